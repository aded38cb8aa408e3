//! `twopass stability`: stiff and extreme cases with known answers.

use crate::cli::args::{Common, StabilityArgs};
use crate::cli::exit::Failure;
use crate::cli::output::{print, say};
use std::io::Write;
use std::path::Path;
use twopass::film::io::{WriteError, WriteErrorKind, atomic_write, probe_writable};
use twopass::stability::{self, Verdict, page};

/// Runs the subcommand.
pub fn run(common: &Common, args: &StabilityArgs) -> Result<(), Failure> {
    if let Some(path) = &common.report {
        let path = path.display();
        return Err(Failure::Usage(format!("stability makes no run report (--report {path}); its result is in -o DIR")));
    }
    let files = args.output.as_ref().map(|folder| [folder.join("stability.csv"), folder.join("index.html")]);
    if let (Some(folder), Some(files)) = (&args.output, &files) {
        std::fs::create_dir_all(folder).map_err(|error| WriteError { path: folder.clone(), kind: WriteErrorKind::Io(error) })?;
        files.iter().try_for_each(|file| probe_writable(file))?;
    }
    let mut printed = Ok(());
    let rows = stability::run(&mut |row| {
        if printed.is_ok() {
            printed = print(&page::line(row));
        }
    });
    printed?;
    print(&format!("{}\n", page::summary(&rows)))?;
    if let Some([csv, html]) = &files {
        write(csv, &page::csv(&rows))?;
        write(html, &page::html(&rows, env!("CARGO_PKG_VERSION")))?;
        say(common, &format!("wrote {} and {}", csv.display(), html.display()));
    }
    let failed: Vec<&str> = rows.iter().filter(|r| r.verdict == Verdict::Fails).map(|r| r.id).collect();
    if failed.is_empty() { Ok(()) } else { Err(Failure::Check(format!("{} laws fail: {}", failed.len(), failed.join(", ")))) }
}

fn write(path: &Path, text: &str) -> Result<(), WriteError> {
    atomic_write(path, |file| Ok(file.write_all(text.as_bytes())?))
}
