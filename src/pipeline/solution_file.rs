//! Pass one in a file: patches, form factors, direct light and solution, each with the key of what it depends on.
//!
//! The format, version 5. Numbers are little-endian.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `TWOPASS` and the byte 0x1a |
//! | 4 | version of the format |
//! | 4 | number of sections |
//! | sections | see below, one after the other, and then the file ends |
//!
//! | bytes of a section | what |
//! |---|---|
//! | 4 | tag: `META`, `PTCH`, `FORM`, `LAMP`, `SOLN`, in this order |
//! | 32 | key of the stage ([`StageKeys`]); zeros for `META` |
//! | 8 | length of the contents |
//! | length | the contents, in postcard's encoding of the types below |
//! | 32 | BLAKE3 of tag, key, length and contents |
//!
//! Links between groups of patches are kept as two runs of bytes: for each link the other group in 2 bytes, 3 from 65,537 groups on, 4 from
//! 16,777,217 on; and f32 transfers. Rooms that a solver has found in them are kept with them.
//!
//! `META`: [`Meta`]. `PTCH`: [`PatchMesh`]. `FORM`: ([`Stored`], [`Outside`]). `LAMP`: [`LampLight`], one for each lamp.
//! `SOLN`: ([`SolutionSummary`], [`LightGroup`], one for each group).

use super::direct::LampLight;
use super::keys::{Key, StageKeys};
use super::pass_one::{Kept, LightGroup, PassOne, PassOneSettings, SolutionSummary, Whole};
use crate::film::io::{WriteError, atomic_write};
use crate::form_factor::{Outside, Stored};
use crate::patch::PatchMesh;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

const MAGIC: [u8; 8] = *b"TWOPASS\x1a";
const VERSION: u32 = 6;
const TAGS: [&[u8; 4]; 5] = [b"META", b"PTCH", b"FORM", b"LAMP", b"SOLN"];

/// With what settings the file was made.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Settings of pass one.
    pub settings: PassOneSettings,
    /// Seed of pass one.
    pub seed: u64,
}

/// Why a solution cannot be read or used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {kind}", path.display())]
pub struct SolutionFileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub kind: SolutionFileFault,
}

/// What may be wrong with a solution.
#[derive(Debug, thiserror::Error)]
pub enum SolutionFileFault {
    /// The system's words.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// Something else.
    #[error("is no solution of this program (expected a file that `twopass solve -o` wrote)")]
    Foreign,
    /// Of another time.
    #[error("has version {0} of the format, expected {VERSION}: solve again into another file")]
    Version(u32),
    /// Too short.
    #[error("ends at byte {0}, in the middle: it was cut off")]
    Truncated(usize),
    /// Too long.
    #[error("goes on for {0} bytes after its end: it was damaged")]
    Trailing(usize),
    /// A checksum is wrong.
    #[error("is damaged: the checksum of its section {0} is wrong")]
    Damaged(String),
    /// The checksums are right, the contents make no sense.
    #[error("its section {0} does not fit the others")]
    Inconsistent(String),
    /// Of another scene.
    #[error("is of another scene: {0} changed since; solve again (`twopass solve SCENE -o` reuses what it can)")]
    Stale(&'static str),
}

/// A file that was read and whose checksums are right.
#[derive(Debug)]
pub struct SolutionFile {
    path: PathBuf,
    /// With what settings it was made.
    pub meta: Meta,
    bytes: Vec<u8>,
    sections: Vec<Section>,
}

/// Where a section is in the file.
#[derive(Debug)]
struct Section {
    key: Key,
    contents: Range<usize>,
    sum: [u8; 32],
}

impl SolutionFile {
    /// Reads a file.
    ///
    /// # Errors
    /// If it is not there, not whole, or not such a file.
    pub fn read(path: &Path) -> Result<Self, SolutionFileError> {
        let failed = |kind| SolutionFileError { path: path.to_owned(), kind };
        let bytes = std::fs::read(path).map_err(|error| failed(error.into()))?;
        let sections = parse(&bytes).map_err(failed)?;
        let meta = decode(&bytes[sections[0].contents.clone()], 0).map_err(failed)?;
        Ok(Self { path: path.to_owned(), meta, bytes, sections })
    }

