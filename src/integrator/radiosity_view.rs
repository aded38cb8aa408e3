//! Pass one alone, as seen from the camera: radiosity between the patches [Goral84], [Cohen85].

use super::{Frame, Integrator, IntegratorSettings};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::math::Rgb;
use crate::radiosity::{Interpolation, RadiosityField};
use crate::world::World;
use crate::world::walk::RayCounts;

/// Plates and holes that a camera ray goes straight through, at most.
const MOST_PLATES: u32 = 32;

/// A view of a solution.
pub struct RadiosityView<'a> {
    world: &'a World,
    field: Option<&'a RadiosityField>,
    interpolation: Option<Interpolation>,
    settings: IntegratorSettings,
}

impl<'a> RadiosityView<'a> {
    /// A view of `field`; without one, of lamps alone.
    pub fn new(world: &'a World, field: Option<&'a RadiosityField>, settings: IntegratorSettings) -> Self {
        Self { world, field, interpolation: field.map(|field| Interpolation::new(world, field)), settings }
    }

    /// What leaves the first surface along `ray` towards its start, and what shines through it.
    fn look(&self, mut ray: Ray, counts: &mut RayCounts) -> PixelSample {
        let mut sample = PixelSample::default();
        let mut carried = Rgb::WHITE;
        let limit = self.settings.max_depth.unwrap_or(u32::MAX);
        if limit == 0 {
            counts.truncate(carried);
            return sample;
        }
        for k in 0..MOST_PLATES {
            let Some(si) = self.world.intersect(&ray) else {
                *sample.layer(Quantity::Direct) += carried * self.world.scene().escaped_radiance(ray.direction);
                break;
            };
            if k == 0 {
                *sample.layer(Quantity::Depth) = Rgb::grey(f64::from(si.t));
                *sample.layer(Quantity::Normal) = Rgb::from(si.ns.to_array());
            }
            let shape = &self.world.scene().shapes[si.shape as usize];
            if si.front && shape.emits() {
                *sample.layer(Quantity::Direct) += carried * shape.emitted(si.uv);
            }
            let shading = self.world.shading(&si);
            let rho = carried * shading.diffuse_reflectance();
            *sample.layer(Quantity::Albedo) += rho;
            if let (Some(field), Some(interpolation)) = (self.field, &self.interpolation)
                && !rho.is_black()
            {
                let smooth = interpolation.irradiance(field, &si);
                *sample.layer(Quantity::Indirect) += RadiosityField::reflected_radiance(rho, smooth);
                *sample.layer(Quantity::Radiosity) += RadiosityField::reflected_radiance(rho, field.at(&si).irradiance);
                *sample.layer(Quantity::Irradiance) += field.irradiance(&si);
            }
            carried *= shading.straight_share();
            if carried.is_black() {
                break;
            }
            counts.transmitted += 1;
            ray.t_min = si.end;
        }
        sample
    }
}

impl Integrator for RadiosityView<'_> {
    fn pass(&mut self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        super::each_pixel(self.world, &self.settings, frame, index, |start, counts| self.look(start.ray, counts))
    }
}
