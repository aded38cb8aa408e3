//! Patches cut in quarters, where a solution shows that radiosity bends within them.
//!
//! Pieces of large triangles are cut across the middle both ways, along their triangle's grid; groups of small triangles are grouped
//! anew in cells of half the size. Cells of spheres stay as they are.

use super::subdivide::{self, Point, Polygon, SplitTree};
use super::{BORDER_MARGIN, Element, Lookup, PatchMesh, Piece, cluster, cuts};
use crate::world::World;
use std::collections::HashMap;

/// Elements are cut in quarters so often at most.
pub const FINEST_LEVEL: u8 = 5;

impl PatchMesh {
    /// How often the element of patch `i` was cut in quarters.
    pub fn level(&self, i: usize) -> u8 {
        self.elements[self.element_of[i] as usize].level
    }

    /// Edge of the cell that patch `i` was cut from [m]: the patch size, halved with each level.
    pub fn cell_size(&self, i: usize) -> f64 {
        self.patch_size / f64::from(1_u32 << self.level(i))
    }

    /// True if the element of patch `i` can be cut further.
    pub fn is_divisible(&self, i: usize) -> bool {
        let element = &self.elements[self.element_of[i] as usize];
        let is_flat = !matches!(self.pieces[element.pieces.start as usize], Piece::SphereCell { .. });
        is_flat && element.level < FINEST_LEVEL
    }

    /// The same surfaces with the elements of the marked patches cut in quarters; `marked` by patch.
    pub fn refined(&self, world: &World, marked: &[bool]) -> PatchMesh {
        let mut cut = vec![false; self.elements.len()];
        marked.iter().zip(&self.element_of).filter(|(marked, _)| **marked).for_each(|(_, e)| cut[*e as usize] = true);
        let (mut finer, moved) = self.of_elements(&cut);
        let margin = f64::from(world.bounds().diagonal()) * BORDER_MARGIN;
        let mut groups: HashMap<u32, Vec<u32>> = HashMap::new();
        for primitive in 0..self.lookups.len() as u32 {
            match self.lookups[primitive as usize] {
                Lookup::Split { tree } => {
                    let old = &self.trees[tree as usize];
                    let mut new = old.clone();
                    let mut parents = new.parents();
                    let leaves = parents.len() as u32;
                    let of_leaf = |leaf: u32| self.tree_elements[(old.base + leaf) as usize];
                    new.base = finer.tree_elements.len() as u32;
                    // Those that stay keep their places; those that are cut give theirs to their first part.
                    finer.tree_elements.extend((0..leaves).map(|leaf| moved[of_leaf(leaf) as usize]));
                    for leaf in (0..leaves).filter(|leaf| cut[of_leaf(*leaf) as usize]) {
                        let (polygon, level) = (self.polygon_of(of_leaf(leaf)), self.elements[of_leaf(leaf) as usize].level);
                        let cell = 0.5 * self.patch_size / f64::from(1_u32 << level);
                        let grid = (world.soup().corners(primitive as usize), self.patch_size);
                        let parts = new.cut_leaf(&mut parents, leaf, polygon, grid, cell);
                        for (leaf, polygon) in parts {
                            let element = finer.add_polygon(world, primitive, &polygon, level + 1, margin);
                            let place = (new.base + leaf) as usize;
                            finer.tree_elements.resize(finer.tree_elements.len().max(place + 1), element);
                            finer.tree_elements[place] = element;
                        }
                    }
                    finer.lookups[primitive as usize] = Lookup::Split { tree: finer.trees.len() as u32 };
                    finer.trees.push(new);
                }
                Lookup::Whole(element) if cut[element as usize] => groups.entry(element).or_default().push(primitive),
                Lookup::Whole(element) => finer.lookups[primitive as usize] = Lookup::Whole(moved[element as usize]),
                Lookup::Grid { first, rows, columns } => {
                    finer.lookups[primitive as usize] = Lookup::Grid { first: moved[first as usize], rows, columns };
                }
                Lookup::None => {}
            }
        }
        let mut groups: Vec<(u32, Vec<u32>)> = groups.into_iter().collect();
        groups.sort_unstable();
        for (element, primitives) in groups {
            finer.regroup(world, &primitives, self.elements[element as usize].level, margin);
        }
        finer.measure(world);
        finer.leave_out_covered(world);
        finer
    }

