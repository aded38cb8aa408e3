//! `twopass compare`: the errors of an image against one or two references.

use crate::cli::args::{Common, CompareArgs};
use crate::cli::exit::Failure;
use crate::cli::output::{number, print, say};
use serde_json::{Map, Value};
use std::path::Path;
use twopass::film::Mask;
use twopass::film::io::{probe_writable, read_exr, read_mask, write_png_bytes};
use twopass::metrics::{Comparison, Metrics, compare, false_colour, flip, flip_pair};

/// Runs the subcommand.
pub fn run(common: &Common, args: &CompareArgs) -> Result<(), Failure> {
    if let Some(path) = &common.report {
        return Err(Failure::Usage(format!("compare makes no run report (--report {}); its result is --json", path.display())));
    }
    for path in [&args.diff, &args.flip].into_iter().flatten() {
        probe_writable(path)?;
    }
    let image = read_exr(&args.image)?;
    let a = read_exr(&args.a)?;
    let b = args.b.as_deref().map(read_exr).transpose()?;
    let mask = |path: Option<&Path>| -> Result<Option<Mask>, Failure> { Ok(path.map(read_mask).transpose()?) };
    let (left_out, emitters) = (mask(args.mask.as_deref())?, mask(args.emitters.as_deref())?);
    let comparison = Comparison { image: &image, a: &a, b: b.as_ref(), left_out: left_out.as_ref(), emitters: emitters.as_ref() };
    let metrics = compare(&comparison)?;
    if let Some(path) = &args.diff {
        write_png_bytes(path, image.width(), image.height(), &false_colour::error_picture(&comparison)?)?;
        say(common, &format!("wrote {}", path.display()));
    }
    if let Some(path) = &args.flip {
        let (image, reference) = flip_pair(&comparison);
        write_png_bytes(path, image.width(), image.height(), &flip::magma_picture(&flip::hdr_map(&image, &reference)))?;
        say(common, &format!("wrote {}", path.display()));
    }
    print(&if args.json { json(&metrics) } else { lines(&metrics) })?;
    match metrics.first_not_finite {
        None => Ok(()),
        Some((x, y)) => Err(Failure::Check(format!(
            "{}: {} pixels are NaN or infinite, first at column {x}, row {y}",
            args.image.display(),
            metrics.n_not_finite
        ))),
    }
}

/// The figures that exist, by name, in the order of the command's description; then standard errors.
fn figures(m: &Metrics) -> Vec<(&'static str, f64)> {
    let [r, g, b] = m.mean_ratio;
    let errors = &m.standard_errors;
    let [r_error, g_error, b_error] = errors.mean_ratio;
    let all = [
        ("mse", Some(m.mse)),
        ("rmse", Some(m.rmse)),
        ("relmse", Some(m.relmse)),
        ("relmse_se", Some(m.relmse_se)),
        ("trimmed_relmse", m.trimmed_relmse),
        ("relmse_off_emitters", m.relmse_off_emitters),
        ("mean_ratio_r", Some(r)),
        ("mean_ratio_g", Some(g)),
        ("mean_ratio_b", Some(b)),
        ("block9_rms", Some(m.block9_rms)),
        ("flip_ldr", Some(m.flip_ldr)),
        ("flip_hdr", Some(m.flip_hdr)),
        ("trimmed_relmse_se", errors.trimmed_relmse),
        ("relmse_off_emitters_se", errors.relmse_off_emitters),
        ("mean_ratio_r_se", Some(r_error)),
        ("mean_ratio_g_se", Some(g_error)),
        ("mean_ratio_b_se", Some(b_error)),
        ("block9_rms_se", Some(errors.block9_rms)),
    ];
    all.into_iter().filter_map(|(name, value)| Some((name, value?))).collect()
}

fn lines(m: &Metrics) -> String {
    let mut text: String = figures(m).iter().map(|(name, value)| format!("{name} {}\n", number(*value))).collect();
    text += &format!("below_reference_noise {}\n", m.below_reference_noise);
    text += &format!("pixels {}\nnan_pixels {}\n", m.n_pixels, m.n_not_finite);
    text
}

/// One JSON object; what is not a number is null.
fn json(m: &Metrics) -> String {
    let mut object: Map<String, Value> =
        figures(m).into_iter().map(|(name, value)| (name.to_owned(), Value::from(value))).collect();
    object.insert("below_reference_noise".to_owned(), m.below_reference_noise.into());
    object.insert("pixels".to_owned(), m.n_pixels.into());
    object.insert("nan_pixels".to_owned(), m.n_not_finite.into());
    format!("{:#}\n", Value::Object(object))
}
