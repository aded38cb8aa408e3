//! Parallel light from infinitely far away.

use super::LightSample;
use crate::math::{Rgb, Vec3};

/// Light that travels in one direction everywhere.
#[derive(Debug, Clone, Copy)]
pub struct DirectionalLight {
    /// Unit direction in which the light travels.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it [W/m²].
    pub irradiance: Rgb,
}

impl DirectionalLight {
    /// The one direction to the light.
    #[inline]
    pub fn sample(&self) -> LightSample {
        LightSample {
            target: None,
            direction: -self.direction,
            irradiance: self.irradiance,
            pdf: f64::INFINITY,
            area_density: 0.0,
        }
    }

    /// Irradiance with normal `n`, visibility aside.
    #[inline]
    pub fn importance(&self, n: Vec3) -> f64 {
        self.irradiance.luminance() * f64::from(-self.direction.dot(n)).max(0.0)
    }
}
