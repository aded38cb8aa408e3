//! Form factors by way of flat mirrors, as those to virtual rooms: the scene reflected in each mirror, seen through the mirror as through a
//! window ([Wallace87], section 4.2). Mirrors seen in mirrors are rooms seen from virtual rooms, down to a number of reflections.
//!
//! What two patches exchange is the exact exchange with the reflected patch where all lines between them pass the window. Where only some do, the
//! reflected patch is cut by the pyramid of the window's edges, from points of the other one. What stands in between is found by rays
//! along the folded way, which carry the mirror's reflectance.

use super::analytic::point_to_polygon;
use super::matrix::FormFactorMatrix;
use super::outside::Outside;
use super::polygon::Polygon;
use crate::math::{DAffine3, DMat3, DVec3, Rgb, Sampler, Vec2, Vec3, sampler::mix};
use crate::patch::{PatchId, PatchMesh};
use crate::world::plane_mirrors::{MirrorWindow, PlaneMirrors};
use crate::world::walk::RayCounts;
use crate::world::{SurfaceInteraction, World};
use rayon::prelude::*;
use std::f64::consts::{FRAC_1_PI, PI};

/// Ways over mirrors that are followed, the shortest first.
const MOST_CHAINS: usize = 256;
/// A patch of more facets is known by points.
const MOST_FACETS: usize = 4;
/// Relative tolerance of the exchange with a reflected patch.
const KERNEL_TOLERANCE: f64 = 1e-5;
/// Lines that pass a window by less than this share of its size do pass it: walls end where their mirrors do.
const SLACK: f64 = 1e-6;
/// Form factors below this are asked for by one ray: there are many of them.
const FAINT: f64 = 2e-3;
/// Rays of others, and where those do not agree.
const RAYS: [u64; 2] = [4, 16];
/// Pairs of points tried to find that many lines through a window.
const TRIES: u64 = 64;
/// Rays of a patch through each mirror towards the surroundings.
const SKY_RAYS: u64 = 64;

/// A way over mirrors.
struct Chain {
    /// Windows as they are met.
    mirrors: Vec<usize>,
    /// Where they are, the first as it is, each later one reflected in those before it.
    windows: Vec<MirrorWindow>,
    /// From the scene to the last virtual room.
    into: DAffine3,
}

/// Adds what patches see by way of flat mirrors, up to `reflections` of them in a row: to the specular part of `matrix` what patches
/// reflect, to `outside` what lamps and surroundings send.
pub fn add(
    world: &World,
    patches: &PatchMesh,
    (reflections, seed): (u32, u64),
    matrix: &mut FormFactorMatrix,
    outside: &mut Outside,
    counts: &mut RayCounts,
) {
    let mirrors = PlaneMirrors::find(world);
    let chains = chains(&mirrors.windows, reflections);
    let n = patches.len();
    let points: Vec<SurfaceInteraction> = (0..n as u32).map(|i| patches.sample(world, PatchId(i), Vec2::splat(0.5))).collect();
    let mut rows: Vec<Vec<(u32, Rgb)>> = vec![Vec::new(); n];
    let mut light = vec![(Rgb::BLACK, Rgb::BLACK); n];
    for (k, chain) in chains.iter().enumerate() {
        let rooms = Rooms::new(world, patches, &mirrors, chain, mix(seed ^ mix(k as u64)));
        let found: Vec<(Vec<(u32, Rgb)>, RayCounts)> = (0..n)
            .into_par_iter()
            .map(|i| {
                let mut counts = RayCounts::default();
                let row = (i..n).map(|j| (j as u32, rooms.exchange(i, j, &mut counts)));
                (row.filter(|(_, s)| !s.is_black()).collect(), counts)
            })
            .collect();
        // A way there is the way back: of the same chain backwards, which is one of the chains, so that their sum is symmetric.
        for (i, (row, c)) in found.into_iter().enumerate() {
            *counts += c;
            for (j, s) in row {
                let j = j as usize;
                let back = chain.into.inverse();
                let mut meet = |here: usize, there: usize, into: &DAffine3| {
                    let f = s / patches.area[here];
                    rows[here].push((there as u32, f));
                    if !patches.exitance[there].is_black() {
                        let seen = into.transform_point3(patches.centroid[there].as_dvec3());
                        let direction = (seen - points[here].point.as_dvec3()).normalize().as_vec3();
                        let arriving = f * patches.exitance[there] * FRAC_1_PI;
                        light[here].0 += arriving;
                        light[here].1 += arriving * world.shading(&points[here]).acceptance(direction);
                    }
                };
                meet(i, j, &chain.into);
                if i != j {
                    meet(j, i, &back);
                }
            }
        }
    }
    for row in &mut rows {
        row.sort_by_key(|e| e.0);
        row.dedup_by(|second, first| {
            let same = second.0 == first.0;
            if same {
                first.1 += second.1;
            }
            same
        });
    }
    matrix.set_specular(&rows);
    if world.scene().environment.is_some() && reflections > 0 {
        let sky = |i: usize| surroundings(world, patches, &mirrors, i, (reflections, seed));
        let found: Vec<(Rgb, Rgb, RayCounts)> = (0..n).into_par_iter().map(sky).collect();
        for (light, (arriving, accepted, c)) in light.iter_mut().zip(found) {
            light.0 += arriving;
            light.1 += accepted;
            *counts += c;
        }
    }
    light.iter().enumerate().for_each(|(i, (arriving, accepted))| outside.add_arriving(i, *arriving, *accepted));
}

