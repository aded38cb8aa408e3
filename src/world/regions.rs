//! Parts of space between which opaque walls let no light pass, found from the geometry alone.
//!
//! A *shell* is a set of triangles joined at their edges, each edge shared by exactly two. However it lies, a path that does not cross it
//! stays among the points whose rays to infinity meet it an even number of times, or an odd number: opaque shells part space. Each side
//! of each triangle, each lamp and the camera therefore have a *label*: one bit for every shell, or none where they come so near to it that
//! rounding, or a mean over a patch, may reach both parts. Light goes only between labels that do not contradict each other. Bounds only: what
//! cannot be told, and scenes that are too large to look at, count as joined.

use super::World;
use crate::geometry::Bounds;
use crate::light::Light;
use crate::math::{DVec3, Vec2, Vec3};
use std::collections::{BTreeMap, HashMap};

/// Two things nearer than this share of the scene's diagonal may be reached from each other whatever shell is between: rays leave slivers by
/// up to 1.2e-4 of their longest edge.
const NEAR: f64 = 1e-3;
/// Shells that are told apart; more are not looked at.
const MOST_SHELLS: usize = 64;
/// Triangles of a scene, and triangles of shells times those of the scene, where more are not looked at.
const MOST_TRIANGLES: usize = 1 << 15;
const MOST_PAIRS: usize = 1 << 22;
/// A ray that decides on which side a point is passes edges no nearer than this, in barycentric weights.
const CLEAR: f64 = 1e-7;
/// Directions that are tried for such a ray.
const DIRECTIONS: u32 = 16;

/// On which side of each shell a place lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
struct Label {
    /// By shell: inside.
    inside: u64,
    /// By shell: whether that is known.
    known: u64,
}

impl Label {
    /// Outside of all shells.
    const OUTSIDE: Label = Label { inside: 0, known: u64::MAX };

    /// True unless some shell surely stands between.
    fn may_meet(self, other: Label) -> bool {
        (self.inside ^ other.inside) & self.known & other.known == 0
    }

    fn set(&mut self, shell: usize, inside: Option<bool>) {
        if let Some(inside) = inside {
            self.known |= 1 << shell;
            self.inside |= u64::from(inside) << shell;
        }
    }
}

/// What no light passes between, by triangle and side: front, back.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Regions {
    /// Light may come here.
    pub lit: Vec<[bool; 2]>,
    /// What is here may count in the picture: the camera sees it, or what it lights, however indirectly.
    pub seen: Vec<[bool; 2]>,
    /// The side reflects or shines.
    pub is_patch: Vec<[bool; 2]>,
    /// True if every ray from what is seen ends on a surface.
    pub is_closed: bool,
}

impl Regions {
    /// Sides that are patches of which `of` says yes.
    pub fn count(&self, of: impl Fn(bool, bool) -> bool) -> usize {
        let sides = self.is_patch.iter().flatten().zip(self.lit.iter().flatten().zip(self.seen.iter().flatten()));
        sides.filter(|(patch, (lit, seen))| **patch && of(**lit, **seen)).count()
    }

    /// Sides whose light cannot count: they get none, or nobody sees what it does.
    pub fn idle(&self) -> Vec<[bool; 2]> {
        self.lit.iter().zip(&self.seen).map(|(lit, seen)| [0, 1].map(|side: usize| !(lit[side] && seen[side]))).collect()
    }
}

