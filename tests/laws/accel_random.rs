//! Random geometry and random rays, and the cost of rays that mean nothing.
//!
//! The judge is the triangle test itself, applied to every triangle in turn: a tree must find the same primitive at the same t, to
//! the last bit, and a batch too. A longer run: `TWOPASS_FUZZ_SECONDS=600 cargo test --release --test laws random_geometry`, for so
//! many seconds of processor time.

use std::sync::Arc;
use std::time::Duration;

use nix::time::{ClockId, clock_gettime};
use twopass::accel::{Accel, AccelKind, build};
use twopass::geometry::triangle::ShearedRay;
use twopass::geometry::{Hit, Ray, Soup, Sphere};
use twopass::math::{Sampler, Vec3};

fn below(s: &mut Sampler, n: usize) -> usize {
    ((s.next_1d() * n as f32) as usize).min(n - 1)
}

fn in_cube(s: &mut Sampler) -> Vec3 {
    2.0 * Vec3::new(s.next_1d(), s.next_1d(), s.next_1d()) - 1.0
}

/// Ten to a power between `low` and `high`.
fn magnitude(s: &mut Sampler, low: f32, high: f32) -> f32 {
    10.0_f32.powf(low + (high - low) * s.next_1d())
}

/// Up to 16,000 primitives: free or over shared vertices, on a grid or not, slivers, points, copies, spheres, far away, tiny or
/// huge, some not numbers at all.
fn random_soup(case: u64) -> Soup {
    let mut s = Sampler::new(case, 0, 0);
    let n_triangles = (magnitude(&mut s, 0.0, 4.2) as usize).max(1);
    let n_vertices = [3 * n_triangles, n_triangles / 2 + 3, 8][below(&mut s, 3)];
    let (scale, size) = (magnitude(&mut s, -9.0, 9.0), magnitude(&mut s, -3.0, 0.5));
    let offset = if s.next_1d() < 0.3 { scale * magnitude(&mut s, 0.0, 6.0) * in_cube(&mut s) } else { Vec3::ZERO };
    let (on_grid, flat) = (s.next_1d() < 0.4, s.next_1d() < 0.2);
    let mut soup = Soup::default();
    for i in 0..n_vertices as u64 {
        let mut s = Sampler::new(case, 1, i);
        let near = if i % 3 == 0 || s.next_1d() < 0.1 { None } else { soup.vertices.last().copied() };
        let random = in_cube(&mut s);
        let mut p = near.map_or(random, |last: Vec3| (last - offset) / scale + size * random);
        if on_grid {
            p = (8.0 * p).round() / 8.0;
        }
        if flat {
            p.y = 0.25;
        }
        let broken = if s.next_1d() < 1e-3 { [f32::NAN, f32::INFINITY][below(&mut s, 2)] } else { 0.0 };
        soup.vertices.push(p * scale + offset + broken);
    }
    for i in 0..n_triangles as u64 {
        let mut s = Sampler::new(case, 2, i);
        let in_order = [0, 1, 2].map(|corner| (3 * i as usize + corner) % n_vertices);
        let corners = if n_vertices == 3 * n_triangles { in_order } else { [0; 3].map(|_| below(&mut s, n_vertices)) };
        soup.triangles.push(corners.map(|corner| corner as u32));
    }
    if s.next_1d() < 0.3 {
        let radius = scale * magnitude(&mut s, -3.0, 0.0);
        let mut sphere = || Sphere { center: scale * in_cube(&mut s) + offset, radius };
        soup.spheres = (0..n_triangles / 4).map(|_| sphere()).collect();
    }
    soup
}

/// A ray anywhere, at a vertex, at an edge, or along an axis; from anywhere or from a vertex.
fn random_ray(soup: &Soup, bounds: (Vec3, Vec3), s: &mut Sampler) -> Ray {
    let (center, reach) = bounds;
    let vertex = |s: &mut Sampler| soup.vertices[below(s, soup.vertices.len())];
    let origin = if s.next_1d() < 0.2 { vertex(s) } else { center + 1.5 * reach * in_cube(s) };
    let target = match below(s, 4) {
        0 => vertex(s),
        1 => {
            let [a, b, _] = soup.corners(below(s, soup.triangles.len()));
            a + (b - a) * s.next_1d()
        }
        _ => center + reach * in_cube(s),
    };
    let mut ray = Ray::new(origin, target - origin);
    if s.next_1d() < 0.2 {
        ray.direction = Vec3::AXES[below(s, 3)] * if s.next_1d() < 0.5 { 1.0 } else { -1.0 };
    }
    if s.next_1d() < 0.3 {
        ray.t_max = 2.0 * s.next_1d();
    }
    ray
}

