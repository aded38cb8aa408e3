//! Subcommands and flags as plain data: what was typed, nothing computed.
//!
//! A flag that the command line promises but that does not work yet is parsed, hidden from the help, and refused by
//! [`Args::not_delivered`]: it is never ignored.

mod form_factors;

pub use form_factors::{FormFactorsArgs, GroupingName};

use super::method_args::MethodArgs;
use super::values::{
    Crop, Define, Depth, Size, parse_bytes, parse_count, parse_crop, parse_depth, parse_finite, parse_form_factors, parse_light,
    parse_method, parse_positive, parse_read_out, parse_sampler, parse_solver, parse_switch, parse_whole,
};
use clap::{Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use twopass::accel::AccelKind;
use twopass::form_factor::FormFactorMethod;
use twopass::integrator::{Method, ReadOut};
use twopass::math::SamplerKind;
use twopass::pipeline::LampWeight;
use twopass::radiosity::Solver;

/// Hybrid two-pass global illumination: radiosity over meshed patches, then Whitted ray tracing that gathers it.
#[derive(Debug, Parser)]
#[command(name = "twopass", version, about, max_term_width = 120, after_help = EXIT_CODES)]
pub struct Args {
    /// Flags of all subcommands
    #[command(flatten)]
    pub common: Common,
    /// List the methods of pass two and end
    #[arg(long)]
    pub list_methods: bool,
    /// What to do
    #[command(subcommand)]
    pub command: Option<Command>,
}

const EXIT_CODES: &str = "Exit codes: 0 done; 1 internal fault; 2 usage; 3 input unreadable or invalid; 4 over a resource limit; \
    5 output cannot be written; 6 not converged, a NaN in the result or a check failed (the image is still written); \
    130/143 interrupted, with the partial result kept.";

/// Flags of all subcommands.
#[derive(Debug, clap::Args)]
pub struct Common {
    /// Threads that work, at most eight per core; 0: one per core
    #[arg(long, global = true, value_name = "N", default_value_t = 0, value_parser = parse_whole::<usize>, allow_negative_numbers = true, help_heading = "Common options")]
    pub threads: usize,
    /// Seed of all random numbers
    #[arg(long, global = true, value_name = "N", default_value_t = 0, value_parser = parse_whole::<u64>, allow_negative_numbers = true, help_heading = "Common options")]
    pub seed: u64,
    /// Say nothing but errors
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = "Common options")]
    pub quiet: bool,
    /// Say more: time by stage, counters
    #[arg(short, long, global = true, help_heading = "Common options")]
    pub verbose: bool,
    /// Progress on stderr; auto: only on a terminal
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto", help_heading = "Common options")]
    pub progress: ProgressMode,
    /// Write the run report (JSON)
    #[arg(long, global = true, value_name = "FILE.json", help_heading = "Common options")]
    pub report: Option<PathBuf>,
    /// Ray engine: obvhs, brute-force, or embree where built in
    #[arg(long, global = true, value_name = "NAME", default_value = "obvhs", help_heading = "Common options")]
    pub accel: AccelKind,
    /// Let the scene read files below this folder too; may be given more than once
    #[arg(long, global = true, value_name = "DIR", help_heading = "Common options")]
    pub allow_path: Vec<PathBuf>,
    /// Refuse a first pass that would take more memory than this, before it is taken; default: the memory of the machine
    #[arg(long, global = true, value_name = "BYTES[K|M|G]", value_parser = parse_bytes, help_heading = "Common options")]
    pub max_memory: Option<u64>,
    /// Stages that the scene does not need: left out (lean), or at work all the same (full); the picture is the same
    #[arg(long, global = true, value_name = "MODE", default_value = "lean", help_heading = "Common options")]
    pub plan: PlanMode,
}

/// Whether stages that a scene does not need are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PlanMode {
    /// Left out.
    Lean,
    /// At work all the same.
    Full,
}

impl From<PlanMode> for twopass::plan::Mode {
    fn from(mode: PlanMode) -> Self {
        match mode {
            PlanMode::Lean => Self::Lean,
            PlanMode::Full => Self::Full,
        }
    }
}

