//! Meshes as they should not be: slivers, triangles without area, copies, wedges, junctions, gaps.

use crate::accel::AccelKind;
use crate::film::Image;
use crate::form_factor::analytic::{parallel_rectangles, perpendicular_rectangles};
use crate::geometry::tessellate::{self, Triangles};
use crate::geometry::{Ray, Soup};
use crate::integrator::drive::Budget;
use crate::math::{DAffine3, DVec3, Sampler, Vec3};
use crate::pipeline::{RenderSettings, solve};
use crate::progress::silent;
use crate::scene::SurfaceSource;
use crate::stability::oracle;
use crate::stability::rooms::{self, Room, lit, mean, quick, rectangle, solve_gathered};
use crate::stability::{Rows, Trouble, figure};
use std::sync::Arc;

/// Index of the floor among the walls of a room.
const FLOOR: usize = 2;

/// The floor of [`lit`].
const FLOOR_PLACE: (DVec3, DVec3, DVec3) = (DVec3::new(-1.0, -1.0, -1.0), DVec3::new(0.0, 0.0, 2.0), DVec3::new(2.0, 0.0, 0.0));

fn settings() -> RenderSettings {
    let mut settings = quick(64, 0.25);
    settings.pass_one.form_factor_tolerance = 0.005;
    settings
}

fn image(room: &Room, settings: &RenderSettings) -> Result<Image, Trouble> {
    Ok(rooms::picture(room.scene()?, settings)?.film.image())
}

/// The floor cut across x at the given shares of its width.
fn cut_floor(shares: &[f64]) -> Triangles {
    let (corner, z, x) = FLOOR_PLACE;
    let mut floor = Triangles::default();
    for share in shares {
        floor.positions.extend([corner + x * *share, corner + x * *share + z]);
    }
    for k in (0..2 * (shares.len() as u32 - 1)).step_by(2) {
        floor.triangles.extend([[k, k + 1, k + 3], [k, k + 3, k + 2]]);
    }
    floor
}

fn with_floor(floor: Triangles) -> Room {
    let mut room = lit(0.6, 16);
    room.source.shapes[FLOOR].surface = SurfaceSource::Triangles(floor);
    room
}

/// B6: a floor of slivers is a floor.
pub fn slivers(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    // Samples go elsewhere where patches differ, so the noise of the two means is not the same: it must be small.
    let settings = RenderSettings { budget: Budget { spp: Some(512), ..Budget::default() }, ..settings() };
    let whole = image(&with_floor(cut_floor(&[0.0, 1.0])), &settings)?;
    let strips: Vec<f64> = (0..=1000).map(|k| f64::from(k) / 1000.0).collect();
    for (name, shares) in [("1000 slivers of aspect 1e3", strips), ("a sliver of aspect 1e6", vec![0.0, 0.4, 0.400001, 1.0])] {
        let room = with_floor(cut_floor(&shares));
        let scene = room.scene()?;
        rows.value(name, "areas sum to the whole", 4.0, scene.shapes[FLOOR].area(), 1e-12);
        let cut = image(&room, &settings)?;
        rows.value(name, "mean of the picture as with a floor of two triangles", mean(&whole), mean(&cut), 1e-3);
        let finite = rooms::is_finite(&cut);
        rows.holds(name, "no NaN", "finite", format!("finite: {finite}"), finite);
    }
    Ok(())
}

/// B7: triangles without area change nothing.
pub fn without_area(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let plain = lit(0.6, 16);
    let mut spoilt = plain.clone();
    let mut added = 0;
    for shape in &mut spoilt.source.shapes {
        if let SurfaceSource::Triangles(t) = &mut shape.surface {
            // Two equal corners, three equal corners, three on a line.
            let middle = t.positions.len() as u32;
            t.positions.push(0.5 * (t.positions[0] + t.positions[1]));
            if !t.uvs.is_empty() {
                t.uvs.push(0.5 * (t.uvs[0] + t.uvs[1]));
            }
            t.triangles.splice(0..0, [[0, 1, 1]]);
            t.triangles.insert(1, [2, 2, 2]);
            t.triangles.push([0, middle, 1]);
            added += 3;
        }
    }
    let scene = spoilt.scene()?;
    let law = "triangles of zero area, two equal corners or three on a line are dropped and counted";
    let dropped = scene.dropped_triangles;
    rows.holds("in every shape, lamp included", law, &added.to_string(), dropped.to_string(), dropped == added);
    let told = scene.warnings.iter().filter(|w| w.contains("have no area")).count();
    rows.holds("in every shape, lamp included", "warned of", "a warning a shape", format!("{told} warnings"), told == added / 3);
    let same = image(&plain, &settings())? == image(&spoilt, &settings())?;
    rows.holds("in every shape, lamp included", "the picture is the same", "same bits", format!("same bits: {same}"), same);
    Ok(())
}

