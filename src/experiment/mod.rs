//! Error against run time: scenes × methods × budgets × seeds, measured one after another and judged by references.
//!
//! What a finished experiment leaves in its folder: `rows.csv` (one [`Row`] a picture), the pictures, `experiment.json` (plan,
//! machine, references: [`Outcome`] without the rows), plots and a page.

pub mod report;
pub mod row;

pub use row::{Outcome, Row, SceneRecord, Status};
