//! Records on flat walls: the same as by the grid, found by the place on the triangle, for scenes of which a plan knows that all is flat.
//!
//! A triangle is cut into cells of its barycentric square; each lists the records that may hold in it, in the order in which the grid
//! would visit them, so that sums have the same bits. Two points of a wall have one normal: nothing turns between them. Where the scene
//! is grey, one channel is read.

use super::{Cached, IrradianceCache, NORMAL_REACH, OVERLAP, Reading, Record, along};
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
    wall: Vec3,
    wall_distance: f32,
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
        let (mut reading, mut grey) = (Reading::default(), GreyReading::default());
        for &index in tiles.at(hit) {
            let head = &tiles.heads[index as usize];
            let offset = point - head.point;
            let (square, reach) = (offset.length_squared(), OVERLAP * head.reach);
            if square > reach * reach * SLACK as f32 {
                continue;
            }
            let is_same = head.normal == normal;
            let distance = if is_same {
                if offset.dot(twice).abs() > 0.4 * head.reach || offset.dot(head.wall) > head.wall_distance {
                    continue;
                }
                square.sqrt() / head.reach + head.bend
            } else {
                self.records[index as usize].distance(point, normal)
            } / OVERLAP;
            if distance >= 1.0 {
                continue;
            }
            if !K::COLOUR && is_same {
                grey.add(&tiles.grey[index as usize], distance, offset);
                continue;
            }
            let record = &self.records[index as usize];
            let turn = if is_same { Rgb::BLACK } else { record.turned(normal) };
            if K::COLOUR {
                reading.add(record, distance, offset, turn);
            } else {
                grey.add_turned(record, distance, offset, turn.r);
            }
        }
        if K::COLOUR { reading.cached() } else { grey.cached() }
    }
}

/// As [`Reading`], in one channel.
#[derive(Debug, Default)]
struct GreyReading {
    total: f64,
    sum: f64,
    emitted: f64,
    offset: Vec3,
    gradient: Vec3,
}

impl GreyReading {
    #[inline]
    fn add(&mut self, record: &Grey, distance: f32, offset: Vec3) {
        self.add_value(record, distance, offset, 0.0);
    }

    #[inline]
    fn add_turned(&mut self, record: &Record, distance: f32, offset: Vec3, turn: f64) {
        self.add_value(&Grey::of(record), distance, offset, turn);
    }

    #[inline]
    fn add_value(&mut self, record: &Grey, distance: f32, offset: Vec3, turn: f64) {
        let near = (1.0 - distance) * (1.0 - distance);
        let weight = f64::from(near);
        let value = along(record.irradiance, f64::from(0.5 * record.translation.dot(offset)) + turn) * weight;
        self.sum += value;
        self.emitted += value * record.emitted_share;
        self.offset += offset * near;
        self.gradient += record.translation * near;
        self.total += weight;
    }

    fn cached(self) -> Option<Cached> {
        let Self { total, sum, emitted, offset, gradient } = self;
        let grey = Reading { total, sum: Rgb::grey(sum), emitted: Rgb::grey(emitted), offset, gradient: [gradient; 3] };
        grey.cached()
    }
}

impl Grey {
    fn of(record: &Record) -> Self {
        Self { irradiance: record.irradiance.r, emitted_share: record.emitted_share.r, translation: record.translation[0] }
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
            wall: r.wall,
            wall_distance: r.wall_distance,
        };
        let grey = if K::COLOUR { Vec::new() } else { records.iter().map(Grey::of).collect() };
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
