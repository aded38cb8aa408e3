//! Emitters: how to find light from a point, how likely a direction was to be found, and how much power there is.

pub mod area;
pub mod bounds;
pub mod cells;
pub mod directional;
pub mod environment;
pub mod point;
pub mod projected;
pub mod spot;
pub mod tree;

pub use area::{AreaLight, Emitter};
pub use directional::DirectionalLight;
pub use environment::Environment;
pub use point::PointLight;
pub use spot::SpotLight;
pub use tree::{LightTree, LightView};

use crate::math::{Rgb, Vec2, Vec3};
use std::sync::Arc;

/// One way to reach a light from a point.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// Point on the light, to be tested for visibility; `None`: the light lies infinitely far along `direction`.
    pub target: Option<Vec3>,
    /// Unit direction from the receiver to the light.
    pub direction: Vec3,
    /// Radiance arriving over density per steradian [W/m²]; times the receiver's cosine it estimates irradiance. For a light at one
    /// point, which has no density, intensity over squared distance; for a sun, its irradiance.
    pub irradiance: Rgb,
    /// Density of `direction` per steradian; infinite for a light without extent.
    pub pdf: f64,
}

/// Where a ray met the surface of a light.
#[derive(Debug, Clone, Copy)]
pub struct LightHit {
    /// The point.
    pub position: Vec3,
    /// Geometric unit normal of the side that emits.
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
    /// A point with a cone.
    Spot(SpotLight),
    /// A sun: parallel light from infinitely far away.
    Directional(DirectionalLight),
    /// What surrounds the scene.
    Environment(Arc<Environment>),
}

/// What a sample of a light is for.
#[derive(Debug, Clone, Copy)]
pub struct Receiver {
    /// Unit normal of the one side that receives; `None`: both do.
    pub normal: Option<Vec3>,
    /// True if other randomness than that of the sample decides the result, as after a bounce: lamps that are not close are then sampled
    /// in a cheaper way.
    pub in_passing: bool,
}

impl From<Option<Vec3>> for Receiver {
    fn from(normal: Option<Vec3>) -> Self {
        Self { normal, in_passing: false }
    }
}

impl Light {
    /// A sample of the light as seen from `point`; `None` where the light cannot reach, visibility aside.
    #[inline]
    pub fn sample(&self, point: Vec3, receiver: impl Into<Receiver>, u: Vec2) -> Option<LightSample> {
        match self {
            Light::Area(light) => light.sample(point, receiver, u),
            Light::Point(light) => light.sample(point),
            Light::Spot(light) => light.sample(point),
            Light::Directional(light) => Some(light.sample()),
            Light::Environment(environment) => {
                let (direction, radiance, pdf) = environment.sample(u);
                (pdf > 0.0).then(|| LightSample { target: None, direction, irradiance: radiance / pdf, pdf })
            }
        }
    }

    /// Density per steradian with which [`Light::sample`] from `point` for `receiver` finds `direction`, when a ray that way meets this
    /// light at `hit` (`None`: it leaves the scene); 0 if it cannot be found so, as for lights without extent.
    #[inline]
    pub fn pdf(&self, point: Vec3, receiver: impl Into<Receiver>, direction: Vec3, hit: Option<&LightHit>) -> f64 {
        match (self, hit) {
            (Light::Area(light), Some(hit)) => light.pdf(point, receiver, direction, hit),
            (Light::Environment(environment), None) => environment.pdf(direction),
            _ => 0.0,
        }
    }

    /// True if it is infinitely far away.
    #[inline]
    pub fn is_distant(&self) -> bool {
        matches!(self, Light::Directional(_) | Light::Environment(_))
    }

    /// Power [W] in all directions. Black for light from infinitely far away, of which a scene takes as much as it is large.
    pub fn power(&self) -> Rgb {
        match self {
            Light::Area(light) => light.power(),
            Light::Point(light) => light.power(),
            Light::Spot(light) => light.power(),
            Light::Directional(_) | Light::Environment(_) => Rgb::BLACK,
        }
    }

    /// Rough unoccluded irradiance at `point` with normal `n`, for choosing among many lights. Never zero where the truth is not.
    #[inline]
    pub fn importance(&self, point: Vec3, n: Vec3) -> f64 {
        match self {
            Light::Area(light) => light.importance(point, n),
            Light::Point(light) => light.importance(point, n),
            Light::Spot(light) => light.importance(point, n),
            Light::Directional(light) => light.importance(n),
            Light::Environment(environment) => environment.importance(n),
        }
    }

    /// Area of its surface [m²]; 0 for a light without one.
    #[inline]
    pub fn area(&self) -> f64 {
        match self {
            Light::Area(light) => light.area(),
            _ => 0.0,
        }
    }

    /// Index of the shape that emits, for an area light.
    #[inline]
    pub fn shape(&self) -> Option<u32> {
        match self {
            Light::Area(light) => Some(light.shape),
            _ => None,
        }
    }

    /// True if it emits nothing at all.
    pub fn is_dark(&self) -> bool {
        match self {
            Light::Directional(light) => light.irradiance.is_black(),
            Light::Environment(environment) => environment.mean().is_black(),
            _ => self.power().is_black(),
        }
    }
}
