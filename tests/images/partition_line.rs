//! Where the floor of door-ajar runs under the dividing wall: no light may leak there, and none may be missing.
//!
//! The floor is one surface through both rooms, and room one is some hundred times brighter: a patch of which one hundredth lay
//! beyond the wall would be twice as bright as it should be, and with it a line along the wall's foot. The pixels that see floor
//! or wall near their common line are summed in blocks along it, and each block's mean is compared with the reference's.

use crate::support::{Case, Shot};
use twopass::accel::AccelKind;
use twopass::film::Image;
use twopass::integrator::ReadOut;
use twopass::load::load_scene;
use twopass::math::{DVec3, Vec2};
use twopass::world::World;

/// Plane of the wall's face in room two [m], as meshes/partition.obj has it.
const WALL_X: f64 = 0.075;
/// Width of the strips [m]: one pixel covers 2 cm across and 6 cm along the view there.
const STRIP: f64 = 0.08;
/// Largest relative error of a block. Picture and reference have a relmse of 0.008 and 0.004, so a block of six pixels is known to
/// 4.5 %: four times that is allowed. The steps between stored patches stay within the same bound.
const TOLERANCE: f64 = 0.2;
/// Fewest blocks that make a line.
const ENOUGH_BLOCKS: usize = 8;
/// Length of a block along the line [m].
const BLOCK: f64 = 0.15;
/// The doorway and its frame, where no wall stands [m].
const DOORWAY: std::ops::Range<f64> = 0.9..2.0;

/// A block of pixels along the foot of the wall.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord, Clone, Copy)]
struct Block {
    /// Index along the line.
    along: i32,
    /// True on the floor, false on the wall.
    floor: bool,
    /// 0: touches the line; 1: the next one.
    strip: i32,
}

/// For each pixel the block that its first corner sees, if all its corners see the same surface.
fn blocks(width: usize, height: usize) -> Vec<Option<Block>> {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/door-ajar/scene.xml");
    let scene = load_scene(&file, &Default::default()).expect("the scene loads").scene;
    let world = World::new(scene, AccelKind::default()).expect("builds");
    let corners = [(0.02, 0.02), (0.98, 0.02), (0.02, 0.98), (0.98, 0.98)];
    let block_of = |i: usize| {
        let corner = |(dx, dy): (f32, f32)| {
            let p = Vec2::new((i % width) as f32 + dx, (i / width) as f32 + dy);
            let hit = world.intersect(&world.scene().camera.ray(p, width, height))?;
            block_at(&world.scene().shapes[hit.shape as usize].id, hit.point.as_dvec3() + world.scene().origin)
        };
        let found = corners.map(corner);
        found[0].filter(|_| found.iter().all(|b| b.map(|b| b.floor) == found[0].map(|b| b.floor)))
    };
    (0..width * height).map(block_of).collect()
}

fn block_at(shape: &str, p: DVec3) -> Option<Block> {
    let (floor, distance) = match shape {
        "floor-both" => (true, p.x - WALL_X),
        "partition" if p.x > 0.5 * WALL_X => (false, p.y),
        _ => return None,
    };
    let near = (0.0..2.0 * STRIP).contains(&distance) && !DOORWAY.contains(&p.z);
    near.then(|| Block { along: (p.z / BLOCK).floor() as i32, floor, strip: (distance / STRIP) as i32 })
}

/// Mean luminance of `image` over the pixels of `block`, and their number.
fn mean(image: &Image, blocks: &[Option<Block>], block: Block) -> (f64, usize) {
    let of_block = |(p, b): (&[f32; 3], &Option<Block>)| (*b == Some(block)).then(|| f64::from(p[0] + p[1] + p[2]));
    let values: Vec<f64> = image.pixels().iter().zip(blocks).filter_map(of_block).collect();
    (values.iter().sum::<f64>() / values.len().max(1) as f64, values.len())
}

/// Picture over reference in each block of at least six pixels.
fn ratios(case: &Case) -> Vec<(Block, f64)> {
    let blocks = blocks(case.image.width(), case.image.height());
    let mut kinds: Vec<Block> = blocks.iter().flatten().copied().collect();
    kinds.sort();
    kinds.dedup();
    let ratio = |block: Block| {
        let (image, n) = mean(&case.image, &blocks, block);
        let [a, b] = [0, 1].map(|h| mean(&case.reference[h], &blocks, block).0);
        (n >= 6).then_some((block, 2.0 * image / (a + b)))
    };
    kinds.into_iter().filter_map(ratio).collect()
}

#[test]
fn no_line_shows_where_floor_and_partition_meet() {
    for (read_out, spp) in [(ReadOut::Stored, 4), (ReadOut::DirectStored, 4), (ReadOut::FinalGather, 64)] {
        let case = Case::of(Shot { spp, read_out: Some(read_out), ..Shot::new("door-ajar") });
        let ratios = ratios(&case);
        let worst = ratios.iter().map(|(_, r)| (r - 1.0).abs()).fold(0.0, f64::max);
        println!("{read_out:?}: {} blocks, worst error {worst:.3}", ratios.len());
        case.check(ratios.len() >= ENOUGH_BLOCKS, &format!("{} blocks, expected {ENOUGH_BLOCKS} or more", ratios.len()));
        case.check(worst <= TOLERANCE, &format!("{ratios:.3?}: worst {worst:.3}, expected 1 within {TOLERANCE}"));
    }
}
