//! The tree over all patches: nodes are groups of patches that lie near each other and face alike.
//!
//! It is binary and made from the top: groups are parted by direction until they face alike, then across their longest side, where sides
//! along the normal count more, so that a table and the floor below it part early. Flat nodes have kernels that vary little.

use crate::geometry::{Bounds, Ray, offset_origin};
use crate::math::{Sampler, Vec3};
use crate::patch::{PatchId, PatchMesh, outline};
use crate::world::World;
use rayon::prelude::*;

/// Points of a node at which kernels are evaluated.
pub const SPOTS: usize = 4;
/// Groups whose normals differ more than this along an axis are parted by direction.
const ALIKE: f32 = 0.75;
/// Extents along the mean normal count this much more than those across, when it is decided where to part.
const ALONG_NORMAL: f32 = 3.0;
/// Height above a node, in its radii, at which its parts should see each other.
const TORN_HEIGHT: f32 = 0.25;
/// Normals that differ by less are one: rounding [rad].
const ONE_NORMAL: f32 = 2e-3;
/// A point of a surface, as links see it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Spot {
    /// The point.
    pub point: Vec3,
    /// Unit normal on the patch's side.
    pub normal: Vec3,
    /// Distance by which rays are lifted off the surface: a bound on the rounding of the point.
    pub lift: f32,
}

/// A group of patches.
#[derive(Debug, Clone)]
pub struct Node {
    /// Box.
    pub bounds: Bounds,
    /// Area-weighted mean of its points.
    pub center: Vec3,
    /// Radius of a ball around the centre that holds it [m].
    pub radius: f32,
    /// Area-weighted mean normal, of unit length.
    pub axis: Vec3,
    /// Largest angle between a normal and the axis [rad].
    pub spread: f32,
    /// Lowest and highest point along the axis, relative to the centre [m].
    pub slab: [f32; 2],
    /// Area [m²].
    pub area: f64,
    /// First patch in the order of the tree.
    pub first: u32,
    /// Number of patches.
    pub count: u32,
    /// The second child; the first follows its parent. 0: a leaf.
    pub second: u32,
}

impl Node {
    /// True if it is a single patch.
    #[inline]
    pub fn is_leaf(&self) -> bool {
        self.second == 0
    }
}

/// Nodes in preorder, and the patches in the order of the leaves.
pub struct Tree {
    /// The nodes; the root comes first.
    pub nodes: Vec<Node>,
    /// Patch at each place.
    pub patch: Vec<u32>,
    /// Node of the leaf at each place.
    pub leaf: Vec<u32>,
    /// Points of each node whose mean is the node's centre, for kernels that nothing hides.
    pub centred: Vec<[Spot; SPOTS]>,
    /// Points of the patch at each place, for rays.
    pub spots: Vec<[Spot; SPOTS]>,
    /// Running area up to and including each place [m²].
    pub running: Vec<f64>,
    /// How much of each node a wall parts from the rest: 0 for none of it, 1 for half of it, and the root of the share between.
    pub torn: Vec<f32>,
    /// Smallest height above a plane that counts [m].
    pub flat: f32,
}

/// What a leaf is made from.
struct Leaf {
    node: Node,
    spots: [Spot; SPOTS],
}

impl Tree {
    /// Builds the tree.
    pub fn new(world: &World, patches: &PatchMesh) -> Self {
        let n = patches.len();
        let leaves: Vec<Leaf> = (0..n as u32).into_par_iter().map(|i| leaf(world, patches, PatchId(i))).collect();
        let mut tree = Self {
            nodes: Vec::with_capacity((2 * n).saturating_sub(1)),
            patch: (0..n as u32).collect(),
            leaf: vec![0; n],
            centred: Vec::with_capacity((2 * n).saturating_sub(1)),
            spots: Vec::with_capacity(n),
            running: Vec::with_capacity(n),
            torn: Vec::new(),
            flat: 1e-6 * world.bounds().diagonal(),
        };
        let mut order = std::mem::take(&mut tree.patch);
        if n > 0 {
            tree.add(&leaves, &mut order, 0);
        }
        let mut running = 0.0;
        for &patch in &order {
            tree.spots.push(leaves[patch as usize].spots);
            running += leaves[patch as usize].node.area;
            tree.running.push(running);
        }
        tree.patch = order;
        for at in 0..tree.nodes.len() {
            let spots = tree.centred_spots(at);
            tree.centred.push(spots);
        }
        let by_itself: Vec<bool> =
            (0..tree.nodes.len()).into_par_iter().with_min_len(256).map(|at| tree.is_torn(world, at)).collect();
        tree.torn = vec![0.0; tree.nodes.len()];
        for at in (0..tree.nodes.len()).rev().filter(|&at| !tree.nodes[at].is_leaf()) {
            let parts = [at + 1, tree.nodes[at].second as usize];
            let share = |part: usize| (tree.nodes[part].area / tree.nodes[at].area) as f32;
            let below = parts.map(|part| tree.torn[part] * share(part).sqrt());
            let own = if by_itself[at] { (2.0 * share(parts[0]).min(share(parts[1]))).sqrt() } else { 0.0 };
            tree.torn[at] = own.max(below[0]).max(below[1]);
        }
        tree
    }

