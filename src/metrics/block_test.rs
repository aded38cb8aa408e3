//! A test that tells whether a method is unbiased: Welch's t-test on means of 4x4-pixel blocks [Welch47].
//!
//! Pictures of the same scene with different seeds (replicas) are averaged over blocks, which makes their noise nearly normal and sixteen
//! times smaller than that of a pixel, and compared with the reference. Errors are weighed by the spread of the replicas and by the
//! variance that the reference brings; its pixels are independent, since its filter is a box. The level is Šidák's for all blocks and
//! channels together [Sidak67].

use super::MetricsError;
use crate::film::Image;

/// Side of a block in pixels. What is left at the right and lower border makes smaller blocks.
pub const BLOCK: usize = 4;

/// No standard error of a block's mean is taken to be smaller [W/(m² sr)], so that rounding to f32 and dark blocks do not decide.
pub const FLOOR: f64 = 1e-4;

/// Probability that an unbiased method has any block below the level.
pub const SIGNIFICANCE: f64 = 0.01;

/// Share of the blocks that must pass in all channels: a block that a rare bright path lights is far from normal.
pub const MUST_PASS: f64 = 0.9975;

/// Terms of the continued fraction at most; it takes some sqrt(a + b).
const MOST_TERMS: u32 = 100_000;

/// Fewest replicas that give a spread worth a test.
pub const FEWEST_REPLICAS: usize = 16;

/// What the replicas are compared with.
#[derive(Debug, Clone, Copy)]
pub struct Reference<'a> {
    /// Two independent unbiased halves.
    pub halves: [&'a Image; 2],
    /// Variance of the pixels of their mean.
    pub variance: &'a Image,
    /// Independent passes of both halves together, from whose spread the variance was taken; at least 2.
    pub passes: u32,
}

/// What the test found.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockTest {
    /// Blocks in a row.
    pub across: usize,
    /// Two-sided p-values per block, row by row, and channel.
    pub p_values: Vec<[f64; 3]>,
    /// Replicas' mean less the reference's, over the standard error of that difference.
    pub t_values: Vec<[f64; 3]>,
    /// p-values below this fail.
    pub level: f64,
}

impl BlockTest {
    /// Share of the blocks that pass in all channels.
    pub fn share_passing(&self) -> f64 {
        let passing = self.p_values.iter().filter(|p| p.iter().all(|p| *p >= self.level)).count();
        passing as f64 / self.p_values.len() as f64
    }

    /// True if enough blocks pass.
    pub fn passes(&self) -> bool {
        self.share_passing() >= MUST_PASS
    }

    /// Column and row of the first pixel of each block that fails, and its t-values.
    pub fn failing(&self) -> impl Iterator<Item = ((usize, usize), [f64; 3])> {
        let place = |i: usize| (i % self.across * BLOCK, i / self.across * BLOCK);
        let failed = |i: &usize| self.p_values[*i].iter().any(|p| *p < self.level);
        (0..self.p_values.len()).filter(failed).map(move |i| (place(i), self.t_values[i]))
    }
}

/// Compares the mean of `replicas`, pictures that differ in their seeds alone, with a reference.
///
/// # Errors
/// [`MetricsError`] if the sizes differ, a reference is not finite, there are fewer than [`FEWEST_REPLICAS`] or no pixels.
pub fn block_test(replicas: &[Image], reference: &Reference<'_>) -> Result<BlockTest, MetricsError> {
    let [a, b] = reference.halves;
    let size = (a.width(), a.height());
    let all = [("reference B", b), ("the variance", reference.variance)].into_iter();
    for (what, image) in all.chain(replicas.iter().map(|image| ("a replica", image))) {
        let found = (image.width(), image.height());
        if found != size {
            return Err(MetricsError::Size { what, found, expected: size });
        }
    }
    for (what, image) in [("reference A", a), ("reference B", b), ("the variance", reference.variance)] {
        if let Some(i) = image.pixels().iter().position(|p| p.iter().any(|v| !v.is_finite())) {
            return Err(MetricsError::NotFinite { what, x: i % size.0, y: i / size.0 });
        }
    }
    if replicas.len() < FEWEST_REPLICAS || size.0 * size.1 == 0 {
        return Err(MetricsError::Empty);
    }
    let across = size.0.div_ceil(BLOCK);
    let n_blocks = across * size.1.div_ceil(BLOCK);
    let level = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / (3 * n_blocks) as f64);
    let (mut p_values, mut t_values) = (vec![[0.0; 3]; n_blocks], vec![[0.0; 3]; n_blocks]);
    for block in 0..n_blocks {
        let pixels = pixels_of(block, across, size);
        for c in 0..3 {
            let (t, freedom) = welch(replicas, reference, &pixels, c);
            t_values[block][c] = t;
            p_values[block][c] = two_sided(t, freedom);
        }
    }
    Ok(BlockTest { across, p_values, t_values, level })
}

