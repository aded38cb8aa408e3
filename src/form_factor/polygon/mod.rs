//! Form factors between two convex planar polygons with nothing in between, to a tolerance.
//!
//! Two rules, chosen by distance, size and tolerance: double contour integrals ([`contour`]) where the polygons are near or touch, and
//! product Gauss rules ([`product`]) where they are far. The contour integral loses about (R/h)^4 roundings of f64 between
//! polygons of size h at distance R; the product rule loses digits as they come near. What one polygon has behind the other is
//! cut off first. All in f64 and in any one unit of length.

pub mod contour;
mod gauss;
mod product;
pub mod shadow;
pub mod shaft;

use crate::math::DVec3;
use product::{MOST_NODES, Nodes};
use smallvec::SmallVec;

/// Corners of a polygon; up to eight take no memory of their own.
type Corners = SmallVec<[DVec3; 8]>;

/// Heights above a plane below this share of the size of a pair are 0: they are rounding.
const FLAT: f64 = 1e-12;
/// Polygons are halved at most this often where neither rule is good enough.
const DEEPEST: u32 = 12;

/// A convex planar polygon that can be asked for form factors to many others.
#[derive(Debug, Clone)]
pub struct Polygon {
    corners: Corners,
    normal: DVec3,
    area: f64,
    center: DVec3,
    radius: f64,
    /// Product rules of two and three nodes a side, if the polygon has three or four corners: most pairs need no more.
    nodes: Option<Box<[Nodes; 2]>>,
}

impl Polygon {
    /// A polygon by its corners, counter-clockwise as seen from its front; `None` if it has no area. It must be convex and planar.
    pub fn new(corners: &[DVec3]) -> Option<Self> {
        let mut polygon = Self::without_nodes(corners.iter().copied().collect())?;
        if polygon.corners.len() <= 4 {
            let panel = polygon.panels().next()?;
            polygon.nodes = Some(Box::new([Nodes::new(&panel, 2), Nodes::new(&panel, 3)]));
        }
        Some(polygon)
    }

    fn without_nodes(corners: Corners) -> Option<Self> {
        let first = *corners.first()?;
        // Relative to a corner, so that a place far from the origin costs no digits.
        let (mut twice, mut moment) = (DVec3::ZERO, DVec3::ZERO);
        for pair in corners[1..].windows(2) {
            let cross = (pair[0] - first).cross(pair[1] - first);
            twice += cross;
            moment += cross.length() * (pair[0] + pair[1] - 2.0 * first) / 3.0;
        }
        let length = twice.length();
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let center = first + moment / length;
        let radius = corners.iter().map(|c| c.distance_squared(center)).fold(0.0, f64::max).sqrt();
        Some(Self { corners, normal: twice / length, area: 0.5 * length, center, radius, nodes: None })
    }

    /// Corners, counter-clockwise from the front.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners
    }

    /// Unit normal of the front.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// Area [m²].
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Centroid.
    pub fn center(&self) -> DVec3 {
        self.center
    }

    /// Radius of a ball around the centroid that holds it.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The same polygon seen from behind.
    pub fn flipped(&self) -> Self {
        let corners: Corners = self.corners.iter().rev().copied().collect();
        Self { corners, normal: -self.normal, ..self.clone() }
    }

    /// True unless one of the two lies behind the other's plane, up to heights of `slack`.
    pub fn may_see(&self, other: &Polygon, slack: f64) -> bool {
        !matches!(self.side_of(other, slack), Side::Behind) && !matches!(other.side_of(self, slack), Side::Behind)
    }

    /// A_p F_pq = A_q F_qp [m²] with nothing in between, within about `tolerance` of its value.
    pub fn transfer(&self, other: &Polygon, tolerance: f64) -> f64 {
        let flat = FLAT * (self.radius + other.radius + self.center.distance(other.center));
        match (self.side_of(other, flat), other.side_of(self, flat)) {
            (Side::Behind, _) | (_, Side::Behind) => 0.0,
            (Side::Front, Side::Front) => between(self, other, tolerance, DEEPEST).clamp(0.0, self.area.min(other.area)),
            _ => {
                let seen = other.clipped(self, flat).zip(self.clipped(other, flat));
                let whole = |(q, p): (Polygon, Polygon)| between(&p, &q, tolerance, DEEPEST);
                seen.map_or(0.0, whole).clamp(0.0, self.area.min(other.area))
            }
        }
    }

    /// On which side of this polygon's plane `other` lies.
    #[inline]
    fn side_of(&self, other: &Polygon, flat: f64) -> Side {
        let middle = self.normal.dot(other.center - self.center);
        if middle > other.radius {
            return Side::Front;
        }
        if middle <= flat - other.radius {
            return Side::Behind;
        }
        let heights = other.corners.iter().map(|c| self.normal.dot(*c - self.center));
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| (l.min(d), h.max(d)));
        if high <= flat {
            Side::Behind
        } else if low >= -flat {
            Side::Front
        } else {
            Side::Across
        }
    }

    /// The part of this polygon in front of the plane of `by`.
    fn clipped(&self, by: &Polygon, flat: f64) -> Option<Polygon> {
        let n = self.corners.len();
        let height = |c: DVec3| {
            let d = by.normal.dot(c - by.center);
            if d.abs() <= flat { 0.0 } else { d }
        };
        let mut kept = Corners::new();
        for i in 0..n {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % n]);
            let (d, e) = (height(a), height(b));
            if d >= 0.0 {
                kept.push(a);
            }
            if d * e < 0.0 {
                kept.push(a + (b - a) * (d / (d - e)));
            }
        }
        Polygon::without_nodes(kept)
    }

    /// Bilinear quadrilaterals that cover it, the last one perhaps with two corners alike.
    pub fn panels(&self) -> impl Iterator<Item = [DVec3; 4]> {
        let c = &self.corners;
        (1..c.len() - 1).step_by(2).map(|k| [c[0], c[k], c[k + 1], c[(k + 2).min(c.len() - 1)]])
    }

    /// Two halves, cut across the direction in which it is longest.
    fn halves(&self) -> Option<[Polygon; 2]> {
        let n = self.corners.len();
        let longest = (0..n).max_by(|&i, &k| {
            let reach = |i: usize| self.corners[i].distance_squared(self.center);
            reach(i).total_cmp(&reach(k))
        })?;
        let along = (self.corners[longest] - self.center).normalize_or_zero();
        let side = |normal: DVec3| {
            let plane = Polygon { corners: Corners::new(), normal, area: 0.0, center: self.center, radius: 0.0, nodes: None };
            self.clipped(&plane, 0.0)
        };
        Some([side(along)?, side(-along)?])
    }
}

