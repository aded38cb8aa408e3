//! From a binary tree with one primitive a leaf to eight-wide nodes and packed leaves.
//!
//! The cut with the least expected cost is found by dynamic programming ([Ylitie17, section 3.2] with leaves of packets):
//! `cost[n][i]` is the least cost of presenting the subtree of `n` as at most `i + 1` children of one wide node.

use super::layout::{Child, LANES, MAX_PACKETS, Node, Packet, WIDTH};
use crate::accel::bvh::{BinaryNode, Tree};
use crate::geometry::Soup;
use crate::geometry::soup::Primitive;

/// Cost of testing a packet in units of testing a node. Between 0.5 and 1 the speed of rays hardly changes.
const PACKET_COST: f32 = 0.7;

/// Primitives in a leaf at most: two packets. More than that never paid.
const MAX_LEAF: u32 = (2 * LANES) as u32;
const _: () = assert!(MAX_LEAF as usize <= MAX_PACKETS * LANES);

/// A wide tree.
pub struct Collapsed {
    /// Root first; there is always a root.
    pub nodes: Vec<Node>,
    /// Leaves.
    pub packets: Vec<Packet>,
    /// Nodes on the longest way down.
    pub depth: usize,
}

/// Collapses `tree`.
pub fn collapse(tree: &Tree, soup: &Soup) -> Collapsed {
    let plan = Plan::new(tree);
    let mut emit = Emit { tree, soup, plan, nodes: vec![Node::EMPTY], packets: Vec::with_capacity(soup.len() / 3), depth: 1 };
    let mut open = Vec::new();
    if !tree.nodes.is_empty() {
        open.push((0, 0, 1));
    }
    while let Some((binary, wide, depth)) = open.pop() {
        emit.node(binary, wide, depth, &mut open);
    }
    Collapsed { nodes: emit.nodes, packets: emit.packets, depth: emit.depth }
}

/// Decisions for each binary node.
struct Plan {
    steps: Vec<Step>,
}

/// The best ways to present one inner node; for `i` roots at index `i - 1`.
#[derive(Clone, Copy, Default)]
struct Step {
    cost: [f32; WIDTH - 1],
    /// Of `i` roots, how many go to the first child; 0: use the way for one root fewer.
    to_first: [u8; WIDTH - 1],
    /// The same for the eight children of the wide node that this node would become.
    to_first_of_eight: u8,
    /// As one root: a leaf rather than a node.
    is_leaf: bool,
    count: u32,
}

impl Plan {
    fn new(tree: &Tree) -> Self {
        let mut steps = vec![Step::default(); tree.nodes.len()];
        if !steps.is_empty() {
            solve(&tree.nodes, &mut steps);
        }
        Self { steps }
    }
}

/// Nodes below which a subtree is not worth another task.
const TASK: usize = 1 << 14;

/// Fills the steps of a subtree, children before parents; the two halves of a large one in parallel.
fn solve(nodes: &[BinaryNode], steps: &mut [Step]) {
    if nodes.len() <= TASK {
        for index in (0..nodes.len()).rev() {
            steps[index] = step(&nodes[index..], &steps[index..]);
        }
        return;
    }
    let second = 1 + nodes[1].size as usize;
    let (first_steps, second_steps) = steps[1..].split_at_mut(second - 1);
    rayon::join(|| solve(&nodes[1..second], first_steps), || solve(&nodes[second..], second_steps));
    steps[0] = step(nodes, steps);
}

/// The step of the first of some nodes in preorder; those of its children are known.
fn step(nodes: &[BinaryNode], steps: &[Step]) -> Step {
    let area = half_area(&nodes[0]);
    if nodes[0].is_leaf() {
        return Step { cost: [area * PACKET_COST; WIDTH - 1], is_leaf: true, count: 1, ..Step::default() };
    }
    inner_step(area, &steps[1], &steps[1 + nodes[1].size as usize])
}

fn half_area(node: &BinaryNode) -> f32 {
    let d = node.bounds.max - node.bounds.min;
    d.x * d.y + d.y * d.z + d.z * d.x
}

