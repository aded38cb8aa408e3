//! From what a reader found (f64, file coordinates) to a valid [`Scene`] (f32, recentred).

use super::{Camera, FilmSettings, Scene, Shape, ShapeSurface, repair};
use crate::geometry::tessellate::Triangles;
use crate::geometry::{Mesh, Sphere};
use crate::light::{AreaLight, DirectionalLight, Emitter, Environment, Light, PointLight, SpotLight};
use crate::material::{MaterialId, Surface, Texture};
use crate::math::{DVec3, Rgb, Vec3};
use std::sync::Arc;

/// A scene as read, before checking and recentring.
#[derive(Debug, Clone)]
pub struct SceneSource {
    /// Name for reports.
    pub name: String,
    /// Camera in file coordinates.
    pub camera: Camera,
    /// Size and wishes.
    pub film: FilmSettings,
    /// Shapes in file coordinates.
    pub shapes: Vec<ShapeSource>,
    /// Materials.
    pub materials: Vec<Surface>,
    /// Lights without a shape.
    pub lights: Vec<LightSource>,
    /// What surrounds the scene.
    pub environment: Option<Environment>,
    /// What the reader wants the user to know.
    pub warnings: Vec<String>,
}

/// A light without a shape as read, in file coordinates.
#[derive(Debug, Clone, Copy)]
pub enum LightSource {
    /// A point that shines everywhere alike.
    Point {
        /// Where it is.
        position: DVec3,
        /// Intensity [W/sr].
        intensity: Rgb,
    },
    /// A point that shines into a cone; see [`SpotLight`].
    Spot {
        /// Where it is.
        position: DVec3,
        /// Unit direction in which it shines.
        axis: DVec3,
        /// Intensity inside the inner cone [W/sr].
        intensity: Rgb,
        /// Angle from the axis beyond which it is dark [radians].
        cutoff: f64,
        /// Angle from the axis up to which the intensity is full [radians].
        beam_width: f64,
    },
    /// Parallel light.
    Directional {
        /// Unit direction in which it travels.
        direction: DVec3,
        /// Irradiance on a surface that faces it [W/m²].
        irradiance: Rgb,
    },
}

impl LightSource {
    fn place(&self, origin: DVec3) -> Light {
        match *self {
            LightSource::Point { position, intensity } => {
                Light::Point(PointLight { position: (position - origin).as_vec3(), intensity })
            }
            LightSource::Spot { position, axis, intensity, cutoff, beam_width } => {
                Light::Spot(SpotLight { position: (position - origin).as_vec3(), axis, intensity, cutoff, beam_width })
            }
            LightSource::Directional { direction, irradiance } => {
                Light::Directional(DirectionalLight { direction: direction.as_vec3(), irradiance })
            }
        }
    }
}

/// A shape as read.
#[derive(Debug, Clone)]
pub struct ShapeSource {
    /// Id.
    pub id: String,
    /// Geometry.
    pub surface: SurfaceSource,
    /// Material.
    pub material: MaterialId,
    /// Emitted radiance [W/(m² sr)]; constant black: none.
    pub emission: Texture,
}

