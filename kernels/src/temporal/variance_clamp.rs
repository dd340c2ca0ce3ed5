//! Variance clamp: the pair and its contract.

pub use raytwin_cpu::temporal::variance_clamp::*;

/// The WGSL twin, without its callback.
pub const WGSL: &str = raytwin_wgsl::temporal::VARIANCE_CLAMP;

#[cfg(feature = "contract")]
use glam::{DMat3, DVec3, UVec2, Vec3};

#[cfg(feature = "contract")]
crate::value_struct!(VarianceClampMoments {
    mean: Vec3,
    spread: Vec3,
    low: Vec3,
    high: Vec3,
    count: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(VarianceClampBox {
    low: Vec3,
    high: Vec3,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};

    const MODULE: &str = "temporal/variance_clamp";
    const SOURCE: &str = "Karis 2014; Salvi 2016";
    const SIZE: UVec2 = UVec2::new(16, 12);
    // The image from a hash of the place, in exact fractions, so that interval
    // arithmetic sees the whole kernel: noise, a constant strip, a grey one,
    // and pixels that are no colours.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u, lane: u32) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn variance_clamp_read(at: vec2u) -> vec3f {
    let red = f32(raytwin_hash(at, 4u)) * 0.00390625;
    let green = f32(raytwin_hash(at, 5u)) * 0.00390625;
    let blue = f32(raytwin_hash(at, 6u)) * 0.00390625;
    if at.x > 9u {
        return vec3f(0.7, 0.3, 0.1);
    }
    if raytwin_hash(at, 1u) < 16u || (at.x < 2u && at.y < 2u) {
        return vec3f(red, 1e30, blue);
    }
    if at.y > 8u {
        return vec3f(red, red, red);
    }
    return vec3f(red, green, blue);
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
    fn read(at: UVec2) -> Vec3 {
        let lane = |i: u32| hash(at, i) as f32 * 0.00390625;
        if at.x > 9 {
            return Vec3::new(0.7, 0.3, 0.1);
        }
        if hash(at, 1) < 16 || (at.x < 2 && at.y < 2) {
            return Vec3::new(lane(4), 1e30, lane(6));
        }
        if at.y > 8 {
            return Vec3::splat(lane(4));
        }
        Vec3::new(lane(4), lane(5), lane(6))
    }
    fn pixel(pixel: UVec2, size: UVec2, radius: u32, history: Vec3, gamma: f32, mode: u32) -> Vec3 {
        variance_clamp_pixel(pixel, size, radius, history, gamma, mode, read)
    }
    // The usual form beside it: moments as plain sums, all else the same.
    const PLAIN_WGSL: &str = "
fn baseline(
    pixel: vec2u, size: vec2u, radius: u32, history: vec3f, gamma: f32, mode: u32,
) -> vec3f {
    var m = VARIANCE_CLAMP_EMPTY;
    var sum = vec3f(0.0);
    var squares = vec3f(0.0);
    let r = i32(radius);
    for (var dy = -r; dy <= r; dy++) {
        for (var dx = -r; dx <= r; dx++) {
            let at = vec2i(pixel) + vec2i(dx, dy);
            if any(at < vec2i(0)) || any(at >= vec2i(size)) {
                continue;
            }
            let color = variance_clamp_read(vec2u(at));
            if any(abs(color) > vec3f(1e15)) {
                continue;
            }
            let place = variance_clamp_axes(color, mode);
            m.low = select(min(m.low, place), place, m.count == 0.0);
            m.high = select(max(m.high, place), place, m.count == 0.0);
            m.count += 1.0;
            sum += color;
            squares += place * place;
        }
    }
    if m.count == 0.0 {
        return history;
    }
    m.mean = sum / m.count;
    let middle = variance_clamp_axes(m.mean, mode);
    m.spread = abs(squares / m.count - middle * middle) * m.count;
    return variance_clamp_limit(history, m.mean, variance_clamp_box(m, gamma, mode), mode);
}";
    fn plain(pixel: UVec2, size: UVec2, radius: u32, history: Vec3, gamma: f32, mode: u32) -> Vec3 {
        let axes = |c: Vec3| {
            if mode & VARIANCE_CLAMP_YCOCG == 0 {
                c
            } else {
                variance_clamp_ycocg(c)
            }
        };
        let mut m = VARIANCE_CLAMP_EMPTY;
        let (mut sum, mut squares) = (Vec3::ZERO, Vec3::ZERO);
        for color in taps(pixel, size, radius) {
            let place = axes(color);
            let first = m.count == 0.0;
            m.low = if first { place } else { m.low.min(place) };
            m.high = if first { place } else { m.high.max(place) };
            m.count += 1.0;
            sum += color;
            squares += place * place;
        }
        if m.count == 0.0 {
            return history;
        }
        m.mean = sum / m.count;
        let middle = axes(m.mean);
        m.spread = (squares / m.count - middle * middle).abs() * m.count;
        variance_clamp_limit(history, m.mean, variance_clamp_box(m, gamma, mode), mode)
    }
    /// The neighbourhood's usable colours.
    fn taps(pixel: UVec2, size: UVec2, radius: u32) -> Vec<Vec3> {
        let r = i64::from(radius.min(8));
        let near = |at: u32, end: u32| {
            (i64::from(at) - r..=i64::from(at) + r)
                .filter(move |i| (0..i64::from(end)).contains(i))
                .map(|i| i as u32)
        };
        near(pixel.y, size.y)
            .flat_map(|y| near(pixel.x, size.x).map(move |x| read(UVec2::new(x, y))))
            .filter(|c| c.abs().max_element() <= 1e15)
            .collect()
    }

    fn matrix(mode: u32) -> DMat3 {
        if mode & VARIANCE_CLAMP_YCOCG == 0 {
            return DMat3::IDENTITY;
        }
        let rows = [[0.25, 0.5, 0.25], [0.5, 0.0, -0.5], [-0.25, 0.5, -0.25]];
        DMat3::from_cols_array_2d(&rows).transpose()
    }
    fn exact_limit(history: DVec3, mean: DVec3, bounds: (DVec3, DVec3), mode: u32) -> DVec3 {
        if !history.to_array().into_iter().all(|c| c.abs() <= 1e15) {
            return mean;
        }
        let (low, high) = bounds;
        let axes = matrix(mode);
        let offset = axes * (history - mean);
        let moved = if mode & VARIANCE_CLAMP_CLIP == 0 {
            axes.inverse() * offset.clamp(low, high)
        } else {
            // The least part at which the segment meets a plane of the box.
            let least = (high - low).max_element() / 64.0;
            let parts = (0..3).filter_map(|i| {
                let side = if offset[i] > 0.0 { high[i] } else { -low[i] };
                (offset[i] != 0.0).then(|| side.max(least) / offset[i].abs())
            });
            (history - mean) * parts.fold(1.0, f64::min)
        };
        (mean + moved).clamp(history.min(mean), history.max(mean))
    }
    fn exact_pixel(
        pixel: UVec2,
        size: UVec2,
        radius: u32,
        history: DVec3,
        gamma: f64,
        mode: u32,
    ) -> DVec3 {
        if pixel.cmpge(size).any() {
            return DVec3::ZERO;
        }
        let colors: Vec<DVec3> = taps(pixel, size, radius)
            .into_iter()
            .map(|c| c.as_dvec3())
            .collect();
        if colors.is_empty() {
            return history;
        }
        // Two passes: the mean first, then the distances from it.
        let n = colors.len() as f64;
        let mean = colors.iter().sum::<DVec3>() / n;
        let axes = matrix(mode);
        let along: Vec<DVec3> = colors.iter().map(|c| axes * (*c - mean)).collect();
        let deviation = (along.iter().map(|d| d * d).sum::<DVec3>() / n)
            .to_array()
            .map(f64::sqrt);
        let reach = DVec3::from_array(deviation) * gamma;
        let low = along.iter().fold(DVec3::ZERO, |m, d| m.min(*d)).max(-reach);
        let high = along.iter().fold(DVec3::ZERO, |m, d| m.max(*d)).min(reach);
        exact_limit(history, mean, (low, high), mode)
    }

    let unit_color = || domains::vec3(domains::range(0.0, 1.0));
    let mode = || domains::below(4);
    let moments = || -> Domain<VarianceClampMoments> {
        unit_color()
            .and(domains::vec3(domains::range(0.0, 6.0)))
            .and(unit_color())
            .and(unit_color())
            .and(domains::below(26))
            .map(
                |((((mean, spread), down), up), count)| VarianceClampMoments {
                    mean,
                    spread: spread * (count as f32 / 25.0),
                    low: mean - down,
                    high: mean + up,
                    count: count as f32,
                },
            )
    };
    // Sides from nothing to the whole range; one in four has no extent.
    let side = || {
        domains::log_range(1e-4, 1.0)
            .and(domains::below(4))
            .map(|(x, kind)| if kind == 0 { 0.0 } else { x })
    };
    let bounds = domains::vec3(side())
        .and(domains::vec3(side()))
        .map(|(low, high)| VarianceClampBox { low: -low, high });
    // Half of the histories where the thinnest side decides.
    let limits = unit_color()
        .and(unit_color())
        .and(bounds)
        .and(domains::log_range(1e-4, 0.1))
        .and(mode())
        .and(domains::below(2))
        .map(|(((((history, mean), bounds), trace), mode), kind)| {
            if kind == 0 {
                return (history, mean, bounds, mode);
            }
            // A grey box of height one half, and a colour just too strong for it.
            let widest = 0.5 + 0.5 * bounds.high.x;
            let grey = VarianceClampBox {
                low: Vec3::new(-0.5, 0.0, 0.0),
                high: Vec3::new(widest - 0.5, 0.0, 0.0),
            };
            let luma = -0.5 + history.x * widest;
            let orange = widest * VARIANCE_CLAMP_THINNEST * (1.0 + trace);
            let away = variance_clamp_rgb(Vec3::new(luma, orange, history.y * orange));
            (mean + away, mean, grey, mode)
        });
    let box_of = |low: f32, high: f32| VarianceClampBox {
        low: Vec3::splat(low),
        high: Vec3::splat(high),
    };
    let grey_box = VarianceClampBox {
        low: Vec3::new(-0.1, 0.0, 0.0),
        high: Vec3::new(0.1, 0.0, 0.0),
    };
    let seen = |colors: &[Vec3], mode: u32| {
        colors
            .iter()
            .fold(VARIANCE_CLAMP_EMPTY, |m, c| variance_clamp_add(m, *c, mode))
    };
    let pixels = domains::below(SIZE.x)
        .and(domains::below(SIZE.y))
        .and(domains::below(8))
        .and(domains::vec3(domains::range(0.0, 1.5)))
        .and(domains::range(0.0, 2.5))
        .and(mode())
        .map(|(((((x, y), kind), history), gamma), mode)| {
            let radius = [2, 2, 2, 2, 2, 1, 1, 0][kind as usize];
            (UVec2::new(x, y), SIZE, radius, history, gamma, mode)
        });
    let bad = Vec3::new(0.1, f32::MAX, 0.2);

    vec![
        Kernel::new(
            MODULE,
            "variance_clamp_usable",
            ["color"],
            variance_clamp_usable,
            |c: DVec3| u32::from(c.to_array().into_iter().all(|c| c.abs() <= 1e15)),
            (domains::vec3(
                domains::signed_log_range(1e-5, 1e5)
                    .and(domains::below(32))
                    .map(|(x, kind)| match kind {
                        0 => f32::NAN,
                        1 => f32::INFINITY,
                        2 => -2e15,
                        _ => x,
                    }),
            ),),
        )
        .bit_exact()
        .by_analysis(
            "WGSL defines no f32 parameter that holds a NaN, so no table covers this \
             signature; the test itself is on bits and exact",
        )
        .hard(
            [
                Vec3::ZERO,
                bad,
                Vec3::new(f32::NAN, 0.0, 0.0),
                Vec3::new(0.0, 0.0, f32::NEG_INFINITY),
                Vec3::new(9e14, -9e14, 1e-30),
                Vec3::splat(f32::from_bits(0x7f80_0001)),
            ]
            .map(|c| (c,)),
        )
        .fixture(FIXTURE, vec![0])
        .source("ours: by bit pattern")
        .build(),
        Kernel::new(
            MODULE,
            "variance_clamp_ycocg",
            ["rgb"],
            variance_clamp_ycocg,
            |c: DVec3| matrix(VARIANCE_CLAMP_YCOCG) * c,
            (domains::vec3(domains::signed_log_range(1e-5, 1e5)),),
        )
        .scale_by(|c: DVec3| c.abs().max_element().max(1e-30))
        .few_ulp(1.0, 1.25)
        .hard([Vec3::ZERO, Vec3::ONE, Vec3::new(1e15, -1e15, 1e15), Vec3::Y].map(|c| (c,)))
        .fixture(FIXTURE, vec![0])
        .source("Malvar and Sullivan 2003")
        .build(),
        Kernel::new(
            MODULE,
            "variance_clamp_rgb",
            ["ycocg"],
            variance_clamp_rgb,
            |c: DVec3| matrix(VARIANCE_CLAMP_YCOCG).inverse() * c,
            (domains::vec3(domains::signed_log_range(1e-5, 1e5)),),
        )
        .scale_by(|c: DVec3| c.abs().max_element().max(1e-30))
        .few_ulp(1.5, 2.75)
        .hard([Vec3::ZERO, Vec3::ONE, Vec3::X, Vec3::new(1.0, -1.0, 1.0)].map(|c| (c,)))
        .fixture(FIXTURE, vec![0])
        .source("Malvar and Sullivan 2003")
        .build(),
        Kernel::new(
            MODULE,
            "variance_clamp_add",
            ["moments", "color", "mode"],
            variance_clamp_add,
            |(mean, spread, low, high, n): (DVec3, DVec3, DVec3, DVec3, f64),
             c: DVec3,
             mode: u32| {
                if c.abs().max_element() > 1e15 {
                    return (mean, spread, low, high, n);
                }
                let axes = matrix(mode);
                let place = axes * c;
                if n == 0.0 {
                    return (c, DVec3::ZERO, place, place, 1.0);
                }
                // Distances of both parts from the new mean.
                let step = axes * ((c - mean) / (n + 1.0));
                let rest = axes * ((c - mean) * (n / (n + 1.0)));
                (
                    (mean * n + c) / (n + 1.0),
                    spread + step * step * n + rest * rest,
                    low.min(place),
                    high.max(place),
                    n + 1.0,
                )
            },
            (moments(), unit_color(), mode()),
        )
        // Colours are in [0, 1] here; other exposures differ by a factor.
        .scale(1.0)
        .few_ulp(1.75, 3.5)
        .hard([
            (VARIANCE_CLAMP_EMPTY, Vec3::splat(0.1), 0),
            (VARIANCE_CLAMP_EMPTY, bad, 1),
            (seen(&[Vec3::splat(0.1)], 1), Vec3::splat(0.1), 1),
            (seen(&[Vec3::splat(0.1), Vec3::ONE], 1), bad, 1),
            (seen(&[Vec3::splat(0.1); 24], 0), Vec3::ONE, 0),
            (seen(&[Vec3::X, Vec3::Y], 3), Vec3::Z, 3),
        ])
        .fixture(FIXTURE, vec![0])
        .source("West 1979")
        .build(),
        Kernel::new(
            MODULE,
            "variance_clamp_box",
            ["moments", "gamma", "mode"],
            variance_clamp_box,
            |(mean, spread, low, high, n): (DVec3, DVec3, DVec3, DVec3, f64),
             gamma: f64,
             mode: u32| {
                let middle = matrix(mode) * mean;
                let variance = (spread / n.max(1.0)).to_array();
                let reach = DVec3::from_array(variance.map(f64::sqrt)) * gamma;
                (
                    (low - middle).min(DVec3::ZERO).max(-reach),
                    (high - middle).max(DVec3::ZERO).min(reach),
                )
            },
            (moments(), domains::range(0.0, 2.5), mode()),
        )
        .scale(1.0)
        .few_ulp(1.0, 5.5)
        .hard([
            (VARIANCE_CLAMP_EMPTY, 1.0, 0),
            (seen(&[Vec3::splat(0.1); 25], 1), 1.0, 1),
            (seen(&[Vec3::ZERO, Vec3::ONE], 0), 0.0, 0),
            (seen(&[Vec3::ZERO, Vec3::ONE], 2), 1e9, 2),
            (seen(&[Vec3::X, Vec3::Y, Vec3::Z], 3), 0.75, 3),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "variance_clamp_limit",
            ["history", "mean", "bounds", "mode"],
            variance_clamp_limit,
            exact_limit,
            limits,
        )
        .scale(1.0)
        .few_ulp(10.0, 22.0)
        .hard([
            (Vec3::splat(0.3), Vec3::splat(0.3), box_of(0.0, 0.0), 0),
            (Vec3::splat(0.9), Vec3::splat(0.1), box_of(0.0, 0.0), 1),
            (Vec3::splat(0.9), Vec3::splat(0.1), box_of(0.0, 0.0), 2),
            (
                Vec3::new(0.9, 0.0, 0.3),
                Vec3::splat(0.1),
                box_of(0.0, 0.0),
                3,
            ),
            (Vec3::ONE, Vec3::ZERO, box_of(-0.1, 0.1), 3),
            (Vec3::splat(0.05), Vec3::ZERO, box_of(-0.1, 0.1), 3),
            // A grey neighbourhood, a history with a trace of colour.
            (
                Vec3::new(0.55, 0.55, 0.550001),
                Vec3::splat(0.5),
                grey_box,
                1,
            ),
            (
                Vec3::new(0.55, 0.55, 0.550001),
                Vec3::splat(0.5),
                grey_box,
                3,
            ),
            (bad, Vec3::splat(0.5), box_of(-0.1, 0.1), 0),
            (bad, Vec3::splat(0.5), box_of(-0.1, 0.1), 3),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "variance_clamp_pixel",
            ["pixel", "size", "radius", "history", "gamma", "mode"],
            pixel,
            exact_pixel,
            pixels,
        )
        // Colours are in [0, 1.5] here.
        .scale(1.0)
        .few_ulp(12.0, 400.0)
        .hard([
            (UVec2::ZERO, UVec2::ZERO, 2, Vec3::ONE, 1.0, 0),
            (UVec2::splat(0xffff_ffff), SIZE, 2, Vec3::ONE, 1.0, 0),
            // No usable tap; one tap.
            (UVec2::ZERO, SIZE, 1, Vec3::ONE, 1.0, 3),
            (UVec2::new(5, 4), SIZE, 0, Vec3::ONE, 1.0, 1),
            // A constant neighbourhood, of all sizes.
            (UVec2::new(13, 5), SIZE, 2, Vec3::ONE, 1.0, 0),
            (UVec2::new(13, 5), SIZE, 2, Vec3::X, 2.0, 1),
            (UVec2::new(13, 5), SIZE, 2, Vec3::Y, 1.0, 2),
            (UVec2::new(15, 11), SIZE, 2, Vec3::Z, 1.0, 3),
            (UVec2::new(3, 5), SIZE, 2, Vec3::splat(0.5), 0.0, 3),
            (UVec2::new(3, 5), SIZE, 2, Vec3::ONE, 1e6, 0),
            // Where the thinnest side decides, and the mean's error counts 64 times.
            (
                UVec2::new(10, 11),
                SIZE,
                2,
                Vec3::new(0.8564631, 0.72125846, 0.8008791),
                2.2425559,
                3,
            ),
            (
                UVec2::new(11, 2),
                SIZE,
                2,
                Vec3::new(0.0, 0.41062298, 1.3221729),
                1.0921551,
                3,
            ),
            (UVec2::new(3, 11), SIZE, 2, Vec3::new(0.9, 0.8, 0.9), 1.0, 3),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .baseline(
            "plain sums, sigma as sqrt |E[x^2] - E[x]^2|",
            PLAIN_WGSL,
            plain,
        )
        .build(),
    ]
}
