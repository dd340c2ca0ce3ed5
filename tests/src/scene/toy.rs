//! A small room assembled in code: closed objects only, chosen for their
//! shadows (a slatted blind, a leaning grid of rods, a ring, a sphere, thin
//! legs) and for their corners.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::{DMat3, DVec3, Vec3, dvec3};

use super::mesh::Mesh;

/// The toy room: x to the right (0 to 6), y up (0 to 3), z towards the viewer
/// (0 to 5), in metres. The wall on the left has a window with a blind, there
/// is no ceiling and no wall behind the viewer. Every object is closed and
/// none touches another in a common plane (what stands on the floor reaches
/// 5 mm into it), so that closest hits are unique.
pub fn toy_room() -> Mesh {
    let mut room = Mesh::default();
    let mut add = |part: Mesh| room.append(&part);

    // Shell, 0.1 thick. Neighbours overlap by a few millimetres.
    add(cuboid([-0.30, -0.10, -0.30], [6.30, 0.0, 5.2]));
    add(cuboid([-0.15, -0.05, -0.11], [6.15, 3.0, -0.01]));
    add(cuboid([6.0, -0.06, -0.13], [6.1, 2.99, 4.9]));
    // The wall on the left, around the window z 1.2..3.4, y 0.9..2.5.
    add(cuboid([-0.105, -0.06, -0.13], [-0.005, 2.98, 1.2]));
    add(cuboid([-0.106, -0.06, 3.4], [-0.006, 2.97, 4.9]));
    add(cuboid([-0.104, -0.07, 1.195], [-0.004, 0.9, 3.405]));
    add(cuboid([-0.103, 2.5, 1.195], [-0.003, 2.96, 3.405]));

    // The blind: six slats, tilted a little.
    for slat in 0..6 {
        let y = 1.02 + 0.27 * f64::from(slat);
        let tilt = DMat3::from_rotation_z(0.1);
        add(cuboid_at(
            dvec3(-0.055, y, 2.3),
            dvec3(0.07, 0.008, 1.08),
            tilt,
        ));
    }

    // A table.
    add(cuboid([2.3, 0.72, 0.7], [4.1, 0.78, 1.8]));
    for (x, z) in [(2.4, 0.8), (4.0, 0.8), (2.4, 1.7), (4.0, 1.7)] {
        add(cuboid(
            [x - 0.03, -0.005, z - 0.03],
            [x + 0.03, 0.725, z + 0.03],
        ));
    }
    // On it: a sphere and a ring that leans against the wall.
    add(sphere(dvec3(2.85, 1.045, 1.2), 0.27, 3));
    add(torus(
        dvec3(3.65, 1.09, 1.05),
        0.25,
        0.065,
        DMat3::from_rotation_y(0.5) * DMat3::from_rotation_x(1.25),
        32,
        16,
    ));

    // Boxes on the floor.
    add(cuboid_at(
        dvec3(1.2, 0.345, 1.0),
        dvec3(0.35, 0.35, 0.35),
        DMat3::from_rotation_y(0.4),
    ));
    add(cuboid_at(
        dvec3(1.22, 0.84, 1.02),
        dvec3(0.18, 0.15, 0.18),
        DMat3::from_rotation_y(-0.3),
    ));
    add(cuboid([5.2, -0.005, 0.3], [5.85, 1.7, 0.95]));

    // A grid of rods in front of the right wall.
    let lean = DMat3::from_rotation_x(-0.22);
    for rod in 0..9 {
        let x = 4.3 + 0.16 * f64::from(rod);
        add(rod_between(
            dvec3(x, -0.005, 2.95),
            dvec3(x, -0.005, 2.95) + lean * dvec3(0.0, 1.3, 0.0),
            0.018,
            12,
        ));
    }
    for bar in [0.25, 0.95] {
        let at = dvec3(0.0, -0.005, 2.95) + lean * dvec3(0.0, bar, 0.0);
        add(rod_between(
            at + dvec3(4.2, 0.0, 0.0),
            at + dvec3(5.68, 0.0, 0.0),
            0.022,
            12,
        ));
    }

    // A ball on the floor, nearest to the viewer.
    add(sphere(dvec3(2.0, 0.298, 2.7), 0.3, 3));
    room
}

fn cuboid(min: [f64; 3], max: [f64; 3]) -> Mesh {
    let (min, max) = (DVec3::from_array(min), DVec3::from_array(max));
    cuboid_at((min + max) * 0.5, (max - min) * 0.5, DMat3::IDENTITY)
}

/// A box by centre, half extents and rotation.
fn cuboid_at(center: DVec3, half: DVec3, rotation: DMat3) -> Mesh {
    let positions = (0..8)
        .map(|corner| {
            let side = |axis: u32| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
            let local = half * dvec3(side(0), side(1), side(2));
            (center + rotation * local).as_vec3()
        })
        .collect();
    // Four corners a face, counter-clockwise from outside.
    let faces: [[u32; 4]; 6] = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    Mesh {
        positions,
        indices: faces
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect(),
        skipped: 0,
    }
}

