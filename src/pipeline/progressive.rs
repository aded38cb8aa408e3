//! The default way of pass two: irradiance gathered at few points and read between them, over a pass one that is refined with the effort.
//!
//! Work is done in rounds, each with twice the passes of the one before. A round makes a new cache for each half of the film, with more
//! rays a record and records closer together, so that the error of the cache falls as the noise does; a new pass one, four
//! times as fine, replaces the old one as soon as it costs no more than a share of what has been done. All is decided by
//! counted rays, never by the clock, so that pictures are the same on any machine.

use super::cost::StageCosts;
use super::{PassOne, PassOneSettings, RenderSettings, pass_one};
use crate::film::PixelSample;
use crate::integrator::caustic_map::{CausticMap, CausticSettings};
use crate::integrator::irradiance_cache::{FillSettings, IrradianceCache};
use crate::integrator::{Frame, Integrator, IntegratorSettings, ReadOut, TwoPass};
use crate::math::sampler::mix;
use crate::world::walk::RayCounts;
use crate::world::{Stages, World};
use std::marker::PhantomData;
use std::ops::ControlFlow;

/// Elements of the first pass one. What gather rays see of it, in a mean over the hemisphere, is already within a few per cent.
const FIRST_ELEMENTS: f64 = 256.0;
/// Error allowed to its form factors: 128 rays a patch.
const FIRST_TOLERANCE: f64 = 0.0442;
/// Elements grow by this factor from one pass one to the next.
const GROWTH: f64 = 4.0;
/// The tolerance of form factors falls by this power of that factor.
const TOLERANCE_POWER: f64 = 0.125;
/// No finer pass one than this is made, unless the user asks for one.
const MOST_ELEMENTS: f64 = 65536.0;
/// Share of all rays so far that a new pass one may cost.
const PASS_ONE_SHARE: f64 = 0.35;
/// Passes of the first round: one for each half.
const FIRST_PASSES: u32 = 2;
/// Gather rays of the caches of a round for each camera sample of that round.
const FILL_SHARE: f64 = 1.0;
/// Rays of a record in the first round; they grow by the fourth root of two from round to round: what a round has more goes into more
/// records rather than better ones, since what is left of the error is mostly that of interpolation.
const FIRST_RAYS: f64 = 64.0;
/// Reach of a record over the mean distance that it sees, in the first round.
const FIRST_ACCURACY: f64 = 0.4;
/// Closest records of the first round in pixels.
const FIRST_CLOSEST: f64 = 3.0;
/// Rounds in which places for records are looked for at every other pixel of a row and column only. On the Cornell box that saves a quarter
/// of the time of 4 samples, for an error 1.001 times as large, and a tenth of that of 64, for 1.16 times the error: not worth it there.
const SPACED_ROUNDS: u32 = 4;
/// Particles of a caustic map for each ray that its cache may cost.
const PARTICLE_SHARE: f64 = 0.5;
/// Most particles that leave the lamps for one map: some 200 MB.
const MOST_PARTICLES: f64 = 2e6;
/// Particles that overlap at a point in the first round; grows as the rays of a record.
const FIRST_OVERLAP: f64 = 24.0;
/// Closest records of any round in pixels.
const LEAST_CLOSEST: f64 = 0.25;
/// Most rays of a record.
const MOST_RAYS: f64 = 4096.0;
/// Farthest records in pixels.
const FARTHEST: f64 = 32.0;

/// Rounds of passes with their caches and solutions.
pub(super) struct Progressive<'a, K: Stages> {
    world: &'a World,
    settings: IntegratorSettings,
    pass_one: PassOne,
    pass_one_settings: PassOneSettings,
    /// True if the user did not say how fine pass one is to be.
    refines: bool,
    /// Rays that the present pass one cost.
    pass_one_rays: u64,
    seed: u64,
    round: u32,
    /// First pass of the next round.
    round_end: u32,
    caches: [Option<IrradianceCache>; 2],
    caustics: [Option<CausticMap>; 2],
    accuracy: f64,
    costs: StageCosts,
    /// Rays so far, pass one included.
    pub counts: RayCounts,
    stages: PhantomData<K>,
}

/// The pass one to begin with: coarse, unless the user said how fine.
pub(super) fn first_pass_one(asked: &PassOneSettings) -> PassOneSettings {
    let mut settings = *asked;
    if refines(asked) {
        settings.patches.elements = FIRST_ELEMENTS;
        settings.form_factor_tolerance = FIRST_TOLERANCE;
    }
    settings
}

fn refines(asked: &PassOneSettings) -> bool {
    *asked == PassOneSettings { solver: asked.solver, max_memory: asked.max_memory, ..PassOneSettings::default() }
}

impl<'a, K: Stages> Progressive<'a, K> {
    /// Starts from a first solution, made by [`first_pass_one`], that cost `counts`.
    pub fn new(
        world: &'a World,
        render: &RenderSettings,
        settings: IntegratorSettings,
        pass_one: PassOne,
        counts: RayCounts,
    ) -> Self {
        Self {
            world,
            settings: IntegratorSettings { read_out: ReadOut::FinalGather, ..settings },
            pass_one,
            pass_one_settings: first_pass_one(&render.pass_one),
            refines: refines(&render.pass_one),
            pass_one_rays: rays(&counts),
            seed: render.seed,
            round: 0,
            round_end: FIRST_PASSES,
            caches: [None, None],
            caustics: [None, None],
            accuracy: FIRST_ACCURACY,
            costs: StageCosts::default(),
            counts,
            stages: PhantomData,
        }
    }

