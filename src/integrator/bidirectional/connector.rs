//! All ways to make a path of walks from both ends, each weighted against all others.

use super::subpath::{CONNECTION_WORTH, Carried, LastEdge, Met, Scattered, Start, Vertex, Walk, begin_light, depart};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::integrator::Frame;
use crate::material::Scattering;
use crate::math::{Rgb, Sampler, Vec3};
use crate::scene::Sighting;
use crate::world::walk::RayCounts;
use crate::world::{All, Departures, Shading, ShadowRay, SurfaceInteraction, World};
use serde::{Deserialize, Serialize};
use std::cell::Cell;

/// No path is longer, whatever the scene asks.
const DEEPEST: u32 = 512;
/// What would bring less than is worth a ray is asked for by no less of a chance.
const LEAST_CHANCE: f64 = 0.05;

/// How the ways to make a path share it [Veach95].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Heuristic {
    /// By their densities.
    Balance,
    /// By the squares of their densities: leaves more to the best of them.
    #[default]
    Power,
}

impl Heuristic {
    /// Both.
    pub const ALL: [Heuristic; 2] = [Heuristic::Balance, Heuristic::Power];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Heuristic::Balance => "balance",
            Heuristic::Power => "power",
        }
    }

    /// What counts of a density.
    #[inline]
    pub fn of(self, density: f64) -> f64 {
        match self {
            Heuristic::Balance => density,
            Heuristic::Power => density * density,
        }
    }
}

/// What a way to make a path brings, with its weight.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// Radiance that leaves the second vertex of the camera's walk, or radiance at the camera where there is none.
    pub light: Rgb,
    /// Share of the sum over all ways that depends on how the walk came to its second vertex, in [0, 1].
    pub lent: f64,
}

impl Found {
    const NOTHING: Found = Found { light: Rgb::BLACK, lent: 0.0 };
}

/// All ways to make paths of a scene.
pub struct Connector<'a> {
    /// The scene.
    pub world: &'a World,
    /// Its emitters; `None` if nothing emits.
    pub departures: Option<Departures>,
    /// How the ways share a path.
    pub heuristic: Heuristic,
    /// Longest path in edges.
    pub limit: u32,
    /// Light walks for each camera sample of one pixel: as many as the pass has pixels.
    pub light_walks: f64,
    /// Width of the whole picture in pixels.
    pub width: usize,
    /// Its height.
    pub height: usize,
}

impl<'a> Connector<'a> {
    /// For passes of one light walk a pixel of `frame`.
    pub fn new(world: &'a World, max_depth: Option<u32>, heuristic: Heuristic) -> Self {
        let limit = max_depth.map_or(DEEPEST, |d| d.min(DEEPEST));
        Self { world, departures: Departures::new(world), heuristic, limit, light_walks: 1.0, width: 1, height: 1 }
    }

    /// Sets the size of the picture and the number of light walks.
    pub fn set_frame(&mut self, frame: &Frame) {
        (self.width, self.height, self.light_walks) = (frame.width, frame.height, frame.n_pixels().max(1) as f64);
    }

    /// Light of one edge along a camera ray, or of up to two: emission and what the first surface reflects of lamps, and what the layers say
    /// of that surface: by walks from the camera alone, whose ways share it among themselves.
    pub fn short_paths(&self, ray: Ray, most_edges: u32, sampler: &mut Sampler, counts: &mut RayCounts) -> PixelSample {
        let mut sample = PixelSample::default();
        let walk = Walk { world: self.world, heuristic: self.heuristic, carried: Carried::Radiance };
        // So few edges are all that is asked of this walk: that is no limit which cuts light off.
        let mut uncounted = RayCounts::default();
        // Sums of zero: nothing comes to the camera from lamps.
        let begin = Start { d_vcm: 0.0, ..self.camera_start(ray) };
        let limit = self.limit.min(most_edges);
        walk.go(
            begin,
            limit,
            sampler,
            &mut uncounted,
            |_, _| {},
            |met, sampler, _| match met {
                Met::Outside(direction, edge) => {
                    *sample.layer(layer_of(edge.scattered, edge.by_ideal)) += edge.before * self.met(direction, None, edge).light;
                }
                Met::Surface(vertex, shading, edge) => {
                    let found = self.met(-vertex.si.wo, Some(&vertex.si), edge);
                    *sample.layer(layer_of(edge.scattered, edge.by_ideal)) += edge.before * found.light;
                    if vertex.edges > 1 {
                        return;
                    }
                    *sample.layer(Quantity::Depth) = Rgb::grey(f64::from(vertex.si.t));
                    *sample.layer(Quantity::Normal) = Rgb::from(vertex.si.ns.to_array());
                    *sample.layer(Quantity::Albedo) += vertex.throughput * shading.diffuse_reflectance();
                    if limit > 1 && (shading.has_diffuse() || shading.has_glossy()) {
                        let direct = sample.layer(Quantity::Direct);
                        self.direct(vertex, shading, sampler, counts, |found| *direct += found.light);
                    }
                }
            },
        );
        sample
    }

