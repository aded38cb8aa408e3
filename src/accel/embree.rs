//! Intel Embree 3 behind [`Accel`] (cargo feature `embree`): the yardstick for the built-in kernel.
//!
//! Triangles in robust mode; spheres as user geometry, by the same exact test as everywhere. Two rules are Embree's own: of hits
//! at equal t any may be reported, and the robust test is watertight at edges but loses about 1 % of rays aimed at vertices.

#![allow(unsafe_code, reason = "calls into a C library")]

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ptr::{self, NonNull};
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex};

use super::embree_sys as sys;
use super::query::usable;
use super::{Accel, AccelError, Hit, Ray, Soup};
use crate::math::Vec3;

/// Which triangle test Embree uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Plücker coordinates: no leaks at edges.
    Robust,
    /// Möller and Trumbore's test: faster, leaks at edges and vertices.
    Fast,
}

/// How a batch is handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BatchForm {
    /// `rtcIntersect16` on consecutive rays.
    Packets,
    /// `rtcIntersect1M`.
    Stream,
}

const TRIANGLES: u32 = 0;
const SPHERES: u32 = 1;

/// A committed Embree scene.
pub struct Embree {
    // Dropped in this order: the scene before its device, both before what their callbacks point to.
    scene: Scene,
    _device: Device,
    log: Box<Log>,
    soup: Arc<Soup>,
}

/// What the callbacks of a device write to.
#[derive(Default)]
struct Log {
    bytes: AtomicIsize,
    error: Mutex<Option<String>>,
}

impl Embree {
    /// Builds and commits the scene, with as many threads as rayon has.
    ///
    /// # Errors
    /// [`AccelError::Embree`] with the library's own words.
    pub fn new(soup: Arc<Soup>, mode: Mode) -> Result<Self, AccelError> {
        let log = Box::<Log>::default();
        let device = Device::new(&log)?;
        let scene = Scene::new(&device, mode)?;
        if !soup.triangles.is_empty() {
            add_triangles(&device, &scene, &soup)?;
        }
        if !soup.spheres.is_empty() {
            add_spheres(&device, &scene, &soup)?;
        }
        // SAFETY: the handle is alive, and no other thread knows it.
        unsafe { sys::rtcCommitScene(scene.0.as_ptr()) };
        device.check(&log)?;
        Ok(Self { scene, _device: device, log, soup })
    }

    /// Nearest hits of many rays in one of Embree's two ways, `coherent` being what the caller knows of them.
    pub fn intersect_batch_as(&self, rays: &[Ray], hits: &mut [Option<Hit>], form: BatchForm, coherent: bool) {
        assert_eq!(rays.len(), hits.len(), "one hit for each ray");
        let mut context = context(coherent);
        match form {
            BatchForm::Stream => {
                let mut batch: Vec<sys::RayHit> = rays.iter().map(|r| to_ray_hit(&usable_or_empty(r))).collect();
                // SAFETY: the scene is committed and alive; the array holds `len` rays at the given stride.
                unsafe {
                    sys::rtcIntersect1M(
                        self.scene.0.as_ptr(),
                        &mut context,
                        batch.as_mut_ptr(),
                        batch.len() as u32,
                        size_of::<sys::RayHit>(),
                    )
                };
                for ((hit, ray), found) in hits.iter_mut().zip(rays).zip(&batch) {
                    *hit = self.to_hit(ray, found.ray.tfar, found.hit.geometry, found.hit.primitive);
                }
            }
            BatchForm::Packets => {
                for (rays, hits) in rays.chunks(16).zip(hits.chunks_mut(16)) {
                    self.intersect_packet(rays, hits, &mut context);
                }
            }
        }
    }

    /// Occlusion of many rays; as `intersect_batch_as`.
    pub fn occluded_batch_as(&self, rays: &[Ray], occluded: &mut [bool], form: BatchForm, coherent: bool) {
        assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
        let mut context = context(coherent);
        match form {
            BatchForm::Stream => {
                let mut batch: Vec<sys::Ray> = rays.iter().map(|r| to_ray(&usable_or_empty(r))).collect();
                // SAFETY: the scene is committed and alive; the array holds `len` rays at the given stride.
                unsafe {
                    sys::rtcOccluded1M(
                        self.scene.0.as_ptr(),
                        &mut context,
                        batch.as_mut_ptr(),
                        batch.len() as u32,
                        size_of::<sys::Ray>(),
                    )
                };
                occluded.iter_mut().zip(&batch).for_each(|(answer, ray)| *answer = ray.tfar == f32::NEG_INFINITY);
            }
            BatchForm::Packets => {
                for (rays, answers) in rays.chunks(16).zip(occluded.chunks_mut(16)) {
                    let (valid, mut packet) = to_packet(rays);
                    // SAFETY: the scene is committed and alive; masks and rays are 64-byte aligned packets of 16.
                    unsafe { sys::rtcOccluded16(valid.0.as_ptr(), self.scene.0.as_ptr(), &mut context, &mut packet) };
                    answers.iter_mut().zip(packet.tfar).for_each(|(answer, tfar)| *answer = tfar == f32::NEG_INFINITY);
                }
            }
        }
    }

