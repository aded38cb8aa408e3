//! Maps from the unit square to the domains that are sampled, each beside its density.

use super::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_4, PI};

/// Uniform point of the unit disk: concentric map, which keeps strata connected (Shirley and Chiu 1997).
#[inline]
pub fn disk(u: Vec2) -> Vec2 {
    let p = 2.0 * u - Vec2::ONE;
    if p == Vec2::ZERO {
        return Vec2::ZERO;
    }
    let is_wide = p.x.abs() > p.y.abs();
    let (radius, angle) = if is_wide { (p.x, FRAC_PI_4 * (p.y / p.x)) } else { (p.y, FRAC_PI_4 * (p.x / p.y)) };
    let (sin, cos) = sin_cos_of_eighth(angle);
    // Beyond an eighth of a turn angles are counted back from a quarter.
    if is_wide { Vec2::new(radius * cos, radius * sin) } else { Vec2::new(radius * sin, radius * cos) }
}

/// Sine and cosine of an angle of an eighth of a turn at most to either side [radians], to 1e-7: Taylor series.
#[inline(always)]
fn sin_cos_of_eighth(x: f32) -> (f32, f32) {
    let x2 = x * x;
    let sin = x * (1.0 + x2 * (-1.0 / 6.0 + x2 * (1.0 / 120.0 + x2 * (-1.0 / 5040.0 + x2 * (1.0 / 362_880.0)))));
    let cos = 1.0 + x2 * (-0.5 + x2 * (1.0 / 24.0 + x2 * (-1.0 / 720.0 + x2 * (1.0 / 40_320.0))));
    (sin, cos)
}

/// Direction of the upper hemisphere with density cos(theta)/pi per steradian (Malley's method).
#[inline]
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let p = disk(u);
    // A direction exactly in the surface would have density zero; the floor keeps it just above.
    let z = (1.0 - p.length_squared()).max(1e-12).sqrt();
    Vec3::new(p.x, p.y, z)
}

/// Uniform barycentric coordinates (of the second and third vertex) of a triangle.
///
/// The square is folded, not bent by a square root, so that strata stay compact (Heitz 2019, "A Low-Distortion Map Between
/// Triangle and Square").
#[inline]
pub fn triangle(u: Vec2) -> Vec2 {
    if u.y > u.x {
        let x = u.x * 0.5;
        Vec2::new(x, u.y - x)
    } else {
        let y = u.y * 0.5;
        Vec2::new(u.x - y, y)
    }
}

/// Uniform direction of the cone around +z whose half-angle has the given cosine.
///
/// `one_minus_cos_max` is `1 - cos(theta_max)`, passed as such because it cancels for small cones. Density per steradian:
/// `1 / (2 pi one_minus_cos_max)`.
#[inline]
pub fn cone(u: Vec2, one_minus_cos_max: f32) -> Vec3 {
    let one_minus_cos = u.x * one_minus_cos_max;
    let cos = 1.0 - one_minus_cos;
    let sin = (one_minus_cos * (2.0 - one_minus_cos)).max(0.0).sqrt();
    let (s, c) = (2.0 * PI * u.y).sin_cos();
    Vec3::new(sin * c, sin * s, cos)
}

/// Uniform direction of the sphere, with density 1/(4 pi) per steradian.
#[inline]
pub fn sphere(u: Vec2) -> Vec3 {
    cone(u, 2.0)
}

/// Sine and cosine of `turn` whole turns, `turn` in [0, 1], to 2e-9: Taylor series within an eighth of a turn of each quarter. The
/// mathematical library gives more digits than a direction in f32 can hold, and takes longer. Without branches, for loops
/// over lanes.
#[inline(always)]
pub fn sin_cos_of_turn(turn: f64) -> (f64, f64) {
    // The nearest quarter by rounding: added to a number so large, it is in the last bits.
    let shifted = 4.0 * turn + ROUNDS;
    let quarter = shifted.to_bits();
    let x = (4.0 * turn - (shifted - ROUNDS)) * std::f64::consts::FRAC_PI_2;
    let x2 = x * x;
    let sin = x * (1.0 + x2 * (-1.0 / 6.0 + x2 * (1.0 / 120.0 + x2 * (-1.0 / 5040.0 + x2 * (1.0 / 362_880.0)))));
    let cos = 1.0 + x2 * (-0.5 + x2 * (1.0 / 24.0 + x2 * (-1.0 / 720.0 + x2 * (1.0 / 40_320.0 + x2 * (-1.0 / 3_628_800.0)))));
    let (s, c) = if quarter & 1 == 0 { (sin, cos) } else { (cos, sin) };
    // Quarters 0 to 3: (s, c), (c, -s), (-s, -c), (-c, s).
    let signed = |bits: u64, v: f64| f64::from_bits(v.to_bits() ^ ((bits & 2) << 62));
    (signed(quarter, s), signed(quarter + 1, c))
}

