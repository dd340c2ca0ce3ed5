//! The octahedral map: the pair and its contract.

pub use raytwin_cpu::math::octahedral::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::math::OCTAHEDRAL;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec2, DVec3, Vec2, Vec3};

    const SOURCE: &str = "Cigolle et al. 2014, JCGT 3(2), section 3 (oct)";
    let sign = |v: f64| if v >= 0.0 { 1.0 } else { -1.0 };

    vec![
        Kernel::new(
            "math/octahedral",
            "octahedral_encode",
            ["n"],
            octahedral_encode,
            move |n: DVec3| {
                let p = DVec2::new(n.x, n.y) / (n.x.abs() + n.y.abs() + n.z.abs());
                if n.z >= 0.0 {
                    p
                } else {
                    DVec2::new((1.0 - p.y.abs()) * sign(n.x), (1.0 - p.x.abs()) * sign(n.y))
                }
            },
            (domains::unit_vector(),),
        )
        .few_ulp(2.0, 4.5)
        .scale(0.5)
        .hard(
            [
                Vec3::X,
                -Vec3::X,
                Vec3::Z,
                -Vec3::Z,
                Vec3::new(-0.0, 1.0, -0.0),
                Vec3::new(0.0, -1.0, -0.0),
                Vec3::new(-0.0, -0.0, -1.0),
                Vec3::new(1e-20, 0.0, -1.0),
                Vec3::new(-1e-20, 1e-20, -1.0),
                Vec3::new(0.70710677, 0.70710677, -1e-20),
                Vec3::new(1e30, -1e30, 1e30),
            ]
            .map(|n| (n,)),
        )
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/octahedral",
            "octahedral_decode",
            ["p"],
            octahedral_decode,
            move |p: DVec2| {
                let z = 1.0 - p.x.abs() - p.y.abs();
                let v = if z >= 0.0 {
                    DVec3::new(p.x, p.y, z)
                } else {
                    DVec3::new(
                        (1.0 - p.y.abs()) * sign(p.x),
                        (1.0 - p.x.abs()) * sign(p.y),
                        z,
                    )
                };
                v.normalize()
            },
            (domains::range(-1.0, 1.0)
                .and(domains::range(-1.0, 1.0))
                .map(|(x, y)| Vec2::new(x, y)),),
        )
        .few_ulp(2.5, 13.5)
        .scale(0.5)
        .hard(
            [
                Vec2::ZERO,
                Vec2::ONE,
                -Vec2::ONE,
                Vec2::new(1.0, -0.0),
                Vec2::new(-0.0, -1.0),
                Vec2::new(0.5, 0.5),
                Vec2::new(0.5, 0.50000006),
                Vec2::new(0.99999994, 1.0),
            ]
            .map(|p| (p,)),
        )
        .source(SOURCE)
        .build(),
        Kernel::new(
            "math/octahedral",
            "octahedral_unpack",
            ["bits"],
            octahedral_unpack,
            move |bits: u32| {
                let snorm = |half: u32| (f64::from(half as u16 as i16) / 32767.0).max(-1.0);
                let (x, y) = (snorm(bits), snorm(bits >> 16));
                let z = 1.0 - x.abs() - y.abs();
                let v = if z >= 0.0 {
                    DVec3::new(x, y, z)
                } else {
                    DVec3::new((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y), z)
                };
                v.normalize()
            },
            (domains::any_u32(),),
        )
        .few_ulp(5.5, 19.0)
        .scale(0.5)
        .hard(
            [
                0x0000_0000,
                0x7fff_7fff,
                0x8001_8001,
                0x8000_8000,
                0x0000_8000,
                0x3fff_4000,
                0x7fff_0000,
                0xffff_0001,
            ]
            .map(|bits| (bits,)),
        )
        .source(SOURCE)
        .build(),
    ]
}
