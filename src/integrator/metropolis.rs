//! Metropolis light transport over random numbers [Kelemen02], each state of a chain one path made in one way of the bidirectional
//! sampler [Hachisuka14].
//!
//! A state is three streams of numbers: for the walk from the camera, for the walk from a lamp, and for the length of the path, the way
//! to make it and its shadow ray. What a path of n edges brings is weighted against all other ways to make it, and divided by the
//! probability of its length and way. Paths of one and two edges, lamps seen at once and direct light, are no part of it: camera rays and
//! shadow rays of each pixel find them with less noise.
//!
//! Start-up: many independent states are drawn first; chains start at some of them, chosen by what they bring, so that each chain's first
//! state has the right distribution in the mean of all runs ([Veach97], section 11.3.1). The mean of the picture comes from these and
//! from all large steps since. The number of chains is fixed, so threads change nothing.

use super::bidirectional::subpath::{Carried, Met, Vertex, Walk};
use super::bidirectional::{Connector, Heuristic, layer_of};
use super::splat::Splats;
use super::{Frame, Integrator, IntegratorSettings, each_pixel, encode_state};
use crate::film::{PixelSample, Quantity};
use crate::math::{Change, Proposal, Rgb, Sampler, Vec2, sampler::mix};
use crate::world::World;
use crate::world::walk::RayCounts;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Numbers of each stream that small steps move; those beyond are always new. A vertex takes three or four.
const NUMBERS: usize = 32;
/// Edges of the shortest paths that chains make.
const SHORTEST: u32 = 3;
/// Ratio of the probabilities of path lengths that follow each other.
const LENGTH_RATIO: f64 = 0.7;
/// Probability of a step that draws the walk from the camera anew and moves the rest a little: what a lamp's walk lights is seen from
/// elsewhere.
const CAMERA_STEPS: f64 = 0.2;
/// The same, or the walk from the lamp is drawn anew.
const CAMERA_AND_LAMP_STEPS: f64 = 0.3;
/// Fewest states that a chain's start is chosen from.
const LEAST_STARTS: usize = 1 << 14;

/// How chains run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MetropolisSettings {
    /// Chains of each half of the film.
    pub chains: u32,
    /// Probability of a large step, in (0, 1].
    pub large_steps: f64,
}

impl Default for MetropolisSettings {
    /// 64 chains keep 64 threads busy. In door-ajar one large step of ten left half the error of three of ten in the same time.
    fn default() -> Self {
        Self { chains: 64, large_steps: 0.1 }
    }
}

/// Where light falls on the film: place, layer, and what an average pixel gets of it.
type Light = (Vec2, Quantity, Rgb);

/// Where a chain is.
#[derive(Clone, Serialize, Deserialize)]
#[serde(from = "KeptState", into = "KeptState")]
struct State {
    numbers: [Arc<[f32]>; 3],
    light: Vec<Light>,
    /// Sum of luminances.
    brightness: f64,
}

/// A state as a file keeps it: its numbers, light and brightness.
#[derive(Serialize, Deserialize)]
struct KeptState([Vec<f32>; 3], Vec<Light>, f64);

impl From<KeptState> for State {
    fn from(KeptState(numbers, light, brightness): KeptState) -> Self {
        State { numbers: numbers.map(Arc::from), light, brightness }
    }
}

impl From<State> for KeptState {
    fn from(state: State) -> Self {
        KeptState(state.numbers.map(|n| n.to_vec()), state.light, state.brightness)
    }
}

/// Chains of one half of the film.
#[derive(Serialize, Deserialize)]
struct Half {
    chains: Vec<State>,
    /// Brightness summed over independent states, and their number.
    brightness: f64,
    states: u64,
    steps: u64,
}

/// Chains of paths.
pub struct Metropolis<'a> {
    connector: Connector<'a>,
    settings: IntegratorSettings,
    chains: MetropolisSettings,
    halves: [Option<Half>; 2],
}

/// What a chain does in one pass.
struct Stretch {
    /// Mean brightness of independent states, as known so far.
    mean: f64,
    seed: u64,
    steps: std::ops::Range<u64>,
}

/// The three streams of a step.
fn streams(numbers: &[Arc<[f32]>; 3], change: [Change; 3], seed: u64) -> [Proposal; 3] {
    [0, 1, 2].map(|i| Proposal { present: Arc::clone(&numbers[i]), change: change[i], seed: mix(seed ^ mix(i as u64 + 1)) })
}

