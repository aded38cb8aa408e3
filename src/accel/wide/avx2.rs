//! The vector operations by AVX2, for processors that have it.

#![allow(unsafe_code, reason = "vector loads from slices, and calls into functions compiled for AVX2 after asking for it")]

use std::arch::x86_64::*;

use super::kernel::{Distances, Lanes, Parameters, is_hidden, traverse};
use super::layout::{Child, LANES, Node, Packet, WIDTH};
use super::packet::{self, RayVector, Row};
use super::{Operations, Wide};
use crate::accel::KnownOccluders;
use crate::accel::query::{BOX_SLACK, Query};
use crate::geometry::{Hit, Ray};

/// True if the processor can run this file.
pub fn is_supported() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") && is_x86_feature_detected!("bmi2")
}

/// The nearest hit.
#[inline]
pub fn nearest(wide: &Wide, ray: &Ray) -> Option<Hit> {
    debug_assert!(wide.operations != Operations::Portable);
    // SAFETY: `Wide::operations`, on which the caller branches, is not `Portable` only if `is_supported` said so.
    unsafe { nearest_avx2(wide, ray) }
}

/// Whether there is a hit.
#[inline]
pub fn any(wide: &Wide, ray: &Ray) -> bool {
    debug_assert!(wide.operations != Operations::Portable);
    // SAFETY: as in `nearest`.
    unsafe { any_avx2(wide, ray) }
}

/// Whether there is a hit, those leaves first where hits are known.
#[inline]
pub fn any_as_known(wide: &Wide, ray: &Ray, known: &mut KnownOccluders) -> bool {
    debug_assert!(wide.operations != Operations::Portable);
    // SAFETY: as in `nearest`.
    unsafe { any_as_known_avx2(wide, ray, known) }
}

/// Nearest hits of a bundle's rays.
#[inline]
pub fn nearest_of(wide: &Wide, rays: &[Ray], hit: &mut impl FnMut(usize, Option<Hit>)) {
    assert!(wide.operations != Operations::Portable);
    // SAFETY: `Wide::operations` is not `Portable` only if `is_supported` said so.
    unsafe { nearest_of_avx2(wide, rays, hit) }
}

/// Whether there are hits of a bundle's rays.
#[inline]
pub fn any_of(wide: &Wide, rays: &[Ray], answer: &mut impl FnMut(usize, bool)) {
    assert!(wide.operations != Operations::Portable);
    // SAFETY: as in `nearest_of`.
    unsafe { any_of_avx2(wide, rays, answer) }
}

#[target_feature(enable = "avx2,bmi1,bmi2")]
fn nearest_of_avx2(wide: &Wide, rays: &[Ray], hit: &mut impl FnMut(usize, Option<Hit>)) {
    packet::nearest::<Avx2>(wide, rays, hit);
}

#[target_feature(enable = "avx2,bmi1,bmi2")]
fn any_of_avx2(wide: &Wide, rays: &[Ray], answer: &mut impl FnMut(usize, bool)) {
    packet::any::<Avx2>(wide, rays, answer);
}

// What is ready for the traversal stays in registers if it is made here.
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn nearest_avx2(wide: &Wide, ray: &Ray) -> Option<Hit> {
    traverse::<Avx2, false>(wide, &Query::new(ray)?, Child::ROOT, None)
}

#[target_feature(enable = "avx2,bmi1,bmi2")]
fn any_avx2(wide: &Wide, ray: &Ray) -> bool {
    Query::new(ray).is_some_and(|query| traverse::<Avx2, true>(wide, &query, Child::ROOT, None).is_some())
}

#[target_feature(enable = "avx2,bmi1,bmi2")]
fn any_as_known_avx2(wide: &Wide, ray: &Ray, known: &mut KnownOccluders) -> bool {
    Query::new(ray).is_some_and(|query| is_hidden::<Avx2>(wide, &query, known))
}

/// AVX2. Private to this file: only the functions above use it, which run with AVX2.
struct Avx2;

