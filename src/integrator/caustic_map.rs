//! Light that lamps throw onto diffuse surfaces by way of mirrors and glass: particles from the lamps [Jensen96].
//!
//! A particle is kept where it meets a diffuse part after one or more ideal reflections or refractions, and spreads its power over a
//! disk whose size follows the density of particles around it (adaptive kernels, [Silverman86], section 5.3). Paths that
//! only gather rays can find, such as those by a glossy surface, are left to them: a gather ray does not count a lamp that
//! it reaches by ideal lobes alone.

use super::irradiance_cache::grid::Grid;
use crate::geometry::{offset_origin, triangle};
use crate::light::{AreaLight, Emitter, Light};
use crate::math::{Frame, Rgb, Sampler, Vec3, warp};
use crate::world::walk::RayCounts;
use crate::world::{Shading, SurfaceInteraction, World};
use rayon::prelude::*;
use std::collections::HashMap;
use std::f64::consts::{FRAC_1_PI, PI};
use std::ops::ControlFlow;

/// Longest chain of ideal lobes.
const LONGEST: u32 = 64;
/// More shapes than this that reflect or refract are aimed at as one.
const MOST_TARGETS: usize = 32;
/// Sizes of cells in which particles are counted; each half of the one before.
const LEVELS: i32 = 9;
/// Widest kernel over the scene's diagonal.
const WIDEST: f32 = 1.0 / 48.0;

/// How a map is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CausticSettings {
    /// Particles that leave the lamps.
    pub particles: u32,
    /// Particles that overlap at a point, about.
    pub overlap: f32,
    /// Seed.
    pub seed: u64,
}

/// A particle where it met a diffuse part.
#[derive(Debug, Clone, Copy)]
struct Particle {
    point: Vec3,
    /// Geometric normal on the side it came to.
    normal: Vec3,
    /// Unit direction it came from.
    direction: Vec3,
    shape: u32,
    /// One over the squared radius of its disk [1/m²].
    inverse_r2: f32,
    /// Power [W]; once the disk is known, irradiance at its middle [W/m²].
    power: Rgb,
}

/// Particles by place.
#[derive(Debug, Default)]
pub struct CausticMap {
    particles: Vec<Particle>,
    grid: Grid,
}

/// Where to shoot: spheres around what reflects or refracts.
struct Targets {
    spheres: Vec<(Vec3, f32)>,
}

