//! Final gather: cosine-distributed rays from a diffuse hit read the radiosity of what they meet.
//!
//! The patches are then seen only through an integral over the hemisphere, which hides them; except one that fills much of it, as in
//! a corner, where its mean would show as a seam: what is nearer than its own size is looked at afresh. Light is counted once: a gather ray
//! does not count the emission of a lamp that shadow rays find, unless it came there by a mirror or was bent by glass, where no shadow
//! ray goes.

use super::irradiance_cache::Below;
use super::{
    TwoPass,
    whitted::{Path, Trace},
};
use crate::film::Quantity;
use crate::geometry::Ray;
use crate::material::Scattering;
use crate::math::{Frame, Rgb, Sampler, warp};
use crate::radiosity::RadiosityField;
use crate::world::sight::{Origin, cosine_density};
use crate::world::walk::{Event, RayCounts};
use crate::world::{Shading, ShadowRay, Sight, Stages, SurfaceInteraction};

/// How often in a row a gather ray that ends too near is continued, before it reads a patch all the same.
pub(super) const NEAR_LEVELS: u32 = 4;
/// Highest probability with which light of one more bounce is followed by a single ray.
const MOST_SURVIVAL: f64 = 0.95;
/// Bounces that single rays follow at most: one path in five million is longer.
const MOST_FOLLOWED: u32 = 300;

/// What a gather ray brings.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gathered {
    /// Radiance reflected by patches.
    pub reflected: Rgb,
    /// Radiance emitted.
    pub emitted: Rgb,
    /// Distance to the first surface; infinite if there is none.
    pub distance: f32,
}

