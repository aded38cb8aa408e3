//! glTF 2.0: what its specification says of nodes, meshes, cameras, lights and materials.

use crate::loading::{Fixture, corners};
use base64::Engine;
use twopass::load::{LoadError, LoadErrorKind, LoadOptions, LoadedScene, load_scene};
use twopass::material::Material;
use twopass::math::{DVec3, Rgb, Vec2, Vec3};
use twopass::scene::Scene;

/// A unit square in the plane z = 0: four positions, four uvs, six indices; 80 + 12 bytes.
fn square() -> Vec<u8> {
    let positions = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let uvs = [[0.0_f32, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    let reals = positions.iter().flatten().chain(uvs.iter().flatten());
    let mut bytes: Vec<u8> = reals.flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes
}

const ACCESSORS: &str = r#""bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":32},
    {"buffer":0,"byteOffset":80,"byteLength":12}],
  "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
    {"bufferView":1,"componentType":5126,"count":4,"type":"VEC2"},{"bufferView":2,"componentType":5123,"count":6,"type":"SCALAR"}]"#;

/// A file whose buffer is the square, at `uri`; `rest` has its other members.
fn file(uri: &str, nodes: &str, rest: &str) -> String {
    let mesh = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"indices":2,"material":0}]}]"#;
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{nodes}],{mesh},{rest},\
         \"buffers\":[{{\"byteLength\":92,\"uri\":\"{uri}\"}}],{ACCESSORS}}}"
    )
}

