//! A small safe layer over Embree: scenes of one triangle mesh, single rays
//! and packets, closest and any hit, default and robust mode.
//!
//! `embree4-rs` has neither occlusion nor packets, asks for the device's error
//! on every ray and keeps its scene handle to itself, so timing and the hard
//! set go through this; the tests check once that both agree.

use std::ffi::{c_int, c_void};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::time::{Duration, Instant};

use embree4_sys::{
    Embree, LoadError, RTC_INVALID_GEOMETRY_ID, RTCBufferType, RTCBuildQuality, RTCDevice,
    RTCDeviceProperty, RTCError, RTCFormat, RTCGeometryType, RTCIntersectArguments,
    RTCOccludedArguments, RTCRay, RTCRayHit, RTCRayHit16, RTCRayQueryFlags, RTCScene,
    RTCSceneFlags,
};

/// How to build the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EmbreeOptions {
    /// Embree's robust mode: watertight edges, a little slower.
    pub robust: bool,
    /// Build quality. `HIGH` is ignored together with `robust`.
    pub quality: RTCBuildQuality,
    /// Build threads; 0 for all.
    pub threads: u32,
}

impl Default for EmbreeOptions {
    fn default() -> Self {
        Self {
            robust: false,
            quality: RTCBuildQuality::MEDIUM,
            threads: 0,
        }
    }
}

/// Why there is no scene.
#[derive(Debug, thiserror::Error)]
pub enum EmbreeError {
    /// No library.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Embree refused something.
    #[error("Embree reports {code:?} while {doing}")]
    Device {
        /// Its error code.
        code: RTCError,
        /// What was being done.
        doing: &'static str,
    },
    /// An index points past the vertices.
    #[error("triangle {triangle} has vertex {index} of {count}")]
    Index {
        /// Triangle.
        triangle: usize,
        /// Its index.
        index: u32,
        /// Number of vertices.
        count: usize,
    },
}

/// A closest hit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EmbreeHit {
    /// Distance in units of the direction's length.
    pub t: f32,
    /// Weight of the triangle's second vertex.
    pub u: f32,
    /// Weight of its third.
    pub v: f32,
    /// Index of the triangle.
    pub primitive: u32,
}

/// One ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmbreeRay {
    /// Origin.
    pub origin: [f32; 3],
    /// Direction, of any length.
    pub direction: [f32; 3],
    /// Start of the segment.
    pub t_min: f32,
    /// Its end, included.
    pub t_max: f32,
}

/// A committed scene of one triangle mesh.
pub struct EmbreeScene {
    embree: &'static Embree,
    device: RTCDevice,
    scene: RTCScene,
    build: Duration,
    memory: usize,
    /// What the device takes; it keeps the address.
    taken: Box<AtomicIsize>,
}

/// Counts what a device takes and gives back.
unsafe extern "C" fn count(taken: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: the pointer is that of `EmbreeScene::taken`, which lives as long as
    // the device.
    unsafe { &*taken.cast::<AtomicIsize>() }.fetch_add(bytes, Ordering::Relaxed);
    true
}

// SAFETY: a committed scene is only read, which Embree allows from any number
// of threads; device and scene are released by the last owner.
unsafe impl Send for EmbreeScene {}
// SAFETY: as above.
unsafe impl Sync for EmbreeScene {}

