//! Links by node, each kept once, with the node of lower index, and carried both ways.

use super::refine::Link;
use crate::accel::{Work, widest};
use rayon::prelude::*;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Mutex, OnceLock};

/// Most parts that a product is made in side by side, each with sums of its own.
const MOST_PARTS: usize = 4;
/// Links that a part has for each node, at least: the sums of each part are to be cleared, kept in a cache, and added to the others.
const LEAST_LINKS: usize = 16;

/// Links of each node to those of its own or higher index. A product reads each once: what it waits for is memory.
#[derive(Debug, Clone, Default)]
pub struct Links {
    upper: Rows,
    /// The same the other way, for whoever asks for single rows.
    lower: OnceLock<Rows>,
}

/// Links of each node, one after the other.
#[derive(Debug, Clone, Default)]
struct Rows {
    /// Links of node p are from `start[p]` to `start[p + 1]`.
    start: Vec<usize>,
    other: Vec<u32>,
    /// S = A_p F_pq [m²].
    transfer: Vec<f32>,
}

impl Rows {
    #[inline]
    fn of(&self, at: usize) -> (&[u32], &[f32]) {
        let range = self.start[at]..self.start[at + 1];
        (&self.other[range.clone()], &self.transfer[range])
    }

    /// Puts the link of a node with itself before its others.
    fn put_own_first(&mut self) {
        for p in 0..self.start.len().saturating_sub(1) {
            let first = self.start[p];
            if let Some(at) = self.of(p).0.iter().position(|&q| q as usize == p) {
                self.other.swap(first, first + at);
                self.transfer.swap(first, first + at);
            }
        }
    }
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

impl Links {
    /// Puts the links of tasks in the order of `nodes` nodes.
    pub fn new(nodes: usize, found: Vec<Vec<Link>>) -> Self {
        let mut count = vec![0; nodes];
        found.iter().flatten().for_each(|link| count[link.first as usize] += 1);
        let start = starts(&count);
        let mut next = start.clone();
        let (mut other, mut transfer) = (vec![0; start[nodes]], vec![0.0; start[nodes]]);
        // Each batch is freed as soon as it has been read.
        for link in found.into_iter().flatten() {
            let at = &mut next[link.first as usize];
            (other[*at], transfer[*at]) = (link.second, link.transfer);
            *at += 1;
        }
        let mut upper = Rows { start, other, transfer };
        upper.put_own_first();
        Self { upper, lower: OnceLock::new() }
    }

    /// Links of each node to those of lower index, in rising order.
    fn lower(&self) -> &Rows {
        self.lower.get_or_init(|| {
            let nodes = self.nodes();
            let mut count = vec![0; nodes];
            let others = |p: usize| self.upper.of(p).0.iter().map(|&q| q as usize).filter(move |&q| q != p);
            (0..nodes).flat_map(others).for_each(|q| count[q] += 1);
            let start = starts(&count);
            let mut next = start.clone();
            let (mut other, mut transfer) = (vec![0; start[nodes]], vec![0.0; start[nodes]]);
            for p in 0..nodes {
                let (others, transfers) = self.upper.of(p);
                for (&q, &s) in others.iter().zip(transfers).filter(|(q, _)| **q as usize != p) {
                    let at = &mut next[q as usize];
                    (other[*at], transfer[*at]) = (p as u32, s);
                    *at += 1;
                }
            }
            Rows { start, other, transfer }
        })
    }

    /// The other nodes of the links of node `at` that are its own or higher, and what they transfer.
    #[inline]
    pub fn upper(&self, at: usize) -> (&[u32], &[f32]) {
        self.upper.of(at)
    }

    /// All links of node `at`: the other node of each and what it transfers.
    pub fn of(&self, at: usize) -> impl Iterator<Item = (u32, f32)> + '_ {
        let (lower, upper) = (self.lower().of(at), self.upper.of(at));
        [lower, upper].into_iter().flat_map(|(others, transfers)| others.iter().copied().zip(transfers.iter().copied()))
    }

