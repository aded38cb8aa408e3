//! All pairs of surfaces by their exact exchange: the analytic method.
//!
//! Surfaces of one plane are taken in blocks, so that what may stand between two blocks is looked for once for all their pairs.
//! Surfaces of many facets, and curved ones, exchange by pairs of points with a ray between each.

use super::blockers::{Blockers, Found};
use super::polygon::Polygon;
use super::polygon::shaft;
use super::visibility::{Between, Transfer, point_of, segment};
use crate::math::{DVec3, Sampler, sampler::mix};
use crate::patch::{PatchId, PatchMesh};
use crate::progress::{Observer, Progress, Stage};
use crate::world::World;
use rayon::prelude::*;
use std::ops::ControlFlow;

/// A surface of up to this many facets exchanges facet by facet.
const MOST_FACETS: usize = 4;
/// Points by which the others are known.
const POINTS: usize = 64;
/// Pairs of points for a pair of surfaces that are near each other, and for others.
const SAMPLES: [usize; 2] = [64, 16];
/// Edge of a block in sizes of its first surface.
const BLOCK: f64 = 6.0;
/// Most polygons between two blocks that are handed on to their pairs.
const MOST_BETWEEN: usize = 48;
/// Share of the tolerance that one form factor may be wrong by where rays measure.
const RAY_SHARE: f64 = 0.05;

/// One side of a surface.
pub struct Surface {
    /// Its convex facets, counter-clockwise as seen from its side; empty: curved.
    facets: Vec<Polygon>,
    /// Points for pairs that are not taken facet by facet.
    points: Vec<(DVec3, DVec3)>,
    area: f64,
}

impl Surface {
    /// A surface of flat facets.
    pub fn of_facets(facets: Vec<Polygon>) -> Self {
        let area = facets.iter().map(Polygon::area).sum();
        Self { facets, points: Vec::new(), area }
    }

    /// Patch `id`: its facets if they are few, points of it otherwise.
    pub fn of_patch(world: &World, patches: &PatchMesh, id: PatchId, seed: u64) -> Self {
        let facets: Vec<Polygon> =
            patches.polygons(world, id).map_or(Vec::new(), |all| all.iter().filter_map(|c| Polygon::new(c)).collect());
        let facets = if facets.len() <= MOST_FACETS { facets } else { Vec::new() };
        let point = |k: u64| {
            let at = patches.sample(world, id, Sampler::new(seed, u64::from(id.0), k).next_2d());
            (at.point.as_dvec3(), at.ng.as_dvec3())
        };
        Self { facets, points: (0..POINTS as u64).map(point).collect(), area: patches.area[id.0 as usize] }
    }

    /// A point of it with the normal there; uniform where it has one facet or is known by points.
    pub fn sample(&self, sampler: &mut Sampler) -> Option<(DVec3, DVec3)> {
        if let Some(facet) = self.facets.first() {
            return Some((point_of(facet, sampler), facet.normal()));
        }
        let k = (f64::from(sampler.next_1d()) * self.points.len() as f64) as usize;
        self.points.get(k).copied()
    }

    /// Area [m²].
    pub fn area(&self) -> f64 {
        self.area
    }

    fn flat(&self) -> Option<&Polygon> {
        if self.facets.len() == 1 { self.facets.first() } else { None }
    }

    fn size(&self) -> f64 {
        self.area.sqrt()
    }
}

/// How well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairSettings {
    /// Error of an exchange between flat surfaces, relative to the unobstructed one, that may come from what stands between.
    pub tolerance: f64,
    /// The same that may come from the unobstructed one.
    pub kernel_tolerance: f64,
    /// Seed of the rays.
    pub seed: u64,
}

/// What surfaces i and j, i <= j, exchange; only pairs that do.
pub type Row = Vec<(u32, Transfer)>;

/// Surfaces of one plane that lie together.
struct Block {
    members: Vec<u32>,
    /// Rectangle around them; none for a surface that is not flat.
    hull: Option<Polygon>,
}

