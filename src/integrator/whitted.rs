//! Whitted's recursion over the solution of pass one: I = I_local + Kr R + Kt T [Whitted80].

use super::{Frame, Integrator, ReadOut, TwoPass};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::material::Lobe;
use crate::math::{Rgb, Sampler, Vec2, sampler::mix};
use crate::radiosity::RadiosityField;
use crate::world::SurfaceInteraction;
use crate::world::walk::RayCounts;
use rayon::prelude::*;

/// Down to this depth both branches of a dielectric are followed; below it one is chosen at random. With three levels a pane
/// before a glass still branches fully, and a pixel never costs more than eight paths.
const BRANCHING_DEPTH: u32 = 3;
/// From this depth on a path goes on with a probability equal to its throughput.
const ROULETTE_DEPTH: u32 = 8;
/// No recursion goes deeper, whatever the scene asks: a closed box of perfect mirrors would never end.
const DEEPEST: u32 = 512;

/// Where in the recursion a ray is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path {
    /// Radiance at the camera over radiance along the ray.
    pub weight: Rgb,
    /// Specular events so far.
    pub depth: u32,
    /// Power left since branches are chosen at random, without the n² scaling: decides how likely the path goes on.
    survival: f64,
}

impl Path {
    /// A ray from the camera.
    pub const START: Path = Path { weight: Rgb::WHITE, depth: 0, survival: 1.0 };
}

/// What one camera sample carries along its recursion.
pub(super) struct Trace<'a> {
    pub sampler: Sampler,
    /// Key of the pixel's gather rays.
    pub key: u64,
    /// Index of the pass within its half.
    pub index: u64,
    pub counts: &'a mut RayCounts,
    pub sample: PixelSample,
}

impl<'a> Trace<'a> {
    pub fn new(sampler: Sampler, key: u64, index: u64, counts: &'a mut RayCounts) -> Self {
        Self { sampler, key, index, counts, sample: PixelSample::default() }
    }
}

impl Integrator for TwoPass<'_> {
    fn pass(&self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        let mut samples = vec![PixelSample::default(); frame.n_pixels()];
        let row = frame.crop[2].max(1);
        let counts = samples
            .par_chunks_mut(row)
            .enumerate()
            .map(|(y, samples)| {
                let mut counts = RayCounts::default();
                for (x, sample) in samples.iter_mut().enumerate() {
                    *sample = self.camera_sample(frame, y * row + x, index, &mut counts);
                }
                counts
            })
            .reduce(RayCounts::default, |mut a, b| {
                a += b;
                a
            });
        (samples, counts)
    }
}

