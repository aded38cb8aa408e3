//! Pass one's equations: B = E + rho F B, solved to a bound on the true error.

pub mod field;
pub mod gauss_seidel;
pub mod interpolation;
mod krylov;
pub mod system;

pub use field::{Incident, RadiosityField};
pub use interpolation::Interpolation;
pub use system::RadiositySystem;

use crate::math::Rgb;
use serde::Serialize;

/// When a solver may stop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SolverSettings {
    /// Bound on the error of any patch's irradiance, relative to the area-weighted mean irradiance.
    pub tolerance: f64,
    /// Sweeps after which it gives up.
    pub max_sweeps: u32,
}

impl Default for SolverSettings {
    /// 1e-5: far below the percent that measured form factors leave. Gauss-Seidel needs a number of sweeps for it that grows as 1/(1 - rho).
    fn default() -> Self {
        Self { tolerance: 1e-5, max_sweeps: 20_000 }
    }
}

/// A solution and how good it is.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Irradiance H [W/m²] of each patch from other patches (what the system's source holds is included).
    pub irradiance: Vec<Rgb>,
    /// Sweeps done.
    pub sweeps: u32,
    /// Bound on the error of any patch, relative to the area-weighted mean irradiance.
    pub error_bound: f64,
    /// Bound on the largest eigenvalue: the largest of rho_i times the sum of row i.
    pub spectral_bound: f64,
    /// False if `max_sweeps` ended it.
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
