//! Gauss-Seidel, the solver of the classic radiosity papers [Goral84], [Cohen85], with Krylov steps against its slow modes.

use super::{Solution, SolveError, SolverSettings, krylov, system::RadiositySystem};
use crate::math::Rgb;
use crate::progress::{Observer, Progress, Stage};
use std::ops::ControlFlow;

/// Below this largest row sum the plain bound is sharp enough; above it a companion system is solved beside the first.
const PLAIN_BOUND_BELOW: f64 = 0.9;
/// Sweeps after which, each time, the slow modes that are left are looked for in a Krylov space. Most interiors need no more sweeps.
const PLAIN_SWEEPS: u32 = 20;
/// Steps in that space, of two sweeps each.
const KRYLOV_STEPS: u32 = 60;

/// Solves H = S + F rho H by sweeps in patch order, each patch using what earlier ones have just become.
///
/// It stops on a bound of the true error, not on the change per sweep, which for a small lamp in a bright room stops after one
/// sweep with 99 % error. The residual after a sweep is at most q times its largest change, where q = max_i sum_j F_ij rho_j.
/// - If q is well below 1, the error in the maximum norm is at most |r|/(1 - q).
/// - Otherwise v = 1 + F rho v is swept as well. I - F rho is an M-matrix, so with c = v - F rho v > 0 the error is at most
///   v max|r|/min c. This holds also where single rows sum to 1, as beside white walls, and is sharper than 1/(1 - q).
///
/// Patches that no light can pass between, as in rooms with closed doors, are solved for one after the other, each set to the
/// tolerance relative to its own mean: beside a bright room a dark one would otherwise be left as it was after a few sweeps.
///
/// # Errors
/// [`SolveError::NoSteadyState`] if there is light and a set of patches that loses none.
pub fn solve(
    system: &RadiositySystem<'_>,
    settings: &SolverSettings,
    observer: &mut Observer<'_>,
) -> Result<Solution, SolveError> {
    let reached = system.reached();
    let irradiance = system.source.clone();
    let spectral_bound = system.spectral_bound(&reached);
    let mut whole = Solution { irradiance, sweeps: 0, error_bound: 0.0, spectral_bound, converged: true };
    if system.has_closed_white_set(&reached) {
        return Err(SolveError::NoSteadyState { spectral_bound });
    }
    let mut solved = 0;
    for patches in system.separate(&reached) {
        let share = |part: f64| (solved as f64 + part * patches.len() as f64) / reached.len() as f64;
        let mut tell = |part: f64| observer(&Progress { stage: Stage::Solve, done: share(part), total: 1.0 });
        let set = solve_set(system, &patches, settings, &mut whole.irradiance, &mut tell);
        whole.sweeps = whole.sweeps.max(set.sweeps);
        whole.error_bound = whole.error_bound.max(set.bound);
        whole.converged &= set.bound <= settings.tolerance;
        if set.stopped {
            return Ok(Solution { converged: false, ..whole });
        }
        solved += patches.len();
    }
    Ok(whole)
}

/// How it went with one set of patches.
struct SolvedSet {
    sweeps: u32,
    bound: f64,
    /// True if the observer ended it.
    stopped: bool,
}

