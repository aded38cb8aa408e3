//! From the results of the library to the run report.

use super::args::{Common, PassOneArgs};
use super::exit::Failure;
use super::interrupt::{Interrupt, Signal};
use super::output::say;
use serde_json::Value;
use twopass::film::Film;
use twopass::integrator::drive::Budget;
use twopass::load::LoadedScene;
use twopass::pipeline::{PassOne, PipelineError, StageCost};
use twopass::plan::{Decision, Plan};
use twopass::run_report::{Closure, Elapsed, NotFinite, PowerBalance, RunReport, SolverReport, StageDecision, StopReason};
use twopass::world::walk::RayCounts;

/// Relative error of radiosities, by rows that do not close, above which it is worth a warning.
const CLOSURE_INFLUENCE: f64 = 0.01;

/// Share of the surface that is given twice above which it is worth a warning.
const GIVEN_TWICE: f64 = 1e-4;

/// A report that knows the scene and the flags.
pub fn begin(common: &Common, loaded: &LoadedScene, method: &str, loading: Elapsed) -> RunReport {
    let mut report = RunReport::new(&loaded.scene.name, loaded.hash, method);
    report.seed = common.seed;
    report.threads = rayon::current_num_threads();
    report.warnings = loaded.scene.warnings.clone();
    report.dropped_triangles = loaded.scene.dropped_triangles as u64;
    report.settings.insert("plan".to_owned(), twopass::plan::Mode::from(common.plan).name().into());
    report.settings.insert("accel".to_owned(), common.accel.name().into());
    report.add_time(twopass::progress::Stage::Load, loading);
    report
}

/// Adds a setting.
pub fn set(report: &mut RunReport, name: &str, value: impl Into<Value>) {
    report.settings.insert(name.to_owned(), value.into());
}

/// Adds the flags of pass one.
pub fn set_pass_one(report: &mut RunReport, args: &PassOneArgs) {
    set(report, "form_factors", args.form_factors.unwrap_or_default().name());
    set(report, "solver", args.solver.name());
    for (name, value) in [
        ("patch_size", args.patch_size),
        ("adaptive", args.adaptive),
        ("tolerance", args.tolerance),
        ("solver_tolerance", args.solver_tolerance),
    ] {
        set(report, name, value);
    }
}

/// Rays of all kinds.
pub fn rays(counts: &RayCounts) -> u64 {
    let tested = counts.shadow + counts.connected;
    counts.camera + counts.glance + tested + counts.gather + counts.form_factor + counts.reflected + counts.transmitted
}

/// Adds what rays and stages cost.
pub fn add_costs(report: &mut RunReport, stages: &[StageCost], counts: &RayCounts) {
    for cost in stages {
        report.add_time(cost.stage, cost.time);
    }
    for (name, count) in [
        ("camera_rays", counts.camera),
        ("glances", counts.glance),
        ("shadow_rays", counts.shadow),
        ("visibility_tests", counts.visibility),
        ("lobe_evaluations", counts.lobes),
        ("uv_evaluations", counts.uv),
        ("distant_light_looks", counts.distant),
        ("light_choices", counts.light_choices),
        ("gather_rays", counts.gather),
        ("form_factor_rays", counts.form_factor),
        ("idle_rays", counts.idle),
        ("connecting_rays", counts.connected),
        ("reflected_rays", counts.reflected),
        ("transmitted_rays", counts.transmitted),
        ("truncated_rays", counts.truncated),
    ] {
        report.count(name, count);
    }
    report.truncated_share = counts.truncated_share();
}

/// Adds what the plan kept and left out.
pub fn add_plan(report: &mut RunReport, plan: &Plan) {
    let decision = |d: &Decision| StageDecision { stage: d.stage.to_owned(), kept: d.kept, reason: d.reason.clone() };
    report.plan = plan.decisions.iter().map(decision).collect();
    report.plan_saving.left_out = plan.decisions.iter().filter(|d| !d.kept).map(|d| d.stage.to_owned()).collect();
}

/// Adds what pass one found.
pub fn add_pass_one(common: &Common, report: &mut RunReport, pass_one: &PassOne) {
    // What was computed, and what was there already.
    let reused = pass_one.reused;
    let (patches, form_factors) = (pass_one.field.patches.len() as u64, pass_one.form_factors.n_nonzero() as u64);
    for (name, kept_name, is_kept, amount) in [
        ("patches", "patches_kept", reused.patches, patches),
        ("form_factors", "form_factors_kept", reused.form_factors, form_factors),
        ("sweeps", "sweeps_kept", reused.solution, pass_one.solution.sweeps.into()),
    ] {
        report.count(name, if is_kept { 0 } else { amount });
        report.count(kept_name, if is_kept { amount } else { 0 });
    }
    report.count("solver_channels", pass_one.channels.into());
    let raw = pass_one.form_factors.closure();
    report.closure = Some(Closure {
        raw_row_sum_min: raw.row_sum_min,
        raw_row_sum_max: raw.row_sum_max,
        worst_defect: (1.0 - raw.row_sum_min).abs().max((raw.row_sum_max - 1.0).abs()),
        reciprocity_defect: raw.reciprocity_defect,
    });
    report.solver = Some(SolverReport {
        method: pass_one.solution.solver.name().to_owned(),
        sweeps: pass_one.solution.sweeps.into(),
        error_bound: pass_one.solution.error_bound,
        // 1/(1 - r) is the amplification.
        condition: 2.0 * pass_one.solution.amplification - 1.0,
        closure_influence: closure_influence(raw.corrected_defect, pass_one.solution.mean_amplification),
        converged: pass_one.solution.converged,
    });
    if let Some(warning) = closure_warning(raw.corrected_defect, pass_one.solution.mean_amplification) {
        say(common, &format!("warning: {warning}"));
        report.warnings.push(warning);
    }
    if let Some(warning) = twice_warning(pass_one) {
        say(common, &format!("warning: {warning}"));
        report.warnings.push(warning);
    }
    let power = &pass_one.power;
    report.power = Some(PowerBalance {
        emitted: power.emitted,
        absorbed: power.absorbed,
        escaped: power.escaped,
        truncated: Some(power.truncated),
        relative_defect: power.unaccounted.abs(),
    });
}

