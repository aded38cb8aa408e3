//! What pass two reads of pass one. The only place where radiosity becomes radiance: L = B / pi.

use crate::math::Rgb;
use crate::patch::PatchMesh;
use crate::world::SurfaceInteraction;
use std::f64::consts::FRAC_1_PI;

/// The solution over the patches, its parts kept apart.
pub struct RadiosityField {
    /// The patches.
    pub patches: PatchMesh,
    /// Irradiance of each patch by lamps that shadow rays find [W/m²].
    pub shadow_irradiance: Vec<Rgb>,
    /// Irradiance of each patch by emitters that gather rays find, the surroundings and light through specular surfaces included.
    pub gathered_irradiance: Vec<Rgb>,
    /// Irradiance of each patch by light that other patches have reflected.
    pub indirect_irradiance: Vec<Rgb>,
}

impl RadiosityField {
    /// Irradiance [W/m²] at a surface point by everything but the lamps that shadow rays find.
    #[inline]
    pub fn rest_irradiance(&self, si: &SurfaceInteraction) -> Rgb {
        self.patches.patch_at(si).map_or(Rgb::BLACK, |id| {
            let i = id.0 as usize;
            self.gathered_irradiance[i] + self.indirect_irradiance[i]
        })
    }

    /// Whole irradiance [W/m²] at a surface point.
    #[inline]
    pub fn irradiance(&self, si: &SurfaceInteraction) -> Rgb {
        self.patches.patch_at(si).map_or(Rgb::BLACK, |id| {
            let i = id.0 as usize;
            self.shadow_irradiance[i] + self.gathered_irradiance[i] + self.indirect_irradiance[i]
        })
    }

    /// True if the surface point, a distance `si.t` from where the ray started, is nearer than its patch is wide: seen from there the
    /// patch fills so much of the hemisphere that its mean irradiance will not do for it.
    #[inline]
    pub fn is_near(&self, si: &SurfaceInteraction) -> bool {
        self.patches.patch_at(si).is_some_and(|id| f64::from(si.t) * f64::from(si.t) < self.patches.area[id.0 as usize])
    }

    /// Radiance [W/(m² sr)] that a diffuse surface of reflectance `rho` reflects under irradiance `h`: (B - E)/pi = rho H/pi.
    #[inline]
    pub fn reflected_radiance(rho: Rgb, h: Rgb) -> Rgb {
        rho * h * FRAC_1_PI
    }

    /// Radiosity B [W/m²] of patch `i`: emitted and reflected.
    pub fn radiosity(&self, i: usize) -> Rgb {
        let h = self.shadow_irradiance[i] + self.gathered_irradiance[i] + self.indirect_irradiance[i];
        self.patches.exitance[i] + self.patches.rho[i] * h
    }
}