fn data_uri(kind: &str, bytes: &[u8]) -> String {
    format!("data:{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

fn load(text: &str) -> Result<LoadedScene, LoadError> {
    let fixture = Fixture::new("").with("model.gltf", text).with("a b.bin", square());
    load_scene(&fixture.folder().join("model.gltf"), &LoadOptions::default())
}

/// The scene of a file with these nodes and one material.
fn scene(nodes: &str, material: &str) -> Scene {
    let text = file(&data_uri("application/octet-stream", &square()), nodes, &format!("\"materials\":[{{{material}}}]"));
    load(&text).unwrap_or_else(|e| panic!("{e}")).scene
}

fn material(members: &str) -> (Scene, Material) {
    let scene = scene("{\"mesh\":0}", members);
    let material = scene.material_of(&scene.shapes[0]).material.clone();
    (scene, material)
}

#[test]
fn nodes_apply_parent_after_child_and_scale_before_turn_before_move() {
    // A quarter turn about y, (0, sin 45, 0, cos 45), takes +x to -z.
    let nodes = r#"{"translation":[10,0,0],"children":[1]},
        {"mesh":0,"scale":[2,3,1],"rotation":[0,0.7071067811865476,0,0.7071067811865476],"translation":[0,5,0]}"#;
    let scene = scene(nodes, "");
    let found = corners(&scene, &scene.shapes[0]);
    let want = [DVec3::new(10.0, 5.0, 0.0), DVec3::new(10.0, 5.0, -2.0), DVec3::new(10.0, 8.0, -2.0)];
    for (corner, want) in found[0].iter().zip(want) {
        assert!((corner.0 - want).length() < 1e-5, "{}, expected {want}", corner.0);
    }
    assert!(found[0][0].1.is_none(), "without normals faces are flat");
    assert_eq!(found[0][2].2, Vec2::new(1.0, 0.0), "v points down already");
    assert_eq!(scene.escaped_radiance(Vec3::Y), Rgb::WHITE, "a sky where nothing emits");
}

#[test]
fn mirrored_nodes_keep_their_front() {
    let scene = scene(r#"{"mesh":0,"scale":[-1,1,1]}"#, "");
    for triangle in corners(&scene, &scene.shapes[0]) {
        let [a, b, c] = triangle.map(|c| c.0);
        assert!((b - a).cross(c - a).z > 0.0);
    }
}

#[test]
fn cameras_look_along_minus_z_with_plus_x_to_the_right() {
    let nodes = r#"{"mesh":0,"children":[1]},{"camera":0,"translation":[1,2,3]}"#;
    let camera = r#""materials":[{}],"cameras":[{"type":"perspective","perspective":{"yfov":0.5,"znear":0.1,"aspectRatio":2}}]"#;
    let scene = load(&file("a%20b.bin", nodes, camera)).unwrap_or_else(|e| panic!("{e}")).scene;
    assert_eq!(scene.camera.to_scene.translation + scene.origin, DVec3::new(1.0, 2.0, 3.0));
    let (width, height) = (scene.film.width, scene.film.height);
    assert_eq!((width, height), (768, 384));
    let ray = scene.camera.ray(Vec2::new(width as f32, 0.0), width, height);
    let want = DVec3::new(2.0 * 0.25_f64.tan(), 0.25_f64.tan(), -1.0).normalize();
    assert!((ray.direction.as_dvec3() - want).length() < 1e-6, "{}, expected {want}", ray.direction);
}

#[test]
fn materials_become_their_nearest_form() {
    let (scene, diffuse) = material(
        r#""doubleSided":true,"pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,1,1],"metallicFactor":0},"emissiveFactor":[1,0.5,0],
        "extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":6}}"#,
    );
    let rho = diffuse.diffuse_reflectance(Vec2::ZERO);
    assert!((rho.r / rho.g - 2.0).abs() < 1e-9 && rho.g > 0.2 && rho.b <= 1.0, "{rho:?}");
    assert!(scene.materials[0].two_sided);
    assert_eq!(scene.shapes[0].emitted(Vec2::ZERO), Rgb::new(6.0, 3.0, 0.0));
    assert!(scene.environment.is_none());
    let metal = r#""pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,1,1],"roughnessFactor":"#;
    let (scene, mirror) = material(&format!("{metal}0.1}}"));
    assert!(!scene.materials[0].two_sided);
    // Seen straight on, a metal reflects its base colour.
    let straight = |metal: &Material| metal.glossy_albedo(Vec3::Z, Vec2::ZERO);
    for (channel, want) in [0.5, 0.25, 1.0].into_iter().enumerate() {
        assert!((straight(&mirror)[channel] - want).abs() < 0.02, "{:?}", straight(&mirror));
    }
    assert!((mirror.roughness(Vec2::ZERO) - 0.01).abs() < 1e-3, "alpha is the square of the roughness");
    let (_, rough) = material(&format!("{metal}0.9}}"));
    assert!((rough.roughness(Vec2::ZERO) - 0.81).abs() < 1e-3);
    let glass = r#""KHR_materials_transmission":{"transmissionFactor":1},"KHR_materials_ior":{"ior":1.4}"#;
    let (_, thin) = material(&format!("\"extensions\":{{{glass}}}"));
    assert!(matches!(thin, Material::ThinDielectric { .. }), "without a volume the wall is thin");
    let (_, solid) = material(&format!("\"extensions\":{{{glass},\"KHR_materials_volume\":{{\"thicknessFactor\":1}}}}"));
    assert!(matches!(solid, Material::Dielectric { eta, .. } if (eta - 1.4).abs() < 1e-6));
}

#[test]
fn pictures_are_upright_and_moved_by_the_extension() {
    let mut png = Vec::new();
    let image = image::RgbImage::from_fn(1, 2, |_, y| image::Rgb(if y == 0 { [255; 3] } else { [0; 3] }));
    image.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).expect("encodes");
    let rest = |extension: &str| {
        format!(
            "\"materials\":[{{\"pbrMetallicRoughness\":{{\"metallicFactor\":0,\"baseColorFactor\":[0.25,0.5,0.5,1],\
             \"baseColorTexture\":{{\"index\":0{extension}}}}}}}],\
             \"textures\":[{{\"source\":0}}],\"images\":[{{\"uri\":\"{}\"}}]",
            data_uri("image/png", &png)
        )
    };
    let at = |extension: &str, height: f32| {
        let scene = load(&file("a%20b.bin", "{\"mesh\":0}", &rest(extension))).unwrap_or_else(|e| panic!("{e}")).scene;
        // uv of the square's corners: v is 1 at y = 0.
        scene.material_of(&scene.shapes[0]).material.diffuse_reflectance(Vec2::new(0.5, 1.0 - height))
    };
    let tinted = |rho: Rgb| (rho.r / rho.g - 0.5).abs() < 1e-9 && rho.g > 0.4;
    assert!(tinted(at("", 0.75)) && at("", 0.25).is_black());
    let moved = ",\"extensions\":{\"KHR_texture_transform\":{\"offset\":[0,0.5]}}";
    assert!(at(moved, 0.75).is_black() && tinted(at(moved, 0.25)));
}

