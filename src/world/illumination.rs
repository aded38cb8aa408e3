//! Direct light at a point, by shadow rays.

use super::walk::RayCounts;
use super::{SurfaceInteraction, World};
use crate::geometry::Ray;
use crate::math::{Rgb, Sampler, Vec2, Vec3};

/// A shadow ray through more plates than this counts as blocked; less than 2 % of the light would be left.
const MOST_PLATES: u32 = 32;

/// How many lights are sampled at each point.
#[derive(Debug, Clone, Copy)]
pub struct DirectSampling {
    /// Up to this many lights, each is sampled at every point; from more, as many are picked by their likely contribution.
    pub lights_per_point: usize,
}

impl Default for DirectSampling {
    /// Four: a light with more than a quarter of the likely contribution is then always among those sampled.
    fn default() -> Self {
        Self { lights_per_point: 4 }
    }
}

impl World {
    /// Estimate of the irradiance [W/m²] at `si` from all lights that are found by shadow rays, about its shading normal.
    ///
    /// Unbiased. Light comes straight, through empty space and thin plates: what is bent by glass or comes by a mirror is found by
    /// gather rays.
    #[inline]
    pub fn direct_irradiance(
        &self,
        si: &SurfaceInteraction,
        sampling: DirectSampling,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
    ) -> Rgb {
        let lights = self.partition.shadow_lights();
        if lights.len() <= sampling.lights_per_point {
            lights.iter().map(|&light| self.irradiance_from(si, light, sampler.next_2d(), counts)).sum()
        } else {
            self.picked_irradiance(si, sampling.lights_per_point, sampler, counts)
        }
    }

    fn picked_irradiance(&self, si: &SurfaceInteraction, picks: usize, sampler: &mut Sampler, counts: &mut RayCounts) -> Rgb {
        let lights = self.partition.shadow_lights();
        let mut running = Vec::with_capacity(lights.len());
        let mut total = 0.0;
        for &light in lights {
            total += self.scene.lights[light].importance(si.point, si.ns);
            running.push(total);
        }
        let shift = f64::from(sampler.next_1d());
        let mut sum = Rgb::BLACK;
        for pick in 0..picks {
            let u = sampler.next_2d();
            if total <= 0.0 {
                continue;
            }
            // Systematic picks: one uniform shift for all, so that a light with a share above 1/picks is always among them.
            let target = (pick as f64 + shift) / picks as f64 * total;
            let k = running.partition_point(|&r| r <= target).min(lights.len() - 1);
            let share = (running[k] - if k == 0 { 0.0 } else { running[k - 1] }) / total;
            if share > 0.0 {
                sum += self.irradiance_from(si, lights[k], u, counts) / (share * picks as f64);
            }
        }
        sum
    }

    /// One sample of one light.
    #[inline]
    fn irradiance_from(&self, si: &SurfaceInteraction, light: usize, u: Vec2, counts: &mut RayCounts) -> Rgb {
        let Some(sample) = self.scene.lights[light].sample(si.point, u) else { return Rgb::BLACK };
        let cos = sample.direction.dot(si.ns);
        // Both normals must see the light: nothing shines through the back of a face.
        if cos <= 0.0 || sample.direction.dot(si.ng) <= 0.0 {
            return Rgb::BLACK;
        }
        counts.shadow += 1;
        self.transmittance(&si.spawn_to(sample.position)) * sample.irradiance * f64::from(cos)
    }

    /// Share of the light that comes straight along `ray` from its far end: 1 if nothing is in the way, less through thin plates, else 0.
    #[inline]
    pub fn transmittance(&self, ray: &Ray) -> Rgb {
        if !self.occluded(ray) {
            Rgb::WHITE
        } else if self.has_thin {
            self.transmittance_of_plates(*ray)
        } else {
            Rgb::BLACK
        }
    }

    fn transmittance_of_plates(&self, mut ray: Ray) -> Rgb {
        let mut share = Rgb::WHITE;
        for _ in 0..MOST_PLATES {
            let Some(si) = self.intersect(&ray) else { return share };
            let thin = self.scene.material_of(&self.scene.shapes[si.shape as usize]).material.passes_straight();
            let lobes = thin.then(|| self.lobes_at(&si)).flatten();
            let Some(through) = lobes.and_then(|(lobes, _)| lobes.iter().find(|l| l.transmits).copied()) else {
                return Rgb::BLACK;
            };
            share *= through.weight;
            // The same ray goes on: behind this hit, which a closed lower end leaves out.
            ray.t_min = si.t;
        }
        Rgb::BLACK
    }

    /// A point in free space as a receiver with normal `n`, for probes.
    pub fn receiver_at(&self, point: Vec3, n: Vec3) -> SurfaceInteraction {
        let error =
            Vec3::splat(self.bounds.min.abs().max(self.bounds.max.abs()).max(point.abs()).max_element() * super::POINT_ERROR);
        SurfaceInteraction::new(point, error, n, n, Vec2::ZERO, (0.0, 0.0), 0, 0, n)
    }
}
