//! Image files to linear texels. Sizes are checked from the header before anything is decoded.

use super::error::LoadErrorKind;
use super::files::Files;
use crate::film::guard::guarded;
use crate::material::texture::Texels;
use exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel, Vec2};
use image::codecs::hdr::HdrDecoder;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use std::fmt::Display;
use std::io::Cursor;
use std::path::Path;

/// A decoded image: linear values, row 0 at the top.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub width: usize,
    pub height: usize,
    pub texels: Texels,
}

const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
const PNG_MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
const JPEG_MAGIC: [u8; 3] = [0xff, 0xd8, 0xff];
/// Radiance writes `#?RADIANCE`, others `#?RGBE`.
const RADIANCE_MAGIC: [u8; 2] = *b"#?";

/// What deflate can make of one byte at most (RFC 1951: a match of 258 bytes takes at least two bits).
const MOST_INFLATED: u64 = 1032;

/// Bytes that a decoder may take for colour profiles and the like, besides the pixels.
const SIDE_DATA: u64 = 1 << 20;

type Result<T> = std::result::Result<T, LoadErrorKind>;

/// Decodes PNG, JPEG, Radiance HDR or OpenEXR. Integer files are sRGB unless `raw`; the others are linear. Grey becomes RGB, an
/// alpha channel is dropped.
pub(super) fn decode(bytes: &[u8], path: &Path, raw: bool, files: &Files) -> Result<Picture> {
    let decoder = match bytes {
        _ if bytes.starts_with(&EXR_MAGIC) => exr,
        _ if bytes.starts_with(&RADIANCE_MAGIC) => radiance,
        _ if bytes.starts_with(&PNG_MAGIC) => png,
        _ if bytes.starts_with(&JPEG_MAGIC) => jpeg,
        _ => {
            let expected = format!("PNG, JPEG, Radiance HDR or OpenEXR in {}", path.display());
            let found = if bytes.is_empty() { "no bytes" } else { "another format" }.to_owned();
            return Err(LoadErrorKind::Malformed { expected, found });
        }
    };
    // Readers have been known to panic on damaged files.
    let decoded = guarded(|| decoder(bytes, path, raw, files));
    decoded.unwrap_or_else(|| Err(damaged(path, &"damage that the reader cannot name")))
}

fn damaged(path: &Path, reason: &dyn Display) -> LoadErrorKind {
    LoadErrorKind::Malformed { expected: format!("an intact image in {}", path.display()), found: reason.to_string() }
}

/// Asks for the memory of an image of this size.
fn claim(width: u64, height: u64, path: &Path, files: &Files) -> Result<()> {
    if width == 0 || height == 0 {
        return Err(damaged(path, &"no pixels"));
    }
    files.take_pixels(path, width, height)
}

fn png(bytes: &[u8], path: &Path, raw: bool, files: &Files) -> Result<Picture> {
    // The header is the first chunk: length, name, width, height, bits a channel, colour type (PNG, section 11.2.1).
    let number = |at: usize| Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?));
    let header =
        bytes.get(12..16).filter(|name| *name == b"IHDR").and_then(|_| Some((number(16)?, number(20)?, bytes.get(24..26)?)));
    let (width, height, kind) = header.ok_or_else(|| damaged(path, &"no header at byte 8"))?;
    let (width, height) = (u64::from(width), u64::from(height));
    claim(width, height, path, files)?;
    let channels = match kind[1] {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1,
    };
    let row = (width * channels * u64::from(kind[0])).div_ceil(8);
    let most = bytes.len() as u64 * MOST_INFLATED;
    if row * height > most {
        return Err(damaged(path, &format!("{} bytes at byte 16, too few for {width} x {height} pixels", bytes.len())));
    }
    integer(bytes, ImageFormat::Png, width * height, path, raw)
}

fn jpeg(bytes: &[u8], path: &Path, raw: bool, files: &Files) -> Result<Picture> {
    let reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Jpeg);
    let (width, height) = reader.into_dimensions().map_err(|e| damaged(path, &e))?;
    claim(width.into(), height.into(), path, files)?;
    integer(bytes, ImageFormat::Jpeg, u64::from(width) * u64::from(height), path, raw)
}

fn integer(bytes: &[u8], format: ImageFormat, pixels: u64, path: &Path, raw: bool) -> Result<Picture> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut bounds = image::Limits::default();
    // Up to 8 bytes a pixel in the file's own type, and as much again while it is decoded.
    bounds.max_alloc = Some(16 * pixels + SIDE_DATA);
    reader.limits(bounds);
    let image = reader.decode().map_err(|e| damaged(path, &e))?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let texels = match image {
        DynamicImage::ImageLuma8(_) | DynamicImage::ImageLumaA8(_) | DynamicImage::ImageRgb8(_) | DynamicImage::ImageRgba8(_) => {
            Texels::of_codes(image.into_rgb8().into_raw(), std::array::from_fn(|v| linear(v as f64 / 255.0, raw)))
        }
        _ => {
            let table: Vec<f32> = (0..=65_535_u16).map(|v| linear(f64::from(v) / 65_535.0, raw)).collect();
            image.into_rgb16().pixels().map(|p| p.0.map(|v| table[usize::from(v)])).collect()
        }
    };
    Ok(Picture { width, height, texels })
}

