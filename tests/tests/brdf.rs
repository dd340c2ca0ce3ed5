//! What samplers, densities and values of materials must be to each other.
//!
//! Chi-square of every GGX sampler and of the layered stacks against their
//! densities (1,000,000 samples, 101 × 202 bins), mass of densities and of
//! dropped samples, weights, reciprocity, energy, and the published variance of
//! the three GGX samplers. Each on the CPU twin and, as shipped, on every
//! adapter; seeds are fixed. Tests whose names begin with `rejects_` feed a
//! check something wrong that renderers ship, and expect it to be caught.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, PoisonError};

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use raytwin::brdf::cook_torrance::cook_torrance_eval;
use raytwin::brdf::fresnel::fresnel_f0;
use raytwin::brdf::ggx::{ggx_d, ggx_d_between, ggx_half, ggx_projected_area, ggx_visibility};
use raytwin::brdf::ggx_bounded::ggx_bounded_direction_pdf;
use raytwin::brdf::ggx_ndf::ggx_ndf_direction_pdf;
use raytwin::brdf::ggx_visible::{ggx_visible_direction_pdf, ggx_visible_pdf};
use raytwin::brdf::lambert::lambert_pdf;
use raytwin::brdf::layered::{
    self, LayeredLayer, LayeredStack, layered_diffuse, layered_pdf, layered_pmf, layered_refract,
};
use raytwin::brdf::reflection::{reflection_pdf, reflection_trimmed_sample};
use raytwin::contract::{Kernel, Value};
use raytwin::math::vector::vec3_dot;
use raytwin::sample::hemisphere::hemisphere_cosine_pdf;
use raytwin_tests::on_both_twins;
use raytwin_tests::statistics::{Bins, chi_square, sidak, turn_of};
use raytwin_tests::twin::{EPS, Run, Twin, components, float, gpu_twins, kernel, random_pairs};

const SAMPLES: usize = 1_000_000;
const ALPHAS: [f32; 6] = [0.02, 0.05, 0.125, 0.25, 0.5, 1.0];
const ANGLES: [f64; 8] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0, 89.0];

/// Odd on purpose: the horizon runs through the middle of a row.
const BINS: Bins = Bins {
    rows: 101,
    columns: 202,
    range: (-1.0, 1.0),
};

/// Roughness and view angles. All of them on the CPU twin and on the first
/// adapter; a second driver runs the same shader text, and three by three of
/// them unless `RAYTWIN_FULL` is set.
fn grid(twin: Twin) -> (Vec<f32>, Vec<f64>) {
    let first = match twin {
        Twin::Cpu => true,
        Twin::Gpu(gpu) => gpu_twins()
            .first()
            .is_some_and(|t| t.label() == gpu.label()),
    };
    if first || std::env::var_os("RAYTWIN_FULL").is_some() {
        (ALPHAS.to_vec(), ANGLES.to_vec())
    } else {
        (vec![0.05, 0.25, 1.0], vec![0.0, 60.0, 85.0])
    }
}

/// A view direction this many degrees from the normal, off the axes.
fn view(degrees: f64) -> Vec3 {
    let (s, c) = degrees.to_radians().sin_cos();
    let (y, x) = 0.6f64.sin_cos();
    Vec3::new((s * x) as f32, (s * y) as f32, c as f32)
}

// -------------------------------------------------------------- integration

/// Nodes and weights of Gauss's rule with three points on `[0, 1]`.
const GAUSS: [(f64, f64); 3] = [
    (0.112_701_665_379_258_3, 5.0 / 18.0),
    (0.5, 8.0 / 18.0),
    (0.887_298_334_620_741_7, 5.0 / 18.0),
];

/// A density per steradian.
type Density<'a> = &'a (dyn Fn(Vec3) -> f32 + Sync);

/// A direction by height and azimuth in turns.
fn direction(z: f64, turn: f64) -> Vec3 {
    let r = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
    let (s, c) = (turn * TAU).sin_cos();
    Vec3::new((r * c) as f32, (r * s) as f32, z as f32)
}

#[derive(Clone, Copy)]
struct Cell {
    z: (f64, f64),
    turn: (f64, f64),
}

impl Cell {
    fn rule(self, pdf: Density) -> f64 {
        let (dz, dt) = (self.z.1 - self.z.0, self.turn.1 - self.turn.0);
        let mut sum = 0.0;
        for (a, wa) in GAUSS {
            for (b, wb) in GAUSS {
                let at = direction(self.z.0 + a * dz, self.turn.0 + b * dt);
                sum += wa * wb * f64::from(pdf(at));
            }
        }
        sum * dz * dt * TAU
    }

    fn quarters(self) -> [Self; 4] {
        let z = 0.5 * (self.z.0 + self.z.1);
        let t = 0.5 * (self.turn.0 + self.turn.1);
        [(self.z.0, z), (z, self.z.1)]
            .map(|z| [(self.turn.0, t), (t, self.turn.1)].map(|turn| Self { z, turn }))
            .concat()
            .try_into()
            .unwrap_or([self; 4])
    }

    /// The density's integral to about `tolerance`; split `least` times
    /// whatever the estimates say.
    fn integral(self, pdf: Density, whole: f64, tolerance: f64, least: u32, most: u32) -> f64 {
        let parts = self.quarters().map(|q| (q, q.rule(pdf)));
        let sum: f64 = parts.iter().map(|p| p.1).sum();
        if most == 0 || (least == 0 && (sum - whole).abs() <= tolerance) {
            return sum;
        }
        parts
            .into_iter()
            .map(|(q, part)| {
                q.integral(
                    pdf,
                    part,
                    0.5 * tolerance,
                    least.saturating_sub(1),
                    most - 1,
                )
            })
            .sum()
    }
}

