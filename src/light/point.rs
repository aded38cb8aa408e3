//! Isotropic point light.

use super::LightSample;
use crate::math::{Rgb, Vec3};
use std::f64::consts::PI;

/// A point that radiates the same intensity in every direction.
#[derive(Debug, Clone, Copy)]
pub struct PointLight {
    /// Where it is.
    pub position: Vec3,
    /// Radiant intensity [W/sr].
    pub intensity: Rgb,
}

impl PointLight {
    /// The one direction to the light; `None` at the light itself.
    #[inline]
    pub fn sample(&self, point: Vec3) -> Option<LightSample> {
        let to_light = (self.position - point).as_dvec3();
        let d2 = to_light.length_squared();
        (d2 > 0.0).then(|| LightSample {
            target: Some(self.position),
            direction: (to_light / d2.sqrt()).as_vec3(),
            irradiance: self.intensity / d2,
            pdf: f64::INFINITY,
            area_density: 0.0,
        })
    }

    /// Power [W]: 4 pi I.
    pub fn power(&self) -> Rgb {
        self.intensity * (4.0 * PI)
    }

    /// Irradiance at `point` with normal `n`, visibility aside.
    #[inline]
    pub fn importance(&self, point: Vec3, n: Vec3) -> f64 {
        let to_light = (self.position - point).as_dvec3();
        let d2 = to_light.length_squared();
        if d2 == 0.0 { 0.0 } else { self.intensity.luminance() * (to_light.dot(n.as_dvec3()) / d2.sqrt()).max(0.0) / d2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn irradiance_follows_the_cosine_and_inverse_square_laws() {
        let light = PointLight { position: Vec3::new(0.0, 0.0, 1.0), intensity: Rgb::WHITE };
        for (degrees, want) in [(0.0_f64, 1.0), (30.0, 0.649_519_053), (60.0, 0.125), (85.0, 0.000_662_046)] {
            let p = Vec3::new(degrees.to_radians().tan() as f32, 0.0, 0.0);
            let s = light.sample(p).expect("apart");
            let e = s.irradiance.r * f64::from(s.direction.z);
            assert!((e / want - 1.0).abs() < 1e-5, "{degrees} degrees: {e}, expected {want}");
        }
    }
}
