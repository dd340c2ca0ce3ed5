//! Visible microfacet normals: the pair and its contract.

pub use raytwin_cpu::brdf::ggx_visible::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::GGX_VISIBLE;

/// The caps in double precision, for this contract and the bounded ones'.
#[cfg(feature = "contract")]
pub(crate) mod exact {
    use glam::{DVec2, DVec3};
    use std::f64::consts::TAU;

    /// Above this condition the normal is at a right angle to the view to
    /// within rounding: the cap's point is opposite to the view direction.
    pub const LOST: f64 = 1e3;

    pub fn stretch(o: DVec3, a: DVec2) -> DVec3 {
        (o.truncate() * a).extend(o.z).normalize()
    }

    pub fn unstretch(h: DVec3, a: DVec2) -> DVec3 {
        (h.truncate() / a).extend(h.z).normalize()
    }

    /// The sum of cap point and view, stretched back; and the cap's radius.
    fn sum(u: DVec2, o: DVec3, a: DVec2, depth: f64) -> (DVec3, f64) {
        let s = stretch(o, a);
        let bottom = -depth * s.z;
        let z = 1.0 + u.x * (bottom - 1.0);
        let r = (1.0 - z * z).max(0.0).sqrt();
        let m = (DVec2::from_angle(TAU * u.y) * r).extend(z) + s;
        ((m.truncate() * a).extend(m.z), r)
    }

    /// The normal that a cap down to `-depth · z` gives.
    pub fn sample(u: DVec2, o: DVec3, a: DVec2, depth: f64) -> DVec3 {
        sum(u, o, a, depth).0.normalize()
    }

    /// How far roundings of the cap's coordinates move the normal.
    ///
    /// The horizontal sum moves by roundings of its two terms, is stretched by
    /// alpha, and counts over the whole sum's length.
    pub fn condition(u: DVec2, o: DVec3, a: DVec2, depth: f64) -> f64 {
        let (m, r) = sum(u, o, a, depth);
        let side = a.max_element() * (r + stretch(o, a).truncate().length());
        side / m.length()
    }

    /// The same of that sum before it is stretched back.
    pub fn condition_stretched(u: DVec2, o: DVec3, a: DVec2, depth: f64) -> f64 {
        condition(u, stretch(o, a), DVec2::ONE, depth)
    }

    /// The cap's horizontal radius at a normal, small where the azimuth is
    /// uncertain.
    pub fn cap(h: DVec3, o: DVec3, a: DVec2) -> DVec3 {
        let (s, n) = (stretch(o, a), unstretch(h, a));
        n * (2.0 * s.dot(n)) - s
    }
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ggx::cases::{ALPHAS, GRAZING, US, VIEWS, alpha, upper};
    use super::ggx::exact as ggx;
    use crate::contract::{Domain, Kernel, domains};
    use crate::sample::disk::azimuth;
    use glam::{DVec2, DVec3, Vec2, Vec3};
    use std::f64::consts::TAU;

    const UNIT: &str =
        "each component of a normalised vector is monotone in the size of each of the vector";
    const MODULE: &str = "brdf/ggx_visible";
    const CAPS: &str = "Dupuy and Benyoub 2023, HPG (CGF 42(8)), listing 1";
    const HEITZ: &str = "Heitz 2018, JCGT 7(4), appendix A";
    const DENSITY: &str = "Heitz 2018, JCGT 7(4), equations 3 and 17";

    // Normals that a viewer sees, with the viewer.
    let seen: Domain<(Vec3, Vec3, Vec2)> = domains::unit_pair()
        .and(upper())
        .and(alpha())
        .map(|((u, o), a)| (ggx_visible_sample(u, o, a), o, a));
    let hard_pdf = VIEWS
        .into_iter()
        .flat_map(|o| ALPHAS.map(|a| (Vec3::Z, o, a)))
        .chain([
            (Vec3::X, -Vec3::Z, Vec2::ONE),
            (
                Vec3::new(0.8, 0.0, 0.6),
                Vec3::new(0.6, 0.0, -0.8),
                Vec2::splat(0.01),
            ),
            (Vec3::Z, Vec3::new(0.6, 0.0, -0.8), Vec2::ONE),
        ]);
    let hard_sample = || {
        US.into_iter().flat_map(|u| {
            VIEWS
                .into_iter()
                .flat_map(move |o| ALPHAS.map(move |a| (u, o, a)))
        })
    };
    let hard_invert = || {
        VIEWS
            .into_iter()
            .flat_map(|o| ALPHAS.map(|a| (ggx_visible_sample(Vec2::new(0.3, 0.2), o, a), o, a)))
    };

