//! Light that two kinds of rays can find is shared between them: multiple importance sampling [Veach95].
//!
//! A shadow ray goes to a point of a light; a gather ray or a glossy one goes where the surface scatters and may meet the same
//! light. Each counts by its share of the summed densities (the balance heuristic, over expected numbers of rays), so that the
//! two together count all light once.

use super::illumination::DirectSampling;
use super::{SurfaceInteraction, World};
use crate::light::LightHit;
use crate::math::Vec3;
use std::f64::consts::FRAC_1_PI;

/// What shadow rays have been sent from where a ray starts, which decides how much of the emission it meets is its to count.
#[derive(Debug, Clone, Copy)]
pub enum Sight {
    /// None that could find the same: a ray from the camera, or by an ideal mirror or glass.
    Alone,
    /// A cosine-distributed ray of a diffuse surface. Lamps are left to its shadow rays; the surroundings are shared.
    Gather(Origin),
    /// A ray of a glossy lobe: lamps and surroundings are shared.
    Glossy(Origin),
    /// A ray drawn from a whole material: lamps and surroundings are shared by [`power_share`].
    Scattered(Origin),
}

/// Where a ray of a surface starts.
#[derive(Debug, Clone, Copy)]
pub struct Origin {
    /// The point.
    pub point: Vec3,
    /// Normal of the side that receives; `None`: both.
    pub receiver: Option<Vec3>,
    /// Expected number of rays per steradian in the direction taken.
    pub density: f64,
    /// The shadow rays sent from there.
    pub sampling: DirectSampling,
}

/// Expected number of rays per steradian when `rays` are cosine distributed about a normal at cosine `cos`.
#[inline]
pub fn cosine_density(rays: f64, cos: f32) -> f64 {
    rays * f64::from(cos.max(0.0)) * FRAC_1_PI
}

/// Share of a kind of rays of density `own` beside another of density `other`.
#[inline]
pub fn balance(own: f64, other: f64) -> f64 {
    if own.is_infinite() {
        1.0
    } else if own > 0.0 {
        own / (own + other)
    } else {
        0.0
    }
}

/// Share of a kind of rays of density `own` beside another of density `other` by the power heuristic with exponent 2 ([Veach95],
/// section 4.3): it leaves more to the denser of the two than [`balance`] does.
#[inline]
pub fn power_share(own: f64, other: f64) -> f64 {
    if own.is_infinite() { 1.0 } else { balance(own * own, other * other) }
}

impl World {
    /// Share of the emission at `at` that a ray along `direction` counts.
    #[inline]
    pub fn emission_share(&self, sight: &Sight, direction: Vec3, at: &SurfaceInteraction) -> f64 {
        let Some(light) = self.partition.shadow_light_of(at.shape as usize) else { return 1.0 };
        match sight {
            Sight::Alone => 1.0,
            Sight::Gather(_) => 0.0,
            Sight::Glossy(origin) => balance(origin.density, self.density_at(origin, light, direction, at)),
            Sight::Scattered(origin) => power_share(origin.density, self.density_at(origin, light, direction, at)),
        }
    }

    /// Share of what arrives from the surroundings that a ray along `direction` counts.
    #[inline]
    pub fn escape_share(&self, sight: &Sight, direction: Vec3) -> f64 {
        let Some(light) = self.partition.environment() else { return 1.0 };
        match sight {
            Sight::Alone => 1.0,
            Sight::Gather(origin) | Sight::Glossy(origin) => {
                balance(origin.density, self.light_density(origin, light, direction, None))
            }
            Sight::Scattered(origin) => power_share(origin.density, self.light_density(origin, light, direction, None)),
        }
    }

    /// Expected number of shadow rays per steradian from `origin` that find the emission which a ray along `direction` meets at `at`, or
    /// outside the scene; 0 if none looks for it.
    #[inline]
    pub fn shadow_density(&self, origin: &Origin, direction: Vec3, at: Option<&SurfaceInteraction>) -> f64 {
        match at {
            Some(at) => self
                .partition
                .shadow_light_of(at.shape as usize)
                .map_or(0.0, |light| self.density_at(origin, light, direction, at)),
            None => self.partition.environment().map_or(0.0, |light| self.light_density(origin, light, direction, None)),
        }
    }

    /// Expected number of shadow rays per steradian from `origin` to `light`, which a ray along `direction` meets at `at`.
    #[inline]
    fn density_at(&self, origin: &Origin, light: usize, direction: Vec3, at: &SurfaceInteraction) -> f64 {
        let primitive = at.primitive - self.first_primitive[at.shape as usize];
        let hit = LightHit { position: at.point, normal: at.ng, primitive, uv: at.uv };
        self.light_density(origin, light, direction, Some(&hit))
    }
}
