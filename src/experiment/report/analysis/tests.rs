use super::*;

fn curve(points: &[(f64, f64)]) -> Vec<Point> {
    let point = |&(time, error)| Point { time, times: [time; 2], error, errors: [error; 2], predicted: None, rows: Vec::new() };
    points.iter().map(point).collect()
}

fn law(times: &[f64], error: impl Fn(f64) -> f64) -> Vec<Point> {
    curve(&times.iter().map(|&t| (t, error(t))).collect::<Vec<_>>())
}

const TIMES: [f64; 7] = [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0];

fn assert_close(got: f64, expected: f64, tolerance: f64) {
    assert!((got - expected).abs() <= tolerance * expected.abs(), "got {got}, expected {expected}");
}

#[test]
fn a_median_is_the_middle() {
    assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
    assert_eq!(median([4.0, 1.0, 3.0, 2.0]), Some(2.5));
    assert_eq!(median([f64::NAN, 7.0]), Some(7.0));
    assert_eq!(median([]), None);
    assert_eq!(range([2.0, f64::NAN, -1.0, 5.0]), Some([-1.0, 5.0]));
}

#[test]
fn a_crossing_lies_where_the_law_says() {
    // error = 0.2 / t comes to 0.03 at t = 0.2/0.03.
    let points = law(&TIMES, |t| 0.2 / t);
    let Reach::At { time } = reach(&points, 0.03) else { panic!("not reached") };
    assert_close(time, 0.2 / 0.03, 1e-12);
    // 0.4 is the error at the first time, 0.00625 at the last; what is beyond is not made up.
    assert_eq!(reach(&points, 0.5), Reach::Before { time: 0.5 });
    assert_eq!(reach(&points, 0.006), Reach::Not);
    assert_eq!(reach(&points, 0.00625), Reach::At { time: 32.0 });
    assert_eq!(reach(&[], 1.0), Reach::Not);
}

#[test]
fn an_error_counts_as_reached_only_if_it_stays() {
    // Below 1 at t = 2, above it again, below for good between 4 and 8: log-log middle of (4, 2) and (8, 0.5).
    let points = curve(&[(1.0, 4.0), (2.0, 0.9), (4.0, 2.0), (8.0, 0.5)]);
    let Reach::At { time } = reach(&points, 1.0) else { panic!("not reached") };
    assert_close(time, 32_f64.sqrt(), 1e-12);
    // A negative estimate has no logarithm: its own time is a safe answer.
    assert_eq!(reach(&curve(&[(1.0, 4.0), (3.0, -0.1)]), 1.0), Reach::At { time: 3.0 });
}

#[test]
fn errors_at_a_time_are_interpolated_and_never_extrapolated() {
    let points = law(&TIMES, |t| 0.2 / t);
    assert_close(error_at(&points, 3.0).unwrap(), 0.2 / 3.0, 1e-12);
    assert_close(error_at(&points, 0.5).unwrap(), 0.4, 1e-12);
    assert_close(error_at(&points, 32.0).unwrap(), 0.00625, 1e-12);
    assert_eq!(error_at(&points, 0.49), None);
    assert_eq!(error_at(&points, 33.0), None);
    assert_eq!(error_at(&curve(&[(1.0, 0.1), (4.0, -0.1)]), 2.0), None);
}

#[test]
fn a_power_law_has_its_exponent_as_slope() {
    let root = slope(&law(&TIMES, |t| 3.0 / t.sqrt()), &[]).unwrap();
    assert_close(root.value, -0.5, 1e-12);
    assert!(root.se.unwrap() < 1e-12);
    // Of 0.5 to 32 s the last decade holds 4, 8, 16 and 32.
    assert_eq!(root.points, 4);
    // What was before does not count.
    let bent = law(&TIMES, |t| if t < 3.2 { 7.0 } else { 1.0 / t });
    assert_close(slope(&bent, &[]).unwrap().value, -1.0, 1e-12);
    assert_eq!(slope(&law(&[1.0], |t| t), &[]), None);
}

