//! Interval arithmetic on `f32` ends, one function per row of the table.
//!
//! Exact results are formed in `f64`: a product of two `f32` is exact there, the
//! error of a sum is recovered with a two-sum, and quotients and transcendental
//! functions are widened by [`SLACK`] before they meet the `f32` grid.

use super::Table;

/// Relative slack for values computed in `f64` (a few of its ULP).
const SLACK: f64 = 1.0 / (1u64 << 49) as f64;
const MIN: f32 = f32::MIN_POSITIVE;

/// An interval with `f32` ends; infinite ends mean any value, NaN included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Iv {
    pub lo: f32,
    pub hi: f32,
}

impl Iv {
    pub const ANY: Self = Self {
        lo: f32::NEG_INFINITY,
        hi: f32::INFINITY,
    };
    pub const ZERO: Self = Self::point(0.0);
    pub const ONE: Self = Self::point(1.0);

    pub const fn point(x: f32) -> Self {
        if x.is_finite() {
            Self { lo: x, hi: x }
        } else {
            Self::ANY
        }
    }
    pub const fn is_any(self) -> bool {
        !(self.lo.is_finite() && self.hi.is_finite())
    }
    pub fn is_point(self) -> bool {
        self.lo == self.hi
    }
    pub fn hull(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }
    /// Largest magnitude.
    fn mag(self) -> f32 {
        self.lo.abs().max(self.hi.abs())
    }
}

/// Adds zero where a subnormal number may be flushed.
fn flush(t: Table, a: Iv) -> Iv {
    if t == Table::Ieee {
        return a;
    }
    let mut a = a;
    if a.lo > 0.0 && a.lo < MIN {
        a.lo = 0.0;
    }
    if a.hi < 0.0 && a.hi > -MIN {
        a.hi = -0.0;
    }
    a
}

/// Finishes a result: overflow, flushing, and zeros of unknown sign.
fn out(t: Table, lo: f32, hi: f32) -> Iv {
    if !(lo.is_finite() && hi.is_finite()) {
        return Iv::ANY;
    }
    if t == Table::Ieee {
        return Iv { lo, hi };
    }
    let mut a = flush(t, Iv { lo, hi });
    if a.lo == 0.0 {
        a.lo = -0.0;
    }
    if a.hi == 0.0 {
        a.hi = 0.0;
    }
    a
}

/// Largest `f32` not above `s + e`, where `e` is below half an ULP of `s`.
fn down(s: f64, e: f64) -> f32 {
    let y = s as f32;
    let z = f64::from(y);
    if z > s || (z == s && e < 0.0) {
        // Above the largest number the next one down is finite, but the result
        // overflows.
        if s > f64::from(f32::MAX) {
            f32::INFINITY
        } else {
            y.next_down()
        }
    } else if s > f64::from(f32::MAX) {
        f32::INFINITY
    } else {
        y
    }
}

/// Smallest `f32` not below `s + e`.
fn up(s: f64, e: f64) -> f32 {
    -down(-s, -e)
}

fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    let c = s - a;
    (s, (a - (s - c)) + (b - c))
}

/// ULP of the real number `x` on the `f32` grid: the smallest distance between
/// two numbers around it. `above` asks for the numbers just past a power of two,
/// whose ULP is twice that of the power itself.
fn ulp(x: f64, above: bool) -> f64 {
    let bits = x.abs().to_bits();
    let mut e = ((bits >> 52) as i32 - 1023).min(127);
    if !above && bits & ((1 << 52) - 1) == 0 {
        e -= 1;
    }
    let e = (e - 23).max(-149);
    f64::from_bits(((e + 1023) as u64) << 52)
}

/// Least `q - n * ulp(q)` over `lo..=hi`. The ULP doubles at powers of two, so
/// numbers just above one can reach lower than the lower end does.
fn least(lo: f64, hi: f64, n: f64) -> f64 {
    let range = lo > 0.0 && lo < hi;
    let mut l = lo - n * ulp(lo, range);
    if range {
        let power = f64::from_bits((lo.to_bits() + ((1 << 52) - 1)) & !((1 << 52) - 1));
        if power < hi {
            l = l.min(power - n * ulp(power, true));
        }
    }
    l
}

