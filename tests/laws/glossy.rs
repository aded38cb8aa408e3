//! Gloss: what shadow rays, glossy rays and walks find between them, against quadrature over the lamp or the sky.

use crate::support::{Room, quick};
use glam::{DMat3, DVec3};
use std::f64::consts::PI;
use twopass::accel::AccelKind;
use twopass::form_factor::FormFactorMethod;
use twopass::integrator::{IntegratorSettings, ReadOut};
use twopass::light::Environment;
use twopass::material::plastic::Base;
use twopass::material::{Distribution, Material, Relief, ReliefMap, RoughConductor, RoughPlastic, Texture};
use twopass::math::SamplerKind;
use twopass::math::{Rgb, Vec2, Vec3};
use twopass::pipeline::probe::{Probed, Prober};
use twopass::pipeline::{Solved, StageCosts, solve_world};
use twopass::progress::silent;
use twopass::scene::Scene;
use twopass::world::{DirectSampling, EmitterPartition, World};

/// Standard errors, taken from 16 batches, that an estimate may be off: one in 40,000 exceeds them (Student's t).
const SIGMAS: f64 = 6.0;

fn metal(alpha_u: f64, alpha_v: f64) -> Material {
    let alpha = [Texture::grey(alpha_u), Texture::grey(alpha_v)];
    Material::RoughConductor(Box::new(RoughConductor::new(Distribution::Ggx, alpha, None, Texture::grey(0.9))))
}

fn coated(alpha: f64) -> Material {
    let base = Base { reflectance: Texture::grey(0.5), nonlinear: true };
    Material::RoughPlastic(Box::new(RoughPlastic::new(Distribution::Beckmann, alpha, 1.5, base, Texture::grey(1.0))))
}

/// Solves with the emitters divided by `share` of the area.
fn solved(scene: Scene, share: f64) -> Solved {
    let partition = EmitterPartition::new(&scene, share);
    let world = World::with_partition(scene, AccelKind::Obvhs, partition).expect("builds");
    solve_world(world, &quick(1, 0.5), StageCosts::default(), &mut silent).expect("solves")
}

fn prober(solved: &Solved, max_depth: Option<u32>, lights_per_point: usize, samples: u64) -> Prober<'_> {
    let direct = DirectSampling { lights_per_point, ..DirectSampling::SEEN };
    let settings = IntegratorSettings {
        read_out: ReadOut::FinalGather,
        max_depth,
        gather_rays: 4,
        direct,
        seed: 3,
        sampler: SamplerKind::Sobol,
    };
    Prober { world: &solved.world, pass_one: &solved.pass_one, settings, samples }
}

fn assert_found(name: &str, found: Probed, want: f64) {
    let (got, bound) = (found.total.g, SIGMAS * found.std_error + 1e-4 * want);
    assert!((got - want).abs() <= bound, "{name}: {got}, expected {want} within {bound}");
    // A bound that admits anything shows nothing.
    assert!(found.std_error < 0.02 * want, "{name}: standard error {} of {want}", found.std_error);
}

const EYE: DVec3 = DVec3::new(0.0, -1.0, 0.8);
/// Where the viewer looks: a point of the plane z = 0.
const SEEN: DVec3 = DVec3::new(0.1, 0.2, 0.0);
/// Middle and half sides of a lamp that hangs near the mirrored direction.
const LAMP: [DVec3; 3] = [DVec3::new(0.18, 1.2, 0.68), DVec3::new(0.25, 0.0, 0.0), DVec3::new(0.0, -0.2, 0.15)];

/// A plane of a material with its u axis turned by `turn`, and lamps side by side of radiance 5.
fn lit_plane(material: Material, turn: f64, n_lamps: usize) -> Scene {
    let mut room = Room::new(EYE, SEEN, 4);
    let (black, plane) = (room.grey(0.0), room.material(material, true));
    let (s, c) = turn.sin_cos();
    let (e1, e2) = (DVec3::new(c, s, 0.0) * 2.0, DVec3::new(-s, c, 0.0) * 2.0);
    room.quad(-(e1 + e2) / 2.0, e1, e2, plane, 0.0);
    let [middle, x, y] = LAMP;
    let part = 2.0 * x / n_lamps as f64;
    for i in 0..n_lamps {
        room.quad(middle - x - y + part * i as f64, part, 2.0 * y, black, 5.0);
    }
    room.scene()
}

