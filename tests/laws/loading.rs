//! What the reader makes of Mitsuba 3 scenes: camera, shapes, structure. Each convention on which readers trip, one test.

use std::path::{Path, PathBuf};
use tempfile::TempDir;
use twopass::load::{LoadError, LoadOptions, LoadedScene, load_scene};
use twopass::material::Material;
use twopass::math::{DVec3, Rgb, Vec2, Vec3};
use twopass::scene::{Scene, Shape, ShapeSurface};

/// A folder with a scene file and what belongs to it.
pub struct Fixture {
    folder: TempDir,
    pub options: LoadOptions,
}

/// A sensor with a box filter, so that it causes no warning.
pub const SENSOR: &str = r#"<sensor type="perspective"><float name="fov" value="40"/><film type="hdrfilm">
    <integer name="width" value="8"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>"#;

impl Fixture {
    /// A scene of the given elements besides [`SENSOR`].
    pub fn new(body: &str) -> Self {
        Self::whole(format!("<scene version=\"3.0.0\">{SENSOR}{body}</scene>"))
    }

    /// A scene file with exactly this text.
    pub fn whole(text: impl AsRef<[u8]>) -> Self {
        let fixture = Self { folder: TempDir::new().expect("a temporary folder"), options: LoadOptions::default() };
        fixture.with("scene.xml", text)
    }

    /// The same with one more file.
    pub fn with(self, name: &str, contents: impl AsRef<[u8]>) -> Self {
        std::fs::write(self.folder.path().join(name), contents).expect("written");
        self
    }

    /// The same with a value for a parameter.
    pub fn define(mut self, name: &str, value: &str) -> Self {
        self.options.defines.push((name.to_owned(), value.to_owned()));
        self
    }

