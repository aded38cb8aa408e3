//! Wavefront OBJ by tobj: `v`, `vt`, `vn`, `f`, and on request `usemtl` and `mtllib`; all else (groups, lines) is passed over.
//!
//! tobj's errors carry no line, and it takes faces without area or numbers that are not finite; so each line is looked at first. It
//! also makes a mesh of each group, and expects all faces of a mesh to have the same attributes; a file with groups, materials or mixed
//! faces is therefore written anew, its faces sorted by material and by what they have. Vertices are shared by equal triples of indices; negative indices count
//! back from the line they stand on. Texture coordinates are flipped vertically on request, because images have their first row at
//! the top.

use super::error::{LoadErrorKind, short};
use super::mesh::{MeshFault, RawMesh};
use crate::math::{DVec3, Vec2};
use std::borrow::Cow;
use std::fmt::Write;

/// Largest number of elements that u32 indices can name.
const NONE: u32 = u32::MAX;

/// Longest line in bytes; a polygon of 65,536 corners with three indices of six digits each has fewer.
const MAX_LINE: usize = 2 << 20;

/// Most corners of a face.
const MAX_CORNERS: usize = 65_536;

/// Faces of one material.
#[derive(Debug, Default)]
pub(super) struct Part {
    /// Name after `usemtl`; empty before the first.
    pub material: String,
    /// Byte offset of the line that names it first.
    pub offset: usize,
    pub mesh: RawMesh,
}

/// An OBJ file with its materials' names.
#[derive(Debug, Default)]
pub(super) struct Wavefront {
    /// Name of each `mtllib` and the byte offset of its line.
    pub libraries: Vec<(String, usize)>,
    /// Parts with faces, in the order in which their materials are named.
    pub parts: Vec<Part>,
}

/// Reads an OBJ file as one mesh.
pub(super) fn parse(bytes: &[u8], flip_v: bool) -> Result<RawMesh, MeshFault> {
    let mut parts = read(bytes, flip_v, false)?.parts;
    Ok(parts.pop().map(|part| part.mesh).unwrap_or_default())
}

/// Reads an OBJ file as one mesh a material.
pub(super) fn parse_by_material(bytes: &[u8], flip_v: bool) -> Result<Wavefront, MeshFault> {
    read(bytes, flip_v, true)
}

fn read(bytes: &[u8], flip_v: bool, by_material: bool) -> Result<Wavefront, MeshFault> {
    // A byte order mark would hide the first statement.
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mark = bytes.len() - text.len();
    let scan = Scan::of(text, by_material)
        .map_err(|fault| MeshFault { offset: fault.offset.map(|offset| offset + mark), kind: fault.kind })?;
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ..tobj::LoadOptions::default() };
    let no_materials = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut scan.text(text).as_ref(), &options, no_materials)
        .map_err(|error| MeshFault::new(None, "an OBJ file", error.to_string()))?;
    let part_of = |model: &tobj::Model| part_of_group(&model.name).filter(|_| scan.parts.len() > 1).unwrap_or(0);
    let parts = scan.parts.iter().enumerate().map(|(index, part)| Part {
        material: part.material.clone(),
        offset: part.offset + mark,
        mesh: join(models.iter().filter(|model| part_of(model) == index), flip_v),
    });
    let parts = parts.filter(|part| !part.mesh.triangles.is_empty() || !by_material).collect();
    let libraries = scan.libraries.iter().map(|(name, offset)| (name.clone(), offset + mark)).collect();
    Ok(Wavefront { libraries, parts })
}

/// One mesh of some models; an attribute that some vertices lack is zero there.
fn join<'m>(models: impl Iterator<Item = &'m tobj::Model> + Clone, flip_v: bool) -> RawMesh {
    let mut mesh = RawMesh::default();
    let has_normals = models.clone().any(|m| !m.mesh.normals.is_empty());
    let has_uvs = models.clone().any(|m| !m.mesh.texcoords.is_empty());
    for tobj::Model { mesh: part, .. } in models {
        let base = mesh.positions.len() as u32;
        let vectors = |values: &[f64]| values.chunks_exact(3).map(|v| DVec3::new(v[0], v[1], v[2])).collect::<Vec<_>>();
        mesh.positions.extend(vectors(&part.positions));
        let count = mesh.positions.len();
        if has_normals {
            mesh.normals.extend(vectors(&part.normals));
            mesh.normals.resize(count, DVec3::ZERO);
        }
        if has_uvs {
            let v = |v: f64| if flip_v { 1.0 - v } else { v };
            mesh.uvs.extend(part.texcoords.chunks_exact(2).map(|t| Vec2::new(t[0] as f32, v(t[1]) as f32)));
            mesh.uvs.resize(count, Vec2::ZERO);
        }
        mesh.triangles.extend(part.indices.chunks_exact(3).map(|t| [t[0] + base, t[1] + base, t[2] + base]));
    }
    mesh
}

