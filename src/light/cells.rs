//! Triangles divided into equal cells, so that a textured emitter is sampled where it is bright.

use crate::math::{DVec2, Vec2};

/// A triangle in barycentric coordinates (weights of the second and third corner), divided into `per_edge`² congruent cells.
///
/// Cells are numbered along rows of constant third weight; in a row, cells with the triangle's own orientation alternate with
/// those turned by half a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cells {
    /// Cells along each edge, 1 or more.
    pub per_edge: usize,
}

impl Cells {
    /// Number of cells.
    #[inline]
    pub fn count(self) -> usize {
        self.per_edge * self.per_edge
    }

    /// The cell that holds the point with barycentric weights `w`; points outside count as on the border.
    #[inline]
    pub fn index_of(self, w: DVec2) -> usize {
        let k = self.per_edge;
        if k == 1 {
            return 0;
        }
        let (x, y) = (w.x.max(0.0) * k as f64, w.y.max(0.0) * k as f64);
        let row = (y as usize).min(k - 1);
        let column = (x as usize).min(k - 1 - row);
        let turned = (x - column as f64) + (y - row as f64) > 1.0 && column + 1 < k - row;
        row * (2 * k - row) + 2 * column + usize::from(turned)
    }

    /// Barycentric weights of the three corners of a cell.
    #[inline]
    pub fn corners(self, index: usize) -> [DVec2; 3] {
        let k = self.per_edge;
        // Rows before row r hold r (2k - r) cells.
        let mut row = (k as f64 - ((k * k - index) as f64).sqrt()) as usize;
        while row > 0 && row * (2 * k - row) > index {
            row -= 1;
        }
        while row + 1 < k && (row + 1) * (2 * k - row - 1) <= index {
            row += 1;
        }
        let in_row = index - row * (2 * k - row);
        let (column, turned) = (in_row / 2, in_row % 2 == 1);
        let at = |x: usize, y: usize| DVec2::new(x as f64, y as f64) / k as f64;
        if turned {
            [at(column + 1, row + 1), at(column, row + 1), at(column + 1, row)]
        } else {
            [at(column, row), at(column + 1, row), at(column, row + 1)]
        }
    }

    /// Barycentric weights in the triangle of the point with weights `w` in a cell.
    #[inline]
    pub fn inside(self, index: usize, w: Vec2) -> DVec2 {
        let w = w.as_dvec2();
        if self.per_edge == 1 {
            return w;
        }
        let [a, b, c] = self.corners(index);
        a + (b - a) * w.x + (c - a) * w.y
    }

    /// Barycentric weights of the middle of a cell.
    #[inline]
    pub fn middle(self, index: usize) -> DVec2 {
        let [a, b, c] = self.corners(index);
        (a + b + c) / 3.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_is_found_again_and_all_have_the_same_area() {
        for per_edge in [1, 2, 3, 7, 64] {
            let cells = Cells { per_edge };
            for index in 0..cells.count() {
                let [a, b, c] = cells.corners(index);
                let area = 0.5 * (b - a).perp_dot(c - a);
                assert!((area * 2.0 * cells.count() as f64 - 1.0).abs() < 1e-9, "cell {index} of {per_edge}²: area {area}");
                assert_eq!(cells.index_of(cells.middle(index)), index, "cell {index} of {per_edge}²");
            }
        }
    }

    #[test]
    fn corners_of_the_triangle_lie_in_some_cell() {
        let cells = Cells { per_edge: 5 };
        for w in [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::new(0.5, 0.5), DVec2::new(-1e-9, 1.0), DVec2::new(0.7, 0.4)] {
            assert!(cells.index_of(w) < cells.count(), "{w}");
        }
    }
}
