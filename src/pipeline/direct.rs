//! Direct light of the patches by lamps that shadow rays find, lamp by lamp: light adds up, so each can be made stronger afterwards.

use super::shown::{Looks, Shown};
use crate::light::{AreaLight, Light};
use crate::material::{Scattering, Texture};
use crate::math::{Rgb, Sampler, sampler::mix};
use crate::patch::{PatchId, PatchMesh};
use crate::radiosity::Incident;
use crate::scene::Scene;
use crate::world::partition::{EmitterPartition, LARGE_SHARE};
use crate::world::stages::ByStages;
use crate::world::walk::RayCounts;
use crate::world::{DirectSampling, ShadowRay, Stages, World};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Points at which the direct light of a patch of the full size is measured; smaller ones get fewer by their share.
pub(super) const DIRECT_POINTS: f64 = 32.0;

/// A patch of the full size gets more points until what it does not know of a lamp is below this share of the lamp's root mean square over all lit
/// patches; the squared error that a smaller one may keep is larger as its area, and so its weight in all light to come, is smaller.
const NOISE: f64 = 0.02;
/// The solutions of `two-pass` allow more by the root of how many more patches there are than these, whose noise averages out in all light to come ...
const FEW_PATCHES: f64 = 2000.0;
/// ... as long as form factors are as rough as this; but no more than so many times.
const ROUGH: f64 = 0.0442;
const MOST_NOISE: f64 = 4.0;
/// No patch gets more points.
const MOST_POINTS: f64 = 256.0;
/// How often it is asked whether a patch gets more: what few points say of their noise may be far too little.
const MORE_LOOKS: u32 = 2;
/// Share of the points of a full patch that any patch has at least: where four points all lie in the dark, nobody looks again. The solutions of
/// `two-pass` follow each other, finer and finer; they look but once more, and small patches have their share of rays in points.
const LEAST_SHARE: f64 = 0.25;

/// Most lamps that are kept apart: each has a solution of its own. Where there are more, all are one.
const MOST_LAMPS: usize = 16;

/// The direct light of one lamp, or of all together.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct LampLight {
    /// The lamp.
    pub lamp: Lamp,
    /// What it does to each patch [W/m²].
    pub incident: Vec<Incident>,
}

/// A lamp by what can be changed of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Lamp {
    /// Id of its shape; `light-1`, `light-2` ... in the order of the scene for lights without a shape. Empty if it stands for several.
    pub name: String,
    /// Radiance, intensity or irradiance, as its kind has it; 1 where it differs from place to place.
    pub strength: Rgb,
}

/// How much stronger a lamp is to be.
#[derive(Debug, Clone, PartialEq)]
pub struct LampWeight {
    /// Its name, as [`Lamp::name`].
    pub name: String,
    /// Factor on its strength, 0 or more.
    pub factor: Rgb,
}

/// Why a lamp cannot be weighted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WeightError {
    /// There is none of that name.
    #[error("there is no light \"{name}\"; there are: {known}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// Those that there are.
        known: String,
    },
    /// It is the surroundings.
    #[error("the light \"{0}\" is the surroundings, which are not kept by themselves")]
    Surroundings(String),
    /// Its light cannot be told from that of others.
    #[error(
        "light that comes over mirrors, glass or gloss is kept for all lights together, so that single ones cannot be weighted in this scene"
    )]
    Mixed,
}

/// Makes lamps of the scene stronger or weaker. One of factor 0 keeps its place among the lamps, with next to no light.
///
/// # Errors
/// [`WeightError`] if that cannot be done to one of them, or would not be all of its light in a kept solution with these `groups`.
pub fn weigh(scene: &mut Scene, groups: &[super::pass_one::LightGroup], weights: &[LampWeight]) -> Result<(), WeightError> {
    const NEXT_TO_NONE: f64 = 1e-100;
    if !weights.is_empty() && super::keys::has_detours(scene) {
        return Err(WeightError::Mixed);
    }
    for weight in weights {
        let factor = weight.factor.map(|f| f.max(NEXT_TO_NONE));
        let found = (0..scene.lights.len()).find(|&light| lamp_of(scene, light).name == weight.name);
        let kept = groups.iter().any(|group| group.lamp.name == weight.name);
        let Some(light) = found.filter(|_| kept) else {
            let names: Vec<&str> = groups.iter().map(|g| g.lamp.name.as_str()).filter(|name| !name.is_empty()).collect();
            let known = if names.is_empty() { "none that is kept by itself".to_owned() } else { names.join(", ") };
            return Err(WeightError::Unknown { name: weight.name.clone(), known });
        };
        match &mut scene.lights[light] {
            Light::Area(lamp) => {
                let radiance = lamp.radiance.scaled(factor);
                scene.shapes[lamp.shape as usize].emission = radiance.clone();
                *lamp = AreaLight::new(lamp.shape, radiance, lamp.emitter.clone());
            }
            Light::Point(lamp) => lamp.intensity *= factor,
            Light::Spot(lamp) => lamp.intensity *= factor,
            Light::Directional(lamp) => lamp.irradiance *= factor,
            Light::Environment(_) => return Err(WeightError::Surroundings(weight.name.clone())),
        }
    }
    Ok(())
}

