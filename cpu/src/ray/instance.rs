//! Meshes placed many times: the walk over a tree of instances, each of which
//! maps the ray into its mesh's space and walks the mesh's tree there.
//!
//! The map takes points of the scene to points of the mesh, by rows. A ray's
//! direction is not made a unit vector again, so `t` means the same in both
//! spaces, and hits of different instances compare as they are.
//!
//! The walk finds what a loop over all instances finds, bit for bit, as long
//! as the boxes of the tree of instances contain every point that a mapped ray
//! can accept: `raytwin::ray::instance_build` pads them for that.

use glam::{Vec3, Vec4};

use super::bvh::{
    BVH_MISS, BVH_STACK, BVH_STEPS, BvhHit, BvhView, bvh_enter, bvh_node, bvh_prepare,
    bvh_sees_all, bvh_walk,
};
use super::ray::Ray;
use crate::math::vector::vec3_normalize;

/// A mesh in its place: 64 bytes.
///
/// ```
/// use glam::{Vec3, Vec4};
/// use raytwin_cpu::ray::instance::{Instance, instance_point};
///
/// // A mesh moved by 5 along x: the map from the scene to it moves back.
/// let moved = Instance {
///     x: Vec4::new(1.0, 0.0, 0.0, -5.0),
///     y: Vec4::Y,
///     z: Vec4::Z,
///     root: 0,
///     mesh: 0,
///     mask: 1,
///     index: 0,
/// };
/// let p = instance_point(moved.x, moved.y, moved.z, Vec3::new(5.0, 1.0, 2.0));
/// assert_eq!(p, Vec3::new(0.0, 1.0, 2.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Instance {
    /// First row of the map from the scene to the mesh; the translation last.
    pub x: Vec4,
    /// Second row.
    pub y: Vec4,
    /// Third row.
    pub z: Vec4,
    /// The root of the mesh's tree in the list of nodes.
    pub root: u32,
    /// Index of the mesh.
    pub mesh: u32,
    /// The instance is there for a ray whose mask shares a bit with this.
    pub mask: u32,
    /// The instance's index in the scene.
    pub index: u32,
}

/// Instances, a tree over them, and the trees of their meshes.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::BvhView;
/// use raytwin_cpu::ray::instance::{InstanceView, instance_any};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let bvh = BvhView { nodes: &[], triangles: &[] };
/// let empty = InstanceView { bvh, top: 0, instances: &[] };
/// let ray =
///     Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_min: 0.0, t_max: 9.0 };
/// assert_eq!(instance_any(&empty, ray, u32::MAX), 0);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct InstanceView<'a> {
    /// The nodes of all meshes and those of the tree of instances; the
    /// triangles of all meshes. Indices count from the start of these lists.
    pub bvh: BvhView<'a>,
    /// The root of the tree of instances. Its leaves count instances.
    pub top: u32,
    /// All instances, in leaf order.
    pub instances: &'a [Instance],
}

/// The closest hit of all instances.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::bvh::{BVH_MISS, BvhView};
/// use raytwin_cpu::ray::instance::{InstanceView, instance_closest};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let bvh = BvhView { nodes: &[], triangles: &[] };
/// let empty = InstanceView { bvh, top: 0, instances: &[] };
/// let ray =
///     Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_min: 0.0, t_max: 9.0 };
/// let hit = instance_closest(&empty, ray, u32::MAX);
/// assert_eq!((hit.instance, hit.t), (BVH_MISS, ray.t_max));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct InstanceHit {
    /// The ray's parameter at the hit; on a miss the ray's `t_max`.
    pub t: f32,
    /// Barycentric weight of the second vertex.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
    /// The triangle's index in its mesh, or [`BVH_MISS`].
    pub primitive: u32,
    /// The instance's index in the scene, or [`BVH_MISS`].
    pub instance: u32,
}

/// A point of the scene in the mesh's space: each component
/// `((m_x p_x + m_y p_y) + m_z p_z) + m_w`.
///
/// Each errs by at most `4u` of the sum of the terms' sizes, `u = 2^-24`.
///
/// ```
/// use glam::{Vec3, Vec4};
/// use raytwin_cpu::ray::instance::instance_point;
///
/// // Half as large and moved: rows of the map, the translation last.
/// let (x, y, z) = (Vec4::new(0.5, 0.0, 0.0, 1.0), 0.5 * Vec4::Y, 0.5 * Vec4::Z);
/// assert_eq!(
///     instance_point(x, y, z, Vec3::splat(2.0)),
///     Vec3::new(2.0, 1.0, 1.0)
/// );
/// ```
#[inline]
#[must_use]
pub fn instance_point(x: Vec4, y: Vec4, z: Vec4, p: Vec3) -> Vec3 {
    Vec3::new(
        ((x.x * p.x + x.y * p.y) + x.z * p.z) + x.w,
        ((y.x * p.x + y.y * p.y) + y.z * p.z) + y.w,
        ((z.x * p.x + z.y * p.y) + z.z * p.z) + z.w,
    )
}

