//! What the Krylov methods have in common: where they start, when they stop, and that what they believe of their residual is verified.

use super::bound::{ErrorBound, relative};
use super::coarse::Coarse;
use super::sets::Sets;
use super::{Solution, SolveError, Solver, SolverSettings, bicgstab, cg, system::RadiositySystem};
use crate::math::Rgb;
use crate::progress::{Observer, Progress, Stage};
use std::cell::Cell;

/// Products of a method between two verifications, at most.
pub(super) const CYCLE: u32 = 300;
/// Cycles that may end without having halved the bound before a method is given up: what is left is rounding, or it is stuck.
const MOST_FAILURES: u32 = 2;
/// A method goes on until it believes its bound to be this share of the tolerance.
const MARGIN: f64 = 0.9;

/// The system and what is known of it.
#[derive(Clone, Copy)]
pub(super) struct Space<'a> {
    pub system: &'a RadiositySystem<'a>,
    pub sets: &'a Sets,
    pub coarse: &'a Coarse,
    /// Weights of the inner product.
    pub weight: &'a [Rgb],
}

impl Space<'_> {
    /// out = (I - F rho) x: one product.
    pub fn apply(&self, x: &[Rgb], out: &mut [Rgb]) {
        self.system.reflect(x, out);
        out.iter_mut().zip(x).for_each(|(out, x)| *out = *x - *out);
    }

    /// Inner product of each set.
    pub fn dot(&self, a: &[Rgb], b: &[Rgb]) -> Vec<Rgb> {
        self.sets.dot(self.weight, a, b)
    }
}

/// Judges solution and residual of a set, by its number.
type IsMet<'a> = dyn FnMut(usize, &[Rgb], &[Rgb]) -> bool + 'a;

/// When a method may stop.
pub(super) struct Goal<'a> {
    /// True if solution and residual of a set are good enough.
    pub is_met: &'a mut IsMet<'a>,
    /// False if somebody wants it to stop; asked after each step.
    pub go_on: &'a mut dyn FnMut() -> bool,
}

impl Goal<'_> {
    /// True if the goal is met for all sets.
    pub fn is_met_by(&mut self, sets: &Sets, x: &[Rgb], r: &[Rgb]) -> bool {
        (0..sets.members.len()).all(|s| (self.is_met)(s, x, r))
    }
}

/// Steps of a method from `x` with residual `r`, by at most so many products, towards a goal; the number of products. At the end `r` is what
/// the method believes the residual of `x` to be.
pub(super) type Method = fn(&Space<'_>, &mut [Rgb], &mut [Rgb], u32, &mut Goal<'_>) -> u32;

/// What all solvers need before they start.
pub(super) struct Prepared {
    pub sets: Sets,
    pub coarse: Coarse,
    pub bound: ErrorBound,
    pub weight: Vec<Rgb>,
    /// Products so far.
    pub sweeps: u32,
}

impl Prepared {
    /// Finds sets and rooms and how the system amplifies, by `method`.
    ///
    /// # Errors
    /// As [`Sets::find`].
    pub fn new(system: &RadiositySystem<'_>, method: Method, weight: Vec<Rgb>) -> Result<Self, SolveError> {
        let sets = Sets::find(system)?;
        let coarse = Coarse::new(system, &sets, weight.clone());
        let bound = ErrorBound::new(system, &sets, &coarse, &weight, method);
        let sweeps = sets.gathers + coarse.gathers + bound.gathers;
        Ok(Self { sets, coarse, bound, weight, sweeps })
    }

    /// For the stationary methods: whatever of the Krylov methods suits the form factors finds the amplification.
    ///
    /// # Errors
    /// As [`Sets::find`].
    pub fn plain(system: &RadiositySystem<'_>) -> Result<Self, SolveError> {
        if system.form_factors.is_reciprocal() {
            Self::new(system, cg::steps, energy_weight(system))
        } else {
            Self::new(system, bicgstab::steps, area_weight(system))
        }
    }

    /// A solution that is nothing yet but these preparations.
    pub fn solution(&self, irradiance: Vec<Rgb>, solver: Solver) -> Solution {
        Solution {
            irradiance,
            sweeps: self.sweeps,
            error_bound: 0.0,
            spectral_bound: self.sets.spectral_bound(),
            amplification: self.bound.amplification,
            mean_amplification: self.bound.mean_amplification,
            rooms: self.coarse.rooms,
            solver,
            converged: true,
        }
    }
}

/// A rho: in this inner product I - F rho is symmetric if A F is.
pub(super) fn energy_weight(system: &RadiositySystem<'_>) -> Vec<Rgb> {
    system.rho.iter().zip(system.area).map(|(rho, a)| *rho * *a).collect()
}

