//! Flags of `twopass form-factors`.

use super::SceneArgs;
use crate::cli::values::{parse_form_factors, parse_positive};
use clap::ValueEnum;
use std::path::PathBuf;
use twopass::form_factor::FormFactorMethod;

/// `twopass form-factors`.
#[derive(Debug, clap::Args)]
pub struct FormFactorsArgs {
    /// Scene file, or a folder with a scene.xml
    pub scene: PathBuf,
    /// Write the table there (CSV); default: stdout
    #[arg(short, long, value_name = "F.csv")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub source: SceneArgs,
    /// What the rows are: shapes by their id (the back of a two-sided one for itself), or patches
    #[arg(long, value_name = "WHAT", default_value = "shape")]
    pub by: GroupingName,
    /// How they are computed: analytic (pair by pair, exact where nothing stands between flat shapes), hemicube, ray-cast
    #[arg(long, value_name = "METHOD", default_value = "analytic", value_parser = parse_form_factors)]
    pub form_factors: FormFactorMethod,
    /// Error allowed to a form factor: analytic, relative to the unobstructed one (default 0.001); others, its standard error
    /// (default 0.0221)
    #[arg(long, value_name = "T", value_parser = parse_positive, allow_hyphen_values = true)]
    pub tolerance: Option<f64>,
    /// Edge length of a patch in scene units; default: a few thousand patches in all
    #[arg(long, value_name = "LENGTH", value_parser = parse_positive, allow_hyphen_values = true)]
    pub patch_size: Option<f64>,
}

/// What form factors are listed by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GroupingName {
    /// Shapes.
    Shape,
    /// Patches.
    Patch,
}
