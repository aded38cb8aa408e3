//! The vector operations by AVX2, for processors that have it.

#![allow(unsafe_code, reason = "vector loads from slices, and calls into functions compiled for AVX2 after asking for it")]

use std::arch::x86_64::*;

use super::Wide;
use super::kernel::{Distances, Lanes, traverse};
use super::layout::{Child, LANES, Node, Packet, WIDTH};
use crate::accel::query::{BOX_SLACK, Query};
use crate::geometry::Hit;

/// True if the processor can run this file.
pub fn is_supported() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") && is_x86_feature_detected!("bmi2")
}

/// Nearest hit below `start`, or `best` if there is none better.
#[inline]
pub fn nearest(wide: &Wide, query: &Query, start: Child, best: Option<Hit>) -> Option<Hit> {
    debug_assert!(wide.use_avx2);
    // SAFETY: `Wide::use_avx2`, on which the caller branches, is true only if `is_supported` said so.
    unsafe { nearest_avx2(wide, query, start, best) }
}

/// Any hit below `start`.
#[inline]
pub fn any(wide: &Wide, query: &Query, start: Child) -> bool {
    debug_assert!(wide.use_avx2);
    // SAFETY: as in `nearest`.
    unsafe { any_avx2(wide, query, start) }
}

#[target_feature(enable = "avx2,bmi1,bmi2")]
fn nearest_avx2(wide: &Wide, query: &Query, start: Child, best: Option<Hit>) -> Option<Hit> {
    traverse::<Avx2, false>(wide, query, start, best)
}

#[target_feature(enable = "avx2,bmi1,bmi2")]
fn any_avx2(wide: &Wide, query: &Query, start: Child) -> bool {
    traverse::<Avx2, true>(wide, query, start, None).is_some()
}

/// AVX2. Private to this file: only the two functions above use it, which run with AVX2.
struct Avx2;

/// A ray over all lanes.
struct SpreadRay {
    origin: [__m256; 3],
    inverse: [__m256; 3],
    /// Rows of [`Node::planes`] through which the ray enters.
    enter: [usize; 3],
    t_min: __m256,
    /// Rows of a packet's corner, in the order of the shear.
    axes: [usize; 3],
    sheared_origin: [__m128; 3],
    sheared_inverse: [__m128; 3],
    shear: [__m128; 3],
    near: __m128,
    /// Axes along which the ray does not move.
    still: [bool; 3],
    is_still: bool,
}

impl Lanes for Avx2 {
    type Ray = SpreadRay;

    #[inline(always)]
    fn spread(query: &Query) -> SpreadRay {
        // SAFETY: reached only through `nearest_avx2` and `any_avx2`, so AVX2 is there.
        unsafe { spread(query) }
    }

    #[inline(always)]
    fn enter(node: &Node, ray: &SpreadRay, limit: f32, distances: &mut Distances) -> u32 {
        // SAFETY: as in `spread`.
        unsafe { enter(node, ray, limit, distances) }
    }

