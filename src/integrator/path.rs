//! Path tracing [Kajiya86]: every light path by one random walk from the camera, nothing stored, no bias.
//!
//! The baseline that the two-pass methods are measured against: the same rays, materials and lights. At each surface one
//! shadow ray (more for suns and surroundings) and one ray of the material share the light that both can find [Veach95].

use super::{Frame, Integrator, IntegratorSettings, PathFilter};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::material::Scattering;
use crate::math::{Rgb, Sampler};
use crate::world::plane_mirrors::PlaneMirrors;
use crate::world::sight::{Origin, power_share};
use crate::world::walk::RayCounts;
use crate::world::{All, Shading, ShadowRay, Sight, Stages, SurfaceInteraction, World};
use std::marker::PhantomData;

/// From this many edges on a path goes on with a probability equal to its throughput; Mitsuba's default as well, which makes the two
/// comparable.
pub const ROULETTE_DEPTH: u32 = 5;

/// No path goes on with a higher probability: a closed room of white walls would never end.
const MOST_SURVIVAL: f64 = 0.95;

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
    /// Which mirrors are flat, if somebody asks for letters.
    pub mirrors: Option<PlaneMirrors>,
    /// The stages that its code holds.
    pub stages: PhantomData<K>,
}

impl<K: Stages> Integrator for PathTracer<'_, K> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        super::each_pixel(self.world, &self.settings, frame, index, |start, counts| {
            let mut sampler = start.sampler;
            self.radiance(start.ray, &mut sampler, counts)
        })
    }
}

impl<K: Stages> PathTracer<'_, K> {
    /// What arrives along `ray`, by one path.
    fn radiance(&self, mut ray: Ray, sampler: &mut Sampler, counts: &mut RayCounts) -> PixelSample {
        let scene = self.world.scene();
        let limit = self.settings.max_depth.map_or(DEEPEST, |d| d.min(DEEPEST));
        let mut sample = PixelSample::default();
        let mut throughput = Rgb::WHITE;
        // Product of the relative indices passed: squared, it takes back the n² scaling of radiance.
        let mut eta = 1.0;
        let mut sight = Sight::Alone;
        // Surfaces so far that were not ideal mirrors, glass or holes.
        let mut scattered = 0;
        // Their letters, if somebody asks.
        let mut word: Vec<u8> = Vec::new();
        let counts_as = |word: &[u8]| self.filter.as_ref().is_none_or(|filter| filter.has(word));
        for depth in 0.. {
            if depth >= limit {
                counts.truncate(throughput);
                break;
            }
            let Some(si) = self.world.intersect_by::<K>(&ray) else {
                counts.distant += u64::from(K::DISTANT);
                if K::DISTANT && counts_as(&word) {
                    let share = self.world.escape_share(&sight, ray.direction);
                    *sample.layer(layer_of(scattered, &sight)) += throughput * scene.escaped_radiance(ray.direction) * share;
                }
                break;
            };
            let shape = &scene.shapes[si.shape as usize];
            if depth == 0 {
                *sample.layer(Quantity::Depth) += Rgb::grey(f64::from(si.t));
                *sample.layer(Quantity::Normal) += Rgb::from(si.ns.to_array());
            }
            if si.front && shape.emits() && counts_as(&word) {
                let share = self.world.emission_share(&sight, ray.direction, &si);
                *sample.layer(layer_of(scattered, &sight)) += throughput * shape.emitted(si.uv) * share;
            }
            let shading = self.world.shading_by::<K>(&si);
            counts.met::<K>();
            counts.lobes += u64::from(K::SPECULAR);
            if scattered == 0 {
                *sample.layer(Quantity::Albedo) += throughput * shading.diffuse_reflectance();
            }
            if depth + 2 <= limit && (shading.has_diffuse() || shading.has_glossy()) {
                let layer = if scattered == 0 { Quantity::Direct } else { Quantity::Indirect };
                let found = self.direct(&si, &shading, sampler, counts);
                if self.filter.is_none() || counts_as(&[&word[..], b"D"].concat()) {
                    *sample.layer(layer) += throughput * found;
                }
            }
            let u = sampler.next_2d();
            let choice = if shading.material.needs_choice() { sampler.next_1d() } else { 0.0 };
            let Some(next) = shading.sample(u, choice) else { break };
            throughput *= next.weight;
            eta *= next.eta;
            if depth + 1 >= ROULETTE_DEPTH {
                let survival = (throughput.max() * eta * eta).min(MOST_SURVIVAL);
                if f64::from(sampler.next_1d()) >= survival {
                    break;
                }
                throughput = throughput / survival;
            }
            if next.density.is_some() {
                scattered += 1;
            }
            if self.filter.is_some() && !next.straight {
                let is_flat = || self.mirrors.as_ref().is_some_and(|mirrors| mirrors.window_of(&si).is_some());
                word.push(if next.density.is_some() { b'D' } else { PathFilter::ideal(is_flat()) });
            }
            sight = match next.density {
                Some(density) => {
                    let sampling = Shading::IN_PASSING;
                    Sight::Scattered(Origin { point: si.point, receiver: shading.receiver(), density, sampling })
                }
                // Straight on, the ray still looks where it was sent.
                None if next.straight => sight,
                None => Sight::Alone,
            };
            if next.direction.dot(si.ng) < 0.0 {
                counts.transmitted += 1;
            } else {
                counts.reflected += 1;
            }
            ray = si.spawn(next.direction);
        }
        sample
    }

    /// Light of lamps and surroundings that `si` sends to the viewer, by shadow rays: their share beside the ray that goes on.
    #[inline]
    fn direct(&self, si: &SurfaceInteraction, shading: &Shading<'_>, sampler: &mut Sampler, counts: &mut RayCounts) -> Rgb {
        let respond = |ray: &ShadowRay| {
            let response = shading.eval(ray.direction).total();
            if response.is_black() {
                return Scattering::default();
            }
            let share = power_share(ray.density, shading.pdf(ray.direction));
            Scattering { diffuse: response * share, glossy: Rgb::BLACK }
        };
        self.world.direct_by::<K>(si, shading.receiver(), Shading::IN_PASSING, sampler, counts, respond).diffuse
    }
}

/// Where emission is recorded that a ray meets after `scattered` surfaces that were not ideal.
#[inline]
fn layer_of(scattered: u32, sight: &Sight) -> Quantity {
    match (scattered, sight) {
        (0, _) | (1, Sight::Scattered(_)) => Quantity::Direct,
        (1, _) => Quantity::Caustic,
        _ => Quantity::Indirect,
    }
}
