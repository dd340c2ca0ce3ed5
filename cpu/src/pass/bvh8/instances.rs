//! Placed meshes over trees of eight children a node:
//! [`ray/instance`](crate::ray::instance) with vector instructions, with the
//! same hits, bit for bit.

use super::{Bvh8, Bvh8Fault, Filter, Level, check_nodes};
use crate::ray::bvh::{BVH_MISS, BvhNode, BvhView};
use crate::ray::instance::{Instance, InstanceHit, InstanceView, instance_walk};
use crate::ray::ray::Ray;

/// Instances of wide trees. The tree of instances itself is a binary one: it
/// is small, and most of a ray's time goes by in the meshes.
///
/// ```
/// use glam::{Vec3, Vec4};
/// use raytwin_cpu::pass::bvh8::instances::Instances8;
/// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
/// use raytwin_cpu::ray::instance::Instance;
/// use raytwin_cpu::ray::ray::Ray;
///
/// let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
/// let (min, max) = triangle_box(a, b, c);
/// let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
/// let nodes = [BvhNode { min, first: 0, max, count: 1 }];
/// let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
/// let top = BvhNode {
///     min: Vec3::splat(-0.1),
///     first: 0,
///     max: Vec3::splat(1.1),
///     count: 1,
/// };
/// let place = Instance {
///     x: Vec4::X,
///     y: Vec4::Y,
///     z: Vec4::Z,
///     root: 0,
///     mesh: 0,
///     mask: 1,
///     index: 3,
/// };
/// let scene = Instances8::new(&[top], &[place], vec![tree])?;
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// assert_eq!(scene.closest(&ray, u32::MAX).instance, 3);
/// # Ok::<(), Bvh8Fault>(())
/// ```
#[derive(Clone, Debug)]
pub struct Instances8 {
    nodes: Vec<BvhNode>,
    instances: Vec<Instance>,
    meshes: Vec<Bvh8>,
}

impl Instances8 {
    /// A tree of instances, its root first, the instances in leaf order, and
    /// their meshes.
    ///
    /// ```
    /// use glam::{Vec3, Vec4};
    /// use raytwin_cpu::pass::bvh8::instances::Instances8;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::instance::Instance;
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// let (min, max) = triangle_box(a, b, c);
    /// let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let top = BvhNode {
    ///     min: Vec3::splat(-0.1),
    ///     first: 0,
    ///     max: Vec3::splat(1.1),
    ///     count: 1,
    /// };
    /// let place = Instance {
    ///     x: Vec4::X,
    ///     y: Vec4::Y,
    ///     z: Vec4::Z,
    ///     root: 0,
    ///     mesh: 0,
    ///     mask: 1,
    ///     index: 3,
    /// };
    /// let scene = Instances8::new(&[top], &[place], vec![tree])?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// // Mesh 7 is not there.
    /// let fault = Instances8::new(&[top], &[Instance { mesh: 7, ..place }], vec![]);
    /// assert_eq!(fault.unwrap_err(), Bvh8Fault::Instance { instance: 0 });
    /// assert!(scene.any(&ray, 1));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    ///
    /// # Errors
    /// The first fault found in the tree of instances;
    /// [`Bvh8Fault::Instance`] for one of no mesh.
    pub fn new(
        nodes: &[BvhNode],
        instances: &[Instance],
        meshes: Vec<Bvh8>,
    ) -> Result<Self, Bvh8Fault> {
        let mut out = Self {
            nodes: Vec::new(),
            instances: Vec::new(),
            meshes,
        };
        out.replace(nodes, instances)?;
        Ok(out)
    }

    /// Another tree of instances over the same meshes.
    ///
    /// ```
    /// use glam::{Vec3, Vec4};
    /// use raytwin_cpu::pass::bvh8::instances::Instances8;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::instance::Instance;
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// # let top = BvhNode {
    /// #     min: Vec3::splat(-0.1),
    /// #     first: 0,
    /// #     max: Vec3::splat(1.1),
    /// #     count: 1,
    /// # };
    /// # let place = Instance {
    /// #     x: Vec4::X,
    /// #     y: Vec4::Y,
    /// #     z: Vec4::Z,
    /// #     root: 0,
    /// #     mesh: 0,
    /// #     mask: 1,
    /// #     index: 3,
    /// # };
    /// # let mut scene = Instances8::new(&[top], &[place], vec![tree])?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// // The same mesh, 5 farther along x.
    /// let moved = Instance { x: Vec4::new(1.0, 0.0, 0.0, -5.0), ..place };
    /// let top = BvhNode {
    ///     min: Vec3::new(4.9, -0.1, -0.1),
    ///     max: Vec3::new(6.1, 1.1, 0.1),
    ///     ..top
    /// };
    /// scene.replace(&[top], &[moved])?;
    /// assert!(!scene.any(&ray, 1));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    ///
    /// # Errors
    /// As [`Self::new`]. Then nothing is changed.
    pub fn replace(&mut self, nodes: &[BvhNode], instances: &[Instance]) -> Result<(), Bvh8Fault> {
        check_nodes(nodes, instances.len())?;
        let lost = |i: &Instance| i.mesh as usize >= self.meshes.len();
        if let Some(position) = instances.iter().position(lost) {
            return Err(Bvh8Fault::Instance {
                instance: position as u32,
            });
        }
        self.nodes.clear();
        self.nodes.extend_from_slice(nodes);
        self.instances.clear();
        self.instances.extend_from_slice(instances);
        Ok(())
    }

