//! The solvers of pass one against each other: products with the form factors until the true error is 1e-6, and until the solver's own
//! bound says so, over reflectances ever nearer to 1. Rooms have exact form factors, the truth is by elimination.
//!
//!     cargo run --release --example solver_table [-- FIGURE.svg]

use plotters::prelude::*;
use std::time::Instant;
use twopass::form_factor::FormFactors;
use twopass::math::Rgb;
use twopass::progress::silent;
use twopass::radiosity::{self, RadiositySystem, Solution, Solver, SolverSettings};
use twopass::stability::enclosures::{Enclosure, cube, rooms_in_a_row};
use twopass::stability::oracle::solve_dense;

const TOLERANCE: f64 = 1e-6;
/// Sweeps after which a method is called slow.
const MOST: u32 = 1500;
const REFLECTANCES: [f64; 5] = [0.5, 0.9, 0.99, 0.999, 0.999999];

struct Case {
    room: Enclosure,
    rho: Vec<Rgb>,
    source: Vec<Rgb>,
    truth: Vec<f64>,
    mean: f64,
}

impl Case {
    /// A lamp of four patches in the middle of the ceiling of the first room.
    fn new(room: &Enclosure, rho: impl Fn(usize) -> f64) -> Self {
        let f = &room.form_factors;
        let ceiling: Vec<usize> = (0..f.n).filter(|&i| room.room[i] == 0 && room.face[i] == 5).collect();
        let side = ceiling.len().isqrt();
        let lamp: Vec<usize> = (0..4).map(|k| ceiling[(side / 2 - 1 + k / 2) * side + side / 2 - 1 + k % 2]).collect();
        let source: Vec<Rgb> = (0..f.n).map(|i| Rgb::grey(lamp.iter().map(|&j| f.factor[i * f.n + j]).sum())).collect();
        let rho: Vec<f64> = (0..f.n).map(rho).collect();
        let equations = (0..f.n).map(|i| {
            let mut row: Vec<f64> = (0..f.n).map(|j| f64::from(u8::from(i == j)) - f.factor[i * f.n + j] * rho[j]).collect();
            row.push(source[i].g);
            row
        });
        let truth = solve_dense(equations.collect());
        let mean = truth.iter().zip(&room.area).map(|(h, a)| h * a).sum::<f64>() / room.area.iter().sum::<f64>();
        Self { room: room.clone(), rho: rho.into_iter().map(Rgb::grey).collect(), source, truth, mean }
    }

    fn solve(&self, solver: Solver, max_sweeps: u32) -> Solution {
        let form_factors: &dyn FormFactors = &self.room.form_factors;
        let system = RadiositySystem { rho: &self.rho, area: &self.room.area, form_factors, source: self.source.clone() };
        let settings = SolverSettings { solver, tolerance: TOLERANCE, max_sweeps };
        radiosity::solve(&system, &settings, &mut silent).expect("a room that loses light has a steady state")
    }

    fn error(&self, solution: &Solution) -> f64 {
        solution.irradiance.iter().zip(&self.truth).map(|(h, t)| (h.g - t).abs()).fold(0.0, f64::max) / self.mean
    }

    /// Products until the true error is met, by bisection; `None` if it never is.
    fn products(&self, solver: Solver, most: u32) -> Option<u32> {
        let is_met = |sweeps: u32| self.error(&self.solve(solver, sweeps)) <= TOLERANCE;
        if !is_met(most) {
            return None;
        }
        let (mut low, mut high) = (0, most);
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if is_met(middle) { high = middle } else { low = middle }
        }
        Some(high)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!(
        "n: products until the true error is 1e-6; (n): until the bound is; x: not within {MOST}, or not looked for; what preparation takes is in all"
    );
    let (one, four) = (cube(10), rooms_in_a_row(4, 8, 3));
    let mut growth: Vec<(Solver, f64, u32)> = Vec::new();
    for (name, room, coloured) in
        [("cube, uniform", &one, false), ("cube, walls of 0.7 and 0.3", &one, true), ("4 rooms with doors", &four, false)]
    {
        println!("{name}, {} patches", room.area.len());
        for rho in REFLECTANCES {
            let of = |i: usize| match room.face[i] {
                0 if coloured => 0.7 * rho,
                1 if coloured => 0.3 * rho,
                _ => rho,
            };
            let case = Case::new(room, of);
            let mut line = format!("  rho {rho:<9}");
            for solver in Solver::ALL {
                let watch = Instant::now();
                let stated = case.solve(solver, MOST);
                let seconds = watch.elapsed().as_secs_f64();
                // Bisection takes ten runs: too many of methods that need hundreds of sweeps in the larger room.
                let is_slow =
                    room.area.len() > 1000 && matches!(solver, Solver::GaussSeidel | Solver::Jacobi | Solver::Southwell);
                let found = if is_slow { None } else { case.products(solver, stated.sweeps) };
                if let (Some(found), "cube, uniform") = (found, name) {
                    growth.push((solver, 1.0 / (1.0 - rho), found));
                }
                let shown = |n: Option<u32>| n.map_or("x".to_owned(), |n| n.to_string());
                let own = stated.converged.then_some(stated.sweeps);
                line += &format!(
                    " | {} {} ({}) {:.0e} {:.0} ms",
                    solver.name(),
                    shown(found),
                    shown(own),
                    stated.error_bound,
                    seconds * 1e3
                );
                assert!(case.error(&stated) <= stated.error_bound * 1.01 + 1e-9, "{} at {rho}: bound broken", solver.name());
            }
            println!("{line} | rooms {}", case.solve(Solver::Cg, 1).rooms);
        }
    }
    match std::env::args().nth(1) {
        Some(path) => Ok(draw(&path, &growth)?),
        None => Ok(()),
    }
}

fn draw(path: &str, growth: &[(Solver, f64, u32)]) -> Result<(), Box<dyn std::error::Error>> {
    let area = SVGBackend::new(path, (760, 480)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption("Cube of 600 patches: products with the form factors to a true error of 1e-6", ("sans-serif", 17))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(56)
        .build_cartesian_2d((1.5_f64..2e6).log_scale(), (1_f64..2e3).log_scale())?;
    chart.configure_mesh().x_desc("1/(1 - rho)").y_desc("products").draw()?;
    for (k, solver) in Solver::ALL.into_iter().enumerate() {
        let points: Vec<(f64, f64)> = growth.iter().filter(|g| g.0 == solver).map(|(_, at, n)| (*at, f64::from(*n))).collect();
        let colour = Palette99::pick(k).to_rgba();
        chart
            .draw_series(LineSeries::new(points.clone(), colour.stroke_width(2)).point_size(3))?
            .label(solver.name())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .position(SeriesLabelPosition::UpperLeft)
        .draw()?;
    area.present()?;
    Ok(())
}
