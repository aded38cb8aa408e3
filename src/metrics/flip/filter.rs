//! Separable filters on planes of f32, borders continued by their last pixel.

use rayon::prelude::*;
use std::f64::consts::PI;

/// Scale parameters of the contrast sensitivity functions' Gaussians [degrees²] and the weights of the two of blue and yellow
/// (FLIP 2020, table 1).
const ACHROMATIC: f64 = 0.0047;
const RED_GREEN: f64 = 0.0053;
const BLUE_YELLOW: [(f64, f64); 2] = [(34.1, 0.04), (13.5, 0.025)];

/// Width of the Gaussian that detects features [degrees]: its standard deviation is half of it (FLIP 2020, section 4.2, w).
const FEATURE_WIDTH: f64 = 0.082;

/// Filters end at this many standard deviations of the widest of their kind.
const ENDS_AT: f64 = 3.0;

/// A weight this small beside the largest changes no f32.
const NEGLIGIBLE: f64 = 1e-9;

/// Weights at whole pixels from −radius to radius.
pub(super) struct Kernel {
    weights: Vec<f32>,
}

impl Kernel {
    /// Of f64 weights, without negligible ends.
    fn new(weights: &[f64]) -> Self {
        let largest = weights.iter().fold(0.0, |a: f64, w| a.max(w.abs()));
        let kept = |w: &f64| w.abs() > NEGLIGIBLE * largest;
        let ends = weights.iter().position(kept).unwrap_or(0).min(weights.iter().rev().position(kept).unwrap_or(0));
        Self { weights: weights[ends..weights.len() - ends].iter().map(|&w| w as f32).collect() }
    }

    fn radius(&self) -> usize {
        self.weights.len() / 2
    }
}

/// Filters of what an eye resolves: achromatic, red-green, and the two whose sum is blue-yellow; to be applied along both axes. A
/// function exp(−π² r²/b) per channel, r in degrees (FLIP 2020, equation 5), scaled so that a constant stays. For blue and yellow a
/// sum a₁ √(π/b₁) exp(−π² r²/b₁) + a₂ √(π/b₂) exp(−π² r²/b₂): each term is the product of two equal factors.
pub(super) fn contrast_sensitivity(pixels_per_degree: f64) -> [Kernel; 4] {
    let deviation = (BLUE_YELLOW[0].1 / (2.0 * PI * PI)).sqrt();
    let radius = (ENDS_AT * deviation * pixels_per_degree).ceil() as i32;
    let gaussian = |b: f64| move |i: i32| (-(PI * f64::from(i) / pixels_per_degree).powi(2) / b).exp();
    let sampled = |factor: f64, b: f64| -> Vec<f64> { (-radius..=radius).map(|i| factor * gaussian(b)(i)).collect() };
    let sum = |weights: &[f64]| weights.iter().sum::<f64>();
    let over = |weights: &[f64], total: f64| Kernel::new(&weights.iter().map(|w| w / total).collect::<Vec<f64>>());
    let unit = |b: f64| {
        let weights = sampled(1.0, b);
        over(&weights, sum(&weights))
    };
    let yellow = BLUE_YELLOW.map(|(a, b)| sampled((a * (PI / b).sqrt()).sqrt(), b));
    let total = yellow.iter().map(|w| sum(w).powi(2)).sum::<f64>().sqrt();
    [unit(ACHROMATIC), unit(RED_GREEN), over(&yellow[0], total), over(&yellow[1], total)]
}

/// A Gaussian, its first and its second derivative. Weights of the Gaussian sum to 1; the positive weights of a derivative to 1 and
/// the negative ones to −1 (FLIP 2020, section 4.2).
pub(super) fn feature_detectors(pixels_per_degree: f64) -> [Kernel; 3] {
    let deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree;
    let radius = (ENDS_AT * deviation).ceil() as i32;
    let sampled = |factor: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let at = |i: i32| f64::from(i) / deviation;
        (-radius..=radius).map(|i| factor(at(i)) * (-0.5 * at(i) * at(i)).exp()).collect()
    };
    let balanced = |weights: Vec<f64>| {
        let positive = weights.iter().filter(|w| **w > 0.0).sum::<f64>();
        let negative = -weights.iter().filter(|w| **w < 0.0).sum::<f64>();
        Kernel::new(
            &weights
                .iter()
                .map(|&w| if w > 0.0 { w / positive } else { w / negative.max(f64::MIN_POSITIVE) })
                .collect::<Vec<f64>>(),
        )
    };
    [balanced(sampled(&|_| 1.0)), balanced(sampled(&|x| -x)), balanced(sampled(&|x| x * x - 1.0))]
}

