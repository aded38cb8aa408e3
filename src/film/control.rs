//! Image-space control variates [Rousselle16]: what is known beforehand of the light along a sample's ray, and along more rays of its pixel.
//!
//! A camera ray that only looks up what is stored for the surface that it meets costs little. Where edges and textures lie within a pixel,
//! what is stored varies as the radiance does, so a pixel becomes R + g (M - Z): R the mean of its samples, Z that of what is
//! stored along their rays, M that of what is stored along all of its rays. Right in the mean for any g; the g that leaves the least
//! variance is how R goes with Z, which the two halves of the film tell: where one half has found more than the other of what is
//! stored, how much more has it found of the light? M and Z become the same as samples are added, so that the little that is wrong by
//! taking g from the same samples vanishes faster than the noise.

use super::{Film, filter};
use crate::math::Rgb;
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// The gain of a pixel is that of the pixels at most this far away in each direction.
const AROUND: usize = 2;
/// Weight of a gain of 1 beside what the halves tell of a pixel's gain.
const PRIOR: f32 = 0.1;

/// What is known beforehand, summed over the samples of a pixel.
#[derive(Debug, Clone, Copy, Default)]
pub struct Beforehand {
    /// Along the rays of the samples.
    pub own: Rgb,
    /// Mean along these and more rays, less that.
    pub change: Rgb,
}

impl Beforehand {
    /// Nothing is known.
    pub const NOTHING: Self = Self { own: Rgb::BLACK, change: Rgb::BLACK };

    /// Takes what is known of other samples in.
    #[inline]
    pub fn add(&mut self, other: &Self) {
        self.own += other.own;
        self.change += other.change;
    }
}

/// The same of all pixels, by half.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Control {
    own: [Vec<Rgb>; 2],
    change: [Vec<Rgb>; 2],
    /// By pixel, once they were asked for.
    #[serde(skip)]
    gains: OnceLock<Vec<f32>>,
}

impl Control {
    pub fn new(n: usize) -> Self {
        let none = || [vec![Rgb::BLACK; n], vec![Rgb::BLACK; n]];
        Self { own: none(), change: none(), gains: OnceLock::new() }
    }

    pub fn add(&mut self, half: usize, pixel: usize, known: &Beforehand) {
        self.own[half][pixel] += known.own;
        self.change[half][pixel] += known.change;
        self.gains.take();
    }

    /// What is to be added to the sum of the samples of one half.
    #[inline]
    pub fn correction(&self, film: &Film, half: usize, pixel: usize) -> Rgb {
        self.change[half][pixel] * f64::from(self.gain(film, pixel))
    }

    /// How the light of a pixel goes with what is known of it, from 0 to 1; 1 until both halves tell.
    #[inline]
    pub fn gain(&self, film: &Film, pixel: usize) -> f32 {
        self.gains.get_or_init(|| self.gains_of(film))[pixel]
    }

    fn gains_of(&self, film: &Film) -> Vec<f32> {
        let n = film.width * film.height;
        let unit = film.unit();
        let (mut both, mut alone) = (vec![0.0; n], vec![0.0; n]);
        for i in 0..n {
            let [a, b] = [0, 1].map(|half: usize| f64::from(film.taken[half][i]));
            if a * b == 0.0 {
                continue;
            }
            let difference = |halves: &[Vec<Rgb>; 2]| halves[0][i] / a - halves[1][i] / b;
            let (found, known) = (difference(&film.halves), difference(&self.own));
            let weight = a * b / (a + b);
            let (found, known) = (found / unit, known / unit);
            both[i] = ((found * known).mean() * weight) as f32;
            alone[i] = ((known * known).mean() * weight) as f32;
        }
        let size = [film.width, film.height];
        let (both, alone) = (filter::around(size, &both, AROUND), filter::around(size, &alone, AROUND));
        let gain = |(both, alone): (&f32, &f32)| {
            let gain = (both + PRIOR * alone) / ((1.0 + PRIOR) * alone);
            if gain.is_finite() { gain.clamp(0.0, 1.0) } else { 1.0 }
        };
        both.iter().zip(&alone).map(gain).collect()
    }
}
