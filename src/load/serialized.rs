//! Mitsuba's `.serialized`: meshes one behind the other, each with a short header and then compressed (zlib), and at the end of the
//! file a list of where they begin.
//!
//! All is little endian. Before anything is allocated the counts are held against what so many compressed bytes can unfold to, and
//! against the limits; arrays then grow with what is really there. Vertex colours are read over. The flag that asks for face normals
//! is passed over, as by Mitsuba 3.9.1 (against its documentation). Texture coordinates are not flipped.

use super::Limits;
use super::error::LoadErrorKind;
use super::mesh::{MeshFault, RawMesh};
use crate::math::{DVec3, Vec2};
use flate2::bufread::ZlibDecoder;
use std::io::{BufReader, Read};

type Result<T> = std::result::Result<T, MeshFault>;

const MAGIC: u16 = 0x041c;

/// Bits of the flags.
const HAS_NORMALS: u32 = 0x0001;
const HAS_UVS: u32 = 0x0002;
const HAS_COLORS: u32 = 0x0008;
const DOUBLE_PRECISION: u32 = 0x2000;

/// DEFLATE unfolds a byte to at most this many (its longest match, 258 bytes, takes two bits at least).
const MAX_RATIO: u64 = 1032;

/// Longest name of a mesh.
const MAX_NAME: usize = 4096;

/// Reads mesh `index` of a file, counted from 0.
pub(super) fn parse(bytes: &[u8], index: usize, limits: &Limits) -> Result<RawMesh> {
    let version = header(bytes, "the start of the file")?;
    let start = if index == 0 { 0 } else { start_of(bytes, index, version)? };
    let mesh = &bytes[start..];
    if start > 0 {
        header(mesh, &format!("the start of mesh {index}"))?;
    }
    let compressed = &mesh[4..];
    let mut reader = Unfolded { source: BufReader::new(ZlibDecoder::new(compressed)), double: false };
    reader.mesh(version, compressed.len() as u64, limits)
}

/// The version, 3 or 4.
fn header(bytes: &[u8], at: &str) -> Result<u16> {
    let word = |i: usize| bytes.get(i..i + 2).map(|b| u16::from_le_bytes([b[0], b[1]]));
    match (word(0), word(2)) {
        (Some(MAGIC), Some(version @ (3 | 4))) => Ok(version),
        (Some(MAGIC), Some(version)) => {
            Err(MeshFault::new(None, "version 3 or 4 of a serialized mesh", format!("version {version}")))
        }
        _ => Err(MeshFault::new(None, "a serialized mesh (bytes 1c 04)", format!("other bytes at {at}"))),
    }
}

/// Where a mesh begins, by the list at the end of the file.
fn start_of(bytes: &[u8], index: usize, version: u16) -> Result<usize> {
    let short = || MeshFault::new(None, "a list of meshes at the end of the file", format!("only {} bytes", bytes.len()));
    let (rest, count) = bytes.split_last_chunk::<4>().ok_or_else(short)?;
    let count = u32::from_le_bytes(*count) as usize;
    if index >= count {
        return Err(MeshFault::new(None, format!("mesh {index}"), format!("a file of {count}")));
    }
    let width = if version == 4 { 8 } else { 4 };
    // `index` is below `count`.
    let from_end = (count - index).checked_mul(width).filter(|n| *n <= rest.len()).ok_or_else(short)?;
    let entry = &rest[rest.len() - from_end..][..width];
    let mut buffer = [0; 8];
    buffer[..width].copy_from_slice(entry);
    let start = u64::from_le_bytes(buffer);
    usize::try_from(start).ok().filter(|s| *s < rest.len()).ok_or_else(|| {
        MeshFault::new(None, format!("mesh {index} within the file"), format!("its start at byte {start} of {}", bytes.len()))
    })
}

/// Decompressed bytes.
struct Unfolded<R> {
    source: R,
    double: bool,
}

