//! What a surface does to light: a diffuse part, which pass one solves, and ideal specular parts, which pass two follows.
//!
//! Conventions: `wo` points from the surface towards where the ray came from, `wi` to where light comes from; both are unit
//! vectors in the local frame whose +z is the surface normal. For a two-sided material the caller mirrors the frame.

pub mod fresnel;
pub mod plastic;
pub mod specular;
pub mod texture;

pub use specular::{Lobe, Lobes};
pub use texture::Texture;

use crate::math::{Rgb, Vec2, Vec3};

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
        /// Real part of the index; `None` (Mitsuba's `material="none"`): reflectance 1 at all angles.
        index: Option<(Rgb, Rgb)>,
        /// Factor on the reflected radiance (Kr).
        reflectance: Rgb,
    },
    /// Smooth boundary between two dielectrics.
    Dielectric {
        /// Index inside (below the surface) over index outside.
        eta: f64,
        /// Factor on reflected radiance (Kr).
        reflectance: Rgb,
        /// Factor on transmitted radiance (Kt).
        transmittance: Rgb,
    },
    /// A thin plate of a dielectric: both faces and all reflections between them, without a shift.
    ThinDielectric {
        /// Index of the plate over that of its surroundings.
        eta: f64,
        /// Factor on reflected radiance (Kr).
        reflectance: Rgb,
        /// Factor on transmitted radiance (Kt).
        transmittance: Rgb,
    },
}

/// f |cos theta_i| of the lobes that are not ideal: the part that pass one treats as diffuse, and the rest [1/sr].
#[derive(Debug, Clone, Copy, Default)]
pub struct Scattering {
    /// Of the diffuse part.
    pub diffuse: Rgb,
    /// Of the glossy lobes.
    pub glossy: Rgb,
}

/// A direction of the glossy lobes.
#[derive(Debug, Clone, Copy)]
pub struct GlossySample {
    /// Unit direction to the light.
    pub wi: Vec3,
    /// Glossy f |cos theta_i| over `pdf`.
    pub weight: Rgb,
    /// Density per steradian.
    pub pdf: f64,
}

impl Material {
    /// The lobes that are not ideal, for light from `wi` to `wo`.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, uv: Vec2) -> Scattering {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Scattering::default();
        }
        let diffuse = self.diffuse_reflectance(uv) * (std::f64::consts::FRAC_1_PI * f64::from(wi.z));
        Scattering { diffuse, glossy: Rgb::BLACK }
    }

    /// True if there are glossy lobes.
    #[inline]
    pub fn has_glossy(&self) -> bool {
        false
    }

    /// A direction by the glossy lobes.
    #[inline]
    pub fn sample_glossy(&self, _wo: Vec3, _uv: Vec2, _u: Vec2, _choice: f32) -> Option<GlossySample> {
        None
    }

    /// Density per steradian with which [`Self::sample_glossy`] finds `wi`.
    #[inline]
    pub fn glossy_pdf(&self, _wo: Vec3, _wi: Vec3, _uv: Vec2) -> f64 {
        0.0
    }

    /// Directional albedo of the glossy lobes.
    #[inline]
    pub fn glossy_albedo(&self, _wo: Vec3, _uv: Vec2) -> Rgb {
        Rgb::BLACK
    }

    /// Smallest roughness of the glossy lobes; 1 if there are none.
    #[inline]
    pub fn roughness(&self, _uv: Vec2) -> f64 {
        1.0
    }

    /// Diffuse reflectance if it is the same everywhere.
    pub fn uniform_diffuse_reflectance(&self) -> Option<Rgb> {
        match self {
            Material::Diffuse { reflectance: Texture::Constant(rho) } => Some(*rho),
            Material::Diffuse { .. } => None,
            _ => Some(Rgb::BLACK),
        }
    }

    /// Directional albedo of the diffuse part.
    #[inline]
    pub fn diffuse_toward(&self, _wo: Vec3, uv: Vec2) -> Rgb {
        self.diffuse_reflectance(uv)
    }

    /// Diffuse reflectance rho at texture coordinates `uv`; black for purely specular materials.
    #[inline]
    pub fn diffuse_reflectance(&self, uv: Vec2) -> Rgb {
        match self {
            Material::Diffuse { reflectance } => reflectance.at(uv),
            _ => Rgb::BLACK,
        }
    }

    /// True if some of the light is reflected diffusely.
    #[inline]
    pub fn has_diffuse(&self) -> bool {
        matches!(self, Material::Diffuse { .. })
    }

    /// True if light passes through the surface.
    #[inline]
    pub fn is_transmissive(&self) -> bool {
        matches!(self, Material::Dielectric { .. } | Material::ThinDielectric { .. })
    }

    /// True if light passes through without being bent, so that shadow rays may go through as well.
    #[inline]
    pub fn passes_straight(&self) -> bool {
        matches!(self, Material::ThinDielectric { .. })
    }

    /// The ideal specular directions for a viewer at `wo`, each with the factor on the radiance that comes from there.
    #[inline]
    pub fn lobes(&self, wo: Vec3, _uv: Vec2) -> Lobes {
        match self {
            Material::Diffuse { .. } => Lobes::default(),
            Material::Conductor { index, reflectance } => specular::conductor(wo, *index, *reflectance),
            Material::Dielectric { eta, reflectance, transmittance } => {
                specular::dielectric(wo, *eta, *reflectance, *transmittance)
            }
            Material::ThinDielectric { eta, reflectance, transmittance } => {
                specular::thin_dielectric(wo, *eta, *reflectance, *transmittance)
            }
        }
    }
}