    #[inline(always)]
    fn meet(packet: &Packet, query: &Query, ray: &SpreadRay, limit: f32, t: &mut [f32; LANES]) -> u32 {
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
        prefetch_lines(packet.cast(), 3);
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

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn spread(query: &Query) -> SpreadRay {
    let (ray, sheared) = (&query.ray, &query.sheared);
    let wide = |v: crate::math::Vec3| v.to_array().map(|x| _mm256_set1_ps(x));
    SpreadRay {
        origin: wide(ray.origin),
        inverse: wide(query.inverse),
        enter: [0, 1, 2].map(|axis| if query.inverse[axis] >= 0.0 { axis } else { axis + 3 }),
        t_min: _mm256_set1_ps(ray.t_min),
        axes: sheared.axes,
        sheared_origin: sheared.axes.map(|axis| _mm_set1_ps(ray.origin[axis])),
        sheared_inverse: sheared.axes.map(|axis| _mm_set1_ps(query.inverse[axis])),
        shear: sheared.shear.map(|x| _mm_set1_ps(x)),
        near: _mm_set1_ps(ray.t_min),
        still: query.still(),
        is_still: query.still() != [false; 3],
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
fn enter(node: &Node, ray: &SpreadRay, limit: f32, distances: &mut Distances) -> u32 {
    let mut near = ray.t_min;
    let mut far = _mm256_set1_ps(limit);
    for axis in 0..3 {
        let row = ray.enter[axis] % 6;
        let opposite = if row >= 3 { row - 3 } else { row + 3 };
        let a = _mm256_mul_ps(_mm256_sub_ps(load8(&node.planes[row]), ray.origin[axis]), ray.inverse[axis]);
        let b = _mm256_mul_ps(_mm256_sub_ps(load8(&node.planes[opposite]), ray.origin[axis]), ray.inverse[axis]);
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
fn holding_ray(node: &Node, ray: &SpreadRay) -> u32 {
    let at = |row: usize, axis: usize| _mm256_cmp_ps::<_CMP_EQ_OQ>(load8(&node.planes[row]), ray.origin[axis]);
    let of = |axis: usize| _mm256_movemask_ps(_mm256_and_ps(at(axis, axis), at(axis + 3, axis))) as u32;
    (0..3).filter(|&axis| ray.still[axis]).fold(0, |mask, axis| mask | of(axis))
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn load4(rows: &[[f32; LANES]; 3], axis: usize) -> __m128 {
    debug_assert!(axis < 3);
    // SAFETY: `axis` comes from `ShearedRay::axes`, a permutation of 0, 1, 2.
    let row = unsafe { rows.get_unchecked(axis) };
    // SAFETY: the reference covers the 16 bytes read; no alignment is asked for.
    unsafe { _mm_loadu_ps(row.as_ptr()) }
}

/// `a b - c d`, each product rounded: not to be fused.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn difference(a: __m128, b: __m128, c: __m128, d: __m128) -> __m128 {
    _mm_sub_ps(_mm_mul_ps(a, b), _mm_mul_ps(c, d))
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn meet(packet: &Packet, query: &Query, ray: &SpreadRay, limit: f32, t: &mut [f32; LANES]) -> u32 {
    let place = |corner: usize| {
        let rows = &packet.corners[corner];
        [0, 1, 2].map(|i| _mm_sub_ps(load4(rows, ray.axes[i]), ray.sheared_origin[i]))
    };
    let places = [place(0), place(1), place(2)];
    let project = |corner: usize| {
        let [x, y, z] = places[corner];
        (_mm_sub_ps(x, _mm_mul_ps(ray.shear[0], z)), _mm_sub_ps(y, _mm_mul_ps(ray.shear[1], z)), z)
    };
    let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (project(0), project(1), project(2));
    let u = difference(cx, by, cy, bx);
    let v = difference(ax, cy, ay, cx);
    let w = difference(bx, ay, by, ax);
    let zero = _mm_setzero_ps();
    let has_negative = _mm_cmplt_ps(_mm_min_ps(_mm_min_ps(u, v), w), zero);
    let has_positive = _mm_cmpgt_ps(_mm_max_ps(_mm_max_ps(u, v), w), zero);
    let outside = _mm_and_ps(has_negative, has_positive);
    if _mm_movemask_ps(outside) == 0xf {
        return 0;
    }
    let det = _mm_add_ps(_mm_add_ps(u, v), w);
    let [az, bz, cz] = [az, bz, cz].map(|z| _mm_mul_ps(ray.shear[2], z));
    let scaled = _mm_add_ps(_mm_add_ps(_mm_mul_ps(u, az), _mm_mul_ps(v, bz)), _mm_mul_ps(w, cz));
    let distance = _mm_div_ps(scaled, det);
    let in_interval = _mm_and_ps(_mm_cmpgt_ps(distance, ray.near), _mm_cmplt_ps(distance, _mm_set1_ps(limit)));
    let is_zero = _mm_or_ps(_mm_or_ps(_mm_cmpeq_ps(u, zero), _mm_cmpeq_ps(v, zero)), _mm_cmpeq_ps(w, zero));
    let mut unsure = _mm_movemask_ps(_mm_andnot_ps(outside, is_zero)) as u32;
    let mut met = _mm_movemask_ps(_mm_andnot_ps(_mm_or_ps(outside, is_zero), in_interval)) as u32;
    if met | unsure != 0 {
        let settled = settle(distance, &places, ray);
        // With an infinite inverse a product may be a NaN: such rays are tested one by one below.
        if !ray.is_still {
            met &= _mm_movemask_ps(_mm_cmplt_ps(settled, _mm_set1_ps(limit))) as u32;
        }
        // SAFETY: the array's 16 bytes are written; no alignment is asked for.
        unsafe { _mm_storeu_ps(t.as_mut_ptr(), settled) };
    }
    if unsure != 0 {
        // A ray inside a wall's plane has many such triangles before it; their corners all lie on an axis, and none is met.
        let (x, y) = (_mm_or_ps(_mm_or_ps(ax, bx), cx), _mm_or_ps(_mm_or_ps(ay, by), cy));
        let edge_on = _mm_or_ps(_mm_cmpeq_ps(x, zero), _mm_cmpeq_ps(y, zero));
        unsure &= !_mm_movemask_ps(edge_on) as u32;
    }
    let alone = if ray.is_still { met | unsure } else { unsure };
    if alone == 0 { met } else { met & !alone | meet_alone(packet, query, alone, limit, t) }
}

/// [`Query::settle`], lane by lane, for a ray that moves along all axes; `places` are corners less the origin.
///
/// The least of the products is that of the plane entered through, as their rounding is monotonic.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn settle(t: __m128, [a, b, c]: &[[__m128; 3]; 3], ray: &SpreadRay) -> __m128 {
    let mut enter = _mm_set1_ps(f32::NEG_INFINITY);
    for i in 0..3 {
        let [a, b, c] = [a, b, c].map(|corner| _mm_mul_ps(corner[i], ray.sheared_inverse[i]));
        enter = _mm_max_ps(_mm_min_ps(_mm_min_ps(a, b), c), enter);
    }
    let is_before = _mm_cmpgt_ps(enter, _mm_mul_ps(t, _mm_set1_ps(BOX_SLACK)));
    _mm_blendv_ps(t, enter, is_before)
}

/// Some lanes one by one: where an edge function is zero, or for a ray along an axis.
#[cold]
fn meet_alone(packet: &Packet, query: &Query, alone: u32, limit: f32, t: &mut [f32; LANES]) -> u32 {
    let mut met = 0;
    for lane in (0..LANES).filter(|lane| alone >> lane & 1 != 0) {
        if let Some(hit) = query.meet(packet.triangle(lane), limit) {
            t[lane] = hit;
            met |= 1 << lane;
        }
    }
    met
}
