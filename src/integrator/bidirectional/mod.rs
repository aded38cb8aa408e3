//! Bidirectional path tracing [Lafortune93], [Veach97]: walks from the camera and from the lights, the vertices of one connected with those
//! of the other ([`light_vertices`] says with which), every way to make a path weighted against all others that could have made it.
//!
//! A path of s vertices from a light and t from the camera, the camera's own among them, is made in five ways: the camera's walk
//! meets a light (s = 0), a shadow ray (s = 1), a connection (s, t > 1), and the light's walk seen by the camera (t = 1). What is
//! left out is a lamp seen at once as s = t = 1, which s = 0 finds as well.
//!
//! Neighbouring pixels lend each other what their walks find from the second vertex on ([`lent`]).

mod connector;
pub mod lent;
pub mod light_vertices;
pub mod shared;
pub mod subpath;

pub use connector::{Connector, Found, Heuristic, layer_of};

use super::splat::Splats;
use super::{Frame, Integrator, IntegratorSettings, camera_start, encode_state};
use crate::film::{PixelSample, Quantity};
use crate::math::{Rgb, Sampler, Vec2, sampler::mix};
use crate::world::World;
use crate::world::walk::RayCounts;
use lent::{First, Lent};
use light_vertices::{Learnt, LightVertices, Outcome};
use rayon::prelude::*;
use shared::{Sharing, Ways};
use subpath::{Met, Vertex};

/// Vertices of light walks that a camera's vertex is connected with: the first, which sees for its own pixel alone, and later ones.
const PICKS: [u32; 2] = [8, 4];
/// What would bring less than this share of the picture's mean is asked for by chance.
const FAINT: f64 = 0.1;
/// Pixels whose light walks are kept at a time: some 200 bytes a vertex.
const BAND: usize = 1 << 17;
/// Picks have random numbers of their own.
const PICK_STREAM: u64 = 0x91_c4e5;
/// Counts changes of what the passes of a run have in common, weights above all: a run that older ones began is not gone on with.
pub const REVISION: u32 = 3;
/// Walks from the lights have random numbers of their own.
const LIGHT_STREAM: u64 = 0x11_6487;

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

/// What a pass brings.
pub struct PassFound {
    /// One sample a pixel.
    pub samples: Vec<PixelSample>,
    /// Rays.
    pub counts: RayCounts,
    /// How much others want of what was left to them, summed over all pixels.
    pub left: f64,
    /// What each way to make a path has brought, if that was asked for.
    pub ways: Option<Ways>,
}

/// What becomes of light that is found.
#[derive(Clone, Copy)]
pub enum Use<'a> {
    /// It is kept.
    Keep,
    /// It is kept, and it is told which ways brought it.
    Measure,
    /// Some of it is left to others.
    Share(&'a Sharing),
}

/// Light that is found, less what is left to others.
pub struct Keeper<'a> {
    sharing: Option<&'a Sharing>,
    left: f64,
    ways: Option<Ways>,
}

impl<'a> Keeper<'a> {
    fn new(used: Use<'a>) -> Self {
        let (sharing, ways) = match used {
            Use::Keep => (None, None),
            Use::Measure => (None, Some(Ways::default())),
            Use::Share(sharing) => (Some(sharing), None),
        };
        Keeper { sharing, left: 0.0, ways }
    }

    /// What is kept of `light` that a path of `edges`, `of_lamp` of its vertices from the lamp, brings by itself to the pixel around
    /// `film_point`, counted so many `times`.
    #[inline]
    fn keep(&mut self, film_point: Vec2, (edges, of_lamp): (u32, u32), light: Rgb, times: f64) -> Rgb {
        if light.is_black() {
            return light;
        }
        if let Some(ways) = &mut self.ways {
            ways.add(edges, of_lamp, light.luminance() * times);
        }
        match self.sharing.and_then(|sharing| sharing.of(film_point, (edges, of_lamp), light)) {
            Some(of_chains) => {
                self.left += of_chains.chance * of_chains.wanted * times;
                light * ((1.0 - of_chains.share) * times)
            }
            None => light * times,
        }
    }

    /// Adds what another has seen of the same pass.
    fn merge(&mut self, other: &Keeper<'_>) {
        self.left += other.left;
        if let (Some(ways), Some(of_other)) = (&mut self.ways, &other.ways) {
            ways.merge(of_other);
        }
    }
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
    fn light(&self, start: &super::Start, row: &mut LightRow<'_>, keeper: &mut Keeper<'_>) {
        let connector = &self.connector;
        let LightRow { vertices, splats, counts } = row;
        let walks = connector.light_walks;
        let mut sampler = light_sampler(&self.settings, start.seed, start.key, start.index);
        connector.light_walk(&mut sampler, counts, |vertex, _, counts| {
            if let Some((sighting, found)) = connector.seen(vertex, counts) {
                let found = keeper.keep(sighting.film_point, (vertex.edges + 1, vertex.edges + 1), found / walks, 1.0) * walks;
                splats.add(sighting.film_point, layer_of(vertex.scattered + 1, vertex.began_ideal), found);
            }
            vertices.push(*vertex);
        });
    }