impl<'a> Metropolis<'a> {
    /// On a scene.
    pub fn new(world: &'a World, settings: IntegratorSettings, heuristic: Heuristic, chains: MetropolisSettings) -> Self {
        Self { connector: Connector::new(world, settings.max_depth, heuristic), settings, chains, halves: [None, None] }
    }

    /// Edges of a path, and their probability.
    fn length(&self, u: f64) -> (u32, f64) {
        // Geometric, cut at the limit.
        let most = f64::from(self.connector.limit - SHORTEST + 1);
        let whole = 1.0 - LENGTH_RATIO.powf(most);
        let k = ((1.0 - u * whole).ln() / LENGTH_RATIO.ln()).floor().clamp(0.0, most - 1.0);
        (k as u32 + SHORTEST, (1.0 - LENGTH_RATIO) * LENGTH_RATIO.powf(k) / whole)
    }

    /// What the path of a state brings, over the probability of its length and way.
    fn evaluate(&self, frame: &Frame, [camera, lamp, rest]: &[Proposal; 3], counts: &mut RayCounts) -> Vec<Light> {
        let connector = &self.connector;
        let mut rest = Sampler::of_chain(rest.clone());
        let (edges, probability) = self.length(f64::from(rest.next_1d()));
        let ways = edges + 1;
        let of_lamp = ((f64::from(rest.next_1d()) * f64::from(ways)) as u32).min(edges);
        let scale = f64::from(ways) / probability;
        let mut found: Vec<Light> = Vec::new();

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
                    found.push((sighting.film_point, layer_of(y.scattered + 1, y.began_ideal), light * scale));
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
        // A uniform point of the film stands for one pixel of many.
        let scale = scale * connector.light_walks;
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
                let mut add = |layer, light: Rgb| {
                    if !light.is_black() && light.is_finite() {
                        found.push((film_point, layer, light * scale));
                    }
                };
                match met {
                    Met::Outside(direction, edge) => {
                        if of_lamp == 0 && edge.edges == wanted {
                            add(layer_of(edge.scattered, edge.by_ideal), connector.met(direction, None, edge));
                        }
                    }
                    Met::Surface(vertex, shading, edge) => {
                        if vertex.edges != wanted {
                            return;
                        }
                        if of_lamp == 0 {
                            add(layer_of(edge.scattered, edge.by_ideal), connector.met(-vertex.si.wo, Some(&vertex.si), edge));
                        } else if shading.has_diffuse() || shading.has_glossy() {
                            if of_lamp == 1 {
                                let light = connector.direct(vertex, shading, &mut rest, counts);
                                add(layer_of(vertex.scattered + 1, false), light);
                            }
                            for y in &lit {
                                let layer = layer_of(vertex.scattered + y.scattered + 2, false);
                                add(layer, connector.connect(vertex, y, counts));
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

    /// Draws independent states, and starts chains at some of them.
    fn begin(&self, frame: &Frame, half: usize, counts: &mut RayCounts) -> Half {
        let n = frame.n_pixels().max(LEAST_STARTS);
        let seed = mix(self.settings.seed ^ mix(0x3e70 + half as u64));
        let none: [Arc<[f32]>; 3] = [0; 3].map(|_| Arc::from([0.0; NUMBERS]));
        let draw = |i: usize| streams(&none, [Change::Large; 3], mix(seed ^ mix(i as u64)));
        let drawn: Vec<(f64, RayCounts)> = (0..n)
            .into_par_iter()
            .map(|i| {
                let mut counts = RayCounts::default();
                (brightness(&self.evaluate(frame, &draw(i), &mut counts)), counts)
            })
            .collect();
        let mut total = 0.0;
        let running: Vec<f64> = drawn
            .iter()
            .map(|(brightness, c)| {
                *counts += *c;
                total += brightness;
                total
            })
            .collect();
        let shift = f64::from(Sampler::new(seed, 1, 0).next_1d());
        let chains = (0..if total > 0.0 { self.chains.chains } else { 0 }).map(|k| {
            let target = (f64::from(k) + shift) / f64::from(self.chains.chains) * total;
            let numbers = draw(running.partition_point(|&r| r <= target).min(n - 1));
            let light = self.evaluate(frame, &numbers, &mut RayCounts::default());
            let brightness = brightness(&light);
            State { numbers: [0, 1, 2].map(|i| numbers[i].accepted()), light, brightness }
        });
        Half { chains: chains.collect(), brightness: total, states: n as u64, steps: 0 }
    }

    /// Steps of one chain: the film's light over the mean brightness is added by expectation, both for what is proposed and for what is
    /// left ([Kelemen02], section 4). Brightness of the large steps, and their number.
    fn run(
        &self,
        frame: &Frame,
        state: &mut State,
        stretch: &Stretch,
        splats: &mut Splats<'_>,
        counts: &mut RayCounts,
    ) -> (f64, u64) {
        let large = self.chains.large_steps;
        let mut add = |light: &[Light], brightness: f64, weight: f64| {
            if weight > 0.0 && brightness > 0.0 {
                let scale = weight / (brightness / stretch.mean + large);
                light.iter().for_each(|(point, layer, radiance)| splats.add(*point, *layer, *radiance * scale));
            }
        };
        let (mut sum, mut n) = (0.0, 0);
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
            let light = self.evaluate(frame, &proposal, counts);
            let proposed = brightness(&light);
            if is_large {
                sum += proposed;
                n += 1;
            }
            let accept = if state.brightness > 0.0 { (proposed / state.brightness).min(1.0) } else { 1.0 };
            waiting += 1.0 - accept;
            let gathers = accept + if is_large { 1.0 } else { 0.0 };
            if f64::from(decide.next_1d()) < accept {
                add(&state.light, state.brightness, waiting);
                waiting = gathers;
                state.numbers = [0, 1, 2].map(|i| proposal[i].accepted());
                (state.light, state.brightness) = (light, proposed);
            } else {
                add(&light, proposed, gathers);
            }
        }
        add(&state.light, state.brightness, waiting);
        (sum, n)
    }
}

/// Sum of luminances.
fn brightness(light: &[Light]) -> f64 {
    light.iter().map(|(_, _, radiance)| radiance.luminance()).sum()
}

impl Integrator for Metropolis<'_> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        self.connector.set_frame(frame);
        let number = (index % 2) as usize;
        let mut counts = RayCounts::default();
        let limit = self.connector.limit;
        let connector = &self.connector;
        // Short paths, and what the layers say of the first surface.
        let (mut samples, c) = each_pixel(connector.world, &self.settings, frame, index, |start, counts| {
            let mut sampler = start.sampler;
            connector.short_paths(start.ray, SHORTEST - 1, &mut sampler, counts)
        });
        counts += c;
        if limit < SHORTEST || connector.departures.is_none() {
            return (samples, counts);
        }
        let mut half = match self.halves[number].take() {
            Some(half) => half,
            None => self.begin(frame, number, &mut counts),
        };
        let mean = half.brightness / half.states as f64;
        if mean > 0.0 {
            let per_chain = (frame.n_pixels() as u64).div_ceil(half.chains.len() as u64);
            let steps = half.steps..half.steps + per_chain;
            let seed = mix(self.settings.seed ^ mix(0x3e7a + number as u64));
            let ran: Vec<(Splats<'_>, RayCounts, (f64, u64))> = half
                .chains
                .par_iter_mut()
                .enumerate()
                .map(|(k, state)| {
                    let (mut splats, mut counts) = (Splats::new(frame), RayCounts::default());
                    let stretch = Stretch { mean, seed: mix(seed ^ mix(k as u64)), steps: steps.clone() };
                    let large = self.run(frame, state, &stretch, &mut splats, &mut counts);
                    (splats, counts, large)
                })
                .collect();
            half.steps = steps.end;
            let scale = 1.0 / (per_chain * half.chains.len() as u64) as f64;
            for (splats, c, (sum, n)) in ran {
                splats.add_to(&mut samples, scale);
                counts += c;
                half.brightness += sum;
                half.states += n;
            }
        }
        self.halves[number] = Some(half);
        (samples, counts)
    }

    fn state(&self) -> Vec<u8> {
        encode_state(&self.halves)
    }

    fn take_up(&mut self, state: &[u8]) -> bool {
        postcard::from_bytes(state).map(|halves| self.halves = halves).is_ok()
    }
}
