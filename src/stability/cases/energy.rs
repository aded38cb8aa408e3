//! How much light there is: bright rooms, white rooms, tiny lamps, dark rooms beside bright ones.

use crate::form_factor::matrix::Row as FactorRow;
use crate::form_factor::{FormFactorMatrix, FormFactors};
use crate::geometry::tessellate;
use crate::load::{LoadOptions, load_scene};
use crate::math::{DAffine3, DVec3, Rgb};
use crate::pipeline::{PassOne, PipelineError, Solved};
use crate::progress::silent;
use crate::radiosity::{self, RadiositySystem, Solution, SolveError, Solver, SolverSettings};
use crate::scene::SurfaceSource;
use crate::stability::oracle::solve_dense;
use crate::stability::rooms::{self, Room, furnace, quick, solve_gathered};
use crate::stability::{Curve, Rows, Trouble, figure};
use std::f64::consts::PI;

/// Reflectances of the catalogue, each ten times nearer to 1 than the one before.
const BRIGHT: [f64; 6] = [0.9, 0.99, 0.999, 0.9999, 0.99999, 0.999999];

/// Solver error that the catalogue allows.
const SOLVER_BOUND: f64 = 1e-6;

/// Tolerance asked of the solver: its own bound is a bound, so this is an order below what is checked.
const TIGHT: SolverSettings = SolverSettings { solver: Solver::Cg, tolerance: 1e-7, max_sweeps: 20_000 };

/// Three closed shapes whose inside emits radiance 1 and reflects `rho`.
fn enclosure(shape: &str, rho: f64) -> Room {
    let mut room = Room::new(DVec3::new(0.1, 0.1, 0.1), DVec3::new(0.1, 0.0, 1.0), 8);
    let grey = room.grey(rho);
    match shape {
        "cube" => return furnace(rho),
        "sphere" => {
            let mut inside = tessellate::sphere(&DAffine3::IDENTITY, 16);
            inside.flip();
            inside.normals.clear();
            room.add(SurfaceSource::Triangles(inside), grey, 1.0);
        }
        _ => {
            // An L of three unit squares, one unit high, around the corner (1, 1).
            let outline = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)];
            for (i, &(x, z)) in outline.iter().enumerate() {
                let (to_x, to_z) = outline[(i + 1) % outline.len()];
                let edge = DVec3::new(to_x - x, 0.0, to_z - z);
                room.quad(DVec3::new(x, 0.0, z), edge, DVec3::Y, grey, 1.0);
            }
            for (corner, width, depth) in [(DVec3::ZERO, 2.0, 1.0), (DVec3::Z, 1.0, 1.0)] {
                room.quad(corner, DVec3::Z * depth, DVec3::X * width, grey, 1.0);
                room.quad(corner + DVec3::Y, DVec3::X * width, DVec3::Z * depth, grey, 1.0);
            }
        }
    }
    room
}

/// Irradiance from emission alone, all emitters being found by form factors.
fn emitted_source(pass_one: &PassOne) -> Vec<Rgb> {
    let (factors, exitance) = (&pass_one.form_factors, &pass_one.field.patches.exitance);
    let mut source = vec![Rgb::BLACK; factors.len()];
    factors.gather_direct(exitance, &mut source);
    source
}

/// Largest relative error of the irradiance of any patch.
fn worst(solution: &Solution, want: impl Fn(usize) -> f64) -> f64 {
    let errors = solution.irradiance.iter().enumerate().map(|(i, h)| (h.g / want(i) - 1.0).abs());
    errors.fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
}

/// Error of the solver after 1, 2, 4, ... sweeps.
fn error_by_sweep(system: &RadiositySystem<'_>, want: impl Fn(usize) -> f64 + Copy) -> Result<Curve, SolveError> {
    let mut points = Vec::new();
    for k in 0..12 {
        let settings = SolverSettings { max_sweeps: 1 << k, ..TIGHT };
        let solution = radiosity::solve(system, &settings, &mut silent)?;
        points.push((f64::from(solution.sweeps), worst(&solution, want).max(1e-16)));
        if solution.converged {
            break;
        }
    }
    Ok(Curve { axis: "sweeps", points })
}

