//! What photon maps know: irradiance at some of the photons, computed once by the others and read where it is nearest ([Christensen99]), and
//! the radiance of caustics.

use super::face::{self, Face, Outlook, SurfacePoint};
use super::{Photon, PhotonGrid, Way};
use crate::math::{Rgb, Vec3, sampler::mix};
use crate::world::{Shading, SurfaceInteraction, World};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Photons that make an estimate, of all and of caustics.
const NEAREST: [usize; 2] = [80, 40];
/// Widest disk of an estimate over the scene's diagonal.
const WIDEST: f32 = 1.0 / 32.0;
/// Narrowest disk that is looked through first, over the same.
const NARROWEST: f32 = 1.0 / 4096.0;
/// Share of those that is enough for a disk, so that no wider one is looked through.
const ENOUGH: usize = 4;
/// One of so many photons gets the irradiance of its surroundings.
const SPARSE: u64 = 12;
/// Photons that are asked for their irradiance until one is seen.
const MOST_LOOKS: u32 = 8;
/// Photons that are asked at most whether they are seen, over those that make an estimate.
const MOST_ASKED: usize = 4;
/// What is of one face: height over the radius, and least cosine between normals.
const FLAT: (f32, f32) = (0.1, 0.9);
/// The same where irradiance is read, and where caustics are seen.
const ALIKE: [(f32, f32); 2] = [(0.3, 0.9), (0.3, 0.7)];

/// Points in grids for disks of several sizes, each twice as wide as the one before: where light is rare, so are photons.
struct Levels(Vec<(f32, PhotonGrid)>);

impl Levels {
    /// Of points of which about `nearest` shall lie in the narrowest disk.
    fn new(points: impl Iterator<Item = Vec3> + Clone, nearest: usize, diagonal: f32) -> Self {
        let n = points.clone().count();
        // Spread over surfaces as large as the faces of the scene's box.
        let r = diagonal * (nearest as f32 / n.max(1) as f32 / std::f32::consts::PI * 2.0).sqrt();
        let widest = WIDEST * diagonal;
        let radii =
            std::iter::successors(Some(r.clamp(NARROWEST * diagonal, widest)), |r| (*r < widest).then(|| (2.0 * r).min(widest)));
        Self(radii.map(|r| (r, PhotonGrid::new(points.clone(), r))).collect())
    }
}

/// Both maps.
pub(super) struct Maps {
    /// Where irradiance is known.
    known: Vec<Known>,
    known_levels: Levels,
    /// The photons that it is made of.
    lighting: Vec<Photon>,
    lighting_levels: Levels,
    caustics: Vec<Photon>,
    caustic_levels: Levels,
    seed: u64,
}

/// A place where irradiance is known.
struct Known {
    at: SurfacePoint,
    /// [W/m²].
    irradiance: Rgb,
    /// What surely sees the place, if any light was found there.
    outlook: Option<Outlook>,
}

impl Maps {
    /// Of photons.
    pub fn new(world: &World, photons: Vec<Photon>, seed: u64) -> Self {
        let diagonal = world.bounds().diagonal();
        let points = |photons: &[Photon]| photons.iter().map(|p| p.point).collect::<Vec<_>>();
        let caustics: Vec<Photon> = photons.iter().filter(|p| p.way == Way::Caustic).copied().collect();
        let caustic_levels = Levels::new(points(&caustics).into_iter(), NEAREST[1], diagonal);
        // Some are places, the others light them: around a place that is a photon itself there would always be one photon more than elsewhere,
        // and what is nearest to a gather ray's end would be the loneliest.
        let (places, lighting): (Vec<_>, Vec<_>) = (0_u64..).zip(photons).partition(|(i, _)| mix(*i).is_multiple_of(SPARSE));
        let share = lighting.len() as f64 / (places.len() + lighting.len()).max(1) as f64;
        let lighting: Vec<Photon> = lighting.into_iter().map(|(_, p)| Photon { power: p.power / share, ..p }).collect();
        let lighting_levels = Levels::new(points(&lighting).into_iter(), NEAREST[0], diagonal);
        let known: Vec<Known> = places
            .par_iter()
            .map(|(i, p)| {
                let at = (p.point, p.normal);
                let (irradiance, outlook) = of_nearest(world, at, &lighting, &lighting_levels, mix(seed ^ mix(*i)));
                Known { at, irradiance, outlook }
            })
            .collect();
        let known_levels = Levels::new(known.iter().map(|k| k.at.0), NEAREST[0] / SPARSE as usize, diagonal);
        Self { known, known_levels, lighting, lighting_levels, caustics, caustic_levels, seed }
    }

