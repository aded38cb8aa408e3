//! Pass one: patches, their direct light, form factors, solution. View-independent.

use super::{PipelineError, cost::StageCosts};
use crate::form_factor::FormFactorMatrix;
use crate::form_factor::ray_cast::{self, RayCastSettings};
use crate::material::Scattering;
use crate::math::{Rgb, Sampler, sampler::mix};
use crate::patch::{PatchId, PatchMesh, PatchSettings};
use crate::progress::{Observer, Progress, Stage};
use crate::radiosity::{Incident, RadiosityField, RadiositySystem, Solution, SolverSettings, gauss_seidel};
use crate::world::walk::RayCounts;
use crate::world::{DirectSampling, ShadowRay, World};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Points at which the direct light of a patch of the full size is measured; smaller ones get fewer by their area, but a quarter at least.
const DIRECT_POINTS: f64 = 32.0;

/// How pass one is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassOneSettings {
    /// The patches.
    pub patches: PatchSettings,
    /// Standard error allowed to any form factor.
    pub form_factor_tolerance: f64,
    /// The solver.
    pub solver: SolverSettings,
    /// Form factors by way of mirrors, glass and gloss as well (extended ones, [Sillion89]).
    pub extended: bool,
}

impl Default for PassOneSettings {
    /// Form factors within 0.022: 512 rays a patch.
    fn default() -> Self {
        Self {
            patches: PatchSettings::default(),
            form_factor_tolerance: 0.0221,
            solver: SolverSettings::default(),
            extended: true,
        }
    }
}

/// The solution with what it rests on.
pub struct PassOne {
    /// What pass two reads.
    pub field: RadiosityField,
    /// Form factors.
    pub form_factors: FormFactorMatrix,
    /// How the system was solved.
    pub solution: Solution,
    /// Where the light went.
    pub power: PowerBalance,
}

/// Power of all light over the three channels [W]. What mirrors and glass absorb is the rest.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct PowerBalance {
    /// Emitted by area and point lights.
    pub emitted: f64,
    /// Absorbed by patches: sum of A (1 - rho) H.
    pub absorbed: f64,
    /// Left the scene after reflection by a patch or emission by a glowing surface.
    pub escaped: f64,
    /// Not followed further because of the limit of specular events.
    pub truncated: f64,
    /// (emitted - absorbed - escaped - truncated) / emitted: mirrors, glass, black backs and the estimation error. 0 where a sun or the
    /// surroundings give light, whose power is not known.
    pub unaccounted: f64,
}

