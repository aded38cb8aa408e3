//! What a surface does to light: a diffuse part, which pass one solves, glossy lobes, and ideal specular directions.
//!
//! Conventions: `wo` points from the surface towards where the ray came from, `wi` to where light comes from; both are unit
//! vectors in the local frame whose +z is the shading normal. Opaque materials are black for `wo` below it; for a two-sided one
//! the caller mirrors the frame. Values are those of Mitsuba 3.9.1's plugins, including f·|cos theta_i| of all lobes and the
//! densities of its samplers.

mod albedo;
pub mod fresnel;
pub mod microfacet;
mod needs;
pub mod parameters;
pub mod plastic;
pub mod principled;
mod relief;
mod rough_conductor;
mod rough_dielectric;
mod sampling;
pub mod specular;
mod texels;
pub mod texture;

pub use microfacet::Distribution;
pub use plastic::{Plastic, RoughPlastic};
pub use principled::Principled;
pub use relief::{Relief, ReliefMap};
pub use rough_conductor::RoughConductor;
pub use rough_dielectric::RoughDielectric;
pub use sampling::{BsdfSample, GlossySample};
pub use specular::{Lobe, Lobes};
pub use texture::Texture;

use crate::math::{DVec3, Rgb, Vec2, Vec3};
use std::f64::consts::FRAC_1_PI;

/// Index of a [`Surface`] in the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct MaterialId(pub u32);

/// A material as a scene names it.
#[derive(Debug, Clone)]
pub struct Surface {
    /// Id in the scene file, or a made-up one.
    pub name: String,
    /// What it does to light.
    pub material: Material,
    /// True: the back behaves like the front. False: the back of an opaque material is black and blocks light.
    pub two_sided: bool,
    /// What bends its shading normal, if anything.
    pub relief: Option<Relief>,
}

/// f·|cos theta_i| of the lobes that are not ideal [1/sr].
#[derive(Debug, Clone, Copy, Default)]
pub struct Scattering {
    /// The part that pass one treats as diffuse.
    pub diffuse: Rgb,
    /// The rest.
    pub glossy: Rgb,
}

/// The closed list of materials.
#[derive(Debug, Clone)]
pub enum Material {
    /// Lambert: reflected radiance rho/pi times irradiance.
    Diffuse {
        /// Reflectance rho, in [0, 1] per channel.
        reflectance: Texture,
    },
    /// Ideal mirror of a metal of complex index eta + i k.
    Conductor {
        /// Real part of the index, and its imaginary part; `None` (Mitsuba's `material="none"`): reflectance 1 at all angles.
        index: Option<(Rgb, Rgb)>,
        /// Factor on the reflected radiance (Kr).
        reflectance: Texture,
    },
    /// A metal of microfacets.
    RoughConductor(Box<RoughConductor>),
    /// Smooth boundary between two dielectrics.
    Dielectric {
        /// Index inside (below the surface) over index outside.
        eta: f64,
        /// Factor on reflected radiance (Kr).
        reflectance: Texture,
        /// Factor on transmitted radiance (Kt).
        transmittance: Texture,
    },
    /// Boundary of microfacets between two dielectrics.
    RoughDielectric(Box<RoughDielectric>),
    /// A thin plate of a dielectric: both faces and all reflections between them, without a shift.
    ThinDielectric {
        /// Index of the plate over that of its surroundings.
        eta: f64,
        /// Factor on reflected radiance (Kr).
        reflectance: Texture,
        /// Factor on transmitted radiance (Kt).
        transmittance: Texture,
    },
    /// A diffuse base under a smooth coat.
    Plastic(Box<Plastic>),
    /// A diffuse base under a rough coat.
    RoughPlastic(Box<RoughPlastic>),
    /// Mitsuba's material of many parameters.
    Principled(Box<Principled>),
    /// A surface with holes finer than a pixel.
    Mask {
        /// Share that is not hole, in [0, 1].
        opacity: Texture,
        /// What that share is made of.
        inner: Box<Material>,
    },
    /// Two materials side by side, finer than a pixel.
    Blend {
        /// Share of the second, in [0, 1].
        weight: Texture,
        /// The first and the second.
        parts: Box<[Material; 2]>,
    },
    /// The same from below as from above, inside a mask or blend whose frame is not mirrored.
    TwoSided(Box<Material>),
    /// Nothing at all: a border that light passes.
    Null,
}

