//! Spatially varying parameters of materials.

pub use super::texels::Texels;
use crate::math::{DVec2, Rgb, Vec2};

/// A colour over the texture coordinates of a surface.
#[derive(Debug, Clone)]
pub enum Texture {
    /// The same everywhere.
    Constant(Rgb),
    /// An image.
    Bitmap(Bitmap),
    /// Two textures in turn.
    Checkerboard(Box<Checkerboard>),
}

impl Texture {
    /// The same with every value times `factor`, by channel.
    pub fn scaled(&self, factor: Rgb) -> Texture {
        match self {
            Texture::Constant(value) => Texture::Constant(*value * factor),
            Texture::Bitmap(bitmap) => {
                let by = [factor.r, factor.g, factor.b];
                let texel = |t: [f32; 3]| std::array::from_fn(|c| (f64::from(t[c]) * by[c]) as f32);
                let texels: Vec<[f32; 3]> = bitmap.texels.iter().map(texel).collect();
                Texture::Bitmap(Bitmap { texels: texels.into(), ..bitmap.clone() })
            }
            Texture::Checkerboard(board) => {
                let colors = [0, 1].map(|k| board.colors[k].scaled(factor));
                Texture::Checkerboard(Box::new(Checkerboard { colors, to_uv: board.to_uv }))
            }
        }
    }
}

/// Squares of half a unit, in each of which one of two textures shows.
#[derive(Debug, Clone)]
pub struct Checkerboard {
    /// Where the fractions of u and v lie in the same half of the unit square, and where they do not.
    pub colors: [Texture; 2],
    /// Rows of the affine map applied to (u, v, 1) before the squares are told apart.
    pub to_uv: [[f32; 3]; 2],
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
    /// Linear values, row by row.
    pub texels: Texels,
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
        let Vec2 { x: u, y: v } = mapped(&self.to_uv, uv);
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
                let columns = [x0, x0 + 1].map(|x| self.fold(x, self.width));
                let row = |y: i64| {
                    let first = self.fold(y, self.height) * self.width;
                    let [a, b] = columns.map(|column| Rgb::from(self.texels.at(first + column)));
                    a * (1.0 - fx) + b * fx
                };
                row(y0) * (1.0 - fy) + row(y0 + 1) * fy
            }
        }
    }

    fn luminance_gradient(&self, uv: Vec2) -> DVec2 {
        if self.filter == Filter::Nearest {
            return DVec2::ZERO;
        }
        let at = mapped(&self.to_uv, uv);
        let (x, y) = (at.x * self.width as f32 - 0.5, at.y * self.height as f32 - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (f64::from(x - x0), f64::from(y - y0));
        let value = |i: i64, j: i64| luminance(self.texel(x0 as i64 + i, y0 as i64 + j));
        let (a, b, c, d) = (value(0, 0), value(1, 0), value(0, 1), value(1, 1));
        let by_x = ((b - a) * (1.0 - fy) + (d - c) * fy) * self.width as f64;
        let by_y = ((c - a) * (1.0 - fx) + (d - b) * fx) * self.height as f64;
        let [row, other] = self.to_uv.map(|row| row.map(f64::from));
        DVec2::new(row[0] * by_x + other[0] * by_y, row[1] * by_x + other[1] * by_y)
    }

    fn texel(&self, x: i64, y: i64) -> Rgb {
        self.texels.at(self.fold(y, self.height) * self.width + self.fold(x, self.width)).into()
    }

    /// Where column or row `i` lies, of `n` that there are.
    #[inline]
    fn fold(&self, i: i64, n: usize) -> usize {
        // Nearly all do; a division costs more than what it finds.
        if (0..n as i64).contains(&i) {
            return i as usize;
        }
        let n = n as i64;
        (match self.wrap {
            Wrap::Repeat => i.rem_euclid(n),
            Wrap::Clamp => i.clamp(0, n - 1),
            Wrap::Mirror => {
                let k = i.rem_euclid(2 * n);
                k.min(2 * n - 1 - k)
            }
        }) as usize
    }
}

fn mapped([a, b]: &[[f32; 3]; 2], uv: Vec2) -> Vec2 {
    Vec2::new(a[0] * uv.x + a[1] * uv.y + a[2], b[0] * uv.x + b[1] * uv.y + b[2])
}

impl Checkerboard {
    /// The texture that shows at `uv`, or the other one.
    #[inline]
    fn showing(&self, uv: Vec2, swapped: bool) -> &Texture {
        let at = mapped(&self.to_uv, uv);
        let upper = |t: f32| t - t.floor() > 0.5;
        &self.colors[usize::from((upper(at.x) != upper(at.y)) != swapped)]
    }
}

/// One number of a plain colour: the mean of its channels, exactly so if it is grey.
fn level(c: Rgb) -> f64 {
    if c.r == c.g && c.g == c.b { c.r } else { c.mean() }
}

/// One number of a colour from an image: its luminance, in the digits that Mitsuba uses.
pub(super) fn luminance(c: Rgb) -> f64 {
    0.212_671 * c.r + 0.715_160 * c.g + 0.072_169 * c.b
}

