//! Metropolis light transport over random numbers [Kelemen02], each state of a chain one path made in one way of the bidirectional
//! sampler [Hachisuka14], beside bidirectional walks.
//!
//! A state is three streams of numbers: for the walk from the camera, for the walk from a lamp, and for the way to make the path and its shadow
//! ray. What a path brings is weighted against all other ways to make it, and divided by the probability of its way. Ways are
//! drawn by what each has brought to the first pass. Every pass makes one bidirectional sample a pixel as well, which leaves to the chains
//! a share of each contribution of three edges or more, the greater the brighter it is beside the picture around
//! ([`super::bidirectional::shared`]). The picture around is that of the first pass, which leaves nothing to chains.
//!
//! Start-up: many independent states are drawn first; chains start at some of them, chosen by what they bring, so that each chain's first
//! state has the right distribution in the mean of all runs ([Veach97], section 11.3.1). How much all states are wanted, over which the
//! chains' light is normalised, is measured by the bidirectional walks. The number of chains is fixed, so threads change nothing.

use super::bidirectional::shared::{Left, SHORTEST, Sharing};
use super::bidirectional::subpath::{Carried, Met, Vertex, Walk};
use super::bidirectional::{Bidirectional, Heuristic, Known, PassFound, REVISION, Use, layer_of};
use super::splat::Splats;
use super::{Frame, Integrator, IntegratorSettings, encode_state};
use crate::film::{PixelSample, Quantity};
use crate::math::{Change, Proposal, Rgb, Sampler, Vec2, sampler::mix};
use crate::world::World;
use crate::world::walk::RayCounts;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Numbers of each stream that small steps move; those beyond are always new. A vertex takes three or four.
const NUMBERS: usize = 32;
/// Probability of a step that draws the walk from the camera anew and moves the rest a little: what a lamp's walk lights is seen from
/// elsewhere.
const CAMERA_STEPS: f64 = 0.2;
/// The same, or the walk from the lamp is drawn anew.
const CAMERA_AND_LAMP_STEPS: f64 = 0.3;
/// States that the starts of all chains of a half are chosen from.
const STARTS: u64 = 1 << 14;

/// How chains run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MetropolisSettings {
    /// Chains of each half of the film.
    pub chains: u32,
    /// Probability of a large step, in (0, 1].
    pub large_steps: f64,
    /// Steps of all chains for each bidirectional sample, above 0.
    pub steps: f64,
    /// Brightness beside the picture's around, from which on most of what a path brings is left to chains, above 0.
    pub even: f64,
}

impl Default for MetropolisSettings {
    /// 64 chains keep 64 threads busy.
    fn default() -> Self {
        Self { chains: 64, large_steps: 0.1, steps: 0.5, even: 32.0 }
    }
}

/// Where light falls on the film: place, layer, and what an average pixel gets of it.
type Light = (Vec2, Quantity, Rgb);

/// What a path brings.
#[derive(Default)]
struct Found {
    light: Vec<Light>,
    /// How much it is wanted: the density of states is in proportion to this.
    wanted: f64,
}

/// Where a chain is.
#[derive(Clone, Serialize, Deserialize)]
#[serde(from = "KeptState", into = "KeptState")]
struct State {
    numbers: [Arc<[f32]>; 3],
    light: Vec<Light>,
    /// How much it is wanted: the density of states is in proportion to this.
    wanted: f64,
}

/// A state as a file keeps it: its numbers, light and how much it is wanted.
#[derive(Serialize, Deserialize)]
struct KeptState([Vec<f32>; 3], Vec<Light>, f64);

impl From<KeptState> for State {
    fn from(KeptState(numbers, light, wanted): KeptState) -> Self {
        State { numbers: numbers.map(Arc::from), light, wanted }
    }
}

impl From<State> for KeptState {
    fn from(state: State) -> Self {
        KeptState(state.numbers.map(|n| n.to_vec()), state.light, state.wanted)
    }
}

