//! What surrounds the scene: the same radiance from everywhere, or an image of the whole sphere.

use crate::material::texture::Texels;
use crate::math::{DMat3, DVec3, Rgb, Vec2, Vec3, warp};
use std::f64::consts::{PI, TAU};
use std::fmt;

/// Largest step between rows below which sines of small angles are summed as a series.
const SMALL_STEP: f64 = 0.3;

/// Step between rows below which a few terms of a series tell sines to all digits that matter [rad].
const NARROW: f64 = 0.01;

/// Share of a map's mean irradiance that every receiver is taken to get at least, when lights are chosen.
const LEAST_IMPORTANCE: f64 = 0.05;

/// Columns of a map that are looked through at once: four lines of a cache in each of two rows.
const BLOCK: usize = 32;

/// Light from infinitely far away, all around.
#[derive(Debug, Clone)]
pub enum Environment {
    /// The same radiance [W/(m² sr)] from everywhere.
    Uniform(Rgb),
    /// An image of the sphere.
    Map(Box<Map>),
}

/// An image of the sphere by longitude and latitude, with Mitsuba's conventions: up is +y, the middle column lies at +z. Columns
/// are texel-centred and go round; the first and the last row are the poles. Between texels it is bilinear in both angles.
#[derive(Clone)]
pub struct Map {
    width: usize,
    height: usize,
    texels: Texels,
    scale: f64,
    /// From the map's own axes to the scene's: a rotation, perhaps mirrored.
    to_scene: DMat3,
    mean: Rgb,
    /// Integral of radiance times direction over the sphere, by luminance, in scene axes.
    vector: DVec3,
    /// Running sum over the columns of each row of the luminance integrated between neighbouring columns, one column wide.
    running: Vec<f64>,
    /// The last running sum of each block of [`BLOCK`] columns, row by row: small enough to stay in the cache.
    blocks: Vec<f64>,
    /// Running sum of the luminance integrated over the bands between rows [sr times columns].
    bands: Vec<f64>,
    /// Sine and cosine of the polar angle of each row.
    sines: Vec<(f64, f64)>,
}

/// What it was made of; sums over it follow from that.
impl fmt::Debug for Map {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, texels, scale, to_scene, .. } = self;
        f.debug_tuple("Map").field(&(width, height, texels, scale, to_scene)).finish()
    }
}

/// A place between texels.
struct Place {
    column: usize,
    row: usize,
    x: f64,
    y: f64,
}

impl Environment {
    /// A map of `width` x `height` (at least 2 x 3) linear texels in rows from the zenith, each 0 or more and finite, times `scale`;
    /// `to_scene` is orthogonal.
    pub fn map(width: usize, height: usize, texels: Texels, scale: f64, to_scene: DMat3) -> Self {
        Environment::Map(Box::new(Map::new(width, height, texels, scale, to_scene)))
    }

