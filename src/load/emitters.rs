//! Emitters: radiance of shapes, lights without a shape, and what surrounds the scene.

use super::error::{LoadError, LoadErrorKind};
use super::mitsuba::{Loader, unknown_plugin};
use super::object::{Object, Property, Value};
use super::spectrum;
use crate::light::Environment;
use crate::material::Texture;
use crate::math::{DAffine3, DMat3, DVec3, Rgb};
use crate::scene::LightSource;

/// Relative departure from equal and perpendicular axes that counts as rounding of the numbers in a file.
const SAME_SHAPE: f64 = 1e-4;

/// What is wrong with a colour of light.
const NOT_LIGHT: &str = "a colour with every channel 0 or more";

impl<'a> Loader<'a> {
    /// Radiance of an emitter that sits in a shape [W/(m² sr)].
    pub fn area_radiance(&mut self, emitter: &'a Object) -> Result<Texture, LoadError> {
        match emitter.plugin.as_str() {
            "area" => {}
            "directionalarea" => return Err(unsupported(emitter, "emits along its normal only")),
            _ => return Err(unknown_plugin(emitter, &["area"])),
        }
        let radiance = self.light_texture(emitter, "radiance")?;
        emitter.finish()?;
        Ok(radiance)
    }

    /// An emitter of its own.
    pub fn emitter(&mut self, emitter: &'a Object) -> Result<(), LoadError> {
        match emitter.plugin.as_str() {
            "point" => {
                let intensity = self.light(emitter, "intensity")?;
                self.lights.push(LightSource::Point { position: point_position(emitter)?, intensity });
            }
            "spot" => self.spot(emitter)?,
            "directional" => self.directional(emitter)?,
            "constant" => {
                let radiance = self.light(emitter, "radiance")?;
                self.surround(emitter, Environment::Uniform(radiance))?;
            }
            "envmap" => self.envmap(emitter)?,
            "sky" | "sun" | "sunsky" | "timed_sunsky" => {
                return Err(unsupported(emitter, "has no model here: bake it into an image and use an envmap"));
            }
            "projector" => return Err(unsupported(emitter, "casts an image")),
            _ => return Err(unknown_plugin(emitter, &["point", "spot", "directional", "constant", "envmap", "area"])),
        }
        emitter.finish()
    }

    fn spot(&mut self, emitter: &'a Object) -> Result<(), LoadError> {
        let intensity = self.light(emitter, "intensity")?;
        let tint = match emitter.get("texture") {
            Some(texture) if self.texture_of(texture).is_some() => {
                let what = format!("the image that {} casts", emitter.describe());
                return Err(texture.place.error(LoadErrorKind::Unsupported { what }));
            }
            _ => self.light(emitter, "texture")?,
        };
        let cutoff = emitter.float_in("cutoff_angle", 20.0, |a| a > 0.0 && a <= 180.0, "above 0 and at most 180 degrees")?;
        let expected = format!("from 0 to the cut-off angle of {cutoff} degrees");
        let beam_width = emitter.float_in("beam_width", 0.75 * cutoff, |a| (0.0..=cutoff).contains(&a), &expected)?;
        let to_world = emitter.transform("to_world")?;
        let (axes, _) = similarity(emitter, &to_world)?;
        self.lights.push(LightSource::Spot {
            position: to_world.translation,
            axis: axes.z_axis,
            intensity: intensity * tint,
            cutoff: cutoff.to_radians(),
            beam_width: beam_width.to_radians(),
        });
        Ok(())
    }

    fn directional(&mut self, emitter: &'a Object) -> Result<(), LoadError> {
        let irradiance = self.light(emitter, "irradiance")?;
        let to_world = emitter.transform("to_world")?;
        let direction = match emitter.point("direction")? {
            None => to_world.transform_vector3(DVec3::Z).normalize(),
            Some(direction) if emitter.get("to_world").is_some() => return Err(one_of_two(&direction.place, "direction")),
            Some(direction) => direction.value.try_normalize().ok_or_else(|| {
                let (expected, found) = ("a vector with a length".to_owned(), format!("{}", direction.value));
                direction.place.error(LoadErrorKind::Value { name: "direction".to_owned(), expected, found })
            })?,
        };
        self.lights.push(LightSource::Directional { direction, irradiance });
        Ok(())
    }

    fn surround(&mut self, emitter: &Object, environment: Environment) -> Result<(), LoadError> {
        if self.environment.replace(environment).is_some() {
            let (expected, found) = ("one surrounding emitter at most".to_owned(), "a second".to_owned());
            return Err(emitter.place.error(LoadErrorKind::Malformed { expected, found }));
        }
        Ok(())
    }