/// The nearest hit of lowest index, by the triangle and sphere tests alone.
fn nearest(soup: &Soup, is_finite: &[bool], ray: &Ray) -> Option<Hit> {
    let valid = Ray { t_min: ray.t_min.max(0.0), ..*ray };
    if !ray.is_valid() || valid.t_min >= valid.t_max {
        return None;
    }
    let sheared = ShearedRay::new(&valid);
    let mut best: Option<Hit> = None;
    for primitive in (0..soup.len() as u32).filter(|&i| is_finite[i as usize]) {
        let n_triangles = soup.triangles.len() as u32;
        let t = if primitive < n_triangles {
            let [a, b, c] = soup.corners(primitive as usize);
            sheared.intersect(a, b, c, valid.t_min, valid.t_max).map(|t| t.max(own_box(&valid, [a, b, c], t)))
        } else {
            soup.spheres[(primitive - n_triangles) as usize].intersect(&valid, valid.t_min, valid.t_max)
        };
        best = t
            .filter(|&t| t < valid.t_max)
            .map(|t| Hit { t, primitive })
            .filter(|hit| best.is_none_or(|best| hit.t < best.t))
            .or(best);
    }
    best
}

/// Where the ray enters the triangle's own box, if that is behind `t` by more than rounding; else before all.
///
/// The t of a triangle seen edge-on is as uncertain as the triangle is deep and may lie before the box. A tree that has found another
/// hit between the two need not look into the box any more, so such a hit counts as lying where the box begins.
fn own_box(ray: &Ray, [a, b, c]: [Vec3; 3], t: f32) -> f32 {
    let entered = |axis: usize| {
        let (low, high) = (a.min(b).min(c)[axis], a.max(b).max(c)[axis]);
        let first = if ray.direction[axis].is_sign_positive() { low } else { high };
        (first - ray.origin[axis]) * ray.direction[axis].recip()
    };
    let enter = (0..3).map(entered).filter(|t| !t.is_nan()).fold(f32::NEG_INFINITY, f32::max);
    if enter > t * (1.0 + 1.0 / (1 << 19) as f32) { enter } else { f32::NEG_INFINITY }
}

/// Builds all engines over one random scene and sends rays through them.
fn try_case(case: u64) {
    let soup = Arc::new(random_soup(case));
    let is_finite = |i: u32| {
        let b = soup.bounds_of(i);
        b.min.is_finite() && b.max.is_finite()
    };
    let is_finite: Vec<bool> = (0..soup.len() as u32).map(is_finite).collect();
    let finite = soup.vertices.iter().copied().filter(|v| v.is_finite());
    let (low, high) = finite.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let bounds = (0.5 * low + 0.5 * high, Vec3::splat((high - low).max_element().max(1e-12)));
    let mut s = Sampler::new(case, 3, 0);
    let rays: Vec<Ray> = (0..300).map(|_| random_ray(&soup, bounds, &mut s)).collect();
    for kind in AccelKind::ALL.into_iter().filter(|kind| kind.is_available() && *kind != AccelKind::BruteForce) {
        let engine = build(soup.clone(), kind).expect("engine is in this build");
        let (mut hits, mut occluded) = (vec![None; rays.len()], vec![false; rays.len()]);
        engine.intersect_batch(&rays, &mut hits);
        engine.occluded_batch(&rays, &mut occluded);
        for ((ray, of_batch), occluded) in rays.iter().zip(hits).zip(occluded) {
            let hit = engine.intersect(ray);
            if kind == AccelKind::Embree {
                // Its own triangle test: only what holds whatever that says.
                let holds = |h: Hit| (h.primitive as usize) < soup.len() && h.t > ray.t_min.max(0.0) && h.t < ray.t_max;
                assert!(hit.is_none_or(holds) && of_batch.is_none_or(holds), "{kind}, case {case}: {hit:?} of {ray:?}");
                continue;
            }
            let expected = nearest(&soup, &is_finite, ray);
            let corners = || expected.map(|e| soup.corners((e.primitive as usize).min(soup.triangles.len() - 1)));
            assert_eq!(hit, expected, "{kind}, case {case}: of all primitives in turn, {ray:?}, {:?}", corners());
            assert_eq!(of_batch, hit, "{kind}, case {case}: batch, {ray:?}");
            assert_eq!((engine.occluded(ray), occluded), (hit.is_some(), hit.is_some()), "{kind}, case {case}: {ray:?}");
        }
    }
}

