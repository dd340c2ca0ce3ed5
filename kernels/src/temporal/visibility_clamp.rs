//! Visibility clamp: the pair and its contract.

pub use raytwin_cpu::temporal::visibility_clamp::*;

/// The WGSL twin, without the callbacks of `filter/packed_visibility`.
pub const WGSL: &str = raytwin_wgsl::temporal::VISIBILITY_CLAMP;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::UVec2;

    const MODULE: &str = "temporal/visibility_clamp";
    const SOURCE: &str = "FidelityFX Denoiser 1.x (17 x 17 mean, half a deviation)";
    // Words from a hash of the block: a soft shadow from left to right, its
    // ends all lit and all dark; the rows' sums are those of the same words.
    const FIXTURE: &str = "
fn raytwin_hash(at: vec2u) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return h ^ (h >> 16u);
}
fn packed_visibility_read(block: vec2u) -> u32 {
    let word = raytwin_hash(block);
    let other = raytwin_hash(block + vec2u(100u, 0u));
    switch block.x {
        case 0u, 1u, 2u: { return 0u; }
        case 3u: { return word & other; }
        case 4u: { return word; }
        case 5u: { return word | other; }
        default: { return 0xffffffffu; }
    }
}
fn packed_visibility_read_row(pixel: vec2u) -> u32 {
    return packed_visibility_horizontal(pixel, vec2u(75u, 41u));
}
";
    const SIZE: UVec2 = UVec2::new(75, 41);
    fn hash(at: UVec2) -> u32 {
        let mut h = at.x.wrapping_mul(0x9e37_79b9) ^ at.y.wrapping_mul(0x85eb_ca6b);
        h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
        h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
        h ^ (h >> 16)
    }
    fn read(block: UVec2) -> u32 {
        let (word, other) = (hash(block), hash(block + UVec2::new(100, 0)));
        match block.x {
            0..=2 => 0,
            3 => word & other,
            4 => word,
            5 => word | other,
            _ => !0,
        }
    }
    fn read_row(pixel: UVec2) -> u32 {
        crate::filter::packed_visibility::packed_visibility_horizontal(pixel, SIZE, read)
    }
    fn pixel(pixel: UVec2, size: UVec2, history: f32, gamma: f32) -> f32 {
        visibility_clamp_pixel(pixel, size, history, gamma, read)
    }
    fn rows(pixel: UVec2, size: UVec2, history: f32, gamma: f32) -> f32 {
        visibility_clamp_rows_pixel(pixel, size, history, gamma, read_row)
    }
    fn exact_limit(history: f64, mean: f64, variance: f64, gamma: f64) -> f64 {
        if history.is_nan() || history.abs() > 1e15 {
            return mean;
        }
        let reach = gamma * variance.sqrt();
        history.clamp((mean - reach).max(0.0), (mean + reach).min(1.0))
    }
    // Ray by ray, the variance by its definition.
    fn exact_pixel(pixel: UVec2, size: UVec2, history: f64, gamma: f64) -> f64 {
        if pixel.cmpge(size).any() {
            return 1.0;
        }
        let near = |at: u32, end: u32| {
            (i64::from(at) - 8..=i64::from(at) + 8).filter(move |i| (0..i64::from(end)).contains(i))
        };
        let rays: Vec<f64> = near(pixel.y, size.y)
            .flat_map(|y| near(pixel.x, size.x).map(move |x| (x, y)))
            .map(|(x, y)| {
                let word = read(UVec2::new((x / 8) as u32, (y / 4) as u32));
                f64::from(word >> (8 * (y % 4) + x % 8) & 1)
            })
            .collect();
        let n = rays.len() as f64;
        let mean = rays.iter().sum::<f64>() / n;
        let variance = rays.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / n;
        exact_limit(history, mean, variance, gamma)
    }
    // The usual form: zeros outside the image, and 289 all the same.
    const NAIVE_WGSL: &str = "
