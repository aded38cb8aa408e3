//! `<bsdf>` to [`Material`]. What is not supported exactly is rendered by its nearest supported form, with one warning a material.

use super::error::{LoadError, LoadErrorKind, near};
use super::ior;
use super::mitsuba::{Loader, unknown_plugin};
use super::object::{Class, Object, Value};
use super::textures::Use;
use crate::material::plastic::{CoatedAlbedo, Distribution};
use crate::material::{Material, MaterialId, Surface, Texture};
use crate::math::Rgb;

/// All that can be read.
const KNOWN: [&str; 11] = [
    "diffuse",
    "conductor",
    "dielectric",
    "thindielectric",
    "twosided",
    "plastic",
    "roughplastic",
    "roughconductor",
    "roughdielectric",
    "mask",
    "null",
];

impl<'a> Loader<'a> {
    /// The material of a `<bsdf>`, made once however many shapes use it. `name` serves if it has no id.
    pub fn material(&mut self, object: &'a Object, name: &str) -> Result<MaterialId, LoadError> {
        if let Some(id) = self.material_of.get(&std::ptr::from_ref(object)) {
            return Ok(*id);
        }
        let (material, two_sided) = self.bsdf(object, false)?;
        let name = object.id.clone().unwrap_or_else(|| name.to_owned());
        let notes = std::mem::take(&mut self.notes);
        if !notes.is_empty() {
            self.warnings.push(format!("material \"{name}\": replaced {}", notes.join("; ")));
        }
        let id = self.add_material(Surface { name, material, two_sided });
        self.material_of.insert(object, id);
        Ok(id)
    }

    /// A material made up by the reader.
    pub fn add_material(&mut self, surface: Surface) -> MaterialId {
        self.surfaces.push(surface);
        MaterialId(self.surfaces.len() as u32 - 1)
    }

    fn bsdf(&mut self, object: &'a Object, two_sided: bool) -> Result<(Material, bool), LoadError> {
        // A bsdf may refer to one that contains it.
        if self.building.contains(&std::ptr::from_ref(object)) {
            return Err(object.place.error(LoadErrorKind::Cycle { what: object.describe() }));
        }
        self.building.push(object);
        let result = match object.plugin.as_str() {
            "twosided" => self.twosided(object)?,
            "mask" => self.mask(object)?,
            _ => (self.simple(object)?, two_sided),
        };
        object.finish()?;
        self.building.pop();
        Ok(result)
    }