    // Heitz's disk: point, chord of the disk, height over it, in f64.
    fn disk(u: DVec2, o: DVec3, a: DVec2) -> (DVec3, f64, f64) {
        let s = exact::stretch(o, a);
        let t = if s.truncate() == DVec2::ZERO {
            DVec3::X
        } else {
            s.truncate().perp().normalize().extend(0.0)
        };
        let b = s.cross(t);
        let p = DVec2::from_angle(TAU * u.y) * u.x.sqrt();
        let rim = (1.0 - p.x * p.x).max(0.0).sqrt();
        let k = 0.5 * (1.0 + s.z);
        let y = rim + k * (p.y - rim);
        let z = (rim * rim - y * y).max(0.0).sqrt();
        (t * p.x + b * y + s * z, rim, z)
    }
    fn heitz(u: DVec2, o: DVec3, a: DVec2) -> DVec3 {
        let n = disk(u, o, a).0;
        (n.truncate() * a).extend(n.z.max(0.0)).normalize()
    }
    fn heitz_condition(u: DVec2, o: DVec3, a: DVec2) -> f64 {
        let (n, rim, z) = disk(u, o, a);
        let m = (n.truncate() * a).extend(n.z.max(0.0));
        let wobble = 1.0 + 1.0 / rim.max(1e-3) + 1.0 / z.max(1e-3);
        let side = a.max_element() + m.normalize().truncate().length();
        side * wobble / m.length()
    }
    fn heitz_invert(h: DVec3, o: DVec3, a: DVec2) -> (DVec2, f64) {
        let s = exact::stretch(o, a);
        let n = exact::unstretch(h, a);
        let t = if s.truncate() == DVec2::ZERO {
            DVec3::X
        } else {
            s.truncate().perp().normalize().extend(0.0)
        };
        let x = n.dot(t);
        let rim = (1.0 - x * x).max(0.0).sqrt();
        let k = 0.5 * (1.0 + s.z);
        let y = rim + (n.dot(s.cross(t)) - rim) / k;
        (DVec2::new(x, y), rim)
    }

    vec![
        Kernel::new(
            MODULE,
            "ggx_visible_sample",
            ["u", "wo", "alpha"],
            ggx_visible_sample,
            |u: DVec2, o: DVec3, a: DVec2| exact::sample(u, o, a, 1.0),
            (domains::unit_pair(), upper(), alpha()),
        )
        .scale_by(|u: DVec2, o: DVec3, a: DVec2| exact::condition(u, o, a, 1.0))
        .by_ends(&[("ggx_visible_sample", "m")], UNIT)
        .undecided(|u: DVec2, o: DVec3, a: DVec2| exact::condition(u, o, a, 1.0) > exact::LOST)
        .few_ulp(5.25, 34.5)
        .hard(hard_sample())
        .source(CAPS)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_visible_invert",
            ["h", "wo", "alpha"],
            ggx_visible_invert,
            |h: DVec3, o: DVec3, a: DVec2| {
                let c = exact::cap(h, o, a);
                let u = (1.0 - c.z) / (1.0 + exact::stretch(o, a).z);
                DVec2::new(u.clamp(0.0, 1.0), azimuth(c.y, c.x).0)
            },
            seen.clone(),
        )
        .scale_by(|h: DVec3, o: DVec3, a: DVec2| {
            0.5 + 1.0 / exact::cap(h, o, a).truncate().length().max(1e-6)
        })
        .undecided(|h: DVec3, o: DVec3, a: DVec2| {
            let c = exact::cap(h, o, a);
            c.truncate().length() < 1e-3 || azimuth(c.y, c.x).1 || (c.y.abs() < 1e-4 && c.x > 0.0)
        })
        .few_ulp(3.75, 24.0)
        .hard(hard_invert())
        .source(CAPS)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_visible_sample_heitz",
            ["u", "wo", "alpha"],
            ggx_visible_sample_heitz,
            heitz,
            (domains::unit_pair(), upper(), alpha()),
        )
        .scale_by(heitz_condition)
        .by_ends(&[("ggx_visible_sample_heitz", "m")], UNIT)
        .undecided(|u: DVec2, o: DVec3, a: DVec2| heitz_condition(u, o, a) > exact::LOST)
        .few_ulp(4.5, 23.0)
        .hard(hard_sample())
        .source(HEITZ)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_visible_invert_heitz",
            ["h", "wo", "alpha"],
            ggx_visible_invert_heitz,
            |h: DVec3, o: DVec3, a: DVec2| {
                let (p, _) = heitz_invert(h, o, a);
                DVec2::new(p.length_squared().min(1.0), azimuth(p.y, p.x).0)
            },
            seen.clone(),
        )
        .scale_by(|h: DVec3, o: DVec3, a: DVec2| {
            let (p, rim) = heitz_invert(h, o, a);
            1.0 / (p.length().max(1e-3) * rim.max(1e-3))
        })
        .undecided(|h: DVec3, o: DVec3, a: DVec2| {
            let (p, rim) = heitz_invert(h, o, a);
            rim < 1e-2
                || p.length() < 1e-2
                || p.length() > 1.0 - 1e-4
                || azimuth(p.y, p.x).1
                || (p.y.abs() < 1e-4 && p.x > 0.0)
        })
        .few_ulp(12.5, 155.0)
        .hard(hard_invert())
        .source(HEITZ)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_visible_pdf",
            ["h", "wo", "alpha"],
            ggx_visible_pdf,
            |h: DVec3, o: DVec3, a: DVec2| {
                let area = ggx::projected_area(o, a);
                if area < 1e-30 {
                    return 0.0;
                }
                ggx::d(h, a) * o.dot(h).max(0.0) / area
            },
            seen,
        )
        // The cosine's terms may cancel.
        .scale_by(|h: DVec3, o: DVec3, a: DVec2| {
            let area = ggx::projected_area(o, a).max(1e-30);
            ggx::d(h, a) * (o * h).abs().element_sum() / area
        })
        .few_ulp(12.0, 47.0)
        .hard(hard_pdf)
        .source(DENSITY)
        .build(),
        Kernel::new(
            MODULE,
            "ggx_visible_direction_pdf",
            ["wo", "wi", "alpha"],
            ggx_visible_direction_pdf,
            |o: DVec3, i: DVec3, a: DVec2| {
                if o.z <= 0.0 || i.z <= 0.0 {
                    return 0.0;
                }
                ggx::d(ggx::half(o, i), a) / (4.0 * ggx::projected_area(o, a))
            },
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
        .source(DENSITY)
        .build(),
    ]
}