fn baseline(pixel: vec2u, size: vec2u, history: f32, gamma: f32) -> f32 {
    let mean = f32(packed_visibility_sum(pixel, size)) / 289.0;
    let reach = gamma * sqrt(max(mean - mean * mean, 0.0));
    return clamp(history, mean - reach, mean + reach);
}";
    fn naive(pixel: UVec2, size: UVec2, history: f32, gamma: f32) -> f32 {
        use crate::filter::packed_visibility::packed_visibility_sum;
        let mean = packed_visibility_sum(pixel, size, read) as f32 / 289.0;
        let reach = gamma * (mean - mean * mean).max(0.0).sqrt();
        history.max(mean - reach).min(mean + reach)
    }

    // Histories a little beyond what a visibility can be.
    let history = || domains::range(-0.25, 1.25);
    let gamma = || domains::range(0.0, 2.0);
    // Counts as they come, so that the two numbers belong together.
    let moments = domains::below(289)
        .and(domains::any_u32())
        .map(|(area, sum)| {
            let (n, k) = (area + 1, sum % (area + 2));
            let p = f64::from(k) / f64::from(n);
            (p as f32, (p * (1.0 - p)) as f32)
        });
    let limits = history()
        .and(moments)
        .and(gamma())
        .map(|((history, (mean, variance)), gamma)| (history, mean, variance, gamma));
    let pixels = || {
        domains::below(SIZE.x)
            .and(domains::below(SIZE.y))
            .and(history())
            .and(gamma())
            .map(|(((x, y), history), gamma)| (UVec2::new(x, y), SIZE, history, gamma))
    };
    let edges = [
        // A lit corner and border, a dark one; histories that would escape.
        (UVec2::new(74, 40), SIZE, 1.0, 0.5),
        (UVec2::new(74, 0), SIZE, 0.0, 0.5),
        (UVec2::ZERO, SIZE, 1.0, 0.5),
        (UVec2::new(0, 20), SIZE, 0.0, 2.0),
        (UVec2::new(36, 20), SIZE, 0.5, 0.5),
        (UVec2::new(36, 20), SIZE, -3.0, 1e9),
        (UVec2::new(36, 20), SIZE, 3.0, 0.0),
        (UVec2::new(24, 40), SIZE, 1e30, 0.5),
        // Outside.
        (UVec2::new(75, 40), SIZE, 0.3, 0.5),
        (UVec2::ZERO, UVec2::ZERO, 0.3, 0.5),
        (UVec2::splat(u32::MAX), SIZE, 0.3, 0.5),
    ];

    vec![
        Kernel::new(
            MODULE,
            "visibility_clamp_limit",
            ["history", "mean", "variance", "gamma"],
            visibility_clamp_limit,
            exact_limit,
            limits,
        )
        .scale(1.0)
        .few_ulp(1.0, 3.25)
        .hard([
            (1.0, 1.0, 0.0, 0.5),
            (0.0, 1.0, 0.0, 1e9),
            (1.0, 0.0, 0.0, 0.5),
            (0.5, 0.5, 0.25, 0.0),
            (-1.0, 0.00346, 0.00345, 0.5),
            (2.0, 0.99654, 0.00345, 0.5),
            (f32::MAX, 0.25, 0.1875, 0.5),
            (-1e30, 0.25, 0.1875, 0.5),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "visibility_clamp_pixel",
            ["pixel", "size", "history", "gamma"],
            pixel,
            exact_pixel,
            pixels(),
        )
        .scale(1.0)
        .few_ulp(1.0, 4.5)
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .baseline(
            "rays outside count as dark, mean - mean^2",
            NAIVE_WGSL,
            naive,
        )
        .build(),
        Kernel::new(
            MODULE,
            "visibility_clamp_rows_pixel",
            ["pixel", "size", "history", "gamma"],
            rows,
            exact_pixel,
            pixels(),
        )
        .scale(1.0)
        .few_ulp(1.0, 4.5)
        .hard(edges)
        .fixture(FIXTURE, vec![0])
        .source(SOURCE)
        .build(),
    ]
}
