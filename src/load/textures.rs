//! Colours and `<texture>`: constants, bitmaps, checkerboards.

use super::error::{LoadError, LoadErrorKind};
use super::files::Files;
use super::mitsuba::{Loader, unknown_plugin};
use super::object::{Class, Object, Property, Value};
use super::picture::{self, Picture};
use crate::material::Texture;
use crate::material::texture::{Bitmap, Checkerboard, Filter, Wrap};
use crate::math::Rgb;
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::PathBuf;

/// What a colour is used for, and so what values it may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Use {
    /// In [0, 1].
    Reflectance,
    /// 0 or more.
    Index,
}

/// Images by path and whether they are raw. A fault is told where the image is asked for.
pub(super) type Pictures = HashMap<(PathBuf, bool), Result<Picture, LoadErrorKind>>;

/// Decodes the images of all objects under `root`, side by side.
pub(super) fn decode_all(root: &Object, files: &Files) -> Pictures {
    let mut keys = Vec::new();
    image_files(root, files, &mut keys);
    keys.sort();
    keys.dedup();
    keys.into_par_iter().map(|key| (key.clone(), decode_file(files, &key))).collect()
}

/// Paths that can be read of all bitmaps and environment maps; what is wrong with the others is told later.
fn image_files(object: &Object, files: &Files, keys: &mut Vec<(PathBuf, bool)>) {
    let of = |name: &str| object.properties.iter().find(|p| p.name == name).map(|p| &p.value);
    if matches!(object.plugin.as_str(), "bitmap" | "envmap")
        && let Some(Value::Text(name)) = of("filename")
        && let Ok(path) = files.resolve(name)
    {
        keys.push((path, matches!(of("raw"), Some(Value::Boolean(true)))));
    }
    for property in &object.properties {
        if let Value::Object(child) = &property.value {
            image_files(child, files, keys);
        }
    }
}

fn decode_file(files: &Files, (path, raw): &(PathBuf, bool)) -> Result<Picture, LoadErrorKind> {
    let bytes = files.read(path, files.limits.image_bytes)?;
    picture::decode(&bytes, path, *raw, files)
}

impl Use {
    fn check(self, value: Rgb) -> Result<Rgb, &'static str> {
        let limit = if self == Use::Reflectance { 1.0 } else { f64::INFINITY };
        if value.is_finite() && value.min() >= 0.0 && value.max() <= limit {
            Ok(value)
        } else if self == Use::Reflectance {
            Err("a colour with every channel from 0 to 1")
        } else {
            Err("a colour with every channel 0 or more")
        }
    }
}

impl<'a> Loader<'a> {
    /// The texture `name` of an object, or a grey `default`.
    pub fn texture(&mut self, object: &'a Object, name: &'static str, default: f64) -> Result<Texture, LoadError> {
        self.texture_for(object, name, default, Use::Reflectance)
    }

    /// One colour: the mean of `name` if it is a texture, which is noted as an approximation.
    pub fn color(&mut self, object: &'a Object, name: &'static str, default: f64, purpose: Use) -> Result<Rgb, LoadError> {
        let texture = self.texture_for(object, name, default, purpose)?;
        if !matches!(texture, Texture::Constant(_)) {
            self.note(format!("its {name} by the texture's mean"));
        }
        Ok(texture.mean())
    }

    /// The texture `name` of an object with values fit for a purpose, or a grey `default`.
    pub fn texture_for(
        &mut self,
        object: &'a Object,
        name: &'static str,
        default: f64,
        purpose: Use,
    ) -> Result<Texture, LoadError> {
        let Some(property) = object.get(name) else { return Ok(Texture::grey(default)) };
        let value = match &property.value {
            Value::Rgb(value) => *value,
            // As a reflectance, a spectrum that is the same at all wavelengths is grey.
            Value::Uniform(value) | Value::Float(value) => Rgb::grey(*value),
            Value::Integer(value) => Rgb::grey(*value as f64),
            _ => return self.child_texture(property, purpose),
        };
        purpose.check(value).map(Texture::Constant).map_err(|expected| property.must_be(expected))
    }