/// When progress is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProgressMode {
    /// On a terminal.
    Auto,
    /// Also into a pipe or file, as lines.
    Always,
    /// Never.
    Never,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene: both passes, OUT.exr and OUT.png
    Render(RenderArgs),
    /// Solve pass one alone and say how well it went
    Solve(SolveArgs),
    /// Say what is in a scene
    Info(InfoArgs),
    /// Irradiance or radiance at given points
    Probe(ProbeArgs),
    /// The errors of an image against one or two references
    Compare(CompareArgs),
    /// Form factors (view factors) between shapes or patches, as a table
    FormFactors(FormFactorsArgs),
    /// Error against run time: scenes, methods and budgets of a plan, measured one after another
    Experiment(ExperimentArgs),
    /// Stiff and extreme cases with known answers: do the laws hold on this machine?
    Stability(StabilityArgs),
    /// Not delivered yet
    #[command(hide = true, disable_help_flag = true)]
    Serve(Rest),
}

/// Whatever follows a subcommand that is not delivered yet.
#[derive(Debug, clap::Args)]
pub struct Rest {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    rest: Vec<String>,
}

/// Flags that choose and change the scene.
#[derive(Debug, clap::Args)]
pub struct SceneArgs {
    /// Value for the scene's $name; may be given more than once
    #[arg(short = 'D', value_name = "NAME=VALUE")]
    pub define: Vec<Define>,
}

/// Flags of pass one.
#[derive(Debug, clap::Args)]
pub struct PassOneArgs {
    /// Edge length of a patch in scene units; default: a few thousand patches in all
    #[arg(long, value_name = "LENGTH", value_parser = parse_positive, allow_hyphen_values = true, help_heading = "Pass one")]
    pub patch_size: Option<f64>,
    /// Cut patches in quarters where radiosity bends by more than T of its root mean square, as at the borders of shadows, and solve
    /// again; best with form factors whose noise is below T
    #[arg(long, value_name = "T", value_parser = parse_positive, allow_hyphen_values = true, help_heading = "Pass one")]
    pub adaptive: Option<f64>,
    /// How form factors are computed: analytic (pair by pair), hemicube, ray-cast, hierarchical (links
    /// between groups of patches). Default: ray-cast; `solve` takes hierarchical for more than 3000 elements, unless a
    /// tolerance is given
    #[arg(long, value_name = "METHOD", value_parser = parse_form_factors, help_heading = "Pass one")]
    pub form_factors: Option<FormFactorMethod>,
    /// Error allowed to a form factor: analytic, relative to the unobstructed one (default 0.001); hierarchical, its bound
    /// (default 0.001); others, its standard error (default 0.0221)
    #[arg(long, value_name = "T", value_parser = parse_positive, allow_hyphen_values = true, help_heading = "Pass one")]
    pub tolerance: Option<f64>,
    /// How the radiosity system is solved: cg, gmres, bicgstab, gauss-seidel, jacobi, southwell
    #[arg(long, value_name = "METHOD", default_value = "cg", value_parser = parse_solver, help_heading = "Pass one")]
    pub solver: Solver,
    /// Bound on the relative error of the solution
    #[arg(long, value_name = "T", value_parser = parse_positive, allow_hyphen_values = true, help_heading = "Pass one")]
    pub solver_tolerance: Option<f64>,
}

/// Flags of pass two.
#[derive(Debug, clap::Args)]
pub struct PassTwoArgs {
    /// How pass two reads pass one: stored, direct-stored, final-gather; default: as the method does
    #[arg(long, value_name = "HOW", value_parser = parse_read_out, help_heading = "Pass two")]
    pub read_out: Option<ReadOut>,
    /// How samples of one pixel lie among each other: sobol (stratified), independent
    #[arg(long, value_name = "KIND", default_value = "sobol", value_parser = parse_sampler, help_heading = "Pass two")]
    pub sampler: SamplerKind,
    /// Longest light path in edges; -1: unlimited; default: the scene's
    #[arg(long, value_name = "N", value_parser = parse_depth, allow_negative_numbers = true, help_heading = "Pass two")]
    pub max_depth: Option<Depth>,
    /// Filter of the two-pass picture by what its two halves agree on: on, off
    #[arg(long, value_name = "ON", default_value = "on", action = clap::ArgAction::Set, value_parser = parse_switch, help_heading = "Pass two")]
    pub image_filter: bool,
    /// Gather rays per sample
    #[arg(long, value_name = "N", value_parser = parse_count::<u32>, allow_negative_numbers = true, help_heading = "Pass two")]
    pub gather_rays: Option<u32>,
}

