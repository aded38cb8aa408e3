//! Bad scene files: each gives a typed error with its place, never a panic, and takes neither time nor memory.

use crate::loading::{Fixture, SENSOR};
use twopass::load::{Fault, LoadError, LoadErrorKind};

/// The error of a scene that must not load, in less than a second.
fn fault(fixture: &Fixture) -> LoadError {
    let start = std::time::Instant::now();
    let error = fixture.load().expect_err("must be refused");
    let seconds = start.elapsed().as_secs_f64();
    assert!(seconds < 1.0, "{error} took {seconds} s");
    error
}

/// Checks class and words of the error of a scene with `body`, and that its place is where `at` begins.
fn refused(body: &str, at: &str, class: Fault, words: &str) {
    let error = fault(&Fixture::new(body));
    check(&error, class, words, body);
    let position = error.at.unwrap_or_else(|| panic!("{error} has no place"));
    let text = format!("<scene version=\"3.0.0\">{SENSOR}{body}</scene>");
    let found = &text[position.offset..];
    assert!(found.starts_with(at), "{body}: {error} points to {}", &found[..found.len().min(30)]);
    let before = &text[..position.offset];
    assert_eq!(position.line as usize, 1 + before.matches('\n').count(), "{body}");
}

fn check(error: &LoadError, class: Fault, words: &str, what: &str) {
    assert_eq!(error.kind.fault(), class, "{what}: {error}");
    assert!(error.to_string().contains(words), "{what}: {error}, expected the words {words:?}");
}

#[test]
fn malformed_xml_has_line_and_column() {
    for (text, line) in
        [("", 1), ("<scene version='3.0.0'>\n<shape", 2), ("<scene>\n\n</shape>", 3), ("hello", 1), ("<a><b></a>", 1)]
    {
        let error = fault(&Fixture::whole(text));
        check(&error, Fault::Invalid, "well-formed XML", text);
        assert_eq!(error.at.expect("a place").line, line, "{text}: {error}");
    }
    check(&fault(&Fixture::whole(b"\x89PNG\xff\x00")), Fault::Invalid, "UTF-8", "binary");
    check(&fault(&Fixture::whole(b"<scene>\0</scene>")), Fault::Invalid, "", "NUL");
    check(&fault(&Fixture::whole("<shape type='cube'/>")), Fault::Invalid, "<scene>", "another root");
}

#[test]
fn a_byte_order_mark_and_crlf_are_no_fault() {
    let text = format!("\u{feff}<?xml version='1.0'?>\r\n<scene version='3.0.0'>\r\n{SENSOR}\r\n</scene>\r\n");
    assert!(Fixture::whole(text).load().is_ok());
}

#[test]
fn document_types_are_refused() {
    let laughs = "<!DOCTYPE x [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'>]><scene version='3.0.0'>&b;</scene>";
    let external = "<!DOCTYPE x [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><scene version='3.0.0'>&a;</scene>";
    for text in [laughs, external] {
        check(&fault(&Fixture::whole(text)), Fault::Invalid, "DTD", text);
    }
}

#[test]
fn values_that_contain_values_do_not_explode() {
    let body: String = (1..40).map(|i| format!("<default name='p{i}' value='{}'/>", format!("$p{}", i - 1).repeat(8))).collect();
    let error = fault(&Fixture::new(&format!("<default name='p0' value='ha'/>{body}")));
    check(&error, Fault::OverLimit, "bytes that replace parameters", "laughs");
}

#[test]
fn deep_nesting_is_refused_before_it_is_parsed() {
    let nest = |n: usize| format!("<scene version='3.0.0'>{}{}</scene>", "<bsdf type='twosided'>".repeat(n), "</bsdf>".repeat(n));
    for n in [256, 257, 20_000, 500_000] {
        let error = fault(&Fixture::whole(nest(n)));
        check(&error, Fault::OverLimit, "depth of nested elements", &n.to_string());
        assert!(error.at.is_some());
    }
    // One less is refused for another reason.
    assert_eq!(fault(&Fixture::whole(nest(255))).kind.fault(), Fault::Invalid);
}

