//! Firefly filters: the pair and its contract.

pub use raytwin_cpu::filter::firefly::*;

/// The WGSL twin, without what it requires and without its callback.
pub const WGSL: &str = raytwin_wgsl::filter::FIREFLY;

#[cfg(feature = "contract")]
use glam::{DVec3, UVec2, Vec3};

#[cfg(feature = "contract")]
crate::value_struct!(FireflyRange {
    low: Vec3,
    high: Vec3,
    count: u32,
});

#[cfg(feature = "contract")]
crate::value_struct!(FireflyStats {
    mean: Vec3,
    spread: Vec3,
    count: u32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};

    const MODULE: &str = "filter/firefly";
    const CAP: &str = "Ray Tracing Gems, ch. 25 (cap by the neighbours)";
    const RANK: &str = "Hardie and Barner 1994 (rank conditioned)";
    const MOMENTS: &str = "West 1979; mean and standard deviations, no percentile";
    // The image from a hash of the place, in exact fractions: values below one,
    // now and then a firefly, a negative pixel or one beyond the largest.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u, lane: u32) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn firefly_read(at: vec2u) -> vec3f {
    let red = f32(raytwin_hash(at, 1u)) * 0.00390625;
    let green = f32(raytwin_hash(at, 2u)) * 0.00390625;
    let blue = f32(raytwin_hash(at, 3u)) * 0.00390625;
    let kind = raytwin_hash(at, 4u);
    if at.x > 12u {
        return vec3f(0.3, 0.1, 0.7);
    }
    if kind < 12u {
        return vec3f(red * 64.0, green * 64.0, blue * 64.0);
    }
    if kind < 18u {
        return vec3f(red, -1.0, blue);
    }
    if at.y == 14u && kind < 40u {
        return vec3f(red, 1e30, blue);
    }
    return vec3f(red, green, blue);
}
";
    fn read(at: UVec2) -> Vec3 {
        let hash = |lane: u32| {
            let mut h = at.x.wrapping_mul(0x9e37_79b9)
                ^ at.y.wrapping_mul(0x85eb_ca6b)
                ^ lane.wrapping_mul(0xc2b2_ae35);
            h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
            h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
            (h ^ (h >> 16)) & 255
        };
        let lane = |i: u32| hash(i) as f32 * 0.00390625;
        let color = Vec3::new(lane(1), lane(2), lane(3));
        let kind = hash(4);
        if at.x > 12 {
            Vec3::new(0.3, 0.1, 0.7)
        } else if kind < 12 {
            color * 64.0
        } else if kind < 18 {
            Vec3::new(color.x, -1.0, color.z)
        } else if at.y == 14 && kind < 40 {
            Vec3::new(color.x, 1e30, color.z)
        } else {
            color
        }
    }
    fn range(pixel: UVec2, size: UVec2) -> FireflyRange {
        firefly_range(pixel, size, read)
    }
    fn stats(pixel: UVec2, size: UVec2) -> FireflyStats {
        firefly_stats(pixel, size, read)
    }
    fn cap_pixel(pixel: UVec2, size: UVec2) -> Vec3 {
        firefly_cap_pixel(pixel, size, read)
    }
    fn rank_pixel(pixel: UVec2, size: UVec2) -> Vec3 {
        firefly_rank_pixel(pixel, size, read)
    }
    fn clamp_pixel(pixel: UVec2, size: UVec2, gamma: f32) -> Vec3 {
        firefly_clamp_pixel(pixel, size, gamma, read)
    }

    type WideRange = (DVec3, DVec3, u32);
    type WideStats = (DVec3, DVec3, u32);
    // A pixel's usable colour, if it has one.
    fn usable(x: i64, y: i64) -> Option<DVec3> {
        let c = read(UVec2::new(x as u32, y as u32)).as_dvec3();
        (c.min_element() >= 0.0).then(|| c.min(DVec3::splat(1e8)))
    }
    fn neighbours(pixel: UVec2, size: UVec2, reach: i64) -> Vec<DVec3> {
        let (p, s) = (pixel.as_i64vec2(), size.as_i64vec2());
        if p.cmpge(s).any() {
            return Vec::new();
        }
        let mut found = Vec::new();
        for y in (p.y - reach).max(0)..(p.y + reach + 1).min(s.y) {
            for x in (p.x - reach).max(0)..(p.x + reach + 1).min(s.x) {
                if (x, y) != (p.x, p.y) {
                    found.extend(usable(x, y));
                }
            }
        }
        found
    }
    fn exact_range(pixel: UVec2, size: UVec2) -> WideRange {
        let all = neighbours(pixel, size, 1);
        let low = all.iter().copied().fold(DVec3::splat(1e8), DVec3::min);
        let high = all.iter().copied().fold(DVec3::ZERO, DVec3::max);
        (low, high, all.len() as u32)
    }
    // Two passes, where the kernel goes neighbour by neighbour.
    fn exact_stats(pixel: UVec2, size: UVec2) -> WideStats {
        let all = neighbours(pixel, size, 2);
        let n = all.len().max(1) as f64;
        let mean = all.iter().sum::<DVec3>() / n;
        let spread = all.iter().map(|c| (*c - mean) * (*c - mean)).sum();
        (mean, spread, all.len() as u32)
    }
    fn exact_limit((mean, spread, count): WideStats, gamma: f64) -> DVec3 {
        if count == 0 {
            DVec3::splat(1e8)
        } else {
            mean + gamma * (spread / f64::from(count)).map(f64::sqrt)
        }
    }
    fn exact_capped(pixel: UVec2, size: UVec2, ranked: bool) -> DVec3 {
        if pixel.cmpge(size).any() {
            return DVec3::ZERO;
        }
        let (low, high, count) = exact_range(pixel, size);
        match usable(pixel.x.into(), pixel.y.into()) {
            None if count == 0 => DVec3::ZERO,
            None => low,
            Some(c) if count == 0 => c,
            Some(c) if ranked => c.clamp(low, high),
            Some(c) => c.min(high),
        }
    }
    fn exact_clamped(pixel: UVec2, size: UVec2, gamma: f64) -> DVec3 {
        if pixel.cmpge(size).any() {
            return DVec3::ZERO;
        }
        let stats = exact_stats(pixel, size);
        match usable(pixel.x.into(), pixel.y.into()) {
            None => stats.0,
            Some(c) => c.min(exact_limit(stats, gamma)),
        }
    }
    // The largest number that enters a pixel's statistics.
    fn largest(pixel: UVec2, size: UVec2) -> f64 {
        neighbours(pixel, size, 2)
            .iter()
            .map(|c| c.max_element())
            .fold(1.0, f64::max)
    }

    let colors = || {
        let dark = domains::below(8).map(|k| if k == 0 { 0.0f32 } else { 1.0 });
        domains::vec3(domains::log_range(1e-4, 1e4))
            .and(dark)
            .map(|(c, on)| c * on)
    };
    let ranges = || {
        colors()
            .and(colors())
            .and(domains::below(9))
            .map(|((a, b), count)| {
                if count == 0 {
                    FIREFLY_RANGE_EMPTY
                } else {
                    FireflyRange {
                        low: a.min(b),
                        high: a.max(b),
                        count,
                    }
                }
            })
    };
    let statistics = || {
        let four = colors().and(colors()).and(colors()).and(colors());
        domains::below(5).and(four).map(|(n, (((a, b), c), d))| {
            [a, b, c, d]
                .into_iter()
                .take(n as usize)
                .fold(FIREFLY_STATS_EMPTY, firefly_stats_add)
        })
    };
    let of = |colors: &[Vec3]| {
        colors
            .iter()
            .copied()
            .fold(FIREFLY_STATS_EMPTY, firefly_stats_add)
    };
    let pixels = || -> Domain<(UVec2, UVec2)> {
        domains::below(17)
            .and(domains::below(17))
            .map(|(x, y)| (UVec2::new(x, y), UVec2::new(16, 16)))
    };
    let edges = [
        (UVec2::ZERO, UVec2::ZERO),
        (UVec2::ZERO, UVec2::ONE),
        (UVec2::new(0, 3), UVec2::new(1, 5)),
        (UVec2::new(3, 0), UVec2::new(5, 1)),
        (UVec2::ZERO, UVec2::splat(16)),
        (UVec2::splat(15), UVec2::splat(16)),
        (UVec2::splat(16), UVec2::splat(16)),
        (UVec2::MAX, UVec2::splat(16)),
        // A constant image.
        (UVec2::splat(40), UVec2::splat(64)),
        (UVec2::new(13, 40), UVec2::splat(64)),
        // One pixel of its own, negative: found below.
        (negative(), negative() + 1),
        (negative(), UVec2::splat(16)),
    ];
    fn negative() -> UVec2 {
        (0..256)
            .map(|i| UVec2::new(i % 13, i / 13))
            .find(|at| read(*at).y < 0.0)
            .expect("the image has a negative pixel")
    }
    let tops = [
        (Vec3::ZERO, FIREFLY_RANGE_EMPTY),
        (Vec3::splat(1e8), FIREFLY_RANGE_EMPTY),
        (
            Vec3::splat(1e8),
            FireflyRange {
                low: Vec3::ZERO,
                high: Vec3::ZERO,
                count: 8,
            },
        ),
        (
            Vec3::new(0.0, 1.0, 2.0),
            FireflyRange {
                low: Vec3::ONE,
                high: Vec3::ONE,
                count: 1,
            },
        ),
    ];

    vec![
        Kernel::new(
            MODULE,
            "firefly_range_add",
            ["range", "color"],
            firefly_range_add,
            |(low, high, count): WideRange, c: DVec3| (low.min(c), high.max(c), count + 1),
            (ranges(), colors()),
        )
        .bit_exact()
        .hard([
            (FIREFLY_RANGE_EMPTY, Vec3::ZERO),
            (FIREFLY_RANGE_EMPTY, Vec3::splat(1e8)),
            (FIREFLY_RANGE_EMPTY, Vec3::new(1.0, 0.0, 1e8)),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CAP)
        .build(),
        Kernel::new(
            MODULE,
            "firefly_cap",
            ["color", "range"],
            firefly_cap,
            |c: DVec3, (_, high, count): WideRange| if count == 0 { c } else { c.min(high) },
            (colors(), ranges()),
        )
        .bit_exact()
        .hard(tops)
        .fixture(FIXTURE, vec![0])
        .source(CAP)
        .build(),
        Kernel::new(
            MODULE,
            "firefly_rank",
            ["color", "range"],
            firefly_rank,
            |c: DVec3, (low, high, count): WideRange| {
                if count == 0 { c } else { c.clamp(low, high) }
            },
            (colors(), ranges()),
        )
        .bit_exact()
        .hard(tops)
        .fixture(FIXTURE, vec![0])
        .source(RANK)
        .build(),
        Kernel::new(
            MODULE,
            "firefly_stats_add",
            ["stats", "color"],
            firefly_stats_add,
            |(mean, spread, count): WideStats, c: DVec3| {
                let n = f64::from(count);
                // From the new mean: what both sides are away from it.
                let new = (mean * n + c) / (n + 1.0);
                let away = (mean - new) * (mean - new) * n + (c - new) * (c - new);
                (new, spread + away, count + 1)
            },
            (statistics(), colors()),
        )
        .few_ulp(3.75, 10.0)
        .hard([
            (FIREFLY_STATS_EMPTY, Vec3::ZERO),
            (FIREFLY_STATS_EMPTY, Vec3::splat(1e8)),
            (of(&[Vec3::splat(0.1); 2]), Vec3::splat(0.1)),
            (of(&[Vec3::splat(1e8); 3]), Vec3::ZERO),
            (of(&[Vec3::ZERO; 4]), Vec3::splat(1e8)),
            (of(&[Vec3::splat(1e4); 4]), Vec3::splat(10000.001)),
        ])
        .fixture(FIXTURE, vec![0])
        .source(MOMENTS)
        .build(),
        Kernel::new(
            MODULE,
            "firefly_limit",
            ["stats", "gamma"],
            firefly_limit,
            exact_limit,
            (statistics(), domains::range(0.0, 8.0)),
        )
        .few_ulp(2.25, 9.5)
        .hard([
            (FIREFLY_STATS_EMPTY, 0.0),
            (FIREFLY_STATS_EMPTY, 4.0),
            (of(&[Vec3::splat(0.1); 3]), 4.0),
            (of(&[Vec3::ZERO; 3]), 4.0),
            (of(&[Vec3::splat(1e8), Vec3::ZERO]), 8.0),
            (of(&[Vec3::splat(1e8), Vec3::ZERO]), 0.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(MOMENTS)
        .build(),
        Kernel::new(
            MODULE,
            "firefly_range",
            ["pixel", "size"],
            range,
            exact_range,
            pixels(),
        )
        .bit_exact()
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(CAP)
        .build(),
        Kernel::new(
            MODULE,
            "firefly_stats",
            ["pixel", "size"],
            stats,
            exact_stats,
            pixels(),
        )
        // The spread is made of differences of the values, squared.
        .scale_by(|pixel: UVec2, size: UVec2| largest(pixel, size).powi(2))
        .few_ulp(4.0, 92.0)
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(MOMENTS)
        .build(),
        Kernel::new(
            MODULE,
            "firefly_cap_pixel",
            ["pixel", "size"],
            cap_pixel,
            |pixel: UVec2, size: UVec2| exact_capped(pixel, size, false),
            pixels(),
        )
        .bit_exact()
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(CAP)
        .build(),
        Kernel::new(
            MODULE,
            "firefly_rank_pixel",
            ["pixel", "size"],
            rank_pixel,
            |pixel: UVec2, size: UVec2| exact_capped(pixel, size, true),
            pixels(),
        )
        .bit_exact()
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(RANK)
        .build(),
        Kernel::new(
            MODULE,
            "firefly_clamp_pixel",
            ["pixel", "size", "gamma"],
            clamp_pixel,
            exact_clamped,
            pixels()
                .and(domains::range(0.0, 4.0))
                .map(|((pixel, size), gamma)| (pixel, size, gamma)),
        )
        // The mean and the deviation are made of all neighbours, the pixel
        // itself may be small beside them.
        .scale_by(|pixel: UVec2, size: UVec2, _: f64| largest(pixel, size))
        .few_ulp(2.25, 52.0)
        .hard(edges.map(|(pixel, size)| (pixel, size, 2.0)))
        .fixture(FIXTURE, vec![0])
        .source(MOMENTS)
        .build(),
    ]
}
