//! Path tracing against sums that are known.

use crate::support::{Room, furnace, quick, run};
use glam::DVec3;
use twopass::film::Quantity;
use twopass::geometry::tessellate::Triangles;
use twopass::integrator::{Method, PathFilter, ReadOut};
use twopass::math::SamplerKind;
use twopass::pipeline::{PipelineError, RenderSettings, StageCosts, render_world};
use twopass::scene::SurfaceSource;

fn settings(spp: u32) -> RenderSettings {
    RenderSettings { method: Method::Path, ..quick(spp, 1.0) }
}

/// In a uniform enclosure every path of n edges brings 1 + rho + ... + rho^(n-1), whatever its directions; roulette begins later. Single paths
/// bring it to each pixel; where neighbours lend each other paths, each of these is shared out without rest, so each tile of 4 by 2 pixels has it.
#[test]
fn paths_in_the_furnace_sum_the_geometric_series() {
    for (rho, depth) in [(0.5_f64, 1), (0.5, 2), (0.9, 3), (0.9, 5)] {
        let want: f64 = (0..depth as i32).map(|k| rho.powi(k)).sum();
        let mut settings = RenderSettings { max_depth: Some(Some(depth)), ..settings(2) };
        let rendered = run(furnace(rho).scene(), &settings);
        assert!(rendered.pass_one.is_none() && rendered.read_out.is_none(), "path tracing has no first pass");
        let image = rendered.film.image();
        for y in (0..image.height()).step_by(2) {
            for x in (0..image.width()).step_by(4) {
                let tile = (0..8).map(|k| f64::from(image.at(x + k % 4, y + k / 4)[1]));
                let got = tile.sum::<f64>() / 8.0;
                assert!((got / want - 1.0).abs() < 1e-6, "rho {rho}, {depth} edges: {got}, expected {want}");
            }
        }
        settings.methods.single_paths = true;
        for pixel in run(furnace(rho).scene(), &settings).film.image().pixels() {
            let got = f64::from(pixel[1]);
            assert!((got / want - 1.0).abs() < 1e-6, "rho {rho}, {depth} edges, alone: {got}, expected {want}");
        }
    }
}

/// Mean and variance of the mean of each pixel of the room, path by path alone or lent between neighbours, of paths of up to `depth` edges.
fn replicas(room: &Room, single: bool, depth: Option<u32>) -> Vec<(f64, f64)> {
    const REPLICAS: u64 = 16;
    let images = (0..REPLICAS).map(|seed| {
        let mut settings = RenderSettings { seed: seed + if single { 100 } else { 0 }, ..settings(32) };
        settings.max_depth = depth.map(Some);
        settings.methods.paths = single.then(|| PathFilter::new("L.*E").expect("a regular expression"));
        run(room.scene(), &settings).film.image()
    });
    let images: Vec<_> = images.collect();
    let n = REPLICAS as f64;
    let of_pixel = |k: usize| {
        let values = || images.iter().map(|image| f64::from(image.pixels()[k][1]));
        let mean = values().sum::<f64>() / n;
        (mean, values().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0) / n)
    };
    (0..images[0].pixels().len()).map(of_pixel).collect()
}

/// Fails unless every pixel has the same mean by lent paths and by single ones; sums of the variances by both.
fn same_by_both(room: &Room, depth: Option<u32>) -> (f64, f64) {
    let (lent, single) = (replicas(room, false, depth), replicas(room, true, depth));
    let mut sum = 0.0;
    for (k, ((a, v1), (b, v2))) in lent.iter().zip(&single).enumerate() {
        if a == b {
            continue;
        }
        let t = (a - b) / (v1 + v2).sqrt();
        // With 16 degrees of freedom at least, one of 64 pixels exceeds 6 once in a thousand runs.
        assert!(t.abs() < 6.0, "pixel {k}: {a} lent, {b} alone, {t} standard errors");
        sum += t;
    }
    // The eight pixels of a tile may err together.
    assert!(sum.abs() < 4.0 * (lent.len() as f64 * 8.0).sqrt(), "errors of one sign: {sum}");
    let total = |of: &[(f64, f64)]| of.iter().map(|(_, v)| v).sum::<f64>();
    (total(&lent), total(&single))
}

/// What neighbours lend has the mean of single paths, in each pixel. Where they do not see the same, a path that is counted by those that do
/// not see where it ends would darken borders: an opaque sheet stands between the walls that neighbours look at.
#[test]
fn lent_paths_have_the_mean_of_single_ones() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, -0.9), DVec3::ZERO, 8);
    let (light, dark) = (room.grey(0.8), room.grey(0.3));
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [light; 6], [0.0; 6]);
    room.quad(DVec3::new(-0.9, 0.9, -0.5), DVec3::X * 0.4, DVec3::Z * 0.4, dark, 10.0);
    // Seen edge-on, it parts the pixels of a tile in two and two.
    room.quad(DVec3::new(0.35, -0.9, -0.2), DVec3::Y * 1.6, DVec3::new(0.45, 0.0, 0.9), light, 0.0);
    let (lent, single) = same_by_both(&room, None);
    assert!(lent < 0.5 * single, "lending lowers the variance: {lent} against {single}");
}

/// Paths whose first surfaces lie as many edges from the camera share what they find, no others: half of each tile looks into a mirror, behind
/// which a path may have one bounce less before its limit.
#[test]
fn paths_of_other_depths_are_not_lent() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, -0.9), DVec3::ZERO, 8);
    let (light, mirror) = (room.grey(0.8), room.mirror(1.0));
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [light; 6], [0.0; 6]);
    room.quad(DVec3::new(-0.5, 0.9, -0.5), DVec3::X, DVec3::Z, light, 4.0);
    // The middle half of the picture's width: its rays meet this plane within 0.85 of the axis.
    room.quad(DVec3::new(-0.425, -0.89, -0.05), DVec3::Y * 1.78, DVec3::X * 0.85, mirror, 0.0);
    same_by_both(&room, Some(3));
}

/// Paths are lent to those only who see the same normal: the floor's interpolated one leans to the lamp, and who looks from behind it sees
/// the floor about its own. Half of a tile does.
#[test]
fn paths_from_uneven_normals_are_not_lent() {
    let mut room = Room::new(DVec3::ZERO, DVec3::Y, 8);
    let grey = room.grey(0.8);
    room.quad(DVec3::new(-1.0, 1.0, -1.0), DVec3::X * 2.0, DVec3::Z * 2.0, grey, 0.0);
    let corner = |x: f64, z: f64| DVec3::new(x, -0.3, z);
    let floor = Triangles {
        positions: vec![corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)],
        normals: vec![DVec3::new(0.95, 0.31, 0.0).normalize().as_vec3(); 4],
        uvs: Vec::new(),
        triangles: vec![[0, 2, 1], [0, 3, 2]],
    };
    room.add(SurfaceSource::Triangles(floor), grey, 0.0);
    room.quad(DVec3::new(0.9, -0.25, -0.4), DVec3::Z * 0.8, DVec3::Y * 0.2, grey, 10.0);
    same_by_both(&room, Some(3));
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
