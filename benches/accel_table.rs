//! Speed, memory and build time of the ray engines, against each other and against plain obvhs.
//!
//! `cargo bench --bench accel_table --features embree -- [singles] [batches] [builds] [coherence] [threads] [growth]
//! [small] [rounds=N] [scene=PART OF ITS NAME] [svg=FILE] [file=SCENE.obj]`; everything if no part is named. `file` measures the
//! triangles of an OBJ file in place of the scenes made here; `svg` draws the growth. Speeds are millions of rays per second of thread CPU time, so that other processes count little. All engines
//! run each set of rays once per round; a ratio is the median of the rounds' ratios to Embree in robust mode.

#[path = "accel/engines.rs"]
mod engines;
#[path = "accel/plot.rs"]
mod plot;
#[path = "accel/rays.rs"]
mod rays;
#[path = "accel/scenes.rs"]
mod scenes;

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use engines::{Engine, batch_engines, single_engines};
use nix::time::{ClockId, clock_gettime};
use rays::RaySets;
use twopass::accel::{AccelKind, build};
use twopass::geometry::{Ray, Soup};
use twopass::math::sampler::mix;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let has = |name: &str| arguments.iter().any(|a| a == name);
    let part = |name: &str| has(name) || !["singles", "batches", "builds", "coherence", "threads", "growth"].into_iter().any(has);
    let rounds = arguments.iter().find_map(|a| a.strip_prefix("rounds=")?.parse().ok()).unwrap_or(5);
    let value = |name: &str| arguments.iter().find_map(|a| a.strip_prefix(name)?.strip_prefix('='));
    let scenes = value("file").map_or_else(|| scenes::all(has("small")), |path| vec![scenes::from_file(path)]);
    let wanted = |name: &str| value("scene").is_none_or(|part| name.contains(part));
    for (name, soup) in scenes.iter().filter(|scene| wanted(&scene.0)) {
        let sets = RaySets::new(soup, 256);
        println!("\n## {name}: {} triangles", soup.triangles.len());
        if part("singles") {
            compare("single rays", &single_engines(soup), &sets, rounds);
        }
        if part("batches") {
            compare("batches of 4096 rays", &batch_engines(soup), &sets, rounds);
        }
        if part("builds") {
            builds(soup, rounds);
        }
        if part("coherence") {
            coherence(soup, &sets, rounds);
        }
        if part("threads") {
            threads(soup, &sets, rounds);
        }
    }
    if part("growth") {
        let points = growth(has("small"));
        if let Some(path) = value("svg") {
            plot::draw(path, &points).expect("the figure can be written");
        }
    }
}

/// CPU time of this thread in seconds.
fn cpu_time() -> f64 {
    let time = clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).expect("Linux has this clock");
    time.tv_sec() as f64 + 1e-9 * time.tv_nsec() as f64
}

/// Rays per second of CPU time.
fn speed(engine: &Engine, rays: &[Ray], any: bool) -> f64 {
    let start = cpu_time();
    black_box(if any { (engine.occluded)(rays) } else { (engine.intersect)(rays) });
    rays.len() as f64 / (cpu_time() - start)
}

