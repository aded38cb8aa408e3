//! Radiosity between the patches: a smooth function through the values at their middles, for pictures of pass one alone.
//!
//! The classic way averages patches at the vertices that they share and interpolates linearly in each [Cohen85]. Patches that
//! were cut and grouped share few vertices, so the same is done without a mesh: at each point a plane is fitted to the values of the
//! patches around it (moving least squares, [Lancaster81]). Patches count only on the same shape, on the same side of a crease, and as far
//! as nothing stands between them. Each counts within a radius of its own size and its weight falls to nothing there, so that the function
//! has no steps where patches of different sizes meet, whatever vertices they share.

use super::RadiosityField;
use crate::geometry::Ray;
use crate::math::{Frame, Rgb, Vec3};
use crate::world::{SurfaceInteraction, World};
use rayon::prelude::*;
use std::collections::HashMap;

/// Radius around its middle in which a patch counts, in its own size: four to nine of them do at a point.
const RADIUS: f32 = 1.6;
/// Edge of the cells in which neighbours are looked for, in patch sizes: no less than the reach of a patch into one of its size or smaller.
const CELL: f32 = RADIUS + 0.75;
/// Cosine of the sharpest bend that is no crease: 25 degrees.
const CREASE: f32 = 0.9;
/// Height above the surface at which two patches must see each other, in patch sizes.
const HEIGHT: f32 = 0.02;
/// Fits whose points lie on a line closer than this (relative determinant) are means instead.
const THINNEST: f64 = 1e-3;

/// Which patches each patch shares its values with.
pub struct Interpolation {
    neighbours: Vec<Vec<u32>>,
    /// Edge of the cell that each patch was cut from [m].
    size: Vec<f32>,
}

/// Cells of patches of one size: their level, place and shape.
type Cell = (u8, [i32; 3], usize);

impl Interpolation {
    /// Finds neighbours: on the same shape, of about the same normal, in sight of each other.
    pub fn new(world: &World, field: &RadiosityField) -> Self {
        let patches = &field.patches;
        let size: Vec<f32> = (0..patches.len()).map(|i| patches.cell_size(i) as f32).collect();
        let of_level = |level: u8| patches.patch_size as f32 / (1_u32 << level) as f32;
        let cell = |p: Vec3, level: u8| (p / (CELL * of_level(level))).floor().as_ivec3().to_array();
        let mut cells: HashMap<Cell, Vec<u32>> = HashMap::new();
        let shapes: Vec<usize> = patches.shapes(world);
        for (i, (centroid, shape)) in patches.centroid.iter().zip(&shapes).enumerate() {
            let level = patches.level(i);
            cells.entry((level, cell(*centroid, level), *shape)).or_default().push(i as u32);
        }
        let above = |i: usize| patches.centroid[i] + patches.normal[i] * (HEIGHT * size[i]);
        // Patch j counts within its radius; a point lies at most a patch's diagonal from its middle.
        let is_reached = |i: usize, j: usize| {
            let reach = RADIUS * size[j] + 0.75 * size[i];
            patches.centroid[i].distance_squared(patches.centroid[j]) < reach * reach
        };
        // Where nothing hides a light nothing hides a patch either.
        let may_hide = world.needs().visibility;
        let together = |i: usize, j: usize| {
            (patches.level(j), i) < (patches.level(i), j)
                && (is_reached(i, j) || is_reached(j, i))
                && patches.normal[i].dot(patches.normal[j]) > CREASE
                && !(may_hide && world.occluded(&Ray::between(above(i), above(j))))
        };
        // Each pair is looked at once, from the smaller patch, or that of lower index.
        let of = |i: usize| {
            let mut near: Vec<u32> = Vec::new();
            for level in 0..=patches.level(i) {
                let [x, y, z] = cell(patches.centroid[i], level);
                let offsets = (0..27).map(|k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1]);
                let found = offsets.filter_map(|c| cells.get(&(level, c, shapes[i]))).flatten();
                near.extend(found.filter(|&&j| together(i, j as usize)));
            }
            near
        };
        let later: Vec<Vec<u32>> = (0..patches.len()).into_par_iter().map(of).collect();
        let mut neighbours: Vec<Vec<u32>> = (0..patches.len() as u32).map(|i| vec![i]).collect();
        for (i, later) in later.iter().enumerate() {
            for &j in later {
                let j = j as usize;
                if is_reached(i, j) {
                    neighbours[i].push(j as u32);
                }
                if is_reached(j, i) {
                    neighbours[j].push(i as u32);
                }
            }
        }
        Self { neighbours, size }
    }

    /// Irradiance [W/m²] at a surface point, as the diffuse part of its patch accepts it; zero where there is no patch.
    pub fn irradiance(&self, field: &RadiosityField, si: &SurfaceInteraction) -> Rgb {
        self.at(field, si, |i| field.accepted_of(i))
    }

    /// The same by everything but the lamps that shadow rays find.
    pub fn rest_irradiance(&self, field: &RadiosityField, si: &SurfaceInteraction) -> Rgb {
        self.at(field, si, |i| field.rest_of(i))
    }

    fn at(&self, field: &RadiosityField, si: &SurfaceInteraction, value: impl Fn(usize) -> Rgb) -> Rgb {
        let Some(here) = field.patches.patch_at(si).map(|id| id.0 as usize) else { return Rgb::BLACK };
        let sums = self.sums(field, (here, si.point, si.ng), &value, |_| true);
        let Some(found) = sums.at_origin() else { return value(here) };
        // A plane may overshoot beside a steep shadow; a mean never does.
        let own = value(here);
        let bound = |v: f64, own: f64, a: f64, b: f64| v.clamp(a.min(own), b.max(own));
        let (low, high) = (sums.low, sums.high);
        Rgb::new(bound(found.r, own.r, low.r, high.r), bound(found.g, own.g, low.g, high.g), bound(found.b, own.b, low.b, high.b))
    }

    /// By how much the irradiance of patch `i` differs from the plane through those around it [W/m²]; `None` where there are none. It is zero where
    /// irradiance is linear, the size of the step where it has one, and falls with the square of the patch size where it bends.
    pub fn bend(&self, field: &RadiosityField, i: usize) -> Option<Rgb> {
        let (point, normal) = (field.patches.centroid[i], field.patches.normal[i]);
        let sums = self.sums(field, (i, point, normal), &|j| field.accepted_of(j), |j| j != i);
        Some((field.accepted_of(i) - sums.at_origin()?).map(f64::abs))
    }

    /// Patches that share values with patch `i`.
    pub fn neighbours(&self, i: usize) -> &[u32] {
        &self.neighbours[i]
    }

    /// What the neighbours of patch `here` that `counts` lets through say around a point with a normal.
    fn sums(
        &self,
        field: &RadiosityField,
        (here, point, normal): (usize, Vec3, Vec3),
        value: &impl Fn(usize) -> Rgb,
        counts: impl Fn(usize) -> bool,
    ) -> Sums {
        let frame = Frame::new(normal);
        let mut sums = Sums::default();
        let unit = f64::from(self.size[here]);
        for j in self.neighbours[here].iter().map(|&j| j as usize).filter(|&j| counts(j)) {
            let offset = frame.to_local(field.patches.centroid[j] - point);
            let size = self.size[j];
            let x = 1.0 - offset.length_squared() / (RADIUS * RADIUS * size * size);
            if x <= 0.0 {
                continue;
            }
            // Slivers count by their share of their cell. Large patches reach in among small ones, which know more.
            let cell = f64::from(size / self.size[here]);
            let weight = f64::from(x * x) * field.patches.area[j] / (unit * unit * cell.powi(4));
            sums.add(weight, f64::from(offset.x) / unit, f64::from(offset.y) / unit, value(j));
        }
        sums
    }
}

