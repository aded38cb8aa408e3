//! Emitters: how to find light from a point, and how much power there is.

pub mod area;
pub mod environment;
pub mod point;

pub use area::{AreaLight, Emitter};
pub use environment::Environment;
pub use point::PointLight;

use crate::math::{Rgb, Vec2, Vec3};

/// One way to reach a light from a point.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// Point on the light, to be tested for visibility; `None`: infinitely far along `direction`.
    pub target: Option<Vec3>,
    /// Unit direction from the receiver to it.
    pub direction: Vec3,
    /// Radiance arriving over density per steradian [W/m²]; times the receiver's cosine it estimates irradiance. For a point light,
    /// which has no density, intensity over squared distance.
    pub irradiance: Rgb,
    /// Density of `direction` per steradian; infinite for a point light.
    pub pdf: f64,
}

/// Where a ray meets a light.
#[derive(Debug, Clone, Copy)]
pub struct LightHit {
    /// The point.
    pub position: Vec3,
    /// Geometric unit normal of the emitting side.
    pub normal: Vec3,
    /// Index of the primitive within its shape.
    pub primitive: u32,
    /// Texture coordinates.
    pub uv: Vec2,
}

/// The closed list of lights that can be sampled from a point.
#[derive(Debug, Clone)]
pub enum Light {
    /// A shape that emits.
    Area(AreaLight),
    /// A point.
    Point(PointLight),
    /// What surrounds the scene.
    Environment(std::sync::Arc<Environment>),
}

impl Light {
    /// A sample of the light as seen from `point`; `None` where the light cannot reach, visibility aside.
    #[inline]
    pub fn sample(&self, point: Vec3, u: Vec2) -> Option<LightSample> {
        match self {
            Light::Area(light) => light.sample(point, u),
            Light::Point(light) => Some(light.sample(point)),
            Light::Environment(_) => None,
        }
    }

    /// Density with which [`Self::sample`] from `point` finds `direction`, when a ray that way meets this light at `hit`.
    #[inline]
    pub fn pdf(&self, point: Vec3, direction: Vec3, hit: Option<&LightHit>) -> f64 {
        match (self, hit) {
            (Light::Area(light), Some(hit)) => light.pdf(point, direction, hit),
            _ => 0.0,
        }
    }

    /// Area [m²]; 0 for lights without a surface.
    pub fn area(&self) -> f64 {
        match self {
            Light::Area(light) => light.emitter.area(),
            Light::Point(_) | Light::Environment(_) => 0.0,
        }
    }

    /// True if it is infinitely far away.
    pub fn is_distant(&self) -> bool {
        matches!(self, Light::Environment(_))
    }

    /// The shape that emits.
    pub fn shape(&self) -> Option<u32> {
        match self {
            Light::Area(light) => Some(light.shape),
            Light::Point(_) | Light::Environment(_) => None,
        }
    }

    /// Power [W] in all directions.
    pub fn power(&self) -> Rgb {
        match self {
            Light::Area(light) => light.power(),
            Light::Point(light) => light.power(),
            Light::Environment(_) => Rgb::BLACK,
        }
    }

    /// Rough unoccluded irradiance at `point` with normal `n`, for choosing among many lights. Never zero where the truth is not.
    #[inline]
    pub fn importance(&self, point: Vec3, n: Vec3) -> f64 {
        match self {
            Light::Area(light) => light.importance(point, n),
            Light::Point(light) => light.importance(point, n),
            Light::Environment(_) => 0.0,
        }
    }
}
