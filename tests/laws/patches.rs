//! Patches: area, cuts, and the six-patch cube through the whole of pass one.

use crate::support::{Room, quick, run};
use glam::DVec3;
use twopass::accel::AccelKind;
use twopass::film::Quantity;
use twopass::material::{Material, MaterialId, Texture};
use twopass::math::{Rgb, Sampler};
use twopass::patch::{PatchId, PatchMesh, PatchSettings};
use twopass::pipeline::{PassOneSettings, Seen, solve};
use twopass::progress::silent;
use twopass::world::World;

fn patches(room: &Room, size: f64) -> (World, PatchMesh) {
    let world = World::new(room.scene(), AccelKind::Obvhs).expect("builds");
    let mesh = PatchMesh::build(&world, &PatchSettings { patch_size: Some(size), ..PatchSettings::default() }).expect("cuts");
    (world, mesh)
}

#[test]
fn patch_areas_sum_to_the_area_of_the_scene() {
    let mut room = crate::support::furnace(0.5);
    let grey = room.grey(0.4);
    room.sphere(DVec3::ZERO, 0.3, grey, 0.0);
    for size in [0.05, 0.3, 5.0] {
        let (world, mesh) = patches(&room, size);
        let want: f64 = world.scene().shapes.iter().map(|s| s.area()).sum();
        let got: f64 = mesh.area.iter().sum();
        assert!((got / want - 1.0).abs() < 1e-6, "size {size}: {got}, expected {want}");
    }
}

/// A point sampled on a patch belongs to that patch.
#[test]
fn sampled_points_are_found_in_their_patch() {
    let mut room = crate::support::furnace(0.5);
    let grey = room.grey(0.4);
    room.sphere(DVec3::ZERO, 0.3, grey, 0.0);
    let (world, mesh) = patches(&room, 0.13);
    let mut strays = 0;
    for i in 0..mesh.len() as u32 {
        for k in 0..8 {
            let at = mesh.sample(&world, PatchId(i), Sampler::new(1, u64::from(i), k).next_2d());
            strays += u32::from(mesh.patch_at(&at) != Some(PatchId(i)));
        }
    }
    // Only points within a rounding of a border may fall to the neighbour.
    assert!(strays <= mesh.len() as u32 * 8 / 10_000, "{strays} of {} points lie in another patch", mesh.len() * 8);
}

/// A partition that stands on a large floor cuts its patches, so that none has points on both sides.
#[test]
fn no_patch_straddles_a_partition() {
    let mut room = Room::new(DVec3::new(0.0, 1.0, 0.0), DVec3::Z, 4);
    let grey = room.grey(0.5);
    room.quad(DVec3::new(-3.0, 0.0, -3.0), DVec3::Z * 6.0, DVec3::X * 6.0, grey, 0.0);
    // Two thirds of the way the wall ends: its line still cuts where it stands.
    room.quad(DVec3::new(0.137, 0.0, -3.0), DVec3::Y * 2.0, DVec3::Z * 4.0, grey, 0.0);
    let (world, mesh) = patches(&room, 0.5);
    let mut straddling = 0;
    for i in 0..mesh.len() as u32 {
        if mesh.normal[i as usize].y < 0.9 {
            continue;
        }
        let points = (0..64).map(|k| mesh.sample(&world, PatchId(i), Sampler::new(1, u64::from(i), k).next_2d()).point);
        let sides: Vec<bool> =
            points.map(|p| p.as_dvec3() + world.scene().origin).filter(|p| p.z < 1.0).map(|p| p.x > 0.137).collect();
        straddling += u32::from(sides.contains(&true) && sides.contains(&false));
    }
    assert_eq!(straddling, 0, "patches with points on both sides of the wall");
}

/// [physical_checks.csv cube6_*] within the noise of measured form factors: 65536 rays a patch. E = 1 on the ceiling of a unit cube.
#[test]
fn the_six_patch_cube_has_its_radiosity() {
    for (rho, ceiling, floor, wall) in [(0.5, 1.090_909, 0.181_746, 0.181_836), (0.9, 2.372_881, 1.525_311, 1.525_452)] {
        let mut room = Room::new(DVec3::splat(0.5), DVec3::new(0.5, 0.5, 1.0), 4);
        let grey = room.grey(rho);
        let emission = std::f64::consts::FRAC_1_PI;
        room.walls(DVec3::ZERO, DVec3::ONE, [grey; 6], [0.0, 0.0, 0.0, emission, 0.0, 0.0]);
        let mut settings = quick(1, 10.0);
        settings.pass_one.form_factor_tolerance = 0.002;
        let pass_one = solve(room.scene(), &settings, &mut silent).expect("solves").pass_one;
        let mesh = &pass_one.field.patches;
        assert_eq!(mesh.len(), 6, "one patch a face");
        for i in 0..6 {
            let want = match mesh.normal[i].y {
                y if y < -0.5 => ceiling,
                y if y > 0.5 => floor,
                _ => wall,
            };
            let got = pass_one.field.radiosity(i).g;
            assert!((got / want - 1.0).abs() < 3e-3, "rho {rho}, face {i}: {got}, expected {want}");
        }
    }
}

