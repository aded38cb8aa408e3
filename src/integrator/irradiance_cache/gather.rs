//! One record: irradiance and its gradients from a hemisphere of rays in rings and sectors [Ward92].

use super::{OVERLAP, Record};
use crate::accel::{Work, widest};
use crate::geometry::Ray;
use crate::integrator::TwoPass;
use crate::integrator::final_gather::{Gathered, NEAR_LEVELS};
use crate::math::sampler::Series;
use crate::math::{Frame, Rgb, Vec3, warp};
use crate::world::convex::bundle::{Directions, LANES, Panorama};
use crate::world::sight::{Origin, cosine_density};
use crate::world::walk::RayCounts;
use crate::world::{Sight, Stages, SurfaceInteraction};
use std::f64::consts::{PI, TAU};

/// Share of its distance by which hits on a wall may be off a line.
const WALL_FLATNESS: f32 = 0.01;

/// How records are gathered.
#[derive(Debug, Clone, Copy)]
pub(super) struct GatherSettings {
    /// Rays of a record, about.
    pub rays: u32,
    /// Distance up to which no other record is placed, over the harmonic mean of the distances seen.
    pub accuracy: f32,
    /// True if a record reaches no further than to what stands nearest; else its gradient limits its reach.
    pub by_nearest: bool,
    /// Seed.
    pub seed: u64,
}

/// What one ray of the hemisphere found.
#[derive(Clone, Copy)]
struct Seen<const N: usize> {
    /// Radiance, as the diffuse part accepts it, in as many channels as differ.
    radiance: [f64; N],
    /// Part of it that is emission.
    emitted: [f64; N],
    /// One over the distance to what was seen; 0 for what is infinitely far.
    nearness: f64,
    /// The ray's unit direction along the two axes of the surface.
    along: [f32; 2],
}

impl<const N: usize> Seen<N> {
    #[inline(always)]
    fn of(found: &Gathered, acceptance: Rgb, along: [f32; 2]) -> Self {
        Self {
            radiance: first((found.reflected + found.emitted) * acceptance),
            emitted: first(found.emitted * acceptance),
            nearness: 1.0 / f64::from(found.distance).max(1e-30),
            along,
        }
    }
}

/// A hemisphere in rings and sectors of equal projected solid angle, ring by ring from the middle.
struct Strata {
    rings: usize,
    sectors: usize,
}

impl Strata {
    fn len(&self) -> usize {
        self.rings * self.sectors
    }

    /// Ring and sector of stratum `i`.
    #[inline(always)]
    fn place(&self, i: usize) -> [f64; 2] {
        [(i / self.sectors) as f64, (i % self.sectors) as f64]
    }

    /// Direction in the frame of the hemisphere through the point `(u, v)` of a ring and sector.
    #[inline(always)]
    fn direction(&self, [ring, sector]: [f64; 2], u: f32, v: f32) -> [f32; 3] {
        let sin2 = (ring + f64::from(u)) / self.rings as f64;
        let (sin_phi, cos_phi) = warp::sin_cos_of_turn((sector + f64::from(v)) / self.sectors as f64);
        let (sin, cos) = (sin2.sqrt(), (1.0 - sin2).max(1e-6).sqrt());
        [(sin * cos_phi) as f32, (sin * sin_phi) as f32, cos as f32]
    }

    /// Directions through points of strata from the `first` on, in the axes of the world.
    #[inline(always)]
    fn directions(&self, first: usize, [u, v]: [&[f32; LANES]; 2], frame: &Frame) -> Directions {
        let [mut rings, mut sectors] = [[0.0; LANES]; 2];
        for lane in 0..LANES {
            [rings[lane], sectors[lane]] = self.place(first + lane);
        }
        let [mut x, mut y, mut z] = [[0.0_f32; LANES]; 3];
        for lane in 0..LANES {
            [x[lane], y[lane], z[lane]] = self.direction([rings[lane], sectors[lane]], u[lane], v[lane]);
        }
        let mut directions = [[0.0; LANES]; 3];
        for (axis, along) in directions.iter_mut().enumerate() {
            let (s, t, n) = (frame.s[axis], frame.t[axis], frame.n[axis]);
            for lane in 0..LANES {
                along[lane] = s * x[lane] + t * y[lane] + n * z[lane];
            }
        }
        directions
    }
}

/// The work of one record.
struct Gathering<'a, 'b, K: Stages> {
    by: &'a TwoPass<'b, K>,
    si: &'a SurfaceInteraction,
    key: u64,
    settings: &'a GatherSettings,
    reach: [f32; 2],
    counts: &'a mut RayCounts,
}

