//! Thirty-two alike rays at once: one walk through the tree for all of them, by AVX2.
//!
//! A node's children are first tested against bounds of all rays together (interval arithmetic, as in [Boulos06]), then those that
//! remain against eight rays at a time; a leaf's triangles are tested by eight rays at a time too. Where only few rays are left
//! in a subtree, they go on alone. Each ray does the same f32 operations as alone and so gets the same answer.

#![allow(unsafe_code, reason = "vector loads and stores, and calls into functions compiled for AVX2 after asking for it")]

use std::arch::x86_64::*;

use super::kernel::{Distances, Key, Stack};
use super::layout::{Child, LANES, Node, Packet, WIDTH};
use super::{Wide, avx2};
use crate::accel::query::{BOX_SLACK, Query};
use crate::geometry::soup::Primitive;
use crate::geometry::triangle::ShearedRay;
use crate::geometry::{Hit, Ray};
use crate::math::Vec3;

/// Groups of eight rays in a bundle.
const GROUPS: usize = 4;
/// Rays in a bundle.
pub const RAYS: usize = GROUPS * WIDTH;

/// Eight values, one a ray.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Eight([f32; WIDTH]);

/// Rays side by side.
struct Bundle<'a> {
    rays: &'a [Ray],
    groups: [Group; GROUPS],
    together: Together,
    /// Rows of [`Node::planes`] through which all rays enter.
    enter: [usize; 3],
    /// Order of coordinates in the shear, the same for all rays.
    axes: [usize; 3],
}

/// Eight rays.
#[derive(Clone, Copy)]
struct Group {
    origin: [Eight; 3],
    inverse: [Eight; 3],
    shear: [Eight; 3],
    t_min: Eight,
    /// Where each ray ends: at `t_max`, at the best hit, or before all if it wants no more.
    limit: Eight,
    /// Primitive of the best hit; 0 while there is none, so that nothing at `t_max` itself counts.
    primitive: [u32; WIDTH],
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

/// Nearest hits of up to [`RAYS`] [usable](crate::accel::query::usable) rays that share the sign of each direction component and
/// the largest one.
pub fn nearest(wide: &Wide, rays: &[Ray], mut hit: impl FnMut(usize, Option<Hit>)) {
    assert!(wide.use_avx2 && !rays.is_empty() && rays.len() <= RAYS);
    // SAFETY: `Wide::use_avx2` is true only if the processor has AVX2.
    let mut bundle = unsafe { Bundle::new(rays) };
    // SAFETY: as above.
    unsafe { walk::<false>(wide, &mut bundle) };
    for (index, ray) in rays.iter().enumerate() {
        let group = &bundle.groups[index / WIDTH];
        let (t, primitive) = (group.limit.0[index % WIDTH], group.primitive[index % WIDTH]);
        hit(index, (t < ray.t_max).then_some(Hit { t, primitive }));
    }
}

/// Occlusion of such rays.
pub fn any(wide: &Wide, rays: &[Ray], mut answer: impl FnMut(usize, bool)) {
    assert!(wide.use_avx2 && !rays.is_empty() && rays.len() <= RAYS);
    // SAFETY: as in `nearest`.
    let mut bundle = unsafe { Bundle::new(rays) };
    // SAFETY: as in `nearest`.
    unsafe { walk::<true>(wide, &mut bundle) };
    for index in 0..rays.len() {
        answer(index, bundle.groups[index / WIDTH].limit.0[index % WIDTH] == f32::NEG_INFINITY);
    }
}

/// Widest spread of directions, as a slope, at which bundles were faster than single rays.
const MAX_SPREAD: f32 = 1.0;

impl<'a> Bundle<'a> {
    #[inline]
    #[target_feature(enable = "avx2,bmi1,bmi2")]
    fn new(rays: &'a [Ray]) -> Self {
        let first = &rays[0];
        let axes = ShearedRay::new(first).axes;
        let enter = [0, 1, 2].map(|axis| if first.direction[axis].is_sign_positive() { axis } else { axis + 3 });
        let spread = |v: Vec3| v.to_array().map(|x| Eight([x; WIDTH]));
        // A lane without a ray has the first one's numbers, but ends before it starts. The directions stay in `inverse` until they
        // are inverted.
        let empty = Group {
            origin: spread(first.origin),
            inverse: spread(first.direction),
            shear: [Eight([0.0; WIDTH]); 3],
            t_min: Eight([first.t_min; WIDTH]),
            limit: Eight([f32::NEG_INFINITY; WIDTH]),
            primitive: [0; WIDTH],
        };
        let mut groups = [empty; GROUPS];
        for (index, ray) in rays.iter().enumerate() {
            let (group, lane) = (&mut groups[index / WIDTH], index % WIDTH);
            for axis in 0..3 {
                group.origin[axis].0[lane] = ray.origin[axis];
                group.inverse[axis].0[lane] = ray.direction[axis];
            }
            group.t_min.0[lane] = ray.t_min;
            group.limit.0[lane] = ray.t_max;
        }
        // The operations of `ShearedRay::new` and `Query::new`, lane by lane.
        for group in &mut groups {
            let direction = [0, 1, 2].map(|axis| load8(&group.inverse[axis].0));
            let inverse = direction.map(|d| _mm256_div_ps(_mm256_set1_ps(1.0), d));
            let [x, y, z] = axes;
            let shear = [_mm256_mul_ps(direction[x], inverse[z]), _mm256_mul_ps(direction[y], inverse[z]), inverse[z]];
            for i in 0..3 {
                store8(&mut group.inverse[i], inverse[i]);
                store8(&mut group.shear[i], shear[i]);
            }
        }
        Self { rays, groups, together: Together::default(), enter, axes }
    }

