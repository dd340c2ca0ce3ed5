//! Fresnel reflectance: the pair and its contract.

pub use raytwin_cpu::brdf::fresnel::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::FRESNEL;

/// Fresnel's equations in double precision, by complex amplitudes, and how
/// steep they are.
#[cfg(feature = "contract")]
mod exact {
    use glam::{DVec2, DVec3};

    pub fn schlick(f0: f64, cos: f64) -> f64 {
        f0 + (1.0 - f0) * (1.0 - cos.clamp(0.0, 1.0)).powi(5)
    }

    /// By the cosine on the side of the lower index, 1 if there is none.
    pub fn schlick_transmitted(f0: f64, cos: f64, eta: f64) -> f64 {
        if eta >= 1.0 {
            return schlick(f0, cos);
        }
        // Products of two f32 are exact in f64.
        let square = eta * eta - 1.0 + cos * cos;
        if square <= 0.0 {
            return 1.0;
        }
        schlick(f0, square.sqrt() / eta)
    }

    pub fn dielectric(cos: f64, eta: f64) -> f64 {
        let square = eta * eta - 1.0 + cos * cos;
        if square < 0.0 {
            return 1.0;
        }
        if eta == 1.0 {
            return 0.0;
        }
        let g = square.sqrt();
        let s = (cos - g) / (cos + g);
        let p = (eta * eta * cos - g) / (eta * eta * cos + g);
        0.5 * (s * s + p * p)
    }

    fn multiply(a: DVec2, b: DVec2) -> DVec2 {
        DVec2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
    }

    fn divide(a: DVec2, b: DVec2) -> DVec2 {
        multiply(a, DVec2::new(b.x, -b.y)) / b.length_squared()
    }

    /// The principal root, for an imaginary part of at least 0.
    fn root(z: DVec2) -> DVec2 {
        let r = z.length();
        if r == 0.0 {
            DVec2::ZERO
        } else if z.x >= 0.0 {
            let x = (0.5 * (r + z.x)).sqrt();
            DVec2::new(x, 0.5 * z.y / x)
        } else {
            let y = (0.5 * (r - z.x)).sqrt();
            DVec2::new(0.5 * z.y / y, y)
        }
    }

    /// `n cos_t` as a complex number.
    fn far(cos: f64, eta: f64, k: f64) -> DVec2 {
        root(DVec2::new(
            (eta * eta - 1.0 + cos * cos) - k * k,
            2.0 * eta * k,
        ))
    }

    fn metal(cos: f64, eta: f64, k: f64) -> f64 {
        if eta == 1.0 && k == 0.0 {
            return 0.0;
        }
        let n = DVec2::new(eta, k);
        let n2 = multiply(n, n);
        let g = far(cos, eta, k);
        let c = DVec2::new(cos, 0.0);
        let s = divide(c - g, c + g);
        let p = divide(n2 * cos - g, n2 * cos + g);
        0.5 * (s.length_squared() + p.length_squared())
    }

    pub fn conductor(cos: f64, eta: DVec3, k: DVec3) -> DVec3 {
        let at = |i: usize| metal(cos, eta[i], k[i]);
        DVec3::new(at(0), at(1), at(2))
    }

    /// Size of the terms of which `n² - sin²` is the sum, and the length of its
    /// root, not below what those terms leave certain of it.
    pub fn edge(cos: f64, eta: f64, k: f64) -> (f64, f64) {
        let low = cos * cos + (eta * eta - 1.0).abs();
        let high = eta * eta + 1.0 - cos * cos;
        let terms = low.min(high) + k * k;
        let g = far(cos, eta, k).length();
        (terms, g.max(terms.sqrt() / 4096.0))
    }