/// The CPU twin's density integrated over each bin, kept by name: the tests of
/// all twins need the same.
fn kept_masses(name: String, pdf: Density, mirror: Vec3) -> Arc<Vec<f64>> {
    static KEPT: Mutex<BTreeMap<String, Arc<Vec<f64>>>> = Mutex::new(BTreeMap::new());
    let known = |name: &str| {
        let kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        kept.get(name).cloned()
    };
    known(&name).unwrap_or_else(|| {
        let masses = Arc::new(masses(pdf, mirror));
        let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        kept.insert(name, Arc::clone(&masses));
        masses
    })
}

/// The density's mass in each bin. A narrow lobe around `mirror` is looked at
/// closely whatever its neighbourhood seems to be.
fn masses(pdf: Density, mirror: Vec3) -> Vec<f64> {
    let (row, column) = (
        ((f64::from(mirror.z) + 1.0) / 2.0 * BINS.rows as f64).floor(),
        turn_of(mirror.x.into(), mirror.y.into()) * BINS.columns as f64,
    );
    (0..BINS.count())
        .into_par_iter()
        .map(|bin| {
            let (r, c) = (bin / BINS.columns, bin % BINS.columns);
            let z = |r: usize| (2.0 * r as f64 / BINS.rows as f64 - 1.0).clamp(0.0, 1.0);
            let t = |c: usize| c as f64 / BINS.columns as f64;
            let cell = Cell {
                z: (z(r), z(r + 1)),
                turn: (t(c), t(c + 1)),
            };
            if cell.z.1 <= 0.0 {
                return 0.0;
            }
            let across = (c as f64 - column).abs();
            let near = (r as f64 - row).abs() <= 2.0
                && (across.min(BINS.columns as f64 - across) <= 3.0 || mirror.z > 0.98);
            let least = if near { 4 } else { 0 };
            // A fiftieth of a sample.
            cell.integral(pdf, cell.rule(pdf), 2e-8, least, 9)
        })
        .collect()
}

// ----------------------------------------------------------------- samplers

/// Reflected directions for pairs of random numbers, a view and a roughness.
type Draw<'a> = &'a dyn Fn(&[u32], Vec3, Vec2) -> Vec<[f64; 3]>;

fn words(values: &[f32]) -> impl Iterator<Item = u32> + '_ {
    values.iter().map(|v| v.to_bits())
}

/// `u, …fixed` for every pair of random numbers.
fn with_pairs(u: &[u32], fixed: &[f32]) -> Vec<u32> {
    u.chunks_exact(2)
        .flat_map(|u| u.iter().copied().chain(words(fixed)))
        .collect()
}

/// A sampler of half vectors, its directions and their density.
#[derive(Clone, Copy)]
struct Sampler {
    name: &'static str,
    path: &'static str,
    /// The normal distribution's sampler does not look at the view.
    takes_view: bool,
    pdf: fn(Vec3, Vec3, Vec2) -> f32,
    pdf_name: &'static str,
}

const SAMPLERS: [Sampler; 4] = [
    Sampler {
        name: "normal distribution",
        path: "brdf/ggx_ndf::ggx_ndf_sample",
        takes_view: false,
        pdf: ggx_ndf_direction_pdf,
        pdf_name: "ggx_ndf_direction_pdf",
    },
    Sampler {
        name: "visible normals, caps",
        path: "brdf/ggx_visible::ggx_visible_sample",
        takes_view: true,
        pdf: ggx_visible_direction_pdf,
        pdf_name: "ggx_visible_direction_pdf",
    },
    Sampler {
        name: "visible normals, Heitz",
        path: "brdf/ggx_visible::ggx_visible_sample_heitz",
        takes_view: true,
        pdf: ggx_visible_direction_pdf,
        pdf_name: "ggx_visible_direction_pdf",
    },
    Sampler {
        name: "bounded visible normals",
        path: "brdf/ggx_bounded::ggx_bounded_sample",
        takes_view: true,
        pdf: ggx_bounded_direction_pdf,
        pdf_name: "ggx_bounded_direction_pdf",
    },
];

impl Sampler {
    /// Both kernels on one twin, compiled once for all configurations.
    fn open(self, twin: Twin) -> impl Fn(&[u32], Vec3, Vec2) -> Vec<[f64; 3]> {
        let normal = Box::leak(Box::new(kernel(self.path)));
        let reflect = Box::leak(Box::new(kernel("brdf/ggx::ggx_reflect")));
        let (normal, reflect): (Run, Run) = (twin.prepare(normal), twin.prepare(reflect));
        move |u, wo, alpha| {
            let o = wo.to_array();
            let fixed: Vec<f32> = if self.takes_view {
                vec![o[0], o[1], o[2], alpha.x, alpha.y]
            } else {
                vec![alpha.x, alpha.y]
            };
            let normals = normal(&with_pairs(u, &fixed));
            let input: Vec<u32> = normals
                .chunks_exact(3)
                .flat_map(|h| {
                    words(&o)
                        .collect::<Vec<_>>()
                        .into_iter()
                        .chain(h.iter().copied())
                })
                .collect();
            reflect(&input).chunks_exact(3).map(components).collect()
        }
    }
}