impl<R: Read> Unfolded<R> {
    fn mesh(&mut self, version: u16, compressed: u64, limits: &Limits) -> Result<RawMesh> {
        let flags = u32::from_le_bytes(self.take()?);
        self.double = flags & DOUBLE_PRECISION != 0;
        if version == 4 {
            let mut length = 0;
            while self.take::<1>()? != [0] {
                length += 1;
                if length > MAX_NAME {
                    return Err(MeshFault::new(None, format!("a name of up to {MAX_NAME} bytes"), "a longer one"));
                }
            }
        }
        let (vertices, triangles) = (u64::from_le_bytes(self.take()?), u64::from_le_bytes(self.take()?));
        let has = |flag: u32| flags & flag != 0;
        let numbers = 3 + 3 * u64::from(has(HAS_NORMALS)) + 2 * u64::from(has(HAS_UVS)) + 3 * u64::from(has(HAS_COLORS));
        let a_vertex = numbers * if self.double { 8 } else { 4 };
        let size = vertices.saturating_mul(a_vertex).saturating_add(triangles.saturating_mul(12));
        if size > compressed.saturating_mul(MAX_RATIO) || vertices >= u64::from(u32::MAX) {
            let found = format!("{vertices} vertices and {triangles} triangles in {compressed} compressed bytes");
            return Err(MeshFault::new(None, "as many items as the file can hold", found));
        }
        for (what, limit, found) in [
            ("bytes of a serialized mesh, decompressed", limits.mesh_bytes, size),
            ("triangles of a serialized mesh", limits.triangles, triangles),
        ] {
            if found > limit {
                return Err(MeshFault { offset: None, kind: LoadErrorKind::OverLimit { what: what.to_owned(), limit, found } });
            }
        }
        let mut mesh = RawMesh::default();
        for vertex in 0..vertices {
            let p = DVec3::from(self.reals::<3>()?);
            if !p.is_finite() {
                return Err(MeshFault::new(None, "finite coordinates", format!("{p} at vertex {vertex}")));
            }
            mesh.positions.push(p);
        }
        for _ in 0..if has(HAS_NORMALS) { vertices } else { 0 } {
            let n = DVec3::from(self.reals::<3>()?);
            // A normal that is no direction counts as none.
            mesh.normals.push(if n.is_finite() { n } else { DVec3::ZERO });
        }
        for _ in 0..if has(HAS_UVS) { vertices } else { 0 } {
            let uv = Vec2::from(self.reals::<2>()?.map(|v| v as f32));
            mesh.uvs.push(if uv.is_finite() { uv } else { Vec2::ZERO });
        }
        for _ in 0..if has(HAS_COLORS) { vertices } else { 0 } {
            self.reals::<3>()?;
        }
        for triangle in 0..triangles {
            let mut corners = [0; 3];
            for corner in &mut corners {
                *corner = u32::from_le_bytes(self.take()?);
                if u64::from(*corner) >= vertices {
                    let found = format!("vertex {corner} in triangle {triangle}");
                    return Err(MeshFault::new(None, format!("vertices below {vertices}"), found));
                }
            }
            mesh.triangles.push(corners);
        }
        Ok(mesh)
    }

