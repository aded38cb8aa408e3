//! Plots for papers: error against CPU time as SVG, and the same picture as PNG.

use super::curves::{self, Chart, Clock, Curve, METRICS, Metric};
use super::page::{html, methods};
use crate::experiment::{Outcome, SceneRecord};
use crate::film::io::{WriteError, WriteErrorKind, atomic_write};
use resvg::{tiny_skia, usvg};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;

/// Size of a plot [CSS pixels]: 3:2, the width of a column and a half of a paper at 100 pixels an inch.
const SIZE: [f64; 2] = [720.0, 480.0];

/// Left, top and bottom margins; the right one follows the names of the methods.
const MARGIN: [f64; 3] = [72.0, 40.0, 58.0];

/// Pixels of the PNG for one of the SVG.
const PNG_SCALE: f32 = 3.0;

/// Distance of the names of methods at the ends of curves.
const NAME_GAP: f64 = 16.0;

/// Colours after Okabe and Ito [OkabeIto08], darkened for white paper: readers with any colour vision tell them apart.
const COLOURS: [&str; 8] = ["#0072b2", "#d55e00", "#00855f", "#b4508f", "#b07800", "#3d99cc", "#4b4f58", "#8a6d1f"];

/// Dashes of the first eight methods, the next eight and so on.
const DASHES: [&str; 4] = ["none", "7 4", "2 3", "9 3 2 3"];

/// Metrics that papers show; the page has all.
const SHOWN: [(&str, &str); 4] = [
    ("relmse", "relMSE"),
    ("block9_rms", "RMS relative error of 9×9-pixel blocks"),
    ("flip_ldr", "mean FLIP (LDR)"),
    ("flip_hdr", "mean FLIP (HDR)"),
];

/// Writes all plots; returns their names without endings, relative to the folder, by scene.
///
/// # Errors
/// [`WriteError`] if a file cannot be written.
pub fn write_all(outcome: &Outcome, folder: &Path) -> Result<Vec<Vec<String>>, WriteError> {
    let names: Vec<String> = methods(outcome).into_iter().map(|(name, _)| name).collect();
    let fonts = fonts();
    let asked = Clock::ALL.into_iter().find(|clock| clock.key() == outcome.clock && clock.tells(&outcome.rows));
    let clock = asked.unwrap_or(Clock::Cpu);
    let mut all = Vec::new();
    for (i, scene) in outcome.scenes.iter().enumerate() {
        let mut of_scene = Vec::new();
        for (key, axis) in SHOWN {
            let metric = METRICS.iter().find(|m| m.key == key).expect("every shown metric is one of the metrics");
            let Some(chart) = curves::chart(&outcome.rows, &scene.name, &names, metric, clock) else { continue };
            let text = svg(scene, &chart, &names, metric, [clock.axis(), axis]);
            let name = format!("plots/{}-{key}", file_name(outcome, i));
            atomic_write(&folder.join(format!("{name}.svg")), |file| Ok(file.write_all(text.as_bytes())?))?;
            atomic_write(&folder.join(format!("{name}.png")), |file| {
                Ok(file.write_all(&png(&text, &fonts).map_err(WriteErrorKind::Encode)?)?)
            })?;
            of_scene.push(name);
        }
        all.push(of_scene);
    }
    Ok(all)
}

/// A scene's name as part of a file's name, unlike those of all other scenes.
fn file_name(outcome: &Outcome, index: usize) -> String {
    let plain =
        |name: &str| -> String { name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect() };
    let name = plain(&outcome.scenes[index].name);
    let is_taken = outcome.scenes.iter().enumerate().any(|(i, s)| i != index && plain(&s.name).eq_ignore_ascii_case(&name));
    if is_taken { format!("{name}-{}", index + 1) } else { name }
}

fn fonts() -> usvg::Options<'static> {
    let mut options = usvg::Options { font_family: "Ubuntu".to_owned(), ..usvg::Options::default() };
    let fonts = Arc::make_mut(&mut options.fontdb);
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    fonts.set_sans_serif_family("Ubuntu");
    options
}

fn png(svg: &str, options: &usvg::Options) -> Result<Vec<u8>, String> {
    let tree = usvg::Tree::from_str(svg, options).map_err(|e| e.to_string())?;
    let [width, height] = SIZE.map(|s| (s as f32 * PNG_SCALE) as u32);
    let mut pixels = tiny_skia::Pixmap::new(width, height).ok_or("no memory for the pixels")?;
    resvg::render(&tree, tiny_skia::Transform::from_scale(PNG_SCALE, PNG_SCALE), &mut pixels.as_mut());
    pixels.encode_png().map_err(|e| e.to_string())
}

/// A logarithmic axis: values at `low` and `high` lie at `start` and `end`.
struct Axis {
    low: f64,
    high: f64,
    start: f64,
    end: f64,
}

impl Axis {
    fn new([low, high]: [f64; 2], start: f64, end: f64) -> Self {
        let pad = 10_f64.powf((0.06 * (high / low).log10()).max(0.1));
        Self { low: low / pad, high: high * pad, start, end }
    }

