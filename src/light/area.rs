//! Emitting triangles and spheres.

use super::cells::Cells;
use super::projected::{Faces, Seen};
use super::{LightHit, LightSample, Receiver};
use crate::geometry::{Bounds, Mesh, Sphere, offset_origin, triangle};
use crate::material::Texture;
use crate::math::{CompensatedSum, DVec2, DVec3, Frame, Rgb, Vec2, Vec3, warp};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Relative bound on the rounding of a point on a spherical lamp, in units of its largest coordinate.
const SPHERE_ERROR: f32 = 8.0 * f32::EPSILON;

/// Most cells along the edge of a textured triangle: as fine as the texels up to here.
const MOST_PER_EDGE: usize = 64;

/// Most cells of a textured emitter, whatever the number of its triangles.
const MOST_CELLS: usize = 1 << 18;

/// Lookups along the edge of a textured triangle, at least: a border between texels is then off by less than 1/1000 of the edge.
const LEAST_LOOKUPS_PER_EDGE: usize = 512;

/// Most lookups that measure a textured emitter.
const MOST_LOOKUPS: usize = 1 << 22;

/// A cell is sampled as if it had at least this share of the emitter's mean radiance: what shines between the points at which
/// its texture was looked up is then still found.
const LEAST_SHARE: f64 = 0.05;

/// Rows and columns of the grid over which the texture of a sphere is averaged.
const SPHERE_GRID: usize = 512;

/// A shape that emits from every point of its normal side the same radiance into every direction of that side.
#[derive(Debug, Clone)]
pub struct AreaLight {
    /// Index of the shape in the scene.
    pub shape: u32,
    /// Emitted radiance [W/(m² sr)] over the shape's texture coordinates.
    pub radiance: Texture,
    /// Its surface.
    pub emitter: Emitter,
    area: f64,
    mean: Rgb,
    /// Luminance of the mean times the area.
    strength: f64,
    /// All of the surface lies in it.
    ball: Ball,
    cells: Cells,
    /// Running sum of the weights by which cells are chosen, cells of the first triangle first; empty for a sphere.
    running: Vec<f64>,
    /// Its faces, if it has few and shines alike everywhere: they are sampled by what they do for a receiver.
    faces: Option<Box<Faces>>,
}

/// Centre and radius.
#[derive(Debug, Clone, Copy)]
struct Ball {
    center: Vec3,
    radius: f32,
}

/// A point of a lamp's surface that light leaves from.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint {
    /// The point.
    pub position: Vec3,
    /// Unit normal of the side that emits.
    pub normal: DVec3,
    /// Bound on the rounding of the point, per coordinate.
    pub error: Vec3,
    /// Index of the primitive within its shape.
    pub primitive: u32,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Radiance emitted there [W/(m² sr)].
    pub radiance: Rgb,
    /// Density of the point per area [1/m²].
    pub density: f64,
}

/// The surface of an [`AreaLight`].
#[derive(Debug, Clone)]
pub enum Emitter {
    /// Triangles.
    Triangles {
        /// Corners of each.
        corners: Vec<[Vec3; 3]>,
        /// Texture coordinates at the corners of each; empty: the barycentric weights of the second and third.
        uvs: Vec<[Vec2; 3]>,
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
        let uvs = if mesh.uvs.is_empty() {
            Vec::new()
        } else {
            mesh.triangles.iter().map(|t| t.map(|i| mesh.uvs[i as usize])).collect()
        };
        let bounds = corners.iter().flatten().copied().collect();
        Emitter::Triangles { corners, uvs, bounds }
    }

    /// Area [m²].
    pub fn area(&self) -> f64 {
        match self {
            Emitter::Triangles { corners, .. } => {
                corners.iter().map(|&[a, b, c]| triangle::area_vector(a, b, c).length()).collect::<CompensatedSum>().value()
            }
            Emitter::Sphere(sphere) => sphere.area(),
        }
    }

    /// Texture coordinates of the point of triangle `index` with barycentric weights `w`.
    /// Texture coordinates of the point of triangle `index` with barycentric weights `w`; `w` itself on a sphere.
    pub fn uv_of(&self, index: usize, w: DVec2) -> Vec2 {
        match self {
            Emitter::Triangles { uvs, .. } => Self::uv(uvs, index, w),
            Emitter::Sphere(_) => w.as_vec2(),
        }
    }

