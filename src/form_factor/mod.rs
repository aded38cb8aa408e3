//! Form factors F_ij: the share of the power that leaves patch i and arrives at patch j directly.
//!
//! Unitless, in [0, 1]; A_i F_ij = A_j F_ji; in a closed scene the row of i sums to 1 [Cohen93, chapter 4].

pub mod analytic;
pub mod blockers;
pub mod hemicube;
pub mod hierarchy;
pub mod known_rooms;
pub mod matrix;
pub mod memory;
pub mod method;
pub mod one_channel;
pub mod outside;
pub mod pairs;
pub mod polygon;
pub mod ray_cast;
pub mod ray_pairs;
pub mod stored;
pub mod virtual_rooms;
pub mod visibility;

pub use hierarchy::Hierarchy;
pub use known_rooms::KnownRooms;
pub use matrix::FormFactorMatrix;
pub use method::{FormFactorMethod, FormFactorSettings};
pub use one_channel::OneChannel;
pub use outside::Outside;
pub use ray_pairs::RayPairs;
pub use stored::Stored;

use crate::math::Rgb;
use serde::Serialize;

/// What the rows looked like before anything was corrected: the honest quality of the form factors.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, serde::Deserialize)]
pub struct Closure {
    /// Smallest sum of a row, what escapes included. 1 in theory.
    pub row_sum_min: f64,
    /// Largest sum of a row, what escapes included. 1 in theory.
    pub row_sum_max: f64,
    /// Largest share of a row that leaves the scene.
    pub escaped_max: f64,
    /// Root of the mean over pairs, weighted by their transport, of the squared relative defect of A_i F_ij = A_j F_ji.
    pub reciprocity_defect: f64,
    /// Mean over the area of |sum of a row - its target| that is left after the correction: light that rows make or lose.
    pub corrected_defect: f64,
}

impl Closure {
    /// Mean over the area of what rows are off by: (area, sum, target).
    fn mean_defect(rows: impl Iterator<Item = (f64, f64, f64)>) -> f64 {
        let (off, all) = rows.fold((0.0, 0.0), |(off, all), (area, sum, target)| (off + area * (sum - target).abs(), all + area));
        if all > 0.0 { off / all } else { 0.0 }
    }
}

/// Looks at a part of the row of the k-th patch asked for: `(k, factor, entries)`; each entry is a patch and a
/// weight, which the factor is to be multiplied with.
pub type RowPart<'a> = dyn FnMut(usize, f64, &[(u32, f64)]) + 'a;

/// The operator F of pass one as solvers see it: numbers, however they are kept (rows, links between groups of patches).
///
/// Row i is the receiver: F_ij is the share of what leaves patch i that arrives at patch j, and, by reciprocity, the weight with which
/// the radiosity of j counts in the irradiance of i. Entries through specular surfaces are coloured.
pub trait FormFactors: Sync {
    /// Number of patches.
    fn len(&self) -> usize;

    /// True if there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// out_i = sum_j F_ij x_j for all patches, in parallel: the same bits on any number of threads. Both slices are `len()` long.
    fn gather(&self, x: &[Rgb], out: &mut [Rgb]);

    /// Shows the entries (j, F_ij) of row `i` that are not zero, several for the same j where light takes several ways. Grouped form
    /// factors are spread over their patches, so that a row may cost as much as there are patches.
    fn row(&self, i: usize, visit: &mut dyn FnMut(usize, Rgb));

    /// Shows the rows of several patches, averaged over channels, in parts. Where form factors are grouped it is cheaper to go through
    /// all groups once than to look for each row.
    fn some_rows(&self, patches: &[usize], visit: &mut RowPart<'_>) {
        patches.iter().enumerate().for_each(|(k, &i)| self.row(i, &mut |j, f| visit(k, 1.0, &[(j as u32, f.mean())])));
    }

    /// Where rooms that were found in these form factors are kept, if they are.
    fn known_rooms(&self) -> Option<&KnownRooms> {
        None
    }

    /// out[g]_i = sum over the patches j of group g of F_ij x_j. Patches of groups that `out` does not have are left out. Returns how many
    /// times the form factors were gone through: once for each group, unless there is a better way.
    fn gather_groups(&self, x: &[Rgb], group: &[u8], out: &mut [Vec<Rgb>]) -> u32 {
        for (g, out) in out.iter_mut().enumerate() {
            let part = x.iter().zip(group).map(|(x, of)| if usize::from(*of) == g { *x } else { Rgb::BLACK });
            self.gather(&part.collect::<Vec<Rgb>>(), out);
        }
        out.len() as u32
    }

    /// Names pairs of patches (i, j) with F_ij > 0, enough of them that whoever exchanges light, directly or by others, is joined by a
    /// chain of pairs. All pairs, unless the form factors are grouped and fewer will do.
    fn join(&self, pair: &mut dyn FnMut(usize, usize)) {
        (0..self.len()).for_each(|i| self.row(i, &mut |j, _| pair(i, j)));
    }

    /// True if A_i F_ij = A_j F_ji for all pairs, up to rounding: what conjugate gradients rest on. Light through specular surfaces is
    /// measured one way only.
    fn is_reciprocal(&self) -> bool;
}
