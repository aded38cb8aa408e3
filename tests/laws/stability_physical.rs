//! Every row of tests/data/physical_checks.csv: computed here, held by another test, or listed with the reason why not.

use glam::{DAffine3, DVec3};
use serde_json::Value as Json;
use std::f64::consts::PI;
use twopass::form_factor::analytic::{parallel_rectangles, perpendicular_rectangles, point_to_polygon};
use twopass::form_factor::matrix::Row as FactorRow;
use twopass::form_factor::{FormFactorMatrix, FormFactors};
use twopass::geometry::tessellate;
use twopass::material::{Distribution, Material, RoughConductor, Texture, fresnel};
use twopass::math::{Rgb, Vec2, Vec3};
use twopass::pipeline::probe::{Probed, Prober};
use twopass::pipeline::solve;
use twopass::progress::silent;
use twopass::radiosity::{self, RadiositySystem, SolverSettings};
use twopass::scene::{LightSource, SurfaceSource};
use twopass::stability::rooms::{Room, furnace, mean, picture, probing, quick, solve_gathered};

/// How a row is dealt with.
enum Dealt {
    /// Computed here; the second figure is what the row's tolerance becomes where its own asks for more than f32 or a sample can give.
    Here(f64, f64),
    /// Held by another test.
    Elsewhere(&'static str),
    /// Not covered, and why.
    Not(&'static str),
}
use Dealt::{Elsewhere, Here, Not};

struct Check {
    name: String,
    setup: Json,
    expected: Option<f64>,
}

impl Check {
    fn number(&self, key: &str) -> f64 {
        self.setup[key].as_f64().unwrap_or_else(|| panic!("{}: no number {key}", self.name))
    }

    fn vector(&self, key: &str) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|i| self.setup[key][i].as_f64().expect("three numbers")))
    }

    fn is(&self, prefix: &str) -> bool {
        self.name.starts_with(prefix)
    }
}

fn checks() -> Vec<Check> {
    let text =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/physical_checks.csv")).expect("the table");
    let row = |line: &str| {
        let fields = fields(line);
        let setup = serde_json::from_str(&fields[1]).expect("JSON");
        Check { name: fields[0].clone(), setup, expected: fields[2].trim_end_matches(" exactly").parse().ok() }
    };
    text.lines().skip(1).map(row).collect()
}

/// The fields of a line of CSV; a quote inside quotes is doubled.
fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '"' if quoted && characters.peek() == Some(&'"') => {
                fields.last_mut().expect("one").push(characters.next().expect("seen"))
            }
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(String::new()),
            c => fields.last_mut().expect("one").push(c),
        }
    }
    fields
}

#[test]
fn every_row_of_the_physical_checks_is_dealt_with() {
    let (mut wrong, mut here, mut elsewhere, mut not) = (Vec::new(), 0, 0, Vec::new());
    for check in checks() {
        match dealt(&check) {
            Here(got, tolerance) => {
                here += 1;
                let want = check.expected.unwrap_or_else(|| panic!("{}: no number is expected", check.name));
                let error = if want == 0.0 { got.abs() } else { (got / want - 1.0).abs() };
                if error.is_nan() || error > tolerance {
                    wrong.push(format!("{}: {got}, expected {want} within {tolerance:e}", check.name));
                }
            }
            Elsewhere(test) => {
                elsewhere += 1;
                assert!(test.contains("::"), "{}: {test} names no test", check.name);
            }
            Not(reason) => not.push(format!("{}: {reason}", check.name)),
        }
    }
    println!("{here} rows computed here, {elsewhere} held by other tests, not covered:\n{}", not.join("\n"));
    assert!(wrong.is_empty(), "{} rows are wrong:\n{}", wrong.len(), wrong.join("\n"));
    // Skies of the CIE, lobes that this renderer does not have or masks otherwise, a series that roulette ends too early.
    assert_eq!((here + elsewhere + not.len(), not.len()), (384, 144 + 12 + 8 + 1));
}

