//! GMRES, restarted: the smallest residual in a Krylov space, for systems without symmetry [SaadSchultz86].

use super::krylov::{self, Goal, Prepared, Space};
use super::sets::divided;
use super::{Solution, SolveError, Solver, SolverSettings, system::RadiositySystem};
use crate::math::Rgb;
use crate::progress::Observer;

/// Vectors of the space before it starts anew.
const VECTORS: usize = 30;

/// Solves by GMRES, with the levels of rooms solved for by its preconditioner.
///
/// # Errors
/// [`SolveError::NoSteadyState`] if there is light and a set of patches that loses none.
pub(super) fn solve(
    system: &RadiositySystem<'_>,
    settings: &SolverSettings,
    observer: &mut Observer<'_>,
) -> Result<Solution, SolveError> {
    let prepared = Prepared::new(system, steps, krylov::area_weight(system))?;
    Ok(krylov::solve(system, settings, observer, (Solver::Gmres, steps), (&prepared, None)).0)
}

/// Steps of the method, as [`krylov::Method`] says. All sets and channels walk side by side, each with its own small system.
pub(super) fn steps(space: &Space<'_>, x: &mut [Rgb], r: &mut [Rgb], limit: u32, goal: &mut Goal<'_>) -> u32 {
    let Space { sets, coarse, .. } = *space;
    coarse.correct(sets, x, r);
    let mut products = 0;
    while products < limit && !goal.is_met_by(sets, x, r) {
        let norm: Vec<Rgb> = space.dot(r, r).iter().map(|v| v.map(f64::sqrt)).collect();
        let mut basis = vec![scaled(space, r, &norm)];
        let mut small = Small::new(norm);
        loop {
            let mut w = vec![Rgb::BLACK; x.len()];
            space.apply(&coarse.precondition(sets, &basis[basis.len() - 1]), &mut w);
            products += 1;
            let mut column = Vec::with_capacity(basis.len() + 1);
            for v in &basis {
                let part = space.dot(&w, v);
                let minus: Vec<Rgb> = part.iter().map(|h| Rgb::BLACK - *h).collect();
                sets.add_scaled(&mut w, &minus, v);
                column.push(part);
            }
            let norm: Vec<Rgb> = space.dot(&w, &w).iter().map(|v| v.map(f64::sqrt)).collect();
            basis.push(scaled(space, &w, &norm));
            column.push(norm);
            small.add(column);
            let (y, left) = small.solve();
            let combined = |coefficients: &[Vec<Rgb>]| {
                let mut sum = vec![Rgb::BLACK; x.len()];
                basis.iter().zip(coefficients).for_each(|(v, c)| sets.add_scaled(&mut sum, c, v));
                sum
            };
            let residual = combined(&left);
            let is_met = goal.is_met_by(sets, x, &residual);
            let is_last = is_met || basis.len() > VECTORS || products >= limit || !(goal.go_on)();
            if is_last {
                let step = coarse.precondition(sets, &combined(&y));
                x.iter_mut().zip(&step).for_each(|(x, s)| *x += *s);
                r.copy_from_slice(&residual);
                if is_met || basis.len() <= VECTORS {
                    return products;
                }
                break;
            }
        }
    }
    products
}

/// `v` over `norm`, by set; 0 where that is 0.
fn scaled(space: &Space<'_>, v: &[Rgb], norm: &[Rgb]) -> Vec<Rgb> {
    let inverse: Vec<Rgb> = norm.iter().map(|n| divided(Rgb::WHITE, *n)).collect();
    let mut out = vec![Rgb::BLACK; v.len()];
    space.sets.add_scaled(&mut out, &inverse, v);
    out
}

/// The least squares min |norm e1 - H y| of each set and channel, H of Hessenberg form, by Givens rotations.
struct Small {
    /// Columns of H as they come: of each entry the values by set.
    columns: Vec<Vec<Vec<Rgb>>>,
    /// The same after the rotations: upper triangular.
    turned: Vec<Vec<Vec<Rgb>>>,
    rotations: Vec<Vec<[Rgb; 2]>>,
    right: Vec<Vec<Rgb>>,
    norm: Vec<Rgb>,
}

impl Small {
    fn new(norm: Vec<Rgb>) -> Self {
        Self { columns: Vec::new(), turned: Vec::new(), rotations: Vec::new(), right: vec![norm.clone()], norm }
    }

    fn add(&mut self, column: Vec<Vec<Rgb>>) {
        let mut turned = column.clone();
        self.columns.push(column);
        let k = self.rotations.len();
        for (row, rotation) in self.rotations.iter().enumerate() {
            for (s, [cos, sin]) in rotation.iter().enumerate() {
                let (a, b) = (turned[row][s], turned[row + 1][s]);
                turned[row][s] = *cos * a + *sin * b;
                turned[row + 1][s] = *cos * b - *sin * a;
            }
        }
        let rotation: Vec<[Rgb; 2]> = turned[k].iter().zip(&turned[k + 1]).map(|(a, b)| rotation(*a, *b)).collect();
        let mut last = vec![Rgb::BLACK; self.norm.len()];
        for (s, [cos, sin]) in rotation.iter().enumerate() {
            turned[k][s] = *cos * turned[k][s] + *sin * turned[k + 1][s];
            let right = self.right[k][s];
            (self.right[k][s], last[s]) = (*cos * right, Rgb::BLACK - *sin * right);
        }
        self.right.push(last);
        self.rotations.push(rotation);
        self.turned.push(turned);
    }

    /// y by column, and norm e1 - H y by row.
    fn solve(&self) -> (Vec<Vec<Rgb>>, Vec<Vec<Rgb>>) {
        let (n, sets) = (self.turned.len(), self.norm.len());
        let mut y = vec![vec![Rgb::BLACK; sets]; n];
        let mut left = vec![vec![Rgb::BLACK; sets]; n + 1];
        for s in 0..sets {
            for k in (0..n).rev() {
                let known: Rgb = (k + 1..n).map(|j| self.turned[j][k][s] * y[j][s]).sum();
                y[k][s] = divided(self.right[k][s] - known, self.turned[k][k][s]);
            }
            left[0][s] = self.norm[s];
            for (column, y) in self.columns.iter().zip(&y) {
                for (left, h) in left.iter_mut().zip(column) {
                    left[s] = left[s] - h[s] * y[s];
                }
            }
        }
        (y, left)
    }
}

/// Cosine and sine that turn (a, b) to (|(a, b)|, 0), by channel.
fn rotation(a: Rgb, b: Rgb) -> [Rgb; 2] {
    let at = |k: usize| {
        let length = a[k].hypot(b[k]);
        if length > 0.0 { [a[k] / length, b[k] / length] } else { [1.0, 0.0] }
    };
    let [r, g, b] = [at(0), at(1), at(2)];
    [Rgb::new(r[0], g[0], b[0]), Rgb::new(r[1], g[1], b[1])]
}
