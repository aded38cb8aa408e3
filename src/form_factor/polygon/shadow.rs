//! What a point sees of a polygon past others, with their shadows cut out exactly.

use super::Polygon;
use crate::math::DVec3;
use std::f64::consts::PI;

/// Most edges of a blocker; one with more hides nothing.
const MOST_EDGES: usize = 16;

/// Convex pieces, corners one after the other.
#[derive(Debug, Default)]
struct Pieces {
    corners: Vec<DVec3>,
    ends: Vec<usize>,
}

impl Pieces {
    fn clear(&mut self) {
        self.corners.clear();
        self.ends.clear();
    }

    fn push(&mut self, piece: &[DVec3]) {
        self.corners.extend_from_slice(piece);
        self.ends.push(self.corners.len());
    }
}

/// Buffers that are used again from point to point.
#[derive(Debug, Default)]
pub struct ShadowCutter {
    seen: Pieces,
    next: Pieces,
    inner: Vec<DVec3>,
    outer: Vec<DVec3>,
    rest: Vec<DVec3>,
    heights: Vec<f64>,
}

impl ShadowCutter {
    /// Form factors from a differential element at `x` with unit normal `n` to the polygon `q`, by Lambert's formula [Cohen93, Eq. 4.27]:
    /// to all of it, and to the part that none of `blockers` hides. All of `q` must be above the element's horizon, and the blockers between x and
    /// q's plane.
    pub fn whole_and_visible(&mut self, x: DVec3, n: DVec3, q: &Polygon, blockers: &[Polygon]) -> (f64, f64) {
        self.seen.clear();
        self.seen.corners.extend(q.corners.iter().map(|c| *c - x));
        self.seen.ends.push(self.seen.corners.len());
        let all = lambert(&self.seen.corners, n);
        let mut cut = false;
        for blocker in blockers {
            let facing = blocker.normal.dot(blocker.center - x);
            // A polygon seen edge-on hides nothing.
            if facing.abs() <= 1e-12 * blocker.radius || blocker.corners.len() > MOST_EDGES {
                continue;
            }
            cut |= self.cut(x, blocker, facing.signum());
            if self.seen.ends.is_empty() {
                return (all, 0.0);
            }
        }
        if !cut {
            return (all, all);
        }
        let mut start = 0;
        let mut visible = 0.0;
        for &end in &self.seen.ends {
            visible += lambert(&self.seen.corners[start..end], n);
            start = end;
        }
        (all, visible.min(all))
    }

    /// False if none of `blockers` hides any of `q` from `x`.
    pub fn may_hide(&self, x: DVec3, q: &Polygon, blockers: &[Polygon]) -> bool {
        blockers.iter().any(|blocker| {
            let facing = blocker.normal.dot(blocker.center - x);
            let is_seen = facing.abs() > 1e-12 * blocker.radius && blocker.corners.len() <= MOST_EDGES;
            let n = blocker.corners.len();
            is_seen
                && (0..n).all(|i| {
                    let side = (blocker.corners[(i + n - 1) % n] - x).cross(blocker.corners[i] - x) * facing.signum();
                    q.corners.iter().any(|c| side.dot(*c - x) > 0.0)
                })
        })
    }

    /// Takes the shadow of one blocker out of all pieces; false if it falls on none.
    fn cut(&mut self, x: DVec3, blocker: &Polygon, sign: f64) -> bool {
        let count = blocker.corners.len();
        let mut sides = [DVec3::ZERO; MOST_EDGES];
        let mut from = (blocker.corners[blocker.corners.len() - 1] - x) * sign;
        for (side, corner) in sides.iter_mut().zip(&blocker.corners) {
            let to = *corner - x;
            *side = from.cross(to);
            from = to * sign;
        }
        let sides = &sides[..count];
        let is_beside = |piece: &[DVec3]| sides.iter().any(|side| piece.iter().all(|c| side.dot(*c) <= 0.0));
        let mut start = 0;
        let mut hits = false;
        self.next.clear();
        for k in 0..self.seen.ends.len() {
            let piece = start..self.seen.ends[k];
            start = piece.end;
            let piece = &self.seen.corners[piece];
            if is_beside(piece) {
                self.next.push(piece);
                continue;
            }
            hits = true;
            let (corners, ends) = (self.next.corners.len(), self.next.ends.len());
            self.rest.clear();
            self.rest.extend_from_slice(piece);
            for side in sides {
                split(&self.rest, *side, &mut self.heights, &mut self.inner, &mut self.outer);
                if self.inner.len() < 3 {
                    // Nothing of it is in the shadow: what was cut off before goes back.
                    self.next.corners.truncate(corners);
                    self.next.ends.truncate(ends);
                    self.next.push(piece);
                    break;
                }
                if self.outer.len() >= 3 {
                    self.next.push(&self.outer);
                }
                std::mem::swap(&mut self.rest, &mut self.inner);
            }
        }
        if hits {
            std::mem::swap(&mut self.seen, &mut self.next);
        }
        hits
    }
}

