//! The double contour integral between two polygons, edge pair by edge pair: for near and touching ones.
//!
//! Stokes' theorem turns the integral over both areas into A_p F_pq = 1/(2 pi) sum_ij cos_ij int int ln r ds dt over pairs of edges,
//! where cos_ij is the cosine between their directions and both polygons run counter-clockwise as seen from the front
//! [Cohen93, section 4.3]; the same integral is solved in closed form by [Schroeder93]. Here the inner integral is closed
//! everywhere. The outer one is closed for parallel edges. For others it is a Gauss rule on panels that shrink geometrically towards the points where
//! the inner one is singular, so that edges may touch, cross in a vertex or be parallel up to rounding.

use super::gauss;
use crate::math::DVec3;
use std::f64::consts::PI;

/// Directions whose sine is below this are parallel: what that changes is of its square, or odd about the middle of an edge.
const PARALLEL: f64 = 1e-13;
/// Edge pairs of which no more than this cosine counts are left out.
const PERPENDICULAR: f64 = 1e-15;
/// A panel this share of its edge is not divided further: what x ln x hides there is of the square of it.
const SMALLEST_PANEL: f64 = 1e-8;
/// A panel at a singular point is divided at this share of it.
const GRADING: f64 = 0.18;

/// Sum with a bound on what rounding has done to it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Estimate {
    /// A_p F_pq [m²].
    pub value: f64,
    /// Bound on its rounding error [m²], within a small factor.
    pub rounding: f64,
}

/// A_p F_pq of two polygons in front of each other, counter-clockwise from their fronts, by contour integrals. `tolerance`: relative
/// error of the edge integrals that are not closed.
pub fn transfer(p: &[DVec3], q: &[DVec3], tolerance: f64) -> Estimate {
    // Lengths are divided by one that is typical for the distances: what ln r has in common for all pairs cancels in the sum.
    let scale = typical_distance(p, q);
    let (mut sum, mut size) = (0.0, 0.0);
    for i in 0..p.len() {
        let (a, b) = (p[i], p[(i + 1) % p.len()]);
        let along_p = (b - a) / scale;
        let length_p = along_p.length();
        if length_p == 0.0 {
            continue;
        }
        let u = along_p / length_p;
        for k in 0..q.len() {
            let (c, d) = (q[k], q[(k + 1) % q.len()]);
            let along_q = (d - c) / scale;
            let length_q = along_q.length();
            if length_q == 0.0 {
                continue;
            }
            let v = along_q / length_q;
            let cosine = u.dot(v);
            if cosine.abs() <= PERPENDICULAR {
                continue;
            }
            let edges = EdgePair { from: (a - c) / scale, u, v, length_p, length_q };
            let integral = edges.log_squared(tolerance);
            sum += cosine * integral;
            size += cosine.abs() * (integral.abs() + length_p * length_q);
        }
    }
    let factor = scale * scale / (4.0 * PI);
    Estimate { value: sum * factor, rounding: 4.0 * f64::EPSILON * size * factor }
}

fn typical_distance(p: &[DVec3], q: &[DVec3]) -> f64 {
    let middle = |polygon: &[DVec3]| polygon.iter().sum::<DVec3>() / polygon.len() as f64;
    let (m, n) = (middle(p), middle(q));
    let radius = |polygon: &[DVec3], m: DVec3| polygon.iter().map(|c| (*c - m).length_squared()).fold(0.0, f64::max);
    (m.distance_squared(n) + radius(p, m) + radius(q, n)).sqrt()
}

/// Two edges by unit directions and lengths; `from` leads from the start of q's to that of p's.
struct EdgePair {
    from: DVec3,
    u: DVec3,
    v: DVec3,
    length_p: f64,
    length_q: f64,
}

impl EdgePair {
    /// The integral of ln r² over both edges.
    fn log_squared(&self, tolerance: f64) -> f64 {
        let sine2 = self.u.cross(self.v).length_squared();
        if sine2 <= PARALLEL * PARALLEL {
            return self.parallel();
        }
        let points = self.singular_points(sine2);
        let (n, clearance) = match tolerance {
            1e-4.. => (5, 3.4),
            1e-7.. => (8, 3.4),
            _ => (12, 3.8),
        };
        let outer =
            Outer { edges: self, points: &points, nodes: gauss::rule(n), clearance, smallest: SMALLEST_PANEL * self.length_p };
        outer.integrate(0.0, self.length_p, 0)
    }

