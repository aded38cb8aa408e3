//! What a scene says about a `principled` material.

use super::texture::Texture;

/// Parameters as a scene gives them; all textures are in [0, 1].
#[derive(Debug, Clone)]
pub struct Parameters {
    /// Colour of the base.
    pub base_color: Texture,
    /// Square root of the roughness alpha.
    pub roughness: Texture,
    /// Stretch of the highlight along the first tangent.
    pub anisotropic: Texture,
    /// Share of metal.
    pub metallic: Texture,
    /// Share of the rest that refracts.
    pub spec_trans: Texture,
    /// Share of the dielectric reflection that takes the hue of the base.
    pub spec_tint: Texture,
    /// Weight of the sheen at grazing angles.
    pub sheen: Texture,
    /// Share of the sheen that takes the hue of the base.
    pub sheen_tint: Texture,
    /// Share of the diffuse part that is flattened.
    pub flatness: Texture,
    /// Weight of the clearcoat.
    pub clearcoat: Texture,
    /// 0: clearcoat of roughness 0.1; 1: of 0.001.
    pub clearcoat_gloss: Texture,
    /// Index inside over index outside.
    pub eta: f64,
    /// How often a path tracer draws from the diffuse part, the clearcoat and the main lobes.
    pub rates: [f64; 3],
}

impl Parameters {
    /// A base of one colour, roughness and share of metal, as glTF describes it; the rest at its defaults.
    pub fn of_base(base_color: Texture, roughness: Texture, metallic: Texture, eta: f64) -> Self {
        let [anisotropic, spec_trans, spec_tint, sheen] = [const { Texture::BLACK }; 4];
        let [sheen_tint, flatness, clearcoat, clearcoat_gloss] = [const { Texture::BLACK }; 4];
        let rates = [1.0; 3];
        #[rustfmt::skip]
        return Self {
            base_color, roughness, metallic, anisotropic, spec_trans, spec_tint, sheen, sheen_tint, flatness, clearcoat,
            clearcoat_gloss, eta, rates,
        };
    }
}
