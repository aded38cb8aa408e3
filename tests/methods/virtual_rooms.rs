//! two-pass-planar and two-pass-general: light by way of mirrors and glass in pass one.

use super::support::{Room, furnace, quick, run};
use super::{greens, mean, settings};
use glam::DVec3;
use twopass::accel::AccelKind;
use twopass::form_factor::FormFactorMethod;
use twopass::integrator::{Method, MethodSettings, PathFilter};
use twopass::material::{Material, Texture};
use twopass::pipeline::{RenderSettings, solve};
use twopass::progress::silent;
use twopass::world::World;
use twopass::world::plane_mirrors::PlaneMirrors;

/// Irradiance of all patches left of the plane x = 1, by the places of their middles, with virtual rooms or without.
fn irradiances(room: &Room, reflections: Option<u32>) -> Vec<([f32; 3], f64)> {
    let mut settings = quick(1, 0.25);
    settings.pass_one.form_factors = FormFactorMethod::Analytic;
    settings.pass_one.form_factor_tolerance = 1e-4;
    settings.pass_one.extended = false;
    settings.pass_one.virtual_rooms = reflections;
    let scene = room.scene();
    let origin = scene.origin;
    let solved = solve(scene, &settings, &mut silent).expect("solves");
    let field = &solved.pass_one.field;
    let place = |i: usize| (field.patches.centroid[i].as_dvec3() + origin).as_vec3().to_array();
    let all = (0..field.patches.len()).map(|i| (place(i), field.irradiance_of(i).g));
    all.filter(|(at, _)| at[0] < 1.0 - 1e-3).collect()
}

/// Largest difference of irradiances at the same places, over their mean.
fn worst(mirrored: &[([f32; 3], f64)], doubled: &[([f32; 3], f64)]) -> f64 {
    let mean = doubled.iter().map(|d| d.1).sum::<f64>() / doubled.len() as f64;
    let error = |(at, value): &([f32; 3], f64)| {
        let same = |(other, _): &&([f32; 3], f64)| at.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-3);
        let wants: Vec<f64> = doubled.iter().filter(same).map(|d| d.1).collect();
        // Both sides of a patch lie at one place.
        wants.iter().map(|want| (value - want).abs() / mean).fold(f64::INFINITY, f64::min)
    };
    mirrored.iter().map(error).fold(0.0, f64::max)
}

/// What stands in a room of flat mirrors.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Walled {
    /// One wall is a perfect mirror.
    Whole,
    /// Half of it is.
    Part,
    /// A board stands before it.
    Board,
    /// Two walls that meet are.
    Corner,
}

/// A narrow room that glows at one end, with its mirrors or with the rooms that stand for them. Narrow: the glowing walls stay more than a
/// tenth of all, so that form factors find them in all rooms.
fn mirrored(walled: Walled, reflectance: f64, repeated: bool) -> Room {
    let mut room = Room::new(DVec3::new(0.2, 0.1, -0.7), DVec3::new(0.0, -0.1, 1.0), 16);
    let (grey, dark, mirror) = (room.grey(0.7), room.grey(0.2), room.mirror(reflectance));
    let both = room.material(Material::Diffuse { reflectance: Texture::grey(0.7) }, true);
    let (x, y, z) = (DVec3::X, DVec3::Y * 2.0, DVec3::Z * 2.0);
    let corner = walled == Walled::Corner;
    for (k, m) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        if (k > 0 && !repeated) || (m > 0 && !(corner && repeated)) {
            continue;
        }
        let low = DVec3::new(f64::from(k), -1.0, f64::from(2 * m - 1));
        // Floor and ceiling, back and front; the wall that glows.
        room.quad(low, z, x, dark, 0.0);
        room.quad(low + y, x, z, grey, 0.0);
        if m == 0 {
            room.quad(low, x, y, grey, 0.0);
        }
        if !corner || m == 1 {
            room.quad(low + z, y, x, if corner { grey } else { dark }, 0.0);
        }
        let (end, e1, e2) = if k == 0 { (low, y, z) } else { (low + x, z, y) };
        room.quad(end, e1, e2, grey, 1.0);
        if walled == Walled::Part && k == 0 {
            // The partition below an opening, with two sides: of two in one place rays would meet only the first.
            room.quad(low + x, z, 0.5 * y, both, 0.0);
        }
        if walled == Walled::Board {
            room.quad(DVec3::new(if k == 0 { 0.75 } else { 1.25 }, -0.5, -0.75), DVec3::Z * 1.5, DVec3::Y, both, 0.0);
        }
    }
    if !repeated {
        let foot = if walled == Walled::Part { 0.0 } else { -1.0 };
        let high = if walled == Walled::Part { 0.5 * y } else { y };
        room.quad(DVec3::new(1.0, foot, -1.0), z, high, mirror, 0.0);
        if corner {
            room.quad(DVec3::new(0.0, -1.0, 1.0), y, x, mirror, 0.0);
        }
    }
    room
}

