//! Records on flat walls: the same as by the grid, found by the place on the triangle, for scenes of which a plan knows that all is flat.
//!
//! A triangle is cut into cells of its barycentric square; each lists the records that may hold in it, in the order in which the grid
//! would visit them, so that sums have the same bits. Two points of a wall have one normal: nothing turns between them. Where the scene
//! is grey, one channel is read.

use super::{Cached, IrradianceCache, NORMAL_REACH, OVERLAP, Record};
use crate::geometry::triangle;
use crate::math::{Rgb, Vec3};
use crate::world::flat::FlatHit;
use crate::world::{Stages, World};

/// Where records times triangles of their shapes are more, the grid is used.
const MOST_PAIRS: usize = 1 << 22;
/// Most cells along the edge of a triangle.
const MOST_PER_EDGE: f64 = 512.0;
/// Spheres are taken wider than they are by this factor, for rounding.
const SLACK: f64 = 1.0 + 1e-4;

/// Records by triangle and place.
#[derive(Debug)]
pub(super) struct Tiles {
    /// By primitive: cells along an edge, and the index of the first.
    tiles: Vec<(f64, usize)>,
    /// Where the records of each cell begin.
    start: Vec<u32>,
    records: Vec<u32>,
    heads: Vec<Head>,
    /// One channel of each record, where that is all.
    grey: Vec<Grey>,
}

/// What tells whether a record holds.
#[derive(Debug, Clone, Copy)]
struct Head {
    point: Vec3,
    reach: f32,
    normal: Vec3,
    /// What the rounding of the product of the normal with itself leaves of a bend.
    bend: f32,
}

/// A record in one channel.
#[derive(Debug, Clone, Copy)]
struct Grey {
    irradiance: f64,
    emitted_share: f64,
    translation: Vec3,
}

impl IrradianceCache {
    /// Lays the records out for [`Self::read_on_flat`].
    pub(super) fn lay_out<K: Stages>(&mut self, world: &World) {
        self.tiles = Tiles::of::<K>(&self.records, |record| self.grid.level_of(record.reach * OVERLAP), world);
    }

    /// As [`Self::read`], at a hit of a flat wall at `point`.
    #[inline]
    pub(in crate::integrator) fn read_on_flat<K: Stages>(&self, hit: &FlatHit, point: Vec3) -> Option<Cached> {
        let Some(tiles) = &self.tiles else { return self.read(point, hit.normal, hit.shape) };
        let normal = hit.normal;
        let twice = normal + normal;
        let mut total = 0.0_f64;
        let (mut sum, mut emitted) = (Rgb::BLACK, Rgb::BLACK);
        let (mut grey_sum, mut grey_emitted) = (0.0, 0.0);
        for &index in tiles.at(hit) {
            let head = &tiles.heads[index as usize];
            let offset = point - head.point;
            let (square, reach) = (offset.length_squared(), OVERLAP * head.reach);
            if square > reach * reach * SLACK as f32 {
                continue;
            }
            let is_same = head.normal == normal;
            let distance = if is_same {
                if offset.dot(twice).abs() > 0.4 * head.reach {
                    continue;
                }
                square.sqrt() / head.reach + head.bend
            } else {
                self.records[index as usize].distance(point, normal)
            } / OVERLAP;
            if distance >= 1.0 {
                continue;
            }
            let weight = f64::from((1.0 - distance) * (1.0 - distance));
            if !K::COLOUR && is_same {
                let record = &tiles.grey[index as usize];
                let value = extrapolated(record.irradiance, record.translation.dot(offset)) * weight;
                grey_sum += value;
                grey_emitted += value * record.emitted_share;
            } else {
                let record = &self.records[index as usize];
                let value = if is_same { record.extrapolate_along(offset) } else { record.extrapolate(point, normal) } * weight;
                if K::COLOUR {
                    sum += value;
                    emitted += value * record.emitted_share;
                } else {
                    grey_sum += value.r;
                    grey_emitted += value.r * record.emitted_share.r;
                }
            }
            total += weight;
        }
        if !K::COLOUR {
            (sum, emitted) = (Rgb::grey(grey_sum), Rgb::grey(grey_emitted));
        }
        (total > 0.0).then(|| Cached { reflected: (sum - emitted) / total, emitted: emitted / total })
    }
}

/// Irradiance `change` away from where it was `irradiance`: as [`Record::extrapolate`].
#[inline]
fn extrapolated(irradiance: f64, change: f32) -> f64 {
    (irradiance + f64::from(change)).clamp(0.5 * irradiance, 2.0 * irradiance)
}

impl Record {
    /// As [`Self::extrapolate`] about the record's own normal.
    #[inline]
    fn extrapolate_along(&self, offset: Vec3) -> Rgb {
        let at = |e: f64, c: usize| extrapolated(e, self.translation[c].dot(offset));
        Rgb::new(at(self.irradiance.r, 0), at(self.irradiance.g, 1), at(self.irradiance.b, 2))
    }
}