/// B1: closed rooms of equal walls, H = pi L_e/(1 - rho) in every patch.
pub fn bright_rooms(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    for shape in ["cube", "sphere", "L-shaped room"] {
        for rho in BRIGHT {
            let mut settings = quick(1, 0.25);
            settings.pass_one.solver = TIGHT;
            let Solved { pass_one, .. } = solve_gathered(enclosure(shape, rho).scene()?, &settings)?;
            let patches = &pass_one.field.patches;
            let want = PI / (1.0 - rho);
            let (mut error, mut found) = (0.0_f64, want);
            for i in 0..patches.len() {
                let radiosity = pass_one.field.radiosity(i).g;
                if (radiosity / want - 1.0).abs() > error || radiosity.is_nan() {
                    (error, found) = ((radiosity / want - 1.0).abs(), radiosity);
                }
            }
            let source = emitted_source(&pass_one);
            let (rho_of, area, form_factors) = (&patches.rho, &patches.area, &pass_one.form_factors);
            let system = RadiositySystem { rho: rho_of, area, form_factors, source };
            let curve = error_by_sweep(&system, |_| PI / (1.0 - rho))?;
            let solution = &pass_one.solution;
            let told = format!(
                "worst of {} patches {}; {} sweeps, bound told {:.1e}, converged {}",
                patches.len(),
                figure(found),
                solution.sweeps,
                solution.error_bound,
                solution.converged
            );
            let name = format!("closed {shape}, rho {rho}");
            rows.error(&name, "B = pi L_e/(1 - rho) in every patch", &figure(want), told, error, SOLVER_BOUND, Some(curve));
        }
    }
    furnace_pictures(rows)
}

/// The same in the picture: every pixel of the furnace is L_e/(1 - rho).
fn furnace_pictures(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    for rho in [0.9, 0.999] {
        let image = rooms::picture(furnace(rho).scene()?, &quick(2, 0.25))?.film.image();
        let want = 1.0 / (1.0 - rho);
        let errors = image.pixels().iter().flatten().map(|v| (f64::from(*v) / want - 1.0).abs());
        let error = errors.fold(0.0, |a: f64, b| if b > a || b.is_nan() { b } else { a });
        let name = format!("furnace seen, rho {rho}");
        rows.error(&name, "L = L_e/(1 - rho) in every pixel", &figure(want), "worst pixel".to_owned(), error, 1e-3, None);
    }
    Ok(())
}

/// B2: a closed room that absorbs nothing has no steady state; an open one has.
pub fn white_rooms(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let refused = match solve_gathered(furnace(1.0).scene()?, &quick(1, 0.5)) {
        Err(PipelineError::Solve(error)) => Some(error.to_string()),
        _ => None,
    };
    let got = refused.clone().unwrap_or_else(|| "no error".to_owned());
    rows.holds("closed, rho 1, emits", "an error that says why", "no steady state", got, refused.is_some());
    let mut open = furnace(1.0);
    open.source.shapes.pop();
    let solved = solve_gathered(open.scene()?, &quick(1, 0.5))?.pass_one;
    let finite = solved.solution.irradiance.iter().all(|h| h.max().is_finite());
    let told = format!("largest {}, converged {}", figure(largest(&solved)), solved.solution.converged);
    rows.holds("open, rho 1, emits", "finite and converged", "finite", told, finite && solved.solution.converged);
    Ok(())
}

fn largest(pass_one: &PassOne) -> f64 {
    pass_one.solution.irradiance.iter().map(|h| h.max()).fold(0.0, f64::max)
}

