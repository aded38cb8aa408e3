//! The light of pass one in groups, and their solution.

use super::PipelineError;
use super::direct::{self, Lamp, LampLight};
use super::pass_one::PassOneSettings;
use super::shown::Shown;
use crate::form_factor::{FormFactorMethod, FormFactors, Outside, RayPairs, Stored};
use crate::light::Light;
use crate::math::Rgb;
use crate::patch::PatchMesh;
use crate::progress::Observer;
use crate::radiosity::{self, Incident, RadiositySystem, Solution, SolverSettings};
use crate::world::World;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Bounces of light after which the rest is told from the last two: enough to know what is seen of light, some per cent of it.
const BOUNCES: u32 = 6;
/// Most of the light of a bounce that the next one is taken to keep.
const MOST_KEPT: f64 = 0.99;

/// Part of the light: that of one lamp, or all of it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct LightGroup {
    /// The lamp; without a name it is light of several, which cannot be told apart.
    pub lamp: Lamp,
    /// Its place among the lamps that shadow rays find; `None` if it is none of them, or all.
    pub shadow: Option<usize>,
    /// Irradiance of each patch by emission that form factors find [W/m²]; empty: none.
    pub gathered: Vec<Incident>,
    /// Irradiance of each patch by light that patches have reflected [W/m²].
    pub indirect: Vec<Rgb>,
}

/// The light in groups, not solved yet: one of all, or, by lamp, one for each lamp that shadow rays find, one for each glowing shape, and
/// one for what came by other ways than straight ones, of which nobody knows whose it is.
pub(super) fn divide(
    world: &World,
    settings: &PassOneSettings,
    (patches, form_factors, outside): (&PatchMesh, &Stored, &Outside),
    lamps: &[LampLight],
) -> Vec<LightGroup> {
    if !settings.by_light {
        return vec![LightGroup {
            gathered: gathered_irradiance(world, patches, form_factors, outside),
            ..LightGroup::default()
        }];
    }
    let mut groups: Vec<LightGroup> = lamps
        .iter()
        .enumerate()
        .map(|(k, light)| LightGroup { lamp: light.lamp.clone(), shadow: Some(k), ..LightGroup::default() })
        .collect();
    let shapes = patches.shapes(world);
    for (index, light) in world.scene().lights.iter().enumerate() {
        let (Light::Area(area), Some(shape)) = (light, light.shape()) else { continue };
        if world.partition().found_by_shadow_rays(area.shape as usize) {
            continue;
        }
        let glowing: Vec<Rgb> =
            patches.exitance.iter().zip(&shapes).map(|(e, s)| if *s == shape as usize { *e } else { Rgb::BLACK }).collect();
        let mut walls = vec![Rgb::BLACK; patches.len()];
        form_factors.gather_direct(&glowing, &mut walls);
        let gathered = walls.into_iter().map(|h| Incident { irradiance: h, accepted: h }).collect();
        groups.push(LightGroup { lamp: direct::lamp_of(world.scene(), index), gathered, ..LightGroup::default() });
    }
    let arriving: Vec<Incident> = (0..patches.len())
        .map(|i| Incident { irradiance: outside.arriving(i) * PI, accepted: outside.accepted(i) * PI })
        .collect();
    if arriving.iter().any(|a| !a.irradiance.is_black()) {
        groups.push(LightGroup { gathered: arriving, ..LightGroup::default() });
    }
    groups
}

