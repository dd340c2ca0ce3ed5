//! Table rows against values worked out by hand, and evaluations with other
//! roundings against the intervals.

use proptest::prelude::*;

use super::{Interval, IntervalError, Limits, Program, Scalar, Table, Tri};

const TINY: f32 = f32::from_bits(1);
const STEP: f64 = 1.192_092_895_507_812_5e-7; // ULP of [1, 2)

const ROWS: &str = "
fn add(a: f32, b: f32) -> f32 { return a + b; }
fn sub(a: f32, b: f32) -> f32 { return a - b; }
fn mul(a: f32, b: f32) -> f32 { return a * b; }
fn div(a: f32, b: f32) -> f32 { return a / b; }
fn rem(a: f32, b: f32) -> f32 { return a % b; }
fn neg(a: f32) -> f32 { return -a; }
fn root(a: f32) -> f32 { return sqrt(a); }
fn inv_root(a: f32) -> f32 { return inverseSqrt(a); }
fn f_abs(a: f32) -> f32 { return abs(a); }
fn f_floor(a: f32) -> f32 { return floor(a); }
fn f_ceil(a: f32) -> f32 { return ceil(a); }
fn f_round(a: f32) -> f32 { return round(a); }
fn f_trunc(a: f32) -> f32 { return trunc(a); }
fn f_sign(a: f32) -> f32 { return sign(a); }
fn f_fract(a: f32) -> f32 { return fract(a); }
fn f_sin(a: f32) -> f32 { return sin(a); }
fn f_cos(a: f32) -> f32 { return cos(a); }
fn f_tan(a: f32) -> f32 { return tan(a); }
fn f_exp(a: f32) -> f32 { return exp(a); }
fn f_exp2(a: f32) -> f32 { return exp2(a); }
fn f_log(a: f32) -> f32 { return log(a); }
fn f_log2(a: f32) -> f32 { return log2(a); }
fn f_pow(a: f32, b: f32) -> f32 { return pow(a, b); }
fn f_atan(a: f32) -> f32 { return atan(a); }
fn f_atan2(a: f32, b: f32) -> f32 { return atan2(a, b); }
fn f_asin(a: f32) -> f32 { return asin(a); }
fn f_acos(a: f32) -> f32 { return acos(a); }
fn f_tanh(a: f32) -> f32 { return tanh(a); }
fn f_min(a: f32, b: f32) -> f32 { return min(a, b); }
fn f_max(a: f32, b: f32) -> f32 { return max(a, b); }
fn f_clamp(a: f32, b: f32, c: f32) -> f32 { return clamp(a, b, c); }
fn f_saturate(a: f32) -> f32 { return saturate(a); }
fn f_fma(a: f32, b: f32, c: f32) -> f32 { return fma(a, b, c); }
fn f_mix(a: f32, b: f32, c: f32) -> f32 { return mix(a, b, c); }
fn f_step(a: f32, b: f32) -> f32 { return step(a, b); }
fn f_smooth(a: f32, b: f32, c: f32) -> f32 { return smoothstep(a, b, c); }
fn f_ldexp(a: f32, n: i32) -> f32 { return ldexp(a, n); }
fn less(a: f32, b: f32) -> bool { return a < b; }
fn equal(a: f32, b: f32) -> bool { return a == b; }
fn third(a: f32) -> f32 { return a / 3.0; }
fn to_u(a: f32) -> u32 { return u32(a); }
fn to_i(a: f32) -> i32 { return i32(a); }
fn from_u(a: u32) -> f32 { return f32(a); }
fn bits(a: f32) -> u32 { return bitcast<u32>(a); }
fn un_bits(a: u32) -> f32 { return bitcast<f32>(a); }
fn f_dot(a: vec3f, b: vec3f) -> f32 { return dot(a, b); }
fn f_cross(a: vec3f, b: vec3f) -> vec3f { return cross(a, b); }
fn f_length(a: vec3f) -> f32 { return length(a); }
fn f_normalize(a: vec3f) -> vec3f { return normalize(a); }
fn f_reflect(a: vec3f, b: vec3f) -> vec3f { return reflect(a, b); }
fn half_pack(a: vec2f) -> u32 { return pack2x16float(a); }
fn half_unpack(a: u32) -> vec2f { return unpack2x16float(a); }
fn unorm_pack(a: vec2f) -> u32 { return pack2x16unorm(a); }
fn unorm_unpack(a: u32) -> vec2f { return unpack2x16unorm(a); }
fn quantize(a: f32) -> f32 { return quantizeToF16(a); }
";

fn rows() -> &'static Program {
    static PROGRAM: std::sync::OnceLock<Program> = std::sync::OnceLock::new();
    PROGRAM.get_or_init(|| Program::parse(ROWS).unwrap())
}

fn floats(x: &[f32]) -> Vec<u32> {
    x.iter().map(|v| v.to_bits()).collect()
}

fn row(table: Table, name: &str, x: &[f32]) -> Interval {
    rows().call(name, &floats(x), table).unwrap()[0]
        .interval()
        .unwrap()
}

fn wgsl(name: &str, x: &[f32]) -> Interval {
    row(Table::Wgsl, name, x)
}

fn ends(i: Interval) -> (f64, f64) {
    (i.lo, i.hi)
}

#[test]
fn sums_and_products_round_either_way() {
    assert_eq!(ends(wgsl("add", &[1.0, 2.0])), (3.0, 3.0));
    assert_eq!(ends(wgsl("add", &[1.0, 2f32.powi(-30)])), (1.0, 1.0 + STEP));
    // The addend is far below the last bit of the f64 sum as well.
    assert_eq!(
        ends(wgsl("add", &[1.0, 2f32.powi(-100)])),
        (1.0, 1.0 + STEP)
    );
    assert_eq!(
        ends(wgsl("sub", &[1.0, 2f32.powi(-100)])),
        (1.0 - STEP / 2.0, 1.0)
    );
    assert_eq!(ends(wgsl("sub", &[0.1, 0.1])), (0.0, 0.0));
    assert_eq!(ends(wgsl("mul", &[1.5, 3.0])), (4.5, 4.5));
    let x = 1.0 + STEP as f32;
    let product = 1.0 + 2.0 * STEP; // plus STEP squared
    assert_eq!(ends(wgsl("mul", &[x, x])), (product, product + STEP));
    assert_eq!(
        ends(wgsl("neg", &[0.1])),
        (f64::from(-0.1f32), f64::from(-0.1f32))
    );
    assert_eq!(wgsl("add", &[f32::MAX, f32::MAX]), Interval::UNBOUNDED);
    assert_eq!(wgsl("add", &[f32::MAX, 1.0]), Interval::UNBOUNDED);
    assert_eq!(wgsl("add", &[-f32::MAX, -1.0]), Interval::UNBOUNDED);
    assert_eq!(wgsl("mul", &[1e30, 1e30]), Interval::UNBOUNDED);
    assert_eq!(wgsl("add", &[f32::NAN, 1.0]), Interval::UNBOUNDED);
}