/// Radiance that the plane reflects to the viewer, by the midpoint rule over the lamp.
fn reflected(material: &Material, turn: f64) -> f64 {
    const N: u32 = 400;
    let (s, c) = turn.sin_cos();
    let frame = DMat3::from_cols(DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0), DVec3::Z).transpose();
    let local = |v: DVec3| (frame * v).as_vec3();
    let [middle, x, y] = LAMP;
    let (n, area) = (x.cross(y).normalize(), 4.0 * x.cross(y).length());
    let wo = local((EYE - SEEN).normalize());
    let mut sum = 0.0;
    for i in 0..N * N {
        let at = |k: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(N) - 1.0;
        let to_lamp = middle + x * at(i % N) + y * at(i / N) - SEEN;
        let (d2, direction) = (to_lamp.length_squared(), to_lamp.normalize());
        let cos = (-direction.dot(n)).max(0.0);
        sum += material.eval(wo, local(direction), Vec2::ZERO).total().g * cos / d2;
    }
    5.0 * sum * area / f64::from(N * N)
}

#[test]
fn a_lamp_in_a_rough_surface_is_seen_as_quadrature_has_it() {
    let cases = [
        ("smooth metal", metal(0.02, 0.02)),
        ("metal", metal(0.15, 0.15)),
        ("brushed metal", metal(0.05, 0.4)),
        ("dull metal", metal(0.8, 0.8)),
        ("coat", coated(0.1)),
    ];
    for (name, material) in cases {
        for turn in [0.0, 0.5] {
            let want = reflected(&material, turn);
            for (how, share, lamps, per_point) in [("shared", 1.0, 1, 4), ("picked", 1.0, 5, 2), ("met by chance", 0.0, 1, 4)] {
                let solved = solved(lit_plane(material.clone(), turn, lamps), share);
                // Two edges: the lamp's light, reflected once.
                let samples = if share == 0.0 { 1 << 18 } else { 1 << 16 };
                let (found, _) = prober(&solved, Some(2), per_point, samples).radiance(&[(EYE, SEEN - EYE)]);
                // By chance alone a coat, of which one ray in six follows, meets the lamp too seldom to say much.
                if how != "met by chance" || found[0].std_error < 0.02 * want {
                    assert_found(&format!("{name} turned {turn}, {how}"), found[0], want);
                }
            }
        }
    }
}

/// A sky with a bright patch, dark elsewhere.
fn sky() -> Environment {
    let (width, height) = (32, 17);
    let texel = |i: usize| {
        let (x, y) = (i % width, i / width);
        [if (14..18).contains(&x) && (5..7).contains(&y) { 50.0 } else { 0.3 }; 3]
    };
    Environment::map(width, height, (0..width * height).map(texel).collect(), 1.0, DMat3::IDENTITY)
}

#[test]
fn a_surface_under_a_sky_is_lit_as_quadrature_has_it() {
    let matt = Material::Diffuse { reflectance: Texture::grey(0.7) };
    for (name, material) in [("matt", matt), ("coat", coated(0.2)), ("metal", metal(0.3, 0.3))] {
        // +y is up in the map: the plane faces it.
        let eye = DVec3::new(0.0, 1.0, -1.2);
        let mut room = Room::new(eye, DVec3::ZERO, 4);
        let plane = room.material(material.clone(), true);
        room.quad(DVec3::new(-1.0, 0.0, -1.0), DVec3::Z * 2.0, DVec3::X * 2.0, plane, 0.0);
        room.source.environment = Some(sky());
        let solved = solved(room.scene(), 1.0);
        let (found, _) = prober(&solved, None, 4, 1 << 16).radiance(&[(eye, -eye)]);
        // Local frame: u along +z, v along +x, the normal +y.
        let local = |v: Vec3| Vec3::new(v.z, v.x, v.y);
        let (wo, map) = (local(eye.normalize().as_vec3()), sky());
        let (rows, columns) = (1024, 2048);
        let mut want = 0.0;
        for i in 0..rows {
            let theta = 0.5 * PI * (f64::from(i) + 0.5) / f64::from(rows);
            for j in 0..columns {
                let phi = 2.0 * PI * (f64::from(j) + 0.5) / f64::from(columns);
                let d = DVec3::new(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos()).as_vec3();
                let f = material.eval(wo, local(d), Vec2::ZERO).total().g;
                want += f * map.radiance(d).g * theta.sin();
            }
        }
        want *= 0.5 * PI / f64::from(rows) * 2.0 * PI / f64::from(columns);
        assert_found(name, found[0], want);
    }
}

