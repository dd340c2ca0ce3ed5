//! Our declarations of Embree are those of the library that is loaded.

use std::ffi::c_int;
use std::mem::{MaybeUninit, align_of, offset_of, size_of, size_of_val};

use embree4_rs::geometry::TriangleMeshGeometry;
use embree4_rs::{CommittedScene, Device, Scene, SceneOptions};
use embree4_sys::{
    INST_PRIM_ID_OFFSET, RTC_INVALID_GEOMETRY_ID, RTCBuildQuality, RTCDeviceProperty, RTCHit,
    RTCRay, RTCRay4, RTCRay8, RTCRay16, RTCRayHit, RTCRayHit4, RTCRayHit8, RTCRayHit16,
    RTCSceneFlags,
};
use raytwin_tests::embree::{EmbreeOptions, EmbreeRay, EmbreeScene};
use raytwin_tests::rays::meshes::{Random, displaced_sphere};

// Two triangles of a square at z = 0.
const POSITIONS: [[f32; 3]; 4] = [
    [-1.0, -1.0, 0.0],
    [1.0, -1.0, 0.0],
    [1.0, 1.0, 0.0],
    [-1.0, 1.0, 0.0],
];
const INDICES: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

fn ray(x: f32, y: f32) -> EmbreeRay {
    EmbreeRay {
        origin: [x, y, 2.0],
        direction: [0.0, 0.0, -1.0],
        t_min: 0.0,
        t_max: 100.0,
    }
}

fn raw(x: f32, y: f32) -> RTCRay {
    RTCRay {
        org_x: x,
        org_y: y,
        org_z: 2.0,
        dir_z: -1.0,
        tfar: 100.0,
        mask: u32::MAX,
        ..Default::default()
    }
}

/// A scene, or a failure that says how to get Embree.
fn scene(positions: &[[f32; 3]], indices: &[[u32; 3]], options: EmbreeOptions) -> EmbreeScene {
    EmbreeScene::new(positions, indices, options).unwrap_or_else(|error| panic!("{error}"))
}

/// Handles of a raw scene, released on drop.
struct RawScene {
    scene: embree4_sys::RTCScene,
    device: embree4_sys::RTCDevice,
}

impl RawScene {
    fn new() -> Self {
        use embree4_sys::*;
        let embree = match load() {
            Ok(embree) => embree,
            Err(error) => panic!("{error}"),
        };
        // SAFETY: plain use of the C interface, each buffer of its stated size.
        unsafe {
            let device = (embree.rtcNewDevice)(std::ptr::null());
            let scene = (embree.rtcNewScene)(device);
            let geometry = (embree.rtcNewGeometry)(device, RTCGeometryType::TRIANGLE);
            let vertices = (embree.rtcSetNewGeometryBuffer)(
                geometry,
                RTCBufferType::VERTEX,
                0,
                RTCFormat::FLOAT3,
                12,
                POSITIONS.len(),
            );
            vertices
                .cast::<[f32; 3]>()
                .copy_from_nonoverlapping(POSITIONS.as_ptr(), POSITIONS.len());
            let triangles = (embree.rtcSetNewGeometryBuffer)(
                geometry,
                RTCBufferType::INDEX,
                0,
                RTCFormat::UINT3,
                12,
                INDICES.len(),
            );
            triangles
                .cast::<[u32; 3]>()
                .copy_from_nonoverlapping(INDICES.as_ptr(), INDICES.len());
            (embree.rtcCommitGeometry)(geometry);
            (embree.rtcAttachGeometry)(scene, geometry);
            (embree.rtcReleaseGeometry)(geometry);
            (embree.rtcCommitScene)(scene);
            Self { scene, device }
        }
    }
}

impl Drop for RawScene {
    fn drop(&mut self) {
        // SAFETY: created above, released once.
        unsafe {
            embree4_sys::rtcReleaseScene(self.scene);
            embree4_sys::rtcReleaseDevice(self.device);
        }
    }
}

const CANARY: u8 = 0xa5;

