//! Finite-value sanitising: the pair and its contract.

pub use raytwin_cpu::math::sanitize::*;

/// The WGSL twin.
pub const WGSL: &str = raytwin_wgsl::math::SANITIZE;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, Vec3};

    const SOURCE: &str = "IEEE 754-2019, section 3.4 (encoding)";
    const NOT_FINITE: [u32; 6] = [
        0x7f80_0000,
        0xff80_0000,
        0x7fc0_0000,
        0xffc0_0000,
        0x7f80_0001,
        0xffff_ffff,
    ];
    // Zero or normal: an implementation may flush a subnormal on its way.
    let finite = domains::signed_log_range(1e-30, 3e38);
    let bits = finite
        .clone()
        .and(domains::any_u32())
        .map(|(x, w)| match w & 3 {
            0 => NOT_FINITE[(w >> 2) as usize % NOT_FINITE.len()],
            _ => x.to_bits(),
        });
    let any = bits.clone().map(f32::from_bits);
    // One in eight is not finite, one in eight too large.
    let far_or_not = domains::log_range(1e-3, 1e3)
        .and(domains::any_u32())
        .map(|(x, w)| match w & 7 {
            0 => f32::from_bits(NOT_FINITE[(w >> 3) as usize % NOT_FINITE.len()]),
            1 => 1e30,
            _ => x,
        });
    let number = |bits: u32| {
        let magnitude = bits & 0x7fff_ffff;
        (magnitude < 0x7f80_0000).then(|| f64::from(f32::from_bits(bits)))
    };

    vec![
        Kernel::new(
            "math/sanitize",
            "finite_bits",
            ["bits"],
            finite_bits,
            move |b: u32| u32::from(number(b).is_some()),
            (domains::any_u32()
                .and(bits.clone())
                .map(|(a, b)| if a & 1 == 0 { a } else { b }),),
        )
        .bit_exact()
        .hard(NOT_FINITE.map(|b| (b,)))
        .hard([(0,), (1,), (0x8000_0000,), (0x7f7f_ffff,), (0x007f_ffff,)])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/sanitize",
            "sanitize_bits",
            ["bits", "fallback"],
            sanitize_bits,
            move |b: u32, fallback: f64| number(b).unwrap_or(fallback),
            (bits, finite.clone()),
        )
        .bit_exact()
        .hard(NOT_FINITE.map(|b| (b, 3.0)))
        .hard([(0x7f7f_ffff, 0.0), (0x0080_0000, 1.0), (0, 1.0)])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/sanitize",
            "sanitize_finite",
            ["x", "fallback"],
            sanitize_finite,
            |x: f64, fallback: f64| if x.is_finite() { x } else { fallback },
            (any.clone(), finite.clone()),
        )
        .bit_exact()
        .by_analysis(
            "WGSL defines no f32 parameter that holds a NaN, so no table covers this \
             signature; the test itself is on bits and exact (see sanitize_bits)",
        )
        .hard(NOT_FINITE.map(|b| (f32::from_bits(b), 7.0)))
        .hard([(f32::MAX, 1.0), (f32::MIN, 1.0), (0.0, 1.0)])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/sanitize",
            "sanitize_vector",
            ["v", "fallback"],
            sanitize_vector,
            |v: DVec3, fallback: DVec3| if v.is_finite() { v } else { fallback },
            (domains::vec3(any), domains::vec3(finite)),
        )
        .bit_exact()
        .by_analysis(
            "WGSL defines no f32 parameter that holds a NaN, so no table covers this \
             signature; the test itself is on bits and exact (see sanitize_bits)",
        )
        .hard(NOT_FINITE.map(|b| (Vec3::new(1.0, f32::from_bits(b), 2.0), Vec3::ZERO)))
        .hard([
            (Vec3::splat(f32::MAX), Vec3::ZERO),
            (Vec3::new(0.0, 0.0, f32::INFINITY), Vec3::ONE),
        ])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/sanitize",
            "magnitude_bits",
            ["v"],
            magnitude_bits,
            // Numbers only: how NaNs are ordered has no truth but the bits.
            |v: DVec3| (v.abs().max_element() as f32).to_bits(),
            (domains::vec3(domains::signed_log_range(1e-30, 3e38)),),
        )
        .bit_exact()
        .hard([
            (Vec3::ZERO,),
            (Vec3::new(-0.0, -f32::MAX, 1.0),),
            (Vec3::new(1.0, 1.0, -f32::MIN_POSITIVE),),
        ])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/sanitize",
            "usable_surface",
            ["position", "normal", "scale"],
            usable_surface,
            |position: DVec3, normal: DVec3, scale: f64| {
                let below = |v: DVec3, most: f64| v.to_array().iter().all(|x| x.abs() < most);
                let far = 2f64.powi(60);
                u32::from(below(position, far) && below(normal, 2.0) && scale > 0.0 && scale < far)
            },
            (
                domains::vec3(far_or_not.clone()),
                domains::vec3(domains::range(-1.0, 1.0)),
                far_or_not,
            ),
        )
        .bit_exact()
        .by_analysis(
            "WGSL defines no f32 parameter that holds a NaN, so no table covers this \
             signature; the test itself is on bits and exact",
        )
        .hard(NOT_FINITE.map(|b| (Vec3::new(1.0, f32::from_bits(b), 2.0), Vec3::Z, 1.0)))
        .hard(NOT_FINITE.map(|b| (Vec3::ONE, Vec3::new(0.0, 0.0, f32::from_bits(b)), 1.0)))
        .hard(NOT_FINITE.map(|b| (Vec3::ONE, Vec3::Z, f32::from_bits(b))))
        .hard([
            (Vec3::ONE, Vec3::Z, 0.0),
            (Vec3::ONE, Vec3::Z, -0.0),
            (Vec3::ONE, Vec3::Z, -1.0),
            (Vec3::splat(1e30), Vec3::Z, 1.0),
            (Vec3::ONE, Vec3::splat(2.0), 1.0),
            (
                Vec3::splat(-1.1529214e18),
                Vec3::splat(-1.9999999),
                1.1529214e18,
            ),
            (Vec3::ONE, Vec3::Z, 1.1529215e18),
        ])
        .source(SOURCE)
        .build(),
    ]
}