/// The lamps that shadow rays find, with all that decides about the rays but their strengths: for the key of the direct light. The strengths
/// are in it where they matter, as with more lamps than a point looks at, of which it picks some by them.
pub(super) fn lamps_of(scene: &Scene) -> Vec<String> {
    let partition = EmitterPartition::new(scene, LARGE_SHARE);
    let apart = is_apart(&partition) && sees_all(&partition);
    let all = partition.shadow_lights().iter().chain(partition.distant_lights());
    all.map(|&light| match &scene.lights[light] {
        Light::Area(lamp) => match &lamp.radiance {
            Texture::Constant(_) if apart => format!("shape {}", lamp.shape),
            radiance => format!("shape {} {radiance:?}", lamp.shape),
        },
        Light::Point(lamp) if apart => format!("point {:?}", lamp.position),
        Light::Spot(lamp) if apart => format!("spot {:?} {:?} {:?} {:?}", lamp.position, lamp.axis, lamp.cutoff, lamp.beam_width),
        Light::Directional(lamp) if apart => format!("sun {:?}", lamp.direction),
        Light::Environment(_) => "surroundings".to_owned(),
        other => format!("{other:?}"),
    })
    .collect()
}

/// True if each lamp has light of its own.
fn is_apart(partition: &EmitterPartition) -> bool {
    partition.shadow_lights().len() + partition.distant_lights().len() <= MOST_LAMPS
}

/// True if every point looks at every lamp: no ray depends on their strengths then.
fn sees_all(partition: &EmitterPartition) -> bool {
    partition.shadow_lights().len() <= DirectSampling::OF_PATCHES.lights_per_point
}

/// A light as a lamp.
pub(super) fn lamp_of(scene: &Scene, light: usize) -> Lamp {
    let without_shape = scene.lights[..light].iter().filter(|l| l.shape().is_none()).count();
    let name = match scene.lights[light].shape() {
        Some(shape) => scene.shapes[shape as usize].id.clone(),
        None => format!("light-{}", without_shape + 1),
    };
    let strength = match &scene.lights[light] {
        Light::Area(lamp) => match lamp.radiance {
            Texture::Constant(radiance) => radiance,
            _ => Rgb::WHITE,
        },
        Light::Point(lamp) => lamp.intensity,
        Light::Spot(lamp) => lamp.intensity,
        Light::Directional(lamp) => lamp.irradiance,
        Light::Environment(_) => Rgb::WHITE,
    };
    Lamp { name, strength }
}

/// The lamps of [`measure`], in its order.
fn lamps_apart(world: &World) -> Vec<usize> {
    let partition = world.partition();
    partition.shadow_lights().iter().chain(partition.distant_lights()).copied().collect()
}

/// What the points of a patch have found.
struct Measured {
    /// By lamp: sums over the points.
    sums: Vec<Incident>,
    /// By lamp, or of all together: sums of squares of the irradiance, averaged over channels.
    squares: Vec<f64>,
    points: u64,
    counts: RayCounts,
    looks: Looks,
}

impl Measured {
    /// Mean irradiance by one lamp, or by all where their squares are together.
    fn level(&self, part: usize) -> f64 {
        let lamps = if self.squares.len() < self.sums.len() { &self.sums[..] } else { &self.sums[part..=part] };
        lamps.iter().map(|sum| sum.irradiance.mean()).sum::<f64>() / self.points as f64
    }

    /// Variance of that, as if the points were independent; 0 for too few points to tell.
    fn noise(&self, part: usize) -> f64 {
        let (n, mean) = (self.points as f64, self.level(part));
        if self.points > 1 { (self.squares[part] / n - mean * mean).max(0.0) / (n - 1.0) } else { 0.0 }
    }

    fn mean(&self, lamp: usize) -> Incident {
        let Incident { irradiance, accepted } = self.sums[lamp];
        Incident { irradiance: irradiance / self.points as f64, accepted: accepted / self.points as f64 }
    }
}

/// What one of many patches may not know of a lamp where form factors are within `tolerance`, as a share of that lamp's root mean square.
pub(super) fn allowed_noise(patches: usize, tolerance: f64) -> f64 {
    NOISE * ((patches as f64 / FEW_PATCHES).sqrt() * tolerance / ROUGH).clamp(1.0, MOST_NOISE)
}

