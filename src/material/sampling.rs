//! Drawing directions: from the glossy lobes alone, and from a whole material as a path tracer does.

use super::{Material, faced, fresnel, share, specular, turned, wide};
use crate::math::{DVec3, Rgb, Vec2, Vec3, warp};
use std::f64::consts::FRAC_1_PI;

/// A direction drawn from the glossy lobes of a material, all together.
#[derive(Debug, Clone, Copy)]
pub struct GlossySample {
    /// Unit direction of the light.
    pub wi: Vec3,
    /// Glossy f·|cos theta_i| over the density.
    pub weight: Rgb,
    /// Density of all glossy lobes together [1/sr].
    pub pdf: f64,
}

/// A direction drawn from a whole material.
#[derive(Debug, Clone, Copy)]
pub struct BsdfSample {
    /// Unit direction of the light.
    pub wi: Vec3,
    /// f·|cos theta_i| over the density; of an ideal direction, the factor on radiance over the probability of its choice.
    pub weight: Rgb,
    /// Density [1/sr], or the probability of an ideal direction.
    pub pdf: f64,
    /// True for an ideal direction.
    pub delta: bool,
    /// Index on the light's side over that on the viewer's; 1 unless refracted.
    pub eta: f64,
}

impl GlossySample {
    fn turned(self) -> Self {
        Self { wi: turned(self.wi), ..self }
    }
}

impl BsdfSample {
    fn turned(self) -> Self {
        Self { wi: turned(self.wi), ..self }
    }

    fn ideal(wi: Vec3, weight: Rgb, pdf: f64, eta: f64) -> Option<Self> {
        (!weight.is_black()).then_some(Self { wi, weight, pdf, delta: true, eta })
    }
}

/// A uniform number made of one that turned out below `p`, or not below it.
#[inline]
fn reused(choice: f32, p: f64) -> (bool, f32) {
    let below = f64::from(choice) < p;
    let rest = if below { f64::from(choice) / p } else { (f64::from(choice) - p) / (1.0 - p) };
    (below, (rest as f32).clamp(0.0, 1.0 - f32::EPSILON / 2.0))
}

/// Density of a cosine-distributed direction of the upper hemisphere [1/sr].
#[inline]
fn cosine_pdf(wi: DVec3) -> f64 {
    wi.z.max(0.0) * FRAC_1_PI
}

