//! Links by node, both directions of each side by side; a file keeps one of them.

use super::refine::Link;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use std::borrow::Cow;

/// Links of each node, those to nodes of lower index first.
#[derive(Debug, Clone, Default)]
pub struct Links {
    /// Links of node p are from `start[p]` to `start[p + 1]`.
    start: Vec<usize>,
    other: Vec<u32>,
    /// S = A_p F_pq [m²].
    transfer: Vec<f32>,
}

/// One direction as a file has it: links of each node to those of its own or higher index. Bytes are taken as they lie in the file, which for
/// millions of links is most of the time that reading takes.
#[derive(Serialize, Deserialize)]
struct Upper<'a> {
    /// Links of each node.
    count: Vec<u32>,
    /// The other node of each, in as many bytes as the largest index needs ([`width`]), little-endian.
    #[serde(borrow)]
    other: Raw<'a>,
    /// S of each [m²]: f32, little-endian.
    transfer: Raw<'a>,
}

/// Bytes as they are.
struct Raw<'a>(Cow<'a, [u8]>);

impl Serialize for Raw<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.0)
    }
}

impl<'de: 'a, 'a> Deserialize<'de> for Raw<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        <&'de [u8]>::deserialize(deserializer).map(|bytes| Self(Cow::Borrowed(bytes)))
    }
}

/// Bytes of a node's index where there are so many nodes.
fn width(nodes: usize) -> usize {
    match nodes {
        0..=0x1_0000 => 2,
        0x1_0001..=0x100_0000 => 3,
        _ => 4,
    }
}

/// Link `k` of a file whose indices have `WIDTH` bytes.
fn link<const WIDTH: usize>(upper: &Upper<'_>, k: usize) -> (u32, f32) {
    let (mut other, mut transfer) = ([0; 4], [0; 4]);
    other[..WIDTH].copy_from_slice(&upper.other.0[k * WIDTH..(k + 1) * WIDTH]);
    transfer.copy_from_slice(&upper.transfer.0[4 * k..4 * k + 4]);
    (u32::from_le_bytes(other), f32::from_le_bytes(transfer))
}

impl Links {
    /// Puts the links of tasks in the order of `nodes` nodes.
    pub fn new(nodes: usize, found: Vec<Vec<Link>>) -> Self {
        let mut count = vec![0; nodes];
        found.iter().flatten().for_each(|link| count[link.first as usize] += 1);
        let mut next = starts(&count);
        let mut upper = vec![(0, 0.0); next[nodes]];
        // Each batch is freed as soon as it has been read.
        for link in found.into_iter().flatten() {
            let at = &mut next[link.first as usize];
            upper[*at] = (link.second, link.transfer);
            *at += 1;
        }
        Self::both_ways(&count, |k| upper[k])
    }

    /// From so many links of each node to those of its own or higher index, one after the other.
    fn both_ways(upper: &[u32], link: impl Fn(usize) -> (u32, f32)) -> Self {
        let nodes = upper.len();
        let from = starts(upper);
        let mut count = upper.to_vec();
        // A patch that sees itself has one entry.
        for p in 0..nodes {
            (from[p]..from[p + 1]).map(|k| link(k).0 as usize).filter(|&q| q != p).for_each(|q| count[q] += 1);
        }
        let start = starts(&count);
        let mut next = start.clone();
        let (mut other, mut transfer) = (vec![0; start[nodes]], vec![0.0; start[nodes]]);
        for p in 0..nodes {
            for k in from[p]..from[p + 1] {
                let (q, s) = link(k);
                for (own, seen) in [(p, q), (q as usize, p as u32)].into_iter().take(if q as usize == p { 1 } else { 2 }) {
                    let at = &mut next[own];
                    (other[*at], transfer[*at]) = (seen, s);
                    *at += 1;
                }
            }
        }
        Self { start, other, transfer }
    }

    /// The other nodes of the links of node `at`, and what they transfer. Products read both from memory, which two rows side by side do
    /// faster than one of pairs.
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
        let width = width(self.nodes());
        let (mut count, mut other, mut transfer) = (Vec::with_capacity(self.nodes()), Vec::new(), Vec::new());
        for at in 0..self.nodes() {
            let (others, transfers) = self.of(at);
            let low = others.partition_point(|&q| (q as usize) < at);
            count.push((others.len() - low) as u32);
            others[low..].iter().for_each(|q| other.extend_from_slice(&q.to_le_bytes()[..width]));
            transfers[low..].iter().for_each(|s| transfer.extend_from_slice(&s.to_le_bytes()));
        }
        Upper { count, other: Raw(other.into()), transfer: Raw(transfer.into()) }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Links {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let upper = Upper::deserialize(deserializer)?;
        let total: usize = upper.count.iter().map(|n| *n as usize).sum();
        let nodes = upper.count.len();
        let width = width(nodes);
        let read = match width {
            2 => link::<2>,
            3 => link::<3>,
            _ => link::<4>,
        };
        let whole = Some(upper.other.0.len()) == total.checked_mul(width) && Some(upper.transfer.0.len()) == total.checked_mul(4);
        if !whole || (0..total).any(|k| read(&upper, k).0 as usize >= nodes) {
            return Err(D::Error::custom("links lead to nodes that are not there"));
        }
        Ok(match width {
            2 => Self::both_ways(&upper.count, |k| link::<2>(&upper, k)),
            3 => Self::both_ways(&upper.count, |k| link::<3>(&upper, k)),
            _ => Self::both_ways(&upper.count, |k| link::<4>(&upper, k)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_go_both_ways_and_come_back_from_a_file_in_the_same_order() {
        let link = |first, second, transfer| Link { first, second, transfer };
        let links = Links::new(4, vec![vec![link(1, 3, 0.5), link(0, 2, 0.25)], vec![link(2, 2, 1.0), link(1, 2, 2.0)]]);
        assert_eq!(links.of(0), (&[2][..], &[0.25][..]));
        assert_eq!(links.of(1), (&[3, 2][..], &[0.5, 2.0][..]));
        assert_eq!(links.of(2), (&[0, 1, 2][..], &[0.25, 2.0, 1.0][..]));
        assert_eq!(links.of(3), (&[1][..], &[0.5][..]));
        let bytes = postcard::to_stdvec(&links).expect("plain numbers");
        let back: Links = postcard::from_bytes(&bytes).expect("as written");
        assert!((0..4).all(|at| back.of(at) == links.of(at)));
        // Indices of two, three and four bytes.
        assert_eq!([1, 0x1_0000, 0x1_0001, 0x100_0000, 0x100_0001].map(width), [2, 2, 3, 3, 4]);
        let many = Links::new(70_000, vec![vec![link(3, 69_999, 0.5)]]);
        let back: Links = postcard::from_bytes(&postcard::to_stdvec(&many).expect("plain numbers")).expect("as written");
        assert_eq!((back.of(3), back.of(69_999)), (many.of(3), many.of(69_999)));
        // One that leads to a fifth node is refused, and so are fewer bytes than there are links.
        let upper = |other: &'static [u8], transfer: &'static [u8]| {
            let bad = Upper { count: vec![1, 0, 0, 0], other: Raw(other.into()), transfer: Raw(transfer.into()) };
            postcard::from_bytes::<Links>(&postcard::to_stdvec(&bad).expect("plain numbers")).is_ok()
        };
        assert_eq!(
            [upper(&[3, 0], &[0; 4]), upper(&[4, 0], &[0; 4]), upper(&[3, 0], &[0; 3]), upper(&[3], &[0; 4])],
            [true, false, false, false]
        );
    }
}
