//! What the plan leaves out changes no bit of the picture, does not run, and would be missed where it is needed.
//!
//! `TWOPASS_PLAN_SCENES=500 cargo test --release --test laws plan::random` tries 500 random scenes instead of 50.

use crate::support::{Room, furnace, quick, run};
use twopass::accel::AccelKind;
use twopass::film::layer::{Layer, LayerData};
use twopass::integrator::{Method, ReadOut};
use twopass::light::Environment;
use twopass::material::texture::{Bitmap, Filter, Wrap};
use twopass::material::{Material, MaterialId, Texture};
use twopass::math::{DVec3, Rgb, Sampler, Vec3};
use twopass::patch::{PatchMesh, PatchSettings};
use twopass::pipeline::{RenderSettings, Rendered};
use twopass::plan::Mode;
use twopass::scene::{FilmSettings, LightSource, Scene};
use twopass::world::World;

/// The lean and the full render of a scene; all bits of all layers are the same, and all values are numbers.
pub fn both(scene: &Scene, settings: &RenderSettings, what: &str) -> [Rendered; 2] {
    let both = [Mode::Lean, Mode::Full].map(|plan| run(scene.clone(), &RenderSettings { plan, ..settings.clone() }));
    let bits = |r: &Rendered| -> Vec<(String, Vec<u32>)> {
        let values = |layer: &Layer| match &layer.data {
            LayerData::Rgb(image) | LayerData::Xyz(image) => image.pixels().iter().flatten().map(|v| v.to_bits()).collect(),
            LayerData::Z(plane) => plane.values().iter().map(|v| v.to_bits()).collect(),
        };
        r.layers().iter().map(|layer| (layer.name.clone(), values(layer))).collect()
    };
    for ((name, lean), (_, full)) in bits(&both[0]).into_iter().zip(bits(&both[1])) {
        assert!(lean == full, "{what}: layer {name:?} differs");
        assert!(lean.iter().all(|v| f32::from_bits(*v).is_finite()), "{what}: layer {name:?} holds no number");
    }
    both
}

/// A room of side 2 with one lamp below its ceiling; no camera sees it from outside.
pub fn lit_room(wall: impl FnOnce(&mut Room) -> MaterialId) -> Room {
    let mut room = Room::new(DVec3::new(0.2, 0.1, -0.7), DVec3::new(0.0, -0.1, 1.0), 8);
    let grey = room.grey(0.5);
    let special = wall(&mut room);
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [grey, grey, grey, grey, grey, special], [0.0; 6]);
    lamp(&mut room, grey, 0.9);
    room
}