    fn child_texture(&mut self, property: &'a Property, purpose: Use) -> Result<Texture, LoadError> {
        let object = self.texture_of(property).ok_or_else(|| property.must_be("a colour or a texture"))?;
        let texture = self.texture_object(object)?;
        if let Some((expected, found)) = misfit(&texture, purpose) {
            let (name, expected) = (property.name.clone(), expected.to_owned());
            return Err(property.place.error(LoadErrorKind::Value { name, expected, found }));
        }
        Ok(texture)
    }

    /// The `<texture>` that a property holds or refers to.
    pub fn texture_of(&self, property: &'a Property) -> Option<&'a Object> {
        let object = match &property.value {
            Value::Object(object) => object,
            Value::Reference(id) => self.ids.get(id.as_str()).copied()?,
            _ => return None,
        };
        (object.class == Class::TEXTURE).then_some(object)
    }

    /// The texture that a `<texture>` element describes.
    pub fn texture_object(&mut self, object: &'a Object) -> Result<Texture, LoadError> {
        // A texture may refer to one that contains it.
        if self.building.contains(&std::ptr::from_ref(object)) {
            return Err(object.place.error(LoadErrorKind::Cycle { what: object.describe() }));
        }
        self.building.push(object);
        let texture = match object.plugin.as_str() {
            "bitmap" => Texture::Bitmap(self.bitmap(object)?),
            "checkerboard" => Texture::Checkerboard(Box::new(self.checkerboard(object)?)),
            _ => return Err(unknown_plugin(object, &["bitmap", "checkerboard"])),
        };
        object.finish()?;
        self.building.pop();
        Ok(texture)
    }

    fn bitmap(&mut self, object: &'a Object) -> Result<Bitmap, LoadError> {
        object.ignore(&["format", "accel"]);
        let raw = object.boolean("raw", false)?;
        let filter = object.choice("filter_type", &[("bilinear", Filter::Bilinear), ("nearest", Filter::Nearest)])?;
        let wrap = object.choice("wrap_mode", &[("repeat", Wrap::Repeat), ("mirror", Wrap::Mirror), ("clamp", Wrap::Clamp)])?;
        let Picture { width, height, texels } = self.picture(object, raw)?;
        Ok(Bitmap { width, height, texels, filter, wrap, to_uv: to_uv(object)? })
    }

    /// The decoded image of an object's `filename`; each file is decoded once.
    pub fn picture(&mut self, object: &'a Object, raw: bool) -> Result<Picture, LoadError> {
        let name = object.needed_text("filename")?;
        let failed = |kind| name.place.error(kind);
        let key = (self.files.resolve(name.value).map_err(failed)?, raw);
        let picture = match self.pictures.remove(&key) {
            Some(decoded) => decoded,
            None => decode_file(self.files, &key),
        };
        let picture = picture.map_err(failed)?;
        self.pictures.insert(key, Ok(picture.clone()));
        Ok(picture)
    }

    fn checkerboard(&mut self, object: &'a Object) -> Result<Checkerboard, LoadError> {
        // Defaults of Mitsuba. What the values may be is known to the one who asked for the texture.
        let colors = [self.texture_for(object, "color0", 0.4, Use::Index)?, self.texture_for(object, "color1", 0.2, Use::Index)?];
        Ok(Checkerboard { colors, to_uv: to_uv(object)? })
    }
}

/// What is expected of a texture's values and the first that is not so.
fn misfit(texture: &Texture, purpose: Use) -> Option<(&'static str, String)> {
    match texture {
        Texture::Constant(c) => purpose.check(*c).err().map(|expected| (expected, format!("rgb {}, {}, {}", c.r, c.g, c.b))),
        Texture::Bitmap(bitmap) => {
            let faulty = |t: [f32; 3]| purpose.check(t.into()).err();
            let (i, expected) = bitmap.texels.iter().enumerate().find_map(|(i, t)| Some((i, faulty(t)?)))?;
            Some((expected, format!("{:?} at ({}, {})", bitmap.texels.at(i), i % bitmap.width, i / bitmap.width)))
        }
        Texture::Checkerboard(board) => board.colors.iter().find_map(|t| misfit(t, purpose)),
    }
}

fn to_uv(object: &Object) -> Result<[[f32; 3]; 2], LoadError> {
    let m = object.transform("to_uv")?;
    let row = |i: usize| [m.matrix3.x_axis[i] as f32, m.matrix3.y_axis[i] as f32, m.translation[i] as f32];
    Ok([row(0), row(1)])
}
