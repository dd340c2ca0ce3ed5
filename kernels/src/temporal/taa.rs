//! Temporal anti-aliasing: the pair and its contract.

pub use raytwin_cpu::temporal::taa::*;

/// The WGSL twin, without what it requires and without its callback.
pub const WGSL: &str = raytwin_wgsl::temporal::TAA;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DMat3, DVec3, UVec2, Vec3};

    const MODULE: &str = "temporal/taa";
    const KARIS: &str = "Karis 2014 (High Quality Temporal Supersampling)";
    const YCOCG: &str = "Malvar and Sullivan 2003 (YCoCg)";
    const SIZE: UVec2 = UVec2::new(16, 12);
    // The frame from a hash of the place, in exact fractions: coloured noise, a
    // flat grey strip, a black one, some pixels that do not count.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u, lane: u32) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn taa_read(at: vec2u) -> vec3f {
    if at.x > 12u {
        return vec3f(0.0, 0.0, 0.0);
    }
    let red = f32(raytwin_hash(at, 1u)) * 0.00390625;
    if at.y > 8u {
        return vec3f(red, red, red);
    }
    if raytwin_hash(at, 4u) < 12u {
        return vec3f(red, -1.0, red);
    }
    let green = f32(raytwin_hash(at, 2u)) * 0.00390625;
    let blue = f32(raytwin_hash(at, 3u)) * 0.00390625;
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
        if at.x > 12 {
            Vec3::ZERO
        } else if at.y > 8 {
            Vec3::splat(lane(1))
        } else if hash(4) < 12 {
            Vec3::new(lane(1), -1.0, lane(1))
        } else {
            Vec3::new(lane(1), lane(2), lane(3))
        }
    }
    fn pixel(pixel: UVec2, size: UVec2, history: Vec3, alpha: f32, exposure: f32) -> Vec3 {
        taa_pixel(pixel, size, history, alpha, exposure, read)
    }

    // The transform as a matrix, and the inverse as its inverse.
    fn matrix() -> DMat3 {
        DMat3::from_cols(
            DVec3::new(0.25, 0.5, -0.25),
            DVec3::new(0.5, 0.0, 0.5),
            DVec3::new(0.25, -0.5, -0.25),
        )
    }
    fn exact_clip(history: DVec3, low: DVec3, high: DVec3) -> DVec3 {
        let margin = high.x / 256.0;
        let (centre, extent) = ((low + high) / 2.0, (high - low) / 2.0 + margin);
        let away = matrix() * history - centre;
        // How many extents the farthest axis is away.
        let over = (0..3)
            .filter(|i| away[*i] != 0.0)
            .map(|i| away[i].abs() / extent[i])
            .fold(0.0, f64::max);
        if over <= 1.0 {
            return history;
        }
        (matrix().inverse() * (centre + away / over)).max(DVec3::ZERO)
    }
    fn exact_blend(history: DVec3, current: DVec3, alpha: f64, exposure: f64) -> DVec3 {
        if alpha >= 1.0 {
            return current;
        }
        if alpha <= 0.0 {
            return history;
        }
        let old = (1.0 - alpha) / (1.0 + exposure * (matrix() * history).x);
        let new = alpha / (1.0 + exposure * (matrix() * current).x);
        (history * old + current * new) / (old + new)
    }
    // The usable colours around a pixel inside the image.
    fn neighbours(pixel: UVec2) -> Vec<DVec3> {
        let p = pixel.as_ivec2();
        let mut found = Vec::new();
        for y in (p.y - 1).max(0)..=(p.y + 1).min(SIZE.y as i32 - 1) {
            for x in (p.x - 1).max(0)..=(p.x + 1).min(SIZE.x as i32 - 1) {
                let c = read(UVec2::new(x as u32, y as u32)).as_dvec3();
                if c.min_element() >= 0.0 {
                    found.push(c);
                }
            }
        }
        found
    }
    fn boxed(pixel: UVec2) -> (DVec3, DVec3) {
        let all: Vec<_> = neighbours(pixel).iter().map(|c| matrix() * *c).collect();
        let low = all.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = all.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        (low, high)
    }
    fn exact_pixel(pixel: UVec2, size: UVec2, history: DVec3, alpha: f64, exposure: f64) -> DVec3 {
        if pixel.cmpge(size).any() {
            return DVec3::ZERO;
        }
        let current = read(pixel).as_dvec3();
        let usable = current.min_element() >= 0.0;
        if history.min_element() < 0.0 || alpha >= 1.0 {
            return if usable { current } else { DVec3::ZERO };
        }
        let (low, high) = boxed(pixel);
        let clipped = exact_clip(history, low, high);
        if usable {
            exact_blend(clipped, current, alpha, exposure)
        } else {
            clipped
        }
    }
    // The clip's condition number, times the largest number that enters: an
    // error along a narrow axis moves the others by the ratio of the extents.
    fn clip_scale(history: DVec3, low: DVec3, high: DVec3) -> f64 {
        let extent = (high - low) / 2.0 + high.x / 256.0;
        let largest = history.max_element().max(high.abs().max_element());
        if extent.min_element() <= 0.0 {
            return largest.max(1e-30);
        }
        largest * (extent.max_element() / extent.min_element())
    }

    let colors = || {
        let dark = domains::below(8).map(|k| if k == 0 { 0.0f32 } else { 1.0 });
        domains::vec3(domains::log_range(1e-3, 1e3))
            .and(dark)
            .map(|(c, on)| c * on)
    };
    let boxes = || {
        // Colours of one scene, a history of another brightness.
        let scene = || domains::vec3(domains::range(0.0, 1.0));
        scene()
            .and(scene())
            .and(scene())
            .and(domains::log_range(1e-3, 1e3))
            .and(domains::log_range(1e-2, 1e2))
            .map(|((((a, b), old), bright), other)| {
                let (a, b) = (taa_ycocg(a * bright), taa_ycocg(b * bright));
                (old * (bright * other), a.min(b), a.max(b))
            })
    };
    let grey = Vec3::new(0.5, 0.0, 0.0);
    let alphas = || domains::range(0.0, 1.0);
    let pixels = domains::below(SIZE.x + 1)
        .and(domains::below(SIZE.y))
        .and(domains::vec3(domains::range(0.0, 1.0)))
        .and(alphas())
        .and(domains::range(0.0, 4.0))
        .map(|((((x, y), history), alpha), exposure)| {
            (UVec2::new(x, y), SIZE, history, alpha, exposure)
        });
    let negative = (0..SIZE.x * SIZE.y)
        .map(|i| UVec2::new(i % SIZE.x, i / SIZE.x))
        .find(|at| read(*at).y < 0.0)
        .expect("the frame has such a pixel");

    vec![
        Kernel::new(
            MODULE,
            "taa_ycocg",
            ["rgb"],
            taa_ycocg,
            |rgb: DVec3| matrix() * rgb,
            (colors(),),
        )
        // Differences of the channels.
        .scale_by(|rgb: DVec3| rgb.abs().max_element().max(1e-30))
        .few_ulp(1.0, 1.25)
        .hard([
            (Vec3::ZERO,),
            (Vec3::ONE,),
            (Vec3::splat(1e8),),
            (Vec3::new(1.0, 1e-8, 1.0),),
            (Vec3::splat(0.1),),
        ])
        .fixture(FIXTURE, vec![0])
        .source(YCOCG)
        .build(),
        Kernel::new(
            MODULE,
            "taa_rgb",
            ["ycocg"],
            taa_rgb,
            |ycocg: DVec3| matrix().inverse() * ycocg,
            colors().map(|c| (taa_ycocg(c),)),
        )
        .scale_by(|ycocg: DVec3| ycocg.abs().max_element().max(1e-30))
        .few_ulp(1.25, 2.25)
        .hard([
            (Vec3::ZERO,),
            (Vec3::X,),
            (Vec3::new(0.5, 0.0, 0.5),),
            (Vec3::new(1e8, -5e7, 5e7),),
        ])
        .fixture(FIXTURE, vec![0])
        .source(YCOCG)
        .build(),
        Kernel::new(
            MODULE,
            "taa_clip",
            ["history", "low", "high"],
            taa_clip,
            exact_clip,
            boxes(),
        )
        .scale_by(clip_scale)
        .few_ulp(3.25, 8.5)
        .hard([
            (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO),
            (Vec3::ONE, Vec3::ZERO, Vec3::ZERO),
            (Vec3::splat(0.5), grey, grey),
            (Vec3::new(0.5, 0.500244, 0.5), grey, grey),
            (Vec3::ZERO, grey, grey),
            (Vec3::splat(1e8), grey, grey),
            (
                Vec3::X,
                Vec3::new(0.0, -0.5, -0.5),
                Vec3::new(1.0, 0.5, 0.5),
            ),
            (
                Vec3::new(1e4, 0.0, 0.0),
                Vec3::new(0.1, -0.5, -0.5),
                Vec3::new(1.0, 0.0, 0.5),
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(KARIS)
        .build(),
        Kernel::new(
            MODULE,
            "taa_blend",
            ["history", "current", "alpha", "exposure"],
            taa_blend,
            exact_blend,
            (colors(), colors(), alphas(), domains::log_range(1e-3, 1e3)),
        )
        .few_ulp(8.0, 17.5)
        .hard([
            (Vec3::ZERO, Vec3::ZERO, 0.1, 1.0),
            (Vec3::splat(0.1), Vec3::splat(0.1), 0.1, 1.0),
            (Vec3::splat(1e8), Vec3::ZERO, 0.1, 1.0),
            (Vec3::ZERO, Vec3::splat(1e8), 0.1, 1.0),
            (Vec3::splat(1e8), Vec3::splat(1e8), 0.5, 1e4),
            (Vec3::ONE, Vec3::ZERO, 1.0, 1.0),
            (Vec3::ONE, Vec3::ZERO, 0.0, 1.0),
            (Vec3::ONE, Vec3::ZERO, 0.5, 0.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(KARIS)
        .baseline(
            "usual form: mix() of weights",
            "fn baseline(history: vec3f, current: vec3f, alpha: f32, exposure: f32) -> vec3f {
                let luma = vec3f(0.25, 0.5, 0.25);
                let a = 1.0 / (1.0 + exposure * dot(history, luma));
                let b = 1.0 / (1.0 + exposure * dot(current, luma));
                return mix(history * a, current * b, alpha) / mix(a, b, alpha);
            }",
            |history: Vec3, current: Vec3, alpha: f32, exposure: f32| {
                let luma = Vec3::new(0.25, 0.5, 0.25);
                let a = 1.0 / (1.0 + exposure * history.dot(luma));
                let b = 1.0 / (1.0 + exposure * current.dot(luma));
                (history * a).lerp(current * b, alpha) / (a + (b - a) * alpha)
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "taa_pixel",
            ["pixel", "size", "history", "alpha", "exposure"],
            pixel,
            exact_pixel,
            pixels,
        )
        .scale_by(|p: UVec2, size: UVec2, history: DVec3, _: f64, _: f64| {
            if p.cmpge(size).any() {
                return 1.0;
            }
            let (low, high) = boxed(p);
            clip_scale(history, low, high).max(1.0)
        })
        .few_ulp(2.0, 11.5)
        .hard([
            (UVec2::ZERO, UVec2::ZERO, Vec3::ONE, 0.1, 1.0),
            (UVec2::MAX, SIZE, Vec3::ONE, 0.1, 1.0),
            (UVec2::ZERO, SIZE, Vec3::ONE, 0.1, 1.0),
            (SIZE - 1, SIZE, Vec3::ONE, 0.1, 1.0),
            (UVec2::new(14, 3), SIZE, Vec3::ZERO, 0.1, 1.0),
            (UVec2::new(5, 10), SIZE, Vec3::X, 0.1, 1.0),
            (UVec2::new(5, 5), SIZE, Vec3::splat(-1.0), 0.1, 1.0),
            (UVec2::new(5, 5), SIZE, Vec3::ONE, 1.0, 1.0),
            (UVec2::new(5, 5), SIZE, Vec3::ONE, 0.0, 1.0),
            (negative, SIZE, Vec3::ONE, 0.1, 1.0),
            (negative, SIZE, Vec3::ONE, 1.0, 1.0),
            (negative, SIZE, Vec3::splat(-1.0), 0.1, 1.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(KARIS)
        .build(),
    ]
}