    /// Second differences of G(x) with G'' = ln(x² + d²): G = (x² - d²)/2 ln(x² + d²) - 3x²/2 + 2 d x atan(x/d).
    fn parallel(&self) -> f64 {
        let sign = self.u.dot(self.v).signum();
        let start = self.from.dot(self.v);
        // The lines' distance, taken at the middles: parallel is up to rounding.
        let between = self.from + 0.5 * self.length_p * self.u;
        let d2 = (between - between.dot(self.v) * self.v).length_squared();
        let d = d2.sqrt();
        let g = |x: f64| {
            let r2 = x * x + d2;
            if r2 == 0.0 {
                return 0.0;
            }
            let arc = if d > 0.0 { 2.0 * d * x * (x / d).atan() } else { 0.0 };
            0.5 * (x * x - d2) * r2.ln() - 1.5 * x * x + arc
        };
        // p's edge covers [low, high] on q's line, whichever way it runs.
        let end = start + sign * self.length_p;
        let (low, high) = (start.min(end), start.max(end));
        (g(high) - g(low)) - (g(high - self.length_q) - g(low - self.length_q))
    }

    /// The integral of ln r² over q's edge from the point `s` along p's.
    #[inline]
    fn inner(&self, s: f64) -> f64 {
        let w = self.from + s * self.u;
        let foot = w.dot(self.v);
        let h2 = (w - foot * self.v).length_squared();
        let h = h2.sqrt();
        let (x0, x1) = (-foot, self.length_q - foot);
        let logs = x_log(x1, x1 * x1 + h2) - x_log(x0, x0 * x0 + h2);
        logs - 2.0 * self.length_q + 2.0 * h * (h * self.length_q).atan2(h2 + x0 * x1)
    }

    /// Points s ± i d of p's line where the inner integral is singular: beside q's two ends, and where the lines pass each other.
    fn singular_points(&self, sine2: f64) -> [(f64, f64); 3] {
        let beside = |end: DVec3| {
            let w = end - self.from;
            let s = w.dot(self.u);
            (s, (w - s * self.u).length())
        };
        let cosine = self.u.dot(self.v);
        // The point of p's line that is nearest to q's.
        let s = (cosine * self.from.dot(self.v) - self.from.dot(self.u)) / sine2;
        let w = self.from + s * self.u;
        let distance = (w - w.dot(self.v) * self.v).length() / sine2.sqrt();
        // Beyond q's edge the two arcs cancel there: a pole of neither.
        let foot = w.dot(self.v);
        let passes = foot > -1e-9 * self.length_q && foot < self.length_q * (1.0 + 1e-9);
        let crossing = if passes { (s, distance) } else { (f64::INFINITY, f64::INFINITY) };
        [beside(DVec3::ZERO), beside(self.length_q * self.v), crossing]
    }
}

/// x ln y, 0 where y is.
#[inline]
fn x_log(x: f64, y: f64) -> f64 {
    if y > 0.0 { x * y.ln() } else { 0.0 }
}

/// The outer integral along p's edge.
struct Outer<'a> {
    edges: &'a EdgePair,
    points: &'a [(f64, f64); 3],
    nodes: &'static gauss::Rule,
    /// Sum of the half axes of the smallest Bernstein ellipse that may have no singular point inside, doubled: rho + 1/rho.
    clearance: f64,
    smallest: f64,
}

impl Outer<'_> {
    fn integrate(&self, from: f64, to: f64, depth: u32) -> f64 {
        let width = to - from;
        let (half, middle) = (0.5 * width, 0.5 * (from + to));
        let worst = self
            .points
            .iter()
            .filter(|(s, _)| s.is_finite())
            .map(|&(s, d)| {
                let x = (s - middle) / half;
                let y2 = (d / half) * (d / half);
                (((x - 1.0) * (x - 1.0) + y2).sqrt() + ((x + 1.0) * (x + 1.0) + y2).sqrt(), s)
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match worst {
            Some((room, s)) if room < self.clearance && width > self.smallest && depth < 64 => {
                let cut = if s <= from + 1e-3 * width {
                    from + GRADING * width
                } else if s >= to - 1e-3 * width {
                    to - GRADING * width
                } else {
                    s
                };
                self.integrate(from, cut, depth + 1) + self.integrate(cut, to, depth + 1)
            }
            _ => self.nodes.nodes().map(|(x, w)| w * self.edges.inner(from + x * width)).sum::<f64>() * width,
        }
    }
}
