//! What one measured picture leaves behind, and what all of them share.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// It gave a picture, which was judged.
    #[default]
    Done,
    /// It ended with an error.
    Failed,
    /// It was stopped after the plan's time limit.
    TimedOut,
    /// Its picture could not be judged: another size, not finite, or not there.
    Unusable,
}

/// What a row is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RowKind {
    /// A picture against reference pictures.
    #[default]
    Picture,
    /// A solution of pass one against a fine solution. `relmse` is then the sum over points and channels of (H−A)(H−B) over that of AB:
    /// the squared relative error of the irradiance in the area-weighted mean square, A and B two reference solutions of other seeds
    /// (or both the same one).
    PassOne,
}

/// One picture of one run, measured. A run that gave pictures at several times is several rows.
///
/// Times are of everything after loading (tree, pass one, pass two; judging and writing pictures excluded), as the sum over stages.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Row {
    /// Name of the scene in the plan.
    pub scene: String,
    /// Name of the method in the plan.
    pub method: String,
    /// What was compared.
    #[serde(default)]
    pub kind: RowKind,
    /// What was asked for, such as `spp=64` or `cpu=2`; of pass one the settings that vary, such as `tolerance=0.1`.
    pub budget: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Which repetition of the same settings and seed, from 0.
    pub repeat: u32,
    /// How it ended; the figures below mean something only for `done`.
    pub status: Status,
    /// What went wrong, or empty.
    pub message: String,
    /// Samples per pixel.
    pub spp: f64,
    /// Wall seconds after loading.
    pub wall_s: f64,
    /// CPU seconds (user and system, all threads) after loading.
    pub cpu_s: f64,
    /// CPU seconds of loading: parse and scene, no tree.
    pub load_cpu_s: f64,
    /// CPU seconds of the ray engine's tree; empty if the method does not tell.
    pub tree_cpu_s: Option<f64>,
    /// CPU seconds of pass one: patches, direct light, form factors, solve; empty if there is none.
    pub pass_one_cpu_s: Option<f64>,
    /// CPU seconds of the solver within pass one; empty if there is none.
    #[serde(default)]
    pub solve_cpu_s: Option<f64>,
    /// Products with the form factors, or sweeps over them, that the solver took; empty if there is none.
    #[serde(default)]
    pub products: Option<u64>,
    /// CPU seconds of pass two.
    pub pass_two_cpu_s: Option<f64>,
    /// Rays of all kinds; empty if the method does not tell.
    pub rays: Option<u64>,
    /// Largest resident memory of the run's process [bytes].
    pub peak_memory_bytes: Option<u64>,
    /// The relmse that the method predicts for its own picture.
    pub predicted_relmse: Option<f64>,
    /// As `twopass compare`.
    pub relmse: Option<f64>,
    /// Bootstrap standard error of `relmse`.
    pub relmse_se: Option<f64>,
    /// As `twopass compare`.
    pub trimmed_relmse: Option<f64>,
    /// As `twopass compare`; needs a mask of emitters.
    pub relmse_off_emitters: Option<f64>,
    /// Mean of the picture over the mean of the reference, red.
    pub mean_ratio_r: Option<f64>,
    /// Green.
    pub mean_ratio_g: Option<f64>,
    /// Blue.
    pub mean_ratio_b: Option<f64>,
    /// As `twopass compare`.
    pub block9_rms: Option<f64>,
    /// Mean LDR FLIP at 67 pixels per degree.
    pub flip_ldr: Option<f64>,
    /// Mean HDR FLIP at 67 pixels per degree.
    pub flip_hdr: Option<f64>,
    /// The picture, relative to the experiment's folder; empty if it was not kept.
    pub image: String,
    /// Load average of the machine (1 minute) when the run began.
    pub load_average: f64,
    /// Hash of everything that was read for the scene, 16 hexadecimal digits.
    #[serde(default)]
    pub scene_hash: String,
    /// Hash of everything else on which the row depends but budget, seed and repetition: settings, command, size, references.
    #[serde(default)]
    pub settings_hash: String,
    /// Version and commit of the program that measured it.
    #[serde(default)]
    pub program: String,
}

/// A scene of an experiment.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SceneRecord {
    /// Name in the plan.
    pub name: String,
    /// Its file, as the plan names it.
    pub file: String,
    /// Hash of everything that was read for it, 16 hexadecimal digits.
    pub hash: String,
    /// The two independent references, relative to the experiment's folder (copies), or empty.
    pub references: Vec<String>,
    /// The references' own relmse, from their difference.
    pub reference_relmse: Option<f64>,
    /// What the program left out for this scene and why, a line each.
    pub left_out: Vec<String>,
    /// Warnings of its reader.
    pub warnings: Vec<String>,
}

/// Everything a report is made from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Outcome {
    /// Title of the plan.
    pub title: String,
    /// The plan as it was read, in TOML.
    pub plan: String,
    /// The clock that the page shows first, by its name there; empty: CPU time.
    #[serde(default)]
    pub clock: String,
    /// Machine and versions by name: CPU model, cores, threads used, operating system, version and commit of the program, date ...
    pub environment: BTreeMap<String, String>,
    /// Scenes in the order of the plan.
    pub scenes: Vec<SceneRecord>,
    /// Methods in the order of the plan: name and one line on what it is.
    pub methods: Vec<(String, String)>,
    /// All rows, in the order in which they were measured.
    #[serde(skip)]
    pub rows: Vec<Row>,
}
