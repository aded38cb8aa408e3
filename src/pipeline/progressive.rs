//! The default way of pass two: irradiance gathered at few points and read between them, over a pass one that is refined with the effort.
//!
//! Work is done in rounds, each with twice the passes of the one before. A round makes a new cache for each half of the film, with more
//! rays a record and records closer together, so that the error of the cache falls as the noise does; a new pass one, four
//! times as fine, replaces the old one as soon as it costs no more than a share of what has been done. All is decided by
//! counted rays, never by the clock, so that pictures are the same on any machine.

use super::allocation::Allocation;
use super::cost::StageCosts;
use super::{PassOne, PassOneSettings, RenderSettings, Seen, pass_one};
use crate::film::{Film, PixelSample, Quantity};
use crate::integrator::caustic_map::{CausticMap, CausticSettings};
use crate::integrator::irradiance_cache::{FillSettings, IrradianceCache};
use crate::integrator::{Frame, Integrator, IntegratorSettings, ReadOut, TwoPass, encode_state};
use crate::math::Rgb;
use crate::math::sampler::mix;
use crate::patch::{DEFAULT_ELEMENTS, PatchSettings};
use crate::world::walk::RayCounts;
use crate::world::{DirectSampling, Stages, World};
use serde::{Deserialize, Serialize};
use std::iter::successors;
use std::marker::PhantomData;
use std::ops::ControlFlow;

