//! Light of the surroundings that comes through a window: shadow rays go where the sky can be seen, and the mean stays what it is.

use crate::support::{Room, close};
use glam::{DMat3, DVec3};
use std::f64::consts::PI;
use twopass::accel::AccelKind;
use twopass::form_factor::analytic::point_to_polygon;
use twopass::light::{Environment, Light};
use twopass::math::{Sampler, Vec2, Vec3};
use twopass::world::walk::RayCounts;
use twopass::world::{All, DirectSampling, World};

/// Radiance 1 from everywhere, as a map.
fn even_sky() -> Environment {
    Environment::map(16, 9, (0..16 * 9).map(|_| [1.0_f32; 3]).collect(), 1.0, DMat3::IDENTITY)
}

const LOW: DVec3 = DVec3::new(-2.0, 0.0, -2.0);
const HIGH: DVec3 = DVec3::new(2.0, 3.0, 2.0);

/// A room with a window of 0.8 x 1 in its wall at +x, given by its corners as seen from inside, and the camera in it.
fn room() -> (World, [DVec3; 4]) {
    let mut room = Room::new(DVec3::new(-1.8, 1.5, 0.0), DVec3::new(2.0, 1.0, 0.3), 32);
    let grey = room.grey(0.5);
    let ([y0, y1], [z0, z1]) = ([1.0, 2.0], [-0.3, 0.5]);
    let (x, y, z) = (DVec3::X * 4.0, DVec3::Y * 3.0, DVec3::Z * 4.0);
    for (corner, e1, e2) in [(LOW, y, z), (LOW, z, x), (LOW + y, x, z), (LOW, x, y), (LOW + z, y, x)] {
        room.quad(corner, e1, e2, grey, 0.0);
    }
    // The wall around the window.
    let at = |y: f64, z: f64| DVec3::new(HIGH.x, y, z);
    for (low, high) in [([0.0, -2.0], [y0, 2.0]), ([y1, -2.0], [3.0, 2.0]), ([y0, -2.0], [y1, z0]), ([y0, z1], [y1, 2.0])] {
        room.quad(at(low[0], low[1]), DVec3::Z * (high[1] - low[1]), DVec3::Y * (high[0] - low[0]), grey, 0.0);
    }
    room.source.environment = Some(even_sky());
    let world = World::new(room.scene(), AccelKind::Obvhs).expect("builds");
    (world, [at(y0, z0), at(y1, z0), at(y1, z1), at(y0, z1)])
}

/// Mean and variance of single estimates at a point, with `sky_rays` shadow rays each.
fn estimates(world: &World, point: DVec3, n: DVec3, sky_rays: u32, in_passing: bool) -> (f64, f64) {
    let origin = world.scene().origin;
    let si = world.receiver_at((point - origin).as_vec3(), n.as_vec3());
    let sampling = DirectSampling { lights_per_point: 4, sky_rays, in_passing };
    let (mut sum, mut squares, count) = (0.0, 0.0, 60_000);
    for i in 0..count {
        let mut sampler = Sampler::new(11, 0, i);
        let h = world.direct_irradiance::<All>(&si, sampling, 0.0, &mut sampler, &mut RayCounts::default()).g;
        sum += h;
        squares += h * h;
    }
    let mean = sum / count as f64;
    (mean, squares / count as f64 - mean * mean)
}

#[test]
fn a_window_lights_a_room_by_its_form_factor_and_most_shadow_rays_pass_it() {
    let (world, window) = room();
    for (point, n) in [
        (DVec3::new(0.0, 0.01, 0.0), DVec3::Y),
        (DVec3::new(1.0, 0.01, -1.0), DVec3::Y),
        (DVec3::new(-1.99, 1.0, 0.4), DVec3::X),
        (DVec3::new(0.5, 1.2, 1.99), DVec3::NEG_Z),
    ] {
        let want = PI * point_to_polygon(point, n, &window);
        for sky_rays in [1, 4] {
            let (mean, variance) = estimates(&world, point, n, sky_rays, false);
            // Six standard errors of the mean, were the samples independent: they lie more evenly.
            close(&format!("irradiance at {point}"), mean, want, 6.0 * (variance / 60_000.0).sqrt() / want);
            // Drawn by radiance alone a share w of the rays passes, where w is the solid angle of the window over 4 pi, at most 0.04 here:
            // a relative variance of 1/w - 1, above 20.
            let relative = variance * f64::from(sky_rays) / (want * want);
            assert!(relative < 12.0, "{sky_rays} rays at {point}: relative variance {relative} each");
        }
    }
}

/// What a glossy lobe finds of the sky and what shadow rays find make up the whole, so their shares must rest on the same densities.
#[test]
fn directions_of_the_sky_are_found_again_in_the_square_they_were_drawn_from() {
    let texel = |i: usize| [0.05 + ((i * 7919) % 23) as f32; 3];
    let turned = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 1.1);
    for sky in [
        Environment::map(64, 33, (0..64 * 33).map(texel).collect(), 1.5, turned),
        Environment::map(4, 3, (0..12).map(texel).collect(), 1.0, DMat3::IDENTITY),
        Environment::Uniform(twopass::math::Rgb::WHITE),
    ] {
        for i in 0..2000 {
            let u = Sampler::new(3, 0, i).next_2d();
            let (direction, ..) = sky.sample(u);
            let found: Vec2 = sky.square(direction);
            let off = (found - u).abs();
            // The square goes round in x.
            let off = Vec2::new(off.x.min(1.0 - off.x), off.y);
            // Near a pole a rounding of the direction turns the azimuth by much.
            let from_pole = (turned.transpose() * direction.as_dvec3()).as_vec3().y.abs().max(direction.z.abs());
            let tolerance = 2e-4 / (1.0 - from_pole * from_pole).max(1e-3).sqrt();
            assert!(off.max_element() < tolerance, "{u} came back as {found} by {direction}");
        }
    }
}

/// The surroundings as a light know nothing of windows: the guide is what makes the difference above.
#[test]
fn without_a_guide_the_same_sky_is_drawn_evenly() {
    let light = Light::Environment(std::sync::Arc::new(even_sky()));
    let sample = light.sample(Vec3::ZERO, None, Vec2::new(0.3, 0.6)).expect("the sky shines everywhere");
    close("density", sample.pdf, 0.25 / PI, 1e-6);
}