pub fn lamp(room: &mut Room, material: MaterialId, y: f64) {
    room.quad(DVec3::new(-0.3, y, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, material, 8.0);
}

fn lamp_at(room: &mut Room, corner: DVec3, material: MaterialId) {
    room.quad(corner, DVec3::X * 0.3, DVec3::Z * 0.5, material, 5.0);
}

/// The mean of a picture.
pub fn mean(rendered: &Rendered) -> f64 {
    let image = rendered.film.image();
    let values: Vec<f64> = image.pixels().iter().flatten().map(|v| f64::from(*v)).collect();
    values.iter().sum::<f64>() / values.len() as f64
}

pub fn keeps(rendered: &Rendered, stage: &str) -> bool {
    rendered.plan.decisions.iter().find(|d| d.stage == stage).expect("the plan names the stage").kept
}

/// A picture of four texels, one of which differs.
fn spotted() -> Texture {
    let texels = [[0.9_f32; 3], [0.1; 3], [0.1; 3], [0.1; 3]].into_iter().collect();
    Texture::Bitmap(Bitmap { width: 2, height: 2, texels, filter: Filter::Nearest, wrap: Wrap::Repeat, to_uv: Bitmap::IDENTITY })
}

#[test]
fn a_diffuse_room_needs_no_recursion_and_one_mirror_does() {
    let settings = quick(4, 0.5);
    let [lean, full] = both(&lit_room(|r| r.grey(0.5)).scene(), &settings, "diffuse room");
    assert_eq!((lean.counts.lobes, lean.counts.uv, lean.counts.distant), (0, 0, 0));
    assert!(full.counts.lobes > 0 && full.counts.uv > 0);
    assert!(!keeps(&lean, "recursion") && keeps(&full, "recursion"));
    let [twin, _] = both(&lit_room(|r| r.mirror(0.9)).scene(), &settings, "a mirror");
    assert!(twin.counts.lobes > 0 && twin.counts.reflected > 0, "{:?}", twin.counts);
    // Without recursion the mirror would be black where it is seen, as a black wall is.
    let black = run(lit_room(|r| r.grey(0.0)).scene(), &settings);
    assert!(mean(&twin) > 1.1 * mean(&black), "{} and {}", mean(&twin), mean(&black));
}

#[test]
fn a_texture_needs_coordinates() {
    let settings = quick(4, 0.5);
    let textured = |reflectance| lit_room(|r| r.material(Material::Diffuse { reflectance }, false)).scene();
    let [plain, _] = both(&textured(Texture::grey(0.1)), &settings, "plain");
    assert_eq!(plain.counts.uv, 0);
    let [twin, _] = both(&textured(spotted()), &settings, "one texel differs");
    assert!(twin.counts.uv > 0);
    assert!(mean(&twin) != mean(&plain), "the texel is not seen");
}

#[test]
fn a_faint_sky_needs_a_look_outside() {
    let settings = quick(4, 0.5);
    let open = |sky: Option<f64>| {
        let mut room = Room::new(DVec3::new(0.0, 1.0, -2.0), DVec3::ZERO, 8);
        let grey = room.grey(0.5);
        room.quad(DVec3::new(-1.0, 0.0, -1.0), DVec3::Z * 2.0, DVec3::X * 2.0, grey, 0.0);
        lamp(&mut room, grey, 0.9);
        room.source.environment = sky.map(|l| Environment::Uniform(Rgb::grey(l)));
        room.scene()
    };
    let [dark, full] = both(&open(None), &settings, "no sky");
    assert_eq!(dark.counts.distant, 0);
    assert!(full.counts.distant > 0);
    let [twin, _] = both(&open(Some(1e-6)), &settings, "a faint sky");
    assert!(twin.counts.distant > 0);
    assert!(mean(&twin) > mean(&dark), "the sky is not seen");
}

#[test]
fn a_scene_without_light_is_black_and_needs_no_pass_one() {
    let settings = quick(2, 0.5);
    let dark = |emission: f64| {
        let mut room = furnace(0.5);
        room.source.shapes.iter_mut().for_each(|s| s.emission = Texture::grey(emission));
        room.scene()
    };
    let [lean, full] = both(&dark(0.0), &settings, "no light");
    let c = lean.counts;
    assert_eq!((c.form_factor, c.gather, c.shadow, c.visibility, mean(&lean)), (0, 0, 0, 0, 0.0));
    assert!(lean.pass_one.is_none() && full.counts.form_factor > 0);
    let [twin, _] = both(&dark(1e-3), &settings, "a faint light");
    assert!(twin.counts.form_factor > 0 && mean(&twin) > 0.0);
}

#[test]
fn mirrors_alone_need_no_pass_one() {
    let settings = quick(4, 0.5);
    let scene = |rho: f64| {
        let mut room = Room::new(DVec3::new(0.0, 0.3, -2.0), DVec3::ZERO, 8);
        let (mirror, grey) = (room.mirror(0.8), room.grey(rho));
        room.quad(DVec3::new(-1.0, 0.0, -1.0), DVec3::Z * 2.0, DVec3::X * 2.0, mirror, 0.0);
        if rho > 0.0 {
            room.quad(DVec3::new(-1.0, 0.0, 1.0), DVec3::Y, DVec3::X * 2.0, grey, 0.0);
        }
        room.point_light(DVec3::new(0.0, 2.0, 0.0), 1.0);
        room.source.environment = Some(Environment::Uniform(Rgb::grey(0.5)));
        room.scene()
    };
    let [lean, _] = both(&scene(0.0), &settings, "mirrors");
    assert_eq!((lean.counts.form_factor, lean.counts.gather), (0, 0));
    assert!(lean.pass_one.is_none() && mean(&lean) > 0.0);
    let [twin, _] = both(&scene(0.01), &settings, "one patch of 1 %");
    assert!(twin.counts.form_factor > 0 && twin.pass_one.is_some());
}

/// Where nothing is diffuse samples go where the error is all the same: to the edges of a mirror before the sky, which alone are noisy.
#[test]
fn samples_are_allotted_among_mirrors_too() {
    let scene = || {
        let mut room = Room::new(DVec3::new(0.0, 0.3, -2.0), DVec3::ZERO, 32);
        let mirror = room.mirror(0.3);
        room.quad(DVec3::new(-1.03, 0.0, -1.0), DVec3::new(0.1, 0.0, 2.0), DVec3::X * 2.0, mirror, 0.0);
        room.source.environment = Some(Environment::Uniform(Rgb::grey(0.5)));
        room.scene()
    };
    let error = |read_out| {
        let [lean, _] =
            both(&scene(), &RenderSettings { read_out, image_filter: false, ..quick(64, 0.5) }, "a mirror under the sky");
        lean.film.estimated_relmse().expect("two halves")
    };
    let (allotted, even) = (error(None), error(Some(ReadOut::FinalGather)));
    // Most pixels see no edge: those that do can have several times their even share.
    assert!(allotted > 0.0 && allotted < 0.6 * even, "relMSE {allotted:e}, and {even:e} by even samples");
}

/// Where paths are so short that nothing is stored samples are allotted as well: to the edges of walls and of the lamp.
#[test]
fn samples_are_allotted_where_paths_are_short() {
    let error = |read_out| {
        let settings = RenderSettings { read_out, image_filter: false, max_depth: Some(Some(2)), ..quick(64, 0.5) };
        let mut room = lit_room(|r| r.grey(0.5));
        room.source.film = FilmSettings { width: 32, height: 32, ..room.source.film };
        let [lean, _] = both(&room.scene(), &settings, "two edges");
        lean.film.estimated_relmse().expect("two halves")
    };
    let (allotted, even) = (error(None), error(Some(ReadOut::FinalGather)));
    assert!(allotted > 0.0 && allotted < 0.6 * even, "relMSE {allotted:e}, and {even:e} by even samples");
}

/// Two edges: light straight from lamps, glowing walls and the sky; nothing of pass one. The glowing walls of a furnace give
/// L_e (1 + rho) then, whatever the read-out.
#[test]
fn two_edges_need_no_pass_one() {
    let settings = RenderSettings { max_depth: Some(Some(2)), ..quick(4, 0.5) };
    let [lean, full] = both(&furnace(0.5).scene(), &settings, "furnace at depth 2");
    assert_eq!(lean.counts.form_factor, 0);
    assert!(full.counts.form_factor > 0 && keeps(&lean, "gather"));
    assert!((mean(&lean) - 1.5).abs() < 1e-5, "{}", mean(&lean));
    let [lamp_only, _] = both(&lit_room(|r| r.grey(0.5)).scene(), &settings, "a lamp at depth 2");
    assert_eq!((lamp_only.counts.form_factor, lamp_only.counts.gather), (0, 0));
    let [twin, _] = both(&furnace(0.5).scene(), &RenderSettings { max_depth: Some(Some(3)), ..settings }, "depth 3");
    assert!(twin.counts.form_factor > 0 && mean(&twin) > 1.6);
}

#[test]
fn a_grey_scene_is_solved_in_one_channel() {
    let settings = quick(2, 0.5);
    let channels = |r: &Rendered| r.pass_one.as_ref().expect("pass one ran").channels;
    let [lean, full] = both(&lit_room(|r| r.grey(0.5)).scene(), &settings, "grey");
    assert_eq!((channels(&lean), channels(&full)), (1, 3));
    let tint = Texture::Constant(Rgb::new(0.5, 0.5, 0.501));
    let [twin, _] = both(&lit_room(|r| r.material(Material::Diffuse { reflectance: tint }, false)).scene(), &settings, "tinted");
    assert_eq!(channels(&twin), 3);
    let image = twin.film.image();
    assert!(image.pixels().iter().any(|p| p[0] != p[2]), "the tint is not seen");
}

#[test]
fn a_convex_room_needs_no_test_of_visibility() {
    let settings = quick(4, 0.5);
    let room = |height: f64, block: bool| {
        let mut room = Room::new(DVec3::new(0.2, 0.1, -0.7), DVec3::new(0.0, -0.5, 1.0), 8);
        let grey = room.grey(0.5);
        room.walls(DVec3::splat(-1.0), DVec3::new(1.0, height, 1.0), [grey; 6], [0.0; 6]);
        room.point_light(DVec3::new(0.1, 0.6, 0.2), 2.0);
        if block {
            let black = room.grey(0.0);
            room.quad(DVec3::new(-0.9, -0.2, -0.9), DVec3::Z * 1.8, DVec3::X * 1.8, black, 0.0);
        }
        room.scene()
    };
    let [lean, full] = both(&room(1.0, false), &settings, "convex");
    assert_eq!(lean.counts.visibility, 0);
    assert!(full.counts.visibility > 0 && lean.counts.shadow == full.counts.shadow);
    let [twin, _] = both(&room(1.0, true), &settings, "a shelf inside");
    assert!(twin.counts.visibility > 0 && mean(&twin) < mean(&lean));
    // The light is outside, above the ceiling: nothing comes in.
    let [outside, _] = both(&room(0.5, false), &settings, "light outside");
    assert!(outside.counts.visibility > 0 && mean(&outside) == 0.0);
}

/// A camera outside a convex room looks at walls from behind, or in through a wall that is not there: neither plan may take its rays for
/// such as start inside.
#[test]
fn a_camera_outside_a_convex_room_sees_its_outside() {
    let settings = quick(4, 0.5);
    let room = |eye: DVec3, two_sided: bool, open: bool| {
        let mut room = Room::new(eye, DVec3::new(0.05, -0.1, 0.0), 8);
        let wall = room.material(Material::Diffuse { reflectance: Texture::grey(0.5) }, two_sided);
        room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [wall; 6], [0.0; 6]);
        if open {
            // Without the wall at z = -1.
            room.source.shapes.remove(4);
        }
        room.point_light(DVec3::new(0.1, 0.6, 0.2), 2.0);
        room.scene()
    };
    let places = [DVec3::new(0.2, 0.1, -3.0), DVec3::new(3.0, 0.4, -2.5), DVec3::new(-2.0, 2.5, 1.5), DVec3::new(0.1, -4.0, 0.2)];
    for eye in places {
        for two_sided in [false, true] {
            let [lean, _] = both(&room(eye, two_sided, false), &settings, &format!("closed, seen from {eye}"));
            assert!(lean.counts.visibility == 0 && !keeps(&lean, "visibility"), "the room is convex wherever the camera is");
            assert_eq!(mean(&lean), 0.0, "light inside is seen from {eye}, two-sided {two_sided}");
        }
    }
    let [seen, _] = both(&room(places[0], false, true), &settings, "through the open side");
    assert!(mean(&seen) > 0.0, "nothing is seen through the open side");
}

