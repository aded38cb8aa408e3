//! Thirty-two alike rays at once: one walk through the tree for all of them.
//!
//! A node's children are first tested against bounds of all rays together (interval arithmetic, as in [Boulos06]), then those that
//! remain against all rays side by side; at leaves, and where only few rays are left in a subtree, each goes on alone. Each ray
//! does the same f32 operations as alone and so gets the same answer.

#![allow(unsafe_code, reason = "vector loads and stores, and calls into functions compiled for AVX2 after asking for it")]

use std::arch::x86_64::*;

use super::Wide;
use super::kernel::{Distances, Key, Lanes, Stack, traverse};
use super::layout::{Child, LANES, Node, Packet, WIDTH};
use crate::accel::query::{BOX_SLACK, Query};
use crate::geometry::triangle::ShearedRay;
use crate::geometry::{Hit, Ray};
use crate::math::Vec3;

/// Rays in a bundle.
pub const RAYS: usize = 32;
/// Groups of eight rays in a bundle.
const GROUPS: usize = RAYS / WIDTH;

/// One value a ray.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub struct Row(pub [f32; RAYS]);

/// Rays side by side.
pub struct Bundle<'a> {
    rays: &'a [Ray],
    /// Start points, by axis.
    pub origin: [Row; 3],
    /// One over the directions, by axis.
    pub inverse: [Row; 3],
    /// Slopes along the two lesser axes, in the order of the shear.
    pub slope: [Row; 2],
    /// Where each ray starts.
    pub t_min: Row,
    /// Where each ray ends: at `t_max`, at the best hit, or before all if it wants no more.
    pub limit: Row,
    /// Primitive of the best hit; 0 while there is none, so that nothing at `t_max` itself counts. Its bits: indices below 2^27
    /// are ordered as numbers of these bits are.
    primitive: Row,
    together: Together,
    /// Rows of [`Node::planes`] through which all rays enter and leave.
    pub rows: [(usize, usize); 3],
    /// Order of coordinates in the shear, the same for all rays.
    axes: [usize; 3],
}

/// Bounds of all rays: for each axis the origin that enters first and the one that leaves last, and the inverse's ends.
#[derive(Default)]
struct Together {
    first: [f32; 3],
    last: [f32; 3],
    low: [f32; 3],
    high: [f32; 3],
    t_min: f32,
    limit: f32,
}

/// Vectors with one number for each of some rays.
pub trait RayVector: Lanes {
    /// The vector.
    type Vector: Copy;
    /// Yes or no for each ray.
    type Mask: Copy;
    /// Rays in a vector.
    const N: usize;