#[test]
fn subnormal_numbers_may_be_flushed() {
    let m = f64::from(f32::MIN_POSITIVE);
    assert_eq!(ends(wgsl("add", &[1e-40, 0.0])), (0.0, f64::from(1e-40f32)));
    // Each addend may be flushed on its own.
    assert_eq!(
        ends(wgsl("add", &[1e-40, 1e-40])),
        (0.0, 2.0 * f64::from(1e-40f32))
    );
    assert_eq!(
        ends(wgsl("add", &[f32::MIN_POSITIVE, 1e-40])),
        (m, m + f64::from(1e-40f32))
    );
    assert_eq!(ends(wgsl("mul", &[f32::MIN_POSITIVE, 0.5])), (0.0, m / 2.0));
    assert_eq!(
        ends(wgsl("mul", &[-f32::MIN_POSITIVE, 0.5])),
        (-m / 2.0, 0.0)
    );
    assert_eq!(ends(wgsl("mul", &[1e-30, 1e-30])), (0.0, f64::from(TINY)));
    assert_eq!(ends(wgsl("f_floor", &[-1e-40])), (-1.0, 0.0));
    assert_eq!(ends(wgsl("f_ceil", &[1e-40])), (0.0, 1.0));
    assert_eq!(ends(wgsl("f_sign", &[-1e-40])), (-1.0, 0.0));
    assert_eq!(ends(wgsl("f_abs", &[-1e-40])), (0.0, f64::from(1e-40f32)));
    assert_eq!(
        ends(wgsl("f_max", &[1e-40, 2e-40])),
        (0.0, f64::from(2e-40f32))
    );
    assert_eq!(ends(wgsl("f_max", &[0.0, -1e-40])), (0.0, 0.0));
    assert_eq!(
        ends(row(Table::Ieee, "mul", &[f32::MIN_POSITIVE, 0.5])),
        (m / 2.0, m / 2.0)
    );
    assert_eq!(
        rows().call("less", &floats(&[0.0, 1e-40]), Table::Wgsl),
        Ok(vec![Scalar::Bool(Tri::Either)])
    );
    assert_eq!(
        rows().call("less", &floats(&[0.0, 1e-40]), Table::Ieee),
        Ok(vec![Scalar::Bool(Tri::True)])
    );
}

#[test]
fn quotients_are_within_two_and_a_half_ulp() {
    // 1.5: ULP 2^-23, so two steps either way are inside and three are not.
    assert_eq!(
        ends(wgsl("div", &[3.0, 2.0])),
        (1.5 - 2.0 * STEP, 1.5 + 2.0 * STEP)
    );
    // 1/3 = 0x1.5555555..p-2 lies a third of a step below the nearest f32, its
    // ULP is 2^-25: from 2.5 below to 2.5 above.
    let ulp = 2f64.powi(-25);
    let i = wgsl("third", &[1.0]);
    let exact = 1.0 / 3.0;
    assert!(i.lo >= exact - 2.5 * ulp && i.lo - ulp < exact - 2.5 * ulp);
    assert!(i.hi <= exact + 2.5 * ulp && i.hi + ulp > exact + 2.5 * ulp);
    // At a power of two the ULP is that of the lower side.
    assert_eq!(ends(wgsl("div", &[2.0, 2.0])), (1.0 - STEP, 1.0 + STEP));
    assert_eq!(ends(wgsl("div", &[0.0, 3.0])), (0.0, 0.0));
    assert_eq!(wgsl("div", &[1.0, 0.0]), Interval::UNBOUNDED);
    assert_eq!(wgsl("div", &[1.0, 1e-39]), Interval::UNBOUNDED);
    assert_eq!(wgsl("div", &[1.0, 2f32.powi(127)]), Interval::UNBOUNDED);
    assert!(wgsl("div", &[1.0, 2f32.powi(126)]).is_bounded());
    assert!(wgsl("div", &[1.0, f32::MIN_POSITIVE]).is_bounded());
    let q = f64::from(1.0f32 / 3.0);
    assert_eq!(ends(row(Table::Ieee, "third", &[1.0])), (q, q));
    let r = wgsl("rem", &[7.5, 2.0]);
    assert!(r.contains(1.5) && r.width() == 0.0, "{r:?}");
}

#[test]
fn roots_follow_the_inherited_formula() {
    // inverseSqrt(4) = 0.5 within 2 ULP of 2^-25 (below a power of two).
    assert_eq!(
        ends(wgsl("inv_root", &[4.0])),
        (0.5 - STEP / 2.0, 0.5 + STEP / 2.0)
    );
    // 1 / [0.5 - 2^-24, 0.5 + 2^-24], then 2.5 ULP more. Upper: 2 + 2^-22 + 2^-45
    // has ULP 2^-22, so up to 2 + 3.5 * 2^-22, of which three steps are on the
    // grid. Lower: the quotients just above 2 also have ULP 2^-22 and reach down to
    // 2 - 2.5 * 2^-22, lower than 2 - 2^-22 with its ULP of 2^-23 does.
    let i = wgsl("root", &[4.0]);
    assert_eq!(ends(i), (2.0 - 5.0 * STEP, 2.0 + 3.0 * 2.0 * STEP));
    assert_eq!(ends(wgsl("root", &[0.0])), (0.0, 0.0));
    assert_eq!(wgsl("root", &[-1.0]), Interval::UNBOUNDED);
    assert_eq!(wgsl("inv_root", &[0.0]), Interval::UNBOUNDED);
    assert_eq!(
        ends(row(Table::Ieee, "root", &[2.0])),
        (f64::from(2f32.sqrt()), f64::from(2f32.sqrt()))
    );
    // A subnormal argument may be flushed, but its root is an ordinary number.
    let i = wgsl("root", &[1e-40]);
    let truth = f64::from(1e-40f32).sqrt();
    assert!(
        i.lo == 0.0 && i.hi > truth && i.hi < truth * (1.0 + 6.0 * STEP),
        "{i:?}"
    );
}