/// The one stage that changes the picture, by less than its bound: light of three edges or more, where all of it is below a hundredth of the
/// error asked for.
#[test]
fn bounces_below_the_error_asked_for_are_left_out() {
    const LAMP: f64 = 8.0;
    // The camera sees a part of one wall, where light varies smoothly: no edge adds noise.
    let scene = |rho: f64| {
        let mut room = Room::new(DVec3::new(0.2, 0.1, 0.9), DVec3::new(0.2, 0.1, 1.0), 8);
        let (wall, black) = (room.grey(rho), room.grey(0.0));
        room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [wall; 6], [0.0; 6]);
        lamp(&mut room, black, 0.9);
        room.scene()
    };
    let asked = |error: Option<f64>| {
        let mut settings = quick(64, 0.5);
        settings.budget.error = error;
        settings.image_filter = false;
        settings
    };
    let (settings, rho) = (asked(Some(0.01)), 0.01);
    let [lean, full] = [Mode::Lean, Mode::Full].map(|plan| run(scene(rho), &RenderSettings { plan, ..settings.clone() }));
    assert!(!keeps(&lean, "interreflection") && keeps(&full, "interreflection"));
    assert_eq!((lean.counts.form_factor, lean.counts.gather), (0, 0));
    assert!(full.counts.form_factor > 0 && full.counts.gather > 0);
    let missing = mean(&full) - mean(&lean);
    let bound = rho * rho * LAMP / (1.0 - rho);
    assert!(missing > 0.0 && missing < bound, "{missing:e} is missing, at most {bound:e} may be");
    let reason = &lean.plan.decisions.iter().find(|d| d.stage == "interreflection").expect("named").reason;
    assert!(reason.contains("8.1e-4") && reason.contains("6.5e-5"), "the bounds are not told: {reason}");
    // A stricter goal, none at all, and lighter walls need it; without it those would be wrong by far more than the goal.
    for (rho, error) in [(0.01, Some(1e-6)), (0.01, None), (0.5, Some(0.01))] {
        let [twin, _] = both(&scene(rho), &asked(error), &format!("rho {rho}, error {error:?}"));
        assert!(keeps(&twin, "interreflection") && twin.counts.form_factor > 0);
        if rho == 0.5 {
            let cut = run(scene(rho), &RenderSettings { max_depth: Some(Some(2)), ..asked(error) });
            assert!(mean(&cut) < 0.8 * mean(&twin), "{} and {}", mean(&cut), mean(&twin));
        }
    }
}

