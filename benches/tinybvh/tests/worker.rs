//! The program through the client that the report uses.

// The program that the report looks for is another.
#[allow(dead_code)]
#[path = "../../src/tinybvh.rs"]
mod client;

use client::Tinybvh;

/// A grid of unit squares in the plane z = 0, two triangles each.
fn grid(n: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let at = |x: u32, y: u32| y * (n + 1) + x;
    let positions = (0..=n)
        .flat_map(|y| (0..=n).map(move |x| [x as f32, y as f32, 0.0]))
        .collect();
    let indices = (0..n)
        .flat_map(|y| {
            (0..n).flat_map(move |x| {
                let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
                [[a, b, c], [a, c, d]]
            })
        })
        .collect();
    (positions, indices)
}

#[test]
fn finds_what_is_there() {
    let tinybvh = Tinybvh::at(env!("CARGO_BIN_EXE_raytwin-tinybvh").into()).unwrap();
    assert_eq!(tinybvh.version, "1.6.8");
    let n = 40;
    let (positions, indices) = grid(n);
    for high in [false, true] {
        let tree = tinybvh.tree(&positions, &indices, high).unwrap();
        assert!(tree.build_ms > 0.0);
        // One into each triangle, with directions that are no unit vectors;
        // the last stops short of it, and another goes beside the grid.
        let mut rays = Vec::new();
        for y in 0..n {
            for x in 0..n {
                for (dx, dy) in [(0.75, 0.25), (0.25, 0.75)] {
                    let (x, y) = (x as f32 + dx, y as f32 + dy);
                    rays.push([x - 1.0, y, -4.0, 0.5, 0.0, 2.0, 0.0, f32::MAX]);
                }
            }
        }
        let last = *rays.last().unwrap();
        rays.push([last[0], last[1], -4.0, 0.5, 0.0, 2.0, 0.0, 1.9]);
        rays.push([-1.0, -1.0, -4.0, 0.0, 0.0, 1.0, 0.0, f32::MAX]);
        for (any, threads) in [(false, 1), (true, 1), (false, 3), (true, 3)] {
            let traced = tree.trace(&rays, any, true, threads).unwrap();
            assert_eq!(traced.hits, indices.len());
            assert!(traced.seconds > 0.0);
            let hits = traced.closest;
            assert_eq!(hits.len(), rays.len());
            for (i, hit) in hits[..indices.len()].iter().enumerate() {
                let (t, primitive) = hit.unwrap();
                assert_eq!(primitive as usize, i);
                assert!((t - 2.0).abs() < 1e-4, "triangle {i}: t is {t}, not 2");
            }
            assert_eq!(hits[indices.len()..], [None, None]);
        }
    }
}

#[test]
fn what_is_refused_is_an_error() {
    let tinybvh = Tinybvh::at(env!("CARGO_BIN_EXE_raytwin-tinybvh").into()).unwrap();
    let error = tinybvh.tree(&[[0.0; 3]; 3], &[[0, 1, 3]], false).err();
    assert!(error.unwrap().to_string().contains("ended"));
    assert!(Tinybvh::at("/no/such/program".into()).is_err());
}
