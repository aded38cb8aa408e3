//! Image-space control variates [Rousselle16]: what is known beforehand of the light along a sample's ray, and along more rays of its pixel.
//!
//! A camera ray that only looks up what is stored for the surface that it meets costs little. Where edges and textures lie within a pixel,
//! what is stored varies as the radiance does, so a pixel becomes R + g (M - Z): R the mean of its samples, Z that of what is
//! stored along their rays, M that of what is stored along all of its rays. Right in the mean for any g; the g that leaves the least
//! variance is how R goes with Z, which the two halves of the film tell: where one half has found more than the other of what is
//! stored, how much more has it found of the light? M and Z become the same as samples are added, so that the little that is wrong by
//! taking g from the same samples vanishes faster than the noise.

use super::neighbours::sums_around;
use super::{Film, ROUNDING};
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
        let change = self.change[half][pixel] * f64::from(self.gain(film, pixel));
        if film.passes.contains(&0) {
            no_more_than_found(change, film.halves[half][pixel], self.own[half][pixel])
        } else {
            change
        }
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
            let difference = |halves: &[Vec<Rgb>; 2]| {
                let (of_a, of_b) = (halves[0][i] / (a * unit), halves[1][i] / (b * unit));
                beyond_rounding(of_a - of_b, of_a + of_b)
            };
            let (found, known) = (difference(&film.halves), difference(&self.own));
            let weight = a * b / (a + b);
            both[i] = ((found * known).mean() * weight) as f32;
            alone[i] = ((known * known).mean() * weight) as f32;
        }
        let size = [film.width, film.height];
        let (both, alone) = (sums_around(size, &both, AROUND), sums_around(size, &alone, AROUND));
        let gain = |(both, alone): (&f32, &f32)| {
            let gain = (both + PRIOR * alone) / ((1.0 + PRIOR) * alone);
            if gain.is_finite() { gain.clamp(0.0, 1.0) } else { 1.0 }
        };
        both.iter().zip(&alone).map(gain).collect()
    }
}

/// While one half is empty nobody knows how light goes with what is stored. Where a sample found less than that, a change that takes away is taken to
/// be of what it found: what is stored for the edge of a thing may be far brighter than the edge, and the pixel would be black.
fn no_more_than_found(change: Rgb, found: Rgb, own: Rgb) -> Rgb {
    let of =
        |change: f64, found: f64, own: f64| if change < 0.0 && found < own { change * (found / own).max(0.0) } else { change };
    Rgb::new(of(change.r, found.r, own.r), of(change.g, found.g, own.g), of(change.b, found.b, own.b))
}

