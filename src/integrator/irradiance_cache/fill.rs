//! Where records stand: at what the camera sees, coarse to fine, until all is covered or the rays are spent.

use super::gather::GatherSettings;
use super::{IrradianceCache, Record};
use crate::integrator::whitted::Path;
use crate::integrator::{Frame, TwoPass};
use crate::math::{Vec2, sampler::mix};
use crate::scene::View;
use crate::world::walk::RayCounts;
use crate::world::{Stages, SurfaceInteraction};
use rayon::prelude::*;

/// Pixels between the points first looked at.
const COARSEST: usize = 32;

/// How a cache is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FillSettings {
    /// Rays of a record, about.
    pub rays: u32,
    /// Distance up to which no other record is placed, over the harmonic mean of the distances seen.
    pub accuracy: f32,
    /// As [`GatherSettings::by_nearest`].
    pub by_nearest: bool,
    /// Closest records, in pixels as seen.
    pub closest: f32,
    /// Farthest records, in pixels as seen.
    pub farthest: f32,
    /// Pixels between the points last looked at; places that this misses are gathered anew by every sample that meets them.
    pub spacing: usize,
    /// Most gather rays.
    pub most_rays: u64,
    /// Seed.
    pub seed: u64,
}

/// A place that no record covers.
#[derive(Debug, Clone)]
pub(in crate::integrator) struct Gap {
    pub si: SurfaceInteraction,
    /// Width of a pixel there [m].
    pub pixel: f32,
}

impl<K: Stages> TwoPass<'_, K> {
    /// A cache for what this frame sees.
    pub fn fill(&self, frame: &Frame, settings: &FillSettings, counts: &mut RayCounts) -> IrradianceCache {
        let mut cache = IrradianceCache::default();
        let gather = GatherSettings {
            rays: settings.rays,
            accuracy: settings.accuracy,
            by_nearest: settings.by_nearest,
            seed: mix(settings.seed),
        };
        let mut spent = 0;
        let mut key = 0;
        let [width, height] = [frame.crop[2], frame.crop[3]];
        let view = frame.seen_by(self.world);
        let mut stride = COARSEST;
        while stride >= settings.spacing {
            // Four interleaved parts of each lattice: what one part fills, the next need not.
            for part in 0..4_usize {
                let columns: Vec<usize> = ((part % 2) * stride..width).step_by(2 * stride).collect();
                let points: Vec<usize> = ((part / 2) * stride..height)
                    .step_by(2 * stride)
                    .flat_map(|y| columns.iter().map(move |x| y * width + x))
                    .collect();
                let found: Vec<(Vec<Gap>, RayCounts)> = points
                    .par_iter()
                    .map(|pixel| {
                        let mut counts = RayCounts::default();
                        (self.gaps((frame, &view), *pixel, stride, &cache, settings.seed, &mut counts), counts)
                    })
                    .collect();
                let mut gaps = Vec::new();
                for (of_pixel, c) in found {
                    gaps.extend(of_pixel);
                    *counts += c;
                }
                let left = settings.most_rays.saturating_sub(spent) / u64::from(settings.rays);
                gaps.truncate(left as usize);
                let made: Vec<(Record, RayCounts)> = gaps
                    .par_iter()
                    .enumerate()
                    .map(|(i, gap)| {
                        let mut counts = RayCounts::default();
                        let reach = [settings.closest * gap.pixel, settings.farthest * gap.pixel];
                        (self.gather_record(&gap.si, key + i as u64, &gather, reach, &mut counts), counts)
                    })
                    .collect();
                key += gaps.len() as u64;
                spent += gaps.len() as u64 * u64::from(settings.rays);
                for (record, c) in made {
                    *counts += c;
                    cache.insert(record);
                }
            }
            stride /= 2;
        }
        if K::PLAIN {
            cache.lay_out::<K>(self.world);
        }
        cache
    }

    /// What a camera ray through the pixel meets that the cache does not cover.
    fn gaps(
        &self,
        (frame, view): (&Frame, &View<'_>),
        pixel: usize,
        stride: usize,
        cache: &IrradianceCache,
        seed: u64,
        counts: &mut RayCounts,
    ) -> Vec<Gap> {
        let (x, y) = frame.pixel(pixel);
        let mut sampler = crate::math::Sampler::new(mix(seed ^ 0x6a70), (y * frame.width + x) as u64, stride as u64);
        let film_point = Vec2::new(x as f32, y as f32) + sampler.next_2d();
        let (ray, per_distance) = (view.ray(film_point), view.per_distance());
        let mut trace = crate::integrator::whitted::Trace::new(sampler, 0, 0, counts);
        trace.collect = Some(crate::integrator::whitted::Collect { cache, per_distance, gaps: Vec::new() });
        self.radiance(&ray, Path::START, &mut trace);
        trace.collect.map_or_else(Vec::new, |c| c.gaps)
    }
}

impl IrradianceCache {
    /// True if a record covers the place.
    pub(in crate::integrator) fn has(&self, si: &SurfaceInteraction, normal: crate::math::Vec3) -> bool {
        self.covers(si.point, normal, si.shape)
    }
}
