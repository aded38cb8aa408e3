//! The solution of pass one at points of the surfaces that do not depend on its patches, so that two solutions can be compared.

use crate::geometry::{soup::Primitive, triangle};
use crate::math::{DVec3, Rgb, Sampler, Vec3, warp};
use crate::radiosity::RadiosityField;
use crate::world::{SurfaceInteraction, World};
use std::f64::consts::PI;

/// Key of the points' random numbers: the same for every run, whatever its seed.
const POINTS_KEY: u64 = 0x5eed_0f90;

/// Draws in which no diffuse side is found before the search is given up, for each point wanted.
const TRIES: u64 = 64;

/// A point of a surface, on one side of it, and what falls on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Place, in file coordinates.
    pub point: DVec3,
    /// Geometric normal of the side.
    pub normal: DVec3,
    /// Irradiance [W/m²] of the patch there; `None` in a gap between patches.
    pub irradiance: Option<Rgb>,
}

/// The irradiance at `n` points, drawn uniformly by area over all sides of surfaces that reflect diffusely. Fewer if there is no such
/// surface. A mean over them is an area-weighted mean over the scene.
pub fn irradiance(world: &World, field: &RadiosityField, n: u32) -> Vec<SurfacePoint> {
    let at = |si: SurfaceInteraction| SurfacePoint {
        point: world.scene().origin + si.point.as_dvec3(),
        normal: si.ng.as_dvec3(),
        irradiance: field.patches.patch_at(&si).map(|id| field.irradiance_of(id.0 as usize)),
    };
    points(world, n).into_iter().map(at).collect()
}

/// The points of [`irradiance`], in coordinates of the scene.
pub fn points(world: &World, n: u32) -> Vec<SurfaceInteraction> {
    let areas = running_areas(world);
    let Some(&total) = areas.last().filter(|total| **total > 0.0) else { return Vec::new() };
    let drawn = (0..u64::from(n) * TRIES).filter_map(|index| {
        let mut sampler = Sampler::new(POINTS_KEY, 0, index);
        let (pick, side) = (sampler.next_2d(), sampler.next_2d());
        let target = f64::from(pick.x) * total;
        let primitive = areas.partition_point(|area| *area <= target).min(areas.len() - 1) as u32;
        let si = point_of(world, primitive, side, pick.y < 0.5);
        (!world.shading(&si).diffuse_reflectance().is_black()).then_some(si)
    });
    drawn.take(n as usize).collect()
}

/// Running sums of the primitives' areas [m²].
fn running_areas(world: &World) -> Vec<f64> {
    let soup = world.soup();
    let mut sum = 0.0;
    (0..soup.len() as u32)
        .map(|i| {
            sum += match soup.primitive(i) {
                Primitive::Triangle([a, b, c]) => triangle::area_vector(a, b, c).length(),
                Primitive::Sphere(s) => 4.0 * PI * f64::from(s.radius) * f64::from(s.radius),
            };
            sum
        })
        .collect()
}

/// The point of a primitive at `u` in the unit square, as seen from its front or its back.
fn point_of(world: &World, primitive: u32, u: crate::math::Vec2, front: bool) -> SurfaceInteraction {
    let on = |wo: Vec3| match world.soup().primitive(primitive) {
        Primitive::Triangle(_) => {
            let w = warp::triangle(u);
            world.on_triangle(primitive, (f64::from(w.x), f64::from(w.y)), wo)
        }
        Primitive::Sphere(_) => world.on_sphere(primitive, warp::sphere(u), wo, 0.0),
    };
    let normal = on(Vec3::Z).ng;
    // The interaction's normal may already be turned towards the viewer, who stands along +z: both ways lead to one side each.
    on(if front { normal } else { -normal })
}
