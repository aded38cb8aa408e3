//! Mitsuba's `principled`: one material of many parameters, after [Burley12] and [Burley15].
//!
//! Its lobes are a diffuse part (with retro-reflection, a flattened variant for skin-like looks, and sheen), a GGX lobe that is
//! part metal, part dielectric, a GTR1 clearcoat, and refraction. It is not derived from physics: sheen and clearcoat add light
//! beyond what arrives for some parameters.

use super::albedo::{AlbedoTable, Range, gauss_legendre};
use super::fresnel;
use super::microfacet::{Distribution, Microfacet, reflected};
pub use super::parameters::Parameters;
use super::rough_dielectric::shares;
use super::texture::{Texture, luminance};
use crate::math::{DVec2, DVec3, Rgb, Vec2};
use std::f64::consts::{FRAC_1_PI, PI, TAU};
use std::sync::{Arc, LazyLock};

/// A `principled` material.
#[derive(Debug, Clone)]
pub struct Principled {
    is: Parameters,
    /// Albedos of the main lobe: weighted by Schlick's (1 - cos)^5, by 1, by the dielectric's reflectance.
    gloss: Arc<AlbedoTable>,
    /// Reflected and transmitted share from above and from below, if some light is refracted.
    boundary: Option<Arc<[AlbedoTable; 2]>>,
}

/// The parameters at one point.
struct Local {
    color: Rgb,
    roughness: f64,
    metallic: f64,
    clearcoat: f64,
    /// Weight of the diffuse part.
    brdf: f64,
    /// Weight of refraction.
    bsdf: f64,
    facets: Microfacet,
    coat: Gtr1,
}

/// The distribution of the clearcoat's normals, with a longer tail than GGX. [Burley12].
#[derive(Clone, Copy)]
struct Gtr1 {
    alpha2: f64,
}

impl Gtr1 {
    fn of_gloss(gloss: f64) -> Self {
        Self { alpha2: (0.1 + (0.001 - 0.1) * gloss).powi(2) }
    }

    fn d(self, m: DVec3) -> f64 {
        let a = self.alpha2;
        let d = (a - 1.0) / (PI * a.ln() * (1.0 + (a - 1.0) * m.z * m.z));
        if d * m.z > 1e-20 { d } else { 0.0 }
    }

    fn sample(self, u: DVec2) -> DVec3 {
        let cos2 = ((1.0 - self.alpha2.powf(1.0 - u.y)) / (1.0 - self.alpha2)).clamp(0.0, 1.0);
        let (sin_phi, cos_phi) = (TAU * u.x).sin_cos();
        let sin = (1.0 - cos2).sqrt();
        DVec3::new(sin * cos_phi, sin * sin_phi, cos2.sqrt())
    }

    /// Shadowing of the clearcoat: GGX of roughness 1/4, whatever its gloss.
    fn shadowing(wo: DVec3, wi: DVec3, m: DVec3) -> f64 {
        let facets = Microfacet::new(Distribution::Ggx, 0.25, 0.25);
        facets.g1(wo, m) * facets.g1(wi, m)
    }

    fn fresnel(cos: f64, eta: f64) -> f64 {
        0.04 + 0.96 * schlick_at(cos, eta)
    }
}

/// (1 - cos)^5. [Schlick94].
#[inline]
fn schlick(cos: f64) -> f64 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

/// The same for the cosine on the optically thinner side of a boundary.
#[inline]
fn schlick_at(cos: f64, eta: f64) -> f64 {
    let eta_ti = if cos >= 0.0 { 1.0 / eta } else { eta };
    if eta_ti < 1.0 { schlick(cos.abs()) } else { schlick((1.0 - (1.0 - cos * cos) * eta_ti * eta_ti).max(0.0).sqrt()) }
}

/// The hue of a colour: scaled to luminance 1, white if black.
fn hue(color: Rgb) -> Rgb {
    let y = luminance(color);
    if y > 0.0 { color / y } else { Rgb::WHITE }
}

