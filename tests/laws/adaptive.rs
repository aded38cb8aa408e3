//! Patches that follow the light, and interpolation between patches: less error for as many, no leaks, no steps.

use crate::support::{Room, close, quick, run};
use glam::DVec3;
use std::f64::consts::PI;
use twopass::accel::AccelKind;
use twopass::film::Quantity;
use twopass::form_factor::FormFactorMethod;
use twopass::form_factor::analytic::point_to_polygon;
use twopass::geometry::tessellate::Triangles;
use twopass::integrator::{Method, ReadOut};
use twopass::math::Sampler;
use twopass::patch::{PatchId, PatchSettings};
use twopass::pipeline::{PassOne, PassOneSettings, RenderSettings, StageCosts, pass_one};
use twopass::progress::silent;
use twopass::radiosity::Interpolation;
use twopass::scene::SurfaceSource;
use twopass::world::World;
use twopass::world::walk::RayCounts;

/// Half edges of lamp and screen, and their heights over the floor.
const LAMP: (f64, f64) = (0.15, 2.0);
const SCREEN: (f64, f64) = (0.5, 0.7);

/// A square floor of 4 under a square lamp of radiance 1, with a black square between the two.
fn screened_floor() -> World {
    let mut room = Room::new(DVec3::new(0.0, 1.0, -1.5), DVec3::ZERO, 4);
    let (grey, black) = (room.grey(0.5), room.grey(0.0));
    room.quad(DVec3::new(-2.0, 0.0, -2.0), DVec3::Z * 4.0, DVec3::X * 4.0, grey, 0.0);
    for ((half, height), emission) in [(LAMP, 1.0), (SCREEN, 0.0)] {
        room.quad(DVec3::new(-half, height, -half), DVec3::X * 2.0 * half, DVec3::Z * 2.0 * half, black, emission);
    }
    World::new(room.scene(), AccelKind::default()).expect("a world")
}

/// Irradiance of the floor at (x, z): the lamp less the part in the shadow, which is the screen as projected on the lamp's plane, by Lambert's
/// formula.
fn exact(x: f64, z: f64) -> f64 {
    let rectangle = |[x0, x1]: [f64; 2], [z0, z1]: [f64; 2]| {
        let at = |x: f64, z: f64| DVec3::new(x, LAMP.1, z);
        let corners = [at(x0, z0), at(x1, z0), at(x1, z1), at(x0, z1)];
        if x0 < x1 && z0 < z1 { point_to_polygon(DVec3::new(x, 0.0, z), DVec3::Y, &corners).abs() } else { 0.0 }
    };
    let shadow = |from: f64| {
        let project = |edge: f64| from + (edge - from) * LAMP.1 / SCREEN.1;
        [project(-SCREEN.0).max(-LAMP.0), project(SCREEN.0).min(LAMP.0)]
    };
    PI * (rectangle([-LAMP.0, LAMP.0], [-LAMP.0, LAMP.0]) - rectangle(shadow(x), shadow(z)))
}

fn solve(world: &World, patch_size: f64, adaptive: Option<f64>) -> PassOne {
    let patches = PatchSettings { patch_size: Some(patch_size), adaptive, ..PatchSettings::default() };
    let form_factors = FormFactorMethod::Hierarchical;
    let settings = PassOneSettings { patches, form_factors, form_factor_tolerance: 1e-2, ..PassOneSettings::default() };
    let (mut costs, mut counts) = (StageCosts::default(), RayCounts::default());
    pass_one::solve(world, &settings, 1, &mut costs, &mut counts, &mut silent).expect("solves")
}

/// Root mean square errors over the floor relative to the root mean square: constant over patches, interpolated.
fn errors(world: &World, solved: &PassOne) -> [f64; 2] {
    let smooth = Interpolation::new(world, &solved.field);
    let (mut off, mut all) = ([0.0; 2], 0.0);
    for k in 0..20_000 {
        let u = Sampler::new(9, 0, k).next_2d();
        let (x, z) = (4.0 * f64::from(u.x) - 2.0, 4.0 * f64::from(u.y) - 2.0);
        let ray = twopass::geometry::Ray::new((DVec3::new(x, 0.2, z) - world.scene().origin).as_vec3(), DVec3::NEG_Y.as_vec3());
        let si = world.intersect(&ray).expect("the floor");
        let want = exact(x, z);
        let got = [solved.field.irradiance(&si), smooth.irradiance(&solved.field, &si)];
        (0..2).for_each(|k| off[k] += (got[k].g - want).powi(2));
        all += want * want;
    }
    off.map(|off: f64| (off / all).sqrt())
}

/// With no more patches than of one size, the error of what is interpolated is smaller by a third at least, where it is shadows that make it.
#[test]
fn patches_that_follow_shadows_leave_less_error() {
    let world = screened_floor();
    let [uniform, adaptive] = [solve(&world, 0.06, None), solve(&world, 0.5, Some(0.01))];
    let [n, fewer] = [&uniform, &adaptive].map(|s| s.field.patches.len());
    let ([constant, smooth], [of_few, of_few_smooth]) = (errors(&world, &uniform), errors(&world, &adaptive));
    println!("{n} patches of one size {constant:.4} {smooth:.4}, {fewer} that follow {of_few:.4} {of_few_smooth:.4}");
    assert!(fewer <= n, "{fewer} patches, of one size {n}");
    assert!(of_few_smooth < 0.67 * smooth, "{of_few_smooth} with {fewer} patches, {smooth} with {n} of one size");
}

