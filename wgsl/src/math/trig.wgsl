// Sine, cosine and angle in turns, from polynomials of our own: WGSL promises
// sin and cos only to 2^-11 and only on [-pi, pi], and atan2 to 4096 ULP.
// Range reduction as in Cody and Waite (1980); coefficients: our minimax fits.

// sin(pi/2 r) = r (S0 + S0_LOW + r^2 (S1 + ...)), relative error 2^-27.97 on |r| <= 1/2.
const TRIG_S0: f32 = 1.5707964;
const TRIG_S0_LOW: f32 = -4.371139e-8;
const TRIG_S1: f32 = -0.64596367;
const TRIG_S2: f32 = 0.07968185;
const TRIG_S3: f32 = -0.0046059857;
// cos(pi/2 r) = 1 + r^2 (C1 + ...), absolute error 2^-31.19 on |r| <= 1/2.
const TRIG_C1: f32 = -1.2337005;
const TRIG_C2: f32 = 0.25366852;
const TRIG_C3: f32 = -0.020855254;
const TRIG_C4: f32 = 0.0008935732;
// atan(x) / 2 pi = x (A0 + x^2 (A1 + ...)), relative error 2^-24.56 on |x| <= tan(pi/8).
const TRIG_A0: f32 = 0.15915494;
const TRIG_A1: f32 = -0.053050034;
const TRIG_A2: f32 = 0.031765692;
const TRIG_A3: f32 = -0.021798123;
const TRIG_A4: f32 = 0.011945155;
const TRIG_TAN_EIGHTH: f32 = 0.41421357;

// (sin 2 pi u, cos 2 pi u) for an angle u in turns, |u| <= 2^20.
// Exact at multiples of a quarter turn.
fn sincos_turn(u: f32) -> vec2f {
    let x = 4.0 * u;
    let k = floor(x + 0.5);
    let r = x - k;
    let z = r * r;
    let s = r * (TRIG_S0 + (TRIG_S0_LOW + z * (TRIG_S1 + z * (TRIG_S2 + z * TRIG_S3))));
    let c = 1.0 + z * (TRIG_C1 + z * (TRIG_C2 + z * (TRIG_C3 + z * TRIG_C4)));
    let quadrant = bitcast<u32>(i32(k)) & 3u;
    let swap = (quadrant & 1u) != 0u;
    let sine = select(s, c, swap);
    let cosine = select(c, s, swap);
    return vec2f(
        select(sine, -sine, (quadrant & 2u) != 0u),
        select(cosine, -cosine, ((quadrant + 1u) & 2u) != 0u),
    );
}

// The angle of the point (x, y) in turns, in [0, 1), from the x axis toward
// the y axis; the origin gives 0. Components finite, the larger size in
// [1e-18, 1e18], or both zero.
fn atan2_turn(y: f32, x: f32) -> f32 {
    let ax = abs(x);
    let ay = abs(y);
    let high = max(ax, ay);
    let low = min(ax, ay);
    if high == 0.0 {
        return 0.0;
    }
    // Past 22.5 degrees measure from the diagonal: atan(q) = 1/8 turn + atan((q - 1)/(q + 1)).
    let far = low > TRIG_TAN_EIGHTH * high;
    let num = select(low, low - high, far);
    let den = select(high, low + high, far);
    let q = num / den;
    let z = q * q;
    let a = q * (TRIG_A0 + z * (TRIG_A1 + z * (TRIG_A2 + z * (TRIG_A3 + z * TRIG_A4))));
    let octant = select(a, 0.125 + a, far);
    let quarter = select(octant, 0.25 - octant, ay > ax);
    let half = select(quarter, 0.5 - quarter, x < 0.0);
    let turn = select(half, 1.0 - half, y < 0.0);
    // 1 - 1e-9 rounds to 1, which is 0 again.
    return select(turn, 0.0, turn >= 1.0);
}
