//! `ray/bvh_filter`: against trees of the triangles left, against a search in
//! double precision, against the eight-wide walk, and on every adapter.

use glam::{DVec3, Vec3};
use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin_cpu::pass::bvh8::{Bvh8, Faces, Filter, Level};
use raytwin_cpu::ray::bvh::{BVH_MISS, BvhHit, bvh_any, bvh_closest};
use raytwin_cpu::ray::bvh_filter::{BVH_FACES_BOTH, BVH_FACES_FRONT, bvh_any_of, bvh_closest_of};
use raytwin_cpu::ray::ray::Ray;
use raytwin_tests::crosscheck::{Subject, tolerance};
use raytwin_tests::gpu::{Build, Gpu, adapters, entry_module};
use raytwin_tests::rays::families::all;
use raytwin_tests::rays::meshes::{Random, displaced_sphere, lattice_cube, room};
use raytwin_tests::rays::reference::reference_triangle;
use raytwin_tests::scene::kitchen;

const SIDES: [(u32, Faces); 2] = [
    (BVH_FACES_BOTH, Faces::Both),
    (BVH_FACES_FRONT, Faces::Front),
];

fn subject(name: &str, positions: &[Vec3], indices: &[[u32; 3]]) -> Subject {
    Subject::new(name, positions, indices, BuildQuality::Medium)
        .unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// A quarter of the triangles is there for nobody.
fn masks(triangles: usize) -> Vec<u32> {
    let mut random = Random::new(8);
    (0..triangles)
        .map(|_| random.word() & random.word() & 7)
        .collect()
}

fn bits(hit: BvhHit) -> [u32; 4] {
    [
        hit.t.to_bits(),
        hit.u.to_bits(),
        hit.v.to_bits(),
        hit.primitive,
    ]
}

/// The hard families, and random rays through a kitchen and two meshes.
fn sets() -> Vec<(Subject, Vec<Ray>)> {
    let mut sets: Vec<_> = all(200)
        .into_iter()
        .map(|f| (subject(&f.name, &f.mesh.positions, &f.mesh.indices), f.rays))
        .collect();
    let scene = kitchen().unwrap_or_else(|e| panic!("{e}"));
    let mut add = |name: &str, positions: &[Vec3], indices: &[[u32; 3]]| {
        let subject = subject(name, positions, indices);
        let rays = subject.random_rays(6_000, 61);
        sets.push((subject, rays));
    };
    add("kitchen", &scene.positions, &scene.indices);
    for (name, mesh) in [("room", room()), ("cube", lattice_cube(24))] {
        add(name, &mesh.positions, &mesh.indices);
    }
    sets
}

/// Whatever the masks leave is as if the rest had never been built.
#[test]
fn masked_is_a_tree_of_the_masked_triangles() {
    let (mut hits, mut others) = (0, 0);
    for (subject, rays) in sets() {
        let masks = masks(subject.indices.len());
        for mask in [1, 6] {
            let left: Vec<u32> = (0..masks.len() as u32)
                .filter(|&i| masks[i as usize] & mask != 0)
                .collect();
            let indices: Vec<_> = left.iter().map(|&i| subject.indices[i as usize]).collect();
            let bvh = Bvh::build(&subject.positions, &indices, BuildQuality::Fast)
                .unwrap_or_else(|e| panic!("{}: {e}", subject.name));
            for &ray in &rays {
                let mut want = bvh_closest(&bvh.view(), ray);
                if want.primitive != BVH_MISS {
                    want.primitive = left[want.primitive as usize];
                }
                let view = subject.bvh.view();
                let found = bvh_closest_of(&view, &masks, ray, BVH_FACES_BOTH, mask);
                assert_eq!(bits(found), bits(want), "{}: {ray:?}", subject.name);
                let any = bvh_any_of(&view, &masks, ray, BVH_FACES_BOTH, mask);
                assert_eq!(any, bvh_any(&bvh.view(), ray), "{}", subject.name);
                hits += usize::from(want.primitive != BVH_MISS);
                others += usize::from(bits(want) != bits(bvh_closest(&view, ray)));
            }
        }
    }
    assert!(hits > 10_000 && others > 10_000, "{hits} {others}");
}

/// In double precision, every triangle asked: the closest one seen from the
/// front, and whether some triangle within reach is so flat, or met so near its
/// rim, that rounding decides.
fn front_in_f64(subject: &Subject, ray: Ray) -> (Option<(f64, u32)>, bool) {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let mut best: Option<(f64, u32)> = None;
    let mut close = false;
    for (i, triangle) in subject.indices.iter().enumerate() {
        let corners = triangle.map(|k| subject.positions[k as usize]);
        let [a, b, c]: [DVec3; 3] = corners.map(|p| p.as_dvec3());
        let normal = (b - a).cross(c - a);
        let facing = normal.dot(d);
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        let t = normal.dot(a - o) / facing;
        let p = o + d * t;
        let part = |x: DVec3, y: DVec3| (x - p).cross(y - p).dot(normal) / normal.length_squared();
        let least = part(b, c).min(part(c, a)).min(part(a, b));
        let flat = facing.abs() < 0.02 * longest * longest * d.length();
        let away = tolerance(o, [a, b, c]) / longest;
        close |= least > -1e3 * away && (flat || least < 1e3 * away);
        if facing >= 0.0 {
            continue;
        }
        if let Some((t, ..)) = reference_triangle(ray, corners[0], corners[1], corners[2])
            && t >= f64::from(ray.t_min)
            && t <= f64::from(ray.t_max)
            && best.is_none_or(|b| t < b.0)
        {
            best = Some((t, i as u32));
        }
    }
    (best, close)
}

#[test]
fn front_is_the_closest_of_those_that_face_the_ray() {
    let sphere = displaced_sphere(1_500);
    let cube = lattice_cube(8);
    let mut random = Random::new(5);
    let (mut hits, mut behind, mut undecided, mut count) = (0, 0, 0, 0);
    for (name, mesh) in [("sphere", &sphere), ("cube", &cube)] {
        let subject = subject(name, &mesh.positions, &mesh.indices);
        // Some from inside: a closed mesh has no front there but where it folds.
        let mut rays = subject.random_rays(3_000, 17);
        rays.extend((0..1_000).map(|_| Ray {
            origin: random.direction() * 0.1,
            direction: random.direction(),
            t_min: 0.0,
            t_max: f32::MAX,
        }));
        let view = subject.bvh.view();
        for ray in rays {
            count += 1;
            let (want, close) = front_in_f64(&subject, ray);
            if close {
                undecided += 1;
                continue;
            }
            let found = bvh_closest_of(&view, &[], ray, BVH_FACES_FRONT, u32::MAX);
            let any = bvh_any_of(&view, &[], ray, BVH_FACES_FRONT, u32::MAX);
            assert_eq!(any != 0, want.is_some(), "{name}: {ray:?}");
            let primitive = want.map_or(BVH_MISS, |w| w.1);
            assert_eq!(found.primitive, primitive, "{name}: {ray:?}");
            if let Some((t, i)) = want {
                hits += 1;
                let corners =
                    subject.indices[i as usize].map(|k| subject.positions[k as usize].as_dvec3());
                let far = tolerance(ray.origin.as_dvec3(), corners);
                // Over the tilt, which is 0.02 of the longest side squared at least.
                let off = (f64::from(found.t) - t).abs() * ray.direction.as_dvec3().length();
                assert!(off < 50.0 * far, "{name}: {off} {far}");
            }
            behind += usize::from(bvh_closest(&view, ray).primitive != primitive);
        }
    }
    println!("{hits} hits, {behind} other than without a filter, {undecided} of {count} left out");
    assert!(hits > 1_500 && behind > 1_500, "{hits} {behind}");
    assert!(10 * undecided < count, "{undecided} of {count}");
}

#[test]
fn the_eight_wide_walk_gives_the_same_bits() {
    let mut hits = 0;
    for (subject, rays) in sets() {
        let wide = Bvh8::new(subject.bvh.view()).expect("a sound tree");
        let view = subject.bvh.view();
        let own = masks(subject.indices.len());
        for masks in [&own[..], &own[..own.len() / 2], &[]] {
            for (faces, sides) in SIDES {
                for mask in [0, 3, u32::MAX] {
                    let filter = Filter {
                        faces: sides,
                        mask,
                        masks,
                    };
                    for level in Level::all() {
                        let wide = wide.clone().with_level(level);
                        for &ray in &rays {
                            let want = bvh_closest_of(&view, masks, ray, faces, mask);
                            let found = wide.closest_of(&ray, filter);
                            let name = (&subject.name, level.name(), faces, mask);
                            assert_eq!(bits(found), bits(want), "{name:?}: {ray:?}");
                            let any = bvh_any_of(&view, masks, ray, faces, mask);
                            assert_eq!(wide.any_of(&ray, filter), any != 0, "{name:?}");
                            assert_eq!(any != 0, want.primitive != BVH_MISS, "{name:?}");
                            hits += any;
                        }
                    }
                }
            }
        }
    }
    assert!(hits > 100_000, "{hits}");
}

const SHADER: &str = "
@group(0) @binding(0) var<storage, read> test_rays: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> test_answers: array<u32>;

@compute @workgroup_size(64)
fn raytwin_main(@builtin(global_invocation_id) id: vec3u) {
    // A filter comes first.
    let asked = bitcast<vec4u>(test_rays[0]);
    if id.x >= arrayLength(&test_rays) / 2u - 1u {
        return;
    }
    let start = test_rays[2u * id.x + 2u];
    let along = test_rays[2u * id.x + 3u];
    let ray = Ray(start.xyz, along.xyz, start.w, along.w);
    let hit = bvh_closest_of(ray, asked.x, asked.y);
    test_answers[5u * id.x] = bitcast<u32>(hit.t);
    test_answers[5u * id.x + 1u] = bitcast<u32>(hit.u);
    test_answers[5u * id.x + 2u] = bitcast<u32>(hit.v);
    test_answers[5u * id.x + 3u] = hit.primitive;
    test_answers[5u * id.x + 4u] = bvh_any_of(ray, asked.x, asked.y);
}
";

/// The ready bindings, all in one group.
fn source() -> String {
    let mut source = raytwin::wgsl::link(&["ray/bvh_filter"]).expect("registered");
    for name in ["ray/bvh", "ray/bvh_filter"] {
        let module = raytwin::wgsl::module(name).expect("registered");
        source += module.bindings.expect("it reads");
    }
    for (from, to) in [(0, 2), (1, 3), (125, 4)] {
        let old = format!("@group(2) @binding({from})");
        assert!(source.contains(&old), "{old}");
        source = source.replace(&old, &format!("@group(0) @binding({to})"));
    }
    source + SHADER
}

fn pipeline(gpu: &Gpu, build: Build) -> (wgpu::ComputePipeline, wgpu::BindGroupLayout) {
    let module = entry_module(gpu, "ray/bvh_filter", &source(), build, "raytwin_main")
        .unwrap_or_else(|e| panic!("{}: {e}", gpu.label()));
    let device = gpu.device();
    let entries: Vec<_> = (0..5)
        .map(|binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage {
                    read_only: binding != 1,
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    let group = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &entries,
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&group)],
        immediate_size: 0,
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: Some(&layout),
        module: &module,
        entry_point: Some("raytwin_main"),
        compilation_options: Default::default(),
        cache: None,
    });
    (pipeline, group)
}

