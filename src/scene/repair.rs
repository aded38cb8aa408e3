//! Triangles that meshes of the real world hold and no renderer needs.

use crate::geometry::{Mesh, triangle};
use crate::math::{DVec3, Vec3};
use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};

/// Drops triangles without area; how many there were.
pub(super) fn drop_without_area(triangles: &mut Vec<[u32; 3]>, positions: &[Vec3]) -> usize {
    let before = triangles.len();
    triangles.retain(|t| {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        triangle::area_vector(a, b, c) != DVec3::ZERO
    });
    before - triangles.len()
}

/// Corners of a triangle in one order, whichever of them comes first; the same triangle turned round has another.
type Place = [[u32; 3]; 3];

fn place_of(triangle: &[u32; 3], positions: &[Vec3]) -> Place {
    // Both zeros are the same place.
    let corners = triangle.map(|i| (positions[i as usize] + Vec3::ZERO).to_array().map(f32::to_bits));
    let first = (0..3).min_by_key(|i| corners[*i]).unwrap_or(0);
    [corners[first], corners[(first + 1) % 3], corners[(first + 2) % 3]]
}

/// Drops every triangle that has the corners of an earlier one in the same order round; how many there were. A ray sees the first of
/// them, but pass one would count the area of each. The same triangle turned round is another side and stays.
pub(super) fn drop_copies(triangles: &mut Vec<[u32; 3]>, positions: &[Vec3]) -> usize {
    let before = triangles.len();
    let mut seen = HashSet::with_capacity(before);
    triangles.retain(|t| seen.insert(place_of(t, positions)));
    before - triangles.len()
}

/// Drops triangles that an earlier shape has as well: of two opaque surfaces in one place the one that comes first in the file is seen,
/// whatever engine looks, and the other has no area that light could reach. For each shape how many were dropped, and the shape that
/// has the first of them. `shapes` holds the opaque ones and `None` for others.
pub(super) fn drop_covered(shapes: &mut [Option<&mut Mesh>]) -> Vec<(usize, usize)> {
    // Only where boxes of two shapes meet can they have a triangle in common: most scenes are done here.
    let boxes: Vec<Option<(Vec3, Vec3)>> = shapes.iter().map(|mesh| mesh.as_ref().and_then(|m| corners_of(m))).collect();
    let meets = |i: usize, j: usize| match (boxes[i], boxes[j]) {
        (Some((a, b)), Some((c, d))) => a.cmple(d).all() && c.cmple(b).all(),
        _ => false,
    };
    let meeting = meeting_boxes(&boxes, meets);
    let mut owner: HashMap<Place, usize> = HashMap::new();
    let mut dropped = vec![(0, 0); shapes.len()];
    for (index, mesh) in shapes.iter_mut().enumerate().filter(|(index, _)| meeting[*index]) {
        let Some(mesh) = mesh else { continue };
        let (positions, triangles) = (&mesh.positions, &mut mesh.triangles);
        triangles.retain(|t| match owner.entry(place_of(t, positions)) {
            Entry::Occupied(first) if *first.get() != index => {
                if dropped[index].0 == 0 {
                    dropped[index].1 = *first.get();
                }
                dropped[index].0 += 1;
                false
            }
            Entry::Occupied(_) => true,
            Entry::Vacant(place) => {
                place.insert(index);
                true
            }
        });
    }
    dropped
}

/// The shapes whose boxes meet the box of another: a sweep along x.
fn meeting_boxes(boxes: &[Option<(Vec3, Vec3)>], meets: impl Fn(usize, usize) -> bool) -> Vec<bool> {
    let mut order: Vec<usize> = (0..boxes.len()).filter(|i| boxes[*i].is_some()).collect();
    let low = |i: usize| boxes[i].map_or(f32::INFINITY, |(low, _)| low.x);
    order.sort_by(|a, b| low(*a).total_cmp(&low(*b)));
    let mut meeting = vec![false; boxes.len()];
    for (k, &i) in order.iter().enumerate() {
        let high = boxes[i].map_or(f32::NEG_INFINITY, |(_, high)| high.x);
        for &j in order[k + 1..].iter().take_while(|j| low(**j) <= high) {
            if !(meeting[i] && meeting[j]) && meets(i, j) {
                (meeting[i], meeting[j]) = (true, true);
            }
        }
    }
    meeting
}

/// Box around the triangles of a mesh.
fn corners_of(mesh: &Mesh) -> Option<(Vec3, Vec3)> {
    let points = mesh.triangles.iter().flatten().map(|i| mesh.positions[*i as usize]);
    points.fold(None, |found, p| Some(found.map_or((p, p), |(low, high): (Vec3, Vec3)| (low.min(p), high.max(p)))))
}

/// Edges that two triangles pass in the same direction. Neighbours with the same side up pass theirs in opposite ones.
pub(super) fn turned_edges(triangles: &[[u32; 3]]) -> usize {
    let mut edges: Vec<(u32, u32)> = triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
    edges.sort_unstable();
    edges.windows(2).filter(|pair| pair[0] == pair[1]).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_no_area_or_comes_twice_is_dropped() {
        let p = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (2.0, 0.0), (-0.0, 0.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
        let mut triangles = vec![[0, 1, 2], [0, 1, 3], [1, 1, 2], [1, 2, 0], [4, 1, 2], [0, 2, 1]];
        assert_eq!(drop_without_area(&mut triangles, &p), 2);
        assert_eq!(drop_copies(&mut triangles, &p), 2);
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 1]], "one of each side is left");
    }

    #[test]
    fn what_an_earlier_shape_has_is_dropped() {
        let mesh = |offset: f32, triangles: &[[u32; 3]]| {
            let positions = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(x, y)| Vec3::new(x + offset, y, 0.0)).to_vec();
            Mesh { positions, triangles: triangles.to_vec(), ..Mesh::default() }
        };
        let mut meshes = [
            mesh(0.0, &[[0, 1, 2]]),
            mesh(9.0, &[[0, 1, 2]]),
            mesh(0.0, &[[1, 2, 0], [0, 2, 1], [1, 3, 2]]),
            mesh(0.0, &[[3, 2, 1]]),
        ];
        let [a, b, c, _] = &mut meshes;
        assert_eq!(drop_covered(&mut [Some(a), Some(b), Some(c), None]), [(0, 0), (0, 0), (1, 0), (0, 0)]);
        assert_eq!(meshes[2].triangles, [[0, 2, 1], [1, 3, 2]], "the turned one and the other one stay");
        let [_, _, c, d] = &mut meshes;
        assert_eq!(drop_covered(&mut [None, None, Some(c), Some(d)])[3], (1, 2), "[3, 2, 1] goes round as [1, 3, 2]");
    }

    #[test]
    fn a_triangle_turned_over_shows_at_its_edges() {
        assert_eq!(turned_edges(&[[0, 1, 2], [0, 2, 3]]), 0);
        assert_eq!(turned_edges(&[[0, 1, 2], [0, 3, 2]]), 1);
    }
}
