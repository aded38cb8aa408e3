//! Light that closed walls keep from arriving, or from being seen, is not computed; rooms that glow all over are not gathered. As in
//! [`super::plan`]: the same picture, no work, and a twin that needs it.

use crate::plan::{both, keeps, lamp, lit_room, mean};
use crate::support::{Room, furnace, quick, run};
use twopass::accel::AccelKind;
use twopass::integrator::drive::{Budget, Clocks};
use twopass::material::{Material, Texture};
use twopass::math::{DVec3, Rgb};
use twopass::pipeline::{RenderSettings, Rendered, StageCosts, render_world};
use twopass::plan::Mode;
use twopass::progress::silent;
use twopass::scene::Scene;
use twopass::world::World;

/// A render in which pass one does nothing on the sides of triangles that `is_idle` names by shape and front, whatever the plan says.
fn forced(scene: Scene, settings: &RenderSettings, is_idle: impl Fn(usize, bool) -> bool) -> Rendered {
    let mut world = World::new(scene, AccelKind::default()).expect("a world");
    let sides = (0..world.soup().triangles.len() as u32).map(|p| [true, false].map(|front| is_idle(world.shape_index(p), front)));
    let sides = sides.collect();
    world.leave_idle(sides, true);
    let clocks = Clocks::start(twopass::run_report::process_cpu_seconds);
    render_world(world, settings, &clocks, StageCosts::default(), &mut silent, &mut |_, _, _| {}).expect("renders")
}

/// A lit room with a box of two-sided walls inside, of which one may be missing. The walls of the box are the last shapes.
fn room_with_box(missing: Option<usize>) -> Room {
    let mut room = lit_room(|r| r.grey(0.5));
    let wall = room.material(Material::Diffuse { reflectance: Texture::Constant(Rgb::new(0.7, 0.5, 0.3)) }, true);
    let first = room.source.shapes.len();
    room.walls(DVec3::new(-0.6, -0.7, 0.1), DVec3::new(0.4, -0.1, 0.7), [wall; 6], [0.0; 6]);
    if let Some(missing) = missing {
        room.source.shapes.remove(first + missing);
    }
    room
}

/// The inside of a closed box is dark: it has no form factors. Without the wall that faces the camera it is seen and lit.
#[test]
fn the_inside_of_a_closed_box_is_left_out() {
    let settings = quick(4, 0.3);
    let [lean, full] = both(&room_with_box(None).scene(), &settings, "a closed box");
    assert!(!keeps(&lean, "dark-surfaces") && keeps(&full, "dark-surfaces") && keeps(&lean, "unseen-surfaces"));
    assert_eq!(lean.counts.idle, 0);
    assert!(full.counts.idle > 0 && lean.counts.form_factor < full.counts.form_factor);
    let first = lean.world.scene().shapes.len() - 6;
    let [twin, _] = both(&room_with_box(Some(4)).scene(), &settings, "an open box");
    assert!(keeps(&twin, "dark-surfaces") && twin.counts.idle == 0);
    // The five walls are seen from inside by their fronts.
    let without = forced(room_with_box(Some(4)).scene(), &settings, |shape, front| shape >= first && front);
    assert!(without.counts.form_factor < twin.counts.form_factor);
    assert!(mean(&without) < 0.999 * mean(&twin), "{} and {}", mean(&without), mean(&twin));
}

