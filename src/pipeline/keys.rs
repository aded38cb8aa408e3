//! What each stage of pass one depends on, as hashes: a stage is done again if its key has changed, and those after it.
//!
//! The camera, the film and the names of things are in no key. Neither is the reflectance of a purely diffuse surface in those before the
//! solution: it decides nothing about who sees whom, unless patches follow the light.

use super::direct::lamps_of;
use super::pass_one::PassOneSettings;
use crate::material::{Material, Surface, Texture};
use crate::patch::needs_patches;
use crate::scene::{Scene, ShapeSurface};
use std::fmt::{self, Debug, Write};

/// A BLAKE3 hash.
pub type Key = [u8; 32];

/// Keys of the stages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StageKeys {
    /// The patches: shapes and patch settings; all that makes the light where patches follow it.
    pub patches: Key,
    /// Form factors: patches, method, tolerance, seed, what mirrors and glass do; all lights where rays meet them on the way.
    pub form_factors: Key,
    /// Direct light, lamp by lamp, whatever their strengths.
    pub direct: Key,
    /// The solution: form factors, direct light, strengths, reflectances, solver.
    pub solution: Key,
}

/// Grows when the computation of a stage changes, so that older files are stale.
const GENERATION: u32 = 7;

/// Bytes that are hashed at once.
const PIECE: usize = 1 << 16;

impl StageKeys {
    /// The keys of a scene with these settings.
    pub fn of(scene: &Scene, settings: &PassOneSettings, seed: u64) -> Self {
        let mut digest = Digest::default();
        digest.add(&(GENERATION, settings.patches));
        for shape in &scene.shapes {
            match &shape.surface {
                ShapeSurface::Sphere(sphere) => digest.add(sphere),
                ShapeSurface::Mesh(mesh) => {
                    digest.add(&(mesh.positions.len(), mesh.triangles.len(), mesh.normals.len(), mesh.uvs.len()));
                    mesh.positions.iter().chain(&mesh.normals).for_each(|p| digest.floats(&p.to_array()));
                    mesh.uvs.iter().for_each(|uv| digest.floats(&uv.to_array()));
                    mesh.triangles.iter().flatten().for_each(|i| digest.bytes(&i.to_le_bytes()));
                }
            }
            let surface = scene.material_of(shape);
            let sides = (surface.two_sided, surface.material.has_diffuse(), surface.material.has_diffuse_below());
            digest.add(&(needs_patches(scene, shape), sides));
        }
        if settings.patches.adaptive.is_some() {
            // Such patches follow the light: whatever changes it changes them.
            digest.add(&(settings.form_factors, settings.form_factor_tolerance, seed, settings.solver, settings.by_light));
            digest.lights(scene);
            scene.shapes.iter().for_each(|shape| digest.add(scene.material_of(shape)));
        }
        let patches = digest.key();

        let mut digest = Digest::from(patches);
        digest.add(&(settings.form_factors, settings.form_factor_tolerance, seed));
        for shape in &scene.shapes {
            let surface = scene.material_of(shape);
            if !is_plain(surface) {
                digest.add(surface);
            }
        }
        let light_is_met = has_detours(scene) || scene.environment.is_some();
        if light_is_met {
            digest.lights(scene);
        }
        let form_factors = digest.key();

        let mut digest = Digest::from(patches);
        digest.add(&(settings.form_factors, settings.form_factor_tolerance, seed, lamps_of(scene)));
        for shape in &scene.shapes {
            let surface = scene.material_of(shape);
            if !is_plain(surface) {
                digest.add(surface);
            }
        }
        if let Some(environment) = &scene.environment {
            digest.add(environment);
        }
        let direct = digest.key();

        let mut digest = Digest::from(form_factors);
        digest.bytes(&direct);
        digest.add(&(settings.solver, settings.by_light));
        digest.lights(scene);
        scene.shapes.iter().for_each(|shape| digest.add(scene.material_of(shape)));
        Self { patches, form_factors, direct, solution: digest.key() }
    }
}

/// True if light takes other ways than straight ones between diffuse surfaces: what comes over mirrors, glass and gloss is summed over all
/// lights.
pub fn has_detours(scene: &Scene) -> bool {
    scene.shapes.iter().any(|shape| !is_plain(scene.material_of(shape)))
}

/// Lambert and nothing else: all that form factors need to know of it is where it is.
fn is_plain(surface: &Surface) -> bool {
    matches!(surface.material, Material::Diffuse { .. }) && surface.relief.is_none()
}

/// A hash of what it is given, in large pieces, of which it is faster than of single numbers.
#[derive(Default)]
struct Digest {
    hash: blake3::Hasher,
    waiting: Vec<u8>,
}

impl Digest {
    fn from(key: Key) -> Self {
        let mut digest = Self::default();
        digest.bytes(&key);
        digest
    }

    /// A value by its derived text, in which numbers are exact.
    fn add(&mut self, value: &dyn Debug) {
        write!(self, "{value:?};").expect("a hash takes whatever it is given");
    }

    fn floats(&mut self, values: &[f32]) {
        values.iter().for_each(|v| self.bytes(&v.to_bits().to_le_bytes()));
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.waiting.extend_from_slice(bytes);
        if self.waiting.len() >= PIECE {
            self.hash.update(&self.waiting);
            self.waiting.clear();
        }
    }

    /// All that emits, with its strength. The lamps of shapes are in their emission.
    fn lights(&mut self, scene: &Scene) {
        for shape in &scene.shapes {
            match &shape.emission {
                Texture::Constant(radiance) => self.add(radiance),
                texture => self.add(texture),
            }
        }
        scene.lights.iter().filter(|light| light.shape().is_none()).for_each(|light| self.add(light));
        if let Some(environment) = &scene.environment {
            self.add(environment);
        }
    }

    fn key(mut self) -> Key {
        self.hash.update(&self.waiting);
        *self.hash.finalize().as_bytes()
    }
}

impl Write for Digest {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.bytes(text.as_bytes());
        Ok(())
    }
}
