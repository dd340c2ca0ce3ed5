//! Packed visibility: the pair and its contract.

pub use raytwin_cpu::filter::packed_visibility::*;

/// The WGSL twin, without its callbacks.
pub const WGSL: &str = raytwin_wgsl::filter::PACKED_VISIBILITY;

#[cfg(feature = "contract")]
crate::value_struct!(PackedVisibilityRays { visible: [u32; 32] });

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};
    use glam::UVec2;

    const MODULE: &str = "filter/packed_visibility";
    const SOURCE: &str = "FidelityFX Denoiser 1.x (blocks of 8 x 4, 17 x 17 mean)";
    const OURS: &str = "counting by masks; our form";
    // Words from a hash of the block: noise, all lit, all dark. Bits beyond the
    // image are as random as the others.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return h ^ (h >> 16u);
}
fn packed_visibility_read(block: vec2u) -> u32 {
    let word = raytwin_hash(block);
    if word % 5u == 0u {
        return 0xffffffffu;
    }
    if word % 5u == 1u {
        return 0u;
    }
    return word;
}
fn packed_visibility_read_row(pixel: vec2u) -> u32 {
    return raytwin_hash(pixel) % 18u;
}
";
    fn hash(at: UVec2) -> u32 {
        let mut h = at.x.wrapping_mul(0x9e37_79b9) ^ at.y.wrapping_mul(0x85eb_ca6b);
        h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
        h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
        h ^ (h >> 16)
    }
    fn read(block: UVec2) -> u32 {
        let word = hash(block);
        match word % 5 {
            0 => !0,
            1 => 0,
            _ => word,
        }
    }
    fn read_row(pixel: UVec2) -> u32 {
        hash(pixel) % 18
    }
    fn rectangle(low: UVec2, high: UVec2) -> u32 {
        packed_visibility_rectangle(low, high, read)
    }
    fn horizontal(pixel: UVec2, size: UVec2) -> u32 {
        packed_visibility_horizontal(pixel, size, read)
    }
    fn vertical(pixel: UVec2, size: UVec2) -> u32 {
        packed_visibility_vertical(pixel, size, read_row)
    }
    fn sum(pixel: UVec2, size: UVec2) -> u32 {
        packed_visibility_sum(pixel, size, read)
    }

    // The truths go pixel by pixel, with signed coordinates.
    fn lit(x: i64, y: i64) -> u32 {
        let block = UVec2::new((x / 8) as u32, (y / 4) as u32);
        read(block) >> (8 * (y % 4) + x % 8) & 1
    }
    fn around(pixel: UVec2, size: UVec2, reach: (i64, i64), value: fn(i64, i64) -> u32) -> u32 {
        let (px, py) = (i64::from(pixel.x), i64::from(pixel.y));
        let (w, h) = (i64::from(size.x), i64::from(size.y));
        if px >= w || py >= h {
            return 0;
        }
        let mut sum = 0;
        for y in py - reach.1..=py + reach.1 {
            for x in px - reach.0..=px + reach.0 {
                if x >= 0 && y >= 0 && x < w && y < h {
                    sum += value(x, y);
                }
            }
        }
        sum
    }
    fn exact_rectangle(low: UVec2, high: UVec2) -> u32 {
        let (low, high) = (low.as_i64vec2(), high.as_i64vec2());
        (low.y..=high.y)
            .map(|y| (low.x..=high.x).map(|x| lit(x, y)).sum::<u32>())
            .sum()
    }
    fn exact_window(block: UVec2, low: UVec2, high: UVec2) -> u32 {
        (0..32)
            .filter(|i| {
                let x = 8 * u64::from(block.x) + i % 8;
                let y = 4 * u64::from(block.y) + i / 8;
                let inside =
                    |v: u64, low: u32, high: u32| u64::from(low) <= v && v <= u64::from(high);
                inside(x, low.x, high.x) && inside(y, low.y, high.y)
            })
            .map(|i| 1 << i)
            .sum()
    }
    fn one(_: i64, _: i64) -> u32 {
        1
    }

    let anywhere = || {
        domains::below(1 << 20)
            .and(domains::below(1 << 20))
            .map(|(x, y)| UVec2::new(x, y))
    };
    let near = |end: u32| {
        domains::below(end)
            .and(domains::below(end))
            .map(|(x, y)| UVec2::new(x, y))
    };
    // A pixel and its image; one in eight lies outside.
    let pixels = || -> Domain<(UVec2, UVec2)> {
        near(64)
            .and(domains::any_uvec2())
            .and(domains::below(8))
            .map(|((size, at), kind)| {
                let size = size + 1;
                let end = if kind == 7 { size + 3 } else { size };
                (at % end, size)
            })
    };
    let inside = || {
        near(64)
            .and(domains::any_uvec2())
            .map(|(size, at)| (at % (size + 1), size + 1))
    };
    let edges = [
        (UVec2::ZERO, UVec2::ZERO),
        (UVec2::ZERO, UVec2::ONE),
        (UVec2::ZERO, UVec2::new(17, 17)),
        (UVec2::new(8, 8), UVec2::new(17, 17)),
        (UVec2::new(16, 16), UVec2::new(17, 17)),
        (UVec2::new(44, 29), UVec2::new(45, 30)),
        (UVec2::new(45, 29), UVec2::new(45, 30)),
        (UVec2::splat(u32::MAX), UVec2::new(45, 30)),
        (UVec2::splat(u32::MAX - 1), UVec2::splat(u32::MAX)),
        (UVec2::new(1919, 1079), UVec2::new(1920, 1080)),
    ];
    // Rays and how many of them reached the light, now and then too many.
    let counts = || {
        domains::below(4097)
            .and(domains::any_u32())
            .map(|(area, sum)| (sum % (area + 2), area))
    };
    let count_edges = [
        (0, 0),
        (0, 1),
        (1, 1),
        (0, 289),
        (288, 289),
        (289, 289),
        (290, 289),
        (4095, 4096),
    ];

    vec![
        Kernel::new(
            MODULE,
            "packed_visibility_block",
            ["pixel"],
            packed_visibility_block,
            |pixel: UVec2| UVec2::new(pixel.x / 8, pixel.y / 4),
            (domains::any_uvec2(),),
        )
        .bit_exact()
        .hard([(UVec2::ZERO,), (UVec2::MAX,), (UVec2::new(7, 3),)])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_bit",
            ["local"],
            packed_visibility_bit,
            |local: UVec2| 2u32.pow(8 * (local.y % 4) + local.x % 8),
            (domains::any_uvec2(),),
        )
        .bit_exact()
        .hard([(UVec2::ZERO,), (UVec2::MAX,), (UVec2::new(7, 3),)])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_pack",
            ["rays"],
            packed_visibility_pack,
            |(visible,): ([u32; 32],)| {
                (0..32)
                    .filter(|i| visible[*i] > 0)
                    .map(|i| 2u32.pow(i as u32))
                    .sum::<u32>()
            },
            (Domain::new(2, |w| PackedVisibilityRays {
                // Any number but 0 is a visible ray.
                visible: std::array::from_fn(|i| (w[0] >> i & 1) * (w[1] | 1)),
            }),),
        )
        .bit_exact()
        .hard([
            (PackedVisibilityRays { visible: [0; 32] },),
            (PackedVisibilityRays {
                visible: [0x8000_0000; 32],
            },),
            (PackedVisibilityRays {
                visible: std::array::from_fn(|i| u32::from(i == 31)),
            },),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_unpack",
            ["word", "local"],
            packed_visibility_unpack,
            |word: u32, local: UVec2| {
                u32::from(word & 2u32.pow(8 * (local.y % 4) + local.x % 8) > 0)
            },
            (domains::any_u32(), domains::any_uvec2()),
        )
        .bit_exact()
        .hard([
            (0x8000_0000, UVec2::new(7, 3)),
            (0x7fff_ffff, UVec2::MAX),
            (1, UVec2::new(8, 4)),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_window",
            ["block", "low", "high"],
            packed_visibility_window,
            exact_window,
            near(8).and(near(64)).and(near(64)).and(anywhere()).map(
                |(((block, low), high), far)| {
                    // A rectangle next to the block, most of them not empty.
                    let start = UVec2::new(8 * far.x, 4 * far.y);
                    (far + block, start + low, start + low.min(high) + high / 2)
                },
            ),
        )
        .bit_exact()
        .hard([
            (UVec2::ZERO, UVec2::ZERO, UVec2::MAX),
            (UVec2::ZERO, UVec2::new(7, 3), UVec2::new(7, 3)),
            (UVec2::ZERO, UVec2::new(8, 0), UVec2::MAX),
            (UVec2::ONE, UVec2::ZERO, UVec2::new(7, 9)),
            (UVec2::ONE, UVec2::new(12, 6), UVec2::new(11, 7)),
            (UVec2::ONE, UVec2::new(12, 6), UVec2::new(12, 5)),
            (
                UVec2::new((1 << 29) - 1, (1 << 30) - 1),
                UVec2::MAX,
                UVec2::MAX,
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_count",
            ["word", "window"],
            packed_visibility_count,
            |word: u32, window: u32| {
                (0..32)
                    .map(|i| (word >> i) & (window >> i) & 1)
                    .sum::<u32>()
            },
            (domains::any_u32(), domains::any_u32()),
        )
        .bit_exact()
        .hard([(!0, !0), (!0, 0), (0, !0), (0x8000_0001, 0x8000_0000)])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_rectangle",
            ["low", "high"],
            rectangle,
            exact_rectangle,
            near(48)
                .and(near(24))
                .map(|(low, extent)| (low, low + extent)),
        )
        .bit_exact()
        .hard([
            (UVec2::ZERO, UVec2::ZERO),
            (UVec2::new(9, 9), UVec2::new(8, 9)),
            (UVec2::new(9, 9), UVec2::new(9, 8)),
            (UVec2::splat(40), UVec2::ZERO),
            (UVec2::splat(u32::MAX - 5), UVec2::MAX),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_low",
            ["pixel"],
            packed_visibility_low,
            |pixel: UVec2| UVec2::new(pixel.x.saturating_sub(8), pixel.y.saturating_sub(8)),
            (near(64),),
        )
        .bit_exact()
        .hard([(UVec2::ZERO,), (UVec2::new(8, 7),), (UVec2::MAX,)])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_high",
            ["pixel", "size"],
            packed_visibility_high,
            |pixel: UVec2, size: UVec2| {
                let end = |p: u32, n: u32| (u64::from(p) + 8).min(u64::from(n) - 1) as u32;
                UVec2::new(end(pixel.x, size.x), end(pixel.y, size.y))
            },
            inside(),
        )
        .bit_exact()
        .hard([
            (UVec2::ZERO, UVec2::ONE),
            (UVec2::ZERO, UVec2::new(9, 8)),
            (UVec2::MAX - 1, UVec2::MAX),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_area",
            ["pixel", "size"],
            packed_visibility_area,
            |pixel: UVec2, size: UVec2| around(pixel, size, (8, 8), one),
            pixels(),
        )
        .bit_exact()
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_horizontal",
            ["pixel", "size"],
            horizontal,
            |pixel: UVec2, size: UVec2| around(pixel, size, (8, 0), lit),
            pixels(),
        )
        .bit_exact()
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_vertical",
            ["pixel", "size"],
            vertical,
            |pixel: UVec2, size: UVec2| {
                around(pixel, size, (0, 8), |x, y| {
                    read_row(UVec2::new(x as u32, y as u32))
                })
            },
            pixels(),
        )
        .bit_exact()
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_sum",
            ["pixel", "size"],
            sum,
            |pixel: UVec2, size: UVec2| around(pixel, size, (8, 8), lit),
            pixels(),
        )
        .bit_exact()
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .baseline(
            "289 rays, one bit each",
            "fn baseline(pixel: vec2u, size: vec2u) -> u32 {
                if any(pixel >= size) {
                    return 0u;
                }
                var sum = 0u;
                for (var y = -8; y <= 8; y++) {
                    for (var x = -8; x <= 8; x++) {
                        let at = vec2i(pixel) + vec2i(x, y);
                        if all(at >= vec2i(0)) && all(at < vec2i(size)) {
                            let p = vec2u(at);
                            let word = packed_visibility_read(p / vec2u(8u, 4u));
                            sum += (word >> (8u * (p.y % 4u) + p.x % 8u)) & 1u;
                        }
                    }
                }
                return sum;
            }",
            |pixel: UVec2, size: UVec2| around(pixel, size, (8, 8), lit),
        )
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_mean",
            ["sum", "area"],
            packed_visibility_mean,
            |sum: u32, area: u32| {
                if area == 0 {
                    1.0
                } else {
                    (f64::from(sum) / f64::from(area)).min(1.0)
                }
            },
            counts(),
        )
        .few_ulp(0.5, 2.5)
        .hard(count_edges)
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "packed_visibility_variance",
            ["sum", "area"],
            packed_visibility_variance,
            |sum: u32, area: u32| {
                if sum >= area {
                    0.0
                } else {
                    let p = f64::from(sum) / f64::from(area);
                    p * (f64::from(area - sum) / f64::from(area))
                }
            },
            counts(),
        )
        .few_ulp(0.5, 2.5)
        .hard(count_edges)
        .fixture(FIXTURE, vec![0])
        .source("Bernoulli's variance, p (1 - p)")
        .baseline(
            "E[x^2] - E[x]^2 in f32",
            "fn baseline(sum: u32, area: u32) -> f32 {
                if sum >= area {
                    return 0.0;
                }
                let p = f32(sum) / f32(area);
                return p - p * p;
            }",
            |sum: u32, area: u32| {
                if sum >= area {
                    return 0.0;
                }
                let p = sum as f32 / area as f32;
                p - p * p
            },
        )
        .build(),
    ]
}
