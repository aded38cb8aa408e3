//! Form factors: time for a pair and error, without and with something in between.
//!
//! `cargo bench --bench form_factors` prints one table each; `-- reference` computes the reference of the obstructed scene, by the exact
//! kernel times a million rays a pair, into the file named next, for one pair in a hundred.

use std::fmt::Write as _;
use std::path::Path;
use twopass::accel::AccelKind;
use twopass::form_factor::method::{FormFactorMethod, FormFactorSettings, analytic};
use twopass::form_factor::polygon::Polygon;
use twopass::form_factor::visibility::{point_of, segment};
use twopass::geometry::tessellate;
use twopass::material::{Material, MaterialId, Surface, Texture};
use twopass::math::{DAffine3, DMat3, DVec2, DVec3, Rgb, Sampler};
use twopass::patch::{PatchId, PatchMesh, PatchSettings};
use twopass::progress::silent;
use twopass::run_report::process_cpu_seconds;
use twopass::scene::camera::FovAxis;
use twopass::scene::{Camera, FilmSettings, Scene, SceneSource, ShapeSource, SurfaceSource};
use twopass::world::World;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    match arguments.first().map(String::as_str) {
        Some("reference") => reference(Path::new(arguments.get(1).map_or("cube_in_cube.csv", String::as_str))),
        Some("obstructed") => obstructed(arguments.get(1).map(Path::new)),
        _ => {
            open_cube();
            obstructed(None);
        }
    }
}

/// A turn about no axis of the cube, and a shift.
fn generic() -> DAffine3 {
    DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.83)
        * DAffine3::from_translation(DVec3::new(0.3, 0.1, -0.7))
}