/// Elements of the first pass one. What gather rays see of it, in a mean over the hemisphere, is already within a few per cent.
const FIRST_ELEMENTS: f64 = 256.0;
/// Its patches are rough where the scene has more triangles than this for each element.
const MANY_TRIANGLES: f64 = 64.0;
/// Error allowed to its form factors: 128 rays a patch.
const FIRST_TOLERANCE: f64 = 0.0442;
/// Error allowed to its solution, far below what its form factors leave.
const FIRST_SOLVER_TOLERANCE: f64 = 1e-3;
/// Elements grow by this factor from one pass one to the next.
const GROWTH: f64 = 4.0;
/// The tolerance of form factors falls by this power of that factor.
const TOLERANCE_POWER: f64 = 0.125;
/// From so many elements on, and in furnished rooms from the first, light between patches counts by what is seen of it, too. In rooms of few things the noise of
/// few rays and the width of few patches are worse than what means have wrong: with it from the first, `door-ajar` errs by 13 to 27 % more (relMSE) up to 10 CPU s.
const ELEMENTS_ALL_SEEN: f64 = 4096.0;
/// No finer pass one than this is made, unless the user asks for one.
const MOST_ELEMENTS: f64 = 65536.0;
/// Share of all rays so far that a new pass one may cost.
const PASS_ONE_SHARE: f64 = 0.6;
/// The same among many triangles, where much of it is no rays: with 0.6 the studio has a finer one after 10 CPU s, which takes 4 of them more and leaves
/// 1.33e-2 (relMSE) after 14.9 where there was 1.45e-2 after 9.8.
const PASS_ONE_SHARE_AMONG_MANY: f64 = 0.25;
/// Pixels along each side of one that tells the level of light.
const LEVEL_PIXEL: usize = 2;
/// Gather rays of each of these.
const LEVEL_RAYS: u32 = 8;
/// Most by which what earlier passes found is multiplied, or divided.
const MOST_LEVEL: f64 = 2.0;
/// Glances beside each sample of the first pass.
const FIRST_GLANCES: u8 = 1;
/// The same among many triangles: with three instead of five the error of 1 sample of a staircase is 1.27 times as large, of a living room 1.17 times,
/// for 0.96 and 0.92 of the time. In the Cornell box three would cost a tenth of the time of 2 samples.
const FIRST_GLANCES_AMONG_MANY: u8 = 5;
/// Passes of the first round: one for each half.
const FIRST_PASSES: u32 = 2;
/// Gather rays of the caches of the first two rounds for each camera sample of them; after that, by what is known of the errors.
const FIRST_FILL: f64 = 1.0;
/// Fewest and most gather rays of a round for each camera sample.
const FILL: [f64; 2] = [0.5, 4.0];
/// Weight of a cache's error beside that of camera samples: what costs a gather ray costs half a camera sample; a cache has a bias besides
/// the noise that shows; and the error of camera samples falls faster than their number grows.
const CACHE_WEIGHT: f64 = 12.0;
/// Rays of a record in the first round; they grow by the fourth root of two from round to round: what a round has more goes into more
/// records rather than better ones, since what is left of the error is mostly that of interpolation.
const FIRST_RAYS: f64 = 64.0;
/// Reach of a record over the mean distance that it sees, in the first round: in rooms of few things, and among many triangles.
const FIRST_ACCURACY: [f64; 2] = [0.3, 0.4];
/// Closest records of the first round in pixels.
const FIRST_CLOSEST: f64 = 3.0;
/// Rounds in which places for records are looked for at every other pixel of a row and column only. On the Cornell box that saves a quarter
/// of the time of 4 samples, for an error 1.001 times as large, and a tenth of that of 64, for 1.16 times the error: not worth it there.
const SPACED_ROUNDS: u32 = 4;
/// Particles of a caustic map for each ray that its cache may cost.
const PARTICLE_SHARE: f64 = 0.5;
/// Most particles that leave the lamps for one map: some 200 MB.
const MOST_PARTICLES: f64 = 2e6;
/// Records of a half, its particles, and those of the other half get one of so many parts of the memory each; the rest is for pass one.
const MEMORY_PARTS: u64 = 8;
/// Bytes of a record with its place in the grid, in up to eight cells.
const RECORD_BYTES: u64 = 400;
/// Bytes of a particle likewise.
const PARTICLE_BYTES: u64 = 200;
/// Particles that overlap at a point in the first round; grows as the rays of a record.
const FIRST_OVERLAP: f64 = 24.0;
/// Closest records of any round in pixels.
const LEAST_CLOSEST: f64 = 0.25;
/// Most rays of a record.
const MOST_RAYS: f64 = 4096.0;
/// Squared error over what the halves disagree by. Interpolation between records and coarse patches are wrong in both; in 21 rows of the own
/// scenes the noise alone was 0.32 to 0.89 of the error, and with this factor 20 of them are within a factor of two.
const ERROR_OVER_NOISE: f64 = 1.5;
/// The same of filtered pictures: what the filter does wrong is alike in both halves. In 56 rows of the own scenes at 1 to 10 CPU s (five seeds) the noise
/// alone was 0.15 to 0.47 of the error; with this factor 53 of them are within a factor of two.
const ERROR_OVER_FILTERED_NOISE: f64 = 3.0;
/// First round whose records reach as far as what stands nearest lets them, whatever their gradients. Before, gradients limit them: that is faster to
/// fill and to read, and leaves records that missed the light by chance the most room. At 6 samples the error is 0.91 to 0.96 of what it is if the second
/// round is filled that way as well, and block errors 0.78 to 0.94.
const FIRST_BY_NEAREST: u32 = 1;
/// Farthest records in pixels.
const FARTHEST: f64 = 20.0;

/// What a run goes on from: caches and solutions are made again from it.
#[derive(Serialize, Deserialize)]
struct State {
    elements: f64,
    form_factor_tolerance: f64,
    refines: bool,
    pass_one_rays: u64,
    round: u32,
    round_end: u32,
    made: [Option<usize>; 2],
    accuracy: f64,
    fill: f64,
    spent: [f64; 2],
    allocation: Option<Allocation>,
    memory: u64,
    counts: RayCounts,
}

