//! What a run did, in one JSON schema: settings, times, counters, and the figures by which its result can be trusted.
//!
//! Every run fills one, also a run that was interrupted. Quantities carry their unit in their name or are pure numbers.

use crate::film::io::{WriteError, atomic_write};
use crate::progress::Stage;
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// Version of the schema: grows when a field changes its meaning or goes away.
pub const SCHEMA: u32 = 1;

/// The report of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunReport {
    /// Version of this schema.
    pub schema: u32,
    /// Version of the program.
    pub version: String,
    /// Scene file or its name.
    pub scene: String,
    /// Hash of everything that was read for the scene, 16 hexadecimal digits.
    pub scene_hash: String,
    /// Method of pass two, or `solve`, `probe`.
    pub method: String,
    /// Other settings by name, as typed or by default.
    pub settings: BTreeMap<String, serde_json::Value>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Threads that worked.
    pub threads: usize,
    /// Samples per pixel reached.
    pub samples_per_pixel: f64,
    /// The error the renderer predicts for its picture, as relMSE.
    pub estimated_relmse: Option<f64>,
    /// The stages kept and left out, and why.
    #[serde(default)]
    pub plan: Vec<StageDecision>,
    /// What leaving stages out saved, where that was measured.
    #[serde(default)]
    pub plan_saving: PlanSaving,
    /// Time by stage, in the order in which the stages began.
    pub stages: Vec<StageTime>,
    /// The picture at earlier times, where that was asked for. Writing these is in no time of the report.
    #[serde(default)]
    pub snapshots: Vec<SnapshotReport>,
    /// How often things were done: `camera_rays`, `shadow_rays`, `form_factors`, `sweeps` ...
    pub counters: BTreeMap<String, u64>,
    /// How well the form factors obey their laws, before any correction.
    pub closure: Option<Closure>,
    /// How the radiosity system was solved.
    pub solver: Option<SolverReport>,
    /// Where the emitted power went.
    pub power: Option<PowerBalance>,
    /// NaN or infinite results.
    pub not_finite: NotFinite,
    /// Samples so bright that they decide their pixel.
    pub fireflies: u64,
    /// Mean weight that the depth limit cut from a camera sample: times the radiance of the scene, the bias it left at most.
    pub truncated_share: f64,
    /// Triangles of the scene that were dropped: without area, or not finite.
    pub dropped_triangles: u64,
    /// What the reader or the renderer had to replace, drop or guess.
    pub warnings: Vec<String>,
    /// Largest resident memory of the process so far [bytes].
    pub peak_memory_bytes: u64,
    /// True if the run did all that was asked.
    pub complete: bool,
    /// Why it ended.
    pub stopped_by: StopReason,
}

/// What became of a stage that not every scene needs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageDecision {
    /// Name of the stage.
    pub stage: String,
    /// False if it was left out.
    pub kept: bool,
    /// Why.
    pub reason: String,
}

/// Time that a plan saved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlanSaving {
    /// How the figures were got, or why there are none.
    pub how: String,
    /// Stages left out.
    pub left_out: Vec<String>,
    /// The two runs, if there were two.
    pub measured: Option<MeasuredSaving>,
}

impl Default for PlanSaving {
    fn default() -> Self {
        let how = "not measured: render --time-plan renders a second time with every stage at work".to_owned();
        Self { how, left_out: Vec::new(), measured: None }
    }
}

/// One render beside the same one with every stage at work; times without loading and writing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeasuredSaving {
    /// Processor time of this run [s].
    pub lean_cpu_s: f64,
    /// Processor time of the other [s].
    pub full_cpu_s: f64,
    /// Difference of the two [s].
    pub saved_cpu_s: f64,
    /// The same on the clock [s].
    pub saved_wall_s: f64,
    /// True if all bits of both pictures and of their variances are equal.
    pub same_picture: bool,
}

/// Time spent in a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// Name of the stage.
    pub name: String,
    /// Time on the clock [s].
    pub wall_s: f64,
    /// Processor time of all threads, user and system [s].
    pub cpu_s: f64,
}

/// The picture so far at some moment of pass two.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SnapshotReport {
    /// The file that holds it.
    pub file: String,
    /// The processor time at which it was asked for [s].
    pub asked_cpu_s: f64,
    /// Samples per pixel.
    pub samples_per_pixel: f64,
    /// Time on the clock since the end of loading [s].
    pub wall_s: f64,
    /// Processor time since the end of loading: tree, pass one and pass two [s].
    pub cpu_s: f64,
    /// Rays of both passes.
    pub rays: u64,
    /// The error that was predicted then, as relMSE.
    pub estimated_relmse: Option<f64>,
}

