//! Lights without a scene around them: closed forms, densities that integrate to one, samples that follow their density.

use crate::support::{assert_chi2, close};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use twopass::geometry::Mesh;
use twopass::light::{AreaLight, DirectionalLight, Emitter, Environment, Light, LightHit, SpotLight};
use twopass::material::Texture;
use twopass::material::texture::{Bitmap, Filter, Wrap};
use twopass::math::{DMat3, DVec2, DVec3, Rgb, Sampler, Vec2, Vec3};

/// A direction by polar angle from +y and azimuth from -z towards +x, the axes of a map.
fn towards(theta: f64, phi: f64) -> DVec3 {
    DVec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin())
}

/// Midpoints of `n` x `2n` cells of the sphere, each with its solid angle: a quadrature that knows nothing of the map.
fn sphere_grid(n: usize) -> impl Iterator<Item = (DVec3, f64)> {
    let step = PI / n as f64;
    (0..2 * n * n).map(move |k| {
        let (i, j) = (k / (2 * n), k % (2 * n));
        let (low, high) = (step * i as f64, step * (i + 1) as f64);
        (towards(0.5 * (low + high), step * (j as f64 + 0.5)), (low.cos() - high.cos()) * step)
    })
}

/// A map of odd values over four decades, with a black stretch and a dark pole.
fn uneven_map(width: usize, height: usize, to_scene: DMat3) -> Environment {
    let texels: Vec<[f32; 3]> = (0..width * height)
        .map(|k| {
            let u = Sampler::new(5, k as u64, 0).next_2d();
            let value = if k % width < width / 4 || k / width == 0 { 0.0 } else { 10.0_f32.powf(4.0 * u.x - 2.0) };
            [value, value * u.y, value * (1.0 - u.y)]
        })
        .collect();
    Environment::map(width, height, texels.into(), 1.5, to_scene)
}

fn rotations() -> [DMat3; 3] {
    let turned = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 1.1);
    [DMat3::IDENTITY, turned, turned * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))]
}

/// Up is +y; the middle column of the image looks at +z, the seam at -z; columns grow towards -x from there.
#[test]
fn an_environment_map_is_oriented_as_mitsuba_has_it() {
    // 4 columns centred at u = 1/8, 3/8, 5/8, 7/8 of a turn from -z towards +x; 3 rows: zenith, horizon, nadir.
    let texels: Vec<[f32; 3]> = (0..12).map(|i| [i as f32; 3]).collect();
    let map = Environment::map(4, 3, texels.into(), 1.0, DMat3::IDENTITY);
    let diagonal = 0.5_f32.sqrt();
    for (direction, want) in [
        (Vec3::new(diagonal, 0.0, -diagonal), 4.0),
        (Vec3::new(diagonal, 0.0, diagonal), 5.0),
        (Vec3::new(-diagonal, 0.0, diagonal), 6.0),
        (Vec3::new(-diagonal, 0.0, -diagonal), 7.0),
        (Vec3::Z, 5.5),
        (Vec3::NEG_Z, 5.5),
        (Vec3::X, 4.5),
        // Halfway to the zenith between columns 0 and 1 (rows 0 and 1), and to the nadir.
        (Vec3::new(diagonal, diagonal, 0.0), 2.5),
        (Vec3::new(diagonal, -diagonal, 0.0), 6.5),
    ] {
        close(&format!("radiance from {direction}"), map.radiance(direction).g, want, 1e-6);
    }
    // What the map has at +x is seen at R +x.
    for rotation in rotations() {
        let texels: Vec<[f32; 3]> = (0..12).map(|i| [i as f32; 3]).collect();
        let map = Environment::map(4, 3, texels.into(), 1.0, rotation);
        close("a turned map", map.radiance((rotation * DVec3::X).as_vec3()).r, 4.5, 1e-5);
    }
}

/// The density of directions integrates to one over the sphere, and is positive wherever there is light.
#[test]
fn the_density_of_an_environment_map_integrates_to_one() {
    for to_scene in rotations() {
        let map = uneven_map(12, 7, to_scene);
        let integral: f64 = sphere_grid(600).map(|(d, solid)| map.pdf(d.as_vec3()) * solid).sum();
        close("integral of the density", integral, 1.0, 1e-5);
        for (d, _) in sphere_grid(40) {
            let d = d.as_vec3();
            assert_eq!(map.radiance(d).is_black(), map.pdf(d) == 0.0, "at {d}");
        }
    }
    // So does the mean, by the same independent quadrature.
    let map = uneven_map(12, 7, rotations()[1]);
    let mean: Rgb = sphere_grid(600).map(|(d, solid)| map.radiance(d.as_vec3()) * (solid / (4.0 * PI))).sum();
    for channel in 0..3 {
        close("mean radiance", map.mean()[channel], mean[channel], 1e-5);
    }
}

