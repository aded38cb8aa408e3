//! From rows to curves of error against time, and from curves to the figures of the tables.

use super::analysis::{self, Point, Prediction, Reach, Slope};
use crate::experiment::{Row, RowKind, Status};
use serde::Serialize;
use std::collections::BTreeMap;

/// Most columns of a table: more are hard to read on a screen and do not fit on paper.
const MAX_COLUMNS: usize = 7;

/// Which seconds are counted. Loading never is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// CPU time of everything after loading.
    Cpu,
    /// The same without the ray engine's tree.
    CpuWithoutTree,
    /// The same without pass one.
    CpuWithoutPassOne,
    /// CPU time of pass two alone.
    CpuPassTwo,
    /// CPU time of pass one's solver alone.
    CpuSolver,
    /// No time: products with the form factors that the solver took, each about as long as any other.
    Products,
    /// Wall time of everything after loading.
    Wall,
}

impl Clock {
    /// All clocks, the first being the default.
    pub const ALL: [Clock; 7] = [
        Clock::Cpu,
        Clock::CpuWithoutTree,
        Clock::CpuWithoutPassOne,
        Clock::CpuPassTwo,
        Clock::CpuSolver,
        Clock::Products,
        Clock::Wall,
    ];

    /// True if it says something about one of the rows that it does not say of all of them.
    pub fn tells(self, rows: &[Row]) -> bool {
        match self {
            Clock::CpuSolver => rows.iter().any(|row| row.solve_cpu_s.is_some() && row.kind == RowKind::PassOne),
            Clock::Products => rows.iter().any(|row| row.products.is_some() && row.kind == RowKind::PassOne),
            _ => true,
        }
    }

    /// Name in the page's data.
    pub fn key(self) -> &'static str {
        match self {
            Clock::Cpu => "cpu",
            Clock::CpuWithoutTree => "cpu-without-tree",
            Clock::CpuWithoutPassOne => "cpu-without-pass-one",
            Clock::CpuPassTwo => "cpu-pass-two",
            Clock::CpuSolver => "cpu-solver",
            Clock::Products => "products",
            Clock::Wall => "wall",
        }
    }

    /// Its axis in plots.
    pub fn axis(self) -> &'static str {
        match self {
            Clock::Cpu => "CPU time [s]",
            Clock::CpuWithoutTree => "CPU time without tree [s]",
            Clock::CpuWithoutPassOne => "CPU time without pass one [s]",
            Clock::CpuPassTwo => "CPU time of pass two [s]",
            Clock::CpuSolver => "CPU time of the solver [s]",
            Clock::Products => "products with the form factors",
            Clock::Wall => "wall time [s]",
        }
    }

    /// Seconds of a row. What a method does not tell apart stays counted.
    pub fn seconds(self, row: &Row) -> f64 {
        let (tree, pass_one) = (row.tree_cpu_s.unwrap_or(0.0), row.pass_one_cpu_s.unwrap_or(0.0));
        match self {
            Clock::Cpu => row.cpu_s,
            Clock::CpuWithoutTree => row.cpu_s - tree,
            Clock::CpuWithoutPassOne => row.cpu_s - pass_one,
            Clock::CpuPassTwo => row.cpu_s - tree - pass_one,
            Clock::CpuSolver => row.solve_cpu_s.unwrap_or(row.cpu_s),
            Clock::Products => row.products.map_or(1.0, |n| n as f64),
            Clock::Wall => row.wall_s,
        }
    }
}

/// An error that curves are drawn of.
#[derive(Debug, Clone, Copy)]
pub struct Metric {
    /// Name as `twopass compare` prints it.
    pub key: &'static str,
    /// True if it falls as the inverse of time for an unbiased method; false if as the inverse root.
    pub squared: bool,
    /// Value of a row.
    pub value: fn(&Row) -> Option<f64>,
    /// What the method predicted for it.
    pub predicted: fn(&Row) -> Option<f64>,
}

