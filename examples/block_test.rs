//! Is a method unbiased on a scene? Welch's t-test of replicas against a reference (`metrics::block_test`).
//!
//! usage: cargo run --release --example `block_test` -- SCENE.xml REFERENCE [method] [spp] [replicas] [sampler] [passes]
//!
//! REFERENCE is a folder with A.exr, B.exr and var.exr, made from `passes` passes in all (default: 44). Ends with code 6 if the test fails.

use std::path::Path;
use std::process::ExitCode;
use twopass::film::Image;
use twopass::film::io::read_exr;
use twopass::integrator::Method;
use twopass::integrator::drive::{Budget, Clocks};
use twopass::load::{LoadOptions, load_scene};
use twopass::math::SamplerKind;
use twopass::metrics::block_test::{MUST_PASS, Reference, block_test};
use twopass::pipeline::{RenderSettings, render};
use twopass::progress::silent;
use twopass::run_report::process_cpu_seconds;

/// Failing blocks that are listed.
const SHOWN: usize = 20;

fn main() -> Result<ExitCode, Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [scene, reference, ..] = args.as_slice() else {
        return Err("expected SCENE.xml REFERENCE [method] [spp] [replicas] [sampler] [passes]".into());
    };
    let word = |i: usize, default: &str| args.get(i).map_or(default, String::as_str).to_owned();
    let method = Method::ALL.into_iter().find(|m| m.name() == word(2, "path")).ok_or("no such method")?;
    let (spp, replicas): (u32, u64) = (word(3, "16").parse()?, word(4, "16").parse()?);
    let sampler = SamplerKind::ALL.into_iter().find(|s| s.name() == word(5, "sobol")).ok_or("no such sampler")?;
    let passes = word(6, "44").parse()?;

    let [a, b, variance] = ["A", "B", "var"].map(|name| read_exr(&Path::new(reference).join(format!("{name}.exr"))));
    let (a, b, variance) = (a?, b?, variance?);
    let scene = load_scene(Path::new(scene), &LoadOptions::default())?.scene;
    let mut images: Vec<Image> = Vec::new();
    for seed in 1..=replicas {
        let budget = Budget { spp: Some(spp), ..Budget::default() };
        let settings = RenderSettings { method, sampler, seed, budget, ..RenderSettings::default() };
        images.push(
            render(scene.clone(), &settings, &Clocks::start(process_cpu_seconds), &mut silent, &mut |_, _, _| {})?.film.image(),
        );
    }
    let test = block_test(&images, &Reference { halves: [&a, &b], variance: &variance, passes })?;
    for ((x, y), t) in test.failing().take(SHOWN) {
        println!("block at column {x}, row {y}: t = {t:.1?}");
    }
    println!("p-values below {:.2e} fail; {} blocks fail", test.level, test.failing().count());
    println!("{:.3} % of the blocks pass, {} % needed", 100.0 * test.share_passing(), 100.0 * MUST_PASS);
    println!("{:.1} CPU s", process_cpu_seconds());
    Ok(if test.passes() { ExitCode::SUCCESS } else { ExitCode::from(6) })
}
