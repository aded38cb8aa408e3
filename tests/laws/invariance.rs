//! What a picture must not depend on: threads, place, engine.

use crate::support::{Room, quick, run};
use glam::DVec3;
use twopass::integrator::Method;
use twopass::math::DAffine3;
use twopass::scene::Scene;

/// A room with a lamp, a block, a mirror ball and a glass ball, moved by `offset`.
fn room_at(offset: DVec3) -> Scene {
    let mut room = Room::new(offset + DVec3::new(0.0, 0.0, -0.9), offset + DVec3::Z, 16);
    let (grey, mirror, glass) = (room.grey(0.6), room.mirror(0.9), room.glass(1.5));
    room.walls(offset - 1.0, offset + 1.0, [grey; 6], [0.0; 6]);
    room.quad(offset + DVec3::new(-0.3, 0.99, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, grey, 5.0);
    let block = DAffine3::from_translation(offset + DVec3::new(0.3, -0.7, 0.3)) * DAffine3::from_scale(DVec3::splat(0.3));
    room.add(twopass::scene::SurfaceSource::Triangles(twopass::geometry::tessellate::cube(&block)), grey, 0.0);
    room.sphere(offset + DVec3::new(-0.4, -0.6, 0.4), 0.35, mirror, 0.0);
    room.sphere(offset + DVec3::new(-0.3, -0.7, -0.4), 0.2, glass, 0.0);
    room.scene()
}

#[test]
fn one_thread_and_two_give_the_same_bits() {
    for method in Method::ALL {
        let picture = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let settings = twopass::pipeline::RenderSettings { method, ..quick(3, 0.3) };
            pool.install(|| run(room_at(DVec3::ZERO), &settings).layers())
        };
        assert!(picture(1) == picture(2), "{method:?}: layers differ between 1 and 2 threads");
    }
}

/// The scene is recentred in f64 at load: far from the origin nothing is lost.
#[test]
fn a_room_far_away_gives_the_same_mean() {
    let mean = |offset: f64| {
        let image = run(room_at(DVec3::new(offset, -offset, 0.5 * offset)), &quick(8, 0.3)).film.image();
        image.pixels().iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / (3 * image.pixels().len()) as f64
    };
    let here = mean(0.0);
    for offset in [1e5, 1e6] {
        let there = mean(offset);
        assert!((there / here - 1.0).abs() < 1e-3, "offset {offset}: mean {there}, at the origin {here}");
    }
}