/// All `f32` within `n` ULP of the reals `lo..=hi` (ends good to `SLACK`).
fn within_ulp(t: Table, lo: f64, hi: f64, n: f64) -> Iv {
    grid(
        t,
        least(lo, hi, n),
        -least(-hi, -lo, n),
        SLACK * lo.abs(),
        SLACK * hi.abs(),
    )
}

/// All `f32` within an absolute error of the reals `lo..=hi`.
fn within(t: Table, lo: f64, hi: f64, err: f64) -> Iv {
    grid(t, lo - err, hi + err, SLACK * lo.abs(), SLACK * hi.abs())
}

/// The permitted results are `f32` values, so the ends move inwards to the grid.
fn grid(t: Table, lo: f64, hi: f64, slack_lo: f64, slack_hi: f64) -> Iv {
    let (lo, hi) = (
        lo - slack_lo - SLACK * lo.abs(),
        hi + slack_hi + SLACK * hi.abs(),
    );
    let max = f64::from(f32::MAX);
    if !(lo >= -max && hi <= max) {
        return Iv::ANY;
    }
    out(t, up(lo, 0.0), down(hi, 0.0))
}

pub(super) fn add(t: Table, a: Iv, b: Iv) -> Iv {
    if a.is_any() || b.is_any() {
        return Iv::ANY;
    }
    if t == Table::Ieee {
        return out(t, a.lo + b.lo, a.hi + b.hi);
    }
    let (a, b) = (flush(t, a), flush(t, b));
    let (s, e) = two_sum(f64::from(a.lo), f64::from(b.lo));
    let lo = down(s, e);
    let (s, e) = two_sum(f64::from(a.hi), f64::from(b.hi));
    out(t, lo, up(s, e))
}

pub(super) fn neg(t: Table, a: Iv) -> Iv {
    if a.is_any() {
        return a;
    }
    let (lo, hi) = (-a.hi, -a.lo);
    if t == Table::Ieee || (lo != 0.0 && hi != 0.0) {
        flush(t, Iv { lo, hi })
    } else {
        out(t, lo, hi)
    }
}

pub(super) fn sub(t: Table, a: Iv, b: Iv) -> Iv {
    if b.is_any() {
        return b;
    }
    add(
        t,
        a,
        Iv {
            lo: -b.hi,
            hi: -b.lo,
        },
    )
}

fn extremes(v: [f64; 4]) -> (f64, f64) {
    (
        v[0].min(v[1]).min(v[2].min(v[3])),
        v[0].max(v[1]).max(v[2].max(v[3])),
    )
}

/// Product; `same` says that both factors are one value, whose square has no
/// negative part.
pub(super) fn mul(t: Table, a: Iv, b: Iv, same: bool) -> Iv {
    if a.is_any() || b.is_any() {
        return Iv::ANY;
    }
    if t == Table::Ieee && a.is_point() && b.is_point() {
        let p = a.lo * b.lo;
        return out(t, p, p);
    }
    let (a, b) = (flush(t, a), flush(t, b));
    let (al, ah, bl, bh) = (
        f64::from(a.lo),
        f64::from(a.hi),
        f64::from(b.lo),
        f64::from(b.hi),
    );
    let (mut lo, hi) = extremes([al * bl, al * bh, ah * bl, ah * bh]);
    if same && lo < 0.0 {
        lo = 0.0;
    }
    match t {
        Table::Ieee => out(t, lo as f32, hi as f32),
        Table::Wgsl => out(t, down(lo, 0.0), up(hi, 0.0)),
    }
}

