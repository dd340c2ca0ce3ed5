//! The specular microfacet BRDF: the pair and its contract.

pub use raytwin_cpu::brdf::cook_torrance::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::COOK_TORRANCE;

/// One function, as a renderer has it, with the built-in functions.
#[cfg(feature = "contract")]
const BY_HAND: &str = "
fn baseline(wo: vec3f, wi: vec3f, alpha: vec2f, f0: vec3f) -> vec3f {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return vec3f(0.0);
    }
    let h = normalize(wo + wi);
    let s = vec3f(h.xy / alpha, h.z);
    let p = dot(s, s);
    let d = 1.0 / (3.14159265 * alpha.x * alpha.y * p * p);
    let o = vec3f(alpha * wo.xy, wo.z);
    let i = vec3f(alpha * wi.xy, wi.z);
    let v = 0.5 / (wi.z * length(o) + wo.z * length(i));
    let x = 1.0 - dot(wo, h);
    return (f0 + (1.0 - f0) * (x * x * x * x * x)) * (d * v);
}";

#[cfg(feature = "contract")]
fn by_hand(wo: glam::Vec3, wi: glam::Vec3, alpha: glam::Vec2, f0: glam::Vec3) -> glam::Vec3 {
    use glam::Vec3Swizzles;
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return glam::Vec3::ZERO;
    }
    let h = (wo + wi).normalize();
    let p = (h.xy() / alpha).extend(h.z).length_squared();
    let d = 1.0 / (std::f32::consts::PI * alpha.x * alpha.y * p * p);
    let o = (alpha * wo.xy()).extend(wo.z);
    let i = (alpha * wi.xy()).extend(wi.z);
    let v = 0.5 / (wi.z * o.length() + wo.z * i.length());
    let x = 1.0 - wo.dot(h);
    (f0 + (1.0 - f0) * (x * x * x * x * x)) * (d * v)
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ggx::cases::{ALPHAS, GRAZING, VIEWS, alpha, upper};
    use super::ggx::exact as ggx;
    use super::ggx_bounded::exact as bounded;
    use crate::contract::{Domain, Kernel, domains};
    use glam::{DVec2, DVec3, Vec2, Vec3};

    const MODULE: &str = "brdf/cook_torrance";
    const PAPER: &str = "Cook and Torrance 1982, ACM TOG 1(1); Heitz 2014, JCGT 3(2)";
    const WEIGHT: &str = "Heitz 2018, JCGT 7(4), equation 19, and its like";

    fn fresnel(o: DVec3, i: DVec3, f0: DVec3) -> DVec3 {
        f0 + (DVec3::ONE - f0) * (1.0 - (0.5 * (o + i).length()).min(1.0)).powi(5)
    }
    fn above(o: DVec3, i: DVec3) -> bool {
        o.z > 0.0 && i.z > 0.0
    }
    fn eval(o: DVec3, i: DVec3, a: DVec2, f0: DVec3) -> DVec3 {
        if !above(o, i) {
            return DVec3::ZERO;
        }
        fresnel(o, i, f0) * (ggx::d(ggx::half(o, i), a) * ggx::g2(o, i, a) / (4.0 * o.z * i.z))
    }
    fn ndf(o: DVec3, i: DVec3, a: DVec2, f0: DVec3) -> DVec3 {
        if !above(o, i) {
            return DVec3::ZERO;
        }
        let h = ggx::half(o, i);
        fresnel(o, i, f0) * (ggx::g2(o, i, a) * 0.5 * (o + i).length() / (o.z * h.z))
    }
    fn visible(o: DVec3, i: DVec3, a: DVec2, f0: DVec3) -> DVec3 {
        if !above(o, i) {
            return DVec3::ZERO;
        }
        fresnel(o, i, f0) * (ggx::g2(o, i, a) * (1.0 + ggx::lambda(o, a)))
    }
    fn limited(o: DVec3, i: DVec3, a: DVec2, f0: DVec3) -> DVec3 {
        if !above(o, i) {
            return DVec3::ZERO;
        }
        fresnel(o, i, f0) * (ggx::g2(o, i, a) * bounded::area(o, a) / o.z)
    }

    type Case = (Vec3, Vec3, Vec2, Vec3);
    let case: Domain<Case> = upper()
        .and(upper())
        .and(alpha())
        .and(domains::vec3(domains::range(0.02, 1.0)))
        .map(|(((o, i), a), f0)| (o, i, a, f0));
    let hard = || {
        let mut out: Vec<Case> = Vec::new();
        for o in VIEWS {
            for a in ALPHAS {
                out.push((o, GRAZING, a, Vec3::new(0.04, 0.5, 1.0)));
                out.push((o, Vec3::Z, a, Vec3::ONE));
            }
        }
        out.push((Vec3::Z, -Vec3::Z, Vec2::ONE, Vec3::ONE));
        out.push((Vec3::X, Vec3::Z, Vec2::ONE, Vec3::ONE));
        out
    };

    macro_rules! kernel {
        ($name:ident, $truth:expr, $cpu:expr, $gpu:expr, $source:expr) => {
            Kernel::new(
                MODULE,
                stringify!($name),
                ["wo", "wi", "alpha", "f0"],
                $name,
                $truth,
                case.clone(),
            )
            .few_ulp($cpu, $gpu)
            .hard(hard())
            .source($source)
        };
    }
    vec![
        kernel!(cook_torrance_eval, eval, 17.0, 95.0, PAPER)
            .baseline("by hand", BY_HAND, by_hand)
            .build(),
        kernel!(cook_torrance_weight_ndf, ndf, 11.0, 50.0, WEIGHT).build(),
        kernel!(cook_torrance_weight_visible, visible, 10.5, 52.0, WEIGHT).build(),
        kernel!(cook_torrance_weight_bounded, limited, 10.5, 52.0, WEIGHT).build(),
    ]
}
