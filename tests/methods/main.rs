//! Each method against sums that are known, in the light paths that it carries.

mod lent;
#[path = "../laws/support.rs"]
#[expect(dead_code, reason = "shared with the other laws")]
mod support;
mod two_rooms;
mod usage;
mod virtual_rooms;

use glam::DVec3;
use support::{Room, furnace, quick, run};
use twopass::geometry::tessellate::Triangles;
use twopass::integrator::bidirectional::Heuristic;
use twopass::integrator::{Method, MethodSettings, PathFilter};
use twopass::light::Environment;
use twopass::material::plastic::{Base, Plastic};
use twopass::material::{Material, Texture};
use twopass::math::Rgb;
use twopass::pipeline::RenderSettings;
use twopass::scene::{LightSource, SurfaceSource};

fn settings(method: Method, spp: u32) -> RenderSettings {
    RenderSettings { method, ..quick(spp, 0.25) }
}

fn greens(image: &twopass::film::Image) -> impl Iterator<Item = f64> {
    image.pixels().iter().map(|p| f64::from(p[1]))
}

/// LD?S*E in a uniform enclosure: the wall seen, and what it reflects of the walls once.
#[test]
fn whitted_alone_carries_one_diffuse_reflection() {
    for (rho, ambient) in [(0.5, 0.0), (0.9, 0.0), (0.5, 2.0)] {
        let methods = MethodSettings { ambient, ..MethodSettings::default() };
        let film = run(furnace(rho).scene(), &RenderSettings { methods, ..settings(Method::WhittedOnly, 2) }).film;
        let want = 1.0 + rho + rho * ambient;
        for got in greens(&film.image()) {
            assert!((got / want - 1.0).abs() < 1e-6, "rho {rho}, ambient {ambient}: {got}, expected {want}");
        }
    }
}

/// The same enclosure by pass one: the whole series.
#[test]
fn radiosity_alone_carries_all_diffuse_reflections() {
    for rho in [0.5, 0.9] {
        let film = run(furnace(rho).scene(), &settings(Method::Radiosity, 1)).film;
        let want = 1.0 / (1.0 - rho);
        for got in greens(&film.image()) {
            assert!((got / want - 1.0).abs() < 1e-3, "rho {rho}: {got}, expected {want}");
        }
    }
}

/// LD*E: a mirror is black, and sends no light on. A floor whose only light would come by the mirror stays exactly dark.
#[test]
fn radiosity_alone_ends_at_mirrors() {
    let mut room = Room::new(DVec3::new(0.0, 1.0, -0.9), DVec3::new(0.0, 0.0, 0.3), 16);
    let (grey, mirror) = (room.grey(0.5), room.mirror(1.0));
    // The lamp shines up onto the mirror alone; a screen beside it would hide nothing else.
    room.quad(DVec3::new(-1.0, 0.0, -1.0), DVec3::Z * 2.0, DVec3::X * 2.0, grey, 0.0);
    room.quad(DVec3::new(-0.2, 0.1, -0.2), DVec3::Z * 0.4, DVec3::X * 0.4, grey, 10.0);
    room.quad(DVec3::new(-1.0, 2.0, -1.0), DVec3::X * 2.0, DVec3::Z * 2.0, mirror, 0.0);
    let seen = |method| {
        let film = run(room.scene(), &settings(method, 2)).film;
        // Where the lamp is not seen itself.
        greens(&film.image()).filter(|v| *v < 5.0).fold(0.0, f64::max)
    };
    assert!(seen(Method::TwoPass) > 0.0, "by the mirror light comes to the floor");
    assert_eq!(seen(Method::Radiosity), 0.0, "without the mirror none does");
}

