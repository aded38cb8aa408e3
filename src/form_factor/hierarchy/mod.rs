//! Hierarchical form factors: links between groups of patches [Hanrahan91], [Smits94].
//!
//! Distant groups are linked as wholes, near ones by their patches, so that links grow about linearly with patches where rows
//! would grow quadratically. Which nodes are linked depends on geometry alone, never on the lights. A link holds S_pq = A_p F_pq = A_q F_qp, one
//! number for both directions: reciprocity is exact. Rows are closed by a symmetric scaling of the patches, F -> D F D.

mod beside;
mod kernel;
mod links;
mod near;
mod refine;
mod shrink;
#[cfg(test)]
mod tests;
mod tree;
mod walls;

use super::{Closure, FormFactors, KnownRooms, Outside, RowPart};
use crate::math::Rgb;
use crate::patch::PatchMesh;
use crate::progress::Observer;
use crate::world::World;
use crate::world::walk::RayCounts;
use beside::Beside;
use links::{Links, Spare};
use refine::{Link, Refinement};
use tree::Tree;
use walls::Walls;

/// Sweeps of the scaling that closes rows, at most: rows that face each other closely go on for hundreds, in which no figure of the solution
/// gets any better. What is left goes to the diagonal.
const CLOSING_SWEEPS: usize = 12;
/// Relative defect at which they end.
const CLOSE_ENOUGH: f64 = 1e-7;
/// Most of a row that stays with its patch: in a pocket whose links say next to nothing, a white patch would keep all its light. What is
/// missing beyond is lost, and the defect says so.
const MOST_KEPT: f64 = 0.5;
/// Scales stay within this range: a row of few links must not be blown up.
const SCALES: [f64; 2] = [0.5, 2.0];

/// How links are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HierarchySettings {
    /// Bound on the error that a link may leave to the form factor between its nodes, in either direction.
    pub tolerance: f64,
    /// Rays of a group of patches that look for what links do not hold: the outside, mirrors, glass and gloss.
    pub rays: u32,
    /// Longest chain of specular events.
    pub max_events: u32,
    /// Number of those rays for each shadow ray that a patch sends: light that both find is shared in proportion.
    pub rays_beside_shadow_rays: f64,
    /// Seed of all rays.
    pub seed: u64,
}

/// Rays of a group at a tolerance of 1e-3.
const GROUP_RAYS: f64 = 384.0;

impl HierarchySettings {
    /// Links within `tolerance`, and rays in inverse proportion to it. `shadow_rays`: those that a patch of the full size sends.
    pub fn for_tolerance(tolerance: f64, shadow_rays: f64, seed: u64) -> Self {
        let rays = ((GROUP_RAYS * 1e-3 / tolerance).clamp(64.0, 65536.0) as u32).next_multiple_of(64);
        Self { tolerance, rays, max_events: 64, rays_beside_shadow_rays: f64::from(rays) / shadow_rays, seed }
    }
}

/// The links, ready to be multiplied with.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Hierarchy {
    /// Nodes in preorder, so that children follow their parents.
    nodes: Vec<Span>,
    /// Patch at each place of the tree's order, and where each patch stands in it.
    patch: Vec<u32>,
    place: Vec<u32>,
    /// Links of each node.
    by_node: Links,
    /// Area of the patch at each place [m²].
    area: Vec<f64>,
    /// D by place.
    scale: Vec<f64>,
    /// What scaling leaves of a row, by place: it goes to the patch itself.
    kept: Vec<f64>,
    /// Light by way of mirrors, glass and gloss.
    beside: Beside,
    links: usize,
    /// Rooms that a solver has found.
    rooms: KnownRooms,
    /// Memory of products, in one channel and in three.
    #[serde(skip)]
    spare: (Spare<1>, Spare<4>),
    /// Quality before correction.
    pub closure: Closure,
}

/// What multiplying needs of a node.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Span {
    area: f64,
    first: u32,
    count: u32,
    second: u32,
}

