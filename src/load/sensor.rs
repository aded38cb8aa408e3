//! `<sensor>`, `<film>`, `<sampler>` and `<integrator>`: the camera and what the file asks for.

use super::error::{LoadError, LoadErrorKind};
use super::mitsuba::{Loader, unknown_plugin};
use super::object::{Class, Object};
use crate::math::{DAffine3, DVec2};
use crate::scene::camera::FovAxis;
use crate::scene::{Camera, FilmSettings};

/// Largest width and height: what 16-bit image formats hold.
const MAX_SIDE: i64 = 65_535;

/// Relative difference below which the scales of a camera's axes count as equal: exporters print six digits.
const SAME_SCALE: f64 = 1e-4;

/// Largest offset of the principal point, in films: beyond it nothing is seen.
const MAX_OFFSET: f64 = 1e3;

impl<'a> Loader<'a> {
    /// Camera, and film settings with unlimited depth.
    pub fn sensor(&mut self, sensor: &'a Object) -> Result<(Camera, FilmSettings), LoadError> {
        let principal_point = match sensor.plugin.as_str() {
            "perspective" => {
                let offset = |name| sensor.float_in(name, 0.0, |v| v.abs() <= MAX_OFFSET, "from -1000 to 1000");
                DVec2::new(offset("principal_point_offset_x")?, offset("principal_point_offset_y")?)
            }
            "thinlens" => {
                self.lens(sensor)?;
                DVec2::ZERO
            }
            _ => return Err(unknown_plugin(sensor, &["perspective", "thinlens"])),
        };
        // Neither changes a still picture of a pinhole camera.
        sensor.ignore(&["shutter_open", "shutter_close", "focus_distance"]);
        let (fov, fov_axis) = field_of_view(sensor)?;
        let near_clip = sensor.float_in("near_clip", 1e-2, |v| v > 0.0, "above 0")?;
        let far_clip = sensor.float_in("far_clip", 1e4, |v| v > near_clip, "above near_clip")?;
        let to_scene = self.camera_frame(sensor)?;
        let (width, height) = match sensor.child(self.ids, Class::FILM)? {
            Some(film) => self.film(film)?,
            None => (768, 576),
        };
        let sample_count = match sensor.child(self.ids, Class::SAMPLER)? {
            Some(sampler) => sample_count(sampler)?,
            None => 4,
        };
        sensor.finish()?;
        let camera = Camera { to_scene, tan_half_fov: (0.5 * fov).tan(), fov_axis, principal_point, near_clip, far_clip };
        Ok((camera, FilmSettings { width, height, sample_count, max_depth: None }))
    }

    /// The lens of a camera, which is rendered as a pinhole.
    fn lens(&mut self, sensor: &Object) -> Result<(), LoadError> {
        let radius = sensor.float("aperture_radius")?.ok_or_else(|| sensor.lacks("the number \"aperture_radius\""))?;
        if radius.value < 0.0 {
            return Err(radius.must_be("aperture_radius", "0 or more"));
        }
        sensor.float_in("focus_distance", 1.0, |v| v > 0.0, "above 0")?;
        if radius.value > 0.0 {
            self.warnings.push("sensor \"thinlens\" is rendered as a pinhole: depth of field is not rendered".to_owned());
        }
        Ok(())
    }

    /// The camera's frame without scale. A mirroring frame is kept: the picture is mirrored, as in Mitsuba.
    fn camera_frame(&mut self, sensor: &Object) -> Result<DAffine3, LoadError> {
        let mut m = sensor.transform("to_world")?;
        let c = &mut m.matrix3;
        let lengths = [c.x_axis.length(), c.y_axis.length(), c.z_axis.length()];
        let mean = lengths.iter().sum::<f64>() / 3.0;
        let (x, y, z) = (c.x_axis / lengths[0], c.y_axis / lengths[1], c.z_axis / lengths[2]);
        let skew = x.dot(y).abs().max(y.dot(z).abs()).max(z.dot(x).abs());
        if skew > SAME_SCALE || lengths.iter().any(|l| (l / mean - 1.0).abs() > SAME_SCALE) {
            let expected = "a rotation and a translation".to_owned();
            let found = format!("axes of lengths {:.4}, {:.4}, {:.4} and skew {skew:.4}", lengths[0], lengths[1], lengths[2]);
            return Err(sensor.place.error(LoadErrorKind::Value { name: "to_world".to_owned(), expected, found }));
        }
        if (mean - 1.0).abs() > SAME_SCALE {
            self.warnings.push(format!("the sensor's to_world scales by {mean:.4}; the scale is left out"));
        }
        *c *= 1.0 / mean;
        Ok(m)
    }

    fn film(&mut self, film: &'a Object) -> Result<(usize, usize), LoadError> {
        if film.plugin != "hdrfilm" {
            return Err(unknown_plugin(film, &["hdrfilm"]));
        }
        // These decide how Mitsuba stores the picture, not what is in it.
        film.ignore(&["pixel_format", "component_format", "file_format", "high_quality_edges", "sample_border", "compensate"]);
        film.ignore(&["banner"]);
        let (width, height) = (side(film, "width", 768)?, side(film, "height", 576)?);
        let (limit, found) = (self.files.limits.film_pixels, width as u64 * height as u64);
        if found > limit {
            let what = format!("pixels of the film ({width} x {height})");
            return Err(film.place.error(LoadErrorKind::OverLimit { what, limit, found }));
        }
        self.crop = crop(film, width, height)?;
        let filter = film.child(self.ids, Class::RFILTER)?;
        self.filter(filter)?;
        film.finish()?;
        Ok((width, height))
    }