    /// One light walk; `visit` gets every vertex that is not ideal through and through.
    pub fn light_walk(
        &self,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
        visit: impl FnMut(&Vertex, &Shading<'_>, &mut RayCounts),
    ) {
        self.light_walk_of(self.limit.saturating_sub(1), sampler, counts, visit);
    }

    /// As [`Self::light_walk`], of no more than `most_edges`.
    pub fn light_walk_of(
        &self,
        most_edges: u32,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
        mut visit: impl FnMut(&Vertex, &Shading<'_>, &mut RayCounts),
    ) {
        let Some(departures) = &self.departures else { return };
        if most_edges == 0 {
            return;
        }
        let Some((start, departure)) = depart(self.world, departures, sampler) else { return };
        counts.particle += 1;
        let walk = Walk { world: self.world, heuristic: self.heuristic, carried: Carried::Light };
        let begin = |vertex: &mut Vertex, shading: &Shading<'_>| {
            begin_light(self.world, self.heuristic, &departure, vertex, shading);
        };
        walk.go(start, most_edges, sampler, counts, begin, |met, _, counts| {
            if let Met::Surface(vertex, shading, _) = met
                && (shading.has_diffuse() || shading.has_glossy())
            {
                visit(vertex, shading, counts);
            }
        });
    }

    /// Walks from the camera.
    pub fn camera_walk(&self) -> Walk<'a> {
        Walk { world: self.world, heuristic: self.heuristic, carried: Carried::Radiance }
    }

    /// Start of a camera walk along `ray`.
    pub fn camera_start(&self, ray: Ray) -> Start {
        let density = self.world.scene().camera.density(ray.direction, self.width, self.height);
        Start { ray, throughput: Rgb::WHITE, d_vcm: self.heuristic.of(self.light_walks / density), d_vc: 0.0 }
    }

    /// s = 0: what the camera's walk meets, an emitter at `at` or the outside, with its weight.
    pub fn met(&self, direction: Vec3, at: Option<&SurfaceInteraction>, edge: &LastEdge) -> Found {
        let scene = self.world.scene();
        let emitted = match at {
            Some(at) if at.front => scene.shapes[at.shape as usize].emitted(at.uv),
            Some(_) => Rgb::BLACK,
            None => scene.escaped_radiance(direction),
        };
        if emitted.is_black() {
            return Found::NOTHING;
        }
        let all = Found { light: edge.throughput * emitted, lent: 0.0 };
        if edge.edges == 1 {
            return all;
        }
        let Some(departures) = &self.departures else { return all };
        let mis = |x: f64| self.heuristic.of(x);
        let shadow = edge.origin.as_ref().map_or(0.0, |origin| self.world.shadow_density(origin, direction, at));
        let leaving = match at {
            Some(at) => departures.density_on(self.world, at),
            None => departures.density_from_outside(self.world, direction),
        };
        let ways = 1.0 + mis(shadow) * edge.d_vcm + mis(leaving) * edge.d_vc;
        Found { light: all.light / ways, lent: mis(leaving) * edge.lent / ways }
    }

    /// s = 1: light by shadow rays from a vertex of the camera's walk, each with its weight.
    pub fn direct(
        &self,
        vertex: &Vertex,
        shading: &Shading<'_>,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
        mut found: impl FnMut(Found),
    ) {
        let Some(departures) = &self.departures else { return };
        let si = &vertex.si;
        let mis = |x: f64| self.heuristic.of(x);
        // Of the ray under way.
        let lent = Cell::new(0.0);
        let respond = |ray: &ShadowRay| {
            let Scattered { response, forward, reverse } = vertex.scatter(self.world, Carried::Radiance, ray.direction);
            if response.is_black() {
                return Scattering::default();
            }
            let density = ray.comparable_density();
            let by_scattering = if ray.density.is_finite() { mis(forward / density) } else { 0.0 };
            let cos = f64::from(si.ng.dot(ray.direction).abs());
            let leaving = mis(departures.density_against(self.world, ray) * cos / density);
            let ways = 1.0 + by_scattering + leaving * vertex.other_ways(self.heuristic, reverse);
            lent.set(leaving * vertex.lent_ways(self.heuristic, reverse) / ways);
            Scattering { diffuse: response / ways, glossy: Rgb::BLACK }
        };
        let (receiver, sampling) = (shading.receiver(), Shading::IN_PASSING);
        self.world.direct_by_light::<All>(si, receiver, sampling, sampler, counts, respond, |_, light| {
            found(Found { light: vertex.throughput * light.diffuse, lent: lent.get() });
        });
    }