/// Samples fall as their density says, and each carries its own density.
#[test]
fn directions_to_an_environment_map_follow_its_density() {
    for to_scene in rotations() {
        let map = uneven_map(12, 7, to_scene);
        // Cells that do not line up with the texels, counted in scene coordinates.
        let (rows, columns, n) = (11, 17, 200_000_u32);
        let cell = |d: DVec3| {
            let row = (d.y.clamp(-1.0, 1.0).acos() / PI * rows as f64) as usize;
            let column = (d.x.atan2(-d.z).rem_euclid(TAU) / TAU * columns as f64) as usize;
            row.min(rows - 1) * columns + column.min(columns - 1)
        };
        let mut expected = vec![0.0; rows * columns];
        sphere_grid(1000).for_each(|(d, solid)| expected[cell(d)] += map.pdf(d.as_vec3()) * solid * f64::from(n));
        let mut counts = vec![0; rows * columns];
        for i in 0..n {
            // Independent points: chi² asks for no stratification.
            let (direction, radiance, pdf) = map.sample(Sampler::new(11, u64::from(i), 0).next_2d());
            assert_eq!((radiance, pdf), (map.radiance(direction), map.pdf(direction)));
            assert!((direction.length() - 1.0).abs() < 1e-6);
            counts[cell(direction.as_dvec3())] += 1;
        }
        assert_chi2("directions to a map", &counts, &expected);
    }
}

fn irradiance(light: &Light, point: Vec3, n: Vec3, samples: u64) -> Rgb {
    let one = |i: u64| {
        let sample = light.sample(point, Some(n), Sampler::new(3, 1, i).next_2d())?;
        Some(sample.irradiance * f64::from(sample.direction.dot(n)).max(0.0))
    };
    (0..samples).filter_map(one).sum::<Rgb>() / samples as f64
}

/// Irradiance of a tilted receiver against a quadrature of the map.
#[test]
fn a_tilted_receiver_under_a_map_gets_what_quadrature_says() {
    for to_scene in rotations() {
        let map = Arc::new(uneven_map(12, 7, to_scene));
        let light = Light::Environment(Arc::clone(&map));
        for n in [DVec3::Y, DVec3::new(0.3, 0.2, -0.9).normalize(), DVec3::new(-0.8, -0.5, 0.1).normalize()] {
            let want: Rgb = sphere_grid(400).map(|(d, solid)| map.radiance(d.as_vec3()) * (d.dot(n).max(0.0) * solid)).sum();
            let got = irradiance(&light, Vec3::ZERO, n.as_vec3(), 1 << 14);
            for channel in 0..3 {
                close(&format!("irradiance about {n}, channel {channel}"), got[channel], want[channel], 5e-3);
            }
        }
    }
}

/// [physical_checks.csv env_tilt_*]: L = 1 over the upper half of the sky gives pi (1 + cos b)/2 at tilt b; here the lower half is black, so the
/// map itself must be right side up.
#[test]
fn half_a_sky_on_a_tilted_receiver_has_its_closed_form() {
    // Row r of 4095 lies at theta = pi r/4094: black from just below the horizon. Half of the soft edge is above the middle.
    let (width, height) = (4, 4095);
    let row = |r: usize| match r {
        0..2047 => 1.0,
        2047 => 0.5,
        _ => 0.0,
    };
    let texels: Vec<[f32; 3]> = (0..width * height).map(|k| [row(k / width); 3]).collect();
    let light = Light::Environment(Arc::new(Environment::map(width, height, texels.into(), 1.0, DMat3::IDENTITY)));
    for degrees in [0.0_f32, 45.0, 90.0, 135.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let want = 0.5 * PI * (1.0 + f64::from(cos));
        let got = irradiance(&light, Vec3::ZERO, Vec3::new(0.0, cos, sin), 1 << 14);
        close(&format!("tilt {degrees}"), got.g, want, 2e-3);
    }
    assert!(irradiance(&light, Vec3::ZERO, Vec3::NEG_Y, 1 << 10).g < 2e-4, "a receiver that looks down");
}

