//! The shapes of patches as polygons, for form factors in closed form.

use super::subdivide::Point;
use super::{PatchId, PatchMesh, Piece};
use crate::geometry::soup::Primitive;
use crate::math::{DVec3, Vec3};
use crate::world::World;
use std::f64::consts::TAU;

/// Corners of a planar convex polygon, counter-clockwise as seen from its patch's side.
pub type Outline = Vec<DVec3>;

impl PatchMesh {
    /// Number of pieces that patch `id` consists of: an upper bound on the number of its outlines.
    pub fn n_pieces(&self, id: PatchId) -> usize {
        self.elements[self.element_of[id.0 as usize] as usize].pieces.len()
    }

    /// The planar polygons that patch `id` consists of [m]: one for a piece of a triangle, one for each triangle of a group. The cell of a
    /// sphere is replaced by the flat one between its corners, which lies a little below.
    pub fn outlines(&self, world: &World, id: PatchId) -> Vec<Outline> {
        let element = &self.elements[self.element_of[id.0 as usize] as usize];
        let pieces = &self.pieces[element.pieces.start as usize..element.pieces.end as usize];
        let front = self.side[id.0 as usize];
        let mut outlines: Vec<Outline> = Vec::with_capacity(1);
        let mut rest = pieces;
        while let Some(Piece::Triangle { primitive, inset, .. }) = rest.first() {
            // The pieces of one split part are the fan around its first corner; groups hold each triangle once.
            let same = |piece: &&Piece| matches!(piece, Piece::Triangle { primitive: p, .. } if p == primitive);
            let fan = rest.iter().take_while(same).count();
            let mut outline = polygon(world, *primitive, f64::from(*inset), &rest[..fan]);
            // Vertex normals decide what the front of a triangle is, whatever its winding.
            let si = world.on_triangle(*primitive, (1.0 / 3.0, 1.0 / 3.0), Vec3::Z);
            let own = if si.front == front { si.ng } else { -si.ng };
            if winding(&outline).dot(own.as_dvec3()) < 0.0 {
                outline.reverse();
            }
            outlines.push(outline);
            rest = &rest[fan..];
        }
        if let Some(&Piece::SphereCell { primitive, row, column, rows, columns }) = rest.first()
            && let Primitive::Sphere(sphere) = world.soup().primitive(primitive)
        {
            let at = |row: u32, column: u32| {
                let z = 1.0 - 2.0 * f64::from(row) / f64::from(rows);
                let (s, c) = (TAU * f64::from(column) / f64::from(columns)).sin_cos();
                let r = (1.0 - z * z).max(0.0).sqrt();
                sphere.center.as_dvec3() + DVec3::new(r * c, r * s, z) * f64::from(sphere.radius)
            };
            let mut outline = vec![at(row, column), at(row + 1, column), at(row + 1, column + 1), at(row, column + 1)];
            if !front {
                outline.reverse();
            }
            outlines.push(outline);
        }
        outlines
    }
}

/// Twice the area vector [m²].
pub fn winding(corners: &[DVec3]) -> DVec3 {
    let first = corners[0];
    corners[1..].windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum()
}

/// The polygon whose fan `pieces` are, its corners moved back out to where they were before the inset.
fn polygon(world: &World, primitive: u32, inset: f64, pieces: &[Piece]) -> Outline {
    let mut corners: Vec<Point> = Vec::with_capacity(pieces.len() + 2);
    for piece in pieces {
        let Piece::Triangle { corners: [first, second, third], .. } = piece else { continue };
        if corners.is_empty() {
            corners.extend([first, second].map(|c| c.map(f64::from)));
        }
        corners.push(third.map(f64::from));
    }
    let n = corners.len() as f64;
    let middle = corners.iter().fold([0.0, 0.0], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]);
    let [a, b, c] = world.soup().corners(primitive as usize).map(|c| c.as_dvec3());
    let place = |p: &Point| {
        let [u, v] = [0, 1].map(|k| middle[k] + (p[k] - middle[k]) / inset);
        a + (b - a) * u + (c - a) * v
    };
    corners.iter().map(place).collect()
}
