//! The terms of the squared errors, pixel by pixel and block by block.

use super::window::window_means;
use super::{Comparison, bootstrap, signed_root};
use crate::film::Image;

/// Added to the squared reference, so that dark pixels do not decide alone: (0.1 radiance)².
const RELATIVE_FLOOR: f64 = 0.01;

/// The same for means of 9x9 pixels, which carry far less noise: (0.01 radiance)². Small beside any block that is seen, and
/// a black block stays finite.
const BLOCK_FLOOR: f64 = 1e-4;

/// Side of the blocks of [`super::Metrics::block9_rms`] in pixels.
const BLOCK_SIDE: usize = 9;

/// Share of the pixels that [`super::Metrics::trimmed_relmse`] leaves out.
const TRIMMED_SHARE: f64 = 0.01;

/// The pictures in f64 with the local mean of the references.
pub(super) struct Terms<'a> {
    image: &'a Image,
    a: &'a Image,
    b: &'a Image,
    local_mean: Vec<[f64; 3]>,
}

impl<'a> Terms<'a> {
    pub fn new(comparison: &Comparison<'a>) -> Self {
        let (a, b) = (comparison.a, comparison.b.unwrap_or(comparison.a));
        let mean: Vec<[f64; 3]> = (0..a.pixels().len()).map(|i| reference(a, b, i)).collect();
        Self { image: comparison.image, a, b, local_mean: window_means(&mean, a.width(), a.height()) }
    }

    pub fn len(&self) -> usize {
        self.image.pixels().len()
    }

    pub fn size(&self) -> (usize, usize) {
        (self.image.width(), self.image.height())
    }

    /// (I−A)(I−B) of a pixel, per channel.
    pub fn squared(&self, i: usize) -> [f64; 3] {
        let (image, a, b) = (wide(self.image, i), wide(self.a, i), wide(self.b, i));
        std::array::from_fn(|c| (image[c] - a[c]) * (image[c] - b[c]))
    }

    /// (I−A)(I−B)/(S²+0.01) of a pixel, per channel.
    pub fn relative(&self, i: usize) -> [f64; 3] {
        let (squared, s) = (self.squared(i), self.local_mean[i]);
        std::array::from_fn(|c| squared[c] / (s[c] * s[c] + RELATIVE_FLOOR))
    }

