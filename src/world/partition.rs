//! Each emitter is found in exactly one of two ways, so that no light is counted twice and none is missed.

use crate::light::Light;
use crate::scene::Scene;

/// Share of the scene's surface above which an emitter is left to gather rays.
///
/// Sampling by area has a density of d²/(cos A) per steradian, which falls without bound where receiver and emitter touch: a wall
/// that glows would give ever larger single samples in its corners, while a cosine-distributed ray finds it at once.
pub const LARGE_SHARE: f64 = 0.1;

/// Which emitters are sampled by shadow rays, and which are left to rays that gather.
#[derive(Debug, Clone)]
pub struct EmitterPartition {
    /// Indices into `scene.lights`.
    shadow: Vec<usize>,
    /// Per shape: true if its emission is found by shadow rays.
    shape_is_shadow: Vec<bool>,
}

impl EmitterPartition {
    /// By the share of the scene's area that each emitter takes: above `large_share` it is left to gather rays. Point lights can only be found by shadow rays; a surrounding only
    /// by gather rays.
    pub fn new(scene: &Scene, large_share: f64) -> Self {
        let total: f64 = scene.shapes.iter().map(crate::scene::Shape::area).sum();
        let mut shape_is_shadow = vec![false; scene.shapes.len()];
        let mut shadow = Vec::new();
        // Emitters of one kind that fill the scene together are large as well, even if each alone is small (six walls of a furnace).
        let emitting: f64 = scene.lights.iter().map(Light::area).sum();
        for (i, light) in scene.lights.iter().enumerate() {
            let area = light.area();
            let large = matches!(light, Light::Environment(_))
                || area > large_share * total
                || (large_share < 1.0 && emitting > 0.5 * total && area > 0.0);
            if !large {
                shadow.push(i);
                if let Some(shape) = light.shape() {
                    shape_is_shadow[shape as usize] = true;
                }
            }
        }
        Self { shadow, shape_is_shadow }
    }

    /// Lights sampled by shadow rays, as indices into `scene.lights`.
    pub fn shadow_lights(&self) -> &[usize] {
        &self.shadow
    }

    /// True if the emission of shape `index` is found by shadow rays, so that a gather ray that meets it directly must not count it.
    #[inline]
    pub fn found_by_shadow_rays(&self, shape: usize) -> bool {
        self.shape_is_shadow[shape]
    }
}
