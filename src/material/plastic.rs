//! A diffuse base under a dielectric coat, smooth or rough; Mitsuba's `plastic` and `roughplastic`.
//!
//! Light crosses the coat on the way in and on the way out. Between base and coat it may go back and forth, which the factor
//! 1/(1 - rho F_in) sums; F_in is the coat's mean internal reflectance. The radiance that the base sends out shrinks by eta².

use super::albedo::{AlbedoTable, CHANNELS, Range, above};
use super::fresnel;
use super::microfacet::{Distribution, Microfacet, reflected};
use super::rough_conductor::reflection_pdf;
use super::rough_dielectric::shares;
use super::texture::Texture;
use crate::math::{DVec2, DVec3, Rgb, Vec2};
use rayon::prelude::*;
use std::collections::HashMap;
use std::f64::consts::FRAC_1_PI;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

/// Nodes of Mitsuba's table of transmittances over the cosine, both ends included.
const NODES: usize = 64;

/// The base of a plastic, with what the coat does to its light.
#[derive(Debug, Clone)]
pub struct Base {
    /// Reflectance parameter rho, in [0, 1] per channel; not an albedo.
    pub reflectance: Texture,
    /// True: the colour shifts with internal scattering.
    pub nonlinear: bool,
}

impl Base {
    /// rho/(1 - rho F_in), or with a linear coat rho/(1 - F_in).
    #[inline]
    fn scattered(&self, internal: f64, uv: Vec2) -> Rgb {
        let rho = self.reflectance.at(uv);
        if self.nonlinear { rho.map(|rho| rho / (1.0 - rho * internal)) } else { rho / (1.0 - internal) }
    }
}

/// Share of the samples that a path tracer gives to the coat, before the angle counts.
fn coat_share(base: &Base, tint: &Texture) -> f64 {
    let (base, coat) = (base.reflectance.mean_scalar(), tint.mean_scalar());
    if base + coat > 0.0 { coat / (base + coat) } else { 1.0 }
}

/// Smooth coat: an ideal reflection above a diffuse base.
#[derive(Debug, Clone)]
pub struct Plastic {
    /// Index of the coat over that outside.
    pub eta: f64,
    base: Base,
    tint: Texture,
    /// Mean reflectance of the coat from inside, by the fit that Mitsuba uses.
    internal: f64,
    /// Mean transmittance of the coat from outside.
    transmitted: f64,
    coat_share: f64,
}

impl Plastic {
    /// A coat of index `eta`, reflecting with the factor `tint`, on `base`.
    pub fn new(eta: f64, base: Base, tint: Texture) -> Self {
        let coat_share = coat_share(&base, &tint);
        let (internal, external) = (fresnel::dielectric_mean_fit(1.0 / eta), fresnel::dielectric_mean(eta));
        Self { eta, base, tint, internal, transmitted: 1.0 - external, coat_share }
    }

    fn through(&self, cos: f64) -> f64 {
        1.0 - fresnel::dielectric(cos, self.eta).0
    }

    /// f cos(theta_i) of the base.
    #[inline]
    pub fn eval(&self, wo: DVec3, wi: DVec3, uv: Vec2) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::BLACK;
        }
        let through = self.through(wo.z) * self.through(wi.z) / (self.eta * self.eta);
        self.base.scattered(self.internal, uv) * (through * wi.z * FRAC_1_PI)
    }

    /// Share of a uniform light that the base sends towards a viewer at cosine `cos`.
    #[inline]
    pub fn base_toward(&self, cos: f64, uv: Vec2) -> Rgb {
        if cos <= 0.0 {
            return Rgb::BLACK;
        }
        self.base.scattered(self.internal, uv) * (self.through(cos) * self.transmitted / (self.eta * self.eta))
    }

    /// Mean of [`Self::base_toward`] over a cosine-weighted hemisphere.
    #[inline]
    pub fn base_albedo(&self, uv: Vec2) -> Rgb {
        self.base.scattered(self.internal, uv) * (self.transmitted / self.eta).powi(2)
    }

    /// Factor on radiance mirrored by the coat at cosine `cos` > 0.
    #[inline]
    pub fn mirrored(&self, cos: f64, uv: Vec2) -> Rgb {
        self.tint.at(uv) * fresnel::dielectric(cos, self.eta).0
    }

    /// Probability with which a path tracer follows the mirrored ray.
    #[inline]
    pub fn mirror_probability(&self, cos: f64) -> f64 {
        let f = fresnel::dielectric(cos, self.eta).0;
        let (coat, base) = (f * self.coat_share, (1.0 - f) * (1.0 - self.coat_share));
        coat / (coat + base)
    }
}

/// Rough coat: a glossy lobe above a diffuse base.
#[derive(Debug, Clone)]
pub struct RoughPlastic {
    /// Index of the coat over that outside.
    pub eta: f64,
    alpha: f64,
    facets: Microfacet,
    base: Base,
    tint: Texture,
    coat: Arc<Coat>,
    coat_share: f64,
}

