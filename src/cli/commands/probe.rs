//! `twopass probe`: irradiance or radiance at given points, as a table.

use super::render_settings;
use crate::cli::args::{Common, ProbeArgs};
use crate::cli::exit::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::print;
use crate::cli::progress::{Display, observer};
use crate::cli::{report, scene_file};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use twopass::film::io::{atomic_write, probe_writable};
use twopass::integrator::IntegratorSettings;
use twopass::math::DVec3;
use twopass::pipeline::probe::{Probed, Prober};
use twopass::pipeline::{self, Solved};
use twopass::progress::Stage;
use twopass::run_report::{StopReason, Stopwatch};

const HEADER_IN: &str = "x,y,z,nx,ny,nz";
const HEADER_OUT: &str = "x,y,z,nx,ny,nz,direct_r,direct_g,direct_b,total_r,total_g,total_b,illuminance,std_error";

/// Most points of a table.
const MOST_POINTS: usize = 10_000_000;

/// Runs the subcommand.
pub fn run(common: &Common, args: &ProbeArgs) -> Result<(), Failure> {
    let interrupt = Interrupt::listen();
    for path in [args.output.as_deref(), common.report.as_deref()].into_iter().flatten() {
        probe_writable(path)?;
    }
    let points = read_points(&args.points)?;
    let watch = Stopwatch::start();
    let loaded = scene_file::load(common, &args.scene, &args.source)?;
    let settings = render_settings(common, &args.pass_one, Some(&args.pass_two));
    let max_depth = settings.max_depth.unwrap_or(loaded.scene.film.max_depth);
    let mut run_report = report::begin(common, &loaded, "probe", watch.elapsed());
    report::set_pass_one(&mut run_report, &args.pass_one);
    report::set(&mut run_report, "samples", args.samples);
    report::set(&mut run_report, "radiance", args.radiance);

    let mut observer = observer(Display::new(common), &interrupt);
    let solved = pipeline::solve(loaded.scene, &settings, &mut observer);
    let solved = solved.map_err(|error| report::no_result(common, &mut run_report, &interrupt, error))?;
    drop(observer);
    report::add_costs(&mut run_report, &solved.stages, &solved.counts);
    report::add_pass_one(common, &mut run_report, &solved.pass_one);
    let pass_two = settings.integrator(max_depth)?;
    let (probed, counts) = run_report.time(Stage::Render, || probe_points(args, &solved, &pass_two, &points));
    report::add_costs(&mut run_report, &[], &counts);
    let table = table(&points, &probed, args.efficacy);
    match &args.output {
        Some(path) => atomic_write(path, |file| Ok(file.write_all(table.as_bytes())?))?,
        None => print(&table)?,
    }
    run_report.not_finite.count = probed.iter().filter(|p| !p.total.is_finite()).count() as u64;
    run_report.samples_per_pixel = args.samples as f64;
    run_report.complete = true;
    run_report.stopped_by = StopReason::Samples;
    report::finish(common, &mut run_report)?;
    report::verdict(&run_report, &interrupt, "")
}

fn probe_points(
    args: &ProbeArgs,
    solved: &Solved,
    settings: &IntegratorSettings,
    points: &[(DVec3, DVec3)],
) -> (Vec<Probed>, twopass::world::walk::RayCounts) {
    let prober = Prober { world: &solved.world, pass_one: &solved.pass_one, settings: *settings, samples: args.samples };
    if args.radiance { prober.radiance(points) } else { prober.irradiance(points) }
}

fn read_points(path: &Path) -> Result<Vec<(DVec3, DVec3)>, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::Input { path: path.to_owned(), error })?;
    parse_points(&text).map_err(|(line, detail)| Failure::Table { path: path.to_owned(), line, detail })
}