/// B3: reflectances that cannot be are refused with their place.
pub fn impossible_reflectances(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let folder = tempfile::tempdir()?;
    for value in ["2", "-1", "nan"] {
        let text = format!(
            "<scene version=\"3.0.0\">\n<sensor type=\"perspective\"/>\n<shape type=\"rectangle\">\n<bsdf type=\"diffuse\">\n\
             <rgb name=\"reflectance\" value=\"0.5, {value}, 0.5\"/>\n</bsdf>\n</shape>\n</scene>\n"
        );
        let path = folder.path().join("scene.xml");
        std::fs::write(&path, text)?;
        let error = load_scene(&path, &LoadOptions::default()).err().map(|e| e.to_string());
        let has_place = error.as_ref().is_some_and(|e| e.contains("scene.xml:5"));
        let got = error.unwrap_or_else(|| "accepted".to_owned());
        let got = got.replace(&format!("{}/", folder.path().display()), "");
        rows.holds(&format!("reflectance {value}"), "refused with file and line", "scene.xml:5: ...", got, has_place);
    }
    Ok(())
}

/// A spherical cavity of `patches` equal patches, one of which is divided: F_ij = A_j/A whatever i. All are powers of two or their
/// differences, exact in f32, so that rows sum to 1 exactly.
fn cavity(patches: u32, tiny: f64) -> (Vec<f64>, FormFactorMatrix) {
    let each = 1.0 / f64::from(patches);
    let mut area = vec![each; patches as usize];
    area[0] -= tiny;
    area.push(tiny);
    let direct: Vec<(u32, f32)> = area.iter().enumerate().map(|(j, a)| (j as u32, *a as f32)).collect();
    let row = FactorRow { direct, ..FactorRow::default() };
    let matrix = FormFactorMatrix::from_rows(vec![row; area.len()]);
    (area, matrix)
}

/// B4: an emitter of 6e-8 of the area; a measured room with all light at one patch.
pub fn tiny_emitter(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let tiny = 2.0_f64.powi(-24);
    let (area, matrix) = cavity(256, tiny);
    let mut exitance = vec![0.0; area.len()];
    exitance[256] = 1e6;
    for rho in BRIGHT {
        let rho_of = vec![Rgb::grey(rho); area.len()];
        let source = vec![Rgb::grey(tiny * 1e6); area.len()];
        let system = RadiositySystem { rho: &rho_of, area: &area, form_factors: &matrix, source };
        let want = tiny * 1e6 / (1.0 - rho);
        let solution = radiosity::solve(&system, &TIGHT, &mut silent)?;
        let curve = error_by_sweep(&system, |_| tiny * 1e6 / (1.0 - rho))?;
        let name = format!("spherical cavity, emitter of 6e-8 of its area, rho {rho}");
        let told = format!("{} sweeps, bound told {:.1e}", solution.sweeps, solution.error_bound);
        let law = "H = (mean exitance)/(1 - rho) in every patch";
        rows.error(&name, law, &figure(want), told, worst(&solution, |_| want), SOLVER_BOUND, Some(curve));
    }
    // Measured form factors of a room with a block in it, light at a single patch: against elimination of the same equations.
    for rho in [0.9, 0.999, 0.999999] {
        let solved = solve_gathered(block_room(rho).scene()?, &quick(1, 0.5))?.pass_one;
        let (factors, patches) = (&solved.form_factors, &solved.field.patches);
        let n = patches.len();
        let mut source = vec![Rgb::BLACK; n];
        source[0] = Rgb::grey(1e6);
        let dense = (0..n).map(|i| {
            let mut row = vec![0.0; n + 1];
            factors.row(i, &mut |j, f| row[j] -= f.g * patches.rho[j].g);
            row[i] += 1.0;
            row[n] = source[i].g;
            row
        });
        let want = solve_dense(dense.collect());
        let system = RadiositySystem { rho: &patches.rho, area: &patches.area, form_factors: factors, source };
        let solution = radiosity::solve(&system, &TIGHT, &mut silent)?;
        let curve = error_by_sweep(&system, |i| want[i])?;
        let name = format!("room with a block, light at 1 of {n} patches, rho {rho}");
        let told = format!("{} sweeps, bound told {:.1e}", solution.sweeps, solution.error_bound);
        let error = worst(&solution, |i| want[i]);
        rows.error(&name, "every patch as by Gaussian elimination", "elimination", told, error, SOLVER_BOUND, Some(curve));
    }
    Ok(())
}

