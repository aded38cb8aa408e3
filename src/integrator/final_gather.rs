//! Final gather: cosine-distributed rays from a diffuse hit read the radiosity of what they meet.
//!
//! The patches are then seen only through an integral over the hemisphere, which hides them. Light is counted once: a gather ray
//! does not count the emission of a lamp that shadow rays find, unless it came there by a mirror or was bent by glass, where no shadow
//! ray goes.

use super::{
    TwoPass,
    whitted::{Path, Trace},
};
use crate::film::Quantity;
use crate::math::{Frame, Rgb, Sampler, warp};
use crate::radiosity::RadiosityField;
use crate::world::SurfaceInteraction;
use crate::world::walk::{Event, RayCounts};

impl TwoPass<'_> {
    /// Adds `weight_rho` times the mean radiance over the cosine-weighted hemisphere.
    pub(super) fn gather(&self, si: &SurfaceInteraction, weight_rho: Rgb, depth: u32, trace: &mut Trace<'_>) {
        // A faint branch of the recursion needs fewer rays.
        let wanted = self.settings.gather_rays;
        let rays = ((f64::from(wanted) * weight_rho.max().min(1.0).sqrt()).ceil() as u32).clamp(1, wanted);
        let frame = Frame::new(si.ns);
        let (mut indirect, mut caustic) = (Rgb::BLACK, Rgb::BLACK);
        for k in 0..rays {
            // Gather rays of one pixel are one sequence over all passes, so that they are stratified among each other.
            let mut sampler = Sampler::new(u64::from(depth), trace.key, trace.index * u64::from(wanted) + u64::from(k));
            let direction = frame.to_world(warp::cosine_hemisphere(sampler.next_2d()));
            if direction.dot(si.ng) <= 0.0 {
                continue;
            }
            trace.counts.gather += 1;
            let (a, b) = self.gathered(si.spawn(direction), depth, &mut sampler, trace);
            indirect += a;
            caustic += b;
        }
        let share = weight_rho / f64::from(rays);
        *trace.sample.layer(Quantity::Indirect) += share * indirect;
        *trace.sample.layer(Quantity::Caustic) += share * caustic;
    }

    /// Radiance along one gather ray: reflected by patches, and emitted.
    fn gathered(&self, ray: crate::geometry::Ray, depth: u32, sampler: &mut Sampler, trace: &mut Trace<'_>) -> (Rgb, Rgb) {
        let scene = self.world.scene();
        let limit = self.settings.max_depth.unwrap_or(u32::MAX);
        let (mut reflected, mut emitted) = (Rgb::BLACK, Rgb::BLACK);
        self.world.follow(ray, sampler, limit.saturating_sub(depth + 1), trace.counts, |event| match event {
            Event::Surface { at, throughput, through, straight } => {
                let shape = &scene.shapes[at.shape as usize];
                let counts = !(straight && self.world.partition().found_by_shadow_rays(at.shape as usize));
                if at.front && counts {
                    emitted += throughput * shape.emitted(at.uv);
                }
                if let Some(field) = self.field
                    && depth + through + 3 <= limit
                {
                    let rho = scene.material_of(shape).material.diffuse_reflectance(at.uv);
                    reflected += RadiosityField::reflected_radiance(throughput * rho, field.irradiance(at));
                }
            }
            Event::Escaped { throughput, direction, .. } => emitted += throughput * scene.escaped_radiance(direction),
            Event::Truncated { .. } => {}
        });
        (reflected, emitted)
    }
}

impl TwoPass<'_> {
    /// Direct and remaining irradiance at a receiver, by `samples` shadow and gather rays.
    pub(crate) fn probe_irradiance(&self, at: &SurfaceInteraction, key: u64, samples: u64) -> (Rgb, Rgb, RayCounts) {
        let mut counts = RayCounts::default();
        let frame = Frame::new(at.ns);
        let (mut direct, mut rest) = (Rgb::BLACK, Rgb::BLACK);
        for index in 0..samples {
            let mut trace = Trace::new(Sampler::new(self.settings.seed, key, index), key, index, &mut counts);
            direct += self.world.direct_irradiance(at, self.settings.direct, &mut trace.sampler, trace.counts);
            let mut sampler = trace.sampler.clone();
            let direction = frame.to_world(warp::cosine_hemisphere(sampler.next_2d()));
            trace.counts.gather += 1;
            let (reflected, emitted) = self.gathered(at.spawn(direction), 0, &mut sampler, &mut trace);
            rest += (reflected + emitted) * std::f64::consts::PI;
        }
        let n = samples as f64;
        (direct / n, rest / n, counts)
    }

    /// Radiance along `ray`, by `samples` camera samples; the first of the pair is what reached the surface seen directly.
    pub(crate) fn probe_radiance(&self, ray: &crate::geometry::Ray, key: u64, samples: u64) -> (Rgb, Rgb, RayCounts) {
        let mut counts = RayCounts::default();
        let (mut direct, mut rest) = (Rgb::BLACK, Rgb::BLACK);
        for index in 0..samples {
            let mut trace = Trace::new(Sampler::new(self.settings.seed, key, index), key, index, &mut counts);
            self.radiance(ray, Path::START, &mut trace);
            let straight = *trace.sample.layer(Quantity::Direct);
            direct += straight;
            rest += trace.sample.radiance() - straight;
        }
        let n = samples as f64;
        (direct / n, rest / n, counts)
    }
}
