//! Points in cells as wide as the largest disk that is looked at, by a hash of the cell.

use crate::math::{Vec3, sampler::mix};

/// Indices of points by place, in cells of twice a radius.
pub(super) struct PhotonGrid {
    /// First of the points of each bucket, and their number at the end.
    first: Vec<u32>,
    /// Indices of points, bucket by bucket, rising in each.
    members: Vec<u32>,
    per_cell: f32,
    mask: u64,
}

impl PhotonGrid {
    /// Sorts points for looks up to `radius` away.
    pub fn new(points: impl Iterator<Item = Vec3> + Clone, radius: f32) -> Self {
        let n = points.clone().count();
        let buckets = n.max(1).next_power_of_two();
        let mut grid =
            Self { first: vec![0; buckets + 1], members: vec![0; n], per_cell: 0.5 / radius, mask: buckets as u64 - 1 };
        for point in points.clone() {
            let bucket = grid.bucket(grid.cell(point));
            grid.first[bucket + 1] += 1;
        }
        for i in 0..buckets {
            grid.first[i + 1] += grid.first[i];
        }
        let mut next = grid.first.clone();
        for (i, point) in points.enumerate() {
            let bucket = grid.bucket(grid.cell(point));
            grid.members[next[bucket] as usize] = i as u32;
            next[bucket] += 1;
        }
        grid
    }

    /// Visits all points that may lie within `radius` of `point` (no more than that of the grid), always in the same order.
    #[inline]
    pub fn visit(&self, point: Vec3, radius: f32, mut visit: impl FnMut(u32)) {
        let (low, high) = (self.cell(point - radius), self.cell(point + radius));
        let mut seen = [usize::MAX; 8];
        let mut k = 0;
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let bucket = self.bucket([x, y, z]);
                    // Two cells may share a bucket.
                    if k < 8 && !seen[..k].contains(&bucket) {
                        seen[k] = bucket;
                        k += 1;
                        let range = self.first[bucket] as usize..self.first[bucket + 1] as usize;
                        self.members[range].iter().for_each(|i| visit(*i));
                    }
                }
            }
        }
    }

    #[inline]
    fn cell(&self, p: Vec3) -> [i32; 3] {
        (p * self.per_cell).floor().as_ivec3().to_array()
    }

    #[inline]
    fn bucket(&self, [x, y, z]: [i32; 3]) -> usize {
        let key = (x as u32 as u64) | ((y as u32 as u64) << 32);
        (mix(key ^ mix(z as u32 as u64 + 1)) & self.mask) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Sampler;

    /// All points within the radius are visited, each once.
    #[test]
    fn what_is_near_is_visited_once() {
        let points: Vec<Vec3> = (0..500_u64)
            .map(|i| {
                let mut s = Sampler::new(1, i, 0);
                Vec3::new(s.next_1d(), s.next_1d(), s.next_1d()) * 4.0 - 2.0
            })
            .collect();
        let grid = PhotonGrid::new(points.iter().copied(), 0.5);
        for at in points.iter().step_by(7) {
            for radius in [0.5, 0.2] {
                let mut times = vec![0; points.len()];
                grid.visit(*at, radius, |i| times[i as usize] += 1);
                for (i, p) in points.iter().enumerate() {
                    assert!(times[i] <= 1, "visited {} times", times[i]);
                    assert!(times[i] == 1 || p.distance(*at) > radius, "a near point was left out");
                }
            }
        }
    }
}
