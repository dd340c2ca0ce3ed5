//! What a sampler must be beyond accurate: distributed as its density says,
//! invertible, stratified, without correlation.
//!
//! Every test runs on the CPU twin and, through the shader as shipped, on
//! every adapter; without an adapter the second half fails and says what to
//! install. Seeds are fixed, so a result never changes by chance. The tests
//! whose names begin with `rejects_` feed each check something that is wrong
//! in a way that renderers ship, and expect it to be caught.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use glam::{UVec2, Vec3};
use raytwin::contract::{Kernel, ulp};
use raytwin::random::halton::{HALTON_PERIOD, HALTON_PRIMES, HALTON_STRIDE};
use raytwin::random::pcg::{pcg_hash, pcg_next, pcg_seed, pcg_unit};
use raytwin_tests::gpu::{self, Build, Program};
use raytwin_tests::measure::run_cpu;
use raytwin_tests::on_both_twins;
use raytwin_tests::statistics::{
    Bins, chi_square, equal_area_grid, mean_variance, pearson, sidak, turn_distance, turn_of,
};
use raytwin_tests::twin::{
    EPS, Run, Twin, all_kernels, components, f32_words, float, kernel, random_pairs,
};

on_both_twins! {
    samples_follow_the_density
    densities_integrate_to_one
    inverses_return_the_random_numbers
    narrow_cones_keep_every_radius
    bases_are_orthonormal_and_right_handed
    radical_inverses_match_exact_ratios
    every_elementary_interval_gets_one_point
    halton_indices_permute_the_tile
    rotation_permutes_the_unit_interval
    units_stay_below_one
    draws_are_uniform_and_uncorrelated
    seeds_of_neighbours_are_uncorrelated
    hashes_do_not_collide
}

// ---------------------------------------------------------------- the warps

/// Where a warp's points lie.
#[derive(Clone, Copy, PartialEq)]
enum Shape {
    Disk,
    Sphere,
    /// A cone with this `1 - cos`.
    Cone(f32),
}

/// How a warp's error passes through its inverse.
#[derive(Clone, Copy)]
enum Inverse {
    /// Radius and azimuth of a point on the disk.
    Polar,
    /// The square map, of a disk or of what lies above it.
    Concentric,
    /// Height and azimuth, of a direction on the sphere or hemisphere; the
    /// number is how much `u.x` moves with `z`.
    Height(f64),
    /// Height over the cone's own, and azimuth.
    Cone,
}

struct Warp {
    name: &'static str,
    sample: &'static str,
    pdf: &'static str,
    invert: &'static str,
    shape: Shape,
    inverse: Inverse,
}

/// `1 - cos 0.00465`: the Sun.
const SUN: f32 = 1.081_123_1e-5;

fn warps() -> Vec<Warp> {
    let warp = |name, sample, pdf, invert, shape, inverse| Warp {
        name,
        sample,
        pdf,
        invert,
        shape,
        inverse,
    };
    let cone = |name, one_minus_cos| {
        warp(
            name,
            "sample/cone::cone_sample",
            "sample/cone::cone_pdf",
            "sample/cone::cone_invert",
            Shape::Cone(one_minus_cos),
            Inverse::Cone,
        )
    };
    vec![
        warp(
            "polar disk",
            "sample/disk::disk_polar_sample",
            "sample/disk::disk_pdf",
            "sample/disk::disk_polar_invert",
            Shape::Disk,
            Inverse::Polar,
        ),
        warp(
            "concentric disk",
            "sample/disk::disk_concentric_sample",
            "sample/disk::disk_pdf",
            "sample/disk::disk_concentric_invert",
            Shape::Disk,
            Inverse::Concentric,
        ),
        warp(
            "sphere",
            "sample/sphere::sphere_sample",
            "sample/sphere::sphere_pdf",
            "sample/sphere::sphere_invert",
            Shape::Sphere,
            Inverse::Height(0.5),
        ),
        warp(
            "cosine hemisphere",
            "sample/hemisphere::hemisphere_cosine_sample",
            "sample/hemisphere::hemisphere_cosine_pdf",
            "sample/hemisphere::hemisphere_cosine_invert",
            Shape::Sphere,
            Inverse::Concentric,
        ),
        warp(
            "uniform hemisphere",
            "sample/hemisphere::hemisphere_uniform_sample",
            "sample/hemisphere::hemisphere_uniform_pdf",
            "sample/hemisphere::hemisphere_uniform_invert",
            Shape::Sphere,
            Inverse::Height(1.0),
        ),
        cone("cone of the Sun", SUN),
        cone("cone of 1 - cos = 0.1", 0.1),
        cone("cone of 1 - cos = 1", 1.0),
        cone("cone of 1 - cos = 2", 2.0),
    ]
}

/// `1 - z` of a direction, from x and y near the pole.
fn height([x, y, z]: [f64; 3]) -> f64 {
    if z > 0.0 {
        (x * x + y * y) / (1.0 + z)
    } else {
        1.0 - z
    }
}

impl Shape {
    /// Components of a point.
    fn words(self) -> usize {
        if self == Self::Disk { 2 } else { 3 }
    }

    /// The argument that follows the point or the random numbers.
    fn parameter(self) -> Option<u32> {
        match self {
            Self::Cone(one_minus_cos) => Some(one_minus_cos.to_bits()),
            _ => None,
        }
    }

    /// Argument lists: each point or pair, and the parameter behind it.
    fn arguments(self, words: impl IntoIterator<Item = u32>, each: usize) -> Vec<u32> {
        let mut words: Vec<u32> = words.into_iter().collect();
        if let Some(parameter) = self.parameter() {
            let mut longer = Vec::with_capacity(words.len() / each * (each + 1));
            for point in words.chunks_exact(each) {
                longer.extend_from_slice(point);
                longer.push(parameter);
            }
            words = longer;
        }
        words
    }

    fn bins(self) -> Bins {
        let (rows, columns, range) = match self {
            Self::Disk => (101, 101, (0.0, 1.0)),
            Self::Sphere => (101, 202, (-1.0, 1.0)),
            Self::Cone(_) => (101, 202, (0.0, 1.0)),
        };
        Bins {
            rows,
            columns,
            range,
        }
    }

    /// Area or solid angle of one bin.
    fn bin_area(self) -> f64 {
        let whole = match self {
            Self::Disk => PI,
            Self::Sphere => 2.0 * TAU,
            Self::Cone(one_minus_cos) => TAU * f64::from(one_minus_cos),
        };
        whole / self.bins().count() as f64
    }

