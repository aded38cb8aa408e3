//! Normals the wrong way round, cameras where none should be, nothing to see, mirrors and glass without end.

use crate::film::Image;
use crate::geometry::tessellate;
use crate::material::MaterialId;
use crate::math::{DAffine3, DVec3};
use crate::pipeline::Rendered;
use crate::scene::SurfaceSource;
use crate::stability::rooms::{self, Room, furnace, is_finite, mean, quick, radiance};
use crate::stability::{Curve, Rows, Trouble, figure};
use crate::world::walk::RayCounts;

fn render(room: &Room, spp: u32) -> Result<Rendered, Trouble> {
    Ok(rooms::picture(room.scene()?, &quick(spp, 0.25))?)
}

/// A lit room whose walls are of `material`; every second triangle of them turned over if `flipped`.
fn half_flipped(two_sided: bool, flipped: bool) -> Room {
    let mut room = Room::new(DVec3::new(0.0, 0.0, -0.9), DVec3::Z, 16);
    let (grey, black) = (if two_sided { room.two_sided(0.6) } else { room.grey(0.6) }, room.grey(0.0));
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), grey, [0.0; 6]);
    if flipped {
        for shape in &mut room.source.shapes {
            if let SurfaceSource::Triangles(t) = &mut shape.surface {
                t.triangles[1].swap(1, 2);
            }
        }
    }
    room.quad(DVec3::new(-0.3, 0.99, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, black, 5.0);
    room
}

/// B14: a two-sided material has no wrong side; a one-sided one is black from behind.
pub fn inverted_normals(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let [plain, flipped] = [false, true].map(|f| render(&half_flipped(true, f), 64).map(|r| mean(&r.film.image())));
    let law = "two-sided walls, every second triangle turned over: the mean of the picture stays";
    rows.value("mixed normals", law, plain?, flipped?, 2e-3);
    let mut away = half_flipped(false, false);
    for shape in &mut away.source.shapes[..6] {
        if let SurfaceSource::Triangles(t) = &mut shape.surface {
            t.flip();
        }
    }
    let image = render(&away, 4)?.film.image();
    // The lamp lies in the upper half.
    let lit = image.pixels()[8 * 16..].iter().filter(|p| p[1] > 0.0).count();
    let law = "one-sided walls, all turned over: exactly black, the lamp shining on them";
    rows.holds("all normals outwards", law, "0 lit pixels of walls", format!("{lit}"), lit == 0);
    let mut away = Room::new(DVec3::new(0.0, 1.0, 0.0), DVec3::ZERO, 8);
    let grey = away.two_sided(0.5);
    away.quad(DVec3::new(-1.0, 0.0, -1.0), DVec3::Z * 2.0, DVec3::X * 2.0, grey, 0.0);
    away.quad(DVec3::new(-0.2, 2.0, -0.2), DVec3::Z * 0.4, DVec3::X * 0.4, grey, 10.0);
    let black = render(&away, 4)?.film.image().pixels().iter().all(|p| *p == [0.0; 3]);
    rows.holds("lamp turned away", "its back gives exactly nothing", "0", format!("black: {black}"), black);
    let warnings = half_flipped(false, true).scene()?.warnings;
    let told = if warnings.is_empty() { "none".to_owned() } else { warnings.join("; ") };
    rows.holds("mixed normals", "counted and warned of", "a warning", told, !warnings.is_empty());
    Ok(())
}

/// B15: a camera in a wall, on a surface, in glass.
pub fn camera_in_the_way(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let place = |room: &mut Room, eye: DVec3| room.source.camera.to_scene.translation = eye;
    let worst = |image: &Image, want: f64| {
        let errors = image.pixels().iter().flatten().map(|v| (f64::from(*v) / want - 1.0).abs());
        errors.fold(0.0, |a: f64, b| if b > a || b.is_nan() { b } else { a })
    };
    let mut on_wall = furnace(0.5);
    place(&mut on_wall, DVec3::new(0.2, 0.1, -1.0));
    let error = worst(&render(&on_wall, 2)?.film.image(), 2.0);
    rows.error("on a wall, looking in", "furnace: L = 2 in every pixel", "2", "worst pixel".to_owned(), error, 1e-3, None);
    let mut in_block = furnace(0.5);
    let grey = in_block.grey(0.5);
    add_block(&mut in_block, DVec3::splat(0.1), 0.3, grey);
    place(&mut in_block, DVec3::splat(0.1));
    let image = render(&in_block, 2)?.film.image();
    let black = image.pixels().iter().all(|p| *p == [0.0; 3]);
    rows.holds("in a solid block", "finite: the insides of its walls are black", "exactly 0", format!("black: {black}"), black);
    let mut in_glass = furnace(0.5);
    let glass = in_glass.glass(1.5);
    in_glass.sphere(DVec3::new(0.1, 0.0, 0.2), 0.4, glass);
    place(&mut in_glass, DVec3::new(0.15, 0.1, 0.1));
    let image = render(&in_glass, 64)?.film.image();
    rows.value("in a glass ball", "furnace: mean radiance n² L = 2.25 · 2", 4.5, mean(&image), 2e-3);
    rows.holds("in a glass ball", "finite", "finite", format!("finite: {}", is_finite(&image)), is_finite(&image));
    Ok(())
}

