//! Runs of this program: their command lines, and rows from their run reports.

use super::job::{Job, Work};
use super::plan::{Plan, ScenePlan, words};
use super::row::Row;
use crate::run_report::{RunReport, SnapshotReport};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Stages of a run report that are neither pass one nor part of what is measured, or have a column of their own.
const NOT_PASS_ONE: [&str; 4] = ["load", "tree", "render", "write"];

/// What any run of this program on a scene is told: subcommand, scene, threads, seed, flags.
pub fn command(
    program: &Path,
    subcommand: &str,
    plan: &Plan,
    scene: &ScenePlan,
    flags: &BTreeMap<String, String>,
    seed: u64,
    report: &Path,
) -> Command {
    let mut command = Command::new(program);
    command.arg(subcommand).arg(&scene.file).args(["--quiet", "--progress", "never"]);
    command.arg(format!("--threads={}", plan.threads)).arg(format!("--seed={seed}"));
    command.arg(with_path("--report=", report));
    command.args(scene.allow_paths.iter().map(|folder| with_path("--allow-path=", folder)));
    command.args(scene.defines.iter().flat_map(|(name, value)| ["-D".to_owned(), format!("{name}={value}")]));
    command.args(words(flags));
    command
}

fn with_path(flag: &str, path: &Path) -> OsString {
    let mut word = OsString::from(flag);
    word.push(path);
    word
}

/// The command that renders a job's picture to `out`.
pub fn render(program: &Path, plan: &Plan, scene: &ScenePlan, job: &Job, out: &Path, report: &Path) -> Command {
    let mut command = command(program, "render", plan, scene, &job.flags, job.seed, report);
    command.arg(with_path("--output=", out));
    if let Some((width, height)) = scene.size {
        command.arg(format!("--size={width}x{height}"));
    }
    match &job.work {
        Work::Cpu(times) => {
            let text: Vec<String> = times.iter().map(f64::to_string).collect();
            let (last, earlier) = text.split_last().expect("a list of budgets is never empty");
            command.arg(format!("--cpu-time={last}"));
            if !earlier.is_empty() {
                command.arg(format!("--snapshots-cpu={}", earlier.join(",")));
            }
        }
        Work::Spp(spp) | Work::External(spp) => drop(command.arg(format!("--spp={spp}"))),
        Work::Solve => {}
    }
    command
}

/// Reads a run report.
///
/// # Errors
/// A sentence if it is not there or damaged.
pub fn read_report(path: &Path) -> Result<RunReport, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("no run report: {error}"))?;
    serde_json::from_str(&text).map_err(|error| format!("its run report is damaged: {error}"))
}

/// Fills in times and counts of a run that is over.
pub fn measure(row: &mut Row, report: &RunReport) {
    let of = |counts: &dyn Fn(&str) -> bool| {
        let stages = report.stages.iter().filter(|stage| counts(&stage.name));
        stages
            .fold(None, |sum: Option<(f64, f64)>, s| Some(sum.map_or((s.wall_s, s.cpu_s), |(w, c)| (w + s.wall_s, c + s.cpu_s))))
    };
    let cpu = |part: Option<(f64, f64)>| part.map(|(_, cpu)| cpu);
    (row.wall_s, row.cpu_s) = of(&|name| name != "load" && name != "write").unwrap_or_default();
    row.load_cpu_s = cpu(of(&|name| name == "load")).unwrap_or(0.0);
    row.tree_cpu_s = cpu(of(&|name| name == "tree"));
    row.pass_one_cpu_s = cpu(of(&|name| !NOT_PASS_ONE.contains(&name)));
    row.solve_cpu_s = cpu(of(&|name| name == "solve"));
    row.products = report.solver.as_ref().map(|solver| solver.sweeps);
    row.pass_two_cpu_s = cpu(of(&|name| name == "render"));
    row.spp = report.samples_per_pixel;
    let is_ray = |name: &&String| name.ends_with("_rays") && *name != "truncated_rays";
    row.rays = Some(report.counters.keys().filter(is_ray).map(|name| report.counters[name]).sum());
    row.peak_memory_bytes = Some(report.peak_memory_bytes);
    row.predicted_relmse = report.estimated_relmse;
}

/// The row of a snapshot, from that of the run's end: what came before pass two is the same.
pub fn row_of_snapshot(end: &Row, snapshot: &SnapshotReport) -> Row {
    let before = end.tree_cpu_s.unwrap_or(0.0) + end.pass_one_cpu_s.unwrap_or(0.0);
    Row {
        spp: snapshot.samples_per_pixel,
        wall_s: snapshot.wall_s,
        cpu_s: snapshot.cpu_s,
        pass_two_cpu_s: end.pass_two_cpu_s.map(|_| snapshot.cpu_s - before),
        rays: Some(snapshot.rays),
        predicted_relmse: snapshot.estimated_relmse,
        ..end.clone()
    }
}

/// The pictures of a run with their rows, without errors yet: snapshots whose picture differs from the next, then the end.
pub fn pictures(mut end: Row, job: &Job, report: &RunReport, out: &Path) -> Vec<(Row, PathBuf)> {
    let mut all: Vec<(Row, PathBuf)> = Vec::new();
    if report.settings.get("read_out").is_some_and(|how| how == "progressive") && !report.snapshots.is_empty() {
        // Pass one is refined between the passes of pass two, so its time over the whole run is not that of any snapshot.
        (end.pass_one_cpu_s, end.pass_two_cpu_s) = (None, None);
    }
    if matches!(job.work, Work::Cpu(_)) {
        for snapshot in &report.snapshots {
            let row = Row { budget: job.budget(&format!("cpu={}", snapshot.asked_cpu_s)), ..row_of_snapshot(&end, snapshot) };
            all.push((row, PathBuf::from(&snapshot.file)));
        }
    }
    all.push((end, out.to_owned()));
    let spp: Vec<f64> = all.iter().map(|(row, _)| row.spp).collect();
    let mut index = 0;
    all.retain(|_| {
        index += 1;
        index == spp.len() || spp[index - 1] != spp[index]
    });
    all
}
