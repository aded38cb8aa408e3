//! Large triangles are split: first along the surfaces that cut them, then by a regular grid of the patch size.
//!
//! The pieces of one triangle are the leaves of a binary tree of lines in its barycentric plane, so that the piece under a hit is
//! found in a few steps.

use super::cuts::{self, Cutters, Line};
use crate::math::Vec3;
use crate::world::World;
use rayon::prelude::*;

/// A point by the barycentric weights of the second and third vertex.
pub type Point = [f64; 2];

/// Convex polygon in barycentric coordinates.
pub type Polygon = Vec<Point>;

/// What a tree answers where a sliver too thin to matter was left without a piece.
pub const NO_PIECE: u32 = u32::MAX;

/// A piece thinner than this share of its triangle stays with its neighbour.
const SLIVER: f64 = 1e-9;

/// A part smaller than this share of the piece that is cut stays with it.
const THINNEST_PART: f64 = 1e-3;

#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Node {
    line: Line,
    /// Where the line's value is below 0, and where it is not; leaves are stored as `LEAF | index`.
    children: [u32; 2],
}

const LEAF: u32 = 1 << 31;

/// A line nearer to a cell than this, over the size of its terms, may cross it.
const NEAR: f64 = 1e-9;

/// The pieces of one triangle.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct SplitTree {
    nodes: Vec<Node>,
    root: u32,
    /// Polygons of the leaves, until they have become elements.
    pub leaves: Vec<Polygon>,
    /// Added to a leaf's index to find its element.
    pub base: u32,
}

impl SplitTree {
    /// The same tree with its polygons given up and its leaves counted from `base`.
    pub fn without_leaves(mut self, base: u32) -> Self {
        self.leaves = Vec::new();
        self.base = base;
        self
    }

    /// Index of the leaf that holds barycentric point (u, v).
    #[inline]
    pub fn find(&self, u: f64, v: f64) -> u32 {
        let mut at = self.root;
        while at & LEAF == 0 {
            let node = &self.nodes[at as usize];
            at = node.children[usize::from(node.line.value([u, v]) >= 0.0)];
        }
        at & !LEAF
    }
}

impl SplitTree {
    /// The leaf that holds all of a cell of the grid, [`NO_PIECE`] included; `None` if a cut crosses the cell or is too near to tell.
    pub(super) fn leaf_of_cell(&self, grid: &Grid, cell: [i64; 2]) -> Option<u32> {
        let [x, y] = grid.coordinates;
        let mut at = self.root;
        while at & LEAF == 0 {
            let Node { line, children } = &self.nodes[at as usize];
            let axis = [x, y].iter().position(|c| (c.a, c.b) == (line.a, line.b) && (c.c - line.c).fract() == 0.0);
            let side = match axis {
                // Grid line k: a cell lies on one side of it.
                Some(axis) => cell[axis] >= (grid.coordinates[axis].c - line.c) as i64,
                None => {
                    let corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|d| grid.point([cell[0] + d[0], cell[1] + d[1]]));
                    let values = corners.map(|p| line.value(p));
                    let scale = corners.iter().flatten().fold(1.0, |m: f64, v| m.max(v.abs()));
                    let margin = NEAR * scale * (line.a.abs() + line.b.abs() + line.c.abs());
                    match (values.iter().all(|v| *v > margin), values.iter().all(|v| *v < -margin)) {
                        (true, _) => true,
                        (_, true) => false,
                        _ => return None,
                    }
                }
            };
            at = children[usize::from(side)];
        }
        Some(at & !LEAF)
    }
}

/// Edge lengths by which triangles are split [m].
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Of a patch.
    pub patch: f64,
    /// Of the patches that decide which cuts matter: coarse patches are cut as finer ones are, or they would reach under walls.
    pub cut: f64,
}

/// Splits each of `primitives` (triangles) along what cuts it and by the grid; in the order given.
pub fn split_all(world: &World, cutters: &Cutters, primitives: &[u32], sizes: Sizes) -> Vec<(u32, SplitTree)> {
    primitives
        .par_iter()
        .map(|&primitive| {
            let corners = world.soup().corners(primitive as usize);
            let lines = cuts::cutting_lines(world, cutters, primitive, sizes.cut);
            (primitive, split(corners, &lines, sizes.patch))
        })
        .collect()
}