#[test]
fn exact_functions_stay_exact() {
    for (name, x, y) in [
        ("f_abs", -2.5, 2.5),
        ("f_floor", -2.5, -3.0),
        ("f_ceil", -2.5, -2.0),
        ("f_round", 2.5, 2.0),
        ("f_round", 3.5, 4.0),
        ("f_trunc", -2.5, -2.0),
        ("f_sign", -2.5, -1.0),
        ("f_sign", 0.0, 0.0),
        ("f_fract", -2.25, 0.75),
        ("f_saturate", 1.25, 1.0),
        ("f_saturate", -0.25, 0.0),
    ] {
        assert_eq!(ends(wgsl(name, &[x])), (y, y), "{name}({x})");
    }
    assert_eq!(ends(wgsl("f_clamp", &[5.0, 1.0, 3.0])), (3.0, 3.0));
    // With the bounds swapped, min(max()) gives 1 and the median 2.
    assert_eq!(ends(wgsl("f_clamp", &[2.0, 3.0, 1.0])), (1.0, 2.0));
    assert_eq!(ends(wgsl("f_min", &[5.0, 1.0])), (1.0, 1.0));
    assert_eq!(ends(wgsl("f_step", &[0.5, 0.5])), (1.0, 1.0));
    assert_eq!(ends(wgsl("f_fma", &[2.0, 3.0, 4.0])), (10.0, 10.0));
    assert_eq!(ends(wgsl("f_mix", &[2.0, 4.0, 0.25])), (2.5, 2.5));
    let args = [1.5f32.to_bits(), 4];
    assert_eq!(
        rows().call("f_ldexp", &args, Table::Wgsl).unwrap()[0]
            .interval()
            .map(ends),
        Some((24.0, 24.0))
    );
    // clamp((0.5 - 0) / (1 - 0)) is 0.5 within one ULP of 2^-25 on the low side.
    let i = wgsl("f_smooth", &[0.0, 1.0, 0.5]);
    assert!(i.contains(0.5) && i.width() < 10.0 * STEP, "{i:?}");
}

/// The table's bound about the true value: inside at 0.99 of it, outside at 1.01.
fn bounded_by(i: Interval, truth: f64, error: f64) {
    let slack = 0.02 * error + f64::from(truth as f32).abs() * 2.0 * STEP;
    assert!(
        (i.lo - (truth - error)).abs() <= slack,
        "{i:?} {truth} {error}"
    );
    assert!(
        (i.hi - (truth + error)).abs() <= slack,
        "{i:?} {truth} {error}"
    );
}

#[test]
fn transcendental_rows() {
    let x = 0.7f32;
    let v = f64::from(x);
    bounded_by(wgsl("f_sin", &[x]), v.sin(), 2f64.powi(-11));
    bounded_by(wgsl("f_cos", &[x]), v.cos(), 2f64.powi(-11));
    assert_eq!(wgsl("f_sin", &[std::f32::consts::PI]), Interval::UNBOUNDED); // above pi
    assert!(wgsl("f_sin", &[std::f32::consts::PI.next_down()]).is_bounded());
    assert_eq!(wgsl("f_cos", &[-4.0]), Interval::UNBOUNDED);
    bounded_by(wgsl("f_exp", &[3.0]), 3f64.exp(), 9.0 * 2f64.powi(-19));
    bounded_by(wgsl("f_exp2", &[3.5]), 3.5f64.exp2(), 10.0 * 2f64.powi(-20));
    bounded_by(wgsl("f_log", &[1.25]), 1.25f64.ln(), 2f64.powi(-21));
    bounded_by(wgsl("f_log", &[8.0]), 8f64.ln(), 3.0 * 2f64.powi(-22));
    bounded_by(wgsl("f_log2", &[8.5]), 8.5f64.log2(), 3.0 * 2f64.powi(-22));
    assert_eq!(wgsl("f_log", &[0.0]), Interval::UNBOUNDED);
    assert_eq!(wgsl("f_log", &[-1.0]), Interval::UNBOUNDED);
    assert_eq!(wgsl("f_exp", &[100.0]), Interval::UNBOUNDED);
    bounded_by(wgsl("f_atan", &[x]), v.atan(), 4096.0 * 2f64.powi(-24));
    bounded_by(
        wgsl("f_atan2", &[x, -1.0]),
        v.atan2(-1.0),
        4096.0 * 2f64.powi(-22),
    );
    assert_eq!(wgsl("f_atan2", &[0.0, 1.0]), Interval::UNBOUNDED);
    assert_eq!(wgsl("f_atan2", &[1.0, 0.0]), Interval::UNBOUNDED);
    assert_eq!(wgsl("f_acos", &[1.5]), Interval::UNBOUNDED);
    let acos = wgsl("f_acos", &[0.5]);
    assert!(
        acos.lo <= 0.5f64.acos() - 6.7e-5 && acos.hi < 0.5f64.acos() + 1e-3,
        "{acos:?}"
    );
    let asin = wgsl("f_asin", &[0.5]);
    assert!(
        asin.hi >= 0.5f64.asin() + 6.8e-5 && asin.lo > 0.5f64.asin() - 1e-3,
        "{asin:?}"
    );
    let tanh = wgsl("f_tanh", &[0.5]);
    assert!(
        tanh.contains(0.5f64.tanh() + 9.9e-6) && !tanh.contains(0.5f64.tanh() + 2e-5),
        "{tanh:?}"
    );
    let tan = wgsl("f_tan", &[0.5]);
    assert!(
        tan.contains(0.5f64.tan()) && tan.width() < 3e-3 && tan.width() > 1e-3,
        "{tan:?}"
    );
    // pow(2, 3) = exp2(3 * log2(2)): log2 within 2^-21, tripled, times 8 ln 2.
    let pow = wgsl("f_pow", &[2.0, 3.0]);
    let expected = 8.0 * std::f64::consts::LN_2 * 3.0 * 2f64.powi(-21) + 9.0 * 8.0 * STEP;
    assert!(
        (pow.hi - 8.0 - expected).abs() < 0.15 * expected,
        "{pow:?} {expected}"
    );
}