    /// What of it still holds for a scene and settings with these keys, each stage by itself.
    ///
    /// # Errors
    /// If the contents do not fit each other.
    pub fn still_good(&self, keys: &StageKeys) -> Result<Kept, SolutionFileError> {
        let mut kept = Kept::default();
        let good = self.good(keys);
        if good[0] {
            let patches: PatchMesh = self.section(1)?;
            let n = patches.len();
            kept.patches = Some(patches);
            if good[1] {
                let (form_factors, outside): (Stored, Outside) = self.section(2)?;
                self.fits(2, crate::form_factor::FormFactors::len(&form_factors) == n && outside.fits(n))?;
                kept.form_factors = Some((form_factors, outside));
            }
            if good[2] {
                let lamps: Vec<LampLight> = self.section(3)?;
                self.fits(3, lamps.iter().all(|lamp| lamp.incident.len() == n))?;
                kept.lamps = Some(lamps);
            }
            if good.iter().all(|good| *good) {
                let solved: (SolutionSummary, Vec<LightGroup>) = self.section(4)?;
                let lamps = kept.lamps.as_ref().map_or(0, Vec::len);
                let whole = |g: &LightGroup| g.indirect.len() == n && (g.gathered.is_empty() || g.gathered.len() == n);
                self.fits(4, solved.1.iter().all(whole) && solved.1.iter().all(|g| g.shadow.is_none_or(|lamp| lamp < lamps)))?;
                kept.solved = Some(solved);
            }
        }
        Ok(kept)
    }

    /// All of it, for a scene with these keys.
    ///
    /// # Errors
    /// If anything has changed, or the contents do not fit each other.
    pub fn whole(&self, keys: &StageKeys) -> Result<Whole, SolutionFileError> {
        let what = ["its geometry", "what form factors depend on", "a light", "a light or a reflectance"];
        if let Some(stage) = self.good(keys).iter().position(|good| !good) {
            return Err(SolutionFileError { path: self.path.clone(), kind: SolutionFileFault::Stale(what[stage]) });
        }
        let Kept { patches, form_factors, lamps, solved, .. } = self.still_good(keys)?;
        let ((form_factors, outside), (summary, groups)) =
            form_factors.zip(solved).expect("every stage whose key holds is there");
        let (patches, lamps) = patches.zip(lamps).expect("every stage whose key holds is there");
        Ok(Whole { patches, form_factors, outside, lamps, summary, groups })
    }

    fn good(&self, keys: &StageKeys) -> [bool; 4] {
        let now = [keys.patches, keys.form_factors, keys.direct, keys.solution];
        std::array::from_fn(|stage| self.sections[stage + 1].key == now[stage])
    }

    fn section<'a, T: Deserialize<'a>>(&'a self, index: usize) -> Result<T, SolutionFileError> {
        decode(self.contents(index), index).map_err(|kind| SolutionFileError { path: self.path.clone(), kind })
    }

    fn contents(&self, index: usize) -> &[u8] {
        &self.bytes[self.sections[index].contents.clone()]
    }