/// A lamp that a receiver sees only in a rough sheet: pass one, and gather rays in pass two, whichever way the lamp is found.
#[test]
fn light_by_way_of_gloss_is_the_same_however_it_is_found() {
    let build = || {
        let mut room = Room::new(DVec3::new(0.0, 0.0, 0.5), DVec3::ZERO, 4);
        let (black, dark, sheet) = (room.grey(0.0), room.grey(0.01), room.material(metal(0.2, 0.2), true));
        room.quad(DVec3::new(-0.5, -0.5, 0.0), DVec3::X, DVec3::Y, dark, 0.0);
        room.quad(DVec3::new(-20.0, -20.0, 2.0), DVec3::Y * 40.0, DVec3::X * 40.0, sheet, 0.0);
        room.quad(DVec3::new(-1.0, 1.5, 1.0), DVec3::X * 2.0, DVec3::Y, black, 5.0);
        room.scene()
    };
    let found = [1.0, 0.0].map(|share| {
        let solved = solved(build(), share);
        let field = &solved.pass_one.field;
        let seen = (0..field.patches.len()).filter(|i| field.patches.rho[*i].g == 0.01);
        let power: f64 = seen.map(|i| solved.pass_one.solution.irradiance[i].g * field.patches.area[i]).sum();
        let at = [(DVec3::new(0.0, 0.0, 1e-4), DVec3::Z)];
        (power, prober(&solved, None, 4, 1 << 18).irradiance(&at).0[0])
    });
    let [(power, shared), (power_by_chance, by_chance)] = found;
    let error = SIGMAS * shared.std_error.hypot(by_chance.std_error);
    let (a, b) = (shared.total.g, by_chance.total.g);
    assert!((a - b).abs() < error && error < 0.05 * a, "shared {a}, by chance {b}, bound {error}");
    // Four patches of 512 rays each, of which one in six comes to the lamp: 5 % a patch, 4 standard errors of the sum of both.
    assert!((power / power_by_chance - 1.0).abs() < 0.2, "pass one: shared {power}, by chance {power_by_chance}");
    assert!((power / a - 1.0).abs() < 0.1, "pass one has {power} over 1 m², pass two {a} at its middle");
}

/// A map that bends every normal to the same side by 30 degrees along u.
#[test]
fn a_normal_map_turns_the_surface_towards_its_texture() {
    let angle = 30.0_f64.to_radians();
    let code = Rgb::new(0.5 + 0.5 * angle.sin(), 0.5, 0.5 + 0.5 * angle.cos());
    for turn in [0.0, 1.0, 2.5] {
        let mut room = Room::new(EYE, SEEN, 4);
        let plane = room.grey(0.6);
        let map = ReliefMap::Normal { texture: Texture::Constant(code) };
        room.source.materials[plane.0 as usize].relief = Some(Relief { map, flips_invalid: false, has_shadowing: false });
        let (s, c) = f64::sin_cos(turn);
        let (e1, e2) = (DVec3::new(c, s, 0.0) * 2.0, DVec3::new(-s, c, 0.0) * 2.0);
        room.quad(-(e1 + e2) / 2.0, e1, e2, plane, 0.0);
        let sun = DVec3::new(0.3, -0.2, 1.0).normalize();
        let source = twopass::scene::LightSource::Directional { direction: -sun, irradiance: Rgb::WHITE };
        room.source.lights.push(source);
        let solved = solved(room.scene(), 1.0);
        let (found, _) = prober(&solved, Some(2), 4, 16).radiance(&[(EYE, SEEN - EYE)]);
        let bent = e1.normalize() * angle.sin() + DVec3::Z * angle.cos();
        assert_found(&format!("turned {turn}"), found[0], 0.6 / PI * bent.dot(sun));
    }
}

