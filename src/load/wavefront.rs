//! A Wavefront OBJ with its MTL as a whole scene: a shape for each material, a camera that frames them, a sky if nothing emits.

use super::error::{LoadError, LoadErrorKind, position};
use super::files::Files;
use super::framing::Model;
use super::mesh::{MeshFault, Placement};
use super::mitsuba::Parts;
use super::mtl::{self, Map, Mtl};
use super::obj;
use super::picture::{self, Picture};
use crate::material::plastic::Base;
use crate::material::principled::Parameters;
use crate::material::texture::{Bitmap, Filter, Wrap};
use crate::material::{Distribution, Material, MaterialId, Principled, RoughPlastic, Surface, Texture};
use crate::math::{DAffine3, Rgb};
use crate::scene::{ShapeSource, SurfaceSource};
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Index of glass and of clear coats where a file gives none.
const DEFAULT_INDEX: f64 = 1.5;

/// A material and the file that it stands in.
struct Described {
    mtl: Mtl,
    library: PathBuf,
    /// The library's bytes: faults in its lines are told with their place.
    text: std::sync::Arc<[u8]>,
}

impl Described {
    fn error(&self, offset: usize, kind: LoadErrorKind) -> LoadError {
        LoadError { file: self.library.as_path().into(), at: Some(position(&self.text, offset)), kind }
    }

    /// The path of an image, which is named relative to the library.
    fn resolve(&self, map: &Map, files: &Files) -> Result<PathBuf, LoadError> {
        let folder = self.library.parent().unwrap_or(Path::new(""));
        files.resolve(&folder.join(&map.file).to_string_lossy()).map_err(|kind| self.error(map.offset, kind))
    }
}

/// Reads the OBJ file `main`.
pub(super) fn scene(files: &Files, main: &Path, name: String) -> Result<Parts, LoadError> {
    let bytes = files.read(main, files.limits.mesh_bytes).map_err(|kind| kind.in_file(main))?;
    let at = |offset: usize, kind| LoadError { file: main.into(), at: Some(position(&bytes, offset)), kind };
    let file = obj::parse_by_material(&bytes, true).map_err(|fault| in_file(fault, main, &bytes))?;
    let found = file.parts.iter().map(|p| p.mesh.triangles.len() as u64).sum();
    if found > files.limits.triangles {
        let (what, limit) = ("number of triangles".to_owned(), files.limits.triangles);
        return Err(LoadErrorKind::OverLimit { what, limit, found }.in_file(main));
    }
    if found == 0 {
        let (expected, found) = ("a model with faces".to_owned(), "none".to_owned());
        return Err(LoadErrorKind::Malformed { expected, found }.in_file(main));
    }
    let mut described = HashMap::new();
    for (library, offset) in &file.libraries {
        for material in read_library(files, library).map_err(|e| e.or_at(|kind| at(*offset, kind)))? {
            described.insert(material.mtl.name.clone(), material);
        }
    }
    let mut warnings = Vec::new();
    let used: Vec<&Described> = file.parts.iter().filter_map(|p| described.get(&p.material)).collect();
    let pictures = decode(&used, files)?;
    let (mut shapes, mut materials) = (Vec::new(), Vec::new());
    for part in file.parts {
        let (surface, emission) = match described.get(&part.material) {
            Some(material) => surface(material, files, &pictures, &mut warnings)?,
            None => {
                if !part.material.is_empty() {
                    let line = position(&bytes, part.offset).line;
                    warnings.push(format!("line {line}: no library has the material \"{}\"; it is grey", part.material));
                }
                (grey(), Texture::BLACK)
            }
        };
        let placement = Placement { to_world: DAffine3::IDENTITY, face_normals: false, flip_normals: false };
        let surface_source = SurfaceSource::Triangles(placement.apply(part.mesh));
        let id = if part.material.is_empty() { "default".to_owned() } else { part.material };
        let material = MaterialId(materials.len() as u32);
        materials.push(surface);
        shapes.push(ShapeSource { id, surface: surface_source, material, emission });
    }
    Ok(Model { shapes, materials, warnings, ..Model::default() }.into_parts(name))
}