/// All ways over mirrors that may carry light.
fn chains(mirrors: &[MirrorWindow], reflections: u32) -> Vec<Chain> {
    let mut chains: Vec<Chain> = Vec::new();
    let mut last: Vec<usize> = Vec::new();
    let faces = |of: &MirrorWindow, other: &MirrorWindow| {
        let size = of.area().sqrt();
        other.corners.iter().any(|c| of.height(*c) > SLACK * size)
    };
    for depth in 0..reflections {
        let before = std::mem::take(&mut last);
        let heads = if depth == 0 { vec![None] } else { before.into_iter().map(Some).collect() };
        for head in heads {
            for (m, window) in mirrors.iter().enumerate() {
                let (mut all, mut windows, into) = head.map_or((Vec::new(), Vec::new(), DAffine3::IDENTITY), |h: usize| {
                    (chains[h].mirrors.clone(), chains[h].windows.clone(), chains[h].into)
                });
                // A mirror sees another only if each has some of the other before it; none sees itself.
                if all.last().is_some_and(|&l| l == m || !faces(&mirrors[l], window) || !faces(window, &mirrors[l])) {
                    continue;
                }
                if chains.len() == MOST_CHAINS {
                    return chains;
                }
                all.push(m);
                windows.push(moved(window, &into));
                last.push(chains.len());
                chains.push(Chain { mirrors: all, windows, into: into * reflection(window) });
            }
        }
    }
    chains
}

/// The map of points to their mirror images.
fn reflection(mirror: &MirrorWindow) -> DAffine3 {
    let n = mirror.normal;
    let outer = DMat3::from_cols(n * n.x, n * n.y, n * n.z);
    DAffine3::from_mat3_translation(DMat3::IDENTITY - outer * 2.0, n * (2.0 * n.dot(mirror.corners[0])))
}

/// A window in a virtual room, its corners still counter-clockwise.
fn moved(window: &MirrorWindow, into: &DAffine3) -> MirrorWindow {
    let mut corners: Vec<DVec3> = window.corners.iter().map(|c| into.transform_point3(*c)).collect();
    if into.matrix3.determinant() < 0.0 {
        corners.reverse();
    }
    MirrorWindow { corners, normal: into.transform_vector3(window.normal) }
}

/// The part of a convex polygon where `height` is not below 0.
fn cut(corners: &[DVec3], height: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut kept = Vec::with_capacity(corners.len() + 1);
    for (i, &a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        let (d, e) = (height(a), height(b));
        if d >= 0.0 {
            kept.push(a);
        }
        if d * e < 0.0 {
            kept.push(a + (b - a) * (d / (d - e)));
        }
    }
    kept
}