/// Corner and edges of the walls of the unit cube, seen from inside.
fn walls() -> [[DVec3; 3]; 6] {
    let (o, x, y, z) = (DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
    [[o, y, z], [x, z, y], [o, z, x], [y, x, z], [o, x, y], [z, y, x]]
}

/// Closed unit cube of 2400 squares, every pair by the kernel alone, against Lambert's formula under a product rule for every 40th row.
fn open_cube() {
    const N: usize = 20;
    let h = 1.0 / N as f64;
    let squares: Vec<Polygon> = walls()
        .iter()
        .flat_map(|[c, e1, e2]| {
            (0..N * N).filter_map(move |k| {
                let at = |i: usize, j: usize| generic().transform_point3(*c + *e1 * (i as f64 * h) + *e2 * (j as f64 * h));
                let (i, j) = (k / N, k % N);
                Polygon::new(&[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
            })
        })
        .collect();
    let n = squares.len();
    let all = |tolerance: f64| {
        let mut upper = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..i {
                upper[i * n + j] = squares[i].transfer(&squares[j], tolerance);
            }
        }
        upper
    };
    println!("open cube, {n} patches, generic orientation");
    println!("tolerance   us/ordered pair   Frobenius   worst pair   worst row sum");
    let exact = all(1e-12);
    let pairs = 2 * exact.iter().filter(|v| **v > 0.0).count();
    let norm: f64 = exact.iter().map(|v| v * v).sum::<f64>().sqrt();
    for tolerance in [1e-3, 1e-4, 3e-5, 1e-5, 1e-6, 1e-8] {
        let start = process_cpu_seconds();
        let got = all(tolerance);
        let seconds = process_cpu_seconds() - start;
        let error: f64 = got.iter().zip(&exact).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        let worst = got.iter().zip(&exact).filter(|(_, b)| **b > 0.0).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        let mut sums = vec![0.0; n];
        for i in 0..n {
            for j in 0..i {
                sums[i] += got[i * n + j] / squares[i].area();
                sums[j] += got[i * n + j] / squares[j].area();
            }
        }
        let row = sums.iter().map(|s| (s - 1.0).abs()).fold(0.0, f64::max);
        println!(
            "{tolerance:9.0e}   {:15.4}   {:9.2e}   {worst:10.2e}   {row:13.2e}",
            seconds * 1e6 / pairs as f64,
            error / norm
        );
    }
    let (mut error, mut norm) = (0.0, 0.0);
    for i in (0..n).step_by(40) {
        for j in (0..n).filter(|&j| j / (N * N) != i / (N * N)) {
            let (a, b) = (i.max(j), i.min(j));
            let want = lambert(&squares[i], &squares[j]);
            error += (exact[a * n + b] - want).powi(2);
            norm += want * want;
        }
    }
    println!(
        "finest against Lambert's formula under 32 x 32 panels of 2 x 2 Gauss points (60 rows): Frobenius {:.2e}",
        f64::sqrt(error / norm)
    );
}

/// The exchange of two squares by Lambert's formula at many points of the first: singular edges leave about 1e-7.
fn lambert(p: &Polygon, q: &Polygon) -> f64 {
    const PANELS: usize = 32;
    const AT: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
    let c = p.corners();
    let (e1, e2) = (c[1] - c[0], c[3] - c[0]);
    let place = |k: usize| ((k / 2) as f64 + AT[k % 2]) / PANELS as f64;
    let value = |i: usize, j: usize| {
        let x = c[0] + e1 * place(i) + e2 * place(j);
        twopass::form_factor::analytic::point_to_polygon(x, p.normal(), q.corners())
    };
    let near = p.center().distance(q.center()) < 4.0 * p.radius();
    let n = if near { 2 * PANELS } else { 8 };
    let scale = if near { 1.0 } else { PANELS as f64 / 4.0 };
    let value = |i: usize, j: usize| {
        if near {
            value(i, j)
        } else {
            let at = |k: usize| ((k / 2) as f64 + AT[k % 2]) / PANELS as f64 * scale;
            twopass::form_factor::analytic::point_to_polygon(c[0] + e1 * at(i) + e2 * at(j), p.normal(), q.corners())
        }
    };
    let sum: f64 = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).map(|(i, j)| value(i, j)).sum();
    sum / (n * n) as f64 * p.area()
}

/// A cube of half the size turned by nothing in a cube, as View3D's cases have it.
fn cube_in_cube() -> (World, PatchMesh) {
    let grey = Surface {
        name: "grey".to_owned(),
        material: Material::Diffuse { reflectance: Texture::Constant(Rgb::grey(0.5)) },
        two_sided: false,
        relief: None,
    };
    let mut shapes = Vec::new();
    let mut add = |corner: DVec3, e1: DVec3, e2: DVec3| {
        let place = DAffine3 {
            matrix3: DMat3::from_cols(0.5 * e1, 0.5 * e2, e1.cross(e2).normalize()),
            translation: corner + 0.5 * (e1 + e2),
        };
        shapes.push(ShapeSource {
            id: format!("wall{}", shapes.len()),
            surface: SurfaceSource::Triangles(tessellate::rectangle(&place)),
            material: MaterialId(0),
            emission: Texture::Constant(Rgb::BLACK),
        });
    };
    for [c, e1, e2] in walls() {
        add(c, e1, e2);
        add(DVec3::splat(0.25) + 0.5 * c, 0.5 * e2, 0.5 * e1);
    }
    let camera = Camera {
        to_scene: DAffine3::from_translation(DVec3::splat(0.1)),
        fov: 1.0,
        fov_axis: FovAxis::X,
        principal_point: DVec2::ZERO,
        near_clip: 1e-3,
        far_clip: 10.0,
    };
    let film = FilmSettings { width: 4, height: 4, sample_count: 1, max_depth: None };
    let source = SceneSource {
        name: "cube in cube".to_owned(),
        camera,
        film,
        shapes,
        materials: vec![grey],
        lights: Vec::new(),
        environment: None,
        warnings: Vec::new(),
    };
    let world = World::new(Scene::new(source).expect("a valid scene"), AccelKind::default()).expect("a world");
    let settings = PatchSettings { patch_size: Some(0.1112), ..PatchSettings::default() };
    let patches = PatchMesh::build(&world, &settings).expect("patches");
    (world, patches)
}

/// Transfers by the exact kernel times a visible share by a million rays a pair; in f64 from points of the polygons.
fn reference(path: &Path) {
    let (world, patches) = cube_in_cube();
    let polygons = polygons(&world, &patches);
    let n = polygons.len();
    let mut text = String::from("i,j,transfer,visible\n");
    let rows: Vec<String> = {
        use rayon::prelude::*;
        (0..n)
            .into_par_iter()
            .map(|i| {
                let mut lines = String::new();
                for j in i + 1..n {
                    let free = polygons[i].transfer(&polygons[j], 1e-10);
                    if free > 0.0 && is_sampled(i, j) {
                        let visible = visible(&world, &polygons[i], &polygons[j], (i * n + j) as u64);
                        writeln!(lines, "{i},{j},{free:e},{visible}").expect("into memory");
                    }
                }
                lines
            })
            .collect()
    };
    text.extend(rows);
    std::fs::write(path, text).expect("writable");
}

/// One pair in a hundred, by a hash: a million rays for each of all would take hours.
fn is_sampled(i: usize, j: usize) -> bool {
    twopass::math::sampler::mix((i << 32 | j) as u64).is_multiple_of(100)
}

fn polygons(world: &World, patches: &PatchMesh) -> Vec<Polygon> {
    let of = |i: usize| {
        let corners = patches.polygons(world, PatchId(i as u32)).expect("flat");
        Polygon::new(&corners[0]).expect("an area")
    };
    (0..patches.len()).map(of).collect()
}

/// Visible share of the kernel: 256 rays, and where they disagree a million in all.
fn visible(world: &World, p: &Polygon, q: &Polygon, key: u64) -> f64 {
    let (mut whole, mut seen) = (0.0, 0.0);
    for k in 0..1_000_000_u64 {
        let mut sampler = Sampler::new(77, key, k);
        let (a, b) = (point_of(p, &mut sampler), point_of(q, &mut sampler));
        let d = b - a;
        let weight = (d.dot(p.normal()) * -d.dot(q.normal())).max(0.0) / d.length_squared().powi(2);
        whole += weight;
        if weight > 0.0 && !world.occluded(&segment(a, p.normal(), b, q.normal())) {
            seen += weight;
        }
        if k == 4095 && (seen == 0.0 || seen == whole) {
            break;
        }
    }
    if whole > 0.0 { seen / whole } else { 0.0 }
}

/// Cube in cube by the analytic method at several tolerances, against the reference if there is one.
fn obstructed(reference: Option<&Path>) {
    let (world, patches) = cube_in_cube();
    let n = patches.len();
    println!("cube in cube, {n} patches");
    println!(
        "tolerance   us/ordered pair   worst row sum   Frobenius   worst entry of the unobstructed, of the entry   largest F"
    );
    let exact = reference.map(|path| read(path, n));
    for tolerance in [1e-2, 3e-3, 1e-3, 3e-4, 1e-4] {
        let settings = FormFactorSettings {
            method: FormFactorMethod::Analytic,
            tolerance,
            shadow_rays: 32.0,
            extended: true,
            virtual_rooms: None,
            seed: 1,
        };
        let start = process_cpu_seconds();
        let rows = analytic(&world, &patches, &settings, &mut silent).expect("not stopped");
        let seconds = process_cpu_seconds() - start;
        let pairs = 2 * rows.iter().map(Vec::len).sum::<usize>();
        let (mut sums, mut largest, mut got) = (vec![0.0; n], 0.0_f64, vec![0.0; n * n]);
        for (i, row) in rows.iter().enumerate() {
            for (j, t) in row {
                let j = *j as usize;
                got[i * n + j] = t.value;
                for (a, b) in [(i, t.value / patches.area[i]), (j, t.value / patches.area[j])] {
                    sums[a] += b;
                    largest = largest.max(b);
                }
            }
        }
        let row = sums.iter().map(|s| (s - 1.0).abs()).fold(0.0, f64::max);
        print!("{tolerance:9.0e}   {:15.3}   {row:13.2e}", seconds * 1e6 / pairs as f64);
        if let Some(exact) = &exact {
            let (mut error, mut norm, mut of_free, mut of_entry) = (0.0, 0.0, 0.0_f64, 0.0_f64);
            for i in 0..n {
                for j in i + 1..n {
                    let (free, visible) = exact[i * n + j];
                    if free == 0.0 {
                        continue;
                    }
                    let (want, got) = (free * visible, got[i * n + j]);
                    for a in [patches.area[i], patches.area[j]] {
                        error += ((got - want) / a).powi(2);
                        norm += (want / a).powi(2);
                    }
                    if free > 0.0 {
                        of_free = of_free.max((got - want).abs() / free);
                    }
                    if visible > 0.01 {
                        of_entry = of_entry.max((got / want - 1.0).abs());
                    }
                }
            }
            print!("   {:9.2e}   {of_free:.2e}   {of_entry:.2e}", f64::sqrt(error / norm));
        }
        println!("   {largest:.4}");
    }
}

/// (unobstructed transfer, visible share) by pair.
fn read(path: &Path, n: usize) -> Vec<(f64, f64)> {
    let mut all = vec![(0.0, 0.0); n * n];
    for line in std::fs::read_to_string(path).expect("readable").lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |k: usize| fields[k].parse::<f64>().expect("a number");
        all[number(0) as usize * n + number(1) as usize] = (number(2), number(3));
    }
    all
}