    fn at(&self, value: f64) -> f64 {
        self.start + (value / self.low).ln() / (self.high / self.low).ln() * (self.end - self.start)
    }

    /// (digit, exponent) of 1 to 9 times all powers of ten in the range.
    fn ticks(&self) -> Vec<(u32, i32)> {
        let exponents = self.low.log10().floor() as i32..=self.high.log10().floor() as i32;
        let all = exponents.flat_map(|e| (1..10).map(move |d| (d, e)));
        all.filter(|&t| tick_value(t) >= self.low && tick_value(t) <= self.high).collect()
    }

    /// Digits whose ticks are named: more where there are few decades.
    fn named_digits(&self) -> &'static [u32] {
        match (self.high / self.low).log10() {
            decades if decades < 1.2 => &[1, 2, 3, 5, 7],
            decades if decades < 2.6 => &[1, 3],
            _ => &[1],
        }
    }
}

fn tick_value((digit, exponent): (u32, i32)) -> f64 {
    f64::from(digit) * 10_f64.powi(exponent)
}

/// A round number as SVG text: decimals where they are short, powers of ten elsewhere.
fn tick_text((digit, exponent): (u32, i32)) -> String {
    if (-3..=4).contains(&exponent) {
        let decimals = usize::try_from(-exponent).unwrap_or(0);
        return format!("{:.decimals$}", tick_value((digit, exponent)));
    }
    let factor = if digit == 1 { String::new() } else { format!("{digit}×") };
    format!("{factor}10<tspan dy=\"-5\" font-size=\"9\">{}</tspan>", exponent.to_string().replace('-', "−"))
}

fn svg(scene: &SceneRecord, chart: &Chart, names: &[String], metric: &Metric, axes: [&str; 2]) -> String {
    let points = || chart.curves.iter().flat_map(|c| &c.points);
    let errors = points().flat_map(|p| [p.error, p.errors[0], p.errors[1]]).filter(|e| *e > 0.0);
    let error_range = super::analysis::range(errors).unwrap_or([0.1, 1.0]);
    let time_range = super::analysis::range(points().map(|p| p.time)).unwrap_or([0.1, 1.0]);
    let longest = chart.curves.iter().map(|c| names[c.method].chars().count()).max().unwrap_or(0);
    let right = SIZE[0] - (26.0 + 7.2 * longest as f64).min(0.34 * SIZE[0]);
    let [left, top, bottom] = [MARGIN[0], MARGIN[1], SIZE[1] - MARGIN[2]];
    let x = Axis::new(time_range, left, right);
    let y = Axis::new(error_range, bottom, top);

    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" \
         font-family=\"Ubuntu, Helvetica, Arial, sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n",
        w = SIZE[0],
        h = SIZE[1]
    );
    text += &format!("<text x=\"{left}\" y=\"24\" font-size=\"16\" font-weight=\"bold\">{}</text>\n", html(&scene.name));
    text += &frame(&x, &y, axes);
    if metric.key == "relmse" {
        text += &noise_line(scene, &x, &y);
    }
    text += &chart.curves.iter().map(|c| curve(c, &x, &y)).collect::<String>();
    text += &end_names(chart, names, &x, &y);
    text + "</svg>\n"
}

fn frame(x: &Axis, y: &Axis, [x_name, y_name]: [&str; 2]) -> String {
    let (left, right, bottom, top) = (x.start, x.end, y.start, y.end);
    let mut text = String::new();
    let shade = |digit: u32| if digit == 1 { "#d9d9d9" } else { "#f0f0f0" };
    for tick in x.ticks() {
        let at = x.at(tick_value(tick));
        text += &format!("<path d=\"M{at:.2} {top}V{bottom}\" stroke=\"{}\"/>\n", shade(tick.0));
        if x.named_digits().contains(&tick.0) {
            text += &format!(
                "<text x=\"{at:.2}\" y=\"{}\" text-anchor=\"middle\" fill=\"#444\">{}</text>\n",
                bottom + 20.0,
                tick_text(tick)
            );
        }
    }
    for tick in y.ticks() {
        let at = y.at(tick_value(tick));
        text += &format!("<path d=\"M{left} {at:.2}H{right:.2}\" stroke=\"{}\"/>\n", shade(tick.0));
        if y.named_digits().contains(&tick.0) {
            let (tx, ty) = (left - 8.0, at + 4.5);
            text += &format!("<text x=\"{tx}\" y=\"{ty:.2}\" text-anchor=\"end\" fill=\"#444\">{}</text>\n", tick_text(tick));
        }
    }
    let (centre, middle) = (0.5 * (left + right), 0.5 * (top + bottom));
    text += &format!("<path d=\"M{left} {top}V{bottom}H{right:.2}\" fill=\"none\" stroke=\"#444\"/>\n");
    text += &format!("<text x=\"{centre:.2}\" y=\"{}\" text-anchor=\"middle\">{x_name}</text>\n", bottom + 44.0);
    text + &format!("<text transform=\"translate(18 {middle:.2}) rotate(-90)\" text-anchor=\"middle\">{y_name}</text>\n")
}

