//! The solvers of pass one: all find the same solution, the one that elimination finds, and say truly how far they are from it.

use std::path::Path;
use twopass::form_factor::FormFactors;
use twopass::math::Rgb;
use twopass::progress::silent;
use twopass::radiosity::{self, RadiositySystem, Solution, SolveError, Solver, SolverSettings};
use twopass::stability::enclosures::{Dense, cube, rooms_in_a_row};
use twopass::stability::oracle::solve_dense;

fn near(got: f64, want: f64, relative: f64) -> bool {
    (got - want).abs() <= relative * want.abs()
}

/// The larger; NaN is the largest.
fn worse(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

const STATIONARY: [Solver; 3] = [Solver::GaussSeidel, Solver::Jacobi, Solver::Southwell];
const KRYLOV: [Solver; 3] = [Solver::Cg, Solver::Gmres, Solver::BiCgStab];

/// A system in numbers, grey or coloured.
#[derive(Clone)]
struct Numbers {
    area: Vec<f64>,
    rho: Vec<Rgb>,
    source: Vec<Rgb>,
    form_factors: Dense,
}

impl Numbers {
    /// `exitance` and `rho` by patch.
    fn new(area: &[f64], form_factors: &Dense, rho: impl Fn(usize) -> f64, exitance: impl Fn(usize) -> f64) -> Self {
        let n = area.len();
        let row = |i: usize| &form_factors.factor[i * n..(i + 1) * n];
        let source = |i: usize| Rgb::grey(row(i).iter().enumerate().map(|(j, f)| f * exitance(j)).sum());
        Self {
            area: area.to_vec(),
            rho: (0..n).map(|i| Rgb::grey(rho(i))).collect(),
            source: (0..n).map(source).collect(),
            form_factors: form_factors.clone(),
        }
    }

    /// A room of which every point sees every other alike, as in a sphere, whose parts have these shares of its area.
    fn sphere(shares: &[f64], rho: impl Fn(usize) -> f64, exitance: impl Fn(usize) -> f64) -> Self {
        let n = shares.len();
        Self::new(shares, &Dense { n, factor: shares.repeat(n) }, rho, exitance)
    }

    fn system(&self) -> RadiositySystem<'_> {
        let form_factors: &dyn FormFactors = &self.form_factors;
        RadiositySystem { rho: &self.rho, area: &self.area, form_factors, source: self.source.clone() }
    }

    fn try_solve(&self, solver: Solver, tolerance: f64, max_sweeps: u32) -> Result<Solution, SolveError> {
        radiosity::solve(&self.system(), &SolverSettings { solver, tolerance, max_sweeps }, &mut silent)
    }

    fn solve(&self, solver: Solver, tolerance: f64, max_sweeps: u32) -> Solution {
        self.try_solve(solver, tolerance, max_sweeps).expect("loses light, so there is a steady state")
    }

    /// By elimination, the green channel.
    fn truth(&self) -> Vec<f64> {
        let n = self.area.len();
        let equation = |i: usize| {
            let entry = |j: usize| f64::from(u8::from(i == j)) - self.form_factors.factor[i * n + j] * self.rho[j].g;
            (0..n).map(entry).chain([self.source[i].g]).collect()
        };
        solve_dense((0..n).map(equation).collect())
    }

    /// Largest error of any patch relative to the mean.
    fn error(&self, solution: &Solution, truth: &[f64]) -> f64 {
        let mean = truth.iter().zip(&self.area).map(|(h, a)| h * a).sum::<f64>() / self.area.iter().sum::<f64>();
        solution.irradiance.iter().zip(truth).map(|(h, t)| (h.g - t).abs()).fold(0.0, worse) / mean
    }
}

/// The cube of 600 patches with a lamp of four in the middle of its ceiling.
fn lit_cube(rho: f64) -> Numbers {
    let room = cube(10);
    Numbers::new(&room.area, &room.form_factors, |_| rho, |j| f64::from(u8::from([544, 545, 554, 555].contains(&j))))
}

/// Six solvers and elimination agree, and no bound that is told is broken, converged or not.
#[test]
fn all_solvers_find_what_elimination_finds() {
    for rho in [0.5, 0.9, 0.99] {
        let numbers = lit_cube(rho);
        let truth = numbers.truth();
        for solver in Solver::ALL {
            let found = numbers.solve(solver, 1e-6, 2000);
            let error = numbers.error(&found, &truth);
            assert!(found.converged && error <= 1e-6, "{} at {rho}: error {error}, {found:.2?}", solver.name());
            assert_eq!(found.solver, solver);
            let early = numbers.solve(solver, 1e-6, 7);
            let error = numbers.error(&early, &truth);
            assert!(!early.converged && early.sweeps <= 8, "{} at {rho}: {} sweeps", solver.name(), early.sweeps);
            assert!(error <= early.error_bound, "{} at {rho} after 7: error {error}, bound {}", solver.name(), early.error_bound);
        }
    }
}