    /// One of the rays as it goes on alone.
    #[inline]
    fn query(&self, index: usize) -> Query {
        let (ray, group, lane) = (self.rays[index], &self.groups[index / WIDTH], index % WIDTH);
        let shear = [0, 1, 2].map(|i| group.shear[i].0[lane]);
        let inverse = Vec3::from_array([0, 1, 2].map(|axis| group.inverse[axis].0[lane]));
        Query { ray, sheared: ShearedRay { origin: ray.origin, axes: self.axes, shear }, inverse }
    }
}

/// Lowest and highest of one number over all rays.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn range(groups: &[Group; GROUPS], of: impl Fn(&Group) -> &Eight) -> (f32, f32) {
    let values = [0, 1, 2, 3].map(|index| load8(&of(&groups[index]).0));
    let low = _mm256_min_ps(_mm256_min_ps(values[0], values[1]), _mm256_min_ps(values[2], values[3]));
    let high = _mm256_max_ps(_mm256_max_ps(values[0], values[1]), _mm256_max_ps(values[2], values[3]));
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
        let groups = &bundle.groups;
        let spread = |i: usize| {
            let (low, high) = range(groups, |group| &group.shear[i]);
            high - low
        };
        let mut together = Together::default();
        for axis in 0..3 {
            let (least, most) = range(groups, |group| &group.origin[axis]);
            let forward = bundle.enter[axis] == axis;
            (together.first[axis], together.last[axis]) = if forward { (most, least) } else { (least, most) };
            (together.low[axis], together.high[axis]) = range(groups, |group| &group.inverse[axis]);
        }
        together.t_min = range(groups, |group| &group.t_min).0;
        together.limit = range(groups, |group| &group.limit).1;
        let is_finite = (0..3).all(|axis| together.low[axis].is_finite() && together.high[axis].is_finite());
        (is_finite && spread(0) <= MAX_SPREAD && spread(1) <= MAX_SPREAD).then_some(together)
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
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn walk<const ANY: bool>(wide: &Wide, bundle: &mut Bundle) {
    let (mut current, mut rays) = (Child::ROOT, u32::MAX >> (RAYS - bundle.rays.len()));
    match Together::new(bundle) {
        Some(together) => bundle.together = together,
        None => {
            go_alone::<ANY>(wide, bundle, current, rays);
            return;
        }
    }
    let mut stack = Stack::new();
    loop {
        let found = if rays.count_ones() <= FEW {
            go_alone::<ANY>(wide, bundle, current, rays)
        } else if current.is_leaf() {
            meet_leaf::<ANY>(wide, bundle, current, rays)
        } else {
            descend(wide, bundle, current, rays, &mut stack);
            false
        };
        if found {
            bundle.together.limit = range(&bundle.groups, |group| &group.limit).1;
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
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn go_alone<const ANY: bool>(wide: &Wide, bundle: &mut Bundle, start: Child, mut rays: u32) -> bool {
    let mut found = false;
    while rays != 0 {
        let index = rays.trailing_zeros() as usize;
        rays &= rays - 1;
        let (group, ray) = (&bundle.groups[index / WIDTH], index % WIDTH);
        let (t, primitive) = (group.limit.0[ray], group.primitive[ray]);
        let hit = if t < bundle.rays[index].t_max { Some(Hit { t, primitive }) } else { None };
        if ANY && hit.is_some() {
            // It has hit something already: its end lies before its start.
            continue;
        }
        let query = bundle.query(index);
        let group = &mut bundle.groups[index / WIDTH];
        if ANY {
            if avx2::any(wide, &query, start) {
                group.keep::<ANY>(ray, Hit { t, primitive });
                found = true;
            }
        } else if let Some(better) = avx2::nearest(wide, &query, start, hit).filter(|&better| Some(better) != hit) {
            group.keep::<ANY>(ray, better);
            found = true;
        }
    }
    found
}

/// Puts the children that any ray enters aside, the nearest on top.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn descend(wide: &Wide, bundle: &Bundle, index: Child, rays: u32, stack: &mut Stack<Entry>) {
    let node = &wide.nodes[index.0 as usize];
    let mut distances = Distances([0.0; WIDTH]);
    let mut mask = enter_together(node, bundle, &mut distances);
    let floor = stack.height();
    while mask != 0 {
        let slot = (mask.trailing_zeros() & 7) as usize;
        mask &= mask - 1;
        let rays = enter_each(node, slot, bundle, rays);
        if rays != 0 {
            let child = node.children[slot];
            avx2::prefetch(wide, child);
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

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn store8(row: &mut Eight, values: __m256) {
    // SAFETY: the array's 32 bytes are written, at the alignment of `Eight`.
    unsafe { _mm256_store_ps(row.0.as_mut_ptr(), values) };
}

/// Children that some ray between the bundle's bounds may enter.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn enter_together(node: &Node, bundle: &Bundle, distances: &mut Distances) -> u32 {
    let together = &bundle.together;
    let mut near = _mm256_set1_ps(together.t_min);
    let mut far = _mm256_set1_ps(together.limit);
    for axis in 0..3 {
        let row = bundle.enter[axis] % 6;
        let opposite = if row >= 3 { row - 3 } else { row + 3 };
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
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn enter_each(node: &Node, slot: usize, bundle: &Bundle, rays: u32) -> u32 {
    let slack = _mm256_set1_ps(BOX_SLACK);
    let planes = [0, 1, 2].map(|axis| {
        let row = bundle.enter[axis] % 6;
        let opposite = if row >= 3 { row - 3 } else { row + 3 };
        (_mm256_set1_ps(node.planes[row][slot]), _mm256_set1_ps(node.planes[opposite][slot]))
    });
    let mut entering = 0;
    for (index, group) in bundle.groups.iter().enumerate().filter(|&(index, _)| rays >> (WIDTH * index) & 0xff != 0) {
        let (mut near, mut far) = (load8(&group.t_min.0), load8(&group.limit.0));
        for (axis, (enter, leave)) in planes.into_iter().enumerate() {
            let (origin, inverse) = (load8(&group.origin[axis].0), load8(&group.inverse[axis].0));
            near = _mm256_max_ps(_mm256_mul_ps(_mm256_sub_ps(enter, origin), inverse), near);
            far = _mm256_min_ps(_mm256_mul_ps(_mm256_sub_ps(leave, origin), inverse), far);
        }
        let enters = _mm256_cmp_ps::<_CMP_LE_OQ>(near, _mm256_mul_ps(far, slack));
        entering |= (_mm256_movemask_ps(enters) as u32) << (WIDTH * index);
    }
    entering & rays
}

/// Tests a leaf's primitives by the groups of some rays; true if one was hit.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn meet_leaf<const ANY: bool>(wide: &Wide, bundle: &mut Bundle, leaf: Child, rays: u32) -> bool {
    let mut found = false;
    for packet in &wide.packets[leaf.packets()] {
        for lane in (0..LANES).take_while(|&lane| packet.primitives[lane] != Packet::NOTHING) {
            let corners = [0, 1, 2].map(|corner| bundle.axes.map(|axis| _mm256_set1_ps(packet.corners[corner][axis][lane])));
            for index in (0..GROUPS).filter(|index| rays >> (WIDTH * index) & 0xff != 0) {
                let (is_hit, unsure) = meet::<ANY>(&corners, bundle, index, packet.primitives[lane]);
                found |= is_hit;
                if unsure != 0 {
                    found |= meet_unsure::<ANY>(bundle, index, packet, lane, unsure);
                }
            }
        }
        if leaf.has_spheres() {
            found |= meet_spheres::<ANY>(wide, bundle, packet, rays);
        }
    }
    found
}

/// Writes down which rays of a group hit a triangle better than before, and says whether one does; and the rays with an edge
/// function of zero.
///
/// The operations are those of [`Query::meet`], lane by lane.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn meet<const ANY: bool>(corners: &[[__m256; 3]; 3], bundle: &mut Bundle, index: usize, primitive: u32) -> (bool, u32) {
    let group = &bundle.groups[index];
    let origin = bundle.axes.map(|axis| load8(&group.origin[axis].0));
    let shear = [0, 1, 2].map(|i| load8(&group.shear[i].0));
    let project = |corner: &[__m256; 3]| {
        let [x, y, z] = [0, 1, 2].map(|i| _mm256_sub_ps(corner[i], origin[i]));
        (_mm256_sub_ps(x, _mm256_mul_ps(shear[0], z)), _mm256_sub_ps(y, _mm256_mul_ps(shear[1], z)), z)
    };
    let difference = |a, b, c, d| _mm256_sub_ps(_mm256_mul_ps(a, b), _mm256_mul_ps(c, d));
    let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (project(&corners[0]), project(&corners[1]), project(&corners[2]));
    let (u, v, w) = (difference(cx, by, cy, bx), difference(ax, cy, ay, cx), difference(bx, ay, by, ax));
    let zero = _mm256_setzero_ps();
    let has_negative = _mm256_cmp_ps::<_CMP_LT_OQ>(_mm256_min_ps(_mm256_min_ps(u, v), w), zero);
    let has_positive = _mm256_cmp_ps::<_CMP_GT_OQ>(_mm256_max_ps(_mm256_max_ps(u, v), w), zero);
    let outside = _mm256_and_ps(has_negative, has_positive);
    if _mm256_movemask_ps(outside) == 0xff {
        return (false, 0);
    }
    let det = _mm256_add_ps(_mm256_add_ps(u, v), w);
    let [az, bz, cz] = [az, bz, cz].map(|z| _mm256_mul_ps(shear[2], z));
    let scaled = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(u, az), _mm256_mul_ps(v, bz)), _mm256_mul_ps(w, cz));
    let distance = settle(_mm256_div_ps(scaled, det), corners, bundle, index);
    let group = &mut bundle.groups[index];
    let limit = load8(&group.limit.0);
    // SAFETY: the reference covers the 32 bytes read; no alignment is asked for.
    let best = unsafe { _mm256_loadu_si256(group.primitive.as_ptr().cast()) };
    let primitive = _mm256_set1_epi32(primitive as i32);
    let is_lower = _mm256_castsi256_ps(_mm256_cmpgt_epi32(best, primitive));
    let ties = _mm256_and_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(distance, limit), is_lower);
    let nearer = _mm256_or_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(distance, limit), ties);
    let in_interval = _mm256_and_ps(nearer, _mm256_cmp_ps::<_CMP_GT_OQ>(distance, load8(&group.t_min.0)));
    let equals_zero = |x| _mm256_cmp_ps::<_CMP_EQ_OQ>(x, zero);
    let is_zero = _mm256_or_ps(_mm256_or_ps(equals_zero(u), equals_zero(v)), equals_zero(w));
    let sure = _mm256_andnot_ps(_mm256_or_ps(outside, is_zero), in_interval);
    // A ray inside a wall's plane has many such triangles before it; their corners all lie on an axis, and none is met.
    let (x, y) = (_mm256_or_ps(_mm256_or_ps(ax, bx), cx), _mm256_or_ps(_mm256_or_ps(ay, by), cy));
    let dismissed = _mm256_or_ps(outside, _mm256_or_ps(equals_zero(x), equals_zero(y)));
    let unsure = _mm256_movemask_ps(_mm256_andnot_ps(dismissed, is_zero)) as u32;
    let is_hit = _mm256_movemask_ps(sure) != 0;
    if is_hit {
        let end = if ANY { _mm256_set1_ps(f32::NEG_INFINITY) } else { distance };
        // SAFETY: the array's 32 bytes are written, at the alignment of `Eight`.
        unsafe { _mm256_store_ps(group.limit.0.as_mut_ptr(), _mm256_blendv_ps(limit, end, sure)) };
        let kept = _mm256_blendv_epi8(best, primitive, _mm256_castps_si256(sure));
        // SAFETY: the array's 32 bytes are written; no alignment is asked for.
        unsafe { _mm256_storeu_si256(group.primitive.as_mut_ptr().cast(), kept) };
    }
    (is_hit, unsure)
}

/// [`Query::settle`], lane by lane.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn settle(t: __m256, [a, b, c]: &[[__m256; 3]; 3], bundle: &Bundle, index: usize) -> __m256 {
    let group = &bundle.groups[index];
    let mut enter = _mm256_set1_ps(f32::NEG_INFINITY);
    for (i, axis) in bundle.axes.into_iter().enumerate() {
        let plane = if bundle.enter[axis] == axis {
            _mm256_min_ps(_mm256_min_ps(a[i], b[i]), c[i])
        } else {
            _mm256_max_ps(_mm256_max_ps(a[i], b[i]), c[i])
        };
        let slab = _mm256_mul_ps(_mm256_sub_ps(plane, load8(&group.origin[axis].0)), load8(&group.inverse[axis].0));
        enter = _mm256_max_ps(slab, enter);
    }
    let is_before = _mm256_cmp_ps::<_CMP_GT_OQ>(enter, _mm256_mul_ps(t, _mm256_set1_ps(BOX_SLACK)));
    _mm256_blendv_ps(t, enter, is_before)
}

