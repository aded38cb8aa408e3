//! How many rays a patch gets beside one of the full size.

use super::PatchMesh;

/// Least share of the rays of a patch of the full size that any patch gets; what a small one sends and blocks counts by its area, and so does
/// the error that its rays leave.
const LEAST_SHARE: f64 = 0.125;
/// The same for a first look.
const LEAST_SHARE_AT_FIRST: f64 = 1.0 / 32.0;

fn least_share(rough: bool) -> f64 {
    if rough { LEAST_SHARE_AT_FIRST } else { LEAST_SHARE }
}

impl PatchMesh {
    /// Least share of the rays of a patch of the full size that any patch gets.
    pub fn least_share(&self) -> f64 {
        least_share(self.rough)
    }

    /// Rays of the patches that a mesh of cells `growth` times as small in area makes of these, over the rays of these if a full patch gets as many: a
    /// wall is cut in more, what is small and curved is there already.
    pub fn shares_if_finer(&self, growth: f64, rough: bool) -> f64 {
        let cell = self.patch_size * self.patch_size;
        let shares = |cell: f64, least: f64| {
            let share = |area: &f64| (area / cell).max(least);
            self.area.iter().map(share).sum::<f64>()
        };
        shares(cell / growth, least_share(rough)) / shares(cell, self.least_share())
    }
}
