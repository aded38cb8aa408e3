//! One file a subcommand.

pub mod compare;
pub mod experiment;
pub mod form_factors;
pub mod info;
pub mod probe;
pub mod render;
pub mod solve;
pub mod stability;

use super::args::{Common, PassOneArgs, PassTwoArgs};
use super::exit::Failure;
use super::output::print;
use super::values::physical_memory;
use twopass::integrator::Method;
use twopass::pipeline::{PassOneSettings, RenderSettings};

/// The table of methods.
pub fn list_methods() -> Result<(), Failure> {
    let lines = Method::ALL.map(|m| format!("{:20} {}\n", m.name(), m.describe()));
    print(&lines.concat())
}

/// Settings of pass one from its flags; the library's defaults where nothing was typed.
fn pass_one_settings(args: &PassOneArgs) -> PassOneSettings {
    let mut settings = PassOneSettings::default();
    settings.patches.patch_size = args.patch_size;
    settings.form_factors = args.form_factors;
    settings.form_factor_tolerance = args.tolerance.unwrap_or(args.form_factors.default_tolerance());
    settings.solver.solver = args.solver;
    settings.solver.tolerance = args.solver_tolerance.unwrap_or(settings.solver.tolerance);
    settings
}

/// Settings of both passes from the flags that all of their users share.
fn render_settings(common: &Common, pass_one: &PassOneArgs, pass_two: Option<&PassTwoArgs>) -> RenderSettings {
    let mut settings = RenderSettings {
        seed: common.seed,
        accel: common.accel,
        pass_one: PassOneSettings { max_memory: common.max_memory.or_else(physical_memory), ..pass_one_settings(pass_one) },
        ..RenderSettings::default()
    };
    if let Some(args) = pass_two {
        settings.read_out = args.read_out;
        settings.max_depth = args.max_depth.map(|d| d.0);
        settings.sampler = args.sampler;
        settings.gather_rays = args.gather_rays.unwrap_or(settings.gather_rays);
    }
    settings
}
