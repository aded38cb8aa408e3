//! Every primitive for every ray, in f64: the oracle for the other engines.
//!
//! Its triangle test is not theirs: signs of the triple products of corner directions, as in Möller and Trumbore's or Plücker's
//! form, with about 1e-16 of relative rounding against 1e-7.

use std::sync::Arc;

use super::query::{is_better, usable};
use super::{Accel, Ray, Soup};
use crate::geometry::Hit;
use crate::geometry::soup::Primitive;
use crate::math::{DVec3, Vec3};

/// The engine without bounding volumes.
pub struct BruteForce {
    soup: Arc<Soup>,
}

impl BruteForce {
    /// Takes the primitives as they are.
    pub fn new(soup: Arc<Soup>) -> Self {
        Self { soup }
    }

    /// All hits of a ray.
    fn hits(&self, ray: &Ray) -> impl Iterator<Item = Hit> {
        usable(ray).into_iter().flat_map(move |ray| {
            (0..self.soup.len() as u32).filter_map(move |primitive| {
                let t = match self.soup.primitive(primitive) {
                    Primitive::Triangle(corners) => hit_triangle(&ray, corners),
                    Primitive::Sphere(sphere) => sphere.intersect(&ray, ray.t_min, ray.t_max),
                }?;
                (t > ray.t_min && t < ray.t_max).then_some(Hit { t, primitive })
            })
        })
    }
}

impl Accel for BruteForce {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.hits(ray).fold(None, |best, hit| if is_better(hit, best) { Some(hit) } else { best })
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.hits(ray).next().is_some()
    }

    fn memory_bytes(&self) -> usize {
        0
    }
}

/// Parameter at which the ray's line meets the triangle, in f64, rounded at the end.
fn hit_triangle(ray: &Ray, corners: [Vec3; 3]) -> Option<f32> {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let [a, b, c]: [DVec3; 3] = corners.map(|v| v.as_dvec3() - o);
    // Six times the volumes of the tetrahedra over the edges; a shared edge gives the two triangles exactly opposite values.
    let (u, v, w) = (d.dot(c.cross(b)), d.dot(a.cross(c)), d.dot(b.cross(a)));
    if u.min(v).min(w) < 0.0 && u.max(v).max(w) > 0.0 {
        return None;
    }
    let det = u + v + w;
    if det == 0.0 {
        return None;
    }
    // The hit point is a convex combination of the corners, so t cannot leave their range however thin the triangle.
    let point = (u * a + v * b + w * c) / det;
    Some((point.dot(d) / d.length_squared()) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_and_both_sides_count_and_the_plane_edge_on_does_not() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let shoot = |o, d| hit_triangle(&Ray::new(o, d), corners);
        assert_eq!(shoot(Vec3::new(0.5, 0.5, 2.0), -Vec3::Z), Some(2.0));
        assert_eq!(shoot(Vec3::new(0.5, 0.0, -2.0), 2.0 * Vec3::Z), Some(1.0));
        assert_eq!(shoot(Vec3::new(0.6, 0.6, 2.0), -Vec3::Z), None);
        assert_eq!(shoot(Vec3::new(-1.0, 0.2, 0.0), Vec3::X), None);
    }
}
