//! `twopass form-factors`: view factors on their own, as a table.

use crate::cli::args::{Common, FormFactorsArgs, GroupingName};
use crate::cli::exit::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{print, say};
use crate::cli::progress::{Display, observer};
use crate::cli::{report, scene_file};
use std::io::Write as _;
use twopass::film::io::{atomic_write, probe_writable};
use twopass::patch::{PatchMesh, PatchSettings};
use twopass::pipeline::form_factor_table::{Grouping, Table, table};
use twopass::pipeline::{PassOneSettings, PipelineError};
use twopass::progress::Stage;
use twopass::run_report::{StopReason, Stopwatch};
use twopass::scene::SurfaceSource;
use twopass::world::World;

const HEADER: [&str; 6] = ["from", "to", "area_from", "area_to", "form_factor", "std_error"];

/// Runs the subcommand.
pub fn run(common: &Common, args: &FormFactorsArgs) -> Result<(), Failure> {
    let interrupt = Interrupt::listen();
    for path in [args.output.as_deref(), common.report.as_deref()].into_iter().flatten() {
        probe_writable(path)?;
    }
    let watch = Stopwatch::start();
    let mut exact: Vec<SurfaceSource> = Vec::new();
    let loaded = scene_file::load_seen(common, &args.scene, &args.source, |source| {
        exact = source.shapes.iter().map(|s| s.surface.clone()).collect();
    })?;
    let mut run_report = report::begin(common, &loaded, "form-factors", watch.elapsed());
    let tolerance = args.tolerance.unwrap_or(args.form_factors.default_tolerance());
    report::set(&mut run_report, "form_factors", args.form_factors.name());
    report::set(&mut run_report, "tolerance", tolerance);
    report::set(&mut run_report, "patch_size", args.patch_size);
    let pass_one =
        PassOneSettings { form_factors: args.form_factors, form_factor_tolerance: tolerance, ..PassOneSettings::default() };
    let settings = pass_one.form_factor_settings(common.seed);
    let grouping = match args.by {
        GroupingName::Shape => Grouping::Shapes,
        GroupingName::Patch => Grouping::Patches,
    };
    let world = run_report.time(Stage::Tree, || World::new(loaded.scene, common.accel)).map_err(PipelineError::Accel)?;
    let sizes = PatchSettings { patch_size: args.patch_size, ..PatchSettings::default() };
    let patches = run_report.time(Stage::Patches, || PatchMesh::build(&world, &sizes)).map_err(PipelineError::Patch)?;
    let mut observer = observer(Display::new(common), &interrupt);
    let found = run_report
        .time(Stage::FormFactors, || table(&world, &exact, &patches, grouping, &settings, &mut observer))
        .ok_or(PipelineError::Stopped)
        .map_err(|error| report::no_result(common, &mut run_report, &interrupt, error))?;
    drop(observer);
    let text = csv_of(&found);
    run_report.time(Stage::Write, || match &args.output {
        Some(path) => Ok(atomic_write(path, |file| Ok(file.write_all(&text)?))?),
        None => print(&String::from_utf8_lossy(&text)),
    })?;
    run_report.count("patches", patches.len() as u64);
    run_report.count("form_factors", found.entries.len() as u64);
    run_report.complete = true;
    run_report.stopped_by = StopReason::Finished;
    report::finish(common, &mut run_report)?;
    let (row_sum, closed) = found.row_sum_defect;
    say(
        common,
        &format!(
            "worst row-sum defect {row_sum:.3e} ({closed} of {} rows closed), worst reciprocity defect {:.3e}, before any correction",
            found.sides.len(),
            found.reciprocity_defect
        ),
    );
    Ok(())
}

/// The table with its header; numbers in as many digits as tell them from all others.
fn csv_of(table: &Table) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write = |fields: &[&str]| writer.write_record(fields).expect("memory can be written, and all rows have six fields");
    write(&HEADER);
    for (i, j, factor, error) in table.rows() {
        let (from, to) = (&table.sides[i], &table.sides[j]);
        let numbers = [from.area, to.area, factor, error].map(number);
        write(&[&from.name, &to.name, &numbers[0], &numbers[1], &numbers[2], &numbers[3]]);
    }
    writer.into_inner().expect("memory can be written")
}

/// The shortest number that reads back as the same; with an exponent where it is small.
fn number(v: f64) -> String {
    if v != 0.0 && v.abs() < 1e-4 { format!("{v:e}") } else { v.to_string() }
}
