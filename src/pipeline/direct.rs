//! Direct light of the patches by lamps that shadow rays find, lamp by lamp: light adds up, so each can be made stronger afterwards.

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

/// Points at which the direct light of a patch of the full size is measured; smaller ones get fewer by their area, but a quarter at least.
pub(super) const DIRECT_POINTS: f64 = 32.0;

/// Most lamps that are kept apart. Where there are more, all are one: which of them a point looks at is then drawn by their strengths.
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
    /// Its strength differs from place to place.
    #[error("the light \"{0}\" has a texture: only lights of one colour can be weighted")]
    Textured(String),
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
                let Texture::Constant(radiance) = lamp.radiance else {
                    return Err(WeightError::Textured(weight.name.clone()));
                };
                let radiance = Texture::Constant(radiance * factor);
                scene.shapes[lamp.shape as usize].emission = radiance.clone();
                *lamp = AreaLight::new(lamp.shape, radiance, lamp.emitter.clone());
            }
            Light::Point(lamp) => lamp.intensity *= factor,
            Light::Spot(lamp) => lamp.intensity *= factor,
            Light::Directional(lamp) => lamp.irradiance *= factor,
            Light::Environment(_) => return Err(WeightError::Textured(weight.name.clone())),
        }
    }
    Ok(())
}

/// The lamps that shadow rays find, with all that decides about the rays but their strengths: for the key of the direct light. The strengths
/// are in it where they matter, as with many lamps, of which each point picks some.
pub(super) fn lamps_of(scene: &Scene) -> Vec<String> {
    let partition = EmitterPartition::new(scene, LARGE_SHARE);
    let apart = is_apart(&partition);
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

/// True if every point looks at every lamp, so that each has light of its own.
fn is_apart(partition: &EmitterPartition) -> bool {
    let lamps = partition.shadow_lights().len();
    lamps <= DirectSampling::OF_PATCHES.lights_per_point && lamps + partition.distant_lights().len() <= MOST_LAMPS
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

/// Mean irradiance of each patch by each lamp that shadow rays find.
pub(super) fn measure(world: &World, patches: &PatchMesh, gather_rays: f64, seed: u64, counts: &mut RayCounts) -> Vec<LampLight> {
    let lights = lamps_apart(world);
    if lights.is_empty() {
        return Vec::new();
    }
    let apart = is_apart(world.partition());
    let n_lamps = if apart { lights.len() } else { 1 };
    let mut lamp_of_light = vec![0; world.scene().lights.len()];
    if apart {
        lights.iter().enumerate().for_each(|(lamp, &light)| lamp_of_light[light] = lamp);
    }
    let measured = world.needs().choose(Measure { world, patches, gather_rays, seed, lamp_of_light, n_lamps });
    measured.iter().for_each(|(_, c)| *counts += *c);
    let of_lamp = |lamp: usize| LampLight {
        lamp: if apart { lamp_of(world.scene(), lights[lamp]) } else { Lamp { name: String::new(), strength: Rgb::WHITE } },
        incident: measured.iter().map(|(sums, _)| sums[lamp]).collect(),
    };
    (0..n_lamps).map(of_lamp).collect()
}

/// The shadow rays of [`measure`].
struct Measure<'a> {
    world: &'a World,
    patches: &'a PatchMesh,
    gather_rays: f64,
    seed: u64,
    lamp_of_light: Vec<usize>,
    n_lamps: usize,
}

impl ByStages for Measure<'_> {
    /// By patch: the light of each lamp, and the rays it cost.
    type Output = Vec<(Vec<Incident>, RayCounts)>;

    fn run<K: Stages>(self) -> Self::Output {
        (0..self.patches.len() as u32).into_par_iter().map(|i| self.patch::<K>(i)).collect()
    }
}

impl Measure<'_> {
    fn patch<K: Stages>(&self, i: u32) -> (Vec<Incident>, RayCounts) {
        let Self { world, patches, gather_rays, seed, ref lamp_of_light, n_lamps } = *self;
        let mut counts = RayCounts::default();
        let share = (patches.area[i as usize] / (patches.patch_size * patches.patch_size)).clamp(0.25, 1.0);
        let points = (DIRECT_POINTS * share) as u64;
        let mut sums = vec![Incident::default(); n_lamps];
        for k in 0..points {
            let mut sampler = Sampler::new(mix(seed ^ 0x00d1_7ec7), u64::from(i), k);
            let mut at = patches.sample_by::<K>(world, PatchId(i), sampler.next_2d());
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
            world.direct_by_light::<K>(&at, Some(at.ng), sampling, &mut sampler, &mut counts, respond, |light, found| {
                let sum = &mut sums[lamp_of_light[light]];
                sum.irradiance += found.diffuse;
                sum.accepted += found.glossy;
            });
        }
        for sum in &mut sums {
            (sum.irradiance, sum.accepted) = (sum.irradiance / points as f64, sum.accepted / points as f64);
        }
        (sums, counts)
    }
}

/// What was measured, for the strengths that the lamps have now; `None` if it does not say: of a lamp that was dark in some channel.
pub(super) fn with_strengths_of(world: &World, mut kept: Vec<LampLight>) -> Option<Vec<LampLight>> {
    if !is_apart(world.partition()) {
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
