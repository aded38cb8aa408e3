//! Many samples of one key: what they have in common is found once, and Sobol numbers are put together from tables.
//!
//! The numbers are those of the crate `sobol_burley` ([Burley20]), bit for bit. Sobol numbers are linear over bits: that of an index is the
//! exclusive or of those of its four groups of four bits.

use sobol_burley::parts::{Int4, hash, hash_int4, owen_scramble_int4_rev, owen_scramble_rev, sobol_int4_rev};
use std::sync::LazyLock;

/// The crate's constants: what its seeds are mixed with for the order of the samples, and for the values in four dimensions.
const ORDER: u32 = 0x79c6_8e4a;
const VALUES: u32 = 0x9c8f_2d3b;
const DIMENSIONS: [u32; 4] = [0x912f_69ba, 0x174f_18ab, 0x691e_72ca, 0xb40c_c1b8];

/// By set of four dimensions, group of four bits of the reversed index from the top, and value of the group.
static TABLES: LazyLock<Vec<[[[u32; 4]; 16]; 4]>> = LazyLock::new(|| {
    let group = |set: u32, group: u32| std::array::from_fn(|bits| sobol_int4_rev((bits as u32) << (28 - 4 * group), set).into());
    (0..sobol_burley::NUM_DIMENSION_SETS_4D).map(|set| [0, 1, 2, 3].map(|g| group(set, g))).collect()
});

/// What all samples under one seed have in common in one set of four dimensions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scramble {
    order: u32,
    values: Int4,
    table: &'static [[[u32; 4]; 16]; 4],
}

impl Scramble {
    /// For a set of four dimensions that the crate has.
    #[inline]
    pub fn new(seed: u32, set: u32) -> Self {
        let seeds: Int4 = DIMENSIONS.map(|d| d ^ set ^ seed.wrapping_mul(VALUES)).into();
        Self { order: hash(seed ^ ORDER), values: hash_int4(seeds), table: &TABLES[set as usize] }
    }

    /// Four values of sample `index`, below 2^16.
    #[inline]
    pub fn sample(&self, index: u32) -> [f32; 4] {
        let reversed = owen_scramble_rev(index.reverse_bits(), self.order);
        let of = |group: usize| &self.table[group][(reversed >> (28 - 4 * group)) as usize & 15];
        let [a, b, c, d] = [of(0), of(1), of(2), of(3)];
        let sobol: [u32; 4] = std::array::from_fn(|k| (a[k] ^ b[k]) ^ (c[k] ^ d[k]));
        owen_scramble_int4_rev(sobol.into(), self.values).reverse_bits().to_f32_norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The crate itself says what its numbers are.
    #[test]
    fn tables_give_the_numbers_of_the_crate() {
        for seed in [0, 1, 0x9e37_79b9, u32::MAX] {
            for set in [0, 1, 7, 63] {
                let scramble = Scramble::new(seed, set);
                for index in (0..1000).chain((0..1 << 16).step_by(101)).chain([(1 << 16) - 1]) {
                    assert_eq!(scramble.sample(index), sobol_burley::sample_4d(index, set, seed), "{seed} {set} {index}");
                }
            }
        }
    }
}