    #[inline]
    fn uv(uvs: &[[Vec2; 3]], index: usize, w: DVec2) -> Vec2 {
        let Some([a, b, c]) = uvs.get(index).map(|t| t.map(|uv| uv.as_dvec2())) else { return w.as_vec2() };
        (a * (1.0 - w.x - w.y) + b * w.x + c * w.y).as_vec2()
    }
}

impl AreaLight {
    /// The light of shape `shape`; measures how much each part of the surface emits.
    pub fn new(shape: u32, radiance: Texture, emitter: Emitter) -> Self {
        let area = emitter.area();
        let (cells, mean, running) = match (&emitter, &radiance) {
            (Emitter::Sphere(_), _) => (Cells { per_edge: 1 }, mean_over_sphere(&radiance), Vec::new()),
            (Emitter::Triangles { corners, .. }, Texture::Constant(value)) => {
                let mut sum = CompensatedSum::default();
                let add = |&[a, b, c]: &[Vec3; 3]| {
                    sum.add(triangle::area_vector(a, b, c).length());
                    sum.value()
                };
                (Cells { per_edge: 1 }, *value, corners.iter().map(add).collect())
            }
            (Emitter::Triangles { corners, uvs, .. }, texture) => measure(corners, uvs, texture, area),
        };
        let faces = match (&emitter, &radiance) {
            (Emitter::Triangles { corners, .. }, Texture::Constant(_)) => Faces::of(corners).map(Box::new),
            _ => None,
        };
        let ball = match &emitter {
            Emitter::Triangles { bounds, .. } => Ball { center: bounds.center(), radius: 0.5 * bounds.diagonal() },
            Emitter::Sphere(s) => Ball { center: s.center, radius: s.radius },
        };
        let strength = mean.luminance() * area;
        Self { shape, radiance, emitter, area, mean, strength, ball, cells, running, faces }
    }

    /// Area [m²].
    #[inline]
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Radiance [W/(m² sr)] averaged over the surface.
    pub fn mean_radiance(&self) -> Rgb {
        self.mean
    }

    /// Power [W]: pi times the integral of the radiance over the surface.
    pub fn power(&self) -> Rgb {
        self.mean * (PI * self.area)
    }

    /// A point of the surface: for a few triangles of constant radiance by the projected solid angle in the sky of the receiver, for others
    /// by the power of their parts; for a sphere seen from outside by solid angle.
    #[inline]
    pub fn sample(&self, point: Vec3, receiver: impl Into<Receiver>, u: Vec2) -> Option<LightSample> {
        match &self.emitter {
            Emitter::Triangles { corners, uvs, .. } => match self.seen_from(point, receiver.into()) {
                Some(seen) => self.sample_seen(&seen, u),
                None => self.sample_triangles(point, u, corners, uvs),
            },
            Emitter::Sphere(sphere) => self.sample_sphere(point, u, sphere),
        }
    }

    /// Density per steradian with which [`AreaLight::sample`] from `point` for `receiver` finds the direction that meets this light at
    /// `hit`.
    #[inline]
    pub fn pdf(&self, point: Vec3, receiver: impl Into<Receiver>, direction: Vec3, hit: &LightHit) -> f64 {
        match &self.emitter {
            Emitter::Triangles { corners, .. } => {
                let Some(&[a, b, c]) = corners.get(hit.primitive as usize) else { return 0.0 };
                let vector = triangle::area_vector(a, b, c);
                let area = vector.length();
                let cos = -direction.as_dvec3().dot(vector) / area;
                if cos <= 0.0 {
                    return 0.0;
                }
                if let Some(seen) = self.seen_from(point, receiver.into()) {
                    return seen.pdf(direction, hit.primitive as usize);
                }
                let cell = if self.cells.per_edge == 1 { 0 } else { self.cells.index_of(weights_at(hit.position, [a, b, c])) };
                let d2 = (hit.position - point).as_dvec3().length_squared();
                d2 / cos * self.density(hit.primitive as usize * self.cells.count() + cell, area)
            }
            Emitter::Sphere(sphere) => {
                if direction.dot(hit.normal) >= 0.0 {
                    return 0.0;
                }
                one_minus_cos(point, sphere).map_or(0.0, |k| 1.0 / (2.0 * PI * k))
            }
        }
    }

