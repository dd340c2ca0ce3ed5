//! Closest-hit and any-hit traversal of a binary bounding volume hierarchy.
//!
//! Traversal finds what a loop over all triangles with
//! [`triangle_intersect_watertight`](super::triangle::triangle_intersect_watertight)
//! finds, bit for bit, whatever the tree: a triangle's hit is only accepted
//! inside the interval of its own box, every node's box contains that box, and
//! the slab test is monotone, so no node is passed over that holds an accepted
//! hit. Among hits at one `t` the lowest primitive index wins.

use glam::{Vec2, Vec3, Vec3A, Vec3Swizzles};

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
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::BvhNode;
///
/// // A leaf with two triangles, the first of them number 6.
/// let leaf = BvhNode { min: Vec3::ZERO, first: 6, max: Vec3::ONE, count: 2 };
/// assert!(leaf.count > 0);
/// assert_eq!(std::mem::size_of_val(&leaf), 32);
/// ```
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
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::BvhTriangle;
///
/// let triangle =
///     BvhTriangle { a: Vec3::ZERO, b: Vec3::X, c: Vec3::Y, primitive: 17 };
/// assert_eq!(std::mem::size_of_val(&triangle), 40);
/// ```
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
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::{BvhView, bvh_any};
/// use raytwin_cpu::ray::ray::Ray;
///
/// // Without nodes there is nothing to hit.
/// let empty = BvhView { nodes: &[], triangles: &[] };
/// let ray =
///     Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_min: 0.0, t_max: 9.0 };
/// assert_eq!(bvh_any(&empty, ray), 0);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct BvhView<'a> {
    /// All nodes.
    pub nodes: &'a [BvhNode],
    /// All triangles, in leaf order.
    pub triangles: &'a [BvhTriangle],
}

/// The closest hit.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::{BVH_MISS, BvhView, bvh_closest};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let empty = BvhView { nodes: &[], triangles: &[] };
/// let ray =
///     Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_min: 0.0, t_max: 9.0 };
/// let hit = bvh_closest(&empty, ray);
/// assert_eq!((hit.primitive, hit.t), (BVH_MISS, ray.t_max));
/// ```
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
pub(crate) fn bvh_node<'a>(bvh: &BvhView<'a>, index: u32) -> &'a BvhNode {
    bvh.nodes.get(index as usize).unwrap_or(&NOWHERE)
}

/// What the walk keeps at hand of a prepared ray, in registers of four.
#[derive(Clone, Copy)]
pub(crate) struct BvhRay {
    shear: RayShear,
    origin: Vec3A,
    inverse: Vec3A,
    t_min: f32,
}

/// The slab of a ray with a zero in its direction: kept out of the hot loop.
#[cold]
#[inline(never)]
fn bvh_slab_parallel(node: &BvhNode, ray: &BvhRay) -> Vec2 {
    aabb_slab(node.min, node.max, &ray.shear)
}

/// Where the ray enters a node's box, or a negative number if it does not
/// touch it between `t_min` and `t_max`.
///
/// [`aabb_slab`] with three axes at a time: the same operations.
#[inline(always)]
pub(crate) fn bvh_enter(node: &BvhNode, ray: &BvhRay, t_max: f32) -> f32 {
    let slab = if ray.shear.parallel != 0 {
        bvh_slab_parallel(node, ray)
    } else {
        let a = (Vec3A::from(node.min) - ray.origin) * ray.inverse;
        let b = (Vec3A::from(node.max) - ray.origin) * ray.inverse;
        Vec2::new(a.min(b).max_element(), a.max(b).min_element())
    };
    let near = aabb_max(slab.x, ray.t_min);
    let far = slab.y * AABB_WIDEN + ray.shear.slack;
    if near <= far && near <= t_max {
        near
    } else {
        -1.0
    }
}

