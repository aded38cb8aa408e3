//! What a finished experiment is shown with: a page for the browser and plots for papers.
//!
//! `index.html` needs nothing beside it: data, pictures, styles and scripts are inside, and it fetches nothing. All figures are
//! computed here ([`analysis`], [`curves`]); its scripts draw them. `plots/` has the same curves as SVG and PNG.

pub mod analysis;
pub mod curves;
mod encode;
mod page;
mod pictures;
mod plot;

use crate::experiment::Outcome;
use crate::film::io::{WriteError, WriteErrorKind, atomic_write};
use std::io::Write;
use std::path::Path;

/// Writes `index.html`, `plots/*.svg` and `plots/*.png` into the folder of an experiment, each as a whole.
///
/// Pictures are read from there by the names in the rows; one that cannot be read is left out, and the page says so.
///
/// # Errors
/// [`WriteError`] if a file cannot be written.
pub fn write(outcome: &Outcome, folder: &Path) -> Result<(), WriteError> {
    let plots = folder.join("plots");
    std::fs::create_dir_all(&plots).map_err(|e| WriteError { path: plots, kind: WriteErrorKind::Io(e) })?;
    let names = plot::write_all(outcome, folder)?;
    let gallery = pictures::gather(outcome, folder);
    let text = page::text(outcome, &gallery, &names);
    atomic_write(&folder.join("index.html"), |file| Ok(file.write_all(text.as_bytes())?))
}

#[cfg(test)]
mod tests;
