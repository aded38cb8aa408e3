//! What pass two reads of pass one. The only place where radiosity becomes radiance: L = B / pi.

use crate::math::Rgb;
use crate::patch::PatchMesh;
use crate::world::SurfaceInteraction;
use crate::world::flat::FlatHit;
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
    /// Irradiance by lamps and by other emitters again, weighted by what the diffuse part makes of each direction over its mean: what a
    /// patch reflects is its mean reflectance times these and the indirect part [W/m²].
    accepted: Vec<[Rgb; 2]>,
    /// What is seen of the irradiance by lamps from afar beyond its mean, as the diffuse part accepts it; empty if that is not known [W/m²].
    shown: Vec<Rgb>,
    /// Their sum with the indirect part, and the area of the patch: what is read at every hit lies together.
    whole: Vec<(Rgb, f64)>,
}

/// Light that falls on a patch.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub struct Incident {
    /// Irradiance [W/m²].
    pub irradiance: Rgb,
    /// The same weighted by what the diffuse part makes of each direction, over its mean [W/m²].
    pub accepted: Rgb,
}

/// What the field holds at a surface point.
#[derive(Debug, Clone, Copy)]
pub struct Stored {
    /// Whole irradiance of its patch, as its diffuse part accepts it [W/m²].
    pub irradiance: Rgb,
    /// True if the point, a distance `si.t` from where the ray started, is nearer than its patch is wide: seen from there the patch
    /// fills so much of the hemisphere that its mean irradiance will not do for it.
    pub is_near: bool,
}

impl RadiosityField {
    /// Puts the parts together; all by patch.
    pub fn new(patches: PatchMesh, shadow: Vec<Incident>, gathered: Vec<Incident>, indirect_irradiance: Vec<Rgb>) -> Self {
        let accepted: Vec<[Rgb; 2]> = shadow.iter().zip(&gathered).map(|(s, g)| [s.accepted, g.accepted]).collect();
        let parts = accepted.iter().zip(&indirect_irradiance);
        let whole = parts.zip(&patches.area).map(|(([s, g], i), area)| (*s + *g + *i, *area)).collect();
        let irradiance = |of: Vec<Incident>| of.into_iter().map(|i| i.irradiance).collect();
        let (shadow_irradiance, gathered_irradiance) = (irradiance(shadow), irradiance(gathered));
        Self { patches, shadow_irradiance, gathered_irradiance, indirect_irradiance, accepted, shown: Vec::new(), whole }
    }

    /// From now on reads of a patch are of what is seen of it from afar: `beyond_mean` more than the mean.
    pub fn show(&mut self, beyond_mean: Vec<Rgb>) {
        self.whole.iter_mut().zip(&beyond_mean).for_each(|((whole, _), more)| *whole = (*whole + *more).map(|h| h.max(0.0)));
        self.shown = beyond_mean;
    }

    /// What is seen of patch `i` from afar beyond the mean of its irradiance [W/m²].
    pub fn shown_beyond_mean(&self, i: usize) -> Rgb {
        self.shown.get(i).copied().unwrap_or(Rgb::BLACK)
    }

    /// Irradiance [W/m²] at a surface point; zero where there is no patch.
    #[inline]
    pub fn irradiance(&self, si: &SurfaceInteraction) -> Rgb {
        self.patches.patch_at(si).map_or(Rgb::BLACK, |id| self.irradiance_of(id.0 as usize))
    }

    /// Irradiance [W/m²] at a surface point, as its diffuse part accepts it and as it is; zero where there is no patch.
    #[inline]
    pub fn accepted_and_whole(&self, si: &SurfaceInteraction) -> [Rgb; 2] {
        let found = self.patches.patch_at(si).map(|id| id.0 as usize);
        found.map_or([Rgb::BLACK; 2], |i| [self.accepted_of(i), self.irradiance_of(i)])
    }

    /// Irradiance [W/m²] of patch `i`.
    #[inline]
    pub fn irradiance_of(&self, i: usize) -> Rgb {
        self.shadow_irradiance[i] + self.gathered_irradiance[i] + self.indirect_irradiance[i]
    }

    /// Irradiance [W/m²] at a surface point by everything but the lamps that shadow rays find, as its diffuse part accepts it.
    #[inline]
    pub fn rest_irradiance(&self, si: &SurfaceInteraction) -> Rgb {
        self.patches.patch_at(si).map_or(Rgb::BLACK, |id| self.rest_of(id.0 as usize))
    }

    /// The same of patch `i`.
    #[inline]
    pub fn rest_of(&self, i: usize) -> Rgb {
        self.accepted[i][1] + self.indirect_irradiance[i]
    }

    /// What is stored for a surface point; zero where there is no patch.
    #[inline]
    pub fn at(&self, si: &SurfaceInteraction) -> Stored {
        self.patches
            .patch_at(si)
            .map_or(Stored { irradiance: Rgb::BLACK, is_near: false }, |id| self.of_patch(id.0 as usize, si.t))
    }

    /// The patch where a ray met a flat wall, by the layout that [`PatchMesh::lay_out`] made.
    #[inline(always)]
    pub fn patch_on_flat(&self, hit: &FlatHit) -> Option<usize> {
        self.patches.patch_on_flat(hit.primitive, hit.place, hit.front).map(|id| id.0 as usize)
    }

    /// What is stored for patch `i` and seen from a distance of `t`.
    #[inline]
    pub fn of_patch(&self, i: usize, t: f32) -> Stored {
        let (irradiance, area) = self.whole[i];
        Stored { irradiance, is_near: f64::from(t) * f64::from(t) < area }
    }

    /// Irradiance of patch `i` as its diffuse part accepts it [W/m²].
    #[inline]
    pub fn accepted_of(&self, i: usize) -> Rgb {
        self.whole[i].0
    }

    /// Radiance [W/(m² sr)] that a diffuse surface of reflectance `rho` reflects under irradiance `h`: (B - E)/pi = rho H/pi.
    #[inline]
    pub fn reflected_radiance(rho: Rgb, h: Rgb) -> Rgb {
        rho * h * FRAC_1_PI
    }

    /// Radiosity B [W/m²] of patch `i`: emitted and reflected.
    pub fn radiosity(&self, i: usize) -> Rgb {
        self.patches.exitance[i] + self.patches.rho[i] * self.whole[i].0
    }
}
