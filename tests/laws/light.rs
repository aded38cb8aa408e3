//! Light straight from emitters, and the two ways in which emitters are found.

use crate::support::{Room, quick, run};
use glam::{DVec2, DVec3};
use twopass::accel::AccelKind;
use twopass::film::Image;
use twopass::integrator::drive::Clocks;
use twopass::integrator::{IntegratorSettings, ReadOut};
use twopass::math::SamplerKind;
use twopass::pipeline::probe::Prober;
use twopass::pipeline::{RenderSettings, StageCosts, render_world, solve};
use twopass::progress::silent;
use twopass::run_report::process_cpu_seconds;
use twopass::scene::Scene;
use twopass::world::{DirectSampling, EmitterPartition, World};

const PROBE: IntegratorSettings = IntegratorSettings {
    read_out: ReadOut::FinalGather,
    max_depth: None,
    gather_rays: 4,
    direct: DirectSampling::SEEN,
    seed: 0,
    sampler: SamplerKind::Sobol,
};

fn total_irradiance(scene: Scene, points: &[(DVec3, DVec3)]) -> Vec<f64> {
    let solved = solve(scene, &quick(1, 0.5), &mut silent).expect("solves");
    let (found, _) =
        Prober { world: &solved.world, pass_one: &solved.pass_one, settings: PROBE, samples: 4096 }.irradiance(points);
    found.iter().map(|p| p.total.g).collect()
}

fn assert_close(name: &str, got: f64, want: f64, tolerance: f64) {
    assert!((got - want).abs() <= tolerance * want.abs(), "{name}: {got}, expected {want} within {tolerance}");
}

/// The picture of a scene whose emitters above a share of its area are left to gather rays.
fn divided(scene: Scene, share: f64, settings: &RenderSettings) -> Image {
    let partition = EmitterPartition::new(&scene, share);
    let world = World::with_partition(scene, AccelKind::Obvhs, partition).expect("builds");
    let clocks = Clocks::start(process_cpu_seconds);
    render_world(world, settings, &clocks, StageCosts::default(), &mut silent, &mut |_, _, _| {}).expect("renders").film.image()
}

/// CIE 171:2006 test 5.2, [physical_checks.csv cie171_5.2_A..J]: Lambertian source of 1000 cd at 3 m; E = I0 h²/d⁴. A small
/// down-facing disk of 1000 cd along its normal stands for the point; its radius of 1 cm changes the fourth digit.
#[test]
fn a_small_lambertian_lamp_follows_the_fourth_power_of_the_cosine() {
    let points =
        [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.5, 0.0), (0.5, 0.5), (1.0, 0.5), (1.5, 0.5), (1.0, 1.0), (1.5, 1.0), (1.5, 1.5)];
    let want = [
        111.111_111_111,
        105.186_267_348,
        90.0,
        71.111_111_111,
        99.722_991_69,
        85.663_295_657,
        68.052_930_057,
        74.380_165_289,
        59.975_010_412,
        49.382_716_049,
    ];
    let mut room = Room::new(DVec3::new(0.0, 0.0, 1.0), DVec3::ZERO, 4);
    let black = room.grey(0.0);
    let side = 0.02;
    let corner = DVec3::new(-side / 2.0, -side / 2.0, 3.0);
    room.quad(corner, DVec3::Y * side, DVec3::X * side, black, 1000.0 / (side * side));
    room.quad(DVec3::new(-2.0, -2.0, -1.0), DVec3::X * 4.0, DVec3::Y * 4.0, black, 0.0);
    let at: Vec<_> = points.iter().map(|&(x, y)| (DVec3::new(x, y, 0.0), DVec3::Z)).collect();
    for (i, (got, want)) in total_irradiance(room.scene(), &at).into_iter().zip(want).enumerate() {
        assert_close(&format!("5.2 point {i}"), got, want, 2e-3);
    }
}

