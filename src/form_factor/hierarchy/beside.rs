//! What links do not hold, by rays: light through mirrors, glass and gloss, and what is seen of the outside.
//!
//! Patches of a small group share their rays. How much of a row goes elsewhere is known from its links, which vary smoothly; where it goes,
//! from the rays.

use super::HierarchySettings;
use super::tree::Tree;
use crate::form_factor::outside::{Outside, OutsideRow, Walked, Walks};
use crate::math::{Frame, Rgb, Sampler, sampler::mix, warp};
use crate::patch::{PatchId, PatchMesh};
use crate::world::sight::{Origin, cosine_density};
use crate::world::walk::{Event, RayCounts};
use crate::world::{DirectSampling, Sight, World};
use rayon::prelude::*;

/// Rays of a group that say whether there is anything but patches to be seen.
const SCOUTS: u32 = 64;
/// A group that gets more rays than others has at most so many times as many.
const MOST_TIMES: u32 = 64;
/// Groups aimed at.
const GROUPS: usize = 8192;
/// Groups are parted where a wall parts more than an eighth of them: the root of twice that share.
const TORN: f32 = 0.5;
/// Most patches of a group.
const LARGEST_GROUP: usize = 64;

/// Rows of groups: those through surfaces that are no patches, and those off the gloss of patches.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct Beside {
    /// Group of each place.
    group: Vec<u32>,
    rows: [Rows; 2],
    /// By group: what its rays saw besides patches.
    seen: Vec<Seen>,
    /// By place: what a row has left for what is no patch, over what the rays of its group found of that.
    weight: Vec<f64>,
}

#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
struct Rows {
    start: Vec<usize>,
    column: Vec<u32>,
    factor: Vec<[f32; 3]>,
}

/// What rays of a group saw, past surfaces that are no patches and off patches.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
struct Seen {
    /// Share of rays that met no patch first.
    elsewhere: f64,
    parts: [OutsideRow; 2],
}

/// A group's rays, summed.
#[derive(Debug, Clone, Default)]
struct Cast {
    seen: Seen,
    entries: [Vec<(u32, [f32; 3])>; 2],
    /// Variance of the mean of what arrived, averaged over channels [W² m⁻⁴ sr⁻²].
    noise: f64,
    counts: RayCounts,
}

impl Beside {
    /// Casts the rays of all groups. Scenes in which the first few show nothing but patches and darkness need no more.
    pub fn cast(world: &World, patches: &PatchMesh, tree: &Tree, settings: &HierarchySettings, counts: &mut RayCounts) -> Self {
        let largest = (tree.patch.len() / GROUPS).clamp(1, LARGEST_GROUP) as u32;
        let is_group = |at: &usize| tree.nodes[*at].count <= largest && tree.torn[*at] < TORN;
        let mut group = vec![0; tree.patch.len()];
        let mut groups = Vec::new();
        let mut at = 0;
        while at < tree.nodes.len() {
            if is_group(&at) {
                let node = &tree.nodes[at];
                group[node.first as usize..(node.first + node.count) as usize].fill(groups.len() as u32);
                groups.push(at);
                // Past all that lies below it, in preorder.
                at += 2 * node.count as usize - 1;
            } else {
                at += 1;
            }
        }
        let all = |rays: u32, seed: u64| -> Vec<Cast> {
            groups.par_iter().map(|&at| cast_group(world, patches, tree, at, rays, seed, settings)).collect()
        };
        let mut found = all(SCOUTS.min(settings.rays), settings.seed);
        found.iter().for_each(|cast| *counts += cast.counts);
        if found.iter().any(Cast::has_light) && settings.rays > SCOUTS {
            found = all(settings.rays, mix(settings.seed));
            found.iter().for_each(|cast| *counts += cast.counts);
            // As many rays again go to groups whose light came by few of them.
            let spread: Vec<f64> =
                groups.iter().zip(&found).map(|(&at, cast)| (tree.nodes[at].area * cast.noise).sqrt()).collect();
            let more = more_rays(&spread);
            let again: Vec<(usize, Cast)> = more
                .par_iter()
                .enumerate()
                .filter(|(_, times)| **times > 1)
                .map(|(g, times)| {
                    let rays = settings.rays.saturating_mul(*times);
                    (g, cast_group(world, patches, tree, groups[g], rays, mix(settings.seed), settings))
                })
                .collect();
            for (g, cast) in again {
                *counts += cast.counts;
                found[g] = cast;
            }
        }
        let mut beside = Self { group, weight: vec![0.0; tree.patch.len()], ..Self::default() };
        beside.rows.iter_mut().for_each(|rows| rows.start.push(0));
        for cast in found {
            for (rows, entries) in beside.rows.iter_mut().zip(&cast.entries) {
                rows.column.extend(entries.iter().map(|e| e.0));
                rows.factor.extend(entries.iter().map(|e| e.1));
                rows.start.push(rows.column.len());
            }
            beside.seen.push(cast.seen);
        }
        beside
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.rows.iter().map(|rows| rows.column.len()).sum()
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        16 * self.len() + 16 * self.seen.len() + size_of::<Seen>() * self.seen.len() + 12 * self.group.len()
    }

