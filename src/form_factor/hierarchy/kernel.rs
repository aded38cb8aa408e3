//! Transfer S_pq = A_p F_pq between two nodes: how much there can be, how much it varies, and its value where nothing hides it.

use super::tree::{Node, SPOTS, Spot, Tree};
use crate::form_factor::polygon::Polygon;
use std::f64::consts::PI;

/// Patches nearer than this many times the sum of their radii are integrated as polygons.
pub const NEAR: f32 = 2.5;
/// Relative error allowed to the integral over polygons at most.
const POLYGON_TOLERANCE: f64 = 1e-3;
/// Two patches with more pairs of polygons than this between them are integrated by their points.
pub const MOST_PAIRS: usize = 24;

/// How strongly two nodes are coupled at most, over unit area of the other one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variation {
    /// Bound on how far the kernel cos cos'/(pi r²) strays from its mean [1/m²], by first derivatives.
    pub kernel: f64,
    /// Bound on the kernel itself [1/m²].
    pub most: f64,
    /// Share of it that dividing the first node would take away, relative to dividing the second.
    pub first_weighs_more: bool,
}

/// Bounds the kernel's variation between two nodes; `None` if they do not face each other at all.
///
/// |grad g| <= (cos + cos' + 2 cos cos')/(pi r³) for g = cos cos'/(pi r²) [after Holzschuch95]; times the radii it bounds the change from
/// the middle. Nodes that are not flat add the change of their cosines.
pub fn variation(p: &Node, q: &Node, flat: f32) -> Option<Variation> {
    let d = q.center - p.center;
    let distance = d.length();
    let farthest = distance + p.radius + q.radius;
    let nearest = (distance - p.radius - q.radius).max(0.3 * distance);
    // Greatest height of a point of `far` over a plane of `near`.
    let height = |near: &Node, far: &Node, to_far: f32| {
        let high = highest(far, near);
        let above = to_far + high - near.slab[0];
        if near.spread == 0.0 { above } else { above + near.spread.min(0.5 * std::f32::consts::PI).sin() * farthest }
    };
    let (over_p, over_q) = (height(p, q, d.dot(p.axis)), height(q, p, -d.dot(q.axis)));
    if over_p <= flat || over_q <= flat {
        return None;
    }
    let cos = |height: f32| f64::from((height / nearest.max(f32::MIN_POSITIVE)).min(1.0));
    let (cos_p, cos_q) = (cos(over_p), cos(over_q));
    let r = f64::from(distance);
    let slope = (2.0 * cos_p * cos_q + cos_p + cos_q) / r;
    let turn = |node: &Node, other_cos: f64| f64::from(node.spread.min(1.6).sin()) * other_cos;
    let of_p = slope * f64::from(p.radius) + turn(p, cos_q);
    let of_q = slope * f64::from(q.radius) + turn(q, cos_p);
    let (kernel, most) = ((of_p + of_q) / (PI * r * r), cos_p * cos_q / (PI * r * r));
    Some(Variation { kernel, most, first_weighs_more: of_p >= of_q })
}

/// Highest point of `far` along the axis of `near`, relative to the centre of `far`.
fn highest(far: &Node, near: &Node) -> f32 {
    let axis = near.axis;
    let cos = axis.dot(far.axis);
    if cos > 1.0 - 1e-6 {
        far.slab[1]
    } else if cos < -1.0 + 1e-6 {
        -far.slab[0]
    } else {
        let (middle, half) = (far.bounds.center(), 0.5 * (far.bounds.max - far.bounds.min));
        ((middle - far.center).dot(axis) + half.dot(axis.abs())).min(far.radius)
    }
}

/// cos cos'/(pi r² + `disk`) from x to y [1/m²]; 0 unless they face each other. `disk` is the area of the one that stands for a disk, which
/// keeps near pairs finite.
#[inline]
pub fn between(x: &Spot, y: &Spot, disk: f64) -> f64 {
    let d = y.point - x.point;
    let (cos, other) = (d.dot(x.normal), -d.dot(y.normal));
    if cos <= 0.0 || other <= 0.0 {
        return 0.0;
    }
    let r2 = f64::from(d.length_squared());
    f64::from(cos) * f64::from(other) / (r2 * (PI * r2 + disk))
}