/// `twopass render`.
#[derive(Debug, clap::Args)]
pub struct RenderArgs {
    /// Scene file, or a folder with a scene.xml
    #[arg(required_unless_present = "list_methods")]
    pub scene: Option<PathBuf>,
    /// Write OUT.exr and OUT.png; default: the scene's folder or file name, in the current folder
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub source: SceneArgs,
    /// Stop after N samples per pixel
    #[arg(long, value_name = "N", value_parser = parse_count::<u32>, allow_negative_numbers = true, help_heading = "When to stop (the first to be met)")]
    pub spp: Option<u32>,
    /// Stop after S seconds on the clock, from the end of loading
    #[arg(long, value_name = "S", value_parser = parse_positive, allow_hyphen_values = true, help_heading = "When to stop (the first to be met)")]
    pub time: Option<f64>,
    /// Stop after S seconds of processor time (user and system), from the end of loading
    #[arg(long, value_name = "S", value_parser = parse_positive, allow_hyphen_values = true, help_heading = "When to stop (the first to be met)")]
    pub cpu_time: Option<f64>,
    /// Stop when the predicted error (relMSE) is reached
    #[arg(long, value_name = "RELMSE", value_parser = parse_positive, allow_hyphen_values = true, help_heading = "When to stop (the first to be met)")]
    pub error: Option<f64>,
    /// Render a second time with every stage at work, and say what leaving out saved, also in the run report
    #[arg(long, conflicts_with_all = ["solution", "resume"], help_heading = "Pass two")]
    pub time_plan: bool,
    /// Method of pass two; table by --list-methods
    #[arg(long, value_name = "M", default_value = "two-pass", value_parser = parse_method, help_heading = "Pass two")]
    pub method: Method,
    /// List the methods of pass two and end
    #[arg(long)]
    pub list_methods: bool,
    #[command(flatten)]
    pub pass_two: PassTwoArgs,
    #[command(flatten)]
    pub methods: Box<MethodArgs>,
    #[command(flatten)]
    pub pass_one: PassOneArgs,
    /// Size of the picture in pixels; default: the scene's
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<Size>,
    /// Render only this part: left, top, width, height in pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = parse_crop, allow_hyphen_values = true)]
    pub crop: Option<Crop>,
    /// Exposure of the PNG in stops: +1 doubles
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = parse_finite, allow_hyphen_values = true)]
    pub exposure: f64,
    /// Highlights of the PNG: soft rolls them off (1 - 1/(4x) above 1/2), srgb cuts them at 1
    #[arg(long, value_name = "OPERATOR", default_value = "soft")]
    pub tone_map: ToneMapName,
    /// Write the picture so far as OUT.0001.exr, OUT.0002.exr ... when these processor times since the end of loading are reached
    /// (ascending); the time that takes is in no budget and no time of the report
    #[arg(long, value_name = "S1,S2,...", value_delimiter = ',', value_parser = parse_positive, allow_hyphen_values = true)]
    pub snapshots_cpu: Vec<f64>,
    /// Write the image so far every S seconds
    #[arg(long, value_name = "S", value_parser = parse_positive, allow_hyphen_values = true)]
    pub partial_every: Option<f64>,
    /// Take pass one from this file, which `solve -o` wrote for the same scene; only the view may differ
    #[arg(long, value_name = "FILE.sol")]
    pub solution: Option<PathBuf>,
    /// Make a light of the solution SCALE times as strong, and R, G, B times as red, green and blue; may be given more than once. Lights
    /// without a shape are called light-1, light-2 ...
    #[arg(long, value_name = "ID=SCALE[,R,G,B]", value_parser = parse_light, requires = "solution")]
    pub light: Vec<LampWeight>,
    /// Go on with the run that was interrupted or killed, of the same scene, flags and output, to the same picture as without the
    /// interruption. Its state lies in OUT.resume, written at an interrupt and with --partial-every; limits may be raised
    #[arg(long)]
    pub resume: bool,
}

/// Tone map operators by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ToneMapName {
    /// Rolled off.
    Soft,
    /// Cut off.
    Srgb,
}

