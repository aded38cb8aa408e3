//! Photon maps with final gather [Jensen96]: a map of all photons, which gather rays read, and one of caustics, which is seen directly.
//!
//! The irradiance around some of the photons is computed once, by the others, and read by the nearest gather rays ([Christensen99]). Maps
//! are made anew from round to round, each with twice the passes and twice the photons of the one before, of the two halves of the film
//! by themselves.

use super::face::{self, Face, SurfacePoint};
use super::{Photon, PhotonGrid, Shots, Way, direct, face_at, shoot};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::integrator::{Frame, Integrator, IntegratorSettings, Start, each_pixel};
use crate::math::{Frame as Axes, Rgb, Sampler, sampler::mix, warp};
use crate::radiosity::RadiosityField;
use crate::world::sight::{Origin, cosine_density};
use crate::world::walk::{Event, RayCounts};
use crate::world::{Departures, Shading, Sight, SurfaceInteraction, World};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Photons that make an estimate, of all and of caustics.
const NEAREST: [usize; 2] = [80, 40];
/// Widest disk of an estimate over the scene's diagonal.
const WIDEST: f32 = 1.0 / 32.0;
/// Narrowest cell of the grids over the same.
const NARROWEST: f32 = 1.0 / 4096.0;
/// One of so many photons gets the irradiance of its surroundings.
const SPARSE: u64 = 4;
/// Points of a disk that are looked at before its photons are all taken to be seen.
const LOOKS: u32 = 4;
/// Photons that are asked for their irradiance until one is seen.
const MOST_LOOKS: usize = 8;
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

