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
