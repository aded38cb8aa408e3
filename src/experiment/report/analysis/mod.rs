//! What curves of error against time tell: medians, crossings, slopes and floors. Pure functions of numbers.
//!
//! A curve is a list of [`Point`]s in ascending time [s]. Errors are as `twopass compare` prints them and may be negative: the
//! picture is then closer to the truth than the references can tell, and no logarithm of it is taken.

mod floor;

pub use floor::{Floor, floor};
use serde::Serialize;

/// Part of the run time over which a slope is measured: the last decade.
const SLOPE_RANGE: f64 = 10.0;

/// Rounding allowed when times of nominally the same budget are compared with the ends of a range.
const TIME_ROUNDING: f64 = 1.0 + 1e-9;

/// The runs of one method with one budget.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Point {
    /// Median time [s].
    pub time: f64,
    /// Shortest and longest time [s].
    pub times: [f64; 2],
    /// Median error.
    pub error: f64,
    /// Smallest and largest error.
    pub errors: [f64; 2],
    /// Median of the errors that the method predicted for itself.
    pub predicted: Option<f64>,
    /// Indices of the rows behind it.
    pub rows: Vec<usize>,
}

/// When a curve comes to an error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Reach {
    /// Interpolated between two measured points.
    At {
        /// Seconds.
        time: f64,
    },
    /// The first measured picture is better already.
    Before {
        /// Seconds of that picture.
        time: f64,
    },
    /// The last measured picture is worse. Nothing is extrapolated.
    Not,
}

/// A slope d log(error) / d log(time).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Slope {
    /// The slope.
    pub value: f64,
    /// Its standard error, if there are enough points.
    pub se: Option<f64>,
    /// Points of the median curve in the range.
    pub points: usize,
    /// Runs whose own slopes gave the standard error; 0 if the scatter of the medians gave it.
    pub runs: usize,
}

/// How well a method knows its own error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Prediction {
    /// Rows with both errors positive.
    pub count: usize,
    /// Median of predicted / measured.
    pub factor: f64,
    /// Share of the rows within a factor of 2 either way.
    pub within_2: f64,
    /// Within a factor of 4.
    pub within_4: f64,
}

/// The middle value, or the mean of the middle two. NaN is left out.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().filter(|v| !v.is_nan()).collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        n if n % 2 == 1 => Some(values[middle]),
        _ => Some(0.5 * (values[middle - 1] + values[middle])),
    }
}

/// Smallest and largest value.
pub fn range(values: impl IntoIterator<Item = f64>) -> Option<[f64; 2]> {
    values.into_iter().filter(|v| v.is_finite()).fold(None, |range, v| match range {
        None => Some([v, v]),
        Some([low, high]) => Some([v.min(low), v.max(high)]),
    })
}

/// When the median comes to an error *and stays there*: the last crossing, on a straight line between logarithms.
///
/// A step down to a negative error is counted at its end.
pub fn reach(points: &[Point], level: f64) -> Reach {
    let Some(last) = points.last() else { return Reach::Not };
    if last.error > level {
        return Reach::Not;
    }
    match points.iter().rposition(|p| p.error > level) {
        None => Reach::Before { time: points[0].time },
        Some(i) => Reach::At { time: crossing(&points[i], &points[i + 1], level) },
    }
}

fn crossing(above: &Point, below: &Point, level: f64) -> f64 {
    if below.error <= 0.0 {
        return below.time;
    }
    let share = (above.error / level).ln() / (above.error / below.error).ln();
    (above.time.ln() + share * (below.time / above.time).ln()).exp()
}

/// Median error at a time [s], on a straight line between logarithms; `None` outside the measured range or beside a negative error.
pub fn error_at(points: &[Point], time: f64) -> Option<f64> {
    let (first, last) = (points.first()?, points.last()?);
    if time * TIME_ROUNDING < first.time || time > last.time * TIME_ROUNDING {
        return None;
    }
    let after = points.iter().position(|p| p.time >= time).unwrap_or(points.len() - 1);
    let (a, b) = (&points[after.saturating_sub(1)], &points[after]);
    if a.time == b.time || time >= b.time {
        return (b.error > 0.0).then_some(b.error);
    }
    if a.error <= 0.0 || b.error <= 0.0 {
        return None;
    }
    let share = ((time / a.time).ln() / (b.time / a.time).ln()).max(0.0);
    Some((a.error.ln() + share * (b.error / a.error).ln()).exp())
}