/// A direction of the scene in the mesh's space: the same without the
/// translation. Each component errs by at most `3u` of its terms' sizes.
///
/// ```
/// use glam::{Vec3, Vec4};
/// use raytwin_cpu::ray::instance::instance_vector;
///
/// // A direction has no place: the translation does not count.
/// let (x, y, z) = (Vec4::new(0.5, 0.0, 0.0, 1.0), 0.5 * Vec4::Y, 0.5 * Vec4::Z);
/// assert_eq!(instance_vector(x, y, z, Vec3::splat(2.0)), Vec3::ONE);
/// ```
#[inline]
#[must_use]
pub fn instance_vector(x: Vec4, y: Vec4, z: Vec4, v: Vec3) -> Vec3 {
    Vec3::new(
        (x.x * v.x + x.y * v.y) + x.z * v.z,
        (y.x * v.x + y.y * v.y) + y.z * v.z,
        (z.x * v.x + z.y * v.y) + z.z * v.z,
    )
}

/// A normal of the mesh in the scene, as a unit vector: the transposed map.
///
/// It stays on the side that it has on the mesh, also where the map mirrors.
/// The product must have a length between 1e-18 and 1e18.
///
/// ```
/// use glam::{Vec3, Vec4};
/// use raytwin_cpu::ray::instance::instance_normal;
///
/// // The mesh is stretched along x, so its slopes get less steep.
/// let (x, y, z) = (0.5 * Vec4::X, Vec4::Y, Vec4::Z);
/// let n = instance_normal(x, y, z, Vec3::new(1.0, 1.0, 0.0).normalize());
/// assert!((n - Vec3::new(0.5, 1.0, 0.0).normalize()).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn instance_normal(x: Vec4, y: Vec4, z: Vec4, n: Vec3) -> Vec3 {
    vec3_normalize(Vec3::new(
        (x.x * n.x + y.x * n.y) + z.x * n.z,
        (x.y * n.x + y.y * n.y) + z.y * n.z,
        (x.z * n.x + y.z * n.y) + z.z * n.z,
    ))
}

/// The shared walk. `inner` asks one mesh and counts its steps.
#[inline(always)]
pub(crate) fn instance_walk(
    view: &InstanceView<'_>,
    ray: Ray,
    mask: u32,
    any: bool,
    inner: impl Fn(&Instance, Ray, &mut u32) -> BvhHit,
) -> InstanceHit {
    let mut best = InstanceHit {
        t: ray.t_max,
        u: 0.0,
        v: 0.0,
        primitive: BVH_MISS,
        instance: BVH_MISS,
    };
    let at = bvh_prepare(ray);
    let mut stack = [(0u32, 0.0f32); BVH_STACK];
    let mut depth = 0usize;
    let mut steps = 0u32;
    let mut node = view.top;
    loop {
        let this = bvh_node(&view.bvh, node);
        let entered = bvh_enter(this, &at, best.t) >= 0.0;
        steps = steps.saturating_add(1);
        let mut next = 0;
        if entered && this.count > 0 {
            let size = this.count.min(BVH_STEPS);
            for i in 0..size {
                let at = this.first.wrapping_add(i) as usize;
                let Some(instance) = view.instances.get(at) else {
                    break;
                };
                steps = steps.saturating_add(1);
                if instance.mask & mask == 0 {
                    continue;
                }
                let local = Ray {
                    origin: instance_point(instance.x, instance.y, instance.z, ray.origin),
                    direction: instance_vector(instance.x, instance.y, instance.z, ray.direction),
                    t_min: ray.t_min,
                    t_max: best.t,
                };
                let hit = inner(instance, local, &mut steps);
                if hit.primitive != BVH_MISS && (hit.t < best.t || instance.index < best.instance) {
                    best = InstanceHit {
                        t: hit.t,
                        u: hit.u,
                        v: hit.v,
                        primitive: hit.primitive,
                        instance: instance.index,
                    };
                    if any {
                        return best;
                    }
                }
                if steps >= BVH_STEPS {
                    return best;
                }
            }
        } else if entered && this.first > node {
            let left = bvh_node(&view.bvh, this.first);
            let right = bvh_node(&view.bvh, this.first.wrapping_add(1));
            let left_enter = bvh_enter(left, &at, best.t);
            let right_enter = bvh_enter(right, &at, best.t);
            let swap = right_enter >= 0.0 && (left_enter < 0.0 || right_enter < left_enter);
            let near = this.first.wrapping_add(u32::from(swap));
            let far = this.first.wrapping_add(u32::from(!swap));
            let near_enter = if swap { right_enter } else { left_enter };
            let far_enter = if swap { left_enter } else { right_enter };
            if near_enter >= 0.0 {
                next = near;
            }
            if far_enter >= 0.0 && depth < BVH_STACK {
                stack[depth] = (far, far_enter);
                depth += 1;
            }
        }
        while next == 0 && depth > 0 {
            depth -= 1;
            let (postponed, enter) = stack[depth];
            if enter <= best.t {
                next = postponed;
            }
        }
        if next == 0 || steps >= BVH_STEPS {
            break;
        }
        node = next;
    }
    best
}

