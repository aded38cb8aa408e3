//! Formulas against values by hand and against numpy.

use super::*;

fn flat(value: f32) -> Image {
    Image::from_pixels(2, 1, vec![[value; 3]; 2])
}

fn judge(image: &Image, a: &Image, b: Option<&Image>) -> Metrics {
    compare(&Comparison { image, a, b, left_out: None, emitters: None }).unwrap()
}

fn assert_close(name: &str, got: f64, want: f64) {
    // The pictures are f32: a relative 6e-8 a value, a few times larger in differences.
    let tolerance = 2e-6 * want.abs();
    assert!((got - want).abs() <= tolerance, "{name}: {got}, expected {want} +- {tolerance}");
}

#[test]
fn a_picture_has_no_error_against_itself() {
    let [_, a, _] = fixture();
    let m = judge(&a, &a, None);
    assert_eq!([m.mse, m.rmse, m.relmse, m.relmse_se, m.block9_rms], [0.0; 5]);
    assert_eq!(m.mean_ratio, [1.0; 3]);
    assert!(!m.below_reference_noise);
    let black = flat(0.0);
    assert_eq!(judge(&black, &black, None).mean_ratio, [1.0; 3]);
}

#[test]
fn a_flat_picture_by_hand() {
    // I = 1.5, A = B = 1: (0.5)² = 0.25; relative 0.25/1.01; blocks 0.25/1.0001.
    let m = judge(&flat(1.5), &flat(1.0), None);
    assert_close("mse", m.mse, 0.25);
    assert_close("rmse", m.rmse, 0.5);
    assert_close("relmse", m.relmse, 0.25 / 1.01);
    assert_close("block9_rms", m.block9_rms, (0.25_f64 / 1.0001).sqrt());
    assert_eq!(m.mean_ratio, [1.5; 3]);
    assert_eq!(m.trimmed_relmse, None);
}

#[test]
fn the_cross_product_cancels_independent_noise_and_may_be_negative() {
    // I = 1 lies between A = 1.1 and B = 0.9: -0.01.
    let m = judge(&flat(1.0), &flat(1.1), Some(&flat(0.9)));
    assert_close("mse", m.mse, -0.01);
    assert_close("rmse", m.rmse, -0.1);
    assert!(m.below_reference_noise);
    // Both references on one side: an error that both see.
    assert!(judge(&flat(2.0), &flat(1.1), Some(&flat(0.9))).mse > 0.0);
}

/// I, A and B of 23x19 pixels, from whole numbers, rounded to f32.
fn fixture() -> [Image; 3] {
    let build = |value: &dyn Fn(usize, usize, usize) -> f64| {
        let pixel = |i: usize| std::array::from_fn(|c| value(i % 23, i / 23, c) as f32);
        Image::from_pixels(23, 19, (0..23 * 19).map(pixel).collect())
    };
    let r = |x, y, c| 0.05 + ((7 * x + 11 * y + 5 * c) % 23) as f64 / 10.0;
    let wave = |v: usize, n: usize| (v % n) as f64 / (n / 2) as f64 - 1.0;
    let image = build(&|x, y, c| r(x, y, c) * (1.0 + 0.2 * wave(2 * x + 7 * y + c, 13)) + 0.01);
    let a = build(&|x, y, c| r(x, y, c) * (1.0 + 0.1 * wave(3 * x + 5 * y + c, 7)));
    let b = build(&|x, y, c| r(x, y, c) * (1.0 + 0.1 * wave(5 * x + 2 * y + 3 * c, 11)));
    [image, a, b]
}

/// Expected values: numpy in f64 on these pictures rounded to f32, window and blocks by slices cut at the border
/// (`ref[max(0,y-2):y+3, max(0,x-2):x+3].mean((0,1))`), the trimmed pixels by a stable argsort (4 of 437).
#[test]
fn two_references_as_numpy_computes_them() {
    let [image, a, b] = fixture();
    let m = judge(&image, &a, Some(&b));
    assert_close("mse", m.mse, 0.027252737413752153);
    assert_close("relmse", m.relmse, 0.02099950060916886);
    assert_close("trimmed", m.trimmed_relmse.unwrap(), 0.021134460379808595);
    assert_close("block9", m.block9_rms, 0.02231870303392398);
    for (c, want) in [1.00463506, 1.01269948, 1.01063496].into_iter().enumerate() {
        assert_close("mean ratio", m.mean_ratio[c], want);
    }
}

