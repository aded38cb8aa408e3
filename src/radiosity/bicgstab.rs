//! BiCGStab: two short recurrences for systems without symmetry [Vorst92]. It needs few vectors, but two products a step.

use super::krylov::{self, Goal, Prepared, Space};
use super::sets::divided;
use super::{Solution, SolveError, Solver, SolverSettings, system::RadiositySystem};
use crate::math::Rgb;
use crate::progress::Observer;

/// Solves by BiCGStab, with the levels of rooms solved for by its preconditioner.
///
/// # Errors
/// [`SolveError::NoSteadyState`] if there is light and a set of patches that loses none.
pub(super) fn solve(
    system: &RadiositySystem<'_>,
    settings: &SolverSettings,
    observer: &mut Observer<'_>,
) -> Result<Solution, SolveError> {
    let prepared = Prepared::new(system, steps, krylov::area_weight(system))?;
    Ok(krylov::solve(system, settings, observer, (Solver::BiCgStab, steps), (&prepared, None)).0)
}

/// Steps of the method, as [`krylov::Method`] says.
pub(super) fn steps(space: &Space<'_>, x: &mut [Rgb], r: &mut [Rgb], limit: u32, goal: &mut Goal<'_>) -> u32 {
    let Space { sets, coarse, .. } = *space;
    coarse.correct(sets, x, r);
    let zero = vec![Rgb::BLACK; x.len()];
    let shadow = r.to_vec();
    let (mut p, mut v, mut t) = (zero.clone(), zero.clone(), zero);
    let one = vec![Rgb::WHITE; sets.members.len()];
    let (mut rho, mut alpha, mut omega) = (one.clone(), one.clone(), one);
    let mut products = 0;
    let minus = |scale: &[Rgb]| -> Vec<Rgb> { scale.iter().map(|s| Rgb::BLACK - *s).collect() };
    let quotients = |a: &[Rgb], b: &[Rgb]| -> Vec<Rgb> { a.iter().zip(b).map(|(a, b)| divided(*a, *b)).collect() };
    while products < limit && !goal.is_met_by(sets, x, r) {
        let next = space.dot(&shadow, r);
        let (of_rho, of_alpha) = (quotients(&next, &rho), quotients(&alpha, &omega));
        let beta: Vec<Rgb> = of_rho.iter().zip(&of_alpha).map(|(a, b)| *a * *b).collect();
        rho = next;
        // p = r + beta (p - omega v)
        sets.add_scaled(&mut p, &minus(&omega), &v);
        let mut turned = r.to_vec();
        sets.add_scaled(&mut turned, &beta, &p);
        p = turned;
        let ahead = coarse.precondition(sets, &p);
        space.apply(&ahead, &mut v);
        products += 1;
        alpha = quotients(&rho, &space.dot(&shadow, &v));
        sets.add_scaled(x, &alpha, &ahead);
        sets.add_scaled(r, &minus(&alpha), &v);
        if products >= limit || goal.is_met_by(sets, x, r) {
            break;
        }
        let ahead = coarse.precondition(sets, r);
        space.apply(&ahead, &mut t);
        products += 1;
        omega = quotients(&space.dot(&t, r), &space.dot(&t, &t));
        sets.add_scaled(x, &omega, &ahead);
        sets.add_scaled(r, &minus(&omega), &t);
        if !(goal.go_on)() {
            break;
        }
    }
    products
}
