//! The film (f64 sums) and the image (f32 pixels), and their files.

mod atomic;
mod control;
mod exr_in;
mod exr_out;
mod filter;
pub mod guard;
pub mod image;
pub mod io;
pub mod layer;
pub mod lock;
mod mask;
pub mod neighbours;
pub mod tone_map;

pub use control::Beforehand;
pub use image::Image;
pub use layer::{Layer, LayerData, Plane};
pub use mask::Mask;

use crate::math::Rgb;
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// Halves that differ by no more than this share of their sum are the same picture: its pixels are f32.
const ROUNDING: f64 = 0.5 * f32::EPSILON as f64;

/// What a picture is recorded in, besides the radiance itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Quantity {
    /// Light that has met no diffuse surface but the one seen, found by shadow rays, and light seen at once.
    Direct,
    /// Light reflected by another diffuse surface before.
    Indirect,
    /// Light that came to the diffuse surface seen through specular ones or from emitters left to gather rays.
    Caustic,
    /// Diffuse reflectance seen.
    Albedo,
    /// Shading normal seen, in scene axes.
    Normal,
    /// Distance to the first surface, in all three channels.
    Depth,
    /// Radiosity of pass one over pi, as seen: the stored picture.
    Radiosity,
    /// Irradiance of pass one at what is seen [W/m²].
    Irradiance,
}

impl Quantity {
    /// All layers in the order of [`PixelSample::layers`].
    pub const ALL: [Quantity; 8] = [
        Quantity::Direct,
        Quantity::Indirect,
        Quantity::Caustic,
        Quantity::Albedo,
        Quantity::Normal,
        Quantity::Depth,
        Quantity::Radiosity,
        Quantity::Irradiance,
    ];

    /// Name in the EXR file.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::Direct => "direct",
            Quantity::Indirect => "indirect",
            Quantity::Caustic => "caustic",
            Quantity::Albedo => "albedo",
            Quantity::Normal => "normal",
            Quantity::Depth => "depth",
            Quantity::Radiosity => "radiosity",
            Quantity::Irradiance => "irradiance",
        }
    }
}

/// What a pass found in a pixel: one camera sample, or the sum of several, or none. Layers are weighted sums over the branches of the
/// recursion; the radiance is the sum of direct, indirect and caustic.
#[derive(Debug, Clone, Copy)]
pub struct PixelSample {
    /// One value per layer, in the order of [`Quantity::ALL`].
    pub layers: [Rgb; Quantity::ALL.len()],
    /// Number of camera samples.
    pub n: u32,
    /// What is known beforehand of the radiance.
    pub known: Beforehand,
}

impl Default for PixelSample {
    /// One sample of nothing.
    fn default() -> Self {
        Self { n: 1, ..Self::NONE }
    }
}

impl PixelSample {
    /// The value of one quantity, to be changed.
    #[inline]
    pub fn layer(&mut self, layer: Quantity) -> &mut Rgb {
        &mut self.layers[layer as usize]
    }

    /// No sample.
    pub const NONE: Self = Self { layers: [Rgb::BLACK; Quantity::ALL.len()], n: 0, known: Beforehand::NOTHING };

    /// Takes the samples of another in.
    #[inline]
    pub fn add(&mut self, other: &PixelSample) {
        self.layers.iter_mut().zip(&other.layers).for_each(|(sum, value)| *sum += *value);
        self.n += other.n;
        self.known.add(&other.known);
    }

    /// Radiance [W/(m² sr)], summed over its samples.
    #[inline]
    pub fn radiance(&self) -> Rgb {
        self.layers[Quantity::Direct as usize]
            + self.layers[Quantity::Indirect as usize]
            + self.layers[Quantity::Caustic as usize]
    }
}

/// Sums of samples per pixel, in f64: the radiance in two independent halves, and the layers.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Film {
    width: usize,
    height: usize,
    halves: [Vec<Rgb>; 2],
    layers: Vec<[Rgb; Quantity::ALL.len()]>,
    /// Samples taken, by half and pixel.
    taken: [Vec<u32>; 2],
    passes: [u32; 2],
    /// True if samples may be negative.
    signed: bool,
    /// Squared error over the noise that the halves show.
    error_over_noise: f64,
    /// What is known of the pixels beforehand; `None` for methods that know nothing.
    control: Option<control::Control>,
    /// The filtered picture, once it was asked for; `None` if there is to be none.
    #[serde(skip)]
    filtered: Option<OnceLock<filter::Filtered>>,
    non_finite: u64,
    first_non_finite: Option<usize>,
}

