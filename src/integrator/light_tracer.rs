//! Particle tracing: light walks from the lamps, each surface that they meet is seen by the camera ([Dutre93]).
//!
//! What has no surface that scatters between itself and the camera is not found so: lamps seen at once are looked at by camera rays,
//! what is seen in mirrors and through glass stays dark.

use super::bidirectional::{Connector, Heuristic, layer_of, light_sampler};
use super::splat::{Splats, each_pixel_with_splats};
use super::{Frame, Integrator, IntegratorSettings, Start};
use crate::film::PixelSample;
use crate::world::World;
use crate::world::walk::RayCounts;

/// A particle tracer.
pub struct LightTracer<'a> {
    connector: Connector<'a>,
    settings: IntegratorSettings,
}

impl<'a> LightTracer<'a> {
    /// On a scene.
    pub fn new(world: &'a World, settings: IntegratorSettings) -> Self {
        Self { connector: Connector::new(world, settings.max_depth, Heuristic::Balance), settings }
    }

    /// One camera ray for lamps seen at once, and one light walk.
    fn sample(&self, start: Start, counts: &mut RayCounts, splats: &mut Splats<'_>) -> PixelSample {
        let connector = &self.connector;
        let mut light = light_sampler(&self.settings, start.seed, start.key, start.index);
        connector.light_walk(&mut light, counts, |vertex, _, counts| {
            if let Some((sighting, carried, _)) = connector.sighted(vertex) {
                let found = carried * connector.visible(vertex, counts);
                splats.add(sighting.film_point, layer_of(vertex.scattered + 1, vertex.began_ideal), found);
            }
        });
        let mut sampler = start.sampler;
        connector.short_paths(start.ray, 1, &mut sampler, &mut RayCounts::default())
    }
}

impl Integrator for LightTracer<'_> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        self.connector.set_frame(frame);
        each_pixel_with_splats(self.connector.world, &self.settings, frame, index, |start, counts, splats| {
            self.sample(start, counts, splats)
        })
    }
}
