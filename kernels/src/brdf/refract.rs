//! Refraction: the pair and its contract.

pub use raytwin_cpu::brdf::refract::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::REFRACT;

#[cfg(feature = "contract")]
crate::value_struct!(Refraction {
    direction: glam::Vec3,
    cos_transmitted: f32,
    total: u32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, Vec3};

    /// `1 - e²`, `e` and the near cosine; `e` is the near index over the far.
    fn sides(wi: DVec3, n: DVec3, eta: f64) -> (f64, f64, f64) {
        let c = wi.dot(n);
        if c >= 0.0 {
            ((eta * eta - 1.0) / (eta * eta), 1.0 / eta, c)
        } else {
            (1.0 - eta * eta, eta, -c)
        }
    }
    /// The tangent is scaled, the part along the normal has the far cosine.
    fn snell(wi: DVec3, n: DVec3, eta: f64) -> (DVec3, f64, u32) {
        let (rest, e, c) = sides(wi, n, eta);
        let square = rest + e * e * c * c;
        let mirror = n * (2.0 * wi.dot(n)) - wi;
        if square < 0.0 {
            return (mirror, 0.0, 1);
        }
        let inward = if wi.dot(n) >= 0.0 { -n } else { n };
        // f32 vectors are not unit: what is not along the normal is tangent.
        let tangent = (-wi - inward * c) * e;
        (tangent + inward * square.sqrt(), square.sqrt(), 0)
    }
    /// How far the far cosine moves when the near one, a rounded dot product of
    /// unit vectors, and the index do.
    fn steepness(wi: DVec3, n: DVec3, eta: f64) -> f64 {
        let (rest, e, c) = sides(wi, n, eta);
        let terms = rest.abs() + e * e * c;
        let t = (rest + e * e * c * c).max(0.0).sqrt();
        let ratio = terms / t.max(terms.sqrt() / 4096.0).max(1e-300);
        0.5 * e.max(1.0).max(ratio)
    }
    let slanted = Vec3::new(0.6, 0.0, 0.8);
    let grazing = Vec3::new(0.99999994, 0.0, 1.745_329e-4);
    let tilted = Vec3::new(0.36, 0.48, 0.8);
    // A quarter close to 1.
    let eta = domains::log_range(0.4, 2.5)
        .and(domains::log_range(6e-8, 0.1))
        .and(domains::below(8))
        .map(|((even, near), pick)| match pick {
            6 => 1.0 - near,
            7 => 1.0 + near,
            _ => even,
        });
    vec![
        Kernel::new(
            "brdf/refract",
            "refract_snell",
            ["wi", "n", "eta"],
            refract_snell,
            snell,
            (domains::unit_vector(), domains::unit_vector(), eta),
        )
        .scale_by(steepness)
        // The side, and whether anything gets through.
        .undecided(|wi: DVec3, n: DVec3, eta: f64| {
            let (rest, e, c) = sides(wi, n, eta);
            let exact = wi * n == DVec3::ZERO;
            (!exact && c < 1e-6)
                || (rest < 0.0 && (rest + e * e * c * c).abs() < 2e-6 * (rest.abs() + e * e * c))
        })
        .few_ulp(4.5, 25.0)
        .hard([
            (Vec3::Z, Vec3::Z, 1.5),
            (-Vec3::Z, Vec3::Z, 1.5),
            // Along the surface.
            (Vec3::X, Vec3::Z, 1.5),
            (Vec3::X, Vec3::Z, 1.0),
            (Vec3::X, Vec3::Z, 0.6666667),
            (slanted, Vec3::Z, 1.0),
            (-slanted, tilted, 1.0),
            (slanted, Vec3::Z, 1.0000001),
            (grazing, Vec3::Z, 1.0000001),
            (grazing, Vec3::Z, 1.0001),
            (grazing, Vec3::Z, 1.5),
            (-grazing, Vec3::Z, 1.5),
            (-slanted, Vec3::Z, 1.5),
            // Total: from behind glass, and from the front of a bubble.
            (Vec3::new(0.8, 0.0, -0.6), Vec3::Z, 1.5),
            (Vec3::new(0.8, 0.0, 0.6), Vec3::Z, 0.6666667),
            // A little inside the critical angle of glass.
            (Vec3::new(0.6666, 0.0, -0.7454145), Vec3::Z, 1.5),
        ])
        .source("Snell's law in vector form")
        .baseline(
            "built-in refract, whose answer at total reflection is a zero vector",
            "fn baseline(wi: vec3f, n: vec3f, eta: f32) -> Refraction {
                let front = dot(wi, n) >= 0.0;
                let normal = select(-n, n, front);
                let d = refract(-wi, normal, select(eta, 1.0 / eta, front));
                return Refraction(d, -dot(d, normal), select(0u, 1u, dot(d, d) == 0.0));
            }",
            |wi: Vec3, n: Vec3, eta: f32| {
                let front = wi.dot(n) >= 0.0;
                let (normal, e) = if front { (n, 1.0 / eta) } else { (-n, eta) };
                let c = wi.dot(normal);
                let k = 1.0 - e * e * (1.0 - c * c);
                if k < 0.0 {
                    return Refraction {
                        direction: Vec3::ZERO,
                        cos_transmitted: 0.0,
                        total: 1,
                    };
                }
                let d = -wi * e + normal * (e * c - k.sqrt());
                Refraction {
                    direction: d,
                    cos_transmitted: -d.dot(normal),
                    total: 0,
                }
            },
        )
        .build(),
    ]
}
