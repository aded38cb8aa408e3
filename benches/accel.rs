//! Speed of the ray engines by criterion: `cargo bench --bench accel --features embree -- [FILTER]`.
//!
//! Wall time, with criterion's confidence intervals and its comparison with the run before. The tables of ratios in interleaved
//! rounds of CPU time, on which the goals are set, are those of the bench `accel_table`.

#[path = "accel/engines.rs"]
#[allow(dead_code, reason = "memory is for the tables")]
mod engines;
#[path = "accel/rays.rs"]
mod rays;
#[path = "accel/scenes.rs"]
#[allow(dead_code, reason = "scenes from files are for the tables")]
mod scenes;

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use engines::{Engine, batch_engines, single_engines};
use rays::RaySets;
use twopass::accel::{AccelKind, build};

/// Every engine with every set of rays, over the scenes made here.
fn speeds(criterion: &mut Criterion) {
    for (scene, soup) in scenes::all(false) {
        let sets = RaySets::new(&soup, 128);
        let forms: [(&str, Vec<Engine>); 2] = [("single", single_engines(&soup)), ("batch", batch_engines(&soup))];
        for ((form, engines), (set, rays, any)) in forms.iter().flat_map(|form| sets.each().map(move |set| (form, set))) {
            let mut group = criterion.benchmark_group(format!("{scene}, {form}, {set}"));
            group.throughput(Throughput::Elements(rays.len() as u64));
            for engine in engines {
                let ask = if any { &engine.occluded } else { &engine.intersect };
                group.bench_function(BenchmarkId::from_parameter(&engine.name), |b| b.iter(|| ask(black_box(rays))));
            }
        }
    }
}

/// Time to build each engine, freeing it not counted.
fn builds(criterion: &mut Criterion) {
    for (scene, soup) in scenes::all(false) {
        let mut group = criterion.benchmark_group(format!("{scene}, build"));
        group.throughput(Throughput::Elements(soup.len() as u64));
        for kind in [AccelKind::Embree, AccelKind::Obvhs].into_iter().filter(|kind| kind.is_available()) {
            group.bench_function(BenchmarkId::from_parameter(kind), |b| {
                b.iter_with_large_drop(|| build(soup.clone(), kind).expect("engine is in this build"));
            });
        }
    }
}

criterion_group! {
    name = accel;
    config = Criterion::default().sample_size(10).warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_secs(1));
    targets = speeds, builds
}
criterion_main!(accel);
