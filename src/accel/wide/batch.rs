//! Many rays at once: those of one class are bundled.

use super::{Operations, Wide, avx2, avx512, packet};
use crate::accel::query::usable;
use crate::accel::{Hit, Ray};
use crate::geometry::triangle::ShearedRay;

/// Octants times largest axes.
const CLASSES: usize = 24;

/// Sign of each direction component, and which is the largest: what the rays of a bundle must share.
fn class(ray: &Ray) -> usize {
    let negative = |axis: usize| (ray.direction[axis].to_bits() >> 31) as usize;
    3 * (negative(0) | negative(1) << 1 | negative(2) << 2) + ShearedRay::main_axis(ray.direction)
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
    let mut finish = |open: &Open| bundled(&open.rays[..open.n_rays], &open.indices[..open.n_rays]);
    for (index, ray) in rays.iter().enumerate() {
        let Some(ray) = usable(ray) else { continue };
        let open = open[class(&ray)]
            .get_or_insert_with(|| Box::new(Open { rays: [ray; packet::RAYS], indices: [0; packet::RAYS], n_rays: 0 }));
        (open.rays[open.n_rays], open.indices[open.n_rays]) = (ray, index as u32);
        open.n_rays += 1;
        if open.n_rays == packet::RAYS {
            finish(open);
            open.n_rays = 0;
        }
    }
    open.iter().flatten().filter(|open| open.n_rays > 0).for_each(|open| finish(open));
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