/// What a finer pass one will cost decides whether it is made. A wall makes four times as many patches; of small things there are
/// as many as before.
#[test]
fn rays_of_finer_patches_are_foretold() {
    let walls = crate::support::furnace(0.5);
    let mut things = crate::support::furnace(0.5);
    let grey = things.grey(0.4);
    // Leaves that are apart from each other: each is a patch of its own, whatever the size asked for.
    for k in 0..900_u32 {
        let k = f64::from(k);
        let corner = DVec3::new(0.8 * (k * 1.9).sin(), 0.8 * (k * 2.3).cos(), 0.8 * (k * 0.7).sin());
        things.quad(corner, DVec3::X * 0.04, DVec3::Y * 0.04, grey, 0.0);
    }
    let least = |mesh: &PatchMesh| -> f64 {
        let cell = mesh.patch_size * mesh.patch_size;
        mesh.area.iter().map(|a| (a / cell).clamp(mesh.least_share(), 1.0)).sum()
    };
    for (room, expected) in [(&walls, 4.0), (&things, 2.0)] {
        let (_, coarse) = patches(room, 0.4);
        let (_, fine) = patches(room, 0.2);
        let (foretold, found) = (coarse.shares_if_finer(4.0, false), least(&fine) / least(&coarse));
        assert!((foretold / found - 1.0).abs() < 0.1, "{foretold} foretold, {found} found");
        assert!((found / expected - 1.0).abs() < 0.5, "{found}, expected about {expected}");
    }
}

/// Half of each patch of a floor lies in the dark under a black strip, where nobody sees it. They give the room the light of their other halves
/// all the same, and no more than there is; by their means they would give half of that.
#[test]
fn a_patch_shows_its_open_part() {
    let mut room = Room::new(DVec3::new(0.9, 0.5, 0.0), DVec3::new(-1.0, 0.3, 0.0), 4);
    let [white, dark, black] = [0.8, 0.05, 0.0].map(|rho| room.grey(rho));
    room.walls(DVec3::new(-1.0, 0.0, -1.0), DVec3::ONE, [black, black, white, dark, black, black], [0.0; 6]);
    for x in [-1.0, -0.5, 0.0, 0.5] {
        room.quad(DVec3::new(x, 0.01, -1.0), DVec3::Z * 2.0, DVec3::X * 0.25, black, 0.0);
    }
    room.point_light(DVec3::new(0.0, 0.7, 0.0), 1.0);
    let solved = |size: f64, shown: bool| {
        let mut settings = quick(1, size);
        settings.pass_one.form_factor_tolerance = 0.005;
        settings.pass_one.seen = if shown { Seen::Lamps } else { Seen::Nothing };
        solve(room.scene(), &settings, &mut silent).expect("solves").pass_one
    };
    // Light that the ceiling gets from the floor, over its area.
    let onto_ceiling = |size: f64, shown: bool| {
        let field = solved(size, shown).field;
        let of_ceiling = |i: &usize| field.patches.normal[*i].y < -0.9 && field.shadow_irradiance[*i].g > 0.0;
        (0..field.patches.len()).filter(of_ceiling).map(|i| field.patches.area[i] * field.indirect_irradiance[i].g).sum::<f64>()
    };
    let (fine, mean, shown) = (onto_ceiling(0.06, false), onto_ceiling(0.5, false), onto_ceiling(0.5, true));
    assert!(mean < 0.7 * fine, "by the mean {mean}, where there is {fine}: the scene shows nothing");
    assert!((shown / fine - 1.0).abs() < 0.04, "{shown} from one patch, {fine} from small ones");
    // What reaches the dark sides of the strips is not taken back: they are no patches.
    let lost = solved(0.5, true).power.unaccounted;
    assert!(lost.abs() < 0.02, "power of {lost} of what is emitted is nowhere");
}

/// The same with grey strips, which have patches below, where next to nothing arrives.
#[test]
fn what_a_patch_does_not_show_is_not_given_to_what_lies_in_its_dark() {
    let mut room = Room::new(DVec3::new(0.9, 0.5, 0.0), DVec3::new(-1.0, 0.3, 0.0), 4);
    let [white, black] = [0.8, 0.0].map(|rho| room.grey(rho));
    strips_in_grey(&mut room, [white, black]);
    room.point_light(DVec3::new(0.0, 0.7, 0.0), 1.0);
    let [fine, mean, shown] =
        [(0.08, Seen::Nothing), (0.5, Seen::Nothing), (0.5, Seen::Lamps)].map(|(size, seen)| downwards(&room, size, seen));
    // A third of what the means have wrong is left: light that patches send each other keeps its mean.
    for (place, k) in [("on the ceiling", 0), ("in the dark", 1)] {
        let (before, after) = (mean[k] - fine[k], shown[k] - fine[k]);
        assert!(
            before.abs() > 0.1 * fine[k],
            "{place} by the mean {}, where there is {}: the scene shows nothing",
            mean[k],
            fine[k]
        );
        assert!(
            (after / before).abs() < 0.4,
            "{place} {} from one patch, {} by the mean, {} from small ones",
            shown[k],
            mean[k],
            fine[k]
        );
    }
}