#[test]
fn integers_and_bits() {
    let word = |name: &str, x: u32| rows().call(name, &[x], Table::Wgsl).unwrap();
    let exact = |x: u32| vec![Scalar::U32 { lo: x, hi: x }];
    assert_eq!(word("to_u", 3.9f32.to_bits()), exact(3));
    assert_eq!(word("to_u", (-1.0f32).to_bits()), exact(0));
    assert_eq!(word("to_u", 1e20f32.to_bits()), exact(4_294_967_040));
    assert_eq!(
        word("to_i", (-3.9f32).to_bits()),
        vec![Scalar::I32 { lo: -3, hi: -3 }]
    );
    assert_eq!(
        word("to_i", 1e20f32.to_bits()),
        vec![Scalar::I32 {
            lo: 2_147_483_520,
            hi: 2_147_483_520
        }]
    );
    assert_eq!(
        word("to_i", (-1e20f32).to_bits()),
        vec![Scalar::I32 {
            lo: i32::MIN,
            hi: i32::MIN
        }]
    );
    assert_eq!(word("bits", 1.5f32.to_bits()), exact(1.5f32.to_bits()));
    assert_eq!(word("bits", 0x8000_0000), exact(0x8000_0000));
    let f = |name: &str, x: u32| ends(word(name, x)[0].interval().unwrap());
    assert_eq!(f("from_u", 1 << 24), (16_777_216.0, 16_777_216.0));
    assert_eq!(f("from_u", (1 << 24) + 1), (16_777_216.0, 16_777_218.0));
    assert_eq!(f("from_u", u32::MAX), (4_294_967_040.0, 4_294_967_296.0));
    assert_eq!(f("un_bits", 0x3fc0_0000), (1.5, 1.5));
    assert_eq!(f("un_bits", 0x7fc0_0000), ends(Interval::UNBOUNDED));
    // 1/3 in f16 lies between 0x3555 and 0x3556.
    let packed = rows()
        .call("half_pack", &floats(&[1.0, 1.0 / 3.0]), Table::Wgsl)
        .unwrap();
    assert_eq!(
        packed,
        vec![Scalar::U32 {
            lo: 0x3555_3c00,
            hi: 0x3556_3c00
        }]
    );
    let packed = rows()
        .call("half_pack", &floats(&[1.0, 1.0 / 3.0]), Table::Ieee)
        .unwrap();
    assert_eq!(packed, exact(0x3555_3c00));
    let halves = rows()
        .call("half_unpack", &[0xc200_3c00], Table::Wgsl)
        .unwrap();
    assert_eq!(ends(halves[0].interval().unwrap()), (1.0, 1.0));
    assert_eq!(ends(halves[1].interval().unwrap()), (-3.0, -3.0));
    assert_eq!(
        rows()
            .call("unorm_pack", &floats(&[0.0, 1.0]), Table::Wgsl)
            .unwrap(),
        exact(0xffff_0000)
    );
    let unorm = rows()
        .call("unorm_unpack", &[0x8000_ffff], Table::Wgsl)
        .unwrap();
    assert!(unorm[0].interval().unwrap().contains(1.0));
    bounded_by(
        unorm[1].interval().unwrap(),
        32768.0 / 65535.0,
        3.0 * 2f64.powi(-24),
    );
    let q = wgsl("quantize", &[1.0 / 3.0]);
    assert_eq!(q.width(), 2f64.powi(-12));
}

