//! Picture files: EXR in and out, PNG out after the tone map, PNG in as a mask.
//!
//! Everything written goes through [`atomic_write`]. Textures are read where scenes are.

use super::{Image, Mask};
use std::io::Write;
use std::path::{Path, PathBuf};
use thiserror::Error;

pub use super::atomic::{WriteError, WriteErrorKind, atomic_write, probe_writable};
pub use super::exr_in::{read_exr, read_exr_layer};
pub use super::exr_out::{Attribute, Header, Window, write_exr};
pub use super::tone_map::{Operator, ToneMap};

/// Most pixels of a picture that is read: 1.6 GB of RGB floats. A header that claims more is refused before any allocation.
pub const MAX_PIXELS: usize = 1 << 27;

/// Why a picture could not be read.
#[derive(Debug, Error)]
#[error("{}: {kind}", path.display())]
pub struct ReadError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub kind: ReadErrorKind,
}

/// What is wrong in a [`ReadError`].
#[derive(Debug, Error)]
pub enum ReadErrorKind {
    /// The operating system could not read it.
    #[error("cannot be read: {0}")]
    Io(std::io::Error),
    /// The bytes are not what the format demands.
    #[error("not a readable {format} picture: {detail}")]
    Malformed {
        /// Name of the format.
        format: &'static str,
        /// The decoder's words.
        detail: String,
    },
    /// No part of the file has these channels.
    #[error("no channels {wanted}; the file has {found}")]
    NoChannels {
        /// The channels looked for.
        wanted: String,
        /// The channels there.
        found: String,
    },
    /// Larger than this program reads.
    #[error("{width}x{height} pixels, more than the limit of {MAX_PIXELS} in all")]
    TooLarge {
        /// Claimed width.
        width: usize,
        /// Claimed height.
        height: usize,
    },
}

pub(super) fn malformed(format: &'static str, detail: impl ToString) -> ReadErrorKind {
    ReadErrorKind::Malformed { format, detail: detail.to_string() }
}

/// Writes a picture for the screen: 8 bits a channel, sRGB, after the tone map.
///
/// # Errors
/// [`WriteError`] as [`atomic_write`].
pub fn write_png(path: &Path, image: &Image, tone_map: &ToneMap) -> Result<(), WriteError> {
    let bytes: Vec<u8> = image.pixels().iter().flat_map(|&p| tone_map.bytes(p)).collect();
    write_png_bytes(path, image.width(), image.height(), &bytes)
}

/// Writes three bytes a pixel as a PNG.
///
/// # Errors
/// [`WriteError`] as [`atomic_write`].
pub fn write_png_bytes(path: &Path, width: usize, height: usize, bytes: &[u8]) -> Result<(), WriteError> {
    use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
    atomic_write(path, |file| {
        let encoder = PngEncoder::new(file.by_ref());
        let written = encoder.write_image(bytes, width as u32, height as u32, ExtendedColorType::Rgb8);
        written.map_err(|error| match error {
            image::ImageError::IoError(error) => WriteErrorKind::Io(error),
            other => WriteErrorKind::Encode(other.to_string()),
        })
    })
}

/// Reads a PNG as a mask: pixels at least half white are in it.
///
/// # Errors
/// [`ReadError`] if the file is missing, damaged or too large.
pub fn read_mask(path: &Path) -> Result<Mask, ReadError> {
    decode_mask(path).map_err(|kind| ReadError { path: path.to_owned(), kind })
}

fn decode_mask(path: &Path) -> Result<Mask, ReadErrorKind> {
    let reader = image::ImageReader::open(path).and_then(|r| r.with_guessed_format()).map_err(ReadErrorKind::Io)?;
    // The decoder's own limit of 512 MiB holds.
    let grey = reader.decode().map_err(|error| malformed("PNG", error))?.into_luma8();
    let (width, height) = (grey.width() as usize, grey.height() as usize);
    Ok(Mask::from_values(width, height, grey.pixels().map(|p| p.0[0] >= 128).collect()))
}

#[cfg(test)]
mod tests;