    pub fn path(&self) -> PathBuf {
        self.folder.path().join("scene.xml")
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub fn load(&self) -> Result<LoadedScene, LoadError> {
        load_scene(&self.path(), &self.options)
    }

    pub fn scene(&self) -> Scene {
        self.load().unwrap_or_else(|e| panic!("{e}")).scene
    }
}

pub fn scene(body: &str) -> Scene {
    Fixture::new(body).scene()
}

/// Diffuse reflectance of the first material at (u, v).
pub fn reflectance(scene: &Scene, u: f32, v: f32) -> Rgb {
    scene.materials[0].material.diffuse_reflectance(Vec2::new(u, v))
}

/// World positions, normals and uvs of a mesh shape, triangle by triangle.
pub fn corners(scene: &Scene, shape: &Shape) -> Vec<[(DVec3, Option<Vec3>, Vec2); 3]> {
    let ShapeSurface::Mesh(mesh) = &shape.surface else { panic!("{} is no mesh", shape.id) };
    let corner = |i: u32| {
        let i = i as usize;
        let uv = mesh.uvs.get(i).copied().unwrap_or_default();
        (mesh.positions[i].as_dvec3() + scene.origin, mesh.normals.get(i).copied(), uv)
    };
    mesh.triangles.iter().map(|t| t.map(corner)).collect()
}

fn face_normal(corners: &[(DVec3, Option<Vec3>, Vec2); 3]) -> DVec3 {
    let [a, b, c] = corners.map(|c| c.0);
    (b - a).cross(c - a).normalize()
}

pub const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 .75\nf 1/1 2/2 3/3\n";

#[test]
fn a_camera_matrix_is_row_major_and_looks_along_plus_z() {
    let body = r#"<shape type="sphere"><point name="center" x="5" y="0" z="0"/></shape>"#;
    let sensor = SENSOR.replace(
        "<film",
        "<transform name=\"to_world\"><matrix value=\"0 0 1 5  0 1 0 6  -1 0 0 7  0 0 0 1\"/></transform><film",
    );
    let scene = Fixture::whole(format!("<scene version='3.0.0'>{sensor}{body}</scene>")).scene();
    assert_eq!(scene.camera.to_scene.translation + scene.origin, DVec3::new(5.0, 6.0, 7.0));
    let (forward, left) = (scene.camera.forward(), scene.camera.to_scene.transform_vector3(DVec3::X));
    assert!((forward - Vec3::X).length() < 1e-6 && (left + DVec3::Z).length() < 1e-12, "{forward}, left {left}");
}

#[test]
fn field_of_view_is_the_width_unless_told_otherwise() {
    // tan(20 degrees), for a film of 8 x 4.
    let tan = 20.0_f64.to_radians().tan();
    let diagonal = tan * 8.0 / 80.0_f64.sqrt();
    for (extra, want) in [
        ("", tan),
        ("<string name='fov_axis' value='y'/>", 2.0 * tan),
        ("<string name='fov_axis' value='smaller'/>", 2.0 * tan),
        ("<string name='fov_axis' value='larger'/>", tan),
        ("<string name='fov_axis' value='diagonal'/>", diagonal),
    ] {
        let sensor = SENSOR.replace("<film", &format!("{extra}<film"));
        let scene = Fixture::whole(format!("<scene version='3.0.0'>{sensor}</scene>")).scene();
        let got = scene.camera.half_width(8, 4);
        assert!((got - want).abs() < 1e-12, "{extra}: {got}, expected {want}");
    }
    // A 35 mm film's diagonal, by default through 50 mm.
    let sensor = SENSOR.replace("<float name=\"fov\" value=\"40\"/>", "");
    let got = Fixture::whole(format!("<scene version='3.0.0'>{sensor}</scene>")).scene().camera.half_width(8, 4);
    let want = 36.0_f64.hypot(24.0) / 100.0 * 8.0 / 80.0_f64.sqrt();
    assert!((got - want).abs() < 1e-12, "{got}, expected {want}");
}

#[test]
fn a_scaled_camera_loses_its_scale_and_a_mirrored_one_stays_mirrored() {
    let of = |operation: &str| {
        let sensor = SENSOR.replace("<film", &format!("<transform name='to_world'>{operation}</transform><film"));
        Fixture::whole(format!("<scene version='3.0.0'>{sensor}</scene>")).scene()
    };
    let scaled = of("<scale value='3'/><translate x='1'/>");
    assert!((scaled.camera.to_scene.matrix3.determinant() - 1.0).abs() < 1e-12);
    assert!(scaled.warnings.iter().any(|w| w.contains("scales by 3")), "{:?}", scaled.warnings);
    let mirrored = of("<scale x='-1'/>");
    assert_eq!(mirrored.camera.to_scene.transform_vector3(DVec3::X), -DVec3::X);
}

#[test]
fn transforms_apply_in_document_order() {
    let body = r#"<shape type="sphere"><transform name="to_world"><scale value="2"/><translate x="1"/>
        <rotate z="1" angle="90"/></transform><point name="center" x="3" y="0" z="0"/></shape>"#;
    let scene = scene(body);
    let ShapeSurface::Sphere(sphere) = &scene.shapes[0].surface else { panic!("exact sphere") };
    // 3 scaled to 6, moved to 7 along x, turned to y.
    let center = sphere.center.as_dvec3() + scene.origin;
    assert!((center - DVec3::new(0.0, 7.0, 0.0)).length() < 1e-12, "{center}");
    assert_eq!(sphere.radius, 2.0);
}

#[test]
fn obj_flips_v_and_ply_and_rectangle_do_not() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float u\n\
               property float v\nelement face 1\nproperty list uchar int vertex_index\nend_header\n\
               0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 .75\n3 0 1 2\n";
    let body = "<shape type='obj'><string name='filename' value='t.obj'/></shape>
        <shape type='obj'><string name='filename' value='t.obj'/><boolean name='flip_tex_coords' value='false'/>
        <transform name='to_world'><translate z='1'/></transform></shape>
        <shape type='ply'><string name='filename' value='t.ply'/><transform name='to_world'><translate z='2'/></transform></shape><shape type='rectangle'/>";
    let scene = Fixture::new(body).with("t.obj", TRIANGLE).with("t.ply", ply).scene();
    for (index, want) in [(0, 0.25), (1, 0.75), (2, 0.75)] {
        assert_eq!(corners(&scene, &scene.shapes[index])[0][2].2, Vec2::new(0.0, want), "shape {index}");
    }
    for (p, _, uv) in corners(&scene, &scene.shapes[3]).into_iter().flatten() {
        assert_eq!(uv.as_dvec2(), 0.5 * (p.truncate() + 1.0), "rectangle");
    }
}

