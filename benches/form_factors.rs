//! Form factors: time for a pair and error, without and with something in between.
//!
//! `cargo bench --bench form_factors` prints one table each; `-- obstructed` the second one alone.

use cube_in_cube::Cubes;
use twopass::form_factor::polygon::Polygon;
use twopass::math::{DAffine3, DVec3};
use twopass::run_report::process_cpu_seconds;

#[path = "../tests/laws/cube_in_cube.rs"]
mod cube_in_cube;

fn main() {
    if std::env::args().all(|argument| argument != "obstructed") {
        open_cube();
    }
    obstructed();
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

/// Cube in cube by the analytic method at several tolerances, against `tests/data/cube_in_cube/transfers.csv`.
fn obstructed() {
    let cubes = Cubes::new();
    println!("cube in cube, {} patches", cubes.squares.len());
    println!(
        "tolerance   us/ordered pair   worst row sum   Frobenius   worst entry of the unobstructed, of itself if > 1 %, > 0.1 %   largest F"
    );
    for tolerance in [1e-2, 3e-3, 1e-3, 3e-4, 1e-4] {
        let start = process_cpu_seconds();
        let rows = cubes.transfers(tolerance);
        let seconds = process_cpu_seconds() - start;
        let errors = cubes.errors(&rows);
        println!(
            "{tolerance:9.0e}   {:15.3}   {:13.2e}   {:9.2e}   {:.2e}   {:.2e}   {:.2e}   {:.4}",
            seconds * 1e6 / errors.pairs as f64,
            errors.row_sum,
            errors.frobenius,
            errors.of_free,
            errors.of_entry,
            errors.of_small,
            errors.largest
        );
    }
}