    /// Density per area [1/m²] of points in a cell of a triangle of the given area.
    #[inline]
    fn density(&self, cell: usize, triangle_area: f64) -> f64 {
        let before = if cell == 0 { 0.0 } else { self.running[cell - 1] };
        let total = self.running.last().copied().unwrap_or(0.0);
        (self.running[cell] - before) * self.cells.count() as f64 / (total * triangle_area)
    }

    /// Its faces in the sky of a receiver; `None`: points are sampled by area.
    #[inline]
    fn seen_from(&self, point: Vec3, receiver: Receiver) -> Option<Seen<'_>> {
        self.faces.as_ref().and_then(|faces| faces.seen_from(point, receiver))
    }

    #[inline]
    fn sample_seen(&self, seen: &Seen<'_>, u: Vec2) -> Option<LightSample> {
        let toward = seen.sample(u)?;
        let direction = toward.direction.as_vec3();
        let target = offset_origin(toward.position.as_vec3(), Vec3::splat(toward.error), toward.normal.as_vec3(), -direction);
        // Of one radiance: points leave by area.
        let area_density = 1.0 / self.area;
        Some(LightSample { target: Some(target), direction, irradiance: self.mean / toward.pdf, pdf: toward.pdf, area_density })
    }

    fn sample_triangles(&self, point: Vec3, u: Vec2, corners: &[[Vec3; 3]], uvs: &[[Vec2; 3]]) -> Option<LightSample> {
        let start = self.point_on_triangles(u, corners, uvs)?;
        let to_light = (start.position - point).as_dvec3();
        let d2 = to_light.length_squared();
        let direction = to_light / d2.sqrt();
        let cos = -direction.dot(start.normal);
        if cos <= 0.0 || d2 == 0.0 {
            return None;
        }
        let pdf = d2 / cos * start.density;
        // The target is moved off the lamp, towards the receiver, so that the lamp does not shadow itself.
        let target = offset_origin(start.position, start.error, start.normal.as_vec3(), -direction.as_vec3());
        let (direction, irradiance) = (direction.as_vec3(), start.radiance / pdf);
        Some(LightSample { target: Some(target), direction, irradiance, pdf, area_density: start.density })
    }

    /// A point by the power of the parts.
    fn point_on_triangles(&self, mut u: Vec2, corners: &[[Vec3; 3]], uvs: &[[Vec2; 3]]) -> Option<SurfacePoint> {
        let total = *self.running.last()?;
        let cell = if self.running.len() == 1 {
            0
        } else {
            // The first number chooses the cell and, stretched again, serves inside it.
            let target = f64::from(u.x) * total;
            let i = self.running.partition_point(|&r| r <= target).min(self.running.len() - 1);
            let before = if i == 0 { 0.0 } else { self.running[i - 1] };
            u.x = (((target - before) / (self.running[i] - before)) as f32).clamp(0.0, 1.0 - f32::EPSILON);
            i
        };
        let index = cell / self.cells.count();
        let [a, b, c] = corners[index];
        let w = self.cells.inside(cell % self.cells.count(), warp::triangle(u));
        let position = (a.as_dvec3() * (1.0 - w.x - w.y) + b.as_dvec3() * w.x + c.as_dvec3() * w.y).as_vec3();
        let vector = triangle::area_vector(a, b, c);
        let area = vector.length();
        let uv = Emitter::uv(uvs, index, w);
        let radiance = match &self.radiance {
            Texture::Constant(value) => *value,
            texture => texture.at(uv),
        };
        // Interpolation in f32 costs as much again as leaving a surface.
        let error = Vec3::splat(2.0 * triangle::leaving_error(a, b, c));
        let density = self.density(cell, area);
        Some(SurfacePoint { position, normal: vector / area, error, primitive: index as u32, uv, radiance, density })
    }

    /// A point of the surface to leave from: by the power of its parts, or by area where it shines alike everywhere.
    pub fn departure(&self, u: Vec2) -> Option<SurfacePoint> {
        match &self.emitter {
            Emitter::Triangles { corners, uvs, .. } => self.point_on_triangles(u, corners, uvs),
            Emitter::Sphere(sphere) => {
                let normal = warp::sphere(u);
                let uv = sphere.uv(normal);
                Some(SurfacePoint {
                    position: (sphere.center.as_dvec3() + normal.as_dvec3() * f64::from(sphere.radius)).as_vec3(),
                    normal: normal.as_dvec3(),
                    error: Vec3::splat((sphere.center.abs().max_element() + sphere.radius) * SPHERE_ERROR),
                    primitive: 0,
                    uv,
                    radiance: self.radiance.at(uv),
                    density: 1.0 / self.area,
                })
            }
        }
    }

    /// Density per area [1/m²] with which [`AreaLight::departure`] finds the point `hit`.
    pub fn departure_density(&self, hit: &LightHit) -> f64 {
        match &self.emitter {
            Emitter::Triangles { corners, .. } => {
                let Some(&[a, b, c]) = corners.get(hit.primitive as usize) else { return 0.0 };
                let cell = if self.cells.per_edge == 1 { 0 } else { self.cells.index_of(weights_at(hit.position, [a, b, c])) };
                let area = triangle::area_vector(a, b, c).length();
                self.density(hit.primitive as usize * self.cells.count() + cell, area)
            }
            Emitter::Sphere(_) => 1.0 / self.area,
        }
    }

    fn sample_sphere(&self, point: Vec3, u: Vec2, sphere: &Sphere) -> Option<LightSample> {
        // Uniform in the cone that the sphere subtends (Shirley, Wang and Zimmerman 1996).
        let one_minus_cos = one_minus_cos(point, sphere)?;
        let to_center = sphere.center.as_dvec3() - point.as_dvec3();
        let (d2, r2) = (to_center.length_squared(), f64::from(sphere.radius) * f64::from(sphere.radius));
        let axis = (to_center / d2.sqrt()).as_vec3();
        let direction = Frame::new(axis).to_world(warp::cone(u, one_minus_cos as f32));
        let along = to_center.dot(direction.as_dvec3());
        let half_chord = (r2 - (d2 - along * along)).max(0.0).sqrt();
        let position = (point.as_dvec3() + direction.as_dvec3() * (along - half_chord)).as_vec3();
        let normal = sphere.normal(position);
        let error = Vec3::splat((sphere.center.abs().max_element() + sphere.radius) * SPHERE_ERROR);
        let target = offset_origin(position, error, normal, -direction);
        let pdf = 1.0 / (2.0 * PI * one_minus_cos);
        let irradiance = self.radiance.at(sphere.uv(normal)) / pdf;
        Some(LightSample { target: Some(target), direction, irradiance, pdf, area_density: 1.0 / self.area })
    }

    /// Rough unoccluded irradiance; an upper bound on the receiver's cosine keeps it positive wherever light can arrive.
    #[inline]
    pub fn importance(&self, point: Vec3, n: Vec3) -> f64 {
        let Ball { center, radius } = self.ball;
        let to_light = center - point;
        let distance = to_light.length().max(radius);
        // Largest cosine of any point of the bounding ball; at least a little, since the ball is rough.
        let cos = ((to_light.dot(n) + radius) / distance).clamp(0.0, 1.0);
        self.strength * f64::from(cos) / f64::from(distance * distance)
    }
}

