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
use super::method_args::MethodArgs;
use super::output::print;
use super::values::physical_memory;
use twopass::integrator::{Method, MethodSettings};
use twopass::pipeline::{PassOneSettings, RenderSettings};

/// The table of methods.
pub fn list_methods() -> Result<(), Failure> {
    let mut table = format!("{:18} {:19} {:10} {:16} {}\n", "method", "light paths", "error", "view", "about");
    for method in Method::ALL {
        let row = method.row();
        let view = if row.view_independent { "independent" } else { "dependent" };
        let error = row.error.name();
        table += &format!("{:18} {:19} {error:10} {view:16} {} ({})\n", row.name, row.paths, row.about, row.citation);
    }
    table += "\nLight paths from the lamp L to the eye E: D diffuse or rough, S ideal mirror or glass, M such a mirror that is flat [Heckbert90].\n";
    print(&table)
}

/// Settings of pass one from its flags; the library's defaults where nothing was typed.
fn pass_one_settings(args: &PassOneArgs) -> PassOneSettings {
    let mut settings = PassOneSettings::default();
    settings.patches.patch_size = args.patch_size;
    settings.patches.adaptive = args.adaptive;
    settings.form_factors = args.form_factors.unwrap_or_default();
    settings.form_factor_tolerance = args.tolerance.unwrap_or(settings.form_factors.default_tolerance());
    settings.solver.solver = args.solver;
    settings.solver.tolerance = args.solver_tolerance.unwrap_or(settings.solver.tolerance);
    settings
}

/// Settings of both passes from the flags that all of their users share.
fn render_settings(common: &Common, pass_one: &PassOneArgs, pass_two: Option<&PassTwoArgs>) -> RenderSettings {
    let mut settings = RenderSettings {
        seed: common.seed,
        accel: common.accel,
        plan: common.plan.into(),
        pass_one: PassOneSettings { max_memory: common.max_memory.or_else(physical_memory), ..pass_one_settings(pass_one) },
        ..RenderSettings::default()
    };
    if let Some(args) = pass_two {
        settings.read_out = args.read_out;
        settings.max_depth = args.max_depth.map(|d| d.0);
        settings.sampler = args.sampler;
        settings.image_filter = args.image_filter;
        settings.gather_rays = args.gather_rays.unwrap_or(settings.gather_rays);
    }
    settings
}

/// Settings of single methods from their flags; the library's defaults where nothing was typed.
fn method_settings(args: &MethodArgs) -> MethodSettings {
    let mut settings = MethodSettings::default();
    settings.ambient = args.ambient.unwrap_or(settings.ambient);
    settings.virtual_rooms.reflections = args.reflections.unwrap_or(settings.virtual_rooms.reflections);
    settings.photons = args.photons;
    let ambient = &mut settings.ambient_cache;
    ambient.bounces = args.ambient_bounces.or(ambient.bounces);
    ambient.accuracy = args.ambient_accuracy.unwrap_or(ambient.accuracy);
    ambient.divisions = args.ambient_divisions.unwrap_or(ambient.divisions);
    settings.metropolis.chains = args.chains.unwrap_or(settings.metropolis.chains);
    settings.metropolis.large_steps = args.large_steps.unwrap_or(settings.metropolis.large_steps);
    settings.metropolis.steps = args.chain_steps.unwrap_or(settings.metropolis.steps);
    settings.metropolis.even = args.chain_brightness.unwrap_or(settings.metropolis.even);
    settings.paths.clone_from(&args.paths);
    settings.single_paths = !args.path_lending;
    settings.heuristic = args.heuristic.unwrap_or(settings.heuristic);
    settings
}
