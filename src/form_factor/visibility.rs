//! How much of what two polygons exchange is left by what stands in between: obstructed = V x unobstructed, 0 <= V <= 1.
//!
//! First a conservative test: a shaft without surfaces is clear, one with a surface right across is blocked; both are exact. Between, with few
//! surfaces, V is an integral over one polygon of what each of its points sees of the other, with shadows cut out exactly, by a rule that
//! is refined where it bends. With many surfaces, V is the share of rays between the two that arrive, weighted by the kernel.

use super::blockers::{Blockers, Found};
use super::polygon::Polygon;
use super::polygon::shadow::ShadowCutter;
use super::polygon::shaft::{self, Shaft};
use crate::geometry::{Ray, offset_origin};
use crate::math::{DVec3, Sampler, Vec3};
use crate::world::World;
use smallvec::SmallVec;
use std::f64::consts::PI;

/// With up to this many polygons in the shaft their shadows are cut out; with more, rays are cheaper.
const MOST_SHADOWS: usize = 16;
/// Ratio of sizes from which on shadows are looked for from points of the smaller polygon.
const UNEVEN: f64 = 3.0;
/// Quarters of quarters: how often the rule over a polygon may be refined.
const DEEPEST: u32 = 6;
/// Intervals a side of the grid on which shadows are looked for that no point of a rule has seen.
const GRID: usize = 4;
/// First and last number of rays for a pair.
const RAYS: (u64, u64) = (16, 1 << 16);
/// An exchange may be wrong by more than the tolerance where the form factor is below this, by the root of their ratio but no more than
/// `MOST_LENIENT` times: small ones count less in any sum.
const LENIENT_BELOW: f64 = 0.01;
const MOST_LENIENT: f64 = 4.0;
/// Where little is seen an exchange may be wrong by so many times the tolerance of itself, down to this share of the unobstructed one.
const OF_SEEN: f64 = 5.0;
const LEAST_SEEN: f64 = 1e-3;

/// A_i F_ij [m²] with its error.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Transfer {
    /// The value [m²], the same in both directions.
    pub value: f64,
    /// Estimate of its standard error [m²].
    pub error: f64,
}

impl Transfer {
    /// The sum of independent parts.
    pub fn plus(self, other: Transfer) -> Transfer {
        Transfer { value: self.value + other.value, error: self.error.hypot(other.error) }
    }
}

/// What the exchange between two polygons is asked of.
pub struct Between<'a> {
    /// The scene.
    pub world: &'a World,
    /// Its surfaces as polygons.
    pub blockers: &'a Blockers,
    /// Relative error allowed to an exchange between polygons, compared to the unobstructed one.
    pub tolerance: f64,
    /// Relative error allowed to the unobstructed kernel.
    pub kernel_tolerance: f64,
    /// Error allowed to a form factor where rays measure: what takes more rays than this asks for would be lost in the row.
    pub ray_tolerance: f64,
    /// Seed of the rays.
    pub seed: u64,
}

