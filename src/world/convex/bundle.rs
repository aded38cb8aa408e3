//! Many rays from one point of a convex room, some at a time: the same, bit for bit, as one by one ([`Hull::meet`]).
//!
//! What a triangle and the point have in common is found once for all of its rays ([`Edges::seen_from`]); which wall comes
//! first is found for all rays of a bundle side by side. Loops over lanes are written so that the compiler makes vectors of them.
//!
//! [`Edges::seen_from`]: crate::geometry::triangle::Edges::seen_from

use super::{BORDER, GRAZING, Hull, MOST_WALLS};
use crate::math::Vec3;

/// Rays of a bundle.
pub const LANES: usize = 8;

/// Directions of a bundle, axis by axis.
pub type Directions = [[f32; LANES]; 3];

/// The walls and triangles of a convex room as seen from a point.
#[derive(Debug)]
pub struct Panorama {
    n_walls: usize,
    walls: [WallSeen; MOST_WALLS],
    triangles: Vec<TriangleSeen>,
}

#[derive(Debug, Clone, Copy, Default)]
struct WallSeen {
    normal: [f32; 3],
    /// As [`super::Outlook`].
    inverse: f32,
    least: f32,
    /// Its triangles.
    first: usize,
    end: usize,
}

#[derive(Debug)]
struct TriangleSeen {
    primitive: u32,
    is_front: bool,
    /// By axis: what a direction's component counts in the determinant and in the weights of the second and third
    /// corner times it, with the sign that makes the determinant positive.
    axes: [[f64; 4]; 3],
    /// Over the determinant: the ray parameter.
    height: f64,
}

/// Where a ray of a bundle meets a wall.
#[derive(Debug, Clone, Copy)]
pub struct Met {
    /// Index of the triangle.
    pub primitive: u32,
    /// Barycentric weights of the second and third corner.
    pub place: (f64, f64),
    /// Ray parameter.
    pub t: f32,
    /// True if the triangle's normal points to the inside.
    pub is_front: bool,
}

impl Hull {
    /// What rays from a point have in common; `None` as in [`Hull::outlook`].
    #[inline]
    pub fn panorama(&self, origin: Vec3) -> Option<Panorama> {
        let (walls, outlook) = (self.walls.as_ref()?, self.outlook(origin)?);
        let mut seen = Panorama { n_walls: walls.n, walls: Default::default(), triangles: Vec::with_capacity(2 * walls.n) };
        for (k, wall) in seen.walls.iter_mut().take(walls.n).enumerate() {
            let (half, lane) = (k / 4, k % 4);
            let first = seen.triangles.len();
            for of in &walls.triangles[k] {
                let by = of.edges.seen_from(origin);
                // The determinant of a ray that comes from inside has the sign of the side that it comes to.
                let sign = if of.is_front { 1.0 } else { -1.0 };
                let axes = [0, 1, 2].map(|axis| [by.normal[axis], by.second[axis], by.third[axis], 0.0].map(|v| sign * v));
                let (primitive, is_front) = (of.primitive, of.is_front);
                seen.triangles.push(TriangleSeen { primitive, is_front, axes, height: sign * by.height });
            }
            *wall = WallSeen {
                normal: walls.normal[half].map(|axis| axis[lane]),
                inverse: outlook.inverse[half][lane],
                least: outlook.least[half][lane],
                first,
                end: seen.triangles.len(),
            };
        }
        Some(seen)
    }
}

impl Panorama {
    /// What rays without ends meet, where no rounding can make it another.
    #[inline(always)]
    pub fn meet(&self, directions: &Directions) -> [Option<Met>; LANES] {
        let [x, y, z] = directions;
        // One over the distance to the nearest plane ahead, and which that is.
        let (mut nearest, mut wall, mut is_unclear) = ([0.0_f32; LANES], [u32::MAX; LANES], [0_u32; LANES]);
        for (k, seen) in (0_u32..).zip(&self.walls[..self.n_walls]) {
            let [nx, ny, nz] = seen.normal;
            for lane in 0..LANES {
                let cosine = nx * x[lane] + ny * y[lane] + nz * z[lane];
                let rate = if cosine < -GRAZING { -cosine * seen.inverse } else { 0.0 };
                let is_first = rate > nearest[lane];
                nearest[lane] = if is_first { rate } else { nearest[lane] };
                wall[lane] = if is_first { k } else { wall[lane] };
                is_unclear[lane] |= u32::from(cosine.abs() <= seen.least);
            }
        }
        let mut met = [None; LANES];
        for lane in 0..LANES {
            let wall = wall[lane] as usize;
            if is_unclear[lane] == 0 && wall < self.n_walls {
                met[lane] = self.meet_wall(wall, [x[lane], y[lane], z[lane]].map(f64::from));
            }
        }
        met
    }

    /// The triangle of a wall that a ray meets.
    #[inline(always)]
    fn meet_wall(&self, wall: usize, [x, y, z]: [f64; 3]) -> Option<Met> {
        let WallSeen { first, end, .. } = self.walls[wall];
        for of in &self.triangles[first..end] {
            let [along_x, along_y, along_z] = &of.axes;
            let mut products = [0.0; 4];
            for k in 0..4 {
                products[k] = x * along_x[k] + y * along_y[k] + z * along_z[k];
            }
            let [determinant, u, v, _] = products;
            if u.min(v).min(determinant - u - v) > BORDER * determinant {
                let place = (u / determinant, v / determinant);
                let t = (of.height / determinant) as f32;
                return Some(Met { primitive: of.primitive, place, t, is_front: of.is_front });
            }
        }
        None
    }
}
