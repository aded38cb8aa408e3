//! Rooms in which nothing can stand between two surfaces.

pub mod bundle;

use super::World;
use crate::geometry::triangle::Edges;
use crate::geometry::{Ray, Soup};
use crate::light::Light;
use crate::math::{DVec2, DVec3, Vec3, Vec4};

/// Planarity and position are judged up to this share of the diagonal: several ulps of a coordinate.
const ROUNDING: f64 = 1e-6;
/// Rooms of more triangles are not looked at.
const MOST_TRIANGLES: usize = 2048;
/// Rooms of more walls leave it to the tree which one a ray meets.
const MOST_WALLS: usize = 8;
/// So do rays within this sine of the plane of a wall that they start near or meet, along which rounding grows,
const GRAZING: f32 = 0.01;
/// near being this share of the diagonal,
const NEAR: f64 = 1e-3;
/// hits whose barycentric weights are less than this from a border, where the engine's rounding decides,
const BORDER: f64 = 1e-3;
/// and rooms with triangles lower than this share of the diagonal, where that border would be too narrow.
const LOWEST: f64 = 0.01;

/// The walls of a body that is convex.
#[derive(Debug)]
pub(super) struct Hull {
    facets: Vec<Facet>,
    rounding: f64,
    walls: Option<Walls>,
}

/// Few walls, side by side, so that a ray is tested against all at once. The first fills the places that are left.
#[derive(Debug)]
struct Walls {
    /// Components of the unit normals to the inside.
    normal: [[Vec4; 3]; 2],
    /// Where on its normal each plane lies.
    offset: [Vec4; 2],
    /// Triangles of each.
    triangles: [Vec<Candidate>; MOST_WALLS],
    /// Number of walls.
    n: usize,
    /// Heights below this are no more than rounding.
    rounding: Vec4,
    /// Heights below this are near.
    near: Vec4,
}

/// A triangle of a wall.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    primitive: u32,
    /// Barycentric weights of the second and third corner as affine functions of a point, roughly.
    weights: [(Vec3, f32); 2],
    edges: Edges,
    /// True if the triangle's normal points to the inside.
    is_front: bool,
}

/// What a point inside a convex room knows of its walls: rays from there need not find it out one by one.
#[derive(Debug, Clone, Copy)]
pub struct Outlook {
    /// One over the height above each wall; 0 for walls that it stands on.
    inverse: [Vec4; 2],
    /// Least sine to each plane of a ray that rounding cannot lead astray.
    least: [Vec4; 2],
}

/// Triangles in one plane.
#[derive(Debug)]
struct Facet {
    /// Unit normal, to the inside.
    normal: DVec3,
    origin: DVec3,
    corners: Vec<DVec3>,
    triangles: Vec<u32>,
    area: f64,
}

impl World {
    /// True if every surface lies on the hull of a convex body, no two on one another, and every light on that hull or inside: then no
    /// surface hides a light from another. Bounds only: a body too large to look at is not convex.
    pub fn is_convex_room(&self) -> bool {
        let Some(hull) = &self.hull else { return false };
        let inside = |p: Vec3| hull.facets.iter().all(|f| (p.as_dvec3() - f.origin).dot(f.normal) > hull.rounding);
        self.scene().lights.iter().all(|light| match light {
            Light::Area(_) => true,
            Light::Point(light) => inside(light.position),
            Light::Spot(light) => inside(light.position),
            Light::Directional(_) | Light::Environment(_) => false,
        })
    }
}