    fn intersect_packet(&self, rays: &[Ray], hits: &mut [Option<Hit>], context: &mut sys::IntersectContext) {
        let (valid, ray) = to_packet(rays);
        let no_hit = sys::Hit16 {
            normal: [[0.0; 16]; 3],
            u: [0.0; 16],
            v: [0.0; 16],
            primitive: [sys::INVALID_ID; 16],
            geometry: [sys::INVALID_ID; 16],
            instance: [sys::INVALID_ID; 16],
        };
        let mut packet = sys::RayHit16 { ray, hit: no_hit };
        // SAFETY: the scene is committed and alive; masks and rays are 64-byte aligned packets of 16.
        unsafe { sys::rtcIntersect16(valid.0.as_ptr(), self.scene.0.as_ptr(), context, &mut packet) };
        for (lane, (hit, ray)) in hits.iter_mut().zip(rays).enumerate() {
            *hit = self.to_hit(ray, packet.ray.tfar[lane], packet.hit.geometry[lane], packet.hit.primitive[lane]);
        }
    }

    fn to_hit(&self, ray: &Ray, t: f32, geometry: u32, primitive: u32) -> Option<Hit> {
        let first = match geometry {
            TRIANGLES => 0,
            SPHERES => self.soup.triangles.len() as u32,
            _ => return None,
        };
        if t <= ray.t_min.max(0.0) {
            return self.behind_near_end(ray);
        }
        // The library's interval is closed at the far end.
        (t < ray.t_max).then_some(Hit { t, primitive: first + primitive })
    }

    /// The library's comparison with the near end is rounded: a hit at `t_min` itself may come back, and hides what lies behind it.
    /// So the near end moves on by 1, 2, 4 ... ulps until it does not.
    #[cold]
    fn behind_near_end(&self, ray: &Ray) -> Option<Hit> {
        let ray = usable(ray)?;
        let start = ray.t_min.max(f32::MIN_POSITIVE);
        (0..20).map(|step| f32::from_bits(start.to_bits() + (1 << step))).find_map(|t_min| {
            let query = self.nearest(&Ray { t_min, ..ray });
            // The end of the search: nothing was found, or something behind the near end that was asked for.
            let is_over = query.hit.geometry == sys::INVALID_ID || query.ray.tfar > ray.t_min;
            is_over.then(|| self.to_hit(&ray, query.ray.tfar, query.hit.geometry, query.hit.primitive))
        })?
    }

    /// What the library finds along a usable ray.
    fn nearest(&self, ray: &Ray) -> sys::RayHit {
        let mut query = to_ray_hit(ray);
        let mut context = context(false);
        // SAFETY: the scene is committed and alive, and "can be called from multiple threads" (manual, rtcIntersect1); ray and
        // context are valid and aligned.
        unsafe { sys::rtcIntersect1(self.scene.0.as_ptr(), &mut context, &mut query) };
        query
    }
}

impl Accel for Embree {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let query = self.nearest(&usable(ray)?);
        self.to_hit(ray, query.ray.tfar, query.hit.geometry, query.hit.primitive)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let Some(ray) = usable(ray) else { return false };
        let (mut query, mut context) = (to_ray(&ray), context(false));
        // SAFETY: as in `nearest`.
        unsafe { sys::rtcOccluded1(self.scene.0.as_ptr(), &mut context, &mut query) };
        query.tfar == f32::NEG_INFINITY
    }

    // Packets of 16 are its fastest form for rays that run together, and batches are made of such.
    fn intersect_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        self.intersect_batch_as(rays, hits, BatchForm::Packets, true);
    }

    fn occluded_batch(&self, rays: &[Ray], occluded: &mut [bool]) {
        self.occluded_batch_as(rays, occluded, BatchForm::Packets, true);
    }

    fn memory_bytes(&self) -> usize {
        self.log.bytes.load(Ordering::Relaxed).max(0) as usize
    }
}

