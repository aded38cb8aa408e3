//! Jacobi: all patches at once from what they were, one bounce of light a sweep.

use super::bound::relative;
use super::krylov::{Prepared, way_done};
use super::{Solution, SolveError, Solver, SolverSettings, system::RadiositySystem};
use crate::progress::{Observer, Progress, Stage};

/// Solves H = S + F rho H by putting H into the right side again and again; sweeps grow as 1/(1 - rho).
///
/// # Errors
/// [`SolveError::NoSteadyState`] if there is light and a set of patches that loses none.
pub(super) fn solve(
    system: &RadiositySystem<'_>,
    settings: &SolverSettings,
    observer: &mut Observer<'_>,
) -> Result<Solution, SolveError> {
    let prepared = Prepared::plain(system)?;
    let sets = &prepared.sets;
    let mut whole = prepared.solution(system.source.clone(), Solver::Jacobi);
    let mut first_bound = f64::INFINITY;
    loop {
        let r = system.residual(&whole.irradiance);
        whole.sweeps += 1;
        whole.irradiance.iter_mut().zip(&r).for_each(|(x, r)| *x += *r);
        // The error of x + r is F rho times that of x.
        let bound_of = |set: &Vec<usize>| {
            let bound = sets.spectral_bound_of(set) * prepared.bound.of(set, &r);
            relative(bound, system.mean_irradiance(set, &whole.irradiance))
        };
        whole.error_bound = sets.members.iter().map(bound_of).fold(0.0, f64::max);
        whole.converged = whole.error_bound <= settings.tolerance;
        if !first_bound.is_finite() {
            first_bound = whole.error_bound;
        }
        let done = way_done(first_bound, whole.error_bound, settings.tolerance);
        let is_stopped = observer(&Progress { stage: Stage::Solve, done, total: 1.0 }).is_break();
        if whole.converged || is_stopped || whole.sweeps >= settings.max_sweeps {
            return Ok(whole);
        }
    }
}
