// Three-component products in one fixed order. The built-ins `dot`, `cross`
// and `normalize` may be evaluated in any order, so a twin that must give the
// CPU's bits spells the order out.

// Dot product, summed as (x*x + y*y) + z*z.
fn vec3_dot(a: vec3f, b: vec3f) -> f32 {
    return (a.x * b.x + a.y * b.y) + a.z * b.z;
}

// Cross product, each component a difference of two products.
fn vec3_cross(a: vec3f, b: vec3f) -> vec3f {
    return vec3f(
        a.y * b.z - a.z * b.y,
        a.z * b.x - a.x * b.z,
        a.x * b.y - a.y * b.x,
    );
}

// Euclidean length. Overflows above about 1.8e19 and underflows below 1e-19.
fn vec3_length(a: vec3f) -> f32 {
    return sqrt(vec3_dot(a, a));
}

// Unit vector in the direction of a, each component divided by the length.
// a must have a length between 1e-18 and 1e18.
fn vec3_normalize(a: vec3f) -> vec3f {
    let len = vec3_length(a);
    return vec3f(a.x / len, a.y / len, a.z / len);
}
