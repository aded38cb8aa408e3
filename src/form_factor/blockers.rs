//! What may stand between two patches: the scene's surfaces as convex polygons, in a tree that is asked by shafts.

use super::polygon::Polygon;
use super::polygon::shaft::Shaft;
use crate::geometry::soup::Primitive;
use crate::math::DVec3;
use crate::world::World;
use smallvec::SmallVec;

/// Most surfaces in a leaf of the tree.
const LEAF: usize = 4;
/// Two triangles are one quadrilateral if no corner is further from their plane than this share of their size.
const COPLANAR: f64 = 1e-6;

/// One surface.
#[derive(Debug, Clone)]
struct Blocker {
    /// `None`: a sphere, known by its box only.
    polygon: Option<Polygon>,
    low: DVec3,
    high: DVec3,
}

struct Node {
    low: DVec3,
    high: DVec3,
    /// Leaf: first and last blocker. Inner node: the second child; the first one follows its parent.
    first: u32,
    last: u32,
    second: u32,
}

/// All surfaces of a scene. Mirrors, glass and masks are among them: light that passes them is not seen directly.
pub struct Blockers {
    blockers: Vec<Blocker>,
    nodes: Vec<Node>,
    /// Lengths below this are rounding of the scene's f32 coordinates.
    slack: f64,
}

/// What a shaft meets.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// Indices of polygons.
    pub polygons: SmallVec<[u32; 24]>,
    /// True if there may be more than that: a sphere, or more polygons than asked for.
    pub more: bool,
}

impl Found {
    /// True if nothing stands in between.
    pub fn is_clear(&self) -> bool {
        self.polygons.is_empty() && !self.more
    }
}

impl Blockers {
    /// Collects the surfaces; two neighbouring triangles that form a convex quadrilateral count as one.
    pub fn new(world: &World) -> Self {
        let soup = world.soup();
        let mut blockers = Vec::with_capacity(soup.len());
        let triangle = |i: usize| soup.corners(i).map(|c| c.as_dvec3());
        let n = soup.triangles.len();
        let mut i = 0;
        while i < n {
            let together = (i + 1 < n && world.shape_index(i as u32) == world.shape_index(i as u32 + 1))
                .then(|| merged(triangle(i), triangle(i + 1), COPLANAR));
            let corners = together.flatten();
            i += 1 + usize::from(corners.is_some());
            let polygon = match corners {
                Some(quad) => Polygon::new(&quad),
                None => Polygon::new(&triangle(i - 1)),
            };
            blockers.extend(polygon.map(|polygon| {
                let (low, high) = extent(polygon.corners());
                Blocker { polygon: Some(polygon), low, high }
            }));
        }
        for k in n..soup.len() {
            if let Primitive::Sphere(s) = soup.primitive(k as u32) {
                let (center, r) = (s.center.as_dvec3(), DVec3::splat(f64::from(s.radius)));
                blockers.push(Blocker { polygon: None, low: center - r, high: center + r });
            }
        }
        Self::over(blockers)
    }

    fn over(mut blockers: Vec<Blocker>) -> Self {
        let (low, high) = bounds(&blockers);
        let farthest = low.abs().max(high.abs()).max_element();
        let slack = 4.0 * f64::from(f32::EPSILON) * if farthest.is_finite() { farthest } else { 0.0 };
        let mut nodes = Vec::new();
        if !blockers.is_empty() {
            let all = blockers.len();
            build(&mut blockers, 0, all, &mut nodes);
        }
        Self { blockers, nodes, slack }
    }

    /// Lengths below this are rounding of the scene's coordinates.
    pub fn slack(&self) -> f64 {
        self.slack
    }

    /// Polygon `index`.
    pub fn polygon(&self, index: u32) -> Option<&Polygon> {
        self.blockers[index as usize].polygon.as_ref()
    }

    /// What may stand in `shaft`; the search ends after `most` polygons.
    pub fn find(&self, shaft: &Shaft, most: usize) -> Found {
        let mut found = Found::default();
        let mut stack: SmallVec<[u32; 64]> = SmallVec::new();
        if !self.nodes.is_empty() {
            stack.push(0);
        }
        while let Some(at) = stack.pop() {
            let node = &self.nodes[at as usize];
            if !shaft.may_hold_box(node.low, node.high) {
                continue;
            }
            if node.second != 0 {
                stack.push(node.second);
                stack.push(at + 1);
                continue;
            }
            for index in node.first..node.last {
                if self.may_hold(shaft, index) {
                    match self.blockers[index as usize].polygon {
                        Some(_) if found.polygons.len() < most => found.polygons.push(index),
                        _ => {
                            found.more = true;
                            return found;
                        }
                    }
                }
            }
        }
        found
    }

