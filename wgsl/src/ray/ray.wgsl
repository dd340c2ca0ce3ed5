// The ray and what is computed once for each ray.

// Direction components smaller than this count as zero.
const RAY_FLUSH: f32 = 8.271806e-25;

// A stand-in for infinity that arithmetic may touch.
const RAY_FAR: f32 = 8.507059e37;

// Largest rounding-independent shift of a slab, in units of 1 / direction:
// four times the smallest normal number.
const RAY_SLACK: f32 = 4.7019774e-38;

// Points origin + direction * t with t_min <= t <= t_max. Coordinates up to
// 2^39, the largest direction component between 2^-40 and 2^40,
// 0 <= t_min <= t_max, all finite.
struct Ray {
    origin: vec3f,
    // Any length but zero.
    direction: vec3f,
    // Both ends are accepted.
    t_min: f32,
    t_max: f32,
}

// What the box and triangle tests need of a ray, computed once by ray_shear.
struct RayShear {
    origin: vec3f,
    // Components below RAY_FLUSH set to zero.
    direction: vec3f,
    // Reciprocal of each component of direction; 0 where that is zero.
    inverse: vec3f,
    // The two other components of the direction over the largest one, in
    // cyclic order.
    shear: vec2f,
    // Index of the direction's largest component.
    axis: u32,
    // 1 if some component of direction is zero.
    parallel: u32,
    // Added to the far end of every slab interval: more than what flushing
    // subnormal numbers can take away.
    slack: f32,
}

// The point of the ray at parameter t.
fn ray_at(ray: Ray, t: f32) -> vec3f {
    return vec3f(
        ray.origin.x + ray.direction.x * t,
        ray.origin.y + ray.direction.y * t,
        ray.origin.z + ray.direction.z * t,
    );
}

// A direction component, or 0 where it is too small to divide by.
fn ray_flush(component: f32) -> f32 {
    return select(component, 0.0, abs(component) < RAY_FLUSH);
}

// 1 / component, or 0 for 0.
fn ray_inverse(component: f32) -> f32 {
    let zero = component == 0.0;
    return select(1.0 / select(component, 1.0, zero), 0.0, zero);
}

// The components (axis + 1, axis + 2, axis) of a vector, modulo three.
fn ray_rotate(v: vec3f, axis: u32) -> vec3f {
    return select(select(v, v.zxy, axis == 1u), v.yzx, axis == 0u);
}

// Prepares a ray for aabb_slab and triangle_intersect_sheared. Tiny direction
// components become zero here, once, so that the box test and the triangle
// test see the same ray.
fn ray_shear(ray: Ray) -> RayShear {
    let direction = vec3f(
        ray_flush(ray.direction.x),
        ray_flush(ray.direction.y),
        ray_flush(ray.direction.z),
    );
    let inverse = vec3f(
        ray_inverse(direction.x),
        ray_inverse(direction.y),
        ray_inverse(direction.z),
    );
    let x = abs(direction.x);
    let y = abs(direction.y);
    let z = abs(direction.z);
    let axis = select(select(0u, 1u, y >= x), 2u, z >= x && z >= y);
    let rotated = ray_rotate(direction, axis);
    let largest = select(rotated.z, 1.0, rotated.z == 0.0);
    let parallel = x == 0.0 || y == 0.0 || z == 0.0;
    let steepest = max(max(max(1.0, abs(inverse.x)), abs(inverse.y)), abs(inverse.z));
    return RayShear(
        ray.origin,
        direction,
        inverse,
        vec2f(rotated.x / largest, rotated.y / largest),
        axis,
        select(0u, 1u, parallel),
        RAY_SLACK * steepest,
    );
}