impl<K: Stages> TwoPass<'_, K> {
    /// Gather rays at a diffuse part of reflectance `rho` that the camera sees with weight `weight`: a faint one needs fewer.
    pub(super) fn gather_rays(&self, weight_rho: Rgb) -> u32 {
        let wanted = self.settings.gather_rays;
        ((f64::from(wanted) * weight_rho.max().min(1.0).sqrt()).ceil() as u32).clamp(1, wanted)
    }

    /// Adds what the diffuse part at `si` reflects of the light that `rays` cosine-distributed rays find.
    pub(super) fn gather(
        &self,
        si: &SurfaceInteraction,
        shading: &Shading<'_>,
        weight: Rgb,
        depth: u32,
        rays: u32,
        trace: &mut Trace<'_>,
    ) {
        let frame = Frame::new(shading.normal());
        let (mut indirect, mut caustic) = (Rgb::BLACK, Rgb::BLACK);
        for k in 0..rays {
            // Gather rays of one pixel are one sequence over all passes, so that they are stratified among each other.
            let wanted = u64::from(self.settings.gather_rays);
            let mut sampler =
                Sampler::of(self.settings.sampler, u64::from(depth), trace.key, trace.index * wanted + u64::from(k));
            let local = warp::cosine_hemisphere(sampler.next_2d());
            let direction = frame.to_world(local);
            let response = shading.eval(direction).diffuse;
            if response.is_black() {
                continue;
            }
            let density = cosine_density(1.0, local.z);
            let origin = Origin {
                point: si.point,
                receiver: shading.receiver(),
                density: density * f64::from(rays),
                sampling: self.settings.direct,
            };
            trace.counts.gather += 1;
            let found = self.gathered(si.spawn(direction), Sight::Gather(origin), depth, &mut sampler, trace.counts);
            indirect += response / density * found.reflected;
            caustic += response / density * found.emitted;
        }
        let share = weight / f64::from(rays);
        *trace.sample.layer(Quantity::Indirect) += share * indirect;
        *trace.sample.layer(Quantity::Caustic) += share * caustic;
    }

    /// Radiance along one gather ray: reflected by patches, and emitted.
    pub(super) fn gathered(&self, ray: Ray, sight: Sight, depth: u32, sampler: &mut Sampler, counts: &mut RayCounts) -> Gathered {
        self.gathered_within(ray, sight, depth, NEAR_LEVELS, sampler, counts)
    }

    /// As [`Self::gathered`], where surfaces too near to be seen as patches are looked at afresh, `levels` times in a row at most.
    fn gathered_within(
        &self,
        ray: Ray,
        sight: Sight,
        depth: u32,
        levels: u32,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
    ) -> Gathered {
        if K::PLAIN {
            return self.plain_gathered((&ray, &self.world.outlook::<K>(ray.origin)), depth, levels, sampler, counts);
        }
        let mut distance = f32::INFINITY;
        let mut near: Option<(SurfaceInteraction, Rgb, u32)> = None;
        let mut to_light: Vec<(SurfaceInteraction, Rgb, u32)> = Vec::new();
        let mut to_correct: Vec<(SurfaceInteraction, Rgb, u32)> = Vec::new();
        let scene = self.world.scene();
        let limit = self.settings.max_depth.unwrap_or(u32::MAX);
        let (mut reflected, mut emitted) = (Rgb::BLACK, Rgb::BLACK);
        self.world.follow_by::<K>(ray, sight, sampler, limit.saturating_sub(depth + 1), counts, |event| match event {
            Event::Surface { at, shading, throughput, through, emission_share, by_ideal_lobes } => {
                if through == 0 {
                    distance = at.t;
                }
                let shape = &scene.shapes[at.shape as usize];
                let by_particles =
                    by_ideal_lobes && self.caustics.is_some() && self.world.partition().found_by_shadow_rays(at.shape as usize);
                if at.front && emission_share > 0.0 && !by_particles {
                    emitted += throughput * shape.emitted(at.uv) * emission_share;
                }
                if self.residual.is_some() {
                    if shading.has_diffuse() && depth + through + 3 <= limit {
                        to_correct.push((*at, throughput, through));
                    }
                } else if let Some(field) = self.field
                    && depth + through + 3 <= limit
                {
                    let rho = shading.diffuse_reflectance();
                    if !rho.is_black() {
                        let stored = field.at(at);
                        if levels > 0 && near.is_none() && stored.is_near {
                            near = Some((*at, throughput, through));
                        } else {
                            reflected += RadiosityField::reflected_radiance(throughput * rho, stored.irradiance);
                        }
                    }
                } else if self.below.is_some() && shading.has_diffuse() && depth + through + 3 <= limit {
                    to_light.push((*at, throughput, through));
                }
            }
            Event::Lit { radiance, through } => {
                if depth + through + 3 <= limit {
                    emitted += radiance;
                }
            }
            Event::Escaped { direction, throughput, share, .. } => {
                if K::DISTANT {
                    emitted += throughput * scene.escaped_radiance(direction) * share;
                }
            }
            Event::Truncated { .. } => {}
        });
        if let Some((si, throughput, through)) = near {
            reflected += throughput * self.near(&si, depth + through + 1, levels - 1, sampler, counts);
        }
        if let Some(below) = &self.below {
            for (si, throughput, through) in to_light {
                reflected += throughput * self.lit(&si, below, depth + through + 1, sampler, counts);
            }
        }
        for (si, throughput, through) in to_correct {
            reflected += throughput * self.corrected(&si, depth + through + 1, sampler, counts);
        }
        Gathered { reflected, emitted, distance }
    }

    /// Radiance that the diffuse part at `si` reflects, right in the mean whatever is stored for it: the stored value as a control
    /// variate, and with some probability the difference of a fresh look from it, over that probability. The fresh look's gather ray
    /// reads what it meets in the same way.
    fn corrected(&self, si: &SurfaceInteraction, depth: u32, sampler: &mut Sampler, counts: &mut RayCounts) -> Rgb {
        let rho = self.world.shading(si).diffuse_reflectance();
        let stored = self.field.map_or(Rgb::BLACK, |field| RadiosityField::reflected_radiance(rho, field.at(si).irradiance));
        let probability = self.residual.unwrap_or(1.0);
        if f64::from(sampler.next_1d()) >= probability {
            return stored;
        }
        stored + (self.near(si, depth, NEAR_LEVELS, sampler, counts) - stored) / probability
    }

    /// Radiance that the diffuse part at `si` reflects, by one shadow ray and the records of the bounce before, or one gather ray where none
    /// reaches.
    fn lit(&self, si: &SurfaceInteraction, below: &Below<'_>, depth: u32, sampler: &mut Sampler, counts: &mut RayCounts) -> Rgb {
        let shading = self.world.shading_by::<K>(si);
        let stored = below.irradiance(si, shading.normal());
        if stored.is_none()
            && depth < MOST_FOLLOWED
            && let Some(next) = below.next()
        {
            // What roulette leaves is worth its ray, since each reflection takes away as much.
            let most = if below.caches.is_empty() { MOST_SURVIVAL } else { 1.0 };
            let chance = if below.caches.is_empty() { shading.diffuse_reflectance().max().min(most) } else { 1.0 };
            let deeper = TwoPass { below: Some(next), smooth: None, ..*self };
            return deeper.near_by_chance(si, depth, 0, chance, sampler, counts);
        }
        // As many gather rays as the records took to be beside shadow rays.
        let rays = f64::from(self.settings.gather_rays);
        let respond = |ray: &ShadowRay| {
            let share = ray.share_beside_gather_rays(rays, ray.direction.dot(shading.normal()));
            Scattering { diffuse: shading.eval(ray.direction).diffuse * share, glossy: Rgb::BLACK }
        };
        let direct = self.world.direct_by::<K>(si, shading.receiver(), Shading::IN_PASSING, sampler, counts, respond).diffuse;
        direct + RadiosityField::reflected_radiance(shading.diffuse_reflectance(), stored.unwrap_or(Rgb::BLACK))
    }

    /// Radiance that the diffuse part at `si` reflects, by one shadow ray and one gather ray.
    pub(super) fn near(
        &self,
        si: &SurfaceInteraction,
        depth: u32,
        levels: u32,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
    ) -> Rgb {
        self.near_by_chance(si, depth, levels, 1.0, sampler, counts)
    }

    /// As [`Self::near`], with a gather ray that is sent with probability `chance` only and counts for more then.
    fn near_by_chance(
        &self,
        si: &SurfaceInteraction,
        depth: u32,
        levels: u32,
        chance: f64,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
    ) -> Rgb {
        let shading = self.world.shading_by::<K>(si);
        let thrown = self.caustics.map_or(Rgb::BLACK, |map| map.irradiance(si, &shading));
        let thrown = RadiosityField::reflected_radiance(shading.diffuse_reflectance(), thrown);
        let respond = |ray: &ShadowRay| {
            let share = ray.share_beside_gather_rays(chance, ray.direction.dot(shading.normal()));
            Scattering { diffuse: shading.eval(ray.direction).diffuse * share, glossy: Rgb::BLACK }
        };
        let direct = self.world.direct_by::<K>(si, shading.receiver(), Shading::IN_PASSING, sampler, counts, respond).diffuse;
        if chance < 1.0 && f64::from(sampler.next_1d()) >= chance {
            return direct + thrown;
        }
        let local = warp::cosine_hemisphere(sampler.next_2d());
        let direction = Frame::new(shading.normal()).to_world(local);
        let density = cosine_density(chance, local.z);
        let weight = match shading.plain() {
            // Directions are as dense as what a Lambertian surface makes of them.
            Some(rho) if shading.wo.z > 0.0 && direction.dot(shading.normal()) > 0.0 => rho / chance,
            Some(_) => Rgb::BLACK,
            None => shading.eval(direction).diffuse / density,
        };
        if weight.is_black() {
            return direct + thrown;
        }
        let sampling = Shading::IN_PASSING;
        let origin = Origin { point: si.point, receiver: shading.receiver(), density, sampling };
        counts.gather += 1;
        let found = self.gathered_within(si.spawn(direction), Sight::Gather(origin), depth, levels, sampler, counts);
        direct + thrown + weight * (found.reflected + found.emitted)
    }
}

