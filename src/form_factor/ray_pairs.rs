//! Rays that start at one point in pairs: what of the light that falls on a patch is seen from where.
//!
//! A form factor takes the light of a patch to be alike all over it. What one ray of a pair brings and where the other goes are of one and the
//! same point: they know what the mean over the patch does not, that points under a table or in the gap behind a cupboard are dark and
//! look at nothing but the table and the cupboard.

/// What a ray met directly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Met(u32);

impl Met {
    /// No patch, or one only by way of something else.
    pub const NONE: Met = Met(u32::MAX);
    const NEAR: u32 = 1 << 31;

    /// Patch `patch`, near by or not.
    #[inline]
    pub fn new(patch: u32, is_near: bool) -> Self {
        Met(patch | if is_near { Self::NEAR } else { 0 })
    }

    /// The patch.
    #[inline]
    pub fn patch(self) -> Option<usize> {
        (self != Self::NONE).then_some((self.0 & !Self::NEAR) as usize)
    }

    /// True if it was met near by.
    #[inline]
    pub fn is_near(self) -> bool {
        self != Self::NONE && self.0 & Self::NEAR != 0
    }
}

/// The pairs of all patches.
#[derive(Debug, Clone, Default)]
pub struct RayPairs {
    start: Vec<usize>,
    met: Vec<[Met; 2]>,
}

impl RayPairs {
    /// Adds those of the next patch.
    pub fn push(&mut self, pairs: impl IntoIterator<Item = [Met; 2]>) {
        if self.start.is_empty() {
            self.start.push(0);
        }
        self.met.extend(pairs);
        self.start.push(self.met.len());
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.met.is_empty()
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        8 * (self.met.len() + self.start.len())
    }

    /// Those of patch `i`.
    pub fn of(&self, i: usize) -> &[[Met; 2]] {
        &self.met[self.start[i]..self.start[i + 1]]
    }

    /// Each ray of patch `i` with the other of its pair.
    pub fn both_ways(&self, i: usize) -> impl Iterator<Item = (Met, Met)> {
        self.of(i).iter().flat_map(|&[a, b]| [(a, b), (b, a)])
    }
}