/// What is wrong with a line.
struct Fault {
    expected: String,
    found: String,
}

impl Fault {
    fn new(expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self { expected: expected.into(), found: found.into() }
    }
}

/// Corner of a face by indices from 0.
#[derive(Clone, Copy, PartialEq)]
struct Corner {
    position: u32,
    uv: Option<u32>,
    normal: Option<u32>,
}

impl Corner {
    /// Which attributes it has: an index below four.
    fn class(self) -> usize {
        usize::from(self.uv.is_some()) + 2 * usize::from(self.normal.is_some())
    }
}

/// What a look at every line found.
#[derive(Default)]
struct Scan {
    positions: usize,
    uvs: usize,
    normals: usize,
    /// Statements that make tobj begin a new mesh occur, or bytes that are not ASCII.
    has_more: bool,
    parts: Vec<PartScan>,
    /// Part that faces go to.
    current: usize,
    libraries: Vec<(String, usize)>,
    by_material: bool,
    face: Vec<Corner>,
}

/// The faces of one material as they were written.
#[derive(Default)]
struct PartScan {
    material: String,
    offset: usize,
    /// With plain indices, by the attributes that the faces have.
    faces: [String; 4],
}

impl Scan {
    fn of(bytes: &[u8], by_material: bool) -> Result<Self, MeshFault> {
        let mut scan = Self { by_material, parts: vec![PartScan::default()], ..Self::default() };
        let mut offset = 0;
        for (index, line) in bytes.split(|b| *b == b'\n').enumerate() {
            let over = |what: &str, limit, found| {
                let what = format!("{what} line {}", index + 1);
                let (limit, found) = (limit as u64, found as u64);
                Err(MeshFault { offset: Some(offset), kind: LoadErrorKind::OverLimit { what, limit, found } })
            };
            if line.len() > MAX_LINE {
                return over("bytes of", MAX_LINE, line.len());
            }
            scan.line(line, offset).map_err(|fault| {
                let found = format!("line {}: {}", index + 1, fault.found);
                MeshFault::new(Some(offset), fault.expected, found)
            })?;
            if scan.face.len() > MAX_CORNERS {
                return over("corners of the face in", MAX_CORNERS, scan.face.len());
            }
            offset += line.len() + 1;
        }
        if scan.positions == 0 && scan.parts.iter().flat_map(|p| &p.faces).all(String::is_empty) {
            return Err(MeshFault::new(None, "an OBJ file", "no vertex and no face"));
        }
        Ok(scan)
    }

    fn line(&mut self, line: &[u8], offset: usize) -> Result<(), Fault> {
        // tobj wants UTF-8 in comments, too.
        self.has_more |= !line.is_ascii();
        let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
        match words.next() {
            Some(b"v") => {
                numbers(&mut words, 3)?;
                self.positions += 1;
            }
            Some(b"vt") => {
                numbers(&mut words, 2)?;
                self.uvs += 1;
            }
            Some(b"vn") => {
                numbers(&mut words, 3)?;
                self.normals += 1;
            }
            Some(b"f") => self.face(words)?,
            Some(b"usemtl") if self.by_material => self.use_material(rest_of(line, b"usemtl"), offset),
            Some(b"mtllib") if self.by_material => {
                self.has_more = true;
                self.libraries.push((rest_of(line, b"mtllib"), offset));
            }
            None => {}
            Some(word) if word.starts_with(b"#") => {}
            // Whatever else there is, tobj need not see it.
            Some(_) => self.has_more = true,
        }
        Ok(())
    }

    fn use_material(&mut self, material: String, offset: usize) {
        self.has_more = true;
        self.current = self.parts.iter().position(|part| part.material == material).unwrap_or_else(|| {
            self.parts.push(PartScan { material, offset, ..PartScan::default() });
            self.parts.len() - 1
        });
    }

