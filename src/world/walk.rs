//! A ray followed through mirrors, glass and gloss until a surface reflects the rest of its light diffusely.

use super::shading::Shading;
use super::sight::{Origin, Sight, balance};
use super::{All, Stages, SurfaceInteraction, World};
use crate::geometry::Ray;
use crate::material::Lobe;
use crate::math::{Rgb, Sampler, Vec3};

/// After this many specular events a path goes on with a probability equal to its throughput.
const ROULETTE_AFTER: u32 = 8;
/// Roulette lets a path go on with this probability at most, if it lets it go on by chance at all: a closed room of white walls would
/// never end.
pub const MOST_SURVIVAL: f64 = 0.95;
/// Down to this many edges ideal mirrors and glass are no reason to end a path that has lost nothing: a chain of some dozen mirrors carries
/// what they leave of the light, and one in twenty ended at each would make few heavy chains of many. Light that is trapped in clear
/// glass goes so far.
const CHAIN: u32 = 256;
/// No chain is longer; a closed box of perfect mirrors would otherwise never end.
const LONGEST: u32 = 512;

/// Highest probability with which roulette lets a path go on after `edges` edges, the last by an ideal lobe or not.
#[inline]
pub fn most_survival(by_ideal: bool, edges: u32) -> f64 {
    if by_ideal && edges < CHAIN { 1.0 } else { MOST_SURVIVAL }
}

/// Counts of rays, added up over a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct RayCounts {
    /// Rays from the camera.
    pub camera: u64,
    /// Rays from the camera that only look for emission.
    pub glance: u64,
    /// Rays to lights.
    pub shadow: u64,
    /// Rays that gather radiosity.
    pub gather: u64,
    /// Rays that measure form factors.
    pub form_factor: u64,
    /// Continuations by reflection.
    pub reflected: u64,
    /// Continuations by transmission.
    pub transmitted: u64,
    /// Shadow rays that were tested for what stands in their way.
    pub visibility: u64,
    /// Hits at which lobes other than the diffuse one were evaluated.
    pub lobes: u64,
    /// Hits at which texture coordinates were found.
    pub uv: u64,
    /// Looks at light from infinitely far away: rays that left the scene, and samples of suns and surroundings.
    pub distant: u64,
    /// Choices of some lights among many.
    pub light_choices: u64,
    /// Hits whose triangle or sphere had to be asked for its normal.
    pub curved: u64,
    /// Rays of pass one, counted above, from patches whose light cannot count in the picture: they decide nothing.
    pub idle: u64,
    /// Chains cut by the depth limit.
    pub truncated: u64,
    /// Rays of particles from lamps.
    pub particle: u64,
    /// Rays between vertices of the paths of two pixels.
    pub connected: u64,
    /// Weight of what the depth limit cut from camera paths, in units of 2^-32: an integer, so that its sum has no order.
    pub truncated_weight: u64,
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, o: Self) {
        self.camera += o.camera;
        self.glance += o.glance;
        self.shadow += o.shadow;
        self.gather += o.gather;
        self.form_factor += o.form_factor;
        self.reflected += o.reflected;
        self.transmitted += o.transmitted;
        self.visibility += o.visibility;
        self.lobes += o.lobes;
        self.uv += o.uv;
        self.distant += o.distant;
        self.light_choices += o.light_choices;
        self.curved += o.curved;
        self.idle += o.idle;
        self.truncated += o.truncated;
        self.particle += o.particle;
        self.connected += o.connected;
        self.truncated_weight += o.truncated_weight;
    }
}

impl RayCounts {
    /// Records what code that holds the stages `K` finds out at a hit.
    #[inline]
    pub fn met<K: Stages>(&mut self) {
        self.uv += u64::from(K::UV);
        self.curved += u64::from(K::CURVED);
    }

