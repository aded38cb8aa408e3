//! How the texture coordinates lie on a surface: for brushed metal and for bump and normal maps.

use super::{SurfaceInteraction, World};
use crate::geometry::soup::Primitive;
use crate::math::{Frame, Vec3};
use crate::scene::ShapeSurface;
use std::f32::consts::{PI, TAU};

impl World {
    /// Derivatives of the point at `si` by its two texture coordinates [m]; the edges of the triangle where they are of no use.
    pub(super) fn tangents(&self, si: &SurfaceInteraction) -> (Vec3, Vec3) {
        match self.soup.primitive(si.primitive) {
            Primitive::Triangle([a, b, c]) => {
                let (e1, e2) = (b - a, c - a);
                let ShapeSurface::Mesh(mesh) = &self.scene.shapes[si.shape as usize].surface else { return (e1, e2) };
                if mesh.uvs.is_empty() {
                    return (e1, e2);
                }
                let index = (si.primitive - self.first_primitive[si.shape as usize]) as usize;
                let [p, q, r] = mesh.triangles[index].map(|i| mesh.uvs[i as usize]);
                let (d1, d2) = (q - p, r - p);
                let det = d1.perp_dot(d2);
                let (du, dv) = ((e1 * d2.y - e2 * d1.y) / det, (e2 * d1.x - e1 * d2.x) / det);
                if du.is_finite() && dv.is_finite() && du != Vec3::ZERO { (du, dv) } else { (e1, e2) }
            }
            Primitive::Sphere(sphere) => {
                let p = si.point - sphere.center;
                let around = p.truncate().length();
                let du = Vec3::new(-p.y, p.x, 0.0) * TAU;
                let dv = Vec3::new(p.x * p.z / around, p.y * p.z / around, -around) * PI;
                // At the poles all longitudes meet.
                if dv.is_finite() { (du, dv) } else { (Vec3::X, Vec3::Y) }
            }
        }
    }

    /// The frame at `si` about `n` on the viewer's side, its first tangent along the texture's u; the second is the same on both
    /// sides of the surface, so that a mirrored frame shows the same texture.
    pub(super) fn textured_frame(&self, si: &SurfaceInteraction, n: Vec3, du: Vec3) -> Frame {
        let Some(s) = (du - n * n.dot(du)).try_normalize() else { return Frame::new(n) };
        let own = if si.front { n } else { -n };
        Frame { s, t: own.cross(s), n }
    }
}
