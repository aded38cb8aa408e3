//! Bump and normal maps: what bends the shading normal.

use super::texture::Texture;
use crate::math::{DVec3, Vec2, Vec3};

/// What bends the shading normal of a surface, as Mitsuba's `bumpmap` and `normalmap` do.
#[derive(Debug, Clone)]
pub struct Relief {
    /// Heights or normals.
    pub map: ReliefMap,
    /// True: a normal that turns away from the viewer is mirrored in the unbent one.
    pub flips_invalid: bool,
    /// True: [`Relief::shadowing`] dims light that grazes the unbent surface.
    pub has_shadowing: bool,
}

/// The picture of a relief.
#[derive(Debug, Clone)]
pub enum ReliefMap {
    /// Heights.
    Bump {
        /// Displacement along the normal over `scale`, as one number.
        texture: Texture,
        /// Factor on the displacement [scene units].
        scale: f64,
    },
    /// Normals, as colours (n + 1)/2 along dp/du, its perpendicular in the surface, and the normal.
    Normal {
        /// The colours, as a rule not decoded from sRGB.
        texture: Texture,
    },
}

impl Relief {
    /// The bent shading normal at `uv`, a unit vector in the shading frame (s, t, n), for a viewer at `wo`.
    ///
    /// `dp_du` and `dp_dv` are the derivatives of the point by the texture coordinates [scene units] and `ng` is the geometric
    /// normal, all in the same frame. A bump keeps to the side of `ng`.
    pub fn perturb(&self, uv: Vec2, wo: Vec3, dp_du: Vec3, dp_dv: Vec3, ng: Vec3) -> Vec3 {
        let (u, v) = (dp_du.as_dvec3(), dp_dv.as_dvec3());
        let bent = match &self.map {
            ReliefMap::Bump { texture, scale } => {
                let slope = texture.scalar_gradient(uv) * *scale;
                // The derivatives are laid into the tangent plane and lifted by the slope.
                let n = u.with_z(slope.x).cross(v.with_z(slope.y));
                if n.dot(ng.as_dvec3()) < 0.0 { -n } else { n }
            }
            ReliefMap::Normal { texture } => {
                let n = DVec3::from(texture.at(uv).map(|v| 2.0 * v - 1.0).to_array());
                let s = u.with_z(0.0).try_normalize().unwrap_or(DVec3::X);
                s * n.x + DVec3::Z.cross(s) * n.y + DVec3::Z * n.z
            }
        };
        // A degenerate parametrisation or a grey texel has no direction: the surface stays as it is.
        let bent = bent.try_normalize().unwrap_or(DVec3::Z);
        let turned_away = bent.dot(wo.as_dvec3()) * f64::from(wo.z) < 0.0;
        (if self.flips_invalid && turned_away { DVec3::new(-bent.x, -bent.y, bent.z) } else { bent }).as_vec3()
    }

    /// Factor on light from `wi` (in the unbent frame) where the normal is `bent`: without it a bump ends in a hard edge where
    /// light grazes the surface. [Estevez19].
    pub fn shadowing(&self, bent: Vec3, wi: Vec3) -> f64 {
        if !self.has_shadowing {
            return 1.0;
        }
        let tan2 = |cos: f32| {
            let cos2 = f64::from(cos).powi(2).clamp(1e-12, 1.0);
            (1.0 - cos2) / cos2
        };
        let alpha2 = (0.125 * tan2(bent.z)).min(1.0);
        2.0 / (1.0 + (1.0 + alpha2 * tan2(wi.z)).sqrt())
    }
}
