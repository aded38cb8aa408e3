//! Random numbers as a pure function of seed, pixel (or patch), sample index and dimension.
//!
//! By default Owen-scrambled Sobol points ([Burley20], crate `sobol_burley`). The crate has 2^16 samples and 256 dimensions; beyond either
//! border the scrambling seed is hashed anew, so that an independent scrambling of the same sequence goes on. [`SamplerKind::Independent`] is for comparisons with renderers that sample so.

use super::Vec2;
use super::series::Scramble;
use std::sync::Arc;

const SAMPLES: u32 = 1 << 16;
/// 2^64 over the golden ratio, odd: the step of SplitMix64.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
const SETS: u32 = sobol_burley::NUM_DIMENSION_SETS_4D;

/// How the samples of one key lie among each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SamplerKind {
    /// Stratified: Owen-scrambled Sobol points.
    #[default]
    Sobol,
    /// Independent of each other.
    Independent,
}

impl SamplerKind {
    /// All kinds, the default first.
    pub const ALL: [SamplerKind; 2] = [SamplerKind::Sobol, SamplerKind::Independent];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SamplerKind::Sobol => "sobol",
            SamplerKind::Independent => "independent",
        }
    }
}

/// Widest and narrowest step of a small change to a number, [Kelemen02], section 3.2.
const STEPS: [f32; 2] = [1.0 / 64.0, 1.0 / 1024.0];

/// How the numbers of a chain's next state come from those of its present one.
#[derive(Debug, Clone, Copy)]
pub enum Change {
    /// All anew.
    Large,
    /// Each moved a little.
    Small,
}

/// Numbers of a state that is proposed to a Markov chain: a pure function of the present state, the change and its seed.
#[derive(Debug, Clone)]
pub struct Proposal {
    /// Numbers of the present state; what lies beyond them is always new.
    pub present: Arc<[f32]>,
    /// The change.
    pub change: Change,
    /// Its seed.
    pub seed: u64,
}

impl Proposal {
    /// Number `i`.
    #[inline]
    pub fn value(&self, i: usize) -> f32 {
        let bits = mix(self.seed ^ mix((i as u64).wrapping_add(GOLDEN)));
        let uniform = |bits: u64| (bits & 0xff_ffff) as f32 * 2.0_f32.powi(-24);
        match (self.change, self.present.get(i)) {
            (Change::Small, Some(x)) => {
                // Exponentially distributed sizes, to both sides, around the circle.
                let size = STEPS[0] * ((STEPS[1] / STEPS[0]).ln() * uniform(bits >> 1)).exp();
                let moved = if bits >> 63 == 0 { x + size } else { x - size };
                let round = moved - moved.floor();
                if round < 1.0 { round } else { 0.0 }
            }
            _ => uniform(bits >> 1),
        }
    }

    /// The first numbers, as many as the present state holds: the state once it is accepted.
    pub fn accepted(&self) -> Arc<[f32]> {
        (0..self.present.len()).map(|i| self.value(i)).collect()
    }
}

/// A stream of sample values; two streams made from the same arguments give the same values on any machine and thread.
#[derive(Debug, Clone)]
pub struct Sampler {
    kind: SamplerKind,
    /// State of an independent stream.
    state: u64,
    seed: u32,
    index: u32,
    block: u32,
    set: u32,
    ready: [f32; 4],
    used: usize,
    /// Where the numbers come from instead, in a Markov chain.
    proposal: Option<Proposal>,
}

impl Sampler {
    /// Stream of sample `index` of item `key` (a pixel, a patch) under `seed`.
    ///
    /// Samples of one key are stratified among each other; different keys and seeds are independent.
    #[inline]
    pub fn new(seed: u64, key: u64, index: u64) -> Self {
        Self::of(SamplerKind::Sobol, seed, key, index)
    }