impl CausticMap {
    /// Shoots particles; `None` if the scene has no lamp of finite size or nothing that bends light ideally.
    pub fn shoot(world: &World, settings: &CausticSettings, counts: &mut RayCounts) -> Option<CausticMap> {
        let lamps = lamps(world);
        let targets = Targets::of(world);
        let total: f64 = lamps.iter().map(|l| l.power().luminance()).sum();
        if targets.spheres.is_empty() || total <= 0.0 {
            return None;
        }
        let running: Vec<f64> = lamps
            .iter()
            .scan(0.0, |sum, lamp| {
                *sum += lamp.power().luminance() / total;
                Some(*sum)
            })
            .collect();
        let shots: Vec<(Vec<Particle>, RayCounts)> = (0..settings.particles.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut counts = RayCounts::default();
                let mut found = Vec::new();
                for k in chunk * CHUNK..((chunk + 1) * CHUNK).min(settings.particles) {
                    let mut sampler = Sampler::new(settings.seed, 0, u64::from(k));
                    let u = f64::from(sampler.next_1d());
                    let i = running.partition_point(|&r| r <= u).min(lamps.len() - 1);
                    let chosen = running[i] - if i == 0 { 0.0 } else { running[i - 1] };
                    let share = 1.0 / (chosen * f64::from(settings.particles));
                    shoot_one(world, lamps[i], &targets, share, &mut sampler, &mut counts, &mut found);
                }
                (found, counts)
            })
            .collect();
        let mut particles = Vec::new();
        for (found, c) in shots {
            particles.extend(found);
            *counts += c;
        }
        Some(Self::of(particles, settings.overlap, WIDEST * world.bounds().diagonal()))
    }

    /// Gives each particle its disk.
    fn of(mut particles: Vec<Particle>, overlap: f32, widest: f32) -> CausticMap {
        let cell = |p: Vec3, level: i32| {
            let scale = (level as f32).exp2() / widest;
            (p * scale).floor().as_i64vec3().to_array()
        };
        let mut density: Vec<HashMap<[i64; 3], u32>> = vec![HashMap::new(); LEVELS as usize];
        for p in &particles {
            for level in 0..LEVELS {
                *density[level as usize].entry(cell(p.point, level)).or_default() += 1;
            }
        }
        let mut grid = Grid::default();
        for (i, p) in particles.iter_mut().enumerate() {
            // The finest cell that holds enough of them; its count refines the radius.
            let enough = (0..LEVELS).rev().find(|&l| density[l as usize][&cell(p.point, l)] as f32 >= overlap).unwrap_or(0);
            let count = density[enough as usize][&cell(p.point, enough)] as f32;
            let size = widest * (-enough as f32).exp2();
            let radius = (size * (overlap / (std::f32::consts::PI * count)).sqrt()).min(widest);
            p.inverse_r2 = 1.0 / (radius * radius);
            // A paraboloid over the disk that holds the whole power.
            p.power = p.power * (2.0 * FRAC_1_PI * f64::from(p.inverse_r2));
            grid.insert(i as u32, p.point, radius);
        }
        CausticMap { particles, grid }
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.particles.len()
    }

    /// True if no particle was kept.
    pub fn is_empty(&self) -> bool {
        self.particles.is_empty()
    }

    /// Irradiance at a hit by lamps seen through ideal lobes alone, as its diffuse part accepts it [W/m²].
    pub fn irradiance(&self, si: &SurfaceInteraction, shading: &Shading<'_>) -> Rgb {
        let mut sum = Rgb::BLACK;
        self.grid.visit(si.point, |i| {
            let p = &self.particles[i as usize];
            let x = (p.point - si.point).length_squared() * p.inverse_r2;
            if x < 1.0 && p.shape == si.shape && p.normal.dot(si.ng) > 0.5 {
                sum += p.power * f64::from(1.0 - x) * shading.acceptance(p.direction);
            }
            ControlFlow::Continue(())
        });
        sum
    }
}

/// Particles traced by one task.
const CHUNK: u32 = 1024;

/// Lamps of finite size that shadow rays look for.
fn lamps(world: &World) -> Vec<&AreaLight> {
    let lights = world.partition().shadow_lights().iter().map(|&i| &world.scene().lights[i]);
    lights.filter_map(|light| if let Light::Area(area) = light { Some(area) } else { None }).collect()
}

impl Targets {
    fn of(world: &World) -> Self {
        let scene = world.scene();
        let bends = |i: &usize| scene.material_of(&scene.shapes[*i]).material.bends_ideally();
        let shapes: Vec<usize> = (0..scene.shapes.len()).filter(bends).collect();
        let sphere = |b: crate::geometry::Bounds| (b.center(), 0.5 * b.diagonal());
        let spheres = if shapes.len() > MOST_TARGETS {
            let all = shapes.iter().map(|&i| world.shape_bounds(i)).reduce(|a, b| a.union(b));
            all.into_iter().map(sphere).collect()
        } else {
            shapes.iter().map(|&i| sphere(world.shape_bounds(i))).collect()
        };
        Self { spheres }
    }

    /// A direction from a point of a lamp, and its density per steradian.
    fn direction(&self, from: Vec3, normal: Vec3, sampler: &mut Sampler) -> (Vec3, f64) {
        let n = self.spheres.len();
        let chosen = ((sampler.next_1d() * n as f32) as usize).min(n - 1);
        let u = sampler.next_2d();
        let direction = match cone(from, self.spheres[chosen]) {
            Some((axis, width)) => Frame::new(axis).to_world(warp::cone(u, width)),
            None => Frame::new(normal).to_world(warp::cosine_hemisphere(u)),
        };
        let density = |sphere: &(Vec3, f32)| match cone(from, *sphere) {
            Some((axis, width)) if direction.dot(axis) >= 1.0 - width => 1.0 / (2.0 * PI * f64::from(width)),
            Some(_) => 0.0,
            None => f64::from(direction.dot(normal).max(0.0)) * FRAC_1_PI,
        };
        (direction, self.spheres.iter().map(density).sum::<f64>() / n as f64)
    }
}

