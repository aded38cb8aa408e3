//! What neighbouring pixels lend each other of walks from both ends.

use super::support::{Room, furnace, run};
use super::{furnished, greens, settings};
use glam::DVec3;
use std::cell::RefCell;
use twopass::accel::AccelKind;
use twopass::integrator::bidirectional::subpath::{Met, Vertex};
use twopass::integrator::bidirectional::{Bidirectional, Connector, Heuristic};
use twopass::integrator::metropolis::{Metropolis, MetropolisSettings};
use twopass::integrator::{Frame, Integrator, IntegratorSettings, Method, MethodSettings, ReadOut};
use twopass::material::{Material, Texture};
use twopass::math::{Rgb, Sampler, SamplerKind, Vec2};
use twopass::pipeline::RenderSettings;
use twopass::world::walk::RayCounts;
use twopass::world::{Shading, World};

/// The furnished room with a lamp under its ceiling.
fn lit() -> Room {
    let mut room = furnished(false);
    let black = room.grey(0.0);
    room.quad(DVec3::new(-0.3, 0.95, -0.3), DVec3::X * 0.6, DVec3::Z * 0.6, black, 5.0);
    room
}

/// The ways before a second vertex that another pixel would have had are those that a walk which does go there has: found from the two
/// vertices alone, and summed up along the walk, with the same density.
#[test]
fn ways_before_a_second_vertex_are_those_of_the_walk() {
    let world = World::new(lit().scene(), AccelKind::default()).expect("a room");
    for heuristic in Heuristic::ALL {
        let mut connector = Connector::new(&world, None, heuristic);
        connector.set_frame(&Frame::whole(16, 16));
        let walk = connector.camera_walk();
        let mut compared = 0;
        for k in 0..4000 {
            let mut sampler = Sampler::new(3, k, 0);
            let place = Vec2::new((k % 16) as f32 + 0.5, (k / 16 % 16) as f32 + 0.5);
            let start = connector.camera_start(world.scene().camera.ray(place, 16, 16));
            let first = RefCell::new(None::<Vertex>);
            walk.go(
                start,
                3,
                &mut sampler,
                &mut RayCounts::default(),
                |_, _| {},
                |met, _, _| {
                    let Met::Surface(vertex, _, edge) = met else { return };
                    match (vertex.edges, *first.borrow(), &edge.origin) {
                        (2, Some(first), Some(origin)) if vertex.plain().is_some() && vertex.si.wo.dot(vertex.si.ns) > 1e-3 => {
                            let way = first.si.point - vertex.si.point;
                            let (d2, back) = (way.length_squared(), way.normalize());
                            let (scattered, ways) = first.as_first(&walk, vertex, (back, f64::from(d2)));
                            let want = vertex.lent_ways(heuristic, vertex.reverse(vertex.si.wo));
                            assert!((ways / want - 1.0).abs() < 1e-2, "{heuristic:?}: {ways}, the walk has {want}");
                            let density = scattered.forward / origin.density;
                            assert!((density - 1.0).abs() < 1e-2, "{heuristic:?}: density {density} of the walk's");
                            assert_eq!(
                                want,
                                vertex.other_ways(heuristic, vertex.reverse(vertex.si.wo)),
                                "all ways are before it"
                            );
                            compared += 1;
                        }
                        _ => {}
                    }
                    if vertex.edges == 1 {
                        first.replace(Some(*vertex));
                    }
                },
            );
        }
        assert!(compared > 1000, "only {compared} walks");
    }
}

