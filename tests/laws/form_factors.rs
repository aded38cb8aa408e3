//! Form factors against exact values, row by row of tests/data/form_factor_cases.csv, each in its class, and method by method.

use crate::cli::Place;
use crate::support::{Room, close};
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::path::Path;
use twopass::accel::AccelKind;
use twopass::form_factor::FormFactors;
use twopass::form_factor::analytic;
use twopass::form_factor::blockers::Blockers;
use twopass::form_factor::method::{self, FormFactorMethod, FormFactorSettings};
use twopass::form_factor::polygon::shadow::ShadowCutter;
use twopass::form_factor::polygon::{Polygon, transfer};
use twopass::form_factor::visibility::Between;
use twopass::load::{LoadOptions, load_scene};
use twopass::math::{DVec3, Rgb};
use twopass::patch::{PatchMesh, PatchSettings};
use twopass::progress::silent;
use twopass::radiosity::{self, RadiositySystem, SolverSettings};
use twopass::world::World;
use twopass::world::walk::RayCounts;

const CASES: &str = include_str!("../data/form_factor_cases.csv");

/// One row: name, geometry, exact form factor.
struct Case {
    name: String,
    geometry: Value,
    want: f64,
}

impl Case {
    fn number(&self, name: &str) -> f64 {
        self.geometry[name].as_f64().unwrap_or_else(|| panic!("{}: no {name}", self.name))
    }

    fn points(&self, name: &str) -> Vec<DVec3> {
        let point = |p: &Value| DVec3::from_array(std::array::from_fn(|i| p[i].as_f64().expect("a number")));
        self.geometry[name].as_array().expect("points").iter().map(point).collect()
    }

    fn point(&self, name: &str) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|i| self.geometry[name][i].as_f64().expect("a number")))
    }
}

fn cases() -> Vec<Case> {
    let mut reader = csv::Reader::from_reader(CASES.as_bytes());
    let rows = reader.records().map(|row| {
        let row = row.expect("a row");
        let geometry = serde_json::from_str(&row[1]).expect("JSON");
        Case { name: row[0].to_owned(), geometry, want: row[2].parse().expect("a number") }
    });
    rows.collect()
}

fn rectangle(corner: DVec3, e1: DVec3, e2: DVec3) -> Vec<DVec3> {
    vec![corner, corner + e1, corner + e1 + e2, corner + e2]
}

/// What is done with a row.
enum Class {
    /// Two finite polygons with nothing between, through the command line.
    Polygons([Vec<DVec3>; 2]),
    /// Two finite polygons with others between, through the command line: all, the first two of them asked for.
    Occluded(Vec<Vec<DVec3>>),
    /// A differential element: what the kernel gives.
    Element(f64),
    /// A curved shape: what the closed form gives, and factors of meshes of rising fineness.
    Curved(f64, fn(&Case, u32) -> f64),
    /// A law that other rows or tests hold: closure and reciprocity of spheres.
    Spheres,
    /// A scene by itself: the cube in a cube.
    CubeInCube,
}

