//! Irradiance cache [Ward88]: the light that diffuse surfaces get from others varies slowly, so it is gathered at few points, with
//! its gradients [Ward92], and read between them.
//!
//! Differences to the classic: what is gathered is the radiosity of pass one, so one level of records is enough; a record tells the
//! irradiance as the diffuse part of its own shape accepts it, so it is read on that shape only; and a cache is made before the pass
//! that reads it and never changes while it is read, which makes pictures independent of threads.

mod bounces;
mod fill;
mod gather;
pub(super) mod grid;
mod tiles;

pub use bounces::{Below, BounceSettings};
pub use fill::FillSettings;
pub(super) use fill::Gap;

use crate::math::{Rgb, Vec3};
use grid::Grid;
use std::ops::ControlFlow;
use tiles::Tiles;

/// Records are read this many times as far as they keep others from being placed, so that several blend at every point.
const OVERLAP: f32 = 1.6;

/// Bend of the normal, as sqrt(1 - n.n'), that counts as much as a whole reach of distance.
const NORMAL_REACH: f32 = 0.3;

/// Irradiance at a point and how it changes around it.
#[derive(Debug, Clone)]
pub struct Record {
    /// The point.
    point: Vec3,
    /// Unit normal that the irradiance is about.
    normal: Vec3,
    /// Shape on which it holds.
    shape: u32,
    /// Distance up to which no other record is placed [m].
    reach: f32,
    /// Unit direction to the nearest wall within what the record is read up to: it does not hold beyond, where something else is seen.
    wall: Vec3,
    /// Distance of that wall [m]; infinite if there is none.
    wall_distance: f32,
    /// Irradiance as the diffuse part accepts it [W/m²].
    irradiance: Rgb,
    /// Share of it that comes from emitters that gather rays find, per channel.
    emitted_share: Rgb,
    /// Per channel: change with the point [W/m³].
    translation: [Vec3; 3],
    /// Per channel: change with the normal, about this axis [W/m² per radian].
    rotation: [Vec3; 3],
}

/// Irradiance read from a cache.
#[derive(Debug, Clone, Copy)]
pub struct Cached {
    /// By light that patches reflected [W/m²].
    pub reflected: Rgb,
    /// By emitters that gather rays find [W/m²].
    pub emitted: Rgb,
}

/// Records by where they hold.
#[derive(Debug, Default)]
pub struct IrradianceCache {
    records: Vec<Record>,
    grid: Grid,
    /// A shorter way to the same, once no record is added any more.
    tiles: Option<Tiles>,
}

