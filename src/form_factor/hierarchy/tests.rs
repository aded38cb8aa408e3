//! Laws of links: bounds, reciprocity, closure, the same bits on any number of threads, and values against closed forms.

use super::*;
use crate::accel::AccelKind;
use crate::form_factor::analytic::{parallel_rectangles, perpendicular_rectangles};
use crate::math::{DVec3, Sampler};
use crate::patch::PatchSettings;
use crate::progress::silent;
use crate::stability::rooms::Room;

/// An empty closed unit cube, or one with a block in it.
fn cube(with_block: bool) -> Room {
    let mut room = Room::new(DVec3::new(0.1, 0.2, 0.3), DVec3::ONE, 4);
    let grey = room.grey(0.5);
    room.walls(DVec3::ZERO, DVec3::ONE, grey, [0.0; 6]);
    if with_block {
        let low = DVec3::new(0.3, 0.2, 0.4);
        let (e1, e2, e3) = (DVec3::new(0.3, 0.0, 0.1), DVec3::new(0.0, 0.4, 0.0), DVec3::new(-0.1, 0.0, 0.3));
        for (corner, a, b) in
            [(low, e2, e1), (low, e1, e3), (low, e3, e2), (low + e3, e1, e2), (low + e2, e3, e1), (low + e1, e2, e3)]
        {
            room.quad(corner, a, b, grey, 0.0);
        }
    }
    room
}

fn linked(room: &Room, patch_size: f64, tolerance: f64) -> (PatchMesh, Hierarchy, Outside) {
    let world = World::new(room.scene().expect("valid"), AccelKind::default()).expect("built");
    let settings = PatchSettings { patch_size: Some(patch_size), ..PatchSettings::default() };
    let patches = PatchMesh::build(&world, &settings).expect("not too many");
    let how = HierarchySettings::for_tolerance(tolerance, 32.0, 3);
    let (links, outside) = link(&world, &patches, &how, &mut RayCounts::default(), &mut silent).expect("not stopped");
    (patches, links, outside)
}

/// Row `i` with one entry for each patch.
fn row(links: &Hierarchy, i: usize) -> Vec<f64> {
    let mut row = vec![0.0; links.len()];
    links.row(i, &mut |j, f| row[j] += f.g);
    row
}

#[test]
fn links_are_bounded_reciprocal_and_closed() {
    let (patches, links, outside) = linked(&cube(true), 0.1, 4e-3);
    let rows: Vec<Vec<f64>> = (0..links.len()).map(|i| row(&links, i)).collect();
    for (i, row) in rows.iter().enumerate() {
        let sum: f64 = row.iter().sum();
        assert!((sum - 1.0).abs() < 1e-9, "row {i} sums to {sum}");
        assert_eq!(outside.escaped(i), Rgb::BLACK, "row {i}");
        for (j, f) in row.iter().enumerate() {
            let (there, back) = (patches.area[i] * f, patches.area[j] * rows[j][i]);
            assert!((there - back).abs() <= 8.0 * f64::EPSILON * there, "{i}, {j}: {there}, backwards {back}");
            let most = patches.area[i].min(patches.area[j]);
            assert!(*f >= 0.0 && there <= most * (1.0 + 1e-9), "{i}, {j}: {there} of {most}");
        }
    }
}

#[test]
fn a_product_is_that_of_the_rows() {
    let (_, links, _) = linked(&cube(true), 0.15, 4e-3);
    let x: Vec<Rgb> = (0..links.len() as u64).map(|i| Rgb::grey(f64::from(Sampler::new(5, i, 0).next_1d()))).collect();
    let mut out = vec![Rgb::BLACK; links.len()];
    links.gather(&x, &mut out);
    for (i, found) in out.iter().enumerate() {
        let want: f64 = row(&links, i).iter().zip(&x).map(|(f, x)| f * x.g).sum();
        assert!((found.g - want).abs() < 1e-12, "patch {i}: {}, by its row {want}", found.g);
    }
}