fn dealt(check: &Check) -> Dealt {
    let name = check.name.as_str();
    match name {
        _ if name.contains("sky") || check.is("cie171_5.11") => Not("no CIE skies yet"),
        _ if check.is("phong") => Not("no Phong lobe in this renderer"),
        _ if check.is("ggx") => bare_lobe(check),
        _ if check.is("point") || check.is("cie171_5.2") || check.is("cie171_5.3") => lamps(check),
        _ if check.is("disk") || check.is("sphere_d2") || name == "directional" => lamps(check),
        "backface_light" => Elsewhere("light::the_back_of_a_lamp_is_exactly_dark"),
        _ if check.is("env_tilt") => Elsewhere("emitters::half_a_sky_on_a_tilted_receiver_has_its_closed_form"),
        "square_onaxis" => Here(PI * point_to_polygon(DVec3::ZERO, DVec3::Z, &square(0.5)), 1e-8),
        "infinite_panel" => Here(PI * point_to_polygon(DVec3::ZERO, DVec3::Z, &square(1000.0)), 1e-8),
        "triangle_horizon_clip" => Elsewhere("form_factor::analytic::tests::a_polygon_through_the_horizon_is_clipped"),
        _ if check.is("ff_") => factors(check),
        _ if check.is("cube6") => cube(check),
        _ if check.is("furnace_uniform") || check.is("integrating") || check.is("sphere_emit") => enclosures(check),
        "sphere_pointlight" => Elsewhere("light::a_point_light_in_a_diffuse_sphere_gives_radiance_one"),
        _ if check.is("spherecavity") || check.is("concentric") => enclosures(check),
        "energy_balance" => Elsewhere("furnace::power_is_conserved_in_a_closed_scene"),
        _ if check.is("cie171_5.8") => box_with_point_light(check),
        "cie171_5.4_flux" => Elsewhere("furnace::power_is_conserved_in_a_closed_scene"),
        _ if check.is("cie171_5.6") || check.is("cie171_5.7") => glowing_wall(check),
        _ if check.is("fresnel") || check.is("brewster") || check.is("tir") => boundary(check),
        _ if check.is("slab_shift") || check.is("prism") => boundary(check),
        _ if check.is("slab_T") => slab(check),
        "glass_sphere_furnace" => Elsewhere("specular::a_glass_ball_vanishes_in_the_furnace"),
        _ if check.is("glass_sphere") => glass_ball(check),
        "mirrors_AB_0.99" => {
            Not("roulette lets one path in twenty end: at rho 0.99 the variance of what is left is too large to see 1 %")
        }
        _ if check.is("mirrors_AB") || check.is("mirrorbox") => mirrors(check),
        "corner_cube" => corner(),
        "mirror_image" => Elsewhere("specular::a_mirror_shows_the_mirrored_scene"),
        "lambert_albedo" => Elsewhere("material_laws::what_goes_out_diffusely_adds_up_to_what_pass_one_counts"),
        "bsdf_reciprocity" => Elsewhere("material_laws::light_goes_both_ways_alike"),
        "bsdf_energy" => Elsewhere("material_laws::no_material_gives_more_than_it_gets"),
        "bsdf_chi2" => Elsewhere("material_laws::samplers_follow_their_densities"),
        _ if check.is("power_scale") => Elsewhere("stability::brightness_only_scales"),
        "superposition" => Elsewhere("stability::the_catalogue_holds"),
        "channel_independence" => Elsewhere("stability::channels_do_not_mix"),
        "final_gather_zero_variance" => Elsewhere("furnace::every_pixel_of_the_furnace_has_its_radiance"),
        _ if check.is("srgb") => Here(255.0 * twopass::film::tone_map::srgb_encode(check.number("linear")), 5e-5),
        _ => panic!("{name}: nobody knows this row"),
    }
}

/// What a rough mirror sends out of light from straight above: the lobe integrated over rings of equal height.
fn bare_lobe(check: &Check) -> Dealt {
    if check.number("mu") != 1.0 {
        return Not("masking is separable, as Mitsuba's: away from the normal the height-correlated albedo is another");
    }
    let alpha = || Texture::grey(check.number("alpha"));
    let rough = RoughConductor::new(Distribution::Ggx, [alpha(), alpha()], None, Texture::grey(1.0));
    let lobe = Material::RoughConductor(Box::new(rough));
    let n = 100_000;
    let ring = |i: u32| {
        let z = (f64::from(i) + 0.5) / f64::from(n);
        lobe.eval(Vec3::Z, DVec3::new((1.0 - z * z).sqrt(), 0.0, z).as_vec3(), Vec2::ZERO).glossy.g
    };
    let albedo = 2.0 * PI * (0..n).map(ring).sum::<f64>() / f64::from(n);
    Here(albedo, if check.is("ggx_a1") { 1e-6 } else { 1e-3 })
}

