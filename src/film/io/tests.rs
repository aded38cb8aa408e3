//! What is written is what is read; the bytes are checked by another reader (the `exr` and `image` crates' own) as well.

use super::super::{Layer, Plane};
use super::*;
use exr::prelude as e;
use exr::prelude::WritableImage;

/// Values that a careless conversion would change: tiny, huge, negative, not representable in half floats.
fn picture(width: usize, height: usize) -> Image {
    let value = |i: usize| [i as f32 * 0.1 + 1e-30, 1e30 / (i + 1) as f32, -(i as f32) / 3.0];
    Image::from_pixels(width, height, (0..width * height).map(value).collect())
}

fn in_folder(test: impl FnOnce(&Path)) {
    let folder = tempfile::tempdir().unwrap();
    test(&folder.path().join("picture.exr"));
}

#[test]
fn exr_floats_come_back_to_the_bit() {
    for (width, height) in [(1, 1), (3, 2), (17, 33), (256, 5)] {
        in_folder(|path| {
            let image = picture(width, height);
            write_exr(path, &[Layer::main(image.clone())], &Header::default()).unwrap();
            assert_eq!(read_exr(path).unwrap(), image);
        });
    }
}

#[test]
fn nan_and_infinity_survive() {
    in_folder(|path| {
        let image = Image::from_pixels(1, 1, vec![[f32::NAN, f32::INFINITY, f32::NEG_INFINITY]]);
        write_exr(path, &[Layer::main(image)], &Header::default()).unwrap();
        let [r, g, b] = read_exr(path).unwrap().at(0, 0);
        assert!(r.is_nan() && g == f32::INFINITY && b == f32::NEG_INFINITY);
    });
}

#[test]
fn layers_share_one_part_under_the_names_that_viewers_expect() {
    in_folder(|path| {
        let (main, direct) = (picture(4, 3), Image::from_pixels(4, 3, vec![[1.0, 2.0, 3.0]; 12]));
        let normal = Image::from_pixels(4, 3, vec![[0.0, 0.6, 0.8]; 12]);
        let depth = Plane::from_values(4, 3, (0..12).map(|i| i as f32).collect());
        let layers = [Layer::main(main.clone()), Layer::rgb("direct", direct.clone()), Layer::xyz("normal", normal.clone())];
        let layers = [&layers[..], &[Layer::z("depth", depth.clone())]].concat();
        write_exr(path, &layers, &Header::default()).unwrap();
        assert_eq!(read_exr(path).unwrap(), main);
        assert_eq!(read_exr_layer(path, "direct", ["R", "G", "B"]).unwrap(), direct);
        assert_eq!(read_exr_layer(path, "normal", ["X", "Y", "Z"]).unwrap(), normal);

        let file = exr::prelude::read_all_flat_layers_from_file(path).unwrap();
        assert_eq!(file.layer_data.len(), 1, "one part");
        let list = &file.layer_data[0].channel_data.list;
        let names: Vec<String> = list.iter().map(|c| c.name.to_string()).collect();
        assert_eq!(names, ["B", "G", "R", "depth.Z", "direct.B", "direct.G", "direct.R", "normal.X", "normal.Y", "normal.Z"]);
        assert_eq!(list[3].sample_data, exr::prelude::FlatSamples::F32(depth.values().to_vec()));
    });
}

#[test]
fn header_attributes_are_kept() {
    in_folder(|path| {
        let matrix = std::array::from_fn(|i| i as f32);
        let header = Header::default().text("scene", "Küche").number("seconds", 12.5);
        let window = Window { x: 5, y: 7, full_width: 64, full_height: 48 };
        let header = Header { window: Some(window), world_to_camera: Some(matrix), ..header };
        write_exr(path, &[Layer::main(picture(2, 2))], &header).unwrap();
        let meta = e::MetaData::read_from_file(path, true).unwrap();
        let own = &meta.headers[0].own_attributes;
        assert_eq!(
            own.other[&e::Text::from_slice_unchecked(b"scene")],
            e::AttributeValue::Text(e::Text::from_slice_unchecked("Küche".as_bytes()))
        );
        assert_eq!(own.other[&e::Text::from_slice_unchecked(b"seconds")], e::AttributeValue::F64(12.5));
        assert_eq!(own.world_to_camera, Some(matrix));
        assert_eq!(own.layer_position, e::Vec2(5, 7));
        assert_eq!(meta.headers[0].shared_attributes.display_window.size, e::Vec2(64, 48));
        assert_eq!(read_exr(path).unwrap(), picture(2, 2));
    });
}

