//! Where the samples of a pass go [Mitchell87]: to pixels in proportion to the error that one sample has there.
//!
//! The mean over pixels of e_i/n_i, with e_i the variance of one sample over the squared brightness and the sum of all n_i given, is least
//! for n_i proportional to the root of e_i. The e_i come from what the two halves of the film disagree by, smoothed over neighbours:
//! the edges of things and of shadows, reflections. A pixel's mean is over all of its samples; that their number depends on
//! some of them is a bias of second order that vanishes with the number of samples.

use crate::film::Film;
use crate::film::neighbours::means_around;
use crate::integrator::{Frame, Looked, PassPlan};
use crate::math::{Rgb, sampler::mix};
use serde::{Deserialize, Serialize};

/// Share of the samples that is spread evenly: what the estimate overlooks is still found.
const EVEN_SHARE: f64 = 0.2;
/// The same of the second pass, which is spread by what a single picture shows.
const EVEN_SHARE_AT_FIRST: f64 = 0.4;
/// No pixel gets more than this many times the mean.
const MOST: f64 = 20.0;
/// Share of the squared mean brightness of the picture that is added to that of each pixel, so that what is nearly black needs no care.
const DARK: f64 = 0.02;
/// Estimates are smoothed over this many pixels around each one as long as there are few samples.
const RADIUS: usize = 2;
/// Least share of the error that is taken to be a pixel's own.
const LEAST_OWN: f64 = 0.1;
/// From this many samples a pixel on, over fewer.
const MANY: u32 = 12;
/// What a sample costs over what a glance costs.
const SAMPLE_OVER_GLANCE: f32 = 5.0;
/// Most glances beside a sample.
const MOST_GLANCES: f32 = 15.0;
/// Least share of the variance of a sample that is taken not to be that of emission.
const LEAST_REST: f32 = 0.02;

/// The samples taken so far and those that come.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Allocation {
    width: usize,
    height: usize,
    taken: [Vec<u32>; 2],
    /// Samples a pass, by pixel.
    rate: Vec<f32>,
    /// Samples that are due, by half and pixel: below 1 after each pass.
    due: [Vec<f32>; 2],
    wanted: Vec<u32>,
    /// Glances so far, by half and pixel.
    glanced: [Vec<u32>; 2],
    /// Glances beside each sample, by pixel.
    glances: Vec<u8>,
    /// Variance of the emission that one ray finds, and of what is stored for what it meets, summed over this many samples, by pixel.
    found: Vec<(f32, f32, u32)>,
    /// What the halves disagree by, as is usual for neighbouring pixels in common, over what each has for itself.
    shared_over_own: f64,
}

impl Allocation {
    /// One sample a pixel and pass, with so many glances beside each in the first.
    pub fn new(frame: &Frame, seed: u64, glances: u8) -> Self {
        let n = frame.n_pixels();
        let dither =
            |half: u64| (0..n as u64).map(|i| (mix(seed ^ mix(2 * i + half)) >> 40) as f32 * 2.0_f32.powi(-24)).collect();
        Self {
            width: frame.crop[2],
            height: frame.crop[3],
            taken: [vec![0; n], vec![0; n]],
            rate: vec![1.0; n],
            due: [dither(0), dither(1)],
            wanted: vec![0; n],
            glanced: [vec![0; n], vec![0; n]],
            glances: vec![glances; n],
            found: vec![(0.0, 0.0, 0); n],
            shared_over_own: 0.0,
        }
    }