    /// s, t > 1: a vertex of the camera's walk connected with one of a light's, with its weight.
    pub fn connect(&self, x: &Vertex, y: &Vertex, counts: &mut RayCounts) -> Found {
        self.connect_by_chance(x, y, (0.0, 0.0), counts).0
    }

    /// As [`Self::connect`], but where nothing in between would bring less than `least`, in luminance, its shadow ray is sent with a probability
    /// in proportion only (`u`, uniform in [0, 1), decides): Russian roulette on what is not worth a ray. The light, and how many times it
    /// counts.
    pub fn connect_by_chance(&self, x: &Vertex, y: &Vertex, (least, u): (f64, f64), counts: &mut RayCounts) -> (Found, f64) {
        let nothing = (Found::NOTHING, 1.0);
        let to = (y.si.point - x.si.point).as_dvec3();
        let d2 = to.length_squared();
        if d2 <= 0.0 {
            return nothing;
        }
        let direction = (to / d2.sqrt()).as_vec3();
        let at_x = x.scatter(self.world, Carried::Radiance, direction);
        if at_x.response.is_black() {
            return nothing;
        }
        let at_y = y.scatter(self.world, Carried::Light, -direction);
        let carried = x.throughput * at_x.response * at_y.response * y.throughput / d2;
        if carried.is_black() || !carried.is_finite() {
            return nothing;
        }
        let mis = |v: f64| self.heuristic.of(v);
        let cos_x = f64::from(x.si.ng.dot(direction).abs());
        let cos_y = f64::from(y.si.ng.dot(direction).abs());
        let worth = if x.edges == 1 { mis(y.worth_as_second()) } else { 1.0 };
        let by_camera = worth * mis(at_x.forward * cos_y / (d2 * CONNECTION_WORTH)) * y.other_ways(self.heuristic, at_y.reverse);
        let by_light = mis(at_y.forward * cos_x / (d2 * CONNECTION_WORTH)) * x.other_ways(self.heuristic, at_x.reverse);
        let ways = 1.0 + by_camera + by_light;
        let weighted = carried / ways;
        let chance = (x.before * weighted).luminance() / least;
        let sent = if chance < 1.0 { chance.max(LEAST_CHANCE) } else { 1.0 };
        if u >= sent {
            return nothing;
        }
        counts.shadow += 1;
        let visible = self.world.transmittance(&x.si.spawn_to(y.si.moved_towards(-direction)));
        let before = mis(at_y.forward * cos_x / (d2 * CONNECTION_WORTH)) * x.lent_ways(self.heuristic, at_x.reverse);
        (Found { light: weighted * visible, lent: before / ways }, 1.0 / sent)
    }

    /// t = 1 before weights and visibility: where the camera sees a vertex of a light's walk, the light that it sees times the number of
    /// light walks, and the density of the way back [1/sr].
    pub fn sighted(&self, y: &Vertex) -> Option<(Sighting, Rgb, f64)> {
        let sighting = self.world.scene().camera.see(y.si.point, self.width, self.height)?;
        let Scattered { response, reverse, .. } = y.scatter(self.world, Carried::Light, sighting.direction);
        let carried = y.throughput * response * (sighting.importance / sighting.distance_squared);
        (!carried.is_black() && carried.is_finite()).then_some((sighting, carried, reverse))
    }

    /// t = 1: a vertex of a light's walk as the camera sees it, with its weight; times the number of light walks.
    pub fn seen(&self, y: &Vertex, counts: &mut RayCounts) -> Option<(Sighting, Rgb)> {
        let (sighting, carried, reverse) = self.sighted(y)?;
        let mis = |v: f64| self.heuristic.of(v);
        let cos = f64::from(y.si.ng.dot(sighting.direction).abs());
        let by_camera = mis(sighting.importance * cos / (sighting.distance_squared * self.light_walks))
            * y.ways_of_camera(self.heuristic, reverse);
        let found = carried * self.visible(y, counts) / (1.0 + by_camera);
        (!found.is_black()).then_some((sighting, found))
    }

    /// Share of the light that comes from a vertex to the camera.
    pub fn visible(&self, y: &Vertex, counts: &mut RayCounts) -> Rgb {
        counts.shadow += 1;
        let camera = self.world.scene().camera.to_scene.translation.as_vec3();
        self.world.transmittance(&y.si.spawn_to(camera))
    }
}

/// Where light is recorded that `scattered` vertices which were not ideal have passed on, the first from the lamp an ideal one if
/// `began_ideal`.
pub fn layer_of(scattered: u32, began_ideal: bool) -> Quantity {
    match (scattered, began_ideal) {
        (0, _) | (1, false) => Quantity::Direct,
        (1, true) => Quantity::Caustic,
        _ => Quantity::Indirect,
    }
}
