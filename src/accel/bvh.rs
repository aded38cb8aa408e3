//! Binary trees built by obvhs, and their plain traversal with the shared watertight triangle test.
//!
//! obvhs' own triangle test is not used: it rejects hits with a barycentric of -0.0, so axis-aligned walls leak at diagonals.

use std::sync::Arc;

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

use super::query::{Query, inclusive, is_better};
use super::{Accel, Hit, Ray, Soup};
use crate::geometry::Bounds;
use crate::math::Vec3A;

/// Deepest tree that is traversed; a deeper one is built anew by halving, which has depth log2(n).
const MAX_DEPTH: usize = 96;

/// Binary tree whose leaves hold one primitive each.
pub struct Tree {
    /// Root first; an inner node's children lie at `first_index` and `first_index + 1`; a leaf's `first_index` is its primitive.
    pub nodes: Vec<Bvh2Node>,
}

impl Tree {
    /// Builds the tree over all primitives with finite boxes; the others can hit nothing.
    ///
    /// Parallel agglomerative clustering, then reinsertion of the 5 % largest nodes. obvhs' presets search only direct Morton
    /// neighbours in the first passes (`search_depth_threshold` above 0); on walls cut into equal squares all costs tie there
    /// and the bad merges stay: node area 300 instead of 41 times the root's, and rays ten times slower. Hence 0.
    pub fn build(soup: &Soup, max_depth: usize) -> Tree {
        let boxes: Vec<Bounds> = (0..soup.len() as u32).map(|i| soup.bounds_of(i)).collect();
        let finite = |b: &Bounds| b.min.is_finite() && b.max.is_finite();
        let indices: Vec<u32> = (0..soup.len() as u32).filter(|&i| finite(&boxes[i as usize])).collect();
        let aabbs: Vec<Aabb> = indices.iter().map(|&i| to_aabb(&boxes[i as usize])).collect();
        let tree = Tree { nodes: cluster(&aabbs) };
        let mut tree = if tree.depth() > max_depth { Tree { nodes: halve(&aabbs) } } else { tree };
        for leaf in tree.nodes.iter_mut().filter(|n| n.is_leaf()) {
            leaf.first_index = indices[leaf.first_index as usize];
        }
        tree
    }

    /// Nodes on the longest way from the root to a leaf; 0 for the empty tree.
    pub fn depth(&self) -> usize {
        let mut deepest = 0;
        let mut open: Vec<(u32, usize)> = if self.nodes.is_empty() { Vec::new() } else { vec![(0, 1)] };
        while let Some((index, depth)) = open.pop() {
            deepest = deepest.max(depth);
            let node = &self.nodes[index as usize];
            if !node.is_leaf() {
                open.extend([(node.first_index, depth + 1), (node.first_index + 1, depth + 1)]);
            }
        }
        deepest
    }
}

fn to_aabb(bounds: &Bounds) -> Aabb {
    Aabb::new(Vec3A::from(bounds.min), Vec3A::from(bounds.max))
}

/// obvhs' builder with the safe parameters.
fn cluster(aabbs: &[Aabb]) -> Vec<Bvh2Node> {
    if aabbs.is_empty() {
        return Vec::new();
    }
    let indices = (0..aabbs.len() as u32).collect();
    let mut bvh: Bvh2 = PlocBuilder::with_capacity(aabbs.len()).build(
        PlocSearchDistance::Medium,
        &loosened(aabbs),
        indices,
        SortPrecision::U64,
        0,
    );
    tighten(&mut bvh, aabbs);
    ReinsertionOptimizer::default().run(&mut bvh, 0.05, None);
    bvh.nodes
}

