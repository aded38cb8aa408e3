//! Standard error of a mean over pixels whose errors are correlated with their neighbours'.
//!
//! Blocks of pixels are drawn with replacement and the mean taken again, many times; the spread of these means is the standard
//! error (Efron's bootstrap, on blocks). The random numbers are a fixed sequence: the same pictures give the same figure.

/// Side of a block in a picture that has enough pixels: wider than the filters and tiles that tie neighbours together.
const SIDE: usize = 16;

/// Fewest blocks wanted in a small picture; its blocks shrink for that.
const FEWEST_BLOCKS: usize = 64;

/// Number of draws: the standard error itself then has a relative error of 1/sqrt(2 * 400) = 3.5 %.
const DRAWS: usize = 400;

/// Standard error of the mean of `term` over kept pixels and channels.
pub(super) fn standard_error(size: (usize, usize), kept: &[bool], term: impl Fn(usize) -> [f64; 3]) -> f64 {
    of_statistic(size, kept, |i| [term(i).iter().sum::<f64>(), 3.0], |[sum, count]| sum / count)
}

/// Standard error of any figure computed from sums of N values a pixel over kept pixels, such as a ratio of two means.
pub(super) fn of_statistic<const N: usize>(
    size: (usize, usize),
    kept: &[bool],
    values: impl Fn(usize) -> [f64; N],
    statistic: impl Fn([f64; N]) -> f64,
) -> f64 {
    let blocks = block_sums(size, kept, values);
    let mut random = SplitMix(0);
    let draws: Vec<f64> = (0..DRAWS).map(|_| statistic(resampled(&blocks, &mut random))).collect();
    let mean = draws.iter().sum::<f64>() / DRAWS as f64;
    (draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (DRAWS - 1) as f64).sqrt()
}

/// Sums over each block that has a kept pixel.
fn block_sums<const N: usize>(
    (width, height): (usize, usize),
    kept: &[bool],
    values: impl Fn(usize) -> [f64; N],
) -> Vec<[f64; N]> {
    let side = ((width * height / FEWEST_BLOCKS).isqrt()).clamp(1, SIDE);
    let across = width.div_ceil(side);
    let mut blocks = vec![None; across * height.div_ceil(side)];
    for i in (0..kept.len()).filter(|&i| kept[i]) {
        let block = blocks[i / width / side * across + i % width / side].get_or_insert([0.0; N]);
        block.iter_mut().zip(values(i)).for_each(|(sum, v)| *sum += v);
    }
    blocks.into_iter().flatten().collect()
}

/// Sums over as many blocks as there are, drawn with replacement.
fn resampled<const N: usize>(blocks: &[[f64; N]], random: &mut SplitMix) -> [f64; N] {
    let mut sums = [0.0; N];
    for _ in 0..blocks.len() {
        let block = &blocks[random.below(blocks.len())];
        sums.iter_mut().zip(block).for_each(|(sum, v)| *sum += v);
    }
    sums
}

/// The SplitMix64 generator (Steele, Lea, Flood 2014).
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number in 0..n: the high half of a 128-bit product, whose bias of n/2^64 is nothing here.
    fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next()) * n as u128) >> 64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Independent uniform values in [0, 1): their mean over n has a standard error of sqrt(1/12/n).
    #[test]
    fn independent_pixels_give_the_textbook_standard_error() {
        let mut random = SplitMix(7);
        let values: Vec<f64> = (0..128 * 128).map(|_| (random.next() >> 11) as f64 / (1_u64 << 53) as f64).collect();
        let got = standard_error((128, 128), &vec![true; values.len()], |i| [values[i]; 3]);
        let want = (1.0 / 12.0 / values.len() as f64).sqrt();
        // 64 blocks and 400 draws: the estimate's own relative standard error is about 1/sqrt(128) + 3.5 %; three of these.
        assert!((got / want - 1.0).abs() < 0.3, "{got}, expected {want}");
    }

    /// A ratio of two means of independent values: by propagation of errors its relative variance is the sum of theirs.
    #[test]
    fn a_ratio_has_the_error_of_both_its_parts() {
        let mut random = SplitMix(3);
        let mut uniform = || (random.next() >> 11) as f64 / (1_u64 << 53) as f64;
        let values: Vec<[f64; 2]> = (0..128 * 128).map(|_| [4.0 + uniform(), 2.0 + uniform()]).collect();
        let got = of_statistic((128, 128), &vec![true; values.len()], |i| values[i], |[a, b]| a / b);
        let variance = 1.0 / 12.0 / values.len() as f64;
        let want = 4.5 / 2.5 * (variance / 4.5_f64.powi(2) + variance / 2.5_f64.powi(2)).sqrt();
        assert!((got / want - 1.0).abs() < 0.3, "{got}, expected {want}");
    }

    #[test]
    fn equal_pixels_have_no_error() {
        assert_eq!(standard_error((40, 40), &[true; 1600], |_| [2.0; 3]), 0.0);
    }
}