/// Radiosity between patches is smooth on a wall: neighbouring pixels differ by less than the patches' own steps.
#[test]
fn interpolated_radiosity_has_no_facets() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, -0.95), DVec3::Z, 64);
    let (grey, black) = (room.grey(0.5), room.grey(0.0));
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [black, black, black, black, black, grey], [0.0; 6]);
    room.quad(DVec3::new(-0.3, 0.3, 0.0), DVec3::X * 0.6, DVec3::Y * 0.3, grey, 10.0);
    let mut settings = settings(Method::Radiosity, 4);
    settings.pass_one.patches.patch_size = Some(0.4);
    let rendered = run(room.scene(), &settings);
    let steps = |image: &twopass::film::Image| {
        let row: Vec<f64> = greens(image).skip(40 * 64 + 20).take(24).collect();
        row.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max) / row.iter().copied().fold(0.0, f64::max)
    };
    let stored = rendered.film.quantity_image(twopass::film::Quantity::Radiosity);
    let (facets, smooth) = (steps(&stored), steps(&rendered.film.image()));
    assert!(smooth < 0.5 * facets, "largest step of a row {smooth}, of the stored patches {facets}");
}

/// Mean of a picture's green channel and its standard error, from the two halves of the film.
fn mean(film: &twopass::film::Film) -> (f64, f64) {
    let image = film.image();
    let n = image.pixels().len() as f64;
    (greens(&image).sum::<f64>() / n, (greens(&film.variance_image()).sum::<f64>()).sqrt() / n)
}

/// In a uniform enclosure the paths of up to n edges bring 1 + rho + ... + rho^(n-1), made from whichever end: all weights of a path sum
/// to 1, at any limit of edges.
#[test]
fn walks_from_the_lamps_sum_the_geometric_series() {
    for heuristic in Heuristic::ALL {
        for method in [Method::Light, Method::Bidirectional] {
            for (rho, depth) in [(0.5, Some(1)), (0.5, Some(2)), (0.5, Some(3)), (0.7, Some(5)), (0.5, None)] {
                let methods = MethodSettings { heuristic, ..MethodSettings::default() };
                let settings = RenderSettings { methods, max_depth: Some(depth), ..settings(method, 64) };
                let (got, error) = mean(&run(furnace(rho).scene(), &settings).film);
                let want = depth.map_or(1.0 / (1.0 - rho), |d| (0..d as i32).map(|k| rho.powi(k)).sum());
                assert!(
                    (got - want).abs() < 4.0 * error + 1e-6 && error < 0.01 * want,
                    "{method:?}, {heuristic:?}, rho {rho}, {depth:?} edges: {got}, expected {want}, standard error {error}"
                );
            }
        }
    }
}

/// A room with a bumpy, a glossy, a mirroring and a glass body, and no light yet; without a ceiling if `open`.
fn furnished(open: bool) -> Room {
    let mut room = Room::new(DVec3::new(0.1, 0.2, -0.95), DVec3::new(0.0, -0.2, 1.0), 16);
    let (grey, mirror, glass) = (room.grey(0.6), room.mirror(0.9), room.glass(1.5));
    let plastic = Plastic::new(1.5, Base { reflectance: Texture::grey(0.5), nonlinear: false }, Texture::grey(1.0));
    let plastic = room.material(Material::Plastic(Box::new(plastic)), true);
    let (x, y, z) = (DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 2.0);
    let low = DVec3::splat(-1.0);
    room.quad(low, z, x, grey, 0.0);
    room.quad(low, y, z, grey, 0.0);
    room.quad(low + x, z, y, plastic, 0.0);
    room.quad(low + z, y, x, grey, 0.0);
    if !open {
        room.quad(low, x, y, grey, 0.0);
        room.quad(low + y, x, z, grey, 0.0);
    }
    room.sphere(DVec3::new(-0.5, -0.6, 0.3), 0.3, mirror, 0.0);
    room.sphere(DVec3::new(0.4, -0.6, -0.1), 0.25, glass, 0.0);
    // Vertex normals that differ from those of the faces: a tetrahedron that pretends to be round.
    let corners =
        [DVec3::new(0.5, -0.9, 0.6), DVec3::new(0.9, -0.9, 0.3), DVec3::new(0.3, -0.9, 0.2), DVec3::new(0.55, -0.3, 0.4)];
    let middle = 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
    let triangles = Triangles {
        positions: corners.to_vec(),
        normals: corners.iter().map(|c| (*c - middle).normalize().as_vec3()).collect(),
        uvs: Vec::new(),
        triangles: vec![[0, 3, 1], [1, 3, 2], [2, 3, 0], [0, 1, 2]],
    };
    room.add(SurfaceSource::Triangles(triangles), grey, 0.0);
    room
}

