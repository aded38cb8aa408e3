//! Closed forms between polygons without anything in between: the oracles of the tests.

use crate::math::DVec3;
use std::f64::consts::PI;

/// Form factor from a differential element at `point` with unit normal `n` to a polygon, clipped to the element's horizon.
///
/// Lambert's formula: a sum over edges of the angle they subtend times the cosine of their plane [Cohen93, Eq. 4.27]. Accurate to a
/// few roundings unless the point lies on the polygon's border.
pub fn point_to_polygon(point: DVec3, n: DVec3, polygon: &[DVec3]) -> f64 {
    let above = clip_to_horizon(point, n, polygon);
    let count = above.len();
    let edge = |i: usize| {
        let (a, b) = (above[i], above[(i + 1) % count]);
        let cross = a.cross(b);
        let length = cross.length();
        if length == 0.0 { 0.0 } else { length.atan2(a.dot(b)) * cross.dot(n) / length }
    };
    ((0..count).map(edge).sum::<f64>() / (2.0 * PI)).abs()
}

/// The polygon relative to `point`, cut off at the plane through it with normal `n`.
fn clip_to_horizon(point: DVec3, n: DVec3, polygon: &[DVec3]) -> Vec<DVec3> {
    let relative: Vec<DVec3> = polygon.iter().map(|p| *p - point).collect();
    let mut kept = Vec::with_capacity(relative.len() + 1);
    for (i, &a) in relative.iter().enumerate() {
        let b = relative[(i + 1) % relative.len()];
        let (d, e) = (a.dot(n), b.dot(n));
        if d >= 0.0 {
            kept.push(a);
        }
        if (d > 0.0) != (e > 0.0) && d != e {
            kept.push(a + (b - a) * (d / (d - e)));
        }
    }
    kept
}

/// Form factor between two parallel, directly opposed rectangles of sides `a` and `b` at distance `c` (Howell's catalogue, C-11).
pub fn parallel_rectangles(a: f64, b: f64, c: f64) -> f64 {
    let (x, y) = (a / c, b / c);
    let (x2, y2) = (1.0 + x * x, 1.0 + y * y);
    let (rx, ry) = (x2.sqrt(), y2.sqrt());
    let log = 0.5 * (x2 * y2 / (x2 + y * y)).ln();
    let sum = log + x * ry * (x / ry).atan() + y * rx * (y / rx).atan() - x * x.atan() - y * y.atan();
    2.0 / (PI * x * y) * sum
}

/// Form factor from a rectangle of depth `w` to one of height `h` at right angles, sharing an edge of length `l` (C-14).
pub fn perpendicular_rectangles(l: f64, w: f64, h: f64) -> f64 {
    let (h, w) = (h / l, w / l);
    let (h2, w2) = (h * h, w * w);
    let r2 = h2 + w2;
    let log = 0.25
        * (((1.0 + w2) * (1.0 + h2) / (1.0 + r2)).ln()
            + w2 * (w2 * (1.0 + r2) / ((1.0 + w2) * r2)).ln()
            + h2 * (h2 * (1.0 + r2) / ((1.0 + h2) * r2)).ln());
    let arcs = w * (1.0 / w).atan() + h * (1.0 / h).atan() - r2.sqrt() * (1.0 / r2.sqrt()).atan();
    (arcs + log) / (PI * w)
}

/// Form factor from a disk of radius `r1` to a coaxial parallel one of radius `r2` at distance `h` (C-41).
pub fn coaxial_disks(r1: f64, r2: f64, h: f64) -> f64 {
    let (a, b) = (r1 / h, r2 / h);
    let x = 1.0 + (1.0 + b * b) / (a * a);
    let root = (x * x - 4.0 * (b / a) * (b / a)).sqrt();
    // The smaller of the two solutions, without the difference of large numbers.
    2.0 * (b / a) * (b / a) / (x + root)
}

/// Form factor from a disk of radius `rd` to a sphere of radius `rs` with its centre on the disk's axis at distance `h` (C-122).
pub fn disk_to_sphere(rs: f64, rd: f64, h: f64) -> f64 {
    // 1 - h/sqrt(h² + rd²) without the difference.
    let root = (h * h + rd * rd).sqrt();
    2.0 * (rs / rd) * (rs / rd) * (rd * rd / (root * (root + h)))
}

