//! The vector operations by AVX-512, for processors that have it: sixteen triangles at a time; boxes as by AVX2.

#![allow(unsafe_code, reason = "vector loads and stores, and calls into functions compiled for AVX-512 after asking for it")]

use std::arch::x86_64::*;

use super::avx2::{self, BoxRay};
use super::kernel::{Distances, Lanes, Parameters, is_hidden, traverse};
use super::layout::{Child, Node, Packet};
use super::packet::{self, RayVector, Row};
use super::{Operations, Wide};
use crate::accel::KnownOccluders;
use crate::accel::query::{BOX_SLACK, Query};
use crate::geometry::{Hit, Ray};

/// True if the processor can run this file.
pub fn is_supported() -> bool {
    avx2::is_supported() && is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vl")
}

/// The nearest hit.
#[inline]
pub fn nearest(wide: &Wide, ray: &Ray) -> Option<Hit> {
    debug_assert!(wide.operations == Operations::Avx512);
    // SAFETY: `Wide::operations`, on which the caller branches, is this only if `is_supported` said so.
    unsafe { nearest_avx512(wide, ray) }
}

/// Whether there is a hit.
#[inline]
pub fn any(wide: &Wide, ray: &Ray) -> bool {
    debug_assert!(wide.operations == Operations::Avx512);
    // SAFETY: as in `nearest`.
    unsafe { any_avx512(wide, ray) }
}

/// Whether there is a hit, those leaves first where hits are known.
#[inline]
pub fn any_as_known(wide: &Wide, ray: &Ray, known: &mut KnownOccluders) -> bool {
    debug_assert!(wide.operations == Operations::Avx512);
    // SAFETY: as in `nearest`.
    unsafe { any_as_known_avx512(wide, ray, known) }
}

/// Nearest hits of a bundle's rays.
#[inline]
pub fn nearest_of(wide: &Wide, rays: &[Ray], hit: &mut impl FnMut(usize, Option<Hit>)) {
    assert!(wide.operations == Operations::Avx512);
    // SAFETY: `Wide::operations` is this only if `is_supported` said so.
    unsafe { nearest_of_avx512(wide, rays, hit) }
}

/// Whether there are hits of a bundle's rays.
#[inline]
pub fn any_of(wide: &Wide, rays: &[Ray], answer: &mut impl FnMut(usize, bool)) {
    assert!(wide.operations == Operations::Avx512);
    // SAFETY: as in `nearest_of`.
    unsafe { any_of_avx512(wide, rays, answer) }
}

#[target_feature(enable = "avx512f,avx512vl,avx2,bmi1,bmi2")]
fn nearest_of_avx512(wide: &Wide, rays: &[Ray], hit: &mut impl FnMut(usize, Option<Hit>)) {
    packet::nearest::<Avx512>(wide, rays, hit);
}

#[target_feature(enable = "avx512f,avx512vl,avx2,bmi1,bmi2")]
fn any_of_avx512(wide: &Wide, rays: &[Ray], answer: &mut impl FnMut(usize, bool)) {
    packet::any::<Avx512>(wide, rays, answer);
}

// What is ready for the traversal stays in registers if it is made here.
#[target_feature(enable = "avx512f,avx512vl,avx2,bmi1,bmi2")]
fn nearest_avx512(wide: &Wide, ray: &Ray) -> Option<Hit> {
    traverse::<Avx512, false>(wide, &Query::new(ray)?, Child::ROOT, None)
}

#[target_feature(enable = "avx512f,avx512vl,avx2,bmi1,bmi2")]
fn any_avx512(wide: &Wide, ray: &Ray) -> bool {
    Query::new(ray).is_some_and(|query| traverse::<Avx512, true>(wide, &query, Child::ROOT, None).is_some())
}

#[target_feature(enable = "avx512f,avx512vl,avx2,bmi1,bmi2")]
fn any_as_known_avx512(wide: &Wide, ray: &Ray, known: &mut KnownOccluders) -> bool {
    Query::new(ray).is_some_and(|query| is_hidden::<Avx512>(wide, &query, known))
}

/// AVX-512. Private to this file: only the functions above use it, which run with AVX-512.
struct Avx512;

/// A ray: for boxes over all lanes; for triangles it is spread by the operations themselves.
struct SpreadRay {
    boxes: BoxRay,
    /// Rows of a packet's corners, in the order of the shear.
    axes: [usize; 3],
    origin: [f32; 3],
    inverse: [f32; 3],
    shear: [f32; 3],
    t_min: f32,
}