fn tinted(color: Rgb, tint: f64) -> Rgb {
    Rgb::grey(1.0 - tint) + hue(color) * tint
}

impl Principled {
    /// The material with these parameters.
    pub fn new(is: Parameters) -> Self {
        let eta = is.eta;
        let squared = |t: f64| t * t;
        let range = match (&is.roughness, &is.anisotropic) {
            (Texture::Constant(_), Texture::Constant(_)) => {
                let [u, v] = alphas(is.roughness.mean_scalar(), is.anisotropic.mean_scalar());
                Range::One(u, v)
            }
            _ => Range::Between(squared(is.roughness.min_scalar()).max(1e-3), squared(is.roughness.max_scalar()).max(1e-3)),
        };
        let gloss = AlbedoTable::new(Distribution::Ggx, range, |facets, v, m| {
            let wi = reflected(v, m);
            let (cos, g) = (v.dot(m), if wi.z > 0.0 { facets.g1(wi, m) } else { 0.0 });
            [g * schlick_at(cos, eta), g, g * fresnel::boundary(cos, eta).reflectance]
        });
        let table = |eta: f64| AlbedoTable::new(Distribution::Ggx, range, move |facets, v, m| shares(facets, v, m, eta));
        let boundary = (is.spec_trans.max_scalar() > 0.0).then(|| Arc::new([table(eta), table(1.0 / eta)]));
        Self { is, gloss: Arc::new(gloss), boundary }
    }

    /// True if some of the light is reflected diffusely.
    pub fn has_diffuse(&self) -> bool {
        self.is.metallic.min_scalar() < 1.0 && self.is.spec_trans.min_scalar() < 1.0
    }

    /// True if the roughness may depend on the direction along the surface.
    pub fn is_anisotropic(&self) -> bool {
        self.is.anisotropic.max_scalar() > 0.0
    }

    /// True if some light is refracted.
    pub fn is_transmissive(&self) -> bool {
        self.boundary.is_some() && self.is.metallic.min_scalar() < 1.0
    }

    /// Roughnesses of the main lobe, and that of the clearcoat where there is one.
    pub fn alphas(&self, uv: Vec2) -> [f64; 3] {
        let [u, v] = alphas(self.is.roughness.scalar(uv), self.is.anisotropic.scalar(uv));
        let coat = if self.is.clearcoat.scalar(uv) > 0.0 {
            Gtr1::of_gloss(self.is.clearcoat_gloss.scalar(uv)).alpha2.sqrt()
        } else {
            1.0
        };
        [u, v, coat]
    }

    fn local(&self, uv: Vec2) -> Local {
        let (metallic, through) = (self.is.metallic.scalar(uv), self.is.spec_trans.scalar(uv));
        let roughness = self.is.roughness.scalar(uv);
        let [u, v] = alphas(roughness, self.is.anisotropic.scalar(uv));
        Local {
            color: self.is.base_color.at(uv),
            roughness,
            metallic,
            clearcoat: self.is.clearcoat.scalar(uv),
            brdf: (1.0 - metallic) * (1.0 - through),
            bsdf: (1.0 - metallic) * through,
            facets: Microfacet::new(Distribution::Ggx, u, v),
            coat: Gtr1::of_gloss(self.is.clearcoat_gloss.scalar(uv)),
        }
    }

    /// Reflectance of the main lobe seen from above, as weights of Schlick's power, 1 and the dielectric's reflectance.
    fn reflectance(&self, at: &Local, uv: Vec2) -> [Rgb; 3] {
        let tint = self.is.spec_tint.scalar(uv);
        let r0 = ((self.is.eta - 1.0) / (self.is.eta + 1.0)).powi(2);
        let edge = at.color * at.metallic + hue(at.color) * (r0 * (1.0 - at.metallic) * tint);
        let all = at.metallic + (1.0 - at.metallic) * tint;
        [Rgb::grey(all) - edge, edge, Rgb::grey((1.0 - at.metallic) * (1.0 - tint))]
    }

