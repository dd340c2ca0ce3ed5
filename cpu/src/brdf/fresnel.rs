//! How much of the light an interface reflects, by angle; unpolarised.
//!
//! `cos` and `cos_i` are the cosine between the light and the normal (or the
//! half vector) on the light's side, clamped to `[0, 1]`; `eta` is the
//! refractive index of the far side over that of the near side, positive.

use glam::Vec3;

/// Stands in for a zero that something divides by.
const TINY: f32 = 1e-30;

/// Reflectance of a dielectric at normal incidence, `((η - 1)/(η + 1))²`.
///
/// Born and Wolf, *Principles of Optics*, 1.5.3. `η - 1` is exact from 1/2 to
/// 2, so the result keeps its relative accuracy as `η` comes close to 1.
///
/// ```
/// use raytwin_cpu::brdf::fresnel::fresnel_f0;
///
/// // Glass reflects 4 %.
/// assert!((fresnel_f0(1.5) - 0.04).abs() < 1e-6);
/// assert_eq!(fresnel_f0(1.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn fresnel_f0(eta: f32) -> f32 {
    let r = (eta - 1.0) / (eta + 1.0);
    r * r
}

/// `x⁵` by three products. WGSL allows its `pow` an error of 57 ULP at
/// `x = 0.1`.
#[inline]
fn fresnel_fifth(x: f32) -> f32 {
    let square = x * x;
    square * square * x
}

/// Schlick's approximation, one channel: `f0 + (1 - f0)(1 - cos)⁵`.
///
/// Schlick, *An Inexpensive BRDF Model for Physically-based Rendering*,
/// Eurographics 1994. `f0` in `[0, 1]`; so is the result.
///
/// Error analysis: a sum and products of positive terms; `1 - cos` is exact
/// for `cos` from 1/2 on and rounded once below, which counts five times.
///
/// ```
/// use raytwin_cpu::brdf::fresnel::fresnel_schlick_scalar;
///
/// assert_eq!(fresnel_schlick_scalar(0.04, 1.0), 0.04);
/// // Along the surface everything is reflected.
/// assert_eq!(fresnel_schlick_scalar(0.04, 0.0), 1.0);
/// ```
#[inline]
#[must_use]
pub fn fresnel_schlick_scalar(f0: f32, cos: f32) -> f32 {
    f0 + (1.0 - f0) * fresnel_fifth(1.0 - cos.clamp(0.0, 1.0))
}

/// Schlick's approximation of a colour; see [`fresnel_schlick_scalar`].
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::fresnel::fresnel_schlick;
///
/// let gold = Vec3::new(1.0, 0.78, 0.34);
/// assert_eq!(fresnel_schlick(gold, 1.0), gold);
/// assert!((fresnel_schlick(gold, 0.0) - Vec3::ONE).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn fresnel_schlick(f0: Vec3, cos: f32) -> Vec3 {
    let x = fresnel_fifth(1.0 - cos.clamp(0.0, 1.0));
    Vec3::new(
        f0.x + (1.0 - f0.x) * x,
        f0.y + (1.0 - f0.y) * x,
        f0.z + (1.0 - f0.z) * x,
    )
}

/// `η² - sin²`, the square of `η` times the transmitted cosine; negative at
/// total internal reflection. `c` in `[0, 1]`.
///
/// The same number is `(η² - 1) + cos²`. Of the two sums the one with smaller
/// terms is taken: near the horizon the second, in which `η² - 1` is a product
/// of exact or nearly exact factors, near the normal the first.
#[inline]
fn fresnel_far_square(c: f32, eta: f32) -> f32 {
    if c * c < 0.5 {
        return (eta - 1.0) * (eta + 1.0) + c * c;
    }
    eta * eta - (1.0 - c) * (1.0 + c)
}