    fn fits(&self, index: usize, fits: bool) -> Result<(), SolutionFileError> {
        let kind = || SolutionFileFault::Inconsistent(name(index));
        if fits { Ok(()) } else { Err(SolutionFileError { path: self.path.clone(), kind: kind() }) }
    }
}

/// Writes a solution, whole or not at all. Stages that `old` holds with the same key are copied as they are.
///
/// # Errors
/// If it cannot be written.
pub fn write(
    path: &Path,
    meta: Meta,
    keys: &StageKeys,
    pass_one: &PassOne,
    old: Option<&SolutionFile>,
) -> Result<(), WriteError> {
    let keys = [[0; 32], keys.patches, keys.form_factors, keys.direct, keys.solution];
    let field = &pass_one.field;
    let contents = |index: usize| -> Vec<u8> {
        match index {
            0 => encode(&meta),
            1 => encode(&field.patches),
            2 => encode(&(&pass_one.form_factors, &pass_one.outside)),
            3 => encode(&pass_one.lamps),
            _ => encode(&(SolutionSummary::from(&pass_one.solution), &pass_one.groups)),
        }
    };
    atomic_write(path, |file| {
        file.write_all(&MAGIC)?;
        file.write_all(&VERSION.to_le_bytes())?;
        file.write_all(&(TAGS.len() as u32).to_le_bytes())?;
        for (index, key) in keys.iter().enumerate() {
            // Lamps are kept for any strength, so the strengths in the file may be older ones; reflectances are part of the patches.
            if let Some(old) = old.filter(|old| index == 2 && old.sections[index].key == *key) {
                // Its checksum was verified when it was read.
                let (contents, sum) = (old.contents(index), &old.sections[index].sum);
                for part in [&TAGS[index][..], key, &(contents.len() as u64).to_le_bytes(), contents, sum] {
                    file.write_all(part)?;
                }
                continue;
            }
            let contents = contents(index);
            let length = (contents.len() as u64).to_le_bytes();
            let mut hash = blake3::Hasher::new();
            for part in [&TAGS[index][..], key, &length, &contents] {
                hash.update(part);
                file.write_all(part)?;
            }
            file.write_all(hash.finalize().as_bytes())?;
        }
        Ok(())
    })
}

fn name(index: usize) -> String {
    String::from_utf8_lossy(TAGS[index]).into_owned()
}

fn encode<T: Serialize>(value: &T) -> Vec<u8> {
    postcard::to_stdvec(value).expect("plain arrays and numbers always have an encoding")
}

fn decode<'a, T: Deserialize<'a>>(contents: &'a [u8], index: usize) -> Result<T, SolutionFileFault> {
    postcard::from_bytes(contents).map_err(|_| SolutionFileFault::Inconsistent(name(index)))
}

fn parse(bytes: &[u8]) -> Result<Vec<Section>, SolutionFileFault> {
    let mut reader = Reader { bytes, at: 0 };
    if bytes.len() < MAGIC.len() || bytes[..MAGIC.len()] != MAGIC {
        return Err(SolutionFileFault::Foreign);
    }
    reader.at = MAGIC.len();
    let version = u32::from_le_bytes(reader.array()?);
    if version != VERSION {
        return Err(SolutionFileFault::Version(version));
    }
    let count = u32::from_le_bytes(reader.array()?);
    if count as usize != TAGS.len() {
        return Err(SolutionFileFault::Foreign);
    }
    let mut sections = Vec::with_capacity(TAGS.len());
    for (index, tag) in TAGS.iter().enumerate() {
        let found: [u8; 4] = reader.array()?;
        let key: Key = reader.array()?;
        let length: [u8; 8] = reader.array()?;
        let contents = reader.take(usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX))?;
        let range = reader.at - contents.len()..reader.at;
        let sum: [u8; 32] = reader.array()?;
        let mut hash = blake3::Hasher::new();
        [&found[..], &key, &length, contents].into_iter().for_each(|part| {
            hash.update(part);
        });
        if *hash.finalize().as_bytes() != sum || found != **tag {
            return Err(SolutionFileFault::Damaged(name(index)));
        }
        sections.push(Section { key, contents: range, sum });
    }
    match bytes.len() - reader.at {
        0 => Ok(sections),
        left => Err(SolutionFileFault::Trailing(left)),
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], SolutionFileFault> {
        let end = self.at.checked_add(n).filter(|end| *end <= self.bytes.len());
        let end = end.ok_or(SolutionFileFault::Truncated(self.bytes.len()))?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], SolutionFileFault> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }
}