/// 1 - cos of half the angle that a sphere subtends; `None` from inside.
#[inline]
fn one_minus_cos(point: Vec3, sphere: &Sphere) -> Option<f64> {
    let d2 = (sphere.center.as_dvec3() - point.as_dvec3()).length_squared();
    let r2 = f64::from(sphere.radius) * f64::from(sphere.radius);
    let sin2 = r2 / d2;
    (d2 > r2).then(|| sin2 / (1.0 + (1.0 - sin2).sqrt()))
}

/// Barycentric weights of the second and third corner at a point of a triangle.
fn weights_at(position: Vec3, [a, b, c]: [Vec3; 3]) -> DVec2 {
    let (e1, e2, p) = ((b - a).as_dvec3(), (c - a).as_dvec3(), (position - a).as_dvec3());
    let n = e1.cross(e2);
    DVec2::new(p.cross(e2).dot(n), e1.cross(p).dot(n)) / n.length_squared()
}

/// Cells of textured triangles, their mean radiance, and the running sum of the weights by which they are chosen.
fn measure(corners: &[[Vec3; 3]], uvs: &[[Vec2; 3]], texture: &Texture, area: f64) -> (Cells, Rgb, Vec<f64>) {
    let texels = match texture {
        Texture::Bitmap(bitmap) => Vec2::new(bitmap.width as f32, bitmap.height as f32),
        // Squares have no filter: their border is caught by many points.
        Texture::Checkerboard(_) => Vec2::splat(64.0),
        Texture::Constant(_) => Vec2::ONE,
    };
    // Texels along the longest edge of any triangle.
    let longest = (0..corners.len()).map(|i| {
        let [a, b, c] = [DVec2::ZERO, DVec2::X, DVec2::Y].map(|w| Emitter::uv(uvs, i, w) * texels);
        (b - a).length().max((c - b).length()).max((a - c).length())
    });
    let longest = (longest.fold(1.0, f32::max).min(1e6) as usize).max(1);
    let affordable = |most: usize| ((most / corners.len().max(1)) as f64).sqrt() as usize;
    let cells = Cells { per_edge: longest.min(MOST_PER_EDGE).min(affordable(MOST_CELLS)).max(1) };
    let wanted = (4 * longest).max(LEAST_LOOKUPS_PER_EDGE).div_ceil(cells.per_edge);
    let points = Cells { per_edge: wanted.min(affordable(MOST_LOOKUPS) / cells.per_edge).max(2) };
    let radiance_of = |triangle: usize, cell: usize| {
        let values = (0..points.count()).map(|k| {
            let w = cells.inside(cell, points.middle(k).as_vec2());
            texture.at(Emitter::uv(uvs, triangle, w))
        });
        values.sum::<Rgb>() / points.count() as f64
    };
    let n = cells.count();
    let cell_area: Vec<f64> = corners.iter().map(|&[a, b, c]| triangle::area_vector(a, b, c).length() / n as f64).collect();
    let radiance: Vec<Rgb> = (0..corners.len() * n).into_par_iter().map(|i| radiance_of(i / n, i % n)).collect();
    let mean: Rgb = radiance.iter().enumerate().map(|(i, l)| *l * (cell_area[i / n] / area)).sum();
    let least = LEAST_SHARE * mean.luminance();
    let mut sum = CompensatedSum::default();
    let running = radiance.iter().enumerate().map(|(i, l)| {
        // A texture that is black wherever it was looked up is sampled evenly.
        sum.add(cell_area[i / n] * if least > 0.0 { l.luminance().max(least) } else { 1.0 });
        sum.value()
    });
    (cells, mean, running.collect())
}

