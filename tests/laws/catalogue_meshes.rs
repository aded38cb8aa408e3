//! Bad meshes and odd text on the built program: rows C8 to C14 of the catalogue in `catalogue.rs`.

use crate::catalogue::{Case, mesh_shape, scene};
use crate::loading::Fixture;

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

fn obj(text: impl AsRef<[u8]>) -> Case {
    Case::new(&mesh_shape("m.obj")).with("m.obj", text)
}

fn ply(bytes: impl AsRef<[u8]>) -> Case {
    Case::new(&mesh_shape("m.ply")).with("m.ply", bytes)
}

fn triangles(case: &Case) -> usize {
    let out = case.accepted();
    let line = out.lines().find_map(|l| l.strip_prefix("triangles ")).unwrap_or_else(|| panic!("no figure in {out}"));
    line.trim().parse().expect("a number")
}

#[test]
fn c8_obj_indices_that_do_not_exist() {
    for index in ["0", "99", "99999999999999999999", "-5", "-99999999999999999999"] {
        let words = format!("vertex {index} of 3");
        obj(format!("{SQUARE}f 1 2 {index}\n")).refused(3, &["m.obj:4:1", "line 4", &words, "expected"]);
    }
    obj(format!("{SQUARE}f 1/1 2/1 3/1\n")).refused(3, &["m.obj:4:1", "texture coordinate 1 of 0"]);
    obj(format!("{SQUARE}f 1//1 2//1 3//1\n")).refused(3, &["m.obj:4:1", "normal 1 of 0"]);
    obj(format!("f 1 2 3\n{SQUARE}")).refused(3, &["m.obj:1:1", "vertex 1 of 0"]);
}

#[test]
fn c9_negative_obj_indices_count_from_their_line() {
    assert_eq!(triangles(&obj(format!("{SQUARE}f -3 -2 -1\nv 5 5 5\nf -1 -2 -3\n"))), 2);
}

#[test]
fn c10_polygons_of_few_and_of_many_vertices() {
    let ring = |n: usize| -> String {
        let vertex = |i: usize| (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
        let vertices: String = (0..n).map(|i| format!("v {:.6} {:.6} 0\n", vertex(i).0, vertex(i).1)).collect();
        let face: String = (1..=n).map(|i| format!(" {i}")).collect();
        format!("{vertices}f{face}\n")
    };
    for n in [4, 17, 1000] {
        assert_eq!(triangles(&obj(ring(n))), n - 2);
    }
    for face in ["f", "f 1", "f 1 2"] {
        obj(format!("{SQUARE}{face}\n")).refused(3, &["m.obj:4:1", "three vertices or more"]);
    }
    let many = |n: usize| format!("{SQUARE}f{}\n", " 1 2 3".repeat(n / 3));
    obj(many(999_999)).refused(4, &["m.obj:4:1", "corners", "65536"]);
    // As many as are allowed.
    let fixture = Fixture::new(&mesh_shape("m.obj")).with("m.obj", many(65_535));
    fixture.load().unwrap_or_else(|e| panic!("{e}"));
}

#[test]
fn c11_coordinates_that_are_no_numbers() {
    for value in ["nan", "inf", "-inf", "1e400", "0x10", "1,5"] {
        obj(format!("v 0 {value} 0\n")).refused(3, &["m.obj:1:1", "a finite number", value]);
    }
    let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    for value in ["nan", "inf", "1e400"] {
        ply(format!("{head}0 0 0\n1 0 {value}\n0 1 0\n3 0 1 2\n")).refused(3, &["m.ply:11:1", "finite", "vertex 1"]);
    }
    // Finite, but their squares are not.
    obj(format!("{SQUARE}v 0 1e300 0\nf 1 2 4\n")).refused(3, &["scene.xml:3:1", "vertex", "beyond 1e18"]);
    for sphere in ["<point name='center' x='1e308' y='0' z='0'/>", "<float name='radius' value='1e300'/>"] {
        Case::new(&format!("<shape type='sphere'>{sphere}</shape>")).refused(3, &["scene.xml:3:1", "1e18"]);
    }
}

/// A binary PLY of one triangle whose counts and third index are given.
fn binary_ply(vertices: &str, faces: &str, corners: u8, index: i32) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    bytes.push(corners);
    [0, 1, index].iter().for_each(|i| bytes.extend(i.to_le_bytes()));
    bytes
}