    /// The first coordinate of a point: squared radius, cosine, or height in
    /// units of the cone's.
    fn first(self, p: [f64; 3]) -> f64 {
        match self {
            Self::Disk => p[0] * p[0] + p[1] * p[1],
            Self::Sphere => p[2],
            Self::Cone(one_minus_cos) => height(p) / f64::from(one_minus_cos),
        }
    }

    /// The point at these bin coordinates.
    fn point(self, first: f64, turn: f64) -> Vec<f64> {
        let (sin, cos) = (TAU * turn).sin_cos();
        let (radius, z) = match self {
            Self::Disk => (first.sqrt(), None),
            Self::Sphere => (((1.0 - first) * (1.0 + first)).sqrt(), Some(first)),
            Self::Cone(one_minus_cos) => {
                let h = first * f64::from(one_minus_cos);
                ((h * (2.0 - h)).sqrt(), Some(1.0 - h))
            }
        };
        [radius * cos, radius * sin].into_iter().chain(z).collect()
    }

    /// Points all over the shape and around it, each standing for the area
    /// that is returned first. The grid has nothing to do with the sampler's
    /// coordinates.
    fn grid(self, side: usize) -> (f64, Vec<f64>) {
        let farthest = match self {
            Self::Disk => {
                let step = 2.5 / side as f64;
                let at = |i: usize| (i as f64 + 0.5) * step - 1.25;
                let points = (0..side * side).flat_map(|i| [at(i % side), at(i / side)]);
                return (step * step, points.collect());
            }
            Self::Sphere => 2.0,
            Self::Cone(one_minus_cos) => (1.5 * f64::from(one_minus_cos)).min(2.0),
        };
        let (area, points) = equal_area_grid(farthest, side);
        (area, points.flatten().collect())
    }
}

// ------------------------------------------------ samples against densities

const SAMPLES: usize = 1_000_000;

/// The chi-square p-value of a sampler against a density, or what is wrong
/// before any statistic. `slack`: how far from the unit sphere (outside of the
/// unit disk) a sample may be.
fn density_test(
    shape: Shape,
    sample: &dyn Fn(&[u32]) -> Vec<u32>,
    pdf: &dyn Fn(&[u32]) -> Vec<u32>,
    seed: u32,
    slack: f64,
) -> Result<f64, String> {
    let bins = shape.bins();
    let words = shape.words();
    let drawn = sample(&shape.arguments(random_pairs(SAMPLES, seed), 2));
    let mut observed = vec![0u64; bins.count()];
    for point in drawn.chunks_exact(words) {
        let p = components(point);
        let length = p.iter().map(|v| v * v).sum::<f64>().sqrt();
        let off = if shape == Shape::Disk {
            (length - 1.0).max(0.0)
        } else {
            (length - 1.0).abs()
        };
        // Written so that a NaN fails too.
        if off.is_nan() || off > slack {
            return Err(format!("{p:?} is {length} long"));
        }
        // A sample may round over the rim by what its density allows for.
        let bin = bins
            .index(shape.first(p), turn_of(p[0], p[1]), 1.0 / 524_288.0)
            .ok_or_else(|| format!("{p:?} lies outside of the shape"))?;
        observed[bin] += 1;
    }

    // The sampler's own density at its samples: zero only on the horizon,
    // which needs a component of u to be zero, one in 2^24.
    let at_samples = pdf(&shape.arguments(drawn, words));
    let impossible = at_samples.iter().filter(|&&w| float(w) <= 0.0).count();
    if impossible * 100_000 > SAMPLES {
        return Err(format!("{impossible} samples have density 0"));
    }

    // Expectations: the density's integral over each bin, by midpoints. An
    // even number of them along a row meets the horizon's step and kink,
    // which run through the middle row's middle, exactly.
    const SIDE: usize = 4;
    let mut owners = Vec::new();
    let mut points = Vec::new();
    for (bin, first, turn) in bins.midpoints(SIDE) {
        owners.push(bin);
        points.extend(f32_words(shape.point(first, turn)));
    }
    let densities = pdf(&shape.arguments(points, words));
    let each = SAMPLES as f64 * shape.bin_area() / (SIDE * SIDE) as f64;
    let mut expected = vec![0.0; bins.count()];
    for (&bin, &density) in owners.iter().zip(&densities) {
        expected[bin] += float(density) * each;
    }
    let test = chi_square(&observed, &expected, 5.0).map_err(|e| e.to_string())?;
    Ok(test.p_value)
}

/// How far from unit length a sample may be: the sample's contract in each
/// component, whose errors can all point the same way.
fn length_slack(twin: Twin, sample: &Kernel) -> f64 {
    3f64.sqrt() * twin.bound(sample) * 2.0 * EPS
}

fn samples_follow_the_density(twin: Twin) {
    let warps = warps();
    let significance = sidak(0.01, warps.len());
    for (seed, warp) in (1000..).zip(warps) {
        let (sample, pdf) = (kernel(warp.sample), kernel(warp.pdf));
        let slack = length_slack(twin, &sample);
        let p = density_test(
            warp.shape,
            &twin.prepare(&sample),
            &twin.prepare(&pdf),
            seed,
            slack,
        )
        .unwrap_or_else(|e| panic!("{} on {}: {e}", warp.name, twin.label()));
        println!("{} on {}: p = {p:.4}", warp.name, twin.label());
        assert!(
            p > significance,
            "{} on {}: the samples do not follow the density, p = {p:e} (< {significance:e})",
            warp.name,
            twin.label()
        );
    }
}

fn integral(shape: Shape, pdf: &dyn Fn(&[u32]) -> Vec<u32>) -> f64 {
    let (area, points) = shape.grid(1024);
    let densities = pdf(&shape.arguments(f32_words(points), shape.words()));
    densities.iter().map(|&w| float(w)).sum::<f64>() * area
}

fn densities_integrate_to_one(twin: Twin) {
    for warp in warps() {
        let pdf = kernel(warp.pdf);
        let found = integral(warp.shape, &twin.prepare(&pdf));
        println!("{} on {}: {found:.6}", warp.name, twin.label());
        assert!(
            (found - 1.0).abs() < 1e-3,
            "{} on {}: integrates to {found}",
            warp.name,
            twin.label()
        );
    }
}

// ---------------------------------------------------------------- inverses

