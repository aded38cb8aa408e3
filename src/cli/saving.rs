//! `render --time-plan`: what leaving stages out saved, by rendering a second time with all of them.

use super::args::Common;
use super::output::say;
use twopass::integrator::drive::{Budget, Clocks};
use twopass::pipeline::{PipelineError, RenderSettings, Rendered, StageCost, render};
use twopass::plan::Mode;
use twopass::progress::Observer;
use twopass::run_report::{Elapsed, MeasuredSaving, PlanSaving, process_cpu_seconds};
use twopass::scene::Scene;

/// Renders `scene` again as `lean` was, as many samples, and compares times and pictures.
///
/// # Errors
/// As [`render`].
pub fn measure(
    (lean, left_out): (&Rendered, Vec<String>),
    scene: Scene,
    settings: &RenderSettings,
    observer: &mut Observer<'_>,
) -> Result<PlanSaving, PipelineError> {
    if settings.plan == Mode::Full {
        return Ok(PlanSaving { how: "--plan full: nothing was left out".to_owned(), left_out, measured: None });
    }
    let samples = lean.film.n_passes();
    let budget = Budget { spp: Some(samples), ..Budget::default() };
    let settings = RenderSettings { plan: Mode::Full, budget, ..settings.clone() };
    let full = render(scene, &settings, &Clocks::start(process_cpu_seconds), observer, &mut |_, _, _| {})?;
    if !full.complete {
        return Err(PipelineError::Stopped);
    }
    let (here, there) = (time_of(&lean.stages), time_of(&full.stages));
    let measured = MeasuredSaving {
        lean_cpu_s: here.cpu_s,
        full_cpu_s: there.cpu_s,
        saved_cpu_s: there.cpu_s - here.cpu_s,
        saved_wall_s: there.wall_s - here.wall_s,
        same_picture: lean.film.image() == full.film.image() && lean.film.variance_image() == full.film.variance_image(),
    };
    let how = format!("measured: one run of {samples} samples per pixel each way in this process, without loading and writing");
    Ok(PlanSaving { how, left_out, measured: Some(measured) })
}

/// Says it in a line.
pub fn tell(common: &Common, saving: &PlanSaving) {
    let said = match saving.measured {
        Some(m) => format!(
            "the plan saved {:.2} of {:.2} CPU s ({:.0} %); left out: {}; with everything the picture is {}",
            m.saved_cpu_s,
            m.full_cpu_s,
            100.0 * m.saved_cpu_s / m.full_cpu_s,
            if saving.left_out.is_empty() { "nothing".to_owned() } else { saving.left_out.join(", ") },
            if m.same_picture { "the same" } else { "another" }
        ),
        None => saving.how.clone(),
    };
    say(common, &said);
}

fn time_of(stages: &[StageCost]) -> Elapsed {
    let sum = |value: fn(&StageCost) -> f64| stages.iter().map(value).sum();
    Elapsed { wall_s: sum(|s| s.time.wall_s), cpu_s: sum(|s| s.time.cpu_s) }
}