/// All exchanges, by the first of each pair; `None` if the observer stopped it.
pub fn transfers(
    world: &World,
    blockers: &Blockers,
    surfaces: &[Surface],
    settings: &PairSettings,
    observer: &mut Observer<'_>,
) -> Option<Vec<Row>> {
    let blocks = blocks(surfaces, blockers.slack());
    let between = Between {
        world,
        blockers,
        tolerance: settings.tolerance,
        kernel_tolerance: settings.kernel_tolerance,
        ray_tolerance: settings.tolerance * RAY_SHARE,
        seed: settings.seed,
    };
    let all = Pairs { between, surfaces, blocks: &blocks };
    let mut rows: Vec<Row> = vec![Row::new(); surfaces.len()];
    let batch = (4 * rayon::current_num_threads()).max(16);
    for start in (0..blocks.len()).step_by(batch) {
        let end = blocks.len().min(start + batch);
        let found: Vec<Vec<(u32, u32, Transfer)>> = (start..end).into_par_iter().map(|i| all.of_block(i)).collect();
        for (i, j, transfer) in found.into_iter().flatten() {
            rows[i.min(j) as usize].push((i.max(j), transfer));
        }
        // What is left shrinks with the square of the blocks that are left.
        let left = (blocks.len() - end) as f64 / blocks.len() as f64;
        let progress =
            Progress { stage: Stage::FormFactors, done: (1.0 - left * left) * rows.len() as f64, total: rows.len() as f64 };
        if let ControlFlow::Break(()) = observer(&progress) {
            return None;
        }
    }
    rows.par_iter_mut().for_each(|row| row.sort_unstable_by_key(|e| e.0));
    Some(rows)
}

struct Pairs<'a> {
    between: Between<'a>,
    surfaces: &'a [Surface],
    blocks: &'a [Block],
}

impl Pairs<'_> {
    /// Exchanges of the members of block `i` with each other and with those of all later blocks.
    fn of_block(&self, i: usize) -> Vec<(u32, u32, Transfer)> {
        let mut found = Vec::new();
        for k in i..self.blocks.len() {
            let (one, two) = (&self.blocks[i], &self.blocks[k]);
            let known = match (&one.hull, &two.hull) {
                // Nothing flat sees itself.
                (Some(_), Some(_)) if i == k => continue,
                (Some(p), Some(q)) => {
                    if !p.may_see(q, self.between.blockers.slack()) {
                        continue;
                    }
                    let known = self.between.candidates(p, q, MOST_BETWEEN);
                    let polygons = || known.polygons.iter().filter_map(|&b| self.between.blockers.polygon(b));
                    if polygons().any(|blocker| shaft::blocks_all(blocker, p, q, self.between.blockers.slack())) {
                        continue;
                    }
                    Some(known)
                }
                _ => None,
            };
            for &a in &one.members {
                for &b in two.members.iter().filter(|b| i != k || a <= **b) {
                    let transfer = self.of_pair(a, b, known.as_ref());
                    if transfer.value > 0.0 {
                        found.push((a, b, transfer));
                    }
                }
            }
        }
        found
    }

    fn of_pair(&self, i: u32, j: u32, known: Option<&Found>) -> Transfer {
        let (a, b) = (&self.surfaces[i as usize], &self.surfaces[j as usize]);
        // The order of the two must not matter to the bits.
        let key = mix(u64::from(i.min(j)) << 32 | u64::from(i.max(j)));
        if let (Some(p), Some(q)) = (a.flat(), b.flat()) {
            if i == j {
                return Transfer::default();
            }
            return self.between.transfer(p, q, known, key);
        }
        let mut sum = if a.facets.is_empty() || b.facets.is_empty() {
            self.by_points(a, b, i == j, key)
        } else {
            let mut sum = Transfer::default();
            for (k, p) in a.facets.iter().enumerate() {
                for (l, q) in b.facets.iter().enumerate().filter(|(l, _)| i != j || *l != k) {
                    sum = sum.plus(self.between.transfer(p, q, None, mix(key ^ (k << 8 | l) as u64)));
                }
            }
            sum
        };
        sum.value = sum.value.min(a.area.min(b.area));
        sum
    }

    /// The mean over pairs of points, with a ray between each.
    fn by_points(&self, a: &Surface, b: &Surface, itself: bool, key: u64) -> Transfer {
        if a.points.is_empty() || b.points.is_empty() {
            return Transfer::default();
        }
        let middle = |s: &Surface| s.points[0].0;
        let near = middle(a).distance(middle(b)) < 3.0 * (a.size() + b.size());
        let n = SAMPLES[usize::from(!near)];
        // A shift that never brings a point to itself.
        let shift = if itself { 1 + (key % 62) as usize } else { (key % 64) as usize };
        let (mut sum, mut squares) = (0.0, 0.0);
        for k in 0..n {
            let ((x, nx), (y, ny)) = (a.points[k], b.points[(k + shift) % POINTS]);
            let d = y - x;
            let cosines = d.dot(nx).max(0.0) * (-d.dot(ny)).max(0.0);
            let r2 = d.length_squared();
            if cosines > 0.0 && r2 > 0.0 && !self.between.world.occluded(&segment(x, nx, y, ny)) {
                let kernel = cosines / (std::f64::consts::PI * r2 * r2);
                sum += kernel;
                squares += kernel * kernel;
            }
        }
        let mean = sum / n as f64;
        let variance = (squares / n as f64 - mean * mean).max(0.0) / (n - 1) as f64;
        let scale = a.area * b.area;
        Transfer { value: mean * scale, error: variance.sqrt() * scale }
    }
}

