//! What every engine must do alike: one suite, run on all engines of this build, with brute force in f64 as the judge.

use std::sync::Arc;

use twopass::accel::{Accel, AccelKind, build};
use twopass::geometry::{Hit, Ray, Soup, Sphere};
use twopass::math::Vec3;

/// The engines of this build.
fn kinds() -> impl Iterator<Item = AccelKind> {
    AccelKind::ALL.into_iter().filter(|kind| kind.is_available())
}

/// The engines that keep every rule to the last bit. Embree's robust mode is watertight at edges only, and reports any of several
/// hits at equal t.
fn exact(kind: AccelKind) -> bool {
    kind != AccelKind::Embree
}

fn built(soup: &Arc<Soup>, kind: AccelKind) -> Box<dyn Accel> {
    build(soup.clone(), kind).expect("engine is in this build")
}

/// Random numbers by SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// In [0, 1).
    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }

    /// In the cube [-1, 1)³.
    fn point(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

/// Closed star-shaped surface with bumps around the origin, `20 * 4^levels` triangles over shared vertices.
fn bumpy_sphere(levels: u32) -> Soup {
    let phi = 0.5 * (1.0 + 5.0_f32.sqrt());
    let mut vertices: Vec<Vec3> = Vec::new();
    for (a, b) in [(-1.0, phi), (1.0, phi), (-1.0, -phi), (1.0, -phi)] {
        vertices.extend([Vec3::new(a, b, 0.0), Vec3::new(0.0, a, b), Vec3::new(b, 0.0, a)]);
    }
    // The faces of an icosahedron are its triples of vertices at mutual distance 2.
    let near = |v: &[Vec3], a: usize, b: usize| (v[a] - v[b]).length() < 2.1;
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(&vertices, a, b) && near(&vertices, b, c) && near(&vertices, a, c) {
                    triangles.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    assert_eq!(triangles.len(), 20);
    for _ in 0..levels {
        triangles = split_in_four(&mut vertices, &triangles);
    }
    let bump = |p: Vec3| p * (1.0 + 0.1 * (9.0 * p.x).sin() * (7.0 * p.y).cos() * (8.0 * p.z).sin());
    Soup { vertices: vertices.into_iter().map(|v| bump(v.normalize())).collect(), triangles, spheres: Vec::new() }
}

fn split_in_four(vertices: &mut Vec<Vec3>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut middles = std::collections::HashMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
            vertices.push(0.5 * (vertices[a as usize] + vertices[b as usize]));
            vertices.len() as u32 - 1
        })
    };
    let mut parts = Vec::new();
    for &[a, b, c] in triangles {
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        parts.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    parts
}

/// The unit cube's inside, each wall cut into `k * k` squares of two triangles: axis-aligned, coplanar, all boxes flat.
fn tessellated_box(k: u32) -> Soup {
    let mut soup = Soup::default();
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            let base = soup.vertices.len() as u32;
            for (i, j) in (0..=k).flat_map(|i| (0..=k).map(move |j| (i, j))) {
                let mut p = Vec3::splat(side);
                p[(axis + 1) % 3] = i as f32 / k as f32;
                p[(axis + 2) % 3] = j as f32 / k as f32;
                soup.vertices.push(p);
            }
            for (i, j) in (0..k).flat_map(|i| (0..k).map(move |j| (i, j))) {
                let at = |di: u32, dj: u32| base + (i + di) * (k + 1) + j + dj;
                soup.triangles.extend([[at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]]);
            }
        }
    }
    soup
}

