//! The runs that a plan asks for, one after another.

use super::judge::Judge;
use super::plan::{MethodKind, MethodPlan, Plan, ScenePlan, Tuning, combinations};
use super::row::{Row, RowKind};
use super::store::Digest;
use std::collections::BTreeMap;
use std::time::Duration;

/// What a run gives.
#[derive(Debug, Clone, PartialEq)]
pub enum Work {
    /// Pictures at these processor times, ascending [s].
    Cpu(Vec<f64>),
    /// One picture of so many samples per pixel.
    Spp(u32),
    /// The same by a command of somebody else.
    External(u32),
    /// A solution of pass one.
    Solve,
}

/// One process to be run.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// Index of the scene in the plan.
    pub scene: usize,
    /// Index of the method.
    pub method: usize,
    /// Flags of this program.
    pub flags: BTreeMap<String, String>,
    /// The command of an external method.
    pub command: String,
    /// The flags that vary, for the name of the budget.
    pub label: String,
    /// What it gives.
    pub work: Work,
    /// Seed.
    pub seed: u64,
    /// Repetition.
    pub repeat: u32,
    /// Time after which it is killed.
    pub timeout: Duration,
    /// A row of it with everything filled in that is known before.
    pub row: Row,
}

impl Job {
    /// Name of a budget, with the flags that vary.
    pub fn budget(&self, budget: &str) -> String {
        [budget, self.label.as_str()].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
    }

    /// True if the row belongs to this run, whichever budget it met.
    pub fn owns(&self, row: &Row) -> bool {
        let mine = &self.row;
        let same = |of: fn(&Row) -> &str| of(row) == of(mine);
        let budget = match &self.work {
            Work::Cpu(times) => times.iter().any(|t| row.budget == self.budget(&format!("cpu={t}"))),
            _ => row.budget == mine.budget,
        };
        budget
            && same(|r| &r.scene)
            && same(|r| &r.method)
            && same(|r| &r.scene_hash)
            && same(|r| &r.settings_hash)
            && (row.seed, row.repeat, row.kind) == (mine.seed, mine.repeat, mine.kind)
    }

    /// Name for files.
    pub fn file_name(&self, budget: &str) -> String {
        format!("{} seed={} repeat={}", budget, self.seed, self.repeat).replace(['/', ' '], "_")
    }
}

/// What the runs on a scene share.
pub struct SceneFacts<'a> {
    /// Hash of the scene.
    pub hash: &'a str,
    /// Its references.
    pub judge: &'a Judge,
}

/// All runs of a plan in order. Repetitions are outermost, so that a change of the machine's mood meets all methods alike.
pub fn jobs(plan: &Plan, facts: &[SceneFacts<'_>]) -> Vec<Job> {
    let mut all = Vec::new();
    for repeat in 0..plan.repeats {
        for &seed in &plan.seeds {
            for (s, scene) in plan.scenes.iter().enumerate() {
                for (m, method) in plan.methods.iter().enumerate().filter(|(_, method)| method.runs_on(&scene.name)) {
                    all.extend(jobs_of(plan, (s, scene), (m, method), &facts[s]).into_iter().map(|mut job| {
                        (job.seed, job.repeat) = (seed, repeat);
                        (job.row.seed, job.row.repeat) = (seed, repeat);
                        job
                    }));
                }
            }
        }
    }
    all
}

fn jobs_of(plan: &Plan, (s, scene): (usize, &ScenePlan), (m, method): (usize, &MethodPlan), facts: &SceneFacts<'_>) -> Vec<Job> {
    let tuning = method.tuning_on(scene);
    let works = works(method.kind, &tuning);
    let timeout = Duration::from_secs_f64(tuning.timeout.unwrap_or(f64::MAX).min(1e9));
    let mut all = Vec::new();
    for (label, flags) in combinations(&tuning.flags) {
        for work in &works {
            let command = tuning.command.clone().unwrap_or_default();
            let row = Row::default();
            let (label, work, flags) = (label.clone(), work.clone(), flags.clone());
            let mut job = Job { scene: s, method: m, flags, command, label, work, seed: 0, repeat: 0, timeout, row };
            job.row = Row {
                scene: scene.name.clone(),
                method: method.name.clone(),
                kind: if method.kind == MethodKind::PassOne { RowKind::PassOne } else { RowKind::Picture },
                budget: last_budget(&job),
                scene_hash: facts.hash.to_owned(),
                settings_hash: settings_hash(plan, scene, &job, facts.judge).text(),
                ..Row::default()
            };
            all.push(job);
        }
    }
    all
}

/// Processor times come before samples where this program can meet them: one run then gives all pictures.
fn works(kind: MethodKind, tuning: &Tuning) -> Vec<Work> {
    let spp = tuning.spp.iter().flatten();
    match (kind, &tuning.cpu) {
        (MethodKind::PassOne, _) => vec![Work::Solve],
        (MethodKind::External, _) => spp.map(|n| Work::External(*n)).collect(),
        (MethodKind::Render, Some(times)) => vec![Work::Cpu(times.clone())],
        (MethodKind::Render, None) => spp.map(|n| Work::Spp(*n)).collect(),
    }
}

/// The budget that the end of a run meets.
fn last_budget(job: &Job) -> String {
    match &job.work {
        Work::Cpu(times) => job.budget(&format!("cpu={}", times.last().copied().unwrap_or(0.0))),
        Work::Spp(spp) | Work::External(spp) => job.budget(&format!("spp={spp}")),
        Work::Solve if job.label.is_empty() => "solution".to_owned(),
        Work::Solve => job.label.clone(),
    }
}

fn settings_hash(plan: &Plan, scene: &ScenePlan, job: &Job, judge: &Judge) -> Digest {
    let mut digest = judge.digest;
    let solution = match job.work {
        Work::Solve => format!("{:?} {}", scene.reference_solution, plan.points),
        _ => String::new(),
    };
    let times = match &job.work {
        Work::Cpu(times) => format!("{times:?}"),
        _ => String::new(),
    };
    let parts = [
        format!("{:?}", job.flags),
        job.command.clone(),
        times,
        solution,
        format!("{:?} {:?} {}", scene.size, scene.defines, plan.threads),
    ];
    parts.iter().for_each(|part| digest.add(part.as_bytes()));
    digest
}
