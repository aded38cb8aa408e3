//! Where light begins: particles that leave the emitters, with the densities that make them comparable with other ways to find the
//! same light.

use super::sight::Origin;
use super::{ShadowRay, SurfaceInteraction, World};
use crate::geometry::{Ray, offset_origin};
use crate::light::{Light, LightHit};
use crate::math::{Frame, Rgb, Sampler, Vec3, warp};
use std::f64::consts::{FRAC_1_PI, PI};

/// Light from infinitely far away starts this far outside the ball around the scene, in its radii: none of it may start inside.
const MARGIN: f32 = 1.001;

/// A particle that leaves an emitter.
#[derive(Debug, Clone, Copy)]
pub struct Departure {
    /// Its ray.
    pub ray: Ray,
    /// Power that it carries [W]: what leaves along the ray over the density of the ray.
    pub power: Rgb,
    /// Density of the ray: per area of the lamp and per steradian over the lamp's cosine; of light from infinitely far away, per
    /// steradian and per area across it. A sun has no density per steradian, a point none per area: these factors are left out.
    pub density: f64,
    /// Index of the light; `None`: even surroundings, which are no light of the list.
    pub light: Option<usize>,
    /// Where on the surface of the light; `None` if it has none.
    hit: Option<LightHit>,
    /// True if no ray can meet the light: a point or a sun.
    pub is_delta: bool,
}

/// Which emitter a particle leaves, by power.
pub struct Departures {
    /// Running share of power, one for each light, the even surroundings last.
    running: Vec<f64>,
    /// Number of `Scene::lights`.
    lights: usize,
    /// Index of the light of each shape.
    light_of_shape: Vec<Option<u32>>,
    center: Vec3,
    radius: f32,
}

impl Departures {
    /// Weighs the emitters of a scene; `None` if nothing emits.
    pub fn new(world: &World) -> Option<Self> {
        let scene = world.scene();
        let bounds = world.bounds();
        let (center, radius) = if bounds.is_empty() { (Vec3::ZERO, 1.0) } else { (bounds.center(), 0.5 * bounds.diagonal()) };
        let disk = PI * f64::from(radius * MARGIN).powi(2);
        let mut light_of_shape = vec![None; scene.shapes.len()];
        let mut total = 0.0;
        let mut running = Vec::with_capacity(scene.lights.len() + 1);
        for (i, light) in scene.lights.iter().enumerate() {
            if let Some(shape) = light.shape() {
                light_of_shape[shape as usize] = Some(i as u32);
            }
            total += match light {
                Light::Directional(sun) => sun.irradiance.luminance() * disk,
                Light::Environment(environment) => environment.mean().luminance() * 4.0 * PI * disk,
                other => other.power().luminance(),
            };
            running.push(total);
        }
        if let Some(environment) = scene.environment.as_ref().filter(|e| e.is_uniform()) {
            total += environment.mean().luminance() * 4.0 * PI * disk;
        }
        running.push(total);
        running.iter_mut().for_each(|r| *r /= total);
        (total > 0.0).then_some(Self { running, lights: scene.lights.len(), light_of_shape, center, radius })
    }

    /// Probability of light `index`; of the even surroundings for the number of lights.
    #[inline]
    fn share(&self, index: usize) -> f64 {
        self.running[index] - if index == 0 { 0.0 } else { self.running[index - 1] }
    }

    /// Density per area across the light, of particles from infinitely far away [1/m²].
    #[inline]
    fn across(&self) -> f64 {
        FRAC_1_PI / f64::from(self.radius * MARGIN).powi(2)
    }