/// Slope over the last decade of time: least squares on the logarithms of the medians.
///
/// `runs` are the single runs behind the medians as (time, error). If at least three of them have two points there, the standard
/// error comes from the scatter of their own slopes, since pictures of one run share its samples and hide part of the scatter.
pub fn slope(points: &[Point], runs: &[Vec<(f64, f64)>]) -> Option<Slope> {
    let last = points.last()?.time;
    let medians: Vec<(f64, f64)> = points.iter().map(|p| (p.time, p.error)).collect();
    let (value, residual_se, points) = log_line(&medians, last)?;
    let own: Vec<f64> = runs.iter().filter_map(|run| Some(log_line(run, last)?.0)).collect();
    if own.len() < 3 {
        return Some(Slope { value, se: residual_se, points, runs: 0 });
    }
    let n = own.len() as f64;
    let mean = own.iter().sum::<f64>() / n;
    let variance = own.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0);
    Some(Slope { value, se: Some((variance / n).sqrt()), points, runs: own.len() })
}

/// Slope, its standard error from residuals and the number of points, of those in the decade before `last`.
fn log_line(points: &[(f64, f64)], last: f64) -> Option<(f64, Option<f64>, usize)> {
    let in_range = |&&(time, error): &&(f64, f64)| time * SLOPE_RANGE * TIME_ROUNDING >= last && error > 0.0;
    let logs: Vec<(f64, f64)> = points.iter().filter(in_range).map(|(t, e)| (t.ln(), e.ln())).collect();
    let n = logs.len() as f64;
    let mean = |get: fn(&(f64, f64)) -> f64| logs.iter().map(get).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let sxx: f64 = logs.iter().map(|p| (p.0 - x).powi(2)).sum();
    // Two pictures at nearly the same time have no slope between them.
    if logs.len() < 2 || sxx < 0.05 {
        return None;
    }
    let slope = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / sxx;
    let residuals: f64 = logs.iter().map(|p| (p.1 - y - slope * (p.0 - x)).powi(2)).sum();
    let se = (logs.len() > 2).then(|| (residuals / (n - 2.0) / sxx).sqrt());
    Some((slope, se, logs.len()))
}

/// Compares (predicted, measured) errors; pairs that are not both positive are left out.
pub fn prediction(pairs: impl IntoIterator<Item = (f64, f64)>) -> Option<Prediction> {
    let positive = |&(p, m): &(f64, f64)| p > 0.0 && m > 0.0;
    let factors: Vec<f64> = pairs.into_iter().filter(positive).map(|(p, m)| p / m).collect();
    let share = |limit: f64| factors.iter().filter(|f| **f <= limit && **f >= 1.0 / limit).count() as f64 / factors.len() as f64;
    let factor = median(factors.iter().copied())?;
    Some(Prediction { count: factors.len(), factor, within_2: share(2.0), within_4: share(4.0) })
}

/// 1, 3, 10, 30 ... times powers of ten within [low, high], ascending.
pub fn half_decades(low: f64, high: f64) -> Vec<f64> {
    if !(low > 0.0 && high >= low && high.is_finite()) {
        return Vec::new();
    }
    let exponents = low.log10().floor() as i32..=high.log10().floor() as i32;
    // Parsed rather than multiplied: 0.3 is the double nearest to 0.3.
    let number = |digit: u8, exponent: i32| format!("{digit}e{exponent}").parse::<f64>().unwrap_or(f64::NAN);
    exponents
        .flat_map(|e| [number(1, e), number(3, e)])
        .filter(|v| *v * TIME_ROUNDING >= low && *v <= high * TIME_ROUNDING)
        .collect()
}

#[cfg(test)]
mod tests;
