//! A scene made ready for rays: primitives, the tree over them, and what is known at a hit.

pub mod convex;
pub mod departure;
pub mod flat;
pub mod illumination;
pub mod interaction;
pub mod lamps;
pub mod partition;
pub mod plane_mirrors;
pub mod regions;
pub mod shading;
pub mod sight;
mod sky_guide;
pub mod stages;
mod tangent;
pub mod walk;

pub use departure::{Departure, Departures};
pub use illumination::{DirectSampling, ShadowRay};
pub use interaction::SurfaceInteraction;
pub use partition::EmitterPartition;
pub use shading::Shading;
pub use sight::Sight;
pub use stages::{All, Stages};

pub use crate::accel::KnownOccluders;
use crate::accel::{self, Accel, AccelError, AccelKind};
use crate::geometry::soup::Primitive;
use crate::geometry::{Bounds, Hit, Ray, Soup, triangle};
use crate::light::LightTree;
use crate::math::{Vec2, Vec3};
use crate::scene::{Scene, Shape, ShapeSurface};
use convex::Hull;
use flat::Flat;
use sky_guide::SkyGuide;
use stages::Needs;
use std::sync::Arc;

/// Relative bound on the rounding of a hit point on a sphere, in units of the largest coordinate: eight ulps.
const POINT_ERROR: f32 = 4.0 * f32::EPSILON;

/// Up to this many lights are weighed one by one (24 ns each), which picks better than the tree (0.4 µs a pick).
const FEW_LIGHTS: usize = 32;

/// Normals of more triangles are found at each hit: they would take memory that the tree's neighbourhood needs.
const MOST_FACES: usize = 1 << 20;

/// Scene, primitives and tree. Immutable; shared by all threads.
pub struct World {
    scene: Scene,
    soup: Arc<Soup>,
    accel: Box<dyn Accel>,
    partition: EmitterPartition,
    shape_of_primitive: Vec<u32>,
    /// First primitive of each shape; triangles of a mesh and the one sphere of a sphere are consecutive.
    first_primitive: Vec<u32>,
    /// Of each triangle, if they are not too many: unit normal by the order of its corners, and bound on the rounding of a point.
    faces: Vec<(Vec3, f32)>,
    bounds: Bounds,
    shape_bounds: Vec<Bounds>,
    /// True if some surface lets light through without bending it.
    has_thin: bool,
    /// Per material: true if it matters how the texture coordinates lie on the surface.
    oriented: Vec<bool>,
    /// Picks among many lights; few are weighed one by one.
    light_tree: Option<LightTree>,
    /// What is seen of the surroundings from where.
    sky_guide: Option<SkyGuide>,
    /// What is known of triangles beforehand, if all are plain.
    flat: Option<Flat>,
    /// The walls of a convex body, if that is all there is.
    hull: Option<Hull>,
    /// The stages that rays are followed with.
    needs: Needs,
    is_grey: bool,
    idle: Option<Idle>,
}

/// Sides of triangles whose light cannot count in the picture.
#[derive(Debug)]
struct Idle {
    /// By triangle: front, back.
    sides: Vec<[bool; 2]>,
    /// True if pass one does nothing for them.
    is_left_out: bool,
}

impl World {
    /// Flattens the scene and builds the tree.
    ///
    /// # Errors
    /// If the engine is not in this build or cannot be set up.
    pub fn new(scene: Scene, kind: AccelKind) -> Result<World, AccelError> {
        let partition = EmitterPartition::new(&scene, partition::LARGE_SHARE);
        Self::with_partition(scene, kind, partition)
    }

