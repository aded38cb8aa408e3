//! Kr R + Kt T: which of the mirror, glass and gloss of a surface the recursion follows.

use super::TwoPass;
use super::whitted::{Path, Trace};
use crate::material::{Lobe, Lobes};
use crate::math::Rgb;
use crate::world::sight::Origin;
use crate::world::walk::most_survival;
use crate::world::{Shading, Sight, Stages, SurfaceInteraction};

/// Down to this depth all branches are followed; below it one is chosen at random. With three levels a pane
/// before a glass still branches fully, and a pixel never costs more than eight paths.
const BRANCHING_DEPTH: u32 = 3;
/// From this depth on a path goes on with a probability equal to its throughput.
const ROULETTE_DEPTH: u32 = 8;
/// A branch beside a diffuse part is followed with this many times its share of power, so that the faint gloss of a coat does not cost
/// as much as the surface itself.
/// Where the camera looks it is always followed: bright windows in a floor are most of what is seen of it.
const FAVOUR: f64 = 4.0;

/// The branches at a hit, each with the probability of being followed.
pub(super) struct Branches {
    /// Expected number of glossy rays.
    pub glossy: f64,
    kind: Kind,
    lobes: Lobes,
}

enum Kind {
    /// Each lobe by itself, with a probability proportional to its power: `favour` times, at most 1.
    Each { favour: f64 },
    /// One of all, or none.
    One { chosen: Option<(Chosen, f64)>, survival: f64 },
}

#[derive(Clone, Copy)]
enum Chosen {
    Glossy,
    Ideal(Lobe),
}

impl<K: Stages> TwoPass<'_, K> {
    /// Decides how the path goes on at a hit.
    pub(super) fn branches(&self, shading: &Shading<'_>, path: &Path, trace: &mut Trace<'_>) -> Branches {
        let lobes = shading.lobes();
        let albedo = shading.glossy_albedo().mean();
        if path.depth < BRANCHING_DEPTH {
            let favour = if shading.has_diffuse() && path.depth > 0 { FAVOUR } else { f64::INFINITY };
            return Branches { glossy: followed(favour, albedo), kind: Kind::Each { favour }, lobes };
        }
        let ideal: f64 = lobes.iter().map(|lobe| lobe.power).sum();
        let total = ideal + albedo;
        if total <= 0.0 {
            return Branches { glossy: 0.0, kind: Kind::One { chosen: None, survival: 0.0 }, lobes };
        }
        let mut go_on = if shading.has_diffuse() { total.min(1.0) } else { 1.0 };
        let mut survival = path.survival * total / go_on;
        if path.depth >= ROULETTE_DEPTH {
            let stays = survival.min(most_survival(albedo <= 0.0, path.depth));
            go_on *= stays;
            survival /= stays;
        }
        let glossy = go_on * albedo / total;
        let u = f64::from(trace.sampler.next_1d());
        let chosen = if u < glossy {
            Some((Chosen::Glossy, glossy))
        } else if u < go_on {
            let rest = go_on - glossy;
            lobes.choose(((u - glossy) / rest) as f32).map(|(lobe, p)| (Chosen::Ideal(lobe), p * rest))
        } else {
            None
        };
        Branches { glossy, kind: Kind::One { chosen, survival }, lobes }
    }
}

/// Probability of following a branch of this power.
fn followed(favour: f64, power: f64) -> f64 {
    if power > 0.0 { (favour * power).min(1.0) } else { 0.0 }
}

/// Follows the branches chosen.
pub(super) fn follow<K: Stages>(
    two_pass: &TwoPass<'_, K>,
    si: &SurfaceInteraction,
    shading: &Shading<'_>,
    branches: &Branches,
    path: &Path,
    trace: &mut Trace<'_>,
) {
    let go = Go { two_pass, si, shading, path };
    match &branches.kind {
        Kind::Each { favour } => {
            for lobe in branches.lobes.iter() {
                let p = followed(*favour, lobe.power);
                if p >= 1.0 || f64::from(trace.sampler.next_1d()) < p {
                    go.ideal(lobe, p, 1.0, trace);
                }
            }
            let p = branches.glossy;
            if p > 0.0 && (p >= 1.0 || f64::from(trace.sampler.next_1d()) < p) {
                go.glossy(p, 1.0, trace);
            }
        }
        Kind::One { chosen: Some((Chosen::Ideal(lobe), p)), survival } => go.ideal(lobe, *p, *survival, trace),
        Kind::One { chosen: Some((Chosen::Glossy, p)), survival } => go.glossy(*p, *survival, trace),
        Kind::One { chosen: None, .. } => {}
    }
}

/// What every continuation needs.
struct Go<'a, K: Stages> {
    two_pass: &'a TwoPass<'a, K>,
    si: &'a SurfaceInteraction,
    shading: &'a Shading<'a>,
    path: &'a Path,
}

impl<K: Stages> Go<'_, K> {
    fn ideal(&self, lobe: &Lobe, probability: f64, survival: f64, trace: &mut Trace<'_>) {
        let Some(direction) = self.shading.direction(lobe) else { return };
        // Straight on, the ray still looks where it was sent.
        let sight = if self.shading.is_straight(lobe) { self.path.sight } else { Sight::Alone };
        self.go(direction, lobe.weight / probability, survival, sight, lobe.transmits, trace);
    }

    fn glossy(&self, probability: f64, survival: f64, trace: &mut Trace<'_>) {
        let (u, choice) = (trace.sampler.next_2d(), trace.sampler.next_1d());
        let Some(sample) = self.shading.sample_glossy(u, choice) else { return };
        let sight = Sight::Glossy(Origin {
            point: self.si.point,
            receiver: self.shading.receiver(),
            density: probability * sample.pdf,
            sampling: self.two_pass.settings.direct,
        });
        let transmits = sample.direction.dot(self.si.ng) < 0.0;
        self.go(sample.direction, sample.weight / probability, survival, sight, transmits, trace);
    }

    fn go(&self, direction: crate::math::Vec3, factor: Rgb, survival: f64, sight: Sight, transmits: bool, trace: &mut Trace<'_>) {
        if transmits {
            trace.counts.transmitted += 1;
        } else {
            trace.counts.reflected += 1;
        }
        let path = Path {
            weight: self.path.weight * factor,
            depth: self.path.depth + 1,
            survival,
            sight,
            length: self.path.length + self.si.t,
        };
        self.two_pass.radiance(&self.si.spawn(direction), path, trace);
    }
}
