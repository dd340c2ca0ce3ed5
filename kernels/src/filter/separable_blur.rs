//! Separable blur: the pair and its contract.

pub use raytwin_cpu::filter::separable_blur::*;

/// The WGSL twin, without what it requires and without its callback.
pub const WGSL: &str = raytwin_wgsl::filter::SEPARABLE_BLUR;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};
    use glam::{DVec3, UVec2, Vec3};

    const MODULE: &str = "filter/separable_blur";
    const SOURCE: &str = "Tomasi and Manduchi 1998; Pham and van Vliet 2005 (separable)";
    const SIZE: UVec2 = UVec2::new(24, 18);
    // The image from a hash of the place, in exact fractions, so that interval
    // arithmetic sees the whole kernel: two floors, a tilted strip, holes,
    // values that do not count.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u, lane: u32) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn separable_blur_read(at: vec2u) -> SeparableBlurPixel {
    var value = f32(raytwin_hash(at, 1u)) * 0.00390625;
    var height = f32(raytwin_hash(at, 2u)) * 0.00390625;
    var normal = vec3f(0.0, 0.0, 1.0);
    var reach = 1.0;
    if at.x > 13u {
        height = height + 2.5;
    }
    if at.y > 12u {
        normal = vec3f(0.125, 0.0, 0.9921567);
    }
    if raytwin_hash(at, 3u) < 12u {
        reach = 0.0;
    }
    if raytwin_hash(at, 4u) < 12u {
        value = -1.0;
    }
    return SeparableBlurPixel(vec3f(0.0, 0.0, height), reach, normal, value);
}
";
    fn read(at: UVec2) -> SeparableBlurPixel {
        let hash = |lane: u32| {
            let mut h = at.x.wrapping_mul(0x9e37_79b9)
                ^ at.y.wrapping_mul(0x85eb_ca6b)
                ^ lane.wrapping_mul(0xc2b2_ae35);
            h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
            h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
            (h ^ (h >> 16)) & 255
        };
        let height = hash(2) as f32 * 0.00390625 + if at.x > 13 { 2.5 } else { 0.0 };
        SeparableBlurPixel {
            position: Vec3::new(0.0, 0.0, height),
            reach: if hash(3) < 12 { 0.0 } else { 1.0 },
            normal: if at.y > 12 {
                Vec3::new(0.125, 0.0, 0.9921567)
            } else {
                Vec3::Z
            },
            value: if hash(4) < 12 {
                -1.0
            } else {
                hash(1) as f32 * 0.00390625
            },
        }
    }
    fn pixel(pixel: UVec2, size: UVec2, axis: u32, radius: u32) -> f32 {
        separable_blur_pixel(pixel, size, axis, radius, read)
    }
    fn exact_weight(
        distance: u32,
        radius: u32,
        n: DVec3,
        other: DVec3,
        offset: DVec3,
        reach: f64,
    ) -> f64 {
        if reach <= 0.0 {
            return 0.0;
        }
        let deviation = f64::from(radius) / 2.0;
        let gauss = (-0.5 * (f64::from(distance) / deviation).powi(2)).exp();
        let plane = n.dot(offset) / reach;
        gauss * (-(plane * plane)).exp() * (-64.0 * (n - other).length_squared()).exp()
    }
    fn exact_pixel(pixel: UVec2, size: UVec2, axis: u32, radius: u32) -> f64 {
        if pixel.cmpge(size).any() {
            return 0.0;
        }
        let wide = |v: Vec3| v.as_dvec3();
        let centre = read(pixel);
        if centre.reach <= 0.0 {
            return f64::from(centre.value).max(0.0);
        }
        let radius = i64::from(radius.min(32));
        let (mut sum, mut weights) = (0.0, 0.0);
        for i in -radius..=radius {
            let step = if axis == 0 { (i, 0) } else { (0, i) };
            let x = i64::from(pixel.x) + step.0;
            let y = i64::from(pixel.y) + step.1;
            if x < 0 || y < 0 || x >= i64::from(size.x) || y >= i64::from(size.y) {
                continue;
            }
            let tap = read(UVec2::new(x as u32, y as u32));
            if tap.value < 0.0 || tap.reach <= 0.0 {
                continue;
            }
            let w = if i == 0 {
                1.0
            } else {
                exact_weight(
                    i.unsigned_abs() as u32,
                    radius as u32,
                    wide(centre.normal),
                    wide(tap.normal),
                    wide(tap.position) - wide(centre.position),
                    centre.reach.into(),
                )
            };
            sum += w * f64::from(tap.value);
            weights += w;
        }
        if weights > 0.0 { sum / weights } else { 0.0 }
    }

    let taps = domains::below(32)
        .and(domains::below(32))
        .and(domains::unit_vector())
        .and(domains::vec3(domains::range(-0.2, 0.2)))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::log_range(0.05, 4.0))
        .map(|(((((a, b), n), tilt), offset), reach)| {
            let other = (n.as_dvec3() + tilt.as_dvec3()).normalize().as_vec3();
            (a.min(b) + 1, a.max(b) + 1, n, other, offset, reach)
        });
    let pixels: Domain<(UVec2, UVec2, u32, u32)> = domains::below(SIZE.x + 1)
        .and(domains::below(SIZE.y))
        .and(domains::below(2))
        .and(domains::below(9))
        .map(|(((x, y), axis), radius)| (UVec2::new(x, y), SIZE, axis, radius));
    // Pixels with and without a surface, with and without a value.
    let find = |wanted: &dyn Fn(&SeparableBlurPixel) -> bool| {
        (0..SIZE.x * SIZE.y)
            .map(|i| UVec2::new(i % SIZE.x, i / SIZE.x))
            .find(|at| wanted(&read(*at)))
            .expect("the image has such a pixel")
    };
    let nowhere = find(&|p| p.reach == 0.0 && p.value > 0.0);
    let negative = find(&|p| p.reach > 0.0 && p.value < 0.0);

    vec![
        Kernel::new(
            MODULE,
            "separable_blur_weight",
            [
                "distance",
                "radius",
                "normal",
                "other_normal",
                "offset",
                "reach",
            ],
            separable_blur_weight,
            exact_weight,
            taps,
        )
        .scale_by(
            |_: u32, _: u32, _: DVec3, _: DVec3, offset: DVec3, reach: f64| {
                1.0 + if reach > 0.0 {
                    offset.length() / reach
                } else {
                    0.0
                }
            },
        )
        .few_ulp(1.0, 3.75)
        .hard([
            (0, 1, Vec3::Z, Vec3::Z, Vec3::ZERO, 1.0),
            (1, 1, Vec3::Z, Vec3::Z, Vec3::X, 1e-6),
            (64, 64, Vec3::Z, Vec3::Z, Vec3::ZERO, 1.0),
            (1, 4, Vec3::Z, Vec3::Z, Vec3::ZERO, 0.0),
            (1, 4, Vec3::Z, Vec3::Z, Vec3::ZERO, -1.0),
            (1, 4, Vec3::Z, -Vec3::Z, Vec3::Z, 1.0),
            (1, 4, Vec3::Z, Vec3::Z, Vec3::Z * 1e9, 1e-9),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "separable_blur_pixel",
            ["pixel", "size", "axis", "radius"],
            pixel,
            exact_pixel,
            pixels,
        )
        // Values are in [0, 1) here.
        .scale(1.0)
        .few_ulp(1.75, 18.5)
        .hard([
            (UVec2::ZERO, UVec2::ZERO, 0, 4),
            (UVec2::ZERO, UVec2::ONE, 0, 4),
            (UVec2::ZERO, SIZE, 0, 0),
            (UVec2::ZERO, SIZE, 0, 0xffff_ffff),
            (UVec2::ZERO, SIZE, 1, 32),
            (SIZE - 1, SIZE, 0, 8),
            (SIZE - 1, SIZE, 7, 8),
            (SIZE, SIZE, 0, 8),
            (UVec2::MAX, SIZE, 0, 8),
            (nowhere, SIZE, 0, 8),
            (negative, SIZE, 0, 8),
            (negative, SIZE, 1, 0),
            (negative, negative + 1, 1, 3),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
    ]
}
