//! Types, by the C headers' names. Layout: Embree 4.3 and later.

use std::ffi::{c_char, c_int, c_void};
use std::mem::{align_of, offset_of, size_of};

macro_rules! handle {
    ($(#[$doc:meta])* $name:ident, $opaque:ident) => {
        #[doc(hidden)]
        #[repr(C)]
        pub struct $opaque {
            _private: [u8; 0],
        }
        $(#[$doc])*
        pub type $name = *mut $opaque;
    };
}

handle!(
    /// A device.
    RTCDevice, RTCDeviceTy
);
handle!(
    /// A scene.
    RTCScene, RTCSceneTy
);
handle!(
    /// A geometry.
    RTCGeometry, RTCGeometryTy
);

macro_rules! constants {
    ($(#[$doc:meta])* $name:ident { $($constant:ident = $value:expr),* $(,)? }) => {
        $(#[$doc])*
        #[repr(transparent)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub struct $name(pub u32);
        impl $name {
            $(
                #[doc = concat!("`", stringify!($constant), "` of the C header.")]
                pub const $constant: Self = Self($value);
            )*
        }
        impl std::ops::BitOr for $name {
            type Output = Self;
            fn bitor(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }
        }
    };
}

constants!(
    /// What went wrong.
    RTCError {
        NONE = 0, UNKNOWN = 1, INVALID_ARGUMENT = 2, INVALID_OPERATION = 3,
        OUT_OF_MEMORY = 4, UNSUPPORTED_CPU = 5, CANCELLED = 6,
    }
);
constants!(
    /// How much time to spend on the BVH.
    RTCBuildQuality { LOW = 0, MEDIUM = 1, HIGH = 2, REFIT = 3 }
);
constants!(
    /// Properties of a scene.
    RTCSceneFlags {
        NONE = 0, DYNAMIC = 1, COMPACT = 2, ROBUST = 4, FILTER_FUNCTION_IN_ARGUMENTS = 8,
    }
);
constants!(
    /// Kind of a geometry.
    RTCGeometryType { TRIANGLE = 0, QUAD = 1, USER = 120, INSTANCE = 121 }
);
constants!(
    /// What a buffer holds.
    RTCBufferType { INDEX = 0, VERTEX = 1 }
);
constants!(
    /// Element type of a buffer.
    RTCFormat { UINT3 = 0x5003, FLOAT3 = 0x9003 }
);
constants!(
    /// What to ask a device about itself.
    RTCDeviceProperty { VERSION = 0, VERSION_MAJOR = 1, VERSION_MINOR = 2, VERSION_PATCH = 3 }
);
constants!(
    /// How the rays of a query relate.
    RTCRayQueryFlags { INCOHERENT = 0, COHERENT = 1 << 16 }
);
constants!(
    /// Which parts of the traversal a query needs.
    RTCFeatureFlags { NONE = 0, ALL = 0xffff_ffff }
);

// The wrapper takes these defaults for "leave the scene as it is".
impl Default for RTCBuildQuality {
    fn default() -> Self {
        Self::MEDIUM
    }
}

impl Default for RTCSceneFlags {
    fn default() -> Self {
        Self::NONE
    }
}

/// No geometry: a miss.
pub const RTC_INVALID_GEOMETRY_ID: u32 = 0xffff_ffff;

/// A box.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug, Default)]
#[allow(missing_docs)]
pub struct RTCBounds {
    pub lower_x: f32,
    pub lower_y: f32,
    pub lower_z: f32,
    pub align0: f32,
    pub upper_x: f32,
    pub upper_y: f32,
    pub upper_z: f32,
    pub align1: f32,
}

/// One ray.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RTCRay {
    pub org_x: f32,
    pub org_y: f32,
    pub org_z: f32,
    pub tnear: f32,
    pub dir_x: f32,
    pub dir_y: f32,
    pub dir_z: f32,
    pub time: f32,
    pub tfar: f32,
    pub mask: u32,
    pub id: u32,
    pub flags: u32,
}

impl Default for RTCRay {
    /// A ray without end that every geometry's mask lets through.
    fn default() -> Self {
        Self {
            org_x: 0.0,
            org_y: 0.0,
            org_z: 0.0,
            tnear: 0.0,
            dir_x: 0.0,
            dir_y: 0.0,
            dir_z: 0.0,
            time: 0.0,
            tfar: f32::INFINITY,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        }
    }
}

/// What one ray hit. The library's own structure goes on with an
/// instance-primitive id; see [`RTCRayHit`].
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RTCHit {
    pub Ng_x: f32,
    pub Ng_y: f32,
    pub Ng_z: f32,
    pub u: f32,
    pub v: f32,
    pub primID: u32,
    pub geomID: u32,
    pub instID: [u32; 1],
}

impl Default for RTCHit {
    /// No hit: `embree4-rs` starts every query with this and tells a miss by
    /// the geometry's id.
    fn default() -> Self {
        Self {
            Ng_x: 0.0,
            Ng_y: 0.0,
            Ng_z: 0.0,
            u: 0.0,
            v: 0.0,
            primID: RTC_INVALID_GEOMETRY_ID,
            geomID: RTC_INVALID_GEOMETRY_ID,
            instID: [RTC_INVALID_GEOMETRY_ID],
        }
    }
}

/// A ray and what it hit: 96 bytes.
///
/// `embree4-rs` builds this and [`RTCHit`] member by member, so the id that
/// Embree 4.3 and later writes at byte 80 cannot be a member. The alignment
/// rounds the size up to 96 and leaves that byte inside the structure.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, Default)]
#[allow(missing_docs)]
pub struct RTCRayHit {
    pub ray: RTCRay,
    pub hit: RTCHit,
}

/// Where Embree 4.3 and later writes the instance-primitive id.
pub const INST_PRIM_ID_OFFSET: usize = 80;

macro_rules! packet {
    ($n:literal, $align:literal, $ray:ident, $hit:ident, $both:ident) => {
        #[doc = concat!("A packet of ", $n, " rays.")]
        #[repr(C, align($align))]
        #[derive(Clone, Copy, Debug)]
        #[allow(missing_docs)]
        pub struct $ray {
            pub org_x: [f32; $n],
            pub org_y: [f32; $n],
            pub org_z: [f32; $n],
            pub tnear: [f32; $n],
            pub dir_x: [f32; $n],
            pub dir_y: [f32; $n],
            pub dir_z: [f32; $n],
            pub time: [f32; $n],
            pub tfar: [f32; $n],
            pub mask: [u32; $n],
            pub id: [u32; $n],
            pub flags: [u32; $n],
        }

        #[doc = concat!("What a packet of ", $n, " rays hit.")]
        #[repr(C, align($align))]
        #[derive(Clone, Copy, Debug)]
        #[allow(missing_docs)]
        pub struct $hit {
            pub Ng_x: [f32; $n],
            pub Ng_y: [f32; $n],
            pub Ng_z: [f32; $n],
            pub u: [f32; $n],
            pub v: [f32; $n],
            pub primID: [u32; $n],
            pub geomID: [u32; $n],
            pub instID: [[u32; $n]; 1],
            pub instPrimID: [[u32; $n]; 1],
        }

        #[doc = concat!("A packet of ", $n, " rays and what they hit.")]
        #[repr(C, align($align))]
        #[derive(Clone, Copy, Debug)]
        #[allow(missing_docs)]
        pub struct $both {
            pub ray: $ray,
            pub hit: $hit,
        }

        impl Default for $ray {
            fn default() -> Self {
                Self {
                    org_x: [0.0; $n],
                    org_y: [0.0; $n],
                    org_z: [0.0; $n],
                    tnear: [0.0; $n],
                    dir_x: [0.0; $n],
                    dir_y: [0.0; $n],
                    dir_z: [0.0; $n],
                    time: [0.0; $n],
                    tfar: [0.0; $n],
                    mask: [0; $n],
                    id: [0; $n],
                    flags: [0; $n],
                }
            }
        }

        impl Default for $hit {
            fn default() -> Self {
                Self {
                    Ng_x: [0.0; $n],
                    Ng_y: [0.0; $n],
                    Ng_z: [0.0; $n],
                    u: [0.0; $n],
                    v: [0.0; $n],
                    primID: [RTC_INVALID_GEOMETRY_ID; $n],
                    geomID: [RTC_INVALID_GEOMETRY_ID; $n],
                    instID: [[RTC_INVALID_GEOMETRY_ID; $n]; 1],
                    instPrimID: [[RTC_INVALID_GEOMETRY_ID; $n]; 1],
                }
            }
        }

        impl Default for $both {
            fn default() -> Self {
                Self {
                    ray: $ray::default(),
                    hit: $hit::default(),
                }
            }
        }

        const _: () = {
            assert!(size_of::<$ray>() == 12 * 4 * $n);
            assert!(size_of::<$hit>() == 9 * 4 * $n);
            assert!(size_of::<$both>() >= 21 * 4 * $n);
            assert!(align_of::<$ray>() == $align && align_of::<$both>() == $align);
            assert!(offset_of!($hit, instPrimID) == 8 * 4 * $n);
            assert!(offset_of!($both, hit) == size_of::<$ray>());
        };
    };
}

packet!(4, 16, RTCRay4, RTCHit4, RTCRayHit4);
packet!(8, 32, RTCRay8, RTCHit8, RTCRayHit8);
packet!(16, 64, RTCRay16, RTCHit16, RTCRayHit16);

/// What a query passes on to callbacks.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RTCRayQueryContext {
    pub instID: [u32; 1],
    pub instPrimID: [u32; 1],
}

/// The filter callback; we never set one.
pub type RTCFilterFunctionN = Option<unsafe extern "C" fn(*const c_void)>;
/// Bounds callback of a user geometry.
pub type RTCBoundsFunction = Option<unsafe extern "C" fn(*const RTCBoundsFunctionArguments)>;
/// Intersection callback of a user geometry.
pub type RTCIntersectFunctionN =
    Option<unsafe extern "C" fn(*const RTCIntersectFunctionNArguments)>;

/// Options of a closest-hit query.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RTCIntersectArguments {
    pub flags: RTCRayQueryFlags,
    pub feature_mask: RTCFeatureFlags,
    pub context: *mut RTCRayQueryContext,
    pub filter: RTCFilterFunctionN,
    pub intersect: RTCIntersectFunctionN,
    /// Read only by libraries built with a minimal width of curves.
    pub minWidthDistanceFactor: f32,
}

impl Default for RTCIntersectArguments {
    fn default() -> Self {
        Self {
            flags: RTCRayQueryFlags::INCOHERENT,
            feature_mask: RTCFeatureFlags::ALL,
            context: std::ptr::null_mut(),
            filter: None,
            intersect: None,
            minWidthDistanceFactor: 0.0,
        }
    }
}

/// Options of an any-hit query: the same, with the callback of occlusion.
pub type RTCOccludedArguments = RTCIntersectArguments;

/// What a bounds callback gets.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RTCBoundsFunctionArguments {
    pub geometryUserPtr: *mut c_void,
    pub primID: u32,
    pub timeStep: u32,
    pub bounds_o: *mut RTCBounds,
}

