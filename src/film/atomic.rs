//! Files that are either whole or not there: a temporary file in the same folder, fsync, rename, fsync of the folder.
//!
//! Whenever the process or the machine dies, the target is the old file or the new one, never a mix of both.

use super::lock::{TEMPORARY_SUFFIX, temporary_prefix};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a file could not be written.
#[derive(Debug, Error)]
#[error("{}: {kind}", path.display())]
pub struct WriteError {
    /// The file that was to be written.
    pub path: PathBuf,
    /// What stood in the way.
    pub kind: WriteErrorKind,
}

/// What stands in the way of a [`WriteError`].
#[derive(Debug, Error)]
pub enum WriteErrorKind {
    /// The target is a folder.
    #[error("is a folder, expected the name of a file")]
    IsFolder,
    /// The target's folder does not exist.
    #[error("the folder {} does not exist", .0.display())]
    NoFolder(PathBuf),
    /// The operating system refused.
    #[error("cannot be written: {0}")]
    Io(io::Error),
    /// Another run writes it.
    #[error("is being written by another run; give another name with -o, or wait for that run")]
    Busy,
    /// The contents cannot be expressed in the format.
    #[error("cannot be encoded: {0}")]
    Encode(String),
}

impl From<io::Error> for WriteErrorKind {
    fn from(error: io::Error) -> Self {
        WriteErrorKind::Io(error)
    }
}

/// Writes a file as a whole, or leaves what was there.
///
/// `write` fills the new contents through a buffer. A target that exists and is no regular file (`/dev/stdout`, a pipe) is
/// written in place: replacing it would destroy it. A symbolic link is followed, so that the file behind it is replaced.
///
/// # Errors
/// [`WriteError`] if the target cannot be created, filled, synchronised or renamed; the temporary file is removed.
pub fn atomic_write(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), WriteErrorKind>,
) -> Result<(), WriteError> {
    replace(path, write).map_err(|kind| WriteError { path: path.to_owned(), kind })
}

/// Checks that a file could be written there, so that a long run does not end in vain.
///
/// # Errors
/// [`WriteError`] as [`atomic_write`] would give.
pub fn probe_writable(path: &Path) -> Result<(), WriteError> {
    probe(path).map_err(|kind| WriteError { path: path.to_owned(), kind })
}

fn replace(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), WriteErrorKind>) -> Result<(), WriteErrorKind> {
    if is_special(path) {
        let file = OpenOptions::new().write(true).open(path)?;
        return fill(&file, write);
    }
    let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let temporary = temporary_beside(&target)?;
    fill(temporary.as_file(), write)?;
    temporary.as_file().sync_all()?;
    temporary.persist(&target).map_err(|e| e.error)?;
    // The rename itself lives in the folder.
    File::open(folder_of(&target))?.sync_all()?;
    Ok(())
}

fn probe(path: &Path) -> Result<(), WriteErrorKind> {
    if is_special(path) {
        OpenOptions::new().write(true).open(path)?;
        return Ok(());
    }
    let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    temporary_beside(&target)?.close()?;
    Ok(())
}

/// Runs `write` and demands that its last byte reached the file: a full disk shows itself here.
fn fill(file: &File, write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), WriteErrorKind>) -> Result<(), WriteErrorKind> {
    let mut buffer = BufWriter::new(file);
    write(&mut buffer)?;
    buffer.flush()?;
    Ok(())
}

fn temporary_beside(target: &Path) -> Result<tempfile::NamedTempFile, WriteErrorKind> {
    let folder = folder_of(target);
    if target.is_dir() || target.file_name().is_none() {
        return Err(WriteErrorKind::IsFolder);
    }
    if !folder.is_dir() {
        return Err(WriteErrorKind::NoFolder(folder.to_owned()));
    }
    let mut builder = tempfile::Builder::new();
    let prefix = temporary_prefix(target);
    builder.prefix(&prefix).suffix(TEMPORARY_SUFFIX);
    // As an ordinary new file: the user's umask applies.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    Ok(builder.tempfile_in(folder)?)
}

pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// True for devices, pipes and sockets.
pub(super) fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|m| !m.is_file() && !m.is_dir())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_in(folder: &Path) -> Vec<String> {
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_rubbish() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        atomic_write(&path, |f| Ok(f.write_all(b"old")?)).unwrap();
        let failed = atomic_write(&path, |f| {
            f.write_all(b"half of the n")?;
            Err(WriteErrorKind::Encode("seeded".into()))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(names_in(folder.path()), ["a.txt"]);
    }

    #[test]
    fn the_target_is_never_seen_half_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        atomic_write(&path, |f| Ok(f.write_all(b"old")?)).unwrap();
        atomic_write(&path, |f| {
            f.write_all(b"new")?;
            f.flush()?;
            assert_eq!(std::fs::read(&path)?, b"old");
            Ok(())
        })
        .unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_full_disk_is_an_error() {
        if Path::new("/dev/full").exists() {
            let error = atomic_write(Path::new("/dev/full"), |f| Ok(f.write_all(b"x")?)).unwrap_err();
            assert!(matches!(error.kind, WriteErrorKind::Io(_)), "{error}");
        }
    }

    #[test]
    fn a_device_is_written_and_not_replaced() {
        atomic_write(Path::new("/dev/null"), |f| Ok(f.write_all(b"x")?)).unwrap();
        assert!(is_special(Path::new("/dev/null")));
    }

    #[test]
    fn a_link_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        std::fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        atomic_write(&link, |f| Ok(f.write_all(b"new")?)).unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"new");
        assert!(link.is_symlink());
    }

    #[test]
    fn the_probe_finds_what_would_fail_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let probe = |p: &Path| probe_writable(p).map_err(|e| e.kind);
        assert!(matches!(probe(folder.path()), Err(WriteErrorKind::IsFolder)));
        assert!(matches!(probe(&folder.path().join("none/a.exr")), Err(WriteErrorKind::NoFolder(_))));
        assert!(matches!(probe(Path::new("/proc/a.exr")), Err(WriteErrorKind::Io(_))));
        probe(&folder.path().join("a.exr")).unwrap();
        assert!(names_in(folder.path()).is_empty());
    }

    #[test]
    fn a_new_file_has_ordinary_permissions() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, theirs) = (folder.path().join("ours"), folder.path().join("theirs"));
        atomic_write(&ours, |f| Ok(f.write_all(b"x")?)).unwrap();
        std::fs::write(&theirs, "x").unwrap();
        let mode = |p: &Path| p.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&theirs));
    }
}