/// Schlick's approximation for either side of an interface: where the far
/// side is the thinner one (`eta < 1`) it takes the transmitted cosine, and is
/// 1 at total internal reflection.
///
/// With the incident cosine the approximation falls apart there: inside glass
/// at `cos_i = 0.7` it gives 0.042, though everything is reflected.
///
/// Error analysis: one minus the transmitted cosine is computed as
/// `sin²/(η(η + g))` with `g = η cos_t`, which does not cancel at the normal;
/// what remains is the steepness of the edge of total reflection.
///
/// ```
/// use raytwin_cpu::brdf::fresnel::{fresnel_f0, fresnel_schlick_transmitted};
///
/// let eta = 1.0 / 1.5;
/// let f0 = fresnel_f0(eta);
/// // From inside glass: total reflection sets in at 41.8 degrees.
/// assert_eq!(fresnel_schlick_transmitted(f0, 0.7, eta), 1.0);
/// assert!(fresnel_schlick_transmitted(f0, 0.9, eta) < 0.1);
/// ```
#[inline]
#[must_use]
pub fn fresnel_schlick_transmitted(f0: f32, cos_i: f32, eta: f32) -> f32 {
    if eta >= 1.0 {
        return fresnel_schlick_scalar(f0, cos_i);
    }
    let c = cos_i.clamp(0.0, 1.0);
    let square = fresnel_far_square(c, eta);
    if square <= 0.0 {
        return 1.0;
    }
    let sin2 = (1.0 - c) * (1.0 + c);
    let x = (sin2 / (eta * (eta + square.sqrt()))).min(1.0);
    f0 + (1.0 - f0) * fresnel_fifth(x)
}

/// Exact reflectance of a dielectric; 1 at total internal reflection, 0 for
/// `eta = 1`.
///
/// Born and Wolf, *Principles of Optics*, 1.5.2. With
/// `g = η cos_t = √(η² - 1 + cos²)` the amplitudes are `(cos - g)/(cos + g)`
/// and `(η² cos - g)/(η² cos + g)`.
///
/// Error analysis: multiplied by their conjugates the amplitudes are
/// `(1 - η²)/(cos + g)²` and `(η² - 1)(η² cos² - sin²)/(η² cos + g)²`. The
/// numerators keep their relative accuracy as `η` comes close to 1, where the
/// textbook differences lose every digit; the second cancels at Brewster's
/// angle, where the first is all there is.
///
/// ```
/// use raytwin_cpu::brdf::fresnel::{fresnel_dielectric, fresnel_f0};
///
/// assert!((fresnel_dielectric(1.0, 1.5) - fresnel_f0(1.5)).abs() < 1e-6);
/// // Inside glass at 45 degrees everything is reflected.
/// assert_eq!(fresnel_dielectric(0.7, 1.0 / 1.5), 1.0);
/// assert_eq!(fresnel_dielectric(0.3, 1.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn fresnel_dielectric(cos_i: f32, eta: f32) -> f32 {
    let c = cos_i.clamp(0.0, 1.0);
    let square = fresnel_far_square(c, eta);
    if square < 0.0 {
        return 1.0;
    }
    let g = square.sqrt();
    let eta2 = eta * eta;
    let step = (eta - 1.0) * (eta + 1.0);
    let sin2 = (1.0 - c) * (1.0 + c);
    let s = c + g;
    let p = eta2 * c + g;
    let rs = step / (s * s).max(TINY);
    let rp = step * ((eta2 * (c * c) - sin2) / (p * p).max(TINY));
    (0.5 * (rs * rs + rp * rp)).min(1.0)
}

