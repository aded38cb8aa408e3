//! Non-local means over the pixels of a picture, by what its two halves agree on [Buades05, Rousselle12].
//!
//! Pixel p becomes the mean over the samples of its neighbours q with weights w(p, q) that fall with the distance of the two. The squared
//! distance of their true colours is estimated by (a_p - a_q)(b_p - b_q), with a and b the means of the two halves: as their errors are
//! independent, the product is right in the mean, and no variance needs to be taken off. It is averaged over 3 x 3 pixels around
//! both and measured in units of the variance of the two pixels, so that as samples are added only pixels that are ever more alike are
//! mixed: the filter does less and less, and what it does wrong stays within a multiple of the noise. Colours are divided by the albedo
//! seen; differences of albedo, normal and depth count as well.

use super::neighbours::sums_around;
use super::{Film, Quantity};
use crate::math::Rgb;
use rayon::prelude::*;
use std::ops::Range;

/// Neighbours at most this many pixels away in each direction.
const REACH: usize = 3;
/// Distances that count as alike, in standard deviations of a pixel.
const BANDWIDTH: f32 = 0.8;
/// Variances are averaged over pixels at most this far away in each direction.
const AROUND: usize = 2;
/// Differences of albedo that make pixels unlike.
const UNLIKE_ALBEDO: f32 = 0.2;
/// Differences of normals that do.
const UNLIKE_NORMAL: f32 = 0.5;
/// Differences of depth over their mean that do.
const UNLIKE_DEPTH: f32 = 0.1;
/// Distance beyond which none is told from another.
const FAR: f32 = 1e6;
/// Colours are divided by the albedo, or by this where less is seen.
const LEAST_ALBEDO: f32 = 0.05;
/// Least number of pixels that tell a variance.
const LEAST_KNOWN: f32 = 1e-3;
/// Rows that one task filters.
const BAND: usize = 32;

/// A filtered picture.
#[derive(Debug, Clone)]
pub(super) struct Filtered {
    /// Radiance [W/(m² sr)].
    pub image: Vec<Rgb>,
    /// Its variance, by how its two filtered halves differ.
    pub variance: Vec<Rgb>,
}

/// One value a pixel.
type Plane = Vec<f32>;

/// What the weights are made from, and what they are for.
struct Pixels {
    width: usize,
    height: usize,
    /// Means of the halves over the albedo, by half and channel; of all samples where a half has none.
    means: [[Plane; 3]; 2],
    /// What these means have in common by chance: the variance of the pixel where a half has no samples.
    common: Plane,
    /// Squared bandwidth.
    width2: Plane,
    /// Albedo and normal in units of what makes them unlike.
    features: [Plane; 6],
    depth: Plane,
    /// Sums of samples over the albedo, by half and channel, and numbers of samples, by half.
    sums: [Plane; 8],
    albedo: Vec<[f32; 3]>,
    /// Power of two by which all radiance was divided.
    unit: f64,
}

/// Filters the picture of a film. While one half is empty, the variance is taken from neighbours that look alike.
pub(super) fn filter(film: &Film) -> Filtered {
    let pixels = Pixels::of(film);
    let (w, h) = (pixels.width, pixels.height);
    let starts: Vec<usize> = (0..h).step_by(BAND).collect();
    let bands: Vec<[Plane; 8]> = starts.into_par_iter().map(|start| pixels.band(start, (start + BAND).min(h))).collect();
    let mut filtered = Filtered { image: Vec::with_capacity(w * h), variance: Vec::with_capacity(w * h) };
    for (band, totals) in bands.iter().enumerate() {
        for (i, albedo) in pixels.albedo[band * BAND * w..].iter().take(totals[0].len()).enumerate() {
            let [n, m] = [6, 7].map(|k| f64::from(totals[k][i]));
            let channel = |c: usize| {
                let [a, b] = [0, 3].map(|half| f64::from(totals[half + c][i]) * f64::from(albedo[c]) * pixels.unit);
                let difference = if n * m > 0.0 { a / n - b / m } else { 0.0 };
                ((a + b) / (n + m).max(f64::MIN_POSITIVE), difference * difference * n * m / ((n + m) * (n + m)))
            };
            let [r, g, b] = [0, 1, 2].map(channel);
            filtered.image.push(Rgb::new(r.0, g.0, b.0));
            filtered.variance.push(Rgb::new(r.1, g.1, b.1));
        }
    }
    filtered
}

