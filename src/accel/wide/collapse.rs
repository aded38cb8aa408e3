//! From a binary tree with one primitive a leaf to eight-wide nodes and packed leaves.
//!
//! The cut with the least expected cost is found by dynamic programming ([Ylitie17, section 3.2] with leaves of packets):
//! `cost[n][i]` is the least cost of presenting the subtree of `n` as at most `i + 1` children of one wide node.

use rayon::prelude::*;

use super::layout::{Child, Filling, LANES, Node, Packet, WIDTH};
use crate::accel::bvh::{BinaryNode, Draft, Tree};
use crate::accel::pages::in_large_pages;
use crate::geometry::soup::Primitive;
use crate::geometry::{Bounds, Soup};

/// Cost of testing a packet in units of testing a node, however full it is. Between 0.5 and 2 the speed of rays hardly changes.
const PACKET_COST: f32 = 1.0;

/// Chance of meeting a flat box, in units of that of another box with its area.
const FLAT: f32 = 0.45;

/// Primitives in a leaf at most: what one packet can hold.
const MAX_LEAF: u32 = LANES as u32;

/// A wide tree.
pub struct Collapsed {
    /// Root first; there is always a root.
    pub nodes: Vec<Node>,
    /// Leaves.
    pub packets: Vec<Packet>,
    /// Nodes on the longest way down.
    pub depth: usize,
}

/// Primitives of a part: a few to each thread, and its steps and nodes stay in the second-level cache.
const PART: usize = 4096;

/// With fewer parts the nodes on top would not be filled: rays would pay for what the build gains.
const FEWEST_PARTS: usize = 16;

/// Collapses a tree, cut in parts that are worked on in parallel. The cut hangs on the tree alone, so the result does too.
pub fn collapse(draft: &Draft, soup: &Soup) -> Collapsed {
    if draft.len() == 0 {
        return Collapsed { nodes: vec![Node::EMPTY], packets: Vec::new(), depth: 1 };
    }
    let n_parts = draft.len() / PART;
    let (mut top, roots) = draft.cut(if n_parts < FEWEST_PARTS { 1 } else { n_parts });
    if let [root] = roots[..] {
        return Part::new(&draft.subtree(root), soup, true).wide;
    }
    let parts: Vec<Part> = roots.par_iter().map(|&root| Part::new(&draft.subtree(root), soup, false)).collect();
    top.nodes.iter_mut().filter(|node| node.is_leaf()).for_each(|node| node.bounds = parts[node.primitive as usize].bounds);
    top.fill();
    join(&top, &parts)
}

/// A subtree, collapsed by itself.
struct Part {
    wide: Collapsed,
    /// What it is to the node above.
    root: Child,
    cost: f32,
    bounds: Bounds,
}

impl Part {
    /// Collapses a part; `is_all` asks for a root that is a node whatever it holds.
    fn new(tree: &Tree, soup: &Soup, is_all: bool) -> Self {
        let mut steps = vec![Step::default(); tree.nodes.len()];
        for index in (0..steps.len()).rev() {
            steps[index] = step(&tree.nodes[index..], &steps[index..], soup);
        }
        let (cost, bounds, as_leaf) = (steps[0].cost[0], tree.nodes[0].bounds, steps[0].is_leaf && !is_all);
        let mut emit = Emit::new(tree, &steps, Leaves::Primitives(soup));
        let root = if as_leaf { emit.leaf(0) } else { emit.below_root() };
        Self { wide: emit.wide, root, cost, bounds }
    }
}

/// Places the nodes over some parts, and the parts behind them.
fn join(top: &Tree, parts: &[Part]) -> Collapsed {
    let mut steps = vec![Step::default(); top.nodes.len()];
    for index in (0..steps.len()).rev() {
        let node = &top.nodes[index];
        steps[index] = if node.is_leaf() {
            // Its count keeps it from being packed in a leaf together with another part.
            Step { cost: [parts[node.primitive as usize].cost; WIDTH - 1], is_leaf: true, count: MAX_LEAF + 1, ..Step::default() }
        } else {
            let (near, far) = (&steps[index + 1], &steps[index + 1 + top.nodes[index + 1].size as usize]);
            inner_step(half_area(node), near, far)
        };
    }
    let starts_above = |n_top: usize| {
        parts.iter().scan((n_top, 0), |next, part| {
            let start = *next;
            *next = (start.0 + part.wide.nodes.len(), start.1 + part.wide.packets.len());
            Some(start)
        })
    };
    // The nodes on top are counted first: the places of all others depend on their number.
    let mut count = Emit::new(top, &steps, Leaves::Parts(&[]));
    count.below_root();
    let starts: Vec<(usize, usize)> = starts_above(count.wide.nodes.len()).collect();
    let roots: Vec<Child> = parts.iter().zip(&starts).map(|(part, start)| part.root.moved(start.0, start.1)).collect();
    let mut emit = Emit::new(top, &steps, Leaves::Parts(&roots));
    emit.below_root();
    let mut wide = emit.wide;
    let n_top = wide.nodes.len();
    let all = |of: fn(&Collapsed) -> usize| parts.iter().map(|part| of(&part.wide)).sum::<usize>();
    let mut nodes = in_large_pages(n_top + all(|wide| wide.nodes.len()));
    nodes.append(&mut wide.nodes);
    (wide.nodes, wide.packets) = (nodes, in_large_pages(all(|wide| wide.packets.len())));
    wide.depth += parts.iter().map(|part| part.wide.depth).max().unwrap_or(0);
    wide.nodes.par_extend((0..all(|wide| wide.nodes.len())).into_par_iter().map(|place| {
        let place = place + n_top;
        let part = starts.partition_point(|start| start.0 <= place) - 1;
        let mut node = parts[part].wide.nodes[place - starts[part].0];
        node.children = node.children.map(|child| child.moved(starts[part].0, starts[part].1));
        node
    }));
    wide.packets.par_extend((0..all(|wide| wide.packets.len())).into_par_iter().map(|place| {
        let part = starts.partition_point(|start| start.1 <= place) - 1;
        parts[part].wide.packets[place - starts[part].1]
    }));
    wide
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
    corners: Corners,
}