/// Rounds of passes with their caches and solutions.
pub(super) struct Progressive<'a, K: Stages> {
    world: &'a World,
    settings: IntegratorSettings,
    /// `None` where nothing is diffuse or nobody reads it: then all that rounds decide is where samples go.
    pass_one: Option<PassOne>,
    pass_one_settings: PassOneSettings,
    /// As the user asked for it.
    asked: PassOneSettings,
    /// True if the user did not say how fine pass one is to be.
    refines: bool,
    /// Rays that the present pass one cost.
    pass_one_rays: u64,
    seed: u64,
    is_filtered: bool,
    round: u32,
    /// First pass of the next round.
    round_end: u32,
    caches: [Option<IrradianceCache>; 2],
    /// Records of the caches of this round, as far as they are made.
    made: [Option<usize>; 2],
    caustics: [Option<CausticMap>; 2],
    accuracy: f64,
    /// Gather rays of this round for each camera sample.
    fill: f64,
    /// Camera samples a pixel and gather rays of caches so far, a pixel.
    spent: [f64; 2],
    allocation: Option<Allocation>,
    /// Bytes that the records of one half may take, and its particles as much again.
    memory: u64,
    costs: StageCosts,
    /// What earlier passes are to be multiplied by; see [`Integrator::level_of_earlier`].
    level_of_earlier: Option<Rgb>,
    /// Rays so far, pass one included.
    pub counts: RayCounts,
    stages: PhantomData<K>,
}

/// The pass one to begin with: coarse, unless the user said how fine.
pub(super) fn first_pass_one(asked: &PassOneSettings, world: &World) -> PassOneSettings {
    let first = PassOneSettings {
        patches: PatchSettings { elements: FIRST_ELEMENTS, rough: has_many_triangles(world), ..asked.patches },
        form_factor_tolerance: FIRST_TOLERANCE,
        seen: Seen::Lamps,
        ..*asked
    };
    if refines(asked) { with_elements(&first, asked, FIRST_ELEMENTS) } else { *asked }
}

/// The same settings for other elements, as fine elsewhere as suits them.
fn with_elements(settings: &PassOneSettings, asked: &PassOneSettings, elements: f64) -> PassOneSettings {
    let finer = elements / settings.patches.elements;
    let mut found = *settings;
    found.patches = PatchSettings { elements, rough: settings.patches.rough && elements < DEFAULT_ELEMENTS, ..settings.patches };
    found.form_factor_tolerance /= finer.powf(TOLERANCE_POWER);
    if settings.patches.rough || elements >= ELEMENTS_ALL_SEEN {
        found.seen = Seen::All;
    }
    found.solver.tolerance = asked.solver.tolerance.max(FIRST_SOLVER_TOLERANCE * FIRST_ELEMENTS / elements);
    found
}

/// True in a room full of things.
fn has_many_triangles(world: &World) -> bool {
    world.soup().len() as f64 > MANY_TRIANGLES * FIRST_ELEMENTS
}

fn refines(asked: &PassOneSettings) -> bool {
    *asked == PassOneSettings { solver: asked.solver, max_memory: asked.max_memory, ..PassOneSettings::default() }
}

impl<'a, K: Stages> Progressive<'a, K> {
    /// Starts from a first solution, made by [`first_pass_one`], that cost `counts`, or from none where nobody reads it.
    pub fn new(
        world: &'a World,
        render: &RenderSettings,
        settings: IntegratorSettings,
        pass_one: Option<PassOne>,
        counts: RayCounts,
    ) -> Self {
        Self {
            world,
            settings: IntegratorSettings {
                direct: if render.image_filter { DirectSampling::FILTERED } else { settings.direct },
                ..settings
            },
            refines: pass_one.is_some() && refines(&render.pass_one),
            pass_one,
            pass_one_settings: first_pass_one(&render.pass_one, world),
            asked: render.pass_one,
            pass_one_rays: rays(&counts),
            seed: render.seed,
            is_filtered: render.image_filter,
            round: 0,
            round_end: FIRST_PASSES,
            caches: [None, None],
            made: [None; 2],
            caustics: [None, None],
            accuracy: FIRST_ACCURACY[usize::from(has_many_triangles(world))],
            fill: FIRST_FILL,
            spent: [0.0; 2],
            allocation: None,
            memory: render.pass_one.max_memory.map_or(u64::MAX, |all| all / MEMORY_PARTS),
            costs: StageCosts::default(),
            level_of_earlier: None,
            counts,
            stages: PhantomData,
        }
    }

