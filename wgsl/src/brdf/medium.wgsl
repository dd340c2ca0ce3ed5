// Media that light crosses: absorption and dispersion.

// log2 e.
const MEDIUM_LOG2_E: f32 = 1.442695;

// What is left of light after a straight way through an absorbing medium, one
// channel (the law of Beer and Lambert). absorption is per unit of length; both
// are at least 0.
fn medium_transmittance_scalar(absorption: f32, distance: f32) -> f32 {
    return exp2_poly(absorption * (-MEDIUM_LOG2_E * distance));
}

// The same for a colour.
fn medium_transmittance(absorption: vec3f, distance: f32) -> vec3f {
    let k = -MEDIUM_LOG2_E * distance;
    return vec3f(
        exp2_poly(absorption.x * k),
        exp2_poly(absorption.y * k),
        exp2_poly(absorption.z * k),
    );
}

// Refractive index by wavelength in micrometres: a + b / wavelength^2, the first
// two terms of Cauchy's equation.
fn medium_cauchy_eta(a: f32, b: f32, wavelength_um: f32) -> f32 {
    return a + b / (wavelength_um * wavelength_um);
}