/// How far `invert(sample(u))` may be from `u`, from the contracts of both.
///
/// Azimuth, all polar maps: the point is `r (cos, sin)`, both with one
/// relative error δ at most (sine and cosine are accurate relative to
/// themselves, then one product), and `r` cancels: the angle moves by at most
/// `|sin cos| · 2δ <= δ` rad, `δ/2π` turns, and `atan2_turn` adds its own.
///
/// Radius of the disk: `u.x = x² + y²` moves by `2 (|x| + |y|) e`, where `e`
/// is the sample's absolute error.
///
/// Concentric: the larger coordinate is `(1 + r)/2` and `r` moves by `√2 e`;
/// the smaller is `(1 + r φ 4/π)/2`, φ moves by `√2 e/r`, so that the square's
/// coordinate moves by `(√2 + √2·4/π) e/2 < 1.61 e`.
///
/// Height: `u.x` moves with `z`, by the given slope.
///
/// Cone: everything is relative, which is what a narrow light needs. With ρ
/// the rounding of one operation, `x(2 - x)` is within `1 + 2 + 1` ρ, its
/// root within 2 ρ and the root's own error, the components within another δ.
/// Inverted, `x² + y²` doubles that and adds 2 ρ, `1 + z` adds 3 ρ, and two
/// divisions follow. (Below the equator `1 - z` is within `5` ρ and better.)
struct InverseBound {
    kind: Inverse,
    sample: f64,
    invert: f64,
    turn: f64,
    cone: f64,
}

impl InverseBound {
    fn new(twin: Twin, warp: &Warp, sample: &Kernel, invert: &Kernel) -> Self {
        let sincos = kernel("math/trig::sincos_turn");
        let atan2 = kernel("math/trig::atan2_turn");
        // One ULP of a number is at most 2 EPS of it.
        let delta = 2.0 * twin.bound(&sincos) + twin.rounding();
        let radius = 2.0 * twin.rounding() + twin.square_root();
        let cone = 2.0 * (radius + delta)
            + 2.0 * twin.rounding()
            + 3.0 * twin.rounding()
            + 2.0 * twin.division();
        Self {
            kind: warp.inverse,
            sample: twin.bound(sample) * EPS,
            invert: twin.bound(invert) * EPS,
            turn: (delta / TAU + twin.bound(&atan2)) * EPS,
            cone: cone * EPS,
        }
    }

    fn at(&self, u: [f64; 2], p: [f64; 3]) -> [f64; 2] {
        // Second-order terms are below this.
        const REST: f64 = 1e-3 * EPS;
        let first = match self.kind {
            Inverse::Polar => 2.0 * (p[0].abs() + p[1].abs()) * self.sample + self.invert,
            Inverse::Concentric => {
                let both = 1.61 * self.sample + self.invert;
                return [both + REST, both + REST];
            }
            // At |z| = 1 an ULP is twice as large.
            Inverse::Height(slope) => {
                slope * self.sample * ulp(p[2].abs().max(0.5)) / EPS + self.invert
            }
            Inverse::Cone => self.cone * u[0],
        };
        [first + REST, self.turn + REST]
    }
}

/// Largest error of `invert(sample(u))` over its bound, for both components.
fn round_trip(
    warp: &Warp,
    sample: &dyn Fn(&[u32]) -> Vec<u32>,
    invert: &dyn Fn(&[u32]) -> Vec<u32>,
    bound: &InverseBound,
) -> Result<[f64; 2], String> {
    let edges = [
        0.0,
        5.960_464_5e-8,
        1.192_092_9e-7,
        0.125,
        0.249_999_99,
        0.25,
        0.499_999_97,
        0.5,
        0.500_000_06,
        0.75,
        0.999_999_9,
        0.999_999_94f32,
    ];
    let mut u = random_pairs(100_000, 2);
    for a in edges {
        for b in edges {
            u.extend([a.to_bits(), b.to_bits()]);
        }
    }
    let points = sample(&warp.shape.arguments(u.iter().copied(), 2));
    let back = invert(
        &warp
            .shape
            .arguments(points.iter().copied(), warp.shape.words()),
    );
    let mut worst = [0.0f64; 2];
    for ((u, p), v) in u
        .chunks_exact(2)
        .zip(points.chunks_exact(warp.shape.words()))
        .zip(back.chunks_exact(2))
    {
        let u = [float(u[0]), float(u[1])];
        let v = [float(v[0]), float(v[1])];
        let p = components(p);
        if !v.iter().all(|v| (0.0..1.0).contains(v)) {
            return Err(format!("{u:?} comes back as {v:?}, outside of [0, 1)"));
        }
        let limit = bound.at(u, p);
        let concentric = matches!(warp.inverse, Inverse::Concentric);
        let mut off = [(u[0] - v[0]).abs(), (u[1] - v[1]).abs()];
        if !concentric {
            // The seam between 1 and 0 is no distance, and the axis has no
            // azimuth but a documented one, 0.
            off[1] = if p[0] == 0.0 && p[1] == 0.0 {
                v[1]
            } else {
                turn_distance(u[1], v[1])
            };
        }
        for i in 0..2 {
            if off[i].is_nan() || off[i] > limit[i] {
                return Err(format!(
                    "{u:?} -> {p:?} -> {v:?}: component {i} is off by {:.2}·2^-24, bound {:.2}",
                    off[i] / EPS,
                    limit[i] / EPS
                ));
            }
            worst[i] = worst[i].max(off[i] / limit[i]);
        }
    }
    Ok(worst)
}

fn inverses_return_the_random_numbers(twin: Twin) {
    for warp in warps() {
        let (sample, invert) = (kernel(warp.sample), kernel(warp.invert));
        let bound = InverseBound::new(twin, &warp, &sample, &invert);
        let worst = round_trip(
            &warp,
            &twin.prepare(&sample),
            &twin.prepare(&invert),
            &bound,
        )
        .unwrap_or_else(|e| panic!("{} on {}: {e}", warp.name, twin.label()));
        println!(
            "{} on {}: largest error {:.2}, {:.2} of the bound",
            warp.name,
            twin.label(),
            worst[0],
            worst[1]
        );
    }
}

// ---------------------------------------------------------------- the basis

const NORMALS: usize = 4_000_000;

