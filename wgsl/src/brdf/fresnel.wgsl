// How much of the light an interface reflects, by angle; unpolarised. cos and
// cos_i are the cosine on the light's side, clamped to [0, 1]; eta is the
// refractive index of the far side over that of the near side, positive.

// Stands in for a zero that something divides by.
const FRESNEL_TINY: f32 = 1e-30;

// Reflectance of a dielectric at normal incidence (Born and Wolf, 1.5.3).
fn fresnel_f0(eta: f32) -> f32 {
    let r = (eta - 1.0) / (eta + 1.0);
    return r * r;
}

// x^5 by three products; pow may err by 57 ULP at x = 0.1.
fn fresnel_fifth(x: f32) -> f32 {
    let square = x * x;
    return square * square * x;
}

// Schlick's approximation (Eurographics 1994), one channel.
fn fresnel_schlick_scalar(f0: f32, cos: f32) -> f32 {
    return f0 + (1.0 - f0) * fresnel_fifth(1.0 - clamp(cos, 0.0, 1.0));
}

// Schlick's approximation of a colour.
fn fresnel_schlick(f0: vec3f, cos: f32) -> vec3f {
    let x = fresnel_fifth(1.0 - clamp(cos, 0.0, 1.0));
    return vec3f(
        f0.x + (1.0 - f0.x) * x,
        f0.y + (1.0 - f0.y) * x,
        f0.z + (1.0 - f0.z) * x,
    );
}

// eta^2 - sin^2, the square of eta times the transmitted cosine; negative at
// total internal reflection. Of two equal sums the one with smaller terms.
fn fresnel_far_square(c: f32, eta: f32) -> f32 {
    if c * c < 0.5 {
        return (eta - 1.0) * (eta + 1.0) + c * c;
    }
    return eta * eta - (1.0 - c) * (1.0 + c);
}

// Schlick's approximation for either side of an interface: for eta < 1 by the
// transmitted cosine, and 1 at total internal reflection.
fn fresnel_schlick_transmitted(f0: f32, cos_i: f32, eta: f32) -> f32 {
    if eta >= 1.0 {
        return fresnel_schlick_scalar(f0, cos_i);
    }
    let c = clamp(cos_i, 0.0, 1.0);
    let square = fresnel_far_square(c, eta);
    if square <= 0.0 {
        return 1.0;
    }
    // One minus the transmitted cosine, without the difference.
    let sin2 = (1.0 - c) * (1.0 + c);
    let x = min(sin2 / (eta * (eta + sqrt(square))), 1.0);
    return f0 + (1.0 - f0) * fresnel_fifth(x);
}

// Exact reflectance of a dielectric (Born and Wolf, 1.5.2); 1 at total internal
// reflection, 0 for eta = 1. The amplitudes are multiplied by their conjugates,
// so that nothing is lost as eta comes close to 1.
fn fresnel_dielectric(cos_i: f32, eta: f32) -> f32 {
    let c = clamp(cos_i, 0.0, 1.0);
    let square = fresnel_far_square(c, eta);
    if square < 0.0 {
        return 1.0;
    }
    let g = sqrt(square);
    let eta2 = eta * eta;
    let step = (eta - 1.0) * (eta + 1.0);
    let sin2 = (1.0 - c) * (1.0 + c);
    let s = c + g;
    let p = eta2 * c + g;
    let rs = step / max(s * s, FRESNEL_TINY);
    let rp = step * ((eta2 * (c * c) - sin2) / max(p * p, FRESNEL_TINY));
    return min(0.5 * (rs * rs + rp * rp), 1.0);
}

// One channel of fresnel_conductor; c in [0, 1].
fn fresnel_conductor_channel(c: f32, eta: f32, k: f32) -> f32 {
    let c2 = c * c;
    let sin2 = (1.0 - c) * (1.0 + c);
    let k2 = k * k;
    // g^2 = n^2 - sin^2 = real + 2i half; |g|^2 and Re g follow.
    let real = fresnel_far_square(c, eta) - k2;
    let half = eta * k;
    let length = sqrt(real * real + 4.0 * (half * half));
    let wide = sqrt(0.5 * (length + abs(real)));
    let narrow = half / max(wide, FRESNEL_TINY);
    let a = select(narrow, wide, real >= 0.0);
    // |n^2 - 1|^2, |cos + g|^2, |n^2 cos + g|^2 and |n^2 cos^2 - sin^2|^2.
    let below = eta - 1.0;
    let above = eta + 1.0;
    let step2 = (below * below + k2) * (above * above + k2);
    let n2 = eta * eta + k2;
    let s = (c2 + length) + 2.0 * (a * c);
    let p = ((n2 * n2) * c2 + length) + 2.0 * ((a * c) * (length + sin2));
    let q_real = c2 * ((eta - k) * (eta + k)) - sin2;
    let q_imaginary = 2.0 * (half * c2);
    let q2 = q_real * q_real + q_imaginary * q_imaginary;
    let rs = step2 / max(s * s, FRESNEL_TINY);
    let rp = step2 * (q2 / max(p * p, FRESNEL_TINY));
    return min(0.5 * (rs + rp), 1.0);
}

// Exact reflectance of a conductor (Born and Wolf, 14.2) with the complex
// refractive index eta + i k relative to the near side, for three wavelengths.
// With k = 0 it is that of a dielectric.
fn fresnel_conductor(cos_i: f32, eta: vec3f, k: vec3f) -> vec3f {
    let c = clamp(cos_i, 0.0, 1.0);
    return vec3f(
        fresnel_conductor_channel(c, eta.x, k.x),
        fresnel_conductor_channel(c, eta.y, k.y),
        fresnel_conductor_channel(c, eta.z, k.z),
    );
}
