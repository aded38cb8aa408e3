//! Form factors by hemicubes [Cohen85]: what is seen from a point of the patch through each pixel of a half cube above it.
//!
//! A hemicube stands at a point, so that one alone has an error that no resolution takes away: the form factor from that point is not the
//! patch's mean; and a grid of pixels that is always the same errs always the same way at the rim of what it sees. Hemicubes stand at several
//! stratified points of each patch instead, each turned about the normal, and each pixel looks through a random point of itself, so that the
//! spread between them shows the errors of both kinds: of the point and of the pixels. Resolution and points grow together until the error is
//! allowed.

use super::visibility::Transfer;
use crate::math::{Frame, Sampler, Vec3, sampler::mix};
use crate::patch::{PatchId, PatchMesh};
use crate::progress::{Observer, Progress, Stage};
use crate::world::World;
use crate::world::walk::RayCounts;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::ControlFlow;

/// Rows computed between two looks at the observer.
const BATCH: usize = 256;
/// Pixels along the top's edge and points of a patch, from coarse to fine.
const LEVELS: [(usize, u64); 5] = [(12, 4), (16, 8), (24, 16), (32, 32), (48, 64)];

/// How fine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HemicubeSettings {
    /// Standard error allowed to any form factor.
    pub tolerance: f64,
    /// Seed of points and angles.
    pub seed: u64,
}

impl HemicubeSettings {
    /// Settings for a standard error of any form factor.
    pub fn for_tolerance(tolerance: f64, seed: u64) -> Self {
        Self { tolerance, seed }
    }
}

/// Directions through the pixels of a hemicube around +z, one at a random place of each, with their form factors, which sum to 1.
fn pixels(side: usize, seed: u64) -> Vec<(Vec3, f64)> {
    let mut directions: Vec<([f64; 3], f64)> = Vec::with_capacity(3 * side * side);
    let cell = 2.0 / side as f64;
    let mut state = seed;
    let mut place = |i: usize, j: usize| {
        state = mix(state.wrapping_add(0x9e37_79b9_7f4a_7c15));
        let within = |bits: u64| (bits & 0xffff_ffff) as f64 * 2.0_f64.powi(-32);
        ((i as f64 + within(state)) * cell - 1.0, (j as f64 + within(state >> 32)) * cell)
    };
    for i in 0..side {
        for j in 0..side {
            let (x, y) = place(i, j);
            let y = y - 1.0;
            // [Cohen85, Eq. 6], the element of the top face.
            let r2 = x * x + y * y + 1.0;
            directions.push(([x, y, 1.0], 1.0 / (r2 * r2)));
            if j < side / 2 {
                // The same of a side face, [Cohen85, Eq. 7]; its rows go from the horizon to the top.
                for face in 0..4 {
                    let (y, z) = place(i, j);
                    let r2 = y * y + z * z + 1.0;
                    let d = [[1.0, y, z], [-y, 1.0, z], [-1.0, -y, z], [y, -1.0, z]][face];
                    directions.push((d, z / (r2 * r2)));
                }
            }
        }
    }
    let sum: f64 = directions.iter().map(|d| d.1).sum();
    let unit = |d: [f64; 3]| Vec3::from_array(d.map(|v| v as f32)).normalize();
    directions.into_iter().map(|(d, f)| (unit(d), f / sum)).collect()
}

/// Rows of F_ij with their standard errors, directly seen patches only; `None` if the observer stopped it.
pub fn project(
    world: &World,
    patches: &PatchMesh,
    settings: &HemicubeSettings,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Option<Vec<Vec<(u32, Transfer)>>> {
    let n = patches.len();
    let mut rows = Vec::with_capacity(n);
    while rows.len() < n {
        let batch = rows.len()..n.min(rows.len() + BATCH);
        let found: Vec<_> = batch.into_par_iter().map(|i| row(world, patches, PatchId(i as u32), settings)).collect();
        for (row, rays) in found {
            rows.push(row);
            counts.form_factor += rays;
        }
        let progress = Progress { stage: Stage::FormFactors, done: rows.len() as f64, total: n as f64 };
        if let ControlFlow::Break(()) = observer(&progress) {
            return None;
        }
    }
    Some(rows)
}

fn row(world: &World, patches: &PatchMesh, id: PatchId, settings: &HemicubeSettings) -> (Vec<(u32, Transfer)>, u64) {
    let mut rays = 0;
    for (side, points) in LEVELS {
        // Sum and sum of squares over the points.
        let mut sums: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
        for k in 0..points {
            let mut one: BTreeMap<u32, f64> = BTreeMap::new();
            let mut sampler = Sampler::new(settings.seed, u64::from(id.0), k);
            let from = patches.sample(world, id, sampler.next_2d());
            let (sin, cos) = (TAU * f64::from(sampler.next_1d())).sin_cos();
            let frame = Frame::new(from.ng);
            for (d, factor) in pixels(side, mix(settings.seed ^ mix(u64::from(id.0) << 16 | k))) {
                let turned = Vec3::new(d.x * cos as f32 - d.y * sin as f32, d.x * sin as f32 + d.y * cos as f32, d.z);
                rays += 1;
                let seen = world.intersect(&from.spawn(frame.to_world(turned)));
                if let Some(j) = seen.and_then(|at| patches.patch_at(&at)) {
                    *one.entry(j.0).or_default() += factor;
                }
            }
            for (j, f) in one {
                let sum = sums.entry(j).or_default();
                *sum = (sum.0 + f, sum.1 + f * f);
            }
        }
        let n = points as f64;
        // A pixel more or less is what no spread shows where all points agree.
        let pixel = 1.0 / (3 * side * side) as f64 / n.sqrt();
        let entry = |(j, (sum, squares)): (u32, (f64, f64))| {
            let mean = sum / n;
            let variance = (squares / n - mean * mean).max(0.0) / (n - 1.0);
            (j, Transfer { value: mean, error: variance.sqrt().max((pixel * mean / n).sqrt()).max(pixel / n) })
        };
        let found: Vec<(u32, Transfer)> = sums.into_iter().map(entry).collect();
        let worst = found.iter().map(|(_, t)| t.error).fold(0.0, f64::max);
        if worst <= settings.tolerance || points == LEVELS[LEVELS.len() - 1].1 {
            return (found, rays);
        }
    }
    (Vec::new(), rays)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_cover_the_cosine_weighted_hemisphere() {
        let pixels = pixels(64, 3);
        // Mean of z over a cosine-weighted hemisphere is 2/3, of z² it is 1/2; of x² it is 1/4.
        let mean = |g: fn(Vec3) -> f32| pixels.iter().map(|(d, f)| f * f64::from(g(*d))).sum::<f64>();
        let known = [("1", mean(|_| 1.0), 1.0), ("z", mean(|d| d.z), 2.0 / 3.0), ("z²", mean(|d| d.z * d.z), 0.5)];
        for (name, got, want) in known.into_iter().chain([("x²", mean(|d| d.x * d.x), 0.25)]) {
            assert!((got - want).abs() < 2e-3, "{name}: {got}, expected {want}");
        }
        assert_eq!(pixels.len(), 3 * 64 * 64);
    }
}
