//! What a material can ever ask for, by bounds over all places and directions: nothing here is sampled.

use super::{Material, Surface, Texture};
use crate::math::Rgb;

impl Material {
    /// True if all that it reflects is reflected diffusely, and nothing goes through. Coated and layered families never are.
    pub fn is_only_diffuse(&self) -> bool {
        match self {
            Material::Diffuse { .. } => true,
            Material::TwoSided(inner) => inner.is_only_diffuse(),
            Material::Blend { parts, .. } => parts.iter().all(Material::is_only_diffuse),
            _ => false,
        }
    }

    /// Its textures; `None` for the families whose parameters are not looked into.
    fn textures(&self) -> Option<Vec<&Texture>> {
        match self {
            Material::Diffuse { reflectance } | Material::Conductor { reflectance, .. } => Some(vec![reflectance]),
            Material::Dielectric { reflectance, transmittance, .. }
            | Material::ThinDielectric { reflectance, transmittance, .. } => Some(vec![reflectance, transmittance]),
            Material::Mask { opacity, inner } => Some([vec![opacity], inner.textures()?].concat()),
            Material::Blend { weight, parts } => Some([vec![weight], parts[0].textures()?, parts[1].textures()?].concat()),
            Material::TwoSided(inner) => inner.textures(),
            Material::Null => Some(Vec::new()),
            Material::RoughConductor(_)
            | Material::RoughDielectric(_)
            | Material::Plastic(_)
            | Material::RoughPlastic(_)
            | Material::Principled(_) => None,
        }
    }

    /// Bounds on its reflectance from below and above, if all that it reflects is reflected diffusely.
    pub fn diffuse_bounds(&self) -> Option<[Rgb; 2]> {
        match self {
            Material::Diffuse { reflectance } => Some(reflectance.bounds()),
            Material::TwoSided(inner) => inner.diffuse_bounds(),
            other => Some([Rgb::BLACK, Rgb::grey(other.diffuse_bound()?)]),
        }
    }

    /// Bound on its reflectance in any channel, if all that it reflects is reflected diffusely.
    pub fn diffuse_bound(&self) -> Option<f64> {
        match self {
            Material::Diffuse { reflectance } => Some(reflectance.max().max()),
            Material::TwoSided(inner) => inner.diffuse_bound(),
            Material::Blend { parts, .. } => Some(parts[0].diffuse_bound()?.max(parts[1].diffuse_bound()?)),
            _ => None,
        }
    }

    /// True if every colour of it is surely grey. The index of a metal colours what it reflects.
    pub fn is_grey(&self) -> bool {
        let index_is_grey = match self {
            Material::Conductor { index, .. } => index.is_none_or(|(eta, k)| eta.is_grey() && k.is_grey()),
            Material::Mask { inner, .. } | Material::TwoSided(inner) => inner.is_grey(),
            Material::Blend { parts, .. } => parts.iter().all(Material::is_grey),
            _ => true,
        };
        index_is_grey && self.textures().is_some_and(|textures| textures.into_iter().all(Texture::is_grey))
    }
}

impl Texture {
    /// Bounds on its values from below and above.
    pub fn bounds(&self) -> [Rgb; 2] {
        match self {
            Texture::Constant(value) => [*value; 2],
            other => [Rgb::BLACK, other.max()],
        }
    }
}

impl Surface {
    /// False if it is surely the same at all texture coordinates, and however those lie on it.
    pub fn may_read_uv(&self) -> bool {
        let varies = self.material.textures().is_none_or(|textures| !textures.into_iter().all(Texture::is_constant));
        varies || self.relief.is_some() || self.material.is_anisotropic()
    }
}