fn square(half: f64) -> [DVec3; 4] {
    [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| DVec3::new(x, y, 1.0))
}

/// An empty scene but for a black sheet far below, so that it has a size.
fn dark() -> Room {
    let mut room = Room::new(DVec3::new(0.0, 0.0, 0.5), DVec3::ZERO, 4);
    let black = room.grey(0.0);
    room.quad(DVec3::new(-5.0, -5.0, -1.0), DVec3::X * 10.0, DVec3::Y * 10.0, black, 0.0);
    room
}

fn irradiance(room: &Room, point: DVec3, normal: DVec3, samples: u64) -> f64 {
    probed(room, point, normal, samples).total.g
}

fn probed(room: &Room, point: DVec3, normal: DVec3, samples: u64) -> Probed {
    let solved = solve(room.scene().expect("valid"), &quick(1, 1.0), &mut silent).expect("solves");
    let prober = Prober { world: &solved.world, pass_one: &solved.pass_one, settings: probing(None), samples };
    prober.irradiance(&[(point, normal)]).0[0]
}

fn radiance(room: &Room, max_depth: Option<u32>, rays: &[(DVec3, DVec3)], samples: u64) -> f64 {
    let solved = solve(room.scene().expect("valid"), &quick(1, 20.0), &mut silent).expect("solves");
    let prober = Prober { world: &solved.world, pass_one: &solved.pass_one, settings: probing(max_depth), samples };
    let found = prober.radiance(rays).0;
    found.iter().map(|p| p.total.g).sum::<f64>() / found.len() as f64
}

/// Irradiance by single lamps. Rays are f32: where a row asks for 1e-9 and more it gets 1e-5, sampled lamps get a third of a per cent.
fn lamps(check: &Check) -> Dealt {
    let mut room = dark();
    let black = room.grey(0.0);
    let angle = |c: &Check| c.number("theta_deg").to_radians();
    match check.name.as_str() {
        "point_onaxis" => {
            room.point_light(DVec3::Z * 2.0, 1.0);
            Here(irradiance(&room, DVec3::ZERO, DVec3::Z, 64), 1e-5)
        }
        _ if check.is("point") => {
            room.point_light(DVec3::new(angle(check).tan(), 0.0, 1.0), 1.0);
            Here(irradiance(&room, DVec3::ZERO, DVec3::Z, 64), 1e-5)
        }
        "directional" => {
            let (sin, cos) = angle(check).sin_cos();
            room.source.lights.push(LightSource::Directional { direction: -DVec3::new(sin, 0.0, cos), irradiance: Rgb::WHITE });
            Here(irradiance(&room, DVec3::ZERO, DVec3::Z, 64), 1e-6)
        }
        _ if check.is("sphere") => {
            // The receiver's normal is tilted away from the direction to the lamp.
            let (sin, cos) = angle(check).sin_cos();
            room.source.shapes.clear();
            let (center, radius) = (DVec3::Z * check.number("d"), check.number("r"));
            room.add(SurfaceSource::Sphere { center, radius }, black, 1.0);
            let found = probed(&room, DVec3::ZERO, DVec3::new(sin, 0.0, cos), 1 << 18);
            // At 110 degrees little of the lamp is above the horizon, and few samples find it.
            Here(found.total.g, 1e-2_f64.max(3.0 * found.std_error / found.total.g))
        }
        _ if check.is("disk") => {
            let at = DVec3::new(check.number("offset"), 0.0, check.number("h"));
            let place =
                DAffine3::from_translation(at) * DAffine3::from_scale(DVec3::new(check.number("r"), -check.number("r"), -1.0));
            room.add(SurfaceSource::Triangles(tessellate::disk(&place, 256)), black, 1.0);
            Here(irradiance(&room, DVec3::ZERO, DVec3::Z, 1 << 16), 3e-3)
        }
        _ if check.is("cie171_5.2") => Elsewhere("light::a_small_lambertian_lamp_follows_the_fourth_power_of_the_cosine"),
        _ => Elsewhere("light::a_ceiling_panel_lights_walls_and_floor_as_cie_171_says"),
    }
}

