//! When work is held to be enough: a goal for the error ends a run, and a finer pass one comes when it is worth its rays.

use super::support::{Room, furnace, quick, run};
use glam::DVec3;
use twopass::integrator::drive::{Budget, Clocks};
use twopass::integrator::{Method, MethodSettings};
use twopass::math::SamplerKind;
use twopass::pipeline::{RenderSettings, Rendered, render};
use twopass::progress::silent;
use twopass::run_report::process_cpu_seconds;

/// First pass after which the prediction is looked at, and how often from then on: about eight times while the passes double.
fn is_looked_at(passes: u32) -> bool {
    passes >= 8 && passes.is_multiple_of((passes / 8).next_power_of_two())
}

/// Renders with a goal; the error predicted after each pass.
fn predictions(method: Method, goal: f64) -> Vec<f64> {
    let budget = Budget { spp: Some(400), error: Some(goal), ..Budget::default() };
    let settings = RenderSettings { budget, method, ..quick(400, 0.5) };
    let mut after = Vec::new();
    let rendered =
        render(furnace(0.5).scene(), &settings, &Clocks::start(process_cpu_seconds), &mut silent, &mut |film, _, _| {
            after.push(film.estimated_relmse().unwrap_or(f64::INFINITY))
        })
        .expect("renders");
    assert!(rendered.complete);
    after
}

/// A run ends at the first look that finds the predicted error no larger than the goal: not before, and not a look later.
#[test]
fn a_run_ends_at_the_first_look_that_finds_its_goal() {
    for method in [Method::Path, Method::Bidirectional] {
        let all = predictions(method, 0.0);
        assert_eq!(all.len(), 400, "{method:?}: nothing is exact");
        for passes in [8, 9, 15, 16, 18, 23, 40, 64, 100, 200] {
            // Just met there, if not before.
            let goal = all[passes - 1] * (1.0 + 1e-9);
            let after = predictions(method, goal);
            let want = (1..=400_u32).find(|&n| is_looked_at(n) && all[n as usize - 1] <= goal).expect("met in the end");
            assert_eq!(after.len(), want as usize, "{method:?}, goal {goal}");
            assert_eq!(after[..], all[..after.len()], "{method:?}: passes do not depend on the goal");
        }
        assert_eq!(predictions(method, 1e9).len(), 8, "{method:?}: a few passes say nothing");
    }
}

/// What is predicted for a method without bias is the error there is: in a furnace every pixel's value is known.
#[test]
fn the_predicted_error_of_path_tracing_is_the_error() {
    const REPLICAS: u64 = 24;
    for (rho, spp) in [(0.5, 8), (0.8, 24)] {
        let want = 1.0 / (1.0 - rho);
        let [mut predicted, mut measured] = [0.0; 2];
        for seed in 1..=REPLICAS {
            // Noise of neighbours that lend each other paths is alike, and halves of Sobol' points know too little of each other.
            let methods = MethodSettings { single_paths: true, ..MethodSettings::default() };
            let sampler = SamplerKind::Independent;
            let film =
                run(furnace(rho).scene(), &RenderSettings { seed, sampler, methods, method: Method::Path, ..quick(spp, 0.5) })
                    .film;
            predicted += film.estimated_relmse().expect("two halves");
            let image = film.image();
            let squares = image.pixels().iter().map(|p| (f64::from(p[1]) - want).powi(2) / (want * want + 0.01));
            measured += squares.sum::<f64>() / image.pixels().len() as f64;
        }
        let ratio = predicted / measured;
        assert!((0.9..1.1).contains(&ratio), "rho {rho}, {spp} samples: {ratio} times the error was predicted");
    }
}

/// Rays of all kinds but glances that may count, as the default method counts its work.
fn rays(rendered: &Rendered) -> f64 {
    let c = &rendered.counts;
    (c.particle + c.camera + c.shadow + c.gather + c.form_factor + c.reflected + c.transmitted - c.idle) as f64
}

/// The default method makes a finer pass one at the first end of a round at which that costs no more than about six tenths of the rays so far, and
/// the finest that does: it would have cost more of what had been done at the end before, and one that is finer still would cost more.
#[test]
fn a_finer_pass_one_comes_when_it_is_worth_its_rays() {
    let mut seen = 0;
    for (rho, size) in [(0.5, 48), (0.9, 64), (0.7, 96)] {
        let mut room = Room::new(DVec3::new(0.1, 0.0, -0.9), DVec3::new(0.0, -0.1, 1.0), size);
        let (grey, black) = (room.grey(rho), room.grey(0.0));
        room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [grey; 6], [0.0; 6]);
        room.quad(DVec3::new(-0.3, 0.95, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, black, 5.0);
        let at = |spp: u32| {
            let budget = Budget { spp: Some(spp), ..Budget::default() };
            run(room.scene(), &RenderSettings { budget, ..RenderSettings::default() })
        };
        // At the end before: all rays.
        let mut earlier = None;
        for end in [2, 6, 14, 30, 62, 126] {
            let [before, after] = [end, end + 1].map(at);
            let made = (after.counts.form_factor - before.counts.form_factor) as f64;
            let patches = |r: &Rendered| r.pass_one.as_ref().expect("a pass one").field.patches.len();
            let (old, new) = (patches(&before), patches(&after));
            let share = made / rays(&before);
            assert_eq!(old < new, made > 0.0, "rays are cast for finer patches, and only for them");
            if made > 0.0 {
                seen += 1;
                assert!(share < 0.7, "rho {rho}, {end} passes: {share} of the rays so far");
                if let Some(earlier) = earlier {
                    assert!(made / earlier > 0.4, "rho {rho}, {end} passes: {} of the rays at the end before", made / earlier);
                }
            }
            earlier = Some(rays(&before));
        }
    }
    assert!(seen >= 4, "{seen} finer ones");
}
