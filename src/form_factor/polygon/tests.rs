use super::*;
use crate::form_factor::analytic;
use crate::math::Sampler;
use serde_json::Value;

/// Exact values by closed forms in 60 digits, each checked by a second method; see tests/data/README.md.
const CASES: &str = include_str!("../../../tests/data/form_factor_cases.csv");

fn rectangle(corner: DVec3, e1: DVec3, e2: DVec3) -> Vec<DVec3> {
    vec![corner, corner + e1, corner + e1 + e2, corner + e2]
}

fn corners(value: &Value) -> Vec<DVec3> {
    let point = |p: &Value| DVec3::from_array(std::array::from_fn(|i| p[i].as_f64().unwrap()));
    value.as_array().unwrap().iter().map(point).collect()
}

/// The two polygons of a row that has such.
fn polygons(geometry: &Value) -> Option<[Vec<DVec3>; 2]> {
    let get = |name: &str| geometry[name].as_f64().unwrap();
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    match geometry["type"].as_str().unwrap() {
        "parallel_rect" => {
            let (a, b, c) = (get("a"), get("b"), get("c"));
            Some([rectangle(DVec3::ZERO, a * x, b * y), rectangle(c * z, b * y, a * x)])
        }
        "perp_rect_common_edge" => {
            let (l, w, h) = (get("l"), get("w"), get("h"));
            Some([rectangle(DVec3::ZERO, w * x, l * y), rectangle(DVec3::ZERO, l * y, h * z)])
        }
        "cube" => Some([rectangle(DVec3::ZERO, x, y), rectangle(z, y, x)]),
        "polygon_pair" => Some([corners(&geometry["P"]), corners(&geometry["Q"])]),
        _ => None,
    }
}

fn rows() -> Vec<(String, Value, f64)> {
    let mut reader = csv::Reader::from_reader(CASES.as_bytes());
    let rows = reader.records().map(|row| {
        let row = row.unwrap();
        (row[0].to_owned(), serde_json::from_str(&row[1]).unwrap(), row[2].parse().unwrap())
    });
    rows.collect()
}

/// A turn about no axis of the polygons, and a shift.
fn somewhere(p: DVec3) -> DVec3 {
    glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.83) * p + DVec3::new(0.3, -2.0, 1.1)
}

#[test]
fn every_finite_polygon_of_the_table() {
    let mut found = 0;
    for (name, geometry, want) in rows() {
        let Some([p, q]) = polygons(&geometry) else { continue };
        found += 1;
        let turned = |polygon: &[DVec3]| polygon.iter().copied().map(somewhere).collect::<Vec<_>>();
        for (place, p, q) in [("as given", p.clone(), q.clone()), ("turned", turned(&p), turned(&q))] {
            let area = Polygon::new(&p).unwrap().area();
            for (tolerance, allowed) in [(1e-11, 1e-9), (1e-6, 1e-6), (1e-3, 1e-3)] {
                // A gap of 1e-6 is lost in the coordinates of a place 2 away, up to 2e-10 of them.
                let allowed: f64 = if place == "turned" && name.contains("e-6") { 4e-10_f64.max(allowed) } else { allowed };
                let got = transfer(&p, &q, tolerance) / area;
                assert!((got / want - 1.0).abs() < allowed, "{name} {place} at {tolerance}: {got}, expected {want}");
                let back = transfer(&q, &p, tolerance) / area;
                assert!(
                    (back / got - 1.0).abs() < 1e-9_f64.max(tolerance),
                    "{name} {place} at {tolerance}: {got}, backwards {back}"
                );
            }
        }
    }
    assert_eq!(found, 29, "finite polygons of the table");
}

