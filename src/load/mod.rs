//! Scene files in: Mitsuba 3 XML with OBJ, PLY and serialized meshes and PNG, JPEG, Radiance and OpenEXR images; or a glTF 2.0
//! or an OBJ by itself.
//!
//! ```no_run
//! let loaded = twopass::load::load_scene("scenes/cornell-box/scene.xml".as_ref(), &Default::default())?;
//! println!("{} triangles", loaded.scene.n_triangles());
//! # Ok::<(), twopass::load::LoadError>(())
//! ```
//!
//! The way of a file: `scan` (how deep it nests), `xml` (text to typed properties), `mitsuba` and its siblings (properties to a
//! [`SceneSource`](crate::scene::SceneSource)), [`Scene::new`]. A property that nobody asks for is an error, and so is a file
//! outside the scene's folder. Limits are checked before memory is taken.

mod bsdf;
mod emitters;
mod error;
mod files;
mod framing;
#[doc(hidden)]
pub mod fuzz;
mod gltf;
mod instances;
mod ior;
mod mesh;
mod mitsuba;
mod mtl;
mod obj;
mod object;
mod parameters;
mod picture;
mod ply;
mod scan;
mod sensor;
mod serialized;
mod shapes;
mod spectra;
mod spectrum;
mod textures;
mod transform;
mod upgrade;
mod wavefront;
mod xml;

pub use error::{Fault, LoadError, LoadErrorKind, Position};

use crate::scene::{Scene, SceneError, SceneSource};
use error::Place;
use files::Files;
use std::path::{Path, PathBuf};
use xml::Tree;

/// What a scene is loaded with.
#[derive(Debug, Clone, Default)]
pub struct LoadOptions {
    /// Values for the scene's `$name`, which override its defaults. Each name must occur in the scene.
    pub defines: Vec<(String, String)>,
    /// Folders outside the scene's own from which files may be read.
    pub allow_paths: Vec<PathBuf>,
    /// Limits on what is read.
    pub limits: Limits,
}

/// Limits on what is read; beyond them loading ends with [`LoadErrorKind::OverLimit`].
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Depth of nested elements, over all includes.
    pub depth: usize,
    /// Attributes of one element; those with a meaning have four at most.
    pub attributes: usize,
    /// Depth of `<include>`; Mitsuba's limit is the same.
    pub include_depth: usize,
    /// Number of `<include>`.
    pub includes: u64,
    /// Bytes of XML in all.
    pub xml_bytes: u64,
    /// XML nodes in one file.
    pub xml_nodes: u32,
    /// Bytes of one mesh file.
    pub mesh_bytes: u64,
    /// Bytes of one image file.
    pub image_bytes: u64,
    /// Width and height of one image.
    pub image_side: u64,
    /// Pixels of one image, which take 12 bytes each.
    pub image_pixels: u64,
    /// Pixels of all images together.
    pub all_image_pixels: u64,
    /// Triangles of all shapes together, instances counted one by one; the ray engines hold no more either.
    pub triangles: u64,
    /// Pixels of the film.
    pub film_pixels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            depth: 256,
            attributes: 256,
            include_depth: 15,
            includes: 1000,
            xml_bytes: 64 << 20,
            xml_nodes: 2_000_000,
            mesh_bytes: 8 << 30,
            image_bytes: 1 << 30,
            image_side: 65_535,
            image_pixels: 1 << 27,
            all_image_pixels: 1 << 28,
            triangles: 1 << 27,
            film_pixels: 16_384 * 16_384,
        }
    }
}

/// A scene with what it was made from.
#[derive(Debug, Clone)]
pub struct LoadedScene {
    /// The scene.
    pub scene: Scene,
    /// Hash of all files and parameters: equal for equal scenes, on any machine.
    pub hash: u64,
    /// Part of the film that the file asks for: left, top, width and height [pixels].
    pub crop: Option<[usize; 4]>,
    /// Every file that was read.
    pub files: Vec<PathBuf>,
}

/// Loads a scene file.
///
/// # Errors
/// [`LoadError`] with file, place, and what was expected there.
pub fn load_scene(path: &Path, options: &LoadOptions) -> Result<LoadedScene, LoadError> {
    load_scene_seen(path, options, |_| {})
}

/// As [`load_scene`]; `look` sees what was read, in f64 and the file's coordinates, before it becomes a scene.
///
/// # Errors
/// As [`load_scene`].
pub fn load_scene_seen(path: &Path, options: &LoadOptions, look: impl FnOnce(&SceneSource)) -> Result<LoadedScene, LoadError> {
    let in_file = |kind: LoadErrorKind| kind.in_file(path);
    let files = Files::beside(path, options).map_err(in_file)?;
    // The file itself was named by the user: it may be a link to anywhere.
    let main = files::canonical(path).map_err(in_file)?;
    let name = scene_name(path, &files.root);
    let extension = path.extension().map(|e| e.to_ascii_lowercase());
    let mitsuba::Parts { source, places, crop } = match extension.as_ref().and_then(|e| e.to_str()) {
        Some("obj") => {
            without_parameters(options).map_err(in_file)?;
            wavefront::scene(&files, &main, name)?
        }
        Some("gltf" | "glb") => {
            without_parameters(options).map_err(in_file)?;
            gltf::scene(&files, &main, name)?
        }
        _ => {
            let tree = Tree::read(&files, &main, &options.defines)?;
            let ids = tree.index()?;
            mitsuba::scene(&tree.root, &ids, &files, name)?
        }
    };
    let shape_ids: Vec<String> = source.shapes.iter().map(|s| s.id.clone()).collect();
    look(&source);
    let scene = Scene::new(source).map_err(|fault| at_shape(fault, &shape_ids, &places, &main))?;
    let (hash, files) = files.summary(&options.defines);
    Ok(LoadedScene { scene, hash, crop, files })
}

/// The folder's name for a `scene.xml`, else the file's without its extension.
fn scene_name(path: &Path, folder: &Path) -> String {
    let folder = folder.file_name().filter(|_| path.file_name().is_some_and(|n| n == "scene.xml"));
    let name = folder.or_else(|| path.file_stem());
    name.map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned())
}

/// An error if parameters are given: only scenes in XML have them.
fn without_parameters(options: &LoadOptions) -> Result<(), LoadErrorKind> {
    parameters::Parameters::new(&options.defines, options.limits.xml_bytes).all_used()
}

/// A fault of geometry, at the shape that has it.
fn at_shape(fault: SceneError, ids: &[String], places: &[Place], main: &Path) -> LoadError {
    let (SceneError::NotFinite { shape, .. } | SceneError::Radius { shape, .. } | SceneError::Index { shape, .. }) = &fault;
    match ids.iter().position(|id| id == shape) {
        Some(i) if i < places.len() => places[i].error(fault.into()),
        _ => LoadErrorKind::from(fault).in_file(main),
    }
}