/// Chains of one half of the film.
#[derive(Serialize, Deserialize)]
struct Half {
    chains: Vec<State>,
    /// How much is wanted of what was left to chains, summed over bidirectional samples, and their number.
    wanted: f64,
    samples: u64,
    steps: u64,
}

/// Chains of paths.
pub struct Metropolis<'a> {
    bidirectional: Bidirectional<'a>,
    settings: IntegratorSettings,
    chains: MetropolisSettings,
    sharing: Option<Sharing>,
    halves: [Option<Half>; 2],
}

/// What a chain does in one pass.
struct Stretch<'r> {
    sharing: &'r Sharing,
    /// How much an independent state is wanted in the mean, as known so far.
    mean: f64,
    seed: u64,
    steps: std::ops::Range<u64>,
}

/// The three streams of a step.
fn streams(numbers: &[Arc<[f32]>; 3], change: [Change; 3], seed: u64) -> [Proposal; 3] {
    [0, 1, 2].map(|i| Proposal { present: Arc::clone(&numbers[i]), change: change[i], seed: mix(seed ^ mix(i as u64 + 1)) })
}

/// Numbers of independent state `i`.
fn independent(seed: u64, i: u64) -> [Proposal; 3] {
    let none: [Arc<[f32]>; 3] = [0; 3].map(|_| Arc::from([0.0; NUMBERS]));
    streams(&none, [Change::Large; 3], mix(seed ^ mix(i)))
}

impl<'a> Metropolis<'a> {
    /// On a scene.
    pub fn new(world: &'a World, settings: IntegratorSettings, heuristic: Heuristic, chains: MetropolisSettings) -> Self {
        Self {
            bidirectional: Bidirectional::new(world, settings, heuristic),
            settings,
            chains,
            sharing: None,
            halves: [None, None],
        }
    }

    /// What the path of a state brings, over the probability of its length and way.
    fn evaluate(&self, frame: &Frame, sharing: &Sharing, [camera, lamp, rest]: &[Proposal; 3], counts: &mut RayCounts) -> Found {
        let connector = self.bidirectional.connector();
        let mut rest = Sampler::of_chain(rest.clone());
        let (edges, of_lamp, probability) = sharing.chances.pick(f64::from(rest.next_1d()));
        let mut found = Found::default();
        let add = |found: &mut Found, film_point: Vec2, layer: Quantity, light: Rgb| {
            let light = if light.is_finite() { light } else { Rgb::BLACK };
            if let Some(Left { share, wanted, .. }) = sharing.of(film_point, (edges, of_lamp), light)
                && !light.is_black()
            {
                found.wanted += wanted;
                found.light.push((film_point, layer, light * (share / probability)));
            }
        };

        // Vertices of the lamp's walk that are wanted: the last of them, more than one where a plate lies before it.
        let mut lit: Vec<Vertex> = Vec::new();
        if of_lamp >= 2 {
            let mut sampler = Sampler::of_chain(lamp.clone());
            connector.light_walk_of(of_lamp - 1, &mut sampler, counts, |vertex, _, _| {
                if vertex.edges == of_lamp - 1 {
                    lit.push(*vertex);
                }
            });
            if lit.is_empty() {
                return found;
            }
        }
        if of_lamp == edges {
            for y in &lit {
                if let Some((sighting, light)) = connector.seen(y, counts) {
                    let layer = layer_of(y.scattered + 1, y.began_ideal);
                    add(&mut found, sighting.film_point, layer, light / connector.light_walks);
                }
            }
            return found;
        }
        let mut sampler = Sampler::of_chain(camera.clone());
        let [left, top, width, height] = frame.crop.map(|v| v as f32);
        let place = sampler.next_2d();
        let film_point = Vec2::new(left + place.x * width, top + place.y * height);
        let film_point = film_point.min(Vec2::new((left + width).next_down(), (top + height).next_down()));
        let ray = connector.world.scene().camera.ray(film_point, frame.width, frame.height);
        let walk = Walk { world: connector.world, heuristic: connector.heuristic, carried: Carried::Radiance };
        let wanted = edges - of_lamp;
        let start = connector.camera_start(ray);
        let mut uncounted = RayCounts::default();
        walk.go(
            start,
            wanted,
            &mut sampler,
            &mut uncounted,
            |_, _| {},
            |met, _, _| {
                let mut add = |layer, light: Rgb| add(&mut found, film_point, layer, light);
                match met {
                    Met::Outside(direction, edge) => {
                        if of_lamp == 0 && edge.edges == wanted {
                            let found = connector.met(direction, None, edge);
                            add(layer_of(edge.scattered, edge.by_ideal), edge.before * found.light);
                        }
                    }
                    Met::Surface(vertex, shading, edge) => {
                        if vertex.edges != wanted {
                            return;
                        }
                        if of_lamp == 0 {
                            let found = connector.met(-vertex.si.wo, Some(&vertex.si), edge);
                            add(layer_of(edge.scattered, edge.by_ideal), edge.before * found.light);
                        } else if shading.has_diffuse() || shading.has_glossy() {
                            if of_lamp == 1 {
                                let layer = layer_of(vertex.scattered + 1, false);
                                connector.direct(vertex, shading, &mut rest, counts, |found| {
                                    add(layer, vertex.before * found.light);
                                });
                            }
                            for y in &lit {
                                let layer = layer_of(vertex.scattered + y.scattered + 2, false);
                                add(layer, vertex.before * connector.connect(vertex, y, counts).light);
                            }
                        }
                    }
                }
            },
        );
        counts.reflected += uncounted.reflected;
        counts.transmitted += uncounted.transmitted;
        found
    }

