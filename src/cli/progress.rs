//! Draws progress events on stderr; the only file that knows the terminal.
//!
//! On a terminal a bar with the time left; asked for on a pipe, a line now and then. A stage that ends within a second shows
//! nothing.

use super::args::{Common, ProgressMode};
use super::interrupt::Interrupt;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};
use twopass::progress::{Progress, Stage};

/// A stage younger than this shows nothing: most end before.
const PATIENCE: Duration = Duration::from_millis(700);

/// Time between two lines on a pipe.
const LINE_INTERVAL: Duration = Duration::from_secs(2);

/// Steps of a bar; events bring fractions.
const STEPS: u64 = 1000;

/// What the library calls: draws each event and stops the run once a signal has arrived.
pub fn observer(mut display: Display, interrupt: &Interrupt) -> impl FnMut(&Progress) -> ControlFlow<()> + '_ {
    move |event| {
        display.update(event);
        if interrupt.signal().is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// Receives the events of a run.
pub struct Display {
    target: Target,
    current: Option<Current>,
}

enum Target {
    Nothing,
    Bars,
    Lines,
}

/// The stage under way.
struct Current {
    stage: Stage,
    started: Instant,
    /// When a line was last written.
    last_line: Instant,
    bar: Option<ProgressBar>,
}

impl Display {
    /// As the flags and the terminal have it.
    pub fn new(common: &Common) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let target = match common.progress {
            ProgressMode::Never => Target::Nothing,
            ProgressMode::Auto if common.quiet || !terminal => Target::Nothing,
            ProgressMode::Always if !terminal => Target::Lines,
            ProgressMode::Auto | ProgressMode::Always => Target::Bars,
        };
        Self { target, current: None }
    }

    /// Takes one event.
    pub fn update(&mut self, event: &Progress) {
        if self.current.as_ref().is_none_or(|c| c.stage != event.stage) {
            self.finish();
            let now = Instant::now();
            self.current = Some(Current { stage: event.stage, started: now, last_line: now, bar: None });
        }
        let Some(current) = &mut self.current else { return };
        if current.started.elapsed() < PATIENCE {
            return;
        }
        match self.target {
            Target::Nothing => {}
            Target::Bars => current.draw(event),
            Target::Lines => current.write_line(event),
        }
    }

    /// Takes the bar away.
    fn finish(&mut self) {
        if let Some(bar) = self.current.take().and_then(|c| c.bar) {
            bar.finish_and_clear();
        }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        self.finish();
    }
}

impl Current {
    fn draw(&mut self, event: &Progress) {
        let (stage, started) = (self.stage, self.started);
        let bar = self.bar.get_or_insert_with(|| new_bar(stage, event.total > 0.0, started));
        bar.set_position((fraction(event) * STEPS as f64) as u64);
    }

    fn write_line(&mut self, event: &Progress) {
        if self.last_line.elapsed() < LINE_INTERVAL {
            return;
        }
        self.last_line = Instant::now();
        let line = line(event, self.started.elapsed().as_secs_f64());
        let _ = writeln!(std::io::stderr(), "{line}");
    }
}

fn new_bar(stage: Stage, known: bool, started: Instant) -> ProgressBar {
    let template =
        if known { "{msg:12} {wide_bar} {percent:>3} %  {elapsed}, {eta} left" } else { "{msg:12} {spinner} {elapsed}" };
    let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr());
    bar.set_style(ProgressStyle::with_template(template).expect("the template is fixed and right"));
    bar.set_message(stage.name());
    bar.with_elapsed(started.elapsed())
}

fn fraction(event: &Progress) -> f64 {
    if event.total > 0.0 { (event.done / event.total).clamp(0.0, 1.0) } else { 0.0 }
}

/// A line for a log: what, how much, how long it will take if the rest goes like the part done.
fn line(event: &Progress, elapsed_s: f64) -> String {
    let (name, done) = (event.stage.name(), fraction(event));
    if done == 0.0 {
        return format!("{name}: {elapsed_s:.0} s");
    }
    let left = elapsed_s * (1.0 - done) / done;
    format!("{name}: {:.0} % in {elapsed_s:.0} s, {left:.0} s left", 100.0 * done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rest_is_expected_to_go_like_the_part_done() {
        let event = |done, total| Progress { stage: Stage::Render, done, total };
        assert_eq!(line(&event(25.0, 100.0), 10.0), "render: 25 % in 10 s, 30 s left");
        assert_eq!(line(&event(0.0, 100.0), 10.0), "render: 10 s");
        assert_eq!(line(&event(5.0, 0.0), 10.0), "render: 10 s");
    }
}
