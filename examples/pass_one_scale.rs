//! Pass one over finer and finer patches, or smaller and smaller tolerances: what it costs, and how far each solution is from the next.
//!
//!     cargo run --release --example pass_one_scale -- SCENE RUN RUN ...
//!
//! A run is `SIZE[@TOLERANCE[@SEED]]`: patch size, tolerance of the hierarchical form factors (default 1e-3), seed (default 0). Each is compared
//! with the run after it, over the patches of the first of the two: the irradiance of the other is averaged over each of them. Errors are
//! the area-weighted root mean square of rho H over that of the second solution, in all and of the parts by lamps, by other emitters and
//! by patches.

use std::path::Path;
use twopass::load::{LoadOptions, load_scene};
use twopass::math::{Rgb, Sampler};
use twopass::patch::{PatchId, PatchSettings};
use twopass::pipeline::{PassOneSettings, StageCosts, pass_one};
use twopass::progress::silent;
use twopass::radiosity::RadiosityField;
use twopass::run_report::peak_memory_bytes;
use twopass::world::World;
use twopass::world::walk::RayCounts;

/// Points of a patch that look for the patches of the other solution.
const POINTS: u64 = 16;
/// Shapes that are listed, those with the largest share of the error first.
const SHOWN: usize = 6;

/// Parts of the irradiance: all, by lamps, by other emitters, by patches.
type Parts = [Rgb; 4];

struct Run {
    patch_size: f64,
    tolerance: f64,
    seed: u64,
}

impl Run {
    fn parse(text: &str) -> Result<Self, Box<dyn std::error::Error>> {
        let mut words = text.split('@');
        let patch_size = words.next().unwrap_or_default().parse()?;
        let tolerance = words.next().unwrap_or("1e-3").parse()?;
        Ok(Self { patch_size, tolerance, seed: words.next().unwrap_or("0").parse()? })
    }

    /// Solves and prints what it took.
    fn solve(&self, world: &World) -> Result<RadiosityField, Box<dyn std::error::Error>> {
        let patches = PatchSettings { patch_size: Some(self.patch_size), ..PatchSettings::default() };
        let form_factors = twopass::form_factor::FormFactorMethod::Hierarchical;
        let settings =
            PassOneSettings { patches, form_factors, form_factor_tolerance: self.tolerance, ..PassOneSettings::default() };
        let (mut costs, mut counts) = (StageCosts::default(), RayCounts::default());
        let solved = pass_one::solve(world, &settings, self.seed, &mut costs, &mut counts, &mut silent)?;
        let stages: Vec<String> = costs.stages.iter().map(|s| format!("{} {:.2}", s.stage.name(), s.time.cpu_s)).collect();
        let all: f64 = costs.stages.iter().map(|s| s.time.cpu_s).sum();
        let closure = solved.form_factors.closure();
        println!(
            "size {} tolerance {} seed {}: {} patches, {} links, {} rays, {all:.2} CPU s ({}), peak {} MB, {} products, rows {:.3} to {:.3}",
            self.patch_size,
            self.tolerance,
            self.seed,
            solved.field.patches.len(),
            solved.form_factors.n_nonzero(),
            counts.form_factor,
            stages.join(", "),
            peak_memory_bytes() / 1_000_000,
            solved.solution.sweeps,
            closure.row_sum_min,
            closure.row_sum_max,
        );
        Ok(solved.field)
    }
}

fn parts(field: &RadiosityField, i: usize) -> Parts {
    let (shadow, gathered, patches) = (field.shadow_irradiance[i], field.gathered_irradiance[i], field.indirect_irradiance[i]);
    [shadow + gathered + patches, shadow, gathered, patches]
}

/// Prints how far `found` is from `finer`.
fn compare(world: &World, found: &RadiosityField, finer: &RadiosityField) {
    let n = found.patches.len();
    let same = n == finer.patches.len() && found.patches.area == finer.patches.area;
    let mut mean: Vec<(Parts, f64)> = vec![([Rgb::BLACK; 4], 0.0); n];
    // From the finer patches, each of which lies in one of the coarser ones or in few.
    for j in 0..finer.patches.len() {
        let of_other = parts(finer, j);
        let mut add = |i: usize, weight: f64| {
            mean[i].0.iter_mut().zip(of_other).for_each(|(sum, part)| *sum += part * weight);
            mean[i].1 += weight;
        };
        if same {
            add(j, 1.0);
            continue;
        }
        for k in 0..POINTS {
            let at = finer.patches.sample(world, PatchId(j as u32), Sampler::new(0x5ca1e, j as u64, k).next_2d());
            if let Some(i) = found.patches.patch_at(&at) {
                add(i.0 as usize, finer.patches.area[j]);
            }
        }
    }
    let shapes = found.patches.shapes(world);
    let (mut off, mut all) = ([0.0; 4], 0.0);
    let mut by_shape = vec![0.0; world.scene().shapes.len()];
    let squared = |v: Rgb| v.r * v.r + v.g * v.g + v.b * v.b;
    for (i, (sum, weight)) in mean.iter().enumerate().filter(|(_, m)| m.1 > 0.0) {
        let (area, rho, own) = (found.patches.area[i], found.patches.rho[i], parts(found, i));
        for k in 0..4 {
            off[k] += area * squared(rho * (own[k] - sum[k] / *weight));
        }
        all += area * squared(rho * sum[0] / *weight);
        by_shape[shapes[i]] += area * squared(rho * (own[0] - sum[0] / *weight));
    }
    let percent = |k: usize| 100.0 * (off[k] / all).sqrt();
    println!(
        "  to the next: {:.3} %, of it lamps {:.3} %, other emitters {:.3} %, patches {:.3} %",
        percent(0),
        percent(1),
        percent(2),
        percent(3)
    );
    let mut worst: Vec<usize> = (0..by_shape.len()).collect();
    worst.sort_by(|a, b| by_shape[*b].total_cmp(&by_shape[*a]));
    let line = |s: &usize| format!("{} {:.0} %", world.scene().shapes[*s].id, 100.0 * by_shape[*s] / off[0]);
    println!("  by shapes: {}", worst.iter().take(SHOWN).map(line).collect::<Vec<_>>().join(", "));
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [scene, runs @ ..] = args.as_slice() else { return Err("expected SCENE RUN RUN ...".into()) };
    let world = World::new(load_scene(Path::new(scene), &LoadOptions::default())?.scene, twopass::accel::AccelKind::default())?;
    let mut before: Option<RadiosityField> = None;
    for run in runs {
        let field = Run::parse(run)?.solve(&world)?;
        if let Some(before) = &before {
            compare(&world, before, &field);
        }
        before = Some(field);
    }
    Ok(())
}