/// Mean of a texture over the surface of a sphere: midpoints in azimuth and in the cosine of the polar angle.
fn mean_over_sphere(texture: &Texture) -> Rgb {
    if let Texture::Constant(value) = texture {
        return *value;
    }
    let at = |i: usize| (i as f32 + 0.5) / SPHERE_GRID as f32;
    let v = |i: usize| (1.0 - 2.0 * at(i)).acos() / std::f32::consts::PI;
    let n = SPHERE_GRID * SPHERE_GRID;
    (0..n).map(|k| texture.at(Vec2::new(at(k % SPHERE_GRID), v(k / SPHERE_GRID)))).sum::<Rgb>() / n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn irradiance(light: &AreaLight, point: Vec3, n: Vec3, samples: usize) -> f64 {
        let at = |i: usize| (i as f32 + 0.5) / samples as f32;
        (0..samples * samples)
            .filter_map(|k| light.sample(point, Some(n), Vec2::new(at(k % samples), at(k / samples))))
            .map(|s| s.irradiance.r * f64::from(s.direction.dot(n)).max(0.0))
            .sum::<f64>()
            / (samples * samples) as f64
    }

    fn unit_square(z: f32, facing_down: bool) -> AreaLight {
        let p = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, y)| Vec3::new(x, y, z));
        let triangles = if facing_down { vec![[0, 2, 1], [0, 3, 2]] } else { vec![[0, 1, 2], [0, 2, 3]] };
        let mesh = Mesh { positions: p.to_vec(), triangles, ..Mesh::default() };
        AreaLight::new(0, Texture::Constant(Rgb::WHITE), Emitter::of_mesh(&mesh))
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
        let light = AreaLight::new(0, Texture::Constant(Rgb::WHITE), Emitter::Sphere(sphere));
        for (theta, want) in [(0.0_f32, PI / 4.0), (45.0, 0.555_360_367), (75.0, 0.221_200_88), (110.0, 0.006_753_066)] {
            let (s, c) = theta.to_radians().sin_cos();
            let got = irradiance(&light, Vec3::ZERO, Vec3::new(s, 0.0, c), 128);
            assert!((got / want - 1.0).abs() < 5e-3, "{theta} degrees: {got}, expected {want}");
        }
    }
}