/// What a rough coat lets through and reflects; the same for all materials of one roughness and index.
#[derive(Debug)]
struct Coat {
    /// Transmittance from outside at cosines i/63.
    transmittance: [f64; NODES],
    /// Its mean over a cosine-weighted hemisphere.
    transmitted: f64,
    /// Mean reflectance from inside.
    internal: f64,
    /// Directional albedo of the coat itself.
    gloss: AlbedoTable,
}

type CoatKey = (Distribution, u64, u64);

/// Coats made so far: their tables take long and interiors use few.
static COATS: LazyLock<Mutex<HashMap<CoatKey, Arc<Coat>>>> = LazyLock::new(Mutex::default);

impl Coat {
    fn shared(distribution: Distribution, alpha: f64, eta: f64) -> Arc<Self> {
        let key = (distribution, alpha.to_bits(), eta.to_bits());
        // A map of finished tables is sound whatever became of the thread that held it.
        let known = || COATS.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(coat) = known().get(&key) {
            return coat.clone();
        }
        let coat = Arc::new(Self::new(distribution, alpha, eta));
        known().insert(key, coat.clone());
        coat
    }

    /// The tables as Mitsuba makes them: Gauss-Legendre means over visible normals, 32² points from outside and 128² from inside;
    /// the internal mean runs over both ends of the interval and so comes out 1/64 below the integral.
    fn new(distribution: Distribution, alpha: f64, eta: f64) -> Self {
        let facets = Microfacet::new(distribution, alpha, alpha);
        let points = |eta: f64| if eta > 1.0 { 32 } else { 128 };
        let nodes: Vec<[f64; 2]> = (0..NODES)
            .into_par_iter()
            .map(|i| {
                let view = above(i as f64 / (NODES - 1) as f64, 0.0);
                let [.., outside] = facets.mean(view, points(eta), |m| shares(&facets, view, m, eta));
                let [inside, ..] = facets.mean(view, points(1.0 / eta), |m| shares(&facets, view, m, 1.0 / eta));
                [outside, inside * view.z]
            })
            .collect();
        let transmittance: [f64; NODES] = std::array::from_fn(|i| nodes[i][0]);
        let internal = 2.0 * nodes.iter().map(|n| n[1]).sum::<f64>() / NODES as f64;
        // Exact for the straight lines between the nodes: 2 int T(mu) mu dmu.
        let step = 1.0 / (NODES - 1) as f64;
        let transmitted = transmittance
            .windows(2)
            .enumerate()
            .map(|(i, pair)| {
                let at = i as f64 * step;
                2.0 * step * (at * 0.5 * (pair[0] + pair[1]) + step * (pair[0] + 2.0 * pair[1]) / 6.0)
            })
            .sum();
        let gloss = AlbedoTable::new(distribution, Range::One(alpha, alpha), |facets, v, m| {
            let wi = reflected(v, m);
            let shadowing = if wi.z > 0.0 { facets.g1(wi, m) } else { 0.0 };
            [fresnel::boundary(v.dot(m), eta).reflectance * shadowing; CHANNELS]
        });
        Self { transmittance, transmitted, internal, gloss }
    }

    #[inline]
    fn through(&self, cos: f64) -> f64 {
        let x = cos * (NODES - 1) as f64;
        let i = (x as usize).min(NODES - 2);
        let (a, b) = (self.transmittance[i], self.transmittance[i + 1]);
        a + (b - a) * (x - i as f64)
    }
}

impl RoughPlastic {
    /// A coat of index `eta` and roughness `alpha` > 0, reflecting with the factor `tint`, on `base`.
    pub fn new(distribution: Distribution, alpha: f64, eta: f64, base: Base, tint: Texture) -> Self {
        let coat_share = coat_share(&base, &tint);
        let facets = Microfacet::new(distribution, alpha, alpha);
        Self { eta, alpha, facets, base, tint, coat: Coat::shared(distribution, alpha, eta), coat_share }
    }