/// Links all patches; `None` if the observer stopped it.
pub fn link(
    world: &World,
    patches: &PatchMesh,
    settings: &HierarchySettings,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Option<(Hierarchy, Outside)> {
    let tree = Tree::new(world, patches);
    let beside = Beside::cast(world, patches, &tree, settings, counts);
    let walls = Walls::new(world, &tree);
    let refinement =
        Refinement { world, patches, tree: &tree, walls: &walls, tolerance: settings.tolerance, seed: settings.seed };
    let (links, rays) = refinement.links(observer)?;
    counts.form_factor += rays;
    let mut hierarchy = Hierarchy::new(tree, links, beside);
    let outside = hierarchy.close();
    Some((hierarchy, outside))
}

impl Hierarchy {
    fn new(tree: Tree, links: Vec<Vec<Link>>, beside: Beside) -> Self {
        let span = |n: &tree::Node| Span { area: n.area, first: n.first, count: n.count, second: n.second };
        let nodes: Vec<Span> = tree.nodes.iter().map(span).collect();
        let mut place = vec![0; tree.patch.len()];
        tree.patch.iter().enumerate().for_each(|(at, &patch)| place[patch as usize] = at as u32);
        let area = tree.leaf.iter().map(|&at| tree.nodes[at as usize].area).collect();
        // What the tree held for making links goes before links are sorted by their nodes.
        let patch = tree.patch;
        drop((tree.nodes, tree.centred, tree.spots, tree.running));
        let n_links = links.iter().map(Vec::len).sum();
        let by_node = Links::new(nodes.len(), links);
        let (scale, kept) = (vec![1.0; place.len()], vec![0.0; place.len()]);
        let closure = Closure::default();
        Self {
            nodes,
            patch,
            place,
            by_node,
            area,
            scale,
            kept,
            beside,
            links: n_links,
            rooms: KnownRooms::default(),
            spare: Default::default(),
            closure,
        }
    }

    /// Number of links, each for both directions, and of entries through specular surfaces.
    pub fn n_nonzero(&self) -> usize {
        self.links + self.beside.len()
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        size_of::<Span>() * self.nodes.len() + 24 * self.place.len() + self.by_node.memory_bytes() + self.beside.memory_bytes()
    }

    /// out_i = sum_j F_ij x_j over what is seen directly, in parallel: the same bits on any number of threads.
    pub fn gather_direct(&self, x: &[Rgb], out: &mut [Rgb]) {
        // Of four numbers the processor adds all at once, of three it does not.
        let of = |place: usize| {
            let [r, g, b] = x[self.patch[place] as usize].to_array();
            [r, g, b, 0.0]
        };
        self.transport(&self.spare.1, of, |place, [r, g, b, _]| out[self.patch[place] as usize] = Rgb::new(r, g, b));
    }

    /// Sums of rows by place: D F D 1 + K 1.
    fn row_sums(&self) -> Vec<f64> {
        let mut sums = vec![0.0; self.place.len()];
        self.transport(&self.spare.0, |_| [1.0], |place, [sum]| sums[place] = sum);
        sums
    }

    /// D F D x + K x by place: means are drawn up the tree, carried along links, and handed down.
    fn transport<const N: usize>(&self, spare: &Spare<N>, x: impl Fn(usize) -> [f64; N], mut put: impl FnMut(usize, [f64; N])) {
        let each = |of: &dyn Fn(usize) -> f64| std::array::from_fn::<f64, N, _>(of);
        let mut mean = spare.take(self.nodes.len());
        for at in (0..self.nodes.len()).rev() {
            let node = self.nodes[at];
            mean[at] = if node.second == 0 {
                let place = node.first as usize;
                x(place).map(|v| v * self.scale[place])
            } else {
                let (a, b) = (at + 1, node.second as usize);
                each(&|k| (mean[a][k] * self.nodes[a].area + mean[b][k] * self.nodes[b].area) * (1.0 / node.area))
            };
        }
        let mut arrived = self.by_node.carry(&mean, spare);
        for at in 0..self.nodes.len() {
            let node = self.nodes[at];
            // What arrives at the nodes above is in it already.
            let here = arrived[at].map(|v| v * (1.0 / node.area));
            if node.second == 0 {
                let (place, v) = (node.first as usize, x(node.first as usize));
                put(place, each(&|k| here[k] * self.scale[place] + v[k] * self.kept[place]));
            } else {
                for child in [at + 1, node.second as usize] {
                    let area = self.nodes[child].area;
                    (0..N).for_each(|k| arrived[child][k] += here[k] * area);
                }
            }
        }
        spare.give(mean);
        spare.give(arrived);
    }

    /// The nodes that hold `place`, from the root to its patch.
    fn above(&self, place: u32) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors((!self.nodes.is_empty()).then_some(0), move |&at| {
            let second = self.nodes[at].second as usize;
            (second != 0).then(|| if place < self.nodes[second].first { at + 1 } else { second })
        })
    }

    /// Shows what a link from node `at`, which holds `place`, to another one is in the row of `place`.
    fn spread(&self, place: u32, (at, other): (usize, usize), transfer: f32, visit: &mut dyn FnMut(usize, Rgb)) {
        let (node, other) = (self.nodes[at], self.nodes[other]);
        let factor = f64::from(transfer) / node.area * self.scale[place as usize];
        for seen in other.first..other.first + other.count {
            let j = self.patch[seen as usize] as usize;
            visit(j, Rgb::grey(factor * self.scale[seen as usize] * self.area[seen as usize] / other.area));
        }
    }

    /// Shows what a row holds besides its links.
    fn row_beside_links(&self, place: u32, visit: &mut dyn FnMut(usize, Rgb)) {
        let kept = self.kept[place as usize];
        if kept > 0.0 {
            visit(self.patch[place as usize] as usize, Rgb::grey(kept));
        }
        self.beside.row(place as usize, visit);
    }

    /// Closes the rows and says what goes elsewhere.
    ///
    /// A row whose group sends all its rays to patches sums to 1. Another one sums to what its links say, and what goes elsewhere takes the
    /// rest. The scaling is a symmetric Sinkhorn iteration [Sinkhorn64]; rows that it leaves too large are scaled down, which makes no
    /// other one larger, and what is then missing, up to a half, stays with the patch itself: transport remains symmetric.
    fn close(&mut self) -> Outside {
        let raw = self.row_sums();
        let target = self.beside.targets(&raw, &self.area);
        for _ in 0..CLOSING_SWEEPS {
            let sums = self.row_sums();
            let mut worst: f64 = 0.0;
            for ((scale, sum), target) in self.scale.iter_mut().zip(&sums).zip(&target) {
                if *sum > 0.0 && *target > 0.0 {
                    let ratio = target / sum;
                    let next = (*scale * ratio.sqrt()).clamp(SCALES[0], SCALES[1]);
                    if next != *scale {
                        worst = worst.max((ratio - 1.0).abs());
                    }
                    *scale = next;
                }
            }
            if worst < CLOSE_ENOUGH {
                break;
            }
        }
        let sums = self.row_sums();
        for ((scale, sum), target) in self.scale.iter_mut().zip(&sums).zip(&target) {
            *scale *= if sum > target { target / sum } else { 1.0 };
        }
        let sums = self.row_sums();
        for ((kept, sum), target) in self.kept.iter_mut().zip(&sums).zip(&target) {
            *kept = (target - sum).clamp(0.0, MOST_KEPT);
        }
        let elsewhere = |at: usize| self.beside.share_elsewhere(at);
        let rows = raw.iter().enumerate().map(|(at, sum)| sum + elsewhere(at));
        let (low, high) = rows.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| (l.min(s), h.max(s)));
        let outside = self.beside.complete(&target, &self.place);
        let closed = self.row_sums();
        self.closure = Closure {
            row_sum_min: if low.is_finite() { low } else { 0.0 },
            row_sum_max: if high.is_finite() { high } else { 0.0 },
            escaped_max: (0..self.place.len()).map(|i| outside.escaped(i).max()).fold(0.0, f64::max),
            reciprocity_defect: 0.0,
            corrected_defect: Closure::mean_defect((0..closed.len()).map(|at| (self.area[at], closed[at], target[at]))),
        };
        outside
    }
}

