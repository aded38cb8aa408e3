//! Very few patches and very many, numbers that are none, finer and finer patches, any number of threads.

use crate::accel::AccelKind;
use crate::film::{Image, Layer, io};
use crate::form_factor::analytic::{parallel_rectangles, point_to_polygon};
use crate::geometry::Ray;
use crate::load::{LoadOptions, load_scene};
use crate::math::{DVec3, Sampler, Vec3};
use crate::patch::PatchError;
use crate::pipeline::{PipelineError, solve};
use crate::progress::silent;
use crate::scene::{SceneError, SurfaceSource};
use crate::stability::rooms::{self, Room, furnished, lit, quick, solve_gathered};
use crate::stability::{Curve, Rows, Trouble, figure};
use crate::world::World;
use std::f64::consts::PI;
use std::time::Instant;

/// B20: 1 patch, 2 patches, a million.
pub fn few_and_many_patches(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let mut settings = quick(1, 10.0);
    settings.pass_one.form_factor_tolerance = 0.002;
    let mut room = Room::new(DVec3::new(0.5, 0.5, 0.5), DVec3::ZERO, 4);
    let grey = room.grey(0.5);
    room.quad(DVec3::ZERO, DVec3::X, DVec3::Y, grey, 1.0);
    let alone = solve_gathered(room.scene()?, &settings)?.pass_one;
    rows.value("1 patch", "B = E", PI, alone.field.radiosity(0).g, 0.0);
    // A second square above, seeing the first: B_1 = E/(1 - rho² F²), B_2 = rho F B_1.
    room.quad(DVec3::Z, DVec3::Y, DVec3::X, grey, 0.0);
    let pair = solve_gathered(room.scene()?, &settings)?.pass_one;
    let f = parallel_rectangles(1.0, 1.0, 1.0);
    let first = PI / (1.0 - 0.25 * f * f);
    // Three standard errors of F by 8192 rays, an eighth of what a patch of the full size casts.
    let bound = 3.0 * (f * (1.0 - f) / 8192.0).sqrt() / f;
    rows.value("2 patches", "B_1 = E/(1 - rho² F²)", first, pair.field.radiosity(0).g, bound * 2.0 * 0.25 * f * f);
    rows.value("2 patches", "B_2 = rho F B_1", 0.5 * f * first, pair.field.radiosity(1).g, bound);
    // 24 units of area: a million patches have an edge of 0.0049.
    let started = Instant::now();
    let mut bounded = quick(1, 0.0049);
    bounded.pass_one.max_memory = Some(1 << 30);
    let refusal = match solve(lit(0.5, 4).scene()?, &bounded, &mut silent) {
        Err(error @ PipelineError::Memory { patches, .. }) => Some((error.to_string(), patches as f64)),
        _ => None,
    };
    let told = refusal.clone().map_or_else(|| "accepted".to_owned(), |(message, _)| message);
    let seconds = started.elapsed().as_secs_f64();
    let is_so = refusal.is_some_and(|(_, estimate)| (5e5..2e6).contains(&estimate)) && seconds < 1.0;
    let law = "estimated, and refused under --max-memory 1G before anything is allocated";
    rows.holds("1e6 patches", law, "an estimate near 1e6 patches", told, is_so);
    let refused = match solve(lit(0.5, 4).scene()?, &quick(1, 1e-3), &mut silent) {
        Err(PipelineError::Patch(error @ PatchError::TooMany { .. })) => Some(error.to_string()),
        _ => None,
    };
    let is_so = refused.is_some();
    let told = refused.unwrap_or_else(|| "accepted".to_owned());
    rows.holds("2e7 patches", "more than can be counted on are refused without a bound, too", "refused", told, is_so);
    Ok(())
}

/// B21: numbers that are none.
pub fn not_a_number(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    for (name, value) in [("NaN", f64::NAN), ("an infinity", f64::INFINITY)] {
        let mut room = lit(0.5, 4);
        if let SurfaceSource::Triangles(t) = &mut room.source.shapes[0].surface {
            t.positions[1].y = value;
        }
        let refused = room.scene().err();
        let told = refused.as_ref().map_or_else(|| "accepted".to_owned(), ToString::to_string);
        let is_so = matches!(refused, Some(SceneError::NotFinite { vertex: 1, .. }));
        rows.holds(&format!("{name} in a vertex"), "refused with shape and vertex", "an error", told, is_so);
    }
    let folder = tempfile::tempdir()?;
    let mut texture = Image::new(4, 4);
    texture.pixels_mut()[5] = [0.5, f32::NAN, 0.5];
    io::write_exr(&folder.path().join("t.exr"), &[Layer::main(texture)], &io::Header::default())?;
    let path = folder.path().join("scene.xml");
    let text = "<scene version=\"3.0.0\"><sensor type=\"perspective\"/><shape type=\"rectangle\"><bsdf type=\"diffuse\"><texture \
                type=\"bitmap\" name=\"reflectance\"><string name=\"filename\" value=\"t.exr\"/></texture></bsdf></shape></scene>";
    std::fs::write(&path, text)?;
    let error = load_scene(&path, &LoadOptions::default()).err().map(|e| e.to_string());
    let is_so = error.is_some();
    let told = error.unwrap_or_else(|| "accepted".to_owned()).replace(&format!("{}/", folder.path().display()), "");
    rows.holds("NaN in a texel", "refused", "an error", told, is_so);
    rays_that_are_none(rows)
}