fn context(coherent: bool) -> sys::IntersectContext {
    let flags = if coherent { sys::CONTEXT_COHERENT } else { sys::CONTEXT_INCOHERENT };
    sys::IntersectContext { flags, filter: ptr::null(), instance: [sys::INVALID_ID] }
}

/// A ray that cannot hit anything becomes one with an empty interval.
fn usable_or_empty(ray: &Ray) -> Ray {
    usable(ray).unwrap_or(Ray { origin: Vec3::ZERO, direction: Vec3::X, t_min: 0.0, t_max: -1.0 })
}

fn to_ray(ray: &Ray) -> sys::Ray {
    sys::Ray {
        origin: ray.origin.into(),
        tnear: ray.t_min,
        direction: ray.direction.into(),
        time: 0.0,
        // The far end is closed there and open here.
        tfar: if ray.t_max == f32::INFINITY { ray.t_max } else { ray.t_max.next_down() },
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}

fn to_ray_hit(ray: &Ray) -> sys::RayHit {
    let id = sys::INVALID_ID;
    sys::RayHit {
        ray: to_ray(ray),
        hit: sys::Hit { normal: [0.0; 3], u: 0.0, v: 0.0, primitive: id, geometry: id, instance: id },
    }
}

fn to_packet(rays: &[Ray]) -> (sys::Valid16, sys::Ray16) {
    let (mut valid, zero) = (sys::Valid16([0; 16]), [0.0; 16]);
    let mut packet = sys::Ray16 {
        origin: [zero; 3],
        tnear: zero,
        direction: [[1.0; 16]; 3],
        time: zero,
        tfar: [-1.0; 16],
        mask: [u32::MAX; 16],
        id: [0; 16],
        flags: [0; 16],
    };
    for (lane, ray) in rays.iter().enumerate() {
        let Some(ray) = usable(ray).map(|ray| to_ray(&ray)) else { continue };
        for axis in 0..3 {
            packet.origin[axis][lane] = ray.origin[axis];
            packet.direction[axis][lane] = ray.direction[axis];
        }
        (packet.tnear[lane], packet.tfar[lane], valid.0[lane]) = (ray.tnear, ray.tfar, -1);
    }
    (valid, packet)
}

/// Owner of a device handle.
struct Device(NonNull<c_void>);

impl Device {
    /// A device whose callbacks write to `log`, which must outlive it.
    fn new(log: &Log) -> Result<Self, AccelError> {
        let config = format!("threads={},set_affinity=0", rayon::current_num_threads());
        let config = CString::new(config).expect("digits and letters hold no zero byte");
        // SAFETY: the string ends with a zero byte and lives through the call.
        let handle = unsafe { sys::rtcNewDevice(config.as_ptr()) };
        let device = Device(NonNull::new(handle).ok_or_else(|| failure("no device"))?);
        // SAFETY: the handle is alive.
        let major = unsafe { sys::rtcGetDeviceProperty(handle, sys::DEVICE_PROPERTY_VERSION_MAJOR) };
        if major != 3 {
            return Err(failure(&format!("version {major} found, version 3 expected")));
        }
        let user = ptr::from_ref(log).cast_mut().cast();
        // SAFETY: the handle is alive; `log` outlives the device and is only used through shared references.
        unsafe { sys::rtcSetDeviceErrorFunction(handle, Some(on_error), user) };
        // SAFETY: as above.
        unsafe { sys::rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory), user) };
        Ok(device)
    }

    fn check(&self, log: &Log) -> Result<(), AccelError> {
        // SAFETY: the handle is alive.
        let code = unsafe { sys::rtcGetDeviceError(self.0.as_ptr()) };
        let message = log.error.lock().map_or(None, |mut error| error.take());
        match (code, message) {
            (sys::ERROR_NONE, None) => Ok(()),
            (code, message) => Err(failure(&message.unwrap_or_else(|| format!("error {code}")))),
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the handle came from `rtcNewDevice` and is released once.
        unsafe { sys::rtcReleaseDevice(self.0.as_ptr()) };
    }
}

fn failure(message: &str) -> AccelError {
    AccelError::Embree { message: message.to_owned() }
}

/// Owner of a scene handle.
struct Scene(NonNull<c_void>);

