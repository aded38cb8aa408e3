//! Nodes and leaves in memory.

use crate::math::Vec3;

/// Children of a node.
pub const WIDTH: usize = 8;
/// Triangles in a packet, and corners that they share.
pub const LANES: usize = 16;
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

/// Up to sixteen primitives, the triangles among them by up to sixteen corners that they share.
///
/// Each corner is moved and sheared once for all its triangles, by the same operations as for one of them. What a ray reads unless
/// it hits something is four cache lines.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub struct Packet {
    /// Coordinate, corner. Those beyond the last are copies of the first.
    pub corners: [[f32; LANES]; 3],
    /// Places of each triangle's first, second and third corner, in four bits each from the lowest; zeros for no triangle.
    pub triangles: [u16; LANES],
    /// Which lanes hold a triangle.
    pub is_triangle: u16,
    /// Primitives in the packet, from lane 0 on.
    pub n_primitives: u16,
    /// Corners before the copies.
    pub n_corners: u32,
    unused: [u32; 6],
    /// Index of each primitive.
    pub primitives: [u32; LANES],
}

const _: () = assert!(size_of::<Packet>() == 320);

impl Packet {
    /// No primitives.
    pub const EMPTY: Packet = Packet {
        corners: [[0.0; LANES]; 3],
        triangles: [0; LANES],
        is_triangle: 0,
        n_primitives: 0,
        n_corners: 0,
        unused: [0; 6],
        primitives: [0; LANES],
    };

    /// The triangle in a lane.
    #[inline]
    pub fn triangle(&self, lane: usize) -> [Vec3; 3] {
        self.places(lane).map(|place| Vec3::from_array(self.corners.map(|row| row[place])))
    }

    /// Places of a triangle's corners.
    #[inline]
    pub fn places(&self, lane: usize) -> [usize; 3] {
        [0, 4, 8].map(|shift| usize::from(self.triangles[lane] >> shift & 0xf))
    }

    /// Indices of all primitives.
    #[inline]
    pub fn primitives(&self) -> &[u32] {
        &self.primitives[..usize::from(self.n_primitives)]
    }
}

/// Fills a packet, primitive by primitive.
pub struct Filling {
    packet: Packet,
}

impl Filling {
    /// Nothing yet.
    pub fn new() -> Self {
        Self { packet: Packet::EMPTY }
    }

    /// Adds a primitive, with its corners if it is a triangle; false if there is no room for it.
    pub fn add(&mut self, primitive: u32, corners: Option<[Vec3; 3]>) -> bool {
        let lane = usize::from(self.packet.n_primitives);
        if lane == LANES {
            return false;
        }
        if let Some(corners) = corners {
            let (mut n_corners, mut places) = (self.packet.n_corners as usize, 0);
            for (number, corner) in corners.into_iter().enumerate() {
                // By bits: zeros of either sign are sheared apart.
                let bits = corner.to_array().map(f32::to_bits);
                let is_at = |place: usize| (0..3).all(|axis| self.packet.corners[axis][place].to_bits() == bits[axis]);
                let place = (0..n_corners).find(|&place| is_at(place)).unwrap_or(n_corners);
                if place == LANES {
                    return false;
                }
                if place == n_corners {
                    (0..3).for_each(|axis| self.packet.corners[axis][place] = corner[axis]);
                    n_corners += 1;
                }
                places |= (place as u16) << (4 * number);
            }
            self.packet.n_corners = n_corners as u32;
            self.packet.triangles[lane] = places;
            self.packet.is_triangle |= 1 << lane;
        }
        self.packet.primitives[lane] = primitive;
        self.packet.n_primitives += 1;
        true
    }

    /// The packet.
    pub fn finish(mut self) -> Packet {
        let n_corners = self.packet.n_corners.max(1) as usize;
        for row in &mut self.packet.corners {
            let first = row[0];
            row[n_corners..].fill(first);
        }
        self.packet
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn same_bits(a: [Vec3; 3], b: [Vec3; 3]) -> bool {
        a.iter().zip(&b).all(|(a, b)| a.to_array().map(f32::to_bits) == b.to_array().map(f32::to_bits))
    }

    #[test]
    fn a_packet_gives_back_each_triangle_bit_by_bit() {
        // A fan around one corner: 14 triangles have 16 corners, and a 15th has no room. Corners of the rim that
        // follow each other lie in one
        // place, but for the sign of a zero: by their bits they are two.
        let rim = |i: u32| Vec3::new((i / 2) as f32, if i.is_multiple_of(2) { 0.0 } else { -0.0 }, 1.0);
        let fan = |i: u32| [Vec3::new(-0.0, 0.0, -0.0), rim(i), rim(i + 1)];
        let mut filling = Filling::new();
        for i in 0..14 {
            assert!(filling.add(100 + i, Some(fan(i))), "{i}");
        }
        assert!(!filling.add(114, Some(fan(14))), "a seventeenth corner");
        assert!(filling.add(500, None), "a sphere has no corners");
        assert!(filling.add(3, Some([rim(2), rim(0), rim(1)])), "all corners are there");
        assert!(!filling.add(4, None), "a seventeenth primitive");
        let packet = filling.finish();
        assert_eq!((packet.n_corners, packet.primitives().len()), (16, 16));
        assert_eq!(packet.is_triangle, !(1 << 14));
        for i in 0..14 {
            assert!(same_bits(packet.triangle(i), fan(i as u32)), "{i}");
            assert_eq!(packet.primitives()[i], 100 + i as u32);
        }
        assert!(same_bits(packet.triangle(15), [rim(2), rim(0), rim(1)]));
    }
}
