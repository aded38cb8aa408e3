//! Light that a pass adds to pixels other than the one at hand: kept as a list and added in order, so that sums do not depend on threads.

use super::{Frame, IntegratorSettings, Start, camera_start};
use crate::film::{PixelSample, Quantity};
use crate::math::{Rgb, Vec2};
use crate::world::World;
use crate::world::walk::RayCounts;
use rayon::prelude::*;

/// Light for any pixel of a frame.
pub struct Splats<'a> {
    frame: &'a Frame,
    list: Vec<(u32, Quantity, Rgb)>,
}

impl<'a> Splats<'a> {
    /// None yet.
    pub fn new(frame: &'a Frame) -> Self {
        Self { frame, list: Vec::new() }
    }

    /// Adds light at a point of the whole film [pixels]; what falls outside the rendered part is dropped.
    #[inline]
    pub fn add(&mut self, film_point: Vec2, layer: Quantity, radiance: Rgb) {
        let [left, top, width, height] = self.frame.crop;
        let (x, y) = (film_point.x as usize, film_point.y as usize);
        if x >= left && y >= top && x - left < width && y - top < height && !radiance.is_black() {
            self.list.push((((y - top) * width + x - left) as u32, layer, radiance));
        }
    }

    /// Adds all to the samples of a pass, times `scale`.
    pub fn add_to(&self, samples: &mut [PixelSample], scale: f64) {
        for (pixel, layer, radiance) in &self.list {
            *samples[*pixel as usize].layer(*layer) += *radiance * scale;
        }
    }
}

/// As `each_pixel`: one camera sample for each pixel, but `trace` may also add light to others. That light is divided by the number of
/// pixels, as befits one light path for each.
pub(super) fn each_pixel_with_splats(
    world: &World,
    settings: &IntegratorSettings,
    frame: &Frame,
    pass: u32,
    trace: impl Fn(Start, &mut RayCounts, &mut Splats<'_>) -> PixelSample + Sync,
) -> (Vec<PixelSample>, RayCounts) {
    let row = frame.crop[2].max(1);
    let rows: Vec<(Vec<PixelSample>, Splats<'_>, RayCounts)> = (0..frame.crop[3])
        .into_par_iter()
        .map(|y| {
            let mut counts = RayCounts::default();
            let mut splats = Splats::new(frame);
            let trace_one = |x: usize| {
                counts.camera += 1;
                trace(camera_start(world, settings, frame, pass, y * row + x), &mut counts, &mut splats)
            };
            let samples = (0..frame.crop[2]).map(trace_one).collect();
            (samples, splats, counts)
        })
        .collect();
    let mut samples = Vec::with_capacity(frame.n_pixels());
    let mut counts = RayCounts::default();
    let mut all = Vec::with_capacity(rows.len());
    for (of_row, splats, c) in rows {
        samples.extend(of_row);
        all.push(splats);
        counts += c;
    }
    let scale = 1.0 / frame.n_pixels().max(1) as f64;
    all.iter().for_each(|splats| splats.add_to(&mut samples, scale));
    (samples, counts)
}
