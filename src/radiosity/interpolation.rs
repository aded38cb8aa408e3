//! Radiosity between the patches: a smooth function through the values at their middles, for pictures of pass one alone.
//!
//! The classic way averages patches at the vertices that they share and interpolates linearly in each [Cohen85]. Patches that
//! were cut and grouped share few vertices, so the same is done without a mesh: at each point a plane is fitted to the values of the
//! patches around it (moving least squares, [Lancaster81]). Patches count only on the same shape, on the same side of a crease, and as far
//! as nothing stands between them.

use super::RadiosityField;
use crate::geometry::Ray;
use crate::math::{Frame, Rgb, Vec3};
use crate::world::{SurfaceInteraction, World};
use rayon::prelude::*;
use std::collections::HashMap;

/// Radius around a point in which patches count, in patch sizes: four to nine of them.
const RADIUS: f32 = 1.6;
/// Cosine of the sharpest bend that is no crease: 25 degrees.
const CREASE: f32 = 0.9;
/// Height above the surface at which two patches must see each other, in patch sizes.
const HEIGHT: f32 = 0.02;
/// Fits whose points lie on a line closer than this (relative determinant) are means instead.
const THINNEST: f64 = 1e-3;

/// Which patches each patch shares its values with.
pub struct Interpolation {
    neighbours: Vec<Vec<u32>>,
    /// Radius in which patches count [m].
    radius: f32,
}

impl Interpolation {
    /// Finds neighbours: on the same shape, of about the same normal, in sight of each other.
    pub fn new(world: &World, field: &RadiosityField) -> Self {
        let patches = &field.patches;
        let size = patches.patch_size as f32;
        // A point lies at most a patch's diagonal from its middle.
        let (radius, reach) = (RADIUS * size, (RADIUS + 0.75) * size);
        let cell = |p: Vec3| (p / reach).floor().as_ivec3().to_array();
        let mut cells: HashMap<([i32; 3], usize), Vec<u32>> = HashMap::new();
        let shapes: Vec<usize> = patches.shapes(world);
        for (i, (centroid, shape)) in patches.centroid.iter().zip(&shapes).enumerate() {
            cells.entry((cell(*centroid), *shape)).or_default().push(i as u32);
        }
        let above = |i: usize| patches.centroid[i] + patches.normal[i] * (HEIGHT * size);
        let together = |i: usize, j: usize| {
            i == j
                || (patches.centroid[i].distance_squared(patches.centroid[j]) < reach * reach
                    && patches.normal[i].dot(patches.normal[j]) > CREASE
                    && !world.occluded(&Ray::between(above(i), above(j))))
        };
        let of = |i: usize| {
            let [x, y, z] = cell(patches.centroid[i]);
            let offsets = (0..27).map(|k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1]);
            let near = offsets.filter_map(|c| cells.get(&(c, shapes[i]))).flatten();
            near.copied().filter(|&j| together(i, j as usize)).collect()
        };
        Self { neighbours: (0..patches.len()).into_par_iter().map(of).collect(), radius }
    }

    /// Irradiance [W/m²] at a surface point, as the diffuse part of its patch accepts it; zero where there is no patch.
    pub fn irradiance(&self, field: &RadiosityField, si: &SurfaceInteraction) -> Rgb {
        let Some(here) = field.patches.patch_at(si).map(|id| id.0 as usize) else { return Rgb::BLACK };
        let frame = Frame::new(si.ng);
        let mut sums = Sums::default();
        let (mut low, mut high) = (field.accepted_of(here), field.accepted_of(here));
        for &j in &self.neighbours[here] {
            let offset = frame.to_local(field.patches.centroid[j as usize] - si.point);
            let x = 1.0 - offset.length_squared() / (self.radius * self.radius);
            if x <= 0.0 {
                continue;
            }
            let value = field.accepted_of(j as usize);
            let by = |f: fn(f64, f64) -> f64, a: Rgb| Rgb::new(f(a.r, value.r), f(a.g, value.g), f(a.b, value.b));
            (low, high) = (by(f64::min, low), by(f64::max, high));
            let weight = f64::from(x * x) * field.patches.area[j as usize];
            sums.add(weight, f64::from(offset.x) / f64::from(self.radius), f64::from(offset.y) / f64::from(self.radius), value);
        }
        let Some(found) = sums.at_origin() else { return field.accepted_of(here) };
        // A plane may overshoot beside a steep shadow; a mean never does.
        let bound = |v: f64, a: f64, b: f64| v.clamp(a, b);
        Rgb::new(bound(found.r, low.r, high.r), bound(found.g, low.g, high.g), bound(found.b, low.b, high.b))
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
}

impl Sums {
    fn add(&mut self, w: f64, x: f64, y: f64, value: Rgb) {
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
