//! What of a disk around a surface point is of the same face and seen from there: photons behind a wall that crosses the disk are none of
//! the point's, and where the face ends there are none.

use super::Photon;
use crate::geometry::Ray;
use crate::math::{Frame, Vec3, sampler::mix};
use crate::world::World;
use std::f32::consts::TAU;

/// Height at which points of a disk look at each other, over its radius: above rounding, below what stands on the face.
const LIFT: f32 = 1.0 / 512.0;
/// The same for bent faces, over the distance times the bend of the normal: twice what an arc needs.
const LIFT_BY_BEND: f32 = 0.25;
/// The same over the scene's diagonal, at least: rounding.
const LEAST_LIFT: f32 = 1e-6;
/// Points drawn at most: a point of a face always has some of the disk for its own, at a corner of a cube a quarter.
const MOST_TRIALS: u32 = 32;

/// Directions in which a point looks along its face.
const SPOKES: usize = 6;
/// How far a look goes, over the radius of the disk: to the corners of a hexagon around it.
const SPOKE: f32 = 1.154_700_5;
/// What a look that ends at something counts, over its length: what is not yet beyond it.
const SHORT: f32 = 0.99;
/// What is higher above a face or deeper below it than this, over the radius, is asked for by itself.
const FLAT: f32 = 1.0 / 16.0;

/// A surface point and the unit normal of its face, on the side that is looked at.
pub(super) type SurfacePoint = (Vec3, Vec3);

/// The face around a point.
#[derive(Clone, Copy)]
pub(super) struct Face<'a> {
    pub world: &'a World,
    pub at: SurfacePoint,
    /// What is farther above or below is of another face [m].
    pub height: f32,
    /// Least cosine between normals of one face.
    pub least_cosine: f32,
}

impl Face<'_> {
    /// True if a point is of the face, whether seen or not.
    #[inline]
    pub fn holds(&self, (point, normal): SurfacePoint) -> bool {
        normal.dot(self.at.1) > self.least_cosine && (point - self.at.0).dot(self.at.1).abs() < self.height
    }

    /// True if nothing stands between the face's point and another one, as they look at each other from just above.
    pub fn sees(&self, other: SurfacePoint, radius: f32) -> bool {
        sees(self.world, self.at, other, radius)
    }

    /// True if a photon is of the face and seen.
    pub fn sees_photon(&self, photon: &Photon, radius: f32) -> bool {
        self.sees((photon.point, photon.normal), radius)
    }

    /// What of a disk around the face's point is seen from there for sure, by rays just above the face, outwards and from end to end.
    pub fn outlook(&self, radius: f32) -> Outlook {
        let (point, normal) = self.at;
        let lift = lift(self.world, radius);
        let axes = Frame::new(normal);
        let mut ends = [Vec3::ZERO; SPOKES];
        let mut lengths = [SPOKE * radius; SPOKES];
        for (k, (end, length)) in ends.iter_mut().zip(&mut lengths).enumerate() {
            let (sin, cos) = spoke(k).sin_cos();
            let mut out = Ray::new(point + normal * lift, axes.s * cos + axes.t * sin);
            out.t_max = *length;
            if let Some(met) = self.world.intersect(&out) {
                *length = SHORT * met.t;
            }
            *end = out.at(*length);
        }
        let is_clear = std::array::from_fn(|k| !self.world.occluded(&Ray::between(ends[k], ends[(k + 1) % SPOKES])));
        let mut outlook = Outlook { lengths, is_clear, height: FLAT * radius, inner: 0.0 };
        if is_clear.into_iter().all(|clear| clear) {
            let nearest = (0..SPOKES).map(|k| {
                let [[ax, ay], [bx, by]] = outlook.chord(k);
                (ax * by - ay * bx) / (bx - ax).hypot(by - ay)
            });
            outlook.inner = nearest.fold(radius, f32::min).powi(2);
        }
        outlook
    }

    /// One over the share of a disk that is of the face and seen, right in the mean: the number of points drawn from the disk until one is
    /// [Booth07]. `share` gives the distance of a point, over the radius, of three uniform numbers in [0, 1).
    pub fn trials(&self, radius: f32, seed: u64, outlook: Option<&Outlook>, share: impl Fn([f32; 3]) -> f32) -> u32 {
        let (point, normal) = self.at;
        let axes = Frame::new(normal);
        let number = |k: u64| (mix(seed.wrapping_add(mix(k))) >> 40) as f32 * 2.0_f32.powi(-24);
        let is_own = |trial: u32| {
            let k = 4 * u64::from(trial);
            let (sin, cos) = (TAU * number(k)).sin_cos();
            let distance = radius * share([number(k + 1), number(k + 2), number(k + 3)]);
            let beside = point + (axes.s * cos + axes.t * sin) * distance;
            // From just above, as something may hang low over the face; from higher up, as a hollow face rises beside the point.
            [lift(self.world, radius), self.height].into_iter().any(|height| {
                let mut down = Ray::new(beside + normal * height, -normal);
                down.t_max = height + self.height;
                self.world.intersect(&down).is_some_and(|met| {
                    let other = (met.point, met.ng);
                    self.holds(other) && (outlook.is_some_and(|o| o.holds(self.at, other.0)) || self.sees(other, radius))
                })
            })
        };
        (1..MOST_TRIALS).find(|trial| is_own(*trial)).unwrap_or(MOST_TRIALS)
    }
}