/// The bar that makes bright rooms affordable: ten products with the form factors, all preparations included, whatever the reflectance.
#[test]
fn conjugate_gradients_need_ten_products_at_any_reflectance() {
    for rho in [0.9, 0.99, 0.999999] {
        let numbers = lit_cube(rho);
        let found = numbers.solve(Solver::Cg, 1e-6, 10);
        let error = numbers.error(&found, &numbers.truth());
        assert!(error <= 1e-6 && found.sweeps <= 10, "rho {rho}: error {error} after {} products", found.sweeps);
    }
}

#[test]
fn in_a_room_that_loses_a_millionth_krylov_methods_converge_and_the_others_say_they_did_not() {
    let numbers = lit_cube(0.999999);
    let truth = numbers.truth();
    for solver in KRYLOV {
        let found = numbers.solve(solver, 1e-6, 100);
        let error = numbers.error(&found, &truth);
        assert!(
            found.converged && error <= found.error_bound.max(1e-8),
            "{}: error {error}, {}",
            solver.name(),
            found.error_bound
        );
        for amplification in [found.amplification, found.mean_amplification] {
            assert!((amplification / 1e6 - 1.0).abs() < 1e-3, "{}: {amplification}", solver.name());
        }
    }
    for solver in STATIONARY {
        let found = numbers.solve(solver, 1e-6, 200);
        let error = numbers.error(&found, &truth);
        assert!(!found.converged && found.error_bound > 1e-6, "{}: {}", solver.name(), found.error_bound);
        assert!(error <= found.error_bound && found.error_bound.is_finite(), "{}: {error}, {}", solver.name(), found.error_bound);
    }
}

#[test]
fn four_rooms_with_doors_are_found_and_taken_out() {
    let rooms = rooms_in_a_row(4, 8, 2);
    let numbers = |rho: f64| {
        let lamp = |j: usize| rooms.room[j] == 0 && rooms.face[j] == 5;
        Numbers::new(&rooms.area, &rooms.form_factors, |_| rho, |j| f64::from(u8::from(lamp(j))))
    };
    let bright = numbers(0.999999);
    // Two products prepare, three are steps, one verifies.
    let found = bright.solve(Solver::Cg, 1e-6, 6);
    assert_eq!(found.rooms, 4);
    let error = bright.error(&found, &bright.truth());
    assert!(error <= 1e-6 && found.sweeps <= 6, "error {error} after {} products", found.sweeps);
    let found = numbers(0.99).solve(Solver::Cg, 1e-6, 100);
    assert!(found.converged && found.sweeps <= 20, "{} products", found.sweeps);
}

/// One channel at the edge of steady state, one dim and one black, solved together.
#[test]
fn colours_are_solved_together_and_each_is_right() {
    let base = lit_cube(0.9);
    let room = cube(10);
    let rho = |i: usize| Rgb::new(0.9999, if room.face[i] == 2 { 0.0 } else { 0.6 }, 0.0);
    let coloured = Numbers { rho: (0..600).map(rho).collect(), ..base };
    let truth = coloured.truth();
    for solver in KRYLOV {
        let found = coloured.solve(solver, 1e-9, 200);
        assert!(found.converged, "{}", solver.name());
        let mean_red = coloured.system().mean_irradiance(&(0..600).collect::<Vec<_>>(), &found.irradiance);
        for (i, h) in found.irradiance.iter().enumerate() {
            // Blue is the light of the lamp alone. The bound is relative to the brightest channel.
            let wrong = (h.g - truth[i]).abs().max((h.b - coloured.source[i].b).abs());
            assert!(
                wrong <= 1e-9 * mean_red,
                "{} patch {i}: {h:?}, expected {} and {}",
                solver.name(),
                truth[i],
                coloured.source[i].b
            );
        }
    }
}

