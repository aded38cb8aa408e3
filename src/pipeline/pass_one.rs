//! Pass one: patches, their direct light, form factors, solution. View-independent.

use super::{PipelineError, cost::StageCosts};
use crate::form_factor::FormFactorMatrix;
use crate::form_factor::ray_cast::{self, RayCastSettings};
use crate::math::{Rgb, Sampler, sampler::mix};
use crate::patch::{PatchId, PatchMesh, PatchSettings};
use crate::progress::{Observer, Progress, Stage};
use crate::radiosity::{RadiosityField, RadiositySystem, Solution, SolverSettings, gauss_seidel};
use crate::world::walk::RayCounts;
use crate::world::{DirectSampling, World};
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
}

impl Default for PassOneSettings {
    /// Form factors within 0.022: 512 rays a patch.
    fn default() -> Self {
        Self { patches: PatchSettings::default(), form_factor_tolerance: 0.0221, solver: SolverSettings::default() }
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
    /// (emitted - absorbed - escaped - truncated) / emitted: mirrors, glass, black backs and the estimation error.
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
    let ray_cast = RayCastSettings::for_tolerance(settings.form_factor_tolerance, DIRECT_POINTS, mix(seed ^ 0x00f0_0f0f));
    let shadow =
        watch.time(Stage::PatchDirect, || direct_irradiance(world, &patches, ray_cast.rays_beside_shadow_rays, seed, counts));
    stop_if_asked(observer, Stage::PatchDirect)?;
    let form_factors = watch
        .time(Stage::FormFactors, || ray_cast::cast(world, &patches, &ray_cast, counts, observer))
        .ok_or(PipelineError::Stopped)?;
    let gathered = gathered_irradiance(world, &patches, &form_factors);
    let source: Vec<Rgb> = shadow.iter().zip(&gathered).map(|(a, b)| *a + *b).collect();
    let system = RadiositySystem { rho: &patches.rho, area: &patches.area, form_factors: &form_factors, source };
    let solution = watch.time(Stage::Solve, || gauss_seidel::solve(&system, &settings.solver, observer))?;
    let indirect = solution.irradiance.iter().zip(&system.source).map(|(h, s)| (*h - *s).map(|v| v.max(0.0))).collect();
    let power = balance(world, &patches, &form_factors, &solution.irradiance);
    let field = RadiosityField::new(patches, shadow, gathered, indirect);
    Ok(PassOne { field, form_factors, solution, power })
}

fn stop_if_asked(observer: &mut Observer<'_>, stage: Stage) -> Result<(), PipelineError> {
    if observer(&Progress { stage, done: 1.0, total: 1.0 }).is_break() { Err(PipelineError::Stopped) } else { Ok(()) }
}

/// Mean irradiance of each patch by the lamps that shadow rays find.
fn direct_irradiance(world: &World, patches: &PatchMesh, gather_rays: f64, seed: u64, counts: &mut RayCounts) -> Vec<Rgb> {
    if world.partition().has_no_shadow_rays() {
        return vec![Rgb::BLACK; patches.len()];
    }
    let measured: Vec<(Rgb, RayCounts)> = (0..patches.len() as u32)
        .into_par_iter()
        .map(|i| {
            let mut counts = RayCounts::default();
            let share = (patches.area[i as usize] / (patches.patch_size * patches.patch_size)).clamp(0.25, 1.0);
            let points = (DIRECT_POINTS * share) as u64;
            let sum: Rgb = (0..points)
                .map(|k| {
                    let mut sampler = Sampler::new(mix(seed ^ 0x00d1_7ec7), u64::from(i), k);
                    let mut at = patches.sample(world, PatchId(i), sampler.next_2d());
                    // Radiosity belongs to the faces themselves, not to the smoothed normals.
                    at.ns = at.ng;
                    world.direct_irradiance(&at, DirectSampling::default(), gather_rays, &mut sampler, &mut counts)
                })
                .sum();
            (sum / points as f64, counts)
        })
        .collect();
    measured.iter().for_each(|(_, c)| *counts += *c);
    measured.into_iter().map(|(h, _)| h).collect()
}

/// Irradiance of each patch by light that only form factors find: glowing walls, the surroundings, and any emitter seen through
/// mirrors or glass.
fn gathered_irradiance(world: &World, patches: &PatchMesh, form_factors: &FormFactorMatrix) -> Vec<Rgb> {
    let by_shadow_rays = patches.found_by_shadow_rays(world);
    (0..patches.len())
        .map(|i| {
            let walls: Rgb =
                form_factors.direct(i).filter(|(j, _)| !by_shadow_rays[*j]).map(|(j, f)| patches.exitance[j] * f).sum();
            walls + form_factors.arriving(i) * PI
        })
        .collect()
}

fn balance(world: &World, patches: &PatchMesh, form_factors: &FormFactorMatrix, irradiance: &[Rgb]) -> PowerBalance {
    let total = |v: Rgb| v.r + v.g + v.b;
    let emitted = total(world.scene().power());
    let (mut absorbed, mut escaped, mut truncated) = (0.0, 0.0, 0.0);
    for (i, &h) in irradiance.iter().enumerate() {
        let (rho, a) = (patches.rho[i], patches.area[i]);
        absorbed += a * total((Rgb::WHITE - rho) * h);
        let leaves = rho * h + patches.exitance[i];
        escaped += a * total(form_factors.escaped(i) * leaves);
        truncated += a * total(form_factors.truncated(i) * leaves);
    }
    let unaccounted = if emitted > 0.0 { (emitted - absorbed - escaped - truncated) / emitted } else { 0.0 };
    PowerBalance { emitted, absorbed, escaped, truncated, unaccounted }
}
