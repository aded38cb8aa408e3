//! The vector operations as loops over arrays: for processors without AVX2, and as the other version's oracle.

use super::Wide;
use super::kernel::{Distances, Lanes};
use super::layout::{Child, LANES, Node, Packet, WIDTH};
use crate::accel::query::{BOX_SLACK, Query};

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
    fn meet(packet: &Packet, query: &Query, _: &Query, limit: f32, t: &mut [f32; LANES]) -> u32 {
        let mut mask = 0;
        for (lane, t) in t.iter_mut().enumerate() {
            if let Some(hit) = query.meet(packet.triangle(lane), limit) {
                *t = hit;
                mask |= 1 << lane;
            }
        }
        mask
    }

    #[inline(always)]
    fn prefetch(_: &Wide, _: Child) {}
}