/// What a walk finds says what part of its weight follows how it came to its second vertex: with other ways before that, the same walk has
/// the weights that were said.
#[test]
fn weights_follow_the_ways_before_a_second_vertex() {
    let world = World::new(lit().scene(), AccelKind::default()).expect("a room");
    for heuristic in Heuristic::ALL {
        let mut connector = Connector::new(&world, None, heuristic);
        connector.set_frame(&Frame::whole(16, 16));
        let mut lights = Vec::new();
        connector.light_walk(&mut Sampler::new(5, 1, 0), &mut RayCounts::default(), |vertex, _, _| lights.push(*vertex));
        let walk = connector.camera_walk();
        // The walk's ways before its second vertex, and what it finds from there on.
        let walked = |k: u64, worth: f64| {
            let mut start = connector.camera_start(world.scene().camera.ray(Vec2::new((k % 16) as f32, 8.0), 16, 16));
            start.d_vcm *= worth;
            let (mut ways, mut found) = (None, Vec::new());
            let mut counts = RayCounts::default();
            walk.go(
                start,
                5,
                &mut Sampler::new(3, k, 0),
                &mut counts,
                |_, _| {},
                |met, sampler, counts| {
                    let Met::Surface(vertex, shading, edge) = met else { return };
                    if vertex.edges == 2 && vertex.plain().is_some() && vertex.si.wo.dot(vertex.si.ns) > 1e-3 {
                        ways = Some(vertex.lent_ways(heuristic, vertex.reverse(vertex.si.wo)));
                    } else if ways.is_some() {
                        found.push(connector.met(-vertex.si.wo, Some(&vertex.si), edge));
                    }
                    if ways.is_some() && shading.has_diffuse() {
                        connector.direct(vertex, shading, sampler, counts, |one| found.push(one));
                        lights.iter().for_each(|y| found.push(connector.connect(vertex, y, counts)));
                    }
                },
            );
            (ways, found)
        };
        let mut compared = 0;
        for k in 0..2000 {
            let ((ways, found), (more, others)) = (walked(k, 1.0), walked(k, 1e4));
            let (Some(ways), Some(more)) = (ways, more) else { continue };
            if ways == 0.0 {
                // Nothing but the walk itself comes to a second vertex behind a mirror.
                continue;
            }
            assert_eq!(found.len(), others.len());
            for (one, other) in found.iter().zip(&others).filter(|(one, _)| !one.light.is_black()) {
                let want = one.light.luminance() / (1.0 - one.lent + one.lent * (more / ways));
                assert!((other.light.luminance() / want - 1.0).abs() < 1e-6, "{heuristic:?}: {other:?}, expected {want}");
                compared += usize::from(other.light.luminance() < 0.9 * one.light.luminance());
            }
        }
        assert!(compared > 100, "only {compared} weights differ");
    }
}

/// Fails unless every block of `side` pixels of a room has what path tracing without lending finds there, of paths of up to `depth` edges.
fn agree(room: &Room, side: usize, depth: Option<u32>, heuristic: Heuristic) {
    const REPLICAS: u64 = 8;
    // Means of the blocks of each replica.
    let blocks = |method: Method, spp: u32| -> Vec<Vec<f64>> {
        let of_seed = |seed| {
            let methods = MethodSettings { heuristic, single_paths: true, ..MethodSettings::default() };
            let settings = RenderSettings { seed, methods, max_depth: depth.map(Some), ..settings(method, spp) };
            let image = run(room.scene(), &settings).film.image();
            let in_row = image.width() / side;
            let mut sums = vec![0.0; in_row * in_row];
            for (i, green) in greens(&image).enumerate() {
                sums[i / image.width() / side * in_row + i % image.width() / side] += green / (side * side) as f64;
            }
            sums
        };
        (1..=REPLICAS).map(of_seed).collect()
    };
    let (both, path) = (blocks(Method::Bidirectional, 256), blocks(Method::Path, 1024));
    let of = |replicas: &[Vec<f64>], block: usize| {
        let n = REPLICAS as f64;
        let mean = replicas.iter().map(|r| r[block]).sum::<f64>() / n;
        (mean, replicas.iter().map(|r| (r[block] - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)))
    };
    for block in 0..both[0].len() {
        let ((got, v1), (want, v2)) = (of(&both, block), of(&path, block));
        let error = (v1 + v2).sqrt();
        assert!((got - want).abs() <= 7.0 * error, "block {block}: {got}, expected {want}, standard error {error}");
    }
}

/// Every part of a picture has what is there, with corners and bodies within most tiles.
#[test]
fn what_neighbours_lend_is_there() {
    agree(&lit(), 4, None, Heuristic::Power);
}

/// A lamp over one end of a corridor: some pixels of a tile look at walls beside the lit floor, some at walls far away, for whom other ways
/// than to go there are better; and a sheet hides the floor from some.
#[test]
fn what_near_and_far_neighbours_lend_is_there() {
    let mut room = Room::new(DVec3::new(0.0, 0.0, 0.1), DVec3::Z, 8);
    let (grey, black) = (room.grey(0.7), room.grey(0.0));
    let both = room.material(Material::Diffuse { reflectance: Texture::Constant(Rgb::grey(0.7)) }, true);
    room.walls(DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, 1.0, 6.0), [grey; 6], [0.0; 6]);
    room.quad(DVec3::new(-0.5, 0.95, 1.0), DVec3::X, DVec3::Z, black, 5.0);
    room.quad(DVec3::new(0.4, -1.01, 0.8), DVec3::Z * 1.7, DVec3::Y * 1.2, both, 0.0);
    agree(&room, 1, Some(3), Heuristic::Balance);
}

