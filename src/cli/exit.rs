//! One error for the whole program, its exit code, and how it is shown.

use super::interrupt::Signal;
use miette::{Diagnostic, LabeledSpan, MietteHandlerOpts, NamedSource, Report, SourceCode};
use std::fmt;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;
use twopass::accel::AccelError;
use twopass::experiment::{ExperimentError, JudgeError, PlanError, StoreError};
use twopass::film::guard::in_guarded_decoder;
use twopass::film::io::{ReadError, ReadErrorKind, WriteError};
use twopass::load::{Fault, LoadError, Position};
use twopass::metrics::MetricsError;
use twopass::pipeline::direct::WeightError;
use twopass::pipeline::solution_file::SolutionFileError;
use twopass::pipeline::{CheckpointError, PipelineError};

/// Exit code of a fault in this program.
pub const INTERNAL: u8 = 1;
const USAGE: u8 = 2;
const INPUT: u8 = 3;
const LIMIT: u8 = 4;
const OUTPUT: u8 = 5;
const CHECK: u8 = 6;

/// Longest line of a scene file that is shown with an error.
const LONGEST_SHOWN_LINE: usize = 200;

/// Why the program ends without having done what was asked.
#[derive(Debug, Error)]
pub enum Failure {
    /// A flag's name or value.
    #[error("{0}")]
    Usage(String),
    /// A scene that cannot be loaded.
    #[error(transparent)]
    Load(Box<LoadError>),
    /// A picture that cannot be read.
    #[error(transparent)]
    Picture(#[from] ReadError),
    /// Pictures that cannot be compared.
    #[error(transparent)]
    Metrics(#[from] MetricsError),
    /// A table that cannot be read.
    #[error("{}:{line}: {detail}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong there.
        detail: String,
    },
    /// Another input that cannot be read.
    #[error("cannot read {}: {error}", path.display())]
    Input {
        /// The file.
        path: PathBuf,
        /// The system's words.
        error: std::io::Error,
    },
    /// A kept solution that cannot be used.
    #[error(transparent)]
    Solution(#[from] SolutionFileError),
    /// An unfinished run that cannot be continued.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A light that cannot be weighted.
    #[error("--light: {0}")]
    Weight(#[from] WeightError),
    /// A plan that cannot be read.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// Over a limit on size, memory, depth or count.
    #[error("{0}")]
    Limit(String),
    /// Rendering or solving failed.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// An output file.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Standard output.
    #[error("cannot write to standard output: {0}")]
    Stdout(std::io::Error),
    /// The result is there but not as it should be.
    #[error("{0}")]
    Check(String),
    /// Stopped by a signal.
    #[error("{}: {kept}", signal.describe())]
    Interrupted {
        /// Which.
        signal: Signal,
        /// What became of the result.
        kept: String,
    },
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        Failure::Load(Box::new(error))
    }
}

impl From<ExperimentError> for Failure {
    fn from(error: ExperimentError) -> Self {
        match error {
            ExperimentError::Load(error) => Failure::Load(error),
            ExperimentError::Judge(JudgeError::Read(error)) => Failure::Picture(error),
            ExperimentError::Judge(JudgeError::Fit { error, .. }) => Failure::Metrics(error),
            ExperimentError::Store(StoreError::Write(error)) | ExperimentError::Write(error) => Failure::Write(error),
            ExperimentError::Store(StoreError::Rows { path, line, detail }) => Failure::Table { path, line, detail },
            ExperimentError::Store(error @ StoreError::Busy(_)) => Failure::Usage(error.to_string()),
        }
    }
}

impl Failure {
    /// Nothing was asked for.
    pub fn no_command() -> Self {
        Failure::Usage(
            "expected a subcommand: render, solve, info, probe, compare, experiment or stability (see --help)".to_owned(),
        )
    }

    /// The program's exit code.
    pub fn code(&self) -> u8 {
        match self {
            Failure::Usage(_) | Failure::Weight(_) => USAGE,
            Failure::Solution(_) | Failure::Checkpoint(_) => INPUT,
            Failure::Load(error) => match error.kind.fault() {
                Fault::Usage => USAGE,
                Fault::Invalid => INPUT,
                Fault::OverLimit => LIMIT,
            },
            Failure::Picture(ReadError { kind: ReadErrorKind::TooLarge { .. }, .. }) | Failure::Limit(_) => LIMIT,
            Failure::Picture(_) | Failure::Metrics(_) | Failure::Table { .. } | Failure::Plan(_) | Failure::Input { .. } => INPUT,
            Failure::Pipeline(error) => match error {
                PipelineError::Accel(AccelError::TooManyPrimitives { .. })
                | PipelineError::Patch(_)
                | PipelineError::Memory { .. } => LIMIT,
                PipelineError::Accel(_)
                | PipelineError::Crop(..)
                | PipelineError::NoFirstPass(_)
                | PipelineError::OneReadOut(_)
                | PipelineError::NoVirtualRooms => USAGE,
                PipelineError::Solve(_) => CHECK,
                PipelineError::Unfinished(_) => INPUT,
                PipelineError::Stopped => INTERNAL,
            },
            Failure::Write(_) | Failure::Stdout(_) => OUTPUT,
            Failure::Check(_) => CHECK,
            Failure::Interrupted { signal, .. } => signal.exit_code(),
        }
    }

    /// Shows the failure with its causes on stderr, once, with the place in the scene file if there is one.
    pub fn print(&self) {
        let terminal = std::io::stderr().is_terminal();
        // Messages in a log stay on one line; a terminal wraps them at its width.
        let _ = miette::set_hook(Box::new(move |_| {
            let options = MietteHandlerOpts::new().context_lines(1).wrap_lines(terminal);
            Box::new(options.build())
        }));
        // Whether anyone listens does not matter.
        let _ = writeln!(std::io::stderr(), "{}", format!("{:?}", Report::new(Shown::new(self))).trim_end());
    }
}

/// A fault of this program says so, in one line and with its place. One that damaged pictures cause in a decoder does not: it
/// becomes an error.
pub fn install_panic_message() {
    std::panic::set_hook(Box::new(|info| {
        if !in_guarded_decoder() {
            let _ = writeln!(std::io::stderr(), "twopass: internal fault, please report it: {info}");
        }
    }));
}

/// A failure as miette draws it.
#[derive(Debug)]
struct Shown {
    message: String,
    snippet: Option<Snippet>,
}

/// The text of a scene file and the byte in it at which something is wrong.
#[derive(Debug)]
struct Snippet {
    text: NamedSource<String>,
    offset: usize,
}

impl Shown {
    fn new(failure: &Failure) -> Self {
        let snippet = match failure {
            Failure::Load(error) => error.at.as_ref().and_then(|at| snippet(&error.file, at)),
            _ => None,
        };
        Self { message: chain(failure), snippet }
    }
}

/// The message and those causes that it does not repeat already.
fn chain(error: &dyn std::error::Error) -> String {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = error.to_string();
        if !message.contains(&text) {
            message = format!("{message}: {text}");
        }
        cause = error.source();
    }
    message
}

/// The scene file again, if the line at fault is short enough to be shown.
fn snippet(file: &Path, at: &Position) -> Option<Snippet> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().nth(at.line.checked_sub(1)? as usize)?;
    (line.len() <= LONGEST_SHOWN_LINE && at.offset <= text.len())
        .then(|| Snippet { text: NamedSource::new(file.display().to_string(), text.clone()), offset: at.offset })
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Shown {}

impl Diagnostic for Shown {
    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.snippet.as_ref().map(|s| &s.text as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let snippet = self.snippet.as_ref()?;
        Some(Box::new(std::iter::once(LabeledSpan::new(Some("here".to_owned()), snippet.offset, 1))))
    }
}
