//! Irradiance and radiance at given points, with a standard error.

use super::PassOne;
use crate::geometry::Ray;
use crate::integrator::{IntegratorSettings, TwoPass};
use crate::math::{CompensatedSum, DVec3, Rgb, Vec3};
use crate::world::World;
use crate::world::walk::RayCounts;
use rayon::prelude::*;

/// What is found at one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Probed {
    /// Irradiance [W/m²] by light straight from emitters that shadow rays find.
    pub direct: Rgb,
    /// All irradiance [W/m²] (or radiance [W/(m² sr)]).
    pub total: Rgb,
    /// Standard error of the total's luminance.
    pub std_error: f64,
}

/// Independent batches from which the standard error is taken.
const BATCHES: u64 = 16;

/// Irradiance at `points` (file coordinates) facing `normals`, by `samples` shadow and gather rays in all at each.
pub fn irradiance(
    world: &World,
    pass_one: &PassOne,
    settings: &IntegratorSettings,
    points: &[(DVec3, DVec3)],
    samples: u64,
) -> (Vec<Probed>, RayCounts) {
    let tracer = TwoPass { world, field: Some(&pass_one.field), settings: *settings };
    let per_batch = samples.div_ceil(BATCHES).max(1);
    collect(points, |i, (point, n)| {
        let local = (point - world.scene().origin).as_vec3();
        let at = world.receiver_at(local, n.as_vec3().normalize());
        let batches = (0..BATCHES).map(|batch| tracer.probe_irradiance(&at, i as u64 * BATCHES + batch, per_batch));
        summarise(batches.collect())
    })
}

/// Radiance arriving at `points` (file coordinates) from `directions`.
pub fn radiance(
    world: &World,
    pass_one: &PassOne,
    settings: &IntegratorSettings,
    points: &[(DVec3, DVec3)],
    samples: u64,
) -> (Vec<Probed>, RayCounts) {
    let tracer = TwoPass { world, field: Some(&pass_one.field), settings: *settings };
    let per_batch = samples.div_ceil(BATCHES).max(1);
    collect(points, |i, (point, direction)| {
        let ray = Ray::new((point - world.scene().origin).as_vec3(), direction.as_vec3().normalize_or(Vec3::Z));
        let batches = (0..BATCHES).map(|batch| tracer.probe_radiance(&ray, i as u64 * BATCHES + batch, per_batch));
        summarise(batches.collect())
    })
}

fn collect(
    points: &[(DVec3, DVec3)],
    probe: impl Fn(usize, (DVec3, DVec3)) -> (Probed, RayCounts) + Sync,
) -> (Vec<Probed>, RayCounts) {
    let found: Vec<(Probed, RayCounts)> = points.par_iter().enumerate().map(|(i, p)| probe(i, *p)).collect();
    let mut counts = RayCounts::default();
    found.iter().for_each(|(_, c)| counts += *c);
    (found.into_iter().map(|(p, _)| p).collect(), counts)
}

/// Mean of the batches, and the standard error of that mean.
fn summarise(batches: Vec<(Rgb, Rgb, RayCounts)>) -> (Probed, RayCounts) {
    let n = batches.len() as f64;
    let mut counts = RayCounts::default();
    batches.iter().for_each(|(_, _, c)| counts += *c);
    let direct = batches.iter().map(|b| b.0).sum::<Rgb>() / n;
    let total = batches.iter().map(|b| b.0 + b.1).sum::<Rgb>() / n;
    let mean = total.luminance();
    let squares: CompensatedSum = batches.iter().map(|b| ((b.0 + b.1).luminance() - mean).powi(2)).collect();
    let std_error = (squares.value() / (n * (n - 1.0))).sqrt();
    (Probed { direct, total, std_error }, counts)
}