    fn reals<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = if self.double { f64::from_le_bytes(self.take()?) } else { f64::from(f32::from_le_bytes(self.take()?)) };
        }
        Ok(values)
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.source.read_exact(&mut bytes).map_err(|error| {
            let found = match error.kind() {
                std::io::ErrorKind::UnexpectedEof => "their end".to_owned(),
                _ => error.to_string(),
            };
            MeshFault::new(None, "more compressed bytes", found)
        })?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use std::io::Write;

    const POSITIONS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0]];

    /// What is written of a mesh; the counts may lie.
    struct Sample {
        version: u16,
        flags: u32,
        vertices: u64,
        triangles: u64,
        corners: Vec<u32>,
    }

    const TRUE: Sample = Sample { version: 4, flags: 0x1000, vertices: 4, triangles: 2, corners: Vec::new() };

    impl Sample {
        fn write(&self) -> Vec<u8> {
            let mut body = ZlibEncoder::new(Vec::new(), Compression::default());
            let mut put = |bytes: &[u8]| body.write_all(bytes).expect("to memory");
            put(&self.flags.to_le_bytes());
            if self.version == 4 {
                put(b"a name\0");
            }
            put(&self.vertices.to_le_bytes());
            put(&self.triangles.to_le_bytes());
            let mut reals = |values: &[f64]| {
                for v in values {
                    if self.flags & DOUBLE_PRECISION != 0 { put(&v.to_le_bytes()) } else { put(&(*v as f32).to_le_bytes()) }
                }
            };
            POSITIONS.iter().for_each(|p| reals(p));
            if self.flags & HAS_NORMALS != 0 {
                POSITIONS.iter().for_each(|_| reals(&[0.0, 0.0, 1.0]));
            }
            if self.flags & HAS_UVS != 0 {
                POSITIONS.iter().for_each(|p| reals(&[p[0], 0.25 * p[1]]));
            }
            if self.flags & HAS_COLORS != 0 {
                POSITIONS.iter().for_each(|_| reals(&[1.0; 3]));
            }
            let corners = if self.corners.is_empty() { &[0, 1, 2, 0, 2, 3][..] } else { &self.corners };
            corners.iter().for_each(|i| put(&i.to_le_bytes()));
            let mut file = [MAGIC.to_le_bytes(), self.version.to_le_bytes()].concat();
            file.extend(body.finish().expect("to memory"));
            file
        }
    }

    /// A file of several meshes with the list at its end.
    fn file(meshes: &[Sample]) -> Vec<u8> {
        let (mut bytes, mut list) = (Vec::new(), Vec::new());
        for mesh in meshes {
            let start = bytes.len() as u64;
            list.extend_from_slice(&start.to_le_bytes()[..if mesh.version == 4 { 8 } else { 4 }]);
            bytes.extend(mesh.write());
        }
        bytes.extend(list);
        bytes.extend((meshes.len() as u32).to_le_bytes());
        bytes
    }

    fn read(bytes: &[u8], index: usize) -> Result<RawMesh> {
        parse(bytes, index, &Limits::default())
    }

    #[test]
    fn versions_precisions_and_attributes_are_read() {
        for version in [3, 4] {
            for flags in [0x1000, 0x2000, 0x1001, 0x2002, 0x1003, 0x2003, 0x100b] {
                // The mesh in question stands second, behind another of another size.
                let first = Sample { version, ..TRUE };
                let bytes = file(&[first, Sample { version, flags, ..TRUE }]);
                let mesh = read(&bytes, 1).unwrap_or_else(|e| panic!("{version} {flags:x}: {}", e.kind));
                assert_eq!(mesh.positions, POSITIONS.map(DVec3::from), "{version} {flags:x}");
                assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]], "{version} {flags:x}");
                assert_eq!(mesh.normals, if flags & 1 != 0 { vec![DVec3::Z; 4] } else { Vec::new() }, "{version} {flags:x}");
                let uvs = POSITIONS.map(|p| Vec2::new(p[0] as f32, 0.25 * p[1] as f32));
                assert_eq!(mesh.uvs, if flags & 2 != 0 { uvs.to_vec() } else { Vec::new() }, "{version} {flags:x}: not flipped");
                assert!(read(&bytes, 0).expect("the first").uvs.is_empty());
            }
        }
    }

    #[test]
    fn false_counts_indices_and_places_are_refused() {
        let with = |change: fn(&mut Sample)| {
            let mut sample = TRUE;
            change(&mut sample);
            file(&[sample])
        };
        let mut far = file(&[TRUE, TRUE]);
        let entry = far.len() - 12;
        far[entry..entry + 8].copy_from_slice(&u64::MAX.to_le_bytes());
        for (bytes, index, part) in [
            (file(&[TRUE, TRUE]), 2, "a file of 2"),
            (far, 1, "within the file"),
            (with(|s| s.vertices = 4_000_000_000), 0, "4000000000 vertices"),
            (with(|s| s.vertices = u64::MAX), 0, "as many items"),
            (with(|s| s.triangles = u64::MAX), 0, "as many items"),
            (with(|s| s.triangles = 4), 0, "their end"),
            (with(|s| s.corners = vec![0, 1, 2, 0, 2, 4]), 0, "vertex 4 in triangle 1"),
            (with(|s| s.version = 5), 0, "version 5"),
            (b"hello, world".to_vec(), 0, "serialized mesh"),
            (MAGIC.to_le_bytes().to_vec(), 0, "serialized mesh"),
        ] {
            let message = read(&bytes, index).expect_err(part).kind.to_string();
            assert!(message.contains(part), "{message}, expected {part}");
        }
    }

    #[test]
    fn shortened_files_are_refused_at_every_length() {
        let whole = Sample { flags: 0x2003, ..TRUE }.write();
        // The checksum at the end of a stream is not read once all numbers are there.
        for n in 0..whole.len() - 5 {
            assert!(read(&whole[..n], 0).is_err(), "{n} of {} bytes", whole.len());
        }
    }

    #[test]
    fn what_unfolds_beyond_a_limit_is_refused_before_it_unfolds() {
        // A megabyte of zeros folds into a kilobyte.
        let mut body = ZlibEncoder::new(Vec::new(), Compression::best());
        let head = [&0x1000_u32.to_le_bytes()[..], b"\0", &80_000_u64.to_le_bytes(), &1_u64.to_le_bytes()].concat();
        body.write_all(&head).and_then(|()| body.write_all(&vec![0; 1 << 20])).expect("to memory");
        let bomb = [&[0x1c, 4, 4, 0][..], &body.finish().expect("to memory")].concat();
        assert!(read(&bomb, 0).is_ok(), "a triangle of 80,000 vertices");
        let limits = Limits { mesh_bytes: 100_000, ..Limits::default() };
        let error = parse(&bomb, 0, &limits).expect_err("over the limit").kind;
        assert!(matches!(error, LoadErrorKind::OverLimit { limit: 100_000, found: 960_012, .. }), "{error}");
    }
}
