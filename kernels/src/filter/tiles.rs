//! Tiles that a filter has to touch: the pair and its contract.

pub use raytwin_cpu::filter::tiles::*;

/// The WGSL twin, without its callbacks.
pub const WGSL: &str = raytwin_wgsl::filter::TILES;

#[cfg(feature = "contract")]
use glam::UVec3;

#[cfg(feature = "contract")]
crate::value_struct!(TilesDispatch {
    groups: UVec3,
    whole: u32,
    count: u32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};
    use glam::{DVec3, UVec2, Vec3};

    const MODULE: &str = "filter/tiles";
    const SOURCE: &str = "FidelityFX Denoiser 1.x (classes of tiles, indirect dispatch)";
    const OURS: &str = "ours: what leaves every bit as it is";
    const NOT_F32: &str = "WGSL defines no f32 parameter that holds a NaN, so no table covers \
                           this signature; the test itself is on bits and exact";
    // Flags from a hash of the place, most of them lit.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return h ^ (h >> 16u);
}
fn raytwin_flags(at: vec2u, rare: u32) -> u32 {
    let h = raytwin_hash(at);
    if h % rare == 0u {
        return (h >> 8u) & 3u;
    }
    return select(TILES_LIT, TILES_NONE, (at.x & 1u) == 0u);
}
fn tiles_read_pixel(at: vec2u) -> u32 {
    return raytwin_flags(at, 97u);
}
fn tiles_read(tile: vec2u) -> u32 {
    return raytwin_flags(tile, 23u);
}
fn tiles_read_row(tile: vec2u) -> u32 {
    return raytwin_flags(tile, 17u);
}
";
    fn read(at: UVec2, rare: u32) -> u32 {
        let mut h = at.x.wrapping_mul(0x9e37_79b9) ^ at.y.wrapping_mul(0x85eb_ca6b);
        h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
        h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
        h ^= h >> 16;
        if h.is_multiple_of(rare) {
            return (h >> 8) & 3;
        }
        if at.x & 1 == 0 { TILES_NONE } else { TILES_LIT }
    }
    fn flags(tile: UVec2, size: UVec2) -> u32 {
        tiles_flags(tile, size, |at| read(at, 97))
    }
    fn horizontal(tile: UVec2, tiles: UVec2, reach: u32) -> u32 {
        tiles_horizontal(tile, tiles, reach, |t| read(t, 23))
    }
    fn vertical(tile: UVec2, tiles: UVec2, reach: u32) -> u32 {
        tiles_vertical(tile, tiles, reach, |t| read(t, 17))
    }

    // The truths say it in numbers instead of bits, with signed places.
    fn exact_scalar(value: f64, variance: f64, surface: u32) -> u32 {
        let is_data = value.abs() < 2f64.powi(60)
            && variance < 2f64.powi(121)
            && variance >= 0.0
            && !variance.is_sign_negative();
        if surface == 0 {
            return if is_data { TILES_NONE } else { TILES_MIXED };
        }
        let sure = variance == 0.0 && !variance.is_sign_negative();
        match (sure, value) {
            (true, 1.0) => TILES_LIT,
            (true, 0.0) if !value.is_sign_negative() => TILES_DARK,
            _ => TILES_MIXED,
        }
    }
    fn exact_color(color: DVec3, variance: f64, surface: u32) -> u32 {
        let each = color.to_array().map(|c| exact_scalar(c, variance, surface));
        if each.iter().all(|f| *f == each[0]) {
            each[0]
        } else {
            TILES_MIXED
        }
    }
    fn joined(
        (first_x, last_x): (i64, i64),
        (first_y, last_y): (i64, i64),
        size: UVec2,
        rare: u32,
    ) -> u32 {
        let (w, h) = (i64::from(size.x), i64::from(size.y));
        let mut seen = [false; 4];
        for y in first_y.max(0)..=last_y.min(h - 1) {
            for x in first_x.max(0)..=last_x.min(w - 1) {
                seen[read(UVec2::new(x as u32, y as u32), rare) as usize] = true;
            }
        }
        let lit = seen[TILES_LIT as usize] || seen[TILES_MIXED as usize];
        let dark = seen[TILES_DARK as usize] || seen[TILES_MIXED as usize];
        u32::from(lit) + 2 * u32::from(dark)
    }
    fn exact_flags(tile: UVec2, size: UVec2) -> u32 {
        let (x, y) = (8 * i64::from(tile.x), 8 * i64::from(tile.y));
        if x >= i64::from(size.x) || y >= i64::from(size.y) {
            return TILES_NONE;
        }
        joined((x, x + 7), (y, y + 7), size, 97)
    }
    fn around(at: u32, reach: u32) -> (i64, i64) {
        let (at, reach) = (i64::from(at), i64::from(reach));
        (at - reach, at + reach)
    }
    fn exact_horizontal(tile: UVec2, tiles: UVec2, reach: u32) -> u32 {
        if tile.cmpge(tiles).any() {
            return TILES_NONE;
        }
        joined(around(tile.x, reach), around(tile.y, 0), tiles, 23)
    }
    fn exact_vertical(tile: UVec2, tiles: UVec2, reach: u32) -> u32 {
        if tile.cmpge(tiles).any() {
            return TILES_NONE;
        }
        joined(around(tile.x, 0), around(tile.y, reach), tiles, 17)
    }

    // Exactly 0 and 1 and their neighbours, data and none.
    let value = || {
        domains::range(0.0, 1.5)
            .and(domains::below(16))
            .map(|(x, kind)| match kind {
                0..=3 => 1.0,
                4..=7 => 0.0,
                8 => -0.0,
                9 => 1.0 - f32::EPSILON / 2.0,
                10 => f32::NAN,
                11 => -1.3e18,
                _ => x,
            })
    };
    let variance = || {
        domains::log_range(1e-6, 1.0)
            .and(domains::below(16))
            .map(|(x, kind)| match kind {
                0..=8 => 0.0,
                9 => -0.0,
                10 => -x,
                11 => f32::INFINITY,
                12 => f32::MAX,
                _ => x,
            })
    };
    let surface = || domains::below(4).map(|kind| kind.min(1));
    let near = |end: u32| {
        domains::below(end)
            .and(domains::below(end))
            .map(|(x, y)| UVec2::new(x, y))
    };
    // Tiles in an image, and now and then beside it.
    let tiles = || -> Domain<(UVec2, UVec2, u32)> {
        near(24)
            .and(near(26))
            .and(domains::below(10))
            .map(|((size, at), reach)| (at % (size + 2), size + 1, reach))
    };
    let tile_edges = [
        (UVec2::ZERO, UVec2::ZERO, 0),
        (UVec2::ZERO, UVec2::ONE, 5),
        (UVec2::new(7, 5), UVec2::new(8, 6), 0),
        (UVec2::new(7, 5), UVec2::new(8, 6), 0x7fff_ffff),
        (UVec2::new(8, 5), UVec2::new(8, 6), 2),
        (UVec2::new(3, 6), UVec2::new(8, 6), 2),
        (UVec2::splat(u32::MAX), UVec2::new(8, 6), 9),
    ];

    vec![
        Kernel::new(
            MODULE,
            "tiles_scalar_flags",
            ["value", "variance", "surface"],
            tiles_scalar_flags,
            exact_scalar,
            value()
                .and(variance())
                .and(surface())
                .map(|((value, variance), surface)| (value, variance, surface)),
        )
        .bit_exact()
        .by_analysis(NOT_F32)
        .hard([
            (1.0, 0.0, 1),
            (0.0, 0.0, 1),
            (-0.0, 0.0, 1),
            (1.0, -0.0, 1),
            (1.0, 1e-30, 1),
            (f32::NAN, 0.0, 1),
            (0.5, 0.25, 0),
            (0.5, -0.25, 0),
            (f32::INFINITY, 0.0, 0),
            (0.5, f32::NAN, 0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_color_flags",
            ["color", "variance", "surface"],
            tiles_color_flags,
            exact_color,
            domains::vec3(value())
                .and(value())
                .and(domains::below(2))
                .and(variance())
                .and(surface())
                .map(|((((color, grey), kind), variance), surface)| {
                    let color = if kind == 0 { color } else { Vec3::splat(grey) };
                    (color, variance, surface)
                }),
        )
        .bit_exact()
        .by_analysis(NOT_F32)
        .hard([
            (Vec3::ONE, 0.0, 1),
            (Vec3::ZERO, 0.0, 1),
            (Vec3::X, 0.0, 1),
            (Vec3::new(1.0, f32::NAN, 1.0), 0.0, 1),
            (Vec3::new(0.2, 7.0, -1.0), 0.5, 0),
            (Vec3::new(0.2, 1e30, -1.0), 0.5, 0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_reflection_flags",
            ["kind"],
            tiles_reflection_flags,
            |kind: u32| 2u32.pow(kind.min(2)),
            (domains::below(4),),
        )
        .bit_exact()
        .hard([(0,), (1,), (2,), (3,), (u32::MAX,)])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_reflection_kind",
            ["flags"],
            tiles_reflection_kind,
            // Neither, mirror, sampled, both; then the same with diffuse.
            |flags: u32| [2, 0, 1, 1, 2, 0, 1, 1][flags as usize % 8],
            (domains::below(8),),
        )
        .bit_exact()
        .hard([(0,), (1,), (4,), (5,), (7,)])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_count",
            ["size"],
            tiles_count,
            |size: UVec2| UVec2::new(size.x.div_ceil(8), size.y.div_ceil(8)),
            (domains::any_uvec2(),),
        )
        .bit_exact()
        .hard([(UVec2::ZERO,), (UVec2::MAX,), (UVec2::new(8, 9),)])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_at",
            ["index", "across"],
            tiles_at,
            |index: u32, across: u32| {
                let row = index.checked_div(across).unwrap_or(index);
                UVec2::new(index - row * across.max(1), row)
            },
            domains::any_u32().and(domains::below(600)),
        )
        .bit_exact()
        .hard([(0, 1), (7, 7), (5, 0), (u32::MAX, u32::MAX)])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_reach",
            ["pixels"],
            tiles_reach,
            |pixels: u32| pixels.div_ceil(8),
            (domains::any_u32(),),
        )
        .bit_exact()
        .hard([(0,), (1,), (8,), (62,), (65,), (u32::MAX,)])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_atrous_reach",
            ["radius", "passes"],
            tiles_atrous_reach,
            |radius: u32, passes: u32| {
                (0..passes.min(16))
                    .map(|i| radius.min(2) * 2u32.pow(i))
                    .sum::<u32>()
            },
            domains::below(4).and(domains::below(20)),
        )
        .bit_exact()
        .hard([(2, 5), (1, 4), (2, 0), (0, 5), (u32::MAX, u32::MAX)])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_flags",
            ["tile", "size"],
            flags,
            exact_flags,
            near(90)
                .and(near(26))
                .map(|(size, at)| (at % (tiles_count(size + 1) + 1), size + 1)),
        )
        .bit_exact()
        .hard([
            (UVec2::ZERO, UVec2::ZERO),
            (UVec2::ZERO, UVec2::ONE),
            (UVec2::new(5, 3), UVec2::new(45, 30)),
            (UVec2::new(6, 3), UVec2::new(45, 30)),
            (UVec2::splat(u32::MAX), UVec2::splat(u32::MAX)),
            (UVec2::splat((1 << 29) - 1), UVec2::splat(u32::MAX)),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_horizontal",
            ["tile", "tiles", "reach"],
            horizontal,
            exact_horizontal,
            tiles(),
        )
        .bit_exact()
        .hard(tile_edges)
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_vertical",
            ["tile", "tiles", "reach"],
            vertical,
            exact_vertical,
            tiles(),
        )
        .bit_exact()
        .hard(tile_edges)
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_needed",
            ["own", "around"],
            tiles_needed,
            |own: u32, around: u32| u32::from(own != 0 && ![0, 1, 2].contains(&around)),
            domains::below(4).and(domains::below(4)),
        )
        .bit_exact()
        .hard([(0, 3), (1, 1), (1, 3), (2, 2), (3, 3), (0, 0)])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_dispatch",
            ["count", "capacity", "tiles"],
            tiles_dispatch,
            |count: u32, capacity: u32, tiles: u32| {
                let fits = count <= capacity.min(tiles);
                let listed = if fits { count } else { tiles };
                let groups = UVec3::new(listed.min(256), listed.div_ceil(256), 1);
                (groups, u32::from(!fits), listed)
            },
            domains::below(1 << 24)
                .and(domains::any_u32())
                .and(domains::any_u32())
                .map(|((tiles, count), capacity)| {
                    // Half of the lists are too short.
                    let count = count % (tiles + 2);
                    let room = if capacity & 1 == 0 { tiles + 1 } else { count };
                    (count, (capacity >> 1) % (room + 1), tiles)
                }),
        )
        .bit_exact()
        .hard([
            (0, 0, 0),
            (0, 10, 10),
            (255, 255, 255),
            (256, 256, 256),
            (257, 257, 257),
            (10, 9, 10),
            (u32::MAX, u32::MAX, 10),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "tiles_slot",
            ["group"],
            tiles_slot,
            |group: UVec2| 256 * group.y + group.x,
            domains::below(256)
                .and(domains::below(65536))
                .map(|(x, y)| (UVec2::new(x, y),)),
        )
        .bit_exact()
        .hard([
            (UVec2::ZERO,),
            (UVec2::new(255, 65535),),
            (UVec2::new(0, 1),),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
    ]
}
