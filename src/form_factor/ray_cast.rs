//! Form factors by casting cosine-distributed rays from each patch [Malley88]: the share of rays that arrive.
//!
//! Rays that meet a mirror or glass go on through it, so that pass one knows the light that comes that way (extended form factors,
//! [Sillion89]). A row closes exactly, whatever the number of rays; the error shows in reciprocity.

use super::matrix::{FormFactorMatrix, REFLECTED_ONLY, Row};
use crate::math::{Frame, Rgb, Sampler, warp};
use crate::patch::{PatchId, PatchMesh};
use crate::progress::{Observer, Progress, Stage};
use crate::world::World;
use crate::world::walk::{Event, RayCounts};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// Rows computed between two looks at the observer.
const BATCH: usize = 1024;

/// How many rays, and how far they go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayCastSettings {
    /// Rays of a patch of the full patch size; smaller ones cast fewer, in proportion to their area, but no less than an eighth.
    pub rays: u32,
    /// Longest chain of specular events.
    pub max_events: u32,
    /// Seed of the rays.
    pub seed: u64,
}

impl RayCastSettings {
    /// As many rays as keep the standard error of any form factor below `tolerance`: sqrt(F(1-F)/n) <= 1/(2 sqrt n), rounded up to a
    /// power of two for the sake of stratification.
    pub fn for_tolerance(tolerance: f64, seed: u64) -> Self {
        let rays = (0.25 / (tolerance * tolerance)).ceil().clamp(16.0, 65536.0) as u32;
        Self { rays: rays.next_power_of_two(), max_events: 64, seed }
    }

    /// Rays of patch `i`. What a small patch sends and blocks counts by its area, and so does the error that its rays leave.
    fn rays_of(&self, patches: &PatchMesh, i: usize) -> u32 {
        let share = (patches.area[i] / (patches.patch_size * patches.patch_size)).clamp(0.125, 1.0);
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
) -> Option<FormFactorMatrix> {
    let n = patches.len();
    let mut rows = Vec::with_capacity(n);
    while rows.len() < n {
        let batch = rows.len()..n.min(rows.len() + BATCH);
        let cast: Vec<(Row, RayCounts)> =
            batch.into_par_iter().map(|i| cast_row(world, patches, PatchId(i as u32), settings)).collect();
        for (row, row_counts) in cast {
            rows.push(row);
            *counts += row_counts;
        }
        let progress = Progress { stage: Stage::FormFactors, done: rows.len() as f64, total: n as f64 };
        if let ControlFlow::Break(()) = observer(&progress) {
            return None;
        }
    }
    let mut matrix = FormFactorMatrix::from_rows(rows);
    let sums =
        (0..n).map(|i| matrix.direct_sum(i) + matrix.specular(i).map(|(_, f)| f.max()).sum::<f64>() + matrix.escaped(i).max());
    let (low, high) = sums.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| (l.min(s), h.max(s)));
    if n > 0 {
        (matrix.closure.row_sum_min, matrix.closure.row_sum_max) = (low, high);
        matrix.closure.escaped_max = (0..n).map(|i| matrix.escaped(i).max()).fold(0.0, f64::max);
    }
    let rays: Vec<f64> = (0..n).map(|i| f64::from(settings.rays_of(patches, i))).collect();
    matrix.symmetrise(&patches.area, &rays);
    Some(matrix)
}

/// The row of one patch.
fn cast_row(world: &World, patches: &PatchMesh, id: PatchId, settings: &RayCastSettings) -> (Row, RayCounts) {
    let mut counts = RayCounts::default();
    let mut direct: Vec<u32> = Vec::new();
    let mut specular: Vec<(u32, Rgb)> = Vec::new();
    let (mut escaped, mut truncated) = (Rgb::BLACK, Rgb::BLACK);
    let rays = settings.rays_of(patches, id.0 as usize);
    for k in 0..rays {
        let mut sampler = Sampler::new(settings.seed, u64::from(id.0), u64::from(k));
        let from = patches.sample(world, id, sampler.next_2d());
        let direction = Frame::new(from.ng).to_world(warp::cosine_hemisphere(sampler.next_2d()));
        counts.form_factor += 1;
        world.follow(from.spawn(direction), &mut sampler, settings.max_events, &mut counts, |event| match event {
            Event::Surface { at, throughput, through, straight } => match patches.patch_at(at) {
                Some(j) if through == 0 => direct.push(j.0),
                Some(j) => {
                    let counted = straight && world.partition().found_by_shadow_rays(at.shape as usize);
                    specular.push((if counted { j.0 | REFLECTED_ONLY } else { j.0 }, throughput));
                }
                None => {}
            },
            Event::Escaped { throughput, .. } => escaped += throughput,
            Event::Truncated { throughput } => truncated += throughput,
        });
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
        escaped: (escaped * share).to_array().map(|v| v as f32),
        truncated: (truncated * share).to_array().map(|v| v as f32),
    };
    (row, counts)
}