/// The p-value of directions against a density with this much mass dropped.
fn p_value(
    drawn: impl IntoIterator<Item = Option<[f64; 3]>>,
    masses: &[f64],
) -> Result<f64, String> {
    let mut observed = vec![0u64; BINS.count() + 1];
    let mut count = 0;
    for d in drawn {
        count += 1;
        let bin = match d {
            None => BINS.count(),
            Some([x, y, z]) => {
                let length = (x * x + y * y + z * z).sqrt();
                if length.is_nan() || (length - 1.0).abs() > 1e-5 {
                    return Err(format!("[{x}, {y}, {z}] is {length} long"));
                }
                BINS.index(z, turn_of(x, y), 1e-6)
                    .ok_or_else(|| format!("[{x}, {y}, {z}] lies outside"))?
            }
        };
        observed[bin] += 1;
    }
    let mut expected = masses.to_vec();
    let mass: f64 = expected.iter().sum();
    if mass.is_nan() || mass > 1.0 + 1e-3 {
        return Err(format!("the density integrates to {mass}"));
    }
    expected.push((1.0 - mass).max(0.0));
    for e in &mut expected {
        *e *= f64::from(count);
    }
    // A drop that rounding alone makes possible is no bin of its own.
    if expected[BINS.count()] < 50.0 && observed[BINS.count()] < 50 {
        expected.pop();
        observed.pop();
    }
    let test = chi_square(&observed, &expected, 5.0).map_err(|e| e.to_string())?;
    Ok(test.p_value)
}

fn above(d: [f64; 3]) -> Option<[f64; 3]> {
    (d[2] > 0.0).then_some(d)
}

fn mirror_of(wo: Vec3) -> Vec3 {
    Vec3::new(-wo.x, -wo.y, wo.z)
}

fn ggx_samples_follow_the_density(twin: Twin) {
    let significance = sidak(0.01, SAMPLERS.len() * (ALPHAS.len() + 1) * ANGLES.len());
    let (roughness, angles) = grid(twin);
    let mut worst = (1.0f64, String::new());
    for (k, sampler) in SAMPLERS.into_iter().enumerate() {
        let draw = sampler.open(twin);
        let alphas = roughness
            .iter()
            .map(|a| Vec2::splat(*a))
            .chain([Vec2::new(0.4, 0.1)]);
        for (j, alpha) in alphas.enumerate() {
            for (i, degrees) in angles.iter().copied().enumerate() {
                let wo = view(degrees);
                let u = random_pairs(SAMPLES, (100 * k + 10 * j + i) as u32);
                let drawn = draw(&u, wo, alpha).into_iter().map(above);
                let pdf = |wi: Vec3| (sampler.pdf)(wo, wi, alpha);
                let case = format!("{}, alpha {alpha}, {degrees} degrees", sampler.name);
                let name = format!("{} {alpha} {degrees}", sampler.pdf_name);
                let p = p_value(drawn, &kept_masses(name, &pdf, mirror_of(wo)))
                    .unwrap_or_else(|e| panic!("{case} on {}: {e}", twin.label()));
                assert!(
                    p > significance,
                    "{case} on {}: the samples do not follow the density, p = {p:e} (< {significance:e})",
                    twin.label()
                );
                if p < worst.0 {
                    worst = (p, case);
                }
            }
        }
    }
    println!("{}: smallest p {:.2e} ({})", twin.label(), worst.0, worst.1);
}

fn lambert_samples_follow_the_density(twin: Twin) {
    let sample = kernel("brdf/lambert::lambert_sample");
    let drawn = twin.prepare(&sample)(&random_pairs(SAMPLES, 41));
    let drawn = drawn.chunks_exact(3).map(components).map(above);
    let p = p_value(drawn, &kept_masses("lambert".into(), &lambert_pdf, Vec3::Z))
        .unwrap_or_else(|e| panic!("{}: {e}", twin.label()));
    println!("{}: p {p:.2e}", twin.label());
    assert!(p > 0.01, "Lambert on {}: p = {p:e}", twin.label());
}

/// The call that gives direction and density at once, against those for one
/// thing each.
fn bounded_directions_are_those_of_the_separate_calls(twin: Twin) {
    let together = kernel("brdf/ggx_bounded::ggx_bounded_direction_sample");
    let together = twin.prepare(&together);
    let separate = SAMPLERS[3].open(twin);
    let u = random_pairs(1 << 14, 53);
    let mut worst = (0f64, 0f64);
    for alpha in [0.005, 0.05, 0.25, 1.0].map(Vec2::splat) {
        for degrees in ANGLES {
            let wo = view(degrees);
            let fixed = [wo.x, wo.y, wo.z, alpha.x, alpha.y];
            let found = together(&with_pairs(&u, &fixed));
            for (one, [x, y, z]) in found.chunks_exact(4).zip(separate(&u, wo, alpha)) {
                let [a, b, c] = components(&one[..3]);
                let pdf = float(one[3]);
                // Both are dropped; and far below the normal is uncertain.
                if c <= 0.0 && z < 1e-4 {
                    assert_eq!(pdf, 0.0, "{alpha} {degrees}: below the horizon");
                    continue;
                }
                let apart = ((a - x).powi(2) + (b - y).powi(2) + (c - z).powi(2)).sqrt();
                worst.0 = worst.0.max(apart);
                assert!(apart < 2e-5, "{alpha} {degrees}: {apart:e} apart");
                let wi = Vec3::new(a as f32, b as f32, c as f32);
                let truth = f64::from(ggx_bounded_direction_pdf(wo, wi, alpha));
                // Three roundings of the direction turn the normal by that over
                // |wo + wi|, and ln D has a slope of 2/alpha at most.
                let m = f64::from((wo + wi).length());
                let moved = 2.0 / f64::from(alpha.x) * 3.0 * EPS / m;
                let off = (pdf / truth - 1.0).abs() / (1e-5 + moved);
                worst.1 = worst.1.max(off);
                assert!(off < 1.0, "{alpha} {degrees}: {pdf} for {truth}");
            }
        }
    }
    println!(
        "{}: {:.1e} apart, density off by {:.2} of what rounding allows",
        twin.label(),
        worst.0,
        worst.1
    );
}

