//! Bidirectional path tracing [Lafortune93], [Veach97]: walks from the camera and from the lights, the vertices of one connected with those
//! of the other ([`light_vertices`] says with which), every way to make a path weighted against all others that could have made it.
//!
//! A path of s vertices from a light and t from the camera, the camera's own among them, is made in five ways: the camera's walk
//! meets a light (s = 0), a shadow ray (s = 1), a connection (s, t > 1), and the light's walk seen by the camera (t = 1). What is
//! left out is a lamp seen at once as s = t = 1, which s = 0 finds as well.

pub mod light_vertices;
pub mod subpath;

use super::splat::Splats;
use super::{Frame, Integrator, IntegratorSettings, camera_start};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::material::Scattering;
use crate::math::{Rgb, Sampler, Vec3, sampler::mix};
use crate::scene::Sighting;
use crate::world::walk::RayCounts;
use crate::world::{Departures, Shading, ShadowRay, SurfaceInteraction, World};
use light_vertices::{Learnt, LightVertices, Outcome};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use subpath::{Carried, LastEdge, Met, Scattered, Start, Vertex, Walk, begin_light, depart};

/// No path is longer, whatever the scene asks.
const DEEPEST: u32 = 512;
/// Vertices of light walks that a camera's vertex is connected with.
const PICKS: u32 = 3;
/// What would bring less than this share of the picture's mean is asked for by chance.
const FAINT: f64 = 0.1;
/// But not by less of a chance.
const LEAST_CHANCE: f64 = 0.05;
/// Pixels whose light walks are kept at a time: some 200 bytes a vertex.
const BAND: usize = 1 << 17;
/// Picks have random numbers of their own.
const PICK_STREAM: u64 = 0x91_c4e5;
/// Walks from the lights have random numbers of their own.
const LIGHT_STREAM: u64 = 0x11_6487;

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
                    *sample.layer(layer_of(edge.scattered, edge.by_ideal)) += self.met(direction, None, edge);
                }
                Met::Surface(vertex, shading, edge) => {
                    let found = self.met(-vertex.si.wo, Some(&vertex.si), edge);
                    *sample.layer(layer_of(edge.scattered, edge.by_ideal)) += found;
                    if vertex.edges > 1 {
                        return;
                    }
                    *sample.layer(Quantity::Depth) = Rgb::grey(f64::from(vertex.si.t));
                    *sample.layer(Quantity::Normal) = Rgb::from(vertex.si.ns.to_array());
                    *sample.layer(Quantity::Albedo) += vertex.throughput * shading.diffuse_reflectance();
                    if limit > 1 && (shading.has_diffuse() || shading.has_glossy()) {
                        *sample.layer(Quantity::Direct) += self.direct(vertex, shading, sampler, counts);
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

    /// Start of a camera walk along `ray`.
    pub fn camera_start(&self, ray: Ray) -> Start {
        let density = self.world.scene().camera.density(ray.direction, self.width, self.height);
        Start { ray, throughput: Rgb::WHITE, d_vcm: self.heuristic.of(self.light_walks / density), d_vc: 0.0 }
    }

    /// s = 0: what the camera's walk meets, an emitter at `at` or the outside, with its weight.
    pub fn met(&self, direction: Vec3, at: Option<&SurfaceInteraction>, edge: &LastEdge) -> Rgb {
        let scene = self.world.scene();
        let emitted = match at {
            Some(at) if at.front => scene.shapes[at.shape as usize].emitted(at.uv),
            Some(_) => Rgb::BLACK,
            None => scene.escaped_radiance(direction),
        };
        if emitted.is_black() {
            return Rgb::BLACK;
        }
        if edge.edges == 1 {
            return edge.throughput * emitted;
        }
        let Some(departures) = &self.departures else { return edge.throughput * emitted };
        let mis = |x: f64| self.heuristic.of(x);
        let shadow = edge.origin.as_ref().map_or(0.0, |origin| self.world.shadow_density(origin, direction, at));
        let leaving = match at {
            Some(at) => departures.density_on(self.world, at),
            None => departures.density_from_outside(self.world, direction),
        };
        edge.throughput * emitted / (1.0 + mis(shadow) * edge.d_vcm + mis(leaving) * edge.d_vc)
    }

    /// s = 1: light by shadow rays from a vertex of the camera's walk, with its weight.
    pub fn direct(&self, vertex: &Vertex, shading: &Shading<'_>, sampler: &mut Sampler, counts: &mut RayCounts) -> Rgb {
        let Some(departures) = &self.departures else { return Rgb::BLACK };
        let si = &vertex.si;
        let mis = |x: f64| self.heuristic.of(x);
        let respond = |ray: &ShadowRay| {
            let Scattered { response, forward, reverse } = vertex.scatter(self.world, Carried::Radiance, ray.direction);
            if response.is_black() {
                return Scattering::default();
            }
            let density = ray.comparable_density();
            let by_scattering = if ray.density.is_finite() { mis(forward / density) } else { 0.0 };
            let cos = f64::from(si.ng.dot(ray.direction).abs());
            let leaving = departures.density_against(self.world, ray);
            let by_light = mis(leaving * cos / density) * (vertex.d_vcm + vertex.d_vc * mis(reverse));
            Scattering { diffuse: response / (1.0 + by_scattering + by_light), glossy: Rgb::BLACK }
        };
        let found = self.world.direct(si, shading.receiver(), Shading::IN_PASSING, sampler, counts, respond).diffuse;
        vertex.throughput * found
    }

    /// s, t > 1: a vertex of the camera's walk connected with one of a light's, with its weight.
    pub fn connect(&self, x: &Vertex, y: &Vertex, counts: &mut RayCounts) -> Rgb {
        self.connect_by_chance(x, y, (0.0, 0.0), counts)
    }

    /// As [`Self::connect`], but where nothing in between would bring less than `least`, in luminance, its shadow ray is sent with a probability
    /// in proportion only (`u`, uniform in [0, 1), decides), and counts for more then: Russian roulette on what is not worth a ray.
    pub fn connect_by_chance(&self, x: &Vertex, y: &Vertex, (least, u): (f64, f64), counts: &mut RayCounts) -> Rgb {
        let to = (y.si.point - x.si.point).as_dvec3();
        let d2 = to.length_squared();
        if d2 <= 0.0 {
            return Rgb::BLACK;
        }
        let direction = (to / d2.sqrt()).as_vec3();
        let at_x = x.scatter(self.world, Carried::Radiance, direction);
        if at_x.response.is_black() {
            return Rgb::BLACK;
        }
        let at_y = y.scatter(self.world, Carried::Light, -direction);
        let carried = x.throughput * at_x.response * at_y.response * y.throughput / d2;
        if carried.is_black() || !carried.is_finite() {
            return Rgb::BLACK;
        }
        let mis = |v: f64| self.heuristic.of(v);
        let cos_x = f64::from(x.si.ng.dot(direction).abs());
        let cos_y = f64::from(y.si.ng.dot(direction).abs());
        let by_camera = mis(at_x.forward * cos_y / d2) * (y.d_vcm + y.d_vc * mis(at_y.reverse));
        let by_light = mis(at_y.forward * cos_x / d2) * (x.d_vcm + x.d_vc * mis(at_x.reverse));
        let weighted = carried / (1.0 + by_camera + by_light);
        let chance = weighted.luminance() / least;
        let sent = if chance < 1.0 { chance.max(LEAST_CHANCE) } else { 1.0 };
        if u >= sent {
            return Rgb::BLACK;
        }
        counts.shadow += 1;
        let visible = self.world.transmittance(&x.si.spawn_to(y.si.moved_towards(-direction)));
        weighted * visible / sent
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
        let by_camera =
            mis(sighting.importance * cos / (sighting.distance_squared * self.light_walks)) * (y.d_vcm + y.d_vc * mis(reverse));
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
pub(super) fn layer_of(scattered: u32, began_ideal: bool) -> Quantity {
    match (scattered, began_ideal) {
        (0, _) | (1, false) => Quantity::Direct,
        (1, true) => Quantity::Caustic,
        _ => Quantity::Indirect,
    }
}

/// Random numbers of a pixel's light walk.
pub(super) fn light_sampler(settings: &IntegratorSettings, seed: u64, key: u64, index: u64) -> Sampler {
    Sampler::of(settings.sampler, mix(seed ^ LIGHT_STREAM), key, index)
}

/// Bidirectional path tracing of pictures.
pub struct Bidirectional<'a> {
    connector: Connector<'a>,
    settings: IntegratorSettings,
    learnt: Learnt,
    /// Sum of the luminances of all samples so far, and their number.
    seen: (f64, f64),
}

/// What a camera walk is connected with, and what is worth a shadow ray.
struct Band<'a> {
    light: &'a LightVertices,
    least: f64,
}

impl<'a> Bidirectional<'a> {
    /// On a scene.
    pub fn new(world: &'a World, settings: IntegratorSettings, heuristic: Heuristic) -> Self {
        let connector = Connector::new(world, settings.max_depth, heuristic);
        Self { connector, settings, learnt: Learnt::new(world.bounds()), seen: (0.0, 0.0) }
    }

    /// One light walk: its vertices, and what of them the camera sees.
    fn light(&self, start: &super::Start, vertices: &mut Vec<Vertex>, splats: &mut Splats<'_>, counts: &mut RayCounts) {
        let connector = &self.connector;
        let mut sampler = light_sampler(&self.settings, start.seed, start.key, start.index);
        connector.light_walk(&mut sampler, counts, |vertex, _, counts| {
            if let Some((sighting, found)) = connector.seen(vertex, counts) {
                splats.add(sighting.film_point, layer_of(vertex.scattered + 1, vertex.began_ideal), found);
            }
            vertices.push(*vertex);
        });
    }

    /// One camera walk.
    fn sample(&self, start: super::Start, band: &Band<'_>, outcomes: &mut Vec<Outcome>, counts: &mut RayCounts) -> PixelSample {
        let connector = &self.connector;
        let mut sample = PixelSample::default();
        let walk = Walk { world: connector.world, heuristic: connector.heuristic, carried: Carried::Radiance };
        let mut sampler = start.sampler;
        let mut random = mix(start.seed ^ PICK_STREAM ^ mix(start.key ^ mix(start.index)));
        let limit = connector.limit;
        let begin = connector.camera_start(start.ray);
        walk.go(
            begin,
            limit,
            &mut sampler,
            counts,
            |_, _| {},
            |met, sampler, counts| match met {
                Met::Outside(direction, edge) => {
                    let found = connector.met(direction, None, edge);
                    *sample.layer(layer_of(edge.scattered, edge.by_ideal)) += found;
                }
                Met::Surface(vertex, shading, edge) => {
                    if vertex.edges == 1 {
                        *sample.layer(Quantity::Depth) = Rgb::grey(f64::from(vertex.si.t));
                        *sample.layer(Quantity::Normal) = Rgb::from(vertex.si.ns.to_array());
                    }
                    let found = connector.met(-vertex.si.wo, Some(&vertex.si), edge);
                    *sample.layer(layer_of(edge.scattered, edge.by_ideal)) += found;
                    if vertex.scattered == 0 {
                        *sample.layer(Quantity::Albedo) += vertex.throughput * shading.diffuse_reflectance();
                    }
                    if !(shading.has_diffuse() || shading.has_glossy()) || vertex.edges >= limit {
                        return;
                    }
                    *sample.layer(layer_of(vertex.scattered + 1, false)) += connector.direct(vertex, shading, sampler, counts);
                    let per_throughput = 1.0 / vertex.throughput.luminance().max(f64::MIN_POSITIVE);
                    for _ in 0..PICKS {
                        random = random.wrapping_add(1);
                        let Some(pick) = band.light.pick(vertex.si.point, PICKS, random) else { continue };
                        let y = pick.vertex;
                        if vertex.edges + y.edges >= limit {
                            continue;
                        }
                        let u = (mix(random ^ PICK_STREAM) >> 32) as f64 / f64::from(1 << 16) / f64::from(1 << 16);
                        let found = connector.connect_by_chance(vertex, y, (band.least / pick.weight, u), counts);
                        outcomes.push((pick.pair, (found.luminance() * per_throughput) as f32));
                        *sample.layer(layer_of(vertex.scattered + y.scattered + 2, false)) += found * pick.weight;
                    }
                }
            },
        );
        sample
    }
}

impl Integrator for Bidirectional<'_> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        self.connector.set_frame(frame);
        let [_, _, width, height] = frame.crop;
        let in_band = (BAND / width.max(1)).max(1);
        let (mut samples, mut counts) = (Vec::with_capacity(frame.n_pixels()), RayCounts::default());
        let mut all_splats = Vec::with_capacity(height);
        let least = if self.seen.1 > 0.0 { FAINT * self.seen.0 / self.seen.1 } else { 0.0 };
        for first in (0..height).step_by(in_band) {
            let rows = first..height.min(first + in_band);
            let start = |y: usize, x: usize| camera_start(self.connector.world, &self.settings, frame, index, y * width + x);
            let light_row = |y: usize| {
                let (mut vertices, mut splats, mut counts) = (Vec::new(), Splats::new(frame), RayCounts::default());
                (0..width).for_each(|x| self.light(&start(y, x), &mut vertices, &mut splats, &mut counts));
                (vertices, splats, counts)
            };
            let lit: Vec<(Vec<Vertex>, Splats<'_>, RayCounts)> = rows.clone().into_par_iter().map(light_row).collect();
            let mut vertices = Vec::with_capacity(lit.iter().map(|row| row.0.len()).sum());
            for (of_row, splats, c) in lit {
                vertices.extend(of_row);
                all_splats.push(splats);
                counts += c;
            }
            let light = LightVertices::new(
                &vertices,
                rows.len() * width,
                &self.learnt,
                mix(PICK_STREAM ^ mix(u64::from(index) << 32 | first as u64) ^ self.settings.seed),
            );
            let band = Band { light: &light, least };
            let camera_row = |y: usize| {
                let (mut outcomes, mut counts) = (Vec::new(), RayCounts::default());
                let one = |x: usize| {
                    counts.camera += 1;
                    self.sample(start(y, x), &band, &mut outcomes, &mut counts)
                };
                let samples: Vec<PixelSample> = (0..width).map(one).collect();
                (samples, outcomes, counts)
            };
            let seen: Vec<(Vec<PixelSample>, Vec<Outcome>, RayCounts)> = rows.into_par_iter().map(camera_row).collect();
            for (of_row, outcomes, c) in seen {
                samples.extend(of_row);
                self.learnt.add(&outcomes);
                counts += c;
            }
        }
        let scale = 1.0 / frame.n_pixels().max(1) as f64;
        all_splats.iter().for_each(|splats| splats.add_to(&mut samples, scale));
        self.seen.0 += samples.iter().map(|s| s.radiance().luminance()).sum::<f64>();
        self.seen.1 += samples.len() as f64;
        (samples, counts)
    }
}