/// Unit normals as words: half over the sphere, half within 0.06 rad of -z,
/// down to the last bit of z; then the printed hard ones.
fn normals() -> Vec<u32> {
    let u = random_pairs(NORMALS, 3);
    let mut words = Vec::with_capacity(3 * NORMALS + 32);
    for (i, u) in u.chunks_exact(2).enumerate() {
        let (a, b) = (float(u[0]), float(u[1]));
        let z = if i % 2 == 0 {
            1.0 - 2.0 * a
        } else {
            // Log-uniform distance from the pole.
            -1.0 + 2e-3 * (-16.0 * a).exp()
        };
        let r = ((1.0 - z) * (1.0 + z)).sqrt();
        let (sin, cos) = (TAU * b).sin_cos();
        words.extend(f32_words([r * cos, r * sin, z]));
    }
    for n in [
        // The two that Duff et al. print, and Frisvad's worst.
        Vec3::new(-0.000_198_135_81, -0.000_089_468_39, -0.999_999_94),
        Vec3::new(0.000_385_273_16, 0.000_384_600_16, -0.999_999_88),
        Vec3::Z,
        -Vec3::Z,
        Vec3::X,
        -Vec3::X,
        Vec3::Y,
        -Vec3::Y,
        Vec3::new(0.6, 0.8, -0.0),
        Vec3::new(-0.0, -0.0, -1.0),
    ] {
        words.extend(n.to_array().map(f32::to_bits));
    }
    words
}

/// The largest deviations of a basis and what they may be, in units of EPS.
///
/// Each component is within `B` ULP of the basis of the given `n`, so each
/// vector within `e = √3 B` EPS. A rounded `n` has squared length `1 + η`, and
/// Duff's formula then gives a tangent of squared length `1 + x² η a²`, with
/// `t·n = -x η/(1 + |z|)` and `t·b = x y η a²`, each at most |η|.
fn basis_deviation(normals: &[u32], frames: &[u32], bound: f64) -> Result<[f64; 3], String> {
    let e = 3f64.sqrt() * bound * EPS;
    let mut worst = [0.0f64; 3];
    for (n, frame) in normals.chunks_exact(3).zip(frames.chunks_exact(6)) {
        let vector = |w: &[u32]| glam::DVec3::new(float(w[0]), float(w[1]), float(w[2]));
        let (n, t, b) = (vector(n), vector(&frame[..3]), vector(&frame[3..]));
        let eta = (n.length_squared() - 1.0).abs();
        let lengths = (t.length() - 1.0).abs().max((b.length() - 1.0).abs());
        let found = [lengths, t.dot(b).abs(), t.dot(n).abs().max(b.dot(n).abs())];
        let allowed = [e + 0.5 * eta, 2.0 * e + eta, e + eta];
        for i in 0..3 {
            // Second-order terms are below the last one.
            if found[i].is_nan() || found[i] > allowed[i] + 1e-12 {
                return Err(format!(
                    "{n:?} gives {t:?}, {b:?}: {} is off by {:.2}·2^-24, bound {:.2}",
                    ["a length", "t·b", "t·n or b·n"][i],
                    found[i] / EPS,
                    allowed[i] / EPS
                ));
            }
            worst[i] = worst[i].max(found[i] / EPS);
        }
        if (t.cross(b).dot(n) - 1.0).abs() > 1e-5 {
            return Err(format!("{n:?} gives a left-handed basis {t:?}, {b:?}"));
        }
    }
    Ok(worst)
}

fn bases_are_orthonormal_and_right_handed(twin: Twin) {
    let basis = kernel("sample/basis::basis_from_normal");
    let normals = normals();
    let frames = twin.prepare(&basis)(&normals);
    let worst = basis_deviation(&normals, &frames, twin.bound(&basis))
        .unwrap_or_else(|e| panic!("{}: {e}", twin.label()));
    println!(
        "{}: lengths {:.2}, t·b {:.2}, t·n {:.2}, in 2^-24",
        twin.label(),
        worst[0],
        worst[1],
        worst[2]
    );
}

// ---------------------------------------------------------------- Halton

/// The exact radical inverse: numerator and denominator.
fn exact_radical_inverse(base: u32, mut index: u32) -> (u128, u128) {
    let base_wide = u128::from(base);
    let (mut top, mut bottom) = (0, 1);
    while index != 0 {
        top = top * base_wide + u128::from(index % base);
        bottom *= base_wide;
        index /= base;
    }
    (top, bottom)
}

/// The `f32` nearest to a ratio in `[0, 1)`, ties to even.
fn nearest(top: u128, bottom: u128) -> f32 {
    if top == 0 {
        return 0.0;
    }
    // So many places that the quotient has 24 bits.
    let mut shift = 24 + top.leading_zeros() - bottom.leading_zeros();
    if (top << shift) / bottom >= 1 << 24 {
        shift -= 1;
    }
    let (quotient, rest) = ((top << shift) / bottom, (top << shift) % bottom);
    let up = 2 * rest > bottom || (2 * rest == bottom && quotient % 2 == 1);
    ((quotient + u128::from(up)) as f64 / 2f64.powi(shift as i32)) as f32
}

/// Distance of a float from a ratio in units of EPS, exactly up to the last
/// division.
fn distance_from(value: f32, top: u128, bottom: u128) -> f64 {
    // value = mantissa · 2^-60, since no value below 2^-36 occurs but 0.
    let mantissa = (f64::from(value) * 2f64.powi(60)) as u128;
    let difference = (mantissa * bottom).abs_diff(top << 60);
    difference as f64 / bottom as f64 / 2f64.powi(36)
}

fn dimension_and_index(points: impl IntoIterator<Item = (u32, u32)>) -> Vec<u32> {
    points.into_iter().flat_map(|(d, i)| [d, i]).collect()
}

/// Compares `(dimension, index)` words with exact ratios: how many values are
/// not the nearest float, and the largest distance in 2^-24.
fn radical_inverse_errors(input: &[u32], values: &[u32]) -> Result<(usize, f64), String> {
    let (mut not_nearest, mut largest) = (0, 0.0f64);
    for (point, &word) in input.chunks_exact(2).zip(values) {
        let value = f32::from_bits(word);
        let base = HALTON_PRIMES[point[0] as usize];
        if !(0.0..1.0).contains(&value) {
            return Err(format!("base {base}, index {}: {value:?}", point[1]));
        }
        let (top, bottom) = exact_radical_inverse(base, point[1]);
        not_nearest += usize::from(value != nearest(top, bottom));
        largest = largest.max(distance_from(value, top, bottom));
    }
    Ok((not_nearest, largest))
}

