//! The hard families: rays and what is known about them beforehand.

use glam::Vec3;
use raytwin_cpu::ray::ray::Ray;

use super::meshes::{
    Mesh, Random, displaced_sphere, lattice_cube, room, sliver_sphere, straight_hall, tilted_hall,
};

/// What must come out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expectation {
    /// The mesh is closed and the ray starts inside: a miss is a leak.
    MustHit,
    /// As `MustHit`; in addition tracing again with `t_max` at the hit's own
    /// `t` must give the same hit.
    MustHitAgain,
}

/// Rays of one kind against one mesh.
#[derive(Clone, Debug)]
pub struct Family {
    /// What they do.
    pub name: String,
    /// The mesh they are shot at.
    pub mesh: Mesh,
    /// The rays.
    pub rays: Vec<Ray>,
    /// What must come out.
    pub expect: Expectation,
}

/// A ray from `t_min` 0 on, without end.
#[must_use]
pub fn ray(origin: Vec3, direction: Vec3) -> Ray {
    Ray {
        origin,
        direction,
        t_min: 0.0,
        t_max: f32::MAX,
    }
}

fn family(name: impl Into<String>, mesh: &Mesh, rays: Vec<Ray>) -> Family {
    assert!(mesh.is_closed());
    Family {
        name: name.into(),
        mesh: mesh.clone(),
        rays,
        expect: Expectation::MustHit,
    }
}

/// A point well inside a displaced sphere of unit scale.
fn inside(random: &mut Random) -> Vec3 {
    random.direction() * (0.5 * random.unit())
}

fn edge_point(mesh: &Mesh, random: &mut Random) -> Vec3 {
    let c = mesh.corners(random.below(mesh.indices.len()));
    let k = random.below(3);
    let s = random.unit();
    let (a, b) = (c[k], c[(k + 1) % 3]);
    a + (b - a) * s
}

/// Aimed at points on edges; `scale` and `offset` are those of the mesh.
fn at_edges(mesh: &Mesh, n: usize, scale: f32, offset: Vec3) -> Vec<Ray> {
    let mut random = Random::new(21);
    (0..n)
        .map(|_| {
            let o = inside(&mut random) * scale + offset;
            ray(o, edge_point(mesh, &mut random) - o)
        })
        .collect()
}

fn at_random(n: usize, scale: f32, offset: Vec3, length: f32) -> Vec<Ray> {
    let mut random = Random::new(22);
    (0..n)
        .map(|_| {
            let o = inside(&mut random) * scale + offset;
            ray(o, random.direction() * length)
        })
        .collect()
}

fn at_vertices(mesh: &Mesh, n: usize) -> Vec<Ray> {
    let mut random = Random::new(23);
    (0..n)
        .map(|_| {
            let o = inside(&mut random);
            ray(o, mesh.positions[random.below(mesh.positions.len())] - o)
        })
        .collect()
}

/// Along an axis, the other two components zeros of either sign, through the
/// lattice's vertices.
fn along_axes(n: usize, size: i32) -> Vec<Ray> {
    let mut random = Random::new(24);
    let inner = size - 1;
    (0..n)
        .map(|_| {
            let mut o = [0.0; 3];
            let mut d = [random.zero(), random.zero(), random.zero()];
            for v in &mut o {
                *v = (random.below(inner as usize) as i32 + 1 - size / 2) as f32;
            }
            d[random.below(3)] = random.sign();
            ray(o.into(), d.into())
        })
        .collect()
}

/// Along the diagonals of squares and of the cube, from lattice points.
fn along_diagonals(n: usize, size: i32) -> Vec<Ray> {
    let mut random = Random::new(25);
    let inner = size - 1;
    (0..n)
        .map(|_| {
            let mut o = [0.0; 3];
            for v in &mut o {
                *v = (random.below(inner as usize) as i32 + 1 - size / 2) as f32;
            }
            let mut d = [random.sign(), random.sign(), random.sign()];
            let k = random.below(4);
            if k < 3 {
                d[k] = random.zero();
            }
            ray(o.into(), d.into())
        })
        .collect()
}

/// Nearly along a face of the cube, just below it.
fn grazing(n: usize, size: i32) -> Vec<Ray> {
    let mut random = Random::new(26);
    let half = size as f32 / 2.0;
    (0..n)
        .map(|_| {
            let axis = random.below(3);
            let side = random.sign();
            let mut o = [0.0; 3].map(|_: f32| 0.9 * half * random.signed());
            let depth = 10f32.powi(-(random.below(6) as i32));
            o[axis] = side * (half - 0.5 * depth * random.unit() - 1e-5);
            let mut d = [random.signed(), random.signed(), random.signed()];
            d[axis] *= 1e-4 * random.unit() * random.unit();
            if d[(axis + 1) % 3].abs() + d[(axis + 2) % 3].abs() < 0.1 {
                d[(axis + 1) % 3] = 1.0;
            }
            ray(o.into(), d.into())
        })
        .collect()
}

/// From points of the surface towards points well inside.
fn from_surface(mesh: &Mesh, n: usize, t_min: f32) -> Vec<Ray> {
    let mut random = Random::new(27);
    (0..n)
        .map(|_| {
            let [a, b, c] = mesh.corners(random.below(mesh.indices.len()));
            let (mut u, mut v) = (random.unit(), random.unit());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let o = a + (b - a) * u + (c - a) * v;
            Ray {
                t_min,
                ..ray(o, inside(&mut random) - o)
            }
        })
        .collect()
}