    /// One camera walk, of pixel `pixel` of its tile; what others may use is put aside.
    fn sample(
        &self,
        start: super::Start,
        pixel: usize,
        band: &Band<'_>,
        row: &mut CameraRow,
        keeper: &mut Keeper<'_>,
    ) -> PixelSample {
        let CameraRow { outcomes, counts, lent } = row;
        let at = start.film_point;
        let connector = &self.connector;
        let mut sample = PixelSample::default();
        let mut sampler = start.sampler;
        let mut random = mix(start.seed ^ PICK_STREAM ^ mix(start.key ^ mix(start.index)));
        let limit = connector.limit;
        let begin = connector.camera_start(start.ray);
        // Of the walk: whether others may lend to its first surface, and whether they may use what it finds.
        let (mut borrows, mut lends) = (false, false);
        connector.camera_walk().go(
            begin,
            limit,
            &mut sampler,
            counts,
            |_, _| {},
            |met, sampler, counts| match met {
                Met::Outside(direction, edge) => {
                    let (way, found) = ((edge.edges, 0), connector.met(direction, None, edge));
                    match lent.second() {
                        Some(second) if lends => second.add(way, found, 1.0),
                        _ => {
                            *sample.layer(layer_of(edge.scattered, edge.by_ideal)) +=
                                keeper.keep(at, way, edge.before * found.light, 1.0)
                        }
                    }
                }
                Met::Surface(vertex, shading, edge) => {
                    if vertex.edges == 1 {
                        *sample.layer(Quantity::Depth) = Rgb::grey(f64::from(vertex.si.t));
                        *sample.layer(Quantity::Normal) = Rgb::from(vertex.si.ns.to_array());
                    }
                    let (way, found) = ((edge.edges, 0), connector.met(-vertex.si.wo, Some(&vertex.si), edge));
                    match lent.second() {
                        Some(second) if lends => second.add(way, found, 1.0),
                        _ => {
                            *sample.layer(layer_of(edge.scattered, edge.by_ideal)) +=
                                keeper.keep(at, way, edge.before * found.light, 1.0)
                        }
                    }
                    if vertex.scattered == 0 {
                        *sample.layer(Quantity::Albedo) += vertex.before * vertex.throughput * shading.diffuse_reflectance();
                    }
                    if !(shading.has_diffuse() || shading.has_glossy()) || vertex.edges >= limit {
                        return;
                    }
                    match (vertex.edges, &edge.origin) {
                        // Light goes to and fro on one side, and nothing passes straight: a walk that is here draws what comes next here.
                        (1, _) if shading.receiver().is_some() => {
                            borrows = true;
                            lent.begin(First { pixel, film_point: at, vertex: *vertex });
                        }
                        (2, Some(origin)) if borrows && !edge.passed => lends = lent.go_on(vertex, origin.density),
                        _ => {}
                    }
                    let mut second = if lends { lent.second() } else { None };
                    let mut keep = |way, layer, found: Found, times: f64| match &mut second {
                        Some(second) => second.add(way, found, times),
                        None => *sample.layer(layer) += keeper.keep(at, way, vertex.before * found.light, times),
                    };
                    connector.direct(vertex, shading, sampler, counts, |found| {
                        keep((vertex.edges + 1, 1), layer_of(vertex.scattered + 1, false), found, 1.0);
                    });
                    let per_throughput = 1.0 / vertex.throughput.luminance().max(f64::MIN_POSITIVE);
                    let picks = PICKS[usize::from(vertex.edges > 1)];
                    for _ in 0..picks {
                        random = random.wrapping_add(1);
                        let Some(pick) = band.light.pick(vertex.si.point, picks, random) else { continue };
                        let y = pick.vertex;
                        if vertex.edges + y.edges >= limit {
                            continue;
                        }
                        let u = (mix(random ^ PICK_STREAM) >> 32) as f64 / f64::from(1 << 16) / f64::from(1 << 16);
                        let (found, times) = connector.connect_by_chance(vertex, y, (band.least / pick.weight, u), counts);
                        outcomes.push((pick.pair, (found.light.luminance() * times * per_throughput) as f32));
                        let way = (vertex.edges + y.edges + 1, y.edges + 1);
                        keep(way, layer_of(vertex.scattered + y.scattered + 2, false), found, times * pick.weight);
                    }
                }
            },
        );
        sample
    }
}

/// What the light walks of a row of pixels bring.
struct LightRow<'a> {
    vertices: Vec<Vertex>,
    splats: Splats<'a>,
    counts: RayCounts,
}

/// What the camera walks of a row of tiles tell besides their samples.
#[derive(Default)]
struct CameraRow {
    outcomes: Vec<Outcome>,
    counts: RayCounts,
    lent: Lent,
}