impl Between<'_> {
    /// Polygons that may stand between `p` and `q`, one of which may stand for a group.
    pub fn candidates(&self, p: &Polygon, q: &Polygon, most: usize) -> Found {
        self.blockers.find(&Shaft::between(p, q, self.blockers.slack()), most)
    }

    /// What `p` and `q` exchange. `known`: what may stand between groups that they belong to. Rays depend on `key` alone.
    pub fn transfer(&self, p: &Polygon, q: &Polygon, known: Option<&Found>, key: u64) -> Transfer {
        let free = p.transfer(q, self.kernel_tolerance);
        if free <= 0.0 {
            return Transfer::default();
        }
        let clear = Transfer { value: free, error: free * self.kernel_tolerance };
        if known.is_some_and(Found::is_clear) {
            return clear;
        }
        let shaft = Shaft::between(p, q, self.blockers.slack());
        let found = match known {
            Some(known) if !known.more => {
                let inside = known.polygons.iter().copied().filter(|&i| self.blockers.may_hold(&shaft, i));
                Found { polygons: inside.collect(), more: false }
            }
            _ => self.blockers.find(&shaft, MOST_SHADOWS),
        };
        if found.is_clear() {
            return clear;
        }
        let polygons = || found.polygons.iter().filter_map(|&i| self.blockers.polygon(i));
        if polygons().any(|blocker| shaft::blocks_all(blocker, p, q, self.blockers.slack())) {
            return Transfer::default();
        }
        let Some((p, q)) = shaft::facing(p, q) else { return clear };
        let share = if found.more || found.polygons.len() > MOST_SHADOWS {
            self.by_rays(&p, &q, free, key)
        } else {
            let cut: Shadows = polygons().filter_map(|blocker| shaft::between_planes(blocker, &p, &q)).collect();
            let lenient = (LENIENT_BELOW * p.area().min(q.area()) / free).sqrt().clamp(1.0, MOST_LENIENT);
            self.by_shadows(&p, &q, &cut, self.tolerance * lenient)
        };
        Transfer { value: free * share.value.clamp(0.0, 1.0), error: (free * share.error).hypot(clear.error) }
    }

    /// V by what the points of one polygon see of the other.
    fn by_shadows(&self, p: &Polygon, q: &Polygon, blockers: &Shadows, tolerance: f64) -> Transfer {
        if blockers.is_empty() {
            return Transfer { value: 1.0, error: 0.0 };
        }
        // From the polygon further from what casts the shadows: they move less there from point to point.
        let mean = blockers.iter().map(Polygon::center).sum::<DVec3>() / blockers.len() as f64;
        let is_further = mean.distance_squared(p.center()) >= mean.distance_squared(q.center());
        // But never from one so large that few of its points count.
        let (p, q) = match p.radius() / q.radius() {
            ratio if ratio > UNEVEN => (q, p),
            ratio if ratio * UNEVEN < 1.0 || is_further => (p, q),
            _ => (q, p),
        };
        let mut over = Shadowed { p, q, blockers, cutter: ShadowCutter::default() };
        let panels: SmallVec<[[DVec3; 4]; 4]> = p.panels().collect();
        let coarse: SmallVec<[Sums; 4]> = panels.iter().map(|panel| over.rule(panel)).collect();
        let whole: f64 = coarse.iter().map(|s| s.whole).sum();
        let mut allowed = tolerance * whole;
        let total = loop {
            let mut total = Sums::default();
            for (panel, coarse) in panels.iter().zip(&coarse) {
                total.add(over.refined(panel, *coarse, allowed, DEEPEST));
            }
            // Of little that is seen, the error may be a larger share of it, but still a small one.
            let of_seen = OF_SEEN * self.tolerance * total.seen.max(LEAST_SEEN * whole);
            if allowed <= 1.5 * of_seen {
                break total;
            }
            allowed = of_seen;
        };
        let value = if total.whole > 0.0 { total.seen / total.whole } else { 1.0 };
        Transfer { value, error: if total.whole > 0.0 { total.error2.sqrt() / total.whole } else { 0.0 } }
    }

    /// V by rays, 16, 64, 256 ... until its error is allowed.
    fn by_rays(&self, p: &Polygon, q: &Polygon, free: f64, key: u64) -> Transfer {
        let allowed = self.ray_tolerance * p.area().min(q.area()) / free;
        let (mut weights, mut seen) = (Vec::<(f64, bool)>::new(), (0.0, 0.0));
        let (mut n, most) = RAYS;
        loop {
            for k in weights.len() as u64..n {
                let mut sampler = Sampler::new(self.seed, key, k);
                let (a, b) = (point_of(p, &mut sampler), point_of(q, &mut sampler));
                let d = b - a;
                let r2 = d.length_squared();
                let weight = (d.dot(p.normal()) * -d.dot(q.normal())).max(0.0) / (PI * r2 * r2);
                let arrives = weight > 0.0 && !self.world.occluded(&segment(a, p.normal(), b, q.normal()));
                weights.push((weight, arrives));
                seen = (seen.0 + weight, seen.1 + if arrives { weight } else { 0.0 });
            }
            if seen.0 <= 0.0 {
                return Transfer { value: 0.0, error: 0.0 };
            }
            let v = seen.1 / seen.0;
            let variance: f64 = weights.iter().map(|(w, arrives)| (w * (f64::from(u8::from(*arrives)) - v)).powi(2)).sum();
            // All or none of so many: the rule of succession instead of a variance of 0.
            let least = 1.0 / (n as f64 + 2.0);
            let error = (variance.sqrt() / seen.0).max(0.5 * least);
            if error <= allowed || n >= most {
                return Transfer { value: v, error };
            }
            n *= 4;
        }
    }
}

type Shadows = SmallVec<[Polygon; 8]>;

/// A ray from just in front of one surface to just in front of another.
pub fn segment(a: DVec3, na: DVec3, b: DVec3, nb: DVec3) -> Ray {
    let (a, b, na, nb) = (a.as_vec3(), b.as_vec3(), na.as_vec3(), nb.as_vec3());
    let error = |p: Vec3| Vec3::splat(8.0 * f32::EPSILON * p.abs().max_element());
    Ray::between(offset_origin(a, error(a), na, na), offset_origin(b, error(b), nb, nb))
}