/// How lines between two polygons lie to a window.
enum Passing {
    All,
    None,
    Some,
}

/// The crossing points of all lines lie in the convex hull of those between corners: weighted by the sum of their heights, they are means of
/// these.
fn passing(p: &Polygon, q: &Polygon, window: &MirrorWindow) -> Passing {
    let n = window.corners.len();
    let slack = SLACK * window.area().sqrt();
    let (mut inside, mut outside) = (true, vec![true; n]);
    for &a in p.corners() {
        let above = window.height(a).max(0.0);
        for &b in q.corners() {
            let below = (-window.height(b)).max(0.0);
            if above + below <= slack {
                // Both on the mirror's edge: lines beside them count.
                continue;
            }
            let at = (a * below + b * above) / (above + below);
            for (k, outside) in outside.iter_mut().enumerate() {
                let (c, d) = (window.corners[k], window.corners[(k + 1) % n]);
                let beside = window.normal.cross(d - c).dot(at - c) / (d - c).length();
                inside &= beside >= -slack;
                *outside &= beside <= slack;
            }
        }
    }
    match (inside, outside.into_iter().any(|o| o)) {
        (true, _) => Passing::All,
        (_, true) => Passing::None,
        _ => Passing::Some,
    }
}

/// The exchange [m²] of `p` with the reflected polygon `q` through all windows, with nothing else in between.
fn through(p: &Polygon, q: &Polygon, windows: &[MirrorWindow]) -> f64 {
    if !p.may_see(q, 0.0) {
        return 0.0;
    }
    let mut all = true;
    for window in windows {
        match passing(p, q, window) {
            Passing::None => return 0.0,
            Passing::Some => all = false,
            Passing::All => {}
        }
    }
    if all {
        return p.transfer(q, KERNEL_TOLERANCE);
    }
    // Three Gauss points each way: what the window cuts off has kinks, and more would not know them.
    const AT: [(f64, f64); 3] = [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 4.0 / 9.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];
    let mut sum = 0.0;
    for [a, b, c, d] in p.panels() {
        for (v, v_weight) in AT {
            for (u, u_weight) in AT {
                let x = (a + (b - a) * u) * (1.0 - v) + (d + (c - d) * u) * v;
                let area = ((b - a) * (1.0 - v) + (c - d) * v).cross((d - a) * (1.0 - u) + (c - b) * u).length();
                let mut seen = q.corners().to_vec();
                for window in windows {
                    let n = window.corners.len();
                    for k in 0..n {
                        let side = (window.corners[k] - x).cross(window.corners[(k + 1) % n] - x);
                        // Counter-clockwise from the front, where x is: to the left of an edge is inside, and the way leads away.
                        seen = cut(&seen, |corner| -side.dot(corner - x));
                        if seen.len() < 3 {
                            break;
                        }
                    }
                }
                if seen.len() >= 3 {
                    sum += u_weight * v_weight * area * point_to_polygon(x, p.normal(), &seen);
                }
            }
        }
    }
    sum.min(p.area().min(q.area()))
}

/// A patch on its way over one chain.
enum Piece {
    /// Its polygons, cut where they leave the side of a window on which they must be.
    Flat(Vec<Polygon>),
    /// Curved, or of many facets.
    Points,
}

/// The scene and its last virtual room of one chain.
struct Rooms<'a> {
    world: &'a World,
    patches: &'a PatchMesh,
    mirrors: &'a PlaneMirrors,
    chain: &'a Chain,
    near: Vec<Piece>,
    far: Vec<Piece>,
    seed: u64,
}

