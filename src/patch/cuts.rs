//! The lines along which other surfaces cross or touch a triangle.
//!
//! A patch that reaches from a lit room under a partition into a dark one would carry light through the wall: in a trial the error
//! of such a scene fell 54-fold when its patches were cut at the wall.

use super::subdivide::{Point, Polygon};
use crate::geometry::Bounds;
use crate::math::{DVec3, Vec3};
use crate::scene::ShapeSurface;
use crate::world::World;
use std::collections::HashSet;

/// Surfaces this near count as touching, relative to the scene's diagonal.
const TOUCH: f64 = 2e-5;
/// Segments on one line must add up to this many patch sizes to cut: the feet of a chair do not, a partition does.
const SHORTEST: f64 = 0.5;
/// More cuts than this through one triangle are not made; the longest are kept.
const MOST: usize = 96;

/// A line function a u + b v + c over barycentric coordinates.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Line {
    /// Factor of u.
    pub a: f64,
    /// Factor of v.
    pub b: f64,
    /// Constant.
    pub c: f64,
}

impl Line {
    /// Value at a point: zero on the line.
    #[inline]
    pub fn value(&self, p: Point) -> f64 {
        self.a * p[0] + self.b * p[1] + self.c
    }

    /// The function times `k`.
    pub fn scaled(&self, k: f64) -> Line {
        Line { a: self.a * k, b: self.b * k, c: self.c * k }
    }

    fn through(p: Point, q: Point) -> Line {
        let (a, b) = (q[1] - p[1], p[0] - q[0]);
        let length = a.hypot(b);
        let (a, b) = (a / length, b / length);
        Line { a, b, c: -(a * p[0] + b * p[1]) }
    }
}

/// A line that cuts, and the stretch of it on which something stands.
#[derive(Debug, Clone, Copy)]
pub struct Cut {
    /// The line.
    pub line: Line,
    /// One end.
    pub from: Point,
    /// The other end.
    pub to: Point,
    /// Length of what stands on it [m].
    pub length: f64,
}

impl Cut {
    /// True if the stretch itself, not only its line, runs through the inside of `polygon`.
    pub fn reaches_into(&self, polygon: &Polygon) -> bool {
        let (mut low, mut high) = (0.0_f64, 1.0_f64);
        for (i, &p) in polygon.iter().enumerate() {
            let q = polygon[(i + 1) % polygon.len()];
            // Inside is to the left of a counter-clockwise edge.
            let side = |x: Point| (q[0] - p[0]) * (x[1] - p[1]) - (q[1] - p[1]) * (x[0] - p[0]);
            let (d, e) = (side(self.from), side(self.to));
            if d < 0.0 && e < 0.0 {
                return false;
            }
            if d < 0.0 {
                low = low.max(d / (d - e));
            } else if e < 0.0 {
                high = high.min(d / (d - e));
            }
        }
        high - low > 1e-6
    }
}

/// The triangle's plane with coordinates both metric and barycentric.
struct Plane {
    origin: DVec3,
    normal: DVec3,
    /// Rows that turn p - origin into barycentric u and v.
    to_u: DVec3,
    to_v: DVec3,
}

impl Plane {
    fn new([a, b, c]: [Vec3; 3]) -> Self {
        let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
        let (e1, e2) = (b - a, c - a);
        let n = e1.cross(e2);
        let n2 = n.length_squared();
        Self { origin: a, normal: n / n2.sqrt(), to_u: e2.cross(n) / n2, to_v: n.cross(e1) / n2 }
    }

    fn barycentric(&self, p: DVec3) -> Point {
        let d = p - self.origin;
        [d.dot(self.to_u), d.dot(self.to_v)]
    }
}

/// Length of a triangle's longest edge.
pub fn longest_edge([a, b, c]: [Vec3; 3]) -> f64 {
    f64::from((b - a).length().max((c - b).length()).max((a - c).length()))
}

/// The surfaces that may cut.
pub struct Cutters {
    /// Triangles of each shape that is a mesh, with the shape's index.
    shapes: Vec<(usize, Vec<u32>)>,
}

impl Cutters {
    /// All triangles with an edge longer than `longer_than`; of those with the same corners, one.
    pub fn new(world: &World, longer_than: f64) -> Self {
        // What stands twice in the same place stands there once; and a file with one face thousands of times would otherwise take
        // time with the square of their number.
        let mut seen = HashSet::new();
        let mut is_new = |mut corners: [Vec3; 3]| {
            corners.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
            seen.insert(corners.map(|c| c.to_array().map(f32::to_bits)))
        };
        let of_shape = |(index, shape): (usize, &crate::scene::Shape)| {
            let ShapeSurface::Mesh(mesh) = &shape.surface else { return None };
            let first = world.first_primitive(index);
            let all = first..first + mesh.triangles.len() as u32;
            let corners = |i: u32| world.soup().corners(i as usize);
            let kept: Vec<u32> = all.filter(|&i| longest_edge(corners(i)) > longer_than && is_new(corners(i))).collect();
            (!kept.is_empty()).then_some((index, kept))
        };
        Self { shapes: world.scene().shapes.iter().enumerate().filter_map(of_shape).collect() }
    }
}

