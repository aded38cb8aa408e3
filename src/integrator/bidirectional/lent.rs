//! What camera walks find from their second vertices on, lent between the pixels of a tile [Bekaert02].
//!
//! Each pixel whose first surface sees the second vertex of a neighbour's walk could have gone there itself; one ray tells. What the walk
//! finds from there on counts for all of them by the balance heuristic over the densities with which they would have gone there, so
//! the mean of each pixel is right. The weight of a path against other ways to make it is that of the whole path from the pixel it counts
//! for: where the second vertex is a plain surface, the sum over all ways is linear in one number that says how the walk came there.

use super::subpath::{Vertex, Walk};
use super::{Connector, Found, Keeper};
use crate::film::{PixelSample, Quantity};
use crate::geometry::offset_origin;
use crate::math::{Rgb, Vec2, Vec3};
use crate::world::walk::RayCounts;

/// Columns of a tile.
pub const COLUMNS: usize = 4;
/// Rows of a tile. Twice as many columns would bring 10 % more where light is rare, in larger tiles whose errors are alike.
pub const ROWS: usize = 4;
/// Pixels of a tile.
pub const PIXELS: usize = COLUMNS * ROWS;
/// Least cosine at which a surface with interpolated normals has them towards a viewer
/// ([`crate::world::SurfaceInteraction::shading_normal`]).
const LEAST_COSINE: f32 = 1e-4;

/// The first surface of a pixel.
pub struct First {
    /// Index of the pixel in the tile.
    pub pixel: usize,
    /// Its place on the whole film [pixels].
    pub film_point: Vec2,
    /// The surface.
    pub vertex: Vertex,
}

/// A plain surface that the walk of one of them has met next.
pub struct Second {
    /// Index of the first surface.
    from: usize,
    vertex: Vertex,
    /// Density per steradian with which it was drawn.
    density: f64,
    /// What was found from there on.
    found: Vec<Beyond>,
}

/// What was found beyond.
struct Beyond {
    found: Found,
    /// Edges of the path, and its vertices from the lamp.
    way: (u32, u32),
    /// How many times it counts.
    times: f64,
}

/// What the walks of a tile have to lend.
#[derive(Default)]
pub struct Lent {
    firsts: Vec<First>,
    seconds: Vec<Second>,
}

impl Second {
    /// Keeps what a path of so many edges and vertices from the lamp brings, to be counted so many `times`.
    #[inline]
    pub fn add(&mut self, way: (u32, u32), found: Found, times: f64) {
        if !found.light.is_black() {
            self.found.push(Beyond { found, way, times });
        }
    }
}

impl Lent {
    /// A first surface that others may lend to.
    pub fn begin(&mut self, first: First) {
        self.firsts.push(first);
    }

    /// The second vertex of the walk that began last, if others may use what is found from there on; `density` is that with which it was
    /// drawn [1/sr].
    pub fn go_on(&mut self, vertex: &Vertex, density: f64) -> bool {
        let Some(first) = self.firsts.last() else { return false };
        let (_, d2, per_area) = seen_from(vertex, &first.vertex);
        let lends = vertex.plain().is_some() && is_even(vertex.si.wo.dot(vertex.si.ns)) && per_area > 0.0 && d2 > 0.0;
        if lends {
            self.seconds.push(Second { from: self.firsts.len() - 1, vertex: *vertex, density, found: Vec::new() });
        }
        lends
    }

    /// The second vertex last kept.
    pub fn second(&mut self) -> Option<&mut Second> {
        self.seconds.last_mut()
    }

    /// Adds to each pixel what all of the tile have found, and forgets it.
    pub fn lend(
        &mut self,
        connector: &Connector<'_>,
        counts: &mut RayCounts,
        keeper: &mut Keeper<'_>,
        samples: &mut [PixelSample],
    ) {
        let walk = connector.camera_walk();
        for second in &self.seconds {
            if !second.found.is_empty() {
                second.lend(&self.firsts, &walk, counts, keeper, samples);
            }
        }
        self.firsts.clear();
        self.seconds.clear();
    }
}

/// A pixel that may have gone to a second vertex.
#[derive(Clone, Copy, Default)]
struct Borrower {
    /// Radiance at the camera over radiance that leaves the second vertex.
    before: Rgb,
    /// Density with which it goes there [1/m²]; 0 if it does not.
    density: f64,
    /// Ways before the second vertex, over those of the walk that was there.
    ways: f64,
}

impl Second {
    fn lend(
        &self,
        firsts: &[First],
        walk: &Walk<'_>,
        counts: &mut RayCounts,
        keeper: &mut Keeper<'_>,
        samples: &mut [PixelSample],
    ) {
        let si = &self.vertex.si;
        let target = offset_origin(si.point, si.error, si.ng, si.ng);
        let (back, _, per_area) = seen_from(&self.vertex, &firsts[self.from].vertex);
        let own_ways = self.vertex.lent_ways(walk.heuristic, self.vertex.reverse(back));
        let mut borrowers = [Borrower::default(); PIXELS];
        borrowers[self.from] = Borrower { before: self.vertex.before, density: self.density * per_area, ways: 1.0 };
        for (k, (first, borrower)) in firsts.iter().zip(&mut borrowers).enumerate() {
            if k == self.from {
                continue;
            }
            let (back, d2, per_area) = seen_from(&self.vertex, &first.vertex);
            if per_area <= 0.0 || !per_area.is_finite() || !is_even(back.dot(si.ns)) {
                continue;
            }
            let (scattered, ways) = first.vertex.as_first(walk, &self.vertex, (back, d2));
            if scattered.forward <= 0.0 || scattered.response.is_black() {
                continue;
            }
            counts.connected += 1;
            if walk.world.occluded(&first.vertex.si.spawn_to(target)) {
                continue;
            }
            let before = first.vertex.throughput * scattered.response / scattered.forward;
            *borrower = Borrower { before, density: scattered.forward * per_area, ways: ways / own_ways };
        }
        let all: f64 = borrowers.iter().map(|b| b.density).sum();
        for (first, borrower) in firsts.iter().zip(&borrowers) {
            if borrower.density <= 0.0 {
                continue;
            }
            let share = borrower.density / all;
            let kept: Rgb = self
                .found
                .iter()
                .map(|beyond| {
                    let Found { light, lent } = beyond.found;
                    let light = borrower.before * light / (1.0 - lent + lent * borrower.ways);
                    keeper.keep(first.film_point, beyond.way, light, beyond.times * share)
                })
                .fold(Rgb::BLACK, |sum, light| sum + light);
            *samples[first.pixel].layer(Quantity::Indirect) += kept;
        }
    }
}

/// Unit direction from a second vertex back to a first one, their squared distance [m²], and the solid angle that an area there fills as
/// seen from the first [sr/m²]; not above 0 from behind.
#[inline]
fn seen_from(second: &Vertex, first: &Vertex) -> (Vec3, f64, f64) {
    let way = first.si.point - second.si.point;
    let d2 = way.length_squared();
    let back = way / d2.sqrt();
    (back, f64::from(d2), f64::from(back.dot(second.si.ng) / d2))
}

/// True if the surface reflects towards a viewer, at that cosine to its interpolated normal, about the same normal as to any other that
/// looks at it from above.
#[inline]
fn is_even(cos: f32) -> bool {
    cos > LEAST_COSINE
}
