//! Conjugate gradients [Hestenes52] with a constant for each room taken out of the Krylov space (deflation, [Nicolaides87], [Saad00]).
//!
//! With the weights A rho in the inner product I - F rho is symmetric and positive, as reciprocity makes A F symmetric: this is the
//! usual symmetrised system without its division by the root of rho. Black patches have no weight; they are lit by the last bounce. Of the
//! spectrum of I - F rho one eigenvalue for each room is near 1 - rho, the others lie between 0.4 and 1.4 or so: with the rooms solved for
//! directly the number of steps no longer depends on rho, nor on the number of patches.

use super::krylov::{self, Goal, Prepared, Space};
use super::sets::divided;
use super::{Solution, SolveError, Solver, SolverSettings, bicgstab, gmres, system::RadiositySystem};
use crate::math::Rgb;
use crate::progress::Observer;

/// A squared residual so many times the first is no longer that of a symmetric system.
const DIVERGED: f64 = 1e4;

/// Solves by conjugate gradients; by BiCGStab where light through mirrors and glass, which is measured one way only, spoils the symmetry
/// (an interior with glossy floors took 56 products by it and 1,900 by restarted GMRES); by GMRES where this gets no nearer because of
/// rounding in the form factors. The solution says so.
///
/// # Errors
/// [`SolveError::NoSteadyState`] if there is light and a set of patches that loses none.
pub(super) fn solve(
    system: &RadiositySystem<'_>,
    settings: &SolverSettings,
    observer: &mut Observer<'_>,
) -> Result<Solution, SolveError> {
    if !system.form_factors.is_reciprocal() {
        return bicgstab::solve(system, settings, observer);
    }
    let prepared = Prepared::new(system, steps, krylov::energy_weight(system))?;
    let (solution, is_given_up) = krylov::solve(system, settings, observer, (Solver::Cg, steps), (&prepared, None));
    if !is_given_up {
        return Ok(solution);
    }
    let other = Prepared { sweeps: solution.sweeps, weight: krylov::area_weight(system), ..prepared };
    let handed =
        krylov::solve(system, settings, observer, (Solver::Gmres, gmres::steps), (&other, Some(solution.irradiance.clone()))).0;
    Ok(if handed.error_bound < solution.error_bound { handed } else { Solution { sweeps: handed.sweeps, ..solution } })
}

/// Steps of the method, as [`krylov::Method`] says. A set that meets the goal is left as it is from then on.
pub(super) fn steps(space: &Space<'_>, x: &mut [Rgb], r: &mut [Rgb], limit: u32, goal: &mut Goal<'_>) -> u32 {
    let Space { system, sets, coarse, .. } = *space;
    let n = x.len();
    coarse.correct(sets, x, r);
    let mut is_open: Vec<bool> = (0..sets.members.len()).map(|s| !(goal.is_met)(s, x, r)).collect();
    let mut level = coarse.solve(&coarse.project_image(sets, r));
    let mut p = vec![Rgb::BLACK; n];
    let mut beta = vec![Rgb::BLACK; sets.members.len()];
    let (mut image, mut before) = (vec![Rgb::BLACK; n], vec![Rgb::BLACK; n]);
    let mut square = space.dot(r, r);
    let first = square.clone();
    turn(space, &mut p, r, &beta, &level, &is_open);
    for step in 0..limit {
        if !is_open.contains(&true) {
            return step;
        }
        system.reflect(&p, &mut image);
        // Another bounce of light from x, x + r, has the residual F rho r, which follows from products that are known.
        let mut bounced = image.clone();
        let minus: Vec<Rgb> = beta.iter().map(|b| Rgb::BLACK - *b).collect();
        sets.add_scaled(&mut bounced, &minus, &before);
        coarse.add_image(sets, &mut bounced, &level);
        let mut lit: Vec<Rgb> = x.iter().zip(r.iter()).map(|(x, r)| *x + *r).collect();
        coarse.correct(sets, &mut lit, &mut bounced);
        for (s, set) in sets.members.iter().enumerate().filter(|(s, _)| is_open[*s]).collect::<Vec<_>>() {
            if (goal.is_met)(s, &lit, &bounced) {
                is_open[s] = false;
                for &i in set {
                    (x[i], r[i], p[i], image[i]) = (lit[i], bounced[i], Rgb::BLACK, Rgb::BLACK);
                }
            }
        }
        let applied: Vec<Rgb> = p.iter().zip(&image).map(|(p, image)| *p - *image).collect();
        let curvature = space.dot(&p, &applied);
        let alpha: Vec<Rgb> = square.iter().zip(&curvature).map(|(a, b)| divided(*a, *b)).collect();
        if alpha.iter().any(|a| a.min() < 0.0) {
            // Not positive: the form factors are not what they are said to be. The caller sees that nothing is gained.
            return step + 1;
        }
        sets.add_scaled(x, &alpha, &p);
        let minus: Vec<Rgb> = alpha.iter().map(|a| Rgb::BLACK - *a).collect();
        sets.add_scaled(r, &minus, &applied);
        // Nothing of r lies in the span of W but rounding, which would be amplified by 1/(1 - rho) once the rest is as small.
        coarse.correct(sets, x, r);
        for (s, is_open) in is_open.iter_mut().enumerate() {
            *is_open = *is_open && !(goal.is_met)(s, x, r);
        }
        if !(goal.go_on)() {
            return step + 1;
        }
        let next = space.dot(r, r);
        if next.iter().zip(&first).any(|(now, first)| (0..3).any(|k| now[k] > DIVERGED * first[k])) {
            return step + 1;
        }
        beta = next.iter().zip(&square).map(|(a, b)| divided(*a, *b)).collect();
        square = next;
        level = coarse.solve(&coarse.project_image(sets, r));
        turn(space, &mut p, r, &beta, &level, &is_open);
        std::mem::swap(&mut image, &mut before);
    }
    limit
}

/// The next direction: p = r + beta p - W level; 0 in sets that are done.
fn turn(space: &Space<'_>, p: &mut [Rgb], r: &[Rgb], beta: &[Rgb], level: &[Rgb], is_open: &[bool]) {
    for ((set, beta), is_open) in space.sets.members.iter().zip(beta).zip(is_open) {
        set.iter().for_each(|&i| p[i] = if *is_open { r[i] + *beta * p[i] } else { Rgb::BLACK });
    }
    let minus: Vec<Rgb> = level.iter().map(|v| Rgb::BLACK - *v).collect();
    let closed = is_open.iter().any(|open| !open);
    space.coarse.add(space.sets, p, &minus);
    if closed {
        for (set, _) in space.sets.members.iter().zip(is_open).filter(|(_, open)| !**open) {
            set.iter().for_each(|&i| p[i] = Rgb::BLACK);
        }
    }
}
