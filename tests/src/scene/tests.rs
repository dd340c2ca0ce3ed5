//! The loaders against their peers and the scenes against their numbers.

use std::collections::HashMap;
use std::io::Read;

use super::*;

/// The same file through tobj: every triangle, corner by corner, as bits.
fn tobj_triangles(bytes: &[u8]) -> Vec<[[u32; 3]; 3]> {
    let options = tobj::LoadOptions {
        triangulate: true,
        ..Default::default()
    };
    let (models, _) = tobj::load_obj_buf(&mut &bytes[..], &options, |_| {
        Ok((Vec::new(), Default::default()))
    })
    .expect("tobj reads the file");
    let mut out = Vec::new();
    for model in models {
        let mesh = model.mesh;
        for t in mesh.indices.chunks_exact(3) {
            out.push([0, 1, 2].map(|k| {
                let at = 3 * t[k] as usize;
                [0, 1, 2].map(|axis| mesh.positions[at + axis].to_bits())
            }));
        }
    }
    out
}

fn assert_same_triangles(mesh: &Mesh, peer: &[[[u32; 3]; 3]]) {
    assert_eq!(mesh.indices.len(), peer.len());
    // tobj groups faces by object and material: compare as multisets.
    let mut counts: HashMap<[[u32; 3]; 3], i64> = HashMap::new();
    for t in peer {
        *counts.entry(*t).or_default() += 1;
    }
    for t in mesh.triangles() {
        *counts
            .entry(t.map(|p| p.to_array().map(f32::to_bits)))
            .or_default() -= 1;
    }
    let differing = counts.values().filter(|n| **n != 0).count();
    assert_eq!(
        differing, 0,
        "triangles that one reader has and the other lacks"
    );
}

/// The kitchen always, and Sponza, which is no part of the repository, where
/// it is present.
#[test]
fn real_meshes_have_their_triangles_and_tobj_agrees() {
    let scene = Scene::kitchen().expect("the kitchen loads");
    assert_eq!(scene.mesh.indices.len(), 56_939);
    let file = std::fs::File::open(kitchen_path().expect("located")).expect("opens");
    let mut bytes = Vec::new();
    ruzstd::decoding::StreamingDecoder::new(file)
        .expect("a zstd frame")
        .read_to_end(&mut bytes)
        .expect("decompresses");
    assert_same_triangles(&scene.mesh, &tobj_triangles(&bytes));

    let Some(path) = sponza_path() else {
        eprintln!("compared the kitchen only: no sponza.obj here (RAYTWIN_SPONZA names one)");
        return;
    };
    let bytes = std::fs::read(&path).expect("sponza reads");
    let scene = Scene::load(&path).expect("sponza loads");
    assert_eq!(scene.name, "sponza");
    assert_eq!(scene.mesh.indices.len(), 66_450);
    assert_same_triangles(&scene.mesh, &tobj_triangles(&bytes));
}

#[test]
fn an_unknown_mesh_is_seen_whole() {
    // A box far from the origin and one of a single point.
    for scale in [1e-3f32, 1.0, 1e6] {
        let mut mesh = toy_room();
        for p in &mut mesh.positions {
            *p = *p * scale + Vec3::splat(3.0 * scale);
        }
        let scene = Scene::seen_whole("box".into(), mesh);
        let camera = scene.camera;
        let forward = (camera.target - camera.eye).normalize();
        let half = (0.5 * camera.fov_degrees).to_radians().cos();
        for p in &scene.mesh.positions {
            let cosine = (*p - camera.eye).normalize().dot(forward);
            assert!(cosine >= half, "scale {scale}: {p} is outside the picture");
        }
        assert!(scene.ao_distance > 0.0);
    }
    let point = Mesh {
        positions: vec![Vec3::ONE],
        indices: vec![[0, 0, 0]],
        skipped: 0,
    };
    let scene = Scene::seen_whole("point".into(), point);
    assert!(scene.camera.eye != scene.camera.target && scene.ao_distance > 0.0);
}

#[test]
fn lights_have_unit_directions() {
    for scene in [
        Scene::toy_room(),
        Scene::kitchen().expect("the kitchen loads"),
    ] {
        let length = scene.light.direction.length();
        assert!((length - 1.0).abs() < 1e-6, "{}: {length}", scene.name);
        assert!(scene.light.angular_radius > 0.0);
    }
}