/// Four rays that all must hit, `stride` bytes apart in one buffer: which of
/// them hit, and the buffer before and after.
fn trace_array(stride: usize) -> ([bool; 4], Vec<u8>, Vec<u8>) {
    let scene = RawScene::new();
    let mut storage = [const { MaybeUninit::<RTCRayHit>::uninit() }; 5];
    let size = size_of_val(&storage);
    let base = storage.as_mut_ptr().cast::<u8>();
    // The last call may write past its structure, not past the buffer.
    assert!(4 * stride + 16 <= size && stride.is_multiple_of(align_of::<RTCRay>()));
    let at = |i: usize| base.wrapping_add(i * stride);
    // SAFETY: every byte is initialised first; `at` stays inside the buffer
    // and on a multiple of the alignment, as asserted. `RTCRayHit` is only
    // pointed to, never made a reference.
    unsafe {
        base.write_bytes(CANARY, size);
        for (i, x) in [-0.6, -0.2, 0.2, 0.6].into_iter().enumerate() {
            at(i).cast::<RTCRay>().write(raw(x, 0.5 * x + 0.1));
            at(i)
                .add(offset_of!(RTCRayHit, hit))
                .cast::<RTCHit>()
                .write(RTCHit::default());
        }
        let before = std::slice::from_raw_parts(base, size).to_vec();
        for i in 0..4 {
            embree4_sys::rtcIntersect1(scene.scene, at(i).cast(), std::ptr::null_mut());
        }
        let after = std::slice::from_raw_parts(base, size).to_vec();
        let hits = std::array::from_fn(|i| {
            let hit = at(i).add(offset_of!(RTCRayHit, hit)).cast::<RTCHit>();
            hit.read().geomID != RTC_INVALID_GEOMETRY_ID
        });
        (hits, before, after)
    }
}

#[test]
fn an_array_of_hits_is_not_overwritten() {
    let stride = size_of::<RTCRayHit>();
    let (hits, before, after) = trace_array(stride);
    assert_eq!(hits, [true; 4], "every ray must hit");
    for (at, (old, new)) in before.iter().zip(&after).enumerate() {
        // The library may write the ray's end, the hit and the id after it.
        let written = at / stride < 4
            && (offset_of!(RTCRay, tfar)..INST_PRIM_ID_OFFSET + 4).contains(&(at % stride));
        assert!(written || old == new, "byte {at} was overwritten");
    }
}

/// The live control: the test above sees the defect of the published crate's
/// 80 bytes, because each hit spoils the origin of the ray behind it.
#[test]
fn the_published_layout_is_overwritten() {
    let (hits, before, after) = trace_array(80);
    let scene = RawScene::new();
    // SAFETY: the device is alive.
    let version = unsafe {
        embree4_sys::rtcGetDeviceProperty(scene.device, RTCDeviceProperty::VERSION_MINOR)
    };
    if version < 3 {
        // Before 4.3 there was no instance-primitive id.
        assert_eq!(hits, [true; 4]);
        return;
    }
    assert_eq!(hits, [true, false, true, false]);
    let spoiled = INST_PRIM_ID_OFFSET..INST_PRIM_ID_OFFSET + 4;
    assert_eq!(before[spoiled.clone()], (-0.2_f32).to_ne_bytes());
    assert_eq!(after[spoiled], [0xff; 4]);
}

/// The bytes of a structure without padding.
fn bytes<T: Copy>(value: &T) -> &[u8] {
    // SAFETY: the callers' types are arrays of four-byte words, all of them
    // initialised.
    unsafe { std::slice::from_raw_parts((&raw const *value).cast(), size_of::<T>()) }
}

