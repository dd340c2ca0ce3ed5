//! SVGF's spatial half: the pair and its contract.

pub use raytwin_cpu::filter::svgf::*;

/// The WGSL twin, without what it requires and without its callbacks.
pub const WGSL: &str = raytwin_wgsl::filter::SVGF;

#[cfg(feature = "contract")]
crate::value_struct!(SvgfSettings {
    alpha: f32,
    moments_alpha: f32,
    history: f32,
    sigma_depth: f32,
    sigma_luminance: f32,
    squarings: u32,
    radius: u32,
    passes: u32,
    feedback: u32,
});

#[cfg(feature = "contract")]
crate::value_struct!([] SvgfColor = SvgfColor {
    value: glam::Vec3,
    variance: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!([] SvgfScalar = SvgfScalar {
    value: f32,
    variance: f32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};
    use glam::{DVec2, DVec3, UVec2, Vec2, Vec3};

    const MODULE: &str = "filter/svgf";
    const PAPER: &str = "Schied et al. 2017, section 4.4";
    const PASS: &str = "Schied et al. 2017, section 4.3";
    const VARIANCE: &str = "Schied et al. 2017, section 4.2; West 1979";
    const OURS: &str = "Schied et al. 2017, section 4.4, with a plane distance";
    const SIZE: UVec2 = UVec2::new(24, 20);
    // The image from a hash of the place, in exact fractions, so that interval
    // arithmetic sees the whole kernel: two floors, a tilted strip, holes, and
    // pixels of 1e30 or with a variance of 3e37, which are no data.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u, lane: u32) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn svgf_read_surface(at: vec2u) -> SvgfSurface {
    var height = f32(raytwin_hash(at, 3u)) * 0.00390625;
    var normal = vec3f(0.0, 0.0, 1.0);
    var reach = 2.0;
    if at.x > 13u {
        height = height + 9.0;
    }
    if at.y > 12u {
        normal = vec3f(0.125, 0.0, 0.9921567);
    }
    if raytwin_hash(at, 1u) < 16u {
        reach = 0.0;
    }
    return SvgfSurface(vec3f(f32(at.x), f32(at.y), height), reach, normal);
}
fn svgf_read_scalar(at: vec2u) -> SvgfScalar {
    var value = f32(raytwin_hash(at, 4u)) * 0.00390625;
    var variance = f32((raytwin_hash(at, 2u) & 63u) + 1u) * 0.0009765625;
    if raytwin_hash(at, 7u) < 8u {
        value = 1e30;
    }
    if raytwin_hash(at, 8u) < 4u {
        variance = 3e37;
    }
    if raytwin_hash(at, 8u) > 252u {
        variance = -1.0;
    }
    return SvgfScalar(value, variance);
}
fn svgf_read_color(at: vec2u) -> SvgfColor {
    let red = svgf_read_scalar(at);
    let green = f32(raytwin_hash(at, 5u)) * 0.00390625;
    let blue = f32(raytwin_hash(at, 6u)) * 0.00390625;
    return SvgfColor(vec3f(red.value, green, blue), red.variance);
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
    fn fraction(at: UVec2, lane: u32) -> f32 {
        hash(at, lane) as f32 * 0.00390625
    }
    fn read_surface(at: UVec2) -> SvgfSurface {
        let step = if at.x > 13 { 9.0 } else { 0.0 };
        SvgfSurface {
            position: Vec3::new(at.x as f32, at.y as f32, fraction(at, 3) + step),
            reach: if hash(at, 1) < 16 { 0.0 } else { 2.0 },
            normal: if at.y > 12 {
                Vec3::new(0.125, 0.0, 0.9921567)
            } else {
                Vec3::Z
            },
        }
    }
    fn read_scalar(at: UVec2) -> SvgfScalar {
        SvgfScalar {
            value: if hash(at, 7) < 8 {
                1e30
            } else {
                fraction(at, 4)
            },
            variance: match hash(at, 8) {
                0..=3 => 3e37,
                253.. => -1.0,
                _ => ((hash(at, 2) & 63) + 1) as f32 * 0.0009765625,
            },
        }
    }
    fn read_color(at: UVec2) -> SvgfColor {
        let red = read_scalar(at);
        SvgfColor {
            value: Vec3::new(red.value, fraction(at, 5), fraction(at, 6)),
            variance: red.variance,
        }
    }
    fn gaussian_pixel(pixel: UVec2, size: UVec2) -> f32 {
        svgf_gaussian_pixel(pixel, size, read_color)
    }
    fn gaussian_scalar_pixel(pixel: UVec2, size: UVec2) -> f32 {
        svgf_gaussian_scalar_pixel(pixel, size, read_scalar)
    }
    fn variance_pixel(pixel: UVec2, size: UVec2, history: f32, settings: SvgfSettings) -> f32 {
        svgf_variance_pixel(pixel, size, history, settings, read_surface, read_color)
    }
    fn variance_scalar_pixel(
        pixel: UVec2,
        size: UVec2,
        history: f32,
        settings: SvgfSettings,
    ) -> f32 {
        svgf_variance_scalar_pixel(pixel, size, history, settings, read_surface, read_scalar)
    }
    fn atrous_pixel(pixel: UVec2, size: UVec2, step: u32, settings: SvgfSettings) -> SvgfColor {
        svgf_atrous_pixel(pixel, size, step, settings, read_surface, read_color)
    }
    fn atrous_scalar_pixel(
        pixel: UVec2,
        size: UVec2,
        step: u32,
        settings: SvgfSettings,
    ) -> SvgfScalar {
        svgf_atrous_scalar_pixel(pixel, size, step, settings, read_surface, read_scalar)
    }

    // The truth: a pixel's data as the paper sees it, wide, and whether it is
    // any; formulas as printed, sums over lists.
    type WideSettings = (f64, f64, f64, f64, f64, u32, u32, u32, u32);
    #[derive(Clone, Copy)]
    struct Wide {
        value: DVec3,
        light: f64,
        variance: f64,
        value_known: bool,
        variance_known: bool,
    }
    fn wide_color(at: UVec2) -> Wide {
        let tap = read_color(at);
        let value = tap.value.as_dvec3();
        Wide {
            value,
            light: value.dot(DVec3::new(0.2126, 0.7152, 0.0722)),
            variance: f64::from(tap.variance).max(0.0),
            value_known: value.abs().max_element() < 1e18,
            variance_known: tap.variance < 1e36,
        }
    }
    fn wide_scalar(at: UVec2) -> Wide {
        let tap = read_scalar(at);
        Wide {
            value: DVec3::splat(tap.value.into()),
            light: tap.value.into(),
            variance: f64::from(tap.variance).max(0.0),
            value_known: tap.value < 1e18,
            variance_known: tap.variance < 1e36,
        }
    }
    fn exact_normal(n: DVec3, other: DVec3, squarings: u32) -> f64 {
        // The cosine of unit vectors by their chord.
        let cosine = (1.0 - 0.5 * (n - other).length_squared()).max(0.0);
        cosine.powi(1 << squarings.min(16))
    }
    fn exact_geometry(p: UVec2, q: UVec2, sigma: f64, squarings: u32) -> f64 {
        let (a, b) = (read_surface(p), read_surface(q));
        if a.reach <= 0.0 || b.reach <= 0.0 {
            return 0.0;
        }
        let (n, other) = (a.normal.as_dvec3(), b.normal.as_dvec3());
        let plane = n.dot(b.position.as_dvec3() - a.position.as_dvec3()).abs();
        (-plane / (sigma * f64::from(a.reach))).exp() * exact_normal(n, other, squarings)
    }
    fn around(pixel: UVec2, size: UVec2, radius: i64, step: i64) -> Vec<(i64, i64, UVec2)> {
        let mut places = Vec::new();
        for dx in -radius..=radius {
            for dy in -radius..=radius {
                let (x, y) = (
                    i64::from(pixel.x) + dx * step,
                    i64::from(pixel.y) + dy * step,
                );
                if x >= 0 && y >= 0 && x < size.x.into() && y < size.y.into() {
                    places.push((dx, dy, UVec2::new(x as u32, y as u32)));
                }
            }
        }
        places
    }
    fn exact_gaussian(pixel: UVec2, size: UVec2, read: fn(UVec2) -> Wide) -> f64 {
        if pixel.cmpge(size).any() {
            return 0.0;
        }
        let (mut sum, mut total) = (0.0, 0.0);
        for (dx, dy, at) in around(pixel, size, 1, 1) {
            let tap = read(at);
            if tap.variance_known {
                let w = 0.25 / f64::from(1 << (dx.abs() + dy.abs()));
                sum += w * tap.variance;
                total += w;
            }
        }
        if total == 0.0 { 0.0 } else { sum / total }
    }
    fn exact_variance(
        pixel: UVec2,
        size: UVec2,
        history: f64,
        settings: WideSettings,
        read: fn(UVec2) -> Wide,
    ) -> f64 {
        if pixel.cmpge(size).any() {
            return 0.0;
        }
        let centre = read(pixel);
        let nowhere = read_surface(pixel).reach <= 0.0;
        if centre.variance_known && (history >= settings.2 || nowhere) {
            return centre.variance;
        }
        let taps: Vec<_> = around(pixel, size, 3, 1)
            .into_iter()
            .map(|(_, _, at)| (exact_geometry(pixel, at, settings.3, settings.5), read(at)))
            .filter(|(w, tap)| *w > 0.0 && tap.value_known)
            .collect();
        let total: f64 = taps.iter().map(|t| t.0).sum();
        if total < 1e-9 {
            return 0.0;
        }
        let mean = taps.iter().map(|t| t.0 * t.1.light).sum::<f64>() / total;
        let spread: f64 = taps.iter().map(|t| t.0 * (t.1.light - mean).powi(2)).sum();
        let squares: f64 = taps.iter().map(|t| t.0 * t.0).sum();
        // Reliability weights; at most doubled.
        spread / total / (1.0 - squares / (total * total)).max(0.5)
    }
    fn exact_atrous(
        pixel: UVec2,
        size: UVec2,
        step: u32,
        settings: WideSettings,
        read: fn(UVec2) -> Wide,
    ) -> (DVec3, f64) {
        if pixel.cmpge(size).any() {
            return (DVec3::ZERO, 0.0);
        }
        let centre = read(pixel);
        let known = centre.value_known && centre.variance_known;
        if read_surface(pixel).reach <= 0.0 {
            return if known {
                (centre.value, centre.variance)
            } else {
                (DVec3::ZERO, 0.0)
            };
        }
        let deviation = exact_gaussian(pixel, size, read).sqrt();
        let scale = settings.4 * deviation + 1e-4 * centre.light.abs();
        let spline = |i: i64| [0.375, 0.25, 0.0625][i.unsigned_abs() as usize];
        let (mut value, mut variance, mut total) = (DVec3::ZERO, 0.0, 0.0);
        let step = i64::from(step.min(1 << 20));
        for (dx, dy, at) in around(pixel, size, settings.6.min(2).into(), step) {
            let tap = read(at);
            if !tap.value_known || !tap.variance_known {
                continue;
            }
            let apart = if known && tap.light != centre.light {
                (tap.light - centre.light).abs() / scale
            } else {
                0.0
            };
            let w = spline(dx)
                * spline(dy)
                * exact_geometry(pixel, at, settings.3, settings.5)
                * (-apart).exp();
            value += tap.value * w;
            variance += tap.variance * w * w;
            total += w;
        }
        if total < 1e-12 {
            return (DVec3::ZERO, 0.0);
        }
        (value / total, variance / (total * total))
    }

    // The usual form beside it: moments that cancel.
    const MOMENTS_WGSL: &str = "
fn baseline(pixel: vec2u, size: vec2u, history: f32, settings: SvgfSettings) -> f32 {
    let own = svgf_read_scalar(pixel);
    let centre = svgf_read_surface(pixel);
    let known = own.variance < 1e36;
    if known && (history >= settings.history || centre.reach <= 0.0) {
        return max(own.variance, 0.0);
    }
    if centre.reach <= 0.0 {
        return 0.0;
    }
    var squares = 0.0;
    var first = 0.0;
    var second = 0.0;
    var sum = 0.0;
    for (var dy = -3; dy <= 3; dy++) {
        for (var dx = -3; dx <= 3; dx++) {
            let at = vec2i(pixel) + vec2i(dx, dy);
            if any(at < vec2i(0)) || any(at >= vec2i(size)) {
                continue;
            }
            let surface = svgf_read_surface(vec2u(at));
            let tap = svgf_read_scalar(vec2u(at));
            if surface.reach <= 0.0 || tap.value > 1e18 {
                continue;
            }
            let c = max(dot(centre.normal, surface.normal), 0.0);
            let plane = abs(dot(centre.normal, surface.position - centre.position));
            let w = pow(c, f32(1u << settings.squarings))
                * exp(-plane / (settings.sigma_depth * centre.reach));
            first += w * tap.value;
            second += w * tap.value * tap.value;
            squares += w * w;
            sum += w;
        }
    }
    if sum <= 1e-9 {
        return 0.0;
    }
    first /= sum;
    return max(second / sum - first * first, 0.0) / max(1.0 - squares / (sum * sum), 0.5);
}
";
    fn moments(pixel: UVec2, size: UVec2, history: f32, settings: SvgfSettings) -> f32 {
        let own = read_scalar(pixel);
        let centre = read_surface(pixel);
        let known = own.variance < 1e36;
        if known && (history >= settings.history || centre.reach <= 0.0) {
            return own.variance.max(0.0);
        }
        if centre.reach <= 0.0 {
            return 0.0;
        }
        let (mut first, mut second, mut sum, mut squares) = (0.0, 0.0, 0.0, 0.0);
        for (_, _, at) in around(pixel, size, 3, 1) {
            let (surface, tap) = (read_surface(at), read_scalar(at));
            if surface.reach <= 0.0 || tap.value > 1e18 {
                continue;
            }
            let c = centre.normal.dot(surface.normal).max(0.0);
            let plane = centre.normal.dot(surface.position - centre.position).abs();
            let w = c.powi(1 << settings.squarings)
                * (-plane / (settings.sigma_depth * centre.reach)).exp();
            first += w * tap.value;
            second += w * tap.value * tap.value;
            squares += w * w;
            sum += w;
        }
        if sum <= 1e-9 {
            return 0.0;
        }
        first /= sum;
        let spread: f32 = second / sum - first * first;
        spread.max(0.0) / (1.0 - squares / (sum * sum)).max(0.5)
    }

    let normals = || {
        domains::unit_vector()
            .and(domains::vec3(domains::range(-0.3, 0.3)))
            .map(|(n, tilt)| {
                let other = (n.as_dvec3() + tilt.as_dvec3()).normalize().as_vec3();
                (n, other)
            })
    };
    let weights = normals()
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::log_range(0.25, 64.0))
        .and(domains::range(-1.0, 1.0))
        .and(domains::log_range(0.25, 256.0))
        .and(domains::below(8))
        .map(
            |((((((n, other), offset), depth), difference), light), squarings)| {
                (n, other, offset, depth, difference, light, squarings)
            },
        );
    let settings = || {
        domains::range(0.5, 2.0)
            .and(domains::range(1.0, 16.0))
            .and(domains::below(8))
            .and(domains::below(3))
            .map(
                |(((sigma_depth, sigma_luminance), squarings), radius)| SvgfSettings {
                    sigma_depth,
                    sigma_luminance,
                    squarings,
                    radius,
                    ..SvgfSettings::PAPER
                },
            )
    };
    let places = || {
        domains::below(SIZE.x)
            .and(domains::below(SIZE.y))
            .map(|(x, y)| UVec2::new(x, y))
    };
    let passes = || -> Domain<(UVec2, UVec2, u32, SvgfSettings)> {
        places()
            .and(domains::below(5))
            .and(settings())
            .map(|((at, pass), settings)| (at, SIZE, 1 << pass, settings))
    };
    let estimates = || -> Domain<(UVec2, UVec2, f32, SvgfSettings)> {
        places()
            .and(domains::below(16))
            .and(settings())
            .map(|((at, history), settings)| (at, SIZE, history as f32, settings))
    };
    let find = |wanted: &dyn Fn(SvgfSurface, SvgfScalar) -> bool| {
        (0..SIZE.x * SIZE.y)
            .map(|i| UVec2::new(i % SIZE.x, i / SIZE.x))
            .find(|at| wanted(read_surface(*at), read_scalar(*at)))
            .expect("the image has such a pixel")
    };
    let bright = find(&|s, c| s.reach > 0.0 && c.value > 1e18);
    let unsure = find(&|s, c| s.reach > 0.0 && c.variance > 1e36);
    let nowhere = find(&|s, c| s.reach == 0.0 && c.value < 1e18);
    let below = find(&|s, c| s.reach > 0.0 && c.variance < 0.0);
    let (paper, blog) = (SvgfSettings::PAPER, SvgfSettings::BLOG);
    let corners = [
        UVec2::ZERO,
        UVec2::new(SIZE.x - 1, SIZE.y - 1),
        UVec2::new(0, SIZE.y - 1),
        UVec2::new(13, 12),
        UVec2::new(14, 13),
        bright,
        unsure,
        nowhere,
        below,
    ];
    let outside = [
        (UVec2::splat(0xffff_ffff), SIZE),
        (UVec2::new(SIZE.x, 0), SIZE),
        (UVec2::ZERO, UVec2::ZERO),
    ];
    let hard_gaussian = || {
        let inside = corners.map(|at| (at, SIZE));
        inside
            .into_iter()
            .chain(outside)
            .chain([(UVec2::ZERO, UVec2::ONE)])
    };
    let hard_variance = || {
        let inside = corners.map(|at| (at, SIZE, 1.0, paper));
        let known = corners.map(|at| (at, SIZE, 4.0, paper));
        let beyond = outside.map(|(at, size)| (at, size, 0.0, paper));
        inside.into_iter().chain(known).chain(beyond).chain([
            (UVec2::new(3, 3), SIZE, 0.0, blog),
            // A pixel alone.
            (UVec2::ZERO, UVec2::ONE, 0.0, paper),
        ])
    };
    let hard_atrous = || {
        let near = corners.map(|at| (at, SIZE, 1, paper));
        let far = corners.map(|at| (at, SIZE, 16, paper));
        let soft = corners.map(|at| (at, SIZE, 2, blog));
        let beyond = outside.map(|(at, size)| (at, size, 1, paper));
        near.into_iter()
            .chain(far)
            .chain(soft)
            .chain(beyond)
            .chain([
                (UVec2::new(3, 3), SIZE, 0, paper),
                (UVec2::new(3, 3), SIZE, 0xffff_ffff, paper),
                (
                    UVec2::new(3, 3),
                    SIZE,
                    1,
                    SvgfSettings { radius: 9, ..paper },
                ),
                (
                    UVec2::new(3, 3),
                    SIZE,
                    1,
                    SvgfSettings { radius: 0, ..paper },
                ),
                (UVec2::ZERO, UVec2::ONE, 1, paper),
            ])
    };

    vec![
        Kernel::new(
            MODULE,
            "svgf_falloff",
            ["scale"],
            svgf_falloff,
            |scale: f64| 1.0 / scale.max((-60f64).exp2()),
            (domains::log_range(1e-20, 1e10),),
        )
        .few_ulp(0.5, 2.5)
        .hard([0.0, -1.0, 1.0, 1e-30, 8.6736174e-19, 1e18].map(|s| (s,)))
        .fixture(FIXTURE, vec![0])
        .source("a reciprocal, capped; our form")
        .build(),
        Kernel::new(
            MODULE,
            "svgf_luminance_scale",
            ["variance", "luminance", "sigma"],
            svgf_luminance_scale,
            |variance: f64, luminance: f64, sigma: f64| {
                sigma * variance.max(0.0).sqrt() + 1e-4 * luminance.abs()
            },
            (
                domains::log_range(1e-12, 1e8),
                domains::signed_log_range(1e-6, 1e6),
                domains::range(0.5, 16.0),
            ),
        )
        .few_ulp(2.0, 8.5)
        .hard([
            (0.0, 0.0, 4.0),
            (0.0, 1.0, 4.0),
            (1.0, 0.0, 4.0),
            (-1.0, -1.0, 4.0),
            (1e36, 1e18, 4.0),
            (1e-30, 1e-15, 4.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(PAPER)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_luminance_weight",
            ["difference", "scale"],
            svgf_luminance_weight,
            |difference: f64, scale: f64| (-difference.abs() / scale.max((-60f64).exp2())).exp(),
            (
                domains::signed_log_range(1e-6, 1e4),
                domains::log_range(1e-6, 1e4),
            ),
        )
        .scale(1.0)
        .few_ulp(0.75, 2.25)
        .hard([
            (0.0, 0.0),
            (0.0, 1.0),
            (1.0, 0.0),
            (-1.0, 1.0),
            (1e18, 0.0),
            (1e18, 1e18),
            (1e-15, 1e-15),
            (87.0, 1.0),
            (88.5, 1.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(PAPER)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_depth_weight",
            ["normal", "offset", "reach"],
            svgf_depth_weight,
            |n: DVec3, offset: DVec3, reach: f64| (-n.dot(offset).abs() / reach).exp(),
            (
                domains::unit_vector(),
                domains::vec3(domains::range(-1.0, 1.0)),
                domains::log_range(0.02, 4.0),
            ),
        )
        .scale_by(|_: DVec3, offset: DVec3, reach: f64| 1.0 + offset.length() / reach)
        .few_ulp(1.0, 2.5)
        .hard([
            (Vec3::Z, Vec3::ZERO, 1.0),
            (Vec3::Z, Vec3::Z, 1.0),
            (Vec3::Z, Vec3::X * 1e6, 1e-3),
            (Vec3::Z, Vec3::Z * 1e18, 1e-15),
            (Vec3::Y, Vec3::new(0.0, 0.0, 30.0), 1e-3),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_depth_weight_gradient",
            ["difference", "depth", "gradient", "offset", "sigma"],
            svgf_depth_weight_gradient,
            |difference: f64, depth: f64, gradient: DVec2, offset: DVec2, sigma: f64| {
                let scale = sigma * gradient.dot(offset).abs() + 1e-3 * depth.abs();
                if difference == 0.0 {
                    1.0
                } else {
                    (-difference.abs() / scale.max((-60f64).exp2())).exp()
                }
            },
            domains::signed_log_range(1e-3, 10.0)
                .and(domains::log_range(1.0, 1e3))
                .and(domains::signed_log_range(1e-4, 0.1))
                .and(domains::signed_log_range(1e-4, 0.1))
                .and(domains::below(5).and(domains::below(5)))
                .and(domains::range(0.5, 4.0))
                .map(|(((((difference, depth), gx), gy), (x, y)), sigma)| {
                    let offset = Vec2::new(x as f32 - 2.0, y as f32 - 2.0);
                    (difference, depth, Vec2::new(gx, gy), offset, sigma)
                }),
        )
        // The predicted slope may cancel, down to the floor.
        .scale_by(
            |_: f64, depth: f64, gradient: DVec2, offset: DVec2, sigma: f64| {
                let terms = sigma * (gradient * offset).abs().element_sum();
                let scale = sigma * gradient.dot(offset).abs() + 1e-3 * depth.abs();
                1.0 + terms / scale.max(1e-18)
            },
        )
        .few_ulp(1.0, 2.75)
        .hard([
            (0.0, 0.0, Vec2::ZERO, Vec2::ZERO, 1.0),
            (0.0, 10.0, Vec2::ZERO, Vec2::ONE, 1.0),
            (1e-3, 10.0, Vec2::ZERO, Vec2::ONE, 1.0),
            (1.0, 0.0, Vec2::ZERO, Vec2::ONE, 1.0),
            (-1.0, 10.0, Vec2::ONE, Vec2::new(1.0, -1.0), 1.0),
            (1e6, 1e-6, Vec2::ONE, Vec2::splat(32.0), 1.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(PAPER)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_normal_weight",
            ["normal", "other_normal", "squarings"],
            svgf_normal_weight,
            exact_normal,
            normals()
                .and(domains::below(8))
                .map(|((n, other), squarings)| (n, other, squarings)),
        )
        .scale(1.0)
        .by_ends(
            &[("svgf_normal_weight", "y")],
            "y(2 - y) rises with y from 0 to 1, where y stays",
        )
        .few_ulp(1.75, 4.0)
        .hard([
            (Vec3::Z, Vec3::Z, 7),
            (Vec3::Z, -Vec3::Z, 7),
            (Vec3::Z, Vec3::X, 7),
            (Vec3::Z, Vec3::X, 0),
            (Vec3::Z, Vec3::new(1e-4, 0.0, 1.0), 7),
            (Vec3::Z, Vec3::new(0.125, 0.0, 0.9921567), 7),
            (Vec3::splat(0.57735026), Vec3::splat(0.57735026), 16),
        ])
        .fixture(FIXTURE, vec![0])
        .source(PAPER)
        .baseline(
            "the cosine squared again and again",
            "fn baseline(n: vec3f, other: vec3f, squarings: u32) -> f32 {
                var c = max(dot(n, other), 0.0);
                for (var i = 0u; i < squarings; i++) {
                    c *= c;
                }
                return c;
            }",
            |n: Vec3, other: Vec3, squarings: u32| {
                (0..squarings).fold(n.dot(other).max(0.0), |c, _| c * c)
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "svgf_weight",
            [
                "normal",
                "other_normal",
                "offset",
                "depth_falloff",
                "difference",
                "luminance_falloff",
                "squarings",
            ],
            svgf_weight,
            |n: DVec3,
             other: DVec3,
             offset: DVec3,
             depth: f64,
             difference: f64,
             light: f64,
             squarings: u32| {
                (-n.dot(offset).abs() * depth).exp()
                    * (-difference.abs() * light).exp()
                    * exact_normal(n, other, squarings)
            },
            weights,
        )
        .scale_by(
            |_: DVec3, _: DVec3, offset: DVec3, depth: f64, _: f64, _: f64, _: u32| {
                1.0 + offset.length() * depth
            },
        )
        .by_ends(
            &[("svgf_normal_weight", "y")],
            "y(2 - y) rises with y from 0 to 1, where y stays",
        )
        .few_ulp(1.75, 3.25)
        .hard([
            (Vec3::Z, Vec3::Z, Vec3::ZERO, 1.0, 0.0, 1.0, 7),
            (Vec3::Z, Vec3::Z, Vec3::X, 1e18, 0.0, 1e18, 7),
            (Vec3::Z, Vec3::Z, Vec3::Z, 1e18, 1e18, 1e18, 7),
            (Vec3::Z, -Vec3::Z, Vec3::ZERO, 1.0, 0.0, 1.0, 7),
            (Vec3::Z, Vec3::Z, Vec3::Z, 0.0, 5.0, 0.0, 7),
            (
                Vec3::Z,
                Vec3::new(0.125, 0.0, 0.9921567),
                Vec3::X,
                1.0,
                0.5,
                8.0,
                5,
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_gaussian_pixel",
            ["pixel", "size"],
            gaussian_pixel,
            |pixel: UVec2, size: UVec2| exact_gaussian(pixel, size, wide_color),
            places().map(|at| (at, SIZE)),
        )
        .few_ulp(0.5, 2.75)
        .hard(hard_gaussian())
        .fixture(FIXTURE, vec![0])
        .source(PAPER)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_gaussian_scalar_pixel",
            ["pixel", "size"],
            gaussian_scalar_pixel,
            |pixel: UVec2, size: UVec2| exact_gaussian(pixel, size, wide_scalar),
            places().map(|at| (at, SIZE)),
        )
        .few_ulp(0.5, 2.75)
        .hard(hard_gaussian())
        .fixture(FIXTURE, vec![0])
        .source(PAPER)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_variance_pixel",
            ["pixel", "size", "history", "settings"],
            variance_pixel,
            |pixel: UVec2, size: UVec2, history: f64, settings: WideSettings| {
                exact_variance(pixel, size, history, settings, wide_color)
            },
            estimates(),
        )
        // Luminance is in [0, 1) here; a variance is made of differences of it.
        .scale(1.0)
        .few_ulp(0.75, 52.0)
        .hard(hard_variance())
        .fixture(FIXTURE, vec![0])
        .source(VARIANCE)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_variance_scalar_pixel",
            ["pixel", "size", "history", "settings"],
            variance_scalar_pixel,
            |pixel: UVec2, size: UVec2, history: f64, settings: WideSettings| {
                exact_variance(pixel, size, history, settings, wide_scalar)
            },
            estimates(),
        )
        .scale(1.0)
        .few_ulp(1.0, 60.0)
        .hard(hard_variance())
        .fixture(FIXTURE, vec![0])
        .source(VARIANCE)
        .baseline("E[x^2] - E[x]^2, pow and exp", MOMENTS_WGSL, moments)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_atrous_pixel",
            ["pixel", "size", "step", "settings"],
            atrous_pixel,
            |pixel: UVec2, size: UVec2, step: u32, settings: WideSettings| {
                exact_atrous(pixel, size, step, settings, wide_color)
            },
            passes(),
        )
        // Values are in [0, 1) here; each sum has 25 roundings.
        .scale(1.0)
        .few_ulp(3.5, 34.0)
        .hard(hard_atrous())
        .fixture(FIXTURE, vec![0])
        .source(PASS)
        .build(),
        Kernel::new(
            MODULE,
            "svgf_atrous_scalar_pixel",
            ["pixel", "size", "step", "settings"],
            atrous_scalar_pixel,
            |pixel: UVec2, size: UVec2, step: u32, settings: WideSettings| {
                let (value, variance) = exact_atrous(pixel, size, step, settings, wide_scalar);
                (value.x, variance)
            },
            passes(),
        )
        .scale(1.0)
        .few_ulp(3.75, 20.0)
        .hard(hard_atrous())
        .fixture(FIXTURE, vec![0])
        .source(PASS)
        .build(),
    ]
}