impl<'a> Rooms<'a> {
    fn new(world: &'a World, patches: &'a PatchMesh, mirrors: &'a PlaneMirrors, chain: &'a Chain, seed: u64) -> Self {
        let flips = chain.into.matrix3.determinant() < 0.0;
        let pieces = |i: usize| {
            let whole = patches.polygons(world, PatchId(i as u32)).filter(|facets| facets.len() <= MOST_FACETS);
            let Some(whole) = whole else { return (Piece::Points, Piece::Points) };
            let polygons = |facets: Vec<Vec<DVec3>>, side: f64| {
                let kept = facets.into_iter().map(|mut corners| {
                    for window in &chain.windows {
                        let flat = 1e-9 * window.area().sqrt();
                        corners = cut(&corners, |c| {
                            let height = side * window.height(c);
                            if height.abs() <= flat { 0.0 } else { height }
                        });
                    }
                    corners
                });
                let kept = kept.filter(|corners| corners.len() >= 3);
                Piece::Flat(kept.filter_map(|corners| Polygon::new(&corners)).collect())
            };
            let image = whole.iter().map(|facet| {
                let mut corners: Vec<DVec3> = facet.iter().map(|c| chain.into.transform_point3(*c)).collect();
                if flips {
                    corners.reverse();
                }
                corners
            });
            (polygons(image.collect(), -1.0), polygons(whole, 1.0))
        };
        let (far, near) = (0..patches.len()).into_par_iter().map(pieces).unzip();
        Self { world, patches, mirrors, chain, near, far, seed }
    }

    /// A_i F_ij by this chain [m²].
    fn exchange(&self, i: usize, j: usize, counts: &mut RayCounts) -> Rgb {
        let least = self.patches.area[i].min(self.patches.area[j]);
        let known = match (&self.near[i], &self.far[j]) {
            (Piece::Flat(near), Piece::Flat(far)) => {
                let pairs = near.iter().flat_map(|p| far.iter().map(move |q| (p, q)));
                let sum: f64 = pairs.map(|(p, q)| through(p, q, &self.chain.windows)).sum();
                if sum <= 0.0 {
                    return Rgb::BLACK;
                }
                Some(sum)
            }
            _ => None,
        };
        let wanted = match known {
            Some(free) if free < FAINT * least => 1,
            _ => RAYS[0],
        };
        let mut sums = Sums::default();
        for k in 0..TRIES {
            let done = match known {
                Some(_) => sums.lines >= if sums.differ() { RAYS[1] } else { wanted },
                None => k >= RAYS[1],
            };
            if done {
                break;
            }
            self.line(i, j, k, &mut sums, counts);
        }
        match known {
            Some(free) if sums.weight > 0.0 => sums.carried * (free / sums.weight),
            Some(_) => Rgb::BLACK,
            None => sums.carried * (self.patches.area[i] * self.patches.area[j] / RAYS[1] as f64),
        }
    }

    /// One line between the two patches: its weight in the exchange, and what of it arrives.
    fn line(&self, i: usize, j: usize, k: u64, sums: &mut Sums, counts: &mut RayCounts) {
        let mut sampler = Sampler::new(self.seed, mix((i as u64) << 32 | j as u64), k);
        let of = |patch: usize, u: Vec2| self.patches.sample(self.world, PatchId(patch as u32), u);
        let (a, b) = (of(i, sampler.next_2d()), of(j, sampler.next_2d()));
        let image = self.chain.into.transform_point3(b.point.as_dvec3());
        let toward = image - a.point.as_dvec3();
        let r2 = toward.length_squared();
        let (from, to) = (a.ng.as_dvec3(), self.chain.into.transform_vector3(b.ng.as_dvec3()));
        let weight = from.dot(toward).max(0.0) * (-to.dot(toward)).max(0.0) / (PI * r2 * r2);
        if weight <= 0.0 || !self.chain.windows.iter().all(|w| crosses(w, a.point.as_dvec3(), image)) {
            return;
        }
        sums.lines += 1;
        sums.weight += weight;
        match self.carried(&a, &b, toward.normalize().as_vec3(), counts) {
            Some(carried) => sums.carried += carried * weight,
            None => sums.lost += 1,
        }
    }

    /// What of the light that `b` sends comes to `a` over the chain: its reflectances; `None` if something is in the way.
    fn carried(&self, a: &SurfaceInteraction, b: &SurfaceInteraction, direction: Vec3, counts: &mut RayCounts) -> Option<Rgb> {
        let mut ray = a.spawn(direction);
        let mut carried = Rgb::WHITE;
        let mut at: Option<SurfaceInteraction> = None;
        for &mirror in &self.chain.mirrors {
            counts.form_factor += 1;
            let (met, share, onward) = reflected(self.world, ray)?;
            if self.mirrors.window_of(&met) != Some(mirror) {
                return None;
            }
            carried *= share;
            ray = met.spawn(onward);
            at = Some(met);
        }
        counts.form_factor += 1;
        let last = self.world.transmittance(&at?.spawn_to(b.moved_towards(b.ng)));
        carried *= last;
        (!carried.is_black()).then_some(carried)
    }
}