/// A fault that has its place, or is to be told where the file is named.
enum Failure {
    Placed(LoadError),
    Here(LoadErrorKind),
}

impl Failure {
    fn or_at(self, place: impl FnOnce(LoadErrorKind) -> LoadError) -> LoadError {
        match self {
            Failure::Placed(error) => error,
            Failure::Here(kind) => place(kind),
        }
    }
}

fn read_library(files: &Files, name: &str) -> Result<Vec<Described>, Failure> {
    let path = files.resolve(&name.replace('\\', "/")).map_err(Failure::Here)?;
    let bytes = files.read(&path, files.limits.xml_bytes).map_err(Failure::Here)?;
    let all = mtl::parse(&bytes).map_err(|fault| Failure::Placed(in_file(fault, &path, &bytes)))?;
    let text: std::sync::Arc<[u8]> = bytes.into();
    Ok(all.into_iter().map(|mtl| Described { mtl, library: path.clone(), text: text.clone() }).collect())
}

fn in_file(fault: MeshFault, path: &Path, bytes: &[u8]) -> LoadError {
    LoadError { file: path.into(), at: fault.offset.map(|offset| position(bytes, offset)), kind: fault.kind }
}

/// All images of the materials in use, side by side; the first fault in file order is told.
fn decode(used: &[&Described], files: &Files) -> Result<HashMap<PathBuf, Picture>, LoadError> {
    let mut wanted: Vec<(PathBuf, &Described, usize)> = Vec::new();
    for material in used {
        for map in [&material.mtl.diffuse_map, &material.mtl.emission_map].into_iter().flatten() {
            let path = material.resolve(map, files)?;
            if wanted.iter().all(|(known, ..)| *known != path) {
                wanted.push((path, material, map.offset));
            }
        }
    }
    let read = |path: &Path| picture::decode(&files.read(path, files.limits.image_bytes)?, path, false, files);
    let decoded: Vec<_> =
        wanted.par_iter().map(|(path, material, offset)| read(path).map_err(|kind| material.error(*offset, kind))).collect();
    wanted.iter().zip(decoded).map(|((path, ..), picture)| Ok((path.clone(), picture?))).collect()
}

fn grey() -> Surface {
    let material = Material::Diffuse { reflectance: Texture::Constant(Rgb::grey(0.5)) };
    Surface { name: "default".to_owned(), material, two_sided: true, relief: None }
}