    /// sum over the links (p, q) of each node p of S_pq x_q, in parallel: the same bits on any number of threads, since how many parts are
    /// added in which order depends on the links alone.
    pub fn carry<const N: usize>(&self, x: &[[f64; N]], spare: &Spare<N>) -> Vec<[f64; N]> {
        let part = |nodes: Range<usize>| {
            let mut found = spare.take(x.len() - nodes.start);
            widest(Carrying { links: &self.upper, x, nodes, found: &mut found });
            found
        };
        let mut parts = self.parts().into_par_iter().map(part).collect::<Vec<_>>().into_iter();
        let mut all = parts.next().unwrap_or_default();
        for part in parts {
            let from = all.len() - part.len();
            all[from..].iter_mut().zip(&part).for_each(|(sum, found)| *sum = plus(*sum, *found, 1.0));
            spare.give(part);
        }
        all
    }

    /// Nodes in parts of about as many links each; the first begins with the first node.
    fn parts(&self) -> Vec<Range<usize>> {
        let (nodes, links) = (self.nodes(), self.upper.other.len());
        let parts = (links / (LEAST_LINKS * nodes.max(1))).clamp(1, MOST_PARTS);
        let border = |part: usize| match part {
            0 => 0,
            _ if part == parts => nodes,
            _ => self.upper.start[..nodes].partition_point(|&start| start * parts < links * part),
        };
        (0..parts).map(|part| border(part)..border(part + 1)).collect()
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.upper.start.len().saturating_sub(1)
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        let of = |rows: &Rows| 8 * (rows.start.len() + rows.other.len());
        of(&self.upper) + self.lower.get().map_or(0, of)
    }
}

/// What the links of some nodes carry, both ways, to these and those of higher index.
struct Carrying<'a, const N: usize> {
    links: &'a Rows,
    x: &'a [[f64; N]],
    nodes: Range<usize>,
    /// From the first of the nodes on.
    found: &'a mut [[f64; N]],
}

impl<const N: usize> Work for Carrying<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { links, x, nodes, found } = self;
        let from = nodes.start;
        for p in nodes {
            let (mut others, mut transfers) = links.of(p);
            let own = x[p];
            // Four sums side by side: each addition would wait for the one before.
            let mut sums = [[0.0; N]; 4];
            // A patch that sees itself has one link for both ways, its first.
            if others.first() == Some(&(p as u32)) {
                sums[0] = plus(sums[0], own, f64::from(transfers[0]));
                (others, transfers) = (&others[1..], &transfers[1..]);
            }
            let (fours, rest) = others.as_chunks::<4>();
            let (four_transfers, rest_transfers) = transfers.as_chunks::<4>();
            let mut carry = |k: usize, q: u32, s: f32| {
                let (q, s) = (q as usize, f64::from(s));
                sums[k] = plus(sums[k], x[q], s);
                found[q - from] = plus(found[q - from], own, s);
            };
            for (others, transfers) in fours.iter().zip(four_transfers) {
                (0..4).for_each(|k| carry(k, others[k], transfers[k]));
            }
            rest.iter().zip(rest_transfers).enumerate().for_each(|(k, (q, s))| carry(k, *q, *s));
            let [a, b, c, d] = sums;
            found[p - from] = plus(found[p - from], plus(plus(a, b, 1.0), plus(c, d, 1.0), 1.0), 1.0);
        }
    }
}

/// a + b s.
#[inline(always)]
fn plus<const N: usize>(mut a: [f64; N], b: [f64; N], s: f64) -> [f64; N] {
    for k in 0..N {
        a[k] += b[k] * s;
    }
    a
}

/// Memory that a product has used and the next may use: fresh pages cost more than filling old ones.
#[derive(Debug, Default)]
pub struct Spare<const N: usize>(Mutex<Vec<Vec<[f64; N]>>>);

impl<const N: usize> Spare<N> {
    /// So many zeros.
    pub fn take(&self, len: usize) -> Vec<[f64; N]> {
        let mut taken = self.0.lock().ok().and_then(|mut spare| spare.pop()).unwrap_or_default();
        taken.clear();
        taken.resize(len, [0.0; N]);
        taken
    }

    /// For the next that asks.
    pub fn give(&self, used: Vec<[f64; N]>) {
        if let Ok(mut spare) = self.0.lock() {
            spare.push(used);
        }
    }
}

