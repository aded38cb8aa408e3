//! Probabilities that sum to one, picks that follow them, and no light forgotten.

use super::*;
use crate::geometry::{Mesh, Sphere};
use crate::light::{AreaLight, DirectionalLight, Emitter, Environment, PointLight, SpotLight};
use crate::material::Texture;
use crate::math::{DMat3, Frame, Rgb, Sampler, warp};
use std::sync::Arc;

fn vector(s: &mut Sampler) -> Vec3 {
    Vec3::new(s.next_1d(), s.next_1d(), s.next_1d())
}

/// A small square at `center` that shines along `n`.
fn panel(center: Vec3, n: Vec3, half: f32, radiance: f64) -> Light {
    let Frame { s, t, .. } = Frame::new(n);
    let positions = [-s - t, s - t, s + t, -s + t].map(|d| center + d * half).to_vec();
    let mesh = Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() };
    Light::Area(AreaLight::new(0, Texture::Constant(Rgb::grey(radiance)), Emitter::of_mesh(&mesh)))
}

/// `n` small lamps of all kinds and of powers over two decades in a room of 10 x 10 x 10.
fn mixed(n: usize) -> Vec<Light> {
    let lamp = |i: usize| {
        let mut s = Sampler::new(21, i as u64, 0);
        let (position, axis) = (vector(&mut s) * 10.0, warp::sphere(s.next_2d()));
        let strength = 10.0_f64.powf(2.0 * f64::from(s.next_1d()));
        match i % 4 {
            0 => panel(position, axis, 0.05, 100.0 * strength),
            1 => {
                let sphere = Sphere { center: position, radius: 0.05 };
                Light::Area(AreaLight::new(0, Texture::Constant(Rgb::grey(100.0 * strength)), Emitter::Sphere(sphere)))
            }
            2 => Light::Point(PointLight { position, intensity: Rgb::grey(strength) }),
            _ => {
                let cutoff = 0.2 + 1.3 * f64::from(s.next_1d());
                let beam_width = if i % 8 == 3 { cutoff } else { 0.5 * cutoff };
                Light::Spot(SpotLight { position, axis: axis.as_dvec3(), intensity: Rgb::grey(strength), cutoff, beam_width })
            }
        }
    };
    (0..n).map(lamp).collect()
}

/// Mixed lamps, two suns and a map.
fn with_sky(n: usize) -> Vec<Light> {
    let mut lights = mixed(n);
    for direction in [Vec3::NEG_Y, Vec3::new(0.6, 0.0, 0.8)] {
        lights.push(Light::Directional(DirectionalLight { direction, irradiance: Rgb::grey(0.5) }));
    }
    let texels: Vec<[f32; 3]> = (0..12).map(|i| [0.1 * i as f32; 3]).collect();
    lights.push(Light::Environment(Arc::new(Environment::map(4, 3, texels.into(), 0.1, DMat3::IDENTITY))));
    lights
}

/// Points inside and outside the room, each with a normal or none.
fn receivers(n: u64) -> impl Iterator<Item = (Vec3, Option<Vec3>)> {
    (0..n).map(|i| {
        let mut s = Sampler::new(22, i, 0);
        let point = vector(&mut s) * if i % 5 == 0 { 40.0 } else { 10.0 };
        (point, (i % 3 != 0).then(|| warp::sphere(s.next_2d())))
    })
}

fn all(lights: &[Light]) -> LightTree {
    LightTree::new(lights, &(0..lights.len()).collect::<Vec<_>>())
}

#[test]
fn probabilities_sum_to_one() {
    for lights in [mixed(1), mixed(2), mixed(9), mixed(700), with_sky(0), with_sky(300)] {
        let tree = all(&lights);
        for (point, n) in receivers(60) {
            let sum: f64 = (0..lights.len()).map(|l| tree.probability(point, n, l)).sum();
            let impossible = sum == 0.0 && tree.pick(point, n, 0.4).is_none();
            assert!(impossible || (sum - 1.0).abs() < 1e-9, "{} lights at {point}: {sum}", lights.len());
        }
    }
}

#[test]
fn a_light_outside_the_subset_is_never_picked() {
    let lights = with_sky(40);
    let tree = LightTree::new(&lights, &[3, 7, 20, 41]);
    for (point, n) in receivers(40) {
        let sum: f64 = [3, 7, 20, 41].map(|l| tree.probability(point, n, l)).iter().sum();
        assert!(sum == 0.0 || (sum - 1.0).abs() < 1e-9);
        assert_eq!(tree.probability(point, n, 4), 0.0);
        if let Some((light, ..)) = tree.pick(point, n, 0.7) {
            assert!([3, 7, 20, 41].contains(&light));
        }
    }
}

