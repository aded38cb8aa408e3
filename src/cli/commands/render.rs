//! `twopass render`: both passes, OUT.exr and OUT.png.

use super::{method_settings, render_settings};
use crate::cli::args::{Common, RenderArgs, ToneMapName};
use crate::cli::exit::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::say;
use crate::cli::progress::{Display, observer};
use crate::cli::snapshots::Snapshots;
use crate::cli::values::read_out_name;
use crate::cli::{header, report, saving, scene_file};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use twopass::film::io::{Header, Operator, ToneMap, WriteError, probe_writable, write_exr, write_png};
use twopass::film::lock::OutputLock;
use twopass::film::{Film, Layer};
use twopass::integrator::drive::{Budget, Clocks};
use twopass::integrator::{Integrator, Method};
use twopass::load::LoadedScene;
use twopass::pipeline::keys::{Key, StageKeys};
use twopass::pipeline::solution_file::SolutionFile;
use twopass::pipeline::{self, Checkpoint, PipelineError, RenderSettings, Rendered, Whole, checkpoint, direct};
use twopass::progress::Stage;
use twopass::run_report::{RunReport, SnapshotReport, StopReason, Stopwatch, process_cpu_seconds};
use twopass::scene::Scene;
use twopass::world::walk::RayCounts;

/// Most pixels of a picture.
const MOST_PIXELS: usize = 1 << 26;

/// Bytes for each of them: the film holds 256, the samples of a pass 192, the layers of the file 100.
const PIXEL_BYTES: u64 = 550;

/// Bytes for a triangle: its corners and normals, twice, and its part of the tree.
const TRIANGLE_BYTES: u64 = 200;

/// What a render is to do, and for whom.
struct Job<'a> {
    common: &'a Common,
    args: &'a RenderArgs,
    settings: RenderSettings,
    targets: Targets,
    interrupt: &'a Interrupt,
    /// What the bits of the picture depend on.
    key: Key,
}

/// Runs the subcommand.
pub fn run(common: &Common, args: &RenderArgs) -> Result<(), Failure> {
    let interrupt = Interrupt::listen();
    let scene = args.scene.as_deref().ok_or_else(|| Failure::Usage("expected a scene".to_owned()))?;
    let targets = Targets::new(scene, args.output.as_deref());
    targets.probe(common)?;
    let lock = OutputLock::take(&targets.exr)?;
    if let Some(lock) = &lock {
        lock.sweep(&[&targets.exr, &targets.png, &targets.resume]);
    }
    if !args.snapshots_cpu.is_sorted() {
        return Err(Failure::Usage("--snapshots-cpu: expected ascending times".to_owned()));
    }
    let settings = settings(common, args);
    let read_out = settings.read_out()?;
    if args.solution.is_some() {
        check_solution_flags(args, read_out.is_some())?;
    }
    if args.methods.paths.is_some() && args.method != Method::Path {
        return Err(Failure::Usage(format!("--paths: expected --method path; {} carries what it carries", args.method.name())));
    }
    let mut job = Job { common, args, settings, targets, interrupt: &interrupt, key: Key::default() };
    let watch = Stopwatch::start();
    let loaded = scene_file::load(common, scene, &args.source)?;
    // The file's crop is in pixels of the file's own size.
    if job.settings.size.is_none() {
        job.settings.crop = job.settings.crop.or(loaded.crop);
    }
    let mut loaded = loaded;
    check_size(&loaded, &mut job.settings)?;
    let kept = args.solution.as_deref().map(|path| kept(path, &mut loaded.scene, &mut job)).transpose()?;
    let also = format!("{:?}", (args.solution.is_some(), &args.light));
    job.key = checkpoint::key(loaded.hash, &job.settings, &also);
    if args.resume {
        job.settings.resume = Some(Checkpoint::read(&job.targets.resume, &job.key)?);
    }
    let mut run_report = report::begin(common, &loaded, job.settings.method.name(), watch.elapsed());
    describe(&mut run_report, &job);
    let again = args.time_plan.then(|| loaded.scene.clone());
    match render(&job, loaded, kept) {
        Ok((rendered, snapshots)) => {
            run_report.snapshots = snapshots?;
            finish(&job, &rendered, run_report, again)
        }
        Err(error) => Err(report::no_result(common, &mut run_report, &interrupt, error)),
    }
}

