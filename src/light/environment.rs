//! What surrounds the scene.

use crate::math::{Rgb, Vec3};

/// Radiance from infinitely far.
#[derive(Debug, Clone)]
pub struct Environment {
    /// The same from everywhere.
    pub uniform: Rgb,
}

impl Environment {
    /// Radiance that arrives from `direction` [W/(m² sr)].
    #[inline]
    pub fn radiance(&self, _direction: Vec3) -> Rgb {
        self.uniform
    }

    /// Density per steradian with which shadow rays look at `direction`.
    #[inline]
    pub fn pdf(&self, _direction: Vec3) -> f64 {
        0.0
    }

    /// True if it is the same from everywhere.
    pub fn is_uniform(&self) -> bool {
        true
    }
}
