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
    let blocks = block_sums(size, kept, term);
    let mut random = SplitMix(0);
    let means: Vec<f64> = (0..DRAWS).map(|_| resampled_mean(&blocks, &mut random)).collect();
    let mean = means.iter().sum::<f64>() / DRAWS as f64;
    (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (DRAWS - 1) as f64).sqrt()
}

/// Sum and count of a block's values.
#[derive(Clone, Copy, Default)]
struct Block {
    sum: f64,
    count: f64,
}

fn block_sums((width, height): (usize, usize), kept: &[bool], term: impl Fn(usize) -> [f64; 3]) -> Vec<Block> {
    let side = ((width * height / FEWEST_BLOCKS).isqrt()).clamp(1, SIDE);
    let across = width.div_ceil(side);
    let mut blocks = vec![Block::default(); across * height.div_ceil(side)];
    for i in (0..kept.len()).filter(|&i| kept[i]) {
        let block = &mut blocks[i / width / side * across + i % width / side];
        block.sum += term(i).iter().sum::<f64>();
        block.count += 3.0;
    }
    blocks.retain(|b| b.count > 0.0);
    blocks
}

fn resampled_mean(blocks: &[Block], random: &mut SplitMix) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for _ in 0..blocks.len() {
        let block = blocks[random.below(blocks.len())];
        sum += block.sum;
        count += block.count;
    }
    sum / count
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

    #[test]
    fn equal_pixels_have_no_error() {
        assert_eq!(standard_error((40, 40), &[true; 1600], |_| [2.0; 3]), 0.0);
    }
}