impl Pixels {
    fn of(film: &Film) -> Self {
        let (width, height) = (film.width(), film.height());
        let n = width * height;
        let unit = film.unit();
        let plane = || vec![0.0_f32; n];
        let mut pixels = Self {
            width,
            height,
            means: [[plane(), plane(), plane()], [plane(), plane(), plane()]],
            common: plane(),
            width2: plane(),
            features: [plane(), plane(), plane(), plane(), plane(), plane()],
            depth: plane(),
            sums: [plane(), plane(), plane(), plane(), plane(), plane(), plane(), plane()],
            albedo: vec![[0.0; 3]; n],
            unit,
        };
        // Variance of one sample, summed over the channels, and where it is known.
        let (mut own, mut known) = (plane(), plane());
        for i in 0..n {
            let over = 1.0 / film.n_samples(i);
            let mean_of = |q: Quantity| (film.layers[i][q as usize] * over).to_array().map(|v| v as f32);
            let (seen, normal) = (mean_of(Quantity::Albedo), mean_of(Quantity::Normal));
            let albedo = seen.map(|v| if v > LEAST_ALBEDO { v } else { LEAST_ALBEDO });
            let taken = [0, 1].map(|half: usize| f64::from(film.taken[half][i]));
            let has_both = taken[0] * taken[1] > 0.0;
            let mut squared = 0.0;
            for c in 0..3 {
                let [a, b] = [0, 1].map(|half: usize| film.half(half, i)[c] / (unit * f64::from(albedo[c])));
                let means = if has_both { [a / taken[0], b / taken[1]] } else { [(a + b) * over; 2] };
                squared += (means[0] - means[1]) * (means[0] - means[1]);
                (pixels.means[0][c][i], pixels.means[1][c][i]) = (means[0] as f32, means[1] as f32);
                (pixels.sums[c][i], pixels.sums[3 + c][i]) = (a as f32, b as f32);
                (pixels.features[c][i], pixels.features[3 + c][i]) = (seen[c] / UNLIKE_ALBEDO, normal[c] / UNLIKE_NORMAL);
            }
            (pixels.sums[6][i], pixels.sums[7][i]) = (taken[0] as f32, taken[1] as f32);
            pixels.depth[i] = mean_of(Quantity::Depth)[0];
            pixels.albedo[i] = albedo;
            (own[i], known[i]) = ((squared * taken[0] * taken[1] * over) as f32, f32::from(u8::from(has_both)));
        }
        if film.passes.contains(&0) {
            (own, known) = pixels.spread();
        }
        let (own, known) = (sums_around([width, height], &own, AROUND), sums_around([width, height], &known, AROUND));
        for i in 0..n {
            let variance = own[i] / known[i].max(LEAST_KNOWN) / film.n_samples(i) as f32;
            pixels.width2[i] = 2.0 * BANDWIDTH * BANDWIDTH * variance;
            pixels.common[i] = if film.taken[0][i].min(film.taken[1][i]) > 0 { 0.0 } else { variance };
        }
        pixels
    }

    /// Variance of one sample by how neighbours differ that look alike, and how many of them do: all there is to go by while one half is empty.
    fn spread(&self) -> (Plane, Plane) {
        let (w, n) = (self.width, self.width * self.height);
        let (mut own, mut known) = (vec![0.0; n], vec![0.0; n]);
        for i in 0..n {
            let right = Some(i + 1).filter(|_| i % w + 1 < w);
            let below = Some(i + w).filter(|j| *j < n);
            for j in right.into_iter().chain(below) {
                let taken = [i, j].map(|k| self.sums[6][k] + self.sums[7][k]);
                let weight = fading(self.unlikeness(i, j));
                let squared: f32 = (0..3).map(|c| (self.means[0][c][i] - self.means[0][c][j]).powi(2)).sum();
                // The means differ by the variances of both.
                own[i] += weight * squared / (1.0 / taken[0].max(1.0) + 1.0 / taken[1].max(1.0));
                known[i] += weight;
            }
        }
        (own, known)
    }

