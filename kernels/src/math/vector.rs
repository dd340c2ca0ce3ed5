//! Three-component products: the pair and its contract.

pub use raytwin_cpu::math::vector::*;

/// The WGSL twin.
pub const WGSL: &str = raytwin_wgsl::math::VECTOR;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, Vec3};

    const SOURCE: &str = "Higham, Accuracy and Stability of Numerical Algorithms, ch. 3";
    let component = domains::signed_log_range(1e-6, 1e6);
    let vector = domains::vec3(component);
    let not_zero = vector
        .clone()
        .map(|v| if v == Vec3::ZERO { Vec3::X } else { v });

    vec![
        Kernel::new(
            "math/vector",
            "vec3_dot",
            ["a", "b"],
            vec3_dot,
            |a: DVec3, b: DVec3| a.dot(b),
            (vector.clone(), vector.clone()),
        )
        // Terms of opposite sign cancel: the error belongs to their sizes.
        .scale_by(|a: DVec3, b: DVec3| a.abs().dot(b.abs()))
        .few_ulp(1.75, 3.5)
        .hard([
            (Vec3::new(1.0, 1.0, 1.0), Vec3::new(1.0, -1.0, 1e-7)),
            (Vec3::splat(1e18), Vec3::splat(1e18)),
            (Vec3::ZERO, Vec3::ONE),
        ])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/vector",
            "vec3_cross",
            ["a", "b"],
            vec3_cross,
            |a: DVec3, b: DVec3| a.cross(b),
            (vector.clone(), vector),
        )
        .scale_by(|a: DVec3, b: DVec3| a.abs().max_element() * b.abs().max_element())
        .few_ulp(1.5, 2.5)
        .hard([
            (Vec3::X, Vec3::Y),
            (Vec3::ONE, Vec3::ONE),
            (Vec3::new(1.0, 1.0, 1.0), Vec3::new(1.0, 1.0000001, 1.0)),
        ])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/vector",
            "vec3_length",
            ["a"],
            vec3_length,
            |a: DVec3| a.length(),
            (not_zero.clone(),),
        )
        .few_ulp(1.5, 8.0)
        .hard(
            [
                Vec3::X,
                Vec3::splat(1e18),
                Vec3::splat(1e-18),
                Vec3::new(3.0, 4.0, 0.0),
            ]
            .map(|v| (v,)),
        )
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/vector",
            "vec3_normalize",
            ["a"],
            vec3_normalize,
            |a: DVec3| a.normalize(),
            (not_zero,),
        )
        .few_ulp(2.75, 13.0)
        .hard(
            [
                Vec3::X,
                -Vec3::Z,
                Vec3::splat(1e18),
                Vec3::splat(1e-18),
                Vec3::new(1e18, 1e-10, 0.0),
            ]
            .map(|v| (v,)),
        )
        .source(SOURCE)
        .build(),
    ]
}
