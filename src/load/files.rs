//! Which files may be read, how much of them, and what they contained: the hash of a scene.

use super::error::{LoadErrorKind, SourceText};
use super::{Limits, LoadOptions};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// The files of one scene.
#[derive(Debug)]
pub(super) struct Files {
    /// The scene file's folder, without links.
    pub root: PathBuf,
    allowed: Vec<PathBuf>,
    pub limits: Limits,
    /// Digest of every file read, by path without links.
    digests: Mutex<BTreeMap<PathBuf, u64>>,
    /// Pixels of the images taken so far.
    pixels: AtomicU64,
    /// Triangles of the shapes made so far.
    triangles: AtomicU64,
}

impl Files {
    /// The files beside the scene file `main`.
    pub fn beside(main: &Path, options: &LoadOptions) -> Result<Files, LoadErrorKind> {
        let parent = main.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let root = canonical(parent)?;
        let allowed = options.allow_paths.iter().map(|p| canonical(p)).collect::<Result<_, _>>()?;
        Ok(Files {
            root,
            allowed,
            limits: options.limits,
            digests: Mutex::default(),
            pixels: AtomicU64::new(0),
            triangles: AtomicU64::new(0),
        })
    }

    /// No files at all.
    pub fn nowhere(limits: Limits) -> Files {
        Files {
            root: PathBuf::from("/nowhere"),
            allowed: Vec::new(),
            limits,
            digests: Mutex::default(),
            pixels: AtomicU64::new(0),
            triangles: AtomicU64::new(0),
        }
    }

    /// The real path of `name`, as written in the scene, if it may be read.
    pub fn resolve(&self, name: &str) -> Result<PathBuf, LoadErrorKind> {
        let path = canonical(&self.root.join(name))?;
        let inside = |folder: &PathBuf| path.starts_with(folder);
        if inside(&self.root) || self.allowed.iter().any(inside) {
            Ok(path)
        } else {
            Err(LoadErrorKind::PathNotAllowed { path: name.into() })
        }
    }

    /// All bytes of a regular file of at most `limit` bytes.
    pub fn read(&self, path: &Path, limit: u64) -> Result<Vec<u8>, LoadErrorKind> {
        let failed = |e: std::io::Error| LoadErrorKind::Unreadable { path: path.into(), reason: e.to_string() };
        let meta = std::fs::metadata(path).map_err(failed)?;
        if !meta.is_file() {
            return Err(LoadErrorKind::Unreadable { path: path.into(), reason: "not a regular file".to_owned() });
        }
        let over = |found| LoadErrorKind::OverLimit { what: format!("size of {} in bytes", path.display()), limit, found };
        if meta.len() > limit {
            return Err(over(meta.len()));
        }
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(meta.len() as usize + 1).map_err(|e| failed(e.into()))?;
        // The file may grow while it is read.
        std::fs::File::open(path).and_then(|f| f.take(limit + 1).read_to_end(&mut bytes)).map_err(failed)?;
        if bytes.len() as u64 > limit {
            return Err(over(bytes.len() as u64));
        }
        self.digests.lock().expect("no holder of this lock panics").insert(path.to_owned(), digest(&bytes));
        Ok(bytes)
    }

    /// Asks for the memory of an image, before it is taken: limits hold for its sides, its pixels, and those of all images.
    pub fn take_pixels(&self, path: &Path, width: u64, height: u64) -> Result<(), LoadErrorKind> {
        let limits = &self.limits;
        let found = width.saturating_mul(height);
        let over = |what: &str, limit, found| {
            let what = format!("{what} {} ({width} x {height})", path.display());
            Err(LoadErrorKind::OverLimit { what, limit, found })
        };
        if width.max(height) > limits.image_side {
            return over("longer side of", limits.image_side, width.max(height));
        }
        if found > limits.image_pixels {
            return over("pixels of", limits.image_pixels, found);
        }
        let all = self.pixels.fetch_add(found, Ordering::Relaxed) + found;
        if all > limits.all_image_pixels {
            return over("pixels of all images with", limits.all_image_pixels, all);
        }
        Ok(())
    }

