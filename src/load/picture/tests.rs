//! Every kind of image that is read, written here.

use super::super::Limits;
use super::*;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, LineOrder, SmallVec, WritableImage, f16,
};
use image::{ImageBuffer, Luma, LumaA, Rgb, Rgba};

fn encoded(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Vec::new();
    image.into().write_to(&mut Cursor::new(&mut bytes), format).expect("encodes");
    bytes
}

fn read(bytes: &[u8], raw: bool) -> Picture {
    try_read(bytes, raw).unwrap_or_else(|e| panic!("{e}"))
}

fn try_read(bytes: &[u8], raw: bool) -> Result<Picture> {
    decode(bytes, Path::new("x"), raw, &Files::nowhere(Limits::default()))
}

/// IEC 61966-2-1, section 5.2, above its linear part.
fn srgb(code: f64) -> f32 {
    ((code + 0.055) / 1.055).powf(2.4) as f32
}

fn close(got: [f32; 3], want: [f32; 3], tolerance: f32) {
    let off = (0..3).map(|i| (got[i] - want[i]).abs()).fold(0.0, f32::max);
    assert!(off <= tolerance, "{got:?}, expected {want:?}");
}

#[test]
fn eight_bits_are_srgb_unless_raw() {
    let bytes = encoded(ImageBuffer::from_pixel(2, 1, Rgb([128_u8, 0, 255])), ImageFormat::Png);
    close(read(&bytes, false).texels.at(1), [srgb(128.0 / 255.0), 0.0, 1.0], 1e-6);
    close(read(&bytes, true).texels.at(1), [128.0 / 255.0, 0.0, 1.0], 1e-6);
}

#[test]
fn sixteen_bits_are_kept() {
    let image = ImageBuffer::from_fn(2, 1, |x, _| Rgb([32_896 + x as u16, 1, 65_535]));
    let bytes = encoded(image, ImageFormat::Png);
    let picture = read(&bytes, false);
    for (x, texel) in picture.texels.iter().enumerate() {
        // Below the knee the curve is a line of slope 1/12.92.
        close(texel, [srgb((32_896 + x) as f64 / 65_535.0), (1.0 / 65_535.0 / 12.92) as f32, 1.0], 1e-7);
    }
    assert!(picture.texels.at(1)[0] > picture.texels.at(0)[0], "one step of 65535");
    assert_eq!(read(&bytes, true).texels.at(0)[0], (32_896.0 / 65_535.0) as f32);
}

#[test]
fn grey_becomes_rgb_and_alpha_is_dropped() {
    let (v, w) = (srgb(128.0 / 255.0), srgb(32_896.0 / 65_535.0));
    let images: [(DynamicImage, f32); 6] = [
        (ImageBuffer::from_pixel(1, 1, Luma([128_u8])).into(), v),
        (ImageBuffer::from_pixel(1, 1, LumaA([128_u8, 0])).into(), v),
        (ImageBuffer::from_pixel(1, 1, Rgba([128_u8, 128, 128, 0])).into(), v),
        (ImageBuffer::from_pixel(1, 1, Luma([32_896_u16])).into(), w),
        (ImageBuffer::from_pixel(1, 1, LumaA([32_896_u16, 7])).into(), w),
        (ImageBuffer::from_pixel(1, 1, Rgba([32_896_u16, 32_896, 32_896, 7])).into(), w),
    ];
    for (image, want) in images {
        close(read(&encoded(image, ImageFormat::Png), false).texels.at(0), [want; 3], 1e-6);
    }
}

#[test]
fn jpeg_is_read_in_colour_and_in_grey() {
    let colour = encoded(ImageBuffer::from_pixel(16, 8, Rgb([200_u8, 200, 200])), ImageFormat::Jpeg);
    let grey = encoded(ImageBuffer::from_pixel(16, 8, Luma([200_u8])), ImageFormat::Jpeg);
    for bytes in [colour, grey] {
        let picture = read(&bytes, true);
        assert_eq!((picture.width, picture.height), (16, 8));
        // Two codes: the rounding of the transform and of its inverse.
        close(picture.texels.at(0), [200.0 / 255.0; 3], 2.0 / 255.0);
    }
}

#[test]
fn radiance_files_are_mantissas_with_a_common_exponent() {
    // Channel = mantissa 2^(exponent - 136) (Ward 1991, "Real Pixels"): 1, 1/2, 1/4, and then black.
    let (texel, black) = ([128_u8, 64, 32, 129], [0_u8; 4]);
    let flat = |magic: &str| [format!("{magic}\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 1\n").as_bytes(), &texel, &black].concat();
    for magic in ["#?RADIANCE", "#?RGBE"] {
        let picture = read(&flat(magic), false);
        assert_eq!((picture.width, picture.height), (1, 2));
        assert_eq!(picture.texels.iter().collect::<Vec<_>>(), [[1.0, 0.5, 0.25], [0.0; 3]], "{magic}");
    }
    // Runs by channel: a mark, the width, and for each channel a run of eight.
    let runs: Vec<u8> = texel.iter().flat_map(|m| [128 + 8, *m]).collect();
    let packed = [b"#?RADIANCE\n\n-Y 1 +X 8\n".as_slice(), &[2, 2, 0, 8], &runs].concat();
    assert_eq!(read(&packed, true).texels.iter().collect::<Vec<_>>(), [[1.0, 0.5, 0.25]; 8]);
    assert!(try_read(&packed[..packed.len() - 1], false).is_err());
}

