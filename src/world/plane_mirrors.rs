//! Flat ideal mirrors: windows through which a virtual room is seen, the room reflected in their plane ([Wallace87]).

use super::{SurfaceInteraction, World};
use crate::math::{DVec3, Frame, Vec3};
use crate::scene::ShapeSurface;
use std::collections::HashMap;

/// A mesh of mirrors in more planes than this is a curved mirror that happens to have facets.
const MOST_PLANES: usize = 32;
/// Most mirrors of a scene: the largest.
const MOST_MIRRORS: usize = 16;
/// Normals of one plane differ by no more, as 1 minus their cosine, and neither does a vertex normal from its face.
const ONE_PLANE: f32 = 1e-6;
/// Distances from a plane below this share of the scene's diagonal are rounding.
const FLAT: f32 = 1e-5;
/// Triangles fill their convex hull if their areas agree this well.
const FILLED: f64 = 1e-4;

/// A convex part of a flat mirror, on one of its sides.
#[derive(Debug, Clone)]
pub struct MirrorWindow {
    /// Corners, counter-clockwise as seen from the side that reflects.
    pub corners: Vec<DVec3>,
    /// Unit normal on that side.
    pub normal: DVec3,
}

impl MirrorWindow {
    /// Twice the area [m²].
    fn twice_area(&self) -> f64 {
        let first = self.corners[0];
        let cross = self.corners[1..].windows(2).map(|e| (e[0] - first).cross(e[1] - first).dot(self.normal));
        cross.sum()
    }

    /// Area [m²].
    pub fn area(&self) -> f64 {
        0.5 * self.twice_area()
    }

    /// Height of a point above the mirror's plane [m].
    #[inline]
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point - self.corners[0])
    }
}

/// The flat ideal mirrors of a scene.
#[derive(Debug, Clone, Default)]
pub struct PlaneMirrors {
    /// Their windows, the largest first.
    pub windows: Vec<MirrorWindow>,
    /// The window of a primitive, by the side that is seen.
    of: HashMap<(u32, bool), usize>,
}

/// Triangles of one plane and side.
struct Plane {
    normal: Vec3,
    point: Vec3,
    triangles: Vec<(u32, bool)>,
}

impl PlaneMirrors {
    /// Finds them: meshes whose material reflects ideally and does nothing else, on faces whose normals are their own.
    pub fn find(world: &World) -> Self {
        let mut found: Vec<(MirrorWindow, Vec<(u32, bool)>)> = Vec::new();
        for (index, shape) in world.scene().shapes.iter().enumerate() {
            let ShapeSurface::Mesh(mesh) = &shape.surface else { continue };
            let first = world.first_primitive(index);
            if world.scene().material_of(shape).relief.is_some() {
                continue;
            }
            let mut planes: Vec<Plane> = Vec::new();
            for primitive in first..first + mesh.triangles.len() as u32 {
                let here = world.on_triangle(primitive, (1.0 / 3.0, 1.0 / 3.0), Vec3::Z);
                let faces = [here.ng, -here.ng].map(|n| here.seen_from(n));
                let mirrors: Vec<&SurfaceInteraction> =
                    faces.iter().filter(|si| is_flat(world, si) && only_reflects(world, si)).collect();
                if mirrors.is_empty() && planes.is_empty() {
                    // What the first triangle is not, the others are hardly.
                    break;
                }
                for si in mirrors {
                    add(&mut planes, si, FLAT * world.bounds().diagonal());
                }
                if planes.len() > MOST_PLANES {
                    planes.clear();
                    break;
                }
            }
            found.extend(planes.iter().flat_map(|plane| windows(world, plane)));
        }
        found.sort_by(|a, b| b.0.area().total_cmp(&a.0.area()));
        found.truncate(MOST_MIRRORS);
        let of = found.iter().enumerate().flat_map(|(k, (_, all))| all.iter().map(move |side| (*side, k))).collect();
        Self { windows: found.into_iter().map(|f| f.0).collect(), of }
    }

    /// The window that a surface point belongs to, as it is seen.
    #[inline]
    pub fn window_of(&self, si: &SurfaceInteraction) -> Option<usize> {
        self.of.get(&(si.primitive, si.front)).copied()
    }
}

fn is_flat(world: &World, si: &SurfaceInteraction) -> bool {
    [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].iter().all(|&corner| {
        let at = world.on_triangle(si.primitive, corner, si.ng);
        at.ns.dot(si.ng) > 1.0 - ONE_PLANE
    })
}

fn only_reflects(world: &World, si: &SurfaceInteraction) -> bool {
    let shading = world.shading(si);
    let lobes = shading.lobes();
    !shading.has_diffuse() && !shading.has_glossy() && lobes.iter().count() == 1 && lobes.iter().all(|lobe| !lobe.transmits)
}

fn add(planes: &mut Vec<Plane>, si: &SurfaceInteraction, flat: f32) {
    let same = |p: &&mut Plane| p.normal.dot(si.ng) > 1.0 - ONE_PLANE && p.normal.dot(si.point - p.point).abs() < flat;
    match planes.iter_mut().find(same) {
        Some(plane) => plane.triangles.push((si.primitive, si.front)),
        None => planes.push(Plane { normal: si.ng, point: si.point, triangles: vec![(si.primitive, si.front)] }),
    }
}

/// One window if the triangles fill their convex hull, else one each.
fn windows(world: &World, plane: &Plane) -> Vec<(MirrorWindow, Vec<(u32, bool)>)> {
    let normal = plane.normal.as_dvec3().normalize();
    let window = |points: Vec<DVec3>| MirrorWindow { corners: hull(points, normal), normal };
    let corners = |primitive: u32| world.soup().corners(primitive as usize).map(|c| c.as_dvec3());
    let single: Vec<MirrorWindow> = plane.triangles.iter().map(|t| window(corners(t.0).to_vec())).collect();
    let whole = window(plane.triangles.iter().flat_map(|t| corners(t.0)).collect());
    let sum: f64 = single.iter().map(MirrorWindow::area).sum();
    if (whole.area() - sum).abs() <= FILLED * sum {
        return vec![(whole, plane.triangles.clone())];
    }
    single.into_iter().zip(plane.triangles.iter().map(|t| vec![*t])).collect()
}

/// Convex hull of points of a plane, counter-clockwise about `normal` [Andrew79].
fn hull(points: Vec<DVec3>, normal: DVec3) -> Vec<DVec3> {
    let frame = Frame::new(normal.as_vec3());
    // Any two directions across the normal will do to sort by.
    let across = normal.cross(frame.t.as_dvec3()).normalize();
    let up = normal.cross(across);
    let mut sorted: Vec<(f64, f64, DVec3)> = points.into_iter().map(|p| (across.dot(p), up.dot(p), p)).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let turn = |a: &(f64, f64, DVec3), b: &(f64, f64, DVec3), c: &(f64, f64, DVec3)| {
        (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0)
    };
    let half = |points: &mut dyn Iterator<Item = &(f64, f64, DVec3)>| {
        let mut kept: Vec<(f64, f64, DVec3)> = Vec::new();
        for p in points {
            while kept.len() > 1 && turn(&kept[kept.len() - 2], &kept[kept.len() - 1], p) <= 0.0 {
                kept.pop();
            }
            kept.push(*p);
        }
        kept.pop();
        kept
    };
    let lower = half(&mut sorted.iter());
    let upper = half(&mut sorted.iter().rev());
    lower.into_iter().chain(upper).map(|p| p.2).collect()
}
