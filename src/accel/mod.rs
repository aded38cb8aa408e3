//! Nearest-hit and any-hit queries over a [`Soup`], by one of several engines.

use crate::geometry::{Hit, Ray};

/// What every acceleration structure answers. Nothing more: points, normals and uv are found again from (ray, primitive) by one
/// routine of `world`, so that all engines give the same picture.
pub trait Accel: Send + Sync {
    /// The nearest hit with t in (`t_min`, `t_max`).
    fn intersect(&self, ray: &Ray) -> Option<Hit>;

    /// True if anything lies in (`t_min`, `t_max`).
    fn occluded(&self, ray: &Ray) -> bool;
}

use crate::geometry::{Soup, triangle::ShearedRay};
use crate::math::{Vec3, Vec3A};
use obvhs::{aabb::Aabb, bvh2::Bvh2, ploc};
use std::sync::Arc;

/// Engines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AccelKind {
    /// obvhs tree.
    #[default]
    Obvhs,
    /// Embree.
    Embree,
    /// Every primitive.
    BruteForce,
}

/// Why there is no engine.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AccelError {
    /// Not in this build.
    #[error("{0} is not in this build")]
    Missing(&'static str),
}

struct Tmp(Arc<Soup>, Bvh2);
impl Accel for Tmp {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        if !ray.is_valid() {
            return None;
        }
        let sheared = ShearedRay::new(ray);
        let r = obvhs::ray::Ray::new(Vec3A::from(ray.origin), Vec3A::from(ray.direction), ray.t_min, ray.t_max);
        let mut h = obvhs::ray::RayHit::none();
        let mut best: Option<Hit> = None;
        self.1.ray_traverse(r, &mut h, |_, id| {
            let p = self.1.primitive_indices[id];
            let t_max = best.map_or(ray.t_max, |b| b.t);
            match self.0.intersect(p, ray, &sheared, t_max) {
                Some(hit) => {
                    best = Some(hit);
                    hit.t
                }
                None => f32::INFINITY,
            }
        });
        best
    }
    fn occluded(&self, ray: &Ray) -> bool {
        self.intersect(ray).is_some()
    }
}

/// Builds.
///
/// # Errors
/// Never.
pub fn build(soup: Arc<Soup>, _kind: AccelKind) -> Result<Box<dyn Accel>, AccelError> {
    let aabbs: Vec<Aabb> = (0..soup.len() as u32)
        .map(|i| {
            let b = soup.bounds_of(i).expanded(1e-6);
            Aabb::new(Vec3A::from(b.min - Vec3::splat(1e-7)), Vec3A::from(b.max))
        })
        .collect();
    let idx: Vec<u32> = (0..soup.len() as u32).collect();
    let bvh = ploc::PlocBuilder::with_capacity(aabbs.len()).build(ploc::PlocSearchDistance::Medium, &aabbs, idx, ploc::SortPrecision::U64, 0);
    Ok(Box::new(Tmp(soup, bvh)))
}
