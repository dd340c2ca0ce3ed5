//! Exponential, logarithm and power from polynomials.
//!
//! WGSL's `exp2` may be off by `3 + 2|x|` ULP, `log2` by 2^-21 near one, and
//! `pow` by the two combined. These stay below 3 ULP, use only `+ - *`,
//! `floor` and bit operations, and never produce an infinity or a NaN.
//!
//! Source: Cody and Waite, *Software Manual for the Elementary Functions*
//! (1980), for the reductions; the coefficients are our own minimax fits.

// 2^f = 1 + f·(E1 + …), relative error 2^-28.3 on |f| <= 1/2.
const E1: f32 = 0.6931472;
const E2: f32 = 0.24022648;
const E3: f32 = 0.0555036;
const E4: f32 = 0.009618506;
const E5: f32 = 0.0013390806;
const E6: f32 = 0.00015326463;
// log2(1 + f) = f·(L1 + …), relative error 2^-25.1 on [√½ - 1, √2 - 1].
const L1: f32 = 1.442695;
const L2: f32 = -0.7213472;
const L3: f32 = 0.48090866;
const L4: f32 = -0.36071476;
const L5: f32 = 0.28797638;
const L6: f32 = -0.23871812;
const L7: f32 = 0.21494865;
const L8: f32 = -0.20860584;
const L9: f32 = 0.12952681;

/// `2^x`, for finite `x`.
///
/// Below -126 the result is 0, from 128 on it is the largest finite number.
///
/// Error analysis: the distance to the nearest integer is exact, the
/// polynomial's correction is at most 0.42 in size, and the scaling is exact:
/// one ULP and a half covers it.
///
/// ```
/// use raytwin_cpu::math::exponent::exp2_poly;
///
/// assert_eq!(exp2_poly(10.0), 1024.0);
/// let root = exp2_poly(0.5);
/// assert!((root * root - 2.0).abs() < 1e-6);
/// assert_eq!(exp2_poly(-1000.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn exp2_poly(x: f32) -> f32 {
    if x < -126.0 {
        return 0.0;
    }
    if x >= 128.0 {
        return f32::MAX;
    }
    let k = (x + 0.5).floor();
    let f = x - k;
    let p = 1.0 + f * (E1 + f * (E2 + f * (E3 + f * (E4 + f * (E5 + f * E6)))));
    // 2^k in two factors: k = 128 has no f32 of its own.
    let i = k as i32;
    let a = i >> 1;
    let b = i - a;
    let scale_a = f32::from_bits(((a + 127) as u32) << 23);
    let scale_b = f32::from_bits(((b + 127) as u32) << 23);
    (p * scale_a) * scale_b
}

/// `log2 x`, for finite `x`.
///
/// Zero, subnormal and negative `x` give -127.
///
/// Error analysis: the mantissa is split off by bits, so near one the result
/// is the polynomial alone and its relative error holds; elsewhere adding the
/// integer exponent rounds once.
///
/// ```
/// use raytwin_cpu::math::exponent::{exp2_poly, log2_poly};
///
/// assert_eq!(log2_poly(1024.0), 10.0);
/// let x = 0.3;
/// assert!((exp2_poly(log2_poly(x)) - x).abs() < 1e-6);
/// assert_eq!(log2_poly(0.0), -127.0);
/// ```
#[inline]
#[must_use]
pub fn log2_poly(x: f32) -> f32 {
    if x < f32::MIN_POSITIVE {
        return -127.0;
    }
    let bits = x.to_bits();
    // Mantissa in [√½, √2): above √2 the exponent goes up by one.
    let high = (bits & 0x007f_ffff) > 0x0035_04f3;
    let exponent = (bits >> 23) as i32 - 127 + i32::from(high);
    let mantissa = (bits & 0x007f_ffff) | if high { 0x3f00_0000 } else { 0x3f80_0000 };
    let f = f32::from_bits(mantissa) - 1.0;
    let p = f
        * (L1
            + f * (L2 + f * (L3 + f * (L4 + f * (L5 + f * (L6 + f * (L7 + f * (L8 + f * L9))))))));
    exponent as f32 + p
}

/// `x^y` for `x >= 0`.
///
/// `x^0` is 1, `0^y` is 0 for positive `y`. The relative error grows with the
/// size of the result's logarithm: about `0.35·|y·log2 x| + 2` ULP.
///
/// ```
/// use raytwin_cpu::math::exponent::pow_poly;
///
/// assert!((pow_poly(2.0, 0.5) - 2.0_f32.sqrt()).abs() < 1e-6);
/// assert_eq!(pow_poly(0.0, 5.0), 0.0);
/// assert_eq!(pow_poly(0.0, 0.0), 1.0);
/// ```
#[inline]
#[must_use]
pub fn pow_poly(x: f32, y: f32) -> f32 {
    if y == 0.0 {
        return 1.0;
    }
    if x == 0.0 {
        return 0.0;
    }
    exp2_poly(y * log2_poly(x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_two_are_exact() {
        for k in -126..128 {
            let x = f32::from_bits(((k + 127) as u32) << 23);
            assert_eq!(exp2_poly(k as f32), x);
            assert_eq!(log2_poly(x), k as f32);
        }
    }

    #[test]
    fn ends_are_finite() {
        assert_eq!(exp2_poly(-1e30), 0.0);
        assert_eq!(exp2_poly(1e30), f32::MAX);
        assert!(exp2_poly(127.99999).is_finite());
        assert_eq!(log2_poly(0.0), -127.0);
        assert_eq!(log2_poly(-1.0), -127.0);
        assert_eq!(pow_poly(0.0, 0.0), 1.0);
        assert_eq!(pow_poly(0.0, 2.0), 0.0);
    }
}
