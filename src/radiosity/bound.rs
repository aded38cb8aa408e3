//! How far a solution may be off, from its residual.
//!
//! I - F rho is an M-matrix where light dies out: its inverse has no negative entries. So if v - F rho v = c > 0 for some v, the error of x with
//! residual r is at most max v · max |r_j|/c_j in any patch. v = 1 gives the well-known |r|/(1 - q) with q the largest row sum of F rho, and
//! nothing where single rows sum to 1, as beside white walls; the solution of v = 1 + F rho v gives the sharpest single figure,
//! 1/(1 - rho) in a room of one reflectance. A rough solution will do: any v with c > 0 gives a bound that holds.

use super::coarse::Coarse;
use super::krylov::{Goal, Method, Space};
use super::sets::Sets;
use super::system::RadiositySystem;
use crate::math::Rgb;

/// Below this amplification the bound is sharp enough: what a better one could save costs as much to find.
const SHARP_ENOUGH: f64 = 30.0;
/// The companion is solved until every c is at least this.
const SETTLED: f64 = 0.5;
/// Products spent on a companion at most.
const MOST_PRODUCTS: u32 = 400;

/// What a residual may mean.
pub(super) struct ErrorBound {
    /// max v over the set, over c_j, of each patch: how much of the set's largest error a residual there may stand for.
    weight: Vec<Rgb>,
    /// Largest of these.
    pub amplification: f64,
    /// Mean of the companion over the area of the set where it is largest: how much a set amplifies what is wrong everywhere alike.
    pub mean_amplification: f64,
    /// Products with the form factors that this took.
    pub gathers: u32,
}

impl ErrorBound {
    /// Finds a companion v for each set: 1, the solution over rooms, or, where neither will do, steps of `method` from there.
    pub fn new(system: &RadiositySystem<'_>, sets: &Sets, coarse: &Coarse, weight: &[Rgb], method: Method) -> Self {
        let mut bound = Self { weight: vec![Rgb::BLACK; system.len()], amplification: 1.0, mean_amplification: 1.0, gathers: 0 };
        let mut ones = vec![Rgb::BLACK; system.len()];
        sets.members.iter().flatten().for_each(|&i| ones[i] = Rgb::WHITE);
        let plain: Vec<Rgb> = ones.iter().zip(&sets.row_reflectance).map(|(v, row)| *v - *row).collect();
        let best: Vec<f64> = sets.members.iter().map(|set| take_better(&mut bound.weight, set, &ones, &plain)).collect();
        let (mut v, mut r) = (vec![Rgb::BLACK; system.len()], ones);
        coarse.correct(sets, &mut v, &mut r);
        let settled = |r: &[Rgb], set: &[usize]| set.iter().all(|&i| r[i].max() <= 1.0 - SETTLED);
        let is_done = |s: usize, r: &[Rgb]| best[s] <= SHARP_ENOUGH || settled(r, &sets.members[s]);
        if !(0..best.len()).all(|s| is_done(s, &r)) {
            let space = Space { system, sets, coarse, weight };
            let mut goal = Goal { is_met: &mut |s, _, r| is_done(s, r), go_on: &mut || true };
            bound.gathers = method(&space, &mut v, &mut r, MOST_PRODUCTS, &mut goal);
            // What a method believes of its residual is only nearly so, and this is to hold.
            let mut image = vec![Rgb::BLACK; system.len()];
            system.reflect(&v, &mut image);
            bound.gathers += 1;
            r.iter_mut().zip(&image).zip(&v).for_each(|((r, image), v)| *r = Rgb::WHITE + *image - *v);
        }
        let settled: Vec<Rgb> = r.iter().map(|r| Rgb::WHITE - *r).collect();
        for set in &sets.members {
            let amplification = take_better(&mut bound.weight, set, &v, &settled);
            bound.amplification = bound.amplification.max(amplification);
            bound.mean_amplification = bound.mean_amplification.max(system.mean_irradiance(set, &v));
        }
        bound
    }

    /// Bound on the error [W/m²] of any patch of a set with residuals `r`.
    pub fn of(&self, set: &[usize], r: &[Rgb]) -> f64 {
        let at = |&i: &usize| {
            let bound = r[i].map(f64::abs) * self.weight[i];
            // An infinite weight on no residual at all is no error.
            if r[i].is_black() {
                0.0
            } else if bound.max().is_nan() {
                f64::INFINITY
            } else {
                bound.max()
            }
        };
        set.iter().map(at).fold(0.0, f64::max)
    }

    /// The largest weight in a set: what a residual of 1 anywhere may stand for.
    pub fn largest(&self, set: &[usize]) -> f64 {
        set.iter().map(|&i| self.weight[i].max()).fold(0.0, f64::max)
    }
}

/// Takes v with c = v - F rho v for `set` where, in a channel, it gives smaller weights than are there; the largest weight.
fn take_better(weight: &mut [Rgb], set: &[usize], v: &[Rgb], c: &[Rgb]) -> f64 {
    let mut worst: f64 = 0.0;
    let mut weights: Vec<[f64; 3]> = set.iter().map(|&i| weight[i].to_array()).collect();
    for k in 0..3 {
        let largest = set.iter().map(|&i| v[i][k]).fold(0.0, f64::max);
        let new: Vec<f64> = set.iter().map(|&i| if c[i][k] > 0.0 { largest / c[i][k] } else { f64::INFINITY }).collect();
        let old = weights.iter().map(|w| w[k]).fold(0.0, f64::max);
        let found = new.iter().fold(0.0, |a: f64, &b| a.max(b));
        if old == 0.0 || found < old {
            weights.iter_mut().zip(&new).for_each(|(w, new)| w[k] = *new);
        }
        worst = worst.max(weights.iter().map(|w| w[k]).fold(0.0, f64::max));
    }
    set.iter().zip(weights).for_each(|(&i, w)| weight[i] = w.into());
    worst
}

/// `bound` relative to `mean`; 0 where there is nothing and nothing is wrong, infinite where numbers have ended.
pub(super) fn relative(bound: f64, mean: f64) -> f64 {
    let relative = if bound == 0.0 { 0.0 } else { bound / mean };
    if relative.is_finite() && mean.is_finite() { relative } else { f64::INFINITY }
}
