//! Error against run time: scenes × methods × budgets × seeds, measured one after another and judged by references.
//!
//! A [`Plan`] says what is to be measured, [`run`] measures it. Every run is a process of its own, so that its time, its memory peak and
//! its crashes are its own, and nothing runs beside it. What a finished experiment leaves in its folder: `rows.csv` (one [`Row`] a
//! picture), `images/` (the pictures), `reports/` (what the runs said), `references/`, `experiment.json` (plan, machine, references:
//! [`Outcome`] without the rows), plots and a page.

mod child;
mod environment;
mod external;
mod job;
mod judge;
mod own;
mod pass_one;
pub mod plan;
pub mod report;
pub mod row;
mod run;
mod store;

pub use environment::program;
pub use judge::JudgeError;
pub use plan::{Plan, PlanError, Reading, Verdict};
pub use row::{Outcome, Row, RowKind, SceneRecord, Status};
pub use run::{Event, Experiment, ExperimentError, Finished, run};
pub use store::StoreError;
