//! Bad images on the built program: rows C15 and C16 of the catalogue in `catalogue.rs`.

use crate::catalogue::Case;
use exr::prelude::WritableImage;
use std::io::{Cursor, Write};

/// A texture whose file is named on line 4.
fn texture(name: &str, bytes: impl AsRef<[u8]>) -> Case {
    let file = format!("<string name='filename' value='{name}'/>");
    let texture = format!("<texture type='bitmap' name='reflectance'>\n{file}</texture>");
    Case::new(&format!("<shape type='cube'><bsdf type='diffuse'>{texture}</bsdf></shape>\n")).with(name, bytes)
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes
        .iter()
        .fold(!0, |crc, b| (0..8).fold(crc ^ u32::from(*b), |c: u32, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 }))
}

/// A PNG file of these chunks after the signature.
pub fn png(chunks: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    for (name, data) in chunks {
        let body = [name.as_slice(), data].concat();
        file.extend((data.len() as u32).to_be_bytes());
        file.extend(&body);
        file.extend(crc32(&body).to_be_bytes());
    }
    file
}

/// A PNG header of 8-bit RGB.
pub fn header(width: u32, height: u32) -> (&'static [u8; 4], Vec<u8>) {
    (b"IHDR", [width.to_be_bytes().as_slice(), &height.to_be_bytes(), &[8, 2, 0, 0, 0]].concat())
}

pub fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).expect("in memory");
    encoder.finish().expect("in memory")
}

/// 8 x 4 texels of half, in an OpenEXR file with the given compression.
pub fn exr(compression: exr::prelude::Compression, value: f32) -> Vec<u8> {
    use exr::prelude::{Encoding, Image, SpecificChannels};
    let channels = SpecificChannels::rgb(|at: exr::math::Vec2<usize>| {
        let v = if at == exr::math::Vec2(5, 2) { value } else { 0.1 * at.0 as f32 };
        (v, 0.5_f32, 0.25_f32)
    });
    let encoding = Encoding { compression, ..Encoding::UNCOMPRESSED };
    let image = Image::from_encoded_channels((8, 4), encoding, channels);
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).expect("in memory");
    bytes.into_inner()
}

#[test]
fn c15_png_headers_are_believed_only_within_limits() {
    let claim = |width, height| png(&[header(width, height), (b"IDAT", deflated(&[0; 100])), (b"IEND", Vec::new())]);
    for (width, height, words) in [
        (8_000_000, 4_000_000_000_u32, "longer side"),
        (8_000_000, 1, "longer side"),
        (65_535, 65_535, "65535 x 65535"),
        (u32::MAX, u32::MAX, "longer side"),
    ] {
        texture("t.png", claim(width, height)).refused(4, &["scene.xml:4:", "t.png", words, "limit"]);
    }
    // Within the limits, but more than so few bytes can hold.
    texture("t.png", claim(11_000, 11_000)).refused(3, &["scene.xml:4:", "t.png", "too few for 11000 x 11000"]);
    texture("t.png", claim(0, 4)).refused(3, &["scene.xml:4:", "t.png", "no pixels"]);
    // A header and nothing else.
    texture("t.png", &png(&[header(8_000_000, 4_000_000_000)])[..33]).refused(4, &["t.png"]);
    texture("t.png", &claim(4, 4)[..20]).refused(3, &["scene.xml:4:", "t.png", "no header at byte 8"]);
}

#[test]
fn c15_compressed_text_and_profiles_are_not_unpacked() {
    // 100 MB of zeros in 100 kB, and three of them.
    let bomb = deflated(&vec![0; 100_000_000]);
    let rows = deflated(&[[0_u8, 50, 60, 70, 80, 90, 99].as_slice(); 2].concat());
    for (name, prefix) in [(b"zTXt", b"Comment\0\0".as_slice()), (b"iTXt", b"Comment\0\x01\0\0\0"), (b"iCCP", b"profile\0\0")] {
        let chunk = || (name, [prefix, &bomb].concat());
        let file = png(&[header(2, 2), chunk(), chunk(), chunk(), (b"IDAT", rows.clone()), (b"IEND", Vec::new())]);
        // The pixels are sound; either answer is one, in little memory.
        let case = texture("t.png", file).within(32 << 10);
        let output = case.command("info scene.xml --threads 1").output().expect("starts");
        let err = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(0 | 3 | 4)) && !err.contains("panic"), "{}: {err}", output.status);
    }
}