/// The value that an sRGB code in [0, 1] stands for (IEC 61966-2-1), or the code itself.
fn linear(code: f64, raw: bool) -> f32 {
    let value = match code {
        _ if raw => code,
        _ if code <= 0.040_45 => code / 12.92,
        _ => ((code + 0.055) / 1.055).powf(2.4),
    };
    value as f32
}

fn radiance(bytes: &[u8], path: &Path, _raw: bool, files: &Files) -> Result<Picture> {
    // The strict mode knows the signature #?RADIANCE only.
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(|e| damaged(path, &e))?;
    let (width, height) = decoder.dimensions();
    claim(width.into(), height.into(), path, files)?;
    let image = DynamicImage::from_decoder(decoder).map_err(|e| damaged(path, &e))?.into_rgb32f();
    Ok(Picture { width: width as usize, height: height as usize, texels: image.pixels().map(|p| p.0).collect() })
}

/// Size of an EXR layer and its texels.
type Layer = (Vec2<usize>, Vec<[f32; 3]>);

fn blank<Channels>(size: Vec2<usize>, _: &Channels) -> Layer {
    (size, vec![[0.0; 3]; size.area()])
}

fn exr(bytes: &[u8], path: &Path, _raw: bool, files: &Files) -> Result<Picture> {
    let meta = exr::meta::MetaData::read_from_buffered(bytes, false).map_err(|e| damaged(path, &e))?;
    let Some((part, channels)) = meta.headers.iter().find_map(|h| Some((h, colour_channels(h)?))) else {
        let names: Vec<String> = meta.headers.iter().flat_map(|h| &h.channels.list).map(|c| c.name.to_string()).collect();
        let expected = format!("channels R, G, B or Y in {}", path.display());
        return Err(LoadErrorKind::Malformed { expected, found: super::error::short(&names.join(" ")) });
    };
    claim(part.layer_size.0 as u64, part.layer_size.1 as u64, path, files)?;
    let [r, g, b] = &channels;
    // All on this thread: a damaged block must not panic on the thread of a pool.
    let read = exr::prelude::read().no_deep_data().largest_resolution_level().specific_channels().required(r.as_str());
    let (size, texels) = if r == g {
        let put = |(size, texels): &mut Layer, at: Vec2<usize>, (y,): (f32,)| {
            texels[at.1 * size.0 + at.0] = [y; 3];
        };
        let read = read.collect_pixels(blank, put).first_valid_layer().all_attributes().non_parallel();
        read.from_buffered(Cursor::new(bytes)).map_err(|e| damaged(path, &e))?.layer_data.channel_data.pixels
    } else {
        let put = |(size, texels): &mut Layer, at: Vec2<usize>, (r, g, b): (f32, f32, f32)| {
            texels[at.1 * size.0 + at.0] = [r, g, b];
        };
        let read = read.required(g.as_str()).required(b.as_str()).collect_pixels(blank, put);
        let read = read.first_valid_layer().all_attributes().non_parallel();
        read.from_buffered(Cursor::new(bytes)).map_err(|e| damaged(path, &e))?.layer_data.channel_data.pixels
    };
    if let Some(i) = texels.iter().position(|t: &[f32; 3]| t.iter().any(|v| !v.is_finite())) {
        let found = format!("one that is not at ({}, {}) of {}", i % size.0, i / size.0, path.display());
        return Err(LoadErrorKind::Malformed { expected: "finite texels".to_owned(), found });
    }
    Ok(Picture { width: size.0, height: size.1, texels: texels.into() })
}

/// Names of a part's red, green and blue: those of the picture itself, else of its first layer that has all three (`layer.R`), else
/// thrice its luminance Y.
fn colour_channels(part: &exr::meta::header::Header) -> Option<[String; 3]> {
    if part.deep {
        return None;
    }
    let names: Vec<String> = part.channels.list.iter().map(|c| c.name.to_string()).collect();
    let of = |layer: &str, names_of: [&str; 3]| {
        let wanted = names_of.map(|c| format!("{layer}{c}"));
        wanted.iter().all(|w| names.contains(w)).then_some(wanted)
    };
    let layers = || std::iter::once("").chain(names.iter().filter_map(|n| n.rfind('.').map(|dot| &n[..=dot])));
    let find = |channels: [&str; 3]| layers().find_map(|layer| of(layer, channels));
    find(["R", "G", "B"]).or_else(|| find(["Y"; 3]))
}

#[cfg(test)]
mod tests;
