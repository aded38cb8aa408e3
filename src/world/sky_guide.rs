//! Which parts of the sky can be seen from where: shadow rays towards the surroundings of an interior go through its windows.
//!
//! Surroundings are drawn by their radiance, which in a room sends most shadow rays into walls. Here the unit square from which they are
//! drawn is divided into bins of equal irradiance, and for places alike (a cell of a grid over what the camera sees, and one of six main
//! directions of the normal) it is measured once how much of each bin arrives. Later samples are drawn from bins in proportion: a
//! histogram of the product of radiance, visibility and cosine, in the spirit of the guiding of [Vorba14]. The density accounts for it, so
//! that pictures keep their mean; a share of the samples ignores the guide, for what the measurement missed.

use super::World;
use crate::geometry::Bounds;
use crate::light::{Environment, Light, LightSample};
use crate::math::{Frame, Sampler, Vec2, Vec3, sampler::mix, warp};
use rayon::prelude::*;

/// Bins along each side of the unit square.
const SIDE: usize = 16;
/// Bins in all.
const BINS: usize = SIDE * SIDE;
/// Cells along the longest side of the grid.
const CELLS: f32 = 10.0;
/// Camera rays whose hits, and those of their reflections, are the places to know.
const PATHS: u64 = 4096;
/// Places along each of them.
const HITS: usize = 3;
/// Rays for each kind of place: four a bin.
const RAYS: usize = 4 * BINS;
/// Share of the samples that is spread as if there were no guide.
const UNGUIDED: f32 = 0.2;
/// Share of the weight of each of its eight neighbours that a bin is given.
const NEIGHBOUR: f64 = 0.15;
/// Where more than this share of the sky is seen a guide would save nothing.
const OPEN: f64 = 0.4;
/// Share of the places beyond the grid at either end of an axis; they belong to its border.
const BEYOND: f32 = 0.02;
/// Seed of the measurement: the guide belongs to the scene, whatever the seed of the picture.
const SEED: u64 = 0x5ea_51de;

/// What is known of the sky at places of a scene.
#[derive(Debug)]
pub(super) struct SkyGuide {
    low: Vec3,
    per_length: f32,
    size: [usize; 3],
    /// Index of the table of each cell and main direction; [`NONE`] without one.
    table_of: Vec<u32>,
    tables: Vec<Table>,
}

/// A distribution over the bins.
#[derive(Debug)]
struct Table {
    /// Running sum over the rows.
    rows: [f32; SIDE],
    /// In each row the running sum over its columns, 1 at the end.
    columns: [[f32; SIDE]; SIDE],
    /// Probability of each bin times the number of bins.
    density: [f32; BINS],
}

const NONE: u32 = u32::MAX;

/// A place that light may reach, with the normal of its side.
struct Place {
    point: Vec3,
    normal: Vec3,
    error: Vec3,
}

impl SkyGuide {
    /// Measures a scene; `None` if there is no map of surroundings that shadow rays look for, or most of it is seen anyway.
    pub fn measure(world: &World) -> Option<Self> {
        let environment = world.environment_map()?;
        let places = places(world);
        let mut guide = Self::over(&places)?;
        let mut members: Vec<Vec<usize>> = Vec::new();
        for (i, place) in places.iter().enumerate() {
            let slot = guide.slot(place.point, place.normal);
            if guide.table_of[slot] == NONE {
                guide.table_of[slot] = members.len() as u32;
                members.push(Vec::new());
            }
            members[guide.table_of[slot] as usize].push(i);
        }
        let directions = directions(environment);
        let measured: Vec<([f64; BINS], f64)> = members
            .par_iter()
            .enumerate()
            .map(|(table, members)| {
                let places: Vec<&Place> = members.iter().map(|i| &places[*i]).collect();
                arriving(world, &directions, &places, table as u64)
            })
            .collect();
        let seen: f64 = measured.iter().map(|m| m.1).sum::<f64>() / measured.len().max(1) as f64;
        if seen > OPEN {
            return None;
        }
        guide.tables = measured.iter().map(|(weights, _)| Table::new(&spread(weights))).collect();
        Some(guide)
    }

