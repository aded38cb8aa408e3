//! Error of pass one against the number of patches, of one size or following the light.
//!
//!     cargo run --release --example adaptive -- SCENE FINEST RUN RUN ...
//!
//! A run is `SIZE` or `SIZE~SHARE`: patch size, and the share of the root mean square by which radiosity may bend within a patch. The error is
//! that of the irradiance at points of the surfaces, read as constant over each patch and interpolated, against a final gather at each point over
//! the solution of the run FINEST: root mean square over that of the irradiance. Points to which lamps are hidden in part, where shadows end, are
//! counted by themselves as well.

use std::path::Path;
use twopass::geometry::Ray;
use twopass::integrator::{IntegratorSettings, ReadOut};
use twopass::light::Light;
use twopass::load::{LoadOptions, load_scene};
use twopass::math::{Rgb, Sampler, SamplerKind, warp};
use twopass::patch::PatchSettings;
use twopass::pipeline::probe::Prober;
use twopass::pipeline::{PassOne, PassOneSettings, StageCosts, pass_one, surface_points};
use twopass::progress::silent;
use twopass::radiosity::Interpolation;
use twopass::world::walk::RayCounts;
use twopass::world::{DirectSampling, SurfaceInteraction, World};

/// Points of the surfaces.
const POINTS: u32 = 3072;
/// Shadow and gather rays at each.
const SAMPLES: u64 = 1024;
/// Error allowed to hierarchical form factors.
const TOLERANCE: f64 = 1e-3;

fn solve(world: &World, run: &str) -> Result<(PassOne, f64), Box<dyn std::error::Error>> {
    let (size, share) = run.split_once('~').map_or((run, None), |(size, share)| (size, Some(share)));
    let adaptive = share.map(str::parse).transpose()?;
    let patches = PatchSettings { patch_size: Some(size.parse()?), adaptive, ..PatchSettings::default() };
    let form_factors = twopass::form_factor::FormFactorMethod::Hierarchical;
    let settings = PassOneSettings { patches, form_factors, form_factor_tolerance: TOLERANCE, ..PassOneSettings::default() };
    let (mut costs, mut counts) = (StageCosts::default(), RayCounts::default());
    let solved = pass_one::solve(world, &settings, 1, &mut costs, &mut counts, &mut silent)?;
    Ok((solved, costs.stages.iter().map(|s| s.time.cpu_s).sum()))
}

/// True if some but not all of 64 points on the lamps are seen from `si`.
fn is_half_lit(world: &World, si: &SurfaceInteraction) -> bool {
    let lamps = world.scene().lights.iter().filter_map(|light| match light {
        Light::Area(lamp) => Some(lamp.shape as usize),
        _ => None,
    });
    let mut seen = [0, 0];
    for shape in lamps {
        let first = world.first_primitive(shape);
        for primitive in first..first + 2 {
            for k in 0..32 {
                let w = warp::triangle(Sampler::new(3, 1, k).next_2d());
                let at = world.on_triangle(primitive, (f64::from(w.x), f64::from(w.y)), si.point);
                if (at.point - si.point).dot(si.ng) > 0.0 {
                    let ray = Ray::between(si.point + si.ng * 1e-4, at.point + at.ng * 1e-4);
                    seen[usize::from(world.occluded(&ray))] += 1;
                }
            }
        }
    }
    seen[0] > 0 && seen[1] > 0
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [scene, finest, runs @ ..] = args.as_slice() else { return Err("expected SCENE FINEST RUN ...".into()) };
    let world = World::new(load_scene(Path::new(scene), &LoadOptions::default())?.scene, twopass::accel::AccelKind::default())?;
    let points = surface_points::points(&world, POINTS);
    let settings = IntegratorSettings {
        read_out: ReadOut::FinalGather,
        max_depth: None,
        gather_rays: 1,
        direct: DirectSampling::default(),
        seed: 1,
        sampler: SamplerKind::default(),
    };
    let finest = solve(&world, finest)?.0;
    let prober = Prober { world: &world, pass_one: &finest, settings, samples: SAMPLES };
    let places: Vec<_> = points.iter().map(|si| (world.scene().origin + si.point.as_dvec3(), si.ng.as_dvec3())).collect();
    let found = prober.irradiance(&places).0;
    let want: Vec<Rgb> = found.iter().map(|p| p.total).collect();
    let half_lit: Vec<bool> = points.iter().map(|si| is_half_lit(&world, si)).collect();
    let squared = |v: Rgb| v.r * v.r + v.g * v.g + v.b * v.b;
    let noise =
        found.iter().map(|p| 3.0 * p.std_error * p.std_error).sum::<f64>() / want.iter().map(|v| squared(*v)).sum::<f64>();
    println!(
        "{} points, {} of them half lit; noise {:.2} %",
        points.len(),
        half_lit.iter().filter(|h| **h).count(),
        100.0 * noise.sqrt()
    );
    println!("run             patches   CPU s   constant: all, half lit   interpolated: all, half lit");
    for run in runs {
        let (solved, seconds) = solve(&world, run)?;
        let field = &solved.field;
        let smooth = Interpolation::new(&world, field);
        let error = |read: &dyn Fn(&SurfaceInteraction) -> Rgb, only: bool| {
            let (mut off, mut all) = (0.0, 0.0);
            for ((si, want), half) in points.iter().zip(&want).zip(&half_lit) {
                if *half || !only {
                    off += squared(read(si) - *want);
                    all += squared(*want);
                }
            }
            100.0 * f64::sqrt(off / all)
        };
        let constant = |si: &SurfaceInteraction| field.irradiance(si);
        let interpolated = |si: &SurfaceInteraction| smooth.irradiance(field, si);
        println!(
            "{run:14}  {:7}  {seconds:6.2}   {:.2} %, {:.2} %   {:.2} %, {:.2} %",
            field.patches.len(),
            error(&constant, false),
            error(&constant, true),
            error(&interpolated, false),
            error(&interpolated, true)
        );
    }
    Ok(())
}