/// Geometry as read, in file coordinates.
#[derive(Debug, Clone)]
pub enum SurfaceSource {
    /// Triangles.
    Triangles(Triangles),
    /// A sphere.
    Sphere {
        /// Centre.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
}

/// Bound on coordinates and radii: squares of lengths below it are finite in f32.
const FARTHEST: f64 = 1e18;

/// Why a scene cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A coordinate is not finite, or too large.
    #[error("shape \"{shape}\": vertex {vertex} is not finite or has a coordinate beyond {FARTHEST:e}")]
    NotFinite {
        /// Shape's id.
        shape: String,
        /// Index of the vertex.
        vertex: usize,
    },
    /// A sphere whose radius is not positive, not finite, or too large.
    #[error("shape \"{shape}\": a sphere needs a radius above 0 and below {FARTHEST:e}, found {radius}")]
    Radius {
        /// Shape's id.
        shape: String,
        /// What was given.
        radius: f64,
    },
    /// A vertex index beyond the vertices.
    #[error("shape \"{shape}\": triangle {triangle} refers to vertex {vertex} of {count}")]
    Index {
        /// Shape's id.
        shape: String,
        /// Index of the triangle.
        triangle: usize,
        /// The index found.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
}

impl SurfaceSource {
    fn corners(&self) -> (DVec3, DVec3) {
        match self {
            SurfaceSource::Triangles(t) => {
                t.positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
            }
            SurfaceSource::Sphere { center, radius } => (*center - *radius, *center + *radius),
        }
    }
}

impl Scene {
    /// Checks, drops triangles without area and copies of others (with a warning that counts them), and recentres in f64.
    ///
    /// # Errors
    /// [`SceneError`] for numbers that are not finite, indices out of range and spheres without a radius.
    pub fn new(source: SceneSource) -> Result<Scene, SceneError> {
        source.shapes.iter().try_for_each(check)?;
        let corners = source.shapes.iter().map(|s| s.surface.corners());
        let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), (low, high)| (a.min(low), b.max(high)));
        let origin = if low.cmple(high).all() { 0.5 * (low + high) } else { source.camera.to_scene.translation };

        let mut warnings = source.warnings;
        let mut camera = source.camera;
        camera.to_scene.translation -= origin;
        let mut dropped_triangles = 0;
        let materials = source.materials;
        let is_opaque = |material: MaterialId| !materials[material.0 as usize].material.is_transmissive();
        let placed = source.shapes.into_iter().map(|s| {
            let is_opaque = is_opaque(s.material);
            place(s, is_opaque, origin, &mut dropped_triangles, &mut warnings)
        });
        let mut shapes: Vec<Shape> = placed.collect();
        dropped_triangles += drop_covered(&mut shapes, is_opaque, &mut warnings);
        let is_one_sided = |s: &Shape| is_opaque(s.material) && !materials[s.material.0 as usize].two_sided;
        warnings.extend(shapes.iter().filter(|s| is_one_sided(s)).filter_map(mixed_sides));

        let area_lights = shapes.iter().enumerate().filter(|(_, s)| s.emits()).filter_map(|(i, s)| {
            let emitter = match &s.surface {
                ShapeSurface::Mesh(mesh) => Emitter::of_mesh(mesh),
                ShapeSurface::Sphere(sphere) => Emitter::Sphere(*sphere),
            };
            (emitter.area() > 0.0).then(|| Light::Area(AreaLight::new(i as u32, s.emission.clone(), emitter)))
        });
        let environment = source.environment.filter(|e| !e.mean().is_black()).map(Arc::new);
        let others = source.lights.iter().map(|light| light.place(origin));
        let map = environment.iter().filter(|e| !e.is_uniform()).map(|e| Light::Environment(Arc::clone(e)));
        let lights: Vec<Light> = area_lights.chain(others).chain(map).collect();
        if environment.is_none() && lights.iter().all(Light::is_dark) {
            warnings.push("the scene has no light: the picture will be black".to_owned());
        }
        Ok(Scene {
            name: source.name,
            origin,
            camera,
            film: source.film,
            shapes,
            materials,
            lights,
            environment,
            dropped_triangles,
            warnings,
        })
    }
}