// SAFETY: the manual, "rtcIntersect1": a committed scene may be queried from many threads at once; the handle is reference
// counted atomically and not bound to the thread that made it.
unsafe impl Send for Embree {}
// SAFETY: as above; after `new` only queries are made.
unsafe impl Sync for Embree {}

impl Scene {
    fn new(device: &Device, mode: Mode) -> Result<Self, AccelError> {
        // SAFETY: the device is alive.
        let handle = unsafe { sys::rtcNewScene(device.0.as_ptr()) };
        let scene = Scene(NonNull::new(handle).ok_or_else(|| failure("no scene"))?);
        let flags = if mode == Mode::Robust { sys::SCENE_FLAG_ROBUST } else { sys::SCENE_FLAG_NONE };
        // SAFETY: the handle is alive and not committed yet.
        unsafe { sys::rtcSetSceneFlags(handle, flags) };
        // SAFETY: as above.
        unsafe { sys::rtcSetSceneBuildQuality(handle, sys::BUILD_QUALITY_MEDIUM) };
        Ok(scene)
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: the handle came from `rtcNewScene` and is released once.
        unsafe { sys::rtcReleaseScene(self.0.as_ptr()) };
    }
}

/// Owner of a geometry handle until it is attached.
struct Geometry(NonNull<c_void>);

impl Geometry {
    fn new(device: &Device, kind: c_int) -> Result<Self, AccelError> {
        // SAFETY: the device is alive.
        let handle = unsafe { sys::rtcNewGeometry(device.0.as_ptr(), kind) };
        NonNull::new(handle).map(Geometry).ok_or_else(|| failure("no geometry"))
    }

    /// Copies `items` into a new buffer owned by the library, which pads it as it needs.
    fn fill<T: Copy>(&self, kind: c_int, format: c_int, items: &[[T; 3]]) -> Result<(), AccelError> {
        // SAFETY: the handle is alive; stride and count describe `items`.
        let buffer = unsafe { sys::rtcSetNewGeometryBuffer(self.0.as_ptr(), kind, 0, format, size_of::<[T; 3]>(), items.len()) };
        let buffer = NonNull::new(buffer).ok_or_else(|| failure("no memory for a buffer"))?;
        // SAFETY: the library returned room for `items.len()` items, aligned to 16 bytes, that nothing else points into.
        unsafe { ptr::copy_nonoverlapping(items.as_ptr(), buffer.as_ptr().cast(), items.len()) };
        Ok(())
    }

    fn attach(self, scene: &Scene, id: u32) {
        // SAFETY: the handle is alive.
        unsafe { sys::rtcCommitGeometry(self.0.as_ptr()) };
        // SAFETY: both handles are alive; the scene keeps a count of its own.
        unsafe { sys::rtcAttachGeometryByID(scene.0.as_ptr(), self.0.as_ptr(), id) };
    }
}

impl Drop for Geometry {
    fn drop(&mut self) {
        // SAFETY: the handle came from `rtcNewGeometry` and is released once.
        unsafe { sys::rtcReleaseGeometry(self.0.as_ptr()) };
    }
}

fn add_triangles(device: &Device, scene: &Scene, soup: &Soup) -> Result<(), AccelError> {
    let geometry = Geometry::new(device, sys::GEOMETRY_TYPE_TRIANGLE)?;
    let vertices: Vec<[f32; 3]> = soup.vertices.iter().map(|v| v.to_array()).collect();
    geometry.fill(sys::BUFFER_TYPE_VERTEX, sys::FORMAT_FLOAT3, &vertices)?;
    geometry.fill(sys::BUFFER_TYPE_INDEX, sys::FORMAT_UINT3, &soup.triangles)?;
    geometry.attach(scene, TRIANGLES);
    Ok(())
}

fn add_spheres(device: &Device, scene: &Scene, soup: &Arc<Soup>) -> Result<(), AccelError> {
    let geometry = Geometry::new(device, sys::GEOMETRY_TYPE_USER)?;
    let (handle, user) = (geometry.0.as_ptr(), Arc::as_ptr(soup).cast_mut().cast());
    // SAFETY: the handle is alive.
    unsafe { sys::rtcSetGeometryUserPrimitiveCount(handle, soup.spheres.len() as u32) };
    // SAFETY: the pointer is that of an `Arc` which `Embree` keeps longer than the scene; callbacks only read it.
    unsafe { sys::rtcSetGeometryUserData(handle, user) };
    // SAFETY: as above; the function has the signature asked for.
    unsafe { sys::rtcSetGeometryBoundsFunction(handle, Some(sphere_bounds), user) };
    // SAFETY: as above.
    unsafe { sys::rtcSetGeometryIntersectFunction(handle, Some(intersect_spheres)) };
    // SAFETY: as above.
    unsafe { sys::rtcSetGeometryOccludedFunction(handle, Some(occlude_spheres)) };
    geometry.attach(scene, SPHERES);
    Ok(())
}

