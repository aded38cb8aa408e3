//! The patch at a point of a flat wall by division instead of by a tree of lines, for scenes of which a plan knows that all walls are flat.
//!
//! Large triangles are split by a regular grid, so that the cell of a point is found by rounding two numbers down. Cells that a cut
//! crosses, where another surface stands, are left to the tree. Both give the same patch, to the last bit of a point on a border.

use super::subdivide::{Grid, NO_PIECE};
use super::{Element, Lookup, PatchId, PatchMesh};
use crate::world::World;

/// No patch on this side.
const NONE: u32 = u32::MAX;
/// The tree knows.
const ASK: u32 = u32::MAX - 1;
/// Triangles of more cells are left to their trees.
const MOST_CELLS: usize = 1 << 22;

/// The cells of all triangles.
#[derive(Debug, Default)]
pub(super) struct Raster {
    /// By primitive.
    grids: Vec<Cells>,
    /// Patches on the front and on the back of each cell, rows of a triangle one after the other.
    patches: Vec<[u32; 2]>,
}

/// The grid over one triangle.
#[derive(Debug, Clone, Copy, Default)]
struct Cells {
    /// Factors of the barycentric weights in each coordinate.
    factor: [[f64; 2]; 2],
    /// Integer to be added to each coordinate, rounded down.
    shift: [i64; 2],
    /// Columns and rows; none: the tree or whatever there is knows.
    size: [i64; 2],
    /// Index of the first cell.
    first: usize,
}

impl PatchMesh {
    /// Lays the patches out for [`Self::patch_on_flat`].
    pub fn lay_out(&mut self, world: &World) {
        let mut raster = Raster { grids: vec![Cells::default(); self.lookups.len()], patches: Vec::new() };
        for (primitive, lookup) in self.lookups.iter().enumerate() {
            let one = |element: &Element| [element.front, element.back].map(|side| side.map_or(NONE, |PatchId(id)| id));
            let first = raster.patches.len();
            match *lookup {
                Lookup::None | Lookup::Grid { .. } => {}
                Lookup::Whole(element) => {
                    // One cell, whatever the weights.
                    raster.grids[primitive] = Cells { size: [1, 1], first, ..Cells::default() };
                    raster.patches.push(one(&self.elements[element as usize]));
                }
                Lookup::Split { tree } => {
                    let tree = &self.trees[tree as usize];
                    let grid = Grid::new(world.soup().corners(primitive), self.patch_size);
                    let [x, y] = grid.coordinates;
                    // Weights sum to one: each coordinate lies between 0 and the number of cells, both included.
                    let size = [x, y].map(|c| c.a.abs().max(c.b.abs()).max(c.c.abs()) as i64 + 1);
                    if raster.patches.len() + (size[0] * size[1]) as usize > MOST_CELLS {
                        continue;
                    }
                    raster.grids[primitive] =
                        Cells { factor: [[x.a, x.b], [y.a, y.b]], shift: [x.c as i64, y.c as i64], size, first };
                    for row in 0..size[1] {
                        for column in 0..size[0] {
                            raster.patches.push(match tree.leaf_of_cell(&grid, [column, row]) {
                                None => [ASK; 2],
                                Some(NO_PIECE) => [NONE; 2],
                                Some(leaf) => one(&self.elements[self.tree_elements[(tree.base + leaf) as usize] as usize]),
                            });
                        }
                    }
                }
            }
        }
        self.raster = raster;
    }

    /// The patch of a flat primitive at barycentric weights, on its front or back: as [`Self::patch_at`], after [`Self::lay_out`].
    #[inline(always)]
    pub fn patch_on_flat(&self, primitive: u32, place: (f64, f64), front: bool) -> Option<PatchId> {
        let Some(cells) = self.raster.grids.get(primitive as usize) else { return self.patch_of(primitive, place, front) };
        let coordinate = |axis: usize| {
            let [a, b] = cells.factor[axis];
            let x = a * place.0 + b * place.1;
            // Rounded down without a call of the mathematical library.
            let cut = x as i64;
            cut - i64::from(x < cut as f64) + cells.shift[axis]
        };
        let (x, y) = (coordinate(0), coordinate(1));
        if x < 0 || y < 0 || x >= cells.size[0] || y >= cells.size[1] {
            return self.patch_of(primitive, place, front);
        }
        match self.raster.patches[cells.first + (y * cells.size[0] + x) as usize][usize::from(!front)] {
            NONE => None,
            ASK => self.patch_of(primitive, place, front),
            id => Some(PatchId(id)),
        }
    }
}