impl Film {
    /// An empty film.
    pub fn new(width: usize, height: usize) -> Self {
        let n = width * height;
        Self {
            width,
            height,
            halves: [vec![Rgb::BLACK; n], vec![Rgb::BLACK; n]],
            layers: vec![[Rgb::BLACK; Quantity::ALL.len()]; n],
            taken: [vec![0; n], vec![0; n]],
            passes: [0; 2],
            signed: false,
            error_over_noise: 1.0,
            control: None,
            filtered: None,
            non_finite: 0,
            first_non_finite: None,
        }
    }

    /// The same film, which takes samples below 0 as well if `signed`: those of estimators that are right in the mean only.
    #[must_use]
    pub fn signed(self, signed: bool) -> Self {
        Self { signed, ..self }
    }

    /// The same film, whose predicted error is `factor` times the noise that its halves show: of methods that have something wrong in both.
    #[must_use]
    pub fn with_error_over_noise(self, factor: f64) -> Self {
        Self { error_over_noise: factor, ..self }
    }

    /// The same film, which uses what samples know beforehand, if `known`.
    #[must_use]
    pub fn controlled(self, known: bool) -> Self {
        let n = self.width * self.height;
        let control = self.control.or_else(|| known.then(|| control::Control::new(n)));
        Self { control, ..self }
    }

    /// The same film, whose picture is filtered, if `filtered`, by what its two halves agree on: for methods whose pixels may tell of each other. The layers
    /// stay as they are.
    #[must_use]
    pub fn filtered(self, filtered: bool) -> Self {
        Self { filtered: filtered.then(OnceLock::new), ..self }
    }

    /// What the filter makes of the picture, made once; `None` without one, and before there are samples.
    fn developed(&self) -> Option<&filter::Filtered> {
        let is_there = self.width * self.height > 0 && self.n_passes() > 0;
        self.filtered.as_ref().filter(|_| is_there).map(|made| made.get_or_init(|| filter::filter(self)))
    }

