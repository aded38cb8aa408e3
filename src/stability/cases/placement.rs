//! Where a scene lies and how large it is must not matter; light that only grazes gives nothing.

use crate::film::Image;
use crate::light::Light;
use crate::load::{LoadOptions, load_scene};
use crate::math::{DVec3, Rgb};
use crate::pipeline::probe::Prober;
use crate::pipeline::{RenderSettings, solve};
use crate::progress::silent;
use crate::scene::LightSource;
use crate::stability::rooms::{self, Room, furnished, mean, probing, quick};
use crate::stability::{Rows, Trouble, figure};

fn image(room: &Room, settings: &RenderSettings) -> Result<Image, Trouble> {
    Ok(rooms::picture(room.scene()?, settings)?.film.image())
}

/// B10: the origin is far away.
pub fn far_away(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let room = furnished(24);
    let settings = quick(16, 0.3);
    let here = mean(&image(&room, &settings)?);
    for distance in [1e3, 1e4, 1e5, 1e6] {
        let there = room.moved(1.0, DVec3::new(distance, -distance, 0.5 * distance));
        let got = mean(&image(&there, &settings)?);
        rows.value(&format!("moved by {distance:.0e}"), "mean of the picture as at the origin", here, got, 1e-3);
    }
    single_precision_far_away(rows)
}

/// A mesh file that stores f32 cannot hold detail below an ulp of its coordinates.
fn single_precision_far_away(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let folder = tempfile::tempdir()?;
    let corner = |x: f32, y: f32| format!("{} {} 1000000\n", 1e6 + x, 1e6 + y);
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let ply =
        header.to_owned() + &corner(0.0, 0.0) + &corner(0.02, 0.0) + &corner(0.02, 0.02) + &corner(0.0, 0.02) + "4 0 1 2 3\n";
    std::fs::write(folder.path().join("far.ply"), ply)?;
    let scene = "<scene version=\"3.0.0\"><sensor type=\"perspective\"/><shape type=\"ply\"><string name=\"filename\" \
                 value=\"far.ply\"/></shape></scene>";
    let path = folder.path().join("scene.xml");
    std::fs::write(&path, scene)?;
    let law = "f32 coordinates at 1e6 (ulp 0.0625) with a detail of 0.02: warned of";
    match load_scene(&path, &LoadOptions::default()) {
        Ok(loaded) => {
            let warnings = loaded.scene.warnings.join("; ");
            let is_told = warnings.contains("no area") || warnings.contains("ulp") || warnings.contains("precision");
            rows.holds(
                "PLY in f32, far away",
                law,
                "a warning",
                if warnings.is_empty() { "none".into() } else { warnings },
                is_told,
            );
        }
        Err(error) => rows.holds("PLY in f32, far away", law, "a warning", error.to_string(), true),
    }
    Ok(())
}

/// B11: scenes of any size.
pub fn small_and_large(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let room = furnished(24);
    let plain = image(&room, &quick(16, 0.25))?;
    for exponent in [-14, -3, 5, 13] {
        let scale = 2.0_f64.powi(exponent);
        let scaled = image(&room.moved(scale, DVec3::ZERO), &quick(16, 0.25 * scale))?;
        let differing = scaled.pixels().iter().zip(plain.pixels()).filter(|(a, b)| a != b).count();
        let told = format!("{differing} pixels differ");
        rows.holds(&format!("scaled by 2^{exponent}"), "the picture is the same", "same bits", told, differing == 0);
    }
    for scale in [1e-4, 1e-2, 3.0, 1e4] {
        let scaled = image(&room.moved(scale, DVec3::ZERO), &quick(16, 0.25 * scale))?;
        let law = "mean of the picture as unscaled";
        rows.value(&format!("scaled by {scale:.0e}"), law, mean(&plain), mean(&scaled), 1e-4);
    }
    Ok(())
}

/// B22: light in the plane of what it would light.
pub fn grazing_light(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let floor = || {
        let mut room = Room::new(DVec3::new(0.0, 1.0, 0.0), DVec3::ZERO, 16);
        let grey = room.grey(0.5);
        room.quad(DVec3::new(-1.0, 0.0, -1.0), DVec3::Z * 2.0, DVec3::X * 2.0, grey, 0.0);
        room
    };
    let mut coplanar = floor();
    let black = coplanar.grey(0.0);
    coplanar.quad(DVec3::new(1.5, 0.0, -0.5), DVec3::Z, DVec3::X, black, 100.0);
    let mut grazing = floor();
    grazing.source.lights.push(LightSource::Directional { direction: DVec3::X, irradiance: Rgb::WHITE });
    let mut level = floor();
    level.point_light(DVec3::new(3.0, 0.0, 0.0), 10.0);
    for (name, room) in [
        ("lamp in the floor's plane", coplanar),
        ("parallel light along the floor", grazing),
        ("point light at floor level", level),
    ] {
        let scene = room.scene()?;
        let is_lit = !scene.lights.iter().all(Light::is_dark);
        let pixels = rooms::picture(scene.clone(), &quick(4, 0.5))?.film.image();
        let solved = solve(scene, &quick(1, 0.5), &mut silent)?;
        let at: Vec<_> = [-0.9, 0.0, 0.9].map(|x| (DVec3::new(x, 0.0, 0.1), DVec3::Y)).to_vec();
        let prober = Prober { world: &solved.world, pass_one: &solved.pass_one, settings: probing(None), samples: 1024 };
        let brightest = prober.irradiance(&at).0.iter().map(|p| p.total.max()).fold(0.0, f64::max);
        let seen = pixels.pixels().iter().flatten().all(|v| *v == 0.0);
        let told = format!("irradiance {}, picture black: {seen}", figure(brightest));
        rows.holds(name, "exactly no light on the floor", "0", told, is_lit && seen && brightest == 0.0);
    }
    Ok(())
}
