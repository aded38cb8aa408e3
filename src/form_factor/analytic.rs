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
