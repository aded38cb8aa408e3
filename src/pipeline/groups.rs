//! The light of pass one in groups, and their solution.

use super::PipelineError;
use super::direct::{self, Lamp, LampLight};
use super::pass_one::PassOneSettings;
use super::shown::Shown;
use crate::form_factor::{FormFactors, Outside, RayPairs, Stored};
use crate::light::Light;
use crate::math::Rgb;
use crate::patch::PatchMesh;
use crate::progress::Observer;
use crate::radiosity::{self, Incident, RadiositySystem, Solution, SolverSettings};
use crate::world::World;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Tolerance of a solution that only tells what is seen of light, over that of the other.
const FIRST_TOLERANCE: f64 = 10.0;

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
        let solve = |direct: &[Rgb], shown: Option<&Shown>, solver: &SolverSettings, observer: &mut Observer<'_>| {
            let mut source = direct.to_vec();
            // What is taken back from patches near each other is of the light that they reflect.
            if let Some(shown) = shown {
                source.iter_mut().zip(&shown.returned).for_each(|(source, returned)| *source += *returned);
            }
            let system = RadiositySystem { rho: &patches.rho, area: &patches.area, form_factors, source };
            radiosity::solve(&system, solver, observer)
        };
        // A first solution tells what is seen of it: some per cent of the light, by rays.
        let is_first = matches!(seen, Some((_, Some(_))));
        let first = SolverSettings { tolerance: if is_first { FIRST_TOLERANCE } else { 1.0 } * solver.tolerance, ..solver };
        let mut solution = solve(&direct, seen.as_ref().map(|(shown, _)| &**shown), &first, observer)?;
        if let Some((shown, Some(pairs))) = &mut seen {
            // One step is enough: the next would change what the first has changed by some tenth.
            let leaving = leaving(world, patches, &solution.irradiance);
            let more = Shown::by_patches(patches, pairs, &leaving);
            direct.iter_mut().zip(&more.beyond_mean).for_each(|(direct, more)| *direct += *more);
            shown.add(&more);
            let sweeps = solution.sweeps;
            solution = solve(&direct, Some(shown), &solver, observer)?;
            solution.sweeps += sweeps;
        }
        group.indirect = solution.irradiance.iter().zip(&direct).map(|(h, s)| (*h - *s).map(|v| v.max(0.0))).collect();
        whole = Some(match whole.take() {
            None => solution,
            Some(mut whole) => {
                whole.irradiance.iter_mut().zip(&solution.irradiance).for_each(|(sum, h)| *sum += *h);
                whole.sweeps += solution.sweeps;
                whole.error_bound = whole.error_bound.max(solution.error_bound);
                whole.spectral_bound = whole.spectral_bound.max(solution.spectral_bound);
                whole.amplification = whole.amplification.max(solution.amplification);
                whole.rooms = whole.rooms.max(solution.rooms);
                whole.converged &= solution.converged;
                whole
            }
        });
    }
    let dark = RadiositySystem { rho: &patches.rho, area: &patches.area, form_factors, source: vec![Rgb::BLACK; patches.len()] };
    let mut whole = match whole {
        Some(whole) => whole,
        None => radiosity::solve(&dark, &solver, observer)?,
    };
    whole.error_bound /= share;
    Ok((whole, groups))
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
