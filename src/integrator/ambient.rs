//! Irradiance caching without a first pass, as in Radiance [Ward88]: light between diffuse surfaces is gathered at few points, and what
//! gather rays meet is lit by shadow rays and by the records of the bounce before.
//!
//! Records carry gradients [Ward92] and are clamped to what their neighbours see. Each bounce has a cache of its own, made from the last
//! bounce to the first, so that nothing depends on the order in which threads ask. Rounds of passes, each twice as long, make the
//! caches anew with more and better records.

use super::irradiance_cache::{Below, BounceSettings, FillSettings, IrradianceCache};
use super::{Frame, Integrator, IntegratorSettings, ReadOut, TwoPass, encode_state};
use crate::film::PixelSample;
use crate::math::sampler::mix;
use crate::world::World;
use crate::world::walk::RayCounts;
use serde::{Deserialize, Serialize};
use std::marker::PhantomData;

/// Passes of the first round: one for each half.
const FIRST_PASSES: u32 = 2;
/// Closest and farthest records of the first round, in pixels as seen.
const FIRST_CLOSEST: f64 = 3.0;
const FARTHEST: f32 = 32.0;
/// Closest records of any round in pixels.
const LEAST_CLOSEST: f64 = 0.25;
/// Gather rays of the first bounce's caches of a round for each camera sample of that round.
const FILL_SHARE: f64 = 1.0;
/// Closest and farthest records of later bounces over the scene's diagonal.
const BOUNCE_REACH: [f32; 2] = [1.0 / 64.0, 1.0 / 8.0];
/// Bounces that have records where light is followed without end.
const CACHED_BOUNCES: u32 = 6;
/// Rays of their records over those of the first bounce.
const BOUNCE_RAYS: f64 = 0.5;

/// How Radiance's method works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AmbientSettings {
    /// Reflections between diffuse surfaces that are followed (Radiance's -ab); `None`: all.
    pub bounces: Option<u32>,
    /// Reach of a record over the mean distance that it sees, in the first round (-aa).
    pub accuracy: f64,
    /// Rays of a record in the first round (-ad).
    pub divisions: u32,
}

impl Default for AmbientSettings {
    /// Behind a door light has been reflected so often that any number of bounces leaves much of it out.
    fn default() -> Self {
        Self { bounces: None, accuracy: 0.4, divisions: 64 }
    }
}

/// Rounds of passes with their caches.
pub struct AmbientCaching<'a> {
    world: &'a World,
    settings: IntegratorSettings,
    ambient: AmbientSettings,
    /// Bounces that have records.
    bounces: u32,
    /// Of each half: the caches of all bounces, the last reflection before the eye first.
    caches: [Option<Vec<IrradianceCache>>; 2],
    rounds: Rounds,
}

/// What a run goes on from.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Rounds {
    round: u32,
    /// First pass of the next round.
    round_end: u32,
    accuracy: f64,
    /// Records of the caches of this round, as far as they are made.
    made: [Option<usize>; 2],
}

impl<'a> AmbientCaching<'a> {
    /// On a scene.
    pub fn new(world: &'a World, settings: IntegratorSettings, ambient: AmbientSettings) -> Self {
        // A path of so many edges has two fewer reflections, without the one that is seen; one more where records find lamps themselves.
        let by_records = u32::from(world.partition().leaves_some());
        let most = settings.max_depth.map(|edges| (edges + by_records).saturating_sub(2).max(1));
        let ambient = AmbientSettings { bounces: ambient.bounces.map_or(most, |b| Some(b.min(most.unwrap_or(b)))), ..ambient };
        let bounces = ambient.bounces.unwrap_or(CACHED_BOUNCES);
        let read_out = if bounces == 0 { ReadOut::DirectStored } else { ReadOut::FinalGather };
        Self {
            world,
            settings: IntegratorSettings { read_out, ..settings },
            ambient,
            bounces,
            caches: [None, None],
            rounds: Rounds { round: 0, round_end: FIRST_PASSES, accuracy: ambient.accuracy, made: [None; 2] },
        }
    }

    /// How much finer than in the first round.
    fn finer(&self) -> f64 {
        2.0_f64.sqrt().powi(self.rounds.round.min(40) as i32)
    }