fn trace(
    gpu: &Gpu,
    (pipeline, layout): &(wgpu::ComputePipeline, wgpu::BindGroupLayout),
    [nodes, triangles, masks]: [&[u32]; 3],
    rays: &[Ray],
    (faces, mask): (u32, u32),
) -> Vec<u32> {
    let mut words = vec![faces, mask, 0, 0, 0, 0, 0, 0];
    words.extend(rays.iter().flat_map(|r| {
        let (o, d) = (r.origin, r.direction);
        [o.x, o.y, o.z, r.t_min, d.x, d.y, d.z, r.t_max].map(f32::to_bits)
    }));
    let output = gpu.buffer(&vec![0xdead_beef; 5 * rays.len()]);
    let buffers = [
        gpu.buffer(&words),
        output.clone(),
        gpu.buffer(nodes),
        gpu.buffer(triangles),
        gpu.buffer(masks),
    ];
    let entries: Vec<_> = buffers
        .iter()
        .zip(0..)
        .map(|(buffer, binding)| wgpu::BindGroupEntry {
            binding,
            resource: buffer.as_entire_binding(),
        })
        .collect();
    let device = gpu.device();
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout,
        entries: &entries,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups((rays.len() as u32).div_ceil(64), 1, 1);
    }
    gpu.queue().submit([encoder.finish()]);
    gpu.read(&output, 5 * rays.len())
}

