//! What links do not hold, by rays: light through mirrors, glass and gloss, and what is seen of the outside.
//!
//! Patches of a small group share their rays. How much of a row goes elsewhere is known from its links, which vary smoothly; where it goes,
//! from the rays.

use super::HierarchySettings;
use super::shrink::{Branches, Estimate};
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
/// Groups that send them side by side.
const SCOUTING: usize = 512;
/// A group that gets more rays than others has at most so many times as many.
const MOST_TIMES: u32 = 64;
/// Groups aimed at.
const GROUPS: usize = 8192;
/// Groups are parted where a wall parts more than an eighth of them: the root of twice that share.
const TORN: f32 = 0.5;
/// Typical error of what the links of a group of patches sum to.
const LINKS_ERR_BY: f64 = 0.05;
/// Standard errors within which shares are believed.
const SURE: f64 = 2.0;
/// Groups whose noise is taken to be one, when it is asked which get more rays.
const POOLED: u32 = 8;
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
    /// True if any saw light, directly or from patches.
    #[serde(skip)]
    finds_light: bool,
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
    /// How many there were.
    #[serde(skip)]
    rays: u32,
}

/// A group's rays, summed; by either way where there are two.
#[derive(Debug, Clone, Default)]
struct Cast {
    rays: u32,
    /// Rays that met no patch first.
    elsewhere: u32,
    walks: [Walks; 2],
    /// What arrived by each patch, in the order of patches.
    entries: [Vec<(u32, Rgb)>; 2],
    /// Light found, averaged over channels, and its square.
    light: [f64; 2],
    squared: [f64; 2],
    counts: RayCounts,
}