/// CIE 171:2006 test 5.3, [physical_checks.csv cie171_5.3_A..N]: 1x1 m ceiling panel of 1000 cd/m² in a black 4x4x3 m room.
#[test]
fn a_ceiling_panel_lights_walls_and_floor_as_cie_171_says() {
    let wall = [32.676_898_014, 75.193_924_566, 81.323_172_125, 69.060_627_013, 53.403_531_108, 40.001_852_02];
    let floor = [61.424_098_538, 79.255_157_316, 95.667_276_333, 105.778_242_176];
    let mut room = Room::new(DVec3::new(1.0, 1.0, 1.0), DVec3::new(2.0, 2.0, 1.0), 4);
    let black = room.grey(0.0);
    room.walls(DVec3::ZERO, DVec3::new(4.0, 4.0, 3.0), [black; 6], [0.0; 6]);
    room.quad(DVec3::new(1.5, 1.5, 3.0 - 1e-4), DVec3::Y, DVec3::X, black, 1000.0);
    let heights = [2.75, 2.25, 1.75, 1.25, 0.75, 0.25];
    let mut at: Vec<_> = heights.iter().map(|&z| (DVec3::new(2.0, 1e-4, z), DVec3::Y)).collect();
    at.extend([0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3.25, 3.75].map(|y| (DVec3::new(2.0, y, 1e-4), DVec3::Z)));
    let want = wall.into_iter().chain(floor).chain(floor.into_iter().rev());
    for (i, (got, want)) in total_irradiance(room.scene(), &at).into_iter().zip(want).enumerate() {
        assert_close(&format!("5.3 point {i}"), got, want, 5e-3);
    }
}

/// A lamp that faces away gives exactly nothing [physical_checks.csv backface_light]: not to shadow rays, not to gather rays, not
/// to the viewer, and not by way of pass one.
#[test]
fn the_back_of_a_lamp_is_exactly_dark() {
    for target in [DVec3::ZERO, DVec3::Z * 2.0] {
        for share in [0.0, 1.0] {
            let mut room = Room::new(DVec3::new(0.0, 0.0, 1.0), target, 8);
            let reflectance = twopass::material::Texture::Constant(twopass::math::Rgb::grey(0.5));
            let grey = room.material(twopass::material::Material::Diffuse { reflectance }, true);
            room.quad(DVec3::new(-0.5, -0.5, 2.0), DVec3::X, DVec3::Y, grey, 10.0);
            room.quad(DVec3::new(-2.0, -2.0, 0.0), DVec3::X * 4.0, DVec3::Y * 4.0, grey, 0.0);
            let image = divided(room.scene(), share, &quick(4, 0.5));
            assert!(image.pixels().iter().all(|p| *p == [0.0; 3]), "towards {target}, share {share}: some pixel is lit");
        }
    }
}

/// Nine lamps, more than are sampled at each point: their irradiances add up, however unequal they are.
#[test]
fn many_lamps_give_the_sum_of_each() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, 1.0), DVec3::ZERO, 4);
    let black = room.grey(0.0);
    room.quad(DVec3::new(-9.0, -9.0, -1.0), DVec3::X * 18.0, DVec3::Y * 18.0, black, 0.0);
    let at = DVec3::new(0.3, -0.2, 0.0);
    let mut want = 0.0;
    for k in 0..9 {
        let lamp = DVec3::new(f64::from(k % 3) - 1.0, f64::from(k / 3) - 1.0, 1.0 + 0.1 * f64::from(k));
        room.point_light(lamp, f64::from(k + 1));
        let d = lamp - at;
        want += f64::from(k + 1) * d.z / d.length().powi(3);
    }
    let got = total_irradiance(room.scene(), &[(at, DVec3::Z)])[0];
    // Four of nine lamps a sample, 4096 stratified samples.
    assert_close("nine lamps", got, want, 5e-3);
}

