//! A ray followed through mirrors and glass until it meets something that is not purely specular.

use super::{SurfaceInteraction, World};
use crate::geometry::Ray;
use crate::material::{Lobe, Lobes};
use crate::math::{Frame, Rgb, Sampler, Vec3};

/// After this many specular events a path goes on with a probability equal to its throughput.
const ROULETTE_AFTER: u32 = 8;
/// No chain is longer; a closed box of perfect mirrors would otherwise never end.
const LONGEST: u32 = 512;

/// Counts of rays, added up over a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// Rays from the camera.
    pub camera: u64,
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
    /// Chains cut by the depth limit.
    pub truncated: u64,
    /// Weight of what the depth limit cut from camera paths, in units of 2^-32: an integer, so that its sum has no order.
    pub truncated_weight: u64,
}

impl std::ops::AddAssign for RayCounts {
    fn add_assign(&mut self, o: Self) {
        self.camera += o.camera;
        self.shadow += o.shadow;
        self.gather += o.gather;
        self.form_factor += o.form_factor;
        self.reflected += o.reflected;
        self.transmitted += o.transmitted;
        self.truncated += o.truncated;
        self.truncated_weight += o.truncated_weight;
    }
}

impl RayCounts {
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
    /// A surface. `through` counts the specular events before it.
    Surface {
        /// Where.
        at: &'a SurfaceInteraction,
        /// Radiance at the start over radiance leaving here.
        throughput: Rgb,
        /// Specular events before.
        through: u32,
        /// True if the path so far is one straight line, through thin plates at most: a shadow ray could have taken it.
        straight: bool,
    },
    /// The ray left the scene.
    Escaped {
        /// Radiance at the start over radiance arriving from outside.
        throughput: Rgb,
        /// Specular events before.
        through: u32,
    },
    /// The limit of specular events cut the walk.
    Truncated {
        /// Radiance at the start over the radiance that was not looked at.
        throughput: Rgb,
    },
}

impl World {
    /// Follows `ray`: every surface met is visited, and the walk goes on through specular ones, one lobe chosen at each.
    ///
    /// It ends at a surface that has a diffuse part, is black, or lies outside; or at `max_events` specular events, which counts
    /// as truncated.
    #[inline]
    pub fn follow(
        &self,
        mut ray: Ray,
        sampler: &mut Sampler,
        max_events: u32,
        counts: &mut RayCounts,
        mut visit: impl FnMut(Event<'_>),
    ) {
        let mut throughput = Rgb::WHITE;
        // The same without the n² scaling, which a path gets back when it leaves the glass.
        let mut survival = 1.0;
        let mut through = 0;
        let mut straight = true;
        loop {
            let Some(si) = self.intersect(&ray) else {
                visit(Event::Escaped { throughput, through });
                return;
            };
            visit(Event::Surface { at: &si, throughput, through, straight });
            let surface = self.scene.material_of(&self.scene.shapes[si.shape as usize]);
            if surface.material.has_diffuse() {
                return;
            }
            let Some((direction, lobe, probability)) = self.choose_lobe(&si, sampler.next_1d()) else { return };
            throughput *= lobe.weight / probability;
            survival *= lobe.power / probability;
            through += 1;
            straight &= lobe.transmits && surface.material.passes_straight();
            if through >= max_events.min(LONGEST) {
                counts.truncated += 1;
                visit(Event::Truncated { throughput });
                return;
            }
            if through > ROULETTE_AFTER {
                let go_on = survival.min(0.95);
                if f64::from(sampler.next_1d()) >= go_on {
                    return;
                }
                throughput = throughput / go_on;
                survival /= go_on;
            }
            if lobe.transmits {
                counts.transmitted += 1;
            } else {
                counts.reflected += 1;
            }
            ray = si.spawn(direction);
        }
    }

    /// One specular direction at `si`, its lobe, and the probability of the choice.
    #[inline]
    fn choose_lobe(&self, si: &SurfaceInteraction, u: f32) -> Option<(Vec3, Lobe, f64)> {
        let (lobes, frame) = self.lobes_at(si)?;
        let (lobe, probability) = lobes.choose(u)?;
        Some((self.lobe_direction(si, &frame, &lobe)?, lobe, probability))
    }

    /// The specular lobes at `si` in the frame they are meant in; `None` on the back of a one-sided opaque surface.
    #[inline]
    pub fn lobes_at(&self, si: &SurfaceInteraction) -> Option<(Lobes, Frame)> {
        let surface = self.scene.material_of(&self.scene.shapes[si.shape as usize]);
        let frame = si.specular_frame();
        let mut wo = frame.to_local(si.wo);
        if !si.front && surface.material.is_transmissive() {
            // The interaction's normals face the viewer; a boundary needs to know that the viewer is inside.
            wo.z = -wo.z;
        } else if !si.front && !surface.two_sided {
            return None;
        }
        Some((surface.material.lobes(wo, si.uv), frame))
    }

    /// World direction of `lobe`; `None` if a shading normal would send it to the wrong side of the surface.
    #[inline]
    pub fn lobe_direction(&self, si: &SurfaceInteraction, frame: &Frame, lobe: &Lobe) -> Option<Vec3> {
        let mut wi = lobe.wi;
        let viewer_below = !si.front && self.scene.material_of(&self.scene.shapes[si.shape as usize]).material.is_transmissive();
        if viewer_below {
            wi.z = -wi.z;
        }
        let direction = frame.to_world(wi);
        if (direction.dot(si.ng) < 0.0) == lobe.transmits {
            return Some(direction);
        }
        // A bent normal sent the direction to the wrong side: use the geometric normal for a reflection, give up otherwise.
        (!lobe.transmits).then(|| 2.0 * si.wo.dot(si.ng) * si.ng - si.wo)
    }
}