impl Beside {
    /// Casts the rays of all groups. Scenes in which the first few show nothing but patches and darkness need no more.
    pub fn cast(world: &World, patches: &PatchMesh, tree: &Tree, settings: &HierarchySettings, counts: &mut RayCounts) -> Self {
        let largest = (tree.patch.len() / GROUPS).clamp(1, LARGEST_GROUP) as u32;
        let is_group = |at: &usize| tree.nodes[*at].count <= largest && tree.torn[*at] < TORN;
        let mut group = vec![0; tree.patch.len()];
        let mut groups = Vec::new();
        let mut visited = Vec::new();
        let mut at = 0;
        while at < tree.nodes.len() {
            visited.push(is_group(&at));
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
        let branches = Branches::new(&visited);
        let casting = Casting { world, patches, tree, settings };
        let all = |groups: &[usize], rays: u32, seed: u64| -> Vec<Cast> {
            groups.par_iter().map(|&at| casting.cast(at, rays, seed)).collect()
        };
        let mut found = Vec::with_capacity(groups.len());
        // Where the first groups find light none of their scouts counts.
        while found.len() < groups.len() && !(settings.rays > SCOUTS && found.iter().any(Cast::has_light)) {
            let next = found.len()..(found.len() + SCOUTING).min(groups.len());
            found.extend(all(&groups[next], SCOUTS.min(settings.rays), settings.seed));
        }
        found.iter().for_each(|cast| *counts += cast.counts);
        if found.iter().any(Cast::has_light) && settings.rays > SCOUTS {
            found = all(&groups, settings.rays, mix(settings.seed));
            // As many rays again go where light came by few of them; not to the very groups that it came to, of which those that were
            // lucky would lose what they found, and the others gain nothing.
            let noise: Vec<f64> = found.iter().map(|cast| cast.noise().iter().sum()).collect();
            let noise = branches.pool(&noise, POOLED);
            let spread: Vec<f64> = groups.iter().zip(&noise).map(|(&at, noise)| (tree.nodes[at].area * noise).sqrt()).collect();
            let more = more_rays(&spread);
            found.par_iter_mut().zip(&groups).zip(&more).filter(|(_, times)| **times > 1).for_each(|((cast, &at), times)| {
                casting.go_on(cast, at, settings.rays.saturating_mul(*times), mix(settings.seed));
            });
            found.iter().for_each(|cast| *counts += cast.counts);
        }
        let area: Vec<f64> = groups.iter().map(|&at| tree.nodes[at].area).collect();
        let finds_light = found.iter().any(Cast::has_light);
        let mut seen: Vec<Seen> = found.iter().map(Cast::seen).collect();
        let noise: Vec<[f64; 2]> = found.iter().map(Cast::noise).collect();
        draw_together(&branches, &area, &noise, &mut seen);
        let mut beside = Self { group, finds_light, weight: vec![0.0; tree.patch.len()], seen, ..Self::default() };
        beside.rows.iter_mut().for_each(|rows| rows.start.push(0));
        for cast in found {
            let share = 1.0 / f64::from(cast.rays);
            for (rows, entries) in beside.rows.iter_mut().zip(&cast.entries) {
                rows.column.extend(entries.iter().map(|e| e.0));
                rows.factor.extend(entries.iter().map(|e| (e.1 * share).to_array().map(|v| v as f32)));
                rows.start.push(rows.column.len());
            }
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

    /// What the direct part of each row sums to, by place, if its links sum to `linked` and its patch has so much `area`.
    ///
    /// Where much goes elsewhere, that is what links leave, as far as the rays of the group bear it out; where little does, it is what the rays
    /// say: what links leave is mostly their own error then, and what one ray in a thousand has found must not count for all of that. Without
    /// light in either, links alone say how open a row is.
    pub fn targets(&self, linked: &[f64], area: &[f64]) -> Vec<f64> {
        let mut target = Vec::with_capacity(linked.len());
        for same in self.group.chunk_by(|a, b| a == b) {
            let range = target.len()..target.len() + same.len();
            let Seen { elsewhere, rays, .. } = self.seen[same[0] as usize];
            if elsewhere <= 0.0 {
                target.resize(range.end, 1.0);
                continue;
            }
            let left = |at: usize| (1.0 - linked[at]).max(0.0);
            let all: f64 = range.clone().map(|at| area[at]).sum();
            let mean = range.clone().map(|at| left(at) * area[at]).sum::<f64>() / all;
            let [low, high] = likely(elsewhere, f64::from(rays));
            let is_likely = !self.finds_light || (low..=high).contains(&mean);
            let factor = if is_likely || mean <= 0.0 { 1.0 } else { elsewhere / mean };
            let by_links = if self.finds_light { elsewhere.powi(2) / (elsewhere.powi(2) + LINKS_ERR_BY.powi(2)) } else { 1.0 };
            let goes = |at: usize| by_links * (left(at) * factor).min(1.0) + (1.0 - by_links) * elsewhere;
            target.extend(range.map(|at| 1.0 - goes(at)));
        }
        target
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
        self.walks.iter().any(Walks::has_light) || self.entries.iter().any(|e| !e.is_empty())
    }

    /// What the rays saw, as shares of them.
    fn seen(&self) -> Seen {
        let elsewhere = f64::from(self.elsewhere) / f64::from(self.rays);
        Seen { elsewhere, parts: self.walks.map(|walks| walks.row(self.rays)), rays: self.rays }
    }

    /// Variance of the mean of what arrived by either way, averaged over channels [W² m⁻⁴ sr⁻²].
    fn noise(&self) -> [f64; 2] {
        let share = 1.0 / f64::from(self.rays);
        [0, 1].map(|way| (self.squared[way] * share - (self.light[way] * share).powi(2)).max(0.0) * share)
    }
}

/// Shares that so many rays may be of, of which the share `found` was found: the interval of [Wilson27].
fn likely(found: f64, rays: f64) -> [f64; 2] {
    let z2 = SURE * SURE / rays;
    let middle = found + 0.5 * z2;
    let half = (z2 * (found * (1.0 - found) + 0.25 * z2)).sqrt();
    [(middle - half) / (1.0 + z2), (middle + half) / (1.0 + z2)]
}

/// Light that came to few groups by few rays is spread over those around them.
fn draw_together(branches: &Branches, area: &[f64], noise: &[[f64; 2]], found: &mut [Seen]) {
    for way in 0..2 {
        let estimate = |((seen, area), noise): ((&Seen, &f64), &[f64; 2])| {
            let row = &seen.parts[way];
            let light = [row.arriving, row.accepted, row.arriving_again].map(Rgb::to_array);
            // Where no ray went past patches nothing can come that way, and what would be put there would be lost.
            let is_open = way == 1 || seen.elsewhere > 0.0;
            Estimate {
                mean: std::array::from_fn::<f64, 9, _>(|k| light[k / 3][k % 3]),
                level: row.arriving.mean(),
                variance: noise[way],
                area: if is_open { *area } else { 0.0 },
            }
        };
        let groups: Vec<Estimate<9>> = found.iter().zip(area).zip(noise).map(estimate).collect();
        for (seen, (mean, group)) in found.iter_mut().zip(branches.shrink(&groups).into_iter().zip(&groups)) {
            if group.area > 0.0 {
                let row = &mut seen.parts[way];
                let light = |k: usize| Rgb::new(mean[3 * k], mean[3 * k + 1], mean[3 * k + 2]).map(|v| v.max(0.0));
                (row.arriving, row.accepted, row.arriving_again) = (light(0), light(1), light(2));
            }
        }
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
    // Of one that gets more all rays count, those that it had as well.
    let again = |per_spread: f64| times(per_spread).iter().filter(|t| **t > 1).map(|t| f64::from(*t)).sum::<f64>();
    // With the first none has more than it had. The factor between is sought by its logarithm.
    let (mut low, mut high) = (1.0 / largest, 1e12 / largest);
    for _ in 0..64 {
        let middle = (low * high).sqrt();
        if again(middle) > spread.len() as f64 { high = middle } else { low = middle }
    }
    times(low)
}

/// What rays of groups are cast through.
struct Casting<'a> {
    world: &'a World,
    patches: &'a PatchMesh,
    tree: &'a Tree,
    settings: &'a HierarchySettings,
}

impl Casting<'_> {
    /// The first `rays` rays of the group at node `at`.
    fn cast(&self, at: usize, rays: u32, seed: u64) -> Cast {
        let mut cast = Cast::default();
        self.go_on(&mut cast, at, rays, seed);
        cast
    }

    /// Further rays of the group at node `at`, up to `rays` of them in all.
    fn go_on(&self, cast: &mut Cast, at: usize, rays: u32, seed: u64) {
        let Self { world, patches, tree, settings } = *self;
        let node = &tree.nodes[at];
        let (first, last) = (node.first as usize, (node.first + node.count) as usize);
        let before = if first == 0 { 0.0 } else { tree.running[first - 1] };
        for k in cast.rays..rays {
            let mut sampler = Sampler::new(seed, u64::from(tree.patch[first]), u64::from(k));
            let (on_patch, towards) = (sampler.next_2d(), sampler.next_2d());
            let target = before + f64::from(sampler.next_1d()) * (tree.running[last - 1] - before);
            let place = first + tree.running[first..last].partition_point(|&a| a <= target).min(last - first - 1);
            let from = patches.sample(world, PatchId(tree.patch[place]), on_patch);
            let direction = Frame::new(from.ng).to_world(warp::cosine_hemisphere(towards));
            cast.counts.form_factor += 1;
            let density = cosine_density(settings.rays_beside_shadow_rays, direction.dot(from.ng));
            let sampling = DirectSampling::OF_PATCHES;
            let sight = Sight::Gather(Origin { point: from.point, receiver: Some(from.ng), density, sampling });
            let mut walk = Walked::default();
            // 0: past what is no patch; 1: off a patch.
            let mut way = 0;
            let Cast { walks, entries, counts, .. } = cast;
            world.follow(from.spawn(direction), sight, &mut sampler, settings.max_events, counts, |event| match event {
                Event::Surface { at, throughput, through, emission_share, .. } => {
                    let has_patch = patches.has_patch_at(at);
                    if through == 0 {
                        way = usize::from(has_patch);
                    } else {
                        if let Some(j) = patches.patch_at(at) {
                            entries[way].push((j.0, throughput));
                            walks[way].arrive(&walk, throughput);
                        }
                        if at.front {
                            walk.find(throughput * world.scene().shapes[at.shape as usize].emitted(at.uv) * emission_share);
                        }
                    }
                    if has_patch {
                        walk.meet_patch();
                    }
                }
                Event::Lit { radiance, .. } => walk.find(radiance),
                Event::Escaped { direction, throughput, share, .. } => {
                    walks[way].escape(&walk, throughput);
                    walk.find(throughput * world.scene().escaped_radiance(direction) * share);
                }
                Event::Truncated { throughput } => walks[way].truncate(&walk, throughput),
            });
            cast.elsewhere += u32::from(way == 0);
            let found = cast.walks[way].add_light(&walk, || world.shading(&from).acceptance(direction)).mean();
            cast.light[way] += found;
            cast.squared[way] += found * found;
        }
        cast.rays = cast.rays.max(rays);
        for entries in &mut cast.entries {
            entries.sort_by_key(|e| e.0);
            let sum = |same: &[(u32, Rgb)]| (same[0].0, same.iter().map(|e| e.1).sum::<Rgb>());
            *entries = entries.chunk_by(|a, b| a.0 == b.0).map(sum).collect();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::AccelKind;
    use crate::math::DVec3;
    use crate::patch::PatchSettings;
    use crate::stability::rooms::Room;

    /// Two patches of one group, of areas 1 and 3, whose rays go elsewhere in this share: what their rows have left for it.
    fn goes(elsewhere: f64, finds_light: bool, linked: [f64; 2]) -> [f64; 2] {
        let seen = vec![Seen { elsewhere, rays: 512, ..Seen::default() }];
        let beside = Beside { group: vec![0; 2], seen, finds_light, ..Beside::default() };
        let target = beside.targets(&linked, &[1.0, 3.0]);
        [1.0 - target[0], 1.0 - target[1]]
    }

    #[test]
    fn what_one_ray_met_does_not_count_for_what_links_lack() {
        let ray = 1.0 / 512.0;
        assert!(goes(ray, true, [0.7, 0.9]).iter().all(|g| (g / ray - 1.0).abs() < 0.25), "{:?}", goes(ray, true, [0.7, 0.9]));
        assert_eq!(goes(0.0, true, [0.7, 0.9]), [0.0; 2]);
        // Nothing there that shines: links know better how open a row is.
        assert!((goes(ray, false, [0.7, 0.9])[0] - 0.3).abs() < 1e-12);
    }

    #[test]
    fn where_much_goes_elsewhere_links_say_how_much_unless_rays_say_no() {
        let [a, b] = goes(0.5, true, [0.4, 0.55]);
        assert!((a - 0.6).abs() < 2e-3 && (b - 0.45).abs() < 2e-3, "{a} and {b}");
        // A mean of 0.15 is 16 standard errors off: their ratio is kept, but for the hundredth that rays have a say in.
        let [a, b] = goes(0.5, true, [0.8, 1.0 - 2.0 / 15.0]);
        assert!((0.25 * a + 0.75 * b - 0.5).abs() < 1e-12 && (a / b - 1.5).abs() < 0.02, "{a} and {b}");
    }

    /// A room with a glowing ceiling and a mirror for a wall: rays that are cast in two turns see what they see in one.
    #[test]
    fn a_group_goes_on_where_it_ended() {
        let mut room = Room::new(DVec3::new(0.1, 0.2, 0.3), DVec3::ONE, 4);
        let grey = room.grey(0.5);
        room.walls(DVec3::ZERO, DVec3::ONE, grey, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        room.source.shapes[0].material = room.mirror(0.9);
        let world = World::new(room.scene().expect("valid"), AccelKind::default()).expect("built");
        let size = PatchSettings { patch_size: Some(0.5), ..PatchSettings::default() };
        let patches = PatchMesh::build(&world, &size).expect("not too many");
        let settings = HierarchySettings::for_tolerance(1e-3, 32.0, 3);
        let tree = Tree::new(&world, &patches);
        let casting = Casting { world: &world, patches: &patches, tree: &tree, settings: &settings };
        for leaf in (0..tree.nodes.len()).filter(|&at| tree.nodes[at].is_leaf()) {
            let whole = casting.cast(leaf, 256, 7);
            let mut parts = casting.cast(leaf, 64, 7);
            casting.go_on(&mut parts, leaf, 256, 7);
            assert!(whole.elsewhere > 0 && whole.entries[0].len() > 1, "node {leaf} sees no mirror");
            assert_eq!((parts.rays, parts.elsewhere, parts.counts.form_factor), (256, whole.elsewhere, 256), "node {leaf}");
            let close = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs();
            assert!((0..2).all(|way| close(parts.noise()[way], whole.noise()[way])), "node {leaf}");
            assert_eq!(parts.entries[0].len(), whole.entries[0].len(), "node {leaf}");
            let same = parts.entries[0].iter().zip(&whole.entries[0]).all(|(a, b)| a.0 == b.0 && close(a.1.g, b.1.g));
            assert!(same, "node {leaf}: {:?}, at once {:?}", parts.entries[0], whole.entries[0]);
        }
    }

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
