//! Pass two: what a camera ray sees.

pub mod ambient;
pub mod bidirectional;
mod branches;
pub mod caustic_map;
pub mod drive;
pub mod final_gather;
mod glance;
pub mod irradiance_cache;
pub mod light_tracer;
pub mod method;
pub mod metropolis;
pub mod path;
mod path_filter;
mod path_tiles;
pub mod photon;
mod plain;
pub mod radiosity_view;
mod splat;
pub mod whitted;

pub use glance::Looked;
pub use method::{Method, MethodSettings};
pub use path_filter::PathFilter;

use crate::film::PixelSample;
use crate::geometry::Ray;
use crate::math::{Rgb, Sampler, SamplerKind, Vec2, sampler::mix};
use crate::radiosity::{Interpolation, RadiosityField};
use crate::scene::View;
use crate::world::walk::RayCounts;
use crate::world::{All, DirectSampling, Stages, World};
use caustic_map::CausticMap;
use irradiance_cache::{Below, IrradianceCache};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::marker::PhantomData;
use std::sync::Arc;

/// How pass two reads pass one at a diffuse surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReadOut {
    /// Radiosity as stored: a preview.
    Stored,
    /// Fresh direct light by shadow rays, everything else as stored.
    DirectStored,
    /// Fresh direct light, and rays that gather the radiosity of what they meet.
    FinalGather,
    /// As final gather, but gathered at few points and read between them where that will do; finer and finer, as is pass one.
    Progressive,
}

/// What pass two needs to know besides the scene.
#[derive(Debug, Clone, Copy)]
pub struct IntegratorSettings {
    /// How pass one is read, by methods that do.
    pub read_out: ReadOut,
    /// Longest light path in edges; 1 sees emitters, 2 direct light. `None`: unlimited.
    pub max_depth: Option<u32>,
    /// Gather rays per camera sample at a diffuse surface.
    pub gather_rays: u32,
    /// Light sampling.
    pub direct: DirectSampling,
    /// Seed of all random numbers.
    pub seed: u64,
    /// How samples of one pixel lie among each other.
    pub sampler: SamplerKind,
}

/// Size of the picture and the part of it that is rendered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Whole width in pixels.
    pub width: usize,
    /// Whole height in pixels.
    pub height: usize,
    /// Left, top, width and height of the part.
    pub crop: [usize; 4],
}

impl Frame {
    /// The whole picture.
    pub fn whole(width: usize, height: usize) -> Self {
        Self { width, height, crop: [0, 0, width, height] }
    }

    /// The camera of a world before this film.
    fn seen_by<'a>(&self, world: &'a World) -> View<'a> {
        world.scene().camera.view(self.width, self.height)
    }

    /// Number of pixels rendered.
    pub fn n_pixels(&self) -> usize {
        self.crop[2] * self.crop[3]
    }

    /// Column and row in the whole picture of rendered pixel `index`.
    pub fn pixel(&self, index: usize) -> (usize, usize) {
        (self.crop[0] + index % self.crop[2], self.crop[1] + index / self.crop[2])
    }
}

/// A method at work: adds passes of one sample per pixel. Never loops over time, prints or saves.
pub trait Integrator: Sync {
    /// Sees what all passes so far have found, before each one.
    fn look_at(&mut self, _film: &crate::film::Film) {}

    /// What pass `index` finds in all pixels of `frame`, one sample in the mean, and the rays it costs.
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts);

    /// What the light between surfaces that all passes before the last one found has to be multiplied by, as better is known now; asked once after each pass.
    fn level_of_earlier(&mut self) -> Option<Rgb> {
        None
    }

    /// What the passes to come depend on besides scene, settings and their index, as bytes that another process can go on from. What can
    /// be made again from less is not in it. Most methods need nothing.
    fn state(&self) -> Vec<u8> {
        Vec::new()
    }

    /// True if its samples may be negative, their mean being right all the same.
    fn is_signed(&self) -> bool {
        false
    }

    /// Squared error of the picture over the noise that its two halves show: above 1 where both have something wrong in common.
    fn error_over_noise(&self) -> f64 {
        1.0
    }

    /// True if the picture is to be filtered by what its two halves agree on ([`crate::film::Film::filtered`]).
    fn is_filtered(&self) -> bool {
        false
    }

    /// True if its samples say what is known of the pixel beforehand ([`crate::film::Film::controlled`]).
    fn knows_beforehand(&self) -> bool {
        false
    }

    /// Goes on where [`Self::state`] was taken, before its first pass here; false if the bytes make no sense.
    fn take_up(&mut self, state: &[u8]) -> bool {
        state.is_empty()
    }
}

