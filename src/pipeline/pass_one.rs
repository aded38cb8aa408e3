//! Pass one: patches, their direct light, form factors, solution. View-independent.

use super::direct::{self, DIRECT_POINTS, LampLight, LampWeight};
use super::groups;
pub use super::groups::LightGroup;
use super::{PipelineError, adaptive, cost::StageCosts};
use crate::form_factor::{
    FormFactorMatrix, FormFactorMethod, FormFactorSettings, FormFactors, OneChannel, Outside, Stored, memory, method,
};
use crate::math::{Rgb, sampler::mix};
use crate::patch::{PatchMesh, PatchSettings};
use crate::progress::{Observer, Progress, Stage};
use crate::radiosity::{Incident, RadiosityField, Solution, Solver, SolverSettings};
use crate::world::World;
use crate::world::walk::RayCounts;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// From so many elements on links between groups of patches are the better form factors where pass one is all there is: at 18,000 patches
/// their noise in radiosity is a tenth of that of 512 rays a patch, and their time and memory grow more slowly.
const MANY_ELEMENTS: f64 = 3000.0;

/// How pass one is done.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PassOneSettings {
    /// The patches.
    pub patches: PatchSettings,
    /// How form factors are computed.
    pub form_factors: FormFactorMethod,
    /// Error allowed to any form factor, in the method's own sense.
    pub form_factor_tolerance: f64,
    /// The solver.
    pub solver: SolverSettings,
    /// True: the light of each lamp is solved for by itself, so that lamps can be made stronger or weaker afterwards.
    pub by_light: bool,
    /// Most bytes that patches and form factors may take; `None`: whatever they need.
    pub max_memory: Option<u64>,
    /// Form factors by way of mirrors, glass and gloss as well (extended ones, [Sillion89]).
    pub extended: bool,
    /// Instead of these: by way of flat mirrors, so many in a row, as virtual rooms [Wallace87]. No kept
    /// solution has them.
    #[serde(skip)]
    pub virtual_rooms: Option<u32>,
    /// Which light counts by what far places see of a patch, rather than by its mean; no kept solution has that.
    #[serde(skip)]
    pub seen: Seen,
}

/// Light that counts by what far places see of a patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Seen {
    /// None: all light of a patch has its mean.
    #[default]
    Nothing,
    /// Light of lamps that shadow rays find.
    Lamps,
    /// That, and what patches send each other.
    All,
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
            extended: true,
            virtual_rooms: None,
            seen: Seen::Nothing,
            by_light: false,
            max_memory: None,
        }
    }
}

impl PassOneSettings {
    /// Bytes that so many patches and their form factors take at most, besides the scene.
    pub fn predicted(&self, patches: usize) -> u64 {
        memory::predicted(patches as f64, &self.form_factor_settings(0)) as u64
    }

    /// Takes hierarchical form factors, at their own tolerance, where the scene makes many elements.
    pub fn choose_form_factors(&mut self, world: &World) {
        if PatchMesh::expected(world, &self.patches) > MANY_ELEMENTS {
            self.form_factors = FormFactorMethod::Hierarchical;
            self.form_factor_tolerance = self.form_factors.default_tolerance();
        }
    }

    /// How form factors are made under `seed`.
    pub fn form_factor_settings(&self, seed: u64) -> FormFactorSettings {
        FormFactorSettings {
            method: self.form_factors,
            tolerance: self.form_factor_tolerance,
            shadow_rays: DIRECT_POINTS,
            extended: self.extended,
            virtual_rooms: self.virtual_rooms,
            in_pairs: self.seen == Seen::All,
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
    /// Direct light of the lamps that shadow rays find.
    pub lamps: Vec<LampLight>,
    /// The light of the solution in parts that add up to it: by lamp if that was asked for, or all in one.
    pub groups: Vec<LightGroup>,
    /// How the system was solved.
    pub solution: Solution,
    /// Where the light went.
    pub power: PowerBalance,
    /// What was not computed but taken from a file.
    pub reused: Reused,
    /// Channels that products with the form factors went through.
    pub channels: u32,
}

/// Stages whose results were there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Reused {
    /// The patches.
    pub patches: bool,
    /// The form factors.
    pub form_factors: bool,
    /// The direct light.
    pub lamps: bool,
    /// The solution.
    pub solution: bool,
}

/// What is known already: each stage needs those before it.
#[derive(Default)]
pub struct Kept {
    /// The patches, whatever their reflectance and emission.
    pub patches: Option<PatchMesh>,
    /// The patches as this run has made them already; not looked at if there are those above.
    pub fresh: Option<PatchMesh>,
    /// Form factors, and what patches see besides each other.
    pub form_factors: Option<(Stored, Outside)>,
    /// Direct light, at whatever strengths the lamps had.
    pub lamps: Option<Vec<LampLight>>,
    /// The solution.
    pub solved: Option<(SolutionSummary, Vec<LightGroup>)>,
}

/// A solution with all that it rests on, as a file keeps it.
pub struct Whole {
    /// The patches, whatever their reflectance and emission.
    pub patches: PatchMesh,
    /// Form factors.
    pub form_factors: Stored,
    /// What patches see besides each other.
    pub outside: Outside,
    /// Direct light of the lamps that shadow rays find.
    pub lamps: Vec<LampLight>,
    /// How the system was solved.
    pub summary: SolutionSummary,
    /// The light in parts.
    pub groups: Vec<LightGroup>,
}

impl Whole {
    /// Pass one for a world whose lamps are `weights` times as strong as they were when it was solved. Light adds up: nothing is solved.
    pub fn weighted(self, world: &World, weights: &[LampWeight]) -> PassOne {
        let Self { mut patches, form_factors, outside, lamps, summary, groups } = self;
        patches.measure_light(world);
        let scale: Vec<Rgb> = groups.iter().map(|group| weight_of(&group.lamp.name, weights)).collect();
        let field = assemble(patches, &lamps, &groups, &scale);
        let power = balance(world, &field, &outside);
        let solution = summary.with(Vec::new());
        let reused = Reused { patches: true, form_factors: true, lamps: true, solution: true };
        PassOne { field, form_factors, outside, lamps, groups, solution, power, reused, channels: 0 }
    }
}

fn weight_of(name: &str, weights: &[LampWeight]) -> Rgb {
    weights.iter().filter(|w| !name.is_empty() && w.name == name).fold(Rgb::WHITE, |product, w| product * w.factor)
}

/// A [`Solution`] without its irradiances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SolutionSummary {
    sweeps: u32,
    error_bound: f64,
    spectral_bound: f64,
    amplification: f64,
    mean_amplification: f64,
    rooms: u32,
    solver: Solver,
    converged: bool,
}

