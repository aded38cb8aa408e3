//! Path tracing with paths lent between neighbours [Bekaert02].
//!
//! What a path finds after its first bounce, at a surface y that is Lambertian, is of use to all pixels of a tile whose first surfaces see y: each
//! could have gone there itself. One ray tells whether it sees y. A pixel counts what all paths of its tile bring by the balance
//! heuristic over the densities, per area at y, with which those of them that see y would have drawn it [Veach95], so no light is counted twice and the mean
//! of each pixel is right; errors of the pixels of one tile are correlated.

use super::path::{PathTracer, ROULETTE_DEPTH, Walk};
use super::{Frame, start_in_half};
use crate::film::{PixelSample, Quantity};
use crate::geometry::offset_origin;
use crate::math::{Rgb, Sampler, Vec3};
use crate::world::walk::RayCounts;
use crate::world::{Sight, Stages, SurfaceInteraction};
use rayon::prelude::*;

/// Columns of a tile.
const COLUMNS: usize = 4;
/// Rows of a tile. With twice as many pixels in a tile, rays between them cost what they bring.
const ROWS: usize = 2;

/// Least cosine at which a surface with interpolated normals has them towards a viewer ([`SurfaceInteraction::shading_normal`]).
const LEAST_COSINE: f32 = 1e-4;

/// The first surface of a pixel that scatters light.
struct First {
    /// Index of the pixel in the tile.
    pixel: usize,
    si: SurfaceInteraction,
    /// As [`Place::plain`].
    plain: Option<Rgb>,
    /// Radiance at the pixel over radiance leaving there.
    throughput: Rgb,
    /// Edges to it.
    depth: u32,
}

/// A Lambertian surface that one of them has drawn.
struct Second {
    /// Index of the first surface.
    from: usize,
    si: SurfaceInteraction,
    /// Radiance that leaves it [W/(m² sr)], its emission left out.
    radiance: Rgb,
    /// Density per steradian with which it was drawn.
    density: f64,
    /// f |cos theta| at the first surface.
    response: Rgb,
}