    /// The same for all rays.
    fn splat(x: f32) -> Self::Vector;
    /// Those of a group of rays.
    fn load(row: &Row, group: usize) -> Self::Vector;
    /// Writes those of a group.
    fn store(row: &mut Row, group: usize, values: Self::Vector);
    /// `a + b`.
    fn add(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a - b`.
    fn sub(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a b`.
    fn mul(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a / b`.
    fn div(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The lower; `b` where one is a NaN.
    fn min(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The higher; `b` where one is a NaN.
    fn max(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a < b`.
    fn less(a: Self::Vector, b: Self::Vector) -> Self::Mask;
    /// `a <= b`.
    fn less_or_equal(a: Self::Vector, b: Self::Vector) -> Self::Mask;
    /// `a == b`.
    fn equal(a: Self::Vector, b: Self::Vector) -> Self::Mask;
    /// Both.
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// At least one.
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The first, but not the second.
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// One bit a ray.
    fn bits(mask: Self::Mask) -> u32;
    /// `yes` where the mask says so, else `no`.
    fn select(mask: Self::Mask, yes: Self::Vector, no: Self::Vector) -> Self::Vector;
}

/// Nearest hits of up to [`RAYS`] [usable](crate::accel::query::usable) rays that share the sign of each direction component and
/// the largest one.
///
/// To be called with AVX2.
#[inline(always)]
pub fn nearest<L: RayVector>(wide: &Wide, rays: &[Ray], hit: &mut impl FnMut(usize, Option<Hit>)) {
    // SAFETY: the callers are compiled for AVX2, or more.
    let mut bundle = unsafe { Bundle::new(rays) };
    walk::<L, false>(wide, &mut bundle);
    for (index, ray) in rays.iter().enumerate() {
        let (t, primitive) = (bundle.limit.0[index], bundle.primitive.0[index].to_bits());
        hit(index, (t < ray.t_max).then_some(Hit { t, primitive }));
    }
}

/// Occlusion of such rays.
///
/// To be called with AVX2.
#[inline(always)]
pub fn any<L: RayVector>(wide: &Wide, rays: &[Ray], answer: &mut impl FnMut(usize, bool)) {
    // SAFETY: as in `nearest`.
    let mut bundle = unsafe { Bundle::new(rays) };
    walk::<L, true>(wide, &mut bundle);
    for index in 0..rays.len() {
        answer(index, bundle.limit.0[index] == f32::NEG_INFINITY);
    }
}

/// Widest spread of directions, as a slope, at which bundles were faster than single rays.
const MAX_SPREAD: f32 = 1.0;

impl<'a> Bundle<'a> {
    #[inline]
    #[target_feature(enable = "avx2,bmi1,bmi2")]
    fn new(rays: &'a [Ray]) -> Self {
        assert!(!rays.is_empty() && rays.len() <= RAYS, "a bundle of rays");
        let first = &rays[0];
        let rows = |axis: usize| if first.direction[axis].is_sign_positive() { (axis, axis + 3) } else { (axis + 3, axis) };
        // A lane without a ray has the first one's numbers, but ends before it starts. The directions stay in `inverse` until they
        // are inverted.
        let spread = |v: Vec3| [Row([v.x; RAYS]), Row([v.y; RAYS]), Row([v.z; RAYS])];
        let mut bundle = Self {
            rays,
            origin: spread(first.origin),
            inverse: spread(first.direction),
            slope: [Row([0.0; RAYS]); 2],
            t_min: Row([first.t_min; RAYS]),
            limit: Row([f32::NEG_INFINITY; RAYS]),
            primitive: Row([0.0; RAYS]),
            together: Together::default(),
            rows: [rows(0), rows(1), rows(2)],
            axes: ShearedRay::new(first).axes,
        };
        for (index, ray) in rays.iter().enumerate() {
            for axis in 0..3 {
                bundle.origin[axis].0[index] = ray.origin[axis];
                bundle.inverse[axis].0[index] = ray.direction[axis];
            }
            bundle.t_min.0[index] = ray.t_min;
            bundle.limit.0[index] = ray.t_max;
        }
        // As in `Query::new` and `ShearedRay::new`, lane by lane.
        let [x, y, z] = bundle.axes;
        for group in 0..GROUPS {
            let direction = [0, 1, 2].map(|axis| load_group(&bundle.inverse[axis], group));
            let inverse = direction.map(|d| _mm256_div_ps(_mm256_set1_ps(1.0), d));
            store_group(&mut bundle.slope[0], group, _mm256_mul_ps(direction[x], inverse[z]));
            store_group(&mut bundle.slope[1], group, _mm256_mul_ps(direction[y], inverse[z]));
            (0..3).for_each(|axis| store_group(&mut bundle.inverse[axis], group, inverse[axis]));
        }
        bundle
    }

    #[inline(always)]
    fn keep<const ANY: bool>(&mut self, index: usize, hit: Hit) {
        self.limit.0[index] = if ANY { f32::NEG_INFINITY } else { hit.t };
        self.primitive.0[index] = f32::from_bits(hit.primitive);
    }

    /// One of the rays as it goes on alone.
    #[inline(always)]
    fn query(&self, index: usize) -> Query {
        let (ray, z) = (self.rays[index], self.axes[2]);
        let inverse = Vec3::new(self.inverse[0].0[index], self.inverse[1].0[index], self.inverse[2].0[index]);
        let shear = [self.slope[0].0[index], self.slope[1].0[index], inverse[z]];
        Query { ray, sheared: ShearedRay { origin: ray.origin, axes: self.axes, shear }, inverse }
    }
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
pub fn load_group(row: &Row, group: usize) -> __m256 {
    debug_assert!(group < GROUPS);
    // SAFETY: `group` counts to `GROUPS` in all callers, so that the 32 bytes read lie inside the row.
    unsafe { _mm256_loadu_ps(row.0.as_ptr().add(WIDTH * group)) }
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn store_group(row: &mut Row, group: usize, values: __m256) {
    debug_assert!(group < GROUPS);
    // SAFETY: as in `load_group`.
    unsafe { _mm256_storeu_ps(row.0.as_mut_ptr().add(WIDTH * group), values) };
}

/// Lowest and highest of one number over all rays.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn range(row: &Row) -> (f32, f32) {
    let (mut low, mut high) = (load_group(row, 0), load_group(row, 0));
    for group in 1..GROUPS {
        low = _mm256_min_ps(low, load_group(row, group));
        high = _mm256_max_ps(high, load_group(row, group));
    }
    // The highest of -x is the lowest of x with its sign turned.
    (-highest(_mm256_sub_ps(_mm256_setzero_ps(), low)), highest(high))
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn highest(values: __m256) -> f32 {
    let four = _mm_max_ps(_mm256_castps256_ps128(values), _mm256_extractf128_ps::<1>(values));
    let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
    _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps::<1>(two, two)))
}

impl Together {
    /// The common bounds, if the rays run close enough together.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,bmi2")]
    fn new(bundle: &Bundle) -> Option<Together> {
        let spread = |slope: &Row| {
            let (low, high) = range(slope);
            high - low
        };
        let mut together = Together::default();
        for axis in 0..3 {
            let (least, most) = range(&bundle.origin[axis]);
            let forward = bundle.rows[axis].0 == axis;
            (together.first[axis], together.last[axis]) = if forward { (most, least) } else { (least, most) };
            (together.low[axis], together.high[axis]) = range(&bundle.inverse[axis]);
        }
        together.t_min = range(&bundle.t_min).0;
        together.limit = range(&bundle.limit).1;
        let is_finite = (0..3).all(|axis| together.low[axis].is_finite() && together.high[axis].is_finite());
        (is_finite && bundle.slope.iter().all(|slope| spread(slope) <= MAX_SPREAD)).then_some(together)
    }
}

/// So few rays go on alone.
const FEW: u32 = 7;

/// What is put aside: a child, where the first ray enters it, and which rays do.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
struct Entry {
    key: Key,
    rays: u32,
}

/// The walk of all rays through the tree.
#[inline(always)]
fn walk<L: RayVector, const ANY: bool>(wide: &Wide, bundle: &mut Bundle) {
    let (mut current, mut rays) = (Child::ROOT, u32::MAX >> (RAYS - bundle.rays.len()));
    // SAFETY: as in `nearest`.
    match unsafe { Together::new(bundle) } {
        Some(together) => bundle.together = together,
        None => {
            go_alone::<L, ANY>(wide, bundle, current, rays);
            return;
        }
    }
    let mut stack = Stack::new();
    loop {
        let found = if rays.count_ones() <= FEW || (current.is_leaf() && current.has_spheres()) {
            go_alone::<L, ANY>(wide, bundle, current, rays)
        } else if current.is_leaf() {
            meet_leaf::<L, ANY>(wide, bundle, current, rays)
        } else {
            descend::<L>(wide, bundle, current, rays, &mut stack);
            false
        };
        if found {
            // SAFETY: as in `nearest`.
            bundle.together.limit = unsafe { range(&bundle.limit) }.1;
        }
        loop {
            let Some(entry) = stack.pop() else { return };
            if entry.key.t() <= bundle.together.limit * BOX_SLACK {
                (current, rays) = (entry.key.child(), entry.rays);
                break;
            }
        }
    }
}

/// Sends some rays through a subtree one by one; true if one hit something.
#[inline(always)]
fn go_alone<L: Lanes, const ANY: bool>(wide: &Wide, bundle: &mut Bundle, start: Child, mut rays: u32) -> bool {
    let mut found = false;
    while rays != 0 {
        let index = rays.trailing_zeros() as usize;
        rays &= rays - 1;
        let (t, primitive) = (bundle.limit.0[index], bundle.primitive.0[index].to_bits());
        let hit = if t < bundle.rays[index].t_max { Some(Hit { t, primitive }) } else { None };
        if ANY && hit.is_some() {
            // It has hit something already: its end lies before its start.
            continue;
        }
        let better = traverse::<L, ANY>(wide, &bundle.query(index), start, hit);
        if let Some(better) = better.filter(|&better| Some(better) != hit) {
            bundle.keep::<ANY>(index, better);
            found = true;
        }
    }
    found
}

/// Puts the children that any ray enters aside, the nearest on top.
#[inline(always)]
fn descend<L: RayVector>(wide: &Wide, bundle: &Bundle, index: Child, rays: u32, stack: &mut Stack<Entry>) {
    let node = &wide.nodes[index.0 as usize];
    let mut distances = Distances([0.0; WIDTH]);
    // SAFETY: as in `nearest`.
    let mut mask = unsafe { enter_together(node, bundle, &mut distances) };
    let floor = stack.height();
    while mask != 0 {
        let slot = (mask.trailing_zeros() & 7) as usize;
        mask &= mask - 1;
        let rays = enter_each::<L>(node, slot, bundle, rays);
        if rays != 0 {
            let child = node.children[slot];
            L::prefetch(wide, child);
            stack.insert(floor, Entry { key: Key::new(distances.0[slot], child), rays });
        }
    }
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn load8(row: &[f32; WIDTH]) -> __m256 {
    // SAFETY: the reference covers the 32 bytes read; no alignment is asked for.
    unsafe { _mm256_loadu_ps(row.as_ptr()) }
}

/// Children that some ray between the bundle's bounds may enter.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn enter_together(node: &Node, bundle: &Bundle, distances: &mut Distances) -> u32 {
    let together = &bundle.together;
    let mut near = _mm256_set1_ps(together.t_min);
    let mut far = _mm256_set1_ps(together.limit);
    for axis in 0..3 {
        let (row, opposite) = bundle.rows[axis];
        let (low, high) = (_mm256_set1_ps(together.low[axis]), _mm256_set1_ps(together.high[axis]));
        let a = _mm256_sub_ps(load8(&node.planes[row]), _mm256_set1_ps(together.first[axis]));
        let b = _mm256_sub_ps(load8(&node.planes[opposite]), _mm256_set1_ps(together.last[axis]));
        near = _mm256_max_ps(_mm256_min_ps(_mm256_mul_ps(a, low), _mm256_mul_ps(a, high)), near);
        far = _mm256_min_ps(_mm256_max_ps(_mm256_mul_ps(b, low), _mm256_mul_ps(b, high)), far);
    }
    // SAFETY: the array's 32 bytes are written, at the alignment of `Distances`.
    unsafe { _mm256_store_ps(distances.0.as_mut_ptr(), near) };
    let stretched = _mm256_mul_ps(far, _mm256_set1_ps(BOX_SLACK));
    _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, stretched)) as u32
}