#[test]
fn points_spots_and_suns_are_read() {
    let nodes = r#"{"mesh":0,"children":[1,2,3]},{"translation":[0,0,4],"extensions":{"KHR_lights_punctual":{"light":0}}},
        {"extensions":{"KHR_lights_punctual":{"light":1}}},{"translation":[0,0,5],"extensions":{"KHR_lights_punctual":{"light":2}}}"#;
    let rest = r#""materials":[{}],"extensions":{"KHR_lights_punctual":{"lights":[
        {"type":"point","color":[1,0.5,0.25],"intensity":8},{"type":"directional","intensity":2},{"type":"spot","intensity":3,"spot":{"innerConeAngle":0.1,"outerConeAngle":0.2}}]}}"#;
    let scene = load(&file("a%20b.bin", nodes, rest)).unwrap_or_else(|e| panic!("{e}")).scene;
    let at = |light: usize| scene.lights[light].sample((DVec3::ZERO - scene.origin).as_vec3(), None, Vec2::ZERO).expect("lit");
    // By the inverse square of the distance, and along -z for the others.
    for (channel, want) in [0.5, 0.25, 0.125].into_iter().enumerate() {
        assert!((at(0).irradiance[channel] - want).abs() < 1e-6, "{:?}", at(0).irradiance);
    }
    assert_eq!((at(1).direction, at(1).irradiance), (Vec3::Z, Rgb::grey(2.0)));
    assert!((at(2).irradiance.g - 3.0 / 25.0).abs() < 1e-6, "{:?}", at(2).irradiance);
}