/// Splits those of `primitives`, smaller than a patch, that a cutter divides: their parts may lie in different rooms.
pub fn split_divided(world: &World, cutters: &Cutters, primitives: &[u32], sizes: Sizes) -> Vec<(u32, SplitTree)> {
    let split_one = |primitive: u32| {
        let corners = world.soup().corners(primitive as usize);
        let lines = cuts::cutting_lines(world, cutters, primitive, sizes.cut);
        if lines.is_empty() {
            return None;
        }
        let tree = split(corners, &lines, sizes.patch);
        (tree.leaves.len() > 1).then_some((primitive, tree))
    };
    primitives.par_iter().filter_map(|&p| split_one(p)).collect()
}

/// Splits one triangle along `lines` and then by the grid.
fn split(corners: [Vec3; 3], lines: &[cuts::Cut], patch_size: f64) -> SplitTree {
    let mut tree = SplitTree { nodes: Vec::new(), root: 0, leaves: Vec::new(), base: 0 };
    let grid = Grid::new(corners, patch_size);
    let whole = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
    tree.root = tree.cut(whole, lines.to_vec(), &grid);
    tree
}

impl SplitTree {
    /// The whole triangle as one leaf, and its polygon.
    pub(super) fn whole() -> (Self, Polygon) {
        (Self { nodes: Vec::new(), root: LEAF, leaves: Vec::new(), base: 0 }, vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    }

    /// By leaf: the node above it and the side on which it hangs there; `None` where the leaf is all there is.
    pub(super) fn parents(&self) -> Vec<Option<(u32, usize)>> {
        let mut parents = Vec::new();
        let mut put = |at: u32, parent| {
            if at & LEAF != 0 {
                let leaf = (at & !LEAF) as usize;
                parents.resize(parents.len().max(leaf + 1), None);
                parents[leaf] = parent;
            }
        };
        put(self.root, None);
        for (k, node) in self.nodes.iter().enumerate() {
            (0..2).for_each(|side| put(node.children[side], Some((k as u32, side))));
        }
        parents
    }

    /// Cuts a leaf across the middle of what it spans in each direction of its triangle's grid (corners and patch size) in which it is longer
    /// than `cell` [m]. The leaves that take its place, with their polygons; the first one keeps its index. `parents` is kept up to date.
    pub(super) fn cut_leaf(
        &mut self,
        parents: &mut Vec<Option<(u32, usize)>>,
        leaf: u32,
        polygon: Polygon,
        (corners, patch_size): ([Vec3; 3], f64),
        cell: f64,
    ) -> Vec<(u32, Polygon)> {
        let grid = Grid::new(corners, patch_size);
        let mut parts = vec![(leaf, polygon)];
        for axis in 0..2 {
            for k in 0..parts.len() {
                let (leaf, polygon) = parts[k].clone();
                let Some(line) = grid.across(&polygon, corners, axis, cell) else { continue };
                let [below, above] = clip_both(&polygon, &line);
                if area(&below).min(area(&above)) <= THINNEST_PART * area(&polygon) {
                    continue;
                }
                let (node, new) = (self.push(line), parents.len() as u32);
                self.nodes[node].children = [LEAF | leaf, LEAF | new];
                match parents[leaf as usize] {
                    Some((above, side)) => self.nodes[above as usize].children[side] = node as u32,
                    None => self.root = node as u32,
                }
                parents[leaf as usize] = Some((node as u32, 0));
                parents.push(Some((node as u32, 1)));
                parts[k].1 = below;
                parts.push((new, above));
            }
        }
        parts
    }

    fn push(&mut self, line: Line) -> usize {
        self.nodes.push(Node { line, children: [0; 2] });
        self.nodes.len() - 1
    }

    fn cut(&mut self, polygon: Polygon, mut lines: Vec<cuts::Cut>, grid: &Grid) -> u32 {
        // The longest cut first: it decides most.
        while let Some(cut) = lines.pop() {
            let [below, above] = clip_both(&polygon, &cut.line);
            if area(&below).min(area(&above)) <= SLIVER || !cut.reaches_into(&polygon) {
                continue;
            }
            let node = self.push(cut.line);
            let low = self.cut(below, lines.clone(), grid);
            let high = self.cut(above, lines, grid);
            self.nodes[node].children = [low, high];
            return node as u32;
        }
        self.refine(polygon, grid)
    }

    /// Splits at the middle grid line of the direction that spans more cells, until one cell is left.
    fn refine(&mut self, polygon: Polygon, grid: &Grid) -> u32 {
        let spans = [0, 1].map(|axis| grid.cells_spanned(&polygon, axis));
        let axis = usize::from(spans[1].1 - spans[1].0 > spans[0].1 - spans[0].0);
        let (first, last) = spans[axis];
        if last > first {
            let line = grid.line(axis, (first + last).div_euclid(2) + 1);
            let [below, above] = clip_both(&polygon, &line);
            if area(&below).min(area(&above)) > SLIVER {
                let node = self.push(line);
                let low = self.refine(below, grid);
                let high = self.refine(above, grid);
                self.nodes[node].children = [low, high];
                return node as u32;
            }
        }
        self.leaves.push(polygon);
        LEAF | (self.leaves.len() as u32 - 1)
    }
}

/// A grid over a triangle, spanned by the two edges at the vertex whose angle is nearest to a right one. The two halves of a
/// rectangle then share one grid.
pub(super) struct Grid {
    /// Each coordinate as a line function of (u, v), scaled so that cells have unit size.
    pub(super) coordinates: [Line; 2],
}

impl Grid {
    pub(super) fn new(corners: [Vec3; 3], patch_size: f64) -> Self {
        let p = corners.map(|c| c.as_dvec3());
        let squareness = |i: usize| {
            let (e, f) = (p[(i + 1) % 3] - p[i], p[(i + 2) % 3] - p[i]);
            (e.dot(f) / (e.length() * f.length())).abs()
        };
        let apex = (0..3).min_by(|&i, &j| squareness(i).total_cmp(&squareness(j))).unwrap_or(0);
        let cells = |to: usize| ((p[to] - p[apex]).length() / patch_size).ceil().max(1.0);
        // Barycentric weight of vertex k as a line function: 1 - u - v, u, v.
        let weight = |k: usize| match k {
            0 => Line { a: -1.0, b: -1.0, c: 1.0 },
            1 => Line { a: 1.0, b: 0.0, c: 0.0 },
            _ => Line { a: 0.0, b: 1.0, c: 0.0 },
        };
        let coordinates = [(apex + 1) % 3, (apex + 2) % 3].map(|k| weight(k).scaled(cells(k)));
        Self { coordinates }
    }

