//! What bidirectional walks leave to chains: of each contribution a share that grows with its brightness beside the picture's around it, so
//! that chains find what walks find rarely. The weights are those of [Kelemen02], section 4, but for the walks, which are
//! connected in all ways at once and so make more of their rays than independent states of a chain, each made in one way.
//!
//! Both sides compute the same share of the same contribution, so nothing is lost, whatever the shares.

use crate::film::PixelSample;
use crate::integrator::Frame;
use crate::math::{Rgb, Vec2};
use serde::{Deserialize, Serialize};

/// Pixels along each side of a tile.
const TILE: usize = 16;
/// No tile is taken to be darker than this share of the picture's mean.
const DARKEST: f64 = 0.05;
/// Chains want nothing more than this many times what is as bright as the picture around: where nothing near is as bright, a chain stays for
/// as many steps, and then brings more to one pixel than a single sample would.
const MOST: f64 = 200.0;

/// Edges of the shortest paths that are shared.
pub const SHORTEST: u32 = 3;
/// Edges of the longest.
pub const LONGEST: u32 = 32;
/// Ratio of the probabilities of path lengths that follow each other, where nothing is known.
const LENGTH_RATIO: f64 = 0.7;
/// Share of the ways drawn as if nothing were known.
const UNKNOWN: f64 = 0.25;

/// Index of the way to make a path of `edges` with `of_lamp` vertices from the lamp, the point on it included; `None`: never shared.
#[inline]
fn way(edges: u32, of_lamp: u32) -> Option<usize> {
    // Ways of all shorter paths: 4 + 5 + ..., n + 1 for those of n edges.
    (SHORTEST..=LONGEST).contains(&edges).then(|| ((edges * (edges + 1) - SHORTEST * (SHORTEST + 1)) / 2 + of_lamp) as usize)
}

/// How many ways there are.
const WAYS: usize = ((LONGEST + 1) * (LONGEST + 2) - SHORTEST * (SHORTEST + 1)) as usize / 2;

/// Which ways to make a path bring how much.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ways {
    brought: Vec<f64>,
}

impl Default for Ways {
    fn default() -> Self {
        Self { brought: vec![0.0; WAYS] }
    }
}

impl Ways {
    /// Adds what one path brings, as a luminance.
    #[inline]
    pub fn add(&mut self, edges: u32, of_lamp: u32, luminance: f64) {
        if let Some(way) = way(edges, of_lamp) {
            self.brought[way] += luminance;
        }
    }

    /// Adds what others have seen.
    pub fn merge(&mut self, other: &Ways) {
        self.brought.iter_mut().zip(&other.brought).for_each(|(sum, b)| *sum += b);
    }

    /// Probabilities to draw them with, for paths of `limit` edges at most.
    pub fn chances(&self, limit: u32) -> WayChances {
        let total: f64 = self.brought.iter().sum();
        let longest = limit.min(LONGEST);
        let whole = 1.0 - LENGTH_RATIO.powi((longest + 1).saturating_sub(SHORTEST) as i32);
        let mut running = Vec::with_capacity(WAYS);
        let mut so_far = 0.0;
        for edges in SHORTEST..=longest {
            let of_length = (1.0 - LENGTH_RATIO) * LENGTH_RATIO.powi((edges - SHORTEST) as i32) / whole;
            for of_lamp in 0..=edges {
                let known = if total > 0.0 { way(edges, of_lamp).map_or(0.0, |w| self.brought[w]) / total } else { 0.0 };
                let unknown = if total > 0.0 { UNKNOWN } else { 1.0 };
                so_far += unknown * of_length / f64::from(edges + 1) + (1.0 - unknown) * known;
                running.push(so_far);
            }
        }
        WayChances { running }
    }
}

/// Probabilities of ways to make paths.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WayChances {
    running: Vec<f64>,
}