// ------------------------------------------------------------------- mass

/// The part of all `u` whose reflection ends at or below the horizon.
fn dropped(draw: Draw, wo: Vec3, alpha: Vec2) -> f64 {
    const SIDE: u32 = 512;
    let u: Vec<u32> = (0..SIDE * SIDE)
        .flat_map(|i| [i % SIDE, i / SIDE].map(|k| ((k as f32 + 0.5) / SIDE as f32).to_bits()))
        .collect();
    let below = draw(&u, wo, alpha).iter().filter(|d| d[2] <= 0.0).count();
    below as f64 / f64::from(SIDE * SIDE)
}

fn densities_and_dropped_samples_make_one(twin: Twin) {
    let (roughness, angles) = grid(twin);
    for sampler in SAMPLERS {
        let draw = sampler.open(twin);
        let mut worst = 0f64;
        for alpha in roughness.iter().map(|a| Vec2::splat(*a)) {
            for degrees in angles.iter().copied() {
                let wo = view(degrees);
                let pdf = |wi: Vec3| (sampler.pdf)(wo, wi, alpha);
                let name = format!("{} {alpha} {degrees}", sampler.pdf_name);
                let mass: f64 = kept_masses(name, &pdf, mirror_of(wo)).iter().sum();
                let off = mass + dropped(&draw, wo, alpha) - 1.0;
                worst = worst.max(off.abs());
                assert!(
                    off.abs() < 1e-3,
                    "{}, alpha {alpha}, {degrees} degrees on {}: {mass} and the dropped make 1 + {off:e}",
                    sampler.name,
                    twin.label()
                );
            }
        }
        println!(
            "{} on {}: off by {worst:.1e} at most",
            sampler.name,
            twin.label()
        );
    }
}

// ------------------------------------------------------- the three samplers

/// Albedo, rejected part and relative variance of value · cosine / density
/// with a Fresnel term of one.
fn moments(sampler: Sampler, draw: Draw, wo: Vec3, alpha: Vec2) -> (f64, f64, f64) {
    // Stratified: the mean of 1024² cells is good to four digits.
    const SIDE: u32 = 1024;
    let jitter = random_pairs((SIDE * SIDE) as usize, 77);
    let u: Vec<u32> = (0..SIDE * SIDE)
        .flat_map(|i| {
            [(i % SIDE, 2 * i), (i / SIDE, 2 * i + 1)].map(|(k, j)| {
                let at = (k as f32 + f32::from_bits(jitter[j as usize])) / SIDE as f32;
                at.min(0.999_999_94).to_bits()
            })
        })
        .collect();
    let (mut sum, mut square, mut lost) = (0.0, 0.0, 0.0);
    for d in draw(&u, wo, alpha) {
        if d[2] <= 0.0 {
            lost += 1.0;
            continue;
        }
        let wi = Vec3::new(d[0] as f32, d[1] as f32, d[2] as f32);
        let value = ggx_d_between(wo, wi, alpha) * ggx_visibility(wo, wi, alpha) * wi.z;
        let weight = f64::from(value / (sampler.pdf)(wo, wi, alpha));
        sum += weight;
        square += weight * weight;
    }
    let n = f64::from(SIDE * SIDE);
    let mean = sum / n;
    (mean, lost / n, square / n / (mean * mean) - 1.0)
}

/// Alpha, degrees; then albedo and relative variance of the normal
/// distribution, visible and bounded normals, from independent measurements in
/// double precision.
const PUBLISHED: [(f32, f64, f64, [f64; 3]); 8] = [
    (0.25, 0.0, 0.916, [0.0719, 0.0719, 0.0087]),
    (0.25, 75.0, 0.840, [1.284, 0.103, 0.074]),
    (0.5, 0.0, 0.688, [0.319, 0.319, 0.055]),
    (0.5, 45.0, 0.683, [0.610, 0.304, 0.132]),
    (0.5, 85.0, 0.872, [3.437, 0.072, 0.033]),
    (1.0, 0.0, 0.307, [1.410, 1.410, 0.207]),
    (1.0, 45.0, 0.377, [1.544, 1.019, 0.182]),
    (0.1, 85.0, 0.887, [2.433, 0.060, 0.055]),
];

fn samplers_agree_on_the_albedo_and_differ_in_variance(twin: Twin) {
    for (k, column) in [(0, 0), (1, 1), (2, 1), (3, 2)] {
        let sampler = SAMPLERS[k];
        let draw = sampler.open(twin);
        for (alpha, degrees, albedo, variance) in PUBLISHED {
            let (mean, lost, found) = moments(sampler, &draw, view(degrees), Vec2::splat(alpha));
            println!(
                "{} on {}, alpha {alpha}, {degrees}: albedo {mean:.4} ({albedo}), dropped {lost:.3}, variance {found:.4} ({})",
                sampler.name,
                twin.label(),
                variance[column]
            );
            // Three digits; the normal distribution's weights at grazing
            // angles have a long tail, which the grid does not tame.
            let slack = if column == 0 && degrees > 70.0 {
                4e-3
            } else {
                1e-3
            };
            assert!((mean - albedo).abs() < slack, "{mean} for {albedo}");
            let ratio = found / variance[column];
            let slack = if column == 0 { 0.1 } else { 0.05 };
            assert!(
                (ratio - 1.0).abs() < slack,
                "{found} for {}",
                variance[column]
            );
        }
    }
}

