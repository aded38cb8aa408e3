//! Few flat-sided lamps as arrays: chosen and sampled in f32, for walks that meet one surface after another.
//!
//! What [`World::direct`] does, in a cheaper way: lamps are weighed at once by a rough irradiance that knows which way each shines, and points lie evenly
//! on their area. On a path that goes on anyway, what the next ray finds makes up for it [Veach95].

use super::sight::Origin;
use super::{SurfaceInteraction, World};
use crate::geometry::{offset_origin, triangle};
use crate::light::{Emitter, Light};
use crate::material::Texture;
use crate::math::{Rgb, Vec2, Vec3, warp};
use wide::{CmpGt, f32x8};

/// Most lamps; more are left to the tree over lights.
const MOST: usize = 16;

/// Lamps whose normals sum up to this share of their area are flat.
const FLAT: f32 = 0.9999;

/// Least cosine at a flat lamp for which it is weighed, on its front.
const LEAST_COSINE: f32 = 0.02;

/// Lamps in a vector.
const WIDTH: usize = 8;

/// One property of all lamps.
type Lanes = [f32x8; MOST / WIDTH];

/// Lamps of triangles that shine alike all over; the only lights of a scene.
#[derive(Debug)]
pub struct Lamps {
    /// Number of vectors that hold lamps.
    vectors: usize,
    center: [Lanes; 3],
    radius: Lanes,
    normal: [Lanes; 3],
    /// The normal times the centre, less what makes lamps that are not flat shine everywhere.
    plane: Lanes,
    /// Luminance times area; 0 where there is no lamp.
    strength: Lanes,
    lamps: Vec<Lamp>,
    /// Lamp of each shape.
    of_shape: Vec<Option<u8>>,
}

/// One of them.
#[derive(Debug)]
struct Lamp {
    faces: Vec<Face>,
    /// Running sum of the areas [m²].
    running: Vec<f32>,
    radiance: Rgb,
    /// Bound on the rounding of a point, per coordinate.
    error: f32,
}

impl Lamp {
    #[inline]
    fn area(&self) -> f32 {
        self.running.last().copied().unwrap_or(0.0)
    }
}

/// A triangle of a lamp.
#[derive(Debug)]
struct Face {
    corner: Vec3,
    /// Edges from the corner to the two others.
    edges: [Vec3; 2],
    /// Unit normal on the side that shines.
    normal: Vec3,
}

/// A way to a lamp.
#[derive(Debug, Clone, Copy)]
pub struct LampSample {
    /// Unit direction to it.
    pub direction: Vec3,
    /// Density per steradian, the choice of the lamp included.
    pub density: f64,
    /// Its radiance [W/(m² sr)].
    pub radiance: Rgb,
    /// Where a shadow ray ends.
    pub target: Vec3,
}

impl Lamps {
    /// The lamps of a scene; `None` if some light is something else, or there are too many.
    pub fn of(world: &World) -> Option<Self> {
        let (scene, partition) = (world.scene(), world.partition());
        let lights = partition.shadow_lights();
        if lights.is_empty() || lights.len() > MOST || !partition.distant_lights().is_empty() || partition.environment().is_some()
        {
            return None;
        }
        let nothing = [f32x8::ZERO; MOST / WIDTH];
        let mut all = Self {
            vectors: lights.len().div_ceil(WIDTH),
            center: [nothing; 3],
            radius: [f32x8::ONE; MOST / WIDTH],
            normal: [nothing; 3],
            plane: nothing,
            strength: nothing,
            lamps: Vec::with_capacity(lights.len()),
            of_shape: vec![None; scene.shapes.len()],
        };
        for (i, &light) in lights.iter().enumerate() {
            let Light::Area(light) = &scene.lights[light] else { return None };
            let (Emitter::Triangles { corners, bounds, .. }, Texture::Constant(radiance)) = (&light.emitter, &light.radiance)
            else {
                return None;
            };
            let vectors = || corners.iter().map(|&[a, b, c]| triangle::area_vector(a, b, c));
            let running = vectors().scan(0.0, |sum, v| {
                *sum += v.length();
                Some(*sum as f32)
            });
            let face = |&[a, b, c]: &[Vec3; 3]| Face {
                corner: a,
                edges: [b - a, c - a],
                normal: (b - a).cross(c - a).normalize_or_zero(),
            };
            let lamp = Lamp {
                running: running.collect(),
                radiance: *radiance,
                error: 2.0 * corners.iter().map(|&[a, b, c]| triangle::leaving_error(a, b, c)).fold(0.0, f32::max),
                faces: corners.iter().map(face).collect(),
            };
            let sum = vectors().sum::<crate::math::DVec3>().as_vec3();
            let (normal, center) = (sum.normalize_or_zero(), bounds.center());
            let is_flat = sum.length() > FLAT * lamp.area();
            for axis in 0..3 {
                set(&mut all.center[axis], i, center[axis]);
                set(&mut all.normal[axis], i, normal[axis]);
            }
            set(&mut all.radius, i, 0.5 * bounds.diagonal());
            set(&mut all.plane, i, if is_flat { normal.dot(center) } else { f32::NEG_INFINITY });
            set(&mut all.strength, i, radiance.luminance() as f32 * lamp.area());
            all.of_shape[light.shape as usize] = Some(i as u8);
            all.lamps.push(lamp);
        }
        Some(all)
    }