/// Solves pass one.
///
/// # Errors
/// If the patches are too many, no solution exists, or the observer stopped it.
pub fn solve(
    world: &World,
    settings: &PassOneSettings,
    seed: u64,
    watch: &mut StageCosts,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Result<PassOne, PipelineError> {
    let patches = watch.time(Stage::Patches, || PatchMesh::build(world, &settings.patches))?;
    stop_if_asked(observer, Stage::Patches)?;
    let mut ray_cast = RayCastSettings::for_tolerance(settings.form_factor_tolerance, DIRECT_POINTS, mix(seed ^ 0x00f0_0f0f));
    if !settings.extended {
        ray_cast.max_events = 0;
    }
    let shadow =
        watch.time(Stage::PatchDirect, || direct_irradiance(world, &patches, ray_cast.rays_beside_shadow_rays, seed, counts));
    stop_if_asked(observer, Stage::PatchDirect)?;
    let form_factors = watch
        .time(Stage::FormFactors, || ray_cast::cast(world, &patches, &ray_cast, counts, observer))
        .ok_or(PipelineError::Stopped)?;
    let gathered = gathered_irradiance(world, &patches, &form_factors);
    let source: Vec<Rgb> = shadow.iter().zip(&gathered).map(|(a, b)| a.accepted + b.accepted).collect();
    let system = RadiositySystem { rho: &patches.rho, area: &patches.area, form_factors: &form_factors, source };
    let solution = watch.time(Stage::Solve, || gauss_seidel::solve(&system, &settings.solver, observer))?;
    let indirect = solution.irradiance.iter().zip(&system.source).map(|(h, s)| (*h - *s).map(|v| v.max(0.0))).collect();
    let field = RadiosityField::new(patches, shadow, gathered, indirect);
    let power = balance(world, &field, &form_factors);
    Ok(PassOne { field, form_factors, solution, power })
}

fn stop_if_asked(observer: &mut Observer<'_>, stage: Stage) -> Result<(), PipelineError> {
    if observer(&Progress { stage, done: 1.0, total: 1.0 }).is_break() { Err(PipelineError::Stopped) } else { Ok(()) }
}

/// Mean irradiance of each patch by the lamps that shadow rays find.
fn direct_irradiance(world: &World, patches: &PatchMesh, gather_rays: f64, seed: u64, counts: &mut RayCounts) -> Vec<Incident> {
    if world.partition().has_no_shadow_rays() {
        return vec![Incident::default(); patches.len()];
    }
    let measured: Vec<(Incident, RayCounts)> = (0..patches.len() as u32)
        .into_par_iter()
        .map(|i| {
            let mut counts = RayCounts::default();
            let share = (patches.area[i as usize] / (patches.patch_size * patches.patch_size)).clamp(0.25, 1.0);
            let points = (DIRECT_POINTS * share) as u64;
            let mut sum = Incident::default();
            for k in 0..points {
                let mut sampler = Sampler::new(mix(seed ^ 0x00d1_7ec7), u64::from(i), k);
                let mut at = patches.sample(world, PatchId(i), sampler.next_2d());
                // Radiosity belongs to the faces themselves, not to the smoothed normals.
                at.ns = at.ng;
                let shading = world.shading(&at);
                // The two parts of what is carried: as it arrives, and as it is accepted.
                let respond = |ray: &ShadowRay| {
                    let cos = ray.direction.dot(at.ng);
                    if cos <= 0.0 {
                        return Scattering::default();
                    }
                    let arriving = Rgb::grey(f64::from(cos) * ray.share_beside_gather_rays(gather_rays, cos));
                    Scattering { diffuse: arriving, glossy: arriving * shading.acceptance(ray.direction) }
                };
                let sampling = DirectSampling::default();
                let found = world.direct(&at, Some(at.ng), sampling, &mut sampler, &mut counts, respond);
                sum.irradiance += found.diffuse;
                sum.accepted += found.glossy;
            }
            let mean = |v: Rgb| v / points as f64;
            (Incident { irradiance: mean(sum.irradiance), accepted: mean(sum.accepted) }, counts)
        })
        .collect();
    measured.iter().for_each(|(_, c)| *counts += *c);
    measured.into_iter().map(|(h, _)| h).collect()
}

/// Irradiance of each patch by light that only form factors find: glowing walls, the surroundings, and any emitter seen through
/// mirrors or glass.
fn gathered_irradiance(world: &World, patches: &PatchMesh, form_factors: &FormFactorMatrix) -> Vec<Incident> {
    let by_shadow_rays = patches.found_by_shadow_rays(world);
    (0..patches.len())
        .map(|i| {
            let walls: Rgb =
                form_factors.direct(i).filter(|(j, _)| !by_shadow_rays[*j]).map(|(j, f)| patches.exitance[j] * f).sum();
            Incident { irradiance: walls + form_factors.arriving(i) * PI, accepted: walls + form_factors.accepted(i) * PI }
        })
        .collect()
}

fn balance(world: &World, field: &RadiosityField, form_factors: &FormFactorMatrix) -> PowerBalance {
    let patches = &field.patches;
    let total = |v: Rgb| v.r + v.g + v.b;
    let emitted = total(world.scene().power());
    let (mut absorbed, mut escaped, mut truncated) = (0.0, 0.0, 0.0);
    for i in 0..patches.len() {
        let a = patches.area[i];
        let leaves = field.radiosity(i);
        absorbed += a * total(field.irradiance_of(i) + patches.exitance[i] - leaves);
        escaped += a * total(form_factors.escaped(i) * leaves);
        truncated += a * total(form_factors.truncated(i) * leaves);
    }
    // Of light from infinitely far away a scene takes what it takes: nothing is known to compare with.
    let is_known = world.scene().environment.is_none() && world.scene().lights.iter().all(|light| !light.is_distant());
    let unaccounted = if emitted > 0.0 && is_known { (emitted - absorbed - escaped - truncated) / emitted } else { 0.0 };
    PowerBalance { emitted, absorbed, escaped, truncated, unaccounted }
}