fn class(case: &Case) -> Class {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let get = |name: &str| case.number(name);
    let square = |corner: DVec3, side: f64| rectangle(corner, side * x, side * y);
    let down = |corner: DVec3, along_x: f64, along_y: f64| rectangle(corner, along_y * y, along_x * x);
    match case.geometry["type"].as_str().expect("a type") {
        "parallel_rect" => {
            let (a, b, c) = (get("a"), get("b"), get("c"));
            Class::Polygons([rectangle(DVec3::ZERO, a * x, b * y), down(c * z, a, b)])
        }
        "perp_rect_common_edge" => {
            let (l, w, h) = (get("l"), get("w"), get("h"));
            Class::Polygons([rectangle(DVec3::ZERO, w * x, l * y), rectangle(DVec3::ZERO, l * y, h * z)])
        }
        "cube" => Class::Polygons([square(DVec3::ZERO, 1.0), down(z, 1.0, 1.0)]),
        "polygon_pair" => Class::Polygons([case.points("P"), case.points("Q")]),
        // Infinite strips as long ones, seen from a short piece in the middle: what is cut off counts as 1/length².
        "infinite_strips" => {
            let (half, screen) = (5e3, case.geometry.get("screen").is_some());
            let mut all = vec![rectangle(-0.5 * y, x, y), down(z - half * y, 1.0, 2.0 * half)];
            if screen {
                all.push(rectangle(DVec3::new(0.25, -half, 0.5), 0.5 * x, 2.0 * half * y));
            }
            Class::Occluded(all)
        }
        "occluded_squares" => {
            let blocker = square(DVec3::new(0.25, 0.25, 0.5), 0.5);
            Class::Occluded(vec![square(DVec3::ZERO, 1.0), down(z, 1.0, 1.0), blocker])
        }
        "dA_to_polygon" => {
            let n = case.point("n").normalize();
            Class::Element(analytic::point_to_polygon(case.point("p"), n, &case.points("Q")))
        }
        // A disk as a polygon of its area.
        "dA_to_disk" => Class::Curved(analytic::coaxial_disks(1e-9, get("R"), get("h")), element_to_disk),
        "dA_occluded" => {
            let centred =
                |half: f64, height: f64| Polygon::new(&square(DVec3::new(-half, -half, height), 2.0 * half)).expect("area");
            let (whole, blocker) = (centred(0.5, 1.0), centred(0.125, 0.5));
            Class::Element(ShadowCutter::default().whole_and_visible(DVec3::ZERO, z, &whole, &[blocker]).1)
        }
        "coaxial_disks" => Class::Curved(analytic::coaxial_disks(get("r1"), get("r2"), get("h")), disks),
        "disk_to_coaxial_sphere" => {
            Class::Curved(analytic::disk_to_sphere(get("rs"), get("rd"), get("h_centre")), disk_to_sphere)
        }
        "sphere_to_rect_corner" => {
            Class::Curved(analytic::sphere_to_rectangle(get("d"), get("l1"), get("l2")), sphere_to_rectangle)
        }
        "concentric_spheres" => Class::Spheres,
        "concentric_cylinders_finite" => {
            let (inner, itself) = analytic::coaxial_cylinders(get("r1"), get("r2"), get("L"));
            let (value, mesh): (f64, fn(&Case, u32) -> f64) =
                if case.name.contains("_21_") { (inner, cylinders) } else { (itself, cylinder_past_another) };
            Class::Curved(value, mesh)
        }
        "cylinder_side_to_itself" => Class::Curved(analytic::cylinder_inside(get("r"), get("h")), cylinder_inside),
        "cube_in_cube" => Class::CubeInCube,
        other => panic!("{}: no class for {other}", case.name),
    }
}

/// A regular polygon around the z axis, of the radius that gives it the area of the circle.
fn ring(radius: f64, z: f64, sides: u32) -> Vec<DVec3> {
    let step = TAU / f64::from(sides);
    let r = radius * (step / step.sin()).sqrt();
    (0..sides).map(|k| f64::from(k) * step).map(|phi| DVec3::new(r * phi.cos(), r * phi.sin(), z)).collect()
}

fn turned(polygon: &[DVec3]) -> Vec<DVec3> {
    polygon.iter().rev().copied().collect()
}

fn sum(from: &[Vec<DVec3>], to: &[Vec<DVec3>]) -> f64 {
    let prepare = |all: &[Vec<DVec3>]| all.iter().filter_map(|p| Polygon::new(p)).collect::<Vec<_>>();
    let (from, to) = (prepare(from), prepare(to));
    let area: f64 = from.iter().map(Polygon::area).sum();
    from.iter().flat_map(|p| to.iter().map(|q| p.transfer(q, 1e-8))).sum::<f64>() / area
}

fn element_to_disk(case: &Case, n: u32) -> f64 {
    let disk = turned(&ring(case.number("R"), case.number("h"), n));
    analytic::point_to_polygon(DVec3::ZERO, DVec3::Z, &disk)
}

fn disks(case: &Case, n: u32) -> f64 {
    let upper = turned(&ring(case.number("r2"), case.number("h"), n));
    sum(&[ring(case.number("r1"), 0.0, n)], &[upper])
}

/// The outside of a sphere around the origin as a polyhedron with its corners on it, in rings that are evenly spaced in latitude.
fn ball(radius: f64, n: u32) -> Vec<Vec<DVec3>> {
    let at = |i: u32, k: u32| {
        let (st, ct) = (PI * f64::from(i) / f64::from(n)).sin_cos();
        let (sp, cp) = (PI * f64::from(k) / f64::from(n)).sin_cos();
        radius * DVec3::new(st * cp, st * sp, ct)
    };
    let cells = (0..n).flat_map(|i| (0..2 * n).map(move |k| (i, k)));
    cells.map(|(i, k)| vec![at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]).collect()
}