    /// Barycentric weights where two grid lines meet.
    fn point(&self, cell: [i64; 2]) -> Point {
        let [x, y] = self.coordinates;
        let (p, q) = (cell[0] as f64 - x.c, cell[1] as f64 - y.c);
        let det = x.a * y.b - x.b * y.a;
        [(p * y.b - x.b * q) / det, (x.a * q - p * y.a) / det]
    }

    /// First and last cell that a polygon reaches into along `axis`.
    fn cells_spanned(&self, polygon: &Polygon, axis: usize) -> (i64, i64) {
        let values = polygon.iter().map(|p| self.coordinates[axis].value(*p));
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        // A border that lies on a grid line up to rounding does not reach into the next cell.
        ((low + 1e-6).floor() as i64, (high - 1e-6).floor() as i64)
    }

    /// The line across the middle of what a polygon spans of `axis`; `None` if that is no longer than `cell` [m].
    fn across(&self, polygon: &Polygon, corners: [Vec3; 3], axis: usize, cell: f64) -> Option<Line> {
        let coordinate = self.coordinates[axis];
        let values = polygon.iter().map(|p| coordinate.value(*p));
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        // A unit of the coordinate [m]: the edge that it runs along, over the number of its cells.
        let [a, b, c] = corners.map(|c| c.as_dvec3());
        let along = self.direction(axis);
        let unit = ((b - a) * along[0] + (c - a) * along[1]).length();
        ((high - low) * unit > 1.001 * cell).then_some(Line { c: coordinate.c - 0.5 * (low + high), ..coordinate })
    }

    /// The step in barycentric weights that changes coordinate `axis` by 1 and the other one not at all.
    fn direction(&self, axis: usize) -> Point {
        let (own, other) = (self.coordinates[axis], self.coordinates[1 - axis]);
        let det = own.a * other.b - own.b * other.a;
        [other.b / det, -other.a / det]
    }

