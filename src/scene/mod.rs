//! A scene: pure data, no files. Valid once it exists.

pub mod build;
pub mod camera;
mod needs;
mod repair;

pub use build::{LightSource, SceneError, SceneSource, ShapeSource, SurfaceSource};
pub use camera::{Camera, Sighting, View};

use crate::geometry::{Mesh, Sphere};
use crate::light::{Environment, Light};
use crate::material::{MaterialId, Surface, Texture};
use crate::math::{DVec3, Rgb, Vec2, Vec3};
use std::sync::Arc;

/// Everything that a picture depends on, in coordinates relative to [`Scene::origin`].
#[derive(Debug, Clone)]
pub struct Scene {
    /// Name for reports and default file names.
    pub name: String,
    /// Where the scene's own origin lies in the file's coordinates; subtracted in f64 before anything became f32.
    pub origin: DVec3,
    /// The viewer.
    pub camera: Camera,
    /// Size of the picture and how the file asks for it to be made.
    pub film: FilmSettings,
    /// Shapes, in file order.
    pub shapes: Vec<Shape>,
    /// Materials; shapes refer to them.
    pub materials: Vec<Surface>,
    /// Lights that can be sampled from a point: emitting shapes in shape order, then those without a shape, last the surroundings
    /// unless they are uniform: those are found best by rays that gather.
    pub lights: Vec<Light>,
    /// What surrounds the scene; `None`: darkness.
    pub environment: Option<Arc<Environment>>,
    /// Triangles without area that were left out.
    pub dropped_triangles: usize,
    /// What the reader had to replace, drop or guess.
    pub warnings: Vec<String>,
}

/// What the scene file says about the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmSettings {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Samples per pixel that the file asks for.
    pub sample_count: u32,
    /// Longest light path in edges, as Mitsuba counts: 1 sees emitters, 2 direct light. `None`: unlimited.
    pub max_depth: Option<u32>,
}

/// A surface with one material.
#[derive(Debug, Clone)]
pub struct Shape {
    /// Id in the scene file, or a made-up one.
    pub id: String,
    /// Its geometry.
    pub surface: ShapeSurface,
    /// Its material.
    pub material: MaterialId,
    /// Radiance emitted from the normal side [W/(m² sr)] by texture coordinates; constant black if it does not emit.
    pub emission: Texture,
}

/// Geometry of a [`Shape`].
#[derive(Debug, Clone)]
pub enum ShapeSurface {
    /// Triangles.
    Mesh(Mesh),
    /// An exact sphere.
    Sphere(Sphere),
}

impl Shape {
    /// Area [m²].
    pub fn area(&self) -> f64 {
        match &self.surface {
            ShapeSurface::Mesh(mesh) => mesh.area(),
            ShapeSurface::Sphere(sphere) => sphere.area(),
        }
    }

    /// True if some of it emits.
    #[inline]
    pub fn emits(&self) -> bool {
        match &self.emission {
            Texture::Constant(radiance) => !radiance.is_black(),
            // A bitmap that is black everywhere became a constant when the scene was made.
            Texture::Bitmap(_) | Texture::Checkerboard(_) => true,
        }
    }

    /// Radiance emitted from the normal side at texture coordinates `uv` [W/(m² sr)].
    #[inline]
    pub fn emitted(&self, uv: Vec2) -> Rgb {
        self.emission.at(uv)
    }
}

impl Scene {
    /// Material of a shape.
    #[inline]
    pub fn material_of(&self, shape: &Shape) -> &Surface {
        &self.materials[shape.material.0 as usize]
    }

    /// Number of triangles.
    pub fn n_triangles(&self) -> usize {
        self.shapes
            .iter()
            .map(|s| match &s.surface {
                ShapeSurface::Mesh(mesh) => mesh.triangles.len(),
                ShapeSurface::Sphere(_) => 0,
            })
            .sum()
    }

    /// Number of exact spheres.
    pub fn n_spheres(&self) -> usize {
        self.shapes.iter().filter(|s| matches!(s.surface, ShapeSurface::Sphere(_))).count()
    }

    /// Total power of all lights [W]; suns and surroundings have none of their own.
    pub fn power(&self) -> Rgb {
        self.lights.iter().map(Light::power).sum()
    }

    /// Radiance [W/(m² sr)] that arrives from outside along the unit vector `direction`; black without surroundings.
    #[inline]
    pub fn escaped_radiance(&self, direction: Vec3) -> Rgb {
        self.environment.as_ref().map_or(Rgb::BLACK, |e| e.radiance(direction))
    }
}
