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
        let mut total = 0.0_f64;
        let (mut sum, mut emitted) = (Rgb::BLACK, Rgb::BLACK);
        self.grid.visit(point, |index| {
            let record = &self.records[index as usize];
            if record.shape != shape {
                return ControlFlow::Continue(());
            }
            let distance = record.distance(point, normal) / OVERLAP;
            if distance >= 1.0 {
                return ControlFlow::Continue(());
            }
            let weight = f64::from((1.0 - distance) * (1.0 - distance));
            let value = record.extrapolate(point, normal) * weight;
            sum += value;
            emitted += value * record.emitted_share;
            total += weight;
            ControlFlow::Continue(())
        });
        (total > 0.0).then(|| Cached { reflected: (sum - emitted) / total, emitted: emitted / total })
    }
}

impl Record {
    /// How far a point is from the record, in units of its reach; infinite behind its surface.
    #[inline]
    fn distance(&self, point: Vec3, normal: Vec3) -> f32 {
        let offset = point - self.point;
        let alike = self.normal.dot(normal);
        if alike <= 0.0 {
            return f32::INFINITY;
        }
        // A point in front of the record's surface sees less than it does, or more: its neighbours tell better.
        if offset.dot(self.normal + normal).abs() > 0.4 * self.reach {
            return f32::INFINITY;
        }
        offset.length() / self.reach + (1.0 - alike).max(0.0).sqrt() / NORMAL_REACH
    }

    /// Irradiance by first order [Ward92]; never negative, nor more than double.
    #[inline]
    fn extrapolate(&self, point: Vec3, normal: Vec3) -> Rgb {
        let offset = point - self.point;
        let turn = self.normal.cross(normal);
        let change = |c: usize| f64::from(self.translation[c].dot(offset) + self.rotation[c].dot(turn));
        let moved = self.irradiance + Rgb::new(change(0), change(1), change(2));
        let bound = |v: f64, e: f64| v.clamp(0.5 * e, 2.0 * e);
        Rgb::new(bound(moved.r, self.irradiance.r), bound(moved.g, self.irradiance.g), bound(moved.b, self.irradiance.b))
    }
}