fn add_block(room: &mut Room, middle: DVec3, half: f64, material: MaterialId) {
    let block = DAffine3::from_translation(middle) * DAffine3::from_scale(DVec3::splat(half));
    room.add(SurfaceSource::Triangles(tessellate::cube(&block)), material, 0.0);
}

/// B16: no light, no reflection, no geometry, nothing before the camera.
pub fn nothing_to_see(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let empty = || Room::new(DVec3::ZERO, DVec3::Z, 8);
    let mut dark = empty();
    let grey = dark.grey(0.5);
    dark.walls(DVec3::splat(-1.0), DVec3::splat(1.0), grey, [0.0; 6]);
    let mut black = empty();
    let soot = black.grey(0.0);
    black.walls(DVec3::splat(-1.0), DVec3::splat(1.0), soot, [0.0; 6]);
    black.point_light(DVec3::new(0.0, 0.5, 0.0), 10.0);
    let mut behind = empty();
    let grey = behind.grey(0.5);
    behind.quad(DVec3::new(-1.0, -1.0, -2.0), DVec3::X * 2.0, DVec3::Y * 2.0, grey, 1.0);
    for (name, room, needs_warning) in [
        ("no light", dark, true),
        ("all black", black, false),
        ("no geometry", empty(), true),
        ("all behind the camera", behind, false),
    ] {
        let rendered = render(&room, 4)?;
        let zero = rendered.film.image().pixels().iter().all(|p| *p == [0.0; 3]);
        rows.holds(name, "the picture is exactly black", "0", format!("black: {zero}"), zero);
        if needs_warning {
            let warnings = rendered.world.scene().warnings.join("; ");
            rows.holds(name, "warned of", "a warning", warnings.clone(), !warnings.is_empty());
        }
        if needs_warning {
            let RayCounts { form_factor, shadow, gather, .. } = rendered.counts;
            let told = format!("{form_factor} for form factors, {shadow} to lights, {gather} to gather");
            let is_so = form_factor + shadow + gather == 0 && rendered.pass_one.is_none();
            rows.holds(name, "no form factor is computed: the plan leaves out all but the camera's rays", "0 rays", told, is_so);
        }
    }
    Ok(())
}

/// B17: boxes of mirrors, every face of which emits 1: D edges see 1 + rho + ... + rho^(D-1).
pub fn mirrors_only(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let boxed = |rho: f64| {
        let mut room = Room::new(DVec3::new(0.1, 0.2, -0.3), DVec3::Z, 4);
        let mirror = room.mirror(rho);
        room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), mirror, [1.0; 6]);
        room
    };
    let series = |rho: f64, edges: i32| if rho == 1.0 { f64::from(edges) } else { (1.0 - rho.powi(edges)) / (1.0 - rho) };
    // Cosines without a common measure: a path that meets an edge of the box leaves it there.
    let direction = DVec3::new(0.3127, 0.1931, 0.9301);
    for rho in [0.9, 0.99, 1.0] {
        let (mut error, mut worst) = (0.0_f64, 0);
        for edges in [1_u32, 2, 4, 8, 16, 64] {
            let got = radiance(boxed(rho).scene()?, Some(edges), DVec3::ZERO, direction, 65_536)?;
            let want = series(rho, edges as i32);
            if (got / want - 1.0).abs() > error {
                (error, worst) = ((got / want - 1.0).abs(), edges);
            }
        }
        let name = format!("mirror box, rho {rho}, 1 to 64 edges");
        let told = format!("worst at {worst} edges");
        // Roulette beyond 8 events ends paths by what the mirrors absorb: 65536 paths leave some parts in a thousand at 64 edges.
        let law = "L = sum of rho^k, k below the number of edges";
        rows.error(&name, law, "geometric series", told, error, 1e-2, None);
    }
    let got = radiance(boxed(0.9).scene()?, None, DVec3::ZERO, direction, 65_536)?;
    rows.value("mirror box, rho 0.9, no limit", "L = 1/(1 - rho)", 10.0, got, 1e-2);
    let image = render(&boxed(1.0), 4)?.film.image();
    let told = format!("finite: {}", is_finite(&image));
    rows.holds(
        "mirror box, rho 1, no limit",
        "ends: by roulette, which keeps the mean, or at 512 events",
        "finite",
        told,
        is_finite(&image),
    );
    let mut settings = quick(64, 0.25);
    settings.max_depth = Some(Some(8));
    let cut = rooms::picture(boxed(1.0).scene()?, &settings)?.counts.truncated_share();
    rows.value("mirror box, rho 1, 8 edges", "the weight cut is reported: all of every path", 1.0, cut, 2e-2);
    Ok(())
}

