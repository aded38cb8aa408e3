//! Path tracing [Kajiya86]: every light path by a random walk from the camera, no first pass, no bias.
//!
//! The baseline that the two-pass methods are measured against: the same rays, materials and lights. At each surface one
//! shadow ray (more for suns and surroundings) and one ray of the material share the light that both can find [Veach95]. Neighbouring
//! pixels lend each other what their paths find after the first bounce ([`super::path_tiles`]), if they are to.

use super::{Frame, Integrator, IntegratorSettings, PathFilter};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::material::Scattering;
use crate::math::{Rgb, Sampler, Vec2, Vec3, warp};
use crate::world::lamps::Lamps;
use crate::world::plane_mirrors::PlaneMirrors;
use crate::world::shading::ScatteredRay;
use crate::world::sight::{Origin, power_share};
use crate::world::walk::{RayCounts, most_survival};
use crate::world::{All, Shading, ShadowRay, Sight, Stages, SurfaceInteraction, World};
use std::f32::consts::FRAC_1_PI;
use std::marker::PhantomData;

/// From this many edges on a path goes on by roulette; Mitsuba's default as well, which makes the two comparable.
pub const ROULETTE_DEPTH: u32 = 5;

/// A path goes on with this many times its throughput as the probability. With the throughput itself, long paths are few and
/// heavy: in a room of light walls twice as many make the squared error a fifth smaller for a tenth more time, four times as many nothing more.
const SURVIVAL: f64 = 2.0;

/// Shadow rays where the camera looks, if there is a choice of lamps.
const LOOKS: u32 = 2;

/// Fraction of the golden ratio: multiples of it fill [0, 1) evenly.
const GOLDEN: f32 = 0.618_034;

/// No path is longer, whatever the scene asks; at the survival above, one path in 10^11 is.
const DEEPEST: u32 = 512;

/// A unidirectional path tracer.
pub struct PathTracer<'a, K: Stages = All> {
    /// The scene.
    pub world: &'a World,
    /// Settings; of the read-out and the gather rays it makes no use.
    pub settings: IntegratorSettings,
    /// Which paths count; `None`: all.
    pub filter: Option<PathFilter>,
    /// Neighbouring pixels lend each other their paths; not together with a filter.
    pub lends: bool,
    /// Which mirrors are flat, if somebody asks for letters.
    pub mirrors: Option<PlaneMirrors>,
    /// The lamps, where there are few and nothing else shines.
    pub lamps: Option<Lamps>,
    /// The stages that its code holds.
    pub stages: PhantomData<K>,
}

/// A path on its way to the next surface.
#[derive(Debug, Clone)]
pub(super) struct Walk {
    pub ray: Ray,
    /// Radiance at its start over radiance along the ray.
    pub throughput: Rgb,
    /// What the throughput is multiplied by for roulette: where a path starts anew with throughput 1, what it had before.
    pub share: f64,
    /// Factor of the last surface.
    pub weight: Rgb,
    /// Product of the relative indices passed: squared, it takes back the n² scaling of radiance.
    pub eta: f64,
    pub sight: Sight,
    /// Edges so far.
    pub depth: u32,
    /// Surfaces so far that were not ideal mirrors, glass or holes.
    pub scattered: u32,
    /// Their letters, if somebody asks.
    pub word: Vec<u8>,
}

impl Walk {
    /// From the camera.
    pub fn new(ray: Ray) -> Self {
        let (throughput, weight, word) = (Rgb::WHITE, Rgb::WHITE, Vec::new());
        Self { ray, throughput, share: 1.0, weight, eta: 1.0, sight: Sight::Alone, depth: 0, scattered: 0, word }
    }
}

/// A surface that a path has come to.
pub(super) struct Place<'a> {
    pub si: &'a SurfaceInteraction,
    pub shading: Shading<'a>,
    /// Its reflectance, if it is nothing but Lambertian.
    pub plain: Option<Rgb>,
}

impl Place<'_> {
    /// True if it scatters light into more than single directions.
    #[inline]
    pub fn scatters(&self) -> bool {
        self.plain.is_some() || self.shading.has_diffuse() || self.shading.has_glossy()
    }

    /// f |cos theta| for light from `direction`, and the density per steradian with which a path goes on there.
    #[inline]
    pub fn response(&self, direction: Vec3) -> (Rgb, f64) {
        match self.plain {
            Some(rho) => {
                let cos = direction.dot(self.shading.normal());
                if cos <= 0.0 || direction.dot(self.si.ng) <= 0.0 {
                    return (Rgb::BLACK, 0.0);
                }
                let density = f64::from(cos * FRAC_1_PI);
                (rho * density, density)
            }
            None => {
                let response = self.shading.eval(direction).total();
                (response, if response.is_black() { 0.0 } else { self.shading.pdf(direction) })
            }
        }
    }

    /// Where a path goes on.
    #[inline]
    fn sample(&self, sampler: &mut Sampler) -> Option<ScatteredRay> {
        let u = sampler.next_2d();
        let Some(rho) = self.plain else {
            let choice = if self.shading.material.needs_choice() { sampler.next_1d() } else { 0.0 };
            return self.shading.sample(u, choice);
        };
        let local = warp::cosine_hemisphere(u);
        let direction = crate::math::Frame::new(self.shading.normal()).to_world(local);
        let density = Some(f64::from(local.z * FRAC_1_PI));
        (direction.dot(self.si.ng) > 0.0).then_some(ScatteredRay { direction, weight: rho, density, straight: false, eta: 1.0 })
    }
}