/// From here on up to twice as much the last bit of an f64 counts 1; even, so that quarters are counted from 0.
const ROUNDS: f64 = (1_u64 << 52) as f64;

#[cfg(test)]
mod tests {
    use super::*;

    /// Midpoints of a regular n x n grid.
    fn grid(n: usize) -> impl Iterator<Item = Vec2> {
        let at = move |i: usize| (i as f32 + 0.5) / n as f32;
        (0..n * n).map(move |k| Vec2::new(at(k % n), at(k / n)))
    }

    #[test]
    fn a_point_of_the_disk_is_where_its_angle_says() {
        for u in grid(64) {
            let p = 2.0 * u - Vec2::ONE;
            let (radius, turn) = if p.x.abs() > p.y.abs() { (p.x, p.y / p.x) } else { (p.y, 2.0 - p.x / p.y) };
            let angle = std::f64::consts::FRAC_PI_4 * f64::from(turn);
            let want = f64::from(radius) * crate::math::DVec2::new(angle.cos(), angle.sin());
            assert!((disk(u).as_dvec2() - want).length() < 2e-7, "{u}: {}, expected {want}", disk(u));
        }
    }

    #[test]
    fn cosine_hemisphere_has_the_moments_of_its_density() {
        // E[z] = 2/3 and E[z^2] = 1/2 under cos(theta)/pi.
        let n = 256;
        let (mut z1, mut z2) = (0.0_f64, 0.0_f64);
        for u in grid(n) {
            let d = cosine_hemisphere(u);
            assert!((d.length() - 1.0).abs() < 1e-5, "|{d}| is not 1");
            z1 += f64::from(d.z);
            z2 += f64::from(d.z * d.z);
        }
        // The cosine drops to the rim like a square root, so the midpoint rule errs by order n^-1.5 = 2.4e-4.
        let count = (n * n) as f64;
        assert!((z1 / count - 2.0 / 3.0).abs() < 2.5e-4, "mean cosine {}", z1 / count);
        assert!((z2 / count - 0.5).abs() < 2.5e-4, "mean squared cosine {}", z2 / count);
    }

    #[test]
    fn sines_of_turns_are_those_of_the_library() {
        for k in 0..=100_000 {
            let turn = f64::from(k) / 1e5;
            let ((sin, cos), (s, c)) = (sin_cos_of_turn(turn), (std::f64::consts::TAU * turn).sin_cos());
            assert!((sin - s).abs() < 2e-9 && (cos - c).abs() < 2e-9, "{turn} turns: {sin} {cos}, not {s} {c}");
        }
    }

    #[test]
    fn triangle_warp_is_uniform() {
        // Centroid and second moment of the unit right triangle: 1/3 and 1/6.
        let n = 256;
        let (mut m1, mut m2) = (0.0_f64, 0.0_f64);
        for u in grid(n) {
            let b = triangle(u);
            assert!(b.x >= 0.0 && b.y >= 0.0 && b.x + b.y <= 1.0 + 1e-6, "{b} lies outside");
            m1 += f64::from(b.x);
            m2 += f64::from(b.x * b.x);
        }
        let count = (n * n) as f64;
        assert!((m1 / count - 1.0 / 3.0).abs() < 1e-3, "first moment {}", m1 / count);
        assert!((m2 / count - 1.0 / 6.0).abs() < 1e-3, "second moment {}", m2 / count);
    }

    #[test]
    fn cone_stays_inside_and_fills_uniformly() {
        let k = 0.2;
        let n = 64;
        let mean: f64 = grid(n).map(|u| f64::from(cone(u, k).z)).sum::<f64>() / (n * n) as f64;
        assert!((mean - (1.0 - 0.5 * f64::from(k))).abs() < 1e-5, "mean cosine {mean}");
        assert!(grid(n).all(|u| cone(u, k).z >= 1.0 - k - 1e-6));
    }
}
