//! Random walks from the camera and from the lights, with what their weights need.
//!
//! Each vertex carries two sums over all other ways to make the path so far ([Georgiev12], technical report, equations 31 to
//! 36), so that the weight of a connection costs the same however long the path is. Ideal events stay inside the sums; what goes straight on
//! (masks, plates) is no vertex at all, since shadow rays pass there as well.

use super::Heuristic;
use crate::geometry::Ray;
use crate::math::{Rgb, Sampler, Vec3};
use crate::world::sight::Origin;
use crate::world::walk::{RayCounts, most_survival};
use crate::world::{Departures, Shading, SurfaceInteraction, World};
use std::f64::consts::FRAC_1_PI;

/// From this many edges on a walk from the camera or from a lamp goes on with a probability equal to its throughput.
const ROULETTE_DEPTH: [u32; 2] = [5, 2];
/// ... or, from the camera, with this many times its throughput since the second vertex, whichever pixel the light counts for, as in path tracing: what deep vertices are connected with is much of the
/// light behind a door, and few heavy walks that get there are noise.
const SURVIVAL: [f64; 2] = [2.0, 1.0];
/// A connection counts as so many in the weights: it is the mean of several well chosen ones, with less noise than other ways of the same
/// density.
pub const CONNECTION_WORTH: f64 = 3.0;
/// A way counts as so many in the weights if a camera's walk has a plain second vertex that is no lamp, since neighbours lend what they
/// find there.
const LENDING_WORTH: f64 = 4.0;
/// Cosines are taken to be no smaller: densities stay finite.
const LEAST_COSINE: f64 = 1e-9;
/// Straight passages between two vertices, at most.
const MOST_PLATES: u32 = 32;

/// What flows along a walk, seen from its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carried {
    /// Importance leaves the camera: light comes against the walk.
    Radiance,
    /// Light leaves a lamp: it goes with the walk.
    Light,
}

/// A surface point of a walk.
#[derive(Debug, Clone, Copy)]
pub struct Vertex {
    /// The point, seen from the vertex before it.
    pub si: SurfaceInteraction,
    /// From the camera: radiance that leaves the second vertex over radiance that leaves here, or at the first vertex radiance at the camera
    /// over radiance that leaves. From a lamp: power on arrival over the arriving ray's geometric cosine, which [`Vertex::scatter`]
    /// takes up.
    pub throughput: Rgb,
    /// From the camera: radiance there over radiance that leaves the second vertex, white at the first. From a lamp: white.
    pub before: Rgb,
    /// Recursive sums: the way that would connect here, and all ways beyond.
    pub d_vcm: f64,
    /// See `d_vcm`.
    pub d_vc: f64,
    /// What of `d_vcm` and `d_vc` is of ways that depend on how a camera's walk came to its second vertex.
    pub lent: [f64; 2],
    /// Edges from the start.
    pub edges: u32,
    /// Vertices before this one that were not ideal.
    pub scattered: u32,
    /// True if an ideal event led here.
    pub by_ideal: bool,
    /// True if the first surface from the start was ideal.
    pub began_ideal: bool,
    /// Reflectance of a plain Lambertian surface.
    plain: Option<Rgb>,
    /// True if the vertex before was a plain Lambertian surface.
    after_plain: bool,
}

/// How many times a way counts in the weights whose camera's walk has a second vertex, no lamp, of that kind.
#[inline]
fn worth_as_second(is_plain: bool) -> f64 {
    if is_plain { LENDING_WORTH } else { 1.0 }
}

/// What a vertex does with light between the vertex before it and a direction.
#[derive(Debug, Clone, Copy)]
pub struct Scattered {
    /// f |cos| as the path tracer has it, from the camera's side; of a light walk times the ratio of geometric cosines that shading
    /// normals leave aside ([Veach97], section 5.3).
    pub response: Rgb,
    /// Density with which the walk takes the direction [1/sr].
    pub forward: f64,
    /// Density with which a walk that comes from there goes back [1/sr].
    pub reverse: f64,
}

impl Vertex {
    /// All ways to make the path that has the edge to this vertex, or one before, in their middle, over the way that goes on from here:
    /// `reverse` is the density of the way back [1/sr].
    #[inline]
    pub fn other_ways(&self, heuristic: Heuristic, reverse: f64) -> f64 {
        // The first edge is no connection: it stands for a shadow ray, or for a lamp's walk that the camera sees.
        let connecting = if self.edges > 1 { heuristic.of(CONNECTION_WORTH) } else { 1.0 };
        self.d_vcm * connecting + self.d_vc * heuristic.of(reverse)
    }

