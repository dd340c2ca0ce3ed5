// Ray against plane. Needs math/vector, ray/ray.

// Smallest denominator that the divisions of this group accept.
const PLANE_TINY: f32 = 7.523164e-37;

// Largest quotient that the divisions of this group give is below 2^100.
const PLANE_RATIO: f32 = 7.888609e-31;

// Where a ray meets a plane.
struct PlaneHit {
    // 1 if the ray meets the plane within its range, else 0.
    hit: u32,
    // The ray's parameter there; 0 on a miss.
    t: f32,
}

// Whether numerator / denominator is safe: the denominator is a normal number
// above 2^-120 and the quotient is below 2^100.
fn plane_divides(numerator: f32, denominator: f32) -> bool {
    let size = abs(denominator);
    return size > abs(numerator) * PLANE_RATIO && size > PLANE_TINY;
}

// Ray against the plane through a point with the given normal, of any length.
// A ray with |n.d| <= 2^-120 misses.
fn plane_intersect(ray: Ray, point: vec3f, normal: vec3f) -> PlaneHit {
    let numerator = vec3_dot(normal, point - ray.origin);
    let denominator = vec3_dot(normal, ray.direction);
    let divides = plane_divides(numerator, denominator);
    let t = numerator / select(1.0, denominator, divides);
    if divides && t >= ray.t_min && t <= ray.t_max {
        return PlaneHit(1u, t);
    }
    return PlaneHit(0u, 0.0);
}