/// `twopass solve`.
#[derive(Debug, clap::Args)]
pub struct SolveArgs {
    /// Scene file, or a folder with a scene.xml
    pub scene: PathBuf,
    #[command(flatten)]
    pub source: SceneArgs,
    #[command(flatten)]
    pub pass_one: PassOneArgs,
    /// Write the irradiance of the solution at points of the surfaces: a CSV of place, normal and irradiance [W/m²]. The points are
    /// drawn by area, alike for any patches, so that solutions can be compared
    #[arg(long, value_name = "FILE.csv")]
    pub irradiance: Option<PathBuf>,
    /// How many points that file has
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = parse_count::<u32>, allow_negative_numbers = true)]
    pub points: u32,
    /// Keep the solution in this file. If it is there already, stages of it that nothing has changed for are not done again
    #[arg(short, long, value_name = "FILE.sol")]
    pub output: Option<PathBuf>,
    /// Write the scene with the solved light in it, as a binary glTF for any viewer
    #[arg(long, value_name = "FILE.glb")]
    pub gltf: Option<PathBuf>,
}

/// `twopass info`.
#[derive(Debug, clap::Args)]
pub struct InfoArgs {
    /// Scene file, or a folder with a scene.xml
    pub scene: PathBuf,
    #[command(flatten)]
    pub source: SceneArgs,
    /// Edge length of a patch in scene units
    #[arg(long, value_name = "LENGTH", value_parser = parse_positive, allow_hyphen_values = true)]
    pub patch_size: Option<f64>,
    /// As one JSON object
    #[arg(long)]
    pub json: bool,
}

/// `twopass probe`.
#[derive(Debug, clap::Args)]
pub struct ProbeArgs {
    /// Scene file, or a folder with a scene.xml
    pub scene: PathBuf,
    /// Points: a CSV with the header x,y,z,nx,ny,nz
    #[arg(long, value_name = "P.csv")]
    pub points: PathBuf,
    /// Write the result there; default: stdout
    #[arg(short, long, value_name = "OUT.csv")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub source: SceneArgs,
    /// Radiance that arrives along n instead of irradiance on a surface facing n
    #[arg(long)]
    pub radiance: bool,
    /// Luminous efficacy [lm/W] of the illuminance column
    #[arg(long, value_name = "K", default_value_t = 179.0, value_parser = parse_positive, allow_hyphen_values = true)]
    pub efficacy: f64,
    /// Samples per point
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = parse_count::<u64>, allow_negative_numbers = true)]
    pub samples: u64,
    #[command(flatten)]
    pub pass_two: PassTwoArgs,
    #[command(flatten)]
    pub pass_one: PassOneArgs,
}

/// `twopass compare`.
#[derive(Debug, clap::Args)]
pub struct CompareArgs {
    /// Picture to be judged (EXR)
    pub image: PathBuf,
    /// Reference (EXR)
    pub a: PathBuf,
    /// Second reference, independent of the first (EXR)
    pub b: Option<PathBuf>,
    /// As one JSON object
    #[arg(long)]
    pub json: bool,
    /// Write a false-colour picture of the relative error: black 0.001, white 1, logarithmic
    #[arg(long, value_name = "FILE.png")]
    pub diff: Option<PathBuf>,
    /// Write the map of HDR-FLIP, the difference that a person sees, in the magma palette: black 0, pale yellow 1
    #[arg(long, value_name = "FILE.png")]
    pub flip: Option<PathBuf>,
    /// Leave out the pixels that are white in this picture
    #[arg(long, value_name = "FILE.png")]
    pub mask: Option<PathBuf>,
    /// Pixels that see an emitter (white), for relmse_off_emitters
    #[arg(long, value_name = "FILE.png")]
    pub emitters: Option<PathBuf>,
}

/// `twopass experiment`.
#[derive(Debug, clap::Args)]
pub struct ExperimentArgs {
    /// The plan: scenes, methods, budgets, seeds (TOML; see benches/plans)
    #[arg(value_name = "PLAN.toml")]
    pub plan_file: PathBuf,
    /// Folder for rows.csv, pictures, reports and the page; an experiment that was stopped goes on there
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Value for the plan's $NAME in names of files and commands; may be given more than once
    #[arg(short = 'D', value_name = "NAME=VALUE")]
    pub define: Vec<Define>,
    /// Run again what failed, timed out or gave no usable picture before
    #[arg(long)]
    pub again: bool,
    /// Only these scenes of the plan
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Only these methods of the plan
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub methods: Vec<String>,
}

/// `twopass stability`.
#[derive(Debug, clap::Args)]
pub struct StabilityArgs {
    /// Write stability.csv and a page, index.html, into this folder
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
}