    /// Samples that the next pass of a half takes.
    pub fn next(&mut self, half: usize) -> PassPlan<'_> {
        for ((wanted, due), rate) in self.wanted.iter_mut().zip(&mut self.due[half]).zip(&self.rate) {
            *due += rate;
            *wanted = *due as u32;
            *due -= *wanted as f32;
        }
        let Self { taken, wanted, glanced, glances, .. } = self;
        PassPlan { half: half as u32, taken: &taken[half], wanted, glanced: &glanced[half], glances }
    }

    /// Notes what that pass has taken.
    pub fn add(&mut self, half: usize, found: &[Looked]) {
        for (i, looked) in found.iter().enumerate() {
            self.taken[half][i] += looked.sample.n;
            self.glanced[half][i] += looked.sample.n * u32::from(self.glances[i]);
            self.found[i].0 += looked.emitted;
            self.found[i].1 += looked.stored;
            self.found[i].2 += looked.n;
        }
    }

    /// Squared error that neighbouring pixels have in common, which is that of what is read between records, over the squared error that
    /// each has for itself, which more camera samples take away; as far as the halves disagree, at the last [`Self::refine`].
    pub fn shared_over_own(&self) -> f64 {
        self.shared_over_own
    }

    /// Gives the samples that come to where they are needed, as far as the film knows; after a single pass, by what can be guessed.
    pub fn refine(&mut self, film: &Film) {
        let size = [self.width, self.height];
        let taken = |i: usize| film.taken(i).iter().sum::<u32>();
        let all: u64 = (0..self.width * self.height).map(|i| u64::from(taken(i))).sum();
        let radius = if all < u64::from(MANY) * (self.width * self.height) as u64 { RADIUS } else { RADIUS / 2 };
        // Brightness around a pixel, and what a sample errs by around it.
        // As the samples are: allotted by what the filter leaves, they cost the Cornell box a tenth and saved as much in furnished rooms.
        let image = film.unfiltered();
        let bright = smooth(size, radius, |i| image.pixels()[i].iter().sum::<f32>() / 3.0);
        let level = bright.iter().map(|b| f64::from(*b)).sum::<f64>() / bright.len().max(1) as f64;
        if !level.is_normal() {
            return;
        }
        let dark = ((DARK * level * level) as f32).max(f32::MIN_POSITIVE);
        let square = |i: usize| bright[i] * bright[i] + dark;
        let looks = smooth(size, 1, |i| self.found[i].2 as f32);
        let of_glances = |i: usize| self.found[i].0 + film.gain(i) * film.gain(i) * self.found[i].1;
        let emission = smooth(size, 1, |i| of_glances(i) / square(i));
        let emission: Vec<f32> = emission.iter().zip(&looks).map(|(e, n)| if *n > 0.0 { e / n } else { 0.0 }).collect();
        if film.n_passes() < 2 {
            // How unlike its neighbours a pixel is, whether by noise, an edge or a texture.
            let around = [0, 1, 2].map(|c| smooth(size, 1, |i| image.pixels()[i][c]));
            let unlike = |i: usize| (0..3).map(|c| (image.pixels()[i][c] - around[c][i]).powi(2)).sum::<f32>() / 3.0;
            self.spread(&smooth(size, 1, |i| unlike(i) / square(i)), &emission, EVEN_SHARE_AT_FIRST);
            return;
        }
        let of_both = |i: usize| film.taken(i)[0].min(film.taken(i)[1]) > 0;
        // Of the pixels that have samples in both halves.
        let known = smooth(size, radius, |i| f32::from(u8::from(of_both(i))));
        let of_sample = |i: usize| (film.half_variance(i).mean() * f64::from(taken(i))) as f32;
        let error = smooth(size, radius, |i| if of_both(i) { of_sample(i) / square(i) } else { 0.0 });
        let error: Vec<f32> = error.iter().zip(&known).map(|(e, known)| if *known > 0.0 { e / known } else { 0.0 }).collect();
        let shared = shared_square(size, |i| {
            let difference = if of_both(i) { film.half_mean(0, i) - film.half_mean(1, i) } else { Rgb::BLACK };
            difference.mean() as f32 / square(i).sqrt()
        });
        // The variance of the mean is a quarter of the squared difference of the halves.
        let n = (self.width * self.height) as f64;
        let all =
            (0..self.width * self.height).map(|i| film.half_variance(i).mean() / f64::from(square(i))).sum::<f64>() * 4.0 / n;
        let own = (all - shared).max(LEAST_OWN * all);
        self.shared_over_own = if own > 0.0 { shared / own } else { 0.0 };
        self.spread(&error, &emission, EVEN_SHARE);
    }

    /// Glances so that what they leave of the variance of emission is worth what they cost, and samples in proportion to the root of what one of
    /// them errs by over the root of its cost, but for an even share. `error` is what a sample errs by as samples are now, `emission` what a single
    /// ray does by emission alone.
    fn spread(&mut self, error: &[f32], emission: &[f32], even: f64) {
        let mut need = Vec::with_capacity(error.len());
        for ((error, emission), glances) in error.iter().zip(emission).zip(&mut self.glances) {
            let rest = (error - emission / (1.0 + f32::from(*glances))).max(LEAST_REST * emission).max(LEAST_REST * error);
            // Least (rest + emission/k)(S + k) for k rays, the sample's own among them.
            let rays = if rest > 0.0 { (SAMPLE_OVER_GLANCE * emission / rest).sqrt() } else { 1.0 };
            *glances = (rays - 1.0).clamp(0.0, MOST_GLANCES).round() as u8;
            let more = f32::from(*glances);
            let expected = (rest + emission / (1.0 + more)).max(0.0) / (1.0 + more / SAMPLE_OVER_GLANCE);
            need.push(f64::from(expected).sqrt());
        }
        let mean_need = need.iter().sum::<f64>() / need.len().max(1) as f64;
        if !mean_need.is_normal() {
            return;
        }
        let wish: Vec<f64> = need.iter().map(|n| even + (1.0 - even) * (n / mean_need).min(MOST)).collect();
        let scale = wish.len() as f64 / wish.iter().sum::<f64>();
        self.rate = wish.iter().map(|wish| (wish * scale) as f32).collect();
    }
}

