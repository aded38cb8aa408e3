//! Form factors by casting cosine-distributed rays from each patch [Malley88]: the share of rays that arrive.
//!
//! Rays that meet a mirror or glass go on through it, so that pass one knows the light that comes that way (extended form factors,
//! [Sillion89]). A row closes exactly, whatever the number of rays; the error shows in reciprocity.

use super::matrix::{FormFactorMatrix, Row};
use super::outside::{Outside, OutsideRow, Walked, Walks};
use super::ray_pairs::Met;
use crate::math::sampler::Series;
use crate::math::{Frame, Rgb, warp};
use crate::patch::{PatchId, PatchMesh};
use crate::progress::{Observer, Progress, Stage};
use crate::world::sight::{Origin, cosine_density};
use crate::world::stages::ByStages;
use crate::world::walk::{Event, RayCounts};
use crate::world::{DirectSampling, Sight, Stages, World};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// Rows computed between two looks at the observer.
const BATCH: usize = 1024;

/// What a ray meets within this share of the width of its patch is near by: half of it loses no less light in furnished rooms than all of it, and
/// counts what stands in the middle of a room less often.
const NEAR: f32 = 0.5;

/// How many rays, and how far they go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayCastSettings {
    /// Rays of a patch of the full patch size; smaller ones cast fewer, in proportion to their area, but no less than an eighth.
    pub rays: u32,
    /// Longest chain of specular events; 0: classic form factors, which carry light between diffuse surfaces alone.
    pub max_events: u32,
    /// Number of these rays for each shadow ray that a patch sends: light that both find is shared in proportion.
    pub rays_beside_shadow_rays: f64,
    /// True: two rays start at each point, and what they met is kept.
    pub in_pairs: bool,
    /// Seed of the rays.
    pub seed: u64,
}

impl RayCastSettings {
    /// As many rays as keep the standard error of any form factor below `tolerance`: sqrt(F(1-F)/n) <= 1/(2 sqrt n), rounded up to a
    /// power of two for the sake of stratification. `shadow_rays`: those that a patch of the full size sends.
    pub fn for_tolerance(tolerance: f64, shadow_rays: f64, seed: u64) -> Self {
        let rays = (0.25 / (tolerance * tolerance)).ceil().clamp(16.0, 65536.0) as u32;
        let rays = rays.next_power_of_two();
        Self { rays, max_events: 64, rays_beside_shadow_rays: f64::from(rays) / shadow_rays, in_pairs: false, seed }
    }

    /// Rays of patch `i`, by its share.
    pub fn rays_of(&self, patches: &PatchMesh, i: usize) -> u32 {
        let share = (patches.area[i] / (patches.patch_size * patches.patch_size)).clamp(patches.least_share(), 1.0);
        ((f64::from(self.rays) * share) as u32).next_power_of_two()
    }
}

/// Casts all rows; `None` if the observer stopped it. Patches that reflect nothing get rows as well: they are looked at, too.
pub fn cast(
    world: &World,
    patches: &PatchMesh,
    settings: &RayCastSettings,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Option<(FormFactorMatrix, Outside)> {
    let n = patches.len();
    let mut rows = Vec::with_capacity(n);
    let mut outside = Outside::default();
    while rows.len() < n {
        let batch = rows.len()..n.min(rows.len() + BATCH);
        for (row, beside, row_counts) in world.needs().choose(CastRows { world, patches, settings, batch }) {
            rows.push(row);
            outside.push(beside);
            *counts += row_counts;
        }
        let progress = Progress { stage: Stage::FormFactors, done: rows.len() as f64, total: n as f64 };
        if let ControlFlow::Break(()) = observer(&progress) {
            return None;
        }
    }
    let mut matrix = FormFactorMatrix::from_rows(rows);
    // Rows that cannot count are as good as they are.
    let counting = || (0..n).filter(|i| !patches.is_idle(*i));
    let sums = counting()
        .map(|i| matrix.direct_sum(i) + matrix.specular(i).map(|(_, f)| f.max()).sum::<f64>() + outside.escaped(i).max());
    let (low, high) = sums.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| (l.min(s), h.max(s)));
    if counting().next().is_some() {
        (matrix.closure.row_sum_min, matrix.closure.row_sum_max) = (low, high);
        matrix.closure.escaped_max = counting().map(|i| outside.escaped(i).max()).fold(0.0, f64::max);
    }
    let rays: Vec<f64> = (0..n).map(|i| f64::from(settings.rays_of(patches, i))).collect();
    matrix.symmetrise(&patches.area, &rays, |i| patches.is_idle(i));
    Some((matrix, outside))
}

/// The rays of some rows.
struct CastRows<'a> {
    world: &'a World,
    patches: &'a PatchMesh,
    settings: &'a RayCastSettings,
    batch: std::ops::Range<usize>,
}

