//! The estimators of `twopass compare` as estimators: unbiased, and with standard errors that are the spread.

use twopass::film::Image;
use twopass::math::Sampler;
use twopass::math::sampler::mix;
use twopass::metrics::{Comparison, Metrics, compare};

const SIDE: usize = 96;
const REPLICAS: u64 = 48;

/// What the perfect picture shows: a ramp from 0.2 to 1.4.
fn truth(x: usize, y: usize) -> f64 {
    0.2 + 1.2 * (x + y) as f64 / (2 * SIDE - 2) as f64
}

/// The truth times `factor`, with uniform noise of full width `spread` times the truth.
fn noisy(factor: f64, spread: f64, seed: u64) -> Image {
    let pixel = |i: usize| {
        let mut sampler = Sampler::new(mix(seed), i as u64, 0);
        let value = truth(i % SIDE, i / SIDE);
        std::array::from_fn(|_| (value * (factor + spread * (f64::from(sampler.next_1d()) - 0.5))) as f32)
    };
    Image::from_pixels(SIDE, SIDE, (0..SIDE * SIDE).map(pixel).collect())
}

/// Relative error of 10 % everywhere, seen against references of which each pixel is uncertain by 17 %.
fn replicas() -> Vec<Metrics> {
    let image = noisy(1.1, 0.0, 0);
    let replica = |k: u64| {
        let (a, b) = (noisy(1.0, 0.6, 2 * k + 1), noisy(1.0, 0.6, 2 * k + 2));
        compare(&Comparison { image: &image, a: &a, b: Some(&b), left_out: None, emitters: None }).expect("compares")
    };
    (0..REPLICAS).map(replica).collect()
}

fn mean_and_spread(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt())
}

/// The cross product of two noisy halves estimates the squared error without the halves' own noise, and leaving out the pixels in
/// which they differ most does not make a picture look better.
#[test]
fn the_cross_product_has_no_bias_and_trimming_favours_nobody() {
    let found = replicas();
    let get = |f: fn(&Metrics) -> f64| mean_and_spread(&found.iter().map(f).collect::<Vec<f64>>());
    let n = (REPLICAS as f64).sqrt();
    let pixels = || (0..SIDE * SIDE).map(|i| truth(i % SIDE, i / SIDE).powi(2));
    let mse = 0.01 * pixels().sum::<f64>() / (SIDE * SIDE) as f64;
    let (mean, spread) = get(|m| m.mse);
    assert!((mean - mse).abs() < 3.0 * spread / n, "mse {mean} +- {}, true {mse}", spread / n);
    // One reference alone would add its variance, 0.36/12 of the square of the truth: three times the error itself.
    assert!(spread / n < 0.01 * mse, "a bias of some hundredths would be missed: {}", spread / n);
    let (relmse, spread) = get(|m| m.relmse);
    let (trimmed, _) = get(|m| m.trimmed_relmse.expect("two references"));
    assert!(trimmed > relmse - 3.0 * spread / n, "trimmed {trimmed} below {relmse} +- {}", spread / n);
}

/// A standard error is what a figure varies by from one pair of references to the next.
#[test]
fn standard_errors_are_the_spread_over_replicas() {
    let found = replicas();
    let check = |name: &str, figure: fn(&Metrics) -> f64, error: fn(&Metrics) -> f64| {
        let (_, spread) = mean_and_spread(&found.iter().map(figure).collect::<Vec<f64>>());
        let (told, _) = mean_and_spread(&found.iter().map(error).collect::<Vec<f64>>());
        // The spread over 48 replicas is itself known to 1/sqrt(2 * 47) = 10 %, the bootstrap over 36 to 64 blocks to as much.
        assert!((told / spread - 1.0).abs() < 0.4, "{name}: told {told}, spread {spread}");
    };
    check("relmse", |m| m.relmse, |m| m.relmse_se);
    check("trimmed", |m| m.trimmed_relmse.expect("two"), |m| m.standard_errors.trimmed_relmse.expect("two"));
    check("mean ratio", |m| m.mean_ratio[1], |m| m.standard_errors.mean_ratio[1]);
    check("blocks", |m| m.block9_rms, |m| m.standard_errors.block9_rms);
}
