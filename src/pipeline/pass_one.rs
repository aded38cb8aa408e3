//! Pass one: patches, their direct light, form factors, solution. View-independent.

use super::{PipelineError, cost::StageCosts};
use crate::form_factor::{FormFactorMethod, FormFactorSettings, Outside, Stored, memory, method};
use crate::material::Scattering;
use crate::math::{Rgb, Sampler, sampler::mix};
use crate::patch::{PatchId, PatchMesh, PatchSettings};
use crate::progress::{Observer, Progress, Stage};
use crate::radiosity::{self, Incident, RadiosityField, RadiositySystem, Solution, SolverSettings};
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
    /// How form factors are computed.
    pub form_factors: FormFactorMethod,
    /// Error allowed to any form factor, in the method's own sense.
    pub form_factor_tolerance: f64,
    /// The solver.
    pub solver: SolverSettings,
    /// Most bytes that patches and form factors may take; `None`: whatever they need.
    pub max_memory: Option<u64>,
}

impl Default for PassOneSettings {
    /// Form factors within 0.022: 512 rays a patch.
    fn default() -> Self {
        let form_factors = FormFactorMethod::default();
        Self {
            patches: PatchSettings::default(),
            form_factors,
            form_factor_tolerance: form_factors.default_tolerance(),
            solver: SolverSettings::default(),
            max_memory: None,
        }
    }
}

impl PassOneSettings {
    /// The number of patches, and the bytes that they and their form factors take at most, besides the scene.
    ///
    /// # Errors
    /// If the patches are too many.
    pub fn predicted(&self, world: &World) -> Result<(usize, u64), PipelineError> {
        let patches = PatchMesh::build(world, &self.patches)?.len();
        Ok((patches, memory::predicted(patches as f64, &self.form_factor_settings(0)) as u64))
    }

    /// How form factors are made under `seed`.
    pub fn form_factor_settings(&self, seed: u64) -> FormFactorSettings {
        FormFactorSettings {
            method: self.form_factors,
            tolerance: self.form_factor_tolerance,
            shadow_rays: DIRECT_POINTS,
            seed: mix(seed ^ 0x00f0_0f0f),
        }
    }
}

/// The solution with what it rests on.
pub struct PassOne {
    /// What pass two reads.
    pub field: RadiosityField,
    /// Form factors.
    pub form_factors: Stored,
    /// What patches see besides each other.
    pub outside: Outside,
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
    let how = settings.form_factor_settings(seed);
    fits(PatchMesh::expected(world, &settings.patches), &how, settings.max_memory)?;
    let patches = watch.time(Stage::Patches, || PatchMesh::build(world, &settings.patches))?;
    fits(patches.len() as f64, &how, settings.max_memory)?;
    stop_if_asked(observer, Stage::Patches)?;
    let gather_rays = how.rays_beside_shadow_rays(world);
    let shadow = watch.time(Stage::PatchDirect, || direct_irradiance(world, &patches, gather_rays, seed, counts));
    stop_if_asked(observer, Stage::PatchDirect)?;
    let (form_factors, outside) = watch
        .time(Stage::FormFactors, || method::build(world, &patches, &how, counts, observer))
        .ok_or(PipelineError::Stopped)?;
    let gathered = gathered_irradiance(world, &patches, &form_factors, &outside);
    let source: Vec<Rgb> = shadow.iter().zip(&gathered).map(|(a, b)| a.accepted + b.accepted).collect();
    let system = RadiositySystem { rho: &patches.rho, area: &patches.area, form_factors: &form_factors, source };
    let solution = watch.time(Stage::Solve, || radiosity::solve(&system, &settings.solver, observer))?;
    let indirect = solution.irradiance.iter().zip(&system.source).map(|(h, s)| (*h - *s).map(|v| v.max(0.0))).collect();
    let field = RadiosityField::new(patches, shadow, gathered, indirect);
    let power = balance(world, &field, &outside);
    Ok(PassOne { field, form_factors, outside, solution, power })
}

/// Refuses what will not fit, before it is allocated.
fn fits(patches: f64, how: &FormFactorSettings, limit: Option<u64>) -> Result<(), PipelineError> {
    let predicted = memory::predicted(patches, how);
    match limit {
        Some(limit) if predicted > limit as f64 => {
            let method = how.method;
            Err(PipelineError::Memory { patches: patches.round() as u64, predicted: predicted as u64, limit, method })
        }
        _ => Ok(()),
    }
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
fn gathered_irradiance(world: &World, patches: &PatchMesh, form_factors: &Stored, outside: &Outside) -> Vec<Incident> {
    let by_shadow_rays = patches.found_by_shadow_rays(world);
    let exitance = patches.exitance.iter().zip(by_shadow_rays);
    let glowing: Vec<Rgb> = exitance.map(|(e, by_shadow_rays)| if by_shadow_rays { Rgb::BLACK } else { *e }).collect();
    let mut walls = vec![Rgb::BLACK; patches.len()];
    form_factors.gather_direct(&glowing, &mut walls);
    let incident = |(i, walls): (usize, Rgb)| Incident {
        irradiance: walls + outside.arriving(i) * PI,
        accepted: walls + outside.accepted(i) * PI,
    };
    walls.into_iter().enumerate().map(incident).collect()
}

fn balance(world: &World, field: &RadiosityField, outside: &Outside) -> PowerBalance {
    let patches = &field.patches;
    let total = |v: Rgb| v.r + v.g + v.b;
    let emitted = total(world.scene().power());
    let (mut absorbed, mut escaped, mut truncated) = (0.0, 0.0, 0.0);
    for i in 0..patches.len() {
        let a = patches.area[i];
        let leaves = field.radiosity(i);
        absorbed += a * total(field.irradiance_of(i) + patches.exitance[i] - leaves);
        escaped += a * total(outside.escaped(i) * leaves);
        truncated += a * total(outside.truncated(i) * leaves);
    }
    // Of light from infinitely far away a scene takes what it takes: nothing is known to compare with.
    let is_known = world.scene().environment.is_none() && world.scene().lights.iter().all(|light| !light.is_distant());
    let unaccounted = if emitted > 0.0 && is_known { (emitted - absorbed - escaped - truncated) / emitted } else { 0.0 };
    PowerBalance { emitted, absorbed, escaped, truncated, unaccounted }
}