/// Form factor from a sphere to a rectangle of sides `l1` and `l2` with a corner on the normal from the sphere's centre, at distance `d`:
/// its solid angle over 4 pi.
pub fn sphere_to_rectangle(d: f64, l1: f64, l2: f64) -> f64 {
    let (a, b) = (d / l1, d / l2);
    (1.0 / (a * a + b * b + a * a * b * b).sqrt()).atan() / (4.0 * PI)
}

/// Form factor from the inside of a cylinder of radius `r` and height `h` without its ends to itself (C-78).
pub fn cylinder_inside(r: f64, h: f64) -> f64 {
    let x = h / (2.0 * r);
    1.0 + x - (1.0 + x * x).sqrt()
}

/// Form factors from the inside of a cylinder of radius `r2` to the outside of a coaxial one of radius `r1`, both of length `l`, and to
/// itself past it (C-91, C-92).
pub fn coaxial_cylinders(r1: f64, r2: f64, l: f64) -> (f64, f64) {
    let (r, h) = (r2 / r1, l / r1);
    let (a, b) = (h * h + r * r - 1.0, h * h - r * r + 1.0);
    let root = ((a + 2.0) * (a + 2.0) - 4.0 * r * r).sqrt();
    let bracket = root * (b / (r * a)).acos() + b * (1.0 / r).asin() - 0.5 * PI * a;
    let to_inner = 1.0 / r - ((b / a).acos() - bracket / (2.0 * h)) / (PI * r);
    let long = (4.0 * r * r + h * h).sqrt() / h;
    let r2 = r * r;
    let arc = ((4.0 * (r2 - 1.0) + h * h / r2 * (r2 - 2.0)) / (h * h + 4.0 * (r2 - 1.0))).asin();
    let ends = long * arc - ((r2 - 2.0) / r2).asin() + 0.5 * PI * (long - 1.0);
    let to_itself = 1.0 - 1.0 / r + 2.0 / (PI * r) * (2.0 * (r2 - 1.0).sqrt() / h).atan() - h / (2.0 * PI * r) * ends;
    (to_inner, to_itself)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(name: &str, got: f64, want: f64, tolerance: f64) {
        assert!((got / want - 1.0).abs() < tolerance, "{name}: {got}, expected {want}");
    }

    #[test]
    fn closed_forms_agree_with_the_table() {
        // physical_checks.csv: ff_cube_opposite, ff_cube_adjacent, ff_parallel_2x1, ff_perp_1x1_1x2.
        close("opposite", parallel_rectangles(1.0, 1.0, 1.0), 0.199_824_895_698, 1e-9);
        close("adjacent", perpendicular_rectangles(1.0, 1.0, 1.0), 0.200_043_776_075, 1e-9);
        close("2 x 1", parallel_rectangles(2.0, 1.0, 1.0), 0.285_875_385, 1e-8);
        close("1x1 to 1x2", perpendicular_rectangles(1.0, 1.0, 2.0), 0.232_852_603, 1e-8);
    }

    #[test]
    fn a_polygon_through_the_horizon_is_clipped() {
        // physical_checks.csv triangle_horizon_clip: irradiance 0.443682949 for L = 1, that is pi times the form factor.
        let triangle = [DVec3::new(1.0, 0.0, -1.0), DVec3::new(1.0, 1.0, 2.0), DVec3::new(1.0, -1.0, 2.0)];
        close("clipped", PI * point_to_polygon(DVec3::ZERO, DVec3::Z, &triangle), 0.443_682_949, 1e-8);
    }

    #[test]
    fn a_square_overhead_and_a_huge_one() {
        let square = |s: f64| [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, y)| DVec3::new(x, y, 1.0));
        close("unit", PI * point_to_polygon(DVec3::ZERO, DVec3::Z, &square(0.5)), 0.752_274_688, 1e-8);
        close("huge", PI * point_to_polygon(DVec3::ZERO, DVec3::Z, &square(1000.0)), 3.141_590_083, 1e-8);
    }
}