    /// Adds the node of `group`, which begins at place `first`, and those below it; its index.
    fn add(&mut self, leaves: &[Leaf], group: &mut [u32], first: u32) -> u32 {
        let index = self.nodes.len() as u32;
        if let [patch] = group {
            self.leaf[first as usize] = index;
            self.nodes.push(Node { first, ..leaves[*patch as usize].node.clone() });
            return index;
        }
        let middle = part(leaves, group);
        self.nodes.push(leaves[group[0] as usize].node.clone());
        let (low, high) = group.split_at_mut(middle);
        let a = self.add(leaves, low, first);
        let b = self.add(leaves, high, first + middle as u32);
        let joined = Node { first, second: b, ..join(&self.nodes[a as usize], &self.nodes[b as usize]) };
        self.nodes[index as usize] = joined;
        index
    }

    /// A point of node `at`, picked by area: `u` in [0, 1) picks the patch, `k` one of its points.
    #[inline]
    pub fn spot(&self, at: usize, u: f64, k: usize) -> &Spot {
        let node = &self.nodes[at];
        let range = node.first as usize..(node.first + node.count) as usize;
        if node.count == 1 {
            return &self.spots[range.start][k % SPOTS];
        }
        let before = if range.start == 0 { 0.0 } else { self.running[range.start - 1] };
        let target = before + u * (self.running[range.end - 1] - before);
        let place = range.start + self.running[range.clone()].partition_point(|&a| a <= target).min(node.count as usize - 1);
        &self.spots[place][k % SPOTS]
    }

    /// Points spread over node `at`, moved so that their mean is its centre: a linear kernel is then integrated exactly.
    fn centred_spots(&self, at: usize) -> [Spot; SPOTS] {
        let node = &self.nodes[at];
        let mut spots: [Spot; SPOTS] = std::array::from_fn(|k| *self.spot(at, (k as f64 + 0.5) / SPOTS as f64, k));
        let shift = node.center - spots.iter().map(|s| s.point).sum::<Vec3>() / SPOTS as f32;
        spots.iter_mut().for_each(|s| s.point += shift);
        spots
    }
}

impl Tree {
    /// True if what stands on node `at` hides its two parts from each other, for most of some points above them.
    fn is_torn(&self, world: &World, at: usize) -> bool {
        let node = &self.nodes[at];
        if node.is_leaf() {
            return false;
        }
        let height = TORN_HEIGHT * node.radius;
        let above = |spot: &Spot| {
            let off = offset_origin(spot.point, Vec3::splat(spot.lift), spot.normal, spot.normal);
            let raised = off + spot.normal * height;
            (!world.occluded(&Ray::between(off, raised))).then_some(raised)
        };
        let hidden = (0..SPOTS).filter(|&k| {
            let share = (k as f64 + 0.5) / SPOTS as f64;
            let (a, b) = (self.spot(at + 1, share, k), self.spot(node.second as usize, share, k + k / 2));
            above(a).zip(above(b)).is_none_or(|(a, b)| world.occluded(&Ray::between(a, b)))
        });
        2 * hidden.count() >= SPOTS
    }
}