    /// A grid over places, without tables.
    fn over(places: &[Place]) -> Option<Self> {
        let mut bounds = Bounds::EMPTY;
        for axis in 0..3 {
            let mut along: Vec<f32> = places.iter().map(|p| p.point[axis]).collect();
            along.sort_by(f32::total_cmp);
            let at = |share: f32| along.get(((along.len() as f32 - 1.0) * share) as usize).copied();
            (bounds.min[axis], bounds.max[axis]) = (at(BEYOND)?, at(1.0 - BEYOND)?);
        }
        let extent = bounds.max - bounds.min;
        let per_length = CELLS / extent.max_element();
        if !per_length.is_finite() {
            return None;
        }
        let size = extent.to_array().map(|e| (e * per_length) as usize + 2);
        let table_of = vec![NONE; 6 * size.iter().product::<usize>()];
        // Walls at the ends of the grid shall not lie between two cells.
        let low = bounds.min - Vec3::splat(0.5 / per_length);
        Some(Self { low, per_length, size, table_of, tables: Vec::new() })
    }

    /// Where the table of a place is kept.
    #[inline]
    fn slot(&self, point: Vec3, normal: Vec3) -> usize {
        let cell = ((point - self.low) * self.per_length).to_array();
        let at = |axis: usize| (cell[axis].max(0.0) as usize).min(self.size[axis] - 1);
        let cell = (at(0) * self.size[1] + at(1)) * self.size[2] + at(2);
        let magnitude = normal.abs();
        let axis = if magnitude.x >= magnitude.y && magnitude.x >= magnitude.z {
            0
        } else if magnitude.y >= magnitude.z {
            1
        } else {
            2
        };
        6 * cell + 2 * axis + usize::from(normal[axis] < 0.0)
    }

    #[inline]
    fn table(&self, point: Vec3, normal: Option<Vec3>) -> Option<&Table> {
        self.tables.get(self.table_of[self.slot(point, normal?)] as usize)
    }

    /// A sample of the surroundings as seen from `point` by a receiver with normal `normal`.
    #[inline]
    pub fn sample(&self, environment: &Environment, point: Vec3, normal: Option<Vec3>, u: Vec2) -> Option<LightSample> {
        let (u, density) = self.table(point, normal).map_or((u, 1.0), |table| table.warp(u));
        let (direction, radiance, pdf) = environment.sample(u);
        let pdf = pdf * f64::from(density);
        (pdf > 0.0).then(|| LightSample { target: None, direction, irradiance: radiance / pdf, pdf, area_density: 0.0 })
    }

    /// Density per steradian with which [`Self::sample`] finds `direction`.
    #[inline]
    pub fn pdf(&self, environment: &Environment, point: Vec3, normal: Option<Vec3>, direction: Vec3) -> f64 {
        let pdf = environment.pdf(direction);
        self.table(point, normal).map_or(pdf, |table| pdf * f64::from(table.density[bin_of(environment.square(direction))]))
    }
}

/// Index of the bin of a point of the unit square.
#[inline]
fn bin_of(u: Vec2) -> usize {
    let along = |t: f32| ((t * SIDE as f32) as usize).min(SIDE - 1);
    along(u.y) * SIDE + along(u.x)
}

/// Gives each bin a share of its neighbours' weight: the border of a window reaches into bins where no ray found it, and light that is
/// left to unguided samples is the noisiest.
fn spread(weights: &[f64; BINS]) -> [f64; BINS] {
    std::array::from_fn(|bin| {
        let (row, column) = (bin / SIDE, bin % SIDE);
        let rows = row.saturating_sub(1)..(row + 2).min(SIDE);
        let around = rows.flat_map(|r| [SIDE - 1, 0, 1].map(|step| r * SIDE + (column + step) % SIDE));
        weights[bin] + NEIGHBOUR * around.filter(|&other| other != bin).map(|other| weights[other]).sum::<f64>()
    })
}

impl Table {
    /// In proportion to `weights`, but for the unguided share.
    fn new(weights: &[f64; BINS]) -> Self {
        let total: f64 = weights.iter().sum();
        let even = if total > 0.0 { UNGUIDED } else { 1.0 };
        let density = weights.map(|w| even + if total > 0.0 { (1.0 - even) * (w / total) as f32 * BINS as f32 } else { 0.0 });
        let mut table = Self { rows: [0.0; SIDE], columns: [[0.0; SIDE]; SIDE], density };
        let mut all = 0.0;
        for row in 0..SIDE {
            let bins = &density[row * SIDE..(row + 1) * SIDE];
            let sum: f32 = bins.iter().sum();
            let mut running = 0.0;
            for (column, bin) in bins.iter().enumerate() {
                running += bin / sum;
                table.columns[row][column] = running;
            }
            all += sum / BINS as f32;
            table.rows[row] = all;
        }
        // What a bin is drawn with is what the running sums say, roundings included.
        for bin in 0..BINS {
            let step = |of: &[f32; SIDE], i: usize| of[i] - if i == 0 { 0.0 } else { of[i - 1] };
            let (row, column) = (bin / SIDE, bin % SIDE);
            let ends = table.rows[SIDE - 1] * table.columns[row][SIDE - 1];
            table.density[bin] = step(&table.rows, row) * step(&table.columns[row], column) / ends * BINS as f32;
        }
        table
    }

