//! The pass loop: runs an integrator until its budget is spent. The only place in pass two that knows time.

use super::{Frame, Integrator};
use crate::film::Film;
use crate::progress::{Observer, Progress, Stage};
use crate::world::walk::RayCounts;
use std::cell::Cell;
use std::ops::ControlFlow;
use std::time::Instant;

/// When to stop; the first limit met ends the run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Budget {
    /// Samples per pixel.
    pub spp: Option<u32>,
    /// Wall seconds since `started`.
    pub time: Option<f64>,
    /// CPU seconds (user and system) of the process since `cpu_started`.
    pub cpu_time: Option<f64>,
    /// Predicted relmse.
    pub error: Option<f64>,
}

impl Budget {
    /// True if no limit is set.
    pub fn is_unlimited(&self) -> bool {
        *self == Budget::default()
    }
}

/// What the caller of a run sees after each pass: the film, the rays of pass two so far, and the method.
pub type Snapshot<'a> = dyn FnMut(&Film, &RayCounts, &dyn Integrator) + 'a;

/// Clocks against which a budget runs; made at the end of loading.
#[derive(Debug, Clone)]
pub struct Clocks {
    started: Instant,
    cpu_started: f64,
    cpu_now: fn() -> f64,
    /// Wall and CPU seconds that do not count.
    excluded: Cell<(f64, f64)>,
    /// Wall and CPU seconds that an interrupted run spent before this one goes on with it.
    before: (f64, f64),
}

impl Clocks {
    /// Starts now. `cpu_now` gives the CPU seconds of the process so far.
    pub fn start(cpu_now: fn() -> f64) -> Self {
        Self { started: Instant::now(), cpu_started: cpu_now(), cpu_now, excluded: Cell::default(), before: (0.0, 0.0) }
    }

    /// The same clocks, ahead by what an interrupted run spent (wall and CPU seconds).
    #[must_use]
    pub fn after(self, before: (f64, f64)) -> Self {
        Self { before, ..self }
    }

    /// Wall seconds since the start that count.
    pub fn wall(&self) -> f64 {
        self.before.0 + self.started.elapsed().as_secs_f64() - self.excluded.get().0
    }

    /// CPU seconds since the start that count.
    pub fn cpu(&self) -> f64 {
        self.before.1 + (self.cpu_now)() - self.cpu_started - self.excluded.get().1
    }

    /// Wall and CPU seconds that count.
    pub fn read(&self) -> (f64, f64) {
        (self.wall(), self.cpu())
    }

    /// Does work that is no part of the run, such as writing pictures by which the run is measured: it counts for no budget.
    pub fn exclude<T>(&self, work: impl FnOnce() -> T) -> T {
        let before = self.read();
        let result = work();
        let (wall, cpu) = self.excluded.get();
        self.excluded.set((wall + self.wall() - before.0, cpu + self.cpu() - before.1));
        result
    }

    /// Wall and CPU seconds that were excluded so far.
    pub fn excluded(&self) -> (f64, f64) {
        self.excluded.get()
    }
}

/// What a run of passes gave.
pub struct Driven {
    /// The film.
    pub film: Film,
    /// Rays cast.
    pub counts: RayCounts,
    /// False if the observer stopped it before its budget was met.
    pub complete: bool,
}

/// The predicted error is looked at only after this many passes: from fewer it is too rough to stop on.
const PASSES_BEFORE_ERROR: u32 = 8;

/// A film and its rays at the end of an interrupted run.
pub type Before<'a> = Option<(&'a Film, RayCounts)>;

/// Runs passes until the budget is met or the observer stops it, after those that `before` holds. `snapshot` sees the film after each
/// pass.
pub fn drive(
    integrator: &mut dyn Integrator,
    (frame, before): (&Frame, Before<'_>),
    budget: &Budget,
    clocks: &Clocks,
    observer: &mut Observer<'_>,
    snapshot: &mut Snapshot<'_>,
) -> Driven {
    let (mut film, mut counts) = match before {
        Some((film, counts)) => (film.clone(), counts),
        None => {
            let film = Film::new(frame.crop[2], frame.crop[3]).signed(integrator.is_signed());
            (film.with_error_over_noise(integrator.error_over_noise()), RayCounts::default())
        }
    };
    film = film.controlled(integrator.knows_beforehand()).filtered(integrator.is_filtered());
    let start = Start { wall: clocks.wall(), cpu: clocks.cpu(), passes: film.n_passes() };
    let mut index = film.n_passes();
    if index > 0 && fraction_done(budget, clocks, &start, &film) >= 1.0 {
        return Driven { film, counts, complete: true };
    }
    loop {
        integrator.look_at(&film);
        let (samples, pass_counts) = integrator.pass(frame, index);
        if let Some(level) = integrator.level_of_earlier() {
            film.scale_indirect(level);
        }
        film.add_pass(index, &samples);
        counts += pass_counts;
        index += 1;
        snapshot(&film, &counts, integrator);
        let done = fraction_done(budget, clocks, &start, &film);
        if done >= 1.0 {
            film.develop();
            return Driven { film, counts, complete: true };
        }
        if let ControlFlow::Break(()) = observer(&Progress { stage: Stage::Render, done, total: 1.0 }) {
            return Driven { film, counts, complete: false };
        }
    }
}

/// Where the passes of this process began.
struct Start {
    wall: f64,
    cpu: f64,
    passes: u32,
}

/// Share of the budget that is spent: the largest over its limits. A time limit also ends the run when the next pass would overrun
/// it by more than it would leave unused.
fn fraction_done(budget: &Budget, clocks: &Clocks, started: &Start, film: &Film) -> f64 {
    let passes = film.n_passes();
    let timed = |limit: f64, now: f64, start: f64| {
        let per_pass = (now - start) / f64::from((passes - started.passes).max(1));
        if now + 0.5 * per_pass >= limit { 1.0 } else { now / limit }
    };
    let by_spp = budget.spp.map_or(0.0, |spp| f64::from(passes) / f64::from(spp));
    let by_time = budget.time.map_or(0.0, |t| timed(t, clocks.wall(), started.wall));
    let by_cpu = budget.cpu_time.map_or(0.0, |t| timed(t, clocks.cpu(), started.cpu));
    let reached = |goal: f64| film.estimated_relmse().map_or(0.0, |now| (goal / now).min(1.0));
    // It takes about as long as a pass to know, so it is not asked after each when there are many.
    let is_asked = passes >= PASSES_BEFORE_ERROR && passes.is_multiple_of((passes / PASSES_BEFORE_ERROR).next_power_of_two());
    let by_error = budget.error.filter(|_| is_asked).map_or(0.0, reached);
    by_spp.max(by_time).max(by_cpu).max(by_error)
}
