//! Glances: camera rays that light nothing.
//!
//! Edges within pixels, of bright windows, of lamps, of things and textures and of their mirror images, are most of the noise of a picture of an interior, and the
//! cheapest part of it: a camera ray with its reflections costs a tenth of a sample that lights what it meets as well. So a sample may be joined by glances,
//! which find what is emitted along other rays of the same pixel, and what pass one has stored for what they meet. Emission is the mean over all of
//! them; what is stored is known beforehand of the rest ([`crate::film::Beforehand`]).

use super::whitted::{Path, Trace};
use super::{Frame, PassPlan, TwoPass, by_rows, start_in_half};
use crate::film::{Beforehand, PixelSample, Quantity};
use crate::math::{Rgb, sampler::mix};
use crate::scene::View;
use crate::world::Stages;
use crate::world::walk::RayCounts;

/// Squares that differ by no more than this share of their sum are those of the same value: pixels are f32.
const ROUNDING: f64 = 1e-13;

/// What glances see as well as samples do.
const SEEN: [Quantity; 5] = [Quantity::Albedo, Quantity::Normal, Quantity::Depth, Quantity::Radiosity, Quantity::Irradiance];

type Layers = [Rgb; Quantity::ALL.len()];

/// What a pass found in a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Looked {
    /// Its samples.
    pub sample: PixelSample,
    /// Variance of the emission that one ray finds, averaged over channels, summed over the samples that had glances.
    pub emitted: f32,
    /// The same of what pass one has stored for what a ray meets.
    pub stored: f32,
    /// Number of samples that had glances.
    pub n: u32,
}

impl<K: Stages> TwoPass<'_, K> {
    /// A pass of as many samples a pixel as `plan` says, with its glances.
    pub fn planned_pass(&self, frame: &Frame, plan: PassPlan<'_>) -> (Vec<Looked>, RayCounts) {
        let nothing = Looked { sample: PixelSample::NONE, emitted: 0.0, stored: 0.0, n: 0 };
        let view = frame.seen_by(self.world);
        by_rows(frame, nothing, |pixel, counts| {
            let mut looked = nothing;
            let glances = u32::from(plan.glances[pixel]);
            for k in 0..plan.wanted[pixel] {
                counts.camera += 1;
                let start = start_in_half(&view, &self.settings, frame, plan.half, plan.taken[pixel] + k, pixel);
                let mut trace = Trace::new(start.sampler, mix(start.seed ^ start.key), start.index, counts);
                self.radiance(&start.ray, Path::START, &mut trace);
                let Trace { mut sample, seen, .. } = trace;
                let known = |layers: &Layers| layers[Quantity::Radiosity as usize];
                let own = known(&sample.layers);
                let (mut emitted, mut stored) = (Spread::of(seen), Spread::of(own));
                for glance in 0..glances {
                    let (seen, layers) =
                        self.glance((frame, &view), plan.half, plan.glanced[pixel] + k * glances + glance, pixel, counts);
                    emitted.add(seen);
                    stored.add(known(&layers));
                    SEEN.iter().for_each(|layer| sample.layers[*layer as usize] += layers[*layer as usize]);
                }
                let share = 1.0 / f64::from(1 + glances);
                SEEN.iter().for_each(|layer| sample.layers[*layer as usize] = sample.layers[*layer as usize] * share);
                *sample.layer(Quantity::Direct) += emitted.mean();
                sample.known = Beforehand { own, change: stored.mean() - own };
                looked.sample.add(&sample);
                looked.emitted += emitted.variance() as f32;
                looked.stored += stored.variance() as f32;
                looked.n += u32::from(glances > 0);
            }
            looked
        })
    }

    /// Emission along a ray through the pixel and its reflections, and what is seen by it.
    fn glance(
        &self,
        (frame, view): (&Frame, &View<'_>),
        half: u32,
        index: u32,
        pixel: usize,
        counts: &mut RayCounts,
    ) -> (Rgb, Layers) {
        // The rays of samples and glances are two sequences, independent of each other.
        let settings = super::IntegratorSettings { seed: mix(self.settings.seed ^ 0x6c_a2ce), ..self.settings };
        let start = start_in_half(view, &settings, frame, half, index, pixel);
        counts.glance += 1;
        // Samples alone tell what recursion leaves out.
        let cut = (counts.truncated, counts.truncated_weight);
        let mut trace = Trace::new(start.sampler, 0, start.index, counts);
        trace.glances = true;
        self.radiance(&start.ray, Path::START, &mut trace);
        let found = (trace.seen, trace.sample.layers);
        (counts.truncated, counts.truncated_weight) = cut;
        found
    }
}

/// Mean and variance of a few colours.
struct Spread {
    sum: Rgb,
    squares: Rgb,
    n: f64,
}

impl Spread {
    fn of(value: Rgb) -> Self {
        Self { sum: value, squares: value * value, n: 1.0 }
    }

    fn add(&mut self, value: Rgb) {
        self.sum += value;
        self.squares += value * value;
        self.n += 1.0;
    }

    fn mean(&self) -> Rgb {
        self.sum / self.n
    }

    /// Of one value, averaged over channels; 0 where there is only one.
    fn variance(&self) -> f64 {
        let mean = self.mean();
        let spread = (self.squares - mean * mean * self.n).mean();
        let is_rounding = spread <= ROUNDING * self.squares.mean();
        if self.n > 1.0 && !is_rounding { spread / (self.n - 1.0) } else { 0.0 }
    }
}