/// A plane filtered by `across` along its rows and `down` along its columns.
pub(super) fn separable(plane: &[f32], size: (usize, usize), across: &Kernel, down: &Kernel) -> Vec<f32> {
    along_columns(&along_rows(plane, size, across), size, down)
}

/// Two filters that belong together: one along the direction asked about, one along the other.
#[derive(Clone, Copy)]
pub(super) struct Taps<'a> {
    /// Along the direction.
    pub along: &'a Kernel,
    /// Across it.
    pub other: &'a Kernel,
}

/// The answer of a detector along rows and along columns.
pub(super) fn gradient(plane: &[f32], size: (usize, usize), taps: Taps) -> [Vec<f32>; 2] {
    [separable(plane, size, taps.along, taps.other), separable(plane, size, taps.other, taps.along)]
}

fn along_rows(plane: &[f32], (width, _): (usize, usize), kernel: &Kernel) -> Vec<f32> {
    let radius = kernel.radius();
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each_init(
        || vec![0.0; width + 2 * radius],
        |continued, (out, row)| {
            continued[..radius].fill(row[0]);
            continued[radius..radius + width].copy_from_slice(row);
            continued[radius + width..].fill(row[width - 1]);
            for (k, &weight) in kernel.weights.iter().enumerate() {
                add_scaled(out, &continued[k..k + width], weight);
            }
        },
    );
    out
}

fn along_columns(plane: &[f32], (width, height): (usize, usize), kernel: &Kernel) -> Vec<f32> {
    let radius = kernel.radius();
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (k, &weight) in kernel.weights.iter().enumerate() {
            let row = (y + k).saturating_sub(radius).min(height - 1);
            add_scaled(out, &plane[row * width..(row + 1) * width], weight);
        }
    });
    out
}

/// out += weight · values. One weight for a whole row: the compiler turns it into vector instructions.
fn add_scaled(out: &mut [f32], values: &[f32], weight: f32) {
    out.iter_mut().zip(values).for_each(|(o, v)| *o += weight * v);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_constant_stays_and_has_no_features() {
        let size = (9, 7);
        let plane = vec![0.3_f32; 63];
        let [achromatic, _, wide, narrow] = contrast_sensitivity(67.0);
        let blurred = separable(&plane, size, &achromatic, &achromatic);
        let sum = [&wide, &narrow].map(|k| separable(&plane, size, k, k));
        let [gaussian, first, second] = feature_detectors(67.0);
        for kernel in [&first, &second] {
            let [x, y] = gradient(&plane, size, Taps { along: kernel, other: &gaussian });
            assert!(x.iter().chain(&y).all(|v| v.abs() < 1e-6));
        }
        assert!(blurred.iter().all(|v| (v - 0.3).abs() < 1e-6));
        assert!((0..63).all(|i| (sum[0][i] + sum[1][i] - 0.3).abs() < 1e-6));
    }

    /// An ideal step from 0 to 1: the first derivative's positive half sums to 1, so the pixel beside the step answers with about
    /// 1 (less its own weight, which is 0 at the middle).
    #[test]
    fn a_step_is_an_edge() {
        let plane: Vec<f32> = (0..40 * 5).map(|i| if i % 40 < 20 { 0.0 } else { 1.0 }).collect();
        let [gaussian, first, _] = feature_detectors(67.0);
        let [x, y] = gradient(&plane, (40, 5), Taps { along: &first, other: &gaussian });
        assert!((x[2 * 40 + 20].abs() - 1.0).abs() < 1e-5, "{}", x[2 * 40 + 20]);
        assert!(y.iter().all(|v| v.abs() < 1e-6));
    }
}