    /// Squared distance of two pixels by what is seen there.
    fn unlikeness(&self, i: usize, j: usize) -> f32 {
        let relative =
            (self.depth[i] - self.depth[j]) / (self.depth[i] + self.depth[j] + f32::MIN_POSITIVE) * (2.0 / UNLIKE_DEPTH);
        relative * relative + self.features.iter().map(|f| (f[i] - f[j]) * (f[i] - f[j])).sum::<f32>()
    }

    /// The weighted sums of rows `start..end`, in the order of [`Self::sums`].
    fn band(&self, start: usize, end: usize) -> [Plane; 8] {
        let w = self.width;
        let mut totals = [0, 1, 2, 3, 4, 5, 6, 7].map(|k: usize| self.sums[k][start * w..end * w].to_vec());
        let mut rows = Rows::new(w);
        let mut weights = vec![0.0; w];
        let reach = REACH as isize;
        // A weight is that of both its pixels for each other: half of the neighbours are enough.
        let offsets = (0..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))).filter(|(dx, dy)| *dy > 0 || *dx > 0);
        for (dx, dy) in offsets {
            let across = self.across(dx);
            let there = shifted(&across, dx);
            let down = dy as usize;
            let (first, end_of_pairs) = (start.saturating_sub(down), end.min(self.height.saturating_sub(down)));
            if first >= end_of_pairs || across.is_empty() {
                continue;
            }
            let pairs = Pairs { pixels: self, offset: down * w, dx, across: across.clone() };
            // With a row more above and below.
            for (k, y) in (first..end_of_pairs + 2).enumerate() {
                let row = k * w..(k + 1) * w;
                let is_inside = y > 0 && y <= self.height - down;
                pairs.distances(is_inside.then(|| y - 1), &mut rows.distances[row.clone()], &mut rows.counts[row]);
            }
            for y in first..end_of_pairs {
                rows.around(y - first, w, &mut weights);
                let weights = &mut weights[across.clone()];
                pairs.weights(y, weights);
                for (total, sums) in totals.iter_mut().zip(&self.sums) {
                    if y >= start {
                        let total = &mut total[(y - start) * w..][across.clone()];
                        add_weighted(total, &sums[(y + down) * w..][there.clone()], weights);
                    }
                    if (start..end).contains(&(y + down)) {
                        let total = &mut total[(y + down - start) * w..][there.clone()];
                        add_weighted(total, &sums[y * w..][across.clone()], weights);
                    }
                }
            }
        }
        totals
    }

    /// Columns whose neighbour `dx` further lies in the picture.
    fn across(&self, dx: isize) -> Range<usize> {
        let width = self.width as isize;
        let start = (-dx).clamp(0, width);
        start as usize..(width - dx.max(0)).max(start) as usize
    }
}

/// Pixels and their neighbours at one distance in the picture.
struct Pairs<'a> {
    pixels: &'a Pixels,
    /// From a row to that of the neighbours.
    offset: usize,
    dx: isize,
    across: Range<usize>,
}

impl Pairs<'_> {
    /// The values of row `y`, and those of their neighbours.
    fn of<'b>(&self, plane: &'b Plane, y: usize) -> (&'b [f32], &'b [f32]) {
        let (row, n) = (y * self.pixels.width, self.across.len());
        // Cut to one length that is known, so that no bound is checked in the loops over them.
        (&plane[row..][self.across.clone()][..n], &plane[row + self.offset..][shifted(&self.across, self.dx)][..n])
    }

    /// Squared distances of the colours of row `y` in units of their variance, and 1 where there is a neighbour; 0 and 0 outside.
    fn distances(&self, y: Option<usize>, distances: &mut [f32], counts: &mut [f32]) {
        distances.fill(0.0);
        counts.fill(0.0);
        let Some(y) = y else { return };
        let n = self.across.len();
        let (distances, counts) = (&mut distances[self.across.clone()][..n], &mut counts[self.across.clone()][..n]);
        for c in 0..3 {
            let [(a, near_a), (b, near_b)] = [0, 1].map(|half: usize| self.of(&self.pixels.means[half][c], y));
            for i in 0..n {
                distances[i] += (a[i] - near_a[i]) * (b[i] - near_b[i]);
            }
        }
        let (width, near_width) = self.of(&self.pixels.width2, y);
        let (common, near_common) = self.of(&self.pixels.common, y);
        for i in 0..n {
            let over = distances[i] - common[i] - near_common[i];
            distances[i] = (over / (width[i] + near_width[i] + f32::MIN_POSITIVE)).clamp(-FAR, FAR);
        }
        counts.fill(1.0);
    }

    /// From the distances of row `y` to the weights.
    fn weights(&self, y: usize, weights: &mut [f32]) {
        let n = self.across.len();
        let weights = &mut weights[..n];
        let (depth, near_depth) = self.of(&self.pixels.depth, y);
        for i in 0..n {
            let relative = (depth[i] - near_depth[i]) / (depth[i] + near_depth[i] + f32::MIN_POSITIVE) * (2.0 / UNLIKE_DEPTH);
            weights[i] = weights[i].max(0.0) + relative * relative;
        }
        for feature in &self.pixels.features {
            let (f, near) = self.of(feature, y);
            for i in 0..n {
                weights[i] += (f[i] - near[i]) * (f[i] - near[i]);
            }
        }
        weights.iter_mut().for_each(|x| *x = fading(*x));
    }
}

