//! Spheres by the cells they overlap, in a grid for each power of two of their size.

use crate::math::{Vec3, sampler::mix};
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Keys are mixed already.
#[derive(Debug, Default, Clone)]
pub struct Mixed(u64);

impl Hasher for Mixed {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|b| self.0 = mix(self.0 ^ u64::from(*b)));
    }

    fn write_u64(&mut self, value: u64) {
        self.0 = value;
    }
}

/// One grid: cells by a hash of their coordinates. Two cells that share a hash only cost a look at more spheres.
type Cells = HashMap<u64, Vec<u32>, BuildHasherDefault<Mixed>>;

/// Indices of spheres by place.
#[derive(Debug, Default)]
pub struct Grid {
    /// Exponent of the cell size, and the cells; few, in no order that matters.
    levels: Vec<(i32, Cells)>,
}

impl Grid {
    /// Adds sphere `index`.
    pub fn insert(&mut self, index: u32, center: Vec3, radius: f32) {
        // Cells as wide as the sphere: it overlaps eight at most.
        let exponent = (2.0 * radius).log2().ceil() as i32;
        let level = match self.levels.iter().position(|(e, _)| *e == exponent) {
            Some(level) => level,
            None => {
                self.levels.push((exponent, Cells::default()));
                self.levels.len() - 1
            }
        };
        let cells = &mut self.levels[level].1;
        let scale = (-exponent as f32).exp2();
        let low = ((center - radius) * scale).floor();
        let high = ((center + radius) * scale).floor();
        for x in low.x as i64..=high.x as i64 {
            for y in low.y as i64..=high.y as i64 {
                for z in low.z as i64..=high.z as i64 {
                    cells.entry(key(x, y, z)).or_default().push(index);
                }
            }
        }
    }

    /// Visits all spheres that may contain `point`, always in the same order.
    #[inline]
    pub fn visit(&self, point: Vec3, mut visit: impl FnMut(u32)) {
        for (exponent, cells) in &self.levels {
            let cell = (point * (-*exponent as f32).exp2()).floor();
            if let Some(found) = cells.get(&key(cell.x as i64, cell.y as i64, cell.z as i64)) {
                found.iter().for_each(|index| visit(*index));
            }
        }
    }
}

#[inline]
fn key(x: i64, y: i64, z: i64) -> u64 {
    mix((x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ mix((y as u64) ^ mix(z as u64)))
}
