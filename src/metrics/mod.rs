//! How far a picture is from its reference.
//!
//! With two independent references A and B a squared error is the cross product (I−A)(I−B): the noise of A and of B is not
//! correlated, so its mean has no floor from the references and may even be negative. With one reference it is (I−A)².
//! Everything is computed in f64, per channel, on linear values. The perceptual metric FLIP is not here yet.

pub mod block_test;
mod bootstrap;
pub mod false_colour;
mod window;

use crate::film::{Image, Mask};
use thiserror::Error;
use window::window_means;

/// Added to the squared reference, so that dark pixels do not decide alone: (0.1 radiance)².
const RELATIVE_FLOOR: f64 = 0.01;

/// The same for means of 9x9 pixels, which carry far less noise: (0.01 radiance)². Small beside any block that is seen, and
/// a black block stays finite.
const BLOCK_FLOOR: f64 = 1e-4;

/// Side of the blocks of [`Metrics::block9_rms`] in pixels.
const BLOCK_SIDE: usize = 9;

/// Share of the pixels that [`Metrics::trimmed_relmse`] leaves out.
const TRIMMED_SHARE: f64 = 0.01;

/// What is compared with what.
#[derive(Debug, Clone, Copy)]
pub struct Comparison<'a> {
    /// The picture to be judged.
    pub image: &'a Image,
    /// A reference.
    pub a: &'a Image,
    /// A second reference, independent of the first.
    pub b: Option<&'a Image>,
    /// Pixels that count nowhere.
    pub left_out: Option<&'a Mask>,
    /// Pixels that see an emitter directly.
    pub emitters: Option<&'a Mask>,
}

/// The errors of a picture. All but the ratios are 0 for a perfect one.
#[derive(Debug, Clone, PartialEq)]
pub struct Metrics {
    /// Mean of (I−A)(I−B) over pixels and channels.
    pub mse: f64,
    /// Root of `mse`, with its sign.
    pub rmse: f64,
    /// Mean over pixels and channels of (I−A)(I−B)/(S²+0.01), S the 5x5-pixel mean of (A+B)/2.
    pub relmse: f64,
    /// Standard error of `relmse`: bootstrap over blocks of pixels, so that noise shared by neighbours counts.
    pub relmse_se: f64,
    /// `relmse` without the 1 % of pixels with the largest (A−B)²/(S²+0.01); only with two references.
    pub trimmed_relmse: Option<f64>,
    /// `relmse` without the pixels of [`Comparison::emitters`].
    pub relmse_off_emitters: Option<f64>,
    /// Mean of the picture over the mean of (A+B)/2, per channel; 1 where both are 0.
    pub mean_ratio: [f64; 3],
    /// Root of the mean over 9x9-pixel blocks and channels of (Ī−Ā)(Ī−B̄)/(R̄²+1e-4), with its sign: bars are means over a
    /// block, R = (A+B)/2. Blocks at the right and lower border are smaller.
    pub block9_rms: f64,
    /// True if an estimate is negative: the picture is closer to the truth than the references can tell.
    pub below_reference_noise: bool,
    /// Pixels that counted.
    pub n_pixels: usize,
    /// NaN or infinite pixels of the picture among them. If there are any, the other figures are NaN or infinite.
    pub n_not_finite: usize,
    /// Column and row of the first such pixel.
    pub first_not_finite: Option<(usize, usize)>,
}

/// Why a comparison is not possible.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum MetricsError {
    /// Pictures of different sizes.
    #[error("{what} has {}x{} pixels, the picture {}x{}", found.0, found.1, expected.0, expected.1)]
    Size {
        /// Which input differs.
        what: &'static str,
        /// Its size.
        found: (usize, usize),
        /// Size of the picture.
        expected: (usize, usize),
    },
    /// A reference is no reference.
    #[error("{what} has a NaN or infinite value at column {x}, row {y}")]
    NotFinite {
        /// Which reference.
        what: &'static str,
        /// Column of the pixel.
        x: usize,
        /// Its row.
        y: usize,
    },
    /// Masks cover everything, or the picture has no pixel.
    #[error("no pixel is left to compare")]
    Empty,
}

/// Compares a picture with its references.
///
/// # Errors
/// [`MetricsError`] if sizes differ, a reference is not finite or nothing is left to compare.
pub fn compare(comparison: &Comparison) -> Result<Metrics, MetricsError> {
    check(comparison)?;
    let terms = Terms::new(comparison);
    let kept = |mask: Option<&Mask>| -> Vec<bool> {
        let in_mask = |m: Option<&Mask>, i: usize| m.is_some_and(|m| m.values()[i]);
        (0..terms.len()).map(|i| !in_mask(comparison.left_out, i) && !in_mask(mask, i)).collect()
    };
    let all = kept(None);
    let mse = terms.mean(&all, |i| terms.squared(i)).ok_or(MetricsError::Empty)?;
    let relmse = terms.mean(&all, |i| terms.relative(i)).ok_or(MetricsError::Empty)?;
    let trimmed = comparison.b.map(|_| terms.trimmed(&all));
    let off_emitters = comparison.emitters.map(|mask| terms.mean(&kept(Some(mask)), |i| terms.relative(i)));
    let block_mean = terms.block_mean(&all);
    let trimmed_relmse = trimmed.map(|m| m.ok_or(MetricsError::Empty)).transpose()?;
    let (n_not_finite, first_not_finite) = not_finite(comparison.image, &all);
    Ok(Metrics {
        mse,
        rmse: signed_root(mse),
        relmse,
        relmse_se: bootstrap::standard_error(terms.size(), &all, |i| terms.relative(i)),
        trimmed_relmse,
        relmse_off_emitters: off_emitters.map(|m| m.ok_or(MetricsError::Empty)).transpose()?,
        mean_ratio: terms.mean_ratio(&all),
        block9_rms: signed_root(block_mean),
        below_reference_noise: [mse, relmse, block_mean, trimmed_relmse.unwrap_or(0.0)].iter().any(|&v| v < 0.0),
        n_pixels: all.iter().filter(|&&k| k).count(),
        n_not_finite,
        first_not_finite,
    })
}

