//! Tables of what rough boundaries reflect and transmit in all: directional albedos of microfacet lobes.

use super::microfacet::{Distribution, Microfacet};
use crate::math::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::{Arc, Mutex, PoisonError};

/// Nodes over the cosine, denser towards grazing angles.
const COSINES: usize = 96;
/// Nodes over the azimuth from 0 to a right angle, for anisotropic lobes.
const AZIMUTHS: usize = 17;
/// Nodes over the roughness, for lobes whose roughness is a texture.
const ROUGHNESSES: usize = 16;
/// Points along each coordinate of the normals.
const POINTS: usize = 48;

/// Values that each table holds side by side, for instance the colour channels.
pub const CHANNELS: usize = 3;

/// Roughnesses for which a table must serve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// One pair, along x and y.
    One(f64, f64),
    /// Any from the first to the second, the same along x and y.
    Between(f64, f64),
}

/// Directional albedo of a lobe over cosine and roughness or azimuth.
///
/// Exact to about 1e-3 for a fixed roughness, 2e-3 for an anisotropic one; for a textured one to about 1e-2, since its nodes are wider apart and both
/// roughnesses of an anisotropic one are replaced by their geometric mean.
#[derive(Debug, Clone)]
pub struct AlbedoTable {
    range: Range,
    values: Vec<[f64; CHANNELS]>,
}

impl AlbedoTable {
    /// Integrates `weight(facets, v, m)`, the lobe's value times cosine over the density of the normal m that v sees.
    pub fn new(
        distribution: Distribution,
        range: Range,
        weight: impl Fn(&Microfacet, DVec3, DVec3) -> [f64; CHANNELS] + Sync,
    ) -> Self {
        let rows = match range {
            Range::One(u, v) if u == v => 1,
            Range::One(..) => AZIMUTHS,
            Range::Between(..) => ROUGHNESSES,
        };
        let values = (0..rows * COSINES)
            .into_par_iter()
            .map(|i| {
                let at = (i / COSINES) as f64 / (rows.max(2) - 1) as f64;
                let root = (i % COSINES) as f64 / (COSINES - 1) as f64;
                let (azimuth, facets) = match range {
                    Range::One(u, v) => (at * FRAC_PI_2, Microfacet::new(distribution, u, v)),
                    Range::Between(low, high) => {
                        let alpha = low * (high / low).powf(at);
                        (0.0, Microfacet::new(distribution, alpha, alpha))
                    }
                };
                let view = above(root * root, azimuth);
                facets.smooth_mean(view, POINTS, |m| weight(&facets, view, m))
            })
            .collect();
        Self { range, values }
    }

    /// Albedo towards `v` (only its cosine and azimuth count) for the roughnesses at the point.
    #[inline]
    pub fn at(&self, v: DVec3, alpha_u: f64, alpha_v: f64) -> [f64; CHANNELS] {
        let rows = self.values.len() / COSINES;
        let place = match self.range {
            _ if rows == 1 => 0.0,
            Range::One(..) => v.y.abs().atan2(v.x.abs()) / FRAC_PI_2,
            Range::Between(low, high) if high > low => {
                (alpha_u * alpha_v).sqrt().clamp(low, high).log(high / low) - low.log(high / low)
            }
            Range::Between(..) => 0.0,
        };
        let (row, t) = split(place, rows);
        let (column, s) = split(v.z.abs().min(1.0).sqrt(), COSINES);
        let value = |row: usize, c: usize| {
            let [a, b] = [self.values[row * COSINES + column][c], self.values[row * COSINES + column + 1][c]];
            a + (b - a) * s
        };
        std::array::from_fn(|c| {
            let first = value(row, c);
            if t == 0.0 { first } else { first + (value(row + 1, c) - first) * t }
        })
    }
}

/// The interval of `n` nodes on [0, 1] in which `x` lies, and where in it.
fn split(x: f64, n: usize) -> (usize, f64) {
    if n < 2 {
        return (0, 0.0);
    }
    let x = x.clamp(0.0, 1.0) * (n - 1) as f64;
    let i = (x as usize).min(n - 2);
    (i, x - i as f64)
}

/// The unit vector of cosine `mu` at the given azimuth [rad].
pub fn above(mu: f64, azimuth: f64) -> DVec3 {
    // The limit of grazing view is approached, not reached: a density per visible area has no meaning there.
    let mu = mu.max(1e-6);
    let sin = (1.0 - mu * mu).max(0.0).sqrt();
    DVec3::new(sin * azimuth.cos(), sin * azimuth.sin(), mu)
}

/// Nodes and weights of a quadrature.
pub type Quadrature = (Vec<f64>, Vec<f64>);

/// Nodes and weights of Gauss-Legendre quadrature on [0, 1]; those asked for before are kept, since tables ask for the same thousands of times.
pub fn gauss_legendre(n: usize) -> Arc<Quadrature> {
    static KNOWN: Mutex<BTreeMap<usize, Arc<Quadrature>>> = Mutex::new(BTreeMap::new());
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry(n).or_insert_with(|| Arc::new(legendre_roots(n))).clone()
}

/// Roots of the Legendre polynomial by Newton's method.
fn legendre_roots(n: usize) -> Quadrature {
    (0..n)
        .map(|i| {
            let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..8 {
                let p = (2..=n).fold(DVec2::new(1.0, x), |p, k| {
                    let k = k as f64;
                    DVec2::new(p.y, ((2.0 * k - 1.0) * x * p.y - (k - 1.0) * p.x) / k)
                });
                slope = n as f64 * (x * p.y - p.x) / (x * x - 1.0);
                x -= p.y / slope;
            }
            (0.5 - 0.5 * x, 1.0 / ((1.0 - x * x) * slope * slope))
        })
        .unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauss_legendre_integrates_polynomials() {
        // Exact up to degree 2n - 1: int_0^1 x^k dx = 1/(k + 1).
        for n in [2, 5, 32, 128] {
            let (nodes, weights) = &*gauss_legendre(n);
            for k in [0, 1, 2 * n - 1] {
                let got: f64 = nodes.iter().zip(weights).map(|(x, w)| w * x.powi(k as i32)).sum();
                assert!((got * (k + 1) as f64 - 1.0).abs() < 1e-12, "n {n}, x^{k}: {got}");
            }
        }
    }

    #[test]
    fn white_ggx_loses_what_the_separable_shadowing_hides() {
        // At normal view and F = 1 the albedo is int D(m) G1(wi) cos(m) dm with wi the mirrored normal; by a fine midpoint rule.
        let alpha = 0.5;
        let table = AlbedoTable::new(Distribution::Ggx, Range::One(alpha, alpha), |facets, v, m| {
            [facets.g1(super::super::microfacet::reflected(v, m), m); CHANNELS]
        });
        let n = 200_000;
        let want: f64 = (0..n)
            .map(|i| {
                // tan² of the normal's angle from the distribution function of D cos.
                let u = (f64::from(i) + 0.5) / f64::from(n);
                let tan2 = alpha * alpha * u / (1.0 - u);
                let cos_wi = (1.0 - tan2) / (1.0 + tan2);
                let tan2_wi = 1.0 / (cos_wi * cos_wi) - 1.0;
                if cos_wi > 0.0 { 2.0 / (1.0 + (1.0 + alpha * alpha * tan2_wi).sqrt()) / f64::from(n) } else { 0.0 }
            })
            .sum();
        let got = table.at(DVec3::Z, alpha, alpha)[0];
        assert!((got - want).abs() < 1e-3, "{got}, expected {want}");
    }
}
