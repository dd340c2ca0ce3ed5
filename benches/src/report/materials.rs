//! Samplers against each other, layers against what they cost, and the goals.

use std::hint::black_box;
use std::time::Instant;

use glam::{Vec2, Vec3, vec3};
use raytwin::contract::Kernel;
use raytwin_cpu::brdf::fresnel::fresnel_f0;
use raytwin_cpu::brdf::ggx::{ggx_d_between, ggx_reflect, ggx_visibility};
use raytwin_cpu::brdf::ggx_bounded::ggx_bounded_direction_sample;
use raytwin_cpu::brdf::ggx_ndf::{ggx_ndf_direction_pdf, ggx_ndf_sample};
use raytwin_cpu::brdf::ggx_visible::{
    ggx_visible_direction_pdf, ggx_visible_sample, ggx_visible_sample_heitz,
};
use raytwin_cpu::brdf::layered::{
    LayeredLayer, LayeredStack, layered_diffuse, layered_eval, layered_sample,
};
use raytwin_cpu::random::pcg::{pcg_hash, pcg_unit};
use raytwin_cpu::sample::hemisphere::{hemisphere_cosine_pdf, hemisphere_cosine_sample};
use raytwin_tests::gpu::{Build, Gpu, Program};

use super::error::ReportError;
use super::kernels::median;
use super::schema::{GoalRow, LayerRow, SamplerRow, finite};

/// GGX roughnesses.
const ALPHAS: [f32; 6] = [0.02, 0.05, 0.125, 0.25, 0.5, 1.0];

/// View angles in degrees.
const ANGLES: [f32; 5] = [0.0, 30.0, 60.0, 75.0, 85.0];

/// Elements of a timed array: it stays in the cache.
pub(super) const ELEMENTS: usize = 1 << 12;

/// Random numbers behind a variance.
const DRAWS: u32 = 1 << 16;

/// A direction and its density; a density of 0 is a dropped sample.
type Draw = fn(Vec2, Vec3, Vec2) -> (Vec3, f32);

#[inline(always)]
fn by_normals(u: Vec2, wo: Vec3, alpha: Vec2) -> (Vec3, f32) {
    let wi = ggx_reflect(wo, ggx_ndf_sample(u, alpha));
    (wi, ggx_ndf_direction_pdf(wo, wi, alpha))
}

#[inline(always)]
fn by_caps(u: Vec2, wo: Vec3, alpha: Vec2) -> (Vec3, f32) {
    let wi = ggx_reflect(wo, ggx_visible_sample(u, wo, alpha));
    (wi, ggx_visible_direction_pdf(wo, wi, alpha))
}

#[inline(always)]
fn by_disk(u: Vec2, wo: Vec3, alpha: Vec2) -> (Vec3, f32) {
    let wi = ggx_reflect(wo, ggx_visible_sample_heitz(u, wo, alpha));
    (wi, ggx_visible_direction_pdf(wo, wi, alpha))
}

#[inline(always)]
fn by_bounded(u: Vec2, wo: Vec3, alpha: Vec2) -> (Vec3, f32) {
    let ray = ggx_bounded_direction_sample(u, wo, alpha);
    (ray.direction, ray.pdf)
}

#[inline(always)]
fn by_cosine(u: Vec2, _: Vec3, _: Vec2) -> (Vec3, f32) {
    let wi = hemisphere_cosine_sample(u);
    (wi, hemisphere_cosine_pdf(wi))
}

/// What the table calls them.
const SAMPLERS: [&str; 4] = [
    "normal distribution",
    "visible normals, Heitz",
    "visible normals, caps",
    "bounded visible normals",
];

fn unit(index: u32) -> f32 {
    pcg_unit(pcg_hash(index))
}

fn pair(index: u32) -> Vec2 {
    Vec2::new(unit(2 * index), unit(2 * index + 1))
}

fn view(degrees: f32) -> Vec3 {
    let (s, c) = f64::from(degrees).to_radians().sin_cos();
    vec3((0.8 * s) as f32, (0.6 * s) as f32, c as f32)
}

/// Nanoseconds an element of each of several loops, in turns: medians.
pub(super) fn in_turns(runs: usize, loops: &mut [&mut dyn FnMut()]) -> Vec<f64> {
    let mut times = vec![Vec::new(); loops.len()];
    for _ in 0..runs.max(1) {
        for (run, times) in loops.iter_mut().zip(&mut times) {
            let start = Instant::now();
            run();
            times.push(start.elapsed().as_nanos() as f64 / ELEMENTS as f64);
        }
    }
    times.iter_mut().map(|t| median(t)).collect()
}