/// Where a polygon lies beside a plane.
enum Side {
    Front,
    Behind,
    Across,
}

/// A_p F_pq [m²] of two convex planar polygons with nothing in between, counter-clockwise as seen from their fronts, within about
/// `tolerance` of its value. It is the same for (p, q) and (q, p) up to rounding. 0 for polygons without area.
pub fn transfer(p: &[DVec3], q: &[DVec3], tolerance: f64) -> f64 {
    let polygon = |corners: &[DVec3]| Polygon::without_nodes(corners.iter().copied().collect());
    polygon(p).zip(polygon(q)).map_or(0.0, |(p, q)| p.transfer(&q, tolerance))
}

/// The integral between two polygons that lie in front of each other.
fn between(p: &Polygon, q: &Polygon, tolerance: f64, depth: u32) -> f64 {
    let most = if tolerance >= 1e-8 { 4 } else { MOST_NODES };
    if let Some(n) = nodes_needed(p, q, tolerance).filter(|n| *n <= most) {
        return by_product(p, q, n);
    }
    let contour = contour::transfer(&p.corners, &q.corners, tolerance);
    // Cancellation is worst between the far ends of polygons much longer than wide: shorter ones suffer less.
    let is_apart = p.center.distance(q.center) > 2.0 * p.radius.min(q.radius);
    if depth > 0 && is_apart && contour.rounding > tolerance * contour.value {
        let (long, short) = if p.radius >= q.radius { (p, q) } else { (q, p) };
        if let Some([a, b]) = long.halves() {
            return between(&a, short, tolerance, depth - 1) + between(&b, short, tolerance, depth - 1);
        }
    }
    contour.value
}

/// Nodes a side with which product rules reach `tolerance`, if any do: an n-point rule on a panel of half width a errs as rho^(-2n), where the
/// nearest singularity, at distance D or more, lies on the ellipse with rho = D/a + sqrt((D/a)² + 1) [Trefethen08, theorem 4.5].
#[inline]
fn nodes_needed(p: &Polygon, q: &Polygon, tolerance: f64) -> Option<usize> {
    let room = p.center.distance(q.center) - p.radius - q.radius;
    let x = room / p.radius.max(q.radius);
    if x < 0.5 {
        return None;
    }
    let rho2 = 4.0 * x * x + 2.0;
    let mut error = RULE_ERROR / (rho2 * rho2);
    // The area of a panel with two corners alike grows from one side to the other and takes up a degree of the rule.
    if (p.corners.len() | q.corners.len()) & 1 == 1 {
        error *= rho2.sqrt();
    }
    let mut n = 2;
    while error > tolerance {
        error /= rho2;
        n += 1;
        if n > MOST_NODES {
            return None;
        }
    }
    Some(n)
}

/// Measured on squares and triangles in many positions: the error of a rule is below this times rho^(-2n).
const RULE_ERROR: f64 = 4.0;

fn by_product(p: &Polygon, q: &Polygon, n: usize) -> f64 {
    if let (2 | 3, Some(a), Some(b)) = (n, &p.nodes, &q.nodes) {
        return product::integrate(&a[n - 2], p.normal, &b[n - 2], q.normal);
    }
    let nodes: SmallVec<[Nodes; 1]> = q.panels().map(|panel| Nodes::new(&panel, n)).collect();
    let over_q = |panel: [DVec3; 4]| {
        let own = Nodes::new(&panel, n);
        nodes.iter().map(|other| product::integrate(&own, p.normal, other, q.normal)).sum::<f64>()
    };
    p.panels().map(over_q).sum()
}

#[cfg(test)]
mod tests;
