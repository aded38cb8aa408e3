//! Where the samples of a pass go: to pixels in proportion to the error that one more sample has there.
//!
//! The mean over pixels of e_i/n_i, with e_i the variance of one sample over the squared brightness and the sum of all n_i given, is least
//! for n_i proportional to the root of e_i. The e_i come from what the two halves of the film disagree by, smoothed over neighbours:
//! the edges of things and of shadows, reflections. A pixel's mean is over all of its samples; that their number depends on
//! some of them is a bias of second order that vanishes with the number of samples.

use crate::film::PixelSample;
use crate::integrator::{Frame, PassPlan};
use crate::math::sampler::mix;

/// Share of the samples that is spread evenly: what the estimate overlooks is still found.
const EVEN_SHARE: f64 = 0.2;
/// No pixel gets more than this many times the mean.
const MOST: f64 = 20.0;
/// Estimates are smoothed over this many pixels around each one as long as there are few samples.
const RADIUS: usize = 2;
/// From this many samples a pixel on, over fewer.
const MANY: u32 = 12;

/// The samples taken so far and those that come.
pub(super) struct Allocation {
    width: usize,
    height: usize,
    /// Sums of radiance by half and pixel [W/(m² sr)].
    sums: [Vec<[f32; 3]>; 2],
    taken: [Vec<u32>; 2],
    /// Samples a pass, by pixel.
    rate: Vec<f32>,
    /// Samples that are due, by half and pixel: below 1 after each pass.
    due: [Vec<f32>; 2],
    wanted: Vec<u32>,
}

impl Allocation {
    /// One sample a pixel and pass.
    pub fn new(frame: &Frame, seed: u64) -> Self {
        let n = frame.n_pixels();
        let dither =
            |half: u64| (0..n as u64).map(|i| (mix(seed ^ mix(2 * i + half)) >> 40) as f32 * 2.0_f32.powi(-24)).collect();
        Self {
            width: frame.crop[2],
            height: frame.crop[3],
            sums: [vec![[0.0; 3]; n], vec![[0.0; 3]; n]],
            taken: [vec![0; n], vec![0; n]],
            rate: vec![1.0; n],
            due: [dither(0), dither(1)],
            wanted: vec![0; n],
        }
    }

    /// Samples that the next pass of a half takes.
    pub fn next(&mut self, half: usize) -> PassPlan<'_> {
        for ((wanted, due), rate) in self.wanted.iter_mut().zip(&mut self.due[half]).zip(&self.rate) {
            *due += rate;
            *wanted = *due as u32;
            *due -= *wanted as f32;
        }
        PassPlan { half: half as u32, taken: &self.taken[half], wanted: &self.wanted }
    }

    /// What that pass found.
    pub fn add(&mut self, half: usize, samples: &[PixelSample]) {
        for ((sum, taken), sample) in self.sums[half].iter_mut().zip(&mut self.taken[half]).zip(samples) {
            let radiance = sample.radiance();
            if radiance.is_finite() {
                (0..3).for_each(|c| sum[c] += radiance[c] as f32);
            }
            *taken += sample.n;
        }
    }

    /// Gives the samples that come to where they are needed, as far as is known.
    pub fn refine(&mut self) {
        let (w, h) = (self.width, self.height);
        let taken: u64 = self.taken.iter().flatten().map(|n| u64::from(*n)).sum();
        let radius = if taken < u64::from(MANY) * (w * h) as u64 { RADIUS } else { RADIUS / 2 };
        let mean = |half: usize, i: usize| {
            let n = self.taken[half][i].max(1) as f32;
            self.sums[half][i].map(|s| s / n)
        };
        // Brightness around a pixel, and what a sample errs by around it.
        let bright = smooth([w, h], radius, |i| {
            let (a, b) = (mean(0, i), mean(1, i));
            (0..3).map(|c| 0.5 * (a[c] + b[c])).sum::<f32>() / 3.0
        });
        let error = smooth([w, h], radius, |i| {
            let (a, b) = (mean(0, i), mean(1, i));
            let [n, m] = [0, 1].map(|half: usize| self.taken[half][i] as f32);
            let squared = (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>() / 3.0;
            squared * n * m / (n + m).max(1.0) / (bright[i] * bright[i] + 0.01)
        });
        let need: Vec<f64> = error.iter().map(|e| f64::from(e.max(0.0)).sqrt()).collect();
        let mean_need = need.iter().sum::<f64>() / need.len().max(1) as f64;
        if !mean_need.is_normal() {
            return;
        }
        let wish: Vec<f64> = need.iter().map(|n| EVEN_SHARE + (1.0 - EVEN_SHARE) * (n / mean_need).min(MOST)).collect();
        let scale = wish.len() as f64 / wish.iter().sum::<f64>();
        self.rate = wish.iter().map(|wish| (wish * scale) as f32).collect();
    }
}

/// Mean over the pixels at most `radius` away in each direction.
fn smooth([width, height]: [usize; 2], radius: usize, value: impl Fn(usize) -> f32) -> Vec<f32> {
    let around = |i: usize, n: usize| i.saturating_sub(radius)..(i + radius + 1).min(n);
    let values: Vec<f32> = (0..width * height).map(value).collect();
    let mean = |range: std::ops::Range<usize>, at: &dyn Fn(usize) -> f32| {
        let n = range.len() as f32;
        range.map(at).sum::<f32>() / n
    };
    let across: Vec<f32> =
        (0..width * height).map(|i| mean(around(i % width, width), &|x| values[i / width * width + x])).collect();
    (0..width * height).map(|i| mean(around(i / width, height), &|y| across[y * width + i % width])).collect()
}
