// Traversal over an array of rays, for the report's table of engines. After
// ray/bvh, its bindings, and the constant TRAVERSAL_WORKGROUP.

struct TraversalRay {
    origin: vec3f,
    t_min: f32,
    direction: vec3f,
    t_max: f32,
}

// Where a stack in the workgroup's memory has its part.
var<private> traversal_lane: u32;

@group(0) @binding(0) var<storage, read> traversal_rays: array<TraversalRay>;
// Two words a ray: the bits of t, and the primitive or BVH_MISS.
@group(0) @binding(1) var<storage, read_write> traversal_hits: array<vec2u>;

fn traversal_index(id: vec3u, groups: vec3u) -> u32 {
    return id.y * (groups.x * TRAVERSAL_WORKGROUP) + id.x;
}

fn traversal_ray(index: u32) -> Ray {
    let r = traversal_rays[index];
    return Ray(r.origin, r.direction, r.t_min, r.t_max);
}

@compute @workgroup_size(TRAVERSAL_WORKGROUP)
fn traversal_closest(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    traversal_lane = lane;
    let i = traversal_index(id, groups);
    if i >= arrayLength(&traversal_rays) {
        return;
    }
    let hit = bvh_closest(traversal_ray(i));
    traversal_hits[i] = vec2u(bitcast<u32>(hit.t), hit.primitive);
}

@compute @workgroup_size(TRAVERSAL_WORKGROUP)
fn traversal_any(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    traversal_lane = lane;
    let i = traversal_index(id, groups);
    if i >= arrayLength(&traversal_rays) {
        return;
    }
    traversal_hits[i] = vec2u(0u, bvh_any(traversal_ray(i)));
}