    /// The last solution; adds what refining it cost to `watch`, of which it was counted as rendering so far.
    pub fn finish(self, watch: &mut StageCosts) -> Option<PassOne> {
        watch.move_from_last(self.costs);
        self.pass_one
    }

    fn next_round(&mut self, frame: &Frame) {
        self.round += 1;
        self.round_end += FIRST_PASSES << self.round.min(24);
        let made = self.made.into_iter().flatten().max();
        (self.caches, self.made) = ([None, None], [None; 2]);
        if let Some(allocation) = &mut self.allocation {
            // Least of own/samples + shared/rays for a given samples + rays, each error falling with the effort that went into it.
            let [samples, rays] = self.spent;
            let fill =
                if self.round < 2 { FIRST_FILL } else { (CACHE_WEIGHT * allocation.shared_over_own() * rays / samples).sqrt() };
            self.fill = fill.clamp(FILL[0], FILL[1]);
        }
        // As many records as the next budget has rays for: their number goes with the inverse square of the reach. A cache that ran
        // out of rays keeps its reach, and the next one gets farther with it.
        if let Some(made) = made {
            let affordable = self.most_rays(frame) as f64 / self.rays_per_record();
            self.accuracy *= (made as f64 / affordable).sqrt().clamp(0.5, 1.0);
        }
        if self.refines {
            self.refine(frame);
        }
    }

    /// Replaces pass one by a finer one if it is time.
    fn refine(&mut self, frame: &Frame) {
        let Some(finer) = self.affordable() else { return };
        let (mut counts, mut of_level) = (RayCounts::default(), RayCounts::default());
        let before = self.level(frame, &mut of_level);
        // What could be solved coarsely can be finely, but for limits on the number of patches: then the old one stays.
        match self.replace_pass_one(finer, &mut counts) {
            true => {
                self.pass_one_rays = rays(&counts);
                let now = self.level(frame, &mut of_level);
                let over =
                    |now: f64, before: f64| if before > 0.0 { (now / before).clamp(1.0 / MOST_LEVEL, MOST_LEVEL) } else { 1.0 };
                self.level_of_earlier = Some(Rgb::new(over(now.r, before.r), over(now.g, before.g), over(now.b, before.b)));
            }
            false => self.refines = false,
        }
        // None of it is cut from the picture.
        (of_level.truncated, of_level.truncated_weight) = (0, 0);
        counts += of_level;
        self.counts += counts;
    }

    /// Sum of the light between surfaces over the picture, as the present pass one has it, from the same rays whichever it is.
    fn level(&self, frame: &Frame, counts: &mut RayCounts) -> Rgb {
        let coarse = |n: usize| n.div_ceil(LEVEL_PIXEL);
        let [left, top, width, height] = frame.crop.map(|n| n / LEVEL_PIXEL);
        let frame =
            Frame { width: coarse(frame.width), height: coarse(frame.height), crop: [left, top, width.max(1), height.max(1)] };
        let settings = IntegratorSettings { gather_rays: LEVEL_RAYS, seed: mix(self.seed ^ 0x1e7e1), ..self.settings };
        let (samples, cost) = TwoPass { settings, ..self.two_pass(0, None) }.pass(&frame, 0);
        *counts += cost;
        samples.iter().map(|sample| sample.layers[Quantity::Indirect as usize]).sum()
    }

    /// The finest of the next pass ones whose rays are no more than a share of those so far.
    fn affordable(&self) -> Option<PassOneSettings> {
        let patches = &self.pass_one.as_ref()?.field.patches;
        let share = if has_many_triangles(self.world) { PASS_ONE_SHARE_AMONG_MANY } else { PASS_ONE_SHARE };
        let allowed = share * rays(&self.counts) as f64 / self.pass_one_rays as f64;
        let growth = successors(Some(GROWTH), |growth| Some(growth * GROWTH));
        let finer = growth.map(|growth| {
            (growth, with_elements(&self.pass_one_settings, &self.asked, self.pass_one_settings.patches.elements * growth))
        });
        let per_patch = |settings: &PassOneSettings| f64::from(settings.form_factor_settings(self.seed).rays(self.world).rays);
        let is_affordable = |(growth, finer): &(f64, PassOneSettings)| {
            let more = per_patch(finer) / per_patch(&self.pass_one_settings);
            finer.patches.elements <= MOST_ELEMENTS && patches.shares_if_finer(*growth, finer.patches.rough) * more <= allowed
        };
        finer.take_while(is_affordable).last().map(|(_, finer)| finer)
    }