/// Lines through the windows, what they weigh, and what arrives along them.
#[derive(Default)]
struct Sums {
    lines: u64,
    lost: u64,
    weight: f64,
    carried: Rgb,
}

impl Sums {
    fn differ(&self) -> bool {
        self.lost > 0 && self.lost < self.lines
    }
}

/// True if the line from `a`, before the window, to `b`, behind it, passes it.
fn crosses(window: &MirrorWindow, a: DVec3, b: DVec3) -> bool {
    let (above, below) = (window.height(a), -window.height(b));
    if above <= 0.0 || below <= 0.0 {
        return false;
    }
    let at = (a * below + b * above) / (above + below);
    let n = window.corners.len();
    (0..n).all(|k| {
        let (c, d) = (window.corners[k], window.corners[(k + 1) % n]);
        window.normal.cross(d - c).dot(at - c) >= 0.0
    })
}

/// Where a ray meets a surface that does not let it pass straight, the share that is reflected there ideally, and whereto.
fn reflected(world: &World, mut ray: crate::geometry::Ray) -> Option<(SurfaceInteraction, Rgb, Vec3)> {
    let mut share = Rgb::WHITE;
    loop {
        let si = world.intersect(&ray)?;
        let shading = world.shading(&si);
        let straight = shading.straight_share();
        if straight.is_black() {
            let lobes = shading.lobes();
            let lobe = lobes.iter().find(|lobe| !lobe.transmits)?;
            let onward = shading.direction(lobe)?;
            return Some((si, share * lobe.weight, onward));
        }
        share *= straight;
        ray.t_min = si.end;
    }
}

/// Mean radiance over the rays of patch `i` that comes from the surroundings over flat mirrors, as it is and as the patch accepts it.
fn surroundings(
    world: &World,
    patches: &PatchMesh,
    mirrors: &PlaneMirrors,
    i: usize,
    (reflections, seed): (u32, u64),
) -> (Rgb, Rgb, RayCounts) {
    let mut counts = RayCounts::default();
    let (mut arriving, mut accepted) = (Rgb::BLACK, Rgb::BLACK);
    for (m, window) in mirrors.windows.iter().enumerate() {
        let Some(face) = Polygon::new(&window.corners) else { continue };
        for k in 0..SKY_RAYS {
            let mut sampler = Sampler::new(mix(seed ^ 0x5c7), mix((i as u64) << 8 | m as u64), k);
            let from = patches.sample(world, PatchId(i as u32), sampler.next_2d());
            let toward = super::visibility::point_of(&face, &mut sampler) - from.point.as_dvec3();
            let r2 = toward.length_squared();
            let weight = from.ng.as_dvec3().dot(toward).max(0.0) * (-window.normal.dot(toward)).max(0.0) / (PI * r2 * r2);
            if weight <= 0.0 {
                continue;
            }
            let direction = toward.normalize().as_vec3();
            let mut carried = Rgb::grey(weight * face.area() / SKY_RAYS as f64);
            let mut ray = from.spawn(direction);
            for depth in 0..=reflections {
                counts.form_factor += 1;
                let Some((met, share, onward)) = reflected(world, ray) else { break };
                let meets = mirrors.window_of(&met);
                if depth == reflections || meets.is_none() || (depth == 0 && meets != Some(m)) {
                    break;
                }
                carried *= share;
                ray = met.spawn(onward);
                let sky = world.transmittance(&ray);
                if !sky.is_black() {
                    let found = carried * sky * world.scene().escaped_radiance(onward);
                    arriving += found;
                    accepted += found * world.shading(&from).acceptance(direction);
                    break;
                }
            }
        }
    }
    (arriving, accepted, counts)
}