#[test]
fn primitives_have_their_sizes_and_normals() {
    let body = "<shape type='rectangle'/><shape type='disk'/><shape type='cube'/><shape type='sphere'/>
        <shape type='rectangle'><boolean name='flip_normals' value='true'/></shape>";
    let scene = scene(body);
    let areas = [4.0, std::f64::consts::PI, 24.0, 4.0 * std::f64::consts::PI, 4.0];
    for (shape, want) in scene.shapes.iter().zip(areas) {
        assert!((shape.area() / want - 1.0).abs() < 1e-6, "{}: {}, expected {want}", shape.id, shape.area());
    }
    for (index, want) in [(0, DVec3::Z), (1, DVec3::Z), (4, -DVec3::Z)] {
        for triangle in corners(&scene, &scene.shapes[index]) {
            assert!((face_normal(&triangle) - want).length() < 1e-5, "shape {index}");
        }
    }
}

#[test]
fn spheres_that_cannot_be_exact_are_triangles_with_a_warning() {
    let stretched = "<shape type='sphere' id='egg'><transform name='to_world'><scale x='2'/></transform></shape>";
    let inward = "<shape type='sphere' id='egg'><boolean name='flip_normals' value='true'/></shape>";
    for (body, outward) in [(stretched, true), (inward, false)] {
        let scene = scene(body);
        assert!(scene.warnings.iter().any(|w| w.contains("egg")), "{:?}", scene.warnings);
        for triangle in corners(&scene, &scene.shapes[0]) {
            let (normal, out) = (face_normal(&triangle), triangle[0].0);
            assert_eq!(normal.dot(out) > 0.0, outward);
            assert!(normal.dot(triangle[0].1.expect("smooth").as_dvec3()) > 0.0);
        }
    }
}

#[test]
fn meshes_without_normals_become_smooth_unless_told_otherwise() {
    let mut cube: String = (0..8).map(|i| format!("v {} {} {}\n", i & 1, i >> 1 & 1, i >> 2)).collect();
    cube += "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    let shape = |extra: &str| format!("<shape type='obj'><string name='filename' value='c.obj'/>{extra}</shape>");
    let body = shape("") + &shape("<boolean name='face_normals' value='true'/>");
    let scene = Fixture::new(&body).with("c.obj", cube).scene();
    for (p, n, _) in corners(&scene, &scene.shapes[0]).into_iter().flatten() {
        let want = (p - 0.5).normalize();
        let n = n.expect("smooth").as_dvec3();
        assert!((n - want).length() < 1e-6, "{n} at {p}, expected {want}");
    }
    for triangle in corners(&scene, &scene.shapes[1]) {
        assert!(triangle[0].1.is_none());
        assert!(face_normal(&triangle).dot(triangle[0].0 - 0.5) > 0.0, "outward");
    }
}

#[test]
fn mirrored_meshes_keep_the_side_of_their_shading_normals() {
    let obj = format!("{}vn 0 0 1\n", TRIANGLE).replace("f 1/1 2/2 3/3\n", "") + "f 1/1/1 2/2/1 3/3/1\n";
    let body = "<shape type='obj'><string name='filename' value='t.obj'/>
        <transform name='to_world'><scale x='-1'/></transform></shape>";
    let scene = Fixture::new(body).with("t.obj", obj).scene();
    let triangle = corners(&scene, &scene.shapes[0])[0];
    assert!((face_normal(&triangle) - DVec3::Z).length() < 1e-6, "{}", face_normal(&triangle));
}

#[test]
fn film_sampler_and_integrator_have_mitsubas_defaults() {
    let bare =
        Fixture::whole("<scene version='3.0.0'><sensor type='perspective'><film type='hdrfilm'/></sensor></scene>").scene();
    assert_eq!((bare.film.width, bare.film.height), (768, 576));
    assert_eq!((bare.film.sample_count, bare.film.max_depth), (4, None));
    assert!(bare.warnings.iter().any(|w| w.contains("gaussian")), "{:?}", bare.warnings);
    for (depth, want) in [("-1", None), ("0", Some(0)), ("7", Some(7))] {
        let scene = scene(&format!("<integrator type='path'><integer name='max_depth' value='{depth}'/></integrator>"));
        assert_eq!(scene.film.max_depth, want);
    }
}

#[test]
fn parameters_come_from_defaults_and_the_command_line() {
    let body =
        "<default name='rho' value='0.25'/><bsdf type='diffuse' id='a'><rgb name='reflectance' value='$rho, $rho, 0'/></bsdf>";
    assert_eq!(reflectance(&scene(body), 0.0, 0.0), Rgb::new(0.25, 0.25, 0.0));
    assert_eq!(reflectance(&Fixture::new(body).define("rho", "0.75").scene(), 0.0, 0.0), Rgb::new(0.75, 0.75, 0.0));
}