impl World {
    /// The parts of a scene whose surfaces are all opaque triangles; `None` where nothing parts it, or it is too large to be looked at. Whether
    /// surfaces are opaque is for the caller to know.
    pub fn regions(&self) -> Option<Regions> {
        let soup = self.soup();
        let n = soup.triangles.len();
        if !soup.spheres.is_empty() || n > MOST_TRIANGLES {
            return None;
        }
        let corners: Vec<[DVec3; 3]> = (0..n).map(|i| soup.corners(i).map(|v| v.as_dvec3())).collect();
        let near = NEAR * f64::from(self.bounds().diagonal());
        let mut shells = closed(soup.triangles.iter().map(|t| t.map(|i| soup.vertices[i as usize])));
        if shells.len() > MOST_SHELLS || shells.iter().map(|s| s.len() * n).sum::<usize>() > MOST_PAIRS {
            return None;
        }
        let corners_of = |p: usize| soup.corners(p);
        shells.retain(|shell| is_clean(shell, &corners, &|p| corners_of(p), near));
        if shells.is_empty() {
            return None;
        }
        let shells: Vec<Shell<'_>> = shells.into_iter().map(|triangles| Shell::of(triangles, &corners)).collect();
        let scene = self.scene();
        let mut sides = vec![[Label::default(); 2]; n];
        let mut is_patch = vec![[false; 2]; n];
        let mut starts = Vec::new();
        for (p, labels) in sides.iter_mut().enumerate() {
            let shape = self.shape(p as u32);
            let surface = scene.material_of(shape);
            is_patch[p] =
                [surface.material.has_diffuse() || shape.emits(), surface.two_sided || surface.material.has_diffuse_below()];
            let front = self.front_of(p as u32);
            for (s, shell) in shells.iter().enumerate() {
                let of_sides = shell.sides(p, front, near);
                labels.iter_mut().zip(of_sides).for_each(|(label, inside)| label.set(s, inside));
            }
            if shape.emits() {
                starts.push(labels[0]);
            }
        }
        let at = |point: Vec3, near: f64| {
            let mut label = Label::default();
            (0..).zip(&shells).for_each(|(s, shell)| label.set(s, shell.holds(point.as_dvec3(), near)));
            label
        };
        for light in &scene.lights {
            starts.push(match light {
                // Known by their shapes.
                Light::Area(_) => continue,
                Light::Point(light) => at(light.position, near),
                Light::Spot(light) => at(light.position, near),
                Light::Directional(_) | Light::Environment(_) => Label::OUTSIDE,
            });
        }
        if scene.environment.is_some() {
            starts.push(Label::OUTSIDE);
        }
        // What is nearer than the clipping plane is passed through.
        let corner = scene.camera.ray(Vec2::ZERO, scene.film.width, scene.film.height);
        let camera = at(corner.origin, near + 2.0 * f64::from(corner.t_min));
        let passing: Vec<Label> =
            sides.iter().zip(&is_patch).flat_map(|(labels, patch)| (0..2).filter(|k| patch[*k]).map(|k| labels[k])).collect();
        let lit = reached(&starts, &passing, &sides);
        let seen = reached(&[camera], &passing, &sides);
        // Everything that counts is surely within some shell.
        let within = sides.iter().zip(&seen).flat_map(|(labels, seen)| (0..2).filter(|k| seen[*k]).map(|k| labels[k]));
        let is_closed = within.chain([camera]).all(|label| label.inside & label.known != 0);
        Some(Regions { lit, seen, is_patch, is_closed })
    }

    /// The direction to which the front of a triangle surely points, all over.
    fn front_of(&self, primitive: u32) -> Option<DVec3> {
        let towards = |weights| {
            let at = self.on_triangle(primitive, weights, Vec3::Z);
            if at.front { at.ng } else { -at.ng }
        };
        let at_corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].map(towards);
        at_corners.iter().all(|n| n.dot(at_corners[0]) > 0.0).then(|| at_corners[0].as_dvec3())
    }
}

/// The sides that light from `starts` may come to, passed on by `passing`.
fn reached(starts: &[Label], passing: &[Label], sides: &[[Label; 2]]) -> Vec<[bool; 2]> {
    let distinct = |labels: &[Label]| {
        let mut labels = labels.to_vec();
        labels.sort_unstable();
        labels.dedup();
        labels
    };
    let (mut found, mut waiting) = (distinct(starts), distinct(passing));
    let mut next = 0;
    while next < found.len() {
        let from = found[next];
        let (met, others): (Vec<Label>, Vec<Label>) = waiting.into_iter().partition(|label| from.may_meet(*label));
        found.extend(met);
        (waiting, next) = (others, next + 1);
    }
    sides.iter().map(|labels| labels.map(|label| found.iter().any(|from| from.may_meet(label)))).collect()
}

/// Sets of triangles, joined at edges by equal corners, of which each edge belongs to exactly two.
fn closed(triangles: impl Iterator<Item = [Vec3; 3]>) -> Vec<Vec<usize>> {
    let mut number: HashMap<[u32; 3], u32> = HashMap::new();
    let mut edges: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    let mut n = 0;
    for (p, corners) in triangles.enumerate() {
        let ids = corners.map(|v| {
            let next = number.len() as u32;
            // -0 is 0.
            *number.entry((v + 0.0).to_array().map(f32::to_bits)).or_insert(next)
        });
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b): (usize, usize)| (ids[a], ids[b])) {
            edges.entry((a.min(b), a.max(b))).or_default().push(p);
        }
        n = p + 1;
    }
    let mut set: Vec<usize> = (0..n).collect();
    fn root(set: &mut [usize], mut i: usize) -> usize {
        while set[i] != i {
            set[i] = set[set[i]];
            i = set[i];
        }
        i
    }
    for joined in edges.values() {
        for pair in joined.windows(2) {
            let (a, b) = (root(&mut set, pair[0]), root(&mut set, pair[1]));
            set[a.max(b)] = a.min(b);
        }
    }
    let mut is_open = vec![false; n];
    for joined in edges.values().filter(|joined| joined.len() != 2) {
        joined.iter().for_each(|&p| is_open[root(&mut set, p)] = true);
    }
    let mut shells: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for p in 0..n {
        let first = root(&mut set, p);
        if !is_open[first] {
            shells.entry(first).or_default().push(p);
        }
    }
    shells.into_values().collect()
}

