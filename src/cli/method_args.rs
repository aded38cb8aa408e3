//! Flags of single methods. A method that does not know a flag does not look at it.

use super::values::{
    parse_count, parse_from_zero, parse_heuristic, parse_positive, parse_reflections, parse_share, parse_switch, parse_whole,
};
use twopass::integrator::PathFilter;
use twopass::integrator::bidirectional::Heuristic;

/// Flags that only single methods know.
#[derive(Debug, clap::Args)]
pub struct MethodArgs {
    /// whitted-only: radiance that stands for all light between surfaces, irradiance over pi [W/(m² sr)]; default: 0
    #[arg(long, value_name = "L", value_parser = parse_from_zero, allow_hyphen_values = true, help_heading = "Single methods")]
    pub ambient: Option<f64>,
    /// two-pass-planar: most mirrors in a row, 8 at most; default: 2
    #[arg(long, value_name = "N", value_parser = parse_reflections, allow_negative_numbers = true, help_heading = "Single methods")]
    pub reflections: Option<u32>,
    /// bidirectional: how the ways to make a path share it: power (the default), balance
    #[arg(long, value_name = "NAME", value_parser = parse_heuristic, help_heading = "Single methods")]
    pub heuristic: Option<Heuristic>,
    /// photon-map, sppm: photons of the first round, of each pass; default: one for each pixel
    #[arg(long, value_name = "N", value_parser = parse_count::<u32>, allow_negative_numbers = true, help_heading = "Single methods")]
    pub photons: Option<u32>,
    /// irradiance-cache: reflections between diffuse surfaces that are followed (Radiance's -ab); default: all
    #[arg(long, value_name = "N", value_parser = parse_whole::<u32>, allow_negative_numbers = true, help_heading = "Single methods")]
    pub ambient_bounces: Option<u32>,
    /// irradiance-cache: reach of a record over the mean distance that it sees, at first (-aa); default: 0.4
    #[arg(long, value_name = "A", value_parser = parse_share, allow_hyphen_values = true, help_heading = "Single methods")]
    pub ambient_accuracy: Option<f64>,
    /// irradiance-cache: rays of a record, at first (-ad); default: 64
    #[arg(long, value_name = "N", value_parser = parse_count::<u32>, allow_negative_numbers = true, help_heading = "Single methods")]
    pub ambient_divisions: Option<u32>,
    /// metropolis: chains of each half of the picture; default: 64
    #[arg(long, value_name = "N", value_parser = parse_count::<u32>, allow_negative_numbers = true, help_heading = "Single methods")]
    pub chains: Option<u32>,
    /// metropolis: probability of a large step; default: 0.1
    #[arg(long, value_name = "P", value_parser = parse_share, allow_hyphen_values = true, help_heading = "Single methods")]
    pub large_steps: Option<f64>,
    /// metropolis: steps of all chains for each bidirectional sample; default: 1
    #[arg(long, value_name = "N", value_parser = parse_positive, allow_hyphen_values = true, help_heading = "Single methods")]
    pub chain_steps: Option<f64>,
    /// metropolis: paths this many times as bright as the picture around are left to chains by half, brighter ones by more; default: 32
    #[arg(long, value_name = "B", value_parser = parse_positive, allow_hyphen_values = true, help_heading = "Single methods")]
    pub chain_brightness: Option<f64>,
    /// path: only light paths that match, such as LS+DE: L lamp, D diffuse or rough, S ideal mirror or glass, M a flat mirror, E eye
    #[arg(long, value_name = "REGEX", value_parser = PathFilter::new, allow_hyphen_values = true, help_heading = "Single methods")]
    pub paths: Option<PathFilter>,
    /// path: pixels of a tile lend each other what their paths find after the first bounce: on, off; never with --paths
    #[arg(long, value_name = "ON", default_value = "on", action = clap::ArgAction::Set, value_parser = parse_switch, help_heading = "Single methods")]
    pub path_lending: bool,
}