// --------------------------------------------------------------- identities

#[test]
fn the_distribution_projects_to_one() {
    for alpha in [
        Vec2::splat(0.05),
        Vec2::splat(0.5),
        Vec2::ONE,
        Vec2::new(0.7, 0.2),
    ] {
        let pdf = |h: Vec3| ggx_d(h, alpha) * h.z.max(0.0);
        let mass: f64 = masses(&pdf, Vec3::Z).iter().sum();
        assert!((mass - 1.0).abs() < 1e-5, "{alpha}: {mass}");
    }
}

#[test]
fn visible_area_is_what_the_normals_show() {
    // ∫ D max(wo·h, 0) dω = projected area, also seen from below.
    for alpha in [Vec2::splat(0.3), Vec2::new(0.8, 0.4)] {
        for wo in [view(0.0), view(45.0), view(85.0), -view(60.0)] {
            let seen = |h: Vec3| ggx_d(h, alpha) * vec3_dot(wo, h).max(0.0);
            let mass: f64 = masses(&seen, Vec3::Z).iter().sum();
            let area = f64::from(ggx_projected_area(wo, alpha));
            assert!(
                (mass - area).abs() < 1e-4 * area.max(0.01),
                "{alpha} {wo}: {mass} {area}"
            );
        }
    }
}

fn masking_is_symmetric(twin: Twin) {
    let (lambda, g1) = (kernel("brdf/ggx::ggx_lambda"), kernel("brdf/ggx::ggx_g1"));
    let (lambda_run, g1_run) = (twin.prepare(&lambda), twin.prepare(&g1));
    let (mut up, mut down) = (Vec::new(), Vec::new());
    for degrees in ANGLES {
        for alpha in ALPHAS {
            let w = view(degrees);
            up.extend(words(&[w.x, w.y, w.z, alpha, 0.7 * alpha]));
            down.extend(words(&[-w.x, -w.y, -w.z, alpha, 0.7 * alpha]));
        }
    }
    for (a, b) in lambda_run(&up).iter().zip(lambda_run(&down)) {
        let (a, b) = (float(*a), float(b));
        assert!((b - (1.0 + a)).abs() <= 4.0 * 2.0 * EPS * b, "{a} {b}");
    }
    assert_eq!(g1_run(&up), g1_run(&down), "{}", twin.label());
}

// ------------------------------------------------------------ reflection rays

fn alternatives_below_the_horizon_are_in_the_density(twin: Twin) {
    const DEGREES: [f64; 4] = [0.0, 45.0, 75.0, 89.0];
    let roughness = [0.125f32, 0.5, 1.0];
    let significance = sidak(0.01, DEGREES.len() * roughness.len());
    let found = kernel("brdf/reflection::reflection_sample");
    let run = twin.prepare(&found);
    for alpha in roughness.map(Vec2::splat) {
        for (seed, degrees) in (500..).zip(DEGREES) {
            let wo = view(degrees);
            let fixed = [wo.x, wo.y, wo.z, alpha.x, alpha.y];
            let drawn: Vec<_> = run(&with_pairs(&random_pairs(SAMPLES, seed), &fixed))
                .chunks_exact(5)
                .map(|r| Some(components(&r[..3])))
                .collect();
            let pdf = |wi: Vec3| reflection_pdf(wo, wi, alpha);
            let name = format!("reflection {alpha} {degrees}");
            let kept = kept_masses(name, &pdf, mirror_of(wo));
            let mass: f64 = kept.iter().sum();
            let case = format!("alpha {alpha}, {degrees} degrees, {}", twin.label());
            assert!((mass - 1.0).abs() < 1e-3, "{case}: mass {mass}");
            let p = p_value(drawn, &kept).unwrap_or_else(|e| panic!("{case}: {e}"));
            assert!(p > significance, "{case}: p = {p:e} (< {significance:e})");
        }
    }
}

/// What trimming loses, as docs/brdf/reflection.md has it.
#[test]
fn trimming_loses_the_tail_and_no_more() {
    const SIDE: u16 = 1024;
    let alpha = Vec2::splat(0.5);
    for degrees in [0.0, 45.0, 75.0] {
        let wo = view(degrees);
        let mut before = 0.0;
        for trim in [0.5f32, 0.7, 0.8, 0.9, 0.95, 1.0] {
            let mut sum = 0.0;
            for i in 0..u32::from(SIDE) * u32::from(SIDE) {
                let at = |k: u32| (k as f32 + 0.5) / f32::from(SIDE);
                let u = Vec2::new(at(i % u32::from(SIDE)), at(i / u32::from(SIDE)));
                let ray = reflection_trimmed_sample(u, wo, alpha, trim);
                if ray.pdf > 0.0 {
                    let value = cook_torrance_eval(wo, ray.direction, alpha, Vec3::ONE).x;
                    sum += f64::from(value * ray.direction.z / ray.pdf);
                }
            }
            let albedo = sum / f64::from(SIDE).powi(2);
            println!("{degrees} degrees, trim {trim}: {albedo:.3}");
            // Straight on, the last fifth is below the horizon anyway.
            assert!(
                albedo > before - 1e-5,
                "{degrees} {trim}: {albedo} after {before}"
            );
            before = albedo;
        }
        let expected = match degrees {
            0.0 => 0.688,
            45.0 => 0.683,
            _ => 0.761,
        };
        assert!(
            (before - expected).abs() < 5e-3,
            "{degrees}: {before} for {expected}"
        );
    }
}