#[test]
fn c12_ply_counts_that_the_file_cannot_hold() {
    assert_eq!(triangles(&ply(binary_ply("3", "1", 3, 2))), 1);
    for (vertices, faces, words) in [
        ("4000000000", "1", ["4000000000", "as many items \"vertex\""]),
        ("3", "4000000000", ["4000000000", "as many items \"face\""]),
        ("18446744073709551615", "1", ["18446744073709551615", "as many items"]),
        ("-1", "1", ["m.ply:3:1", "count"]),
        ("100000000000000000000", "1", ["m.ply:3:1", "count"]),
        ("4", "1", ["m.ply", "expected"]),
        ("2", "1", ["m.ply", "expected"]),
    ] {
        ply(binary_ply(vertices, faces, 3, 2)).refused(3, &[&["m.ply"], words.as_slice()].concat());
    }
    let whole = binary_ply("3", "1", 3, 2);
    for n in [1, 3, 40, 160, whole.len() - 1] {
        ply(&whole[..n]).refused(3, &["m.ply", "expected"]);
    }
    ply([whole, vec![0; 7]].concat()).refused(3, &["m.ply", "the end of the file", "7 bytes more"]);
    ply(binary_ply("3", "1", 255, 2)).refused(3, &["m.ply", "more data"]);
    ply(binary_ply("3", "1", 2, 2)).refused(3, &["m.ply", "three vertices", "at byte"]);
}

#[test]
fn c13_ply_indices_that_do_not_exist() {
    let header = binary_ply("3", "1", 3, 2).len() - 13;
    for index in [3, 77, -1, i32::MAX, i32::MIN] {
        let (found, place) = (format!("vertex {index} in face 0"), format!("at byte {header}"));
        ply(binary_ply("3", "1", 3, index)).refused(3, &["m.ply", "vertices from 0", &found, &place]);
    }
}

/// Each pair of triangles in one place, were it looked at, would take seconds.
#[test]
fn c13_one_face_thousands_of_times_takes_no_longer() {
    let one = binary_ply("3", "21845", 3, 2);
    let face = one[one.len() - 13..].repeat(21_844);
    assert_eq!(triangles(&ply([one, face].concat())), 21_845);
}

#[test]
fn c14_odd_text_is_defined() {
    let body = mesh_shape("m.obj");
    let mesh = format!("{SQUARE}f 1 2 3\n");
    let with_bom = |text: &str| format!("\u{feff}{text}");
    let crlf = |text: &str| text.replace('\n', "\r\n");
    assert_eq!(triangles(&Case::whole(with_bom(&crlf(&scene(&body)))).with("m.obj", with_bom(&crlf(&mesh)))), 1);
    // The place does not move with the mark or the line ends.
    obj(with_bom(&crlf(&format!("{SQUARE}f 1 2 9\n")))).refused(3, &["m.obj:4:1", "vertex 9 of 3"]);
    // Comments are in any encoding; numbers are not.
    assert_eq!(triangles(&obj([b"# caf\xe9\n", mesh.as_bytes()].concat())), 1);
    obj(b"v 0 0 \xff\n").refused(3, &["m.obj:1:1", "a finite number"]);
    obj(b"v 0 0 1\x00\n").refused(3, &["m.obj:1:1", "a finite number"]);
    Case::whole(b"<scene version='3.0.0'>\n\xff</scene>").refused(3, &["scene.xml", "UTF-8", "offset 24"]);
    Case::whole(b"<scene version='3.0.0'>\n\x00</scene>").refused(3, &["scene.xml:2:1"]);
    let utf16: Vec<u8> = "<scene/>".encode_utf16().flat_map(u16::to_le_bytes).collect();
    Case::whole([b"\xff\xfe".as_slice(), &utf16].concat()).refused(3, &["scene.xml", "UTF-8"]);
}

#[test]
fn c14_lines_of_a_hundred_megabytes_are_over_a_limit() {
    let long = |head: &str, fill: &str| format!("{head}{}", fill.repeat(100_000_000 / fill.len()));
    Case::whole(long("<scene version='3.0.0'>", "<!-- -->")).refused(4, &["scene.xml", "size of", "bytes"]);
    obj(long(SQUARE, "f 1 2 3 ")).refused(4, &["m.obj:4:1", "bytes of line 4"]);
    obj(long("# ", "x")).refused(4, &["m.obj:1:1", "bytes of line 1"]);
    ply(long("ply\ncomment ", "x")).refused(3, &["m.ply", "end_header"]);
}

#[test]
fn c10_triangles_of_all_shapes_together_have_a_limit() {
    let square = format!("{SQUARE}f 1 2 3\nf 3 2 1\n");
    for (body, n) in [("<shape type='cube'/>\n".repeat(3), 36), (mesh_shape("m.obj").repeat(5), 10)] {
        let mut fixture = Fixture::new(&body).with("m.obj", &square);
        fixture.options.limits.triangles = n;
        assert!(fixture.load().is_ok());
        fixture.options.limits.triangles = n - 1;
        let error = fixture.load().expect_err("one too many");
        assert!(error.at.is_some() && error.to_string().contains(&format!("triangles of all shapes: {n} is over")), "{error}");
    }
    // A flipped sphere is 75 bytes of text and thousands of triangles.
    let flipped = "<shape type='sphere'><boolean name='flip_normals' value='true'/></shape>";
    let mut many = Fixture::new(&flipped.repeat(2000));
    many.options.limits.triangles = 1 << 17;
    assert_eq!(many.load().expect_err("too many").kind.fault(), twopass::load::Fault::OverLimit);
}
