//! One run an output: a lock beside it, which the system gives back however its holder ends.

use super::atomic::{WriteError, WriteErrorKind, folder_of, is_special};
use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use std::fs::{File, OpenOptions};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Keeps other runs from writing the same output, until it is dropped.
#[derive(Debug)]
pub struct OutputLock {
    path: PathBuf,
    _file: Flock<File>,
}

impl OutputLock {
    /// Takes the lock of an output, by the name of its first file. Devices and pipes have none.
    ///
    /// # Errors
    /// [`WriteErrorKind::Busy`] if another process holds it, or what stood in the way of making it.
    pub fn take(target: &Path) -> Result<Option<Self>, WriteError> {
        if is_special(target) {
            return Ok(None);
        }
        lock(target).map_err(|kind| WriteError { path: target.to_owned(), kind })
    }

    /// Removes the temporary files that killed runs left of these outputs, all of which this lock stands for.
    pub fn sweep(&self, targets: &[&Path]) {
        for target in targets {
            let prefix = temporary_prefix(target);
            let Ok(entries) = std::fs::read_dir(folder_of(target)) else { continue };
            for entry in entries.flatten() {
                let name = entry.file_name();
                let name = name.to_string_lossy();
                if name.starts_with(&prefix) && name.ends_with(TEMPORARY_SUFFIX) {
                    // Rubbish that cannot be removed does no harm.
                    let _ = std::fs::remove_file(entry.path());
                }
            }
        }
    }
}

impl Drop for OutputLock {
    fn drop(&mut self) {
        // While it is still held, so that nobody can hold the name without the lock.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// How the name of a temporary file beside `target` begins.
pub(super) fn temporary_prefix(target: &Path) -> String {
    format!(".{}.", target.file_name().unwrap_or_default().to_string_lossy())
}

/// How it ends.
pub(super) const TEMPORARY_SUFFIX: &str = ".tmp";

fn lock(target: &Path) -> Result<Option<OutputLock>, WriteErrorKind> {
    let path = folder_of(target).join(format!("{}lock", temporary_prefix(target)));
    loop {
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(&path)?;
        let file = match Flock::lock(file, FlockArg::LockExclusiveNonblock) {
            Ok(file) => file,
            Err((_, Errno::EWOULDBLOCK)) => return Err(WriteErrorKind::Busy),
            // A file system without locks: runs on it are as they were without.
            Err(_) => return Ok(None),
        };
        // The holder before may have removed the name between opening and locking.
        let same = |there: std::fs::Metadata| file.metadata().is_ok_and(|m| (m.dev(), m.ino()) == (there.dev(), there.ino()));
        if path.metadata().is_ok_and(same) {
            return Ok(Some(OutputLock { path, _file: file }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_holder_at_a_time_and_nothing_left() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.exr");
        let held = OutputLock::take(&target).unwrap();
        assert!(matches!(OutputLock::take(&target).unwrap_err().kind, WriteErrorKind::Busy));
        assert!(OutputLock::take(&folder.path().join("b.exr")).unwrap().is_some(), "another output is free");
        drop(held);
        let again = OutputLock::take(&target).unwrap().expect("free again");
        for name in [".a.exr.x1.tmp", ".b.exr.x1.tmp", "a.exr.tmp"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        again.sweep(&[&target]);
        drop(again);
        let mut left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, [".b.exr.x1.tmp", "a.exr.tmp"]);
        assert!(OutputLock::take(Path::new("/dev/null")).unwrap().is_none());
    }
}
