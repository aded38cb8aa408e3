//! Mirrors and glass: Kr and Kt against closed forms.

use crate::support::{Room, quick, run};
use glam::{DMat3, DVec3};
use twopass::accel::AccelKind;
use twopass::geometry::{Ray, tessellate};
use twopass::integrator::{IntegratorSettings, ReadOut};
use twopass::math::{DAffine3, Sampler, SamplerKind};
use twopass::pipeline::probe::Prober;
use twopass::pipeline::solve;
use twopass::progress::silent;
use twopass::scene::{Scene, SurfaceSource};
use twopass::world::{DirectSampling, World};

const PROBE: IntegratorSettings = IntegratorSettings {
    read_out: ReadOut::FinalGather,
    max_depth: None,
    gather_rays: 4,
    direct: DirectSampling::SEEN,
    seed: 2,
    sampler: SamplerKind::Sobol,
};

fn radiance(scene: Scene, max_depth: Option<u32>, from: DVec3, direction: DVec3, samples: u64) -> f64 {
    let settings = IntegratorSettings {
        read_out: ReadOut::FinalGather,
        max_depth,
        gather_rays: 4,
        direct: DirectSampling::SEEN,
        seed: 1,
        sampler: SamplerKind::Sobol,
    };
    let solved = solve(scene, &quick(1, 20.0), &mut silent).expect("solves");
    let (found, _) =
        Prober { world: &solved.world, pass_one: &solved.pass_one, settings, samples }.radiance(&[(from, direction)]);
    found[0].total.g
}

fn assert_close(name: &str, got: f64, want: f64, tolerance: f64) {
    assert!((got - want).abs() <= tolerance * want.abs(), "{name}: {got}, expected {want} within {tolerance}");
}

/// Two facing mirrors of reflectance rho, the second emits 1: towards the first one sees rho/(1 - rho²) [physical_checks.csv].
fn facing_mirrors(rho: f64) -> Scene {
    let mut room = Room::new(DVec3::ZERO, DVec3::Z, 4);
    let mirror = room.mirror(rho);
    room.quad(DVec3::new(-50.0, -50.0, 1.0), DVec3::Y * 100.0, DVec3::X * 100.0, mirror, 0.0);
    room.quad(DVec3::new(-50.0, -50.0, -1.0), DVec3::X * 100.0, DVec3::Y * 100.0, mirror, 1.0);
    room.scene()
}

#[test]
fn facing_mirrors_sum_the_geometric_series() {
    // The first terms are deterministic: each further pair of edges adds one.
    for (edges, want) in [(2, 0.9), (4, 1.629), (6, 2.219_49), (8, 2.697_786_9)] {
        // An odd number of edges ends at the mirror that does not shine.
        for edges in [edges, edges + 1] {
            let got = radiance(facing_mirrors(0.9), Some(edges), DVec3::ZERO, DVec3::Z, 16);
            assert_close(&format!("{edges} edges"), got, want, 1e-6);
        }
    }
    for (rho, want, tolerance) in [(0.5, 0.666_667, 1e-3), (0.9, 4.736_842, 1e-2)] {
        let got = radiance(facing_mirrors(rho), None, DVec3::ZERO, DVec3::Z, 65_536);
        assert_close(&format!("rho {rho}"), got, want, tolerance);
    }
}

/// A slab of n = 1.5 between the viewer and a lamp that fills the other side.
fn slab() -> Scene {
    let mut room = Room::new(DVec3::ZERO, DVec3::Z, 4);
    let (glass, black) = (room.glass(1.5), room.grey(0.0));
    let (x, y) = (DVec3::X * 400.0, DVec3::Y * 400.0);
    room.quad(DVec3::new(-200.0, -200.0, 1.0), y, x, glass, 0.0);
    room.quad(DVec3::new(-200.0, -200.0, 1.1), x, y, glass, 0.0);
    room.quad(DVec3::new(-200.0, -200.0, 2.0), y, x, black, 1.0);
    room.scene()
}

/// [physical_checks.csv slab_*]: the transmittance of a plate with all reflections inside is (1 - R)/(1 + R).
#[test]
fn a_slab_transmits_what_fresnel_says() {
    let table = [(0.0, 0.923_077), (30.0, 0.920_266), (45.0, 0.904_327), (60.0, 0.836_232), (75.0, 0.596_092), (80.0, 0.441_229)];
    for (degrees, want) in table {
        let (s, c) = f64::to_radians(degrees).sin_cos();
        let got = radiance(slab(), None, DVec3::ZERO, DVec3::new(s, 0.0, c), 65_536);
        assert_close(&format!("{degrees} degrees"), got, want, 1e-3);
    }
}