impl Hull {
    /// The hull, if all triangles lie on it and none on another.
    pub fn of(soup: &Soup, diagonal: f64) -> Option<Self> {
        if !soup.spheres.is_empty() || soup.triangles.is_empty() || soup.triangles.len() > MOST_TRIANGLES {
            return None;
        }
        let rounding = ROUNDING * diagonal;
        let at = |i: u32| soup.vertices[i as usize].as_dvec3();
        let points: Vec<DVec3> = soup.triangles.iter().flatten().map(|i| at(*i)).collect();
        let mut facets: Vec<Facet> = Vec::new();
        let mut lowest = f64::INFINITY;
        for (index, triangle) in (0..).zip(&soup.triangles) {
            let [a, b, c] = triangle.map(at);
            let cross = (b - a).cross(c - a);
            let area = 0.5 * cross.length();
            let longest = (b - a).length().max((c - b).length()).max((a - c).length());
            lowest = lowest.min(2.0 * area / longest);
            let mut normal = cross.try_normalize()?;
            let lies_in = |f: &Facet| {
                f.normal.cross(normal).length() < ROUNDING
                    && [a, b, c].iter().all(|p| (*p - f.origin).dot(f.normal).abs() <= rounding)
            };
            if let Some(facet) = facets.iter_mut().find(|f| lies_in(f)) {
                facet.corners.extend([a, b, c]);
                facet.triangles.push(index);
                facet.area += area;
                continue;
            }
            let heights = points.iter().map(|p| (*p - a).dot(normal));
            let (low, high) = heights.fold((0.0_f64, 0.0_f64), |(l, h), d| (l.min(d), h.max(d)));
            match (low < -rounding, high > rounding) {
                (false, true) => {}
                (true, false) => normal = -normal,
                // Something on either side, or a flat scene.
                _ => return None,
            }
            facets.push(Facet { normal, origin: a, corners: vec![a, b, c], triangles: vec![index], area });
        }
        if !facets.iter().all(|f| f.area <= f.hull_area() * (1.0 + ROUNDING)) {
            return None;
        }
        let walls = (facets.len() <= MOST_WALLS && lowest >= LOWEST * diagonal).then(|| Walls::of(&facets, soup, diagonal));
        Some(Self { facets, rounding, walls })
    }

    /// The walls as seen from a point; `None` if there are too many, or if it may lie outside: on the outer side of a wall, or where a
    /// camera stands.
    #[inline]
    pub fn outlook(&self, origin: Vec3) -> Option<Outlook> {
        let walls = self.walls.as_ref()?;
        let height = [0, 1].map(|half: usize| along(&walls.normal[half], origin) - walls.offset[half]);
        // False for what is no number as well.
        if !height.iter().all(|h| h.cmpgt(-walls.rounding).all()) {
            return None;
        }
        Some(Outlook {
            inverse: height.map(|h| Vec4::select(h.cmpgt(walls.rounding), h.recip(), Vec4::ZERO)),
            least: height.map(|h| Vec4::select(h.cmplt(walls.near), Vec4::splat(GRAZING), Vec4::NEG_ONE)),
        })
    }

    /// The triangle that a ray from inside meets, the barycentric weights there and the ray parameter, where no
    /// rounding can make it another.
    ///
    /// Which wall comes first is found roughly, and then proved: in a convex room the triangle that a line from inside passes through, well
    /// within its border, is the only one. What the engine might find instead is a wall seen edge-on, by rounding: one that the ray
    /// starts near, as all others are far from it as long as it is inside.
    #[inline(always)]
    pub fn meet(&self, outlook: &Outlook, ray: &Ray) -> Option<(u32, (f64, f64), f32)> {
        let walls = self.walls.as_ref()?;
        let cosine = [0, 1].map(|half: usize| along(&walls.normal[half], ray.direction));
        let is_clear = [0, 1].map(|half: usize| cosine[half].abs().cmpgt(outlook.least[half]).all());
        // One over the distance to each plane ahead.
        let rate = [0, 1].map(|half: usize| {
            Vec4::select(cosine[half].cmplt(Vec4::splat(-GRAZING)), -cosine[half] * outlook.inverse[half], Vec4::ZERO)
        });
        let first = rate[0].max(rate[1]).max_element();
        // What a camera passes through or leaves out ends well before or beyond that wall.
        let is_within = ray.t_min * first < 0.5 && ray.t_max * first > 2.0;
        if !(is_clear[0] && is_clear[1] && first > 0.0 && is_within) {
            return None;
        }
        let at = |half: usize| rate[half].cmpeq(Vec4::splat(first)).bitmask();
        let wall = (at(0) | at(1) << 4).trailing_zeros() as usize;
        let point = ray.origin + ray.direction / first;
        for of in walls.triangles.get(wall)? {
            let [u, v] = of.weights.map(|(gradient, at_origin)| gradient.dot(point) + at_origin);
            if u.min(v).min(1.0 - u - v) < 0.0 {
                continue;
            }
            let seen = of.edges.seen_from(ray.origin);
            let [determinant, u, v] = seen.products(ray.direction);
            // As triangle::locate.
            let (u, v) = (u / determinant, v / determinant);
            if u.min(v).min(1.0 - u - v) > BORDER {
                return Some((of.primitive, (u, v), (seen.height / determinant) as f32));
            }
        }
        None
    }
}

