//! The space between two polygons: which surfaces can stand in it, and whether one of them blocks it as a whole.

use super::Polygon;
use crate::math::DVec3;
use smallvec::SmallVec;

/// All segments between two convex polygons lie on the inner side of these planes [Haines94].
#[derive(Debug, Clone)]
pub struct Shaft {
    /// Normal to the outside and offset: `n · x - c` is above 0 outside.
    planes: SmallVec<[(DVec3, f64); 24]>,
    low: DVec3,
    high: DVec3,
    slack: f64,
}

impl Shaft {
    /// The shaft between `p` and `q`. Surfaces that reach into it by less than `slack` count as outside: those that only touch it, such as
    /// the neighbours of p and q in their walls, do so up to rounding.
    pub fn between(p: &Polygon, q: &Polygon, slack: f64) -> Self {
        let corners = || p.corners.iter().chain(&q.corners).copied();
        let low = corners().fold(DVec3::INFINITY, DVec3::min);
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
        let mut shaft = Self { planes: SmallVec::new(), low, high, slack };
        shaft.planes.push((-p.normal, -p.normal.dot(p.center)));
        shaft.planes.push((-q.normal, -q.normal.dot(q.center)));
        shaft.add_sides(p, q);
        shaft.add_sides(q, p);
        shaft
    }

    /// Planes through an edge of `p` and a corner of `q` that have all of both on one side.
    fn add_sides(&mut self, p: &Polygon, q: &Polygon) {
        let n = p.corners.len();
        for i in 0..n {
            let (a, b) = (p.corners[i], p.corners[(i + 1) % n]);
            // With p to one side of its edge, which side is known: that away from p.
            let outward = (b - a).cross(p.normal);
            for &v in &q.corners {
                let mut normal = (b - a).cross(v - a);
                let length = normal.length();
                if length <= 1e-12 * (b - a).length() * (v - a).length() {
                    continue;
                }
                normal *= outward.dot(normal).signum() / length;
                let offset = normal.dot(a);
                let tolerance = 0.1 * self.slack;
                if q.corners.iter().all(|c| normal.dot(*c) - offset <= tolerance)
                    && p.corners.iter().all(|c| normal.dot(*c) - offset <= tolerance)
                {
                    self.planes.push((normal, offset));
                    break;
                }
            }
        }
    }

    /// False if the convex hull of `points` certainly lies outside.
    #[inline]
    pub fn may_hold(&self, points: &[DVec3]) -> bool {
        let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        if (low.cmpgt(self.high) | high.cmplt(self.low)).any() {
            return false;
        }
        !self.planes.iter().any(|(n, c)| points.iter().all(|p| n.dot(*p) - c >= -self.slack))
    }

    /// False if the box certainly lies outside.
    #[inline]
    pub fn may_hold_box(&self, low: DVec3, high: DVec3) -> bool {
        if (low.cmpgt(self.high) | high.cmplt(self.low)).any() {
            return false;
        }
        // The corner of the box that is deepest inside.
        !self.planes.iter().any(|(n, c)| {
            let deepest = DVec3::select(n.cmpgt(DVec3::ZERO), low, high);
            n.dot(deepest) - c >= -self.slack
        })
    }
}

/// True if every segment between `p` and `q` certainly meets the convex polygon `blocker`.
pub fn blocks_all(blocker: &Polygon, p: &Polygon, q: &Polygon, slack: f64) -> bool {
    let height = |c: &DVec3| blocker.normal.dot(*c - blocker.center);
    let range =
        |of: &Polygon| of.corners.iter().map(height).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| (l.min(d), h.max(d)));
    let ((p_low, p_high), (q_low, q_high)) = (range(p), range(q));
    if !(p_low > slack && q_high < -slack || q_low > slack && p_high < -slack) {
        return false;
    }
    let n = blocker.corners.len();
    p.corners.iter().all(|a| {
        q.corners.iter().all(|b| {
            let (d, e) = (height(a), height(b));
            let x = *a + (*b - *a) * (d / (d - e));
            (0..n).all(|i| {
                let (from, to) = (blocker.corners[i], blocker.corners[(i + 1) % n]);
                (to - from).cross(x - from).dot(blocker.normal) >= 0.0
            })
        })
    })
}

/// What is left of two polygons of which each is cut off behind the other's plane; `None` if they do not face each other.
pub fn facing(p: &Polygon, q: &Polygon) -> Option<(Polygon, Polygon)> {
    let flat = super::FLAT * (p.radius + q.radius + p.center.distance(q.center));
    let (mut p, q) = (p.clipped(q, flat)?, q.clipped(p, flat)?);
    p.nodes = None;
    Some((p, q))
}

/// The part of the blocker `of` between the planes of two polygons, in front of both.
pub fn between_planes(of: &Polygon, p: &Polygon, q: &Polygon) -> Option<Polygon> {
    of.clipped(p, 0.0)?.clipped(q, 0.0)
}