    /// Radiance [W/(m² sr)] that arrives from the unit vector `direction`, in scene coordinates.
    #[inline]
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        match self {
            Environment::Uniform(radiance) => *radiance,
            Environment::Map(map) => map.radiance(direction),
        }
    }

    /// Density per steradian with which [`Environment::sample`] finds `direction`.
    #[inline]
    pub fn pdf(&self, direction: Vec3) -> f64 {
        match self {
            Environment::Uniform(_) => 0.25 / PI,
            Environment::Map(map) => map.pdf(map.radiance(direction)),
        }
    }

    /// A direction by its luminance, with its radiance and its density per steradian; density 0 if all is dark.
    #[inline]
    pub fn sample(&self, u: Vec2) -> (Vec3, Rgb, f64) {
        match self {
            Environment::Uniform(radiance) => (crate::math::warp::sphere(u), *radiance, 0.25 / PI),
            Environment::Map(map) => {
                let direction = map.sample(u);
                // As whoever looks that way finds it, to the last bit.
                let radiance = map.radiance(direction);
                (direction, radiance, map.pdf(radiance))
            }
        }
    }

    /// The point of the unit square from which [`Environment::sample`] makes `direction`.
    #[inline]
    pub fn square(&self, direction: Vec3) -> Vec2 {
        match self {
            Environment::Uniform(_) => {
                let turn = f64::from(direction.y).atan2(f64::from(direction.x)) / TAU;
                Vec2::new(0.5 * (1.0 - direction.z), turn.rem_euclid(1.0) as f32)
            }
            Environment::Map(map) => map.square(direction),
        }
    }

    /// True if the radiance is the same from everywhere.
    pub fn is_uniform(&self) -> bool {
        matches!(self, Environment::Uniform(_))
    }

    /// Mean radiance over the sphere [W/(m² sr)].
    pub fn mean(&self) -> Rgb {
        match self {
            Environment::Uniform(radiance) => *radiance,
            Environment::Map(map) => map.mean,
        }
    }

    /// Rough irradiance of a receiver with normal `n`, never zero unless all is dark.
    #[inline]
    pub fn importance(&self, n: Vec3) -> f64 {
        let even = PI * self.mean().luminance();
        match self {
            Environment::Uniform(_) => even,
            // The positive part of the cosine is half the cosine and half its magnitude, taken as if light came evenly.
            Environment::Map(map) => (even + 0.5 * map.vector.dot(n.as_dvec3())).max(LEAST_IMPORTANCE * even),
        }
    }
}

impl Map {
    fn new(width: usize, height: usize, texels: Texels, scale: f64, to_scene: DMat3) -> Self {
        assert!(width >= 2 && height >= 3 && texels.len() == width * height, "a map of at least 2 x 3 texels");
        let luminance = |row: usize, column: usize| Rgb::from(texels.at(row * width + column % width)).luminance();
        let mut running = Vec::with_capacity(width * height);
        for row in 0..height {
            let mut sum = 0.0;
            for column in 0..width {
                sum += 0.5 * (luminance(row, column) + luminance(row, column + 1));
                running.push(sum);
            }
        }
        let step = PI / (height - 1) as f64;
        let mut total = 0.0;
        let bands = (0..height - 1).map(|row| {
            let [top, bottom] = [row, row + 1].map(|r| running[r * width + width - 1]);
            total += Band::new(row, step).integral(top, bottom, 1.0);
            total
        });
        let bands = bands.collect();
        let column_width = TAU / width as f64;
        let (mut sum, mut vector) = (Rgb::BLACK, DVec3::ZERO);
        for (row, weight) in row_weights(height).into_iter().enumerate() {
            let theta = step * row as f64;
            let mut row_sum = Rgb::BLACK;
            for column in 0..width {
                let radiance = Rgb::from(texels.at(row * width + column));
                row_sum += radiance;
                let phi = column_width * (column as f64 + 0.5);
                // Coarse within a texel, which a rough importance may be.
                vector += local_direction(theta, phi) * (radiance.luminance() * weight);
            }
            sum += row_sum * weight;
        }
        let mean = sum * (scale / width as f64);
        let vector = to_scene * vector * (scale * 4.0 * PI / width as f64);
        let ends = |row: &[f64]| row.chunks(BLOCK).map(|block| block[block.len() - 1]).collect::<Vec<_>>();
        let blocks = running.chunks(width).flat_map(ends).collect();
        let sines = (0..height).map(|row| (step * row as f64).sin_cos()).collect();
        Self { width, height, texels, scale, to_scene, mean, vector, running, blocks, bands, sines }
    }

    /// Where `direction` lies between the texels.
    #[inline]
    fn place(&self, direction: Vec3) -> Place {
        let d = self.to_scene.transpose() * direction.as_dvec3();
        let phi = d.x.atan2(-d.z);
        // Unlike the arc cosine, exact near the poles.
        let theta = d.x.hypot(d.z).atan2(d.y);
        let x = (phi / TAU * self.width as f64 - 0.5).rem_euclid(self.width as f64);
        let y = theta / PI * (self.height - 1) as f64;
        // A tiny negative number can round to the period itself.
        let column = (x as usize).min(self.width - 1);
        let row = (y as usize).min(self.height - 2);
        Place { column, row, x: x - column as f64, y: y - row as f64 }
    }