    fn face<'w>(&mut self, words: impl Iterator<Item = &'w [u8]>) -> Result<(), Fault> {
        let mut face = std::mem::take(&mut self.face);
        face.clear();
        for word in words {
            face.push(self.corner(word)?);
        }
        if face.len() < 3 {
            return Err(Fault::new("a face of three vertices or more", format!("{} of them", face.len())));
        }
        let class = face[0].class();
        if face.iter().any(|c| c.class() != class) {
            return Err(Fault::new("a face whose corners all have the same attributes", "a mixture of them"));
        }
        let text = &mut self.parts[self.current].faces[class];
        text.push('f');
        for corner in &face {
            // Writing to a string cannot fail.
            let _ = match (corner.uv, corner.normal) {
                (None, None) => write!(text, " {}", corner.position + 1),
                (Some(uv), None) => write!(text, " {}/{}", corner.position + 1, uv + 1),
                (None, Some(n)) => write!(text, " {}//{}", corner.position + 1, n + 1),
                (Some(uv), Some(n)) => write!(text, " {}/{}/{}", corner.position + 1, uv + 1, n + 1),
            };
        }
        text.push('\n');
        self.face = face;
        Ok(())
    }

    /// One corner `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, word: &[u8]) -> Result<Corner, Fault> {
        let mut parts = word.split(|b| *b == b'/');
        let position = index(parts.next().unwrap_or_default(), self.positions, "vertex", word)?;
        let mut optional = |count, what| match parts.next() {
            None | Some(b"") => Ok(None),
            Some(part) => index(part, count, what, word).map(Some),
        };
        let uv = optional(self.uvs, "texture coordinate")?;
        let normal = optional(self.normals, "normal")?;
        if parts.next().is_some() {
            return Err(Fault::new("v/vt/vn", text(word)));
        }
        Ok(Corner { position, uv, normal })
    }

    /// The file as tobj is to see it: unchanged if all faces are alike and nothing divides them.
    fn text<'b>(&self, bytes: &'b [u8]) -> Cow<'b, [u8]> {
        let faces =
            || self.parts.iter().enumerate().flat_map(|(i, p)| p.faces.iter().enumerate().map(move |(class, f)| (i, class, f)));
        let kinds = faces().filter(|(.., f)| !f.is_empty()).count();
        if !self.has_more && kinds <= 1 {
            return Cow::Borrowed(bytes);
        }
        let is_vertex = |line: &&[u8]| line.trim_ascii_start().first() == Some(&b'v');
        let mut written = Vec::with_capacity(bytes.len());
        for line in bytes.split(|b| *b == b'\n').filter(is_vertex) {
            written.extend_from_slice(String::from_utf8_lossy(line).as_bytes());
            written.push(b'\n');
        }
        for (part, class, faces) in faces().filter(|(.., f)| !f.is_empty()) {
            written.extend_from_slice(format!("g {part}_{class}\n{faces}").as_bytes());
        }
        Cow::Owned(written)
    }
}

/// The part that a group written by [`Scan::text`] belongs to.
fn part_of_group(name: &str) -> Option<usize> {
    name.split('_').next()?.parse().ok()
}

/// What stands behind the first word of a line: a name, which may contain spaces.
fn rest_of(line: &[u8], word: &[u8]) -> String {
    let line = line.trim_ascii();
    String::from_utf8_lossy(line.strip_prefix(word).unwrap_or(line).trim_ascii()).into_owned()
}

/// Up to three finite numbers, at least `needed` of them; the rest are 0.
fn numbers<'w>(words: &mut impl Iterator<Item = &'w [u8]>, needed: usize) -> Result<[f64; 3], Fault> {
    let mut values = [0.0; 3];
    for (i, value) in values.iter_mut().enumerate() {
        let Some(word) = words.next() else {
            if i >= needed {
                break;
            }
            return Err(Fault::new(format!("{needed} numbers"), format!("{i} of them")));
        };
        let number = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok()).filter(|v: &f64| v.is_finite());
        *value = number.ok_or_else(|| Fault::new("a finite number", text(word)))?;
    }
    Ok(values)
}

