//! Form factors against exact values, method by method.

use crate::support::Room;
use twopass::accel::AccelKind;
use twopass::form_factor::method::{FormFactorMethod, FormFactorSettings, analytic, build};
use twopass::math::DVec3;
use twopass::patch::{PatchMesh, PatchSettings};
use twopass::progress::silent;
use twopass::world::World;
use twopass::world::walk::RayCounts;

fn world(room: &Room) -> World {
    World::new(room.scene(), AccelKind::default()).expect("a world")
}

fn patches(world: &World, patch_size: f64) -> PatchMesh {
    PatchMesh::build(world, &PatchSettings { patch_size: Some(patch_size), ..PatchSettings::default() }).expect("patches")
}

fn settings(method: FormFactorMethod, tolerance: f64) -> FormFactorSettings {
    FormFactorSettings { method, tolerance, shadow_rays: 32.0, seed: 1 }
}

/// A cube of half the size in the middle of a cube, walls grey.
fn cube_in_cube() -> Room {
    let mut room = Room::new(DVec3::new(0.4, 0.4, 0.4), DVec3::ZERO, 4);
    let grey = room.grey(0.5);
    room.walls(DVec3::splat(-0.5), DVec3::splat(0.5), [grey; 6], [0.0; 6]);
    let h = 0.25;
    let (x, y, z) = (DVec3::X * 2.0 * h, DVec3::Y * 2.0 * h, DVec3::Z * 2.0 * h);
    let (low, high) = (DVec3::splat(-h), DVec3::splat(h));
    for (corner, e1, e2) in [(low, z, y), (low, x, z), (low, y, x), (high, -y, -z), (high, -z, -x), (high, -x, -y)] {
        room.quad(corner, e1, e2, grey, 0.0);
    }
    room
}

#[test]
fn analytic_factors_of_a_cube_in_a_cube() {
    let world = world(&cube_in_cube());
    let mesh = patches(&world, 0.125);
    let start = std::time::Instant::now();
    let rows = analytic(&world, &mesh, &settings(FormFactorMethod::Analytic, 1e-3), &mut silent).expect("not stopped");
    let n = mesh.len();
    let pairs: usize = rows.iter().map(Vec::len).sum();
    eprintln!(
        "{n} patches, {pairs} pairs, {:?}: {:.2} us per ordered pair",
        start.elapsed(),
        start.elapsed().as_secs_f64() * 1e6 / (2 * pairs) as f64
    );
    let mut sums = vec![0.0; n];
    for (i, row) in rows.iter().enumerate() {
        for (j, t) in row {
            sums[i] += t.value / mesh.area[i];
            sums[*j as usize] += t.value / mesh.area[*j as usize];
        }
    }
    let worst = sums.iter().map(|s| (s - 1.0).abs()).fold(0.0, f64::max);
    eprintln!("worst row {worst:e}");
    assert!(worst < 1e-4, "row sums are off by up to {worst}");
}
