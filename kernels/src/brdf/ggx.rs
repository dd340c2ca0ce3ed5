//! The Trowbridge–Reitz distribution: the pair and its contract.

pub use raytwin_cpu::brdf::ggx::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::GGX;

/// The distribution in double precision, by slopes and angles.
#[cfg(feature = "contract")]
pub(crate) mod exact {
    use glam::{DVec2, DVec3};
    use std::f64::consts::PI;

    pub fn half(o: DVec3, i: DVec3) -> DVec3 {
        let m = o + i;
        if m.length() < 1e-15 {
            DVec3::Z
        } else {
            m.normalize()
        }
    }

    pub fn reflect(o: DVec3, h: DVec3) -> DVec3 {
        h * (2.0 * o.dot(h)) - o
    }

    /// From the distribution of slopes.
    pub fn d(h: DVec3, a: DVec2) -> f64 {
        if h.z <= 0.0 {
            return 0.0;
        }
        let slope = h.truncate() / h.z / a;
        1.0 / (PI * a.x * a.y * (1.0 + slope.length_squared()).powi(2) * h.z.powi(4))
    }

    /// Hidden over own area, for a direction above the surface.
    pub fn lambda(w: DVec3, a: DVec2) -> f64 {
        let tan2 = (w.truncate() * a).length_squared() / (w.z * w.z);
        // (√(1 + t) - 1) / 2, for small t too.
        0.5 * tan2 / ((1.0 + tan2).sqrt() + 1.0)
    }

    pub fn stretched(w: DVec3, a: DVec2) -> f64 {
        (w.truncate() * a).extend(w.z).length()
    }

    /// Visible area, `z (1 + Λ)` above and `-z Λ` below.
    pub fn projected_area(w: DVec3, a: DVec2) -> f64 {
        if w.z == 0.0 {
            return 0.5 * stretched(w, a);
        }
        let hidden = lambda(w, a);
        w.z.abs() * if w.z > 0.0 { 1.0 + hidden } else { hidden }
    }

    pub fn g2(o: DVec3, i: DVec3, a: DVec2) -> f64 {
        if o.z <= 0.0 || i.z <= 0.0 {
            return 0.0;
        }
        1.0 / (1.0 + lambda(o, a) + lambda(i, a))
    }
}

/// Directions and roughness that contracts of the group share.
#[cfg(feature = "contract")]
pub(crate) mod cases {
    use crate::contract::{Domain, domains};
    use glam::{Vec2, Vec3};

    /// Sine and cosine of 89.99°.
    pub const GRAZING: Vec3 = Vec3::new(0.99999994, 0.0, 1.745_329e-4);

    /// Above the surface, by the cosine's logarithm or uniformly, down to
    /// 89.99°.
    pub fn upper() -> Domain<Vec3> {
        domains::log_range(1.745_329e-4, 1.0)
            .and(domains::range(1.745_329e-4, 1.0))
            .and(domains::unit())
            .and(domains::below(2))
            .map(|(((small, even), turn), which)| {
                let z = if which == 0 { even } else { small };
                let (s, c) = (f64::from(turn) * std::f64::consts::TAU).sin_cos();
                let r = ((1.0 - f64::from(z)) * (1.0 + f64::from(z))).sqrt();
                Vec3::new((r * c) as f32, (r * s) as f32, z)
            })
    }

    /// From a mirror's threshold's tenth to the roughest, along the grain of the
    /// most anisotropic: `ggx_alpha(1, 1)` is 3.16 there.
    pub fn alpha() -> Domain<Vec2> {
        domains::log_range(1e-4, 3.2)
            .and(domains::log_range(1e-4, 3.2))
            .map(|(x, y)| Vec2::new(x, y))
    }

    pub const ALPHAS: [Vec2; 5] = [
        Vec2::splat(1e-4),
        Vec2::ONE,
        Vec2::new(1e-4, 1.0),
        Vec2::splat(0.3),
        Vec2::new(3.1622777, 0.31622776),
    ];

    pub const VIEWS: [Vec3; 5] = [
        Vec3::Z,
        GRAZING,
        Vec3::new(0.0, -0.99999994, 1.745_329e-4),
        Vec3::new(0.6, 0.0, 0.8),
        Vec3::new(-0.48, 0.64, 0.6),
    ];

    pub const US: [Vec2; 6] = [
        Vec2::ZERO,
        Vec2::new(0.99999994, 0.5),
        Vec2::new(0.99999994, 0.0),
        Vec2::new(0.5, 0.25),
        Vec2::new(5.960_464_5e-8, 0.99999994),
        Vec2::new(0.25, 0.125),
    ];
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use cases::{ALPHAS, GRAZING, VIEWS, alpha, upper};
    use glam::{DVec2, DVec3, Vec2, Vec3};