impl WayChances {
    /// Edges, vertices from the lamp and probability of the way that `u` in [0, 1) stands for.
    pub fn pick(&self, u: f64) -> (u32, u32, f64) {
        let last = self.running.len() - 1;
        let total = self.running[last];
        let index = self.running.partition_point(|&r| r <= u * total).min(last);
        let before = if index == 0 { 0.0 } else { self.running[index - 1] };
        let (mut edges, mut of_lamp) = (SHORTEST, index as u32);
        while of_lamp > edges {
            of_lamp -= edges + 1;
            edges += 1;
        }
        (edges, of_lamp, (self.running[index] - before) / total)
    }

    /// Probability of the way to make a path of `edges` with `of_lamp` vertices from the lamp; 0 if it is never shared.
    #[inline]
    fn of(&self, edges: u32, of_lamp: u32) -> f64 {
        let Some(index) = way(edges, of_lamp).filter(|&index| index < self.running.len()) else { return 0.0 };
        let before = if index == 0 { 0.0 } else { self.running[index - 1] };
        (self.running[index] - before) / self.running[self.running.len() - 1]
    }
}

/// Rough brightness of the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RoughPicture {
    /// Left and top of the part that is rendered [pixels], tiles in a row.
    left: usize,
    top: usize,
    columns: usize,
    /// 1 over the luminance of each tile.
    per_luminance: Vec<f64>,
}

impl RoughPicture {
    /// From one pass over `frame`; `None` if that is black.
    pub fn new(frame: &Frame, samples: &[PixelSample]) -> Option<Self> {
        let [left, top, width, height] = frame.crop;
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let mut sums = vec![(0.0, 0.0); columns * rows];
        // What shines there many times the mean says nothing of its tile.
        let mean = samples.iter().map(|s| s.radiance().luminance()).sum::<f64>() / samples.len().max(1) as f64;
        for (i, sample) in samples.iter().enumerate() {
            let tile = &mut sums[i / width / TILE * columns + i % width / TILE];
            *tile = (tile.0 + sample.radiance().luminance().min(100.0 * mean), tile.1 + 1.0);
        }
        let least = DARKEST * mean;
        (mean > 0.0 && mean.is_finite()).then(|| Self {
            left,
            top,
            columns,
            per_luminance: sums.iter().map(|(sum, n)| 1.0 / (sum / n).max(least)).collect(),
        })
    }

    /// Luminance of light at a point of the whole film [pixels], over that of the picture there.
    #[inline]
    fn relative(&self, film_point: Vec2, light: Rgb) -> f64 {
        let column = (film_point.x as usize).saturating_sub(self.left) / TILE;
        let row = (film_point.y as usize).saturating_sub(self.top) / TILE;
        let tile = (row * self.columns + column.min(self.columns - 1)).min(self.per_luminance.len() - 1);
        light.luminance() * self.per_luminance[tile]
    }
}

/// How chains and bidirectional walks share what both find.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Sharing {
    rough: RoughPicture,
    /// Ways to make paths, as chains draw them.
    pub chances: WayChances,
    even: f64,
}

/// What chains have of a contribution.
#[derive(Debug, Clone, Copy)]
pub struct Left {
    /// Their share of the light.
    pub share: f64,
    /// Probability of its way.
    pub chance: f64,
    /// How much they want it: what the density of their states is in proportion to.
    pub wanted: f64,
}

impl Sharing {
    /// By one pass over `frame`, in which `ways` brought light to `samples`; what is `even` times as bright as the picture around is shared
    /// evenly. `None` if the pass is black.
    pub fn new(frame: &Frame, samples: &[PixelSample], ways: &Ways, (limit, even): (u32, f64)) -> Option<Self> {
        let rough = RoughPicture::new(frame, samples)?;
        Some(Self { rough, chances: ways.chances(limit), even })
    }