impl<K: Stages> Work for Gathering<'_, '_, K> {
    type Output = Record;

    #[inline(always)]
    fn run(self) -> Record {
        let Self { by, si, key, settings, reach, counts } = self;
        if K::COLOUR {
            by.gather_channels::<3>(si, key, settings, reach, counts)
        } else {
            by.gather_channels::<1>(si, key, settings, reach, counts)
        }
    }
}

impl<K: Stages> TwoPass<'_, K> {
    /// Irradiance at `si` and around it. `reach` bounds how far it may hold [m], from below and above.
    pub(super) fn gather_record(
        &self,
        si: &SurfaceInteraction,
        key: u64,
        settings: &GatherSettings,
        reach: [f32; 2],
        counts: &mut RayCounts,
    ) -> Record {
        widest(Gathering { by: self, si, key, settings, reach, counts })
    }

    /// The same; the first `N` channels are computed, the others, if any, are as the first.
    #[inline(always)]
    fn gather_channels<const N: usize>(
        &self,
        si: &SurfaceInteraction,
        key: u64,
        settings: &GatherSettings,
        reach: [f32; 2],
        counts: &mut RayCounts,
    ) -> Record {
        let shading = self.world.shading_by::<K>(si);
        let frame = Frame::new(shading.normal());
        let rings = ((f64::from(settings.rays) / PI).sqrt().round() as usize).max(3);
        let sectors = (PI * rings as f64).round() as usize;
        let mut seen = Vec::with_capacity(rings * sectors);
        // On this side of the face all rays start at one point.
        let start = si.spawn(si.ng).origin;
        let outlook = self.world.outlook::<K>(start);
        let series = Series::new(settings.seed, key);
        let strata = Strata { rings, sectors };
        let panorama = if strata.len() <= Series::LEN { self.world.panorama::<K>(start) } else { None };
        if let Some(panorama) = panorama {
            counts.gather += strata.len() as u64;
            for first in (0..strata.len()).step_by(LANES) {
                self.gather_bundle(first, &strata, (&frame, start), &panorama, &series, counts, &mut seen);
            }
            return self.record_of(si, &frame, &seen, rings, settings, reach);
        }
        for i in 0..strata.len() {
            let mut sampler = series.sampler(i as u64);
            let u = sampler.next_2d();
            let local = Vec3::from(strata.direction(strata.place(i), u.x, u.y));
            let direction = frame.to_world(local);
            let origin = Origin {
                point: si.point,
                receiver: shading.receiver(),
                density: cosine_density(f64::from(self.settings.gather_rays), local.z),
                sampling: self.settings.direct,
            };
            // Bent normals look below the face itself, where nothing arrives.
            if direction.dot(si.ng) <= 0.0 {
                seen.push(Seen::<N> { radiance: [0.0; N], emitted: [0.0; N], nearness: 0.0, along: [0.0; 2] });
                continue;
            }
            counts.gather += 1;
            let (found, acceptance) = if K::PLAIN {
                let ray = Ray::new(start, direction);
                (self.plain_gathered((&ray, &outlook), 0, NEAR_LEVELS, &mut sampler, counts), Rgb::WHITE)
            } else {
                let found = self.gathered(si.spawn(direction), Sight::Gather(origin), 0, &mut sampler, counts);
                (found, shading.acceptance(direction))
            };
            seen.push(Seen::of(&found, acceptance, [local.x, local.y]));
        }
        self.record_of(si, &frame, &seen, rings, settings, reach)
    }

    /// The same for some rays of a record in a plain convex room, from the `first` on: they start at one point, and no
    /// normal is bent.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "what all bundles of a record share, found once")]
    fn gather_bundle<const N: usize>(
        &self,
        first: usize,
        strata: &Strata,
        (frame, start): (&Frame, Vec3),
        panorama: &Panorama,
        series: &Series,
        counts: &mut RayCounts,
        seen: &mut Vec<Seen<N>>,
    ) {
        let [mut u, mut v] = [[0.0_f32; LANES]; 2];
        for lane in 0..LANES {
            [u[lane], v[lane]] = series.first_2d((first + lane) as u32);
        }
        let directions = strata.directions(first, [&u, &v], frame);
        let met = panorama.meet(&directions);
        for (lane, met) in met.into_iter().enumerate().take(strata.len() - first) {
            let direction = Vec3::from([0, 1, 2].map(|axis: usize| directions[axis][lane]));
            let sampler = || {
                let mut sampler = series.sampler((first + lane) as u64);
                sampler.next_2d();
                sampler
            };
            let hit = match met {
                Some(met) => self.world.met_in_bundle(met, direction),
                None => None,
            };
            let found = match hit {
                Some(met) => {
                    self.plain_found(&met, 0, NEAR_LEVELS, |met| self.plain_near(met, 1, NEAR_LEVELS - 1, &mut sampler(), counts))
                }
                None => {
                    let ray = Ray::new(start, direction);
                    self.plain_gathered((&ray, &self.world.outlook::<K>(start)), 0, NEAR_LEVELS, &mut sampler(), counts)
                }
            };
            seen.push(Seen::of(&found, Rgb::WHITE, [direction.dot(frame.s), direction.dot(frame.t)]));
        }
    }

    fn record_of<const N: usize>(
        &self,
        si: &SurfaceInteraction,
        frame: &Frame,
        seen: &[Seen<N>],
        rings: usize,
        settings: &GatherSettings,
        reach: [f32; 2],
    ) -> Record {
        let GatherSettings { accuracy, by_nearest, .. } = *settings;
        let n = seen.len() as f64;
        let irradiance = sum(seen.iter().map(|s| &s.radiance)) * (PI / n);
        let emitted = sum(seen.iter().map(|s| &s.emitted)) * (PI / n);
        let share = |e: f64, h: f64| if h > 0.0 { e / h } else { 0.0 };
        let emitted_share =
            Rgb::new(share(emitted.r, irradiance.r), share(emitted.g, irradiance.g), share(emitted.b, irradiance.b));
        let (rotation, mut translation) = gradients(frame, seen, rings);
        let mean_nearness = seen.iter().map(|s| s.nearness).sum::<f64>() / n;
        let harmonic = (1.0 / mean_nearness.max(1e-30)) as f32;
        let [least, most] = reach;
        let reach = if by_nearest {
            // Rays into a few bright places make irradiance and gradient noisy together: a reach that followed them would give most room to
            // records that missed the light. So the gradient follows the reach, which ends before what stands nearest.
            let nearness = seen.iter().map(|s| s.nearness).fold(1e-30, f64::max);
            let nearest = (1.0 / nearness) as f32 / OVERLAP;
            let reach = (accuracy * harmonic).min(nearest).clamp(least, most);
            for (gradient, e) in translation.iter_mut().zip(irradiance.to_array()) {
                *gradient = gradient.clamp_length_max((0.5 * e) as f32 / (OVERLAP * reach));
            }
            reach
        } else {
            // Where irradiance changes fast, a record holds less far.
            let steepest = translation.iter().map(|g| g.length_squared()).sum::<f32>().sqrt();
            let level = (irradiance.r.powi(2) + irradiance.g.powi(2) + irradiance.b.powi(2)).sqrt() as f32;
            let by_gradient = if steepest > 0.0 { level / steepest } else { f32::INFINITY };
            (accuracy * harmonic.min(by_gradient)).clamp(least, most)
        };
        let ([x, y], wall_distance) = wall(seen, rings, OVERLAP * reach).unwrap_or(([0.0; 2], f32::INFINITY));
        let wall = frame.s * x + frame.t * y;
        let normal = frame.n;
        Record {
            point: si.point,
            normal,
            shape: si.shape,
            reach,
            wall,
            wall_distance,
            irradiance,
            emitted_share,
            translation,
            rotation,
        }
    }
}

