//! Emitting triangles and spheres.

use super::LightSample;
use crate::geometry::{Bounds, Mesh, Sphere, offset_origin, triangle};
use crate::math::{Frame, Rgb, Vec2, Vec3, warp};
use std::f64::consts::PI;

/// Relative bound on the rounding of a point on a spherical lamp, in units of its largest coordinate.
const SPHERE_ERROR: f32 = 8.0 * f32::EPSILON;

/// A shape that emits the same radiance from every point of its normal side into every direction of that side.
#[derive(Debug, Clone)]
pub struct AreaLight {
    /// Index of the shape in the scene.
    pub shape: u32,
    /// Emitted radiance [W/(m² sr)].
    pub radiance: Rgb,
    /// Its surface.
    pub emitter: Emitter,
}

/// The surface of an [`AreaLight`].
#[derive(Debug, Clone)]
pub enum Emitter {
    /// Triangles, with the running sum of their areas.
    Triangles {
        /// Corners of each.
        corners: Vec<[Vec3; 3]>,
        /// Area of all up to and including each [m²].
        running_area: Vec<f64>,
        /// Box of all.
        bounds: Bounds,
    },
    /// A sphere that emits outward.
    Sphere(Sphere),
}

impl Emitter {
    /// The triangles of a mesh.
    pub fn of_mesh(mesh: &Mesh) -> Self {
        let corners: Vec<_> = (0..mesh.triangles.len()).map(|i| mesh.corners(i)).collect();
        let mut sum = crate::math::CompensatedSum::default();
        let running_area = corners
            .iter()
            .map(|&[a, b, c]| {
                sum.add(triangle::area_vector(a, b, c).length());
                sum.value()
            })
            .collect();
        let bounds = corners.iter().flatten().copied().collect();
        Emitter::Triangles { corners, running_area, bounds }
    }

    /// Area [m²].
    pub fn area(&self) -> f64 {
        match self {
            Emitter::Triangles { running_area, .. } => running_area.last().copied().unwrap_or(0.0),
            Emitter::Sphere(sphere) => sphere.area(),
        }
    }
}

impl AreaLight {
    /// Power [W]: pi L A.
    pub fn power(&self) -> Rgb {
        self.radiance * (PI * self.emitter.area())
    }

    /// Density per steradian with which [`Self::sample`] from `point` finds `hit` along `direction`.
    #[inline]
    pub fn pdf(&self, point: Vec3, direction: Vec3, hit: &super::LightHit) -> f64 {
        match &self.emitter {
            Emitter::Triangles { .. } => {
                let cos = -f64::from(direction.dot(hit.normal));
                let d2 = f64::from((hit.position - point).length_squared());
                if cos > 0.0 { d2 / (cos * self.emitter.area()) } else { 0.0 }
            }
            Emitter::Sphere(sphere) => {
                let d2 = (sphere.center.as_dvec3() - point.as_dvec3()).length_squared();
                let sin2 = f64::from(sphere.radius).powi(2) / d2;
                if sin2 >= 1.0 { 0.0 } else { (1.0 + (1.0 - sin2).sqrt()) / (2.0 * PI * sin2) }
            }
        }
    }

    /// A point of the surface, uniform by area for triangles and by solid angle for a sphere seen from outside.
    #[inline]
    pub fn sample(&self, point: Vec3, u: Vec2) -> Option<LightSample> {
        match &self.emitter {
            Emitter::Triangles { corners, running_area, .. } => self.sample_triangles(point, u, corners, running_area),
            Emitter::Sphere(sphere) => self.sample_sphere(point, u, sphere),
        }
    }

    fn sample_triangles(&self, point: Vec3, mut u: Vec2, corners: &[[Vec3; 3]], running_area: &[f64]) -> Option<LightSample> {
        let area = *running_area.last()?;
        let index = if corners.len() == 1 {
            0
        } else {
            // The first number chooses the triangle and, stretched again, serves inside it.
            let target = f64::from(u.x) * area;
            let i = running_area.partition_point(|&a| a <= target).min(corners.len() - 1);
            let before = if i == 0 { 0.0 } else { running_area[i - 1] };
            u.x = (((target - before) / (running_area[i] - before)) as f32).clamp(0.0, 1.0 - f32::EPSILON);
            i
        };
        let [a, b, c] = corners[index];
        let w = warp::triangle(u);
        let position = a + (b - a) * w.x + (c - a) * w.y;
        let to_light = (position - point).as_dvec3();
        let d2 = to_light.length_squared();
        let direction = to_light / d2.sqrt();
        let n = triangle::area_vector(a, b, c).normalize_or_zero();
        let cos = -direction.dot(n);
        if cos <= 0.0 || d2 == 0.0 {
            return None;
        }
        let pdf = d2 / (cos * area);
        // The target is moved off the lamp, towards the receiver, so that the lamp does not shadow itself; its interpolation
        // in f32 costs as much again as leaving a surface.
        let error = Vec3::splat(2.0 * triangle::leaving_error(a, b, c));
        let position = offset_origin(position, error, n.as_vec3(), -direction.as_vec3());
        Some(LightSample { target: Some(position), direction: direction.as_vec3(), irradiance: self.radiance / pdf, pdf })
    }

