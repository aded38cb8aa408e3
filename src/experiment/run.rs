//! From a plan to rows: one run after another, nothing beside them.

use super::child::{self, Ended, How};
use super::environment::{self, load_average};
use super::external::{self, Words};
use super::job::{Job, SceneFacts, Work, jobs};
use super::judge::{Judge, JudgeError};
use super::own;
use super::pass_one;
use super::plan::{Plan, ScenePlan};
use super::report;
use super::row::{Outcome, Row, SceneRecord, Status};
use super::store::{Digest, Store, StoreError, write_text};
use crate::film::Layer;
use crate::film::io::{Header, ToneMap, WriteError, write_exr, write_png};
use crate::load::{LoadError, LoadOptions, LoadedScene, load_scene};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// What an experiment is told.
pub struct Experiment<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// Where its results go.
    pub folder: &'a Path,
    /// This program's own executable.
    pub program: &'a Path,
    /// Runs that gave no usable picture before are tried again.
    pub again: bool,
    /// Only scenes and methods of these names are run; empty lists: all.
    pub only: (&'a [String], &'a [String]),
    /// True once it is to stop.
    pub stopped: &'a dyn Fn() -> bool,
}

/// What an experiment says of its progress.
#[derive(Debug)]
pub enum Event<'a> {
    /// Something to know.
    Note(&'a str),
    /// A run begins: its place from 1, how many there are, scene, method, budget and seed.
    Begins(usize, usize, &'a Row),
    /// It is over, with its last row.
    Ended(&'a Row),
}

/// How an experiment ended.
#[derive(Debug)]
pub struct Finished {
    /// Everything measured so far.
    pub outcome: Outcome,
    /// True if it was stopped before its end.
    pub stopped: bool,
}

/// Why an experiment cannot be done at all.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A scene cannot be loaded.
    #[error(transparent)]
    Load(#[from] Box<LoadError>),
    /// References are of no use.
    #[error(transparent)]
    Judge(#[from] JudgeError),
    /// The folder cannot be worked in.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A result cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// A scene as it was found.
struct Prepared {
    record: SceneRecord,
    judge: Judge,
    size: (usize, usize),
}

/// Runs what is missing, and writes `rows.csv` after each run and `experiment.json` at the end.
///
/// # Errors
/// [`ExperimentError`] if scenes or references are of no use or the folder cannot be written. Runs that fail are rows, not errors.
pub fn run(experiment: &Experiment<'_>, listen: &mut dyn FnMut(&Event<'_>)) -> Result<Finished, ExperimentError> {
    let plan = experiment.plan;
    let mut store = Store::open(experiment.folder)?;
    plan.left_out.iter().for_each(|line| listen(&Event::Note(&format!("left out: {line}"))));
    let mut scenes = Vec::new();
    for scene in &plan.scenes {
        scenes.push(prepare(scene, &store)?);
    }
    let facts: Vec<_> = scenes.iter().map(|s| SceneFacts { hash: &s.record.hash, judge: &s.judge }).collect();
    let all = jobs(plan, &facts);
    let old = store.set_aside(|row| plan.leaves_out(&row.scene, &row.method) || all.iter().any(|job| job.owns(row)))?;
    if old > 0 {
        listen(&Event::Note(&format!("{old} rows of other settings or scenes were moved to rows.old.csv")));
    }
    let program = environment::program();
    let foreign = store.rows().iter().filter(|row| row.program != program).count();
    if foreign > 0 {
        listen(&Event::Note(&format!(
            "{foreign} rows that are kept were measured by another build; take a new folder to measure all anew"
        )));
    }
    let missing: Vec<&Job> = all.iter().filter(|job| is_wanted(experiment, job) && !is_done(experiment, &store, job)).collect();
    let runner = Runner { experiment, program, scenes: &scenes };
    let mut stopped = false;
    for (i, job) in missing.iter().enumerate() {
        listen(&Event::Begins(i + 1, missing.len(), &job.row));
        let Some(rows) = runner.rows(job, &store)? else {
            stopped = true;
            break;
        };
        store.add(&rows, |row| job.owns(row))?;
        listen(&Event::Ended(rows.last().expect("a run leaves at least one row")));
    }
    store.clear_scratch();
    let outcome = Outcome {
        title: plan.title.clone(),
        plan: plan.text.clone(),
        clock: plan.clock.clone(),
        environment: environment::describe(plan.threads),
        scenes: scenes.iter().map(|s| s.record.clone()).collect(),
        methods: plan.methods.iter().map(|m| (m.name.clone(), m.about.clone())).collect(),
        rows: store.rows().to_vec(),
    };
    publish(&outcome, experiment.folder)?;
    Ok(Finished { outcome, stopped })
}

/// Writes what a reader of the results needs beside `rows.csv`. Plots and page are made of it.
fn publish(outcome: &Outcome, folder: &Path) -> Result<(), WriteError> {
    let json = serde_json::to_string_pretty(outcome).expect("text keys and plain values always become JSON");
    write_text(&folder.join("experiment.json"), &(json + "\n"))?;
    report::write(outcome, folder)
}

fn is_wanted(experiment: &Experiment<'_>, job: &Job) -> bool {
    let (scenes, methods) = experiment.only;
    (scenes.is_empty() || scenes.contains(&job.row.scene)) && (methods.is_empty() || methods.contains(&job.row.method))
}

/// True if the run has met its last budget, or failed and is not to be tried again.
fn is_done(experiment: &Experiment<'_>, store: &Store, job: &Job) -> bool {
    let mut last = store.rows().iter().filter(|row| job.owns(row) && row.budget == job.row.budget);
    last.any(|row| store.is_whole(row) || (row.status != Status::Done && !experiment.again))
}

/// Loads a scene for its hash and size, and copies its references.
fn prepare(scene: &ScenePlan, store: &Store) -> Result<Prepared, ExperimentError> {
    let options =
        LoadOptions { defines: scene.defines.clone(), allow_paths: scene.allow_paths.clone(), ..LoadOptions::default() };
    let file = if scene.file.is_dir() { scene.file.join("scene.xml") } else { scene.file.clone() };
    let LoadedScene { scene: loaded, hash, .. } = load_scene(&file, &options).map_err(Box::new)?;
    let size = scene.size.unwrap_or((loaded.film.width, loaded.film.height));
    let judge = Judge::read(scene, size)?;
    let mut references = Vec::new();
    for (path, half) in scene.references.iter().zip(["A", "B"]) {
        let name = format!("references/{} {half}.exr", scene.name);
        std::fs::copy(path, store.path(&name)).map_err(|error| WriteError { path: store.path(&name), kind: error.into() })?;
        references.push(name);
    }
    let dropped = loaded.dropped_triangles;
    let left_out = if dropped > 0 { vec![format!("{dropped} triangles without area or the same as others")] } else { Vec::new() };
    let record = SceneRecord {
        name: scene.name.clone(),
        file: scene.file_as_written.clone(),
        hash: format!("{hash:016x}"),
        references,
        reference_relmse: judge.reference_relmse(),
        left_out,
        warnings: loaded.warnings.clone(),
    };
    Ok(Prepared { record, judge, size })
}

/// What all runs share.
struct Runner<'a> {
    experiment: &'a Experiment<'a>,
    program: String,
    scenes: &'a [Prepared],
}

/// What is left of a run that gave nothing: a status and a sentence.
type Failed = (Status, String);

impl Runner<'_> {
    fn plan(&self) -> &Plan {
        self.experiment.plan
    }

    fn scene(&self, job: &Job) -> &ScenePlan {
        &self.plan().scenes[job.scene]
    }

    /// Runs a job and judges what it gave: one row or more; `None` if the experiment was stopped meanwhile.
    fn rows(&self, job: &Job, store: &Store) -> Result<Option<Vec<Row>>, WriteError> {
        let mut row = Row { load_average: load_average(), program: self.program.clone(), ..job.row.clone() };
        let result = match job.work {
            Work::Solve => self.solution(job, store, &mut row).map(|done| done.then(Vec::new)),
            Work::External(spp) => self.external(job, store, &mut row, spp),
            Work::Cpu(_) | Work::Spp(_) => self.own(job, store, &mut row),
        };
        match result {
            Ok(None) => Ok(None),
            Ok(Some(pictures)) if pictures.is_empty() => Ok(Some(vec![row])),
            Ok(Some(pictures)) => {
                let rows = pictures.into_iter().map(|(row, path)| self.judged(job, store, row, &path));
                rows.collect::<Result<_, _>>().map(Some)
            }
            Err((status, message)) => Ok(Some(vec![Row { status, message, ..row }])),
        }
    }

    /// Runs this program's `render`.
    fn own(&self, job: &Job, store: &Store, row: &mut Row) -> Result<Option<Vec<(Row, PathBuf)>>, Failed> {
        store.clear_scratch();
        let (out, report_path) = (store.path("scratch/out.exr"), self.report_path(job, store));
        let mut command = own::render(self.experiment.program, self.plan(), self.scene(job), job, &out, &report_path);
        if self.execute(&mut command, job.timeout, &self.log_path(job, store), store)?.is_none() {
            return Ok(None);
        }
        let report = own::read_report(&report_path).map_err(|why| (Status::Failed, why))?;
        own::measure(row, &report);
        Ok(Some(own::pictures(row.clone(), job, &report, &out)))
    }

    /// Runs a command of somebody else.
    fn external(&self, job: &Job, store: &Store, row: &mut Row, spp: u32) -> Result<Option<Vec<(Row, PathBuf)>>, Failed> {
        store.clear_scratch();
        let out = store.path("scratch/out.exr");
        let scene = self.scene(job);
        let words = Words {
            scene: &scene.file,
            out: &out,
            spp,
            seed: job.seed,
            size: self.scenes[job.scene].size,
            threads: match self.plan().threads {
                0 => std::thread::available_parallelism().map_or(1, usize::from),
                n => n,
            },
            plan_dir: &self.plan().folder,
            defines: &scene.defines,
        };
        let mut command = Command::new("sh");
        command.arg("-c").arg(external::fill(&job.command, &words)).current_dir(&self.plan().folder);
        let Some(ended) = self.execute(&mut command, job.timeout, &self.log_path(job, store), store)? else { return Ok(None) };
        let said = PathBuf::from(format!("{}.json", out.display()));
        external::measure(row, &ended, &said, spp).map_err(|why| (Status::Failed, why))?;
        let _ = std::fs::copy(&said, self.report_path(job, store));
        Ok(Some(vec![(row.clone(), out)]))
    }

    /// Solves pass one and compares it; false if the experiment was stopped meanwhile.
    fn solution(&self, job: &Job, store: &Store, row: &mut Row) -> Result<bool, Failed> {
        let scene = self.scene(job);
        let reference = scene.reference_solution.as_ref().expect("the plan was checked for it");
        let mut fine = Vec::new();
        for &seed in &reference.seeds {
            let mut digest = Digest::default();
            let flags: BTreeMap<String, String> = reference.flags.iter().map(|(k, v)| (k.clone(), v[0].clone())).collect();
            let named = [&self.scenes[job.scene].record.hash, &self.program, &format!("{flags:?} {seed} {}", self.plan().points)];
            named.iter().for_each(|part| digest.add(part.as_bytes()));
            let path = store.path(&format!("solutions/{}.csv", digest.text()));
            if !path.exists() {
                let limit = Duration::from_secs_f64(reference.timeout.min(1e9));
                let report = store.path(&format!("reports/reference solution {}.json", digest.text()));
                let done = self.solve(store, scene, &flags, seed, limit, &path, &report);
                if !done.map_err(|(status, why)| (status, format!("reference solution: {why}")))? {
                    return Ok(false);
                }
            }
            fine.push(pass_one::read(&path).map_err(|why| (Status::Unusable, why))?);
        }
        let (out, report) = (store.path("scratch/solution.csv"), self.report_path(job, store));
        store.clear_scratch();
        if !self.solve(store, scene, &job.flags, job.seed, job.timeout, &out, &report)? {
            return Ok(false);
        }
        own::measure(row, &own::read_report(&report).map_err(|why| (Status::Failed, why))?);
        let found = pass_one::read(&out).map_err(|why| (Status::Unusable, why))?;
        let (a, b) = (&fine[0], fine.last().unwrap_or(&fine[0]));
        let (error, mean) = pass_one::error(&found, a, b).map_err(|why| (Status::Unusable, why))?;
        row.relmse = Some(error);
        [row.mean_ratio_r, row.mean_ratio_g, row.mean_ratio_b] = mean.map(Some);
        Ok(true)
    }

    #[expect(clippy::too_many_arguments, reason = "a solution for reference and for a row differ in all of these")]
    fn solve(
        &self,
        store: &Store,
        scene: &ScenePlan,
        flags: &BTreeMap<String, String>,
        seed: u64,
        limit: Duration,
        out: &Path,
        report: &Path,
    ) -> Result<bool, Failed> {
        let mut command = own::command(self.experiment.program, "solve", self.plan(), scene, flags, seed, report);
        command.arg("--irradiance").arg(out).arg(format!("--points={}", self.plan().points));
        Ok(self.execute(&mut command, limit, &report.with_extension("log"), store)?.is_some())
    }

    /// Runs a process; `None` if the experiment was stopped meanwhile.
    fn execute(&self, command: &mut Command, limit: Duration, log: &Path, store: &Store) -> Result<Option<Ended>, Failed> {
        let ended = child::run(command, limit, log, |pid| store.note_running(pid), self.experiment.stopped);
        store.note_ended();
        let ended = ended.map_err(|error| (Status::Failed, format!("cannot be started: {error}")))?;
        let failed = |status, what: &str| match ended.last_words.as_str() {
            "" => Err((status, what.to_owned())),
            words => Err((status, format!("{what}: {words}"))),
        };
        match &ended.how {
            How::Stopped => Ok(None),
            How::Well => {
                // What a run that went well had to say is of no interest.
                let _ = std::fs::remove_file(log);
                Ok(Some(ended))
            }
            How::Badly(what) => failed(Status::Failed, what),
            How::TimedOut => failed(Status::TimedOut, &format!("stopped after {} s", limit.as_secs_f64())),
        }
    }

    /// Judges a picture and keeps its three channels.
    fn judged(&self, job: &Job, store: &Store, mut row: Row, path: &Path) -> Result<Row, WriteError> {
        match self.scenes[job.scene].judge.judge(path, &mut row) {
            Err(message) => Ok(Row { status: Status::Unusable, message, ..row }),
            Ok(image) => {
                let folder = format!("images/{}/{}", row.scene, row.method);
                let target = store.path(&folder);
                std::fs::create_dir_all(&target).map_err(|error| WriteError { path: target, kind: error.into() })?;
                row.image = format!("{folder}/{}.exr", job.file_name(&row.budget));
                let kept = store.path(&row.image);
                write_png(&kept.with_extension("png"), &image, &ToneMap::default())?;
                let header = Header::default().text("scene", &row.scene).text("method", &row.method).number("samples", row.spp);
                write_exr(&kept, &[Layer::main(image)], &header.number("cpuSeconds", row.cpu_s))?;
                Ok(row)
            }
        }
    }

    fn report_path(&self, job: &Job, store: &Store) -> PathBuf {
        let name = format!("{} {} {}", job.row.scene, job.row.method, job.file_name(&job.row.budget));
        store.path(&format!("reports/{name}.json"))
    }

    fn log_path(&self, job: &Job, store: &Store) -> PathBuf {
        self.report_path(job, store).with_extension("log")
    }
}