/// What is known of one patch.
fn leaf(world: &World, patches: &PatchMesh, id: PatchId) -> Leaf {
    let i = id.0 as usize;
    let spots: [Spot; SPOTS] = std::array::from_fn(|k| {
        let si = patches.sample(world, id, Sampler::new(0x5907, u64::from(id.0), k as u64).next_2d());
        Spot { point: si.point, normal: si.ng, lift: si.error.abs().max_element() }
    });
    let center = patches.centroid[i];
    let axis = if patches.normal[i] == Vec3::ZERO { Vec3::Z } else { patches.normal[i] };
    let outlines = patches.outlines(world, id);
    let corners: Vec<Vec3> = outlines.iter().flatten().map(|p| p.as_vec3()).collect();
    let all = || corners.iter().copied().chain(spots.iter().map(|s| s.point));
    let heights = all().map(|p| (p - center).dot(axis));
    let slab = heights.fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)]);
    let radius = all().map(|p| p.distance(center)).fold(0.0, f32::max);
    let normals = outlines.iter().map(|o| outline::winding(o).normalize_or(axis.as_dvec3()).as_vec3());
    let angles = normals.chain(spots.iter().map(|s| s.normal)).map(|n| n.dot(axis).clamp(-1.0, 1.0).acos());
    let spread = angles.fold(0.0, f32::max);
    let bounds: Bounds = all().collect();
    let node = Node {
        bounds,
        center,
        radius,
        axis,
        spread: if spread < ONE_NORMAL { 0.0 } else { spread },
        slab,
        area: patches.area[i],
        first: 0,
        count: 1,
        second: 0,
    };
    Leaf { node, spots }
}

/// Orders `group` into two parts; the number of the first.
fn part(leaves: &[Leaf], group: &mut [u32]) -> usize {
    let node = |i: u32| &leaves[i as usize].node;
    let places: Bounds = group.iter().map(|&i| node(i).center).collect();
    let normals: Bounds = group.iter().map(|&i| node(i).axis).collect();
    let middle = if (normals.max - normals.min).max_element() > ALIKE {
        let axis = (normals.max - normals.min).max_position();
        let at = normals.center()[axis];
        divide(group, |i| node(i).axis[axis] < at)
    } else {
        let mean = group.iter().map(|&i| node(i).axis).sum::<Vec3>().normalize_or_zero();
        let axis = ((places.max - places.min) * (Vec3::ONE + ALONG_NORMAL * mean.abs())).max_position();
        let at = places.center()[axis];
        divide(group, |i| node(i).center[axis] < at)
    };
    // All in one place: in halves.
    if middle == 0 || middle == group.len() { group.len() / 2 } else { middle }
}

/// Moves those of which `is_low` holds to the front, each part in the order it had; their number.
fn divide(group: &mut [u32], is_low: impl Fn(u32) -> bool) -> usize {
    let (low, high): (Vec<u32>, Vec<u32>) = group.iter().partition(|&&i| is_low(i));
    group[..low.len()].copy_from_slice(&low);
    group[low.len()..].copy_from_slice(&high);
    low.len()
}

/// The node over two others.
fn join(a: &Node, b: &Node) -> Node {
    let area = a.area + b.area;
    let share = (b.area / area) as f32;
    let center = a.center + (b.center - a.center) * share;
    let bounds = a.bounds.union(b.bounds);
    let reach = |node: &Node| node.center.distance(center) + node.radius;
    let corner = (bounds.max - center).max(center - bounds.min).length();
    let sum = a.axis * a.area as f32 + b.axis * b.area as f32;
    let axis = sum.normalize_or(a.axis);
    let angle = |node: &Node| node.axis.dot(axis).clamp(-1.0, 1.0).acos() + node.spread;
    let extent = |node: &Node| {
        let at = (node.center - center).dot(axis);
        if node.axis.dot(axis) > 1.0 - 1e-6 {
            return [at + node.slab[0], at + node.slab[1]];
        }
        let (middle, half) = (node.bounds.center(), 0.5 * (node.bounds.max - node.bounds.min));
        let (at, half) = ((middle - center).dot(axis), half.dot(axis.abs()));
        [at - half, at + half]
    };
    let (low, high) = (extent(a), extent(b));
    let spread = angle(a).max(angle(b));
    Node {
        bounds,
        center,
        radius: reach(a).max(reach(b)).min(corner),
        axis,
        spread: if spread < ONE_NORMAL { 0.0 } else { spread.min(std::f32::consts::PI) },
        slab: [low[0].min(high[0]), low[1].max(high[1])],
        area,
        first: 0,
        count: a.count + b.count,
        second: 0,
    }
}
