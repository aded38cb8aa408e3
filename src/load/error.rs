//! What can be wrong with a scene file, where, and what was expected there.

use crate::scene::SceneError;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A place in a text file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Position {
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
    /// Bytes from the start of the file.
    pub offset: usize,
}

/// Why a scene could not be loaded.
#[derive(Debug, thiserror::Error)]
pub struct LoadError {
    /// File in which the fault lies.
    pub file: Box<Path>,
    /// Place in it; `None` when the file as a whole is at fault, or is binary.
    pub at: Option<Position>,
    /// What is wrong.
    pub kind: LoadErrorKind,
}

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.at {
            Some(at) => write!(f, "{}:{}:{}: {}", self.file.display(), at.line, at.column, self.kind),
            None => write!(f, "{}: {}", self.file.display(), self.kind),
        }
    }
}

/// The kinds of faults.
#[derive(Debug, thiserror::Error)]
pub enum LoadErrorKind {
    /// A file is missing or cannot be read.
    #[error("cannot read {}: {reason}", path.display())]
    Unreadable {
        /// Path that was tried.
        path: PathBuf,
        /// The system's words.
        reason: String,
    },
    /// Bytes that do not follow the file's format.
    #[error("expected {expected}, found {found}")]
    Malformed {
        /// What the format asks for.
        expected: String,
        /// What is there.
        found: String,
    },
    /// An XML element or attribute that has no meaning here.
    #[error("{found} has no meaning here{}", hint(near))]
    UnknownElement {
        /// The element or attribute.
        found: String,
        /// Names that are known.
        near: Vec<String>,
    },
    /// A `type` that is not known.
    #[error("unknown {class} \"{found}\"{}", hint(near))]
    UnknownPlugin {
        /// Kind of object.
        class: &'static str,
        /// Its type.
        found: String,
        /// Known types, nearest first.
        near: Vec<String>,
    },
    /// Something that is known but not supported.
    #[error("{what} is not supported")]
    Unsupported {
        /// The thing.
        what: String,
    },
    /// A property that nobody asked for.
    #[error("{owner} has no property \"{name}\"{}", hint(near))]
    UnusedProperty {
        /// Object that holds it.
        owner: String,
        /// Its name.
        name: String,
        /// Names that the object knows, nearest first.
        near: Vec<String>,
    },
    /// Something that must be given.
    #[error("{owner} needs {what}")]
    Missing {
        /// Object that lacks it.
        owner: String,
        /// What it lacks.
        what: String,
    },
    /// A value outside its range or of the wrong type.
    #[error("\"{name}\" must be {expected}, found {found}")]
    Value {
        /// Name of the property.
        name: String,
        /// What is allowed.
        expected: String,
        /// What was given.
        found: String,
    },
    /// A `$name` without a value.
    #[error("parameter \"${name}\" has no value: neither a <default> nor -D gives it one{}", hint(near))]
    UndefinedParameter {
        /// Its name.
        name: String,
        /// Parameters that have a value.
        near: Vec<String>,
    },
    /// A given parameter that the scene never uses.
    #[error("-D {name}: the scene has no such parameter{}", hint(near))]
    UnusedDefine {
        /// Its name.
        name: String,
        /// Parameters that the scene has.
        near: Vec<String>,
    },
    /// A reference to an id that no object has.
    #[error("no object has the id \"{id}\"{}", hint(near))]
    UnknownReference {
        /// The id.
        id: String,
        /// Ids that exist.
        near: Vec<String>,
    },
    /// An id given twice.
    #[error("the id \"{id}\" is given twice")]
    DuplicateId {
        /// The id.
        id: String,
    },
    /// Files or objects that contain themselves.
    #[error("{what} contains itself")]
    Cycle {
        /// File or object.
        what: String,
    },
    /// A path outside the folders that may be read.
    #[error("{} lies outside the scene's folder; allow its folder to read it", path.display())]
    PathNotAllowed {
        /// The path as written.
        path: PathBuf,
    },
    /// Over a limit on size, depth or count.
    #[error("{what}: {found} is over the limit of {limit}")]
    OverLimit {
        /// What was counted.
        what: String,
        /// Largest value allowed.
        limit: u64,
        /// Value found; a lower bound where counting stopped.
        found: u64,
    },
    /// Geometry that cannot be a scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// What the program does about a fault: its exit codes follow this.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The command line asks for something that the scene does not have.
    Usage,
    /// The input cannot be read or is invalid.
    Invalid,
    /// The input is over a limit.
    OverLimit,
}

