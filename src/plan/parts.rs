//! What follows from opaque walls that part space: light that cannot arrive, light that cannot be seen, and rooms that glow all over.

use super::{Asked, FLOOR, NEGLIGIBLE, Verdict};
use crate::math::Rgb;
use crate::world::World;
use crate::world::regions::Regions;

/// What pass one may leave open of a solution, relative: ten times the default tolerance of the solver and of the sums of rows.
const SOLVED: f64 = 1e-4;

/// The parts of a scene, where pass one goes patch by patch; else why they are not looked at.
pub(super) fn parts(world: &World, asked: &Asked, specular: bool) -> Result<Regions, &'static str> {
    if !asked.has_pass_one {
        return Err("the method has no pass one");
    }
    if !(asked.by_patch && asked.by_stages) {
        return Err("pass one is not made patch by patch for one camera");
    }
    if specular {
        return Err("a surface does not reflect diffusely only: what parts space is not looked for");
    }
    world.regions().ok_or("no closed walls are found that part space")
}

/// Patches that no light reaches.
pub(super) fn dark(parts: &Result<Regions, &'static str>) -> Verdict {
    let parts = match parts {
        Ok(parts) => parts,
        Err(reason) => return (true, (*reason).to_owned()),
    };
    match parts.count(|lit, _| !lit) {
        0 => (true, "light may come to every surface".to_owned()),
        n => (false, format!("closed walls keep all light from {}", sides(n))),
    }
}

/// Patches whose light cannot come to what the camera sees.
pub(super) fn unseen(parts: &Result<Regions, &'static str>) -> Verdict {
    let parts = match parts {
        Ok(parts) => parts,
        Err(reason) => return (true, (*reason).to_owned()),
    };
    match parts.count(|lit, seen| lit && !seen) {
        0 => (true, "what is lit may count in the picture".to_owned()),
        n => (false, format!("closed walls keep the light of {} from all that the camera can see", sides(n))),
    }
}

fn sides(n: usize) -> String {
    if n == 1 { "one side of a triangle".to_owned() } else { format!("{n} sides of triangles") }
}

/// True if rays need not gather, with a bound on what the picture loses: in closed rooms whose walls all glow about alike.
///
/// Every ray from a surface in a closed room ends on a surface. With L_e and rho at most (least) those of some surface, radiance is at most max
/// L_e/(1 - rho) and at least min L_e/(1 - rho) everywhere, since the largest (smallest) is reached somewhere and is at most L_e there, and
/// rho of itself. So irradiance over pi lies between the two at each point, and in the mean over each patch: read from the patches the
/// reflected radiance is off by no more than rho times the difference.
pub(super) fn glow(world: &World, asked: &Asked, parts: &Result<Regions, &'static str>) -> Option<Verdict> {
    let (goal, parts) = (asked.error_goal?, parts.as_ref().ok().filter(|parts| parts.is_closed)?);
    let scene = world.scene();
    let partition = world.partition();
    if !partition.has_no_shadow_rays() || scene.environment.is_some() || asked.max_depth.is_some() {
        return None;
    }
    let (mut low, mut high, mut most) = ([f64::INFINITY; 3], [0.0_f64; 3], [0.0_f64; 3]);
    for (p, seen) in parts.seen.iter().enumerate() {
        let shape = world.shape(p as u32);
        for side in [0, 1].into_iter().filter(|side: &usize| seen[*side]) {
            let emission = if side == 0 { shape.emission.bounds() } else { [Rgb::BLACK; 2] };
            let rho = if parts.is_patch[p][side] { scene.material_of(shape).material.diffuse_bounds()? } else { [Rgb::BLACK; 2] };
            for c in 0..3 {
                let radiance = [0, 1].map(|k: usize| emission[k][c] / (1.0 - rho[k][c]));
                (low[c], high[c], most[c]) = (low[c].min(radiance[0]), high[c].max(radiance[1]), most[c].max(rho[1][c]));
            }
        }
    }
    // A reflectance of 1 bounds nothing.
    if most.iter().any(|rho| *rho >= 1.0) {
        return None;
    }
    let off = |c: usize| most[c] * (high[c] - low[c] + high[c] * SOLVED);
    let error = (0..3).map(|c| off(c) * off(c) / (low[c] * low[c] + FLOOR)).fold(0.0, f64::max);
    let radiance = (0..3).map(off).fold(0.0, f64::max);
    let said = format!("patches show what rays would gather within {radiance:.1e}, relMSE {error:.1e}");
    Some(if error <= NEGLIGIBLE * goal {
        (false, format!("{said}: below a hundredth of --error {goal}"))
    } else {
        (true, format!("{said}: that is not below a hundredth of --error {goal}"))
    })
}