/// A direction and a density for each of several random numbers, the loop that
/// a user has. Generic, so that the sampler is compiled into it; not inlined,
/// so that the compiler knows that the lists are apart.
#[inline(never)]
fn draws<F: Fn(Vec2, Vec3, Vec2) -> (Vec3, f32)>(
    draw: F,
    u: &[Vec2],
    wo: &[Vec3],
    alpha: &[Vec2],
    out: &mut [(Vec3, f32)],
) {
    for (out, ((u, wo), alpha)) in out.iter_mut().zip(u.iter().zip(wo).zip(alpha)) {
        *out = draw(*u, *wo, *alpha);
    }
    black_box(out);
}

/// Variance of `value · cosine / density` over its squared mean, with a
/// Fresnel term of one.
fn variance(draw: Draw, wo: Vec3, alpha: Vec2) -> f64 {
    let (mut mean, mut spread) = (0.0, 0.0);
    for i in 0..DRAWS {
        let (wi, pdf) = draw(pair(i), wo, alpha);
        let mut weight = 0.0;
        if pdf > 0.0 {
            let dv = ggx_d_between(wo, wi, alpha) * ggx_visibility(wo, wi, alpha);
            weight = f64::from(dv * wi.z / pdf);
        }
        let before = weight - mean;
        mean += before / f64::from(i + 1);
        spread += before * (weight - mean);
    }
    spread / f64::from(DRAWS) / (mean * mean)
}

/// Variance and time of every sampler.
pub(super) fn samplers(runs: usize) -> Vec<SamplerRow> {
    let u: Vec<Vec2> = (0..ELEMENTS as u32).map(pair).collect();
    let mut out = Vec::new();
    for alpha in ALPHAS {
        for degrees in ANGLES {
            let (wo, a) = (view(degrees), Vec2::splat(alpha));
            let (views, alphas) = (vec![wo; ELEMENTS], vec![a; ELEMENTS]);
            let mut o: [Vec<(Vec3, f32)>; 4] =
                std::array::from_fn(|_| vec![(Vec3::ZERO, 0.0); ELEMENTS]);
            let [o0, o1, o2, o3] = &mut o;
            let ns = in_turns(
                runs,
                &mut [
                    &mut || draws(by_normals, &u, &views, &alphas, o0),
                    &mut || draws(by_disk, &u, &views, &alphas, o1),
                    &mut || draws(by_caps, &u, &views, &alphas, o2),
                    &mut || draws(by_bounded, &u, &views, &alphas, o3),
                ],
            );
            let variances = [
                by_normals as Draw,
                by_disk as Draw,
                by_caps as Draw,
                by_bounded as Draw,
            ]
            .map(|draw| variance(draw, wo, a));
            let first = variances[0] * ns[0];
            for k in 0..SAMPLERS.len() {
                out.push(SamplerRow {
                    sampler: SAMPLERS[k].into(),
                    alpha,
                    degrees,
                    variance: variances[k],
                    ns: ns[k],
                    efficiency: first / (variances[k] * ns[k]),
                });
            }
        }
    }
    out
}

// ------------------------------------------------------------------ layers

/// A car's paint: varnish, tinted lacquer, a layer of flakes, and glossy paint.
fn paint() -> [LayeredLayer; 4] {
    let layer = |eta: f32, depth: Vec3, alpha: f32| LayeredLayer {
        reflectance: Vec3::splat(fresnel_f0(eta)),
        eta,
        depth,
        alpha: Vec2::splat(alpha),
    };
    [
        layer(1.5, vec3(0.02, 0.02, 0.02), 0.02),
        layer(1.1, vec3(0.05, 0.25, 0.40), 0.15),
        LayeredLayer {
            reflectance: vec3(0.15, 0.13, 0.10),
            ..layer(1.0, Vec3::ZERO, 0.25)
        },
        layer(1.2, Vec3::ZERO, 0.4),
    ]
}

const BASE: Vec3 = vec3(0.6, 0.15, 0.1);

fn stack<const N: usize>(chosen: &[usize]) -> LayeredStack<N> {
    let paint = paint();
    let layers: [LayeredLayer; N] = std::array::from_fn(|k| paint[chosen[k]]);
    LayeredStack {
        layers,
        diffuse: layered_diffuse(BASE, layers[N - 1]),
    }
}