/// Whether the edges of a triangle let the ray through: the first half of
/// [`triangle_intersect_sheared`] for three vertices at a time.
///
/// The order of an edge's ends and the test for equal products, which guard
/// the twin against fused operations, change no bit here: Rust does not fuse,
/// and a difference of two rounded products has the sign of their comparison.
#[inline(always)]
fn bvh_edges_pass(triangle: &BvhTriangle, ray: &BvhRay) -> bool {
    let BvhTriangle { a, b, c, .. } = triangle;
    let x = Vec3A::new(a.x, b.x, c.x) - Vec3A::splat(ray.shear.origin.x);
    let y = Vec3A::new(a.y, b.y, c.y) - Vec3A::splat(ray.shear.origin.y);
    let z = Vec3A::new(a.z, b.z, c.z) - Vec3A::splat(ray.shear.origin.z);
    let (u, v, w) = match ray.shear.axis {
        0 => (y, z, x),
        1 => (z, x, y),
        _ => (x, y, z),
    };
    let u = u - w * ray.shear.shear.x;
    let v = v - w * ray.shear.shear.y;
    let p = u.yzx() * v.zxy();
    let q = v.yzx() * u.zxy();
    p.cmplt(q).any() != p.cmpgt(q).any()
}

/// Which triangles a ray can hit: all of them. (Walks take such a function;
/// `ray/bvh_filter` has another.)
#[inline(always)]
pub(crate) fn bvh_sees_all(_: &BvhTriangle, _: &RayShear) -> bool {
    true
}

/// Takes a triangle as the best hit if it is one that the ray can hit: once or
/// twice a ray, so it stays out of the hot loop.
#[inline(never)]
fn bvh_accept(
    triangle: &BvhTriangle,
    ray: &BvhRay,
    best: &mut BvhHit,
    sees: impl Fn(&BvhTriangle, &RayShear) -> bool,
) -> bool {
    let hit = triangle_intersect_sheared(
        &ray.shear, ray.t_min, best.t, triangle.a, triangle.b, triangle.c,
    );
    let better = hit.hit != 0
        && (hit.t < best.t || triangle.primitive < best.primitive)
        && sees(triangle, &ray.shear);
    if better {
        *best = BvhHit {
            t: hit.t,
            u: hit.u,
            v: hit.v,
            primitive: triangle.primitive,
        };
    }
    better
}

/// Tests a leaf's triangles and returns their number.
#[inline(always)]
fn bvh_leaf(
    bvh: &BvhView<'_>,
    node: &BvhNode,
    ray: &BvhRay,
    any: bool,
    best: &mut BvhHit,
    sees: impl Fn(&BvhTriangle, &RayShear) -> bool + Copy,
) -> u32 {
    let first = node.first as usize;
    let size = node.count.min(BVH_STEPS);
    let leaf = first
        .checked_add(size as usize)
        .and_then(|end| bvh.triangles.get(first..end))
        .unwrap_or(&[]);
    for triangle in leaf {
        if !bvh_edges_pass(triangle, ray) {
            continue;
        }
        if bvh_accept(triangle, ray, best, sees) && any {
            break;
        }
    }
    size
}

#[inline(always)]
pub(crate) fn bvh_prepare(ray: Ray) -> BvhRay {
    let shear = ray_shear(ray);
    BvhRay {
        shear,
        origin: shear.origin.into(),
        inverse: shear.inverse.into(),
        t_min: ray.t_min,
    }
}

