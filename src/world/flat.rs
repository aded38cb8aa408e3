//! What is known of every triangle before a ray meets it, in scenes of flat walls that reflect diffusely and alike all over.

use super::convex::Outlook;
use super::convex::bundle::{Met, Panorama};
use super::stages::Stages;
use super::{SurfaceInteraction, World};
use crate::geometry::{Ray, Soup, triangle};
use crate::material::{Material, Texture};
use crate::math::{Rgb, Vec2, Vec3};
use crate::scene::{Scene, Shape, ShapeSurface};

/// Scenes of more triangles are not looked at: there the tree takes the time.
const MOST_TRIANGLES: usize = 1 << 16;

/// The triangles of a scene of flat, diffuse walls without textures.
#[derive(Debug)]
pub struct Flat {
    triangles: Vec<FlatTriangle>,
}

/// One of them.
#[derive(Debug)]
pub(super) struct FlatTriangle {
    /// Corners.
    pub vertices: [Vec3; 3],
    /// Unit normal by the order of the corners.
    pub normal: Vec3,
    /// Bound on the rounding of a point, per coordinate.
    pub error: f32,
    /// Index of the shape.
    pub shape: u32,
    /// Reflectance.
    pub rho: Rgb,
    /// True if the back reflects as well.
    pub two_sided: bool,
}

impl Flat {
    /// `None` if some surface is curved, smoothed, textured, or does more than reflect diffusely.
    pub(super) fn of(scene: &Scene, soup: &Soup, shape_of_primitive: &[u32]) -> Option<Self> {
        if !soup.spheres.is_empty() || soup.triangles.len() > MOST_TRIANGLES {
            return None;
        }
        let plain: Vec<(Rgb, bool)> = scene.shapes.iter().map(|shape| plain(scene, shape)).collect::<Option<_>>()?;
        let triangles = shape_of_primitive.iter().enumerate().map(|(i, &shape)| {
            let corners = soup.corners(i);
            let [a, b, c] = corners;
            let (rho, two_sided) = plain[shape as usize];
            FlatTriangle {
                vertices: corners,
                normal: triangle::normal(a, b, c),
                error: triangle::leaving_error(a, b, c),
                shape,
                rho,
                two_sided,
            }
        });
        Some(Self { triangles: triangles.collect() })
    }

    #[inline]
    pub(super) fn triangle(&self, primitive: u32) -> &FlatTriangle {
        &self.triangles[primitive as usize]
    }
}

/// Where a ray meets such a triangle.
#[derive(Debug, Clone, Copy)]
pub struct FlatHit {
    /// Index of the triangle.
    pub primitive: u32,
    /// Index of its shape.
    pub shape: u32,
    /// Barycentric weights of the second and third corner.
    pub place: (f64, f64),
    /// Ray parameter.
    pub t: f32,
    /// True if the ray comes from the side to which the triangle's normal points.
    pub front: bool,
    /// True if that side reflects.
    pub diffuse: bool,
    /// Reflectance towards where the ray comes from.
    pub rho: Rgb,
    /// Unit normal on that side.
    pub normal: Vec3,
    /// Direction to where the ray comes from, of any length.
    back: Vec3,
}

impl World {
    /// What rays from a point may know beforehand, for [`Self::meet_flat_from`].
    #[inline]
    pub fn outlook<K: Stages>(&self, origin: Vec3) -> Option<Outlook> {
        if K::HULL { self.hull.as_ref()?.outlook(origin) } else { None }
    }

    /// What a ray meets, in a scene of flat walls, of which the plan knows: the same, bit for bit, as by [`World::intersect`].
    #[inline]
    pub fn meet_flat<K: Stages>(&self, ray: &Ray) -> Option<FlatHit> {
        self.meet_flat_from::<K>(&self.outlook::<K>(ray.origin), ray)
    }

