//! Emitters: radiance of shapes, point lights, and what surrounds the scene.

use super::error::{LoadError, LoadErrorKind};
use super::mitsuba::{Loader, unknown_plugin};
use super::object::{Object, Value};
use crate::math::{DVec3, Rgb};
use std::f64::consts::PI;

/// Linear sRGB of light with the same power at all wavelengths and Y = 1: the first column sums of the XYZ to sRGB matrix
/// (IEC 61966-2-1) over X = Y = Z = 1.
const EQUAL_ENERGY: Rgb = Rgb::new(1.204_785, 0.948_301, 0.908_843);

impl<'a> Loader<'a> {
    /// Radiance of an emitter that sits in a shape [W/(m² sr)].
    pub fn area_radiance(&mut self, emitter: &'a Object) -> Result<Rgb, LoadError> {
        if emitter.plugin != "area" {
            return Err(unknown_plugin(emitter, &["area"]));
        }
        let radiance = self.light(emitter, "radiance")?;
        emitter.finish()?;
        Ok(radiance)
    }

    /// An emitter of its own.
    pub fn emitter(&mut self, emitter: &'a Object) -> Result<(), LoadError> {
        match emitter.plugin.as_str() {
            "point" => {
                let intensity = self.light(emitter, "intensity")?;
                self.point_lights.push((point_position(emitter)?, intensity));
            }
            "constant" => {
                let radiance = self.light(emitter, "radiance")?;
                self.surround(emitter, radiance)?;
            }
            "envmap" => self.envmap(emitter)?,
            _ => return Err(unknown_plugin(emitter, &["point", "constant", "envmap", "area"])),
        }
        emitter.finish()
    }

    fn surround(&mut self, emitter: &Object, radiance: Rgb) -> Result<(), LoadError> {
        if self.environment.replace(radiance).is_some() {
            let (expected, found) = ("one surrounding emitter at most".to_owned(), "a second".to_owned());
            return Err(emitter.place.error(LoadErrorKind::Malformed { expected, found }));
        }
        Ok(())
    }

    fn envmap(&mut self, emitter: &'a Object) -> Result<(), LoadError> {
        // A turned map has the same mean; a mirrored one too.
        emitter.transform("to_world")?;
        let scale = emitter.float_in("scale", 1.0, |s| s >= 0.0, "0 or more")?;
        let picture = self.picture(emitter, false)?;
        let negative = picture.texels.iter().filter(|t| t.iter().any(|v| *v < 0.0)).count();
        if negative > 0 {
            self.warnings.push(format!("envmap: {negative} texels below 0 count as 0"));
        }
        let rows = picture.texels.chunks(picture.width).map(|row| {
            let sum: Rgb = row.iter().map(|t| Rgb::from(*t).map(|v| v.max(0.0))).sum();
            sum / row.len() as f64
        });
        let mean: Rgb = rows.zip(row_weights(picture.height)).map(|(row, weight)| row * weight).sum();
        self.warnings.push("envmap is rendered as a uniform surrounding of its mean radiance".to_owned());
        self.surround(emitter, mean * scale)
    }

    /// Radiance or intensity; (1, 1, 1) unless given.
    fn light(&mut self, emitter: &'a Object, name: &'static str) -> Result<Rgb, LoadError> {
        let Some(property) = emitter.get(name) else { return Ok(Rgb::WHITE) };
        let value = match &property.value {
            Value::Rgb(value) => *value,
            Value::Uniform(value) => EQUAL_ENERGY * *value,
            _ => {
                let texture = self.texture_of(property).ok_or_else(|| property.must_be("an rgb, a spectrum or a texture"))?;
                self.warnings.push(format!("{}: textured {name} is rendered as the texture's mean", emitter.describe()));
                self.texture_object(texture)?.mean()
            }
        };
        if value.is_finite() && value.min() >= 0.0 {
            Ok(value)
        } else {
            Err(property.must_be("a colour with every channel 0 or more"))
        }
    }
}

fn point_position(emitter: &Object) -> Result<DVec3, LoadError> {
    let to_world = emitter.transform("to_world")?;
    let Some(position) = emitter.point("position")? else { return Ok(to_world.translation) };
    if emitter.get("to_world").is_some() {
        let (expected, found) = ("either position or to_world".to_owned(), "both".to_owned());
        return Err(position.place.error(LoadErrorKind::Malformed { expected, found }));
    }
    Ok(position.value)
}

/// Share of the sphere that each row of an environment map stands for; their sum is 1.
///
/// Row r lies at theta = pi r/(H - 1), so that the first and the last are the poles, and values between rows are linear:
/// the weight is half the integral of the hat function of that row times sin(theta).
fn row_weights(height: usize) -> Vec<f64> {
    if height == 1 {
        return vec![1.0];
    }
    let step = PI / (height - 1) as f64;
    (0..height)
        .map(|r| {
            if r == 0 || r == height - 1 {
                0.5 * (1.0 - step.sin() / step)
            } else {
                (step * r as f64).sin() * 2.0 * (0.5 * step).sin().powi(2) / step
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_weights_cover_the_sphere() {
        for height in [1, 2, 3, 64, 1024] {
            let sum: f64 = row_weights(height).iter().sum();
            assert!((sum - 1.0).abs() < 1e-12, "{height} rows: {sum}");
        }
    }

    #[test]
    fn equal_energy_light_has_unit_luminance() {
        assert!((EQUAL_ENERGY.luminance() - 1.0).abs() < 1e-4, "{}", EQUAL_ENERGY.luminance());
    }
}
