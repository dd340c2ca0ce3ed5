//! Meshes made in code, the same on every machine.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

/// Vertices and triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Three vertex indices a triangle.
    pub indices: Vec<[u32; 3]>,
}

impl Mesh {
    /// The corners of a triangle.
    #[must_use]
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.indices[triangle].map(|i| self.positions[i as usize])
    }

    /// Every vertex multiplied by `scale`, then moved.
    #[must_use]
    pub fn placed(mut self, scale: f32, offset: Vec3) -> Self {
        for p in &mut self.positions {
            *p = *p * scale + offset;
        }
        self
    }

    /// Adds another mesh's triangles.
    pub fn append(&mut self, other: &Self) {
        let base = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.indices
            .extend(other.indices.iter().map(|t| t.map(|i| i + base)));
    }

    /// Whether each edge has as many triangles on one side as on the other,
    /// which makes a ray from inside hit something.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        let mut sides: HashMap<(u32, u32), i32> = HashMap::new();
        for t in &self.indices {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                if a != b {
                    *sides.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
                }
            }
        }
        sides.values().all(|&n| n == 0)
    }
}

/// A small generator: PCG's output function over a counter.
#[derive(Clone, Debug)]
pub struct Random(u32);

impl Random {
    /// Starts a sequence.
    #[must_use]
    pub fn new(seed: u32) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9))
    }

    /// 32 random bits.
    pub fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let x = ((self.0 >> ((self.0 >> 28) + 4)) ^ self.0).wrapping_mul(277_803_737);
        (x >> 22) ^ x
    }

    /// An index below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        ((u64::from(self.word()) * n as u64) >> 32) as usize
    }

    /// In `[0, 1)`.
    pub fn unit(&mut self) -> f32 {
        (self.word() >> 8) as f32 / 16_777_216.0
    }

    /// In `[-1, 1)`.
    pub fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    /// 1 or -1.
    pub fn sign(&mut self) -> f32 {
        if self.word() & 1 == 1 { -1.0 } else { 1.0 }
    }

    /// 0 or -0.
    pub fn zero(&mut self) -> f32 {
        0.0 * self.sign()
    }

    /// A direction of about unit length.
    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = Vec3::new(self.signed(), self.signed(), self.signed());
            let n = v.x * v.x + v.y * v.y + v.z * v.z;
            if (0.01..=1.0).contains(&n) {
                return v / n.sqrt();
            }
        }
    }
}

/// The surface of a cube of `n` by `n` squares a face, two triangles each, on
/// integer coordinates from `-n/2` to `n/2` (`n` even). Closed.
#[must_use]
pub fn lattice_cube(n: i32) -> Mesh {
    let mut mesh = Mesh::default();
    let mut known: HashMap<[i32; 3], u32> = HashMap::new();
    let half = n / 2;
    for axis in 0..3usize {
        for side in [-1, 1] {
            for i in 0..n {
                for j in 0..n {
                    let mut corner = |di: i32, dj: i32| {
                        let mut p = [0; 3];
                        p[axis] = side * half;
                        p[(axis + 1) % 3] = i + di - half;
                        p[(axis + 2) % 3] = j + dj - half;
                        *known.entry(p).or_insert_with(|| {
                            mesh.positions
                                .push(Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32));
                            mesh.positions.len() as u32 - 1
                        })
                    };
                    let (a, b, c, d) = (corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1));
                    // Both diagonals, so that no direction is special.
                    let pair = if (i + j) % 2 == 0 {
                        [[a, b, c], [a, c, d]]
                    } else {
                        [[a, b, d], [b, c, d]]
                    };
                    for t in pair {
                        mesh.indices
                            .push(if side > 0 { t } else { [t[0], t[2], t[1]] });
                    }
                }
            }
        }
    }
    mesh
}

