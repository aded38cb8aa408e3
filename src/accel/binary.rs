//! Plain traversal of the binary tree: the simple version with which the wide one is compared in tests.

use std::sync::Arc;

use super::bvh::{Draft, Tree};
use super::query::{BOX_SLACK, Query, inclusive, is_better};
use super::{Accel, Hit, Ray, Soup};
use crate::geometry::Bounds;
use crate::geometry::soup::Primitive;

/// Deepest tree that is traversed; a deeper one is built anew by halving.
const MAX_DEPTH: usize = 96;

/// Plain traversal of the binary tree, nearer child first: what the wide one is compared with.
pub struct Binary {
    soup: Arc<Soup>,
    tree: Tree,
}

impl Binary {
    /// Builds the tree.
    pub fn new(soup: Arc<Soup>) -> Self {
        let tree = Draft::build(&soup).tree();
        let tree = if depth(&tree) > MAX_DEPTH { Draft::build_balanced(&soup).tree() } else { tree };
        Self { tree, soup }
    }

    /// Parameter at which the ray enters `bounds`, if it does so within [`t_min`, `limit`] (conservative).
    #[inline]
    fn enters(query: &Query, bounds: &Bounds, limit: f32) -> Option<f32> {
        let a = (bounds.min - query.ray.origin) * query.inverse;
        let b = (bounds.max - query.ray.origin) * query.inverse;
        let (mut near, mut far) = (query.ray.t_min, limit);
        for axis in 0..3 {
            let (enter, leave) = if query.inverse[axis] >= 0.0 { (a[axis], b[axis]) } else { (b[axis], a[axis]) };
            // 0 * infinity, a ray inside a face's plane, is a NaN: both comparisons fail and the slab does not count.
            near = if enter > near { enter } else { near };
            far = if leave < far { leave } else { far };
        }
        (near <= far * BOX_SLACK).then_some(near)
    }

    /// Calls `visit` with primitives near the ray; it returns the new end of the ray, or `None` to stop.
    #[inline]
    fn traverse(&self, query: &Query, mut visit: impl FnMut(u32, f32) -> Option<f32>) {
        let mut stack = [(0_u32, 0.0_f32); MAX_DEPTH];
        let mut limit = query.ray.t_max;
        let enter = |index: u32, limit| Self::enters(query, &self.tree.nodes[index as usize].bounds, limit).map(|t| (index, t));
        let mut current = if self.tree.nodes.is_empty() { None } else { enter(0, limit) };
        let mut height = 0;
        while let Some((index, _)) = current {
            let node = &self.tree.nodes[index as usize];
            if node.is_leaf() {
                match visit(node.primitive, limit) {
                    Some(end) => limit = end,
                    None => return,
                }
                current = None;
            } else {
                let [first, second] = self.tree.children(index);
                current = match (enter(first, limit), enter(second, limit)) {
                    (Some(a), Some(b)) => {
                        let (near, far) = if b.1 < a.1 { (b, a) } else { (a, b) };
                        stack[height] = far;
                        height += 1;
                        Some(near)
                    }
                    (a, b) => a.or(b),
                };
            }
            // What was put aside may lie beyond a hit found since.
            while current.is_none() && height > 0 {
                height -= 1;
                current = Some(stack[height]).filter(|&(_, t)| t <= limit * BOX_SLACK);
            }
        }
    }
}

impl Binary {
    fn meet(&self, primitive: u32, query: &Query, limit: f32) -> Option<Hit> {
        let t = match self.soup.primitive(primitive) {
            Primitive::Triangle(corners) => query.meet(corners, limit),
            Primitive::Sphere(sphere) => sphere.intersect(&query.ray, query.ray.t_min, limit),
        };
        t.map(|t| Hit { t, primitive })
    }
}

impl Accel for Binary {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let query = Query::new(ray)?;
        let mut best = None;
        self.traverse(&query, |primitive, limit| {
            if let Some(hit) = self.meet(primitive, &query, limit)
                && is_better(hit, best)
            {
                best = Some(hit);
            }
            Some(best.map_or(limit, |hit| inclusive(hit.t).min(ray.t_max)))
        });
        best
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let Some(query) = Query::new(ray) else { return false };
        let mut found = false;
        self.traverse(&query, |primitive, limit| {
            found = self.meet(primitive, &query, limit).is_some();
            (!found).then_some(limit)
        });
        found
    }

    fn memory_bytes(&self) -> usize {
        std::mem::size_of_val(self.tree.nodes.as_slice())
    }
}

/// Nodes on the longest way from the root to a leaf; 0 for the empty tree.
fn depth(tree: &Tree) -> usize {
    let mut deepest = 0;
    let mut open: Vec<(u32, usize)> = if tree.nodes.is_empty() { Vec::new() } else { vec![(0, 1)] };
    while let Some((index, depth)) = open.pop() {
        deepest = deepest.max(depth);
        let node = &tree.nodes[index as usize];
        if !node.is_leaf() {
            open.extend(tree.children(index).map(|child| (child, depth + 1)));
        }
    }
    deepest
}