    fn envmap(&mut self, emitter: &'a Object) -> Result<(), LoadError> {
        // How Mitsuba samples the map has no bearing on its light.
        emitter.ignore(&["mis_compensation"]);
        let to_world = emitter.transform("to_world")?;
        let (axes, scale) = similarity(emitter, &to_world)?;
        if (scale - 1.0).abs() > SAME_SHAPE {
            return Err(transform_must_be(emitter, "a rotation, for an environment map", "one that scales"));
        }
        let scale = emitter.float_in("scale", 1.0, |s| s >= 0.0, "0 or more")?;
        let mut picture = self.picture(emitter, false)?;
        let place = || emitter.get("filename").map_or(&emitter.place, |p| &p.place);
        if picture.width < 2 || picture.height < 3 {
            let expected = "an environment map of 2 x 3 pixels or more".to_owned();
            let found = format!("{} x {}", picture.width, picture.height);
            return Err(place().error(LoadErrorKind::Malformed { expected, found }));
        }
        let negative = picture.texels.iter().filter(|t| t.iter().any(|v| *v < 0.0)).count();
        if negative > 0 {
            self.warnings.push(format!("envmap: {negative} texels below 0 count as 0"));
            picture.texels = picture.texels.iter().map(|t| t.map(|v| v.max(0.0))).collect();
        }
        let map = Environment::map(picture.width, picture.height, picture.texels, scale, axes);
        self.surround(emitter, map)
    }

    /// Radiance over a surface; (1, 1, 1) unless given.
    fn light_texture(&mut self, emitter: &'a Object, name: &'static str) -> Result<Texture, LoadError> {
        let Some(object) = emitter.get(name).and_then(|property| self.texture_of(property)) else {
            return Ok(Texture::Constant(self.light(emitter, name)?));
        };
        let texture = self.texture_object(object)?;
        if let Texture::Bitmap(bitmap) = &texture
            && let Some(i) = bitmap.texels.iter().position(|t| !is_light(t.into()))
        {
            let found = format!("{:?} at ({}, {})", bitmap.texels.at(i), i % bitmap.width, i / bitmap.width);
            let (name, expected) = (name.to_owned(), NOT_LIGHT.to_owned());
            return Err(object.place.error(LoadErrorKind::Value { name, expected, found }));
        }
        Ok(texture)
    }

    /// Radiance or intensity that is the same everywhere; (1, 1, 1) unless given.
    fn light(&mut self, emitter: &'a Object, name: &'static str) -> Result<Rgb, LoadError> {
        let Some(property) = emitter.get(name) else { return Ok(Rgb::WHITE) };
        let value = self.light_value(emitter, property)?;
        if is_light(value) { Ok(value) } else { Err(property.must_be(NOT_LIGHT)) }
    }

    fn light_value(&mut self, emitter: &Object, property: &'a Property) -> Result<Rgb, LoadError> {
        match &property.value {
            Value::Rgb(value) => Ok(*value),
            Value::Uniform(value) => Ok(spectrum::EQUAL_ENERGY * *value),
            Value::Spectrum(samples) => {
                let (colour, beyond) = spectrum::light(samples);
                if beyond {
                    let what = format!("{}: its {} lies beyond the sRGB gamut and is clipped", emitter.describe(), property.name);
                    self.warnings.push(what);
                }
                Ok(colour)
            }
            _ => {
                let texture = self.texture_of(property).ok_or_else(|| property.must_be("an rgb, a spectrum or a texture"))?;
                let what = format!("a textured {} of {}", property.name, emitter.describe());
                Err(texture.place.error(LoadErrorKind::Unsupported { what }))
            }
        }
    }
}

fn is_light(value: Rgb) -> bool {
    value.is_finite() && value.min() >= 0.0
}

/// The error that an emitter is known, but `why` it cannot be rendered.
fn unsupported(emitter: &Object, why: &str) -> LoadError {
    let what = format!("{}, which {why},", emitter.describe());
    emitter.place.error(LoadErrorKind::Unsupported { what })
}

fn one_of_two(place: &super::error::Place, name: &str) -> LoadError {
    place.error(LoadErrorKind::Malformed { expected: format!("either {name} or to_world"), found: "both".to_owned() })
}

fn transform_must_be(emitter: &Object, expected: &str, found: &str) -> LoadError {
    let place = emitter.get("to_world").map_or(&emitter.place, |p| &p.place);
    let (name, expected, found) = ("to_world".to_owned(), expected.to_owned(), found.to_owned());
    place.error(LoadErrorKind::Value { name, expected, found })
}

/// Orthonormal axes, perhaps left-handed, and the scale of a transform that keeps angles; an error for any other.
fn similarity(emitter: &Object, to_world: &DAffine3) -> Result<(DMat3, f64), LoadError> {
    let m = to_world.matrix3;
    let scale = m.determinant().abs().cbrt();
    let gram = m.transpose() * m * (scale * scale).recip();
    let departure = (gram - DMat3::IDENTITY).to_cols_array().into_iter().fold(0.0, |worst: f64, v| worst.max(v.abs()));
    if departure > SAME_SHAPE {
        return Err(transform_must_be(emitter, "rotations and one scale for all axes", "one that stretches or shears"));
    }
    // Gram and Schmidt take away the rounding of the numbers in the file.
    let z = m.z_axis.normalize();
    let y = m.y_axis.reject_from_normalized(z).normalize();
    let x = y.cross(z) * m.determinant().signum();
    Ok((DMat3::from_cols(x, y, z), scale))
}

fn point_position(emitter: &Object) -> Result<DVec3, LoadError> {
    let to_world = emitter.transform("to_world")?;
    let Some(position) = emitter.point("position")? else { return Ok(to_world.translation) };
    if emitter.get("to_world").is_some() {
        return Err(one_of_two(&position.place, "position"));
    }
    Ok(position.value)
}
