//! `twopass experiment`: error against run time by a plan.

use crate::cli::args::{Args, Command, Common, ExperimentArgs};
use crate::cli::exit::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::say;
use clap::Parser;
use std::path::Path;
use std::process::Stdio;
use twopass::accel::AccelError;
use twopass::experiment::{self, Event, Experiment, Plan, Reading, Row, RowKind, Status, Verdict};

/// Runs the subcommand.
pub fn run(common: &Common, args: &ExperimentArgs) -> Result<(), Failure> {
    if let Some(path) = &common.report {
        let why = "experiment keeps a report of each of its runs in its folder";
        return Err(Failure::Usage(format!("{why} (--report {})", path.display())));
    }
    let interrupt = Interrupt::listen();
    let defines: Vec<(String, String)> = args.define.iter().map(|d| (d.name.clone(), d.value.clone())).collect();
    let mut plan = Plan::read(&args.plan_file, &Reading { defines: &defines, judge: &judge, succeeds: &succeeds })?;
    if common.threads != 0 {
        plan.threads = common.threads;
    }
    if let Some(message) = plan.unknown(&args.scenes, &args.methods) {
        return Err(Failure::Usage(message));
    }
    let program = std::env::current_exe().map_err(|error| Failure::Input { path: "the program itself".into(), error })?;
    let stopped = || interrupt.signal().is_some();
    let experiment = Experiment {
        plan: &plan,
        folder: &args.output,
        program: &program,
        again: args.again,
        only: (&args.scenes, &args.methods),
        stopped: &stopped,
    };
    let finished = experiment::run(&experiment, &mut |event| say(common, &sentence(event)))?;
    if let (true, Some(signal)) = (finished.stopped, interrupt.signal()) {
        let kept = format!("{} rows are kept; the same command goes on", finished.outcome.rows.len());
        return Err(Failure::Interrupted { signal, kept });
    }
    let rows = &finished.outcome.rows;
    say(common, &format!("{} rows in {}", rows.len(), args.output.join("rows.csv").display()));
    let bad: Vec<&Row> = rows.iter().filter(|row| row.status != Status::Done).collect();
    match bad.first() {
        None => Ok(()),
        Some(row) => Err(Failure::Check(format!(
            "{} of {} rows are marked, first {}, {}, {}: {}",
            bad.len(),
            rows.len(),
            row.scene,
            row.method,
            row.budget,
            row.message
        ))),
    }
}

/// Looks at a command line as the program itself would.
fn judge(words: &[String]) -> Verdict {
    let line = std::iter::once("twopass").chain(words.iter().map(String::as_str));
    let args = match Args::try_parse_from(line) {
        Ok(args) => args,
        Err(error) => {
            let text = error.to_string();
            let first = text.lines().next().unwrap_or_default();
            return Verdict::Wrong(first.trim_start_matches("error: ").to_owned());
        }
    };
    match args.not_delivered() {
        Some(message) => Verdict::Wrong(message),
        None if !matches!(args.command, Some(Command::Render(_) | Command::Solve(_))) => Verdict::Wrong(words.join(" ")),
        None if !args.common.accel.is_available() => Verdict::Unavailable(AccelError::EmbreeMissing.to_string()),
        None => Verdict::Known,
    }
}

/// True if a shell command ends well; what it says is of no interest.
fn succeeds(command: &str, folder: &Path) -> bool {
    let mut shell = std::process::Command::new("sh");
    shell.arg("-c").arg(command).current_dir(folder).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    shell.status().is_ok_and(|status| status.success())
}

fn sentence(event: &Event<'_>) -> String {
    let place = |row: &Row| format!("{}, {}, {}, seed {}", row.scene, row.method, row.budget, row.seed);
    match event {
        Event::Note(text) => (*text).to_owned(),
        Event::Begins(i, n, row) => format!("[{i}/{n}] {}", place(row)),
        Event::Ended(row) if row.status != Status::Done => format!("    {}: {}", describe(row.status), row.message),
        Event::Ended(row) => {
            let error = |name: &str, value: Option<f64>| value.map(|v| format!(", {name} {v:.2e}")).unwrap_or_default();
            let measured = match row.kind {
                RowKind::Picture => "relmse",
                RowKind::PassOne => "squared relative error",
            };
            let predicted = error("predicted", row.predicted_relmse);
            format!("    {:.2} CPU s, {:.2} s{}{predicted}", row.cpu_s, row.wall_s, error(measured, row.relmse))
        }
    }
}

fn describe(status: Status) -> &'static str {
    match status {
        Status::Done => "done",
        Status::Failed => "failed",
        Status::TimedOut => "timed out",
        Status::Unusable => "no usable picture",
    }
}