impl Bidirectional<'_> {
    /// Sets the size of the picture.
    pub fn set_frame(&mut self, frame: &Frame) {
        self.connector.set_frame(frame);
    }

    /// Pass `index`, less what is left to others.
    pub fn find(&mut self, frame: &Frame, index: u32, used: Use<'_>) -> PassFound {
        self.connector.set_frame(frame);
        let [_, _, width, height] = frame.crop;
        let in_band = (BAND / width.max(1)).max(1).next_multiple_of(lent::ROWS);
        let (mut samples, mut counts) = (Vec::with_capacity(frame.n_pixels()), RayCounts::default());
        let mut all_splats = Vec::with_capacity(height);
        let mut keeper = Keeper::new(used);
        let least = if self.seen.1 > 0.0 { FAINT * self.seen.0 / self.seen.1 } else { 0.0 };
        for first in (0..height).step_by(in_band) {
            let rows = first..height.min(first + in_band);
            let start = |y: usize, x: usize| camera_start(self.connector.world, &self.settings, frame, index, y * width + x);
            let light_row = |y: usize| {
                let mut row = LightRow { vertices: Vec::new(), splats: Splats::new(frame), counts: RayCounts::default() };
                let mut keeper = Keeper::new(used);
                (0..width).for_each(|x| self.light(&start(y, x), &mut row, &mut keeper));
                (row, keeper)
            };
            let lit: Vec<(LightRow<'_>, Keeper<'_>)> = rows.clone().into_par_iter().map(light_row).collect();
            let mut vertices = Vec::with_capacity(lit.iter().map(|(row, _)| row.vertices.len()).sum());
            for (row, of_row) in lit {
                vertices.extend(row.vertices);
                all_splats.push(row.splats);
                counts += row.counts;
                keeper.merge(&of_row);
            }
            let light = LightVertices::new(
                &vertices,
                rows.len() * width,
                &self.learnt,
                mix(PICK_STREAM ^ mix(u64::from(index) << 32 | first as u64) ^ self.settings.seed),
            );
            let band = Band { light: &light, least };
            let tiles = |y0: usize| {
                let (mut row, mut keeper) = (CameraRow::default(), Keeper::new(used));
                let lines = lent::ROWS.min(rows.end - y0);
                let mut samples = vec![PixelSample::default(); lines * width];
                for x0 in (0..width).step_by(lent::COLUMNS) {
                    let columns = lent::COLUMNS.min(width - x0);
                    let mut of_tile = [PixelSample::default(); lent::PIXELS];
                    for (k, sample) in of_tile.iter_mut().enumerate().take(columns * lines) {
                        row.counts.camera += 1;
                        *sample = self.sample(start(y0 + k / columns, x0 + k % columns), k, &band, &mut row, &mut keeper);
                    }
                    row.lent.lend(&self.connector, &mut row.counts, &mut keeper, &mut of_tile);
                    for (k, sample) in of_tile.into_iter().enumerate().take(columns * lines) {
                        samples[k / columns * width + x0 + k % columns] = sample;
                    }
                }
                (samples, row, keeper)
            };
            let starts: Vec<usize> = rows.clone().step_by(lent::ROWS).collect();
            let seen: Vec<(Vec<PixelSample>, CameraRow, Keeper<'_>)> = starts.into_par_iter().map(tiles).collect();
            for (found, row, of_row) in seen {
                samples.extend(found);
                self.learnt.add(&row.outcomes);
                counts += row.counts;
                keeper.merge(&of_row);
            }
        }
        let scale = 1.0 / frame.n_pixels().max(1) as f64;
        all_splats.iter().for_each(|splats| splats.add_to(&mut samples, scale));
        self.seen.0 += samples.iter().map(|s| s.radiance().luminance()).sum::<f64>();
        self.seen.1 += samples.len() as f64;
        PassFound { samples, counts, left: keeper.left, ways: keeper.ways }
    }

    /// What is known of connections, for passes to come.
    pub fn known(&self) -> Known {
        (self.learnt.clone(), self.seen)
    }

    /// Goes on with what another was known to know; false if that is of another scene.
    pub fn take_up_known(&mut self, (learnt, seen): Known) -> bool {
        let fits = self.learnt.fits(&learnt);
        if fits {
            (self.learnt, self.seen) = (learnt, seen);
        }
        fits
    }

    /// All ways to make paths.
    pub fn connector(&self) -> &Connector<'_> {
        &self.connector
    }
}

/// What passes so far tell those to come: connections, sum of luminances and number of samples.
pub type Known = (Learnt, (f64, f64));

impl Integrator for Bidirectional<'_> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        let PassFound { samples, counts, .. } = self.find(frame, index, Use::Keep);
        (samples, counts)
    }

    fn state(&self) -> Vec<u8> {
        encode_state(&(REVISION, self.known()))
    }

    fn take_up(&mut self, state: &[u8]) -> bool {
        postcard::from_bytes::<(u32, Known)>(state)
            .is_ok_and(|(revision, known)| revision == REVISION && self.take_up_known(known))
    }
}
