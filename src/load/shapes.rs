//! `<shape>` to geometry in world coordinates. Mesh files are read later and side by side; see [`MeshFile`].

use super::bsdf::default_surface;
use super::error::{LoadError, LoadErrorKind, Place, position};
use super::files::Files;
use super::mesh::{MeshFault, Placement};
use super::mitsuba::{Loader, unknown_plugin};
use super::object::{Class, Object, Value};
use super::{obj, ply, serialized};
use crate::geometry::tessellate::{self, Triangles};
use crate::material::{Material, MaterialId, Surface, Texture};
use crate::math::{DAffine3, DVec3, Rgb};
use crate::scene::{ShapeSource, SurfaceSource};
use glam::DMat3;
use std::path::PathBuf;

/// Sides of the polygon that stands for a disk: its rim is off by less than 1e-3 of the radius.
const DISK_SIDES: u32 = 64;

/// Sides of the prism that stands for a cylinder.
const CYLINDER_SIDES: u32 = 64;

/// Bands of a sphere that cannot be exact; their edges are off by about 1e-3 of the radius.
pub(super) const SPHERE_BANDS: u32 = 48;

/// Relative difference below which a sphere's axes count as equal.
const SAME_SCALE: f64 = 1e-4;

/// All that can be read.
const KNOWN: [&str; 10] =
    ["obj", "ply", "serialized", "rectangle", "cube", "sphere", "disk", "cylinder", "shapegroup", "instance"];

/// A shape whose mesh file may still have to be read.
pub(super) struct PendingShape {
    pub id: String,
    pub place: Place,
    material: MaterialId,
    emission: Texture,
    emits: bool,
    geometry: Geometry,
}

enum Geometry {
    Ready(SurfaceSource),
    File(MeshFile),
}

/// A mesh file to be read.
struct MeshFile {
    path: PathBuf,
    /// Where the scene names it.
    place: Place,
    format: MeshFormat,
    placement: Placement,
    /// Flip texture coordinates vertically.
    flip_v: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum MeshFormat {
    Obj,
    Ply,
    /// The mesh of this index, from 0.
    Serialized(usize),
}

impl<'a> Loader<'a> {
    /// Everything about a shape but the contents of its mesh file.
    pub fn shape(&mut self, shape: &'a Object) -> Result<PendingShape, LoadError> {
        let id = shape.id.clone().unwrap_or_else(|| self.make_id(&shape.plugin));
        let emitter = shape.child(self.ids, Class::EMITTER)?;
        let emission = emitter.map_or(Ok(Texture::Constant(Rgb::BLACK)), |e| self.area_radiance(e))?;
        let material = match shape.child(self.ids, Class::BSDF)? {
            Some(bsdf) => self.material(bsdf, &format!("bsdf of {id}"))?,
            None => self.default_material(emitter.is_some()),
        };
        let geometry = match shape.plugin.as_str() {
            "obj" => self.mesh_file(shape, MeshFormat::Obj)?,
            "ply" => self.mesh_file(shape, MeshFormat::Ply)?,
            "serialized" => self.serialized(shape)?,
            "rectangle" => analytic(shape, tessellate::rectangle)?,
            "cube" => analytic(shape, tessellate::cube)?,
            "disk" => analytic(shape, |m| tessellate::disk(m, DISK_SIDES))?,
            "cylinder" => cylinder(shape)?,
            "sphere" => self.sphere(shape, &id, material, emitter.is_some())?,
            _ => return Err(unknown_plugin(shape, &KNOWN)),
        };
        if let Geometry::Ready(SurfaceSource::Triangles(t)) = &geometry {
            self.files.take_triangles(t.triangles.len()).map_err(|kind| shape.place.error(kind))?;
        }
        // A hint for Mitsuba's differentiable rendering.
        shape.ignore(&["silhouette_sampling_weight"]);
        shape.finish()?;
        let emits = emitter.is_some();
        Ok(PendingShape { id, place: shape.place.clone(), material, emission, emits, geometry })
    }

    fn default_material(&mut self, emits: bool) -> MaterialId {
        let index = usize::from(emits);
        if let Some(id) = self.default_materials[index] {
            return id;
        }
        let id = self.add_material(default_surface(emits));
        self.default_materials[index] = Some(id);
        id
    }

    pub fn make_id(&mut self, plugin: &str) -> String {
        loop {
            self.made_ids += 1;
            let id = format!("{plugin}-{}", self.made_ids);
            if !self.ids.contains_key(id.as_str()) {
                return id;
            }
        }
    }

    fn mesh_file(&mut self, shape: &Object, format: MeshFormat) -> Result<Geometry, LoadError> {
        let name = shape.needed_text("filename")?;
        let path = self.files.resolve(name.value).map_err(|kind| name.place.error(kind))?;
        let placement = Placement {
            to_world: shape.transform("to_world")?,
            face_normals: shape.boolean("face_normals", false)?,
            flip_normals: shape.boolean("flip_normals", false)?,
        };
        // As in Mitsuba: OBJ is flipped unless told otherwise, PLY is not, and the third is not asked.
        let flip_v = match format {
            MeshFormat::Serialized(_) => false,
            _ => shape.boolean("flip_tex_coords", format == MeshFormat::Obj)?,
        };
        Ok(Geometry::File(MeshFile { path, place: name.place, format, placement, flip_v }))
    }

    fn serialized(&mut self, shape: &Object) -> Result<Geometry, LoadError> {
        let index = match shape.integer("shape_index")? {
            None => 0,
            Some(index) => usize::try_from(index.value).map_err(|_| index.must_be("shape_index", "0 or more"))?,
        };
        self.mesh_file(shape, MeshFormat::Serialized(index))
    }