/// What box tests need of a ray. It is spread over the lanes where it is used: done once for all, the copies were slower.
pub struct BoxRay {
    origin: [f32; 3],
    inverse: [f32; 3],
    /// Rows of [`Node::planes`] through which the ray enters and leaves, in bytes from the first.
    rows: [(usize, usize); 3],
    t_min: f32,
    /// Axes along which the ray does not move.
    still: [bool; 3],
    /// True if there is such an axis.
    pub is_still: bool,
}

/// A ray over all lanes.
struct SpreadRay {
    boxes: BoxRay,
    /// Rows of a packet's corners, in the order of the shear.
    axes: [usize; 3],
    origin: [__m256; 3],
    inverse: [__m256; 3],
    shear: [__m256; 3],
    t_min: __m256,
}

impl Lanes for Avx2 {
    type Ray = SpreadRay;

    #[inline(always)]
    fn spread(query: &Query) -> SpreadRay {
        // SAFETY: reached only through the functions above, so AVX2 is there.
        unsafe { spread(query) }
    }

    #[inline(always)]
    fn enter(node: &Node, ray: &SpreadRay, limit: f32, distances: &mut Distances) -> u32 {
        // SAFETY: as in `spread`.
        unsafe { enter(node, &ray.boxes, limit, distances) }
    }

    #[inline(always)]
    fn meet(packet: &Packet, query: &Query, ray: &SpreadRay, limit: f32, t: &mut Parameters) -> u32 {
        // SAFETY: as in `spread`.
        unsafe { meet(packet, query, ray, limit, t) }
    }

    #[inline(always)]
    fn prefetch(wide: &Wide, child: Child) {
        prefetch(wide, child);
    }
}

/// Asks for the memory of a node or of a leaf's first packet.
#[inline(always)]
pub fn prefetch(wide: &Wide, child: Child) {
    if child.is_leaf() {
        let packet = wide.packets.as_ptr().wrapping_add(child.packets().start);
        prefetch_lines(packet.cast(), 5);
    } else {
        let node = wide.nodes.as_ptr().wrapping_add(child.0 as usize);
        prefetch_lines(node.cast(), 4);
    }
}

#[inline(always)]
fn prefetch_lines(start: *const i8, count: usize) {
    for line in 0..count {
        // SAFETY: a prefetch of any address has no effect but on the cache, by the processor's manual.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(64 * line)) };
    }
}

impl BoxRay {
    /// Of a ray.
    #[inline(always)]
    pub fn new(query: &Query) -> Self {
        let (origin, inverse) = (query.ray.origin, query.inverse);
        let rows = |axis: usize| {
            let (low, high) = (axis * size_of::<[f32; WIDTH]>(), (axis + 3) * size_of::<[f32; WIDTH]>());
            if inverse[axis] >= 0.0 { (low, high) } else { (high, low) }
        };
        let still = query.still();
        Self {
            origin: origin.to_array(),
            inverse: inverse.to_array(),
            rows: [rows(0), rows(1), rows(2)],
            t_min: query.ray.t_min,
            still,
            is_still: still[0] | still[1] | still[2],
        }
    }
}

impl RayVector for Avx2 {
    type Vector = __m256;
    type Mask = __m256;
    const N: usize = 8;

    #[inline(always)]
    fn splat(x: f32) -> Self::Vector {
        // SAFETY: as in `spread`.
        unsafe { _mm256_set1_ps(x) }
    }

    #[inline(always)]
    fn load(row: &Row, group: usize) -> Self::Vector {
        // SAFETY: the slice covers what is read, and rows are aligned; and as in `spread`.
        unsafe { _mm256_load_ps(row.0[8 * group..][..8].as_ptr()) }
    }

    #[inline(always)]
    fn store(row: &mut Row, group: usize, values: Self::Vector) {
        // SAFETY: the slice covers what is written, and rows are aligned; and as in `spread`.
        unsafe { _mm256_store_ps(row.0[8 * group..][..8].as_mut_ptr(), values) }
    }

    #[inline(always)]
    fn add(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `spread`.
        unsafe { _mm256_add_ps(a, b) }
    }

