//! Triangles from a mesh file to world coordinates, with the normals that Mitsuba would give them.

use super::error::LoadErrorKind;
use crate::geometry::tessellate::Triangles;
use crate::math::{DAffine3, DVec3, Vec2};

/// A mesh in its own coordinates.
#[derive(Debug, Clone, Default)]
pub(super) struct RawMesh {
    pub positions: Vec<DVec3>,
    /// One a vertex, or none at all. A zero vector: this vertex has none.
    pub normals: Vec<DVec3>,
    /// One a vertex, or none at all.
    pub uvs: Vec<Vec2>,
    pub triangles: Vec<[u32; 3]>,
}

/// How a mesh is placed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placement {
    pub to_world: DAffine3,
    /// Drop vertex normals: every triangle is flat.
    pub face_normals: bool,
    pub flip_normals: bool,
}

/// A fault in a mesh file.
#[derive(Debug)]
pub(super) struct MeshFault {
    /// Byte offset of the faulty line in a text file.
    pub offset: Option<usize>,
    pub kind: LoadErrorKind,
}

impl MeshFault {
    /// What was expected and what was found instead.
    pub fn new(offset: Option<usize>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self { offset, kind: LoadErrorKind::Malformed { expected: expected.into(), found: found.into() } }
    }
}

impl Placement {
    /// The mesh in world coordinates.
    ///
    /// Vertex normals are made where there are none. The side of a triangle is that of its shading normals, as in Mitsuba: where
    /// the winding disagrees with them (after a mirroring, or in a careless export) it is reversed.
    pub fn apply(&self, mesh: RawMesh) -> Triangles {
        let RawMesh { mut positions, mut normals, uvs, mut triangles } = mesh;
        positions.iter_mut().for_each(|p| *p = self.to_world.transform_point3(*p));
        if self.face_normals {
            normals = Vec::new();
        } else if normals.is_empty() {
            normals = smooth_normals(&positions, &triangles);
        } else {
            // The inverse transpose, up to a positive factor.
            let to_world = self.to_world.matrix3.inverse().transpose();
            normals.iter_mut().for_each(|n| *n = (to_world * *n).normalize_or_zero());
        }
        if !normals.is_empty() {
            triangles.iter_mut().for_each(|t| agree(t, &positions, &normals));
        }
        let mut shape = Triangles { positions, normals: normals.iter().map(|n| n.as_vec3()).collect(), uvs, triangles };
        if self.flip_normals {
            shape.flip();
            shape.normals.iter_mut().for_each(|n| *n = -*n);
        }
        shape
    }
}

/// Vertex normals: those of the adjacent faces, weighted by the angle that each face has at the vertex (Thuermer and
/// Wuethrich 1998, "Computing Vertex Normals from Polygonal Facets").
fn smooth_normals(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; positions.len()];
    for t in triangles {
        let p = t.map(|i| positions[i as usize]);
        let Some(n) = (p[1] - p[0]).cross(p[2] - p[0]).try_normalize() else { continue };
        for i in 0..3 {
            let angle = (p[(i + 1) % 3] - p[i]).angle_between(p[(i + 2) % 3] - p[i]);
            normals[t[i] as usize] += n * angle;
        }
    }
    normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    normals
}

fn agree(t: &mut [u32; 3], positions: &[DVec3], normals: &[DVec3]) {
    let [a, b, c] = t.map(|i| positions[i as usize]);
    let shading: DVec3 = t.iter().map(|i| normals[*i as usize]).sum();
    if (b - a).cross(c - a).dot(shading) < 0.0 {
        t.swap(1, 2);
    }
}

/// Triangles of a polygon as a fan from its first corner, as Mitsuba does.
pub(super) fn fan(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    corners.windows(2).skip(1).map(|w| [corners[0], w[0], w[1]])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilted_triangle() -> RawMesh {
        let positions = vec![DVec3::ZERO, DVec3::X, DVec3::new(0.0, 1.0, -1.0)];
        let n = DVec3::new(0.0, 1.0, 1.0).normalize();
        RawMesh { positions, normals: vec![n; 3], uvs: Vec::new(), triangles: vec![[0, 1, 2]] }
    }

    fn face_normal(t: &Triangles) -> DVec3 {
        let [a, b, c] = t.triangles[0].map(|i| t.positions[i as usize]);
        (b - a).cross(c - a).normalize()
    }

    #[test]
    fn normals_stay_perpendicular_under_any_transform() {
        for scale in [DVec3::new(1.0, 3.0, 0.5), DVec3::new(-1.0, 1.0, 1.0), DVec3::new(2.0, 2.0, -0.1)] {
            let placement = Placement { to_world: DAffine3::from_scale(scale), face_normals: false, flip_normals: false };
            let t = placement.apply(tilted_triangle());
            let n = t.normals[0].as_dvec3();
            let face = face_normal(&t);
            assert!((n - face).length() < 1e-6, "scale {scale}: shading {n}, face {face}");
        }
    }

    #[test]
    fn flipping_turns_winding_and_normals() {
        let placement = |flip_normals| Placement { to_world: DAffine3::IDENTITY, face_normals: false, flip_normals };
        let (a, b) = (placement(false).apply(tilted_triangle()), placement(true).apply(tilted_triangle()));
        assert!((face_normal(&a) + face_normal(&b)).length() < 1e-12);
        assert_eq!(a.normals[1], -b.normals[1]);
    }

    #[test]
    fn a_fan_has_two_triangles_less_than_corners() {
        assert_eq!(fan(&[5, 6, 7, 8]).collect::<Vec<_>>(), vec![[5, 6, 7], [5, 7, 8]]);
        assert_eq!(fan(&[1, 2]).count(), 0);
    }
}
