//! The ways to form factors, by name.

use serde::{Deserialize, Serialize};

/// How form factors are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FormFactorMethod {
    /// Cosine-distributed rays from each patch.
    #[default]
    RayCast,
    /// Links between groups of patches.
    Hierarchical,
}

impl FormFactorMethod {
    /// All, in the order of the documentation.
    pub const ALL: [FormFactorMethod; 2] = [FormFactorMethod::RayCast, FormFactorMethod::Hierarchical];

    /// The `--tolerance` that it has unless the user gives one. Of cast rays it is the standard error of a form factor, of links the bound on
    /// the error that each leaves to the form factors between its nodes.
    pub fn default_tolerance(self) -> f64 {
        match self {
            // 512 rays a patch.
            FormFactorMethod::RayCast => 0.0221,
            FormFactorMethod::Hierarchical => 1e-3,
        }
    }

    /// Name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            FormFactorMethod::RayCast => "ray-cast",
            FormFactorMethod::Hierarchical => "hierarchical",
        }
    }
}