#[test]
fn c15_damaged_and_foreign_images() {
    let sound = png(&[header(2, 2), (b"IDAT", deflated(&[0; 14])), (b"IEND", Vec::new())]);
    texture("t.png", &sound).accepted();
    for bytes in
        [&b""[..], b"hello", b"\x89PNG\r\n\x1a\n", &sound[..sound.len() - 20], b"\xff\xd8\xff\xe0", b"#?RADIANCE\n", b"GIF89a"]
    {
        texture("t.png", bytes).refused(3, &["scene.xml:4:", "t.png", "expected"]);
    }
    let hdr = |size: &str| texture("t.hdr", format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n"));
    hdr("-Y 4000000000 +X 8000000").refused(4, &["scene.xml:4:", "t.hdr", "longer side"]);
    hdr("-Y 60000 +X 60000").refused(4, &["scene.xml:4:", "t.hdr", "60000 x 60000"]);
    hdr("-Y 4 +X 4").refused(3, &["scene.xml:4:", "t.hdr", "intact"]);
}

#[test]
fn c15_all_images_together_have_a_limit() {
    // Each is within its own limit: flat, so small files. Five of 2^26 pixels and 37 kB.
    let rows = deflated(&vec![0; (1 + 8192 / 8) * 8192]);
    let grey = [8192_u32.to_be_bytes().as_slice(), &8192_u32.to_be_bytes(), &[1, 0, 0, 0, 0]].concat();
    let file = png(&[(b"IHDR", grey), (b"IDAT", rows), (b"IEND", Vec::new())]);
    let fixture = (0..5).fold(crate::loading::Fixture::new(&five_textures()), |f, i| f.with(&format!("{i}.png"), &file));
    let mut fixture = fixture;
    // The same limit at a hundredth of the memory.
    fixture.options.limits.all_image_pixels = 4 << 26;
    fixture.options.limits.image_pixels = (1 << 26) - 1;
    let one = fixture.load().expect_err("each is too large").to_string();
    assert!(one.contains("pixels of ") && !one.contains("all images"), "{one}");
    let small = png(&[header(2, 2), (b"IDAT", deflated(&[0; 14])), (b"IEND", Vec::new())]);
    let mut fixture = (0..5).fold(fixture, |f, i| f.with(&format!("{i}.png"), &small));
    fixture.options.limits.all_image_pixels = 19;
    let all = fixture.load().expect_err("20 pixels in all");
    assert_eq!(all.kind.fault(), twopass::load::Fault::OverLimit);
    assert!(all.to_string().contains("pixels of all images") && all.to_string().contains("limit of 19"), "{all}");
    fixture.options.limits.all_image_pixels = 20;
    assert!(fixture.load().is_ok());
}

fn five_textures() -> String {
    let one = |i| format!("<texture type='bitmap' name='reflectance'><string name='filename' value='{i}.png'/></texture>");
    (0..5).map(|i| format!("<bsdf type='diffuse' id='b{i}'>{}</bsdf>", one(i))).collect()
}

#[test]
fn c16_exr_files_that_lie() {
    use exr::prelude::Compression;
    let sound = exr(Compression::ZIP16, 0.5);
    texture("t.exr", &sound).accepted();
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        texture("t.exr", exr(Compression::ZIP16, value)).refused(3, &["scene.xml:4:", "t.exr", "finite", "(5, 2)"]);
    }
    // Chunks that are missing, offsets that lead nowhere.
    for cut in [4, 20, sound.len() / 2, sound.len() - 5] {
        texture("t.exr", &sound[..cut]).refused(3, &["scene.xml:4:", "t.exr", "expected"]);
    }
    // The attribute is a name, a type, a size and four numbers: x and y of both corners.
    let name = b"dataWindow\0box2i\0\x10\0\0\0";
    let at = sound.windows(name.len()).position(|w| w == name).expect("the attribute") + name.len();
    let window = |x0: i32, y0: i32, x1: i32, y1: i32| {
        let mut file = sound.clone();
        file[at..at + 16].copy_from_slice(&[x0, y0, x1, y1].map(i32::to_le_bytes).concat());
        file
    };
    for (x0, y0, x1, y1) in
        [(0, 0, 1 << 30, 1 << 30), (0, 0, 100_000, 3), (0, 0, 30_000, 30_000), (-40_000, -40_000, 40_000, 40_000)]
    {
        let case = texture("t.exr", window(x0, y0, x1, y1));
        let output = case.command("info scene.xml --threads 2").output().expect("starts");
        let err = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(3 | 4)), "{}: {err}", output.status);
        assert!(err.contains("scene.xml:4:") && err.contains("t.exr") && !err.contains("panic"), "{err}");
    }
    for (x0, y0, x1, y1) in [(i32::MIN, i32::MIN, i32::MAX, i32::MAX), (0, 0, 6, 2), (0, 0, 8, 4), (0, 0, 9000, 9000)] {
        texture("t.exr", window(x0, y0, x1, y1)).refused(3, &["scene.xml:4:", "t.exr", "expected"]);
    }
}

#[test]
fn c16_damaged_exr_files_end_in_an_error_or_a_picture() {
    use exr::prelude::Compression;
    // Numbers by a linear congruence (Knuth's MMIX constants), so that a failure can be repeated.
    let mut state = 7_u64;
    let mut random = |n: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % n
    };
    for compression in
        [Compression::Uncompressed, Compression::RLE, Compression::ZIP16, Compression::PIZ, Compression::PXR24, Compression::B44]
    {
        let sound = exr(compression, 0.5);
        for _ in 0..6 {
            let mut file = sound.clone();
            for _ in 0..3 {
                let at = 8 + random(file.len() - 8);
                file[at] = random(256) as u8;
            }
            let case = texture("t.exr", file);
            let output = case.command("info scene.xml --threads 2").output().expect("starts");
            let err = String::from_utf8_lossy(&output.stderr);
            assert!(matches!(output.status.code(), Some(0 | 3 | 4)), "{compression:?}: {}: {err}", output.status);
            assert!(!err.contains("panic") && !err.contains("internal fault"), "{compression:?}: {err}");
        }
    }
}
