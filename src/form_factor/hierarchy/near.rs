//! Exchanges of patches that are near each other for their size: rays of the smaller one, which all these exchanges share.
//!
//! The kernel between such patches has a peak: of points spread over a ceiling few lie above the lamp's holder that hangs a centimetre
//! below it, and these are all that count. Rays by the cosine law from the smaller patch are where the kernel is. Those that aim at the other
//! patch say which share of it is seen; where polygons are too many to be integrated, those that meet it say all.

use super::kernel::{self, MOST_PAIRS, NEAR};
use super::refine::{Casting, Link, Refinement};
use crate::form_factor::polygon::Polygon;
use crate::math::{DVec3, Frame, Sampler, Vec3, sampler::mix, warp};
use crate::patch::{PatchId, outline};
use crate::progress::{Observer, Progress, Stage};
use rayon::prelude::*;
use smallvec::SmallVec;
use std::ops::ControlFlow;

/// Patches that are worked on one after the other.
const TASK: usize = 64;
/// Of these, side by side, between two looks at the observer.
const TASKS: usize = 256;
/// Rays of a patch.
const RAYS: usize = 128;
/// Rays that aim at a patch, from which on they say how much of it is seen.
const FEWEST_AIMED: usize = 8;
/// Patches of many polygons nearer to each other than this many times the sum of their radii exchange what rays meet: further apart what is
/// between their points is as good.
const BESIDE: f32 = 1.0;

/// Sets their random numbers apart from those of other rays.
const OWN_RAYS: u64 = 0x6ea2;

/// Two patches, as nodes, the smaller one first, and about the most that its form factor may be.
pub type Pair = (u32, u32, f32);

/// The rays of one patch.
struct Looks {
    from: [[f32; RAYS]; 3],
    along: [[f32; RAYS]; 3],
    /// The patch that each met first.
    met: [Option<PatchId>; RAYS],
}

