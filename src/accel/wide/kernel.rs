//! The traversal, generic over its vector operations.

#![allow(unsafe_code, reason = "the stack is not cleared for every ray: 2 KiB would cost as much as ten nodes")]

use std::mem::MaybeUninit;

use super::layout::{Child, LANES, Node, Packet, WIDTH};
use super::{MAX_DEPTH, Wide};
use crate::accel::KnownOccluders;
use crate::accel::query::{BOX_SLACK, Query, inclusive, is_better};
use crate::geometry::Hit;
use crate::geometry::soup::Primitive;

/// Vector operations on one ray against eight boxes or sixteen triangles.
///
/// The f32 operations and their order are the same in all implementations; those of `meet` are those of [`Query::meet`].
pub trait Lanes {
    /// The ray, spread over the lanes.
    type Ray;

    /// Spreads a ray.
    fn spread(query: &Query) -> Self::Ray;

    /// Bit `i` is set if the ray enters child `i` within [`t_min`, `limit`]; where it does is written to `distances`.
    fn enter(node: &Node, ray: &Self::Ray, limit: f32, distances: &mut Distances) -> u32;

    /// Bit `i` is set if the ray meets triangle `i` in (`t_min`, `limit`); where is written to `t`.
    fn meet(packet: &Packet, query: &Query, ray: &Self::Ray, limit: f32, t: &mut Parameters) -> u32;

    /// Asks for memory that will be read soon.
    fn prefetch(wide: &Wide, child: Child);
}

/// Eight ray parameters.
#[repr(align(32))]
pub struct Distances(pub [f32; WIDTH]);

/// A ray parameter for each triangle of a packet.
#[repr(align(64))]
pub struct Parameters(pub [f32; LANES]);

/// What is put aside: a child and the t at which the ray enters it, in the upper half, so that keys sort by t (which is not
/// negative).
#[derive(Clone, Copy, PartialEq, PartialOrd)]
pub struct Key(u64);

impl Key {
    /// Key of a child entered at `t`.
    #[inline(always)]
    pub fn new(t: f32, child: Child) -> Self {
        Key(u64::from(t.to_bits()) << 32 | u64::from(child.0))
    }

    /// Where the ray enters.
    #[inline(always)]
    pub fn t(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    /// What it enters.
    #[inline(always)]
    pub fn child(self) -> Child {
        Child(self.0 as u32)
    }
}

/// One level puts seven children aside at most.
const STACK: usize = (WIDTH - 1) * MAX_DEPTH + 1;

/// Keys put aside.
pub struct Stack<T> {
    keys: [MaybeUninit<T>; STACK],
    height: usize,
}

impl<T: Copy + PartialOrd> Stack<T> {
    /// Empty.
    #[inline(always)]
    pub fn new() -> Self {
        Self { keys: [const { MaybeUninit::uninit() }; STACK], height: 0 }
    }

    /// Keys on it.
    #[inline(always)]
    pub fn height(&self) -> usize {
        self.height
    }

    #[inline(always)]
    fn push(&mut self, key: T) {
        self.keys[self.height].write(key);
        self.height += 1;
    }

    #[inline(always)]
    fn get(&self, index: usize) -> T {
        debug_assert!(index < self.height);
        // SAFETY: `height` grows only in `push`, which writes the key at the old height, so all keys below `height` are written;
        // callers ask for such keys only.
        unsafe { self.keys[index].assume_init() }
    }

    /// Takes the topmost key.
    #[inline(always)]
    pub fn pop(&mut self) -> Option<T> {
        self.height = self.height.checked_sub(1)?;
        // SAFETY: as in `get`: the key just below the old height was written by `push`.
        Some(unsafe { self.keys[self.height].assume_init() })
    }

