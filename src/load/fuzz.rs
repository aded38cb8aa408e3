//! Each reader alone, on bytes in memory: for the fuzz targets in `tests/fuzz` and the law that replays their corpora.
//!
//! Not part of the library's interface.

use super::error::SourceText;
use super::files::Files;
use super::xml::Tree;
use super::{Limits, LoadOptions, load_scene, obj, picture, ply, serialized};
use std::path::Path;

/// Text between the files of [`scene`] and [`model`]: a line that begins so ends with the name of the file that follows.
pub const DIVIDER: &str = "==== ";

/// Limits under which no input of some hundred kilobytes may take 256 MB.
pub const LIMITS: Limits = Limits {
    depth: 256,
    attributes: 256,
    include_depth: 15,
    includes: 100,
    xml_bytes: 1 << 20,
    xml_nodes: 100_000,
    mesh_bytes: 1 << 20,
    image_bytes: 1 << 20,
    image_side: 65_535,
    image_pixels: 1 << 20,
    all_image_pixels: 1 << 21,
    triangles: 1 << 19,
    film_pixels: 1 << 20,
};

/// XML to objects with checked references; files that it includes do not exist. True if it is accepted.
pub fn xml(bytes: &[u8]) -> bool {
    let Ok(text) = String::from_utf8(bytes.to_vec()) else { return false };
    let files = Files::nowhere(LIMITS);
    let tree = Tree::of_text(&files, SourceText { path: "scene.xml".into(), text }, &[]);
    tree.is_ok_and(|tree| tree.index().is_ok())
}

/// An OBJ mesh. True if it is accepted.
pub fn obj(bytes: &[u8]) -> bool {
    obj::parse(bytes, true).is_ok()
}

/// A PLY mesh. True if it is accepted.
pub fn ply(bytes: &[u8]) -> bool {
    ply::parse(bytes).is_ok()
}

/// The first two meshes of a file in Mitsuba's serialized format. True if one is accepted.
pub fn serialized(bytes: &[u8]) -> bool {
    (0..2).any(|index| serialized::parse(bytes, index, &LIMITS).is_ok())
}

/// An image of any kind. True if it is accepted.
pub fn image(bytes: &[u8]) -> bool {
    picture::decode(bytes, Path::new("image"), false, &Files::nowhere(LIMITS)).is_ok()
}

/// A whole scene in XML with its files, written to `folder`: the text of scene.xml, and after each [`DIVIDER`] another file. True
/// if it is accepted.
///
/// # Panics
/// If `folder` cannot be written.
pub fn scene(bytes: &[u8], folder: &Path) -> bool {
    archive(bytes, folder, "scene.xml")
}

/// An OBJ as a whole scene with its libraries and images, written to `folder` as by [`scene`]. True if it is accepted.
///
/// # Panics
/// If `folder` cannot be written.
pub fn model(bytes: &[u8], folder: &Path) -> bool {
    archive(bytes, folder, "model.obj")
}

/// A glTF in JSON or binary by itself, written to `folder`. True if it is accepted.
///
/// # Panics
/// If `folder` cannot be written.
pub fn gltf(bytes: &[u8], folder: &Path) -> bool {
    std::fs::write(folder.join("model.gltf"), bytes).expect("the folder can be written");
    loads(&folder.join("model.gltf"))
}

fn archive(bytes: &[u8], folder: &Path, main: &str) -> bool {
    let mut rest = bytes;
    let mut name = Some(main.to_owned());
    let marker = format!("\n{DIVIDER}");
    while let Some(file) = name.take() {
        let end = rest.windows(marker.len()).position(|w| w == marker.as_bytes());
        std::fs::write(folder.join(file), &rest[..end.unwrap_or(rest.len())]).expect("the folder can be written");
        let Some(end) = end else { break };
        rest = &rest[end + marker.len()..];
        let line = rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
        let (head, tail) = rest.split_at(line);
        rest = tail.get(1..).unwrap_or_default();
        name = plain_name(head);
    }
    loads(&folder.join(main))
}

fn loads(main: &Path) -> bool {
    load_scene(main, &LoadOptions { limits: LIMITS, ..LoadOptions::default() }).is_ok()
}

/// A short file name without anything that leads out of a folder.
fn plain_name(bytes: &[u8]) -> Option<String> {
    let name = std::str::from_utf8(bytes).ok()?.trim();
    let plain = name.len() <= 20 && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'.');
    (plain && name.bytes().any(|b| b != b'.')).then(|| name.to_owned())
}