    /// Mean of a term over kept pixels and channels; `None` if no pixel is kept.
    pub fn mean(&self, kept: &[bool], term: impl Fn(usize) -> [f64; 3]) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0.0);
        for i in (0..kept.len()).filter(|&i| kept[i]) {
            sum += term(i).iter().sum::<f64>();
            count += 3.0;
        }
        (count > 0.0).then(|| sum / count)
    }

    /// Kept pixels without those in which the references differ most.
    pub fn without_least_certain(&self, kept: &[bool]) -> Vec<bool> {
        kept.iter().zip(self.least_certain()).map(|(k, worst)| *k && !worst).collect()
    }

    /// The 1 % of all pixels with the largest (A−B)²/(S²+0.01), summed over channels: the same for every picture.
    fn least_certain(&self) -> Vec<bool> {
        let score = |i: usize| -> f64 {
            let (a, b, s) = (wide(self.a, i), wide(self.b, i), self.local_mean[i]);
            (0..3).map(|c| (a[c] - b[c]).powi(2) / (s[c] * s[c] + RELATIVE_FLOOR)).sum()
        };
        let scores: Vec<f64> = (0..self.len()).map(score).collect();
        let mut order: Vec<usize> = (0..self.len()).collect();
        order.sort_by(|&i, &j| scores[j].total_cmp(&scores[i]).then(i.cmp(&j)));
        let mut worst = vec![false; self.len()];
        let n_trimmed = (TRIMMED_SHARE * self.len() as f64).round() as usize;
        order[..n_trimmed].iter().for_each(|&i| worst[i] = true);
        worst
    }

    pub fn mean_ratio(&self, kept: &[bool]) -> [f64; 3] {
        let mut sums = [[0.0; 3]; 2];
        for i in (0..kept.len()).filter(|&i| kept[i]) {
            let (image, reference) = (wide(self.image, i), reference(self.a, self.b, i));
            (0..3).for_each(|c| sums[0][c] += image[c]);
            (0..3).for_each(|c| sums[1][c] += reference[c]);
        }
        std::array::from_fn(|c| if sums[0][c] == sums[1][c] { 1.0 } else { sums[0][c] / sums[1][c] })
    }

    /// Standard errors of the ratio, per channel.
    pub fn mean_ratio_errors(&self, kept: &[bool]) -> [f64; 3] {
        let ratio = |[image, reference]: [f64; 2]| if image == reference { 1.0 } else { image / reference };
        std::array::from_fn(|c| {
            let values = |i: usize| [wide(self.image, i)[c], reference(self.a, self.b, i)[c]];
            bootstrap::of_statistic(self.size(), kept, values, ratio)
        })
    }

    /// The squared relative errors of block means.
    pub fn blocks(&self, kept: &[bool]) -> Blocks {
        let (width, height) = self.size();
        let corners = (0..height).step_by(BLOCK_SIDE).flat_map(|y| (0..width).step_by(BLOCK_SIDE).map(move |x| (x, y)));
        let error = |(x, y)| self.block_error(block_pixels(x, y, width, height).filter(|&i| kept[i]));
        Blocks { size: (width.div_ceil(BLOCK_SIDE), height.div_ceil(BLOCK_SIDE)), errors: corners.map(error).collect() }
    }

    /// Sum over channels of (Ī−Ā)(Ī−B̄)/(R̄²+1e-4) of one block; `None` if it has no pixel.
    fn block_error(&self, pixels: impl Iterator<Item = usize>) -> Option<f64> {
        let mut sums = [[0.0; 3]; 3];
        let mut n = 0.0;
        for i in pixels {
            for (sum, image) in sums.iter_mut().zip([self.image, self.a, self.b]) {
                let pixel = wide(image, i);
                (0..3).for_each(|c| sum[c] += pixel[c]);
            }
            n += 1.0;
        }
        let [image, a, b] = sums.map(|sum| sum.map(|v| v / n));
        let error = |c: usize| {
            let reference = 0.5 * (a[c] + b[c]);
            (image[c] - a[c]) * (image[c] - b[c]) / (reference * reference + BLOCK_FLOOR)
        };
        (n > 0.0).then(|| (0..3).map(error).sum())
    }
}

/// Errors of blocks of pixels, row by row: sums over channels, `None` where no pixel is kept.
pub(super) struct Blocks {
    size: (usize, usize),
    errors: Vec<Option<f64>>,
}

impl Blocks {
    /// Mean over blocks and channels.
    pub fn mean(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        self.errors.iter().flatten().for_each(|error| {
            sum += error;
            count += 3.0;
        });
        sum / count
    }

    /// Standard error of the root of the mean.
    pub fn root_error(&self) -> f64 {
        let kept: Vec<bool> = self.errors.iter().map(Option::is_some).collect();
        let values = |i: usize| [self.errors[i].unwrap_or(0.0), 3.0];
        bootstrap::of_statistic(self.size, &kept, values, |[sum, count]| signed_root(sum / count))
    }
}

fn block_pixels(x: usize, y: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let rows = y..(y + BLOCK_SIDE).min(height);
    rows.flat_map(move |row| (x..(x + BLOCK_SIDE).min(width)).map(move |column| row * width + column))
}

fn wide(image: &Image, i: usize) -> [f64; 3] {
    image.pixels()[i].map(f64::from)
}

/// (A+B)/2 of a pixel.
fn reference(a: &Image, b: &Image, i: usize) -> [f64; 3] {
    let (a, b) = (wide(a, i), wide(b, i));
    std::array::from_fn(|c| 0.5 * (a[c] + b[c]))
}