    /// Grid line `k` of `axis`.
    fn line(&self, axis: usize, k: i64) -> Line {
        let Line { a, b, c } = self.coordinates[axis];
        Line { a, b, c: c - k as f64 }
    }
}

/// Area in barycentric coordinates, of which the whole triangle has 1/2.
pub fn area(polygon: &Polygon) -> f64 {
    let n = polygon.len();
    let cross = |i: usize| {
        let (p, q) = (polygon[i], polygon[(i + 1) % n]);
        p[0] * q[1] - q[0] * p[1]
    };
    0.5 * (0..n).map(cross).sum::<f64>()
}

/// The polygon drawn in towards the mean of its corners so that its border moves by at least `margin` [m], and the factor by which.
pub fn inset(polygon: &Polygon, corners: [Vec3; 3], margin: f64) -> (Polygon, f64) {
    let [a, b, c] = corners.map(|c| c.as_dvec3());
    let metric = |p: Point| (b - a) * p[0] + (c - a) * p[1];
    let n = polygon.len();
    let middle = polygon.iter().fold([0.0, 0.0], |m, p| [m[0] + p[0] / n as f64, m[1] + p[1] / n as f64]);
    // Distance of the middle from the nearest side.
    let distance = |i: usize| {
        let (p, q, m) = (metric(polygon[i]), metric(polygon[(i + 1) % n]), metric(middle));
        (q - p).cross(m - p).length() / (q - p).length().max(f64::MIN_POSITIVE)
    };
    let nearest = (0..n).map(distance).fold(f64::INFINITY, f64::min);
    let factor = 1.0 - (margin / nearest).min(0.5);
    let draw = |p: &Point| [0, 1].map(|k| middle[k] + (p[k] - middle[k]) * factor);
    (polygon.iter().map(draw).collect(), factor)
}

/// The parts of a convex polygon where the line function is below 0 and where it is not.
fn clip_both(polygon: &Polygon, line: &Line) -> [Polygon; 2] {
    let mut parts = [Polygon::new(), Polygon::new()];
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (d, e) = (line.value(p), line.value(q));
        parts[usize::from(d >= 0.0)].push(p);
        if (d >= 0.0) != (e >= 0.0) {
            let t = d / (d - e);
            let x = [p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])];
            parts.iter_mut().for_each(|part| part.push(x));
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [Vec3; 3] = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];

    fn cut(a: f64, b: f64, c: f64) -> cuts::Cut {
        cuts::Cut { line: Line { a, b, c }, from: [-10.0, -10.0], to: [10.0, 10.0], length: 1.0 }
    }

    #[test]
    fn pieces_cover_the_triangle_and_are_found_again() {
        let lines = [cut(1.0, -0.5, -0.2)];
        let tree = split(CORNERS, &lines, 0.13);
        let total: f64 = tree.leaves.iter().map(area).sum();
        assert!((total - 0.5).abs() < 1e-9, "pieces cover {total} of 0.5");
        for (index, polygon) in tree.leaves.iter().enumerate() {
            let n = polygon.len() as f64;
            let (u, v) = polygon.iter().fold((0.0, 0.0), |(u, v), p| (u + p[0] / n, v + p[1] / n));
            assert_eq!(tree.find(u, v) as usize, index, "the middle of piece {index}");
        }
    }

    #[test]
    fn no_piece_straddles_a_cut() {
        let line = Line { a: 1.0, b: -0.5, c: -0.2 };
        let tree = split(CORNERS, &[cut(line.a, line.b, line.c)], 0.3);
        for polygon in &tree.leaves {
            let values: Vec<f64> = polygon.iter().map(|p| line.value(*p)).collect();
            let (low, high) = (values.iter().copied().fold(f64::MAX, f64::min), values.iter().copied().fold(f64::MIN, f64::max));
            assert!(low > -1e-12 || high < 1e-12, "a piece reaches from {low} to {high} across the cut");
        }
    }

    #[test]
    fn pieces_are_no_larger_than_asked() {
        let tree = split(CORNERS, &[], 0.25);
        assert_eq!(tree.leaves.len(), 4 * 8 / 2 + 4, "8 x 4 cells halved by the diagonal");
    }
}
