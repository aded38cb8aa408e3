//! What the default method gathers at few points or throws by particles, against quadrature over the emitters.

use crate::support::{Room, close, quick, run};
use glam::DVec3;
use twopass::accel::AccelKind;
use twopass::film::Film;
use twopass::geometry::Ray;
use twopass::integrator::caustic_map::{CausticMap, CausticSettings};
use twopass::integrator::irradiance_cache::FillSettings;
use twopass::integrator::{Frame, IntegratorSettings, Method, PassPlan, ReadOut, TwoPass};
use twopass::material::{Material, Texture};
use twopass::math::{SamplerKind, Vec2, Vec3};
use twopass::pipeline::{PassOneSettings, RenderSettings, StageCosts, pass_one};
use twopass::world::walk::RayCounts;
use twopass::world::{DirectSampling, EmitterPartition, World};

/// Irradiance at `p` about `n` by a quadrilateral of radiance 1 that emits to the side of `e1 x e2`: midpoints.
fn irradiance(p: DVec3, n: DVec3, corner: DVec3, e1: DVec3, e2: DVec3) -> f64 {
    const STEPS: usize = 128;
    let vector = e1.cross(e2) / (STEPS * STEPS) as f64;
    let at = |i: usize| (i as f64 + 0.5) / STEPS as f64;
    let cell = |k: usize| {
        let d = corner + e1 * at(k % STEPS) + e2 * at(k / STEPS) - p;
        let d2 = d.length_squared();
        d.dot(n).max(0.0) * (-d).dot(vector).max(0.0) / (d2 * d2)
    };
    (0..STEPS * STEPS).map(cell).sum()
}

/// Pass two without a pass one.
fn tracer(world: &World, sampler: SamplerKind) -> TwoPass<'_> {
    let settings = IntegratorSettings {
        read_out: ReadOut::FinalGather,
        max_depth: None,
        gather_rays: 4,
        direct: DirectSampling::default(),
        seed: 1,
        sampler,
    };
    TwoPass {
        world,
        field: None,
        settings,
        cache: None,
        caustics: None,
        ambient: 0.0,
        below: None,
        residual: None,
        smooth: None,
        stages: std::marker::PhantomData,
    }
}

/// A floor beside a wall that glows. The wall is so large that gather rays look for it, and nothing else is there: what is read between
/// records is the wall's irradiance, which falls by half within a distance as long as the wall is away. Without gradients, or with one of
/// them turned round, records this far apart would be off by several per cent.
#[test]
fn what_is_read_between_records_is_the_irradiance_there() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, 32);
    let (floor, wall) = (room.grey(0.5), room.grey(0.0));
    room.quad(DVec3::new(-4.0, -4.0, 0.0), DVec3::X * 8.0, DVec3::Y * 8.0, floor, 0.0);
    let (corner, e1, e2) = (DVec3::new(2.5, -6.0, 0.0), DVec3::Z * 4.0, DVec3::Y * 12.0);
    room.quad(corner, e1, e2, wall, 1.0);
    let scene = room.scene();
    let partition = EmitterPartition::new(&scene, 0.0);
    let origin = scene.origin;
    let world = World::with_partition(scene, AccelKind::Obvhs, partition).expect("builds");
    let tracer = tracer(&world, SamplerKind::Sobol);
    let fill = FillSettings {
        rays: 4096,
        accuracy: 0.25,
        by_nearest: false,
        closest: 2.0,
        farthest: 16.0,
        spacing: 1,
        most_rays: u64::MAX,
        seed: 5,
    };
    let cache = tracer.fill(&Frame::whole(32, 32), &fill, &mut RayCounts::default());
    assert!((10..400).contains(&cache.len()), "{} records", cache.len());
    let mut worst: f64 = 0.0;
    for k in 0..400 {
        let p = DVec3::new(-1.2 + 0.12 * f64::from(k % 20), -1.2 + 0.12 * f64::from(k / 20), 0.0);
        let want = irradiance(p, DVec3::Z, corner, e1, e2);
        let found = cache.read((p - origin).as_vec3(), Vec3::Z, 0).unwrap_or_else(|| panic!("no record reaches {p}"));
        assert_eq!(found.reflected.g, 0.0, "nothing reflects here");
        worst = worst.max((found.emitted.g / want - 1.0).abs());
    }
    assert!(worst < 0.03, "worst error {worst}");
}

