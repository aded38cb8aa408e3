//! Perspective camera: from film point to ray.

use crate::geometry::Ray;
use crate::math::{DAffine3, DVec2, DVec3, Vec2, Vec3};

/// Which side of the film the field of view spans.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FovAxis {
    /// Its width.
    X,
    /// Its height.
    Y,
    /// Its diagonal.
    Diagonal,
    /// The shorter side.
    Smaller,
    /// The longer side.
    Larger,
}

/// A pinhole camera that looks along its local +z, +y up and +x to the image's left (Mitsuba's convention).
#[derive(Debug, Clone)]
pub struct Camera {
    /// Local to scene coordinates; its translation is relative to the scene's origin.
    pub to_scene: DAffine3,
    /// Tangent of half the angle across `fov_axis`.
    pub tan_half_fov: f64,
    /// Side that `fov` spans.
    pub fov_axis: FovAxis,
    /// Where the view axis meets the film, from its middle towards the right and the bottom, as shares of width and height.
    pub principal_point: DVec2,
    /// Distance along the view axis before which nothing is seen.
    pub near_clip: f64,
    /// Distance along the view axis beyond which nothing is seen.
    pub far_clip: f64,
}

/// A point as the camera sees it.
#[derive(Debug, Clone, Copy)]
pub struct Sighting {
    /// Where on the film, in pixels from its top left corner.
    pub film_point: Vec2,
    /// Unit direction from the point to the camera.
    pub direction: Vec3,
    /// Squared distance [m²].
    pub distance_squared: f64,
    /// Importance W_e of the pixel there per steradian [1/sr]: a pixel's value is the integral of W_e L over its solid angle. It is
    /// also the density with which rays through uniform points of that pixel take this direction ([Veach97], section 8.3).
    pub importance: f64,
}

impl Camera {
    /// Where on a film of `width` x `height` pixels `point` is seen, other surfaces aside; `None` if it is not: outside the film, or of
    /// the range of distances.
    pub fn see(&self, point: Vec3, width: usize, height: usize) -> Option<Sighting> {
        let to_point = point.as_dvec3() - self.to_scene.translation.as_vec3().as_dvec3();
        let local = self.to_scene.matrix3.inverse() * to_point;
        let along = self.to_scene.transform_vector3(DVec3::Z).normalize().dot(to_point);
        if local.z <= 0.0 || along <= self.near_clip || along >= self.far_clip {
            return None;
        }
        let per_pixel = 2.0 * self.half_width(width, height) / width as f64;
        let middle = DVec2::new(width as f64, height as f64) * (0.5 - self.principal_point);
        let film = DVec2::new(middle.x - local.x / local.z / per_pixel, middle.y - local.y / local.z / per_pixel);
        let inside = film.x >= 0.0 && film.y >= 0.0 && film.x < width as f64 && film.y < height as f64;
        let distance_squared = to_point.length_squared();
        let cos = along / distance_squared.sqrt();
        inside.then(|| Sighting {
            film_point: film.as_vec2(),
            direction: (-to_point / distance_squared.sqrt()).as_vec3(),
            distance_squared,
            importance: 1.0 / (per_pixel * per_pixel * cos.powi(3)),
        })
    }

    /// Density per steradian of the rays through uniform points of one pixel, along the unit vector `direction` [1/sr].
    pub fn density(&self, direction: Vec3, width: usize, height: usize) -> f64 {
        let per_pixel = 2.0 * self.half_width(width, height) / width as f64;
        let cos = self.to_scene.transform_vector3(DVec3::Z).normalize().dot(direction.as_dvec3());
        1.0 / (per_pixel * per_pixel * cos.powi(3))
    }

    /// Half the width of the film at unit distance.
    pub fn half_width(&self, width: usize, height: usize) -> f64 {
        let tan = self.tan_half_fov;
        let aspect = width as f64 / height as f64;
        let spans_width = match self.fov_axis {
            FovAxis::X => true,
            FovAxis::Y => false,
            FovAxis::Smaller => width <= height,
            FovAxis::Larger => width >= height,
            FovAxis::Diagonal => {
                let diagonal = (width as f64).hypot(height as f64);
                return tan * width as f64 / diagonal;
            }
        };
        if spans_width { tan } else { tan * aspect }
    }

    /// A film of `width` x `height` pixels before the camera.
    pub fn view(&self, width: usize, height: usize) -> View<'_> {
        let per_pixel = 2.0 * self.half_width(width, height) / width as f64;
        let middle = DVec2::new(width as f64, height as f64) * (0.5 - self.principal_point);
        View { camera: self, per_pixel, middle, origin: self.to_scene.translation.as_vec3() }
    }

    /// The ray through film point `p` in pixels: (0, 0) is the top left corner of a film of `width` x `height`.
    pub fn ray(&self, p: Vec2, width: usize, height: usize) -> Ray {
        self.view(width, height).ray(p)
    }

    /// Viewing direction, unit length.
    pub fn forward(&self) -> Vec3 {
        self.to_scene.transform_vector3(DVec3::Z).normalize().as_vec3()
    }
}

