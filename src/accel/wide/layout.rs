//! Nodes and leaves in memory.

use crate::math::Vec3;

/// Children of a node.
pub const WIDTH: usize = 8;
/// Triangles in a packet.
pub const LANES: usize = 4;
/// Packets in one leaf at most: what three bits can count.
pub const MAX_PACKETS: usize = 8;

/// Inner node: the boxes of up to eight children, one coordinate after the other. Four cache lines.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub struct Node {
    /// Lower x, y, z, then upper x, y, z of each child; a child that is not there has an inverted infinite box.
    pub planes: [[f32; WIDTH]; 6],
    /// What each child is.
    pub children: [Child; WIDTH],
}

impl Node {
    /// A node without children.
    pub const EMPTY: Node = Node {
        planes: [
            [f32::INFINITY; 8],
            [f32::INFINITY; 8],
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
            [f32::NEG_INFINITY; 8],
            [f32::NEG_INFINITY; 8],
        ],
        children: [Child(0); WIDTH],
    };

    /// Sets one child.
    pub fn set(&mut self, slot: usize, min: Vec3, max: Vec3, child: Child) {
        for axis in 0..3 {
            self.planes[axis][slot] = min[axis];
            self.planes[axis + 3][slot] = max[axis];
        }
        self.children[slot] = child;
    }
}

/// A node's index, or a leaf: first packet (27 bits), whether spheres are among its primitives, number of packets less one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(transparent)]
pub struct Child(pub u32);

impl Child {
    const LEAF: u32 = 1 << 31;
    const SPHERES: u32 = 1 << 3;

    /// The root, an inner node always.
    pub const ROOT: Child = Child(0);

    /// The inner node `index`.
    pub fn inner(index: usize) -> Self {
        debug_assert!(index < Self::LEAF as usize);
        Child(index as u32)
    }

    /// The leaf of `count` packets from `first`.
    pub fn leaf(first: usize, count: usize, has_spheres: bool) -> Self {
        debug_assert!(first < 1 << 27 && (1..=MAX_PACKETS).contains(&count));
        Child(Self::LEAF | (first as u32) << 4 | if has_spheres { Self::SPHERES } else { 0 } | (count - 1) as u32)
    }

    /// The same child where `nodes` nodes and `packets` packets have been placed before its own.
    pub fn moved(self, nodes: usize, packets: usize) -> Self {
        if self.is_leaf() { Child(self.0 + ((packets as u32) << 4)) } else { Child(self.0 + nodes as u32) }
    }

    /// True for a leaf.
    #[inline(always)]
    pub fn is_leaf(self) -> bool {
        self.0 & Self::LEAF != 0
    }

    /// Packets of a leaf.
    #[inline(always)]
    pub fn packets(self) -> std::ops::Range<usize> {
        let first = ((self.0 & !Self::LEAF) >> 4) as usize;
        first..first + (self.0 & 7) as usize + 1
    }

    /// True if a leaf holds spheres.
    #[inline(always)]
    pub fn has_spheres(self) -> bool {
        self.0 & Self::SPHERES != 0
    }
}

/// Four primitives. A lane without a triangle has NaN corners, which no ray meets.
#[repr(C, align(32))]
#[derive(Clone, Copy)]
pub struct Packet {
    /// Corner, coordinate, lane.
    pub corners: [[[f32; LANES]; 3]; 3],
    /// Index of each primitive; [`Packet::NOTHING`] in an empty lane.
    pub primitives: [u32; LANES],
}

impl Packet {
    /// Marks an empty lane.
    pub const NOTHING: u32 = u32::MAX;
    /// Four empty lanes.
    pub const EMPTY: Packet = Packet { corners: [[[f32::NAN; LANES]; 3]; 3], primitives: [Self::NOTHING; LANES] };

    /// The triangle in a lane.
    #[inline]
    pub fn triangle(&self, lane: usize) -> [Vec3; 3] {
        self.corners.map(|rows| Vec3::from_array(rows.map(|row| row[lane])))
    }

    /// Places a triangle.
    pub fn set(&mut self, lane: usize, corners: [Vec3; 3]) {
        for (corner, rows) in corners.iter().zip(&mut self.corners) {
            for axis in 0..3 {
                rows[axis][lane] = corner[axis];
            }
        }
    }
}
