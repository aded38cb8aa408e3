//! `twopass solve`: pass one alone, and how well it went.

use super::render_settings;
use crate::cli::args::{Common, SolveArgs};
use crate::cli::exit::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{print, say, short};
use crate::cli::progress::{Display, observer};
use crate::cli::{report, scene_file};
use std::io::Write as _;
use std::path::Path;
use twopass::film::io::{WriteError, atomic_write, probe_writable};
use twopass::patch::PatchMesh;
use twopass::pipeline::keys::{StageKeys, has_detours};
use twopass::pipeline::pass_one::expect_to_fit;
use twopass::pipeline::solution_file::{self, Meta, SolutionFile};
use twopass::pipeline::{self, Kept, PassOneSettings, PipelineError, Solved, StageCosts, surface_points};
use twopass::progress::Stage;
use twopass::run_report::{RunReport, StopReason, Stopwatch};
use twopass::world::World;

/// Runs the subcommand.
pub fn run(common: &Common, args: &SolveArgs) -> Result<(), Failure> {
    let interrupt = Interrupt::listen();
    let outputs = [&common.report, &args.irradiance, &args.output, &args.gltf];
    for path in outputs.into_iter().flatten() {
        probe_writable(path)?;
    }
    let watch = Stopwatch::start();
    let loaded = scene_file::load(common, &args.scene, &args.source)?;
    let mut settings = render_settings(common, &args.pass_one, None);
    let mut run_report = report::begin(common, &loaded, "solve", watch.elapsed());
    report::set_pass_one(&mut run_report, &args.pass_one);
    let mut costs = StageCosts::default();
    let world = costs.time(Stage::Tree, || World::new(loaded.scene, settings.accel)).map_err(PipelineError::from)?;
    // Where lamps cannot be weighted one by one a solution for each would be for nothing.
    settings.pass_one.by_light = args.output.is_some() && !has_detours(world.scene());
    if args.pass_one.form_factors.is_none() && args.pass_one.tolerance.is_none() {
        settings.pass_one.choose_form_factors(&world);
        report::set(&mut run_report, "form_factors", settings.pass_one.form_factors.name());
    }
    // How much memory there is decides nothing about the solution.
    let meta = Meta { settings: PassOneSettings { max_memory: None, ..settings.pass_one }, seed: settings.seed };
    let keys = args.output.as_ref().map(|_| StageKeys::of(world.scene(), &meta.settings, meta.seed));
    let reading = Stopwatch::start();
    let old = args.output.as_deref().filter(|path| path.exists()).map(SolutionFile::read).transpose()?;
    let mut kept = match (&old, &keys) {
        (Some(old), Some(keys)) => old.still_good(keys)?,
        _ => Kept::default(),
    };
    run_report.add_time(Stage::Load, reading.elapsed());
    if kept.form_factors.is_none() {
        // Counted as soon as it may fit, before memory is taken: patches alone are a small part of it.
        if kept.patches.is_none() {
            expect_to_fit(&world, &settings.pass_one)?;
            let patches = costs.time(Stage::Patches, || PatchMesh::build(&world, &settings.pass_one.patches));
            kept.fresh = Some(patches.map_err(PipelineError::from)?);
        }
        let patches = kept.patches.as_ref().or(kept.fresh.as_ref()).map_or(0, PatchMesh::len);
        say(common, &format!("pass one: {patches} patches, at most {} MB", settings.pass_one.predicted(patches) / 1_000_000));
    }

    let mut observer = observer(Display::new(common), &interrupt);
    let solved = pipeline::solve_from(world, &settings, kept, costs, &mut observer);
    let solved = solved.map_err(|error| report::no_result(common, &mut run_report, &interrupt, error))?;
    drop(observer);
    report::add_plan(&mut run_report, &solved.plan);
    report::add_costs(&mut run_report, &solved.stages, &solved.counts);
    report::add_pass_one(common, &mut run_report, &solved.pass_one);
    run_report.complete = solved.pass_one.solution.converged;
    run_report.stopped_by = if run_report.complete { StopReason::Finished } else { StopReason::NotConverged };
    if let (Some(path), Some(keys)) = (&args.output, &keys) {
        run_report.time(Stage::Write, || solution_file::write(path, meta, keys, &solved.pass_one, old.as_ref()))?;
    }
    if let Some(path) = &args.irradiance {
        run_report.time(Stage::Write, || write_irradiance(path, &solved, args.points))?;
    }
    if let Some(path) = &args.gltf {
        let file = pipeline::lit_gltf(&solved.world, &solved.pass_one);
        run_report.time(Stage::Write, || atomic_write(path, |out| Ok(out.write_all(&file)?)))?;
    }
    report::finish(common, &mut run_report)?;
    print(&summary(&run_report))?;
    report::verdict(&run_report, &interrupt, "")
}

/// A line for each point: place, normal, irradiance; the last three are empty in a gap between patches.
fn write_irradiance(path: &Path, solved: &Solved, n: u32) -> Result<(), WriteError> {
    let points = surface_points::irradiance(&solved.world, &solved.pass_one.field, n);
    atomic_write(path, |file| {
        writeln!(file, "x,y,z,nx,ny,nz,irradiance_r,irradiance_g,irradiance_b")?;
        for at in &points {
            let (p, n) = (at.point, at.normal);
            let found = at.irradiance.map_or_else(|| ",,".to_owned(), |h| format!("{},{},{}", h.r, h.g, h.b));
            writeln!(file, "{},{},{},{},{},{},{found}", p.x, p.y, p.z, n.x, n.y, n.z)?;
        }
        Ok(())
    })
}

/// `name value` lines.
fn summary(run_report: &RunReport) -> String {
    let mut lines: Vec<(&str, String)> = Vec::new();
    for name in ["patches", "patches_kept", "form_factors", "form_factors_kept", "form_factor_rays", "shadow_rays", "sweeps_kept"]
    {
        lines.push((name, run_report.counters.get(name).copied().unwrap_or(0).to_string()));
    }
    if let Some(closure) = &run_report.closure {
        lines.push(("row_sum_min", closure.raw_row_sum_min.to_string()));
        lines.push(("row_sum_max", closure.raw_row_sum_max.to_string()));
        lines.push(("reciprocity_defect", short(closure.reciprocity_defect)));
    }
    if let Some(solver) = &run_report.solver {
        lines.push(("solver", solver.method.clone()));
        lines.push(("sweeps", solver.sweeps.to_string()));
        lines.push(("error_bound", short(solver.error_bound)));
        lines.push(("condition", short(solver.condition)));
        lines.push(("closure_influence", short(solver.closure_influence)));
        lines.push(("converged", solver.converged.to_string()));
    }
    if let Some(power) = &run_report.power {
        lines.push(("power_emitted", short(power.emitted)));
        lines.push(("power_absorbed", short(power.absorbed)));
        lines.push(("power_escaped", short(power.escaped)));
        lines.push(("power_relative_defect", short(power.relative_defect)));
    }
    let spent = run_report.total();
    lines.push(("seconds", format!("{:.3}", spent.wall_s)));
    lines.push(("cpu_seconds", format!("{:.3}", spent.cpu_s)));
    lines.iter().map(|(name, value)| format!("{name} {value}\n")).collect()
}
