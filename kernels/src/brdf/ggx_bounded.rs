//! Bounded visible microfacet normals: the pair and its contract.

pub use raytwin_cpu::brdf::ggx_bounded::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::GGX_BOUNDED;

#[cfg(feature = "contract")]
crate::value_struct!(GgxBoundedDirection {
    direction: glam::Vec3,
    pdf: f32,
});

/// The paper's bound in double precision.
#[cfg(feature = "contract")]
pub(crate) mod exact {
    use crate::brdf::ggx::exact as ggx;
    use glam::{DVec2, DVec3};

    /// Equation 5: `k = (1 - a²) s² / (s² + a² cos²)`, `s = 1 + sin`.
    pub fn depth(o: DVec3, a: DVec2) -> f64 {
        if o.z <= 0.0 {
            return 1.0;
        }
        let a2 = a.min_element().min(1.0).powi(2);
        let s2 = (1.0 + o.truncate().length()).powi(2);
        (1.0 - a2) * s2 / (s2 + a2 * o.z * o.z)
    }

    /// What divides the density.
    pub fn area(o: DVec3, a: DVec2) -> f64 {
        if o.z <= 0.0 {
            return ggx::projected_area(o, a);
        }
        0.5 * (depth(o, a) * o.z + ggx::stretched(o, a))
    }

    pub fn direction_pdf(o: DVec3, i: DVec3, a: DVec2) -> f64 {
        if o.z <= 0.0 || i.z <= 0.0 {
            return 0.0;
        }
        ggx::d(ggx::half(o, i), a) / (4.0 * area(o, a))
    }
}

/// One function, as a renderer has it: the paper's listing, the reflection and
/// the density in a row, with the built-in functions.
#[cfg(feature = "contract")]
const BY_HAND: &str = "
fn baseline(u: vec2f, wo: vec3f, alpha: vec2f) -> GgxBoundedDirection {
    let stretched = vec3f(alpha * wo.xy, wo.z);
    let length = sqrt(dot(stretched, stretched));
    let o = stretched / length;
    let a = min(min(alpha.x, alpha.y), 1.0);
    let s = 1.0 + sqrt(dot(wo.xy, wo.xy));
    let k = (1.0 - a * a) * (s * s) / (s * s + a * a * wo.z * wo.z);
    let z = (1.0 - u.x) * (1.0 + k * o.z) - k * o.z;
    let r = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    let phi = 6.2831853 * u.y;
    let n = vec3f(r * cos(phi), r * sin(phi), z) + o;
    let m = vec3f(alpha * n.xy, n.z);
    let h = normalize(m);
    let wi = 2.0 * dot(wo, h) * h - wo;
    let q = dot(m, m) / dot(n, n);
    let d = q * q / (3.14159265 * alpha.x * alpha.y);
    let pdf = d / (2.0 * (k * wo.z + length));
    return GgxBoundedDirection(wi, select(0.0, pdf, wi.z > 0.0 && wo.z > 0.0));
}";