    #[inline(always)]
    fn sub(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `spread`.
        unsafe { _mm256_sub_ps(a, b) }
    }

    #[inline(always)]
    fn mul(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `spread`.
        unsafe { _mm256_mul_ps(a, b) }
    }

    #[inline(always)]
    fn div(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `spread`.
        unsafe { _mm256_div_ps(a, b) }
    }

    #[inline(always)]
    fn min(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `spread`.
        unsafe { _mm256_min_ps(a, b) }
    }

    #[inline(always)]
    fn max(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `spread`.
        unsafe { _mm256_max_ps(a, b) }
    }

    #[inline(always)]
    fn less(a: Self::Vector, b: Self::Vector) -> Self::Mask {
        // SAFETY: as in `spread`.
        unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(a, b) }
    }

    #[inline(always)]
    fn less_or_equal(a: Self::Vector, b: Self::Vector) -> Self::Mask {
        // SAFETY: as in `spread`.
        unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(a, b) }
    }

    #[inline(always)]
    fn equal(a: Self::Vector, b: Self::Vector) -> Self::Mask {
        // SAFETY: as in `spread`.
        unsafe { _mm256_cmp_ps::<_CMP_EQ_OQ>(a, b) }
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        // SAFETY: as in `spread`.
        unsafe { _mm256_and_ps(a, b) }
    }

    #[inline(always)]
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        // SAFETY: as in `spread`.
        unsafe { _mm256_or_ps(a, b) }
    }

    #[inline(always)]
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        // SAFETY: as in `spread`.
        unsafe { _mm256_andnot_ps(b, a) }
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        // SAFETY: as in `spread`.
        unsafe { _mm256_movemask_ps(mask) as u32 }
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self::Vector, no: Self::Vector) -> Self::Vector {
        // SAFETY: as in `spread`.
        unsafe { _mm256_blendv_ps(no, yes, mask) }
    }
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn spread(query: &Query) -> SpreadRay {
    let (ray, sheared) = (&query.ray, &query.sheared);
    SpreadRay {
        boxes: BoxRay::new(query),
        axes: sheared.axes,
        origin: sheared.axes.map(|axis| _mm256_set1_ps(ray.origin[axis])),
        inverse: sheared.axes.map(|axis| _mm256_set1_ps(query.inverse[axis])),
        shear: sheared.shear.map(|x| _mm256_set1_ps(x)),
        t_min: _mm256_set1_ps(ray.t_min),
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
pub fn enter(node: &Node, ray: &BoxRay, limit: f32, distances: &mut Distances) -> u32 {
    let mut near = _mm256_set1_ps(ray.t_min);
    let mut far = _mm256_set1_ps(limit);
    for axis in 0..3 {
        let (enter, leave) = ray.rows[axis];
        debug_assert!(enter < 6 * size_of::<[f32; WIDTH]>() && leave < 6 * size_of::<[f32; WIDTH]>());
        let planes = std::ptr::from_ref(&node.planes).cast::<f32>();
        // SAFETY: `BoxRay::new` makes all offsets those of one of the six rows.
        let (enter, leave) = unsafe { (_mm256_load_ps(planes.byte_add(enter)), _mm256_load_ps(planes.byte_add(leave))) };
        let (origin, inverse) = (_mm256_set1_ps(ray.origin[axis]), _mm256_set1_ps(ray.inverse[axis]));
        let a = _mm256_mul_ps(_mm256_sub_ps(enter, origin), inverse);
        let b = _mm256_mul_ps(_mm256_sub_ps(leave, origin), inverse);
        // Where one operand is a NaN these give the second one, so that the slab does not count.
        near = _mm256_max_ps(a, near);
        far = _mm256_min_ps(b, far);
    }
    // SAFETY: the array's 32 bytes are written, at the alignment of `Distances`.
    unsafe { _mm256_store_ps(distances.0.as_mut_ptr(), near) };
    let stretched = _mm256_mul_ps(far, _mm256_set1_ps(BOX_SLACK));
    let mask = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, stretched)) as u32;
    if ray.is_still { mask & !holding_ray(node, ray) } else { mask }
}