/// The files to write.
struct Targets {
    exr: PathBuf,
    png: PathBuf,
    /// State of an unfinished run.
    resume: PathBuf,
}

impl Targets {
    fn new(scene: &Path, output: Option<&Path>) -> Self {
        let base = output.map_or_else(|| PathBuf::from(scene_file::default_name(scene)), Path::to_owned);
        let known = base.extension().is_some_and(|e| e == "exr" || e == "png");
        let stem = if known { base.with_extension("") } else { base };
        let with = |extension: &str| PathBuf::from(format!("{}.{extension}", stem.display()));
        Self { exr: with("exr"), png: with("png"), resume: with("resume") }
    }

    /// What cannot be written is found before anything is computed.
    fn probe(&self, common: &Common) -> Result<(), Failure> {
        for path in [Some(&self.exr), Some(&self.png), common.report.as_ref()].into_iter().flatten() {
            probe_writable(path)?;
        }
        Ok(())
    }
}

fn settings(common: &Common, args: &RenderArgs) -> RenderSettings {
    RenderSettings {
        method: args.method,
        size: args.size.map(|s| (s.width, s.height)),
        crop: args.crop.map(|c| c.0),
        budget: Budget { spp: args.spp, time: args.time, cpu_time: args.cpu_time, error: args.error },
        methods: method_settings(&args.methods),
        ..render_settings(common, &args.pass_one, Some(&args.pass_two))
    }
}

fn tone_map(args: &RenderArgs) -> ToneMap {
    let operator = match args.tone_map {
        ToneMapName::Soft => Operator::Soft,
        ToneMapName::Srgb => Operator::Srgb,
    };
    ToneMap { exposure: args.exposure, operator }
}

/// Refuses what is too large before it is allocated, and leaves the rest of the memory to pass one.
fn check_size(loaded: &LoadedScene, settings: &mut RenderSettings) -> Result<(), Failure> {
    let (width, height) = settings.size.unwrap_or((loaded.scene.film.width, loaded.scene.film.height));
    let pixels = settings.crop.map_or(width.saturating_mul(height), |[_, _, w, h]| w.saturating_mul(h));
    if pixels > MOST_PIXELS {
        return Err(Failure::Limit(format!("{pixels} pixels are over the limit of {MOST_PIXELS}; render parts with --crop")));
    }
    let triangles = loaded.scene.n_triangles() as u64;
    let taken = pixels as u64 * PIXEL_BYTES + triangles * TRIANGLE_BYTES;
    if let Some(limit) = settings.pass_one.max_memory {
        if taken > limit {
            return Err(Failure::Limit(format!(
                "a picture of {pixels} pixels of a scene of {triangles} triangles would take {} MB, more than the {} MB of --max-memory; \
                 --size and --crop take less",
                taken / 1_000_000,
                limit / 1_000_000
            )));
        }
        settings.pass_one.max_memory = Some(limit - taken);
    }
    Ok(())
}

/// With a kept solution nothing is left to say about how pass one is done.
fn check_solution_flags(args: &RenderArgs, has_first_pass: bool) -> Result<(), Failure> {
    if let Some(flag) = args.pass_one.given().first() {
        return Err(Failure::Usage(format!(
            "{flag} says how pass one is done, which --solution brings with it: give one of them"
        )));
    }
    if args.method == Method::TwoPassPlanar {
        let message = "a kept solution holds light by way of all mirrors and glass, which two-pass-planar does not carry; expected two-pass-general";
        return Err(Failure::Usage(message.to_owned()));
    }
    match has_first_pass {
        true => Ok(()),
        false => Err(Failure::Usage(format!("the method {} has no first pass to take from --solution", args.method.name()))),
    }
}

