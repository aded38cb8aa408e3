//! Models that are scenes by themselves: Wavefront OBJ with its MTL.

use crate::loading::Fixture;
use twopass::load::{LoadError, LoadOptions, LoadedScene, load_scene};
use twopass::material::Material;
use twopass::math::{DVec3, Rgb, Vec2, Vec3};
use twopass::scene::{Scene, Shape};

/// A unit square for each material named, one behind the other.
fn squares(materials: &[&str]) -> String {
    let square = |(i, name): (usize, &&str)| {
        format!(
            "usemtl {name}\nv 0 0 {i}\nv 1 0 {i}\nv 1 1 {i}\nv 0 1 {i}\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf -4/-4 -3/-3 -2/-2 -1/-1\n"
        )
    };
    "mtllib m.mtl\n".to_owned() + &materials.iter().enumerate().map(square).collect::<String>()
}

fn load(obj: &str, mtl: &str) -> Result<LoadedScene, LoadError> {
    let fixture = Fixture::new("").with("model.obj", obj).with("m.mtl", mtl).with("t.png", picture());
    load_scene(&fixture.folder().join("model.obj"), &LoadOptions::default())
}

fn scene(obj: &str, mtl: &str) -> Scene {
    load(obj, mtl).unwrap_or_else(|e| panic!("{e}")).scene
}

/// Two texels, one above the other: white over black.
fn picture() -> Vec<u8> {
    let mut bytes = Vec::new();
    let image = image::RgbImage::from_fn(1, 2, |_, y| image::Rgb(if y == 0 { [255; 3] } else { [0; 3] }));
    image.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).expect("encodes");
    bytes
}

fn shape<'s>(scene: &'s Scene, id: &str) -> (&'s Shape, &'s Material) {
    let shape = scene.shapes.iter().find(|s| s.id == id).unwrap_or_else(|| panic!("no shape {id}"));
    (shape, &scene.material_of(shape).material)
}

#[test]
fn a_bare_model_is_framed_under_a_sky() {
    let scene = scene("v 0 0 0\nv 4 0 0\nv 0 2 0\nf 1 2 3\n", "");
    assert_eq!((scene.n_triangles(), scene.escaped_radiance(Vec3::Y)), (1, Rgb::WHITE));
    assert_eq!(scene.name, "model");
    let middle = (DVec3::new(2.0, 1.0, 0.0) - scene.origin - scene.camera.to_scene.translation).normalize();
    assert!((scene.camera.forward().as_dvec3() - middle).length() < 1e-6, "looks at the middle of the box");
    assert_eq!(shape(&scene, "default").1.diffuse_reflectance(Vec2::ZERO), Rgb::grey(0.5));
}

#[test]
fn materials_follow_their_statements() {
    let mtl = "newmtl matt\nKd .5 .25 1\nillum 1\nKs 1 1 1\nnewmtl glass\nillum 7\nNi 1.3\nTf .9 .9 .8\nnewmtl pane\nd .1\n\
               newmtl mirror\nillum 5\nKs .9 .8 .7\nnewmtl steel\nKd .6 .5 .4\nPm 1\nPr .1\nnewmtl iron\nKd .6 .5 .4\nPm 1\nPr .9\n\
               newmtl lamp\nKe 3 2 1\nnewmtl leaf\nd .8\nKd .1 .2 .3\n";
    let names = ["matt", "glass", "pane", "mirror", "steel", "iron", "lamp", "leaf", "unknown"];
    let scene = scene(&squares(&names), mtl);
    assert_eq!(scene.shapes.iter().map(|s| s.id.as_str()).collect::<Vec<_>>(), names);
    let diffuse = |id: &str| shape(&scene, id).1.diffuse_reflectance(Vec2::ZERO);
    assert_eq!(diffuse("matt"), Rgb::new(0.5, 0.25, 1.0), "illum 1 has no highlight");
    assert!((diffuse("leaf") - Rgb::new(0.1, 0.2, 0.3) * 0.8).map(f64::abs).max() < 1e-12, "{:?}", diffuse("leaf"));
    assert_eq!(diffuse("unknown"), Rgb::grey(0.5));
    let Material::Dielectric { eta, transmittance, .. } = shape(&scene, "glass").1 else { panic!("glass") };
    assert_eq!((*eta, transmittance.at(Vec2::ZERO)), (1.3, Rgb::new(0.9, 0.9, 0.8)));
    assert!(matches!(shape(&scene, "pane").1, Material::ThinDielectric { .. }));
    let Material::Conductor { index: None, reflectance } = shape(&scene, "mirror").1 else { panic!("mirror") };
    assert_eq!(reflectance.at(Vec2::ZERO), Rgb::new(0.9, 0.8, 0.7));
    for (id, alpha) in [("steel", 0.01), ("iron", 0.81)] {
        let metal = shape(&scene, id).1;
        assert!((metal.roughness(Vec2::ZERO) - alpha).abs() < 1e-6, "{id}: {}", metal.roughness(Vec2::ZERO));
    }
    assert_eq!(shape(&scene, "lamp").0.emitted(Vec2::ZERO), Rgb::new(3.0, 2.0, 1.0));
    assert!(scene.environment.is_none(), "no sky where something emits");
    assert!(scene.warnings.iter().any(|w| w.contains("unknown")), "{:?}", scene.warnings);
}