    fn filter(&mut self, filter: Option<&Object>) -> Result<(), LoadError> {
        let name = filter.map_or("gaussian", |f| f.plugin.as_str());
        if let Some(filter) = filter {
            filter.ignore(match name {
                "gaussian" => &["stddev"],
                "tent" => &["radius"],
                "mitchell" => &["A", "B", "C"],
                "lanczos" => &["lobes"],
                "box" | "catmullrom" => &[],
                _ => return Err(unknown_plugin(filter, &["box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"])),
            });
            filter.finish()?;
        }
        if name != "box" {
            self.warnings.push(format!("reconstruction filter \"{name}\" is replaced by a box of one pixel"));
        }
        Ok(())
    }

    /// Longest path in edges, or `None`.
    pub fn max_depth(&mut self, integrator: &Object) -> Result<Option<u32>, LoadError> {
        let exact = ["path"];
        let near = ["volpath", "volpathmis", "bdpt", "prbvolpath", "prb"];
        let name = integrator.plugin.as_str();
        if !exact.contains(&name) && !near.contains(&name) {
            return Err(unknown_plugin(integrator, &["path", "volpath", "volpathmis"]));
        }
        if near.contains(&name) {
            self.warnings.push(format!("integrator \"{name}\" is read as \"path\": participating media play no part"));
        }
        // Russian roulette leaves the expected picture alone; where emitters are hidden does not.
        if let Some(depth) = integrator.integer("rr_depth")?
            && depth.value < 1
        {
            return Err(depth.must_be("rr_depth", "1 or more"));
        }
        if integrator.boolean("hide_emitters", false)? {
            self.warnings.push("integrator: hide_emitters plays no part; emitters are seen".to_owned());
        }
        let depth = match integrator.integer("max_depth")? {
            None => None,
            Some(depth) if depth.value == -1 => None,
            Some(depth) => {
                let value = u32::try_from(depth.value);
                Some(value.map_err(|_| depth.must_be("max_depth", "-1 (unlimited), or 0 or more"))?)
            }
        };
        integrator.finish()?;
        Ok(depth)
    }
}

fn field_of_view(sensor: &Object) -> Result<(f64, FovAxis), LoadError> {
    let fov = sensor.float_in("fov", f64::NAN, |v| v > 0.0 && v < 180.0, "an angle between 0 and 180 degrees")?;
    let focal_length = sensor.text("focal_length")?;
    if !fov.is_nan() {
        if let Some(length) = focal_length {
            return Err(length.must_be("focal_length", "left out beside fov"));
        }
        let axes = [
            ("x", FovAxis::X),
            ("y", FovAxis::Y),
            ("diagonal", FovAxis::Diagonal),
            ("smaller", FovAxis::Smaller),
            ("larger", FovAxis::Larger),
        ];
        return Ok((fov.to_radians(), sensor.choice("fov_axis", &axes)?));
    }
    // A 35 mm film, 36 x 24 mm, seen along its diagonal.
    let length = match focal_length {
        None => 50.0,
        Some(text) => {
            let number = text.value.trim().trim_end_matches("mm").trim().parse().ok();
            number
                .filter(|f: &f64| f.is_finite() && *f > 0.0)
                .ok_or_else(|| text.must_be("focal_length", "a length such as 50mm"))?
        }
    };
    Ok((2.0 * (36.0_f64.hypot(24.0) / (2.0 * length)).atan(), FovAxis::Diagonal))
}

/// Left, top, width and height of the part of the film that is wanted; `None` for all of it.
fn crop(film: &Object, width: usize, height: usize) -> Result<Option<[usize; 4]>, LoadError> {
    let within = |name: &'static str, default: usize, low: usize, high: usize| match film.integer(name)? {
        None => Ok(default),
        Some(given) => {
            let value = usize::try_from(given.value).ok().filter(|v| (low..=high).contains(v));
            value.ok_or_else(|| given.must_be(name, &format!("from {low} to {high}, inside the film")))
        }
    };
    let x = within("crop_offset_x", 0, 0, width - 1)?;
    let y = within("crop_offset_y", 0, 0, height - 1)?;
    // Mitsuba's crop has the film's size unless told otherwise, and must fit.
    let w = within("crop_width", width, 1, width - x)?;
    let h = within("crop_height", height, 1, height - y)?;
    if x + w > width || y + h > height {
        let (expected, found) = ("a crop inside the film".to_owned(), format!("{w} x {h} pixels from ({x}, {y})"));
        return Err(film.place.error(LoadErrorKind::Malformed { expected, found }));
    }
    Ok(([x, y, w, h] != [0, 0, width, height]).then_some([x, y, w, h]))
}

fn side(film: &Object, name: &'static str, default: usize) -> Result<usize, LoadError> {
    let Some(side) = film.integer(name)? else { return Ok(default) };
    if side.value > MAX_SIDE {
        let (limit, found) = (MAX_SIDE as u64, side.value as u64);
        return Err(side.place.error(LoadErrorKind::OverLimit { what: format!("{name} of the film"), limit, found }));
    }
    usize::try_from(side.value).ok().filter(|v| *v > 0).ok_or_else(|| side.must_be(name, "1 or more"))
}

fn sample_count(sampler: &Object) -> Result<u32, LoadError> {
    let known = ["independent", "stratified", "multijitter", "orthogonal", "ldsampler"];
    if !known.contains(&sampler.plugin.as_str()) {
        return Err(unknown_plugin(sampler, &known));
    }
    // Samples are always low-discrepancy here, and the seed is the program's.
    sampler.ignore(&["seed", "jitter", "strength"]);
    let count = match sampler.integer("sample_count")? {
        None => 4,
        Some(count) => {
            let value = u32::try_from(count.value).ok().filter(|v| *v > 0);
            value.ok_or_else(|| count.must_be("sample_count", "from 1 to 4294967295"))?
        }
    };
    sampler.finish()?;
    Ok(count)
}
