//! Relative luminance of linear RGB.

use glam::Vec3;

/// Relative luminance of a linear colour with Rec. 709 (sRGB) primaries and
/// the D65 white point.
///
/// Source: ITU-R BT.709-6, item 3.2, with the coefficients rounded as there.
/// They sum to one, so a grey keeps its value to an ULP or so.
///
/// Error analysis: three products and two sums of terms of one sign for
/// non-negative colours: at most 2 ULP.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::math::luminance::luminance;
///
/// assert!((luminance(Vec3::splat(0.5)) - 0.5).abs() < 1e-6);
/// // Of the three primaries, green is by far the brightest.
/// assert!(luminance(Vec3::Y) > 3.0 * luminance(Vec3::X));
/// ```
#[inline]
#[must_use]
pub fn luminance(rgb: Vec3) -> f32 {
    (0.2126 * rgb.x + 0.7152 * rgb.y) + 0.0722 * rgb.z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_is_one() {
        assert!((luminance(Vec3::ONE) - 1.0).abs() < 1e-6);
    }
}
