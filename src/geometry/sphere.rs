//! Spheres are intersected exactly: glass and mirror balls must not be faceted.

use super::Ray;
use crate::math::{DVec3, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// A sphere; its normal points outward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub center: Vec3,
    /// Radius, greater than 0.
    pub radius: f32,
}

impl Sphere {
    /// Surface area in f64.
    pub fn area(&self) -> f64 {
        4.0 * std::f64::consts::PI * f64::from(self.radius) * f64::from(self.radius)
    }

    /// Smallest ray parameter in (`t_min`, `t_max`) at which `ray` meets the sphere, from outside or inside.
    ///
    /// In f64, by the discriminant of the perpendicular distance, which does not cancel for a far or small sphere
    /// (Haines et al. 2019, Ray Tracing Gems, chapter 7).
    #[inline]
    pub fn intersect(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<f32> {
        let (o, d) = (ray.origin.as_dvec3() - self.center.as_dvec3(), ray.direction.as_dvec3());
        let r2 = f64::from(self.radius) * f64::from(self.radius);
        let a = d.length_squared();
        let b = -o.dot(d);
        let nearest: DVec3 = o + d * (b / a);
        let discriminant = a * (r2 - nearest.length_squared());
        if discriminant < 0.0 {
            return None;
        }
        let q = b + discriminant.sqrt().copysign(b);
        let c = o.length_squared() - r2;
        // The two roots without cancellation; q is zero only for a ray that starts in the surface along a tangent.
        let (t0, t1) = if q == 0.0 { (0.0, 0.0) } else { (c / q, q / a) };
        let (near, far) = if t0 < t1 { (t0 as f32, t1 as f32) } else { (t1 as f32, t0 as f32) };
        let inside = |t: f32| t > t_min && t < t_max;
        if inside(near) { Some(near) } else { inside(far).then_some(far) }
    }

    /// Outward unit normal at a point on (or near) the surface.
    #[inline]
    pub fn normal(&self, point: Vec3) -> Vec3 {
        (point.as_dvec3() - self.center.as_dvec3()).normalize_or_zero().as_vec3()
    }

    /// Texture coordinates where the outward unit normal is `n`: azimuth over 2 pi and polar angle over pi, about +z.
    #[inline]
    pub fn uv(&self, n: Vec3) -> Vec2 {
        Vec2::new(n.y.atan2(n.x).rem_euclid(TAU) / TAU, n.z.clamp(-1.0, 1.0).acos() / PI)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_meets_the_sphere_from_outside_and_inside() {
        let s = Sphere { center: Vec3::new(1.0, 2.0, 3.0), radius: 0.5 };
        let out = Ray::new(Vec3::new(1.0, 2.0, 0.0), Vec3::Z);
        assert_eq!(s.intersect(&out, 0.0, f32::INFINITY), Some(2.5));
        assert_eq!(s.intersect(&Ray::new(s.center, Vec3::X), 0.0, f32::INFINITY), Some(0.5));
        assert_eq!(s.intersect(&out, 2.6, f32::INFINITY), Some(3.5));
        assert_eq!(s.intersect(&Ray::new(Vec3::ZERO, Vec3::Z), 0.0, f32::INFINITY), None);
    }

    #[test]
    fn a_small_far_sphere_is_still_hit() {
        let s = Sphere { center: Vec3::new(0.0, 0.0, 1e4), radius: 1e-3 };
        let t = s.intersect(&Ray::new(Vec3::ZERO, Vec3::Z), 0.0, f32::INFINITY).expect("hit");
        assert!((t - (1e4 - 1e-3)).abs() < 1e-3, "{t}");
    }
}
