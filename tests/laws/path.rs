//! Path tracing against sums that are known.

use crate::support::{Room, furnace, quick, run};
use glam::DVec3;
use twopass::film::Quantity;
use twopass::integrator::{Method, ReadOut};
use twopass::math::SamplerKind;
use twopass::pipeline::{PipelineError, RenderSettings, StageCosts, render_world};

fn settings(spp: u32) -> RenderSettings {
    RenderSettings { method: Method::Path, ..quick(spp, 1.0) }
}

/// In a uniform enclosure every path of n edges brings 1 + rho + ... + rho^(n-1), whatever its directions; roulette begins later.
#[test]
fn paths_in_the_furnace_sum_the_geometric_series() {
    for (rho, depth) in [(0.5, 1), (0.5, 2), (0.9, 3), (0.9, 5)] {
        let rendered = run(furnace(rho).scene(), &RenderSettings { max_depth: Some(Some(depth)), ..settings(2) });
        assert!(rendered.pass_one.is_none() && rendered.read_out.is_none(), "path tracing has no first pass");
        let want: f64 = (0..depth as i32).map(|k| rho.powi(k)).sum();
        for pixel in rendered.film.image().pixels() {
            let got = f64::from(pixel[1]);
            assert!((got / want - 1.0).abs() < 1e-6, "rho {rho}, {depth} edges: {got}, expected {want}");
        }
    }
}

/// With roulette the mean stays: 1/(1 - rho).
#[test]
fn roulette_leaves_the_mean_of_the_furnace_alone() {
    for sampler in SamplerKind::ALL {
        let rendered = run(furnace(0.8).scene(), &RenderSettings { sampler, ..settings(256) });
        let image = rendered.film.image();
        let mean = image.pixels().iter().map(|p| f64::from(p[1])).sum::<f64>() / image.pixels().len() as f64;
        // 65,536 paths. From the fifth edge on the length is geometric with ratio 0.8, of standard deviation sqrt(0.8)/0.2 = 4.5 edges
        // that bring at most 1 each: a standard error below 4.5/256 = 0.018.
        assert!((mean - 5.0).abs() < 4.0 * 0.018, "{sampler:?}: {mean}, expected 5");
    }
}

/// A lamp is found by shadow rays and by rays of the material; alone or together they give the same mean.
#[test]
fn both_ways_to_a_lamp_give_the_same_light() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, -0.9), DVec3::ZERO, 16);
    let grey = room.grey(0.5);
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [grey; 6], [0.0; 6]);
    room.quad(DVec3::new(-0.5, 0.9, -0.5), DVec3::X, DVec3::Z, grey, 4.0);
    let mean = |share: f64| {
        use twopass::accel::AccelKind;
        use twopass::integrator::drive::Clocks;
        use twopass::world::{EmitterPartition, World};
        let scene = room.scene();
        let partition = EmitterPartition::new(&scene, share);
        let world = World::with_partition(scene, AccelKind::Obvhs, partition).expect("the engine is built in");
        let clocks = Clocks::start(twopass::run_report::process_cpu_seconds);
        let silent = &mut twopass::progress::silent;
        let film =
            render_world(world, &settings(256), &clocks, StageCosts::default(), silent, &mut |_, _, _| {}).expect("renders").film;
        let (image, spread) = (film.image(), film.variance_image());
        let sum = |i: &twopass::film::Image| i.pixels().iter().map(|p| f64::from(p[1])).sum::<f64>();
        let n = image.pixels().len() as f64;
        (sum(&image) / n, sum(&spread) / n / n)
    };
    let ((by_rays, v1), (by_both, v2)) = (mean(0.0), mean(1.0));
    let error = (v1 + v2).sqrt();
    assert!((by_rays - by_both).abs() < 4.0 * error, "{by_rays} by rays alone, {by_both} by both, standard error {error}");
    assert!(v2 < v1, "shadow rays lower the variance: {v2}, expected less than {v1}");
}

/// The parts of the light add up to it, and the layers tell what is seen.
#[test]
fn layers_say_what_is_seen() {
    let rendered = run(furnace(0.5).scene(), &settings(4));
    let albedo = rendered.film.quantity_image(Quantity::Albedo);
    assert!(albedo.pixels().iter().all(|p| (p[1] - 0.5).abs() < 1e-6), "every wall reflects one half");
    let depth = rendered.film.quantity_image(Quantity::Depth);
    assert!(depth.pixels().iter().all(|p| p[0] > 0.0 && p[0] < 2.0 * 3.0_f32.sqrt()), "every wall is within the cube's diagonal");
}

#[test]
fn a_read_out_of_no_first_pass_is_refused() {
    let settings = RenderSettings { read_out: Some(ReadOut::Stored), ..settings(1) };
    assert_eq!(settings.read_out(), Err(PipelineError::NoFirstPass(Method::Path)));
}