impl Args {
    /// What was asked for that this version does not do yet or does not know: a sentence for the user.
    pub fn not_delivered(&self) -> Option<String> {
        match self.command.as_ref()? {
            Command::Render(_) | Command::Solve(_) | Command::Probe(_) | Command::FormFactors(_) => None,
            Command::Info(_) | Command::Compare(_) | Command::Experiment(_) | Command::Stability(_) => None,
            Command::Serve(_) => Some(later("the subcommand serve")),
        }
    }
}

impl PassOneArgs {
    /// The flags that say how pass one is done, as far as they were given.
    pub fn given(&self) -> Vec<&'static str> {
        let flags = [
            ("--patch-size", self.patch_size.is_some()),
            ("--adaptive", self.adaptive.is_some()),
            ("--tolerance", self.tolerance.is_some()),
            ("--solver-tolerance", self.solver_tolerance.is_some()),
            ("--form-factors", self.form_factors.is_some()),
            ("--solver", self.solver != Solver::default()),
        ];
        flags.into_iter().filter(|(_, given)| *given).map(|(name, _)| name).collect()
    }
}

fn later(name: &str) -> String {
    format!("{name} is not delivered in this version")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_consistent() {
        Args::command().debug_assert();
    }

    #[test]
    fn common_flags_may_follow_the_subcommand() {
        let args = Args::try_parse_from(["twopass", "render", "a.xml", "--seed", "7", "--threads=2", "-q"]).unwrap();
        assert_eq!((args.common.seed, args.common.threads, args.common.quiet), (7, 2, true));
    }

    /// A value below 0 is a value, not an unknown flag: the message names the flag and what it takes.
    #[test]
    fn values_below_their_range_are_refused_by_their_flag() {
        for (line, flag, expected) in [
            ("render a.xml --spp -3", "--spp", "1 or more"),
            ("render a.xml --gather-rays -1", "--gather-rays", "1 or more"),
            ("render a.xml --ambient -1", "--ambient", "0 or more"),
            ("render a.xml --photons 0", "--photons", "1 or more"),
            ("render a.xml --ambient-divisions 0", "--ambient-divisions", "1 or more"),
            ("render a.xml --chains 0", "--chains", "1 or more"),
            ("render a.xml --large-steps 1.5", "--large-steps", "1 at most"),
            ("render a.xml --paths L(DE", "--paths", "regular expression"),
            ("render a.xml --paths LXE", "--paths", "no letter"),
            ("render a.xml --threads -1", "--threads", "0 or more"),
            ("render a.xml --seed -1", "--seed", "0 or more"),
            ("render a.xml --time -1", "--time", "above 0"),
            ("render a.xml --cpu-time -0.5", "--cpu-time", "above 0"),
            ("render a.xml --error -1e-3", "--error", "above 0"),
            ("render a.xml --patch-size -1", "--patch-size", "above 0"),
            ("render a.xml --tolerance -1", "--tolerance", "above 0"),
            ("render a.xml --solver-tolerance -1", "--solver-tolerance", "above 0"),
            ("render a.xml --partial-every -1", "--partial-every", "above 0"),
            ("render a.xml --size -5x3", "--size", "WxH"),
            ("render a.xml --crop -1,2,3,4", "--crop", "X,Y,W,H"),
            ("solve a.xml --adaptive 0", "--adaptive", "above 0"),
            ("info a.xml --patch-size -1", "--patch-size", "above 0"),
            ("solve a.xml --form-factors magic", "--form-factors", "expected one of analytic, hemicube, ray-cast"),
            ("probe a.xml --points p.csv --samples -4", "--samples", "1 or more"),
            ("probe a.xml --points p.csv --efficacy -1", "--efficacy", "above 0"),
        ] {
            let words = std::iter::once("twopass").chain(line.split(' '));
            let message = Args::try_parse_from(words).expect_err(line).to_string();
            assert!(
                message.contains("invalid value") && message.contains(flag) && message.contains(expected),
                "{line}: {message}"
            );
        }
    }

    #[test]
    fn what_comes_later_is_refused_and_named() {
        let refusal = |line: &str| Args::try_parse_from(line.split(' ')).unwrap().not_delivered();
        let line = "twopass serve a.xml --port 80";
        let message = refusal(line).unwrap_or_else(|| panic!("accepted: {line}"));
        assert!(message.contains("serve"), "{line}: {message}");
        assert_eq!(refusal("twopass render a.xml --form-factors ray-cast --solver gauss-seidel"), None);
    }
}
