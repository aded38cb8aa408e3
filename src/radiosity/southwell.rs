//! Southwell's relaxation: the patch with most unshot power shoots it, again and again. Radiosity knows it as progressive refinement
//! [Cohen88], [Gortler94].

use super::bound::relative;
use super::krylov::{Prepared, way_done};
use super::{Solution, SolveError, Solver, SolverSettings, system::RadiositySystem};
use crate::math::Rgb;
use crate::progress::{Observer, Progress, Stage};

/// Solves H = S + F rho H by shooting. With r the irradiance that a patch has received and not yet reflected, a shot adds r_j to H_j and
/// F_ij rho_j r_j to each r_i: r is the residual. Good after few shots, since bright patches come first; in the end it needs as many
/// products as Gauss-Seidel.
///
/// If it ends early, light that is still to be shot is added as an ambient term [Cohen88], its mean after all bounces spread evenly over
/// the patches that exchange light, for as long as that lowers the bound.
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
    let columns = Columns::of(system);
    let mut whole = prepared.solution(vec![Rgb::BLACK; system.len()], Solver::Southwell);
    let mut r = system.source.clone();
    let (mut done, mut most) = (0.0, 0);
    for set in &sets.members {
        let share = set.len() as f64 / system.len() as f64;
        let (mut sweeps, mut first) = (0, f64::INFINITY);
        let (bound, is_stopped) = loop {
            // A sweep is as many shots as there are patches.
            shoot(system, &columns, set, (&mut whole.irradiance, &mut r));
            sweeps += 1;
            let bound = relative(prepared.bound.of(set, &r), mean_with(system, set, &whole.irradiance, &r));
            if !first.is_finite() {
                first = bound;
            }
            let part = done + share * way_done(first, bound, settings.tolerance);
            let is_stopped = observer(&Progress { stage: Stage::Solve, done: part, total: 1.0 }).is_break();
            if bound <= settings.tolerance || is_stopped || prepared.sweeps + sweeps + 1 >= settings.max_sweeps {
                break (bound, is_stopped);
            }
        };
        done += share;
        most = most.max(sweeps);
        whole.converged &= bound <= settings.tolerance;
        if is_stopped {
            whole.converged = false;
            break;
        }
    }
    whole.sweeps += most + 1;
    finish(system, &prepared, settings, &mut whole);
    Ok(whole)
}

/// F_ij of a column j.
struct Columns {
    /// By patch; `None` if rows will do, by reciprocity.
    entries: Option<Vec<Vec<(usize, Rgb)>>>,
}

impl Columns {
    fn of(system: &RadiositySystem<'_>) -> Self {
        if system.form_factors.is_reciprocal() {
            return Self { entries: None };
        }
        let mut entries = vec![Vec::new(); system.len()];
        (0..system.len()).for_each(|i| system.form_factors.row(i, &mut |j, f| entries[j].push((i, f))));
        Self { entries: Some(entries) }
    }

    fn visit(&self, system: &RadiositySystem<'_>, j: usize, visit: &mut dyn FnMut(usize, Rgb)) {
        match &self.entries {
            Some(entries) => entries[j].iter().for_each(|(i, f)| visit(*i, *f)),
            None => {
                let area = system.area[j];
                system.form_factors.row(j, &mut |i, f| visit(i, f * (area / system.area[i])));
            }
        }
    }
}

/// As many shots as `set` has patches.
fn shoot(system: &RadiositySystem<'_>, columns: &Columns, set: &[usize], (x, r): (&mut [Rgb], &mut [Rgb])) {
    let power = |i: usize, r: &[Rgb]| system.area[i] * (system.rho[i] * r[i]).map(f64::abs).max();
    for _ in 0..set.len() {
        let (j, most) = set.iter().fold((0, 0.0), |best, &i| if power(i, r) > best.1 { (i, power(i, r)) } else { best });
        if most == 0.0 {
            break;
        }
        let shot = r[j];
        x[j] += shot;
        r[j] = Rgb::BLACK;
        let radiosity = system.rho[j] * shot;
        columns.visit(system, j, &mut |i, f| r[i] += f * radiosity);
    }
    // What a patch does not reflect it need not shoot.
    for &i in set {
        let black = system.rho[i].map(|rho| if rho == 0.0 { 1.0 } else { 0.0 });
        x[i] += r[i] * black;
        r[i] *= Rgb::WHITE - black;
    }
}

/// Mean irradiance of `set` with what is received and not yet counted.
fn mean_with(system: &RadiositySystem<'_>, set: &[usize], x: &[Rgb], r: &[Rgb]) -> f64 {
    let weighted: Rgb = set.iter().map(|&i| (x[i] + r[i]) * system.area[i]).sum();
    weighted.max() / set.iter().map(|&i| system.area[i]).sum::<f64>()
}

/// The last bounce by the form factors as they are, and the ambient term of sets that are not done.
fn finish(system: &RadiositySystem<'_>, prepared: &Prepared, settings: &SolverSettings, whole: &mut Solution) {
    let sets = &prepared.sets;
    let r = system.residual(&whole.irradiance);
    whole.error_bound = 0.0;
    for set in &sets.members {
        let q = sets.spectral_bound_of(set);
        set.iter().for_each(|&i| whole.irradiance[i] += r[i]);
        let bound = relative(q * prepared.bound.of(set, &r), system.mean_irradiance(set, &whole.irradiance));
        whole.error_bound = whole.error_bound.max(if bound <= settings.tolerance {
            bound
        } else {
            // With ambient a the residual of x + a is r - a (1 - F rho 1).
            let absorbed = |i: usize| Rgb::WHITE - sets.row_reflectance[i];
            let weighted = |v: &dyn Fn(usize) -> Rgb| -> Rgb { set.iter().map(|&i| v(i) * system.rho[i] * system.area[i]).sum() };
            let ambient = super::sets::divided(weighted(&|i| r[i]), weighted(&absorbed)).map(|a| a.max(0.0));
            let mut left = r.clone();
            set.iter().for_each(|&i| left[i] = left[i] - ambient * absorbed(i));
            // One more bounce is in x + r, so what it holds of the ambient is F rho 1 of it.
            let with: f64 = q * prepared.bound.of(set, &left);
            let mut lit = whole.irradiance.clone();
            set.iter().for_each(|&i| lit[i] += ambient * sets.row_reflectance[i]);
            let with = relative(with, system.mean_irradiance(set, &lit));
            if with < bound {
                whole.irradiance = lit;
                with
            } else {
                bound
            }
        });
    }
    whole.converged = whole.error_bound <= settings.tolerance && whole.converged;
}