/// The corners of some triangles: a number for each, of its bits, in ascending order, and the highest number behind the last.
///
/// Different corners may have the same number, by chance. A leaf then needs one more packet than expected.
#[derive(Clone, Copy, Default)]
struct Corners {
    numbers: [u16; LANES],
    /// More than `LANES` if there are more than fit a packet; `numbers` are not set then.
    n: u16,
}

impl Corners {
    const NOTHING: u16 = u16::MAX;

    fn of(primitive: Primitive) -> Self {
        let Primitive::Triangle(corners) = primitive else { return Self { numbers: [Self::NOTHING; LANES], n: 0 } };
        let [a, b, c] = corners.map(|corner| {
            let [x, y, z] = corner.to_array().map(|x| u64::from(x.to_bits()));
            let mixed = (x << 32 | y).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ z.wrapping_mul(0xd6e8_feb8_6659_fd93);
            ((mixed.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 48) as u16).min(Self::NOTHING - 1)
        });
        let (low, high) = (a.min(b), a.max(b));
        let sorted = [low.min(c), high.min(low.max(c)), high.max(c)];
        let mut all = Self { numbers: [Self::NOTHING; LANES], n: 0 };
        for number in sorted {
            if all.n == 0 || all.numbers[usize::from(all.n) - 1] != number {
                all.numbers[usize::from(all.n)] = number;
                all.n += 1;
            }
        }
        all
    }

    fn union(&self, other: &Self) -> Self {
        const LIMIT: u16 = LANES as u16;
        let mut all = Self { numbers: [Self::NOTHING; LANES], n: 0 };
        if self.n > LIMIT || other.n > LIMIT {
            return Self { n: LIMIT + 1, ..all };
        }
        let (mut i, mut j) = (0, 0);
        while i < self.n || j < other.n {
            if all.n == LIMIT {
                all.n += 1;
                return all;
            }
            let number = |corners: &Self, i: u16| if i < LIMIT { corners.numbers[usize::from(i)] } else { Self::NOTHING };
            let (a, b) = (number(self, i), number(other, j));
            all.numbers[usize::from(all.n)] = a.min(b);
            all.n += 1;
            i += u16::from(a <= b);
            j += u16::from(b <= a);
        }
        all
    }
}

/// The step of the first of some nodes in preorder; those of its children are known.
fn step(nodes: &[BinaryNode], steps: &[Step], soup: &Soup) -> Step {
    let area = half_area(&nodes[0]);
    if nodes[0].is_leaf() {
        let corners = Corners::of(soup.primitive(nodes[0].primitive));
        return Step { cost: [area * PACKET_COST; WIDTH - 1], is_leaf: true, count: 1, corners, ..Step::default() };
    }
    inner_step(area, &steps[1], &steps[1 + nodes[1].size as usize])
}

/// What stands for the chance that a ray meets a box: half its area, and for a flat one a little less than half of that.
///
/// Of a room's walls a line meets two, and a ray that starts at one of them only the other: as many as it meets boxes around the
/// whole room. Without this, six walls that could be told apart ended in one packet, which every ray in the room asked: shadow rays
/// in a box of 36 triangles 48 ns for 32.
fn half_area(node: &BinaryNode) -> f32 {
    let d = node.bounds.max - node.bounds.min;
    let half = d.x * d.y + d.y * d.z + d.z * d.x;
    if d.min_element() == 0.0 { FLAT * half } else { half }
}

