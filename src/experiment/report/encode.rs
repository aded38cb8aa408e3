//! Pictures as text inside the page: half floats, one plane for the high bytes and one for the low, deflate, base64.

use crate::film::Image;
use base64::Engine;
use flate2::{Compression, write::ZlibEncoder};
use half::f16;
use std::io::Write;

/// Largest finite half float; larger values are shown as this.
const LARGEST: f32 = 65_504.0;

/// Base64 of deflated (zlib) half floats.
///
/// The planes are in the order red high bytes, green, blue, then the low bytes alike: neighbours in one plane are alike, which is
/// what deflate needs. NaN stays NaN.
pub fn half_floats(image: &Image) -> String {
    let n = image.pixels().len();
    let mut bytes = vec![0; 6 * n];
    for (i, pixel) in image.pixels().iter().enumerate() {
        for (channel, &value) in pixel.iter().enumerate() {
            let value = if value.is_nan() { value } else { value.clamp(-LARGEST, LARGEST) };
            let [high, low] = f16::from_f32(value).to_bits().to_be_bytes();
            bytes[channel * n + i] = high;
            bytes[(3 + channel) * n + i] = low;
        }
    }
    packed(&bytes)
}

/// Base64 of deflated (zlib) bytes.
pub fn packed(bytes: &[u8]) -> String {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    let deflated = encoder.write_all(bytes).and_then(|()| encoder.finish()).expect("memory takes all bytes");
    base64::engine::general_purpose::STANDARD.encode(deflated)
}

/// The picture with at most `max_pixels` pixels: means over squares of the smallest side that does; parts of squares at the right
/// and lower border are means of what there is. Linear values, so the mean is radiance.
pub fn reduced(image: &Image, max_pixels: usize) -> Image {
    let (width, height) = (image.width(), image.height());
    let mut side = 1;
    while width.div_ceil(side) * height.div_ceil(side) > max_pixels.max(1) {
        side += 1;
    }
    let (w, h) = (width.div_ceil(side), height.div_ceil(side));
    let mean = |i: usize| {
        let (columns, rows) = (span(i % w, side, width), span(i / w, side, height));
        let count = (columns.len() * rows.len()) as f64;
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
        let sum = pixels.fold([0.0; 3], |sum: [f64; 3], (x, y)| {
            let pixel = image.at(x, y);
            std::array::from_fn(|c| sum[c] + f64::from(pixel[c]))
        });
        sum.map(|s| (s / count) as f32)
    };
    Image::from_pixels(w, h, (0..w * h).map(mean).collect())
}

fn span(index: usize, side: usize, end: usize) -> std::ops::Range<usize> {
    index * side..((index + 1) * side).min(end)
}