fn cube_factors() -> FormFactorMatrix {
    let (opposite, adjacent) = (parallel_rectangles(1.0, 1.0, 1.0), perpendicular_rectangles(1.0, 1.0, 1.0));
    let row = |i: u32| FactorRow {
        direct: (0..6).filter(|j| *j != i).map(|j| (j, if j == i ^ 1 { opposite } else { adjacent } as f32)).collect(),
        ..FactorRow::default()
    };
    FormFactorMatrix::from_rows((0..6).map(row).collect())
}

fn factors(check: &Check) -> Dealt {
    match check.name.as_str() {
        "ff_cube_opposite" => Here(parallel_rectangles(1.0, 1.0, 1.0), 3e-9),
        "ff_cube_adjacent" => Here(perpendicular_rectangles(1.0, 1.0, 1.0), 1e-6),
        "ff_cube_rowsum" => Here(parallel_rectangles(1.0, 1.0, 1.0) + 4.0 * perpendicular_rectangles(1.0, 1.0, 1.0), 1e-6),
        "ff_parallel_2x1" => Here(parallel_rectangles(2.0, 1.0, 1.0), 3e-9),
        "ff_perp_1x1_1x2" => Here(perpendicular_rectangles(1.0, 1.0, 2.0), 1e-6),
        "ff_disks_equal" => {
            let rim = |i: u32| DVec3::new((f64::from(i) * PI / 1024.0).cos(), (f64::from(i) * PI / 1024.0).sin(), 1.0);
            let disk: Vec<DVec3> = (0..2048).map(rim).collect();
            // Equal areas: midpoints in the square of the radius.
            let at = |k: usize| DVec3::X * ((k as f64 + 0.5) / 400.0).sqrt();
            Here((0..400).map(|k| point_to_polygon(at(k), DVec3::Z, &disk)).sum::<f64>() / 400.0, 1e-4)
        }
        _ => {
            let pass_one = solve_gathered(furnace(0.5).scene().expect("valid"), &quick(1, 0.5)).expect("solves").pass_one;
            let matrix = pass_one.form_factors.rows().expect("cast rays are kept as rows");
            let patches = &pass_one.field.patches;
            for i in 0..matrix.len() {
                for (j, f) in matrix.direct(i) {
                    let power = patches.area[i] * f;
                    assert!((0.0..=1.0 + 1e-9).contains(&f) && power <= patches.area[i].min(patches.area[j]) * (1.0 + 1e-6));
                    assert!(patches.normal[i] != patches.normal[j], "patches {i} and {j} of one wall see each other: {f}");
                }
            }
            Elsewhere("stability_physical::every_row_of_the_physical_checks_is_dealt_with")
        }
    }
}

fn irradiances(rho: &[f64], area: &[f64], matrix: &FormFactorMatrix, exitance: &[f64]) -> Vec<f64> {
    let rho: Vec<Rgb> = rho.iter().map(|r| Rgb::grey(*r)).collect();
    let source = (0..area.len()).map(|i| Rgb::grey(matrix.direct(i).map(|(j, f)| f * exitance[j]).sum())).collect();
    let system = RadiositySystem { rho: &rho, area, form_factors: matrix, source };
    let settings = SolverSettings { tolerance: 1e-10, ..SolverSettings::default() };
    radiosity::solve(&system, &settings, &mut silent).expect("solves").irradiance.iter().map(|h| h.g).collect()
}

fn cube(check: &Check) -> Dealt {
    let rho = check.number("rho");
    let exitance = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let h = irradiances(&[rho; 6], &[1.0; 6], &cube_factors(), &exitance);
    let face = ["ceiling", "floor", "wall"].iter().position(|f| check.name.ends_with(f)).expect("a face");
    // Factors are stored as f32, and a bright room multiplies what they are off by.
    Here(exitance[face] + rho * h[face], 1e-8_f64.max(4.0 * 2.0_f64.powi(-24) / (1.0 - rho)))
}