fn noise_line(scene: &SceneRecord, x: &Axis, y: &Axis) -> String {
    let Some(noise) = scene.reference_relmse.filter(|n| *n > y.low && *n < y.high) else { return String::new() };
    let at = y.at(noise);
    format!(
        "<path d=\"M{} {at:.2}H{:.2}\" stroke=\"#777\" stroke-dasharray=\"6 4\"/>\n\
         <text x=\"{}\" y=\"{:.2}\" font-size=\"11\" fill=\"#666\">the references' own relMSE</text>\n",
        x.start,
        x.end,
        x.start + 8.0,
        at - 6.0
    )
}

fn curve(curve: &Curve, x: &Axis, y: &Axis) -> String {
    let colour = COLOURS[curve.method % COLOURS.len()];
    let dash = DASHES[curve.method / COLOURS.len() % DASHES.len()];
    let clamped = |error: f64| if error > y.low { y.at(error) } else { y.start };
    let line = |points: &mut dyn Iterator<Item = (f64, f64)>| {
        points.enumerate().fold(String::new(), |mut d, (i, (px, py))| {
            write!(d, "{}{px:.2} {py:.2}", if i == 0 { 'M' } else { 'L' }).expect("a string takes all text");
            d
        })
    };
    let points: Vec<_> = curve.points.iter().filter(|p| p.error > 0.0).collect();
    let upper = points.iter().map(|p| (x.at(p.time), clamped(p.errors[1])));
    let lower = points.iter().rev().map(|p| (x.at(p.time), clamped(p.errors[0])));
    let band = line(&mut upper.chain(lower));
    let median = line(&mut points.iter().map(|p| (x.at(p.time), y.at(p.error))));
    let mut text = String::new();
    if points.iter().any(|p| p.errors[0] < p.errors[1]) {
        text += &format!("<path d=\"{band}Z\" fill=\"{colour}\" fill-opacity=\"0.16\"/>\n");
    }
    text += &format!(
        "<path d=\"{median}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" stroke-linejoin=\"round\" stroke-dasharray=\"{dash}\"/>\n"
    );
    for point in &curve.points {
        let at = x.at(point.time);
        // Below what the references can tell: a small triangle at the foot.
        text += &match point.error > 0.0 {
            true => marker(curve.method, at, y.at(point.error), 4.0, colour),
            false => format!("<path d=\"M{:.2} {:.2}h10l-5 8z\" fill=\"{colour}\"/>\n", at - 5.0, y.start - 10.0),
        };
    }
    text
}

fn marker(method: usize, x: f64, y: f64, size: f64, colour: &str) -> String {
    // Corners, turn in half turns, growth that makes areas look alike; the same markers as the page.
    let (corners, turn, growth) = match method % 8 {
        0 => return format!("<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{size}\" fill=\"{colour}\"/>\n"),
        1 => (4, 0.25, 1.2),
        2 => (3, 0.0, 1.25),
        3 => (4, 0.0, 1.2),
        4 => (3, 1.0, 1.25),
        5 => (5, 0.0, 1.1),
        6 => (10, 0.0, 1.2),
        _ => (6, 1.0 / 6.0, 1.1),
    };
    let corner = |i: usize| {
        let angle = std::f64::consts::PI * (turn + 2.0 * i as f64 / corners as f64);
        // The ten corners are those of a star.
        let radius = size * if corners == 10 && i % 2 == 1 { 0.5 } else { growth };
        format!("{:.2},{:.2} ", x + radius * angle.sin(), y - radius * angle.cos())
    };
    let points: String = (0..corners).map(corner).collect();
    format!("<polygon points=\"{}\" fill=\"{colour}\"/>\n", points.trim_end())
}

/// Names of methods beside the ends of their curves, moved apart where they would touch.
fn end_names(chart: &Chart, names: &[String], x: &Axis, y: &Axis) -> String {
    let end = |c: &Curve| {
        let last = c.points.last()?;
        let at = if last.error > 0.0 { y.at(last.error) } else { y.start - 6.0 };
        Some((c.method, x.at(last.time), at, at))
    };
    let mut ends: Vec<(usize, f64, f64, f64)> = chart.curves.iter().filter_map(end).collect();
    ends.sort_by(|a, b| a.3.total_cmp(&b.3));
    for i in 1..ends.len() {
        ends[i].3 = ends[i].3.max(ends[i - 1].3 + NAME_GAP);
    }
    let mut limit = y.start;
    for end in ends.iter_mut().rev() {
        end.3 = end.3.min(limit);
        limit = end.3 - NAME_GAP;
    }
    let name = |&(method, from_x, from_y, at): &(usize, f64, f64, f64)| {
        let colour = COLOURS[method % COLOURS.len()];
        format!(
            "<path d=\"M{:.2} {from_y:.2}L{:.2} {at:.2}h5\" fill=\"none\" stroke=\"{colour}\" stroke-opacity=\"0.45\"/>\n\
             <text x=\"{:.2}\" y=\"{:.2}\" fill=\"{colour}\" font-weight=\"bold\">{}</text>\n",
            from_x + 6.0,
            x.end + 4.0,
            x.end + 13.0,
            at + 4.5,
            html(&names[method])
        )
    };
    ends.iter().map(name).collect()
}