    /// Roughness of the coat.
    #[inline]
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// f cos(theta_i) of the base.
    #[inline]
    pub fn eval_base(&self, wo: DVec3, wi: DVec3, uv: Vec2) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::BLACK;
        }
        let through = self.coat.through(wo.z) * self.coat.through(wi.z) / (self.eta * self.eta);
        self.base.scattered(self.coat.internal, uv) * (through * wi.z * FRAC_1_PI)
    }

    /// f cos(theta_i) of the coat.
    #[inline]
    pub fn eval_coat(&self, wo: DVec3, wi: DVec3, uv: Vec2) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::BLACK;
        }
        let m = (wo + wi).normalize();
        let f = fresnel::boundary(wo.dot(m), self.eta).reflectance;
        let value = f * self.facets.d(m) * self.facets.g1(wo, m) * self.facets.g1(wi, m) / (4.0 * wo.z);
        self.tint.at(uv) * value
    }

    /// Density of [`Self::sample_coat`] per steradian.
    #[inline]
    pub fn coat_pdf(&self, wo: DVec3, wi: DVec3) -> f64 {
        if wo.z <= 0.0 || wi.z <= 0.0 { 0.0 } else { reflection_pdf(&self.facets, wo, wi) }
    }

    /// A direction by way of a normal that `wo` sees, and f cos(theta_i) of the coat over its density.
    #[inline]
    pub fn sample_coat(&self, wo: DVec3, uv: Vec2, u: DVec2) -> Option<(DVec3, Rgb)> {
        if wo.z <= 0.0 {
            return None;
        }
        let m = self.facets.sample(wo, u);
        let wi = reflected(wo, m);
        let shadowing = if wi.z > 0.0 { self.facets.g1(wi, m) } else { 0.0 };
        let f = fresnel::boundary(wo.dot(m), self.eta).reflectance;
        (shadowing > 0.0).then(|| (wi, self.tint.at(uv) * (f * shadowing)))
    }

    /// Share of a uniform light that the coat reflects towards `wo`.
    #[inline]
    pub fn coat_albedo(&self, wo: DVec3, uv: Vec2) -> Rgb {
        if wo.z <= 0.0 { Rgb::BLACK } else { self.tint.at(uv) * self.coat.gloss.at(wo, self.alpha, self.alpha)[0] }
    }

    /// Share of a uniform light that the base sends towards a viewer at cosine `cos`.
    #[inline]
    pub fn base_toward(&self, cos: f64, uv: Vec2) -> Rgb {
        if cos <= 0.0 {
            return Rgb::BLACK;
        }
        let through = self.coat.through(cos) * self.coat.transmitted / (self.eta * self.eta);
        self.base.scattered(self.coat.internal, uv) * through
    }

    /// Mean of [`Self::base_toward`] over a cosine-weighted hemisphere.
    #[inline]
    pub fn base_albedo(&self, uv: Vec2) -> Rgb {
        self.base.scattered(self.coat.internal, uv) * (self.coat.transmitted / self.eta).powi(2)
    }

    /// Probability with which a path tracer samples the coat.
    #[inline]
    pub fn coat_probability(&self, cos: f64) -> f64 {
        let through = self.coat.through(cos);
        let (coat, base) = ((1.0 - through) * self.coat_share, through * (1.0 - self.coat_share));
        coat / (coat + base)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(rho: f64, nonlinear: bool) -> Base {
        Base { reflectance: Texture::Constant(Rgb::grey(rho)), nonlinear }
    }

    fn white() -> Texture {
        Texture::Constant(Rgb::WHITE)
    }

    /// Albedos for rho = 0.1, 0.5, 0.8, 1 under uniform light that follow from Mitsuba 3.9.1's formulas and tables, found without
    /// this code; three digits.
    #[test]
    fn albedos_are_those_of_mitsuba() {
        let ggx =
            |rho, alpha| RoughPlastic::new(Distribution::Ggx, alpha, 1.5, grey(rho, true), white()).base_albedo(Vec2::ZERO).r;
        let smooth = |rho| Plastic::new(1.5, grey(rho, true), white()).base_albedo(Vec2::ZERO).r;
        for (rho, want) in [(0.1, [0.039, 0.039, 0.039]), (0.5, [0.261, 0.256, 0.245]), (0.8, [0.561, 0.531, 0.486])] {
            for (got, want) in [smooth(rho), ggx(rho, 0.1), ggx(rho, 0.2)].into_iter().zip(want) {
                assert!((got - want).abs() < 6e-4, "rho {rho}: {got}, expected {want}");
            }
        }
        for (got, want) in [smooth(1.0), ggx(1.0, 0.1), ggx(1.0, 0.2)].into_iter().zip([0.910, 0.828, 0.722]) {
            assert!((got - want).abs() < 2e-3, "rho 1: {got}, expected {want}");
        }
    }

    #[test]
    fn what_goes_each_way_adds_up_to_what_pass_one_counts() {
        let rough = |d, alpha| RoughPlastic::new(d, alpha, 1.49, grey(0.7, true), white());
        let smooth = Plastic::new(1.5, grey(0.7, false), white());
        let coats = [rough(Distribution::Ggx, 0.3), rough(Distribution::Beckmann, 0.1)];
        let mean = |toward: &dyn Fn(f64) -> f64| {
            let n = 4000;
            (0..n).map(|i| (f64::from(i) + 0.5) / f64::from(n)).map(|mu| 2.0 * mu * toward(mu) / f64::from(n)).sum::<f64>()
        };
        let mut pairs = vec![(mean(&|mu| smooth.base_toward(mu, Vec2::ZERO).g), smooth.base_albedo(Vec2::ZERO).g)];
        for coat in &coats {
            pairs.push((mean(&|mu| coat.base_toward(mu, Vec2::ZERO).g), coat.base_albedo(Vec2::ZERO).g));
        }
        for (got, want) in pairs {
            assert!((got / want - 1.0).abs() < 1e-4, "{got}, expected {want}");
        }
    }

    #[test]
    fn a_linear_coat_keeps_the_hue() {
        let base = Base { reflectance: Texture::Constant(Rgb::new(0.2, 0.4, 0.8)), nonlinear: false };
        let got = Plastic::new(1.5, base, white()).base_albedo(Vec2::ZERO);
        assert!((got.g / got.r - 2.0).abs() < 1e-12 && (got.b / got.r - 4.0).abs() < 1e-12, "{got:?}");
    }
}
