//! Camera and gather rays in scenes of flat walls that reflect diffusely and alike all over: what is left of Whitted's recursion and of the
//! final gather where nothing else is needed. Same numbers as [`super::whitted`] and [`super::final_gather`], bit for bit; the laws of
//! the plan hold both against each other.

use super::final_gather::Gathered;
use super::irradiance_cache::Gap;
use super::whitted::{Path, Trace};
use super::{ReadOut, TwoPass};
use crate::accel::{Work, widest};
use crate::film::Quantity;
use crate::geometry::Ray;
use crate::material::{Lambert, Scattering};
use crate::math::{Frame, Rgb, Sampler, warp};
use crate::radiosity::RadiosityField;
use crate::world::convex::Outlook;
use crate::world::flat::FlatHit;
use crate::world::walk::RayCounts;
use crate::world::{DirectSampling, Shading, ShadowRay, Stages, SurfaceInteraction};

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
        let reflect = |h: Rgb| in_channels::<K>(RadiosityField::reflected_radiance(rho, h));
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
        let direct = self.plain_direct(&si, rho, self.settings.direct, &mut trace.sampler, trace.counts);
        *trace.sample.layer(Quantity::Direct) += direct;
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
        match self.world.meet_flat_from::<K>(outlook, ray) {
            Some(met) => {
                self.plain_found(&met, depth, levels, |met| self.plain_near(met, depth + 1, levels - 1, sampler, counts))
            }
            None => Gathered { reflected: Rgb::BLACK, emitted: Rgb::BLACK, distance: f32::INFINITY },
        }
    }

    /// Radiance along a gather ray that met a wall; `near` looks at it afresh.
    #[inline(always)]
    pub(super) fn plain_found(&self, met: &FlatHit, depth: u32, levels: u32, near: impl FnOnce(&FlatHit) -> Rgb) -> Gathered {
        let mut found = Gathered { reflected: Rgb::BLACK, emitted: Rgb::BLACK, distance: met.t };
        if met.front && self.world.partition().leaves_some() && !self.world.partition().found_by_shadow_rays(met.shape as usize) {
            found.emitted = self.world.scene().shapes[met.shape as usize].emitted(crate::math::Vec2::ZERO);
        }
        if met.rho.is_black() || depth + 3 > self.settings.max_depth.unwrap_or(u32::MAX) {
            return found;
        }
        let Some(field) = self.field else { return found };
        let Some(patch) = field.patch_on_flat(met) else { return found };
        let stored = field.of_patch(patch, met.t);
        found.reflected =
            if levels > 0 && stored.is_near { near(met) } else { RadiosityField::reflected_radiance(met.rho, stored.irradiance) };
        found
    }

    /// Radiance that a wall of reflectance `rho` reflects of what lamps send straight.
    #[inline(always)]
    fn plain_direct(
        &self,
        si: &SurfaceInteraction,
        rho: Rgb,
        sampling: DirectSampling,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
    ) -> Rgb {
        let lambert = Lambert { normal: si.ng, rho };
        if K::HULL && self.world.partition().shadow_lights().len() <= sampling.lights_per_point {
            return self.world.unhidden::<K>(si, sampling, sampler, counts, |direction| lambert.eval(direction));
        }
        let respond = |ray: &ShadowRay| Scattering { diffuse: lambert.eval(ray.direction), glossy: Rgb::BLACK };
        self.world.direct_by::<K>(si, Some(si.ng), sampling, sampler, counts, respond).diffuse
    }

    /// Radiance that a wall reflects, by one shadow ray and one gather ray: as by [`super::final_gather`].
    pub(super) fn plain_near(
        &self,
        met: &FlatHit,
        depth: u32,
        levels: u32,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
    ) -> Rgb {
        widest(Near { by: self, met, depth, levels, sampler, counts })
    }
}

/// A colour of which only the first channel is computed where one stands for all.
#[inline(always)]
fn in_channels<K: Stages>(colour: Rgb) -> Rgb {
    if K::COLOUR { colour } else { Rgb::grey(colour.r) }
}

/// The work of [`TwoPass::plain_near`].
struct Near<'a, 'b, K: Stages> {
    by: &'a TwoPass<'b, K>,
    met: &'a FlatHit,
    depth: u32,
    levels: u32,
    sampler: &'a mut Sampler,
    counts: &'a mut RayCounts,
}

impl<K: Stages> Work for Near<'_, '_, K> {
    type Output = Rgb;

    #[inline(always)]
    fn run(self) -> Rgb {
        let Self { by, met, depth, levels, sampler, counts } = self;
        let si = by.world.flat_interaction(met);
        let direct = by.plain_direct(&si, met.rho, Shading::IN_PASSING, sampler, counts);
        let local = warp::cosine_hemisphere(sampler.next_2d());
        let direction = Frame::new(met.normal).to_world(local);
        if direction.dot(met.normal) <= 0.0 {
            return direct;
        }
        counts.gather += 1;
        let ray = si.spawn(direction);
        let found = by.plain_gathered((&ray, &by.world.outlook::<K>(ray.origin)), depth, levels, sampler, counts);
        // Directions are as dense as what a Lambertian surface makes of them.
        in_channels::<K>(direct + met.rho * (found.reflected + found.emitted))
    }
}
