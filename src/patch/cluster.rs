//! Small neighbouring triangles of one shape are grouped into face clusters.
//!
//! A group lies in one cell of a grid of the patch size, its normals in one bin, and its parts see each other along the surface, so
//! that it does not reach through a wall that stands on it.

use crate::geometry::{Ray, triangle};
use crate::math::Vec3;
use crate::world::World;
use rayon::prelude::*;

/// Bins per side of each of the six faces of the cube of normals: about 30 degrees wide, with the axes in the middle of bins.
const BINS: f32 = 3.0;
/// What a shape has of a cell, in patch areas, below which a bin is a whole face of that cube: a cup needs no 54 patches.
const COARSE_BELOW: f64 = 0.5;
/// The same below which all normals are one bin: what is as small as a button is seen as one.
const ONE_BELOW: f64 = 0.02;
/// Height above the surface at which two parts of a group must see each other, in patch sizes.
const HEIGHT: f32 = 0.02;
/// A group falls apart into this many at most; what is left stays together.
const MOST_PARTS: usize = 6;

/// Groups of the given triangles of one shape, each in rising order, in an order that depends on nothing but the input.
pub fn group(world: &World, primitives: &[u32], patch_size: f64) -> Vec<Vec<u32>> {
    let size = patch_size as f32;
    let mut keyed: Vec<([i32; 4], u32)> = primitives
        .par_iter()
        .map(|&p| {
            let [a, b, c] = world.soup().corners(p as usize);
            // Half a cell off, so that the middle of the scene, where its origin lies, is no border.
            let cell = ((a + b + c) / (3.0 * size) + 0.5).floor().as_ivec3();
            ([cell.x, cell.y, cell.z, 0], p)
        })
        .collect();
    keyed.sort_unstable();
    let corners = |p: u32| world.soup().corners(p as usize);
    keyed.par_chunk_by_mut(|a, b| a.0 == b.0).for_each(|cell| {
        let area: f64 = cell.iter().map(|(_, p)| area(corners(*p))).sum();
        let bins = bins_for(area / (patch_size * patch_size));
        for (key, p) in cell {
            let [a, b, c] = corners(*p);
            key[3] = bins.map_or(0, |bins| normal_bin(triangle::normal(a, b, c), bins));
        }
    });
    keyed.sort_unstable();
    let groups: Vec<Vec<u32>> = keyed.chunk_by(|a, b| a.0 == b.0).map(|group| group.iter().map(|(_, p)| *p).collect()).collect();
    groups.into_par_iter().flat_map_iter(|group| parts_in_sight(world, group, size)).collect()
}

/// Area of a triangle.
fn area([a, b, c]: [Vec3; 3]) -> f64 {
    triangle::area_vector(a, b, c).length()
}

/// Bins a side for `area` in patch areas; `None`: one bin for all.
fn bins_for(area: f64) -> Option<f32> {
    if area < ONE_BELOW {
        None
    } else if area < COARSE_BELOW {
        Some(1.0)
    } else {
        Some(BINS)
    }
}

/// Bin of a unit normal on the cube, with `bins` a side.
fn normal_bin(n: Vec3, bins: f32) -> i32 {
    let axis = n.abs().max_position();
    let (u, v) = (n[(axis + 1) % 3] / n[axis].abs(), n[(axis + 2) % 3] / n[axis].abs());
    let bin = |t: f32| (((t + 1.0) * 0.5 * bins) as i32).clamp(0, bins as i32 - 1);
    let face = 2 * axis as i32 + i32::from(n[axis] < 0.0);
    (face * bins as i32 + bin(u)) * bins as i32 + bin(v)
}

/// Splits a group where something large stands between its parts.
fn parts_in_sight(world: &World, group: Vec<u32>, size: f32) -> Vec<Vec<u32>> {
    let mut parts = Vec::new();
    let mut rest = group;
    while rest.len() > 1 && parts.len() + 1 < MOST_PARTS {
        let seed = rest[0];
        let (together, apart): (Vec<u32>, Vec<u32>) =
            rest.into_iter().partition(|&p| p == seed || in_sight(world, seed, p, size));
        parts.push(together);
        rest = apart;
    }
    if !rest.is_empty() {
        parts.push(rest);
    }
    parts
}

/// True unless a shape larger than two patches stands between points just above two triangles.
fn in_sight(world: &World, from: u32, to: u32, size: f32) -> bool {
    let above = |p: u32| {
        let [a, b, c] = world.soup().corners(p as usize);
        (a + b + c) / 3.0 + triangle::normal(a, b, c) * (HEIGHT * size)
    };
    let hit = world.intersect(&Ray::between(above(from), above(to)));
    hit.is_none_or(|si| world.shape_bounds(si.shape as usize).diagonal() < 2.0 * size)
}