/// Those of some rays that enter one child: for each ray the same test as alone.
#[inline(always)]
fn enter_each<L: RayVector>(node: &Node, slot: usize, bundle: &Bundle, rays: u32) -> u32 {
    let slack = L::splat(BOX_SLACK);
    let planes = bundle.rows.map(|(enter, leave)| (node.planes[enter][slot], node.planes[leave][slot]));
    let mut entering = 0;
    for group in (0..RAYS / L::N).filter(|group| in_group::<L>(rays, *group) != 0) {
        let (mut near, mut far) = (L::load(&bundle.t_min, group), L::load(&bundle.limit, group));
        for (axis, (enter, leave)) in planes.into_iter().enumerate() {
            let (origin, inverse) = (L::load(&bundle.origin[axis], group), L::load(&bundle.inverse[axis], group));
            near = L::max(L::mul(L::sub(L::splat(enter), origin), inverse), near);
            far = L::min(L::mul(L::sub(L::splat(leave), origin), inverse), far);
        }
        entering |= L::bits(L::less_or_equal(near, L::mul(far, slack))) << (L::N * group);
    }
    entering & rays
}

/// Those of `rays` in a group, from bit 0 on.
#[inline(always)]
fn in_group<L: RayVector>(rays: u32, group: usize) -> u32 {
    rays >> (L::N * group) & (u32::MAX >> (RAYS - L::N))
}

