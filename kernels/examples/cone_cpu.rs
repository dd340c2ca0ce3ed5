//! The shadow of a Sun with a disc, on the CPU: how much of it a wall leaves.
//!
//! `cargo run -p raytwin --example cone_cpu`
//!
//! A flat floor, and a wall of height 1 that stands between it and the Sun.
//! Farther from the wall the edge of its shadow grows softer.

use glam::{UVec2, Vec2, Vec3};
use raytwin::random::pcg::{pcg_next, pcg_seed, pcg_unit};
use raytwin::sample::{basis, cone};

const SAMPLES: u32 = 4096;
const TO_SUN: Vec3 = Vec3::new(0.6, 0.8, 0.0);
/// Half the angle that the Sun takes in the sky, in radians.
const HALF_ANGLE: f32 = 0.00465;

/// The part of the Sun's disc that is seen from the floor at `distance` from
/// the wall.
fn visible(distance: f32, seed: u32) -> f32 {
    let one_minus_cos = cone::cone_one_minus_cos(HALF_ANGLE);
    let frame = basis::basis_from_normal(TO_SUN);
    let mut state = pcg_seed(UVec2::new(seed, 0), 0);
    let mut seen = 0;
    for _ in 0..SAMPLES {
        let first = pcg_next(state);
        let second = pcg_next(first.state);
        state = second.state;
        let u = Vec2::new(pcg_unit(first.value), pcg_unit(second.value));
        let local = cone::cone_sample(u, one_minus_cos);
        let direction = basis::basis_to_world(frame, TO_SUN, local);
        // The ray's height where it passes the wall.
        if distance * direction.y / direction.x > 1.0 {
            seen += 1;
        }
    }
    seen as f32 / SAMPLES as f32
}

fn main() {
    // The middle of the shadow's edge.
    let edge = TO_SUN.x / TO_SUN.y;
    println!("distance to the wall   part of the Sun that is seen");
    for (row, offset) in [-0.01, -0.005, -0.002, 0.0, 0.002, 0.005, 0.01]
        .into_iter()
        .enumerate()
    {
        let part = visible(edge + offset, row as u32);
        println!("{:20.3}   {part:.3}", edge + offset);
    }
}
