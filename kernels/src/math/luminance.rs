//! Relative luminance: the pair and its contract.

pub use raytwin_cpu::math::luminance::*;

/// The WGSL twin.
pub const WGSL: &str = raytwin_wgsl::math::LUMINANCE;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, Vec3};

    vec![
        Kernel::new(
            "math/luminance",
            "luminance",
            ["rgb"],
            luminance,
            |rgb: DVec3| 0.2126 * rgb.x + 0.7152 * rgb.y + 0.0722 * rgb.z,
            (domains::vec3(domains::log_range(1e-4, 1e5)),),
        )
        .few_ulp(2.25, 3.5)
        .hard(
            [
                Vec3::ZERO,
                Vec3::ONE,
                Vec3::new(1e30, 1e-30, 0.0),
                Vec3::splat(65504.0),
                Vec3::new(0.0, 0.0, 1e-20),
            ]
            .map(|v| (v,)),
        )
        .source("ITU-R BT.709-6, item 3.2")
        .build(),
    ]
}
