//! How far a picture is from its reference.
//!
//! With two independent references A and B a squared error is the cross product (I−A)(I−B): the noise of A and of B is not
//! correlated, so its mean has no floor from the references and may even be negative. With one reference it is (I−A)².
//! Everything is computed in f64, per channel, on linear values. FLIP, the difference that a person sees, compares with
//! the mean of A and B.

pub mod block_test;
mod bootstrap;
pub mod false_colour;
pub mod flip;
mod terms;
mod window;

use crate::film::{Image, Mask};
use terms::Terms;
use thiserror::Error;

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
    /// Mean of LDR-FLIP: linear values cut to [0, 1] at exposure 0, then the sRGB curve; 67 pixels per degree.
    pub flip_ldr: f64,
    /// Mean of HDR-FLIP, exposures by [`flip::Exposures::of`] (A+B)/2, ACES curve; 67 pixels per degree.
    pub flip_hdr: f64,
    /// Standard errors of the other figures, as `relmse_se`.
    pub standard_errors: StandardErrors,
    /// True if an estimate is negative: the picture is closer to the truth than the references can tell.
    pub below_reference_noise: bool,
    /// Pixels that counted.
    pub n_pixels: usize,
    /// NaN or infinite pixels of the picture among them. If there are any, the other figures are NaN or infinite.
    pub n_not_finite: usize,
    /// Column and row of the first such pixel.
    pub first_not_finite: Option<(usize, usize)>,
}

/// Standard errors by bootstrap over blocks of pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct StandardErrors {
    /// Of [`Metrics::trimmed_relmse`].
    pub trimmed_relmse: Option<f64>,
    /// Of [`Metrics::relmse_off_emitters`].
    pub relmse_off_emitters: Option<f64>,
    /// Of [`Metrics::mean_ratio`], per channel.
    pub mean_ratio: [f64; 3],
    /// Of [`Metrics::block9_rms`].
    pub block9_rms: f64,
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
    let relative = |kept: &[bool]| terms.mean(kept, |i| terms.relative(i)).ok_or(MetricsError::Empty);
    let relative_error = |kept: &[bool]| bootstrap::standard_error(terms.size(), kept, |i| terms.relative(i));
    let mse = terms.mean(&all, |i| terms.squared(i)).ok_or(MetricsError::Empty)?;
    let relmse = relative(&all)?;
    let certain = comparison.b.map(|_| terms.without_least_certain(&all));
    let off_emitters = comparison.emitters.map(|mask| kept(Some(mask)));
    let trimmed_relmse = certain.as_deref().map(relative).transpose()?;
    let blocks = terms.blocks(&all);
    let block_mean = blocks.mean();
    let (n_not_finite, first_not_finite) = not_finite(comparison.image, &all);
    let [flip_ldr, flip_hdr] = flip_means(comparison, &all);
    Ok(Metrics {
        mse,
        rmse: signed_root(mse),
        relmse,
        relmse_se: relative_error(&all),
        trimmed_relmse,
        relmse_off_emitters: off_emitters.as_deref().map(relative).transpose()?,
        mean_ratio: terms.mean_ratio(&all),
        block9_rms: signed_root(block_mean),
        flip_ldr,
        flip_hdr,
        standard_errors: StandardErrors {
            trimmed_relmse: certain.as_deref().map(relative_error),
            relmse_off_emitters: off_emitters.as_deref().map(relative_error),
            mean_ratio: terms.mean_ratio_errors(&all),
            block9_rms: blocks.root_error(),
        },
        below_reference_noise: [mse, relmse, block_mean, trimmed_relmse.unwrap_or(0.0)].iter().any(|&v| v < 0.0),
        n_pixels: all.iter().filter(|&&k| k).count(),
        n_not_finite,
        first_not_finite,
    })
}

/// Means of LDR- and HDR-FLIP over kept pixels; NaN if a kept pixel is not finite.
fn flip_means(comparison: &Comparison, kept: &[bool]) -> [f64; 2] {
    let (image, reference) = flip_pair(comparison);
    if image.pixels().iter().flatten().any(|v| !v.is_finite()) {
        return [f64::NAN; 2];
    }
    [flip::ldr_map, flip::hdr_map].map(|map| {
        let map = map(&image, &reference);
        let values = || map.values().iter().zip(kept).filter(|(_, kept)| **kept).map(|(&v, _)| f64::from(v));
        values().sum::<f64>() / values().count() as f64
    })
}

/// What FLIP compares: the picture and (A+B)/2. Pixels that are left out become those of the reference, so that their neighbours,
/// whose filters reach them, see no difference there.
pub fn flip_pair(comparison: &Comparison) -> (Image, Image) {
    let (a, b) = (comparison.a, comparison.b.unwrap_or(comparison.a));
    let mean = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| 0.5 * (a[c] + b[c]));
    let reference = Image::from_pixels(a.width(), a.height(), a.pixels().iter().zip(b.pixels()).map(mean).collect());
    let mut image = comparison.image.clone();
    if let Some(mask) = comparison.left_out {
        let left_out = mask.values().iter().zip(reference.pixels()).zip(image.pixels_mut());
        left_out.filter(|((left_out, _), _)| **left_out).for_each(|((_, reference), pixel)| *pixel = *reference);
    }
    (image, reference)
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

#[cfg(test)]
mod tests;