#[test]
fn one_light_needs_no_choice_and_two_do() {
    let mut room = lit_room(|r| r.grey(0.5));
    let [one, _] = both(&room.scene(), &quick(8, 0.5), "one lamp");
    assert_eq!(one.counts.light_choices, 0);
    let settings = RenderSettings { method: Method::Path, ..quick(4, 0.5) };
    room.point_light(DVec3::new(0.5, 0.0, 0.0), 1.0);
    let [two, _] = both(&room.scene(), &settings, "two lights");
    assert!(two.counts.light_choices > 0);
}

/// Flat walls are known beforehand; a sphere has to be asked.
#[test]
fn flat_walls_need_no_normal_and_a_sphere_does() {
    let settings = quick(16, 0.5);
    for depth in [None, Some(3), Some(2)] {
        let settings = RenderSettings { max_depth: Some(depth), ..settings.clone() };
        let [lean, full] = both(&lit_room(|r| r.grey(0.3)).scene(), &settings, "flat walls");
        assert_eq!(lean.counts.curved, 0);
        assert!(full.counts.curved > 0 && !keeps(&lean, "curvature"));
    }
    let mut room = lit_room(|r| r.grey(0.3));
    let (black, tinted) = (room.grey(0.0), Texture::Constant(Rgb::new(0.7, 0.5, 0.3)));
    let tinted = room.material(Material::Diffuse { reflectance: tinted }, true);
    // A block and a table: cuts in the floor, backs, colours.
    room.walls(DVec3::new(-0.2, -1.0, 0.0), DVec3::new(0.3, -0.4, 0.5), [tinted; 6], [0.0; 6]);
    room.quad(DVec3::new(-0.8, -0.5, -0.2), DVec3::Z * 0.6, DVec3::X * 0.5, tinted, 0.0);
    let [flat, _] = both(&room.scene(), &settings, "a block and a table");
    assert_eq!(flat.counts.curved, 0);
    room.sphere(DVec3::new(0.5, -0.6, 0.2), 0.3, black, 0.0);
    let [twin, _] = both(&room.scene(), &settings, "a sphere");
    assert!(twin.counts.curved > 0 && mean(&twin) != mean(&flat));
}

