//! Uniform enclosures, where the answer is known without a reference.

use crate::support::{furnace, quick, run};
use twopass::integrator::ReadOut;

/// [physical_checks.csv furnace_uniform_*]: radiance L_e/(1 - rho) in every pixel, with any number of gather samples.
#[test]
fn every_pixel_of_the_furnace_has_its_radiance() {
    for rho in [0.5, 0.9] {
        for read_out in [ReadOut::Stored, ReadOut::DirectStored, ReadOut::FinalGather, ReadOut::Progressive] {
            for gather_rays in [1, 3] {
                let mut settings = quick(2, 0.25);
                settings.read_out = Some(read_out);
                settings.gather_rays = gather_rays;
                let rendered = run(furnace(rho).scene(), &settings);
                let want = 1.0 / (1.0 - rho);
                for pixel in rendered.film.image().pixels() {
                    let got = f64::from(pixel[1]);
                    assert!(
                        (got / want - 1.0).abs() < 1e-3,
                        "rho {rho}, {read_out:?}, {gather_rays} rays: {got}, expected {want}"
                    );
                }
            }
        }
    }
}

/// Two edges carry one reflection: 1 + rho, also by the default method, which has no pass one to read then.
#[test]
fn two_edges_carry_one_reflection() {
    let mut settings = quick(2, 0.25);
    settings.max_depth = Some(Some(2));
    for pixel in run(furnace(0.5).scene(), &settings).film.image().pixels() {
        assert!((f64::from(pixel[1]) - 1.5).abs() < 1e-4, "{}, expected 1.5", pixel[1]);
    }
}

/// A closed scene keeps its light: what is emitted is absorbed.
#[test]
fn power_is_conserved_in_a_closed_scene() {
    let rendered = run(furnace(0.7).scene(), &quick(1, 0.3));
    let power = rendered.pass_one.expect("pass one ran").power;
    assert!(power.unaccounted.abs() < 1e-5, "{power:?}");
    assert!((power.emitted / (24.0 * std::f64::consts::PI * 3.0) - 1.0).abs() < 1e-6, "{power:?}");
}