/// True if the triangles of a shell meet at common corners and edges only, and are not folded upon each other.
fn is_clean(shell: &[usize], corners: &[[DVec3; 3]], exact: &dyn Fn(usize) -> [Vec3; 3], near: f64) -> bool {
    let boxes: Vec<Bounds> = shell.iter().map(|&p| exact(p).into_iter().collect::<Bounds>().expanded(near as f32)).collect();
    for (i, &p) in shell.iter().enumerate() {
        for (k, &q) in shell.iter().enumerate().skip(i + 1) {
            if !boxes[i].overlaps(&boxes[k]) {
                continue;
            }
            let (of_p, of_q) = (exact(p), exact(q));
            // What the one has besides the corners that it shares.
            let besides = |mine: [Vec3; 3], others: [Vec3; 3]| -> Vec<DVec3> {
                mine.into_iter().filter(|v| !others.contains(v)).map(|v| v.as_dvec3()).collect()
            };
            let (p_only, q_only) = (besides(of_p, of_q), besides(of_q, of_p));
            let (a, b) = (&corners[p][..], &corners[q][..]);
            let meets = match (p_only.len(), q_only.len()) {
                // One edge: the third corner of each away from the other.
                (1, 1) => are_near(&p_only, b, near) || are_near(&q_only, a, near),
                (2, 2) => are_near(&p_only, b, near) || are_near(&q_only, a, near),
                (3, 3) => are_near(a, b, near),
                _ => true,
            };
            if meets {
                return false;
            }
        }
    }
    true
}

/// True unless a plane separates two convex sets of up to three points by more than `gap`.
fn are_near(a: &[DVec3], b: &[DVec3], gap: f64) -> bool {
    let edges =
        |points: &[DVec3]| -> Vec<DVec3> { (0..points.len()).map(|k| points[(k + 1) % points.len()] - points[k]).collect() };
    let (of_a, of_b) = (edges(a), edges(b));
    let normal = |e: &[DVec3]| if e.len() == 3 { e[0].cross(e[1]) } else { DVec3::ZERO };
    let (na, nb) = (normal(&of_a), normal(&of_b));
    let within = |e: &[DVec3], n: DVec3| e.iter().map(|e| n.cross(*e)).collect::<Vec<_>>();
    let mut axes = vec![na, nb];
    axes.extend(within(&of_a, na));
    axes.extend(within(&of_b, nb));
    axes.extend(of_a.iter().flat_map(|e| of_b.iter().map(|f| e.cross(*f))));
    axes.extend(a.iter().flat_map(|p| b.iter().map(|q| *q - *p)));
    let spread = |points: &[DVec3], axis: DVec3| {
        points.iter().map(|p| p.dot(axis)).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| (l.min(d), h.max(d)))
    };
    !axes.into_iter().filter_map(DVec3::try_normalize).any(|axis| {
        let ((low_a, high_a), (low_b, high_b)) = (spread(a, axis), spread(b, axis));
        low_a - high_b > gap || low_b - high_a > gap
    })
}

/// A closed set of triangles.
struct Shell<'a> {
    triangles: Vec<usize>,
    corners: &'a [[DVec3; 3]],
    low: DVec3,
    high: DVec3,
}

impl<'a> Shell<'a> {
    fn of(triangles: Vec<usize>, corners: &'a [[DVec3; 3]]) -> Self {
        let all = || triangles.iter().flat_map(|&p| corners[p]);
        let low = all().fold(DVec3::INFINITY, DVec3::min);
        let high = all().fold(DVec3::NEG_INFINITY, DVec3::max);
        Self { triangles, corners, low, high }
    }