/// The kept solution, if it is of this scene; makes the scene's lights as strong as they are to be.
fn kept(path: &Path, scene: &mut Scene, job: &mut Job) -> Result<Whole, Failure> {
    let file = SolutionFile::read(path)?;
    let whole = file.whole(&StageKeys::of(scene, &file.meta.settings, file.meta.seed))?;
    job.settings.pass_one = file.meta.settings;
    direct::weigh(scene, &whole.groups, &job.args.light)?;
    Ok(whole)
}

fn describe(run_report: &mut RunReport, job: &Job) {
    let (args, settings) = (job.args, &job.settings);
    let read_out = settings.read_out.or(settings.method.read_out());
    report::set(run_report, "read_out", read_out.map(read_out_name));
    report::set(run_report, "sampler", settings.sampler.name());
    report::set(run_report, "spp", args.spp);
    report::set(run_report, "time", args.time);
    report::set(run_report, "cpu_time", args.cpu_time);
    report::set(run_report, "error", args.error);
    report::set(run_report, "size", args.size.map(|s| vec![s.width, s.height]));
    report::set(run_report, "crop", settings.crop.map(|c| c.to_vec()));
    // null: the scene's; -1: unlimited.
    let depth = args.pass_two.max_depth.map(|d| d.0.map_or(-1, i64::from));
    report::set(run_report, "max_depth", depth);
    report::set(run_report, "image_filter", settings.image_filter);
    report::set(run_report, "gather_rays", settings.gather_rays);
    report::set(run_report, "reflections", args.methods.reflections);
    report::set(run_report, "ambient", args.methods.ambient);
    report::set(run_report, "photons", args.methods.photons);
    report::set(run_report, "ambient_bounces", args.methods.ambient_bounces);
    report::set(run_report, "ambient_accuracy", args.methods.ambient_accuracy);
    report::set(run_report, "ambient_divisions", args.methods.ambient_divisions);
    report::set(run_report, "chains", args.methods.chains);
    report::set(run_report, "large_steps", args.methods.large_steps);
    report::set(run_report, "chain_steps", args.methods.chain_steps);
    report::set(run_report, "chain_brightness", args.methods.chain_brightness);
    report::set(run_report, "paths", args.methods.paths.as_ref().map(|p| p.text().to_owned()));
    report::set(run_report, "path_lending", args.methods.path_lending);
    report::set(run_report, "heuristic", args.methods.heuristic.map(|h| h.name()));
    report::set_pass_one(run_report, &args.pass_one);
}

/// Renders with progress, signals, partial pictures and snapshots.
fn render(
    job: &Job,
    loaded: LoadedScene,
    kept: Option<Whole>,
) -> Result<(Rendered, Result<Vec<SnapshotReport>, WriteError>), PipelineError> {
    let spent = job.settings.resume.as_ref().map_or((0.0, 0.0), |checkpoint| checkpoint.spent);
    let clocks = Clocks::start(process_cpu_seconds).after(spent);
    let mut observer = observer(Display::new(job.common), job.interrupt);
    let mut last = Instant::now();
    let mut snapshots = Snapshots::new(&clocks, &job.targets.exr, &job.args.snapshots_cpu);
    let mut snapshot = |film: &Film, counts: &RayCounts, method: &dyn Integrator| {
        snapshots.look(film, counts);
        let Some(interval) = job.args.partial_every else { return };
        if last.elapsed() >= Duration::from_secs_f64(interval) {
            write_partial(job, film);
            keep(job, (film, counts), &method.state(), &clocks);
            last = Instant::now();
        }
    };
    let (scene, settings) = (loaded.scene, &job.settings);
    let rendered = match kept {
        Some(kept) => pipeline::render_kept(scene, settings, (kept, &job.args.light), &clocks, &mut observer, &mut snapshot)?,
        None => pipeline::render(scene, settings, &clocks, &mut observer, &mut snapshot)?,
    };
    let snapshots = snapshots.finish(report::rays(&rendered.counts));
    if let Some((counts, state)) = &rendered.unfinished {
        keep(job, (&rendered.film, counts), state, &clocks);
    }
    Ok((rendered, snapshots))
}

