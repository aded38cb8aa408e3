//! What a mirror tube carries through, against [SwiftSmith95]: chains of two dozen mirrors and more, and the roulette that ends them.

use super::support::run;
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;
use twopass::integrator::Method;
use twopass::integrator::drive::Budget;
use twopass::load::{LoadOptions, load_scene};
use twopass::math::DVec3;
use twopass::pipeline::probe::Prober;
use twopass::pipeline::{RenderSettings, solve};
use twopass::progress::silent;
use twopass::scene::Scene;

/// Part of the transmission by which it may be off.
const TOLERANCE: f64 = 5e-3;

struct Tube {
    rho: f64,
    length: f64,
    /// Degrees off the axis; `None`: light from all directions alike.
    angle: Option<f64>,
    transmission: f64,
}

fn tubes() -> Vec<Tube> {
    let table = std::fs::read_to_string("tests/data/light_pipes.csv").expect("the table is there");
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |i: usize| cells[i].parse::<f64>().expect("a number");
        Tube { rho: number(1), length: number(2), angle: (cells[0] == "parallel").then(|| number(3)), transmission: number(4) }
    };
    table.lines().skip(1).map(row).collect()
}

/// The closed form for rays at `angle` (radians) to the axis, by the substitution s = sin x, which takes the root away, and midpoints.
fn swift_smith(rho: f64, length: f64, angle: f64) -> f64 {
    const STEPS: u32 = 200_000;
    let p = length * angle.tan();
    let at = |k: u32| {
        let s = ((f64::from(k) + 0.5) / f64::from(STEPS) * FRAC_PI_2).sin();
        let whole = (p / s).floor();
        s * s * rho.powf(whole) * (1.0 - (1.0 - rho) * (p / s - whole))
    };
    (0..STEPS).map(at).sum::<f64>() / f64::from(STEPS) * FRAC_PI_2 * 4.0 / PI
}

/// The table is that of the formula, to the digits it has.
#[test]
fn the_table_is_the_formulas() {
    for tube in tubes() {
        let got = match tube.angle {
            Some(angle) => swift_smith(tube.rho, tube.length, angle.to_radians()),
            None => {
                // Mean over directions weighted by the cosine: 2 sin cos dx.
                let n = 400;
                let at = |k: u32| {
                    let x = (f64::from(k) + 0.5) / f64::from(n) * FRAC_PI_2;
                    2.0 * x.sin() * x.cos() * swift_smith(tube.rho, tube.length, x) * FRAC_PI_2 / f64::from(n)
                };
                if tube.length > 5.0 {
                    continue;
                }
                (0..n).map(at).sum()
            }
        };
        let bound = if tube.angle.is_some() { 1e-6 } else { 2e-4 };
        assert!(
            (got / tube.transmission - 1.0).abs() < bound,
            "rho {}, length {}: {got}, {}",
            tube.rho,
            tube.length,
            tube.transmission
        );
    }
}

fn scene(tube: &Tube) -> Scene {
    let mut defines = vec![("rho".to_owned(), tube.rho.to_string()), ("length".to_owned(), tube.length.to_string())];
    defines.extend(tube.angle.map(|angle| ("angle".to_owned(), angle.to_string())));
    let options = LoadOptions { defines, ..LoadOptions::default() };
    load_scene(Path::new("scenes/specular-guide/scene.xml"), &options).expect("the scene is there").scene
}

/// Samples for a standard error of a fifth of the tolerance: a chain goes on by chance from where half of its light is lost, so the relative
/// variance of one is (1/T - 1)/2 at most.
fn samples(tube: &Tube) -> f64 {
    0.5 * (1.0 / tube.transmission - 1.0) / (0.2 * TOLERANCE).powi(2)
}

fn transmission(tube: &Tube) -> f64 {
    let Some(angle) = tube.angle else { return diffuse_transmission(tube) };
    let spp = (samples(tube) / (64.0 * 64.0)).clamp(16.0, 512.0) as u32;
    let settings = RenderSettings {
        method: Method::Path,
        budget: Budget { spp: Some(spp), ..Budget::default() },
        ..RenderSettings::default()
    };
    let image = run(scene(tube), &settings).film.image();
    let mean = image.pixels().iter().map(|p| f64::from(p[1])).sum::<f64>() / image.pixels().len() as f64;
    mean / (PI * angle.to_radians().cos() / 4.0)
}

/// Irradiance at the entry, facing in, over pi: averaged over the disk.
fn diffuse_transmission(tube: &Tube) -> f64 {
    const RINGS: u32 = 64;
    let samples = (samples(tube) / f64::from(RINGS)).clamp(1024.0, 8192.0) as u64;
    let settings = RenderSettings::default();
    let solved = solve(scene(tube), &settings, &mut silent).expect("solves");
    let integrator = settings.integrator(None).expect("valid");
    let prober = Prober { world: &solved.world, pass_one: &solved.pass_one, settings: integrator, samples };
    // Rings of equal area, each with a point at another angle.
    let place = |k: u32| {
        let (r, phi) = (0.5 * ((f64::from(k) + 0.5) / f64::from(RINGS)).sqrt(), f64::from(k) * 2.399_963);
        (DVec3::new(r * phi.cos(), r * phi.sin(), 0.0), DVec3::Z)
    };
    let points: Vec<_> = (0..RINGS).map(place).collect();
    let found = prober.irradiance(&points).0;
    found.iter().map(|p| p.total.g).sum::<f64>() / f64::from(RINGS) / PI
}

/// All rows with the environment variable TWOPASS_ALL_ROWS (some two CPU minutes); without it those of which few samples tell enough, one of
/// diffuse light among them.
#[test]
fn a_mirror_tube_carries_what_the_formula_says() {
    let all = std::env::var_os("TWOPASS_ALL_ROWS").is_some();
    for tube in tubes().into_iter().filter(|t| all || t.transmission > if t.angle.is_some() { 0.6 } else { 0.95 }) {
        let got = transmission(&tube);
        let name = format!("rho {}, length {}, angle {:?}", tube.rho, tube.length, tube.angle);
        println!("{name}: {got:.6}, expected {:.6}, {:+.3} %", tube.transmission, 100.0 * (got / tube.transmission - 1.0));
        assert!((got / tube.transmission - 1.0).abs() <= TOLERANCE, "{name}: {got}, expected {}", tube.transmission);
    }
}