fn block_room(rho: f64) -> Room {
    let mut room = furnace(rho);
    let grey = room.grey(rho);
    let block = DAffine3::from_translation(DVec3::new(0.1, -0.45, 0.2)) * DAffine3::from_scale(DVec3::splat(0.4));
    room.add(SurfaceSource::Triangles(tessellate::cube(&block)), grey, 0.0);
    room
}

/// Two rooms side by side, the first lit by `dark`, the second by `bright`; `gap` is the height of a slit in the wall between them.
fn two_rooms(dark: f64, bright: f64, gap: f64) -> Room {
    let mut room = Room::new(DVec3::new(0.5, 0.5, 0.1), DVec3::new(0.5, 0.5, 1.0), 8);
    let (rho_dark, rho_bright) = (room.two_sided(0.9), room.two_sided(0.3));
    for (x, grey) in [(0.0, rho_dark), (1.0, rho_bright)] {
        let low = DVec3::X * x;
        for (face, (corner, e1, e2)) in rooms::faces(low, low + 1.0).into_iter().enumerate() {
            let between = (x == 0.0 && face == 1) || (x == 1.0 && face == 0);
            if !between {
                room.quad(corner, e1, e2, grey, 0.0);
            }
        }
    }
    room.quad(DVec3::new(1.0, 0.0, 0.0), DVec3::Z, DVec3::Y * (1.0 - gap), rho_dark, 0.0);
    for (x, emission) in [(0.0, dark), (1.0, bright)] {
        let black = room.grey(0.0);
        room.quad(DVec3::new(x + 0.3, 0.999, 0.3), DVec3::X * 0.4, DVec3::Z * 0.4, black, emission);
    }
    room
}

/// B5: radiances of 1e-6 and 1e6 in one scene.
pub fn bright_beside_dark(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    let irradiances = |room: &Room| -> Result<Vec<(f64, f64)>, Trouble> {
        let mut settings = quick(1, 0.25);
        settings.pass_one.form_factor_tolerance = 0.01;
        let solved = solve_gathered(room.scene()?, &settings)?;
        let (field, origin) = (&solved.pass_one.field, solved.world.scene().origin);
        let place = |i: usize| f64::from(field.patches.centroid[i].x) + f64::from(field.patches.normal[i].x) * 1e-3 + origin.x;
        Ok((0..field.patches.len()).map(|i| (place(i), field.irradiance_of(i).g)).collect())
    };
    let both = irradiances(&two_rooms(1e-6, 1e6, 0.0))?;
    let alone = irradiances(&two_rooms(1e-6, 0.0, 0.0))?;
    let in_dark = both.iter().zip(&alone).filter(|((x, _), (_, h))| *x < 1.0 && *h > 0.0);
    let error = in_dark.clone().map(|((_, b), (_, a))| (b / a - 1.0).abs()).fold(0.0, f64::max);
    let told = format!("worst of {} patches", in_dark.count());
    let law = "every patch of the dark room as if its lamp (1e-6) shone alone beside a lamp of 1e6";
    rows.error("two closed rooms", law, "alone", told, error, 1e-2, None);
    let (both, bright, dark) = (
        irradiances(&two_rooms(1e-6, 1e6, 0.05))?,
        irradiances(&two_rooms(0.0, 1e6, 0.05))?,
        irradiances(&two_rooms(1e-6, 0.0, 0.05))?,
    );
    let error = |i: usize| (both[i].1 - bright[i].1 - dark[i].1).abs() / both[i].1.max(f64::MIN_POSITIVE);
    let error = (0..both.len()).map(error).fold(0.0, f64::max);
    let ratio = both.iter().map(|b| b.1).fold(0.0, f64::max)
        / both.iter().map(|b| b.1).filter(|h| *h > 0.0).fold(f64::INFINITY, f64::min);
    let told = format!("irradiances span a factor of {ratio:.1e}");
    rows.error("two rooms and a slit", "both lamps = the sum of each, in every patch", "sum", told, error, 1e-4, None);
    faint_as_bright(rows, &irradiances)
}