    /// Counts the triangles of a shape: a short scene file can ask for the same large mesh again and again.
    pub fn take_triangles(&self, count: usize) -> Result<(), LoadErrorKind> {
        let (limit, count) = (self.limits.triangles, count as u64);
        let found = self.triangles.fetch_add(count, Ordering::Relaxed) + count;
        if found > limit {
            return Err(LoadErrorKind::OverLimit { what: "triangles of all shapes".to_owned(), limit, found });
        }
        Ok(())
    }

    /// A text file in UTF-8.
    pub fn read_text(&self, path: &Path, limit: u64) -> Result<SourceText, LoadErrorKind> {
        let text = String::from_utf8(self.read(path, limit)?).map_err(|e| {
            let at = e.utf8_error().valid_up_to();
            let found = format!("byte {:#04x} at offset {at}", e.as_bytes()[at]);
            LoadErrorKind::Malformed { expected: "UTF-8 text".to_owned(), found }
        })?;
        Ok(SourceText { path: path.to_owned(), text })
    }

    /// Hash of all files read and of the parameters given; and the files.
    pub fn summary(self, defines: &[(String, String)]) -> (u64, Vec<PathBuf>) {
        let digests = self.digests.into_inner().expect("no holder of this lock panics");
        let mut all = Vec::new();
        let mut put = |text: &[u8]| {
            all.extend((text.len() as u64).to_le_bytes());
            all.extend(text);
        };
        let mut defines: Vec<_> = defines.iter().collect();
        defines.sort();
        for (name, value) in defines {
            put(name.as_bytes());
            put(value.as_bytes());
        }
        // What lies outside the scene's folder goes by its bare name, so that the hash is the same on any machine.
        let bare = |path: &Path| path.file_name().map(PathBuf::from).unwrap_or_default();
        let name = |path: &Path| path.strip_prefix(&self.root).map_or_else(|_| bare(path), Path::to_owned);
        let mut named: Vec<_> = digests.iter().map(|(path, digest)| (name(path), *digest)).collect();
        named.sort();
        for (name, digest) in named {
            put(name.as_os_str().as_encoded_bytes());
            put(&digest.to_le_bytes());
        }
        (digest(&all), digests.into_keys().collect())
    }
}

/// The path without links, if there is such a file or folder.
pub(super) fn canonical(path: &Path) -> Result<PathBuf, LoadErrorKind> {
    path.canonicalize().map_err(|e| LoadErrorKind::Unreadable { path: path.into(), reason: e.to_string() })
}

/// 64-bit digest over words of eight bytes by folded multiplication (as in wyhash). Against accidents, not against intent.
pub(super) fn digest(bytes: &[u8]) -> u64 {
    let step = |h: u64, word: u64| {
        // The odd number nearest to 2^64 over the golden ratio: its bits have no pattern.
        let product = u128::from(h ^ word) * 0x9e37_79b9_7f4a_7c15;
        (product as u64) ^ ((product >> 64) as u64)
    };
    let (words, rest) = bytes.as_chunks::<8>();
    let mut h = words.iter().fold(0xcbf2_9ce4_8422_2325_u64, |h, w| step(h, u64::from_le_bytes(*w)));
    let mut tail = [0; 8];
    tail[..rest.len()].copy_from_slice(rest);
    h = step(h, u64::from_le_bytes(tail));
    step(step(h, bytes.len() as u64), 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_changed_bit_or_byte_changes_the_digest() {
        let base: Vec<u8> = (0..40).collect();
        let mut seen = vec![digest(&base), digest(&base[..39]), digest(&[])];
        for i in 0..base.len() * 8 {
            let mut other = base.clone();
            other[i / 8] ^= 1 << (i % 8);
            seen.push(digest(&other));
        }
        let n = seen.len();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), n);
    }
}