/// Index into a list of `count` from one as written: from 1 up, or from -1 down for the last one.
fn index(part: &[u8], count: usize, what: &str, word: &[u8]) -> Result<u32, Fault> {
    let number = std::str::from_utf8(part).ok().and_then(|p| p.parse::<i128>().ok());
    let number = number.ok_or_else(|| Fault::new("indices such as 1, 1/2, 1//3 or 1/2/3", text(word)))?;
    let count = count as i128;
    let index = if number > 0 { number - 1 } else { count + number };
    if number == 0 || index < 0 || index >= count || index >= i128::from(NONE) {
        return Err(Fault::new(
            format!("a {what} from 1 to {count}, or from -{count} to -1"),
            format!("{what} {number} of {count}"),
        ));
    }
    Ok(index as u32)
}

fn text(word: &[u8]) -> String {
    format!("\"{}\"", short(&String::from_utf8_lossy(word)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    fn read(text: &str) -> RawMesh {
        parse(text.as_bytes(), true).expect("valid")
    }

    fn fault(text: &str) -> (Option<usize>, String) {
        let fault = parse(text.as_bytes(), true).expect_err("must be refused");
        (fault.offset, fault.kind.to_string())
    }

    #[test]
    fn negative_indices_count_back_from_their_line() {
        let mesh = read(&format!("{SQUARE}f -4 -3 -2\nv 5 5 5\nf -1 1 2\n"));
        let corners: Vec<_> = mesh.triangles.iter().map(|t| t.map(|i| mesh.positions[i as usize])).collect();
        assert_eq!(corners[0], [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0)]);
        assert_eq!(corners[1][0], DVec3::splat(5.0));
    }

    #[test]
    fn vertices_are_shared_by_equal_triples() {
        let mesh = read(&format!("{SQUARE}vt 0 0\nvt 1 .25\nf 1/1 2/1 3/1\nf 1/1 3/2 4/1\r\n"));
        assert_eq!(mesh.positions.len(), 5, "vertex 3 occurs with two texture coordinates, vertex 1 with one");
        assert_eq!(mesh.uvs[3], Vec2::new(1.0, 0.75), "v is flipped");
        assert!(mesh.normals.is_empty());
    }

    #[test]
    fn polygons_become_fans_and_other_statements_are_passed_over() {
        let mesh = read(&format!("# x\nmtllib a.mtl\no a\n{SQUARE}vn 0 0 1\ng b\nusemtl c\ns 1\nf 1//1 2//1 3//1 4//1\nl 1 2\n"));
        assert_eq!(mesh.triangles, vec![[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.normals, vec![DVec3::Z; 4]);
    }

    #[test]
    fn faces_with_different_attributes_keep_their_own() {
        let mesh = read(&format!("{SQUARE}vt .5 .25\nvn 0 0 1\nf 1/1 2/1 3/1\ng b\nf 1//1 3//1 4//1\n"));
        assert_eq!((mesh.positions.len(), mesh.uvs.len(), mesh.normals.len()), (6, 6, 6));
        let corner = |triangle: usize, k: usize| mesh.triangles[triangle][k] as usize;
        assert_eq!((mesh.uvs[corner(0, 0)], mesh.normals[corner(0, 0)]), (Vec2::new(0.5, 0.75), DVec3::ZERO));
        assert_eq!((mesh.uvs[corner(1, 2)], mesh.normals[corner(1, 2)]), (Vec2::ZERO, DVec3::Z));
        assert_eq!(mesh.positions[corner(1, 2)], DVec3::Y);
    }

    #[test]
    fn faults_name_line_and_count() {
        for (face, part) in [
            ("f 1 2 0", "vertex 0 of 4"),
            ("f 1 2 99", "line 5: vertex 99 of 4"),
            ("f 1 2 -5", "vertex -5 of 4"),
            ("f 1 2 99999999999999999999", "vertex 99999999999999999999 of 4"),
            ("f 1 2 99999999999999999999999999999999999999999999", "expected indices"),
            ("f 1/1 2/1 3/1", "texture coordinate 1 of 0"),
            ("f 1//7 2 3", "normal 7 of 0"),
            ("f 1 2", "three vertices or more"),
            ("f 1///1 2 3", "v/vt/vn"),
            ("v nan 0 0", "finite"),
            ("v 1e400 0 0", "finite"),
            ("v 1 2", "3 numbers"),
            ("vt 1", "2 numbers"),
            ("f 1/1 2 3", "texture coordinate 1 of 0"),
        ] {
            let (offset, message) = fault(&format!("{SQUARE}{face}\n"));
            assert_eq!(offset, Some(SQUARE.len()), "{face}");
            assert!(message.contains(part), "{face}: {message}");
        }
        assert!(fault("hello").1.contains("OBJ"));
    }
}