#[test]
fn pictures_stand_upright() {
    let mtl = "newmtl plain\nKd 1 1 1\nillum 1\nmap_Kd t.png\nnewmtl tinted\nKd .5 1 1\nillum 1\nmap_Kd t.png\n\
               newmtl moved\nillum 1\nKd 0 0 0\nmap_Kd -o 0 .25 t.png\n";
    let scene = scene(&squares(&["plain", "tinted", "moved"]), mtl);
    let at = |id: &str, height: f32| {
        let (shape, material) = shape(&scene, id);
        let twopass::scene::ShapeSurface::Mesh(mesh) = &shape.surface else { panic!("a mesh") };
        let corner = |y: f32| mesh.positions.iter().position(|p| (f64::from(p.y) + scene.origin.y) as f32 == y).expect("there");
        let uv = mesh.uvs[corner(0.0)] * (1.0 - height) + mesh.uvs[corner(1.0)] * height;
        material.diffuse_reflectance(Vec2::new(0.5, uv.y))
    };
    assert_eq!((at("plain", 0.75), at("plain", 0.25)), (Rgb::WHITE, Rgb::BLACK));
    assert_eq!(at("tinted", 0.75), Rgb::new(0.5, 1.0, 1.0));
    // v + 1/4, in the file's sense: what stood at 3/4 comes down to 1/2.
    assert_eq!((at("moved", 0.5), at("moved", 0.0)), (Rgb::WHITE, Rgb::BLACK));
}

#[test]
fn faults_of_models_name_file_and_line() {
    let one = squares(&["a"]);
    for (obj, mtl, file, line, part) in [
        (one.as_str(), "newmtl a\nKd 2 0 0\n", "m.mtl", 2, "from 0 to 1"),
        (one.as_str(), "newmtl a\n\nmap_Kd x.png\n", "m.mtl", 3, "x.png"),
        (one.as_str(), "newmtl a\nmap_Kd ../../../../etc/passwd\n", "m.mtl", 2, "passwd"),
        ("v 0 0 0\nmtllib n.mtl\nf 1 1 1\n", "", "model.obj", 2, "n.mtl"),
        ("v 0 0 0\nf 1 2 3\n", "", "model.obj", 2, "vertex 2 of 1"),
    ] {
        let error = load(obj, mtl).expect_err(part);
        assert!(error.to_string().contains(part), "{error}, expected {part}");
        assert_eq!(
            (error.file.file_name().expect("a name").to_str(), error.at.expect("a place").line),
            (Some(file), line),
            "{error}"
        );
    }
    let error = load("v 0 0 0\n", "").expect_err("no faces").to_string();
    assert!(error.contains("a model with faces"), "{error}");
    let fixture = Fixture::new("").with("model.obj", "v 0 0 0\nf 1 1 1\n").define("a", "1");
    let error = load_scene(&fixture.folder().join("model.obj"), &fixture.options).expect_err("no parameters").to_string();
    assert!(error.contains("-D a"), "{error}");
}
