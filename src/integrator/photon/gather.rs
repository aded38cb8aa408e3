//! Photon maps with final gather [Jensen96]: a map of all photons, which gather rays read, and one of caustics, which is seen directly.
//!
//! Maps
//! are made anew from round to round, each with twice the passes and twice the photons of the one before, of the two halves of the film
//! by themselves.

use super::maps::Maps;
use super::{Shots, direct, shoot};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::integrator::{Frame, Integrator, IntegratorSettings, Start, each_pixel};
use crate::math::{Frame as Axes, Rgb, Sampler, sampler::mix, warp};
use crate::radiosity::RadiosityField;
use crate::world::sight::{Origin, cosine_density};
use crate::world::walk::{Event, RayCounts};
use crate::world::{Departures, Shading, Sight, SurfaceInteraction, World};

/// Most photons of a map: some 400 MB.
const MOST_PHOTONS: u64 = 4_000_000;
/// No path is longer, whatever the scene asks.
const DEEPEST: u32 = 512;

/// Final gather over photon maps.
pub struct PhotonMapper<'a> {
    world: &'a World,
    departures: Option<Departures>,
    settings: IntegratorSettings,
    /// Photons of the first round; `None`: one for each pixel.
    photons: Option<u32>,
    round: u32,
    round_end: u32,
    maps: [Option<Maps>; 2],
}

impl<'a> PhotonMapper<'a> {
    /// On a scene.
    pub fn new(world: &'a World, settings: IntegratorSettings, photons: Option<u32>) -> Self {
        let departures = Departures::new(world);
        Self { world, departures, settings, photons, round: 0, round_end: 2, maps: [None, None] }
    }

    fn limit(&self) -> u32 {
        self.settings.max_depth.map_or(DEEPEST, |d| d.min(DEEPEST))
    }

    fn make(&self, frame: &Frame, half: usize, counts: &mut RayCounts) -> Option<Maps> {
        let departures = self.departures.as_ref()?;
        let limit = self.limit();
        if limit < 3 {
            return None;
        }
        let first = self.photons.map_or(frame.n_pixels() as u64, u64::from);
        let shots = Shots {
            photons: (first << self.round.min(20)).min(MOST_PHOTONS),
            // The camera's edge, and one more to a surface that is gathered.
            most_edges: limit - 2,
            seed: mix(self.settings.seed ^ mix(0x0070_4071 + u64::from(2 * self.round) + half as u64)),
            sampler: self.settings.sampler,
        };
        let photons = shoot(self.world, departures, &shots, counts);
        Some(Maps::new(self.world, photons, shots.seed))
    }

    /// One camera sample.
    fn radiance(&self, start: Start, maps: Option<&Maps>, counts: &mut RayCounts) -> PixelSample {
        let world = self.world;
        let scene = world.scene();
        let limit = self.limit();
        let mut sample = PixelSample::default();
        if limit == 0 {
            return sample;
        }
        let mut sampler = start.sampler;
        let mut walk_sampler = Sampler::of(self.settings.sampler, mix(start.seed ^ 0x3a1f), start.key, start.index);
        let mut of_walk = RayCounts::default();
        world.follow(start.ray, Sight::Alone, &mut walk_sampler, limit, &mut of_walk, |event| match event {
            Event::Surface { at, shading, throughput, through, emission_share, .. } => {
                if through == 0 {
                    *sample.layer(Quantity::Depth) = Rgb::grey(f64::from(at.t));
                    *sample.layer(Quantity::Normal) = Rgb::from(at.ns.to_array());
                }
                let shape = &scene.shapes[at.shape as usize];
                if at.front && emission_share > 0.0 {
                    *sample.layer(Quantity::Direct) += throughput * shape.emitted(at.uv) * emission_share;
                }
                if !shading.has_diffuse() || through + 2 > limit {
                    return;
                }
                *sample.layer(Quantity::Albedo) += throughput * shading.diffuse_reflectance();
                let rays = self.settings.gather_rays.max(1);
                let lit = direct(world, at, shading, f64::from(rays), self.settings.direct, &mut sampler, counts);
                *sample.layer(Quantity::Direct) += throughput * lit;
                if let Some(maps) = maps {
                    let seed = mix(start.seed ^ mix(start.key ^ mix(start.index))) ^ u64::from(through);
                    *sample.layer(Quantity::Caustic) += throughput * maps.caustic(world, at, shading, seed);
                }
                let key = (mix(start.seed ^ start.key), start.index);
                let [emitted, reflected] = self.gather(at, shading, through, rays, key, maps, counts);
                *sample.layer(Quantity::Direct) += throughput * emitted;
                *sample.layer(Quantity::Indirect) += throughput * reflected;
            }
            Event::Lit { radiance, through } => {
                if through + 2 <= limit {
                    *sample.layer(Quantity::Direct) += radiance;
                }
            }
            Event::Escaped { direction, throughput, share, .. } => {
                *sample.layer(Quantity::Direct) += throughput * scene.escaped_radiance(direction) * share;
            }
            Event::Truncated { .. } => {}
        });
        *counts += of_walk;
        sample
    }