    /// All elements but those that are `cut`, without lookups and measures, and the new index of each; of no account for one that is cut.
    fn of_elements(&self, cut: &[bool]) -> (PatchMesh, Vec<u32>) {
        let mut kept = PatchMesh::empty(self.patch_size, self.lookups.len());
        let mut moved = Vec::with_capacity(self.elements.len());
        for (element, cut) in self.elements.iter().zip(cut) {
            moved.push(kept.elements.len() as u32);
            if !cut {
                let pieces = &self.pieces[element.pieces.start as usize..element.pieces.end as usize];
                kept.add_element(pieces.iter().copied(), element.level);
            }
        }
        (kept, moved)
    }

    /// The barycentric polygon that an element on one triangle was cut out as, before it was drawn in.
    fn polygon_of(&self, element: u32) -> Polygon {
        let pieces = &self.elements[element as usize].pieces;
        let mut polygon = Polygon::new();
        let mut factor = 1.0;
        for piece in &self.pieces[pieces.start as usize..pieces.end as usize] {
            let Piece::Triangle { corners, inset, .. } = piece else { continue };
            let known = if polygon.is_empty() { 0 } else { 2 };
            polygon.extend(corners[known..].iter().map(|c| c.map(f64::from)));
            factor = f64::from(*inset);
        }
        let n = polygon.len() as f64;
        let middle = polygon.iter().fold([0.0, 0.0], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]);
        polygon.iter().map(|p: &Point| [0, 1].map(|k| middle[k] + (p[k] - middle[k]) / factor)).collect()
    }

    /// Small triangles that were one element, in cells of half the size; one that is larger by itself is cut.
    fn regroup(&mut self, world: &World, primitives: &[u32], level: u8, margin: f64) {
        let cell = 0.5 * self.patch_size / f64::from(1_u32 << level);
        for group in cluster::group(world, primitives, cell) {
            let corners = world.soup().corners(group[0] as usize);
            if group.len() == 1 && cuts::longest_edge(corners) > cell {
                let (mut tree, whole) = SplitTree::whole();
                tree.base = self.tree_elements.len() as u32;
                for (_, polygon) in tree.cut_leaf(&mut vec![None], 0, whole, (corners, self.patch_size), cell) {
                    let element = self.add_polygon(world, group[0], &polygon, level + 1, margin);
                    self.tree_elements.push(element);
                }
                self.lookups[group[0] as usize] = Lookup::Split { tree: self.trees.len() as u32 };
                self.trees.push(tree);
            } else {
                self.add_group(group, level + 1);
            }
        }
    }

    /// An element for part of a triangle.
    pub(super) fn add_polygon(&mut self, world: &World, primitive: u32, polygon: &Polygon, level: u8, margin: f64) -> u32 {
        let (polygon, inset) = subdivide::inset(polygon, world.soup().corners(primitive as usize), margin);
        let fan = (1..polygon.len() - 1).map(|k| [polygon[0], polygon[k], polygon[k + 1]]);
        let corners = |triangle: [Point; 3]| triangle.map(|c| [c[0] as f32, c[1] as f32]);
        let pieces = fan.map(|triangle| Piece::Triangle { primitive, corners: corners(triangle), inset: inset as f32 });
        self.add_element(pieces, level)
    }

    /// An element for whole triangles.
    pub(super) fn add_group(&mut self, group: Vec<u32>, level: u8) {
        let whole = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let pieces = group.iter().map(|&primitive| Piece::Triangle { primitive, corners: whole, inset: 1.0 });
        let element = self.add_element(pieces, level);
        for primitive in group {
            self.lookups[primitive as usize] = Lookup::Whole(element);
        }
    }

    pub(super) fn add_element(&mut self, pieces: impl Iterator<Item = Piece>, level: u8) -> u32 {
        let start = self.pieces.len() as u32;
        self.pieces.extend(pieces);
        self.elements.push(Element { pieces: start..self.pieces.len() as u32, front: None, back: None, level });
        self.elements.len() as u32 - 1
    }
}
