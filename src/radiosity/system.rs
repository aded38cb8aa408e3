//! The linear system as the solvers see it: numbers, never triangles.

use crate::form_factor::FormFactors;
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
    pub form_factors: &'a dyn FormFactors,
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

    /// sum_j F_ij rho_j H_j of one patch.
    #[inline]
    pub fn reflected_to(&self, i: usize, irradiance: &[Rgb]) -> Rgb {
        let mut sum = Rgb::BLACK;
        self.form_factors.row(i, &mut |j, f| sum += self.rho[j] * irradiance[j] * f);
        sum
    }

    /// out = F rho x: one product with the form factors, for all patches.
    pub fn reflect(&self, x: &[Rgb], out: &mut [Rgb]) {
        let radiosity: Vec<Rgb> = x.iter().zip(self.rho).map(|(x, rho)| *x * *rho).collect();
        self.form_factors.gather(&radiosity, out);
    }

    /// S + F rho x - x.
    pub fn residual(&self, x: &[Rgb]) -> Vec<Rgb> {
        let mut r = vec![Rgb::BLACK; self.len()];
        self.reflect(x, &mut r);
        r.iter_mut().zip(&self.source).zip(x).for_each(|((r, s), x)| *r = *s + *r - *x);
        r
    }

    /// Area-weighted mean irradiance of `patches`, the largest channel.
    pub fn mean_irradiance(&self, patches: &[usize], irradiance: &[Rgb]) -> f64 {
        let weighted: Rgb = patches.iter().map(|&i| irradiance[i] * self.area[i]).sum();
        let area: f64 = patches.iter().map(|&i| self.area[i]).sum();
        if area > 0.0 { weighted.max() / area } else { 0.0 }
    }
}