/// Points and directions of a table, or the line at fault.
fn parse_points(text: &str) -> Result<Vec<(DVec3, DVec3)>, (usize, String)> {
    let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    match lines.next() {
        Some((_, header)) if header.split(',').map(str::trim).eq(HEADER_IN.split(',')) => {}
        Some((_, header)) => return Err((1, format!("expected the header {HEADER_IN}, found \"{}\"", shortened(header)))),
        None => return Err((1, format!("expected the header {HEADER_IN}, found an empty file"))),
    }
    let points: Vec<_> = lines
        .filter(|(_, line)| !line.is_empty())
        .map(|(n, line)| parse_row(line).map_err(|e| (n, e)))
        .collect::<Result<_, _>>()?;
    if points.len() > MOST_POINTS {
        return Err((MOST_POINTS, format!("more than {MOST_POINTS} points")));
    }
    Ok(points)
}

fn parse_row(line: &str) -> Result<(DVec3, DVec3), String> {
    let numbers: Result<Vec<f64>, String> = line.split(',').map(parse_number).collect();
    match numbers?.as_slice() {
        &[x, y, z, nx, ny, nz] => {
            let n = DVec3::new(nx, ny, nz);
            // Exactly so: any other length is a direction.
            let has_length = n.length_squared() > 0.0 && n.length_squared().is_finite();
            has_length.then_some((DVec3::new(x, y, z), n)).ok_or_else(|| "nx,ny,nz is no direction".to_owned())
        }
        other => Err(format!("expected 6 numbers, found {}", other.len())),
    }
}

fn parse_number(field: &str) -> Result<f64, String> {
    let value = field.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    value.ok_or_else(|| format!("expected a finite number, found \"{}\"", shortened(field)))
}

fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}

fn table(points: &[(DVec3, DVec3)], probed: &[Probed], efficacy: f64) -> String {
    let mut text = format!("{HEADER_OUT}\n");
    for ((p, n), found) in points.iter().zip(probed) {
        let (d, t) = (found.direct, found.total);
        let illuminance = efficacy * t.luminance();
        let row = [p.x, p.y, p.z, n.x, n.y, n.z, d.r, d.g, d.b, t.r, t.g, t.b, illuminance, found.std_error];
        let row = row.map(|v| v.to_string()).join(",");
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{row}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use twopass::math::Rgb;

    #[test]
    fn a_table_of_points_is_read() {
        let points = parse_points("x, y,z,nx,ny,nz\r\n1,2,3,0,0,1\n\n-1e-3,0,5,0,2,0\n").unwrap();
        assert_eq!(points, [(DVec3::new(1.0, 2.0, 3.0), DVec3::Z), (DVec3::new(-1e-3, 0.0, 5.0), 2.0 * DVec3::Y)]);
    }

    #[test]
    fn a_bad_row_is_named_by_its_line() {
        let line = |text: &str| parse_points(text).unwrap_err().0;
        assert_eq!(line(""), 1);
        assert_eq!(line("x,y,z\n1,2,3\n"), 1);
        for bad in ["1,2,3", "1,2,3,0,0,1,5", "1,2,3,0,0,0", "1,2,nan,0,0,1", "1,2,3,0,0,1e400", "1,2,a,0,0,1"] {
            assert_eq!(line(&format!("x,y,z,nx,ny,nz\n0,0,0,0,0,1\n{bad}\n")), 3, "{bad}");
        }
    }

    #[test]
    fn illuminance_is_luminance_times_efficacy() {
        let found = Probed { direct: Rgb::BLACK, total: Rgb::new(1.0, 2.0, 3.0), std_error: 0.5 };
        let text = table(&[(DVec3::X, DVec3::Z)], &[found], 179.0);
        let row = text.lines().nth(1).unwrap();
        let illuminance: f64 = row.split(',').nth(12).unwrap().parse().unwrap();
        // 0.2126 + 2 * 0.7152 + 3 * 0.0722 = 1.8596.
        assert!((illuminance - 179.0 * 1.8596).abs() < 1e-9, "{illuminance}");
        assert!(row.starts_with("1,0,0,0,0,1,0,0,0,1,2,3,"), "{row}");
    }
}