macro_rules! packets_match_single_rays {
    ($name:ident, $n:literal, $ray:ident, $both:ident, $intersect:ident, $occluded:ident) => {
        /// Packets leave their neighbours alone, and say what single rays say.
        #[test]
        fn $name() {
            #[repr(align(64))]
            struct Valid([c_int; $n]);
            // Otherwise the structure has padding, which `bytes` must not read.
            assert_eq!(size_of::<$ray>(), 48 * $n);
            let scene = RawScene::new();
            let x = |lane: usize| -1.35 + 2.7 * (lane as f32 + 0.5) / $n as f32;
            let mut packet = <$both>::default();
            for lane in 0..$n {
                let one = raw(x(lane), 0.1);
                packet.ray.org_x[lane] = one.org_x;
                packet.ray.org_y[lane] = one.org_y;
                packet.ray.org_z[lane] = one.org_z;
                packet.ray.dir_z[lane] = one.dir_z;
                packet.ray.tfar[lane] = one.tfar;
                packet.ray.mask[lane] = one.mask;
            }
            // The second ray is switched off.
            let mut valid = Valid([-1; $n]);
            valid.0[1] = 0;
            let mut closest = [packet; 3];
            let mut any = [packet.ray; 3];
            // SAFETY: structures of the library's size and alignment.
            unsafe {
                embree4_sys::$intersect(
                    valid.0.as_ptr(),
                    scene.scene,
                    &raw mut closest[1],
                    std::ptr::null_mut(),
                );
                embree4_sys::$occluded(
                    valid.0.as_ptr(),
                    scene.scene,
                    &raw mut any[1],
                    std::ptr::null_mut(),
                );
            }
            for neighbour in [0, 2] {
                assert_eq!(bytes(&closest[neighbour].ray), bytes(&packet.ray));
                assert_eq!(bytes(&closest[neighbour].hit), bytes(&packet.hit));
                assert_eq!(bytes(&any[neighbour]), bytes(&packet.ray));
            }
            let mut hits = 0;
            for lane in 0..$n {
                let mut single = RTCRayHit {
                    ray: raw(x(lane), 0.1),
                    hit: RTCHit::default(),
                };
                if valid.0[lane] != 0 {
                    // SAFETY: as above.
                    unsafe {
                        embree4_sys::rtcIntersect1(
                            scene.scene,
                            &raw mut single,
                            std::ptr::null_mut(),
                        );
                    }
                }
                let hit = single.hit.geomID != RTC_INVALID_GEOMETRY_ID;
                hits += usize::from(hit);
                let found = &closest[1];
                assert_eq!(found.hit.geomID[lane], single.hit.geomID, "lane {lane}");
                assert_eq!(found.hit.primID[lane], single.hit.primID, "lane {lane}");
                assert_eq!(found.ray.tfar[lane], single.ray.tfar, "lane {lane}");
                let end = if hit { f32::NEG_INFINITY } else { 100.0 };
                assert_eq!(any[1].tfar[lane], end, "lane {lane}");
            }
            assert!(0 < hits && hits < $n - 1, "{hits} hits do not show much");
        }
    };
}

packets_match_single_rays!(
    packets_of_4,
    4,
    RTCRay4,
    RTCRayHit4,
    rtcIntersect4,
    rtcOccluded4
);
packets_match_single_rays!(
    packets_of_8,
    8,
    RTCRay8,
    RTCRayHit8,
    rtcIntersect8,
    rtcOccluded8
);
packets_match_single_rays!(
    packets_of_16,
    16,
    RTCRay16,
    RTCRayHit16,
    rtcIntersect16,
    rtcOccluded16
);

fn wrapper(flags: RTCSceneFlags) -> CommittedScene {
    // Never `Some(..)`: the wrapper passes a string without its NUL.
    let device = Device::try_new(None).expect("a device");
    let vertices = POSITIONS.map(|p| (p[0], p[1], p[2]));
    let indices = INDICES.map(|i| (i[0], i[1], i[2]));
    let mesh = TriangleMeshGeometry::try_new(&device, &vertices, &indices).expect("a mesh");
    let options = SceneOptions {
        build_quality: RTCBuildQuality::HIGH,
        flags,
    };
    let scene = Scene::try_new(device, options).expect("a scene");
    scene.attach_geometry(&mesh).expect("attached");
    scene.commit().expect("built")
}

