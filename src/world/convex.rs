//! Rooms in which nothing can stand between two surfaces.

use super::World;
use super::flat::Flat;
use crate::geometry::{Ray, Soup, triangle};
use crate::light::Light;
use crate::math::{DVec2, DVec3, Vec3};

/// Planarity and position are judged up to this share of the diagonal: several ulps of a coordinate.
const ROUNDING: f64 = 1e-6;
/// Rooms of more triangles are not looked at.
const MOST_TRIANGLES: usize = 2048;
/// Rooms of more walls leave it to the tree which one a ray meets.
const MOST_WALLS: usize = 8;
/// So do rays within this sine of a wall's plane, along which rounding grows,
const GRAZING: f32 = 0.01;
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
    normal: [[f32; MOST_WALLS]; 3],
    /// Where on its normal each plane lies.
    offset: [f32; MOST_WALLS],
    /// Triangles of each.
    triangles: [Vec<u32>; MOST_WALLS],
    /// Heights below this are no more than rounding.
    rounding: f32,
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
        let walls = (facets.len() <= MOST_WALLS && lowest >= LOWEST * diagonal).then(|| Walls::of(&facets, rounding));
        Some(Self { facets, rounding, walls })
    }

    /// The triangle that a ray from inside meets and the barycentric weights there, where no rounding can make it another.
    #[inline]
    pub fn meet(&self, flat: &Flat, ray: &Ray) -> Option<(u32, (f64, f64))> {
        let walls = self.walls.as_ref()?;
        let candidates = walls.ahead(ray)?;
        for &primitive in candidates {
            let [a, b, c] = flat.triangle(primitive).vertices;
            let (u, v) = triangle::barycentric(ray, a, b, c);
            if u.min(v).min(1.0 - u - v) > BORDER {
                return Some((primitive, (u, v)));
            }
        }
        None
    }
}

impl Walls {
    fn of(facets: &[Facet], rounding: f64) -> Self {
        let mut walls = Self {
            normal: [[0.0; MOST_WALLS]; 3],
            offset: [0.0; MOST_WALLS],
            triangles: std::array::from_fn(|_| Vec::new()),
            rounding: 2.0 * rounding as f32,
        };
        for k in 0..MOST_WALLS {
            let facet = facets.get(k).unwrap_or(&facets[0]);
            for (axis, n) in facet.normal.to_array().into_iter().enumerate() {
                walls.normal[axis][k] = n as f32;
            }
            walls.offset[k] = facet.normal.dot(facet.origin) as f32;
            walls.triangles[k].clone_from(&facet.triangles);
        }
        walls
    }

    /// Triangles of the wall whose plane a ray from inside meets first; `None` along a wall, or for a ray that may start outside: on the
    /// outer side of a wall, or where a camera stands.
    #[inline]
    fn ahead(&self, ray: &Ray) -> Option<&[u32]> {
        let [o, d] = [ray.origin.to_array(), ray.direction.to_array()];
        let along = |v: [f32; 3], k: usize| self.normal[0][k] * v[0] + self.normal[1][k] * v[1] + self.normal[2][k] * v[2];
        let cosine: [f32; MOST_WALLS] = std::array::from_fn(|k| along(d, k));
        let height: [f32; MOST_WALLS] = std::array::from_fn(|k| along(o, k) - self.offset[k]);
        let t: [f32; MOST_WALLS] = std::array::from_fn(|k| if cosine[k] < 0.0 { height[k] / -cosine[k] } else { f32::INFINITY });
        let less = |a: f32, b: f32| if b < a { b } else { a };
        let flattest = cosine.map(f32::abs).into_iter().reduce(less)?;
        let first = t.into_iter().reduce(less)?;
        // False for what is no number as well.
        let is_clear = height.into_iter().all(|h| h > -self.rounding)
            && flattest > GRAZING
            && first < f32::INFINITY
            && ray.t_max == f32::INFINITY;
        let wall = t.iter().position(|t| *t == first)?;
        (is_clear && height[wall] > self.rounding).then(|| self.triangles[wall].as_slice())
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