#[test]
fn random_geometry_gives_what_all_primitives_in_turn_give() {
    let seconds = std::env::var("TWOPASS_FUZZ_SECONDS").ok().and_then(|text| text.parse().ok());
    let (start, at_least) = (cpu_time(), Duration::from_secs(seconds.unwrap_or(0)));
    let mut case = std::env::var("TWOPASS_FUZZ_FROM").ok().and_then(|text| text.parse().ok()).unwrap_or(0);
    let first = case;
    while case < first + 100 || cpu_time() - start < at_least {
        try_case(case);
        case += 1;
    }
    println!("random scenes {first} to {case}");
}

/// CPU time of this thread: other work on the machine does not count.
fn cpu_time() -> Duration {
    clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).expect("Linux has this clock").into()
}

/// Least time of a few runs.
fn least_time(mut run: impl FnMut()) -> f64 {
    let mut one = || {
        let start = cpu_time();
        run();
        (cpu_time() - start).as_secs_f64()
    };
    (0..7).map(|_| one()).fold(f64::INFINITY, f64::min)
}

/// The bound is that of Embree's own tests.
#[test]
fn meaningless_rays_cost_no_more_than_two_and_a_half_times_as_much_as_others() {
    const BOUND: f64 = 2.5;
    let mut soup = Soup::default();
    for i in 0..2000 {
        let mut s = Sampler::new(11, i, 0);
        let p = in_cube(&mut s);
        soup.vertices.extend([p, p + 0.1 * in_cube(&mut s), p + 0.1 * in_cube(&mut s)]);
        soup.triangles.push([0, 1, 2].map(|corner| 3 * i as u32 + corner));
    }
    let soup = Arc::new(soup);
    let good: Vec<Ray> = (0..20_000)
        .map(|i| {
            let mut s = Sampler::new(12, i, 0);
            Ray::new(1.5 * in_cube(&mut s), in_cube(&mut s))
        })
        .collect();
    for kind in AccelKind::ALL.into_iter().filter(|kind| kind.is_available()) {
        let engine = build(soup.clone(), kind).expect("engine is in this build");
        let stride = if kind == AccelKind::BruteForce { 100 } else { 1 };
        let good: Vec<Ray> = good.iter().copied().step_by(stride).collect();
        let time = |rays: &[Ray]| cost(engine.as_ref(), rays);
        let usual = time(&good);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for part in 0..4 {
                let spoil = |(index, ray): (usize, &Ray)| {
                    let mut ray = *ray;
                    match part {
                        0 => ray.origin[index % 3] = bad,
                        1 => ray.direction[index % 3] = bad,
                        2 => ray.t_min = bad,
                        // Every other ray, so that batches hold both kinds.
                        _ if index % 2 == 0 => ray.direction = Vec3::splat(bad),
                        _ => {}
                    }
                    ray
                };
                let spoilt: Vec<Ray> = good.iter().enumerate().map(spoil).collect();
                // A start before all is no fault: such a ray is an ordinary one.
                for (form, (cost, usual)) in
                    ["single", "any-hit", "batch", "any-hit batch"].iter().zip(time(&spoilt).into_iter().zip(usual))
                {
                    assert!(cost <= BOUND * usual, "{kind}, {form}, {bad} in part {part}: {cost} s, others {usual} s");
                }
            }
        }
    }
}

/// Seconds for all rays: one by one, any-hit one by one, and both as batches.
fn cost(engine: &dyn Accel, rays: &[Ray]) -> [f64; 4] {
    let (mut hits, mut occluded) = (vec![None; rays.len()], vec![false; rays.len()]);
    [
        least_time(|| rays.iter().zip(&mut hits).for_each(|(ray, hit)| *hit = engine.intersect(ray))),
        least_time(|| rays.iter().zip(&mut occluded).for_each(|(ray, answer)| *answer = engine.occluded(ray))),
        least_time(|| engine.intersect_batch(rays, &mut hits)),
        least_time(|| engine.occluded_batch(rays, &mut occluded)),
    ]
}