/// Defects of the form factors as computed: all 0 if they are exact and the scene is closed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Closure {
    /// Smallest row sum; 1 in a closed scene.
    pub raw_row_sum_min: f64,
    /// Largest row sum; never above 1 in truth.
    pub raw_row_sum_max: f64,
    /// Largest |1 - row sum| over the patches of a closed scene, or by how much a row exceeds 1.
    pub worst_defect: f64,
    /// Largest |A_i F_ij - A_j F_ji| relative to the larger of both areas' products.
    pub reciprocity_defect: f64,
}

/// How a solver ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SolverReport {
    /// Name of the method.
    pub method: String,
    /// Sweeps or iterations.
    pub sweeps: u64,
    /// Bound on the relative error of the solution, not on its last change.
    pub error_bound: f64,
    /// Estimate of the condition of the equations, (1 + r)/(1 - r) with the spectral radius r of what reflection does to light.
    #[serde(default)]
    pub condition: f64,
    /// Estimate of the relative error by rows of form factors that do not close, in the mean, as interreflection amplifies it.
    #[serde(default)]
    pub closure_influence: f64,
    /// True if the bound is below the tolerance.
    pub converged: bool,
}

/// Where the emitted power went, summed over channels [W].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PowerBalance {
    /// Sent out by the lights.
    pub emitted: f64,
    /// Kept by surfaces.
    pub absorbed: f64,
    /// Left through openings of the scene.
    pub escaped: f64,
    /// Lost where paths were cut off; `None` if it was not measured.
    pub truncated: Option<f64>,
    /// |emitted - absorbed - escaped - truncated| / emitted: what nobody accounts for; 0 without light.
    pub relative_defect: f64,
}

/// NaN or infinite results: never hidden, and none in a right run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct NotFinite {
    /// How many pixels or samples.
    pub count: u64,
    /// Column and row of the first one.
    pub first_pixel: Option<[usize; 2]>,
}

/// Why a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// Nothing was left to do.
    #[default]
    Finished,
    /// The samples asked for were reached.
    Samples,
    /// The time on the clock was used up.
    Time,
    /// The processor time was used up.
    CpuTime,
    /// The error asked for was reached.
    Error,
    /// The caller stopped it.
    Interrupted,
    /// The radiosity solver did not reach its tolerance.
    NotConverged,
    /// It failed.
    Failed,
}

impl RunReport {
    /// An empty report of this version of the program.
    pub fn new(scene: impl Into<String>, scene_hash: u64, method: impl Into<String>) -> Self {
        Self {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene: scene.into(),
            scene_hash: format!("{scene_hash:016x}"),
            method: method.into(),
            settings: BTreeMap::new(),
            seed: 0,
            threads: 0,
            samples_per_pixel: 0.0,
            estimated_relmse: None,
            plan: Vec::new(),
            plan_saving: PlanSaving::default(),
            stages: Vec::new(),
            snapshots: Vec::new(),
            counters: BTreeMap::new(),
            closure: None,
            solver: None,
            power: None,
            not_finite: NotFinite::default(),
            fireflies: 0,
            truncated_share: 0.0,
            dropped_triangles: 0,
            warnings: Vec::new(),
            peak_memory_bytes: 0,
            complete: false,
            stopped_by: StopReason::default(),
        }
    }

    /// Adds to a counter.
    pub fn count(&mut self, name: &str, amount: u64) {
        *self.counters.entry(name.to_owned()).or_insert(0) += amount;
    }

    /// Adds time to a stage; a stage that runs again is one entry.
    pub fn add_time(&mut self, stage: Stage, time: Elapsed) {
        let name = stage.name();
        match self.stages.iter_mut().find(|s| s.name == name) {
            Some(entry) => {
                entry.wall_s += time.wall_s;
                entry.cpu_s += time.cpu_s;
            }
            None => self.stages.push(StageTime { name: name.to_owned(), wall_s: time.wall_s, cpu_s: time.cpu_s }),
        }
    }