impl<const N: usize> Clone for Spare<N> {
    fn clone(&self) -> Self {
        Self::default()
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
        let Rows { start, other: others, transfer: transfers } = &self.upper;
        let count = start.windows(2).map(|at| (at[1] - at[0]) as u32).collect();
        let (mut other, mut transfer) = (Vec::with_capacity(width * others.len()), Vec::with_capacity(4 * others.len()));
        others.iter().for_each(|q| other.extend_from_slice(&q.to_le_bytes()[..width]));
        transfers.iter().for_each(|s| transfer.extend_from_slice(&s.to_le_bytes()));
        Upper { count, other: Raw(other.into()), transfer: Raw(transfer.into()) }.serialize(serializer)
    }
}

/// Indices of `WIDTH` bytes each.
fn indices<const WIDTH: usize>(bytes: &[u8]) -> Vec<u32> {
    let index = |bytes: &[u8; WIDTH]| {
        let mut index = [0; 4];
        index[..WIDTH].copy_from_slice(bytes);
        u32::from_le_bytes(index)
    };
    bytes.as_chunks().0.iter().map(index).collect()
}

impl<'de> Deserialize<'de> for Links {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let Upper { count, other, transfer } = Upper::deserialize(deserializer)?;
        let start = starts(&count);
        let (nodes, total) = (count.len(), start[count.len()]);
        let width = width(nodes);
        if Some(other.0.len()) != total.checked_mul(width) || Some(transfer.0.len()) != total.checked_mul(4) {
            return Err(D::Error::custom("as many indices and transfers as links are needed"));
        }
        let other = match width {
            2 => indices::<2>(&other.0),
            3 => indices::<3>(&other.0),
            _ => indices::<4>(&other.0),
        };
        let transfer = transfer.0.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        let mut rows = Rows { start, other, transfer };
        rows.put_own_first();
        let leads_astray = |p: usize| {
            rows.of(p).0.iter().enumerate().any(|(k, &q)| q as usize >= nodes || (q as usize) < p + usize::from(k > 0))
        };
        if (0..nodes).any(leads_astray) {
            return Err(D::Error::custom("links lead to nodes that are not there, or back"));
        }
        Ok(Self { upper: rows, lower: OnceLock::new() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_go_both_ways_and_come_back_from_a_file_in_the_same_order() {
        let link = |first, second, transfer| Link { first, second, transfer };
        let links = Links::new(4, vec![vec![link(1, 3, 0.5), link(0, 2, 0.25)], vec![link(2, 2, 1.0), link(1, 2, 2.0)]]);
        let of = |links: &Links, at: usize| links.of(at).collect::<Vec<_>>();
        assert_eq!(of(&links, 0), [(2, 0.25)]);
        assert_eq!(of(&links, 1), [(3, 0.5), (2, 2.0)]);
        assert_eq!(of(&links, 2), [(0, 0.25), (1, 2.0), (2, 1.0)]);
        assert_eq!(of(&links, 3), [(1, 0.5)]);
        assert_eq!(links.carry(&[[1.0], [10.0], [100.0], [1000.0]], &Spare::default()), [[25.0], [700.0], [120.25], [5.0]]);
        let bytes = postcard::to_stdvec(&links).expect("plain numbers");
        let back: Links = postcard::from_bytes(&bytes).expect("as written");
        assert!((0..4).all(|at| of(&back, at) == of(&links, at)));
        // Indices of two, three and four bytes.
        assert_eq!([1, 0x1_0000, 0x1_0001, 0x100_0000, 0x100_0001].map(width), [2, 2, 3, 3, 4]);
        let many = Links::new(70_000, vec![vec![link(3, 69_999, 0.5)]]);
        let back: Links = postcard::from_bytes(&postcard::to_stdvec(&many).expect("plain numbers")).expect("as written");
        assert!([3, 69_999].into_iter().all(|at| of(&back, at).len() == 1 && of(&back, at) == of(&many, at)));
        // One that leads to a fifth node is refused, one that leads back, and fewer bytes than there are links.
        let upper = |other: &'static [u8], transfer: &'static [u8]| {
            let bad = Upper { count: vec![0, 1, 0, 0], other: Raw(other.into()), transfer: Raw(transfer.into()) };
            postcard::from_bytes::<Links>(&postcard::to_stdvec(&bad).expect("plain numbers")).is_ok()
        };
        assert_eq!(
            [
                upper(&[3, 0], &[0; 4]),
                upper(&[4, 0], &[0; 4]),
                upper(&[0, 0], &[0; 4]),
                upper(&[3, 0], &[0; 3]),
                upper(&[3], &[0; 4])
            ],
            [true, false, false, false, false]
        );
    }
}