/// Mitsuba's fall-off is linear in the angle; irradiance on the axis is I/d², and the power is the integral of the intensity.
#[test]
fn a_spot_has_its_closed_forms() {
    let (cutoff, beam_width) = (40.0_f64.to_radians(), 25.0_f64.to_radians());
    let axis = DVec3::new(0.0, 0.0, -1.0);
    let light = SpotLight { position: Vec3::new(0.0, 0.0, 2.0), axis, intensity: Rgb::grey(8.0), cutoff, beam_width };
    for (degrees, share) in [(0.0_f64, 1.0), (24.9, 1.0), (31.0, 0.6), (38.5, 0.1), (40.1, 0.0), (89.0, 0.0)] {
        let a = degrees.to_radians();
        let point = Vec3::new((2.0 * a.tan()) as f32, 0.0, 0.0);
        let got = Light::Spot(light).sample(point, None, Vec2::ZERO).map_or(0.0, |s| s.irradiance.g * f64::from(s.direction.z));
        // I share cos³/h² on the plane at height h below.
        let want = 8.0 * share * a.cos().powi(3) / 4.0;
        assert!((got - want).abs() < 1e-5, "{degrees} degrees: {got}, expected {want}");
    }
    for (cutoff, beam_width) in [(40.0_f64, 25.0_f64), (20.0, 15.0), (90.0, 0.0), (180.0, 170.0), (30.0, 30.0)] {
        let light = SpotLight { cutoff: cutoff.to_radians(), beam_width: beam_width.to_radians(), ..light };
        let n = 200_000;
        let step = PI / f64::from(n);
        let ring = |i: i32| {
            let theta = step * (f64::from(i) + 0.5);
            8.0 * light.falloff(DVec3::new(theta.sin(), 0.0, -theta.cos())) * TAU * theta.sin() * step
        };
        close(&format!("power, {cutoff} and {beam_width}"), light.power().g, (0..n).map(ring).sum(), 2e-5);
    }
}

/// A sun gives its irradiance times the cosine, at any distance, and is found by no density.
#[test]
fn a_sun_follows_the_cosine_law_alone() {
    let direction = Vec3::new(1.0, -2.0, 0.5).normalize();
    let light = Light::Directional(DirectionalLight { direction, irradiance: Rgb::new(1.0, 2.0, 3.0) });
    for point in [Vec3::ZERO, Vec3::splat(1e4)] {
        let sample = light.sample(point, None, Vec2::ZERO).expect("everywhere");
        assert!(sample.target.is_none() && sample.pdf.is_infinite());
        assert_eq!((sample.direction, sample.irradiance), (-direction, Rgb::new(1.0, 2.0, 3.0)));
        assert_eq!(light.pdf(point, None, sample.direction, None), 0.0);
    }
    let cos = 2.0 / 5.25_f64.sqrt();
    close("luminance on the floor", light.importance(Vec3::ZERO, Vec3::Y), Rgb::new(1.0, 2.0, 3.0).luminance() * cos, 1e-6);
}