/// Indices of the pixels of a block.
fn pixels_of(block: usize, across: usize, (width, height): (usize, usize)) -> Vec<usize> {
    let (x, y) = (block % across * BLOCK, block / across * BLOCK);
    (y..(y + BLOCK).min(height)).flat_map(|v| (x..(x + BLOCK).min(width)).map(move |u| v * width + u)).collect()
}

/// Difference over its standard error, and the degrees of freedom of that error by Welch and Satterthwaite: each pixel of the reference
/// has a variance of its own, with one degree of freedom less than there were passes.
fn welch(replicas: &[Image], reference: &Reference<'_>, pixels: &[usize], c: usize) -> (f64, f64) {
    let (n, area) = (replicas.len() as f64, pixels.len() as f64);
    let mean_of = |image: &Image| pixels.iter().map(|&i| f64::from(image.pixels()[i][c])).sum::<f64>() / area;
    let means: Vec<f64> = replicas.iter().map(mean_of).collect();
    let mean = means.iter().sum::<f64>() / n;
    let own = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0) / n;
    let [a, b] = reference.halves.map(mean_of);
    let (mut others, mut squares) = (0.0, 0.0);
    for &i in pixels {
        let v = f64::from(reference.variance.pixels()[i][c]) / (area * area);
        others += v;
        squares += v * v / f64::from(reference.passes.max(2) - 1);
    }
    let variance = own + others;
    let freedom = variance * variance / (own * own / (n - 1.0) + squares);
    let t = (mean - 0.5 * (a + b)) / variance.sqrt().max(FLOOR);
    // Two black blocks have no variance at all; the floor alone decides, as of a normal distribution.
    (t, if freedom.is_finite() { freedom } else { 1e6 })
}

/// Probability that Student's t with `freedom` degrees of freedom is at least as far from 0 as `t`: I_x(freedom/2, 1/2) with
/// x = freedom/(freedom + t²) [NIST-DLMF, 8.17]. A t that is not a number has probability 0.
pub fn two_sided(t: f64, freedom: f64) -> f64 {
    if t.is_finite() { incomplete_beta(0.5 * freedom, 0.5, freedom / (freedom + t * t)) } else { 0.0 }
}

