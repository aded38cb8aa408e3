//! The linear system as the solvers see it: numbers, never triangles.

use crate::form_factor::FormFactorMatrix;
use crate::math::Rgb;

/// Unknown: irradiance H_i [W/m²] of each patch. With reflected radiosity R_j = rho_j H_j,
/// H_i = S_i + sum_j F_ij R_j, where F has a direct part and a coloured one through specular surfaces.
///
/// The source S holds all light that has not been reflected by a patch: of lamps by shadow rays, of glowing walls by form factors.
/// Irradiance is unknown rather than radiosity, so that a black patch needs no division by rho.
pub struct RadiositySystem<'a> {
    /// Diffuse reflectance of each patch.
    pub rho: &'a [Rgb],
    /// Area of each patch [m²].
    pub area: &'a [f64],
    /// Form factors.
    pub form_factors: &'a FormFactorMatrix,
    /// Irradiance of each patch from light that no patch has reflected yet [W/m²].
    pub source: Vec<Rgb>,
}

impl RadiositySystem<'_> {
    /// Number of patches.
    pub fn len(&self) -> usize {
        self.rho.len()
    }

    /// True if there are no patches.
    pub fn is_empty(&self) -> bool {
        self.rho.is_empty()
    }

    /// S_i + sum_j F_ij rho_j H_j.
    #[inline]
    pub fn gathered(&self, i: usize, irradiance: &[Rgb]) -> Rgb {
        let direct: Rgb = self.form_factors.direct(i).map(|(j, f)| self.rho[j] * irradiance[j] * f).sum();
        let specular: Rgb = self.form_factors.specular(i).map(|(j, f)| self.rho[j] * irradiance[j] * f).sum();
        self.source[i] + direct + specular
    }

    /// Largest over rows and channels of sum_j F_ij rho_j: bounds the spectral radius, and by it the error.
    pub fn spectral_bound(&self) -> f64 {
        let row = |i: usize| {
            let direct: Rgb = self.form_factors.direct(i).map(|(j, f)| self.rho[j] * f).sum();
            let specular: Rgb = self.form_factors.specular(i).map(|(j, f)| self.rho[j] * f).sum();
            (direct + specular).max()
        };
        (0..self.len()).map(row).fold(0.0, f64::max)
    }

    /// Area-weighted mean irradiance, the largest channel.
    pub fn mean_irradiance(&self, irradiance: &[Rgb]) -> f64 {
        let weighted: Rgb = irradiance.iter().zip(self.area).map(|(h, a)| *h * *a).sum();
        let area: f64 = self.area.iter().sum();
        if area > 0.0 { weighted.max() / area } else { 0.0 }
    }
}
