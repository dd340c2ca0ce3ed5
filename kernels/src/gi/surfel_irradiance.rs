//! The light of surfels: the pair and its contract.

pub use raytwin_cpu::gi::surfel_irradiance::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::gi::SURFEL_IRRADIANCE;

#[cfg(feature = "contract")]
crate::value_struct!(SurfelIrradiancePose {
    x: glam::Vec3,
    y: glam::Vec3,
    z: glam::Vec3,
    origin: glam::Vec3,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::surfel::{SURFEL_LARGEST, Surfel, WideSurfel, surfel_and_point, surfel_sound};
    use crate::contract::{Kernel, domains};
    use crate::random::pcg::pcg3d;
    use crate::sample::basis::basis_from_normal;
    use glam::{DMat3, DVec2, DVec3, UVec3, Vec3};
    use std::f64::consts::{FRAC_PI_4, PI};

    const MODULE: &str = "gi/surfel_irradiance";
    const CHAPTER: &str = "Ray Tracing Gems, ch. 25 (diffuse GI)";
    const COSINE: &str = "Malley's method (PBR, 4th ed., A.5.3); Ray Tracing Gems, ch. 25";
    const DIFFUSE: &str = "radiance of a diffuse surface";
    const OURS: &str = "ours";
    const NOT_A_NUMBER: &str = "WGSL defines no f32 parameter that holds a NaN, so no table \
                                covers this signature; the tests are on bits and exact";
    // Nothing here reads surfels.
    const FIXTURE: &str = "
fn surfel_read(entry: u32) -> Surfel {
    return Surfel(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), entry);
}
fn surfel_read_irradiance(entry: u32) -> vec3f {
    return vec3f(0.0, 0.0, 0.0);
}
";
    type WidePose = (DVec3, DVec3, DVec3, DVec3);

    fn exact_rays(age: u32, most: u32) -> u32 {
        if most == 0 {
            return 0;
        }
        (u64::from(most) / (u64::from(age) + 1)).max(1) as u32
    }
    fn exact_allowed(before: u32, wanted: u32, budget: u32) -> u32 {
        i64::from(wanted).min((i64::from(budget) - i64::from(before)).max(0)) as u32
    }
    fn off((p, radius, _, _): WideSurfel) -> f64 {
        radius / 256.0 + p.abs().max_element() / 2f64.powi(20)
    }
    fn exact_origin(s: WideSurfel) -> DVec3 {
        s.0 + s.2 * off(s)
    }
    // The disk by an angle, and the basis by rotating ±z onto the normal.
    fn exact_direction(n: DVec3, surfel: u32, frame: u32, ray: u32) -> DVec3 {
        let unit = |bits: u32| f64::from(bits >> 8) / 16_777_216.0;
        let bits = pcg3d(UVec3::new(surfel, frame, ray));
        let v = DVec2::new(unit(bits.x), unit(bits.y)) * 2.0 - 1.0;
        let r = v.abs().max_element();
        let angle = if v == DVec2::ZERO {
            0.0
        } else if v.x.abs() > v.y.abs() {
            FRAC_PI_4 * v.y / v.x + if v.x < 0.0 { PI } else { 0.0 }
        } else {
            PI / 2.0 - FRAC_PI_4 * v.x / v.y + if v.y < 0.0 { PI } else { 0.0 }
        };
        let local = (DVec2::from_angle(angle) * r).extend((1.0 - r * r).max(0.0).sqrt());
        let pole = DVec3::new(0.0, 0.0, if n.z >= 0.0 { 1.0 } else { -1.0 });
        let k = 1.0 / (1.0 + n.dot(pole));
        let h = n + pole;
        let rotate = |v: DVec3| v - h * (k * h.dot(v));
        let tangent = -rotate(DVec3::NEG_X);
        let bitangent = -rotate(DVec3::NEG_Y) * pole.z;
        tangent * local.x + bitangent * local.y + n * local.z
    }
    fn light(v: DVec3) -> DVec3 {
        DVec3::from_array(v.to_array().map(|x| {
            let usable = x >= 0.0 && x <= f64::from(SURFEL_LARGEST);
            if usable { x } else { 0.0 }
        }))
    }
    fn exact_sample(radiance: DVec3, rays: u32) -> DVec3 {
        if rays == 0 {
            return DVec3::ZERO;
        }
        (light(radiance) * PI / f64::from(rays)).min(DVec3::splat(SURFEL_LARGEST.into()))
    }
    fn exact_outgoing(albedo: DVec3, emission: DVec3, direct: DVec3, gathered: DVec3) -> DVec3 {
        let rho = light(albedo).min(DVec3::splat(31.0 / 32.0));
        let sum = light(emission) + rho * (light(direct) + light(gathered)) / PI;
        sum.min(DVec3::splat(SURFEL_LARGEST.into()))
    }
    fn exact_follow(s: WideSurfel, old: WidePose, new: WidePose) -> WideSurfel {
        let there = DMat3::from_cols(old.0, old.1, old.2).transpose();
        let turn = DMat3::from_cols(new.0, new.1, new.2) * there;
        (
            new.3 + turn * (s.0 - old.3),
            s.1,
            (turn * s.2).normalize(),
            s.3,
        )
    }
    fn exact_patience(used: u32, capacity: u32, patience: u32) -> u32 {
        let free = u64::from(capacity.saturating_sub(used));
        let parts = (1024 * free).checked_div(u64::from(capacity)).unwrap_or(0);
        (u64::from(patience.min(65_535)) * parts.min(256) / 256) as u32
    }
    fn pose(normal: Vec3, turn: f32, origin: Vec3) -> SurfelIrradiancePose {
        let frame = basis_from_normal(normal);
        let (s, c) = (turn * 6.283_185_5).sin_cos();
        SurfelIrradiancePose {
            x: frame.tangent * c + frame.bitangent * s,
            y: frame.bitangent * c - frame.tangent * s,
            z: normal,
            origin,
        }
    }
    let poses = || {
        domains::unit_vector()
            .and(domains::unit())
            .and(domains::vec3(domains::range(-8.0, 8.0)))
            .map(|((normal, turn), origin)| pose(normal, turn, origin))
    };
    // Large pools and small ones.
    let pools = || domains::below(260_000).map(|x| if x % 2 == 1 { x % 3000 } else { x });
    let surfels = || surfel_and_point().map(|(s, _)| s);
    let disc = |position: Vec3, radius: f32, normal: Vec3| Surfel {
        position,
        radius,
        normal,
        mesh: 3,
    };
    let tilted = Vec3::new(0.6, 0.0, 0.8);
    let good = disc(Vec3::new(1.0, 2.0, 3.0), 0.5, tilted);
    let colors = |low: f32, high: f32| domains::vec3(domains::log_range(low, high));
    let broken = Vec3::new(-1.0, 1e20, 0.5);
    let home = pose(Vec3::Z, 0.0, Vec3::ZERO);

    vec![
        Kernel::new(
            MODULE,
            "surfel_irradiance_rays",
            ["age", "most"],
            surfel_irradiance_rays,
            exact_rays,
            (domains::below(300), domains::below(256)),
        )
        .bit_exact()
        .hard([
            (0, 0),
            (0, 16),
            (15, 16),
            (16, 16),
            (u32::MAX, 16),
            (u32::MAX, u32::MAX),
            (0, u32::MAX),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_irradiance_allowed",
            ["before", "wanted", "budget"],
            surfel_irradiance_allowed,
            exact_allowed,
            (
                domains::below(300_000),
                domains::below(64),
                domains::below(300_000),
            ),
        )
        .bit_exact()
        .hard([
            (0, 0, 0),
            (10, 5, 10),
            (9, 5, 10),
            (u32::MAX, 5, 10),
            (0, u32::MAX, u32::MAX),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_irradiance_origin",
            ["surfel"],
            surfel_irradiance_origin,
            exact_origin,
            (surfels(),),
        )
        .scale_by(|s: WideSurfel| s.0.abs().max_element().max(off(s)))
        .few_ulp(1.75, 3.0)
        .hard([
            (good,),
            (disc(Vec3::ZERO, 1e-3, Vec3::Z),),
            (disc(Vec3::splat(1e6), 1e-3, tilted),),
            (disc(Vec3::splat(-1e-6), 1e3, -tilted),),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_irradiance_direction",
            ["normal", "surfel", "frame", "ray"],
            surfel_irradiance_direction,
            exact_direction,
            (
                domains::unit_vector(),
                domains::below(250_000),
                domains::any_u32(),
                domains::below(64),
            ),
        )
        .scale(1.0)
        .few_ulp(2.25, 6.0)
        .hard([
            (Vec3::Z, 0, 0, 0),
            (-Vec3::Z, 0, 0, 0),
            (Vec3::X, 249_999, u32::MAX, 63),
            (
                Vec3::new(0.00038527316, 0.00038460016, -0.99999988),
                7,
                9,
                0,
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(COSINE)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_irradiance_sample",
            ["radiance", "rays"],
            surfel_irradiance_sample,
            exact_sample,
            (colors(1e-6, 1e6), domains::below(65)),
        )
        .few_ulp(2.0, 6.0)
        .hard([
            (Vec3::ZERO, 1),
            (Vec3::ONE, 0),
            (broken, 4),
            (Vec3::splat(1e15), 1),
            (Vec3::splat(1e-30), 3),
        ])
        .fixture(FIXTURE, vec![0])
        .source(COSINE)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_irradiance_outgoing",
            ["albedo", "emission", "direct", "gathered"],
            surfel_irradiance_outgoing,
            exact_outgoing,
            (
                domains::vec3(domains::range(0.0, 1.0)),
                colors(1e-3, 1e3),
                colors(1e-3, 1e3),
                colors(1e-3, 1e3),
            ),
        )
        .few_ulp(3.25, 6.0)
        .hard([
            (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO),
            (Vec3::ONE, Vec3::ZERO, Vec3::ONE, Vec3::ONE),
            (Vec3::splat(0.96875), Vec3::ZERO, Vec3::ZERO, Vec3::ONE),
            (broken, Vec3::ONE, Vec3::ONE, Vec3::ONE),
            (Vec3::ONE, broken, broken, broken),
            (
                Vec3::ONE,
                Vec3::splat(1e15),
                Vec3::splat(1e15),
                Vec3::splat(1e15),
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(DIFFUSE)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_irradiance_follow",
            ["surfel", "old", "new_pose"],
            surfel_irradiance_follow,
            exact_follow,
            (surfels(), poses(), poses()),
        )
        // Distance from the old origin, both origins; 1 for the normal.
        .scale_by(|s: WideSurfel, old: WidePose, new: WidePose| {
            let origins = old.3.length().max(new.3.length());
            (s.0 - old.3).length().max(origins).max(1.0)
        })
        .few_ulp(4.0, 8.0)
        .hard([
            (good, home, home),
            (good, home, pose(-Vec3::Z, 0.25, Vec3::X)),
            (good, pose(tilted, 0.3, good.position), home),
            (good, home, pose(tilted, 0.7, Vec3::new(1e6, -1e6, 0.0))),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_irradiance_patience",
            ["used", "capacity", "patience"],
            surfel_irradiance_patience,
            exact_patience,
            (pools(), pools(), domains::below(2000)),
        )
        .bit_exact()
        .hard([
            (0, 0, 600),
            (0, 250_000, 600),
            (187_500, 250_000, 600),
            (249_999, 250_000, 600),
            (250_000, 250_000, 600),
            (u32::MAX, 250_000, 600),
            (0, u32::MAX, u32::MAX),
            // A quarter free, and one slot less; small pools and the largest.
            (48, 64, 600),
            (49, 64, 600),
            (63, 64, 600),
            (0, 1, 600),
            (2, 3, 65_535),
            (750, 1000, 600),
            (1535, 2047, 600),
            (187_501, 250_000, 600),
            (0xbfff_ffff, u32::MAX, 65_535),
            (0xc000_0000, u32::MAX, 65_535),
            (0xe000_0000, u32::MAX, 600),
            (0xffff_fffe, u32::MAX, 65_535),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_irradiance_recycle",
            ["surfel", "unseen", "patience"],
            surfel_irradiance_recycle,
            |s: WideSurfel, unseen: u32, patience: u32| {
                let narrow = Surfel {
                    position: s.0.as_vec3(),
                    radius: s.1 as f32,
                    normal: s.2.as_vec3(),
                    mesh: s.3,
                };
                u32::from(surfel_sound(narrow) == 0 || unseen > patience)
            },
            (surfels(), domains::below(1200), domains::below(1200)),
        )
        .bit_exact()
        .by_analysis(NOT_A_NUMBER)
        .hard([
            (good, 0, 0),
            (good, 1, 0),
            (good, 600, 600),
            (disc(Vec3::ZERO, 0.0, Vec3::Z), 0, 600),
            (disc(Vec3::ZERO, 0.1, Vec3::ZERO), 0, 600),
            (disc(Vec3::ZERO, f32::NAN, Vec3::Z), 0, 600),
            (disc(Vec3::splat(f32::INFINITY), 0.1, Vec3::Z), 0, 600),
        ])
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
    ]
}
