//! Media that light crosses: absorption and dispersion.

use glam::Vec3;

use crate::math::exponent::exp2_poly;

/// log2 e.
const LOG2_E: f32 = 1.442695;

/// What is left of light after a straight way through an absorbing medium,
/// one channel: `exp(-absorption · distance)`.
///
/// `absorption` is per unit of length, `distance` in that unit; both are at
/// least 0 and their product is below 1e38. The result underflows to 0 beyond
/// an optical depth (the product) of 87.3.
///
/// Source: the law of Beer and Lambert (also Bouguer).
///
/// Error analysis: the exponent is rounded three times, which is relative to
/// the optical depth `d`; the result's relative error is the exponential's
/// plus 1.4 · 2^-23 d. Rounding the optical depth alone has that effect.
///
/// ```
/// use raytwin_cpu::brdf::medium::medium_transmittance_scalar;
///
/// // Half is left after ln 2 mean free paths.
/// let left = medium_transmittance_scalar(0.5, 2.0 * std::f32::consts::LN_2);
/// assert!((left - 0.5).abs() < 1e-6);
/// assert_eq!(medium_transmittance_scalar(0.5, 0.0), 1.0);
/// ```
#[inline]
#[must_use]
pub fn medium_transmittance_scalar(absorption: f32, distance: f32) -> f32 {
    exp2_poly(absorption * (-LOG2_E * distance))
}

/// What is left of light after a straight way through an absorbing medium; see
/// [`medium_transmittance_scalar`].
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::medium::medium_transmittance;
///
/// // Two ways one after the other: what they let through is multiplied.
/// let absorption = Vec3::new(0.1, 0.5, 2.0);
/// let twice = medium_transmittance(absorption, 1.0)
///     * medium_transmittance(absorption, 1.0);
/// assert!((twice - medium_transmittance(absorption, 2.0)).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn medium_transmittance(absorption: Vec3, distance: f32) -> Vec3 {
    let k = -LOG2_E * distance;
    Vec3::new(
        exp2_poly(absorption.x * k),
        exp2_poly(absorption.y * k),
        exp2_poly(absorption.z * k),
    )
}

/// Refractive index by wavelength: `a + b/λ²`, the first two terms of Cauchy's
/// equation.
///
/// `wavelength_um` is in micrometres and `b` in square micrometres, as tables
/// have them; good for glass and water in visible light, 0.38 to 0.75 µm.
///
/// ```
/// use raytwin_cpu::brdf::medium::medium_cauchy_eta;
///
/// // Crown glass (BK7): blue is refracted more than red.
/// let red = medium_cauchy_eta(1.5046, 0.0042, 0.65);
/// let blue = medium_cauchy_eta(1.5046, 0.0042, 0.45);
/// assert!(blue > red && (red - 1.5145).abs() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn medium_cauchy_eta(a: f32, b: f32, wavelength_um: f32) -> f32 {
    a + b / (wavelength_um * wavelength_um)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_the_way() {
        assert_eq!(medium_transmittance(Vec3::ZERO, 10.0), Vec3::ONE);
        assert_eq!(medium_transmittance(Vec3::ONE, 0.0), Vec3::ONE);
        assert_eq!(medium_transmittance(Vec3::splat(1e3), 1.0), Vec3::ZERO);
        assert_eq!(medium_transmittance(Vec3::splat(1e20), 1e15), Vec3::ZERO);
    }

    #[test]
    fn two_ways_make_the_product() {
        let a = Vec3::new(0.1, 0.7, 2.5);
        for i in 1..100 {
            let d = i as f32 / 20.0;
            let twice = medium_transmittance(a, d) * medium_transmittance(a, 2.0 * d);
            let once = medium_transmittance(a, 3.0 * d);
            assert!((twice - once).abs().cmple(once * 1e-5).all());
            assert!(once.cmple(Vec3::ONE).all());
        }
    }

    #[test]
    fn glass_bends_blue_more() {
        // BK7: 1.5046, 0.0042 µm²; n is 1.5168 at 0.5876 µm.
        assert!((medium_cauchy_eta(1.5046, 0.0042, 0.5876) - 1.5168).abs() < 2e-4);
        assert!(medium_cauchy_eta(1.5046, 0.0042, 0.45) > medium_cauchy_eta(1.5046, 0.0042, 0.65));
    }
}