/// A star of triangles around a surface point, on its face: as far as nothing stands in the way of a look.
#[derive(Debug, Clone, Copy)]
pub(super) struct Outlook {
    /// How far the point looks each way [m].
    lengths: [f32; SPOKES],
    /// True if nothing stands between the ends of a look and the next one.
    is_clear: [bool; SPOKES],
    /// What is farther above or below may be hidden [m].
    height: f32,
    /// Squared radius of a disk within the triangles, if all are clear [m²].
    inner: f32,
}

impl Outlook {
    /// True if the point `at` that has this outlook surely sees `other`.
    #[inline]
    pub fn holds(&self, at: SurfacePoint, other: Vec3) -> bool {
        let way = other - at.0;
        if way.dot(at.1).abs() > self.height {
            return false;
        }
        if way.length_squared() <= self.inner {
            return true;
        }
        let local = Frame::new(at.1).to_local(way);
        let turns = local.y.atan2(local.x) / TAU;
        let k = ((turns - turns.floor()) * SPOKES as f32) as usize % SPOKES;
        let [[ax, ay], [bx, by]] = self.chord(k);
        self.is_clear[k] && (bx - ax) * (local.y - ay) >= (by - ay) * (local.x - ax)
    }

    /// The ends of a look and of the next one, beside the point.
    fn chord(&self, k: usize) -> [[f32; 2]; 2] {
        [k, (k + 1) % SPOKES].map(|k| {
            let (sin, cos) = spoke(k).sin_cos();
            [self.lengths[k] * cos, self.lengths[k] * sin]
        })
    }
}

/// Angle of a look [rad].
fn spoke(k: usize) -> f32 {
    k as f32 * (TAU / SPOKES as f32)
}

/// Height at which points of a disk look at each other where the face is flat [m].
fn lift(world: &World, radius: f32) -> f32 {
    (LIFT * radius).max(LEAST_LIFT * world.bounds().diagonal())
}

/// True if nothing stands between two surface points of a disk, as they look at each other from just above.
fn sees(world: &World, a: SurfacePoint, b: SurfacePoint, radius: f32) -> bool {
    let lift = lift(world, radius) + LIFT_BY_BEND * a.0.distance(b.0) * a.1.distance(b.1);
    !world.transmittance(&Ray::between(a.0 + a.1 * lift, b.0 + b.1 * lift)).is_black()
}