/// A diffuse surface and nothing else, in world directions.
#[derive(Debug, Clone, Copy)]
pub struct Lambert {
    /// Unit normal on the viewer's side.
    pub normal: Vec3,
    /// Reflectance.
    pub rho: Rgb,
}

impl Lambert {
    /// f·|cos theta_i| for light from a direction [1/sr], as [`Material::eval`] has it.
    #[inline]
    pub fn eval(&self, direction: Vec3) -> Rgb {
        let cosine = direction.dot(self.normal);
        if cosine > 0.0 { self.rho * (f64::from(cosine) * FRAC_1_PI) } else { Rgb::BLACK }
    }
}

/// The direction in f64 and of unit length there: near total reflection the rounding to f32 would show.
#[inline]
fn wide(v: Vec3) -> DVec3 {
    v.as_dvec3().normalize()
}

/// A weight or an opacity: one number in [0, 1].
#[inline]
fn share(texture: &Texture, uv: Vec2) -> f64 {
    texture.scalar(uv).clamp(0.0, 1.0)
}

/// The direction in a frame whose third axis is turned round.
#[inline]
fn turned(v: Vec3) -> Vec3 {
    Vec3::new(v.x, v.y, -v.z)
}

/// The directions as [`Material::TwoSided`] hands them on.
#[inline]
fn faced(wo: Vec3, wi: Vec3) -> (Vec3, Vec3) {
    if wo.z < 0.0 { (turned(wo), turned(wi)) } else { (wo, wi) }
}

impl Scattering {
    /// The sum of both parts.
    #[inline]
    pub fn total(self) -> Rgb {
        self.diffuse + self.glossy
    }

    #[inline]
    fn diffuse(diffuse: Rgb) -> Self {
        Self { diffuse, glossy: Rgb::BLACK }
    }

    #[inline]
    fn glossy(glossy: Rgb) -> Self {
        Self { diffuse: Rgb::BLACK, glossy }
    }

    #[inline]
    fn blended(self, other: Self, weight: f64) -> Self {
        let mix = |a: Rgb, b: Rgb| a * (1.0 - weight) + b * weight;
        Self { diffuse: mix(self.diffuse, other.diffuse), glossy: mix(self.glossy, other.glossy) }
    }
}