/// The same in light of a point, and in light that the ceiling alone reflects, where light that patches send each other counts by what is seen of it as well:
/// next to nothing is wrong any more.
#[test]
fn a_patch_shows_its_open_part_of_what_patches_send_and_keeps_the_rest_in_the_dark() {
    for by_patches in [false, true] {
        let mut room = Room::new(DVec3::new(0.9, 0.5, 0.0), DVec3::new(-1.0, 0.3, 0.0), 4);
        let [white, black] = [0.8, 0.0].map(|rho| room.grey(rho));
        strips_in_grey(&mut room, [white, black]);
        match by_patches {
            true => room.quad(DVec3::new(-0.2, 0.6, -0.2), DVec3::Z * 0.4, DVec3::X * 0.4, black, 10.0),
            false => room.point_light(DVec3::new(0.0, 0.7, 0.0), 1.0),
        }
        let [fine, mean, shown] =
            [(0.08, Seen::Nothing), (0.5, Seen::Nothing), (0.5, Seen::All)].map(|(size, seen)| downwards(&room, size, seen));
        assert!((mean[0] / fine[0] - 1.0).abs() > 0.1, "by the mean {mean:?}, where there is {fine:?}: the scene shows nothing");
        assert!((shown[0] / fine[0] - 1.0).abs() < 0.04, "{shown:?} from one patch, {fine:?} from small ones");
        let dark = (shown[1] - fine[1]) / (mean[1] - fine[1]);
        assert!(dark.abs() < 0.2, "{shown:?} from one patch, {mean:?} by the mean, {fine:?} from small ones");
    }
}

/// Walls of which the sides are white, and grey strips above the floor.
fn strips_in_grey(room: &mut Room, [white, black]: [MaterialId; 2]) {
    let reflectance = Texture::Constant(Rgb::grey(0.5));
    let grey = room.material(Material::Diffuse { reflectance }, true);
    room.walls(DVec3::new(-1.0, 0.0, -1.0), DVec3::ONE, [black, black, white, white, black, black], [0.0; 6]);
    for x in [-1.0, -0.5, 0.0, 0.5] {
        room.quad(DVec3::new(x, 0.01, -1.0), DVec3::Z * 2.0, DVec3::X * 0.25, grey, 0.0);
    }
}

/// Light that patches send to those that look down: the ceiling, and the dark sides of the strips.
fn downwards(room: &Room, size: f64, seen: Seen) -> [f64; 2] {
    let mut settings = quick(1, size);
    settings.pass_one.form_factor_tolerance = 0.01;
    settings.pass_one.seen = seen;
    let field = solve(room.scene(), &settings, &mut silent).expect("solves").pass_one.field;
    let patches = &field.patches;
    let middle = patches.centroid.iter().map(|c| c.y).sum::<f32>() / patches.len() as f32;
    [true, false].map(|is_ceiling| {
        let looks_down = (0..patches.len()).filter(|&i| patches.normal[i].y < -0.9);
        let those = looks_down.filter(|&i| (patches.centroid[i].y > middle) == is_ceiling);
        those.map(|i| patches.area[i] * field.indirect_irradiance[i].g).sum::<f64>()
    })
}

/// A finer pass one brings the light between surfaces of the passes before it to its own level: the picture is not left with a share of what they had wrong.
#[test]
fn earlier_passes_follow_a_finer_pass_one() {
    let mut room = Room::new(DVec3::new(0.9, 0.5, 0.0), DVec3::new(-1.0, 0.9, 0.0), 96);
    let [white, black] = [0.8, 0.0].map(|rho| room.grey(rho));
    room.walls(DVec3::new(-1.0, 0.0, -1.0), DVec3::ONE, [black, black, white, white, black, black], [0.0; 6]);
    for k in 0..16 {
        room.quad(DVec3::new(-1.0 + 0.125 * f64::from(k), 0.003, -1.0), DVec3::Z * 2.0, DVec3::X * 0.0625, black, 0.0);
    }
    room.quad(DVec3::new(-0.2, 0.6, -0.2), DVec3::Z * 0.4, DVec3::X * 0.4, black, 10.0);
    let indirect = |spp: u32| {
        let mut settings = quick(spp, 1.0);
        settings.pass_one = PassOneSettings::default();
        let rendered = run(room.scene(), &settings);
        let light = rendered.film.quantity_image(Quantity::Indirect);
        light.pixels().iter().map(|p| f64::from(p[1])).sum::<f64>()
    };
    // The second finer pass one comes with the 127th pass.
    let [before, after, later] = [126, 127, 190].map(indirect);
    assert!((before / later - 1.0).abs() > 0.03, "{before} before, {later} later: the scene shows nothing");
    assert!((after - later).abs() < 0.25 * (before - later).abs(), "{before} before, {after} after, {later} later");
}