#[test]
fn one_reference_as_numpy_computes_it() {
    let [image, a, _] = fixture();
    let m = judge(&image, &a, None);
    assert_close("mse", m.mse, 0.035602985990240976);
    assert_close("relmse", m.relmse, 0.027440538849204724);
    assert_close("block9", m.block9_rms, 0.02966785394901797);
}

#[test]
fn a_mask_leaves_pixels_out_of_every_figure_but_not_of_the_local_mean() {
    let [image, a, b] = fixture();
    let inside = |i: usize| (5..12).contains(&(i % 23)) && (3..9).contains(&(i / 23));
    let mask = Mask::from_values(23, 19, (0..23 * 19).map(inside).collect());
    let comparison = Comparison { image: &image, a: &a, b: Some(&b), left_out: Some(&mask), emitters: None };
    let m = compare(&comparison).unwrap();
    assert_close("mse", m.mse, 0.02707891194880494);
    assert_close("relmse", m.relmse, 0.020842070664952844);
    assert_close("block9", m.block9_rms, 0.023433898073582055);
    assert_close("ratio", m.mean_ratio[0], 1.00286867);
    assert_eq!(m.n_pixels, 23 * 19 - 42);

    let m = compare(&Comparison { left_out: None, emitters: Some(&mask), ..comparison }).unwrap();
    assert_close("relmse", m.relmse, 0.02099950060916886);
    assert_close("off emitters", m.relmse_off_emitters.unwrap(), 0.020842070664952844);
}

#[test]
fn a_nan_is_counted_and_shows_in_the_figures() {
    let [mut image, a, b] = fixture();
    image.pixels_mut()[30] = [f32::NAN, 0.0, 0.0];
    image.pixels_mut()[40] = [f32::INFINITY, 0.0, 0.0];
    let m = judge(&image, &a, Some(&b));
    assert_eq!((m.n_not_finite, m.first_not_finite), (2, Some((7, 1))));
    assert!(m.mse.is_nan() && m.relmse.is_nan() && m.block9_rms.is_nan() && m.relmse_se.is_nan());
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let [image, a, b] = fixture();
    let small = flat(1.0);
    let comparison = Comparison { image: &image, a: &a, b: Some(&small), left_out: None, emitters: None };
    let size = MetricsError::Size { what: "reference B", found: (2, 1), expected: (23, 19) };
    assert_eq!(compare(&comparison), Err(size));

    let all = Mask::from_values(23, 19, vec![true; 23 * 19]);
    assert_eq!(compare(&Comparison { b: Some(&b), left_out: Some(&all), ..comparison }), Err(MetricsError::Empty));

    let mut bad = a.clone();
    bad.pixels_mut()[24] = [0.0, f32::NAN, 0.0];
    let refused = compare(&Comparison { a: &bad, b: Some(&b), ..comparison });
    assert_eq!(refused, Err(MetricsError::NotFinite { what: "reference A", x: 1, y: 1 }));
}

/// Noise of known size in both halves: the estimate stays within three standard errors of the true error, while the square
/// against one half alone carries that half's variance.
#[test]
fn noise_of_the_references_does_not_bias_the_error() {
    let n = 128;
    let mut state = 1_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let mut noisy = |mean: f64, spread: f64| {
        let pixels = (0..n * n).map(|_| std::array::from_fn(|_| (mean + spread * uniform()) as f32)).collect();
        Image::from_pixels(n, n, pixels)
    };
    let (image, a, b) = (noisy(1.1, 0.0), noisy(1.0, 0.5), noisy(1.0, 0.5));
    let truth = 0.01 / 1.01;
    let both = judge(&image, &a, Some(&b));
    assert!((both.relmse - truth).abs() < 3.0 * both.relmse_se, "{} +- {}, true {truth}", both.relmse, both.relmse_se);
    let single = judge(&image, &a, None);
    let variance = 0.25 / 12.0 / 1.01;
    assert!((single.relmse - truth - variance).abs() < 3.0 * single.relmse_se + 1e-3, "{}", single.relmse);
    // Leaving out where the references differ most cannot favour the picture: not below the estimate by more than its error.
    assert!(both.trimmed_relmse.unwrap() > both.relmse - 3.0 * both.relmse_se);
}