#[test]
fn geometry_rows() {
    let args = |a: [f32; 3], b: [f32; 3]| floats(&[a[0], a[1], a[2], b[0], b[1], b[2]]);
    // 1e8 + 1 - 1e8: the order of a dot product is open.
    let r = rows()
        .call("f_dot", &args([1e8, 1.0, -1e8], [1.0; 3]), Table::Wgsl)
        .unwrap();
    let i = r[0].interval().unwrap();
    assert!(
        i.contains(0.0) && i.contains(1.0) && i.contains(8.0) && i.width() < 20.0,
        "{i:?}"
    );
    let r = rows()
        .call(
            "f_cross",
            &args([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
            Table::Wgsl,
        )
        .unwrap();
    assert_eq!(r[2].interval().map(ends), Some((1.0, 1.0)));
    let r = rows()
        .call("f_length", &floats(&[3.0, 4.0, 0.0]), Table::Wgsl)
        .unwrap();
    let i = r[0].interval().unwrap();
    assert!(i.contains(5.0) && i.width() < 10.0 * 4.0 * STEP, "{i:?}");
    let r = rows()
        .call("f_normalize", &floats(&[3.0, 4.0, 0.0]), Table::Wgsl)
        .unwrap();
    assert!(r[1].contains(0.8f32.to_bits()) && r[1].interval().unwrap().width() < 20.0 * STEP);
    let r = rows()
        .call(
            "f_reflect",
            &args([1.0, -1.0, 0.0], [0.0, 1.0, 0.0]),
            Table::Wgsl,
        )
        .unwrap();
    assert_eq!(r[1].interval().map(ends), Some((1.0, 1.0)));
}

// Evaluations with other roundings.

/// Source of roundings for the Rust mirrors below.
trait Fp {
    fn add(&mut self, a: f32, b: f32) -> f32;
    fn mul(&mut self, a: f32, b: f32) -> f32;
    fn div(&mut self, a: f32, b: f32) -> f32;
    fn sqrt(&mut self, a: f32) -> f32;
    /// `a * b + c`, which may be fused.
    fn mul_add(&mut self, a: f32, b: f32, c: f32) -> f32 {
        let p = self.mul(a, b);
        self.add(p, c)
    }
    fn sub(&mut self, a: f32, b: f32) -> f32 {
        self.add(a, -b)
    }
    /// `product + c`, where `product` is the rounded `a * b` and may be fused.
    fn mul_add_from(&mut self, product: f32, _a: f32, _b: f32, c: f32) -> f32 {
        self.add(product, c)
    }
}

struct Nearest;

impl Fp for Nearest {
    fn add(&mut self, a: f32, b: f32) -> f32 {
        a + b
    }
    fn mul(&mut self, a: f32, b: f32) -> f32 {
        a * b
    }
    fn div(&mut self, a: f32, b: f32) -> f32 {
        a / b
    }
    fn sqrt(&mut self, a: f32) -> f32 {
        a.sqrt()
    }
}

/// Rounds at random, flushes at random and fuses at random, within the table.
struct Perturbed(u64);

impl Perturbed {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    fn coin(&mut self) -> bool {
        self.next() & 1 == 0
    }
    fn flush(&mut self, x: f32) -> f32 {
        if x.is_subnormal() && self.coin() {
            0.0
        } else {
            x
        }
    }
    /// `y` or its neighbour on the side of the residual.
    fn round(&mut self, y: f32, residual: f64) -> f32 {
        let r = if residual == 0.0 || self.coin() {
            y
        } else if residual > 0.0 {
            y.next_up()
        } else {
            y.next_down()
        };
        self.flush(r)
    }
    /// An `f32` within `n` ULP of `x`.
    fn near(&mut self, x: f64, n: f64) -> f32 {
        if x == 0.0 || !(x as f32).is_finite() {
            return x as f32;
        }
        let nearest = x as f32;
        let below = if f64::from(nearest).abs() >= x.abs() {
            f32::from_bits(nearest.to_bits() - 1)
        } else {
            nearest
        };
        let ulp = (f64::from(below) - f64::from(f32::from_bits(below.to_bits() + 1))).abs();
        loop {
            let k = (self.next() % 7) as i32 - 3;
            let y = f32::from_bits(nearest.to_bits().wrapping_add_signed(k));
            if (f64::from(y) - x).abs() <= n * ulp {
                return self.flush(y);
            }
        }
    }
}

impl Fp for Perturbed {
    fn add(&mut self, a: f32, b: f32) -> f32 {
        let (a, b) = (self.flush(a), self.flush(b));
        // The error of a sum is itself an f32 (two-sum).
        let s = a + b;
        let c = s - a;
        let e = (a - (s - c)) + (b - c);
        self.round(s, f64::from(e))
    }
    fn mul(&mut self, a: f32, b: f32) -> f32 {
        let (a, b) = (self.flush(a), self.flush(b));
        let p = a * b;
        self.round(p, f64::from(a) * f64::from(b) - f64::from(p))
    }
    fn div(&mut self, a: f32, b: f32) -> f32 {
        let (a, b) = (self.flush(a), self.flush(b));
        self.near(f64::from(a) / f64::from(b), 2.5)
    }
    fn sqrt(&mut self, a: f32) -> f32 {
        let a = self.flush(a);
        if a == 0.0 {
            return 0.0;
        }
        let r = self.near(1.0 / f64::from(a).sqrt(), 2.0);
        self.div(1.0, r)
    }
    fn mul_add(&mut self, a: f32, b: f32, c: f32) -> f32 {
        if self.coin() {
            let r = a.mul_add(b, c);
            return self.flush(r);
        }
        let p = self.mul(a, b);
        self.add(p, c)
    }
    fn mul_add_from(&mut self, product: f32, a: f32, b: f32, c: f32) -> f32 {
        if self.coin() {
            let r = a.mul_add(b, c);
            return self.flush(r);
        }
        self.add(product, c)
    }
}

const KERNELS: &str = "
struct Frame { tangent: vec3f, bitangent: vec3f, normal: vec3f, }
const TABLE = array<f32, 4>(0.5, 1.5, -0.25, 2.0);

fn horner(x: f32) -> f32 {
    let a = 0.3 * x + 1.25;
    let b = a * x - 0.7;
    return b * x + 0.1;
}

fn unit(v: vec3f) -> vec3f {
    let len = sqrt((v.x * v.x + v.y * v.y) + v.z * v.z);
    return v / len;
}

fn basis(v: vec3f) -> Frame {
    let n = unit(v);
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return Frame(
        vec3f(1.0 + s * n.x * n.x * a, s * b, -s * n.x),
        vec3f(b, s + n.y * n.y * a, -n.y),
        n,
    );
}

fn sine(x: f32) -> f32 {
    let q = floor(x * 0.63661975 + 0.5);
    let r = x - q * 1.5707964;
    let r2 = r * r;
    let s = r * (1.0 + r2 * (-0.16666667 + r2 * 0.008333333));
    let c = 1.0 + r2 * (-0.5 + r2 * 0.041666668);
    let quadrant = i32(q) & 3;
    var y = s;
    switch quadrant {
        case 0: { y = s; }
        case 1: { y = c; }
        case 2: { y = -s; }
        default: { y = -c; }
    }
    return y;
}

fn radical_inverse(base: u32, index: u32) -> f32 {
    var n = index;
    var reversed = 0u;
    var scale = 1u;
    loop {
        if n == 0u || scale > 16777215u / base { break; }
        let q = n / base;
        reversed = reversed * base + (n - q * base);
        scale *= base;
        n = q;
    }
    return f32(reversed) / f32(scale);
}

fn oct_sign(x: f32) -> f32 { if x >= 0.0 { return 1.0; } return -1.0; }

fn octahedral(v: vec3f) -> vec2f {
    let k = (abs(v.x) + abs(v.y)) + abs(v.z);
    let p = vec2f(v.x / k, v.y / k);
    if v.z < 0.0 {
        return vec2f((1.0 - abs(p.y)) * oct_sign(p.x), (1.0 - abs(p.x)) * oct_sign(p.y));
    }
    return p;
}

fn roots(a: f32, b: f32, c: f32) -> vec2f {
    let d = b * b - a * c;
    if d < 0.0 { return vec2f(-1.0); }
    let q = b + select(-1.0, 1.0, b >= 0.0) * sqrt(d);
    var r = vec2f(q / a, 0.0);
    if q != 0.0 { r.y = c / q; }
    for (var i = 0; i < 2; i++) { if r[i] < 0.0 { r[i] = -r[i]; } }
    return r;
}

fn bump(p: ptr<function, array<vec2f, 2>>, i: u32) { (*p)[i].y += TABLE[i + 1u]; }
fn arrays(x: f32, i: u32) -> array<vec2f, 2> {
    var a = array<vec2f, 2>(vec2f(x), vec2f(TABLE[i], 1.0));
    bump(&a, i);
    return a;
}
";

fn kernels() -> &'static Program {
    static PROGRAM: std::sync::OnceLock<Program> = std::sync::OnceLock::new();
    PROGRAM.get_or_init(|| Program::parse(KERNELS).unwrap())
}

fn horner(m: &mut impl Fp, x: f32) -> Vec<f32> {
    let a = m.mul_add(0.3, x, 1.25);
    let b = m.mul_add(a, x, -0.7);
    vec![m.mul_add(b, x, 0.1)]
}

fn unit(m: &mut impl Fp, v: [f32; 3]) -> [f32; 3] {
    let xx = m.mul(v[0], v[0]);
    let xy = m.mul_add(v[1], v[1], xx);
    let d = m.mul_add(v[2], v[2], xy);
    let len = m.sqrt(d);
    v.map(|x| m.div(x, len))
}

fn basis(m: &mut impl Fp, v: [f32; 3]) -> Vec<f32> {
    let n = unit(m, v);
    let s = if n[2] >= 0.0 { 1.0 } else { -1.0 };
    let sum = m.add(s, n[2]);
    let a = m.div(-1.0, sum);
    let xy = m.mul(n[0], n[1]);
    let b = m.mul(xy, a);
    let sxx = m.mul(s * n[0], n[0]);
    let yy = m.mul(n[1], n[1]);
    vec![
        m.mul_add(sxx, a, 1.0),
        s * b,
        -s * n[0],
        b,
        m.mul_add(yy, a, s),
        -n[1],
        n[0],
        n[1],
        n[2],
    ]
}

fn sine(m: &mut impl Fp, x: f32) -> Vec<f32> {
    let q = m.mul_add(x, 0.636_619_75, 0.5).floor();
    let r = m.mul_add(-q, 1.570_796_4, x);
    let r2 = m.mul(r, r);
    let s = m.mul_add(r2, 0.008_333_333, -0.166_666_67);
    let s = m.mul_add(r2, s, 1.0);
    let s = m.mul(r, s);
    let c = m.mul_add(r2, 0.041_666_668, -0.5);
    let c = m.mul_add(r2, c, 1.0);
    vec![match (q as i32) & 3 {
        0 => s,
        1 => c,
        2 => -s,
        _ => -c,
    }]
}

fn radical_inverse(m: &mut impl Fp, base: u32, index: u32) -> Vec<f32> {
    let (mut n, mut reversed, mut scale) = (index, 0, 1);
    while n != 0 && scale <= 16_777_215 / base {
        reversed = reversed * base + n % base;
        scale *= base;
        n /= base;
    }
    vec![m.div(reversed as f32, scale as f32)]
}

fn octahedral(m: &mut impl Fp, v: [f32; 3]) -> Vec<f32> {
    let k = m.add(v[0].abs(), v[1].abs());
    let k = m.add(k, v[2].abs());
    let p = [m.div(v[0], k), m.div(v[1], k)];
    if v[2] < 0.0 {
        let sign = |x: f32| if x >= 0.0 { 1.0 } else { -1.0 };
        let (a, b) = (m.sub(1.0, p[1].abs()), m.sub(1.0, p[0].abs()));
        return vec![a * sign(p[0]), b * sign(p[1])];
    }
    p.to_vec()
}

fn roots(m: &mut impl Fp, a: f32, b: f32, c: f32) -> Vec<f32> {
    let ac = m.mul(a, c);
    let d = m.mul_add(b, b, -ac);
    if d < 0.0 {
        return vec![-1.0, -1.0];
    }
    let s = if b >= 0.0 { 1.0 } else { -1.0 };
    let root = m.sqrt(d);
    let q = m.add(b, s * root);
    let r = [m.div(q, a), if q == 0.0 { 0.0 } else { m.div(c, q) }];
    r.map(f32::abs).to_vec()
}

/// The mirror with nearest rounding lies in the IEEE intervals, these in the WGSL
/// ones, and 16 perturbed runs as well.
fn sound(
    name: &str,
    args: &[u32],
    seed: u64,
    run: impl Fn(&mut Perturbed) -> Vec<f32>,
    nearest: &[f32],
) {
    let ieee = kernels().call(name, args, Table::Ieee).unwrap();
    let wgsl = kernels().call(name, args, Table::Wgsl).unwrap();
    assert_eq!(ieee.len(), nearest.len());
    for (i, &x) in nearest.iter().enumerate() {
        assert!(
            ieee[i].contains(x.to_bits()),
            "{name}[{i}]: {x:e} not in IEEE {:?}",
            ieee[i]
        );
        let (a, b) = (ieee[i].interval().unwrap(), wgsl[i].interval().unwrap());
        assert!(
            b.lo <= a.lo && a.hi <= b.hi,
            "{name}[{i}]: IEEE {a:?} not in WGSL {b:?}"
        );
    }
    for k in 0..16 {
        let result = run(&mut Perturbed(seed.wrapping_add(k)));
        for (i, &x) in result.iter().enumerate() {
            assert!(
                wgsl[i].contains(x.to_bits()),
                "{name}[{i}]: {x:e} not in {:?}",
                wgsl[i]
            );
        }
    }
}

fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -4.0f32..4.0,
        2 => (any::<bool>(), 90u32..160, 0u32..1 << 23)
            .prop_map(|(s, e, m)| f32::from_bits((u32::from(s) << 31) | (e << 23) | m)),
        1 => (-8i32..8).prop_map(|x| x as f32 * 0.25),
        1 => any::<u32>().prop_map(|x| f32::from_bits(x & 0x807f_ffff)),
    ]
}