    /// As [`Sampler::new`], of either kind.
    #[inline]
    pub fn of(kind: SamplerKind, seed: u64, key: u64, index: u64) -> Self {
        let mixed = mix(seed ^ mix(key.wrapping_add(GOLDEN)));
        Self {
            kind,
            state: match kind {
                SamplerKind::Independent => mix(mixed ^ mix(index.wrapping_add(GOLDEN))),
                SamplerKind::Sobol => 0,
            },
            seed: (mixed ^ (mixed >> 32)) as u32,
            index: (index % u64::from(SAMPLES)) as u32,
            block: (index / u64::from(SAMPLES)) as u32,
            set: 0,
            ready: [0.0; 4],
            used: 4,
            proposal: None,
        }
    }

    /// The numbers of a state of a Markov chain, in order.
    pub fn of_chain(proposal: Proposal) -> Self {
        Self { proposal: Some(proposal), ..Self::of(SamplerKind::Independent, 0, 0, 0) }
    }

    /// Next value in [0, 1).
    #[inline]
    pub fn next_1d(&mut self) -> f32 {
        if self.used == 4 {
            self.refill();
        }
        self.used += 1;
        self.ready[self.used - 1]
    }

    /// Next point of the unit square; its two coordinates are always stratified together.
    #[inline]
    pub fn next_2d(&mut self) -> Vec2 {
        if self.used & 1 == 1 {
            self.used += 1;
        }
        if self.used == 4 {
            self.refill();
        }
        self.used += 2;
        Vec2::new(self.ready[self.used - 2], self.ready[self.used - 1])
    }

    fn refill(&mut self) {
        self.used = 0;
        if self.kind == SamplerKind::Independent {
            self.ready = match &self.proposal {
                Some(proposal) => [0, 1, 2, 3].map(|k| proposal.value(4 * self.set as usize + k)),
                None => self.independent(),
            };
            self.set += 1;
            return;
        }
        let round = self.set / SETS;
        let mut seed = self.seed;
        // Both borders: a new block of 2^16 samples or a new round of 256 dimensions is scrambled anew.
        if self.block != 0 || round != 0 {
            seed = mix(u64::from(seed) | (u64::from(self.block) << 32) ^ (u64::from(round) << 52)) as u32;
        }
        self.ready = Scramble::new(seed, self.set % SETS).sample(self.index);
        self.set += 1;
    }

    /// Four values of 24 bits by SplitMix64.
    #[inline]
    fn independent(&mut self) -> [f32; 4] {
        let mut two = || {
            self.state = self.state.wrapping_add(GOLDEN);
            let bits = mix(self.state);
            [bits >> 40, (bits >> 8) & 0xff_ffff].map(|b| b as f32 * 2.0_f32.powi(-24))
        };
        let ([a, b], [c, d]) = (two(), two());
        [a, b, c, d]
    }
}

/// The samples of one item: as [`Sampler::new`] gives them, one by one.
#[derive(Debug, Clone, Copy)]
pub struct Series {
    key: [u64; 2],
    seed: u32,
    first: Scramble,
}

impl Series {
    /// Of item `key` under `seed`.
    #[inline]
    pub fn new(seed: u64, key: u64) -> Self {
        let Sampler { seed: mixed, .. } = Sampler::new(seed, key, 0);
        Self { key: [seed, key], seed: mixed, first: Scramble::new(mixed, 0) }
    }

    /// Samples below this index share what [`Self::first_2d`] needs.
    pub const LEN: usize = SAMPLES as usize;

    /// The first two numbers of sample `index`, which must be below [`Self::LEN`].
    #[inline(always)]
    pub fn first_2d(&self, index: u32) -> [f32; 2] {
        let [x, y, ..] = self.first.sample(index);
        [x, y]
    }

    /// The stream of sample `index`.
    #[inline]
    pub fn sampler(&self, index: u64) -> Sampler {
        if index >= u64::from(SAMPLES) {
            return Sampler::new(self.key[0], self.key[1], index);
        }
        let index = index as u32;
        Sampler {
            kind: SamplerKind::Sobol,
            state: 0,
            seed: self.seed,
            index,
            block: 0,
            set: 1,
            ready: self.first.sample(index),
            used: 0,
            proposal: None,
        }
    }
}

