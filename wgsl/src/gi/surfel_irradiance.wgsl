// The light of surfels (Ray Tracing Gems, chapter 25): where their rays go,
// what a ray's light counts, what a hit sends back, how long a surfel stays.
// Radiance is light along a ray, irradiance what falls on a surface. A ray of
// density cos/pi makes one of the other with a factor pi alone.

const SURFEL_IRRADIANCE_PI: f32 = 3.1415927;
const SURFEL_IRRADIANCE_INV_PI: f32 = 0.31830987;
// Largest albedo that light bounces with: below 1, or light would grow forever.
const SURFEL_IRRADIANCE_ALBEDO: f32 = 0.96875;

// Where an object is: a rotation as its columns, and a shift.
struct SurfelIrradiancePose {
    x: vec3f,
    y: vec3f,
    z: vec3f,
    origin: vec3f,
}

// How many rays a surfel wants in a frame: most in its first (age 0), a half in
// its second, a third in its third, and 1 from most frames on.
fn surfel_irradiance_rays(age: u32, most: u32) -> u32 {
    if most == 0u {
        return 0u;
    }
    return max(most / (min(age, 0xfffffffeu) + 1u), 1u);
}

// How many of the rays that it wants a surfel gets under a budget, when those
// before it want before: all that are left.
fn surfel_irradiance_allowed(before: u32, wanted: u32, budget: u32) -> u32 {
    return min(wanted, budget - min(before, budget));
}

// Where a surfel's rays begin: off its middle along the normal.
fn surfel_irradiance_origin(surfel: Surfel) -> vec3f {
    let p = surfel.position;
    let n = surfel.normal;
    let far = max(max(abs(p.x), abs(p.y)), abs(p.z));
    let off = surfel.radius * 0.00390625 + far * 9.536743e-7;
    return vec3f(p.x + n.x * off, p.y + n.y * off, p.z + n.z * off);
}

// Direction of a surfel's ray: by the cosine about the unit normal, with random
// numbers that are a function of surfel, frame and ray alone.
fn surfel_irradiance_direction(normal: vec3f, surfel: u32, frame: u32, ray: u32) -> vec3f {
    let bits = pcg3d(vec3u(surfel, frame, ray));
    let u = vec2f(pcg_unit(bits.x), pcg_unit(bits.y));
    let local = hemisphere_cosine_sample(u);
    return basis_to_world(basis_from_normal(normal), normal, local);
}

// What may count as light: 0 for what is negative, not finite or too large, all
// of which lie above the largest usable number in bits.
fn surfel_irradiance_light(x: f32) -> f32 {
    if bitcast<u32>(x) > bitcast<u32>(SURFEL_LARGEST) {
        return 0.0;
    }
    return x;
}

fn surfel_irradiance_sample_channel(radiance: f32, rays: f32) -> f32 {
    let mean = surfel_irradiance_light(radiance) / rays;
    return min(mean * SURFEL_IRRADIANCE_PI, SURFEL_LARGEST);
}

// Irradiance by a frame's rays: pi times the mean of their radiance, of which
// radiance is the sum; 0 of none.
fn surfel_irradiance_sample(radiance: vec3f, rays: u32) -> vec3f {
    if rays == 0u {
        return vec3f(0.0, 0.0, 0.0);
    }
    let count = f32(rays);
    return vec3f(
        surfel_irradiance_sample_channel(radiance.x, count),
        surfel_irradiance_sample_channel(radiance.y, count),
        surfel_irradiance_sample_channel(radiance.z, count),
    );
}

fn surfel_irradiance_outgoing_channel(
    albedo: f32,
    emission: f32,
    direct: f32,
    gathered: f32,
) -> f32 {
    let part = min(surfel_irradiance_light(albedo), SURFEL_IRRADIANCE_ALBEDO)
        * SURFEL_IRRADIANCE_INV_PI;
    let falls = surfel_irradiance_light(direct) + surfel_irradiance_light(gathered);
    return min(surfel_irradiance_light(emission) + part * falls, SURFEL_LARGEST);
}

// Radiance that a diffuse surface sends towards everybody: emission (a
// radiance) + albedo/pi (direct + gathered), which are irradiances.
fn surfel_irradiance_outgoing(
    albedo: vec3f,
    emission: vec3f,
    direct: vec3f,
    gathered: vec3f,
) -> vec3f {
    return vec3f(
        surfel_irradiance_outgoing_channel(albedo.x, emission.x, direct.x, gathered.x),
        surfel_irradiance_outgoing_channel(albedo.y, emission.y, direct.y, gathered.y),
        surfel_irradiance_outgoing_channel(albedo.z, emission.z, direct.z, gathered.z),
    );
}

fn surfel_irradiance_into_pose(pose: SurfelIrradiancePose, v: vec3f) -> vec3f {
    return vec3f(vec3_dot(pose.x, v), vec3_dot(pose.y, v), vec3_dot(pose.z, v));
}

fn surfel_irradiance_out_of_pose(pose: SurfelIrradiancePose, v: vec3f) -> vec3f {
    return vec3f(
        (pose.x.x * v.x + pose.y.x * v.y) + pose.z.x * v.z,
        (pose.x.y * v.x + pose.y.y * v.y) + pose.z.y * v.z,
        (pose.x.z * v.x + pose.y.z * v.y) + pose.z.z * v.z,
    );
}

// A surfel of an object that moved from one pose to another: where it is on the
// object stays the same, and its normal keeps unit length.
fn surfel_irradiance_follow(
    surfel: Surfel,
    old: SurfelIrradiancePose,
    new_pose: SurfelIrradiancePose,
) -> Surfel {
    let p = surfel.position;
    let away = vec3f(
        p.x - old.origin.x,
        p.y - old.origin.y,
        p.z - old.origin.z,
    );
    let moved = surfel_irradiance_out_of_pose(new_pose, surfel_irradiance_into_pose(old, away));
    let turned = surfel_irradiance_into_pose(old, surfel.normal);
    let normal = surfel_irradiance_out_of_pose(new_pose, turned);
    return Surfel(
        vec3f(
            new_pose.origin.x + moved.x,
            new_pose.origin.y + moved.y,
            new_pose.origin.z + moved.z,
        ),
        surfel.radius,
        vec3_normalize(normal),
        surfel.mesh,
    );
}

// For how many frames a surfel may go unseen: patience (65535 at most) while a
// quarter of the pool is free, then less, and 0 when it is full.
fn surfel_irradiance_patience(used: u32, capacity: u32, patience: u32) -> u32 {
    let free = capacity - min(used, capacity);
    if free == 0u {
        return 0u;
    }
    // floor(1024 free/capacity), 1023 for a pool without surfels.
    var parts = 0u;
    var rest = free;
    for (var i = 0u; i < 10u; i++) {
        let more = capacity - rest;
        parts = parts * 2u;
        if rest >= more {
            rest = rest - more;
            parts = parts + 1u;
        } else {
            rest = rest + rest;
        }
    }
    return (min(patience, 65535u) * min(parts, 256u)) >> 8u;
}

// 1 if a surfel is to be given up: it is not sound, or has gone unseen for more
// than patience frames.
fn surfel_irradiance_recycle(surfel: Surfel, unseen: u32, patience: u32) -> u32 {
    return select(0u, 1u, surfel_sound(surfel) == 0u || unseen > patience);
}
