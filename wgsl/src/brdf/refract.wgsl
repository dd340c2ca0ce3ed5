// Refraction through an interface, from either side.

// Stands in for a zero that something divides by.
const REFRACT_TINY: f32 = 1e-30;

// Where light goes at an interface.
struct Refraction {
    // The refracted direction, or the mirrored one at total internal
    // reflection; unit, away from the interface.
    direction: vec3f,
    // Cosine on the far side; 0 at total internal reflection.
    cos_transmitted: f32,
    // 1 at total internal reflection, else 0.
    total: u32,
}

// Snell's law for light that arrives from wi, which points away from the
// interface. eta is the refractive index of the medium that n points away from
// over that of the medium it points into; the side is found from wi.
fn refract_snell(wi: vec3f, n: vec3f, eta: f32) -> Refraction {
    let c = vec3_dot(wi, n);
    let front = c >= 0.0;
    let e = select(eta, 1.0 / eta, front);
    // 1 - e^2, relative accuracy kept near eta = 1.
    let step = (eta - 1.0) * (eta + 1.0);
    let rest = select(-step, step * (e * e), front);
    let ec = e * abs(c);
    let square = rest + ec * ec;
    if square < 0.0 {
        let k = 2.0 * c;
        return Refraction(vec3f(k * n.x - wi.x, k * n.y - wi.y, k * n.z - wi.z), 0.0, 1u);
    }
    let t = sqrt(square);
    // t - ec as a quotient, which does not cancel.
    let gain = rest / max(t + ec, REFRACT_TINY);
    let along = select(gain, -gain, front);
    return Refraction(
        vec3f(
            along * n.x - e * wi.x,
            along * n.y - e * wi.y,
            along * n.z - e * wi.z,
        ),
        t,
        0u,
    );
}