/// A square of side 2 in z = 0 that shines up, with texture coordinates from 0 to 1.
fn square(radiance: Texture, placed: fn(DVec3) -> DVec3) -> Light {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let mesh = Mesh {
        positions: corners.map(|(x, y)| placed(DVec3::new(x, y, 0.0)).as_vec3()).to_vec(),
        uvs: corners.map(|(x, y)| Vec2::new(0.5 * (x + 1.0) as f32, 0.5 * (y + 1.0) as f32)).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    Light::Area(AreaLight::new(0, radiance, Emitter::of_mesh(&mesh)))
}

/// Rough texels, three of five black.
fn rough(filter: Filter) -> Texture {
    let texels = (0..48)
        .map(|k| {
            let u = Sampler::new(8, k, 0).next_2d();
            if k % 5 < 3 { [0.0; 3] } else { [4.0 * u.x, 4.0 * u.y, 1.0] }
        })
        .collect();
    Texture::Bitmap(Bitmap { width: 8, height: 6, texels, filter, wrap: Wrap::Repeat, to_uv: Bitmap::IDENTITY })
}

/// Power and irradiance of a textured square against the sum over 240 x 240 small constant emitters, each seen as a point.
#[test]
fn a_textured_emitter_is_the_sum_of_its_parts() {
    for filter in [Filter::Nearest, Filter::Bilinear] {
        let texture = rough(filter);
        let light = square(texture.clone(), |p| p);
        let point = DVec3::new(0.4, -0.3, 1.3);
        let n = DVec3::new(0.2, 0.3, -1.0).normalize();
        let parts = 240;
        let (mut power, mut irradiant) = (Rgb::BLACK, Rgb::BLACK);
        for k in 0..parts * parts {
            let uv = DVec2::new((k % parts) as f64 + 0.5, (k / parts) as f64 + 0.5) / parts as f64;
            let (radiance, area) = (texture.at(uv.as_vec2()), 4.0 / (parts * parts) as f64);
            let to_light = DVec3::new(2.0 * uv.x - 1.0, 2.0 * uv.y - 1.0, 0.0) - point;
            let d2 = to_light.length_squared();
            let direction = to_light / d2.sqrt();
            power += radiance * (PI * area);
            irradiant += radiance * (area * -direction.z * direction.dot(n).max(0.0) / d2);
        }
        let got = self::irradiance(&light, point.as_vec3(), n.as_vec3(), 1 << 17);
        for channel in 0..3 {
            close(&format!("{filter:?}: power, channel {channel}"), light.power()[channel], power[channel], 2e-3);
            close(&format!("{filter:?}: irradiance, channel {channel}"), got[channel], irradiant[channel], 4e-3);
        }
    }
}

/// The density that `pdf` gives a hit is the one of the sample that leads there, and integrates to one over the directions.
#[test]
fn the_density_of_a_textured_emitter_is_that_of_its_samples() {
    let light = square(rough(Filter::Bilinear), |p| p);
    let point = Vec3::new(0.4, -0.3, 1.3);
    let hit_at = |direction: Vec3| {
        let position = point + direction * (-point.z / direction.z);
        // The diagonal from (-1, -1) to (1, 1) divides the square.
        let primitive = u32::from(position.y > position.x);
        let uv = Vec2::new(0.5 * (position.x + 1.0), 0.5 * (position.y + 1.0));
        LightHit { position, normal: Vec3::Z, primitive, uv }
    };
    let mut near_borders = 0;
    for i in 0..4096 {
        let sample = light.sample(point, None, Sampler::new(3, 2, i).next_2d()).expect("seen from the front");
        let pdf = light.pdf(point, None, sample.direction, Some(&hit_at(sample.direction)));
        // Rounding can move a sample across the border of two cells.
        near_borders += u32::from((pdf / sample.pdf - 1.0).abs() > 1e-4);
    }
    assert!(near_borders <= 4, "{near_borders} samples have another density than their hits");
    let n = 1500;
    let mut integral = 0.0;
    for k in 0..n * n {
        let at = |i: usize| 2.0 * (i as f64 + 0.5) / n as f64 - 1.0;
        let to_light = DVec3::new(at(k % n), at(k / n), 0.0) - point.as_dvec3();
        let (d2, direction) = (to_light.length_squared(), to_light.normalize());
        let hit = hit_at(direction.as_vec3());
        integral += light.pdf(point, None, direction.as_vec3(), Some(&hit)) * -direction.z / d2 * 4.0 / (n * n) as f64;
    }
    close("integral of the density", integral, 1.0, 1e-3);
    assert_eq!(light.pdf(Vec3::new(0.0, 0.0, -1.0), None, Vec3::Z, Some(&hit_at(Vec3::Z))), 0.0, "the back");
    assert_eq!(light.pdf(point, None, Vec3::Z, None), 0.0, "a ray that leaves the scene");
}

/// From outside a sphere its density is that of the cone it fills.
#[test]
fn the_density_of_a_spherical_lamp_is_that_of_its_cone() {
    let sphere = twopass::geometry::Sphere { center: Vec3::new(0.0, 0.0, 3.0), radius: 1.0 };
    let light = Light::Area(AreaLight::new(0, Texture::Constant(Rgb::WHITE), Emitter::Sphere(sphere)));
    let hit = LightHit { position: Vec3::new(0.0, 0.0, 2.0), normal: Vec3::NEG_Z, primitive: 0, uv: Vec2::ZERO };
    let want = 1.0 / (TAU * (1.0 - (8.0_f64 / 9.0).sqrt()));
    close("density", light.pdf(Vec3::ZERO, None, Vec3::Z, Some(&hit)), want, 1e-6);
    let sample = light.sample(Vec3::ZERO, None, Vec2::splat(0.3)).expect("outside");
    close("density of a sample", sample.pdf, want, 1e-6);
    close("power", light.power().g, PI * 4.0 * PI, 1e-12);
}
