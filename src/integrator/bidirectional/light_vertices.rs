//! Which vertices of light walks a vertex of a camera walk is connected with.
//!
//! A camera walk need not be connected with one light walk alone: the vertices of all of them are at hand ([Davidovic14], section 4), and few
//! serve it as well as many if they are well chosen ([Popov15]). Space is divided into cells. What connections between each two cells
//! have brought in the passes before, shadows and weights included, tells how likely a vertex of a cell is picked from another; some picks are
//! uniform, so that nothing is missed. Every strategy's expectation is as with one walk each, so its weights are as well, but
//! that a connection counts for more ([`super::subpath::CONNECTION_WORTH`]).

use super::subpath::Vertex;
use crate::geometry::Bounds;
use crate::math::{Vec3, sampler::mix};
use serde::{Deserialize, Serialize};

/// Cells along the longest side of the scene.
const CELLS: u32 = 8;
/// Vertices of a cell that are kept: few enough for all to stay near the processor.
const KEPT: u32 = 64;
/// Share of the picks that are uniform over all vertices.
const UNIFORM: f64 = 0.25;
/// What was learnt of a pair of cells counts as if so many connections more had brought as much as those from this cell do in the mean.
const PRIOR: f64 = 1.0;

/// Cells of the scene's box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Cells {
    low: Vec3,
    per_length: f32,
    count: [u32; 3],
}

impl Cells {
    fn new(bounds: Bounds) -> Self {
        let size = if bounds.is_empty() { Vec3::ONE } else { bounds.max - bounds.min };
        let low = if bounds.is_empty() { Vec3::ZERO } else { bounds.min };
        let longest = size.max_element().max(f32::MIN_POSITIVE);
        let per_length = CELLS as f32 / longest;
        let count = [size.x, size.y, size.z].map(|s| ((s * per_length).ceil() as u32).clamp(1, CELLS));
        Self { low, per_length, count }
    }

    fn len(&self) -> usize {
        self.count.iter().product::<u32>() as usize
    }

    #[inline]
    fn of(&self, point: Vec3) -> usize {
        let at = (point - self.low) * self.per_length;
        let [x, y, z] = [0, 1, 2].map(|k| (at[k].max(0.0) as u32).min(self.count[k] - 1));
        ((z * self.count[1] + y) * self.count[0] + x) as usize
    }
}

/// What connections between cells have brought, the cell of the camera's vertex first.
#[derive(Clone, Serialize, Deserialize)]
pub struct Learnt {
    cells: Cells,
    /// Sum of what connections brought, per radiance of the camera's vertex.
    sum: Vec<f64>,
    tried: Vec<u32>,
}

/// One connection's outcome: the pair of cells, and what it brought.
pub type Outcome = (u32, f32);

impl Learnt {
    /// Nothing yet.
    pub fn new(bounds: Bounds) -> Self {
        let cells = Cells::new(bounds);
        let pairs = cells.len() * cells.len();
        Self { cells, sum: vec![0.0; pairs], tried: vec![0; pairs] }
    }

    /// True if the other is of the same cells.
    pub fn fits(&self, other: &Learnt) -> bool {
        self.cells == other.cells && [other.sum.len(), other.tried.len()] == [self.sum.len(); 2]
    }

    /// Adds outcomes; their order is that of the rows, so that sums do not depend on threads.
    pub fn add(&mut self, outcomes: &[Outcome]) {
        for &(pair, brought) in outcomes {
            self.sum[pair as usize] += f64::from(brought);
            self.tried[pair as usize] += 1;
        }
    }
}

/// Vertices of light walks, and from where each is picked how often.
pub struct LightVertices {
    cells: Cells,
    /// Those that are kept, by cell.
    kept: Vec<Vertex>,
    /// First of each cell in `kept`, and their number.
    first: Vec<u32>,
    /// Number of vertices of each cell, kept or not.
    count: Vec<u32>,
    /// For each cell of a camera's vertex the running probability of the cells; empty rows: nothing is known.
    running: Vec<f32>,
    /// Number of walks that they are from.
    walks: f64,
}

/// A vertex picked.
pub struct Pick<'a> {
    /// The vertex.
    pub vertex: &'a Vertex,
    /// 1 over the expected number of times that it is picked instead of being its own walk's: factor of what it brings.
    pub weight: f64,
    /// Its pair of cells.
    pub pair: u32,
}

