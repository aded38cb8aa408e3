//! Stiff and extreme cases with known answers, run as a suite on the user's own machine.
//!
//! Each [`Row`] states a law, what it expects (a formula, or the same scene stated in another way) and what was got. Where a figure
//! converges, the row holds its error over sweeps, samples or patch size. Nothing here is compared with an earlier output.

mod cases;
pub mod enclosures;
pub mod oracle;
pub mod page;
pub mod rooms;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// How a law fared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Within its bound.
    Holds,
    /// Beyond it.
    Fails,
    /// Not checked here; the row says why.
    NotCovered,
}

impl Verdict {
    /// One word for tables.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Holds => "holds",
            Verdict::Fails => "FAILS",
            Verdict::NotCovered => "not covered",
        }
    }
}

/// Error over the work spent.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// What is counted, such as "sweeps".
    pub axis: &'static str,
    /// Work and error, both above 0.
    pub points: Vec<(f64, f64)>,
}

/// One law in one case.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Number in the catalogue, such as "B1".
    pub id: &'static str,
    /// The case.
    pub name: String,
    /// What must hold.
    pub law: String,
    /// What was expected.
    pub expected: String,
    /// What was got.
    pub got: String,
    /// The error, where there is one figure for it.
    pub error: Option<f64>,
    /// What it may be.
    pub bound: Option<f64>,
    /// How it fared.
    pub verdict: Verdict,
    /// Error over work.
    pub curve: Option<Curve>,
    /// Wall seconds since the row before.
    pub seconds: f64,
}

/// Runs the whole catalogue. `seen` is given each row as soon as it is known.
pub fn run(seen: &mut dyn FnMut(&Row)) -> Vec<Row> {
    run_cases(cases::ALL, seen)
}

/// Runs the cases whose number is one of `ids`.
pub fn run_some(ids: &[&str], seen: &mut dyn FnMut(&Row)) -> Vec<Row> {
    let chosen: Vec<Case> = cases::ALL.iter().filter(|c| ids.contains(&c.0)).copied().collect();
    run_cases(&chosen, seen)
}

/// Numbers of all cases in the catalogue, in order.
pub fn ids() -> Vec<&'static str> {
    cases::ALL.iter().map(|case| case.0).collect()
}

/// True if no row fails.
pub fn all_hold(rows: &[Row]) -> bool {
    rows.iter().all(|row| row.verdict != Verdict::Fails)
}

/// Why a case could not be carried out, which is a failure of it.
type Trouble = Box<dyn std::error::Error>;

/// A number in the catalogue and the case itself.
type Case = (&'static str, fn(&mut Rows<'_>) -> Result<(), Trouble>);

fn run_cases(cases: &[Case], seen: &mut dyn FnMut(&Row)) -> Vec<Row> {
    let mut all = Vec::new();
    for &(id, case) in cases {
        let mut rows = Rows { id, rows: Vec::new(), since: Instant::now(), seen: &mut *seen };
        // A panic is a fault of the program, but the suite has more to tell than that.
        let ended = catch_unwind(AssertUnwindSafe(|| case(&mut rows)));
        match ended {
            Ok(Ok(())) => {}
            Ok(Err(trouble)) => rows.holds("carried out", "the case can be carried out", "a result", trouble.to_string(), false),
            Err(_) => rows.holds("carried out", "no panic", "a result", "a panic".to_owned(), false),
        }
        all.append(&mut rows.rows);
    }
    all
}

/// The rows of one case as they come.
struct Rows<'a> {
    id: &'static str,
    rows: Vec<Row>,
    since: Instant,
    seen: &'a mut dyn FnMut(&Row),
}

impl Rows<'_> {
    fn push(&mut self, mut row: Row) {
        row.seconds = self.since.elapsed().as_secs_f64();
        self.since = Instant::now();
        (self.seen)(&row);
        self.rows.push(row);
    }

    fn row(&self, name: &str, law: &str) -> Row {
        Row {
            id: self.id,
            name: name.to_owned(),
            law: law.to_owned(),
            expected: String::new(),
            got: String::new(),
            error: None,
            bound: None,
            verdict: Verdict::NotCovered,
            curve: None,
            seconds: 0.0,
        }
    }

    /// A figure that must lie within `bound` of its value, relative to it; absolute where the value is 0.
    fn value(&mut self, name: &str, law: &str, expected: f64, got: f64, bound: f64) {
        let error = if expected == 0.0 { got.abs() } else { (got / expected - 1.0).abs() };
        self.error(name, law, &figure(expected), figure(got), error, bound, None);
    }

    /// An error that must not exceed `bound`.
    #[allow(clippy::too_many_arguments)]
    fn error(&mut self, name: &str, law: &str, expected: &str, got: String, error: f64, bound: f64, curve: Option<Curve>) {
        let mut row = self.row(name, law);
        // Not `error > bound`: NaN fails.
        row.verdict = if error <= bound { Verdict::Holds } else { Verdict::Fails };
        (row.expected, row.got, row.error, row.bound, row.curve) = (expected.to_owned(), got, Some(error), Some(bound), curve);
        self.push(row);
    }

    /// Something that is so or not.
    fn holds(&mut self, name: &str, law: &str, expected: &str, got: String, is_so: bool) {
        let mut row = self.row(name, law);
        row.verdict = if is_so { Verdict::Holds } else { Verdict::Fails };
        (row.expected, row.got) = (expected.to_owned(), got);
        self.push(row);
    }

    /// Something that is not checked here.
    #[cfg_attr(not(test), expect(dead_code, reason = "all that the catalogue asks of these cases is checked at present"))]
    fn not_covered(&mut self, name: &str, law: &str, reason: &str) {
        let mut row = self.row(name, law);
        row.got = reason.to_owned();
        self.push(row);
    }
}

/// A figure for tables.
fn figure(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) { format!("{value:.7}") } else { format!("{value:.4e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdicts(case: fn(&mut Rows<'_>) -> Result<(), Trouble>) -> Vec<Verdict> {
        run_cases(&[("B0", case)], &mut |_| {}).iter().map(|row| row.verdict).collect()
    }

    #[test]
    fn only_what_is_within_its_bound_holds() {
        let verdicts = verdicts(|rows| {
            rows.value("within", "", 2.0, 2.0 + 1e-7, 1e-6);
            rows.value("beyond", "", 2.0, 2.1, 1e-6);
            rows.value("no number", "", 2.0, f64::NAN, 1e-6);
            rows.value("exactly 0", "", 0.0, 1e-300, 0.0);
            rows.not_covered("later", "", "why");
            Ok(())
        });
        assert_eq!(verdicts, [Verdict::Holds, Verdict::Fails, Verdict::Fails, Verdict::Fails, Verdict::NotCovered]);
    }

    #[test]
    fn a_case_that_ends_with_an_error_or_a_panic_fails_and_the_rest_goes_on() {
        assert_eq!(verdicts(|_| Err("trouble".into())), [Verdict::Fails]);
        assert_eq!(verdicts(|_| std::panic::panic_any("a seeded fault")), [Verdict::Fails]);
    }
}