/// Two rooms beside each other, each with a lamp of its own; with a door there is no wall between them.
fn two_rooms(door: bool, size: usize) -> Room {
    let mut room = Room::new(DVec3::new(0.3, 0.1, -0.7), DVec3::new(-0.1, -0.1, 1.0), size);
    let grey = room.grey(0.5);
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [grey; 6], [0.0; 6]);
    if door {
        // The wall at x = 1.
        room.source.shapes.remove(1);
    }
    lamp(&mut room, grey, 0.9);
    room.walls(DVec3::new(1.0, -1.0, -1.0), DVec3::new(3.0, 1.0, 1.0), [grey; 6], [0.0; 6]);
    if door {
        let last = room.source.shapes.len() - 6;
        room.source.shapes.remove(last);
    } else {
        // Apart, so that no wall is in the same place as another.
        room.source.shapes.truncate(7);
        room.walls(DVec3::new(1.2, -1.0, -1.0), DVec3::new(3.2, 1.0, 1.0), [grey; 6], [0.0; 6]);
    }
    room.quad(DVec3::new(1.8, 0.7, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, grey, 30.0);
    room
}

/// A lit room that nobody looks into is left out; through a door its light is seen.
#[test]
fn a_lit_room_that_nobody_sees_is_left_out() {
    let settings = quick(4, 0.4);
    let [lean, full] = both(&two_rooms(false, 8).scene(), &settings, "two rooms");
    assert!(!keeps(&lean, "unseen-surfaces") && keeps(&full, "unseen-surfaces") && keeps(&lean, "dark-surfaces"));
    assert_eq!(lean.counts.idle, 0);
    assert!(full.counts.idle > 0 && lean.counts.form_factor < full.counts.form_factor);
    let [twin, _] = both(&two_rooms(true, 8).scene(), &settings, "with a door");
    assert!(keeps(&twin, "unseen-surfaces") && twin.counts.idle == 0);
    let shapes = twin.world.scene().shapes.len();
    let without = forced(two_rooms(true, 8).scene(), &settings, |shape, _| shape >= shapes - 6);
    assert!(mean(&without) < 0.95 * mean(&twin), "{} and {}", mean(&without), mean(&twin));
    // Solved by itself, all of it is.
    let scene = two_rooms(false, 8).scene();
    let solved = twopass::pipeline::solve(scene, &settings, &mut silent).expect("a solution");
    assert_eq!(solved.counts.form_factor, full.counts.form_factor);
    // Rays that cannot count decide nothing either: not when pass one is made finer, nor how fine.
    let refining = RenderSettings { budget: Budget { spp: Some(512), ..Budget::default() }, ..RenderSettings::default() };
    let [lean, full] = both(&two_rooms(false, 24).scene(), &refining, "refined");
    let patches = |r: &Rendered| r.pass_one.as_ref().expect("pass one ran").field.patches.len();
    assert!(patches(&full) > 1000 && patches(&lean) == patches(&full), "{} patches", patches(&full));
}

/// Both rooms, the unseen one with walls that reflect nearly all: what its solution needs touches no bit of the other.
#[test]
fn an_unseen_bright_room_changes_no_bit() {
    let mut room = two_rooms(false, 8);
    let bright = room.grey(0.9999);
    let n = room.source.shapes.len();
    room.source.shapes[n - 7..n - 1].iter_mut().for_each(|shape| shape.material = bright);
    let [lean, _] = both(&room.scene(), &quick(4, 0.4), "a bright room beside");
    assert!(!keeps(&lean, "unseen-surfaces"));
}

/// More lamps than a point looks at: how many points a patch has is decided by the light of all lamps together, but not by
/// that of a bright one which
/// nobody sees.
#[test]
fn a_bright_lamp_that_nobody_sees_decides_nothing() {
    let mut room = two_rooms(false, 8);
    let (unseen, grey) = (room.source.shapes.len() - 1, room.grey(0.5));
    room.source.shapes[unseen].emission = Texture::grey(300.0);
    for k in 0..4 {
        let corner = DVec3::new(-0.9, -0.9 + 0.45 * f64::from(k), 0.2 * f64::from(k) - 0.5);
        room.quad(corner, DVec3::Y * 0.3, DVec3::Z * 0.3, grey, 5.0);
    }
    let [lean, full] = both(&room.scene(), &quick(4, 0.4), "five lamps");
    assert!(!keeps(&lean, "unseen-surfaces") && full.counts.idle > 0);
}

