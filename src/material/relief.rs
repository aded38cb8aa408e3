//! Bump and normal maps: what bends the shading normal.

use super::texture::Texture;
use crate::math::{DVec3, Vec2, Vec3};

/// A map that bends the shading normal of a surface.
#[derive(Debug, Clone)]
pub enum Relief {
    /// Heights.
    Bump {
        /// Displacement along the normal over `scale`, as one number.
        texture: Texture,
        /// Factor on the displacement [scene units].
        scale: f64,
    },
    /// Normals, as colours (n + 1)/2 in the frame of dp/du, its perpendicular, and the normal.
    Normal {
        /// The colours, not decoded from sRGB.
        texture: Texture,
    },
}

impl Relief {
    /// The bent shading normal at `uv`, a unit vector in the shading frame (s, t, n).
    ///
    /// `dp_du` and `dp_dv` are the derivatives of the point by the texture coordinates, in the same frame; only heights need
    /// them. `ng` is the geometric normal in that frame: the bent normal keeps to its side.
    pub fn perturb(&self, uv: Vec2, dp_du: Vec3, dp_dv: Vec3, ng: Vec3) -> Vec3 {
        let bent = match self {
            Relief::Bump { texture, scale } => {
                let slope = texture.scalar_gradient(uv) * *scale;
                let lifted = |dp: Vec3, slope: f64| DVec3::new(dp.x.into(), dp.y.into(), slope);
                let n = lifted(dp_du, slope.x).cross(lifted(dp_dv, slope.y));
                if n.dot(ng.as_dvec3()) < 0.0 { -n } else { n }
            }
            Relief::Normal { texture } => DVec3::from(texture.at(uv).map(|v| 2.0 * v - 1.0).to_array()),
        };
        // A degenerate parametrisation or a grey texel has no direction: the surface stays as it is.
        bent.try_normalize().unwrap_or(DVec3::Z).as_vec3()
    }
}