/// The shared walk from a root on: with `any` it ends at the first hit. It
/// adds what it visits to `steps`, and passes by triangles that `sees` denies.
#[inline(always)]
pub(crate) fn bvh_walk(
    bvh: &BvhView<'_>,
    root: u32,
    ray: Ray,
    any: bool,
    steps: &mut u32,
    sees: impl Fn(&BvhTriangle, &RayShear) -> bool + Copy,
) -> BvhHit {
    let mut best = BvhHit {
        t: ray.t_max,
        u: 0.0,
        v: 0.0,
        primitive: BVH_MISS,
    };
    let at = bvh_prepare(ray);
    let root = bvh_node(bvh, root);
    if bvh_enter(root, &at, best.t) < 0.0 {
        return best;
    }
    if root.count > 0 {
        *steps = steps.saturating_add(bvh_leaf(bvh, root, &at, any, &mut best, sees));
        return best;
    }
    let mut stack = [(0u32, 0.0f32); BVH_STACK];
    let mut depth = 0usize;
    let mut pair = root.first;
    // A pair of siblings is never at 0: that is a root.
    while pair != 0 && *steps < BVH_STEPS {
        let left = bvh_node(bvh, pair);
        let right = bvh_node(bvh, pair.wrapping_add(1));
        let left_enter = bvh_enter(left, &at, best.t);
        let right_enter = bvh_enter(right, &at, best.t);
        // The nearer first; one that is missed counts as the farther.
        let swap = right_enter >= 0.0 && (left_enter < 0.0 || right_enter < left_enter);
        let (near, near_enter) = if swap {
            (right, right_enter)
        } else {
            (left, left_enter)
        };
        let (far, far_enter) = if swap {
            (left, left_enter)
        } else {
            (right, right_enter)
        };
        *steps += 1;
        let mut next = 0;
        let mut postponed = 0;
        if near_enter >= 0.0 {
            if near.count > 0 {
                *steps = steps.saturating_add(bvh_leaf(bvh, near, &at, any, &mut best, sees));
            } else if near.first > pair {
                next = near.first;
            }
        }
        if far_enter >= 0.0 && far_enter <= best.t {
            if far.count > 0 {
                *steps = steps.saturating_add(bvh_leaf(bvh, far, &at, any, &mut best, sees));
            } else if far.first > pair {
                postponed = far.first;
            }
        }
        if any && best.primitive != BVH_MISS {
            return best;
        }
        if next == 0 {
            next = postponed;
        } else if postponed != 0 && depth < BVH_STACK {
            stack[depth] = (postponed, far_enter);
            depth += 1;
        }
        while next == 0 && depth > 0 {
            depth -= 1;
            let (node, enter) = stack[depth];
            if enter <= best.t {
                next = node;
            }
        }
        pair = next;
    }
    best
}

/// The closest triangle that a ray meets within its range, ends included.
///
/// See the module's documentation for what is guaranteed. A broken tree
/// (indices outside, cycles, too deep) gives some answer, in bounded time.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView, bvh_closest};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let triangle =
///     BvhTriangle { a: Vec3::ZERO, b: Vec3::X, c: Vec3::Y, primitive: 17 };
/// let root = BvhNode {
///     min: Vec3::ZERO,
///     first: 0,
///     max: Vec3::new(1.0, 1.0, 0.0),
///     count: 1,
/// };
/// let tree = BvhView { nodes: &[root], triangles: &[triangle] };
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let hit = bvh_closest(&tree, ray);
/// assert_eq!((hit.primitive, hit.t, hit.u, hit.v), (17, 2.0, 0.25, 0.5));
/// ```
#[must_use]
pub fn bvh_closest(bvh: &BvhView<'_>, ray: Ray) -> BvhHit {
    bvh_walk(bvh, 0, ray, false, &mut 0, bvh_sees_all)
}

/// 1 if the ray meets any triangle within its range, ends included, else 0.
///
/// The same answer as whether [`bvh_closest`] finds one.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView, bvh_any};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let triangle =
///     BvhTriangle { a: Vec3::ZERO, b: Vec3::X, c: Vec3::Y, primitive: 17 };
/// let root = BvhNode {
///     min: Vec3::ZERO,
///     first: 0,
///     max: Vec3::new(1.0, 1.0, 0.0),
///     count: 1,
/// };
/// let tree = BvhView { nodes: &[root], triangles: &[triangle] };
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// assert_eq!(bvh_any(&tree, ray), 1);
/// // A light at distance 1 is not hidden by it.
/// assert_eq!(bvh_any(&tree, Ray { t_max: 1.0, ..ray }), 0);
/// ```
#[must_use]
pub fn bvh_any(bvh: &BvhView<'_>, ray: Ray) -> u32 {
    u32::from(bvh_walk(bvh, 0, ray, true, &mut 0, bvh_sees_all).primitive != BVH_MISS)
}
