//! Expected values by formulas and by methods that share nothing with the renderer.

use std::f64::consts::PI;

/// Solves a dense system by Gaussian elimination with partial pivoting. `rows` are overwritten; each is a row of the matrix with its
/// right-hand side appended.
///
/// The oracle of the iterative solvers: its error is some n·ε·condition, 1e-8 at a condition of 1e6 and 400 unknowns.
pub fn solve_dense(mut rows: Vec<Vec<f64>>) -> Vec<f64> {
    let n = rows.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| rows[i][k].abs().total_cmp(&rows[j][k].abs())).unwrap_or(k);
        rows.swap(k, pivot);
        let (above, below) = rows.split_at_mut(k + 1);
        let pivot = &above[k];
        for row in below {
            let factor = row[k] / pivot[k];
            if factor != 0.0 {
                row[k..].iter_mut().zip(&pivot[k..]).for_each(|(a, p)| *a -= factor * p);
            }
        }
    }
    let mut x = vec![0.0; n];
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| rows[k][j] * x[j]).sum();
        x[k] = (rows[k][n] - known) / rows[k][k];
    }
    x
}

/// Form factor between two infinitely long strips of one width that share an edge at `angle` radians: 1 − sin(angle/2) (Hottel's
/// crossed strings; Howell C-16).
pub fn wedge(angle: f64) -> f64 {
    1.0 - (0.5 * angle).sin()
}

/// Form factor between opposite (first) and adjacent (second) faces of a cube, by quadrature of the double area integral's inner
/// contour form: the exact factor from a point to a polygon, averaged by Gauss-Legendre over `n`² points with a graded map towards the
/// shared edge.
pub fn cube_faces(n: usize) -> [f64; 2] {
    use crate::form_factor::analytic::point_to_polygon;
    use crate::math::DVec3;
    let opposite = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 1.0));
    let adjacent = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, z)| DVec3::new(x, 0.0, z));
    let nodes = gauss_legendre(n);
    let mut sums = [0.0; 2];
    for &(u, wu) in &nodes {
        for &(v, wv) in &nodes {
            // y = v⁵: the integrand has an infinite slope at the edge y = 0.
            let (y, weight) = (v.powi(5), wu * wv * 5.0 * v.powi(4));
            let point = DVec3::new(u, y, 0.0);
            sums[0] += weight * point_to_polygon(point, DVec3::Z, &opposite);
            sums[1] += weight * point_to_polygon(point, DVec3::Z, &adjacent);
        }
    }
    sums
}

/// Form factor between two strips, 1 wide and `length` long, that share a long edge at `angle` radians: the exact factor from a point
/// to a polygon, averaged over the midpoints of a grid.
pub fn finite_wedge(angle: f64, length: f64) -> f64 {
    use crate::form_factor::analytic::point_to_polygon;
    use crate::math::DVec3;
    const GRID: (usize, usize) = (2000, 64);
    let (sin, cos) = angle.sin_cos();
    let side = DVec3::new(cos, sin, 0.0);
    let along = DVec3::Z * length;
    let other = [DVec3::ZERO, along, side + along, side];
    let at = |i: usize, j: usize| {
        let (x, z) = ((i as f64 + 0.5) / GRID.0 as f64, (j as f64 + 0.5) / GRID.1 as f64);
        point_to_polygon(DVec3::new(x, 0.0, z * length), DVec3::Y, &other)
    };
    let sum: f64 = (0..GRID.0).map(|i| (0..GRID.1).map(|j| at(i, j)).sum::<f64>()).sum();
    sum / (GRID.0 * GRID.1) as f64
}

/// Nodes and weights on [0, 1], by Newton's method on the Legendre polynomials.
fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    let node = |i: usize| {
        let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..60 {
            let (mut p, mut before) = (1.0, 0.0);
            for k in 1..=n {
                (p, before) = (((2 * k - 1) as f64 * x * p - (k - 1) as f64 * before) / k as f64, p);
            }
            slope = n as f64 * (x * p - before) / (x * x - 1.0);
            x -= p / slope;
        }
        (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..n).map(node).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::form_factor::analytic::{parallel_rectangles, perpendicular_rectangles};

    #[test]
    fn elimination_solves_what_needs_pivots() {
        // 0x + y = 2, x + y = 5.
        let x = solve_dense(vec![vec![0.0, 1.0, 2.0], vec![1.0, 1.0, 5.0]]);
        assert_eq!(x, [3.0, 2.0]);
    }

    #[test]
    fn quadrature_and_closed_form_agree_on_the_cube() {
        let [opposite, adjacent] = cube_faces(40);
        assert!((opposite - parallel_rectangles(1.0, 1.0, 1.0)).abs() < 1e-9, "{opposite}");
        assert!((adjacent - perpendicular_rectangles(1.0, 1.0, 1.0)).abs() < 1e-7, "{adjacent}");
    }
}