#[test]
fn wrapper_and_raw_calls_agree() {
    for (robust, flags) in [(false, RTCSceneFlags::NONE), (true, RTCSceneFlags::ROBUST)] {
        let options = EmbreeOptions {
            robust,
            quality: RTCBuildQuality::HIGH,
            ..Default::default()
        };
        let ours = scene(&POSITIONS, &INDICES, options);
        let theirs = wrapper(flags);
        let mut hits = 0;
        for i in 0..400 {
            let (x, y) = (-1.5 + 0.15 * (i % 20) as f32, -1.5 + 0.15 * (i / 20) as f32);
            let expected = theirs
                .intersect_1(raw(x, y), None)
                .expect("no device error");
            let found = ours.intersect(&ray(x, y));
            assert_eq!(found.is_some(), expected.is_some(), "ray at {x}, {y}");
            if let (Some(a), Some(b)) = (found, expected) {
                hits += 1;
                assert_eq!((a.t, a.primitive), (b.ray.tfar, b.hit.primID));
                assert_eq!((a.u, a.v), (b.hit.u, b.hit.v));
            }
        }
        assert!(hits > 100, "only {hits} of 400 rays hit");
    }
}

/// Whether Embree may say this where the other is exact: it divides by a
/// reciprocal of 12 bits, of which each maker has its own, and one step of
/// Newton's. The step leaves `(1.5 * 2^-12)^2`, 1.125 of `f32::EPSILON`; its two
/// roundings and the product's are half of that each: 2.6 in all.
fn divided(found: f32, exact: f32) -> bool {
    let apart = (found - exact).abs() / (f32::EPSILON * exact);
    println!("{found} for {exact}: {apart} of 2.625 steps");
    apart <= 2.625
}

/// Each member means what we take it for, known from the square itself.
#[test]
fn a_hit_is_where_it_must_be() {
    for robust in [false, true] {
        let options = EmbreeOptions {
            robust,
            ..Default::default()
        };
        let scene = scene(&POSITIONS, &INDICES, options);
        // (-1, -1) + 0.5 (2, 0) + 0.25 (2, 2), and (-1, -1) + 0.25 (2, 2) + 0.5 (0, 2)
        for (ray, u, v, primitive) in [
            (ray(0.5, -0.5), 0.5, 0.25, 0),
            (ray(-0.5, 0.5), 0.25, 0.5, 1),
        ] {
            let hit = scene.intersect(&ray).expect("a hit");
            assert_eq!(hit.primitive, primitive);
            let near = divided(hit.t, 2.0) && divided(hit.u, u) && divided(hit.v, v);
            assert!(near, "{hit:?}");
        }
        for (t_min, t_max, hit) in [(0.0, 1.9, false), (2.1, 100.0, false), (1.9, 2.1, true)] {
            let ray = EmbreeRay {
                t_min,
                t_max,
                ..ray(0.5, -0.5)
            };
            assert_eq!(scene.intersect(&ray).is_some(), hit, "{ray:?}");
            assert_eq!(scene.occluded(&ray), hit, "{ray:?}");
            assert_eq!(scene.intersect16(&[ray], false)[0].is_some(), hit);
            assert_eq!(scene.occluded16(&[ray], false)[0], hit, "{ray:?}");
        }
    }
}

