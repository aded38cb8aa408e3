//! Form factors in a scene that is known to be grey: products in one channel, which stands for three.

use super::{FormFactors, KnownRooms, RowPart, Stored};
use crate::math::Rgb;

/// Form factors that are only ever multiplied with what is equal in all channels. Those that are grouped do not make use of it.
pub struct OneChannel<'a>(pub &'a Stored);

impl OneChannel<'_> {
    /// Channels that a product goes through.
    pub fn channels(&self) -> u32 {
        match self.0 {
            Stored::Rows(_) => 1,
            Stored::Links(_) => 3,
        }
    }
}

impl FormFactors for OneChannel<'_> {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn gather(&self, x: &[Rgb], out: &mut [Rgb]) {
        match self.0 {
            Stored::Rows(matrix) => matrix.gather_grey(x, out),
            Stored::Links(links) => links.gather(x, out),
        }
    }

    fn gather_groups(&self, x: &[Rgb], group: &[u8], out: &mut [Vec<Rgb>]) -> u32 {
        self.0.gather_groups(x, group, out)
    }

    fn join(&self, pair: &mut dyn FnMut(usize, usize)) {
        self.0.join(pair);
    }

    fn row(&self, i: usize, visit: &mut dyn FnMut(usize, Rgb)) {
        self.0.row(i, visit);
    }

    fn some_rows(&self, patches: &[usize], visit: &mut RowPart<'_>) {
        self.0.some_rows(patches, visit);
    }

    fn known_rooms(&self) -> Option<&KnownRooms> {
        self.0.known_rooms()
    }

    fn is_reciprocal(&self) -> bool {
        self.0.is_reciprocal()
    }
}