fn disk_to_sphere(case: &Case, n: u32) -> f64 {
    let disk = ring(case.number("rd"), -case.number("h_centre"), 4 * n);
    sum(&[disk], &ball(case.number("rs"), n))
}

fn sphere_to_rectangle(case: &Case, n: u32) -> f64 {
    let rectangle = turned(&rectangle(DVec3::Z * case.number("d"), DVec3::X * case.number("l1"), DVec3::Y * case.number("l2")));
    sum(&ball(0.5, n), &[rectangle])
}

/// The outside of a cylinder around z.
fn mantle(radius: f64, length: f64, sides: u32) -> Vec<Vec<DVec3>> {
    let (low, high) = (ring(radius, 0.0, sides), ring(radius, length, sides));
    let n = sides as usize;
    (0..n).map(|k| vec![low[k], low[(k + 1) % n], high[(k + 1) % n], high[k]]).collect()
}

fn inside(mantle: Vec<Vec<DVec3>>) -> Vec<Vec<DVec3>> {
    mantle.iter().map(|p| turned(p)).collect()
}

fn cylinders(case: &Case, n: u32) -> f64 {
    let l = case.number("L");
    sum(&inside(mantle(case.number("r2"), l, n)), &mantle(case.number("r1"), l, n))
}

/// The outer cylinder to itself past the inner one: from one of its sides, as all are alike.
fn cylinder_past_another(case: &Case, sides: u32) -> f64 {
    let l = case.number("L");
    let outer = inside(mantle(case.number("r2"), l, sides));
    let mut room = Room::new(DVec3::splat(10.0), DVec3::ZERO, 4);
    let grey = room.grey(0.5);
    mantle(case.number("r1"), l, sides).iter().chain(&outer).for_each(|p| room.polygon(p, grey, 0.0));
    let world = world(&room);
    let between = Between {
        world: &world,
        blockers: &Blockers::new(&world),
        tolerance: 1e-5,
        kernel_tolerance: 1e-8,
        ray_tolerance: 1e-6,
        seed: 1,
    };
    let here = |p: &Vec<DVec3>| Polygon::new(&p.iter().map(|c| *c - world.scene().origin).collect::<Vec<_>>()).expect("an area");
    let outer: Vec<Polygon> = outer.iter().map(here).collect();
    let to = |(key, q): (usize, &Polygon)| between.transfer(&outer[0], q, None, key as u64).value;
    outer.iter().enumerate().skip(1).map(to).sum::<f64>() / outer[0].area()
}

fn cylinder_inside(case: &Case, n: u32) -> f64 {
    let walls = inside(mantle(case.number("r"), case.number("h"), n));
    sum(&walls, &walls)
}

/// A scene of polygons as the command line reads it.
fn write_scene(place: &Place, polygons: &[Vec<DVec3>]) {
    let mut scene = String::from("<scene version='3.0.0'><sensor type='perspective'><float name='fov' value='40'/></sensor>");
    for (k, polygon) in polygons.iter().enumerate() {
        let line = |p: &DVec3| format!("v {} {} {}\n", p.x, p.y, p.z);
        let face: Vec<String> = (1..=polygon.len()).map(|i| i.to_string()).collect();
        let text: String = polygon.iter().map(line).collect();
        place.write(&format!("p{k}.obj"), &format!("{text}f {}\n", face.join(" ")));
        scene += &format!("<shape type='obj' id='p{k}'><string name='filename' value='p{k}.obj'/><bsdf type='diffuse'/></shape>");
    }
    place.write("scene.xml", &(scene + "</scene>"));
}

/// Form factor and standard error by (from, to).
fn table(place: &Place, flags: &str) -> BTreeMap<(String, String), (f64, f64)> {
    let (out, err) = place.expect(0, &format!("form-factors scene.xml {flags}"));
    let last = err.lines().last().unwrap_or_default();
    assert!(last.contains("row-sum defect") && last.contains("reciprocity defect"), "last line: {last}");
    let mut lines = out.lines();
    assert_eq!(lines.next(), Some("from,to,area_from,area_to,form_factor,std_error"));
    let row = |line: &str| {
        let f: Vec<&str> = line.split(',').collect();
        let number = |k: usize| f[k].parse::<f64>().expect("a number");
        ((f[0].to_owned(), f[1].to_owned()), (number(4), number(5)))
    };
    lines.map(row).collect()
}