/// A uniform point of a polygon.
pub fn point_of(p: &Polygon, sampler: &mut Sampler) -> DVec3 {
    let u = sampler.next_2d();
    let (mut x, y) = (f64::from(u.x), f64::from(u.y));
    let c = p.corners();
    let area = |k: usize| 0.5 * (c[k] - c[0]).cross(c[k + 1] - c[0]).dot(p.normal()).max(0.0) / p.area();
    let mut k = 1;
    while k + 2 < c.len() && x >= area(k) {
        x -= area(k);
        k += 1;
    }
    let x = (x / area(k).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0).sqrt();
    c[0] + (c[k] - c[0]) * (x * (1.0 - y)) + (c[k + 1] - c[0]) * (x * y)
}

/// Integrals over a part of a polygon.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    whole: f64,
    seen: f64,
    error2: f64,
}

impl Sums {
    fn add(&mut self, other: Sums) {
        self.whole += other.whole;
        self.seen += other.seen;
        self.error2 += other.error2;
    }

    fn hidden(&self) -> f64 {
        self.whole - self.seen
    }
}

/// What points of `p` see of `q` past `blockers`.
struct Shadowed<'a> {
    p: &'a Polygon,
    q: &'a Polygon,
    blockers: &'a [Polygon],
    cutter: ShadowCutter,
}

impl Shadowed<'_> {
    /// Two by two Gauss points over a bilinear panel.
    fn rule(&mut self, panel: &[DVec3; 4]) -> Sums {
        const AT: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
        let [a, b, c, d] = *panel;
        let mut sums = Sums::default();
        for v in AT {
            for u in AT {
                let x = (a + (b - a) * u) * (1.0 - v) + (d + (c - d) * u) * v;
                let area = 0.25 * ((b - a) * (1.0 - v) + (c - d) * v).cross((d - a) * (1.0 - u) + (c - b) * u).length();
                let (whole, seen) = self.cutter.whole_and_visible(x, self.p.normal(), self.q, self.blockers);
                sums.add(Sums { whole: whole * area, seen: seen * area, error2: 0.0 });
            }
        }
        sums
    }

    /// The panel in quarters, and those again where what is hidden changed by more than `allowed`.
    fn refined(&mut self, panel: &[DVec3; 4], coarse: Sums, allowed: f64, depth: u32) -> Sums {
        let [a, b, c, d] = *panel;
        if depth == 0 {
            return coarse;
        }
        // Where all points agree that all or nothing is hidden, a shadow or a gap may lie between them.
        let agreed = coarse.hidden() <= 0.0 || coarse.seen <= 0.0;
        if agreed && self.at_grid(panel, coarse.hidden() <= 0.0) <= 2.0 * allowed {
            return coarse;
        }
        let middle = |p: DVec3, q: DVec3| 0.5 * (p + q);
        let (ab, bc, cd, da) = (middle(a, b), middle(b, c), middle(c, d), middle(d, a));
        let m = middle(ab, cd);
        let quarters = [[a, ab, m, da], [ab, b, bc, m], [m, bc, c, cd], [da, m, cd, d]];
        let fine = quarters.map(|quarter| self.rule(&quarter));
        let mut total = Sums::default();
        fine.iter().for_each(|s| total.add(*s));
        let change = (total.hidden() - coarse.hidden()).abs();
        // Halving the distances leaves at most about a half of the error of the coarser rule where shadows bend it.
        if !agreed && change <= allowed {
            total.error2 = (0.5 * change) * (0.5 * change);
            return total;
        }
        let mut refined = Sums::default();
        for (quarter, fine) in quarters.iter().zip(fine) {
            refined.add(self.refined(quarter, fine, 0.5 * allowed, depth - 1));
        }
        refined
    }

    /// The most that points of a grid over a panel, its border included, have hidden, or seen, beyond what its Gauss points have, which is nothing;
    /// for a quarter of the panel. Corners of shadows come in between the corners of a panel as well.
    fn at_grid(&mut self, panel: &[DVec3; 4], hidden: bool) -> f64 {
        let [a, b, c, d] = *panel;
        let area = 0.5 * (c - a).cross(d - b).length();
        let mut most = 0.0_f64;
        for k in 0..(GRID + 1) * (GRID + 1) {
            // Just inside: a corner itself may lie on a blocker's edge.
            let place = |i: usize| (i as f64 / GRID as f64 - 0.5) * (1.0 - 1e-6) + 0.5;
            let (u, v) = (place(k % (GRID + 1)), place(k / (GRID + 1)));
            let x = (a + (b - a) * u) * (1.0 - v) + (d + (c - d) * u) * v;
            // Most see all of q, which is told without integrals.
            if hidden && !self.cutter.may_hide(x, self.q, self.blockers) {
                continue;
            }
            let (whole, seen) = self.cutter.whole_and_visible(x, self.p.normal(), self.q, self.blockers);
            most = most.max(if hidden { whole - seen } else { seen });
        }
        most * area * 0.25
    }
}