/// Walls of the unit cube: C-11 and C-14 of Howell's catalogue. What scaling does to the sums is no larger than the error itself.
#[test]
fn walls_of_a_cube_have_their_closed_forms() {
    let (patches, links, _) = linked(&cube(false), 0.07, 1e-3);
    let n = links.len();
    let wall = |i: usize| patches.normal[i].to_array().map(|v| v.round() as i32);
    let sum = |facing: [i32; 3]| -> f64 {
        let from: Vec<usize> = (0..n).filter(|&i| wall(i) == [1, 0, 0]).collect();
        let to = |row: &[f64]| (0..n).filter(|&j| wall(j) == facing).map(|j| row[j]).sum::<f64>();
        from.iter().map(|&i| patches.area[i] * to(&row(&links, i))).sum()
    };
    for (facing, want) in [([-1, 0, 0], parallel_rectangles(1.0, 1.0, 1.0)), ([0, 1, 0], perpendicular_rectangles(1.0, 1.0, 1.0))]
    {
        let got = sum(facing);
        assert!((got / want - 1.0).abs() < 1e-3, "towards {facing:?}: {got}, expected {want}");
    }
    assert!(
        (links.closure.row_sum_min - 1.0).abs() < 0.1 && (links.closure.row_sum_max - 1.0).abs() < 0.1,
        "{:?}",
        links.closure
    );
}

/// Two squares facing each other in the open: what they do not exchange escapes.
#[test]
fn what_escapes_is_the_rest_of_the_row() {
    let mut room = Room::new(DVec3::new(0.5, 0.5, 3.0), DVec3::ZERO, 4);
    let grey = room.grey(0.5);
    room.quad(DVec3::ZERO, DVec3::X, DVec3::Y, grey, 0.0);
    room.quad(DVec3::Z, DVec3::Y, DVec3::X, grey, 0.0);
    let (patches, links, outside) = linked(&room, 0.1, 1e-3);
    let mut exchanged = 0.0;
    for i in 0..links.len() {
        let sum: f64 = row(&links, i).iter().sum();
        assert!((sum + outside.escaped(i).g - 1.0).abs() < 1e-6, "row {i}: {sum} and {}", outside.escaped(i).g);
        exchanged += patches.area[i] * sum;
    }
    let want = 2.0 * parallel_rectangles(1.0, 1.0, 1.0);
    assert!((exchanged / want - 1.0).abs() < 1e-3, "{exchanged} exchanged, expected {want}");
}

/// Two rooms with a wall between them: nothing passes, however coarse the links.
#[test]
fn nothing_passes_through_a_wall() {
    let mut room = Room::new(DVec3::splat(0.1), DVec3::ONE, 4);
    let grey = room.two_sided(0.5);
    room.walls(DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0), grey, [0.0; 6]);
    room.quad(DVec3::X * 0.83, DVec3::Y, DVec3::Z, grey, 0.0);
    let (patches, links, _) = linked(&room, 0.2, 2e-2);
    let left = |i: usize| {
        let side = patches.centroid[i].x + 0.5 * 2.0 - 0.83;
        if side.abs() < 1e-3 { patches.normal[i].x < 0.0 } else { side < 0.0 }
    };
    let inside = |i: usize| row(&links, i).iter().sum::<f64>() > 0.5;
    let across: f64 = (0..links.len())
        .filter(|&i| inside(i) && left(i))
        .map(|i| row(&links, i).iter().enumerate().filter(|(j, _)| !left(*j)).map(|(_, f)| f * patches.area[i]).sum::<f64>())
        .sum();
    assert!(across < 1e-3, "{across} m² are exchanged through the wall");
}

#[test]
fn threads_do_not_change_a_bit_of_the_links() {
    let room = cube(true);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let (patches, links, _) = linked(&room, 0.12, 4e-3);
            let x: Vec<Rgb> = patches.centroid.iter().map(|c| Rgb::grey(f64::from(c.x + 2.0 * c.y))).collect();
            let mut out = vec![Rgb::BLACK; links.len()];
            links.gather(&x, &mut out);
            let bits: Vec<u64> = out.iter().map(|v| v.g.to_bits()).collect();
            (postcard::to_stdvec(&links.by_node).expect("plain numbers"), bits)
        })
    };
    assert!(run(1) == run(2));
}

/// A mirror for a wall: what links and rays find adds up to 1 in every row.
#[test]
fn rows_close_with_a_mirror_for_a_wall() {
    let mut room = cube(true);
    let mirror = room.mirror(1.0);
    room.source.shapes[0].material = mirror;
    let (_, links, outside) = linked(&room, 0.25, 4e-3);
    assert!(!links.is_reciprocal());
    let beside = (0..links.len()).map(|i| row(&links, i).iter().sum::<f64>() + outside.escaped(i).g + outside.truncated(i).g);
    for (i, sum) in beside.enumerate() {
        assert!((sum - 1.0).abs() < 1e-6, "row {i} sums to {sum}");
    }
}

