//! Sets of patches that exchange light: rooms behind closed doors are systems of their own.

use super::{SolveError, system::RadiositySystem};
use crate::math::Rgb;

/// Row sums from here on count as 1: they are no better than the rounding of their entries.
const WHITE: f64 = 1.0 - 1e-9;
/// Rays from which on a part that none of them left is taken to be closed.
const FEW: f64 = 4096.0;

/// The patches that light reaches, by set. The others, such as the insides of closed bodies, stay exactly dark and belong to none.
///
/// Sets are solved side by side: one product with the form factors serves all of them, but each has inner products, step lengths and a
/// tolerance of its own. Beside a bright room a dark one would otherwise be left as it was after a few steps.
pub(super) struct Sets {
    /// Patches of each set in rising order; sets in the order of their first patch.
    pub members: Vec<Vec<usize>>,
    /// sum_j F_ij rho_j over the patches that light reaches.
    pub row_reflectance: Vec<Rgb>,
    /// Products with the form factors that finding them took.
    pub gathers: u32,
}

impl Sets {
    /// Finds the sets.
    ///
    /// # Errors
    /// [`SolveError::NoSteadyState`] if in some channel some patches that light reaches see only each other and lose nothing.
    pub fn find(system: &RadiositySystem<'_>) -> Result<Self, SolveError> {
        let mut lit: Vec<bool> = system.source.iter().map(|s| !s.is_black()).collect();
        let mut row_reflectance = vec![Rgb::BLACK; system.len()];
        let mut gathers = 0;
        let mut towards: Vec<usize> = (0..system.len()).collect();
        // Where every patch passes light on, both ways, whoever is joined with a lit one is lit: no product is needed to see that.
        let is_joined = system.form_factors.is_reciprocal() && !system.rho.iter().any(|rho| rho.is_black());
        if is_joined {
            system.form_factors.join(&mut |i, j| unite(&mut towards, i, j));
            let mut is_reached = vec![false; system.len()];
            (0..system.len()).filter(|&i| lit[i]).for_each(|i| is_reached[root(&mut towards, i)] = true);
            (0..system.len()).for_each(|i| lit[i] = is_reached[root(&mut towards, i)]);
        }
        // Light goes on from patches that it reaches and that reflect. The last round finds nothing new, and its product is the row sums.
        loop {
            let reflecting: Vec<Rgb> =
                lit.iter().zip(system.rho).map(|(lit, rho)| if *lit { *rho } else { Rgb::BLACK }).collect();
            system.form_factors.gather(&reflecting, &mut row_reflectance);
            gathers += 1;
            let mut has_grown = false;
            for (lit, row) in lit.iter_mut().zip(&row_reflectance) {
                has_grown |= !*lit && !row.is_black();
                *lit |= !row.is_black();
            }
            if !has_grown {
                break;
            }
        }
        if !is_joined {
            system.form_factors.join(&mut |i, j| {
                if lit[i] {
                    unite(&mut towards, i, j);
                }
            });
        }
        let mut sets = Self { members: members(&mut towards, &lit), row_reflectance, gathers };
        if sets.has_closed_white_part(system) {
            return Err(SolveError::NoSteadyState { spectral_bound: sets.spectral_bound() });
        }
        Ok(sets)
    }

    /// Largest over the rows and channels of sum_j F_ij rho_j: bounds the spectral radius.
    pub fn spectral_bound(&self) -> f64 {
        self.members.iter().map(|set| self.spectral_bound_of(set)).fold(0.0, f64::max)
    }

    /// The same over the patches of one set.
    pub fn spectral_bound_of(&self, set: &[usize]) -> f64 {
        set.iter().map(|&i| self.row_reflectance[i].max()).fold(0.0, f64::max)
    }

    /// Inner product of each set: sum of w_i a_i b_i, by channel.
    pub fn dot(&self, weight: &[Rgb], a: &[Rgb], b: &[Rgb]) -> Vec<Rgb> {
        let of = |set: &Vec<usize>| set.iter().map(|&i| weight[i] * a[i] * b[i]).sum();
        self.members.iter().map(of).collect()
    }

    /// x += scale y, with a factor for each set.
    pub fn add_scaled(&self, x: &mut [Rgb], scale: &[Rgb], y: &[Rgb]) {
        for (set, scale) in self.members.iter().zip(scale) {
            set.iter().for_each(|&i| x[i] += *scale * y[i]);
        }
    }

    /// True if in some channel some patches see only each other and reflect all.
    fn has_closed_white_part(&mut self, system: &RadiositySystem<'_>) -> bool {
        let mut white = vec![Rgb::BLACK; system.len()];
        for &i in self.members.iter().flatten() {
            white[i] = self.row_reflectance[i].map(is_white);
        }
        closed_part(system, &mut white, &mut self.gathers)
    }
}

