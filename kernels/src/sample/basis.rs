//! Orthonormal basis: the pair and its contract.

pub use raytwin_cpu::sample::basis::*;

/// The WGSL twin.
pub const WGSL: &str = raytwin_wgsl::sample::BASIS;

#[cfg(feature = "contract")]
crate::value_struct!(BasisFrame {
    tangent: glam::Vec3,
    bitangent: glam::Vec3,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, Vec3};

    const SOURCE: &str = "Duff et al. 2017, JCGT 6(1), listing 3";

    // The first of these is Frisvad's worst input, next to the lower pole; the
    // two after it are the ones that Duff et al. print.
    let hard = [
        Vec3::new(0.00038527316, 0.00038460016, -0.99999988),
        Vec3::new(-0.00019813581, -0.00008946839, -0.99999994),
        Vec3::Z,
        -Vec3::Z,
        Vec3::X,
        -Vec3::Y,
        Vec3::new(1.0, 0.0, -0.0),
        Vec3::new(-0.0, -0.0, -1.0),
        Vec3::new(0.6, 0.8, 1e-30),
        Vec3::new(0.6, 0.8, -1e-30),
    ];
    let frame = domains::unit_vector().map(|n| (basis_from_normal(n), n));

    vec![
        Kernel::new(
            "sample/basis",
            "basis_from_normal",
            ["n"],
            basis_from_normal,
            // Rodrigues' rotation that takes ±z to n, in matrix form: written
            // as an outer product, unlike the listing.
            |n: DVec3| {
                let pole = DVec3::new(0.0, 0.0, if n.z >= 0.0 { 1.0 } else { -1.0 });
                let k = 1.0 / (1.0 + n.dot(pole));
                let h = n + pole;
                let rotate = |v: DVec3| v - h * (k * h.dot(v));
                // The half-turn about h swaps ±z and n; mirrored back so that
                // the basis is right-handed and continuous at the pole.
                (-rotate(DVec3::NEG_X), -rotate(DVec3::NEG_Y) * pole.z)
            },
            (domains::unit_vector(),),
        )
        .scale(0.5)
        .few_ulp(1.75, 4.5)
        .hard(hard.map(|n| (n,)))
        .source(SOURCE)
        .baseline(
            "Frisvad 2012",
            "fn baseline(n: vec3f) -> BasisFrame {
                if n.z < -0.9999999 {
                    return BasisFrame(vec3f(0.0, -1.0, 0.0), vec3f(-1.0, 0.0, 0.0));
                }
                let a = 1.0 / (1.0 + n.z);
                let b = -n.x * n.y * a;
                return BasisFrame(
                    vec3f(1.0 - n.x * n.x * a, b, -n.x),
                    vec3f(b, 1.0 - n.y * n.y * a, -n.y));
            }",
            |n: Vec3| {
                if n.z < -0.999_999_9 {
                    return BasisFrame {
                        tangent: -Vec3::Y,
                        bitangent: -Vec3::X,
                    };
                }
                let a = 1.0 / (1.0 + n.z);
                let b = -n.x * n.y * a;
                BasisFrame {
                    tangent: Vec3::new(1.0 - n.x * n.x * a, b, -n.x),
                    bitangent: Vec3::new(b, 1.0 - n.y * n.y * a, -n.y),
                }
            },
        )
        .build(),
        Kernel::new(
            "sample/basis",
            "basis_to_world",
            ["frame", "n", "v"],
            basis_to_world,
            |(t, b): (DVec3, DVec3), n: DVec3, v: DVec3| t * v.x + b * v.y + n * v.z,
            frame
                .clone()
                .and(domains::unit_vector())
                .map(|((frame, n), v)| (frame, n, v)),
        )
        .scale(0.5)
        .few_ulp(2.0, 3.5)
        .hard(hard.map(|n| (basis_from_normal(n), n, Vec3::new(0.6, 0.0, 0.8))))
        .source(SOURCE)
        .build(),
        Kernel::new(
            "sample/basis",
            "basis_to_local",
            ["frame", "n", "v"],
            basis_to_local,
            |(t, b): (DVec3, DVec3), n: DVec3, v: DVec3| DVec3::new(t.dot(v), b.dot(v), n.dot(v)),
            frame
                .and(domains::unit_vector())
                .map(|((frame, n), v)| (frame, n, v)),
        )
        .scale(0.5)
        .few_ulp(2.0, 3.5)
        .hard(hard.map(|n| (basis_from_normal(n), n, Vec3::new(0.6, 0.0, 0.8))))
        .source(SOURCE)
        .build(),
    ]
}
