//! A Mitsuba 3 scene to a [`SceneSource`]: one match arm for each kind of element.

use super::error::{LoadError, LoadErrorKind, Place, near};
use super::files::Files;
use super::instances::{self, Groups, Pending};
use super::object::{Class, Ids, Object};
use super::textures::{self, Pictures};
use crate::light::Environment;
use crate::material::{MaterialId, Surface};
use crate::scene::{LightSource, SceneSource};
use std::collections::HashMap;

/// What is known of a scene while it is read.
pub(super) struct Loader<'a> {
    pub ids: &'a Ids<'a>,
    pub files: &'a Files,
    pub warnings: Vec<String>,
    /// Approximations of the material being made.
    pub notes: Vec<String>,
    pub surfaces: Vec<Surface>,
    /// Material of each bsdf that has been made. Objects are told apart by where they are, since they need no id.
    pub material_of: HashMap<*const Object, MaterialId>,
    /// The bsdfs being made, outermost first.
    pub building: Vec<*const Object>,
    /// Materials of shapes without one: not emitting, emitting.
    pub default_materials: [Option<MaterialId>; 2],
    pub pictures: Pictures,
    pub lights: Vec<LightSource>,
    pub environment: Option<Environment>,
    pub groups: Groups,
    /// Left, top, width and height of the film's crop, if it has one.
    pub crop: Option<[usize; 4]>,
    pub made_ids: u32,
}

/// A scene in file coordinates, and where each of its shapes was written.
pub(super) struct Parts {
    pub source: SceneSource,
    pub places: Vec<Place>,
    pub crop: Option<[usize; 4]>,
}

/// Reads the objects of a scene.
pub(super) fn scene(root: &Object, ids: &Ids<'_>, files: &Files, name: String) -> Result<Parts, LoadError> {
    let mut loader = Loader {
        ids,
        files,
        warnings: Vec::new(),
        notes: Vec::new(),
        surfaces: Vec::new(),
        material_of: HashMap::new(),
        building: Vec::new(),
        default_materials: [None; 2],
        pictures: textures::decode_all(root, files),
        lights: Vec::new(),
        environment: None,
        groups: Groups::default(),
        crop: None,
        made_ids: 0,
    };
    let sensors = root.children(ids, Class::SENSOR);
    let (_, sensor) = sensors.first().ok_or_else(|| root.lacks("a sensor"))?;
    let (camera, mut film) = loader.sensor(sensor)?;
    if sensors.len() > 1 {
        loader.warnings.push(format!("the scene has {} sensors; the first is used", sensors.len()));
    }
    if let Some(integrator) = root.child(ids, Class::INTEGRATOR)? {
        film.max_depth = loader.max_depth(integrator)?;
    }
    for (_, bsdf) in root.children(ids, Class::BSDF) {
        loader.material(bsdf, "unnamed")?;
    }
    for (_, texture) in root.children(ids, Class::TEXTURE) {
        loader.texture_object(texture)?;
    }
    let mut pending: Vec<Pending> = Vec::new();
    for (_, shape) in root.children(ids, Class::SHAPE) {
        pending.extend(loader.pending(shape)?);
    }
    for (_, emitter) in root.children(ids, Class::EMITTER) {
        loader.emitter(emitter)?;
    }
    root.finish()?;
    // Textures that no material kept must not be in memory beside the meshes.
    drop(std::mem::take(&mut loader.pictures));
    let crop = loader.crop;
    let (shapes, places) = instances::read_all(pending, loader.groups, files)?;
    let source = SceneSource {
        name,
        camera,
        film,
        shapes,
        materials: loader.surfaces,
        lights: loader.lights,
        environment: loader.environment,
        warnings: loader.warnings,
    };
    Ok(Parts { source, places, crop })
}

impl Loader<'_> {
    /// Notes that the material being made is an approximation, in the words that follow "replaced".
    pub fn note(&mut self, what: String) {
        if !self.notes.contains(&what) {
            self.notes.push(what);
        }
    }
}

/// The error that an object's type is not among `known`.
pub(super) fn unknown_plugin(object: &Object, known: &[&str]) -> LoadError {
    let (class, plugin) = (object.class.0, object.plugin.as_str());
    object.place.error(LoadErrorKind::UnknownPlugin {
        class,
        found: plugin.to_owned(),
        near: near(plugin, known.iter().copied()),
    })
}