/// One channel of [`fresnel_conductor`]; `c` in `[0, 1]`.
#[inline]
fn fresnel_conductor_channel(c: f32, eta: f32, k: f32) -> f32 {
    let c2 = c * c;
    let sin2 = (1.0 - c) * (1.0 + c);
    let k2 = k * k;
    // g² = n² - sin² = real + 2i·half; |g|² and Re g follow.
    let real = fresnel_far_square(c, eta) - k2;
    let half = eta * k;
    let length = (real * real + 4.0 * (half * half)).sqrt();
    let wide = (0.5 * (length + real.abs())).sqrt();
    let narrow = half / wide.max(TINY);
    let a = if real >= 0.0 { wide } else { narrow };
    // |n² - 1|², |cos + g|², |n² cos + g|² and |n² cos² - sin²|².
    let below = eta - 1.0;
    let above = eta + 1.0;
    let step2 = (below * below + k2) * (above * above + k2);
    let n2 = eta * eta + k2;
    let s = (c2 + length) + 2.0 * (a * c);
    let p = ((n2 * n2) * c2 + length) + 2.0 * ((a * c) * (length + sin2));
    let q_real = c2 * ((eta - k) * (eta + k)) - sin2;
    let q_imaginary = 2.0 * (half * c2);
    let q2 = q_real * q_real + q_imaginary * q_imaginary;
    let rs = step2 / (s * s).max(TINY);
    let rp = step2 * (q2 / (p * p).max(TINY));
    (0.5 * (rs + rp)).min(1.0)
}