/// Blocks of neighbours in one plane; each surface that is not flat by itself.
fn blocks(surfaces: &[Surface], slack: f64) -> Vec<Block> {
    let mut keyed: Vec<([i64; 7], u32)> = Vec::new();
    let mut blocks = Vec::new();
    for (i, surface) in surfaces.iter().enumerate() {
        match surface.flat() {
            Some(p) => {
                let (n, c) = (p.normal(), p.center());
                let whole = |v: f64, unit: f64| (v / unit).round() as i64;
                let cell = BLOCK * surface.size();
                let offset = whole(n.dot(c), 100.0 * slack.max(f64::MIN_POSITIVE));
                let key = [whole(n.x, 1e-4), whole(n.y, 1e-4), whole(n.z, 1e-4), offset];
                let place = [whole(c.x, cell), whole(c.y, cell), whole(c.z, cell)];
                keyed.push(([key[0], key[1], key[2], key[3], place[0], place[1], place[2]], i as u32));
            }
            None => blocks.push(Block { members: vec![i as u32], hull: None }),
        }
    }
    keyed.sort_unstable();
    for run in keyed.chunk_by(|a, b| a.0 == b.0) {
        let mut rest: Vec<u32> = run.iter().map(|e| e.1).collect();
        while let Some(&first) = rest.first() {
            let plane = surfaces[first as usize].flat();
            let in_plane = |i: &u32| match (plane, surfaces[*i as usize].flat()) {
                (Some(p), Some(q)) => q.corners().iter().all(|c| p.normal().dot(*c - p.center()).abs() <= slack),
                _ => false,
            };
            let (mut members, others): (Vec<u32>, Vec<u32>) = rest.into_iter().partition(in_plane);
            // A surface is in its own plane, but for rounding beyond all measure.
            if members.is_empty() {
                members = vec![first];
            }
            rest = others.into_iter().filter(|i| !members.contains(i)).collect();
            let polygons: Vec<&Polygon> = members.iter().filter_map(|&i| surfaces[i as usize].flat()).collect();
            blocks.push(Block { hull: hull(&polygons), members });
        }
    }
    blocks
}

/// The rectangle around polygons of one plane, along the longest edge of the first.
fn hull(polygons: &[&Polygon]) -> Option<Polygon> {
    let first = polygons.first()?;
    let c = first.corners();
    let edges = (0..c.len()).map(|i| c[(i + 1) % c.len()] - c[i]);
    let u = edges.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?.normalize_or_zero();
    let v = first.normal().cross(u);
    let corners = polygons.iter().flat_map(|p| p.corners()).map(|c| *c - first.center());
    let (low, high) = corners.fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(l, h), d| {
        let at = [d.dot(u), d.dot(v)];
        ([l[0].min(at[0]), l[1].min(at[1])], [h[0].max(at[0]), h[1].max(at[1])])
    });
    let corner = |x: f64, y: f64| first.center() + u * x + v * y;
    Polygon::new(&[corner(low[0], low[1]), corner(high[0], low[1]), corner(high[0], high[1]), corner(low[0], high[1])])
}
