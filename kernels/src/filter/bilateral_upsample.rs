//! Bilateral upsampling: the pair and its contract.

pub use raytwin_cpu::filter::bilateral_upsample::*;

/// The WGSL twin, without what it requires and without its callbacks.
pub const WGSL: &str = raytwin_wgsl::filter::BILATERAL_UPSAMPLE;

#[cfg(feature = "contract")]
use glam::{DVec2, DVec3, UVec2, Vec2, Vec3};

#[cfg(feature = "contract")]
crate::value_struct!(BilateralUpsamplePlace {
    near: UVec2,
    far: UVec2,
    share: Vec2,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};

    const MODULE: &str = "filter/bilateral_upsample";
    const SOURCE: &str = "Kopf et al. 2007 (joint bilateral upsampling)";
    const LOW: UVec2 = UVec2::new(16, 12);
    // Both images from a hash of the place, in exact fractions, so that
    // interval arithmetic sees the whole kernel: two floors far apart, a tilted
    // strip, holes, and a corner that fits nothing.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u, lane: u32) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn bilateral_upsample_read_surface(pixel: vec2u) -> BilateralUpsampleSurface {
    var height = f32(raytwin_hash(pixel, 1u)) * 0.0078125;
    var normal = vec3f(0.0, 0.0, 1.0);
    var reach = 1.0;
    if pixel.x > 19u {
        height = height + 5.0;
    }
    if pixel.y > 17u {
        normal = vec3f(0.125, 0.0, 0.9921567);
    }
    if raytwin_hash(pixel, 2u) < 12u {
        reach = 0.0;
    }
    if pixel.x > 27u && pixel.y > 19u {
        height = 60.0;
    }
    return BilateralUpsampleSurface(vec3f(0.0, 0.0, height), reach, normal);
}
fn bilateral_upsample_read_tap(at: vec2u) -> BilateralUpsampleTap {
    let red = f32(raytwin_hash(at, 3u)) * 0.00390625;
    let green = f32(raytwin_hash(at, 4u)) * 0.00390625;
    let blue = f32(raytwin_hash(at, 5u)) * 0.00390625;
    var height = f32(raytwin_hash(at, 6u)) * 0.0078125;
    var normal = vec3f(0.0, 0.0, 1.0);
    var weight = f32(raytwin_hash(at, 7u)) * 0.00390625;
    if at.x > 9u {
        height = height + 5.0;
    }
    if at.y > 8u {
        normal = vec3f(0.125, 0.0, 0.9921567);
    }
    if raytwin_hash(at, 8u) < 24u {
        weight = 0.0;
    }
    return BilateralUpsampleTap(
        vec3f(red, green, blue), weight, vec3f(0.0, 0.0, height), normal,
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
    const TILTED: Vec3 = Vec3::new(0.125, 0.0, 0.9921567);
    fn read_surface(pixel: UVec2) -> BilateralUpsampleSurface {
        let mut height = hash(pixel, 1) as f32 * 0.0078125;
        if pixel.x > 19 {
            height += 5.0;
        }
        if pixel.x > 27 && pixel.y > 19 {
            height = 60.0;
        }
        BilateralUpsampleSurface {
            position: Vec3::new(0.0, 0.0, height),
            reach: if hash(pixel, 2) < 12 { 0.0 } else { 1.0 },
            normal: if pixel.y > 17 { TILTED } else { Vec3::Z },
        }
    }
    fn read_tap(at: UVec2) -> BilateralUpsampleTap {
        let lane = |i: u32| hash(at, i) as f32 * 0.00390625;
        let mut height = hash(at, 6) as f32 * 0.0078125;
        if at.x > 9 {
            height += 5.0;
        }
        BilateralUpsampleTap {
            color: Vec3::new(lane(3), lane(4), lane(5)),
            weight: if hash(at, 8) < 24 { 0.0 } else { lane(7) },
            position: Vec3::new(0.0, 0.0, height),
            normal: if at.y > 8 { TILTED } else { Vec3::Z },
        }
    }
    fn pixel(pixel: UVec2, low_size: UVec2, scale: u32) -> Vec3 {
        bilateral_upsample_pixel(pixel, low_size, scale, read_surface, read_tap)
    }
    fn exact_weight(n: DVec3, other: DVec3, offset: DVec3, reach: f64) -> f64 {
        if reach <= 0.0 {
            return 0.0;
        }
        let plane = n.dot(offset) / reach;
        (-(plane * plane)).exp() * (-64.0 * (n - other).length_squared()).exp()
    }
    fn exact_place(pixel: UVec2, scale: u32) -> (UVec2, UVec2, DVec2) {
        // Twice the distance from the middle, in pixels of the full resolution;
        // in the very middle the far one, of no weight, is the lower.
        let axis = |p: u32| {
            let near = p / scale;
            let twice = 2 * i64::from(p) + 1 - i64::from(scale) * (2 * i64::from(near) + 1);
            let far = i64::from(near) + if twice > 0 { 1 } else { -1 };
            let share = twice.abs() as f64 / (2.0 * f64::from(scale));
            (near, far as u32, share)
        };
        let (x, y) = (axis(pixel.x), axis(pixel.y));
        (
            UVec2::new(x.0, y.0),
            UVec2::new(x.1, y.1),
            DVec2::new(x.2, y.2),
        )
    }
    fn exact_pixel(pixel: UVec2, low_size: UVec2, scale: u32) -> DVec3 {
        if low_size.min_element() == 0 {
            return DVec3::ZERO;
        }
        let wide = |v: Vec3| v.as_dvec3();
        let (near, far, share) = exact_place(pixel, scale);
        let surface = read_surface(pixel);
        let nearest = read_tap(near.min(low_size - 1));
        let mut weights = 2f64.powi(-24);
        let mut sum = wide(nearest.color) * weights;
        for (x, wx) in [(near.x, 1.0 - share.x), (far.x, share.x)] {
            for (y, wy) in [(near.y, 1.0 - share.y), (far.y, share.y)] {
                let at = UVec2::new(x, y);
                if at.cmplt(low_size).all() {
                    let tap = read_tap(at);
                    let fit = exact_weight(
                        wide(surface.normal),
                        wide(tap.normal),
                        wide(tap.position) - wide(surface.position),
                        surface.reach.into(),
                    );
                    let w = wx * wy * fit * f64::from(tap.weight);
                    sum += wide(tap.color) * w;
                    weights += w;
                }
            }
        }
        sum / weights
    }

    // 2 and 4 mostly, now and then another.
    let scales = || {
        domains::below(8).map(|k| match k {
            0..=2 => 2,
            3..=5 => 4,
            6 => 1,
            _ => 3,
        })
    };
    let pairs = domains::unit_vector()
        .and(domains::vec3(domains::range(-0.2, 0.2)))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::log_range(0.05, 4.0))
        .map(|(((n, tilt), offset), reach)| {
            let other = (n.as_dvec3() + tilt.as_dvec3()).normalize().as_vec3();
            (n, other, offset, reach)
        });
    let pixels: Domain<(UVec2, UVec2, u32)> = domains::below(34)
        .and(domains::below(26))
        .and(scales())
        .map(|((x, y), scale)| (UVec2::new(x, y), LOW, scale));

    vec![
        Kernel::new(
            MODULE,
            "bilateral_upsample_place",
            ["pixel", "scale"],
            bilateral_upsample_place,
            exact_place,
            domains::below(5000)
                .and(domains::below(3000))
                .and(domains::below(64))
                .map(|((x, y), scale)| (UVec2::new(x, y), scale + 1)),
        )
        .few_ulp(0.5, 2.5)
        .hard([
            (UVec2::ZERO, 1),
            (UVec2::ZERO, 2),
            (UVec2::ZERO, 4),
            (UVec2::new(1, 2), 3),
            (UVec2::new(3, 4), 4),
            (UVec2::splat((1 << 30) - 1), 64),
        ])
        .fixture(FIXTURE, vec![0])
        .source("bilinear interpolation")
        .build(),
        Kernel::new(
            MODULE,
            "bilateral_upsample_weight",
            ["normal", "other_normal", "offset", "reach"],
            bilateral_upsample_weight,
            exact_weight,
            pairs,
        )
        .scale_by(|_: DVec3, _: DVec3, offset: DVec3, reach: f64| {
            1.0 + if reach > 0.0 {
                offset.length() / reach
            } else {
                0.0
            }
        })
        .few_ulp(1.25, 3.25)
        .hard([
            (Vec3::Z, Vec3::Z, Vec3::ZERO, 1.0),
            (Vec3::Z, Vec3::Z, Vec3::X, 1e-6),
            (Vec3::Z, Vec3::Z, Vec3::ZERO, 0.0),
            (Vec3::Z, Vec3::Z, Vec3::ZERO, -1.0),
            (Vec3::Z, -Vec3::Z, Vec3::Z, 1.0),
            (Vec3::Z, Vec3::Z, Vec3::Z * 1e9, 1e-9),
            (Vec3::Z, Vec3::Z, Vec3::X * 1e4, 1.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source("plane distance and normals as in filter/bilateral_variance")
        .baseline(
            "usual form: depth difference and pow(n.n', 128)",
            "fn baseline(n: vec3f, other: vec3f, offset: vec3f, reach: f32) -> f32 {
                if reach <= 0.0 {
                    return 0.0;
                }
                let p = dot(n, offset) / reach;
                return exp(-p * p) * pow(max(dot(n, other), 0.0), 128.0);
            }",
            |n: Vec3, other: Vec3, offset: Vec3, reach: f32| {
                if reach <= 0.0 {
                    return 0.0;
                }
                let p = n.dot(offset) / reach;
                (-p * p).exp() * n.dot(other).max(0.0).powf(128.0)
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "bilateral_upsample_pixel",
            ["pixel", "low_size", "scale"],
            pixel,
            exact_pixel,
            pixels,
        )
        // Colours are in [0, 1) here.
        .scale(1.0)
        .few_ulp(2.25, 108.0)
        .hard([
            (UVec2::ZERO, UVec2::ZERO, 2),
            (UVec2::ZERO, UVec2::new(0, 5), 4),
            (UVec2::ZERO, UVec2::ONE, 2),
            (UVec2::ZERO, LOW, 2),
            (UVec2::new(31, 23), LOW, 2),
            // Beyond the last pixel of the low resolution.
            (UVec2::new(32, 24), LOW, 2),
            (UVec2::new(1000, 1000), LOW, 4),
            // Nothing fits.
            (UVec2::new(30, 22), LOW, 2),
            (UVec2::new(30, 22), LOW, 4),
            (UVec2::new(5, 5), LOW, 1),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
    ]
}
