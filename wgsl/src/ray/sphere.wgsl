// Ray against sphere. Needs math/vector, ray/ray.

// Where a ray meets a sphere.
struct SphereHit {
    // 1 if the ray meets the surface within its range, else 0.
    hit: u32,
    // The first crossing within the range; 0 on a miss.
    t: f32,
    // Where the line enters and leaves; 0 on a miss.
    t_near: f32,
    t_far: f32,
}

// Ray against the surface of a sphere, radius >= 0. The discriminant is taken
// from the perpendicular from the centre to the line, and the root that would
// cancel is the other one's conjugate.
fn sphere_intersect(ray: Ray, center: vec3f, radius: f32) -> SphereHit {
    let oc = center - ray.origin;
    let a = vec3_dot(ray.direction, ray.direction);
    let closest = vec3_dot(oc, ray.direction) / a;
    let perp = vec3f(
        oc.x - ray.direction.x * closest,
        oc.y - ray.direction.y * closest,
        oc.z - ray.direction.z * closest,
    );
    let discriminant = radius * radius - vec3_dot(perp, perp);
    if discriminant < 0.0 {
        return SphereHit(0u, 0.0, 0.0, 0.0);
    }
    let reach = sqrt(discriminant / a);
    let distance = sqrt(vec3_dot(oc, oc));
    let c = ((distance - radius) * (distance + radius)) / a;
    let outer = select(closest + reach, closest - reach, closest < 0.0);
    let zero = outer == 0.0;
    let inner = select(c / select(outer, 1.0, zero), 0.0, zero);
    let t_near = select(outer, inner, inner < outer);
    let t_far = select(inner, outer, inner < outer);
    let near_inside = t_near >= ray.t_min && t_near <= ray.t_max;
    let far_inside = t_far >= ray.t_min && t_far <= ray.t_max;
    if near_inside || far_inside {
        return SphereHit(1u, select(t_far, t_near, near_inside), t_near, t_far);
    }
    return SphereHit(0u, 0.0, 0.0, 0.0);
}