/// Axis of the cone around a sphere and 1 - cos of half its angle; `None` from inside.
fn cone(from: Vec3, (center, radius): (Vec3, f32)) -> Option<(Vec3, f32)> {
    let to = center - from;
    let d2 = to.length_squared();
    // A little wider, so that rounding does not put a direction of the cone outside it.
    let sin2 = 1.001 * radius * radius / d2;
    (sin2 < 1.0).then(|| (to / d2.sqrt(), 1.0001 * sin2 / (1.0 + (1.0 - sin2).sqrt())))
}

/// A point of a lamp by area: the point moved off its surface towards `direction` can be had by the normal and the error.
fn start(lamp: &AreaLight, sampler: &mut Sampler) -> Option<(Vec3, Vec3, Vec3, Rgb)> {
    match &lamp.emitter {
        Emitter::Triangles { corners, .. } => {
            let total = lamp.area();
            let mut left = f64::from(sampler.next_1d()) * total;
            let area = |&[a, b, c]: &[Vec3; 3]| triangle::area_vector(a, b, c).length();
            let index = corners.iter().position(|t| {
                left -= area(t);
                left < 0.0
            });
            let index = index.unwrap_or(corners.len().checked_sub(1)?);
            let [a, b, c] = corners[index];
            let w = warp::triangle(sampler.next_2d());
            let point = a * (1.0 - w.x - w.y) + b * w.x + c * w.y;
            let normal = triangle::area_vector(a, b, c).normalize().as_vec3();
            let error = Vec3::splat(2.0 * triangle::leaving_error(a, b, c));
            let radiance = lamp.radiance.at(lamp.emitter.uv_of(index, w.as_dvec2()));
            Some((point, normal, error, radiance))
        }
        Emitter::Sphere(sphere) => {
            let normal = warp::sphere(sampler.next_2d());
            let point = sphere.center + normal * sphere.radius;
            let error = Vec3::splat((sphere.center.abs().max_element() + sphere.radius) * 8.0 * f32::EPSILON);
            Some((point, normal, error, lamp.radiance.at(sphere.uv(normal))))
        }
    }
}

/// One particle from a lamp; `share` is one over the expected number of its particles.
fn shoot_one(
    world: &World,
    lamp: &AreaLight,
    targets: &Targets,
    share: f64,
    sampler: &mut Sampler,
    counts: &mut RayCounts,
    found: &mut Vec<Particle>,
) {
    let Some((point, normal, error, radiance)) = start(lamp, sampler) else { return };
    let (direction, density) = targets.direction(point, normal, sampler);
    let cos = f64::from(direction.dot(normal));
    if cos <= 0.0 || density <= 0.0 {
        return;
    }
    let mut power = radiance * (cos * lamp.area() / density * share);
    let mut ray = crate::geometry::Ray::new(offset_origin(point, error, normal, direction), direction);
    let mut bent = false;
    for _ in 0..LONGEST {
        counts.particle += 1;
        let Some(si) = world.intersect(&ray) else { return };
        let shading = world.shading(&si);
        if bent && shading.has_diffuse() {
            found.push(Particle { point: si.point, normal: si.ng, direction: si.wo, shape: si.shape, inverse_r2: 0.0, power });
        }
        let lobes = shading.lobes();
        let total: f64 = lobes.iter().map(|lobe| lobe.power).sum();
        let u = f64::from(sampler.next_1d());
        let go_on = total.min(1.0);
        if u >= go_on {
            return;
        }
        let Some((lobe, probability)) = lobes.choose((u / go_on) as f32) else { return };
        // Power has no n² scaling: the tint of the lobe alone, at the share of power that it was chosen by.
        let tint = lobe.weight / lobe.weight.mean().max(f64::MIN_POSITIVE);
        power = power * tint * (lobe.power / (probability * go_on));
        let Some(direction) = shading.direction(&lobe) else { return };
        bent |= !shading.is_straight(&lobe);
        ray = si.spawn(direction);
    }
}