/// A wall that is a perfect mirror makes the room twice as long: the solution is that of the doubled room, patch by patch. A wall that is a
/// mirror in part makes it two rooms with an opening between them, and two mirrors in a corner make it four.
#[test]
fn a_flat_mirror_doubles_the_room() {
    for (walled, reflections, within) in
        [(Walled::Whole, 1, 1e-3), (Walled::Part, 1, 1e-2), (Walled::Board, 1, 3e-2), (Walled::Corner, 2, 1e-2)]
    {
        let want = irradiances(&mirrored(walled, 1.0, true), None);
        let found = worst(&irradiances(&mirrored(walled, 1.0, false), Some(reflections)), &want);
        assert!(found < within, "{walled:?}: {found} of the mean, expected less than {within}");
        let without = worst(&irradiances(&mirrored(walled, 1.0, false), Some(reflections - 1)), &want);
        assert!(without > 5.0 * within, "{walled:?}: the mirror matters, {without}");
    }
}

/// Among black walls what a mirror adds is in proportion to its reflectance.
#[test]
fn a_mirror_sends_back_what_it_reflects() {
    let of = |reflectance: f64, reflections: u32| {
        let mut room = mirrored(Walled::Whole, reflectance, false);
        let black = room.grey(0.0);
        room.source.shapes.iter_mut().rev().skip(1).for_each(|shape| shape.material = black);
        irradiances(&room, Some(reflections))
    };
    let (none, half, whole) = (of(1.0, 0), of(0.5, 1), of(1.0, 1));
    let mean = whole.iter().map(|w| w.1).sum::<f64>() / whole.len() as f64;
    for ((n, h), w) in none.iter().zip(&half).zip(&whole) {
        assert!((0.5 * (n.1 + w.1) - h.1).abs() < 1e-6 * mean, "{h:?}, expected the mean of {n:?} and {w:?}");
    }
    let added = whole.iter().zip(&none).map(|(w, n)| w.1 - n.1).fold(0.0, f64::max);
    assert!(added > 0.1 * mean, "the mirror matters, {added}");
}