#[cfg(feature = "contract")]
fn by_hand(u: glam::Vec2, wo: glam::Vec3, alpha: glam::Vec2) -> GgxBoundedDirection {
    use glam::Vec3Swizzles;
    let stretched = (alpha * wo.xy()).extend(wo.z);
    let length = stretched.length();
    let o = stretched / length;
    let a = alpha.min_element().min(1.0);
    let s = 1.0 + wo.xy().length();
    let k = (1.0 - a * a) * (s * s) / (s * s + a * a * wo.z * wo.z);
    let z = (1.0 - u.x) * (1.0 + k * o.z) - k * o.z;
    let r = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let (sin, cos) = (std::f32::consts::TAU * u.y).sin_cos();
    let n = glam::Vec3::new(r * cos, r * sin, z) + o;
    let m = (alpha * n.xy()).extend(n.z);
    let h = m.normalize();
    let direction = 2.0 * wo.dot(h) * h - wo;
    let q = m.length_squared() / n.length_squared();
    let d = q * q / (std::f32::consts::PI * alpha.x * alpha.y);
    let pdf = d / (2.0 * (k * wo.z + length));
    GgxBoundedDirection {
        direction,
        pdf: if direction.z > 0.0 && wo.z > 0.0 {
            pdf
        } else {
            0.0
        },
    }
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ggx::cases::{ALPHAS, GRAZING, US, VIEWS, alpha, upper};
    use super::ggx::exact as ggx;
    use super::ggx::ggx_reflect;
    use super::ggx_visible::exact as caps;
    use crate::contract::{Domain, Kernel, domains};
    use crate::sample::disk::azimuth;
    use glam::{DVec2, DVec3, Vec2, Vec3};

    const UNIT: &str =
        "each component of a normalised vector is monotone in the size of each of the vector";
    const MODULE: &str = "brdf/ggx_bounded";
    const PAPER: &str = "Eto and Tokuyoshi 2023, SIGGRAPH Asia Technical Communications, listing 1";

    let seen: Domain<(Vec3, Vec3, Vec2)> = domains::unit_pair()
        .and(upper())
        .and(alpha())
        .map(|((u, o), a)| (ggx_bounded_sample(u, o, a), o, a));
    let hard_sample = US.into_iter().flat_map(|u| {
        VIEWS
            .into_iter()
            .flat_map(move |o| ALPHAS.map(move |a| (u, o, a)))
    });
    let hard_invert = VIEWS
        .into_iter()
        .flat_map(|o| ALPHAS.map(|a| (ggx_bounded_sample(Vec2::new(0.3, 0.2), o, a), o, a)));

    fn reflected(u: DVec2, o: DVec3, a: DVec2) -> (DVec3, f64) {
        if o.z <= 0.0 {
            return (DVec3::Z, 0.0);
        }
        let d = ggx::reflect(o, caps::sample(u, o, a, exact::depth(o, a)));
        (d, exact::direction_pdf(o, d, a))
    }

    vec![
        Kernel::new(
            MODULE,
            "ggx_bounded_direction_sample",
            ["u", "wo", "alpha"],
            ggx_bounded_direction_sample,
            reflected,
            (domains::unit_pair(), upper(), alpha()),
        )
        // The direction's errors are absolute, the density's relative.
        .scale_by(|u: DVec2, o: DVec3, a: DVec2| {
            let depth = exact::depth(o, a);
            let lost = caps::condition(u, o, a, depth) + caps::condition_stretched(u, o, a, depth);
            (1.0 + lost) * (1.0 + reflected(u, o, a).1)
        })
        // Dropped or not.
        .undecided(|u: DVec2, o: DVec3, a: DVec2| {
            let depth = exact::depth(o, a);
            let lost = caps::condition(u, o, a, depth) + caps::condition_stretched(u, o, a, depth);
            lost > caps::LOST || reflected(u, o, a).0.z.abs() < 1e-6 * (1.0 + lost)
        })
        .few_ulp(8.5, 127.0)
        .hard(
            hard_sample
                .clone()
                .chain([(Vec2::splat(0.5), -Vec3::Z, Vec2::ONE)]),
        )
        .source(PAPER)
        .baseline("by hand", BY_HAND, by_hand)
        .baseline(
            "sample, reflect, density",
            "fn baseline(u: vec2f, wo: vec3f, alpha: vec2f) -> GgxBoundedDirection {
                let wi = ggx_reflect(wo, ggx_bounded_sample(u, wo, alpha));
                return GgxBoundedDirection(wi, ggx_bounded_direction_pdf(wo, wi, alpha));
            }",
            |u: Vec2, wo: Vec3, alpha: Vec2| {
                let direction = ggx_reflect(wo, ggx_bounded_sample(u, wo, alpha));
                GgxBoundedDirection {
                    direction,
                    pdf: ggx_bounded_direction_pdf(wo, direction, alpha),
                }
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "ggx_bounded_lift",
            ["wo", "alpha"],
            ggx_bounded_lift,
            |o: DVec3, a: DVec2| 1.0 - exact::depth(o, a),
            (upper(), alpha()),
        )
        .few_ulp(4.0, 26.0)
        .hard(
            VIEWS
                .into_iter()
                .chain([-Vec3::Z, Vec3::X])
                .flat_map(|o| ALPHAS.map(|a| (o, a))),
        )
        .source(PAPER)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_bounded_sample",
            ["u", "wo", "alpha"],
            ggx_bounded_sample,
            |u: DVec2, o: DVec3, a: DVec2| caps::sample(u, o, a, exact::depth(o, a)),
            (domains::unit_pair(), upper(), alpha()),
        )
        .scale_by(|u: DVec2, o: DVec3, a: DVec2| caps::condition(u, o, a, exact::depth(o, a)))
        .by_ends(&[("ggx_bounded_sample", "m")], UNIT)
        .undecided(|u: DVec2, o: DVec3, a: DVec2| {
            caps::condition(u, o, a, exact::depth(o, a)) > caps::LOST
        })
        .few_ulp(5.25, 37.5)
        .hard(hard_sample)
        .source(PAPER)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_bounded_invert",
            ["h", "wo", "alpha"],
            ggx_bounded_invert,
            |h: DVec3, o: DVec3, a: DVec2| {
                let c = caps::cap(h, o, a);
                let u = (1.0 - c.z) / (1.0 + exact::depth(o, a) * caps::stretch(o, a).z);
                DVec2::new(u.clamp(0.0, 1.0), azimuth(c.y, c.x).0)
            },
            seen.clone(),
        )
        .scale_by(|h: DVec3, o: DVec3, a: DVec2| {
            0.5 + 1.0 / caps::cap(h, o, a).truncate().length().max(1e-6)
        })
        .undecided(|h: DVec3, o: DVec3, a: DVec2| {
            let c = caps::cap(h, o, a);
            c.truncate().length() < 1e-3 || azimuth(c.y, c.x).1 || (c.y.abs() < 1e-4 && c.x > 0.0)
        })
        .few_ulp(5.0, 41.0)
        .hard(hard_invert)
        .source(PAPER)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_bounded_pdf",
            ["h", "wo", "alpha"],
            ggx_bounded_pdf,
            |h: DVec3, o: DVec3, a: DVec2| {
                let area = exact::area(o, a);
                if area < 1e-30 {
                    return 0.0;
                }
                ggx::d(h, a) * o.dot(h).max(0.0) / area
            },
            seen,
        )
        .scale_by(|h: DVec3, o: DVec3, a: DVec2| {
            let area = exact::area(o, a).max(1e-30);
            ggx::d(h, a) * (o * h).abs().element_sum() / area
        })
        .few_ulp(12.0, 51.0)
        .hard(
            VIEWS
                .into_iter()
                .flat_map(|o| ALPHAS.map(|a| (Vec3::Z, o, a)))
                .chain([(Vec3::X, -Vec3::Z, Vec2::ONE)]),
        )
        .source(PAPER)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_bounded_direction_pdf",
            ["wo", "wi", "alpha"],
            ggx_bounded_direction_pdf,
            exact::direction_pdf,
            (upper(), upper(), alpha()),
        )
        .few_ulp(16.0, 70.0)
        .hard(
            VIEWS
                .into_iter()
                .flat_map(|o| ALPHAS.map(|a| (o, GRAZING, a)))
                .chain([
                    (Vec3::Z, Vec3::new(0.6, 0.0, -0.8), Vec2::ONE),
                    (-Vec3::Z, Vec3::Z, Vec2::ONE),
                ]),
        )
        .source(PAPER)
        .build(),
    ]
}