/// Walls that part groups spare rays, and take no link away that rays would have found.
#[test]
fn walls_leave_out_nothing_that_is_seen() {
    let world = World::new(cube(true).scene().expect("valid"), AccelKind::default()).expect("built");
    let settings = PatchSettings { patch_size: Some(0.05), ..PatchSettings::default() };
    let patches = PatchMesh::build(&world, &settings).expect("not too many");
    let tree = Tree::new(&world, &patches);
    let all = |walls: &Walls| {
        let refinement = Refinement { world: &world, patches: &patches, tree: &tree, walls, tolerance: 2e-3, seed: 3 };
        let (links, rays) = refinement.links(&mut silent).expect("not stopped");
        let mut links: Vec<(u32, u32, u32)> =
            links.into_iter().flatten().map(|link| (link.first, link.second, link.transfer.to_bits())).collect();
        links.sort_unstable();
        (links, rays)
    };
    let ((without, all_rays), (with, rays)) = (all(&Walls::none(&world, &tree)), all(&Walls::new(&world, &tree)));
    assert!(without == with, "{} links, with walls {}", without.len(), with.len());
    assert!(rays < all_rays, "{rays} rays, without walls {all_rays}");
}

/// Form factor to a ceiling of 1 by 1 from a square of 0.2 that lies `gap` below, cut in so many quads a side, half of it hidden if asked.
fn below_a_ceiling(quads: u32, gap: f64, is_half_hidden: bool) -> f64 {
    let mut room = Room::new(DVec3::splat(0.1), DVec3::ONE, 4);
    let grey = room.grey(0.5);
    let mut plate = crate::geometry::tessellate::Triangles::default();
    let side = 0.2 / f64::from(quads);
    for (i, k) in (0..quads * quads).map(|n| (n % quads, n / quads)) {
        let corner = DVec3::new(0.2 + side * f64::from(i), 0.2 + side * f64::from(k), 0.0);
        let first = plate.positions.len() as u32;
        plate.positions.extend([
            corner,
            corner + DVec3::X * side,
            corner + DVec3::new(side, side, 0.0),
            corner + DVec3::Y * side,
        ]);
        plate.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    room.add(crate::scene::SurfaceSource::Triangles(plate), grey, 0.0);
    room.quad(DVec3::new(-0.2, -0.2, gap), DVec3::Y, DVec3::X, grey, 0.0);
    if is_half_hidden {
        room.quad(DVec3::new(0.2, 0.15, 0.002), DVec3::Y * 0.3, DVec3::X * 0.1, grey, 0.0);
    }
    let (patches, links, _) = linked(&room, 1.0, 1e-3);
    let is_plate = |i: usize| patches.normal[i].z > 0.5;
    // The middle of the scene is its origin.
    let to_ceiling = |i: usize| -> f64 {
        // As links have it: closing rows mends a share that is wrong, for what hides the ceiling must get all of its own.
        let scale = |j: usize| links.scale[links.place[j] as usize];
        let row = row(&links, i);
        (0..row.len()).filter(|j| patches.centroid[*j].z > 0.0).map(|j| row[j] / (scale(i) * scale(j))).sum()
    };
    let all: f64 = (0..links.len()).filter(|&i| is_plate(i)).map(|i| patches.area[i] * to_ceiling(i)).sum();
    all / 0.04
}

/// The kernel is nothing but for a disk of the ceiling as wide as the gap. Integrated over polygons, and of too many triangles for that.
#[test]
fn what_lies_close_below_a_ceiling_sees_nothing_else() {
    for (quads, gap) in [(1, 0.03), (5, 0.01)] {
        let found = below_a_ceiling(quads, gap, false);
        assert!((0.97..1.0 + 1e-6).contains(&found), "{quads} a side: {found}");
        let half = below_a_ceiling(quads, gap, true);
        assert!((half - 0.5).abs() < 0.05, "{quads} a side, half of it hidden: {half}");
    }
}

/// Rows of several patches in one go, as rooms are looked for.
#[test]
fn parts_of_rows_are_the_rows() {
    let (_, links, _) = linked(&cube(true), 0.12, 4e-3);
    let asked = [3, 0, links.len() - 1];
    let mut found = vec![vec![0.0; links.len()]; asked.len()];
    links.some_rows(&asked, &mut |k, factor, entries| {
        entries.iter().for_each(|(j, weight)| found[k][*j as usize] += factor * weight);
    });
    for (k, &i) in asked.iter().enumerate() {
        for (j, want) in row(&links, i).into_iter().enumerate() {
            assert!((found[k][j] - want).abs() <= 1e-14, "row {i}, {j}: {}, by itself {want}", found[k][j]);
        }
    }
}
