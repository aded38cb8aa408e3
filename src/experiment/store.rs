//! The folder of an experiment: rows, pictures, reports.

use super::child;
use super::row::{Row, Status};
use crate::film::io::{WriteError, WriteErrorKind, atomic_write};
use nix::fcntl::{Flock, FlockArg};
use std::fs::{File, create_dir_all};
use std::io::Write;
use std::path::{Path, PathBuf};

/// 64-bit digest (FNV-1a of Fowler, Noll and Vo): the same on any machine and in any version. Against accidents, not against intent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Digest(u64);

impl Default for Digest {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Digest {
    /// Adds a part; parts do not run into each other.
    pub fn add(&mut self, part: &[u8]) {
        let mut step = |byte: u8| self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        part.iter().for_each(|byte| step(*byte));
        part.len().to_le_bytes().into_iter().for_each(step);
    }

    /// In 16 hexadecimal digits.
    pub fn text(self) -> String {
        format!("{:016x}", self.0)
    }
}

/// Why a folder cannot be worked in.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file or folder cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Another experiment works in it.
    #[error("{}: another experiment is running in this folder", .0.display())]
    Busy(PathBuf),
    /// Rows of an earlier start cannot be read.
    #[error("{}:{line}: {detail}", path.display())]
    Rows {
        /// The file.
        path: PathBuf,
        /// The line.
        line: usize,
        /// What is wrong there.
        detail: String,
    },
}

/// The folder, held by this process alone.
pub struct Store {
    folder: PathBuf,
    rows: Vec<Row>,
    // Held until the end.
    _lock: Flock<File>,
}

impl Store {
    /// Opens a folder, or makes it, and reads the rows of an earlier start. A run that was left behind by it is killed.
    ///
    /// # Errors
    /// [`StoreError`] if it cannot be written, is in use, or its rows cannot be read.
    pub fn open(folder: &Path) -> Result<Store, StoreError> {
        // Runs have other working folders.
        let folder = &std::path::absolute(folder).map_err(|error| write_error(folder, error))?;
        for sub in ["", "images", "reports", "references", "solutions", "scratch"] {
            let path = folder.join(sub);
            create_dir_all(&path).map_err(|error| write_error(&path, error))?;
        }
        let lock_path = folder.join(".lock");
        let file = File::create(&lock_path).map_err(|error| write_error(&lock_path, error))?;
        let lock = Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|_| StoreError::Busy(folder.to_owned()))?;
        let store = Store { folder: folder.to_owned(), rows: read_rows(&folder.join("rows.csv"))?, _lock: lock };
        if let Ok(identity) = std::fs::read_to_string(store.running()) {
            child::kill_left_behind(identity.trim());
        }
        store.clear_scratch();
        Ok(store)
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// All rows so far.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Adds the rows of a run in place of those that `replaced` names; the file has all of them or none.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn add(&mut self, rows: &[Row], replaced: impl Fn(&Row) -> bool) -> Result<(), WriteError> {
        self.rows.retain(|row| !replaced(row));
        self.rows.extend_from_slice(rows);
        write_rows(&self.path("rows.csv"), &self.rows)
    }

    /// Moves rows that do not belong to the plan any more to `rows.old.csv`, and says how many.
    ///
    /// # Errors
    /// [`StoreError`] if the files cannot be read or written.
    pub fn set_aside(&mut self, belongs: impl Fn(&Row) -> bool) -> Result<usize, StoreError> {
        let (kept, old): (Vec<Row>, Vec<Row>) = std::mem::take(&mut self.rows).into_iter().partition(belongs);
        self.rows = kept;
        if !old.is_empty() {
            let path = self.path("rows.old.csv");
            let mut all = read_rows(&path)?;
            all.extend_from_slice(&old);
            write_rows(&path, &all)?;
            write_rows(&self.path("rows.csv"), &self.rows)?;
        }
        Ok(old.len())
    }

    /// True if the row is done and its picture still there.
    pub fn is_whole(&self, row: &Row) -> bool {
        row.status == Status::Done && (row.image.is_empty() || self.path(&row.image).exists())
    }

    /// Remembers which process runs, so that the next start finds it if this one is killed.
    pub fn note_running(&self, pid: u32) {
        if let Some(identity) = child::identity(pid) {
            let _ = std::fs::write(self.running(), identity);
        }
    }

    /// Forgets it.
    pub fn note_ended(&self) {
        let _ = std::fs::remove_file(self.running());
    }

    /// Removes what runs left in the folder where they work.
    pub fn clear_scratch(&self) {
        for entry in std::fs::read_dir(self.path("scratch")).into_iter().flatten().flatten() {
            let _ = std::fs::remove_file(entry.path());
        }
    }

    fn running(&self) -> PathBuf {
        self.path(".running")
    }
}

fn write_error(path: &Path, error: std::io::Error) -> StoreError {
    StoreError::Write(WriteError { path: path.to_owned(), kind: WriteErrorKind::Io(error) })
}

fn read_rows(path: &Path) -> Result<Vec<Row>, StoreError> {
    let bytes = match std::fs::read(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(StoreError::Rows { path: path.to_owned(), line: 1, detail: error.to_string() }),
        Ok(bytes) => bytes,
    };
    let fault = |error: csv::Error| {
        let line = error.position().map_or(1, |at| at.line() as usize);
        StoreError::Rows { path: path.to_owned(), line, detail: error.to_string() }
    };
    csv::Reader::from_reader(&bytes[..]).into_deserialize().collect::<Result<_, _>>().map_err(fault)
}

fn write_rows(path: &Path, rows: &[Row]) -> Result<(), WriteError> {
    atomic_write(path, |file| {
        let mut writer = csv::Writer::from_writer(file);
        let written: Result<(), csv::Error> = rows.iter().try_for_each(|row| writer.serialize(row));
        written.map_err(|error| WriteErrorKind::Encode(error.to_string()))?;
        Ok(writer.flush()?)
    })
}

/// Writes a text file as a whole.
///
/// # Errors
/// [`WriteError`] if it cannot be written.
pub fn write_text(path: &Path, text: &str) -> Result<(), WriteError> {
    atomic_write(path, |file| Ok(file.write_all(text.as_bytes())?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_and_a_second_experiment_is_kept_out() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        let row =
            |seed| Row { scene: "a, \"b\"".into(), seed, relmse: Some(1.0 / 3.0), message: "x\ny".into(), ..Row::default() };
        store.add(&[row(1), row(2)], |_| false).unwrap();
        store.add(&[row(3)], |r| r.seed == 1).unwrap();
        assert!(matches!(Store::open(folder.path()), Err(StoreError::Busy(_))));
        drop(store);
        let mut store = Store::open(folder.path()).unwrap();
        assert_eq!(store.rows(), [row(2), row(3)]);
        assert_eq!(store.set_aside(|r| r.seed == 3).unwrap(), 1);
        assert_eq!(store.rows(), [row(3)]);
        assert_eq!(read_rows(&store.path("rows.old.csv")).unwrap(), [row(2)]);
    }

    /// FNV-1a of "a" is a published value; the length that follows is ours.
    #[test]
    fn the_digest_keeps_parts_apart() {
        let of = |parts: &[&str]| {
            let mut digest = Digest::default();
            parts.iter().for_each(|p| digest.add(p.as_bytes()));
            digest
        };
        assert_ne!(of(&["ab", "c"]), of(&["a", "bc"]));
        assert_ne!(of(&["ab"]), of(&["ab", ""]));
        assert_eq!(of(&["ab", "c"]), of(&["ab", "c"]));
    }
}