fn inner_step(area: f32, a: &Step, b: &Step) -> Step {
    let mut step = Step { count: a.count + b.count, ..Step::default() };
    let may_be_leaf = step.count <= MAX_LEAF && {
        step.corners = a.corners.union(&b.corners);
        step.corners.n <= LANES as u16
    };
    let split = |roots: usize| {
        (1..roots)
            .map(|k| (a.cost[k - 1] + b.cost[roots - k - 1], k as u8))
            .fold((f32::INFINITY, 1), |best, way| if way.0 < best.0 { way } else { best })
    };
    let (of_eight, to_first) = split(WIDTH);
    step.to_first_of_eight = to_first;
    let as_node = of_eight + area;
    let as_leaf = if may_be_leaf { area * PACKET_COST } else { f32::INFINITY };
    step.is_leaf = may_be_leaf && as_leaf <= as_node;
    step.cost[0] = as_node.min(as_leaf);
    // More roots than primitives are never of use, and most nodes have few.
    let useful = WIDTH.min(step.count as usize + 1);
    for roots in 2..useful {
        let (cost, to_first) = split(roots);
        let fewer = step.cost[roots - 2];
        (step.cost[roots - 1], step.to_first[roots - 1]) = if cost < fewer { (cost, to_first) } else { (fewer, 0) };
    }
    for roots in useful.max(2)..WIDTH {
        step.cost[roots - 1] = step.cost[roots - 2];
    }
    step
}

/// What the leaves of the binary tree stand for.
enum Leaves<'a> {
    /// Primitives.
    Primitives(&'a Soup),
    /// Parts that are in their places; of an empty slice, parts that have none yet.
    Parts(&'a [Child]),
}

/// Writes nodes and leaves.
struct Emit<'a> {
    tree: &'a Tree,
    steps: &'a [Step],
    leaves: Leaves<'a>,
    wide: Collapsed,
}

impl<'a> Emit<'a> {
    fn new(tree: &'a Tree, steps: &'a [Step], leaves: Leaves<'a>) -> Self {
        let wide = Collapsed { nodes: vec![Node::EMPTY], packets: Vec::with_capacity(tree.nodes.len() / 12), depth: 1 };
        Self { tree, steps, leaves, wide }
    }
}

impl Emit<'_> {
    /// Writes the root, as a node, and all nodes below it.
    fn below_root(&mut self) -> Child {
        let mut open = vec![(0, 0, 1)];
        while let Some((binary, wide, depth)) = open.pop() {
            self.node(binary, wide, depth, &mut open);
        }
        Child::ROOT
    }

    /// Fills wide node `wide` from the binary node; inner children get adjacent places and are left in `open`.
    fn node(&mut self, binary: u32, wide: usize, depth: usize, open: &mut Vec<(u32, usize, usize)>) {
        self.wide.depth = self.wide.depth.max(depth);
        let (roots, n_roots) = self.roots(binary);
        let mut node = Node::EMPTY;
        for (slot, &root) in roots[..n_roots].iter().enumerate() {
            let child = if self.steps[root as usize].is_leaf {
                self.leaf(root)
            } else {
                self.wide.nodes.push(Node::EMPTY);
                open.push((root, self.wide.nodes.len() - 1, depth + 1));
                Child::inner(self.wide.nodes.len() - 1)
            };
            let bounds = &self.tree.nodes[root as usize].bounds;
            node.set(slot, bounds.min, bounds.max, child);
        }
        self.wide.nodes[wide] = node;
    }

    /// The binary nodes that become children of the wide node over `binary`.
    fn roots(&self, binary: u32) -> ([u32; WIDTH], usize) {
        let (mut roots, mut n_roots) = ([0; WIDTH], 0);
        let step = &self.steps[binary as usize];
        let mut open: Vec<(u32, usize)> = Vec::with_capacity(WIDTH);
        if self.tree.nodes[binary as usize].is_leaf() {
            open.push((binary, 1));
        } else {
            let [first, second] = self.tree.children(binary);
            let to_first = usize::from(step.to_first_of_eight);
            open.extend([(second, WIDTH - to_first), (first, to_first)]);
        }
        while let Some((index, mut share)) = open.pop() {
            let (node, step) = (&self.tree.nodes[index as usize], &self.steps[index as usize]);
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
        let soup = match self.leaves {
            Leaves::Primitives(soup) => soup,
            Leaves::Parts(parts) => {
                return parts.get(self.tree.nodes[root as usize].primitive as usize).copied().unwrap_or(Child::ROOT);
            }
        };
        let below = &self.tree.nodes[root as usize..][..self.tree.nodes[root as usize].size as usize];
        let (mut primitives, mut n) = ([0; MAX_LEAF as usize], 0);
        for node in below.iter().filter(|node| node.is_leaf()) {
            primitives[n] = node.primitive;
            n += 1;
        }
        let primitives = &mut primitives[..n];
        primitives.sort_unstable();
        let (first, mut has_spheres) = (self.wide.packets.len(), false);
        let mut filling = Filling::new();
        for &primitive in primitives.iter() {
            let corners = match soup.primitive(primitive) {
                Primitive::Triangle(corners) => Some(corners),
                Primitive::Sphere(_) => None,
            };
            has_spheres |= corners.is_none();
            if !filling.add(primitive, corners) {
                self.wide.packets.push(std::mem::replace(&mut filling, Filling::new()).finish());
                assert!(filling.add(primitive, corners), "an empty packet has room for one primitive");
            }
        }
        self.wide.packets.push(filling.finish());
        Child::leaf(first, self.wide.packets.len() - first, has_spheres)
    }
}
