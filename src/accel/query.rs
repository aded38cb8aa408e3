//! What a traversal needs to know of a ray, computed once.

use crate::geometry::triangle::ShearedRay;
use crate::geometry::{Hit, Ray};
use crate::math::Vec3;

/// Factor by which the far end of a box's interval is stretched, so that rounding never loses a box.
///
/// With u = 2^-24: a slab parameter `(plane - origin) * (1 / direction)` has a relative error of 3u. A vertex sheared by the
/// triangle test is displaced by at most 5u of its distance along the same axis (difference, reciprocal, two products and their
/// difference), so a ray may meet a triangle whose box it passes by that much. Twice (3 + 5)u covers near and far end; 2^-19 is
/// twice that again and costs no speed.
pub const BOX_SLACK: f32 = 1.0 + 1.0 / (1 << 19) as f32;

/// A valid ray made ready for traversal.
#[derive(Debug, Clone, Copy)]
pub struct Query {
    /// The ray, its `t_min` at least 0.
    pub ray: Ray,
    /// For the triangle test.
    pub sheared: ShearedRay,
    /// One over each direction component; infinite where that is zero.
    pub inverse: Vec3,
}

impl Query {
    /// Prepares a ray; `None` if it cannot hit anything.
    #[inline(always)]
    pub fn new(ray: &Ray) -> Option<Self> {
        let ray = usable(ray)?;
        let inverse = ray.direction.recip();
        // Branches on the largest axis are foreseen where rays are alike; a version without was 10 % slower for shadow rays.
        Some(Self { ray, sheared: ShearedRay::with_inverse(&ray, inverse), inverse })
    }

    /// Axes along which the ray does not move.
    ///
    /// Such a ray may lie in the plane of a flat box. Triangles in it are seen edge-on and none is met, so it can be skipped; or
    /// else a ray along a finely cut wall would pass through every leaf on its way.
    #[inline]
    pub fn still(&self) -> [bool; 3] {
        self.inverse.to_array().map(f32::is_infinite)
    }
}

impl Query {
    /// Parameter at which the ray meets a triangle, in (`t_min`, `limit`).
    #[inline]
    pub fn meet(&self, [a, b, c]: [Vec3; 3], limit: f32) -> Option<f32> {
        let t = self.sheared.intersect(a, b, c, self.ray.t_min, limit)?;
        Some(self.settle(t, [a, b, c])).filter(|&t| t < limit)
    }

    /// The t that counts for a triangle met at `t`: where the ray enters the triangle's own box, if `t` lies before that by more
    /// than [`BOX_SLACK`] allows.
    ///
    /// The t of a triangle seen edge-on is as uncertain as the triangle is deep. A tree passes over boxes that begin behind the best
    /// hit so far, so a t before its own box would win or lose by the order in which leaves are visited. With this rule no order
    /// matters: all boxes around the triangle begin at or before its own one, because `(plane - origin) * inverse` is rounded
    /// monotonically in the plane, and so none of them begins behind `t * BOX_SLACK`.
    #[inline]
    pub fn settle(&self, t: f32, [a, b, c]: [Vec3; 3]) -> f32 {
        let plane = Vec3::select(self.inverse.cmpge(Vec3::ZERO), a.min(b).min(c), a.max(b).max(c));
        let enter = (plane - self.ray.origin) * self.inverse;
        // The maximum passes over NaNs, from a ray inside a face's plane: such a slab does not count.
        let enter = enter.x.max(enter.y).max(enter.z);
        if enter > t * BOX_SLACK { enter } else { t }
    }
}

/// The part of `ray` that can hit anything: nothing of one that is not valid or whose interval is empty, and nothing behind the
/// origin.
#[inline(always)]
pub fn usable(ray: &Ray) -> Option<Ray> {
    // Zero times an infinity or a NaN is a NaN.
    let zero = ray.origin * 0.0 + ray.direction * 0.0;
    let is_finite = zero.x + zero.y + zero.z == 0.0;
    let t_min = ray.t_min.max(0.0);
    // A NaN at either end fails the first comparison.
    let holds_something = (ray.t_min < ray.t_max) & (t_min < ray.t_max);
    (is_finite & holds_something & (ray.direction != Vec3::ZERO)).then_some(Ray { t_min, ..*ray })
}

/// True if `hit` is to be preferred: nearer, or at the same t and of lower index.
#[inline]
pub fn is_better(hit: Hit, than: Option<Hit>) -> bool {
    than.is_none_or(|best| hit.t < best.t || (hit.t == best.t && hit.primitive < best.primitive))
}

/// An end behind `t`, so that other hits at `t` itself still count. `t` is positive and finite.
#[inline]
pub fn inclusive(t: f32) -> f32 {
    f32::from_bits(t.to_bits() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_is_usable_if_valid_and_its_interval_holds_something() {
        let values = [-2.0, -1.0, -0.0, 0.0, 0.5, 1.0, 3.0, f32::NAN, f32::INFINITY];
        for (x, y) in values.into_iter().flat_map(|x| values.map(|y| (x, y))) {
            for (z, t_max) in values.into_iter().flat_map(|z| values.map(|t| (z, t))) {
                let ray = Ray { t_max, ..Ray::new(Vec3::new(1.0, x, 2.0), Vec3::new(x, y, z)) };
                let query = Query::new(&ray);
                assert_eq!(query.is_some(), ray.is_valid() && t_max > 0.0, "{ray:?}");
            }
        }
    }

    #[test]
    fn a_triangle_smaller_than_rounding_is_not_met_from_afar() {
        let corners = [
            Vec3::new(0.085_473_06, 0.078_949_93, 0.203_322_17),
            Vec3::new(0.085_472_815, 0.078_949_92, 0.203_322_23),
            Vec3::new(0.085_473_25, 0.078_949_77, 0.203_322_07),
        ];
        let (o, d) =
            (Vec3::new(0.135_226_25, 0.950_638_53, 0.687_460_9), Vec3::new(-0.193_951_25, -0.167_837_74, -0.055_370_808));
        let query = Query::new(&Ray::new(o, d)).expect("valid");
        assert_eq!(query.meet(corners, f32::INFINITY), None);
        let aimed = Query::new(&Ray::new(o, corners[0] - o)).expect("valid");
        let t = aimed.meet(corners, f32::INFINITY).expect("aimed at a corner");
        assert!((t - 1.0).abs() < 1e-6, "{t}");
    }
}
