// Closest-hit and any-hit traversal of a binary bounding volume hierarchy.
// Needs ray/triangle and what that needs.
//
// The tree is read through two functions that the shader defines, or takes
// from ray/bvh.bindings:
//     fn bvh_read_node(index: u32) -> BvhNode
//     fn bvh_read_triangle(index: u32) -> BvhTriangle
//
// Traversal finds what a loop over all triangles with
// triangle_intersect_watertight finds, whatever the tree: a triangle's hit is
// only accepted inside the interval of its own box, every node's box contains
// that box, and the slab test is monotone. Among hits at one t the lowest
// primitive index wins.

// Postponed nodes that a traversal can hold; a tree may be one level deeper.
const BVH_STACK: u32 = 64u;

// A traversal that has visited this many nodes and triangles ends with what it
// has: only a broken tree, or a ray that meets millions of boxes, gets there.
const BVH_STEPS: u32 = 4194304u;

// BvhHit.primitive of a miss.
const BVH_MISS: u32 = 0xffffffffu;

// A node: 32 bytes.
struct BvhNode {
    min: vec3f,
    // Inner node: index of the first child, the second follows it; a child
    // comes after its parent. Leaf: index of the first triangle.
    first: u32,
    max: vec3f,
    // Number of triangles; 0 for an inner node.
    count: u32,
}

// A triangle in leaf order.
struct BvhTriangle {
    a: vec3f,
    b: vec3f,
    c: vec3f,
    // Its index in the mesh.
    primitive: u32,
}

// The closest hit.
struct BvhHit {
    // The ray's parameter at the hit; on a miss the ray's t_max.
    t: f32,
    // Barycentric weights of the second and the third vertex.
    u: f32,
    v: f32,
    // The triangle's index in the mesh, or BVH_MISS.
    primitive: u32,
}

// Where the ray enters a node's box, or a negative number if it does not touch
// it between t_min and t_max.
fn bvh_enter(node: BvhNode, shear: RayShear, t_min: f32, t_max: f32) -> f32 {
    let slab = aabb_slab(node.min, node.max, shear);
    let near = max(slab.x, t_min);
    let far = slab.y * AABB_WIDEN + shear.slack;
    return select(-1.0, near, near <= far && near <= t_max);
}

// Tests a leaf's triangles and returns the best hit.
fn bvh_leaf(
    node: BvhNode,
    shear: RayShear,
    t_min: f32,
    any_hit: bool,
    before: BvhHit,
) -> BvhHit {
    var best = before;
    let size = min(node.count, BVH_STEPS);
    for (var i = 0u; i < size; i += 1u) {
        let triangle = bvh_read_triangle(node.first + i);
        let hit = triangle_intersect_sheared(
            shear,
            t_min,
            best.t,
            triangle.a,
            triangle.b,
            triangle.c,
        );
        if hit.hit != 0u && (hit.t < best.t || triangle.primitive < best.primitive) {
            best = BvhHit(hit.t, hit.u, hit.v, triangle.primitive);
            if any_hit {
                break;
            }
        }
    }
    return best;
}

// What a walk has found, and what it has visited.
struct BvhWalk {
    hit: BvhHit,
    steps: u32,
}

// The shared walk from a root on, after so many steps: with any_hit it ends at
// the first hit.
fn bvh_walk(root_index: u32, ray: Ray, any_hit: bool, steps_before: u32) -> BvhWalk {
    var best = BvhHit(ray.t_max, 0.0, 0.0, BVH_MISS);
    let shear = ray_shear(ray);
    let root = bvh_read_node(root_index);
    if bvh_enter(root, shear, ray.t_min, best.t) < 0.0 {
        return BvhWalk(best, steps_before);
    }
    if root.count > 0u {
        best = bvh_leaf(root, shear, ray.t_min, any_hit, best);
        return BvhWalk(best, steps_before + min(root.count, BVH_STEPS));
    }
    var stack_node: array<u32, BVH_STACK>;
    var stack_enter: array<f32, BVH_STACK>;
    var depth = 0u;
    var pair = root.first;
    var steps = steps_before;
    // A pair of siblings is never at 0: that is a root.
    while pair != 0u && steps < BVH_STEPS {
        var near = bvh_read_node(pair);
        var far = bvh_read_node(pair + 1u);
        var near_enter = bvh_enter(near, shear, ray.t_min, best.t);
        var far_enter = bvh_enter(far, shear, ray.t_min, best.t);
        // The nearer first; one that is missed counts as the farther.
        if far_enter >= 0.0 && (near_enter < 0.0 || far_enter < near_enter) {
            let node = near;
            let enter = near_enter;
            near = far;
            near_enter = far_enter;
            far = node;
            far_enter = enter;
        }
        steps += 1u;
        var next = 0u;
        var postponed = 0u;
        if near_enter >= 0.0 {
            if near.count > 0u {
                best = bvh_leaf(near, shear, ray.t_min, any_hit, best);
                steps += min(near.count, BVH_STEPS);
            } else if near.first > pair {
                next = near.first;
            }
        }
        if far_enter >= 0.0 && far_enter <= best.t {
            if far.count > 0u {
                best = bvh_leaf(far, shear, ray.t_min, any_hit, best);
                steps += min(far.count, BVH_STEPS);
            } else if far.first > pair {
                postponed = far.first;
            }
        }
        if any_hit && best.primitive != BVH_MISS {
            return BvhWalk(best, steps);
        }
        if next == 0u {
            next = postponed;
        } else if postponed != 0u && depth < BVH_STACK {
            stack_node[depth] = postponed;
            stack_enter[depth] = far_enter;
            depth += 1u;
        }
        while next == 0u && depth > 0u {
            depth -= 1u;
            if stack_enter[depth] <= best.t {
                next = stack_node[depth];
            }
        }
        pair = next;
    }
    return BvhWalk(best, steps);
}

// The closest triangle that a ray meets within its range, ends included. A
// broken tree (indices outside, cycles, too deep) gives some answer, in
// bounded time.
fn bvh_closest(ray: Ray) -> BvhHit {
    return bvh_walk(0u, ray, false, 0u).hit;
}

// 1 if the ray meets any triangle within its range, ends included, else 0. The
// same answer as whether bvh_closest finds one.
fn bvh_any(ray: Ray) -> u32 {
    return select(0u, 1u, bvh_walk(0u, ray, true, 0u).hit.primitive != BVH_MISS);
}