/// Solves the groups one after the other; the solution is their sum.
pub(super) fn solve(
    world: &World,
    settings: &PassOneSettings,
    (patches, form_factors): (&PatchMesh, &dyn FormFactors),
    mut groups: Vec<LightGroup>,
    (lamps, mut seen): (&[LampLight], Option<(&mut Shown, Option<&RayPairs>)>),
    observer: &mut Observer<'_>,
) -> Result<(Solution, Vec<LightGroup>), PipelineError> {
    // Errors add up as the light does, but each channel of the mean has its own brightest group: three times at most.
    let share = if groups.len() > 1 { 1.0 / 3.0 } else { 1.0 };
    let solver = SolverSettings { tolerance: settings.solver.tolerance * share, ..settings.solver };
    let how = settings.form_factor_settings(0);
    let rays = how.rays(world);
    let rays_of = |i: usize| match how.method {
        FormFactorMethod::RayCast => f64::from(rays.rays_of(patches, i)),
        _ => f64::INFINITY,
    };
    let unlit = RadiositySystem { rho: &patches.rho, area: &patches.area, form_factors, source: Vec::new() };
    let held = radiosity::held_reflectance(&unlit, rays_of);
    let rho = held.as_deref().unwrap_or(&patches.rho);
    let mut whole: Option<Solution> = None;
    for group in &mut groups {
        let mut source = vec![Rgb::BLACK; patches.len()];
        let shadow = match group.shadow {
            Some(lamp) => std::slice::from_ref(&lamps[lamp]),
            None if settings.by_light => &[],
            None => lamps,
        };
        for incident in shadow.iter().map(|lamp| &lamp.incident).chain([&group.gathered]) {
            source.iter_mut().zip(incident).for_each(|(source, h)| *source += h.accepted);
        }
        let mut direct = source.clone();
        if let Some((shown, _)) = &seen {
            direct.iter_mut().zip(&shown.beyond_mean).for_each(|(direct, more)| *direct += *more);
        }
        // What is taken back from patches near each other is of the light that they reflect.
        let system_of = |direct: &[Rgb], shown: Option<&Shown>| {
            let mut source = direct.to_vec();
            if let Some(shown) = shown {
                source.iter_mut().zip(&shown.returned).for_each(|(source, returned)| *source += *returned);
            }
            RadiositySystem { rho, area: &patches.area, form_factors, source }
        };
        let mut bounces = 0;
        if let Some((shown, Some(pairs))) = &mut seen {
            // Once is enough: with what it changes it would change by some tenth of that.
            let irradiance = after_bounces(&system_of(&direct, Some(shown)), patches);
            bounces = BOUNCES;
            let more = Shown::by_patches(patches, pairs, &leaving(world, patches, &irradiance));
            direct.iter_mut().zip(&more.beyond_mean).for_each(|(direct, more)| *direct += *more);
            shown.add(&more);
        }
        let mut solution = radiosity::solve(&system_of(&direct, seen.as_ref().map(|(shown, _)| &**shown)), &solver, observer)?;
        solution.sweeps += bounces;
        group.indirect = solution.irradiance.iter().zip(&direct).map(|(h, s)| (*h - *s).map(|v| v.max(0.0))).collect();
        whole = Some(match whole.take() {
            None => solution,
            Some(mut whole) => {
                whole.irradiance.iter_mut().zip(&solution.irradiance).for_each(|(sum, h)| *sum += *h);
                whole.sweeps += solution.sweeps;
                whole.error_bound = whole.error_bound.max(solution.error_bound);
                whole.spectral_bound = whole.spectral_bound.max(solution.spectral_bound);
                whole.amplification = whole.amplification.max(solution.amplification);
                whole.mean_amplification = whole.mean_amplification.max(solution.mean_amplification);
                whole.rooms = whole.rooms.max(solution.rooms);
                whole.converged &= solution.converged;
                whole
            }
        });
    }
    let dark = RadiositySystem { rho, area: &patches.area, form_factors, source: vec![Rgb::BLACK; patches.len()] };
    let mut whole = match whole {
        Some(whole) => whole,
        None => radiosity::solve(&dark, &solver, observer)?,
    };
    whole.error_bound /= share;
    Ok((whole, groups))
}

/// Irradiance after some bounces, with what more of them would bring in each channel if each were to the last as that was to the one before.
fn after_bounces(system: &RadiositySystem<'_>, patches: &PatchMesh) -> Vec<Rgb> {
    let (mut irradiance, mut last) = (system.source.clone(), system.source.clone());
    let mut bounce = vec![Rgb::BLACK; system.len()];
    // Light that cannot count in the picture decides nothing.
    let counting = || (0..system.len()).filter(|i| !patches.is_idle(*i));
    let total = |light: &[Rgb]| counting().map(|i| light[i] * system.area[i]).sum::<Rgb>();
    let mut ratio = Rgb::BLACK;
    for _ in 0..BOUNCES {
        system.reflect(&last, &mut bounce);
        irradiance.iter_mut().zip(&bounce).for_each(|(h, more)| *h += *more);
        let (now, before) = (total(&bounce), total(&last));
        let over = |now: f64, before: f64| if before > 0.0 { (now / before).clamp(0.0, MOST_KEPT) } else { 0.0 };
        ratio = Rgb::new(over(now.r, before.r), over(now.g, before.g), over(now.b, before.b));
        std::mem::swap(&mut last, &mut bounce);
    }
    let more = ratio.map(|q| q / (1.0 - q));
    irradiance.iter_mut().zip(&last).for_each(|(h, last)| *h += *last * more);
    irradiance
}

/// Radiosity of each patch that form factors find, by its irradiance; emission that shadow rays find is none of it.
fn leaving(world: &World, patches: &PatchMesh, irradiance: &[Rgb]) -> Vec<Rgb> {
    let reflected = irradiance.iter().zip(&patches.rho).map(|(h, rho)| *h * *rho);
    reflected.zip(glowing(world, patches)).map(|(reflected, glow)| reflected + glow).collect()
}

/// Exitance of each patch that no shadow ray finds.
fn glowing(world: &World, patches: &PatchMesh) -> Vec<Rgb> {
    let exitance = patches.exitance.iter().zip(patches.found_by_shadow_rays(world));
    exitance.map(|(e, by_shadow_rays)| if by_shadow_rays { Rgb::BLACK } else { *e }).collect()
}

/// Irradiance of each patch by light that only form factors find: glowing walls, the surroundings, and any emitter seen through
/// mirrors or glass.
fn gathered_irradiance(world: &World, patches: &PatchMesh, form_factors: &Stored, outside: &Outside) -> Vec<Incident> {
    let glowing = glowing(world, patches);
    let mut walls = vec![Rgb::BLACK; patches.len()];
    form_factors.gather_direct(&glowing, &mut walls);
    let incident = |(i, walls): (usize, Rgb)| Incident {
        irradiance: walls + outside.arriving(i) * PI,
        accepted: walls + outside.accepted(i) * PI,
    };
    walls.into_iter().enumerate().map(incident).collect()
}