/// A material of the renderer for one of an MTL, and the radiance it emits.
///
/// To be extended with the materials: what MTL describes and [`Material`] has no form for is decided here and nowhere else.
fn surface(
    described: &Described,
    files: &Files,
    pictures: &HashMap<PathBuf, Picture>,
    warnings: &mut Vec<String>,
) -> Result<(Surface, Texture), LoadError> {
    let mtl = &described.mtl;
    let mut note = |what: &str| warnings.push(format!("material \"{}\": {what}", mtl.name));
    let mut emission = Texture::Constant(mtl.emission.unwrap_or(Rgb::BLACK));
    if let Some(map) = &mtl.emission_map {
        // Exporters leave Ke black or white beside a map.
        let factor = mtl.emission.filter(|e| !e.is_black()).unwrap_or(Rgb::WHITE);
        emission = texture(described, map, files, pictures, factor)?;
    }
    let opacity = mtl.opacity.unwrap_or(1.0);
    let index = mtl.index.filter(|n| *n > 1.0).unwrap_or(DEFAULT_INDEX);
    let transmittance = Texture::Constant(mtl.filter.unwrap_or(Rgb::WHITE));
    let specular = mtl.specular.unwrap_or(Rgb::BLACK).map(|v| v.min(1.0));
    let material = match mtl.model.unwrap_or(2) {
        4 | 6 | 7 | 9 if opacity < 1.0 || mtl.opacity.is_none() => {
            Material::Dielectric { eta: index, reflectance: Texture::WHITE, transmittance }
        }
        // Without a word on refraction, what is nearly clear is a pane, which does not bend light.
        _ if opacity < 0.5 => Material::ThinDielectric { eta: index, reflectance: Texture::WHITE, transmittance },
        5 => {
            let reflectance = if specular.is_black() { Rgb::WHITE } else { specular };
            Material::Conductor { index: None, reflectance: Texture::Constant(reflectance) }
        }
        model => {
            let base = base_color(described, files, pictures)?;
            let form = match mtl.roughness {
                // The physically based extension.
                Some(roughness) => {
                    let grey = |v: f64| Texture::Constant(Rgb::grey(v.clamp(0.0, 1.0)));
                    let parts = Parameters::of_base(base, grey(roughness), grey(mtl.metallic.unwrap_or(0.0)), DEFAULT_INDEX);
                    Material::Principled(Box::new(Principled::new(parts)))
                }
                None if model >= 2 && !specular.is_black() => {
                    // The Beckmann alpha whose highlight is as wide as that of Phong's exponent [Walter07].
                    let alpha = (2.0 / (mtl.shininess.unwrap_or(0.0) + 2.0)).sqrt().clamp(0.01, 1.0);
                    let base = Base { reflectance: base, nonlinear: false };
                    let coat = Texture::Constant(specular);
                    Material::RoughPlastic(Box::new(RoughPlastic::new(Distribution::Beckmann, alpha, DEFAULT_INDEX, base, coat)))
                }
                None => Material::Diffuse { reflectance: base },
            };
            if opacity < 1.0 {
                let inner = Box::new(Material::TwoSided(Box::new(form)));
                Material::Mask { opacity: Texture::Constant(Rgb::grey(opacity)), inner }
            } else {
                form
            }
        }
    };
    if mtl.has_opacity_map {
        note("its map of opacity plays no part");
    }
    let two_sided = !material.is_transmissive();
    Ok((Surface { name: mtl.name.clone(), material, two_sided, relief: None }, emission))
}

/// Kd times its map.
fn base_color(described: &Described, files: &Files, pictures: &HashMap<PathBuf, Picture>) -> Result<Texture, LoadError> {
    let mtl = &described.mtl;
    match &mtl.diffuse_map {
        None => Ok(Texture::Constant(mtl.diffuse.unwrap_or(Rgb::grey(0.5)))),
        Some(map) => {
            // A black factor would hide the map; exporters write it and mean white.
            let factor = mtl.diffuse.filter(|c| !c.is_black()).unwrap_or(Rgb::WHITE);
            texture(described, map, files, pictures, factor)
        }
    }
}

fn texture(
    described: &Described,
    map: &Map,
    files: &Files,
    pictures: &HashMap<PathBuf, Picture>,
    factor: Rgb,
) -> Result<Texture, LoadError> {
    let Picture { width, height, texels } = pictures[&described.resolve(map, files)?].clone();
    let is_reflectance = |t: [f32; 3]| t.iter().all(|v| (0.0..=1.0).contains(v));
    if let Some(i) = texels.iter().position(|t| !is_reflectance(t)) {
        let expected = "texels with every channel from 0 to 1".to_owned();
        let found = format!("{:?} at ({}, {}) of {}", texels.at(i), i % width, i / width, map.file);
        return Err(described.error(map.offset, LoadErrorKind::Malformed { expected, found }));
    }
    let [[su, sv], [ou, ov]] = [map.scale, map.shift].map(|v| v.map(|v| v as f32));
    // The file's v points up and the renderer's down; the mesh was flipped already: v' = 1 - (sv (1 - v) + ov).
    let to_uv = [[su, 0.0, ou], [0.0, sv, 1.0 - sv - ov]];
    let wrap = if map.clamp { Wrap::Clamp } else { Wrap::Repeat };
    let bitmap = Texture::Bitmap(Bitmap { width, height, texels, filter: Filter::Bilinear, wrap, to_uv });
    Ok(if factor == Rgb::WHITE { bitmap } else { bitmap.map(&|rho| rho * factor) })
}