pub(super) fn div(t: Table, a: Iv, b: Iv) -> Iv {
    if a.is_any() || b.is_any() {
        return Iv::ANY;
    }
    let (a, b) = (flush(t, a), flush(t, b));
    if b.lo <= 0.0 && b.hi >= 0.0 {
        return Iv::ANY;
    }
    if t == Table::Ieee {
        let q = [a.lo / b.lo, a.lo / b.hi, a.hi / b.lo, a.hi / b.hi];
        return out(
            t,
            q[0].min(q[1]).min(q[2].min(q[3])),
            q[0].max(q[1]).max(q[2].max(q[3])),
        );
    }
    if b.mag() > f32::from_bits(0x7e80_0000) {
        return Iv::ANY; // beyond 2^126
    }
    let (al, ah, bl, bh) = (
        f64::from(a.lo),
        f64::from(a.hi),
        f64::from(b.lo),
        f64::from(b.hi),
    );
    let (lo, hi) = extremes([al / bl, al / bh, ah / bl, ah / bh]);
    let mut r = within_ulp(t, lo, hi, 2.5);
    if !r.is_any() {
        // The sign of the exact quotient; 0 / y is 0.
        if lo >= 0.0 {
            r.lo = r.lo.max(0.0);
        }
        if hi <= 0.0 {
            r.hi = r.hi.min(0.0);
        }
        r = out(t, r.lo, r.hi);
    }
    r
}

/// Remainder, `a - b * trunc(a / b)`.
pub(super) fn rem(t: Table, a: Iv, b: Iv) -> Iv {
    if t == Table::Ieee && a.is_point() && b.is_point() && !a.is_any() && b.lo != 0.0 {
        return Iv::point(a.lo % b.lo);
    }
    sub(t, a, mul(t, b, step_fn(t, div(t, a, b), f32::trunc), false))
}

/// A non-decreasing exact function (`floor`, `trunc`, `sign`, ...).
pub(super) fn step_fn(t: Table, a: Iv, f: fn(f32) -> f32) -> Iv {
    if a.is_any() {
        return a;
    }
    let a = flush(t, a);
    out(t, f(a.lo), f(a.hi))
}

pub(super) fn sign(x: f32) -> f32 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

pub(super) fn abs(t: Table, a: Iv) -> Iv {
    if a.is_any() {
        return a;
    }
    let r = if a.lo > 0.0 || (a.lo == 0.0 && a.hi > 0.0) {
        Iv {
            lo: a.lo.abs(),
            hi: a.hi,
        }
    } else if a.hi <= 0.0 {
        Iv {
            lo: -a.hi,
            hi: -a.lo,
        }
    } else {
        Iv {
            lo: 0.0,
            hi: a.mag(),
        }
    };
    let r = flush(t, r);
    // abs(-0) has no sign left.
    Iv {
        lo: r.lo.abs(),
        hi: r.hi.abs(),
    }
}

pub(super) fn min(t: Table, a: Iv, b: Iv) -> Iv {
    if a.is_any() || b.is_any() {
        return Iv::ANY;
    }
    let (a, b) = (flush(t, a), flush(t, b));
    subnormal_choice(
        t,
        a,
        b,
        Iv {
            lo: a.lo.min(b.lo),
            hi: a.hi.min(b.hi),
        },
    )
}

pub(super) fn max(t: Table, a: Iv, b: Iv) -> Iv {
    if a.is_any() || b.is_any() {
        return Iv::ANY;
    }
    let (a, b) = (flush(t, a), flush(t, b));
    subnormal_choice(
        t,
        a,
        b,
        Iv {
            lo: a.lo.max(b.lo),
            hi: a.hi.max(b.hi),
        },
    )
}

/// Of two subnormal arguments `min` and `max` may return either one.
fn subnormal_choice(t: Table, a: Iv, b: Iv, r: Iv) -> Iv {
    if t == Table::Ieee {
        return r;
    }
    // The subnormal part of each side, as far as it has one; zero is none.
    let top = MIN.next_down();
    let small = |x: Iv| {
        let holds = (x.lo < MIN && x.hi > 0.0) || (x.lo < 0.0 && x.hi > -MIN);
        holds.then(|| (x.lo.max(-top), x.hi.min(top)))
    };
    match (small(a), small(b)) {
        (Some(x), Some(y)) => out(t, r.lo.min(x.0).min(y.0), r.hi.max(x.1).max(y.1)),
        _ => out(t, r.lo, r.hi),
    }
}