#[inline(always)]
fn instance_ask(view: &InstanceView<'_>, ray: Ray, mask: u32, any: bool) -> InstanceHit {
    instance_walk(view, ray, mask, any, |instance, local, steps| {
        bvh_walk(&view.bvh, instance.root, local, any, steps, bvh_sees_all)
    })
}

/// The closest triangle of any instance in the mask that a ray meets within
/// its range, ends included. At one `t` the lowest instance wins, then the
/// lowest triangle.
///
/// A broken tree gives some answer, in bounded time.
///
/// ```
/// use glam::{Vec3, Vec4};
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
/// use raytwin_cpu::ray::instance::{Instance, InstanceView, instance_closest};
/// use raytwin_cpu::ray::ray::Ray;
///
/// // A triangle, placed once, 5 along x. Node 0 is its tree, node 1 the scene's.
/// let triangles =
///     [BvhTriangle { a: Vec3::ZERO, b: Vec3::X, c: Vec3::Y, primitive: 17 }];
/// let mesh = BvhNode {
///     min: Vec3::ZERO,
///     first: 0,
///     max: Vec3::new(1.0, 1.0, 0.0),
///     count: 1,
/// };
/// let scene = BvhNode {
///     min: Vec3::new(4.9, -0.1, -0.1),
///     first: 0,
///     max: Vec3::new(6.1, 1.1, 0.1),
///     count: 1,
/// };
/// let nodes = [mesh, scene];
/// let moved = Instance {
///     x: Vec4::new(1.0, 0.0, 0.0, -5.0),
///     y: Vec4::Y,
///     z: Vec4::Z,
///     root: 0,
///     mesh: 0,
///     mask: 1,
///     index: 3,
/// };
/// let view = InstanceView {
///     bvh: BvhView { nodes: &nodes, triangles: &triangles },
///     top: 1,
///     instances: &[moved],
/// };
/// let ray = Ray {
///     origin: Vec3::new(5.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let hit = instance_closest(&view, ray, u32::MAX);
/// assert_eq!((hit.instance, hit.primitive, hit.t), (3, 17, 2.0));
/// ```
#[must_use]
pub fn instance_closest(view: &InstanceView<'_>, ray: Ray, mask: u32) -> InstanceHit {
    instance_ask(view, ray, mask, false)
}

/// 1 if the ray meets any triangle of an instance in the mask within its
/// range, ends included, else 0: whether [`instance_closest`] finds one.
///
/// ```
/// use glam::{Vec3, Vec4};
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
/// use raytwin_cpu::ray::instance::{Instance, InstanceView, instance_any};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let triangles =
///     [BvhTriangle { a: Vec3::ZERO, b: Vec3::X, c: Vec3::Y, primitive: 17 }];
/// let node = BvhNode {
///     min: Vec3::splat(-0.1),
///     first: 0,
///     max: Vec3::splat(1.1),
///     count: 1,
/// };
/// let nodes = [node, node];
/// // Where it is modelled, and only for rays with bit 2.
/// let place = Instance {
///     x: Vec4::X,
///     y: Vec4::Y,
///     z: Vec4::Z,
///     root: 0,
///     mesh: 0,
///     mask: 4,
///     index: 0,
/// };
/// let view = InstanceView {
///     bvh: BvhView { nodes: &nodes, triangles: &triangles },
///     top: 1,
///     instances: &[place],
/// };
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// assert_eq!(instance_any(&view, ray, 4), 1);
/// assert_eq!(instance_any(&view, ray, 2), 0);
/// ```
#[must_use]
pub fn instance_any(view: &InstanceView<'_>, ray: Ray, mask: u32) -> u32 {
    u32::from(instance_ask(view, ray, mask, true).primitive != BVH_MISS)
}