/// As [`number`], without the subnormal ones: comparisons would otherwise meet
/// numbers that are flushed at one use and kept at the next.
fn normal() -> impl Strategy<Value = f32> {
    number().prop_map(|x| if x.is_subnormal() { 0.0 } else { x })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn horner_is_sound(x in number(), seed: u64) {
        sound("horner", &floats(&[x]), seed, |m| horner(m, x), &horner(&mut Nearest, x));
    }

    #[test]
    fn normalising_is_sound(x in normal(), y in normal(), z in normal(), seed: u64) {
        let v = [x, y, z];
        sound("unit", &floats(&v), seed, |m| unit(m, v).to_vec(), &unit(&mut Nearest, v));
    }

    #[test]
    fn basis_is_sound(x in normal(), y in normal(), z in normal(), seed: u64) {
        let v = [x, y, z];
        prop_assume!(x * x + y * y + z * z > 1e-20);
        sound("basis", &floats(&v), seed, |m| basis(m, v), &basis(&mut Nearest, v));
    }

    #[test]
    fn sine_is_sound(x in -50.0f32..50.0, q in -20i32..20, near: bool, seed: u64) {
        // Half of the arguments sit where the quadrant changes.
        let x = if near { (q as f32 + 0.5) * std::f32::consts::FRAC_PI_2 } else { x };
        sound("sine", &floats(&[x]), seed, |m| sine(m, x), &sine(&mut Nearest, x));
    }

    #[test]
    fn radical_inverse_is_sound(base in 2u32..32, index: u32, seed: u64) {
        let args = [base, index];
        sound("radical_inverse", &args, seed, |m| radical_inverse(m, base, index),
            &radical_inverse(&mut Nearest, base, index));
    }

    #[test]
    fn octahedral_is_sound(x in normal(), y in normal(), z in normal(), seed: u64) {
        let v = [x, y, z];
        prop_assume!(x.abs() + y.abs() + z.abs() > 1e-20);
        sound("octahedral", &floats(&v), seed, |m| octahedral(m, v), &octahedral(&mut Nearest, v));
    }

    #[test]
    fn roots_are_sound(a in 0.25f32..4.0, b in -4.0f32..4.0, c in -4.0f32..4.0, double: bool, seed: u64) {
        // Half of the cases have a discriminant near zero.
        let c = if double { b * b / a } else { c };
        sound("roots", &floats(&[a, b, c]), seed, |m| roots(m, a, b, c), &roots(&mut Nearest, a, b, c));
    }

    #[test]
    fn single_operations_hold_both_neighbours(a in number(), b in number()) {
        for (name, y, exact) in [
            ("add", a + b, None),
            ("mul", a * b, Some(f64::from(a) * f64::from(b))),
        ] {
            let i = wgsl(name, &[a, b]);
            prop_assert!(i.contains(f64::from(y)));
            // Two adjacent numbers at most, when nothing can be flushed.
            if i.is_bounded() && [a, b, y].iter().all(|x| x.abs() > 1e-37) {
                prop_assert!(i.hi as f32 == i.lo as f32 || (i.lo as f32).next_up() == i.hi as f32, "{:?}", i);
                if let Some(exact) = exact {
                    prop_assert!(i.lo <= exact && exact <= i.hi);
                    prop_assert_eq!(i.width() == 0.0, f64::from(y) == exact);
                }
            }
        }
    }
}

#[test]
fn pointers_arrays_and_constants() {
    let r = kernels()
        .call("arrays", &[0.5f32.to_bits(), 1], Table::Wgsl)
        .unwrap();
    let values: Vec<_> = r
        .iter()
        .map(|s| s.interval().map(ends).unwrap().0)
        .collect();
    assert_eq!(values, [0.5, 0.5, 1.5, 0.75]);
    assert!(r.iter().all(Scalar::is_exact));
    let error = kernels().call("arrays", &[0, 7], Table::Wgsl);
    assert_eq!(
        error,
        Err(IntervalError::IndexOutOfBounds {
            function: "arrays".into(),
            index: 7,
            length: 4
        })
    );
}