fn between(table: &BTreeMap<(String, String), (f64, f64)>, from: &str, to: &str) -> (f64, f64) {
    table.get(&(from.to_owned(), to.to_owned())).copied().unwrap_or_default()
}

#[test]
fn every_row_of_the_table_in_its_class() {
    let mut found = [0; 6];
    let place = Place::new();
    for case in cases() {
        let (name, want) = (&case.name, case.want);
        match class(&case) {
            Class::Polygons(polygons) => {
                found[0] += 1;
                let area = Polygon::new(&polygons[0]).expect("an area").area();
                close(name, transfer(&polygons[0], &polygons[1], 1e-11) / area, want, 1e-9);
                write_scene(&place, &polygons);
                let (f, error) = between(&table(&place, ""), "p0", "p1");
                close(&format!("{name}, command line"), f, want, 1e-9);
                assert!((f - want).abs() <= 3.0 * error + 1e-9 * want, "{name}: {f} +- {error}, expected {want}");
            }
            Class::Occluded(polygons) => {
                found[1] += 1;
                write_scene(&place, &polygons);
                for (flags, allowed) in [("", 2e-3), ("--tolerance 1e-4", 2e-4)] {
                    let (f, _) = between(&table(&place, flags), "p0", "p1");
                    close(&format!("{name} {flags}"), f, want, allowed);
                }
            }
            Class::Element(got) => {
                found[2] += 1;
                close(name, got, want, 1e-9);
            }
            Class::Curved(closed, mesh) => {
                found[3] += 1;
                close(&format!("{name}, closed form"), closed, want, 1e-9);
                let [a, b] = [24, 48].map(|n| (mesh(&case, n) - want).abs() / want);
                let order = (a / b).log2();
                assert!(order >= 1.9 || b < 1e-9, "{name}: order {order} between errors {a:e} and {b:e}");
            }
            Class::Spheres => found[4] += 1,
            Class::CubeInCube => found[5] += 1,
        }
    }
    // Polygons, occluded and strips, differential elements, curved, spheres, cube in cube: all 59 rows.
    assert_eq!(found, [29, 3, 5, 16, 4, 2]);
}

/// Rows concentric_spheres_*: the sphere's cells are curved, so points and rays measure them, with an error that is stated.
#[test]
fn concentric_spheres_within_the_stated_error() {
    for case in cases().iter().filter(|c| matches!(class(c), Class::Spheres)) {
        let (r1, r2) = (case.number("r1"), case.number("r2"));
        let closed = if case.name.contains("_22_") { 1.0 - (r1 / r2).powi(2) } else { (r1 / r2).powi(2) };
        close(&case.name, closed, case.want, 1e-12);
    }
    let place = Place::new();
    let sphere = |id: &str, r: f64, flip: bool| {
        format!(
            "<shape type='sphere' id='{id}'><float name='radius' value='{r}'/><boolean name='flip_normals' value='{flip}'/><bsdf type='twosided'><bsdf type='diffuse'/></bsdf></shape>"
        )
    };
    let scene = format!(
        "<scene version='3.0.0'><sensor type='perspective'><float name='fov' value='40'/></sensor>{}{}</scene>",
        sphere("inner", 0.5, false),
        sphere("outer", 1.0, false)
    );
    place.write("scene.xml", &scene);
    for flags in ["--patch-size 0.3", "--patch-size 0.3 --form-factors ray-cast", "--patch-size 0.3 --form-factors hemicube"] {
        let table = table(&place, flags);
        for (to, want) in [("inner", 0.25), ("outer (back)", 0.75)] {
            let (f, error) = between(&table, "outer (back)", to);
            assert!((f - want).abs() <= 3.0 * error && error < 0.02, "{flags}, to {to}: {f} +- {error}, expected {want}");
        }
    }
}

fn world(room: &Room) -> World {
    World::new(room.scene(), AccelKind::default()).expect("a world")
}

fn patches(world: &World, patch_size: f64) -> PatchMesh {
    PatchMesh::build(world, &PatchSettings { patch_size: Some(patch_size), ..PatchSettings::default() }).expect("patches")
}

