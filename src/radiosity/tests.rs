use super::*;
use crate::form_factor::analytic::{parallel_rectangles, perpendicular_rectangles};
use crate::form_factor::matrix::{FormFactorMatrix, Row};
use crate::progress::silent;

/// Unit cube, one patch a face, with exact form factors; face 0 is the ceiling, face 1 the floor.
fn cube() -> FormFactorMatrix {
    let opposite = parallel_rectangles(1.0, 1.0, 1.0);
    let adjacent = perpendicular_rectangles(1.0, 1.0, 1.0);
    let row = |i: u32| Row {
        direct: (0..6).filter(|j| *j != i).map(|j| (j, if j == i ^ 1 { opposite } else { adjacent } as f32)).collect(),
        ..Row::default()
    };
    FormFactorMatrix::from_rows((0..6).map(row).collect())
}

fn settings(solver: Solver, tolerance: f64) -> SolverSettings {
    SolverSettings { solver, tolerance, ..SolverSettings::default() }
}

fn solve_cube(solver: Solver, rho: f64, exitance: [f64; 6]) -> (Vec<f64>, Solution) {
    let matrix = cube();
    let (rho, area) = ([Rgb::grey(rho); 6], [1.0; 6]);
    let source = (0..6).map(|i| Rgb::grey(matrix.direct(i).map(|(j, f)| f * exitance[j]).sum())).collect();
    let system = RadiositySystem { rho: &rho, area: &area, form_factors: &matrix, source };
    let solution = solve(&system, &settings(solver, 1e-11), &mut silent).expect("solves");
    let radiosity = (0..6).map(|i| exitance[i] + rho[i].g * solution.irradiance[i].g).collect();
    (radiosity, solution)
}