/// A lamp beside a mirror: on the floor its particles are the light of the lamp behind the mirror, times the mirror's reflectance.
#[test]
fn particles_by_a_mirror_are_the_light_of_the_lamp_behind_it() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, 16);
    let (floor, mirror, black) = (room.grey(0.5), room.mirror(0.8), room.grey(0.0));
    room.quad(DVec3::new(-3.0, -3.0, 0.0), DVec3::X * 6.0, DVec3::Y * 6.0, floor, 0.0);
    room.quad(DVec3::new(1.0, -8.0, 0.0), DVec3::Z * 8.0, DVec3::Y * 16.0, mirror, 0.0);
    // Down-facing, and its image behind the mirror x = 1.
    let (corner, e1, e2) = (DVec3::new(-0.3, -0.2, 1.5), DVec3::Y * 0.4, DVec3::X * 0.4);
    room.quad(corner, e1, e2, black, 1.0);
    let image = (DVec3::new(2.3, -0.2, 1.5), DVec3::NEG_X * 0.4, DVec3::Y * 0.4);
    let scene = room.scene();
    let origin = scene.origin;
    let world = World::new(scene, AccelKind::Obvhs).expect("builds");
    let settings = CausticSettings { particles: 1 << 20, overlap: 200.0, seed: 3 };
    let map = CausticMap::shoot(&world, &settings, &mut RayCounts::default()).expect("a lamp and a mirror");
    for (x, y) in [(0.5, 0.0), (0.0, 0.4), (-0.8, -0.6), (0.8, 0.9)] {
        let p = DVec3::new(x, y, 0.0);
        let above = (p + DVec3::Z * 0.5 - origin).as_vec3();
        let si = world.intersect(&Ray::new(above, Vec3::NEG_Z)).expect("the floor");
        let got = map.irradiance(&si, &world.shading(&si)).g;
        let want = 0.8 * irradiance(p, DVec3::Z, image.0, image.1, image.2);
        // 200 overlapping disks of paraboloid weight: a standard error of some 8 % at one point, less in the mean.
        close(&format!("at {x}, {y}"), got, want, 0.25);
    }
    let mean = |of: &dyn Fn(DVec3) -> f64| {
        (0..900).map(|k| of(DVec3::new(-1.5 + f64::from(k % 30) * 0.07, -1.0 + f64::from(k / 30) * 0.07, 0.0))).sum::<f64>()
            / 900.0
    };
    let got = mean(&|p| {
        let si = world.intersect(&Ray::new((p + DVec3::Z * 0.5 - origin).as_vec3(), Vec3::NEG_Z)).expect("the floor");
        map.irradiance(&si, &world.shading(&si)).g
    });
    let want = mean(&|p| 0.8 * irradiance(p, DVec3::Z, image.0, image.1, image.2));
    close("mean over the floor", got, want, 0.01);
}

/// Without a mirror or glass there is nothing to throw light.
#[test]
fn without_a_mirror_there_are_no_particles() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, 16);
    let (floor, black) = (room.grey(0.5), room.grey(0.0));
    room.quad(DVec3::new(-3.0, -3.0, 0.0), DVec3::X * 6.0, DVec3::Y * 6.0, floor, 0.0);
    room.quad(DVec3::new(-0.3, -0.2, 1.5), DVec3::Y * 0.4, DVec3::X * 0.4, black, 1.0);
    let world = World::new(room.scene(), AccelKind::Obvhs).expect("builds");
    let mut counts = RayCounts::default();
    let settings = CausticSettings { particles: 1000, overlap: 10.0, seed: 3 };
    assert!(CausticMap::shoot(&world, &settings, &mut counts).is_none());
    assert_eq!(counts.particle, 0);
}

