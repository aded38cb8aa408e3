//! A picture of where the error is.

use super::{Comparison, MetricsError, Terms, check};

/// Relative error at which the scale begins (black) and ends (white); logarithmic between.
const RANGE: (f64, f64) = (1e-3, 1.0);

/// Colours of the scale at equal steps, dark to light: black, violet, red, orange, yellow, white.
const SCALE: [[f64; 3]; 6] =
    [[0.0, 0.0, 0.0], [70.0, 10.0, 110.0], [190.0, 40.0, 60.0], [245.0, 130.0, 20.0], [250.0, 220.0, 60.0], [255.0; 3]];

/// Colour of a pixel that is left out.
const LEFT_OUT: [u8; 3] = [0, 70, 90];

/// Colour of a pixel with a NaN or an infinity.
const NOT_FINITE: [u8; 3] = [0, 255, 255];

/// Three bytes a pixel: the root of the channels' mean of |(I−A)(I−B)|/(S²+0.01), from 0.001 (black) to 1 (white) over violet,
/// red, orange and yellow, a third of the scale a decade. Pixels left out are teal, NaN is cyan.
///
/// # Errors
/// [`MetricsError`] as in [`super::compare`].
pub fn error_picture(comparison: &Comparison) -> Result<Vec<u8>, MetricsError> {
    check(comparison)?;
    let terms = Terms::new(comparison);
    let colour = |i: usize| {
        if comparison.left_out.is_some_and(|m| m.values()[i]) {
            return LEFT_OUT;
        }
        let error = (terms.relative(i).iter().map(|v| v.abs()).sum::<f64>() / 3.0).sqrt();
        if error.is_finite() { scale_colour(error) } else { NOT_FINITE }
    };
    Ok((0..terms.len()).flat_map(colour).collect())
}

fn scale_colour(error: f64) -> [u8; 3] {
    let (low, high) = RANGE;
    let position = ((error.max(low) / low).ln() / (high / low).ln()).min(1.0) * (SCALE.len() - 1) as f64;
    let below = (position as usize).min(SCALE.len() - 2);
    let t = position - below as f64;
    std::array::from_fn(|c| (SCALE[below][c] * (1.0 - t) + SCALE[below + 1][c] * t).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{Image, Mask};

    #[test]
    fn the_scale_runs_from_black_to_white() {
        assert_eq!(scale_colour(0.0), [0; 3]);
        assert_eq!(scale_colour(1e-3), [0; 3]);
        assert_eq!(scale_colour(1.0), [255; 3]);
        assert_eq!(scale_colour(50.0), [255; 3]);
        // Two fifths of three decades up from 1e-3.
        assert_eq!(scale_colour(10_f64.powf(-3.0 + 1.2)), [190, 40, 60]);
    }

    #[test]
    fn what_does_not_count_is_told_apart() {
        let a = Image::from_pixels(3, 1, vec![[1.0; 3]; 3]);
        let image = Image::from_pixels(3, 1, vec![[1.0; 3], [9.0; 3], [f32::NAN; 3]]);
        let mask = Mask::from_values(3, 1, vec![false, true, false]);
        let comparison = Comparison { image: &image, a: &a, b: None, left_out: Some(&mask), emitters: None };
        assert_eq!(error_picture(&comparison).unwrap(), [[0; 3], LEFT_OUT, NOT_FINITE].concat());
    }
}