/// All errors that curves are drawn of, the first being the default.
pub const METRICS: [Metric; 6] = [
    Metric { key: "relmse", squared: true, value: |r| r.relmse, predicted: |r| r.predicted_relmse },
    Metric { key: "trimmed_relmse", squared: true, value: |r| r.trimmed_relmse, predicted: |_| None },
    Metric { key: "relmse_off_emitters", squared: true, value: |r| r.relmse_off_emitters, predicted: |_| None },
    Metric { key: "block9_rms", squared: false, value: |r| r.block9_rms, predicted: |_| None },
    Metric { key: "flip_ldr", squared: false, value: |r| r.flip_ldr, predicted: |_| None },
    Metric { key: "flip_hdr", squared: false, value: |r| r.flip_hdr, predicted: |_| None },
];

/// The floor of a metric, in its own unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BiasFloor {
    /// What stays however long the method runs.
    pub value: f64,
    /// Upper end of its 95 % interval.
    pub upper: f64,
    /// True if the interval leaves out 0.
    pub distinguishable: bool,
    /// Points that were fitted.
    pub points: usize,
}

/// One method in one scene by one metric and one clock.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Curve {
    /// Index of the method.
    pub method: usize,
    /// Medians over seeds and repeats, in ascending time.
    pub points: Vec<Point>,
    /// Time to reach each of [`Chart::levels`].
    pub reach: Vec<Reach>,
    /// Error at each of [`Chart::times`].
    pub error_at: Vec<Option<f64>>,
    /// Convergence over the last decade of time.
    pub slope: Option<Slope>,
    /// Bias floor, fitted against the time of pass two whatever the clock: only that makes the picture less noisy.
    pub floor: Option<BiasFloor>,
    /// Squared error × seconds of the last point: what a picture costs.
    pub cost: Option<f64>,
    /// Rows whose error was not positive, so that no logarithm shows them.
    pub below_noise: usize,
}

/// All curves of one scene by one metric and one clock.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chart {
    /// Errors at the head of the table of times.
    pub levels: Vec<f64>,
    /// Times at the head of the table of errors [s].
    pub times: Vec<f64>,
    /// A curve for each method that has this metric here.
    pub curves: Vec<Curve>,
}

/// Rows of one scene and method, grouped by budget: what one point of a curve is made from.
type Groups = BTreeMap<(String, usize), Vec<usize>>;

/// The chart of one scene, or `None` if no row has the metric.
///
/// `methods` is the order of the methods; rows of other scenes are ignored.
pub fn chart(rows: &[Row], scene: &str, methods: &[String], metric: &Metric, clock: Clock) -> Option<Chart> {
    let of_method = |(index, name): (usize, &String)| curve(rows, &groups(rows, scene, name), index, metric, clock);
    let mut curves: Vec<Curve> = methods.iter().enumerate().filter_map(of_method).collect();
    let points = || curves.iter().flat_map(|c| &c.points);
    let [low, high] = analysis::range(points().map(|p| p.error).filter(|e| *e > 0.0))?;
    let [first, last] = analysis::range(points().map(|p| p.time))?;
    let levels: Vec<f64> = thin(analysis::half_decades(low, high)).into_iter().rev().collect();
    let times = thin(analysis::half_decades(first, last));
    for curve in &mut curves {
        curve.reach = levels.iter().map(|&level| analysis::reach(&curve.points, level)).collect();
        curve.error_at = times.iter().map(|&time| analysis::error_at(&curve.points, time)).collect();
    }
    Some(Chart { levels, times, curves })
}

/// Whole decades if halves are too many, then every second of them and so on.
fn thin(mut values: Vec<f64>) -> Vec<f64> {
    while values.len() > MAX_COLUMNS {
        let keep_odd = values.len().is_multiple_of(2);
        values = values.into_iter().enumerate().filter(|(i, _)| (i % 2 == 1) == keep_odd).map(|(_, v)| v).collect();
    }
    values
}