    /// As [`Self::meet_flat`], by the outlook of the ray's origin.
    #[inline(always)]
    pub fn meet_flat_from<K: Stages>(&self, outlook: &Option<Outlook>, ray: &Ray) -> Option<FlatHit> {
        let flat = self.flat.as_ref()?;
        let by_hull = match (outlook, &self.hull) {
            (Some(outlook), Some(hull)) if K::HULL => hull.meet(outlook, ray),
            _ => None,
        };
        let back = -ray.direction;
        let (primitive, place, t) = match by_hull {
            Some(found) => found,
            None => {
                let primitive = self.accel.intersect(ray)?.primitive;
                let (place, t) = triangle::locate(ray, flat.triangle(primitive).vertices);
                (primitive, place, t)
            }
        };
        let of = flat.triangle(primitive);
        let front = back.dot(of.normal) >= 0.0;
        let normal = if front { of.normal } else { -of.normal };
        // As Material::diffuse_toward: a viewer in the plane of a face sees nothing of it. By the hull no face is met at such an angle.
        let diffuse = front || of.two_sided;
        let is_seen = (K::HULL && by_hull.is_some()) || back.normalize().dot(normal) > 0.0;
        let rho = if diffuse && is_seen { of.rho } else { Rgb::BLACK };
        Some(FlatHit { primitive, shape: of.shape, place, t, front, diffuse, rho, normal, back })
    }

    /// What a point of a convex room knows of its walls for bundles of rays.
    #[inline(always)]
    pub fn panorama<K: Stages>(&self, origin: Vec3) -> Option<Panorama> {
        if K::HULL { self.hull.as_ref()?.panorama(origin) } else { None }
    }

    /// What a ray of a bundle has met, as [`Self::meet_flat`] has it.
    #[inline(always)]
    pub fn met_in_bundle(&self, met: Met, direction: Vec3) -> Option<FlatHit> {
        let Met { primitive, place, t, is_front: front } = met;
        let of = self.flat.as_ref()?.triangle(primitive);
        let normal = if front { of.normal } else { -of.normal };
        let diffuse = front || of.two_sided;
        let rho = if diffuse { of.rho } else { Rgb::BLACK };
        Some(FlatHit { primitive, shape: of.shape, place, t, front, diffuse, rho, normal, back: -direction })
    }

    /// The surface there.
    #[inline]
    pub fn flat_interaction(&self, hit: &FlatHit) -> SurfaceInteraction {
        let (u, v) = hit.place;
        let (point, error) = self.flat_point(hit.primitive, (u, v));
        SurfaceInteraction {
            point,
            error,
            ng: hit.normal,
            ns: hit.normal,
            uv: Vec2::new(u as f32, v as f32),
            place: hit.place,
            shape: hit.shape,
            primitive: hit.primitive,
            front: hit.front,
            wo: hit.back.normalize(),
            t: hit.t,
            end: hit.t,
        }
    }

    /// As [`World::on_triangle`], on the front or on the back and seen along the normal there.
    #[inline]
    pub fn on_flat(&self, primitive: u32, (u, v): (f64, f64), front: bool) -> Option<SurfaceInteraction> {
        let of = self.flat.as_ref()?.triangle(primitive);
        let (point, error) = self.flat_point(primitive, (u, v));
        let normal = if front { of.normal } else { -of.normal };
        Some(SurfaceInteraction {
            point,
            error,
            ng: normal,
            ns: normal,
            uv: Vec2::new(u as f32, v as f32),
            place: (u, v),
            shape: of.shape,
            primitive,
            front,
            wo: normal,
            t: 0.0,
            end: 0.0,
        })
    }

    /// The point of a flat triangle with the given weights, and the bound on its rounding.
    #[inline]
    fn flat_point(&self, primitive: u32, (u, v): (f64, f64)) -> (Vec3, Vec3) {
        let Some(of) = self.flat.as_ref().map(|flat| flat.triangle(primitive)) else { return (Vec3::ZERO, Vec3::ZERO) };
        let [a, b, c] = of.vertices.map(|p| p.as_dvec3());
        let w = 1.0 - u - v;
        ((a * w + b * u + c * v).as_vec3(), Vec3::splat(of.error))
    }
}

/// Reflectance of a shape, and whether its back has it as well, if that is all there is to say of it.
fn plain(scene: &Scene, shape: &Shape) -> Option<(Rgb, bool)> {
    let surface = scene.material_of(shape);
    let is_flat = matches!(&shape.surface, ShapeSurface::Mesh(mesh) if mesh.normals.is_empty());
    match surface.material {
        Material::Diffuse { reflectance: Texture::Constant(rho) } if is_flat && surface.relief.is_none() => {
            matches!(shape.emission, Texture::Constant(_)).then_some((rho, surface.two_sided))
        }
        _ => None,
    }
}
