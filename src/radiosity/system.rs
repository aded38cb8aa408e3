//! The linear system as the solvers see it: numbers, never triangles.

use crate::form_factor::FormFactors;
use crate::math::Rgb;

/// Unknown: irradiance H_i [W/m²] of each patch. With reflected radiosity R_j = rho_j H_j,
/// H_i = S_i + sum_j F_ij R_j, where F has a direct part and a coloured one through specular surfaces.
///
/// The source S holds all light that has not been reflected by a patch: of lamps by shadow rays, of glowing walls by form factors.
/// Irradiance is unknown rather than radiosity, so that a black patch needs no division by rho.
pub struct RadiositySystem<'a> {
    /// Diffuse reflectance of each patch.
    pub rho: &'a [Rgb],
    /// Area of each patch [m²].
    pub area: &'a [f64],
    /// Form factors.
    pub form_factors: &'a dyn FormFactors,
    /// Irradiance of each patch from light that no patch has reflected yet [W/m²].
    pub source: Vec<Rgb>,
}

impl RadiositySystem<'_> {
    /// Number of patches.
    pub fn len(&self) -> usize {
        self.rho.len()
    }

    /// True if there are no patches.
    pub fn is_empty(&self) -> bool {
        self.rho.is_empty()
    }

    /// sum_j F_ij rho_j H_j.
    #[inline]
    pub fn reflected_to(&self, i: usize, irradiance: &[Rgb]) -> Rgb {
        let mut sum = Rgb::BLACK;
        self.form_factors.row(i, &mut |j, f| sum += self.rho[j] * irradiance[j] * f);
        sum
    }

    /// sum_j F_ij rho_j: what a uniform irradiance of 1 everywhere would send back to patch `i`.
    pub fn row_reflectance(&self, i: usize) -> Rgb {
        let mut sum = Rgb::BLACK;
        self.form_factors.row(i, &mut |j, f| sum += self.rho[j] * f);
        sum
    }

    /// Patches that light can reach, in rising order: those with a source, and those that see one that is reached and reflects. The
    /// others, such as the insides of closed bodies, stay exactly dark and need no sweeps.
    pub fn reached(&self) -> Vec<usize> {
        let mut lit: Vec<bool> = self.source.iter().map(|s| !s.is_black()).collect();
        loop {
            let sees_light = |i: usize| self.sees(i, |j| lit[j] && !self.rho[j].is_black());
            let new: Vec<usize> = (0..self.len()).filter(|&i| !lit[i] && sees_light(i)).collect();
            if new.is_empty() {
                return (0..self.len()).filter(|&i| lit[i]).collect();
            }
            new.into_iter().for_each(|i| lit[i] = true);
        }
    }

    /// True if patch `i` sees, directly or through specular surfaces, one that `is_such`.
    fn sees(&self, i: usize, is_such: impl Fn(usize) -> bool) -> bool {
        let mut found = false;
        self.form_factors.row(i, &mut |j, _| found = found || is_such(j));
        found
    }

    /// Largest over the rows of `patches` and channels of sum_j F_ij rho_j: bounds the spectral radius.
    pub fn spectral_bound(&self, patches: &[usize]) -> f64 {
        patches.iter().map(|&i| self.row_reflectance(i).max()).fold(0.0, f64::max)
    }

    /// True if in some channel some of `patches` see only each other and lose nothing: light there has no steady state.
    pub fn has_closed_white_set(&self, patches: &[usize]) -> bool {
        (0..3).any(|channel| {
            let mut white = vec![false; self.len()];
            // Rows sum to 1 only up to the rounding of their entries.
            patches.iter().for_each(|&i| white[i] = self.row_reflectance(i)[channel] >= 1.0 - 1e-9);
            loop {
                let leaky: Vec<usize> = patches.iter().copied().filter(|&i| white[i] && self.sees(i, |j| !white[j])).collect();
                if leaky.is_empty() {
                    return white.contains(&true);
                }
                leaky.into_iter().for_each(|i| white[i] = false);
            }
        })
    }

    /// `patches` in sets between which no light passes, each in rising order. Patches that reflect nothing still belong to those that
    /// light them.
    pub fn separate(&self, patches: &[usize]) -> Vec<Vec<usize>> {
        // Every patch points towards the smallest of its set; paths are halved on the way.
        let mut towards: Vec<usize> = (0..self.len()).collect();
        fn root(towards: &mut [usize], mut i: usize) -> usize {
            while towards[i] != i {
                towards[i] = towards[towards[i]];
                i = towards[i];
            }
            i
        }
        for &i in patches {
            self.form_factors.row(i, &mut |j, _| {
                let (a, b) = (root(&mut towards, i), root(&mut towards, j));
                towards[a.max(b)] = a.min(b);
            });
        }
        let mut set_of = vec![usize::MAX; self.len()];
        let mut sets: Vec<Vec<usize>> = Vec::new();
        for &i in patches {
            let first = root(&mut towards, i);
            if set_of[first] == usize::MAX {
                set_of[first] = sets.len();
                sets.push(Vec::new());
            }
            sets[set_of[first]].push(i);
        }
        sets
    }

    /// Area-weighted mean irradiance of `patches`, the largest channel.
    pub fn mean_irradiance(&self, patches: &[usize], irradiance: &[Rgb]) -> f64 {
        let weighted: Rgb = patches.iter().map(|&i| irradiance[i] * self.area[i]).sum();
        let area: f64 = patches.iter().map(|&i| self.area[i]).sum();
        if area > 0.0 { weighted.max() / area } else { 0.0 }
    }
}