#[test]
fn the_standard_error_of_a_slope_is_that_of_the_textbook() {
    // ln e = y at ln t = 0, 1, 2: y = 0, -1.3, -2. Slope -1; residuals 0.1, -0.2, 0.1; s^2 = 0.06/1; S_xx = 2.
    let e = std::f64::consts::E;
    let points = curve(&[(1.0, 1.0), (e, (-1.3_f64).exp()), (e * e, (-2.0_f64).exp())]);
    let got = slope(&points, &[]).unwrap();
    assert_close(got.value, -1.0, 1e-12);
    assert_close(got.se.unwrap(), 0.03_f64.sqrt(), 1e-9);
    // Three runs with slopes -0.9, -1, -1.1: standard deviation 0.1, standard error 0.1/sqrt 3.
    let run = |s: f64| vec![(1.0, 1.0), (4.0, 4_f64.powf(s))];
    let got = slope(&points, &[run(-0.9), run(-1.0), run(-1.1)]).unwrap();
    assert_close(got.se.unwrap(), 0.1 / 3_f64.sqrt(), 1e-9);
    assert_eq!(got.runs, 3);
}

#[test]
fn a_floor_is_found_where_there_is_one() {
    let fit = floor(&law(&TIMES, |t| 0.004 + 0.1 / t)).unwrap();
    assert_close(fit.floor, 0.004, 1e-6);
    assert_close(fit.scale, 0.1, 1e-6);
    assert!(fit.distinguishable);
    // 3 % of scatter by a fixed pattern: the floor stays within its own interval.
    let pattern = [1.03, 0.97, 1.02, 0.98, 0.97, 1.03, 0.99];
    let noisy: Vec<_> = TIMES.iter().zip(pattern).map(|(&t, s)| (t, s * (0.004 + 0.1 / t))).collect();
    let fit = floor(&curve(&noisy)).unwrap();
    assert!(fit.distinguishable && fit.upper > 0.004 && 2.0 * fit.floor - fit.upper < 0.004, "{fit:?}");
}

#[test]
fn no_floor_is_claimed_where_there_is_none() {
    let exact = floor(&law(&TIMES, |t| 0.1 / t)).unwrap();
    assert!(!exact.distinguishable && exact.floor < 1e-8, "{exact:?}");
    // Falls faster than 1/t: the free fit would be negative.
    let steep = floor(&law(&TIMES, |t| 0.1 / t.powf(1.2))).unwrap();
    assert_eq!(steep.floor, 0.0);
    assert!(!steep.distinguishable);
    let pattern = [1.1, 0.9, 1.05, 0.95, 0.92, 1.08, 1.0];
    let noisy: Vec<_> = TIMES.iter().zip(pattern).map(|(&t, s)| (t, s * 0.1 / t)).collect();
    assert!(!floor(&curve(&noisy)).unwrap().distinguishable);
    assert_eq!(floor(&curve(&[(1.0, 0.1), (2.0, 0.05)])), None);
}

#[test]
fn one_wild_point_does_not_move_a_floor() {
    let mut points = law(&TIMES, |t| 0.004 + 0.1 / t);
    points[3].error *= 3.0;
    assert_close(floor(&points).unwrap().floor, 0.004, 0.05);
}

#[test]
fn predictions_are_judged_by_factors() {
    // Factors 1, 1.5, 3, 1/3, 10: median 1.5; two within 2; four within 4. A negative estimate says nothing.
    let pairs = [(1.0, 1.0), (3.0, 2.0), (3.0, 1.0), (1.0, 3.0), (10.0, 1.0), (1.0, -1.0)];
    let expected = Prediction { count: 5, factor: 1.5, within_2: 0.4, within_4: 0.8 };
    assert_eq!(prediction(pairs), Some(expected));
    assert_eq!(prediction([]), None);
}

#[test]
fn levels_are_halves_of_decades() {
    assert_eq!(half_decades(0.02, 1.0), [0.03, 0.1, 0.3, 1.0]);
    assert_eq!(half_decades(1.0, 35.0), [1.0, 3.0, 10.0, 30.0]);
    assert!(half_decades(-1.0, 1.0).is_empty() && half_decades(0.4, 0.9).is_empty());
}
