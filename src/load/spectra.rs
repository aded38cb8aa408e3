//! `<spectrum>` elements by wavelengths or by a model, to linear sRGB.

use super::error::LoadError;
use super::mitsuba::{Loader, unknown_plugin};
use super::object::{At, Class, Object, Property, Value};
use super::{spectrum, transform};
use crate::math::Rgb;

/// Planck's radiation law: 2 h c² [W m²] and h c / k [m K] (CODATA 2018, exact).
const FIRST_RADIATION: f64 = 1.191_042_972_397_188e-16;
const SECOND_RADIATION: f64 = 1.438_776_877_503_933e-2;

impl<'a> Loader<'a> {
    /// The spectrum of a property by wavelength [nm], if it is one.
    pub fn spectrum_of(&self, property: &'a Property) -> Result<Option<Vec<(f64, f64)>>, LoadError> {
        let object = match &property.value {
            Value::Spectrum(samples) => return Ok(Some(samples.clone())),
            Value::Object(object) => object,
            Value::Reference(id) => match self.ids.get(id.as_str()) {
                Some(object) => *object,
                None => return Ok(None),
            },
            _ => return Ok(None),
        };
        if object.class != Class::SPECTRUM {
            return Ok(None);
        }
        let samples = match object.plugin.as_str() {
            "uniform" => {
                let value = object.float_in("value", 1.0, f64::is_finite, "a finite number")?;
                vec![(spectrum::SHORTEST, value), (spectrum::LONGEST, value)]
            }
            "regular" => regular(object)?,
            "irregular" => irregular(object)?,
            "blackbody" => blackbody(object)?,
            _ => return Err(unknown_plugin(object, &["blackbody", "irregular", "regular", "uniform"])),
        };
        object.finish()?;
        Ok(Some(samples))
    }

    /// A reflectance by wavelength, seen under light of the same power at all of them.
    pub fn spectral_reflectance(&mut self, samples: &[(f64, f64)]) -> Rgb {
        self.note("a spectrum by its colour under equal-energy light".to_owned());
        let (colour, _) = spectrum::light(samples);
        let white = spectrum::EQUAL_ENERGY;
        Rgb::new(colour.r / white.r, colour.g / white.g, colour.b / white.b).map(|v| v.min(1.0))
    }
}

fn list(text: &At<&str>, name: &str) -> Result<Vec<f64>, LoadError> {
    let numbers = transform::numbers(text.value).filter(|n| n.len() > 1);
    numbers.ok_or_else(|| text.must_be(name, "two or more finite numbers"))
}

/// Values at even steps from the first wavelength to the last.
fn regular(object: &Object) -> Result<Vec<(f64, f64)>, LoadError> {
    let text = object.needed_text("values")?;
    let values = list(&text, "values")?;
    let low = object.float_in("wavelength_min", spectrum::SHORTEST, |w| w > 0.0, "above 0")?;
    let high = object.float_in("wavelength_max", spectrum::LONGEST, |w| w > low, "above wavelength_min")?;
    let step = (high - low) / (values.len() - 1) as f64;
    Ok(values.into_iter().enumerate().map(|(i, value)| (low + step * i as f64, value)).collect())
}

fn irregular(object: &Object) -> Result<Vec<(f64, f64)>, LoadError> {
    let (at, text) = (object.needed_text("wavelengths")?, object.needed_text("values")?);
    let (wavelengths, values) = (list(&at, "wavelengths")?, list(&text, "values")?);
    if !wavelengths.is_sorted_by(|a, b| a < b) {
        return Err(at.must_be("wavelengths", "growing"));
    }
    if values.len() != wavelengths.len() {
        return Err(text.must_be("values", &format!("{} numbers, one a wavelength", wavelengths.len())));
    }
    Ok(wavelengths.into_iter().zip(values).collect())
}

/// Radiance of a black body [W m⁻² sr⁻¹ nm⁻¹], as Mitsuba scales it.
fn blackbody(object: &Object) -> Result<Vec<(f64, f64)>, LoadError> {
    let temperature = object.float_in("temperature", f64::NAN, |t| t > 0.0 && t.is_finite(), "a temperature above 0 K")?;
    if temperature.is_nan() {
        return Err(object.lacks("the number \"temperature\""));
    }
    let scale = object.float_in("scale", 1.0, |s| s >= 0.0 && s.is_finite(), "0 or more")?;
    let radiance = |nm: f64| {
        let m = nm * 1e-9;
        FIRST_RADIATION / (m.powi(5) * (SECOND_RADIATION / (m * temperature)).exp_m1()) * 1e-9
    };
    let steps = (0..=94).map(|i| spectrum::SHORTEST + 5.0 * f64::from(i));
    Ok(steps.map(|nm| (nm, scale * radiance(nm))).collect())
}
