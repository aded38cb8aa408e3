//! Wavefront OBJ: `v`, `vt`, `vn`, `f`, and on request `usemtl` and `mtllib`; all else (groups, lines, smoothing) is passed over.
//!
//! One pass over the lines, each with its fault at hand. Vertices are shared by equal triples of indices; negative indices count back
//! from the line they stand on; an attribute that only some faces have is zero for the others. Texture coordinates are flipped
//! vertically on request, because images have their first row at the top.

use super::error::short;
use super::mesh::{MeshFault, RawMesh};
use crate::math::{DVec3, Vec2};
use ahash::AHashMap;

/// An index that no element has: the attribute is missing.
const NONE: u32 = u32::MAX;

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
    let mut parts = Reader::read(bytes, flip_v, false)?.parts;
    Ok(parts.pop().map(|part| part.mesh).unwrap_or_default())
}

/// Reads an OBJ file as one mesh a material.
pub(super) fn parse_by_material(bytes: &[u8], flip_v: bool) -> Result<Wavefront, MeshFault> {
    Reader::read(bytes, flip_v, true)
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

/// Corner of a face by indices from 0, or [`NONE`].
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Corner {
    position: u32,
    uv: u32,
    normal: u32,
    part: u32,
}

#[derive(Default)]
struct Reader {
    positions: Vec<DVec3>,
    uvs: Vec<Vec2>,
    normals: Vec<DVec3>,
    file: Wavefront,
    /// Part that faces go to.
    current: u32,
    /// Vertex of the part for each corner seen.
    vertices: AHashMap<Corner, u32>,
    flip_v: bool,
    by_material: bool,
}

impl Reader {
    fn read(bytes: &[u8], flip_v: bool, by_material: bool) -> Result<Wavefront, MeshFault> {
        let mut reader = Self { flip_v, by_material, ..Self::default() };
        reader.file.parts.push(Part::default());
        let mut offset = 0;
        for (index, line) in bytes.split(|b| *b == b'\n').enumerate() {
            reader.line(line, offset).map_err(|fault| {
                let found = format!("line {}: {}", index + 1, fault.found);
                MeshFault::new(Some(offset), fault.expected, found)
            })?;
            offset += line.len() + 1;
        }
        let Self { mut file, positions, .. } = reader;
        file.parts.retain(|part| !part.mesh.triangles.is_empty());
        if positions.is_empty() && file.parts.is_empty() {
            return Err(MeshFault::new(None, "an OBJ file", "no vertex and no face"));
        }
        for part in &mut file.parts {
            let mesh = &mut part.mesh;
            // None of the part's faces has the attribute.
            if mesh.normals.iter().all(|n| *n == DVec3::ZERO) {
                mesh.normals = Vec::new();
            }
            if mesh.uvs.iter().all(|t| t.is_nan()) {
                mesh.uvs = Vec::new();
            }
            mesh.uvs.iter_mut().filter(|t| t.is_nan()).for_each(|t| *t = Vec2::ZERO);
        }
        Ok(file)
    }

    fn line(&mut self, line: &[u8], offset: usize) -> Result<(), Fault> {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
        match words.next() {
            Some(b"v") => self.positions.push(DVec3::from(numbers(&mut words, 3)?)),
            Some(b"vt") => {
                let [u, v, _] = numbers(&mut words, 2)?;
                self.uvs.push(Vec2::new(u as f32, if self.flip_v { 1.0 - v } else { v } as f32));
            }
            Some(b"vn") => self.normals.push(DVec3::from(numbers(&mut words, 3)?)),
            Some(b"f") => self.face(words)?,
            Some(b"usemtl") if self.by_material => self.use_material(&rest_of(line, b"usemtl"), offset),
            Some(b"mtllib") if self.by_material => self.file.libraries.push((rest_of(line, b"mtllib"), offset)),
            _ => {}
        }
        Ok(())
    }

    fn use_material(&mut self, name: &str, offset: usize) {
        let known = self.file.parts.iter().position(|p| p.material == name);
        let index = known.unwrap_or_else(|| {
            self.file.parts.push(Part { material: name.to_owned(), offset, mesh: RawMesh::default() });
            self.file.parts.len() - 1
        });
        self.current = index as u32;
    }

    fn face<'w>(&mut self, words: impl Iterator<Item = &'w [u8]>) -> Result<(), Fault> {
        let (mut count, mut first, mut last) = (0, 0, 0);
        let mut attributes = (false, false);
        for word in words {
            let corner = self.corner(word)?;
            let has = (corner.uv != NONE, corner.normal != NONE);
            if count > 0 && has != attributes {
                return Err(Fault::new("a face whose corners all have the same attributes", "a mixture of them"));
            }
            attributes = has;
            let vertex = self.vertex(corner)?;
            // A fan from the first corner, as Mitsuba makes it.
            match count {
                0 => first = vertex,
                1 => {}
                _ => self.file.parts[self.current as usize].mesh.triangles.push([first, last, vertex]),
            }
            last = vertex;
            count += 1;
        }
        if count < 3 {
            return Err(Fault::new("a face of three vertices or more", format!("{count} of them")));
        }
        Ok(())
    }

    /// Index of the vertex that a corner stands for.
    fn vertex(&mut self, corner: Corner) -> Result<u32, Fault> {
        let mesh = &mut self.file.parts[self.current as usize].mesh;
        let next = mesh.positions.len();
        if next >= NONE as usize {
            return Err(Fault::new(format!("fewer than {NONE} vertices"), "one more"));
        }
        let index = *self.vertices.entry(corner).or_insert(next as u32);
        if index as usize == next {
            mesh.positions.push(self.positions[corner.position as usize]);
            mesh.normals.push(self.normals.get(corner.normal as usize).copied().unwrap_or(DVec3::ZERO));
            mesh.uvs.push(self.uvs.get(corner.uv as usize).copied().unwrap_or(Vec2::NAN));
        }
        Ok(index)
    }

    /// One corner `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, word: &[u8]) -> Result<Corner, Fault> {
        let mut parts = word.split(|b| *b == b'/');
        let position = index(parts.next().unwrap_or_default(), self.positions.len(), "vertex", word)?;
        let mut optional = |count, what| match parts.next() {
            None | Some(b"") => Ok(NONE),
            Some(part) => index(part, count, what, word),
        };
        let uv = optional(self.uvs.len(), "texture coordinate")?;
        let normal = optional(self.normals.len(), "normal")?;
        if parts.next().is_some() {
            return Err(Fault::new("v/vt/vn", text(word)));
        }
        Ok(Corner { position, uv, normal, part: self.current })
    }
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
    let digits = std::str::from_utf8(part).unwrap_or_default();
    // Numbers of 20 digits are still told as such.
    let number = match digits.parse::<i64>() {
        Ok(number) => i128::from(number),
        Err(_) => digits.parse().map_err(|_| Fault::new("indices such as 1, 1/2, 1//3 or 1/2/3", text(word)))?,
    };
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