/// Mean of a value over the pixels at most `radius` away in each direction.
fn smooth(size: [usize; 2], radius: usize, value: impl Fn(usize) -> f32) -> Vec<f32> {
    let values: Vec<f32> = (0..size[0] * size[1]).map(value).collect();
    means_around(size, &values, radius)
}

/// Of the values of a picture, the part of the mean square that neighbours share: what is independent from pixel to pixel falls, in the mean
/// over n pixels, to the n-th part.
fn shared_square(size: [usize; 2], value: impl Fn(usize) -> f32) -> f64 {
    let n = ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f64;
    let mean_square = |v: &[f32]| v.iter().map(|v| f64::from(*v) * f64::from(*v)).sum::<f64>() / v.len().max(1) as f64;
    let values: Vec<f32> = (0..size[0] * size[1]).map(value).collect();
    let (all, smooth) = (mean_square(&values), mean_square(&means_around(size, &values, RADIUS)));
    ((smooth - all / n) / (1.0 - 1.0 / n)).clamp(0.0, all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{PixelSample, Quantity};
    use crate::math::Sampler;

    const SIDE: usize = 32;

    fn noise(key: usize, index: u64) -> f64 {
        f64::from(Sampler::new(1, key as u64, index).next_1d()) - 0.5
    }

    /// A pass whose samples are 3, and err in the left half of the picture.
    fn pass(allocation: &mut Allocation, film: &mut Film, index: u32) -> f64 {
        let half = (index % 2) as usize;
        let wanted = allocation.next(half).wanted.to_vec();
        let sample = |i: usize| {
            let mut sample = PixelSample { n: wanted[i], ..PixelSample::NONE };
            let error = if i % SIDE < SIDE / 2 { noise(i, index.into()) } else { 0.0 };
            *sample.layer(Quantity::Direct) = Rgb::grey(f64::from(wanted[i]) * 3.0 * (1.0 + error));
            sample
        };
        let samples: Vec<PixelSample> = (0..SIDE * SIDE).map(sample).collect();
        let looked: Vec<Looked> =
            samples.iter().map(|&sample| Looked { sample, emitted: 0.0, stored: 0.0, n: sample.n }).collect();
        allocation.add(half, &looked);
        film.add_pass(index, &samples);
        f64::from(wanted.iter().sum::<u32>()) / (SIDE * SIDE) as f64
    }

    #[test]
    fn samples_go_where_the_halves_disagree() {
        let (mut allocation, mut film) = (Allocation::new(&Frame::whole(SIDE, SIDE), 3, 1), Film::new(SIDE, SIDE));
        (0..2).for_each(|index| assert_eq!(pass(&mut allocation, &mut film, index), 1.0));
        allocation.refine(&film);
        let mean = (2..18).map(|index| pass(&mut allocation, &mut film, index)).sum::<f64>() / 16.0;
        // Half of the pixels need all that is not spread evenly; one pass may be off by the rounding of a pixel's share.
        assert!((mean - 1.0).abs() < 0.02, "{mean} samples a pixel and pass instead of 1");
        let taken = |columns: std::ops::Range<usize>| {
            let n = columns.len() * SIDE;
            let of = |i: usize| f64::from(allocation.taken[0][i] + allocation.taken[1][i] - 2) / 16.0;
            (0..SIDE).flat_map(|y| columns.clone().map(move |x| y * SIDE + x)).map(of).sum::<f64>() / n as f64
        };
        // Away from the border, which is smoothed over: 0.2 + 0.8 x 2, and 0.2.
        let (left, right) = (taken(0..SIDE / 2 - 3), taken(SIDE / 2 + 3..SIDE));
        assert!((left - 1.8).abs() < 0.1 && (right - EVEN_SHARE).abs() < 0.02, "{left} and {right}");
    }

    /// Errors with independent values in blocks of 16 x 16 pixels, and in each pixel, of the same variance: as much shared as own.
    #[test]
    fn errors_that_neighbours_share_are_told_from_those_they_do_not() {
        let side = 256;
        let block = |i: usize| i / side / 16 * 16 + i % side / 16;
        // Of a uniform number: 1/12.
        let of = |value: &dyn Fn(usize) -> f64| 12.0 * shared_square([side, side], |i| value(i) as f32);
        let own = of(&|i| noise(i, 0));
        assert!(own < 0.01, "{own}");
        // Windows across the borders of blocks lose some of it: (1 - 1.2/16)^2 = 0.86.
        let both = of(&|i| noise(i, 0) + noise(1_000_000 + block(i), 0));
        assert!((both - 0.86).abs() < 0.12, "{both}");
        let shared = of(&|i| noise(1_000_000 + block(i), 0));
        assert!((shared - 0.86).abs() < 0.12, "{shared}");
    }
}