/// Pairs of triangles at random places against Lambert's formula, exact at each point, under a product rule.
#[test]
fn random_triangles_agree_with_lambert_under_quadrature() {
    let mut compared = 0;
    for k in 0..400 {
        let mut sampler = Sampler::new(1, 0, k);
        let mut point = || DVec3::from_array([0; 3].map(|_| f64::from(sampler.next_1d())));
        let p = [point(), point(), point()];
        let shift = DVec3::Z * (1.05 + 2.0 * (k % 7) as f64);
        let q = [point() + shift, point() + shift, point() + shift];
        let (Some(one), Some(two)) = (Polygon::new(&p), Polygon::new(&q)) else { continue };
        let got = transfer(&p, &q, 1e-9);
        // Lambert's formula is exact at each point of p; it is smooth there where q does not cross the horizon.
        let crosses =
            q.iter().any(|c| one.normal().dot(*c - p[0]) < 0.02) || p.iter().any(|c| two.normal().dot(*c - q[0]) < 0.02);
        if crosses || got < 1e-9 {
            continue;
        }
        let rule = gauss::rule(16);
        let mut want = 0.0;
        for (v, weight_v) in rule.nodes() {
            for (u, weight_u) in rule.nodes() {
                let at = p[0] + (p[1] - p[0]) * (u * (1.0 - v)) + (p[2] - p[0]) * v;
                want += weight_u * weight_v * (1.0 - v) * 2.0 * one.area() * analytic::point_to_polygon(at, one.normal(), &q);
            }
        }
        compared += 1;
        assert!((got / want - 1.0).abs() < 1e-7, "pair {k}: {got}, expected {want}");
    }
    assert!(compared > 30, "{compared} pairs compared");
}

/// What is behind the other's plane takes no part, and cutting there changes nothing.
#[test]
fn polygons_across_each_others_horizon_are_clipped() {
    let floor = rectangle(DVec3::ZERO, DVec3::X, DVec3::Y);
    let (low, high) = (DVec3::new(1.0, 0.0, -0.7), DVec3::new(1.0, 0.0, 1.0));
    let through = rectangle(low, high - low, DVec3::Y);
    let above = rectangle(DVec3::X, DVec3::Z, DVec3::Y);
    let want = analytic::perpendicular_rectangles(1.0, 1.0, 1.0);
    for (name, wall) in [("through", &through), ("above", &above)] {
        let got = transfer(&floor, wall, 1e-10);
        assert!((got / want - 1.0).abs() < 1e-9, "{name}: {got}, expected {want}");
    }
    assert_eq!(transfer(&floor, &rectangle(DVec3::Z, DVec3::X, DVec3::Y), 1e-10), 0.0, "turned away");
    assert_eq!(transfer(&floor, &rectangle(DVec3::X, DVec3::Y, DVec3::X), 1e-10), 0.0, "in one plane");
}

/// Far pairs: the exact value is known from the point kernel, up to (h/R)². There the contour integral alone would lose all digits.
#[test]
fn far_pairs_keep_their_digits() {
    for distance in [30.0, 1e3, 1e5] {
        let p = rectangle(DVec3::ZERO, DVec3::X, DVec3::Y);
        let q = rectangle(DVec3::Z * distance, DVec3::Y, DVec3::X);
        let kernel = 1.0 / (std::f64::consts::PI * distance * distance);
        let got = transfer(&p, &q, 1e-11);
        // Of two unit squares the mean of the squared lateral distance is 1/3, which counts twice in 1/r⁴.
        let want = kernel * (1.0 - 2.0 / (3.0 * distance * distance));
        assert!((got / want - 1.0).abs() < 1e-11 + 3.0 / distance.powi(4), "{distance}: {got}, expected {want}");
    }
}

/// A strip halved is the sum of its halves, also when it is a thousand times as long as wide.
#[test]
fn transfers_add_up() {
    let skew = |p: DVec3| glam::DQuat::from_rotation_x(0.4) * glam::DQuat::from_rotation_y(-2.9) * p + DVec3::new(0.2, 0.1, 0.9);
    for (length, width) in [(1.0, 1.0), (1000.0, 1.0), (1.0, 1e-3)] {
        let p = rectangle(DVec3::ZERO, DVec3::X * length, DVec3::Y * width);
        let of = |from: f64, to: f64| -> Vec<DVec3> {
            let strip = rectangle(DVec3::X * from, DVec3::X * (to - from), DVec3::Y * width);
            strip.into_iter().map(skew).collect()
        };
        let whole = transfer(&p, &of(0.0, length), 1e-10);
        let parts = transfer(&p, &of(0.0, 0.3 * length), 1e-10) + transfer(&p, &of(0.3 * length, length), 1e-10);
        assert!(whole > 0.0 && (parts / whole - 1.0).abs() < 1e-8, "{length} x {width}: {whole}, in parts {parts}");
    }
}