impl Lanes for Avx512 {
    type Ray = SpreadRay;

    #[inline(always)]
    fn spread(query: &Query) -> SpreadRay {
        let ([x, y, z], origin, inverse) = (query.sheared.axes, query.ray.origin, query.inverse);
        SpreadRay {
            boxes: BoxRay::new(query),
            axes: query.sheared.axes,
            origin: [origin[x], origin[y], origin[z]],
            inverse: [inverse[x], inverse[y], inverse[z]],
            shear: query.sheared.shear,
            t_min: query.ray.t_min,
        }
    }

    #[inline(always)]
    fn enter(node: &Node, ray: &SpreadRay, limit: f32, distances: &mut Distances) -> u32 {
        // SAFETY: reached only through the functions above, so AVX2 is there.
        unsafe { avx2::enter(node, &ray.boxes, limit, distances) }
    }

    #[inline(always)]
    fn meet(packet: &Packet, query: &Query, ray: &SpreadRay, limit: f32, t: &mut Parameters) -> u32 {
        // SAFETY: reached only through the functions above, so AVX-512 is there.
        unsafe { meet(packet, query, ray, limit, t) }
    }

    #[inline(always)]
    fn prefetch(wide: &Wide, child: Child) {
        avx2::prefetch(wide, child);
    }
}

impl RayVector for Avx512 {
    type Vector = __m512;
    type Mask = __mmask16;
    const N: usize = 16;

    #[inline(always)]
    fn splat(x: f32) -> Self::Vector {
        // SAFETY: as in `meet`.
        unsafe { _mm512_set1_ps(x) }
    }

    #[inline(always)]
    fn load(row: &Row, group: usize) -> Self::Vector {
        // SAFETY: the slice covers what is read, and rows are aligned; and as in `meet`.
        unsafe { _mm512_load_ps(row.0[16 * group..][..16].as_ptr()) }
    }

    #[inline(always)]
    fn store(row: &mut Row, group: usize, values: Self::Vector) {
        // SAFETY: the slice covers what is written, and rows are aligned; and as in `meet`.
        unsafe { _mm512_store_ps(row.0[16 * group..][..16].as_mut_ptr(), values) }
    }

    #[inline(always)]
    fn add(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `meet`.
        unsafe { _mm512_add_ps(a, b) }
    }

    #[inline(always)]
    fn sub(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `meet`.
        unsafe { _mm512_sub_ps(a, b) }
    }

    #[inline(always)]
    fn mul(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `meet`.
        unsafe { _mm512_mul_ps(a, b) }
    }

    #[inline(always)]
    fn div(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `meet`.
        unsafe { _mm512_div_ps(a, b) }
    }

    #[inline(always)]
    fn min(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `meet`.
        unsafe { _mm512_min_ps(a, b) }
    }

    #[inline(always)]
    fn max(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        // SAFETY: as in `meet`.
        unsafe { _mm512_max_ps(a, b) }
    }

    #[inline(always)]
    fn less(a: Self::Vector, b: Self::Vector) -> Self::Mask {
        // SAFETY: as in `meet`.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b) }
    }

    #[inline(always)]
    fn less_or_equal(a: Self::Vector, b: Self::Vector) -> Self::Mask {
        // SAFETY: as in `meet`.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b) }
    }

    #[inline(always)]
    fn equal(a: Self::Vector, b: Self::Vector) -> Self::Mask {
        // SAFETY: as in `meet`.
        unsafe { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(a, b) }
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a & b
    }

    #[inline(always)]
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a | b
    }

    #[inline(always)]
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a & !b
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        u32::from(mask)
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self::Vector, no: Self::Vector) -> Self::Vector {
        // SAFETY: as in `meet`.
        unsafe { _mm512_mask_blend_ps(mask, no, yes) }
    }
}

/// `a b - c d`, each product rounded: not to be fused.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx2,bmi1,bmi2")]
fn difference(a: __m512, b: __m512, c: __m512, d: __m512) -> __m512 {
    _mm512_sub_ps(_mm512_mul_ps(a, b), _mm512_mul_ps(c, d))
}