const BRANCHES: &str = "
fn both(a: f32) -> vec2f {
    let x = a / 3.0;
    if x * 3.0 < a { return vec2f(10.0, x); }
    return vec2f(20.0, -x);
}
fn guarded(a: f32, b: f32) -> f32 {
    let d = a / 3.0 - b;
    if d > 0.0 { return sqrt(d); }
    return 0.0;
}
fn unguarded(a: f32, b: f32) -> f32 { return sqrt(a / 3.0 - b); }
fn square(a: f32, b: f32) -> f32 {
    let v = vec2f(a / 3.0 - b, 1.0);
    return helper(v, v);
}
fn helper(p: vec2f, q: vec2f) -> f32 { return p.x * q.x; }
fn wrapped(a: f32) -> f32 { let x = a / 3.0; return x - floor(x); }
fn count(a: f32) -> u32 { return u32(a / 3.0) * 10u; }
fn loops(a: f32) -> i32 {
    var n = 0;
    for (var x = a / 3.0; x >= 1.0; x -= 1.0) { n++; }
    return n;
}
fn chosen(a: f32) -> vec2f {
    let x = a / 3.0;
    let c = x >= 1.0;
    return vec2f(select(0.0, 5.0, c), select(5.0, 0.0, c));
}
fn chosen_sum(a: f32) -> f32 { let v = chosen(a); return v.x + v.y; }
fn sign_bit(a: f32, b: f32) -> f32 {
    let d = a / 3.0 - b;
    let s = bitcast<u32>(d) & 0x80000000u;
    return bitcast<f32>(s | 0x3f800000u);
}
fn nan_test(a: f32, b: f32) -> bool {
    let d = a / 3.0 - b;
    return (bitcast<u32>(d) & 0x7fffffffu) > 0x7f800000u;
}
fn flip(a: f32) -> f32 { return bitcast<f32>(bitcast<u32>(a / 3.0) ^ 0x80000000u); }
fn larger(a: f32, b: f32) -> f32 {
    let x = a / 3.0 - b;
    let y = a / 3.0 - b;
    let m = max(x, y);
    return m * x;
}
fn fused(a: f32, b: f32) -> f32 {
    let x = a * b;
    if x >= 1.0 { return x - 1.0; }
    return 0.0;
}
fn between(a: f32) -> f32 {
    let x = a / 3.0;
    if x < 1.0 { return x; }
    return 1.0;
}
fn odd_sum(n: u32) -> u32 {
    var sum = 0u;
    for (var i = 0u; i < n; i++) {
        if (i & 1u) == 0u { continue; }
        sum += i;
    }
    return sum;
}
fn forever(a: f32) -> f32 {
    var x = a / 3.0;
    loop { if x == 1.0 { break; } x = a / 3.0; }
    return x;
}
fn spin() -> f32 { var i = 0u; loop { i++; if i == 0u { break; } } return 1.0; }
fn matrices(a: f32) -> f32 { return (mat2x2f(a, a, a, a) * vec2f(1.0)).x; }
";

#[test]
fn ambiguous_branches_join_both_sides() {
    let p = Program::parse(BRANCHES).unwrap();
    let call = |name: &str, x: &[f32]| p.call(name, &floats(x), Table::Wgsl).unwrap();
    let f = |name: &str, x: &[f32]| call(name, x)[0].interval().unwrap();
    let third = f64::from(1.0f32 / 3.0);

    let r = call("both", &[1.0]);
    assert_eq!(r[0].interval().map(ends), Some((10.0, 20.0)));
    let i = r[1].interval().unwrap();
    assert!(i.contains(third) && i.contains(-third), "{i:?}");
    let r = p.call("both", &floats(&[1.0]), Table::Ieee).unwrap();
    assert!(r.iter().all(Scalar::is_exact));

    // A decision narrows what it was about.
    let b = 1.0 / 3.0;
    assert!(f("guarded", &[1.0, b]).is_bounded());
    assert_eq!(f("unguarded", &[1.0, b]), Interval::UNBOUNDED);
    assert_eq!(f("square", &[1.0, b]).lo, 0.0);
    let i = f("wrapped", &[3.0]);
    assert!(i.lo == 0.0 && i.hi < 1.0 && i.hi > 0.999, "{i:?}");
    assert_eq!(call("count", &[3.0]), vec![Scalar::U32 { lo: 0, hi: 10 }]);
    assert_eq!(call("count", &[4.0]), vec![Scalar::U32 { lo: 10, hi: 10 }]);
    assert_eq!(call("loops", &[9.0]), vec![Scalar::I32 { lo: 2, hi: 3 }]);
    assert_eq!(call("loops", &[10.0]), vec![Scalar::I32 { lo: 3, hi: 3 }]);
    // Uses of one condition agree.
    assert_eq!(ends(f("chosen_sum", &[3.0])), (5.0, 5.0));
    let r = call("chosen", &[3.0]);
    assert_eq!(r[0].interval().map(ends), Some((0.0, 5.0)));
    assert_eq!(ends(f("sign_bit", &[1.0, b])), (-1.0, 1.0));
    assert_eq!(ends(f("sign_bit", &[1.0, 0.25])), (1.0, 1.0));
    assert_eq!(call("nan_test", &[1.0, b]), vec![Scalar::Bool(Tri::False)]);
    assert!(f("flip", &[1.0]).hi < 0.0);
    // The larger of two overlapping values is neither: no square here.
    assert!(f("larger", &[1.0, b]).lo < 0.0);
    // 1 - 2^-46 rounds up to 1, yet the fused difference is negative.
    let step = STEP as f32;
    assert!(f("fused", &[1.0 + step, 1.0 - step]).lo <= -(2f64.powi(-46)));
    // 1 within 2.5 of its ULP, without the part above it.
    assert_eq!(ends(f("between", &[3.0])), (1.0 - STEP, 1.0));
    assert_eq!(
        p.call("odd_sum", &[7], Table::Wgsl),
        Ok(vec![Scalar::U32 { lo: 9, hi: 9 }])
    );
}

#[test]
fn a_value_taken_by_ends_stays_the_same_value() {
    // a is within 2.5 ULP of 1/3; in x a + y a the two are one value, which
    // plain intervals forget.
    let text = "fn cancel(x: f32) -> f32 {
        let a = 1.0 / x;
        let copy = a + 0.0;
        return 4096.0 * a - 4095.0 * copy;
    }";
    let mut p = Program::parse(text).unwrap();
    let wide = p.call("cancel", &floats(&[3.0]), Table::Wgsl).unwrap()[0];
    p.take_by_ends("cancel", "a").unwrap();
    let thin = p.call("cancel", &floats(&[3.0]), Table::Wgsl).unwrap()[0];
    let (wide, thin) = (wide.interval().unwrap(), thin.interval().unwrap());
    assert!(thin.contains(1.0 / 3.0) && wide.lo < thin.lo && thin.hi < wide.hi);
    assert!(wide.width() > 4.0 * thin.width(), "{wide:?} {thin:?}");
    assert!(matches!(
        p.take_by_ends("cancel", "b"),
        Err(IntervalError::UnknownVariable { .. })
    ));
    assert!(matches!(
        p.take_by_ends("none", "a"),
        Err(IntervalError::UnknownFunction(_))
    ));
}