/// Distances over the radius of points that are uniform in a disk.
pub(super) fn even([u, _, _]: [f32; 3]) -> f32 {
    u.sqrt()
}

/// The same of points as dense as a cone over the disk is high: the middle one of three uniform numbers.
pub(super) fn as_cone([a, b, c]: [f32; 3]) -> f32 {
    a.max(b).min(a.min(b).max(c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::AccelKind;
    use crate::geometry::tessellate;
    use crate::material::{Material, MaterialId, Surface, Texture};
    use crate::math::{DAffine3, DMat3, DVec2, DVec3, Rgb};
    use crate::scene::camera::FovAxis;
    use crate::scene::{Camera, FilmSettings, Scene, SceneSource, ShapeSource, SurfaceSource};

    /// A floor, and a fence on it that begins at the origin and goes on beyond every disk.
    fn fenced() -> World {
        let camera = Camera {
            to_scene: DAffine3::IDENTITY,
            tan_half_fov: 1.0,
            fov_axis: FovAxis::X,
            principal_point: DVec2::ZERO,
            near_clip: 1e-4,
            far_clip: 1e7,
        };
        let quad = |id: &str, middle: DVec3, e1: DVec3, e2: DVec3| {
            let to_world = DAffine3 { matrix3: DMat3::from_cols(e1, e2, e1.cross(e2).normalize()), translation: middle };
            let surface = SurfaceSource::Triangles(tessellate::rectangle(&to_world));
            ShapeSource { id: id.to_owned(), surface, material: MaterialId(0), emission: Texture::Constant(Rgb::BLACK) }
        };
        let source = SceneSource {
            name: "test".to_owned(),
            camera,
            film: FilmSettings { width: 8, height: 8, sample_count: 1, max_depth: None },
            shapes: vec![
                quad("floor", DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0),
                quad("fence", DVec3::X * 2.0, DVec3::X * 2.0, DVec3::Z),
            ],
            materials: vec![Surface {
                name: "test".to_owned(),
                material: Material::Diffuse { reflectance: Texture::Constant(Rgb::WHITE) },
                two_sided: true,
                relief: None,
            }],
            lights: Vec::new(),
            environment: None,
            warnings: Vec::new(),
        };
        World::new(Scene::new(source).expect("a valid scene"), AccelKind::default()).expect("a world")
    }

    /// What an outlook holds is seen, also where a fence comes in between two looks; and it holds most of what is seen.
    #[test]
    fn an_outlook_holds_what_is_seen() {
        let world = fenced();
        let number = |k: u64| (mix(k) >> 40) as f32 * 2.0_f32.powi(-24);
        let radius = 0.5;
        let (mut held, mut seen, mut between) = (0, 0, 0);
        for i in 0..400 {
            let point = Vec3::new(0.3 * number(3 * i) - 0.4, 0.3 * number(3 * i + 1) - 0.15, 0.0);
            let face = Face { world: &world, at: (point, Vec3::Z), height: 0.1, least_cosine: 0.9 };
            let outlook = face.outlook(radius);
            between += i32::from(outlook.lengths.iter().all(|&l| l == SPOKE * radius) && outlook.is_clear.contains(&false));
            for k in 0..100 {
                let (sin, cos) = (TAU * number(1_000_000 + 2 * (100 * i + k))).sin_cos();
                let way = radius * number(1_000_001 + 2 * (100 * i + k)).sqrt();
                let other = point + Vec3::new(way * cos, way * sin, 0.0);
                let (holds, sees) = (outlook.holds(face.at, other), face.sees((other, Vec3::Z), radius));
                assert!(sees || !holds, "{other} is hidden from {point}");
                held += i32::from(holds);
                seen += i32::from(sees);
            }
        }
        assert!(held * 10 > seen * 8 && seen < 39_800, "{held} of {seen} held");
        assert!(between > 0, "the fence comes in between two looks {between} times");
    }
}