    /// Does the work of a stage and adds its time.
    pub fn time<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let watch = Stopwatch::start();
        let result = work();
        self.add_time(stage, watch.elapsed());
        result
    }

    /// Time of all stages together.
    pub fn total(&self) -> Elapsed {
        let sum = |value: fn(&StageTime) -> f64| self.stages.iter().map(value).sum();
        Elapsed { wall_s: sum(|s| s.wall_s), cpu_s: sum(|s| s.cpu_s) }
    }

    /// Writes the report as JSON, atomically, with the memory peak up to now.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write(&mut self, path: &Path) -> Result<(), WriteError> {
        self.peak_memory_bytes = self.peak_memory_bytes.max(peak_memory_bytes());
        let json = serde_json::to_string_pretty(self).expect("text keys and plain values always become JSON");
        atomic_write(path, |file| Ok(writeln!(file, "{json}")?))
    }
}

/// A span of time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Elapsed {
    /// On the clock [s].
    pub wall_s: f64,
    /// Processor time of the process, all threads, user and system [s].
    pub cpu_s: f64,
}

/// Measures a span of time on the monotonic clock and in processor time.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    wall: Instant,
    cpu_s: f64,
}

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Self {
        Self { wall: Instant::now(), cpu_s: process_cpu_seconds() }
    }

    /// Time since the start.
    pub fn elapsed(&self) -> Elapsed {
        Elapsed { wall_s: self.wall.elapsed().as_secs_f64(), cpu_s: process_cpu_seconds() - self.cpu_s }
    }
}

/// Processor time of this process so far, user and system, all threads [s]; 0 if the system does not tell.
pub fn process_cpu_seconds() -> f64 {
    let seconds = |time: nix::sys::time::TimeVal| time.num_microseconds() as f64 * 1e-6;
    getrusage(UsageWho::RUSAGE_SELF).map_or(0.0, |u| seconds(u.user_time()) + seconds(u.system_time()))
}

/// Largest resident memory of this process so far [bytes]; 0 if the system does not tell.
pub fn peak_memory_bytes() -> u64 {
    // Linux counts in KiB.
    getrusage(UsageWho::RUSAGE_SELF).map_or(0, |u| u.max_rss().unsigned_abs() * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_comes_back_from_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.json");
        let mut report = RunReport::new("box", 0xabc, "two-pass");
        report.settings.insert("patch_size".into(), 0.25.into());
        report.count("shadow_rays", 3);
        report.count("shadow_rays", 4);
        report.power = Some(PowerBalance { emitted: 10.0, absorbed: 8.0, escaped: 1.0, truncated: None, relative_defect: 0.1 });
        report.not_finite = NotFinite { count: 2, first_pixel: Some([3, 4]) };
        report.stopped_by = StopReason::CpuTime;
        report.write(&path).unwrap();
        let read: RunReport = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        assert_eq!(read, report);
        assert_eq!((read.counters["shadow_rays"], read.scene_hash.as_str()), (7, "0000000000000abc"));
        assert!(read.peak_memory_bytes > 1 << 20);
        assert!(std::fs::read_to_string(&path).unwrap().contains("\"stopped_by\": \"cpu_time\""));
    }

    #[test]
    fn a_stage_that_runs_again_is_one_entry() {
        let mut report = RunReport::new("box", 0, "two-pass");
        report.add_time(Stage::Solve, Elapsed { wall_s: 1.0, cpu_s: 2.0 });
        report.add_time(Stage::Render, Elapsed { wall_s: 0.5, cpu_s: 0.5 });
        report.add_time(Stage::Solve, Elapsed { wall_s: 1.5, cpu_s: 1.0 });
        assert_eq!(report.stages.len(), 2);
        assert_eq!(report.stages[0], StageTime { name: "solve".into(), wall_s: 2.5, cpu_s: 3.0 });
        assert_eq!(report.total(), Elapsed { wall_s: 3.0, cpu_s: 3.5 });
    }

    /// Two threads that work: processor time exceeds that of either; a sleeping process uses the clock only.
    #[test]
    fn the_stopwatch_tells_working_from_waiting() {
        let watch = Stopwatch::start();
        std::thread::sleep(std::time::Duration::from_millis(30));
        assert!(watch.elapsed().wall_s >= 0.03);
        let watch = Stopwatch::start();
        while process_cpu_seconds() - watch.cpu_s < 0.02 {
            std::hint::black_box(0);
        }
        assert!(watch.elapsed().cpu_s >= 0.02);
    }
}
