//! All primitives of a scene in flat arrays, as the acceleration structures want them.

use super::{Bounds, Sphere};
use crate::math::Vec3;

/// Triangles, then spheres: primitive `i` is triangle `i` if `i < triangles.len()`, else sphere `i - triangles.len()`.
#[derive(Debug, Clone, Default)]
pub struct Soup {
    /// Vertices of all meshes.
    pub vertices: Vec<Vec3>,
    /// Indices into `vertices`.
    pub triangles: Vec<[u32; 3]>,
    /// Spheres.
    pub spheres: Vec<Sphere>,
}

/// One primitive of a [`Soup`].
#[derive(Debug, Clone, Copy)]
pub enum Primitive {
    /// Three corners.
    Triangle([Vec3; 3]),
    /// A sphere.
    Sphere(Sphere),
}

impl Soup {
    /// Number of primitives.
    pub fn len(&self) -> usize {
        self.triangles.len() + self.spheres.len()
    }

    /// True if there is no primitive.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Corners of triangle `index`.
    #[inline]
    pub fn corners(&self, index: usize) -> [Vec3; 3] {
        self.triangles[index].map(|i| self.vertices[i as usize])
    }

    /// Primitive `index`.
    #[inline]
    pub fn primitive(&self, index: u32) -> Primitive {
        let index = index as usize;
        match index.checked_sub(self.triangles.len()) {
            None => Primitive::Triangle(self.corners(index)),
            Some(sphere) => Primitive::Sphere(self.spheres[sphere]),
        }
    }

    /// Tight box of primitive `index`.
    pub fn bounds_of(&self, index: u32) -> Bounds {
        match self.primitive(index) {
            Primitive::Triangle(corners) => corners.into_iter().collect(),
            Primitive::Sphere(s) => {
                let r = Vec3::splat(s.radius.next_up());
                Bounds::new((s.center - r).map(f32::next_down), (s.center + r).map(f32::next_up))
            }
        }
    }

    /// Box of everything.
    pub fn bounds(&self) -> Bounds {
        (0..self.len() as u32).map(|i| self.bounds_of(i)).fold(Bounds::EMPTY, Bounds::union)
    }
}
