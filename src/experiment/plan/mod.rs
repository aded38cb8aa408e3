//! The plan of an experiment: a TOML file of scenes, methods, budgets and seeds.
//!
//! Settings of a method are flags of the command line under their own names (`gather_rays = 4` is `--gather-rays=4`), so that a plan
//! can ask for whatever the program can do. Whether it can is for the caller to say, by a function that looks at a command line.

mod read;
mod table;

pub use table::Fault;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Flags of the command line by name, without dashes in front; a list of values is a sweep.
pub type Flags = BTreeMap<String, Vec<String>>;

/// A plan that was read, with absolute paths.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// What it is about.
    pub title: String,
    /// The file's text.
    pub text: String,
    /// The folder in which the file lies.
    pub folder: PathBuf,
    /// Threads of each run; 0: one per core.
    pub threads: usize,
    /// Seeds: each is a run of its own.
    pub seeds: Vec<u64>,
    /// How often each run is repeated with the same seed.
    pub repeats: u32,
    /// Points at which solutions of pass one are compared.
    pub points: u32,
    /// The clock that the page shows first, by its name there; empty: CPU time.
    pub clock: String,
    /// Scenes, in order.
    pub scenes: Vec<ScenePlan>,
    /// Methods, in order.
    pub methods: Vec<MethodPlan>,
    /// Scenes and methods that are left out because something that they need is not there, a line each.
    pub left_out: Vec<String>,
}

/// A scene of a plan.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ScenePlan {
    /// Its name.
    pub name: String,
    /// Its file.
    pub file: PathBuf,
    /// The file as the plan names it.
    pub file_as_written: String,
    /// One reference or two independent ones.
    pub references: Vec<PathBuf>,
    /// Pixels that count nowhere.
    pub mask: Option<PathBuf>,
    /// Pixels that see an emitter.
    pub emitters: Option<PathBuf>,
    /// Size of the pictures; `None`: the scene's.
    pub size: Option<(usize, usize)>,
    /// Values for the scene's parameters.
    pub defines: Vec<(String, String)>,
    /// Other folders that it may read.
    pub allow_paths: Vec<PathBuf>,
    /// What differs for single methods here, by their names.
    pub overrides: BTreeMap<String, Tuning>,
    /// Budgets and time limit of this scene.
    pub tuning: Tuning,
    /// Settings of the reference solution of pass one.
    pub reference_solution: Option<ReferenceSolution>,
}

/// A method of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct MethodPlan {
    /// Its name.
    pub name: String,
    /// One line on what it is.
    pub about: String,
    /// What is run.
    pub kind: MethodKind,
    /// Only these scenes; `None`: all.
    pub scenes: Option<Vec<String>>,
    /// Not these scenes.
    pub except: Vec<String>,
    /// Settings, budgets and time limit.
    pub tuning: Tuning,
    /// Line of the plan at which it begins.
    pub line: usize,
}

/// What a method runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MethodKind {
    /// This program's `render`.
    Render,
    /// A command line of somebody else.
    External,
    /// This program's `solve`: pass one alone, compared with a fine solution.
    PassOne,
}

/// What may be set for the plan, a scene, a method, or a method at a scene; the later one of these wins.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tuning {
    /// Flags of the program.
    pub flags: Flags,
    /// The command of an external method.
    pub command: Option<String>,
    /// Processor times at which the picture of one run is judged [s].
    pub cpu: Option<Vec<f64>>,
    /// Samples per pixel, each a run of its own.
    pub spp: Option<Vec<u32>>,
    /// Wall seconds after which a run is ended.
    pub timeout: Option<f64>,
}

/// How the solution of pass one is made with which others are compared.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceSolution {
    /// Flags of `solve`.
    pub flags: Flags,
    /// One seed or two: of two, squared errors are cross products, which have no floor by the reference's own noise.
    pub seeds: Vec<u64>,
    /// Wall seconds after which it is given up.
    pub timeout: f64,
}

/// Whether the program can do what a command line says.
pub enum Verdict {
    /// It can.
    Known,
    /// Not this build: the method is left out, for this reason.
    Unavailable(String),
    /// No such flag or value.
    Wrong(String),
}

/// What a plan is read with.
pub struct Reading<'a> {
    /// Values for `$NAME` in names of files and commands.
    pub defines: &'a [(String, String)],
    /// Looks at a subcommand and its flags.
    pub judge: &'a dyn Fn(&[String]) -> Verdict,
    /// True if a command ends well; what a method says it needs is tried by it.
    pub succeeds: &'a dyn Fn(&str, &Path) -> bool,
}