#[test]
fn the_cube_of_six_patches_has_its_exact_radiosity() {
    // radiosity of ceiling, floor and wall for E = 1 on the ceiling; stored factors are f32, so the bound is their rounding.
    let table = [
        (0.5, [1.090_909_098, 0.181_745_826, 0.181_836_269]),
        (0.9, [2.372_881_375, 1.525_310_551, 1.525_452_019]),
        (0.99, [17.362_270_473, 16.527_425_128, 16.527_576_1]),
    ];
    for (solver, (rho, want)) in Solver::ALL.into_iter().flat_map(|s| table.map(|t| (s, t))) {
        let (radiosity, _) = solve_cube(solver, rho, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        for (face, want) in [(0, want[0]), (1, want[1]), (2, want[2])] {
            let tolerance = 2.0_f64.powi(-24) * 4.0 / (1.0 - rho) * want;
            let error = (radiosity[face] - want).abs();
            assert!(error < tolerance.max(2e-8), "{solver:?} rho {rho} face {face}: {}, expected {want}", radiosity[face]);
        }
    }
}

#[test]
fn the_error_bound_holds() {
    for (solver, rho) in Solver::ALL.into_iter().flat_map(|s| [0.5, 0.9, 0.99, 0.999].map(|rho| (s, rho))) {
        let lit = [1.0, 0.0, 0.5, 0.0, 0.0, 0.25];
        let (_, exact) = solve_cube(Solver::Cg, rho, lit);
        let matrix = cube();
        let (rho_all, area) = ([Rgb::grey(rho); 6], [1.0; 6]);
        let source = (0..6).map(|i| Rgb::grey(matrix.direct(i).map(|(j, f)| f * lit[j]).sum())).collect();
        let system = RadiositySystem { rho: &rho_all, area: &area, form_factors: &matrix, source };
        let got = solve(&system, &settings(solver, 1e-3), &mut silent).expect("solves");
        let mean = system.mean_irradiance(&[0, 1, 2, 3, 4, 5], &exact.irradiance);
        let error = (0..6).map(|i| (got.irradiance[i].g - exact.irradiance[i].g).abs() / mean).fold(0.0, f64::max);
        assert!(error <= 1e-3 && got.error_bound <= 1e-3, "{solver:?} rho {rho}: error {error}, bound {}", got.error_bound);
        assert!(error <= got.error_bound * 1.001 + 1e-11, "{solver:?} rho {rho}: {error} above its bound {}", got.error_bound);
    }
}

#[test]
fn a_patch_that_sees_only_white_ones_does_not_stop_the_solver() {
    // Patch 0 sees only patch 1, which is white; patch 1 sees the grey patch 2 as well.
    let rows = [vec![(1, 1.0)], vec![(0, 0.5), (2, 0.5)], vec![(1, 1.0)]];
    let matrix = FormFactorMatrix::from_rows(rows.map(|direct| Row { direct, ..Row::default() }).to_vec());
    let rho = [Rgb::WHITE, Rgb::WHITE, Rgb::grey(0.5)];
    // Areas that make it reciprocal: A F is 1/2 for both pairs.
    let system = RadiositySystem { rho: &rho, area: &[0.5, 1.0, 0.5], form_factors: &matrix, source: vec![Rgb::WHITE; 3] };
    for solver in Solver::ALL {
        let got = solve(&system, &settings(solver, 1e-6), &mut silent).expect("solves");
        // By hand: H0 = 1 + H1, H1 = 1 + H0/2 + H2/4, H2 = 1 + H1.
        for (i, want) in [8.0, 7.0, 8.0].into_iter().enumerate() {
            let error = (got.irradiance[i].g - want).abs();
            assert!(error <= 1e-6 * 8.0 && got.converged, "{solver:?} patch {i}: {}, expected {want}", got.irradiance[i].g);
        }
    }
}

/// Two closed pairs of patches: H = s/(1 - rho) in each, the second with a source of 1e-12 of the first's and a slower series.
#[test]
fn a_dark_room_beside_a_bright_one_is_solved_as_if_alone() {
    let rows = [1, 0, 3, 2].map(|j| Row { direct: vec![(j, 1.0)], ..Row::default() });
    let matrix = FormFactorMatrix::from_rows(rows.to_vec());
    let rho = [0.3, 0.3, 0.95, 0.95].map(Rgb::grey);
    let source = [1e6, 1e6, 1e-6, 1e-6].map(Rgb::grey).to_vec();
    let system = RadiositySystem { rho: &rho, area: &[1.0; 4], form_factors: &matrix, source };
    for solver in Solver::ALL {
        let got = solve(&system, &settings(solver, 1e-5), &mut silent).expect("solves");
        for (i, want) in [1e6 / 0.7, 1e6 / 0.7, 1e-6 / 0.05, 1e-6 / 0.05].into_iter().enumerate() {
            let error = (got.irradiance[i].g / want - 1.0).abs();
            assert!(error <= 1e-5 && got.converged, "{solver:?} patch {i}: {}, expected {want}", got.irradiance[i].g);
        }
    }
}

#[test]
fn a_closed_scene_that_absorbs_nothing_is_refused() {
    let matrix = cube();
    let system = RadiositySystem { rho: &[Rgb::WHITE; 6], area: &[1.0; 6], form_factors: &matrix, source: vec![Rgb::WHITE; 6] };
    for solver in Solver::ALL {
        let got = solve(&system, &settings(solver, 1e-5), &mut silent);
        assert!(matches!(got, Err(SolveError::NoSteadyState { .. })), "{solver:?}");
    }
}

/// Patches that see nobody, that are black, or that no light reaches: what they get is the source, or nothing.
#[test]
fn patches_without_light_or_reflection() {
    let rows = [vec![(1, 1.0)], vec![(0, 1.0)], vec![], vec![(4, 1.0)], vec![(3, 1.0)]];
    let matrix = FormFactorMatrix::from_rows(rows.map(|direct| Row { direct, ..Row::default() }).to_vec());
    let rho = [0.0, 0.5, 0.7, 1.0, 1.0].map(Rgb::grey);
    let source = [1.0, 0.0, 3.0, 0.0, 0.0].map(Rgb::grey).to_vec();
    let system = RadiositySystem { rho: &rho, area: &[1.0; 5], form_factors: &matrix, source };
    for solver in Solver::ALL {
        // Patch 0 is lit and black, so patch 1 sees no light; patch 2 is alone; 3 and 4 are white, closed and dark.
        let got = solve(&system, &settings(solver, 1e-6), &mut silent).expect("no light where nothing is lost");
        let found: Vec<f64> = got.irradiance.iter().map(|h| h.g).collect();
        assert_eq!(found, [1.0, 0.0, 3.0, 0.0, 0.0], "{solver:?}");
        assert!(got.converged, "{solver:?}");
    }
}

/// What a set of patches still needs does not touch another that is solved: not a bit, however many cycles it takes.
#[test]
fn a_set_that_is_solved_is_left_alone() {
    // Beside the cube a row of patches, each of which sees the next ones alone: light takes a product for each, more
    // than a cycle has.
    const LONG: usize = 2 * krylov::CYCLE as usize;
    let cube = cube();
    let of_cube = (0..6).map(|i| cube.direct(i).map(|(j, f)| (j as u32, f as f32)).collect::<Vec<_>>());
    let of_row = (0..LONG as u32).map(|i| match i {
        0 => vec![(7, 1.0)],
        i if i + 1 == LONG as u32 => vec![(5 + i, 1.0)],
        i => vec![(5 + i, 0.5), (7 + i, 0.5)],
    });
    let matrix = FormFactorMatrix::from_rows(of_cube.chain(of_row).map(|direct| Row { direct, ..Row::default() }).collect());
    let n = 6 + LONG;
    let area: Vec<f64> = (0..n).map(|i| if i == 6 || i + 1 == n { 0.5 } else { 1.0 }).collect();
    let rho: Vec<Rgb> = (0..n).map(|i| Rgb::grey(if i < 6 { 0.5 + 0.02 * i as f64 } else { 1.0 - 1e-6 })).collect();
    let source: Vec<Rgb> = (0..n).map(|i| Rgb::grey(if i < 7 { 1.0 + 0.1 * i as f64 } else { 0.0 })).collect();
    for solver in [Solver::Cg, Solver::Gmres, Solver::BiCgStab] {
        let solved = |max_sweeps: u32| {
            let system = RadiositySystem { rho: &rho, area: &area, form_factors: &matrix, source: source.clone() };
            let settings = SolverSettings { max_sweeps, ..settings(solver, 1e-9) };
            let solution = solve(&system, &settings, &mut silent).expect("solves");
            (solution.irradiance[..6].iter().map(|h| h.to_array().map(f64::to_bits)).collect::<Vec<_>>(), solution)
        };
        let ((early, first), (late, second)) = (solved(500), solved(1500));
        let more = second.sweeps - first.sweeps;
        assert!(!first.converged && more > krylov::CYCLE, "{solver:?}: {} and {} products", first.sweeps, second.sweeps);
        assert_eq!(early, late, "{solver:?}");
    }
}

/// Two patches in a gap that few rays say pass on up to 1.5 times what they get, by way of gloss, beside two that are what they seem: held to what the
/// brighter of them reflects, they have a solution.
#[test]
fn a_gap_whose_rows_claim_too_much_is_held() {
    let row = |j: u32, beside: f32| Row { direct: vec![(j, 1.0)], specular: vec![(j, [beside, 0.0, 0.0])], ..Row::default() };
    let matrix = FormFactorMatrix::from_rows(vec![row(1, 0.875), row(0, 0.5), row(3, 0.0), row(2, 0.0)]);
    let rho = [0.8, 0.6, 0.9, 0.9].map(Rgb::grey);
    let area = [1.0; 4];
    fn system<'a>(rho: &'a [Rgb], area: &'a [f64], form_factors: &'a FormFactorMatrix) -> RadiositySystem<'a> {
        RadiositySystem { rho, area, form_factors, source: vec![Rgb::WHITE; 4] }
    }
    let solve = |rho| solve(&system(rho, &area, &matrix), &settings(Solver::BiCgStab, 1e-9), &mut silent);
    assert!(matches!(solve(&rho), Err(SolveError::NoSteadyState { .. })));
    let held = held_reflectance(&system(&rho, &area, &matrix), |_| f64::INFINITY).expect("rows of 1.125 and 1.2 in a gap");
    // Red of the first two: 0.8 over the larger row, 1.5 * 0.8 = 1.2.
    let expected = [[0.8 * 0.8 / 1.2, 0.8, 0.8], [0.6 * 0.8 / 1.2, 0.6, 0.6], [0.9; 3], [0.9; 3]];
    for (got, want) in held.iter().zip(expected) {
        assert!((0..3).all(|c| (got[c] - want[c]).abs() < 1e-12), "{held:?}");
    }
    let solution = solve(&held).expect("solves");
    assert!(solution.irradiance.iter().all(|h| (1.0..20.0).contains(&h.r)), "{:?}", solution.irradiance);
    assert!(held_reflectance(&system(&held, &area, &matrix), |_| 1.0).is_none(), "nothing is left to be held");
}

/// A small white patch whose few rays all met itself loses some light; by many rays it is closed, as is a room of which it is the whole.
#[test]
fn few_rays_cannot_tell_that_nothing_leaves() {
    let rows = [vec![(0, 1.0)], vec![(2, 1.0)], vec![(1, 1.0)]].map(|direct| Row { direct, ..Row::default() });
    let matrix = FormFactorMatrix::from_rows(rows.to_vec());
    let rho = [1.0, 0.5, 0.5].map(Rgb::grey);
    let held = |area: [f64; 3], rays: f64| {
        let system = RadiositySystem { rho: &rho, area: &area, form_factors: &matrix, source: Vec::new() };
        held_reflectance(&system, |_| rays).expect("a white part")[0].g
    };
    assert!((held([1.0, 9.0, 9.0], 127.0) - 127.0 / 128.0).abs() < 1e-12);
    for (area, rays) in [([1.0, 9.0, 9.0], 1e5), ([1.0, 9.0, 9.0], f64::INFINITY), ([20.0, 9.0, 9.0], 127.0)] {
        assert_eq!(held(area, rays), 1.0, "{area:?} {rays}");
    }
}
