//! Bytes of a glTF: its buffers, and typed numbers out of them. Every extent is checked before it is used, and counts are held
//! against the bytes that are there before memory is taken.

use super::super::error::LoadErrorKind;
use super::super::files::Files;
use base64::Engine;
use gltf::Accessor;
use gltf::accessor::{DataType, sparse};
use std::borrow::Cow;

type Result<T> = std::result::Result<T, LoadErrorKind>;

/// All buffers of a file.
pub(super) struct Buffers<'b> {
    buffers: Vec<Cow<'b, [u8]>>,
    /// Most numbers that an accessor without data (all zero) may stand for.
    limit: usize,
}

/// The fault that the file should have `expected`.
pub(super) fn malformed(expected: impl Into<String>, found: impl Into<String>) -> LoadErrorKind {
    LoadErrorKind::Malformed { expected: expected.into(), found: found.into() }
}

/// The bytes that a URI names: a file beside the scene, or the URI's own.
pub(super) fn fetch(uri: &str, files: &Files, limit: u64) -> Result<Vec<u8>> {
    let Some(data) = uri.strip_prefix("data:") else {
        let name = percent_encoding::percent_decode_str(uri).decode_utf8_lossy();
        return files.read(&files.resolve(&name)?, limit);
    };
    let (_, text) = data.split_once(";base64,").ok_or_else(|| malformed("a data URI in base64", "another encoding"))?;
    let engine = base64::engine::general_purpose::STANDARD;
    engine.decode(text).map_err(|error| malformed("a data URI in base64", error.to_string()))
}

impl<'b> Buffers<'b> {
    /// Reads the buffers of a document; `blob` is the binary part of a .glb.
    pub fn read(document: &gltf::Document, blob: Option<Cow<'b, [u8]>>, files: &Files) -> Result<Self> {
        let mut blob = blob;
        let buffers = document.buffers().map(|buffer| {
            let bytes = match buffer.source() {
                gltf::buffer::Source::Bin => blob.take().ok_or_else(|| malformed("a binary part of the file", "none"))?,
                gltf::buffer::Source::Uri(uri) => Cow::Owned(fetch(uri, files, files.limits.mesh_bytes)?),
            };
            if bytes.len() < buffer.length() {
                let expected = format!("{} bytes in buffer {}", buffer.length(), buffer.index());
                return Err(malformed(expected, format!("{} bytes", bytes.len())));
            }
            Ok(bytes)
        });
        let limit = usize::try_from(files.limits.triangles.saturating_mul(3)).unwrap_or(usize::MAX);
        Ok(Self { buffers: buffers.collect::<Result<_>>()?, limit })
    }

    /// The bytes of a buffer view.
    pub fn view(&self, view: &gltf::buffer::View<'_>) -> Result<&[u8]> {
        let buffer = &self.buffers[view.buffer().index()];
        let end = view.offset().checked_add(view.length()).filter(|end| *end <= buffer.len());
        let end = end.ok_or_else(|| {
            let found = format!("{} bytes from {} on", view.length(), view.offset());
            malformed(format!("a view inside the {} bytes of its buffer", buffer.len()), found)
        })?;
        Ok(&buffer[view.offset()..end])
    }

    /// `count` items of `size` bytes, `stride` apart.
    fn items(&self, view: &gltf::buffer::View<'_>, offset: usize, count: usize, size: usize) -> Result<Vec<&[u8]>> {
        let bytes = self.view(view)?;
        let stride = view.stride().unwrap_or(size);
        let fault = || {
            let found = format!("{count} items of {size} bytes from {offset} on, {stride} apart");
            malformed(format!("items inside the {} bytes of a view", bytes.len()), found)
        };
        if count == 0 {
            return Ok(Vec::new());
        }
        let last = (count - 1).checked_mul(stride).and_then(|n| n.checked_add(offset)?.checked_add(size));
        if stride < size || last.is_none_or(|end| end > bytes.len()) {
            return Err(fault());
        }
        Ok((0..count).map(|i| &bytes[offset + i * stride..][..size]).collect())
    }

    /// Vectors of `N` numbers; integers as they are, or in [0, 1] and [-1, 1] if the accessor is normalized.
    pub fn vectors<const N: usize>(&self, accessor: &Accessor<'_>) -> Result<Vec<[f64; N]>> {
        let kind = accessor.data_type();
        if accessor.dimensions().multiplicity() != N {
            let found = format!("{:?} in accessor {}", accessor.dimensions(), accessor.index());
            return Err(malformed(format!("{N} numbers an item"), found));
        }
        let size = N * size_of(kind);
        let item = |bytes: &[u8]| std::array::from_fn(|i| number(&bytes[i * size_of(kind)..], kind, accessor.normalized()));
        let mut values: Vec<[f64; N]> = match accessor.view() {
            Some(view) => self.items(&view, accessor.offset(), accessor.count(), size)?.into_iter().map(item).collect(),
            None if accessor.count() > self.limit => {
                let (what, limit) = ("items of an accessor without data".to_owned(), self.limit as u64);
                return Err(LoadErrorKind::OverLimit { what, limit, found: accessor.count() as u64 });
            }
            None => vec![[0.0; N]; accessor.count()],
        };
        if let Some(sparse) = accessor.sparse() {
            let (indices, replaced) = (sparse.indices(), sparse.values());
            let index_kind = match indices.index_type() {
                sparse::IndexType::U8 => DataType::U8,
                sparse::IndexType::U16 => DataType::U16,
                sparse::IndexType::U32 => DataType::U32,
            };
            let places = self.items(&indices.view(), indices.offset(), sparse.count(), size_of(index_kind))?;
            let items = self.items(&replaced.view(), replaced.offset(), sparse.count(), size)?;
            for (place, bytes) in places.into_iter().zip(items) {
                let place = number(place, index_kind, false) as usize;
                let count = values.len();
                let value = values.get_mut(place);
                *value.ok_or_else(|| malformed(format!("places below {count}"), format!("{place}")))? = item(bytes);
            }
        }
        Ok(values)
    }

    /// Indices of vertices.
    pub fn indices(&self, accessor: &Accessor<'_>) -> Result<Vec<u32>> {
        match accessor.data_type() {
            DataType::U8 | DataType::U16 | DataType::U32 => {
                Ok(self.vectors::<1>(accessor)?.into_iter().map(|[index]| index as u32).collect())
            }
            other => Err(malformed("indices of an unsigned type", format!("{other:?}"))),
        }
    }
}

fn size_of(kind: DataType) -> usize {
    match kind {
        DataType::I8 | DataType::U8 => 1,
        DataType::I16 | DataType::U16 => 2,
        DataType::U32 | DataType::F32 => 4,
    }
}

fn number(bytes: &[u8], kind: DataType, normalized: bool) -> f64 {
    let scaled = |value: f64, largest: f64| if normalized { (value / largest).max(-1.0) } else { value };
    match kind {
        DataType::I8 => scaled(f64::from(bytes[0] as i8), 127.0),
        DataType::U8 => scaled(f64::from(bytes[0]), 255.0),
        DataType::I16 => scaled(f64::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32_767.0),
        DataType::U16 => scaled(f64::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65_535.0),
        DataType::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        DataType::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
    }
}
