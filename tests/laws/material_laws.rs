//! Materials against Mitsuba's values, and the laws that any material obeys.

use crate::loading::{Fixture, scene};
use std::f64::consts::{PI, TAU};
use std::path::Path;
use twopass::material::texture::{Bitmap, Filter, Wrap};
use twopass::material::{Material, Relief, ReliefMap, Surface, Texture};
use twopass::math::{Rgb, Vec2, Vec3, sampler::mix};

/// Where textures would be read; the materials here have none.
const UV: Vec2 = Vec2::new(0.3, 0.7);

/// The material that a `<bsdf>` element describes.
fn surface(xml: &str) -> Surface {
    scene(xml).materials[0].clone()
}

fn material(xml: &str) -> Material {
    surface(xml).material
}

/// The directions as a caller hands them to a material: mirrored if it is two-sided and opaque.
fn handed_on(surface: &Surface, wo: Vec3, wi: Vec3) -> (Vec3, Vec3) {
    let mirrored = wo.z < 0.0 && surface.two_sided && !surface.material.is_transmissive();
    let turn = |v: Vec3| if mirrored { Vec3::new(v.x, v.y, -v.z) } else { v };
    (turn(wo), turn(wi))
}

/// A set of values of one material.
struct Set {
    name: String,
    xml: String,
    /// wo, wi, f cos, density.
    records: Vec<[f32; 10]>,
}

/// The sets of tests/data/bsdf/materials.f32; make.py beside it tells the format.
fn fixture() -> Vec<Set> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/bsdf/materials.f32");
    let bytes = std::fs::read(path).expect("the fixture");
    let end = bytes.windows(2).position(|w| w == b"\n\n").expect("an empty line after the header");
    let header = std::str::from_utf8(&bytes[..end]).expect("text");
    let numbers: Vec<f32> = bytes[end + 2..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let mut records = numbers.chunks_exact(10).map(|r| <[f32; 10]>::try_from(r).unwrap());
    let sets: Vec<Set> = header
        .lines()
        .map(|line| {
            let set: serde_json::Value = serde_json::from_str(line).expect("JSON");
            let text = |key: &str| set[key].as_str().expect("text").to_owned();
            let count = set["count"].as_u64().expect("a number") as usize;
            Set { name: text("name"), xml: text("xml"), records: records.by_ref().take(count).collect() }
        })
        .collect();
    assert!(sets.len() > 35 && sets.iter().all(|s| s.records.len() >= 500) && records.next().is_none());
    sets
}

/// Largest relative difference; values below 1e-6 count as that.
fn difference(got: f64, want: f64) -> f64 {
    (got - want).abs() / want.abs().max(1e-6)
}

/// Tolerance of the comparison with Mitsuba, which computes in single precision.
const SINGLE: f64 = 1e-4;