/// B18: glass within glass in a furnace of radiance 2.
pub fn nested_glass(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let middle = DVec3::new(0.1, 0.0, 0.2);
    let glass_with = |inside: &[(f64, f64)]| {
        let mut room = furnace(0.5);
        let glass = room.glass(1.5);
        room.sphere(middle, 0.5, glass);
        for &(radius, eta) in inside {
            let material = room.glass(eta);
            room.sphere(middle, radius, material);
        }
        room
    };
    let cases = [
        ("water in glass, one surface of relative index", glass_with(&[(0.3, 1.33 / 1.5)])),
        ("water in glass, air gap of 1e-4", glass_with(&[(0.3, 1.0 / 1.5), (0.2999, 1.33)])),
        ("water in glass, two surfaces in one place", glass_with(&[(0.3, 1.0 / 1.5), (0.3, 1.33)])),
    ];
    for (name, room) in cases {
        let mut points = Vec::new();
        let mut got = 0.0;
        for spp in [16_u32, 64, 256] {
            got = mean(&render(&room, spp)?.film.image());
            points.push((f64::from(spp), (got / 2.0 - 1.0).abs().max(1e-16)));
        }
        let error = (got / 2.0 - 1.0).abs();
        let curve = Some(Curve { axis: "samples per pixel", points });
        rows.error(name, "furnace: mean radiance 2, as without glass", "2", figure(got), error, 1e-3, curve);
    }
    Ok(())
}

/// B19: a camera in a cube of glass. A ray none of whose direction cosines reaches that of the critical angle never leaves.
pub fn light_trap(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    const SIDE: usize = 16;
    let mut room = Room::new(DVec3::new(0.05, -0.1, 0.02), DVec3::new(0.05, -0.1, 1.0), SIDE);
    let glass = room.glass(1.5);
    add_block(&mut room, DVec3::ZERO, 1.0, glass);
    room.surround(1.0);
    let rendered = render(&room, 256)?;
    let image = rendered.film.image();
    // cos² of the critical angle is 1 - 1/n²; a direction (u, v, 1) has at most 1/(1 + u² + v²).
    let limit = 1.0 / (1.0 - 1.0 / 2.25) - 1.0;
    let (mut trapped, mut lit, mut free) = (0, 0, Vec::new());
    for (i, pixel) in image.pixels().iter().enumerate() {
        let off_axis = |k: usize| (2.0 * (k as f64 + 0.5) / SIDE as f64 - 1.0).abs();
        let (u, v, half) = (off_axis(i % SIDE), off_axis(i / SIDE), 1.0 / SIDE as f64);
        if (u - half).powi(2) + (v - half).powi(2) > limit {
            trapped += 1;
            lit += usize::from(*pixel != [0.0; 3]);
        } else if (u + half).powi(2) + (v + half).powi(2) < limit {
            free.push(f64::from(pixel[1]));
        }
    }
    let name = "in a cube of glass, surroundings of radiance 1";
    let law = "where the light is trapped: exactly black";
    rows.holds(name, law, "0 lit pixels", format!("{lit} of {trapped}"), lit == 0 && trapped > 10);
    let got = free.iter().sum::<f64>() / free.len() as f64;
    rows.value(name, "elsewhere: mean radiance n² = 2.25", 2.25, got, 5e-3);
    let mut settings = quick(16, 0.25);
    settings.max_depth = Some(Some(8));
    let share = rooms::picture(room.scene()?, &settings)?.counts.truncated_share();
    // A trapped path keeps its whole weight: 64 pixels and more of 256.
    let law = "limit of 8 edges: the weight cut is reported, at least that of the trapped paths";
    let least = f64::from(trapped) / (SIDE * SIDE) as f64;
    rows.holds(name, law, &format!("above {least}"), figure(share), share >= least);
    let counts = rendered.counts;
    let each = (counts.reflected + counts.transmitted) as f64 / counts.camera as f64;
    let law = "rays a camera ray: branches only for 3 events, chains of 512 at most";
    rows.holds(name, law, "at most 8 · 512", format!("{each:.0}"), each <= 4096.0);
    Ok(())
}