    /// Records a camera path that the depth limit cut; `weight` is radiance at the camera over the radiance not looked at.
    #[inline]
    pub fn truncate(&mut self, weight: Rgb) {
        self.truncated += 1;
        self.truncated_weight += (weight.mean().min(1e3) * f64::from(1 << 16) * f64::from(1 << 16)) as u64;
    }

    /// Mean weight that the depth limit cut from a camera sample: times the radiance of the scene, the bias it left at most.
    pub fn truncated_share(&self) -> f64 {
        if self.camera == 0 { 0.0 } else { self.truncated_weight as f64 / 2.0_f64.powi(32) / self.camera as f64 }
    }
}

/// One event of a walk, handed to its visitor.
pub enum Event<'a> {
    /// A surface. `through` counts the specular and glossy events before it.
    Surface {
        /// Where.
        at: &'a SurfaceInteraction,
        /// Its material there.
        shading: &'a Shading<'a>,
        /// Radiance at the start over radiance leaving here.
        throughput: Rgb,
        /// Events before.
        through: u32,
        /// Share of its emission that this ray counts; shadow rays count the rest.
        emission_share: f64,
        /// True if ideal lobes alone led here, and not straight on.
        by_ideal_lobes: bool,
    },
    /// Light of lamps and surroundings that a glossy surface sends back along the ray.
    Lit {
        /// Radiance at the start.
        radiance: Rgb,
        /// Events before, the glossy one not counted.
        through: u32,
    },
    /// The ray left the scene.
    Escaped {
        /// Unit direction in which it left.
        direction: Vec3,
        /// Radiance at the start over radiance arriving from outside.
        throughput: Rgb,
        /// Events before.
        through: u32,
        /// Share of what arrives from there that this ray counts.
        share: f64,
    },
    /// The limit of events cut the walk.
    Truncated {
        /// Radiance at the start over the radiance that was not looked at.
        throughput: Rgb,
    },
}

/// How a walk goes on.
struct Step {
    direction: Vec3,
    /// Radiance towards the viewer over radiance from `direction`, over the probability of the choice.
    weight: Rgb,
    /// The same without the n² scaling.
    power: f64,
    sight: Sight,
    transmits: bool,
    /// By a glossy lobe.
    glossy: bool,
    /// Not straight on.
    bends: bool,
}