/// A filter that divides by the sum of its weights gives back the energy that
/// trimming takes; what stays wrong is the tail's shape.
#[test]
fn a_ratio_of_sums_corrects_the_energy_of_trimming() {
    const SIDE: u16 = 512;
    let alpha = Vec2::splat(0.5);
    for degrees in [0.0, 45.0, 75.0] {
        let wo = view(degrees);
        let mirror = mirror_of(wo);
        // What lies ahead: the same everywhere; or brighter toward the mirror.
        for (name, slope) in [("even light", 0.0f32), ("a gradient", 0.5)] {
            let estimates = |trim: f32| {
                let (mut plain, mut weights) = (0.0, 0.0);
                for i in 0..u32::from(SIDE) * u32::from(SIDE) {
                    let at = |k: u32| (k as f32 + 0.5) / f32::from(SIDE);
                    let u = Vec2::new(at(i % u32::from(SIDE)), at(i / u32::from(SIDE)));
                    let ray = reflection_trimmed_sample(u, wo, alpha, trim);
                    if ray.pdf > 0.0 {
                        let value = cook_torrance_eval(wo, ray.direction, alpha, Vec3::ONE).x;
                        let weight = f64::from(value * ray.direction.z / ray.pdf);
                        let light = 1.0 + slope * vec3_dot(mirror, ray.direction);
                        plain += weight * f64::from(light);
                        weights += weight;
                    }
                }
                (plain / f64::from(SIDE).powi(2), plain / weights)
            };
            let (truth, mean) = estimates(1.0);
            let (trimmed, corrected) = estimates(0.8);
            let lost = 1.0 - trimmed / truth;
            let left = (corrected / mean - 1.0).abs();
            println!("{degrees} degrees, {name}: plain loses {lost:.3}, a ratio errs by {left:.4}");
            if slope == 0.0 {
                assert!(left < 1e-6, "{degrees}: {left}");
            } else if degrees > 0.0 {
                // Straight on the last fifth is below the horizon anyway.
                assert!(left < 0.75 * lost.abs(), "{degrees}: {left} of {lost}");
            }
        }
    }
}

// ------------------------------------------------------------------ layers

/// A stack with a name.
struct Named<const N: usize> {
    name: &'static str,
    stack: LayeredStack<N>,
}

fn dielectric(alpha: f32, eta: f32, depth: Vec3) -> LayeredLayer {
    LayeredLayer {
        reflectance: Vec3::splat(fresnel_f0(eta)),
        eta,
        depth,
        alpha: Vec2::splat(alpha),
    }
}

fn metal(color: [f32; 3], alpha: f32) -> LayeredLayer {
    LayeredLayer {
        reflectance: Vec3::from_array(color),
        eta: 1.0,
        depth: Vec3::ZERO,
        alpha: Vec2::splat(alpha),
    }
}

fn over<const N: usize>(layers: [LayeredLayer; N], albedo: Vec3) -> LayeredStack<N> {
    LayeredStack {
        layers,
        diffuse: layered_diffuse(albedo, layers[N - 1]),
    }
}

const GOLD: [f32; 3] = [1.0, 0.78, 0.34];

fn one(alpha: f32) -> [Named<1>; 2] {
    let plastic = dielectric(alpha, 1.5, Vec3::ZERO);
    [
        Named {
            name: "gold",
            stack: over([metal(GOLD, alpha)], Vec3::ZERO),
        },
        Named {
            name: "white plastic",
            stack: over([plastic], Vec3::ONE),
        },
    ]
}

fn two(alpha: f32) -> [Named<2>; 2] {
    let coat = dielectric(0.05, 1.5, Vec3::new(0.1, 0.3, 0.6));
    [
        Named {
            name: "tinted coat on silver",
            stack: over([coat, metal([0.97, 0.96, 0.91], alpha)], Vec3::ZERO),
        },
        Named {
            name: "coat on white plastic",
            stack: over(
                [
                    dielectric(0.05, 1.5, Vec3::ZERO),
                    dielectric(alpha, 1.2, Vec3::ZERO),
                ],
                Vec3::ONE,
            ),
        },
    ]
}

fn four(alpha: f32) -> [Named<4>; 1] {
    [Named {
        name: "four layers",
        stack: over(
            [
                dielectric(0.1, 1.3, Vec3::splat(0.05)),
                dielectric(alpha, 1.2, Vec3::new(0.0, 0.2, 0.4)),
                dielectric(0.3, 1.1, Vec3::ZERO),
                dielectric(0.5, 1.1, Vec3::ZERO),
            ],
            Vec3::new(0.9, 0.8, 0.7),
        ),
    }]
}

fn layered_kernel<const N: usize>(name: &str) -> &'static Kernel {
    let found = layered::kernels::<N>()
        .into_iter()
        .find(|k| k.name == name)
        .unwrap_or_else(|| panic!("no kernel {name}"));
    Box::leak(Box::new(found))
}

fn stack_words<const N: usize>(stack: &LayeredStack<N>) -> Vec<u32> {
    let mut out = vec![0; LayeredStack::<N>::WORDS];
    stack.write(&mut out);
    out
}