#[test]
fn half_floats_are_read() {
    in_folder(|path| {
        let half = |v: f32| e::f16::from_f32(v);
        e::write_rgb_file(path, 2, 1, |x, _| (half(x as f32), half(0.5), half(-2.0))).unwrap();
        assert_eq!(read_exr(path).unwrap().pixels(), [[0.0, 0.5, -2.0], [1.0, 0.5, -2.0]]);
    });
}

#[test]
fn a_luminance_picture_is_read_as_grey() {
    in_folder(|path| {
        let y = e::AnyChannel::new("Y", e::FlatSamples::F32(vec![0.25, 4.0]));
        let channels = e::AnyChannels::sort([y].into_iter().collect());
        e::Image::from_channels((2, 1), channels).write().to_file(path).unwrap();
        assert_eq!(read_exr(path).unwrap().pixels(), [[0.25; 3], [4.0; 3]]);
    });
}

#[test]
fn unreadable_files_are_named_with_the_reason() {
    in_folder(|path| {
        let message = |path: &Path| read_exr(path).unwrap_err().to_string();
        assert!(matches!(read_exr(path).unwrap_err().kind, ReadErrorKind::Io(_)));
        std::fs::write(path, "not a picture").unwrap();
        assert!(message(path).contains("picture.exr: not a readable OpenEXR picture"), "{}", message(path));
        write_exr(path, &[Layer::rgb("direct", picture(2, 2))], &Header::default()).unwrap();
        assert!(message(path).contains("no channels R G B; the file has direct.B direct.G direct.R"), "{}", message(path));
    });
}

#[test]
fn a_truncated_file_is_an_error_at_every_length() {
    in_folder(|path| {
        write_exr(path, &[Layer::main(picture(40, 40))], &Header::default()).unwrap();
        let bytes = std::fs::read(path).unwrap();
        for part in 0..40 {
            std::fs::write(path, &bytes[..bytes.len() * part / 40]).unwrap();
            assert!(read_exr(path).is_err(), "{part}/40 of the file");
        }
    });
}

#[test]
fn a_header_that_claims_too_much_is_refused_before_allocation() {
    in_folder(|path| {
        write_exr(path, &[Layer::main(picture(2, 2))], &Header::default()).unwrap();
        let mut bytes = std::fs::read(path).unwrap();
        // The data window is four little-endian integers behind the name, the type and the size of the attribute.
        let name = b"dataWindow\0box2i\0";
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
        bytes[at + 8..at + 12].copy_from_slice(&2_000_000_i32.to_le_bytes());
        bytes[at + 12..at + 16].copy_from_slice(&2_000_000_i32.to_le_bytes());
        std::fs::write(path, &bytes).unwrap();
        let error = read_exr(path).unwrap_err();
        assert!(matches!(error.kind, ReadErrorKind::TooLarge { .. }), "{error}");
    });
}

#[test]
fn png_shows_the_tone_mapped_bytes() {
    in_folder(|path| {
        let path = path.with_extension("png");
        let image = Image::from_pixels(2, 1, vec![[0.0, 0.18, 0.5], [1.0, 2.0, f32::NAN]]);
        write_png(&path, &image, &ToneMap { exposure: 0.0, operator: Operator::Srgb }).unwrap();
        let shown = image::open(&path).unwrap().into_rgb8();
        assert_eq!(shown.get_pixel(0, 0).0, [0, 118, 188]);
        assert_eq!(shown.get_pixel(1, 0).0, [255, 0, 255]);
    });
}

#[test]
fn white_pixels_make_the_mask() {
    in_folder(|path| {
        let path = path.with_extension("png");
        write_png_bytes(&path, 3, 1, &[0, 0, 0, 255, 255, 255, 120, 120, 120]).unwrap();
        assert_eq!(read_mask(&path).unwrap(), Mask::from_values(3, 1, vec![false, true, false]));
        std::fs::write(&path, "x").unwrap();
        assert!(read_mask(&path).is_err());
    });
}
