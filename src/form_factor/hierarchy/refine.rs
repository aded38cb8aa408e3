//! Which nodes are linked: pairs are divided until the kernel between them varies little, or both are patches.

use super::kernel::{self, Variation};
use super::near::Pair;
use super::tree::{SPOTS, Spot, Tree};
use super::walls::Walls;
use crate::geometry::{Ray, offset_origin};
use crate::math::{Vec3, sampler::mix};
use crate::patch::PatchMesh;
use crate::progress::{Observer, Progress, Stage};
use crate::world::{KnownOccluders, World};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// Pairs that are worked on side by side.
const TASKS: usize = 4096;
/// Of these, between two looks at the observer.
const BATCH: usize = 256;
/// Fewest rays by which the visible share of a pair is measured.
const FEWEST_RAYS: u32 = 2;
/// The same between two patches: what they exchange is in no other link.
const FEWEST_BETWEEN_PATCHES: u32 = 4;
/// Most rays.
const MOST_RAYS: u32 = 16;
/// The error that visibility leaves to a form factor may be this many times that of its kernel: it is random, and averages out.
const VISIBILITY_SHARE: f64 = 4.0;

/// Walls are asked about nodes of so many patches or more.
const FEWEST_BEHIND_WALLS: u32 = 4;

/// Nodes that are near each other may exchange this many times what their middles say.
const SURELY: f64 = 2.0;

/// The bound on how a kernel varies may be this many times the tolerance: it holds for the corners that it varies most between, and what a link leaves out
/// is a mean over all points.
const KERNEL_SLACK: f64 = 1.3;
/// What a wall parts is linked as one only if what passes is below this share of the tolerance: all such links err alike.
const TORN_SHARE: f64 = 1.0 / 16.0;

/// Transfer between all patches of two nodes, in both directions.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Link {
    /// The first node; its index is not larger than the second's.
    pub first: u32,
    /// The second node.
    pub second: u32,
    /// S = A_p F_pq = A_q F_qp [m²].
    pub transfer: f32,
}

/// What pairs are asked.
pub struct Refinement<'a> {
    /// The scene.
    pub world: &'a World,
    /// Its patches.
    pub patches: &'a PatchMesh,
    /// The tree over them.
    pub tree: &'a Tree,
    /// The largest surfaces.
    pub walls: &'a Walls,
    /// Bound on the error of F_pq and of F_qp that a link may leave.
    pub tolerance: f64,
    /// Seed of the rays.
    pub seed: u64,
}

/// What becomes of a pair.
enum Verdict {
    /// Nothing passes between them.
    Apart,
    /// It is divided.
    Divided([(u32, u32); 2]),
    /// Pairs of a node with itself make three.
    Within([(u32, u32); 3]),
    /// Both are patches, and near each other.
    Near(Pair),
    /// It is a link, whose form factor in either direction is about this at most.
    Linked(f64),
}

/// Rays between pairs, cast one after the other.
#[derive(Default)]
pub(super) struct Casting {
    /// How many.
    pub rays: u64,
    known: KnownOccluders,
}

/// What has become of the pairs of a task.
#[derive(Default)]
struct Found {
    links: Vec<Link>,
    near: Vec<Pair>,
    rays: u64,
}

