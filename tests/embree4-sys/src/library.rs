//! Finding the shared library and calling into it.

use std::ffi::{c_char, c_int, c_void};
use std::fmt;
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::OnceLock;

use crate::layout::*;

/// Names an Embree library explicitly.
pub const LIBRARY_VARIABLE: &str = "EMBREE_LIB";

/// Why Embree is not usable.
#[derive(Clone, Debug)]
pub enum LoadError {
    /// No library was found; what was tried.
    NotFound(Vec<String>),
    /// A library lacks a function of Embree 4.
    Incomplete {
        /// Which library.
        library: String,
        /// What the loader said.
        reason: String,
    },
    /// A library has Embree's functions, but of another major version.
    Version {
        /// Which library.
        library: String,
        /// Its major version.
        major: isize,
    },
    /// A library loads, but has no device to ask for its version.
    NoDevice {
        /// Which library.
        library: String,
        /// Its error code.
        code: RTCError,
    },
}

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFound(tried) => write!(
                f,
                "Embree 4 was not found (tried: {}); run `cargo xtask setup`, or set \
                 {LIBRARY_VARIABLE} to the library's path",
                tried.join("; ")
            ),
            Self::Incomplete { library, reason } => write!(
                f,
                "{library} is not a usable Embree 4: {reason}; run `cargo xtask setup`, or set \
                 {LIBRARY_VARIABLE} to another"
            ),
            Self::Version { library, major } => write!(
                f,
                "{library} is Embree {major}, not 4; run `cargo xtask setup`, or set \
                 {LIBRARY_VARIABLE} to an Embree 4"
            ),
            Self::NoDevice { library, code } => write!(
                f,
                "{library} makes no device ({code:?}); run `cargo xtask setup`, or set \
                 {LIBRARY_VARIABLE} to another"
            ),
        }
    }
}

impl std::error::Error for LoadError {}

