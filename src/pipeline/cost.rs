//! What each stage of a run cost in wall and CPU seconds.

use crate::progress::Stage;
use crate::run_report::{Elapsed, Stopwatch};

/// Time spent in one stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageCost {
    /// Which.
    pub stage: Stage,
    /// What it took.
    pub time: Elapsed,
}

/// Collects the costs of stages.
#[derive(Debug, Clone, Default)]
pub struct StageCosts {
    /// Costs so far, in order.
    pub stages: Vec<StageCost>,
}

impl StageCosts {
    /// Runs `work` and records what it cost.
    pub fn time<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let watch = Stopwatch::start();
        let result = work();
        self.stages.push(StageCost { stage, time: watch.elapsed() });
        result
    }

    /// Adds stages that ran inside the last one recorded, and takes their time from it.
    pub fn move_from_last(&mut self, inner: StageCosts) {
        if let Some(last) = self.stages.last_mut() {
            for cost in &inner.stages {
                last.time.wall_s -= cost.time.wall_s;
                last.time.cpu_s -= cost.time.cpu_s;
            }
        }
        self.stages.extend(inner.stages);
    }

    /// Takes wall and CPU seconds off a stage: work within it that is no part of the run.
    pub fn take_off(&mut self, stage: Stage, (wall_s, cpu_s): (f64, f64)) {
        if let Some(cost) = self.stages.iter_mut().rev().find(|cost| cost.stage == stage) {
            cost.time.wall_s -= wall_s;
            cost.time.cpu_s -= cpu_s;
        }
    }
}