/// The boxes, each grown by up to a thousandth of its size, differently for each.
///
/// Clustering merges pairs that choose each other. Where many boxes are equal, or equally spaced, all choose to the same side,
/// one pair is merged in a pass and the build takes quadratic time: 25,000 duplicates took 13 s, and take 20 ms this way.
fn loosened(aabbs: &[Aabb]) -> Vec<Aabb> {
    let all = aabbs.iter().fold(Aabb::empty(), |all, b| all.union(b));
    let diagonal = all.diagonal().length();
    // Enough to be seen at the scene's coordinates in f32, and for a scene that is a single point.
    let reach = all.min.abs().max(all.max.abs()).max_element().max(diagonal);
    let least = if reach > 0.0 { 4.0 * f32::EPSILON * reach } else { 1.0 };
    let loosen = |(index, b): (usize, &Aabb)| {
        let random = (index as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let part = |shift: u32| (1 + ((random >> shift) & 0x3ff)) as f32 / 1024.0;
        let grow = (1e-3 * b.diagonal() + Vec3A::splat(least)) * Vec3A::new(part(34), part(44), part(54));
        Aabb::new(b.min - grow, b.max + grow)
    };
    aabbs.iter().enumerate().map(loosen).collect()
}

/// Gives a fresh tree, in which children follow their parents, the true boxes.
fn tighten(bvh: &mut Bvh2, aabbs: &[Aabb]) {
    assert!(bvh.children_are_ordered_after_parents, "obvhs places children after their parents before reinsertion");
    for index in (0..bvh.nodes.len()).rev() {
        let (first, is_leaf) = (bvh.nodes[index].first_index as usize, bvh.nodes[index].is_leaf());
        let tight = if is_leaf { aabbs[first] } else { bvh.nodes[first].aabb().union(bvh.nodes[first + 1].aabb()) };
        bvh.nodes[index].set_aabb(tight);
    }
}

/// A balanced tree: halves of the primitives, ordered by centre along the widest axis.
fn halve(aabbs: &[Aabb]) -> Vec<Bvh2Node> {
    let mut order: Vec<u32> = (0..aabbs.len() as u32).collect();
    let mut nodes = vec![Bvh2Node::default(); (2 * aabbs.len()).saturating_sub(1)];
    let mut used = 1;
    let mut open = if aabbs.is_empty() { Vec::new() } else { vec![(0, 0, aabbs.len())] };
    while let Some((node, start, end)) = open.pop() {
        let part = &mut order[start..end];
        let bounds = part.iter().fold(Aabb::empty(), |b, &i| b.union(&aabbs[i as usize]));
        if part.len() == 1 {
            nodes[node] = Bvh2Node::new(bounds, 1, part[0]);
            continue;
        }
        let axis = bounds.largest_axis();
        let middle = part.len() / 2;
        let center = |i: &u32| aabbs[*i as usize].center_axis(axis);
        part.select_nth_unstable_by(middle, |a, b| center(a).total_cmp(&center(b)).then(a.cmp(b)));
        nodes[node] = Bvh2Node::new(bounds, 0, used as u32);
        open.extend([(used, start, start + middle), (used + 1, start + middle, end)]);
        used += 2;
    }
    nodes
}

/// Plain traversal of the binary tree, nearer child first.
pub struct Bvh {
    soup: Arc<Soup>,
    nodes: Vec<Node>,
}

/// A node in 32 bytes.
#[derive(Clone, Copy)]
struct Node {
    bounds: Bounds,
    /// First child of an inner node, primitive of a leaf.
    first: u32,
    is_leaf: bool,
}

impl Bvh {
    /// Builds the tree.
    pub fn new(soup: Arc<Soup>) -> Self {
        let tree = Tree::build(&soup, MAX_DEPTH);
        let convert = |n: &Bvh2Node| {
            let bounds = Bounds::new(n.aabb().min.into(), n.aabb().max.into());
            Node { bounds, first: n.first_index, is_leaf: n.is_leaf() }
        };
        Self { nodes: tree.nodes.iter().map(convert).collect(), soup }
    }

    /// Calls `visit` with primitives near the ray; it returns the new end of the ray, or `None` to stop.
    #[inline]
    fn traverse(&self, query: &Query, mut visit: impl FnMut(u32, f32) -> Option<f32>) {
        let mut stack = [(0_u32, 0.0_f32); MAX_DEPTH];
        let mut limit = query.ray.t_max;
        let enter = |index: u32, limit| query.enters(&self.nodes[index as usize].bounds, limit).map(|t| (index, t));
        let mut current = if self.nodes.is_empty() { None } else { enter(0, limit) };
        let mut height = 0;
        while let Some((index, _)) = current {
            let node = &self.nodes[index as usize];
            if node.is_leaf {
                match visit(node.first, limit) {
                    Some(end) => limit = end,
                    None => return,
                }
                current = None;
            } else {
                current = match (enter(node.first, limit), enter(node.first + 1, limit)) {
                    (Some(a), Some(b)) => {
                        let (near, far) = if b.1 < a.1 { (b, a) } else { (a, b) };
                        stack[height] = far;
                        height += 1;
                        Some(near)
                    }
                    (a, b) => a.or(b),
                };
            }
            // What was put aside may lie beyond a hit found since.
            while current.is_none() && height > 0 {
                height -= 1;
                current = Some(stack[height]).filter(|&(_, t)| t <= limit * super::query::BOX_SLACK);
            }
        }
    }
}

impl Accel for Bvh {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let query = Query::new(ray)?;
        let mut best = None;
        self.traverse(&query, |primitive, limit| {
            if let Some(hit) = self.soup.intersect(primitive, &query.ray, &query.sheared, limit)
                && is_better(hit, best)
            {
                best = Some(hit);
            }
            Some(best.map_or(limit, |hit| inclusive(hit.t).min(ray.t_max)))
        });
        best
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let Some(query) = Query::new(ray) else { return false };
        let mut found = false;
        self.traverse(&query, |primitive, limit| {
            found = self.soup.intersect(primitive, &query.ray, &query.sheared, limit).is_some();
            (!found).then_some(limit)
        });
        found
    }

    fn memory_bytes(&self) -> usize {
        std::mem::size_of_val(self.nodes.as_slice())
    }
}