    #[inline]
    fn radiance(&self, direction: Vec3) -> Rgb {
        let Place { column, row, x, y } = self.place(direction);
        let next = if column + 1 == self.width { 0 } else { column + 1 };
        let texel = |row: usize, column: usize| Rgb::from(self.texels.at(row * self.width + column));
        let along = |row: usize| texel(row, column) * (1.0 - x) + texel(row, next) * x;
        (along(row) * (1.0 - y) + along(row + 1) * y) * self.scale
    }

    /// Density per steradian: luminance over its integral. The luminance of the bilinear function is what is sampled, exactly.
    #[inline]
    fn pdf(&self, radiance: Rgb) -> f64 {
        let total = 4.0 * PI * self.mean.luminance();
        if total > 0.0 { radiance.luminance() / total } else { 0.0 }
    }

    /// A direction by luminance: first the band between two rows, then the polar angle in it, then the azimuth.
    fn sample(&self, u: Vec2) -> Vec3 {
        let target = f64::from(u.y) * self.bands[self.bands.len() - 1];
        let row = self.bands.partition_point(|&b| b <= target).min(self.height - 2);
        let before = if row == 0 { 0.0 } else { self.bands[row - 1] };
        let band = self.band(row);
        let (top, bottom) = (self.row(row), self.row(row + 1));
        let y = band.invert(top[self.width - 1], bottom[self.width - 1], target - before);
        let mix = |a: f64, b: f64| a * (1.0 - y) + b * y;

        let at = |column: usize| mix(top[column], bottom[column]);
        let target = f64::from(u.x) * at(self.width - 1);
        let n_blocks = self.width.div_ceil(BLOCK);
        let blocks = &self.blocks[row * n_blocks..(row + 2) * n_blocks];
        let block = first_above(0, n_blocks - 1, target, |b| mix(blocks[b], blocks[n_blocks + b]));
        let column = first_above(block * BLOCK, (block * BLOCK + BLOCK).min(self.width) - 1, target, at);
        let rest = target - if column == 0 { 0.0 } else { at(column - 1) };
        let next = if column + 1 == self.width { 0 } else { column + 1 };
        let [left, right] = [column, next].map(|c| mix(self.luminance(row, c), self.luminance(row + 1, c)));
        let x = invert_linear(left, right, rest);
        let (st, ct) = band.sin_cos(y);
        let (sp, cp) = warp::sin_cos_of_turn((column as f64 + x + 0.5) / self.width as f64);
        (self.to_scene * DVec3::new(sp * st, ct, -cp * st)).as_vec3().normalize()
    }

    /// The strip between a row and the next.
    #[inline]
    fn band(&self, row: usize) -> Band {
        let (sin, cos) = self.sines[row];
        Band { step: PI / (self.height - 1) as f64, sin, cos }
    }

    /// Inverse of [`Map::sample`].
    fn square(&self, direction: Vec3) -> Vec2 {
        let Place { column, row, x, y } = self.place(direction);
        let (top, bottom) = (self.row(row), self.row(row + 1));
        let before = if row == 0 { 0.0 } else { self.bands[row - 1] };
        let band = self.band(row);
        let along_y = before + band.integral(top[self.width - 1], bottom[self.width - 1], y);
        let mix = |a: f64, b: f64| a * (1.0 - y) + b * y;
        let next = if column + 1 == self.width { 0 } else { column + 1 };
        let [left, right] = [column, next].map(|c| mix(self.luminance(row, c), self.luminance(row + 1, c)));
        let before = if column == 0 { 0.0 } else { mix(top[column - 1], bottom[column - 1]) };
        let along_x = before + x * (left + 0.5 * x * (right - left));
        let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole).clamp(0.0, 1.0) as f32 } else { 0.0 };
        let whole = [mix(top[self.width - 1], bottom[self.width - 1]), self.bands[self.bands.len() - 1]];
        Vec2::new(share(along_x, whole[0]), share(along_y, whole[1]))
    }

    #[inline]
    fn row(&self, row: usize) -> &[f64] {
        &self.running[row * self.width..(row + 1) * self.width]
    }

    #[inline]
    fn luminance(&self, row: usize, column: usize) -> f64 {
        Rgb::from(self.texels.at(row * self.width + column)).luminance()
    }
}

