//! Gauss-Seidel, the solver of the classic radiosity papers [Goral84], [Cohen85].

use super::bound::relative;
use super::krylov::{Prepared, way_done};
use super::{Solution, SolveError, Solver, SolverSettings, system::RadiositySystem};
use crate::math::Rgb;
use crate::progress::{Observer, Progress, Stage};

/// Solves H = S + F rho H by sweeps in patch order, each patch using what earlier ones have just become. Sweeps grow as 1/(1 - rho).
///
/// The residual after a sweep is at most q times its largest change, where q is the largest row sum of F rho: a patch differs from what it
/// should be by what later ones have changed since.
///
/// # Errors
/// [`SolveError::NoSteadyState`] if there is light and a set of patches that loses none.
pub(super) fn solve(
    system: &RadiositySystem<'_>,
    settings: &SolverSettings,
    observer: &mut Observer<'_>,
) -> Result<Solution, SolveError> {
    let prepared = Prepared::plain(system)?;
    let mut whole = prepared.solution(system.source.clone(), Solver::GaussSeidel);
    let (mut solved, mut most) = (0.0, 0);
    for set in &prepared.sets.members {
        let share = set.len() as f64 / system.len() as f64;
        let q = prepared.sets.spectral_bound_of(set);
        let amplification = q * prepared.bound.largest(set);
        let (mut sweeps, mut first) = (0, f64::INFINITY);
        let (bound, is_stopped) = loop {
            let change = sweep(system, set, &mut whole.irradiance);
            sweeps += 1;
            // No change is no error, however much it would be amplified.
            let bound = if change == 0.0 { 0.0 } else { change * amplification };
            let bound = relative(bound, system.mean_irradiance(set, &whole.irradiance));
            if !first.is_finite() {
                first = bound;
            }
            let done = solved + share * way_done(first, bound, settings.tolerance);
            let is_stopped = observer(&Progress { stage: Stage::Solve, done, total: 1.0 }).is_break();
            if bound <= settings.tolerance || is_stopped || prepared.sweeps + sweeps >= settings.max_sweeps {
                break (bound, is_stopped);
            }
        };
        solved += share;
        most = most.max(sweeps);
        whole.error_bound = whole.error_bound.max(bound);
        whole.converged &= bound <= settings.tolerance;
        if is_stopped {
            whole.converged = false;
            break;
        }
    }
    whole.sweeps += most;
    Ok(whole)
}

/// One sweep in place; the largest change of any patch and channel.
fn sweep(system: &RadiositySystem<'_>, set: &[usize], x: &mut [Rgb]) -> f64 {
    let mut largest: f64 = 0.0;
    for &i in set {
        let new = system.source[i] + system.reflected_to(i, x);
        largest = largest.max((new - x[i]).map(f64::abs).max());
        x[i] = new;
    }
    largest
}
