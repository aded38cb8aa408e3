//! `<bsdf>` to [`Material`]. What is not supported exactly is rendered by its nearest supported form, with one warning a material.

use super::error::{LoadError, LoadErrorKind, near};
use super::ior;
use super::mitsuba::{Loader, unknown_plugin};
use super::object::{Class, Object, Value};
use super::textures::Use;
use crate::material::plastic::Base;
use crate::material::principled::Parameters;
use crate::material::{
    Distribution, Material, MaterialId, Plastic, Principled, Relief, ReliefMap, RoughConductor, RoughDielectric, RoughPlastic,
    Surface, Texture,
};
use crate::math::Rgb;

/// All that can be read.
const KNOWN: [&str; 15] = [
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
    "blendbsdf",
    "bumpmap",
    "normalmap",
    "principled",
    "null",
];

/// A material on its way to a [`Surface`].
struct Built {
    material: Material,
    two_sided: bool,
    relief: Option<Relief>,
}

impl Built {
    fn one_sided(material: Material) -> Self {
        Self { material, two_sided: false, relief: None }
    }

    /// The material for a place where the frame is not mirrored for a viewer below.
    fn facing_both_ways(material: Material, two_sided: bool) -> Material {
        if two_sided { Material::TwoSided(Box::new(material)) } else { material }
    }
}

impl<'a> Loader<'a> {
    /// The material of a `<bsdf>`, made once however many shapes use it. `name` serves if it has no id.
    pub fn material(&mut self, object: &'a Object, name: &str) -> Result<MaterialId, LoadError> {
        if let Some(id) = self.material_of.get(&std::ptr::from_ref(object)) {
            return Ok(*id);
        }
        let Built { material, two_sided, relief } = self.bsdf(object)?;
        let name = object.id.clone().unwrap_or_else(|| name.to_owned());
        let notes = std::mem::take(&mut self.notes);
        if !notes.is_empty() {
            self.warnings.push(format!("material \"{name}\": replaced {}", notes.join("; ")));
        }
        let id = self.add_material(Surface { name, material, two_sided, relief });
        self.material_of.insert(object, id);
        Ok(id)
    }

    /// A material made up by the reader.
    pub fn add_material(&mut self, surface: Surface) -> MaterialId {
        self.surfaces.push(surface);
        MaterialId(self.surfaces.len() as u32 - 1)
    }

