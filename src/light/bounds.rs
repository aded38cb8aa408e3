//! Where a light is and which way it shines: what a tree over many lights knows of each and of groups.

use super::{Emitter, Light};
use crate::geometry::{Bounds, triangle};
use crate::math::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Box, directions and strength of a light or of a group of lights [ContyKulla18].
#[derive(Debug, Clone, Copy)]
pub struct EmissionBounds {
    /// Box of all emitting points.
    pub bounds: Bounds,
    /// Unit axis of the cone that holds the normals of all emitting surfaces.
    pub axis: DVec3,
    /// Half the opening of that cone [radians]; pi: all directions.
    pub normals: f64,
    /// Largest angle off a normal at which light leaves [radians].
    pub emission: f64,
    /// Largest intensity in any direction, by luminance [W/sr], about.
    pub strength: f64,
}

impl EmissionBounds {
    /// Bounds of a light; `None` if it has no place in the scene, or is dark.
    pub fn of(light: &Light) -> Option<Self> {
        let everywhere = |bounds, emission, strength| Self { bounds, axis: DVec3::Z, normals: PI, emission, strength };
        let found = match light {
            Light::Point(l) => everywhere(Bounds::new(l.position, l.position), FRAC_PI_2, l.intensity.luminance()),
            Light::Spot(l) => Self {
                bounds: Bounds::new(l.position, l.position),
                axis: l.axis,
                normals: l.beam_width,
                emission: l.cutoff - l.beam_width,
                strength: l.intensity.luminance(),
            },
            Light::Area(l) => {
                let radiance = l.mean_radiance().luminance();
                match &l.emitter {
                    Emitter::Sphere(s) => {
                        let bounds = Bounds::new(s.center - s.radius, s.center + s.radius);
                        everywhere(bounds, FRAC_PI_2, radiance * 0.25 * l.area())
                    }
                    Emitter::Triangles { corners, bounds, .. } => {
                        let vectors = || corners.iter().map(|&[a, b, c]| triangle::area_vector(a, b, c));
                        let sum: DVec3 = vectors().sum();
                        let axis = sum.try_normalize().unwrap_or(DVec3::Z);
                        let normals = vectors().map(|v| axis.angle_between(v)).fold(0.0, f64::max);
                        // A closed surface shows a quarter of its area from anywhere (Cauchy), a flat one all of it from the front.
                        let shown = sum.length().max(0.25 * l.area());
                        Self { bounds: *bounds, axis, normals, emission: FRAC_PI_2, strength: radiance * shown }
                    }
                }
            }
            Light::Directional(_) | Light::Environment(_) => return None,
        };
        (found.strength > 0.0).then_some(found)
    }

    /// Bounds of both.
    pub fn union(&self, other: &Self) -> Self {
        let (axis, normals) = cone_of_both((self.axis, self.normals), (other.axis, other.normals));
        Self {
            bounds: self.bounds.union(other.bounds),
            axis,
            normals,
            emission: self.emission.max(other.emission),
            strength: self.strength + other.strength,
        }
    }

    /// Cost of a group in the heuristic by which groups are split: strength times the directions and the surface that it spreads
    /// over [ContyKulla18], the surface being that of the ball around the box.
    pub fn cost(&self) -> f64 {
        let spread = (self.normals + self.emission).min(PI);
        let (sin, cos) = self.normals.sin_cos();
        let solid = 2.0 * PI * (1.0 - cos)
            + FRAC_PI_2 * (2.0 * spread * sin - (self.normals - 2.0 * spread).cos() - 2.0 * self.normals * sin + cos);
        let diagonal = f64::from(self.bounds.diagonal());
        self.strength * solid * diagonal * diagonal
    }
}

/// The smallest cone that holds two cones, each an axis and half its opening.
fn cone_of_both(a: (DVec3, f64), b: (DVec3, f64)) -> (DVec3, f64) {
    let (wide, narrow) = if a.1 >= b.1 { (a, b) } else { (b, a) };
    let between = wide.0.angle_between(narrow.0);
    if (between + narrow.1).min(PI) <= wide.1 {
        return wide;
    }
    let opening = 0.5 * (wide.1 + between + narrow.1);
    let turn_about = wide.0.cross(narrow.0);
    if opening >= PI || turn_about.length_squared() < 1e-24 {
        return (wide.0, PI);
    }
    let turn = glam::DQuat::from_axis_angle(turn_about.normalize(), opening - wide.1);
    (turn * wide.0, opening)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Sampler;

    #[test]
    fn a_cone_of_two_holds_both() {
        let unit = |s: &mut Sampler| crate::math::warp::sphere(s.next_2d()).as_dvec3();
        for i in 0..200 {
            let mut s = Sampler::new(1, i, 0);
            let (a, b) = ((unit(&mut s), f64::from(s.next_1d())), (unit(&mut s), f64::from(s.next_1d()) * 2.0));
            let (axis, opening) = cone_of_both(a, b);
            for (inner, half) in [a, b] {
                for _ in 0..8 {
                    // A direction on the rim.
                    let side = inner.cross(unit(&mut s)).normalize();
                    let rim = inner * half.cos() + side * half.sin();
                    assert!(axis.angle_between(rim) <= opening + 1e-6, "{rim} lies outside");
                }
            }
            assert!(opening <= 0.5 * (a.1 + b.1 + a.0.angle_between(b.0)).max(2.0 * a.1.max(b.1)) + 1e-6 || opening == PI);
        }
    }
}