impl EmbreeScene {
    /// Builds a scene.
    ///
    /// # Errors
    /// If Embree is missing or refuses, or an index is out of range.
    pub fn new(
        positions: &[[f32; 3]],
        indices: &[[u32; 3]],
        options: EmbreeOptions,
    ) -> Result<Self, EmbreeError> {
        for (triangle, corners) in indices.iter().enumerate() {
            for &index in corners {
                if index as usize >= positions.len() {
                    return Err(EmbreeError::Index {
                        triangle,
                        index,
                        count: positions.len(),
                    });
                }
            }
        }
        let embree = embree4_sys::load()?;
        let config = std::ffi::CString::new(format!("threads={}", options.threads))
            .expect("no NUL in a number");
        // SAFETY: every handle is checked before use; the buffers that Embree
        // allocates have the sizes asked for (and its own padding behind).
        unsafe {
            let device = (embree.rtcNewDevice)(config.as_ptr());
            if device.is_null() {
                let code = (embree.rtcGetDeviceError)(null_mut());
                return Err(EmbreeError::Device {
                    code,
                    doing: "creating a device",
                });
            }
            let taken = Box::new(AtomicIsize::new(0));
            let user = std::ptr::from_ref(&*taken).cast_mut().cast::<c_void>();
            (embree.rtcSetDeviceMemoryMonitorFunction)(device, Some(count), user);
            let scene = (embree.rtcNewScene)(device);
            let mut this = Self {
                embree,
                device,
                scene,
                build: Duration::ZERO,
                memory: 0,
                taken,
            };
            (embree.rtcSetSceneBuildQuality)(scene, options.quality);
            if options.robust {
                (embree.rtcSetSceneFlags)(scene, RTCSceneFlags::ROBUST);
            }
            this.check("creating a scene")?;
            let start = Instant::now();
            let geometry = (embree.rtcNewGeometry)(device, RTCGeometryType::TRIANGLE);
            this.check("creating a geometry")?;
            // The scene owns it from here on, whatever fails.
            (embree.rtcAttachGeometry)(scene, geometry);
            (embree.rtcReleaseGeometry)(geometry);
            this.check("attaching a geometry")?;
            let vertices = (embree.rtcSetNewGeometryBuffer)(
                geometry,
                RTCBufferType::VERTEX,
                0,
                RTCFormat::FLOAT3,
                12,
                positions.len(),
            );
            let triangles = (embree.rtcSetNewGeometryBuffer)(
                geometry,
                RTCBufferType::INDEX,
                0,
                RTCFormat::UINT3,
                12,
                indices.len(),
            );
            this.check("allocating buffers")?;
            if !positions.is_empty() {
                vertices
                    .cast::<[f32; 3]>()
                    .copy_from_nonoverlapping(positions.as_ptr(), positions.len());
            }
            if !indices.is_empty() {
                triangles
                    .cast::<[u32; 3]>()
                    .copy_from_nonoverlapping(indices.as_ptr(), indices.len());
            }
            let before = this.taken.load(Ordering::Relaxed);
            (embree.rtcCommitGeometry)(geometry);
            (embree.rtcCommitScene)(scene);
            this.build = start.elapsed();
            let after = this.taken.load(Ordering::Relaxed);
            this.memory = usize::try_from(after - before).unwrap_or_default();
            this.check("building")?;
            Ok(this)
        }
    }

    fn check(&self, doing: &'static str) -> Result<(), EmbreeError> {
        // SAFETY: the device is alive.
        match unsafe { (self.embree.rtcGetDeviceError)(self.device) } {
            RTCError::NONE => Ok(()),
            code => Err(EmbreeError::Device { code, doing }),
        }
    }

    /// Wall-clock time of the build.
    #[must_use]
    pub fn build_time(&self) -> Duration {
        self.build
    }

    /// Bytes that the tree takes, without the vertices and indices that it was
    /// given, as Embree itself counts them.
    #[must_use]
    pub fn memory(&self) -> usize {
        self.memory
    }

    /// Version of the library, as `4.4.0`.
    #[must_use]
    pub fn version(&self) -> String {
        let number = |property| {
            // SAFETY: the device is alive.
            unsafe { (self.embree.rtcGetDeviceProperty)(self.device, property) }
        };
        format!(
            "{}.{}.{}",
            number(RTCDeviceProperty::VERSION_MAJOR),
            number(RTCDeviceProperty::VERSION_MINOR),
            number(RTCDeviceProperty::VERSION_PATCH)
        )
    }

    /// The closest hit in `[t_min, t_max]`.
    #[inline]
    #[must_use]
    pub fn intersect(&self, ray: &EmbreeRay) -> Option<EmbreeHit> {
        let mut both = RTCRayHit {
            ray: raw_ray(ray),
            hit: Default::default(),
        };
        both.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        // SAFETY: the structure has the size that Embree 4.3+ writes.
        unsafe { (self.embree.rtcIntersect1)(self.scene, &raw mut both, null_mut()) };
        (both.hit.geomID != RTC_INVALID_GEOMETRY_ID).then_some(EmbreeHit {
            t: both.ray.tfar,
            u: both.hit.u,
            v: both.hit.v,
            primitive: both.hit.primID,
        })
    }

