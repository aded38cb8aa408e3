//! Triangles: area, normal, and the watertight ray test that every acceleration structure shares.

use super::Ray;
use crate::math::{DVec3, Vec3};

/// Area of a triangle in f64, and twice the area vector it comes from.
#[inline]
pub fn area_vector(a: Vec3, b: Vec3, c: Vec3) -> DVec3 {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    0.5 * (b - a).cross(c - a)
}

/// Unit geometric normal, by the order of the vertices; zero for a degenerate triangle.
#[inline]
pub fn normal(a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    area_vector(a, b, c).normalize_or_zero().as_vec3()
}

/// How far a ray must start off a triangle, per coordinate, so that the watertight test does not find it again.
///
/// Two parts. Eight ulps of the largest coordinate cover the rounding of the point, of vertex minus origin, and of the shear, which
/// mixes the axes: on a wall at x = 0.025 in a room of 2 m a bound per axis was too small. And the edge functions of the test round
/// by ulps of the longest edge L squared while they sum to the area, so the distance found is off by about 0.1 ulp L (L/h) on a
/// triangle of height h (measured; five times that is taken, and slivers beyond L/h = 2000 no further).
#[inline]
pub fn leaving_error(a: Vec3, b: Vec3, c: Vec3) -> f32 {
    let coordinate = a.abs().max(b.abs()).max(c.abs()).max_element();
    let longest2 = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    let doubled_area = (b - a).cross(c - a).length();
    let slenderness = if doubled_area > 0.0 { (longest2 / doubled_area).min(2000.0) } else { 2000.0 };
    f32::EPSILON * (4.0 * coordinate + 0.5 * longest2.sqrt() * slenderness)
}

/// A ray made ready for the watertight triangle test: its largest direction axis and the shear that turns it to +z.
///
/// [Woop13, section 3]. The same vertex is always sheared to the same rounded point, whatever the triangle, so no ray slips
/// between triangles that share it. For that reason the products below must not be contracted into fused multiply-adds.
#[derive(Debug, Clone, Copy)]
pub struct ShearedRay {
    /// Start point.
    pub origin: Vec3,
    /// Axis of the largest direction component, and the two others in right-handed order.
    pub axes: [usize; 3],
    /// Shear along x and y, and scale along z.
    pub shear: [f32; 3],
}

impl ShearedRay {
    /// Prepares `ray`, whose direction must not be zero.
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        Self::with_inverse(ray, ray.direction.recip())
    }

    /// The same, with one over each direction component.
    #[inline(always)]
    pub fn with_inverse(ray: &Ray, inverse: Vec3) -> Self {
        let d = ray.direction;
        let z = Self::main_axis(d);
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        // Keep the winding when the main axis is negative.
        if d[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        let inverse = inverse[z];
        Self { origin: ray.origin, axes: [x, y, z], shear: [d[x] * inverse, d[y] * inverse, inverse] }
    }

    /// Axis of the largest component of a direction.
    #[inline(always)]
    pub fn main_axis(direction: Vec3) -> usize {
        let abs = direction.abs();
        if abs.x > abs.y && abs.x > abs.z {
            0
        } else if abs.y > abs.z {
            1
        } else {
            2
        }
    }

    #[inline]
    fn project(&self, vertex: Vec3) -> [f32; 3] {
        let v = vertex - self.origin;
        let [x, y, z] = self.axes;
        [v[x] - self.shear[0] * v[z], v[y] - self.shear[1] * v[z], self.shear[2] * v[z]]
    }

    /// Ray parameter at which the ray meets the triangle, in (`t_min`, `t_max`). Both sides count; edges and vertices count.
    ///
    /// Where an edge function rounds to zero its sign is found in f64, where the products are exact. Without that, a triangle
    /// smaller than the rounding of its coordinates could count as met by a ray that passes anywhere: all three values are then
    /// zero or noise. A box test around every triangle would hide this; packed leaves have none.
    #[inline]
    pub fn intersect(&self, a: Vec3, b: Vec3, c: Vec3, t_min: f32, t_max: f32) -> Option<f32> {
        let [a, b, c] = [a, b, c].map(|corner| self.project(corner));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let t = if u == 0.0 || v == 0.0 || w == 0.0 {
            meet_by_exact_signs(a, b, c)?
        } else {
            (u * a[2] + v * b[2] + w * c[2]) / (u + v + w)
        };
        (t > t_min && t < t_max).then_some(t)
    }
}