#[test]
fn includes_are_spliced_in() {
    let body = "<default name='r' value='2'/><include filename='part.xml'/><include filename='one.xml'/>";
    let part = "<scene version='3.0.0'><shape type='sphere' id='a'><float name='radius' value='$r'/></shape></scene>";
    let scene = Fixture::new(body).with("part.xml", part).with("one.xml", "<shape type='cube' id='b'/>").scene();
    assert_eq!(scene.shapes.iter().map(|s| s.id.as_str()).collect::<Vec<_>>(), ["a", "b"]);
}

#[test]
fn files_of_mitsuba_0_6_are_brought_up_to_date() {
    let text = "<scene version='0.6.0'><sensor type='perspective'><float name='fov' value='40'/>
        <transform name='toWorld'><lookAt origin='0,0,-5' target='0,0,0' up='0,1,0'/></transform></sensor>
        <bsdf type='diffuse' id='d'><rgb name='diffuseReflectance' value='0.5'/></bsdf>
        <bsdf type='dielectric' id='g'><float name='intIOR' value='1.5'/><float name='extIOR' value='1'/></bsdf>
        <bsdf type='conductor' id='c'><rgb name='eta' value='1'/><rgb name='k' value='2'/><float name='extEta' value='1'/></bsdf>
        <shape type='obj'><string name='filename' value='t.obj'/><boolean name='faceNormals' value='true'/></shape></scene>";
    let scene = Fixture::whole(text).with("t.obj", TRIANGLE).scene();
    assert_eq!(reflectance(&scene, 0.0, 0.0), Rgb::grey(0.5));
    assert!(matches!(scene.materials[1].material, Material::Dielectric { eta: 1.5, .. }));
    assert!(corners(&scene, &scene.shapes[0])[0][0].1.is_none());
}

#[test]
fn the_name_is_the_folders_for_scene_xml_and_the_files_otherwise() {
    let fixture = Fixture::new("").with("other.xml", format!("<scene version='3.0.0'>{SENSOR}</scene>"));
    let folder = fixture.folder().file_name().expect("a name").to_string_lossy().into_owned();
    assert_eq!(fixture.scene().name, folder);
    let other = load_scene(&fixture.folder().join("other.xml"), &LoadOptions::default()).expect("valid");
    assert_eq!(other.scene.name, "other");
}

#[test]
fn the_hash_follows_the_contents_and_not_the_place() {
    let body = "<default name='a' value='1'/><shape type='obj'><string name='filename' value='t.obj'/></shape>";
    let fixture = |mesh: &str| Fixture::new(body).with("t.obj", mesh);
    let hash = |fixture: Fixture| fixture.load().expect("valid").hash;
    let base = hash(fixture(TRIANGLE));
    assert_eq!(base, hash(fixture(TRIANGLE)), "two folders with the same files");
    assert_ne!(base, hash(fixture(&TRIANGLE.replace("v 1 0 0", "v 1 0 1"))));
    assert_ne!(base, hash(fixture(TRIANGLE).define("a", "2")));
}

#[test]
fn far_scenes_keep_their_digits() {
    let body =
        |x: f64| format!("<shape type='rectangle'><transform name='to_world'><translate x='{x}' y='{x}'/></transform></shape>");
    let (near, far) = (scene(&body(0.0)), scene(&body(1e6)));
    let positions = |s: &Scene| match &s.shapes[0].surface {
        ShapeSurface::Mesh(mesh) => mesh.positions.clone(),
        ShapeSurface::Sphere(_) => Vec::new(),
    };
    assert_eq!(positions(&near), positions(&far), "recentred in f64");
}

#[test]
fn the_projects_own_scenes_load_without_a_warning_about_the_file() {
    let Ok(folder) = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").read_dir() else { return };
    for entry in folder {
        let path = entry.expect("listed").path().join("scene.xml");
        if path.exists() {
            let loaded = load_scene(&path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
            assert!(!loaded.scene.shapes.is_empty() && !loaded.scene.lights.is_empty(), "{}", path.display());
            let dropped = |w: &String| w.contains("were dropped");
            let other: Vec<_> = loaded.scene.warnings.iter().filter(|w| !dropped(w)).collect();
            assert!(other.is_empty(), "{}: {other:?}", path.display());
        }
    }
}
