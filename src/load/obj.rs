//! Wavefront OBJ: `v`, `vt`, `vn`, `f`; all else (groups, materials, lines) is passed over.
//!
//! Vertices are shared by equal triples of indices. Negative indices count back from the line they stand on. Texture
//! coordinates are flipped vertically on request, because images have their first row at the top.

use super::error::short;
use super::mesh::{MeshFault, RawMesh, fan};
use crate::math::{DVec3, Vec2};

/// No entry: an attribute that a corner does not have, or the end of a chain.
const NONE: u32 = u32::MAX;

/// Reads an OBJ file.
pub(super) fn parse(bytes: &[u8], flip_v: bool) -> Result<RawMesh, MeshFault> {
    let mut reader = Reader { flip_v, ..Reader::default() };
    let mut offset = 0;
    for (index, line) in bytes.split(|b| *b == b'\n').enumerate() {
        reader.line(line).map_err(|fault| {
            let found = format!("line {}: {}", index + 1, fault.found);
            MeshFault::new(Some(offset), fault.expected, found)
        })?;
        offset += line.len() + 1;
    }
    if !reader.is_obj {
        return Err(MeshFault::new(None, "an OBJ file", "no vertex and no face"));
    }
    Ok(reader.finish())
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

#[derive(Default)]
struct Reader {
    flip_v: bool,
    /// Something that only an OBJ file has was seen.
    is_obj: bool,
    positions: Vec<DVec3>,
    uvs: Vec<Vec2>,
    normals: Vec<DVec3>,
    /// First vertex made of each position; further ones follow by `Corner::next`.
    chains: Vec<u32>,
    /// The vertices made so far.
    corners: Vec<Corner>,
    triangles: Vec<[u32; 3]>,
    face: Vec<u32>,
}

struct Corner {
    position: u32,
    uv: u32,
    normal: u32,
    next: u32,
}

impl Reader {
    fn line(&mut self, line: &[u8]) -> Result<(), Fault> {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
        match words.next() {
            Some(b"v") => {
                let [x, y, z] = numbers(&mut words, 3)?;
                self.positions.push(DVec3::new(x, y, z));
                self.chains.push(NONE);
            }
            Some(b"vt") => {
                let [u, v, _] = numbers(&mut words.take(2), 1)?;
                self.uvs.push(Vec2::new(u as f32, if self.flip_v { 1.0 - v } else { v } as f32));
            }
            Some(b"vn") => {
                let [x, y, z] = numbers(&mut words, 3)?;
                self.normals.push(DVec3::new(x, y, z));
            }
            Some(b"f") => self.face(words)?,
            _ => return Ok(()),
        }
        self.is_obj = true;
        Ok(())
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
        self.triangles.extend(fan(&face));
        self.face = face;
        Ok(())
    }

    /// The vertex of one corner `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&mut self, word: &[u8]) -> Result<u32, Fault> {
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
        Ok(self.vertex(position, uv, normal))
    }

    fn vertex(&mut self, position: u32, uv: u32, normal: u32) -> u32 {
        let mut at = self.chains[position as usize];
        while at != NONE {
            let corner = &self.corners[at as usize];
            if (corner.uv, corner.normal) == (uv, normal) {
                return at;
            }
            at = corner.next;
        }
        let new = self.corners.len() as u32;
        let next = std::mem::replace(&mut self.chains[position as usize], new);
        self.corners.push(Corner { position, uv, normal, next });
        new
    }

    fn finish(self) -> RawMesh {
        let at = |list: &[DVec3], i: u32| list.get(i as usize).copied().unwrap_or(DVec3::ZERO);
        let corners = &self.corners;
        let positions = corners.iter().map(|c| self.positions[c.position as usize]).collect();
        let has_normals = corners.iter().any(|c| c.normal != NONE);
        let normals = if has_normals { corners.iter().map(|c| at(&self.normals, c.normal)).collect() } else { Vec::new() };
        let has_uvs = corners.iter().any(|c| c.uv != NONE);
        let uv = |c: &Corner| self.uvs.get(c.uv as usize).copied().unwrap_or(Vec2::ZERO);
        let uvs = if has_uvs { corners.iter().map(uv).collect() } else { Vec::new() };
        RawMesh { positions, normals, uvs, triangles: self.triangles }
    }
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
            ("vt", "1 numbers"),
        ] {
            let (offset, message) = fault(&format!("{SQUARE}{face}\n"));
            assert_eq!(offset, Some(SQUARE.len()), "{face}");
            assert!(message.contains(part), "{face}: {message}");
        }
        assert!(fault("hello").1.contains("OBJ"));
    }
}