impl LightVertices {
    /// Those of `walks` light walks; `seed` decides which are kept.
    pub fn new(vertices: &[Vertex], walks: usize, learnt: &Learnt, seed: u64) -> Self {
        let cells = learnt.cells;
        let n = cells.len();
        let of: Vec<u32> = vertices.iter().map(|v| cells.of(v.si.point) as u32).collect();
        let mut count = vec![0_u32; n];
        of.iter().for_each(|&c| count[c as usize] += 1);
        // Every one of a cell is kept with the same probability, at even steps from a random one on.
        let steps = count.iter().map(|&c| f64::from(c) / f64::from(KEPT.min(c.max(1))));
        let mut next: Vec<(f64, f64)> =
            steps.enumerate().map(|(c, step)| (step * unit(mix(seed ^ mix(c as u64)) >> 32), step)).collect();
        let mut first = vec![0_u32; n + 1];
        for c in 0..n {
            first[c + 1] = first[c] + count[c].min(KEPT);
        }
        let mut free = first.clone();
        let mut seen = vec![0_u32; n];
        let mut places = vec![0_u32; first[n] as usize];
        for (i, &c) in of.iter().enumerate() {
            let c = c as usize;
            if f64::from(seen[c]) >= next[c].0.floor() && free[c] < first[c + 1] {
                places[free[c] as usize] = i as u32;
                free[c] += 1;
                next[c].0 += next[c].1;
            }
            seen[c] += 1;
        }
        let kept = places.iter().map(|&i| vertices[i as usize]).collect();
        let all = vertices.len() as f64;
        let mut running = vec![0.0_f32; n * n];
        for (row, running) in running.chunks_mut(n).enumerate() {
            let pairs = row * n..(row + 1) * n;
            let (sum, tried) = (&learnt.sum[pairs.clone()], &learnt.tried[pairs]);
            let total_tried: f64 = tried.iter().map(|t| f64::from(*t)).sum();
            let mean = if total_tried > 0.0 { sum.iter().sum::<f64>() / total_tried } else { 0.0 };
            let count = |c: usize| f64::from(count[c]);
            let wanted = |c: usize| count(c) * (sum[c] + PRIOR * mean) / (f64::from(tried[c]) + PRIOR);
            let total: f64 = (0..n).map(wanted).sum();
            let mut so_far = 0.0;
            for (c, running) in running.iter_mut().enumerate() {
                let uniform = if all > 0.0 { count(c) / all } else { 0.0 };
                so_far += if total > 0.0 { UNIFORM * uniform + (1.0 - UNIFORM) * wanted(c) / total } else { uniform };
                *running = so_far as f32;
            }
        }
        Self { cells, kept, first, count, running, walks: walks as f64 }
    }

    /// Picks one of `picks` vertices for a camera's vertex at `point`; `seed` decides.
    #[inline]
    pub fn pick(&self, point: Vec3, picks: u32, seed: u64) -> Option<Pick<'_>> {
        let n = self.cells.len();
        let here = self.cells.of(point);
        let running = &self.running[here * n..(here + 1) * n];
        let random = mix(seed);
        let target = (unit(random >> 32) * f64::from(running[n - 1])) as f32;
        let there = running.partition_point(|&r| r <= target).min(n - 1);
        let (start, end) = (self.first[there], self.first[there + 1]);
        let before = if there == 0 { 0.0 } else { running[there - 1] };
        let probability = f64::from(running[there] - before) / f64::from(running[n - 1]);
        if start == end || probability <= 0.0 {
            return None;
        }
        let k = start + (((random & 0xffff_ffff) * u64::from(end - start)) >> 32) as u32;
        let vertex = &self.kept[k as usize];
        let weight = f64::from(self.count[there]) / (probability * f64::from(picks) * self.walks);
        Some(Pick { vertex, weight, pair: (here * n + there) as u32 })
    }
}

/// 32 random bits as a number in [0, 1).
#[inline]
fn unit(bits: u64) -> f64 {
    bits as f64 / f64::from(1 << 16) / f64::from(1 << 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::bidirectional::subpath::tests::vertex_at;

    /// However picks are biased by what was learnt, the mean of weighted picks is the sum over all vertices, over walks.
    #[test]
    fn weighted_picks_sum_all_vertices() {
        let bounds = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
        let mut learnt = Learnt::new(bounds);
        let place = |i: u64| {
            let random = mix(i);
            Vec3::new((random & 0xffff) as f32, (random >> 16 & 0xffff) as f32, (random >> 32 & 0xff) as f32 * 16.0) / 65536.0
        };
        let vertices: Vec<Vertex> = (0..40_000).map(|i| vertex_at(place(i))).collect();
        let value = |v: &Vertex| f64::from(v.si.point.x + 2.0 * v.si.point.y * v.si.point.z);
        let want: f64 = vertices.iter().map(value).sum::<f64>() / 1000.0;
        let here = Vec3::splat(0.3);
        let (mut total, mut picks) = (0.0, 0);
        for round in 0..64 {
            let light = LightVertices::new(&vertices, 1000, &learnt, round);
            let mut outcomes = Vec::new();
            for k in 0..2000 {
                let pick = light.pick(here, 3, mix(round << 32 | k)).expect("there are vertices");
                total += 3.0 * pick.weight * value(pick.vertex);
                // One corner is said to be worth much.
                outcomes.push((pick.pair, if pick.vertex.si.point.max_element() < 0.4 { 5.0 } else { 0.1 }));
                picks += 1;
            }
            learnt.add(&outcomes);
        }
        let got = total / f64::from(picks);
        assert!((got / want - 1.0).abs() < 0.02, "{got}, expected {want}");
    }
}