/// The first of `low..=high` whose value is above `target`, values rising; `high` if none is. All are looked at, since reading them one after
/// the other as a bisection does takes longer: most are not in the cache.
#[inline(always)]
fn first_above(low: usize, high: usize, target: f64, value: impl Fn(usize) -> f64) -> usize {
    low + (low..high).map(|i| usize::from(value(i) <= target)).sum::<usize>()
}

/// Direction in the map's axes: `theta` from +y, `phi` from -z towards +x.
fn local_direction(theta: f64, phi: f64) -> DVec3 {
    let ((st, ct), (sp, cp)) = (theta.sin_cos(), phi.sin_cos());
    DVec3::new(sp * st, ct, -cp * st)
}

/// The t in [0, 1] at which the integral of `a (1 - t) + b t` from 0 reaches `target`.
#[inline]
fn invert_linear(a: f64, b: f64, target: f64) -> f64 {
    // a t + (b - a) t²/2 = target, by the root that does not cancel.
    let q = a + (a * a + 2.0 * (b - a) * target).max(0.0).sqrt();
    if q > 0.0 { (2.0 * target / q).clamp(0.0, 1.0) } else { 0.5 }
}

/// The strip of the sphere between two rows of a map.
struct Band {
    step: f64,
    sin: f64,
    cos: f64,
}

impl Band {
    fn new(row: usize, step: f64) -> Self {
        let (sin, cos) = (step * row as f64).sin_cos();
        Self { step, sin, cos }
    }

    /// Integral of `(a (1 - s) + b s) sin(theta0 + step s)` over s from 0 to t.
    fn integral(&self, a: f64, b: f64, t: f64) -> f64 {
        let (h, x) = (self.step, self.step * t);
        let (sin, cos) = x.sin_cos();
        let versine = 2.0 * (0.5 * x).sin().powi(2);
        // Integrals of cos(h s), sin(h s), s cos(h s) and s sin(h s).
        let (c0, s0) = (sin / h, versine / h);
        let c1 = t * sin / h - versine / (h * h);
        let s1 = if x < SMALL_STEP {
            // (sin x - x cos x)/h² cancels.
            let x2 = x * x;
            t * t * x * (1.0 / 3.0 - x2 * (1.0 / 30.0 - x2 * (1.0 / 840.0 - x2 / 45_360.0)))
        } else {
            (sin - x * cos) / (h * h)
        };
        self.sin * (a * c0 + (b - a) * c1) + self.cos * (a * s0 + (b - a) * s1)
    }

    /// Sine and cosine of the polar angle at a share `t` of the band.
    #[inline]
    fn sin_cos(&self, t: f64) -> (f64, f64) {
        let x = self.step * t;
        let (sin, cos) = if x < NARROW {
            let x2 = x * x;
            (x * (1.0 - x2 * (1.0 / 6.0 - x2 / 120.0)), 1.0 - x2 * (0.5 - x2 * (1.0 / 24.0 - x2 / 720.0)))
        } else {
            x.sin_cos()
        };
        (self.sin * cos + self.cos * sin, self.cos * cos - self.sin * sin)
    }

    /// The t at which [`Band::integral`] reaches `target`.
    #[inline]
    fn invert(&self, a: f64, b: f64, target: f64) -> f64 {
        if self.step < NARROW { self.invert_narrow(a, b, target) } else { self.invert_wide(a, b, target) }
    }