    /// Irradiance at a hit [W/m²], of the nearest photon that knows it and is seen from there. Where there is none within the widest disk,
    /// there may be light all the same: it is that of the photons around the hit itself.
    pub fn irradiance(&self, world: &World, si: &SurfaceInteraction) -> Rgb {
        let at = (si.point, si.ng);
        // Those up to this distance are hidden.
        let mut hidden = -1.0;
        let mut looks = 0;
        for (radius, grid) in &self.known_levels.0 {
            let face = Face { world, at, height: ALIKE[0].0 * radius, least_cosine: ALIKE[0].1 };
            while looks < MOST_LOOKS {
                let mut best = (radius * radius, None);
                grid.visit(si.point, *radius, |i| {
                    let other = self.known[i as usize].at;
                    let d2 = other.0.distance_squared(si.point);
                    if d2 < best.0 && d2 > hidden && face.holds(other) {
                        best = (d2, Some(i));
                    }
                });
                let Some(i) = best.1 else { break };
                let Known { at: other, irradiance, outlook } = &self.known[i as usize];
                if outlook.is_some_and(|o| o.holds(*other, si.point)) || face.sees(*other, best.0.sqrt()) {
                    return *irradiance;
                }
                hidden = best.0;
                looks += 1;
            }
        }
        let place = si.point.to_array().into_iter().fold(self.seed, |key, x| mix(key ^ u64::from(x.to_bits())));
        of_nearest(world, at, &self.lighting, &self.lighting_levels, place).0
    }

    /// Radiance of caustics at a hit.
    pub fn caustic(&self, world: &World, si: &SurfaceInteraction, shading: &Shading<'_>, seed: u64) -> Rgb {
        let at = (si.point, si.ng);
        in_disk(world, at, ALIKE[1], (&self.caustics, &self.caustic_levels), NEAREST[1], seed, |p| p.reflected(si, shading)).0
    }
}

/// Irradiance [W/m²] by the nearest photons, and the point's outlook on them.
fn of_nearest(world: &World, at: SurfacePoint, photons: &[Photon], levels: &Levels, seed: u64) -> (Rgb, Option<Outlook>) {
    in_disk(world, at, FLAT, (photons, levels), NEAREST[0], seed, |photon| photon.power)
}

/// Density over a disk around a surface point of `value` of the `nearest` photons of its face that it sees, weighted by a cone over the disk.
fn in_disk(
    world: &World,
    at: SurfacePoint,
    (height, least_cosine): (f32, f32),
    (photons, levels): (&[Photon], &Levels),
    nearest: usize,
    seed: u64,
    value: impl Fn(&Photon) -> Rgb,
) -> (Rgb, Option<Outlook>) {
    let mut near: Vec<(f32, u32)> = Vec::new();
    let last = levels.0.len() - 1;
    for (level, (widest, grid)) in levels.0.iter().enumerate() {
        near.clear();
        let face = Face { world, at, height: height * widest, least_cosine };
        grid.visit(at.0, *widest, |i| {
            let p = &photons[i as usize];
            let d2 = p.point.distance_squared(at.0);
            if d2 < widest * widest && face.holds((p.point, p.normal)) {
                near.push((d2, i));
            }
        });
        if near.len() < nearest / ENOUGH && level < last {
            continue;
        }
        if near.is_empty() {
            break;
        }
        let (seen, r2, outlook) = nearest_seen(&face, photons, &mut near, nearest, *widest);
        if seen.len() < nearest / ENOUGH && r2 == widest * widest && level < last {
            continue;
        }
        let sum: Rgb = seen.iter().map(|(d2, i)| value(&photons[*i as usize]) * cone(*d2, r2)).sum();
        if sum.is_black() {
            return (Rgb::BLACK, Some(outlook));
        }
        let trials = face.trials(r2.sqrt(), seed, Some(&outlook), face::as_cone);
        return (sum * f64::from(trials), Some(outlook));
    }
    (Rgb::BLACK, None)
}

/// The `nearest` of photons by squared distance that the face's point sees, the squared radius of the disk that they fill, and the outlook
/// on it. The disk ends where the next one lies, or where no more are asked.
fn nearest_seen(
    face: &Face<'_>,
    photons: &[Photon],
    near: &mut [(f32, u32)],
    nearest: usize,
    widest: f32,
) -> (Vec<(f32, u32)>, f32, Outlook) {
    let by_distance = |a: &(f32, u32), b: &(f32, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    let fill = |k: usize, near: &mut [(f32, u32)]| {
        if k < near.len() { near.select_nth_unstable_by(k, by_distance).1.0 } else { widest * widest }
    };
    let first = fill(nearest, near);
    let outlook = face.outlook(first.sqrt());
    let mut seen = Vec::with_capacity(nearest + 1);
    let mut asked = 0;
    let mut done = 0;
    // Most often the first ones are seen, and no more are put in order.
    for end in [nearest + 1, near.len()] {
        let end = end.min(near.len());
        near[done..end].sort_unstable_by(by_distance);
        for (d2, i) in &near[done..end] {
            let photon = &photons[*i as usize];
            if !outlook.holds(face.at, photon.point) {
                asked += 1;
                if !face.sees_photon(photon, first.sqrt()) {
                    if asked >= MOST_ASKED * nearest {
                        return (seen, *d2, outlook);
                    }
                    continue;
                }
            }
            if seen.len() == nearest {
                return (seen, *d2, outlook);
            }
            seen.push((*d2, *i));
        }
        done = end;
    }
    (seen, widest * widest, outlook)
}

/// Weight of a photon in a disk: falls linearly to its edge, with integral 1 [1/m²].
#[inline]
fn cone(d2: f32, r2: f32) -> f64 {
    let r2 = f64::from(r2);
    (1.0 - (f64::from(d2) / r2).sqrt()).max(0.0) * 3.0 / (PI * r2)
}
