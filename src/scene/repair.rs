//! Triangles that meshes of the real world hold and no renderer needs.

use crate::geometry::triangle;
use crate::math::{DVec3, Vec3};
use std::collections::HashSet;

/// Drops triangles without area; how many there were.
pub(super) fn drop_without_area(triangles: &mut Vec<[u32; 3]>, positions: &[Vec3]) -> usize {
    let before = triangles.len();
    triangles.retain(|t| {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        triangle::area_vector(a, b, c) != DVec3::ZERO
    });
    before - triangles.len()
}

/// Drops every triangle that has the corners of an earlier one in the same order round; how many there were. A ray sees the first of
/// them, but pass one would count the area of each. The same triangle turned round is another side and stays.
pub(super) fn drop_copies(triangles: &mut Vec<[u32; 3]>, positions: &[Vec3]) -> usize {
    let before = triangles.len();
    let mut seen = HashSet::with_capacity(before);
    triangles.retain(|t| {
        // Both zeros are the same place.
        let corners = t.map(|i| (positions[i as usize] + Vec3::ZERO).to_array().map(f32::to_bits));
        let first = (0..3).min_by_key(|i| corners[*i]).unwrap_or(0);
        seen.insert([corners[first], corners[(first + 1) % 3], corners[(first + 2) % 3]])
    });
    before - triangles.len()
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
    fn a_triangle_turned_over_shows_at_its_edges() {
        assert_eq!(turned_edges(&[[0, 1, 2], [0, 2, 3]]), 0);
        assert_eq!(turned_edges(&[[0, 1, 2], [0, 3, 2]]), 1);
    }
}
