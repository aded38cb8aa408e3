//! How much of a patch other surfaces in the same place hide.
//!
//! Of two surfaces in one place a viewer sees one: that which the ray engine reports, the same one in both passes. What it never reports
//! gets no light and gives none, so it may not count as area. Triangles that coincide exactly are dropped before ([`crate::scene`]);
//! what overlaps otherwise is measured here, by rays at points of the patch from close by.

use super::{PatchId, PatchMesh};
use crate::geometry::Ray;
use crate::math::{CompensatedSum, Frame, Sampler, warp};
use crate::world::World;
use rayon::prelude::*;

/// Rays that look whether anything lies in the place of a patch at all.
const FIRST_LOOK: u64 = 4;
/// Rays that measure its share then.
const RAYS: u64 = 64;
/// Distance from which they are cast over the patch's width.
const DISTANCE: f32 = 1e-3;
/// Surfaces nearer to each other than this, over that distance, are in the same place.
const SAME_PLACE: f32 = 1e-3;
/// Cosine between normals above which surfaces are parallel.
const PARALLEL: f32 = 0.9999;

/// What lies in the place of a patch: shares of the rays.
#[derive(Clone, Copy, Default)]
struct Covered {
    /// Seen instead of the patch.
    hidden: f64,
    /// Of that: by a front where the patch is a front too, so that its area was given twice.
    twice: f64,
    /// A shape that was seen instead.
    by: Option<u32>,
}

impl PatchMesh {
    /// Takes hidden parts off the areas of all patches.
    pub(super) fn leave_out_covered(&mut self, world: &World) {
        let all = || (0..self.len() as u32).into_par_iter().map(PatchId);
        let first: Vec<Covered> = all().map(|id| self.look(world, id, 0..FIRST_LOOK)).collect();
        // Which of two surfaces a ray meets is decided by rounding. Where one is met seldom the other's first look
        // may miss it, but not its own.
        let mut hides = vec![false; world.scene().shapes.len()];
        first.iter().filter_map(|covered| covered.by).for_each(|shape| hides[shape as usize] = true);
        let covered: Vec<Covered> = all()
            .zip(&first)
            .map(|(id, first)| {
                let is_shared = first.hidden > 0.0 || hides[self.side_of(world, id).0 as usize];
                if is_shared { self.measure_covered(world, id, first) } else { *first }
            })
            .collect();
        let mut twice = CompensatedSum::default();
        for (area, covered) in self.area.iter_mut().zip(&covered) {
            twice.add(covered.twice * *area);
            // Not 0: what no ray finds takes part in no exchange, and all divisions by areas stay finite.
            *area *= (1.0 - covered.hidden).max(LEAST_AREA);
        }
        self.given_twice = twice.value();
    }

    fn measure_covered(&self, world: &World, id: PatchId, first: &Covered) -> Covered {
        let rest = self.look(world, id, FIRST_LOOK..RAYS);
        let mean = |a: f64, b: f64| (a + b) / RAYS as f64;
        Covered { hidden: mean(first.hidden, rest.hidden), twice: mean(first.twice, rest.twice), by: first.by }
    }

    /// Counts of rays.
    fn look(&self, world: &World, id: PatchId, rays: std::ops::Range<u64>) -> Covered {
        let mut covered = Covered::default();
        for k in rays {
            let mut sampler = Sampler::new(0x00c0_e3ed, u64::from(id.0), k);
            let at = self.sample(world, id, sampler.next_2d());
            let away = Frame::new(at.ng).to_world(warp::cosine_hemisphere(sampler.next_2d()));
            let rounding = at.error.max_element();
            let distance = (DISTANCE * (self.area[id.0 as usize] as f32).sqrt()).max(rounding / SAME_PLACE);
            let Some(hit) = world.intersect(&Ray::new(at.point + away * distance, -away)) else { continue };
            // How far before or behind the patch's own plane the surface is that is seen.
            let apart = ((hit.point - at.point).dot(at.ng)).abs();
            let same_place = apart <= SAME_PLACE * distance + 2.0 * rounding && hit.ng.dot(at.ng) > PARALLEL;
            let opaque = !world.scene().material_of(world.shape(hit.primitive)).material.is_transmissive();
            if hit.shape != at.shape && same_place && opaque {
                covered.hidden += 1.0;
                covered.by = Some(hit.shape);
                covered.twice += f64::from(u8::from(hit.front && at.front));
            }
        }
        covered
    }
}

/// Share of its area that a patch keeps, however much of it is hidden.
const LEAST_AREA: f64 = 1e-9;