/// Products of a vector with four normals.
#[inline]
fn along(normal: &[Vec4; 3], v: Vec3) -> Vec4 {
    normal[0] * v.x + normal[1] * v.y + normal[2] * v.z
}

impl Walls {
    fn of(facets: &[Facet], soup: &Soup, diagonal: f64) -> Self {
        let at = |k: usize| facets.get(k).unwrap_or(&facets[0]);
        let four = |half: usize, value: &dyn Fn(&Facet) -> f64| Vec4::from([0, 1, 2, 3].map(|k| value(at(4 * half + k)) as f32));
        let triangles = |of: &Facet| -> Vec<Candidate> {
            of.triangles.iter().map(|&primitive| Candidate::of(primitive, soup.corners(primitive as usize), of.normal)).collect()
        };
        Self {
            normal: [0, 1].map(|half| [0, 1, 2].map(|axis| four(half, &|f| f.normal[axis]))),
            offset: [0, 1].map(|half| four(half, &|f| f.normal.dot(f.origin))),
            triangles: std::array::from_fn(|k| triangles(at(k))),
            n: facets.len(),
            rounding: Vec4::splat((2.0 * ROUNDING * diagonal) as f32),
            near: Vec4::splat((NEAR * diagonal) as f32),
        }
    }
}

impl Candidate {
    fn of(primitive: u32, corners: [Vec3; 3], inside: DVec3) -> Self {
        let [a, b, c] = corners.map(|v| v.as_dvec3());
        let (e1, e2) = (b - a, c - a);
        let normal = e1.cross(e2);
        let affine = |edge: DVec3| {
            let gradient = edge / normal.length_squared();
            (gradient.as_vec3(), -gradient.dot(a) as f32)
        };
        Self {
            primitive,
            weights: [affine(e2.cross(normal)), affine(normal.cross(e1))],
            edges: Edges::new(corners),
            is_front: normal.dot(inside) > 0.0,
        }
    }
}

impl Facet {
    /// Area of the convex hull of the corners: less than that of the triangles if some lie on others. Andrew's monotone chain.
    fn hull_area(&self) -> f64 {
        let s = self.normal.any_orthonormal_vector();
        let t = self.normal.cross(s);
        let mut points: Vec<DVec2> =
            self.corners.iter().map(|p| *p - self.origin).map(|p| DVec2::new(p.dot(s), p.dot(t))).collect();
        points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        let chain = |points: &mut dyn Iterator<Item = DVec2>| {
            let mut chain: Vec<DVec2> = Vec::new();
            for p in points {
                while let [.., a, b] = chain[..]
                    && (b - a).perp_dot(p - a) <= 0.0
                {
                    chain.pop();
                }
                chain.push(p);
            }
            chain.pop();
            chain
        };
        let hull = [chain(&mut points.iter().copied()), chain(&mut points.iter().rev().copied())].concat();
        let next = hull.iter().cycle().skip(1);
        0.5 * hull.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum::<f64>()
    }
}