/// A_p F_pq [m²] of nodes `p` and `q` that are not near each other, as if nothing hid them: 0 <= S <= min(A_p, A_q).
pub fn unobstructed(tree: &Tree, p: usize, q: usize) -> f64 {
    by_points(tree, p, q, 0.0).min(tree.nodes[p].area.min(tree.nodes[q].area))
}

/// The same by points of each, of which those of one stand for disks of the area `disk`.
pub fn by_points(tree: &Tree, p: usize, q: usize, disk: f64) -> f64 {
    tree.nodes[p].area * tree.nodes[q].area * mean(&tree.centred[p], &tree.centred[q], disk)
}

/// The same of patches by their polygons, to a relative error of `tolerance`: what a form factor may be off, if it is 1.
pub fn between_polygons(p: &[Polygon], q: &[Polygon], tolerance: f64) -> f64 {
    let tolerance = tolerance.min(POLYGON_TOLERANCE);
    let pairs = p.iter().flat_map(|f| q.iter().map(move |s| (f, s)));
    pairs.map(|(f, s)| f.transfer(s, tolerance)).sum()
}

fn mean(p: &[Spot; SPOTS], q: &[Spot; SPOTS], disk: f64) -> f64 {
    let pairs = p.iter().flat_map(|x| q.iter().map(move |y| between(x, y, disk)));
    pairs.sum::<f64>() / (SPOTS * SPOTS) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Bounds;
    use crate::math::Vec3;

    /// A square of side `s` around `center` that faces along an axis.
    fn square(center: Vec3, axis: Vec3, s: f32) -> Node {
        let across = (Vec3::ONE - axis.abs()) * 0.5 * s;
        let bounds = Bounds::new(center - across, center + across);
        let area = f64::from(s * s);
        let radius = s * 0.5_f32.sqrt();
        Node { bounds, center, radius, axis, spread: 0.0, slab: [0.0; 2], area, first: 0, count: 1, second: 0 }
    }

    #[test]
    fn squares_back_to_back_or_in_one_plane_exchange_nothing() {
        let floor = square(Vec3::ZERO, Vec3::Z, 1.0);
        for (center, axis) in [(Vec3::Z, Vec3::Z), (Vec3::X * 3.0, Vec3::Z), (-Vec3::Z, -Vec3::Z), (-Vec3::Z, Vec3::Z)] {
            assert_eq!(variation(&floor, &square(center, axis, 1.0), 1e-6), None, "{center} facing {axis}");
        }
        assert!(variation(&floor, &square(Vec3::Z, -Vec3::Z, 1.0), 1e-6).is_some());
    }

    /// The bound against the kernel itself on a lattice of points of two squares in several positions.
    #[test]
    fn the_kernel_strays_from_its_middle_by_less_than_the_bound() {
        for (center, axis) in [(Vec3::Z, -Vec3::Z), (Vec3::new(3.0, 0.0, 1.0), -Vec3::X), (Vec3::new(2.0, 1.0, 4.0), -Vec3::Z)] {
            for s in [0.1_f32, 0.3, 0.6] {
                let (p, q) = (square(Vec3::ZERO, Vec3::Z, s), square(center, axis, s));
                let bound = variation(&p, &q, 1e-6).expect("they face each other").kernel;
                let lattice = |node: &Node| -> Vec<Spot> {
                    let at = |i: usize, span: f32| span * (i as f32 / 4.0 - 0.5);
                    let (u, v) = if node.axis.z != 0.0 { (Vec3::X, Vec3::Y) } else { (Vec3::Y, Vec3::Z) };
                    let point = |k: usize| node.center + u * at(k % 5, s) + v * at(k / 5, s);
                    (0..25).map(|k| Spot { point: point(k), normal: node.axis, lift: 0.0 }).collect()
                };
                let middle = |node: &Node| Spot { point: node.center, normal: node.axis, lift: 0.0 };
                let centre = between(&middle(&p), &middle(&q), 0.0);
                for (x, y) in lattice(&p).iter().flat_map(|x| lattice(&q).into_iter().map(move |y| (*x, y))) {
                    let off = (between(&x, &y, 0.0) - centre).abs();
                    assert!(off <= bound, "side {s} at {center}: the kernel is off by {off}, the bound is {bound}");
                }
            }
        }
    }
}