impl IrradianceCache {
    /// Number of records.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// True if there are no records.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    fn insert(&mut self, record: Record) {
        let index = self.records.len() as u32;
        self.grid.insert(index, record.point, record.reach * OVERLAP);
        self.records.push(record);
    }

    /// True if a new record at a point would stand too close to another.
    fn covers(&self, point: Vec3, normal: Vec3, shape: u32) -> bool {
        let mut covered = false;
        self.grid.visit(point, |index| {
            let record = &self.records[index as usize];
            covered = record.shape == shape && record.distance(point, normal) < 1.0;
            if covered { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        covered
    }

    /// Irradiance at a point of a shape about a normal; `None` where no record reaches.
    pub fn read(&self, point: Vec3, normal: Vec3, shape: u32) -> Option<Cached> {
        let mut reading = Reading::default();
        self.grid.visit(point, |index| {
            let record = &self.records[index as usize];
            if record.shape != shape {
                return ControlFlow::Continue(());
            }
            let distance = record.distance(point, normal) / OVERLAP;
            if distance >= 1.0 {
                return ControlFlow::Continue(());
            }
            reading.add(record, distance, point - record.point, record.turned(normal));
            ControlFlow::Continue(())
        });
        reading.cached()
    }
}

/// Records blended at a point, with half of what each extrapolates and half of what their mean gradient makes of their mean offset.
///
/// With w_k the weights over their sum, d_k the offset of the point from record k and g_k the gradient there, what [Ward92] blends is
/// sum_k w_k (E_k + g_k d_k), whose error is half the second derivative along each d_k: tangents of a hill lie above it. That of the records alone
/// has the opposite sign. The mean of both is exact to second order where the records lie evenly around the point, and the mean gradient
/// makes up for where they do not: E = sum_k w_k (E_k + g_k d_k / 2) + (sum_k w_k g_k)(sum_k w_k d_k) / 2.
#[derive(Debug, Default)]
struct Reading {
    total: f64,
    sum: Rgb,
    emitted: Rgb,
    offset: Vec3,
    gradient: [Vec3; 3],
}

impl Reading {
    /// Adds a record at a distance, in units of what it is read up to, whose irradiance is `turn` more about the normal of the point.
    #[inline]
    fn add(&mut self, record: &Record, distance: f32, offset: Vec3, turn: Rgb) {
        let near = (1.0 - distance) * (1.0 - distance);
        let weight = f64::from(near);
        let value = record.halfway(offset, turn) * weight;
        self.sum += value;
        self.emitted += value * record.emitted_share;
        self.offset += offset * near;
        (0..3).for_each(|c| self.gradient[c] += record.translation[c] * near);
        self.total += weight;
    }

    fn cached(self) -> Option<Cached> {
        if self.total <= 0.0 {
            return None;
        }
        let by = 0.5 / (self.total * self.total);
        let part = |c: usize, sum: f64| {
            if sum > 0.0 {
                along(1.0, f64::from(self.gradient[c].dot(self.offset)) * by * self.total / sum) / self.total
            } else {
                0.0
            }
        };
        let share = Rgb::new(part(0, self.sum.r), part(1, self.sum.g), part(2, self.sum.b));
        Some(Cached { reflected: (self.sum - self.emitted) * share, emitted: self.emitted * share })
    }
}

/// Irradiance after a change: no less than half of what it was, no more than double.
#[inline]
fn along(irradiance: f64, change: f64) -> f64 {
    (irradiance + change).clamp(0.5 * irradiance, 2.0 * irradiance)
}

impl Record {
    /// How far a point is from the record, in units of its reach; infinite behind its surface and beyond a wall.
    #[inline]
    fn distance(&self, point: Vec3, normal: Vec3) -> f32 {
        let offset = point - self.point;
        let alike = self.normal.dot(normal);
        if alike <= 0.0 {
            return f32::INFINITY;
        }
        // A point in front of the record's surface sees less than it does, or more: its neighbours tell better.
        if offset.dot(self.normal + normal).abs() > 0.4 * self.reach || offset.dot(self.wall) > self.wall_distance {
            return f32::INFINITY;
        }
        offset.length() / self.reach + (1.0 - alike).max(0.0).sqrt() / NORMAL_REACH
    }

    /// How irradiance changes from the record's normal to another, by first order [Ward92].
    #[inline]
    fn turned(&self, normal: Vec3) -> Rgb {
        let turn = self.normal.cross(normal);
        Rgb::from(self.rotation.map(|by| f64::from(by.dot(turn))))
    }

    /// Irradiance with half of how it changes along an offset, by first order [Ward92], and all of how it changes with the normal.
    #[inline]
    fn halfway(&self, offset: Vec3, turn: Rgb) -> Rgb {
        let at = |e: f64, c: usize, turn: f64| along(e, f64::from(0.5 * self.translation[c].dot(offset)) + turn);
        Rgb::new(at(self.irradiance.r, 0, turn.r), at(self.irradiance.g, 1, turn.g), at(self.irradiance.b, 2, turn.b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cache of records at these places of a plane, with irradiance and gradient as given, read at the origin.
    fn read(places: &[[f32; 2]], irradiance: impl Fn([f32; 2]) -> f32, gradient: impl Fn([f32; 2]) -> [f32; 2]) -> f64 {
        let mut cache = IrradianceCache::default();
        for &[x, y] in places {
            let [gx, gy] = gradient([x, y]);
            cache.insert(Record {
                point: Vec3::new(x, y, 0.0),
                normal: Vec3::Z,
                shape: 0,
                reach: 1.0,
                wall: Vec3::ZERO,
                wall_distance: f32::INFINITY,
                irradiance: Rgb::grey(f64::from(irradiance([x, y]))),
                emitted_share: Rgb::grey(0.25),
                translation: [Vec3::new(gx, gy, 0.0); 3],
                rotation: [Vec3::ZERO; 3],
            });
        }
        let cached = cache.read(Vec3::ZERO, Vec3::Z, 0).unwrap();
        assert!((cached.emitted.g - (cached.emitted.g + cached.reflected.g) / 4.0).abs() < 1e-6);
        cached.reflected.g + cached.emitted.g
    }

    /// On a hill of light tangents lie above it, and the records themselves below its top.
    #[test]
    fn what_is_read_amid_records_is_exact_to_second_order() {
        let around = [[0.6, 0.0], [-0.6, 0.0], [0.0, 0.6], [0.0, -0.6]];
        let hill = |[x, y]: [f32; 2]| 4.0 - 1.5 * x * x - y * y + 0.5 * x * y + 0.3 * x;
        let slope = |[x, y]: [f32; 2]| [-3.0 * x + 0.5 * y + 0.3, -2.0 * y + 0.5 * x];
        assert!((read(&around, hill, slope) - 4.0).abs() < 1e-5, "{}", read(&around, hill, slope));
    }

    #[test]
    fn what_is_read_beside_records_is_exact_to_first_order() {
        let aside = [[0.6, 0.1], [0.2, 0.7], [-0.1, 0.3]];
        let plane = |[x, y]: [f32; 2]| 4.0 + 1.0 * x - 0.5 * y;
        assert!((read(&aside, plane, |_| [1.0, -0.5]) - 4.0).abs() < 1e-5, "{}", read(&aside, plane, |_| [1.0, -0.5]));
    }
}
