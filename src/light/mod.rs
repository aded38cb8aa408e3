//! Emitters: how to find light from a point, and how much power there is.

pub mod area;
pub mod point;

pub use area::{AreaLight, Emitter};
pub use point::PointLight;

use crate::math::{Rgb, Vec2, Vec3};

/// One way to reach a light from a point.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// Point on the light, to be tested for visibility.
    pub position: Vec3,
    /// Unit direction from the receiver to it.
    pub direction: Vec3,
    /// Radiance arriving over density per steradian [W/m²]; times the receiver's cosine it estimates irradiance. For a point light,
    /// which has no density, intensity over squared distance.
    pub irradiance: Rgb,
    /// Density of `direction` per steradian; infinite for a point light.
    pub pdf: f64,
}

/// The closed list of lights that can be sampled from a point.
#[derive(Debug, Clone)]
pub enum Light {
    /// A shape that emits.
    Area(AreaLight),
    /// A point.
    Point(PointLight),
}

impl Light {
    /// A sample of the light as seen from `point`; `None` where the light cannot reach, visibility aside.
    #[inline]
    pub fn sample(&self, point: Vec3, u: Vec2) -> Option<LightSample> {
        match self {
            Light::Area(light) => light.sample(point, u),
            Light::Point(light) => Some(light.sample(point)),
        }
    }

    /// Power [W] in all directions.
    pub fn power(&self) -> Rgb {
        match self {
            Light::Area(light) => light.power(),
            Light::Point(light) => light.power(),
        }
    }

    /// Rough unoccluded irradiance at `point` with normal `n`, for choosing among many lights. Never zero where the truth is not.
    #[inline]
    pub fn importance(&self, point: Vec3, n: Vec3) -> f64 {
        match self {
            Light::Area(light) => light.importance(point, n),
            Light::Point(light) => light.importance(point, n),
        }
    }
}