/// Drops triangles of opaque shapes that an earlier opaque shape has as well, with a warning for each shape; how many there were.
fn drop_covered(shapes: &mut [Shape], is_opaque: impl Fn(MaterialId) -> bool, warnings: &mut Vec<String>) -> usize {
    let mut meshes: Vec<Option<&mut Mesh>> = shapes
        .iter_mut()
        .map(|shape| match &mut shape.surface {
            ShapeSurface::Mesh(mesh) if is_opaque(shape.material) => Some(mesh),
            _ => None,
        })
        .collect();
    let dropped = repair::drop_covered(&mut meshes);
    for (shape, &(count, first)) in shapes.iter().zip(&dropped).filter(|(_, (count, _))| *count > 0) {
        warnings.push(format!(
            "shape \"{}\": {count} of its triangles repeat those of shape \"{}\", which is seen there, and were dropped",
            shape.id, shapes[first].id
        ));
    }
    dropped.iter().map(|(count, _)| count).sum()
}

/// What to tell of a one-sided shape whose triangles do not all have the same side up. Vertex normals would say which side is meant.
fn mixed_sides(shape: &Shape) -> Option<String> {
    let ShapeSurface::Mesh(mesh) = &shape.surface else { return None };
    let turned = if mesh.normals.is_empty() { repair::turned_edges(&mesh.triangles) } else { 0 };
    (turned > 0).then(|| {
        format!(
            "shape \"{}\": neighbours turn different sides up at {turned} edges; its material is black from behind (two-sided ones are not)",
            shape.id
        )
    })
}

fn is_near(p: &DVec3) -> bool {
    p.is_finite() && p.abs().max_element() < FARTHEST
}

fn check(shape: &ShapeSource) -> Result<(), SceneError> {
    let id = || shape.id.clone();
    match &shape.surface {
        SurfaceSource::Triangles(t) => {
            if let Some(vertex) = t.positions.iter().position(|p| !is_near(p)) {
                return Err(SceneError::NotFinite { shape: id(), vertex });
            }
            let count = t.positions.len();
            for (triangle, indices) in t.triangles.iter().enumerate() {
                if let Some(&vertex) = indices.iter().find(|i| **i as usize >= count) {
                    return Err(SceneError::Index { shape: id(), triangle, vertex, count });
                }
            }
        }
        SurfaceSource::Sphere { center, radius } => {
            if !is_near(center) {
                return Err(SceneError::NotFinite { shape: id(), vertex: 0 });
            }
            if !(*radius > 0.0 && *radius < FARTHEST) {
                return Err(SceneError::Radius { shape: id(), radius: *radius });
            }
        }
    }
    Ok(())
}

fn place(shape: ShapeSource, is_opaque: bool, origin: DVec3, dropped_triangles: &mut usize, warnings: &mut Vec<String>) -> Shape {
    let surface = match shape.surface {
        SurfaceSource::Sphere { center, radius } => {
            ShapeSurface::Sphere(Sphere { center: (center - origin).as_vec3(), radius: radius as f32 })
        }
        SurfaceSource::Triangles(t) => {
            let positions: Vec<Vec3> = t.positions.iter().map(|p| (*p - origin).as_vec3()).collect();
            let mut triangles = t.triangles;
            let before = triangles.len();
            let mut tell = |count: usize, what: &str| {
                if count > 0 {
                    warnings.push(format!("shape \"{}\": {count} of {before} triangles {what}", shape.id));
                }
            };
            let without_area = repair::drop_without_area(&mut triangles, &positions);
            tell(without_area, "have no area and were dropped");
            // A viewer sees through both copies of what lets light through.
            let copies = if is_opaque { repair::drop_copies(&mut triangles, &positions) } else { 0 };
            tell(copies, "repeat another one and were dropped");
            *dropped_triangles += without_area + copies;
            let mut normals = t.normals;
            // A normal that cannot be normalised is replaced by the face's, by giving it zero length.
            normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
            ShapeSurface::Mesh(Mesh { positions, normals, uvs: t.uvs, triangles })
        }
    };
    let is_black = matches!(&shape.emission, Texture::Bitmap(b) if b.texels.iter().all(|t| t == [0.0; 3]));
    let emission = if is_black { Texture::Constant(Rgb::BLACK) } else { shape.emission };
    Shape { id: shape.id, surface, material: shape.material, emission }
}