/// `n` small triangles and `n / 8` spheres in the cube [-1, 1]³.
fn clutter(n: usize, random: &mut Random) -> Soup {
    let mut soup = Soup::default();
    for i in 0..n as u32 {
        let p = random.point();
        soup.vertices.extend([p, p + 0.2 * random.point(), p + 0.2 * random.point()]);
        soup.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    let sphere = |random: &mut Random| Sphere { center: random.point(), radius: 0.01 + 0.1 * random.unit() };
    soup.spheres = (0..n / 8).map(|_| sphere(random)).collect();
    soup
}

/// Moves and scales all coordinates.
fn placed(mut soup: Soup, scale: f32, offset: Vec3) -> Soup {
    soup.vertices.iter_mut().for_each(|v| *v = *v * scale + offset);
    soup.spheres.iter_mut().for_each(|s| *s = Sphere { center: s.center * scale + offset, radius: s.radius * scale });
    soup
}

/// Bound on the difference of two t of one hit in f32 and in f64, in units of t: the sheared coordinates have 5 roundings of a
/// relative 2^-24, and a corner's depth varies over a triangle by at most its extent seen from the ray; 64 covers triangles
/// that are met at down to about 5 degrees.
const T_TOLERANCE: f32 = 64.0 * f32::EPSILON;

/// Compares an engine with brute force on one ray; true if they agree.
///
/// Equal misses, or the same primitive, or another one at the same t. `scale` is the size of coordinates in units of direction.
fn agree(found: Option<Hit>, expected: Option<Hit>, scale: f32) -> bool {
    match (found, expected) {
        (None, None) => true,
        (Some(a), Some(b)) => {
            (a.t - b.t).abs() <= T_TOLERANCE * (b.t.abs() + scale) * if a.primitive == b.primitive { 8.0 } else { 1.0 }
        }
        _ => false,
    }
}

#[test]
fn engines_agree_with_brute_force_on_clutter_of_every_size() {
    let mut random = Random(1);
    for n in [0, 1, 2, 3, 4, 5, 7, 8, 9, 31, 255, 256, 257, 2000] {
        let soup = Arc::new(clutter(n, &mut random));
        let oracle = built(&soup, AccelKind::BruteForce);
        for kind in kinds() {
            let engine = built(&soup, kind);
            let n_rays = 2_000;
            let mut differing = 0;
            for _ in 0..n_rays {
                let ray = Ray::new(1.5 * random.point(), random.point());
                let (found, expected) = (engine.intersect(&ray), oracle.intersect(&ray));
                assert_eq!(
                    engine.occluded(&ray),
                    found.is_some(),
                    "{kind}, {n} triangles: any-hit against nearest-hit of {ray:?}"
                );
                differing += usize::from(!agree(found, expected, 1.0));
            }
            // A random ray passes an edge within the f32 error of 1e-6 with a probability of about 1e-5 a triangle it meets.
            assert!(differing <= 1, "{kind}, {n} triangles: {differing} of {n_rays} rays differ from brute force");
        }
    }
}

#[test]
fn batches_answer_as_single_rays_do() {
    let mut random = Random(10);
    let soup = Arc::new(clutter(300, &mut random));
    let center = random.point();
    let mut rays: Vec<Ray> = (0..1000).map(|_| Ray::new(center, random.point())).collect();
    rays[17].direction.x = f32::NAN;
    for kind in kinds() {
        let engine = built(&soup, kind);
        let (mut hits, mut occluded) = (vec![None; rays.len()], vec![false; rays.len()]);
        engine.intersect_batch(&rays, &mut hits);
        engine.occluded_batch(&rays, &mut occluded);
        for ((ray, hit), occluded) in rays.iter().zip(hits).zip(occluded) {
            let alone = engine.intersect(ray);
            assert!(if exact(kind) { hit == alone } else { agree(hit, alone, 1.0) }, "{kind}: {hit:?} and alone {alone:?}");
            assert_eq!(occluded, alone.is_some(), "{kind}: {ray:?}");
        }
    }
}

#[test]
fn the_interval_of_a_ray_is_open_and_bounds_both_queries() {
    let mut random = Random(2);
    let soup = Arc::new(clutter(300, &mut random));
    for kind in kinds() {
        let engine = built(&soup, kind);
        for _ in 0..5_000 {
            let ray = Ray::new(1.5 * random.point(), random.point());
            let Some(hit) = engine.intersect(&ray) else { continue };
            // Embree compares products, not quotients: its ends are open within rounding.
            let (below, above) = if exact(kind) { (hit.t, hit.t.next_up()) } else { (hit.t * 0.99999, hit.t * 1.00001) };
            let before = Ray { t_max: below, ..ray };
            assert_eq!(engine.intersect(&before), None, "{kind}: t_max is open, {ray:?} {hit:?}");
            assert!(!engine.occluded(&before), "{kind}: t_max is open for any-hit");
            let just = Ray { t_max: above, ..ray };
            assert_eq!(engine.intersect(&just), Some(hit), "{kind}: a hit just before t_max counts");
            let beyond = Ray { t_min: if exact(kind) { hit.t } else { above }, ..ray };
            let next = engine.intersect(&beyond);
            assert!(next.is_none_or(|n| n.t > hit.t), "{kind}: t_min is open, {next:?} after {hit:?}");
            assert_eq!(engine.occluded(&beyond), next.is_some(), "{kind}: any-hit obeys t_min");
            let empty = Ray { t_min: 2.0 * hit.t, t_max: 0.5 * hit.t, ..ray };
            assert_eq!(engine.intersect(&empty), None, "{kind}: an empty interval holds no hit");
        }
    }
}

/// Misses among rays from inside the closed surface, aimed at its vertices and at points of its edges.
fn leaks(soup: &Soup, engine: &dyn Accel, n_rays: usize, center: Vec3, random: &mut Random) -> [usize; 2] {
    let mut leaks = [0; 2];
    for _ in 0..n_rays {
        let origin = center + 0.5 * random.point();
        let [a, b, _] = soup.corners(random.below(soup.triangles.len()));
        for (target, leak) in [a, a + (b - a) * random.unit()].into_iter().zip(&mut leaks) {
            let ray = Ray::new(origin, target - origin);
            let hit = engine.intersect(&ray);
            assert_eq!(hit.is_some(), engine.occluded(&ray), "any-hit against nearest-hit of {ray:?}");
            *leak += usize::from(hit.is_none());
        }
    }
    leaks
}

#[test]
fn no_ray_leaks_through_vertices_or_edges_of_a_closed_surface() {
    let soup = Arc::new(bumpy_sphere(5));
    for kind in kinds().filter(|&kind| kind != AccelKind::BruteForce) {
        let engine = built(&soup, kind);
        let n_rays = 100_000;
        let [at_vertices, at_edges] = leaks(&soup, engine.as_ref(), n_rays, Vec3::ZERO, &mut Random(3));
        assert_eq!(at_edges, 0, "{kind}: of {n_rays} rays at edges");
        // Measured for Embree's robust mode: 1.07 % at vertices.
        let allowed = if exact(kind) { 0 } else { n_rays / 50 };
        assert!(at_vertices <= allowed, "{kind}: {at_vertices} of {n_rays} rays at vertices leak, {allowed} allowed");
    }
}

/// Ten million rays each at vertices and edges, and a million far from the origin: minutes.
#[test]
#[cfg(feature = "slow-tests")]
fn ten_million_rays_do_not_leak() {
    let soup = Arc::new(bumpy_sphere(5));
    let engine = built(&soup, AccelKind::Obvhs);
    assert_eq!(leaks(&soup, engine.as_ref(), 10_000_000, Vec3::ZERO, &mut Random(4)), [0, 0]);
}

#[test]
fn far_from_the_origin_and_at_other_scales_nothing_leaks() {
    let n_rays = 20_000;
    for (scale, offset) in [(1.0, 1.5e5), (1e-4, 0.0), (1e4, 0.0), (1e-4, 10.0), (1e4, 1e6)] {
        let center = Vec3::new(offset, -0.7 * offset, 0.3 * offset);
        let soup = Arc::new(placed(bumpy_sphere(4), scale, center));
        let engine = built(&soup, AccelKind::Obvhs);
        let mut random = Random(5);
        let mut missed = 0;
        for _ in 0..n_rays {
            let origin = center + 0.5 * scale * random.point();
            let [a, b, _] = soup.corners(random.below(soup.triangles.len()));
            for target in [a, 0.5 * (a + b)] {
                missed += usize::from(target != origin && engine.intersect(&Ray::new(origin, target - origin)).is_none());
            }
        }
        assert_eq!(missed, 0, "scale {scale}, offset {offset}: leaks of {}", 2 * n_rays);
    }
}

#[test]
fn axis_aligned_rays_at_grid_lines_of_a_tessellated_box_hit() {
    let k = 16;
    let soup = Arc::new(tessellated_box(k));
    let oracle = built(&soup, AccelKind::BruteForce);
    for kind in kinds() {
        let engine = built(&soup, kind);
        // At the box's own edges, where a ray runs inside two walls, Embree finds nothing.
        let lines = if exact(kind) { 0..=k } else { 1..=k - 1 };
        for (i, j) in lines.clone().flat_map(|i| lines.clone().map(move |j| (i, j))) {
            for axis in 0..3 {
                for sign in [1.0, -1.0] {
                    let mut origin = Vec3::splat(0.5);
                    origin[(axis + 1) % 3] = i as f32 / k as f32;
                    origin[(axis + 2) % 3] = j as f32 / k as f32;
                    // A negative zero must be no other direction than a positive one.
                    for zero in [0.0, -0.0] {
                        let mut direction = Vec3::splat(zero);
                        direction[axis] = sign;
                        let ray = Ray::new(origin, direction);
                        let (found, expected) = (engine.intersect(&ray), oracle.intersect(&ray));
                        assert_eq!(found.map(|h| h.t), Some(0.5), "{kind}: {ray:?}");
                        if exact(kind) {
                            assert_eq!(found, expected, "{kind}: lowest index of those at an edge, {ray:?}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn meaningless_rays_miss() {
    let mut soup = tessellated_box(4);
    soup.spheres.push(Sphere { center: Vec3::splat(0.5), radius: 0.1 });
    let soup = Arc::new(soup);
    let good = Ray::new(Vec3::splat(0.25), Vec3::new(0.3, 0.5, 0.7));
    for kind in kinds() {
        let engine = built(&soup, kind);
        assert!(engine.intersect(&good).is_some());
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for axis in 0..3 {
                let (mut a, mut b) = (good, good);
                a.origin[axis] = bad;
                b.direction[axis] = bad;
                for ray in [a, b] {
                    assert_eq!(engine.intersect(&ray), None, "{kind}: {ray:?}");
                    assert!(!engine.occluded(&ray), "{kind}: {ray:?}");
                }
            }
        }
        for ray in [
            Ray { direction: Vec3::ZERO, ..good },
            Ray { t_min: f32::NAN, ..good },
            Ray { t_max: f32::NAN, ..good },
            Ray { t_max: -1.0, ..good },
            Ray { t_max: f32::NEG_INFINITY, ..good },
            Ray { t_min: f32::INFINITY, ..good },
        ] {
            assert_eq!(engine.intersect(&ray), None, "{kind}: {ray:?}");
            assert!(!engine.occluded(&ray), "{kind}: {ray:?}");
        }
        let behind = Ray { t_min: -10.0, ..good };
        assert_eq!(engine.intersect(&behind), engine.intersect(&good), "{kind}: nothing behind the origin is hit");
    }
}

#[test]
fn slivers_and_grazing_rays_agree_with_brute_force() {
    let mut random = Random(6);
    // A fan of slivers: 1 long, 1e-5 wide at the rim, all over one shared vertex.
    let n = 1_000;
    let mut soup = Soup { vertices: vec![Vec3::ZERO], ..Soup::default() };
    soup.vertices.extend((0..=n).map(|i| Vec3::new(1.0, 1e-5 * i as f32, 1e-3 * (0.05 * i as f32).sin())));
    soup.triangles = (0..n).map(|i| [0, i + 1, i + 2]).collect();
    let soup = Arc::new(soup);
    let oracle = built(&soup, AccelKind::BruteForce);
    for kind in kinds() {
        let engine = built(&soup, kind);
        let (mut differing, n_rays) = (0, 10_000);
        for _ in 0..n_rays {
            let target = Vec3::new(0.1 + 0.8 * random.unit(), 0.0, 0.0);
            let target = target + Vec3::Y * (1e-5 * n as f32 * target.x * random.unit());
            let origin = target + Vec3::new(0.0, 0.0, 1.0) + 0.3 * random.point();
            let ray = Ray::new(origin, target - origin);
            differing += usize::from(engine.intersect(&ray).is_some() != oracle.intersect(&ray).is_some());
        }
        // Only the fan's two outer edges may be judged differently: a band of 1e-7 of 1e-2 width.
        assert!(differing <= 5, "{kind}: {differing} of {n_rays} rays at slivers differ");

        for _ in 0..10_000 {
            let origin = Vec3::new(-1.0, 0.01 * random.unit(), 1e-3 * random.unit());
            let ray = Ray::new(origin, Vec3::new(1.0, 1e-3 * random.unit(), -1e-3 * random.unit()));
            let hit = engine.intersect(&ray);
            assert_eq!(hit.is_some(), engine.occluded(&ray), "{kind}: grazing {ray:?}");
            assert!(hit.is_none_or(|h| (0.0..=3.0).contains(&h.t)), "{kind}: grazing hit {hit:?}");
        }
    }
}

#[test]
fn degenerate_and_huge_primitives_neither_panic_nor_hide_others() {
    let mut random = Random(7);
    let mut soup = clutter(200, &mut random);
    let first = soup.triangles.len() as u32;
    let n = soup.vertices.len() as u32;
    let (inf, nan) = (f32::INFINITY, f32::NAN);
    soup.vertices.extend([
        Vec3::splat(0.3),
        Vec3::splat(0.6),
        Vec3::new(-1e12, -1e12, -5e11),
        Vec3::new(1e12, -1e12, -5e11),
        Vec3::new(0.0, 1e12, -5e11),
        Vec3::new(inf, 0.0, 0.0),
        Vec3::new(nan, 0.0, 0.0),
    ]);
    // A point, a segment, one of a kilometre in a unit scene a billion times over, and two that are not numbers.
    soup.triangles.extend([[n, n, n], [n, n + 1, n], [n + 2, n + 3, n + 4], [n, n + 1, n + 5], [n, n + 1, n + 6]]);
    let soup = Arc::new(soup);
    let valid = Arc::new(Soup { triangles: soup.triangles[..first as usize].to_vec(), ..(*soup).clone() });
    let huge = first + 2;
    for kind in kinds() {
        let (engine, without) = (built(&soup, kind), built(&valid, kind));
        let to_old = |h: Hit| if h.primitive >= first + 5 { Hit { primitive: h.primitive - 5, ..h } } else { h };
        for _ in 0..5_000 {
            let ray = Ray::new(1.5 * random.point(), random.point());
            let hit = engine.intersect(&ray);
            assert_eq!(hit.is_some(), engine.occluded(&ray), "{kind}: {ray:?}");
            let other = hit.filter(|h| h.primitive != huge);
            if hit == other {
                assert_eq!(other.map(to_old), without.intersect(&ray), "{kind}: {ray:?}");
            }
        }
        let down = Ray::new(Vec3::new(50.0, 60.0, 0.0), Vec3::new(0.01, 0.02, -1.0));
        let hit = engine.intersect(&down).expect("the huge triangle lies below");
        assert!(hit.primitive == huge && (hit.t / 5e11 - 1.0).abs() < 1e-4, "{kind}: {hit:?}");
    }
}

#[test]
fn duplicates_build_and_the_lowest_index_is_hit() {
    let mut soup = Soup { vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y], ..Soup::default() };
    soup.triangles = vec![[0, 1, 2]; 20_000];
    soup.spheres = vec![Sphere { center: Vec3::new(5.0, 0.0, 0.0), radius: 1.0 }; 5_000];
    let soup = Arc::new(soup);
    for kind in kinds() {
        let engine = built(&soup, kind);
        let at_triangles = engine.intersect(&Ray::new(Vec3::new(0.2, 0.3, 1.0), -Vec3::Z));
        let at_spheres = engine.intersect(&Ray::new(Vec3::new(5.0, 0.0, 3.0), -Vec3::Z));
        for (hit, t, first, last) in [(at_triangles, 1.0, 0, 20_000), (at_spheres, 2.0, 20_000, 25_000)] {
            let hit = hit.expect("aimed at all of them");
            let right = if exact(kind) { hit.primitive == first } else { (first..last).contains(&hit.primitive) };
            assert!(right && hit.t == t, "{kind}: {hit:?}, expected {first} at {t}");
        }
        assert!(!engine.occluded(&Ray::new(Vec3::new(0.7, 0.7, 1.0), -Vec3::Z)), "{kind}");
    }
}

/// A quadratic build would take hundreds of times longer than one over as many different triangles; the measured factor is 1.
#[test]
fn equal_and_equally_spaced_triangles_build_about_as_fast_as_others() {
    let n = 60_000;
    let time = |soup: Soup| {
        let soup = Arc::new(soup);
        let start = std::time::Instant::now();
        let engine = built(&soup, AccelKind::Obvhs);
        let time = start.elapsed().as_secs_f64();
        assert!(engine.memory_bytes() > n as usize);
        time
    };
    let others = time(clutter(n as usize, &mut Random(9)));
    let vertices = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    let equal = time(Soup { vertices, triangles: vec![[0, 1, 2]; n as usize], spheres: Vec::new() });
    let mut row = Soup::default();
    for i in 0..n {
        row.vertices.extend([Vec3::ZERO, Vec3::Y, Vec3::Z].map(|v| v + Vec3::X * i as f32));
        row.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    let spaced = time(row);
    assert!(equal < 20.0 * others && spaced < 20.0 * others, "equal {equal} s, equally spaced {spaced} s, others {others} s");
}

#[test]
fn many_builds_of_one_triangle_leave_nothing_behind() {
    let soup = Arc::new(Soup { vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], spheres: Vec::new() });
    let ray = Ray::new(Vec3::new(0.25, 0.25, 1.0), -Vec3::Z);
    for kind in kinds() {
        // A million leaves a device of Embree's, at 1 ms each, too long; the others run it in seconds.
        let n_builds = if cfg!(feature = "slow-tests") && exact(kind) { 1_000_000 } else { 500 };
        for _ in 0..n_builds {
            assert_eq!(built(&soup, kind).intersect(&ray), Some(Hit { t: 1.0, primitive: 0 }), "{kind}");
        }
    }
}

#[test]
fn spheres_are_hit_from_outside_and_inside_by_every_engine() {
    let spheres = vec![
        Sphere { center: Vec3::ZERO, radius: 1.0 },
        Sphere { center: Vec3::new(0.0, 0.0, 1e4), radius: 1e-2 },
        Sphere { center: Vec3::new(30.0, 0.0, 0.0), radius: 10.0 },
    ];
    let soup = Arc::new(Soup { spheres, ..tessellated_box(1) });
    let first = soup.triangles.len() as u32;
    let oracle = built(&soup, AccelKind::BruteForce);
    let mut random = Random(8);
    for kind in kinds() {
        let engine = built(&soup, kind);
        let far = engine.intersect(&Ray::new(Vec3::new(0.0, 0.0, 5e3), Vec3::Z));
        assert_eq!(far.map(|h| h.primitive), Some(first + 1), "{kind}: a small far sphere");
        for _ in 0..5_000 {
            let ray = Ray::new(20.0 * random.point(), random.point());
            let (found, expected) = (engine.intersect(&ray), oracle.intersect(&ray));
            assert!(agree(found, expected, 40.0), "{kind}: {found:?} expected {expected:?} for {ray:?}");
        }
    }
}
