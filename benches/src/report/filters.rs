//! What filters cost on whole images.

use std::time::Instant;

use glam::{UVec2, Vec3, vec3};
use rayon::prelude::*;
use raytwin::filter::svgf::{SvgfColor, SvgfScalar, SvgfSettings, SvgfSurface};
use raytwin::filter::svgf::{svgf_atrous_pixel, svgf_atrous_scalar_pixel};
use raytwin::pass::svgf::SvgfPass;
use raytwin_cpu::random::pcg::{pcg_hash, pcg_unit};

use super::kernels::median;
use super::schema::GoalRow;

/// Where the time a pixel is compared: from 480p to 4K.
const SIZES: [UVec2; 3] = [
    UVec2::new(854, 480),
    UVec2::new(1920, 1080),
    UVec2::new(3840, 2160),
];

/// Where the straightforward loop is timed, which is slow.
const SMALL: UVec2 = UVec2::new(640, 360);

fn noise(at: UVec2, lane: u32) -> f32 {
    pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
}

/// A wall of panels with slightly rough normals.
fn surface(at: UVec2) -> SvgfSurface {
    let step = if (at.x / 64 + at.y / 64).is_multiple_of(3) {
        1.0
    } else {
        0.0
    };
    let tilt = vec3(0.05 * noise(at, 1), 0.05 * noise(at, 2), 1.0);
    SvgfSurface {
        position: vec3(at.x as f32, at.y as f32, step) * 0.01,
        reach: 0.01,
        normal: tilt.normalize(),
    }
}

fn value(at: UVec2) -> [f32; 3] {
    std::array::from_fn(|c| noise(at, 3 + c as u32))
}

const VARIANCE: f32 = 0.08;

/// Milliseconds of all passes, the median.
fn passes<const C: usize>(size: UVec2, repeats: usize) -> f64 {
    let mut pass = SvgfPass::<C>::new(size, SvgfSettings::PAPER);
    pass.set_surfaces(surface);
    let mut times: Vec<f64> = (0..repeats)
        .map(|_| {
            pass.set_image(|at| (std::array::from_fn(|c| value(at)[c]), VARIANCE));
            let start = Instant::now();
            pass.filter(|_| ());
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    median(&mut times)
}

fn pixels(size: UVec2) -> impl IndexedParallelIterator<Item = UVec2> {
    (0..size.x * size.y)
        .into_par_iter()
        .map(move |i| UVec2::new(i % size.x, i / size.x))
}

/// The readable way: the function for a pixel, over every pixel, in parallel.
fn loops(size: UVec2) -> (f64, f64) {
    let settings = SvgfSettings::PAPER;
    let index = |at: UVec2| (at.y * size.x + at.x) as usize;
    let surfaces: Vec<SvgfSurface> = pixels(size).map(surface).collect();
    let read_surface = |at: UVec2| surfaces[index(at)];
    let mut colours: Vec<SvgfColor> = pixels(size)
        .map(|at| SvgfColor {
            value: Vec3::from_array(value(at)),
            variance: VARIANCE,
        })
        .collect();
    let start = Instant::now();
    for i in 0..settings.passes {
        let read = |at: UVec2| colours[index(at)];
        colours = pixels(size)
            .map(|at| svgf_atrous_pixel(at, size, 1 << i, settings, read_surface, read))
            .collect();
    }
    let colour = start.elapsed().as_secs_f64() * 1e3;
    let mut scalars: Vec<SvgfScalar> = pixels(size)
        .map(|at| SvgfScalar {
            value: value(at)[0],
            variance: VARIANCE,
        })
        .collect();
    let start = Instant::now();
    for i in 0..settings.passes {
        let read = |at: UVec2| scalars[index(at)];
        scalars = pixels(size)
            .map(|at| svgf_atrous_scalar_pixel(at, size, 1 << i, settings, read_surface, read))
            .collect();
    }
    (colour, start.elapsed().as_secs_f64() * 1e3)
}

/// The speed goals of the filters on the CPU.
pub(super) fn goals(repeats: usize) -> Vec<GoalRow> {
    let mut out = Vec::new();
    let threads = rayon::current_num_threads();
    let mut goal = |name: String, measured: f64, limit: f64, detail: String| {
        out.push(GoalRow {
            name,
            backend: "cpu".into(),
            measured,
            limit,
            detail,
            shader: None,
        });
    };
    let colours = SIZES.map(|size| {
        // The largest takes seconds.
        let repeats = if size == SIZES[2] { 1 } else { repeats };
        (size, passes::<3>(size, repeats))
    });
    let scalar = passes::<1>(SIZES[1], repeats);
    let (_, colour) = colours[1];
    goal(
        "SVGF, five passes, RGB at 1080p, over 200 ms".into(),
        colour / 200.0,
        1.0,
        format!("{colour:.0} ms on {threads} threads"),
    );
    goal(
        "SVGF, five passes, scalar at 1080p, over 80 ms".into(),
        scalar / 80.0,
        1.0,
        format!("{scalar:.0} ms on {threads} threads"),
    );
    let (loop_colour, loop_scalar) = loops(SMALL);
    let (small_colour, small_scalar) = (passes::<3>(SMALL, repeats), passes::<1>(SMALL, repeats));
    for (what, ours, theirs) in [
        ("RGB", small_colour, loop_colour),
        ("scalar", small_scalar, loop_scalar),
    ] {
        goal(
            format!("SVGF, {what}, over an eighth of the loop over pixels"),
            8.0 * ours / theirs,
            1.0,
            format!("{ours:.0} ms over {theirs:.0} ms at 360p, both on {threads} threads"),
        );
    }
    let a_pixel = colours.map(|(size, ms)| ms * 1e6 / f64::from(size.x * size.y));
    let mean = a_pixel.iter().sum::<f64>() / 3.0;
    let worst = a_pixel
        .iter()
        .map(|t| (t / mean - 1.0).abs())
        .fold(0.0, f64::max);
    goal(
        "SVGF, time a pixel from 480p to 4K, away from the mean".into(),
        worst,
        0.15,
        format!(
            "{:.0}, {:.0} and {:.0} ns",
            a_pixel[0], a_pixel[1], a_pixel[2]
        ),
    );
    out
}