    /// f cos(theta_i) of the diffuse part.
    pub fn eval_diffuse(&self, wo: DVec3, wi: DVec3, uv: Vec2) -> Rgb {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Rgb::BLACK;
        }
        let at = self.local(uv);
        if at.brdf <= 0.0 {
            return Rgb::BLACK;
        }
        let shape = Shape::new(wo, wi);
        let flat = self.is.flatness.scalar(uv);
        let value = shape.plain(at.roughness) * (1.0 - flat) + shape.flat(at.roughness) * flat;
        let sheen = self.sheen(&at, uv) * shape.sheen;
        (at.color * (at.brdf * FRAC_1_PI * value) + sheen) * wi.z
    }

    fn sheen(&self, at: &Local, uv: Vec2) -> Rgb {
        let weight = self.is.sheen.scalar(uv) * (1.0 - at.metallic);
        if weight == 0.0 { Rgb::BLACK } else { tinted(at.color, self.is.sheen_tint.scalar(uv)) * weight }
    }

    /// The facet between the directions on the upper side, the index over the viewer's, and whether it reflects; `None` if the
    /// facet turns its back on one of them.
    fn connect(&self, wo: DVec3, wi: DVec3) -> Option<(DVec3, f64, bool)> {
        let reflects = wo.z * wi.z > 0.0;
        let eta = if wo.z > 0.0 { self.is.eta } else { 1.0 / self.is.eta };
        let m = (wo + wi * if reflects { 1.0 } else { eta }).normalize();
        let m = if m.z < 0.0 { -m } else { m };
        (wo.dot(m) * wo.z > 0.0 && wi.dot(m) * wi.z > 0.0).then_some((m, eta, reflects))
    }

    /// |f cos(theta_i)| of the other lobes.
    pub fn eval_glossy(&self, wo: DVec3, wi: DVec3, uv: Vec2) -> Rgb {
        if wo.z == 0.0 || wi.z == 0.0 {
            return Rgb::BLACK;
        }
        let Some((m, eta, reflects)) = self.connect(wo, wi) else { return Rgb::BLACK };
        let at = self.local(uv);
        let (o, i) = (wo.dot(m), wi.dot(m));
        let f = fresnel::boundary(o, self.is.eta).reflectance;
        let dg = at.facets.d(m) * at.facets.g1(wo, m) * at.facets.g1(wi, m);
        if !reflects {
            let value = at.bsdf * ((1.0 - f) * dg * o * i / (wo.z * (o + eta * i).powi(2))).abs();
            return at.color.map(f64::sqrt) * value;
        }
        if wo.z < 0.0 {
            return Rgb::grey(at.bsdf * f * dg / (4.0 * -wo.z));
        }
        let [a, b, c] = self.reflectance(&at, uv);
        // Without a step of the index the plugin has no main lobe, not even of metal.
        let main = if f > 0.0 { a * schlick_at(o, self.is.eta) + b + c * f } else { Rgb::BLACK };
        let coat = 0.25 * at.clearcoat * Gtr1::fresnel(o, self.is.eta) * at.coat.d(m) * Gtr1::shadowing(wo, wi, m) * wi.z;
        main * (dg / (4.0 * wo.z)) + Rgb::grey(coat)
    }

    /// Probabilities of diffuse part, clearcoat, refraction and reflection for a facet of reflectance `f`.
    fn odds(&self, at: &Local, above: bool, f: f64, diffuse: bool) -> [f64; 4] {
        let [diffuse_rate, coat_rate, main_rate] = self.is.rates;
        if !above {
            return [0.0, 0.0, 1.0 - f, f];
        }
        let through = at.bsdf * (1.0 - f);
        let diffuse = if diffuse { at.brdf * diffuse_rate } else { 0.0 };
        let odds = [diffuse, 0.25 * at.clearcoat * coat_rate, main_rate * through, main_rate * (1.0 - through)];
        let total: f64 = odds.iter().sum();
        odds.map(|p| p / total)
    }

    /// Density of [`Self::sample`] [1/sr].
    pub fn pdf(&self, wo: DVec3, wi: DVec3, uv: Vec2, diffuse: bool) -> f64 {
        if wo.z == 0.0 || wi.z == 0.0 || (wo.z < 0.0 && !self.is_transmissive()) {
            return 0.0;
        }
        let at = self.local(uv);
        let reflects = wo.z * wi.z > 0.0;
        let connected = self.connect(wo, wi);
        let f = connected.map_or(0.0, |(m, ..)| fresnel::boundary(wo.dot(m), self.is.eta).reflectance);
        let odds = self.odds(&at, wo.z > 0.0, f, diffuse);
        let mut pdf = if reflects { odds[0] * wi.z.max(0.0) * FRAC_1_PI } else { 0.0 };
        if let Some((m, eta, reflects)) = connected {
            let (o, i) = (wo.dot(m), wi.dot(m));
            let main = at.facets.pdf(wo * wo.z.signum(), m);
            pdf += if reflects {
                (odds[3] * main + odds[1] * at.coat.d(m) * m.z) * (0.25 / i).abs()
            } else {
                odds[2] * main * (eta * eta * i / (o + eta * i).powi(2)).abs()
            };
        }
        pdf
    }

    /// A direction and the index on its side over that of the viewer's; from the glossy lobes only unless `diffuse`.
    pub fn sample(&self, wo: DVec3, uv: Vec2, u: DVec2, choice: f64, diffuse: bool) -> Option<(DVec3, f64)> {
        if wo.z == 0.0 || (wo.z < 0.0 && !self.is_transmissive()) {
            return None;
        }
        let at = self.local(uv);
        let m = at.facets.sample(wo * wo.z.signum(), u);
        let boundary = fresnel::boundary(wo.dot(m), self.is.eta);
        let odds = self.odds(&at, wo.z > 0.0, boundary.reflectance, diffuse);
        let (wi, m, eta) = if choice < odds[0] {
            return Some((crate::math::warp::cosine_hemisphere(u.as_vec2()).as_dvec3(), 1.0));
        } else if choice < odds[0] + odds[1] {
            let m = at.coat.sample(u);
            (reflected(wo, m), m, 1.0)
        } else if choice < odds[0] + odds[1] + odds[2] {
            (boundary.refracted(wo, m), m, boundary.eta_it)
        } else {
            (reflected(wo, m), m, 1.0)
        };
        let right_side = (wi.z * wo.z > 0.0) == (eta == 1.0);
        (right_side && wo.dot(m) * wo.z > 0.0 && wi.dot(m) * wi.z > 0.0).then_some((wi, eta))
    }

    /// Share of a uniform light that the glossy lobes send towards `wo`.
    pub fn glossy_albedo(&self, wo: DVec3, uv: Vec2) -> Rgb {
        let at = self.local(uv);
        let [alpha_u, alpha_v, _] = self.alphas(uv);
        let crossed = self.boundary.as_ref().map(|b| b[usize::from(wo.z < 0.0)].at(wo, alpha_u, alpha_v)).unwrap_or_default();
        let through = at.color.map(f64::sqrt) * (at.bsdf * crossed[1]);
        if wo.z <= 0.0 {
            return through + Rgb::grey(at.bsdf * crossed[0]);
        }
        let [a, b, c] = self.reflectance(&at, uv);
        let [power, one, dielectric] = self.gloss.at(wo, alpha_u, alpha_v);
        let main = if self.is.eta == 1.0 { Rgb::BLACK } else { a * power + b * one + c * dielectric };
        let coat = if at.clearcoat > 0.0 { at.clearcoat * COAT.at(wo.z, self.is.clearcoat_gloss.scalar(uv)) } else { 0.0 };
        main + through + Rgb::grey(coat)
    }

    /// Share of a uniform light that the diffuse part sends towards a viewer at cosine `cos`.
    pub fn diffuse_toward(&self, cos: f64, uv: Vec2) -> Rgb {
        if cos <= 0.0 { Rgb::BLACK } else { self.diffuse_albedo_by(&DIFFUSE.toward(cos), uv) }
    }

    /// Mean of [`Self::diffuse_toward`] over a cosine-weighted hemisphere; below 1, where sheen would reach it.
    pub fn diffuse_albedo(&self, uv: Vec2) -> Rgb {
        self.diffuse_albedo_by(&DIFFUSE.mean, uv).map(|v| v.min(0.999))
    }

    /// Largest share of a uniform light that the diffuse part would send back at the brightest place of its base, were
    /// [`Self::diffuse_albedo`] not cut: sheen and retro-reflection may take it beyond 1.
    pub fn largest_diffuse_albedo(&self) -> f64 {
        let base_color = Texture::Constant(self.is.base_color.max());
        let brightest = Self { is: Parameters { base_color, ..self.is.clone() }, ..self.clone() };
        brightest.diffuse_albedo_by(&DIFFUSE.mean, Vec2::ZERO).max()
    }

    fn diffuse_albedo_by(&self, terms: &Terms, uv: Vec2) -> Rgb {
        let at = self.local(uv);
        if at.brdf <= 0.0 {
            return Rgb::BLACK;
        }
        let (r, flat) = (at.roughness, self.is.flatness.scalar(uv));
        let plain = terms[0] + r * (terms[1] + r * terms[2]);
        let flattened = terms[3] + r * (terms[4] + r * terms[5]);
        at.color * (at.brdf * (plain * (1.0 - flat) + flattened * flat)) + self.sheen(&at, uv) * terms[6]
    }
}