/// `min(max(x, low), high)`, or the median of the three.
pub(super) fn clamp(t: Table, x: Iv, low: Iv, high: Iv) -> Iv {
    let r = min(t, max(t, x, low), high);
    if t == Table::Ieee || r.is_any() || low.hi <= high.lo {
        return r;
    }
    let median = max(t, min(t, x, low), min(t, max(t, x, low), high));
    r.hull(median)
}

pub(super) fn fract(t: Table, a: Iv) -> Iv {
    if a.is_any() {
        return a;
    }
    let a = flush(t, a);
    let k = a.lo.floor();
    if k == a.hi.floor() {
        sub(t, a, Iv::point(k))
    } else {
        Iv { lo: 0.0, hi: 1.0 }
    }
}

pub(super) fn inverse_sqrt(t: Table, a: Iv) -> Iv {
    if a.is_any() {
        return a;
    }
    if t == Table::Ieee {
        return div(t, Iv::ONE, sqrt(t, a));
    }
    let a = flush(t, a);
    if a.lo <= 0.0 {
        return Iv::ANY;
    }
    within_ulp(
        t,
        1.0 / f64::from(a.hi).sqrt(),
        1.0 / f64::from(a.lo).sqrt(),
        2.0,
    )
}

pub(super) fn sqrt(t: Table, a: Iv) -> Iv {
    if a.is_any() || a.lo < 0.0 {
        return Iv::ANY;
    }
    if t == Table::Ieee {
        return Iv {
            lo: a.lo.sqrt(),
            hi: a.hi.sqrt(),
        };
    }
    let a = flush(t, a);
    if a.hi == 0.0 {
        return out(t, 0.0, 0.0);
    }
    if a.lo == 0.0 {
        // 1 / inverseSqrt over the positive part, joined with sqrt(0) = 0.
        let r = least(1.0 / f64::from(a.hi).sqrt(), f64::INFINITY, 2.0);
        return out(
            t,
            0.0,
            div(t, Iv::ONE, grid(t, r, r, 0.0, 2.0 * ulp(r, true))).hi,
        );
    }
    div(t, Iv::ONE, inverse_sqrt(t, a))
}

/// A non-decreasing function within `n(x)` ULP.
fn monotone(t: Table, a: Iv, f: impl Fn(f64) -> f64, n: impl Fn(f64) -> f64) -> Iv {
    if a.is_any() {
        return a;
    }
    let a = flush(t, a);
    let (lo, hi) = (f64::from(a.lo), f64::from(a.hi));
    if t == Table::Ieee {
        return within_ulp(t, f(lo), f(hi), 1.0);
    }
    // The count of ULP may grow towards either end.
    let k = n(lo).max(n(hi));
    within_ulp(t, f(lo), f(hi), k)
}

pub(super) fn exp(t: Table, a: Iv) -> Iv {
    monotone(t, a, f64::exp, |x| 3.0 + 2.0 * x.abs())
}
pub(super) fn exp2(t: Table, a: Iv) -> Iv {
    monotone(t, a, f64::exp2, |x| 3.0 + 2.0 * x.abs())
}

fn log_of(t: Table, a: Iv, f: fn(f64) -> f64) -> Iv {
    if a.is_any() {
        return a;
    }
    let a = flush(t, a);
    if a.lo <= 0.0 {
        return Iv::ANY;
    }
    let (lo, hi) = (f64::from(a.lo), f64::from(a.hi));
    let (l, h) = (f(lo), f(hi));
    if t == Table::Ieee {
        return within_ulp(t, l, h, 1.0);
    }
    // Which bound holds depends on the argument; a range may meet both.
    let near_one = || within(t, l, h, 2f64.powi(-21));
    let elsewhere = || within_ulp(t, l, h, 3.0);
    if lo >= 0.5 && hi <= 2.0 {
        near_one()
    } else if hi < 0.5 || lo > 2.0 {
        elsewhere()
    } else {
        near_one().hull(elsewhere())
    }
}
pub(super) fn log(t: Table, a: Iv) -> Iv {
    log_of(t, a, f64::ln)
}
pub(super) fn log2(t: Table, a: Iv) -> Iv {
    log_of(t, a, f64::log2)
}

