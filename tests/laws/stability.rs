//! The stiff and extreme cases: the quick ones of `twopass stability`, and what it writes.

use twopass::math::Rgb;
use twopass::stability::rooms::{furnace, picture, quick, solve_gathered};
use twopass::stability::{Row, Verdict, ids, page, run_some};

/// Those that take a second at most; the whole catalogue is a command.
const QUICK: [&str; 11] = ["B2", "B3", "B4", "B5", "B7", "B9", "B13", "B15", "B16", "B20", "B22"];

fn rows() -> Vec<Row> {
    run_some(&QUICK, &mut |_| {})
}

#[test]
fn the_catalogue_holds() {
    let rows = rows();
    let failed: String = rows.iter().filter(|r| r.verdict == Verdict::Fails).map(page::line).collect();
    assert!(failed.is_empty(), "{failed}");
    assert!(QUICK.iter().all(|id| rows.iter().any(|r| r.id == *id)), "a case gave no row");
}

#[test]
fn the_catalogue_is_complete() {
    let want: Vec<String> = (1..=24).map(|k| format!("B{k}")).collect();
    assert_eq!(ids(), want);
}

#[test]
fn table_and_page_hold_every_row() {
    let rows = run_some(&["B2", "B3", "B13"], &mut |_| {});
    let csv = page::csv(&rows);
    assert_eq!(csv.lines().count(), rows.len() + 1, "{csv}");
    assert!(csv.lines().skip(1).all(|line| line.contains(",holds,")), "{csv}");
    let html = page::html(&rows, "0");
    assert_eq!(html.matches("<tr class=").count(), rows.len());
    // Nothing from elsewhere: the page works from a file, without a network.
    assert!(!html.contains("http") && !html.contains("src=") && !html.contains("<script"), "the page asks for something");
    assert!(html.contains(&format!("{} hold, 0 fail", rows.len())));
}

fn lit_image(emission: f64) -> Vec<f64> {
    let mut room = twopass::stability::rooms::lit(0.6, 12);
    let lamp = room.source.shapes.last_mut().expect("a lamp");
    lamp.emission = twopass::material::Texture::Constant(Rgb::grey(emission));
    let image = picture(room.scene().expect("valid"), &quick(4, 0.4)).expect("renders").film.image();
    image.pixels().iter().flatten().map(|v| f64::from(*v)).collect()
}

/// [physical_checks.csv power_scale_pow2, power_scale_1e6]
#[test]
fn brightness_only_scales() {
    let one = lit_image(5.0);
    for (scale, bound) in [(2.0_f64.powi(-20), 0.0), (2.0_f64.powi(20), 0.0), (1e-6, 1e-6), (1e6, 1e-6)] {
        let scaled = lit_image(5.0 * scale);
        let error = scaled.iter().zip(&one).map(|(s, o)| (s - o * scale).abs() / (o * scale).max(f64::MIN_POSITIVE));
        let error = error.fold(0.0, f64::max);
        assert!(error <= bound, "emission times {scale}: worst pixel differs by {error:e}");
    }
}

/// [physical_checks.csv channel_independence]
#[test]
fn channels_do_not_mix() {
    let solved = |rho: Rgb| {
        let mut room = furnace(0.0);
        room.source.materials[0].material =
            twopass::material::Material::Diffuse { reflectance: twopass::material::Texture::Constant(rho) };
        let mut settings = quick(1, 0.5);
        settings.pass_one.solver.tolerance = 1e-9;
        let pass_one = solve_gathered(room.scene().expect("valid"), &settings).expect("solves").pass_one;
        (0..pass_one.field.patches.len()).map(|i| pass_one.field.radiosity(i)).collect::<Vec<Rgb>>()
    };
    let coloured = solved(Rgb::new(0.1, 0.5, 0.9));
    for (channel, rho) in [0.1, 0.5, 0.9].into_iter().enumerate() {
        for (c, g) in coloured.iter().zip(solved(Rgb::grey(rho))) {
            assert!((c[channel] / g[channel] - 1.0).abs() < 1e-6, "channel {channel}: {} and {}", c[channel], g[channel]);
        }
    }
}
