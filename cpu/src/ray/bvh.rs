//! Closest-hit and any-hit traversal of a binary bounding volume hierarchy.
//!
//! Traversal finds what a loop over all triangles with
//! [`triangle_intersect_watertight`](super::triangle::triangle_intersect_watertight)
//! finds, bit for bit, whatever the tree: a triangle's hit is only accepted
//! inside the interval of its own box, every node's box contains that box, and
//! the slab test is monotone, so no node is passed over that holds an accepted
//! hit. Among hits at one `t` the lowest primitive index wins.

use glam::Vec3;

use super::aabb::{AABB_WIDEN, aabb_max, aabb_slab};
use super::ray::{Ray, RayShear, ray_shear};
use super::triangle::triangle_intersect_sheared;

/// Postponed nodes that a traversal can hold; a tree may be one level deeper.
pub const BVH_STACK: usize = 64;

/// A traversal that has visited this many nodes and triangles, 2^22, ends
/// with what it has: only a broken tree, or a ray that meets millions of
/// boxes, gets there.
pub const BVH_STEPS: u32 = 1 << 22;

/// [`BvhHit::primitive`] of a miss.
pub const BVH_MISS: u32 = 0xffff_ffff;

/// A node: 32 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct BvhNode {
    /// Lower corner of the box.
    pub min: Vec3,
    /// Inner node: index of the first child, the second follows it; a child
    /// comes after its parent. Leaf: index of the first triangle.
    pub first: u32,
    /// Upper corner of the box.
    pub max: Vec3,
    /// Number of triangles; 0 for an inner node.
    pub count: u32,
}

/// A triangle in leaf order: 40 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct BvhTriangle {
    /// First vertex.
    pub a: Vec3,
    /// Second vertex.
    pub b: Vec3,
    /// Third vertex.
    pub c: Vec3,
    /// Its index in the mesh.
    pub primitive: u32,
}

/// A tree to traverse. The root is node 0; no nodes, no hits.
#[derive(Clone, Copy, Debug)]
pub struct BvhView<'a> {
    /// All nodes.
    pub nodes: &'a [BvhNode],
    /// All triangles, in leaf order.
    pub triangles: &'a [BvhTriangle],
}

/// The closest hit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct BvhHit {
    /// The ray's parameter at the hit; on a miss the ray's `t_max`.
    pub t: f32,
    /// Barycentric weight of the second vertex.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
    /// The triangle's index in the mesh, or [`BVH_MISS`].
    pub primitive: u32,
}

/// What reads outside the tree give: an inner node without children.
const NOWHERE: BvhNode = BvhNode {
    min: Vec3::ZERO,
    first: 0,
    max: Vec3::ZERO,
    count: 0,
};

#[inline(always)]
fn bvh_node<'a>(bvh: &BvhView<'a>, index: u32) -> &'a BvhNode {
    bvh.nodes.get(index as usize).unwrap_or(&NOWHERE)
}

/// Where the ray enters a node's box, or a negative number if it does not
/// touch it between `t_min` and `t_max`.
#[inline(always)]
fn bvh_enter(node: &BvhNode, shear: &RayShear, t_min: f32, t_max: f32) -> f32 {
    let slab = aabb_slab(node.min, node.max, shear);
    let near = aabb_max(slab.x, t_min);
    let far = slab.y * AABB_WIDEN + shear.slack;
    if near <= far && near <= t_max { near } else { -1.0 }
}

/// The shared walk: with `any` it ends at the first hit.
#[inline(always)]
fn bvh_walk(bvh: &BvhView<'_>, ray: Ray, any: bool) -> BvhHit {
    let mut best = BvhHit {
        t: ray.t_max,
        u: 0.0,
        v: 0.0,
        primitive: BVH_MISS,
    };
    let shear = ray_shear(ray);
    let mut stack_node = [0u32; BVH_STACK];
    let mut stack_near = [0.0f32; BVH_STACK];
    let mut depth = 0usize;
    let mut index = 0u32;
    let mut steps = 0u32;
    let root = bvh_node(bvh, 0);
    if bvh_enter(root, &shear, ray.t_min, best.t) < 0.0 {
        return best;
    }
    let (mut first, mut count) = (root.first, root.count);
    loop {
        steps += 1;
        let mut down = false;
        if count > 0 {
            let end = first.saturating_add(count.min(BVH_STEPS));
            let leaf = bvh
                .triangles
                .get(first as usize..end as usize)
                .unwrap_or(&[]);
            for triangle in leaf {
                let hit = triangle_intersect_sheared(
                    &shear, ray.t_min, best.t, triangle.a, triangle.b, triangle.c,
                );
                if hit.hit != 0 && (hit.t < best.t || triangle.primitive < best.primitive) {
                    best = BvhHit {
                        t: hit.t,
                        u: hit.u,
                        v: hit.v,
                        primitive: triangle.primitive,
                    };
                    if any {
                        return best;
                    }
                }
            }
            steps = steps.saturating_add(count);
        } else if first > index {
            let left = bvh_node(bvh, first);
            let right = bvh_node(bvh, first.wrapping_add(1));
            let left_near = bvh_enter(left, &shear, ray.t_min, best.t);
            let right_near = bvh_enter(right, &shear, ray.t_min, best.t);
            let both = left_near >= 0.0 && right_near >= 0.0;
            let go_right = if both {
                right_near < left_near
            } else {
                right_near >= 0.0
            };
            down = left_near >= 0.0 || right_near >= 0.0;
            if both && depth < BVH_STACK {
                stack_node[depth] = if go_right {
                    first
                } else {
                    first.wrapping_add(1)
                };
                stack_near[depth] = if go_right { left_near } else { right_near };
                depth += 1;
            }
            if down {
                index = first.wrapping_add(u32::from(go_right));
                let next = if go_right { right } else { left };
                (first, count) = (next.first, next.count);
            }
        }
        if !down {
            loop {
                if depth == 0 {
                    return best;
                }
                depth -= 1;
                if stack_near[depth] <= best.t {
                    break;
                }
            }
            index = stack_node[depth];
            let next = bvh_node(bvh, index);
            (first, count) = (next.first, next.count);
        }
        if steps >= BVH_STEPS {
            return best;
        }
    }
}

/// The closest triangle that a ray meets within its range, ends included.
///
/// See the module's documentation for what is guaranteed. A broken tree
/// (indices outside, cycles, too deep) gives some answer, in bounded time.
#[must_use]
pub fn bvh_closest(bvh: &BvhView<'_>, ray: Ray) -> BvhHit {
    bvh_walk(bvh, ray, false)
}

/// 1 if the ray meets any triangle within its range, ends included, else 0.
///
/// The same answer as whether [`bvh_closest`] finds one.
#[must_use]
pub fn bvh_any(bvh: &BvhView<'_>, ray: Ray) -> u32 {
    u32::from(bvh_walk(bvh, ray, true).primitive != BVH_MISS)
}