/// Tests a leaf's triangles by the groups of some rays; true if one was hit.
#[inline(always)]
fn meet_leaf<L: RayVector, const ANY: bool>(wide: &Wide, bundle: &mut Bundle, leaf: Child, rays: u32) -> bool {
    let mut found = false;
    for packet in &wide.packets[leaf.packets()] {
        for group in 0..RAYS / L::N {
            if in_group::<L>(rays, group) != 0 {
                found |= meet_packet::<L, ANY>(packet, bundle, group);
            }
        }
    }
    found
}

/// Writes down which rays of a group hit one of a packet's triangles better than before, and says whether one does.
///
/// The operations are those of [`Query::meet`], lane by lane. Rays that do not come near do no harm.
#[inline(always)]
fn meet_packet<L: RayVector, const ANY: bool>(packet: &Packet, bundle: &mut Bundle, group: usize) -> bool {
    let [x, y, z] = bundle.axes;
    let (slope_x, slope_y) = (L::load(&bundle.slope[0], group), L::load(&bundle.slope[1], group));
    let scale = L::load(&bundle.inverse[z], group);
    let (from_x, from_y) = (L::load(&bundle.origin[x], group), L::load(&bundle.origin[y], group));
    let from_z = L::load(&bundle.origin[z], group);
    let zero = L::splat(0.0);
    let mut sheared = [[zero; 3]; LANES];
    for (place, sheared) in sheared.iter_mut().enumerate().take(packet.n_corners as usize) {
        let depth = L::sub(L::splat(packet.corners[z][place]), from_z);
        let across = L::sub(L::splat(packet.corners[x][place]), from_x);
        let along = L::sub(L::splat(packet.corners[y][place]), from_y);
        *sheared = [L::sub(across, L::mul(slope_x, depth)), L::sub(along, L::mul(slope_y, depth)), L::mul(scale, depth)];
    }
    let mut found = false;
    let mut triangles = packet.is_triangle;
    while triangles != 0 {
        let lane = (triangles.trailing_zeros() & 15) as usize;
        triangles &= triangles - 1;
        let [a, b, c] = packet.places(lane);
        let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (sheared[a], sheared[b], sheared[c]);
        let u = L::sub(L::mul(cx, by), L::mul(cy, bx));
        let v = L::sub(L::mul(ax, cy), L::mul(ay, cx));
        let w = L::sub(L::mul(bx, ay), L::mul(by, ax));
        let has_negative = L::less(L::min(L::min(u, v), w), zero);
        let has_positive = L::less(zero, L::max(L::max(u, v), w));
        let outside = L::and(has_negative, has_positive);
        if L::bits(outside) == u32::MAX >> (RAYS - L::N) {
            continue;
        }
        let det = L::add(L::add(u, v), w);
        let scaled = L::add(L::add(L::mul(u, az), L::mul(v, bz)), L::mul(w, cz));
        let distance = settle::<L>(L::div(scaled, det), packet.triangle(lane), bundle, group);
        let (limit, best) = (L::load(&bundle.limit, group), L::load(&bundle.primitive, group));
        let primitive = L::splat(f32::from_bits(packet.primitives[lane]));
        let ties = L::and(L::equal(distance, limit), L::less(primitive, best));
        let is_better = L::and(L::or(L::less(distance, limit), ties), L::less(L::load(&bundle.t_min, group), distance));
        let is_zero = L::or(L::or(L::equal(u, zero), L::equal(v, zero)), L::equal(w, zero));
        let sure = L::and_not(L::and_not(is_better, outside), is_zero);
        if L::bits(sure) != 0 {
            let end = if ANY { L::splat(f32::NEG_INFINITY) } else { distance };
            L::store(&mut bundle.limit, group, L::select(sure, end, limit));
            L::store(&mut bundle.primitive, group, L::select(sure, primitive, best));
            found = true;
        }
        let unsure = L::and_not(is_zero, outside);
        if L::bits(unsure) != 0 {
            // A ray inside a wall's plane has many such triangles before it; their corners all lie on an axis, and none is met.
            let all = |a, b, c| L::and(L::and(L::equal(a, zero), L::equal(b, zero)), L::equal(c, zero));
            let unsure = L::and_not(unsure, L::or(all(ax, bx, cx), all(ay, by, cy)));
            found |= meet_unsure::<ANY>(bundle, packet, lane, L::bits(unsure) << (L::N * group));
        }
    }
    found
}