/// Paths made from both ends bring what paths from the camera bring, whatever shines.
#[test]
fn walks_from_both_ends_agree_with_path_tracing() {
    type Lit = (&'static str, bool, fn(&mut Room));
    let lamps: [Lit; 6] = [
        ("quad", false, |room| {
            let black = room.grey(0.0);
            room.quad(DVec3::new(-0.3, 0.95, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, black, 5.0);
        }),
        ("ball", false, |room| {
            let black = room.grey(0.0);
            room.sphere(DVec3::new(0.2, 0.5, 0.2), 0.2, black, 5.0);
        }),
        ("point", false, |room| room.point_light(DVec3::new(0.2, 0.5, 0.2), 1.0)),
        ("spot", false, |room| {
            let (position, axis) = (DVec3::new(-0.2, 0.8, 0.0), DVec3::new(0.2, -1.0, 0.1).normalize());
            let intensity = Rgb::grey(3.0);
            room.source.lights.push(LightSource::Spot { position, axis, intensity, cutoff: 0.6, beam_width: 0.4 });
        }),
        ("sun", true, |room| {
            let direction = DVec3::new(0.2, -1.0, 0.3).normalize();
            room.source.lights.push(LightSource::Directional { direction, irradiance: Rgb::grey(2.0) });
        }),
        ("sky", true, |room| room.source.environment = Some(Environment::Uniform(Rgb::grey(1.0)))),
    ];
    for (name, open, light) in lamps {
        let mut room = furnished(open);
        light(&mut room);
        // Caustics of points and suns are found from the lamps only, and mirrored ones by no way at all.
        let delta = ["point", "spot", "sun"].contains(&name);
        if delta {
            room.source.shapes.retain(|s| !matches!(s.surface, SurfaceSource::Sphere { .. }));
            let grey = room.grey(0.6);
            room.source.shapes.iter_mut().for_each(|s| s.material = grey);
        }
        for depth in [Some(3), None] {
            let of =
                |method, spp| mean(&run(room.scene(), &RenderSettings { max_depth: Some(depth), ..settings(method, spp) }).film);
            let (path, e1) = of(Method::Path, 512);
            let (both, e2) = of(Method::Bidirectional, 128);
            let error = e1.hypot(e2);
            assert!(
                (path - both).abs() < 4.0 * error && error < 0.02 * path,
                "{name}, {depth:?} edges: {both} from both ends, {path} from the camera, standard error {error}"
            );
        }
    }
}

/// What only shadow rays and photons, chains or records bring agrees with the sum of the series too.
#[test]
fn other_methods_reach_the_radiance_of_the_furnace() {
    for (method, side, spp, within) in [
        (Method::PhotonMap, 16, 16, 0.01),
        (Method::PhotonMap, 16, 256, 0.003),
        (Method::Sppm, 192, 4, 0.01),
        (Method::Sppm, 192, 64, 0.003),
        (Method::IrradianceCache, 16, 4, 0.01),
        (Method::IrradianceCache, 16, 64, 0.003),
        (Method::Metropolis, 16, 1024, 0.01),
    ] {
        let methods = MethodSettings { photons: Some(4096), ..MethodSettings::default() };
        let settings = RenderSettings { methods, size: Some((side, side)), ..settings(method, spp) };
        let (got, error) = mean(&run(furnace(0.5).scene(), &settings).film);
        assert!((got / 2.0 - 1.0).abs() < within, "{method:?}, {spp} samples: {got}, expected 2 within {within}; error {error}");
    }
}

/// Each bounce of records adds one reflection: 1 + rho + ... + rho^n with n of them, without noise.
#[test]
fn ambient_bounces_are_counted() {
    for (rho, bounces) in [(0.5, 0), (0.5, 1), (0.5, 4), (0.9, 3)] {
        let mut methods = MethodSettings::default();
        methods.ambient_cache.bounces = Some(bounces);
        let film = run(furnace(rho).scene(), &RenderSettings { methods, ..settings(Method::IrradianceCache, 4) }).film;
        // Lamps as large as these are found by gather rays; without any, one ray of each sample looks for them.
        let want: f64 = (0..=bounces.max(1) as i32).map(|k| rho.powi(k)).sum();
        for got in greens(&film.image()) {
            assert!((got / want - 1.0).abs() < 1e-3, "rho {rho}, {bounces} bounces: {got}, expected {want}");
        }
    }
}

/// The same paths, asked for by their letters.
#[test]
fn paths_are_chosen_by_their_letters() {
    for (text, want) in [("LE", 1.0), ("LDE", 0.5), ("LDDE", 0.25), ("LD{2,3}E", 0.375), ("LS+DE", 0.0), ("L(S|D)*E", 1.875)] {
        let paths = Some(PathFilter::new(text).expect("well formed"));
        let methods = MethodSettings { paths, ..MethodSettings::default() };
        let settings = RenderSettings { methods, max_depth: Some(Some(4)), ..settings(Method::Path, 2) };
        for got in greens(&run(furnace(0.5).scene(), &settings).film.image()) {
            assert!((got - want).abs() < 1e-6, "{text}: {got}, expected {want}");
        }
    }
}

/// Letters are read from the lamp, though a path tracer meets them from the eye: a mirror behind a diffuse surface is not one before it.
#[test]
fn paths_are_read_from_the_lamp() {
    // The camera looks down at a floor that the lamp lights only by a mirror: LSDE, and never LDSE.
    let mut room = Room::new(DVec3::new(0.0, 1.0, -0.9), DVec3::new(0.0, 0.0, 0.3), 16);
    let (grey, mirror) = (room.grey(0.5), room.mirror(1.0));
    room.quad(DVec3::new(-1.0, 0.0, -1.0), DVec3::Z * 2.0, DVec3::X * 2.0, grey, 0.0);
    room.quad(DVec3::new(-0.2, 0.1, -0.2), DVec3::Z * 0.4, DVec3::X * 0.4, grey, 10.0);
    room.quad(DVec3::new(-1.0, 2.0, -1.0), DVec3::X * 2.0, DVec3::Z * 2.0, mirror, 0.0);
    let brings = |text: &str| {
        let paths = Some(PathFilter::new(text).expect("well formed"));
        let methods = MethodSettings { paths, ..MethodSettings::default() };
        mean(&run(room.scene(), &RenderSettings { methods, ..settings(Method::Path, 64) }).film).0
    };
    let (by_mirror, in_mirror) = (brings("LSDE"), brings("LDSE"));
    assert!(by_mirror > 0.0 && in_mirror == 0.0, "LSDE {by_mirror}, expected light; LDSE {in_mirror}, expected none");
    assert_eq!(brings("LMDE"), by_mirror, "the mirror is flat");
}

/// What the table says that a method carries is what it brings, no more and no less.
#[test]
fn incomplete_methods_carry_what_their_rows_say() {
    let mut room = Room::new(DVec3::new(0.1, 0.2, -0.95), DVec3::new(0.0, -0.2, 1.0), 24);
    let (grey, mirror) = (room.grey(0.7), room.mirror(0.9));
    room.walls(DVec3::splat(-1.0), DVec3::splat(1.0), [grey, mirror, grey, grey, grey, grey], [0.0; 6]);
    room.quad(DVec3::new(-0.3, 0.95, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, grey, 5.0);
    room.sphere(DVec3::new(-0.4, -0.6, 0.3), 0.3, mirror, 0.0);
    for (method, spp, bias) in [(Method::WhittedOnly, 32, 0.0), (Method::Light, 256, 0.0), (Method::Radiosity, 16, 0.01)] {
        let (got, e1) = mean(&run(room.scene(), &settings(method, spp)).film);
        let by_paths = |text: &str| {
            let paths = Some(PathFilter::new(text).expect("well formed"));
            let methods = MethodSettings { paths, ..MethodSettings::default() };
            mean(&run(room.scene(), &RenderSettings { methods, ..settings(Method::Path, 512) }).film)
        };
        let text = method.row().paths;
        let ((want, e2), (whole, _)) = (by_paths(text), by_paths("L(S|D)*E"));
        let error = e1.hypot(e2);
        assert!(
            (got - want).abs() < 4.0 * error + bias * want && error < 0.01 * want,
            "{method:?}: {got}, paths {text} bring {want}, standard error {error}"
        );
        assert!(want < 0.95 * whole, "{text} leaves something out: {want} of {whole}");
    }
}

/// Photons and chains in a furnished room, against path tracing.
#[test]
fn photons_and_chains_agree_with_path_tracing() {
    let mut room = furnished(false);
    let black = room.grey(0.0);
    room.quad(DVec3::new(-0.3, 0.95, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, black, 5.0);
    let (path, e1) = mean(&run(room.scene(), &settings(Method::Path, 1024)).film);
    for (method, side, spp, within) in [
        (Method::Sppm, 96, 32, 0.01),
        (Method::PhotonMap, 16, 64, 0.03),
        (Method::IrradianceCache, 32, 16, 0.03),
        (Method::Metropolis, 16, 512, 0.03),
    ] {
        let methods = MethodSettings { photons: Some(8192), ..MethodSettings::default() };
        let settings = RenderSettings { methods, size: Some((side, side)), ..settings(method, spp) };
        let (got, _) = mean(&run(room.scene(), &settings).film);
        assert!((got - path).abs() < 4.0 * e1 + within * path, "{method:?}: {got}, by path tracing {path}, standard error {e1}");
    }
}

/// Normals that are not those of the face: what a particle brings is what a camera path finds, by the cosines that the two leave aside.
#[test]
fn particles_know_bent_normals() {
    let mut room = Room::new(DVec3::new(0.8, 1.2, -1.2), DVec3::new(0.0, 0.0, 0.1), 16);
    let grey = room.grey(0.8);
    let corner = |x: f64, z: f64| DVec3::new(x, 0.0, z);
    let floor = Triangles {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        normals: vec![DVec3::new(0.6, 0.8, 0.0).as_vec3(); 4],
        uvs: Vec::new(),
        triangles: vec![[0, 2, 1], [0, 3, 2]],
    };
    room.add(SurfaceSource::Triangles(floor), grey, 0.0);
    room.quad(DVec3::new(-0.9, 1.0, -0.2), DVec3::X * 0.4, DVec3::Z * 0.4, grey, 5.0);
    let of = |method, spp| mean(&run(room.scene(), &RenderSettings { max_depth: Some(Some(2)), ..settings(method, spp) }).film);
    let (path, e1) = of(Method::Path, 256);
    for method in [Method::Light, Method::Bidirectional] {
        let (got, e2) = of(method, 256);
        let error = e1.hypot(e2);
        assert!(
            (got - path).abs() < 4.0 * error && error < 0.02 * path,
            "{method:?}: {got}, by path tracing {path}, standard error {error}"
        );
    }
}
