//! Options of mesh files and of cameras against what Mitsuba 3.9.1 reports for the same files.

use crate::loading::{Fixture, SENSOR, corners, scene};
use std::f64::consts::FRAC_1_SQRT_2;
use twopass::math::{DVec3, Vec2};
use twopass::scene::Scene;

/// A square and a triangle that leans against it; a quad and a triangle.
const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 2 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt .5 .75\n\
                   f 1/1 2/2 3/3 4/4\nf 4/4 3/3 5/5\n";

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                   property float u\nproperty float v\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
                   0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n.5 2 1 .5 .75\n4 0 1 2 3\n3 3 2 4\n";

/// The shape of `kind` with `extra` properties, in a scene of its own.
fn mesh(kind: &str, extra: &str) -> Scene {
    let body = format!("<shape type='{kind}'><string name='filename' value='m.{kind}'/>{extra}</shape>");
    Fixture::new(&body).with("m.obj", OBJ).with("m.ply", PLY).scene()
}

fn boolean(name: &str, value: bool) -> String {
    format!("<boolean name='{name}' value='{value}'/>")
}

/// Normal and uv of the vertex at `position`, wherever it occurs.
fn vertex(scene: &Scene, position: DVec3) -> (Option<DVec3>, Vec2) {
    let all = corners(scene, &scene.shapes[0]);
    let found = all.into_iter().flatten().find(|c| (c.0 - position).length() < 1e-6).expect("a vertex there");
    (found.1.map(|n| n.as_dvec3()), found.2)
}

#[test]
fn missing_normals_are_weighted_by_angle_after_the_transform() {
    let stretch = "<transform name='to_world'><scale x='1' y='3' z='.5'/></transform>";
    for kind in ["obj", "ply"] {
        // Vertices 0, 2 and 4 as Mitsuba has them.
        for (extra, scale, want) in [
            ("", DVec3::ONE, [[0.0, 0.0, 1.0], [0.0, -0.33584, 0.94192], [0.0, -FRAC_1_SQRT_2, FRAC_1_SQRT_2]]),
            (stretch, DVec3::new(1.0, 3.0, 0.5), [[0.0, 0.0, 1.0], [0.0, -0.07797, 0.99696], [0.0, -0.1644, 0.98639]]),
        ] {
            let scene = mesh(kind, extra);
            for (position, want) in [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.5, 2.0, 1.0)].into_iter().zip(want) {
                let n = vertex(&scene, position * scale).0.expect("smooth");
                assert!((n - DVec3::from(want)).length() < 1e-5, "{kind} {extra} {position}: {n}, expected {want:?}");
            }
        }
    }
}

#[test]
fn quads_are_split_at_their_first_corner_and_normals_flip() {
    for kind in ["obj", "ply"] {
        for (flip, side) in [(false, 1.0), (true, -1.0)] {
            for flat in [false, true] {
                let scene = mesh(kind, &(boolean("flip_normals", flip) + &boolean("face_normals", flat)));
                let all = corners(&scene, &scene.shapes[0]);
                assert_eq!(all.len(), 3, "{kind}");
                assert_eq!(all[0][0].0, all[1][0].0, "{kind}: both halves of the quad begin at its first corner");
                for triangle in &all {
                    assert_eq!(triangle[0].1.is_none(), flat, "{kind}");
                    let [a, b, c] = triangle.map(|c| c.0);
                    assert!((b - a).cross(c - a).z * side > 0.0, "{kind}, flipped: {flip}");
                }
                let normal = vertex(&scene, DVec3::ZERO).0;
                assert_eq!(normal, (!flat).then_some(DVec3::Z * side), "{kind}, flipped: {flip}");
            }
        }
    }
}

#[test]
fn texture_coordinates_flip_by_default_in_obj_only() {
    for (kind, extra, v) in [
        ("obj", String::new(), 0.25),
        ("obj", boolean("flip_tex_coords", true), 0.25),
        ("obj", boolean("flip_tex_coords", false), 0.75),
        ("ply", String::new(), 0.75),
        ("ply", boolean("flip_tex_coords", true), 0.25),
    ] {
        let uv = vertex(&mesh(kind, &extra), DVec3::new(0.5, 2.0, 1.0)).1;
        assert_eq!(uv, Vec2::new(0.5, v), "{kind} {extra}");
    }
}

/// A compressed mesh of one triangle, made by hand: stored blocks of zlib need no compressor.
fn serialized() -> Vec<u8> {
    let mut body = Vec::new();
    body.extend(0x1000_u32.to_le_bytes());
    body.extend(b"\0");
    body.extend(3_u64.to_le_bytes());
    body.extend(1_u64.to_le_bytes());
    for v in [0.0_f32, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0, 0.0] {
        body.extend(v.to_le_bytes());
    }
    [0_u32, 1, 2].iter().for_each(|i| body.extend(i.to_le_bytes()));
    let length = body.len() as u16;
    let mut file = vec![0x1c, 0x04, 0x04, 0x00, 0x78, 0x01, 0x01];
    file.extend(length.to_le_bytes());
    file.extend((!length).to_le_bytes());
    let adler = body.iter().fold((1_u32, 0_u32), |(a, b), byte| {
        let a = (a + u32::from(*byte)) % 65_521;
        (a, (a + b) % 65_521)
    });
    file.extend(body);
    file.extend((adler.1 << 16 | adler.0).to_be_bytes());
    file.extend(0_u64.to_le_bytes());
    file.extend(1_u32.to_le_bytes());
    file
}