/// Tests the rays of `unsure` one by one in f64.
#[cold]
fn meet_unsure<const ANY: bool>(bundle: &mut Bundle, index: usize, packet: &Packet, lane: usize, unsure: u32) -> bool {
    let mut found = false;
    let primitive = packet.primitives[lane];
    for ray in (0..WIDTH).filter(|ray| unsure >> ray & 1 != 0) {
        if index * WIDTH + ray >= bundle.rays.len() {
            continue;
        }
        let query = bundle.query(index * WIDTH + ray);
        if let Some(t) = query.meet(packet.triangle(lane), query.ray.t_max) {
            found |= bundle.groups[index].offer::<ANY>(ray, Hit { t, primitive });
        }
    }
    found
}

impl Group {
    #[inline]
    fn keep<const ANY: bool>(&mut self, ray: usize, hit: Hit) {
        self.limit.0[ray] = if ANY { f32::NEG_INFINITY } else { hit.t };
        self.primitive[ray] = hit.primitive;
    }

    /// Keeps a hit if it is better than the best so far.
    fn offer<const ANY: bool>(&mut self, ray: usize, hit: Hit) -> bool {
        let limit = self.limit.0[ray];
        let is_better = hit.t < limit || (hit.t == limit && hit.primitive < self.primitive[ray]);
        if is_better {
            self.keep::<ANY>(ray, hit);
        }
        is_better
    }
}

/// Spheres are rare: one ray and one sphere at a time.
#[cold]
fn meet_spheres<const ANY: bool>(wide: &Wide, bundle: &mut Bundle, packet: &Packet, rays: u32) -> bool {
    let mut found = false;
    for primitive in packet.primitives.into_iter().filter(|&p| p != Packet::NOTHING) {
        let Primitive::Sphere(sphere) = wide.soup.primitive(primitive) else { continue };
        for (index, ray) in bundle.rays.iter().enumerate().filter(|(i, _)| rays >> i & 1 != 0) {
            if let Some(t) = sphere.intersect(ray, ray.t_min, ray.t_max) {
                found |= bundle.groups[index / WIDTH].offer::<ANY>(index % WIDTH, Hit { t, primitive });
            }
        }
    }
    found
}
