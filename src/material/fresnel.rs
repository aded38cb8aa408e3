//! Fresnel reflectance and Snell's law, in f64.

use crate::math::{DVec3, Rgb};

/// Unpolarised Fresnel reflectance of a dielectric boundary, and the cosine on the other side.
///
/// `cos_i` > 0 is the cosine on the side the light comes from, `eta` the index of the other side over that of this side. The
/// returned cosine is positive, or 0 under total internal reflection, where the reflectance is exactly 1. [Born99, section 1.5].
#[inline]
pub fn dielectric(cos_i: f64, eta: f64) -> (f64, f64) {
    // Without a step of the index there is no boundary, at grazing angles either.
    if eta == 1.0 {
        return (0.0, cos_i);
    }
    let sin2_t = (1.0 - cos_i * cos_i).max(0.0) / (eta * eta);
    if sin2_t >= 1.0 {
        return (1.0, 0.0);
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let r_p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    (0.5 * (r_s * r_s + r_p * r_p), cos_t)
}

/// A dielectric boundary as seen from either side.
#[derive(Debug, Clone, Copy)]
pub struct Boundary {
    /// Unpolarised Fresnel reflectance.
    pub reflectance: f64,
    /// Cosine of the refracted direction, of the sign opposite to the incident one; 0 under total internal reflection.
    pub cos_t: f64,
    /// Index of the far side over that of the incident side.
    pub eta_it: f64,
    /// Its inverse.
    pub eta_ti: f64,
}

/// The boundary met at signed cosine `cos_i`; `eta` is the index on the negative side over that on the positive side.
#[inline]
pub fn boundary(cos_i: f64, eta: f64) -> Boundary {
    let (eta_it, eta_ti) = if cos_i >= 0.0 { (eta, 1.0 / eta) } else { (1.0 / eta, eta) };
    let (reflectance, cos_t) = dielectric(cos_i.abs(), eta_it);
    Boundary { reflectance, cos_t: if cos_i >= 0.0 { -cos_t } else { cos_t }, eta_it, eta_ti }
}

impl Boundary {
    /// The direction `v`, which gave the cosine with normal `m`, refracted through the boundary.
    #[inline]
    pub fn refracted(&self, v: DVec3, m: DVec3) -> DVec3 {
        m * (v.dot(m) * self.eta_ti + self.cos_t) - v * self.eta_ti
    }
}

/// Unpolarised Fresnel reflectance of a metal of relative index `eta + i k`, per channel. [Born99, section 14.2].
#[inline]
pub fn conductor(cos_i: f64, eta: Rgb, k: Rgb) -> Rgb {
    let one = |eta: f64, k: f64| {
        let (c2, s2) = (cos_i * cos_i, (1.0 - cos_i * cos_i).max(0.0));
        let t0 = eta * eta - k * k - s2;
        let a2_plus_b2 = (t0 * t0 + 4.0 * eta * eta * k * k).sqrt();
        let t1 = a2_plus_b2 + c2;
        let a = (0.5 * (a2_plus_b2 + t0)).max(0.0).sqrt();
        let t2 = 2.0 * a * cos_i;
        let r_s = (t1 - t2) / (t1 + t2);
        let t3 = c2 * a2_plus_b2 + s2 * s2;
        let t4 = t2 * s2;
        let r_p = r_s * (t3 - t4) / (t3 + t4);
        0.5 * (r_s + r_p)
    };
    Rgb::new(one(eta.r, k.r), one(eta.g, k.g), one(eta.b, k.b))
}

/// Fresnel reflectance of a dielectric averaged over a cosine-weighted hemisphere: 2 int_0^1 F(mu) mu dmu.
///
/// `eta` is the index of the far side over that of the near side. By composite Gauss-Legendre quadrature on both sides of the
/// critical angle; the means at 1.5 and 1/1.5 obey their reciprocity relation
/// to 1e-8.
pub fn dielectric_mean(eta: f64) -> f64 {
    let critical = if eta < 1.0 { (1.0 - eta * eta).sqrt() } else { 0.0 };
    // Below the critical cosine the reflectance is 1. Above it, mu = critical + (1 - critical) s^2 removes the root singularity.
    let n = 2048;
    let span = 1.0 - critical;
    let sum: crate::math::CompensatedSum = (0..n)
        .flat_map(|i| {
            let node = 0.5 / 3.0_f64.sqrt();
            [0.5 - node, 0.5 + node].map(|x| {
                let s = (f64::from(i) + x) / f64::from(n);
                let mu = critical + span * s * s;
                dielectric(mu, eta).0 * mu * span * 2.0 * s / (2.0 * f64::from(n))
            })
        })
        .collect();
    critical * critical + 2.0 * sum.value()
}

/// The same by the fits that Mitsuba uses in place of the integral: [Egan73] below 1, [dEon11] above. Accurate to 0.6 % for
/// indices from 1/2 to 10.
pub fn dielectric_mean_fit(eta: f64) -> f64 {
    let inverse = 1.0 / eta;
    if eta < 1.0 {
        return 0.0636 * inverse + 0.6681 + eta * (0.7099 - 1.4399 * eta);
    }
    let terms = [-1.36881, 4.98554, -7.80989, 6.75335, -3.4793, 0.919317];
    terms.iter().fold(0.0, |sum, term| sum * inverse + term)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_incidence_and_grazing_are_exact() {
        assert!((dielectric(1.0, 1.5).0 - 0.04).abs() < 1e-15);
        assert!((dielectric(1e-9, 1.5).0 - 1.0).abs() < 1e-7);
        let (eta, k) = (Rgb::grey(0.2), Rgb::grey(3.0));
        let want = ((0.2_f64 - 1.0).powi(2) + 9.0) / ((0.2_f64 + 1.0).powi(2) + 9.0);
        assert!((conductor(1.0, eta, k).r - want).abs() < 1e-12);
    }

    #[test]
    fn a_conductor_without_absorption_is_a_dielectric() {
        for cos in [0.1, 0.4, 0.9] {
            let want = dielectric(cos, 1.5).0;
            assert!((conductor(cos, Rgb::grey(1.5), Rgb::BLACK).g - want).abs() < 1e-12);
        }
    }

    #[test]
    fn the_fits_are_near_the_integral() {
        for (eta, tolerance) in [(1.5, 1e-3), (1.9, 1e-3), (2.5, 2e-3), (1.0 / 1.5, 1e-3), (1.0 / 1.9, 6e-3)] {
            let (fit, want) = (dielectric_mean_fit(eta), dielectric_mean(eta));
            assert!((fit / want - 1.0).abs() < tolerance, "eta {eta}: {fit}, expected {want}");
        }
    }

    #[test]
    fn the_mean_inside_and_outside_obey_their_relation() {
        // (1 - F_in) = (1 - F_out) / eta^2, by reciprocity of the n^2 scaled transmission.
        let (outside, inside) = (dielectric_mean(1.5), dielectric_mean(1.0 / 1.5));
        assert!((outside - 0.091_776).abs() < 1e-5, "{outside}");
        assert!(((1.0 - inside) * 2.25 - (1.0 - outside)).abs() < 1e-8, "{inside}");
    }
}