impl Tiles {
    /// `None` where the grid does better.
    fn of<K: Stages>(records: &[Record], level_of: impl Fn(&Record) -> usize, world: &World) -> Option<Self> {
        let n = world.soup().triangles.len();
        let shapes = world.scene().shapes.len();
        let (mut on_shape, mut primitives) = (vec![0_usize; shapes], vec![Vec::new(); shapes]);
        records.iter().for_each(|r| on_shape[r.shape as usize] += 1);
        (0..n).for_each(|p| primitives[world.shape_index(p as u32)].push(p));
        let pairs: usize = on_shape.iter().zip(&primitives).map(|(records, primitives)| records * primitives.len()).sum();
        if pairs > MOST_PAIRS {
            return None;
        }
        let corners = |p: usize| world.soup().corners(p);
        let area = |p: usize| {
            let [a, b, c] = corners(p);
            triangle::area_vector(a, b, c).length()
        };
        let mut tiles = vec![(0.0, 0); n];
        let mut cells = 0;
        for (records, primitives) in on_shape.iter().zip(&primitives) {
            let whole: f64 = primitives.iter().map(|&p| area(p)).sum();
            for &p in primitives.iter().filter(|_| *records > 0) {
                // About as many cells in the triangle, half of the square, as it has records.
                let per_edge = (2.0 * *records as f64 * area(p) / whole).sqrt().ceil().clamp(1.0, MOST_PER_EDGE);
                tiles[p] = (per_edge, cells);
                cells += (per_edge * per_edge) as usize;
            }
        }
        // As the grid visits them: by level, then by age.
        let mut order: Vec<u32> = (0..records.len() as u32).collect();
        order.sort_by_key(|&i| level_of(&records[i as usize]));
        let mut held: Vec<(u32, u32)> = Vec::new();
        for index in order {
            let record = &records[index as usize];
            for &p in &primitives[record.shape as usize] {
                cells_held(record, corners(p), tiles[p], |cell| held.push((cell as u32, index)));
            }
        }
        let mut start = vec![0_u32; cells + 1];
        held.iter().for_each(|(cell, _)| start[*cell as usize + 1] += 1);
        (0..cells).for_each(|cell| start[cell + 1] += start[cell]);
        let mut next = start.clone();
        let mut sorted = vec![0; held.len()];
        for (cell, index) in held {
            sorted[next[cell as usize] as usize] = index;
            next[cell as usize] += 1;
        }
        let head = |r: &Record| Head {
            point: r.point,
            reach: r.reach,
            normal: r.normal,
            bend: (1.0 - r.normal.dot(r.normal)).max(0.0).sqrt() / NORMAL_REACH,
        };
        let grey =
            |r: &Record| Grey { irradiance: r.irradiance.r, emitted_share: r.emitted_share.r, translation: r.translation[0] };
        let grey = if K::COLOUR { Vec::new() } else { records.iter().map(grey).collect() };
        Some(Self { tiles, start, records: sorted, heads: records.iter().map(head).collect(), grey })
    }

    /// The records that may hold at a hit.
    #[inline]
    fn at(&self, hit: &FlatHit) -> &[u32] {
        let (per_edge, first) = self.tiles[hit.primitive as usize];
        let (u, v) = hit.place;
        let side = per_edge as usize;
        if side == 0 {
            return &[];
        }
        let cell = |x: f64| ((x * per_edge) as usize).min(side - 1);
        let cell = first + cell(v) * side + cell(u);
        &self.records[self.start[cell] as usize..self.start[cell + 1] as usize]
    }
}

/// Visits the cells of a triangle in which a record may hold: those that its sphere may reach.
fn cells_held(record: &Record, corners: [Vec3; 3], (per_edge, first): (f64, usize), mut visit: impl FnMut(usize)) {
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let (e1, e2, p) = (b - a, c - a, record.point.as_dvec3() - a);
    let n = e1.cross(e2);
    let radius = f64::from(record.reach) * f64::from(OVERLAP) * SLACK;
    if p.dot(n).abs() > radius * n.length() {
        return;
    }
    let square = n.length_squared();
    let (u, v) = (p.cross(e2).dot(n) / square, e1.cross(p).dot(n) / square);
    // Change of a weight with the point: the other edge over twice the area.
    let (du, dv) = (radius * e2.length() / n.length(), radius * e1.length() / n.length());
    let side = per_edge as usize;
    let range = |x: f64, d: f64| {
        let cell = |x: f64| ((x.max(0.0) * per_edge) as usize).min(side - 1);
        (x + d >= 0.0 && x - d <= 1.0).then(|| cell(x - d)..=cell(x + d)).into_iter().flatten()
    };
    // A cell is a parallelogram: its corners lie no further from its middle than half of its longer diagonal.
    let half = 0.5 * (e1 + e2).length().max((e1 - e2).length()) / per_edge;
    for row in range(v, dv) {
        for column in range(u, du) {
            let (x, y) = (column as f64 / per_edge, row as f64 / per_edge);
            let middle = e1 * (x + 0.5 / per_edge) + e2 * (y + 0.5 / per_edge);
            if x + y <= 1.0 + 1e-9 && (middle - p).length() <= radius + half * SLACK {
                visit(first + row * side + column);
            }
        }
    }
}
