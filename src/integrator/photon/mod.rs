//! Photons: particles from the lamps, kept where they meet diffuse surfaces.

mod face;
mod gather;
mod grid;
mod maps;
mod sppm;

pub use gather::PhotonMapper;
pub use sppm::Sppm;

use super::bidirectional::Heuristic;
use super::bidirectional::subpath::{Carried, Met, Vertex, Walk, depart};
use crate::light::Light;
use crate::material::Scattering;
use crate::math::{Rgb, Sampler, SamplerKind, Vec3};
use crate::world::walk::RayCounts;
use crate::world::{Departures, DirectSampling, Shading, ShadowRay, SurfaceInteraction, World};
use face::Face;
use grid::PhotonGrid;
use rayon::prelude::*;
use std::f64::consts::FRAC_1_PI;

/// Photons of one task.
const CHUNK: u64 = 1024;
/// Photons that graze a face more than this count as if they came at this cosine: rounding and bent normals would make them sparks.
const LEAST_COSINE: f64 = 0.02;

/// A photon where it met a diffuse part.
#[derive(Debug, Clone, Copy)]
pub(super) struct Photon {
    /// The point.
    pub point: Vec3,
    /// Geometric normal on the side it came to.
    pub normal: Vec3,
    /// Unit direction it came from.
    pub direction: Vec3,
    /// Power [W].
    pub power: Rgb,
    /// Edges from the lamp.
    pub edges: u32,
    /// By what way it came.
    pub way: Way,
}

/// The way of a photon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// Straight from an emitter that shadow rays find.
    Direct,
    /// By ideal mirrors and glass alone from an emitter that shadow rays find, or from a point.
    Caustic,
    /// Any other.
    Other,
}

/// How photons are shot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shots {
    pub photons: u64,
    /// Longest way in edges.
    pub most_edges: u32,
    pub seed: u64,
    pub sampler: SamplerKind,
}

/// Shoots photons: those that met diffuse parts, in an order that depends on nothing but the settings.
pub(super) fn shoot(world: &World, departures: &Departures, shots: &Shots, counts: &mut RayCounts) -> Vec<Photon> {
    let share = 1.0 / shots.photons as f64;
    let found: Vec<(Vec<Photon>, RayCounts)> = (0..shots.photons.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let mut counts = RayCounts::default();
            let mut photons = Vec::new();
            for k in chunk * CHUNK..((chunk + 1) * CHUNK).min(shots.photons) {
                let mut sampler = Sampler::of(shots.sampler, shots.seed, 0, k);
                let Some((start, departure)) = depart(world, departures, &mut sampler) else { continue };
                counts.particle += 1;
                let by_shadow_rays = departure.light.is_some_and(|i| match &world.scene().lights[i] {
                    Light::Area(lamp) => world.partition().found_by_shadow_rays(lamp.shape as usize),
                    Light::Environment(_) => true,
                    Light::Point(_) | Light::Spot(_) | Light::Directional(_) => true,
                });
                let is_sky = departure.light.is_none_or(|i| matches!(world.scene().lights[i], Light::Environment(_)));
                let walk = Walk { world, heuristic: Heuristic::Balance, carried: Carried::Light };
                let begin = |_: &mut Vertex, _: &Shading<'_>| {};
                walk.go(start, shots.most_edges, &mut sampler, &mut counts, begin, |met, _, _| {
                    let Met::Surface(vertex, shading, _) = met else { return };
                    if !shading.has_diffuse() {
                        return;
                    }
                    let way = match (vertex.edges, vertex.scattered) {
                        (1, _) if by_shadow_rays => Way::Direct,
                        (2.., 0) if by_shadow_rays && !is_sky => Way::Caustic,
                        _ => Way::Other,
                    };
                    let Vertex { si, throughput, edges, .. } = *vertex;
                    photons.push(Photon {
                        point: si.point,
                        normal: si.ng,
                        direction: si.wo,
                        power: throughput * share,
                        edges,
                        way,
                    });
                });
            }
            (photons, counts)
        })
        .collect();
    let mut photons = Vec::with_capacity(found.iter().map(|(p, _)| p.len()).sum());
    for (p, c) in found {
        photons.extend(p);
        *counts += c;
    }
    photons
}

impl Photon {
    /// What the diffuse part at `si`, where it counts as arriving, sends of it to the viewer: radiance times area [W/sr].
    #[inline]
    fn reflected(&self, si: &SurfaceInteraction, shading: &Shading<'_>) -> Rgb {
        let cos = f64::from(si.ng.dot(self.direction));
        let response = match shading.plain() {
            Some(rho) if cos > 0.0 => rho * (f64::from(shading.normal().dot(self.direction)).max(0.0) * FRAC_1_PI),
            Some(_) => return Rgb::BLACK,
            None => shading.eval(self.direction).diffuse,
        };
        self.power * response / cos.abs().max(LEAST_COSINE)
    }
}

/// The face around what is looked at, for disks of a radius.
fn face_at<'a>(world: &'a World, si: &SurfaceInteraction, radius: f32) -> Face<'a> {
    Face { world, at: (si.point, si.ng), height: 0.3 * radius, least_cosine: 0.7 }
}

/// What the diffuse part at `si` reflects of the lights that shadow rays find.
fn direct(
    world: &World,
    si: &SurfaceInteraction,
    shading: &Shading<'_>,
    gather_rays: f64,
    sampling: DirectSampling,
    sampler: &mut Sampler,
    counts: &mut RayCounts,
) -> Rgb {
    let respond = |ray: &ShadowRay| {
        let share = ray.share_beside_gather_rays(gather_rays, ray.direction.dot(shading.normal()));
        Scattering { diffuse: shading.eval(ray.direction).diffuse * share, glossy: Rgb::BLACK }
    };
    world.direct(si, shading.receiver(), sampling, sampler, counts, respond).diffuse
}
