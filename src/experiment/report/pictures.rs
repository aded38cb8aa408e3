//! Which pictures the page carries, within a bound on its size.

use super::encode::{half_floats, packed, reduced};
use crate::experiment::{Outcome, Row, SceneRecord, Status};
use crate::film::{Image, io::read_exr};
use crate::metrics::flip;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Most pixels of an embedded picture; larger ones are reduced.
const MAX_PIXELS: usize = 1 << 19;

/// Bytes of all embedded pictures, as base64: a page that browsers open without trouble and mail programs still take.
const MAX_BYTES: usize = 56_000_000;

/// Most pictures of one method in one scene: the last and earlier ones at geometric times.
const MAX_PER_METHOD: usize = 6;

/// A picture inside the page.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Picture {
    /// Scene by name.
    pub scene: String,
    /// Index of its row among all rows; `None` for the reference.
    pub row: Option<usize>,
    /// Pixels as embedded.
    pub width: usize,
    /// Pixels as embedded.
    pub height: usize,
    /// Pixels as rendered.
    pub full_width: usize,
    /// Pixels as rendered.
    pub full_height: usize,
    /// Whether there is a FLIP map.
    pub has_flip: bool,
    /// [`half_floats`].
    #[serde(skip)]
    pub data: String,
    /// LDR-FLIP against the reference, 255 times its root a pixel, [`packed`]; empty if there is none of its size.
    #[serde(skip)]
    pub flip: String,
}

/// The pictures of a page.
#[derive(Debug, Default)]
pub struct Gallery {
    /// Those embedded: by scene, the reference first.
    pub pictures: Vec<Picture>,
    /// What was left out and why, a line each.
    pub left_out: Vec<String>,
}

/// Reads and embeds pictures: all references first, then round by round the last picture of each method, the one before ...
///
/// A picture that cannot be read is left out with the reader's message.
pub fn gather(outcome: &Outcome, folder: &Path) -> Gallery {
    let mut gallery = Gallery::default();
    let mut room = MAX_BYTES;
    let mut references: BTreeMap<&str, Image> = BTreeMap::new();
    for scene in &outcome.scenes {
        match reference(scene, folder) {
            Ok(Some(image)) => {
                add(&mut gallery, &mut room, (&scene.name, None), &image, None);
                references.insert(&scene.name, image);
            }
            Ok(None) => {}
            Err(message) => gallery.left_out.push(message),
        }
    }
    let (wanted, thinned) = choose(&outcome.rows);
    let mut no_room = 0;
    let known = |row: &Row| outcome.scenes.iter().any(|s| s.name == row.scene);
    for index in wanted.into_iter().filter(|&i| known(&outcome.rows[i])) {
        let row = &outcome.rows[index];
        match read_exr(&folder.join(&row.image)) {
            // Neighbours in size are alike in bytes; a picture that does not fit may be followed by a smaller one that does.
            Ok(image) if least_bytes(&image) <= room => {
                let reference = references.get(row.scene.as_str());
                add(&mut gallery, &mut room, (&row.scene, Some(index)), &image, reference);
            }
            Ok(_) => no_room += 1,
            Err(error) => gallery.left_out.push(format!("{} of {} in {}: {error}", row.budget, row.method, row.scene)),
        }
    }
    if thinned > 0 {
        let text =
            "other seeds, repeats and times: the viewer keeps the first seed, and of each method the last picture and earlier";
        gallery.left_out.push(format!("{thinned} pictures of {text} ones at geometric steps"));
    }
    if no_room > 0 {
        gallery.left_out.push(format!("{no_room} pictures: the page is limited to {} MB of them", MAX_BYTES / 1_000_000));
    }
    let order = |p: &Picture| (outcome.scenes.iter().position(|s| s.name == p.scene), p.row.map(|r| r + 1));
    gallery.pictures.sort_by_key(order);
    gallery
}

/// Deflate rarely makes more than a third of noisy half floats go away.
fn least_bytes(image: &Image) -> usize {
    let pixels = (image.width() * image.height()).min(MAX_PIXELS);
    pixels * 7 * 4 / 3
}