    /// Whether anything is hit in `[t_min, t_max]`.
    #[inline]
    #[must_use]
    pub fn occluded(&self, ray: &EmbreeRay) -> bool {
        let mut raw = raw_ray(ray);
        // SAFETY: as above.
        unsafe { (self.embree.rtcOccluded1)(self.scene, &raw mut raw, null_mut()) };
        raw.tfar < 0.0 && raw.tfar.is_infinite()
    }

    /// Closest hits of up to 16 rays at once.
    ///
    /// # Panics
    /// If there are more than 16.
    #[must_use]
    pub fn intersect16(&self, rays: &[EmbreeRay], coherent: bool) -> [Option<EmbreeHit>; 16] {
        let (valid, mut both) = packet(rays);
        let mut arguments = RTCIntersectArguments {
            flags: query_flags(coherent),
            ..Default::default()
        };
        // SAFETY: packet structures with the 4.3+ layout, alive for the call.
        unsafe {
            (self.embree.rtcIntersect16)(
                valid.as_ptr(),
                self.scene,
                &raw mut both,
                &raw mut arguments,
            );
        }
        std::array::from_fn(|i| {
            (i < rays.len() && both.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID).then(|| EmbreeHit {
                t: both.ray.tfar[i],
                u: both.hit.u[i],
                v: both.hit.v[i],
                primitive: both.hit.primID[i],
            })
        })
    }

    /// Whether each of up to 16 rays hits anything.
    ///
    /// # Panics
    /// If there are more than 16.
    #[must_use]
    pub fn occluded16(&self, rays: &[EmbreeRay], coherent: bool) -> [bool; 16] {
        let (valid, mut both) = packet(rays);
        let mut arguments = RTCOccludedArguments {
            flags: query_flags(coherent),
            ..Default::default()
        };
        // SAFETY: as above.
        unsafe {
            (self.embree.rtcOccluded16)(
                valid.as_ptr(),
                self.scene,
                &raw mut both.ray,
                &raw mut arguments,
            );
        }
        std::array::from_fn(|i| i < rays.len() && both.ray.tfar[i] == f32::NEG_INFINITY)
    }
}

impl Drop for EmbreeScene {
    fn drop(&mut self) {
        // SAFETY: nothing else holds them.
        unsafe {
            (self.embree.rtcReleaseScene)(self.scene);
            (self.embree.rtcReleaseDevice)(self.device);
        }
    }
}

fn query_flags(coherent: bool) -> RTCRayQueryFlags {
    if coherent {
        RTCRayQueryFlags::COHERENT
    } else {
        RTCRayQueryFlags::INCOHERENT
    }
}

#[repr(align(64))]
struct Valid([c_int; 16]);

impl Valid {
    fn as_ptr(&self) -> *const c_int {
        self.0.as_ptr()
    }
}

fn packet(rays: &[EmbreeRay]) -> (Valid, RTCRayHit16) {
    assert!(
        rays.len() <= 16,
        "a packet holds 16 rays, not {}",
        rays.len()
    );
    let mut valid = Valid([0; 16]);
    let mut both = RTCRayHit16::default();
    for (i, ray) in rays.iter().enumerate() {
        valid.0[i] = -1;
        both.ray.org_x[i] = ray.origin[0];
        both.ray.org_y[i] = ray.origin[1];
        both.ray.org_z[i] = ray.origin[2];
        both.ray.dir_x[i] = ray.direction[0];
        both.ray.dir_y[i] = ray.direction[1];
        both.ray.dir_z[i] = ray.direction[2];
        both.ray.tnear[i] = ray.t_min;
        both.ray.tfar[i] = ray.t_max;
        both.ray.mask[i] = u32::MAX;
    }
    (valid, both)
}

fn raw_ray(ray: &EmbreeRay) -> RTCRay {
    RTCRay {
        org_x: ray.origin[0],
        org_y: ray.origin[1],
        org_z: ray.origin[2],
        tnear: ray.t_min,
        dir_x: ray.direction[0],
        dir_y: ray.direction[1],
        dir_z: ray.direction[2],
        time: 0.0,
        tfar: ray.t_max,
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}
