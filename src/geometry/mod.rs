//! Rays, hits, boxes, and the rule by which a ray leaves a surface.

pub mod mesh;
pub mod soup;
pub mod sphere;
pub mod tessellate;
pub mod triangle;

pub use mesh::Mesh;
pub use soup::Soup;
pub use sphere::Sphere;

use crate::math::Vec3;

/// A ray `origin + t direction` for t in (`t_min`, `t_max`). The direction need not have unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Start point.
    pub origin: Vec3,
    /// Direction; t counts in multiples of it.
    pub direction: Vec3,
    /// Hits at or below this t do not count.
    pub t_min: f32,
    /// Hits at or beyond this t do not count.
    pub t_max: f32,
}

impl Ray {
    /// A ray without an end.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// A ray from `origin` that ends just before `target`, as a shadow ray does: t runs from 0 to 1.
    ///
    /// The end is pulled in by a relative amount that covers the rounding of the direction and of the hit distance.
    #[inline]
    pub fn between(origin: Vec3, target: Vec3) -> Self {
        Self { origin, direction: target - origin, t_min: 0.0, t_max: 1.0 - 16.0 * f32::EPSILON }
    }

    /// The point at parameter `t`.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }

    /// False if a NaN or an infinity makes the ray meaningless, or its direction is zero. Such a ray hits nothing.
    #[inline]
    pub fn is_valid(&self) -> bool {
        self.origin.is_finite()
            && self.direction.is_finite()
            && self.direction != Vec3::ZERO
            && !self.t_min.is_nan()
            && !self.t_max.is_nan()
    }
}

/// Nearest intersection of a ray: its parameter and the primitive's index in the [`Soup`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Ray parameter of the hit.
    pub t: f32,
    /// Index of the primitive: triangles first, then spheres.
    pub primitive: u32,
}

/// Axis-aligned box; empty when `min > max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Bounds {
    /// The box that holds nothing.
    pub const EMPTY: Bounds = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// Box of two corners.
    pub fn new(min: Vec3, max: Vec3) -> Self {
        Self { min, max }
    }

    /// True if it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// The box grown to hold `point`.
    #[inline]
    pub fn with_point(self, point: Vec3) -> Self {
        Self { min: self.min.min(point), max: self.max.max(point) }
    }

    /// The box that holds both.
    pub fn union(self, other: Bounds) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The box grown by `margin` on every side.
    pub fn expanded(self, margin: f32) -> Self {
        Self { min: self.min - margin, max: self.max + margin }
    }

    /// True if the two boxes share a point.
    #[inline]
    pub fn overlaps(&self, other: &Bounds) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    /// Length of the diagonal; 0 when empty.
    pub fn diagonal(&self) -> f32 {
        if self.is_empty() { 0.0 } else { (self.max - self.min).length() }
    }

    /// Centre.
    pub fn center(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }
}

impl FromIterator<Vec3> for Bounds {
    fn from_iter<I: IntoIterator<Item = Vec3>>(points: I) -> Self {
        points.into_iter().fold(Bounds::EMPTY, Bounds::with_point)
    }
}

/// Start point of a ray that leaves the surface at `point` on the side towards which `direction` points.
///
/// `normal` is the geometric unit normal and `error` bounds the rounding of `point` per coordinate. The point moves along the
/// normal until the error box lies on one side of the surface, then outward by one more ulp (Pharr, Jakob and Humphreys 2016,
/// section 3.9.5).
#[inline]
pub fn offset_origin(point: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    let distance = normal.abs().dot(error);
    let offset = if direction.dot(normal) < 0.0 { -distance * normal } else { distance * normal };
    let moved = point + offset;
    Vec3::new(outward(moved.x, offset.x), outward(moved.y, offset.y), outward(moved.z, offset.z))
}

/// The next number after `x` in the direction of `offset`; `x` itself for an offset of zero.
///
/// As `next_up` and `next_down`, without branches: of two numbers with the same sign, the one with the higher bits is farther from zero.
#[inline(always)]
fn outward(x: f32, offset: f32) -> f32 {
    let (bits, sign) = (x.to_bits(), offset.to_bits() & 0x8000_0000);
    let step = if (bits ^ sign) >> 31 == 0 { 1 } else { u32::MAX };
    let next = if x == 0.0 { sign | 1 } else { bits.wrapping_add(step) };
    if offset == 0.0 || !x.is_finite() { x } else { f32::from_bits(next) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offset_origin_is_off_the_surface_on_the_asked_side() {
        let (p, n) = (Vec3::new(3.0, -2.0, 7.0), Vec3::new(0.6, 0.0, 0.8));
        let error = Vec3::splat(1e-6);
        for (d, sign) in [(n, 1.0), (-n, -1.0)] {
            let o = offset_origin(p, error, n, d);
            assert!(sign * (o - p).dot(n) > 1e-6, "moved by {}", (o - p).dot(n));
        }
    }

    #[test]
    fn a_step_outward_is_the_next_number_on_that_side() {
        let values = [0.0, -0.0, 1.0, -1.0, 1e-45, -1e-45, f32::MIN_POSITIVE, -f32::MIN_POSITIVE, 16_777_216.0, -2.5, f32::MAX];
        for x in values {
            assert_eq!(outward(x, 1e-9).to_bits(), x.next_up().to_bits(), "up from {x}");
            assert_eq!(outward(-x, -3.0).to_bits(), (-x).next_down().to_bits(), "down from {}", -x);
            assert_eq!((outward(x, 0.0).to_bits(), outward(x, -0.0).to_bits()), (x.to_bits(), x.to_bits()));
        }
        assert!(outward(f32::NAN, 1.0).is_nan());
    }

    #[test]
    fn an_empty_box_overlaps_nothing() {
        let unit = Bounds::new(Vec3::ZERO, Vec3::ONE);
        assert!(!Bounds::EMPTY.overlaps(&unit) && Bounds::EMPTY.is_empty());
        assert_eq!(Bounds::EMPTY.diagonal(), 0.0);
    }
}