/// Distances of the rows of a band, one more above and below.
struct Rows {
    distances: Vec<f32>,
    counts: Vec<f32>,
    /// Sums over three rows, with a column more on either side.
    sums: [Vec<f32>; 2],
}

impl Rows {
    fn new(width: usize) -> Self {
        let n = (BAND + REACH + 2) * width;
        Self { distances: vec![0.0; n], counts: vec![0.0; n], sums: [vec![0.0; width + 2], vec![0.0; width + 2]] }
    }

    /// Means of the distances over 3 x 3 pixels around those of the row between the `k`-th and the second after it.
    fn around(&mut self, k: usize, width: usize, means: &mut [f32]) {
        for (sums, plane) in self.sums.iter_mut().zip([&self.distances, &self.counts]) {
            let [above, here, below] = [k, k + 1, k + 2].map(|row| &plane[row * width..][..width]);
            let sums = &mut sums[1..][..width];
            for i in 0..width {
                sums[i] = above[i] + here[i] + below[i];
            }
        }
        let [distances, counts] = &self.sums;
        let (distances, counts, means) = (&distances[..width + 2], &counts[..width + 2], &mut means[..width]);
        for i in 0..width {
            let count = counts[i] + counts[i + 1] + counts[i + 2];
            means[i] = (distances[i] + distances[i + 1] + distances[i + 2]) / count.max(1.0);
        }
    }
}

/// e^-x, nearly, and nothing beyond 8.
fn fading(x: f32) -> f32 {
    let near = (1.0 - 0.125 * x).max(0.0);
    let squared = near * near;
    let fourth = squared * squared;
    fourth * fourth
}

fn shifted(range: &Range<usize>, by: isize) -> Range<usize> {
    range.start.wrapping_add_signed(by)..range.end.wrapping_add_signed(by)
}