#[test]
fn errors_are_typed() {
    let mut p = Program::parse(BRANCHES).unwrap();
    let args = floats(&[3.0]);
    assert!(matches!(
        p.call("nothing", &[], Table::Wgsl),
        Err(IntervalError::UnknownFunction(_))
    ));
    assert!(matches!(
        p.call("both", &[], Table::Wgsl),
        Err(IntervalError::ArgumentCount {
            expected: 1,
            found: 0,
            ..
        })
    ));
    assert!(matches!(
        p.call("forever", &args, Table::Wgsl),
        Err(IntervalError::TooAmbiguous { .. })
    ));
    assert!(matches!(
        p.call("matrices", &args, Table::Wgsl),
        Err(IntervalError::Unsupported { .. })
    ));
    p.limits = Limits {
        steps: 10_000,
        ..Limits::default()
    };
    assert!(matches!(
        p.call("spin", &[], Table::Wgsl),
        Err(IntervalError::TooManySteps { .. })
    ));
    assert!(matches!(
        Program::parse("fn f( {"),
        Err(IntervalError::Parse(_))
    ));
}

// Random straight-line programs.

/// One operation on earlier values, by index.
#[derive(Clone, Copy, Debug)]
struct Op {
    kind: u8,
    a: usize,
    b: usize,
    c: usize,
}

/// The program as WGSL: `r0..r2` are arguments, `r3` a constant.
fn program_text(ops: &[Op]) -> String {
    let mut text = String::from("fn f(x0: f32, x1: f32, x2: f32) -> array<f32, 3> {\n");
    for (i, init) in ["x0", "x1", "x2", "0.75"].iter().enumerate() {
        text += &format!("let r{i} = {init};\n");
    }
    for (i, &Op { kind, a, b, c }) in ops.iter().enumerate() {
        let (n, m) = (i + 4, i + 4);
        let (a, b, c) = (
            format!("r{}", a % n),
            format!("r{}", b % n),
            format!("r{}", c % n),
        );
        let e = match kind {
            0 => format!("{a} + {b}"),
            1 => format!("{a} - {b}"),
            2 => format!("{a} * {b}"),
            3 => format!("{a} / {b}"),
            4 => format!("min({a}, {b})"),
            5 => format!("max({a}, {b})"),
            6 => format!("abs({a})"),
            7 => format!("floor({a})"),
            8 => format!("sqrt(abs({a}))"),
            9 => format!("select({a}, {b}, {b} < {c})"),
            10 => format!("-{a}"),
            11 => format!("{a} * {b} + {c}"),
            12 => format!("{a} * {a}"),
            13 => format!("{a} - floor({a})"),
            _ => format!("f32(i32(clamp({a}, -100.0, 100.0)))"),
        };
        text += &format!("let r{m} = {e};\n");
    }
    let n = ops.len() + 4;
    text + &format!(
        "return array<f32, 3>(r{}, r{}, r{});\n}}\n",
        n - 1,
        n - 2,
        n - 3
    )
}

fn run_program(m: &mut impl Fp, ops: &[Op], x: [f32; 3]) -> Vec<f32> {
    let mut r = vec![x[0], x[1], x[2], 0.75];
    // Factors of each value that is a product.
    let mut product: Vec<Option<(f32, f32)>> = vec![None; 4];
    for &Op { kind, a, b, c } in ops {
        let n = r.len();
        let (i, j) = (a % n, b % n);
        let (a, b, c) = (r[i], r[j], r[c % n]);
        let mut factors = None;
        let y = match kind {
            0 => match product[i] {
                Some((p, q)) => m.mul_add_from(a, p, q, b),
                None => m.add(a, b),
            },
            1 => match product[i] {
                Some((p, q)) => m.mul_add_from(a, p, q, -b),
                None => m.sub(a, b),
            },
            2 => {
                factors = Some((a, b));
                m.mul(a, b)
            }
            3 => m.div(a, b),
            4 => {
                if b < a {
                    b
                } else {
                    a
                }
            }
            5 => {
                if a < b {
                    b
                } else {
                    a
                }
            }
            6 => a.abs(),
            7 => a.floor(),
            8 => m.sqrt(a.abs()),
            9 => {
                if b < c {
                    b
                } else {
                    a
                }
            }
            10 => {
                factors = product[i].map(|(p, q)| (-p, q));
                -a
            }
            11 => m.mul_add(a, b, c),
            12 => {
                factors = Some((a, a));
                m.mul(a, a)
            }
            13 => match product[i] {
                Some((p, q)) => m.mul_add_from(a, p, q, -a.floor()),
                None => m.sub(a, a.floor()),
            },
            _ => a.clamp(-100.0, 100.0).trunc(),
        };
        // Past an overflow or a NaN anything is acceptable.
        if !y.is_finite() {
            return Vec::new();
        }
        r.push(y);
        product.push(factors);
    }
    let n = r.len();
    vec![r[n - 1], r[n - 2], r[n - 3]]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn random_programs_are_sound(
        ops in proptest::collection::vec(
            (0u8..15, 0usize..64, 0usize..64, 0usize..64).prop_map(|(kind, a, b, c)| Op { kind, a, b, c }),
            1..14,
        ),
        inputs in proptest::collection::vec([normal(), normal(), normal()], 8),
        seed: u64,
    ) {
        let text = program_text(&ops);
        let p = Program::parse(&text).unwrap();
        for x in inputs {
            let ieee = p.call("f", &floats(&x), Table::Ieee).unwrap();
            let wgsl = match p.call("f", &floats(&x), Table::Wgsl) {
                Err(IntervalError::TooAmbiguous { .. }) => continue,
                r => r.unwrap(),
            };
            let nearest = run_program(&mut Nearest, &ops, x);
            for i in 0..nearest.len() {
                let (a, b) = (ieee[i].interval().unwrap(), wgsl[i].interval().unwrap());
                prop_assert!(ieee[i].contains(nearest[i].to_bits()), "{}{:?}: {:e} not in {:?}", text, x, nearest[i], a);
                prop_assert!(!b.is_bounded() || (b.lo <= a.lo && a.hi <= b.hi), "{}{:?}: {:?} not in {:?}", text, x, a, b);
            }
            for k in 0..8 {
                let y = run_program(&mut Perturbed(seed.wrapping_add(k)), &ops, x);
                for i in 0..y.len() {
                    prop_assert!(wgsl[i].contains(y[i].to_bits()), "{}{:?}: {:e} not in {:?}", text, x, y[i], wgsl[i]);
                }
            }
        }
    }
}
