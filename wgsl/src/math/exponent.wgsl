// Exponential, logarithm and power from polynomials of our own: WGSL's exp2
// may be off by 3 + 2|x| ULP, log2 by 2^-21 near one, pow by the two combined.
// Reductions as in Cody and Waite (1980); coefficients: our minimax fits.

// 2^f = 1 + f (E1 + ...), relative error 2^-28.3 on |f| <= 1/2.
const EXPONENT_E1: f32 = 0.6931472;
const EXPONENT_E2: f32 = 0.24022648;
const EXPONENT_E3: f32 = 0.0555036;
const EXPONENT_E4: f32 = 0.009618506;
const EXPONENT_E5: f32 = 0.0013390806;
const EXPONENT_E6: f32 = 0.00015326463;
// log2(1 + f) = f (L1 + ...), relative error 2^-25.1 on [sqrt(1/2) - 1, sqrt(2) - 1].
const EXPONENT_L1: f32 = 1.442695;
const EXPONENT_L2: f32 = -0.7213472;
const EXPONENT_L3: f32 = 0.48090866;
const EXPONENT_L4: f32 = -0.36071476;
const EXPONENT_L5: f32 = 0.28797638;
const EXPONENT_L6: f32 = -0.23871812;
const EXPONENT_L7: f32 = 0.21494865;
const EXPONENT_L8: f32 = -0.20860584;
const EXPONENT_L9: f32 = 0.12952681;

// 2^x for finite x. Below -126 the result is 0, from 128 on the largest finite number.
fn exp2_poly(x: f32) -> f32 {
    if x < -126.0 {
        return 0.0;
    }
    if x >= 128.0 {
        return 3.4028234e38;
    }
    let k = floor(x + 0.5);
    let f = x - k;
    let p = 1.0 + f * (EXPONENT_E1 + f * (EXPONENT_E2 + f * (EXPONENT_E3
        + f * (EXPONENT_E4 + f * (EXPONENT_E5 + f * EXPONENT_E6)))));
    // 2^k in two factors: k = 128 has no f32 of its own.
    let i = i32(k);
    let a = i >> 1u;
    let b = i - a;
    let scale_a = bitcast<f32>(bitcast<u32>(a + 127) << 23u);
    let scale_b = bitcast<f32>(bitcast<u32>(b + 127) << 23u);
    return (p * scale_a) * scale_b;
}

// log2 x for finite x. Zero, subnormal and negative x give -127.
fn log2_poly(x: f32) -> f32 {
    if x < 1.1754944e-38 {
        return -127.0;
    }
    let bits = bitcast<u32>(x);
    // Mantissa in [sqrt(1/2), sqrt(2)): above sqrt(2) the exponent goes up by one.
    let high = (bits & 0x007fffffu) > 0x003504f3u;
    let exponent = i32(bits >> 23u) - 127 + select(0, 1, high);
    let mantissa = (bits & 0x007fffffu) | select(0x3f800000u, 0x3f000000u, high);
    let f = bitcast<f32>(mantissa) - 1.0;
    let p = f
        * (EXPONENT_L1
            + f * (EXPONENT_L2
                + f * (EXPONENT_L3 + f * (EXPONENT_L4 + f * (EXPONENT_L5 + f * (EXPONENT_L6
                    + f * (EXPONENT_L7 + f * (EXPONENT_L8 + f * EXPONENT_L9))))))));
    return f32(exponent) + p;
}

// x^y for x >= 0; x^0 is 1, 0^y is 0 for positive y.
fn pow_poly(x: f32, y: f32) -> f32 {
    if y == 0.0 {
        return 1.0;
    }
    if x == 0.0 {
        return 0.0;
    }
    return exp2_poly(y * log2_poly(x));
}
