// Energy that GGX with a single scattering event loses, given back (Turquin
// 2019). An option: no other module requires this one.

// Directional albedo of white single-scattering GGX, height-correlated Smith
// shadowing. alpha in [1e-4, 1], cos clamped to [0, 1]. Our own fit: never below
// the albedo, at most 1.1 % above.
fn compensation_albedo(alpha: f32, cos: f32) -> f32 {
    let c = clamp(cos, 0.0, 1.0);
    let sum = alpha + c;
    let t = c / sum;
    let x = sqrt(t) - 0.5;
    let y = alpha * alpha - 0.5;
    let part_a = 1.5838451 + y * (2.1568155 + y * -0.6933848);
    let part_b = -0.048463564 + y * (-1.1377293 + y * 0.6492186);
    let part_c = 6.0199094 + y * (5.0317416 + y * -11.384926);
    let part_d = 5.047814 + y * (9.75618 + y * -28.203835);
    let part_e = -3.2352748 + y * (67.391525 + y * 138.04222);
    let p = part_a + x * (part_b + x * (part_c + x * (part_d + x * part_e)));
    return min(1.0053 - (t * (alpha / sum)) * p, 1.0);
}

// What to multiply a GGX lobe by: 1 + f0 (1 - albedo) / albedo.
fn compensation_factor(f0: vec3f, albedo: f32) -> vec3f {
    let k = (1.0 - albedo) / albedo;
    return vec3f(1.0 + f0.x * k, 1.0 + f0.y * k, 1.0 + f0.z * k);
}