/// A furnace whose walls glow nearly alike needs no gather at a goal: all radiance lies between L/(1 - rho) of its darkest and its brightest
/// wall. The other stage that changes the picture, by less than its bound.
#[test]
fn rooms_that_glow_alike_are_not_gathered() {
    let (rho, brightest) = (0.5, 1.02);
    let scene = |brightest: f64| {
        let mut room = furnace(rho);
        room.source.shapes[5].emission = Texture::grey(brightest);
        room.scene()
    };
    let asked = |error: Option<f64>| {
        let mut settings = quick(16, 0.5);
        settings.budget.error = error;
        settings.image_filter = false;
        settings
    };
    let settings = asked(Some(0.1));
    let [lean, full] = [Mode::Lean, Mode::Full].map(|plan| run(scene(brightest), &RenderSettings { plan, ..settings.clone() }));
    assert!(!keeps(&lean, "gather") && keeps(&full, "gather"));
    assert!(lean.counts.gather == 0 && full.counts.gather > 0 && lean.counts.form_factor > 0);
    // rho (L_max - L_min)/(1 - rho), and a ten-thousandth of the brightest for what pass one may leave open.
    let bound = rho / (1.0 - rho) * (brightest - 1.0 + 1e-4 * brightest);
    let (a, b) = (lean.film.image(), full.film.image());
    let values = |image: &twopass::film::Image| image.pixels().iter().flatten().map(|v| f64::from(*v)).collect::<Vec<_>>();
    let worst = values(&a).iter().zip(values(&b)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst > 0.0 && worst < bound, "pixels differ by {worst:e}, at most {bound:e} may be");
    let reason = &lean.plan.decisions.iter().find(|d| d.stage == "gather").expect("named").reason;
    // 0.0201; squared over 2² + 0.01.
    assert!(reason.contains("2.0e-2") && reason.contains("1.0e-4"), "the bounds are not told: {reason}");
    for (brightest, error) in [(1.02, Some(1e-3)), (1.02, None), (9.0, Some(0.1))] {
        let [twin, _] = both(&scene(brightest), &asked(error), &format!("brightest {brightest}, error {error:?}"));
        assert!(keeps(&twin, "gather") && twin.counts.gather > 0);
    }
    // Without gathering the brighter wall would show the patches' edges by more than the goal allows.
    let stored = RenderSettings { read_out: Some(twopass::integrator::ReadOut::DirectStored), ..asked(None) };
    let (a, b) = (run(scene(9.0), &stored).film.image(), run(scene(9.0), &asked(None)).film.image());
    let square = |a: f64, b: f64| (a - b).powi(2) / (b * b + 0.01);
    let (a, b) = (values(&a), values(&b));
    let relmse = a.iter().zip(&b).map(|(a, b)| square(*a, *b)).sum::<f64>() / a.len() as f64;
    assert!(relmse > 0.01 * 0.1, "patches show it within relMSE {relmse:e}");
}

/// One edge: nothing but what shines is seen. Two: lamps light walls.
#[test]
fn one_edge_needs_no_shadow_rays() {
    let scene = lit_room(|r| r.grey(0.5)).scene();
    let at = |depth: u32| RenderSettings { max_depth: Some(Some(depth)), ..quick(4, 0.5) };
    let [lean, full] = both(&scene, &at(1), "one edge");
    assert!(!keeps(&lean, "shadow-rays") && lean.counts.shadow == 0 && full.counts.shadow > 0);
    let [twin, _] = both(&scene, &at(2), "two edges");
    assert!(keeps(&twin, "shadow-rays") && twin.counts.shadow > 0 && mean(&twin) > 1.1 * mean(&lean));
    // Walls that glow are found by rays that gather.
    let [glowing, _] = both(&furnace(0.5).scene(), &quick(4, 0.5), "a furnace");
    assert!(!keeps(&glowing, "shadow-rays") && glowing.counts.shadow == 0);
}