const SIZE: (usize, usize) = (5, 3);

/// Samples `first`, `first + 1` and so on, row by row.
fn ramp(first: f32) -> Vec<f32> {
    (0..SIZE.0 * SIZE.1).map(|i| first + i as f32).collect()
}

fn layer(name: &str, channels: Vec<(&str, FlatSamples)>) -> Layer<AnyChannels<FlatSamples>> {
    let channels = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples)).collect::<Vec<_>>();
    let encoding = Encoding { compression: Compression::ZIP1, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    Layer::new(SIZE, LayerAttributes::named(name), encoding, AnyChannels::sort(SmallVec::from_vec(channels)))
}

fn floats(prefix: &str) -> Vec<(String, FlatSamples)> {
    [("R", 100.0), ("G", 200.0), ("B", 300.0)].map(|(c, v)| (format!("{prefix}{c}"), FlatSamples::F32(ramp(v)))).into()
}

fn named(channels: &[(String, FlatSamples)]) -> Vec<(&str, FlatSamples)> {
    channels.iter().map(|(name, samples)| (name.as_str(), samples.clone())).collect()
}

fn exr_file(layers: Vec<Layer<AnyChannels<FlatSamples>>>) -> Vec<u8> {
    let attributes = ImageAttributes::new(IntegerBounds::from_dimensions(SIZE));
    let mut bytes = Cursor::new(Vec::new());
    let image = Image { attributes, layer_data: layers.into_iter().collect::<SmallVec<[_; 2]>>() };
    image.write().non_parallel().to_buffered(&mut bytes).expect("in memory");
    bytes.into_inner()
}

/// The second texel of the third row.
fn probe(layers: Vec<Layer<AnyChannels<FlatSamples>>>) -> [f32; 3] {
    let picture = read(&exr_file(layers), false);
    assert_eq!((picture.width, picture.height), SIZE);
    picture.texels.at(2 * SIZE.0 + 1)
}

#[test]
fn exr_files_of_any_sample_type() {
    let half = |v: f32| FlatSamples::F16(ramp(v).into_iter().map(f16::from_f32).collect());
    let whole = |v: f32| FlatSamples::U32(ramp(v).into_iter().map(|v| v as u32).collect());
    let float = |v: f32| FlatSamples::F32(ramp(v));
    let want = [111.0, 211.0, 311.0];
    assert_eq!(probe(vec![layer("a", vec![("R", float(100.0)), ("G", float(200.0)), ("B", float(300.0))])]), want);
    assert_eq!(probe(vec![layer("a", vec![("R", half(100.0)), ("G", half(200.0)), ("B", half(300.0))])]), want);
    assert_eq!(probe(vec![layer("a", vec![("R", whole(100.0)), ("G", half(200.0)), ("B", float(300.0))])]), want, "a mixture");
    let alpha = vec![("A", half(0.0)), ("R", float(100.0)), ("G", float(200.0)), ("B", float(300.0))];
    assert_eq!(probe(vec![layer("a", alpha)]), want, "alpha is dropped");
    assert_eq!(probe(vec![layer("a", vec![("Y", half(7.0))])]), [18.0; 3], "luminance alone is grey");
}

#[test]
fn exr_files_in_tiles_and_with_a_shifted_window() {
    let mut tiled = layer("a", named(&floats("")));
    tiled.encoding.blocks = Blocks::Tiles(exr::math::Vec2(2, 2));
    assert_eq!(probe(vec![tiled]), [111.0, 211.0, 311.0]);
    for position in [(-3, 5), (40, -7)] {
        let mut shifted = layer("a", named(&floats("")));
        shifted.attributes.layer_position = exr::math::Vec2(position.0, position.1);
        assert_eq!(probe(vec![shifted]), [111.0, 211.0, 311.0], "{position:?}");
    }
}

#[test]
fn of_several_exr_layers_the_first_in_colour_counts() {
    let depth = || layer("depth", vec![("Z", FlatSamples::F32(ramp(0.0)))]);
    let colour = |v: f32| {
        let channel = |c| (c, FlatSamples::F32(ramp(v)));
        layer(&format!("colour {v}"), ["R", "G", "B"].map(channel).into())
    };
    assert_eq!(probe(vec![depth(), colour(10.0), colour(20.0)]), [21.0; 3]);
    // Layers by the names of channels: the picture itself first, else the first that is complete.
    let lights = vec![("lights.G".to_owned(), FlatSamples::F32(ramp(0.0)))];
    let some = [lights, floats("paint.")].concat();
    assert_eq!(probe(vec![layer("a", named(&some))]), [111.0, 211.0, 311.0]);
    let own: Vec<_> = floats("").into_iter().map(|(name, _)| (name, FlatSamples::F32(ramp(50.0)))).collect();
    assert_eq!(probe(vec![layer("a", named(&[floats("a."), own].concat()))]), [61.0; 3]);
    let fault = try_read(&exr_file(vec![depth()]), false).expect_err("no colour").to_string();
    assert!(fault.contains("R, G, B or Y") && fault.contains('Z'), "{fault}");
}

#[test]
fn damaged_images_are_refused() {
    let whole = encoded(ImageBuffer::from_pixel(40, 40, Rgb([1_u8, 2, 3])), ImageFormat::Png);
    for bytes in [&whole[..whole.len() / 2], b"", b"hello", &EXR_MAGIC, &[EXR_MAGIC.to_vec(), vec![2; 60]].concat()] {
        assert!(try_read(bytes, false).is_err());
    }
}