    /// As [`Self::other_ways`], of a light's walk that the camera sees here.
    #[inline]
    pub fn ways_of_camera(&self, heuristic: Heuristic, reverse: f64) -> f64 {
        if self.edges == 1 {
            return self.other_ways(heuristic, reverse);
        }
        self.d_vcm * heuristic.of(CONNECTION_WORTH) + self.d_vc * heuristic.of(reverse * worth_as_second(self.after_plain))
    }

    /// What of [`Self::other_ways`] is in proportion to the ways that a camera's walk has before its second vertex.
    #[inline]
    pub fn lent_ways(&self, heuristic: Heuristic, reverse: f64) -> f64 {
        self.lent[0] * heuristic.of(CONNECTION_WORTH) + self.lent[1] * heuristic.of(reverse)
    }

    /// What the walk does here, seen as the first vertex of a camera's walk that has its second at `second`, a plain surface that is seen
    /// from here along the unit vector -`back` at `d2` [m²]; and the ways before the second vertex, as [`Self::other_ways`] of that has
    /// them.
    pub fn as_first(&self, walk: &Walk<'_>, second: &Vertex, (back, d2): (Vec3, f64)) -> (Scattered, f64) {
        let scattered = self.scatter(walk.world, Carried::Radiance, -back);
        let mis = |x: f64| walk.heuristic.of(x);
        let cos_out = f64::from(self.si.ng.dot(back).abs());
        let cos_in = f64::from(second.si.ng.dot(back).abs()).max(LEAST_COSINE);
        let d_vcm = mis(d2 / (scattered.forward * cos_in));
        let d_vc = mis(cos_out / (scattered.forward * cos_in)) * self.other_ways(walk.heuristic, scattered.reverse);
        let ways = d_vcm * mis(CONNECTION_WORTH) + d_vc * mis(second.reverse(back));
        (scattered, ways / mis(LENDING_WORTH))
    }

    /// Density of the way back from a plain surface along the unit vector `back`, about its interpolated normal [1/sr].
    #[inline]
    pub fn reverse(&self, back: Vec3) -> f64 {
        f64::from(self.si.ns.dot(back)).max(0.0) * FRAC_1_PI
    }

    /// How many times a way counts in the weights if this is the second vertex of its camera's walk.
    #[inline]
    pub fn worth_as_second(&self) -> f64 {
        worth_as_second(self.plain.is_some())
    }

    /// Reflectance, if this is a plain Lambertian surface.
    pub fn plain(&self) -> Option<Rgb> {
        self.plain
    }

    /// The vertex's part in a path that goes on along the unit vector `toward`.
    #[inline]
    pub fn scatter(&self, world: &World, carried: Carried, toward: Vec3) -> Scattered {
        let si = &self.si;
        let dark = Scattered { response: Rgb::BLACK, forward: 0.0, reverse: 0.0 };
        let (out, back) = (si.ng.dot(toward), si.ng.dot(si.wo));
        let (cos_out, cos_in) = (f64::from(out.abs()), f64::from(back.abs()).max(LEAST_COSINE));
        if let Some(rho) = self.plain {
            if out <= 0.0 {
                return dark;
            }
            // Seen from where it came, and from where it goes.
            let forward = f64::from(si.shading_normal(si.wo).dot(toward)).max(0.0) * FRAC_1_PI;
            let reverse = f64::from(si.shading_normal(toward).dot(si.wo)).max(0.0) * FRAC_1_PI;
            let response = match carried {
                Carried::Radiance => rho * forward,
                Carried::Light => rho * (reverse * cos_out / cos_in),
            };
            return Scattered { response, forward, reverse };
        }
        let here = world.shading(si);
        let turned = si.seen_from(toward);
        let there = world.shading(&turned);
        let response = match carried {
            Carried::Radiance => here.eval(toward).total(),
            Carried::Light => there.eval(si.wo).total() * (cos_out / cos_in),
        };
        if response.is_black() {
            return dark;
        }
        Scattered { response, forward: here.pdf(toward), reverse: there.pdf(si.wo) }
    }
}

/// Where a camera walk's last edge started, for light that it meets.
#[derive(Debug, Clone, Copy)]
pub struct LastEdge {
    /// Sums before the edge.
    pub d_vcm: f64,
    /// See `d_vcm`.
    pub d_vc: f64,
    /// The vertex it started from, unless that is the camera or ideal.
    pub origin: Option<Origin>,
    /// Edges with this one.
    pub edges: u32,
    /// Vertices that were not ideal.
    pub scattered: u32,
    /// Radiance at the second vertex over radiance along the edge, or of the first two edges radiance at their start.
    pub throughput: Rgb,
    /// Radiance at the camera over radiance that leaves the second vertex; white on the first edge.
    pub before: Rgb,
    /// As [`Vertex::lent`], of `d_vc`.
    pub lent: f64,
    /// True if it passed straight through something.
    pub passed: bool,
    /// True if an ideal event was its start.
    pub by_ideal: bool,
}