    /// Pushes `key` below those of the topmost keys, down to `floor`, that are nearer.
    #[inline(always)]
    pub fn insert(&mut self, floor: usize, key: T) {
        let mut slot = self.height;
        self.push(key);
        while slot > floor && self.get(slot - 1) < key {
            self.keys[slot] = self.keys[slot - 1];
            slot -= 1;
        }
        self.keys[slot].write(key);
    }
}

/// The nearest hit below `start` or the one already found, or with `ANY` the first one found.
#[inline(always)]
pub fn traverse<L: Lanes, const ANY: bool>(wide: &Wide, query: &Query, start: Child, mut best: Option<Hit>) -> Option<Hit> {
    let ray = L::spread(query);
    let mut stack = Stack::new();
    let mut limit = best.map_or(query.ray.t_max, |hit| end_after(hit, query));
    let mut current = start;
    loop {
        if current.is_leaf() {
            if meet_leaf::<L, ANY>(wide, query, &ray, current, &mut limit, &mut best) {
                return best;
            }
        } else if let Some(next) = descend::<L, ANY>(wide, &ray, current, limit, &mut stack) {
            current = next;
            continue;
        }
        // Next, what was put aside and does not lie beyond a hit found since.
        loop {
            let Some(key) = stack.pop() else { return best };
            if ANY || key.t() <= limit * BOX_SLACK {
                current = key.child();
                break;
            }
        }
    }
}

/// Whether there is a hit: in the leaves that are known to hide others, or else in any, which is then known.
#[inline(always)]
pub fn is_hidden<L: Lanes>(wide: &Wide, query: &Query, known: &mut KnownOccluders) -> bool {
    let ray = L::spread(query);
    let (mut limit, mut best) = (query.ray.t_max, None);
    if known.any(|&leaf| meet_leaf::<L, true>(wide, query, &ray, Child(leaf), &mut limit, &mut best)) {
        return true;
    }
    let mut stack = Stack::new();
    let mut current = Child::ROOT;
    loop {
        if current.is_leaf() {
            if meet_leaf::<L, true>(wide, query, &ray, current, &mut limit, &mut best) {
                known.add(current.0);
                return true;
            }
        } else if let Some(next) = descend::<L, true>(wide, &ray, current, limit, &mut stack) {
            current = next;
            continue;
        }
        let Some(key) = stack.pop() else { return false };
        current = key.child();
    }
}

/// The nearest child that the ray enters; the others are put aside, the nearest on top.
#[inline(always)]
fn descend<L: Lanes, const ANY: bool>(
    wide: &Wide,
    ray: &L::Ray,
    index: Child,
    limit: f32,
    stack: &mut Stack<Key>,
) -> Option<Child> {
    let node = &wide.nodes[index.0 as usize];
    let mut distances = Distances([0.0; WIDTH]);
    let mut mask = L::enter(node, ray, limit, &mut distances);
    let mut take = || {
        let slot = (mask.trailing_zeros() & 7) as usize;
        let is_there = mask != 0;
        mask &= mask.wrapping_sub(1);
        is_there.then(|| {
            let child = node.children[slot];
            L::prefetch(wide, child);
            Key::new(distances.0[slot], child)
        })
    };
    let first = take()?;
    let Some(second) = take() else { return Some(first.child()) };
    let (near, far) = if second < first { (second, first) } else { (first, second) };
    let Some(third) = take() else {
        stack.push(far);
        return Some(near.child());
    };
    if ANY {
        stack.push(far);
        let mut near = near;
        let mut next = Some(third);
        while let Some(key) = next {
            let (nearer, farther) = if key < near { (key, near) } else { (near, key) };
            stack.push(farther);
            near = nearer;
            next = take();
        }
        return Some(near.child());
    }
    let floor = stack.height;
    stack.push(far);
    stack.push(near);
    stack.insert(floor, third);
    while let Some(key) = take() {
        stack.insert(floor, key);
    }
    stack.pop().map(Key::child)
}

/// Tests a leaf's primitives; true if the traversal can stop.
#[inline(always)]
fn meet_leaf<L: Lanes, const ANY: bool>(
    wide: &Wide,
    query: &Query,
    ray: &L::Ray,
    leaf: Child,
    limit: &mut f32,
    best: &mut Option<Hit>,
) -> bool {
    for packet in &wide.packets[leaf.packets()] {
        let mut t = Parameters([0.0; LANES]);
        let mut mask = L::meet(packet, query, ray, *limit, &mut t);
        while mask != 0 {
            let lane = (mask.trailing_zeros() & 15) as usize;
            mask &= mask - 1;
            accept(Hit { t: t.0[lane], primitive: packet.primitives[lane] }, query, limit, best);
        }
        if leaf.has_spheres() {
            *best = meet_spheres(wide, query, packet, *best);
            *limit = best.map_or(*limit, |hit| end_after(hit, query));
        }
        if ANY && best.is_some() {
            return true;
        }
    }
    false
}

/// Keeps `hit` if it is better than the best so far.
#[inline(always)]
fn accept(hit: Hit, query: &Query, limit: &mut f32, best: &mut Option<Hit>) {
    if is_better(hit, *best) {
        *best = Some(hit);
        *limit = end_after(hit, query);
    }
}

/// Where the ray ends after a hit: hits at the same t still count, if their index is lower.
#[inline(always)]
fn end_after(hit: Hit, query: &Query) -> f32 {
    inclusive(hit.t).min(query.ray.t_max)
}

/// Spheres are rare: one at a time, by the exact test.
#[cold]
fn meet_spheres(wide: &Wide, query: &Query, packet: &Packet, mut best: Option<Hit>) -> Option<Hit> {
    for &primitive in packet.primitives() {
        let Primitive::Sphere(sphere) = wide.soup.primitive(primitive) else { continue };
        let t = sphere.intersect(&query.ray, query.ray.t_min, query.ray.t_max);
        best = t.map(|t| Hit { t, primitive }).filter(|&hit| is_better(hit, best)).or(best);
    }
    best
}