/// Solves for `patches`, which see no others that are lit.
fn solve_set(
    system: &RadiositySystem<'_>,
    patches: &[usize],
    settings: &SolverSettings,
    irradiance: &mut [Rgb],
    tell: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> SolvedSet {
    let q = system.spectral_bound(patches);
    let mut companion = (q >= PLAIN_BOUND_BELOW).then(|| companion_start(system, patches));
    let (mut bound, mut first_bound) = (f64::INFINITY, f64::INFINITY);
    for sweep in 1..=settings.max_sweeps {
        if sweep % PLAIN_SWEEPS == 0 {
            krylov::accelerate(irradiance, KRYLOV_STEPS, |x, with_source| {
                sweep_once(system, patches, |i| if with_source { system.source[i] } else { Rgb::BLACK }, x);
            });
            if let Some(v) = &mut companion {
                krylov::accelerate(v, KRYLOV_STEPS, |x, with_source| {
                    sweep_once(system, patches, |_| if with_source { Rgb::WHITE } else { Rgb::BLACK }, x);
                });
            }
        }
        let change = sweep_once(system, patches, |i| system.source[i], irradiance);
        let amplification = match &mut companion {
            None => 1.0 / (1.0 - q),
            Some(v) => {
                let settled = 1.0 - q * sweep_once(system, patches, |_| Rgb::WHITE, v);
                let largest = patches.iter().map(|&i| v[i].max()).fold(0.0, f64::max);
                if settled > 0.0 { largest / settled } else { f64::INFINITY }
            }
        };
        bound = q * change * amplification / system.mean_irradiance(patches, irradiance);
        if !first_bound.is_finite() {
            first_bound = bound;
        }
        if bound <= settings.tolerance {
            return SolvedSet { sweeps: sweep, bound, stopped: false };
        }
        if tell(way_done(first_bound, bound, settings.tolerance)).is_break() {
            return SolvedSet { sweeps: sweep, bound, stopped: true };
        }
    }
    SolvedSet { sweeps: settings.max_sweeps, bound, stopped: false }
}

/// The companion before its first sweep: 1 at the patches that are solved for. The others carry no error.
fn companion_start(system: &RadiositySystem<'_>, reached: &[usize]) -> Vec<Rgb> {
    let mut v = vec![Rgb::BLACK; system.len()];
    reached.iter().for_each(|&i| v[i] = Rgb::WHITE);
    v
}

/// One sweep in place over x = s + F rho x at `patches`; the largest change of any patch and channel.
fn sweep_once(system: &RadiositySystem<'_>, patches: &[usize], source: impl Fn(usize) -> Rgb, x: &mut [Rgb]) -> f64 {
    let mut largest: f64 = 0.0;
    for &i in patches {
        let new = source(i) + system.reflected_to(i, x);
        largest = largest.max((new - x[i]).map(f64::abs).max());
        x[i] = new;
    }
    largest
}

/// Share of the way from the first bound to the tolerance; bounds fall geometrically, so their logarithms measure it.
fn way_done(first: f64, now: f64, tolerance: f64) -> f64 {
    let way = (first / now).ln() / (first / tolerance).ln();
    if way.is_finite() { way.clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::form_factor::analytic::{parallel_rectangles, perpendicular_rectangles};
    use crate::form_factor::matrix::{FormFactorMatrix, Row};

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

    fn solve_cube(rho: f64, exitance: [f64; 6]) -> (Vec<f64>, Solution) {
        let matrix = cube();
        let (rho, area) = ([Rgb::grey(rho); 6], [1.0; 6]);
        let source = (0..6).map(|i| Rgb::grey(matrix.direct(i).map(|(j, f)| f * exitance[j]).sum())).collect();
        let system = RadiositySystem { rho: &rho, area: &area, form_factors: &matrix, source };
        let settings = SolverSettings { tolerance: 1e-11, ..SolverSettings::default() };
        let solution = solve(&system, &settings, &mut crate::progress::silent).expect("solves");
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
        for (rho, want) in table {
            let (radiosity, _) = solve_cube(rho, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
            for (face, want) in [(0, want[0]), (1, want[1]), (2, want[2])] {
                let tolerance = 2.0_f64.powi(-24) * 4.0 / (1.0 - rho) * want;
                let error = (radiosity[face] - want).abs();
                assert!(error < tolerance.max(2e-8), "rho {rho} face {face}: {}, expected {want}", radiosity[face]);
            }
        }
    }

    #[test]
    fn the_error_bound_holds() {
        for rho in [0.5, 0.9, 0.99, 0.999] {
            let (_, exact) = solve_cube(rho, [1.0; 6]);
            let matrix = cube();
            let (rho_all, area) = ([Rgb::grey(rho); 6], [1.0; 6]);
            let source = (0..6).map(|i| Rgb::grey(matrix.direct_sum(i))).collect();
            let system = RadiositySystem { rho: &rho_all, area: &area, form_factors: &matrix, source };
            let loose = SolverSettings { tolerance: 1e-3, ..SolverSettings::default() };
            let got = solve(&system, &loose, &mut crate::progress::silent).expect("solves");
            let mean = system.mean_irradiance(&[0, 1, 2, 3, 4, 5], &exact.irradiance);
            let error = (0..6).map(|i| (got.irradiance[i].g - exact.irradiance[i].g).abs() / mean).fold(0.0, f64::max);
            assert!(error <= 1e-3 && got.error_bound <= 1e-3, "rho {rho}: error {error}, bound {}", got.error_bound);
            assert!(error <= got.error_bound * 1.001, "rho {rho}: error {error} above its bound {}", got.error_bound);
        }
    }

    #[test]
    fn a_patch_that_sees_only_white_ones_does_not_stop_the_solver() {
        // Patch 0 sees only patch 1, which is white; patch 1 sees the grey patch 2 as well.
        let rows = [vec![(1, 1.0)], vec![(0, 0.5), (2, 0.5)], vec![(1, 1.0)]];
        let matrix = FormFactorMatrix::from_rows(rows.map(|direct| Row { direct, ..Row::default() }).to_vec());
        let rho = [Rgb::WHITE, Rgb::WHITE, Rgb::grey(0.5)];
        let system = RadiositySystem { rho: &rho, area: &[1.0; 3], form_factors: &matrix, source: vec![Rgb::WHITE; 3] };
        let settings = SolverSettings { tolerance: 1e-6, ..SolverSettings::default() };
        let got = solve(&system, &settings, &mut crate::progress::silent).expect("solves");
        // By hand: H0 = 1 + H1, H1 = 1 + H0/2 + H2/4, H2 = 1 + H1.
        for (i, want) in [8.0, 7.0, 8.0].into_iter().enumerate() {
            let error = (got.irradiance[i].g - want).abs();
            assert!(error <= 1e-6 * 8.0 && got.converged, "patch {i}: {}, expected {want}", got.irradiance[i].g);
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
        let got = solve(&system, &SolverSettings::default(), &mut crate::progress::silent).expect("solves");
        for (i, want) in [1e6 / 0.7, 1e6 / 0.7, 1e-6 / 0.05, 1e-6 / 0.05].into_iter().enumerate() {
            let error = (got.irradiance[i].g / want - 1.0).abs();
            assert!(error <= 1e-5 && got.converged, "patch {i}: {}, expected {want}", got.irradiance[i].g);
        }
    }

    #[test]
    fn a_closed_scene_that_absorbs_nothing_is_refused() {
        let matrix = cube();
        let system =
            RadiositySystem { rho: &[Rgb::WHITE; 6], area: &[1.0; 6], form_factors: &matrix, source: vec![Rgb::WHITE; 6] };
        let got = solve(&system, &SolverSettings::default(), &mut crate::progress::silent);
        assert!(matches!(got, Err(SolveError::NoSteadyState { .. })));
    }
}