impl FormFactors for Hierarchy {
    fn len(&self) -> usize {
        self.place.len()
    }

    fn gather(&self, x: &[Rgb], out: &mut [Rgb]) {
        self.gather_direct(x, out);
        self.beside.add(x, &self.place, out);
    }

    fn row(&self, i: usize, visit: &mut dyn FnMut(usize, Rgb)) {
        let place = self.place[i];
        self.row_beside_links(place, visit);
        for at in self.above(place) {
            self.by_node.of(at).for_each(|(other, transfer)| self.spread(place, (at, other as usize), transfer, visit));
        }
    }

    fn some_rows(&self, patches: &[usize], visit: &mut RowPart<'_>) {
        // Which of them lie in each node: few nodes hold any.
        let mut held: Vec<(usize, usize)> = Vec::new();
        for (k, &i) in patches.iter().enumerate() {
            self.row_beside_links(self.place[i], &mut |j, f| visit(k, 1.0, &[(j as u32, f.mean())]));
            held.extend(self.above(self.place[i]).map(|at| (at, k)));
        }
        held.sort_unstable();
        let mut start = vec![0_u32; self.nodes.len() + 1];
        held.iter().for_each(|(at, _)| start[at + 1] += 1);
        (0..self.nodes.len()).for_each(|at| start[at + 1] += start[at]);
        let entry = |(at, &patch): (usize, &u32)| (patch, self.scale[at] * self.area[at]);
        let entries: Vec<(u32, f64)> = self.patch.iter().enumerate().map(entry).collect();
        let mut show = |at: usize, other: usize, transfer: f32| {
            for &(_, k) in &held[start[at] as usize..start[at + 1] as usize] {
                let other = self.nodes[other];
                let scale = self.scale[self.place[patches[k]] as usize];
                let factor = f64::from(transfer) * scale / (self.nodes[at].area * other.area);
                visit(k, factor, &entries[other.first as usize..(other.first + other.count) as usize]);
            }
        };
        for at in 0..self.nodes.len() {
            let (others, transfers) = self.by_node.upper(at);
            for (&other, &transfer) in others.iter().zip(transfers) {
                show(at, other as usize, transfer);
                if other as usize != at {
                    show(other as usize, at, transfer);
                }
            }
        }
    }