fn radical_inverses_match_exact_ratios(twin: Twin) {
    let sample = kernel("random/halton::halton_sample");
    let run = twin.prepare(&sample);
    let check = |what: &str, input: &[u32]| {
        let (not_nearest, largest) = radical_inverse_errors(input, &run(input))
            .unwrap_or_else(|e| panic!("{what} on {}: {e}", twin.label()));
        println!(
            "{what} on {}: {not_nearest} of {} not the nearest float, largest error {largest:.3}·2^-24",
            twin.label(),
            input.len() / 2
        );
        // The contract's scale is 1/2, whose ULP is 2^-24.
        assert!(
            largest <= twin.bound(&sample),
            "{what} on {}: {largest:.3}·2^-24, bound {}",
            twin.label(),
            twin.bound(&sample)
        );
        not_nearest
    };
    let small = dimension_and_index((0..32).flat_map(|d| (0..1 << 16).map(move |i| (d, i))));
    let wrong = check("the first 65536 indices", &small);
    // base^k <= 2^24 there: one division of exact integers, rounded once.
    if matches!(twin, Twin::Cpu) {
        assert_eq!(wrong, 0, "a single division must round to nearest");
    }
    let any = (0..1u32 << 20).map(|i| (i % 32, pcg_hash(i)));
    check("random 32-bit indices", &dimension_and_index(any));
    // All digits at their highest: what rounds to one in naive code; and where
    // reversed digits overflow 32 bits.
    let mut hard = Vec::new();
    for d in 0..32 {
        let base = u64::from(HALTON_PRIMES[d as usize]);
        let mut power = base;
        while power <= 1 << 32 {
            hard.extend([power - 1, power - 2].map(|i| (d, i as u32)));
            power *= base;
        }
        hard.extend([u32::MAX, u32::MAX - 1, 294_500_312, 1 << 24, (1 << 24) - 1].map(|i| (d, i)));
    }
    check("hard indices", &dimension_and_index(hard));
}

/// Whether `b^k` successive values, the `block`-th such run of the sequence,
/// meet each interval `[j/b^k, (j+1)/b^k)` exactly once.
///
/// The interval is an integer and not the floor of a float: the values of a
/// run are `(j + φ)/b^k` with one φ, the radical inverse of the block's
/// number. So `value·b^k - φ` is `j` but for the value's own error times
/// `b^k`, at most 2^16 · 4.5 · 2^-24 < 0.02: rounding it gives `j` for certain.
fn stratified(base: u32, power: u32, block: u32, values: &[u32], bound: f64) -> Result<(), String> {
    let (top, bottom) = exact_radical_inverse(base, block);
    let offset = top as f64 / bottom as f64;
    let mut hit = vec![false; power as usize];
    for (i, &word) in values.iter().enumerate() {
        let place = float(word) * f64::from(power) - offset;
        let interval = place.round();
        let tolerance = f64::from(power) * bound * EPS + 1e-9;
        if (place - interval).abs() > tolerance || !(0.0..f64::from(power)).contains(&interval) {
            return Err(format!(
                "base {base}, block {block}: value {i} lies at {place} intervals"
            ));
        }
        if std::mem::replace(&mut hit[interval as usize], true) {
            return Err(format!(
                "base {base}, block {block}: interval {interval} is hit twice"
            ));
        }
    }
    Ok(())
}

fn every_elementary_interval_gets_one_point(twin: Twin) {
    let sample = kernel("random/halton::halton_sample");
    let run = twin.prepare(&sample);
    for (d, base) in HALTON_PRIMES.into_iter().enumerate() {
        let mut power = base;
        while power * base <= 1 << 16 {
            power *= base;
        }
        for block in [0, 1, 12_345] {
            let indices = (0..power).map(|i| (d as u32, block * power + i));
            let values = run(&dimension_and_index(indices));
            stratified(base, power, block, &values, twin.bound(&sample))
                .unwrap_or_else(|e| panic!("{}: {e}", twin.label()));
        }
    }
}

fn halton_indices_permute_the_tile(twin: Twin) {
    let index = kernel("random/halton::halton_index");
    let sample = kernel("random/halton::halton_sample");
    let (to_index, to_sample) = (twin.prepare(&index), twin.prepare(&sample));
    // A rounded coordinate may sit on a pixel's upper edge.
    let tolerance = 729.0 * twin.bound(&sample) * EPS;
    for i in [0, 1, HALTON_PERIOD - 1, HALTON_PERIOD, u32::MAX] {
        let pixels = || (0..HALTON_STRIDE).map(|p| (p % 256, p / 256));
        let input: Vec<u32> = pixels().flat_map(|(x, y)| [x, y, i]).collect();
        let indices = to_index(&input);
        let mut seen = vec![false; HALTON_STRIDE as usize];
        for ((x, y), &n) in pixels().zip(&indices) {
            assert_eq!(n / HALTON_STRIDE, i % HALTON_PERIOD, "pixel ({x}, {y})");
            let place = (n % HALTON_STRIDE) as usize;
            assert!(
                !std::mem::replace(&mut seen[place], true),
                "{}: sample {i}: two pixels share index {n}",
                twin.label()
            );
        }
        // So many distinct places below the stride fill it: a permutation.
        for (dimension, size) in [(0, 256.0), (1, 729.0)] {
            let input = indices.iter().map(|&n| (dimension, n));
            let values = to_sample(&dimension_and_index(input));
            for (((x, y), &n), &word) in pixels().zip(&indices).zip(&values) {
                let inside = float(word) * size - f64::from(if dimension == 0 { x } else { y });
                assert!(
                    (-tolerance..1.0 + tolerance).contains(&inside),
                    "{}: index {n}, coordinate {dimension}, lies {inside} into pixel ({x}, {y})",
                    twin.label()
                );
            }
        }
    }
}

/// Whether each multiple of 2^-24 occurs once.
fn permutes_the_lattice(values: impl Iterator<Item = f32>) -> Result<(), String> {
    let mut seen = vec![0u64; 1 << 18];
    for value in values {
        let steps = value * 16_777_216.0;
        let k = steps as u32;
        if k >= 1 << 24 || k as f32 != steps {
            return Err(format!("{value:?} is no multiple of 2^-24 in [0, 1)"));
        }
        let (word, bit) = (k as usize / 64, 1 << (k % 64));
        if seen[word] & bit != 0 {
            return Err(format!("{value:?} occurs twice"));
        }
        seen[word] |= bit;
    }
    if seen.iter().all(|&word| word == u64::MAX) {
        Ok(())
    } else {
        Err("a multiple of 2^-24 is missing".into())
    }
}

