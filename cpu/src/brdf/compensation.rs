//! Energy that GGX with a single scattering event loses, given back.
//!
//! Light that meets a second microfacet is missing from `D F G/(4 cos cos)`: a
//! rough white mirror reflects as little as 31 % of the light. The usual remedy
//! scales the lobe so that a white one reflects everything. This is an option:
//! nothing else in the kit calls it, so it costs nothing where it is not used.
//!
//! Source: Turquin, *Practical multiple scattering compensation for microfacet
//! models*, Industrial Light & Magic 2019; the fit is our own.

use glam::Vec3;

/// Directional albedo of white single-scattering GGX (height-correlated Smith
/// shadowing): the part of the light from elevation `cos` that it reflects.
///
/// `alpha` in `[1e-4, 1]`, `cos` in `[0, 1]` (clamped). The result lies in
/// `[0.3, 1]`. For an anisotropic surface take `√(alpha.x · alpha.y)`, which is
/// coarser: see the page.
///
/// A fit to quadrature in double precision: with `t = cos/(alpha + cos)` the
/// loss is `t (1 - t)` times a polynomial of degree 4 in `√t` and 2 in
/// `alpha²`. The fit never lies below the albedo and at most 1.1 % above it, so
/// compensation makes no energy: a white furnace gets back 98.9 to 100 %.
///
/// Error analysis: the loss is at most 0.7 and computed to a few ULP of that,
/// the polynomial being centred on its range, where its terms stay small.
///
/// ```
/// use raytwin_cpu::brdf::compensation::compensation_albedo;
///
/// // A smooth mirror loses nothing, a rough one much of the light.
/// assert!(compensation_albedo(1e-4, 1.0) > 0.99);
/// assert!(compensation_albedo(1.0, 1.0) < 0.6);
/// ```
#[inline]
#[must_use]
pub fn compensation_albedo(alpha: f32, cos: f32) -> f32 {
    let c = cos.clamp(0.0, 1.0);
    let sum = alpha + c;
    let t = c / sum;
    let x = t.sqrt() - 0.5;
    let y = alpha * alpha - 0.5;
    let part_a = 1.5838451 + y * (2.1568155 + y * -0.6933848);
    let part_b = -0.048463564 + y * (-1.1377293 + y * 0.6492186);
    let part_c = 6.0199094 + y * (5.0317416 + y * -11.384926);
    let part_d = 5.047814 + y * (9.75618 + y * -28.203835);
    let part_e = -3.2352748 + y * (67.391525 + y * 138.04222);
    let p = part_a + x * (part_b + x * (part_c + x * (part_d + x * part_e)));
    (1.0053 - (t * (alpha / sum)) * p).min(1.0)
}

/// What to multiply a GGX lobe by, for the light of all later scattering
/// events: `1 + f0 (1 - albedo)/albedo`.
///
/// `f0` is the reflectance at normal incidence in `[0, 1]`, `albedo` that of
/// [`compensation_albedo`] for the view direction, in `(0, 1]`.
///
/// The factor depends on the view direction alone: a lobe scaled by it is not
/// reciprocal, which a path tracer from the eye does not
/// notice.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::compensation::{
///     compensation_albedo, compensation_factor,
/// };
///
/// // A white metal, scaled by the factor, gives back all that it gets.
/// let albedo = compensation_albedo(0.7, 0.5);
/// let factor = compensation_factor(Vec3::ONE, albedo);
/// assert!((factor * albedo - Vec3::ONE).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn compensation_factor(f0: Vec3, albedo: f32) -> Vec3 {
    let k = (1.0 - albedo) / albedo;
    Vec3::new(1.0 + f0.x * k, 1.0 + f0.y * k, 1.0 + f0.z * k)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The albedo by quadrature over visible normals (the spherical caps of
    /// Dupuy and Benyoub, 2023), whose weight is G2/G1; midpoints in both.
    fn quadrature(alpha: f64, cos: f64) -> f64 {
        const N: usize = 512;
        const M: usize = 48;
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let lambda = |tan2: f64| 0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0);
        let view = lambda((sin / cos).powi(2));
        let length = (alpha * sin).hypot(cos);
        let (ux, uz) = (alpha * sin / length, cos / length);
        let mut sum = 0.0;
        for i in 0..N {
            let z = 1.0 - (1.0 + uz) * (i as f64 + 0.5) / N as f64;
            let r = (1.0 - z * z).max(0.0).sqrt();
            for j in 0..M {
                let (s, c) = (std::f64::consts::PI * (j as f64 + 0.5) / M as f64).sin_cos();
                let h = [alpha * (r * c + ux), alpha * r * s, (z + uz).max(0.0)];
                let norm = (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]).sqrt();
                let (hx, hz) = (h[0] / norm, h[2] / norm);
                let out = 2.0 * (sin * hx + cos * hz) * hz - cos;
                if out > 0.0 {
                    let light = lambda((1.0 - out * out).max(0.0) / (out * out));
                    sum += (1.0 + view) / (1.0 + view + light);
                }
            }
        }
        sum / (N * M) as f64
    }

    #[test]
    fn quadrature_knows_the_closed_form() {
        // At normal incidence and alpha = 1 the albedo is 1 - ln 2.
        assert!((quadrature(1.0, 1.0) - (1.0 - 2f64.ln())).abs() < 1e-5);
    }

    #[test]
    fn fit_is_never_below_the_albedo_and_little_above() {
        let (mut low, mut high) = (1.0f64, -1.0f64);
        for i in 0..24 {
            for j in 0..24 {
                // Roughness by its square root, as it is painted.
                let alpha = (0.03 + 0.97 * f64::from(i) / 23.0).powi(2);
                let cos = (0.02 + 0.98 * f64::from(j) / 23.0).powi(2);
                let fit = f64::from(compensation_albedo(alpha as f32, cos as f32));
                let off = fit / quadrature(alpha, cos) - 1.0;
                low = low.min(off);
                high = high.max(off);
            }
        }
        // The quadrature itself is good to 1e-4.
        assert!(low > -1e-4, "{low}");
        assert!(high < 0.011, "{high}");
    }

    #[test]
    fn a_white_furnace_stays_within_one() {
        for alpha in [0.05, 0.3, 0.6, 1.0] {
            for cos in [0.05, 0.3, 0.7, 1.0] {
                let albedo = compensation_albedo(alpha, cos);
                let factor = compensation_factor(Vec3::new(1.0, 0.5, 0.0), albedo);
                let white = quadrature(f64::from(alpha), f64::from(cos)) * f64::from(factor.x);
                assert!((0.989..1.000_1).contains(&white), "{alpha} {cos}: {white}");
                assert!(factor.x >= factor.y && factor.z == 1.0);
            }
        }
    }

    #[test]
    fn ends() {
        // A smooth surface loses nothing, nor does one seen edge-on.
        assert_eq!(compensation_albedo(1e-4, 1.0), 1.0);
        assert_eq!(compensation_albedo(1.0, 0.0), 1.0);
        assert_eq!(compensation_albedo(1e-4, 0.0), 1.0);
        assert_eq!(compensation_factor(Vec3::ONE, 1.0), Vec3::ONE);
    }
}
