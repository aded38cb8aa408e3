//! Diffuse albedo of coated materials, the nearest form in which they are supported so far.
//!
//! A smooth or rough dielectric coat over a Lambertian base of parameter rho lets through T on the way in and on the way out, and
//! reflects part of the light back down inside: the diffuse albedo is rho T² / (eta² (1 - rho F_in)), where T is the transmittance
//! averaged over a cosine-weighted hemisphere and F_in the mean internal reflectance (Mitsuba's `plastic` and `roughplastic`).

use super::fresnel;
use crate::math::{CompensatedSum, Rgb};
use std::f64::consts::PI;

/// Diffuse albedo of a coated base as a function of its reflectance parameter.
#[derive(Debug, Clone, Copy)]
pub struct CoatedAlbedo {
    transmitted: f64,
    internal: f64,
    gloss: f64,
    nonlinear: bool,
}

/// Distribution of microfacet normals, with its shadowing function G1. [Walter07, section 5.2].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Distribution {
    /// Gaussian slopes.
    Beckmann,
    /// Trowbridge-Reitz.
    Ggx,
}

impl CoatedAlbedo {
    /// Smooth coat of relative index `eta`. `nonlinear`: the colour shifts with internal scattering.
    pub fn smooth(eta: f64, nonlinear: bool) -> Self {
        let gloss = fresnel::dielectric_mean(eta);
        let through = 1.0 - gloss;
        let transmitted = through * through / (eta * eta);
        Self { transmitted, internal: fresnel::dielectric_mean(1.0 / eta), gloss, nonlinear }
    }

    /// Rough coat of relative index `eta` and roughness `alpha` > 0.
    ///
    /// Single scattering, as in Mitsuba: light that would meet the microfacets a second time is lost. Accuracy 1e-3.
    pub fn rough(eta: f64, alpha: f64, distribution: Distribution, nonlinear: bool) -> Self {
        // Below this roughness nothing differs from the smooth coat by more than 1e-3.
        if alpha < 1e-3 {
            return Self::smooth(eta, nonlinear);
        }
        let inward = Boundary { eta, alpha, distribution };
        let outward = Boundary { eta: 1.0 / eta, ..inward };
        let middle = |i, n| (f64::from(i) + 0.5) / f64::from(n);
        let through = mean(middle, |mu| inward.scatter(mu).transmitted);
        let gloss = mean(middle, |mu| inward.scatter(mu).reflected);
        // Mitsuba's mean runs over both ends of the interval and so comes out 1/64 lower than the integral.
        let internal = mean(|i, n| f64::from(i).max(1e-6) / f64::from(n - 1), |mu| outward.scatter(mu).reflected);
        Self { transmitted: through * through / (eta * eta), internal, gloss, nonlinear }
    }

    /// Share of a uniform light that the coat itself reflects.
    pub fn gloss(&self) -> f64 {
        self.gloss
    }

    /// Diffuse albedo for reflectance parameter `rho`, per channel.
    pub fn of(&self, rho: Rgb) -> Rgb {
        rho.map(|rho| {
            let denominator = if self.nonlinear { 1.0 - rho * self.internal } else { 1.0 - self.internal };
            rho * self.transmitted / denominator
        })
    }
}

/// 2 int f(mu) mu dmu over [0, 1] by the mean over 64 points: `point(i, 64)` is the i-th.
fn mean(point: impl Fn(u32, u32) -> f64, f: impl Fn(f64) -> f64) -> f64 {
    const N: u32 = 64;
    let sum: CompensatedSum = (0..N).map(|i| point(i, N)).map(|mu| 2.0 * mu * f(mu) / f64::from(N)).collect();
    sum.value()
}

/// A rough boundary as seen from one side.
#[derive(Debug, Clone, Copy)]
struct Boundary {
    /// Index of the far side over that of this side.
    eta: f64,
    alpha: f64,
    distribution: Distribution,
}

/// Shares of the light that leave a boundary after one scattering.
struct Scattered {
    reflected: f64,
    transmitted: f64,
}