pub(super) fn pow(t: Table, a: Iv, b: Iv) -> Iv {
    if t == Table::Ieee && a.is_point() && b.is_point() && !a.is_any() && !b.is_any() && a.lo > 0.0
    {
        let y = f64::from(a.lo).powf(f64::from(b.lo));
        return within_ulp(t, y, y, 1.0);
    }
    exp2(t, mul(t, b, log2(t, a), false))
}

/// Ends of the sine over a range within [-pi, pi].
fn sine_range(lo: f64, hi: f64, f: fn(f64) -> f64, top: f64, bottom: &[f64]) -> (f64, f64) {
    let (a, b) = (f(lo), f(hi));
    let holds = |x: f64| lo <= x && x <= hi;
    let low = if bottom.iter().any(|&x| holds(x)) {
        -1.0
    } else {
        a.min(b)
    };
    (low, if holds(top) { 1.0 } else { a.max(b) })
}

fn trig(t: Table, a: Iv, f: fn(f64) -> f64, top: f64, bottom: &[f64]) -> Iv {
    use std::f64::consts::PI;
    if a.is_any() {
        return a;
    }
    let a = flush(t, a);
    let (lo, hi) = (f64::from(a.lo), f64::from(a.hi));
    if t == Table::Ieee && a.is_point() {
        return within_ulp(t, f(lo), f(lo), 1.0);
    }
    // The double nearest to pi is below it, and no f32 lies between.
    if lo < -PI || hi > PI {
        return if t == Table::Ieee {
            Iv { lo: -1.0, hi: 1.0 }
        } else {
            Iv::ANY
        };
    }
    let (l, h) = sine_range(lo, hi, f, top, bottom);
    match t {
        Table::Ieee => within_ulp(t, l, h, 1.0),
        Table::Wgsl => within(t, l, h, 2f64.powi(-11)),
    }
}
pub(super) fn sin(t: Table, a: Iv) -> Iv {
    use std::f64::consts::FRAC_PI_2;
    trig(t, a, f64::sin, FRAC_PI_2, &[-FRAC_PI_2])
}
pub(super) fn cos(t: Table, a: Iv) -> Iv {
    use std::f64::consts::PI;
    trig(t, a, f64::cos, 0.0, &[-PI, PI])
}
pub(super) fn tan(t: Table, a: Iv) -> Iv {
    div(t, sin(t, a), cos(t, a))
}

pub(super) fn atan(t: Table, a: Iv) -> Iv {
    monotone(t, a, f64::atan, |_| 4096.0)
}

pub(super) fn atan2(t: Table, y: Iv, x: Iv) -> Iv {
    if y.is_any() || x.is_any() {
        return Iv::ANY;
    }
    let (y, x) = (flush(t, y), flush(t, x));
    let crosses = |a: Iv| a.lo <= 0.0 && a.hi >= 0.0;
    let n = match t {
        Table::Ieee => 1.0,
        Table::Wgsl => {
            if crosses(y) || crosses(x) || x.mag() > f32::from_bits(0x7e80_0000) {
                return Iv::ANY;
            }
            4096.0
        }
    };
    if crosses(y) && !(y.is_point() && x.is_point()) {
        return Iv::ANY; // the branch cut
    }
    let f = |a: f32, b: f32| f64::from(a).atan2(f64::from(b));
    let (lo, hi) = extremes([f(y.lo, x.lo), f(y.lo, x.hi), f(y.hi, x.lo), f(y.hi, x.hi)]);
    within_ulp(t, lo, hi, n)
}

/// `asin` and `acos`: the worse of an absolute error and the formula.
fn arc(t: Table, a: Iv, lo: f64, hi: f64, err: f64, formula: impl Fn() -> Iv) -> Iv {
    if a.is_any() || a.lo < -1.0 || a.hi > 1.0 {
        return Iv::ANY;
    }
    match t {
        Table::Ieee => within_ulp(t, lo, hi, 1.0),
        Table::Wgsl => within(t, lo, hi, err).hull(formula()),
    }
}