    /// Share of the rays of the group at `place` that met no patch first.
    pub fn share_elsewhere(&self, place: usize) -> f64 {
        self.seen[self.group[place] as usize].elsewhere
    }

    /// What the direct part of the row at `place` sums to, if its links sum to `linked`.
    pub fn target(&self, place: usize, linked: f64) -> f64 {
        if self.share_elsewhere(place) > 0.0 { linked.min(1.0) } else { 1.0 }
    }

    /// Weights the rows of groups so that each patch, whose direct part sums to `target` by place, has a row that closes; what goes out
    /// of the scene, by patch.
    pub fn complete(&mut self, target: &[f64], place: &[u32]) -> Outside {
        for (at, weight) in self.weight.iter_mut().enumerate() {
            let elsewhere = self.seen[self.group[at] as usize].elsewhere;
            *weight = if elsewhere > 0.0 { (1.0 - target[at]).max(0.0) / elsewhere } else { 0.0 };
        }
        let mut outside = Outside::default();
        for &at in place {
            let [past, off] = self.seen[self.group[at as usize] as usize].parts;
            let weight = self.weight[at as usize];
            let shares = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|c| a[c] * weight as f32 + b[c]);
            outside.push(OutsideRow {
                escaped: shares(past.escaped, off.escaped),
                truncated: shares(past.truncated, off.truncated),
                passed_on: shares(past.passed_on, off.passed_on),
                passed_out: shares(past.passed_out, off.passed_out),
                arriving: past.arriving * weight + off.arriving,
                accepted: past.accepted * weight + off.accepted,
                arriving_again: past.arriving_again * weight + off.arriving_again,
            });
        }
        outside
    }

    /// Adds what patches get of `x` this way; `x` and `out` by patch.
    pub fn add(&self, x: &[Rgb], place: &[u32], out: &mut [Rgb]) {
        if self.len() == 0 {
            return;
        }
        let sums = |g: usize| {
            [0, 1].map(|k| {
                let rows = &self.rows[k];
                let range = rows.start[g]..rows.start[g + 1];
                let entries = rows.column[range.clone()].iter().zip(&rows.factor[range]);
                entries.map(|(&j, &f)| x[j as usize] * Rgb::from(f)).sum::<Rgb>()
            })
        };
        let of_group: Vec<[Rgb; 2]> = (0..self.seen.len()).into_par_iter().with_min_len(64).map(sums).collect();
        for (out, &at) in out.iter_mut().zip(place) {
            let [past, off] = of_group[self.group[at as usize] as usize];
            *out += past * self.weight[at as usize] + off;
        }
    }

    /// Shows the entries of the row at `place`.
    pub fn row(&self, place: usize, visit: &mut dyn FnMut(usize, Rgb)) {
        let g = self.group[place] as usize;
        for (rows, weight) in self.rows.iter().zip([self.weight[place], 1.0]) {
            for k in rows.start[g]..rows.start[g + 1] {
                visit(rows.column[k] as usize, Rgb::from(rows.factor[k]) * weight);
            }
        }
    }
}

impl Beside {
    /// Names pairs of patches as [`crate::form_factor::FormFactors::join`] does; `patch` is the one at each place.
    pub fn join(&self, patch: &[u32], pair: &mut dyn FnMut(usize, usize)) {
        for (place, &g) in self.group.iter().enumerate() {
            let is_first = place == 0 || self.group[place - 1] != g;
            for rows in &self.rows {
                let entries = &rows.column[rows.start[g as usize]..rows.start[g as usize + 1]];
                // All patches of a group see what one of them sees.
                let shown = if is_first { entries } else { &entries[..entries.len().min(1)] };
                shown.iter().for_each(|&j| pair(patch[place] as usize, j as usize));
            }
        }
    }
}

impl Cast {
    /// True if there is more than patches, and the dark beyond them.
    fn has_light(&self) -> bool {
        let lit = self.seen.parts.iter().any(|part| !part.arriving.is_black() || part.truncated != [0.0; 3]);
        lit || self.entries.iter().any(|e| !e.is_empty())
    }
}

