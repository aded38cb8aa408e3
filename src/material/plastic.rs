//! Diffuse albedo of coated materials, the nearest form in which they are supported so far.
//!
//! A smooth or rough dielectric coat over a Lambertian base of parameter rho lets through T on the way in and on the way out, and
//! reflects part of the light back down inside: the diffuse albedo is rho T² / (eta² (1 - rho F_in)), where T is the transmittance
//! averaged over a cosine-weighted hemisphere and F_in the mean internal reflectance (Mitsuba's `plastic` and `roughplastic`).

use super::fresnel;
use crate::math::Rgb;

/// Diffuse albedo of a coated base as a function of its reflectance parameter.
#[derive(Debug, Clone, Copy)]
pub struct CoatedAlbedo {
    transmitted: f64,
    internal: f64,
    nonlinear: bool,
}

impl CoatedAlbedo {
    /// Smooth coat of relative index `eta`. `nonlinear`: the colour shifts with internal scattering.
    pub fn smooth(eta: f64, nonlinear: bool) -> Self {
        let through = 1.0 - fresnel::dielectric_mean(eta);
        Self { transmitted: through * through / (eta * eta), internal: fresnel::dielectric_mean(1.0 / eta), nonlinear }
    }

    /// Albedo for reflectance parameter `rho`, per channel.
    pub fn of(&self, rho: Rgb) -> Rgb {
        rho.map(|rho| {
            let denominator = if self.nonlinear { 1.0 - rho * self.internal } else { 1.0 - self.internal };
            rho * self.transmitted / denominator
        })
    }
}
