//! Spheres by the cells they overlap, in a grid for each power of two of their size.

use crate::math::{Vec3, sampler::mix};
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::ops::ControlFlow;

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
type Cells = HashMap<u64, Vec<Sphere>, BuildHasherDefault<Mixed>>;

/// What is looked at of a sphere before the sphere itself: most that overlap a cell do not contain the point asked for, and these lie one
/// after the other in memory.
#[derive(Debug, Clone, Copy)]
struct Sphere {
    center: Vec3,
    /// Squared radius, not less than it is.
    radius2: f32,
    index: u32,
}

/// Indices of spheres by place.
#[derive(Debug, Default)]
pub struct Grid {
    /// Few, in no order that matters.
    levels: Vec<Level>,
}

#[derive(Debug)]
struct Level {
    /// Exponent of the cell size.
    exponent: i32,
    /// One over the cell size.
    scale: f32,
    cells: Cells,
}

impl Grid {
    /// Adds sphere `index`.
    pub fn insert(&mut self, index: u32, center: Vec3, radius: f32) {
        // Cells as wide as the sphere: it overlaps eight at most.
        let exponent = (2.0 * radius).log2().ceil() as i32;
        let known = self.levels.iter().position(|level| level.exponent == exponent);
        let at = known.unwrap_or(self.levels.len());
        if known.is_none() {
            self.levels.push(Level { exponent, scale: (-exponent as f32).exp2(), cells: Cells::default() });
        }
        let Level { scale, cells, .. } = &mut self.levels[at];
        let low = cell_of(center - radius, *scale);
        let high = cell_of(center + radius, *scale);
        let sphere = Sphere { center, radius2: radius * radius * (1.0 + 16.0 * f32::EPSILON), index };
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    cells.entry(key([x, y, z])).or_default().push(sphere);
                }
            }
        }
    }

    /// Where among the levels [`Self::visit`] comes to spheres of a radius.
    pub fn level_of(&self, radius: f32) -> usize {
        let exponent = (2.0 * radius).log2().ceil() as i32;
        self.levels.iter().position(|level| level.exponent == exponent).unwrap_or(self.levels.len())
    }

    /// Visits the spheres that may contain `point`, always in the same order, until `visit` breaks.
    #[inline]
    pub fn visit(&self, point: Vec3, mut visit: impl FnMut(u32) -> ControlFlow<()>) {
        for level in &self.levels {
            let Some(found) = level.cells.get(&key(cell_of(point, level.scale))) else { continue };
            for sphere in found {
                if sphere.center.distance_squared(point) <= sphere.radius2 && visit(sphere.index).is_break() {
                    return;
                }
            }
        }
    }
}

/// Coordinates of the cell of a point.
#[inline]
fn cell_of(point: Vec3, scale: f32) -> [i64; 3] {
    // Rounded down without a call of the mathematical library, which the plain instruction set would need.
    (point * scale).to_array().map(|v| v as i64 - i64::from(v < v as i64 as f32))
}

#[inline]
fn key([x, y, z]: [i64; 3]) -> u64 {
    mix((x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ mix((y as u64) ^ mix(z as u64)))
}
