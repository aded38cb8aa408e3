//! Rough boundaries between two dielectrics: microfacets that reflect and refract. [Walter07, eqs. 20 and 21].

use super::albedo::{AlbedoTable, CHANNELS};
use super::fresnel;
use super::microfacet::{Distribution, Microfacet, reflected};
use super::rough_conductor::{differ, range_of};
use super::texture::Texture;
use crate::math::{DVec2, DVec3, Rgb, Vec2};
use std::sync::Arc;

/// A boundary whose microfacets reflect and refract.
#[derive(Debug, Clone)]
pub struct RoughDielectric {
    distribution: Distribution,
    /// Roughness along the first and the second tangent.
    alpha: [Texture; 2],
    /// Index below the surface over that above.
    eta: f64,
    reflectance: Texture,
    transmittance: Texture,
    /// Reflected and transmitted share for a viewer above and one below.
    albedo: Arc<[AlbedoTable; 2]>,
}

/// A direction that was drawn: where the light comes from, and f cos(theta_i) over the density.
#[derive(Debug, Clone, Copy)]
pub struct Drawn {
    /// Direction of the light.
    pub wi: DVec3,
    /// f cos(theta_i) over the density.
    pub weight: Rgb,
    /// Index on the light's side over that on the viewer's.
    pub eta: f64,
}

impl RoughDielectric {
    /// A boundary with index `eta` below over above, roughness `alpha` along the tangents, and factors on reflected and
    /// transmitted radiance.
    pub fn new(distribution: Distribution, alpha: [Texture; 2], eta: f64, reflectance: Texture, transmittance: Texture) -> Self {
        let range = range_of(&alpha);
        let table = |eta: f64| AlbedoTable::new(distribution, range, move |facets, v, m| shares(facets, v, m, eta));
        let albedo = Arc::new([table(eta), table(1.0 / eta)]);
        Self { distribution, alpha, eta, reflectance, transmittance, albedo }
    }

    /// True if the tangents may differ.
    pub fn is_anisotropic(&self) -> bool {
        differ(&self.alpha)
    }

    /// Roughnesses along the tangents.
    #[inline]
    pub fn alphas(&self, uv: Vec2) -> [f64; 2] {
        [self.alpha[0].scalar(uv), self.alpha[1].scalar(uv)]
    }

    #[inline]
    fn facets(&self, uv: Vec2) -> Microfacet {
        let [u, v] = self.alphas(uv);
        Microfacet::new(self.distribution, u, v)
    }

    /// Normal of the facet that connects the directions, on the upper side; the relative index; whether it reflects.
    #[inline]
    fn connect(&self, wo: DVec3, wi: DVec3) -> (DVec3, f64, bool) {
        let reflects = wo.z * wi.z > 0.0;
        let eta = if wo.z > 0.0 { self.eta } else { 1.0 / self.eta };
        let m = (wo + wi * if reflects { 1.0 } else { eta }).normalize();
        (if m.z < 0.0 { -m } else { m }, eta, reflects)
    }

    /// |f cos(theta_i)|, radiance scaled by n² across the boundary.
    #[inline]
    pub fn eval(&self, wo: DVec3, wi: DVec3, uv: Vec2) -> Rgb {
        if wo.z == 0.0 || wi.z == 0.0 {
            return Rgb::BLACK;
        }
        let (m, eta, reflects) = self.connect(wo, wi);
        let facets = self.facets(uv);
        let f = fresnel::boundary(wo.dot(m), self.eta).reflectance;
        let dg = facets.d(m) * facets.g1(wo, m) * facets.g1(wi, m);
        if reflects {
            return self.reflectance.at(uv) * (f * dg / (4.0 * wo.z.abs()));
        }
        let (o, i) = (wo.dot(m), wi.dot(m));
        // eta² of the half vector's Jacobian and the n² of radiance cancel.
        self.transmittance.at(uv) * ((1.0 - f) * dg * o * i / (wo.z * (o + eta * i).powi(2))).abs()
    }

    /// Density of [`Self::sample`] per steradian.
    #[inline]
    pub fn pdf(&self, wo: DVec3, wi: DVec3, uv: Vec2) -> f64 {
        if wo.z == 0.0 || wi.z == 0.0 {
            return 0.0;
        }
        let (m, eta, reflects) = self.connect(wo, wi);
        let (o, i) = (wo.dot(m), wi.dot(m));
        if o * wo.z <= 0.0 || i * wi.z <= 0.0 {
            return 0.0;
        }
        let f = fresnel::boundary(o, self.eta).reflectance;
        let (share, jacobian) = if reflects { (f, 0.25 / i) } else { (1.0 - f, eta * eta * i / (o + eta * i).powi(2)) };
        self.facets(uv).pdf(wo * wo.z.signum(), m) * share * jacobian.abs()
    }

    /// A direction by way of a normal that `wo` sees, reflected if `choice` is below its Fresnel reflectance.
    #[inline]
    pub fn sample(&self, wo: DVec3, uv: Vec2, u: DVec2, choice: f64) -> Option<Drawn> {
        if wo.z == 0.0 {
            return None;
        }
        let facets = self.facets(uv);
        let m = facets.sample(wo * wo.z.signum(), u);
        let boundary = fresnel::boundary(wo.dot(m), self.eta);
        let drawn = if choice <= boundary.reflectance {
            let wi = reflected(wo, m);
            Drawn { wi, weight: self.reflectance.at(uv) * facets.g1(wi, m), eta: 1.0 }
        } else {
            let wi = boundary.refracted(wo, m);
            let scale = boundary.eta_ti * boundary.eta_ti;
            Drawn { wi, weight: self.transmittance.at(uv) * (scale * facets.g1(wi, m)), eta: boundary.eta_it }
        };
        let right_side = (drawn.wi.z * wo.z > 0.0) == (drawn.eta == 1.0);
        (right_side && !drawn.weight.is_black()).then_some(drawn)
    }

    /// Share of a uniform light from both sides that goes towards `wo`, the n² of radiance included.
    #[inline]
    pub fn albedo(&self, wo: DVec3, uv: Vec2) -> Rgb {
        let [u, v] = self.alphas(uv);
        let [reflected, transmitted, _] = self.albedo[usize::from(wo.z < 0.0)].at(wo, u, v);
        self.reflectance.at(uv) * reflected + self.transmittance.at(uv) * transmitted
    }
}

/// Share of what a facet of normal `m` reflects and transmits towards `v`, n² included, and transmits without it.
pub(super) fn shares(facets: &Microfacet, v: DVec3, m: DVec3, eta: f64) -> [f64; CHANNELS] {
    let boundary = fresnel::boundary(v.dot(m), eta);
    let wi = reflected(v, m);
    let up = if wi.z > 0.0 { facets.g1(wi, m) * boundary.reflectance } else { 0.0 };
    let wi = boundary.refracted(v, m);
    let through = if wi.z < 0.0 { facets.g1(wi, m) * (1.0 - boundary.reflectance) } else { 0.0 };
    [up, through * boundary.eta_ti * boundary.eta_ti, through]
}