    /// Moves a point of the unit square; also the density with which it comes to lie there.
    #[inline]
    fn warp(&self, u: Vec2) -> (Vec2, f32) {
        let (row, y) = pick(&self.rows, u.y);
        let (column, x) = pick(&self.columns[row], u.x);
        let inside = |i: usize, t: f32| ((i as f32 + t) / SIDE as f32).min(1.0 - f32::EPSILON);
        (Vec2::new(inside(column, x), inside(row, y)), self.density[row * SIDE + column])
    }
}

/// The step of a running sum that `u` falls on, and how far into it.
#[inline]
fn pick(running: &[f32; SIDE], u: f32) -> (usize, f32) {
    let target = u * running[SIDE - 1];
    let i = running.partition_point(|&r| r <= target).min(SIDE - 1);
    let before = if i == 0 { 0.0 } else { running[i - 1] };
    (i, ((target - before) / (running[i] - before)).clamp(0.0, 1.0 - f32::EPSILON))
}

/// What the camera sees, and what is seen from there.
fn places(world: &World) -> Vec<Place> {
    let scene = world.scene();
    let (width, height) = (scene.film.width, scene.film.height);
    let paths: Vec<Vec<Place>> = (0..PATHS)
        .into_par_iter()
        .map(|i| {
            let mut sampler = Sampler::new(SEED, 0, i);
            let mut ray = scene.camera.ray(sampler.next_2d() * Vec2::new(width as f32, height as f32), width, height);
            let mut found = Vec::new();
            while found.len() < HITS {
                let Some(si) = world.intersect(&ray) else { break };
                found.push(Place { point: si.point, normal: si.ng, error: si.error });
                ray = si.spawn(Frame::new(si.ng).to_world(warp::cosine_hemisphere(sampler.next_2d())));
            }
            found
        })
        .collect();
    paths.into_iter().flatten().collect()
}

/// One direction for each ray, the first [`BINS`] of them in the order of their bins; zero where the sky is dark.
fn directions(environment: &Environment) -> Vec<Vec3> {
    let one = |k: usize| {
        let u = Sampler::new(mix(SEED), 0, k as u64).next_2d();
        let bin = k % BINS;
        let at = Vec2::new((bin % SIDE) as f32 + u.x, (bin / SIDE) as f32 + u.y) / SIDE as f32;
        let (direction, _, pdf) = environment.sample(at);
        if pdf > 0.0 { direction } else { Vec3::ZERO }
    };
    (0..RAYS).map(one).collect()
}

/// Irradiance that arrives at places alike from each bin, and the share of the bins that is seen.
fn arriving(world: &World, directions: &[Vec3], places: &[&Place], key: u64) -> ([f64; BINS], f64) {
    let mut weights = [0.0; BINS];
    let (mut seen, mut above) = (0.0, 0.0);
    for (k, &direction) in directions.iter().enumerate() {
        let u = Sampler::new(mix(SEED ^ 1), key, k as u64).next_1d();
        let place = places[(u * places.len() as f32) as usize % places.len()];
        let cos = direction.dot(place.normal);
        if cos <= 0.0 {
            continue;
        }
        let si = super::SurfaceInteraction::new(
            place.point,
            place.error,
            place.normal,
            place.normal,
            Vec2::ZERO,
            (0.0, 0.0),
            0,
            0,
            place.normal,
        );
        let share = world.transmittance(&si.spawn(direction)).luminance();
        weights[k % BINS] += f64::from(cos) * share;
        seen += share;
        above += 1.0;
    }
    (weights, if above > 0.0 { seen / above } else { 0.0 })
}

impl World {
    /// The map of surroundings that shadow rays look for.
    fn environment_map(&self) -> Option<&Environment> {
        match &self.scene.lights[self.partition.environment()?] {
            Light::Environment(environment) if !environment.is_uniform() => Some(environment),
            _ => None,
        }
    }
}