impl TwoPass<'_> {
    fn camera_sample(&self, frame: &Frame, pixel: usize, pass: u32, counts: &mut RayCounts) -> PixelSample {
        let (x, y) = frame.pixel(pixel);
        // The two halves of the film are scrambled independently: each has its own seed and counts its own samples.
        let seed = mix(self.settings.seed.wrapping_mul(2).wrapping_add(u64::from(pass % 2)));
        let key = (y * frame.width + x) as u64;
        let index = u64::from(pass / 2);
        let mut sampler = Sampler::new(seed, key, index);
        let film_point = Vec2::new(x as f32, y as f32) + sampler.next_2d();
        let ray = self.world.scene().camera.ray(film_point, frame.width, frame.height);
        counts.camera += 1;
        let mut trace = Trace::new(sampler, mix(seed ^ key), index, counts);
        self.radiance(&ray, Path::START, &mut trace);
        trace.sample
    }

    /// Longest path in edges, bounded.
    fn depth_limit(&self) -> u32 {
        self.settings.max_depth.map_or(DEEPEST, |d| d.min(DEEPEST))
    }

    /// Adds what arrives along `ray` to the sample.
    pub(super) fn radiance(&self, ray: &Ray, path: Path, trace: &mut Trace<'_>) {
        let Path { weight, depth, .. } = path;
        if depth >= self.depth_limit() {
            trace.counts.truncate(weight);
            return;
        }
        let Some(si) = self.world.intersect(ray) else {
            *trace.sample.layer(Quantity::Direct) += weight * self.world.scene().escaped_radiance(ray.direction);
            return;
        };
        let shape = &self.world.scene().shapes[si.shape as usize];
        if depth == 0 {
            *trace.sample.layer(Quantity::Depth) += Rgb::grey(f64::from(si.t));
            *trace.sample.layer(Quantity::Normal) += Rgb::from(si.ns.to_array());
        }
        if si.front {
            *trace.sample.layer(Quantity::Direct) += weight * shape.emitted(si.uv);
        }
        let surface = self.world.scene().material_of(shape);
        if surface.material.has_diffuse() {
            if si.front || surface.two_sided {
                let rho = surface.material.diffuse_reflectance(si.uv);
                self.diffuse(&si, rho, weight, depth, trace);
            }
        } else {
            self.recurse(&si, path, trace);
        }
    }

    /// I_local: what a diffuse surface reflects, by the chosen read-out of pass one.
    fn diffuse(&self, si: &SurfaceInteraction, rho: Rgb, weight: Rgb, depth: u32, trace: &mut Trace<'_>) {
        *trace.sample.layer(Quantity::Albedo) += weight * rho;
        let limit = self.depth_limit();
        let weight_rho = weight * rho;
        let reflect = |h: Rgb| RadiosityField::reflected_radiance(weight_rho, h);
        if let Some(field) = self.field {
            let stored = field.irradiance(si);
            *trace.sample.layer(Quantity::Radiosity) += reflect(stored);
            *trace.sample.layer(Quantity::Irradiance) += stored;
            if self.settings.read_out == ReadOut::Stored && depth + 2 <= limit {
                *trace.sample.layer(Quantity::Indirect) += reflect(stored);
                return;
            }
        }
        if depth + 2 > limit || weight_rho.is_black() {
            return;
        }
        let direct = self.world.direct_irradiance(si, self.settings.direct, &mut trace.sampler, trace.counts);
        *trace.sample.layer(Quantity::Direct) += reflect(direct);
        match (self.settings.read_out, self.field) {
            (ReadOut::FinalGather, _) => self.gather(si, weight_rho, depth, trace),
            (_, Some(field)) => *trace.sample.layer(Quantity::Indirect) += reflect(field.rest_irradiance(si)),
            (_, None) => {}
        }
    }

    /// Kr R + Kt T: both branches near the camera, one of them further down.
    fn recurse(&self, si: &SurfaceInteraction, path: Path, trace: &mut Trace<'_>) {
        let Some((lobes, frame)) = self.world.lobes_at(si) else { return };
        let go = |lobe: &Lobe, factor: f64, survival: f64, trace: &mut Trace<'_>| {
            let Some(direction) = self.world.lobe_direction(si, &frame, lobe) else { return };
            if lobe.transmits {
                trace.counts.transmitted += 1;
            } else {
                trace.counts.reflected += 1;
            }
            let path = Path { weight: path.weight * lobe.weight * factor, depth: path.depth + 1, survival };
            self.radiance(&si.spawn(direction), path, trace);
        };
        if path.depth < BRANCHING_DEPTH {
            lobes.iter().for_each(|lobe| go(lobe, 1.0, 1.0, trace));
            return;
        }
        let Some((lobe, probability)) = lobes.choose(trace.sampler.next_1d()) else { return };
        let mut factor = 1.0 / probability;
        let mut survival = path.survival * lobe.power * factor;
        if path.depth >= ROULETTE_DEPTH {
            let go_on = survival.min(0.95);
            if f64::from(trace.sampler.next_1d()) >= go_on {
                return;
            }
            factor /= go_on;
            survival /= go_on;
        }
        go(&lobe, factor, survival, trace);
    }
}