/// Directions with their weight in an integral over the hemisphere and over
/// views, drawn by the whole stack.
fn probes() -> Vec<(Vec3, Vec3, f64)> {
    let whole = stack::<4>(&[0, 1, 2, 3]);
    let mut out = Vec::new();
    for (k, degrees) in (0u32..).zip([0.0, 20.0, 40.0, 60.0, 75.0, 85.0]) {
        let wo = view(degrees);
        for i in 0..1 << 12 {
            let at = 3 * (i + (k << 12));
            let u = vec3(unit(at), unit(at + 1), unit(at + 2));
            let sample = layered_sample(&whole, wo, u);
            if sample.pdf > 0.0 {
                let z = f64::from(sample.direction.z);
                out.push((wo, sample.direction, z / f64::from(sample.pdf)));
            }
        }
    }
    out
}

/// Reflected light that is misplaced when only `chosen` layers stay, over all
/// that the whole stack reflects.
fn misplaced<const N: usize>(probes: &[(Vec3, Vec3, f64)], chosen: &[usize]) -> f64 {
    let whole = stack::<4>(&[0, 1, 2, 3]);
    let part = stack::<N>(chosen);
    let (mut apart, mut all) = (0.0, 0.0);
    for &(wo, wi, weight) in probes {
        let truth = layered_eval(&whole, wo, wi).as_dvec3();
        let found = layered_eval(&part, wo, wi).as_dvec3();
        apart += (found - truth).abs().element_sum() * weight;
        all += truth.element_sum() * weight;
    }
    apart / all
}

fn best<const N: usize>(probes: &[(Vec3, Vec3, f64)]) -> (f64, String) {
    const NAMES: [&str; 4] = ["varnish", "lacquer", "flakes", "paint"];
    let mut best = (f64::INFINITY, String::new());
    for mask in 0u32..16 {
        let chosen: Vec<usize> = (0..4).filter(|k| mask >> k & 1 == 1).collect();
        if chosen.len() != N {
            continue;
        }
        let error = misplaced::<N>(probes, &chosen);
        if error < best.0 {
            let names: Vec<&str> = chosen.iter().map(|k| NAMES[*k]).collect();
            best = (error, names.join(", "));
        }
    }
    best
}

/// Words of arguments, and a buffer for the results.
struct Timed {
    kernel: Kernel,
    input: Vec<u32>,
    output: Vec<u32>,
}

impl Timed {
    fn new(kernels: Vec<Kernel>, name: &str) -> Option<Self> {
        let kernel = kernels.into_iter().find(|k| k.name == name)?;
        let input = kernel.draw_many(ELEMENTS, 77);
        let output = vec![0; ELEMENTS * kernel.words_out()];
        Some(Self {
            kernel,
            input,
            output,
        })
    }

    fn run(&mut self) {
        self.kernel
            .run_cpu(black_box(&self.input), black_box(&mut self.output));
    }
}

const TIMED: [&str; 3] = ["layered_pdf", "layered_eval", "layered_sample"];

/// What 1 to 4 layers cost, and what is lost without the others.
pub(super) fn layers(
    runs: usize,
    with_cpu: bool,
    gpus: &[&Gpu],
) -> Result<Vec<LayerRow>, ReportError> {
    use raytwin::brdf::layered::kernels;
    let probes = probes();
    let lost = [
        best::<1>(&probes),
        best::<2>(&probes),
        best::<3>(&probes),
        best::<4>(&probes),
    ];
    let mut rows: Vec<LayerRow> = (1..)
        .zip(lost)
        .map(|(layers, (error, kept))| LayerRow {
            layers,
            kept,
            error,
            ..LayerRow::default()
        })
        .collect();
    for (which, name) in TIMED.into_iter().enumerate() {
        let mut timed: Vec<Timed> = [
            kernels::<1>(),
            kernels::<2>(),
            kernels::<3>(),
            kernels::<4>(),
        ]
        .into_iter()
        .filter_map(|k| Timed::new(k, name))
        .collect();
        if with_cpu && let [a, b, c, d] = &mut timed[..] {
            let ns = in_turns(
                runs,
                &mut [
                    &mut || a.run(),
                    &mut || b.run(),
                    &mut || c.run(),
                    &mut || {
                        d.run();
                    },
                ],
            );
            for (row, ns) in rows.iter_mut().zip(ns) {
                row.cpu_ns[which] = finite(ns);
            }
        }
        for gpu in gpus {
            let programs: Result<Vec<Program>, _> = timed
                .iter()
                .map(|t| Program::new(gpu, &t.kernel, Build::Plain))
                .collect();
            let programs = programs?;
            let inputs: Vec<Vec<u32>> = timed
                .iter()
                .map(|t| t.kernel.draw_many(1 << 16, 78))
                .collect();
            let mut times = vec![Vec::new(); programs.len()];
            for _ in 0..5 {
                for ((program, input), times) in programs.iter().zip(&inputs).zip(&mut times) {
                    times.push(program.time(input, 1));
                }
            }
            for (row, times) in rows.iter_mut().zip(&mut times) {
                row.gpu_ns.entry(gpu.label()).or_default()[which] = finite(median(times));
            }
        }
    }
    Ok(rows)
}