#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx2,bmi1,bmi2")]
fn meet(packet: &Packet, query: &Query, ray: &SpreadRay, limit: f32, t: &mut Parameters) -> u32 {
    let row = |i: usize| {
        debug_assert!(ray.axes[i] < 3);
        // SAFETY: `axes` is a permutation of 0, 1, 2, and the reference covers the 64 bytes read.
        unsafe { _mm512_loadu_ps(packet.corners.get_unchecked(ray.axes[i]).as_ptr()) }
    };
    let spread = |x: f32| _mm512_set1_ps(x);
    // Of each corner.
    let moved_x = _mm512_sub_ps(row(0), spread(ray.origin[0]));
    let moved_y = _mm512_sub_ps(row(1), spread(ray.origin[1]));
    let moved_z = _mm512_sub_ps(row(2), spread(ray.origin[2]));
    let x = _mm512_sub_ps(moved_x, _mm512_mul_ps(spread(ray.shear[0]), moved_z));
    let y = _mm512_sub_ps(moved_y, _mm512_mul_ps(spread(ray.shear[1]), moved_z));
    // Of each triangle.
    // SAFETY: the reference covers the 32 bytes read; no alignment is asked for.
    let places = unsafe { _mm256_loadu_si256(packet.triangles.as_ptr().cast()) };
    // A permutation heeds the lowest four bits only.
    let of_a = _mm512_cvtepu16_epi32(places);
    let (of_b, of_c) = (_mm512_srli_epi32::<4>(of_a), _mm512_srli_epi32::<8>(of_a));
    let pick = |values: __m512| {
        (_mm512_permutexvar_ps(of_a, values), _mm512_permutexvar_ps(of_b, values), _mm512_permutexvar_ps(of_c, values))
    };
    let ((ax, bx, cx), (ay, by, cy)) = (pick(x), pick(y));
    let u = difference(cx, by, cy, bx);
    let v = difference(ax, cy, ay, cx);
    let w = difference(bx, ay, by, ax);
    let zero = _mm512_setzero_ps();
    let has_negative = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_min_ps(_mm512_min_ps(u, v), w), zero);
    let has_positive = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(_mm512_max_ps(_mm512_max_ps(u, v), w), zero);
    let inside = packet.is_triangle & !(has_negative & has_positive);
    if inside == 0 {
        return 0;
    }
    let det = _mm512_add_ps(_mm512_add_ps(u, v), w);
    let (az, bz, cz) = pick(_mm512_mul_ps(spread(ray.shear[2]), moved_z));
    let scaled = _mm512_add_ps(_mm512_add_ps(_mm512_mul_ps(u, az), _mm512_mul_ps(v, bz)), _mm512_mul_ps(w, cz));
    let distance = _mm512_div_ps(scaled, det);
    let wide_limit = spread(limit);
    let in_interval =
        _mm512_cmp_ps_mask::<_CMP_GT_OQ>(distance, spread(ray.t_min)) & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(distance, wide_limit);
    let equals_zero = |x| _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(x, zero);
    let is_zero = equals_zero(u) | equals_zero(v) | equals_zero(w);
    let mut unsure = inside & is_zero;
    let mut met = inside & !is_zero & in_interval;
    if met | unsure == 0 {
        return 0;
    }
    // `Query::settle`: the least of the products is that of the plane entered through, as their rounding is monotonic.
    let slab = |moved: __m512, inverse: f32| {
        let (a, b, c) = pick(_mm512_mul_ps(moved, spread(inverse)));
        _mm512_min_ps(_mm512_min_ps(a, b), c)
    };
    let enter = _mm512_max_ps(slab(moved_x, ray.inverse[0]), spread(f32::NEG_INFINITY));
    let enter = _mm512_max_ps(slab(moved_y, ray.inverse[1]), enter);
    let enter = _mm512_max_ps(slab(moved_z, ray.inverse[2]), enter);
    let is_before = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(enter, _mm512_mul_ps(distance, _mm512_set1_ps(BOX_SLACK)));
    let settled = _mm512_mask_blend_ps(is_before, distance, enter);
    // With an infinite inverse a product may be a NaN: such rays are tested one by one below.
    if !ray.boxes.is_still {
        met &= _mm512_cmp_ps_mask::<_CMP_LT_OQ>(settled, wide_limit);
    }
    // SAFETY: the array's 64 bytes are written; no alignment is asked for.
    unsafe { _mm512_storeu_ps(t.0.as_mut_ptr(), settled) };
    if unsure != 0 {
        // A ray inside a wall's plane has many such triangles before it; their corners all lie on an axis, and none is met.
        let all = |a, b, c| equals_zero(a) & equals_zero(b) & equals_zero(c);
        unsure &= !(all(ax, bx, cx) | all(ay, by, cy));
    }
    let alone = if ray.boxes.is_still { met | unsure } else { unsure };
    let (met, alone) = (u32::from(met), u32::from(alone));
    if alone == 0 { met } else { met & !alone | avx2::meet_alone(packet, query, alone, limit, t) }
}