/// The difference of two values that add up to `sum`, or nothing where they are the same but for rounding: in a furnace all pixels are, and how one rounding
/// goes with another means nothing.
fn beyond_rounding(difference: Rgb, sum: Rgb) -> Rgb {
    let of = |d: f64, sum: f64| if d.abs() <= ROUNDING * sum.abs() { 0.0 } else { d };
    Rgb::new(of(difference.r, sum.r), of(difference.g, sum.g), of(difference.b, sum.b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{Image, PixelSample, Quantity};
    use crate::math::{Sampler, sampler::mix};

    const SIDE: usize = 32;
    /// Rays beside each sample.
    const MORE: u32 = 7;

    /// A film of so many samples a pixel and half. Along each ray 1 or 3 is known, as on either side of an edge through the pixel, and `found` is the light,
    /// by what is known and a random number about 0.
    fn film(passes: u32, seed: u64, is_controlled: bool, found: impl Fn(f64, f64) -> f64) -> Film {
        let mut film = Film::new(SIDE, SIDE).controlled(is_controlled);
        for index in 0..2 * passes {
            let samples: Vec<PixelSample> = (0..SIDE * SIDE)
                .map(|i| {
                    let mut random = Sampler::new(seed, mix(i as u64 ^ mix(index.into())), 0);
                    let mut known = || if random.next_1d() < 0.5 { 1.0 } else { 3.0 };
                    let own: f64 = known();
                    let all = own + (0..MORE).map(|_| known()).sum::<f64>();
                    let mut sample = PixelSample::default();
                    *sample.layer(Quantity::Indirect) = Rgb::grey(found(own, f64::from(random.next_1d()) - 0.5));
                    sample.known = Beforehand { own: Rgb::grey(own), change: Rgb::grey(all / f64::from(1 + MORE) - own) };
                    sample
                })
                .collect();
            film.add_pass(index, &samples);
        }
        film
    }

    /// Mean error and mean squared error.
    fn errors(image: &Image, right: f64) -> [f64; 2] {
        let n = (SIDE * SIDE) as f64;
        let of = |power: i32| image.pixels().iter().map(|p| (f64::from(p[1]) - right).powi(power)).sum::<f64>() / n;
        [of(1), of(2)]
    }

    /// Light that is what is known, and a little noise: what is left of the variance of the edge is an eighth, by eight rays for one.
    #[test]
    fn edges_that_are_known_are_seen_by_all_rays() {
        let found = |known: f64, noise: f64| known + noise;
        let errors_of = |is_controlled: bool| errors(&film(1, 1, is_controlled, found).unfiltered(), 2.0);
        let ([_, alone], [mean, controlled]) = (errors_of(false), errors_of(true));
        // A variance of 1 for the edge and 1/12 for the noise, over two samples.
        let expected = (1.0 / 8.0 + 1.0 / 12.0) / (1.0 + 1.0 / 12.0);
        assert!((controlled / alone / expected - 1.0).abs() < 0.25, "{controlled} of {alone}, expected a share of {expected}");
        let standard_error = (controlled / (SIDE * SIDE) as f64).sqrt();
        assert!(mean.abs() < 4.0 * standard_error, "the mean is off by {mean}, its standard error {standard_error}");
    }

    /// Light that falls where what is known rises, or has nothing to do with it: the gain is next to none.
    #[test]
    fn what_is_known_wrongly_does_little_harm() {
        let against = |known: f64, noise: f64| 4.0 - known + noise;
        let beside = |_: f64, noise: f64| 2.0 + 2.0 * noise;
        for found in [&against as &dyn Fn(f64, f64) -> f64, &beside] {
            for passes in [1, 8] {
                let error_of = |is_controlled: bool| errors(&film(passes, 2, is_controlled, found).unfiltered(), 2.0)[1];
                let (alone, controlled) = (error_of(false), error_of(true));
                assert!(controlled < 1.15 * alone, "{controlled} instead of {alone} after {passes} passes");
            }
        }
    }

    /// Light that goes half as far as what is known: so does the gain, but for what is expected of it beforehand.
    #[test]
    fn the_gain_is_how_light_goes_with_what_is_known() {
        let film = film(64, 3, true, |known, noise| 0.5 * known + noise);
        let mean = (0..SIDE * SIDE).map(|i| f64::from(film.gain(i))).sum::<f64>() / (SIDE * SIDE) as f64;
        let expected = (0.5 + f64::from(PRIOR)) / (1.0 + f64::from(PRIOR));
        assert!((mean - expected).abs() < 0.02, "{mean}, expected {expected}");
    }

    /// A first pass alone: a pixel is darker by the share by which what is stored is less along all rays, unless its sample found more than is stored.
    #[test]
    fn a_change_takes_no_more_than_the_first_pass_has_found() {
        let first_pass = |own: f64, change: f64, found: f64| {
            let mut sample = PixelSample::default();
            *sample.layer(Quantity::Indirect) = Rgb::grey(found);
            sample.known = Beforehand { own: Rgb::grey(own), change: Rgb::grey(change) };
            let mut film = Film::new(2, 2).controlled(true);
            film.add_pass(0, &[sample; 4]);
            film.half_mean(0, 0).g
        };
        for (own, change, found, expected) in
            [(3.0, -1.0, 0.15, 0.1), (1.0, -0.5, 2.0, 1.5), (3.0, 1.0, 0.15, 1.15), (3.0, -1.0, 0.0, 0.0)]
        {
            let got = first_pass(own, change, found);
            assert!((got - expected).abs() < 1e-6, "{own} {change} {found}: {got}, expected {expected}");
        }
    }

    #[test]
    fn no_pixel_is_shown_below_black_and_a_power_of_two_changes_no_bit() {
        let dark = film(1, 4, true, |known, _| 0.05 * known);
        assert!((0..SIDE * SIDE).any(|i| dark.half_mean(0, i).g < 0.0), "a pixel whose sample found less than is known");
        assert!(dark.image().pixels().iter().flatten().all(|v| *v >= 0.0));
        let scaled = |scale: f64| {
            let mut film = Film::new(2, 2).controlled(true);
            for (index, [own, found]) in [[1.0, 1.2], [3.0, 2.9]].into_iter().enumerate() {
                let mut sample = PixelSample::default();
                *sample.layer(Quantity::Direct) = Rgb::grey(scale * found);
                sample.known = Beforehand { own: Rgb::grey(scale * own), change: Rgb::grey(scale * (2.0 - own)) };
                film.add_pass(index as u32, &[sample; 4]);
            }
            film.image().at(0, 0)[0]
        };
        assert_eq!(scaled(1.0) * 2.0_f32.powi(100), scaled(2.0_f64.powi(100)));
    }
}