impl Refinement<'_> {
    /// True if two nodes, both of them patches, are near each other.
    pub(super) fn is_near(&self, p: u32, q: u32) -> bool {
        let [a, b] = [p, q].map(|at| &self.tree.nodes[at as usize]);
        a.center.distance(b.center) < NEAR * (a.radius + b.radius)
    }

    /// The links of near pairs, and the number of rays cast; pairs may come in any order. `None` if the observer stopped it.
    pub(super) fn near_links(&self, mut pairs: Vec<Pair>, observer: &mut Observer<'_>) -> Option<(Vec<Vec<Link>>, u64)> {
        pairs.par_sort_unstable_by_key(|(p, q, _)| (*p, *q));
        let of_patch: Vec<&[Pair]> = pairs.chunk_by(|a, b| a.0 == b.0).collect();
        let of_some = |patches: &[&[Pair]]| {
            let (mut links, mut cast) = (Vec::new(), Casting::default());
            patches.iter().for_each(|pairs| self.links_of(pairs, &mut links, &mut cast));
            (links, cast.rays)
        };
        let (mut links, mut rays) = (Vec::new(), 0);
        for (done, some) in of_patch.chunks(TASK * TASKS).enumerate() {
            let found: Vec<(Vec<Link>, u64)> = some.par_chunks(TASK).map(of_some).collect();
            for (of_task, cast) in found {
                links.push(of_task);
                rays += cast;
            }
            let done = ((done + 1) * TASK * TASKS) as f64;
            let progress = Progress { stage: Stage::FormFactors, done, total: of_patch.len() as f64 };
            if let ControlFlow::Break(()) = observer(&progress) {
                return None;
            }
        }
        Some((links, rays))
    }

    /// The links of the patch that is first in all of `pairs`.
    fn links_of(&self, pairs: &[Pair], links: &mut Vec<Link>, cast: &mut Casting) {
        let Some(&(p, ..)) = pairs.first() else { return };
        let node = |at: u32| &self.tree.nodes[at as usize];
        let patch = |at: u32| PatchId(self.tree.patch[node(at).first as usize]);
        let a = node(p);
        let (mut looks, mut own) = (None, None);
        for &(_, q, most) in pairs {
            let b = node(q);
            let ids = [p, q].map(patch);
            let are_few = ids.iter().map(|&id| self.patches.n_pieces(id)).product::<usize>() <= MOST_PAIRS;
            let transfer = if are_few {
                let outlines = self.patches.outlines(self.world, ids[1]);
                // What few rays can aim at is left to those between the two.
                let [aimed, seen] = match most * RAYS as f32 >= FEWEST_AIMED as f32 {
                    true => looks.get_or_insert_with(|| self.look(ids[0], cast)).at(ids[1], &outlines),
                    false => [0, 0],
                };
                let own = own.get_or_insert_with(|| polygons(&self.patches.outlines(self.world, ids[0])));
                let whole = || {
                    let other = polygons(&outlines);
                    kernel::between_polygons(own, &other, self.tolerance).min(a.area.min(b.area))
                };
                match (aimed >= FEWEST_AIMED, seen) {
                    (true, 0) => 0.0,
                    (true, _) => whole() * seen as f64 / aimed as f64,
                    (false, _) => self.transfer_by((p, q), f64::from(most), &whole, cast),
                }
            } else if a.center.distance(b.center) < BESIDE * (a.radius + b.radius) {
                let met =
                    looks.get_or_insert_with(|| self.look(ids[0], cast)).met.iter().filter(|met| **met == Some(ids[1])).count();
                (a.area * met as f64 / RAYS as f64).min(b.area)
            } else {
                let whole = || kernel::by_points(self.tree, p as usize, q as usize, a.area.min(b.area));
                self.transfer_by((p, q), f64::from(most), &whole, cast)
            };
            if transfer > 0.0 {
                links.push(Link { first: p.min(q), second: p.max(q), transfer: transfer as f32 });
            }
        }
    }

    /// Casts the rays of a patch.
    fn look(&self, id: PatchId, cast: &mut Casting) -> Looks {
        let mut looks = Looks { from: [[0.0; RAYS]; 3], along: [[0.0; RAYS]; 3], met: [None; RAYS] };
        cast.rays += RAYS as u64;
        for k in 0..RAYS {
            let mut sampler = Sampler::new(mix(self.seed ^ OWN_RAYS), u64::from(id.0), k as u64);
            let from = self.patches.sample(self.world, id, sampler.next_2d());
            let along = Frame::new(from.ng).to_world(warp::cosine_hemisphere(sampler.next_2d()));
            looks.met[k] = self.world.intersect(&from.spawn(along)).and_then(|at| self.patches.patch_at(&at));
            for axis in 0..3 {
                (looks.from[axis][k], looks.along[axis][k]) = (from.point[axis], along[axis]);
            }
        }
        looks
    }
}

impl Looks {
    /// How many rays would meet patch `id`, of these `outlines`, if nothing stood between, and how many of them do.
    fn at(&self, id: PatchId, outlines: &[outline::Outline]) -> [usize; 2] {
        let mut aims = [false; RAYS];
        for outline in outlines {
            let normal = outline::winding(outline).normalize_or_zero();
            let edge = |k: usize| {
                let (here, next) = (outline[k], outline[(k + 1) % outline.len()]);
                let inwards = normal.cross(next - here);
                (inwards.as_vec3(), inwards.dot(here) as f32)
            };
            let edges: SmallVec<[_; 8]> = (0..outline.len()).map(edge).collect();
            let (n, height) = (normal.as_vec3(), normal.dot(outline[0]) as f32);
            for k in 0..RAYS {
                let [from, along] = [&self.from, &self.along].map(|v| [v[0][k], v[1][k], v[2][k]]);
                let (down, above) =
                    (n.x * along[0] + n.y * along[1] + n.z * along[2], n.x * from[0] + n.y * from[1] + n.z * from[2]);
                let t = (height - above) / down;
                let at = [from[0] + t * along[0], from[1] + t * along[1], from[2] + t * along[2]];
                let is_inside = |(m, c): &(Vec3, f32)| m.x * at[0] + m.y * at[1] + m.z * at[2] >= *c;
                aims[k] |= down < 0.0 && t > 0.0 && edges.iter().all(is_inside);
            }
        }
        let aimed = aims.iter().filter(|aims| **aims).count();
        [aimed, aims.iter().zip(&self.met).filter(|(aims, met)| **aims && **met == Some(id)).count()]
    }
}

fn polygons(outlines: &[Vec<DVec3>]) -> Vec<Polygon> {
    outlines.iter().filter_map(|o| Polygon::new(o)).collect()
}