    fn sample_sphere(&self, point: Vec3, u: Vec2, sphere: &Sphere) -> Option<LightSample> {
        let to_center = sphere.center.as_dvec3() - point.as_dvec3();
        let (d2, r2) = (to_center.length_squared(), f64::from(sphere.radius) * f64::from(sphere.radius));
        if d2 <= r2 {
            return None;
        }
        // Uniform in the cone that the sphere subtends (Shirley, Wang and Zimmerman 1996).
        let sin2 = r2 / d2;
        let one_minus_cos = sin2 / (1.0 + (1.0 - sin2).sqrt());
        let axis = (to_center / d2.sqrt()).as_vec3();
        let direction = Frame::new(axis).to_world(warp::cone(u, one_minus_cos as f32));
        let along = to_center.dot(direction.as_dvec3());
        let half_chord = (r2 - (d2 - along * along)).max(0.0).sqrt();
        let position = (point.as_dvec3() + direction.as_dvec3() * (along - half_chord)).as_vec3();
        let error = Vec3::splat((sphere.center.abs().max_element() + sphere.radius) * SPHERE_ERROR);
        let position = offset_origin(position, error, sphere.normal(position), -direction);
        let pdf = 1.0 / (2.0 * PI * one_minus_cos);
        Some(LightSample { target: Some(position), direction, irradiance: self.radiance / pdf, pdf })
    }

    /// Rough unoccluded irradiance; an upper bound on the receiver's cosine keeps it positive wherever light can arrive.
    #[inline]
    pub fn importance(&self, point: Vec3, n: Vec3) -> f64 {
        let (center, radius) = match &self.emitter {
            Emitter::Triangles { bounds, .. } => (bounds.center(), 0.5 * bounds.diagonal()),
            Emitter::Sphere(s) => (s.center, s.radius),
        };
        let to_light = center - point;
        let distance = to_light.length().max(radius);
        // Largest cosine of any point of the bounding ball; at least a little, since the ball is rough.
        let cos = ((to_light.dot(n) + radius) / distance).clamp(0.0, 1.0);
        self.radiance.luminance() * self.emitter.area() * f64::from(cos) / f64::from(distance * distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn irradiance(light: &AreaLight, point: Vec3, n: Vec3, samples: usize) -> f64 {
        let at = |i: usize| (i as f32 + 0.5) / samples as f32;
        (0..samples * samples)
            .filter_map(|k| light.sample(point, Vec2::new(at(k % samples), at(k / samples))))
            .map(|s| s.irradiance.r * f64::from(s.direction.dot(n)).max(0.0))
            .sum::<f64>()
            / (samples * samples) as f64
    }

    fn unit_square(z: f32, facing_down: bool) -> AreaLight {
        let p = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, y)| Vec3::new(x, y, z));
        let triangles = if facing_down { vec![[0, 2, 1], [0, 3, 2]] } else { vec![[0, 1, 2], [0, 2, 3]] };
        let mesh = Mesh { positions: p.to_vec(), triangles, ..Mesh::default() };
        AreaLight { shape: 0, radiance: Rgb::WHITE, emitter: Emitter::of_mesh(&mesh) }
    }

    #[test]
    fn a_square_overhead_gives_its_closed_form() {
        // physical_checks.csv square_onaxis: 0.752274688.
        let got = irradiance(&unit_square(1.0, true), Vec3::ZERO, Vec3::Z, 64);
        assert!((got / 0.752_274_688 - 1.0).abs() < 1e-3, "{got}");
    }

    #[test]
    fn the_back_of_an_emitter_is_dark() {
        assert_eq!(irradiance(&unit_square(1.0, false), Vec3::ZERO, Vec3::Z, 8), 0.0);
    }

    #[test]
    fn a_sphere_light_gives_its_closed_form_even_below_the_horizon() {
        // physical_checks.csv sphere_d2_r1_t*: L = 1, d = 2, r = 1.
        let sphere = Sphere { center: Vec3::new(0.0, 0.0, 2.0), radius: 1.0 };
        let light = AreaLight { shape: 0, radiance: Rgb::WHITE, emitter: Emitter::Sphere(sphere) };
        for (theta, want) in [(0.0_f32, PI / 4.0), (45.0, 0.555_360_367), (75.0, 0.221_200_88), (110.0, 0.006_753_066)] {
            let (s, c) = theta.to_radians().sin_cos();
            let got = irradiance(&light, Vec3::ZERO, Vec3::new(s, 0.0, c), 128);
            assert!((got / want - 1.0).abs() < 5e-3, "{theta} degrees: {got}, expected {want}");
        }
    }
}
