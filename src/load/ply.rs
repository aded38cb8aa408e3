//! Stanford PLY: ascii and binary of both byte orders. Vertices with x y z, nx ny nz, and u v (or s t); faces as lists.
//!
//! Other properties and elements are read over. Counts are checked against the bytes that are left before anything is allocated.
//! Texture coordinates are not flipped.

use super::error::short;
use super::mesh::{MeshFault, RawMesh, fan};
use crate::math::{DVec3, Vec2};

type Result<T> = std::result::Result<T, MeshFault>;

/// Longest header; a real one has a few hundred bytes.
const MAX_HEADER: usize = 64 * 1024;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

#[derive(Debug)]
struct Property {
    name: String,
    /// Type of the length, for a list.
    list: Option<Scalar>,
    scalar: Scalar,
}

/// Reads a PLY file.
pub(super) fn parse(bytes: &[u8]) -> Result<RawMesh> {
    let (format, elements, body) = header(bytes)?;
    let mut reader = Reader { bytes, at: body, format };
    let mut mesh = RawMesh::default();
    let mut faces = Vec::new();
    for element in &elements {
        reader.check_count(element)?;
        match element.name.as_str() {
            "vertex" => reader.vertices(element, &mut mesh)?,
            "face" => reader.faces(element, mesh.positions.len(), &mut faces)?,
            _ => reader.skip(element)?,
        }
    }
    reader.end()?;
    let count = mesh.positions.len();
    if let Some((face, index)) = faces.iter().enumerate().find_map(|(i, t)| Some((i, *t.iter().find(|v| **v as usize >= count)?)))
    {
        let found = format!("vertex {index} in triangle {face}");
        return Err(MeshFault::new(None, format!("vertices from 0 to {}", count.saturating_sub(1)), found));
    }
    mesh.triangles = faces;
    Ok(mesh)
}

fn header(bytes: &[u8]) -> Result<(Format, Vec<Element>, usize)> {
    let mut at = 0;
    let mut line = || -> Result<(usize, &str)> {
        let rest = &bytes[at..];
        let end = rest.iter().take(MAX_HEADER).position(|b| *b == b'\n');
        let end = end.ok_or_else(|| MeshFault::new(None, "a PLY header that ends in end_header", "the end of the file"))?;
        let text =
            std::str::from_utf8(&rest[..end]).map_err(|_| MeshFault::new(None, "a PLY header", "bytes that are no text"))?;
        let start = at;
        at += end + 1;
        Ok((start, text.trim()))
    };
    let (_, magic) = line()?;
    if magic != "ply" {
        return Err(MeshFault::new(None, "a PLY file, which begins with the line \"ply\"", format!("\"{}\"", short(magic))));
    }
    let (mut format, mut elements) = (None, Vec::<Element>::new());
    loop {
        let (start, text) = line()?;
        let fault = |expected: &str| MeshFault::new(Some(start), expected, format!("\"{}\"", short(text)));
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["format", name, _version] => {
                format = Some(match *name {
                    "ascii" => Format::Ascii,
                    "binary_little_endian" => Format::LittleEndian,
                    "binary_big_endian" => Format::BigEndian,
                    _ => return Err(fault("format ascii, binary_little_endian or binary_big_endian")),
                });
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| fault("an element with its count"))?;
                elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
            }
            ["property", rest @ ..] => {
                let element = elements.last_mut().ok_or_else(|| fault("an element before its properties"))?;
                element.properties.push(property(rest).ok_or_else(|| fault("a property with a known type"))?);
            }
            ["end_header"] => {
                let format = format.ok_or_else(|| fault("a format before end_header"))?;
                return Ok((format, elements, at));
            }
            [] | ["comment" | "obj_info", ..] => {}
            _ => return Err(fault("a line of a PLY header")),
        }
    }
}

fn property(words: &[&str]) -> Option<Property> {
    match words {
        ["list", length, item, name] => {
            let list = Some(scalar(length)?).filter(|s| !matches!(s, Scalar::F32 | Scalar::F64))?;
            Some(Property { name: (*name).to_owned(), list: Some(list), scalar: scalar(item)? })
        }
        [item, name] => Some(Property { name: (*name).to_owned(), list: None, scalar: scalar(item)? }),
        _ => None,
    }
}

