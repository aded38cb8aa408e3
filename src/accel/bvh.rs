//! Binary trees built by obvhs.
//!
//! Only its builder is used: its triangle test rejects hits with a barycentric of -0.0, so axis-aligned walls leak at their
//! diagonals, and its traversal is half as fast as that of eight-wide nodes.

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

use crate::geometry::{Bounds, Soup};
use crate::math::Vec3A;

/// Binary tree whose leaves hold one primitive each, in preorder: a node, all of its first child's nodes, all of the second's.
pub struct Tree {
    /// Root first.
    pub nodes: Vec<BinaryNode>,
}

/// A node in 32 bytes.
#[derive(Debug, Clone, Copy)]
pub struct BinaryNode {
    /// Box of everything below.
    pub bounds: Bounds,
    /// Number of nodes in this subtree; 1 for a leaf.
    pub size: u32,
    /// Primitive of a leaf.
    pub primitive: u32,
}

impl BinaryNode {
    /// True for a leaf.
    #[inline]
    pub fn is_leaf(&self) -> bool {
        self.size == 1
    }
}

impl Tree {
    /// Builds the tree over all primitives with finite boxes; the others can hit nothing.
    ///
    /// Parallel agglomerative clustering over 6 neighbours (14 gave no faster rays), then reinsertion of the 5 % largest nodes.
    /// obvhs' presets search only direct Morton neighbours in the first passes (`search_depth_threshold` above 0); on walls cut
    /// into equal squares all costs tie there and the bad merges stay: rays were ten times slower. Hence 0.
    pub fn build(soup: &Soup) -> Tree {
        Self::build_by(soup, cluster)
    }

    /// The same by halving, with depth log2(n), whatever the input: for inputs on which clustering makes a chain.
    pub fn build_balanced(soup: &Soup) -> Tree {
        Self::build_by(soup, halve)
    }

    fn build_by(soup: &Soup, method: fn(&[Aabb]) -> Vec<Bvh2Node>) -> Tree {
        let to_aabb = |i: u32| {
            let bounds = soup.bounds_of(i);
            Aabb::new(Vec3A::from(bounds.min), Vec3A::from(bounds.max))
        };
        let finite = |b: &Aabb| b.min.is_finite() && b.max.is_finite();
        let (indices, aabbs): (Vec<u32>, Vec<Aabb>) =
            (0..soup.len() as u32).map(|i| (i, to_aabb(i))).filter(|(_, b)| finite(b)).unzip();
        let mut tree = Tree { nodes: preorder(&method(&aabbs), &indices) };
        tree.count_sizes();
        tree
    }

    /// The two children of an inner node.
    #[inline]
    pub fn children(&self, index: u32) -> [u32; 2] {
        [index + 1, index + 1 + self.nodes[index as usize + 1].size]
    }

    fn count_sizes(&mut self) {
        for index in (0..self.nodes.len()).rev() {
            if self.nodes[index].is_leaf() {
                continue;
            }
            let [first, second] = self.children(index as u32);
            self.nodes[index].size = 1 + self.nodes[first as usize].size + self.nodes[second as usize].size;
        }
    }
}

/// obvhs' nodes, which lie in any order, in preorder; sizes of inner nodes are still 0.
fn preorder(nodes: &[Bvh2Node], indices: &[u32]) -> Vec<BinaryNode> {
    let mut ordered = Vec::with_capacity(nodes.len());
    let mut open: Vec<u32> = if nodes.is_empty() { Vec::new() } else { vec![0] };
    while let Some(index) = open.pop() {
        let node = &nodes[index as usize];
        let bounds = Bounds::new(node.aabb().min.into(), node.aabb().max.into());
        let (size, primitive) = if node.is_leaf() { (1, indices[node.first_index as usize]) } else { (0, 0) };
        ordered.push(BinaryNode { bounds, size, primitive });
        if !node.is_leaf() {
            open.extend([node.first_index + 1, node.first_index]);
        }
    }
    ordered
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
/// Clustering merges pairs that choose each other. Where many boxes are equal or equally spaced all may choose to the same side,
/// and one pair is merged in a pass: with a search over 14 neighbours, 25,000 duplicates took 13 s, and 20 ms this way. A search
/// over 6 was not seen to fail so, but that hangs on how obvhs breaks ties, and without ties it does not matter.
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