/// Light that goes one way only, as through a mirror that rays measured from one side.
#[test]
fn without_reciprocity_conjugate_gradients_hand_over_and_say_so() {
    #[derive(Clone)]
    struct OneWay(Dense);
    impl FormFactors for OneWay {
        fn len(&self) -> usize {
            self.0.len()
        }
        fn gather(&self, x: &[Rgb], out: &mut [Rgb]) {
            self.0.gather(x, out);
        }
        fn row(&self, i: usize, visit: &mut dyn FnMut(usize, Rgb)) {
            self.0.row(i, visit);
        }
        fn is_reciprocal(&self) -> bool {
            false
        }
    }
    let mut numbers = lit_cube(0.95);
    // Patches of the floor see twice as much of the first ceiling patch, at the cost of the second.
    for i in 400..500 {
        let (a, b) = (i * 600 + 500, i * 600 + 501);
        let moved = 0.9 * numbers.form_factors.factor[b];
        numbers.form_factors.factor[a] += moved;
        numbers.form_factors.factor[b] -= moved;
    }
    let truth = numbers.truth();
    let factors = OneWay(numbers.form_factors.clone());
    for solver in Solver::ALL {
        let system = RadiositySystem { form_factors: &factors, ..numbers.system() };
        let settings = SolverSettings { solver, tolerance: 1e-7, max_sweeps: 2000 };
        let found = radiosity::solve(&system, &settings, &mut silent).expect("solves");
        let error = numbers.error(&found, &truth);
        assert!(found.converged && error <= 1e-7, "{}: error {error}", solver.name());
        assert_eq!(found.solver, if solver == Solver::Cg { Solver::BiCgStab } else { solver });
    }
    // Said to be reciprocal when they are not: what counts is the residual that is measured, so the answer is right all the same.
    let found = numbers.solve(Solver::Cg, 1e-7, 2000);
    let error = numbers.error(&found, &truth);
    assert!(found.converged && error <= 1e-7, "error {error}, {}", found.error_bound);
}