impl<K: Stages> TwoPass<'_, K> {
    /// Direct and remaining irradiance at a receiver, by `samples` shadow and gather rays.
    pub(crate) fn probe_irradiance(&self, at: &SurfaceInteraction, key: u64, samples: u64) -> (Rgb, Rgb, RayCounts) {
        let mut counts = RayCounts::default();
        let frame = Frame::new(at.ns);
        let (mut direct, mut rest) = (Rgb::BLACK, Rgb::BLACK);
        for index in 0..samples {
            let mut trace = Trace::new(Sampler::new(self.settings.seed, key, index), key, index, &mut counts);
            direct += self.world.direct_irradiance::<K>(at, self.settings.direct, 1.0, &mut trace.sampler, trace.counts);
            let mut sampler = trace.sampler.clone();
            let local = warp::cosine_hemisphere(sampler.next_2d());
            trace.counts.gather += 1;
            let density = cosine_density(1.0, local.z);
            let origin = Origin { point: at.point, receiver: Some(at.ns), density, sampling: self.settings.direct };
            let ray = at.spawn(frame.to_world(local));
            let found = self.gathered(ray, Sight::Gather(origin), 0, &mut sampler, trace.counts);
            rest += (found.reflected + found.emitted) * std::f64::consts::PI;
        }
        let n = samples as f64;
        (direct / n, rest / n, counts)
    }

    /// Radiance along `ray`, by `samples` camera samples; the first of the pair is what reached the surface seen directly.
    pub(crate) fn probe_radiance(&self, ray: &Ray, key: u64, samples: u64) -> (Rgb, Rgb, RayCounts) {
        let mut counts = RayCounts::default();
        let (mut direct, mut rest) = (Rgb::BLACK, Rgb::BLACK);
        for index in 0..samples {
            let mut trace = Trace::new(Sampler::new(self.settings.seed, key, index), key, index, &mut counts);
            self.radiance(ray, Path::START, &mut trace);
            *trace.sample.layer(Quantity::Direct) += trace.seen;
            let straight = *trace.sample.layer(Quantity::Direct);
            direct += straight;
            rest += trace.sample.radiance() - straight;
        }
        let n = samples as f64;
        (direct / n, rest / n, counts)
    }
}