    fn rays(&self) -> f64 {
        f64::from(self.ambient.divisions) * self.finer().sqrt()
    }

    /// Rays that the first bounce of one half may cost in this round.
    fn most_rays(&self, frame: &Frame) -> u64 {
        let passes = f64::from(FIRST_PASSES) * 2.0_f64.powi(self.rounds.round.min(40) as i32);
        (0.5 * FILL_SHARE * passes * frame.n_pixels() as f64) as u64
    }

    fn next_round(&mut self, frame: &Frame) {
        self.rounds.round += 1;
        self.rounds.round_end += FIRST_PASSES << self.rounds.round.min(24);
        let made = self.rounds.made.into_iter().flatten().max();
        self.rounds.made = [None; 2];
        self.caches = [None, None];
        // As many records as the next budget has rays for: their number goes with the inverse square of the reach.
        if let Some(made) = made.filter(|m| *m > 0) {
            let affordable = self.most_rays(frame) as f64 / self.rays();
            self.rounds.accuracy *= (made as f64 / affordable).sqrt().clamp(0.5, 1.0);
        }
    }

    fn tracer<'b>(&'b self, cache: Option<&'b IrradianceCache>, caches: &'b [IrradianceCache]) -> TwoPass<'b> {
        let below = (self.bounces > 0).then_some(Below { caches, endless: self.ambient.bounces.is_none() });
        TwoPass {
            world: self.world,
            field: None,
            settings: self.settings,
            cache,
            caustics: None,
            ambient: 0.0,
            below,
            residual: None,
            smooth: None,
            stages: PhantomData,
        }
    }

    fn make(&self, frame: &Frame, half: usize, counts: &mut RayCounts) -> Vec<IrradianceCache> {
        let seed = mix(self.settings.seed ^ mix(0x00a3_b1e7 + u64::from(2 * self.rounds.round) + half as u64));
        let mut caches: Vec<IrradianceCache> = Vec::new();
        for bounce in (1..self.bounces).rev() {
            let settings = BounceSettings {
                rays: (BOUNCE_RAYS * self.rays()) as u32,
                accuracy: self.rounds.accuracy as f32,
                reach: BOUNCE_REACH.map(|r| r / self.finer().sqrt() as f32),
                seed: mix(seed ^ u64::from(bounce)),
            };
            let made = self.tracer(None, &caches).fill_bounce(frame, &settings, counts);
            caches.insert(0, made);
        }
        let settings = FillSettings {
            by_nearest: true,
            rays: self.rays() as u32,
            accuracy: self.rounds.accuracy as f32,
            closest: (FIRST_CLOSEST / self.finer()).max(LEAST_CLOSEST) as f32,
            farthest: FARTHEST,
            spacing: 1,
            most_rays: self.most_rays(frame),
            seed,
        };
        let made = self.tracer(None, &caches).fill(frame, &settings, counts);
        caches.insert(0, made);
        // Looking for places cuts paths as well, but none of a camera sample.
        (counts.truncated, counts.truncated_weight) = (0, 0);
        caches
    }
}

impl Integrator for AmbientCaching<'_> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        let mut counts = RayCounts::default();
        if self.bounces == 0 {
            return self.tracer(None, &[]).pass(frame, index);
        }
        if index >= self.rounds.round_end {
            self.next_round(frame);
        }
        let half = (index % 2) as usize;
        if self.caches[half].is_none() {
            let caches = self.make(frame, half, &mut counts);
            // One that an earlier process made is the same once more, and was counted there.
            if self.rounds.made[half].replace(caches.first().map_or(0, IrradianceCache::len)).is_some() {
                counts = RayCounts::default();
            }
            self.caches[half] = Some(caches);
        }
        let caches = self.caches[half].as_deref().unwrap_or_default();
        let mut tracer = self.tracer(caches.first(), caches.get(1..).unwrap_or_default());
        let (samples, of_pass) = tracer.pass(frame, index);
        counts += of_pass;
        (samples, counts)
    }

    fn state(&self) -> Vec<u8> {
        encode_state(&self.rounds)
    }

    fn take_up(&mut self, state: &[u8]) -> bool {
        postcard::from_bytes(state).map(|rounds| self.rounds = rounds).is_ok()
    }
}
