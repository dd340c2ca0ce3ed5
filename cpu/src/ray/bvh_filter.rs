//! The traversal of [`bvh`](super::bvh) for rays that can hit only some of the
//! triangles: those seen from the front, those whose mask shares a bit.
//!
//! The result is that of a loop over the triangles left, bit for bit. The side
//! is told from the edge functions that let the ray through, so the two
//! triangles of an edge agree about it, and no product can round it away.

use super::bvh::{BVH_MISS, BvhHit, BvhTriangle, BvhView, bvh_walk};
use super::ray::{Ray, RayShear, ray_rotate};
use super::triangle::triangle_edges;

/// Both sides of a triangle can be hit.
pub const BVH_FACES_BOTH: u32 = 0;

/// Only triangles whose normal `(b - a) × (c - a)` is against the ray can be
/// hit, so that their vertices are seen counter-clockwise.
pub const BVH_FACES_FRONT: u32 = 1;

/// Whether the ray, which meets the triangle, sees it from the front.
///
/// The edges that let the ray through all have one sign: that of a triangle seen
/// along the axis of the shear, where counter-clockwise is seen from ahead.
#[inline(always)]
fn bvh_filter_front(triangle: &BvhTriangle, shear: &RayShear) -> bool {
    let la = triangle.a - shear.origin;
    let lb = triangle.b - shear.origin;
    let lc = triangle.c - shear.origin;
    let edges = triangle_edges(shear, la, lb, lc);
    let below = edges.x < 0.0 || edges.y < 0.0 || edges.z < 0.0;
    let along = ray_rotate(shear.direction, shear.axis).z;
    below == (along > 0.0)
}

/// Whether a triangle that the ray meets is there for it.
#[inline(always)]
fn bvh_filter_sees(
    masks: &[u32],
    triangle: &BvhTriangle,
    shear: &RayShear,
    faces: u32,
    mask: u32,
) -> bool {
    // A triangle beyond the end has all bits.
    let own = masks.get(triangle.primitive as usize);
    let shared = own.copied().unwrap_or(u32::MAX) & mask;
    shared != 0 && (faces != BVH_FACES_FRONT || bvh_filter_front(triangle, shear))
}

/// The closest triangle that a ray meets within its range, ends included, of
/// those that `faces` ([`BVH_FACES_BOTH`] or [`BVH_FACES_FRONT`]) and `mask` leave.
///
/// `masks` has a mask for each triangle of the mesh, by
/// [`BvhTriangle::primitive`]; a triangle is there for the ray if its mask shares
/// a bit with `mask`. One beyond the end of `masks` has all bits, so an empty
/// slice is a mesh without masks, and a `mask` of 0 hits nothing.
///
/// As [`bvh_closest`](super::bvh::bvh_closest) otherwise.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::{BVH_MISS, BvhNode, BvhTriangle, BvhView};
/// use raytwin_cpu::ray::bvh_filter::{BVH_FACES_FRONT, bvh_closest_of};
/// use raytwin_cpu::ray::ray::Ray;
///
/// // Two squares' halves, one behind the other; the nearer one looks away.
/// let near = BvhTriangle { a: Vec3::Z, b: Vec3::Y + Vec3::Z, c: Vec3::X + Vec3::Z, primitive: 0 };
/// let far = BvhTriangle { a: Vec3::ZERO, b: Vec3::X, c: Vec3::Y, primitive: 1 };
/// let root = BvhNode { min: Vec3::ZERO, first: 0, max: Vec3::ONE, count: 2 };
/// let tree = BvhView { nodes: &[root], triangles: &[near, far] };
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.25, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let front = bvh_closest_of(&tree, &[], ray, BVH_FACES_FRONT, u32::MAX);
/// assert_eq!((front.primitive, front.t), (1, 2.0));
/// // The far one has bit 2 alone.
/// let masked = bvh_closest_of(&tree, &[1, 2], ray, BVH_FACES_FRONT, 1);
/// assert_eq!(masked.primitive, BVH_MISS);
/// ```
#[must_use]
pub fn bvh_closest_of(bvh: &BvhView<'_>, masks: &[u32], ray: Ray, faces: u32, mask: u32) -> BvhHit {
    bvh_walk(bvh, 0, ray, false, &mut 0, |triangle, shear| {
        bvh_filter_sees(masks, triangle, shear, faces, mask)
    })
}

/// 1 if the ray meets any triangle that `faces` and `mask` leave within its
/// range, ends included, else 0: whether [`bvh_closest_of`] finds one.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
/// use raytwin_cpu::ray::bvh_filter::{BVH_FACES_BOTH, bvh_any_of};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let triangle =
///     BvhTriangle { a: Vec3::ZERO, b: Vec3::X, c: Vec3::Y, primitive: 0 };
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
/// // Glass, say, has bit 2 and casts no shadow: shadow rays ask for bit 1.
/// let masks = [2];
/// assert_eq!(bvh_any_of(&tree, &masks, ray, BVH_FACES_BOTH, 1), 0);
/// assert_eq!(bvh_any_of(&tree, &masks, ray, BVH_FACES_BOTH, 3), 1);
/// ```
#[must_use]
pub fn bvh_any_of(bvh: &BvhView<'_>, masks: &[u32], ray: Ray, faces: u32, mask: u32) -> u32 {
    let hit = bvh_walk(bvh, 0, ray, true, &mut 0, |triangle, shear| {
        bvh_filter_sees(masks, triangle, shear, faces, mask)
    });
    u32::from(hit.primitive != BVH_MISS)
}
