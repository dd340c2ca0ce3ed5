// The traversal of ray/bvh for rays that can hit only some of the triangles:
// those seen from the front, those whose mask shares a bit.
// Needs ray/bvh and what that needs, with its callbacks.
//
// Masks are read through a function that the shader defines, or takes from
// ray/bvh_filter.bindings:
//     fn bvh_read_mask(primitive: u32) -> u32
//
// The result is that of a loop over the triangles left. The side is told from
// the edge functions that let the ray through, so the two triangles of an edge
// agree about it.

// Both sides of a triangle can be hit.
const BVH_FACES_BOTH: u32 = 0u;

// Only triangles whose normal (b - a) x (c - a) is against the ray can be hit,
// so that their vertices are seen counter-clockwise.
const BVH_FACES_FRONT: u32 = 1u;

// Whether the ray, which meets the triangle, sees it from the front. The edges
// that let the ray through all have one sign: that of a triangle seen along
// the axis of the shear, where counter-clockwise is seen from ahead.
fn bvh_filter_front(triangle: BvhTriangle, shear: RayShear) -> bool {
    let la = triangle.a - shear.origin;
    let lb = triangle.b - shear.origin;
    let lc = triangle.c - shear.origin;
    let edges = triangle_edges(shear, la, lb, lc);
    let below = edges.x < 0.0 || edges.y < 0.0 || edges.z < 0.0;
    let along = ray_rotate(shear.direction, shear.axis).z;
    return below == (along > 0.0);
}

// Whether a triangle that the ray meets is there for it.
fn bvh_filter_sees(triangle: BvhTriangle, shear: RayShear, faces: u32, mask: u32) -> bool {
    if (bvh_read_mask(triangle.primitive) & mask) == 0u {
        return false;
    }
    return faces != BVH_FACES_FRONT || bvh_filter_front(triangle, shear);
}

// bvh_leaf for some of the triangles.
fn bvh_filter_leaf(
    node: BvhNode,
    shear: RayShear,
    t_min: f32,
    any_hit: bool,
    faces: u32,
    mask: u32,
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
        if hit.hit != 0u
            && (hit.t < best.t || triangle.primitive < best.primitive)
            && bvh_filter_sees(triangle, shear, faces, mask) {
            best = BvhHit(hit.t, hit.u, hit.v, triangle.primitive);
            if any_hit {
                break;
            }
        }
    }
    return best;
}

// bvh_walk for some of the triangles: the same but for the leaves. (There are no
// functions as arguments in WGSL, and a mask is read through a callback that
// programs without masks do not have. A test holds the two texts together.)
fn bvh_filter_walk(
    root_index: u32,
    ray: Ray,
    any_hit: bool,
    faces: u32,
    mask: u32,
    steps_before: u32,
) -> BvhWalk {
    var best = BvhHit(ray.t_max, 0.0, 0.0, BVH_MISS);
    let shear = ray_shear(ray);
    let root = bvh_read_node(root_index);
    if bvh_enter(root, shear, ray.t_min, best.t) < 0.0 {
        return BvhWalk(best, steps_before);
    }
    if root.count > 0u {
        best = bvh_filter_leaf(root, shear, ray.t_min, any_hit, faces, mask, best);
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
                best = bvh_filter_leaf(near, shear, ray.t_min, any_hit, faces, mask, best);
                steps += min(near.count, BVH_STEPS);
            } else if near.first > pair {
                next = near.first;
            }
        }
        if far_enter >= 0.0 && far_enter <= best.t {
            if far.count > 0u {
                best = bvh_filter_leaf(far, shear, ray.t_min, any_hit, faces, mask, best);
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

// The closest triangle that a ray meets within its range, ends included, of
// those that faces (BVH_FACES_BOTH or BVH_FACES_FRONT) and mask leave: a
// triangle is there for the ray if its mask shares a bit with mask. As
// bvh_closest otherwise.
fn bvh_closest_of(ray: Ray, faces: u32, mask: u32) -> BvhHit {
    return bvh_filter_walk(0u, ray, false, faces, mask, 0u).hit;
}

// 1 if the ray meets any triangle that faces and mask leave within its range,
// ends included, else 0: whether bvh_closest_of finds one.
fn bvh_any_of(ray: Ray, faces: u32, mask: u32) -> u32 {
    let hit = bvh_filter_walk(0u, ray, true, faces, mask, 0u).hit;
    return select(0u, 1u, hit.primitive != BVH_MISS);
}
