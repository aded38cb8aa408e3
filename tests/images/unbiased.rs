//! The path tracer against Mitsuba's: no bias in any part of the picture, and an error that falls as it must.

use crate::support::{Shot, reference, reference_folder, rendered, rendered_with};
use twopass::film::io::read_exr;
use twopass::integrator::Method;
use twopass::math::SamplerKind;
use twopass::metrics::block_test::{FEWEST_REPLICAS, MUST_PASS, Reference, block_test};
use twopass::metrics::{Comparison, compare};

/// Welch's t-test on means of 4x4 pixels; `passes` stands in the reference's PROVENANCE.toml.
fn is_unbiased(scene: &'static str, method: Method, spp: u32, passes: u32) {
    let shot = |seed| Shot { spp, method, seed, ..Shot::new(scene) };
    let replicas: Vec<_> = (1..=FEWEST_REPLICAS as u64).map(|seed| rendered(&shot(seed)).film.image()).collect();
    let [a, b] = reference(scene);
    let variance = read_exr(&reference_folder(scene).join("var.exr")).expect("the reference is there");
    let test = block_test(&replicas, &Reference { halves: [&a, &b], variance: &variance, passes }).expect("comparable");
    let worst: Vec<_> = test.failing().take(5).collect();
    println!("{scene}, {}: {:.3} % pass", method.name(), 100.0 * test.share_passing());
    assert!(test.passes(), "{scene}: {} of the blocks pass, expected {MUST_PASS}; (pixel, t): {worst:?}", test.share_passing());
}

#[test]
fn path_tracing_is_unbiased_in_the_cornell_box() {
    is_unbiased("cornell-box", Method::Path, 8, 138);
}

/// Whatever pass one has wrong: it is a control variate.
#[test]
fn two_passes_can_be_unbiased() {
    is_unbiased("cornell-box", Method::TwoPassUnbiased, 8, 138);
}

/// Caustics and light behind a door are found from the lamps, and all ways to make a path share it.
#[test]
fn walks_from_both_ends_are_unbiased() {
    is_unbiased("cornell-box", Method::Bidirectional, 4, 138);
    is_unbiased("cornell-glass", Method::Bidirectional, 8, 44);
    is_unbiased("door-ajar", Method::Bidirectional, 16, 356);
}

/// Slope of log relmse over log samples, by least squares over powers of two.
fn slope(sampler: SamplerKind) -> f64 {
    let [a, b] = reference("cornell-box");
    let mut points: Vec<(f64, f64)> = Vec::new();
    let shot = Shot { spp: 64, method: Method::Path, sampler, ..Shot::new("cornell-box") };
    rendered_with(&shot, &mut |film, _, _| {
        let n = film.n_passes();
        if n >= 4 && n.is_power_of_two() {
            let comparison = Comparison { image: &film.image(), a: &a, b: Some(&b), left_out: None, emitters: None };
            points.push((f64::from(n).ln(), compare(&comparison).expect("comparable").relmse.ln()));
        }
    });
    let n = points.len() as f64;
    let [x, y] = [points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n];
    let covariance: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    covariance / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}

/// The variance of a mean of n independent samples is 1/n of theirs.
#[test]
fn the_error_of_independent_samples_falls_as_one_over_their_number() {
    let slope = slope(SamplerKind::Independent);
    println!("independent: slope {slope:.4}");
    assert!((slope + 1.0).abs() <= 0.05, "slope {slope}, expected -1 within 0.05");
}

/// Stratified samples are no worse than independent ones in any smooth part of the integrand.
#[test]
fn the_error_of_sobol_samples_falls_at_least_as_fast() {
    let slope = slope(SamplerKind::Sobol);
    println!("sobol: slope {slope:.4}");
    assert!(slope <= -0.95, "slope {slope}, expected -0.95 at most");
}
