//! Cells with lists of surfels: the pair and its contract.

pub use raytwin_cpu::gi::surfel_grid::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::gi::SURFEL_GRID;

#[cfg(feature = "contract")]
crate::value_struct!(SurfelGrid {
    origin: glam::Vec3,
    inverse_cell: f32,
    size: glam::UVec3,
    slots: u32,
    inverse_reach: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(SurfelGridRange {
    low: glam::UVec3,
    span: glam::UVec3,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::surfel::{SURFEL_LARGEST, Surfel, WideSurfel, surfel_and_point, surfel_sound};
    use crate::contract::{Kernel, domains};
    use crate::random::pcg::pcg4d;
    use glam::{DVec3, UVec2, UVec3, UVec4, Vec3};

    const MODULE: &str = "gi/surfel_grid";
    const LEVELS: &str = "ours";
    const LISTS: &str = "Ray Tracing Gems, ch. 25 (lists in cells)";
    const HASH: &str = "Teschner et al. 2003; hash of Jarzynski and Olano 2020";
    // The grid itself reads nothing.
    const FIXTURE: &str = "
fn surfel_read(entry: u32) -> Surfel {
    return Surfel(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), entry);
}
fn surfel_read_irradiance(entry: u32) -> vec3f {
    return vec3f(0.0, 0.0, 0.0);
}
";
    type WideGrid = (DVec3, f64, UVec3, u32, f64);

    fn level_of(far: f64) -> u32 {
        if far < 1.0 {
            0
        } else {
            (far.log2().floor() as u32 + 1).min(SURFEL_GRID_LEVELS)
        }
    }
    fn exact_level(point: DVec3, (origin, _, _, _, reach): WideGrid) -> u32 {
        level_of((point - origin).abs().max_element() * reach)
    }
    // A power of two from 1 on, where a rounding error changes the level.
    fn level_open(far: f64) -> bool {
        let log = far.max(0.25).log2();
        (log - log.round()).abs() < 1e-6 && log > -0.5 && log < 20.0
    }
    fn cells(point: DVec3, level: u32, (origin, inverse, ..): WideGrid) -> DVec3 {
        let most = DVec3::splat(SURFEL_GRID_FAR.into());
        let scale = inverse / 2f64.powi(level.min(SURFEL_GRID_LEVELS) as i32);
        ((point - origin) * scale).clamp(-most, most)
    }
    fn wrapped(cell: DVec3) -> UVec3 {
        let axis = |x: f64| (x.floor() as i64).rem_euclid(1 << 32) as u32;
        UVec3::new(axis(cell.x), axis(cell.y), axis(cell.z))
    }
    fn exact_coordinate(point: DVec3, level: u32, grid: WideGrid) -> UVec3 {
        wrapped(cells(point, level, grid))
    }
    fn cells_open(cell: DVec3) -> bool {
        cells_open_by(cell, 0.0)
    }
    fn cells_open_by(cell: DVec3, lost: f64) -> bool {
        cell.to_array()
            .into_iter()
            .any(|x| (x - x.round()).abs() < 1e-6 * x.abs().max(1.0) + lost)
    }
    fn exact_slot(c: UVec3, level: u32, (_, _, size, slots, _): WideGrid) -> u32 {
        if slots == 0 {
            return SURFEL_GRID_NOWHERE;
        }
        if size == UVec3::ZERO {
            return pcg4d(UVec4::new(c.x, c.y, c.z, level)).x % slots;
        }
        let [x, y, z] = c.to_array().map(u64::from);
        let [width, height, depth] = size.to_array().map(u64::from);
        let slot = x + width * (y + height * z);
        let inside = level == 0 && x < width && y < height && z < depth;
        if inside && slot < u64::from(slots) {
            slot as u32
        } else {
            SURFEL_GRID_NOWHERE
        }
    }
    fn exact_find(point: DVec3, grid: WideGrid) -> u32 {
        let usable = |x: f64| x.abs() <= f64::from(SURFEL_LARGEST);
        if !point.to_array().into_iter().all(usable) {
            return SURFEL_GRID_NOWHERE;
        }
        let level = exact_level(point, grid);
        exact_slot(exact_coordinate(point, level, grid), level, grid)
    }
    fn exact_extent((p, radius, n, _): WideSurfel, grid: WideGrid) -> DVec3 {
        // Of a unit normal's ellipsoid: 1 - (15/16) n² along each axis.
        let square = n.length_squared();
        let wide = (DVec3::splat(square) - n * n * (15.0 / 16.0)).max(DVec3::ZERO);
        let root = DVec3::new(wide.x.sqrt(), wide.y.sqrt(), wide.z.sqrt());
        root * (radius * 33.0 / 32.0) + (p.abs() + grid.0.abs()) / 4_194_304.0
    }
    fn exact_sound((p, r, n, mesh): WideSurfel) -> bool {
        // Of exact numbers: as its own contract says.
        let surfel = Surfel {
            position: p.as_vec3(),
            radius: r as f32,
            normal: n.as_vec3(),
            mesh,
        };
        surfel_sound(surfel) == 1
    }
    // Nearest and farthest of a box, in reaches.
    fn reaches(s: WideSurfel, grid: WideGrid) -> (f64, f64) {
        let h = exact_extent(s, grid);
        let away = (s.0 - grid.0).abs();
        (
            (away - h).max_element().max(0.0) * grid.4,
            (away + h).max_element() * grid.4,
        )
    }
    fn exact_levels(s: WideSurfel, grid: WideGrid) -> UVec2 {
        if !exact_sound(s) {
            return UVec2::ZERO;
        }
        let (near, far) = reaches(s, grid);
        let (first, last) = (level_of(near), level_of(far));
        if last > first + 1 {
            return UVec2::ZERO;
        }
        UVec2::new(first, last - first + 1)
    }
    fn corners(s: WideSurfel, level: u32, grid: WideGrid) -> (DVec3, DVec3) {
        let h = exact_extent(s, grid);
        (cells(s.0 - h, level, grid), cells(s.0 + h, level, grid))
    }
    fn exact_range(s: WideSurfel, level: u32, grid: WideGrid) -> (UVec3, UVec3) {
        let (low, high) = corners(s, level, grid);
        let span = high.floor() - low.floor() + DVec3::ONE;
        if span.max_element() > 3.0 {
            return (wrapped(low), UVec3::ZERO);
        }
        (wrapped(low), span.as_uvec3())
    }
    fn exact_cell((low, span): (UVec3, UVec3), index: u32) -> UVec3 {
        let (width, height) = (span.x.max(1), span.y.max(1));
        let row = index / width;
        let step = UVec3::new(
            index - row * width,
            row - row / height * height,
            row / height,
        );
        let sum = |a: u32, b: u32| (u64::from(a) + u64::from(b)).rem_euclid(1 << 32) as u32;
        UVec3::new(sum(low.x, step.x), sum(low.y, step.y), sum(low.z, step.z))
    }

    let grids = || {
        domains::vec3(domains::range(-4.0, 4.0))
            .and(domains::log_range(0.01, 10.0))
            .and(domains::below(4))
            .and(domains::log_range(0.01, 10.0))
            .map(|(((origin, inverse_cell), kind), reach)| SurfelGrid {
                origin,
                inverse_cell,
                size: match kind {
                    0 => UVec3::new(40, 30, 20),
                    _ => UVec3::ZERO,
                },
                slots: 24_000,
                inverse_reach: if kind > 1 { reach } else { 0.0 },
            })
    };
    let points = || domains::vec3(domains::signed_log_range(1e-3, 1e4));
    let hashed = SurfelGrid {
        origin: Vec3::ZERO,
        inverse_cell: 1.0,
        size: UVec3::ZERO,
        slots: 4096,
        inverse_reach: 0.25,
    };
    let dense = SurfelGrid {
        size: UVec3::new(8, 4, 2),
        slots: 64,
        inverse_reach: 0.0,
        ..hashed
    };
    let empty = SurfelGrid { slots: 0, ..hashed };
    let disc = |position: Vec3, radius: f32, normal: Vec3| Surfel {
        position,
        radius,
        normal,
        mesh: 0,
    };
    let surfels = || surfel_and_point().map(|(s, _)| s);
    let ranges = || {
        domains::any_uvec3()
            .and(domains::below(27))
            .map(|(low, k)| SurfelGridRange {
                low,
                span: UVec3::new(k % 3 + 1, k / 3 % 3 + 1, k / 9 + 1),
            })
    };
    let no_cells = SurfelGridRange {
        low: UVec3::MAX,
        span: UVec3::ZERO,
    };
    let broken = [
        disc(Vec3::ZERO, 0.0, Vec3::Z),
        disc(Vec3::ZERO, 1.0, Vec3::ZERO),
        disc(Vec3::splat(1e20), 1.0, Vec3::Z),
        disc(Vec3::ZERO, 1e20, Vec3::Z),
    ];

    vec![
        Kernel::new(
            MODULE,
            "surfel_grid_level",
            ["point", "grid"],
            surfel_grid_level,
            exact_level,
            (points(), grids()),
        )
        .undecided(|p: DVec3, grid: WideGrid| {
            level_open((p - grid.0).abs().max_element() * grid.4) && grid.1 != 1.0
        })
        .few_ulp(0.0, 0.0)
        .hard([0.0, -3.999_999_8, 4.0, 8.0, -16.0, 1e15].map(|x| (Vec3::new(0.0, x, 0.0), hashed)))
        .hard([(Vec3::splat(1e15), dense)])
        .fixture(FIXTURE, vec![0])
        .source(LEVELS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_grid_coordinate",
            ["point", "level", "grid"],
            surfel_grid_coordinate,
            exact_coordinate,
            (points(), domains::below(18), grids()),
        )
        .undecided(|p: DVec3, level: u32, grid: WideGrid| {
            cells_open(cells(p, level, grid)) && grid.1 != 1.0
        })
        .few_ulp(0.0, 0.0)
        .hard([
            (Vec3::ZERO, 0, hashed),
            (Vec3::new(-1.0, 1.0, -1e-30), 0, hashed),
            (Vec3::new(0.99999994, -0.5, 2.0), 1, hashed),
            (Vec3::new(1e15, -1e15, 0.0), 0, hashed),
            (Vec3::new(65536.0, -65536.0, -1.0), 16, hashed),
            (Vec3::ONE, 99, hashed),
        ])
        .fixture(FIXTURE, vec![0])
        .source(LISTS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_grid_slot",
            ["coordinate", "level", "grid"],
            surfel_grid_slot,
            exact_slot,
            (
                domains::any_uvec3()
                    .and(domains::below(2))
                    .map(|(c, near)| if near == 1 { c % 48 } else { c }),
                domains::below(3),
                grids(),
            ),
        )
        .bit_exact()
        .hard([
            (UVec3::ZERO, 0, dense),
            (UVec3::new(7, 3, 1), 0, dense),
            (UVec3::new(8, 0, 0), 0, dense),
            (UVec3::new(0, u32::MAX, 0), 0, dense),
            (UVec3::ZERO, 1, dense),
            (UVec3::new(7, 3, 1), 0, SurfelGrid { slots: 63, ..dense }),
            (UVec3::MAX, 0, hashed),
            (UVec3::MAX, 0, SurfelGrid { slots: 1, ..hashed }),
            (UVec3::ZERO, 0, empty),
        ])
        .fixture(FIXTURE, vec![0])
        .source(HASH)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_grid_find",
            ["point", "grid"],
            surfel_grid_find,
            exact_find,
            (points(), grids()),
        )
        .undecided(|p: DVec3, grid: WideGrid| {
            grid.1 != 1.0
                && (level_open((p - grid.0).abs().max_element() * grid.4)
                    || cells_open(cells(p, exact_level(p, grid), grid)))
        })
        .few_ulp(0.0, 0.0)
        .hard([
            (Vec3::ZERO, hashed),
            (Vec3::new(-0.5, 100.0, 3.0), hashed),
            (Vec3::splat(1e20), hashed),
            (Vec3::new(0.5, 3.5, 1.5), dense),
            (Vec3::new(-0.5, 3.5, 1.5), dense),
            (Vec3::ZERO, empty),
        ])
        .fixture(FIXTURE, vec![0])
        .source(HASH)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_grid_extent",
            ["surfel", "grid"],
            surfel_grid_extent,
            exact_extent,
            (surfels(), grids()),
        )
        .few_ulp(3.5, 11.5)
        .hard([
            (disc(Vec3::ZERO, 1.0, Vec3::Z), hashed),
            (disc(Vec3::splat(-1e6), 1e-3, Vec3::X), hashed),
            (disc(Vec3::ZERO, 0.0, Vec3::X), hashed),
            (disc(Vec3::ZERO, 1e9, Vec3::new(0.6, 0.0, -0.8)), dense),
        ])
        .fixture(FIXTURE, vec![0])
        .source(LISTS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_grid_levels",
            ["surfel", "grid"],
            surfel_grid_levels,
            exact_levels,
            (surfels(), grids()),
        )
        .undecided(|s: WideSurfel, grid: WideGrid| {
            let (near, far) = reaches(s, grid);
            // Near cancels: open by what the distance rounds by.
            let lost = 1e-6 * (far + grid.4);
            exact_sound(s)
                && (level_open(far) || level_of(near + lost) != level_of((near - lost).max(0.0)))
        })
        .few_ulp(0.0, 0.0)
        .hard(broken.map(|s| (s, hashed)))
        .hard([
            (disc(Vec3::X * 4.0, 0.5, Vec3::Z), hashed),
            (disc(Vec3::X * 3.0, 0.5, Vec3::Z), hashed),
            (disc(Vec3::X * 4.0, 400.0, Vec3::Z), hashed),
            (disc(Vec3::X * 4.0, 400.0, Vec3::Z), dense),
        ])
        .fixture(FIXTURE, vec![0])
        .source(LEVELS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_grid_range",
            ["surfel", "level", "grid"],
            surfel_grid_range,
            exact_range,
            (surfels(), domains::below(10), grids()),
        )
        .undecided(|s: WideSurfel, level: u32, grid: WideGrid| {
            let (low, high) = corners(s, level, grid);
            // What the corners round by, in cells.
            let size = s.0.abs().max_element() + s.1 + grid.0.abs().max_element();
            let lost = 1e-6 * size * grid.1 / 2f64.powi(level as i32);
            cells_open_by(low, lost) || cells_open_by(high, lost)
        })
        .few_ulp(0.0, 0.0)
        .hard([
            (disc(Vec3::splat(0.5), 0.25, Vec3::Z), 0, hashed),
            (disc(Vec3::ZERO, 0.25, Vec3::Z), 0, hashed),
            (disc(Vec3::splat(0.5), 1.25, Vec3::X), 0, hashed),
            (disc(Vec3::splat(0.5), 5.0, Vec3::X), 0, hashed),
            (disc(Vec3::splat(0.5), 5.0, Vec3::X), 3, hashed),
        ])
        .fixture(FIXTURE, vec![0])
        .source(LISTS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_grid_count",
            ["range"],
            surfel_grid_count,
            |(_, span): (UVec3, UVec3)| span.element_product(),
            (ranges(),),
        )
        .bit_exact()
        .hard([(no_cells,)])
        .fixture(FIXTURE, vec![0])
        .source(LISTS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_grid_cell",
            ["range", "index"],
            surfel_grid_cell,
            exact_cell,
            (ranges(), domains::below(27)),
        )
        .bit_exact()
        .hard([(no_cells, 0), (no_cells, 5)])
        .fixture(FIXTURE, vec![0])
        .source(LISTS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_grid_kept",
            ["first", "count", "capacity"],
            surfel_grid_kept,
            |first: u32, count: u32, capacity: u32| {
                let fits = u64::from(first) + u64::from(count) <= u64::from(capacity);
                if fits { count } else { 0 }
            },
            (domains::any_u32(), domains::any_u32(), domains::any_u32()),
        )
        .bit_exact()
        .hard([
            (0, 10, 10),
            (1, 10, 10),
            (u32::MAX, u32::MAX, u32::MAX),
            (0, u32::MAX, u32::MAX),
            (10, 0, 10),
            (11, 0, 10),
        ])
        .fixture(FIXTURE, vec![0])
        .source(LISTS)
        .build(),
    ]
}