    /// Chains that start at some of many independent states; none if those bring nothing.
    fn begin(&self, frame: &Frame, sharing: &Sharing, seed: u64, counts: &mut RayCounts) -> Vec<State> {
        let one = |i: u64| {
            let mut counts = RayCounts::default();
            (self.evaluate(frame, sharing, &independent(seed, i), &mut counts).wanted, counts)
        };
        let drawn: Vec<(f64, RayCounts)> = (0..STARTS).into_par_iter().map(one).collect();
        let mut total = 0.0;
        let running: Vec<f64> = drawn
            .iter()
            .map(|(wanted, c)| {
                *counts += *c;
                total += wanted;
                total
            })
            .collect();
        if total <= 0.0 {
            return Vec::new();
        }
        let shift = f64::from(Sampler::new(seed, 1, 0).next_1d());
        let start = |k: u32| {
            let target = (f64::from(k) + shift) / f64::from(self.chains.chains) * total;
            let numbers = independent(seed, (running.partition_point(|&r| r <= target) as u64).min(STARTS - 1));
            let Found { light, wanted } = self.evaluate(frame, sharing, &numbers, &mut RayCounts::default());
            State { numbers: [0, 1, 2].map(|i| numbers[i].accepted()), light, wanted }
        };
        (0..self.chains.chains).map(start).collect()
    }

    /// Steps of one chain: the film's light over the mean brightness is added by expectation, both for what is proposed and for what is
    /// left ([Kelemen02], section 4).
    fn run(&self, frame: &Frame, state: &mut State, stretch: &Stretch<'_>, splats: &mut Splats<'_>, counts: &mut RayCounts) {
        let large = self.chains.large_steps;
        let mut add = |light: &[Light], wanted: f64, weight: f64| {
            if weight > 0.0 && wanted > 0.0 {
                let scale = weight / (wanted / stretch.mean + large);
                light.iter().for_each(|(point, layer, radiance)| splats.add(*point, *layer, *radiance * scale));
            }
        };
        // What the present state has gathered since it was accepted.
        let mut waiting = 0.0;
        for step in stretch.steps.clone() {
            let seed = mix(stretch.seed ^ mix(step));
            let mut decide = Sampler::of(crate::math::SamplerKind::Independent, seed, 0, 0);
            let kind = f64::from(decide.next_1d());
            let is_large = kind < large;
            let change = match kind - large {
                ..0.0 => [Change::Large; 3],
                ..CAMERA_STEPS => [Change::Large, Change::Small, Change::Small],
                ..CAMERA_AND_LAMP_STEPS => [Change::Small, Change::Large, Change::Small],
                _ => [Change::Small; 3],
            };
            let proposal = streams(&state.numbers, change, seed);
            let Found { light, wanted: proposed } = self.evaluate(frame, stretch.sharing, &proposal, counts);
            let accept = if state.wanted > 0.0 { (proposed / state.wanted).min(1.0) } else { 1.0 };
            waiting += 1.0 - accept;
            let gathers = accept + if is_large { 1.0 } else { 0.0 };
            if f64::from(decide.next_1d()) < accept {
                add(&state.light, state.wanted, waiting);
                waiting = gathers;
                state.numbers = [0, 1, 2].map(|i| proposal[i].accepted());
                (state.light, state.wanted) = (light, proposed);
            } else {
                add(&light, proposed, gathers);
            }
        }
        add(&state.light, state.wanted, waiting);
    }
}