#[test]
fn serialized_meshes_are_shapes_like_others() {
    let shape = |extra: &str| format!("<shape type='serialized'><string name='filename' value='m.serialized'/>{extra}</shape>");
    let load = |extra: &str| Fixture::new(&shape(extra)).with("m.serialized", serialized()).load();
    let scene = load("<integer name='shape_index' value='0'/>").expect("valid").scene;
    assert!((scene.shapes[0].area() - 2.0).abs() < 1e-6);
    for (extra, part) in [
        ("<integer name='shape_index' value='1'/>", "a file of 1"),
        ("<integer name='shape_index' value='-1'/>", "0 or more"),
        ("<boolean name='flip_tex_coords' value='true'/>", "no property"),
    ] {
        let error = load(extra).expect_err("must be refused").to_string();
        assert!(error.contains(part), "{extra}: {error}");
    }
}

/// A scene whose sensor has `kind` and, before its film, `extra`; its film `film`.
fn camera(kind: &str, extra: &str, film: &str) -> Fixture {
    let sensor = SENSOR.replace("'perspective'", "").replace("\"perspective\"", &format!("\"{kind}\""));
    let sensor = sensor.replace("<film", &format!("{extra}<film")).replace("<rfilter", &format!("{film}<rfilter"));
    Fixture::whole(format!("<scene version='3.0.0'>{sensor}</scene>"))
}

#[test]
fn a_thin_lens_is_a_pinhole_with_a_warning() {
    let lens = "<float name='aperture_radius' value='.1'/><float name='focus_distance' value='2'/>";
    let scene = camera("thinlens", lens, "").scene();
    assert!(scene.warnings.iter().any(|w| w.contains("depth of field is not rendered")), "{:?}", scene.warnings);
    let tan = 20.0_f64.to_radians().tan();
    assert!((scene.camera.half_width(8, 4) - tan).abs() < 1e-12);
    let error = camera("thinlens", "", "").load().expect_err("Mitsuba refuses it too").to_string();
    assert!(error.contains("aperture_radius"), "{error}");
}

#[test]
fn the_principal_point_is_read() {
    let offsets = "<float name='principal_point_offset_x' value='.1'/><float name='principal_point_offset_y' value='.2'/>";
    let scene = camera("perspective", offsets, "").scene();
    let d = scene.camera.ray(Vec2::new(2.0, 2.0), 8, 4).direction;
    assert!((d.x / d.z - 0.109191).abs() < 1e-5 && (d.y / d.z + 0.072794).abs() < 1e-5, "{d}");
}

#[test]
fn focal_lengths_span_the_diagonal_of_a_35_mm_film() {
    // Mitsuba: x over z at the left border of a film of 8 x 4.
    for (text, want) in [("50mm", 0.386988), ("35", 0.552840)] {
        let fixture = camera("perspective", &format!("<string name='focal_length' value='{text}'/>"), "");
        let file = std::fs::read_to_string(fixture.path()).expect("written").replace("<float name=\"fov\" value=\"40\"/>", "");
        let got = Fixture::whole(file).scene().camera.half_width(8, 4);
        assert!((got - want).abs() < 1e-6, "{text}: {got}, expected {want}");
    }
}

#[test]
fn a_crop_is_handed_on_and_must_lie_inside_the_film() {
    let integers = |x: i32, y: i32, w: i32, h: i32| {
        [("offset_x", x), ("offset_y", y), ("width", w), ("height", h)]
            .map(|(n, v)| format!("<integer name='crop_{n}' value='{v}'/>"))
            .concat()
    };
    let load = |x, y, w, h| camera("perspective", "", &integers(x, y, w, h)).load();
    assert_eq!(load(2, 1, 4, 2).expect("valid").crop, Some([2, 1, 4, 2]));
    assert_eq!(load(0, 0, 8, 4).expect("valid").crop, None);
    for (x, y, w, h) in [(8, 0, 1, 1), (2, 0, 7, 4), (0, 0, 0, 4), (-1, 0, 1, 1), (0, 3, 8, 2)] {
        let error = load(x, y, w, h).expect_err("must be refused").to_string();
        assert!(error.contains("inside the film"), "{error}");
    }
    let offset = "<integer name='crop_offset_x' value='2'/>";
    let error = camera("perspective", "", offset).load().expect_err("the film's width, from 2 on").to_string();
    assert!(error.contains("inside the film"), "{error}");
    assert_eq!(scene("").film.width, 8, "a crop does not change the film's size");
}