impl LoadErrorKind {
    /// Who is at fault.
    pub fn fault(&self) -> Fault {
        match self {
            LoadErrorKind::UnusedDefine { .. } => Fault::Usage,
            LoadErrorKind::OverLimit { .. } => Fault::OverLimit,
            _ => Fault::Invalid,
        }
    }

    /// The error without a place inside `file`.
    pub(super) fn in_file(self, file: &Path) -> LoadError {
        LoadError { file: file.into(), at: None, kind: self }
    }
}

fn hint(near: &[String]) -> String {
    if near.is_empty() { String::new() } else { format!("; known: {}", near.join(", ")) }
}

/// A text file that was read.
#[derive(Debug)]
pub(super) struct SourceText {
    pub path: PathBuf,
    pub text: String,
}

/// A place in a [`SourceText`].
#[derive(Debug, Clone)]
pub(super) struct Place {
    pub source: Arc<SourceText>,
    pub offset: usize,
}

impl Place {
    /// The error `kind` at this place.
    pub fn error(&self, kind: LoadErrorKind) -> LoadError {
        LoadError { file: self.source.path.as_path().into(), at: Some(position(self.source.text.as_bytes(), self.offset)), kind }
    }
}

/// Line and column of a byte offset.
pub(super) fn position(text: &[u8], offset: usize) -> Position {
    let before = &text[..offset.min(text.len())];
    let line_start = before.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
    let line = 1 + before.iter().filter(|b| **b == b'\n').count() as u32;
    // A UTF-8 character has one byte that is not a continuation byte.
    let column = 1 + before[line_start..].iter().filter(|b| **b & 0xc0 != 0x80).count() as u32;
    Position { line, column, offset }
}

/// The names of `known` that are nearest to `name`, nearest first: those that a slip of the pen explains, or else all.
pub(super) fn near<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut ranked: Vec<(usize, &str)> = known.into_iter().map(|k| (edit_distance(name, k), k)).collect();
    ranked.sort();
    ranked.dedup();
    let slip = 1 + name.chars().count() / 3;
    let close = ranked.iter().filter(|(d, _)| *d <= slip).count();
    // Beyond a dozen names a list no longer helps.
    let shown = if close > 0 { close.min(5) } else { ranked.len().min(12) };
    ranked[..shown].iter().map(|(_, k)| (*k).to_owned()).collect()
}

/// Levenshtein's distance, by one row of the table. Long names are cut: only slips matter.
fn edit_distance(a: &str, b: &str) -> usize {
    let cut = |s: &str| s.chars().take(64).collect::<Vec<_>>();
    let (a, b) = (cut(a), cut(b));
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

/// At most the first 40 characters of `text`, for messages.
pub(super) fn short(text: &str) -> String {
    let mut cut: String = text.chars().take(40).collect();
    if cut.len() < text.len() {
        cut.push('…');
    }
    cut
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edit_distance_of_known_pairs() {
        for (a, b, want) in [("kitten", "sitting", 3), ("", "abc", 3), ("diffuse", "diffuse", 0), ("difuse", "diffuse", 1)] {
            assert_eq!(edit_distance(a, b), want, "{a}, {b}");
        }
    }

    #[test]
    fn positions_count_characters_not_bytes() {
        let text = "a\nüü<x>";
        let at = position(text.as_bytes(), text.find('<').expect("there"));
        assert_eq!((at.line, at.column, at.offset), (2, 3, 6));
    }
}
