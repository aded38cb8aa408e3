//! What each stage cost in wall and CPU seconds.

use crate::progress::Stage;
use nix::sys::resource::{UsageWho, getrusage};
use std::time::Instant;

/// Time spent in one stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageCost {
    /// Which.
    pub stage: Stage,
    /// Wall seconds.
    pub wall: f64,
    /// CPU seconds of the whole process, user and system.
    pub cpu: f64,
}

/// CPU seconds of this process so far, user and system; 0 where the system does not tell.
pub fn cpu_seconds() -> f64 {
    getrusage(UsageWho::RUSAGE_SELF).map_or(0.0, |usage| {
        let seconds = |t: nix::sys::time::TimeVal| t.tv_sec() as f64 + t.tv_usec() as f64 * 1e-6;
        seconds(usage.user_time()) + seconds(usage.system_time())
    })
}

/// Collects the costs of stages.
#[derive(Debug, Clone, Default)]
pub struct Stopwatch {
    /// Costs so far, in order.
    pub stages: Vec<StageCost>,
}

impl Stopwatch {
    /// Runs `work` and records what it cost.
    pub fn time<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let (started, cpu) = (Instant::now(), cpu_seconds());
        let result = work();
        self.stages.push(StageCost { stage, wall: started.elapsed().as_secs_f64(), cpu: cpu_seconds() - cpu });
        result
    }
}