#[test]
fn values_and_densities_are_those_of_mitsuba() {
    let mut failures = Vec::new();
    for Set { name, xml, records } in fixture().iter().filter(|s| !s.name.starts_with("delta")) {
        let surface = surface(xml);
        let mut worst = (0.0, String::new());
        for r in records {
            let (wo, wi) = handed_on(&surface, Vec3::new(r[0], r[1], r[2]), Vec3::new(r[3], r[4], r[5]));
            let scattering = surface.material.eval(wo, wi, UV);
            let got = [scattering.total().to_array().as_slice(), &[surface.material.pdf(wo, wi, UV)]].concat();
            for (k, got) in got.into_iter().enumerate() {
                let error = difference(got, r[6 + k].into());
                if error > worst.0 {
                    worst = (error, format!("{name}: value {k} at wo {wo}, wi {wi}: {got}, Mitsuba {}", r[6 + k]));
                }
            }
        }
        println!("{name}: {:.1e}", worst.0);
        if worst.0 > SINGLE {
            failures.push(worst.1);
        }
    }
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn ideal_directions_are_those_of_mitsuba() {
    for Set { name, xml, records } in fixture().iter().filter(|s| s.name.starts_with("delta")) {
        let material = material(xml);
        for r in records {
            let (wo, wi) = (Vec3::new(r[0], r[1], r[2]), Vec3::new(r[3], r[4], r[5]));
            let near = |v: Vec3| (v - wi).length() < 1e-4;
            // One of these choices leads there, or the direction does not exist.
            let drawn = (0..64).filter_map(|i| material.sample(wo, UV, Vec2::splat(0.5), (i as f32 + 0.5) / 64.0));
            let lobes = material.lobes(wo, UV);
            let lobe = lobes.iter().find(|l| near(l.wi)).unwrap_or_else(|| panic!("{name}: nothing at {wi} for {wo}"));
            for k in 0..3 {
                let error = difference(lobe.weight[k], r[6 + k].into());
                assert!(error < SINGLE, "{name}, {wo} to {wi}: {:?}, Mitsuba {:?}", lobe.weight, &r[6..9]);
            }
            for sample in drawn.filter(|s| s.delta && near(s.wi)) {
                assert!(difference(sample.pdf, r[9].into()) < SINGLE, "{name}: {}, Mitsuba {}", sample.pdf, r[9]);
                assert!(difference((sample.weight * sample.pdf).g, r[7].into()) < SINGLE, "{name}: {sample:?}");
            }
        }
    }
}

/// Independent uniform numbers in [0, 1).
fn uniform(seed: u64, i: u64) -> f32 {
    (mix(seed << 40 | i) >> 40) as f32 / (1 << 24) as f32
}

/// Rows over the cosine and columns over the azimuth.
const GRID: (usize, usize) = (24, 32);

fn cell(v: Vec3) -> usize {
    let row = ((f64::from(v.z) + 1.0) * 0.5 * GRID.0 as f64).min(GRID.0 as f64 - 1.0) as usize;
    let turn = f64::from(v.y).atan2(v.x.into()).rem_euclid(TAU) / TAU;
    row * GRID.1 + ((turn * GRID.1 as f64) as usize).min(GRID.1 - 1)
}

/// Probability that a chi-square variable of `n` degrees exceeds `x`, by the cube root's normal limit (Wilson and Hilferty).
fn exceeds(x: f64, n: f64) -> f64 {
    let z = ((x / n).cbrt() - (1.0 - 2.0 / (9.0 * n))) / (2.0 / (9.0 * n)).sqrt();
    0.5 * libm::erfc(z / 2.0_f64.sqrt())
}

/// Probability of a worse fit of `samples` draws to the density `pdf`.
fn fit(seed: u64, samples: u64, draw: impl Fn(Vec2, f32) -> Option<Vec3>, pdf: impl Fn(Vec3) -> f64) -> f64 {
    let mut found = vec![0.0; GRID.0 * GRID.1 + 1];
    for i in 0..samples {
        let u = |k: u64| uniform(seed, 3 * i + k);
        // Draws without a direction are counted, too.
        found[draw(Vec2::new(u(0), u(1)), u(2)).map_or(GRID.0 * GRID.1, cell)] += 1.0;
    }
    let n = 24;
    let inside = |i: usize, k: usize, of: usize| (i as f64 + (k as f64 + 0.5) / f64::from(n)) / of as f64;
    let mut expected: Vec<f64> = (0..GRID.0 * GRID.1)
        .map(|c| {
            let points = (0..n * n).map(|k| {
                let z = 2.0 * inside(c / GRID.1, (k / n) as usize, GRID.0) - 1.0;
                let (s, c) = (TAU * inside(c % GRID.1, (k % n) as usize, GRID.1)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                pdf(Vec3::new((r * c) as f32, (r * s) as f32, z as f32))
            });
            points.sum::<f64>() / f64::from(n * n) * 2.0 * TAU / (GRID.0 * GRID.1) as f64 * samples as f64
        })
        .collect();
    expected.push((samples as f64 - expected.iter().sum::<f64>()).max(0.0));
    // Cells that expect little are thrown together.
    let (mut chi2, mut cells, mut rest) = (0.0, 0, (0.0, 0.0));
    for (found, expected) in found.into_iter().zip(expected) {
        if expected < 10.0 {
            rest = (rest.0 + found, rest.1 + expected);
        } else {
            chi2 += (found - expected).powi(2) / expected;
            cells += 1;
        }
    }
    chi2 += (rest.0 - rest.1).powi(2) / rest.1.max(1.0);
    exceeds(chi2, f64::from(cells))
}

/// Views from above, oblique and grazing, and from below for what lets light through.
fn views(material: &Material) -> Vec<Vec3> {
    let at = |z: f32, phi: f32| {
        let (s, c) = phi.sin_cos();
        Vec3::new((1.0 - z * z).sqrt() * c, (1.0 - z * z).sqrt() * s, z)
    };
    let mut views = vec![at(0.95, 0.3), at(0.6, 2.0), at(0.25, 4.0)];
    if material.is_transmissive() {
        views.extend([at(-0.9, 1.0), at(-0.4, 5.0)]);
    }
    views
}

/// Materials with lobes wide enough for the grid; the names tell the faulty one.
fn samplers() -> Vec<(String, Material)> {
    let wide = ["0.3", "tinted", "roughconductor", "roughdielectric", "blend", "mask", "diffuse", "plastic linear", "principled"];
    let sets = fixture().into_iter().filter(|s| !s.name.starts_with("delta") && wide.iter().any(|w| s.name.contains(w)));
    sets.map(|s| (material(&s.xml), s.name)).map(|(m, n)| (n, m)).collect()
}

#[test]
fn samplers_follow_their_densities() {
    let mut tests = Vec::new();
    for (n, (name, material)) in samplers().iter().enumerate() {
        for (k, wo) in views(material).into_iter().enumerate() {
            let seed = (16 * n + k) as u64;
            if material.has_glossy() {
                let draw = |u, choice| material.sample_glossy(wo, UV, u, choice).map(|s| s.wi);
                let p = fit(seed, 40_000, draw, |wi| material.glossy_pdf(wo, wi, UV));
                tests.push((p, format!("glossy lobes of {name} at {wo}")));
            }
            let draw = |u, choice| material.sample(wo, UV, u, choice).filter(|s| !s.delta).map(|s| s.wi);
            let p = fit(seed + 8192, 40_000, draw, |wi| material.pdf(wo, wi, UV));
            tests.push((p, format!("{name} at {wo}")));
        }
    }
    // 1 % for all of them together (Sidak).
    let level = 1.0 - 0.99_f64.powf(1.0 / tests.len() as f64);
    println!("{} tests, each at {level:.1e}; smallest {:?}", tests.len(), tests.iter().map(|t| t.0).fold(1.0, f64::min));
    let failed: Vec<_> = tests.iter().filter(|t| t.0 < level).map(|t| format!("{}: p = {:.1e}", t.1, t.0)).collect();
    assert!(failed.is_empty(), "\n{}", failed.join("\n"));
}

#[test]
fn tables_of_albedo_are_what_the_samplers_find() {
    for (name, material) in samplers().iter().filter(|(_, m)| m.has_glossy()) {
        for wo in views(material) {
            // Points of a regular lattice: their error falls with their number, not its root.
            let n = 60_000_u32;
            let mut sum = Rgb::BLACK;
            for i in 0..n {
                let k = f64::from(i) + 0.5;
                let u = Vec2::new((k * 0.754_877_666_246_693).fract() as f32, (k * 0.569_840_290_998_053).fract() as f32);
                let choice = (k * 0.819_172_513_396_164).fract() as f32;
                sum += material.sample_glossy(wo, UV, u, choice).map_or(Rgb::BLACK, |s| s.weight);
            }
            let (got, want) = (material.glossy_albedo(wo, UV), sum / f64::from(n));
            // Interpolation over the azimuth, and the n² inside glass, ask for more.
            let tolerance = if name.contains("aniso") || wo.z < 0.0 || name.contains("principled") { 1e-2 } else { 1.5e-3 };
            let error = (got - want).map(f64::abs).max();
            assert!(error < tolerance, "{name} at {wo}: table {got:?}, samples {want:?}");
        }
    }
}

#[test]
fn no_material_gives_more_than_it_gets() {
    for (name, material) in &samplers() {
        for wo in views(material) {
            let n = 20_000;
            let mut sum = Rgb::BLACK;
            for i in 0..n {
                let u = |k: u64| uniform(77, 3 * i + k);
                if let Some(s) = material.sample(wo, UV, Vec2::new(u(0), u(1)), u(2)) {
                    // Without the n² of radiance: power.
                    sum += s.weight * (s.eta * s.eta);
                }
            }
            let albedo = (sum / n as f64).max();
            if name.contains("principled") {
                println!("{name} at {wo}: {albedo:.4}");
            } else {
                assert!(albedo <= 1.0 + 1e-3, "{name} at {wo}: {albedo}");
            }
        }
    }
}

#[test]
fn light_goes_both_ways_alike() {
    for (name, material) in samplers() {
        if name.contains("principled") && material.is_transmissive() {
            continue;
        }
        // Indices below and above, as written in the fixture; only what bends light needs them.
        let eta: f64 = match name.as_str() {
            "roughdielectric ggx" | "blend sides" => 1.5,
            "roughdielectric beckmann" => 1.33,
            "roughdielectric ggx aniso" => 1.0 / 1.7,
            "roughdielectric beckmann aniso" => 1.8,
            _ => 1.0,
        };
        let n2 = |v: Vec3| if v.z < 0.0 { eta * eta } else { 1.0 };
        for i in 0..400 {
            let at = |k: u64| {
                let (z, phi) = (2.0 * uniform(5, 4 * i + k) - 1.0, TAU as f32 * uniform(5, 4 * i + k + 1));
                Vec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z)
            };
            let (a, b) = (at(0), at(2));
            let f = |wo: Vec3, wi: Vec3| material.eval(wo, wi, UV).total() / f64::from(wi.z.abs()) / n2(wo);
            let (there, back) = (f(a, b), f(b, a));
            let error = (there - back).map(f64::abs).max();
            assert!(error <= 1e-4 * there.max() + 1e-9, "{name}, {a} and {b}: {there:?} and {back:?}");
        }
    }
}

#[test]
fn what_goes_out_diffusely_adds_up_to_what_pass_one_counts() {
    for (name, material) in samplers().iter().filter(|(_, m)| m.has_diffuse()) {
        // Mean of the albedo towards each direction over a cosine-weighted hemisphere, front and back.
        let n = 2000;
        let mean: Rgb = (0..n)
            .map(|i| {
                let z = ((f64::from(i) + 0.5) / f64::from(n)).sqrt();
                material.diffuse_toward(Vec3::new((1.0 - z * z).sqrt() as f32, 0.0, z as f32), UV) / f64::from(n)
            })
            .sum();
        let want = material.diffuse_reflectance(UV);
        assert!((mean - want).map(f64::abs).max() < 1e-3, "{name}: {mean:?}, counted {want:?}");
        // And each is the integral of the value: over a regular grid of light directions.
        for wo in views(material).into_iter().filter(|w| w.z > 0.0) {
            let (rows, columns) = (256, 64);
            let mut sum = Rgb::BLACK;
            for k in 0..rows * columns {
                let z = (f64::from(k / columns) + 0.5) / f64::from(rows);
                let phi = TAU * (f64::from(k % columns) + 0.5) / f64::from(columns);
                let r = (1.0 - z * z).sqrt();
                let wi = Vec3::new((r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32);
                sum += material.eval(wo, wi, UV).diffuse * (2.0 * PI / f64::from(rows * columns));
            }
            let want = material.diffuse_toward(wo, UV);
            assert!((sum - want).map(f64::abs).max() < 1e-3, "{name} at {wo}: integral {sum:?}, said {want:?}");
        }
    }
}

/// Heights 2u over the unit square.
fn ramp() -> Texture {
    Texture::Bitmap(Bitmap {
        width: 4,
        height: 1,
        texels: [0.25_f32, 0.75, 1.25, 1.75].map(|v| [v; 3]).into_iter().collect(),
        filter: Filter::Bilinear,
        wrap: Wrap::Repeat,
        to_uv: Bitmap::IDENTITY,
    })
}

#[test]
fn a_relief_bends_the_normal_by_its_slope() {
    let relief = |map| Relief { map, flips_invalid: true, has_shadowing: true };
    let bump = relief(ReliefMap::Bump { texture: ramp(), scale: 0.8 });
    // On a rectangle of 4 by 5 the slope is 2 * 0.8 / 4 along x.
    let (du, dv) = (Vec3::X * 4.0, Vec3::Y * 5.0);
    let want = Vec3::new(-0.4, 0.0, 1.0).normalize();
    for dv in [dv, -dv] {
        let got = bump.perturb(UV, Vec3::Z, du, dv, Vec3::Z);
        assert!((got - want).length() < 1e-6, "{got}, expected {want}");
    }
    // Mitsuba 3.9.1 evaluates a diffuse material of reflectance one half under this bump, seen from above, to 0.5/pi times these.
    let bent = bump.perturb(UV, Vec3::Z, du, dv, Vec3::Z);
    for (wi, want) in [([0.6, 0.0, 0.8], 0.518_493), ([0.0, 0.6, 0.8], 0.740_704), ([-0.95, 0.0, 0.3122], 0.615_409)] {
        let wi = Vec3::from(wi);
        let got = bump.shadowing(bent, wi) * f64::from(bent.dot(wi));
        assert!((got - want).abs() < 1e-5, "{wi}: {got}, Mitsuba {want}");
    }
    // A normal along the first tangent, wherever that points; mirrored for a viewer on whom it turns its back.
    let map = relief(ReliefMap::Normal { texture: Texture::Constant(Rgb::new(0.8, 0.5, 0.9)) });
    for (du, wo, want) in [
        (Vec3::X, Vec3::Z, Vec3::new(0.6, 0.0, 0.8)),
        (Vec3::Y, Vec3::Z, Vec3::new(0.0, 0.6, 0.8)),
        (Vec3::X, Vec3::new(-0.95, 0.0, 0.3122), Vec3::new(-0.6, 0.0, 0.8)),
    ] {
        let got = map.perturb(UV, wo, du, dv, Vec3::Z);
        assert!((got - want).length() < 1e-6, "{got}, expected {want}");
    }
}

#[test]
fn reliefs_are_read_with_what_they_cover() {
    let texture = "<texture type='bitmap'><string name='filename' value='t.png'/></texture>";
    let xml = format!(
        "<bsdf type='twosided'><bsdf type='bumpmap'><float name='scale' value='3'/>{texture}
         <boolean name='flip_invalid_normals' value='false'/><bsdf type='diffuse'/></bsdf></bsdf>"
    );
    let image = image::RgbImage::from_pixel(2, 2, image::Rgb([9, 9, 9]));
    let mut png = std::io::Cursor::new(Vec::new());
    image.write_to(&mut png, image::ImageFormat::Png).expect("encodes");
    let surface = Fixture::new(&xml).with("t.png", png.into_inner()).scene().materials[0].clone();
    let relief = surface.relief.expect("a bump");
    assert!(matches!(relief.map, ReliefMap::Bump { scale: 3.0, .. }), "{relief:?}");
    assert!(surface.two_sided && !relief.flips_invalid && relief.has_shadowing);
    assert!(matches!(surface.material, Material::Diffuse { .. }));
}

#[test]
fn a_blend_shows_its_second_part_by_the_weight() {
    let part = |rho: f64| format!("<bsdf type='diffuse'><rgb name='reflectance' value='{rho}'/></bsdf>");
    let xml = format!("<bsdf type='blendbsdf'><float name='weight' value='0.25'/>{}{}</bsdf>", part(0.1), part(0.9));
    let rho = material(&xml).diffuse_reflectance(UV).g;
    assert!((rho - 0.3).abs() < 1e-12, "{rho}, expected 0.75 * 0.1 + 0.25 * 0.9");
    // Two sheets of glass and a hole: three ways through, and one reflection.
    let glass = |ior: f64| format!("<bsdf type='dielectric'><float name='int_ior' value='{ior}'/></bsdf>");
    let xml = format!("<bsdf type='blendbsdf'><float name='weight' value='0.25'/>{}{}</bsdf>", glass(1.5), glass(1.3));
    let masked = material(&format!("<bsdf type='mask'><float name='opacity' value='0.5'/>{xml}</bsdf>"));
    let lobes = masked.lobes(Vec3::new(0.6, 0.0, 0.8), UV);
    assert_eq!(lobes.iter().filter(|l| l.transmits).count(), 3);
    assert_eq!(masked.straight_transmittance(Vec3::new(0.6, 0.0, 0.8), UV), Rgb::grey(0.5));
    let power: f64 = lobes.iter().map(|l| l.power).sum();
    assert!((power - 1.0).abs() < 1e-12, "{power}");
}

#[test]
fn checkerboards_nest_and_swap_when_read_as_numbers() {
    let xml = "<bsdf type='diffuse'><texture name='reflectance' type='checkerboard'><rgb name='color0' value='0.9'/>
        <texture name='color1' type='checkerboard'><rgb name='color0' value='0.3'/><rgb name='color1' value='0.1'/>
        <transform name='to_uv'><scale x='2' y='2'/></transform></texture></texture></bsdf>";
    let Material::Diffuse { reflectance } = material(xml) else { panic!("diffuse") };
    for (u, v, want) in [(0.1, 0.1, 0.9), (0.6, 0.1, 0.3), (0.8, 0.1, 0.1), (0.6, 0.6, 0.9)] {
        assert_eq!(reflectance.at(Vec2::new(u, v)).g, want, "at {u}, {v}");
    }
    assert!((reflectance.mean().g - 0.55).abs() < 1e-12 && reflectance.max().g == 0.9);
    // Found by asking Mitsuba 3.9.1: where a number is read, color1 is at the origin.
    assert_eq!(reflectance.scalar(Vec2::new(0.6, 0.1)), 0.9);
}
