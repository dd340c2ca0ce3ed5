//! Our declarations of Embree are those of the library that is loaded.

use embree4_rs::geometry::TriangleMeshGeometry;
use embree4_rs::{CommittedScene, Device, Scene, SceneOptions};
use embree4_sys::{
    INST_PRIM_ID_OFFSET, RTC_INVALID_GEOMETRY_ID, RTCBuildQuality, RTCRay, RTCRayHit, RTCSceneFlags,
};
use raytwin_tests::embree::{EmbreeOptions, EmbreeRay, EmbreeScene};

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

#[test]
fn an_array_of_hits_is_not_overwritten() {
    let scene = RawScene::new();
    let mut rays: Vec<RTCRayHit> = [-0.6, -0.2, 0.2, 0.6]
        .map(|x| RTCRayHit {
            ray: raw(x, 0.5 * x + 0.1),
            hit: embree4_sys::RTCHit {
                geomID: RTC_INVALID_GEOMETRY_ID,
                ..Default::default()
            },
        })
        .to_vec();
    for i in 0..rays.len() {
        let before: Vec<u32> = rays.iter().map(|r| r.ray.org_x.to_bits()).collect();
        // SAFETY: one valid structure of the array.
        unsafe {
            embree4_sys::rtcIntersect1(scene.scene, &raw mut rays[i], std::ptr::null_mut());
        }
        let after: Vec<u32> = rays.iter().map(|r| r.ray.org_x.to_bits()).collect();
        assert_eq!(before, after, "the call for ray {i} wrote into another");
    }
    for (i, r) in rays.iter().enumerate() {
        assert_ne!(r.hit.geomID, RTC_INVALID_GEOMETRY_ID, "ray {i} must hit");
        assert_eq!(r.ray.tfar, 2.0);
    }
}

/// The live control: with the published crate's 80 bytes the test above would
/// see the defect, because the library does write behind them.
#[test]
fn the_published_layout_would_be_overwritten() {
    let scene = RawScene::new();
    // 96 bytes of ours, of which the published structure claims the first 80.
    let mut both = RTCRayHit {
        ray: raw(0.25, 0.1),
        hit: embree4_sys::RTCHit {
            geomID: RTC_INVALID_GEOMETRY_ID,
            ..Default::default()
        },
    };
    let tail = (&raw mut both)
        .cast::<u8>()
        .wrapping_add(INST_PRIM_ID_OFFSET)
        .cast::<u32>();
    let canary = 0x1234_5678;
    // SAFETY: bytes 80..84 lie inside the 96 of the structure.
    let written = unsafe {
        tail.write(canary);
        embree4_sys::rtcIntersect1(scene.scene, &raw mut both, std::ptr::null_mut());
        tail.read()
    };
    assert_ne!(both.hit.geomID, RTC_INVALID_GEOMETRY_ID, "the ray must hit");
    assert_ne!(
        written, canary,
        "this Embree does not write an instance-primitive id; is it older than 4.3?"
    );
}

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
        let ours = EmbreeScene::new(&POSITIONS, &INDICES, options).expect("a scene");
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

#[test]
fn occlusion_and_packets_agree_with_single_rays() {
    for robust in [false, true] {
        let options = EmbreeOptions {
            robust,
            ..Default::default()
        };
        let scene = EmbreeScene::new(&POSITIONS, &INDICES, options).expect("a scene");
        let rays: Vec<_> = (0..16)
            .map(|i| ray(-1.4 + 0.19 * i as f32, 0.03 * i as f32))
            .collect();
        for count in [1, 7, 16] {
            for coherent in [false, true] {
                let hits = scene.intersect16(&rays[..count], coherent);
                let occluded = scene.occluded16(&rays[..count], coherent);
                for i in 0..16 {
                    let single = (i < count).then(|| scene.intersect(&rays[i])).flatten();
                    assert_eq!(
                        hits[i].map(|h| (h.t, h.primitive)),
                        single.map(|h| (h.t, h.primitive)),
                        "ray {i} of {count}"
                    );
                    assert_eq!(occluded[i], single.is_some(), "ray {i} of {count}");
                    if i < count {
                        assert_eq!(scene.occluded(&rays[i]), single.is_some());
                    }
                }
            }
        }
    }
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