/// Random triples as words.
fn random_triples(count: usize, seed: u32) -> Vec<u32> {
    let mut all = random_pairs(count + count.div_ceil(2), seed);
    all.truncate(3 * count);
    all
}

/// One sample of a stack on some twin: direction, density, weight.
struct Drawn {
    direction: Option<[f64; 3]>,
    pdf: f64,
    weight: [f64; 3],
}

fn draw_stack(run: &Run, stack: &[u32], wo: Vec3, u: &[u32]) -> Vec<Drawn> {
    let o: Vec<u32> = words(&wo.to_array()).collect();
    let input: Vec<u32> = u
        .chunks_exact(3)
        .flat_map(|u| stack.iter().chain(&o).chain(u).copied().collect::<Vec<_>>())
        .collect();
    run(&input)
        .chunks_exact(8)
        .map(|s| {
            let pdf = float(s[3]);
            Drawn {
                direction: (pdf > 0.0).then(|| components(&s[..3])),
                pdf,
                weight: components(&s[4..7]),
            }
        })
        .collect()
}

fn follow<const N: usize>(twin: Twin, stacks: fn(f32) -> Vec<Named<N>>, tests: usize) {
    let significance = sidak(0.01, tests);
    let (roughness, angles) = grid(twin);
    let run = twin.prepare(layered_kernel::<N>("layered_sample"));
    for (j, alpha) in roughness.into_iter().enumerate() {
        for Named { name, stack } in stacks(alpha) {
            let flat = stack_words(&stack);
            for (i, degrees) in angles.iter().copied().enumerate() {
                let wo = view(degrees);
                // Rows of a sixth of the samples, so that the words of a
                // stack need not all be in memory.
                let seed = (1000 * N + 10 * j + i) as u32;
                let parts = (0..5).flat_map(|part| {
                    let u = random_triples(SAMPLES / 5, 97 * seed + part);
                    draw_stack(&run, &flat, wo, &u)
                        .into_iter()
                        .map(|d| d.direction)
                        .collect::<Vec<_>>()
                });
                let pdf = |wi: Vec3| layered_pdf(&stack, wo, wi);
                let case = format!("{name}, alpha {alpha}, {degrees} degrees, {}", twin.label());
                let kept = kept_masses(format!("{name} {alpha} {degrees}"), &pdf, mirror_of(wo));
                let p = p_value(parts, &kept).unwrap_or_else(|e| panic!("{case}: {e}"));
                assert!(p > significance, "{case}: p = {p:e} (< {significance:e})");
            }
        }
    }
}

fn layered_samples_follow_the_density(twin: Twin) {
    let tests = 5 * ALPHAS.len() * ANGLES.len();
    follow::<1>(twin, |a| one(a).into(), tests);
    follow::<2>(twin, |a| two(a).into(), tests);
    follow::<4>(twin, |a| four(a).into(), tests);
}

fn agree<const N: usize>(twin: Twin, stacks: fn(f32) -> Vec<Named<N>>) {
    const COUNT: usize = 4096;
    let sample = twin.prepare(layered_kernel::<N>("layered_sample"));
    let (eval_kernel, pdf_kernel) = (
        layered_kernel::<N>("layered_eval"),
        layered_kernel::<N>("layered_pdf"),
    );
    let (eval, pdf) = (twin.prepare(eval_kernel), twin.prepare(pdf_kernel));
    let (roughness, angles) = grid(twin);
    for alpha in roughness {
        for Named { name, stack } in stacks(alpha) {
            let flat = stack_words(&stack);
            for degrees in angles.iter().copied() {
                let wo = view(degrees);
                let drawn = draw_stack(&sample, &flat, wo, &random_triples(COUNT, 5));
                let kept: Vec<&Drawn> = drawn.iter().filter(|d| d.direction.is_some()).collect();
                let arguments = |flip: bool| -> Vec<u32> {
                    kept.iter()
                        .flat_map(|d| {
                            let i = d.direction.unwrap_or_default().map(|v| v as f32);
                            let o = wo.to_array();
                            let (a, b) = if flip { (i, o) } else { (o, i) };
                            flat.iter()
                                .copied()
                                .chain(words(&a))
                                .chain(words(&b))
                                .collect::<Vec<_>>()
                        })
                        .collect()
                };
                let values = eval(&arguments(false));
                let back = eval(&arguments(true));
                let densities = pdf(&arguments(false));
                for (k, d) in kept.iter().enumerate() {
                    let case =
                        || format!("{name}, alpha {alpha}, {degrees} degrees, {}", twin.label());
                    let density = float(densities[k]);
                    assert!(
                        (d.pdf / density - 1.0).abs() < 1e-5,
                        "{}: sample says {}, pdf {density}",
                        case(),
                        d.pdf
                    );
                    let cos = d.direction.unwrap_or_default()[2];
                    for c in 0..3 {
                        let f = float(values[3 * k + c]);
                        let weight = f * cos / density;
                        assert!(
                            (d.weight[c] - weight).abs() <= 1e-4 * weight,
                            "{}: weight {} for {weight}",
                            case(),
                            d.weight[c]
                        );
                        let b = float(back[3 * k + c]);
                        assert!(
                            (f - b).abs() <= 1e-5 * f.max(b),
                            "{}: {f} one way, {b} back",
                            case()
                        );
                    }
                }
            }
        }
    }
}

