//! Closed rooms with exact form factors between many patches, in numbers alone: what solvers are measured on.

use crate::form_factor::FormFactors;
use crate::math::Rgb;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Form factors as full rows in f64.
#[derive(Debug, Clone)]
pub struct Dense {
    /// Number of patches.
    pub n: usize,
    /// F_ij by rows.
    pub factor: Vec<f64>,
}

impl FormFactors for Dense {
    fn len(&self) -> usize {
        self.n
    }

    fn gather(&self, x: &[Rgb], out: &mut [Rgb]) {
        let rows = self.factor.par_chunks(self.n.max(1));
        out.par_iter_mut().zip(rows).for_each(|(out, row)| *out = row.iter().zip(x).map(|(f, x)| *x * *f).sum());
    }

    fn gather_groups(&self, x: &[Rgb], group: &[u8], out: &mut [Vec<Rgb>]) -> u32 {
        for (i, row) in self.factor.chunks(self.n.max(1)).enumerate() {
            out.iter_mut().for_each(|out| out[i] = Rgb::BLACK);
            for ((f, x), g) in row.iter().zip(x).zip(group) {
                if let Some(out) = out.get_mut(usize::from(*g)) {
                    out[i] += *x * *f;
                }
            }
        }
        1
    }

    fn row(&self, i: usize, visit: &mut dyn FnMut(usize, Rgb)) {
        let row = &self.factor[i * self.n..(i + 1) * self.n];
        row.iter().enumerate().filter(|(_, f)| **f > 0.0).for_each(|(j, f)| visit(j, Rgb::grey(*f)));
    }

    fn is_reciprocal(&self) -> bool {
        true
    }
}

/// A closed room, or several.
#[derive(Debug, Clone)]
pub struct Enclosure {
    /// Areas [m²].
    pub area: Vec<f64>,
    /// Face of the cube that a patch lies on: 0 and 1 opposite in x, 2 and 3 in y, 4 and 5 in z.
    pub face: Vec<usize>,
    /// Room that a patch lies in.
    pub room: Vec<usize>,
    /// Exact form factors.
    pub form_factors: Dense,
}

/// The unit cube, `n` by `n` patches a face, with exact form factors.
///
/// Between rectangles of parallel or perpendicular sides A F is a second difference, in both coordinates, of an elementary function of the
/// distances of their corners (Howell's catalogue, C-13 and C-15).
pub fn cube(n: usize) -> Enclosure {
    let total = 6 * n * n;
    let side = 1.0 / n as f64;
    let patch = |i: usize| Patch { face: i / (n * n), cell: [i % n, i / n % n] };
    let row = |i: usize| (0..total).map(move |j| exchange(patch(i), patch(j), side) / (side * side));
    let factor: Vec<f64> = (0..total).into_par_iter().flat_map_iter(row).collect();
    Enclosure {
        area: vec![side * side; total],
        face: (0..total).map(|i| patch(i).face).collect(),
        room: vec![0; total],
        form_factors: Dense { n: total, factor },
    }
}

/// Cubes in a row, `n` by `n` patches a face, with doors between neighbours of `door` by `door` patches in the corner of the walls.
///
/// A door is frosted: what falls on a patch of it leaves the same patch of the other side in all directions. So the patches of doors can be
/// put out of the equations exactly, F_ij + sum_d F_id F_dj, and what is left is closed and reciprocal as the cube is.
pub fn rooms_in_a_row(rooms: usize, n: usize, door: usize) -> Enclosure {
    let one = cube(n);
    let cells = one.area.len();
    // Cells of the door in faces 0 (towards the room before) and 1 (towards the next): both count cells alike.
    let in_door = |cell: usize| (cell % (n * n)) % n < door && (cell % (n * n)) / n < door;
    let is_open = |room: usize, cell: usize| match cell / (n * n) {
        0 => room > 0 && in_door(cell),
        1 => room + 1 < rooms && in_door(cell),
        _ => false,
    };
    let kept: Vec<(usize, usize)> =
        (0..rooms).flat_map(|r| (0..cells).map(move |c| (r, c))).filter(|&(r, c)| !is_open(r, c)).collect();
    let total = kept.len();
    let f = |a: usize, b: usize| one.form_factors.factor[a * cells + b];
    let row = |&(room, cell): &(usize, usize)| {
        // What falls on patches of doors goes on into the next room, from door to door, until too little is left to count.
        let mut sent = vec![0.0; rooms * cells];
        let mut wave: Vec<((usize, usize), f64)> = vec![((room, cell), 1.0)];
        while !wave.is_empty() {
            let mut through = vec![0.0; rooms * cells];
            for ((r, c), power) in wave.drain(..) {
                for to in 0..cells {
                    let arrives = power * f(c, to);
                    if is_open(r, to) {
                        let (next, face) = if to / (n * n) == 0 { (r - 1, 1) } else { (r + 1, 0) };
                        through[next * cells + face * n * n + to % (n * n)] += arrives;
                    } else {
                        sent[r * cells + to] += arrives;
                    }
                }
            }
            wave = through.iter().enumerate().filter(|(_, p)| **p > 1e-18).map(|(i, p)| ((i / cells, i % cells), *p)).collect();
        }
        kept.iter().map(|&(r, c)| sent[r * cells + c]).collect::<Vec<f64>>()
    };
    let factor: Vec<f64> = kept.par_iter().flat_map_iter(row).collect();
    Enclosure {
        area: kept.iter().map(|&(_, c)| one.area[c]).collect(),
        face: kept.iter().map(|&(_, c)| one.face[c]).collect(),
        room: kept.iter().map(|&(r, _)| r).collect(),
        form_factors: Dense { n: total, factor },
    }
}