    /// What the diffuse part at `si` reflects of light that `rays` cosine-distributed rays find: emitted, and reflected by what they meet.
    #[expect(clippy::too_many_arguments, reason = "one call site; what a hit knows and what a sample carries")]
    fn gather(
        &self,
        si: &SurfaceInteraction,
        shading: &Shading<'_>,
        through: u32,
        rays: u32,
        (key, index): (u64, u64),
        maps: Option<&Maps>,
        counts: &mut RayCounts,
    ) -> [Rgb; 2] {
        let axes = Axes::new(shading.normal());
        let (mut emitted, mut reflected) = (Rgb::BLACK, Rgb::BLACK);
        let limit = self.limit() - through - 1;
        for k in 0..rays {
            let at = index * u64::from(rays) + u64::from(k);
            let mut sampler = Sampler::of(self.settings.sampler, u64::from(through), key, at);
            let local = warp::cosine_hemisphere(sampler.next_2d());
            let direction = axes.to_world(local);
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
            counts.gather += 1;
            let found = self.gathered(si.spawn(direction), Sight::Gather(origin), limit, &mut sampler, maps, counts);
            let weight = response / (density * f64::from(rays));
            emitted += weight * found[0];
            reflected += weight * found[1];
        }
        [emitted, reflected]
    }

    fn gathered(
        &self,
        ray: Ray,
        sight: Sight,
        limit: u32,
        sampler: &mut Sampler,
        maps: Option<&Maps>,
        counts: &mut RayCounts,
    ) -> [Rgb; 2] {
        let scene = self.world.scene();
        let (mut emitted, mut reflected) = (Rgb::BLACK, Rgb::BLACK);
        self.world.follow(ray, sight, sampler, limit, counts, |event| match event {
            Event::Surface { at, shading, throughput, through, emission_share, by_ideal_lobes } => {
                // The light of lamps by ideal lobes alone is in the map of caustics.
                let by_photons = by_ideal_lobes && self.world.partition().found_by_shadow_rays(at.shape as usize);
                if at.front && emission_share > 0.0 && !by_photons {
                    emitted += throughput * scene.shapes[at.shape as usize].emitted(at.uv) * emission_share;
                }
                if let Some(maps) = maps
                    && through + 2 <= limit
                {
                    let rho = shading.diffuse_reflectance();
                    if !rho.is_black() {
                        reflected += RadiosityField::reflected_radiance(throughput * rho, maps.irradiance(self.world, at));
                    }
                }
            }
            Event::Lit { radiance, through } => {
                if through + 2 <= limit {
                    emitted += radiance;
                }
            }
            Event::Escaped { direction, throughput, share, .. } => {
                emitted += throughput * scene.escaped_radiance(direction) * share;
            }
            Event::Truncated { .. } => {}
        });
        [emitted, reflected]
    }
}

impl Integrator for PhotonMapper<'_> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        while index >= self.round_end {
            self.round += 1;
            self.round_end += 2 << self.round.min(24);
            self.maps = [None, None];
        }
        let half = (index % 2) as usize;
        let mut counts = RayCounts::default();
        if self.maps[half].is_none() {
            self.maps[half] = self.make(frame, half, &mut counts);
        }
        let maps = self.maps[half].as_ref();
        let (samples, c) =
            each_pixel(self.world, &self.settings, frame, index, |start, counts| self.radiance(start, maps, counts));
        counts += c;
        (samples, counts)
    }
}