/// A closed bumpy sphere of about `triangles` triangles, radius 0.8 to 1.2,
/// around the origin: every ray from the origin's neighbourhood must hit it.
#[must_use]
pub fn displaced_sphere(triangles: usize) -> Mesh {
    let n = (2.0 * (triangles as f64 / 48.0).sqrt().round()).max(2.0) as i32;
    let mut mesh = lattice_cube(n);
    let mut random = Random::new(3);
    for p in &mut mesh.positions {
        // Spread the squares of a face evenly over the sphere.
        let q = p.as_dvec3() * (2.0 / f64::from(n));
        let q = DVec3::from_array(
            q.to_array()
                .map(|v| (v * std::f64::consts::FRAC_PI_4).tan()),
        )
        .normalize();
        let bumps = (7.0 * q.x).sin() * (5.0 * q.y + 1.0).sin() * (6.0 * q.z + 2.0).sin();
        let r = 1.0 + 0.15 * bumps + 0.2 / f64::from(n) * f64::from(random.signed());
        *p = (q * r).as_vec3();
    }
    mesh
}

/// A sitting hare of about `triangles` triangles: bumpy ellipsoids, each closed,
/// that reach into each other; folds, thin ears, triangles of different size.
#[must_use]
pub fn hare(triangles: usize) -> Mesh {
    // Share of the triangles, centre, half axes, lean in x per y.
    type Part = (f64, [f32; 3], [f32; 3], f32);
    const PARTS: [Part; 9] = [
        (0.34, [0.0, 0.0, 0.0], [0.8, 0.7, 0.6], 0.1),
        (0.2, [0.75, 0.75, 0.0], [0.42, 0.36, 0.33], 0.0),
        (0.1, [0.45, 1.35, 0.18], [0.1, 0.5, 0.14], -0.3),
        (0.1, [0.5, 1.35, -0.18], [0.1, 0.5, 0.14], -0.4),
        (0.08, [-0.3, -0.3, 0.42], [0.45, 0.36, 0.22], 0.0),
        (0.08, [-0.3, -0.3, -0.42], [0.45, 0.36, 0.22], 0.0),
        (0.03, [0.65, -0.5, 0.25], [0.3, 0.16, 0.12], 0.0),
        (0.03, [0.65, -0.5, -0.25], [0.3, 0.16, 0.12], 0.0),
        (0.04, [-0.85, -0.15, 0.0], [0.2, 0.2, 0.2], 0.0),
    ];
    let mut mesh = Mesh::default();
    for (share, centre, axes, lean) in PARTS {
        let mut part = displaced_sphere((triangles as f64 * share) as usize);
        for p in &mut part.positions {
            let q = *p * Vec3::from_array(axes);
            *p = Vec3::new(q.x + lean * q.y, q.y, q.z) + Vec3::from_array(centre);
        }
        mesh.append(&part);
    }
    mesh
}

/// An open field of hills, about `triangles` triangles, over `[-10, 10]²`, y up.
#[must_use]
pub fn terrain(triangles: usize) -> Mesh {
    let n = (triangles as f64 / 2.0).sqrt().round().max(1.0) as u32;
    let mut mesh = Mesh::default();
    for j in 0..=n {
        for i in 0..=n {
            let x = 20.0 * f64::from(i) / f64::from(n) - 10.0;
            let z = 20.0 * f64::from(j) / f64::from(n) - 10.0;
            let mut y = 0.0;
            for octave in 0..6 {
                let f = 0.4 * 1.9f64.powi(octave);
                y += (f * x + 1.3 * f64::from(octave)).sin() * (f * 1.1 * z).cos() / f * 0.4;
            }
            mesh.positions.push(DVec3::new(x, y, z).as_vec3());
        }
    }
    let at = |i: u32, j: u32| j * (n + 1) + i;
    for j in 0..n {
        for i in 0..n {
            mesh.indices.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            mesh.indices
                .push([at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]);
        }
    }
    mesh
}