/// Children whose boxes are flat and hold the ray in their plane; see [`Query::still`].
#[cold]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn holding_ray(node: &Node, ray: &BoxRay) -> u32 {
    let at = |row: usize, axis: usize| _mm256_cmp_ps::<_CMP_EQ_OQ>(load8(&node.planes[row]), _mm256_set1_ps(ray.origin[axis]));
    let of = |axis: usize| _mm256_movemask_ps(_mm256_and_ps(at(axis, axis), at(axis + 3, axis))) as u32;
    (0..3).filter(|&axis| ray.still[axis]).fold(0, |mask, axis| mask | of(axis))
}

/// Eight corners of a packet: moved to the ray's origin, and sheared. In the order of the shear.
struct Corners {
    moved: [__m256; 3],
    sheared: [__m256; 3],
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn move_and_shear(packet: &Packet, first: usize, ray: &SpreadRay) -> Corners {
    let row = |i: usize| {
        debug_assert!(ray.axes[i] < 3 && first + 8 <= LANES);
        // SAFETY: `axes` is a permutation of 0, 1, 2 and `first` is 0 or 8, so that the 32 bytes read lie inside the row.
        unsafe { _mm256_loadu_ps(packet.corners.get_unchecked(ray.axes[i]).as_ptr().add(first)) }
    };
    let [x, y, z] = [0, 1, 2].map(|i| _mm256_sub_ps(row(i), ray.origin[i]));
    let sheared_x = _mm256_sub_ps(x, _mm256_mul_ps(ray.shear[0], z));
    let sheared_y = _mm256_sub_ps(y, _mm256_mul_ps(ray.shear[1], z));
    Corners { moved: [x, y, z], sheared: [sheared_x, sheared_y, _mm256_mul_ps(ray.shear[2], z)] }
}

/// For eight triangles the value at one of their corners, of two times eight values at places in the lowest four bits of `places`.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn pick(places: __m256i, low: __m256, high: __m256) -> __m256 {
    let is_high = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(places));
    _mm256_blendv_ps(_mm256_permutevar8x32_ps(low, places), _mm256_permutevar8x32_ps(high, places), is_high)
}

/// `a b - c d`, each product rounded: not to be fused.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn difference(a: __m256, b: __m256, c: __m256, d: __m256) -> __m256 {
    _mm256_sub_ps(_mm256_mul_ps(a, b), _mm256_mul_ps(c, d))
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn meet(packet: &Packet, query: &Query, ray: &SpreadRay, limit: f32, t: &mut Parameters) -> u32 {
    let corners = [move_and_shear(packet, 0, ray), move_and_shear(packet, 8, ray)];
    let mut met = meet_eight(packet, 0, &corners, query, ray, limit, t);
    if packet.is_triangle > 0xff {
        met |= meet_eight(packet, 8, &corners, query, ray, limit, t);
    }
    met
}

