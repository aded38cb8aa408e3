//! The program's own modules: command line, terminal, signals, exit codes. The library knows nothing of them.

mod args;
mod commands;
mod exit;
mod header;
mod interrupt;
mod method_args;
mod output;
mod progress;
mod report;
mod saving;
mod scene_file;
mod snapshots;
mod values;

use args::{Args, Command};
use clap::Parser;
use exit::Failure;
use std::process::ExitCode;
use twopass::accel::AccelError;

/// More threads than this for each processor are never started: they would only cost the time to start them.
const MOST_THREADS_PER_PROCESSOR: usize = 8;

/// Parses the command line, runs it, reports a failure once, and gives the exit code.
pub fn main() -> ExitCode {
    exit::install_panic_message();
    let args = Args::parse();
    // A panic is a fault of this program; its message has been printed by the hook.
    match std::panic::catch_unwind(|| run(&args)) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(failure)) => {
            failure.print();
            ExitCode::from(failure.code())
        }
        Err(_) => ExitCode::from(exit::INTERNAL),
    }
}

fn run(args: &Args) -> Result<(), Failure> {
    if let Some(message) = args.not_delivered() {
        return Err(Failure::Usage(message));
    }
    let Some(command) = &args.command else {
        return if args.list_methods { commands::list_methods() } else { Err(Failure::no_command()) };
    };
    if !args.common.accel.is_available() {
        return Err(Failure::Usage(AccelError::EmbreeMissing.to_string()));
    }
    start_threads(args.common.threads)?;
    let common = &args.common;
    match command {
        Command::Render(render) if args.list_methods || render.list_methods => commands::list_methods(),
        Command::Render(args) => commands::render::run(common, args),
        Command::Solve(args) => commands::solve::run(common, args),
        Command::Info(args) => commands::info::run(common, args),
        Command::Probe(args) => commands::probe::run(common, args),
        Command::Compare(args) => commands::compare::run(common, args),
        Command::Experiment(args) => commands::experiment::run(common, args),
        Command::Stability(args) => commands::stability::run(common, args),
        Command::FormFactors(args) => commands::form_factors::run(common, args),
        Command::Serve(_) => {
            unreachable!("refused before")
        }
    }
}

fn start_threads(threads: usize) -> Result<(), Failure> {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let builder = rayon::ThreadPoolBuilder::new().num_threads(threads.min(MOST_THREADS_PER_PROCESSOR * processors));
    builder.build_global().map_err(|error| Failure::Limit(format!("cannot start {threads} threads: {error}")))
}
