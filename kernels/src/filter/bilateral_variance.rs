//! Variance-driven bilateral filter: the pair and its contract.

pub use raytwin_cpu::filter::bilateral_variance::*;

/// The WGSL twin, without what it requires and without its callback.
pub const WGSL: &str = raytwin_wgsl::filter::BILATERAL_VARIANCE;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::spatial_reconstruct::{exact_neighbour, exact_spiral, exact_square};
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, UVec2, Vec3};

    const MODULE: &str = "filter/bilateral_variance";
    const SOURCE: &str = "Ray Tracing Gems, ch. 25 (bilateral cleanup)";
    const OURS: &str = "proportional to the relative standard deviation; our form";
    const SIZE: UVec2 = UVec2::new(16, 12);
    // The image from a hash of the place, in exact fractions, so that interval
    // arithmetic sees the whole kernel: two floors, a tilted strip, a hole.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u, lane: u32) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn bilateral_variance_read(at: vec2u) -> BilateralVariancePixel {
    let red = f32(raytwin_hash(at, 4u)) * 0.00390625;
    let green = f32(raytwin_hash(at, 5u)) * 0.00390625;
    let blue = f32(raytwin_hash(at, 6u)) * 0.00390625;
    let variance = f32(raytwin_hash(at, 2u) & 31u) * 0.0009765625;
    var height = f32(raytwin_hash(at, 3u)) * 0.00390625;
    var normal = vec3f(0.0, 0.0, 1.0);
    var reach = 2.0;
    if at.x > 9u {
        height = height + 3.0;
    }
    if at.y > 8u {
        normal = vec3f(0.125, 0.0, 0.9921567);
    }
    if raytwin_hash(at, 1u) < 16u {
        reach = 0.0;
    }
    return BilateralVariancePixel(
        vec3f(red, green, blue), variance, vec3f(f32(at.x), f32(at.y), height), reach, normal,
    );
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
    fn read(at: UVec2) -> BilateralVariancePixel {
        let lane = |i: u32| hash(at, i) as f32 * 0.00390625;
        BilateralVariancePixel {
            color: Vec3::new(lane(4), lane(5), lane(6)),
            variance: (hash(at, 2) & 31) as f32 * 0.0009765625,
            position: Vec3::new(
                at.x as f32,
                at.y as f32,
                lane(3) + if at.x > 9 { 3.0 } else { 0.0 },
            ),
            reach: if hash(at, 1) < 16 { 0.0 } else { 2.0 },
            normal: if at.y > 8 {
                Vec3::new(0.125, 0.0, 0.9921567)
            } else {
                Vec3::Z
            },
        }
    }
    fn pixel(pixel: UVec2, size: UVec2, max_radius: f32, max_taps: u32, turn: f32) -> Vec3 {
        bilateral_variance_pixel(pixel, size, max_radius, max_taps, turn, read)
    }
    fn exact_weight(
        n: DVec3,
        other: DVec3,
        offset: DVec3,
        reach: f64,
        difference: DVec3,
        variance: f64,
    ) -> f64 {
        if variance <= 0.0 || reach <= 0.0 {
            return 0.0;
        }
        let plane = n.dot(offset) / reach;
        let color = exact_square(difference) / (16.0 * variance);
        (-(plane * plane)).exp() * (-64.0 * (n - other).length_squared()).exp() * (-color).exp()
    }
    fn exact_radius(variance: f64, square: f64, max_radius: f64) -> f64 {
        if variance <= 0.0 {
            0.0
        } else {
            // The standard deviation over half the root mean square.
            max_radius * (2.0 * variance.sqrt() / square.sqrt()).min(1.0)
        }
    }
    // Whether the square of a radius is next to an integer, but not on it.
    fn close_to_integer(radius: f64, exact: bool, tolerance: f64) -> bool {
        let square = radius * radius;
        let apart = (square - square.round()).abs();
        apart < tolerance * square && !(exact && apart == 0.0)
    }
    // The taps' pixels, and whether the choice of them is open.
    fn kernel(
        pixel: UVec2,
        size: UVec2,
        max_radius: f64,
        max_taps: u32,
        turn: f64,
    ) -> (Vec<UVec2>, bool) {
        let centre = read(pixel);
        let square = exact_square(centre.color.as_dvec3());
        let variance = f64::from(centre.variance);
        let radius = exact_radius(variance, square, max_radius);
        let taps = ((radius * radius) as u32).min(max_taps);
        let capped = radius * radius > f64::from(max_taps) + 1.0;
        let full = variance > 0.25001 * square;
        let mut open = variance > 0.0 && !capped && close_to_integer(radius, full, 1e-5);
        let mut places = Vec::new();
        for i in 1..=taps {
            let r = radius * (f64::from(i) / f64::from(taps)).sqrt();
            let (at, near) = exact_neighbour(pixel, size, exact_spiral(i, r, turn));
            open |= near;
            places.extend(at);
        }
        (places, open)
    }
    fn exact_pixel(pixel: UVec2, size: UVec2, max_radius: f64, max_taps: u32, turn: f64) -> DVec3 {
        if pixel.cmpge(size).any() {
            return DVec3::ZERO;
        }
        let wide = |v: Vec3| v.as_dvec3();
        let centre = read(pixel);
        let (mut sum, mut weights) = (wide(centre.color), 1.0);
        for at in kernel(pixel, size, max_radius, max_taps, turn).0 {
            let tap = read(at);
            if tap.reach > 0.0 {
                let w = exact_weight(
                    wide(centre.normal),
                    wide(tap.normal),
                    wide(tap.position) - wide(centre.position),
                    centre.reach.into(),
                    wide(tap.color) - wide(centre.color),
                    centre.variance.into(),
                );
                sum += wide(tap.color) * w;
                weights += w;
            }
        }
        sum / weights
    }

    let taps_of = domains::below(64)
        .and(domains::below(64))
        .and(domains::range(1.0, 32.0))
        .and(domains::unit())
        .map(|(((a, b), radius), turn)| (a.min(b) + 1, a.max(b) + 1, radius, turn));
    let pairs = domains::unit_vector()
        .and(domains::vec3(domains::range(-0.2, 0.2)))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::log_range(0.05, 4.0))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::log_range(1e-4, 10.0))
        .map(|(((((n, tilt), offset), reach), difference), variance)| {
            let other = (n.as_dvec3() + tilt.as_dvec3()).normalize().as_vec3();
            (n, other, offset, reach, difference, variance)
        });
    let pixels = domains::below(SIZE.x)
        .and(domains::below(SIZE.y))
        .and(domains::range(0.0, 6.0))
        .and(domains::below(25))
        .and(domains::unit())
        .map(|((((x, y), radius), taps), turn)| (UVec2::new(x, y), SIZE, radius, taps, turn));
    // Pixels of the image with a variance, without one, and without a surface.
    let find = |wanted: &dyn Fn(&BilateralVariancePixel) -> bool| {
        (0..SIZE.x * SIZE.y)
            .map(|i| UVec2::new(i % SIZE.x, i / SIZE.x))
            .find(|at| wanted(&read(*at)))
            .expect("the image has such a pixel")
    };
    let still = find(&|p| p.variance == 0.0);
    let nowhere = find(&|p| p.reach == 0.0 && p.variance > 0.0);
    let noisy = find(&|p| p.reach > 0.0 && p.variance > 0.02);

    vec![
        Kernel::new(
            MODULE,
            "bilateral_variance_square",
            ["color"],
            bilateral_variance_square,
            exact_square,
            (domains::vec3(domains::signed_log_range(1e-4, 1e5)),),
        )
        .few_ulp(3.0, 4.75)
        .hard(
            [
                Vec3::ZERO,
                Vec3::ONE,
                Vec3::splat(-1e4),
                Vec3::new(1e8, 0.0, 1e-8),
                Vec3::new(-1.0, 1.0, -1.0),
            ]
            .map(|c| (c,)),
        )
        .fixture(FIXTURE, vec![0])
        .source("ITU-R BT.709-6, item 3.2, as weights of squares")
        .build(),
        Kernel::new(
            MODULE,
            "bilateral_variance_usable",
            ["color"],
            bilateral_variance_usable,
            |c: DVec3| u32::from(c.to_array().into_iter().all(|c| c.abs() < 2f64.powi(60))),
            (domains::vec3(
                domains::signed_log_range(1e-5, 1e5)
                    .and(domains::below(32))
                    .map(|(x, kind)| match kind {
                        0 => f32::NAN,
                        1 => f32::INFINITY,
                        2 => -2e18,
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
                Vec3::new(f32::NAN, 0.0, 0.0),
                Vec3::new(0.0, 0.0, f32::NEG_INFINITY),
                Vec3::new(0.0, 1_152_921_504_606_846_976.0, 0.0),
                Vec3::new(1.152_921_4e18, -1.152_921_4e18, 1e-30),
                Vec3::splat(f32::from_bits(0x7f80_0001)),
            ]
            .map(|c| (c,)),
        )
        .fixture(FIXTURE, vec![0])
        .source("ours: by bit pattern")
        .build(),
        Kernel::new(
            MODULE,
            "bilateral_variance_radius",
            ["variance", "square", "max_radius"],
            bilateral_variance_radius,
            exact_radius,
            (
                domains::log_range(1e-8, 1e4),
                domains::log_range(1e-6, 1e8),
                domains::range(0.5, 32.0),
            ),
        )
        .few_ulp(2.0, 9.75)
        .hard([
            (0.0, 0.0, 8.0),
            (0.0, 1.0, 8.0),
            (1.0, 0.0, 8.0),
            (1e8, 1e8, 8.0),
            (1e-30, 1e-30, 8.0),
            (0.25, 1.0, 8.0),
            (1e-8, 1e8, 8.0),
            (-1.0, 1.0, 8.0),
            (1.0, 1.0, 0.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "bilateral_variance_taps",
            ["radius", "max_taps"],
            bilateral_variance_taps,
            |radius: f64, max_taps: u32| ((radius * radius).floor() as u32).min(max_taps),
            (domains::range(0.0, 16.0), domains::below(300)),
        )
        .undecided(|radius: f64, _: u32| close_to_integer(radius, true, 2.5e-7))
        .few_ulp(0.0, 0.0)
        .hard([
            (0.0, 16),
            (0.99999994, 16),
            (1.0, 16),
            (4.0, 16),
            (4.0, 0),
            (3.9, 16),
            (1024.0, 0xffff_ffff),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "bilateral_variance_offset",
            ["index", "taps", "radius", "turn"],
            bilateral_variance_offset,
            |index: u32, taps: u32, radius: f64, turn: f64| {
                let r = radius * (f64::from(index) / f64::from(taps.max(1))).sqrt();
                exact_spiral(index, r, turn)
            },
            taps_of,
        )
        // A place in the plane: absolute, in units of its distance.
        .scale_by(|index: u32, taps: u32, radius: f64, _: f64| {
            (radius * (f64::from(index) / f64::from(taps.max(1))).sqrt()).max(1e-30)
        })
        .few_ulp(13.5, 19.5)
        .hard([
            (1, 1, 1.0, 0.0),
            (16, 16, 4.0, 0.99999994),
            (1, 64, 32.0, 0.5),
            (0, 0, 1.0, 0.5),
            (1, 1, 0.0, 0.5),
        ])
        .fixture(FIXTURE, vec![0])
        .source("Vogel 1979")
        .build(),
        Kernel::new(
            MODULE,
            "bilateral_variance_weight",
            [
                "normal",
                "other_normal",
                "offset",
                "reach",
                "difference",
                "variance",
            ],
            bilateral_variance_weight,
            exact_weight,
            pairs,
        )
        .scale_by(
            |_: DVec3, _: DVec3, offset: DVec3, reach: f64, _: DVec3, _: f64| {
                1.0 + if reach > 0.0 {
                    offset.length() / reach
                } else {
                    0.0
                }
            },
        )
        .few_ulp(1.25, 3.25)
        .hard([
            (Vec3::Z, Vec3::Z, Vec3::ZERO, 1.0, Vec3::ZERO, 1.0),
            (Vec3::Z, Vec3::Z, Vec3::X, 1e-6, Vec3::ZERO, 1e-20),
            (Vec3::Z, Vec3::Z, Vec3::ZERO, 1.0, Vec3::ZERO, 0.0),
            (Vec3::Z, Vec3::Z, Vec3::ZERO, 0.0, Vec3::ZERO, 1.0),
            (Vec3::Z, -Vec3::Z, Vec3::Z, 1.0, Vec3::ONE, 1.0),
            (Vec3::Z, Vec3::Z, Vec3::Z * 1e9, 1e-9, Vec3::ZERO, 1.0),
            (Vec3::Z, Vec3::Z, Vec3::X, 1.0, Vec3::splat(1e4), 1e-20),
            (Vec3::Z, Vec3::Z, Vec3::X, 1.0, Vec3::splat(1e4), 1e8),
        ])
        .fixture(FIXTURE, vec![0])
        .source("Tomasi and Manduchi 1998; Schied et al. 2017")
        .baseline(
            "usual form: built-in exp and dot, 1 - n.n'",
            "fn baseline(n: vec3f, other: vec3f, offset: vec3f, reach: f32, difference: vec3f, variance: f32) -> f32 {
                if variance <= 0.0 || reach <= 0.0 {
                    return 0.0;
                }
                let p = dot(n, offset) / reach;
                let d = dot(difference * difference, vec3f(0.2126, 0.7152, 0.0722));
                return exp(-p * p - 128.0 * (1.0 - dot(n, other)) - d / (16.0 * variance));
            }",
            |n: Vec3, other: Vec3, offset: Vec3, reach: f32, difference: Vec3, variance: f32| {
                if variance <= 0.0 || reach <= 0.0 {
                    return 0.0;
                }
                let p = n.dot(offset) / reach;
                let d = (difference * difference).dot(Vec3::new(0.2126, 0.7152, 0.0722));
                (-p * p - 128.0 * (1.0 - n.dot(other)) - d / (16.0 * variance)).exp()
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "bilateral_variance_pixel",
            ["pixel", "size", "max_radius", "max_taps", "turn"],
            pixel,
            exact_pixel,
            pixels,
        )
        // Colours are in [0, 1) here.
        .scale(1.0)
        .undecided(|p: UVec2, size: UVec2, radius: f64, taps: u32, turn: f64| {
            p.cmplt(size).all() && kernel(p, size, radius, taps, turn).1
        })
        .few_ulp(3.5, 110.0)
        .hard([
            (UVec2::ZERO, UVec2::ZERO, 4.0, 16, 0.0),
            (UVec2::splat(0xffff_ffff), SIZE, 4.0, 16, 0.0),
            (still, SIZE, 6.0, 24, 0.3),
            (nowhere, SIZE, 6.0, 24, 0.3),
            (noisy, SIZE, 0.0, 24, 0.3),
            (noisy, SIZE, 6.0, 0, 0.3),
            (noisy, SIZE, 5.3, 24, 0.3),
            // Every tap outside the image.
            (UVec2::ZERO, UVec2::ONE, 5.3, 24, 0.3),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
    ]
}
