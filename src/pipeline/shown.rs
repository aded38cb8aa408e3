//! What patches show of their light to places far away.
//!
//! Light and the outlook of a point go together: what lies under a rug or behind a box is dark, and nobody sees it. With one mean for all
//! of a patch, the parts that are seen are too dark, and a coarse solution loses light at every bounce. So points are weighted by how
//! much of the hemisphere is free about them, up to the width of the patch, by one cosine-distributed ray each:
//!
//! shown_i = sum_k w_k D_k / sum_k w_k, with w_k = 1 where the ray of point k is free and 0 where it meets another patch.
//!
//! What lies within that width sees the other points, but form factors carry the shown mean there too. That much is taken back from
//! whoever was met, so that all light of the patch is its area times its mean as before:
//!
//! returned_j = sum_i rho_i A_i / (A_j n_i) sum over the points k of i that met j of (D_k - shown_i).
//!
//! Light that patches send each other is seen in the same way, by pairs of rays from one point ([`RayPairs`]): a ray that brings light from a
//! patch counts by whether the other of its pair looks far. A few bounces tell the light that these corrections are of, before it is solved.

use crate::form_factor::RayPairs;
use crate::math::{Frame, Rgb, Sampler, sampler::mix, warp};
use crate::patch::PatchMesh;
use crate::world::{Stages, SurfaceInteraction, World};

/// Corrections of the light of all patches for what is seen of them, as their diffuse part accepts it [W/m²].
pub(super) struct Shown {
    /// What far places see of it, beyond its mean.
    pub beyond_mean: Vec<Rgb>,
    /// What a patch gets from those near it, beyond what form factors carry there.
    pub returned: Vec<Rgb>,
}

/// What the points of one patch have found.
#[derive(Default)]
pub(super) struct Looks {
    /// Sum of the direct light of points that look far.
    open: Rgb,
    n_open: u64,
    /// Patches that the others met, if what they met has any, with the direct light of the point.
    near: Vec<(Option<u32>, Rgb)>,
}

impl Looks {
    /// Looks from point `at`, number `k`, of patch `i`; its direct light is `light`.
    pub fn add<K: Stages>(
        &mut self,
        (world, patches): (&World, &PatchMesh),
        (i, k, seed): (usize, u64, u64),
        at: &SurfaceInteraction,
        light: Rgb,
    ) {
        let mut sampler = Sampler::new(mix(seed ^ 0x5ee0), i as u64, k);
        let direction = Frame::new(at.ng).to_world(warp::cosine_hemisphere(sampler.next_2d()));
        let mut ray = at.spawn(direction);
        ray.t_max = patches.area[i].sqrt() as f32;
        let met = world.intersect_by::<K>(&ray);
        match met.as_ref().and_then(|met| patches.patch_at(met)) {
            Some(patch) => self.near.push((Some(patch.0), light)),
            None if met.is_some_and(|met| !goes_on_from(world, &met)) => self.near.push((None, light)),
            None => {
                self.open += light;
                self.n_open += 1;
            }
        }
    }
}

/// True where light goes on from a surface that is no patch: from mirrors and through glass, not from what is black.
fn goes_on_from(world: &World, met: &SurfaceInteraction) -> bool {
    let scene = world.scene();
    !scene.material_of(&scene.shapes[met.shape as usize]).material.is_only_diffuse()
}

impl Shown {
    /// Nothing to correct.
    pub fn none(patches: usize) -> Self {
        Self { beyond_mean: vec![Rgb::BLACK; patches], returned: vec![Rgb::BLACK; patches] }
    }

    /// Adds what else is to be corrected.
    pub fn add(&mut self, more: &Self) {
        let add = |to: &mut [Rgb], from: &[Rgb]| to.iter_mut().zip(from).for_each(|(to, from)| *to += *from);
        add(&mut self.beyond_mean, &more.beyond_mean);
        add(&mut self.returned, &more.returned);
    }

    /// The same of light that patches send each other, `leaving` them [W/m²], by pairs of rays from one point: the other ray of each tells
    /// whether the point looks far, and where the light of those that do not goes.
    pub fn by_patches(patches: &PatchMesh, pairs: &RayPairs, leaving: &[Rgb]) -> Self {
        let mut shown = Self::none(patches.len());
        for i in 0..patches.len() {
            let (mut all, mut n_all, mut open, mut n_open) = (Rgb::BLACK, 0.0, Rgb::BLACK, 0.0);
            for (met, other) in pairs.both_ways(i) {
                let Some(j) = met.patch() else { continue };
                all += leaving[j];
                n_all += 1.0;
                if !other.is_near() {
                    open += leaving[j];
                    n_open += 1.0;
                }
            }
            if n_open == 0.0 || n_open == n_all {
                continue;
            }
            let (rays, open) = (2.0 * pairs.of(i).len() as f64, open / n_open);
            shown.beyond_mean[i] = open * (n_all / rays) - all / rays;
            for (met, other) in pairs.both_ways(i).filter(|(met, _)| met.is_near()) {
                if let (Some(j), Some(from)) = (met.patch(), other.patch()) {
                    let share = patches.area[i] / (rays * patches.area[j]);
                    shown.returned[j] += patches.rho[i] * (leaving[from] - open) * share;
                }
            }
        }
        shown
    }

    /// From what the points of each patch found, and the mean direct light of the patches.
    pub fn new(patches: &PatchMesh, looks: &[Looks], mean: &[Rgb]) -> Self {
        let mut shown = Self::none(looks.len());
        for (i, look) in looks.iter().enumerate().filter(|(_, look)| look.n_open > 0 && !look.near.is_empty()) {
            let open = look.open / look.n_open as f64;
            shown.beyond_mean[i] = open - mean[i];
            let share = patches.area[i] / (look.n_open as f64 + look.near.len() as f64);
            for (j, light) in look.near.iter().filter_map(|&(j, light)| Some((j?, light))) {
                shown.returned[j as usize] += patches.rho[i] * (light - open) * (share / patches.area[j as usize]);
            }
        }
        shown
    }
}
