//! Microfacet distributions: density of normals, Smith's shadowing, sampling of the normals that a direction sees.
//!
//! [Walter07] for Beckmann and GGX, [Heitz14] for visible normals, [Heitz18] and [Jakob14] for drawing them. The rational fit of
//! Beckmann's shadowing, the floor of the roughness and the three Newton steps are those of Mitsuba, whose tables are built
//! with them.

use super::albedo::gauss_legendre;
use crate::math::{DVec2, DVec3};
use std::f64::consts::{FRAC_2_SQRT_PI, FRAC_PI_2, FRAC_PI_4, PI};

/// Smallest roughness; below it the lobe is narrower than f32 directions resolve.
const SMOOTHEST: f64 = 1e-4;

/// Densities below this count as none, so that no later quotient overflows.
const NEGLIGIBLE: f64 = 1e-20;

/// Distribution of microfacet normals, with its shadowing function G1. [Walter07, section 5.2].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Distribution {
    /// Gaussian slopes.
    Beckmann,
    /// Trowbridge-Reitz.
    Ggx,
}

/// A distribution with its roughness along the two tangents.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Microfacet {
    distribution: Distribution,
    /// Roughness along x and y [slope].
    alpha: DVec2,
}

impl Microfacet {
    /// Roughness `alpha_u` along x and `alpha_v` along y: root mean square slope for Beckmann, times sqrt(1/2).
    #[inline]
    pub fn new(distribution: Distribution, alpha_u: f64, alpha_v: f64) -> Self {
        Self { distribution, alpha: DVec2::new(alpha_u.max(SMOOTHEST), alpha_v.max(SMOOTHEST)) }
    }

    /// Density of normals D(m) per steradian: microfacet area over projected area. [Walter07, eqs. 25 and 33].
    #[inline]
    pub fn d(&self, m: DVec3) -> f64 {
        let slope2 = (m.x / self.alpha.x).powi(2) + (m.y / self.alpha.y).powi(2);
        let cos2 = m.z * m.z;
        let scale = PI * self.alpha.x * self.alpha.y;
        let d = match self.distribution {
            Distribution::Beckmann => (-slope2 / cos2).exp() / (scale * cos2 * cos2),
            Distribution::Ggx => 1.0 / (scale * (slope2 + cos2).powi(2)),
        };
        if d * m.z > NEGLIGIBLE { d } else { 0.0 }
    }

    /// Share of the microfacets with normal `m` that direction `v` sees. [Walter07, eqs. 27 and 34].
    #[inline]
    pub fn g1(&self, v: DVec3, m: DVec3) -> f64 {
        // From above one sees no back of a facet, and the reverse.
        if v.dot(m) * v.z <= 0.0 {
            return 0.0;
        }
        let slope2 = (self.alpha.x * v.x).powi(2) + (self.alpha.y * v.y).powi(2);
        if slope2 == 0.0 {
            return 1.0;
        }
        let tan2 = slope2 / (v.z * v.z);
        match self.distribution {
            Distribution::Ggx => 2.0 / (1.0 + (1.0 + tan2).sqrt()),
            Distribution::Beckmann => {
                let a = 1.0 / tan2.sqrt();
                if a >= 1.6 { 1.0 } else { (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a) }
            }
        }
    }

    /// Density per steradian of [`Self::sample`] for a direction `v` above the surface. [Heitz14].
    #[inline]
    pub fn pdf(&self, v: DVec3, m: DVec3) -> f64 {
        self.d(m) * self.g1(v, m) * v.dot(m).abs() / v.z
    }

    /// A normal that `v` (v.z > 0) sees, from a point `u` of the unit square.
    #[inline]
    pub fn sample(&self, v: DVec3, u: DVec2) -> DVec3 {
        let stretched = self.stretched(v);
        let slope = match self.distribution {
            Distribution::Beckmann => DVec2::new(beckmann_slope(stretched.z, u.x), gaussian_slope(u.y)),
            Distribution::Ggx => ggx_slopes(stretched.z, disk(u)),
        };
        self.normal_of(stretched, slope)
    }

