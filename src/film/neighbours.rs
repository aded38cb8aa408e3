//! Sums and means over the pixels around each one.

use rayon::prelude::*;

/// Rows that one task sums.
const BAND: usize = 32;

/// Sums over the pixels at most `reach` away in each direction, for planes of so many columns and rows.
pub fn sums_around([width, height]: [usize; 2], values: &[f32], reach: usize) -> Vec<f32> {
    if width * height == 0 {
        return Vec::new();
    }
    // Along rows first, over rows with nothing on either side, so that all pixels are alike and several are summed at once.
    let mut across = vec![0.0; width * height];
    across.par_chunks_mut(width * BAND).zip(values.par_chunks(width * BAND)).for_each(|(across, values)| {
        let mut padded = vec![0.0; width + 2 * reach];
        for (sums, row) in across.chunks_mut(width).zip(values.chunks(width)) {
            padded[reach..][..width].copy_from_slice(row);
            (0..=2 * reach).for_each(|k| add(sums, &padded[k..][..width]));
        }
    });
    let mut sums = vec![0.0; width * height];
    sums.par_chunks_mut(width).enumerate().for_each(|(y, sums)| {
        let near = within(y, height, reach);
        across[near.start * width..near.end * width].chunks(width).for_each(|row| add(sums, row));
    });
    sums
}

/// Means over the pixels at most `reach` away in each direction.
pub fn means_around([width, height]: [usize; 2], values: &[f32], reach: usize) -> Vec<f32> {
    let mut means = sums_around([width, height], values, reach);
    let share = |i: usize, n: usize| 1.0 / within(i, n, reach).len() as f32;
    let shares: Vec<f32> = (0..width).map(|x| share(x, width)).collect();
    for (y, row) in means.chunks_mut(width.max(1)).enumerate() {
        let of_rows = share(y, height);
        row.iter_mut().zip(&shares).for_each(|(mean, share)| *mean *= share * of_rows);
    }
    means
}

/// Of `n` rows or columns those at most `reach` away from the `i`-th.
fn within(i: usize, n: usize, reach: usize) -> std::ops::Range<usize> {
    i.saturating_sub(reach)..(i + reach + 1).min(n)
}

fn add(sums: &mut [f32], values: &[f32]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against sums pixel by pixel, in pictures narrower and lower than what is summed over, too.
    #[test]
    fn all_pixels_within_reach_count_once() {
        for (size, reach) in [([7, 40], 1), ([40, 7], 2), ([3, 2], 4), ([1, 1], 1), ([0, 5], 2)] {
            let [w, h] = size;
            let values: Vec<f32> = (0..w * h).map(|i| (i * i % 17) as f32).collect();
            let (sums, means) = (sums_around(size, &values, reach), means_around(size, &values, reach));
            for i in 0..w * h {
                let near: Vec<f32> = (0..w * h)
                    .filter(|j| (i % w).abs_diff(j % w) <= reach && (i / w).abs_diff(j / w) <= reach)
                    .map(|j| values[j])
                    .collect();
                let sum: f32 = near.iter().sum();
                assert_eq!(sums[i], sum, "{size:?}, {reach}, pixel {i}");
                assert!((means[i] - sum / near.len() as f32).abs() <= 1e-5 * sum, "{size:?}, {reach}, pixel {i}");
            }
        }
    }
}