/// Reflectances with which no patches that see only each other pass on more light than they get; `None` if those given are such.
///
/// What is seen by way of gloss and glass adds to a row whose direct part is held to what a half space holds, and all is known by few rays. So
/// a row in a gap between two glossy things may claim more than all though nothing there is white, and a white patch folded over itself
/// that it sees nothing else. Where the light of such rows has nowhere else to go there would be no solution. There rows pass on no more than
/// the brightest of their patches reflects, and no more than so few rays can tell from all: n that stay say that a share of 1/(n + 1) may
/// leave (rule of succession). White parts of [`FEW`] rays (`rays` of each patch) or more, and those with half of all area
/// are left as they are, to be refused. Nothing is asked of the source of `system`.
pub fn held_reflectance(system: &RadiositySystem<'_>, rays: impl Fn(usize) -> f64) -> Option<Vec<Rgb>> {
    let RadiositySystem { rho, area, form_factors, .. } = system;
    let is_bounded = form_factors.is_reciprocal() && rho.iter().all(|rho| rho.max() < WHITE);
    if is_bounded {
        return None;
    }
    let mut row_reflectance = vec![Rgb::BLACK; rho.len()];
    form_factors.gather(rho, &mut row_reflectance);
    let mut part: Vec<Rgb> = row_reflectance.iter().map(|row| row.map(is_white)).collect();
    if !closed_part(system, &mut part, &mut 0) {
        return None;
    }
    let scale: [f64; 3] = std::array::from_fn(|c| {
        let members = || part.iter().enumerate().filter(|(_, part)| part[c] > 0.0).map(|(i, _)| i);
        let most = members().map(|i| rho[i][c]).fold(0.0, f64::max);
        let row = members().map(|i| row_reflectance[i][c]).fold(0.0, f64::max);
        let n = members().map(&rays).sum::<f64>();
        let is_small = members().map(|i| area[i]).sum::<f64>() < 0.5 * area.iter().sum::<f64>();
        match (most < WHITE, n < FEW && is_small) {
            (true, _) if row > 0.0 => most / row,
            (false, true) => n / (n + 1.0) / row,
            _ => 1.0,
        }
    });
    let of_part = |part: &Rgb| std::array::from_fn(|c| if part[c] > 0.0 { scale[c] } else { 1.0 });
    let held = rho.iter().zip(&part).map(|(rho, part)| *rho * Rgb::from(of_part(part))).collect();
    Some(held)
}

/// 1 where a patch is white as far as is known.
fn is_white(row: f64) -> f64 {
    if row >= WHITE { 1.0 } else { 0.0 }
}

/// Of patches that pass on all they get (1 in a channel, others 0) leaves those that get light only from each other; true if there are any.
fn closed_part(system: &RadiositySystem<'_>, white: &mut [Rgb], gathers: &mut u32) -> bool {
    let mut lost = vec![Rgb::BLACK; white.len()];
    while white.iter().any(|w| !w.is_black()) {
        let others: Vec<Rgb> = white.iter().map(|w| Rgb::WHITE - *w).collect();
        system.form_factors.gather(&others, &mut lost);
        *gathers += 1;
        let mut has_shrunk = false;
        for (white, lost) in white.iter_mut().zip(&lost) {
            let kept = *white * lost.map(|v| if v > 0.0 { 0.0 } else { 1.0 });
            has_shrunk |= kept != *white;
            *white = kept;
        }
        if !has_shrunk {
            return true;
        }
    }
    false
}

/// The first patch of the set of patch i as far as is known: every patch points towards a smaller one of its set, and paths are halved on the way.
fn root(towards: &mut [usize], mut i: usize) -> usize {
    while towards[i] != i {
        towards[i] = towards[towards[i]];
        i = towards[i];
    }
    i
}

/// Puts the sets of two patches together.
fn unite(towards: &mut [usize], i: usize, j: usize) {
    // Most pairs are in one set and known to be.
    if towards[i] != towards[j] {
        let (a, b) = (root(towards, i), root(towards, j));
        towards[a.max(b)] = a.min(b);
    }
}

/// The lit patches of each set, in rising order; sets in the order of their first patch.
fn members(towards: &mut [usize], lit: &[bool]) -> Vec<Vec<usize>> {
    let mut set_of = vec![usize::MAX; lit.len()];
    let mut sets: Vec<Vec<usize>> = Vec::new();
    for i in (0..lit.len()).filter(|&i| lit[i]) {
        let first = root(towards, i);
        if set_of[first] == usize::MAX {
            set_of[first] = sets.len();
            sets.push(Vec::new());
        }
        sets[set_of[first]].push(i);
    }
    sets
}

/// Quotient per channel; 0 where it does not exist, which leaves that channel where it is.
pub(super) fn divided(a: Rgb, b: Rgb) -> Rgb {
    let quotient = |a: f64, b: f64| {
        let q = a / b;
        if q.is_finite() { q } else { 0.0 }
    };
    Rgb::new(quotient(a.r, b.r), quotient(a.g, b.g), quotient(a.b, b.b))
}