    /// The last solution; adds what refining it cost to `watch`, of which it was counted as rendering so far.
    pub fn finish(self, watch: &mut StageCosts) -> PassOne {
        watch.move_from_last(self.costs);
        self.pass_one
    }

    fn next_round(&mut self, frame: &Frame) {
        self.round += 1;
        self.round_end += FIRST_PASSES << self.round.min(24);
        let made: Vec<usize> = self.caches.iter().flatten().map(IrradianceCache::len).collect();
        self.caches = [None, None];
        // As many records as the next budget has rays for: their number goes with the inverse square of the reach. A cache that ran
        // out of rays keeps its reach, and the next one gets farther with it.
        if let Some(&made) = made.iter().max() {
            let affordable = self.most_rays(frame) as f64 / self.rays_per_record();
            self.accuracy *= (made as f64 / affordable).sqrt().clamp(0.5, 1.0);
        }
        if self.refines {
            self.refine();
        }
    }

    /// Replaces pass one by a finer one if it is time.
    fn refine(&mut self) {
        let next = self.pass_one_settings.patches.elements * GROWTH;
        let cost = self.pass_one_rays as f64 * GROWTH * GROWTH.powf(2.0 * TOLERANCE_POWER);
        if next > MOST_ELEMENTS || cost > PASS_ONE_SHARE * rays(&self.counts) as f64 {
            return;
        }
        let mut finer = self.pass_one_settings;
        finer.patches.elements = next;
        finer.form_factor_tolerance /= GROWTH.powf(TOLERANCE_POWER);
        let mut counts = RayCounts::default();
        let mut go_on = |_: &_| ControlFlow::Continue(());
        // What could be solved coarsely can be finely, but for limits on the number of patches: then the old one stays.
        let found = pass_one::solve(self.world, &finer, self.seed, &mut self.costs, &mut counts, &mut go_on);
        match found {
            Ok(pass_one) => {
                self.pass_one = pass_one;
                self.pass_one_settings = finer;
                self.pass_one_rays = rays(&counts);
            }
            Err(_) => self.refines = false,
        }
        self.counts += counts;
    }

    /// How much finer than in the first round.
    fn finer(&self) -> f64 {
        2.0_f64.sqrt().powi(self.round.min(40) as i32)
    }

    fn rays_per_record(&self) -> f64 {
        (FIRST_RAYS * self.finer().sqrt()).min(MOST_RAYS)
    }

    /// Rays that the cache of one half may cost in this round.
    fn most_rays(&self, frame: &Frame) -> u64 {
        let passes = f64::from(FIRST_PASSES) * 2.0_f64.powi(self.round.min(40) as i32);
        (0.5 * FILL_SHARE * passes * frame.n_pixels() as f64) as u64
    }

    /// How the cache of one half is made in this round.
    fn fill_settings(&self, frame: &Frame, half: usize) -> FillSettings {
        FillSettings {
            rays: self.rays_per_record() as u32,
            accuracy: self.accuracy as f32,
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
            particles: (PARTICLE_SHARE * fill.most_rays as f64).min(MOST_PARTICLES) as u32,
            overlap: (FIRST_OVERLAP * self.finer().sqrt()) as f32,
            seed: mix(fill.seed ^ 0xca05),
        }
    }

    fn two_pass<'b>(&'b self, half: usize, cache: Option<&'b IrradianceCache>) -> TwoPass<'b, K> {
        let caustics = self.caustics[half].as_ref();
        TwoPass {
            world: self.world,
            field: Some(&self.pass_one.field),
            settings: self.settings,
            cache,
            caustics,
            ambient: 0.0,
            below: None,
            stages: PhantomData,
        }
    }
}

impl<K: Stages> Integrator for Progressive<'_, K> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        if index >= self.round_end {
            self.next_round(frame);
        }
        let half = (index % 2) as usize;
        let mut counts = RayCounts::default();
        if self.caches[half].is_none() {
            let settings = self.fill_settings(frame, half);
            self.caustics[half] = CausticMap::shoot(self.world, &self.caustic_settings(&settings), &mut counts);
            let cache = self.two_pass(half, None).fill(frame, &settings, &mut counts);
            // Looking for places cuts paths as well, but none of a camera sample.
            (counts.truncated, counts.truncated_weight) = (0, 0);
            self.caches[half] = Some(cache);
        }
        let (samples, of_pass) = self.two_pass(half, self.caches[half].as_ref()).pass(frame, index);
        counts += of_pass;
        self.counts += counts;
        (samples, counts)
    }
}

/// Rays of all kinds.
fn rays(counts: &RayCounts) -> u64 {
    counts.particle + counts.camera + counts.shadow + counts.gather + counts.form_factor + counts.reflected + counts.transmitted
}