fn settings(method: FormFactorMethod, tolerance: f64) -> FormFactorSettings {
    FormFactorSettings { method, tolerance, shadow_rays: 32.0, extended: true, virtual_rooms: None, in_pairs: false, seed: 1 }
}

/// Polygons of a cube of half the size in the middle of a unit cube: six walls, then six faces.
fn cube_in_cube() -> Vec<Vec<DVec3>> {
    let (o, x, y, z) = (DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
    let walls = [(o, y, z), (x, z, y), (o, z, x), (y, x, z), (o, x, y), (z, y, x)];
    let faces = walls.map(|(c, e1, e2)| rectangle(DVec3::splat(0.25) + 0.5 * c, 0.5 * e2, 0.5 * e1));
    walls.map(|(c, e1, e2)| rectangle(c, e1, e2)).into_iter().chain(faces).collect()
}

/// Rows OCC_cube_in_cube_*: exact by reciprocity and symmetry. Each method within what it says of itself.
#[test]
fn a_cube_in_a_cube_by_every_method() {
    let place = Place::new();
    write_scene(&place, &cube_in_cube());
    for (flags, allowed) in [
        ("", Some(2e-3)),
        ("--tolerance 1e-4", Some(2e-4)),
        ("--form-factors ray-cast --patch-size 0.25", None),
        ("--form-factors hemicube --patch-size 0.25", None),
    ] {
        let table = table(&place, flags);
        let total = |range: std::ops::Range<usize>| {
            let all = range.map(|k| between(&table, "p0", &format!("p{k}")));
            all.fold((0.0, 0.0_f64), |(f, e), (g, d)| (f + g, e.hypot(d)))
        };
        for (what, (f, error), want) in [("inner", total(6..12), 0.25), ("outer", total(0..6), 0.75)] {
            let allowed = allowed.map_or(3.0 * error, |relative| relative * want);
            assert!((f - want).abs() <= allowed && f <= 1.0, "{flags}, to {what}: {f} +- {error}, expected {want}");
        }
    }
}

/// Patches of the cube in a cube: bounds, reciprocity and closure hold for every entry, before and after the correction.
#[test]
fn entries_are_bounded_reciprocal_and_closed() {
    let mut room = Room::new(DVec3::splat(0.1), DVec3::ONE, 4);
    let grey = room.grey(0.5);
    for p in cube_in_cube() {
        room.quad(p[0], p[1] - p[0], p[3] - p[0], grey, 0.0);
    }
    let world = world(&room);
    let mesh = patches(&world, 0.25);
    for method in [FormFactorMethod::Analytic, FormFactorMethod::Hemicube] {
        let how = settings(method, method.default_tolerance());
        let (stored, outside) = method::build(&world, &mesh, &how, &mut RayCounts::default(), &mut silent).expect("not stopped");
        let matrix = stored.rows().expect("kept as rows");
        let name = method.name();
        assert_eq!(matrix.closure.reciprocity_defect, 0.0, "{name}");
        for i in 0..mesh.len() {
            assert!((matrix.direct_sum(i) - 1.0).abs() < 1e-12, "{name}: row {i} sums to {}", matrix.direct_sum(i));
            assert_eq!(outside.escaped(i), Rgb::BLACK, "{name}: row {i}");
            for (j, f) in matrix.direct(i) {
                let back = matrix.direct(j).find(|e| e.0 == i).map_or(0.0, |e| e.1);
                let (there, here) = (mesh.area[i] * f, mesh.area[j] * back);
                assert!((there - here).abs() <= 4.0 * f64::EPSILON * there, "{name}: {i}, {j}: {there}, backwards {here}");
                assert!(f > 0.0 && there <= mesh.area[i].min(mesh.area[j]), "{name}: {i}, {j}: {f}");
            }
        }
    }
    let rows = method::analytic(&world, &mesh, &settings(FormFactorMethod::Analytic, 1e-3), &mut silent).expect("not stopped");
    for (i, row) in rows.iter().enumerate() {
        for (j, t) in row {
            let of = |k: usize| mesh.polygons(&world, twopass::patch::PatchId(k as u32)).expect("flat").swap_remove(0);
            let free = transfer(&of(i), &of(*j as usize), 1e-6);
            assert!(t.value <= free * (1.0 + 1e-4), "{i}, {j}: {}, unobstructed {free}", t.value);
        }
    }
}

/// The same bits by one thread and by two.
#[test]
fn threads_do_not_change_a_bit() {
    let mut room = Room::new(DVec3::splat(0.1), DVec3::ONE, 4);
    let grey = room.grey(0.5);
    for p in cube_in_cube() {
        room.quad(p[0], p[1] - p[0], p[3] - p[0], grey, 0.0);
    }
    room.sphere(DVec3::splat(0.1), 0.05, grey, 0.0);
    let world = world(&room);
    let mesh = patches(&world, 0.25);
    for method in [FormFactorMethod::Analytic, FormFactorMethod::Hemicube, FormFactorMethod::RayCast] {
        let how = settings(method, method.default_tolerance());
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let built = pool.install(|| method::build(&world, &mesh, &how, &mut RayCounts::default(), &mut silent));
            let (stored, _) = built.expect("not stopped");
            let matrix = stored.rows().expect("kept as rows");
            (0..mesh.len())
                .flat_map(|i| matrix.direct(i).map(|(j, f)| (i, j, f.to_bits())).collect::<Vec<_>>())
                .collect::<Vec<_>>()
        };
        assert!(run(1) == run(2), "{}", method.name());
    }
}

