//! The engine behind the rays does not show in the picture.
//!
//! Point, normal and uv are found again from ray and primitive, so engines that pick the same primitive give the same bits. Of hits
//! at equal t, the built-in engine and brute force take the lowest index. Embree takes any and loses rays at vertices: its pictures
//! may differ, in single pixels.

use crate::support::{Room, quick, run};
use glam::DVec3;
use twopass::accel::AccelKind;
use twopass::geometry::{Ray, tessellate};
use twopass::material::{Material, Texture};
use twopass::math::{DAffine3, Rgb, Vec3};
use twopass::pipeline::RenderSettings;
use twopass::scene::{Scene, SurfaceSource};
use twopass::world::World;

/// A room with a lamp, a ball of `bands` bands of triangles, a mirror ball and a glass ball; all walls meet at shared edges.
fn room(bands: u32, size: usize) -> Scene {
    let mut room = Room::new(DVec3::new(0.0, 0.0, -0.9), DVec3::Z, size);
    let (grey, mirror, glass) = (room.grey(0.6), room.mirror(0.9), room.glass(1.5));
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [grey; 6], [0.0; 6]);
    room.quad(DVec3::new(-0.3, 0.99, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, grey, 5.0);
    let ball = DAffine3::from_translation(DVec3::new(0.3, -0.5, 0.3)) * DAffine3::from_scale(DVec3::splat(0.4));
    room.add(SurfaceSource::Triangles(tessellate::sphere(&ball, bands)), grey, 0.0);
    room.sphere(DVec3::new(-0.4, -0.6, 0.4), 0.35, mirror, 0.0);
    room.sphere(DVec3::new(-0.3, -0.7, -0.4), 0.2, glass, 0.0);
    room.scene()
}

/// Compares the pictures of all engines of this build with that of brute force.
fn compare(scene: &dyn Fn() -> Scene, settings: &RenderSettings) {
    let render = |accel| run(scene(), &RenderSettings { accel, ..settings.clone() });
    let expected = render(AccelKind::BruteForce);
    for accel in AccelKind::ALL.into_iter().filter(|kind| kind.is_available() && *kind != AccelKind::BruteForce) {
        let found = render(accel);
        if accel == AccelKind::Obvhs {
            assert!(found.layers() == expected.layers(), "{accel}: a layer differs from brute force's");
            continue;
        }
        let (a, b) = (found.film.image(), expected.film.image());
        let mean = |pixels: &[[f32; 3]]| pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>();
        let (a, b) = (mean(a.pixels()), mean(b.pixels()));
        assert!((a / b - 1.0).abs() < 1e-2, "{accel}: sum of all pixels {a}, brute force {b}");
    }
}

#[test]
fn both_passes_of_a_small_scene_give_the_same_bits_with_every_exact_engine() {
    compare(&|| room(6, 24), &quick(2, 0.4));
}

/// Without pass one: brute force would cast its rays for minutes.
#[test]
fn a_scene_of_ten_thousand_triangles_gives_the_same_bits_with_every_exact_engine() {
    let scene = || room(72, 64);
    let n_triangles = scene().n_triangles();
    assert!(n_triangles > 10_000, "{n_triangles}");
    compare(&scene, &RenderSettings { max_depth: Some(Some(2)), ..quick(1, 0.5) });
}

/// Masks are no business of the engines: a ray goes on straight behind each one it meets. Of light through n of opacity p, (1 - p)^n
/// is left, and nothing behind a wall.
#[test]
fn masks_let_their_share_of_a_shadow_ray_through_with_every_engine() {
    const OPACITY: f64 = 0.25;
    for (n, wall) in [(0, false), (1, false), (3, false), (5, false), (3, true)] {
        let scene = || {
            let mut room = Room::new(DVec3::new(0.0, 0.0, -2.0), DVec3::Z, 4);
            let grey = room.grey(0.5);
            let inner = Box::new(Material::Diffuse { reflectance: Texture::Constant(Rgb::grey(0.5)) });
            let mask = room.material(Material::Mask { opacity: Texture::grey(OPACITY), inner }, true);
            for plate in 0..n {
                let tilt = DVec3::new(2.0, 0.0, 0.1 * f64::from(plate));
                room.quad(DVec3::new(-1.0, -1.0, 0.3 * f64::from(plate)), tilt, DVec3::Y * 2.0, mask, 0.0);
            }
            room.quad(DVec3::new(-1.0, 3.0, -1.0), DVec3::X, DVec3::Z, grey, 1.0);
            if wall {
                room.quad(DVec3::new(-1.0, -1.0, 1.9), DVec3::X * 2.0, DVec3::Y * 2.0, grey, 0.0);
            }
            room.scene()
        };
        let expected = if wall { 0.0 } else { (1.0 - OPACITY).powi(n) };
        for kind in AccelKind::ALL.into_iter().filter(|kind| kind.is_available()) {
            let scene = scene();
            let origin = scene.origin.as_vec3();
            let world = World::new(scene, kind).expect("engine is in this build");
            for i in 0..100 {
                let place = Vec3::new(0.008 * i as f32 - 0.4, 0.3 - 0.005 * i as f32, -1.0);
                let found = world.transmittance(&Ray::between(place - origin, Vec3::new(0.1, -0.2, 2.0) - origin));
                let all = [found.r, found.g, found.b];
                assert!(all.iter().all(|share| (share - expected).abs() < 1e-6), "{kind}, {n} masks: {found:?}, not {expected}");
            }
        }
    }
}

/// A usage error, and what to install.
#[cfg(not(feature = "embree"))]
#[test]
fn an_engine_that_this_build_lacks_is_refused_with_advice() {
    let arguments = ["info", "none.xml", "--accel", "embree"];
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_twopass")).args(arguments).output().expect("the program runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains("libembree-dev"), "{:?}: {said}", output.status);
}