fn rays_that_are_none(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    const RAYS: u64 = 200_000;
    let world = World::new(furnished(8).scene()?, AccelKind::default())?;
    let direction = |k: u64| {
        let u = Sampler::new(3, 0, k).next_2d();
        crate::math::warp::cosine_hemisphere(u)
    };
    let good = |k: u64| Ray::new(Vec3::new(0.1, 0.0, -0.5), direction(k));
    let spoilt = |k: u64| {
        let mut ray = good(k);
        let value = if k.is_multiple_of(2) { f32::NAN } else { f32::INFINITY };
        match k % 6 / 2 {
            0 => ray.origin.x = value,
            1 => ray.direction.y = value,
            _ => (ray.origin.z, ray.direction.x) = (value, value),
        }
        ray
    };
    let timed = |ray: &dyn Fn(u64) -> Ray| {
        let started = Instant::now();
        let hits = (0..RAYS).filter(|&k| world.intersect(&ray(k)).is_some()).count();
        (hits, started.elapsed().as_secs_f64())
    };
    let (hits, seconds) = timed(&spoilt);
    let (_, usual) = timed(&good);
    rows.holds("NaN and infinite rays", "they hit nothing", "0 hits", format!("{hits} of {RAYS} hit"), hits == 0);
    let told = format!("{:.2} times the time of good rays", seconds / usual);
    rows.holds("NaN and infinite rays", "no slowdown above 2.5", "at most 2.5", told, seconds <= 2.5 * usual);
    Ok(())
}

/// B23: patches of size h, h/2, h/4 ...: the error of a solution constant over each patch falls with h.
pub fn refinement(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    // A black floor under a glowing ceiling of its own size: the irradiance at each point is known.
    let side = 2.0;
    let ceiling = [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)].map(|(x, z)| DVec3::new(x, 1.0, z));
    let mut points = Vec::new();
    for size in [0.5, 0.25, 0.125] {
        let mut room = Room::new(DVec3::new(1.0, 0.5, 1.0), DVec3::new(1.0, 0.0, 1.1), 4);
        let black = room.grey(0.0);
        room.quad(DVec3::ZERO, DVec3::Z * side, DVec3::X * side, black, 0.0);
        room.quad(DVec3::Y, DVec3::X * side, DVec3::Z * side, black, 1.0);
        let mut settings = quick(1, size);
        settings.pass_one.form_factor_tolerance = 0.004;
        let solved = solve_gathered(room.scene()?, &settings)?;
        let (field, world) = (&solved.pass_one.field, &solved.world);
        let mut sum = 0.0;
        const POINTS: u64 = 4096;
        for k in 0..POINTS {
            let u = Sampler::new(5, 0, k).next_2d();
            let at = DVec3::new(f64::from(u.x) * side, 0.0, f64::from(u.y) * side);
            let start = (at + DVec3::Y * 0.5 - world.scene().origin).as_vec3();
            let hit = world.intersect(&Ray::new(start, Vec3::NEG_Y)).ok_or("the floor was not hit")?;
            let exact = PI * point_to_polygon(at, DVec3::Y, &ceiling);
            sum += (field.irradiance(&hit).g - exact).powi(2);
        }
        points.push((1.0 / size, (sum / POINTS as f64).sqrt()));
    }
    let order = (points[0].1 / points[2].1).log2() / 2.0;
    let told = points.iter().map(|(_, e)| figure(*e)).collect::<Vec<String>>().join(", ");
    let law = "L2 error of the irradiance over patches of 1/2, 1/4, 1/8: observed order at least 0.95";
    let curve = Curve { axis: "patches per unit length", points };
    rows.error("floor under a glowing ceiling", law, "order 1", told, 1.0 - order, 0.05, Some(curve));
    Ok(())
}

/// B24: the same bits on any number of threads, every time.
pub fn threads(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let mut first: Option<Image> = None;
    for threads in [1, 2, 3, 8] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let mut differing = 0;
        for _ in 0..3 {
            let scene = furnished(16).scene()?;
            let image = pool.install(|| rooms::picture(scene, &quick(4, 0.3)))?.film.image();
            let first = first.get_or_insert_with(|| image.clone());
            differing += image.pixels().iter().zip(first.pixels()).filter(|(a, b)| a != b).count();
        }
        let told = format!("{differing} pixels differ in 3 runs");
        rows.holds(&format!("{threads} threads"), "the same bits as on 1", "same bits", told, differing == 0);
    }
    Ok(())
}