impl<K: Stages> Integrator for PathTracer<'_, K> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        if self.lends {
            return self.pass_by_tiles(frame, index);
        }
        super::each_pixel(self.world, &self.settings, frame, index, |mut start, counts| {
            let mut sample = PixelSample::default();
            self.follow(Walk::new(start.ray), &mut start.sampler, counts, &mut sample);
            sample
        })
    }
}

impl<K: Stages> PathTracer<'_, K> {
    fn counts_as(&self, word: &[u8]) -> bool {
        self.filter.as_ref().is_none_or(|filter| filter.has(word))
    }

    fn limit(&self) -> u32 {
        self.settings.max_depth.map_or(DEEPEST, |d| d.min(DEEPEST))
    }

    /// Adds what arrives along a walk, by one path.
    pub(super) fn follow(&self, mut walk: Walk, sampler: &mut Sampler, counts: &mut RayCounts, sample: &mut PixelSample) {
        while let Some(si) = self.arrive(&walk, counts, sample) {
            let place = self.place(&si, counts);
            match self.leave(&walk, &place, sampler, counts, sample) {
                Some(next) => walk = next,
                None => return,
            }
        }
    }

    /// The surface that a walk comes to, its emission counted.
    #[inline]
    pub(super) fn arrive(&self, walk: &Walk, counts: &mut RayCounts, sample: &mut PixelSample) -> Option<SurfaceInteraction> {
        if walk.depth >= self.limit() {
            counts.truncate(walk.throughput * walk.share);
            return None;
        }
        let scene = self.world.scene();
        let Some(si) = self.world.intersect_by::<K>(&walk.ray) else {
            counts.distant += u64::from(K::DISTANT);
            if K::DISTANT && self.counts_as(&walk.word) {
                let share = self.world.escape_share(&walk.sight, walk.ray.direction);
                *sample.layer(layer_of(walk)) += walk.throughput * scene.escaped_radiance(walk.ray.direction) * share;
            }
            return None;
        };
        if walk.depth == 0 {
            *sample.layer(Quantity::Depth) += Rgb::grey(f64::from(si.t));
            *sample.layer(Quantity::Normal) += Rgb::from(si.ns.to_array());
        }
        let shape = &scene.shapes[si.shape as usize];
        if si.front && shape.emits() && self.counts_as(&walk.word) {
            *sample.layer(layer_of(walk)) += walk.throughput * shape.emitted(si.uv) * self.emission_share(walk, &si);
        }
        Some(si)
    }

    /// Share of the emission at `si` that the walk counts, beside shadow rays from where it comes from.
    #[inline]
    fn emission_share(&self, walk: &Walk, si: &SurfaceInteraction) -> f64 {
        let direction = walk.ray.direction;
        if let (Some(lamps), Sight::Scattered(origin)) = (&self.lamps, &walk.sight)
            && let Some(density) = lamps.density(origin, direction, si)
        {
            return power_share(origin.density, density);
        }
        self.world.emission_share(&walk.sight, direction, si)
    }

    /// What is known of a surface.
    #[inline]
    pub(super) fn place<'b>(&'b self, si: &'b SurfaceInteraction, counts: &mut RayCounts) -> Place<'b> {
        counts.met::<K>();
        counts.lobes += u64::from(K::SPECULAR);
        let shading = self.world.shading_by::<K>(si);
        let plain = shading.plain();
        Place { si, shading, plain }
    }

    /// The same once more, its reflectance known.
    #[inline]
    pub(super) fn place_again<'b>(&'b self, si: &'b SurfaceInteraction, plain: Option<Rgb>) -> Place<'b> {
        Place { si, shading: self.world.shading_by::<K>(si), plain }
    }

    /// Adds the light of lamps there and goes on; `None`: the path ends.
    #[inline]
    pub(super) fn leave(
        &self,
        walk: &Walk,
        place: &Place<'_>,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
        sample: &mut PixelSample,
    ) -> Option<Walk> {
        if walk.scattered == 0 {
            *sample.layer(Quantity::Albedo) +=
                walk.throughput * place.plain.unwrap_or_else(|| place.shading.diffuse_reflectance());
        }
        if walk.depth + 2 <= self.limit() && place.scatters() {
            let layer = if walk.scattered == 0 { Quantity::Direct } else { Quantity::Indirect };
            // What the camera sees is lit by the noise of single looks; after a bounce that of the bounce is larger.
            let looks = if walk.scattered == 0 && self.lamps.as_ref().is_some_and(Lamps::is_choice) { LOOKS } else { 1 };
            let found = self.direct(place, looks, sampler, counts);
            if self.filter.is_none() || self.counts_as(&[&walk.word[..], b"D"].concat()) {
                *sample.layer(layer) += walk.throughput * found;
            }
        }
        let next = place.sample(sampler)?;
        let (mut weight, eta) = (next.weight, walk.eta * next.eta);
        if walk.depth + 1 >= ROULETTE_DEPTH {
            let survival = ((walk.throughput * weight).max() * walk.share * eta * eta * SURVIVAL)
                .min(most_survival(next.density.is_none(), walk.depth + 1));
            if survival < 1.0 && f64::from(sampler.next_1d()) >= survival {
                return None;
            }
            weight = weight / survival;
        }
        let mut word = Vec::new();
        if self.filter.is_some() {
            word.clone_from(&walk.word);
            if !next.straight {
                let is_flat = || self.mirrors.as_ref().is_some_and(|mirrors| mirrors.window_of(place.si).is_some());
                word.push(if next.density.is_some() { b'D' } else { PathFilter::ideal(is_flat()) });
            }
        }
        let sight = match next.density {
            Some(density) => {
                let sampling = Shading::IN_PASSING;
                Sight::Scattered(Origin { point: place.si.point, receiver: place.shading.receiver(), density, sampling })
            }
            // Straight on, the ray still looks where it was sent.
            None if next.straight => walk.sight,
            None => Sight::Alone,
        };
        if next.direction.dot(place.si.ng) < 0.0 {
            counts.transmitted += 1;
        } else {
            counts.reflected += 1;
        }
        Some(Walk {
            ray: place.si.spawn(next.direction),
            throughput: walk.throughput * weight,
            share: walk.share,
            weight,
            eta,
            sight,
            depth: walk.depth + 1,
            scattered: walk.scattered + u32::from(next.density.is_some()),
            word,
        })
    }

    /// Light of lamps and surroundings that `place` sends to the viewer, by shadow rays, `looks` where there are some lamps: their share
    /// beside the ray that goes on.
    #[inline]
    fn direct(&self, place: &Place<'_>, looks: u32, sampler: &mut Sampler, counts: &mut RayCounts) -> Rgb {
        let respond = |direction: Vec3, density: f64| {
            let (response, other) = place.response(direction);
            if response.is_black() { response } else { response * power_share(density, other) }
        };
        let (Some(lamps), Some(normal)) = (&self.lamps, place.shading.receiver()) else {
            let respond = |ray: &ShadowRay| Scattering { diffuse: respond(ray.direction, ray.density), glossy: Rgb::BLACK };
            return self
                .world
                .direct_by::<K>(place.si, place.shading.receiver(), Shading::IN_PASSING, sampler, counts, respond)
                .diffuse;
        };
        let view = lamps.seen_from(place.si.point, normal);
        let shift = if lamps.is_choice() { sampler.next_1d() } else { 0.0 };
        counts.light_choices += u64::from(lamps.is_choice());
        let mut sum = Rgb::BLACK;
        let first = sampler.next_2d();
        let share = 1.0 / f64::from(looks);
        for look in 0..looks {
            let along = look as f32 / looks as f32;
            let choice = along + shift / looks as f32;
            // Points of the looks lie apart, each of them anywhere with the same chance.
            let shifted = first + Vec2::new(along, look as f32 * GOLDEN);
            let Some(lamp) = view.sample(choice, shifted - shifted.floor()) else { continue };
            let response = respond(lamp.direction, lamp.density);
            if response.is_black() {
                continue;
            }
            counts.shadow += 1;
            counts.visibility += u64::from(K::VISIBILITY);
            let seen = if K::VISIBILITY { self.world.transmittance(&place.si.spawn_to(lamp.target)) } else { Rgb::WHITE };
            if seen.is_black() {
                continue;
            }
            sum += response * lamp.radiance * seen * (share / lamp.density);
        }
        sum
    }
}

/// Where emission is recorded that a walk meets.
#[inline]
fn layer_of(walk: &Walk) -> Quantity {
    match (walk.scattered, &walk.sight) {
        (0, _) | (1, Sight::Scattered(_)) => Quantity::Direct,
        (1, _) => Quantity::Caustic,
        _ => Quantity::Indirect,
    }
}
