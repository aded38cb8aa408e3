//! What the reader makes of colours, textures, materials and lights.

use crate::loading::{Fixture, reflectance, scene};
use tempfile::TempDir;
use twopass::material::{Material, MaterialId, Texture};
use twopass::math::{DVec3, Rgb, Vec2, Vec3};
use twopass::scene::Shape;

fn close(got: Rgb, want: [f64; 3], tolerance: f64) {
    let error = (got - Rgb::from(want)).map(f64::abs).max();
    assert!(error <= tolerance, "{got:?}, expected {want:?} within {tolerance}");
}

fn png(pixels: &[&[[u8; 4]]]) -> Vec<u8> {
    let (width, height) = (pixels[0].len() as u32, pixels.len() as u32);
    let image = image::RgbaImage::from_fn(width, height, |x, y| image::Rgba(pixels[y as usize][x as usize]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).expect("encodes");
    bytes.into_inner()
}

#[test]
fn colours_are_linear_with_commas_or_spaces() {
    let of = |value: &str| {
        let body = format!("<bsdf type='diffuse' id='a'><rgb name='reflectance' value='{value}'/></bsdf>");
        reflectance(&scene(&body), 0.0, 0.0)
    };
    assert_eq!(of("0.1, 0.2, 0.3"), Rgb::new(0.1, 0.2, 0.3));
    assert_eq!(of("0.1 0.2  0.3"), Rgb::new(0.1, 0.2, 0.3));
    assert_eq!(of("0.5"), Rgb::grey(0.5));
    assert_eq!(of("0.999999"), Rgb::grey(0.999999), "f64 all the way");
}

#[test]
fn a_uniform_spectrum_is_grey_as_reflectance_and_equal_energy_white_as_radiance() {
    let body = "<bsdf type='diffuse' id='a'><spectrum name='reflectance' value='0.25'/></bsdf>
        <shape type='rectangle'><ref id='a'/><emitter type='area'><spectrum name='radiance' value='2'/></emitter></shape>";
    let scene = scene(body);
    assert_eq!(reflectance(&scene, 0.0, 0.0), Rgb::grey(0.25));
    close(scene.shapes[0].emitted(Vec2::ZERO), [2.0 * 1.205, 2.0 * 0.948, 2.0 * 0.909], 1.1e-3);
}

#[test]
fn eight_bit_images_are_decoded_before_filtering_and_row_0_is_at_v_0() {
    let grey = |v| [v, v, v, 255];
    let image = png(&[&[grey(0), grey(255)], &[grey(128), grey(128)]]);
    let of = |extra: &str| {
        let body = format!(
            "<bsdf type='diffuse' id='a'><texture name='reflectance' type='bitmap'>
             <string name='filename' value='t.png'/>{extra}</texture></bsdf>"
        );
        Fixture::new(&body).with("t.png", &image).scene()
    };
    let plain = of("");
    // Texel centres at a quarter and three quarters; halfway between black and white lies linear 0.5, not sRGB 128.
    for (u, v, want) in [(0.25, 0.25, 0.0), (0.75, 0.25, 1.0), (0.5, 0.25, 0.5), (0.25, 0.75, 0.215_86), (1.25, 0.75, 0.215_86)] {
        close(reflectance(&plain, u, v), [want; 3], 1e-5);
    }
    close(reflectance(&of("<boolean name='raw' value='true'/>"), 0.25, 0.75), [0.501_96; 3], 1e-5);
    close(reflectance(&of("<string name='filter_type' value='nearest'/>"), 0.49, 0.25), [0.0; 3], 0.0);
    close(reflectance(&of("<string name='wrap_mode' value='clamp'/>"), -3.0, 0.25), [0.0; 3], 0.0);
    let half = "<transform name='to_uv'><scale x='0.5' y='1'/></transform>";
    close(reflectance(&of(half), 0.5, 0.25), [0.0; 3], 1e-6);
}

#[test]
fn a_checkerboard_has_color0_at_the_origin() {
    let body = "<bsdf type='diffuse' id='a'><texture name='reflectance' type='checkerboard'>
        <rgb name='color0' value='0.8'/><rgb name='color1' value='0.2'/>
        <transform name='to_uv'><scale x='10' y='20'/></transform></texture></bsdf>";
    let scene = scene(body);
    // A cell is a tenth wide and a twentieth high; its four quarters alternate.
    for (u, v, want) in [(0.01, 0.01, 0.8), (0.06, 0.01, 0.2), (0.01, 0.03, 0.2), (0.06, 0.03, 0.8), (0.11, 0.01, 0.8)] {
        close(reflectance(&scene, u, v), [want; 3], 1e-6);
    }
}

#[test]
fn opaque_materials_are_one_sided_unless_wrapped() {
    let body = "<bsdf type='diffuse' id='one'/><bsdf type='twosided' id='two'><bsdf type='diffuse'/></bsdf>
        <bsdf type='dielectric' id='glass'/>";
    let sides: Vec<_> = scene(body).materials.iter().map(|m| (m.name.clone(), m.two_sided)).collect();
    assert_eq!(sides, [("one".to_owned(), false), ("two".to_owned(), true), ("glass".to_owned(), false)]);
}

#[test]
fn shapes_without_a_material_are_grey_or_black_if_they_emit() {
    let scene = scene("<shape type='rectangle'/><shape type='rectangle'><emitter type='area'/></shape>");
    let rho = |shape: &Shape| scene.material_of(shape).material.diffuse_reflectance(Vec2::ZERO);
    assert_eq!(rho(&scene.shapes[0]), Rgb::grey(0.5));
    assert_eq!(rho(&scene.shapes[1]), Rgb::BLACK);
    assert_eq!(scene.shapes[1].emitted(Vec2::ZERO), Rgb::WHITE);
}

#[test]
fn references_are_shared_and_may_come_before_their_object() {
    let body = "<shape type='rectangle' id='a'><ref id='x'/></shape><shape type='cube' id='b'><ref id='y'/></shape>
        <bsdf type='diffuse' id='x'/><alias id='x' as='y'/>";
    let scene = scene(body);
    assert_eq!(scene.materials.len(), 1);
    assert_eq!((scene.shapes[0].material, scene.shapes[1].material), (MaterialId(0), MaterialId(0)));
    assert_eq!(scene.shapes.iter().map(|s| s.id.as_str()).collect::<Vec<_>>(), ["a", "b"]);
}

#[test]
fn conductors_and_dielectrics() {
    let body = "<bsdf type='conductor' id='a'><string name='material' value='none'/></bsdf>
        <bsdf type='conductor' id='b'><string name='material' value='Au'/></bsdf>
        <bsdf type='conductor' id='c'><rgb name='eta' value='1.5, 1, 0.5'/><rgb name='k' value='7'/></bsdf>
        <bsdf type='dielectric' id='d'><string name='int_ior' value='water'/><float name='ext_ior' value='1'/></bsdf>
        <bsdf type='dielectric' id='e'/>
        <bsdf type='thindielectric' id='f'><float name='int_ior' value='1.5'/><float name='ext_ior' value='1.2'/>
        <rgb name='specular_transmittance' value='0, 0, 0'/></bsdf>";
    let scene = scene(body);
    let material = |i: usize| &scene.materials[i].material;
    assert!(matches!(material(0), Material::Conductor { index: None, .. }));
    let Material::Conductor { index: Some((eta, _)), .. } = material(1) else { panic!("gold has an index") };
    assert!(eta.b > eta.g && eta.g > eta.r, "gold is yellow: {eta:?}");
    let Material::Conductor { index: Some(index), .. } = material(2) else { panic!("given by eta and k") };
    assert_eq!(*index, (Rgb::new(1.5, 1.0, 0.5), Rgb::grey(7.0)));
    for (i, want) in [(3, 1.333), (4, 1.5046 / 1.000_28)] {
        let Material::Dielectric { eta, transmittance, .. } = material(i) else { panic!("glass") };
        assert_eq!((*eta, transmittance.mean()), (want, Rgb::WHITE));
    }
    let Material::ThinDielectric { eta, transmittance, .. } = material(5) else { panic!("plate") };
    assert_eq!((*eta, transmittance.mean()), (1.25, Rgb::BLACK));
    assert!(scene.warnings.iter().all(|w| !w.contains("material")), "{:?}", scene.warnings);
}

#[test]
fn rough_and_coated_materials_are_what_they_are() {
    let body = "<bsdf type='twosided' id='coat'><bsdf type='roughplastic'><string name='distribution' value='ggx'/>
        <float name='alpha' value='0.1'/><float name='int_ior' value='1.5'/><float name='ext_ior' value='1'/>
        <boolean name='nonlinear' value='true'/><rgb name='diffuse_reflectance' value='0.8'/></bsdf></bsdf>
        <bsdf type='roughconductor' id='steel'><float name='alpha_u' value='0.2'/><float name='alpha_v' value='0.3'/></bsdf>
        <bsdf type='roughdielectric' id='frost'/><bsdf type='plastic' id='smooth'/>
        <bsdf type='conductor' id='odd'><texture name='eta' type='checkerboard'/></bsdf>
        <shape type='rectangle'><ref id='coat'/></shape><shape type='rectangle'><ref id='coat'/></shape>";
    let scene = scene(body);
    let material = |i: usize| &scene.materials[i].material;
    // What Mitsuba's formulas give: not 0.8.
    close(reflectance(&scene, 0.0, 0.0), [0.531; 3], 1e-3);
    assert!(scene.materials[0].two_sided);
    for (i, alpha, diffuse) in [(0, 0.1, true), (1, 0.2, false), (2, 0.1, false), (3, 1.0, true)] {
        assert_eq!((material(i).roughness(Vec2::ZERO), material(i).has_diffuse()), (alpha, diffuse), "material {i}");
        assert_eq!(material(i).has_glossy(), i < 3, "material {i}");
    }
    assert!(matches!(material(2), Material::RoughDielectric(_)) && material(2).is_transmissive());
    // Only the textured index is replaced: by its mean.
    let about = |id: &str| scene.warnings.iter().filter(|w| w.contains(&format!("\"{id}\""))).count();
    for (id, n) in [("coat", 0), ("steel", 0), ("frost", 0), ("smooth", 0), ("odd", 1)] {
        assert_eq!(about(id), n, "warnings about {id}: {:?}", scene.warnings);
    }
}

#[test]
fn masks_use_the_luminance_of_the_colours_and_drop_alpha() {
    let body =
        "<bsdf type='mask' id='leaf'><texture name='opacity' type='bitmap'><string name='filename' value='t.png'/></texture>
        <bsdf type='twosided'><bsdf type='diffuse'/></bsdf></bsdf>
        <bsdf type='mask' id='veil'><rgb name='opacity' value='0.1'/><bsdf type='diffuse'/></bsdf>
        <bsdf type='mask' id='whole'><float name='opacity' value='1'/><bsdf type='diffuse'/></bsdf>
        <bsdf type='mask' id='gone'><float name='opacity' value='0'/><bsdf type='diffuse'/></bsdf>";
    let green_but_clear = png(&[&[[0, 255, 0, 0]]]);
    let scene = Fixture::new(body).with("t.png", green_but_clear).scene();
    let (down, up) = (Vec3::new(0.6, 0.0, -0.8), Vec3::new(0.6, 0.0, 0.8));
    // Luminance of green in Mitsuba's digits; the rest goes straight on, from either side.
    for (i, opacity, back) in [(0, 0.715_16, true), (1, 0.1, false)] {
        let material = &scene.materials[i].material;
        for wo in [up, down] {
            let through: Vec<_> = material.lobes(wo, Vec2::ZERO).iter().map(|l| (l.wi, l.weight.g)).collect();
            assert_eq!(through.len(), 1);
            assert!(through[0].0 == -wo && (through[0].1 - (1.0 - opacity)).abs() < 1e-6, "{through:?}");
        }
        close(material.diffuse_toward(up, Vec2::ZERO), [0.5 * opacity; 3], 1e-6);
        close(material.diffuse_toward(down, Vec2::ZERO), [if back { 0.5 * opacity } else { 0.0 }; 3], 1e-6);
        assert_eq!((scene.materials[i].two_sided, material.passes_straight()), (back, true));
    }
    assert!(matches!(scene.materials[2].material, Material::Diffuse { .. }));
    assert!(matches!(scene.materials[3].material, Material::Null));
    assert!(scene.warnings.iter().all(|w| !w.contains("material")), "{:?}", scene.warnings);
}

#[test]
fn faulty_materials_are_refused_where_they_stand() {
    let part = "<bsdf type='diffuse'/>";
    let glass = "<bsdf type='dielectric'/>";
    let cases = [
        (format!("<bsdf type='blendbsdf'>{part}{part}</bsdf>"), "\"weight\""),
        (format!("<bsdf type='blendbsdf'><float name='weight' value='0.5'/>{part}</bsdf>"), "it has 1"),
        (format!("<bsdf type='blendbsdf'><float name='weight' value='1.5'/>{part}{part}</bsdf>"), "from 0 to 1"),
        (
            format!(
                "<bsdf type='blendbsdf'><float name='weight' value='0.5'/>{glass}<bsdf type='blendbsdf'>
                 <float name='weight' value='0.5'/>{glass}{glass}</bsdf></bsdf>"
            ),
            "more than two smooth dielectrics",
        ),
        ("<bsdf type='roughconductor'><float name='alpha_u' value='0.1'/></bsdf>".to_owned(), "\"alpha_v\""),
        (
            "<bsdf type='roughdielectric'><float name='alpha' value='0.1'/><float name='alpha_u' value='0.1'/></bsdf>".to_owned(),
            "left out beside \"alpha\"",
        ),
        ("<bsdf type='roughconductor'><rgb name='alpha' value='0'/></bsdf>".to_owned(), "above 0"),
        ("<bsdf type='roughplastic'><texture name='alpha' type='checkerboard'/></bsdf>".to_owned(), "a number"),
        (
            "<bsdf type='roughplastic'><float name='int_ior' value='1.2'/><float name='ext_ior' value='1.2'/></bsdf>".to_owned(),
            "other than \"ext_ior\"",
        ),
        (
            "<bsdf type='principled'><float name='eta' value='1.5'/><float name='specular' value='0.5'/></bsdf>".to_owned(),
            "left out beside \"eta\"",
        ),
        ("<bsdf type='principled'><float name='metallic' value='2'/></bsdf>".to_owned(), "from 0 to 1"),
        (format!("<bsdf type='bumpmap'><texture type='checkerboard'/>{part}</bsdf>"), "a bitmap"),
        (format!("<bsdf type='normalmap'>{part}</bsdf>"), "\"normalmap\""),
        (format!("<bsdf type='twosided'><bsdf type='mask'>{part}</bsdf></bsdf>"), "opaque"),
    ];
    for (body, expected) in cases {
        let fault = Fixture::new(&body).load().expect_err(&body);
        assert!(fault.at.is_some() && fault.to_string().contains(expected), "{body}: {fault}, expected {expected}");
    }
}

#[test]
fn lights_are_where_the_file_says() {
    let body = "<emitter type='point'><point name='position' x='1' y='2' z='3'/><rgb name='intensity' value='4'/></emitter>
        <emitter type='point'><transform name='to_world'><translate x='5'/></transform></emitter>
        <emitter type='constant'><rgb name='radiance' value='0.5'/></emitter>";
    let scene = scene(body);
    let twopass::light::Light::Point(light) = &scene.lights[0] else { panic!("a point light") };
    assert_eq!(light.position.as_dvec3() + scene.origin, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(light.intensity, Rgb::grey(4.0));
    let twopass::light::Light::Point(light) = &scene.lights[1] else { panic!("a point light") };
    assert_eq!(light.position.as_dvec3() + scene.origin, DVec3::new(5.0, 0.0, 0.0));
    assert_eq!(scene.escaped_radiance(Vec3::X), Rgb::grey(0.5));
    assert_eq!(scene.lights.len(), 2, "a uniform surrounding is not sampled");
}

#[test]
fn spots_and_suns_are_read_and_what_cannot_be_rendered_is_told() {
    let body = "<emitter type='spot'><transform name='to_world'><lookat origin='1, 2, 3' target='1, 2, 9' up='0, 1, 0'/></transform>
        <spectrum name='intensity' value='300:2, 900:2'/><float name='cutoff_angle' value='40'/></emitter>
        <emitter type='directional'><vector name='direction' x='0' y='-3' z='0'/><rgb name='irradiance' value='1, 2, 3'/></emitter>";
    let scene = scene(body);
    let twopass::light::Light::Spot(spot) = &scene.lights[0] else { panic!("a spot") };
    assert_eq!(spot.position.as_dvec3() + scene.origin, DVec3::new(1.0, 2.0, 3.0));
    assert!((spot.axis - DVec3::Z).length() < 1e-12 && (spot.cutoff - 40.0_f64.to_radians()).abs() < 1e-12);
    // Mitsuba's default: three quarters of the cut-off angle.
    assert!((spot.beam_width - 30.0_f64.to_radians()).abs() < 1e-12);
    close(spot.intensity, [2.0 * 1.2049, 2.0 * 0.9482, 2.0 * 0.9093], 1e-3);
    let twopass::light::Light::Directional(sun) = &scene.lights[1] else { panic!("a sun") };
    assert_eq!((sun.direction, sun.irradiance), (Vec3::NEG_Y, Rgb::new(1.0, 2.0, 3.0)));
    for (body, wanted) in [
        ("<emitter type='sunsky'/>", "bake it into an image"),
        ("<emitter type='spot'><float name='beam_width' value='30'/></emitter>", "from 0 to the cut-off angle of 20"),
        ("<emitter type='directional'><vector name='direction' x='0' y='0' z='0'/></emitter>", "a vector with a length"),
        ("<emitter type='point'><spectrum name='intensity' value='500:1, 400:2'/></emitter>", "growing wavelengths"),
        ("<emitter type='point'><spectrum name='intensity' type='blackbody'/></emitter>", "blackbody"),
        ("<shape type='rectangle'><emitter type='directionalarea'/></shape>", "along its normal"),
        ("<emitter type='spot'><transform name='to_world'><scale x='2'/></transform></emitter>", "stretches or shears"),
    ] {
        let told = Fixture::new(body).load().expect_err(body).to_string();
        assert!(told.contains(wanted) && told.contains(".xml:"), "{body}: {told}");
    }
}

#[test]
fn the_mean_of_an_environment_map_is_over_the_sphere() {
    // Rows at theta = pi r/16; only the middle one shines. The mean of a hat of width h about the equator is (1 - cos h)/h.
    let write = |f: fn(usize) -> f32| {
        let folder = TempDir::new().expect("a folder");
        let path = folder.path().join("e.exr");
        exr::prelude::write_rgb_file(&path, 8, 17, |_, y| (f(y), 2.0 * f(y), 0.0_f32)).expect("written");
        std::fs::read(path).expect("read back")
    };
    let body = "<emitter type='envmap'><string name='filename' value='e.exr'/><float name='scale' value='3'/></emitter>";
    let mean = |image: &[u8]| Fixture::new(body).with("e.exr", image).scene().environment.expect("a map").mean();
    let h = std::f64::consts::PI / 16.0;
    let belt = 3.0 * (1.0 - h.cos()) / h;
    close(mean(&write(|_| 1.0)), [3.0, 6.0, 0.0], 1e-6);
    close(mean(&write(|y| if y == 8 { 1.0 } else { 0.0 })), [belt, 2.0 * belt, 0.0], 1e-6);
    let faulty =
        Fixture::new(body).with("e.exr", write(|y| if y == 3 { f32::NAN } else { 0.0 })).load().expect_err("a NaN texel");
    assert!(faulty.to_string().contains("(0, 3)"), "{faulty}");
}

#[test]
fn textures_of_one_file_are_decoded_once() {
    let bsdf = |id: &str| {
        format!(
            "<bsdf type='diffuse' id='{id}'><texture name='reflectance' type='bitmap'>
             <string name='filename' value='t.png'/></texture></bsdf>"
        )
    };
    let scene = Fixture::new(&(bsdf("a") + &bsdf("b"))).with("t.png", png(&[&[[9, 9, 9, 255]]])).scene();
    let texels = |i: usize| match &scene.materials[i].material {
        Material::Diffuse { reflectance: Texture::Bitmap(b) } => b.texels.clone(),
        _ => panic!("a bitmap"),
    };
    assert!(texels(0).is_shared_with(&texels(1)));
}

#[test]
fn textures_may_be_referred_to_and_may_emit() {
    let body = "<texture type='checkerboard' id='t'><rgb name='color0' value='1'/><rgb name='color1' value='0'/></texture>
        <bsdf type='diffuse' id='a'><ref name='reflectance' id='t'/></bsdf>
        <shape type='rectangle'><ref id='a'/><emitter type='area' id='lamp'><ref name='radiance' id='t'/></emitter></shape>";
    let scene = scene(body);
    assert_eq!(reflectance(&scene, 0.1, 0.1), Rgb::WHITE);
    assert_eq!(scene.shapes[0].emitted(Vec2::new(0.1, 0.1)), Rgb::WHITE);
    assert_eq!(scene.shapes[0].emitted(Vec2::new(0.1, 0.9)), Rgb::BLACK);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}