fn inner_step(area: f32, a: &Step, b: &Step) -> Step {
    let mut step = Step { count: a.count + b.count, ..Step::default() };
    let split = |roots: usize| {
        (1..roots)
            .map(|k| (a.cost[k - 1] + b.cost[roots - k - 1], k as u8))
            .fold((f32::INFINITY, 1), |best, way| if way.0 < best.0 { way } else { best })
    };
    let (of_eight, to_first) = split(WIDTH);
    step.to_first_of_eight = to_first;
    let as_node = of_eight + area;
    let packets = step.count.div_ceil(LANES as u32);
    let as_leaf = if step.count <= MAX_LEAF { area * packets as f32 * PACKET_COST } else { f32::INFINITY };
    step.is_leaf = as_leaf <= as_node && step.count <= MAX_LEAF;
    step.cost[0] = as_node.min(as_leaf);
    for roots in 2..WIDTH {
        let (cost, to_first) = split(roots);
        let fewer = step.cost[roots - 2];
        (step.cost[roots - 1], step.to_first[roots - 1]) = if cost < fewer { (cost, to_first) } else { (fewer, 0) };
    }
    step
}

/// Writes nodes and leaves.
struct Emit<'a> {
    tree: &'a Tree,
    soup: &'a Soup,
    plan: Plan,
    nodes: Vec<Node>,
    packets: Vec<Packet>,
    depth: usize,
}

impl Emit<'_> {
    /// Fills wide node `wide` from the binary node; inner children get adjacent places and are left in `open`.
    fn node(&mut self, binary: u32, wide: usize, depth: usize, open: &mut Vec<(u32, usize, usize)>) {
        self.depth = self.depth.max(depth);
        let (roots, n_roots) = self.roots(binary);
        let mut node = Node::EMPTY;
        for (slot, &root) in roots[..n_roots].iter().enumerate() {
            let child = if self.plan.steps[root as usize].is_leaf {
                self.leaf(root)
            } else {
                self.nodes.push(Node::EMPTY);
                open.push((root, self.nodes.len() - 1, depth + 1));
                Child::inner(self.nodes.len() - 1)
            };
            let bounds = &self.tree.nodes[root as usize].bounds;
            node.set(slot, bounds.min, bounds.max, child);
        }
        self.nodes[wide] = node;
    }

    /// The binary nodes that become children of the wide node over `binary`.
    fn roots(&self, binary: u32) -> ([u32; WIDTH], usize) {
        let (mut roots, mut n_roots) = ([0; WIDTH], 0);
        let step = &self.plan.steps[binary as usize];
        let mut open: Vec<(u32, usize)> = Vec::with_capacity(WIDTH);
        if self.tree.nodes[binary as usize].is_leaf() {
            open.push((binary, 1));
        } else {
            let [first, second] = self.tree.children(binary);
            let to_first = usize::from(step.to_first_of_eight);
            open.extend([(second, WIDTH - to_first), (first, to_first)]);
        }
        while let Some((index, mut share)) = open.pop() {
            let (node, step) = (&self.tree.nodes[index as usize], &self.plan.steps[index as usize]);
            while share > 1 && step.to_first[share - 1] == 0 {
                share -= 1;
            }
            if share == 1 || node.is_leaf() {
                roots[n_roots] = index;
                n_roots += 1;
            } else {
                let to_first = usize::from(step.to_first[share - 1]);
                let [first, second] = self.tree.children(index);
                open.extend([(second, share - to_first), (first, to_first)]);
            }
        }
        (roots, n_roots)
    }

    /// Packs the primitives under a binary node.
    fn leaf(&mut self, root: u32) -> Child {
        let below = &self.tree.nodes[root as usize..][..self.tree.nodes[root as usize].size as usize];
        let (mut primitives, mut n) = ([0; MAX_LEAF as usize], 0);
        for node in below.iter().filter(|node| node.is_leaf()) {
            primitives[n] = node.primitive;
            n += 1;
        }
        let primitives = &mut primitives[..n];
        primitives.sort_unstable();
        let (first, mut has_spheres) = (self.packets.len(), false);
        for chunk in primitives.chunks(LANES) {
            let mut packet = Packet::EMPTY;
            for (lane, &primitive) in chunk.iter().enumerate() {
                packet.primitives[lane] = primitive;
                match self.soup.primitive(primitive) {
                    Primitive::Triangle(corners) => packet.set(lane, corners),
                    Primitive::Sphere(_) => has_spheres = true,
                }
            }
            self.packets.push(packet);
        }
        Child::leaf(first, self.packets.len() - first, has_spheres)
    }
}
