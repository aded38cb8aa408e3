//! How each emitter is found from a diffuse surface: by shadow rays or by gather rays, so that no light is counted twice and none is
//! missed.

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
    /// Indices into `scene.lights`, those with a place.
    shadow: Vec<usize>,
    /// Those infinitely far away.
    distant: Vec<usize>,
    /// Per shape: index of its light if shadow rays find it.
    shadow_light_of_shape: Vec<Option<u32>>,
    /// Index of the surroundings if shadow rays find them.
    environment: Option<usize>,
    /// True if some emitter is not found by shadow rays.
    leaves_some: bool,
}

impl EmitterPartition {
    /// By the share of the scene's area that each emitter takes: above `large_share` it is left to gather rays. Lights without a surface
    /// can only be found by shadow rays; a uniform surrounding, which is no light of the list, only by gather rays.
    pub fn new(scene: &Scene, large_share: f64) -> Self {
        let total: f64 = scene.shapes.iter().map(crate::scene::Shape::area).sum();
        let mut partition = Self {
            shadow: Vec::new(),
            distant: Vec::new(),
            shadow_light_of_shape: vec![None; scene.shapes.len()],
            environment: None,
            leaves_some: false,
        };
        // Emitters of one kind that fill the scene together are large as well, even if each alone is small (six walls of a furnace).
        let emitting: f64 = scene.lights.iter().map(Light::area).sum();
        for (i, light) in scene.lights.iter().enumerate() {
            let area = light.area();
            if area > large_share * total || (large_share < 1.0 && emitting > 0.5 * total && area > 0.0) {
                continue;
            }
            if light.is_distant() {
                partition.distant.push(i);
            } else {
                partition.shadow.push(i);
            }
            if let Some(shape) = light.shape() {
                partition.shadow_light_of_shape[shape as usize] = Some(i as u32);
            }
            if matches!(light, Light::Environment(_)) {
                partition.environment = Some(i);
            }
        }
        let left_out = |(i, shape): (usize, &crate::scene::Shape)| shape.emits() && !partition.found_by_shadow_rays(i);
        partition.leaves_some =
            (scene.environment.is_some() && partition.environment.is_none()) || scene.shapes.iter().enumerate().any(left_out);
        partition
    }

    /// For a scene of so many shapes in which nothing shines: no shadow ray looks for any light.
    pub fn of_none(shapes: usize) -> Self {
        Self {
            shadow: Vec::new(),
            distant: Vec::new(),
            shadow_light_of_shape: vec![None; shapes],
            environment: None,
            leaves_some: false,
        }
    }

    /// True if some emitter, the surroundings among them, is left to rays that meet it by chance.
    #[inline]
    pub fn leaves_some(&self) -> bool {
        self.leaves_some
    }

    /// Lights with a place that are sampled by shadow rays, as indices into `scene.lights`.
    pub fn shadow_lights(&self) -> &[usize] {
        &self.shadow
    }

    /// Lights infinitely far away that are sampled by shadow rays.
    pub fn distant_lights(&self) -> &[usize] {
        &self.distant
    }

    /// True if no light is sampled by shadow rays.
    pub fn has_no_shadow_rays(&self) -> bool {
        self.shadow.is_empty() && self.distant.is_empty()
    }

    /// The light of shape `index` if it is found by shadow rays.
    #[inline]
    pub fn shadow_light_of(&self, shape: usize) -> Option<usize> {
        self.shadow_light_of_shape[shape].map(|light| light as usize)
    }

    /// True if the emission of shape `index` is found by shadow rays, so that a gather ray that meets it directly must not count it.
    #[inline]
    pub fn found_by_shadow_rays(&self, shape: usize) -> bool {
        self.shadow_light_of_shape[shape].is_some()
    }

    /// The surroundings as a light, if shadow rays look for them.
    #[inline]
    pub fn environment(&self) -> Option<usize> {
        self.environment
    }
}