/// A plan that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The file cannot be read.
    #[error("cannot read {}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's words.
        error: std::io::Error,
    },
    /// Something in it is wrong.
    #[error("{}:{}: {}", path.display(), fault.line, fault.detail)]
    Fault {
        /// The file.
        path: PathBuf,
        /// What and where.
        fault: Fault,
    },
}

impl Plan {
    /// Reads a plan. Relative paths in it are relative to its folder.
    ///
    /// # Errors
    /// [`PlanError`] with file and line.
    pub fn read(path: &Path, reading: &Reading<'_>) -> Result<Plan, PlanError> {
        let text = std::fs::read_to_string(path).map_err(|error| PlanError::Io { path: path.to_owned(), error })?;
        let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let folder = absolute.parent().unwrap_or(Path::new("/")).to_owned();
        read::plan(&text, &folder, reading).map_err(|fault| PlanError::Fault { path: path.to_owned(), fault })
    }

    /// True if the scene or the method is in the plan but left out this time: rows of an earlier start, when all was there, stay.
    pub fn leaves_out(&self, scene: &str, method: &str) -> bool {
        let (scene, method) = (format!("scene {scene}:"), format!("method {method}:"));
        self.left_out.iter().any(|line| line.starts_with(&scene) || line.starts_with(&method))
    }

    /// The first of these names that the plan does not know, in a sentence.
    pub fn unknown(&self, scenes: &[String], methods: &[String]) -> Option<String> {
        let scene = scenes.iter().find(|name| !self.scenes.iter().any(|s| s.name == **name));
        let method = methods.iter().find(|name| !self.methods.iter().any(|m| m.name == **name));
        let sentence = |what: &str, name: &String| format!("the plan has no {what} \"{name}\", or it is left out");
        scene.map(|name| sentence("scene", name)).or_else(|| method.map(|name| sentence("method", name)))
    }
}

impl MethodPlan {
    /// True if it is to run on this scene.
    pub fn runs_on(&self, scene: &str) -> bool {
        self.scenes.as_ref().is_none_or(|names| names.iter().any(|n| n == scene)) && !self.except.iter().any(|n| n == scene)
    }

    /// Its settings on a scene.
    pub fn tuning_on(&self, scene: &ScenePlan) -> Tuning {
        let mut tuning = scene.tuning.clone().with(&self.tuning);
        if let Some(special) = scene.overrides.get(&self.name) {
            tuning = tuning.with(special);
        }
        tuning
    }
}

impl Tuning {
    /// These settings, replaced where `other` has some.
    pub fn with(mut self, other: &Tuning) -> Tuning {
        self.flags.extend(other.flags.clone());
        // A budget of one kind replaces one of the other.
        if other.cpu.is_some() || other.spp.is_some() {
            (self.cpu, self.spp) = (other.cpu.clone(), other.spp.clone());
        }
        self.command = other.command.clone().or(self.command);
        self.timeout = other.timeout.or(self.timeout);
        self
    }
}

/// Words of a command line for flags of one value each.
pub fn words<'f>(flags: impl IntoIterator<Item = (&'f String, &'f String)>) -> Vec<String> {
    let word = |(name, value): (&String, &String)| match value.as_str() {
        "true" => Some(format!("--{name}")),
        "false" => None,
        value => Some(format!("--{name}={value}")),
    };
    flags.into_iter().filter_map(word).collect()
}

/// All combinations of the values of flags, each with a label of those that vary.
pub fn combinations(flags: &Flags) -> Vec<(String, BTreeMap<String, String>)> {
    let mut all = vec![(Vec::new(), BTreeMap::new())];
    for (name, values) in flags {
        let longer = all.iter().flat_map(|(label, chosen): &(Vec<String>, BTreeMap<String, String>)| {
            values.iter().map(move |value| {
                let (mut label, mut chosen) = (label.clone(), chosen.clone());
                if values.len() > 1 {
                    label.push(format!("{}={value}", name.replace('-', "_")));
                }
                chosen.insert(name.clone(), value.clone());
                (label, chosen)
            })
        });
        all = longer.collect();
    }
    all.into_iter().map(|(label, chosen)| (label.join(" "), chosen)).collect()
}
