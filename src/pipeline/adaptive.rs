//! Patches that follow the light: a solution tells where radiosity bends, elements there are cut in quarters, and it is solved again.
//!
//! The estimate for a patch is the distance of its radiosity from the plane through those around it ([`Interpolation::bend`]): nothing
//! where radiosity is linear, which interpolation makes of it anyway; the second derivative times the square of the size where it is smooth;
//! the step itself where a shadow ends. Elements are cut until that, weighted by the root of their area in full patches, is below a share of the
//! scene's root mean square, so that all patches leave about alike to the error. Patches beside each other differ by one level at most.

use super::pass_one::{Kept, PassOne, PassOneSettings, solve_from};
use super::{PipelineError, cost::StageCosts};
use crate::patch::{FINEST_LEVEL, PatchMesh};
use crate::progress::{Observer, Stage};
use crate::radiosity::{Interpolation, RadiosityField};
use crate::world::World;
use crate::world::walk::RayCounts;

/// A patch of at least this share of the full size that has none beside it is cut once, so that something can be said of it.
const LONELY: f64 = 0.5;

/// Patches that touch are nearer than this times the sum of their sizes.
const TOUCHING: f32 = 0.75;

/// Solves pass one on patches that are cut again and again where radiosity bends by more than `share` of its root mean square.
///
/// # Errors
/// As [`solve_from`]. What would be too many patches, or take too much memory, is not cut further.
pub(super) fn solve(
    world: &World,
    (settings, seed): (&PassOneSettings, u64),
    (share, mut fresh): (f64, Option<PatchMesh>),
    watch: &mut StageCosts,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Result<PassOne, PipelineError> {
    let mut settings = *settings;
    settings.patches.adaptive = None;
    loop {
        let kept = Kept { fresh, ..Kept::default() };
        let solved = solve_from(world, (&settings, seed), kept, watch, counts, observer)?;
        let finer = watch.time(Stage::Patches, || {
            let marked = marked(world, &solved.field, share);
            let grown = solved.field.patches.len() + 3 * marked.iter().filter(|m| **m).count();
            let fits = settings.max_memory.is_none_or(|limit| settings.predicted(grown) <= limit);
            let is_worth_it = grown > solved.field.patches.len() && grown <= settings.patches.max_patches && fits;
            is_worth_it.then(|| solved.field.patches.refined(world, &marked))
        });
        match finer {
            None => return Ok(solved),
            finer => fresh = finer,
        }
    }
}

/// Which patches are to be cut.
fn marked(world: &World, field: &RadiosityField, share: f64) -> Vec<bool> {
    let patches = &field.patches;
    let around = Interpolation::new(world, field);
    let full = patches.patch_size * patches.patch_size;
    let squared = |i: usize| patches.area[i] * (patches.rho[i] * field.accepted_of(i)).mean().powi(2);
    let total: f64 = patches.area.iter().sum();
    let rms = ((0..patches.len()).map(squared).sum::<f64>() / total).sqrt();
    let mut marked: Vec<bool> = (0..patches.len())
        .map(|i| {
            let size = (patches.area[i] / full).min(1.0);
            patches.is_divisible(i)
                && match around.bend(field, i) {
                    Some(bend) => (patches.rho[i] * bend).mean() * size.sqrt() > share * rms,
                    None => patches.level(i) == 0 && size >= LONELY && !patches.rho[i].is_black(),
                }
        })
        .collect();
    // The finest first: what is beside an element that is cut must not be more than one level behind it then.
    for level in (1..FINEST_LEVEL).rev() {
        for i in 0..patches.len() {
            if !marked[i] || patches.level(i) != level {
                continue;
            }
            for &j in around.neighbours(i) {
                let j = j as usize;
                let apart = patches.centroid[i].distance(patches.centroid[j]);
                let is_beside = apart <= TOUCHING * (patches.cell_size(i) + patches.cell_size(j)) as f32;
                if is_beside && patches.level(j) < level && patches.is_divisible(j) {
                    marked[j] = true;
                }
            }
        }
    }
    marked
}