/// The parts of a piece where `side` · v is not below 0, and where it is.
fn split(piece: &[DVec3], side: DVec3, heights: &mut Vec<f64>, inner: &mut Vec<DVec3>, outer: &mut Vec<DVec3>) {
    inner.clear();
    outer.clear();
    heights.clear();
    heights.extend(piece.iter().map(|v| side.dot(*v)));
    if heights.iter().all(|d| *d >= 0.0) {
        inner.extend_from_slice(piece);
        return;
    }
    if heights.iter().all(|d| *d <= 0.0) {
        outer.extend_from_slice(piece);
        return;
    }
    for i in 0..piece.len() {
        let k = if i + 1 == piece.len() { 0 } else { i + 1 };
        let (d, e) = (heights[i], heights[k]);
        if d >= 0.0 {
            inner.push(piece[i]);
        }
        if d <= 0.0 {
            outer.push(piece[i]);
        }
        if d * e < 0.0 {
            let at = piece[i] + (piece[k] - piece[i]) * (d / (d - e));
            inner.push(at);
            outer.push(at);
        }
    }
}

/// Lambert's formula for corners relative to the element, all above its horizon.
fn lambert(corners: &[DVec3], n: DVec3) -> f64 {
    let mut sum = 0.0;
    let mut a = corners[corners.len() - 1];
    for &b in corners {
        let cross = a.cross(b);
        let length = cross.length();
        if length > 0.0 {
            sum += length.atan2(a.dot(b)) * cross.dot(n) / length;
        }
        a = b;
    }
    (sum / (2.0 * PI)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::form_factor::analytic::point_to_polygon;

    fn square(middle: DVec3, half: f64) -> Polygon {
        let corner = |(x, y): (f64, f64)| middle + half * DVec3::new(x, y, 0.0);
        Polygon::new(&[(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner)).unwrap()
    }

    #[test]
    fn shadows_are_cut_out_once_however_they_overlap() {
        // form_factor_cases.csv, OCC_dA_centre_square_with_blocker: Lambert minus Lambert of the shadow.
        let q = square(DVec3::Z, 0.5);
        let blocker = square(DVec3::Z * 0.5, 0.125);
        let mut cutter = ShadowCutter::default();
        let mut visible = |blockers: &[Polygon]| cutter.whole_and_visible(DVec3::ZERO, DVec3::Z, &q, blockers);
        let want = 0.165_978_835_648_252_2;
        let inside = square(DVec3::new(0.02, 0.0, 0.55), 0.1);
        let beside = square(DVec3::new(0.9, 0.0, 0.5), 0.125);
        let all = point_to_polygon(DVec3::ZERO, DVec3::Z, q.corners());
        for blockers in [
            vec![blocker.clone()],
            vec![blocker.clone(), inside.clone(), beside.clone()],
            vec![inside, blocker.flipped(), beside.clone()],
        ] {
            let (whole, seen) = visible(&blockers);
            assert!((whole - all).abs() < 1e-15, "{whole}, expected {all}");
            assert!((seen - want).abs() < 1e-14, "{seen}, expected {want}");
        }
        assert_eq!(visible(&[beside]), (all, all), "beside");
        assert_eq!(visible(&[square(DVec3::Z * 0.5, 0.3)]), (all, 0.0), "hidden");
    }
}