    /// Another pass one in place of the present one, which stays if there is no such solution.
    fn replace_pass_one(&mut self, settings: PassOneSettings, counts: &mut RayCounts) -> bool {
        let mut go_on = |_: &_| ControlFlow::Continue(());
        // The old one is there until the new one is.
        let bounded = PassOneSettings { max_memory: settings.max_memory.map(|all| all / 2), ..settings };
        let found = pass_one::solve(self.world, &bounded, self.seed, &mut self.costs, counts, &mut go_on);
        match found {
            Ok(pass_one) => {
                self.pass_one = Some(pass_one);
                self.pass_one_settings = settings;
                true
            }
            Err(_) => false,
        }
    }

    /// How much finer than in the first round.
    fn finer(&self) -> f64 {
        2.0_f64.sqrt().powi(self.round.min(40) as i32)
    }

    fn rays_per_record(&self) -> f64 {
        (FIRST_RAYS * self.finer().sqrt() * self.fill).min(MOST_RAYS)
    }

    /// Rays that the cache of one half may cost in this round.
    fn most_rays(&self, frame: &Frame) -> u64 {
        let passes = f64::from(FIRST_PASSES) * 2.0_f64.powi(self.round.min(40) as i32);
        let wanted = 0.5 * self.fill * passes * frame.n_pixels() as f64;
        let most_records = (self.memory / RECORD_BYTES).max(1) as f64;
        wanted.min(most_records * self.rays_per_record()) as u64
    }

    /// How the cache of one half is made in this round.
    fn fill_settings(&self, frame: &Frame, half: usize) -> FillSettings {
        FillSettings {
            rays: self.rays_per_record() as u32,
            accuracy: self.accuracy as f32,
            by_nearest: self.round >= FIRST_BY_NEAREST,
            closest: (FIRST_CLOSEST / self.finer()).max(LEAST_CLOSEST) as f32,
            farthest: FARTHEST as f32,
            spacing: if self.round < SPACED_ROUNDS { 2 } else { 1 },
            most_rays: self.most_rays(frame),
            seed: mix(self.seed ^ mix(u64::from(2 * self.round) + half as u64)),
        }
    }

    /// How the caustic map of one half is made: as many particles as the cache has rays, at most.
    fn caustic_settings(&self, fill: &FillSettings) -> CausticSettings {
        CausticSettings {
            particles: (PARTICLE_SHARE * fill.most_rays as f64).min(MOST_PARTICLES).min((self.memory / PARTICLE_BYTES) as f64)
                as u32,
            overlap: (FIRST_OVERLAP * self.finer().sqrt()) as f32,
            seed: mix(fill.seed ^ 0xca05),
        }
    }

    fn two_pass<'b>(&'b self, half: usize, cache: Option<&'b IrradianceCache>) -> TwoPass<'b, K> {
        let caustics = self.caustics[half].as_ref();
        TwoPass {
            world: self.world,
            field: self.pass_one.as_ref().map(|p| &p.field),
            settings: self.settings,
            cache,
            caustics,
            ambient: 0.0,
            below: None,
            residual: None,
            smooth: None,
            stages: PhantomData,
        }
    }
}

