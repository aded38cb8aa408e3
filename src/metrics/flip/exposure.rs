//! The exposures of HDR-FLIP and the curve through which it shows pictures.

use super::colour::luminance;
use crate::film::Image;

/// Coefficients of Narkowicz's fit to the ACES curve, (a x² + b x) / (c x² + d x + e), the exposure of 0.6 that came with it folded
/// in.
const ACES: [f32; 5] = [0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];

/// The value on the screen that the brightest pixel has at the first exposure and the median pixel at the last (HDR-FLIP 2021,
/// section 4).
const SHOWN_AT_ENDS: f64 = 0.85;

/// Linear radiance to linear values on the screen, 0 to 1.
pub(super) fn aces(linear: [f32; 3]) -> [f32; 3] {
    let [a, b, c, d, e] = ACES;
    linear.map(|x| ((a * x * x + b * x) / (c * x * x + d * x + e)).clamp(0.0, 1.0))
}

/// The exposures at which HDR-FLIP looks at a picture [stops].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposures {
    /// The first: the brightest pixel is just not washed out.
    pub start: f64,
    /// The last: half the picture is nearly white.
    pub stop: f64,
    /// How many, equally spaced and with both ends: about one a stop.
    pub number: usize,
}

impl Exposures {
    /// The exposures that a reference asks for. Black pixels do not decide where the median is black: then it is that of the others.
    /// A picture without light is looked at as it is.
    pub fn of(reference: &Image) -> Self {
        let mut luminances: Vec<f32> = reference.pixels().iter().map(|&p| luminance(p.map(|v| v.max(0.0)))).collect();
        luminances.sort_unstable_by(f32::total_cmp);
        let (Some(&brightest), Some(&median)) = (luminances.last(), luminances.get(luminances.len() / 2)) else {
            return Self { start: 0.0, stop: 0.0, number: 1 };
        };
        let median = if median > 0.0 {
            median
        } else {
            luminances.drain(..luminances.partition_point(|&l| l <= 0.0));
            luminances.get(luminances.len() / 2).copied().unwrap_or(0.0)
        };
        if median <= 0.0 || !brightest.is_finite() {
            return Self { start: 0.0, stop: 0.0, number: 1 };
        }
        let at = |luminance: f32| (radiance_shown_as(SHOWN_AT_ENDS) / f64::from(luminance)).log2();
        let (start, stop) = (at(brightest), at(median));
        Self { start, stop, number: ((stop - start).ceil() as usize).max(2) }
    }

    /// All of them in order [stops].
    pub(super) fn all(self) -> impl Iterator<Item = f32> {
        let step = if self.number > 1 { (self.stop - self.start) / (self.number - 1) as f64 } else { 0.0 };
        (0..self.number).map(move |i| (self.start + i as f64 * step) as f32)
    }
}

/// The radiance that the ACES curve shows as `value`: the positive root of (a − v c) x² + (b − v d) x − v e = 0.
fn radiance_shown_as(value: f64) -> f64 {
    let [a, b, c, d, e] = ACES.map(f64::from);
    let (quadratic, half_linear, constant) = (a - value * c, 0.5 * (b - value * d), -value * e);
    (-half_linear + (half_linear * half_linear - quadratic * constant).sqrt()) / quadratic
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_and_its_inverse_agree() {
        for value in [0.1, 0.5, SHOWN_AT_ENDS, 0.99] {
            let shown = aces([radiance_shown_as(value) as f32; 3])[0];
            assert!((f64::from(shown) - value).abs() < 1e-6, "{value}: {shown}");
        }
    }

    #[test]
    fn black_pixels_do_not_make_exposures_infinite() {
        let black = Image::new(3, 2);
        assert_eq!(Exposures::of(&black), Exposures { start: 0.0, stop: 0.0, number: 1 });
        let mostly = Image::from_pixels(3, 2, vec![[0.0; 3], [0.0; 3], [0.0; 3], [0.0; 3], [1.0; 3], [4.0; 3]]);
        let got = Exposures::of(&mostly);
        // Of 1 and 4 the upper one is the median: both ends are the same, which is two exposures at least.
        assert_eq!((got.start, got.number), (got.stop, 2));
    }
}
