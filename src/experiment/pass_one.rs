//! The error of a solution of pass one: its irradiance at points of the surfaces against that of a fine solution.
//!
//! The points are drawn by area and are the same for any patches ([`crate::pipeline::surface_points`]), so a mean over them is
//! area-weighted. What is measured is all that pass one does at once: the size of its patches, the noise of its form factors, the solver.

use std::path::Path;

/// Irradiance at the points; `None` in a gap between patches.
pub type Solution = Vec<Option<[f64; 3]>>;

/// Reads what `solve --irradiance` wrote.
///
/// # Errors
/// A sentence if it is not there or damaged.
pub fn read(path: &Path) -> Result<Solution, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("no irradiance: {error}"))?;
    let damaged = |n: usize| format!("{}:{}: expected nine columns", path.display(), n + 1);
    text.lines()
        .enumerate()
        .skip(1)
        .map(|(n, line)| {
            let cells: Vec<&str> = line.split(',').collect();
            let [.., r, g, b] = cells[..] else { return Err(damaged(n)) };
            if cells.len() != 9 {
                return Err(damaged(n));
            }
            if r.is_empty() {
                return Ok(None);
            }
            let number = |cell: &str| cell.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| damaged(n));
            Ok(Some([number(r)?, number(g)?, number(b)?]))
        })
        .collect()
}

/// Squared relative error in the area-weighted mean square: sum of (H−A)(H−B) over sum of AB, over points and channels. With two
/// reference solutions of independent noise the numerator's mean has none of it. Also the mean of H over that of (A+B)/2, per channel.
///
/// # Errors
/// A sentence if the solutions are of different points or there is no light.
pub fn error(found: &Solution, a: &Solution, b: &Solution) -> Result<(f64, [f64; 3]), String> {
    if found.len() != a.len() || a.len() != b.len() {
        return Err(format!("{} points, the reference solutions have {} and {}", found.len(), a.len(), b.len()));
    }
    let (mut squared, mut power) = (0.0, 0.0);
    let (mut mine, mut theirs) = ([0.0; 3], [0.0; 3]);
    for at in found.iter().zip(a).zip(b) {
        let ((Some(h), Some(a)), Some(b)) = at else { continue };
        for c in 0..3 {
            squared += (h[c] - a[c]) * (h[c] - b[c]);
            power += a[c] * b[c];
            mine[c] += h[c];
            theirs[c] += 0.5 * (a[c] + b[c]);
        }
    }
    if power <= 0.0 {
        return Err("no light falls on any of the points".to_owned());
    }
    Ok((squared / power, std::array::from_fn(|c| if mine[c] == theirs[c] { 1.0 } else { mine[c] / theirs[c] })))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: H = (2, 0, 1), A = (1, 0, 1), B = (1, 1, 1) at one point, and a gap that does not count.
    #[test]
    fn the_error_is_a_cross_product_over_points() {
        let one = |v: [f64; 3]| vec![Some(v), Some([7.0; 3])];
        let (mut found, a, b) = (one([2.0, 0.0, 1.0]), one([1.0, 0.0, 1.0]), one([1.0, 1.0, 1.0]));
        found[1] = None;
        let (error, mean) = error(&found, &a, &b).unwrap();
        // (1·1 + 0·(-1) + 0) / (1 + 0 + 1).
        assert_eq!(error, 0.5);
        assert_eq!(mean, [2.0, 0.0, 1.0]);
    }

    #[test]
    fn a_table_is_read_with_its_gaps() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("h.csv");
        std::fs::write(&path, "x,y,z,nx,ny,nz,r,g,b\n0,0,0,0,0,1,1,2,3\n0,0,0,0,0,1,,,\n").unwrap();
        assert_eq!(read(&path).unwrap(), [Some([1.0, 2.0, 3.0]), None]);
        std::fs::write(&path, "header\n1,2,3\n").unwrap();
        assert!(read(&path).unwrap_err().contains("h.csv:2:"));
    }
}