/// A warning if surfaces lie in the same place.
fn twice_warning(pass_one: &PassOne) -> Option<String> {
    let patches = &pass_one.field.patches;
    let share = patches.given_twice / patches.area.iter().sum::<f64>();
    (share > GIVEN_TWICE).then(|| {
        format!(
            "{:.3e} of the surface lies in the same place as other surfaces that hide it: it is left out of pass one; move one of them, \
             or give each surface once",
            share
        )
    })
}

/// Relative error of radiosities by rows that are off by `defect`: the light of all reflections but the first looks through them.
fn closure_influence(defect: f64, amplification: f64) -> f64 {
    defect * (amplification - 1.0)
}

/// A warning if rows that do not close may count much: where all are off by delta that counts delta rho/(1 - rho) times in a bright room.
fn closure_warning(defect: f64, amplification: f64) -> Option<String> {
    let amplified = amplification - 1.0;
    let influence = closure_influence(defect, amplification);
    (influence > CLOSURE_INFLUENCE).then(|| {
        format!(
            "rows of form factors are off by {defect:.1e} in the mean, which interreflection may amplify {amplified:.0} times: \
             radiosities may be off by {:.1} %; a smaller --tolerance helps",
            100.0 * influence
        )
    })
}

/// Adds what the film holds.
pub fn add_film(report: &mut RunReport, film: &Film) {
    let (count, first) = film.bad_samples();
    let first_pixel = first.map(|i| [i % film.width(), i / film.width()]);
    report.not_finite = NotFinite { count, first_pixel };
    report.samples_per_pixel = film.n_passes().into();
    report.fireflies = film.fireflies();
    report.estimated_relmse = film.estimated_relmse();
}

/// Which limit of a budget ended a complete run.
pub fn stop_reason(budget: &Budget, film: &Film) -> StopReason {
    let error_met = || matches!((budget.error, film.estimated_relmse()), (Some(goal), Some(now)) if now <= goal);
    if budget.is_unlimited() || budget.spp.is_some_and(|spp| film.n_passes() >= spp) {
        StopReason::Samples
    } else if error_met() {
        StopReason::Error
    } else if budget.time.is_some() {
        StopReason::Time
    } else {
        StopReason::CpuTime
    }
}

/// Writes the report if it was asked for, and says the times if the user wants to hear more.
pub fn finish(common: &Common, report: &mut RunReport) -> Result<(), Failure> {
    if common.verbose {
        for stage in &report.stages {
            say(common, &format!("{:14} {:9.3} s  {:9.3} CPU s", stage.name, stage.wall_s, stage.cpu_s));
        }
        for (name, count) in &report.counters {
            say(common, &format!("{name:18} {count}"));
        }
    }
    match &common.report {
        Some(path) => Ok(report.write(path)?),
        None => Ok(()),
    }
}

/// The verdict on a run whose results are written: interrupted, in doubt, or good.
pub fn verdict(report: &RunReport, interrupt: &Interrupt, kept: &str) -> Result<(), Failure> {
    if let (false, Some(signal)) = (report.complete, interrupt.signal()) {
        return Err(interrupted(signal, kept));
    }
    if report.not_finite.count > 0 {
        let at = report.not_finite.first_pixel.map(|[x, y]| format!(", first at column {x}, row {y}")).unwrap_or_default();
        let count = report.not_finite.count;
        return Err(Failure::Check(format!("{count} samples were NaN, infinite or negative and were left out{at}")));
    }
    match &report.solver {
        Some(solver) if !solver.converged => Err(Failure::Check(format!(
            "pass one did not converge: after {} sweeps of {} the error is bounded by {:.3e}",
            solver.sweeps, solver.method, solver.error_bound
        ))),
        _ => Ok(()),
    }
}

/// A run that ended without a result: the report is written nevertheless, and the failure says why.
pub fn no_result(common: &Common, report: &mut RunReport, interrupt: &Interrupt, error: PipelineError) -> Failure {
    let stopped = error == PipelineError::Stopped;
    report.stopped_by = if stopped { StopReason::Interrupted } else { StopReason::Failed };
    if let Err(failure) = finish(common, report) {
        return failure;
    }
    match interrupt.signal() {
        Some(signal) if stopped => interrupted(signal, "there was no result yet to keep"),
        _ => error.into(),
    }
}

fn interrupted(signal: Signal, kept: &str) -> Failure {
    Failure::Interrupted { signal, kept: kept.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row that is off by delta counts delta rho/(1 - rho) times: 1 % in the light from 1.0e-5 on at rho = 0.999, from 1.1e-3 at 0.9.
    #[test]
    fn rows_that_do_not_close_are_warned_of_where_they_count() {
        for (rho, limit) in [(0.9, 1.1e-3), (0.99, 1.0e-4), (0.999, 1.0e-5), (0.999_999, 1.0e-8)] {
            let amplification = 1.0 / (1.0 - rho);
            assert!(closure_warning(0.9 * limit, amplification).is_none(), "rho {rho}: warned of too early");
            let warning = closure_warning(1.1 * limit, amplification).unwrap_or_else(|| panic!("rho {rho}: not warned of"));
            assert!(warning.contains("1.1 %"), "{warning}");
        }
    }
}