/// An icosahedron, each triangle split in four `levels` times.
fn sphere(center: DVec3, radius: f64, levels: u32) -> Mesh {
    let golden = (1.0 + 5.0f64.sqrt()) / 2.0;
    let mut unit: Vec<DVec3> = Vec::new();
    for (a, b) in [
        (-1.0, golden),
        (1.0, golden),
        (-1.0, -golden),
        (1.0, -golden),
    ] {
        unit.push(dvec3(a, b, 0.0));
    }
    for (a, b) in [
        (-1.0, golden),
        (1.0, golden),
        (-1.0, -golden),
        (1.0, -golden),
    ] {
        unit.push(dvec3(0.0, a, b));
    }
    for (a, b) in [
        (golden, -1.0),
        (golden, 1.0),
        (-golden, -1.0),
        (-golden, 1.0),
    ] {
        unit.push(dvec3(a, 0.0, b));
    }
    for p in &mut unit {
        *p = p.normalize();
    }
    let mut indices: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..levels {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                unit.push((unit[a as usize] + unit[b as usize]).normalize());
                unit.len() as u32 - 1
            })
        };
        indices = indices
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    Mesh {
        positions: unit
            .iter()
            .map(|&p| (center + p * radius).as_vec3())
            .collect(),
        indices,
        skipped: 0,
    }
}

/// A ring: `major` segments around, `minor` around the tube; its axis is the
/// rotated y.
fn torus(center: DVec3, radius: f64, tube: f64, rotation: DMat3, major: u32, minor: u32) -> Mesh {
    let mut positions: Vec<Vec3> = Vec::new();
    let mut indices = Vec::new();
    for i in 0..major {
        let (s, c) = (TAU * f64::from(i) / f64::from(major)).sin_cos();
        for j in 0..minor {
            let (sj, cj) = (TAU * f64::from(j) / f64::from(minor)).sin_cos();
            let r = radius + tube * cj;
            positions.push((center + rotation * dvec3(r * c, tube * sj, r * s)).as_vec3());
            let at = |i: u32, j: u32| (i % major) * minor + j % minor;
            let (a, b) = (at(i, j), at(i + 1, j));
            let (d, e) = (at(i, j + 1), at(i + 1, j + 1));
            indices.extend([[a, d, e], [a, e, b]]);
        }
    }
    Mesh {
        positions,
        indices,
        skipped: 0,
    }
}

/// A closed cylinder with `sides` sides.
fn rod_between(from: DVec3, to: DVec3, radius: f64, sides: u32) -> Mesh {
    let axis = (to - from).normalize();
    let (u, v) = axis.any_orthonormal_pair();
    let mut positions = Vec::new();
    let mut indices = Vec::new();
    for end in [from, to] {
        for i in 0..sides {
            let (s, c) = (TAU * f64::from(i) / f64::from(sides)).sin_cos();
            positions.push((end + (u * c + v * s) * radius).as_vec3());
        }
    }
    for i in 0..sides {
        let next = (i + 1) % sides;
        indices.extend([[i, next, sides + next], [i, sides + next, sides + i]]);
    }
    for i in 1..sides - 1 {
        indices.extend([[0, i + 1, i], [sides, sides + i, sides + i + 1]]);
    }
    Mesh {
        positions,
        indices,
        skipped: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every edge is used once in each direction, and the volume is positive:
    /// each object is closed and turned outwards.
    fn assert_closed(name: &str, mesh: &Mesh) {
        let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
        for &[a, b, c] in &mesh.indices {
            for edge in [(a, b), (b, c), (c, a)] {
                *edges.entry(edge).or_default() += 1;
            }
        }
        for (&(a, b), &uses) in &edges {
            assert_eq!(uses, 1, "{name}: edge {a}-{b}");
            assert_eq!(edges.get(&(b, a)), Some(&1), "{name}: edge {b}-{a}");
        }
        let volume: f64 = mesh
            .triangles()
            .map(|t| {
                let [a, b, c] = t.map(Vec3::as_dvec3);
                a.dot(b.cross(c))
            })
            .sum();
        assert!(volume > 0.0, "{name}: volume {volume}");
    }

    #[test]
    fn parts_are_closed_and_face_outwards() {
        let turn = DMat3::from_rotation_y(0.5);
        assert_closed("box", &cuboid_at(DVec3::ONE, DVec3::ONE, turn));
        assert_closed("sphere", &sphere(DVec3::ONE, 0.3, 3));
        assert_closed("ring", &torus(DVec3::ONE, 0.3, 0.1, turn, 32, 16));
        assert_closed("rod", &rod_between(DVec3::ONE, DVec3::ZERO, 0.1, 12));
        assert_closed("room", &toy_room());
    }

    #[test]
    fn the_room_is_small_and_has_no_degenerate_triangle() {
        let room = toy_room();
        let count = room.indices.len();
        assert!((1000..5000).contains(&count), "{count} triangles");
        for t in 0..count {
            assert!(room.geometric_normal(t).is_some(), "triangle {t}");
        }
    }
}