/// The lines along which `cutters` cut triangle `primitive`, the longest last. Lines on which less than half of `patch_size` stands
/// are left out.
pub fn cutting_lines(world: &World, cutters: &Cutters, primitive: u32, patch_size: f64) -> Vec<Cut> {
    let tolerance = TOUCH * f64::from(world.bounds().diagonal());
    let corners = world.soup().corners(primitive as usize);
    let plane = Plane::new(corners);
    let near = corners.into_iter().collect::<Bounds>().expanded(tolerance as f32);
    let mut segments = Vec::new();
    for (shape, triangles) in &cutters.shapes {
        if !world.shape_bounds(*shape).overlaps(&near) {
            continue;
        }
        for &candidate in triangles.iter().filter(|&&t| t != primitive) {
            let other = world.soup().corners(candidate as usize);
            if other.into_iter().collect::<Bounds>().overlaps(&near) {
                segments.extend(segment(&plane, other, tolerance));
            }
        }
    }
    merge(&plane, segments, patch_size)
}

/// Where a triangle crosses or touches the plane, also beyond the plane's own triangle: what counts is how much stands on a line.
fn segment(plane: &Plane, corners: [Vec3; 3], tolerance: f64) -> Option<Cut> {
    let p = corners.map(|c| c.as_dvec3());
    let d = p.map(|p| {
        let d = (p - plane.origin).dot(plane.normal);
        if d.abs() <= tolerance { 0.0 } else { d }
    });
    if d == [0.0; 3] {
        return None;
    }
    let mut ends: Vec<DVec3> = Vec::with_capacity(4);
    for i in 0..3 {
        let j = (i + 1) % 3;
        if d[i] == 0.0 {
            ends.push(p[i]);
        } else if d[i] * d[j] < 0.0 {
            ends.push(p[i] + (p[j] - p[i]) * (d[i] / (d[i] - d[j])));
        }
    }
    match ends[..] {
        [a, b] => {
            let (from, to) = (plane.barycentric(a), plane.barycentric(b));
            Some(Cut { line: Line::through(from, to), from, to, length: (a - b).length() })
        }
        _ => None,
    }
}

/// Segments on one line are one cut; lines on which too little stands are dropped.
fn merge(plane: &Plane, segments: Vec<Cut>, patch_size: f64) -> Vec<Cut> {
    let mut cuts: Vec<Cut> = Vec::new();
    let sound = |cut: &Cut| cut.length > 1e-6 * patch_size && cut.line.a.is_finite() && cut.line.b.is_finite();
    let mut keyed: Vec<Cut> = segments.into_iter().filter(sound).collect();
    // The longest segment gives the line its direction.
    keyed.sort_by(|a, b| b.length.total_cmp(&a.length));
    for cut in keyed {
        let same = |other: &&mut Cut| {
            // Both ends within a thousandth of a patch of the other's line.
            let off = |p: Point| plane_distance(plane, &other.line, p);
            off(cut.from) < 1e-3 * patch_size && off(cut.to) < 1e-3 * patch_size
        };
        if let Some(other) = cuts.iter_mut().find(same) {
            other.absorb(&cut);
        } else if cuts.len() < 16 * MOST {
            cuts.push(cut);
        }
    }
    let whole = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
    cuts.retain(|cut| cut.length >= SHORTEST * patch_size && cut.reaches_into(&whole));
    cuts.sort_by(|a, b| a.length.total_cmp(&b.length));
    let surplus = cuts.len().saturating_sub(MOST);
    cuts.drain(..surplus);
    cuts
}

/// Metric distance of a point from a line.
fn plane_distance(plane: &Plane, line: &Line, p: Point) -> f64 {
    // The gradient of the line function in metric coordinates turns its value into a distance.
    let gradient = plane.to_u * line.a + plane.to_v * line.b;
    line.value(p).abs() / gradient.length()
}

impl Cut {
    /// Extends the stretch by another on the same line.
    fn absorb(&mut self, other: &Cut) {
        self.length += other.length;
        let along = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        let at = |p: Point| (p[0] - self.from[0]) * along[0] + (p[1] - self.from[1]) * along[1];
        let (mut low, mut high) = ((at(self.from), self.from), (at(self.to), self.to));
        for p in [other.from, other.to] {
            if at(p) < low.0 {
                low = (at(p), p);
            }
            if at(p) > high.0 {
                high = (at(p), p);
            }
        }
        (self.from, self.to) = (low.1, high.1);
    }
}