impl<K: Stages> PathTracer<'_, K> {
    /// A sample of each pixel of the frame. Tiles lie on a grid of the whole picture, so that a part of it shows what the whole shows there.
    pub(super) fn pass_by_tiles(&self, frame: &Frame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        let [left, top, width, height] = frame.crop;
        let mut found = vec![PixelSample::NONE; frame.n_pixels()];
        let mut bands: Vec<(usize, Vec<&mut [PixelSample]>)> = Vec::with_capacity(height / ROWS + 2);
        for (y, row) in found.chunks_mut(width.max(1)).enumerate() {
            let band = (top + y) / ROWS;
            match bands.last_mut() {
                Some((last, rows)) if *last == band => rows.push(row),
                _ => bands.push((band, vec![row])),
            }
        }
        let whole = Frame::whole(frame.width, frame.height);
        let tiles = left / COLUMNS..(left + width).div_ceil(COLUMNS);
        let counts = bands.into_par_iter().map(|(band, mut rows)| {
            let mut counts = RayCounts::default();
            let y0 = band * ROWS;
            for tile in tiles.clone() {
                let x0 = tile * COLUMNS;
                let (columns, lines) = (COLUMNS.min(frame.width - x0), ROWS.min(frame.height - y0));
                let samples = self.tile(&whole, index, (x0, y0), (columns, lines), &mut counts);
                for (k, sample) in samples.into_iter().take(columns * lines).enumerate() {
                    let (x, y) = (x0 + k % columns, y0 + k / columns);
                    // Pixels beside the part that is rendered lend their paths, too.
                    if (left..left + width).contains(&x) && (top..top + height).contains(&y) {
                        rows[y - top.max(y0)][x - left] = sample;
                    }
                }
            }
            counts
        });
        let counts = counts.reduce(RayCounts::default, |mut a, b| {
            a += b;
            a
        });
        (found, counts)
    }

    fn tile(
        &self,
        whole: &Frame,
        index: u32,
        (x0, y0): (usize, usize),
        (columns, lines): (usize, usize),
        counts: &mut RayCounts,
    ) -> [PixelSample; COLUMNS * ROWS] {
        let mut samples = [PixelSample::default(); COLUMNS * ROWS];
        let (mut firsts, mut seconds) = (Vec::with_capacity(COLUMNS * ROWS), Vec::with_capacity(COLUMNS * ROWS));
        let view = whole.seen_by(self.world);
        for (pixel, sample) in samples.iter_mut().enumerate().take(columns * lines) {
            let place = (y0 + pixel / columns) * whole.width + x0 + pixel % columns;
            let mut start = start_in_half(&view, &self.settings, whole, index % 2, index / 2, place);
            counts.camera += 1;
            self.begin(pixel, Walk::new(start.ray), &mut start.sampler, counts, sample, (&mut firsts, &mut seconds));
        }
        self.lend(&firsts, &seconds, counts, &mut samples);
        samples
    }

    /// Follows the path of a pixel; what it finds at a second surface that others may use is put aside.
    fn begin(
        &self,
        pixel: usize,
        mut walk: Walk,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
        sample: &mut PixelSample,
        (firsts, seconds): (&mut Vec<First>, &mut Vec<Second>),
    ) {
        let (next, from) = loop {
            let Some(si) = self.arrive(&walk, counts, sample) else { return };
            let place = self.place(&si, counts);
            let is_first = place.scatters();
            // Light goes to and fro on one side, paths end by themselves, and most of the light is spread: only then is lending worth a ray.
            let lends = is_first
                && walk.depth + 1 < ROULETTE_DEPTH
                && place.shading.receiver().is_some()
                && (place.plain.is_some() || place.shading.has_diffuse());
            if lends {
                firsts.push(First { pixel, si, plain: place.plain, throughput: walk.throughput, depth: walk.depth });
            }
            let Some(next) = self.leave(&walk, &place, sampler, counts, sample) else { return };
            match next.sight {
                Sight::Scattered(origin) if lends && next.scattered == 1 => break (next, origin.density),
                _ if is_first => return self.follow(next, sampler, counts, sample),
                _ => walk = next,
            }
        };
        let Some(si) = self.arrive(&next, counts, sample) else { return };
        let place = self.place(&si, counts);
        let own = firsts.len() - 1;
        if place.plain.is_none() || !is_even(&si, si.wo) || seen_from(&si, firsts[own].si.point).1 <= 0.0 {
            if let Some(next) = self.leave(&next, &place, sampler, counts, sample) {
                self.follow(next, sampler, counts, sample);
            }
            return;
        }
        // What leaves there is found by itself: for others it has another weight.
        let (weight, share) = (next.weight, next.throughput.max());
        let alone = Walk { throughput: Rgb::WHITE, share, ..next };
        let mut beyond = PixelSample::default();
        if let Some(next) = self.leave(&alone, &place, sampler, counts, &mut beyond) {
            self.follow(next, sampler, counts, &mut beyond);
        }
        let radiance = beyond.radiance();
        if !radiance.is_black() {
            seconds.push(Second { from: own, si, radiance, density: from, response: weight * from });
        }
    }

    /// Adds to each pixel what all of the tile have found at their second surfaces.
    fn lend(&self, firsts: &[First], seconds: &[Second], counts: &mut RayCounts, samples: &mut [PixelSample]) {
        let places: Vec<_> = firsts.iter().map(|first| self.place_again(&first.si, first.plain)).collect();
        for second in seconds {
            let own = &firsts[second.from];
            let target = offset_origin(second.si.point, second.si.error, second.si.ng, second.si.ng);
            let (_, per_area) = seen_from(&second.si, own.si.point);
            let mut density = second.density * per_area;
            let mut responses = [Rgb::BLACK; COLUMNS * ROWS];
            responses[second.from] = second.response * per_area;
            for (k, (first, place)) in firsts.iter().zip(&places).enumerate() {
                // Longer paths to y may end before others.
                if k == second.from || first.depth != own.depth {
                    continue;
                }
                let (back, per_area) = seen_from(&second.si, first.si.point);
                if per_area <= 0.0 || !per_area.is_finite() || !is_even(&second.si, back) {
                    continue;
                }
                let (response, drawn) = place.response(-back);
                if drawn <= 0.0 {
                    continue;
                }
                counts.connected += 1;
                if K::VISIBILITY && self.world.occluded(&first.si.spawn_to(target)) {
                    continue;
                }
                density += drawn * per_area;
                responses[k] = response * per_area;
            }
            let radiance = second.radiance / density;
            for (first, response) in firsts.iter().zip(&responses) {
                *samples[first.pixel].layer(Quantity::Indirect) += first.throughput * *response * radiance;
            }
        }
    }
}

/// Unit direction from a surface to `point`, and the solid angle that an area there fills as seen from `point` [sr/m²]; not above 0 from behind.
#[inline]
fn seen_from(si: &SurfaceInteraction, point: Vec3) -> (Vec3, f64) {
    let way = point - si.point;
    let d2 = way.length_squared();
    let back = way / d2.sqrt();
    (back, f64::from(back.dot(si.ng) / d2))
}

/// True if the surface reflects towards `back` about the same normal as to any viewer that looks at it from above.
#[inline]
fn is_even(si: &SurfaceInteraction, back: Vec3) -> bool {
    back.dot(si.ns) > LEAST_COSINE
}