    /// True unless blocker `index` certainly lies outside `shaft`.
    pub fn may_hold(&self, shaft: &Shaft, index: u32) -> bool {
        let blocker = &self.blockers[index as usize];
        match &blocker.polygon {
            Some(polygon) => shaft.may_hold(polygon.corners()),
            None => shaft.may_hold_box(blocker.low, blocker.high),
        }
    }
}

fn extent(corners: &[DVec3]) -> (DVec3, DVec3) {
    corners.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), c| (l.min(*c), h.max(*c)))
}

fn bounds(blockers: &[Blocker]) -> (DVec3, DVec3) {
    blockers.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), b| (l.min(b.low), h.max(b.high)))
}

/// A tree in preorder, split at the median of the longest side.
fn build(blockers: &mut [Blocker], from: usize, to: usize, nodes: &mut Vec<Node>) {
    let (low, high) = bounds(&blockers[from..to]);
    let at = nodes.len();
    nodes.push(Node { low, high, first: from as u32, last: to as u32, second: 0 });
    if to - from <= LEAF {
        return;
    }
    let axis = (high - low).max_position();
    let middle = (to - from) / 2;
    let key = |b: &Blocker| b.low[axis] + b.high[axis];
    blockers[from..to].select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    build(blockers, from, from + middle, nodes);
    nodes[at].second = nodes.len() as u32;
    build(blockers, from + middle, to, nodes);
}

/// The quadrilateral that two triangles form, if they share an edge, lie in one plane up to the share `coplanar` of their size with the same
/// side up, and it is convex.
pub fn merged(a: [DVec3; 3], b: [DVec3; 3], coplanar: f64) -> Option<[DVec3; 4]> {
    // The corner of b that a has not, and the one of a opposite the shared edge.
    let own = (0..3).find(|&k| !a.contains(&b[k]))?;
    let apex = (0..3).find(|&k| !b.contains(&a[k]))?;
    let (p, q, r, s) = (a[apex], a[(apex + 1) % 3], b[own], a[(apex + 2) % 3]);
    // q to s is the shared edge; b runs along it the other way.
    if b[(own + 1) % 3] != s || b[(own + 2) % 3] != q {
        return None;
    }
    let quad = [p, q, r, s];
    let normal = (q - p).cross(s - p).normalize_or_zero();
    let size = (r - p).length().max((s - q).length());
    let is_convex = (0..4).all(|i| {
        let (u, v, w) = (quad[i], quad[(i + 1) % 4], quad[(i + 2) % 4]);
        (v - u).cross(w - v).dot(normal) > 0.0
    });
    (is_convex && (r - p).dot(normal).abs() <= coplanar * size).then_some(quad)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(z: f64, half: f64) -> [DVec3; 4] {
        [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| DVec3::new(x, y, z))
    }

    fn blockers(polygons: &[[DVec3; 4]]) -> Blockers {
        let of = |p: &[DVec3; 4]| {
            let (low, high) = extent(p);
            Blocker { polygon: Polygon::new(p), low, high }
        };
        Blockers::over(polygons.iter().map(of).collect())
    }

    #[test]
    fn two_triangles_of_a_square_are_one_polygon_and_others_are_not() {
        let [a, b, c, d] = square(0.0, 1.0);
        assert_eq!(merged([a, b, c], [a, c, d], COPLANAR).map(|q| Polygon::new(&q).unwrap().area()), Some(4.0));
        assert!(merged([a, b, c], [a, d, c], COPLANAR).is_none(), "the other side up");
        assert!(merged([a, b, c], [a, c, d + DVec3::Z], COPLANAR).is_none(), "out of the plane");
        assert!(merged([a, b, c], [a, c, 0.9 * b + 0.1 * d], COPLANAR).is_none(), "not convex");
    }

    #[test]
    fn shafts_find_what_stands_between_and_nothing_else() {
        let [low, high] = [square(0.0, 1.0), square(4.0, 1.0)];
        let q: Vec<DVec3> = high.into_iter().rev().collect();
        let (p, q) = (Polygon::new(&low).unwrap(), Polygon::new(&q).unwrap());
        let shift = |d: DVec3| square(2.0, 0.25).map(|c| c + d);
        // In the middle; just beside; above q's plane; the walls' own planes; touching a side plane.
        let all = [shift(DVec3::ZERO), shift(DVec3::X * 1.3), shift(DVec3::Z * 3.0), low, high, shift(DVec3::X * 1.25)];
        let found = blockers(&all);
        let shaft = Shaft::between(&p, &q, found.slack());
        let inside: Vec<u32> = (0..6).filter(|&i| found.may_hold(&shaft, i)).collect();
        let middle = inside.iter().map(|&i| found.polygon(i).unwrap().center());
        assert_eq!(middle.collect::<Vec<_>>(), [DVec3::Z * 2.0]);
        assert_eq!(found.find(&shaft, 9).polygons.to_vec(), inside);
        assert!(found.find(&shaft, 0).more, "more than none");
    }
}
