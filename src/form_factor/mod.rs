//! Form factors F_ij: the share of the power that leaves patch i and arrives at patch j directly.
//!
//! Unitless, in [0, 1]; A_i F_ij = A_j F_ji; in a closed scene the row of i sums to 1 [Cohen93, chapter 4].

pub mod analytic;
pub mod matrix;
pub mod ray_cast;

pub use matrix::FormFactorMatrix;

use serde::Serialize;

/// What the rows looked like before anything was corrected: the honest quality of the form factors.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Closure {
    /// Smallest sum of a row, what escapes included. 1 in theory.
    pub row_sum_min: f64,
    /// Largest sum of a row, what escapes included. 1 in theory.
    pub row_sum_max: f64,
    /// Largest share of a row that leaves the scene.
    pub escaped_max: f64,
    /// Root of the mean over pairs, weighted by their transport, of the squared relative defect of A_i F_ij = A_j F_ji.
    pub reciprocity_defect: f64,
    /// Largest remaining |sum of a row - its target| after the correction.
    pub corrected_defect: f64,
}