    /// As [`World::new`] with the emitters divided as the caller says; the picture's mean does not depend on it.
    ///
    /// # Errors
    /// As [`World::new`].
    pub fn with_partition(scene: Scene, kind: AccelKind, partition: EmitterPartition) -> Result<World, AccelError> {
        let mut soup = Soup::default();
        let mut shape_of_primitive = Vec::new();
        let mut first_primitive = vec![0; scene.shapes.len()];
        for (i, shape) in scene.shapes.iter().enumerate() {
            if let ShapeSurface::Mesh(mesh) = &shape.surface {
                let base = soup.vertices.len() as u32;
                first_primitive[i] = soup.triangles.len() as u32;
                soup.vertices.extend_from_slice(&mesh.positions);
                soup.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + base)));
                shape_of_primitive.resize(soup.triangles.len(), i as u32);
            }
        }
        for (i, shape) in scene.shapes.iter().enumerate() {
            if let ShapeSurface::Sphere(sphere) = shape.surface {
                first_primitive[i] = shape_of_primitive.len() as u32;
                soup.spheres.push(sphere);
                shape_of_primitive.push(i as u32);
            }
        }
        let bounds = soup.bounds();
        let mut shape_bounds = vec![Bounds::EMPTY; scene.shapes.len()];
        for (primitive, &shape) in shape_of_primitive.iter().enumerate() {
            let shape = &mut shape_bounds[shape as usize];
            *shape = shape.union(soup.bounds_of(primitive as u32));
        }
        let has_thin = scene.shapes.iter().any(|s| scene.material_of(s).material.passes_straight());
        let oriented = scene.materials.iter().map(|m| m.relief.is_some() || m.material.is_anisotropic()).collect();
        let lights = partition.shadow_lights();
        let light_tree = (lights.len() > FEW_LIGHTS).then(|| LightTree::new(&scene.lights, lights));
        let flat = Flat::of(&scene, &soup, &shape_of_primitive);
        let hull = Hull::of(&soup, f64::from(bounds.diagonal()));
        let face = |i: usize| {
            let [a, b, c] = soup.corners(i);
            (triangle::normal(a, b, c), triangle::leaving_error(a, b, c))
        };
        let faces = if soup.triangles.len() > MOST_FACES { Vec::new() } else { (0..soup.triangles.len()).map(face).collect() };
        let soup = Arc::new(soup);
        let accel = accel::build(Arc::clone(&soup), kind)?;
        let mut world = World {
            scene,
            soup,
            accel,
            partition,
            shape_of_primitive,
            first_primitive,
            faces,
            bounds,
            shape_bounds,
            has_thin,
            oriented,
            light_tree,
            sky_guide: None,
            flat,
            hull,
            needs: Needs::ALL,
            is_grey: false,
            idle: None,
        };
        world.sky_guide = SkyGuide::measure(&world);
        Ok(world)
    }

    /// Leaves out the stages that a plan found to be of no effect in this scene.
    pub fn leave_out(&mut self, needs: Needs, is_grey: bool) {
        (self.needs, self.is_grey) = (needs, is_grey);
    }

    /// Tells pass one for which sides of triangles light cannot count (front, back), and whether it is to leave them out. Those that it does not
    /// leave out decide nothing for others.
    pub fn leave_idle(&mut self, sides: Vec<[bool; 2]>, is_left_out: bool) {
        self.idle = Some(Idle { sides, is_left_out });
    }

    /// True if a plan found some sides of triangles whose light cannot count.
    pub fn has_idle(&self) -> bool {
        self.idle.is_some()
    }

    /// True if light on that side of a primitive cannot count in the picture, by a plan.
    pub fn is_idle(&self, primitive: u32, front: bool) -> bool {
        let sides = self.idle.as_ref().and_then(|idle| idle.sides.get(primitive as usize));
        sides.is_some_and(|sides| sides[usize::from(!front)])
    }

    /// True if pass one does nothing where light cannot count.
    pub fn leaves_idle(&self) -> bool {
        self.idle.as_ref().is_some_and(|idle| idle.is_left_out)
    }

    /// True if a plan found red, green and blue to be equal in all that is reflected and emitted.
    pub fn is_grey(&self) -> bool {
        self.is_grey
    }

    /// The stages that rays are followed with.
    pub fn needs(&self) -> Needs {
        self.needs
    }

    /// True if every surface is flat, not smoothed, and reflects diffusely and alike all over.
    pub fn is_plain(&self) -> bool {
        self.flat.is_some()
    }

    /// Looks for no light any more: there is none.
    pub fn forget_lights(&mut self) {
        self.partition = EmitterPartition::of_none(self.scene.shapes.len());
        (self.light_tree, self.sky_guide) = (None, None);
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The primitives.
    pub fn soup(&self) -> &Soup {
        &self.soup
    }

    /// Which emitters are found by shadow rays and which by gather rays.
    pub fn partition(&self) -> &EmitterPartition {
        &self.partition
    }

    /// Box of all primitives.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Box of one shape.
    pub fn shape_bounds(&self, shape: usize) -> Bounds {
        self.shape_bounds[shape]
    }

    /// Index of the shape that primitive `index` belongs to.
    #[inline]
    pub fn shape_index(&self, primitive: u32) -> usize {
        self.shape_of_primitive[primitive as usize] as usize
    }

    /// The shape that primitive `index` belongs to.
    #[inline]
    pub fn shape(&self, primitive: u32) -> &Shape {
        &self.scene.shapes[self.shape_index(primitive)]
    }

    /// First primitive of a shape; its others follow.
    pub fn first_primitive(&self, shape: usize) -> u32 {
        self.first_primitive[shape]
    }

    /// Nearest surface along `ray`.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<SurfaceInteraction> {
        self.intersect_by::<All>(ray)
    }

    /// As [`Self::intersect`], by code that holds the stages `K`.
    #[inline]
    pub fn intersect_by<K: Stages>(&self, ray: &Ray) -> Option<SurfaceInteraction> {
        if K::PLAIN {
            return self.meet_flat::<K>(ray).map(|hit| self.flat_interaction(&hit));
        }
        self.accel.intersect(ray).map(|hit| self.interaction::<K>(ray, hit))
    }

    /// True if something lies between the two ends of `ray`.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.accel.occluded(ray)
    }

    /// The same for rays that are much alike, one after the other.
    #[inline]
    pub fn occluded_as_known(&self, ray: &Ray, known: &mut KnownOccluders) -> bool {
        self.accel.occluded_as_known(ray, known)
    }

    /// The surface at a hit, found again from ray and primitive alone, so that every engine gives the same.
    #[inline]
    fn interaction<K: Stages>(&self, ray: &Ray, hit: Hit) -> SurfaceInteraction {
        match self.soup.primitive(hit.primitive) {
            Primitive::Triangle([a, b, c]) => {
                let (weights, t) = triangle::locate(ray, [a, b, c]);
                let mut si = self.on_triangle_by::<K>(hit.primitive, weights, -ray.direction);
                (si.t, si.end) = (t, hit.t);
                si
            }
            Primitive::Sphere(sphere) => {
                let n = sphere.normal(ray.at(hit.t));
                self.on_sphere(hit.primitive, n, -ray.direction, hit.t)
            }
        }
    }

    /// The surface point of triangle `primitive` at barycentric `weights` of its second and third vertex, seen from `wo`.
    #[inline]
    pub fn on_triangle(&self, primitive: u32, weights: (f64, f64), wo: Vec3) -> SurfaceInteraction {
        self.on_triangle_by::<All>(primitive, weights, wo)
    }

    /// As [`Self::on_triangle`], by code that holds the stages `K`.
    #[inline]
    pub fn on_triangle_by<K: Stages>(&self, primitive: u32, weights: (f64, f64), wo: Vec3) -> SurfaceInteraction {
        let shape = self.shape_index(primitive);
        let [a, b, c] = self.soup.corners(primitive as usize);
        let (u, v) = weights;
        let w = 1.0 - u - v;
        let mix = |a: Vec3, b: Vec3, c: Vec3| a.as_dvec3() * w + b.as_dvec3() * u + c.as_dvec3() * v;
        let known = self.faces.get(primitive as usize);
        let (mut ng, error) = known.copied().unwrap_or_else(|| (triangle::normal(a, b, c), triangle::leaving_error(a, b, c)));
        let (mut ns, mut uv) = (ng, Vec2::new(u as f32, v as f32));
        if let ShapeSurface::Mesh(mesh) = &self.scene.shapes[shape].surface {
            let [i, j, k] = mesh.triangles[(primitive - self.first_primitive[shape]) as usize].map(|i| i as usize);
            if K::CURVED && !mesh.normals.is_empty() {
                let n = mix(mesh.normals[i], mesh.normals[j], mesh.normals[k]).as_vec3().normalize_or_zero();
                if n != Vec3::ZERO {
                    ns = n;
                    // Vertex normals say which side is the front, whatever the winding.
                    if ng.dot(ns) < 0.0 {
                        ng = -ng;
                    }
                }
            }
            if K::UV && !mesh.uvs.is_empty() {
                let [p, q, r] = [i, j, k].map(|i| mesh.uvs[i].as_dvec2());
                uv = (p * w + q * u + r * v).as_vec2();
            }
        }
        SurfaceInteraction::new(mix(a, b, c).as_vec3(), Vec3::splat(error), ng, ns, uv, weights, shape as u32, primitive, wo)
    }

    /// The point of sphere `primitive` with outward unit normal `n`, seen from `wo`; `t` is the ray parameter.
    #[inline]
    pub fn on_sphere(&self, primitive: u32, n: Vec3, wo: Vec3, t: f32) -> SurfaceInteraction {
        let sphere = self.soup.spheres[primitive as usize - self.soup.triangles.len()];
        let point = (sphere.center.as_dvec3() + n.as_dvec3() * f64::from(sphere.radius)).as_vec3();
        let error = Vec3::splat((sphere.center.abs().max_element() + sphere.radius) * POINT_ERROR);
        let uv = sphere.uv(n);
        let place = (f64::from(uv.x), f64::from(n.z));
        let shape = self.shape_index(primitive) as u32;
        let mut si = SurfaceInteraction::new(point, error, n, n, uv, place, shape, primitive, wo);
        (si.t, si.end) = (t, t);
        si
    }
}
