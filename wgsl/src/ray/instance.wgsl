// Meshes placed many times: the walk over a tree of instances, each of which
// maps the ray into its mesh's space and walks the mesh's tree there.
// Needs ray/bvh and what that needs, with its callbacks.
//
// The map takes points of the scene to points of the mesh, by rows. A ray's
// direction is not made a unit vector again, so t means the same in both
// spaces, and hits of different instances compare as they are.
//
// The tree of instances lies in the same list as those of the meshes; its
// leaves count instances, which are read through a function that the shader
// defines, or takes from ray/instance.bindings:
//     fn instance_read(index: u32) -> Instance

// A mesh in its place: 64 bytes.
struct Instance {
    // Rows of the map from the scene to the mesh; the translation last.
    x: vec4f,
    y: vec4f,
    z: vec4f,
    // The root of the mesh's tree in the list of nodes.
    root: u32,
    // Index of the mesh.
    mesh: u32,
    // The instance is there for a ray whose mask shares a bit with this.
    mask: u32,
    // The instance's index in the scene.
    index: u32,
}

// The closest hit of all instances.
struct InstanceHit {
    // The ray's parameter at the hit; on a miss the ray's t_max.
    t: f32,
    // Barycentric weights of the second and the third vertex.
    u: f32,
    v: f32,
    // The triangle's index in its mesh, or BVH_MISS.
    primitive: u32,
    // The instance's index in the scene, or BVH_MISS.
    instance: u32,
}

// A point of the scene in the mesh's space.
fn instance_point(x: vec4f, y: vec4f, z: vec4f, p: vec3f) -> vec3f {
    return vec3f(
        ((x.x * p.x + x.y * p.y) + x.z * p.z) + x.w,
        ((y.x * p.x + y.y * p.y) + y.z * p.z) + y.w,
        ((z.x * p.x + z.y * p.y) + z.z * p.z) + z.w,
    );
}

// A direction of the scene in the mesh's space: the same without the
// translation.
fn instance_vector(x: vec4f, y: vec4f, z: vec4f, v: vec3f) -> vec3f {
    return vec3f(
        (x.x * v.x + x.y * v.y) + x.z * v.z,
        (y.x * v.x + y.y * v.y) + y.z * v.z,
        (z.x * v.x + z.y * v.y) + z.z * v.z,
    );
}

// A normal of the mesh in the scene, as a unit vector: the transposed map. It
// stays on the side that it has on the mesh, also where the map mirrors. The
// product must have a length between 1e-18 and 1e18.
fn instance_normal(x: vec4f, y: vec4f, z: vec4f, n: vec3f) -> vec3f {
    return vec3_normalize(vec3f(
        (x.x * n.x + y.x * n.y) + z.x * n.z,
        (x.y * n.x + y.y * n.y) + z.y * n.z,
        (x.z * n.x + y.z * n.y) + z.z * n.z,
    ));
}

// The shared walk: with any_hit it ends at the first hit.
fn instance_walk(top: u32, ray: Ray, mask: u32, any_hit: bool) -> InstanceHit {
    var best = InstanceHit(ray.t_max, 0.0, 0.0, BVH_MISS, BVH_MISS);
    let shear = ray_shear(ray);
    var stack_node: array<u32, BVH_STACK>;
    var stack_enter: array<f32, BVH_STACK>;
    var depth = 0u;
    var steps = 0u;
    var node = top;
    loop {
        let item = bvh_read_node(node);
        let entered = bvh_enter(item, shear, ray.t_min, best.t) >= 0.0;
        steps += 1u;
        var next = 0u;
        if entered && item.count > 0u {
            let size = min(item.count, BVH_STEPS);
            for (var i = 0u; i < size; i += 1u) {
                let instance = instance_read(item.first + i);
                steps += 1u;
                if (instance.mask & mask) != 0u {
                    let local = Ray(
                        instance_point(instance.x, instance.y, instance.z, ray.origin),
                        instance_vector(instance.x, instance.y, instance.z, ray.direction),
                        ray.t_min,
                        best.t,
                    );
                    let walk = bvh_walk(instance.root, local, any_hit, steps);
                    let hit = walk.hit;
                    steps = walk.steps;
                    if hit.primitive != BVH_MISS
                        && (hit.t < best.t || instance.index < best.instance) {
                        best = InstanceHit(hit.t, hit.u, hit.v, hit.primitive, instance.index);
                        if any_hit {
                            return best;
                        }
                    }
                }
                if steps >= BVH_STEPS {
                    return best;
                }
            }
        } else if entered && item.first > node {
            let left = bvh_read_node(item.first);
            let right = bvh_read_node(item.first + 1u);
            let left_enter = bvh_enter(left, shear, ray.t_min, best.t);
            let right_enter = bvh_enter(right, shear, ray.t_min, best.t);
            let swap = right_enter >= 0.0 && (left_enter < 0.0 || right_enter < left_enter);
            let near_enter = select(left_enter, right_enter, swap);
            let far_enter = select(right_enter, left_enter, swap);
            if near_enter >= 0.0 {
                next = item.first + select(0u, 1u, swap);
            }
            if far_enter >= 0.0 && depth < BVH_STACK {
                stack_node[depth] = item.first + select(1u, 0u, swap);
                stack_enter[depth] = far_enter;
                depth += 1u;
            }
        }
        while next == 0u && depth > 0u {
            depth -= 1u;
            if stack_enter[depth] <= best.t {
                next = stack_node[depth];
            }
        }
        if next == 0u || steps >= BVH_STEPS {
            break;
        }
        node = next;
    }
    return best;
}

// The closest triangle of any instance in the mask that a ray meets within its
// range, ends included; top is the root of the tree of instances. At one t the
// lowest instance wins, then the lowest triangle. A broken tree gives some
// answer, in bounded time.
fn instance_closest(top: u32, ray: Ray, mask: u32) -> InstanceHit {
    return instance_walk(top, ray, mask, false);
}

// 1 if the ray meets any triangle of an instance in the mask within its range,
// ends included, else 0: whether instance_closest finds one.
fn instance_any(top: u32, ray: Ray, mask: u32) -> u32 {
    return select(0u, 1u, instance_walk(top, ray, mask, true).primitive != BVH_MISS);
}
