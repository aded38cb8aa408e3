//! Hierarchical form factors as pass one uses them: energy, and agreement with what rays measure independently.

use crate::support::Room;
use twopass::accel::AccelKind;
use twopass::form_factor::method::{self, FormFactorMethod, FormFactorSettings};
use twopass::form_factor::{FormFactors, Stored};
use twopass::math::{DVec3, Rgb};
use twopass::patch::{PatchMesh, PatchSettings};
use twopass::progress::silent;
use twopass::radiosity::{self, RadiositySystem, SolverSettings};
use twopass::world::World;
use twopass::world::walk::RayCounts;

/// A closed room with a table in it, which hides much of the floor from the ceiling.
fn furnished() -> (World, PatchMesh) {
    let mut room = Room::new(DVec3::new(0.1, 0.2, 0.3), DVec3::ONE, 4);
    let grey = room.grey(0.5);
    room.walls(DVec3::ZERO, DVec3::ONE, [grey; 6], [0.0; 6]);
    let (low, x, y, z) = (DVec3::new(0.25, 0.3, 0.25), DVec3::X * 0.5, DVec3::Y * 0.05, DVec3::Z * 0.4);
    for (corner, a, b) in [(low, x, z), (low + y, z, x), (low, z, y), (low + x, y, z), (low, y, x), (low + z, x, y)] {
        room.quad(corner, a, b, grey, 0.0);
    }
    let world = World::new(room.scene(), AccelKind::default()).expect("a world");
    let settings = PatchSettings { patch_size: Some(0.1), ..PatchSettings::default() };
    let mesh = PatchMesh::build(&world, &settings).expect("patches");
    (world, mesh)
}

fn form_factors((world, mesh): &(World, PatchMesh), method: FormFactorMethod, tolerance: f64) -> Stored {
    let how = FormFactorSettings {
        method,
        tolerance,
        shadow_rays: 32.0,
        extended: true,
        virtual_rooms: None,
        in_pairs: false,
        seed: 5,
    };
    method::build(world, mesh, &how, &mut RayCounts::default(), &mut silent).expect("not stopped").0
}

/// Irradiance where the patches of `exitance` glow and all reflect `rho`.
fn irradiance(mesh: &PatchMesh, form_factors: &Stored, rho: f64, exitance: impl Fn(usize) -> f64) -> Vec<f64> {
    let emitted: Vec<Rgb> = (0..mesh.len()).map(|i| Rgb::grey(exitance(i))).collect();
    let mut source = vec![Rgb::BLACK; mesh.len()];
    form_factors.gather(&emitted, &mut source);
    let rho = vec![Rgb::grey(rho); mesh.len()];
    let system = RadiositySystem { rho: &rho, area: &mesh.area, form_factors, source };
    let settings = SolverSettings { tolerance: 1e-8, ..SolverSettings::default() };
    let solution = radiosity::solve(&system, &settings, &mut silent).expect("a steady state");
    solution.irradiance.iter().map(|h| h.g).collect()
}

/// Where everything glows and reflects alike, H = E/(1 - rho) everywhere, whatever stands in the room.
#[test]
fn links_make_a_furnace() {
    let furnished = furnished();
    let links = form_factors(&furnished, FormFactorMethod::Hierarchical, 4e-3);
    for rho in [0.5, 0.9, 0.999] {
        for (i, h) in irradiance(&furnished.1, &links, rho, |_| 1.0).into_iter().enumerate() {
            let want = 1.0 / (1.0 - rho);
            assert!((h / want - 1.0).abs() < 1e-5, "rho {rho}, patch {i}: {h}, expected {want}");
        }
    }
}

/// Light of the ceiling by links and by ten thousand rays a patch: an area-weighted root mean square apart of no more than the noise of
/// the rays, and below the table no brighter than they say.
#[test]
fn links_agree_with_rays() {
    let furnished = furnished();
    let mesh = &furnished.1;
    let glows =
        |i: usize| if mesh.centroid[i].y > mesh.centroid.iter().map(|c| c.y).fold(f32::MIN, f32::max) - 1e-3 { 1.0 } else { 0.0 };
    let of = |method, tolerance| irradiance(mesh, &form_factors(&furnished, method, tolerance), 0.7, glows);
    let (links, rays) = (of(FormFactorMethod::Hierarchical, 1e-3), of(FormFactorMethod::RayCast, 0.005));
    let mean_square = |value: &dyn Fn(usize) -> f64| (0..mesh.len()).map(|i| mesh.area[i] * value(i).powi(2)).sum::<f64>();
    let off = (mean_square(&|i| links[i] - rays[i]) / mean_square(&|i| rays[i])).sqrt();
    assert!(off < 0.01, "{off} apart");
    let table = |i: &usize| mesh.normal[*i].y < -0.9 && glows(*i) == 0.0;
    let under = |h: &[f64]| -> f64 { (0..mesh.len()).filter(table).map(|i| mesh.area[i] * h[i]).sum() };
    assert!((under(&links) / under(&rays) - 1.0).abs() < 0.02, "below the table {} by links, {}", under(&links), under(&rays));
}