impl Boundary {
    /// Shares of the light that arrives at cosine `mu`.
    ///
    /// Integral over microfacet normals m of F(wi.m), or of 1 - F, times G1(wi) G1(wo) (wi.m) D(m)/mu, wo being wi mirrored in m,
    /// or refracted [Walter07, eqs. 20, 21, 38-40]; m is spread by the density D(m) (n.m) on a regular grid.
    fn scatter(&self, mu: f64) -> Scattered {
        const N_THETA: u32 = 32;
        const N_PHI: u32 = 24;
        let sin = (1.0 - mu * mu).sqrt();
        let (mut reflected, mut transmitted) = (CompensatedSum::default(), CompensatedSum::default());
        let g1_i = self.distribution.g1(mu, self.alpha);
        for i in 0..N_THETA {
            // The long tail of the distribution, where 1 - u is small, needs a finer grid: 1 - u = rest².
            let rest = 1.0 - (f64::from(i) + 0.5) / f64::from(N_THETA);
            let tan2 = self.distribution.tan2_theta(1.0 - rest * rest, self.alpha);
            let cos_m = 1.0 / (1.0 + tan2).sqrt();
            let sin_m = (1.0 - cos_m * cos_m).max(0.0).sqrt();
            // The two halves around the plane of incidence are mirror images.
            for j in 0..N_PHI {
                let phi = PI * (f64::from(j) + 0.5) / f64::from(N_PHI);
                let wi_m = sin * sin_m * phi.cos() + mu * cos_m;
                if wi_m <= 0.0 {
                    continue;
                }
                let (f, cos_t) = fresnel::dielectric(wi_m, self.eta);
                let weight = g1_i * wi_m / (mu * cos_m) * 2.0 * rest / f64::from(N_THETA * N_PHI);
                let mu_reflected = 2.0 * wi_m * cos_m - mu;
                if mu_reflected > 0.0 {
                    reflected.add(weight * f * self.distribution.g1(mu_reflected, self.alpha));
                }
                // Cosine of the refracted direction below the surface.
                let mu_refracted = mu / self.eta - (wi_m / self.eta - cos_t) * cos_m;
                if f < 1.0 && mu_refracted > 0.0 {
                    transmitted.add(weight * (1.0 - f) * self.distribution.g1(mu_refracted, self.alpha));
                }
            }
        }
        Scattered { reflected: reflected.value(), transmitted: transmitted.value() }
    }
}

impl Distribution {
    /// Squared tangent of the angle that a share `u` of the projected microfacet area stays below. [Walter07, eqs. 28 and 35].
    fn tan2_theta(self, u: f64, alpha: f64) -> f64 {
        match self {
            Distribution::Beckmann => -alpha * alpha * (-u).ln_1p(),
            Distribution::Ggx => alpha * alpha * u / (1.0 - u),
        }
    }

    /// Share of the microfacets that is seen from cosine `mu`. [Walter07, eqs. 27 and 34].
    fn g1(self, mu: f64, alpha: f64) -> f64 {
        let tan2 = (1.0 - mu * mu).max(0.0) / (mu * mu);
        match self {
            Distribution::Ggx => 2.0 / (1.0 + (1.0 + alpha * alpha * tan2).sqrt()),
            Distribution::Beckmann => {
                let a = 1.0 / (alpha * tan2.sqrt());
                if a >= 1.6 { 1.0 } else { (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Albedos for rho = 0.1, 0.5, 0.8, 1 under uniform light that follow from Mitsuba 3.9.1's formulas and tables, found without
    /// this code; three digits.
    #[test]
    fn albedos_are_those_of_mitsuba() {
        let ggx = |alpha| CoatedAlbedo::rough(1.5, alpha, Distribution::Ggx, true);
        let cases = [
            ("smooth", CoatedAlbedo::smooth(1.5, true), [0.039, 0.261, 0.561, 0.910]),
            ("alpha 0.1", ggx(0.1), [0.039, 0.256, 0.531, 0.828]),
            ("alpha 0.2", ggx(0.2), [0.039, 0.245, 0.486, 0.722]),
        ];
        for (name, albedo, want) in cases {
            for (rho, want) in [0.1, 0.5, 0.8, 1.0].into_iter().zip(want) {
                let got = albedo.of(Rgb::grey(rho)).r;
                // The digits given, and Mitsuba's own fit of the smooth internal reflectance.
                assert!((got - want).abs() < 2e-3, "{name}, rho {rho}: {got}, expected {want}");
            }
        }
    }

    #[test]
    fn a_boundary_creates_no_light_and_a_nearly_smooth_one_loses_none() {
        for distribution in [Distribution::Beckmann, Distribution::Ggx] {
            for (eta, alpha) in [(1.5, 0.002), (1.5, 0.1), (1.5, 0.6), (1.0 / 1.5, 0.1), (1.0 / 1.5, 0.6), (2.4, 0.3)] {
                for mu in [0.05, 0.3, 0.7, 1.0] {
                    let Scattered { reflected, transmitted } = Boundary { eta, alpha, distribution }.scatter(mu);
                    let sum = reflected + transmitted;
                    assert!(sum < 1.001, "{distribution:?}, eta {eta}, alpha {alpha}, mu {mu}: {sum}");
                    if alpha < 0.01 && mu > 0.1 {
                        let smooth = fresnel::dielectric(mu, eta).0;
                        assert!(sum > 0.999, "{distribution:?}, mu {mu}: {sum}");
                        assert!((reflected - smooth).abs() < 1e-3, "{distribution:?}, mu {mu}: {reflected}, smooth {smooth}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_linear_coat_keeps_the_hue() {
        let albedo = CoatedAlbedo::smooth(1.5, false);
        let got = albedo.of(Rgb::new(0.2, 0.4, 0.8));
        assert!((got.g / got.r - 2.0).abs() < 1e-12 && (got.b / got.r - 4.0).abs() < 1e-12, "{got:?}");
        // All of a white base comes back out, one way or the other: rho = 1 gives 1 minus the outer reflection.
        let white = albedo.of(Rgb::WHITE).r;
        assert!((white - (1.0 - fresnel::dielectric_mean(1.5))).abs() < 1e-6, "{white}");
    }
}