    /// Whether the front and the back of a triangle lie inside, as far as that is known.
    fn sides(&self, p: usize, front: Option<DVec3>, near: f64) -> [Option<bool>; 2] {
        let triangle = &self.corners[p];
        let middle = triangle.iter().sum::<DVec3>() / 3.0;
        if self.triangles.binary_search(&p).is_ok() {
            let inside = front.and_then(|front| self.parity(middle, Some((p, front))));
            return [inside, inside.map(|i| !i)];
        }
        [self.side_of(triangle, middle, near); 2]
    }

    /// Whether a point lies inside, unless it is too near to tell.
    fn holds(&self, point: DVec3, near: f64) -> Option<bool> {
        self.side_of(&[point], point, near)
    }

    fn side_of(&self, points: &[DVec3], middle: DVec3, near: f64) -> Option<bool> {
        let low = points.iter().fold(DVec3::INFINITY, |a, b| a.min(*b)) - near;
        let high = points.iter().fold(DVec3::NEG_INFINITY, |a, b| a.max(*b)) + near;
        let meets = |l: DVec3, h: DVec3| l.cmple(high).all() && h.cmpge(low).all();
        if !meets(self.low, self.high) {
            return Some(false);
        }
        for &q in &self.triangles {
            let [a, b, c] = self.corners[q];
            if meets(a.min(b).min(c), a.max(b).max(c)) && are_near(points, &self.corners[q], near) {
                return None;
            }
        }
        self.parity(middle, None)
    }

    /// True if a ray from `point` crosses the shell an odd number of times. Of a point on a triangle: the ray leaves to the side given, and
    /// that triangle is not crossed.
    fn parity(&self, point: DVec3, leaving: Option<(usize, DVec3)>) -> Option<bool> {
        'directions: for k in 1..=DIRECTIONS {
            let mut direction = direction(k);
            if let Some((_, side)) = leaving {
                let cos = direction.dot(side);
                if cos.abs() < 0.1 {
                    continue;
                }
                direction *= cos.signum();
            }
            let mut inside = false;
            for &q in self.triangles.iter().filter(|q| leaving.is_none_or(|(p, _)| **q != p)) {
                match crosses(point, direction, self.corners[q]) {
                    Some(crossed) => inside ^= crossed,
                    None => continue 'directions,
                }
            }
            return Some(inside);
        }
        None
    }
}

/// Direction `k` of those that are tried. Any will do that are not those of walls.
fn direction(k: u32) -> DVec3 {
    let (s, c) = (2.399_963 * f64::from(k) + 0.3).sin_cos();
    let z = (0.754_877_7 * f64::from(k)).fract() * 1.8 - 0.9;
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * c, z, r * s)
}