    fn known_rooms(&self) -> Option<&KnownRooms> {
        Some(&self.rooms)
    }

    fn join(&self, pair: &mut dyn FnMut(usize, usize)) {
        let patch = |place: u32| self.patch[place as usize] as usize;
        // All patches of a linked node are joined by what it is linked to; in preorder the largest such node comes first. `block`: its number,
        // of each node.
        let mut is_linked = vec![false; self.nodes.len()];
        for at in 0..self.nodes.len() {
            let others = self.by_node.upper(at).0;
            is_linked[at] |= !others.is_empty();
            others.iter().for_each(|&other| is_linked[other as usize] = true);
        }
        let (mut joined, mut blocks) = (0, 0_u32);
        let mut block = vec![u32::MAX; self.nodes.len()];
        for (at, node) in self.nodes.iter().enumerate() {
            if node.first >= joined && is_linked[at] {
                joined = node.first + node.count;
                blocks += 1;
                (node.first..joined - 1).for_each(|place| pair(patch(place), patch(place + 1)));
            }
            block[at] = if node.first < joined { blocks } else { u32::MAX };
        }
        // Each link is one of both its nodes. Most lead to where another has led.
        let mut last = vec![u32::MAX; blocks as usize + 1];
        for (at, node) in self.nodes.iter().enumerate() {
            for &other in self.by_node.upper(at).0 {
                // Blocks are in the order of nodes.
                let (here, there) = (block[at], block[other as usize]);
                if here < there && last[there as usize] != here {
                    last[there as usize] = here;
                    pair(patch(node.first), patch(self.nodes[other as usize].first));
                }
            }
        }
        self.beside.join(&self.patch, pair);
    }

    fn is_reciprocal(&self) -> bool {
        self.beside.len() == 0
    }
}