    /// Mean of `f` over the normals that `v` sees, by Gauss-Legendre points of the unit square, `points` on each side.
    ///
    /// For GGX the map of [`Self::sample`] has creases along the diagonals of the disk, which cost accuracy. Tables that must
    /// equal Mitsuba's need the same; for others see [`Self::smooth_mean`].
    pub fn mean<const N: usize>(&self, v: DVec3, points: usize, mut f: impl FnMut(DVec3) -> [f64; N]) -> [f64; N] {
        let stretched = self.stretched(v);
        let (nodes, weights) = &*gauss_legendre(points);
        let across: Vec<f64> = match self.distribution {
            Distribution::Beckmann => nodes.iter().map(|&u| gaussian_slope(u)).collect(),
            Distribution::Ggx => Vec::new(),
        };
        let mut sums = [0.0; N];
        for (i, &x) in nodes.iter().enumerate() {
            let along = if across.is_empty() { 0.0 } else { beckmann_slope(stretched.z, x) };
            for (j, &y) in nodes.iter().enumerate() {
                let slope = match self.distribution {
                    Distribution::Beckmann => DVec2::new(along, across[j]),
                    Distribution::Ggx => ggx_slopes(stretched.z, disk(DVec2::new(x, y))),
                };
                add(&mut sums, weights[i] * weights[j], f(self.normal_of(stretched, slope)));
            }
        }
        sums
    }

    /// The same mean by points that suit the distribution: for GGX rings of the disk.
    pub fn smooth_mean<const N: usize>(&self, v: DVec3, points: usize, mut f: impl FnMut(DVec3) -> [f64; N]) -> [f64; N] {
        if self.distribution == Distribution::Beckmann {
            return self.mean(v, points, f);
        }
        let stretched = self.stretched(v);
        // More rings than spokes: where mirrored light reaches the horizon, the mean has a crease along a ring.
        let (nodes, weights) = &*gauss_legendre(2 * points);
        let mut sums = [0.0; N];
        for (x, weight) in nodes.iter().zip(weights) {
            // The radius as a sine: normals depend on the height above the disk, which then has no root at the rim.
            let (radius, height) = (FRAC_PI_2 * x).sin_cos();
            let weight = weight * PI * radius * height / points as f64;
            for k in 0..points {
                let (sin, cos) = (2.0 * PI * (k as f64 + 0.5) / points as f64).sin_cos();
                let slope = ggx_slopes(stretched.z, DVec2::new(radius * cos, radius * sin));
                add(&mut sums, weight, f(self.normal_of(stretched, slope)));
            }
        }
        sums
    }

    fn stretched(&self, v: DVec3) -> DVec3 {
        DVec3::new(self.alpha.x * v.x, self.alpha.y * v.y, v.z).normalize()
    }

    /// The normal of a facet whose slopes are `slope` in the plane of the stretched direction.
    fn normal_of(&self, stretched: DVec3, slope: DVec2) -> DVec3 {
        let sin2 = 1.0 - stretched.z * stretched.z;
        // Looking straight down, any azimuth will do.
        let (sin_phi, cos_phi) = if sin2 <= 4.0 * f64::EPSILON {
            (0.0, 1.0)
        } else {
            let scale = 1.0 / sin2.sqrt();
            ((stretched.y * scale).clamp(-1.0, 1.0), (stretched.x * scale).clamp(-1.0, 1.0))
        };
        let x = (cos_phi * slope.x - sin_phi * slope.y) * self.alpha.x;
        let y = (sin_phi * slope.x + cos_phi * slope.y) * self.alpha.y;
        DVec3::new(-x, -y, 1.0).normalize()
    }
}

/// Slope towards the viewer of a visible facet at roughness 1: the distribution function is inverted in the domain of erf, from
/// the solution for grazing view, by three Newton steps. [Jakob14].
fn beckmann_slope(cos: f64, u: f64) -> f64 {
    let tan = (1.0 - cos * cos).max(0.0).sqrt() / cos;
    let cot = 1.0 / tan;
    let top = libm::erf(cot);
    let u = u.clamp(1e-6, 1.0 - 1e-6);
    let over_sqrt_pi = 0.5 * FRAC_2_SQRT_PI * tan;
    let mut x = top - (top + 1.0) * libm::erf((-u.ln()).sqrt());
    let target = u * (1.0 + top + over_sqrt_pi * (-cot * cot).exp());
    for _ in 0..3 {
        let slope = erf_inverse(x);
        let value = 1.0 + x + over_sqrt_pi * (-slope * slope).exp() - target;
        x -= value / (1.0 - slope * tan);
    }
    erf_inverse(x)
}

/// Slope across the plane of view at roughness 1: a Gaussian.
fn gaussian_slope(u: f64) -> f64 {
    erf_inverse(2.0 * u.clamp(1e-6, 1.0 - 1e-6) - 1.0)
}

fn add<const N: usize>(sums: &mut [f64; N], weight: f64, values: [f64; N]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
}