/// Both maps.
struct Maps {
    /// Where irradiance is known: point, normal, value [W/m²].
    known: Vec<(SurfacePoint, Rgb)>,
    known_grid: PhotonGrid,
    caustics: Vec<Photon>,
    caustic_grid: PhotonGrid,
    widest: f32,
    widest_caustic: f32,
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
        let diagonal = self.world.bounds().diagonal();
        let caustics: Vec<Photon> = photons.iter().filter(|p| p.way == Way::Caustic).copied().collect();
        let widest_caustic = radius_for(caustics.len(), NEAREST[1], diagonal);
        // Some are places, the others light them: around a place that is a photon itself there would always be one photon more than elsewhere,
        // and what is nearest to a gather ray's end would be the loneliest.
        let (places, mut lighting): (Vec<_>, Vec<_>) = (0_u64..).zip(photons).partition(|(i, _)| mix(*i).is_multiple_of(SPARSE));
        let share = lighting.len() as f64 / (places.len() + lighting.len()).max(1) as f64;
        lighting.iter_mut().for_each(|(_, p)| p.power = p.power / share);
        let lighting: Vec<Photon> = lighting.into_iter().map(|(_, p)| p).collect();
        let widest = radius_for(lighting.len(), NEAREST[0], diagonal);
        let grid = PhotonGrid::new(lighting.iter().map(|p| p.point), widest);
        let known: Vec<(SurfacePoint, Rgb)> = places
            .par_iter()
            .map(|(i, p)| {
                let at = (p.point, p.normal);
                let face = Face { world: self.world, at, height: 0.1 * widest, least_cosine: 0.9 };
                (at, irradiance(&lighting, &grid, &face, widest, mix(shots.seed ^ mix(*i))))
            })
            .collect();
        let known_grid = PhotonGrid::new(known.iter().map(|k| k.0.0), widest);
        let caustic_grid = PhotonGrid::new(caustics.iter().map(|p| p.point), widest_caustic);
        Some(Maps { known, known_grid, caustics, caustic_grid, widest, widest_caustic })
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

/// Radius that holds about `nearest` of `n` points spread over surfaces as large as the faces of the scene's box.
fn radius_for(n: usize, nearest: usize, diagonal: f32) -> f32 {
    let r = diagonal * (nearest as f32 / n.max(1) as f32 / std::f32::consts::PI * 2.0).sqrt();
    r.clamp(NARROWEST * diagonal, WIDEST * diagonal)
}

/// Irradiance [W/m²] by the nearest photons that the face's point sees, weighted by a cone over their disk.
fn irradiance(photons: &[Photon], grid: &PhotonGrid, face: &Face<'_>, widest: f32, seed: u64) -> Rgb {
    in_disk(photons, grid, face, NEAREST[0], widest, seed, |photon| photon.power)
}

/// Density over a disk around the face's point of `value` of the `nearest` photons, those left out that it does not see, unless
/// nothing seems to stand between.
fn in_disk(
    photons: &[Photon],
    grid: &PhotonGrid,
    face: &Face<'_>,
    nearest: usize,
    widest: f32,
    seed: u64,
    value: impl Fn(&Photon) -> Rgb,
) -> Rgb {
    let mut near: Vec<(f32, u32)> = Vec::new();
    grid.visit(face.at.0, widest, |i| {
        let p = &photons[i as usize];
        let d2 = p.point.distance_squared(face.at.0);
        if d2 < widest * widest && face.holds((p.point, p.normal)) {
            near.push((d2, i));
        }
    });
    let r2 = disk(&mut near, nearest, widest);
    if near.is_empty() {
        return Rgb::BLACK;
    }
    let radius = r2.sqrt();
    let (trials, is_clear) = face.trials(radius, seed, LOOKS, face::as_cone);
    let mut sum = Rgb::BLACK;
    for (d2, i) in near {
        let photon = &photons[i as usize];
        if is_clear || face.sees_photon(photon, radius) {
            sum += value(photon) * cone(d2, r2);
        }
    }
    sum * f64::from(trials)
}

/// Keeps the `nearest` of points by squared distance; squared radius of the disk that they fill.
fn disk(near: &mut Vec<(f32, u32)>, nearest: usize, widest: f32) -> f32 {
    if near.len() <= nearest {
        return widest * widest;
    }
    near.select_nth_unstable_by(nearest, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let r2 = near[nearest].0;
    near.truncate(nearest);
    near.sort_unstable_by_key(|p| p.1);
    r2
}

/// Weight of a photon in a disk: falls linearly to its edge, with integral 1 [1/m²].
#[inline]
fn cone(d2: f32, r2: f32) -> f64 {
    let r2 = f64::from(r2);
    (1.0 - (f64::from(d2) / r2).sqrt()).max(0.0) * 3.0 / (PI * r2)
}

impl Maps {
    /// Irradiance at a hit, of the nearest photon that knows it and is seen from there.
    fn irradiance(&self, world: &World, si: &SurfaceInteraction) -> Rgb {
        let face = Face { world, at: (si.point, si.ng), height: self.widest, least_cosine: 0.9 };
        // Those up to this distance are hidden.
        let mut hidden = -1.0;
        for _ in 0..MOST_LOOKS {
            let mut best = (self.widest * self.widest, None);
            self.known_grid.visit(si.point, self.widest, |i| {
                let at = self.known[i as usize].0;
                let d2 = at.0.distance_squared(si.point);
                if d2 < best.0 && d2 > hidden && face.holds(at) {
                    best = (d2, Some(i));
                }
            });
            let Some(i) = best.1 else { break };
            let (at, value) = self.known[i as usize];
            if face.sees(at, best.0.sqrt()) {
                return value;
            }
            hidden = best.0;
        }
        Rgb::BLACK
    }

    /// Radiance of caustics at a hit.
    fn caustic(&self, world: &World, si: &SurfaceInteraction, shading: &Shading<'_>, seed: u64) -> Rgb {
        let widest = self.widest_caustic;
        let face = face_at(world, si, widest);
        in_disk(&self.caustics, &self.caustic_grid, &face, NEAREST[1], widest, seed, |photon| photon.reflected(si, shading))
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
