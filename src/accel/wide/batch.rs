//! Many rays at once: those of one class are bundled.

use super::Wide;
use super::packet;
use crate::accel::query::Query;
use crate::accel::{Hit, Ray};

/// Octants times largest axes.
const CLASSES: usize = 24;

/// Sign of each direction component, and which is the largest: what the rays of a bundle must share.
fn class(query: &Query) -> usize {
    let negative = |axis: usize| usize::from(query.inverse[axis].is_sign_negative());
    3 * (negative(0) | negative(1) << 1 | negative(2) << 2) + query.sheared.axes[2]
}

/// A bundle in the making.
struct Open {
    queries: [Query; packet::RAYS],
    indices: [u32; packet::RAYS],
    n_rays: usize,
}

/// Calls `bundled` with rays of one class, in their order.
///
/// Rays of up to 24 classes may alternate, as at a corner of the picture; each class fills a bundle of its own.
fn sort_out(rays: &[Ray], mut bundled: impl FnMut(&[Query], &[u32])) {
    let mut open: [Option<Box<Open>>; CLASSES] = Default::default();
    let mut finish = |open: &Open| bundled(&open.queries[..open.n_rays], &open.indices[..open.n_rays]);
    for (index, ray) in rays.iter().enumerate() {
        let Some(query) = Query::new(ray) else { continue };
        let open = open[class(&query)]
            .get_or_insert_with(|| Box::new(Open { queries: [query; packet::RAYS], indices: [0; packet::RAYS], n_rays: 0 }));
        (open.queries[open.n_rays], open.indices[open.n_rays]) = (query, index as u32);
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
    sort_out(rays, |queries, indices| packet::nearest(wide, queries, |i, hit| hits[indices[i] as usize] = hit));
}

/// Occlusion.
pub fn any(wide: &Wide, rays: &[Ray], occluded: &mut [bool]) {
    assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
    occluded.fill(false);
    sort_out(rays, |queries, indices| packet::any(wide, queries, |i, answer| occluded[indices[i] as usize] = answer));
}