/// The hull of a room need not be a box, nor lie along the axes, nor be grey.
#[test]
fn walls_of_a_convex_room_are_met_without_the_tree() {
    for (turn, tint) in [(0.0, 1.0), (0.3, 1.0), (1.1, 0.5)] {
        let (s, c) = f64::sin_cos(turn);
        let at = |x: f64, y: f64, z: f64| DVec3::new(c * x - s * z, y, s * x + c * z);
        let mut room = Room::new(at(0.1, 0.1, -0.4), at(0.0, -0.3, 1.0), 12);
        let colour = Texture::Constant(Rgb::new(0.6, 0.6 * tint, 0.6));
        let wall = room.material(Material::Diffuse { reflectance: colour }, false);
        // A triangular prism, and a lamp that is one of its walls' neighbours in the ceiling.
        let (p, q, r) = (at(-1.0, -1.0, -0.8), at(1.0, -1.0, -0.8), at(0.0, -1.0, 1.2));
        let up = DVec3::Y * 2.0;
        room.polygon(&[p, r, q], wall, 0.0);
        room.polygon(&[p + up, q + up, r + up], wall, 2.0);
        for (a, b) in [(p, q), (q, r), (r, p)] {
            room.polygon(&[a, b, b + up, a + up], wall, 0.0);
        }
        let [lean, full] = both(&room.scene(), &quick(32, 0.3), &format!("a prism turned by {turn}"));
        assert!(lean.counts.visibility == 0 && !keeps(&lean, "visibility") && mean(&full) > 0.0);
    }
}