/// [`displaced_sphere`] with a vertex 3e-5 of an edge's length beside one edge
/// of each triangle, which makes a needle of aspect 3e4, and at every fourth
/// triangle another edge cut in the middle with a triangle of no area to close
/// the gap. Closed.
#[must_use]
pub fn sliver_sphere(triangles: usize) -> Mesh {
    let base = displaced_sphere(triangles / 4);
    let mut mesh = Mesh {
        positions: base.positions.clone(),
        indices: Vec::new(),
    };
    for (i, &[a, b, c]) in base.indices.iter().enumerate() {
        let [pa, pb, pc] = base.corners(i).map(|p| p.as_dvec3());
        let near = (pa + pb) * 0.5 + (pc - (pa + pb) * 0.5) * 3e-5;
        let p = mesh.positions.len() as u32;
        mesh.positions.push(near.as_vec3());
        mesh.indices.extend([[a, b, p], [c, a, p]]);
        if i % 4 == 0 {
            let m = mesh.positions.len() as u32;
            mesh.positions.push(((pb + pc) * 0.5).as_vec3());
            mesh.indices.extend([[b, c, m], [b, m, p], [m, c, p]]);
        } else {
            mesh.indices.push([b, c, p]);
        }
    }
    mesh
}

/// A box, given by its centre and three half axes. Closed.
#[must_use]
pub fn oriented_box(center: Vec3, axes: [Vec3; 3]) -> Mesh {
    let mut mesh = lattice_cube(2);
    // Only the corners: two triangles a side.
    mesh.positions = (0..8)
        .map(|i| {
            let s = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            center + axes[0] * s(0) + axes[1] * s(1) + axes[2] * s(2)
        })
        .collect();
    mesh.indices = vec![
        [0, 2, 3],
        [0, 3, 1],
        [4, 5, 7],
        [4, 7, 6],
        [0, 1, 5],
        [0, 5, 4],
        [2, 6, 7],
        [2, 7, 3],
        [0, 4, 6],
        [0, 6, 2],
        [1, 3, 7],
        [1, 7, 5],
    ];
    mesh
}

/// A closed room of 8 by 3 by 6 with thin tilted rods, boxes and balls in it.
#[must_use]
pub fn room() -> Mesh {
    let mut random = Random::new(11);
    let mut mesh = oriented_box(Vec3::ZERO, [Vec3::X * 4.0, Vec3::Y * 1.5, Vec3::Z * 3.0]);
    for t in &mut mesh.indices {
        t.swap(1, 2);
    }
    for _ in 0..200 {
        let center = Vec3::new(
            3.0 * random.signed(),
            random.signed(),
            2.0 * random.signed(),
        );
        let d = random.direction();
        let side = Vec3::new(-d.y, d.x, 0.25 * d.z) * 0.003;
        let up = Vec3::new(0.25 * d.x, -d.z, d.y) * 0.003;
        mesh.append(&oriented_box(center, [d * 0.4, side, up]));
    }
    let ball = displaced_sphere(3_000);
    for _ in 0..6 {
        let center = Vec3::new(
            3.0 * random.signed(),
            random.signed(),
            2.0 * random.signed(),
        );
        mesh.append(&ball.clone().placed(0.3, center));
    }
    mesh
}

/// A closed hall of length 20 000 and width 2, twelve triangles, tilted: walls
/// that reach ten thousand times farther than they are away.
#[must_use]
pub fn tilted_hall() -> Mesh {
    let along = DVec3::new(0.5, 0.3, 1.0).normalize();
    let side = along.cross(DVec3::Y).normalize();
    let up = side.cross(along);
    oriented_box(
        Vec3::ZERO,
        [(along * 1e4).as_vec3(), side.as_vec3(), up.as_vec3()],
    )
}

/// The hall along the z axis: the boxes of its walls have no thickness.
#[must_use]
pub fn straight_hall() -> Mesh {
    oriented_box(
        Vec3::new(0.1, 0.3, 0.7),
        [Vec3::Z * 1.1e4, Vec3::X * 0.9, Vec3::Y * 1.2],
    )
}