#[test]
fn cut_patches_keep_their_area_and_their_points() {
    let mut room = crate::support::furnace(0.5);
    let grey = room.grey(0.4);
    room.quad(DVec3::new(-0.13, -1.0, -1.0), DVec3::Y, DVec3::Z, grey, 0.0);
    room.sphere(DVec3::new(0.4, 0.0, 0.3), 0.3, grey, 0.0);
    let world = World::new(room.scene(), AccelKind::default()).expect("a world");
    let settings = PatchSettings { patch_size: Some(0.4), ..PatchSettings::default() };
    let mut mesh = twopass::patch::PatchMesh::build(&world, &settings).expect("cuts");
    let whole: f64 = mesh.area.iter().sum();
    for round in 0..4_u64 {
        let marked: Vec<bool> = (0..mesh.len()).map(|i| mesh.is_divisible(i) && (i as u64 * 7 + round) % 5 < 2).collect();
        let before = mesh.len();
        mesh = mesh.refined(&world, &marked);
        assert!(mesh.len() > before + marked.iter().filter(|m| **m).count(), "{} after {before}", mesh.len());
        close("area", mesh.area.iter().sum(), whole, 1e-5);
        let mut strays = 0;
        for i in 0..mesh.len() as u32 {
            for k in 0..4 {
                let at = mesh.sample(&world, PatchId(i), Sampler::new(1, u64::from(i), k).next_2d());
                strays += u32::from(mesh.patch_at(&at) != Some(PatchId(i)));
            }
        }
        assert!(strays <= mesh.len() as u32 * 4 / 2_000, "{strays} of {} points lie in another patch", mesh.len() * 4);
    }
}

#[test]
fn patches_that_follow_the_light_are_the_same_on_any_number_of_threads() {
    let world = screened_floor();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let solved = pool.install(|| solve(&world, 0.5, Some(0.05)));
        let field = solved.field;
        (0..field.patches.len())
            .map(|i| (field.patches.area[i].to_bits(), field.irradiance_of(i).g.to_bits()))
            .collect::<Vec<_>>()
    };
    assert_eq!(on(1), on(2));
}

/// Patches beside each other differ by a level at most, and where small ones meet large ones interpolation has no steps: a step a
/// ten-thousandth of the floor wide is nowhere more than a hundredth of what patches differ by.
#[test]
fn interpolation_has_no_steps_where_sizes_change() {
    let world = screened_floor();
    let solved = solve(&world, 0.5, Some(0.02));
    let (field, smooth) = (&solved.field, Interpolation::new(&world, &solved.field));
    let floor: Vec<usize> = (0..field.patches.len()).filter(|&i| field.patches.rho[i].g > 0.0).collect();
    let levels: std::collections::BTreeSet<u8> = floor.iter().map(|&i| field.patches.level(i)).collect();
    assert!(levels.len() >= 4, "{levels:?}");
    let at = |x: f64, z: f64| {
        let from = (DVec3::new(x, 0.2, z) - world.scene().origin).as_vec3();
        world.intersect(&twopass::geometry::Ray::new(from, DVec3::NEG_Y.as_vec3())).expect("the floor")
    };
    let (mut step, mut facet, mut largest) = (0.0_f64, 0.0_f64, 0.0_f64);
    for k in 0..40_000_u64 {
        let u = Sampler::new(4, 0, k).next_2d();
        let (x, z) = (3.9 * f64::from(u.x) - 1.95, 3.9 * f64::from(u.y) - 1.95);
        let [here, there] = [at(x, z), at(x + 4e-4, z)];
        let [a, b] = [&here, &there].map(|si| field.patches.patch_at(si).expect("a patch").0 as usize);
        assert!(field.patches.level(a).abs_diff(field.patches.level(b)) <= 1, "levels at {x}, {z}");
        // Within patches as well: it is where others begin to count that a step may be.
        step = step.max((smooth.irradiance(field, &here).g - smooth.irradiance(field, &there).g).abs());
        facet = facet.max((field.irradiance_of(a).g - field.irradiance_of(b).g).abs());
        largest = largest.max(field.irradiance_of(a).g);
    }
    println!("largest step {:.4}, of patches {:.4}, of {largest}", step / largest, facet / largest);
    assert!(facet > 0.05 * largest && step < 0.02 * largest, "largest step {step}, of patches {facet}, of {largest}");
}

/// A closed room, divided by a wall across its floor and ceiling, lit on one side only.
fn divided(eye: DVec3, target: DVec3) -> Room {
    let mut room = Room::new(eye, target, 24);
    let grey = room.grey(0.7);
    room.walls(DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0), [grey; 6], [0.0; 6]);
    // The two sides of the wall.
    room.quad(DVec3::new(1.03, 0.0, 0.0), DVec3::Y, DVec3::Z, grey, 0.0);
    room.quad(DVec3::new(1.02, 0.0, 0.0), DVec3::Z, DVec3::Y, grey, 0.0);
    room.quad(DVec3::new(0.3, 0.95, 0.3), DVec3::X * 0.3, DVec3::Z * 0.3, grey, 10.0);
    room
}

