//! Reflection rays: the pair and its contract.

pub use raytwin_cpu::brdf::reflection::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::REFLECTION;

#[cfg(feature = "contract")]
crate::value_struct!(ReflectionRay {
    direction: glam::Vec3,
    pdf: f32,
    below: u32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ggx::cases::{GRAZING, VIEWS, upper};
    use super::ggx::exact as ggx;
    use super::ggx_visible::exact as caps;
    use crate::contract::{Domain, Kernel, domains};
    use glam::{DVec2, DVec3, Vec2, Vec3};
    use std::f64::consts::TAU;

    const MODULE: &str = "brdf/reflection";
    const CHAPTER: &str = "Ray Tracing Gems 2019, chapter 25, 25.2.2";

    fn alpha() -> Domain<Vec2> {
        domains::log_range(0.02, 1.0)
            .and(domains::log_range(0.02, 1.0))
            .map(|(x, y)| Vec2::new(x, y))
    }
    /// Above the surface by half a degree and more.
    fn view() -> Domain<Vec3> {
        domains::range(0.01, 1.0)
            .and(domains::unit())
            .map(|(z, turn)| {
                let (s, c) = (f64::from(turn) * TAU).sin_cos();
                let r = ((1.0 - f64::from(z)) * (1.0 + f64::from(z))).sqrt();
                Vec3::new((r * c) as f32, (r * s) as f32, z)
            })
    }

    fn image(i: DVec3) -> DVec3 {
        DVec3::new(i.x, i.y, -i.z)
    }
    fn between(o: DVec3, i: DVec3, a: DVec2) -> f64 {
        let m = o + i;
        if m.z <= 0.0 || m.length() < 1e-15 {
            return 0.0;
        }
        ggx::d(m.normalize(), a)
    }
    fn pdf(o: DVec3, i: DVec3, a: DVec2) -> f64 {
        if o.z <= 0.0 || i.z < 0.0 {
            return 0.0;
        }
        let d = between(o, i, a) + between(o, image(i), a);
        d / (4.0 * ggx::projected_area(o, a))
    }
    fn ndf_pdf(o: DVec3, i: DVec3, a: DVec2) -> f64 {
        if o.z <= 0.0 || i.z <= 0.0 {
            return 0.0;
        }
        let h = ggx::half(o, i);
        ggx::d(h, a) * h.z / (2.0 * (o + i).length())
    }
    /// The radius with which the half vector is drawn.
    fn radius(o: DVec3, i: DVec3, a: DVec2) -> f64 {
        let h = o + i;
        let slope = (h.truncate() / h.z / a).length_squared();
        slope / (1.0 + slope)
    }
    fn visible(u: DVec2, o: DVec3, a: DVec2) -> DVec3 {
        ggx::reflect(o, caps::sample(u, o, a, 1.0))
    }
    fn trimmed(u: DVec2, o: DVec3, a: DVec2, trim: f64) -> DVec3 {
        let u = DVec2::new(u.x * trim, u.y);
        let slope = DVec2::from_angle(TAU * u.y) * (u.x / (1.0 - u.x)).sqrt() * a;
        ggx::reflect(o, slope.extend(1.0).normalize())
    }
    /// A direction's roundings move a density by at most its slope, about
    /// 4/alpha of it.
    fn slope(density: f64, a: DVec2) -> f64 {
        density * 4.0 / a.min_element()
    }

    let us = [
        Vec2::ZERO,
        Vec2::new(0.3, 0.2),
        Vec2::new(0.9, 0.55),
        Vec2::new(0.5, 0.99999994),
    ];
    let alphas = [Vec2::splat(0.02), Vec2::ONE, Vec2::new(0.1, 0.8)];
    let views = [
        Vec3::Z,
        Vec3::new(0.6, 0.0, 0.8),
        Vec3::new(0.0, 0.99498743, 0.1),
    ];
    let mut hard_sample = Vec::new();
    let mut hard_trimmed = Vec::new();
    for u in us {
        for o in views {
            for a in alphas {
                hard_sample.push((u, o, a));
                hard_trimmed.push((u, o, a, 0.8));
            }
        }
    }
    let mut hard_pdf = Vec::new();
    for o in VIEWS {
        for a in alphas {
            hard_pdf.push((o, GRAZING, a));
        }
    }
    hard_pdf.push((Vec3::Z, Vec3::new(0.6, 0.0, -0.8), Vec2::ONE));
    hard_pdf.push((-Vec3::Z, Vec3::Z, Vec2::ONE));

    vec![
        Kernel::new(
            MODULE,
            "reflection_kind",
            ["roughness", "mirror", "diffuse"],
            reflection_kind,
            |r: f64, mirror: f64, diffuse: f64| {
                if r < mirror {
                    0
                } else if r > diffuse {
                    2
                } else {
                    1
                }
            },
            (
                domains::range(0.0, 1.0),
                domains::range(0.0, 0.2),
                domains::range(0.3, 1.0),
            ),
        )
        .bit_exact()
        .hard([(0.05, 0.05, 0.75), (0.75, 0.05, 0.75), (0.0, 0.0, 0.0)])
        .source("roughness cuts of the hybrid-rendering blog")
        .build(),
        Kernel::new(
            MODULE,
            "reflection_sample",
            ["u", "wo", "alpha"],
            reflection_sample,
            |u: DVec2, o: DVec3, a: DVec2| {
                let d = visible(u, o, a);
                let up = DVec3::new(d.x, d.y, d.z.abs());
                (up, pdf(o, up, a), u32::from(d.z < 0.0))
            },
            (domains::unit_pair(), view(), alpha()),
        )
        .scale_by(|u: DVec2, o: DVec3, a: DVec2| {
            let d = visible(u, o, a);
            let up = DVec3::new(d.x, d.y, d.z.abs());
            let near = (o + up).length().min((o + image(up)).length());
            let steep = 1.0 + 1.0 / near.max(1e-3);
            (1.0 + caps::condition(u, o, a, 1.0)) * (1.0 + slope(pdf(o, up, a), a) * steep)
        })
        // Below or not; and the alternative's normal is at the horizon, where the
        // distribution ends with a step, as heights above and below are equal.
        .undecided(|u: DVec2, o: DVec3, a: DVec2| {
            let d = visible(u, o, a);
            d.z.abs() < 1e-4
                || (o.z - d.z.abs()).abs() < 1e-6
                || (o + d).length() < 1e-3
                || caps::condition(u, o, a, 1.0) > caps::LOST
        })
        .few_ulp(3.75, 84.0)
        .hard(hard_sample)
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "reflection_pdf",
            ["wo", "wi", "alpha"],
            reflection_pdf,
            pdf,
            (upper(), upper(), alpha()),
        )
        // The image's normal is a difference of heights.
        .scale_by(|o: DVec3, i: DVec3, a: DVec2| slope(pdf(o, i, a), a))
        .few_ulp(2.0, 11.5)
        .hard(hard_pdf.clone())
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "reflection_trimmed_sample",
            ["u", "wo", "alpha", "trim"],
            reflection_trimmed_sample,
            |u: DVec2, o: DVec3, a: DVec2, trim: f64| {
                let d = trimmed(u, o, a, trim);
                (d, ndf_pdf(o, d, a) / trim, u32::from(d.z <= 0.0))
            },
            (
                domains::unit_pair(),
                view(),
                alpha(),
                domains::range(0.5, 1.0),
            ),
        )
        // The normal's distance from the horizon divides the azimuth's part.
        .scale_by(|u: DVec2, o: DVec3, a: DVec2, trim: f64| {
            let d = trimmed(u, o, a, trim);
            let p = if d.z > 0.0 {
                ndf_pdf(o, d, a) / trim
            } else {
                0.0
            };
            let steep = 1.0 + 1.0 / (o + d).length().max(1e-3);
            let rim = 1.0 / (1.0 - u.x * trim).sqrt();
            2.0 * rim.min(4096.0) * (1.0 + slope(p, a) * steep)
        })
        .undecided(|u: DVec2, o: DVec3, a: DVec2, trim: f64| trimmed(u, o, a, trim).z.abs() < 1e-4)
        .few_ulp(2.75, 26.0)
        .hard(hard_trimmed)
        .source("trim of the hybrid-rendering blog, of the radius alone")
        .build(),
        Kernel::new(
            MODULE,
            "reflection_trimmed_pdf",
            ["wo", "wi", "alpha", "trim"],
            reflection_trimmed_pdf,
            |o: DVec3, i: DVec3, a: DVec2, trim: f64| {
                if radius(o, i, a) > trim {
                    0.0
                } else {
                    ndf_pdf(o, i, a) / trim
                }
            },
            (upper(), upper(), alpha(), domains::range(0.5, 1.0)),
        )
        .undecided(|o: DVec3, i: DVec3, a: DVec2, trim: f64| {
            (radius(o, i, a) / trim - 1.0).abs() < 1e-5
        })
        .few_ulp(12.0, 58.0)
        .hard(hard_pdf.into_iter().map(|(o, i, a)| (o, i, a, 0.8)))
        .source("trim of the hybrid-rendering blog, of the radius alone")
        .build(),
    ]
}
