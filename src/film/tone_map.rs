//! From linear radiance to the bytes of a screen.
//!
//! `x = 2^exposure * L` first, then per channel one of
//!
//! - soft: `y = x` up to 1/2, `y = 1 - 1/(4x)` above: the straight line goes over, with the same slope, into a shoulder that
//!   reaches 1 only at infinity, so that lamps and their surroundings keep their shape;
//! - srgb: `y = min(x, 1)`;
//!
//! then the transfer curve of sRGB (IEC 61966-2-1), 255 levels, rounded to the nearest.
//! Negative values become 0. NaN is not hidden: it shows as [`NAN_COLOUR`].

/// What a pixel with a NaN shows: magenta.
pub const NAN_COLOUR: [u8; 3] = [255, 0, 255];

/// How values above the screen's white are treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Operator {
    /// Rolled off: `1 - 1/(4x)` above 1/2.
    #[default]
    Soft,
    /// Cut off at 1.
    Srgb,
}

/// Settings of the tone map.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ToneMap {
    /// Exposure in stops: +1 doubles.
    pub exposure: f64,
    /// What happens to highlights.
    pub operator: Operator,
}

impl ToneMap {
    /// The byte triple that shows a pixel.
    pub fn bytes(&self, pixel: [f32; 3]) -> [u8; 3] {
        if pixel.iter().any(|v| v.is_nan()) {
            return NAN_COLOUR;
        }
        pixel.map(|v| (255.0 * self.display(v.into())).round() as u8)
    }

    /// Display value in [0, 1] of a linear value.
    pub fn display(&self, value: f64) -> f64 {
        let x = (value * self.exposure.exp2()).max(0.0);
        let y = match self.operator {
            Operator::Srgb => x.min(1.0),
            Operator::Soft if x <= 0.5 => x,
            Operator::Soft => 1.0 - 0.25 / x,
        };
        srgb_encode(y)
    }
}

/// The transfer curve of sRGB: linear [0, 1] to encoded [0, 1] (IEC 61966-2-1).
pub fn srgb_encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SRGB: ToneMap = ToneMap { exposure: 0.0, operator: Operator::Srgb };
    const SOFT: ToneMap = ToneMap { exposure: 0.0, operator: Operator::Soft };

    #[test]
    fn srgb_gives_the_values_of_the_standard() {
        // By hand from the standard's formula: 255 * (1.055 * 0.18^(1/2.4) - 0.055), and the same for 0.5.
        for (linear, level) in [(0.18, 117.646), (0.5, 187.516), (0.0, 0.0), (1.0, 255.0), (0.002, 255.0 * 0.02584)] {
            let got = 255.0 * SRGB.display(linear);
            assert!((got - level).abs() < 5e-4, "{linear}: {got}, expected {level}");
        }
    }

    #[test]
    fn the_shoulder_continues_the_line() {
        let step = 1e-6;
        let curve = |x: f64| SOFT.display(x);
        let below = (srgb_encode(0.5) - srgb_encode(0.5 - step)) / step;
        let above = (curve(0.5 + step) - curve(0.5)) / step;
        assert!((below - above).abs() < 1e-4, "slopes {below} and {above}");
        assert_eq!(SOFT.display(0.3), SRGB.display(0.3));
        assert_eq!(SOFT.display(1.0), srgb_encode(0.75));
    }

    #[test]
    fn brighter_is_never_shown_darker() {
        let shown: Vec<f64> = (0..1000).map(|i| SOFT.display(f64::from(i) * 0.02)).collect();
        assert!(shown.windows(2).all(|w| w[0] < w[1] && w[1] <= 1.0));
    }

    #[test]
    fn a_stop_doubles() {
        let up = ToneMap { exposure: 1.0, ..SRGB };
        assert_eq!(up.display(0.2), SRGB.display(0.4));
    }

    #[test]
    fn unusual_values_are_shown_and_not_hidden() {
        assert_eq!(SOFT.bytes([0.0, f32::NAN, 0.0]), NAN_COLOUR);
        assert_eq!(SOFT.bytes([f32::INFINITY, -1.0, 0.0]), [255, 0, 0]);
    }
}