/// What is read of pass one, whole or but for the lamps, lies on this side of a wall: behind it all is black, with patches of one size or not.
#[test]
fn interpolated_radiosity_does_not_leak_through_a_wall() {
    for adaptive in [None, Some(0.05)] {
        for (method, read_out) in [(Method::TwoPassWhitted, None), (Method::TwoPass, Some(ReadOut::Stored))] {
            let mut settings = RenderSettings { method, read_out, ..quick(4, 0.25) };
            settings.pass_one.patches.adaptive = adaptive;
            let seen = |eye: DVec3, target: DVec3| {
                let image = run(divided(eye, target).scene(), &settings).film.quantity_image(Quantity::Indirect);
                image.pixels().iter().map(|p| f64::from(p[1])).fold(0.0, f64::max)
            };
            // Along the foot of the wall, from either side of it.
            let dark = seen(DVec3::new(1.9, 0.9, 0.5), DVec3::new(1.05, 0.0, 0.5));
            let lit = seen(DVec3::new(0.1, 0.9, 0.5), DVec3::new(1.0, 0.0, 0.5));
            assert!(dark == 0.0 && lit > 0.1, "{method:?} {adaptive:?}: {dark} behind the wall, {lit} before it");
        }
    }
}

/// Two faces of one mesh that meet in a corner, in sight of each other: no patch of one counts on the other.
#[test]
fn interpolation_ends_at_a_corner() {
    let mut room = Room::new(DVec3::new(0.5, 1.0, -1.5), DVec3::new(0.5, 0.2, 0.0), 4);
    let (grey, black) = (room.grey(0.7), room.grey(0.0));
    let positions = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, 1.0, 1.0), (1.0, 1.0, 1.0)]
        .map(|(x, y, z)| DVec3::new(x, y, z))
        .to_vec();
    // The floor looks up, the wall behind it towards -z.
    let triangles = vec![[0, 2, 1], [0, 3, 2], [3, 5, 2], [3, 4, 5]];
    room.add(SurfaceSource::Triangles(Triangles { positions, normals: Vec::new(), uvs: Vec::new(), triangles }), grey, 0.0);
    room.quad(DVec3::new(0.3, 1.5, 0.3), DVec3::X * 0.4, DVec3::Z * 0.4, black, 10.0);
    let world = World::new(room.scene(), AccelKind::default()).expect("a world");
    let solved = solve(&world, 0.1, None);
    let (patches, smooth) = (&solved.field.patches, Interpolation::new(&world, &solved.field));
    let of_fold: Vec<usize> = (0..patches.len()).filter(|&i| patches.rho[i].g > 0.0).collect();
    let floor = of_fold.iter().filter(|&&i| patches.normal[i].y > 0.9).count();
    assert!(floor > 50 && of_fold.len() - floor > 50, "{floor} patches of {} on the floor", of_fold.len());
    for &i in &of_fold {
        assert!(smooth.neighbours(i).len() >= 4, "patch {i} is alone");
        for &j in smooth.neighbours(i) {
            let bend = patches.normal[i].dot(patches.normal[j as usize]);
            assert!(bend > 0.9, "patches {i} and {j} share values over a corner");
        }
    }
}

/// Two faces of one mesh that meet in an edge, one lit and one turned away: the light of the one does not show on the other.
#[test]
fn interpolated_radiosity_does_not_leak_over_an_edge() {
    let mut room = Room::new(DVec3::new(0.5, -0.4, -1.5), DVec3::new(0.5, -0.2, 0.0), 24);
    let (grey, black) = (room.grey(0.7), room.grey(0.0));
    let positions = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, -1.0, 0.0)]
        .map(|(x, y, z)| DVec3::new(x, y, z))
        .to_vec();
    // The top looks up, the front towards -z.
    let triangles = vec![[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4]];
    let fold = Triangles { positions, normals: Vec::new(), uvs: Vec::new(), triangles };
    room.add(SurfaceSource::Triangles(fold), grey, 0.0);
    // Behind the plane of the front.
    room.quad(DVec3::new(0.3, 1.0, 0.3), DVec3::X * 0.4, DVec3::Z * 0.4, black, 10.0);
    let settings = RenderSettings { method: Method::TwoPass, read_out: Some(ReadOut::Stored), ..quick(4, 0.2) };
    let rendered = run(room.scene(), &settings);
    let solved = rendered.pass_one.as_ref().expect("a solution");
    let lit = (0..solved.field.patches.len()).map(|i| solved.field.irradiance_of(i).g).fold(0.0, f64::max);
    let seen = rendered.film.quantity_image(Quantity::Indirect);
    let front = seen.pixels().iter().map(|p| f64::from(p[1])).fold(0.0, f64::max);
    assert!(lit > 0.1 && front == 0.0, "{front} on the front, {lit} on the top");
}