/// The patch by division is the patch by the tree, on borders as well; and so that it is not asked in vain, most cells know it.
#[test]
fn patches_of_flat_walls_are_found_by_division() {
    let mut room = lit_room(|r| r.grey(0.3));
    let grey = room.grey(0.4);
    room.walls(DVec3::new(-0.2, -1.0, 0.0), DVec3::new(0.31, -0.4, 0.47), [grey; 6], [0.0; 6]);
    let world = World::new(room.scene(), AccelKind::default()).expect("a world");
    let settings = PatchSettings { patch_size: Some(0.23), ..PatchSettings::default() };
    let mut patches = PatchMesh::build(&world, &settings).expect("patches");
    patches.lay_out(&world);
    let n = 92;
    for primitive in 0..world.soup().triangles.len() as u32 {
        for (u, v) in (0..=n).flat_map(|u| (0..=n - u).map(move |v| (f64::from(u) / f64::from(n), f64::from(v) / f64::from(n)))) {
            // Beside the border as well as on it.
            for u in [u, u.next_down().max(0.0), u.next_up()] {
                for wo in [Vec3::new(0.1, 0.2, 1.0), Vec3::new(-0.1, -0.2, -1.0), Vec3::new(1.0, 0.3, 0.1)] {
                    let at = world.on_triangle(primitive, (u, v), wo);
                    let found = patches.patch_on_flat(primitive, (u, v), at.front);
                    assert_eq!(found, patches.patch_at(&at), "primitive {primitive} at {u}, {v}");
                }
            }
        }
    }
}