/// [physical_checks.csv slab_80_trips_*]: without any round trip inside, only (1 - R)² passes.
#[test]
fn a_slab_cut_to_three_edges_passes_the_first_term_only() {
    let (s, c) = f64::to_radians(80.0).sin_cos();
    let direction = DVec3::new(s, 0.0, c);
    assert_close("no round trip", radiance(slab(), Some(3), DVec3::ZERO, direction, 64), 0.374_906, 2e-5);
    // One round trip is two edges more; its branch lies below the depth of full branching and is chosen at random.
    assert_close("one round trip", radiance(slab(), Some(5), DVec3::ZERO, direction, 65_536), 0.431_260, 1e-3);
}

/// From inside glass a lamp outside looks n² times as bright, less what the boundary reflects.
#[test]
fn radiance_grows_with_n_squared_inside_glass() {
    let mut room = Room::new(DVec3::ZERO, DVec3::Z, 4);
    let (glass, black) = (room.glass(1.5), room.grey(0.0));
    let (x, y) = (DVec3::X * 400.0, DVec3::Y * 400.0);
    // The boundary's normal points away from the viewer, who is inside.
    room.quad(DVec3::new(-200.0, -200.0, 1.0), x, y, glass, 0.0);
    room.quad(DVec3::new(-200.0, -200.0, 2.0), y, x, black, 1.0);
    let scene = room.scene();
    // At 30 degrees inside it leaves at 48.59; R = (R_s + R_p)/2 there by Fresnel's equations.
    for (degrees, r) in [(0.0_f64, 0.04), (30.0, 0.055_190_2)] {
        let (s, c) = degrees.to_radians().sin_cos();
        let got = radiance(scene.clone(), None, DVec3::ZERO, DVec3::new(s, 0.0, c), 16);
        assert_close(&format!("{degrees} degrees inside"), got, 2.25 * (1.0 - r), 1e-4);
    }
}

/// Glass in a uniform enclosure is invisible: refraction, total reflection and the n² scaling cancel.
#[test]
fn a_glass_ball_vanishes_in_the_furnace() {
    let mut room = crate::support::furnace(0.5);
    let glass = room.glass(1.5);
    room.sphere(DVec3::new(0.1, 0.0, 0.2), 0.4, glass, 0.0);
    let mut settings = quick(64, 0.25);
    settings.read_out = Some(ReadOut::FinalGather);
    let image = run(room.scene(), &settings).film.image();
    let mean = image.pixels().iter().map(|p| f64::from(p[1])).sum::<f64>() / image.pixels().len() as f64;
    assert_close("mean", mean, 2.0, 2e-3);
    // Nothing is random but the choice of a lobe deep inside the ball.
    for pixel in image.pixels() {
        assert_close("pixel", f64::from(pixel[1]), 2.0, 2e-2);
    }
}

/// A perfect mirror doubles the room: the picture in it equals that of the mirrored copy.
#[test]
fn a_mirror_shows_the_mirrored_scene() {
    let lamp = DVec3::new(0.3, 0.4, 1.5);
    let build = |mirrored: bool| {
        let mut room = Room::new(DVec3::ZERO, DVec3::Z, 16);
        let (black, mirror) = (room.grey(0.0), room.mirror(1.0));
        if mirrored {
            // The lamp's reflection in the plane z = 4.
            room.sphere(DVec3::new(lamp.x, lamp.y, 8.0 - lamp.z), 0.5, black, 3.0);
        } else {
            room.quad(DVec3::new(-50.0, -50.0, 4.0), DVec3::Y * 100.0, DVec3::X * 100.0, mirror, 0.0);
            room.sphere(DVec3::new(lamp.x, lamp.y, lamp.z), 0.5, black, 3.0);
        }
        room.scene()
    };
    // Look past the lamp itself, at the mirror only.
    let direction = (DVec3::new(lamp.x, lamp.y, 8.0 - lamp.z) - DVec3::new(-1.0, -1.0, 0.0)).normalize();
    let [seen, copy] = [false, true].map(|m| radiance(build(m), None, DVec3::new(-1.0, -1.0, 0.0), direction, 16));
    assert_eq!((seen, copy), (3.0, 3.0));
}

