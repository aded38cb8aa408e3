//! What the row of a patch sees besides other patches: the outside, what was cut, and light that no patch has reflected.

use crate::math::Rgb;

/// A walk from a patch through mirrors, glass and gloss, as the row of the patch counts it: what comes from beyond a patch on its way has
/// fallen on that one before.
#[derive(Debug, Default)]
pub struct Walked {
    found: Rgb,
    found_again: Rgb,
    has_met_patch: bool,
}

impl Walked {
    /// Light is found that no patch has reflected [W/(m² sr)].
    pub fn find(&mut self, light: Rgb) {
        self.found += light;
        if self.has_met_patch {
            self.found_again += light;
        }
    }

    /// The walk has come to a patch and may go on.
    pub fn meet_patch(&mut self) {
        self.has_met_patch = true;
    }
}

/// Sums over the walks of a row.
#[derive(Debug, Default, Clone, Copy)]
pub struct Walks {
    escaped: Rgb,
    truncated: Rgb,
    passed_on: Rgb,
    passed_out: Rgb,
    arriving: Rgb,
    accepted: Rgb,
    arriving_again: Rgb,
}

impl Walks {
    /// A walk arrives at a patch by way of something else with this share.
    pub fn arrive(&mut self, walk: &Walked, throughput: Rgb) {
        if walk.has_met_patch {
            self.passed_on += throughput;
        }
    }

    /// One leaves the scene.
    pub fn escape(&mut self, walk: &Walked, throughput: Rgb) {
        self.escaped += throughput;
        self.leave(walk, throughput);
    }

    /// One is cut by the limit of specular events.
    pub fn truncate(&mut self, walk: &Walked, throughput: Rgb) {
        self.truncated += throughput;
        self.leave(walk, throughput);
    }

    /// True if any found light, or was cut before it could.
    pub fn has_light(&self) -> bool {
        !self.arriving.is_black() || !self.truncated.is_black()
    }

    fn leave(&mut self, walk: &Walked, throughput: Rgb) {
        if walk.has_met_patch {
            self.passed_out += throughput;
        }
    }

    /// Adds the light that a walk has found, if any; `acceptance`: what the diffuse part of the patch makes of its direction. Returns the light.
    pub fn add_light(&mut self, walk: &Walked, acceptance: impl FnOnce() -> Rgb) -> Rgb {
        if !walk.found.is_black() {
            self.arriving += walk.found;
            self.accepted += walk.found * acceptance();
            self.arriving_again += walk.found_again;
        }
        walk.found
    }

    /// The row of so many walks.
    pub fn row(self, walks: u32) -> OutsideRow {
        let share = 1.0 / f64::from(walks);
        let narrow = |v: Rgb| (v * share).to_array().map(|v| v as f32);
        OutsideRow {
            escaped: narrow(self.escaped),
            truncated: narrow(self.truncated),
            passed_on: narrow(self.passed_on),
            passed_out: narrow(self.passed_out),
            arriving: self.arriving * share,
            accepted: self.accepted * share,
            arriving_again: self.arriving_again * share,
        }
    }
}

/// By patch, whatever its form factors are kept as.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct Outside {
    len: usize,
    /// Empty as long as no patch sees anything but others.
    rows: Vec<OutsideRow>,
}

/// The same of one patch.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OutsideRow {
    /// Share that leaves the scene, per channel (coloured by what it passed).
    pub escaped: [f32; 3],
    /// Share that was cut by the limit of specular events.
    pub truncated: [f32; 3],
    /// Share that patches passed on to patches, by gloss or ideal lobes. By reciprocity it is the share of what this patch sends that has
    /// fallen on patches before it does so again.
    pub passed_on: [f32; 3],
    /// The part of `escaped` and `truncated` that patches passed on.
    pub passed_out: [f32; 3],
    /// Mean radiance [W/(m² sr)] of emitters that are not seen directly.
    pub arriving: Rgb,
    /// The same, weighted by what the diffuse part of the patch makes of each direction.
    pub accepted: Rgb,
    /// The part of `arriving` that other patches passed on: it has fallen on them before [W/(m² sr)].
    pub arriving_again: Rgb,
}

impl Outside {
    /// Adds the next patch.
    pub fn push(&mut self, row: OutsideRow) {
        if !self.rows.is_empty() || row != OutsideRow::default() {
            self.rows.resize(self.len, OutsideRow::default());
            self.rows.push(row);
        }
        self.len += 1;
    }

    /// Adds mean radiance [W/(m² sr)] over the rays of row i, as it arrives and as the patch accepts it.
    pub fn add_arriving(&mut self, i: usize, arriving: Rgb, accepted: Rgb) {
        self.rows.resize(self.len, OutsideRow::default());
        self.rows[i].arriving += arriving;
        self.rows[i].accepted += accepted;
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// True if it is of `patches` patches; what a file holds may be of none.
    pub fn fits(&self, patches: usize) -> bool {
        self.len == patches && (self.rows.is_empty() || self.rows.len() == patches)
    }

    /// Row i is open by the share `open`, where rays had measured `measured`: what they saw there counts in proportion.
    pub fn set_open_share(&mut self, i: usize, measured: f64, open: f64) {
        let factor = if measured > 0.0 { open / measured } else { 0.0 };
        if let Some(row) = self.rows.get_mut(i) {
            row.escaped = row.escaped.map(|share| (f64::from(share) * factor).min(1.0) as f32);
        }
    }

    fn row(&self, i: usize) -> OutsideRow {
        self.rows.get(i).copied().unwrap_or_default()
    }

    /// Mean radiance [W/(m² sr)] over the rays of row i that comes from emitters without reflection by a patch, except what row i sees
    /// directly of glowing patches: from the surroundings, and by way of specular and glossy surfaces.
    #[inline]
    pub fn arriving(&self, i: usize) -> Rgb {
        self.row(i).arriving
    }

    /// [`Self::arriving`] weighted by what the diffuse part of the patch makes of each direction, over its mean.
    #[inline]
    pub fn accepted(&self, i: usize) -> Rgb {
        self.row(i).accepted
    }

    /// As [`OutsideRow::arriving_again`].
    #[inline]
    pub fn arriving_again(&self, i: usize) -> Rgb {
        self.row(i).arriving_again
    }

    /// Share of row i that leaves the scene.
    #[inline]
    pub fn escaped(&self, i: usize) -> Rgb {
        self.row(i).escaped.into()
    }

    /// Share of row i that the limit of specular events cut.
    #[inline]
    pub fn truncated(&self, i: usize) -> Rgb {
        self.row(i).truncated.into()
    }

    /// As [`OutsideRow::passed_out`].
    #[inline]
    pub fn passed_out(&self, i: usize) -> Rgb {
        self.row(i).passed_out.into()
    }

    /// As [`OutsideRow::passed_on`].
    #[inline]
    pub fn passed_on(&self, i: usize) -> Rgb {
        self.row(i).passed_on.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_nothing_take_no_place_until_one_holds_something() {
        let mut outside = Outside::default();
        outside.push(OutsideRow::default());
        outside.push(OutsideRow::default());
        assert!(outside.rows.is_empty() && outside.fits(2) && !outside.fits(3));
        outside.push(OutsideRow { escaped: [0.25; 3], ..OutsideRow::default() });
        outside.push(OutsideRow::default());
        let escaped: Vec<f64> = (0..4).map(|i| outside.escaped(i).g).collect();
        assert_eq!((escaped, outside.fits(4)), (vec![0.0, 0.0, 0.25, 0.0], true));
    }
}