/// A lamp before nothing, turned so that its edges run across pixels: a picture of it adds up to the pixels that it covers, whether rays
/// that only look for emission join the samples or not; with three of them beside each sample its error is that of four times as many samples; and the
/// variance told is that of a ray that meets the lamp or not.
#[test]
fn glances_see_the_lamp_as_samples_do_and_oftener() {
    const SIDE: usize = 32;
    let mut room = Room::new(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, SIDE);
    let black = room.grey(0.0);
    let (sin, cos) = 0.5_f64.sin_cos();
    let (e1, e2) = (DVec3::new(cos, sin, 0.0) * 1.7, DVec3::new(-sin, cos, 0.0) * 1.3);
    room.quad(-0.5 * (e1 + e2), e1, e2, black, 1.0);
    let world = World::new(room.scene(), AccelKind::Obvhs).expect("builds");
    let tracer = tracer(&world, SamplerKind::Independent);
    let frame = Frame::whole(SIDE, SIDE);
    let n = SIDE * SIDE;
    let shot = |samples: u32, glances: u8| {
        let (none, wanted, glances) = (vec![0; n], vec![samples; n], vec![glances; n]);
        let plan = PassPlan { half: 0, taken: &none, wanted: &wanted, glanced: &none, glances: &glances };
        let (found, counts) = tracer.planned_pass(&frame, plan);
        let image: Vec<f64> = found.iter().map(|l| l.sample.radiance().g / f64::from(samples)).collect();
        let variance: Vec<f64> = found.iter().map(|l| f64::from(l.emitted) / f64::from(l.n.max(1))).collect();
        (image, variance, [counts.camera, counts.glance])
    };
    // The plane of the lamp is 4 wide in the picture.
    let covered = 1.7 * 1.3 * (SIDE * SIDE) as f64 / 16.0;
    let (exact, _, _) = shot(4096, 0);
    let error = |image: &[f64]| image.iter().zip(&exact).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    let (alone, _, camera) = shot(16, 0);
    assert_eq!(camera, [16 * n as u64, 0]);
    let (joined, variance, camera) = shot(16, 3);
    assert_eq!(camera, [16 * n as u64, 48 * n as u64]);
    for image in [&exact, &alone, &joined] {
        let sum: f64 = image.iter().sum();
        // About 110 pixels at the edges, each with a variance of at most 1/4 over 16 samples: a standard error of 1.
        assert!((sum - covered).abs() < 4.0, "the lamp covers {covered} pixels, in the picture {sum}");
    }
    let gain = error(&alone) / error(&joined);
    assert!((2.0..8.0).contains(&gain), "the squared error of 64 rays is that of 16 over {gain}, expected 4");
    let told: f64 = variance.iter().sum();
    let right: f64 = exact.iter().map(|c| c * (1.0 - c)).sum();
    assert!((told / right - 1.0).abs() < 0.15, "variances of a ray add up to {told}, expected {right}");
}

/// Strips of dark and bright floor that run across pixels, under a lamp: what pass one has stored for them, looked up along three more rays beside each
/// sample, takes most of the noise of their edges away, and the mean stays.
#[test]
fn glances_see_what_is_stored_for_the_edges_of_things() {
    const SIDE: usize = 32;
    let mut room = Room::new(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, SIDE);
    let floors = [room.grey(0.1), room.grey(0.8)];
    let black = room.grey(0.0);
    let (sin, cos) = 0.3_f64.sin_cos();
    let (along, across) = (DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0));
    for k in 0..24 {
        let corner = along * -4.0 + across * (-4.0 + f64::from(k) / 3.0);
        room.quad(corner, along * 8.0, across / 3.0, floors[k as usize % 2], 0.0);
    }
    // Seen by no camera ray, and small, so that shadow rays find little noise.
    room.quad(DVec3::new(-0.1, -0.1, 4.0), DVec3::Y * 0.2, DVec3::X * 0.2, black, 100.0);
    let world = World::new(room.scene(), AccelKind::Obvhs).expect("builds");
    let (mut watch, mut counts) = (StageCosts::default(), RayCounts::default());
    let asked = PassOneSettings::default();
    let solved = pass_one::solve(&world, &asked, 1, &mut watch, &mut counts, &mut |_| std::ops::ControlFlow::Continue(()));
    let solved = solved.expect("solves");
    let mut tracer = tracer(&world, SamplerKind::Independent);
    (tracer.field, tracer.settings.read_out) = (Some(&solved.field), ReadOut::DirectStored);
    let frame = Frame::whole(SIDE, SIDE);
    let n = SIDE * SIDE;
    let shot = |samples: u32, glances: u8, is_controlled: bool| {
        let mut film = Film::new(SIDE, SIDE).controlled(is_controlled);
        for half in 0..2 {
            let (none, wanted, glances) = (vec![0; n], vec![samples; n], vec![glances; n]);
            let plan = PassPlan { half, taken: &none, wanted: &wanted, glanced: &none, glances: &glances };
            let samples: Vec<_> = tracer.planned_pass(&frame, plan).0.iter().map(|looked| looked.sample).collect();
            film.add_pass(half, &samples);
        }
        film.image().pixels().iter().map(|p| f64::from(p[1])).collect::<Vec<f64>>()
    };
    let exact = shot(1024, 0, false);
    let error = |image: &[f64]| image.iter().zip(&exact).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    let (alone, joined) = (shot(2, 3, false), shot(2, 3, true));
    // Four rays for one leave a quarter of the noise of edges, which is nearly all.
    let gain = error(&alone) / error(&joined);
    assert!((2.5..5.0).contains(&gain), "the squared error with what is stored is that without over {gain}, expected nearly 4");
    let sums: Vec<f64> = [&alone, &joined, &exact].map(|image| image.iter().sum()).to_vec();
    let standard_error = error(&joined).sqrt();
    assert!((sums[1] - sums[2]).abs() < 4.0 * standard_error, "{sums:?}, standard error {standard_error}");
}