impl Texture {
    /// Black everywhere.
    pub const BLACK: Texture = Texture::Constant(Rgb::BLACK);
    /// White everywhere.
    pub const WHITE: Texture = Texture::Constant(Rgb::WHITE);

    /// The texture with `f` applied to every value.
    pub fn map(&self, f: &dyn Fn(Rgb) -> Rgb) -> Texture {
        match self {
            Texture::Constant(value) => Texture::Constant(f(*value)),
            Texture::Bitmap(bitmap) => {
                let texels = bitmap.texels.iter().map(|t| f(Rgb::from(t)).to_array().map(|v| v as f32)).collect();
                Texture::Bitmap(Bitmap { texels, ..bitmap.clone() })
            }
            Texture::Checkerboard(board) => {
                let colors = [board.colors[0].map(f), board.colors[1].map(f)];
                Texture::Checkerboard(Box::new(Checkerboard { colors, to_uv: board.to_uv }))
            }
        }
    }

    /// The same number in all channels, everywhere.
    pub const fn grey(value: f64) -> Self {
        Texture::Constant(Rgb::grey(value))
    }

    /// True if it has the same value everywhere.
    pub fn is_constant(&self) -> bool {
        matches!(self, Texture::Constant(_))
    }

    /// True if red, green and blue are equal at every place.
    pub fn is_grey(&self) -> bool {
        match self {
            Texture::Constant(value) => value.is_grey(),
            Texture::Bitmap(bitmap) => bitmap.texels.iter().all(|t| Rgb::from(t).is_grey()),
            Texture::Checkerboard(board) => board.colors.iter().all(Texture::is_grey),
        }
    }

    /// Value at texture coordinates `uv`.
    #[inline]
    pub fn at(&self, uv: Vec2) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
            Texture::Bitmap(bitmap) => bitmap.at(uv),
            Texture::Checkerboard(board) => board.showing(uv, false).at(uv),
        }
    }

    /// Value as one number, for roughness, opacity and the like: the luminance of an image, the mean of the channels of a plain
    /// colour, as Mitsuba reads them.
    #[inline]
    pub fn scalar(&self, uv: Vec2) -> f64 {
        match self {
            Texture::Constant(value) => level(*value),
            Texture::Bitmap(bitmap) => luminance(bitmap.at(uv)),
            // Where a number is read, Mitsuba 3.9.1 has the two textures the other way round.
            Texture::Checkerboard(board) => board.showing(uv, true).scalar(uv),
        }
    }

    /// Derivatives of [`Self::scalar`] by u and v: of an image that is interpolated; else 0.
    pub fn scalar_gradient(&self, uv: Vec2) -> DVec2 {
        match self {
            Texture::Bitmap(bitmap) => bitmap.luminance_gradient(uv),
            Texture::Checkerboard(board) => board.showing(uv, true).scalar_gradient(uv),
            Texture::Constant(_) => DVec2::ZERO,
        }
    }

    /// Mean over the unit square of texture coordinates, before `to_uv`. Both filters and all continuations give each texel
    /// the same weight there.
    pub fn mean(&self) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
            Texture::Bitmap(b) => b.texels.iter().map(Rgb::from).sum::<Rgb>() / b.texels.len() as f64,
            Texture::Checkerboard(board) => (board.colors[0].mean() + board.colors[1].mean()) * 0.5,
        }
    }

    /// Mean of [`Self::scalar`].
    pub fn mean_scalar(&self) -> f64 {
        match self {
            Texture::Constant(value) => level(*value),
            Texture::Bitmap(_) => luminance(self.mean()),
            Texture::Checkerboard(board) => 0.5 * (board.colors[0].mean_scalar() + board.colors[1].mean_scalar()),
        }
    }

    /// Largest value of each channel.
    pub fn max(&self) -> Rgb {
        let larger = |a: Rgb, b: Rgb| Rgb::new(a.r.max(b.r), a.g.max(b.g), a.b.max(b.b));
        match self {
            Texture::Constant(value) => *value,
            Texture::Bitmap(b) => b.texels.iter().map(Rgb::from).fold(Rgb::BLACK, larger),
            Texture::Checkerboard(board) => larger(board.colors[0].max(), board.colors[1].max()),
        }
    }

    /// Largest value of [`Self::scalar`].
    pub fn max_scalar(&self) -> f64 {
        match self {
            Texture::Constant(value) => level(*value),
            Texture::Bitmap(b) => b.texels.iter().map(|t| luminance(t.into())).fold(0.0, f64::max),
            Texture::Checkerboard(board) => board.colors[0].max_scalar().max(board.colors[1].max_scalar()),
        }
    }

    /// Smallest value of [`Self::scalar`].
    pub fn min_scalar(&self) -> f64 {
        match self {
            Texture::Constant(value) => level(*value),
            Texture::Bitmap(b) => b.texels.iter().map(|t| luminance(t.into())).fold(f64::INFINITY, f64::min),
            Texture::Checkerboard(board) => board.colors[0].min_scalar().min(board.colors[1].min_scalar()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_by_one(filter: Filter, wrap: Wrap) -> Texture {
        let texels = vec![[0.0; 3], [1.0; 3]].into();
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