/// Keeps the first error's text. A panic here would abort the process; nothing in it panics.
unsafe extern "C" fn on_error(user: *mut c_void, code: c_int, text: *const c_char) {
    // SAFETY: `Device::new` passed a `Log` that outlives the device.
    let log = unsafe { &*user.cast::<Log>() };
    let text = if text.is_null() {
        String::new()
    } else {
        // SAFETY: the manual: a null-terminated string, valid during the call.
        unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
    };
    if let Ok(mut error) = log.error.lock() {
        error.get_or_insert(format!("error {code}: {text}"));
    }
}

/// Counts bytes; allows everything.
unsafe extern "C" fn on_memory(user: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: as in `on_error`.
    let log = unsafe { &*user.cast::<Log>() };
    log.bytes.fetch_add(bytes, Ordering::Relaxed);
    true
}

unsafe extern "C" fn sphere_bounds(arguments: *const sys::BoundsArguments) {
    // SAFETY: the library passes valid arguments for the time of the call.
    let arguments = unsafe { &*arguments };
    // SAFETY: `add_spheres` passed a `Soup` that outlives the scene.
    let soup = unsafe { &*arguments.user.cast::<Soup>() };
    let bounds = soup.bounds_of(soup.triangles.len() as u32 + arguments.primitive);
    let bounds = sys::Bounds { lower: bounds.min.into(), align0: 0.0, upper: bounds.max.into(), align1: 0.0 };
    // SAFETY: the library passes a place for one box.
    unsafe { arguments.bounds.write(bounds) };
}

unsafe extern "C" fn intersect_spheres(arguments: *const sys::QueryArguments) {
    // SAFETY: the library passes valid arguments for the time of the call.
    let arguments = unsafe { &*arguments };
    for lane in 0..arguments.n as usize {
        let Some(t) = meet_sphere(arguments, lane) else { continue };
        let field = |index: usize| arguments.rays.wrapping_add(index * arguments.n as usize + lane);
        // SAFETY: `RTCRayHitN` is 20 arrays of n words; 8 is tfar.
        unsafe { field(8).write(t) };
        // SAFETY: 17 is primID, an unsigned word.
        unsafe { field(17).cast::<u32>().write(arguments.primitive) };
        // SAFETY: 18 is geomID.
        unsafe { field(18).cast::<u32>().write(arguments.geometry) };
        // SAFETY: 19 is instID[0].
        unsafe { field(19).cast::<u32>().write(sys::INVALID_ID) };
    }
}

unsafe extern "C" fn occlude_spheres(arguments: *const sys::QueryArguments) {
    // SAFETY: the library passes valid arguments for the time of the call.
    let arguments = unsafe { &*arguments };
    for lane in 0..arguments.n as usize {
        if meet_sphere(arguments, lane).is_some() {
            // SAFETY: `RTCRayN` is 12 arrays of n words; 8 is tfar, set to -inf for "occluded".
            unsafe { arguments.rays.wrapping_add(8 * arguments.n as usize + lane).write(f32::NEG_INFINITY) };
        }
    }
}

/// Where an active lane's ray meets the sphere.
fn meet_sphere(arguments: &sys::QueryArguments, lane: usize) -> Option<f32> {
    // SAFETY: the library passes n words, -1 for an active ray.
    if unsafe { arguments.valid.wrapping_add(lane).read() } != -1 {
        return None;
    }
    let field = |index: usize| {
        // SAFETY: `RTCRayN` is 12 arrays of n words, and callers ask for fields below 12.
        unsafe { arguments.rays.wrapping_add(index * arguments.n as usize + lane).read() }
    };
    // SAFETY: `add_spheres` passed a `Soup` that outlives the scene.
    let soup = unsafe { &*arguments.user.cast::<Soup>() };
    let sphere = soup.spheres.get(arguments.primitive as usize)?;
    let vector = |first: usize| Vec3::new(field(first), field(first + 1), field(first + 2));
    let ray = Ray { origin: vector(0), direction: vector(4), t_min: field(3), t_max: field(8) };
    sphere.intersect(&ray, ray.t_min, ray.t_max)
}