/// The test in f64 on the same rounded corners. The product of two f32 is exact in f64, so each sign is right.
#[cold]
fn meet_by_exact_signs(a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> Option<f32> {
    let [a, b, c] = [a, b, c].map(|p| p.map(f64::from));
    let u = c[0] * b[1] - c[1] * b[0];
    let v = a[0] * c[1] - a[1] * c[0];
    let w = b[0] * a[1] - b[1] * a[0];
    let det = u + v + w;
    // Zero: the triangle is seen edge-on or has no area; its neighbours take the hit.
    if (u.min(v).min(w) < 0.0 && u.max(v).max(w) > 0.0) || det == 0.0 {
        return None;
    }
    Some(((u * a[2] + v * b[2] + w * c[2]) / det) as f32)
}

/// A corner of a triangle and the edges from there, in f64.
#[derive(Debug, Clone, Copy)]
pub struct Edges {
    corner: DVec3,
    edges: [DVec3; 2],
    /// Product of the second edge with the first.
    normal: DVec3,
}

impl Edges {
    /// Of a triangle by its corners.
    #[inline]
    pub fn new([a, b, c]: [Vec3; 3]) -> Self {
        let corner = a.as_dvec3();
        let edges = [b, c].map(|p| p.as_dvec3() - corner);
        Self { corner, edges, normal: edges[1].cross(edges[0]) }
    }

    /// What all rays from a point share.
    #[inline(always)]
    pub fn seen_from(&self, origin: Vec3) -> Perspective {
        let (o, [e1, e2]) = (origin.as_dvec3() - self.corner, self.edges);
        Perspective { normal: self.normal, second: e2.cross(o), third: o.cross(e1), height: -o.dot(self.normal) }
    }
}

/// A triangle as seen from a point: what [Moller97] finds for each ray, with the products turned round so that only those
/// with the direction are left to the ray. All in f64.
#[derive(Debug, Clone, Copy)]
pub struct Perspective {
    /// Its product with a direction is the determinant.
    pub normal: DVec3,
    /// Its product with a direction, over the determinant, is the barycentric weight of the second corner.
    pub second: DVec3,
    /// The same of the third corner.
    pub third: DVec3,
    /// Over the determinant, the ray parameter.
    pub height: f64,
}

impl Perspective {
    /// The determinant, and the weights of the second and third corner times it.
    #[inline(always)]
    pub fn products(&self, direction: Vec3) -> [f64; 3] {
        let d = direction.as_dvec3();
        [self.normal, self.second, self.third].map(|v| d.dot(v))
    }
}

/// Where a ray meets a triangle that it is known to meet, in f64: barycentric weights of the second and third corner, and
/// the ray parameter.
///
/// Engines round t in their own ways; this one is the same whichever found the triangle. Weights lie inside the triangle,
/// off its edges by as much as rays leave it (see [`leaving_error`]): beside a wall that stands on the edge, a ray that
/// starts there starts on the inside of both.
#[inline]
pub fn locate(ray: &Ray, corners: [Vec3; 3]) -> ((f64, f64), f32) {
    let seen = Edges::new(corners).seen_from(ray.origin);
    let [determinant, u, v] = seen.products(ray.direction);
    let least = CLEAR_SINE * CLEAR_SINE * seen.normal.length_squared() * ray.direction.as_dvec3().length_squared();
    if determinant * determinant > least {
        let weights = (u / determinant, v / determinant);
        if weights.0.min(weights.1).min(1.0 - weights.0 - weights.1) >= EDGE {
            return (weights, (seen.height / determinant) as f32);
        }
    }
    locate_near_edge(ray, corners, [determinant, u, v])
}

/// Rays within this sine of a triangle's plane find the parameter by the point.
const CLEAR_SINE: f64 = 1e-6;

/// How far points keep off edges, in multiples of the bound by which rays leave the plane: enough for walls at 15 degrees
/// to each other.
const OFF_EDGES: f64 = 8.0;

/// Points whose weights are all above this are not moved off the edges.
pub const EDGE: f64 = 1e-4;

/// The same where rounding might take the point out of the triangle, or beyond a wall beside it.
#[cold]
fn locate_near_edge(ray: &Ray, corners: [Vec3; 3], [determinant, u, v]: [f64; 3]) -> ((f64, f64), f32) {
    let inside = |x: f64| (x / determinant).clamp(0.0, 1.0);
    let (u, v) = if determinant == 0.0 { (1.0 / 3.0, 1.0 / 3.0) } else { (inside(u), inside(v)) };
    let excess = (u + v).max(1.0);
    let mut weights = [1.0 - (u + v) / excess, u / excess, v / excess].map(|w| w.max(0.0));
    let [a, b, c] = corners;
    let doubled_area = 2.0 * area_vector(a, b, c).length();
    let error = f64::from(leaving_error(a, b, c));
    // Of thin slivers no more than what shows nowhere.
    let margin = |opposite: Vec3| (OFF_EDGES * error * opposite.as_dvec3().length() / doubled_area).min(EDGE);
    for (weight, opposite) in weights.iter_mut().zip([c - b, a - c, b - a]) {
        *weight = weight.max(margin(opposite));
    }
    let sum: f64 = weights.iter().sum();
    let weights = (weights[1] / sum, weights[2] / sum);
    (weights, parameter(ray, corners, weights))
}

/// Parameter of `ray` at the point of a triangle with barycentric `weights` of the second and third vertex, in f64.
fn parameter(ray: &Ray, [a, b, c]: [Vec3; 3], weights: (f64, f64)) -> f32 {
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let [a, b, c] = [a, b, c].map(|corner| corner.as_dvec3() - origin);
    let point = a + (b - a) * weights.0 + (c - a) * weights.1;
    (point.dot(direction) / direction.length_squared()) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Vec3 = Vec3::new(0.0, 0.0, 0.0);
    const B: Vec3 = Vec3::new(1.0, 0.0, 0.0);
    const C: Vec3 = Vec3::new(0.0, 1.0, 0.0);

    fn shoot(origin: Vec3, direction: Vec3) -> Option<f32> {
        ShearedRay::new(&Ray::new(origin, direction)).intersect(A, B, C, 0.0, f32::INFINITY)
    }

    #[test]
    fn both_sides_edges_and_vertices_are_hit() {
        for (x, y) in [(0.25, 0.25), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0)] {
            assert_eq!(shoot(Vec3::new(x, y, 2.0), -Vec3::Z), Some(2.0), "from above at {x}, {y}");
            assert_eq!(shoot(Vec3::new(x, y, -2.0), Vec3::Z), Some(2.0), "from below at {x}, {y}");
        }
    }

    #[test]
    fn misses_and_edge_on_rays_return_nothing() {
        assert_eq!(shoot(Vec3::new(0.6, 0.6, 1.0), -Vec3::Z), None);
        assert_eq!(shoot(Vec3::new(0.25, 0.25, 1.0), Vec3::Z), None);
        assert_eq!(shoot(Vec3::new(-1.0, 0.25, 0.0), Vec3::X), None);
    }

    #[test]
    fn barycentric_weights_place_the_hit() {
        let ray = Ray::new(Vec3::new(0.2, 0.3, 1.0), -Vec3::Z);
        let ((u, v), t) = locate(&Ray { direction: -4.0 * Vec3::Z, ..ray }, [A, B, C]);
        assert!((u - 0.2).abs() < 1e-7 && (v - 0.3).abs() < 1e-7 && t == 0.25, "{u}, {v}, {t}");
    }

    /// Points at edges and corners, and of rays along the triangle, lie inside: off the edges by as much as rays leave
    /// the triangle.
    #[test]
    fn points_keep_off_the_edges() {
        let least = f64::from(leaving_error(A, B, C));
        for (x, y) in [(0.0, 0.5), (0.5, 0.0), (0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1e-7, 0.3), (0.7, 0.3 + 1e-7)] {
            let ((u, v), t) = locate(&Ray::new(Vec3::new(x, y, 1.0), -Vec3::Z), [A, B, C]);
            let to_edges = u.min(v).min((1.0 - u - v) / 2.0_f64.sqrt());
            assert!(to_edges >= least && t == 1.0, "{x} {y}: {u} {v} {t}");
            assert!((u - f64::from(x)).abs() < 2e-5 && (v - f64::from(y)).abs() < 2e-5, "{x} {y}: {u} {v}");
        }
        let ((u, v), t) = locate(&Ray::new(Vec3::new(-1.0, 0.25, 0.0), Vec3::X), [A, B, C]);
        assert!(u.min(v).min(1.0 - u - v) >= least && (1.0..2.0).contains(&t), "edge-on: {u} {v} {t}");
    }
}