impl Material {
    /// f·|cos theta_i| of all lobes but the ideal ones [1/sr]; radiance scaled by n² across a boundary.
    pub fn eval(&self, wo: Vec3, wi: Vec3, uv: Vec2) -> Scattering {
        if let Material::Diffuse { reflectance } = self {
            let is_lit = wo.z > 0.0 && wi.z > 0.0;
            let f = || Scattering::diffuse(reflectance.at(uv) * (f64::from(wi.z) * FRAC_1_PI));
            return if is_lit { f() } else { Scattering::default() };
        }
        let (o, i) = (wide(wo), wide(wi));
        match self {
            Material::Plastic(plastic) => Scattering::diffuse(plastic.eval(o, i, uv)),
            Material::RoughPlastic(plastic) => {
                Scattering { diffuse: plastic.eval_base(o, i, uv), glossy: plastic.eval_coat(o, i, uv) }
            }
            Material::Principled(p) => Scattering { diffuse: p.eval_diffuse(o, i, uv), glossy: p.eval_glossy(o, i, uv) },
            Material::RoughConductor(metal) => Scattering::glossy(metal.eval(o, i, uv)),
            Material::RoughDielectric(glass) => Scattering::glossy(glass.eval(o, i, uv)),
            Material::Mask { opacity, inner } => Scattering::default().blended(inner.eval(wo, wi, uv), share(opacity, uv)),
            Material::Blend { weight, parts } => parts[0].eval(wo, wi, uv).blended(parts[1].eval(wo, wi, uv), share(weight, uv)),
            Material::TwoSided(inner) => {
                let (wo, wi) = faced(wo, wi);
                inner.eval(wo, wi, uv)
            }
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. }
            | Material::Null => Scattering::default(),
        }
    }

    /// True if some light leaves by a lobe that is neither diffuse nor ideal.
    pub fn has_glossy(&self) -> bool {
        match self {
            Material::RoughConductor(_) | Material::RoughDielectric(_) | Material::RoughPlastic(_) | Material::Principled(_) => {
                true
            }
            Material::Mask { inner, .. } | Material::TwoSided(inner) => inner.has_glossy(),
            Material::Blend { parts, .. } => parts.iter().any(Material::has_glossy),
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. }
            | Material::Plastic(_)
            | Material::Null => false,
        }
    }

    /// Share of a uniform light that the glossy lobes send towards `wo`, from tables, to 1 %. Across a boundary it includes n².
    pub fn glossy_albedo(&self, wo: Vec3, uv: Vec2) -> Rgb {
        match self {
            Material::RoughConductor(metal) => metal.albedo(wide(wo), uv),
            Material::RoughDielectric(glass) => glass.albedo(wide(wo), uv),
            Material::RoughPlastic(plastic) => plastic.coat_albedo(wide(wo), uv),
            Material::Principled(p) => p.glossy_albedo(wide(wo), uv),
            Material::Mask { opacity, inner } => inner.glossy_albedo(wo, uv) * share(opacity, uv),
            Material::Blend { weight, parts } => {
                let weight = share(weight, uv);
                parts[0].glossy_albedo(wo, uv) * (1.0 - weight) + parts[1].glossy_albedo(wo, uv) * weight
            }
            Material::TwoSided(inner) => inner.glossy_albedo(faced(wo, wo).0, uv),
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. }
            | Material::Plastic(_)
            | Material::Null => Rgb::BLACK,
        }
    }

    /// Smallest roughness alpha of the glossy lobes at `uv`; 1 if there are none.
    pub fn roughness(&self, uv: Vec2) -> f64 {
        match self {
            Material::RoughConductor(metal) => metal.alphas(uv).into_iter().fold(1.0, f64::min),
            Material::RoughDielectric(glass) => glass.alphas(uv).into_iter().fold(1.0, f64::min),
            Material::RoughPlastic(plastic) => plastic.alpha().min(1.0),
            Material::Principled(p) => p.alphas(uv).into_iter().fold(1.0, f64::min),
            Material::Mask { inner, .. } | Material::TwoSided(inner) => inner.roughness(uv),
            Material::Blend { parts, .. } => parts[0].roughness(uv).min(parts[1].roughness(uv)),
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::Dielectric { .. }
            | Material::ThinDielectric { .. }
            | Material::Plastic(_)
            | Material::Null => 1.0,
        }
    }

    /// True if some of the light is reflected diffusely.
    pub fn has_diffuse(&self) -> bool {
        match self {
            Material::Diffuse { .. } | Material::Plastic(_) | Material::RoughPlastic(_) => true,
            Material::Principled(p) => p.has_diffuse(),
            Material::Mask { inner, .. } | Material::TwoSided(inner) => inner.has_diffuse(),
            Material::Blend { parts, .. } => parts.iter().any(Material::has_diffuse),
            Material::Conductor { .. }
            | Material::RoughConductor(_)
            | Material::Dielectric { .. }
            | Material::RoughDielectric(_)
            | Material::ThinDielectric { .. }
            | Material::Null => false,
        }
    }

    /// Share of a uniform light that the diffuse part sends back in all: the rho of pass one at `uv`.
    pub fn diffuse_reflectance(&self, uv: Vec2) -> Rgb {
        match self {
            Material::Diffuse { reflectance } => reflectance.at(uv),
            Material::Plastic(plastic) => plastic.base_albedo(uv),
            Material::RoughPlastic(plastic) => plastic.base_albedo(uv),
            Material::Principled(p) => p.diffuse_albedo(uv),
            Material::Mask { opacity, inner } => inner.diffuse_reflectance(uv) * share(opacity, uv),
            Material::Blend { weight, parts } => {
                let weight = share(weight, uv);
                parts[0].diffuse_reflectance(uv) * (1.0 - weight) + parts[1].diffuse_reflectance(uv) * weight
            }
            Material::TwoSided(inner) => inner.diffuse_reflectance(uv),
            Material::Conductor { .. }
            | Material::RoughConductor(_)
            | Material::Dielectric { .. }
            | Material::RoughDielectric(_)
            | Material::ThinDielectric { .. }
            | Material::Null => Rgb::BLACK,
        }
    }

    /// True if the diffuse part, if any, is the same in all directions.
    pub fn is_lambertian(&self) -> bool {
        match self {
            Material::Plastic(_) | Material::RoughPlastic(_) | Material::Principled(_) => false,
            Material::Mask { inner, .. } | Material::TwoSided(inner) => inner.is_lambertian(),
            Material::Blend { parts, .. } => parts.iter().all(Material::is_lambertian),
            _ => true,
        }
    }

    /// [`Self::diffuse_reflectance`] if it is known to be the same everywhere.
    pub fn uniform_diffuse_reflectance(&self) -> Option<Rgb> {
        match self {
            Material::Diffuse { reflectance: Texture::Constant(rho) } => Some(*rho),
            _ if self.has_diffuse() => None,
            _ => Some(Rgb::BLACK),
        }
    }

    /// True if it does nothing but reflect diffusely, on whichever side.
    pub fn is_diffuse(&self) -> bool {
        match self {
            Material::Diffuse { .. } => true,
            Material::TwoSided(inner) => inner.is_diffuse(),
            _ => false,
        }
    }

    /// True if a surface that is not two-sided as a whole reflects diffusely from below as well.
    pub fn has_diffuse_below(&self) -> bool {
        match self {
            Material::TwoSided(inner) => inner.has_diffuse(),
            Material::Mask { inner, .. } => inner.has_diffuse_below(),
            Material::Blend { parts, .. } => parts.iter().any(Material::has_diffuse_below),
            _ => false,
        }
    }

    /// Share of a uniform light that the diffuse part sends towards `wo`: the radiance is this over pi times the irradiance.
    pub fn diffuse_toward(&self, wo: Vec3, uv: Vec2) -> Rgb {
        match self {
            Material::Diffuse { reflectance } if wo.z > 0.0 => reflectance.at(uv),
            Material::Plastic(plastic) => plastic.base_toward(wo.z.into(), uv),
            Material::RoughPlastic(plastic) => plastic.base_toward(wo.z.into(), uv),
            Material::Principled(p) => p.diffuse_toward(wo.z.into(), uv),
            Material::Mask { opacity, inner } => inner.diffuse_toward(wo, uv) * share(opacity, uv),
            Material::Blend { weight, parts } => {
                let weight = share(weight, uv);
                parts[0].diffuse_toward(wo, uv) * (1.0 - weight) + parts[1].diffuse_toward(wo, uv) * weight
            }
            Material::TwoSided(inner) => inner.diffuse_toward(faced(wo, wo).0, uv),
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::RoughConductor(_)
            | Material::Dielectric { .. }
            | Material::RoughDielectric(_)
            | Material::ThinDielectric { .. }
            | Material::Null => Rgb::BLACK,
        }
    }

    /// The ideal directions for a viewer at `wo`, the straight way through holes included, each with the factor on the radiance
    /// that comes from there.
    #[inline]
    pub fn lobes(&self, wo: Vec3, uv: Vec2) -> Lobes {
        match self {
            Material::Conductor { index, reflectance } => specular::conductor(wo, *index, reflectance.at(uv)),
            Material::Dielectric { eta, reflectance, transmittance } => {
                specular::dielectric(wo, *eta, reflectance.at(uv), transmittance.at(uv))
            }
            Material::ThinDielectric { eta, reflectance, transmittance } => {
                specular::thin_dielectric(wo, *eta, reflectance.at(uv), transmittance.at(uv))
            }
            Material::Plastic(plastic) if wo.z > 0.0 => specular::mirror(wo, plastic.mirrored(wo.z.into(), uv)),
            Material::Mask { opacity, inner } => specular::straight(wo).blended(inner.lobes(wo, uv), share(opacity, uv)),
            Material::Blend { weight, parts } => parts[0].lobes(wo, uv).blended(parts[1].lobes(wo, uv), share(weight, uv)),
            Material::TwoSided(inner) if wo.z < 0.0 => inner.lobes(turned(wo), uv).flipped(),
            Material::TwoSided(inner) => inner.lobes(wo, uv),
            Material::Null => specular::straight(wo),
            Material::Diffuse { .. }
            | Material::Plastic(_)
            | Material::RoughPlastic(_)
            | Material::Principled(_)
            | Material::RoughConductor(_)
            | Material::RoughDielectric(_) => Lobes::default(),
        }
    }

    /// Factor on radiance that goes straight through towards `wo`: what a shadow ray finds.
    pub fn straight_transmittance(&self, wo: Vec3, uv: Vec2) -> Rgb {
        self.lobes(wo, uv).iter().filter(|lobe| lobe.goes_straight(wo)).map(|lobe| lobe.weight).sum()
    }

    /// True if a turn of the surface about its normal may change what it does.
    pub fn is_anisotropic(&self) -> bool {
        match self {
            Material::RoughConductor(metal) => metal.is_anisotropic(),
            Material::RoughDielectric(glass) => glass.is_anisotropic(),
            Material::Principled(principled) => principled.is_anisotropic(),
            Material::Mask { inner, .. } | Material::TwoSided(inner) => inner.is_anisotropic(),
            Material::Blend { parts, .. } => parts.iter().any(Material::is_anisotropic),
            _ => false,
        }
    }

    /// True if some of its light goes by an ideal lobe that is not straight on: a mirror, glass, a smooth coat.
    pub fn bends_ideally(&self) -> bool {
        match self {
            Material::Conductor { .. } | Material::Dielectric { .. } | Material::ThinDielectric { .. } | Material::Plastic(_) => {
                true
            }
            Material::Mask { inner, .. } => inner.bends_ideally(),
            Material::Blend { parts, .. } => parts.iter().any(Material::bends_ideally),
            Material::TwoSided(inner) => inner.bends_ideally(),
            Material::Diffuse { .. }
            | Material::RoughConductor(_)
            | Material::RoughDielectric(_)
            | Material::RoughPlastic(_)
            | Material::Principled(_)
            | Material::Null => false,
        }
    }

    /// True if light passes through the surface, or the sides differ: the frame is not mirrored for a viewer below.
    pub fn is_transmissive(&self) -> bool {
        match self {
            Material::Dielectric { .. }
            | Material::RoughDielectric(_)
            | Material::ThinDielectric { .. }
            | Material::Mask { .. }
            | Material::Null => true,
            Material::Principled(p) => p.is_transmissive(),
            Material::Blend { parts, .. } => parts.iter().any(Material::is_transmissive),
            // Only ever part of one of the above, which it keeps from being mirrored.
            Material::TwoSided(_) => true,
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::RoughConductor(_)
            | Material::Plastic(_)
            | Material::RoughPlastic(_) => false,
        }
    }

    /// True if some light passes without being bent, so that shadow rays may go through as well: a plate, a mask, nothing.
    pub fn passes_straight(&self) -> bool {
        match self {
            Material::ThinDielectric { .. } | Material::Mask { .. } | Material::Null => true,
            Material::Blend { parts, .. } => parts.iter().any(Material::passes_straight),
            Material::TwoSided(inner) => inner.passes_straight(),
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::RoughConductor(_)
            | Material::Dielectric { .. }
            | Material::RoughDielectric(_)
            | Material::Plastic(_)
            | Material::Principled(_)
            | Material::RoughPlastic(_) => false,
        }
    }
}
