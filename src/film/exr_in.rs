//! Reading EXR files.

use super::io::{MAX_PIXELS, ReadError, ReadErrorKind, malformed};
use super::layer::channel_name;
use super::{Image, guard};
use exr::prelude as e;
use exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel};
use std::path::Path;

/// Reads the picture itself: channels R, G, B of the first part that has them, or else a single Y as grey.
///
/// Half floats and integers become f32; NaN and infinity are kept. The data window is read, wherever it lies.
///
/// # Errors
/// [`ReadError`] if the file is missing, damaged, too large or has no such channels.
pub fn read_exr(path: &Path) -> Result<Image, ReadError> {
    match read_exr_layer(path, "", ["R", "G", "B"]) {
        Err(ReadError { kind: ReadErrorKind::NoChannels { found, .. }, .. }) if found.split(' ').any(|c| c == "Y") => {
            guarded(path, &["Y".to_owned()], decode_grey)
        }
        result => result,
    }
}

/// Reads three channels of a layer, such as `direct` and `["R", "G", "B"]`.
///
/// # Errors
/// As [`read_exr`].
pub fn read_exr_layer(path: &Path, layer: &str, components: [&str; 3]) -> Result<Image, ReadError> {
    let names = components.map(|c| channel_name(layer, c));
    guarded(path, &names, |path| decode_rgb(path, &names))
}

/// Decodes after a look at the header. A decoder that trips over hostile bytes does not take the program down.
fn guarded(
    path: &Path,
    names: &[String],
    decode: impl Fn(&Path) -> Result<Image, ReadErrorKind> + std::panic::RefUnwindSafe,
) -> Result<Image, ReadError> {
    guard::guarded(|| check_header(path, names).and_then(|()| decode(path)))
        .unwrap_or_else(|| Err(malformed("OpenEXR", "the decoder failed")))
        .map_err(|kind| ReadError { path: path.to_owned(), kind })
}

fn exr_error(error: e::Error) -> ReadErrorKind {
    match error {
        e::Error::Io(error) => ReadErrorKind::Io(error),
        other => malformed("OpenEXR", other),
    }
}

/// Refuses what would be expensive or in vain before a pixel is allocated.
fn check_header(path: &Path, names: &[String]) -> Result<(), ReadErrorKind> {
    let meta = e::MetaData::read_from_file(path, false).map_err(exr_error)?;
    let has = |header: &exr::meta::header::Header, name: &String| header.channels.list.iter().any(|c| c.name.eq(name));
    let part = meta.headers.iter().find(|h| names.iter().all(|n| has(h, n)));
    let Some(part) = part else {
        let found: Vec<String> = meta.headers.iter().flat_map(|h| &h.channels.list).map(|c| c.name.to_string()).collect();
        return Err(ReadErrorKind::NoChannels { wanted: names.join(" "), found: found.join(" ") });
    };
    let (width, height) = (part.layer_size.0, part.layer_size.1);
    match width.checked_mul(height) {
        Some(pixels) if pixels <= MAX_PIXELS => Ok(()),
        _ => Err(ReadErrorKind::TooLarge { width, height }),
    }
}

fn decode_rgb(path: &Path, names: &[String; 3]) -> Result<Image, ReadErrorKind> {
    let [r, g, b] = names.each_ref().map(String::as_str);
    let image = e::read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required(r)
        .required(g)
        .required(b)
        .collect_pixels(
            |size, _| Image::new(size.0, size.1),
            |image: &mut Image, at, (r, g, b): (f32, f32, f32)| {
                let width = image.width();
                image.pixels_mut()[at.1 * width + at.0] = [r, g, b];
            },
        )
        .first_valid_layer()
        .all_attributes()
        // A damaged block must not panic on the thread of a pool.
        .non_parallel()
        .from_file(path)
        .map_err(exr_error)?;
    Ok(image.layer_data.channel_data.pixels)
}

fn decode_grey(path: &Path) -> Result<Image, ReadErrorKind> {
    let image = e::read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("Y")
        .collect_pixels(
            |size, _| Image::new(size.0, size.1),
            |image: &mut Image, at, (y,): (f32,)| {
                let width = image.width();
                image.pixels_mut()[at.1 * width + at.0] = [y; 3];
            },
        )
        .first_valid_layer()
        .all_attributes()
        // A damaged block must not panic on the thread of a pool.
        .non_parallel()
        .from_file(path)
        .map_err(exr_error)?;
    Ok(image.layer_data.channel_data.pixels)
}
