//! What the row of a patch sees besides other patches: the outside, what was cut, and light that no patch has reflected.

use crate::math::Rgb;

/// By patch, whatever its form factors are kept as.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct Outside {
    escaped: Vec<[f32; 3]>,
    truncated: Vec<[f32; 3]>,
    arriving: Vec<Rgb>,
    accepted: Vec<Rgb>,
}

/// The same of one patch.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub struct OutsideRow {
    /// Share that leaves the scene, per channel (coloured by what it passed).
    pub escaped: [f32; 3],
    /// Share that was cut by the limit of specular events.
    pub truncated: [f32; 3],
    /// Mean radiance [W/(m² sr)] of emitters that are not seen directly.
    pub arriving: Rgb,
    /// The same, weighted by what the diffuse part of the patch makes of each direction.
    pub accepted: Rgb,
}

impl Outside {
    /// Adds the next patch.
    pub fn push(&mut self, row: OutsideRow) {
        self.escaped.push(row.escaped);
        self.truncated.push(row.truncated);
        self.arriving.push(row.arriving);
        self.accepted.push(row.accepted);
    }

    /// Adds mean radiance [W/(m² sr)] over the rays of row i, as it arrives and as the patch accepts it.
    pub fn add_arriving(&mut self, i: usize, arriving: Rgb, accepted: Rgb) {
        self.arriving[i] += arriving;
        self.accepted[i] += accepted;
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.escaped.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.escaped.is_empty()
    }

    /// Row i is open by the share `open`, where rays had measured `measured`: what they saw there counts in proportion.
    pub fn set_open_share(&mut self, i: usize, measured: f64, open: f64) {
        let factor = if measured > 0.0 { open / measured } else { 0.0 };
        self.escaped[i] = self.escaped[i].map(|share| (f64::from(share) * factor).min(1.0) as f32);
    }

    /// Mean radiance [W/(m² sr)] over the rays of row i that comes from emitters without reflection by a patch, except what row i sees
    /// directly of glowing patches: from the surroundings, and by way of specular and glossy surfaces.
    #[inline]
    pub fn arriving(&self, i: usize) -> Rgb {
        self.arriving[i]
    }

    /// [`Self::arriving`] weighted by what the diffuse part of the patch makes of each direction, over its mean.
    #[inline]
    pub fn accepted(&self, i: usize) -> Rgb {
        self.accepted[i]
    }

    /// Share of row i that leaves the scene.
    #[inline]
    pub fn escaped(&self, i: usize) -> Rgb {
        self.escaped[i].into()
    }

    /// Share of row i that the limit of specular events cut.
    #[inline]
    pub fn truncated(&self, i: usize) -> Rgb {
        self.truncated[i].into()
    }
}
