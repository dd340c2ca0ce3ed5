// Ray against axis-aligned box. Needs ray/ray.

// The far plane moves out by this factor: more than the rounding of both
// planes and of the shear in the triangle test together.
const AABB_WIDEN: f32 = 1.0 + 3.8146973e-6;

// Where a ray is inside a box.
struct AabbHit {
    // 1 if the ray touches the box within its range, else 0.
    hit: u32,
    // Where it enters and leaves, within the ray's range; 0 on a miss.
    t_near: f32,
    t_far: f32,
}

// The interval of a slab parallel to the ray: everything or nothing.
fn aabb_parallel(lower: f32, upper: f32, direction: f32, through: vec2f) -> vec2f {
    let inside = lower <= 0.0 && upper >= 0.0;
    let far = select(-RAY_FAR, RAY_FAR, inside);
    return select(through, vec2f(-far, far), direction == 0.0);
}

// The interval (near, far) of t in which the ray's line is inside a box, given
// the box's corners minus the ray's origin. The line meets the box where
// near <= far * AABB_WIDEN + slack. Every step is monotone in the corners,
// also after rounding; traversal relies on that.
fn aabb_slab_local(lower: vec3f, upper: vec3f, shear: RayShear) -> vec2f {
    let ax = lower.x * shear.inverse.x;
    let ay = lower.y * shear.inverse.y;
    let az = lower.z * shear.inverse.z;
    let bx = upper.x * shear.inverse.x;
    let by = upper.y * shear.inverse.y;
    let bz = upper.z * shear.inverse.z;
    var x = vec2f(min(ax, bx), max(ax, bx));
    var y = vec2f(min(ay, by), max(ay, by));
    var z = vec2f(min(az, bz), max(az, bz));
    if shear.parallel != 0u {
        x = aabb_parallel(lower.x, upper.x, shear.direction.x, x);
        y = aabb_parallel(lower.y, upper.y, shear.direction.y, y);
        z = aabb_parallel(lower.z, upper.z, shear.direction.z, z);
    }
    return vec2f(max(max(x.x, y.x), z.x), min(min(x.y, y.y), z.y));
}

// aabb_slab_local for a box given by its corners.
fn aabb_slab(box_min: vec3f, box_max: vec3f, shear: RayShear) -> vec2f {
    return aabb_slab_local(box_min - shear.origin, box_max - shear.origin, shear);
}

// Ray against a box; the box and the ray's range include their ends. Never
// misses a box that the exact line touches within the range; may report a box
// that the line passes by less than 2^-18 of the distance.
fn aabb_intersect(ray: Ray, box_min: vec3f, box_max: vec3f) -> AabbHit {
    let shear = ray_shear(ray);
    let slab = aabb_slab(box_min, box_max, shear);
    let far = slab.y * AABB_WIDEN + shear.slack;
    let t_near = max(slab.x, ray.t_min);
    let t_far = min(far, ray.t_max);
    if t_near <= t_far {
        return AabbHit(1u, t_near, t_far);
    }
    return AabbHit(0u, 0.0, 0.0);
}