/// WGSL lets `max(-0, 0)` be either zero.
fn unsigned_zeros([t, u, v, primitive]: [u32; 4]) -> [u32; 4] {
    let [t, u, v] = [t, u, v].map(|x| if x == 1 << 31 { 0 } else { x });
    [t, u, v, primitive]
}

/// The scalar twin's bits in the precise build on a processor; as shipped, the
/// same triangle but for one ray in a thousand.
#[test]
fn the_wgsl_twin_gives_the_same_hits() {
    let sets = sets();
    for gpu in adapters().unwrap_or_else(|e| panic!("{e}")) {
        for build in [Build::Plain, Build::Precise] {
            if build == Build::Precise && !gpu.has_precise() {
                continue;
            }
            let pipeline = pipeline(gpu, build);
            let (mut count, mut off, mut hits) = (0, 0, 0);
            for (subject, rays) in &sets {
                let own = masks(subject.indices.len());
                let trees = [subject.bvh.node_words(), subject.bvh.triangle_words()];
                // Beyond the end a triangle has all bits.
                for (masks, faces, mask) in [
                    (&own[..], BVH_FACES_FRONT, 3),
                    (&own[..own.len().div_ceil(2)], BVH_FACES_BOTH, 4),
                    (&own[..1], BVH_FACES_FRONT, u32::MAX),
                ] {
                    let read = [&trees[0][..], &trees[1], masks];
                    let words = trace(gpu, &pipeline, read, rays, (faces, mask));
                    for (&ray, word) in rays.iter().zip(words.chunks_exact(5)) {
                        let view = subject.bvh.view();
                        let want = bvh_closest_of(&view, masks, ray, faces, mask);
                        let found = unsigned_zeros([word[0], word[1], word[2], word[3]]);
                        let same = found == unsigned_zeros(bits(want));
                        let any = u32::from(found[3] != BVH_MISS);
                        assert_eq!(word[4], any, "{}: {ray:?}", subject.name);
                        if build == Build::Precise && gpu.is_software() {
                            assert!(same, "{}: {ray:?} {found:?} {want:?}", subject.name);
                        }
                        count += 1;
                        off += usize::from(found[3] != want.primitive);
                        hits += any;
                    }
                }
            }
            println!(
                "{}, {build:?}: {off} of {count} differ, {hits} hits",
                gpu.label()
            );
            assert!(hits > 5_000, "{hits}");
            assert!(1000 * off <= count, "{}: {off} of {count}", gpu.label());
        }
    }
}