/// Pearson's chi² of picks against the probabilities, and that each pick tells its own.
#[test]
fn picks_follow_their_probabilities() {
    let lights = with_sky(60);
    let tree = all(&lights);
    for (k, (point, n)) in receivers(8).enumerate() {
        let draws = 60_000_u64;
        let (mut counts, mut mean_rest) = (vec![0_u64; lights.len()], 0.0);
        for i in 0..draws {
            let u = Sampler::new(23, i, k as u64).next_1d();
            let Some((light, probability, rest)) = tree.pick(point, n, u) else { continue };
            let told = tree.probability(point, n, light);
            assert!((probability / told - 1.0).abs() < 1e-12, "{probability} picked, {told} told");
            assert!((0.0..1.0).contains(&rest));
            counts[light] += 1;
            mean_rest += f64::from(rest) / draws as f64;
        }
        let expected = (0..lights.len()).map(|l| tree.probability(point, n, l) * draws as f64);
        let (mut chi2, mut cells) = (0.0, 0);
        for (&count, e) in counts.iter().zip(expected) {
            if e >= 5.0 {
                chi2 += (count as f64 - e).powi(2) / e;
                cells += 1;
            } else {
                assert!((count as f64) < e + 25.0, "{count} picks of {e} expected");
            }
        }
        // Five standard deviations of chi²: mean k, variance 2k.
        let freedom = f64::from(cells);
        assert!(chi2 < freedom + 5.0 * (2.0 * freedom).sqrt() + 5.0, "receiver {k}: chi² {chi2} over {cells} cells");
        // What is left of the random number is uniform: its mean has a standard deviation of 0.29/sqrt(draws).
        assert!((mean_rest - 0.5).abs() < 0.008, "receiver {k}: mean of what is left {mean_rest}");
    }
}

/// Irradiance from one light by a few samples, without occlusion.
fn irradiance(light: &Light, point: Vec3, n: Vec3, samples: u64) -> f64 {
    let one = |i: u64| {
        let s = light.sample(point, None, Sampler::new(24, 0, i).next_2d())?;
        Some(s.irradiance.g * f64::from(s.direction.dot(n)).max(0.0))
    };
    (0..samples).filter_map(one).sum::<f64>() / samples as f64
}

/// With every contributing light possible, the expectation of contribution over probability is the sum over all lights.
#[test]
fn every_light_that_contributes_can_be_picked() {
    let lights = with_sky(400);
    let tree = all(&lights);
    for (point, n) in receivers(150) {
        for normal in [n.unwrap_or(Vec3::X), Vec3::Y] {
            for (l, light) in lights.iter().enumerate() {
                if irradiance(light, point, normal, 4) > 0.0 {
                    assert!(tree.probability(point, Some(normal), l) > 0.0, "light {l} at {point} about {normal}");
                    assert!(tree.probability(point, None, l) > 0.0, "light {l} at {point}");
                }
            }
        }
    }
}

/// Relative variance of one pick, by the exact sum over all lights: sum of e²/p over the squared sum of e, less one.
fn variance(each: &[f64], probability: impl Fn(usize) -> f64) -> f64 {
    let total: f64 = each.iter().sum();
    each.iter().enumerate().filter(|(_, e)| **e > 0.0).map(|(l, e)| e * e / probability(l)).sum::<f64>() / (total * total) - 1.0
}

/// A thousand lamps in a room: picks by the tree against picks by the importance of each light.
#[test]
fn the_tree_is_nearly_as_good_as_looking_at_every_light() {
    let panels: Vec<Light> = (0..1000)
        .map(|i| {
            let mut s = Sampler::new(25, i, 0);
            let at = vector(&mut s) * 10.0;
            let strength = 10.0_f64.powf(2.0 * f64::from(s.next_1d()));
            if i % 2 == 0 {
                panel(Vec3::new(at.x, 9.9, at.z), Vec3::NEG_Y, 0.04, strength)
            } else {
                panel(Vec3::new(0.05, at.y, at.z), Vec3::X, 0.04, strength)
            }
        })
        .collect();
    for (name, lights) in [("panels on ceiling and wall", panels), ("lamps of all kinds", mixed(1000))] {
        let tree = all(&lights);
        let (mut by_tree, mut by_each, mut points) = (0.0, 0.0, 0.0);
        for i in 0..100 {
            let mut s = Sampler::new(26, i, 0);
            let (point, n) = (vector(&mut s) * 9.0 + 0.5, warp::sphere(s.next_2d()));
            let each: Vec<f64> = lights.iter().map(|l| irradiance(l, point, n, 4)).collect();
            if each.iter().sum::<f64>() <= 0.0 {
                continue;
            }
            let importance: Vec<f64> = lights.iter().map(|l| l.importance(point, n)).collect();
            let total: f64 = importance.iter().sum();
            by_each += variance(&each, |l| importance[l] / total);
            by_tree += variance(&each, |l| tree.probability(point, Some(n), l));
            points += 1.0;
        }
        let (by_tree, by_each) = (by_tree / points, by_each / points);
        println!("{name}: relative variance of one pick {by_tree:.3} by the tree, {by_each:.3} by each light");
        assert!(by_tree < 1.5 * by_each, "{name}: {by_tree} by the tree, {by_each} by each light");
    }
}