impl Integrator for Metropolis<'_> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        self.bidirectional.set_frame(frame);
        let limit = self.bidirectional.connector().limit;
        if limit < SHORTEST || self.bidirectional.connector().departures.is_none() {
            return self.bidirectional.pass(frame, index);
        }
        let Some(sharing) = self.sharing.take() else {
            let PassFound { samples, counts, ways, .. } = self.bidirectional.find(frame, index, Use::Measure);
            self.sharing = Sharing::new(frame, &samples, &ways.unwrap_or_default(), (limit, self.chains.even));
            return (samples, counts);
        };
        let number = (index % 2) as usize;
        let seed = mix(self.settings.seed ^ mix(0x3e7a + number as u64));
        let mut started = RayCounts::default();
        let half = self.halves[number].take().or_else(|| {
            let chains = self.begin(frame, &sharing, mix(seed ^ u64::from(index)), &mut started);
            (!chains.is_empty()).then_some(Half { chains, wanted: 0.0, samples: 0, steps: 0 })
        });
        let used = if half.is_some() { Use::Share(&sharing) } else { Use::Keep };
        let PassFound { mut samples, mut counts, left, .. } = self.bidirectional.find(frame, index, used);
        counts += started;
        self.halves[number] = half.map(|mut half| {
            half.wanted += left;
            half.samples += samples.len() as u64;
            let mean = half.wanted / half.samples as f64;
            let per_chain = (self.chains.steps * samples.len() as f64 / half.chains.len() as f64).ceil() as u64;
            let steps = half.steps..half.steps + per_chain;
            half.steps = steps.end;
            let n_steps = per_chain * half.chains.len() as u64;
            let run = |(k, state): (usize, &mut State)| {
                let (mut splats, mut counts) = (Splats::new(frame), RayCounts::default());
                let stretch = Stretch { sharing: &sharing, mean, seed: mix(seed ^ mix(k as u64)), steps: steps.clone() };
                self.run(frame, state, &stretch, &mut splats, &mut counts);
                (splats, counts)
            };
            let ran: Vec<(Splats<'_>, RayCounts)> =
                if mean > 0.0 { half.chains.par_iter_mut().enumerate().map(run).collect() } else { Vec::new() };
            let scale = samples.len() as f64 / n_steps as f64;
            for (splats, c) in ran {
                splats.add_to(&mut samples, scale);
                counts += c;
            }
            half
        });
        self.sharing = Some(sharing);
        (samples, counts)
    }

    fn state(&self) -> Vec<u8> {
        encode_state(&(REVISION, &self.sharing, &self.halves, self.bidirectional.known()))
    }

    fn take_up(&mut self, state: &[u8]) -> bool {
        let Ok((revision, sharing, halves, known)) =
            postcard::from_bytes::<(u32, Option<Sharing>, [Option<Half>; 2], Known)>(state)
        else {
            return false;
        };
        if revision != REVISION {
            return false;
        }
        (self.sharing, self.halves) = (sharing, halves);
        self.bidirectional.take_up_known(known)
    }
}
