//! Stochastic progressive photon mapping [Hachisuka09], in the form without a memory in each pixel [Knaus11]: every pass has photons of
//! its own, and disks that shrink from pass to pass as r²(i+1) = r²(i) (i + alpha)/(i + 1), so that the mean of all passes has
//! neither noise nor blur in the limit.

use super::{Photon, PhotonGrid, Shots, Way, direct, face, face_at, shoot};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::integrator::{Frame, Integrator, IntegratorSettings, each_pixel};
use crate::math::{Rgb, Sampler, Vec2, sampler::mix};
use crate::world::walk::{Event, RayCounts};
use crate::world::{Departures, Shading, Sight, SurfaceInteraction, World};
use std::f64::consts::PI;

/// Rate at which disks shrink: [Hachisuka09]'s value.
const ALPHA: f64 = 2.0 / 3.0;
/// Radius of the first pass, in pixels as seen at the mean distance.
const FIRST_RADIUS: f64 = 2.0;
/// Camera rays a side that measure the distance.
const PROBES: usize = 16;
/// No path is longer, whatever the scene asks.
const DEEPEST: u32 = 512;

/// Passes of photons.
pub struct Sppm<'a> {
    world: &'a World,
    departures: Option<Departures>,
    settings: IntegratorSettings,
    /// Photons of a pass; `None`: one for each pixel.
    photons: Option<u32>,
    first_radius: Option<f32>,
}

/// What one pass reads.
struct Photons {
    photons: Vec<Photon>,
    grid: PhotonGrid,
    radius: f32,
}

impl<'a> Sppm<'a> {
    /// On a scene.
    pub fn new(world: &'a World, settings: IntegratorSettings, photons: Option<u32>) -> Self {
        Self { world, departures: Departures::new(world), settings, photons, first_radius: None }
    }

    fn limit(&self) -> u32 {
        self.settings.max_depth.map_or(DEEPEST, |d| d.min(DEEPEST))
    }

    /// Radius of the disks of pass `index` [m].
    fn radius(&mut self, frame: &Frame, index: u32) -> f32 {
        let world = self.world;
        let first = *self.first_radius.get_or_insert_with(|| {
            let camera = &world.scene().camera;
            let (width, height) = (frame.width, frame.height);
            let middle = |k: usize, of: usize| (k as f32 + 0.5) / PROBES as f32 * of as f32;
            let points = (0..PROBES * PROBES).map(|k| Vec2::new(middle(k % PROBES, width), middle(k / PROBES, height)));
            let distances = points.filter_map(|p| world.intersect(&camera.ray(p, width, height)).map(|si| f64::from(si.t)));
            let (sum, n) = distances.fold((0.0, 0), |(sum, n), d| (sum + d, n + 1));
            let distance = if n > 0 { sum / f64::from(n) } else { f64::from(world.bounds().diagonal()) };
            (FIRST_RADIUS * 2.0 * camera.half_width(width, height) / width as f64 * distance) as f32
        });
        let shrunk: f64 = (1..=index).map(|i| (f64::from(i) + ALPHA) / (f64::from(i) + 1.0)).product();
        first * shrunk.sqrt() as f32
    }

