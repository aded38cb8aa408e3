//! What is known about a surface where a ray meets it.

use crate::geometry::{Ray, offset_origin};
use crate::math::{Frame, Vec2, Vec3};

/// A point of a surface as seen from one side.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceInteraction {
    /// The point.
    pub point: Vec3,
    /// Bound on its rounding, per coordinate.
    pub error: Vec3,
    /// Geometric unit normal on the viewer's side.
    pub ng: Vec3,
    /// Shading unit normal on the viewer's side; never more than 90 degrees from `ng`.
    pub ns: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Where on the primitive: barycentric weights of the second and third vertex of a triangle; (phi/2pi, cos theta) of a sphere.
    pub place: (f64, f64),
    /// Index of the shape.
    pub shape: u32,
    /// Index of the primitive.
    pub primitive: u32,
    /// True if the viewer is on the side to which the surface's own normal points.
    pub front: bool,
    /// Unit direction to the viewer.
    pub wo: Vec3,
    /// Ray parameter, found again from ray and primitive.
    pub t: f32,
    /// Ray parameter at which the engine met the primitive: the same ray goes on behind it with this as its open lower end.
    pub end: f32,
}

impl SurfaceInteraction {
    /// Turns the normals to the side of the viewer at `wo` (any length).
    #[expect(clippy::too_many_arguments, reason = "one call site per kind of primitive, each filling every field")]
    #[inline]
    pub(super) fn new(
        point: Vec3,
        error: Vec3,
        ng: Vec3,
        ns: Vec3,
        uv: Vec2,
        place: (f64, f64),
        shape: u32,
        primitive: u32,
        wo: Vec3,
    ) -> Self {
        let front = wo.dot(ng) >= 0.0;
        let (ng, ns) = if front { (ng, ns) } else { (-ng, -ns) };
        Self { point, error, ng, ns, uv, place, shape, primitive, front, wo: wo.normalize(), t: 0.0, end: 0.0 }
    }

    /// The same point as seen from the unit direction `wo`.
    #[inline]
    pub fn seen_from(&self, wo: Vec3) -> Self {
        let side = if wo.dot(self.ng) >= 0.0 { 1.0 } else { -1.0 };
        Self { ng: self.ng * side, ns: self.ns * side, front: self.front == (side > 0.0), wo, ..*self }
    }

    /// The point moved off the surface, towards `direction`: where a ray to it may end.
    #[inline]
    pub fn moved_towards(&self, direction: Vec3) -> Vec3 {
        offset_origin(self.point, self.error, self.ng, direction)
    }

    /// A ray that leaves the surface along `direction`, free of self-intersection.
    #[inline]
    pub fn spawn(&self, direction: Vec3) -> Ray {
        Ray::new(offset_origin(self.point, self.error, self.ng, direction), direction)
    }

    /// A ray that ends just before `target`.
    #[inline]
    pub fn spawn_to(&self, target: Vec3) -> Ray {
        Ray::between(offset_origin(self.point, self.error, self.ng, target - self.point), target)
    }

    /// Frame of the material: around the shading normal, unless the viewer is below it (then the geometric one).
    #[inline]
    pub fn shading_frame(&self) -> Frame {
        Frame::new(self.shading_normal(self.wo))
    }

    /// Third axis of [`Self::shading_frame`] for a viewer on this side along the unit vector `wo`.
    #[inline]
    pub fn shading_normal(&self, wo: Vec3) -> Vec3 {
        if wo.dot(self.ns) > 1e-4 { self.ns } else { self.ng }
    }
}
