//! Microfacet normals by their distribution: the pair and its contract.

pub use raytwin_cpu::brdf::ggx_ndf::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::GGX_NDF;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ggx::cases::{ALPHAS, GRAZING, US, VIEWS, alpha, upper};
    use super::ggx::exact;
    use crate::contract::{Kernel, domains};
    use crate::sample::disk::azimuth;
    use glam::{DVec2, DVec3, Vec2, Vec3};
    use std::f64::consts::TAU;

    const UNIT: &str =
        "each component of a normalised vector is monotone in the size of each of the vector";
    const MODULE: &str = "brdf/ggx_ndf";
    const WALTER: &str = "Walter et al. 2007, EGSR, equations 35 and 36";
    const DIRECTION: &str = "Walter et al. 2007, EGSR, equations 14 and 38";

    vec![
        Kernel::new(
            MODULE,
            "ggx_ndf_sample",
            ["u", "alpha"],
            ggx_ndf_sample,
            |u: DVec2, a: DVec2| {
                // By the slope: its square over alpha's is u / (1 - u).
                let slope = DVec2::from_angle(TAU * u.y) * (u.x / (1.0 - u.x)).sqrt() * a;
                slope.extend(1.0).normalize()
            },
            (domains::unit_pair(), alpha()),
        )
        // The azimuth's cosine passes through zero: relative to the length.
        .scale_by(|u: DVec2, a: DVec2| {
            let slope = DVec2::from_angle(TAU * u.y) * (u.x / (1.0 - u.x)).sqrt() * a;
            slope.length() / slope.extend(1.0).length()
        })
        .by_ends(&[("ggx_ndf_sample", "x"), ("ggx_ndf_sample", "y")], UNIT)
        .few_ulp(4.75, 24.5)
        .hard(US.into_iter().flat_map(|u| ALPHAS.map(|a| (u, a))))
        .source(WALTER)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_ndf_pdf",
            ["h", "alpha"],
            ggx_ndf_pdf,
            |h: DVec3, a: DVec2| exact::d(h, a) * h.z,
            (upper(), alpha()),
        )
        .few_ulp(11.0, 41.0)
        .hard(VIEWS.into_iter().flat_map(|h| ALPHAS.map(|a| (h, a))))
        .source(WALTER)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_ndf_direction_pdf",
            ["wo", "wi", "alpha"],
            ggx_ndf_direction_pdf,
            |o: DVec3, i: DVec3, a: DVec2| {
                if o.z <= 0.0 || i.z <= 0.0 {
                    return 0.0;
                }
                let h = exact::half(o, i);
                exact::d(h, a) * h.z / (2.0 * (o + i).length())
            },
            (upper(), upper(), alpha()),
        )
        .few_ulp(14.5, 65.0)
        .hard(
            VIEWS
                .into_iter()
                .flat_map(|o| ALPHAS.map(|a| (o, GRAZING, a)))
                .chain([
                    (Vec3::Z, Vec3::new(0.6, 0.0, -0.8), Vec2::ONE),
                    (-Vec3::Z, Vec3::Z, Vec2::ONE),
                    (Vec3::X, -Vec3::X, Vec2::ONE),
                ]),
        )
        .source(DIRECTION)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_ndf_invert",
            ["h", "alpha"],
            ggx_ndf_invert,
            |h: DVec3, a: DVec2| {
                let slope = h.truncate() / h.z / a;
                let s = slope.length_squared();
                let u = if h.z == 0.0 { 1.0 } else { s / (1.0 + s) };
                DVec2::new(u, azimuth(h.y / a.y, h.x / a.x).0)
            },
            (upper(), alpha()),
        )
        .scale(0.5)
        .undecided(|h: DVec3, a: DVec2| azimuth(h.y / a.y, h.x / a.x).1)
        .few_ulp(2.25, 16.25)
        .hard(
            [Vec3::Z, Vec3::X, GRAZING]
                .into_iter()
                .flat_map(|h| ALPHAS.map(|a| (h, a))),
        )
        .source(WALTER)
        .build(),
    ]
}