impl World {
    /// Follows `ray`: every surface met is visited, and the walk goes on by one lobe at each that is not diffuse.
    ///
    /// At a surface with a diffuse part it goes on with a probability equal to the albedo of its other lobes. It ends at what is black or
    /// lies outside; or at `max_events` events, which counts as truncated.
    #[inline]
    pub fn follow(
        &self,
        ray: Ray,
        sight: Sight,
        sampler: &mut Sampler,
        max_events: u32,
        counts: &mut RayCounts,
        visit: impl FnMut(Event<'_>),
    ) {
        self.follow_by::<All>(ray, sight, sampler, max_events, counts, visit);
    }

    /// As [`Self::follow`], by code that holds the stages `K`.
    #[inline]
    pub fn follow_by<K: Stages>(
        &self,
        mut ray: Ray,
        mut sight: Sight,
        sampler: &mut Sampler,
        max_events: u32,
        counts: &mut RayCounts,
        mut visit: impl FnMut(Event<'_>),
    ) {
        let mut throughput = Rgb::WHITE;
        // The same without the n² scaling, which a path gets back when it leaves the glass.
        let mut survival = 1.0;
        let mut through = 0;
        let (mut bent, mut glossy) = (false, false);
        loop {
            let Some(si) = self.intersect_by::<K>(&ray) else {
                counts.distant += u64::from(K::DISTANT);
                let share = if K::DISTANT { self.escape_share(&sight, ray.direction) } else { 0.0 };
                visit(Event::Escaped { direction: ray.direction, throughput, through, share });
                return;
            };
            counts.met::<K>();
            let shading = self.shading_by::<K>(&si);
            let emission_share = self.emission_share(&sight, ray.direction, &si);
            let by_ideal_lobes = bent && !glossy;
            visit(Event::Surface { at: &si, shading: &shading, throughput, through, emission_share, by_ideal_lobes });
            if !K::SPECULAR {
                return;
            }
            counts.lobes += 1;
            let ends = through + 1 >= max_events.min(LONGEST);
            let lit = |radiance: Rgb| visit(Event::Lit { radiance: throughput * radiance, through });
            let Some(step) = self.step::<K>(&si, &shading, &sight, sampler, counts, lit) else { return };
            throughput *= step.weight;
            survival *= step.power;
            through += 1;
            bent |= step.bends;
            glossy |= step.glossy;
            if ends {
                counts.truncated += 1;
                visit(Event::Truncated { throughput });
                return;
            }
            if through > ROULETTE_AFTER {
                let go_on = survival.min(most_survival(!step.glossy, through));
                if go_on < 1.0 && f64::from(sampler.next_1d()) >= go_on {
                    return;
                }
                throughput = throughput / go_on;
                survival /= go_on;
            }
            if step.transmits {
                counts.transmitted += 1;
            } else {
                counts.reflected += 1;
            }
            sight = step.sight;
            ray = si.spawn(step.direction);
        }
    }

    /// One lobe chosen by its share of power; `lit` gets the light of shadow rays that a glossy surface reflects.
    #[inline]
    fn step<K: Stages>(
        &self,
        si: &SurfaceInteraction,
        shading: &Shading<'_>,
        sight: &Sight,
        sampler: &mut Sampler,
        counts: &mut RayCounts,
        lit: impl FnOnce(Rgb),
    ) -> Option<Step> {
        let lobes = shading.lobes();
        let ideal: f64 = lobes.iter().map(|lobe| lobe.power).sum();
        let glossy = shading.glossy_albedo().mean();
        let total = ideal + glossy;
        if total <= 0.0 {
            return None;
        }
        // What is diffuse ends most walks: its light has been read.
        let go_on = if shading.has_diffuse() { total.min(MOST_SURVIVAL) } else { 1.0 };
        let glossy_probability = go_on * glossy / total;
        if glossy > 0.0 {
            let respond = |ray: &super::ShadowRay| {
                let mut response = shading.eval(ray.direction);
                response.diffuse = Rgb::BLACK;
                let other = glossy_probability * shading.glossy_pdf(ray.direction);
                response.glossy = response.glossy * balance(ray.density, other);
                response
            };
            let direct = self.direct_by::<K>(si, shading.receiver(), Shading::IN_PASSING, sampler, counts, respond).glossy;
            if !direct.is_black() {
                lit(direct);
            }
        }
        let u = f64::from(sampler.next_1d());
        if u >= go_on {
            return None;
        }
        if u < glossy_probability {
            let sample = shading.sample_glossy(sampler.next_2d(), (u / glossy_probability) as f32)?;
            let weight = sample.weight / glossy_probability;
            let density = glossy_probability * sample.pdf;
            let origin = Origin { point: si.point, receiver: shading.receiver(), density, sampling: Shading::IN_PASSING };
            let transmits = sample.direction.dot(si.ng) < 0.0;
            let power = weight.mean().min(1.0 / glossy_probability);
            return Some(Step {
                direction: sample.direction,
                weight,
                power,
                sight: Sight::Glossy(origin),
                transmits,
                glossy: true,
                bends: true,
            });
        }
        let u = ((u - glossy_probability) / (go_on - glossy_probability)) as f32;
        let (lobe, probability): (Lobe, f64) = lobes.choose(u)?;
        let probability = probability * (go_on - glossy_probability);
        // Straight on, the ray still looks where it was sent.
        let bends = !shading.is_straight(&lobe);
        let sight = if bends { Sight::Alone } else { *sight };
        let direction = shading.direction(&lobe)?;
        let (weight, power) = (lobe.weight / probability, lobe.power / probability);
        Some(Step { direction, weight, power, sight, transmits: lobe.transmits, glossy: false, bends })
    }
}