    fn bsdf(&mut self, object: &'a Object) -> Result<Built, LoadError> {
        // A bsdf may refer to one that contains it.
        if self.building.contains(&std::ptr::from_ref(object)) {
            return Err(object.place.error(LoadErrorKind::Cycle { what: object.describe() }));
        }
        self.building.push(object);
        let built = match object.plugin.as_str() {
            "twosided" => self.twosided(object)?,
            "mask" => self.mask(object)?,
            "blendbsdf" => self.blend(object)?,
            "bumpmap" | "normalmap" => self.relief(object)?,
            _ => Built::one_sided(self.simple(object)?),
        };
        object.finish()?;
        self.building.pop();
        Ok(built)
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

    fn twosided(&mut self, object: &'a Object) -> Result<Built, LoadError> {
        let nested = self.nested(object)?;
        let built = self.bsdf(nested)?;
        if built.material.is_transmissive() {
            let (expected, found) = ("an opaque bsdf in \"twosided\"".to_owned(), nested.describe());
            return Err(nested.place.error(LoadErrorKind::Malformed { expected, found }));
        }
        Ok(Built { two_sided: true, ..built })
    }

    fn mask(&mut self, object: &'a Object) -> Result<Built, LoadError> {
        let nested = self.nested(object)?;
        // An image's alpha channel plays no part: opacity is the luminance of its colours.
        let opacity = self.texture(object, "opacity", 0.5)?;
        let built = self.bsdf(nested)?;
        Ok(match opacity {
            Texture::Constant(all) if all == Rgb::WHITE => built,
            Texture::Constant(none) if none.is_black() => Built::one_sided(Material::Null),
            opacity => {
                let inner = Box::new(Built::facing_both_ways(built.material, built.two_sided));
                Built { material: Material::Mask { opacity, inner }, ..built }
            }
        })
    }

    fn blend(&mut self, object: &'a Object) -> Result<Built, LoadError> {
        let children = object.children(self.ids, Class::BSDF);
        let [(_, first), (_, second)] = children.as_slice() else {
            return Err(object.lacks(&format!("two nested bsdfs; it has {}", children.len())));
        };
        if object.get("weight").is_none() {
            return Err(object.lacks("the texture or number \"weight\""));
        }
        let weight = self.texture(object, "weight", 0.5)?;
        let (a, b) = (self.bsdf(first)?, self.bsdf(second)?);
        if a.relief.is_some() || b.relief.is_some() {
            let what = format!("a bump or normal map within {}, rather than around it,", object.describe());
            return Err(object.place.error(LoadErrorKind::Unsupported { what }));
        }
        let two_sided = a.two_sided || b.two_sided;
        let mirrors = a.two_sided == b.two_sided && !a.material.is_transmissive() && !b.material.is_transmissive();
        let part = |b: Built| if mirrors { b.material } else { Built::facing_both_ways(b.material, b.two_sided) };
        let parts = Box::new([part(a), part(b)]);
        if parts.iter().map(refractions).sum::<usize>() > 2 {
            let what = format!("more than two smooth dielectrics in {}", object.describe());
            return Err(object.place.error(LoadErrorKind::Unsupported { what }));
        }
        Ok(Built { material: Material::Blend { weight, parts }, two_sided, relief: None })
    }

    fn relief(&mut self, object: &'a Object) -> Result<Built, LoadError> {
        let nested = self.nested(object)?;
        let map = if object.plugin == "bumpmap" {
            let scale = object.float_in("scale", 1.0, f64::is_finite, "a finite number")?;
            match object.children(self.ids, Class::TEXTURE).as_slice() {
                [(property, texture)] => match self.texture_object(texture)? {
                    texture @ Texture::Bitmap(_) => ReliefMap::Bump { texture, scale },
                    _ => return Err(property.must_be("a bitmap, which has slopes")),
                },
                other => return Err(object.lacks(&format!("one nested texture; it has {}", other.len()))),
            }
        } else {
            let property = object.get("normalmap").ok_or_else(|| object.lacks("the texture \"normalmap\""))?;
            let texture = self.texture_of(property).ok_or_else(|| property.must_be("a texture"))?;
            ReliefMap::Normal { texture: self.texture_object(texture)? }
        };
        let flips_invalid = object.boolean("flip_invalid_normals", true)?;
        let has_shadowing = object.boolean("use_shadowing_function", true)?;
        let built = self.bsdf(nested)?;
        if built.relief.is_some() {
            let what = format!("a second bump or normal map in {}", object.describe());
            return Err(nested.place.error(LoadErrorKind::Unsupported { what }));
        }
        Ok(Built { relief: Some(Relief { map, flips_invalid, has_shadowing }), ..built })
    }

    fn simple(&mut self, object: &'a Object) -> Result<Material, LoadError> {
        match object.plugin.as_str() {
            "diffuse" => Ok(Material::Diffuse { reflectance: self.texture(object, "reflectance", 0.5)? }),
            "conductor" => {
                let (index, reflectance) = self.conductor_parts(object)?;
                Ok(Material::Conductor { index, reflectance })
            }
            "roughconductor" => {
                let (distribution, alpha) = self.roughness(object)?;
                let (index, reflectance) = self.conductor_parts(object)?;
                Ok(Material::RoughConductor(Box::new(RoughConductor::new(distribution, alpha, index, reflectance))))
            }
            "dielectric" => {
                let (eta, reflectance, transmittance) = self.dielectric_parts(object)?;
                Ok(Material::Dielectric { eta, reflectance, transmittance })
            }
            "roughdielectric" => {
                let (distribution, alpha) = self.roughness(object)?;
                let (eta, reflectance, transmittance) = self.dielectric_parts(object)?;
                differing(object, eta)?;
                let glass = RoughDielectric::new(distribution, alpha, eta, reflectance, transmittance);
                Ok(Material::RoughDielectric(Box::new(glass)))
            }
            "thindielectric" => {
                let (eta, reflectance, transmittance) = self.dielectric_parts(object)?;
                Ok(Material::ThinDielectric { eta, reflectance, transmittance })
            }
            "plastic" => {
                let (eta, base, tint) = self.plastic_parts(object)?;
                Ok(Material::Plastic(Box::new(Plastic::new(eta, base, tint))))
            }
            "roughplastic" => {
                let distribution = distribution(object)?;
                let alpha = object.float_in("alpha", 0.1, |a| a > 0.0 && a.is_finite(), "a number above 0")?;
                let (eta, base, tint) = self.plastic_parts(object)?;
                differing(object, eta)?;
                Ok(Material::RoughPlastic(Box::new(RoughPlastic::new(distribution, alpha, eta, base, tint))))
            }
            "principled" => {
                let principled = Principled::new(self.principled_parts(object)?);
                let albedo = principled.largest_diffuse_albedo();
                if albedo > 0.999 {
                    let of = object.describe();
                    self.warnings.push(format!("{of}: its diffuse part reflects {albedo:.3} of the light; pass one takes 0.999"));
                }
                Ok(Material::Principled(Box::new(principled)))
            }
            "null" => Ok(Material::Null),
            _ => Err(unknown_plugin(object, &KNOWN)),
        }
    }

    fn conductor_parts(&mut self, object: &'a Object) -> Result<(Option<(Rgb, Rgb)>, Texture), LoadError> {
        let reflectance = self.texture(object, "specular_reflectance", 1.0)?;
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
                let near = near(name.value, ior::METALS.iter().map(|m| m.0)).join(", ");
                let expected = || format!("one of Ag, Al, Au, Cr, Cu, W, ..., none (nearest: {near}), or given by eta and k");
                Some(ior::metal(name.value).ok_or_else(|| name.must_be("material", &expected()))?)
            }
        };
        Ok((index, reflectance))
    }

    fn dielectric_parts(&mut self, object: &'a Object) -> Result<(f64, Texture, Texture), LoadError> {
        let eta = relative_index(object, "bk7")?;
        let reflectance = self.texture(object, "specular_reflectance", 1.0)?;
        let transmittance = self.texture(object, "specular_transmittance", 1.0)?;
        Ok((eta, reflectance, transmittance))
    }

    /// Index of the coat, the base under it, and the factor on what it reflects.
    fn plastic_parts(&mut self, object: &'a Object) -> Result<(f64, Base, Texture), LoadError> {
        let eta = relative_index(object, "polypropylene")?;
        let nonlinear = object.boolean("nonlinear", false)?;
        let base = Base { reflectance: self.texture(object, "diffuse_reflectance", 0.5)?, nonlinear };
        Ok((eta, base, self.texture(object, "specular_reflectance", 1.0)?))
    }

    fn principled_parts(&mut self, object: &'a Object) -> Result<Parameters, LoadError> {
        let mut texture = |name, default| self.texture(object, name, default);
        let spec_trans = texture("spec_trans", 0.0)?;
        let rate = |name| object.float_in(name, 1.0, |r| r >= 0.0 && r.is_finite(), "a number 0 or more");
        Ok(Parameters {
            base_color: texture("base_color", 0.5)?,
            roughness: texture("roughness", 0.5)?,
            anisotropic: texture("anisotropic", 0.0)?,
            metallic: texture("metallic", 0.0)?,
            spec_tint: texture("spec_tint", 0.0)?,
            sheen: texture("sheen", 0.0)?,
            sheen_tint: texture("sheen_tint", 0.0)?,
            flatness: texture("flatness", 0.0)?,
            clearcoat: texture("clearcoat", 0.0)?,
            clearcoat_gloss: texture("clearcoat_gloss", 0.0)?,
            eta: principled_index(object, spec_trans.max_scalar() > 0.0)?,
            rates: [
                rate("diffuse_reflectance_sampling_rate")?,
                rate("clearcoat_sampling_rate")?,
                rate("main_specular_sampling_rate")?,
            ],
            spec_trans,
        })
    }

    /// Distribution and roughness along both tangents.
    fn roughness(&mut self, object: &'a Object) -> Result<(Distribution, [Texture; 2]), LoadError> {
        let distribution = distribution(object)?;
        let pair = object.get("alpha_u").or(object.get("alpha_v"));
        let Some(one) = pair else {
            let alpha = self.alpha(object, "alpha")?;
            return Ok((distribution, [alpha.clone(), alpha]));
        };
        if object.get("alpha").is_some() {
            return Err(one.must_be("left out beside \"alpha\""));
        }
        for name in ["alpha_u", "alpha_v"] {
            if object.get(name).is_none() {
                return Err(object.lacks(&format!("\"{name}\" beside \"{}\"", one.name)));
            }
        }
        Ok((distribution, [self.alpha(object, "alpha_u")?, self.alpha(object, "alpha_v")?]))
    }

    /// A roughness: a number above 0, or a texture, whose zeros are raised to the smallest roughness.
    fn alpha(&mut self, object: &'a Object, name: &'static str) -> Result<Texture, LoadError> {
        let alpha = self.texture_for(object, name, 0.1, Use::Index)?;
        match (&alpha, object.get(name)) {
            (Texture::Constant(value), Some(property)) if value.mean() <= 0.0 => Err(property.must_be("above 0")),
            _ => Ok(alpha),
        }
    }
}