/// Random scenes of a small grammar: a floor or a room, lamps, spheres, mirrors, glass, textures, skies.
fn random_scene(seed: u64) -> (Scene, RenderSettings) {
    let mut sampler = Sampler::new(0x9_1a4, seed, 0);
    let mut next = |n: u32| ((sampler.next_1d() * n as f32) as u32).min(n - 1);
    let mut room = Room::new(DVec3::new(0.2, 0.1, -0.85), DVec3::new(0.0, -0.3, 1.0), 5);
    let any = |room: &mut Room, k: u32| match k {
        0 => room.mirror(0.9),
        1 => room.glass(1.5),
        2 => room.material(Material::Diffuse { reflectance: spotted() }, true),
        3 => room.material(Material::Diffuse { reflectance: Texture::Constant(Rgb::new(0.7, 0.4, 0.2)) }, false),
        4 => room.grey(0.0),
        _ => room.grey(0.6),
    };
    // Some scenes have nothing but grey walls, which can be seen to part space.
    let grey_only = next(3) == 0;
    let (high, closed) = (DVec3::new(1.0, 0.7 + 0.1 * f64::from(next(4)), 1.0), next(3) > 0);
    let walls = [0; 6].map(|_| any(&mut room, if grey_only { 5 } else { [5, 5, 5, 0, 2, 3, 4][next(7) as usize] }));
    if closed {
        let glow = if next(5) == 0 { 0.3 } else { 0.0 };
        room.walls(DVec3::splat(-1.0), high, walls, [glow, 0.0, 0.0, 0.0, 0.0, 0.0]);
    } else {
        room.quad(DVec3::splat(-1.0), DVec3::Z * 2.0, DVec3::X * 2.0, walls[0], 0.0);
    }
    // A closed box within, and a lit room beside.
    if next(3) == 0 {
        let wall = room.material(Material::Diffuse { reflectance: Texture::grey(0.4) }, next(2) == 0);
        room.walls(DVec3::new(0.3, -0.8, 0.2), DVec3::new(0.7, -0.3, 0.6), [wall; 6], [0.0; 6]);
    }
    if next(3) == 0 {
        let grey = room.grey(0.5);
        room.walls(DVec3::new(1.5, -1.0, -1.0), DVec3::new(2.5, 1.0, 1.0), [grey; 6], [0.0; 6]);
        lamp_at(&mut room, DVec3::new(1.8, 0.7, 0.0), grey);
    }
    for i in 0..if grey_only { 0 } else { next(3) } {
        let material = any(&mut room, next(6));
        room.sphere(DVec3::new(f64::from(i) * 0.8 - 0.4, -0.6, 0.3), 0.3, material, if next(6) == 0 { 2.0 } else { 0.0 });
    }
    for i in 0..next(4) {
        let grey = room.grey(0.3);
        let x = f64::from(i) * 0.6 - 0.9;
        match next(3) {
            0 => room.point_light(DVec3::new(x, 0.4, 0.1), 1.0),
            _ => room.quad(DVec3::new(x, 0.6, -0.3), DVec3::X * 0.3, DVec3::Z * 0.5, grey, 5.0),
        }
    }
    if !closed {
        match next(3) {
            0 => room.source.environment = Some(Environment::Uniform(Rgb::new(0.2, 0.3, 0.5))),
            1 => {
                let irradiance = Rgb::grey(2.0);
                room.source.lights.push(LightSource::Directional { direction: DVec3::new(0.3, -1.0, 0.2), irradiance });
            }
            _ => {}
        }
    }
    let mut settings = quick(1 + next(6), 0.7);
    settings.seed = seed;
    settings.pass_one.form_factor_tolerance = 0.06;
    settings.max_depth = Some([None, None, Some(1), Some(2), Some(3)][next(5) as usize]);
    settings.method = [Method::TwoPass, Method::TwoPass, Method::TwoPassWhitted, Method::Path][next(4) as usize];
    if settings.method == Method::TwoPass && next(2) == 0 {
        settings.read_out = Some([ReadOut::Stored, ReadOut::FinalGather][next(2) as usize]);
    }
    (room.scene(), settings)
}

#[test]
fn random_scenes_look_the_same_lean_and_full() {
    let wanted = std::env::var("TWOPASS_PLAN_SCENES").ok().and_then(|n| n.parse().ok()).unwrap_or(50_u64);
    // How often each stage was left out: a grammar that never leaves one out proves nothing about it.
    let mut left_out = std::collections::BTreeMap::<&str, u32>::new();
    for seed in 0..wanted {
        let (scene, settings) = random_scene(seed);
        let [lean, full] = both(&scene, &settings, &format!("random scene {seed}"));
        let c = lean.counts;
        for d in lean.plan.decisions.iter().filter(|d| !d.kept) {
            // Closed walls count where there is something behind them.
            let is_of_walls = matches!(d.stage, "dark-surfaces" | "unseen-surfaces");
            *left_out.entry(d.stage).or_default() += u32::from(!is_of_walls || full.counts.idle > 0);
            let work = match d.stage {
                // A path goes on by reflection at diffuse surfaces, too.
                "recursion" if settings.method == Method::Path => c.lobes,
                "recursion" => c.lobes + c.reflected + c.transmitted,
                "texture-coordinates" => c.uv,
                "distant-light" => c.distant,
                "visibility" => c.visibility,
                "pass-one" => c.form_factor,
                "gather" => c.gather,
                "light-choice" => c.light_choices,
                "curvature" => c.curved,
                "light" => c.shadow + c.gather + c.form_factor,
                "dark-surfaces" | "unseen-surfaces" => c.idle,
                "shadow-rays" => c.shadow,
                _ => 0,
            };
            assert!(work == 0, "random scene {seed}: {} was left out and worked {work} times", d.stage);
        }
    }
    for stage in [
        "dark-surfaces",
        "unseen-surfaces",
        "shadow-rays",
        "recursion",
        "texture-coordinates",
        "distant-light",
        "curvature",
        "light",
        "pass-one",
        "gather",
        "three-channels",
    ] {
        assert!(left_out.get(stage).is_some_and(|n| *n > 0), "{stage} was never left out: {left_out:?}");
    }
}