fn rotation_permutes_the_unit_interval(twin: Twin) {
    let rotate = kernel("random/halton::halton_rotate");
    let run = twin.prepare(&rotate);
    let edges = [
        0.0,
        1e-30,
        2.980_232_2e-8,
        5.960_464_5e-8,
        1.192_092_9e-7,
        0.1,
        0.25,
        0.333_333_34,
        0.5,
        0.75,
        0.999_999_9,
        0.999_999_94f32,
    ];
    let pairs: Vec<u32> = edges
        .iter()
        .flat_map(|a| edges.iter().flat_map(|b| [a.to_bits(), b.to_bits()]))
        .collect();
    let rotated = run(&pairs);
    for (pair, &word) in pairs.chunks_exact(2).zip(&rotated) {
        let steps = |w: u32| (float(w) / EPS).floor();
        let truth = (steps(pair[0]) + steps(pair[1])) % 16_777_216.0 * EPS;
        assert_eq!(
            float(word),
            truth,
            "{}: {} rotated by {}",
            twin.label(),
            float(pair[0]),
            float(pair[1])
        );
    }
    // A rotation must keep a uniform u uniform: it permutes the multiples of
    // 2^-24 (which is every u that pcg_unit gives), all of them tried.
    for shift in [0.123_456_79f32, 0.999_999_94] {
        let chunk = 1u32 << 22;
        let mut values = Vec::with_capacity(1 << 24);
        for start in (0..1 << 24).step_by(chunk as usize) {
            let mut input = Vec::with_capacity(2 * chunk as usize);
            for k in start..start + chunk {
                input.push((k as f32 * EPS as f32).to_bits());
                input.push(shift.to_bits());
            }
            values.extend(run(&input));
        }
        permutes_the_lattice(values.into_iter().map(f32::from_bits))
            .unwrap_or_else(|e| panic!("{}, shift {shift}: {e}", twin.label()));
    }
}

// ---------------------------------------------------------------- the cone

/// The contract of `cone_sample` is absolute, so that it holds for wide cones;
/// next to the axis what counts is the radius relative to itself.
fn narrow_cones_keep_every_radius(twin: Twin) {
    let sample = kernel("sample/cone::cone_sample");
    let run = twin.prepare(&sample);
    // √(x (2 - x)) with x = u · omc, times a cosine that is 1 exactly: the
    // root halves the errors of three operations, then comes its own and the
    // product's.
    let bound = (2.5 * twin.rounding() + twin.square_root()) * EPS;
    for one_minus_cos in [SUN, 1e-3, 1e-8, 1e-12] {
        let u: Vec<f32> = (0..4096u16).map(|i| f32::from(i) / 4096.0).collect();
        let input: Vec<u32> = u
            .iter()
            .flat_map(|u| [u.to_bits(), 0, one_minus_cos.to_bits()])
            .collect();
        let radii: Vec<f32> = run(&input)
            .chunks_exact(3)
            .map(|d| f32::from_bits(d[0]))
            .collect();
        let mut worst = 0f64;
        for (u, r) in u.iter().zip(&radii).skip(1) {
            let x = f64::from(*u) * f64::from(one_minus_cos);
            let truth = (x * (2.0 - x)).sqrt();
            worst = worst.max((f64::from(*r) / truth - 1.0).abs());
        }
        let mut distinct = radii;
        distinct.sort_by(f32::total_cmp);
        distinct.dedup();
        println!(
            "{}: 1 - cos = {one_minus_cos:e}: {} of 4096 radii, relative error {worst:.2e} of {bound:.2e}",
            twin.label(),
            distinct.len()
        );
        assert_eq!(distinct.len(), 4096, "{}", twin.label());
        assert!(worst <= bound, "{}: {worst:e} > {bound:e}", twin.label());
    }
}

// ---------------------------------------------------------------- PCG

fn units_stay_below_one(twin: Twin) {
    let unit = kernel("random/pcg::pcg_unit");
    let run = twin.prepare(&unit);
    // All 2^24 patterns of the bits that count, with the rest clear and set.
    for low in [0, 0xff] {
        for start in (0..1u32 << 24).step_by(1 << 22) {
            let input: Vec<u32> = (start..start + (1 << 22)).map(|k| k << 8 | low).collect();
            for (k, word) in (start..).zip(run(&input)) {
                // Equal to k·2^-24, so below one, and distinct for distinct k.
                assert_eq!(float(word), f64::from(k) * EPS, "{}", twin.label());
            }
        }
    }
}

const DRAWS: usize = 1 << 22;

/// Mean and variance within five standard deviations of those of a uniform
/// variable.
fn is_uniform(values: &[f32]) -> Result<(), String> {
    let n = values.len() as f64;
    let (mean, variance) = mean_variance(values);
    let deviation = [
        (mean - 0.5) / (1.0 / 12.0 / n).sqrt(),
        (variance - 1.0 / 12.0) / (1.0 / 180.0 / n).sqrt(),
    ];
    if deviation.iter().all(|d| d.abs() < 5.0) {
        return Ok(());
    }
    Err(format!(
        "mean {mean} and variance {variance} are {deviation:.1?} standard deviations off"
    ))
}

/// Five standard deviations of the correlation of [`DRAWS`] independent pairs.
const CORRELATION: f64 = 0.0025;

fn uncorrelated_lags(values: &[f32]) -> Result<(), String> {
    for lag in 1..=8 {
        let r = pearson([(values, &values[lag..])].into_iter());
        if r.abs() >= CORRELATION {
            return Err(format!("correlation {r:.5} at lag {lag}"));
        }
    }
    Ok(())
}

fn draws_are_uniform_and_uncorrelated(twin: Twin) {
    let next = kernel("random/pcg::pcg_next");
    let first = pcg_seed(UVec2::new(17, 4), 99);
    // The twin's own states, checked to be a chain.
    let mut state = first;
    let states: Vec<u32> = (0..DRAWS)
        .map(|_| {
            let next = pcg_next(state).state;
            std::mem::replace(&mut state, next)
        })
        .collect();
    let draws = twin.prepare(&next)(&states);
    for (draw, &state) in draws.chunks_exact(2).zip(&states[1..]) {
        assert_eq!(draw[0], state, "{}: the states differ", twin.label());
    }
    let values: Vec<f32> = draws.chunks_exact(2).map(|d| pcg_unit(d[1])).collect();
    is_uniform(&values)
        .and_then(|()| uncorrelated_lags(&values))
        .unwrap_or_else(|e| panic!("{}: {e}", twin.label()));
}