/// `tests/data/radiosity_exact.csv`: every row, by every solver where its sweeps are bearable.
#[test]
fn enclosures_with_exact_solutions() {
    let number = |text: &str, name: &str| -> f64 {
        let at = text.find(name).unwrap_or_else(|| panic!("{name} in {text}")) + name.len();
        text[at..].chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect::<String>().parse().expect("a number")
    };
    let mut rows = csv::Reader::from_path(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/radiosity_exact.csv")).unwrap();
    let mut seen = 0;
    for row in rows.records().map(Result::unwrap) {
        let (case, parameters) = (&row[0], &row[1]);
        let want: Vec<f64> = row[3].split(';').map(|v| v.trim().parse().expect("a number")).collect();
        let rho = ["rho=", "rho1=rho2=", "rho1="].iter().find(|n| parameters.contains(**n)).map(|name| number(parameters, name));
        // For each: the system, and what of its solution the row is about (B of some patches, or H).
        let one = |first: usize| move |j: usize| if j == first { 1.0 } else { 0.0 };
        let two = |factor: [f64; 4], area: [f64; 2], rho: f64| {
            Numbers::new(&area, &Dense { n: 2, factor: factor.to_vec() }, |_| rho, one(0))
        };
        let channel = |rho: f64| {
            let (opposite, side, height) = (0.618_033_988_749_89, 0.190_983_005_625_05, 0.236_067_977_499_79);
            let (up, across) = (2.0 * side, height);
            let factor = [0.0, opposite, side, side, opposite, 0.0, side, side, up, up, 0.0, across, up, up, across, 0.0];
            Numbers::new(&[2.0, 2.0, 1.0, 1.0], &Dense { n: 4, factor: factor.to_vec() }, |_| rho, one(0))
        };
        let many = [0.03; 20].iter().chain(&[0.04; 10]).copied().collect::<Vec<f64>>();
        let (numbers, is_irradiance, exitance): (Numbers, bool, Vec<f64>) = match (case, rho) {
            ("white_furnace", Some(rho)) => {
                (Numbers::new(&cube(3).area, &cube(3).form_factors, |_| rho, |_| 1.0), false, vec![1.0; 54])
            }
            ("integrating_sphere", Some(rho)) => {
                let shares = [0.05, 0.01, 0.5, 0.44];
                (Numbers::sphere(&shares, |i| if i == 0 { 0.0 } else { rho }, one(1)), true, vec![0.0; 4])
            }
            ("sphere_two_halves", Some(rho)) => {
                (Numbers::sphere(&[0.5, 0.5], |i| if i == 0 { rho } else { 0.5 * rho }, one(0)), true, vec![0.0; 2])
            }
            ("parallel_plates", Some(rho)) => (two([0.0, 1.0, 1.0, 0.0], [1.0, 1.0], rho), false, vec![1.0, 0.0]),
            ("concentric_spheres", Some(rho)) => (two([0.0, 1.0, 0.25, 0.75], [1.0, 4.0], rho), false, vec![1.0, 0.0]),
            ("concentric_inf_cylinders", Some(rho)) => (two([0.0, 1.0, 0.5, 0.5], [1.0, 2.0], rho), false, vec![1.0, 0.0]),
            ("spherical_cap_cavity", Some(rho)) => {
                let factor = many.iter().map(|a| 0.7 * a).collect::<Vec<f64>>().repeat(30);
                (Numbers::new(&many, &Dense { n: 30, factor }, |_| rho, |_| 1.0), false, vec![1.0; 30])
            }
            ("channel_2x1_uniform_per_wall_APPROX", Some(rho)) => (channel(rho), false, vec![1.0, 0.0, 0.0, 0.0]),
            ("channel_2x1_crossed_strings", None) => {
                // Hottel: width 2, height 1, and the factors close.
                let opposite = (5.0_f64.sqrt() - 1.0) / 2.0;
                for (want, got) in want.iter().zip([opposite, 0.5 * (1.0 - opposite), 5.0_f64.sqrt() - 2.0]) {
                    assert!(near(got, *want, 1e-13), "{case}: {got}, expected {want}");
                }
                seen += 1;
                continue;
            }
            _ => panic!("nobody deals with {case}, {parameters}"),
        };
        let rho = rho.expect("all others have one");
        let solvers: &[Solver] = if rho <= 0.99 { &Solver::ALL } else { &KRYLOV };
        for &solver in solvers {
            let found = numbers.solve(solver, 1e-11, 20_000);
            for (i, want) in want.iter().enumerate() {
                let got = if is_irradiance { found.irradiance[i].g } else { exitance[i] + rho * found.irradiance[i].g };
                // Fourteen digits are given; what is rounded in a row of factors counts 1/(1 - rho) times.
                let tolerance = 1e-11 + 1e-15 / (1.0 - rho);
                assert!(near(got, *want, tolerance), "{case} ({parameters}) by {}: {got}, expected {want}", solver.name());
            }
        }
        seen += 1;
    }
    assert_eq!(seen, 39);
}

/// `tests/data/cube_one_emitter.csv`: one patch a face is the table's 6x6; finer meshes approach the continuum with order 1.5 and more.
#[test]
fn a_cube_with_one_bright_face_under_refinement() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/cube_one_emitter.csv");
    let mut rows = csv::Reader::from_path(path).unwrap();
    let rooms: Vec<_> = [1, 4, 8, 16].map(|n| (n, cube(n))).into();
    for row in rows.records().map(Result::unwrap) {
        let value = |k: usize| -> f64 { row[k].parse().expect("a number") };
        let rho = value(0);
        let faces = |n: usize| -> [f64; 3] {
            let (_, room) = rooms.iter().find(|r| r.0 == n).expect("made above");
            let numbers = Numbers::new(&room.area, &room.form_factors, |_| rho, |j| f64::from(u8::from(room.face[j] == 0)));
            let found = numbers.solve(Solver::Cg, 1e-13, 60);
            let mean = |face: usize| {
                let mine = found.irradiance.iter().zip(&room.face).filter(|(_, f)| **f == face).map(|(h, _)| rho * h.g);
                mine.sum::<f64>() / (n * n) as f64
            };
            [1.0 + mean(0), mean(1), mean(2)]
        };
        // The closed forms are differences of numbers of order 1: 1e-14 is left of their closure, which counts 1/(1 - rho) times.
        let rounding = 1e-10 + 1e-12 / (1.0 - rho);
        for (got, want) in faces(1).iter().zip([value(1), value(2), value(3)]) {
            assert!(near(*got, want, rounding), "rho {rho}, 6 patches: {got}, expected {want}");
        }
        let sides = [(4, value(7)), (8, value(8)), (16, value(9))].map(|(n, want)| {
            let got = faces(n)[2];
            assert!(near(got, want, rounding), "rho {rho}, {n} x {n} a face: {got}, expected {want}");
            got
        });
        let errors = sides.map(|side| (side - value(6)).abs());
        let orders = [errors[0] / errors[1], errors[1] / errors[2]].map(f64::log2);
        println!("rho {rho}: errors {errors:?} with 4, 8, 16 patches an edge, orders {orders:.2?}");
        let fine = faces(16);
        for (got, want) in fine.iter().zip([value(4), value(5), value(6)]) {
            assert!((got - want).abs() <= 4e-3 * value(4).min(1.0 / (1.0 - rho)).min(1.0), "rho {rho}: {got}, continuum {want}");
        }
        // Nearer to 1 than this the difference of two meshes drowns in what closure leaves.
        if rho <= 0.999 {
            assert!(orders.iter().all(|o| *o >= 1.5), "rho {rho}: orders {orders:?}");
        }
    }
}