/// What an older revision of a method knew is not gone on from: its weights were others.
#[test]
fn states_of_other_revisions_are_refused() {
    let world = World::new(furnace(0.5).scene(), AccelKind::default()).expect("a room");
    let settings = IntegratorSettings {
        read_out: ReadOut::Stored,
        max_depth: None,
        gather_rays: 1,
        direct: Shading::IN_PASSING,
        seed: 1,
        sampler: SamplerKind::Independent,
    };
    let new = || -> [Box<dyn Integrator + '_>; 2] {
        [
            Box::new(Bidirectional::new(&world, settings, Heuristic::Power)),
            Box::new(Metropolis::new(&world, settings, Heuristic::Power, MetropolisSettings::default())),
        ]
    };
    for (mut method, mut other) in new().into_iter().zip(new()) {
        method.pass(&Frame::whole(8, 8), 0);
        let state = method.state();
        assert!(other.take_up(&state), "a state of its own");
        let mut older = state.clone();
        older[0] -= 1;
        assert!(!other.take_up(&older), "a state of the revision before");
        assert!(!other.take_up(&state[1..]), "a state without a revision");
    }
}

/// What chains and walks have of a contribution depends on how much it is, so it must be as much by whichever pixel's walk it is found: roulette
/// knows nothing of the first surface. Dark and bright stripes, each a pixel wide, in a bright room; most that is found goes to chains.
#[test]
fn what_is_lent_is_shared_with_chains_as_what_is_not() {
    const REPLICAS: u64 = 8;
    let mut room = Room::new(DVec3::ZERO, DVec3::Z, 8);
    let (dark, bright, black) = (room.grey(0.02), room.grey(0.9), room.grey(0.0));
    let (low, x, y, z) = (DVec3::splat(-1.0), DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 2.0);
    for (corner, e1, e2) in [(low, y, z), (low + x, z, y), (low, z, x), (low + y, x, z), (low, x, y)] {
        room.quad(corner, e1, e2, bright, 0.0);
    }
    for k in 0..8 {
        room.quad(low + z + x * f64::from(k) / 8.0, y, x / 8.0, if k % 2 == 0 { dark } else { bright }, 0.0);
    }
    room.quad(DVec3::new(-0.3, 0.95, -0.8), DVec3::X * 0.6, DVec3::Z * 0.6, black, 5.0);
    // Means of both kinds of stripes, the darker first.
    let stripes = |method: Method, spp: u32, seed: u64| -> [f64; 2] {
        let metropolis = MetropolisSettings { even: 0.5, steps: 2.0, ..MetropolisSettings::default() };
        let methods = MethodSettings { metropolis, single_paths: true, ..MethodSettings::default() };
        let image = run(room.scene(), &RenderSettings { seed, methods, ..settings(method, spp) }).film.image();
        let mut sums = [0.0; 2];
        greens(&image).enumerate().for_each(|(i, green)| sums[i % 2] += green / 32.0);
        if sums[0] < sums[1] { sums } else { [sums[1], sums[0]] }
    };
    let of = |method: Method, spp: u32| {
        let all: Vec<[f64; 2]> = (1..=REPLICAS).map(|seed| stripes(method, spp, seed)).collect();
        let n = REPLICAS as f64;
        [0, 1].map(|kind: usize| {
            let mean = all.iter().map(|r| r[kind]).sum::<f64>() / n;
            (mean, all.iter().map(|r| (r[kind] - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)))
        })
    };
    let (chains, path) = (of(Method::Metropolis, 512), of(Method::Path, 2048));
    for (kind, ((got, v1), (want, v2))) in ["dark", "bright"].iter().zip(chains.into_iter().zip(path)) {
        let error = (v1 + v2).sqrt();
        println!("{kind}: {got}, path tracing has {want}, standard error {error}");
        assert!(error < 0.02 * want, "{kind}: a standard error of {error} tells nothing");
        assert!((got - want).abs() <= 5.0 * error, "{kind}: {got}, expected {want}, standard error {error}");
    }
}
