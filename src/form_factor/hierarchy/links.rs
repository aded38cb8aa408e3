//! Links by node, both directions of each side by side; a file keeps one of them.

use super::refine::Link;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

/// Links of each node, those to nodes of lower index first.
#[derive(Debug, Clone, Default)]
pub struct Links {
    /// Links of node p are from `start[p]` to `start[p + 1]`.
    start: Vec<usize>,
    other: Vec<u32>,
    /// S = A_p F_pq [m²].
    transfer: Vec<f32>,
}

/// One direction: links of each node to those of its own or higher index.
#[derive(Default, Serialize, Deserialize)]
struct Upper {
    count: Vec<u32>,
    other: Vec<u32>,
    transfer: Vec<f32>,
}

impl Links {
    /// Puts the links of tasks in the order of `nodes` nodes.
    pub fn new(nodes: usize, found: Vec<Vec<Link>>) -> Self {
        let mut count = vec![0; nodes];
        found.iter().flatten().for_each(|link| count[link.first as usize] += 1);
        let mut next = starts(&count);
        let total = next[nodes];
        let (mut other, mut transfer) = (vec![0; total], vec![0.0; total]);
        // Each batch is freed as soon as it has been read.
        for link in found.into_iter().flatten() {
            let at = &mut next[link.first as usize];
            (other[*at], transfer[*at]) = (link.second, link.transfer);
            *at += 1;
        }
        Self::both_ways(&Upper { count, other, transfer })
    }

    fn both_ways(upper: &Upper) -> Self {
        let nodes = upper.count.len();
        let from = starts(&upper.count);
        let mut count = upper.count.clone();
        // A patch that sees itself has one entry.
        let others = |p: usize| from[p]..from[p + 1];
        for p in 0..nodes {
            upper.other[others(p)].iter().filter(|&&q| q as usize != p).for_each(|&q| count[q as usize] += 1);
        }
        let start = starts(&count);
        let mut next = start.clone();
        let (mut other, mut transfer) = (vec![0; start[nodes]], vec![0.0; start[nodes]]);
        for p in 0..nodes {
            for k in others(p) {
                let (q, s) = (upper.other[k], upper.transfer[k]);
                for (own, seen) in [(p, q), (q as usize, p as u32)].into_iter().take(if q as usize == p { 1 } else { 2 }) {
                    let at = &mut next[own];
                    (other[*at], transfer[*at]) = (seen, s);
                    *at += 1;
                }
            }
        }
        Self { start, other, transfer }
    }

    /// The other nodes of the links of node `at`, and what they transfer.
    #[inline]
    pub fn of(&self, at: usize) -> (&[u32], &[f32]) {
        let range = self.start[at]..self.start[at + 1];
        (&self.other[range.clone()], &self.transfer[range])
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        8 * self.start.len() + 8 * self.other.len()
    }
}

/// Where each begins that has so many, and the end.
fn starts(count: &[u32]) -> Vec<usize> {
    let mut start = Vec::with_capacity(count.len() + 1);
    start.push(0);
    let mut sum = 0;
    start.extend(count.iter().map(|n| {
        sum += *n as usize;
        sum
    }));
    start
}

impl Serialize for Links {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut upper = Upper::default();
        for at in 0..self.nodes() {
            let (other, transfer) = self.of(at);
            let low = other.partition_point(|&q| (q as usize) < at);
            upper.count.push((other.len() - low) as u32);
            upper.other.extend_from_slice(&other[low..]);
            upper.transfer.extend_from_slice(&transfer[low..]);
        }
        upper.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Links {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let upper = Upper::deserialize(deserializer)?;
        let total: usize = upper.count.iter().map(|n| *n as usize).sum();
        let nodes = upper.count.len();
        let fits =
            upper.other.len() == total && upper.transfer.len() == total && upper.other.iter().all(|&q| (q as usize) < nodes);
        if fits { Ok(Self::both_ways(&upper)) } else { Err(D::Error::custom("links lead to nodes that are not there")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_go_both_ways_and_come_back_from_a_file_in_the_same_order() {
        let link = |first, second, transfer| Link { first, second, transfer };
        let links = Links::new(4, vec![vec![link(1, 3, 0.5), link(0, 2, 0.25)], vec![link(2, 2, 1.0), link(1, 2, 2.0)]]);
        let of = |links: &Links, at: usize| {
            let (other, transfer) = links.of(at);
            (other.to_vec(), transfer.to_vec())
        };
        assert_eq!(of(&links, 0), (vec![2], vec![0.25]));
        assert_eq!(of(&links, 1), (vec![3, 2], vec![0.5, 2.0]));
        assert_eq!(of(&links, 2), (vec![0, 1, 2], vec![0.25, 2.0, 1.0]));
        assert_eq!(of(&links, 3), (vec![1], vec![0.5]));
        let bytes = postcard::to_stdvec(&links).expect("plain numbers");
        let back: Links = postcard::from_bytes(&bytes).expect("as written");
        assert!((0..4).all(|at| of(&back, at) == of(&links, at)));
        // One that leads to a fifth node is refused.
        let bad = Upper { count: vec![1, 0, 0, 0], other: vec![4], transfer: vec![1.0] };
        let bytes = postcard::to_stdvec(&bad).expect("plain numbers");
        assert!(postcard::from_bytes::<Links>(&bytes).is_err());
    }
}
