//! Placed meshes over trees of eight children a node:
//! [`ray/instance`](crate::ray::instance) with vector instructions, with the
//! same hits, bit for bit.

use super::{Bvh8, Bvh8Fault, Filter, Level, check_nodes};
use crate::ray::bvh::{BVH_MISS, BvhNode, BvhView};
use crate::ray::instance::{Instance, InstanceHit, InstanceView, instance_walk};
use crate::ray::ray::Ray;

/// Instances of wide trees. The tree of instances itself is a binary one: it
/// is small, and most of a ray's time goes by in the meshes.
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
    #[must_use]
    pub fn closest(&self, ray: &Ray, mask: u32) -> InstanceHit {
        self.walk::<false>(ray, mask)
    }

    /// Whether the ray meets any triangle of an instance in the mask.
    #[must_use]
    pub fn any(&self, ray: &Ray, mask: u32) -> bool {
        self.walk::<true>(ray, mask).primitive != BVH_MISS
    }
}