// ------------------------------------------------------------------- goals

/// Bounded visible normals against the cosine hemisphere: nanoseconds of a
/// sample with its density, over views and roughnesses of all kinds.
fn bounded_over_cosine(runs: usize) -> (f64, f64) {
    let u: Vec<Vec2> = (0..ELEMENTS as u32).map(pair).collect();
    let wo: Vec<Vec3> = (0..ELEMENTS as u32)
        .map(|i| hemisphere_cosine_sample(pair(i + (1 << 20))))
        .collect();
    let alpha: Vec<Vec2> = (0..ELEMENTS as u32)
        .map(|i| Vec2::splat(0.02) + 0.98 * pair(i + (1 << 21)))
        .collect();
    let mut first = vec![(Vec3::ZERO, 0.0); ELEMENTS];
    let mut second = first.clone();
    let ns = in_turns(
        runs,
        &mut [
            &mut || draws(by_cosine, &u, &wo, &alpha, &mut first),
            &mut || draws(by_bounded, &u, &wo, &alpha, &mut second),
        ],
    );
    (ns[1], ns[0])
}

/// The speed goals of the materials, from one run.
pub(super) fn goals(runs: usize, layers: &[LayerRow]) -> Vec<GoalRow> {
    let (bounded, cosine) = bounded_over_cosine(4 * runs);
    let mut out = vec![GoalRow {
        name: "bounded visible normals, sample and density, over the cosine hemisphere's".into(),
        backend: "cpu".into(),
        measured: bounded / cosine,
        limit: 2.0,
        detail: format!("{bounded:.1} ns over {cosine:.1} ns"),
        shader: None,
    }];
    let pdf = |row: &LayerRow| row.cpu_ns[0];
    if let Some(one) = layers.first().and_then(pdf) {
        for row in &layers[1..] {
            if let Some(ns) = pdf(row) {
                out.push(GoalRow {
                    name: format!(
                        "density of {} layers over {0} times that of one",
                        row.layers
                    ),
                    backend: "cpu".into(),
                    measured: ns / (one * f64::from(row.layers)),
                    limit: 1.15,
                    detail: format!("{ns:.0} ns over {} times {one:.0} ns", row.layers),
                    shader: None,
                });
            }
        }
    }
    out
}

/// The name of a baseline that is the same math without our structure.
pub(super) const BY_HAND: &str = "by hand";

/// Kernels against the same math written by hand, for each adapter: a program
/// of each in turns.
pub(super) fn by_hand(
    kernels: &[Kernel],
    runs: usize,
    gpus: &[&Gpu],
) -> Result<Vec<GoalRow>, ReportError> {
    let mut out = Vec::new();
    for kernel in kernels {
        let Some(hand) = kernel.baselines.iter().find(|b| b.name == BY_HAND) else {
            continue;
        };
        for gpu in gpus {
            let ours = Program::new(gpu, kernel, Build::Plain)?;
            let theirs = Program::with_function(gpu, kernel, Build::Plain, "baseline", hand.wgsl)?;
            let input = kernel.draw_many(1 << 16, 79);
            let mut times = [Vec::new(), Vec::new()];
            for _ in 0..runs.max(1) {
                times[0].push(ours.time(&input, 1));
                times[1].push(theirs.time(&input, 1));
            }
            let [a, b] = times.map(|mut t| median(&mut t));
            out.push(GoalRow {
                name: format!("{} over the same math by hand", kernel.name),
                backend: gpu.label(),
                measured: a / b,
                limit: 1.3,
                detail: format!("{a:.1} ns over {b:.1} ns"),
                shader: Some(hand.wgsl.trim().into()),
            });
        }
    }
    Ok(out)
}