    /// What arrives along `ray`.
    fn radiance(
        &self,
        ray: Ray,
        seed: u64,
        sampler: &mut Sampler,
        photons: Option<&Photons>,
        counts: &mut RayCounts,
    ) -> PixelSample {
        let world = self.world;
        let scene = world.scene();
        let limit = self.limit();
        let mut sample = PixelSample::default();
        let mut shadow_sampler = sampler.clone();
        // The walk draws from a stream of its own, so that shadow rays do not move it.
        let mut shade = |si: &SurfaceInteraction, shading: &Shading<'_>, through: u32, counts: &mut RayCounts| {
            let lit = direct(world, si, shading, 0.0, self.settings.direct, &mut shadow_sampler, counts);
            (
                lit,
                photons.map_or((Rgb::BLACK, Rgb::BLACK), |p| {
                    p.reflected(world, si, shading, limit - through - 1, seed ^ u64::from(through))
                }),
            )
        };
        let mut walk_counts = RayCounts::default();
        if limit == 0 {
            return sample;
        }
        let mut walk_sampler = Sampler::of(self.settings.sampler, mix(u64::from(sampler.next_1d().to_bits())), 0, 0);
        world.follow(ray, Sight::Alone, &mut walk_sampler, limit, &mut walk_counts, |event| match event {
            Event::Surface { at, shading, throughput, through, emission_share, .. } => {
                if through == 0 {
                    *sample.layer(Quantity::Depth) = Rgb::grey(f64::from(at.t));
                    *sample.layer(Quantity::Normal) = Rgb::from(at.ns.to_array());
                }
                let shape = &scene.shapes[at.shape as usize];
                if at.front && emission_share > 0.0 {
                    *sample.layer(Quantity::Direct) += throughput * shape.emitted(at.uv) * emission_share;
                }
                if shading.has_diffuse() && through + 2 <= limit {
                    *sample.layer(Quantity::Albedo) += throughput * shading.diffuse_reflectance();
                    let (lit, (caustic, other)) = shade(at, shading, through, counts);
                    *sample.layer(Quantity::Direct) += throughput * lit;
                    *sample.layer(Quantity::Caustic) += throughput * caustic;
                    *sample.layer(Quantity::Indirect) += throughput * other;
                }
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
        *counts += walk_counts;
        sample
    }
}

impl Photons {
    /// Radiance by photons around `si` of at most `most_edges`: caustics and the rest. Where something stands in the disk, or ends it, as the
    /// first point drawn tells, each photon is asked whether it is seen. Elsewhere
    /// none is: shrinking disks get rid of what stands in the way unnoticed.
    fn reflected(&self, world: &World, si: &SurfaceInteraction, shading: &Shading<'_>, most_edges: u32, seed: u64) -> (Rgb, Rgb) {
        let mut sums = [Rgb::BLACK; 2];
        let r2 = self.radius * self.radius;
        let face = face_at(world, si, self.radius);
        // Known once there is a photon.
        let mut trials = None;
        self.grid.visit(si.point, self.radius, |i| {
            let photon = &self.photons[i as usize];
            let is_near = photon.point.distance_squared(si.point) < r2 && photon.edges <= most_edges;
            if is_near && face.holds((photon.point, photon.normal)) {
                let trials = *trials.get_or_insert_with(|| face.trials(self.radius, seed, None, face::even));
                if trials > 1 && !face.sees_photon(photon, self.radius) {
                    return;
                }
                let found = photon.reflected(si, shading) * f64::from(trials);
                sums[usize::from(photon.way == Way::Caustic)] += found;
            }
        });
        let area = PI * f64::from(r2);
        (sums[1] / area, sums[0] / area)
    }
}

impl Integrator for Sppm<'_> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        let radius = self.radius(frame, index);
        let mut counts = RayCounts::default();
        let limit = self.limit();
        let photons = self.departures.as_ref().filter(|_| limit > 1).map(|departures| {
            let shots = Shots {
                photons: self.photons.map_or(frame.n_pixels() as u64, u64::from),
                most_edges: limit - 1,
                seed: mix(self.settings.seed ^ mix(0x0070_4070 + u64::from(index))),
                sampler: self.settings.sampler,
            };
            let mut photons = shoot(self.world, departures, &shots, &mut counts);
            // Shadow rays find these better.
            photons.retain(|p| p.way != Way::Direct);
            let grid = PhotonGrid::new(photons.iter().map(|p| p.point), radius);
            Photons { photons, grid, radius }
        });
        let (samples, c) = each_pixel(self.world, &self.settings, frame, index, |start, counts| {
            let mut sampler = start.sampler;
            let seed = mix(start.seed ^ mix(start.key ^ mix(start.index)));
            self.radiance(start.ray, seed, &mut sampler, photons.as_ref(), counts)
        });
        counts += c;
        (samples, counts)
    }
}
