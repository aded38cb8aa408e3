//! The error that is left however long a method runs.

use super::Point;
use serde::Serialize;

/// Huber's constant: residuals beyond this many scales lose weight; 95 % efficiency for normal ones [Huber64].
const HUBER: f64 = 1.345;

/// From the median absolute deviation to a standard deviation of normal residuals.
const MAD_TO_SIGMA: f64 = 1.4826;

/// Smallest relative scatter that is believed: measured errors have no more digits.
const SMALLEST_SCATTER: f64 = 1e-9;

/// Rounds of reweighting; the weights settle within about ten.
const ROUNDS: usize = 30;

/// Student's t at 97.5 % by degrees of freedom from 1 [Student08].
const T_975: [f64; 10] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];

/// A fit of error = floor + scale / time. For a squared error (relmse) the floor is squared bias, the rest variance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Floor {
    /// The error that stays, at least 0.
    pub floor: f64,
    /// Error × seconds of the part that vanishes, at least 0.
    pub scale: f64,
    /// Standard error of the floor.
    pub se: f64,
    /// Upper end of the floor's 95 % interval.
    pub upper: f64,
    /// True if the interval leaves out 0.
    pub distinguishable: bool,
    /// Points of the curve that were fitted.
    pub points: usize,
}

/// Fits error = floor + scale / time to a curve by robust least squares of *relative* residuals, both parameters not negative.
///
/// Relative, since errors span decades and scatter in proportion; robust by Huber's weights [Huber64]. `None` with fewer than
/// three positive points or less than a factor of 2 between first and last time.
pub fn floor(points: &[Point]) -> Option<Floor> {
    let points: Vec<(f64, f64)> = points.iter().filter(|p| p.error > 0.0).map(|p| (p.time, p.error)).collect();
    if points.len() < 3 || points[points.len() - 1].0 < 2.0 * points[0].0 {
        return None;
    }
    // Residual of a point: floor / e + scale / (t e) - 1.
    let rows: Vec<[f64; 2]> = points.iter().map(|(t, e)| [1.0 / e, 1.0 / (t * e)]).collect();
    let mut weights = vec![1.0; rows.len()];
    let mut fit = Fit::new(&rows, &weights);
    for _ in 0..ROUNDS {
        let residuals = fit.residuals(&rows);
        let scale = scatter(&residuals);
        weights = residuals.iter().map(|r| (HUBER * scale / r.abs()).min(1.0)).collect();
        fit = Fit::new(&rows, &weights);
    }
    let freedom = rows.len() - 2;
    let weighted = fit.residuals(&rows).iter().zip(&weights).map(|(r, w)| w * r * r).sum::<f64>();
    let sigma = (weighted / freedom as f64).sqrt().max(SMALLEST_SCATTER);
    let se = sigma * fit.unit_variance(&rows, &weights).sqrt();
    let reach = t_975(freedom) * se;
    let distinguishable = fit.floor > reach;
    Some(Floor { floor: fit.floor, scale: fit.scale, se, upper: fit.floor + reach, distinguishable, points: rows.len() })
}

/// Robust standard deviation of residuals about 0.
fn scatter(residuals: &[f64]) -> f64 {
    let deviation = super::median(residuals.iter().map(|r| r.abs())).unwrap_or(0.0);
    (MAD_TO_SIGMA * deviation).max(SMALLEST_SCATTER)
}

fn t_975(freedom: usize) -> f64 {
    // Beyond the table the quantile is 1.96 + 2.4 / freedom to 1 % (Cornish-Fisher, first term).
    T_975.get(freedom.saturating_sub(1)).copied().unwrap_or(1.96 + 2.4 / freedom as f64)
}

struct Fit {
    floor: f64,
    scale: f64,
}

impl Fit {
    /// Weighted least squares with both parameters at least 0: the free optimum, or the best on the border.
    fn new(rows: &[[f64; 2]], weights: &[f64]) -> Self {
        let [a, b, c] = normal_matrix(rows, weights);
        let sum = |i: usize| rows.iter().zip(weights).map(|(row, w)| w * row[i]).sum::<f64>();
        let (u, v) = (sum(0), sum(1));
        let determinant = a * c - b * b;
        let free = Fit { floor: (c * u - b * v) / determinant, scale: (a * v - b * u) / determinant };
        if free.floor >= 0.0 && free.scale >= 0.0 {
            return free;
        }
        let borders = [Fit { floor: 0.0, scale: v / c }, Fit { floor: u / a, scale: 0.0 }];
        let cost = |fit: &Fit| fit.residuals(rows).iter().zip(weights).map(|(r, w)| w * r * r).sum::<f64>();
        let [no_floor, only_floor] = borders;
        if cost(&no_floor) <= cost(&only_floor) { no_floor } else { only_floor }
    }

    fn residuals(&self, rows: &[[f64; 2]]) -> Vec<f64> {
        rows.iter().map(|row| self.floor * row[0] + self.scale * row[1] - 1.0).collect()
    }

    /// Variance of the floor for residuals of variance 1.
    fn unit_variance(&self, rows: &[[f64; 2]], weights: &[f64]) -> f64 {
        let [a, b, c] = normal_matrix(rows, weights);
        c / (a * c - b * b)
    }
}

/// Upper triangle of the weighted normal matrix.
fn normal_matrix(rows: &[[f64; 2]], weights: &[f64]) -> [f64; 3] {
    let sum = |i: usize, j: usize| rows.iter().zip(weights).map(|(row, w)| w * row[i] * row[j]).sum::<f64>();
    [sum(0, 0), sum(0, 1), sum(1, 1)]
}
