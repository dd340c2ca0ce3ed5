//! Ambient occlusion baked into the vertices of a mesh, on the CPU.
//!
//! `cargo run --release -p raytwin --example bake_ao --features build [FILE.ply]`
//!
//! A ball of radius 1 rests on a floor. What the ball leaves of the sky above a
//! point of the floor is known exactly, so the table shows how far the bake is
//! from it. With a file name the mesh is written with a grey level a vertex.

use std::error::Error;
use std::f32::consts::{PI, TAU};
use std::fmt::Write;

use glam::{UVec2, Vec2, Vec3};
use raytwin::random::pcg::{pcg_next, pcg_seed, pcg_unit};
use raytwin::ray::bvh::{BvhView, bvh_any};
use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin::ray::ray::Ray;
use raytwin::sample::{basis, hemisphere};

const SAMPLES: u32 = 1024;
/// How far a ray starts from its surface.
const OFFSET: f32 = 1e-3;

#[derive(Default)]
struct Mesh {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A grid of `across` by `down` quads; `point` gives position and normal.
    fn add_grid(&mut self, across: u32, down: u32, point: impl Fn(Vec2) -> (Vec3, Vec3)) {
        let first = self.positions.len() as u32;
        for y in 0..=down {
            for x in 0..=across {
                let at = Vec2::new(x as f32 / across as f32, y as f32 / down as f32);
                let (position, normal) = point(at);
                self.positions.push(position);
                self.normals.push(normal);
            }
        }
        for y in 0..down {
            for x in 0..across {
                let a = first + y * (across + 1) + x;
                let (b, c) = (a + 1, a + across + 1);
                self.triangles.push([a, b, c]);
                self.triangles.push([b, c + 1, c]);
            }
        }
    }
}

/// The part of the sky that a surface sees, weighted by the cosine.
fn open_sky(view: &BvhView<'_>, position: Vec3, normal: Vec3, seed: u32) -> f32 {
    let frame = basis::basis_from_normal(normal);
    let mut state = pcg_seed(UVec2::new(seed, 0), 0);
    let mut open = 0;
    for _ in 0..SAMPLES {
        let first = pcg_next(state);
        let second = pcg_next(first.state);
        state = second.state;
        let u = Vec2::new(pcg_unit(first.value), pcg_unit(second.value));
        let local = hemisphere::hemisphere_cosine_sample(u);
        let ray = Ray {
            origin: position + normal * OFFSET,
            direction: basis::basis_to_world(frame, normal, local),
            t_min: 0.0,
            t_max: f32::MAX,
        };
        open += u32::from(bvh_any(view, ray) == 0);
    }
    open as f32 / SAMPLES as f32
}

fn ply(mesh: &Mesh, levels: &[f32]) -> Result<String, std::fmt::Error> {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    );
    for (p, level) in mesh.positions.iter().zip(levels) {
        let grey = (level * 255.0).round() as u8;
        writeln!(text, "{} {} {} {grey} {grey} {grey}", p.x, p.y, p.z)?;
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(text, "3 {a} {b} {c}")?;
    }
    Ok(text)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut mesh = Mesh::default();
    mesh.add_grid(32, 32, |at| {
        let p = (at - 0.5) * 8.0;
        (Vec3::new(p.x, 0.0, p.y), Vec3::Y)
    });
    let floor = mesh.positions.len();
    mesh.add_grid(64, 32, |at| {
        let (sin, cos) = (at.x * TAU).sin_cos();
        let (ring, height) = (at.y * PI).sin_cos();
        let normal = Vec3::new(ring * cos, height, ring * sin);
        (normal + Vec3::Y, normal)
    });

    let bvh = Bvh::build(&mesh.positions, &mesh.triangles, BuildQuality::Medium)?;
    let view = bvh.view();
    let levels: Vec<f32> = mesh
        .positions
        .iter()
        .zip(&mesh.normals)
        .enumerate()
        .map(|(i, (p, n))| open_sky(&view, *p, *n, i as u32))
        .collect();

    // The ball's form factor seen from the floor is 1 / (1 + d^2)^(3/2).
    println!("distance   baked   exact");
    let row = floor / 2;
    for i in (row..row + 17).step_by(2) {
        let d = Vec2::new(mesh.positions[i].x, mesh.positions[i].z).length();
        let exact = 1.0 - (1.0 + d * d).powf(-1.5);
        println!("{d:8.2}   {:.3}   {exact:.3}", levels[i]);
    }
    if let Some(path) = std::env::args().nth(1) {
        std::fs::write(&path, ply(&mesh, &levels)?).map_err(|e| format!("{path}: {e}"))?;
        println!("{path} written");
    }
    Ok(())
}
