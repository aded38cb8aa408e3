//! Form factors in the form in which a run keeps them.

use super::{Closure, FormFactorMatrix, FormFactors, Hierarchy, KnownRooms, RowPart};
use crate::math::Rgb;

/// One variant for each way of keeping them.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub enum Stored {
    /// Sparse rows.
    Rows(Box<FormFactorMatrix>),
    /// Links between groups of patches.
    Links(Box<Hierarchy>),
}

impl Stored {
    /// The rows, if they are kept as such.
    pub fn rows(&self) -> Option<&FormFactorMatrix> {
        match self {
            Stored::Rows(matrix) => Some(matrix),
            Stored::Links(_) => None,
        }
    }

    /// out_i = sum_j F_ij x_j over what is seen directly, in parallel: the same bits on any number of threads.
    pub fn gather_direct(&self, x: &[Rgb], out: &mut [Rgb]) {
        match self {
            Stored::Rows(matrix) => matrix.gather_direct(x, out),
            Stored::Links(links) => links.gather_direct(x, out),
        }
    }

    /// Number of entries above zero.
    pub fn n_nonzero(&self) -> usize {
        match self {
            Stored::Rows(matrix) => matrix.n_nonzero(),
            Stored::Links(links) => links.n_nonzero(),
        }
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        match self {
            Stored::Rows(matrix) => matrix.memory_bytes(),
            Stored::Links(links) => links.memory_bytes(),
        }
    }

    /// Quality before correction.
    pub fn closure(&self) -> Closure {
        match self {
            Stored::Rows(matrix) => matrix.closure,
            Stored::Links(links) => links.closure,
        }
    }

    fn operator(&self) -> &dyn FormFactors {
        match self {
            Stored::Rows(matrix) => &**matrix,
            Stored::Links(links) => &**links,
        }
    }
}

impl FormFactors for Stored {
    fn len(&self) -> usize {
        self.operator().len()
    }

    fn gather(&self, x: &[Rgb], out: &mut [Rgb]) {
        self.operator().gather(x, out);
    }

    fn gather_groups(&self, x: &[Rgb], group: &[u8], out: &mut [Vec<Rgb>]) -> u32 {
        self.operator().gather_groups(x, group, out)
    }

    fn join(&self, pair: &mut dyn FnMut(usize, usize)) {
        self.operator().join(pair);
    }

    fn row(&self, i: usize, visit: &mut dyn FnMut(usize, Rgb)) {
        self.operator().row(i, visit);
    }

    fn some_rows(&self, patches: &[usize], visit: &mut RowPart<'_>) {
        self.operator().some_rows(patches, visit);
    }

    fn known_rooms(&self) -> Option<&KnownRooms> {
        self.operator().known_rooms()
    }

    fn is_reciprocal(&self) -> bool {
        self.operator().is_reciprocal()
    }
}