    /// True if there is more than one.
    pub fn is_choice(&self) -> bool {
        self.lamps.len() > 1
    }

    /// The lamps as a point with normal `n` sees them: weighed, once for all that is drawn there, by rough irradiance, nothing in
    /// between, which is 0 only where no light can arrive.
    #[inline]
    pub fn seen_from(&self, p: Vec3, n: Vec3) -> LampView<'_> {
        let at = (p.to_array().map(f32x8::splat), n.to_array().map(f32x8::splat));
        let dot = |a: [f32x8; 3], b: [f32x8; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let mut weights = [0.0; MOST];
        let mut total = 0.0;
        for (v, of_vector) in weights.chunks_exact_mut(WIDTH).enumerate().take(self.vectors) {
            let of = |all: &[Lanes; 3]| [all[0][v], all[1][v], all[2][v]];
            let (center, normal, radius) = (of(&self.center), of(&self.normal), self.radius[v]);
            let way = [center[0] - at.0[0], center[1] - at.0[1], center[2] - at.0[2]];
            let over_distance = f32x8::ONE / dot(way, way).max(radius * radius).sqrt();
            let cos = ((dot(way, at.1) + radius) * over_distance).max(f32x8::ZERO).min(f32x8::ONE);
            let height = dot(at.0, normal) - self.plane[v];
            let least = height.cmp_gt(f32x8::ZERO).blend(f32x8::splat(LEAST_COSINE), f32x8::ZERO);
            let shines = (height * over_distance).min(f32x8::ONE).max(least);
            let all = self.strength[v] * cos * shines * over_distance * over_distance;
            total += all.reduce_add();
            of_vector.copy_from_slice(&all.to_array());
        }
        LampView { lamps: self, point: p, weights, total }
    }

    /// Density per steradian with which [`LampView::sample`] finds the point `at` of a lamp, which a ray from `origin` along `direction` has met;
    /// `None` if `at` is no lamp, or both sides of `origin` receive: shadow rays are not sent by this then.
    #[inline]
    pub fn density(&self, origin: &Origin, direction: Vec3, at: &SurfaceInteraction) -> Option<f64> {
        let lamp = usize::from(self.of_shape[at.shape as usize]?);
        let LampView { weights, total, .. } = self.seen_from(origin.point, origin.receiver?);
        let cos = -direction.dot(at.ng);
        if total <= 0.0 || cos <= 0.0 {
            return Some(0.0);
        }
        let d2 = (at.point - origin.point).length_squared();
        Some(f64::from(d2 / (cos * self.lamps[lamp].area()) * (weights[lamp] / total)))
    }
}

/// Lamps as one place sees them.
#[derive(Debug)]
pub struct LampView<'a> {
    lamps: &'a Lamps,
    point: Vec3,
    weights: [f32; MOST],
    total: f32,
}

impl LampView<'_> {
    /// A point of one of the lamps; `None` where it shines the other way.
    #[inline]
    pub fn sample(&self, choice: f32, mut u: Vec2) -> Option<LampSample> {
        let Self { lamps, point, weights, total } = self;
        if *total <= 0.0 {
            return None;
        }
        let mut rest = choice * total;
        let mut chosen = 0;
        while chosen + 1 < lamps.lamps.len() && rest >= weights[chosen] {
            rest -= weights[chosen];
            chosen += 1;
        }
        // Rounding may lead past the last that counts.
        while weights[chosen] == 0.0 {
            chosen = chosen.checked_sub(1)?;
        }
        let lamp = &lamps.lamps[chosen];
        let along = u.x * lamp.area();
        // Most lamps have two triangles.
        let k =
            if lamp.running[0] > along { 0 } else { lamp.running.partition_point(|&r| r <= along).min(lamp.running.len() - 1) };
        let before = if k == 0 { 0.0 } else { lamp.running[k - 1] };
        u.x = ((along - before) / (lamp.running[k] - before)).clamp(0.0, 1.0 - f32::EPSILON);
        let (w, &Face { corner, edges, normal }) = (warp::triangle(u), &lamp.faces[k]);
        let position = corner + edges[0] * w.x + edges[1] * w.y;
        let way = position - *point;
        let d2 = way.length_squared();
        let direction = way / d2.sqrt();
        let cos = -normal.dot(direction);
        // False for a point on the lamp itself, too.
        let shines = cos > 0.0 && d2 > 0.0;
        let target = offset_origin(position, Vec3::splat(lamp.error), normal, -direction);
        let density = f64::from(d2 / (cos * lamp.area()) * (weights[chosen] / total));
        shines.then_some(LampSample { direction, density, radiance: lamp.radiance, target })
    }
}

fn set(lanes: &mut Lanes, lamp: usize, value: f32) {
    let mut of_vector = lanes[lamp / WIDTH].to_array();
    of_vector[lamp % WIDTH] = value;
    lanes[lamp / WIDTH] = of_vector.into();
}