/// Slopes of a visible facet at roughness 1, from a point `p` of the disk: that is bent into the two half-disks to which the
/// visible hemisphere projects. [Heitz18].
fn ggx_slopes(cos: f64, p: DVec2) -> DVec2 {
    let upper = (1.0 - p.x * p.x).max(0.0).sqrt();
    let y = upper + (p.y - upper) * 0.5 * (1.0 + cos);
    let z = (1.0 - p.x * p.x - y * y).max(0.0).sqrt();
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    DVec2::new(cos * y - sin * z, p.x) / (sin * y + cos * z)
}

/// The concentric map in f64 ([Shirley97]; `math::warp::disk` is its twin in f32).
fn disk(u: DVec2) -> DVec2 {
    let p = 2.0 * u - DVec2::ONE;
    if p == DVec2::ZERO {
        return p;
    }
    let (radius, angle) =
        if p.x.abs() >= p.y.abs() { (p.x, FRAC_PI_4 * p.y / p.x) } else { (p.y, FRAC_PI_2 - FRAC_PI_4 * p.x / p.y) };
    let (sin, cos) = angle.sin_cos();
    DVec2::new(radius * cos, radius * sin)
}

/// Inverse of erf, to 1e-12: the fit of [Giles12] and one Newton step.
fn erf_inverse(x: f64) -> f64 {
    let x = x.clamp(-1.0 + 1e-15, 1.0 - 1e-15);
    let horner = |w: f64, terms: &[f64]| terms.iter().fold(0.0, |sum, term| sum * w + term);
    let w = -((1.0 - x) * (1.0 + x)).ln();
    let start = x * if w < 5.0 {
        horner(
            w - 2.5,
            &[
                2.810_226_36e-8,
                3.432_739_39e-7,
                -3.523_387_7e-6,
                -4.391_506_54e-6,
                2.185_808_7e-4,
                -1.253_725_03e-3,
                -4.177_681_64e-3,
                0.246_640_727,
                1.501_409_41,
            ],
        )
    } else {
        horner(
            w.sqrt() - 3.0,
            &[
                -2.002_142_57e-4,
                1.009_505_58e-4,
                1.349_343_22e-3,
                -3.673_428_44e-3,
                5.739_507_73e-3,
                -7.622_461_3e-3,
                9.438_870_47e-3,
                1.001_674_06,
                2.832_976_82,
            ],
        )
    };
    start - (libm::erf(start) - x) / (FRAC_2_SQRT_PI * (-start * start).exp())
}

/// The direction `v` mirrored in the plane of normal `m`.
#[inline]
pub fn reflected(v: DVec3, m: DVec3) -> DVec3 {
    m * (2.0 * v.dot(m)) - v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_of_erf_is_its_inverse() {
        for i in 1..200 {
            let y = -3.5 + 7.0 * f64::from(i) / 200.0;
            let got = erf_inverse(libm::erf(y));
            assert!((got - y).abs() < 1e-9 * (1.0 + (y * y).exp() * 1e-6), "{got}, expected {y}");
        }
    }

    #[test]
    fn distributions_project_to_the_surface_and_to_what_is_seen() {
        // int D(m) (n.m) dm = 1, and int D(m) G1(v, m) max(v.m, 0) dm = v.z. [Walter07, eq. 4; Heitz14].
        for distribution in [Distribution::Beckmann, Distribution::Ggx] {
            for (u, v) in [(0.3, 0.3), (0.2, 0.6)] {
                let facets = Microfacet::new(distribution, u, v);
                let view = DVec3::new(0.6, 0.48, 0.64);
                let (mut area, mut seen) = (0.0, 0.0);
                let n = 1200;
                for i in 0..n {
                    // Equal steps of the polar angle put nodes where the lobe is.
                    let theta = FRAC_PI_2 * (f64::from(i) + 0.5) / f64::from(n);
                    for j in 0..200 {
                        let phi = 2.0 * PI * (f64::from(j) + 0.5) / 200.0;
                        let m = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                        let weight = facets.d(m) * theta.sin() * FRAC_PI_2 / f64::from(n) * 2.0 * PI / 200.0;
                        area += weight * m.z;
                        seen += weight * facets.g1(view, m) * view.dot(m).max(0.0);
                    }
                }
                assert!((area - 1.0).abs() < 1e-3, "{distribution:?} {u} {v}: projected area {area}");
                // Beckmann's shadowing is a fit, good to 0.35 %.
                assert!((seen / view.z - 1.0).abs() < 4e-3, "{distribution:?} {u} {v}: seen {seen} of {}", view.z);
            }
        }
    }
}
