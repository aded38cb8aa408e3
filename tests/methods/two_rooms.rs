//! Two rooms, a lamp in one and the camera in the other: what walls stop, and what comes round a corner.

use super::support::{Room, furnace, run};
use super::{greens, mean, settings};
use glam::DVec3;
use twopass::integrator::{Method, MethodSettings};
use twopass::material::{Material, Texture};
use twopass::math::Rgb;
use twopass::pipeline::RenderSettings;

/// Two rooms in one box, whose floor, ceiling, back and front are of both; a wall without thickness stands between, open over `door` of its
/// width. The lamp is in the left room; the camera, in the right one, sees both doorposts and the floor on either side.
fn two_rooms(door: f64) -> Room {
    let mut room = Room::new(DVec3::new(1.8, 0.3, 0.8), DVec3::new(0.0, -0.6, -0.5), 32);
    let grey = room.grey(0.7);
    let both = room.material(Material::Diffuse { reflectance: Texture::Constant(Rgb::grey(0.7)) }, true);
    room.walls(DVec3::new(-2.0, -1.0, -1.0), DVec3::new(2.0, 1.0, 1.0), [grey; 6], [0.0; 6]);
    // A little into floor, ceiling and ends.
    room.quad(DVec3::new(0.0, -1.01, -1.01), DVec3::Y * 2.02, DVec3::Z * (2.02 - door), both, 0.0);
    // Flat against the dividing wall: no light straight through the door.
    let black = room.grey(0.0);
    room.quad(DVec3::new(-0.02, -0.4, -0.8), DVec3::Z * 0.8, DVec3::Y * 0.8, black, 20.0);
    room
}

/// The floor goes on under the wall, and photons lie on it right up to the wall: none of them may count on the other side.
#[test]
fn a_wall_stops_photons() {
    let methods = MethodSettings { photons: Some(8192), ..MethodSettings::default() };
    for method in [Method::PhotonMap, Method::IrradianceCache] {
        let film = run(two_rooms(0.0).scene(), &RenderSettings { methods: methods.clone(), ..settings(method, 4) }).film;
        let brightest = greens(&film.image()).fold(0.0, f64::max);
        assert_eq!(brightest, 0.0, "{method:?}: light behind a closed wall");
    }
}

/// Most of the light has been reflected many times before it comes through the door, where no record stands that the camera's walks made.
#[test]
fn light_round_a_corner_is_that_of_path_tracing() {
    let room = two_rooms(0.4);
    let (path, error) = mean(&run(room.scene(), &settings(Method::Path, 2048)).film);
    for (method, spp, within) in
        [(Method::IrradianceCache, 16, 0.08), (Method::PhotonMap, 8, 0.03), (Method::Metropolis, 512, 0.03)]
    {
        let methods = MethodSettings { photons: Some(32_768), ..MethodSettings::default() };
        let (got, _) = mean(&run(room.scene(), &RenderSettings { methods, ..settings(method, spp) }).film);
        assert!(
            (got - path).abs() < 4.0 * error + within * path,
            "{method:?}: {got}, by path tracing {path}, standard error {error}"
        );
    }
}

/// Behind a narrow slit photons are rare: where a gather ray finds none nearby that knows the irradiance, there is light all the same.
#[test]
fn rare_photons_bring_all_light() {
    let room = two_rooms(0.1);
    let (path, error) = mean(&run(room.scene(), &settings(Method::Path, 4096)).film);
    for (method, side, spp) in [(Method::PhotonMap, 32, 32), (Method::Sppm, 96, 64)] {
        let methods = MethodSettings { photons: Some(16_384), ..MethodSettings::default() };
        let settings = RenderSettings { methods, size: Some((side, side)), ..settings(method, spp) };
        let (got, _) = mean(&run(room.scene(), &settings).film);
        assert!(
            (got - path).abs() < 4.0 * error + 0.04 * path,
            "{method:?}: {got}, by path tracing {path}, standard error {error}"
        );
    }
}

/// So few photons that most disks are empty: the radiance of the furnace in the mean.
#[test]
fn a_few_photons_fill_a_furnace() {
    let methods = MethodSettings { photons: Some(128), ..MethodSettings::default() };
    let film = run(furnace(0.5).scene(), &RenderSettings { methods, ..settings(Method::PhotonMap, 128) }).film;
    let (got, error) = mean(&film);
    assert!((got / 2.0 - 1.0).abs() < 0.01, "{got}, expected 2 within 1 %; error {error}");
}

/// Strips narrower than the disks, back to back in mid-air: as bright as the walls behind them.
#[test]
fn disks_know_how_narrow_a_strip_is() {
    let mut room = furnace(0.5);
    let grey = room.grey(0.5);
    for k in -6..=6 {
        let (across, low) = (DVec3::X * 1.8, DVec3::new(-0.9, 0.13 * f64::from(k), 0.2));
        let up = DVec3::Y * 0.03;
        room.quad(low, up, across, grey, 1.0);
        room.quad(low + DVec3::Z * 1e-5, across, up, grey, 1.0);
    }
    for (method, side, spp, photons) in [(Method::PhotonMap, 16, 32, 8192), (Method::Sppm, 64, 32, 16_384)] {
        let methods = MethodSettings { photons: Some(photons), ..MethodSettings::default() };
        let settings = RenderSettings { methods, size: Some((side, side)), ..settings(method, spp) };
        let (got, error) = mean(&run(room.scene(), &settings).film);
        assert!((got / 2.0 - 1.0).abs() < 0.01, "{method:?}: {got}, expected 2 within 1 %; error {error}");
    }
}

/// Disks of photons that reach beyond the edges of a wall are divided by what of them is left: the radiance of the furnace, whatever
/// their size.
#[test]
fn disks_end_where_walls_end() {
    for (method, side, spp) in [(Method::PhotonMap, 16, 16), (Method::Sppm, 96, 16)] {
        let methods = MethodSettings { photons: Some(8192), ..MethodSettings::default() };
        let settings = RenderSettings { methods, size: Some((side, side)), ..settings(method, spp) };
        let (got, error) = mean(&run(furnace(0.5).scene(), &settings).film);
        assert!((got / 2.0 - 1.0).abs() < 0.003, "{method:?}: {got}, expected 2 within 0.3 %; error {error}");
    }
}

/// A limit of edges is one for chains and records as well.
#[test]
fn chains_and_records_know_the_limit_of_edges() {
    for (method, spp) in [(Method::Metropolis, 512), (Method::IrradianceCache, 4)] {
        for depth in [1, 2, 3, 5] {
            let settings = RenderSettings { max_depth: Some(Some(depth)), ..settings(method, spp) };
            let (got, error) = mean(&run(furnace(0.5).scene(), &settings).film);
            let want: f64 = (0..depth as i32).map(|k| 0.5_f64.powi(k)).sum();
            assert!((got / want - 1.0).abs() < 0.01, "{method:?}, {depth} edges: {got}, expected {want}; error {error}");
        }
    }
}