/// B8: a mesh given twice.
pub fn duplicates(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let plain = lit(0.6, 16);
    let reference = image(&plain, &settings())?;
    let mut doubled = plain.clone();
    for shape in &mut doubled.source.shapes {
        if let SurfaceSource::Triangles(t) = &mut shape.surface {
            t.triangles.extend(t.triangles.clone());
        }
    }
    let warned = doubled.scene()?.warnings.iter().filter(|w| w.contains("repeat another one")).count();
    let law = "every triangle of a mesh given twice: dropped, with a warning";
    rows.holds("copies within meshes", law, "7 warnings", format!("{warned} warnings"), warned == 7);
    let same = image(&doubled, &settings())? == reference;
    rows.holds("copies within meshes", "the picture is the same", "same bits", format!("same bits: {same}"), same);
    // As two shapes: the copy of the floor lies in the floor.
    let mut twice = plain.clone();
    let mut floor = twice.source.shapes[FLOOR].clone();
    floor.id = "again".to_owned();
    twice.source.shapes.push(floor);
    let told = twice.scene()?.warnings.join("; ");
    rows.holds(
        "the floor as two shapes",
        "warned of: its area would count twice",
        "a warning",
        told.clone(),
        told.contains("repeat those of shape"),
    );
    let got = mean(&image(&twice, &settings())?);
    rows.value("the floor as two shapes", "no shadow of itself: the mean of the picture stays", mean(&reference), got, 2e-3);
    // Lies in the floor as well, but has other triangles and covers a part of it only.
    let mut rug = plain.clone();
    let grey = rug.source.shapes[FLOOR].material;
    rug.quad(DVec3::new(-0.7, -1.0, -0.6), DVec3::Z * 1.1, DVec3::X * 0.9, grey, 0.0);
    let area = |room: &Room| -> Result<(f64, f64), Trouble> {
        let patches = solve(room.scene()?, &settings(), &mut silent)?.pass_one.field.patches;
        Ok((patches.area.iter().sum(), patches.given_twice))
    };
    let ((whole, none), (with_rug, twice)) = (area(&plain)?, area(&rug)?);
    let law = "hidden parts are no area of pass one: the sum stays that of the room";
    rows.value("a rug in the floor's own plane", law, whole, with_rug, 2e-3);
    let told = format!("{} m², and {} without it", figure(twice), figure(none));
    rows.holds(
        "a rug in the floor's own plane",
        "told of: 0.99 m² are given twice",
        "0.99 m²",
        told,
        (twice - 0.99).abs() < 0.05 && none == 0.0,
    );
    let got = mean(&image(&rug, &settings())?);
    rows.value("a rug in the floor's own plane", "the mean of the picture stays", mean(&reference), got, 2e-3);
    // Within 100 copies of one triangle a traversal that descends into all of them would take 100 times as long.
    let mut many = plain;
    for k in 0..100 {
        let mut floor = many.source.shapes[FLOOR].clone();
        floor.id = format!("again{k}");
        many.source.shapes.push(floor);
    }
    let got = mean(&image(&many, &quick(4, 1.0))?);
    rows.holds("the floor as 101 shapes", "ends, finite", "finite", figure(got), got.is_finite());
    Ok(())
}