/// Roughnesses along the tangents from the artist's two numbers. [Burley12].
fn alphas(roughness: f64, anisotropic: f64) -> [f64; 2] {
    let aspect = (1.0 - 0.9 * anisotropic).sqrt();
    let r2 = roughness * roughness;
    [(r2 / aspect).max(1e-3), (r2 * aspect).max(1e-3)]
}

/// The diffuse part between two directions, as polynomials of the roughness.
struct Shape {
    plain: [f64; 3],
    flat: [f64; 3],
    sheen: f64,
}

impl Shape {
    /// Diffuse and retro-reflected light, the flattened variant, and sheen. [Burley12], [Burley15].
    fn new(wo: DVec3, wi: DVec3) -> Self {
        let (o, i) = (schlick(wo.z), schlick(wi.z));
        // Squared cosine between a direction and the half vector.
        let c2 = (0.5 * (1.0 + wo.dot(wi))).max(0.0);
        let plain = [(1.0 - 0.5 * o) * (1.0 - 0.5 * i), 2.0 * c2 * (o + i - o * i), 4.0 * c2 * c2 * o * i];
        let q = 1.25 * (1.0 / (wo.z + wi.z) - 0.5);
        let flat = [q * (1.0 - o) * (1.0 - i) + 0.625, q * c2 * ((1.0 - o) * i + (1.0 - i) * o), q * c2 * c2 * o * i];
        Self { plain, flat, sheen: schlick(c2.sqrt()) }
    }