    fn nested(&mut self, object: &'a Object) -> Result<&'a Object, LoadError> {
        match object.children(self.ids, Class::BSDF).as_slice() {
            [(_, one)] => Ok(one),
            [] => Err(object.lacks("a nested bsdf")),
            [_, (second, _), ..] => {
                let what = format!("a second bsdf in {}", object.describe());
                Err(second.place.error(LoadErrorKind::Unsupported { what }))
            }
        }
    }

    fn twosided(&mut self, object: &'a Object) -> Result<(Material, bool), LoadError> {
        let nested = self.nested(object)?;
        let (material, _) = self.bsdf(nested, true)?;
        if material.is_transmissive() {
            let (expected, found) = ("an opaque bsdf in \"twosided\"".to_owned(), nested.describe());
            return Err(nested.place.error(LoadErrorKind::Malformed { expected, found }));
        }
        Ok((material, true))
    }

    /// Opaque or absent, whichever is nearer to the mean opacity.
    fn mask(&mut self, object: &'a Object) -> Result<(Material, bool), LoadError> {
        let nested = self.nested(object)?;
        // An image's alpha channel plays no part: opacity is the luminance of its colours.
        let opacity = self.texture(object, "opacity", 0.5)?.mean().luminance();
        let inner = self.bsdf(nested, false)?;
        let opaque = opacity >= 0.5;
        if opacity != 1.0 {
            let form = if opaque { "an opaque surface" } else { "nothing at all" };
            self.note(format!("mask of mean opacity {opacity:.2} by {form}"));
        }
        Ok(if opaque { inner } else { (clear(), false) })
    }

    fn simple(&mut self, object: &'a Object) -> Result<Material, LoadError> {
        match object.plugin.as_str() {
            "diffuse" => Ok(Material::Diffuse { reflectance: self.texture(object, "reflectance", 0.5)? }),
            "conductor" => self.conductor(object),
            "roughconductor" => {
                self.roughness(object)?;
                self.note("roughconductor by a smooth one".to_owned());
                self.conductor(object)
            }
            "dielectric" => self.dielectric(object),
            "roughdielectric" => {
                self.roughness(object)?;
                self.note("roughdielectric by a smooth one".to_owned());
                self.dielectric(object)
            }
            "thindielectric" => {
                let (eta, reflectance, transmittance) = self.dielectric_parts(object)?;
                Ok(Material::ThinDielectric { eta, reflectance, transmittance })
            }
            "plastic" | "roughplastic" => self.plastic(object),
            "null" => Ok(clear()),
            _ => Err(unknown_plugin(object, &KNOWN)),
        }
    }

    fn conductor(&mut self, object: &'a Object) -> Result<Material, LoadError> {
        let reflectance = self.color(object, "specular_reflectance", 1.0, Use::Reflectance)?;
        let name = object.text("material")?;
        let given = object.get("eta").is_some() || object.get("k").is_some();
        let index = match &name {
            Some(name) if given => return Err(name.must_be("material", "left out beside eta and k")),
            None if given => {
                let (eta, k) = (self.color(object, "eta", 0.0, Use::Index)?, self.color(object, "k", 1.0, Use::Index)?);
                // Index 0 + i k reflects everything, and so does Mitsuba's "none".
                (!eta.is_black() || k.is_black()).then_some((eta, k))
            }
            None => None,
            Some(name) if name.value == "none" => None,
            Some(name) => {
                let known: Vec<_> = ior::METALS.iter().map(|m| m.0).chain(["none"]).collect();
                let expected = || format!("one of {}, or given by eta and k", known.join(", "));
                Some(ior::metal(name.value).ok_or_else(|| name.must_be("material", &expected()))?)
            }
        };
        Ok(Material::Conductor { index, reflectance })
    }

    fn dielectric(&mut self, object: &'a Object) -> Result<Material, LoadError> {
        let (eta, reflectance, transmittance) = self.dielectric_parts(object)?;
        Ok(Material::Dielectric { eta, reflectance, transmittance })
    }

    fn dielectric_parts(&mut self, object: &'a Object) -> Result<(f64, Rgb, Rgb), LoadError> {
        let eta = relative_index(object, "bk7")?;
        let reflectance = self.color(object, "specular_reflectance", 1.0, Use::Reflectance)?;
        let transmittance = self.color(object, "specular_transmittance", 1.0, Use::Reflectance)?;
        Ok((eta, reflectance, transmittance))
    }

    /// A coated diffuse base by a diffuse surface that reflects as much of a uniform light, gloss and base together.
    ///
    /// Without the gloss an interior with a polished floor loses a tenth of its light.
    fn plastic(&mut self, object: &'a Object) -> Result<Material, LoadError> {
        let eta = relative_index(object, "polypropylene")?;
        let nonlinear = object.boolean("nonlinear", false)?;
        let base = self.texture(object, "diffuse_reflectance", 0.5)?;
        let tint = self.color(object, "specular_reflectance", 1.0, Use::Reflectance)?;
        let albedo = if object.plugin == "plastic" {
            CoatedAlbedo::smooth(eta, nonlinear)
        } else {
            let roughness = self.roughness(object)?;
            CoatedAlbedo::rough(eta, roughness.alpha, roughness.distribution, nonlinear)
        };
        self.note(format!("{} by a diffuse surface of its albedo, gloss included", object.plugin));
        let reflected = |rho| (albedo.of(rho) + tint * albedo.gloss()).map(|v| v.min(1.0));
        Ok(Material::Diffuse { reflectance: base.map(reflected) })
    }

    fn roughness(&mut self, object: &'a Object) -> Result<Roughness, LoadError> {
        object.boolean("sample_visible", true)?;
        let kinds = [("beckmann", Distribution::Beckmann), ("ggx", Distribution::Ggx)];
        let distribution = object.choice("distribution", &kinds)?;
        let mut alpha = 0.1;
        for name in ["alpha", "alpha_u", "alpha_v"] {
            if let Some(property) = object.get(name) {
                alpha = self.color(object, name, alpha, Use::Index)?.mean();
                if alpha <= 0.0 {
                    return Err(property.must_be("above 0"));
                }
            }
        }
        Ok(Roughness { alpha, distribution })
    }
}

struct Roughness {
    alpha: f64,
    distribution: Distribution,
}

/// A surface that light passes as if it were not there: a plate of index 1.
fn clear() -> Material {
    Material::ThinDielectric { eta: 1.0, reflectance: Rgb::WHITE, transmittance: Rgb::WHITE }
}

/// Index inside over index outside.
fn relative_index(object: &Object, default_inside: &str) -> Result<f64, LoadError> {
    Ok(index(object, "int_ior", default_inside)? / index(object, "ext_ior", "air")?)
}

fn index(object: &Object, name: &'static str, default: &str) -> Result<f64, LoadError> {
    let Some(property) = object.get(name) else { return Ok(ior::dielectric(default).unwrap_or(1.0)) };
    match &property.value {
        Value::Text(medium) => ior::dielectric(medium).ok_or_else(|| {
            let near = near(medium, ior::DIELECTRICS.iter().map(|d| d.0));
            property.must_be(&format!("a number or a known medium ({}, ...)", near.join(", ")))
        }),
        Value::Float(ior) if *ior > 0.0 => Ok(*ior),
        Value::Integer(ior) if *ior > 0 => Ok(*ior as f64),
        _ => Err(property.must_be("an index of refraction above 0")),
    }
}

/// Mitsuba's material of a shape without one: grey one half, or black if the shape emits.
pub(super) fn default_surface(emits: bool) -> Surface {
    let (name, rho) = if emits { ("default of emitters", 0.0) } else { ("default", 0.5) };
    let reflectance = Texture::Constant(Rgb::grey(rho));
    Surface { name: name.to_owned(), material: Material::Diffuse { reflectance }, two_sided: false }
}
