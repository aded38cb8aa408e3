//! Rough metals: microfacets that each mirror. [Walter07, eq. 20].

use super::albedo::{AlbedoTable, Range};
use super::fresnel;
use super::microfacet::{Distribution, Microfacet, reflected};
use super::texture::Texture;
use crate::math::{DVec2, DVec3, Rgb, Vec2};
use std::sync::Arc;

/// A metal whose microfacets mirror.
#[derive(Debug, Clone)]
pub struct RoughConductor {
    distribution: Distribution,
    /// Roughness along the first and the second tangent.
    alpha: [Texture; 2],
    index: Option<(Rgb, Rgb)>,
    reflectance: Texture,
    albedo: Arc<AlbedoTable>,
}

/// Lowest and highest roughness that two textures give, as a table needs it.
pub(super) fn range_of(alpha: &[Texture; 2]) -> Range {
    if let [Texture::Constant(_), Texture::Constant(_)] = alpha {
        return Range::One(alpha[0].mean_scalar(), alpha[1].mean_scalar());
    }
    let low = alpha.iter().map(Texture::min_scalar).fold(f64::INFINITY, f64::min).max(1e-4);
    let high = alpha.iter().map(Texture::max_scalar).fold(low, f64::max);
    Range::Between(low, high)
}

/// True unless both are known to be the same.
pub(super) fn differ([u, v]: &[Texture; 2]) -> bool {
    match (u, v) {
        (Texture::Constant(u), Texture::Constant(v)) => u != v,
        // The reader gives one texture twice where the file has only one.
        (Texture::Bitmap(u), Texture::Bitmap(v)) => !std::sync::Arc::ptr_eq(&u.texels, &v.texels),
        _ => true,
    }
}

impl RoughConductor {
    /// A metal of complex index eta + i k (`None`: reflectance 1), roughness `alpha` along the tangents, and a factor on what it
    /// reflects.
    pub fn new(distribution: Distribution, alpha: [Texture; 2], index: Option<(Rgb, Rgb)>, reflectance: Texture) -> Self {
        let albedo = AlbedoTable::new(distribution, range_of(&alpha), |facets, v, m| {
            let wi = reflected(v, m);
            let shadowing = if wi.z > 0.0 { facets.g1(wi, m) } else { 0.0 };
            (fresnel_of(index, v.dot(m)) * shadowing).to_array()
        });
        Self { distribution, alpha, index, reflectance, albedo: Arc::new(albedo) }
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

    /// f cos(theta_i) for directions above the surface.
    #[inline]
    pub fn eval(&self, wo: DVec3, wi: DVec3, uv: Vec2) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::BLACK;
        }
        let facets = self.facets(uv);
        let m = (wo + wi).normalize();
        let value = facets.d(m) * facets.g1(wo, m) * facets.g1(wi, m) / (4.0 * wo.z);
        self.reflectance.at(uv) * fresnel_of(self.index, wo.dot(m)) * value
    }

    /// Density of [`Self::sample`] per steradian.
    #[inline]
    pub fn pdf(&self, wo: DVec3, wi: DVec3, uv: Vec2) -> f64 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        reflection_pdf(&self.facets(uv), wo, wi)
    }

    /// A direction by way of a normal that `wo` sees, and f cos(theta_i) over its density.
    #[inline]
    pub fn sample(&self, wo: DVec3, uv: Vec2, u: DVec2) -> Option<(DVec3, Rgb)> {
        if wo.z <= 0.0 {
            return None;
        }
        let facets = self.facets(uv);
        let m = facets.sample(wo, u);
        let wi = reflected(wo, m);
        let shadowing = if wi.z > 0.0 { facets.g1(wi, m) } else { 0.0 };
        let weight = self.reflectance.at(uv) * fresnel_of(self.index, wo.dot(m)) * shadowing;
        (shadowing > 0.0).then_some((wi, weight))
    }

    /// Share of a uniform light that goes towards `wo`.
    #[inline]
    pub fn albedo(&self, wo: DVec3, uv: Vec2) -> Rgb {
        if wo.z <= 0.0 {
            return Rgb::BLACK;
        }
        let [u, v] = self.alphas(uv);
        self.reflectance.at(uv) * Rgb::from(self.albedo.at(wo, u, v))
    }
}

/// Density of the direction `wi` that mirrors `wo` in a visible normal, both above the surface.
#[inline]
pub(super) fn reflection_pdf(facets: &Microfacet, wo: DVec3, wi: DVec3) -> f64 {
    let m = (wo + wi).normalize();
    if wi.dot(m) <= 0.0 { 0.0 } else { facets.d(m) * facets.g1(wo, m) / (4.0 * wo.z) }
}

#[inline]
fn fresnel_of(index: Option<(Rgb, Rgb)>, cos: f64) -> Rgb {
    index.map_or(Rgb::WHITE, |(eta, k)| fresnel::conductor(cos, eta, k))
}