impl From<&Solution> for SolutionSummary {
    fn from(s: &Solution) -> Self {
        let Solution { sweeps, error_bound, spectral_bound, amplification, mean_amplification, rooms, solver, converged, .. } =
            *s;
        Self { sweeps, error_bound, spectral_bound, amplification, mean_amplification, rooms, solver, converged }
    }
}

impl SolutionSummary {
    fn with(self, irradiance: Vec<Rgb>) -> Solution {
        let Self { sweeps, error_bound, spectral_bound, amplification, mean_amplification, rooms, solver, converged } = self;
        Solution { irradiance, sweeps, error_bound, spectral_bound, amplification, mean_amplification, rooms, solver, converged }
    }
}

/// Power of all light over the three channels [W]. What mirrors and glass absorb is the rest.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct PowerBalance {
    /// Emitted by area and point lights.
    pub emitted: f64,
    /// Absorbed by patches: sum of A (1 - rho) H, less what they pass on by gloss, which is counted where it ends. Light of points that leaves
    /// the scene off gloss is held to be absorbed there.
    pub absorbed: f64,
    /// Left the scene after reflection by a patch or emission by a glowing surface.
    pub escaped: f64,
    /// Not followed further because of the limit of specular events.
    pub truncated: f64,
    /// (emitted - absorbed - escaped - truncated) / emitted: mirrors, glass, black backs and the estimation error. 0 where a sun or the
    /// surroundings give light, whose power is not known, and where light that cannot count in the picture was left out.
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
    solve_from(world, (settings, seed), Kept::default(), watch, counts, observer)
}