impl<K: Stages> Integrator for Progressive<'_, K> {
    fn look_at(&mut self, film: &Film) {
        if let Some(allocation) = &mut self.allocation
            && (film.n_passes() == 1 || film.n_passes() >= self.round_end)
        {
            allocation.refine(film);
        }
    }

    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        if index >= self.round_end {
            self.next_round(frame);
        }
        let half = (index % 2) as usize;
        let mut counts = RayCounts::default();
        // Where nothing is gathered patches are read as they are.
        let gathers = self.settings.read_out == ReadOut::FinalGather;
        if gathers && self.pass_one.is_some() && self.caches[half].is_none() {
            let settings = self.fill_settings(frame, half);
            self.caustics[half] = CausticMap::shoot(self.world, &self.caustic_settings(&settings), &mut counts);
            let before = counts.gather;
            let cache = self.two_pass(half, None).fill(frame, &settings, &mut counts);
            let gathered = (counts.gather - before) as f64 / frame.n_pixels() as f64;
            // Looking for places cuts paths as well, but none of a camera sample.
            (counts.truncated, counts.truncated_weight) = (0, 0);
            // One that an earlier process made is the same once more, and was counted there.
            if self.made[half].replace(cache.len()).is_some() {
                counts = RayCounts::default();
            } else {
                self.spent[1] += gathered;
            }
            self.caches[half] = Some(cache);
        }
        let mut allocation = self.allocation.take().unwrap_or_else(|| {
            let glances = if has_many_triangles(self.world) { FIRST_GLANCES_AMONG_MANY } else { FIRST_GLANCES };
            Allocation::new(frame, self.seed, glances)
        });
        let plan = allocation.next(half);
        let (looked, of_pass) = self.two_pass(half, self.caches[half].as_ref()).planned_pass(frame, plan);
        allocation.add(half, &looked);
        // In place: at 264 bytes a pixel a second copy is felt.
        let samples = looked.into_iter().map(|looked| looked.sample).collect();
        self.allocation = Some(allocation);
        self.spent[0] += 1.0;
        counts += of_pass;
        self.counts += counts;
        (samples, counts)
    }

    fn level_of_earlier(&mut self) -> Option<Rgb> {
        self.level_of_earlier.take()
    }

    fn state(&self) -> Vec<u8> {
        let PassOneSettings { patches, form_factor_tolerance, .. } = self.pass_one_settings;
        let state = State {
            elements: patches.elements,
            form_factor_tolerance,
            refines: self.refines,
            pass_one_rays: self.pass_one_rays,
            round: self.round,
            round_end: self.round_end,
            made: self.made,
            accuracy: self.accuracy,
            fill: self.fill,
            spent: self.spent,
            allocation: self.allocation.clone(),
            memory: self.memory,
            counts: self.counts,
        };
        encode_state(&state)
    }

    fn error_over_noise(&self) -> f64 {
        match (self.is_filtered, self.pass_one.is_some()) {
            (true, _) => ERROR_OVER_FILTERED_NOISE,
            (false, true) => ERROR_OVER_NOISE,
            // Where nothing is gathered noise is all there is.
            (false, false) => 1.0,
        }
    }

    fn knows_beforehand(&self) -> bool {
        self.pass_one.is_some()
    }

    fn is_filtered(&self) -> bool {
        self.is_filtered
    }

    fn take_up(&mut self, state: &[u8]) -> bool {
        let Ok(state) = postcard::from_bytes::<State>(state) else { return false };
        let mut settings = self.pass_one_settings;
        if state.elements != settings.patches.elements {
            settings = with_elements(&settings, &self.asked, state.elements);
            settings.form_factor_tolerance = state.form_factor_tolerance;
        }
        let is_there = settings == self.pass_one_settings || self.replace_pass_one(settings, &mut RayCounts::default());
        (self.refines, self.pass_one_rays) = (state.refines, state.pass_one_rays);
        (self.round, self.round_end, self.made, self.accuracy) = (state.round, state.round_end, state.made, state.accuracy);
        (self.fill, self.spent, self.allocation) = (state.fill, state.spent, state.allocation);
        (self.memory, self.counts) = (state.memory, state.counts);
        is_there
    }
}

/// Rays of all kinds but glances, which cost less, and without those that cannot count in the picture: whether they are cast must decide nothing.
fn rays(counts: &RayCounts) -> u64 {
    let all = counts.particle + counts.camera + counts.shadow + counts.gather + counts.form_factor;
    all + counts.reflected + counts.transmitted - counts.idle
}
