//! Binary trees built by obvhs.
//!
//! Only its builder is used: its triangle test rejects hits with a barycentric of -0.0, so axis-aligned walls leak at their
//! diagonals, and its traversal is half as fast as that of eight-wide nodes.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashSet};

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use super::pages::in_large_pages;
use crate::geometry::{Bounds, Soup};
use crate::math::Vec3A;

/// Binary tree over all primitives with finite boxes (the others can hit nothing), as it comes from its builder.
pub struct Draft<'a> {
    soup: &'a Soup,
    /// In any order, the root first, with boxes that may be a little too large.
    nodes: Vec<Bvh2Node>,
    /// Primitive of each leaf by its `first_index`.
    indices: Vec<u32>,
}

/// Binary tree whose leaves hold one thing each, in preorder: a node, all of its first child's nodes, all of the second's.
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
    /// Primitive of a leaf; in the top of a tree that was cut in parts, the part.
    pub primitive: u32,
}

impl BinaryNode {
    /// True for a leaf.
    #[inline]
    pub fn is_leaf(&self) -> bool {
        self.size == 1
    }
}

impl<'a> Draft<'a> {
    /// Builds the tree by clustering.
    ///
    /// Parallel agglomerative clustering over 14 neighbours (6, together with a cut in two parts, made shadow rays in a tessellated box a third slower), then reinsertion of the largest nodes.
    /// obvhs' presets search only direct Morton neighbours in the first passes (`search_depth_threshold` above 0); on walls cut
    /// into equal squares all costs tie there and the bad merges stay: rays were ten times slower. Hence 0.
    pub fn build(soup: &'a Soup) -> Self {
        Self::build_by(soup, cluster)
    }

    /// The same by halving, with depth log2(n), whatever the input: for inputs on which clustering makes a chain.
    pub fn build_balanced(soup: &'a Soup) -> Self {
        Self::build_by(soup, halve)
    }

    fn build_by(soup: &'a Soup, method: fn(Vec<Aabb>) -> Vec<Bvh2Node>) -> Self {
        let box_of = |i: u32| {
            let bounds = soup.bounds_of(i);
            Aabb::new(Vec3A::from(bounds.min), Vec3A::from(bounds.max))
        };
        let is_finite = |b: &Aabb| b.min.is_finite() && b.max.is_finite();
        let mut aabbs: Vec<Aabb> = in_large_pages(soup.len());
        aabbs.par_extend((0..soup.len() as u32).into_par_iter().map(box_of));
        let indices: Vec<u32> = (0..soup.len() as u32).filter(|&i| is_finite(&aabbs[i as usize])).collect();
        if indices.len() < aabbs.len() {
            aabbs.retain(is_finite);
        }
        Self { soup, nodes: method(aabbs), indices }
    }

    /// The whole tree.
    #[cfg(test)]
    pub fn tree(&self) -> Tree {
        if self.nodes.is_empty() { Tree { nodes: Vec::new() } } else { self.subtree(0) }
    }

    /// The tree below a node of the draft.
    pub fn subtree(&self, root: u32) -> Tree {
        let mut nodes = Vec::new();
        let mut open = vec![root];
        while let Some(index) = open.pop() {
            let node = &self.nodes[index as usize];
            let (bounds, size, primitive) = if node.is_leaf() {
                let primitive = self.indices[node.first_index as usize];
                (self.soup.bounds_of(primitive), 1, primitive)
            } else {
                open.extend([node.first_index + 1, node.first_index]);
                (Bounds::EMPTY, 0, 0)
            };
            nodes.push(BinaryNode { bounds, size, primitive });
        }
        let mut tree = Tree { nodes };
        tree.fill();
        tree
    }