fn layered_sample_value_and_density_agree_and_are_reciprocal(twin: Twin) {
    agree::<1>(twin, |a| one(a).into());
    agree::<2>(twin, |a| two(a).into());
    agree::<4>(twin, |a| four(a).into());
}

fn furnace<const N: usize>(twin: Twin, stacks: fn(f32) -> Vec<Named<N>>) {
    const COUNT: usize = 65_536;
    let sample = twin.prepare(layered_kernel::<N>("layered_sample"));
    let (roughness, angles) = grid(twin);
    for alpha in roughness {
        for Named { name, stack } in stacks(alpha) {
            let flat = stack_words(&stack);
            let mut line = String::new();
            for degrees in angles.iter().copied() {
                let wo = view(degrees);
                let drawn = draw_stack(&sample, &flat, wo, &random_triples(COUNT, 9));
                let n = COUNT as f64;
                for c in 0..3 {
                    let mean = drawn.iter().map(|d| d.weight[c]).sum::<f64>() / n;
                    let square = drawn
                        .iter()
                        .map(|d| (d.weight[c] - mean).powi(2))
                        .sum::<f64>();
                    let sigma = (square / n / n).sqrt();
                    assert!(
                        mean <= 1.0 + 3.0 * sigma,
                        "{name}, alpha {alpha}, {degrees} degrees, {}: reflects {mean} of 1 (sigma {sigma:e})",
                        twin.label()
                    );
                    if c == 0 {
                        line += &format!(" {mean:.3}");
                    }
                }
                // The mass of the density and the dropped samples.
                let pdf = |wi: Vec3| layered_pdf(&stack, wo, wi);
                let kept = kept_masses(format!("{name} {alpha} {degrees}"), &pdf, mirror_of(wo));
                let mass: f64 = kept.iter().sum();
                let lost = drawn.iter().filter(|d| d.direction.is_none()).count() as f64 / n;
                let sigma = (lost * (1.0 - lost) / n).sqrt();
                assert!(
                    (mass + lost - 1.0).abs() < 1e-3 + 4.0 * sigma,
                    "{name}, alpha {alpha}, {degrees} degrees: mass {mass}, dropped {lost}"
                );
            }
            println!("{name}, alpha {alpha}, {}:{line}", twin.label());
        }
    }
}

fn no_stack_reflects_more_than_it_gets(twin: Twin) {
    furnace::<1>(twin, |a| one(a).into());
    furnace::<2>(twin, |a| two(a).into());
    furnace::<4>(twin, |a| four(a).into());
}

// -------------------------------------------------------- checks that reject

#[test]
fn rejects_the_density_of_the_wrong_normals() {
    let draw = SAMPLERS[3].open(Twin::Cpu);
    let (wo, alpha) = (view(45.0), Vec2::splat(0.5));
    let u = random_pairs(SAMPLES, 3);
    let drawn = draw(&u, wo, alpha).into_iter().map(above);
    let pdf = |wi: Vec3| ggx_visible_direction_pdf(wo, wi, alpha);
    assert!(p_value(drawn, &masses(&pdf, mirror_of(wo))).is_ok_and(|p| p < 1e-6));
}

#[test]
fn rejects_a_half_vector_density_taken_for_a_direction_density() {
    let draw = SAMPLERS[1].open(Twin::Cpu);
    let (wo, alpha) = (view(30.0), Vec2::splat(0.25));
    let u = random_pairs(SAMPLES, 4);
    let drawn = draw(&u, wo, alpha).into_iter().map(above);
    let pdf = |wi: Vec3| ggx_visible_pdf(ggx_half(wo, wi), wo, alpha);
    assert!(!p_value(drawn, &masses(&pdf, mirror_of(wo))).is_ok_and(|p| p > 1e-6));
}

#[test]
fn rejects_a_layer_without_its_solid_angle() {
    // Weidlich and Wilkie as printed: the lower lobe's density as it is inside.
    let stack = over(
        [
            dielectric(0.05, 1.5, Vec3::ZERO),
            metal([0.97, 0.96, 0.91], 0.5),
        ],
        Vec3::ZERO,
    );
    let wo = view(45.0);
    let run = twin_sample::<2>();
    let drawn: Vec<_> = draw_stack(&run, &stack_words(&stack), wo, &random_triples(SAMPLES, 6))
        .into_iter()
        .map(|d| d.direction)
        .collect();
    let printed = |wi: Vec3| {
        let pmf = layered_pmf(&stack, wo);
        let (o, i) = (layered_refract(wo, 1.5), layered_refract(wi, 1.5));
        pmf.layers[0] * ggx_bounded_direction_pdf(wo, wi, stack.layers[0].alpha)
            + pmf.layers[1] * ggx_bounded_direction_pdf(o, i, stack.layers[1].alpha)
            + pmf.diffuse * hemisphere_cosine_pdf(wi)
    };
    assert!(!p_value(drawn, &masses(&printed, mirror_of(wo))).is_ok_and(|p| p > 1e-6));
}

fn twin_sample<const N: usize>() -> Run<'static> {
    Twin::Cpu.prepare(layered_kernel::<N>("layered_sample"))
}

on_both_twins! {
    lambert_samples_follow_the_density
    bounded_directions_are_those_of_the_separate_calls
    ggx_samples_follow_the_density
    densities_and_dropped_samples_make_one
    samplers_agree_on_the_albedo_and_differ_in_variance
    masking_is_symmetric
    layered_samples_follow_the_density
    layered_sample_value_and_density_agree_and_are_reciprocal
    no_stack_reflects_more_than_it_gets
    alternatives_below_the_horizon_are_in_the_density
}