/// Solves pass one, as far as it is not known already.
///
/// # Errors
/// As [`solve`].
pub fn solve_from(
    world: &World,
    (settings, seed): (&PassOneSettings, u64),
    kept: Kept,
    watch: &mut StageCosts,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Result<PassOne, PipelineError> {
    if let (Some(share), None) = (settings.patches.adaptive, &kept.patches) {
        return adaptive::solve(world, (settings, seed), (share, kept.fresh), watch, counts, observer);
    }
    let mut reused = Reused { patches: kept.patches.is_some(), ..Reused::default() };
    let how = settings.form_factor_settings(seed);
    if kept.form_factors.is_none() && kept.fresh.is_none() {
        expect_to_fit(world, settings)?;
    }
    let mut patches = watch.time(Stage::Patches, || match kept.patches {
        Some(mut patches) => {
            patches.measure_light(world);
            Ok(patches)
        }
        None => kept.fresh.map_or_else(|| PatchMesh::build(world, &settings.patches), Ok),
    })?;
    if world.needs().is_plain() {
        watch.time(Stage::Patches, || patches.lay_out(world));
    }
    // What is kept holds for any camera.
    if !reused.patches {
        patches.mark_idle(world);
    }
    if kept.form_factors.is_none() {
        fits(patches.len() as f64, &how, settings.max_memory)?;
    }
    stop_if_asked(observer, Stage::Patches)?;
    let lamps = kept.lamps.and_then(|lamps| direct::with_strengths_of(world, lamps));
    reused.lamps = lamps.is_some();
    let rays_beside = how.rays_beside_shadow_rays(world);
    let allowed = direct::allowed_noise(patches.len(), settings.form_factor_tolerance);
    let seen = (settings.seen != Seen::Nothing).then_some(allowed);
    let measure = || direct::measure(world, &patches, (rays_beside, seen), seed, counts);
    let (lamps, mut shown) = watch.time(Stage::PatchDirect, || lamps.map_or_else(measure, |lamps| (lamps, None)));
    stop_if_asked(observer, Stage::PatchDirect)?;
    reused.form_factors = kept.form_factors.is_some();
    let compute = || method::build(world, &patches, &how, counts, observer);
    let (form_factors, outside) =
        watch.time(Stage::FormFactors, || kept.form_factors.or_else(compute)).ok_or(PipelineError::Stopped)?;
    reused.solution = kept.solved.is_some();
    let one_channel = OneChannel(&form_factors);
    let operator: &dyn FormFactors = if world.is_grey() { &one_channel } else { &form_factors };
    let (solution, groups) = match kept.solved {
        Some((summary, groups)) => (summary.with(Vec::new()), groups),
        None => watch.time(Stage::Solve, || {
            let groups = groups::divide(world, settings, (&patches, &form_factors, &outside), &lamps);
            let seen = shown.as_mut().map(|shown| (shown, form_factors.rows().and_then(FormFactorMatrix::pairs)));
            groups::solve(world, settings, (&patches, operator), groups, (&lamps, seen), observer)
        })?,
    };
    let channels = match reused.solution {
        true => 0,
        false if world.is_grey() => one_channel.channels(),
        false => 3,
    };
    let mut field = assemble(patches, &lamps, &groups, &[]);
    if let Some(shown) = shown {
        field.show(shown.beyond_mean);
    }
    let power = balance(world, &field, &outside);
    Ok(PassOne { field, form_factors, outside, lamps, groups, solution, power, reused, channels })
}

/// The field of lamps and groups, with a factor on each group; none: all as they are.
fn assemble(patches: PatchMesh, lamps: &[LampLight], groups: &[LightGroup], scale: &[Rgb]) -> RadiosityField {
    let n = patches.len();
    let (mut shadow, mut gathered, mut indirect) =
        (vec![Incident::default(); n], vec![Incident::default(); n], vec![Rgb::BLACK; n]);
    let add = |to: &mut [Incident], from: &[Incident], scale: Rgb| {
        to.iter_mut().zip(from).for_each(|(to, from)| {
            to.irradiance += from.irradiance * scale;
            to.accepted += from.accepted * scale;
        });
    };
    let scale_of = |group: usize| scale.get(group).copied().unwrap_or(Rgb::WHITE);
    for (lamp, light) in lamps.iter().enumerate() {
        let group = groups.iter().position(|g| g.shadow == Some(lamp));
        add(&mut shadow, &light.incident, group.map_or(Rgb::WHITE, scale_of));
    }
    for (g, group) in groups.iter().enumerate() {
        add(&mut gathered, &group.gathered, scale_of(g));
        indirect.iter_mut().zip(&group.indirect).for_each(|(to, from)| *to += *from * scale_of(g));
    }
    RadiosityField::new(patches, shadow, gathered, indirect)
}

/// Refuses a pass one that is expected not to fit, before a patch is made.
///
/// # Errors
/// [`PipelineError::Memory`] with the patches expected.
pub fn expect_to_fit(world: &World, settings: &PassOneSettings) -> Result<(), PipelineError> {
    fits(PatchMesh::expected(world, &settings.patches), &settings.form_factor_settings(0), settings.max_memory)
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

fn balance(world: &World, field: &RadiosityField, outside: &Outside) -> PowerBalance {
    let patches = &field.patches;
    let total = |v: Rgb| v.r + v.g + v.b;
    let emitted = total(world.scene().power());
    let (mut absorbed, mut escaped, mut truncated) = (0.0, 0.0, 0.0);
    for i in 0..patches.len() {
        let a = patches.area[i];
        let leaves = field.radiosity(i);
        // Far places see more of a patch than its mean, which is what it absorbs by.
        let mean = leaves - patches.rho[i] * field.shown_beyond_mean(i);
        absorbed += a * total(field.irradiance_of(i) + patches.exitance[i] - mean);
        // What gloss passes on falls on patches twice or oftener.
        let reflected = leaves - patches.exitance[i];
        absorbed -= a * total(outside.passed_on(i) * reflected + outside.passed_out(i) * leaves + outside.arriving_again(i) * PI);
        escaped += a * total(outside.escaped(i) * leaves);
        truncated += a * total(outside.truncated(i) * leaves);
    }
    // Of light from infinitely far away a scene takes what it takes: nothing is known to compare with. Nor is what light does where it cannot
    // count, if that is left out.
    let is_known = !world.leaves_idle()
        && world.scene().environment.is_none()
        && world.scene().lights.iter().all(|light| !light.is_distant());
    let unaccounted = if emitted > 0.0 && is_known { (emitted - absorbed - escaped - truncated) / emitted } else { 0.0 };
    PowerBalance { emitted, absorbed, escaped, truncated, unaccounted }
}