    /// The reflectance, or how far it moves (in the same unit) when those terms
    /// do: the reflected amplitude changes with `g` over `min(1, |n|²) cos + g`.
    pub fn steepness(cos: f64, eta: f64, k: f64) -> f64 {
        let (terms, g) = edge(cos, eta, k);
        let n2 = (eta * eta + k * k).min(1.0);
        let ratio = terms / (g * (n2 * cos + g)).max(1e-300);
        metal(cos, eta, k) * ratio.max(1.0)
    }
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};
    use glam::{DVec3, Vec3};

    const MODULE: &str = "brdf/fresnel";
    const SCHLICK: &str = "Schlick 1994, An Inexpensive BRDF Model";
    const FRESNEL: &str = "Born and Wolf, Principles of Optics, 1.5.2";

    /// Uniform, with a quarter each near the horizon and near the normal.
    fn cosine() -> Domain<f32> {
        domains::range(0.0, 1.0)
            .and(domains::log_range(1e-5, 1.0))
            .and(domains::below(4))
            .map(|((even, near), pick)| match pick {
                2 => near,
                3 => 1.0 - near,
                _ => even,
            })
    }
    /// From `low` to `high`, a quarter of them close to 1.
    fn index(low: f32, high: f32) -> Domain<f32> {
        domains::log_range(low, high)
            .and(domains::log_range(6e-8, 0.1))
            .and(domains::below(8))
            .map(|((even, near), pick)| match pick {
                6 => 1.0 - near,
                7 => 1.0 + near,
                _ => even,
            })
    }
    /// Extinction; an eighth of them none.
    fn extinction() -> Domain<f32> {
        domains::range(0.0, 10.0)
            .and(domains::log_range(1e-6, 10.0))
            .and(domains::below(8))
            .map(|((even, log), pick)| match pick {
                7 => 0.0,
                0..4 => even,
                _ => log,
            })
    }

    let f0 = || domains::range(0.0, 1.0);
    // 89.99 degrees; the edge of total reflection in glass, from both sides.
    let grazing = 1.745_329e-4;
    let cosines = [0.0, grazing, 0.5, 0.745_355_9, 0.745_356, 0.99999994, 1.0];
    let indices = [0.4, 0.6666667, 0.99999994, 1.0, 1.0000001, 1.5, 2.5];

    vec![
        Kernel::new(
            MODULE,
            "fresnel_f0",
            ["eta"],
            fresnel_f0,
            |e: f64| ((e - 1.0) / (e + 1.0)).powi(2),
            (index(0.4, 2.5),),
        )
        .few_ulp(5.0, 13.0)
        .hard(indices.map(|e| (e,)))
        .source("Born and Wolf, Principles of Optics, 1.5.3")
        .build(),
        Kernel::new(
            MODULE,
            "fresnel_schlick_scalar",
            ["f0", "cos"],
            fresnel_schlick_scalar,
            exact::schlick,
            (f0(), cosine()),
        )
        .few_ulp(7.0, 11.0)
        .hard(
            cosines
                .into_iter()
                .flat_map(|c| [0.0, 0.04, 1.0].map(|f| (f, c)))
                // A dot product of unit vectors may round to these.
                .chain([(0.04, 1.0000001), (0.04, -1e-7)]),
        )
        .source(SCHLICK)
        .baseline(
            "pow(1 - cos, 5)",
            "fn baseline(f0: f32, cos: f32) -> f32 {
                return f0 + (1.0 - f0) * pow(1.0 - clamp(cos, 0.0, 1.0), 5.0);
            }",
            |f0: f32, cos: f32| f0 + (1.0 - f0) * (1.0 - cos.clamp(0.0, 1.0)).powf(5.0),
        )
        .build(),
        Kernel::new(
            MODULE,
            "fresnel_schlick",
            ["f0", "cos"],
            fresnel_schlick,
            |f: DVec3, c: f64| {
                DVec3::new(
                    exact::schlick(f.x, c),
                    exact::schlick(f.y, c),
                    exact::schlick(f.z, c),
                )
            },
            (domains::vec3(f0()), cosine()),
        )
        .few_ulp(7.0, 11.0)
        .hard(cosines.map(|c| (Vec3::new(1.0, 0.78, 0.0), c)))
        .source(SCHLICK)
        .build(),
        Kernel::new(
            MODULE,
            "fresnel_schlick_transmitted",
            ["f0", "cos_i", "eta"],
            fresnel_schlick_transmitted,
            exact::schlick_transmitted,
            (f0(), cosine(), index(0.4, 2.5)),
        )
        // How far the fifth power moves with the transmitted cosine, a root
        // that ends at zero.
        .scale_by(|f0: f64, c: f64, e: f64| {
            let f = exact::schlick_transmitted(f0, c, e);
            let (terms, g) = exact::edge(c, e, 0.0);
            if e >= 1.0 {
                f
            } else {
                f.max(2.5 * (1.0 - f0) * f * terms / (g * (e + g)))
            }
        })
        .few_ulp(16.0, 46.0)
        .hard(
            cosines
                .into_iter()
                .flat_map(|c| indices.map(|e| (0.04, c, e)))
                .chain([(0.04, 0.7, 0.6666667), (0.0, 1.0, 0.6666667)]),
        )
        .source("Schlick 1994; the transmitted cosine: Lagarde 2013, Memo on Fresnel equations")
        .baseline(
            "Schlick by the incident cosine",
            "fn baseline(f0: f32, cos_i: f32, eta: f32) -> f32 {
                let x = 1.0 - cos_i;
                let x2 = x * x;
                return f0 + (1.0 - f0) * (x2 * x2 * x);
            }",
            |f0: f32, cos_i: f32, _: f32| {
                let x = 1.0 - cos_i;
                let x2 = x * x;
                f0 + (1.0 - f0) * (x2 * x2 * x)
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "fresnel_dielectric",
            ["cos_i", "eta"],
            fresnel_dielectric,
            exact::dielectric,
            (cosine(), index(0.4, 2.5)),
        )
        .scale_by(|c: f64, e: f64| exact::steepness(c, e, 0.0))
        .few_ulp(11.5, 54.0)
        .hard(
            cosines
                .into_iter()
                .flat_map(|c| indices.map(|e| (c, e)))
                // Brewster's angle; inside glass beyond the critical angle.
                .chain([(0.5547002, 1.5), (0.7, 0.6666667), (1e-20, 1.0)]),
        )
        .source(FRESNEL)
        .baseline(
            "usual form: cos_t from sin, differences of amplitudes",
            "fn baseline(cos_i: f32, eta: f32) -> f32 {
                let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
                if sin2_t >= 1.0 { return 1.0; }
                let cos_t = sqrt(1.0 - sin2_t);
                let p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
                let s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
                return 0.5 * (p * p + s * s);
            }",
            |cos_i: f32, eta: f32| {
                let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
                if sin2_t >= 1.0 {
                    return 1.0;
                }
                let cos_t = (1.0 - sin2_t).sqrt();
                let p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
                let s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
                0.5 * (p * p + s * s)
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "fresnel_conductor",
            ["cos_i", "eta", "k"],
            fresnel_conductor,
            exact::conductor,
            // One index for all channels: the scale is one number.
            cosine()
                .and(index(0.04, 8.0))
                .and(extinction())
                .map(|((c, e), k)| (c, Vec3::splat(e), Vec3::splat(k))),
        )
        .scale_by(|c: f64, eta: DVec3, k: DVec3| {
            let at = |i: usize| exact::steepness(c, eta[i], k[i]);
            at(0).max(at(1)).max(at(2))
        })
        .few_ulp(11.0, 48.0)
        .hard(cosines.into_iter().flat_map(|c| {
            [
                // Gold; silver, nearly perfect; no absorption; no interface.
                (c, Vec3::new(0.18, 0.42, 1.37), Vec3::new(3.42, 2.35, 1.77)),
                (c, Vec3::splat(0.05), Vec3::splat(8.0)),
                (c, Vec3::splat(1.5), Vec3::ZERO),
                (c, Vec3::splat(0.6666667), Vec3::ZERO),
                (c, Vec3::splat(1.0), Vec3::ZERO),
                (c, Vec3::splat(1.0000001), Vec3::splat(1e-6)),
            ]
        }))
        .source("Born and Wolf, Principles of Optics, 14.2")
        .baseline(
            "usual form: real parts by differences",
            "fn baseline_channel(c: f32, eta: f32, k: f32) -> f32 {
                let c2 = c * c;
                let s2 = 1.0 - c2;
                let eta2 = eta * eta;
                let k2 = k * k;
                let t0 = eta2 - k2 - s2;
                let both = sqrt(t0 * t0 + 4.0 * eta2 * k2);
                let t1 = both + c2;
                let a = sqrt(max(0.5 * (both + t0), 0.0));
                let t2 = 2.0 * c * a;
                let rs = (t1 - t2) / (t1 + t2);
                let t3 = c2 * both + s2 * s2;
                let t4 = t2 * s2;
                let rp = rs * (t3 - t4) / (t3 + t4);
                return 0.5 * (rp + rs);
            }
            fn baseline(cos_i: f32, eta: vec3f, k: vec3f) -> vec3f {
                return vec3f(
                    baseline_channel(cos_i, eta.x, k.x),
                    baseline_channel(cos_i, eta.y, k.y),
                    baseline_channel(cos_i, eta.z, k.z),
                );
            }",
            |c: f32, eta: Vec3, k: Vec3| {
                let channel = |eta: f32, k: f32| {
                    let c2 = c * c;
                    let s2 = 1.0 - c2;
                    let (eta2, k2) = (eta * eta, k * k);
                    let t0 = eta2 - k2 - s2;
                    let both = (t0 * t0 + 4.0 * eta2 * k2).sqrt();
                    let t1 = both + c2;
                    let a = (0.5 * (both + t0)).max(0.0).sqrt();
                    let t2 = 2.0 * c * a;
                    let rs = (t1 - t2) / (t1 + t2);
                    let t3 = c2 * both + s2 * s2;
                    let t4 = t2 * s2;
                    let rp = rs * (t3 - t4) / (t3 + t4);
                    0.5 * (rp + rs)
                };
                Vec3::new(
                    channel(eta.x, k.x),
                    channel(eta.y, k.y),
                    channel(eta.z, k.z),
                )
            },
        )
        .build(),
    ]
}