/// How many times the rays that it had each group should have, so that there are about twice as many in all: in proportion to `spread`, the root
/// of what a group adds to the square of the error. Powers of two, of which the most is [`MOST_TIMES`].
fn more_rays(spread: &[f64]) -> Vec<u32> {
    let times = |per_spread: f64| {
        let of = |s: &f64| (s * per_spread).clamp(1.0, f64::from(MOST_TIMES)) as u32;
        spread.iter().map(|s| 1 << of(s).ilog2()).collect::<Vec<u32>>()
    };
    let largest = spread.iter().copied().fold(0.0, f64::max);
    if largest <= 0.0 {
        return vec![1; spread.len()];
    }
    // One that is cast again is cast from the start.
    let again = |per_spread: f64| times(per_spread).iter().filter(|t| **t > 1).map(|t| f64::from(*t)).sum::<f64>();
    // With the first none has more than it had. The factor between is sought by its logarithm.
    let (mut low, mut high) = (1.0 / largest, 1e12 / largest);
    for _ in 0..64 {
        let middle = (low * high).sqrt();
        if again(middle) > spread.len() as f64 { high = middle } else { low = middle }
    }
    times(low)
}

/// Rays of the group at node `at`; `rays` for one of the full area.
fn cast_group(
    world: &World,
    patches: &PatchMesh,
    tree: &Tree,
    at: usize,
    rays: u32,
    seed: u64,
    settings: &HierarchySettings,
) -> Cast {
    let node = &tree.nodes[at];
    let (first, last) = (node.first as usize, (node.first + node.count) as usize);
    let before = if first == 0 { 0.0 } else { tree.running[first - 1] };
    let mut cast = Cast::default();
    let mut sums = [Walks::default(); 2];
    let mut entries: [Vec<(u32, Rgb)>; 2] = Default::default();
    let mut elsewhere = 0_u32;
    let (mut light, mut squared) = (0.0, 0.0);
    for k in 0..rays {
        let mut sampler = Sampler::new(seed, u64::from(tree.patch[first]), u64::from(k));
        let (on_patch, towards) = (sampler.next_2d(), sampler.next_2d());
        let target = before + f64::from(sampler.next_1d()) * (tree.running[last - 1] - before);
        let place = first + tree.running[first..last].partition_point(|&a| a <= target).min(last - first - 1);
        let from = patches.sample(world, PatchId(tree.patch[place]), on_patch);
        let direction = Frame::new(from.ng).to_world(warp::cosine_hemisphere(towards));
        cast.counts.form_factor += 1;
        let density = cosine_density(settings.rays_beside_shadow_rays, direction.dot(from.ng));
        let sight =
            Sight::Gather(Origin { point: from.point, receiver: Some(from.ng), density, sampling: DirectSampling::OF_PATCHES });
        let mut walk = Walked::default();
        // 0: past what is no patch; 1: off a patch.
        let mut way = 0;
        let counts = &mut cast.counts;
        world.follow(from.spawn(direction), sight, &mut sampler, settings.max_events, counts, |event| match event {
            Event::Surface { at, throughput, through, emission_share, .. } => {
                let patch = patches.patch_at(at);
                if through == 0 {
                    way = usize::from(patch.is_some());
                } else {
                    if let Some(j) = patch {
                        entries[way].push((j.0, throughput));
                        sums[way].arrive(&walk, throughput);
                    }
                    if at.front {
                        walk.find(throughput * world.scene().shapes[at.shape as usize].emitted(at.uv) * emission_share);
                    }
                }
                if patch.is_some() {
                    walk.meet_patch();
                }
            }
            Event::Lit { radiance, .. } => walk.find(radiance),
            Event::Escaped { direction, throughput, share, .. } => {
                sums[way].escape(&walk, throughput);
                walk.find(throughput * world.scene().escaped_radiance(direction) * share);
            }
            Event::Truncated { throughput } => sums[way].truncate(&walk, throughput),
        });
        elsewhere += u32::from(way == 0);
        let found = sums[way].add_light(&walk, || world.shading(&from).acceptance(direction)).mean();
        light += found;
        squared += found * found;
    }
    let share = 1.0 / f64::from(rays);
    cast.noise = (squared * share - (light * share).powi(2)).max(0.0) * share;
    let narrow = |v: Rgb| (v * share).to_array().map(|v| v as f32);
    cast.seen.elsewhere = f64::from(elsewhere) * share;
    cast.seen.parts = sums.map(|s| s.row(rays));
    cast.entries = entries.map(|mut found| {
        found.sort_by_key(|e| e.0);
        let sum = |same: &[(u32, Rgb)]| (same[0].0, narrow(same.iter().map(|e| e.1).sum::<Rgb>()));
        found.chunk_by(|a, b| a.0 == b.0).map(sum).collect()
    });
    cast
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_that_know_least_get_most_rays() {
        let mut spread = vec![1e-6; 200];
        (spread[7], spread[70]) = (1.0, 0.1);
        let times = more_rays(&spread);
        assert_eq!((times[7], times[70]), (MOST_TIMES, MOST_TIMES));
        assert!(times.iter().filter(|t| **t > 1).sum::<u32>() <= 200);
        // All alike, or without any light: none is favoured.
        assert_eq!(more_rays(&[0.5; 9]), [1; 9]);
        assert_eq!(more_rays(&[0.0; 9]), [1; 9]);
    }
}