/// A room with a lamp and a glowing wall: two emitters of different size.
fn two_emitters() -> Scene {
    let mut room = Room::new(DVec3::new(0.1, -0.2, -0.9), DVec3::new(0.0, 0.0, 1.0), 24);
    let grey = room.grey(0.6);
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [grey; 6], [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
    room.quad(DVec3::new(-0.4, 0.98, -0.4), DVec3::X * 0.8, DVec3::Z * 0.8, grey, 6.0);
    room.quad(DVec3::new(-0.2, -0.4, 0.1), DVec3::X * 0.5, DVec3::new(0.0, 0.2, 0.4), grey, 0.0);
    room.scene()
}

/// Every emitter is in exactly one set.
#[test]
fn shadow_and_gather_emitters_are_disjoint_and_complete() {
    let scene = two_emitters();
    for share in [0.0, 0.1, 1.0] {
        let partition = EmitterPartition::new(&scene, share);
        for (shape, s) in scene.shapes.iter().enumerate() {
            let listed = partition
                .shadow_lights()
                .iter()
                .filter(|&&l| matches!(&scene.lights[l], twopass::light::Light::Area(a) if a.shape as usize == shape));
            let (listed, flagged) = (listed.count(), partition.found_by_shadow_rays(shape));
            assert_eq!(listed == 1, flagged, "shape {shape} at share {share}: listed {listed} times, flagged {flagged}");
            assert!(listed <= 1 && (s.emits() || !flagged));
        }
    }
    let sizes = [0.0, 0.1, 1.0].map(|share| EmitterPartition::new(&scene, share).shadow_lights().len());
    assert_eq!(sizes, [0, 1, 2], "all gathered, one of each, all by shadow rays");
}

/// No light is counted twice and none is missed, whichever way the emitters are divided.
#[test]
fn the_picture_does_not_depend_on_how_emitters_are_divided() {
    let mean = |share: f64, read_out: ReadOut| {
        let mut settings = quick(64, 0.2);
        settings.read_out = Some(read_out);
        let image = divided(two_emitters(), share, &settings);
        image.pixels().iter().map(|p| f64::from(p[1])).sum::<f64>() / image.pixels().len() as f64
    };
    for read_out in [ReadOut::Stored, ReadOut::DirectStored, ReadOut::FinalGather] {
        let [gathered, mixed, shadow] = [0.0, 0.1, 1.0].map(|share| mean(share, read_out));
        // 576 pixels x 64 samples; counting an emitter twice, or not at all, changes the mean by tens of per cent.
        assert_close(&format!("{read_out:?}: all gathered against mixed"), gathered, mixed, 1.2e-2);
        assert_close(&format!("{read_out:?}: all by shadow rays against mixed"), shadow, mixed, 1.2e-2);
    }
}

/// pbrt's analytic scene [physical_checks.csv sphere_pointlight]: point light I = pi in the middle of a sphere of radius 1 and
/// reflectance 1/2 gives radiance 1 everywhere.
#[test]
fn a_point_light_in_a_diffuse_sphere_gives_radiance_one() {
    let mut room = Room::new(DVec3::new(0.1, 0.0, -0.3), DVec3::Z, 16);
    let grey = room.material(
        twopass::material::Material::Diffuse { reflectance: twopass::material::Texture::Constant(twopass::math::Rgb::grey(0.5)) },
        true,
    );
    room.sphere(DVec3::ZERO, 1.0, grey, 0.0);
    room.point_light(DVec3::ZERO, std::f64::consts::PI);
    for read_out in [ReadOut::Stored, ReadOut::DirectStored, ReadOut::FinalGather] {
        let mut settings = quick(4, 0.3);
        settings.read_out = Some(read_out);
        for pixel in run(room.scene(), &settings).film.image().pixels() {
            assert_close(&format!("{read_out:?}"), f64::from(pixel[0]), 1.0, 3e-3);
        }
    }
}

/// Irradiance falls with the square of the distance and the cosine, far from the lamp's own size.
#[test]
fn a_point_light_probed_obeys_the_inverse_square_law() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, 1.0), DVec3::ZERO, 4);
    let black = room.grey(0.0);
    room.quad(DVec3::new(-9.0, -9.0, -1.0), DVec3::X * 18.0, DVec3::Y * 18.0, black, 0.0);
    room.point_light(DVec3::new(0.0, 0.0, 2.0), 1.0);
    let at = [0.0, 1.0, 3.0].map(|x| (DVec3::new(x, 0.0, 0.0), DVec3::Z));
    let got = total_irradiance(room.scene(), &at);
    for ((point, _), got) in at.iter().zip(got) {
        let d2 = DVec2::new(point.x, 2.0).length_squared();
        assert_close("point light", got, 2.0 / d2.powf(1.5), 1e-5);
    }
}

/// Smoothed normals bend the shading, not the geometry: no light comes through the back of a face, however its normals lean.
#[test]
fn no_light_comes_through_the_back_of_a_face_with_bent_normals() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, 1.0), DVec3::ZERO, 8);
    let grey = room.grey(0.5);
    let mut floor = twopass::geometry::tessellate::rectangle(&glam::DAffine3::IDENTITY);
    // 60 degrees off the face: a lamp just below the horizon is well above the shading horizon.
    floor.normals = vec![glam::Vec3::new(0.75_f32.sqrt(), 0.0, 0.5); 4];
    room.add(twopass::scene::SurfaceSource::Triangles(floor), grey, 0.0);
    room.point_light(DVec3::new(3.0, 0.0, -0.5), 10.0);
    let mut settings = quick(4, 0.5);
    settings.read_out = Some(ReadOut::FinalGather);
    let image = run(room.scene(), &settings).film.image();
    assert!(image.pixels().iter().all(|p| *p == [0.0; 3]), "light from behind shows on the front");
    // The same lamp above the face does light it.
    room.source.lights.clear();
    room.point_light(DVec3::new(3.0, 0.0, 0.5), 10.0);
    let lit = run(room.scene(), &settings).film.image();
    assert!(lit.pixels().iter().any(|p| p[0] > 0.0), "nothing shows at all");
}