#[test]
fn includes_are_bounded() {
    let include = |name: &str| format!("<scene version='3.0.0'><include filename='{name}'/></scene>");
    let itself = Fixture::whole(include("scene.xml"));
    check(&fault(&itself), Fault::Invalid, "contains itself", "self");
    let pair = Fixture::whole(include("b.xml")).with("b.xml", include("scene.xml"));
    check(&fault(&pair), Fault::Invalid, "contains itself", "cycle");
    let mut chain = Fixture::whole(include("1.xml"));
    for i in 1..=20 {
        chain = chain.with(&format!("{i}.xml"), include(&format!("{}.xml", i + 1)));
    }
    check(&fault(&chain), Fault::OverLimit, "depth of includes", "chain");
    // Each file includes the next four times: 4^14 inclusions, were they all made.
    let mut fan = Fixture::whole(include("1.xml"));
    for i in 1..=14 {
        let line = format!("<include filename='{}.xml'/>", i + 1).repeat(4);
        fan = fan.with(&format!("{i}.xml"), format!("<scene version='3.0.0'>{line}</scene>"));
    }
    check(&fault(&fan.with("15.xml", "<scene version='3.0.0'></scene>")), Fault::OverLimit, "number of includes", "fan");
}

#[test]
fn paths_outside_the_folder_need_permission() {
    let outside = tempfile::TempDir::new().expect("a folder");
    let file = outside.path().join("secret.obj");
    std::fs::write(&file, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("written");
    let shape = |name: &str| format!("<shape type='obj'><string name='filename' value='{name}'/></shape>");
    let absolute = file.to_string_lossy().into_owned();
    let relative = format!("../{}/secret.obj", outside.path().file_name().expect("a name").to_string_lossy());
    for name in [absolute.as_str(), &relative, "link.obj", "/etc/passwd", "../../../../../../../etc/passwd"] {
        let mut fixture = Fixture::new(&shape(name));
        #[cfg(unix)]
        std::os::unix::fs::symlink(&file, fixture.folder().join("link.obj")).expect("linked");
        let error = fault(&fixture);
        assert!(matches!(error.kind, LoadErrorKind::PathNotAllowed { .. }), "{name}: {error}");
        if !name.contains("passwd") {
            fixture.options.allow_paths.push(outside.path().to_owned());
            assert!(fixture.load().is_ok(), "{name} with permission");
        }
    }
}

#[cfg(unix)]
#[test]
fn the_scene_file_itself_may_be_a_link() {
    let target = Fixture::new("<shape type='cube'/>");
    let folder = tempfile::TempDir::new().expect("a folder");
    let link = folder.path().join("scene.xml");
    std::os::unix::fs::symlink(target.path(), &link).expect("linked");
    let loaded = twopass::load::load_scene(&link, &Default::default()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(loaded.hash, target.load().expect("valid").hash);
    assert_eq!(loaded.scene.name, folder.path().file_name().expect("a name").to_string_lossy());
}

#[test]
fn missing_files_are_named_at_the_line_that_asks_for_them() {
    let place = "value='none.obj'";
    let body = format!("\n<shape type='obj'>\n<string name='filename' {place}/></shape>");
    let error = fault(&Fixture::new(&body));
    check(&error, Fault::Invalid, "none.obj", &body);
    assert!(error.at.is_some() && error.to_string().contains("cannot read"), "{error}");
    let error = twopass::load::load_scene("/nowhere/at/all.xml".as_ref(), &Default::default()).expect_err("missing");
    check(&error, Fault::Invalid, "cannot read", "scene file");
    let folder = tempfile::TempDir::new().expect("a folder");
    let error = twopass::load::load_scene(folder.path(), &Default::default()).expect_err("a folder");
    check(&error, Fault::Invalid, "not a regular file", "a folder");
}

#[test]
fn unknown_names_list_the_near_ones() {
    for (body, at, words) in [
        ("<shape type='sphear'/>", "<shape", "known: sphere"),
        ("<bsdf type='difuse'/>", "<bsdf", "known: diffuse"),
        ("<bsdf type='hair'/>", "<bsdf", "roughplastic"),
        ("<emitter type='constnt'/>", "<emitter", "constant"),
        ("<shap type='cube'/>", "<shap", "known: shape"),
        ("<shape type='sphere'><float name='raduis' value='1'/></shape>", "<float", "known: radius"),
        ("<shape type='cube'><floaf name='x' value='1'/></shape>", "<floaf", "known: float"),
        ("<shape type='cube'><ref id='red'/></shape><bsdf type='diffuse' id='rde'/>", "<ref", "known: rde"),
        ("<bsdf type='dielectric'><string name='int_ior' value='dimond'/></bsdf>", "<string", "diamond"),
        ("<bsdf type='conductor'><string name='material' value='Unobtainium'/></bsdf>", "<string", "one of Ag, Al, Au"),
    ] {
        refused(body, at, Fault::Invalid, words);
    }
}

#[test]
fn structure_is_checked() {
    for (body, at, words) in [
        ("<shape type='cube' colour='red'/>", "colour", "the attribute \"colour\""),
        ("<shape/>", "<shape", "the attribute \"type\""),
        ("<shape type='cube'>text</shape>", "text", "the text \"text\""),
        ("<shape type='cube' id='a'/><shape type='cube' id='a'/>", "<shape type='cube' id='a'/></scene>", "given twice"),
        (
            "<shape type='sphere'><float name='radius' value='1'/><float name='radius' value='2'/></shape>",
            "<float name='radius' value='2'",
            "once",
        ),
        ("<shape type='cube'><emitter type='point'/></shape>", "<emitter", "unknown emitter"),
        (
            "<shape type='cube'><emitter type='area'/><emitter type='area'/></shape>",
            "<emitter type='area'/></shape>",
            "a second emitter",
        ),
        ("<emitter type='area'/>", "<emitter", "unknown emitter"),
        ("<bsdf type='twosided'><bsdf type='dielectric'/></bsdf>", "<bsdf type='dielectric'", "opaque"),
        ("<bsdf type='twosided'/>", "<bsdf", "nested bsdf"),
        ("<bsdf type='twosided' id='a'><ref id='a'/></bsdf>", "<bsdf", "contains itself"),
        ("<medium type='homogeneous'/>", "<medium", "not supported"),
        ("<shape type='obj'/>", "<shape", "\"filename\""),
        ("<bsdf type='diffuse'><rgb name='reflectance' value='$rho'/></bsdf>", "value='$rho'", "\"$rho\" has no value"),
    ] {
        refused(body, at, Fault::Invalid, words);
    }
    check(&fault(&Fixture::whole("<scene version='3.0.0'/>")), Fault::Invalid, "needs a sensor", "no sensor");
}

#[test]
fn values_are_checked_where_they_stand() {
    let bsdf = |v: &str| format!("<bsdf type='diffuse'><rgb name='reflectance' value='{v}'/></bsdf>");
    for value in ["nan", "inf", "#ff8000", "0.1 0.2", "1e400", "red", ""] {
        refused(&bsdf(value), "value", Fault::Invalid, "linear sRGB");
    }
    for value in ["1.5", "-0.1", "0.5, 0.5, 1.0001"] {
        refused(&bsdf(value), "<rgb", Fault::Invalid, "from 0 to 1");
    }
    for (body, at, words) in [
        ("<shape type='cube'><emitter type='area'><rgb name='radiance' value='-1'/></emitter></shape>", "<rgb", "0 or more"),
        ("<shape type='sphere'><float name='radius' value='0'/></shape>", "<float", "above 0"),
        ("<shape type='sphere'><float name='radius' value='-2'/></shape>", "<float", "above 0"),
        ("<shape type='sphere'><string name='radius' value='2'/></shape>", "<string", "a number"),
        ("<shape type='cube'><boolean name='flip_normals' value='yes'/></shape>", "value", "true or false"),
        ("<bsdf type='dielectric'><float name='int_ior' value='0'/></bsdf>", "<float", "above 0"),
        ("<bsdf type='dielectric'><float name='ext_ior' value='-1'/></bsdf>", "<float", "above 0"),
        ("<bsdf type='roughplastic'><float name='alpha' value='0'/></bsdf>", "<float", "above 0"),
        ("<bsdf type='roughplastic'><string name='distribution' value='phong'/></bsdf>", "<string", "beckmann, ggx"),
        ("<bsdf type='conductor'><rgb name='eta' value='-1'/></bsdf>", "<rgb", "0 or more"),
        ("<integrator type='path'><integer name='max_depth' value='-7'/></integrator>", "<integer", "-1 (unlimited)"),
        ("<integrator type='path'><integer name='max_depth' value='1.5'/></integrator>", "value", "a whole number"),
        ("<shape type='cube'><transform name='to_world'><scale value='0'/></transform></shape>", "<transform", "invertible"),
        ("<shape type='cube'><transform name='to_world'><scale z='0'/></transform></shape>", "<transform", "invertible"),
        ("<shape type='cube'><transform name='to_world'><rotate angle='3'/></transform></shape>", "<rotate", "axis"),
        ("<shape type='cube'><transform name='to_world'><matrix value='1 2 3'/></transform></shape>", "value", "16 numbers"),
        (
            "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1'/></transform></shape>",
            "value",
            "affine",
        ),
        (
            "<shape type='cube'><transform name='to_world'><lookat origin='0,0,0' target='0,1,0' up='0,1,0'/></transform></shape>",
            "<lookat",
            "across the view",
        ),
    ] {
        refused(body, at, Fault::Invalid, words);
    }
}

#[test]
fn cameras_and_films_are_checked() {
    let with = |from: &str, to: &str| {
        let sensor = SENSOR.replace(from, to);
        assert_ne!(sensor, SENSOR, "{from}");
        fault(&Fixture::whole(format!("<scene version='3.0.0'>{sensor}</scene>")))
    };
    for fov in ["0", "180", "-5", "200"] {
        check(&with("value=\"40\"", &format!("value=\"{fov}\"")), Fault::Invalid, "between 0 and 180", fov);
    }
    for (size, class) in
        [("0", Fault::Invalid), ("-5", Fault::Invalid), ("4294967297", Fault::OverLimit), ("65536", Fault::OverLimit)]
    {
        check(&with("value=\"8\"", &format!("value=\"{size}\"")), class, "width", size);
    }
    let huge = SENSOR.replace(
        "value=\"8\"/><integer name=\"height\" value=\"4\"/>",
        "value=\"65535\"/><integer name=\"height\" value=\"65535\"/>",
    );
    assert_ne!(huge, SENSOR);
    check(
        &fault(&Fixture::whole(format!("<scene version='3.0.0'>{huge}</scene>"))),
        Fault::OverLimit,
        "pixels of the film",
        "huge",
    );
    let sampler = |n: &str| format!("<sampler type='independent'><integer name='sample_count' value='{n}'/></sampler><film");
    for n in ["0", "-3", "4294967296"] {
        check(&with("<film", &sampler(n)), Fault::Invalid, "sample_count", n);
    }
    check(&with("<film", "<float name='near_clip' value='0'/><film"), Fault::Invalid, "above 0", "near");
    check(&with("<film", "<float name='far_clip' value='0.001'/><film"), Fault::Invalid, "near_clip", "far");
    let skewed = "<transform name='to_world'><scale x='2'/></transform><film";
    check(&with("<film", skewed), Fault::Invalid, "a rotation", "stretched camera");
    check(&with("<rfilter", "<integer name='crop_width' value='9'/><rfilter"), Fault::Invalid, "crop", "crop");
}

#[test]
fn parameters_that_the_scene_lacks_are_a_usage_error() {
    let body = "<default name='rho' value='0.5'/><bsdf type='diffuse'><rgb name='reflectance' value='$rho'/></bsdf>";
    let error = fault(&Fixture::new(body).define("rhoo", "0.1"));
    check(&error, Fault::Usage, "known: rho", "rhoo");
    // A bad value shows up where it is used.
    let error = fault(&Fixture::new(body).define("rho", "7"));
    check(&error, Fault::Invalid, "from 0 to 1", "rho = 7");
}

#[test]
fn broken_meshes_name_their_file_and_line() {
    let shape = |name: &str| format!("<shape type='{}'><string name='filename' value='{name}'/></shape>", &name[2..]);
    let vertices = "v 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\n";
    for (face, words) in
        [("f 1 2 0", "vertex 0 of 3"), ("f 1 2 99", "m.obj:4:1: "), ("f 1 2", "three"), ("v nan 0 0\nf 1 2 3", "finite")]
    {
        let error = fault(&Fixture::new(&shape("m.obj")).with("m.obj", format!("{vertices}{face}\r\n")));
        check(&error, Fault::Invalid, words, face);
        assert_eq!(error.at.expect("a line").line, 4, "{error}");
    }
    check(&fault(&Fixture::new(&shape("m.obj")).with("m.obj", "v 0 0 0\n")), Fault::Invalid, "triangles", "no face");
    check(&fault(&Fixture::new(&shape("m.obj")).with("m.obj", [0_u8, 255, 17])), Fault::Invalid, "OBJ", "binary");
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n\
                  property float z\nend_header\n";
    check(&fault(&Fixture::new(&shape("m.ply")).with("m.ply", header)), Fault::Invalid, "m.ply: expected as many", "4e9");
    check(&fault(&Fixture::new(&shape("m.ply")).with("m.ply", "solid x")), Fault::Invalid, "PLY", "stl");
}

#[test]
fn broken_images_are_refused() {
    let body = "<bsdf type='diffuse'><texture name='reflectance' type='bitmap'>\n<string name='filename' value='t.png'/></texture></bsdf>";
    for bytes in [&b""[..], b"hello", b"\x89PNG\r\n\x1a\n", b"\x76\x2f\x31\x01junk"] {
        let error = fault(&Fixture::new(body).with("t.png", bytes));
        check(&error, Fault::Invalid, "t.png", &String::from_utf8_lossy(bytes));
        assert!(error.at.is_some(), "{error}");
    }
    let mut small = Fixture::new(body).with("t.png", {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image::RgbImage::new(20, 30).write_to(&mut bytes, image::ImageFormat::Png).expect("encodes");
        bytes.into_inner()
    });
    small.options.limits.image_pixels = 599;
    check(&fault(&small), Fault::OverLimit, "20 x 30", "600 pixels");
    small.options.limits.image_pixels = 600;
    assert!(small.load().is_ok());
}

#[test]
fn files_over_their_size_are_not_read() {
    let mut fixture = Fixture::new(&format!("<!--{}-->", "x".repeat(5000)));
    fixture.options.limits.xml_bytes = 5000;
    check(&fault(&fixture), Fault::OverLimit, "size of", "5000 bytes");
    let mut fixture = Fixture::new(&"<shape type='cube'/>".repeat(50));
    fixture.options.limits.xml_nodes = 50;
    check(&fault(&fixture), Fault::OverLimit, "XML nodes", "50 nodes");
}

#[test]
fn many_of_anything_takes_linear_time() {
    let n = 50_000;
    let many = |f: &dyn Fn(usize) -> String| (0..n).map(f).collect::<String>();
    let attributes = format!("<shape type='cube' {}/>", many(&|i| format!("a{i}='1' ")));
    let refused = [attributes, many(&|i| format!("<float name='f{i}' value='1'/>"))];
    for body in &refused {
        fault(&Fixture::new(body));
    }
    let accepted = [
        many(&|i| format!("<bsdf type='diffuse' name='n{i}' id='i{i}'/>")),
        many(&|i| format!("<default name='d{i}' value='$d{}'/>", i.saturating_sub(1))).replace("'$d0'", "'1'"),
        many(&|i| format!("<alias id='x' as='y{i}'/>")) + "<bsdf type='diffuse' id='x'/>",
        many(&|_| "<emitter type='point'/>".to_owned()),
    ];
    for body in &accepted {
        let fixture = Fixture::new(body);
        let start = std::time::Instant::now();
        fixture.load().unwrap_or_else(|e| panic!("{e}"));
        let seconds = start.elapsed().as_secs_f64();
        assert!(seconds < 5.0, "{seconds} s for {}...", &body[..60]);
    }
}

#[test]
fn a_scene_without_light_loads_with_a_warning() {
    let scene = Fixture::new("<shape type='cube'/>").scene();
    assert!(scene.warnings.iter().any(|w| w.contains("no light")), "{:?}", scene.warnings);
}

/// A scene that reads every kind of file, as (name, contents).
fn rich_scene() -> Vec<(&'static str, Vec<u8>)> {
    let body = "<default name='r' value='0.5'/><include filename='part.xml'/>
        <bsdf type='twosided' id='a'><bsdf type='roughplastic'><float name='alpha' value='0.2'/><texture type='bitmap'
        name='diffuse_reflectance'><string name='filename' value='t.png'/></texture></bsdf></bsdf>
        <shape type='obj'><string name='filename' value='m.obj'/><ref id='a'/></shape>
        <shape type='ply'><string name='filename' value='m.ply'/><emitter type='area'><rgb name='radiance' value='1 2 3'/></emitter></shape>
        <shape type='sphere'><point name='center' x='1' y='$r' z='2'/><transform name='to_world'><rotate y='1' angle='30'/><scale
        value='2'/></transform><bsdf type='conductor'><rgb name='eta' value='1'/></bsdf></shape>
        <emitter type='envmap'><string name='filename' value='e.exr'/></emitter>";
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_fn(9, 7, |x, y| image::Rgb([x as u8 * 20, y as u8 * 30, 77]))
        .write_to(&mut png, image::ImageFormat::Png)
        .expect("encodes");
    let folder = tempfile::TempDir::new().expect("a folder");
    let exr = folder.path().join("e.exr");
    exr::prelude::write_rgb_file(&exr, 8, 4, |x, y| (x as f32, y as f32, 1.0_f32)).expect("written");
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.5\nvt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1\nf -1 -2 -3\n";
    let mut ply =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element face 2\nproperty list uchar int vertex_indices\nend_header\n"
            .to_vec();
    [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0].iter().for_each(|v| ply.extend(v.to_le_bytes()));
    for face in [[0_i32, 1, 2], [0, 2, 3]] {
        ply.push(3);
        face.iter().for_each(|v| ply.extend(v.to_le_bytes()));
    }
    vec![
        ("scene.xml", format!("<scene version=\"3.0.0\">{SENSOR}{body}</scene>").into_bytes()),
        ("part.xml", b"<scene version='3.0.0'><shape type='cube'><bsdf type='dielectric'/></shape></scene>".to_vec()),
        ("m.obj", obj.as_bytes().to_vec()),
        ("m.ply", ply),
        ("t.png", png.into_inner()),
        ("e.exr", std::fs::read(exr).expect("read back")),
    ]
}

#[test]
fn damaged_files_end_in_an_error_or_a_scene_but_never_in_a_panic() {
    let files = rich_scene();
    let mut fixture = Fixture::whole("");
    for (name, contents) in &files {
        fixture = fixture.with(name, contents);
    }
    fixture.load().unwrap_or_else(|e| panic!("the undamaged scene: {e}"));
    // Numbers by a linear congruence (Knuth's MMIX constants), so that a failure can be repeated.
    let mut state = 1_u64;
    let mut random = |n: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % n
    };
    for round in 0..500 {
        let (name, contents) = &files[random(files.len())];
        let mut damaged = contents.clone();
        for _ in 0..=random(3) {
            let (at, other) = (random(damaged.len()), random(contents.len()));
            match random(5) {
                0 => damaged[at] ^= 1 << random(8),
                1 => damaged.truncate(at.max(1)),
                2 => damaged[at] = random(256) as u8,
                3 => drop(damaged.splice(at..at, contents[other..].iter().take(20).copied())),
                _ => drop(damaged.splice(at..(at + 1 + random(10)).min(damaged.len()), [])),
            }
            if damaged.is_empty() {
                damaged.push(0);
            }
        }
        fixture = fixture.with(name, &damaged);
        let start = std::time::Instant::now();
        if let Err(error) = fixture.load() {
            assert!(!error.to_string().is_empty());
        }
        assert!(start.elapsed().as_secs_f64() < 1.0, "round {round}, {name}");
        fixture = fixture.with(name, contents);
    }
}