    const MODULE: &str = "brdf/ggx";
    const WALTER: &str = "Walter et al. 2007, EGSR, equation 33";
    const HEITZ: &str = "Heitz 2014, JCGT 3(2), equations 72 and 99";
    let tiny = 1e-30f64;
    let one = domains::unit_vector;

    vec![
        Kernel::new(
            MODULE,
            "ggx_alpha",
            ["roughness", "anisotropy"],
            ggx_alpha,
            |r: f64, a: f64| {
                let aspect = (1.0 - f64::from(0.9f32) * a).sqrt();
                DVec2::new(r * r / aspect, r * r * aspect).max(DVec2::splat(f64::from(1e-4f32)))
            },
            domains::range(0.0, 1.0)
                .and(domains::range(0.0, 1.0))
                .map(|(r, a)| (r, a)),
        )
        .few_ulp(4.25, 15.0)
        .hard([(0.0, 0.0), (1.0, 1.0), (0.01, 0.5), (1.0, 0.0)])
        .source("Burley 2012, SIGGRAPH course notes, 5.4")
        .build(),
        Kernel::new(
            MODULE,
            "ggx_is_mirror",
            ["alpha"],
            ggx_is_mirror,
            |a: DVec2| u32::from(a.max_element() < f64::from(GGX_MIRROR_ALPHA)),
            (alpha(),),
        )
        .bit_exact()
        .hard([
            (Vec2::splat(1e-3),),
            (Vec2::new(1e-4, 1e-3),),
            (Vec2::splat(9.99e-4),),
        ])
        .source("threshold of pbrt-v4 and Falcor")
        .build(),
        Kernel::new(
            MODULE,
            "ggx_half",
            ["wo", "wi"],
            ggx_half,
            exact::half,
            (one(), one()),
        )
        .few_ulp(3.75, 15.0)
        .hard([
            (Vec3::Z, Vec3::Z),
            (Vec3::Z, -Vec3::Z),
            (Vec3::X, GRAZING),
            (-Vec3::X, GRAZING),
            (Vec3::new(-0.99999994, 0.0, 1.745_329e-4), GRAZING),
        ])
        .source("Walter et al. 2007, EGSR, equation 13")
        .build(),
        Kernel::new(
            MODULE,
            "ggx_reflect",
            ["wo", "h"],
            ggx_reflect,
            exact::reflect,
            (one(), one()),
        )
        .scale(1.0)
        .few_ulp(2.25, 4.0)
        .hard([
            (Vec3::Z, Vec3::Z),
            (GRAZING, Vec3::Z),
            (Vec3::X, Vec3::new(0.70710677, 0.0, 0.70710677)),
        ])
        .source("law of reflection")
        .build(),
        Kernel::new(
            MODULE,
            "ggx_d",
            ["h", "alpha"],
            ggx_d,
            exact::d,
            (upper(), alpha()),
        )
        .few_ulp(10.5, 37.0)
        .hard(
            VIEWS
                .into_iter()
                .chain([Vec3::X, -Vec3::Z])
                .flat_map(|h| ALPHAS.map(|a| (h, a))),
        )
        .source(WALTER)
        .baseline(
            "1 - (n·h)²",
            "fn baseline(h: vec3f, alpha: vec2f) -> f32 {
                let a = alpha.x;
                let k = a / (1.0 - h.z * h.z + (h.z * a) * (h.z * a));
                return k * k * 0.31830987;
            }",
            |h: Vec3, alpha: Vec2| {
                let a = alpha.x;
                let k = a / (1.0 - h.z * h.z + (h.z * a) * (h.z * a));
                k * k * 0.318_309_87
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "ggx_d_isotropic",
            ["h", "alpha"],
            ggx_d_isotropic,
            |h: DVec3, a: f64| exact::d(h, DVec2::splat(a)),
            (upper(), domains::log_range(1e-4, 1.0)),
        )
        .few_ulp(9.0, 17.0)
        .hard(
            VIEWS
                .into_iter()
                .chain([Vec3::X, -Vec3::Z])
                .flat_map(|h| [1e-4, 0.3, 1.0].map(|a| (h, a))),
        )
        .source(WALTER)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_d_between",
            ["wo", "wi", "alpha"],
            ggx_d_between,
            |o: DVec3, i: DVec3, a: DVec2| {
                if (o + i).length() < 1e-15 {
                    0.0
                } else {
                    exact::d((o + i).normalize(), a)
                }
            },
            (upper(), upper(), alpha()),
        )
        .few_ulp(16.5, 55.0)
        .hard(
            VIEWS
                .into_iter()
                .flat_map(|o| ALPHAS.map(|a| (o, GRAZING, a)))
                .chain([
                    (Vec3::Z, -Vec3::Z, Vec2::ONE),
                    (Vec3::X, Vec3::new(0.6, 0.0, -0.8), Vec2::ONE),
                ]),
        )
        .source(WALTER)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_stretched",
            ["w", "alpha"],
            ggx_stretched,
            exact::stretched,
            (one(), alpha()),
        )
        .few_ulp(2.0, 10.5)
        .hard(VIEWS.into_iter().flat_map(|w| ALPHAS.map(|a| (w, a))))
        .source(HEITZ)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_projected_area",
            ["w", "alpha"],
            ggx_projected_area,
            exact::projected_area,
            (one(), alpha()),
        )
        .few_ulp(5.25, 17.0)
        .hard(
            VIEWS
                .into_iter()
                .chain(VIEWS.map(|w| -w))
                .chain([Vec3::X])
                .flat_map(|w| ALPHAS.map(|a| (w, a))),
        )
        .source("Heitz et al. 2015, The SGGX Microflake Distribution, and JCGT 3(2) 2014")
        .build(),
        Kernel::new(
            MODULE,
            "ggx_lambda",
            ["w", "alpha"],
            ggx_lambda,
            |w: DVec3, a: DVec2| {
                let z = w.z.abs().max(f64::from(1e-7f32));
                let up = exact::lambda(DVec3::new(w.x, w.y, z), a);
                if w.z < 0.0 { 1.0 + up } else { up }
            },
            (one(), alpha()),
        )
        .few_ulp(5.75, 17.0)
        .hard(
            VIEWS
                .into_iter()
                .chain(VIEWS.map(|w| -w))
                .chain([Vec3::X])
                .flat_map(|w| ALPHAS.map(|a| (w, a))),
        )
        .source(HEITZ)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_g1",
            ["w", "alpha"],
            ggx_g1,
            |w: DVec3, a: DVec2| {
                if w.z == 0.0 {
                    0.0
                } else {
                    1.0 / (1.0 + exact::lambda(w.abs(), a))
                }
            },
            (one(), alpha()),
        )
        .few_ulp(3.75, 12.5)
        .hard(
            VIEWS
                .into_iter()
                .chain([Vec3::X, -Vec3::Z])
                .flat_map(|w| ALPHAS.map(|a| (w, a))),
        )
        .source(HEITZ)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_g2",
            ["wo", "wi", "alpha"],
            ggx_g2,
            exact::g2,
            (upper(), upper(), alpha()),
        )
        .few_ulp(4.25, 16.0)
        .hard(
            VIEWS
                .into_iter()
                .flat_map(|o| ALPHAS.map(|a| (o, GRAZING, a))),
        )
        .source(HEITZ)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_visibility",
            ["wo", "wi", "alpha"],
            ggx_visibility,
            move |o: DVec3, i: DVec3, a: DVec2| {
                let sum = i.z * exact::stretched(o, a) + o.z * exact::stretched(i, a);
                0.5 / sum.max(tiny)
            },
            (upper(), upper(), alpha()),
        )
        .few_ulp(4.75, 16.0)
        .hard(
            VIEWS
                .into_iter()
                .flat_map(|o| ALPHAS.map(|a| (o, GRAZING, a)))
                .chain([(Vec3::X, Vec3::Y, Vec2::ONE)]),
        )
        .source(HEITZ)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_visibility_isotropic",
            ["cos_o", "cos_i", "alpha"],
            ggx_visibility_isotropic,
            |o: f64, i: f64, a: f64| {
                let w = |c: f64| DVec3::new((1.0 - c * c).max(0.0).sqrt(), 0.0, c);
                exact::g2(w(o), w(i), DVec2::splat(a)) / (4.0 * o * i)
            },
            (
                domains::log_range(1e-4, 1.0),
                domains::log_range(1e-4, 1.0),
                domains::log_range(1e-4, 1.0),
            ),
        )
        .few_ulp(4.25, 16.5)
        .hard([(1.0, 1.0, 1e-4), (1e-4, 1e-4, 1.0), (1e-4, 1.0, 1e-4)])
        .source(HEITZ)
        .build(),
    ]
}
