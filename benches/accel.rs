//! Speed, memory and build time of the ray engines, against each other and against plain obvhs.
//!
//! `cargo bench --bench accel --features embree -- [singles] [batches] [builds] [growth] [small] [rounds=N]`; everything if no
//! part is named. Speeds are millions of rays per second of thread CPU time, so that other processes count little. All engines
//! run each set of rays once per round; a ratio is the median of the rounds' ratios to Embree in robust mode.

#[path = "accel/engines.rs"]
mod engines;
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

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let has = |name: &str| arguments.iter().any(|a| a == name);
    let part = |name: &str| has(name) || !["singles", "batches", "builds", "growth"].into_iter().any(has);
    let rounds = arguments.iter().find_map(|a| a.strip_prefix("rounds=")?.parse().ok()).unwrap_or(5);
    let scenes = scenes::all(has("small"));
    for (name, soup) in &scenes {
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
    }
    if part("growth") {
        growth(has("small"));
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

/// Build time by the wall's clock and memory of the engines that can be chosen.
fn builds(soup: &Arc<Soup>, rounds: usize) {
    println!("\nbuilds with {} threads: wall ms, median of {rounds} rounds; memory", rayon::current_num_threads());
    let kinds: Vec<AccelKind> = [AccelKind::Embree, AccelKind::Obvhs].into_iter().filter(|k| k.is_available()).collect();
    let mut times = vec![Vec::new(); kinds.len()];
    let mut memory = vec![0; kinds.len()];
    for _ in 0..rounds {
        for (index, &kind) in kinds.iter().enumerate() {
            let start = Instant::now();
            let engine = build(soup.clone(), kind).expect("engine is in this build");
            times[index].push(1e3 * start.elapsed().as_secs_f64());
            memory[index] = engine.memory_bytes();
        }
    }
    for (index, kind) in kinds.iter().enumerate() {
        let ratio = median(times[index].iter().zip(&times[0]).map(|(a, b)| a / b).collect());
        println!(
            "{:<26}{:>8.1} ms ({ratio:.2}) {:>8.1} MB",
            kind.name(),
            median(times[index].clone()),
            memory[index] as f64 / 1e6
        );
    }
}

/// The bounding volumes' gain over testing every triangle, as the walls of a box are cut ever finer.
fn growth(small: bool) {
    println!("\n## gain of bounding volumes over brute force (same f64 oracle), tessellated box");
    println!("{:>10}{:>14}{:>14}{:>14}{:>14}", "triangles", "primary", "secondary", "shadow", "patch");
    let mut points: Vec<(f64, Vec<f64>)> = Vec::new();
    let cuts: &[u32] = if small { &[1, 3, 9, 17] } else { &[1, 3, 5, 9, 17, 31, 53] };
    for &k in cuts {
        let soup = Arc::new(scenes::cornell(k));
        let sets = RaySets::new(&soup, 128);
        let (tree, all) = (engines::of_kind(&soup, AccelKind::Obvhs), engines::of_kind(&soup, AccelKind::BruteForce));
        let gains: Vec<f64> = sets
            .each()
            .map(|(_, rays, any)| {
                // The oracle gets a part of the rays that takes about the same time whatever the scene.
                let stride = (soup.len() / 64).max(1);
                let few: Vec<Ray> = rays.iter().step_by(stride).copied().collect();
                speed(&tree, rays, any);
                median((0..3).map(|_| speed(&tree, rays, any)).collect()) / speed(&all, &few, any)
            })
            .collect();
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
}

/// Slope of the least-squares line.
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let covariance: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    covariance / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}