/// On a curved mesh, whose rays hit at all angles.
#[test]
fn occlusion_and_packets_agree_with_single_rays() {
    let mesh = displaced_sphere(2_000);
    let positions: Vec<_> = mesh.positions.iter().map(|p| p.to_array()).collect();
    let mut random = Random::new(7);
    let mut hits = 0;
    let scenes = [false, true].map(|robust| {
        let options = EmbreeOptions {
            robust,
            ..Default::default()
        };
        scene(&positions, &mesh.indices, options)
    });
    for round in 0..200 {
        let rays: [EmbreeRay; 16] = std::array::from_fn(|_| EmbreeRay {
            origin: [3.0 * random.signed(), 3.0 * random.signed(), 3.0],
            direction: [0.3 * random.signed(), 0.3 * random.signed(), -1.0],
            t_min: 0.0,
            t_max: 10.0,
        });
        let count = [1, 7, 16][round % 3];
        let coherent = round % 2 == 0;
        // Random rays keep away from edges by more than the modes differ.
        let single = rays.map(|r| scenes[0].intersect(&r));
        for scene in &scenes {
            let packet = scene.intersect16(&rays[..count], coherent);
            let occluded = scene.occluded16(&rays[..count], coherent);
            for i in 0..16 {
                let expected = if i < count { single[i] } else { None };
                assert_eq!(
                    packet[i].map(|h| h.primitive),
                    expected.map(|h| h.primitive),
                    "ray {i} of {count}, {:?}",
                    rays[i]
                );
                assert_eq!(occluded[i], expected.is_some(), "ray {i} of {count}");
                if i < count {
                    let own = scene.intersect(&rays[i]);
                    assert_eq!(own.map(|h| h.primitive), expected.map(|h| h.primitive));
                    assert_eq!(scene.occluded(&rays[i]), expected.is_some());
                }
                if let (Some(a), Some(b)) = (packet[i], expected) {
                    hits += 1;
                    // The intersectors round differently, by a few units of
                    // the distance, which the weights see over short edges.
                    let unit = f32::EPSILON * b.t;
                    assert!((a.t - b.t).abs() <= 8.0 * unit, "{a:?}, {b:?}");
                    let weights = (a.u - b.u).abs().max((a.v - b.v).abs());
                    assert!(weights <= 8.0 * unit / 0.05, "{a:?}, {b:?}");
                }
            }
        }
    }
    assert!(hits > 200, "only {hits} rays hit");
}

#[test]
fn an_empty_mesh_is_never_hit() {
    let scene = scene(&[], &[], EmbreeOptions::default());
    assert_eq!(scene.intersect(&ray(0.0, 0.0)), None);
    assert!(!scene.occluded(&ray(0.0, 0.0)));
}

#[test]
fn a_bad_index_is_an_error() {
    let error = EmbreeScene::new(&POSITIONS, &[[0, 1, 4]], EmbreeOptions::default());
    assert!(
        error
            .err()
            .expect("an error")
            .to_string()
            .contains("vertex 4 of 4")
    );
}

/// Pages that this process has in memory, as bytes; `None` where nobody says.
fn resident() -> Option<usize> {
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: usize = text.split_whitespace().nth(1)?.parse().ok()?;
    Some(4096 * pages)
}

/// What Embree says that its tree takes is neither nothing nor all that the
/// process takes. `--nocapture` shows bytes a triangle, ours beside.
#[test]
fn memory_is_that_of_the_tree() {
    use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    assert_eq!(scene(&[], &[], EmbreeOptions::default()).memory() / 4096, 0);
    let sizes: &[usize] = match std::env::var_os("RAYTWIN_FULL") {
        Some(_) => &[10_000, 100_000, 1_000_000],
        None => &[10_000, 100_000],
    };
    for &size in sizes {
        let mesh = displaced_sphere(size);
        let positions: Vec<_> = mesh.positions.iter().map(|p| p.to_array()).collect();
        let count = mesh.indices.len() as f64;
        let mut memory = [0.0; 2];
        for (memory, robust) in memory.iter_mut().zip([false, true]) {
            let options = EmbreeOptions {
                robust,
                threads: 1,
                ..Default::default()
            };
            let before = resident();
            let scene = scene(&positions, &mesh.indices, options);
            let after = resident();
            *memory = scene.memory() as f64 / count;
            let given = 12.0 * (positions.len() + mesh.indices.len()) as f64;
            let taken = before
                .zip(after)
                .map(|(before, after)| (after.saturating_sub(before) as f64 - given) / count);
            println!("{count}, robust {robust}: {memory:.1}, the process {taken:.1?}");
        }
        let bvh = Bvh::build(&mesh.positions, &mesh.indices, BuildQuality::Medium);
        let wide = bvh.expect("a plain mesh").wide().expect("a sound tree");
        println!("{count}, ours: {:.1}", wide.bytes() as f64 / count);
        // A triangle's vertices or its indices, and its part of a node.
        for memory in memory {
            assert!(memory > 12.0 && memory < 400.0, "{memory}");
        }
    }
}