impl Refinement<'_> {
    /// All links by task, in an order that depends on nothing but the tree; and the number of rays cast. `None` if the observer stopped it.
    pub fn links(&self, observer: &mut Observer<'_>) -> Option<(Vec<Vec<Link>>, u64)> {
        let (mut links, mut near, mut rays) = (Vec::new(), Vec::new(), 0);
        if self.tree.nodes.is_empty() {
            return Some((links, rays));
        }
        let tasks = self.tasks();
        for (done, batch) in tasks.chunks(BATCH).enumerate() {
            let found: Vec<Found> = batch.par_iter().with_max_len(1).map(|&pair| self.descend(pair)).collect();
            for mut of_task in found {
                of_task.links.shrink_to_fit();
                links.push(of_task.links);
                near.extend(of_task.near);
                rays += of_task.rays;
            }
            let progress = Progress { stage: Stage::FormFactors, done: ((done + 1) * BATCH) as f64, total: tasks.len() as f64 };
            if let ControlFlow::Break(()) = observer(&progress) {
                return None;
            }
        }
        let (near, of_near) = self.near_links(near, observer)?;
        links.extend(near);
        Some((links, rays + of_near))
    }

    /// Pairs that together hold all links, many enough to keep threads busy.
    fn tasks(&self) -> Vec<(u32, u32)> {
        let mut tasks = vec![(0, 0)];
        while tasks.len() < TASKS {
            let mut next = Vec::with_capacity(3 * tasks.len());
            for &pair in &tasks {
                match self.judge(pair) {
                    Verdict::Apart => {}
                    Verdict::Divided(pairs) => next.extend(pairs),
                    Verdict::Within(pairs) => next.extend(pairs),
                    Verdict::Linked(_) | Verdict::Near(_) => next.push(pair),
                }
            }
            if next.len() == tasks.len() {
                return next;
            }
            tasks = next;
        }
        tasks
    }

    fn descend(&self, pair: (u32, u32)) -> Found {
        let (mut found, mut casting, mut stack) = (Found::default(), Casting::default(), vec![pair]);
        while let Some(pair) = stack.pop() {
            match self.judge(pair) {
                Verdict::Apart => {}
                Verdict::Divided(pairs) => stack.extend(pairs),
                Verdict::Within(pairs) => stack.extend(pairs),
                Verdict::Near(pair) => found.near.push(pair),
                Verdict::Linked(most) => {
                    let transfer = self.transfer(pair, most, &mut casting);
                    if transfer > 0.0 {
                        found.links.push(Link { first: pair.0, second: pair.1, transfer: transfer as f32 });
                    }
                }
            }
        }
        found.rays = casting.rays;
        found
    }

    fn judge(&self, (p, q): (u32, u32)) -> Verdict {
        let (a, b) = (&self.tree.nodes[p as usize], &self.tree.nodes[q as usize]);
        if p == q {
            return match (a.is_leaf(), a.spread) {
                // A flat patch does not see itself.
                (true, 0.0) => Verdict::Apart,
                (true, _) => Verdict::Linked(1.0),
                _ => Verdict::Within([(p + 1, p + 1), (a.second, a.second), (p + 1, a.second)]),
            };
        }
        let Some(Variation { kernel, most, mut first_weighs_more }) = kernel::variation(a, b, self.tree.flat) else {
            return Verdict::Apart;
        };
        let larger = a.area.max(b.area);
        if a.is_leaf() && b.is_leaf() {
            let (small, large) = if a.area <= b.area { (p, q) } else { (q, p) };
            return match self.is_near(p, q) {
                true => Verdict::Near((small, large, (most * larger) as f32)),
                false => Verdict::Linked(most * larger),
            };
        }
        // Of few patches it is as cheap to cast rays.
        if a.count.min(b.count) >= FEWEST_BEHIND_WALLS && self.walls.part(self.tree, p as usize, q as usize) {
            return Verdict::Apart;
        }
        if kernel * larger <= self.tolerance * KERNEL_SLACK {
            let torn = [p, q].map(|at| self.tree.torn[at as usize]);
            if most * larger * f64::from(torn[0].max(torn[1])) <= self.tolerance * TORN_SHARE {
                return Verdict::Linked(most * larger);
            }
            first_weighs_more = torn[0] * a.radius >= torn[1] * b.radius;
        }
        // Indices of pairs stay in order, so that a link is known by its nodes alone.
        let ordered = |x: u32, y: u32| (x.min(y), x.max(y));
        if !a.is_leaf() && (first_weighs_more || b.is_leaf()) {
            Verdict::Divided([ordered(p + 1, q), ordered(a.second, q)])
        } else {
            Verdict::Divided([ordered(p, q + 1), ordered(p, b.second)])
        }
    }

    /// A_p F_pq [m²]: what there would be if nothing hid them, times the share of it that is visible. `most`: about the most that the form
    /// factor may be.
    fn transfer(&self, (p, q): (u32, u32), most: f64, cast: &mut Casting) -> f64 {
        match p == q {
            true => self.transfer_by((p, q), most, &|| self.with_itself(p as usize), cast),
            false => self.transfer_by((p, q), most, &|| kernel::unobstructed(self.tree, p as usize, q as usize), cast),
        }
    }

    /// The same with what there would be if nothing hid them, `whole`.
    pub(super) fn transfer_by(&self, (p, q): (u32, u32), most: f64, whole: &dyn Fn() -> f64, cast: &mut Casting) -> f64 {
        let (a, b) = (&self.tree.nodes[p as usize], &self.tree.nodes[q as usize]);
        let fewest = if a.is_leaf() && b.is_leaf() { FEWEST_BETWEEN_PATCHES } else { FEWEST_RAYS };
        // Standard error of a share is at most 1/(2 sqrt n).
        let wanted = |factor: f64| (factor / (2.0 * VISIBILITY_SHARE * self.tolerance)).powi(2).ceil() as u32;
        // Most pairs that get few rays are hidden: what there would be is then not asked for.
        if wanted(SURELY * most) <= fewest {
            let share = self.visible_share(p as usize, q as usize, fewest, cast);
            return if share > 0.0 { share * whole() } else { 0.0 };
        }
        let whole = whole();
        let factor = whole / a.area.min(b.area);
        if factor <= 0.0 {
            return 0.0;
        }
        whole * self.visible_share(p as usize, q as usize, wanted(factor).clamp(fewest, MOST_RAYS), cast)
    }

    /// A_p F_pp [m²] of a patch that is not flat, as if its parts hid nothing.
    fn with_itself(&self, p: usize) -> f64 {
        let area = self.tree.nodes[p].area;
        let spots = &self.tree.centred[p];
        let pairs = spots.iter().flat_map(|x| spots.iter().map(move |y| kernel::between(x, y, area)));
        (area * area * pairs.sum::<f64>() / (SPOTS * (SPOTS - 1)) as f64).min(area)
    }

    /// Share of the transfer between two nodes that nothing hides, by `n` rays between them, weighted by what they carry.
    fn visible_share(&self, p: usize, q: usize, n: u32, cast: &mut Casting) -> f64 {
        let key = mix(self.seed ^ mix((p as u64) << 32 | q as u64));
        // A lattice of rank one, shifted at random: both ends of the rays are stratified.
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let shift = |bits: u64| (bits & 0xffff_ffff) as f64 / 4_294_967_296.0;
        let (du, dv, turn) = (shift(key), shift(key >> 32), (key >> 17) as usize);
        let disk = self.tree.nodes[p].area.min(self.tree.nodes[q].area);
        let (mut seen, mut all) = (0.0, 0.0);
        for k in 0..n {
            let (u, v) = ((f64::from(k) + du) / f64::from(n), (f64::from(k) * GOLDEN + dv).fract());
            let k = k as usize + turn;
            let (x, y) = (self.tree.spot(p, u, k), self.tree.spot(q, v, k + k / SPOTS));
            let weight = kernel::between(x, y, disk);
            if weight > 0.0 {
                all += weight;
                cast.rays += 1;
                seen += if self.world.occluded_as_known(&segment(x, y), &mut cast.known) { 0.0 } else { weight };
            }
        }
        if all > 0.0 { seen / all } else { 0.0 }
    }
}

/// The ray from one surface point to another, off both surfaces.
fn segment(x: &Spot, y: &Spot) -> Ray {
    let d = y.point - x.point;
    let off = |s: &Spot, towards: Vec3| offset_origin(s.point, Vec3::splat(s.lift), s.normal, towards);
    Ray::between(off(x, d), off(y, -d))
}
