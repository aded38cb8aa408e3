//! Spatially varying reflectance.

use crate::math::{Rgb, Vec2};
use std::sync::Arc;

/// A reflectance over the texture coordinates of a surface.
#[derive(Debug, Clone)]
pub enum Texture {
    /// The same everywhere.
    Constant(Rgb),
    /// An image.
    Bitmap(Bitmap),
}

/// How values between texel centres are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// The nearest texel.
    Nearest,
    /// Bilinear between the four nearest.
    Bilinear,
}

/// What lies outside the unit square.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// The image again.
    Repeat,
    /// The image mirrored.
    Mirror,
    /// Its border.
    Clamp,
}

/// An image of linear values. Row 0 is at v = 0; texel centres lie at (i + 1/2)/n.
#[derive(Debug, Clone)]
pub struct Bitmap {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// Linear values, row by row; shared by all users of the file.
    pub texels: Arc<[[f32; 3]]>,
    /// Interpolation.
    pub filter: Filter,
    /// Continuation.
    pub wrap: Wrap,
    /// Rows of the affine map applied to (u, v, 1) before the lookup.
    pub to_uv: [[f32; 3]; 2],
}

impl Bitmap {
    /// The identity map for `to_uv`.
    pub const IDENTITY: [[f32; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    fn at(&self, uv: Vec2) -> Rgb {
        let [a, b] = self.to_uv;
        let (u, v) = (a[0] * uv.x + a[1] * uv.y + a[2], b[0] * uv.x + b[1] * uv.y + b[2]);
        match self.filter {
            Filter::Nearest => {
                let cell = |t: f32, n: usize| (t * n as f32).floor() as i64;
                self.texel(cell(u, self.width), cell(v, self.height))
            }
            Filter::Bilinear => {
                let (x, y) = (u * self.width as f32 - 0.5, v * self.height as f32 - 0.5);
                let (x0, y0) = (x.floor(), y.floor());
                let (fx, fy) = (f64::from(x - x0), f64::from(y - y0));
                let (x0, y0) = (x0 as i64, y0 as i64);
                let row = |y: i64| self.texel(x0, y) * (1.0 - fx) + self.texel(x0 + 1, y) * fx;
                row(y0) * (1.0 - fy) + row(y0 + 1) * fy
            }
        }
    }

    fn texel(&self, x: i64, y: i64) -> Rgb {
        let fold = |i: i64, n: usize| {
            let n = n as i64;
            (match self.wrap {
                Wrap::Repeat => i.rem_euclid(n),
                Wrap::Clamp => i.clamp(0, n - 1),
                Wrap::Mirror => {
                    let k = i.rem_euclid(2 * n);
                    k.min(2 * n - 1 - k)
                }
            }) as usize
        };
        self.texels[fold(y, self.height) * self.width + fold(x, self.width)].into()
    }
}

impl Texture {
    /// Value at texture coordinates `uv`.
    #[inline]
    pub fn at(&self, uv: Vec2) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
            Texture::Bitmap(bitmap) => bitmap.at(uv),
        }
    }

    /// Mean over the whole image.
    pub fn mean(&self) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
            Texture::Bitmap(b) => b.texels.iter().map(|t| Rgb::from(*t)).sum::<Rgb>() / b.texels.len() as f64,
        }
    }

    /// The texture with `f` applied to every value; used to turn a parameter into an albedo.
    pub fn map(&self, f: impl Fn(Rgb) -> Rgb) -> Texture {
        match self {
            Texture::Constant(value) => Texture::Constant(f(*value)),
            Texture::Bitmap(bitmap) => {
                let texels = bitmap.texels.iter().map(|t| f(Rgb::from(*t)).to_array().map(|v| v as f32)).collect();
                Texture::Bitmap(Bitmap { texels, ..bitmap.clone() })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_by_one(filter: Filter, wrap: Wrap) -> Texture {
        let texels = Arc::from([[0.0; 3], [1.0; 3]]);
        Texture::Bitmap(Bitmap { width: 2, height: 1, texels, filter, wrap, to_uv: Bitmap::IDENTITY })
    }

    #[test]
    fn bilinear_lookup_wraps_at_the_border() {
        let t = two_by_one(Filter::Bilinear, Wrap::Repeat);
        for (u, want) in [(0.25, 0.0), (0.75, 1.0), (0.5, 0.5), (0.0, 0.5), (1.0, 0.5), (1.25, 0.0)] {
            let got = t.at(Vec2::new(u, 0.3)).r;
            assert!((got - want).abs() < 1e-6, "u = {u}: {got}, expected {want}");
        }
    }

    #[test]
    fn nearest_lookup_and_the_other_wraps() {
        assert_eq!(two_by_one(Filter::Nearest, Wrap::Repeat).at(Vec2::new(-0.25, 0.0)).r, 1.0);
        assert_eq!(two_by_one(Filter::Nearest, Wrap::Clamp).at(Vec2::new(-0.25, 0.0)).r, 0.0);
        assert_eq!(two_by_one(Filter::Nearest, Wrap::Mirror).at(Vec2::new(1.25, 0.0)).r, 1.0);
    }
}
