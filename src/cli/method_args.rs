//! Flags of single methods. A method that does not know a flag does not look at it.

use super::values::{parse_from_zero, parse_heuristic};
use twopass::integrator::bidirectional::Heuristic;

/// Flags that only single methods know.
#[derive(Debug, clap::Args)]
pub struct MethodArgs {
    /// whitted-only: radiance that stands for all light between surfaces, irradiance over pi [W/(m² sr)]; default: 0
    #[arg(long, value_name = "L", value_parser = parse_from_zero, allow_hyphen_values = true, help_heading = "Single methods")]
    pub ambient: Option<f64>,
    /// bidirectional: how the ways to make a path share it: power (the default), balance
    #[arg(long, value_name = "NAME", value_parser = parse_heuristic, help_heading = "Single methods")]
    pub heuristic: Option<Heuristic>,
}
