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

    /// Bound on the radiance that light of three edges or more adds to any pixel [W/(m² sr)]; `None` where there is none.
    ///
    /// Lamps and surroundings of radiance at most L and suns of irradiance E make H <= pi L + E at any surface, since from each direction
    /// comes the light of one lamp. What reflects at most rho of that has a radiance of at most rho (L + E/pi), and all further bounces
    /// together of at most rho / (1 - rho) times that. Points and spots have no bound: light grows with the inverse square of the distance.
    pub fn interreflection_bound(&self) -> Option<f64> {
        let mut radiance = self.shapes.iter().map(|shape| shape.emission.max().max()).fold(0.0, f64::max);
        match self.environment.as_deref() {
            None => {}
            Some(Environment::Uniform(all_over)) => radiance = radiance.max(all_over.max()),
            Some(Environment::Map(_)) => return None,
        }
        for light in &self.lights {
            match light {
                Light::Directional(sun) => radiance += sun.irradiance.max() / std::f64::consts::PI,
                Light::Area(_) | Light::Environment(_) => {}
                Light::Point(_) | Light::Spot(_) => return None,
            }
        }
        let rho =
            self.used_materials().map(|surface| surface.material.diffuse_bound()).try_fold(0.0, |a: f64, b| Some(a.max(b?)))?;
        let bound = rho * rho * radiance / (1.0 - rho);
        (rho < 1.0 && bound.is_finite()).then_some(bound)
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
