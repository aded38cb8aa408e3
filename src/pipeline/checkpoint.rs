//! The state of an unfinished render in a file, from which another process goes on to the same bits.
//!
//! The format, version 2. Numbers are little-endian.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `TWOPART` and the byte 0x1a |
//! | 4 | version of the format |
//! | 32 | key: BLAKE3 of the scene's hash, the settings and the program's version ([`key`]) |
//! | rest | [`Checkpoint`] in postcard's encoding |
//! | 32 | BLAKE3 of all before |
//!
//! The key knows nothing of the budget: passes do not depend on it, so a run may go on for longer than was asked of it at first.

use super::RenderSettings;
use super::keys::Key;
use crate::film::Film;
use crate::film::io::{WriteError, WriteErrorKind, atomic_write};
use crate::integrator::drive::Budget;
use crate::world::walk::RayCounts;
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const MAGIC: [u8; 8] = *b"TWOPART\x1a";
const VERSION: u32 = 3;
const HEAD: usize = MAGIC.len() + 4 + 32;
const SUM: usize = 32;

/// What a render knows after a pass.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Sums of all passes so far.
    pub film: Film,
    /// Rays of pass two so far.
    pub counts: RayCounts,
    /// What the method knows besides ([`crate::integrator::Integrator::state`]).
    pub state: Vec<u8>,
    /// Wall and CPU seconds spent so far, which count for budgets.
    pub spent: (f64, f64),
}

/// The same, borrowed from a run.
#[derive(Serialize)]
struct Running<'a> {
    film: &'a Film,
    counts: RayCounts,
    state: &'a [u8],
    spent: (f64, f64),
}

/// Why a run cannot be continued.
#[derive(Debug, thiserror::Error)]
#[error("{}: {kind}", path.display())]
pub struct CheckpointError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub kind: CheckpointFault,
}

/// What may be wrong with a checkpoint.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointFault {
    /// The system's words.
    #[error("cannot be read, so there is nothing to go on from: {0}")]
    Io(#[from] io::Error),
    /// Something else.
    #[error("is no unfinished run of this program (expected a file that an interrupted `twopass render` left)")]
    Foreign,
    /// Of another time.
    #[error("has version {0} of the format, expected {VERSION}: render anew without --resume")]
    Version(u32),
    /// Cut off or changed.
    #[error("is damaged or was cut off: its checksum is wrong; render anew without --resume")]
    Damaged,
    /// Of another scene or other settings.
    #[error(
        "is of another run: the scene, the settings or the program changed since; render anew without --resume, or give the same flags"
    )]
    Stale,
}

/// What the bits of a picture depend on, as a hash. `also` names what neither the scene's hash nor the settings hold.
pub fn key(scene_hash: u64, settings: &RenderSettings, also: &str) -> Key {
    let mut settings = RenderSettings { budget: Budget::default(), resume: None, ..settings.clone() };
    settings.pass_one.max_memory = None;
    let version = env!("CARGO_PKG_VERSION");
    *blake3::hash(format!("{VERSION} {version} {scene_hash:016x} {settings:?} {also}").as_bytes()).as_bytes()
}

impl Checkpoint {
    /// Reads the state of a run with this key.
    ///
    /// # Errors
    /// If it is not there, not whole, or of another run.
    pub fn read(path: &Path, key: &Key) -> Result<Arc<Self>, CheckpointError> {
        let failed = |kind| CheckpointError { path: path.to_owned(), kind };
        let bytes = std::fs::read(path).map_err(|error| failed(error.into()))?;
        parse(&bytes, key).map(Arc::new).map_err(failed)
    }
}

fn parse(bytes: &[u8], key: &Key) -> Result<Checkpoint, CheckpointFault> {
    if !bytes.starts_with(&MAGIC) {
        return Err(CheckpointFault::Foreign);
    }
    if bytes.len() < HEAD + SUM {
        return Err(CheckpointFault::Damaged);
    }
    let (contents, sum) = bytes.split_at(bytes.len() - SUM);
    if blake3::hash(contents).as_bytes() != sum {
        return Err(CheckpointFault::Damaged);
    }
    let mut version = [0; 4];
    version.copy_from_slice(&contents[MAGIC.len()..MAGIC.len() + 4]);
    match u32::from_le_bytes(version) {
        VERSION => {}
        other => return Err(CheckpointFault::Version(other)),
    }
    if contents[MAGIC.len() + 4..HEAD] != *key {
        return Err(CheckpointFault::Stale);
    }
    postcard::from_bytes(&contents[HEAD..]).map_err(|_| CheckpointFault::Damaged)
}

/// Writes the state of a run, whole or not at all.
///
/// # Errors
/// If it cannot be written.
pub fn write(
    path: &Path,
    key: &Key,
    (film, counts): (&Film, &RayCounts),
    state: &[u8],
    spent: (f64, f64),
) -> Result<(), WriteError> {
    atomic_write(path, |file| {
        let mut summed = Summed { file, hash: blake3::Hasher::new() };
        summed.write_all(&MAGIC)?;
        summed.write_all(&VERSION.to_le_bytes())?;
        summed.write_all(key)?;
        let running = Running { film, counts: *counts, state, spent };
        let Summed { file, hash } =
            postcard::to_io(&running, summed).map_err(|_| WriteErrorKind::Io(io::Error::last_os_error()))?;
        Ok(file.write_all(hash.finalize().as_bytes())?)
    })
}

/// A file that knows the hash of what went into it.
struct Summed<W> {
    file: W,
    hash: blake3::Hasher,
}

impl<W: Write> Write for Summed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.file.write(bytes)?;
        self.hash.update(&bytes[..n]);
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