/// Rows of one scene and method by budget. Several pictures of one run under one budget are told apart by their order.
fn groups(rows: &[Row], scene: &str, method: &str) -> Groups {
    let mut seen: BTreeMap<(&str, u64, u32), usize> = BTreeMap::new();
    let mut groups = Groups::new();
    for (i, row) in rows.iter().enumerate() {
        if row.scene == scene && row.method == method && row.status == Status::Done {
            let nth = seen.entry((&row.budget, row.seed, row.repeat)).or_default();
            groups.entry((row.budget.clone(), *nth)).or_default().push(i);
            *nth += 1;
        }
    }
    groups
}

fn curve(rows: &[Row], groups: &Groups, method: usize, metric: &Metric, clock: Clock) -> Option<Curve> {
    let points = points(rows, groups, metric, clock);
    let last = points.last()?;
    let cost = (last.error > 0.0).then(|| if metric.squared { last.error } else { last.error.powi(2) } * last.time);
    let below_noise =
        points.iter().flat_map(|p| &p.rows).filter(|&&i| (metric.value)(&rows[i]).is_some_and(|e| e <= 0.0)).count();
    Some(Curve {
        method,
        slope: analysis::slope(&points, &runs(rows, &points, metric, clock)),
        floor: bias_floor(rows, groups, metric),
        cost,
        below_noise,
        points,
        reach: Vec::new(),
        error_at: Vec::new(),
    })
}

fn points(rows: &[Row], groups: &Groups, metric: &Metric, clock: Clock) -> Vec<Point> {
    let measured = |i: &usize| {
        let seconds = clock.seconds(&rows[*i]);
        seconds > 0.0 && seconds.is_finite() && (metric.value)(&rows[*i]).is_some_and(f64::is_finite)
    };
    let point = |group: &Vec<usize>| {
        let rows_of: Vec<usize> = group.iter().copied().filter(measured).collect();
        let times = || rows_of.iter().map(|&i| clock.seconds(&rows[i]));
        let errors = || rows_of.iter().filter_map(|&i| (metric.value)(&rows[i]));
        Some(Point {
            time: analysis::median(times())?,
            times: analysis::range(times())?,
            error: analysis::median(errors())?,
            errors: analysis::range(errors())?,
            predicted: analysis::median(rows_of.iter().filter_map(|&i| (metric.predicted)(&rows[i]))),
            rows: rows_of,
        })
    };
    let mut points: Vec<Point> = groups.values().filter_map(point).collect();
    points.sort_by(|a, b| a.time.total_cmp(&b.time));
    points
}

/// The single runs behind a curve as (time, error), one for each seed and repeat.
fn runs(rows: &[Row], points: &[Point], metric: &Metric, clock: Clock) -> Vec<Vec<(f64, f64)>> {
    let mut runs: BTreeMap<(u64, u32), Vec<(f64, f64)>> = BTreeMap::new();
    for row in points.iter().flat_map(|p| &p.rows).map(|&i| &rows[i]) {
        let error = (metric.value)(row).unwrap_or(f64::NAN);
        runs.entry((row.seed, row.repeat)).or_default().push((clock.seconds(row), error));
    }
    runs.into_values().collect()
}

fn bias_floor(rows: &[Row], groups: &Groups, metric: &Metric) -> Option<BiasFloor> {
    let mut points = points(rows, groups, metric, Clock::CpuPassTwo);
    // The law floor + c/t is one of squared errors.
    if !metric.squared {
        points.iter_mut().for_each(|p| p.error *= p.error.abs());
    }
    let fit = analysis::floor(&points)?;
    let unit = |value: f64| if metric.squared { value } else { value.sqrt() };
    Some(BiasFloor { value: unit(fit.floor), upper: unit(fit.upper), distinguishable: fit.distinguishable, points: fit.points })
}

/// Predicted against measured relmse of each method, over all scenes or one; `None` for those that do not predict.
pub fn predictions(rows: &[Row], scene: &str, methods: &[String]) -> Vec<Option<Prediction>> {
    let of_method = |method: &String| {
        let counts = |r: &&Row| r.scene == scene && r.method == *method && r.status == Status::Done;
        analysis::prediction(rows.iter().filter(counts).filter_map(|r| Some((r.predicted_relmse?, r.relmse?))))
    };
    methods.iter().map(of_method).collect()
}