fn signed_root(value: f64) -> f64 {
    if value == 0.0 { 0.0 } else { value.abs().sqrt().copysign(value) }
}

fn check(comparison: &Comparison) -> Result<(), MetricsError> {
    let expected = (comparison.image.width(), comparison.image.height());
    let references = [("reference A", Some(comparison.a)), ("reference B", comparison.b)];
    let masks = [("the mask", comparison.left_out), ("the mask of emitters", comparison.emitters)];
    let images = references.iter().filter_map(|(what, image)| image.map(|i| (*what, (i.width(), i.height()))));
    let masks = masks.iter().filter_map(|(what, mask)| mask.map(|m| (*what, m.size())));
    for (what, found) in images.chain(masks) {
        if found != expected {
            return Err(MetricsError::Size { what, found, expected });
        }
    }
    for (what, image) in references {
        let image = image.into_iter().flat_map(Image::pixels);
        if let Some(at) = image.into_iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            return Err(MetricsError::NotFinite { what, x: at % expected.0, y: at / expected.0 });
        }
    }
    Ok(())
}

/// Counts pixels with a NaN or an infinity and finds the first.
fn not_finite(image: &Image, kept: &[bool]) -> (usize, Option<(usize, usize)>) {
    let bad = |&i: &usize| kept[i] && !image.pixels()[i].iter().all(|v| v.is_finite());
    let mut all = (0..kept.len()).filter(bad);
    match all.next() {
        None => (0, None),
        Some(first) => (1 + all.count(), Some((first % image.width(), first / image.width()))),
    }
}

/// The pictures in f64 with the local mean of the references.
struct Terms<'a> {
    image: &'a Image,
    a: &'a Image,
    b: &'a Image,
    local_mean: Vec<[f64; 3]>,
}

impl<'a> Terms<'a> {
    fn new(comparison: &Comparison<'a>) -> Self {
        let (a, b) = (comparison.a, comparison.b.unwrap_or(comparison.a));
        let mean: Vec<[f64; 3]> = (0..a.pixels().len()).map(|i| reference(a, b, i)).collect();
        Self { image: comparison.image, a, b, local_mean: window_means(&mean, a.width(), a.height()) }
    }

    fn len(&self) -> usize {
        self.image.pixels().len()
    }

    fn size(&self) -> (usize, usize) {
        (self.image.width(), self.image.height())
    }

    /// (I−A)(I−B) of a pixel, per channel.
    fn squared(&self, i: usize) -> [f64; 3] {
        let (image, a, b) = (wide(self.image, i), wide(self.a, i), wide(self.b, i));
        std::array::from_fn(|c| (image[c] - a[c]) * (image[c] - b[c]))
    }

    /// (I−A)(I−B)/(S²+0.01) of a pixel, per channel.
    fn relative(&self, i: usize) -> [f64; 3] {
        let (squared, s) = (self.squared(i), self.local_mean[i]);
        std::array::from_fn(|c| squared[c] / (s[c] * s[c] + RELATIVE_FLOOR))
    }

    /// Mean of a term over kept pixels and channels; `None` if no pixel is kept.
    fn mean(&self, kept: &[bool], term: impl Fn(usize) -> [f64; 3]) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0.0);
        for i in (0..kept.len()).filter(|&i| kept[i]) {
            sum += term(i).iter().sum::<f64>();
            count += 3.0;
        }
        (count > 0.0).then(|| sum / count)
    }

    /// Relative error without the pixels in which the references differ most.
    fn trimmed(&self, kept: &[bool]) -> Option<f64> {
        let worst = self.least_certain();
        let kept: Vec<bool> = kept.iter().zip(&worst).map(|(k, w)| *k && !*w).collect();
        self.mean(&kept, |i| self.relative(i))
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

    fn mean_ratio(&self, kept: &[bool]) -> [f64; 3] {
        let mut sums = [[0.0; 3]; 2];
        for i in (0..kept.len()).filter(|&i| kept[i]) {
            let (image, reference) = (wide(self.image, i), reference(self.a, self.b, i));
            (0..3).for_each(|c| sums[0][c] += image[c]);
            (0..3).for_each(|c| sums[1][c] += reference[c]);
        }
        std::array::from_fn(|c| if sums[0][c] == sums[1][c] { 1.0 } else { sums[0][c] / sums[1][c] })
    }

    /// Mean over blocks and channels of the squared relative error of block means.
    fn block_mean(&self, kept: &[bool]) -> f64 {
        let (width, height) = self.size();
        let (mut sum, mut count) = (0.0, 0.0);
        for y in (0..height).step_by(BLOCK_SIDE) {
            for x in (0..width).step_by(BLOCK_SIDE) {
                let pixels = block_pixels(x, y, width, height).filter(|&i| kept[i]);
                if let Some(error) = self.block_error(pixels) {
                    sum += error;
                    count += 3.0;
                }
            }
        }
        sum / count
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

#[cfg(test)]
mod tests;