/// A bijective mix of 64 bits (finaliser of SplitMix64, Steele et al. 2014).
#[inline]
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first_2d(key: u64, index: u64) -> Vec2 {
        Sampler::new(7, key, index).next_2d()
    }

    #[test]
    fn samples_of_one_key_are_stratified() {
        // A (0,2) sequence: every 256 consecutive samples put one point in each of the 16 x 16 cells.
        let mut cells = [0; 256];
        for index in 0..256 {
            let p = first_2d(3, index);
            cells[(p.x * 16.0) as usize + 16 * (p.y * 16.0) as usize] += 1;
        }
        assert_eq!(cells, [1; 256]);
    }

    #[test]
    fn the_sample_border_is_crossed_without_repeating() {
        let border = u64::from(SAMPLES);
        let before: Vec<Vec2> = (0..256).map(|i| first_2d(3, i)).collect();
        let after: Vec<Vec2> = (0..256).map(|i| first_2d(3, border + i)).collect();
        assert!(before.iter().zip(&after).all(|(a, b)| a != b), "the second block repeats the first");
        let mean = after.iter().fold(Vec2::ZERO, |sum, p| sum + *p) / 256.0;
        assert!((mean - Vec2::splat(0.5)).length() < 0.01, "mean past the border: {mean}");
    }

    #[test]
    fn the_dimension_border_is_crossed_without_repeating() {
        let mut correlation = 0.0;
        for index in 0..1024 {
            let mut sampler = Sampler::new(7, 3, index);
            let first = sampler.next_1d();
            (1..256).for_each(|_| {
                sampler.next_1d();
            });
            let past = sampler.next_1d();
            assert!((0.0..1.0).contains(&past), "{past}");
            correlation += (first - 0.5) * (past - 0.5);
        }
        assert!((correlation / 1024.0 / (1.0 / 12.0)).abs() < 0.1, "dimension 256 follows dimension 0: {correlation}");
    }

    #[test]
    fn a_series_gives_the_streams_of_its_samples() {
        let series = Series::new(7, 3);
        for index in [0, 1, 255, 65_535, 65_536, 1 << 40] {
            let (mut one, mut other) = (series.sampler(index), Sampler::new(7, 3, index));
            for _ in 0..300 {
                assert_eq!((one.next_1d(), one.next_2d()), (other.next_1d(), other.next_2d()), "sample {index}");
            }
        }
    }

    #[test]
    fn keys_and_seeds_give_other_points() {
        assert_ne!(first_2d(1, 0), first_2d(2, 0));
        assert_ne!(Sampler::new(1, 1, 0).next_1d(), Sampler::new(2, 1, 0).next_1d());
        assert_eq!(first_2d(9, 5), first_2d(9, 5));
    }

    /// Small steps are small and even to both sides; what is proposed does not depend on how it is read.
    #[test]
    fn a_chain_moves_each_number_a_little() {
        let present: Arc<[f32]> = [0.5_f32; 4096].into();
        let proposal = Proposal { present, change: Change::Small, seed: 5 };
        let accepted = proposal.accepted();
        let mut stream = Sampler::of_chain(proposal);
        let (mut up, mut n) = (0, 0);
        for x in accepted.iter() {
            assert_eq!(stream.next_1d(), *x);
            let step = (x - 0.5).abs();
            assert!((0.99 / 1024.0..=1.01 / 64.0).contains(&step), "a step of {step}");
            up += u32::from(*x > 0.5);
            n += 1;
        }
        // Four standard errors of a fair coin.
        assert!((f64::from(up) - 0.5 * f64::from(n)).abs() < 4.0 * 0.5 * f64::from(n).sqrt(), "{up} of {n} went up");
    }
}
