//! Sine, cosine and angle in turns, from polynomials.
//!
//! WGSL promises `sin` and `cos` to 2^-11 and only on `[-π, π]`, and `atan2`
//! to 4096 ULP. A turn (the angle over 2π) is what samplers start from anyway,
//! and reducing a turn to an octant is exact, so these are both more accurate
//! and inside what the specification guarantees.
//!
//! Source: range reduction and odd/even polynomials as in Cody and Waite,
//! *Software Manual for the Elementary Functions* (1980); the coefficients are
//! our own minimax fits, rounded to `f32` one after the other.

use glam::Vec2;

// sin(π/2·r) = r·(S0 + S0_LOW + r²·(S1 + …)), relative error 2^-27.97 on |r| <= 1/2.
const S0: f32 = 1.5707964;
const S0_LOW: f32 = -4.371139e-8;
const S1: f32 = -0.64596367;
const S2: f32 = 0.07968185;
const S3: f32 = -0.0046059857;
// cos(π/2·r) = 1 + r²·(C1 + …), absolute error 2^-31.19 on |r| <= 1/2.
const C1: f32 = -1.2337005;
const C2: f32 = 0.25366852;
const C3: f32 = -0.020855254;
const C4: f32 = 0.0008935732;
// atan(x)/2π = x·(A0 + x²·(A1 + …)), relative error 2^-24.56 on |x| <= tan(π/8).
const A0: f32 = 0.15915494;
const A1: f32 = -0.053050034;
const A2: f32 = 0.031765692;
const A3: f32 = -0.021798123;
const A4: f32 = 0.011945155;
const TAN_EIGHTH: f32 = 0.41421357;

/// `(sin 2πu, cos 2πu)`.
///
/// `u` is an angle in turns, `|u| <= 2^20`; exact at multiples of a quarter
/// turn.
///
/// Error analysis: `4u` and its distance to the nearest integer are exact.
/// The sine's polynomial is summed to half an ULP of 1.57 and multiplied once;
/// the cosine's correction is at most 0.30 in size, so its rounding reaches a
/// quarter of an ULP of the result before the last addition adds a half.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::math::trig::sincos_turn;
///
/// // A quarter turn is exact, as no sine of π/2 in f32 can be.
/// assert_eq!(sincos_turn(0.25), Vec2::new(1.0, 0.0));
/// let eighth = sincos_turn(0.125);
/// assert!((eighth.x - 0.5_f32.sqrt()).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn sincos_turn(u: f32) -> Vec2 {
    let x = 4.0 * u;
    let k = (x + 0.5).floor();
    let r = x - k;
    let z = r * r;
    let s = r * (S0 + (S0_LOW + z * (S1 + z * (S2 + z * S3))));
    let c = 1.0 + z * (C1 + z * (C2 + z * (C3 + z * C4)));
    let quadrant = (k as i32) as u32 & 3;
    let swap = quadrant & 1 != 0;
    let sin = if swap { c } else { s };
    let cos = if swap { s } else { c };
    Vec2::new(
        if quadrant & 2 != 0 { -sin } else { sin },
        if (quadrant + 1) & 2 != 0 { -cos } else { cos },
    )
}

/// The angle of the point `(x, y)` in turns, in `[0, 1)`.
///
/// Counted from the x axis toward the y axis; the origin gives 0. Components
/// must be finite and their larger size in `[1e-18, 1e18]`, or both zero.
///
/// Error analysis: one division (2.5 ULP in WGSL), a polynomial of half the
/// weight, and additions of exact fractions of a turn: absolute error below
/// 2^-23 turns; relative error as small only near angle zero.
///
/// ```
/// use raytwin_cpu::math::trig::{atan2_turn, sincos_turn};
///
/// assert_eq!(atan2_turn(1.0, 0.0), 0.25);
/// assert_eq!(atan2_turn(-1.0, -1.0), 0.625);
/// let p = sincos_turn(0.3);
/// assert!((atan2_turn(p.x, p.y) - 0.3).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn atan2_turn(y: f32, x: f32) -> f32 {
    let ax = x.abs();
    let ay = y.abs();
    let high = ax.max(ay);
    let low = ax.min(ay);
    if high == 0.0 {
        return 0.0;
    }
    // Past 22.5 degrees measure from the diagonal: atan(q) = 1/8 turn + atan((q - 1)/(q + 1)).
    let far = low > TAN_EIGHTH * high;
    let num = if far { low - high } else { low };
    let den = if far { low + high } else { high };
    let q = num / den;
    let z = q * q;
    let a = q * (A0 + z * (A1 + z * (A2 + z * (A3 + z * A4))));
    let octant = if far { 0.125 + a } else { a };
    let quarter = if ay > ax { 0.25 - octant } else { octant };
    let half = if x < 0.0 { 0.5 - quarter } else { quarter };
    let turn = if y < 0.0 { 1.0 - half } else { half };
    // 1 - 1e-9 rounds to 1, which is 0 again.
    if turn >= 1.0 { 0.0 } else { turn }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_exact() {
        assert_eq!(sincos_turn(0.0), Vec2::new(0.0, 1.0));
        assert_eq!(sincos_turn(0.25), Vec2::new(1.0, 0.0));
        assert_eq!(sincos_turn(0.5), Vec2::new(0.0, -1.0));
        assert_eq!(sincos_turn(0.75), Vec2::new(-1.0, 0.0));
        assert_eq!(sincos_turn(-0.25), Vec2::new(-1.0, 0.0));
    }

    #[test]
    fn angles_of_the_axes_and_diagonals() {
        for (y, x, turn) in [
            (0.0, 1.0, 0.0),
            (1.0, 1.0, 0.125),
            (1.0, 0.0, 0.25),
            (0.0, -1.0, 0.5),
            (-1.0, 0.0, 0.75),
            (-1.0, 1.0, 0.875),
            (0.0, 0.0, 0.0),
        ] {
            assert_eq!(atan2_turn(y, x), turn, "atan2_turn({y}, {x})");
        }
        assert_eq!(atan2_turn(-1e-12, 1.0), 0.0);
    }
}
