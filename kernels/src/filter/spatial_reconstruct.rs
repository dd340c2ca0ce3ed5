//! Spatial reconstruction: the pair and its contract.

pub use raytwin_cpu::filter::spatial_reconstruct::*;

/// The WGSL twin, without what it requires and without its callbacks.
pub const WGSL: &str = raytwin_wgsl::filter::SPATIAL_RECONSTRUCT;

#[cfg(feature = "contract")]
use glam::{DVec2, DVec3, UVec2, Vec3};

#[cfg(feature = "contract")]
crate::value_struct!(SpatialReconstructState {
    color: Vec3,
    weight: f32,
    squares: f32,
    pairs: f32,
    spread: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(SpatialReconstruction {
    color: Vec3,
    variance: f32,
    samples: f32,
});

/// Squared size of a colour with the channels weighted as in luminance.
#[cfg(feature = "contract")]
pub(super) fn exact_square(c: DVec3) -> f64 {
    (c * c).dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Neighbour `index` of the golden-angle spiral, at distance `r`.
#[cfg(feature = "contract")]
pub(super) fn exact_spiral(index: u32, r: f64, turn: f64) -> DVec2 {
    // 1/φ = (√5 - 1)/2, not through the fixed-point constant.
    let golden = (5f64.sqrt() - 1.0) / 2.0;
    let angle = (f64::from(index) * golden).fract() + turn;
    DVec2::from_angle(std::f64::consts::TAU * angle) * r
}

/// The pixel at a rounded offset, if inside, and whether the rounding is
/// within reach of an error.
#[cfg(feature = "contract")]
pub(super) fn exact_neighbour(own: UVec2, size: UVec2, offset: DVec2) -> (Option<UVec2>, bool) {
    let at = own.as_dvec2() + (offset + 0.5).floor();
    let inside = at.cmpge(DVec2::ZERO).all() && at.cmplt(size.as_dvec2()).all();
    let edge = (offset + 0.5) - (offset + 0.5).round();
    let open = edge.abs().min_element() < 2e-5;
    (inside.then(|| at.as_uvec2()), open)
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};

    const MODULE: &str = "filter/spatial_reconstruct";
    const SOURCE: &str = "Ray Tracing Gems, ch. 25 (spatial reconstruction)";
    const MOMENTS: &str = "West 1979; Kish 1965 (effective samples)";
    // The neighbours' data from a hash of their place, in exact fractions, so
    // that interval arithmetic sees the whole kernel.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u, lane: u32) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn spatial_reconstruct_read_hit(at: vec2u) -> SpatialReconstructHit {
    let x = f32(raytwin_hash(at, 0u)) * 0.0078125 - 0.5;
    let y = f32(raytwin_hash(at, 1u)) * 0.0078125 - 0.5;
    var pdf = f32(raytwin_hash(at, 2u) + 1u) * 0.0625;
    if raytwin_hash(at, 3u) < 32u || (at.x < 2u && at.y < 2u) {
        pdf = 0.0;
    }
    let red = f32(raytwin_hash(at, 4u)) * 0.00390625;
    let green = f32(raytwin_hash(at, 5u)) * 0.00390625;
    let blue = f32(raytwin_hash(at, 6u)) * 0.00390625;
    return SpatialReconstructHit(vec3f(x, y, 1.0), pdf, vec3f(red, green, blue));
}
fn spatial_reconstruct_weight(pixel: vec2u, at: vec2u, hit: SpatialReconstructHit) -> f32 {
    let x = hit.position.x - f32(pixel.x) * 0.0625;
    let y = hit.position.y - f32(pixel.y) * 0.0625;
    return max(1.0 - (x * x + y * y), 0.0);
}
";
    fn hash(at: UVec2, lane: u32) -> u32 {
        let mut h = at.x.wrapping_mul(0x9e37_79b9)
            ^ at.y.wrapping_mul(0x85eb_ca6b)
            ^ lane.wrapping_mul(0xc2b2_ae35);
        h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
        h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
        (h ^ (h >> 16)) & 255
    }
    fn read_hit(at: UVec2) -> SpatialReconstructHit {
        let lane = |i: u32, step: f32| hash(at, i) as f32 * step;
        let empty = hash(at, 3) < 32 || (at.x < 2 && at.y < 2);
        SpatialReconstructHit {
            position: Vec3::new(lane(0, 0.0078125) - 0.5, lane(1, 0.0078125) - 0.5, 1.0),
            pdf: if empty {
                0.0
            } else {
                (hash(at, 2) + 1) as f32 * 0.0625
            },
            radiance: Vec3::new(
                lane(4, 0.00390625),
                lane(5, 0.00390625),
                lane(6, 0.00390625),
            ),
        }
    }
    fn weight(pixel: UVec2, _: UVec2, hit: SpatialReconstructHit) -> f32 {
        let x = hit.position.x - pixel.x as f32 * 0.0625;
        let y = hit.position.y - pixel.y as f32 * 0.0625;
        (1.0 - (x * x + y * y)).max(0.0)
    }
    fn pixel(pixel: UVec2, size: UVec2, count: u32, turn: f32) -> SpatialReconstruction {
        spatial_reconstruct_pixel(pixel, size, count, turn, read_hit, weight)
    }
    // The usual form beside it; guarded, or it would give NaN without weights.
    const PLAIN_WGSL: &str = "
fn baseline(pixel: vec2u, size: vec2u, count: u32, turn: f32) -> SpatialReconstruction {
    let own = min(pixel / 2u, size - 1u);
    let luma = vec3f(0.2126, 0.7152, 0.0722);
    var color = vec3f(0.0);
    var moment = 0.0;
    var sum = 0.0;
    var squares = 0.0;
    var used = 0u;
    for (var i = 0u; i < count; i++) {
        let at = vec2i(own) + vec2i(floor(spatial_reconstruct_offset(i, turn) + 0.5));
        if any(at < vec2i(0)) || any(at >= vec2i(size)) {
            continue;
        }
        let hit = spatial_reconstruct_read_hit(vec2u(at));
        let f = spatial_reconstruct_weight(pixel, vec2u(at), hit);
        if f <= 0.0 || hit.pdf <= 0.0 {
            continue;
        }
        let w = f / hit.pdf;
        color += w * hit.radiance;
        moment += w * dot(hit.radiance * hit.radiance, luma);
        sum += w;
        squares += w * w;
        used++;
    }
    if used == 0u {
        let centre = spatial_reconstruct_read_hit(own).radiance;
        return SpatialReconstruction(centre, dot(centre * centre, luma), 0.0);
    }
    color /= sum;
    if used == 1u {
        return SpatialReconstruction(color, dot(color * color, luma), 1.0);
    }
    let variance = max(moment / sum - dot(color * color, luma), 0.0);
    return SpatialReconstruction(
        color, variance * squares / (sum * sum - squares), sum * sum / squares,
    );
}
";
    fn plain(pixel: UVec2, size: UVec2, count: u32, turn: f32) -> SpatialReconstruction {
        let luma = Vec3::new(0.2126, 0.7152, 0.0722);
        let own = (pixel / 2).min(size.saturating_sub(UVec2::ONE));
        let (mut color, mut moment, mut sum, mut squares) = (Vec3::ZERO, 0.0, 0.0, 0.0);
        let mut used = 0;
        for i in 0..count.min(16) {
            let step = (spatial_reconstruct_offset(i, turn) + 0.5)
                .floor()
                .as_ivec2();
            let at = own.as_ivec2() + step;
            if at.min_element() < 0 || at.cmpge(size.as_ivec2()).any() {
                continue;
            }
            let hit = read_hit(at.as_uvec2());
            let f = weight(pixel, at.as_uvec2(), hit);
            if f <= 0.0 || hit.pdf <= 0.0 {
                continue;
            }
            let w = f / hit.pdf;
            color += w * hit.radiance;
            moment += w * (hit.radiance * hit.radiance).dot(luma);
            sum += w;
            squares += w * w;
            used += 1;
        }
        let lone = |color: Vec3, samples| SpatialReconstruction {
            color,
            variance: (color * color).dot(luma),
            samples,
        };
        if used == 0 {
            return lone(read_hit(own).radiance, 0.0);
        }
        color /= sum;
        if used == 1 {
            return lone(color, 1.0);
        }
        let variance = (moment / sum - (color * color).dot(luma)).max(0.0);
        SpatialReconstruction {
            color,
            variance: variance * squares / (sum * sum - squares),
            samples: sum * sum / squares,
        }
    }
    type WideState = (DVec3, f64, f64, f64, f64);
    type WideResult = (DVec3, f64, f64);

    fn exact_ratio(weight: f64, pdf: f64) -> f64 {
        if weight <= 0.0 || pdf <= 0.0 || weight / pdf < 1e-9 {
            0.0
        } else {
            (weight / pdf).min(1e9)
        }
    }
    // The gathered hits, and whether the choice of neighbours is open.
    fn gather(pixel: UVec2, size: UVec2, count: u32, turn: f64) -> (Vec<(f64, DVec3)>, bool) {
        let own = (pixel / 2).min(size - 1);
        let (mut hits, mut open) = (Vec::new(), false);
        for i in 0..count.clamp(1, 16) {
            let offset = exact_spiral(i, f64::from(i).sqrt(), turn);
            let (at, near) = exact_neighbour(own, size, offset);
            open |= near;
            let Some(at) = at else { continue };
            let hit = read_hit(at);
            let apart = hit.position.truncate().as_dvec2() - pixel.as_dvec2() / 16.0;
            let w = exact_ratio((1.0 - apart.length_squared()).max(0.0), hit.pdf.into());
            if w > 0.0 {
                hits.push((w, hit.radiance.as_dvec3()));
            }
        }
        (hits, open)
    }
    // Two passes and plain sums, where the kernel goes hit by hit.
    fn exact_pixel(pixel: UVec2, size: UVec2, count: u32, turn: f64) -> WideResult {
        if size.min_element() == 0 {
            return (DVec3::ZERO, 0.0, 0.0);
        }
        let (hits, _) = gather(pixel, size, count, turn);
        if hits.is_empty() {
            let own = read_hit((pixel / 2).min(size - 1)).radiance.as_dvec3();
            return (own, exact_square(own), 0.0);
        }
        let sum: f64 = hits.iter().map(|h| h.0).sum();
        let squares: f64 = hits.iter().map(|h| h.0 * h.0).sum();
        let mean = hits.iter().map(|h| h.1 * h.0).sum::<DVec3>() / sum;
        let samples = sum * sum / squares;
        if hits.len() == 1 {
            return (mean, exact_square(mean), 1.0);
        }
        let spread: f64 = hits.iter().map(|h| h.0 * exact_square(h.1 - mean)).sum();
        // Reliability weights: unbiased sample variance, then that of a mean.
        let unbiased = spread / (sum - squares / sum);
        (mean, unbiased / samples, samples)
    }

    let radiance = || {
        let dark = domains::below(16).map(|k| if k == 0 { 0.0f32 } else { 1.0 });
        domains::vec3(domains::log_range(1e-4, 1e4))
            .and(dark)
            .map(|(c, on)| c * on)
    };
    let weight_and_pdf = || domains::log_range(1e-5, 1e5).and(domains::log_range(1e-4, 1e4));
    // States that adding leads to: none to four hits.
    let state = || {
        let hit = || weight_and_pdf().and(radiance());
        let four = hit().and(hit()).and(hit()).and(hit());
        domains::below(5).and(four).map(|(n, (((a, b), c), d))| {
            [a, b, c, d].into_iter().take(n as usize).fold(
                SPATIAL_RECONSTRUCT_EMPTY,
                |state, ((weight, pdf), radiance)| {
                    spatial_reconstruct_add(state, weight, pdf, radiance)
                },
            )
        })
    };
    let surfaces = domains::unit_vector()
        .and(domains::vec3(domains::range(-0.3, 0.3)))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::log_range(0.02, 2.0))
        .map(|(((n, tilt), offset), reach)| {
            let other = (n.as_dvec3() + tilt.as_dvec3()).normalize().as_vec3();
            (n, other, offset, reach)
        });
    let pixels: Domain<(UVec2, UVec2, u32, f32)> = domains::below(16)
        .and(domains::below(16))
        .and(domains::below(4))
        .and(domains::unit())
        .map(|(((x, y), kind), turn)| {
            let count = [1, 4, 8, 16][kind as usize];
            (UVec2::new(x, y), UVec2::new(8, 7), count, turn)
        });
    let of = |color: Vec3, weights: &[f32]| {
        weights
            .iter()
            .enumerate()
            .fold(SPATIAL_RECONSTRUCT_EMPTY, |s, (i, w)| {
                spatial_reconstruct_add(s, *w, 1.0, color * (1.0 + i as f32))
            })
    };
    let constant = spatial_reconstruct_add(of(Vec3::ONE, &[1.0]), 1e-6, 1.0, Vec3::ONE);

    vec![
        Kernel::new(
            MODULE,
            "spatial_reconstruct_offset",
            ["index", "turn"],
            spatial_reconstruct_offset,
            |index: u32, turn: f64| exact_spiral(index, f64::from(index).sqrt(), turn),
            (domains::below(64), domains::unit()),
        )
        // A place in the plane: absolute, in units of its distance.
        .scale_by(|index: u32, _: f64| f64::from(index).sqrt().max(1.0))
        .few_ulp(13.0, 18.0)
        .hard([(0, 0.0), (0, 0.5), (1, 0.0), (15, 0.99999994), (63, 0.25)])
        .fixture(FIXTURE, vec![0])
        .source("Vogel 1979")
        .build(),
        Kernel::new(
            MODULE,
            "spatial_reconstruct_edge",
            ["normal", "other_normal", "offset", "reach"],
            spatial_reconstruct_edge,
            |n: DVec3, other: DVec3, offset: DVec3, reach: f64| {
                n.dot(other).clamp(0.0, 1.0).powi(8) * (1.0 - n.dot(offset).abs() / reach).max(0.0)
            },
            surfaces,
        )
        .scale_by(|_: DVec3, _: DVec3, offset: DVec3, reach: f64| 1.0 + offset.length() / reach)
        .few_ulp(7.0, 14.0)
        .hard([
            (Vec3::Z, Vec3::Z, Vec3::ZERO, 1.0),
            (Vec3::Z, -Vec3::Z, Vec3::X, 1.0),
            (Vec3::Z, Vec3::Z, Vec3::Z, 1.0),
            (Vec3::Z, Vec3::X, Vec3::ZERO, 1e-20),
            (Vec3::Z, Vec3::Z, Vec3::new(1.0, 1.0, 0.0), 1e-6),
        ])
        .fixture(FIXTURE, vec![0])
        .source("cosine power and plane distance; our form")
        .build(),
        Kernel::new(
            MODULE,
            "spatial_reconstruct_usable",
            ["weight", "pdf", "radiance"],
            spatial_reconstruct_usable,
            |weight: f64, pdf: f64, radiance: DVec3| {
                let channels = radiance.to_array();
                let sound = channels.into_iter().all(|c| c.abs() < 2f64.powi(60));
                u32::from(weight.is_finite() && pdf.is_finite() && sound)
            },
            {
                let number = |broken| {
                    domains::signed_log_range(1e-5, 1e5)
                        .and(domains::below(64))
                        .map(move |(x, kind)| match kind {
                            0 => f32::NAN,
                            1 => f32::INFINITY,
                            2 => broken,
                            _ => x,
                        })
                };
                (number(1.0), number(-1.0), domains::vec3(number(-2e18)))
            },
        )
        .bit_exact()
        .by_analysis(
            "WGSL defines no f32 parameter that holds a NaN, so no table covers this \
             signature; the test itself is on bits and exact",
        )
        .hard([
            (0.0, 0.0, Vec3::ZERO),
            (f32::NAN, 1.0, Vec3::ONE),
            (1.0, f32::NEG_INFINITY, Vec3::ONE),
            (
                f32::MAX,
                f32::MAX,
                Vec3::new(1.152_921_4e18, -1.152_921_4e18, 0.0),
            ),
            (1.0, 1.0, Vec3::new(0.0, 0.0, 1_152_921_504_606_846_976.0)),
            (1.0, 1.0, Vec3::splat(f32::from_bits(0x7f80_0001))),
        ])
        .fixture(FIXTURE, vec![0])
        .source("ours: by bit pattern")
        .build(),
        Kernel::new(
            MODULE,
            "spatial_reconstruct_ratio",
            ["weight", "pdf"],
            spatial_reconstruct_ratio,
            exact_ratio,
            (
                domains::signed_log_range(1e-8, 1e8),
                domains::signed_log_range(1e-6, 1e6),
            ),
        )
        .undecided(|weight: f64, pdf: f64| (weight / pdf / 1e-9 - 1.0).abs() < 1e-6)
        .few_ulp(0.5, 2.75)
        .hard([
            (0.0, 1.0),
            (1.0, 0.0),
            (0.0, 0.0),
            (1.0, 1e-30),
            (1e-30, 1.0),
            (1e30, 1e-30),
            (1e-30, 1e20),
            (-1.0, 1.0),
            (1.0, -1.0),
            // The smallest normal number; smaller ones may be flushed.
            (f32::MIN_POSITIVE, f32::MIN_POSITIVE),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "spatial_reconstruct_add",
            ["state", "weight", "pdf", "radiance"],
            spatial_reconstruct_add,
            |(mean, sum, squares, pairs, spread): WideState, weight: f64, pdf: f64, c: DVec3| {
                let w = exact_ratio(weight, pdf);
                if w == 0.0 {
                    return (mean, sum, squares, pairs, spread);
                }
                // From the new mean: what both sides are away from it.
                let step = (c - mean) * (w / (sum + w));
                let rest = (c - mean) * (sum / (sum + w));
                let away = sum * exact_square(step) + w * exact_square(rest);
                let new = (mean * sum + c * w) / (sum + w);
                (
                    new,
                    sum + w,
                    squares + w * w,
                    pairs + sum * w,
                    spread + away,
                )
            },
            state()
                .and(weight_and_pdf())
                .and(radiance())
                .map(|((state, (weight, pdf)), c)| (state, weight, pdf, c)),
        )
        .undecided(|_: WideState, weight: f64, pdf: f64, _: DVec3| {
            (weight / pdf / 1e-9 - 1.0).abs() < 1e-6
        })
        .few_ulp(6.5, 23.0)
        .hard([
            (SPATIAL_RECONSTRUCT_EMPTY, 0.0, 0.0, Vec3::ONE),
            (SPATIAL_RECONSTRUCT_EMPTY, 1.0, 3.0, Vec3::splat(0.1)),
            (of(Vec3::splat(0.1), &[1.0]), 0.7, 3.0, Vec3::splat(0.1)),
            (of(Vec3::ONE, &[1.0]), 1.0, 0.0, Vec3::splat(1e4)),
            (
                of(Vec3::splat(1e4), &[1e9]),
                1e-9,
                1.0,
                Vec3::splat(10000.001),
            ),
            (of(Vec3::ZERO, &[1.0]), 1.0, 1.0, Vec3::ZERO),
            (of(Vec3::X, &[1.0, 2.0]), 1e30, 1e-5, Vec3::Z * 1e8),
            (of(Vec3::ZERO, &[1e-9]), 1e9, 1.0, Vec3::splat(1e4)),
        ])
        .fixture(FIXTURE, vec![0])
        .source(MOMENTS)
        .build(),
        Kernel::new(
            MODULE,
            "spatial_reconstruct_finish",
            ["state", "centre"],
            spatial_reconstruct_finish,
            |(mean, sum, squares, pairs, spread): WideState, centre: DVec3| {
                if sum == 0.0 {
                    (centre, exact_square(centre), 0.0)
                } else if pairs == 0.0 {
                    (mean, exact_square(mean), 1.0)
                } else {
                    let samples = sum * sum / squares;
                    (
                        mean,
                        spread * squares / (2.0 * sum * pairs),
                        samples.max(1.0),
                    )
                }
            },
            (state(), radiance()),
        )
        .few_ulp(3.0, 8.5)
        .hard([
            (SPATIAL_RECONSTRUCT_EMPTY, Vec3::splat(1e4)),
            (SPATIAL_RECONSTRUCT_EMPTY, Vec3::ZERO),
            (of(Vec3::ONE, &[2.0]), Vec3::ZERO),
            (of(Vec3::ZERO, &[1.0, 1.0]), Vec3::ONE),
            (of(Vec3::splat(1e4), &[1e9, 1e-9]), Vec3::ONE),
            (of(Vec3::splat(1e4), &[1e-9, 1e-9, 1e-9]), Vec3::ONE),
            (constant, Vec3::ZERO),
        ])
        .fixture(FIXTURE, vec![0])
        .source(MOMENTS)
        .build(),
        Kernel::new(
            MODULE,
            "spatial_reconstruct_pixel",
            ["pixel", "size", "count", "turn"],
            pixel,
            exact_pixel,
            pixels,
        )
        // Radiance is in [0, 1) here; a variance is made of differences of it.
        .scale(1.0)
        .undecided(|pixel: UVec2, size: UVec2, count: u32, turn: f64| {
            size.min_element() > 0 && gather(pixel, size, count, turn).1
        })
        .few_ulp(9.0, 56.0)
        .hard([
            // No pixels; only pixels without a ray; one pixel.
            (UVec2::ZERO, UVec2::ZERO, 16, 0.0),
            (UVec2::new(5, 5), UVec2::new(0, 8), 16, 0.0),
            (UVec2::new(1, 2), UVec2::new(2, 2), 16, 0.3),
            (UVec2::ZERO, UVec2::ONE, 16, 0.7),
            (UVec2::new(8, 8), UVec2::new(8, 8), 1, 0.1),
            // Beyond the image, and beyond the count.
            (UVec2::splat(0xffff_ffff), UVec2::new(8, 8), 8, 0.3),
            (UVec2::new(7, 9), UVec2::new(8, 8), 0xffff_ffff, 0.3),
            (UVec2::new(7, 9), UVec2::new(8, 8), 0, 0.3),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .baseline("plain sums, variance as E[x^2] - E[x]^2", PLAIN_WGSL, plain)
        .build(),
    ]
}
