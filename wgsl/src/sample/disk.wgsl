// Uniform points on the unit disk: polar and concentric (Shirley and Chiu, JGT
// 2(3), 1997), with angles in turns.

// 1/pi.
const DISK_INV_PI: f32 = 0.31830987;
// Largest f32 below one: what invert may return at most.
const DISK_ONE_BELOW: f32 = 0.99999994;

// Polar map: radius sqrt(u.x), angle u.y turns.
fn disk_polar_sample(u: vec2f) -> vec2f {
    let r = sqrt(u.x);
    let turn = sincos_turn(u.y);
    return vec2f(r * turn.y, r * turn.x);
}

// The u that disk_polar_sample maps to p; the centre gives (0, 0).
fn disk_polar_invert(p: vec2f) -> vec2f {
    let radius_squared = p.x * p.x + p.y * p.y;
    return vec2f(min(radius_squared, DISK_ONE_BELOW), atan2_turn(p.y, p.x));
}

// Concentric map: squares around the centre become circles.
fn disk_concentric_sample(u: vec2f) -> vec2f {
    let a = 2.0 * u.x - 1.0;
    let b = 2.0 * u.y - 1.0;
    if a == 0.0 && b == 0.0 {
        return vec2f(0.0, 0.0);
    }
    let wide = abs(a) > abs(b);
    let r = select(b, a, wide);
    // The quotient of the smaller by the larger, so neither choice divides by zero.
    let ratio = select(a, b, wide) / r;
    // ratio is -1 to 1: an eighth of a turn either way.
    let eighth = 0.125 * ratio;
    let turn = sincos_turn(select(0.25 - eighth, eighth, wide));
    return vec2f(r * turn.y, r * turn.x);
}

// The u that disk_concentric_sample maps to p.
fn disk_concentric_invert(p: vec2f) -> vec2f {
    let r = sqrt(p.x * p.x + p.y * p.y);
    let ax = abs(p.x);
    let ay = abs(p.y);
    let wide = ax > ay;
    // Angle from the nearer axis as a fraction of an eighth turn.
    let fraction = 8.0 * atan2_turn(select(ax, ay, wide), select(ay, ax, wide));
    let major = r;
    let minor = r * fraction;
    let a = select(minor, major, wide);
    let b = select(major, minor, wide);
    return vec2f(
        clamp(0.5 + 0.5 * select(a, -a, p.x < 0.0), 0.0, DISK_ONE_BELOW),
        clamp(0.5 + 0.5 * select(b, -b, p.y < 0.0), 0.0, DISK_ONE_BELOW),
    );
}

// Density of both maps per unit area: 1/pi on the disk, 0 outside. The rim is
// taken 2^-20 wide, since a sample on it may round outward.
fn disk_pdf(p: vec2f) -> f32 {
    let radius_squared = p.x * p.x + p.y * p.y;
    if radius_squared > 1.0 + 1.0 / 1048576.0 {
        return 0.0;
    }
    return DISK_INV_PI;
}
