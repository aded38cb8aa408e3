//! Walls: the few largest flat surfaces, which tell of many pairs of groups at once that nothing passes between them [Teller93].

use super::tree::{Node, Tree};
use crate::form_factor::blockers::merged;
use crate::geometry::Bounds;
use crate::math::DVec3;
use crate::world::World;

/// Most walls: a bit each.
const MOST_WALLS: usize = 64;
/// Share of the area of all surfaces that a wall has at least.
const LEAST_AREA: f64 = 1e-4;
/// Two triangles are one wall if no corner is further from their plane than this share of their size.
const COPLANAR: f64 = 1e-6;
/// Lengths below this share of the scene's diagonal are taken for rounding.
const SLACK: f64 = 1e-5;

/// One wall: a convex polygon.
struct Wall {
    /// Height over its plane, and over the planes on its edges at right angles to it, positive on its inside: normal and offset.
    planes: Vec<(DVec3, f64)>,
}

/// The largest flat surfaces of a scene, and on which side of them each node lies.
pub struct Walls {
    walls: Vec<Wall>,
    /// By node: a bit for each wall that it lies above, and for each that it lies below, as a whole.
    sides: Vec<[u64; 2]>,
    slack: f64,
}

impl Walls {
    /// The walls of a scene.
    pub fn new(world: &World, tree: &Tree) -> Self {
        let soup = world.soup();
        let n = soup.triangles.len();
        let triangle = |i: usize| soup.corners(i).map(|c| c.as_dvec3());
        let mut found: Vec<(f64, Vec<DVec3>)> = Vec::new();
        let mut all = 0.0;
        let mut i = 0;
        while i < n {
            let together = (i + 1 < n).then(|| merged(triangle(i), triangle(i + 1), COPLANAR)).flatten();
            i += 1 + usize::from(together.is_some());
            let corners = together.map_or_else(|| triangle(i - 1).to_vec(), |quad| quad.to_vec());
            let area = 0.5 * turns(&corners).length();
            all += area;
            // Of what has been seen: more is left out as more is known.
            if area > LEAST_AREA * all {
                found.push((area, corners));
            }
        }
        found.retain(|(area, _)| *area > LEAST_AREA * all);
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(MOST_WALLS);
        Self::over(found.into_iter().map(|(_, corners)| Wall::new(&corners)).collect(), tree, world.bounds())
    }

    /// None at all.
    #[cfg(test)]
    pub fn none(world: &World, tree: &Tree) -> Self {
        Self::over(Vec::new(), tree, world.bounds())
    }

    fn over(walls: Vec<Wall>, tree: &Tree, scene: Bounds) -> Self {
        let slack = SLACK * f64::from(scene.diagonal());
        let side = |node: &Node| {
            let mut sides = [0, 0];
            for (k, wall) in walls.iter().enumerate() {
                let [low, high] = range(node.bounds, wall.planes[0]);
                sides[0] |= u64::from(low > slack) << k;
                sides[1] |= u64::from(high < -slack) << k;
            }
            sides
        };
        let sides = tree.nodes.iter().map(side).collect();
        Self { walls, sides, slack }
    }

    /// True if a wall certainly stands between all points of nodes `p` and `q`.
    #[inline]
    pub fn part(&self, tree: &Tree, p: usize, q: usize) -> bool {
        let ([p_above, p_below], [q_above, q_below]) = (self.sides[p], self.sides[q]);
        let mut between = (p_above & q_below) | (p_below & q_above);
        while between != 0 {
            let wall = &self.walls[between.trailing_zeros() as usize];
            let centers = [p, q].map(|at| tree.nodes[at].center.as_dvec3());
            if wall.is_passed(centers) && wall.hides(tree.nodes[p].bounds, tree.nodes[q].bounds, self.slack) {
                return true;
            }
            between &= between - 1;
        }
        false
    }
}