/// `scenes/light-tube`: a tube of diameter 1 with diffuse walls, a lamp for its entry and a black exit. It has 16 sides: with the circle's area,
/// transmissions are within 0.45 % of the circle's, by a count of rings that was doubled until it did not matter.
fn light_tube(length: f64) -> World {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/light-tube/scene.xml");
    let options = LoadOptions { defines: vec![("length".to_owned(), length.to_string())], ..LoadOptions::default() };
    World::new(load_scene(&file, &options).expect("a scene").scene, AccelKind::default()).expect("built")
}

/// [diffuse_wall_tube.csv]: what enters one opening of a tube with diffuse walls and leaves by the other, within 0.5 %.
#[test]
fn light_passes_a_diffuse_tube_as_clausing_says() {
    let rows = include_str!("../data/diffuse_wall_tube.csv");
    let number = |text: &str, before: &str| -> f64 {
        let from = text.find(before).unwrap_or_else(|| panic!("no {before} in {text}")) + before.len();
        let end = text[from..].find([',', '"', ' ']).map_or(text.len(), |k| from + k);
        text[from..end].parse().expect("a number")
    };
    let mut compared = 0;
    for (length, patch_size) in [(2.0, 0.1), (5.0, 0.1), (10.0, 0.1)] {
        let world = light_tube(length);
        let mesh = patches(&world, patch_size);
        let how = settings(FormFactorMethod::Analytic, 1e-3);
        let (matrix, _) = method::build(&world, &mesh, &how, &mut RayCounts::default(), &mut silent).expect("not stopped");
        let shapes = mesh.shapes(&world);
        let is = |i: usize, id: &str| world.scene().shapes[shapes[i]].id == id;
        let emitted: Vec<Rgb> = (0..mesh.len()).map(|i| if is(i, "entry") { Rgb::WHITE } else { Rgb::BLACK }).collect();
        let mut source = vec![Rgb::BLACK; mesh.len()];
        matrix.gather(&emitted, &mut source);
        for row in rows.lines().filter(|r| r.contains(&format!("L/d={length}\""))) {
            let (rho, want) = (number(row, "rho="), number(row, "exit "));
            let reflectance: Vec<Rgb> = (0..mesh.len()).map(|i| Rgb::grey(if is(i, "tube") { rho } else { 0.0 })).collect();
            let system = RadiositySystem { rho: &reflectance, area: &mesh.area, form_factors: &matrix, source: source.clone() };
            let solution = radiosity::solve(&system, &SolverSettings::default(), &mut silent).expect("a steady state");
            let flux = |of: &str, value: &dyn Fn(usize) -> f64| -> f64 {
                (0..mesh.len()).filter(|i| is(*i, of)).map(|i| mesh.area[i] * value(i)).sum()
            };
            let passed = flux("exit", &|i| solution.irradiance[i].g) / flux("entry", &|_| 1.0);
            close(&format!("rho {rho}, L/d {length}, {} patches", mesh.len()), passed, want, 5e-3);
            compared += 1;
        }
    }
    assert_eq!(compared, 18);
}