/// A fence on a floor, a low lamp before it and nothing above, or a black roof: behind it is exactly no light, and path tracing finds none.
/// Records are placed so far apart that those before the fence reach across its foot, and do not hold there; so next to nothing gets behind
/// it.
#[test]
fn records_do_not_hold_beyond_a_fence() {
    for (turn, roof) in [(0.0, false), (0.35, false), (0.0, true), (0.35, true)] {
        let mut room = Room::new(DVec3::new(0.0, if roof { 1.5 } else { 4.0 }, 0.01), DVec3::ZERO, 64);
        let matte = room.material(Material::Diffuse { reflectance: Texture::grey(0.8) }, true);
        let black = room.grey(0.0);
        room.quad(DVec3::new(-2.5, 0.0, -2.5), DVec3::Z * 5.0, DVec3::X * 5.0, matte, 0.0);
        let (along, across) = (DVec3::new(turn, 0.0, 1.0).normalize(), DVec3::new(1.0, 0.0, -turn).normalize());
        room.quad(-5.0 * along, 10.0 * along, DVec3::Y * 0.4, matte, 0.0);
        room.quad(-1.5 * across + DVec3::Y * 0.05 - along, 2.0 * along, DVec3::Y * 0.2, black, 5.0);
        room.quad(-1.5 * across + DVec3::Y * 0.05 - along, DVec3::Y * 0.2, 2.0 * along, black, 5.0);
        if roof {
            room.quad(DVec3::new(-2.5, 1.6, -2.5), DVec3::X * 5.0, DVec3::Z * 5.0, black, 0.0);
        }
        let (eye, axis) = (room.scene().camera, across);
        // Sums of what is before and behind, away from the fence itself, which the camera sees edge on.
        let sides = |method: Method| {
            let film = run(room.scene(), &RenderSettings { method, ..quick(2, 0.25) }).film;
            let image = film.image();
            let [mut before, mut behind] = [0.0; 2];
            for (i, pixel) in image.pixels().iter().enumerate() {
                let middle = Vec2::new((i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5);
                let ray = eye.ray(middle, 64, 64);
                let at = (ray.origin + ray.direction * (-ray.origin.y / ray.direction.y)).as_dvec3().dot(axis);
                if at < -0.1 {
                    before += f64::from(pixel[1]);
                } else if at > 0.1 {
                    behind += f64::from(pixel[1]);
                }
            }
            (before, behind)
        };
        let (_, nothing) = sides(Method::Path);
        assert_eq!(nothing, 0.0, "behind the fence is no light");
        let (before, behind) = sides(Method::IrradianceCache);
        println!("turned by {turn}, roof {roof}: {behind} behind, {before} before, {:.4} %", 100.0 * behind / before);
        assert!(behind < 1e-3 * before, "turned by {turn}, roof {roof}: {behind} behind the fence, {before} before it");
    }
}
