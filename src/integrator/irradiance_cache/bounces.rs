//! Caches for light that is gathered more than once: where gather rays end, instead of where the camera looks.

use super::IrradianceCache;
use super::gather::GatherSettings;
use crate::integrator::{Frame, TwoPass};
use crate::math::{Frame as Axes, Rgb, Sampler, Vec2, Vec3, sampler::mix, warp};
use crate::world::walk::RayCounts;
use crate::world::{SurfaceInteraction, World};
use rayon::prelude::*;

/// One of so many columns and rows of pixels starts a walk that looks for places.
const STRIDE: usize = 4;
/// Surfaces of such a walk.
const SURFACES: usize = 3;
/// Events of such a walk, mirrors and glass included.
const EVENTS: usize = 8;
/// Places of the first batch; each batch has twice those of the one before, and fills what the ones before left.
const FIRST_BATCH: usize = 32;

/// What gather rays read of a surface where there is no pass one: shadow rays light it there and then, and caches of the bounces before
/// tell the rest. Where no record reaches, a single ray looks: a constant, as Radiance takes, would be that of where the camera looks.
#[derive(Debug, Clone, Copy)]
pub struct Below<'a> {
    /// Irradiance by light that was reflected before: where rays of this bounce end, where those of the one before end, and so on.
    pub caches: &'a [IrradianceCache],
    /// True if light of more bounces than there are caches is followed by single rays; else there is none.
    pub endless: bool,
}

impl Below<'_> {
    /// Irradiance at a hit about a normal [W/m²]; `None` where no record of this bounce reaches.
    pub(in crate::integrator) fn irradiance(&self, si: &SurfaceInteraction, normal: Vec3) -> Option<Rgb> {
        let found = self.caches.first()?.read(si.point, normal, si.shape)?;
        Some(found.reflected + found.emitted)
    }

    /// What is below this bounce; `None` below the last.
    pub(in crate::integrator) fn next(&self) -> Option<Self> {
        match self.caches {
            [] => self.endless.then_some(*self),
            [_, rest @ ..] => Some(Self { caches: rest, ..*self }),
        }
    }
}

/// How the cache of a bounce is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BounceSettings {
    /// Rays of a record, about.
    pub rays: u32,
    /// As that of [`super::FillSettings`].
    pub accuracy: f32,
    /// Closest and farthest records over the scene's diagonal.
    pub reach: [f32; 2],
    /// Seed.
    pub seed: u64,
}

impl TwoPass<'_> {
    /// A cache for what the gather rays of this frame's surfaces meet.
    pub fn fill_bounce(&self, frame: &Frame, settings: &BounceSettings, counts: &mut RayCounts) -> IrradianceCache {
        let mut cache = IrradianceCache::default();
        let gather =
            GatherSettings { rays: settings.rays, accuracy: settings.accuracy, by_nearest: true, seed: mix(settings.seed) };
        let reach = settings.reach.map(|r| r * self.world.bounds().diagonal());
        let places = places(self.world, frame, settings.seed);
        let (mut done, mut batch) = (0, FIRST_BATCH);
        while done < places.len() {
            let end = (done + batch).min(places.len());
            let normal = |si: &SurfaceInteraction| self.world.shading(si).normal();
            let gaps: Vec<&SurfaceInteraction> =
                places[done..end].iter().filter(|si| !cache.covers(si.point, normal(si), si.shape)).collect();
            let made: Vec<_> = gaps
                .par_iter()
                .enumerate()
                .map(|(i, si)| {
                    let mut counts = RayCounts::default();
                    (self.gather_record(si, (done + i) as u64, &gather, reach, &mut counts), counts)
                })
                .collect();
            for (record, c) in made {
                *counts += c;
                cache.insert(record);
            }
            (done, batch) = (end, 2 * batch);
        }
        cache
    }
}

/// Diffuse surfaces on walks from the camera that go on as gather rays do; neighbours in the list lie far apart.
fn places(world: &World, frame: &Frame, seed: u64) -> Vec<SurfaceInteraction> {
    let columns = frame.crop[2].div_ceil(STRIDE);
    let n = columns * frame.crop[3].div_ceil(STRIDE);
    // A step coprime to the number visits all, in an order that jumps about.
    let step = (0..).map(|k| (n as f64 * 0.618) as usize + k).find(|s| *s > 0 && gcd(*s, n) == 1).unwrap_or(1);
    let walk = |i: usize| {
        let k = i * step % n;
        let x = frame.crop[0] + (k % columns) * STRIDE;
        let y = frame.crop[1] + (k / columns) * STRIDE;
        let mut sampler = Sampler::new(mix(seed ^ 0xb0_7ce5), (y * frame.width + x) as u64, 0);
        let point = Vec2::new(x as f32, y as f32) + sampler.next_2d();
        let mut ray = world.scene().camera.ray(point, frame.width, frame.height);
        let mut found = Vec::new();
        for _ in 0..EVENTS {
            let Some(si) = world.intersect(&ray) else { break };
            let shading = world.shading(&si);
            let (u, choice) = (sampler.next_2d(), sampler.next_1d());
            let direction = if shading.has_diffuse() {
                found.push(si);
                Axes::new(shading.normal()).to_world(warp::cosine_hemisphere(u))
            } else {
                match shading.sample(u, choice) {
                    Some(next) => next.direction,
                    None => break,
                }
            };
            if found.len() >= SURFACES {
                break;
            }
            ray = si.spawn(direction);
        }
        found
    };
    let walks: Vec<Vec<SurfaceInteraction>> = (0..n).into_par_iter().map(walk).collect();
    // What the camera sees is also what gather rays of its neighbours meet.
    walks.into_iter().flatten().collect()
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}