fn one_minus_square_root(t: Table, a: Iv) -> Iv {
    sqrt(t, sub(t, Iv::ONE, mul(t, a, a, true)))
}
pub(super) fn asin(t: Table, a: Iv) -> Iv {
    let (lo, hi) = (f64::from(a.lo).asin(), f64::from(a.hi).asin());
    arc(t, a, lo, hi, 6.81e-5, || {
        atan2(t, a, one_minus_square_root(t, a))
    })
}
pub(super) fn acos(t: Table, a: Iv) -> Iv {
    let (lo, hi) = (f64::from(a.hi).acos(), f64::from(a.lo).acos());
    arc(t, a, lo, hi, 6.77e-5, || {
        atan2(t, one_minus_square_root(t, a), a)
    })
}

pub(super) fn sinh(t: Table, a: Iv) -> Iv {
    if t == Table::Ieee {
        return monotone(t, a, f64::sinh, |_| 1.0);
    }
    mul(
        t,
        sub(t, exp(t, a), exp(t, neg(t, a))),
        Iv::point(0.5),
        false,
    )
}
pub(super) fn cosh(t: Table, a: Iv) -> Iv {
    if t == Table::Ieee {
        return monotone(t, abs(t, a), f64::cosh, |_| 1.0);
    }
    mul(
        t,
        add(t, exp(t, a), exp(t, neg(t, a))),
        Iv::point(0.5),
        false,
    )
}
pub(super) fn tanh(t: Table, a: Iv) -> Iv {
    if a.is_any() {
        return a;
    }
    if t == Table::Ieee {
        return monotone(t, a, f64::tanh, |_| 1.0);
    }
    let f = flush(t, a);
    within(t, f64::from(f.lo).tanh(), f64::from(f.hi).tanh(), 1e-5).hull(div(
        t,
        sinh(t, a),
        cosh(t, a),
    ))
}
pub(super) fn asinh(t: Table, a: Iv) -> Iv {
    if t == Table::Ieee {
        return monotone(t, a, f64::asinh, |_| 1.0);
    }
    log(t, add(t, a, sqrt(t, add(t, mul(t, a, a, true), Iv::ONE))))
}
pub(super) fn acosh(t: Table, a: Iv) -> Iv {
    if t == Table::Ieee {
        return if a.lo < 1.0 {
            Iv::ANY
        } else {
            monotone(t, a, f64::acosh, |_| 1.0)
        };
    }
    log(t, add(t, a, sqrt(t, sub(t, mul(t, a, a, true), Iv::ONE))))
}
pub(super) fn atanh(t: Table, a: Iv) -> Iv {
    if t == Table::Ieee {
        return if a.lo <= -1.0 || a.hi >= 1.0 {
            Iv::ANY
        } else {
            monotone(t, a, f64::atanh, |_| 1.0)
        };
    }
    let q = div(t, add(t, Iv::ONE, a), sub(t, Iv::ONE, a));
    mul(t, log(t, q), Iv::point(0.5), false)
}

/// `x * y + z`, fused or not.
pub(super) fn fma(t: Table, x: Iv, y: Iv, z: Iv) -> Iv {
    let r = add(t, mul(t, x, y, false), z);
    if t == Table::Ieee && !r.is_any() && x.is_point() && y.is_point() && z.is_point() {
        return r.hull(Iv::point(x.lo.mul_add(y.lo, z.lo)));
    }
    r
}

pub(super) fn mix(t: Table, x: Iv, y: Iv, z: Iv) -> Iv {
    add(t, mul(t, x, sub(t, Iv::ONE, z), false), mul(t, y, z, false))
}

pub(super) fn smooth_step(t: Table, e0: Iv, e1: Iv, x: Iv) -> Iv {
    let s = clamp(t, div(t, sub(t, x, e0), sub(t, e1, e0)), Iv::ZERO, Iv::ONE);
    let u = sub(t, Iv::point(3.0), mul(t, Iv::point(2.0), s, false));
    mul(t, mul(t, s, s, true), u, false)
}