/// First draws of an image of 2048 × 2048 pixels in one frame.
fn first_draws(seed: &Run, draw: &Run, frame: u32) -> Vec<f32> {
    let mut pixels = Vec::with_capacity(3 * DRAWS);
    for p in 0..DRAWS as u32 {
        pixels.extend_from_slice(&[p % 2048, p / 2048, frame]);
    }
    let draws = draw(&seed(&pixels));
    draws.chunks_exact(2).map(|d| pcg_unit(d[1])).collect()
}

fn uncorrelated_neighbours(image: &[f32], successor: &[f32]) -> Result<(), String> {
    for (dx, dy) in (0..16).map(|i| (i % 4, i / 4)) {
        for (what, other) in [("pixels", image), ("frames", successor)] {
            if (dx, dy) == (0, 0) && what == "pixels" {
                continue;
            }
            let rows = (0..2048 - dy).map(|y| {
                let (a, b) = (&image[y * 2048..], &other[(y + dy) * 2048..]);
                (&a[..2048 - dx], &b[dx..2048])
            });
            let r = pearson(rows);
            if r.abs() >= CORRELATION {
                return Err(format!("correlation {r:.5} of {what} at ({dx}, {dy})"));
            }
        }
    }
    Ok(())
}

fn seeds_of_neighbours_are_uncorrelated(twin: Twin) {
    let (seed, draw) = (
        kernel("random/pcg::pcg_seed"),
        kernel("random/pcg::pcg_next"),
    );
    let (seed, draw) = (twin.prepare(&seed), twin.prepare(&draw));
    let image = first_draws(&seed, &draw, 0);
    let successor = first_draws(&seed, &draw, 1);
    is_uniform(&image)
        .and_then(|()| uncorrelated_neighbours(&image, &successor))
        .unwrap_or_else(|e| panic!("{}: {e}", twin.label()));
}

/// Whether all words are distinct.
fn distinct(words: &[u32]) -> Result<(), String> {
    // By their top byte first, so that a set of the rest stays in the cache.
    let mut buckets = vec![Vec::new(); 256];
    for &word in words {
        buckets[word as usize >> 24].push(word);
    }
    for bucket in buckets {
        let mut seen = vec![0u64; 1 << 18];
        for word in bucket {
            let place = word as usize & 0x00ff_ffff;
            let bit = 1 << (place % 64);
            if seen[place / 64] & bit != 0 {
                return Err(format!("{word:#010x} occurs twice"));
            }
            seen[place / 64] |= bit;
        }
    }
    Ok(())
}

/// On 2^24 of the 2^32 inputs, spread over all of them. All of them would
/// take minutes; that the hash is a bijection follows from its steps, an odd
/// multiplier, a sum, and two xors of a word with its own higher bits.
fn hashes_do_not_collide(twin: Twin) {
    let hash = kernel("random/pcg::pcg_hash");
    let run = twin.prepare(&hash);
    let mut words = Vec::with_capacity(1 << 24);
    for start in (0..1u32 << 24).step_by(1 << 22) {
        let input: Vec<u32> = (start..start + (1 << 22))
            .map(|k| k.wrapping_mul(0x9e37_79b1))
            .collect();
        words.extend(run(&input));
    }
    distinct(&words).unwrap_or_else(|e| panic!("{}: {e}", twin.label()));
}

// ---------------------------------------------------------------- determinism

#[test]
fn two_dispatches_give_the_same_bits() {
    for gpu in gpu::adapters().unwrap_or_else(|e| panic!("{e}")) {
        for kernel in all_kernels() {
            let input = kernel.draw_many(1 << 14, 0xd15);
            let program = Program::new(gpu, &kernel, Build::Plain)
                .unwrap_or_else(|e| panic!("{}: {e}", gpu.label()));
            let first = program.run(&input);
            assert!(
                first == program.run(&input),
                "{kernel:?} on {}: two dispatches differ",
                gpu.label()
            );
        }
    }
}

// ------------------------------------------------------- what must be caught

fn cpu(path: &str) -> impl Fn(&[u32]) -> Vec<u32> {
    let kernel = kernel(path);
    move |input| run_cpu(&kernel, input)
}

/// A function of `words_in` floats with `words_out` results over arrays.
fn over_arrays(words_in: usize, f: impl Fn(&[f32]) -> Vec<f32>) -> impl Fn(&[u32]) -> Vec<u32> {
    move |input| {
        input
            .chunks_exact(words_in)
            .flat_map(|words| {
                let floats: Vec<f32> = words.iter().map(|&w| f32::from_bits(w)).collect();
                f(&floats)
            })
            .map(f32::to_bits)
            .collect()
    }
}

/// The kernel's baseline on the CPU: the usual form that it replaces.
fn baseline(path: &str) -> impl Fn(&[u32]) -> Vec<u32> {
    let kernel = kernel(path);
    move |input| {
        let mut output = vec![0; input.len() / kernel.words_in() * kernel.words_out()];
        (kernel.baselines[0].cpu)(input, &mut output);
        output
    }
}

fn rejected(shape: Shape, sample: &dyn Fn(&[u32]) -> Vec<u32>, pdf: &dyn Fn(&[u32]) -> Vec<u32>) {
    match density_test(shape, sample, pdf, 1, 1e-6) {
        Ok(p) => assert!(p < 1e-6, "not caught: p = {p}"),
        Err(why) => println!("{why}"),
    }
}

#[test]
fn rejects_a_density_six_percent_off() {
    let tilted = over_arrays(3, |d| vec![0.079_577_47 * (1.0 + 0.06 * d[2])]);
    rejected(Shape::Sphere, &cpu("sample/sphere::sphere_sample"), &tilted);
}

#[test]
fn rejects_a_missing_root_and_a_wrong_density() {
    let no_root = over_arrays(2, |u| {
        let (sin, cos) = (6.283_185_5 * u[1]).sin_cos();
        vec![u[0] * cos, u[0] * sin]
    });
    rejected(Shape::Disk, &no_root, &cpu("sample/disk::disk_pdf"));
    let cosine = "sample/hemisphere::hemisphere_cosine_sample";
    let uniform = "sample/hemisphere::hemisphere_uniform_pdf";
    rejected(Shape::Sphere, &cpu(cosine), &cpu(uniform));
}

