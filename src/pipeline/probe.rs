//! Irradiance and radiance at given points, with a standard error.

use super::PassOne;
use crate::geometry::Ray;
use crate::integrator::{IntegratorSettings, TwoPass};
use crate::math::{CompensatedSum, DVec3, Rgb, Vec3};
use crate::world::World;
use crate::world::walk::RayCounts;
use rayon::prelude::*;
use std::marker::PhantomData;

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

/// What probes read: a scene, its solution, and how.
pub struct Prober<'a> {
    /// The scene.
    pub world: &'a World,
    /// The solution.
    pub pass_one: &'a PassOne,
    /// How pass two reads it.
    pub settings: IntegratorSettings,
    /// Shadow and gather rays, or camera samples, at each point; rounded up to batches.
    pub samples: u64,
}

/// One point's share of a batch: direct light, the rest, and the rays they cost.
type Batch = (Rgb, Rgb, RayCounts);

impl Prober<'_> {
    /// Irradiance at `points` (file coordinates) facing their normals.
    pub fn irradiance(&self, points: &[(DVec3, DVec3)]) -> (Vec<Probed>, RayCounts) {
        self.probe(points, |tracer, point, n, key, samples| {
            tracer.probe_irradiance(&self.world.receiver_at(point, n.normalize()), key, samples)
        })
    }

    /// Radiance arriving at `points` (file coordinates) from their directions.
    pub fn radiance(&self, points: &[(DVec3, DVec3)]) -> (Vec<Probed>, RayCounts) {
        self.probe(points, |tracer, point, direction, key, samples| {
            tracer.probe_radiance(&Ray::new(point, direction.normalize_or(Vec3::Z)), key, samples)
        })
    }

    fn probe(
        &self,
        points: &[(DVec3, DVec3)],
        one: impl Fn(&TwoPass<'_>, Vec3, Vec3, u64, u64) -> Batch + Sync,
    ) -> (Vec<Probed>, RayCounts) {
        let tracer: TwoPass<'_> = TwoPass {
            world: self.world,
            field: Some(&self.pass_one.field),
            settings: self.settings,
            cache: None,
            caustics: None,
            ambient: 0.0,
            below: None,
            residual: None,
            smooth: None,
            stages: PhantomData,
        };
        let per_batch = self.samples.div_ceil(BATCHES).max(1);
        let found: Vec<(Probed, RayCounts)> = points
            .par_iter()
            .enumerate()
            .map(|(i, (point, direction))| {
                let local = (*point - self.world.scene().origin).as_vec3();
                let key = |batch: u64| i as u64 * BATCHES + batch;
                summarise((0..BATCHES).map(|b| one(&tracer, local, direction.as_vec3(), key(b), per_batch)).collect())
            })
            .collect();
        let mut counts = RayCounts::default();
        found.iter().for_each(|(_, c)| counts += *c);
        (found.into_iter().map(|(p, _)| p).collect(), counts)
    }
}

/// Mean of the batches, and the standard error of that mean.
fn summarise(batches: Vec<Batch>) -> (Probed, RayCounts) {
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