    /// The same scene, walked with other instructions.
    ///
    /// ```
    /// use glam::{Vec3, Vec4};
    /// use raytwin_cpu::pass::bvh8::instances::Instances8;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Level, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::instance::Instance;
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// # let top = BvhNode {
    /// #     min: Vec3::splat(-0.1),
    /// #     first: 0,
    /// #     max: Vec3::splat(1.1),
    /// #     count: 1,
    /// # };
    /// # let place = Instance {
    /// #     x: Vec4::X,
    /// #     y: Vec4::Y,
    /// #     z: Vec4::Z,
    /// #     root: 0,
    /// #     mesh: 0,
    /// #     mask: 1,
    /// #     index: 3,
    /// # };
    /// # let scene = Instances8::new(&[top], &[place], vec![tree])?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let hit = scene.closest(&ray, 1);
    /// let portable = scene.with_level(Level::all()[0]);
    /// assert_eq!(portable.closest(&ray, 1), hit);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn with_level(mut self, level: Level) -> Self {
        for mesh in &mut self.meshes {
            mesh.level = level;
        }
        self
    }

    #[inline(always)]
    fn walk<const ANY: bool>(&self, ray: &Ray, mask: u32) -> InstanceHit {
        let view = InstanceView {
            bvh: BvhView {
                nodes: &self.nodes,
                triangles: &[],
            },
            top: 0,
            instances: &self.instances,
        };
        instance_walk(&view, *ray, mask, ANY, |instance, local, _| {
            // `replace` has checked the index.
            self.meshes[instance.mesh as usize].walk::<ANY>(&local, Filter::ALL)
        })
    }

    /// The closest triangle of any instance in the mask:
    /// [`instance_closest`](crate::ray::instance::instance_closest), every bit
    /// of it.
    ///
    /// ```
    /// use glam::{Vec3, Vec4};
    /// use raytwin_cpu::pass::bvh8::instances::Instances8;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::instance::Instance;
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// # let top = BvhNode {
    /// #     min: Vec3::splat(-0.1),
    /// #     first: 0,
    /// #     max: Vec3::splat(1.1),
    /// #     count: 1,
    /// # };
    /// # let place = Instance {
    /// #     x: Vec4::X,
    /// #     y: Vec4::Y,
    /// #     z: Vec4::Z,
    /// #     root: 0,
    /// #     mesh: 0,
    /// #     mask: 1,
    /// #     index: 3,
    /// # };
    /// # let scene = Instances8::new(&[top], &[place], vec![tree])?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let hit = scene.closest(&ray, u32::MAX);
    /// assert_eq!((hit.instance, hit.primitive, hit.t), (3, 0, 2.0));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn closest(&self, ray: &Ray, mask: u32) -> InstanceHit {
        self.walk::<false>(ray, mask)
    }

    /// Whether the ray meets any triangle of an instance in the mask.
    ///
    /// ```
    /// use glam::{Vec3, Vec4};
    /// use raytwin_cpu::pass::bvh8::instances::Instances8;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::instance::Instance;
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// # let top = BvhNode {
    /// #     min: Vec3::splat(-0.1),
    /// #     first: 0,
    /// #     max: Vec3::splat(1.1),
    /// #     count: 1,
    /// # };
    /// # let place = Instance {
    /// #     x: Vec4::X,
    /// #     y: Vec4::Y,
    /// #     z: Vec4::Z,
    /// #     root: 0,
    /// #     mesh: 0,
    /// #     mask: 1,
    /// #     index: 3,
    /// # };
    /// # let scene = Instances8::new(&[top], &[place], vec![tree])?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// assert!(scene.any(&ray, 1));
    /// // The instance is not there for rays without its bit.
    /// assert!(!scene.any(&ray, 2));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn any(&self, ray: &Ray, mask: u32) -> bool {
        self.walk::<true>(ray, mask).primitive != BVH_MISS
    }
}