#[test]
fn the_binary_form_says_the_same_and_strips_alternate() {
    let text = file("-", r#"{"mesh":0}"#, "\"materials\":[{}]").replace(",\"uri\":\"-\"", "");
    // A strip over the four corners in the order of the buffer.
    let text = text.replace("\"indices\":2,", "\"mode\":5,");
    let pad = |mut bytes: Vec<u8>, with: u8| {
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let (json, bin) = (pad(text.into_bytes(), b' '), pad(square(), 0));
    let mut glb = b"glTF".to_vec();
    for word in [2_u32, (28 + json.len() + bin.len()) as u32, json.len() as u32] {
        glb.extend(word.to_le_bytes());
    }
    glb.extend(b"JSON");
    glb.extend(&json);
    glb.extend((bin.len() as u32).to_le_bytes());
    glb.extend(b"BIN\0");
    glb.extend(&bin);
    let fixture = Fixture::new("").with("model.glb", &glb);
    let load = || load_scene(&fixture.folder().join("model.glb"), &LoadOptions::default());
    let scene = load().unwrap_or_else(|e| panic!("{e}")).scene;
    let found = corners(&scene, &scene.shapes[0]);
    let (a, b, c, d) = (DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y);
    for (triangle, want) in found.iter().zip([[a, b, c], [c, b, d]]) {
        assert!(triangle.iter().zip(want).all(|(corner, want)| (corner.0 - want).length() < 1e-6), "{triangle:?}");
    }
    for n in 0..glb.len() {
        std::fs::write(fixture.folder().join("model.glb"), &glb[..n]).expect("written");
        assert!(load().is_err(), "{n} of {} bytes", glb.len());
    }
    for length in [0_u32, 11, 12, u32::MAX] {
        glb[8..12].copy_from_slice(&length.to_le_bytes());
        std::fs::write(fixture.folder().join("model.glb"), &glb).expect("written");
        assert!(length == 12 || load().is_err(), "a file that says it has {length} bytes");
    }
}

#[test]
fn false_extents_and_trees_are_refused() {
    let uri = data_uri("application/octet-stream", &square());
    let good = file(&uri, r#"{"mesh":0}"#, "\"materials\":[{}]");
    for (from, to, part) in [
        ("\"count\":4,\"type\":\"VEC3\"", "\"count\":5,\"type\":\"VEC3\"", "items inside"),
        ("\"count\":4,\"type\":\"VEC3\"", "\"count\":4000000000,\"type\":\"VEC3\"", ""),
        ("\"count\":4,\"type\":\"VEC2\"", "\"count\":3,\"type\":\"VEC2\"", "4 texture coordinates"),
        ("\"byteOffset\":80,\"byteLength\":12", "\"byteOffset\":81,\"byteLength\":12", "view inside"),
        ("\"byteOffset\":80,\"byteLength\":12", "\"byteOffset\":79,\"byteLength\":12", "vertices below 4"),
        ("\"byteLength\":92", "\"byteLength\":93", "93 bytes"),
        ("\"componentType\":5123", "\"componentType\":5126", "unsigned type"),
        ("{\"mesh\":0}", "{\"mesh\":0,\"children\":[0]}", ""),
        ("{\"mesh\":0}", "{\"mesh\":7}", ""),
        (";base64,", ";base99,", "base64"),
        ("\"TEXCOORD_0\":1", "\"TEXCOORD_0\":0", "2 numbers"),
        ("[{}]", "[{\"emissiveFactor\":[2,0,0]}]", "from 0 to 1"),
    ] {
        assert!(good.contains(from), "{from}");
        let error = load(&good.replacen(from, to, 1)).expect_err(to).to_string();
        assert!(error.contains(part), "{to}: {error}");
    }
    let outside = file("../../../../etc/passwd", "{\"mesh\":0}", "\"materials\":[{}]");
    let error = load(&outside).expect_err("outside");
    assert!(matches!(error.kind, LoadErrorKind::PathNotAllowed { .. } | LoadErrorKind::Unreadable { .. }), "{error}");
    assert!(load("{").expect_err("no JSON").to_string().contains("line 1"));
}

/// Members that the crate which reads the JSON unwraps without having asked for them, and an index that it follows unchecked.
#[test]
fn members_taken_for_granted_are_asked_for() {
    let material =
        "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0}}}],\"textures\":[{\"source\":0}]";
    let camera = |members: &str| format!("\"materials\":[{{}}],\"cameras\":[{{{members}}}]");
    let orthographic = r#""orthographic":{"xmag":1,"ymag":1,"znear":0.1,"zfar":9}"#;
    let perspective = r#""perspective":{"yfov":0.5,"znear":0.1}"#;
    for (rest, part) in [
        (format!("{material},\"images\":[{{}}]"), "an image with a bufferView or a uri, found neither in image 0"),
        (format!("{material},\"images\":[{{\"mimeType\":\"image/png\"}}]"), "neither in image 0"),
        (format!("{material},\"images\":[{{\"bufferView\":0}}]"), "mimeType, found none in image 0"),
        (camera(&format!("\"type\":\"perspective\",{orthographic}")), "properties of its type, found none in camera 0"),
        (camera(&format!("\"type\":\"orthographic\",{perspective}")), "none in camera 0"),
    ] {
        let uri = data_uri("application/octet-stream", &square());
        let node = if rest.contains("cameras") { r#"{"mesh":0,"camera":0}"# } else { r#"{"mesh":0}"# };
        let error = load(&file(&uri, node, &rest)).expect_err(part).to_string();
        assert!(error.contains(part), "{error}, expected {part}");
    }
    let text = file("a%20b.bin", r#"{"mesh":0}"#, "\"materials\":[{}]").replace("\"POSITION\":0", "\"POSITION\":3");
    let error = load(&text).expect_err("no such accessor").to_string();
    assert!(error.contains("3 accessors, found accessor 3"), "{error}");
}

#[test]
fn triangles_are_counted_before_they_are_made() {
    let nodes: String = (1..=100).map(|i| format!(",{{\"mesh\":0,\"translation\":[0,0,{i}]}}")).collect();
    let children: Vec<String> = (1..=100).map(|i| i.to_string()).collect();
    let text = file("a%20b.bin", &format!("{{\"children\":[{}]}}{nodes}", children.join(",")), "\"materials\":[{}]");
    let fixture = Fixture::new("").with("model.gltf", text).with("a b.bin", square());
    let mut options = LoadOptions::default();
    let load = |options: &LoadOptions| load_scene(&fixture.folder().join("model.gltf"), options);
    options.limits.triangles = 199;
    let error = load(&options).expect_err("200 triangles");
    assert!(matches!(error.kind, LoadErrorKind::OverLimit { limit: 199, found: 200, .. }), "{error}");
    options.limits.triangles = 200;
    assert_eq!(load(&options).unwrap_or_else(|e| panic!("{e}")).scene.n_triangles(), 200);
}
