//! Image files to linear texels. Sizes are checked from the header before anything is decoded.

use super::Limits;
use super::error::LoadErrorKind;
use image::{DynamicImage, ImageFormat, ImageReader};
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

/// A decoded image: linear values, row 0 at the top.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub width: usize,
    pub height: usize,
    pub texels: Arc<[[f32; 3]]>,
}

const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Decodes PNG, JPEG or OpenEXR. Integer files are sRGB unless `raw`; EXR is linear. An alpha channel is dropped.
pub(super) fn decode(bytes: &[u8], path: &Path, raw: bool, limits: &Limits) -> Result<Picture, LoadErrorKind> {
    if bytes.starts_with(&EXR_MAGIC) { exr(bytes, path, limits) } else { integer(bytes, path, raw, limits) }
}

fn damaged(path: &Path, reason: &dyn std::fmt::Display) -> LoadErrorKind {
    LoadErrorKind::Malformed { expected: format!("an intact image in {}", path.display()), found: reason.to_string() }
}

fn check_size(width: u64, height: u64, path: &Path, limits: &Limits) -> Result<(), LoadErrorKind> {
    if width == 0 || height == 0 {
        return Err(damaged(path, &"no pixels"));
    }
    let found = width.saturating_mul(height);
    if found > limits.image_pixels {
        let what = format!("pixels of {} ({width} x {height})", path.display());
        return Err(LoadErrorKind::OverLimit { what, limit: limits.image_pixels, found });
    }
    Ok(())
}

fn integer(bytes: &[u8], path: &Path, raw: bool, limits: &Limits) -> Result<Picture, LoadErrorKind> {
    let reader = || -> Result<_, LoadErrorKind> {
        let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| damaged(path, &e))?;
        match reader.format() {
            Some(ImageFormat::Png | ImageFormat::Jpeg) => Ok(reader),
            _ => Err(LoadErrorKind::Malformed {
                expected: format!("PNG, JPEG or OpenEXR in {}", path.display()),
                found: "another format".to_owned(),
            }),
        }
    };
    let (width, height) = reader()?.into_dimensions().map_err(|e| damaged(path, &e))?;
    check_size(width.into(), height.into(), path, limits)?;
    let mut decoder = reader()?;
    let mut bounds = image::Limits::default();
    // Up to 8 bytes a pixel in the file's own type, and as much again while it is decoded.
    bounds.max_alloc = Some(16 * limits.image_pixels);
    decoder.limits(bounds);
    let image = decoder.decode().map_err(|e| damaged(path, &e))?;
    let texels = match image {
        DynamicImage::ImageLuma8(_) | DynamicImage::ImageLumaA8(_) | DynamicImage::ImageRgb8(_) | DynamicImage::ImageRgba8(_) => {
            let table: Vec<f32> = (0..=255_u8).map(|v| linear(f64::from(v) / 255.0, raw)).collect();
            image.into_rgb8().pixels().map(|p| p.0.map(|v| table[usize::from(v)])).collect()
        }
        _ => {
            let table: Vec<f32> = (0..=65_535_u16).map(|v| linear(f64::from(v) / 65_535.0, raw)).collect();
            image.into_rgb16().pixels().map(|p| p.0.map(|v| table[usize::from(v)])).collect()
        }
    };
    Ok(Picture { width: width as usize, height: height as usize, texels })
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

fn exr(bytes: &[u8], path: &Path, limits: &Limits) -> Result<Picture, LoadErrorKind> {
    // The reader of EXR files has been known to panic on damaged ones.
    let result = std::panic::catch_unwind(|| exr_unguarded(bytes, path, limits));
    result.unwrap_or_else(|_| Err(damaged(path, &"damage that the reader cannot name")))
}

fn exr_unguarded(bytes: &[u8], path: &Path, limits: &Limits) -> Result<Picture, LoadErrorKind> {
    use exr::prelude::{ReadChannels, ReadLayers, Vec2};
    let meta = exr::meta::MetaData::read_from_buffered(bytes, false).map_err(|e| damaged(path, &e))?;
    for header in &meta.headers {
        check_size(header.layer_size.0 as u64, header.layer_size.1 as u64, path, limits)?;
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| (size, vec![[0.0_f32; 3]; size.area()]),
            |(size, texels): &mut (Vec2<usize>, Vec<[f32; 3]>), at, (r, g, b): (f32, f32, f32)| {
                texels[at.1 * size.0 + at.0] = [r, g, b];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| damaged(path, &e))?;
    let (size, texels) = image.layer_data.channel_data.pixels;
    if let Some(i) = texels.iter().position(|t: &[f32; 3]| t.iter().any(|v| !v.is_finite())) {
        let found = format!("one that is not at ({}, {}) of {}", i % size.0, i / size.0, path.display());
        return Err(LoadErrorKind::Malformed { expected: "finite texels".to_owned(), found });
    }
    Ok(Picture { width: size.0, height: size.1, texels: texels.into() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(image: DynamicImage) -> Vec<u8> {
        let mut bytes = Vec::new();
        image.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).expect("encodes");
        bytes
    }

    fn read(bytes: &[u8], raw: bool) -> Picture {
        decode(bytes, Path::new("x"), raw, &Limits::default()).expect("valid")
    }

    #[test]
    fn integer_codes_are_srgb_unless_raw() {
        let grey = png(DynamicImage::ImageRgb8(image::RgbImage::from_pixel(2, 1, image::Rgb([128, 0, 255]))));
        let deep = png(DynamicImage::ImageLuma16(image::ImageBuffer::from_pixel(1, 1, image::Luma([32_896_u16]))));
        for (bytes, raw, want) in [(&grey, false, 0.215_86), (&grey, true, 0.501_96), (&deep, false, 0.215_86)] {
            let got = read(bytes, raw).texels[0][0];
            assert!((got - want).abs() < 1e-5, "{got}, expected {want}");
        }
        assert_eq!(read(&grey, false).texels[1][1..], [0.0, 1.0]);
    }

    #[test]
    fn alpha_is_dropped() {
        let clear = png(DynamicImage::ImageRgba8(image::RgbaImage::from_pixel(1, 1, image::Rgba([255, 255, 255, 0]))));
        assert_eq!(read(&clear, false).texels[0], [1.0; 3]);
    }

    #[test]
    fn sizes_are_refused_from_the_header_alone() {
        // A PNG header that claims 8e6 x 4e9 pixels, without any data.
        let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec();
        bytes.extend(8_000_000_u32.to_be_bytes());
        bytes.extend(2_000_000_000_u32.to_be_bytes());
        bytes.extend([8, 2, 0, 0, 0]);
        bytes.extend(crc32(&bytes[12..]).to_be_bytes());
        bytes.extend([0, 0, 0, 0]);
        let fault = decode(&bytes, Path::new("x"), false, &Limits::default()).expect_err("too large");
        assert!(matches!(fault, LoadErrorKind::OverLimit { .. } | LoadErrorKind::Malformed { .. }), "{fault}");
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0, |crc, b| {
            (0..8).fold(crc ^ u32::from(*b), |c: u32, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 })
        })
    }

    #[test]
    fn damaged_images_are_refused() {
        let whole = png(DynamicImage::ImageRgb8(image::RgbImage::new(40, 40)));
        for bytes in [&whole[..whole.len() / 2], b"", b"hello", &EXR_MAGIC, &[EXR_MAGIC.to_vec(), vec![2; 60]].concat()] {
            assert!(decode(bytes, Path::new("x"), false, &Limits::default()).is_err());
        }
    }
}