    fn plain(&self, r: f64) -> f64 {
        self.plain[0] + r * (self.plain[1] + r * self.plain[2])
    }

    fn flat(&self, r: f64) -> f64 {
        self.flat[0] + r * (self.flat[1] + r * self.flat[2])
    }
}

/// Integrals of the diffuse part over light directions: three powers of the roughness, three flattened, sheen.
type Terms = [f64; 7];

/// Nodes of the tables over the square root of the cosine.
const NODES: usize = 64;

struct DiffuseTerms {
    toward: Vec<Terms>,
    mean: Terms,
}

/// The same for all materials of this kind.
static DIFFUSE: LazyLock<DiffuseTerms> = LazyLock::new(DiffuseTerms::new);

fn view(cos: f64) -> DVec3 {
    DVec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos)
}

impl DiffuseTerms {
    fn new() -> Self {
        let (nodes, weights) = &*gauss_legendre(48);
        let integral = |cos: f64| {
            let mut terms = [0.0; 7];
            for (x, w) in nodes.iter().zip(weights) {
                // The flattened part rises towards grazing light: mu = x² puts nodes there.
                let mu = x * x;
                for k in 0..32 {
                    let (s, c) = (PI * (f64::from(k) + 0.5) / 32.0).sin_cos();
                    let sin = (1.0 - mu * mu).sqrt();
                    let shape = Shape::new(view(cos), DVec3::new(sin * c, sin * s, mu));
                    // d omega cos / pi, both halves of the azimuth.
                    let weight = w * 2.0 * x * mu * 2.0 / 32.0;
                    let values = shape.plain.into_iter().chain(shape.flat).chain([PI * shape.sheen]);
                    terms.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight * v);
                }
            }
            terms
        };
        let toward = (0..NODES).map(|i| integral((i as f64 / (NODES - 1) as f64).powi(2).max(1e-6))).collect();
        let mut mean = [0.0; 7];
        for (x, w) in nodes.iter().zip(weights) {
            let terms = integral(x * x);
            mean.iter_mut().zip(terms).for_each(|(sum, v)| *sum += w * 4.0 * x.powi(3) * v);
        }
        Self { toward, mean }
    }

    fn toward(&self, cos: f64) -> Terms {
        let x = cos.clamp(0.0, 1.0).sqrt() * (NODES - 1) as f64;
        let i = (x as usize).min(NODES - 2);
        let t = x - i as f64;
        std::array::from_fn(|k| self.toward[i][k] * (1.0 - t) + self.toward[i + 1][k] * t)
    }
}