    /// What chains have of light that a path of `edges` with `of_lamp` vertices from the lamp brings by itself to the pixel around
    /// `film_point`.
    #[inline]
    pub fn of(&self, film_point: Vec2, (edges, of_lamp): (u32, u32), light: Rgb) -> Option<Left> {
        let chance = self.chances.of(edges, of_lamp);
        if chance <= 0.0 {
            return None;
        }
        let relative = self.rough.relative(film_point, light);
        let bright = relative / (1.0 + relative / (MOST * chance));
        Some(Left { share: bright / (bright + self.even), chance, wanted: bright / chance })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ways() -> Ways {
        let mut ways = Ways::default();
        [(3, 0, 2.0), (3, 3, 1.0), (5, 2, 4.0), (LONGEST, LONGEST, 1.0), (LONGEST + 1, 0, 9.0)]
            .iter()
            .for_each(|&(edges, of_lamp, brought)| ways.add(edges, of_lamp, brought));
        ways
    }

    /// Evenly spread numbers draw each way as often as its probability says, no path is longer than the limit, and every way may come.
    #[test]
    fn ways_are_drawn_as_often_as_their_chances_say() {
        for (ways, limit) in [(ways(), 512), (ways(), 5), (Ways::default(), 7)] {
            let chances = ways.chances(limit);
            let n = 400_000;
            let mut drawn = Ways::default();
            for i in 0..n {
                let (edges, of_lamp, chance) = chances.pick((f64::from(i) + 0.5) / f64::from(n));
                assert!(
                    (SHORTEST..=limit.min(LONGEST)).contains(&edges) && of_lamp <= edges,
                    "{edges} edges, {of_lamp} from the lamp"
                );
                assert_eq!(chance, chances.of(edges, of_lamp));
                drawn.add(edges, of_lamp, 1.0 / f64::from(n));
            }
            let mut total = 0.0;
            for edges in 0..LONGEST + 8 {
                for of_lamp in 0..=edges {
                    let chance = chances.of(edges, of_lamp);
                    assert_eq!(
                        chance > 0.0,
                        (SHORTEST..=limit.min(LONGEST)).contains(&edges),
                        "{edges} edges, {of_lamp} from the lamp"
                    );
                    let got = way(edges, of_lamp).map_or(0.0, |w| drawn.brought[w]);
                    assert!(
                        (got - chance).abs() < 2.0 / f64::from(n),
                        "{edges} edges, {of_lamp} from the lamp: {got} for {chance}"
                    );
                    total += chance;
                }
            }
            assert!((total - 1.0).abs() < 1e-12, "{total}");
        }
    }

    /// The brighter beside the picture around, the more is left; and what is wanted has a bound.
    #[test]
    fn what_is_bright_is_left() {
        let frame = Frame::whole(64, 16);
        let mut samples = vec![PixelSample::default(); frame.n_pixels()];
        for (i, sample) in samples.iter_mut().enumerate() {
            *sample.layer(crate::film::Quantity::Direct) = Rgb::grey(if i % 64 < 32 { 1.0 } else { 4.0 });
        }
        let sharing = Sharing::new(&frame, &samples, &ways(), (16, 8.0)).expect("not black");
        let of = |x: f32, light: f64| sharing.of(Vec2::new(x, 3.0), (5, 2), Rgb::grey(light)).expect("shared");
        let shares = [0.1, 1.0, 10.0, 100.0].map(|light| of(5.0, light).share);
        assert!(shares.is_sorted() && shares[0] > 0.0 && shares[3] < 1.0, "{shares:?}");
        assert!((of(5.0, 2.0).share - of(60.0, 8.0).share).abs() < 1e-12, "four times as bright beside four times as much");
        assert!(of(5.0, 1e12).wanted <= MOST);
        assert!(sharing.of(Vec2::ZERO, (2, 1), Rgb::WHITE).is_none(), "short paths are no part of it");
        assert!(Sharing::new(&frame, &vec![PixelSample::default(); 1024], &ways(), (16, 8.0)).is_none());
    }
}
