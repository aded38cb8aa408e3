//! Spot light: a point that shines into a cone.

use super::LightSample;
use crate::math::{DVec3, Frame, Rgb, Vec2, Vec3, warp};
use std::f64::consts::TAU;

/// A point whose intensity is full inside one cone, zero outside a wider one, and falls linearly with the angle between them
/// (Mitsuba's `spot`).
#[derive(Debug, Clone, Copy)]
pub struct SpotLight {
    /// Where it is.
    pub position: Vec3,
    /// Unit direction in which it shines.
    pub axis: DVec3,
    /// Radiant intensity inside the inner cone [W/sr].
    pub intensity: Rgb,
    /// Angle from the axis beyond which it is dark [radians], at most pi.
    pub cutoff: f64,
    /// Angle from the axis up to which the intensity is full [radians], at most `cutoff`.
    pub beam_width: f64,
}

impl SpotLight {
    /// Share of the full intensity that leaves along the unit vector `direction`, in [0, 1].
    #[inline]
    pub fn falloff(&self, direction: DVec3) -> f64 {
        // The arc cosine is ill-conditioned near the axis, where the intensity is constant; the arc tangent is not.
        let angle = self.axis.cross(direction).length().atan2(self.axis.dot(direction));
        if angle <= self.beam_width {
            1.0
        } else if angle < self.cutoff {
            (self.cutoff - angle) / (self.cutoff - self.beam_width)
        } else {
            0.0
        }
    }

    /// The one direction to the light; `None` outside its cone.
    #[inline]
    pub fn sample(&self, point: Vec3) -> Option<LightSample> {
        let to_light = (self.position - point).as_dvec3();
        let d2 = to_light.length_squared();
        let direction = to_light / d2.sqrt();
        let falloff = if d2 > 0.0 { self.falloff(-direction) } else { 0.0 };
        (falloff > 0.0).then(|| LightSample {
            target: Some(self.position),
            direction: direction.as_vec3(),
            irradiance: self.intensity * (falloff / d2),
            pdf: f64::INFINITY,
            area_density: 0.0,
        })
    }

    /// A direction of its cone, uniform, and its density per steradian.
    pub fn departure(&self, u: Vec2) -> (Vec3, f64) {
        let one_minus_cos = 2.0 * (0.5 * self.cutoff).sin().powi(2);
        let direction = Frame::new(self.axis.as_vec3().normalize()).to_world(warp::cone(u, one_minus_cos as f32));
        (direction, 1.0 / (TAU * one_minus_cos))
    }

    /// Power [W]: the integral of the intensity, 2 pi I (1 - (sin c - sin b)/(c - b)) for cut-off c and beam width b.
    pub fn power(&self) -> Rgb {
        let (b, c) = (self.beam_width, self.cutoff);
        // (sin c - sin b)/(c - b) without cancellation; its limit for c = b is cos b.
        let half = 0.5 * (c - b);
        let sinc = if half > 0.0 { half.sin() / half } else { 1.0 };
        self.intensity * (TAU * (1.0 - (0.5 * (c + b)).cos() * sinc))
    }

    /// Irradiance at `point` with normal `n`, visibility aside.
    #[inline]
    pub fn importance(&self, point: Vec3, n: Vec3) -> f64 {
        self.sample(point).map_or(0.0, |s| s.irradiance.luminance() * f64::from(s.direction.dot(n)).max(0.0))
    }
}