/// The FLIP map as a picture is embedded: reduced like it, the root of each value as a byte, so that small ones keep their digits.
fn flip_bytes(image: &Image, reference: &Image) -> Vec<u8> {
    let map = flip::ldr_map(image, reference);
    let grey = Image::from_pixels(image.width(), image.height(), map.values().iter().map(|&v| [v; 3]).collect());
    reduced(&grey, MAX_PIXELS).pixels().iter().map(|p| (255.0 * p[0].sqrt()).round() as u8).collect()
}

/// Embeds a picture of (scene, row).
fn add(gallery: &mut Gallery, room: &mut usize, of: (&str, Option<usize>), image: &Image, reference: Option<&Image>) {
    let small = reduced(image, MAX_PIXELS);
    let size = |i: &Image| (i.width(), i.height());
    let flip = reference.filter(|r| size(r) == size(image)).map_or_else(String::new, |r| packed(&flip_bytes(image, r)));
    let data = half_floats(&small);
    *room = room.saturating_sub(data.len() + flip.len());
    let ((width, height), (full_width, full_height)) = (size(&small), size(image));
    let (scene, row, has_flip) = (of.0.to_owned(), of.1, !flip.is_empty());
    gallery.pictures.push(Picture { scene, row, width, height, full_width, full_height, has_flip, data, flip });
}

/// The mean of a scene's references.
fn reference(scene: &SceneRecord, folder: &Path) -> Result<Option<Image>, String> {
    let read = |name: &String| read_exr(&folder.join(name)).map_err(|e| format!("the reference of {}: {e}", scene.name));
    let images = scene.references.iter().filter(|n| !n.is_empty()).map(read).collect::<Result<Vec<_>, _>>()?;
    let Some(first) = images.first() else { return Ok(None) };
    if images.iter().any(|i| (i.width(), i.height()) != (first.width(), first.height())) {
        return Err(format!("the references of {} differ in size", scene.name));
    }
    let share = 1.0 / images.len() as f32;
    let mean = |i: usize| images.iter().fold([0.0; 3], |sum, m| std::array::from_fn(|c| sum[c] + share * m.pixels()[i][c]));
    let pixels = (0..first.pixels().len()).map(mean).collect();
    Ok(Some(Image::from_pixels(first.width(), first.height(), pixels)))
}

/// Indices of the rows whose pictures are wanted, most wanted first, and how many others have pictures.
fn choose(rows: &[Row]) -> (Vec<usize>, usize) {
    let mut by_method: BTreeMap<(&str, &str), Vec<usize>> = BTreeMap::new();
    let has_picture = |row: &Row| row.status == Status::Done && !row.image.is_empty();
    for (i, row) in rows.iter().enumerate().filter(|(_, r)| has_picture(r)) {
        by_method.entry((&row.scene, &row.method)).or_default().push(i);
    }
    let all: usize = by_method.values().map(Vec::len).sum();
    let chosen: Vec<Vec<usize>> = by_method.into_values().map(|indices| of_method(rows, indices)).collect();
    let rounds = (0..MAX_PER_METHOD).flat_map(|nth| chosen.iter().filter_map(move |c| c.get(nth).copied()));
    let wanted: Vec<usize> = rounds.collect();
    let thinned = all - wanted.len();
    (wanted, thinned)
}

/// Of one method in one scene: the first seed's pictures, the last first, then others at geometric steps of time.
fn of_method(rows: &[Row], mut indices: Vec<usize>) -> Vec<usize> {
    let Some(first) = indices.iter().map(|&i| (rows[i].repeat, rows[i].seed)).min() else { return Vec::new() };
    indices.retain(|&i| (rows[i].repeat, rows[i].seed) == first);
    indices.sort_by(|&i, &j| rows[j].cpu_s.total_cmp(&rows[i].cpu_s));
    let n = indices.len();
    if n <= MAX_PER_METHOD {
        return indices;
    }
    let [low, high] = [rows[indices[n - 1]].cpu_s.max(1e-9), rows[indices[0]].cpu_s.max(1e-9)];
    let step = (high / low).ln() / (MAX_PER_METHOD - 1) as f64;
    let mut kept: Vec<usize> = Vec::new();
    for nth in 0..MAX_PER_METHOD {
        let target = high.ln() - step * nth as f64;
        let distance = |i: usize| (rows[i].cpu_s.max(1e-9).ln() - target).abs();
        let free = indices.iter().copied().filter(|i| !kept.contains(i));
        kept.extend(free.min_by(|&i, &j| distance(i).total_cmp(&distance(j))));
    }
    kept
}