/// Light that reaches a wall only by a mirror is known to pass one and is gathered in pass two.
#[test]
fn light_by_way_of_a_mirror_is_found_by_both_passes() {
    // The lamp faces a mirror; the receiver sees the lamp's image at twice the distance, undimmed.
    let build = |with_mirror: bool| {
        let mut room = Room::new(DVec3::new(0.0, 0.0, 0.5), DVec3::ZERO, 4);
        // Nearly black: what the receiver itself reflects would come back by the mirror.
        let (black, grey, mirror) = (room.grey(0.0), room.grey(0.01), room.mirror(1.0));
        room.quad(DVec3::new(-0.5, -0.5, 0.0), DVec3::X, DVec3::Y, grey, 0.0);
        if with_mirror {
            room.quad(DVec3::new(-20.0, -20.0, 2.0), DVec3::Y * 40.0, DVec3::X * 40.0, mirror, 0.0);
            room.quad(DVec3::new(-1.0, 1.5, 1.0), DVec3::X * 2.0, DVec3::Y, black, 5.0);
        } else {
            room.quad(DVec3::new(-1.0, 1.5, 3.0), DVec3::Y, DVec3::X * 2.0, black, 5.0);
        }
        room.scene()
    };
    let at = [(DVec3::new(0.0, 0.0, 1e-4), DVec3::Z)];
    let probed = |scene| {
        let mut quick = quick(1, 0.25);
        quick.pass_one.form_factor_tolerance = 0.01;
        let solved = solve(scene, &quick, &mut silent).expect("solves");
        let stored = (0..solved.pass_one.field.patches.len())
            .filter(|i| solved.pass_one.field.patches.rho[*i].g == 0.01)
            .map(|i| solved.pass_one.solution.irradiance[i].g * solved.pass_one.field.patches.area[i])
            .sum::<f64>();
        let (found, _) =
            Prober { world: &solved.world, pass_one: &solved.pass_one, settings: PROBE, samples: 262_144 }.irradiance(&at);
        (stored, found[0].total.g)
    };
    let ((stored, gathered), (stored_image, direct)) = (probed(build(true)), probed(build(false)));
    assert_close("pass one", stored, stored_image, 2e-2);
    assert_close("pass two", gathered, direct, 1e-2);
}

/// A thin plate does not bend light, so shadow rays pass it: a lamp behind it is found, dimmed by (1 - R)/(1 + R), and found once,
/// whichever way the emitters are divided.
#[test]
fn light_through_a_thin_plate_is_found_once() {
    use twopass::pipeline::{StageCosts, solve_world};
    let build = |with_plate: bool| {
        let mut room = Room::new(DVec3::new(0.0, 0.0, 0.5), DVec3::ZERO, 4);
        let (black, grey) = (room.grey(0.0), room.grey(0.01));
        let (reflectance, transmittance) = (twopass::material::Texture::grey(1.0), twopass::material::Texture::grey(1.0));
        let plate = room.material(twopass::material::Material::ThinDielectric { eta: 1.5, reflectance, transmittance }, true);
        room.quad(DVec3::new(-0.5, -0.5, 0.0), DVec3::X, DVec3::Y, grey, 0.0);
        if with_plate {
            room.quad(DVec3::new(-5.0, -5.0, 1.0), DVec3::X * 10.0, DVec3::Y * 10.0, plate, 0.0);
        }
        room.quad(DVec3::new(-0.5, -0.5, 5.0), DVec3::Y, DVec3::X, black, 5.0);
        room.scene()
    };
    let at = [(DVec3::new(0.0, 0.0, 1e-4), DVec3::Z)];
    let probed = |scene: Scene, share: f64| {
        let partition = twopass::world::EmitterPartition::new(&scene, share);
        let world = twopass::world::World::with_partition(scene, twopass::accel::AccelKind::Obvhs, partition).expect("builds");
        let solved = solve_world(world, &quick(1, 0.25), StageCosts::default(), &mut silent).expect("solves");
        let stored = solved.pass_one.solution.irradiance.iter().zip(&solved.pass_one.field.patches.rho);
        let stored: f64 = stored.filter(|(_, rho)| rho.g == 0.01).map(|(h, _)| h.g).sum();
        let (found, _) =
            Prober { world: &solved.world, pass_one: &solved.pass_one, settings: PROBE, samples: 262_144 }.irradiance(&at);
        (found[0].total.g, stored)
    };
    let (free, _) = probed(build(false), 1.0);
    let (by_shadow_rays, stored_by_shadow_rays) = probed(build(true), 1.0);
    let (gathered, stored_gathered) = probed(build(true), 0.0);
    // The lamp is seen within 6 degrees of the normal, where the plate passes 0.9231 to four digits.
    assert_close("by shadow rays", by_shadow_rays / free, 0.923_08, 2e-3);
    assert_close("gathered", gathered / free, 0.923_08, 3e-2);
    // The gathered one rests on some 200 rays that meet the lamp: three standard errors.
    assert_close("stored", stored_gathered, stored_by_shadow_rays, 0.21);
}