/// Of 100 lamps, picked by the tree, all are found at their rate: the irradiance is the sum of all.
#[test]
fn many_lamps_are_all_found() {
    let mut room = Room::new(EYE, SEEN, 4);
    let (grey, black) = (room.grey(0.5), room.grey(0.0));
    room.quad(DVec3::new(-2.0, -2.0, 0.0), DVec3::X * 4.0, DVec3::Y * 4.0, grey, 0.0);
    let (side, mut want) = (0.02, 0.0);
    for i in 0..100_u32 {
        let center = DVec3::new(f64::from(i % 10) * 0.35 - 1.6, f64::from(i / 10) * 0.35 - 1.6, 0.6 + 0.1 * f64::from(i % 7));
        let radiance = f64::from(1 + i % 13) * 20.0;
        room.quad(center - DVec3::new(side, side, 0.0) / 2.0, DVec3::Y * side, DVec3::X * side, black, radiance);
        let d = center - SEEN;
        // Small enough to be a point: side² over d² is below 2e-3.
        want += radiance * side * side * (d.normalize().z * d.normalize().z) / d.length_squared();
    }
    let solved = solved(room.scene(), 1.0);
    let (found, _) = prober(&solved, None, 4, 1 << 15).irradiance(&[(SEEN + DVec3::Z * 1e-4, DVec3::Z)]);
    let (got, error) = (found[0].direct.g, SIGMAS * found[0].std_error + 1e-3 * want);
    assert!((got - want).abs() < error && error < 0.02 * want, "{got}, expected {want} within {error}");
}

/// A closed room of no special orientation with coated walls, a table and a lamp of which both reflect: all light that is emitted is absorbed. What
/// a coat passes on falls on patches twice, and a lamp does not shine on itself; either would show as power from nowhere.
#[test]
fn a_furnished_room_with_gloss_absorbs_what_is_emitted() {
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.7);
    let mut room = Room::new(turn * DVec3::new(0.1, 0.2, 0.3), turn * DVec3::ONE, 4);
    let (coat, grey) = (room.material(coated(0.2), false), room.grey(0.5));
    let both_sides = room.material(Material::Diffuse { reflectance: Texture::grey(0.5) }, true);
    let mut quad =
        |corner: DVec3, a: DVec3, b: DVec3, material, light| room.quad(turn * corner, turn * a, turn * b, material, light);
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    for (corner, a, b) in [(DVec3::ZERO, y, z), (x, z, y), (DVec3::ZERO, z, x), (y, x, z), (DVec3::ZERO, x, y), (z, y, x)] {
        quad(corner, a, b, coat, 0.0);
    }
    let (low, x, y, z) = (DVec3::new(0.25, 0.3, 0.25), 0.5 * x, 0.05 * y, 0.4 * z);
    for (corner, a, b) in [(low, x, z), (low + y, z, x), (low, z, y), (low + x, y, z), (low, y, x), (low + z, x, y)] {
        quad(corner, a, b, grey, 0.0);
    }
    quad(DVec3::new(0.35, 0.85, 0.4), 0.6 * x, 0.6 * z, both_sides, 5.0);
    let world = |scene| World::new(scene, AccelKind::Obvhs).expect("builds");
    for (method, tolerance) in [(FormFactorMethod::Hierarchical, 2e-3), (FormFactorMethod::RayCast, 0.0222)] {
        let mut settings = quick(1, 0.2);
        (settings.pass_one.form_factors, settings.pass_one.form_factor_tolerance) = (method, tolerance);
        let solved = solve_world(world(room.scene()), &settings, StageCosts::default(), &mut silent).expect("solves");
        let power = solved.pass_one.power;
        assert!(power.escaped == 0.0 && power.emitted > 0.0, "{power:?}");
        // Direct light knows a lamp to a fiftieth of its mean on each of hundreds of patches, and rays as many know the gloss.
        assert!(power.unaccounted.abs() < POWER_KNOWN, "{}: {power:?}", method.name());
    }
}

/// Share of the emitted power that samples may leave unaccounted for.
const POWER_KNOWN: f64 = 5e-3;