macro_rules! functions {
    ($($(#[$doc:meta])* fn $name:ident($($argument:ident: $ty:ty),* $(,)?) $(-> $result:ty)?;)*) => {
        /// The functions of a loaded library.
        #[allow(missing_docs)]
        pub struct Embree {
            path: PathBuf,
            $(pub $name: unsafe extern "C" fn($($ty),*) $(-> $result)?,)*
            // Keeps the code mapped.
            _library: libloading::Library,
        }

        impl Embree {
            fn resolve(library: libloading::Library, path: PathBuf) -> Result<Self, LoadError> {
                $(
                    // SAFETY: the signature is that of the C header.
                    let $name = *unsafe {
                        library.get::<unsafe extern "C" fn($($ty),*) $(-> $result)?>(
                            concat!(stringify!($name), "\0").as_bytes(),
                        )
                    }
                    .map_err(|e| LoadError::Incomplete {
                        library: path.display().to_string(),
                        reason: e.to_string(),
                    })?;
                )*
                Ok(Self { path, $($name,)* _library: library })
            }
        }

        $(
            $(#[$doc])*
            ///
            /// # Safety
            /// The contract of the C function of this name.
            ///
            /// # Panics
            /// If Embree is not there; [`load`] says so without a panic.
            #[allow(clippy::missing_safety_doc)]
            #[inline]
            pub unsafe fn $name($($argument: $ty),*) $(-> $result)? {
                // SAFETY: the caller's.
                unsafe { (embree().$name)($($argument),*) }
            }
        )*
    };
}

functions! {
    /// Creates a device; null on failure.
    fn rtcNewDevice(config: *const c_char) -> RTCDevice;
    /// Gives a device back.
    fn rtcReleaseDevice(device: RTCDevice);
    /// Reads and clears the last error.
    fn rtcGetDeviceError(device: RTCDevice) -> RTCError;
    /// Reads a property.
    fn rtcGetDeviceProperty(device: RTCDevice, property: RTCDeviceProperty) -> isize;
    /// Sets the error callback.
    fn rtcSetDeviceErrorFunction(device: RTCDevice, function: RTCErrorFunction, user: *mut c_void);
    /// Sets the callback that hears of memory.
    fn rtcSetDeviceMemoryMonitorFunction(
        device: RTCDevice,
        function: RTCMemoryMonitorFunction,
        user: *mut c_void,
    );
    /// Creates a scene.
    fn rtcNewScene(device: RTCDevice) -> RTCScene;
    /// Gives a scene back.
    fn rtcReleaseScene(scene: RTCScene);
    /// Sets the flags, robust mode among them.
    fn rtcSetSceneFlags(scene: RTCScene, flags: RTCSceneFlags);
    /// Sets the build quality.
    fn rtcSetSceneBuildQuality(scene: RTCScene, quality: RTCBuildQuality);
    /// Builds the BVH.
    fn rtcCommitScene(scene: RTCScene);
    /// The box of everything.
    fn rtcGetSceneBounds(scene: RTCScene, bounds: *mut RTCBounds);
    /// Creates a geometry.
    fn rtcNewGeometry(device: RTCDevice, kind: RTCGeometryType) -> RTCGeometry;
    /// Gives a geometry back.
    fn rtcReleaseGeometry(geometry: RTCGeometry);
    /// Allocates a buffer of the geometry.
    fn rtcSetNewGeometryBuffer(
        geometry: RTCGeometry,
        kind: RTCBufferType,
        slot: u32,
        format: RTCFormat,
        stride: usize,
        count: usize,
    ) -> *mut c_void;
    /// Ends the changes to a geometry.
    fn rtcCommitGeometry(geometry: RTCGeometry);
    /// Adds a geometry to a scene.
    fn rtcAttachGeometry(scene: RTCScene, geometry: RTCGeometry) -> u32;
    /// Number of primitives of a user geometry.
    fn rtcSetGeometryUserPrimitiveCount(geometry: RTCGeometry, count: u32);
    /// Pointer passed to a user geometry's callbacks.
    fn rtcSetGeometryUserData(geometry: RTCGeometry, data: *mut c_void);
    /// Bounds callback of a user geometry.
    fn rtcSetGeometryBoundsFunction(
        geometry: RTCGeometry,
        function: RTCBoundsFunction,
        data: *mut c_void,
    );
    /// Intersection callback of a user geometry.
    fn rtcSetGeometryIntersectFunction(geometry: RTCGeometry, function: RTCIntersectFunctionN);
    /// Closest hit of one ray.
    fn rtcIntersect1(scene: RTCScene, rayhit: *mut RTCRayHit, args: *mut RTCIntersectArguments);
    /// Closest hits of four rays.
    fn rtcIntersect4(
        valid: *const c_int,
        scene: RTCScene,
        rayhit: *mut RTCRayHit4,
        args: *mut RTCIntersectArguments,
    );
    /// Closest hits of eight rays.
    fn rtcIntersect8(
        valid: *const c_int,
        scene: RTCScene,
        rayhit: *mut RTCRayHit8,
        args: *mut RTCIntersectArguments,
    );
    /// Closest hits of sixteen rays.
    fn rtcIntersect16(
        valid: *const c_int,
        scene: RTCScene,
        rayhit: *mut RTCRayHit16,
        args: *mut RTCIntersectArguments,
    );
    /// Whether one ray hits anything: `tfar` becomes -inf.
    fn rtcOccluded1(scene: RTCScene, ray: *mut RTCRay, args: *mut RTCOccludedArguments);
    /// The same for four rays.
    fn rtcOccluded4(
        valid: *const c_int,
        scene: RTCScene,
        ray: *mut RTCRay4,
        args: *mut RTCOccludedArguments,
    );
    /// The same for eight rays.
    fn rtcOccluded8(
        valid: *const c_int,
        scene: RTCScene,
        ray: *mut RTCRay8,
        args: *mut RTCOccludedArguments,
    );
    /// The same for sixteen rays.
    fn rtcOccluded16(
        valid: *const c_int,
        scene: RTCScene,
        ray: *mut RTCRay16,
        args: *mut RTCOccludedArguments,
    );
}

impl Embree {
    /// Where the library was found.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Embree 3 has functions of the same names that take other arguments, so
    /// that all names resolve says nothing about the version.
    fn check_version(self) -> Result<Self, LoadError> {
        let library = self.path.display().to_string();
        // SAFETY: these four are the same in every version; the device is
        // checked and released once.
        let major = unsafe {
            let device = (self.rtcNewDevice)(ptr::null());
            if device.is_null() {
                let code = (self.rtcGetDeviceError)(ptr::null_mut());
                return Err(LoadError::NoDevice { library, code });
            }
            let major = (self.rtcGetDeviceProperty)(device, RTCDeviceProperty::VERSION_MAJOR);
            (self.rtcReleaseDevice)(device);
            major
        };
        if major == 4 {
            Ok(self)
        } else {
            Err(LoadError::Version { library, major })
        }
    }
}

/// The library, loaded once.
///
/// # Errors
/// If none is found or the one found is not Embree 4.
pub fn load() -> Result<&'static Embree, LoadError> {
    static EMBREE: OnceLock<Result<Embree, LoadError>> = OnceLock::new();
    EMBREE
        .get_or_init(|| {
            let mut tried = Vec::new();
            for candidate in candidates() {
                // SAFETY: Embree's initialisers are those of an ordinary
                // C++ library.
                match unsafe { libloading::Library::new(&candidate) } {
                    Ok(library) => {
                        return Embree::resolve(library, candidate).and_then(Embree::check_version);
                    }
                    Err(error) => tried.push(format!("{}: {error}", candidate.display())),
                }
            }
            Err(LoadError::NotFound(tried))
        })
        .as_ref()
        .map_err(Clone::clone)
}

fn embree() -> &'static Embree {
    match load() {
        Ok(embree) => embree,
        Err(error) => panic!("{error}"),
    }
}

/// In this order: the variable, `target/embree`, the system.
fn candidates() -> Vec<PathBuf> {
    if let Some(named) = std::env::var_os(LIBRARY_VARIABLE) {
        return vec![named.into()];
    }
    let mut found = Vec::new();
    for folder in target_folders() {
        collect(&folder.join("embree"), 3, &mut found);
    }
    found.extend(
        if cfg!(target_os = "macos") {
            &[
                "libembree4.4.dylib",
                "libembree4.dylib",
                "/opt/homebrew/lib/libembree4.dylib",
                "/usr/local/lib/libembree4.dylib",
            ][..]
        } else if cfg!(windows) {
            &["embree4.dll"][..]
        } else {
            &["libembree4.so.4", "libembree4.so"][..]
        }
        .iter()
        .map(PathBuf::from),
    );
    found
}

/// Where cargo may have put `target`.
fn target_folders() -> Vec<PathBuf> {
    let mut folders = Vec::new();
    if let Some(folder) = std::env::var_os("CARGO_TARGET_DIR") {
        folders.push(PathBuf::from(folder));
    }
    let mut starts = vec![PathBuf::from(env!("CARGO_MANIFEST_DIR"))];
    starts.extend(std::env::current_dir());
    starts.extend(std::env::current_exe());
    for start in starts {
        folders.extend(start.ancestors().map(|folder| folder.join("target")));
    }
    folders.retain(|folder| folder.join("embree").is_dir());
    folders.dedup();
    folders
}

fn collect(folder: &Path, depth: usize, out: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            if depth > 0 {
                collect(&path, depth - 1, out);
            }
            continue;
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let library = name.contains(".so") || name.ends_with(".dylib") || name.ends_with(".dll");
        if library && name.contains("embree4") {
            out.push(path);
        }
    }
}