/// Albedo of a clearcoat of weight 1 over the root of the cosine, for five degrees of gloss; the same for all indices above 1.
struct CoatTable {
    values: Vec<[f64; 5]>,
}

static COAT: LazyLock<CoatTable> = LazyLock::new(CoatTable::new);

impl CoatTable {
    fn new() -> Self {
        let (nodes, weights) = &*gauss_legendre(32);
        let albedo = |cos: f64, gloss: f64| {
            let (coat, wo) = (Gtr1::of_gloss(gloss), view(cos));
            let mut sum = 0.0;
            for (y, w) in nodes.iter().zip(weights) {
                for k in 0..32 {
                    let m = coat.sample(DVec2::new((f64::from(k) + 0.5) / 64.0, *y));
                    let wi = reflected(wo, m);
                    if wi.z > 0.0 && wo.dot(m) > 0.0 && m.z > 0.0 {
                        // Value over density D(m) cos(m)/(4 wo.m).
                        let value = Gtr1::fresnel(wo.dot(m), 1.5) * Gtr1::shadowing(wo, wi, m) * wi.z * wo.dot(m) / m.z;
                        sum += w * value / 32.0;
                    }
                }
            }
            sum
        };
        let row = |i: usize| {
            let cos = (i as f64 / (NODES - 1) as f64).powi(2).max(1e-6);
            std::array::from_fn(|g| albedo(cos, g as f64 / 4.0))
        };
        Self { values: (0..NODES).map(row).collect() }
    }

    fn at(&self, cos: f64, gloss: f64) -> f64 {
        let x = cos.clamp(0.0, 1.0).sqrt() * (NODES - 1) as f64;
        let i = (x as usize).min(NODES - 2);
        let y = gloss.clamp(0.0, 1.0) * 4.0;
        let j = (y as usize).min(3);
        let (s, t) = (x - i as f64, y - j as f64);
        let row = |i: usize| self.values[i][j] * (1.0 - t) + self.values[i][j + 1] * t;
        row(i) * (1.0 - s) + row(i + 1) * s
    }
}