impl Wall {
    fn new(corners: &[DVec3]) -> Self {
        let normal = turns(corners).normalize_or_zero();
        let mut planes = vec![(normal, normal.dot(corners[0]))];
        let next = |k: usize| corners[(k + 1) % corners.len()];
        planes.extend((0..corners.len()).map(|k| {
            let inwards = normal.cross(next(k) - corners[k]).normalize_or_zero();
            (inwards, inwards.dot(corners[k]))
        }));
        Self { planes }
    }

    /// True if the segment between two points on different sides of the plane passes through the wall: few do where boxes do not, either.
    #[inline]
    fn is_passed(&self, [a, b]: [DVec3; 2]) -> bool {
        let height = |(n, c): (DVec3, f64), x: DVec3| n.dot(x) - c;
        let (to_a, to_b) = (height(self.planes[0], a).abs(), height(self.planes[0], b).abs());
        self.planes[1..].iter().all(|plane| height(*plane, a) * to_b + height(*plane, b) * to_a >= 0.0)
    }

    /// True if each segment between two boxes on different sides of the plane passes through the wall, no nearer to an edge than `slack`.
    fn hides(&self, p: Bounds, q: Bounds, slack: f64) -> bool {
        let heights = |of: Bounds, (n, c): (DVec3, f64)| -> [f64; 8] { corners(of).map(|corner| n.dot(corner) - c) };
        let (above, below) = (heights(p, self.planes[0]), heights(q, self.planes[0]));
        // Over each edge the point in which a segment passes the plane lies as high as its ends do, weighted by the other one's distance.
        // As an end moves along a line that point does, too: corners decide.
        self.planes[1..].iter().all(|plane| {
            let (a, b) = (heights(p, *plane), heights(q, *plane));
            let inside = |i: usize, j: usize| {
                let (to_a, to_b) = (above[i].abs(), below[j].abs());
                (a[i] - slack) * to_b + (b[j] - slack) * to_a >= 0.0
            };
            (0..8).all(|i| (0..8).all(|j| inside(i, j)))
        })
    }
}

/// Twice the area of a polygon, along its normal.
fn turns(corners: &[DVec3]) -> DVec3 {
    corners[1..].windows(2).map(|edge| (edge[0] - corners[0]).cross(edge[1] - corners[0])).sum()
}

fn corners(of: Bounds) -> [DVec3; 8] {
    let (low, high) = (of.min.as_dvec3(), of.max.as_dvec3());
    let pick = |k: usize, axis: usize| if k >> axis & 1 == 0 { low[axis] } else { high[axis] };
    std::array::from_fn(|k| DVec3::new(pick(k, 0), pick(k, 1), pick(k, 2)))
}

/// Lowest and highest point of a box over a plane.
fn range(of: Bounds, (normal, offset): (DVec3, f64)) -> [f64; 2] {
    let (low, high) = (of.min.as_dvec3(), of.max.as_dvec3());
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let (at, reach) = (normal.dot(middle) - offset, normal.abs().dot(half));
    [at - reach, at + reach]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    /// A wall of 2 x 2 in the middle, and two boxes on its sides that move apart until a segment passes it.
    #[test]
    fn a_wall_hides_what_no_segment_passes_by() {
        let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        let wall = Wall::new(&square);
        let cube = |center: Vec3| Bounds::new(center - 0.25, center + 0.25);
        let hides = |x: f32, z: f32| wall.hides(cube(Vec3::new(x, 0.0, z)), cube(Vec3::new(-x, 0.0, -1.0)), 1e-6);
        assert!(hides(0.0, 1.0) && hides(0.7, 1.0) && hides(0.7, 0.5));
        // Both to one side: the segment between their outer corners passes at x = 1.05.
        let beside = |x: f32| wall.hides(cube(Vec3::new(x, 0.0, 1.0)), cube(Vec3::new(x, 0.0, -1.0)), 1e-6);
        assert!(beside(0.7) && !beside(0.8));
        // The other way round, and past the wall's end far from one of them.
        assert!(wall.hides(cube(-Vec3::Z), cube(Vec3::Z), 1e-6));
        assert!(!wall.hides(cube(Vec3::new(3.0, 0.0, 1.0)), cube(Vec3::new(0.5, 0.0, -1.0)), 1e-6));
    }
}
