//! A triple of linear sRGB values in f64: radiance, radiosity, reflectance, power.

use serde::{Deserialize, Serialize};
use std::ops::{Add, AddAssign, Div, Index, Mul, MulAssign, Sub};

/// Linear sRGB triple. Its unit is that of the quantity it holds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Rgb {
    /// Red.
    pub r: f64,
    /// Green.
    pub g: f64,
    /// Blue.
    pub b: f64,
}

impl Rgb {
    /// Zero in all channels.
    pub const BLACK: Rgb = Rgb::grey(0.0);
    /// One in all channels.
    pub const WHITE: Rgb = Rgb::grey(1.0);

    /// A triple of three values.
    #[inline]
    pub const fn new(r: f64, g: f64, b: f64) -> Self {
        Self { r, g, b }
    }

    /// The same value in all channels.
    #[inline]
    pub const fn grey(value: f64) -> Self {
        Self { r: value, g: value, b: value }
    }

    /// Luminance Y of linear sRGB (IEC 61966-2-1 primaries).
    #[inline]
    pub fn luminance(self) -> f64 {
        0.2126 * self.r + 0.7152 * self.g + 0.0722 * self.b
    }

    /// Largest channel.
    #[inline]
    pub fn max(self) -> f64 {
        self.r.max(self.g).max(self.b)
    }

    /// Smallest channel.
    #[inline]
    pub fn min(self) -> f64 {
        self.r.min(self.g).min(self.b)
    }

    /// Mean of the channels.
    #[inline]
    pub fn mean(self) -> f64 {
        (self.r + self.g + self.b) / 3.0
    }

    /// The function applied to each channel.
    #[inline]
    pub fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self::new(f(self.r), f(self.g), f(self.b))
    }

    /// True if every channel is exactly zero.
    #[inline]
    pub fn is_black(self) -> bool {
        self.r == 0.0 && self.g == 0.0 && self.b == 0.0
    }

    /// True if all channels are equal.
    #[inline]
    pub fn is_grey(self) -> bool {
        self.r == self.g && self.g == self.b
    }

    /// True if no channel is NaN or infinite.
    #[inline]
    pub fn is_finite(self) -> bool {
        self.r.is_finite() && self.g.is_finite() && self.b.is_finite()
    }

    /// As an array, red first.
    #[inline]
    pub fn to_array(self) -> [f64; 3] {
        [self.r, self.g, self.b]
    }
}

impl From<[f64; 3]> for Rgb {
    #[inline]
    fn from([r, g, b]: [f64; 3]) -> Self {
        Self { r, g, b }
    }
}

impl From<[f32; 3]> for Rgb {
    #[inline]
    fn from(v: [f32; 3]) -> Self {
        Self::new(v[0].into(), v[1].into(), v[2].into())
    }
}

impl Index<usize> for Rgb {
    type Output = f64;
    #[inline]
    fn index(&self, channel: usize) -> &f64 {
        match channel {
            0 => &self.r,
            1 => &self.g,
            2 => &self.b,
            _ => panic!("an Rgb has channels 0, 1 and 2, not {channel}"),
        }
    }
}

impl Add for Rgb {
    type Output = Rgb;
    #[inline]
    fn add(self, o: Rgb) -> Rgb {
        Rgb::new(self.r + o.r, self.g + o.g, self.b + o.b)
    }
}

impl AddAssign for Rgb {
    #[inline]
    fn add_assign(&mut self, o: Rgb) {
        *self = *self + o;
    }
}

impl Sub for Rgb {
    type Output = Rgb;
    #[inline]
    fn sub(self, o: Rgb) -> Rgb {
        Rgb::new(self.r - o.r, self.g - o.g, self.b - o.b)
    }
}

impl Mul for Rgb {
    type Output = Rgb;
    #[inline]
    fn mul(self, o: Rgb) -> Rgb {
        Rgb::new(self.r * o.r, self.g * o.g, self.b * o.b)
    }
}

impl MulAssign for Rgb {
    #[inline]
    fn mul_assign(&mut self, o: Rgb) {
        *self = *self * o;
    }
}

impl Mul<f64> for Rgb {
    type Output = Rgb;
    #[inline]
    fn mul(self, k: f64) -> Rgb {
        Rgb::new(self.r * k, self.g * k, self.b * k)
    }
}

impl Mul<Rgb> for f64 {
    type Output = Rgb;
    #[inline]
    fn mul(self, v: Rgb) -> Rgb {
        v * self
    }
}

impl Div<f64> for Rgb {
    type Output = Rgb;
    #[inline]
    fn div(self, k: f64) -> Rgb {
        Rgb::new(self.r / k, self.g / k, self.b / k)
    }
}

impl std::iter::Sum for Rgb {
    fn sum<I: Iterator<Item = Rgb>>(values: I) -> Rgb {
        values.fold(Rgb::BLACK, Add::add)
    }
}
