//! Indexed triangle mesh.

use crate::math::{Vec2, Vec3};

/// Triangles over shared vertices. Valid once it exists: indices in range, all numbers finite, no triangle without area.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Vertex positions, relative to the scene's origin.
    pub positions: Vec<Vec3>,
    /// Unit shading normal of each vertex; empty: the geometric normal is used.
    pub normals: Vec<Vec3>,
    /// Texture coordinates of each vertex; empty: none.
    pub uvs: Vec<Vec2>,
    /// Vertex indices; counter-clockwise as seen from the normal's side.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Corner positions of triangle `index`.
    #[inline]
    pub fn corners(&self, index: usize) -> [Vec3; 3] {
        self.triangles[index].map(|i| self.positions[i as usize])
    }

    /// Total area in f64.
    pub fn area(&self) -> f64 {
        (0..self.triangles.len())
            .map(|i| {
                let [a, b, c] = self.corners(i);
                super::triangle::area_vector(a, b, c).length()
            })
            .sum()
    }
}