/// Regularised incomplete beta function I_x(a, b) by its continued fraction [NIST-DLMF, 8.17.22], evaluated by Lentz's method.
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return x.clamp(0.0, 1.0);
    }
    // The fraction converges fast below the mean; above it the complement does.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(b, a, 1.0 - x);
    }
    let scale = (a * x.ln() + b * (-x).ln_1p() + libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b)).exp() / a;
    // Lentz's method divides by these.
    let away = |v: f64| if v.abs() < 1e-300 { 1e-300 } else { v };
    let (mut c, mut d, mut fraction) = (1.0, 0.0, 1.0);
    for k in 1..MOST_TERMS {
        let m = f64::from(k / 2);
        let term = if k % 2 == 0 {
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        } else {
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        };
        d = 1.0 / away(1.0 + term * d);
        c = away(1.0 + term / c);
        fraction *= c * d;
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    scale / fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Sampler, SamplerKind};
    use std::f64::consts::PI;

    const SIDE: usize = 64;

    /// Pictures of 64x64 pixels: 0.5 plus `bias`, with independent normal noise of standard deviation `noise` a pixel.
    fn pictures(count: u64, seed: u64, bias: f64, noise: f64) -> Vec<Image> {
        let one = |k: u64| {
            let mut sampler = Sampler::of(SamplerKind::Independent, seed, k, 0);
            let mut normal = || {
                // Box and Muller.
                let u = sampler.next_2d().as_dvec2();
                (-2.0 * (1.0 - u.x).ln()).sqrt() * (2.0 * PI * u.y).cos()
            };
            let pixels = (0..SIDE * SIDE).map(|_| [0; 3].map(|_| (0.5 + bias + noise * normal()) as f32)).collect();
            Image::from_pixels(SIDE, SIDE, pixels)
        };
        (0..count).map(one).collect()
    }

    /// The test of replicas with noise 0.2 and a bias against halves with noise 0.05.
    fn tested(seed: u64, bias: f64) -> BlockTest {
        let halves = pictures(2, seed + 1000, 0.0, 0.05);
        // The mean of two has half the variance of one.
        let variance = Image::from_pixels(SIDE, SIDE, vec![[0.5 * 0.05 * 0.05; 3]; SIDE * SIDE]);
        let reference = Reference { halves: [&halves[0], &halves[1]], variance: &variance, passes: 1000 };
        block_test(&pictures(16, seed, bias, 0.2), &reference).expect("sizes agree")
    }

    #[test]
    fn students_distribution_has_its_closed_forms() {
        for t in [0.01_f64, 0.5, 1.0, 2.0, 5.0, 40.0] {
            for (freedom, want) in [(1.0, 1.0 - 2.0 / PI * t.atan()), (2.0, 1.0 - t / (2.0 + t * t).sqrt())] {
                let got = two_sided(t, freedom);
                assert!((got - want).abs() < 1e-12, "t {t}, {freedom} degrees: {got}, expected {want}");
            }
            // Four degrees: with s = t/sqrt(4+t²), 1 - s (3 - s²)/2.
            let s = t / (4.0 + t * t).sqrt();
            let (got, want) = (two_sided(-t, 4.0), 1.0 - 0.5 * s * (3.0 - s * s));
            assert!((got - want).abs() < 1e-12, "t -{t}, 4 degrees: {got}, expected {want}");
        }
        // Very many degrees: the normal distribution, erfc(t/sqrt 2).
        let (got, want) = (two_sided(3.0, 1e7), libm::erfc(3.0 / 2.0_f64.sqrt()));
        assert!((got / want - 1.0).abs() < 1e-5, "{got}, expected {want}");
    }

    #[test]
    fn noise_without_bias_fails_as_often_as_the_level_says() {
        let (mut p, mut failing): (Vec<f64>, usize) = (Vec::new(), 0);
        for seed in 0..4 {
            let test = tested(seed, 0.0);
            failing += test.failing().count();
            p.extend(test.p_values.iter().flatten().copied());
        }
        // Four tests at 0.01: 0.04 failing blocks are expected, more than two of 1024 once in 100,000 times.
        assert!(failing <= 2, "{failing} of 1024 blocks fail without any bias");
        // 3072 independent p-values, uniform: 4 standard deviations of a share q are 4 sqrt(q(1-q)/3072).
        let n = p.len() as f64;
        for q in [0.05, 0.5, 0.9] {
            let share = p.iter().filter(|p| **p < q).count() as f64 / n;
            let tolerance = 4.0 * (q * (1.0 - q) / n).sqrt();
            assert!((share - q).abs() < tolerance, "{share} of the p-values lie below {q}, within {tolerance}");
        }
    }

    #[test]
    fn a_bias_of_five_standard_errors_fails() {
        // A block's standard error: sqrt(0.2²/16/16 + 0.05²/2/16) = 0.0153, with some 33 degrees of freedom. The level of 768 tests,
        // 1.3e-5, lies at |t| of about 5.1, so that half of the channels fail at 5 and nearly all at 10.
        let half = tested(9, 5.0 * 0.0153);
        assert!(!half.passes(), "{} pass with a bias of 5 standard errors", half.share_passing());
        let most = tested(9, -10.0 * 0.0153);
        assert!(most.share_passing() < 0.3, "{} pass with a bias of -10 standard errors", most.share_passing());
        assert!(most.failing().all(|(_, t)| t.iter().any(|t| *t < 0.0)), "the sign of the bias is that of t");
    }

    #[test]
    fn dark_blocks_are_judged_by_the_floor() {
        let flat = |value: f32| Image::from_pixels(8, 8, vec![[value; 3]; 64]);
        let (black, variance) = (flat(0.0), flat(0.0));
        let reference = Reference { halves: [&black, &black], variance: &variance, passes: 2 };
        let p = |value: f32| block_test(&vec![flat(value); 16], &reference).expect("sizes agree").p_values[0][0];
        assert_eq!(p(0.0), 1.0);
        // One floor away: as likely as a normal variate beyond 1.
        assert!((p(1e-4) - libm::erfc(0.5_f64.sqrt())).abs() < 1e-5, "{}", p(1e-4));
        assert!(p(1e-3) < 1e-15);
    }

    #[test]
    fn what_cannot_be_tested_is_refused() {
        let flat = |n: usize| Image::from_pixels(n, n, vec![[0.0; 3]; n * n]);
        let (small, large) = (flat(4), flat(8));
        let reference = Reference { halves: [&small, &small], variance: &small, passes: 2 };
        assert!(matches!(block_test(&vec![large; 16], &reference), Err(MetricsError::Size { .. })));
        assert_eq!(block_test(&vec![small.clone(); 15], &reference), Err(MetricsError::Empty));
    }
}