/// [`Query::settle`], lane by lane.
#[inline(always)]
fn settle<L: RayVector>(t: L::Vector, [a, b, c]: [Vec3; 3], bundle: &Bundle, group: usize) -> L::Vector {
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let mut enter = L::splat(f32::NEG_INFINITY);
    for axis in bundle.axes {
        let plane = if bundle.rows[axis].0 == axis { low[axis] } else { high[axis] };
        let slab = L::mul(L::sub(L::splat(plane), L::load(&bundle.origin[axis], group)), L::load(&bundle.inverse[axis], group));
        enter = L::max(slab, enter);
    }
    L::select(L::less(L::mul(t, L::splat(BOX_SLACK)), enter), enter, t)
}

/// Tests the rays of `unsure` one by one, with signs found in f64.
#[cold]
fn meet_unsure<const ANY: bool>(bundle: &mut Bundle, packet: &Packet, lane: usize, unsure: u32) -> bool {
    let mut found = false;
    let primitive = packet.primitives[lane];
    for index in (0..bundle.rays.len()).filter(|index| unsure >> index & 1 != 0) {
        let query = bundle.query(index);
        let Some(t) = query.meet(packet.triangle(lane), query.ray.t_max) else { continue };
        let (limit, best) = (bundle.limit.0[index], bundle.primitive.0[index].to_bits());
        if t < limit || (t == limit && primitive < best) {
            bundle.keep::<ANY>(index, Hit { t, primitive });
            found = true;
        }
    }
    found
}