/// True if a ray crosses a triangle; `None` if it passes too near to an edge, or along it, to tell.
fn crosses(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<bool> {
    let (e1, e2, p) = (b - a, c - a, origin - a);
    let normal = e1.cross(e2);
    let determinant = -direction.dot(normal);
    if determinant.abs() < CLEAR * normal.length() {
        return None;
    }
    let across = p.cross(direction);
    let (u, v) = (e2.dot(across) / determinant, -e1.dot(across) / determinant);
    let within = u.min(v).min(1.0 - u - v);
    if within < -CLEAR {
        return Some(false);
    }
    let t = p.dot(normal) / determinant;
    let length = e1.length().max(e2.length());
    (within > CLEAR && t.abs() > CLEAR * length).then_some(t > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron with the corners 0, x, y, z.
    fn tetrahedron() -> Vec<[DVec3; 3]> {
        let [o, x, y, z] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        vec![[o, x, y], [o, y, z], [o, z, x], [x, y, z]]
    }

    fn single(corners: &[[DVec3; 3]]) -> Vec<[Vec3; 3]> {
        corners.iter().map(|t| t.map(|v| v.as_vec3())).collect()
    }

    /// The plane x + y + z = 1 and those of the axes bound the points that are inside.
    #[test]
    fn a_tetrahedron_holds_what_its_planes_bound() {
        let corners = tetrahedron();
        let shells = closed(single(&corners).into_iter());
        assert_eq!(shells, [[0, 1, 2, 3]]);
        assert!(is_clean(&shells[0], &corners, &|p| single(&corners)[p], 1e-3));
        let shell = Shell::of(shells[0].clone(), &corners);
        let (mut inside, mut outside, mut unknown) = (0, 0, 0);
        for i in 0..9_i32.pow(3) {
            let p = [i % 9, i / 9 % 9, i / 81].map(|k| 0.17 * f64::from(k) - 0.19);
            let p = DVec3::from(p);
            let depth = p.min_element().min((1.0 - p.element_sum()) / 3.0_f64.sqrt());
            match shell.holds(p, 1e-2) {
                Some(true) => inside += i32::from(depth > 0.0) + 1000 * i32::from(depth <= 0.0),
                Some(false) => outside += i32::from(depth < 0.0) + 1000 * i32::from(depth >= 0.0),
                None => unknown += i32::from(depth.abs() < 0.05) + 1000 * i32::from(depth.abs() >= 0.05),
            }
        }
        assert!((10..1000).contains(&inside) && (100..1000).contains(&outside) && unknown < 1000, "{inside} {outside} {unknown}");
        // Sides of its own triangles: one within, one without; of one that crosses it nothing is known.
        for (p, towards) in [(0, DVec3::Z), (1, DVec3::X), (2, DVec3::Y), (3, DVec3::NEG_ONE)] {
            assert_eq!(shell.sides(p, Some(towards), 1e-3), [Some(true), Some(false)], "triangle {p}");
        }
        assert_eq!(
            shell.side_of(&[DVec3::splat(0.1), DVec3::splat(0.9), DVec3::new(0.1, 0.2, 0.1)], DVec3::splat(0.3), 1e-3),
            None
        );
    }

    /// A point within whose first rays pass exactly through corners and edges of the shell, and one on the shell, of
    /// which no ray can tell.
    #[test]
    fn rays_through_edges_decide_nothing() {
        for unclear in 1..=3 {
            // Corners where the first rays arrive, or on an edge between the first two of them; the others around the point.
            let (a, b) = (direction(1), direction(2));
            let on_edge = unclear == 3;
            let corners = if on_edge { [2.0 * a - b, b] } else { [a, if unclear == 2 { b } else { -0.3 * a + b }] };
            let middle = -0.5 * (corners[0] + corners[1]);
            let across = corners[0].cross(corners[1]).normalize();
            let [c, d] = [1.0, -1.0].map(|side| 1.5 * middle + 2.0 * side * across);
            let [a, b] = corners;
            let tetrahedron = [[a, b, c], [a, c, d], [a, d, b], [b, d, c]];
            let shell = Shell::of(vec![0, 1, 2, 3], &tetrahedron);
            assert!(
                tetrahedron.iter().any(|t| crosses(DVec3::ZERO, direction(1), *t).is_none()),
                "{unclear}: the first ray is clear"
            );
            assert_eq!(shell.parity(DVec3::ZERO, None), Some(true), "{unclear}: within");
            assert_eq!(shell.parity(10.0 * direction(1), None), Some(false), "{unclear}: without");
            assert_eq!(shell.parity((a + b + c) / 3.0, None), None, "{unclear}: on a face");
        }
    }

    #[test]
    fn what_is_open_folded_or_crosses_itself_is_no_shell() {
        let corners = tetrahedron();
        assert!(closed(single(&corners[..3]).into_iter()).is_empty());
        // A wall between two rooms: three triangles at an edge.
        let third = [DVec3::ZERO, DVec3::X, DVec3::NEG_ONE];
        assert!(closed(single(&[&corners[..], &[third]].concat()).into_iter()).is_empty());
        // So flat that its walls all but touch.
        let flat: Vec<[DVec3; 3]> = corners.iter().map(|t| t.map(|v| v * DVec3::new(1.0, 1.0, 1e-4))).collect();
        let shells = closed(single(&flat).into_iter());
        assert!(!is_clean(&shells[0], &flat, &|p| single(&flat)[p], 1e-3));
    }

    #[test]
    fn triangles_are_near_unless_a_plane_parts_them() {
        let t = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let moved = |by: DVec3| t.map(|v| v + by);
        assert!(are_near(&t, &moved(DVec3::Z * 0.009), 0.01) && !are_near(&t, &moved(DVec3::Z * 0.011), 0.01));
        assert!(are_near(&t, &moved(DVec3::new(0.5, 0.499, 0.0)), 0.01));
        // In one plane, past the longest edge.
        assert!(!are_near(&t, &moved(DVec3::new(0.52, 0.52, 0.0)), 0.01));
        // In one plane, along an edge whose normal joins no two corners.
        let beside = |gap: f64| [[2.0, -1.0], [-1.0, 2.0], [4.0, 1.0]].map(|[x, y]| DVec3::new(x + gap, y + gap, 0.0));
        assert!(!are_near(&t, &beside(0.01), 0.01) && are_near(&t, &beside(0.005), 0.01));
        // Through each other.
        assert!(are_near(&t, &[DVec3::new(0.2, 0.2, -1.0), DVec3::new(0.2, 0.2, 1.0), DVec3::new(3.0, 3.0, 0.0)], 0.01));
    }
}