/// What an intersection callback gets.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RTCIntersectFunctionNArguments {
    pub valid: *mut c_int,
    pub geometryUserPtr: *mut c_void,
    pub primID: u32,
    pub context: *mut RTCRayQueryContext,
    pub rayhit: *mut c_void,
    pub N: u32,
    pub geomID: u32,
}

/// Error callback of a device.
pub type RTCErrorFunction =
    Option<unsafe extern "C" fn(userPtr: *mut c_void, code: RTCError, message: *const c_char)>;

/// Memory callback of a device: bytes that it takes, negative where it gives them
/// back, before or after it does; with `false` it gives up.
pub type RTCMemoryMonitorFunction =
    Option<unsafe extern "C" fn(userPtr: *mut c_void, bytes: isize, post: bool) -> bool>;

const _: () = {
    assert!(size_of::<RTCRay>() == 48 && align_of::<RTCRay>() == 16);
    assert!(size_of::<RTCHit>() == 32 && align_of::<RTCHit>() == 16);
    // The library writes four bytes at INST_PRIM_ID_OFFSET on every hit.
    assert!(size_of::<RTCRayHit>() == 96 && align_of::<RTCRayHit>() >= 16);
    assert!(size_of::<RTCRayHit>() >= INST_PRIM_ID_OFFSET + 4);
    assert!(offset_of!(RTCRayHit, hit) == 48);
    assert!(offset_of!(RTCRay, tfar) == 32 && offset_of!(RTCRay, flags) == 44);
    assert!(offset_of!(RTCHit, primID) == 20 && offset_of!(RTCHit, instID) == 28);
    assert!(size_of::<RTCRayQueryContext>() == 8);
    assert!(size_of::<RTCBounds>() == 32);
    assert!(offset_of!(RTCIntersectArguments, feature_mask) == 4);
    assert!(offset_of!(RTCIntersectArguments, context) == 8);
    assert!(offset_of!(RTCIntersectArguments, filter) == 8 + size_of::<usize>());
    assert!(offset_of!(RTCIntersectArguments, intersect) == 8 + 2 * size_of::<usize>());
};