#[derive(Clone, Copy)]
struct Patch {
    face: usize,
    /// Along the two other axes, in rising order of them.
    cell: [usize; 2],
}

impl Patch {
    /// Extent along `axis`: a wall has none along its own.
    fn extent(self, axis: usize, side: f64) -> [f64; 2] {
        let own = self.face / 2;
        if axis == own {
            return [(self.face % 2) as f64; 2];
        }
        let rank = (0..axis).filter(|a| *a != own).count();
        [self.cell[rank] as f64 * side, (self.cell[rank] + 1) as f64 * side]
    }
}

/// A_i F_ij of two patches of the cube.
fn exchange(a: Patch, b: Patch, side: f64) -> f64 {
    let (own, other) = (a.face / 2, b.face / 2);
    if a.face == b.face {
        return 0.0;
    }
    if own == other {
        let [u, v] = match own {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        };
        return differences([a.extent(u, side), b.extent(u, side)], [a.extent(v, side), b.extent(v, side)], |p, q, x, y| {
            parallel(p - q, x - y, 1.0)
        });
    }
    // Distances from the common edge, and places along it.
    let along = 3 - own - other;
    let from = |extent: [f64; 2], wall: usize| if wall == 0 { extent } else { [1.0 - extent[1], 1.0 - extent[0]] };
    let (x, y) = (from(a.extent(other, side), b.face % 2), from(b.extent(own, side), a.face % 2));
    differences([a.extent(along, side), b.extent(along, side)], [x, y], |p, q, x, y| perpendicular(p - q, x, y))
}

/// The alternating sum over the ends of four extents.
fn differences([p, q]: [[f64; 2]; 2], [x, y]: [[f64; 2]; 2], g: impl Fn(f64, f64, f64, f64) -> f64) -> f64 {
    let mut sum = 0.0;
    for (i, j, k, l) in (0..16).map(|m| (m & 1, m >> 1 & 1, m >> 2 & 1, m >> 3)) {
        let sign = if (i + j + k + l) % 2 == 0 { 1.0 } else { -1.0 };
        sum += sign * g(p[i], q[j], x[k], y[l]);
    }
    // Rounding: what is nothing may come out below 0.
    sum.abs()
}

fn parallel(u: f64, v: f64, z: f64) -> f64 {
    let (a, b) = (u.hypot(z), v.hypot(z));
    (v * a * (v / a).atan() + u * b * (u / b).atan() - 0.5 * z * z * (u * u + v * v + z * z).ln()) / (2.0 * PI)
}

fn perpendicular(u: f64, x: f64, y: f64) -> f64 {
    let (c2, u2) = (x * x + y * y, u * u);
    let c = c2.sqrt();
    let arc = if c > 0.0 { u * c * (u / c).atan() } else { 0.0 };
    let log = if c2 + u2 > 0.0 { 0.25 * (c2 - u2) * (c2 + u2).ln() } else { 0.0 };
    (arc - log) / (2.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::form_factor::analytic::{parallel_rectangles, perpendicular_rectangles};

    #[test]
    fn patches_of_the_cube_close_and_add_up_to_its_faces() {
        let room = cube(5);
        let f = &room.form_factors;
        for i in 0..f.n {
            let sum: f64 = f.factor[i * f.n..(i + 1) * f.n].iter().sum();
            assert!((sum - 1.0).abs() < 1e-12, "row {i} sums to {sum}");
        }
        let between = |a: usize, b: usize| -> f64 {
            let pairs = (0..f.n).flat_map(|i| (0..f.n).map(move |j| (i, j)));
            pairs.filter(|&(i, j)| room.face[i] == a && room.face[j] == b).map(|(i, j)| f.factor[i * f.n + j]).sum::<f64>() / 25.0
        };
        let (opposite, adjacent) = (parallel_rectangles(1.0, 1.0, 1.0), perpendicular_rectangles(1.0, 1.0, 1.0));
        for (a, b, want) in
            [(0, 1, opposite), (2, 3, opposite), (5, 4, opposite), (0, 2, adjacent), (4, 1, adjacent), (3, 5, adjacent)]
        {
            assert!((between(a, b) - want).abs() < 1e-13, "{a} to {b}: {}, expected {want}", between(a, b));
        }
        // Two patches alone: the unit of length of the closed forms does not matter.
        let first = f.factor[25];
        assert!((first - parallel_rectangles(0.2, 0.2, 1.0)).abs() < 1e-12, "{first}");
    }

    #[test]
    fn rooms_with_doors_close_and_are_reciprocal() {
        let rooms = rooms_in_a_row(3, 4, 2);
        let f = &rooms.form_factors;
        assert_eq!(f.n, 3 * 96 - 4 * 4);
        for i in 0..f.n {
            let sum: f64 = f.factor[i * f.n..(i + 1) * f.n].iter().sum();
            assert!((sum - 1.0).abs() < 1e-12, "row {i} sums to {sum}");
            for j in 0..i {
                assert!((f.factor[i * f.n + j] - f.factor[j * f.n + i]).abs() < 1e-14, "{i} and {j}");
            }
        }
        let far = (0..f.n).filter(|&j| rooms.room[j] == 2).map(|j| f.factor[j]).sum::<f64>();
        assert!(far > 1e-4 && far < 0.1, "from the first room to the last: {far}");
    }
}