fn add_weighted(total: &mut [f32], values: &[f32], weights: &[f32]) {
    total.iter_mut().zip(values).zip(weights).for_each(|((total, value), weight)| *total += weight * value);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::PixelSample;
    use crate::math::{Sampler, sampler::mix};

    const SIDE: usize = 48;

    /// A film with so many samples a pixel and half, of a picture with noise of a standard deviation of 0.29.
    fn film(passes: u32, picture: impl Fn(usize, usize) -> f64, scale: f64) -> Film {
        let mut film = Film::new(SIDE, SIDE).filtered(true);
        for index in 0..2 * passes {
            let samples: Vec<PixelSample> = (0..SIDE * SIDE)
                .map(|i| {
                    let noise = f64::from(Sampler::new(7, mix(i as u64 ^ mix(index.into())), 0).next_1d()) - 0.5;
                    let mut sample = PixelSample::default();
                    *sample.layer(Quantity::Direct) = Rgb::grey(scale * (picture(i % SIDE, i / SIDE) + noise));
                    *sample.layer(Quantity::Albedo) = Rgb::grey(0.5);
                    *sample.layer(Quantity::Depth) = Rgb::grey(3.0);
                    sample
                })
                .collect();
            film.add_pass(index, &samples);
        }
        film
    }

    fn error(image: &crate::film::Image, picture: impl Fn(usize, usize) -> f64) -> f64 {
        let pixel = |i: usize| (f64::from(image.pixels()[i][1]) - picture(i % SIDE, i / SIDE)).powi(2);
        (0..SIDE * SIDE).map(pixel).sum::<f64>() / (SIDE * SIDE) as f64
    }

    /// Of 49 pixels all alike: the variance falls at least to a tenth, and is known.
    #[test]
    fn noise_goes_where_all_is_alike() {
        let flat = |_, _| 2.0;
        let film = film(2, flat, 1.0);
        let found = error(&film.image(), flat);
        let raw = error(&film.unfiltered(), flat);
        assert!(found < 0.1 * raw, "{found} of {raw}");
        let told = film.variance_image().pixels().iter().map(|p| f64::from(p[1])).sum::<f64>() / (SIDE * SIDE) as f64;
        assert!((0.5..1.5).contains(&(told / found)), "{told} for {found}");
    }

    /// An edge of three standard deviations of a pixel stays: a plain mean over 7 x 7 pixels would leave a tenth of its square there.
    #[test]
    fn edges_stay() {
        let edge = |x: usize, _| if x < SIDE / 2 { 1.0 } else { 2.0 };
        let film = film(2, edge, 1.0);
        let near: f64 = (0..SIDE)
            .flat_map(|y| (SIDE / 2 - 2..SIDE / 2 + 2).map(move |x| (x, y)))
            .map(|(x, y)| (f64::from(film.image().at(x, y)[1]) - edge(x, y)).powi(2))
            .sum::<f64>()
            / (4 * SIDE) as f64;
        assert!(near < 1.0 / 12.0 / 4.0, "{near}");
    }

    /// A single pass, whose noise only its neighbours tell: where all looks alike it is filtered as well, and what looks different stays apart.
    #[test]
    fn a_first_pass_is_filtered_by_what_is_seen() {
        let two = |x: usize, _| if x < SIDE / 2 { 1.0 } else { 2.0 };
        let mut film = Film::new(SIDE, SIDE).filtered(true);
        let samples: Vec<PixelSample> = (0..SIDE * SIDE)
            .map(|i| {
                let noise = f64::from(Sampler::new(7, mix(i as u64), 0).next_1d()) - 0.5;
                let mut sample = PixelSample::default();
                let albedo = if i % SIDE < SIDE / 2 { 0.2 } else { 0.9 };
                *sample.layer(Quantity::Direct) = Rgb::grey(albedo * (two(i % SIDE, i / SIDE) + noise));
                *sample.layer(Quantity::Albedo) = Rgb::grey(albedo);
                *sample.layer(Quantity::Depth) = Rgb::grey(3.0);
                sample
            })
            .collect();
        film.add_pass(0, &samples);
        let picture = |x: usize, y: usize| two(x, y) * if x < SIDE / 2 { 0.2 } else { 0.9 };
        let (found, raw) = (error(&film.image(), picture), error(&film.unfiltered(), picture));
        assert!(found < 0.2 * raw, "{found} of {raw}");
    }

    /// Where nothing is alike, the filter does little from the start and nothing in the end.
    #[test]
    fn it_does_no_harm_in_the_limit() {
        let waves = |x: usize, y: usize| 2.0 + 0.3 * (x as f64).sin() + 0.3 * (1.7 * y as f64).cos();
        for (passes, most) in [(4, 1.3), (64, 1.05)] {
            let film = film(passes, waves, 1.0);
            let (found, raw) = (error(&film.image(), waves), error(&film.unfiltered(), waves));
            assert!(found < most * raw, "{found} of {raw} after {passes} passes");
        }
    }

    #[test]
    fn brightness_by_a_power_of_two_changes_no_bit() {
        let slope = |x: usize, _| 1.0 + x as f64 / 16.0;
        let [one, many] = [1.0, 2.0_f64.powi(60)].map(|scale| film(3, slope, scale).image());
        let is_same = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).all(|c| a[c] * 2.0_f32.powi(60) == b[c]);
        assert!(one.pixels().iter().zip(many.pixels()).all(is_same));
    }
}