impl Material {
    /// A direction from the glossy lobes, from a point `u` of the unit square and a number `choice` in [0, 1).
    pub fn sample_glossy(&self, wo: Vec3, uv: Vec2, u: Vec2, choice: f32) -> Option<GlossySample> {
        let o = wide(wo);
        let drawn = |wi: DVec3, weight: Rgb| {
            let wi = wi.as_vec3();
            let pdf = self.glossy_pdf(wo, wi, uv);
            (pdf > 0.0 && pdf.is_finite()).then_some(GlossySample { wi, weight, pdf })
        };
        match self {
            Material::RoughConductor(metal) => metal.sample(o, uv, u.as_dvec2()).and_then(|(wi, weight)| drawn(wi, weight)),
            Material::RoughPlastic(plastic) => {
                plastic.sample_coat(o, uv, u.as_dvec2()).and_then(|(wi, weight)| drawn(wi, weight))
            }
            Material::RoughDielectric(glass) => {
                glass.sample(o, uv, u.as_dvec2(), choice.into()).and_then(|d| drawn(d.wi, d.weight))
            }
            Material::Principled(p) => {
                let wi = p.sample(o, uv, u.as_dvec2(), choice.into(), false)?.0.as_vec3();
                let weight = p.eval_glossy(o, wide(wi), uv) / self.glossy_pdf(wo, wi, uv);
                weight.is_finite().then(|| drawn(wide(wi), weight)).flatten()
            }
            Material::Mask { opacity, inner } => {
                let sample = inner.sample_glossy(wo, uv, u, choice)?;
                Some(GlossySample { weight: sample.weight * share(opacity, uv), ..sample })
            }
            Material::Blend { parts, .. } => {
                let first = self.first_share(uv)?;
                let (below, rest) = reused(choice, first);
                let wi = parts[usize::from(!below)].sample_glossy(wo, uv, u, rest)?.wi;
                let pdf = self.glossy_pdf(wo, wi, uv);
                (pdf > 0.0).then(|| GlossySample { wi, weight: self.eval(wo, wi, uv).glossy / pdf, pdf })
            }
            Material::TwoSided(inner) if wo.z < 0.0 => inner.sample_glossy(turned(wo), uv, u, choice).map(GlossySample::turned),
            Material::TwoSided(inner) => inner.sample_glossy(wo, uv, u, choice),
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. }
            | Material::Plastic(_)
            | Material::Null => None,
        }
    }

    /// Density of [`Self::sample_glossy`] [1/sr].
    pub fn glossy_pdf(&self, wo: Vec3, wi: Vec3, uv: Vec2) -> f64 {
        let (o, i) = (wide(wo), wide(wi));
        match self {
            Material::RoughConductor(metal) => metal.pdf(o, i, uv),
            Material::RoughPlastic(plastic) => plastic.coat_pdf(o, i),
            Material::RoughDielectric(glass) => glass.pdf(o, i, uv),
            Material::Principled(p) => p.pdf(o, i, uv, false),
            Material::Mask { inner, .. } => inner.glossy_pdf(wo, wi, uv),
            Material::Blend { parts, .. } => self
                .first_share(uv)
                .map_or(0.0, |first| first * parts[0].glossy_pdf(wo, wi, uv) + (1.0 - first) * parts[1].glossy_pdf(wo, wi, uv)),
            Material::TwoSided(inner) => {
                let (wo, wi) = faced(wo, wi);
                inner.glossy_pdf(wo, wi, uv)
            }
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. }
            | Material::Plastic(_)
            | Material::Null => 0.0,
        }
    }

    /// Probability of the first part of a blend when a glossy direction is drawn; `None` if neither has one.
    fn first_share(&self, uv: Vec2) -> Option<f64> {
        let Material::Blend { weight, parts } = self else { return None };
        let weight = share(weight, uv);
        let first = if parts[0].has_glossy() { 1.0 - weight } else { 0.0 };
        let second = if parts[1].has_glossy() { weight } else { 0.0 };
        (first + second > 0.0).then(|| first / (first + second))
    }

    /// A direction from the whole material, ideal ones included, with the probabilities of Mitsuba's sampler of that name.
    pub fn sample(&self, wo: Vec3, uv: Vec2, u: Vec2, choice: f32) -> Option<BsdfSample> {
        let o = wide(wo);
        // A direction that has a density, judged by the whole material.
        let spread = |wi: Vec3, eta: f64| {
            let pdf = self.pdf(wo, wi, uv);
            let weight = self.eval(wo, wi, uv).total() / pdf;
            (pdf > 0.0 && weight.is_finite()).then_some(BsdfSample { wi, weight, pdf, delta: false, eta })
        };
        match self {
            Material::Diffuse { reflectance } => (wo.z > 0.0).then(|| {
                // What `spread` would find, the cosines cancelled.
                let wi = warp::cosine_hemisphere(u);
                BsdfSample { wi, weight: reflectance.at(uv), pdf: cosine_pdf(wi.as_dvec3()), delta: false, eta: 1.0 }
            }),
            Material::RoughConductor(metal) => metal.sample(o, uv, u.as_dvec2()).and_then(|(wi, _)| spread(wi.as_vec3(), 1.0)),
            Material::RoughDielectric(glass) => {
                glass.sample(o, uv, u.as_dvec2(), choice.into()).and_then(|d| spread(d.wi.as_vec3(), d.eta))
            }
            Material::Principled(p) => {
                p.sample(o, uv, u.as_dvec2(), choice.into(), true).and_then(|(wi, eta)| spread(wi.as_vec3(), eta))
            }
            Material::Plastic(plastic) if wo.z > 0.0 => {
                let p = plastic.mirror_probability(o.z);
                if f64::from(choice) < p {
                    let wi = Vec3::new(-wo.x, -wo.y, wo.z);
                    return BsdfSample::ideal(wi, plastic.mirrored(o.z, uv) / p, p, 1.0);
                }
                spread(warp::cosine_hemisphere(u), 1.0)
            }
            Material::RoughPlastic(plastic) if wo.z > 0.0 => {
                if f64::from(choice) < plastic.coat_probability(o.z) {
                    let (wi, _) = plastic.sample_coat(o, uv, u.as_dvec2())?;
                    return spread(wi.as_vec3(), 1.0);
                }
                spread(warp::cosine_hemisphere(u), 1.0)
            }
            Material::Conductor { .. } | Material::Dielectric { .. } | Material::ThinDielectric { .. } | Material::Null => {
                self.sample_ideal(wo, uv, choice)
            }
            Material::Plastic(_) | Material::RoughPlastic(_) => None,
            Material::Mask { opacity, inner } => {
                let opacity = share(opacity, uv);
                let (below, rest) = reused(choice, opacity);
                if !below {
                    return BsdfSample::ideal(-wo, Rgb::WHITE, 1.0 - opacity, 1.0);
                }
                inner.sample(wo, uv, u, rest).map(|s| BsdfSample { pdf: s.pdf * opacity, ..s })
            }
            Material::Blend { weight, parts } => {
                let weight = share(weight, uv);
                let (below, rest) = reused(choice, weight);
                let sample = parts[usize::from(below)].sample(wo, uv, u, rest)?;
                if sample.delta {
                    let pdf = sample.pdf * if below { weight } else { 1.0 - weight };
                    return Some(BsdfSample { pdf, ..sample });
                }
                spread(sample.wi, sample.eta)
            }
            Material::TwoSided(inner) if wo.z < 0.0 => inner.sample(turned(wo), uv, u, choice).map(BsdfSample::turned),
            Material::TwoSided(inner) => inner.sample(wo, uv, u, choice),
        }
    }

    /// True if [`Self::sample`] looks at its `choice`.
    #[inline]
    pub fn needs_choice(&self) -> bool {
        !matches!(self, Material::Diffuse { .. } | Material::RoughConductor(_) | Material::Conductor { .. } | Material::Null)
    }

    /// One of the ideal directions of a single boundary, chosen by its Fresnel factor alone, tints left aside.
    fn sample_ideal(&self, wo: Vec3, uv: Vec2, choice: f32) -> Option<BsdfSample> {
        let one = |eta: f64, reflectance: f64| {
            // The lobes of the white boundary: their power is the Fresnel factor.
            let reflects = reflectance > 0.0 && f64::from(choice) <= reflectance;
            let lobes = self.lobes(wo, uv);
            let lobe = lobes.iter().find(|l| l.transmits != reflects)?;
            let p = if reflects { reflectance } else { 1.0 - reflectance };
            BsdfSample::ideal(lobe.wi, lobe.weight / p, p, if reflects { 1.0 } else { eta })
        };
        match self {
            Material::Dielectric { eta, .. } => {
                let boundary = fresnel::boundary(wo.z.into(), *eta);
                one(boundary.eta_it, boundary.reflectance)
            }
            Material::ThinDielectric { eta, .. } => one(1.0, specular::plate_reflectance(f64::from(wo.z.abs()), *eta)),
            Material::Conductor { .. } => one(1.0, 1.0),
            _ => one(1.0, -1.0).map(|s| BsdfSample { weight: Rgb::WHITE, pdf: 1.0, ..s }),
        }
    }

    /// Density of [`Self::sample`], ideal directions left out [1/sr].
    ///
    /// As in Mitsuba, the parts of a mask or blend bring the densities of their own samplers.
    pub fn pdf(&self, wo: Vec3, wi: Vec3, uv: Vec2) -> f64 {
        let (o, i) = (wide(wo), wide(wi));
        match self {
            Material::Diffuse { .. } if wo.z > 0.0 => cosine_pdf(i),
            Material::RoughConductor(metal) => metal.pdf(o, i, uv),
            Material::RoughDielectric(glass) => glass.pdf(o, i, uv),
            Material::Plastic(plastic) if wo.z > 0.0 => cosine_pdf(i) * (1.0 - plastic.mirror_probability(o.z)),
            Material::RoughPlastic(plastic) if wo.z > 0.0 && wi.z > 0.0 => {
                let p = plastic.coat_probability(o.z);
                p * plastic.coat_pdf(o, i) + (1.0 - p) * cosine_pdf(i)
            }
            Material::Principled(p) => p.pdf(o, i, uv, true),
            Material::Mask { opacity, inner } => inner.pdf(wo, wi, uv) * share(opacity, uv),
            Material::Blend { weight, parts } => {
                let weight = share(weight, uv);
                parts[0].pdf(wo, wi, uv) * (1.0 - weight) + parts[1].pdf(wo, wi, uv) * weight
            }
            Material::TwoSided(inner) => {
                let (wo, wi) = faced(wo, wi);
                inner.pdf(wo, wi, uv)
            }
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. }
            | Material::Plastic(_)
            | Material::RoughPlastic(_)
            | Material::Null => 0.0,
        }
    }
}