/// Prints a table: for each engine and set of rays the median speed and the median ratio to the first engine.
fn compare(title: &str, engines: &[Engine], sets: &RaySets, rounds: usize) {
    println!("\n{title}: Mrays/s (ratio to {}), medians of {rounds} rounds", engines[0].name);
    print!("{:<26}{:>8}", "engine", "MB");
    sets.each().for_each(|(name, ..)| print!("{name:>16}"));
    println!();
    // speeds[set][engine][round]
    let measured: Vec<Vec<Vec<f64>>> = sets
        .each()
        .map(|(_, rays, any)| {
            let mut speeds = vec![Vec::new(); engines.len()];
            for round in 0..=rounds {
                for (engine, speeds) in engines.iter().zip(&mut speeds) {
                    let found = speed(engine, rays, any);
                    // The first round warms the caches.
                    if round > 0 {
                        speeds.push(found);
                    }
                }
            }
            speeds
        })
        .collect();
    for (index, engine) in engines.iter().enumerate() {
        print!("{:<26}{:>8.1}", engine.name, engine.memory as f64 / 1e6);
        for speeds in &measured {
            let ratio = median(speeds[index].iter().zip(&speeds[0]).map(|(a, b)| a / b).collect());
            print!("{:>9.2} ({ratio:.2})", median(speeds[index].clone()) / 1e6);
        }
        println!();
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The paper's second speed-up: rays that follow each other closely find their nodes in the cache. Each set in its own order, and
/// shuffled.
fn coherence(soup: &Arc<Soup>, sets: &RaySets, rounds: usize) {
    println!("\ncoherence: Mrays/s in the order of the picture, shuffled, and what order gains; medians of {rounds} rounds");
    for engine in single_engines(soup).iter().filter(|engine| ["embree robust", "obvhs"].contains(&engine.name.as_str())) {
        print!("{:<26}", engine.name);
        for (_, rays, any) in sets.each() {
            let mut shuffled = rays.to_vec();
            shuffled
                .sort_by_cached_key(|ray| mix(u64::from(ray.direction.x.to_bits()) << 32 | u64::from(ray.origin.y.to_bits())));
            let speeds: Vec<(f64, f64)> =
                (0..rounds).map(|_| (speed(engine, rays, any), speed(engine, &shuffled, any))).collect();
            let of = |f: fn(&(f64, f64)) -> f64| median(speeds.iter().map(f).collect());
            print!("{:>8.2}{:>7.2} ({:.2})", of(|s| s.0) / 1e6, of(|s| s.1) / 1e6, of(|s| s.0 / s.1));
        }
        println!();
    }
}

/// What a second thread costs the first: Mrays/s of CPU time with one thread and with two, each with all rays.
fn threads(soup: &Arc<Soup>, sets: &RaySets, rounds: usize) {
    println!("\nthreads: Mrays/s of each thread's CPU time, one thread and two at once (ratio); medians of {rounds} rounds");
    for kind in [AccelKind::Embree, AccelKind::Obvhs].into_iter().filter(|k| k.is_available()) {
        print!("{:<26}", kind.name());
        let engine = build(soup.clone(), kind).expect("engine is in this build");
        let one = |rays: &[Ray], any: bool| {
            let start = cpu_time();
            let found = rays.iter().filter(|r| if any { engine.occluded(r) } else { engine.intersect(r).is_some() });
            black_box(found.count());
            rays.len() as f64 / (cpu_time() - start)
        };
        for (_, rays, any) in sets.each() {
            let both = || {
                let (a, b) = rayon::join(|| one(rays, any), || one(rays, any));
                2.0 / (1.0 / a + 1.0 / b)
            };
            let speeds: Vec<(f64, f64)> = (0..rounds).map(|_| (one(rays, any), both())).collect();
            let of = |f: fn(&(f64, f64)) -> f64| median(speeds.iter().map(f).collect());
            print!("{:>8.2}{:>7.2} ({:.2})", of(|s| s.0) / 1e6, of(|s| s.1) / 1e6, of(|s| s.1 / s.0));
        }
        println!();
    }
}

/// CPU time of all threads in seconds.
fn process_time() -> f64 {
    let time = clock_gettime(ClockId::CLOCK_PROCESS_CPUTIME_ID).expect("Linux has this clock");
    time.tv_sec() as f64 + 1e-9 * time.tv_nsec() as f64
}

/// Build time by the wall's clock and in CPU time, and memory, of the engines that can be chosen.
fn builds(soup: &Arc<Soup>, rounds: usize) {
    println!("\nbuilds with {} threads, medians of {rounds} rounds (ratio); memory", rayon::current_num_threads());
    let kinds: Vec<AccelKind> = [AccelKind::Embree, AccelKind::Obvhs].into_iter().filter(|k| k.is_available()).collect();
    let mut times = vec![Vec::new(); kinds.len()];
    let mut cpu_times = vec![Vec::new(); kinds.len()];
    let mut memory = vec![0; kinds.len()];
    for _ in 0..rounds {
        for (index, &kind) in kinds.iter().enumerate() {
            let (start, cpu_start) = (Instant::now(), process_time());
            let engine = build(soup.clone(), kind).expect("engine is in this build");
            times[index].push(1e3 * start.elapsed().as_secs_f64());
            cpu_times[index].push(1e3 * (process_time() - cpu_start));
            memory[index] = engine.memory_bytes();
        }
    }
    for (index, kind) in kinds.iter().enumerate() {
        let ratio = |times: &[Vec<f64>]| median(times[index].iter().zip(&times[0]).map(|(a, b)| a / b).collect());
        println!(
            "{:<26}{:>8.1} ms ({:.2}) {:>8.1} CPU ms ({:.2}) {:>8.1} MB",
            kind.name(),
            median(times[index].clone()),
            ratio(&times),
            median(cpu_times[index].clone()),
            ratio(&cpu_times),
            memory[index] as f64 / 1e6
        );
    }
}

/// The bounding volumes' gain over testing every triangle, as the walls of a box are cut ever finer.
///
/// Returns, for each number of triangles, seconds for a ray of each kind by the tree and by brute force.
fn growth(small: bool) -> Vec<plot::Point> {
    println!("\n## gain of bounding volumes over brute force (same f64 oracle), tessellated box");
    println!("{:>10}{:>14}{:>14}{:>14}{:>14}", "triangles", "primary", "secondary", "shadow", "patch");
    let mut points: Vec<(f64, Vec<f64>)> = Vec::new();
    let mut times = Vec::new();
    let cuts: &[u32] = if small { &[1, 3, 9, 17] } else { &[1, 3, 5, 9, 17, 31, 53] };
    for &k in cuts {
        let soup = Arc::new(scenes::cornell(k));
        let sets = RaySets::new(&soup, 128);
        let (tree, all) = (engines::of_kind(&soup, AccelKind::Obvhs), engines::of_kind(&soup, AccelKind::BruteForce));
        let speeds: Vec<(f64, f64)> = sets
            .each()
            .map(|(_, rays, any)| {
                // The oracle gets a part of the rays that takes about the same time whatever the scene.
                let stride = (soup.len() / 64).max(1);
                let few: Vec<Ray> = rays.iter().step_by(stride).copied().collect();
                speed(&tree, rays, any);
                (median((0..3).map(|_| speed(&tree, rays, any)).collect()), speed(&all, &few, any))
            })
            .collect();
        let gains: Vec<f64> = speeds.iter().map(|(tree, all)| tree / all).collect();
        times.push(plot::Point {
            n_triangles: soup.len() as f64,
            by_tree: speeds.iter().map(|s| 1.0 / s.0).collect(),
            by_all: speeds.iter().map(|s| 1.0 / s.1).collect(),
        });
        print!("{:>10}", soup.len());
        gains.iter().for_each(|g| print!("{g:>14.1}"));
        println!();
        points.push((soup.len() as f64, gains));
    }
    let fitted = |set: usize| {
        let points: Vec<(f64, f64)> = points.iter().filter(|p| p.0 > 300.0).map(|p| (p.0.ln(), p.1[set].ln())).collect();
        slope(&points)
    };
    println!("{:>10}{:>14.2}{:>14.2}{:>14.2}{:>14.2}", "exponent", fitted(0), fitted(1), fitted(2), fitted(3));
    times
}

/// Slope of the least-squares line.
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let covariance: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    covariance / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}
