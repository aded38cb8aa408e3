//! FLIP: the difference that a person sees when two pictures are shown in turn in the same place, 0 (none) to 1 (Andersson,
//! Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild 2020), and HDR-FLIP, the largest of it over the exposures at which the
//! reference can be looked at (Andersson, Nilsson, Shirley, Akenine-Möller 2021).
//!
//! The observer sits so that [`PIXELS_PER_DEGREE`] pixels span one degree. HDR-FLIP shows pictures through the ACES curve, as its
//! authors' program does unless told otherwise.

mod colour;
mod exposure;
mod filter;
mod palette;
#[cfg(test)]
mod tests;

use crate::film::Image;
use crate::film::layer::Plane;
use colour::{Opponent, PerceivedColour};
use filter::{Kernel, Taps};
use rayon::prelude::*;

pub use exposure::Exposures;
pub use palette::magma_picture;

/// Pixels in one degree of the observer's view: 0.7 m before a screen 0.7 m and 3840 pixels wide, 3840 π / 180, about 67.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * std::f64::consts::PI / 180.0;

/// Exponent of the colour difference (FLIP 2020, section 4.1, q_c).
const COLOUR_EXPONENT: f32 = 0.7;

/// Share of the largest colour difference from which on differences are compressed (p_c), and the value it is given (p_t).
const COMPRESSED_FROM: f32 = 0.4;
const COMPRESSED_VALUE: f32 = 0.95;

/// Exponent of the feature difference (FLIP 2020, section 4.2, q_f).
const FEATURE_EXPONENT: f32 = 0.5;

/// LDR-FLIP of two linear pictures as a screen shows them at exposure 0: each channel cut to [0, 1], then the sRGB curve. One
/// value a pixel, 0 to 1.
///
/// # Panics
/// If the pictures differ in size.
pub fn ldr_map(image: &Image, reference: &Image) -> Plane {
    let show = |linear: [f32; 3]| linear.map(|v| v.clamp(0.0, 1.0));
    Eye::new().difference(image, reference, show)
}

/// HDR-FLIP of two linear pictures over [`Exposures::of`] the reference, negative values taken as 0. One value a pixel, 0 to 1.
///
/// # Panics
/// If the pictures differ in size.
pub fn hdr_map(image: &Image, reference: &Image) -> Plane {
    let eye = Eye::new();
    let mut largest = vec![0.0_f32; reference.pixels().len()];
    for stops in Exposures::of(reference).all() {
        let factor = stops.exp2();
        // Not `max`, here and below: it would drop a NaN.
        let show = |linear: [f32; 3]| exposure::aces(linear.map(|v| if v < 0.0 { 0.0 } else { v * factor }));
        let shown = eye.difference(image, reference, show);
        largest
            .iter_mut()
            .zip(shown.values())
            .filter(|(all, one)| *one > *all || one.is_nan())
            .for_each(|(all, &one)| *all = one);
    }
    Plane::from_values(reference.width(), reference.height(), largest)
}

/// What an observer's eye does to a picture: filters whose width depends on how far away the screen is.
struct Eye {
    /// Contrast sensitivity of the three opponent channels; that of blue and yellow is a sum of two Gaussians.
    achromatic: Kernel,
    red_green: Kernel,
    blue_yellow: [Kernel; 2],
    /// A Gaussian and its two derivatives, which answer to edges and to points.
    feature: [Kernel; 3],
    /// Largest colour difference: between saturated green and blue.
    largest_difference: f32,
}

impl Eye {
    fn new() -> Self {
        let [achromatic, red_green, yellow_wide, yellow_narrow] = filter::contrast_sensitivity(PIXELS_PER_DEGREE);
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|rgb| PerceivedColour::of(Opponent::of(rgb)));
        Self {
            achromatic,
            red_green,
            blue_yellow: [yellow_wide, yellow_narrow],
            feature: filter::feature_detectors(PIXELS_PER_DEGREE),
            largest_difference: green.distance(&blue).powf(COLOUR_EXPONENT),
        }
    }

    /// FLIP of two pictures after `show`, which gives linear values in 0 to 1.
    fn difference(&self, image: &Image, reference: &Image, show: impl Fn([f32; 3]) -> [f32; 3] + Sync) -> Plane {
        let size = (reference.width(), reference.height());
        assert_eq!((image.width(), image.height()), size, "pictures of one size");
        let [seen, wanted] = [image, reference].map(|picture| self.look(picture, &show));
        let values = (0..size.0 * size.1).into_par_iter().map(|i| {
            let colour = self.colour_difference(seen.colour(i).distance(&wanted.colour(i)));
            let features = (seen.edges[i] - wanted.edges[i]).abs().max((seen.points[i] - wanted.points[i]).abs());
            let feature = (features * std::f32::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT);
            // FLIP 2020, equation 18: a feature that appears or goes makes a colour difference count for more.
            colour.powf(1.0 - feature)
        });
        Plane::from_values(size.0, size.1, values.collect())
    }

    /// A distance of perceived colours on the scale 0 to 1 (FLIP 2020, equation 15): most of the scale for the small ones.
    fn colour_difference(&self, distance: f32) -> f32 {
        let (power, largest) = (distance.powf(COLOUR_EXPONENT), self.largest_difference);
        let bend = COMPRESSED_FROM * largest;
        if power < bend {
            power * COMPRESSED_VALUE / bend
        } else {
            COMPRESSED_VALUE + (power - bend) / (largest - bend) * (1.0 - COMPRESSED_VALUE)
        }
    }

    fn look(&self, picture: &Image, show: &(impl Fn([f32; 3]) -> [f32; 3] + Sync)) -> Seen {
        let size = (picture.width(), picture.height());
        let opponent: Vec<Opponent> = picture.pixels().par_iter().map(|&p| Opponent::of(show(p))).collect();
        let plane = |c: usize| -> Vec<f32> { opponent.iter().map(|o| o.0[c]).collect() };
        let planes: [Vec<f32>; 3] = std::array::from_fn(plane);
        drop(opponent);
        let blurred = |plane: &[f32], kernel: &Kernel| filter::separable(plane, size, kernel, kernel);
        let mut blue_yellow = blurred(&planes[2], &self.blue_yellow[0]);
        let narrow = blurred(&planes[2], &self.blue_yellow[1]);
        blue_yellow.iter_mut().zip(narrow).for_each(|(sum, v)| *sum += v);
        let [gaussian, first, second] = &self.feature;
        let strength = |kernel: &Kernel| {
            let [across, down] = filter::gradient(&planes[0], size, Taps { along: kernel, other: gaussian });
            across.into_iter().zip(down).map(|(x, y)| (x * x + y * y).sqrt()).collect()
        };
        Seen {
            channels: [blurred(&planes[0], &self.achromatic), blurred(&planes[1], &self.red_green), blue_yellow],
            edges: strength(first),
            points: strength(second),
        }
    }
}

/// A picture as the eye's filters leave it.
struct Seen {
    channels: [Vec<f32>; 3],
    edges: Vec<f32>,
    points: Vec<f32>,
}

impl Seen {
    fn colour(&self, i: usize) -> PerceivedColour {
        PerceivedColour::of(Opponent(std::array::from_fn(|c| self.channels[c][i])))
    }
}