fn distribution(object: &Object) -> Result<Distribution, LoadError> {
    // Another way of drawing directions, of the same mean.
    object.boolean("sample_visible", true)?;
    object.choice("distribution", &[("beckmann", Distribution::Beckmann), ("ggx", Distribution::Ggx)])
}

/// Relative index of a principled material: `eta`, or from `specular`, 0.08 times which is the reflectance at normal view.
fn principled_index(object: &Object, transmits: bool) -> Result<f64, LoadError> {
    if let (Some(specular), true) = (object.get("specular"), object.get("eta").is_some()) {
        return Err(specular.must_be("left out beside \"eta\""));
    }
    // Where light is refracted, Mitsuba moves an index of 1 by a little.
    if object.get("eta").is_some() {
        let eta = object.float_in("eta", 1.5, |eta| eta > 0.0 && eta.is_finite(), "a number above 0")?;
        return Ok(if transmits && eta == 1.0 { 1.001 } else { eta });
    }
    let specular = object.float_in("specular", 0.5, |s| (0.0..=1.0).contains(&s), "a number from 0 to 1")?;
    let specular = if transmits && specular == 0.0 { 1e-3 } else { specular };
    Ok(2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0)
}

/// An error if the index is the same on both sides, where a rough boundary has no meaning.
fn differing(object: &Object, eta: f64) -> Result<(), LoadError> {
    if eta != 1.0 {
        return Ok(());
    }
    let (name, expected) = ("int_ior".to_owned(), "other than \"ext_ior\"".to_owned());
    Err(object.place.error(LoadErrorKind::Value { name, expected, found: "the same".to_owned() }))
}

/// Number of smooth boundaries that each bend light their own way.
fn refractions(material: &Material) -> usize {
    match material {
        Material::Dielectric { .. } => 1,
        Material::Mask { inner, .. } | Material::TwoSided(inner) => refractions(inner),
        Material::Blend { parts, .. } => parts.iter().map(refractions).sum(),
        _ => 0,
    }
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
    let material = Material::Diffuse { reflectance: Texture::grey(rho) };
    Surface { name: name.to_owned(), material, two_sided: false, relief: None }
}