/// Facing mirrors, a curved one, glass and a screen in a room with a lamp.
fn gallery(environment: bool) -> Room {
    let mut room = Room::new(DVec3::new(0.1, 0.2, -0.95), DVec3::new(0.0, -0.2, 1.0), 24);
    let (grey, mirror, round, glass) = (room.grey(0.6), room.mirror(0.9), room.mirror(0.8), room.glass(1.5));
    let (x, y, z) = (DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 2.0);
    let low = DVec3::splat(-1.0);
    room.quad(low, z, x, grey, 0.0);
    room.quad(low, y, z, grey, 0.0);
    room.quad(low + x, z, y, grey, 0.0);
    room.quad(low + z, y, x, grey, 0.0);
    room.quad(low, x, y, grey, 0.0);
    if environment {
        room.source.environment = Some(twopass::light::Environment::Uniform(twopass::math::Rgb::grey(1.0)));
    } else {
        room.quad(low + y, x, z, grey, 0.0);
        room.quad(DVec3::new(-0.3, 0.95, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, grey, 5.0);
    }
    room.quad(DVec3::new(-0.98, -0.8, -0.6), DVec3::Y * 1.4, DVec3::Z * 1.2, mirror, 0.0);
    room.quad(DVec3::new(0.98, -0.5, -0.6), DVec3::Z * 0.9, DVec3::Y * 1.2, mirror, 0.0);
    room.quad(DVec3::new(-0.4, -0.9, 0.5), DVec3::Y * 0.8, DVec3::X * 0.4, grey, 0.0);
    room.sphere(DVec3::new(-0.4, -0.7, 0.0), 0.25, round, 0.0);
    room.sphere(DVec3::new(0.4, -0.7, 0.1), 0.25, glass, 0.0);
    room
}

/// Both methods bring the paths of their rows, compared with a path tracer that counts no others.
#[test]
fn both_ways_over_mirrors_carry_what_their_rows_say() {
    for environment in [false, true] {
        let room = gallery(environment);
        let by_paths = |text: &str| {
            let paths = Some(PathFilter::new(text).expect("well formed"));
            let methods = MethodSettings { paths, ..MethodSettings::default() };
            mean(&run(room.scene(), &RenderSettings { methods, ..settings(Method::Path, 768) }).film)
        };
        let (whole, _) = by_paths("L(S|D)*E");
        for (method, reflections, text, within) in [
            (Method::TwoPassPlanar, 1, "L(M?D)*S*E", 0.015),
            (Method::TwoPassPlanar, 3, "L(M{0,3}D)*S*E", 0.015),
            (Method::TwoPassGeneral, 0, "L(S|D)*E", 0.015),
        ] {
            let mut by = settings(method, 16);
            by.pass_one.patches.patch_size = Some(0.125);
            by.methods.virtual_rooms.reflections = reflections;
            let ((got, _), (want, error)) = (mean(&run(room.scene(), &by).film), by_paths(text));
            assert!(
                (got - want).abs() < 4.0 * error + within * want && error < 0.01 * want,
                "{method:?}, surroundings {environment}: {got}, paths {text} bring {want}, standard error {error}"
            );
            let complete = method == Method::TwoPassGeneral;
            assert!(complete || want < 0.97 * whole, "{text} leaves something out: {want} of {whole}");
        }
    }
}

/// The furnace: every wall sends the sum of the series.
#[test]
fn shown_radiosity_is_that_of_the_furnace() {
    for method in [Method::TwoPassPlanar, Method::TwoPassGeneral] {
        for rho in [0.5, 0.9] {
            for got in greens(&run(furnace(rho).scene(), &settings(method, 1)).film.image()) {
                let want = 1.0 / (1.0 - rho);
                assert!((got / want - 1.0).abs() < 1e-3, "{method:?}, rho {rho}: {got}, expected {want}");
            }
        }
    }
}

/// A mirror of two triangles is one window on each side; a ball, glass and a wall are none.
#[test]
fn flat_mirrors_are_found() {
    let world = World::new(gallery(false).scene(), AccelKind::default()).expect("a world");
    let mirrors = PlaneMirrors::find(&world);
    let areas: Vec<f64> = mirrors.windows.iter().map(|w| w.area()).collect();
    let want = [1.4 * 1.2, 1.4 * 1.2, 0.9 * 1.2, 0.9 * 1.2];
    assert_eq!(areas.len(), want.len(), "{areas:?}");
    assert!(areas.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-5), "{areas:?}");
}

/// Nothing depends on the number of threads, mirrors in mirrors and surroundings included.
#[test]
fn virtual_rooms_are_the_same_on_any_number_of_threads() {
    for environment in [false, true] {
        let picture = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| run(gallery(environment).scene(), &settings(Method::TwoPassPlanar, 1)).layers())
        };
        assert!(picture(1) == picture(2), "surroundings {environment}: layers differ");
    }
}
