//! How a long run speaks to its caller: one event type, one observer that can stop the run.
//!
//! The library never prints. Whoever calls it passes an observer and draws what it likes.

use std::ops::ControlFlow;

/// A stage of a run, in the order in which they happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Reading the scene file, its meshes and its textures.
    Load,
    /// Building the ray acceleration structure.
    Tree,
    /// Cutting the scene into patches.
    Patches,
    /// Direct irradiance of the patches by shadow rays.
    PatchDirect,
    /// Form factors.
    FormFactors,
    /// Solving the radiosity system.
    Solve,
    /// Pass two: the picture.
    Render,
    /// Writing files.
    Write,
}

impl Stage {
    /// Name for reports and progress bars.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Load => "load",
            Stage::Tree => "tree",
            Stage::Patches => "patches",
            Stage::PatchDirect => "patch_direct",
            Stage::FormFactors => "form_factors",
            Stage::Solve => "solve",
            Stage::Render => "render",
            Stage::Write => "write",
        }
    }
}

/// One progress event: `done` of `total` units of `stage`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// Units done so far; a fraction is allowed.
    pub done: f64,
    /// Units in all; 0 when it is not known.
    pub total: f64,
}

/// Receives progress events and may stop the run by returning `ControlFlow::Break`.
///
/// It is called from the thread that started the run only.
pub type Observer<'a> = dyn FnMut(&Progress) -> ControlFlow<()> + 'a;

/// An observer that listens to nothing and never stops a run.
pub fn silent(_: &Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}