impl ByStages for CastRows<'_> {
    type Output = Vec<(Row, OutsideRow, RayCounts)>;

    fn run<K: Stages>(self) -> Self::Output {
        let Self { world, patches, settings, batch } = self;
        let row = |i: usize| {
            if !patches.is_idle(i) {
                return cast_row::<K>(world, patches, PatchId(i as u32), settings);
            }
            if world.leaves_idle() {
                return Default::default();
            }
            let (row, outside, mut counts) = cast_row::<K>(world, patches, PatchId(i as u32), settings);
            counts.idle += counts.form_factor;
            (row, outside, counts)
        };
        batch.into_par_iter().map(row).collect()
    }
}

/// The row of one patch.
fn cast_row<K: Stages>(
    world: &World,
    patches: &PatchMesh,
    id: PatchId,
    settings: &RayCastSettings,
) -> (Row, OutsideRow, RayCounts) {
    let mut counts = RayCounts::default();
    let mut direct: Vec<u32> = Vec::new();
    let mut specular: Vec<(u32, Rgb)> = Vec::new();
    let mut walks = Walks::default();
    let rays = settings.rays_of(patches, id.0 as usize);
    let series = Series::new(settings.seed, u64::from(id.0));
    let near = NEAR * patches.area[id.0 as usize].sqrt() as f32;
    let mut pairs = Vec::new();
    for k in 0..rays {
        // The second of a pair has the point of the first, and a direction of its own.
        let (index, is_second) = if settings.in_pairs { (k / 2, k % 2 == 1) } else { (k, false) };
        let mut sampler = series.sampler(u64::from(index));
        let from = patches.sample_by::<K>(world, id, sampler.next_2d());
        if is_second {
            sampler.next_2d();
        }
        let direction = Frame::new(from.ng).to_world(warp::cosine_hemisphere(sampler.next_2d()));
        let mut met_directly = Met::NONE;
        counts.form_factor += 1;
        if K::PLAIN {
            match world.meet_flat::<K>(&from.spawn(direction)) {
                Some(met) => {
                    if let Some(j) = patches.patch_on_flat(met.primitive, met.place, met.front) {
                        direct.push(j.0);
                        met_directly = Met::new(j.0, met.t < near);
                    }
                }
                None => walks.escape(&Walked::default(), Rgb::WHITE),
            }
            note_in_pairs(&mut pairs, (settings.in_pairs, is_second), met_directly);
            continue;
        }
        // Densities are per shadow ray, so that the shares do not depend on how many of either kind there are.
        let density = cosine_density(settings.rays_beside_shadow_rays, direction.dot(from.ng));
        let sampling = DirectSampling::OF_PATCHES;
        let sight = Sight::Gather(Origin { point: from.point, receiver: Some(from.ng), density, sampling });
        let mut walk = Walked::default();
        world.follow_by::<K>(from.spawn(direction), sight, &mut sampler, settings.max_events, &mut counts, |event| match event {
            Event::Surface { at, throughput, through, emission_share, .. } => {
                // What is seen directly is known exactly by the form factor.
                if through > 0 && at.front {
                    walk.find(throughput * world.scene().shapes[at.shape as usize].emitted(at.uv) * emission_share);
                }
                if let Some(j) = patches.patch_at(at) {
                    if through == 0 {
                        direct.push(j.0);
                        met_directly = Met::new(j.0, at.t < near);
                    } else {
                        specular.push((j.0, throughput));
                        walks.arrive(&walk, throughput);
                    }
                    walk.meet_patch();
                }
            }
            // Gloss is an event like any other, though its light comes by a shadow ray.
            Event::Lit { radiance, .. } if settings.max_events > 0 => walk.find(radiance),
            Event::Lit { .. } => {}
            Event::Escaped { direction, throughput, share, .. } => {
                walks.escape(&walk, throughput);
                if K::DISTANT {
                    walk.find(throughput * world.scene().escaped_radiance(direction) * share);
                }
            }
            Event::Truncated { throughput } => walks.truncate(&walk, throughput),
        });
        walks.add_light(&walk, || world.shading(&from).acceptance(direction));
        note_in_pairs(&mut pairs, (settings.in_pairs, is_second), met_directly);
    }
    let share = 1.0 / f64::from(rays);
    direct.sort_unstable();
    specular.sort_by_key(|e| e.0);
    let row = Row {
        direct: direct.chunk_by(|a, b| a == b).map(|same| (same[0], (same.len() as f64 * share) as f32)).collect(),
        specular: specular
            .chunk_by(|a, b| a.0 == b.0)
            .map(|same| (same[0].0, (same.iter().map(|e| e.1).sum::<Rgb>() * share).to_array().map(|v| v as f32)))
            .collect(),
        pairs,
    };
    (row, walks.row(rays), counts)
}

/// Adds what a ray met to the pair that it belongs to, if pairs are kept.
#[inline]
fn note_in_pairs(pairs: &mut Vec<[Met; 2]>, (in_pairs, is_second): (bool, bool), met: Met) {
    match pairs.last_mut() {
        _ if !in_pairs => {}
        Some(pair) if is_second => pair[1] = met,
        _ => pairs.push([met, Met::NONE]),
    }
}
