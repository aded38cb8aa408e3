//! Mean over a small window around each pixel.

/// Half the side of the window, without its middle: 5x5 pixels.
const RADIUS: usize = 2;

/// Mean over the 5x5 pixels around each pixel, per channel; at the border over those that exist.
pub(super) fn window_means(values: &[[f64; 3]], width: usize, height: usize) -> Vec<[f64; 3]> {
    // The count of existing pixels is a product of the two axes, so rows and columns can be averaged one after the other.
    let rows: Vec<[f64; 3]> =
        (0..values.len()).map(|i| mean(neighbours(i % width, width).map(|x| values[i - i % width + x]))).collect();
    (0..values.len()).map(|i| mean(neighbours(i / width, height).map(|y| rows[y * width + i % width]))).collect()
}

fn neighbours(at: usize, n: usize) -> std::ops::Range<usize> {
    at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(n)
}

fn mean(values: impl ExactSizeIterator<Item = [f64; 3]>) -> [f64; 3] {
    let n = values.len() as f64;
    let mut sum = [0.0; 3];
    values.for_each(|v| (0..3).for_each(|c| sum[c] += v[c]));
    sum.map(|s| s / n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_is_cut_at_the_border() {
        // One bright pixel in the corner of 4x3: seen by the 3x3 pixels around it, each window cut to what exists.
        let mut values = vec![[0.0; 3]; 12];
        values[0] = [36.0, 0.0, 0.0];
        let means: Vec<f64> = window_means(&values, 4, 3).iter().map(|v| v[0]).collect();
        // Columns seen: 3, 4, 4, 3; rows seen: 3, 3, 3. The fourth column does not see column 0.
        let want = [4.0, 3.0, 3.0, 0.0, 4.0, 3.0, 3.0, 0.0, 4.0, 3.0, 3.0, 0.0];
        assert!(means.iter().zip(want).all(|(m, w)| (m - w).abs() < 1e-12), "{means:?}");
    }
}
