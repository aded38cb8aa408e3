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

impl Material {
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
    pub fn is_thin(&self) -> bool {
        matches!(self, Material::ThinDielectric { .. })
    }

    /// The ideal specular directions for a viewer at `wo`, each with the factor on the radiance that comes from there.
    #[inline]
    pub fn lobes(&self, wo: Vec3) -> Lobes {
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