/// A gather ray between facing mirrors goes on by roulette; its mean is the whole series all the same.
#[test]
fn long_chains_of_gather_rays_keep_their_mean() {
    let rho = 0.9;
    let mut room = Room::new(DVec3::ZERO, DVec3::Z, 4);
    let mirror = room.mirror(rho);
    room.quad(DVec3::new(-500.0, -500.0, 1.0), DVec3::Y * 1000.0, DVec3::X * 1000.0, mirror, 0.0);
    room.quad(DVec3::new(-500.0, -500.0, -1.0), DVec3::X * 1000.0, DVec3::Y * 1000.0, mirror, 1.0);
    let partition = twopass::world::EmitterPartition::new(&room.scene(), 0.0);
    let world = twopass::world::World::with_partition(room.scene(), twopass::accel::AccelKind::Obvhs, partition).expect("builds");
    let solved = twopass::pipeline::solve_world(world, &quick(1, 20.0), twopass::pipeline::StageCosts::default(), &mut silent);
    let solved = solved.expect("solves");
    let at = [(DVec3::ZERO, DVec3::Z)];
    let (found, _) =
        Prober { world: &solved.world, pass_one: &solved.pass_one, settings: PROBE, samples: 65_536 }.irradiance(&at);
    // Radiance rho/(1 - rho²) from every direction of the hemisphere; a few grazing rays leave the mirrors.
    assert_close("irradiance", found[0].total.g, std::f64::consts::PI * rho / (1.0 - rho * rho), 1.5e-2);
}

/// In a closed block every ray that leaves a wall to the inside meets another, also from points where walls meet: a ray
/// that starts beyond the
/// wall beside its own would leave the block, and light that is trapped in glass with it.
#[test]
fn no_ray_leaves_a_closed_block_through_an_edge() {
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.7);
    for (name, to_world) in [
        ("cube", DAffine3::IDENTITY),
        ("turned", DAffine3::from_quat(turn)),
        ("aside", DAffine3::from_translation(DVec3::new(7.3, -2.1, 0.4))),
        ("flat", DAffine3::from_quat(turn) * DAffine3::from_scale(DVec3::new(1.0, 0.1, 1.0))),
        // Edges of 27 degrees.
        ("sharp", DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::new(0.9, 0.45, 0.0), DVec3::Z))),
    ] {
        let mut room = Room::new(DVec3::new(0.0, 0.0, -30.0), DVec3::ZERO, 4);
        let grey = room.grey(0.5);
        // A large wall far away, as scenes have around a block: what is rounded goes with coordinates.
        room.quad(DVec3::new(-20.0, -20.0, 20.0), DVec3::Y * 40.0, DVec3::X * 40.0, grey, 0.0);
        room.add(SurfaceSource::Triangles(tessellate::cube(&to_world)), grey, 0.0);
        let world = World::new(room.scene(), AccelKind::Obvhs).expect("a world");
        let origin = world.scene().origin;
        let at = |p: [f64; 3]| to_world.transform_point3(DVec3::from(p)) - origin;
        let (mut rays, mut lost) = (0, 0);
        for index in 0..20_000 {
            let mut random = Sampler::new(1, 5, index);
            let mut next = || 2.0 * f64::from(random.next_1d()) - 1.0;
            let from = at([next(), next(), next()].map(|x| 0.9 * x));
            // A point of an edge, or nearly, every eighth time of a corner.
            let mut target = [next(), next(), next()];
            let axis = index as usize % 3;
            [1, 2]
                .into_iter()
                .for_each(|k| target[(axis + k) % 3] = target[(axis + k) % 3].signum() * (1.0 - 1e-8 * next().abs()));
            if index % 8 == 0 {
                target[axis] = target[axis].signum();
            }
            let mut ray = Ray::new(from.as_vec3(), (at(target) - from).as_vec3().normalize());
            for _ in 0..8 {
                rays += 1;
                // The far wall stands behind all.
                let Some(si) = world.intersect(&ray).filter(|si| si.shape == 1 && !si.front) else {
                    lost += 1;
                    break;
                };
                ray = si.spawn((ray.direction - 2.0 * ray.direction.dot(si.ng) * si.ng).normalize());
            }
        }
        assert!(rays > 100_000 && lost == 0, "{name}: {lost} of {rays} rays leave");
    }
}
