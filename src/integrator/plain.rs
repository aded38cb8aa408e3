//! Camera and gather rays in scenes of flat walls that reflect diffusely and alike all over: what is left of Whitted's recursion and of the
//! final gather where nothing else is needed. Same numbers as [`super::whitted`] and [`super::final_gather`], bit for bit; the laws of
//! the plan hold both against each other.

use super::final_gather::Gathered;
use super::irradiance_cache::Gap;
use super::whitted::{Path, Trace};
use super::{ReadOut, TwoPass};
use crate::film::Quantity;
use crate::geometry::Ray;
use crate::material::{Lambert, Scattering};
use crate::math::{Frame, Rgb, Sampler, warp};
use crate::radiosity::RadiosityField;
use crate::world::convex::Outlook;
use crate::world::flat::FlatHit;
use crate::world::sight::cosine_density;
use crate::world::walk::RayCounts;
use crate::world::{Shading, ShadowRay, Stages};

impl<K: Stages> TwoPass<'_, K> {
    /// Adds what arrives along a camera ray to the sample.
    pub(super) fn plain_radiance(&self, ray: &Ray, path: Path, trace: &mut Trace<'_>) {
        let limit = self.depth_limit();
        if limit == 0 {
            trace.counts.truncate(path.weight);
            return;
        }
        let Some(met) = self.world.meet_flat::<K>(ray) else { return };
        *trace.sample.layer(Quantity::Depth) += Rgb::grey(f64::from(met.t));
        *trace.sample.layer(Quantity::Normal) += Rgb::from(met.normal.to_array());
        let shape = &self.world.scene().shapes[met.shape as usize];
        if met.front && shape.emits() {
            trace.seen += shape.emitted(crate::math::Vec2::ZERO);
        }
        if !met.diffuse {
            return;
        }
        if trace.glances {
            self.plain_stored(&met, trace);
            return;
        }
        let si = self.world.flat_interaction(&met);
        if self.field.is_none() || self.settings.read_out != ReadOut::FinalGather {
            let shading = self.world.shading_by::<K>(&si);
            self.local(&si, &shading, 0.0, &path, trace);
            return;
        }
        let (rho, normal) = (met.rho, met.normal);
        let reflect = |h: Rgb| RadiosityField::reflected_radiance(rho, h);
        self.plain_stored(&met, trace);
        if limit < 2 || rho.is_black() {
            return;
        }
        if let Some(collect) = &mut trace.collect {
            if !collect.cache.has(&si, normal) {
                collect.gaps.push(Gap { si, pixel: collect.per_distance * (path.length + si.t) });
            }
            return;
        }
        let cached = self.cache.and_then(|cache| cache.read_on_flat::<K>(&met, si.point));
        let lambert = Lambert { frame: Frame::new(normal), rho };
        let respond = |ray: &ShadowRay| Scattering { diffuse: lambert.eval(ray.direction), glossy: Rgb::BLACK };
        let sampling = self.settings.direct;
        let direct = self.world.direct_by::<K>(&si, Some(normal), sampling, &mut trace.sampler, trace.counts, respond);
        *trace.sample.layer(Quantity::Direct) += direct.diffuse;
        match cached {
            Some(found) => {
                *trace.sample.layer(Quantity::Indirect) += reflect(found.reflected);
                *trace.sample.layer(Quantity::Caustic) += reflect(found.emitted);
            }
            None => {
                let shading = self.world.shading_by::<K>(&si);
                self.gather(&si, &shading, path.weight, 0, self.gather_rays(rho), trace);
            }
        }
    }

    /// What pass one knows of a wall.
    #[inline(always)]
    fn plain_stored(&self, met: &FlatHit, trace: &mut Trace<'_>) {
        *trace.sample.layer(Quantity::Albedo) += met.rho;
        let Some(field) = self.field else { return };
        let Some(patch) = field.patch_on_flat(met) else { return };
        *trace.sample.layer(Quantity::Radiosity) += RadiosityField::reflected_radiance(met.rho, field.accepted_of(patch));
        *trace.sample.layer(Quantity::Irradiance) += field.irradiance_of(patch);
    }

    /// Radiance along one gather ray: as by [`super::final_gather`].
    #[inline(always)]
    pub(super) fn plain_gathered(
        &self,
        (ray, outlook): (&Ray, &Option<Outlook>),
        depth: u32,
        levels: u32,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
    ) -> Gathered {
        let mut found = Gathered { reflected: Rgb::BLACK, emitted: Rgb::BLACK, distance: f32::INFINITY };
        let Some(met) = self.world.meet_flat_from::<K>(outlook, ray) else { return found };
        found.distance = met.t;
        if met.front && self.world.partition().leaves_some() && !self.world.partition().found_by_shadow_rays(met.shape as usize) {
            found.emitted = self.world.scene().shapes[met.shape as usize].emitted(crate::math::Vec2::ZERO);
        }
        if met.rho.is_black() || depth + 3 > self.settings.max_depth.unwrap_or(u32::MAX) {
            return found;
        }
        let Some(field) = self.field else { return found };
        let Some(patch) = field.patch_on_flat(&met) else { return found };
        let stored = field.of_patch(patch, met.t);
        found.reflected = if levels > 0 && stored.is_near {
            self.plain_near(&met, depth + 1, levels - 1, sampler, counts)
        } else {
            RadiosityField::reflected_radiance(met.rho, stored.irradiance)
        };
        found
    }

    /// Radiance that a wall reflects, by one shadow ray and one gather ray: as by [`super::final_gather`].
    fn plain_near(&self, met: &FlatHit, depth: u32, levels: u32, sampler: &mut Sampler, counts: &mut RayCounts) -> Rgb {
        let si = self.world.flat_interaction(met);
        let lambert = Lambert { frame: Frame::new(met.normal), rho: met.rho };
        let respond = |ray: &ShadowRay| Scattering { diffuse: lambert.eval(ray.direction), glossy: Rgb::BLACK };
        let direct = self.world.direct_by::<K>(&si, Some(met.normal), Shading::IN_PASSING, sampler, counts, respond).diffuse;
        let local = warp::cosine_hemisphere(sampler.next_2d());
        let direction = lambert.frame.to_world(local);
        let response = lambert.eval(direction);
        if response.is_black() {
            return direct;
        }
        let density = cosine_density(1.0, local.z);
        counts.gather += 1;
        let ray = si.spawn(direction);
        let found = self.plain_gathered((&ray, &self.world.outlook::<K>(ray.origin)), depth, levels, sampler, counts);
        direct + response / density * (found.reflected + found.emitted)
    }
}