/// Mean irradiance of each patch by each lamp that shadow rays find; `seen`: what of it is seen from afar as well, and the noise that is allowed
/// then.
pub(super) fn measure(
    world: &World,
    patches: &PatchMesh,
    (gather_rays, seen): (f64, Option<f64>),
    seed: u64,
    counts: &mut RayCounts,
) -> (Vec<LampLight>, Option<Shown>) {
    let lights = lamps_apart(world);
    let (is_shown, noise) = (seen.is_some(), seen.unwrap_or(NOISE));
    if lights.is_empty() {
        return (Vec::new(), is_shown.then(|| Shown::none(patches.len())));
    }
    let apart = is_apart(world.partition());
    let n_lamps = if apart { lights.len() } else { 1 };
    let mut lamp_of_light = vec![0; world.scene().lights.len()];
    if apart {
        lights.iter().enumerate().for_each(|(lamp, &light)| lamp_of_light[light] = lamp);
    }
    // Where a point picks some of the lamps, how many points there are is decided by all: what few points find of a faint one is never known.
    let n_parts = if sees_all(world.partition()) { n_lamps } else { 1 };
    let look = Measure { world, patches, gather_rays, is_shown, noise, seed, lamp_of_light, n_lamps, n_parts };
    let measured = world.needs().choose(look);
    measured.iter().for_each(|m| *counts += m.counts);
    let of_lamp = |lamp: usize| LampLight {
        lamp: if apart { lamp_of(world.scene(), lights[lamp]) } else { Lamp { name: String::new(), strength: Rgb::WHITE } },
        incident: measured.iter().map(|m| m.mean(lamp)).collect(),
    };
    let lamps = (0..n_lamps).map(of_lamp).collect();
    if !is_shown {
        return (lamps, None);
    }
    let means: Vec<Rgb> = measured.iter().map(|m| (0..n_lamps).map(|lamp| m.mean(lamp).accepted).sum()).collect();
    let looks: Vec<Looks> = measured.into_iter().map(|m| m.looks).collect();
    (lamps, Some(Shown::new(patches, &looks, &means)))
}

/// The shadow rays of [`measure`].
struct Measure<'a> {
    world: &'a World,
    patches: &'a PatchMesh,
    gather_rays: f64,
    is_shown: bool,
    /// Noise that a patch of the full size may keep.
    noise: f64,
    seed: u64,
    lamp_of_light: Vec<usize>,
    n_lamps: usize,
    /// Parts of the light whose noise decides about more points: each lamp, or all.
    n_parts: usize,
}

impl ByStages for Measure<'_> {
    type Output = Vec<Measured>;

    fn run<K: Stages>(self) -> Self::Output {
        let Self { patches, n_lamps, n_parts, .. } = self;
        let (least_share, more_looks) = if self.is_shown { (patches.least_share(), 1) } else { (LEAST_SHARE, MORE_LOOKS) };
        // Patches that were cut small because the light changes there are full ones of their size.
        let share = |i: usize| (patches.area[i] / patches.cell_size(i).powi(2)).min(1.0);
        let mut measured: Vec<Measured> = (0..patches.len())
            .into_par_iter()
            .map(|i| {
                let mut measured = Measured {
                    sums: vec![Incident::default(); n_lamps],
                    squares: vec![0.0; n_parts],
                    points: 0,
                    counts: RayCounts::default(),
                    looks: Looks::default(),
                };
                let points = (DIRECT_POINTS * share(i).max(least_share)) as u64;
                if patches.is_idle(i) && self.world.leaves_idle() {
                    measured.points = points;
                } else {
                    self.look::<K>(i, points, &mut measured);
                }
                measured
            })
            .collect();
        // Half shadows need more points than that. How many is decided lamp by lamp, whatever the strengths of the lamps.
        // Patches whose light cannot count have no say, nor have dark ones, of which a solution for any camera has more.
        let level = |part: usize| {
            let lit = (0..patches.len()).filter(|&i| !patches.is_idle(i) && measured[i].level(part) > 0.0);
            let (squares, area) = lit.fold((0.0, 0.0), |(squares, area), i| {
                (squares + patches.area[i] * measured[i].level(part).powi(2), area + patches.area[i])
            });
            if area > 0.0 { (squares / area).sqrt() } else { f64::INFINITY }
        };
        let levels: Vec<f64> = (0..n_parts).map(level).collect();
        measured.par_iter_mut().enumerate().for_each(|(i, m)| {
            for _ in 0..more_looks {
                let over = |(part, level): (usize, &f64)| share(i) * m.noise(part) / (self.noise * level).powi(2);
                let wanted = levels.iter().enumerate().map(over).fold(0.0, f64::max);
                if wanted > 1.0 {
                    let points = ((m.points as f64 * wanted).min(MOST_POINTS) as u64).next_power_of_two();
                    self.look::<K>(i, points, m);
                }
            }
            if patches.is_idle(i) {
                m.counts.idle += m.counts.shadow;
            }
        });
        measured
    }
}