/// Writes what another process needs to go on. A failure is said and not fatal.
fn keep(job: &Job, so_far: (&Film, &RayCounts), state: &[u8], clocks: &Clocks) {
    let written = checkpoint::write(&job.targets.resume, &job.key, so_far, state, (clocks.wall(), clocks.cpu()));
    if let Err(error) = written {
        say(job.common, &format!("warning: the state of the run was not written: {error}"));
    }
}

/// Writes the picture so far. A failure is said and not fatal: the run may still end well.
fn write_partial(job: &Job, film: &Film) {
    let image = film.image();
    let marked = Header::default().text("complete", "false").number("samples", film.n_passes().into());
    let written = write_png(&job.targets.png, &image, &tone_map(job.args))
        .and_then(|()| write_exr(&job.targets.exr, &[Layer::main(image)], &marked));
    if let Err(error) = written {
        say(job.common, &format!("warning: partial picture not written: {error}"));
    }
}

/// Renders a second time with every stage at work. The picture is there, whatever becomes of that.
fn time_plan(job: &Job, rendered: &Rendered, run_report: &mut RunReport, scene: Scene) {
    let mut observer = observer(Display::new(job.common), job.interrupt);
    let left_out = run_report.plan_saving.left_out.clone();
    match saving::measure((rendered, left_out), scene, &job.settings, &mut observer) {
        Ok(saving) => run_report.plan_saving = saving,
        Err(error) => run_report.plan_saving.how = format!("not measured: {error}"),
    }
    saving::tell(job.common, &run_report.plan_saving);
}

/// Writes what was rendered, complete or not, and says how it went.
fn finish(job: &Job, rendered: &Rendered, mut run_report: RunReport, again: Option<Scene>) -> Result<(), Failure> {
    let targets = &job.targets;
    report::add_plan(&mut run_report, &rendered.plan);
    report::add_costs(&mut run_report, &rendered.stages, &rendered.counts);
    report::add_film(&mut run_report, &rendered.film);
    if let Some(pass_one) = &rendered.pass_one {
        report::add_pass_one(job.common, &mut run_report, pass_one);
    }
    run_report.complete = rendered.complete;
    run_report.stopped_by = match rendered.complete {
        true => report::stop_reason(&job.settings.budget, &rendered.film),
        false => StopReason::Interrupted,
    };
    let layers = rendered.layers();
    let exr_header = header::header(rendered, &run_report);
    let written = run_report.time(Stage::Write, || {
        write_exr(&targets.exr, &layers, &exr_header)
            .and_then(|()| write_png(&targets.png, &rendered.film.image(), &tone_map(job.args)))
    });
    if let Some(scene) = again.filter(|_| rendered.complete) {
        time_plan(job, rendered, &mut run_report, scene);
    }
    report::finish(job.common, &mut run_report)?;
    written?;
    if rendered.complete && (job.args.resume || job.args.partial_every.is_some()) {
        // It was of this run, which is done.
        let _ = std::fs::remove_file(&targets.resume);
    }
    let spent = run_report.total();
    let done = format!(
        "{} and {}: {} samples per pixel in {:.1} s ({:.1} CPU s)",
        targets.exr.display(),
        targets.png.display(),
        run_report.samples_per_pixel,
        spent.wall_s,
        spent.cpu_s
    );
    say(job.common, &format!("wrote {done}"));
    report::verdict(&run_report, job.interrupt, "the picture so far is kept, and --resume goes on from there")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_pictures_differ_in_their_extension_only() {
        for (output, exr) in [("a", "a.exr"), ("a.exr", "a.exr"), ("a.png", "a.exr"), ("b/a.v2", "b/a.v2.exr")] {
            let targets = Targets::new(Path::new("scene.xml"), Some(Path::new(output)));
            assert_eq!(targets.exr, Path::new(exr), "{output}");
            assert_eq!(targets.png, targets.exr.with_extension("png"));
        }
        assert_eq!(Targets::new(Path::new("x/box/scene.xml"), None).exr, Path::new("box.exr"));
    }
}
