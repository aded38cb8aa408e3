//! The vector operations as loops over arrays: for processors without AVX2, and as the other version's oracle.

use super::Wide;
use super::kernel::{Distances, Lanes, Parameters};
use super::layout::{Child, LANES, Node, Packet, WIDTH};
use crate::accel::query::{BOX_SLACK, Query};
use crate::geometry::triangle::ShearedRay;

/// Arrays.
pub struct Portable;

impl Lanes for Portable {
    type Ray = Query;

    fn spread(query: &Query) -> Query {
        *query
    }

    #[inline(always)]
    fn enter(node: &Node, query: &Query, limit: f32, distances: &mut Distances) -> u32 {
        let near = &mut distances.0;
        *near = [query.ray.t_min; WIDTH];
        let mut far = [limit; WIDTH];
        for axis in 0..3 {
            let (origin, inverse) = (query.ray.origin[axis], query.inverse[axis]);
            let swap = if inverse >= 0.0 { 0 } else { 3 };
            let (enter, leave) = (&node.planes[axis + swap], &node.planes[axis + 3 - swap]);
            for i in 0..WIDTH {
                let (a, b) = ((enter[i] - origin) * inverse, (leave[i] - origin) * inverse);
                // A NaN, from a ray inside a face's plane, fails both comparisons and does not count.
                near[i] = if a > near[i] { a } else { near[i] };
                far[i] = if b < far[i] { b } else { far[i] };
            }
        }
        let still = query.still();
        let holds_ray = |i: usize, axis: usize| {
            still[axis] && node.planes[axis][i] == query.ray.origin[axis] && node.planes[axis + 3][i] == query.ray.origin[axis]
        };
        let enters = |i: usize| near[i] <= far[i] * BOX_SLACK && !(0..3).any(|axis| holds_ray(i, axis));
        (0..WIDTH).fold(0, |mask, i| mask | u32::from(enters(i)) << i)
    }

    #[inline(always)]
    fn meet(packet: &Packet, query: &Query, _: &Query, limit: f32, t: &mut Parameters) -> u32 {
        let [[ax, ay], [bx, by], [cx, cy]] = project(packet, query);
        let mut inside = 0;
        for lane in 0..LANES {
            let u = cx[lane] * by[lane] - cy[lane] * bx[lane];
            let v = ax[lane] * cy[lane] - ay[lane] * cx[lane];
            let w = bx[lane] * ay[lane] - by[lane] * ax[lane];
            let outside = (u < 0.0 || v < 0.0 || w < 0.0) & (u > 0.0 || v > 0.0 || w > 0.0);
            inside |= u32::from(!outside) << lane;
        }
        inside &= u32::from(packet.is_triangle);
        let mut mask = 0;
        while inside != 0 {
            let lane = inside.trailing_zeros() as usize;
            inside &= inside - 1;
            if let Some(hit) = query.meet(packet.triangle(lane), limit) {
                t.0[lane] = hit;
                mask |= 1 << lane;
            }
        }
        mask
    }

    #[inline(always)]
    fn prefetch(_: &Wide, _: Child) {}
}

/// The triangles' first, second and third corners, sheared: x and y.
#[inline(always)]
fn project(packet: &Packet, query: &Query) -> [[[f32; LANES]; 2]; 3] {
    let ShearedRay { origin, axes: [x, y, z], shear } = query.sheared;
    let (mut sheared_x, mut sheared_y) = ([0.0; LANES], [0.0; LANES]);
    for place in 0..LANES {
        let depth = packet.corners[z][place] - origin[z];
        sheared_x[place] = (packet.corners[x][place] - origin[x]) - shear[0] * depth;
        sheared_y[place] = (packet.corners[y][place] - origin[y]) - shear[1] * depth;
    }
    let mut picked = [[[0.0; LANES]; 2]; 3];
    for lane in 0..LANES {
        for (picked, place) in picked.iter_mut().zip(packet.places(lane)) {
            (picked[0][lane], picked[1][lane]) = (sheared_x[place], sheared_y[place]);
        }
    }
    picked
}
