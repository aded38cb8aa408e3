//! What a traversal needs to know of a ray, computed once, and the interval test against boxes.

use crate::geometry::triangle::ShearedRay;
use crate::geometry::{Bounds, Hit, Ray};
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
    #[inline]
    pub fn new(ray: &Ray) -> Option<Self> {
        let ray = usable(ray)?;
        Some(Self { ray, sheared: ShearedRay::new(&ray), inverse: ray.direction.recip() })
    }

    /// Parameter at which the ray enters `bounds`, if it does so within [`t_min`, `limit`] (conservative).
    #[inline]
    pub fn enters(&self, bounds: &Bounds, limit: f32) -> Option<f32> {
        let a = (bounds.min - self.ray.origin) * self.inverse;
        let b = (bounds.max - self.ray.origin) * self.inverse;
        let (mut near, mut far) = (self.ray.t_min, limit);
        for axis in 0..3 {
            let (enter, leave) = if self.inverse[axis] >= 0.0 { (a[axis], b[axis]) } else { (b[axis], a[axis]) };
            // 0 * infinity, a ray inside a face's plane, is a NaN: both comparisons fail and the slab does not count.
            near = if enter > near { enter } else { near };
            far = if leave < far { leave } else { far };
        }
        (near <= far * BOX_SLACK).then_some(near)
    }
}

/// The part of `ray` that can hit anything: nothing of one that is not valid, and nothing behind the origin.
#[inline]
pub fn usable(ray: &Ray) -> Option<Ray> {
    ray.is_valid().then(|| Ray { t_min: ray.t_min.max(0.0), ..*ray })
}

/// True if `hit` is to be preferred: nearer, or at the same t and of lower index.
#[inline]
pub fn is_better(hit: Hit, than: Option<Hit>) -> bool {
    than.is_none_or(|best| hit.t < best.t || (hit.t == best.t && hit.primitive < best.primitive))
}

/// Largest t at which a candidate may still matter after a hit at `t`: `t` itself counts, for ties.
#[inline]
pub fn inclusive(t: f32) -> f32 {
    t.next_up()
}
