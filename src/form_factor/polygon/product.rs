//! Product Gauss rules over two polygons: for those that are far apart, where contour integrals lose digits by cancellation.

use super::gauss;
use crate::math::DVec3;
use std::f64::consts::FRAC_1_PI;
use wide::f64x4;

/// Most nodes a side of a rule that is kept in vectors.
pub const MOST_NODES: usize = 8;
/// Panels of a polygon that fit without memory of their own.
const VECTORS: usize = MOST_NODES * MOST_NODES / 4;

/// The nodes of one bilinear panel, four to a vector; those that fill up the last vector weigh nothing.
#[derive(Debug, Clone)]
pub struct Nodes {
    x: [f64x4; VECTORS],
    y: [f64x4; VECTORS],
    z: [f64x4; VECTORS],
    weight: [f64x4; VECTORS],
    vectors: usize,
    count: usize,
}

impl Nodes {
    /// `n` by `n` nodes of a panel: a quadrilateral or, with two corners alike, a triangle.
    pub fn new(panel: &[DVec3; 4], n: usize) -> Self {
        let mut lanes = [[0.0; 4 * VECTORS]; 4];
        let rule = gauss::rule(n);
        let [a, b, c, d] = *panel;
        let (ab, dc) = (b - a, c - d);
        let mut count = 0;
        for (v, weight_v) in rule.nodes() {
            let along = ab + (dc - ab) * v;
            let start = a + (d - a) * v;
            let side = (d - a, (c - b) - (d - a));
            for (u, weight_u) in rule.nodes() {
                let at = start + along * u;
                let area = along.cross(side.0 + side.1 * u).length();
                for (lane, value) in lanes.iter_mut().zip([at.x, at.y, at.z, weight_u * weight_v * area]) {
                    lane[count] = value;
                }
                count += 1;
            }
        }
        let vectors = count.div_ceil(4);
        for lane in &mut lanes[..3] {
            let last = lane[count - 1];
            lane[count..4 * vectors].fill(last);
        }
        let pack = |lane: &[f64; 4 * VECTORS]| {
            std::array::from_fn(|i| f64x4::new([lane[4 * i], lane[4 * i + 1], lane[4 * i + 2], lane[4 * i + 3]]))
        };
        Self { x: pack(&lanes[0]), y: pack(&lanes[1]), z: pack(&lanes[2]), weight: pack(&lanes[3]), vectors, count }
    }
}

/// The integral of cos cos / (pi r²) over two panels with unit normals `np` and `nq` [m²].
#[inline]
pub fn integrate(p: &Nodes, np: DVec3, q: &Nodes, nq: DVec3) -> f64 {
    let splat = f64x4::splat;
    let (px, py, pz) = (splat(np.x), splat(np.y), splat(np.z));
    let (qx, qy, qz) = (splat(nq.x), splat(nq.y), splat(nq.z));
    let mut total = 0.0;
    for i in 0..p.count {
        let (vector, lane) = (i / 4, i % 4);
        let at = |of: &[f64x4; VECTORS]| splat(of[vector].as_array_ref()[lane]);
        let (ax, ay, az) = (at(&p.x), at(&p.y), at(&p.z));
        let mut sum = f64x4::ZERO;
        for k in 0..q.vectors {
            let (dx, dy, dz) = (q.x[k] - ax, q.y[k] - ay, q.z[k] - az);
            let r2 = dx * dx + dy * dy + dz * dz;
            let cosines = (dx * px + dy * py + dz * pz) * (dx * qx + dy * qy + dz * qz);
            sum += q.weight[k] * cosines / (r2 * r2);
        }
        total -= sum.reduce_add() * p.weight[vector].as_array_ref()[lane];
    }
    total * FRAC_1_PI
}
