//! What a scene can ever ask for, by bounds over its materials and lights: nothing here is sampled.

use super::{Scene, Shape};
use crate::light::{Environment, Light};
use crate::material::Surface;

impl Scene {
    /// The materials that some shape has.
    fn used_materials(&self) -> impl Iterator<Item = &Surface> {
        self.shapes.iter().map(|shape| self.material_of(shape))
    }

    /// The first shape with a part that is not diffuse, if any.
    pub fn first_specular(&self) -> Option<&Shape> {
        self.shapes.iter().find(|shape| !self.material_of(shape).material.is_only_diffuse())
    }

    /// The first shape whose material or emission may differ from place to place, if any.
    pub fn first_textured(&self) -> Option<&Shape> {
        self.shapes.iter().find(|shape| self.material_of(shape).may_read_uv() || !shape.emission.is_constant())
    }

    /// True if some surface has a diffuse part, black ones included: their irradiance is a layer of the picture.
    pub fn has_diffuse(&self) -> bool {
        self.used_materials().any(|surface| surface.material.has_diffuse())
    }

    /// True if there may be any light.
    pub fn may_emit(&self) -> bool {
        let shines = |light: &Light| !matches!(light, Light::Area(_)) && !light.is_dark();
        self.environment.is_some() || self.shapes.iter().any(Shape::emits) || self.lights.iter().any(shines)
    }

    /// True if some light may come from infinitely far away.
    pub fn has_distant_light(&self) -> bool {
        self.environment.is_some() || self.lights.iter().any(Light::is_distant)
    }

    /// True if red, green and blue are surely equal in all that is reflected and emitted.
    pub fn is_grey(&self) -> bool {
        let grey_light = |light: &Light| match light {
            // Known by their shapes.
            Light::Area(_) => true,
            Light::Directional(sun) => sun.irradiance.is_grey(),
            Light::Point(_) | Light::Spot(_) => light.power().is_grey(),
            Light::Environment(_) => false,
        };
        self.used_materials().all(|surface| surface.material.is_grey())
            && self.shapes.iter().all(|shape| shape.emission.is_grey())
            && self.lights.iter().all(grey_light)
            && self.environment.as_ref().is_none_or(|e| matches!(**e, Environment::Uniform(radiance) if radiance.is_grey()))
    }
}
