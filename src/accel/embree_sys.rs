//! Declarations of Embree 3's C interface, as far as used (Embree 3.13 API reference; headers `embree3/rtcore_*.h`).
//!
//! Checked for libraries built with one instance level and without a minimal curve width, the defaults.

#![allow(missing_docs, reason = "the names are those of Embree's manual")]
#![allow(unsafe_code, reason = "foreign functions are declared unsafe")]

use std::ffi::{c_char, c_int, c_uint, c_void};

pub type Handle = *mut c_void;

pub const INVALID_ID: c_uint = c_uint::MAX;
pub const GEOMETRY_TYPE_TRIANGLE: c_int = 0;
pub const GEOMETRY_TYPE_USER: c_int = 120;
pub const BUFFER_TYPE_INDEX: c_int = 0;
pub const BUFFER_TYPE_VERTEX: c_int = 1;
pub const FORMAT_UINT3: c_int = 0x5003;
pub const FORMAT_FLOAT3: c_int = 0x9003;
pub const BUILD_QUALITY_MEDIUM: c_int = 1;
pub const SCENE_FLAG_NONE: c_int = 0;
pub const SCENE_FLAG_ROBUST: c_int = 1 << 2;
pub const CONTEXT_INCOHERENT: c_int = 0;
pub const CONTEXT_COHERENT: c_int = 1;
pub const ERROR_NONE: c_int = 0;
pub const DEVICE_PROPERTY_VERSION_MAJOR: c_int = 1;

#[repr(C, align(16))]
#[derive(Clone, Copy)]
pub struct Ray {
    pub origin: [f32; 3],
    pub tnear: f32,
    pub direction: [f32; 3],
    pub time: f32,
    pub tfar: f32,
    pub mask: c_uint,
    pub id: c_uint,
    pub flags: c_uint,
}

#[repr(C, align(16))]
#[derive(Clone, Copy)]
pub struct Hit {
    pub normal: [f32; 3],
    pub u: f32,
    pub v: f32,
    pub primitive: c_uint,
    pub geometry: c_uint,
    pub instance: c_uint,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct RayHit {
    pub ray: Ray,
    pub hit: Hit,
}

/// Sixteen rays, one field after the other; 64-byte aligned as `rtcIntersect16` asks.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub struct Ray16 {
    pub origin: [[f32; 16]; 3],
    pub tnear: [f32; 16],
    pub direction: [[f32; 16]; 3],
    pub time: [f32; 16],
    pub tfar: [f32; 16],
    pub mask: [c_uint; 16],
    pub id: [c_uint; 16],
    pub flags: [c_uint; 16],
}

#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub struct Hit16 {
    pub normal: [[f32; 16]; 3],
    pub u: [f32; 16],
    pub v: [f32; 16],
    pub primitive: [c_uint; 16],
    pub geometry: [c_uint; 16],
    pub instance: [c_uint; 16],
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct RayHit16 {
    pub ray: Ray16,
    pub hit: Hit16,
}

#[repr(C, align(64))]
pub struct Valid16(pub [c_int; 16]);

#[repr(C)]
pub struct IntersectContext {
    pub flags: c_int,
    pub filter: *const c_void,
    pub instance: [c_uint; 1],
}

#[repr(C, align(16))]
pub struct Bounds {
    pub lower: [f32; 3],
    pub align0: f32,
    pub upper: [f32; 3],
    pub align1: f32,
}

#[repr(C)]
pub struct BoundsArguments {
    pub user: *mut c_void,
    pub primitive: c_uint,
    pub time_step: c_uint,
    pub bounds: *mut Bounds,
}

/// Arguments of both `RTCIntersectFunctionN` and `RTCOccludedFunctionN`: the rays are `RTCRayHitN` or `RTCRayN`.
#[repr(C)]
pub struct QueryArguments {
    pub valid: *mut c_int,
    pub user: *mut c_void,
    pub primitive: c_uint,
    pub context: *mut IntersectContext,
    pub rays: *mut f32,
    pub n: c_uint,
    pub geometry: c_uint,
}

pub type ErrorFunction = unsafe extern "C" fn(*mut c_void, c_int, *const c_char);
pub type MemoryFunction = unsafe extern "C" fn(*mut c_void, isize, bool) -> bool;
pub type BoundsFunction = unsafe extern "C" fn(*const BoundsArguments);
pub type QueryFunction = unsafe extern "C" fn(*const QueryArguments);

const _: () = {
    assert!(size_of::<Ray>() == 48 && size_of::<Hit>() == 32 && size_of::<RayHit>() == 80);
    assert!(size_of::<RayHit16>() == 80 * 16 && align_of::<RayHit16>() == 64);
    assert!(size_of::<IntersectContext>() == 24 && size_of::<Bounds>() == 32);
};

unsafe extern "C" {
    pub fn rtcNewDevice(config: *const c_char) -> Handle;
    pub fn rtcReleaseDevice(device: Handle);
    pub fn rtcGetDeviceProperty(device: Handle, property: c_int) -> isize;
    pub fn rtcGetDeviceError(device: Handle) -> c_int;
    pub fn rtcSetDeviceErrorFunction(device: Handle, function: Option<ErrorFunction>, user: *mut c_void);
    pub fn rtcSetDeviceMemoryMonitorFunction(device: Handle, function: Option<MemoryFunction>, user: *mut c_void);

    pub fn rtcNewScene(device: Handle) -> Handle;
    pub fn rtcReleaseScene(scene: Handle);
    pub fn rtcSetSceneBuildQuality(scene: Handle, quality: c_int);
    pub fn rtcSetSceneFlags(scene: Handle, flags: c_int);
    pub fn rtcAttachGeometryByID(scene: Handle, geometry: Handle, id: c_uint);
    pub fn rtcCommitScene(scene: Handle);

    pub fn rtcNewGeometry(device: Handle, kind: c_int) -> Handle;
    pub fn rtcReleaseGeometry(geometry: Handle);
    pub fn rtcCommitGeometry(geometry: Handle);
    pub fn rtcSetNewGeometryBuffer(
        geometry: Handle,
        kind: c_int,
        slot: c_uint,
        format: c_int,
        stride: usize,
        count: usize,
    ) -> *mut c_void;
    pub fn rtcSetGeometryUserPrimitiveCount(geometry: Handle, count: c_uint);
    pub fn rtcSetGeometryUserData(geometry: Handle, user: *mut c_void);
    pub fn rtcSetGeometryBoundsFunction(geometry: Handle, function: Option<BoundsFunction>, user: *mut c_void);
    pub fn rtcSetGeometryIntersectFunction(geometry: Handle, function: Option<QueryFunction>);
    pub fn rtcSetGeometryOccludedFunction(geometry: Handle, function: Option<QueryFunction>);

    pub fn rtcIntersect1(scene: Handle, context: *mut IntersectContext, ray: *mut RayHit);
    pub fn rtcOccluded1(scene: Handle, context: *mut IntersectContext, ray: *mut Ray);
    pub fn rtcIntersect16(valid: *const c_int, scene: Handle, context: *mut IntersectContext, rays: *mut RayHit16);
    pub fn rtcOccluded16(valid: *const c_int, scene: Handle, context: *mut IntersectContext, rays: *mut Ray16);
    pub fn rtcIntersect1M(scene: Handle, context: *mut IntersectContext, rays: *mut RayHit, count: c_uint, stride: usize);
    pub fn rtcOccluded1M(scene: Handle, context: *mut IntersectContext, rays: *mut Ray, count: c_uint, stride: usize);
}