/// Bytes of a method's state.
pub(crate) fn encode_state<T: Serialize>(state: &T) -> Vec<u8> {
    postcard::to_stdvec(state).expect("plain numbers always have an encoding")
}

/// Where a camera sample starts.
struct Start {
    /// Its ray.
    ray: Ray,
    /// Its place on the whole film [pixels].
    film_point: Vec2,
    /// Random numbers; the place on the film has been taken from it.
    sampler: Sampler,
    /// Seed of the half of the film that the pass belongs to.
    seed: u64,
    /// Index of the pixel in the whole picture.
    key: u64,
    /// Index of the pass within its half.
    index: u64,
}

/// Where the sample of pass `pass` of rendered pixel `pixel` starts.
fn camera_start(world: &World, settings: &IntegratorSettings, frame: &Frame, pass: u32, pixel: usize) -> Start {
    start_in_half(&frame.seen_by(world), settings, frame, pass % 2, pass / 2, pixel)
}

/// Where sample `index` of one half of the film of rendered pixel `pixel` starts.
///
/// The two halves of the film are scrambled independently: each has its own seed and counts its own samples.
fn start_in_half(view: &View<'_>, settings: &IntegratorSettings, frame: &Frame, half: u32, index: u32, pixel: usize) -> Start {
    let seed = mix(settings.seed.wrapping_mul(2).wrapping_add(u64::from(half)));
    let index = u64::from(index);
    let (x, y) = frame.pixel(pixel);
    let key = (y * frame.width + x) as u64;
    let mut sampler = Sampler::of(settings.sampler, seed, key, index);
    let film_point = Vec2::new(x as f32, y as f32) + sampler.next_2d();
    Start { ray: view.ray(film_point), film_point, sampler, seed, key, index }
}

/// Which samples a pass takes.
#[derive(Clone, Copy)]
pub struct PassPlan<'a> {
    /// Half of the film that it belongs to.
    pub half: u32,
    /// Samples of that half so far, by pixel.
    pub taken: &'a [u32],
    /// Samples to be taken, by pixel.
    pub wanted: &'a [u32],
    /// Glances of that half so far, by pixel.
    pub glanced: &'a [u32],
    /// Glances beside each sample, by pixel.
    pub glances: &'a [u8],
}

/// Pass `pass` over all pixels of `frame`: one camera sample each, traced by `trace`.
fn each_pixel(
    world: &World,
    settings: &IntegratorSettings,
    frame: &Frame,
    pass: u32,
    trace: impl Fn(Start, &mut RayCounts) -> PixelSample + Sync,
) -> (Vec<PixelSample>, RayCounts) {
    by_rows(frame, PixelSample::NONE, |pixel, counts| {
        counts.camera += 1;
        trace(camera_start(world, settings, frame, pass, pixel), counts)
    })
}

/// All pixels, row by row.
fn by_rows<T: Copy + Send>(frame: &Frame, nothing: T, pixel: impl Fn(usize, &mut RayCounts) -> T + Sync) -> (Vec<T>, RayCounts) {
    let mut found = vec![nothing; frame.n_pixels()];
    let row = frame.crop[2].max(1);
    let counts = found
        .par_chunks_mut(row)
        .enumerate()
        .map(|(y, of_row)| {
            let mut counts = RayCounts::default();
            for (x, of_pixel) in of_row.iter_mut().enumerate() {
                *of_pixel = pixel(y * row + x, &mut counts);
            }
            counts
        })
        .reduce(RayCounts::default, |mut a, b| {
            a += b;
            a
        });
    (found, counts)
}

/// Both passes over one field.
pub struct TwoPass<'a, K: Stages = All> {
    /// The scene.
    pub world: &'a World,
    /// The solution of pass one; `None` when no path is long enough to need it.
    pub field: Option<&'a RadiosityField>,
    /// Settings.
    pub settings: IntegratorSettings,
    /// Irradiance gathered at few points, read instead of gathering where it reaches.
    pub cache: Option<&'a IrradianceCache>,
    /// Light of lamps through mirrors and glass; gather rays leave it out then.
    pub caustics: Option<&'a CausticMap>,
    /// Irradiance over pi [W/(m² sr)] that stands for all light between surfaces where there is no field.
    pub ambient: f64,
    /// What gather rays read instead of a field.
    pub below: Option<Below<'a>>,
    /// Probability with which what a gather ray reads is put right by looking afresh; `None`: it is taken as it is.
    pub residual: Option<f64>,
    /// Makes stored radiosity smooth between patches where it is shown as it is.
    pub smooth: Option<Arc<Interpolation>>,
    /// The stages that its code holds.
    pub stages: PhantomData<K>,
}