/// A camera with its film: what all rays through the film share.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    camera: &'a Camera,
    /// Width of a pixel at unit distance.
    per_pixel: f64,
    /// Where the view axis meets the film [pixels].
    middle: DVec2,
    origin: Vec3,
}

impl View<'_> {
    /// Width of a pixel at unit distance.
    pub fn per_distance(&self) -> f32 {
        self.per_pixel as f32
    }

    /// The ray through film point `p` in pixels: (0, 0) is the top left corner.
    #[inline]
    pub fn ray(&self, p: Vec2) -> Ray {
        let x = (self.middle.x - f64::from(p.x)) * self.per_pixel;
        let y = (self.middle.y - f64::from(p.y)) * self.per_pixel;
        let local = DVec3::new(x, y, 1.0).normalize();
        let direction = self.camera.to_scene.transform_vector3(local).normalize();
        Ray {
            origin: self.origin,
            direction: direction.as_vec3(),
            t_min: (self.camera.near_clip / local.z) as f32,
            t_max: (self.camera.far_clip / local.z) as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(fov_axis: FovAxis) -> Camera {
        let tan_half_fov = 45.0_f64.to_radians().tan();
        let principal_point = DVec2::ZERO;
        Camera { to_scene: DAffine3::IDENTITY, tan_half_fov, fov_axis, principal_point, near_clip: 0.01, far_clip: 1e4 }
    }

    #[test]
    fn the_top_left_pixel_looks_up_and_towards_plus_x() {
        let d = camera(FovAxis::X).ray(Vec2::ZERO, 200, 100).direction;
        let want = Vec3::new(1.0, 0.5, 1.0).normalize();
        assert!((d - want).length() < 1e-6, "{d}, expected {want}");
    }

    #[test]
    fn the_principal_point_moves_as_mitsubas_does() {
        // Mitsuba 3.9.1: fov 40, film of 8 x 4, offsets 0.1 and 0.2; local directions over their z at film points.
        let tan_half_fov = 20.0_f64.to_radians().tan();
        let camera = Camera { tan_half_fov, principal_point: DVec2::new(0.1, 0.2), ..camera(FovAxis::X) };
        for (p, want) in
            [((0.0, 0.0), (0.291176, 0.109191)), ((8.0, 4.0), (-0.436764, -0.254779)), ((2.0, 2.0), (0.109191, -0.072794))]
        {
            let d = camera.ray(Vec2::new(p.0, p.1), 8, 4).direction;
            let (x, y) = (d.x / d.z, d.y / d.z);
            assert!((x - want.0).abs() < 1e-5 && (y - want.1).abs() < 1e-5, "{p:?}: {x} {y}, expected {want:?}");
        }
    }

    /// A ray's points are seen where the ray came from.
    #[test]
    fn a_point_is_seen_where_its_ray_starts() {
        let camera = Camera { principal_point: DVec2::new(0.1, -0.05), ..camera(FovAxis::X) };
        for p in [Vec2::new(0.5, 0.25), Vec2::new(7.5, 3.0), Vec2::new(3.0, 2.0)] {
            let ray = camera.ray(p, 8, 4);
            let seen = camera.see(ray.at(2.5), 8, 4).expect("before the camera");
            assert!((seen.film_point - p).length() < 1e-4, "{p}: {}", seen.film_point);
            assert!((seen.distance_squared - 6.25).abs() < 1e-4 && (seen.direction + ray.direction).length() < 1e-5);
            assert!((seen.importance / camera.density(ray.direction, 8, 4) - 1.0).abs() < 1e-4);
        }
        assert!(camera.see(Vec3::new(0.0, 0.0, -1.0), 8, 4).is_none(), "behind");
        assert!(camera.see(Vec3::new(2.0, 0.0, 1.0), 8, 4).is_none(), "beside");
    }

    /// The solid angle of a film is the sum of 1/W_e over its pixels, also that of a square pyramid:
    /// 4 arcsin(sin(a/2) sin(b/2)) with the two full angles a and b.
    #[test]
    fn importance_is_one_over_the_solid_angle_of_a_pixel() {
        let camera = camera(FovAxis::X);
        let n = 64;
        let sum: f64 = (0..n * n)
            .map(|i| {
                1.0 / camera.density(camera.ray(Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5), n, n).direction, n, n)
            })
            .sum();
        let want = 4.0 * (0.5_f64).asin();
        assert!((sum / want - 1.0).abs() < 1e-3, "{sum}, expected {want}");
    }

    #[test]
    fn the_field_of_view_spans_the_named_side() {
        for (axis, width) in [(FovAxis::X, 1.0), (FovAxis::Y, 2.0), (FovAxis::Smaller, 2.0), (FovAxis::Larger, 1.0)] {
            let got = camera(axis).half_width(200, 100);
            assert!((got - width).abs() < 1e-12, "{axis:?}: {got}");
        }
    }
}
