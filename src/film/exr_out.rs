//! Writing EXR files.

use super::atomic::{WriteError, WriteErrorKind, atomic_write};
use super::layer::Layer;
use exr::prelude as e;
use exr::prelude::WritableImage;
use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::Path;

/// A value in the header of an EXR file.
#[derive(Debug, Clone, PartialEq)]
pub enum Attribute {
    /// Text, stored as UTF-8.
    Text(String),
    /// A number, stored as a double.
    Number(f64),
}

/// What an EXR file says about its pixels.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Header {
    /// Attributes by name.
    pub attributes: BTreeMap<String, Attribute>,
    /// OpenEXR's `worldToCamera`: a 4x4 matrix for row vectors, row by row.
    pub world_to_camera: Option<[f32; 16]>,
    /// OpenEXR's `worldToNDC`, likewise.
    pub world_to_ndc: Option<[f32; 16]>,
    /// Where the pixels lie in a larger picture; `None` if they are all of it.
    pub window: Option<Window>,
}

/// A cut-out of a larger picture, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Column of the cut-out's left edge.
    pub x: usize,
    /// Row of its top edge.
    pub y: usize,
    /// Width of the whole picture.
    pub full_width: usize,
    /// Height of the whole picture.
    pub full_height: usize,
}

impl Header {
    /// Adds a text.
    pub fn text(mut self, name: &str, value: impl Into<String>) -> Self {
        self.attributes.insert(name.to_owned(), Attribute::Text(value.into()));
        self
    }

    /// Adds a number.
    pub fn number(mut self, name: &str, value: f64) -> Self {
        self.attributes.insert(name.to_owned(), Attribute::Number(value));
        self
    }
}

/// Writes layers of one size into one part of an EXR file, as 32-bit floats without loss. Run lengths: ZIP takes 0.1 CPU s more for 256x256 pixels, as
/// long as a preview, and saves 15 % of the bytes.
///
/// # Errors
/// [`WriteError`] as [`atomic_write`], or if two layers share a channel.
///
/// # Panics
/// If there is no layer or their sizes differ.
pub fn write_exr(path: &Path, layers: &[Layer], header: &Header) -> Result<(), WriteError> {
    let image = exr_image(layers, header);
    atomic_write(path, |file: &mut BufWriter<_>| {
        image.write().to_buffered(file).map_err(|error| match error {
            e::Error::Io(error) => WriteErrorKind::Io(error),
            other => WriteErrorKind::Encode(other.to_string()),
        })
    })
}

type ExrImage = e::Image<e::Layer<e::AnyChannels<e::FlatSamples>>>;

fn exr_image(layers: &[Layer], header: &Header) -> ExrImage {
    let size = layers.first().expect("a picture has at least one layer").size();
    assert!(layers.iter().all(|l| l.size() == size), "all layers of a picture have its size, {size:?}");
    let channels = layers.iter().flat_map(Layer::channels);
    let channels = channels.map(|(name, values)| e::AnyChannel::new(name.as_str(), e::FlatSamples::F32(values))).collect();
    let mut attributes = e::LayerAttributes::default();
    attributes.software_name = Some(e::Text::from(concat!("twopass ", env!("CARGO_PKG_VERSION"))));
    attributes.world_to_camera = header.world_to_camera;
    attributes.world_to_normalized_device = header.world_to_ndc;
    attributes.other = header.attributes.iter().map(|(name, value)| (raw_text(name), exr_attribute(value))).collect();
    let encoding = e::Encoding { compression: e::Compression::RLE, ..e::Encoding::default() };
    let mut display = (e::Vec2(0, 0), size);
    if let Some(window) = header.window {
        attributes.layer_position = e::Vec2(window.x as i32, window.y as i32);
        display.1 = (window.full_width, window.full_height);
    }
    let layer = e::Layer::new(size, attributes, encoding, e::AnyChannels::sort(channels));
    let mut image = e::Image::from_layer(layer);
    image.attributes.display_window = e::IntegerBounds::new(display.0, display.1);
    image
}

fn exr_attribute(value: &Attribute) -> e::AttributeValue {
    match value {
        Attribute::Text(text) => e::AttributeValue::Text(raw_text(text)),
        Attribute::Number(number) => e::AttributeValue::F64(*number),
    }
}

/// The text's bytes as they are: the crate's own conversion stops at Latin-1.
fn raw_text(text: &str) -> e::Text {
    e::Text::from_slice_unchecked(text.as_bytes())
}