    /// The upper end of the tree, whose leaves are the roots of about `n_parts` subtrees, and these roots.
    ///
    /// What is largest is cut first. Sizes and boxes of the upper end are still to be [filled](Tree::fill).
    pub fn cut(&self, n_parts: usize) -> (Tree, Vec<u32>) {
        let candidate = |index: u32| {
            let node = &self.nodes[index as usize];
            // Half areas are not negative, so their bits sort as they do.
            (!node.is_leaf()).then(|| (node.aabb().half_area().to_bits(), Reverse(index)))
        };
        let mut whole: BinaryHeap<_> = self.nodes.first().and_then(|_| candidate(0)).into_iter().collect();
        let mut is_cut = HashSet::new();
        while is_cut.len() + 1 < n_parts
            && let Some((_, Reverse(index))) = whole.pop()
        {
            is_cut.insert(index);
            let first = self.nodes[index as usize].first_index;
            whole.extend([first, first + 1].into_iter().filter_map(candidate));
        }
        let (mut nodes, mut roots) = (Vec::new(), Vec::new());
        let mut open: Vec<u32> = if self.nodes.is_empty() { Vec::new() } else { vec![0] };
        while let Some(index) = open.pop() {
            let (size, primitive) = if is_cut.contains(&index) { (0, 0) } else { (1, roots.len() as u32) };
            nodes.push(BinaryNode { bounds: Bounds::EMPTY, size, primitive });
            if size == 0 {
                let first = self.nodes[index as usize].first_index;
                open.extend([first + 1, first]);
            } else {
                roots.push(index);
            }
        }
        (Tree { nodes }, roots)
    }

    /// Number of primitives in the tree.
    pub fn len(&self) -> usize {
        self.indices.len()
    }
}

impl Tree {
    /// The two children of an inner node.
    #[inline]
    pub fn children(&self, index: u32) -> [u32; 2] {
        [index + 1, index + 1 + self.nodes[index as usize + 1].size]
    }

    /// Gives inner nodes their sizes and boxes; those of leaves are known.
    pub fn fill(&mut self) {
        for index in (0..self.nodes.len()).rev() {
            if self.nodes[index].is_leaf() {
                continue;
            }
            let [first, second] = self.children(index as u32).map(|child| self.nodes[child as usize]);
            self.nodes[index].size = 1 + first.size + second.size;
            self.nodes[index].bounds = first.bounds.union(second.bounds);
        }
    }
}

/// From so many primitives on, clustering looks at 6 neighbours on each side instead of 14, and a twentieth of the nodes is inserted anew instead of a
/// fifth: at 101,124 triangles of a tessellated box a fifth made shadow rays 13 % and rays between patches 20 % faster.
const MANY: usize = 1 << 17;

/// obvhs' builder with the safe parameters.
fn cluster(mut aabbs: Vec<Aabb>) -> Vec<Bvh2Node> {
    if aabbs.is_empty() {
        return Vec::new();
    }
    loosen(&mut aabbs);
    let indices = (0..aabbs.len() as u32).collect();
    let (reach, moved) = if aabbs.len() < MANY { (PlocSearchDistance::Medium, 0.2) } else { (PlocSearchDistance::Low, 0.05) };
    let mut bvh: Bvh2 = PlocBuilder::with_capacity(aabbs.len()).build(reach, &aabbs, indices, SortPrecision::U64, 0);
    ReinsertionOptimizer::default().run(&mut bvh, moved, None);
    bvh.nodes
}

/// Grows each box by up to a thousandth of its size, differently for each.
///
/// Clustering merges pairs that choose each other. Where many boxes are equal or equally spaced all may choose to the same side,
/// and one pair is merged in a pass: with a search over 14 neighbours, 25,000 duplicates took 13 s, and 20 ms this way. A search
/// over 6 was not seen to fail so, but that hangs on how obvhs breaks ties, and without ties it does not matter.
fn loosen(aabbs: &mut [Aabb]) {
    let all = aabbs.par_iter().copied().reduce(Aabb::empty, |a, b| a.union(&b));
    let diagonal = all.diagonal().length();
    // Enough to be seen at the scene's coordinates in f32, and for a scene that is a single point.
    let reach = all.min.abs().max(all.max.abs()).max_element().max(diagonal);
    let least = if reach > 0.0 { 4.0 * f32::EPSILON * reach } else { 1.0 };
    aabbs.par_iter_mut().enumerate().for_each(|(index, b)| {
        let random = (index as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let part = |shift: u32| (1 + ((random >> shift) & 0x3ff)) as f32 / 1024.0;
        let grow = (1e-3 * b.diagonal() + Vec3A::splat(least)) * Vec3A::new(part(34), part(44), part(54));
        *b = Aabb::new(b.min - grow, b.max + grow);
    });
}

/// A balanced tree: halves of the primitives, ordered by centre along the widest axis.
fn halve(aabbs: Vec<Aabb>) -> Vec<Bvh2Node> {
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