impl Measure<'_> {
    /// Looks from further points of patch `i`, up to `points` of them in all.
    fn look<K: Stages>(&self, i: usize, points: u64, into: &mut Measured) {
        let Self { world, patches, gather_rays, is_shown, seed, ref lamp_of_light, n_lamps, n_parts, .. } = *self;
        for k in into.points..points {
            let mut sampler = Sampler::new(mix(seed ^ 0x00d1_7ec7), i as u64, k);
            let mut at = patches.sample_by::<K>(world, PatchId(i as u32), sampler.next_2d());
            // Radiosity belongs to the faces themselves, not to the smoothed normals.
            at.ns = at.ng;
            let shading = world.shading_by::<K>(&at);
            // The two parts of what is carried: as it arrives, and as it is accepted.
            let respond = |ray: &ShadowRay| {
                let cos = ray.direction.dot(at.ng);
                if cos <= 0.0 {
                    return Scattering::default();
                }
                let arriving = Rgb::grey(f64::from(cos) * ray.share_beside_gather_rays(gather_rays, cos));
                Scattering { diffuse: arriving, glossy: arriving * shading.acceptance(ray.direction) }
            };
            let sampling = DirectSampling::OF_PATCHES;
            let mut found = vec![Incident::default(); n_lamps];
            let counts = &mut into.counts;
            world.direct_by_light::<K>(&at, Some(at.ng), sampling, &mut sampler, counts, respond, |light, light_found| {
                let found = &mut found[lamp_of_light[light]];
                found.irradiance += light_found.diffuse;
                found.accepted += light_found.glossy;
            });
            for (sum, found) in into.sums.iter_mut().zip(&found) {
                sum.irradiance += found.irradiance;
                sum.accepted += found.accepted;
            }
            if is_shown {
                let all = found.iter().map(|found| found.accepted).sum();
                into.counts.form_factor += 1;
                into.looks.add::<K>((world, patches), (i, k, seed), &at, all);
            }
            for (square, lamps) in into.squares.iter_mut().zip(found.chunks(n_lamps / n_parts)) {
                *square += lamps.iter().map(|found| found.irradiance.mean()).sum::<f64>().powi(2);
            }
        }
        into.points = into.points.max(points);
    }
}

/// What was measured, for the strengths that the lamps have now; `None` if it does not say: of a lamp that was dark in some channel.
pub(super) fn with_strengths_of(world: &World, mut kept: Vec<LampLight>) -> Option<Vec<LampLight>> {
    if !is_apart(world.partition()) || !sees_all(world.partition()) {
        return Some(kept);
    }
    let lights = lamps_apart(world);
    if lights.len() != kept.len() {
        return None;
    }
    for (light, kept) in lights.iter().zip(&mut kept) {
        let now = lamp_of(world.scene(), *light);
        let ratio = ratio(now.strength, kept.lamp.strength)?;
        kept.lamp = now;
        if ratio != Rgb::WHITE {
            for incident in &mut kept.incident {
                incident.irradiance *= ratio;
                incident.accepted *= ratio;
            }
        }
    }
    Some(kept)
}

fn ratio(now: Rgb, then: Rgb) -> Option<Rgb> {
    let mut out = [0.0; 3];
    for k in 0..3 {
        out[k] = match (now[k], then[k]) {
            (0.0, _) => 0.0,
            (_, 0.0) => return None,
            (now, then) => now / then,
        };
    }
    Some(out.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two points, one lit with 2 and one dark: the variance of a point is 2, that of their mean 1.
    #[test]
    fn many_rough_patches_may_be_noisier_than_few_or_fine_ones() {
        assert_eq!(allowed_noise(1900, ROUGH), NOISE);
        assert!((allowed_noise(8000, ROUGH) / NOISE - 2.0).abs() < 1e-12);
        assert_eq!(allowed_noise(8000, 0.5 * ROUGH), NOISE);
        assert_eq!(allowed_noise(1_000_000, ROUGH), MOST_NOISE * NOISE);
    }

    #[test]
    fn the_noise_of_a_mean_is_that_of_independent_points() {
        let lit = Incident { irradiance: Rgb::grey(2.0), accepted: Rgb::grey(1.0) };
        let of = |points| Measured {
            sums: vec![lit],
            squares: vec![4.0],
            points,
            counts: RayCounts::default(),
            looks: Looks::default(),
        };
        assert!((of(2).noise(0) - 1.0).abs() < 1e-15, "{}", of(2).noise(0));
        assert_eq!(of(1).noise(0), 0.0);
        assert_eq!(of(2).mean(0).accepted, Rgb::grey(0.5));
    }
}