    /// A particle.
    pub fn sample(&self, world: &World, sampler: &mut Sampler) -> Option<Departure> {
        let u = f64::from(sampler.next_1d());
        let (first, second) = (sampler.next_2d(), sampler.next_2d());
        let index = self.running.partition_point(|&r| r <= u).min(self.lights);
        let share = self.share(index);
        if share <= 0.0 {
            return None;
        }
        // From infinitely far away, along `direction`.
        let from_afar = |direction: Vec3| {
            let disk = warp::disk(first) * (self.radius * MARGIN);
            let frame = Frame::new(direction);
            let middle = self.center - direction * (2.0 * self.radius * MARGIN);
            Ray::new(middle + frame.s * disk.x + frame.t * disk.y, direction)
        };
        let scene = world.scene();
        let (ray, power, density, hit) = match scene.lights.get(index) {
            Some(Light::Area(lamp)) => {
                let start = lamp.departure(first)?;
                let normal = start.normal.as_vec3();
                let direction = Frame::new(normal).to_world(warp::cosine_hemisphere(second));
                let origin = offset_origin(start.position, start.error, normal, direction);
                let hit = LightHit { position: start.position, normal, primitive: start.primitive, uv: start.uv };
                let power = start.radiance * (PI / start.density);
                (Ray::new(origin, direction), power, start.density * FRAC_1_PI, Some(hit))
            }
            Some(Light::Point(point)) => (Ray::new(point.position, warp::sphere(first)), point.power(), 0.25 * FRAC_1_PI, None),
            Some(Light::Spot(spot)) => {
                let (direction, pdf) = spot.departure(first);
                let intensity = spot.intensity * spot.falloff(direction.as_dvec3());
                (Ray::new(spot.position, direction), intensity / pdf, pdf, None)
            }
            Some(Light::Directional(sun)) => (from_afar(sun.direction), sun.irradiance / self.across(), self.across(), None),
            Some(Light::Environment(environment)) => {
                let (toward, radiance, pdf) = environment.sample(second);
                let density = pdf * self.across();
                (from_afar(-toward), radiance / density, density, None)
            }
            None => {
                let environment = scene.environment.as_ref()?;
                let (toward, radiance, pdf) = environment.sample(second);
                let density = pdf * self.across();
                (from_afar(-toward), radiance / density, density, None)
            }
        };
        let light = (index < self.lights).then_some(index);
        let is_delta = light.is_some_and(|i| is_delta(&scene.lights[i]));
        (density > 0.0 && power.is_finite()).then(|| Departure {
            ray,
            power: power / share,
            density: density * share,
            light,
            hit,
            is_delta,
        })
    }

    /// As [`Departure::density`], of a particle that would leave the emitter which a ray met at `si`.
    pub fn density_on(&self, world: &World, si: &SurfaceInteraction) -> f64 {
        let Some(light) = self.light_of_shape[si.shape as usize] else { return 0.0 };
        let Light::Area(lamp) = &world.scene().lights[light as usize] else { return 0.0 };
        let primitive = si.primitive - world.first_primitive(si.shape as usize);
        let hit = LightHit { position: si.point, normal: si.ng, primitive, uv: si.uv };
        lamp.departure_density(&hit) * FRAC_1_PI * self.share(light as usize)
    }

    /// As [`Departure::density`], of a particle that would come from outside against the unit vector `direction`.
    pub fn density_from_outside(&self, world: &World, direction: Vec3) -> f64 {
        let Some(environment) = &world.scene().environment else { return 0.0 };
        let is_this = |light: &Light| matches!(light, Light::Environment(_));
        let index = world.scene().lights.iter().position(is_this).unwrap_or(self.lights);
        environment.pdf(direction) * self.across() * self.share(index)
    }

    /// As [`Departure::density`], of a particle that would come the way of a shadow ray.
    pub fn density_against(&self, world: &World, ray: &ShadowRay) -> f64 {
        let density = match &world.scene().lights[ray.light] {
            Light::Area(_) => ray.area_density * FRAC_1_PI,
            Light::Point(_) => 0.25 * FRAC_1_PI,
            Light::Spot(spot) => spot.departure(crate::math::Vec2::ZERO).1,
            Light::Directional(_) => self.across(),
            Light::Environment(environment) => environment.pdf(ray.direction) * self.across(),
        };
        density * self.share(ray.light)
    }
}

impl Departure {
    /// What shadow rays from `origin`, where the particle arrived, would find its light with: expected number per steradian; for a point
    /// light times the squared distance, for a sun as it is. 0 if none looks for it.
    pub fn shadow_density(&self, world: &World, origin: &Origin) -> f64 {
        let Some(light) = self.light else { return 0.0 };
        let direction = -self.ray.direction;
        match &world.scene().lights[light] {
            Light::Area(lamp) if world.partition().found_by_shadow_rays(lamp.shape as usize) => {
                world.light_density(origin, light, direction, self.hit.as_ref())
            }
            Light::Area(_) => 0.0,
            Light::Point(_) | Light::Spot(_) => {
                let d2 = f64::from(self.ray.origin.distance_squared(origin.point));
                world.expected_picks(origin, light) * d2
            }
            Light::Directional(_) => 1.0,
            Light::Environment(_) => world.light_density(origin, light, direction, None),
        }
    }
}

impl ShadowRay {
    /// Its density in the sense of [`Departure::shadow_density`].
    pub fn comparable_density(&self) -> f64 {
        if self.density.is_finite() {
            self.density
        } else if self.distance_squared.is_finite() {
            self.picked * self.distance_squared
        } else {
            self.picked
        }
    }
}

/// True for a light that no ray can meet.
fn is_delta(light: &Light) -> bool {
    matches!(light, Light::Point(_) | Light::Spot(_) | Light::Directional(_))
}
