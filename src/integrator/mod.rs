//! Pass two: what a camera ray sees.

mod branches;
pub mod drive;
pub mod final_gather;
pub mod irradiance_cache;
pub mod whitted;

use crate::film::PixelSample;
use crate::radiosity::RadiosityField;
use irradiance_cache::IrradianceCache;
use crate::world::walk::RayCounts;
use crate::world::{DirectSampling, World};
use serde::{Deserialize, Serialize};

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
}

/// The closed list of methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Both passes, final gather (the default).
    TwoPass,
    /// Both passes as in the classic papers: Whitted's recursion, shadow rays, stored radiosity.
    TwoPassWhitted,
}

impl Method {
    /// All methods, in the order of `--list-methods`.
    pub const ALL: [Method; 2] = [Method::TwoPass, Method::TwoPassWhitted];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Method::TwoPass => "two-pass",
            Method::TwoPassWhitted => "two-pass-whitted",
        }
    }

    /// Light paths carried, in Heckbert's notation, and what is to be said of its error.
    pub fn describe(self) -> &'static str {
        match self {
            Method::TwoPass => "L(S|D)*E; radiosity, then shadow and gather rays at diffuse hits; error floor set by the patches",
            Method::TwoPassWhitted => {
                "L(S|D)*E; radiosity, then Whitted's recursion with shadow rays and stored radiosity; shows the patches"
            }
        }
    }

    /// The read-out it uses unless told otherwise.
    pub fn read_out(self) -> ReadOut {
        match self {
            Method::TwoPass => ReadOut::FinalGather,
            Method::TwoPassWhitted => ReadOut::DirectStored,
        }
    }
}

/// What pass two needs to know besides the scene.
#[derive(Debug, Clone, Copy)]
pub struct IntegratorSettings {
    /// How pass one is read.
    pub read_out: ReadOut,
    /// Longest light path in edges; 1 sees emitters, 2 direct light. `None`: unlimited.
    pub max_depth: Option<u32>,
    /// Gather rays per camera sample at a diffuse surface.
    pub gather_rays: u32,
    /// Light sampling.
    pub direct: DirectSampling,
    /// Seed of all random numbers.
    pub seed: u64,
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
    /// The samples of pass `index` for all pixels of `frame`, and the rays they cost.
    fn pass(&self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts);
}

/// Both passes over one field.
pub struct TwoPass<'a> {
    /// The scene.
    pub world: &'a World,
    /// The solution of pass one; `None` when no path is long enough to need it.
    pub field: Option<&'a RadiosityField>,
    /// Settings.
    pub settings: IntegratorSettings,
    /// Irradiance gathered at few points, read instead of gathering where it reaches.
    pub cache: Option<&'a IrradianceCache>,
}