/// Moments of weighted values over a tangent plane.
#[derive(Default)]
struct Sums {
    w: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    v: Rgb,
    vx: Rgb,
    vy: Rgb,
    /// Least and largest value by channel.
    low: Rgb,
    high: Rgb,
}

impl Sums {
    fn add(&mut self, w: f64, x: f64, y: f64, value: Rgb) {
        let by = |f: fn(f64, f64) -> f64, a: Rgb| Rgb::new(f(a.r, value.r), f(a.g, value.g), f(a.b, value.b));
        let first = self.w <= 0.0;
        (self.low, self.high) = if first { (value, value) } else { (by(f64::min, self.low), by(f64::max, self.high)) };
        self.w += w;
        self.x += w * x;
        self.y += w * y;
        self.xx += w * x * x;
        self.xy += w * x * y;
        self.yy += w * y * y;
        self.v += value * w;
        self.vx += value * (w * x);
        self.vy += value * (w * y);
    }

    /// Value at the origin of the plane that fits best; the mean where the points do not span one; `None` without any.
    fn at_origin(&self) -> Option<Rgb> {
        if self.w <= 0.0 {
            return None;
        }
        let mean = self.v / self.w;
        let (mx, my) = (self.x / self.w, self.y / self.w);
        let (cxx, cxy, cyy) = (self.xx / self.w - mx * mx, self.xy / self.w - mx * my, self.yy / self.w - my * my);
        let det = cxx * cyy - cxy * cxy;
        if det <= THINNEST * (cxx + cyy).powi(2) {
            return Some(mean);
        }
        let (cvx, cvy) = (self.vx / self.w - mean * mx, self.vy / self.w - mean * my);
        let slope_x = (cvx * cyy - cvy * cxy) / det;
        let slope_y = (cvy * cxx - cvx * cxy) / det;
        Some(mean - slope_x * mx - slope_y * my)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane through any points is found again, wherever they lie.
    #[test]
    fn a_linear_function_is_reproduced() {
        let value = |x: f64, y: f64| Rgb::new(2.0 + 0.5 * x - 0.25 * y, 1.0 - x, 3.0);
        let mut sums = Sums::default();
        for (w, x, y) in [(1.0, 0.3, 0.1), (0.5, -0.2, 0.7), (2.0, 0.8, 0.4), (0.7, 0.5, -0.6)] {
            sums.add(w, x, y, value(x, y));
        }
        let found = sums.at_origin().expect("there are points");
        let want = value(0.0, 0.0);
        assert!((found - want).map(f64::abs).max() < 1e-12, "{found:?}, expected {want:?}");
    }

    /// Points on a line say nothing across it: their mean is taken.
    #[test]
    fn points_on_a_line_give_their_mean() {
        let mut sums = Sums::default();
        sums.add(1.0, 0.1, 0.1, Rgb::grey(1.0));
        sums.add(1.0, 0.3, 0.3, Rgb::grey(2.0));
        assert_eq!(sums.at_origin().map(|v| v.r), Some(1.5));
        assert!(Sums::default().at_origin().is_none());
    }
}