/// The nearest wall within `reach` [m], if any that is upright: the unit direction to it along the two axes of the surface, and its distance
/// [m]. Each sector has its nearest hit, as seen from above, of those that are no higher than `reach`: ceilings are no walls. Three neighbours
/// on a line, the nearest among them, are one.
fn wall<const N: usize>(seen: &[Seen<N>], rings: usize, reach: f32) -> Option<([f32; 2], f32)> {
    let sectors = seen.len() / rings;
    let nearest = |k: usize| {
        let hits = (0..rings).filter_map(|ring| {
            let Seen { nearness, along: [x, y], .. } = seen[ring * sectors + k];
            let distance = (1.0 / nearness.max(1e-30)) as f32;
            let height = distance * (1.0 - square([x, y])).max(0.0).sqrt();
            (height < reach).then_some([x * distance, y * distance])
        });
        hits.min_by(|a, b| square(*a).total_cmp(&square(*b))).unwrap_or([f32::INFINITY; 2])
    };
    let hits: Vec<[f32; 2]> = (0..sectors).map(nearest).collect();
    let first = (0..sectors).min_by(|a, b| square(hits[*a]).total_cmp(&square(hits[*b])))?;
    if square(hits[first]) > reach * reach {
        return None;
    }
    [sectors - 1, 0, sectors - 2].into_iter().find_map(|begin| {
        let [a, b, c] = [0, 1, 2].map(|k| hits[(first + begin + k) % sectors]);
        let (x, y) = (a[1] - c[1], c[0] - a[0]);
        let length = x.hypot(y);
        let normal = [x / length, y / length];
        let [of_a, of_b] = [a, b].map(|hit| normal[0] * hit[0] + normal[1] * hit[1]);
        let is_flat = of_a.abs() > 0.0 && (of_b - of_a).abs() <= WALL_FLATNESS * of_a.abs();
        (is_flat && of_a.abs() < reach).then(|| (normal.map(|v| v * of_a.signum()), of_a.abs() * (1.0 + WALL_FLATNESS)))
    })
}

