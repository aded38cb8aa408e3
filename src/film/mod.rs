//! The film (f64 sums) and the image (f32 pixels), and their files.

mod atomic;
mod exr_in;
mod exr_out;
pub mod image;
pub mod io;
pub mod layer;
mod mask;
pub mod tone_map;

pub use image::Image;
pub use layer::{Layer, LayerData, Plane};
pub use mask::Mask;

use crate::math::Rgb;

/// Sums of samples per pixel, in f64.
#[derive(Debug, Clone)]
pub struct Film {
    width: usize,
    height: usize,
    sums: Vec<Rgb>,
    counts: Vec<f64>,
}

impl Film {
    /// An empty film.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, sums: vec![Rgb::BLACK; width * height], counts: vec![0.0; width * height] }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Adds one sample of radiance [W/(m² sr)] to pixel `index` (row by row from the top left).
    #[inline]
    pub fn add_sample(&mut self, index: usize, radiance: Rgb) {
        self.sums[index] += radiance;
        self.counts[index] += 1.0;
    }

    /// Mean of what was added to each pixel; black where nothing was.
    pub fn image(&self) -> Image {
        let mean = |(sum, &count): (&Rgb, &f64)| if count > 0.0 { *sum / count } else { Rgb::BLACK };
        let pixels = self.sums.iter().zip(&self.counts).map(mean).map(|c| c.to_array().map(|v| v as f32)).collect();
        Image::from_pixels(self.width, self.height, pixels)
    }
}