    /// Filters the picture, if it is to be, so that who asks for it next finds it done.
    pub fn develop(&self) {
        self.developed();
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Passes added so far: samples per pixel, in the mean over pixels.
    pub fn n_passes(&self) -> u32 {
        self.passes[0] + self.passes[1]
    }

    /// Samples that were not finite, or negative where they must not be, and the first pixel that had one. They are left out of the sums
    /// and never hidden.
    pub fn bad_samples(&self) -> (u64, Option<usize>) {
        (self.non_finite, self.first_non_finite)
    }

    /// Adds what a pass found in every pixel; passes of even index go to one half, odd ones to the other.
    ///
    /// # Panics
    /// If there is not one entry per pixel.
    pub fn add_pass(&mut self, index: u32, samples: &[PixelSample]) {
        assert_eq!(samples.len(), self.width * self.height, "one entry per pixel");
        let half = (index % 2) as usize;
        for (pixel, sample) in samples.iter().enumerate() {
            self.taken[half][pixel] += sample.n;
            let radiance = sample.radiance();
            if !radiance.is_finite() || (radiance.min() < 0.0 && !self.signed) {
                self.non_finite += 1;
                self.first_non_finite.get_or_insert(pixel);
                continue;
            }
            self.halves[half][pixel] += radiance;
            self.layers[pixel].iter_mut().zip(&sample.layers).for_each(|(sum, value)| *sum += *value);
            if let Some(control) = &mut self.control {
                control.add(half, pixel, &sample.known);
            }
        }
        self.passes[half] += 1;
        if let Some(filtered) = &mut self.filtered {
            filtered.take();
        }
    }

    /// Multiplies the light between surfaces that was found so far, in each channel; what belongs to which half is known in the mean only.
    pub fn scale_indirect(&mut self, level: Rgb) {
        for i in 0..self.layers.len() {
            let change = self.layers[i][Quantity::Indirect as usize] * (level - Rgb::WHITE);
            self.layers[i][Quantity::Indirect as usize] += change;
            let per_sample = change / self.n_samples(i);
            for half in 0..2 {
                self.halves[half][i] += per_sample * f64::from(self.taken[half][i]);
            }
        }
        if let Some(filtered) = &mut self.filtered {
            filtered.take();
        }
    }

    /// Samples of pixel `i` so far.
    fn n_samples(&self, i: usize) -> f64 {
        f64::from((self.taken[0][i] + self.taken[1][i]).max(1))
    }

    /// Samples of pixel `i` so far, by half.
    pub fn taken(&self, i: usize) -> [u32; 2] {
        [self.taken[0][i], self.taken[1][i]]
    }

    /// Sum of the samples of one half, and what is known of more rays beside them.
    #[inline]
    fn half(&self, half: usize, i: usize) -> Rgb {
        self.halves[half][i] + self.control.as_ref().map_or(Rgb::BLACK, |control| control.correction(self, half, i))
    }

    /// The power of two below the mean radiance as sampled: divided by it, a picture twice as bright is the same, bit for bit.
    fn unit(&self) -> f64 {
        let n = self.width * self.height;
        let level = (0..n).map(|i| ((self.halves[0][i] + self.halves[1][i]) / self.n_samples(i)).mean()).sum::<f64>() / n as f64;
        if level.is_normal() { level.log2().floor().exp2() } else { 1.0 }
    }

    /// How the light of pixel `i` goes with what is known of it beforehand, from 0 to 1.
    pub fn gain(&self, i: usize) -> f32 {
        self.control.as_ref().map_or(0.0, |control| control.gain(self, i))
    }

    /// Mean radiance of the samples that one half has of pixel `i`, unfiltered.
    pub fn half_mean(&self, half: usize, i: usize) -> Rgb {
        self.half(half, i) / f64::from(self.taken[half][i].max(1))
    }

    /// Mean radiance of all samples; filtered, if it is to be.
    pub fn image(&self) -> Image {
        if let Some(developed) = self.developed() {
            return self.picture_of(|i| self.shown(developed.image[i]));
        }
        self.unfiltered()
    }

    /// Mean radiance of all samples, unfiltered.
    pub fn unfiltered(&self) -> Image {
        self.picture_of(|i| self.shown((self.half(0, i) + self.half(1, i)) / self.n_samples(i)))
    }

    /// What is known beforehand may take more from a pixel than a few samples have found.
    fn shown(&self, radiance: Rgb) -> Rgb {
        if self.signed { radiance } else { Rgb::new(radiance.r.max(0.0), radiance.g.max(0.0), radiance.b.max(0.0)) }
    }

    /// Mean of one quantity.
    pub fn quantity_image(&self, layer: Quantity) -> Image {
        let more = |i: usize| match layer {
            Quantity::Indirect => self.half(0, i) - self.halves[0][i] + self.half(1, i) - self.halves[1][i],
            _ => Rgb::BLACK,
        };
        self.picture_of(|i| (self.layers[i][layer as usize] + more(i)) / self.n_samples(i))
    }

    /// Variance of the pixel, from the two halves (filtered, if the picture is): one degree of freedom a pixel. Black before the second pass.
    pub fn variance_image(&self) -> Image {
        self.picture_of(|i| self.variance(i))
    }

    /// Predicted relmse of the picture by its own two halves: mean of its [variance](Self::variance_image) over S²+0.01, S the mean over
    /// 5x5 pixels, times what the method usually has wrong in both halves ([`Self::with_error_over_noise`]). `None` before the second pass.
    pub fn estimated_relmse(&self) -> Option<f64> {
        if self.passes.contains(&0) {
            return None;
        }
        let smooth = self.image().box_filtered(2);
        let pixel = |i: usize| {
            let (v, s) = (self.variance(i), smooth.pixels()[i]);
            (0..3).map(|c| v[c] / (f64::from(s[c]) * f64::from(s[c]) + 0.01)).sum::<f64>()
        };
        let n = self.width * self.height;
        Some(self.error_over_noise * (0..n).map(pixel).sum::<f64>() / (3 * n) as f64)
    }

    /// Number of fireflies: pixels brighter than the mean and more than five times as bright as each of their neighbours.
    pub fn fireflies(&self) -> u64 {
        let image = self.image();
        let luminance: Vec<f64> = image.pixels().iter().map(|p| Rgb::from(*p).luminance()).collect();
        let mean = luminance.iter().sum::<f64>() / luminance.len().max(1) as f64;
        let (w, h) = (self.width, self.height);
        let outshines = |i: usize| {
            let (x, y) = (i % w, i / w);
            let near =
                (y.saturating_sub(1)..(y + 2).min(h)).flat_map(|v| (x.saturating_sub(1)..(x + 2).min(w)).map(move |u| v * w + u));
            luminance[i] > mean && near.filter(|j| *j != i).all(|j| luminance[i] > 5.0 * luminance[j])
        };
        (0..w * h).filter(|&i| outshines(i)).count() as u64
    }

    fn variance(&self, i: usize) -> Rgb {
        self.developed().map_or_else(|| self.half_variance(i), |developed| developed.variance[i])
    }

    /// Variance of the mean of pixel `i`: of two means over a and b samples, ab/(a+b)² of their squared difference, which is a quarter where
    /// the halves have as many.
    pub fn half_variance(&self, i: usize) -> Rgb {
        let [a, b] = [0, 1].map(|half: usize| f64::from(self.taken[half][i]));
        if a * b == 0.0 {
            return Rgb::BLACK;
        }
        let [of_a, of_b] = [self.half_mean(0, i), self.half_mean(1, i)];
        let (difference, size) = (of_a - of_b, of_a + of_b);
        let variance =
            |d: f64, size: f64| if d.abs() <= ROUNDING * size.abs() { 0.0 } else { d * d * a * b / ((a + b) * (a + b)) };
        Rgb::new(variance(difference.r, size.r), variance(difference.g, size.g), variance(difference.b, size.b))
    }

    fn picture_of(&self, value: impl Fn(usize) -> Rgb) -> Image {
        let pixels = (0..self.width * self.height).map(|i| value(i).to_array().map(|v| v as f32)).collect();
        Image::from_pixels(self.width, self.height, pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(value: f64) -> PixelSample {
        let mut sample = PixelSample::default();
        *sample.layer(Quantity::Indirect) = Rgb::grey(value);
        sample
    }

    #[test]
    fn the_film_holds_means_and_the_variance_of_its_halves() {
        let mut film = Film::new(1, 1);
        for (index, value) in [1.0, 3.0, 2.0, 4.0].into_iter().enumerate() {
            film.add_pass(index as u32, &[sample(value)]);
        }
        assert_eq!(film.image().at(0, 0), [2.5; 3]);
        // Halves (1+2)/2 and (3+4)/2: a quarter of the squared difference 2.
        assert_eq!(film.variance_image().at(0, 0), [1.0; 3]);
        assert_eq!(film.quantity_image(Quantity::Indirect).at(0, 0), [2.5; 3]);
    }

    /// Pixels with many samples in one pass and none in another: still the mean over samples, and the variance of that mean.
    #[test]
    fn pixels_may_have_as_many_samples_as_they_need() {
        let mut film = Film::new(1, 1);
        let mut three = PixelSample::NONE;
        [1.0, 2.0, 6.0].iter().for_each(|v| three.add(&sample(*v)));
        let mut again = PixelSample::NONE;
        again.add(&three);
        assert_eq!((again.n, again.radiance()), (3, Rgb::grey(9.0)), "sums are taken in with all of their samples");
        [three, sample(7.0), PixelSample::NONE].iter().enumerate().for_each(|(i, s)| film.add_pass(i as u32, &[*s]));
        assert_eq!(film.image().at(0, 0), [4.0; 3]);
        // Means 3 of three and 7 of one: 3/16 of the squared difference 16.
        assert_eq!(film.variance_image().at(0, 0), [3.0; 3]);
    }

    /// Two halves that agree in every digit of a pixel, but for rounding, show no noise; from the next digit on they do.
    #[test]
    fn rounding_is_no_variance() {
        for (relative, expected) in [(1e-9, 0.0), (1e-5, 0.25 * 0.3 * 0.3 * 1e-10)] {
            let mut film = Film::new(1, 1);
            [0.3, 0.3 * (1.0 + relative)].iter().enumerate().for_each(|(i, v)| film.add_pass(i as u32, &[sample(*v)]));
            let got = f64::from(film.variance_image().at(0, 0)[0]);
            assert!((got - expected).abs() <= 1e-4 * expected, "{got:e} for halves {relative} apart, not {expected:e}");
        }
    }

    #[test]
    fn light_between_surfaces_is_scaled_alone_and_in_both_halves() {
        let mut film = Film::new(1, 1);
        for (index, indirect) in [1.0, 3.0].into_iter().enumerate() {
            let mut sample = PixelSample::default();
            *sample.layer(Quantity::Direct) = Rgb::grey(5.0);
            *sample.layer(Quantity::Indirect) = Rgb::grey(indirect);
            film.add_pass(index as u32, &[sample]);
        }
        film.scale_indirect(Rgb::new(1.5, 1.0, 0.5));
        assert_eq!(film.image().at(0, 0), [8.0, 7.0, 6.0]);
        assert_eq!(film.quantity_image(Quantity::Indirect).at(0, 0), [3.0, 2.0, 1.0]);
        assert_eq!([0, 1].map(|half| film.half_mean(half, 0).r), [7.0, 9.0]);
    }

    #[test]
    fn a_lone_bright_pixel_is_a_firefly() {
        let mut film = Film::new(3, 3);
        let values = [1.0, 1.0, 1.0, 1.0, 9.0, 1.0, 1.0, 1.0, 1.0];
        film.add_pass(0, &values.map(sample));
        assert_eq!(film.fireflies(), 1);
    }

    #[test]
    fn a_sample_that_is_not_a_number_is_counted() {
        let mut film = Film::new(2, 1);
        film.add_pass(0, &[sample(1.0), sample(f64::NAN)]);
        assert_eq!(film.bad_samples(), (1, Some(1)));
        assert_eq!(film.image().at(1, 0), [0.0; 3]);
    }
}
