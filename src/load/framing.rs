//! What a model lacks to be a scene: a view of it, a film, and light.

use super::mitsuba::Parts;
use crate::light::Environment;
use crate::material::Surface;
use crate::math::{DAffine3, DVec2, DVec3, Rgb};
use crate::scene::camera::FovAxis;
use crate::scene::{Camera, FilmSettings, LightSource, SceneSource, ShapeSource, SurfaceSource};

/// Where the viewer of a model stands, as seen from its middle: in front, a little to the right and above (+y is up).
const TOWARDS_VIEWER: DVec3 = DVec3::new(0.35, 0.3, 1.0);

/// Full angle across the shorter side of the film [degrees].
const FOV: f64 = 40.0;

/// Most rows of a picture whose shape the file asks for.
const MAX_HEIGHT: f64 = 16_384.0;

/// What a model file gives.
#[derive(Default)]
pub(super) struct Model {
    pub shapes: Vec<ShapeSource>,
    pub materials: Vec<Surface>,
    /// Lights without a surface.
    pub lights: Vec<LightSource>,
    /// A camera, if the file has one, and width over height of its picture, if it says so.
    pub view: Option<(Camera, Option<f64>)>,
    pub warnings: Vec<String>,
}

impl Model {
    /// The model as a scene called `name`, with all that it lacks.
    pub fn into_parts(mut self, name: String) -> Parts {
        let mut film = FilmSettings { width: 768, height: 576, sample_count: 16, max_depth: None };
        let camera = match self.view {
            None => camera(&self.shapes),
            Some((camera, aspect)) => {
                if let Some(aspect) = aspect {
                    let height = (film.width as f64 / aspect).round();
                    film.height = height.clamp(1.0, MAX_HEIGHT) as usize;
                }
                camera
            }
        };
        let has_light = !self.lights.is_empty() || self.shapes.iter().any(|s| !s.emission.mean().is_black());
        let environment = (!has_light).then_some(Environment::Uniform(Rgb::WHITE));
        if !has_light {
            self.warnings.push("nothing in the model emits light: a uniform sky of radiance 1 surrounds it".to_owned());
        }
        let Model { shapes, materials, lights, warnings, .. } = self;
        let source = SceneSource { name, camera, film, shapes, materials, lights, environment, warnings };
        Parts { source, places: Vec::new(), crop: None }
    }
}

/// A camera that sees the whole of `shapes`: the sphere around their box touches the edges of the view.
fn camera(shapes: &[ShapeSource]) -> Camera {
    let join = |(low, high): (DVec3, DVec3), p: &DVec3| (low.min(*p), high.max(*p));
    let (low, high) = shapes.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |range, s| match &s.surface {
        SurfaceSource::Triangles(t) => t.positions.iter().fold(range, join),
        SurfaceSource::Sphere { center, radius } => [*center - *radius, *center + *radius].iter().fold(range, join),
    });
    let (middle, radius) =
        if low.cmple(high).all() { (0.5 * (low + high), 0.5 * (high - low).length()) } else { (DVec3::ZERO, 0.0) };
    // A model that is a single point is seen from one unit away.
    let radius = if radius > 0.0 { radius } else { 1.0 };
    let half = 0.5 * FOV.to_radians();
    let distance = radius / half.sin();
    let eye = middle + TOWARDS_VIEWER.normalize() * distance;
    looking(eye, middle, 2.0 * half, FovAxis::Smaller, 1e-3 * (distance - radius), distance + 2.0 * radius)
}

/// A camera at `eye` that looks at `target` with +y up.
fn looking(eye: DVec3, target: DVec3, fov: f64, fov_axis: FovAxis, near_clip: f64, far_clip: f64) -> Camera {
    let forward = (target - eye).normalize();
    let left = DVec3::Y.cross(forward).normalize();
    let to_scene = DAffine3::from_cols(left, forward.cross(left), forward, eye);
    Camera { to_scene, tan_half_fov: (0.5 * fov).tan(), fov_axis, principal_point: DVec2::ZERO, near_clip, far_clip }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::tessellate;
    use crate::material::MaterialId;
    use crate::math::Vec2;

    #[test]
    fn a_framed_model_fills_the_shorter_side() {
        let place = DAffine3::from_translation(DVec3::new(100.0, -3.0, 5.0));
        let surface = SurfaceSource::Triangles(tessellate::cube(&place));
        let shape =
            ShapeSource { id: String::new(), surface, material: MaterialId(0), emission: crate::material::Texture::BLACK };
        let camera = camera(&[shape]);
        let ray = camera.ray(Vec2::new(384.0, 0.0), 768, 576);
        // The upper edge of the view is a plane that touches the sphere of radius sqrt(3) around the middle of the cube.
        let edge = ray.direction.as_dvec3().cross(camera.to_scene.transform_vector3(DVec3::X)).normalize();
        let distance = (place.translation - camera.to_scene.translation).dot(edge).abs();
        assert!((distance - 3.0_f64.sqrt()).abs() < 1e-5, "{distance}");
    }
}