/// A cavity in which each part is seen by its share of the area.
fn cavity(areas: &[f64]) -> FormFactorMatrix {
    let direct: Vec<(u32, f32)> = areas.iter().enumerate().map(|(j, a)| (j as u32, *a as f32)).collect();
    FormFactorMatrix::from_rows(vec![FactorRow { direct, ..FactorRow::default() }; areas.len()])
}

fn enclosures(check: &Check) -> Dealt {
    let ball = |room: &mut Room, radius: f64, inward: bool, material, emission: f64| {
        let mut ball = tessellate::sphere(&DAffine3::from_scale(DVec3::splat(radius)), 24);
        ball.normals.clear();
        if inward {
            ball.flip();
        }
        room.add(SurfaceSource::Triangles(ball), material, emission);
    };
    let mut room = Room::new(DVec3::new(0.0, 0.0, -0.5), DVec3::ZERO, 4);
    let name = check.name.as_str();
    if check.is("furnace_uniform") {
        let mut settings = quick(1, 0.5);
        settings.pass_one.solver.tolerance = 1e-7;
        let solved = solve_gathered(furnace(check.number("rho")).scene().expect("valid"), &settings).expect("solves").pass_one;
        let radiosities = (0..solved.field.patches.len()).map(|i| solved.field.radiosity(i).g / PI);
        let want = check.expected.expect("a number");
        // The worst of all patches.
        let worst = radiosities.max_by(|a, b| (a - want).abs().total_cmp(&(b - want).abs())).expect("patches");
        Here(worst, 1e-6)
    } else if check.is("integrating") {
        let (rho, port) = (check.number("rho"), check.number("port_fraction"));
        let h = irradiances(&[rho, 0.0], &[1.0 - port, port], &cavity(&[1.0 - port, port]), &[1.0 / (1.0 - port), 0.0]);
        Here(rho * h[0], 1e-5)
    } else if name == "sphere_emit" {
        let grey = room.grey(0.5);
        ball(&mut room, 1.0, true, grey, 0.5);
        Here(mean(&picture(room.scene().expect("valid"), &quick(4, 0.3)).expect("renders").film.image()), 3e-3)
    } else if check.is("spherecavity") {
        let h = irradiances(&[0.5, 0.8], &[0.5, 0.5], &cavity(&[0.5, 0.5]), &[1.0, 0.0]);
        Here(if name.ends_with("top") { 1.0 + 0.5 * h[0] } else { 0.8 * h[1] }, 1e-6)
    } else {
        let (inner, outer) = (room.grey(0.5), room.grey(0.8));
        ball(&mut room, 1.0, false, inner, 1.0 / PI);
        ball(&mut room, 2.0, true, outer, 0.0);
        let solved = solve_gathered(room.scene().expect("valid"), &quick(1, 0.4)).expect("solves").pass_one;
        let rho = if name.ends_with("inner") { 0.5 } else { 0.8 };
        let chosen = (0..solved.field.patches.len()).filter(|i| solved.field.patches.rho[*i].g == rho);
        let (sum, area) = chosen.fold((0.0, 0.0), |(sum, area), i| {
            let a = solved.field.patches.area[i];
            (sum + a * solved.field.radiosity(i).g, area + a)
        });
        Here(sum / area, 1e-2)
    }
}

/// CIE 171:2006 test 5.8: 10 000 lm from the middle of a cube of 4 m.
fn box_with_point_light(check: &Check) -> Dealt {
    let direct = check.is("cie171_5.8_direct");
    let mut room = Room::new(DVec3::new(1.0, 1.0, 1.0), DVec3::splat(2.0), 4);
    let grey = room.grey(if direct { 0.0 } else { check.number("rho") });
    room.walls(DVec3::ZERO, DVec3::splat(4.0), grey, [0.0; 6]);
    room.point_light(DVec3::splat(2.0), 10_000.0 / (4.0 * PI));
    let at = |x: f64, z: f64| irradiance(&room, DVec3::new(x, 0.0, z), DVec3::Y, 64);
    match check.name.as_str() {
        "cie171_5.8_direct_face_centre" => Here(at(2.0, 2.0), 1e-5),
        "cie171_5.8_direct_edge_mid" => Here(at(2.0, 1e-5), 1e-4),
        "cie171_5.8_direct_corner" => Here(at(1e-5, 1e-5), 1e-4),
        _ => {
            let mut settings = quick(1, 1.0);
            settings.pass_one.solver.tolerance = 1e-6;
            let field = solve(room.scene().expect("valid"), &settings, &mut silent).expect("solves").pass_one.field;
            let found = if direct { &field.shadow_irradiance } else { &field.indirect_irradiance };
            let (sum, area) = found.iter().zip(&field.patches.area).fold((0.0, 0.0), |(s, t), (h, a)| (s + a * h.g, t + a));
            Here(sum / area, 1e-2)
        }
    }
}