    /// The same for a narrow band, in which the sine is a cubic to 1e-9: Newton's method on a polynomial, from where it would be if sine and
    /// radiance were linear together.
    fn invert_narrow(&self, a: f64, b: f64, target: f64) -> f64 {
        let (s, c, bend) = (self.sin, self.cos * self.step, -0.5 * self.sin * self.step * self.step);
        let (d, turn) = (b - a, -c * self.step * self.step / 6.0);
        // Of (a + d t)(s + c t + bend t² + turn t³).
        let of = [a * s, a * c + d * s, a * bend + d * c, a * turn + d * bend, d * turn];
        let end = s + c + bend + turn;
        let mut t = invert_linear(a * s + 1e-300, (b * end).max(0.0), target);
        // Near the poles the start is far off; elsewhere two steps do.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..32 {
            let error = t * (of[0] + t * (of[1] / 2.0 + t * (of[2] / 3.0 + t * (of[3] / 4.0 + t * of[4] / 5.0)))) - target;
            let slope = of[0] + t * (of[1] + t * (of[2] + t * (of[3] + t * of[4])));
            if error > 0.0 {
                high = t;
            } else {
                low = t;
            }
            let next = t - error / slope;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - t).abs() < 1e-12 {
                return next;
            }
            t = next;
        }
        t
    }

    /// The same for any band: Newton's method, kept inside a shrinking bracket.
    fn invert_wide(&self, a: f64, b: f64, target: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        // Exact if sine and radiance were linear together.
        let (sin1, _) = (self.sin * self.step.cos() + self.cos * self.step.sin(), ());
        let mut t = invert_linear(a * self.sin + 1e-300, b * sin1.max(0.0), target);
        for _ in 0..64 {
            let error = self.integral(a, b, t) - target;
            if error > 0.0 {
                high = t
            } else {
                low = t
            }
            let slope = (a * (1.0 - t) + b * t) * (self.sin * (self.step * t).cos() + self.cos * (self.step * t).sin());
            let next = t - error / slope;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - t).abs() < 1e-12 {
                return next;
            }
            t = next;
        }
        t
    }
}

/// Share of the sphere that each row of a map stands for; their sum is 1.
///
/// Row r lies at theta = pi r/(H - 1), so that the first and the last are the poles, and values between rows are linear:
/// the weight is half the integral of the hat function of that row times sin(theta).
fn row_weights(height: usize) -> Vec<f64> {
    let step = PI / (height - 1) as f64;
    (0..height)
        .map(|r| {
            if r == 0 || r == height - 1 {
                0.5 * (1.0 - step.sin() / step)
            } else {
                (step * r as f64).sin() * 2.0 * (0.5 * step).sin().powi(2) / step
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_weights_cover_the_sphere() {
        for height in [3, 4, 64, 1024] {
            let sum: f64 = row_weights(height).iter().sum();
            assert!((sum - 1.0).abs() < 1e-12, "{height} rows: {sum}");
        }
    }

    /// Against Simpson's rule with many steps.
    #[test]
    fn the_integral_over_a_band_and_its_inverse() {
        for (height, row) in [(3, 0), (3, 1), (16, 0), (16, 7), (1024, 0), (1024, 1022)] {
            let band = Band::new(row, PI / (height - 1) as f64);
            for (a, b, t) in [(1.0, 1.0, 1.0), (2.0, 0.5, 0.7), (0.0, 1.0, 0.3), (1.0, 0.0, 0.999)] {
                let f = |s: f64| (a * (1.0 - s) + b * s) * (band.step * (row as f64 + s)).sin();
                let n = 2000;
                let at = |i: usize| f(t * i as f64 / f64::from(n));
                let odd: f64 = (1..n as usize).map(|i| at(i) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
                let want = (at(0) + odd + at(n as usize)) * t / (3.0 * f64::from(n));
                let got = band.integral(a, b, t);
                assert!((got / want - 1.0).abs() < 1e-7, "row {row} of {height}, {a} to {b} up to {t}: {got}, expected {want}");
                let back = band.invert(a, b, want);
                assert!((back - t).abs() < 1e-5, "row {row} of {height}, {a} to {b}: {back}, expected {t}");
            }
        }
    }
}