/// Tests eight triangles from lane `first` on.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn meet_eight(
    packet: &Packet,
    first: usize,
    [low, high]: &[Corners; 2],
    query: &Query,
    ray: &SpreadRay,
    limit: f32,
    t: &mut Parameters,
) -> u32 {
    debug_assert!(first + 8 <= LANES);
    // SAFETY: `first` is 0 or 8, so that the 16 bytes read lie inside the array.
    let places = unsafe { _mm_loadu_si128(packet.triangles.as_ptr().add(first).cast()) };
    let places = _mm256_cvtepu16_epi32(places);
    let places = [places, _mm256_srli_epi32::<4>(places), _mm256_srli_epi32::<8>(places)];
    let [ax, bx, cx] = places.map(|places| pick(places, low.sheared[0], high.sheared[0]));
    let [ay, by, cy] = places.map(|places| pick(places, low.sheared[1], high.sheared[1]));
    let u = difference(cx, by, cy, bx);
    let v = difference(ax, cy, ay, cx);
    let w = difference(bx, ay, by, ax);
    let zero = _mm256_setzero_ps();
    let has_negative = _mm256_cmp_ps::<_CMP_LT_OQ>(_mm256_min_ps(_mm256_min_ps(u, v), w), zero);
    let has_positive = _mm256_cmp_ps::<_CMP_GT_OQ>(_mm256_max_ps(_mm256_max_ps(u, v), w), zero);
    let outside = _mm256_movemask_ps(_mm256_and_ps(has_negative, has_positive)) as u32;
    let inside = !outside & u32::from(packet.is_triangle) >> first & 0xff;
    if inside == 0 {
        return 0;
    }
    let det = _mm256_add_ps(_mm256_add_ps(u, v), w);
    let [az, bz, cz] = places.map(|places| pick(places, low.sheared[2], high.sheared[2]));
    let scaled = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(u, az), _mm256_mul_ps(v, bz)), _mm256_mul_ps(w, cz));
    let distance = _mm256_div_ps(scaled, det);
    let wide_limit = _mm256_set1_ps(limit);
    let in_interval =
        _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(distance, ray.t_min), _mm256_cmp_ps::<_CMP_LT_OQ>(distance, wide_limit));
    let equals_zero = |x| _mm256_cmp_ps::<_CMP_EQ_OQ>(x, zero);
    let is_zero = _mm256_movemask_ps(_mm256_or_ps(_mm256_or_ps(equals_zero(u), equals_zero(v)), equals_zero(w))) as u32;
    let mut unsure = inside & is_zero;
    let mut met = inside & !is_zero & _mm256_movemask_ps(in_interval) as u32;
    if met | unsure == 0 {
        return 0;
    }
    // `Query::settle`: the least of the products is that of the plane entered through, as their rounding is monotonic.
    let mut enter = _mm256_set1_ps(f32::NEG_INFINITY);
    for i in 0..3 {
        let (low, high) = (_mm256_mul_ps(low.moved[i], ray.inverse[i]), _mm256_mul_ps(high.moved[i], ray.inverse[i]));
        let [a, b, c] = places.map(|places| pick(places, low, high));
        enter = _mm256_max_ps(_mm256_min_ps(_mm256_min_ps(a, b), c), enter);
    }
    let is_before = _mm256_cmp_ps::<_CMP_GT_OQ>(enter, _mm256_mul_ps(distance, _mm256_set1_ps(BOX_SLACK)));
    let settled = _mm256_blendv_ps(distance, enter, is_before);
    // With an infinite inverse a product may be a NaN: such rays are tested one by one below.
    if !ray.boxes.is_still {
        met &= _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(settled, wide_limit)) as u32;
    }
    // SAFETY: `first` is 0 or 8, so that the 32 bytes written lie inside the array; no alignment is asked for.
    unsafe { _mm256_storeu_ps(t.0.as_mut_ptr().add(first), settled) };
    if unsure != 0 {
        // A ray inside a wall's plane has many such triangles before it; their corners all lie on an axis, and none is met.
        let all = |a, b, c| equals_zero(_mm256_or_ps(_mm256_or_ps(a, b), c));
        let edge_on = _mm256_or_ps(all(ax, bx, cx), all(ay, by, cy));
        unsure &= !_mm256_movemask_ps(edge_on) as u32;
    }
    let alone = if ray.boxes.is_still { met | unsure } else { unsure };
    let met = met << first;
    if alone == 0 { met } else { met & !(alone << first) | meet_alone(packet, query, alone << first, limit, t) }
}

/// Some lanes one by one: where an edge function is zero, or for a ray along an axis.
#[cold]
pub fn meet_alone(packet: &Packet, query: &Query, alone: u32, limit: f32, t: &mut Parameters) -> u32 {
    let mut met = 0;
    for lane in (0..LANES).filter(|lane| alone >> lane & 1 != 0) {
        if let Some(hit) = query.meet(packet.triangle(lane), limit) {
            t.0[lane] = hit;
            met |= 1 << lane;
        }
    }
    met
}