/// A: for methods that need no symmetry it is better that dark patches count.
pub(super) fn area_weight(system: &RadiositySystem<'_>) -> Vec<Rgb> {
    system.area.iter().map(|a| Rgb::grey(*a)).collect()
}

/// Solves by a Krylov method, from `start` or from darkness. The second value is true if it was given up because it got no nearer.
///
/// What counts is the residual of the solution itself, computed anew at the end of each cycle. The product that this takes is not lost: it is
/// one more bounce of light, x + r, whose error is at most q times that of x.
pub(super) fn solve(
    system: &RadiositySystem<'_>,
    settings: &SolverSettings,
    observer: &mut Observer<'_>,
    (solver, method): (Solver, Method),
    (prepared, start): (&Prepared, Option<Vec<Rgb>>),
) -> (Solution, bool) {
    let Prepared { sets, coarse, bound, weight, .. } = prepared;
    let space = Space { system, sets, coarse, weight };
    let mut whole = prepared.solution(vec![Rgb::BLACK; system.len()], solver);
    let mut r = system.source.clone();
    if let Some(start) = start {
        whole.irradiance = start;
        r = system.residual(&whole.irradiance);
        whole.sweeps += 1;
    }
    let (mut best, mut failures) = (f64::INFINITY, 0);
    // The best so far with its residual: a method that goes astray must not take the solution with it.
    let mut kept = (whole.irradiance.clone(), r.clone());
    // Sets whose solution was verified: what others still need does not touch them any more.
    let mut settled: Vec<Option<Vec<(Rgb, Rgb)>>> = vec![None; sets.members.len()];
    let (first, now, stopped) = (Cell::new(0.0), Cell::new(0.0_f64), Cell::new(false));
    loop {
        let mut is_met = |s: usize, x: &[Rgb], r: &[Rgb]| {
            let set = &sets.members[s];
            // One more bounce is added at the end, which makes the bound smaller only if rows sum to less than 1.
            let is = relative(sets.spectral_bound_of(set).max(1.0) * bound.of(set, r), system.mean_irradiance(set, x));
            now.set(now.get().max(is));
            is <= MARGIN * settings.tolerance
        };
        let mut go_on = || {
            let is = now.take();
            if first.get() == 0.0 {
                first.set(is);
            }
            let done = way_done(first.get(), is, settings.tolerance);
            stopped.set(observer(&Progress { stage: Stage::Solve, done, total: 1.0 }).is_break());
            !stopped.get()
        };
        let limit = settings.max_sweeps.saturating_sub(whole.sweeps + 1).min(CYCLE);
        whole.sweeps +=
            method(&space, &mut whole.irradiance, &mut r, limit, &mut Goal { is_met: &mut is_met, go_on: &mut go_on });
        r = system.residual(&whole.irradiance);
        whole.sweeps += 1;
        for (set, settled) in sets.members.iter().zip(&settled) {
            for (&i, kept) in set.iter().zip(settled.iter().flatten()) {
                (whole.irradiance[i], r[i]) = *kept;
            }
        }
        let bounced: Vec<Rgb> = whole.irradiance.iter().zip(&r).map(|(x, r)| *x + *r).collect();
        let bound_of =
            |set: &Vec<usize>| relative(sets.spectral_bound_of(set) * bound.of(set, &r), system.mean_irradiance(set, &bounced));
        let bounds: Vec<f64> = sets.members.iter().map(bound_of).collect();
        for ((set, settled), bound) in sets.members.iter().zip(&mut settled).zip(&bounds) {
            if settled.is_none() && *bound <= settings.tolerance {
                *settled = Some(set.iter().map(|&i| (whole.irradiance[i], r[i])).collect());
            }
        }
        whole.error_bound = bounds.into_iter().fold(0.0, f64::max);
        whole.converged = whole.error_bound <= settings.tolerance;
        failures += u32::from(whole.error_bound > 0.5 * best);
        let is_given_up = !whole.converged && failures >= MOST_FAILURES;
        if whole.error_bound < best {
            (best, kept) = (whole.error_bound, (whole.irradiance.clone(), r.clone()));
        } else {
            (whole.error_bound, (whole.irradiance, r)) = (best, kept.clone());
        }
        if whole.converged || is_given_up || stopped.get() || whole.sweeps >= settings.max_sweeps {
            whole.irradiance.iter_mut().zip(&r).for_each(|(x, r)| *x += *r);
            return (whole, is_given_up);
        }
    }
}

/// Share of the way from the first bound to the tolerance; bounds fall geometrically, so their logarithms measure it.
pub(super) fn way_done(first: f64, now: f64, tolerance: f64) -> f64 {
    let way = (first / now).ln() / (first / tolerance).ln();
    if way.is_finite() { way.clamp(0.0, 1.0) } else { 0.0 }
}