#[test]
fn rejects_samples_outside_of_the_density() {
    let (sphere, hemisphere) = (
        cpu("sample/sphere::sphere_sample"),
        cpu("sample/hemisphere::hemisphere_uniform_pdf"),
    );
    let why = density_test(Shape::Sphere, &sphere, &hemisphere, 1, 1e-6)
        .expect_err("half of the samples lie below the horizon");
    assert!(why.contains("density 0"), "{why}");
    let wide = over_arrays(3, |u| {
        let h = 1.01 * u[2] * u[0];
        let (sin, cos) = (6.283_185_5 * u[1]).sin_cos();
        let r = (h * (2.0 - h)).sqrt();
        vec![r * cos, r * sin, 1.0 - h]
    });
    let why = density_test(
        Shape::Cone(0.1),
        &wide,
        &cpu("sample/cone::cone_pdf"),
        1,
        1e-6,
    )
    .expect_err("a hundredth of the samples lie outside of the cone");
    assert!(why.contains("outside"), "{why}");
}

#[test]
fn rejects_the_sun_from_a_stored_cosine() {
    // 182 distinct radii of 4096 cannot fill 101 rows evenly.
    let usual = baseline("sample/cone::cone_sample");
    rejected(Shape::Cone(SUN), &usual, &cpu("sample/cone::cone_pdf"));
}

#[test]
fn rejects_a_density_that_does_not_integrate_to_one() {
    // The floor of 1e-6 that some libraries put under a density, scaled up to
    // what the test must see, and the hemisphere's density on the whole sphere.
    for (constant, floor) in [(0.318_309_87f32, 2e-4f32), (0.159_154_94, 0.159_154_94)] {
        let pdf = over_arrays(3, |d| vec![(d[2] * constant).max(floor)]);
        let found = integral(Shape::Sphere, &pdf);
        assert!((found - 1.0).abs() > 1e-3, "not caught: {found}");
    }
}

#[test]
fn rejects_inverses_that_lose_digits() {
    for warp in warps() {
        let (sample, invert) = (kernel(warp.sample), kernel(warp.invert));
        let bound = InverseBound::new(Twin::Cpu, &warp, &sample, &invert);
        // The sample moved by 2^-19 of itself along x.
        let moved = |input: &[u32]| {
            let mut points = run_cpu(&sample, input);
            for point in points.chunks_exact_mut(warp.shape.words()) {
                point[0] = (f32::from_bits(point[0]) * 1.000_001_9).to_bits();
            }
            points
        };
        let back = |input: &[u32]| run_cpu(&invert, input);
        let result = round_trip(&warp, &moved, &back, &bound);
        assert!(result.is_err(), "{}: not caught", warp.name);
    }
    // The usual cone at the Sun.
    let sun = warps().remove(5);
    let (sample, invert) = (kernel(sun.sample), kernel(sun.invert));
    let bound = InverseBound::new(Twin::Cpu, &sun, &sample, &invert);
    let usual = baseline(sun.sample);
    assert!(round_trip(&sun, &usual, &cpu(sun.invert), &bound).is_err());
}

#[test]
fn rejects_the_basis_of_frisvad() {
    let normals = normals();
    let frames = baseline("sample/basis::basis_from_normal")(&normals);
    let bound = kernel("sample/basis::basis_from_normal").bounds.gpu;
    let why = basis_deviation(&normals, &frames, bound).expect_err("Frisvad loses digits at -z");
    println!("{why}");
}

#[test]
fn rejects_radical_inverses_in_floats() {
    // The chapter's loop: a running float weight.
    let accumulate = |base: u32, mut n: u32| {
        let inverse = 1.0 / base as f32;
        let (mut weight, mut sum) = (inverse, 0.0f32);
        while n != 0 {
            sum += (n % base) as f32 * weight;
            n /= base;
            weight *= inverse;
        }
        sum.to_bits()
    };
    let input = dimension_and_index((0..1 << 16).map(|i| (1, i)));
    let values: Vec<u32> = input.chunks_exact(2).map(|p| accumulate(3, p[1])).collect();
    let (not_nearest, largest) = radical_inverse_errors(&input, &values).expect("in range");
    println!("{not_nearest} of 65536 not nearest, largest {largest:.2}·2^-24");
    assert!(not_nearest > 1000 && largest > 1.5);
    // All ternary digits at their highest: the sum rounds to one.
    let input = dimension_and_index((1..=20).map(|k| (1, (3u64.pow(k) - 1) as u32)));
    let values: Vec<u32> = input.chunks_exact(2).map(|p| accumulate(3, p[1])).collect();
    let why = radical_inverse_errors(&input, &values).expect_err("a value of 1");
    println!("{why}");
    // One value off by one interval.
    let mut values: Vec<u32> = (0..243)
        .map(|i| {
            let (top, bottom) = exact_radical_inverse(3, i);
            nearest(top, bottom).to_bits()
        })
        .collect();
    stratified(3, 243, 0, &values, 1.5).expect("stratified");
    values[100] = values[101];
    stratified(3, 243, 0, &values, 1.5).expect_err("an interval is hit twice");
}

#[test]
fn rejects_a_rotation_in_floats() {
    // 3·2^-24: the sum's last bit is lost from one on.
    let shift = 1.788_139_3e-7f32;
    let values = (0..1u32 << 24).map(|k| (k as f32 * EPS as f32 + shift).fract());
    let why = permutes_the_lattice(values).expect_err("the sum rounds above one");
    println!("{why}");
}

#[test]
fn rejects_bad_generators() {
    // A Weyl sequence is uniform and far from independent.
    let weyl: Vec<f32> = (0..DRAWS as u32)
        .map(|i| pcg_unit(i.wrapping_mul(0x9e37_79b9)))
        .collect();
    uncorrelated_lags(&weyl).expect_err("a regular sequence");
    // Pixel and frame added before hashing: frame 1 is frame 0 moved by one.
    let image = |frame: u32| -> Vec<f32> {
        (0..DRAWS as u32)
            .map(|p| pcg_unit(pcg_hash(p % 2048 + p / 2048 + frame)))
            .collect()
    };
    uncorrelated_neighbours(&image(0), &image(1)).expect_err("a diagonal repeats");
    let narrow: Vec<f32> = (0..DRAWS as u32)
        .map(|i| 0.999 * pcg_unit(pcg_hash(i)))
        .collect();
    is_uniform(&narrow).expect_err("a mean of 0.4995");
    // All 32 bits over 2^32: 1.0 for the last 128 inputs, and equal neighbours.
    assert_eq!(u32::MAX as f32 / 4_294_967_296.0, 1.0);
    distinct(&[3, 1, 2, 1]).expect_err("1 occurs twice");
    let mut counts = HashMap::new();
    for bits in 0xffff_ff00..=u32::MAX {
        *counts.entry((bits as f32).to_bits()).or_insert(0) += 1;
    }
    assert_eq!(counts[&4_294_967_296f32.to_bits()], 128);
}