    /// A sphere that is exact where it can be: round, seen alike from both sides or from outside, and not turned under a texture.
    fn sphere(&mut self, shape: &Object, id: &str, material: MaterialId, emits: bool) -> Result<Geometry, LoadError> {
        let center = shape.point("center")?.map_or(DVec3::ZERO, |c| c.value);
        let radius = shape.float_in("radius", 1.0, |r| r > 0.0, "above 0")?;
        let to_world = shape.transform("to_world")?;
        let c = to_world.matrix3;
        // A mirrored sphere of Mitsuba is turned inside out.
        let inward = shape.boolean("flip_normals", false)? != (c.determinant() < 0.0);
        let surface = &self.surfaces[material.0 as usize];
        let has_sides = emits || !surface.two_sided;
        let why = match uniform_scale(&to_world) {
            None => "a transform that is not a uniform scale",
            Some(_) if inward && has_sides => "normals that point inward",
            Some(scale)
                if is_textured(surface) && !c.abs_diff_eq(DMat3::from_diagonal(DVec3::splat(scale)), SAME_SCALE * scale) =>
            {
                "a texture that is turned with it"
            }
            Some(scale) => {
                let center = to_world.transform_point3(center);
                return Ok(Geometry::Ready(SurfaceSource::Sphere { center, radius: radius * scale }));
            }
        };
        self.warnings.push(format!("sphere \"{id}\" has {why} and is rendered as triangles"));
        let place = to_world * DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(radius));
        let mut triangles = tessellate::sphere(&place, SPHERE_BANDS);
        if inward {
            flip(&mut triangles);
        }
        Ok(Geometry::Ready(SurfaceSource::Triangles(triangles)))
    }
}

/// The factor by which a transform scales all lengths; `None` if directions differ.
pub(super) fn uniform_scale(m: &DAffine3) -> Option<f64> {
    let c = m.matrix3;
    let lengths = [c.x_axis.length(), c.y_axis.length(), c.z_axis.length()];
    let scale = lengths.iter().sum::<f64>() / 3.0;
    let skew = [c.x_axis.dot(c.y_axis), c.y_axis.dot(c.z_axis), c.z_axis.dot(c.x_axis)];
    let round =
        lengths.iter().all(|l| (l / scale - 1.0).abs() < SAME_SCALE) && skew.iter().all(|s| s.abs() < SAME_SCALE * scale * scale);
    round.then_some(scale)
}

/// True if a material looks different at other texture coordinates.
fn is_textured(surface: &Surface) -> bool {
    matches!(&surface.material, Material::Diffuse { reflectance: Texture::Bitmap(_) | Texture::Checkerboard(_) })
}

fn cylinder(shape: &Object) -> Result<Geometry, LoadError> {
    let end = |name, default| Ok::<_, LoadError>(shape.point(name)?.map_or(default, |p| p.value));
    let (p0, p1) = (end("p0", DVec3::ZERO)?, end("p1", DVec3::Z)?);
    if p0 == p1 {
        let found = format!("{} for both", Value::Point(p0).describe());
        let (name, expected) = ("p1".to_owned(), "another point than p0".to_owned());
        return Err(shape.place.error(LoadErrorKind::Value { name, expected, found }));
    }
    let radius = shape.float_in("radius", 1.0, |r| r > 0.0, "above 0")?;
    analytic(shape, |m| tessellate::cylinder(m, p0, p1, radius, CYLINDER_SIDES))
}

fn analytic(shape: &Object, make: impl Fn(&DAffine3) -> Triangles) -> Result<Geometry, LoadError> {
    let mut triangles = make(&shape.transform("to_world")?);
    if shape.boolean("flip_normals", false)? {
        flip(&mut triangles);
    }
    Ok(Geometry::Ready(SurfaceSource::Triangles(triangles)))
}

fn flip(triangles: &mut Triangles) {
    triangles.flip();
    triangles.normals.iter_mut().for_each(|n| *n = -*n);
}

impl PendingShape {
    /// Reads the mesh file, if there is one.
    pub fn read(self, files: &Files) -> Result<ShapeSource, LoadError> {
        let surface = match self.geometry {
            Geometry::Ready(surface) => surface,
            Geometry::File(file) => SurfaceSource::Triangles(file.read(files)?),
        };
        Ok(ShapeSource { id: self.id, surface, material: self.material, emission: self.emission })
    }

    /// True if it has an emitter, even a black one.
    pub fn emits(&self) -> bool {
        self.emits
    }
}

impl MeshFile {
    fn read(&self, files: &Files) -> Result<Triangles, LoadError> {
        let bytes = files.read(&self.path, files.limits.mesh_bytes).map_err(|kind| self.place.error(kind))?;
        let mesh = match self.format {
            MeshFormat::Obj => obj::parse(&bytes, self.flip_v),
            MeshFormat::Ply => ply::parse(&bytes).map(|mut mesh| {
                if self.flip_v {
                    mesh.uvs.iter_mut().for_each(|t| t.y = 1.0 - t.y);
                }
                mesh
            }),
            MeshFormat::Serialized(index) => serialized::parse(&bytes, index, &files.limits),
        };
        let in_file = |fault: MeshFault| LoadError {
            file: self.path.as_path().into(),
            at: fault.offset.map(|offset| position(&bytes, offset)),
            kind: fault.kind,
        };
        let mesh = mesh.map_err(in_file)?;
        if mesh.triangles.is_empty() {
            let (expected, found) = ("a mesh with triangles".to_owned(), "none".to_owned());
            return Err(LoadErrorKind::Malformed { expected, found }.in_file(&self.path));
        }
        files.take_triangles(mesh.triangles.len()).map_err(|kind| self.place.error(kind))?;
        Ok(self.placement.apply(mesh))
    }
}