/// B9: form factors of patches that touch.
pub fn touching_patches(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let [opposite, adjacent] = oracle::cube_faces(40);
    let law = "closed form = quadrature";
    rows.value("cube, faces that share an edge", law, adjacent, perpendicular_rectangles(1.0, 1.0, 1.0), 1e-6);
    rows.value("cube, opposite faces", law, opposite, parallel_rectangles(1.0, 1.0, 1.0), 1e-6);
    let mut settings = quick(1, 1e5);
    settings.pass_one.form_factor_tolerance = 0.002;
    for degrees in [90.0_f64, 10.0, 1.0, 0.1] {
        const LENGTH: f64 = 4.0;
        let angle = degrees.to_radians();
        let (sin, cos) = angle.sin_cos();
        let mut room = Room::new(DVec3::new(0.5, 1.0, 0.0), DVec3::ZERO, 4);
        let grey = room.grey(0.5);
        let along = DVec3::Z * LENGTH;
        room.quad(DVec3::ZERO, along, DVec3::X, grey, 1.0);
        room.quad(DVec3::ZERO, DVec3::new(cos, sin, 0.0), along, grey, 0.0);
        let pass_one = solve_gathered(room.scene()?, &settings)?.pass_one;
        let factors = pass_one.form_factors.rows().expect("cast rays are kept as rows");
        let name = format!("wedge of {degrees} degrees");
        let long = oracle::finite_wedge(angle, 4000.0);
        rows.value(&name, "infinite strips: 1 - sin(a/2) = quadrature at 4 km", oracle::wedge(angle), long, 1e-3);
        let want = oracle::finite_wedge(angle, LENGTH);
        // Three standard errors of 8192 rays, an eighth of what a patch of the full size casts; and rays that start where the wedge is lower than they are lifted off the surface.
        let bound = 3.0 * (want * (1.0 - want) / 8192.0).sqrt() + 5e-6 / angle;
        rows.value(&name, "strips of 4 m: F by 8192 rays = quadrature", want, factors.direct_sum(0), bound / want);
        let closes = (0..2).map(|i| (factors.direct_sum(i) + pass_one.outside.escaped(i).g - 1.0).abs()).fold(0.0, f64::max);
        rows.value(&name, "0 <= F <= 1, rows close", 0.0, closes.max(factors.direct_sum(0) - 1.0), 1e-6);
    }
    Ok(())
}

/// B12: edges that meet elsewhere than at corners, and walls that do not quite meet.
pub fn junctions_and_gaps(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    // The floor is cut at places that its neighbours do not know.
    let shares = [0.0, 0.137, 0.291, 0.5003, 0.77, 1.0];
    let leak = |room: &Room| -> Result<f64, Trouble> {
        let mut settings = quick(1, 0.25);
        settings.pass_one.form_factor_tolerance = 0.005;
        let power = solve(room.scene()?, &settings, &mut silent)?.pass_one.power;
        Ok(power.escaped / power.emitted)
    };
    let law = "power that escapes over power emitted";
    rows.value("T-junctions along the floor", law, 0.0, leak(&with_floor(cut_floor(&shares)))?, 1e-5);
    let one_ulp = f64::from(f32::from_bits(1.0_f32.to_bits() + 1) - 1.0);
    for (name, gap) in [("floor lower by an ulp", one_ulp), ("floor lower by 1e-6", 1e-6)] {
        let (corner, z, x) = FLOOR_PLACE;
        rows.value(name, law, 0.0, leak(&with_floor(rectangle(corner - DVec3::Y * gap, z, x)))?, 1e-5);
    }
    watertight(rows)
}

/// Rays from inside a closed mesh towards its edges and corners.
fn watertight(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    const RAYS: u64 = 1 << 21;
    let place = DAffine3::from_translation(DVec3::new(0.3, -0.2, 0.7));
    let ball = tessellate::sphere(&place, 24);
    let soup = Soup {
        vertices: ball.positions.iter().map(|p| p.as_vec3()).collect(),
        triangles: ball.triangles.clone(),
        ..Soup::default()
    };
    let accel = crate::accel::build(Arc::new(soup), AccelKind::default())?;
    let origin = Vec3::new(0.31, -0.19, 0.72);
    let missed = |k: u64| {
        let mut sampler = Sampler::new(12, k / 4096, k % 4096);
        let (pick, share) = (sampler.next_2d(), sampler.next_1d());
        let t = ball.triangles[(pick.x * ball.triangles.len() as f32) as usize % ball.triangles.len()];
        let side = (pick.y * 3.0) as usize % 3;
        let [a, b] = [t[side], t[(side + 1) % 3]].map(|i| ball.positions[i as usize].as_vec3());
        // A quarter of them aim at corners.
        let share = if k.is_multiple_of(4) { 0.0 } else { share };
        accel.intersect(&Ray::new(origin, a + (b - a) * share - origin)).is_none()
    };
    let misses = (0..RAYS).filter(|&k| missed(k)).count();
    let told = format!("{misses} of {RAYS}");
    rows.holds("closed mesh, rays at its edges and corners", "no ray gets out", "0 misses", told, misses == 0);
    Ok(())
}