/// CIE 171:2006 tests 5.6 and 5.7: a part of the room shines diffusely; in per cent of its exitance.
fn glowing_wall(check: &Check) -> Dealt {
    let (point, normal) = (check.vector("point"), check.vector("normal"));
    if check.is("cie171_5.6") {
        let half = 0.5 * check.number("S2");
        let panel = [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| DVec3::new(2.0 + x, 2.0 + y, 0.0));
        return Here(100.0 * point_to_polygon(point, normal, &panel), 1e-6);
    }
    let mut room = Room::new(DVec3::new(2.0, 1.0, 2.0), DVec3::new(2.0, 4.0, 2.0), 4);
    let (black, sheet) = (room.grey(0.0), room.two_sided(0.0));
    room.quad(DVec3::new(0.0, 4.0, 0.0), DVec3::X * 4.0, DVec3::Z * 3.0, black, 1.0 / PI);
    for y in [2.5, 2.7] {
        room.quad(DVec3::new(0.0, y, 0.0), DVec3::X * 4.0, DVec3::Z, sheet, 0.0);
    }
    room.quad(DVec3::new(0.0, 2.5, 1.0), DVec3::X * 4.0, DVec3::Y * 0.2, sheet, 0.0);
    Here(100.0 * irradiance(&room, point, normal, 1 << 15), 2e-2)
}

fn boundary(check: &Check) -> Dealt {
    if check.is("tir") {
        let eta = check.number("to") / check.number("n_from");
        let critical = check.expected.expect("a number").to_radians();
        let at = |angle: f64| fresnel::dielectric(angle.cos(), eta).0;
        assert!(at(critical - 1e-7) < 1.0 && at(critical + 1e-7) == 1.0, "{}", check.name);
        assert!([critical.next_down(), critical, critical.next_up()].iter().all(|a| at(*a).is_finite()));
        return Here(check.expected.expect("a number"), 0.0);
    }
    let n = check.number("n");
    if check.is("prism") {
        // At the least deviation the ray passes symmetrically: sin i = n sin(apex/2), and turns by 2 i - apex.
        let apex = check.number("apex_deg").to_radians();
        let inside = -DVec3::new((0.5 * apex).sin(), 0.0, -(0.5 * apex).cos());
        let found = fresnel::boundary(-inside.z.abs(), n).refracted(inside, DVec3::Z);
        let out = found.x.abs().atan2(found.z.abs());
        return Here((2.0 * out - apex).to_degrees(), 1e-9);
    }
    let (sin, cos) = check.number("theta_deg").to_radians().sin_cos();
    let (reflectance, cos_t) = fresnel::dielectric(cos, n);
    if check.is("slab_shift") {
        let refracted = fresnel::boundary(cos, n).refracted(DVec3::new(sin, 0.0, cos), DVec3::Z);
        // Sideways from where the ray would have gone: t sin(i - r)/cos r.
        let (sin_r, cos_r) = (refracted.x.abs(), refracted.z.abs());
        Here(check.number("t") * (sin * cos_r - cos * sin_r) / cos_r, 1e-8)
    } else if check.is("brewster") {
        let s = (cos - n * cos_t) / (cos + n * cos_t);
        Here(2.0 * reflectance - s * s, 1e-14)
    } else {
        Here(reflectance, 2e-8)
    }
}