/// WGSL has no functions as arguments, so the filtered walk is a text of its
/// own: the plain one with other leaves.
#[test]
fn the_filtered_walk_is_the_walk() {
    fn code(name: &str) -> Vec<String> {
        let text = raytwin::wgsl::module(name).expect("registered").source;
        let lines = text
            .lines()
            .map(|l| l.split("//").next().unwrap_or_default());
        let text = lines.collect::<Vec<_>>().join("\n");
        text.split("\nfn ")
            .filter_map(|f| f.split_once("\n}"))
            .map(|(f, _)| f.split_whitespace().collect::<Vec<_>>().join(" "))
            .collect()
    }
    fn find<'a>(all: &'a [String], name: &str) -> &'a str {
        let found = all.iter().find(|f| f.starts_with(name));
        found.unwrap_or_else(|| panic!("no {name}"))
    }
    let (plain, filtered) = (code("ray/bvh"), code("ray/bvh_filter"));
    let leaf = find(&plain, "bvh_leaf(")
        .replace("bvh_leaf(", "bvh_filter_leaf(")
        .replace("any_hit: bool,", "any_hit: bool, faces: u32, mask: u32,")
        .replace(
            "triangle.primitive < best.primitive)",
            "triangle.primitive < best.primitive) && bvh_filter_sees(triangle, shear, faces, mask)",
        );
    let walk = find(&plain, "bvh_walk(")
        .replace("bvh_leaf(", "bvh_filter_leaf(")
        .replace("any_hit, best)", "any_hit, faces, mask, best)");
    // Trailing commas and line breaks do not count.
    let plainly = |text: &str| text.replace([' ', ','], "");
    let (_, body) = walk.split_once('{').expect("a body");
    let (_, own) = find(&filtered, "bvh_filter_walk(")
        .split_once('{')
        .expect("a body");
    assert_eq!(plainly(body), plainly(own));
    assert_eq!(plainly(&leaf), plainly(find(&filtered, "bvh_filter_leaf(")));
}