/// Place along x and irradiance of the patches of a room.
type Irradiances = dyn Fn(&Room) -> Result<Vec<(f64, f64)>, Trouble>;

/// What is faint is not rounded away: a lamp gives as much more light as it is stronger, however weak it is. A threshold in units of
/// radiance would hide from the rows above, where both sides of the equation fall below it.
fn faint_as_bright(rows: &mut Rows<'_>, irradiances: &Irradiances) -> Result<(), Trouble> {
    for gap in [0.0, 0.05] {
        let (faint, one) = (irradiances(&two_rooms(1e-6, 0.0, gap))?, irradiances(&two_rooms(1.0, 0.0, gap))?);
        let error = faint.iter().zip(&one).map(|((_, f), (_, o))| if f == o { 0.0 } else { (f / (o * 1e-6) - 1.0).abs() });
        let error = error.fold(0.0, |a: f64, b| if b > a || b.is_nan() { b } else { a });
        let lit = one.iter().filter(|(_, h)| *h > 0.0).count();
        let name = if gap > 0.0 { "a faint lamp alone, slit open" } else { "a faint lamp alone" };
        let law = "every patch by a lamp of 1e-6 = 1e-6 times by a lamp of 1";
        rows.error(name, law, "by a lamp of 1", format!("worst of {lit} lit patches"), error, 1e-9, None);
    }
    let seen = |emission: f64| -> Result<Vec<f64>, Trouble> {
        let image = rooms::picture(two_rooms(emission, 0.0, 0.0).scene()?, &quick(8, 0.25))?.film.image();
        Ok(image.pixels().iter().flatten().map(|v| f64::from(*v)).collect())
    };
    // By a power of two, so that rounding decides nothing.
    let scale = 2.0_f64.powi(-20);
    let (faint, one) = (seen(scale)?, seen(1.0)?);
    let differing = faint.iter().zip(&one).filter(|(f, o)| **f != *o * scale).count();
    let is_so = differing == 0 && one.iter().any(|v| *v > 0.0);
    let law = "the picture by a lamp of 2^-20 = 2^-20 times that by a lamp of 1";
    rows.holds("a faint lamp alone, seen", law, "same bits", format!("{differing} of {} values differ", one.len()), is_so);
    Ok(())
}

/// B13: what leaves an open room is known.
pub fn open_room(rows: &mut Rows<'_>) -> Result<(), Trouble> {
    for rho in [0.5, 0.95] {
        let mut room = furnace(rho);
        room.source.shapes.pop();
        let mut settings = quick(1, 0.25);
        settings.pass_one.solver = TIGHT;
        let power = solve_gathered(room.scene()?, &settings)?.pass_one.power;
        let name = format!("cube without a wall, rho {rho}");
        let accounted = power.absorbed + power.escaped + power.truncated;
        rows.value(&name, "emitted = absorbed + escaped [W]", power.emitted, accounted, 1e-6);
        let is_so = power.escaped > 0.05 * power.emitted;
        let got = format!("{} of {}", figure(power.escaped), figure(power.emitted));
        rows.holds(&name, "the power that escapes is reported", "above 0", got, is_so);
    }
    Ok(())
}