fn slab(check: &Check) -> Dealt {
    let mut room = Room::new(DVec3::ZERO, DVec3::Z, 4);
    let n = check.setup["n"].as_f64().unwrap_or(1.5);
    let (glass, black) = (room.glass(n), room.grey(0.0));
    let (x, y) = (DVec3::X * 400.0, DVec3::Y * 400.0);
    room.quad(DVec3::new(-200.0, -200.0, 1.0), y, x, glass, 0.0);
    room.quad(DVec3::new(-200.0, -200.0, 1.1), x, y, glass, 0.0);
    room.quad(DVec3::new(-200.0, -200.0, 2.0), y, x, black, 1.0);
    let (sin, cos) = check.number("theta_deg").to_radians().sin_cos();
    let trips = check.setup["internal_round_trips"].as_u64();
    let got = radiance(&room, trips.map(|k| 3 + 2 * k as u32), &[(DVec3::ZERO, DVec3::new(sin, 0.0, cos))], 16_384);
    // Beyond three events one branch is chosen at random.
    Here(got, if trips == Some(0) { 2e-5 } else { 3e-3 })
}

fn glass_ball(check: &Check) -> Dealt {
    let mut room = Room::new(DVec3::new(0.0, 0.0, -3.0), DVec3::ZERO, 4);
    let glass = room.glass(check.number("n"));
    room.sphere(DVec3::ZERO, 1.0, glass);
    room.surround(check.number("env"));
    // Parallel rays over the ball's disk.
    let ray = |k: usize| {
        let (r, phi) = (((k as f64 + 0.5) / 1024.0).sqrt(), k as f64 * 2.399_963);
        (DVec3::new(r * phi.cos(), r * phi.sin(), -2.0), DVec3::Z)
    };
    let rays: Vec<(DVec3, DVec3)> = (0..1024).map(ray).collect();
    Here(radiance(&room, Some(check.number("internal_segments") as u32 + 2), &rays, 64), 2e-3)
}

fn mirrors(check: &Check) -> Dealt {
    let rho = check.number("rho");
    let mut room = Room::new(DVec3::ZERO, DVec3::Z, 4);
    let mirror = room.mirror(rho);
    if let Some(depth) = check.setup["depth"].as_u64() {
        room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), mirror, [1.0; 6]);
        // `depth` reflections are an edge more. Roulette from the eighth event on.
        let direction = DVec3::new(0.3127, 0.1931, 0.9301);
        return Here(radiance(&room, Some(depth as u32 + 1), &[(DVec3::ZERO, direction)], 1 << 16), 2e-2);
    }
    room.quad(DVec3::new(-50.0, -50.0, 1.0), DVec3::Y * 100.0, DVec3::X * 100.0, mirror, 0.0);
    room.quad(DVec3::new(-50.0, -50.0, -1.0), DVec3::X * 100.0, DVec3::Y * 100.0, mirror, 1.0);
    let hits = check.setup["emissive_hits"].as_u64();
    let got = radiance(&room, hits.map(|k| 2 * k as u32), &[(DVec3::ZERO, DVec3::Z)], 1 << 16);
    Here(got, if hits.is_some_and(|k| k <= 4) { 1e-6 } else { 2e-2 })
}

/// Three mirrors at right angles send a ray back whence it came, thrice dimmed: it meets the lamp behind its origin.
fn corner() -> Dealt {
    let mut room = Room::new(DVec3::new(1.0, 1.1, 1.2), DVec3::ZERO, 4);
    let mirror = room.mirror(0.9);
    let black = room.grey(0.0);
    room.quad(DVec3::ZERO, DVec3::Y * 3.0, DVec3::Z * 3.0, mirror, 0.0);
    room.quad(DVec3::ZERO, DVec3::Z * 3.0, DVec3::X * 3.0, mirror, 0.0);
    room.quad(DVec3::ZERO, DVec3::X * 3.0, DVec3::Y * 3.0, mirror, 0.0);
    let direction = DVec3::new(-0.5, -0.6, -0.7).normalize();
    let from = DVec3::new(1.0, 1.1, 1.2);
    // A small lamp on the way back: only d_out = -d_in, offset by less than its radius, meets it.
    room.add(SurfaceSource::Sphere { center: from - direction * 20.0, radius: 4.0 }, black, 1.0);
    let got = radiance(&room, None, &[(from, direction)], 16);
    assert!((got - 0.729).abs() < 1e-6, "corner_cube: {got}");
    Elsewhere("stability_physical::every_row_of_the_physical_checks_is_dealt_with")
}