/// `x * 2^n`.
pub(super) fn ldexp(t: Table, x: Iv, n: i32) -> Iv {
    // Exponents past 128 are indeterminate, those far below give zero.
    if x.is_any() || n > 128 {
        return Iv::ANY;
    }
    let x = flush(t, x);
    let scale = 2f64.powi(n.max(-400));
    let (lo, hi) = (f64::from(x.lo) * scale, f64::from(x.hi) * scale);
    match t {
        Table::Ieee => out(t, lo as f32, hi as f32),
        Table::Wgsl => out(t, down(lo, 0.0), up(hi, 0.0)),
    }
}

/// Sum in any order: the table does not say which one `dot` takes.
fn sum(t: Table, terms: &[Iv], mask: usize) -> Iv {
    if mask.count_ones() == 1 {
        return terms[mask.trailing_zeros() as usize];
    }
    let first = 1 << mask.trailing_zeros();
    let mut result: Option<Iv> = None;
    let mut part = (mask - 1) & mask;
    while part != 0 {
        if part & first != 0 {
            let r = add(t, sum(t, terms, part), sum(t, terms, mask & !part));
            result = Some(result.map_or(r, |old| old.hull(r)));
        }
        part = (part - 1) & mask;
    }
    result.unwrap_or(Iv::ZERO)
}

/// `same[i]` says that `a[i]` and `b[i]` are one value.
pub(super) fn dot(t: Table, a: &[Iv], b: &[Iv], same: &[bool]) -> Iv {
    let mut terms = [Iv::ZERO; 4];
    for i in 0..a.len() {
        terms[i] = mul(t, a[i], b[i], same[i]);
    }
    if t == Table::Ieee {
        return terms[1..a.len()]
            .iter()
            .fold(terms[0], |s, &x| add(t, s, x));
    }
    sum(t, &terms[..a.len()], (1 << a.len()) - 1)
}

/// An integer as `f32`: exact below 2^24, else one of the two neighbours.
pub(super) fn from_int(t: Table, lo: i64, hi: i64) -> Iv {
    match t {
        Table::Ieee => Iv {
            lo: lo as f32,
            hi: hi as f32,
        },
        Table::Wgsl => Iv {
            lo: down(lo as f64, 0.0),
            hi: up(hi as f64, 0.0),
        },
    }
}

/// Within `n` ULP of the real number `x`, for the unpacking built-ins.
pub(super) fn near(t: Table, x: f64, n: f64) -> Iv {
    match t {
        Table::Ieee => Iv::point(x as f32),
        Table::Wgsl if x == 0.0 => Iv::ZERO,
        Table::Wgsl => within_ulp(t, x, x, n),
    }
}

/// Bits of the `f16` next to `x`: toward zero, and away from it when inexact.
pub(super) fn f16_neighbours(x: f32) -> Option<(u16, u16)> {
    let s = ((x.to_bits() >> 16) & 0x8000) as u16;
    let a = x.abs();
    if a > 65504.0 {
        return None;
    }
    // Units of the f16 grid: 2^-24 below 2^-14, else 10 fraction bits.
    let e = (((a.to_bits() >> 23) as i32) - 127).max(-14);
    let units = f64::from(a) * 2f64.powi(10 - e);
    let base = if e == -14 { 0 } else { (e + 14) * 1024 };
    let toward = units.floor();
    let low = (base + toward as i32) as u16;
    let high = if toward == units { low } else { low + 1 };
    (high < 0x7c00).then_some((low | s, high | s))
}

/// Value of `f16` bits; none for infinity and NaN.
pub(super) fn f16_value(h: u16) -> Option<f32> {
    let e = i32::from((h >> 10) & 31);
    let m = f32::from(h & 1023);
    let a = match e {
        31 => return None,
        0 => m * 2f32.powi(-24),
        _ => (1024.0 + m) * 2f32.powi(e - 25),
    };
    Some(if h & 0x8000 != 0 { -a } else { a })
}