fn scalar(name: &str) -> Option<Scalar> {
    Some(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return None,
    })
}

impl Scalar {
    fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }
}

struct Reader<'b> {
    bytes: &'b [u8],
    at: usize,
    format: Format,
}

impl Reader<'_> {
    /// An error if the file cannot hold as many items as it claims.
    fn check_count(&self, element: &Element) -> Result<()> {
        let of = |p: &Property| match self.format {
            // A digit and a separator.
            Format::Ascii => 2,
            _ => p.list.unwrap_or(p.scalar).size(),
        };
        // The last number of a text file needs no separator.
        let left = self.bytes.len() - self.at + 1;
        let least = element.properties.iter().map(of).sum::<usize>().max(1);
        if element.count > left / least || element.count >= u32::MAX as usize {
            let found = format!("{} of them in {} bytes", element.count, left - 1);
            return Err(MeshFault::new(None, format!("as many items \"{}\" as the file can hold", element.name), found));
        }
        Ok(())
    }

    fn vertices(&mut self, element: &Element, mesh: &mut RawMesh) -> Result<()> {
        let find = |names: &[&str]| element.properties.iter().position(|p| p.list.is_none() && names.contains(&p.name.as_str()));
        let group = |sets: [&[&str]; 3]| Some([find(sets[0])?, find(sets[1])?, find(sets[2])?]);
        let position = group([&["x"], &["y"], &["z"]])
            .ok_or_else(|| MeshFault::new(None, "vertices with the properties x, y and z", "others"))?;
        let normal = group([&["nx"], &["ny"], &["nz"]]);
        let uv = find(&["u", "s", "texture_u"]).zip(find(&["v", "t", "texture_v"]));
        mesh.positions.reserve(element.count);
        let mut row = vec![0.0; element.properties.len()];
        for vertex in 0..element.count {
            let start = self.next();
            for (value, property) in row.iter_mut().zip(&element.properties) {
                *value = self.value_or_list(property, |_| {})?;
            }
            let point = |at: [usize; 3]| DVec3::from(at.map(|i| row[i]));
            let p = point(position);
            if !p.is_finite() {
                return Err(self.fault(start, "finite coordinates", format!("{p} at vertex {vertex}")));
            }
            mesh.positions.push(p);
            // A normal that is no direction counts as none.
            mesh.normals.extend(normal.map(point).map(|n| if n.is_finite() { n } else { DVec3::ZERO }));
            mesh.uvs.extend(
                uv.map(|(u, v)| Vec2::new(row[u] as f32, row[v] as f32)).map(|t| if t.is_finite() { t } else { Vec2::ZERO }),
            );
        }
        Ok(())
    }

    /// Faces of a mesh with `vertices` so far; they may also follow.
    fn faces(&mut self, element: &Element, vertices: usize, triangles: &mut Vec<[u32; 3]>) -> Result<()> {
        let is_list = |p: &Property| p.list.is_some() && matches!(p.name.as_str(), "vertex_indices" | "vertex_index");
        if !element.properties.iter().any(is_list) {
            return Err(MeshFault::new(None, "faces with the list vertex_indices", "others"));
        }
        triangles.reserve(element.count);
        let (mut corners, mut polygon) = (Vec::new(), Vec::new());
        for face in 0..element.count {
            for property in &element.properties {
                if !is_list(property) {
                    self.value_or_list(property, |_| {})?;
                    continue;
                }
                corners.clear();
                let start = self.next();
                self.value_or_list(property, |v| corners.push(v))?;
                if corners.len() < 3 {
                    let found = format!("{} vertices in face {face}", corners.len());
                    return Err(self.fault(start, "faces of three vertices or more", found));
                }
                let valid = |v: &f64| *v >= 0.0 && *v < f64::from(u32::MAX) && v.fract() == 0.0;
                if let Some(bad) = corners.iter().find(|v| !valid(v)) {
                    return Err(self.fault(start, "vertices from 0 up", format!("vertex {bad} in face {face}")));
                }
                if let Some(bad) = corners.iter().find(|v| vertices > 0 && **v >= vertices as f64) {
                    let found = format!("vertex {bad} in face {face}");
                    return Err(self.fault(start, &format!("vertices from 0 to {}", vertices - 1), found));
                }
                polygon.clear();
                polygon.extend(corners.iter().map(|v| *v as u32));
                triangles.extend(fan(&polygon));
            }
        }
        Ok(())
    }

    fn skip(&mut self, element: &Element) -> Result<()> {
        // An element without properties takes no bytes, however many there are.
        if element.properties.is_empty() {
            return Ok(());
        }
        for _ in 0..element.count {
            for property in &element.properties {
                self.value_or_list(property, |_| {})?;
            }
        }
        Ok(())
    }

    /// The value of a scalar property; or 0 for a list, whose items go to `item`.
    fn value_or_list(&mut self, property: &Property, mut item: impl FnMut(f64)) -> Result<f64> {
        let Some(length) = property.list else { return self.value(property.scalar) };
        let start = self.next();
        let n = self.value(length)?;
        if n < 0.0 {
            return Err(self.fault(start, "a list with a length", format!("length {n}")));
        }
        for _ in 0..n as u64 {
            item(self.value(property.scalar)?);
        }
        Ok(0.0)
    }

    fn value(&mut self, scalar: Scalar) -> Result<f64> {
        if self.format == Format::Ascii {
            return self.word();
        }
        let end = self.at + scalar.size();
        let bytes = self.bytes.get(self.at..end).ok_or_else(|| self.too_short())?;
        self.at = end;
        let mut buffer = [0; 8];
        buffer[..bytes.len()].copy_from_slice(bytes);
        if self.format == Format::BigEndian {
            buffer[..bytes.len()].reverse();
        }
        let [a, b, c, d, ..] = buffer;
        Ok(match scalar {
            Scalar::I8 => f64::from(a as i8),
            Scalar::U8 => f64::from(a),
            Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
            Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
            Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Scalar::F64 => f64::from_le_bytes(buffer),
        })
    }

    fn word(&mut self) -> Result<f64> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace()).ok_or_else(|| self.too_short())?;
        let end = rest[start..].iter().position(u8::is_ascii_whitespace).map_or(rest.len(), |n| start + n);
        let word = &rest[start..end];
        let number = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
        let at = self.at + start;
        self.at += end;
        number.ok_or_else(|| MeshFault::new(Some(at), "a number", format!("\"{}\"", short(&String::from_utf8_lossy(word)))))
    }

    /// Byte at which the next item begins.
    fn next(&self) -> usize {
        let blanks = self.bytes[self.at..].iter().take_while(|b| self.format == Format::Ascii && b.is_ascii_whitespace());
        self.at + blanks.count()
    }

    /// A fault of the item at byte `at`: by its line in a text file.
    fn fault(&self, at: usize, expected: &str, found: String) -> MeshFault {
        match self.format {
            Format::Ascii => MeshFault::new(Some(at), expected, found),
            _ => MeshFault::new(None, expected, format!("{found}, at byte {at}")),
        }
    }

    fn too_short(&self) -> MeshFault {
        let place = match self.format {
            Format::Ascii => String::new(),
            _ => format!(", {} bytes into an item that begins at byte {}", self.bytes.len() - self.at, self.at),
        };
        MeshFault::new(None, "more data", format!("the end of the file after {} bytes{place}", self.bytes.len()))
    }

    /// An error if anything but white space is left.
    fn end(&self) -> Result<()> {
        let rest = &self.bytes[self.at..];
        let left = if self.format == Format::Ascii { rest.trim_ascii().len() } else { rest.len() };
        if left > 0 {
            return Err(MeshFault::new(None, "the end of the file", format!("{left} bytes more")));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n\
                        property float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\n\
                        property short flags\nelement other 1\nproperty list uint double data\nend_header\n";

    const BODY: &str = "0 0 0 7 0 0\n1 0 0 7 1 0\n0 1 0.5 7 0 0.25\n3 0 1 2 -1\n2 9 9\n";

    fn binary(big: bool) -> Vec<u8> {
        let name = if big { "big" } else { "little" };
        let mut file = format!("ply\nformat binary_{name}_endian 1.0\n{HEAD}").into_bytes();
        let mut put = |mut bytes: Vec<u8>| {
            if big {
                bytes.reverse();
            }
            file.extend(bytes);
        };
        for v in [[0.0_f32, 0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.5, 0.0, 0.25]] {
            v[..3].iter().for_each(|x| put(x.to_le_bytes().to_vec()));
            put(vec![7]);
            v[3..].iter().for_each(|x| put(x.to_le_bytes().to_vec()));
        }
        put(vec![3]);
        [0_i32, 1, 2].iter().for_each(|i| put(i.to_le_bytes().to_vec()));
        put((-1_i16).to_le_bytes().to_vec());
        put(2_u32.to_le_bytes().to_vec());
        [9.0_f64; 2].iter().for_each(|x| put(x.to_le_bytes().to_vec()));
        file
    }

    fn ascii(body: &str) -> Vec<u8> {
        format!("ply\nformat ascii 1.0\ncomment c\n{HEAD}{body}").into_bytes()
    }

    #[test]
    fn the_three_formats_say_the_same() {
        for (name, file) in [("ascii", ascii(BODY)), ("little", binary(false)), ("big", binary(true))] {
            let mesh = parse(&file).unwrap_or_else(|e| panic!("{name}: {}", e.kind));
            assert_eq!(mesh.positions, [DVec3::ZERO, DVec3::X, DVec3::new(0.0, 1.0, 0.5)], "{name}");
            assert_eq!(mesh.uvs[2], Vec2::new(0.0, 0.25), "{name}: v is not flipped");
            assert_eq!(mesh.triangles, [[0, 1, 2]], "{name}");
            assert!(mesh.normals.is_empty(), "{name}");
        }
    }

    #[test]
    fn every_shortened_file_and_every_longer_one_is_refused() {
        for file in [binary(false), binary(true), ascii(BODY.trim_end())] {
            for n in 0..file.len() - 1 {
                // A number may lose its last digits unnoticed, so only the binary files are short at every length.
                if file.starts_with(b"ply\nformat b") {
                    assert!(parse(&file[..n]).is_err(), "{n} bytes of {}", file.len());
                }
            }
            let longer = [&file[..], b" 1"].concat();
            assert!(parse(&longer).is_err());
        }
    }

    #[test]
    fn a_binary_file_that_ends_early_is_told_where() {
        for big in [false, true] {
            let file = binary(big);
            // The last number has eight bytes, of which three are left.
            let (length, last) = (file.len() - 5, file.len() - 8);
            let message = parse(&file[..length]).expect_err("too short").kind.to_string();
            let want = format!("after {length} bytes, 3 bytes into an item that begins at byte {last}");
            assert!(message.contains(&want), "{message}, expected {want}");
        }
    }

    #[test]
    fn false_counts_and_indices_are_refused() {
        let text = String::from_utf8(ascii(BODY)).expect("text");
        for (from, to, part) in [
            ("element vertex 3", "element vertex 4000000000", "4000000000"),
            ("element vertex 3", "element vertex -1", "count"),
            ("element vertex 3", "element vertex 100000000000000000000", "count"),
            ("element face 1", "element face 4000000000", "4000000000"),
            ("element other 1", "element other 4000000000", "4000000000"),
            ("3 0 1 2", "3 0 1 3", "vertices from 0 to 2, found vertex 3 in face 0"),
            ("3 0 1 2", "3 0 1 -1", "vertex -1 in face 0"),
            ("3 0 1 2", "2 0 1", "three vertices"),
            ("0 1 0.5", "0 nan 0.5", "vertex 2"),
            ("0 1 0.5", "0 x 0.5", "\"x\""),
            ("property float y", "property float why", "x, y and z"),
            ("uchar int vertex", "float int vertex", "known type"),
            ("format ascii", "format ebcdic", "binary_little_endian"),
        ] {
            let changed = text.replacen(from, to, 1);
            assert_ne!(changed, text, "{from}");
            let message = parse(changed.as_bytes()).expect_err(to).kind.to_string();
            assert!(message.contains(part), "{to}: {message}");
        }
    }
}
