//! Pass one's equations: B = E + rho F B, solved to a bound on the true error.
//!
//! One file a solver, all with the signature of [`solve`]. What several of them need stands beside them: `sets` finds the sets of patches
//! that exchange light, `rooms` the rooms within those, `coarse` the small system over rooms, `bound` how much a residual may mean,
//! `krylov` what is common to the Krylov methods.

mod bicgstab;
mod bound;
mod cg;
mod coarse;
pub mod field;
mod gauss_seidel;
mod gmres;
pub mod interpolation;
mod jacobi;
mod krylov;
mod rooms;
mod sets;
mod southwell;
pub mod system;

pub use field::{Incident, RadiosityField};
pub use interpolation::Interpolation;
pub use sets::held_reflectance;
pub use system::RadiositySystem;

use crate::math::Rgb;
use crate::progress::Observer;
use serde::{Deserialize, Serialize};

/// How the system is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// Each patch in turn, with what the others have just become [Goral84], [Cohen85].
    GaussSeidel,
    /// All patches at once from what they were: one bounce of light a sweep.
    Jacobi,
    /// Progressive shooting: the patch with most unshot power first [Cohen88], [Gortler94].
    Southwell,
    /// Conjugate gradients with a constant vector for each room taken out [Hestenes52], [Nicolaides87].
    #[default]
    Cg,
    /// The smallest residual in a Krylov space [SaadSchultz86].
    Gmres,
    /// Two short recurrences for systems without symmetry [Vorst92].
    BiCgStab,
}

impl Solver {
    /// All, in the order of the documentation.
    pub const ALL: [Solver; 6] =
        [Solver::GaussSeidel, Solver::Jacobi, Solver::Southwell, Solver::Cg, Solver::Gmres, Solver::BiCgStab];

    /// Name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Solver::GaussSeidel => "gauss-seidel",
            Solver::Jacobi => "jacobi",
            Solver::Southwell => "southwell",
            Solver::Cg => "cg",
            Solver::Gmres => "gmres",
            Solver::BiCgStab => "bicgstab",
        }
    }
}

/// How to solve, and when to stop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SolverSettings {
    /// The method.
    pub solver: Solver,
    /// Bound on the error of any patch's irradiance, relative to the area-weighted mean irradiance of the patches that it exchanges light with.
    pub tolerance: f64,
    /// Products with the form factors, or sweeps over them, after which it gives up.
    pub max_sweeps: u32,
}

impl Default for SolverSettings {
    /// 1e-5: far below the percent that measured form factors leave.
    fn default() -> Self {
        Self { solver: Solver::default(), tolerance: 1e-5, max_sweeps: 20_000 }
    }
}

/// A solution and how good it is.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Irradiance H [W/m²] of each patch from other patches (what the system's source holds is included).
    pub irradiance: Vec<Rgb>,
    /// Products with the form factors, or sweeps over them: whatever goes once over all of them, preparation and verification included.
    pub sweeps: u32,
    /// Bound on the error of any patch, relative to the area-weighted mean irradiance.
    pub error_bound: f64,
    /// Bound on the largest eigenvalue: the largest of rho_i times the sum of row i.
    pub spectral_bound: f64,
    /// Bound on how much the system amplifies, the largest row sum of (I - F rho)⁻¹: 1/(1 - rho) in a closed room of one reflectance.
    pub amplification: f64,
    /// The same in the mean over the area: what rows of F make or lose of light counts in all of the solution by about this less 1.
    pub mean_amplification: f64,
    /// Rooms found, over all sets of patches that exchange light; 0 where the solver had no use for them.
    pub rooms: u32,
    /// The method that got there: another than was asked for where that one is not made for the system.
    pub solver: Solver,
    /// False if it was stopped, or got no nearer, before the tolerance was met.
    pub converged: bool,
}

/// Why there is no solution.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// Light is emitted into a closed scene that absorbs nothing.
    #[error("no steady state: the scene reflects all light (largest reflectance times row sum is {spectral_bound}) and emits")]
    NoSteadyState {
        /// The largest rho_i times the sum of row i.
        spectral_bound: f64,
    },
}

/// Solves H = S + F rho H by the method that the settings name.
///
/// All stop on a bound of the true error of any patch ([`Solution::error_bound`]), never on the change from step to step, which for a
/// small lamp in a bright room is small at once with nearly everything missing. One that gets no nearer or is stopped returns what it has
/// with its bound, not converged.
///
/// # Errors
/// [`SolveError::NoSteadyState`] if there is light and a set of patches that loses none.
pub fn solve(
    system: &RadiositySystem<'_>,
    settings: &SolverSettings,
    observer: &mut Observer<'_>,
) -> Result<Solution, SolveError> {
    match settings.solver {
        Solver::GaussSeidel => gauss_seidel::solve(system, settings, observer),
        Solver::Jacobi => jacobi::solve(system, settings, observer),
        Solver::Southwell => southwell::solve(system, settings, observer),
        Solver::Cg => cg::solve(system, settings, observer),
        Solver::Gmres => gmres::solve(system, settings, observer),
        Solver::BiCgStab => bicgstab::solve(system, settings, observer),
    }
}

#[cfg(test)]
mod tests;