/// Square of a length.
#[inline]
fn square([x, y]: [f32; 2]) -> f32 {
    x * x + y * y
}

/// The first channels of a colour.
#[inline]
fn first<const N: usize>(colour: Rgb) -> [f64; N] {
    let all = colour.to_array();
    std::array::from_fn(|c| all[c])
}

/// Sums of the channels; those that are not there are as the first.
fn sum<'a, const N: usize>(values: impl Iterator<Item = &'a [f64; N]>) -> Rgb {
    let mut sum = [0.0; N];
    values.for_each(|value| sum.iter_mut().zip(value).for_each(|(sum, v)| *sum += v));
    Rgb::from([0, 1, 2].map(|c: usize| sum[c.min(N - 1)]))
}

/// Rotation and translation gradients per channel, in world axes: [Ward92], equations for a hemisphere of rings and sectors of equal
/// projected solid angle. The first `N` channels are computed; the others, if any, are as the first.
fn gradients<const N: usize>(frame: &Frame, seen: &[Seen<N>], rings: usize) -> ([Vec3; 3], [Vec3; 3]) {
    let sectors = seen.len() / rings;
    let at = |j: usize, k: usize| seen[j * sectors + k % sectors];
    let edge_sin2 = |j: usize| j as f64 / rings as f64;
    // Of each ring: tangent of its middle, its width, and what its inner edge counts.
    let of_ring = |j: usize| {
        let (sin2, s2) = ((j as f64 + 0.5) / rings as f64, edge_sin2(j));
        [(sin2 / (1.0 - sin2)).sqrt(), edge_sin2(j + 1).sqrt() - s2.sqrt(), s2.sqrt() * (1.0 - s2)]
    };
    let of_rings: Vec<[f64; 3]> = (0..rings).map(of_ring).collect();
    let mut rotation = [[0.0_f64; 2]; N];
    let mut translation = [[0.0_f64; 2]; N];
    for k in 0..sectors {
        let middle = TAU * (k as f64 + 0.5) / sectors as f64;
        let border = TAU * k as f64 / sectors as f64;
        let (u, v) = ([middle.cos(), middle.sin()], [-middle.sin(), middle.cos()]);
        let v_border = [-border.sin(), border.cos()];
        let (mut turned, mut radial, mut across) = ([0.0; N], [0.0; N], [0.0; N]);
        for (j, &[tangent, width, edge]) in of_rings.iter().enumerate() {
            let here = at(j, k);
            let beside = at(j, k + sectors - 1);
            let across_by = width * here.nearness.max(beside.nearness);
            let (value, next) = (here.radiance, beside.radiance);
            for ((turned, across), (value, next)) in turned.iter_mut().zip(&mut across).zip(value.into_iter().zip(next)) {
                *turned += value * tangent;
                *across += (value - next) * across_by;
            }
            if j > 0 {
                let inner = at(j - 1, k);
                let radial_by = edge * here.nearness.max(inner.nearness);
                radial
                    .iter_mut()
                    .zip(value.into_iter().zip(inner.radiance))
                    .for_each(|(sum, (v, i))| *sum += (v - i) * radial_by);
            }
        }
        for (rotation, turned) in rotation.iter_mut().zip(turned) {
            [0, 1].into_iter().for_each(|axis| rotation[axis] += v[axis] * turned);
        }
        for (translation, (radial, across)) in translation.iter_mut().zip(radial.into_iter().zip(across)) {
            for axis in [0, 1] {
                translation[axis] += u[axis] * radial * TAU / sectors as f64 + v_border[axis] * across;
            }
        }
    }
    let scale = PI / seen.len() as f64;
    let world = |g: [f64; 2], by: f64| frame.s * (g[0] * by) as f32 + frame.t * (g[1] * by) as f32;
    let channel = |c: usize| c.min(N - 1);
    ([0, 1, 2].map(|c| world(rotation[channel(c)], scale)), [0, 1, 2].map(|c| world(translation[channel(c)], 1.0)))
}