/// From inside the hall at points on and beside its long edges, up to ten
/// thousand widths away.
fn along_hall(mesh: &Mesh, n: usize) -> Vec<Ray> {
    let mut random = Random::new(28);
    let [along, side, up] = [1, 2, 4].map(|i| (mesh.positions[i] - mesh.positions[0]).as_dvec3());
    let middle = (mesh.positions[0].as_dvec3() + mesh.positions[7].as_dvec3()) * 0.5;
    (0..n)
        .map(|_| {
            let mut part = || f64::from(0.45 * random.signed());
            let o = along * part() + side * part() + up * part();
            let o = (o + middle).as_vec3();
            let corner = mesh.positions[random.below(8)].as_dvec3();
            let step = 10f64.powf(4.0 * f64::from(random.unit())) * f64::from(random.sign());
            let s = (o.as_dvec3() - corner).dot(along.normalize()) + step;
            // Onto the edge, or past it by up to a thousandth: the shear of a
            // far vertex errs by more than the box's own rounding.
            let past =
                random.direction().as_dvec3() * 10f64.powf(-3.0 - 5.0 * f64::from(random.unit()));
            let target = corner + along.normalize() * s + past;
            ray(o, target.as_vec3() - o)
        })
        .collect()
}

/// All families, `n` rays each.
#[must_use]
pub fn all(n: usize) -> Vec<Family> {
    let sphere = displaced_sphere(20_000);
    let cube = lattice_cube(64);
    let slivers = sliver_sphere(20_000);
    let zero = Vec3::ZERO;
    let mut out = vec![
        family(
            "random, closed sphere",
            &sphere,
            at_random(n, 1.0, zero, 1.0),
        ),
        family(
            "edges, closed sphere",
            &sphere,
            at_edges(&sphere, n, 1.0, zero),
        ),
        family("vertices, closed sphere", &sphere, at_vertices(&sphere, n)),
        family(
            "axes with either zero, lattice vertices",
            &cube,
            along_axes(n, 64),
        ),
        family(
            "diagonals with zeros, lattice vertices",
            &cube,
            along_diagonals(n, 64),
        ),
        family("grazing along faces", &cube, grazing(n, 64)),
        family("axes, closed sphere", &sphere, {
            let mut random = Random::new(29);
            (0..n)
                .map(|_| {
                    let mut d = [random.zero(), random.zero(), random.zero()];
                    d[random.below(3)] = random.sign();
                    ray(inside(&mut random), d.into())
                })
                .collect()
        }),
        family(
            "edges of slivers",
            &slivers,
            at_edges(&slivers, n, 1.0, zero),
        ),
        family("vertices of slivers", &slivers, at_vertices(&slivers, n)),
        family("random, slivers", &slivers, at_random(n, 1.0, zero, 1.0)),
        family(
            "from the surface inwards, t_min 0",
            &sphere,
            from_surface(&sphere, n, 0.0),
        ),
        family(
            "from the surface inwards, t_min 1e-4",
            &sphere,
            from_surface(&sphere, n, 1e-4),
        ),
    ];
    for scale in [1e6, 1e3, 1e-3, 1e-4, 1e-5, 1e-7] {
        let mesh = sphere.clone().placed(scale, zero);
        out.push(family(
            format!("edges, sphere x {scale:e}"),
            &mesh,
            at_edges(&mesh, n, scale, zero),
        ));
        out.push(family(
            format!("random, sphere x {scale:e}"),
            &mesh,
            at_random(n, scale, zero, 1.0),
        ));
    }
    let offset = Vec3::new(1e6, -1e6, 1e6);
    let far = sphere.clone().placed(100.0, offset);
    out.push(family(
        "edges, radius 100 at 1e6",
        &far,
        at_edges(&far, n, 100.0, offset),
    ));
    out.push(family(
        "random, radius 100 at 1e6",
        &far,
        at_random(n, 100.0, offset, 1.0),
    ));
    for length in [1e-10, 1e-5, 1e5, 1e10] {
        out.push(family(
            format!("direction length {length:e}"),
            &sphere,
            at_random(n, 1.0, zero, length),
        ));
    }
    for (name, hall) in [
        ("edges of a long hall, tilted", tilted_hall()),
        ("edges of a long hall, straight", straight_hall()),
    ] {
        out.push(family(name, &hall, along_hall(&hall, n)));
    }
    let room = room();
    out.push(family("random in a room with rods", &room, {
        let mut random = Random::new(30);
        (0..n)
            .map(|_| {
                let o = Vec3::new(
                    3.9 * random.signed(),
                    1.4 * random.signed(),
                    2.9 * random.signed(),
                );
                ray(o, random.direction())
            })
            .collect()
    }));
    for (name, mesh, rays) in [
        (
            "t_max at the hit, random",
            &sphere,
            at_random(n, 1.0, zero, 1.0),
        ),
        (
            "t_max at the hit, edges",
            &sphere,
            at_edges(&sphere, n, 1.0, zero),
        ),
        (
            "t_max at the hit, slivers",
            &slivers,
            at_edges(&slivers, n, 1.0, zero),
        ),
    ] {
        out.push(Family {
            expect: Expectation::MustHitAgain,
            ..family(name, mesh, rays)
        });
    }
    out
}

/// Counts the rays of a family that a tracer loses. `trace` gives the hit's
/// `t` and primitive.
pub fn leaks(family: &Family, mut trace: impl FnMut(Ray) -> Option<(f32, u32)>) -> usize {
    let mut lost = 0;
    for &ray in &family.rays {
        let hit = trace(ray);
        let again = match (family.expect, hit) {
            (Expectation::MustHitAgain, Some((t, _))) => trace(Ray { t_max: t, ..ray }),
            _ => hit,
        };
        lost += usize::from(hit.is_none() || again != hit);
    }
    lost
}