/// Exact reflectance of a conductor with the complex refractive index
/// `eta + i k` relative to the near side, for three wavelengths; `k` at least
/// 0. With `k = 0` it is the reflectance of a dielectric.
///
/// Born and Wolf, *Principles of Optics*, 14.2. Indices up to 100 are safe
/// from overflow.
///
/// Error analysis: as in [`fresnel_dielectric`] with the complex `n` for `η`,
/// and every squared modulus written as a sum of positive terms
/// (`|n² cos + g|² = |n|⁴ cos² + |g|² + 2 cos Re g (|g|² + sin²)`), so neither
/// a weak nor a nearly perfect mirror loses digits. Of the two parts of `g` the
/// smaller follows from their product, since their difference cancels.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::fresnel::{fresnel_conductor, fresnel_dielectric};
///
/// // Gold at 650, 550 and 450 nm: red is reflected best.
/// let eta = Vec3::new(0.16, 0.42, 1.5);
/// let k = Vec3::new(3.5, 2.4, 1.9);
/// let f = fresnel_conductor(1.0, eta, k);
/// assert!(f.x > f.y && f.y > f.z);
/// // Without absorption it is a dielectric.
/// let glass = fresnel_conductor(0.8, Vec3::splat(1.5), Vec3::ZERO);
/// assert!((glass.x - fresnel_dielectric(0.8, 1.5)).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn fresnel_conductor(cos_i: f32, eta: Vec3, k: Vec3) -> Vec3 {
    let c = cos_i.clamp(0.0, 1.0);
    Vec3::new(
        fresnel_conductor_channel(c, eta.x, k.x),
        fresnel_conductor_channel(c, eta.y, k.y),
        fresnel_conductor_channel(c, eta.z, k.z),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cosines from grazing (89.99 degrees) to normal.
    fn cosines() -> impl Iterator<Item = f32> {
        (1..=1000)
            .map(|i| i as f32 / 1000.0)
            .chain([0.0, 1e-20, 1.745_329e-4, 1e-3, 0.99999994])
    }

    #[test]
    fn ends() {
        assert_eq!(fresnel_schlick_scalar(0.04, 1.0), 0.04);
        assert_eq!(fresnel_schlick_scalar(0.04, 0.0), 1.0);
        assert_eq!(fresnel_dielectric(0.0, 1.5), 1.0);
        assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-8);
        assert!((fresnel_f0(1.5) - 0.04).abs() < 1e-8);
        // Rounding may push a cosine out of its range.
        assert_eq!(
            fresnel_dielectric(1.000_000_1, 1.5),
            fresnel_dielectric(1.0, 1.5)
        );
        assert_eq!(fresnel_dielectric(-1e-7, 1.0), 0.0);
    }

    #[test]
    fn no_interface_reflects_nothing() {
        for c in cosines() {
            assert_eq!(fresnel_dielectric(c, 1.0), 0.0);
            assert_eq!(fresnel_conductor(c, Vec3::ONE, Vec3::ZERO), Vec3::ZERO);
        }
        assert_eq!(fresnel_f0(1.0), 0.0);
    }

    #[test]
    fn total_internal_reflection() {
        // In glass everything is reflected below cos = √(1 - 1/1.5²) = 0.7454.
        let eta = 1.0 / 1.5;
        for c in [0.0, 1e-4, 0.5, 0.7, 0.745] {
            assert_eq!(fresnel_dielectric(c, eta), 1.0);
            assert_eq!(fresnel_schlick_transmitted(0.04, c, eta), 1.0);
            assert!(fresnel_conductor(c, Vec3::splat(eta), Vec3::ZERO).x > 1.0 - 1e-6);
        }
        assert!((fresnel_schlick_scalar(0.04, 0.7) - 0.042).abs() < 5e-4);
        assert!(fresnel_schlick_transmitted(0.04, 0.746, eta) < 0.9);
    }

    #[test]
    fn reflectances_are_parts() {
        for c in cosines() {
            for eta in [
                0.05, 0.4, 0.6666667, 0.9999999, 1.0, 1.0000001, 1.5, 2.5, 8.0,
            ] {
                let all = [
                    fresnel_dielectric(c, eta),
                    fresnel_schlick_transmitted(0.04, c, eta),
                    fresnel_schlick_scalar(fresnel_f0(eta), c),
                    fresnel_conductor(c, Vec3::splat(eta), Vec3::ZERO).x,
                    fresnel_conductor(c, Vec3::splat(eta), Vec3::splat(1e-3)).x,
                    fresnel_conductor(c, Vec3::splat(eta), Vec3::splat(4.0)).x,
                ];
                for f in all {
                    assert!((0.0..=1.0).contains(&f), "{c} {eta}: {all:?}");
                }
            }
        }
    }

    #[test]
    fn both_sides_reflect_alike() {
        // F(cos_i, η) = F(cos_t, 1/η) for each pair that Snell's law makes.
        for eta in [1.01f64, 1.33, 1.5, 2.4] {
            for i in 1..1000 {
                let cos = f64::from(i) / 1000.0;
                let far = (1.0 - (1.0 - cos * cos) / (eta * eta)).sqrt();
                let there = fresnel_dielectric(cos as f32, eta as f32);
                let back = fresnel_dielectric(far as f32, (1.0 / eta) as f32);
                // The far cosine is rounded, and F runs with it as 1/cos.
                let moved = f64::from(there - back).abs();
                assert!(moved < 2e-6 / cos, "{eta} {cos}: {there} {back}");
            }
        }
    }

    #[test]
    fn reflectance_grows_toward_grazing_from_brewsters_angle() {
        let eta = 1.5f32;
        let brewster = 1.0 / (1.0 + eta * eta).sqrt();
        let mut last = 1.0;
        for i in 0..=1000 {
            let f = fresnel_dielectric(brewster * (i as f32 / 1000.0), eta);
            assert!(f <= last);
            last = f;
        }
        // All of it polarised across the plane of incidence: half of r_s².
        let r = (1.0 - eta * eta) / (1.0 + eta * eta);
        assert!((last - 0.5 * r * r).abs() < 1e-7);
    }

    #[test]
    fn without_absorption_a_conductor_is_a_dielectric() {
        for eta in [0.4f32, 0.6666667, 0.9999999, 1.0000001, 1.1, 1.5, 2.4] {
            for c in cosines() {
                let metal = fresnel_conductor(c, Vec3::splat(eta), Vec3::ZERO).x;
                let glass = fresnel_dielectric(c, eta);
                // Relative; where `n² - sin²` cancels both inherit its noise.
                let near = (eta * eta - 1.0 + c * c).abs().max(1e-6);
                let allowed = glass * 2e-6 / if eta < 1.0 { near } else { 1.0 };
                assert!(
                    (metal - glass).abs() <= allowed,
                    "{eta} {c}: {metal} {glass}"
                );
            }
        }
    }
}
