//! Many rays at once: those of one class are bundled.

use super::{Operations, Wide, avx2, avx512, packet};
use crate::accel::query::usable;
use crate::accel::{Hit, Ray};
use crate::geometry::triangle::ShearedRay;
use crate::math::Vec3;

/// Octants times largest axes.
const CLASSES: usize = 24;

/// Sign of each direction component, and which is the largest: what the rays of a bundle must share.
fn class(ray: &Ray) -> usize {
    let negative = |axis: usize| (ray.direction[axis].to_bits() >> 31) as usize;
    3 * (negative(0) | negative(1) << 1 | negative(2) << 2) + ShearedRay::main_axis(ray.direction)
}

/// True if all rays are [usable] as they are, and of one class.
///
/// Without branches: in a camera tile nearly all are, and looking at each by itself took an eighth of the time of a batch.
fn are_alike(rays: &[Ray]) -> bool {
    let class = |ray: &Ray| {
        let (d, abs) = (ray.direction, ray.direction.abs());
        let is_x = (abs.x > abs.y) & (abs.x > abs.z);
        let is_y = !is_x & (abs.y > abs.z);
        let signs = d.x.to_bits() >> 31 | d.y.to_bits() >> 31 << 1 | d.z.to_bits() >> 31 << 2;
        signs | u32::from(is_x) << 3 | u32::from(is_y) << 4
    };
    let first = class(&rays[0]);
    rays.iter().fold(true, |all, ray| {
        // As in `usable`: zero times an infinity or a NaN is a NaN.
        let zero = ray.origin * 0.0 + ray.direction * 0.0;
        let is_finite = zero.x + zero.y + zero.z == 0.0;
        let holds_something = ray.t_min.is_sign_positive() & (ray.t_min < ray.t_max);
        all & is_finite & holds_something & (ray.direction != Vec3::ZERO) & (class(ray) == first)
    })
}

/// A bundle in the making.
struct Open {
    rays: [Ray; packet::RAYS],
    indices: [u32; packet::RAYS],
    n_rays: usize,
}

/// Calls `bundled` with rays of one class, in their order.
///
/// Rays of up to 24 classes may alternate, as at a corner of the picture; each class fills a bundle of its own.
fn sort_out(rays: &[Ray], mut bundled: impl FnMut(&[Ray], &[u32])) {
    let mut open: [Option<Box<Open>>; CLASSES] = Default::default();
    for (chunk, start) in rays.chunks(packet::RAYS).zip((0..).step_by(packet::RAYS)) {
        if are_alike(chunk) {
            let mut indices = [0; packet::RAYS];
            indices.iter_mut().zip(start..).for_each(|(index, i)| *index = i);
            bundled(chunk, &indices[..chunk.len()]);
            continue;
        }
        for (index, ray) in (start..).zip(chunk) {
            let Some(ray) = usable(ray) else { continue };
            let open = open[class(&ray)]
                .get_or_insert_with(|| Box::new(Open { rays: [ray; packet::RAYS], indices: [0; packet::RAYS], n_rays: 0 }));
            (open.rays[open.n_rays], open.indices[open.n_rays]) = (ray, index);
            open.n_rays += 1;
            if open.n_rays == packet::RAYS {
                bundled(&open.rays, &open.indices);
                open.n_rays = 0;
            }
        }
    }
    open.iter()
        .flatten()
        .filter(|open| open.n_rays > 0)
        .for_each(|open| bundled(&open.rays[..open.n_rays], &open.indices[..open.n_rays]));
}

/// Nearest hits.
pub fn nearest(wide: &Wide, rays: &[Ray], hits: &mut [Option<Hit>]) {
    assert_eq!(rays.len(), hits.len(), "one hit for each ray");
    hits.fill(None);
    sort_out(rays, |rays, indices| {
        let mut keep = |i: usize, hit| hits[indices[i] as usize] = hit;
        match wide.operations {
            Operations::Avx512 => avx512::nearest_of(wide, rays, &mut keep),
            _ => avx2::nearest_of(wide, rays, &mut keep),
        }
    });
}

/// Occlusion.
pub fn any(wide: &Wide, rays: &[Ray], occluded: &mut [bool]) {
    assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
    occluded.fill(false);
    sort_out(rays, |rays, indices| {
        let mut keep = |i: usize, answer| occluded[indices[i] as usize] = answer;
        match wide.operations {
            Operations::Avx512 => avx512::any_of(wide, rays, &mut keep),
            _ => avx2::any_of(wide, rays, &mut keep),
        }
    });
}