/// What a walk meets, handed to its visitor.
pub enum Met<'a> {
    /// A surface: the vertex, its material seen from the vertex before, the last edge.
    Surface(&'a Vertex, &'a Shading<'a>, &'a LastEdge),
    /// The outside, along the unit direction.
    Outside(Vec3, &'a LastEdge),
}

/// A walk under way.
pub struct Walk<'a> {
    /// The scene.
    pub world: &'a World,
    /// How the ways to make a path share it.
    pub heuristic: Heuristic,
    /// What flows.
    pub carried: Carried,
}

/// The start of a walk.
pub struct Start {
    /// First ray.
    pub ray: Ray,
    /// What the ray carries.
    pub throughput: Rgb,
    /// Sums before the first edge; of a light walk they are made at its first surface.
    pub d_vcm: f64,
    /// See `d_vcm`.
    pub d_vc: f64,
}

impl Walk<'_> {
    /// Walks until light is absorbed or `most_edges` are walked. `begin` may set the sums and the throughput of the first vertex, once it
    /// is known.
    pub fn go(
        &self,
        start: Start,
        most_edges: u32,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
        begin: impl Fn(&mut Vertex, &Shading<'_>),
        mut visit: impl FnMut(Met<'_>, &mut Sampler, &mut RayCounts),
    ) {
        let mis = |x: f64| self.heuristic.of(x);
        let mut ray = start.ray;
        let first = start.throughput.max();
        let mut edge = LastEdge {
            d_vcm: start.d_vcm,
            d_vc: start.d_vc,
            origin: None,
            edges: 1,
            scattered: 0,
            throughput: start.throughput,
            before: Rgb::WHITE,
            lent: 0.0,
            passed: false,
            by_ideal: false,
        };
        let mut began_ideal = false;
        // Where the last vertex was: straight passages leave it alone.
        let mut from = ray.origin;
        let mut after_plain = false;
        let mut eta = 1.0;
        let mut plates = 0;
        while edge.edges <= most_edges {
            let Some(si) = self.world.intersect(&ray) else {
                visit(Met::Outside(ray.direction, &edge), sampler, counts);
                return;
            };
            let shading = self.world.shading(&si);
            let cos_in = f64::from(si.ng.dot(si.wo).abs()).max(LEAST_COSINE);
            let d2 = f64::from(si.point.distance_squared(from));
            let mut vertex = Vertex {
                si,
                throughput: edge.throughput,
                before: edge.before,
                d_vcm: edge.d_vcm * mis(d2) / mis(cos_in),
                d_vc: edge.d_vc / mis(cos_in),
                lent: [0.0, edge.lent / mis(cos_in)],
                edges: edge.edges,
                scattered: edge.scattered,
                by_ideal: edge.by_ideal,
                began_ideal,
                plain: shading.plain(),
                after_plain,
            };
            if self.carried == Carried::Light && edge.edges == 1 {
                begin(&mut vertex, &shading);
            }
            if edge.edges == 2 && self.carried == Carried::Radiance {
                vertex.d_vcm /= mis(vertex.worth_as_second());
                vertex.d_vc /= mis(vertex.worth_as_second());
                vertex.lent = [vertex.d_vcm, vertex.d_vc];
            }
            visit(Met::Surface(&vertex, &shading, &edge), sampler, counts);

            let u = sampler.next_2d();
            let choice = if shading.material.needs_choice() { sampler.next_1d() } else { 0.0 };
            let Some(next) = shading.sample(u, choice) else { return };
            let mut throughput = edge.throughput;
            if next.straight {
                // No vertex: the edge goes on, and what was in its way takes its share.
                plates += 1;
                if plates > MOST_PLATES {
                    return;
                }
                edge.throughput = throughput * next.weight;
                edge.passed = true;
                ray = si.spawn(next.direction);
                continue;
            }
            plates = 0;
            let cos_out = f64::from(si.ng.dot(next.direction).abs());
            match next.density {
                None => {
                    let factor = match self.carried {
                        Carried::Radiance => Rgb::WHITE,
                        // Power has no n² scaling; bent normals take and give by their cosines.
                        Carried::Light => {
                            let n = shading.normal();
                            let bent = f64::from((n.dot(si.wo) / n.dot(next.direction)).abs()) * cos_out / cos_in;
                            Rgb::grey(next.eta * next.eta * if bent.is_finite() { bent } else { 0.0 })
                        }
                    };
                    throughput *= next.weight * factor;
                    edge.d_vcm = 0.0;
                    edge.d_vc = vertex.d_vc * mis(cos_out);
                    edge.lent = vertex.lent[1] * mis(cos_out);
                    edge.origin = None;
                    began_ideal |= edge.edges == 1;
                }
                Some(density) => {
                    let scattered = vertex.scatter(self.world, self.carried, next.direction);
                    throughput *= match self.carried {
                        Carried::Radiance => next.weight,
                        Carried::Light => scattered.response / density,
                    };
                    edge.d_vc = mis(cos_out / density) * vertex.other_ways(self.heuristic, scattered.reverse);
                    edge.lent = mis(cos_out / density) * vertex.lent_ways(self.heuristic, scattered.reverse);
                    edge.d_vcm = mis(1.0 / density);
                    edge.scattered += 1;
                    let sampling = Shading::IN_PASSING;
                    edge.origin = Some(Origin { point: si.point, receiver: shading.receiver(), density, sampling });
                }
            }
            after_plain = vertex.plain.is_some();
            eta *= next.eta;
            edge.by_ideal = next.density.is_none();
            edge.edges += 1;
            edge.passed = false;
            edge.throughput = throughput;
            if edge.edges == 2 && self.carried == Carried::Radiance {
                (edge.before, edge.throughput) = (throughput, Rgb::WHITE);
            }
            if throughput.is_black() || !throughput.is_finite() {
                return;
            }
            if edge.edges > ROULETTE_DEPTH[self.carried as usize] {
                let scale = if self.carried == Carried::Radiance { eta * eta } else { 1.0 / first };
                let survival =
                    (throughput.max() * scale * SURVIVAL[self.carried as usize]).min(most_survival(edge.by_ideal, edge.edges));
                if survival < 1.0 && f64::from(sampler.next_1d()) >= survival {
                    return;
                }
                edge.throughput = throughput / survival;
            }
            if next.direction.dot(si.ng) < 0.0 {
                counts.transmitted += 1;
            } else {
                counts.reflected += 1;
            }
            from = si.point;
            ray = si.spawn(next.direction);
        }
        if self.carried == Carried::Radiance {
            counts.truncate(edge.before * edge.throughput);
        }
    }
}

/// A light walk's start, and what makes its first vertex comparable with shadow rays.
pub fn depart(world: &World, departures: &Departures, sampler: &mut Sampler) -> Option<(Start, crate::world::Departure)> {
    let departure = departures.sample(world, sampler)?;
    Some((Start { ray: departure.ray, throughput: departure.power, d_vcm: 0.0, d_vc: 0.0 }, departure))
}

/// Sets the sums of a light walk's first vertex.
pub fn begin_light(
    world: &World,
    heuristic: Heuristic,
    departure: &crate::world::Departure,
    vertex: &mut Vertex,
    shading: &Shading<'_>,
) {
    let cos_in = f64::from(vertex.si.ng.dot(vertex.si.wo).abs()).max(LEAST_COSINE);
    let sampling = Shading::IN_PASSING;
    let origin = Origin { point: vertex.si.point, receiver: shading.receiver(), density: 0.0, sampling };
    let shadow = departure.shadow_density(world, &origin);
    vertex.d_vcm = heuristic.of(shadow / (departure.density * cos_in));
    vertex.d_vc = if departure.is_delta { 0.0 } else { heuristic.of(1.0 / (departure.density * cos_in)) };
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::math::Vec2;

    /// A vertex at a point, seen from above.
    pub fn vertex_at(point: Vec3) -> Vertex {
        let si = SurfaceInteraction {
            point,
            error: Vec3::ZERO,
            ng: Vec3::Z,
            ns: Vec3::Z,
            uv: Vec2::ZERO,
            place: (0.0, 0.0),
            shape: 0,
            primitive: 0,
            front: true,
            wo: Vec3::Z,
            t: 0.0,
            end: 0.0,
        };
        Vertex {
            si,
            throughput: Rgb::WHITE,
            before: Rgb::WHITE,
            d_vcm: 0.0,
            d_vc: 0.0,
            lent: [0.0; 2],
            edges: 1,
            scattered: 0,
            by_ideal: false,
            began_ideal: false,
            plain: None,
            after_plain: false,
        }
    }
}
