//! Scenes of placed meshes for [`raytwin_cpu::ray::instance`] and its WGSL
//! twin: the tree of instances, its refit and its checks.

use glam::{Affine3A, DMat3, DVec3, Mat3, Vec3, Vec4};
use obvhs::aabb::Aabb;
use raytwin_cpu::pass::bvh8::instances::Instances8;
use raytwin_cpu::pass::bvh8::{Bvh8Fault, check_nodes};
use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
use raytwin_cpu::ray::instance::{Instance, InstanceView};

use super::bvh_build::{BVH_COORDINATE_MAX, BuildQuality, Bvh, Shape, join};

/// How far the box of an instance grows, 2^-17, in units of the numbers that a
/// mapped ray is computed from: see [`instance_box`].
pub const INSTANCE_PAD: f64 = 1.0 / 131_072.0;

/// A mesh and where it is.
///
/// ```
/// use glam::{Affine3A, Vec3};
///
/// use raytwin::ray::instance_build::Placement;
///
/// let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
/// let place = Placement { to_scene, mesh: 0, mask: 1 };
/// // Five along x, for rays with bit 1.
/// assert_eq!(
///     place.to_scene.transform_point3(Vec3::X),
///     Vec3::new(6.0, 0.0, 0.0)
/// );
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// From the mesh to the scene.
    pub to_scene: Affine3A,
    /// Index of the mesh.
    pub mesh: u32,
    /// Rays whose mask shares no bit with this pass through.
    pub mask: u32,
}

/// Why a scene of instances cannot be built or moved.
///
/// ```
/// use glam::{Affine3A, Vec3};
///
/// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
/// use raytwin::ray::instance_build::{InstanceError, Instances, Placement};
///
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
/// // A map that flattens has no inverse; the error says whose it is.
/// let to_scene = Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0));
/// let place = Placement { to_scene, mesh: 0, mask: 1 };
/// let error = Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium);
/// assert_eq!(error.unwrap_err(), InstanceError::Map { instance: 0 });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InstanceError {
    /// A mesh that is not there.
    #[error("instance {instance} is of mesh {mesh}, but there are {meshes} meshes")]
    Mesh {
        /// The instance.
        instance: usize,
        /// Its mesh.
        mesh: u32,
        /// Number of meshes.
        meshes: usize,
    },
    /// A map that is not finite or that flattens.
    #[error(
        "instance {instance}: its map is not finite, has no inverse in single precision, or \
         reaches beyond {BVH_COORDINATE_MAX:e}: remove the instance or mend the map"
    )]
    Map {
        /// The instance.
        instance: usize,
    },
    /// A reach that is no distance.
    #[error("the reach is {reach}: give the largest coordinate of a ray's origin")]
    Reach {
        /// What was given.
        reach: f32,
    },
    /// Another number of instances, or another mesh, than was built.
    #[error("refit gets {given} instances for {built}, or other meshes: build anew")]
    Refit {
        /// Instances given.
        given: usize,
        /// Instances built.
        built: usize,
    },
    /// More nodes, triangles or instances than 2^31.
    #[error("the meshes together have more than 2^31 nodes or triangles: split the scene")]
    TooMany,
}

/// What [`Instances::validate`] finds wrong.
///
/// ```
/// use glam::{Affine3A, Vec3};
///
/// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
/// use raytwin::ray::instance_build::{InstanceFault, Instances, Placement};
///
/// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
/// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
/// # let place = Placement { to_scene, mesh: 0, mask: 1 };
/// # let scene =
/// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
/// match scene.validate() {
///     Ok(()) => println!("sound"),
///     Err(InstanceFault::Tree(fault)) => println!("the tree's shape: {fault}"),
///     Err(fault) => println!("{fault}"),
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InstanceFault {
    /// In the tree of instances; nodes are counted from its root.
    #[error("tree of instances: {0}")]
    Tree(Bvh8Fault),
    /// A leaf's box that does not contain an instance's.
    #[error("tree of instances: node {node}: its box does not contain instance {instance}")]
    Box {
        /// The leaf.
        node: u32,
        /// Position of the instance in the list.
        instance: u32,
    },
    /// An instance in no leaf, or in several.
    #[error("the instance at position {instance} is in {leaves} leaves")]
    Leaves {
        /// Its position in the list.
        instance: u32,
        /// Times that it is in a leaf.
        leaves: u32,
    },
    /// An instance that does not name its mesh and that mesh's root.
    #[error("the instance at position {instance}: mesh {mesh} with root {root} is not there")]
    Mesh {
        /// Its position in the list.
        instance: u32,
        /// Its mesh.
        mesh: u32,
        /// Its root.
        root: u32,
    },
}

/// A scene of placed meshes.
///
/// ```
/// use glam::{Affine3A, Vec3};
///
/// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
/// use raytwin::ray::instance::instance_closest;
/// use raytwin::ray::instance_build::{Instances, Placement};
/// use raytwin::ray::ray::Ray;
///
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
/// let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
/// let place = Placement { to_scene, mesh: 0, mask: 1 };
/// let scene =
///     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
/// let ray = Ray {
///     origin: Vec3::new(5.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let hit = instance_closest(&scene.view(), ray, u32::MAX);
/// assert_eq!((hit.instance, hit.primitive, hit.t), (0, 0, 2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Instances {
    nodes: Vec<BvhNode>,
    triangles: Vec<BvhTriangle>,
    top: u32,
    instances: Vec<Instance>,
    /// By mesh: its root, and the corners of its box.
    meshes: Vec<(u32, Vec3, Vec3)>,
    reach: f32,
}

/// The matrix and the translation from the mesh to the scene, exact but for
/// double precision: the inverse of what the instance stores.
fn forward(instance: &Instance) -> (DMat3, DVec3) {
    let rows = [instance.x, instance.y, instance.z].map(|r| r.as_dvec4());
    let linear =
        DMat3::from_cols(rows[0].truncate(), rows[1].truncate(), rows[2].truncate()).transpose();
    let back = linear.inverse();
    let shift = DVec3::new(rows[0].w, rows[1].w, rows[2].w);
    (back, -(back * shift))
}

/// The box of an instance in the scene, for rays that start at coordinates up
/// to `reach`.
///
/// Its corners are those of the mesh's box. A ray is mapped with rounding,
/// and a hit may lie outside the mesh's box by what the slab test's factor
/// allows: both are errors in the mesh's space, and the map carries them into
/// the scene. With L the map to the mesh, b its translation, M its inverse, P
/// the largest coordinate of the box in the scene and B of the mesh's box, the
/// point at t is computed from numbers of size up to
/// `A = |L| (reach + P) + |b| + B` by component. Mapping the origin errs by `4u`
/// of it, the direction by `3u` (its length up to the hit is within A), the slab
/// test by `4u` in both spaces and its factor by `2^-18`, with `u = 2^-24`: together
/// less than [`INSTANCE_PAD`] A. Boxes grow by `|M|` times that.
///
/// ```
/// use glam::{Affine3A, Vec3};
///
/// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
/// use raytwin::ray::instance_build::{Instances, Placement, instance_box};
///
/// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
/// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
/// # let place = Placement { to_scene, mesh: 0, mask: 1 };
/// # let scene =
/// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
/// // Somewhat larger than the mesh's box in its place.
/// let instance = &scene.view().instances[0];
/// let (min, max) = instance_box(instance, Vec3::ZERO, Vec3::ONE, 100.0);
/// assert!(min.x < 5.0 && min.x > 4.9 && max.x > 6.0 && max.x < 6.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn instance_box(instance: &Instance, low: Vec3, high: Vec3, reach: f32) -> (Vec3, Vec3) {
    let (matrix, shift) = forward(instance);
    let (mut min, mut max) = (DVec3::MAX, DVec3::MIN);
    for corner in 0..8u32 {
        let pick = |k: u32| {
            let of = if corner >> k & 1 == 0 { low } else { high };
            f64::from(of[k as usize])
        };
        let at = matrix * DVec3::new(pick(0), pick(1), pick(2)) + shift;
        min = min.min(at);
        max = max.max(at);
    }
    let far = min.abs().max(max.abs()) + f64::from(reach);
    let rows = [instance.x, instance.y, instance.z].map(|r| r.as_dvec4());
    let own = low.abs().max(high.abs()).as_dvec3();
    let size = |k: usize| rows[k].truncate().abs().dot(far) + rows[k].w.abs() + own[k];
    let sizes = DVec3::new(size(0), size(1), size(2)) * INSTANCE_PAD;
    let grow = DMat3::from_cols(
        matrix.x_axis.abs(),
        matrix.y_axis.abs(),
        matrix.z_axis.abs(),
    ) * sizes;
    let (min, max) = ((min - grow).as_vec3(), (max + grow).as_vec3());
    let down = min.to_array().map(f32::next_down);
    let up = max.to_array().map(f32::next_up);
    (down.into(), up.into())
}

fn place(
    instance: usize,
    placement: &Placement,
    meshes: &[(u32, Vec3, Vec3)],
    reach: f32,
) -> Result<(Instance, Vec3, Vec3), InstanceError> {
    let Some(&(root, low, high)) = meshes.get(placement.mesh as usize) else {
        return Err(InstanceError::Mesh {
            instance,
            mesh: placement.mesh,
            meshes: meshes.len(),
        });
    };
    let error = InstanceError::Map { instance };
    let matrix = Mat3::from(placement.to_scene.matrix3).as_dmat3();
    let back = matrix.inverse();
    let shift = -(back * placement.to_scene.translation.as_dvec3());
    let row = |k: usize| {
        let r = back.row(k);
        Vec4::new(r.x as f32, r.y as f32, r.z as f32, shift[k] as f32)
    };
    let out = Instance {
        x: row(0),
        y: row(1),
        z: row(2),
        root,
        mesh: placement.mesh,
        mask: placement.mask,
        index: instance as u32,
    };
    let stored = [out.x, out.y, out.z];
    if !matrix.is_finite() || matrix.determinant() == 0.0 || stored.iter().any(|r| !r.is_finite()) {
        return Err(error);
    }
    let (min, max) = instance_box(&out, low, high, reach);
    let far = min.abs().max(max.abs()).max_element();
    // A NaN compares as false.
    if far <= BVH_COORDINATE_MAX {
        Ok((out, min, max))
    } else {
        Err(error)
    }
}

impl Instances {
    /// Places meshes, and builds the tree of instances.
    ///
    /// `reach` is the largest coordinate that a ray's origin has. The boxes of
    /// instances grow by about 2^-17 of it; a ray that starts farther away may
    /// lose what is close to the rim of such a box, and nothing else.
    ///
    /// ```
    /// use glam::{Affine3A, Vec3};
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::instance_build::{Instances, Placement};
    ///
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    /// let place = Placement { to_scene, mesh: 0, mask: 1 };
    /// let scene =
    ///     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
    /// // Two of the same mesh, the second at the scene's origin.
    /// let origin = Placement { to_scene: Affine3A::IDENTITY, ..place };
    /// let two = Instances::build(
    ///     &[&mesh],
    ///     &[place, origin],
    ///     100.0,
    ///     BuildQuality::Medium,
    /// )?;
    /// assert_eq!(two.view().instances.len(), 2);
    /// assert_eq!(scene.view().instances.len(), 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// An instance of no mesh, a map without an inverse or beyond the range of
    /// coordinates (each with the instance), a reach that is not a distance,
    /// too many nodes.
    pub fn build(
        meshes: &[&Bvh],
        placements: &[Placement],
        reach: f32,
        quality: BuildQuality,
    ) -> Result<Self, InstanceError> {
        if !(0.0..=BVH_COORDINATE_MAX).contains(&reach) {
            return Err(InstanceError::Reach { reach });
        }
        let count = |f: &dyn Fn(&Bvh) -> usize| meshes.iter().map(|m| f(m)).sum::<usize>();
        let limit = 1usize << 31;
        if count(&|m| m.nodes.len()) + 2 * placements.len() >= limit
            || count(&|m| m.triangles.len()) >= limit
        {
            return Err(InstanceError::TooMany);
        }
        let mut out = Self {
            nodes: Vec::new(),
            triangles: Vec::new(),
            top: 0,
            instances: Vec::new(),
            meshes: Vec::new(),
            reach,
        };
        for mesh in meshes {
            let root = out.nodes.len() as u32;
            let first = out.triangles.len() as u32;
            let (low, high) = mesh
                .nodes
                .first()
                .map_or((Vec3::ZERO, Vec3::ZERO), |n| (n.min, n.max));
            out.meshes.push((root, low, high));
            out.nodes.extend(mesh.nodes.iter().map(|n| BvhNode {
                first: n.first + if n.count == 0 { root } else { first },
                ..*n
            }));
            if mesh.nodes.is_empty() {
                // An inner node without children.
                out.nodes.push(BvhNode {
                    min: Vec3::ZERO,
                    first: 0,
                    max: Vec3::ZERO,
                    count: 0,
                });
            }
            out.triangles.extend_from_slice(&mesh.triangles);
        }
        out.top = out.nodes.len() as u32;
        let mut placed = Vec::with_capacity(placements.len());
        for (i, placement) in placements.iter().enumerate() {
            placed.push(place(i, placement, &out.meshes, reach)?);
        }
        if placed.is_empty() {
            return Ok(out);
        }
        let boxes: Vec<_> = placed
            .iter()
            .map(|p| Aabb::new(p.1.into(), p.2.into()))
            .collect();
        let nodes = Shape::new(&boxes, quality).lay_out(|i| {
            let (instance, low, high) = placed[i as usize];
            out.instances.push(instance);
            (low, high)
        });
        let top = out.top;
        out.nodes.extend(nodes.iter().map(|n| BvhNode {
            first: n.first + if n.count == 0 { top } else { 0 },
            ..*n
        }));
        Ok(out)
    }

    /// Moves the instances, and the boxes of their tree with them; its shape
    /// stays. The hits are those of a tree built anew; the farther the
    /// instances move from each other, the longer they take.
    ///
    /// ```
    /// use glam::{Affine3A, Vec3};
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::instance::instance_any;
    /// use raytwin::ray::instance_build::{Instances, Placement};
    /// use raytwin::ray::ray::Ray;
    ///
    /// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    /// # let place = Placement { to_scene, mesh: 0, mask: 1 };
    /// # let mut scene =
    /// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
    /// let ray = Ray {
    ///     origin: Vec3::new(5.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// // It moves on, out of the ray's way.
    /// let to_scene = Affine3A::from_translation(Vec3::new(7.0, 0.0, 0.0));
    /// scene.refit(&[Placement { to_scene, ..place }])?;
    /// assert_eq!(instance_any(&scene.view(), ray, u32::MAX), 0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`Self::build`], and if the number of instances or the mesh of one
    /// is not what was built. Then nothing is changed.
    pub fn refit(&mut self, placements: &[Placement]) -> Result<(), InstanceError> {
        let other = InstanceError::Refit {
            given: placements.len(),
            built: self.instances.len(),
        };
        if placements.len() != self.instances.len() {
            return Err(other);
        }
        let mut placed = Vec::with_capacity(placements.len());
        for instance in &self.instances {
            let i = instance.index as usize;
            let placement = placements.get(i).ok_or_else(|| other.clone())?;
            if placement.mesh != instance.mesh {
                return Err(other);
            }
            placed.push(place(i, placement, &self.meshes, self.reach)?);
        }
        let mut nodes = self.top_nodes();
        for node in &mut nodes {
            if node.count > 0 {
                let first = node.first as usize;
                (node.min, node.max) = (Vec3::MAX, Vec3::MIN);
                for &(_, low, high) in &placed[first..first + node.count as usize] {
                    node.min = node.min.min(low);
                    node.max = node.max.max(high);
                }
            }
        }
        join(&mut nodes);
        let top = self.top as usize;
        for (to, from) in self.nodes[top..].iter_mut().zip(&nodes) {
            (to.min, to.max) = (from.min, from.max);
        }
        self.instances = placed.into_iter().map(|p| p.0).collect();
        Ok(())
    }

    /// The nodes of the tree of instances, counted from its root.
    fn top_nodes(&self) -> Vec<BvhNode> {
        let nodes = self.nodes.get(self.top as usize..).unwrap_or(&[]);
        let shift = |n: &BvhNode| if n.count == 0 { self.top } else { 0 };
        nodes
            .iter()
            .map(|n| BvhNode {
                first: n.first.wrapping_sub(shift(n)),
                ..*n
            })
            .collect()
    }

    /// Checks what the walk relies on: the shape of the tree of instances, that
    /// its leaves' boxes contain the instances' and each instance is in one
    /// leaf, and that each names a mesh that is there. The meshes' own trees
    /// are checked by [`Bvh::validate`].
    ///
    /// ```
    /// use glam::{Affine3A, Vec3};
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::instance_build::{Instances, Placement};
    ///
    /// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    /// # let place = Placement { to_scene, mesh: 0, mask: 1 };
    /// # let scene =
    /// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
    /// assert_eq!(scene.validate(), Ok(()));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// The first fault found.
    pub fn validate(&self) -> Result<(), InstanceFault> {
        let nodes = self.top_nodes();
        check_nodes(&nodes, self.instances.len()).map_err(InstanceFault::Tree)?;
        let mut leaves = vec![0u32; self.instances.len()];
        for (position, instance) in self.instances.iter().enumerate() {
            let mesh = self.meshes.get(instance.mesh as usize);
            if mesh.is_none_or(|m| m.0 != instance.root) {
                return Err(InstanceFault::Mesh {
                    instance: position as u32,
                    mesh: instance.mesh,
                    root: instance.root,
                });
            }
        }
        for (i, node) in nodes.iter().enumerate() {
            for k in node.first..node.first.saturating_add(node.count) {
                let instance = &self.instances[k as usize];
                leaves[k as usize] += 1;
                let (_, low, high) = self.meshes[instance.mesh as usize];
                let (low, high) = instance_box(instance, low, high, self.reach);
                if !(node.min.cmple(low).all() && node.max.cmpge(high).all()) {
                    return Err(InstanceFault::Box {
                        node: i as u32,
                        instance: k,
                    });
                }
            }
        }
        match leaves.iter().position(|&n| n != 1) {
            Some(k) => Err(InstanceFault::Leaves {
                instance: k as u32,
                leaves: leaves[k],
            }),
            None => Ok(()),
        }
    }

    /// What [`instance_closest`](raytwin_cpu::ray::instance::instance_closest)
    /// walks.
    ///
    /// ```
    /// use glam::{Affine3A, Vec3};
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::instance::instance_any;
    /// use raytwin::ray::instance_build::{Instances, Placement};
    /// use raytwin::ray::ray::Ray;
    ///
    /// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    /// # let place = Placement { to_scene, mesh: 0, mask: 1 };
    /// # let scene =
    /// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
    /// let ray = Ray {
    ///     origin: Vec3::new(5.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// assert_eq!(instance_any(&scene.view(), ray, 1), 1);
    /// // The instance is not there for rays without its bit.
    /// assert_eq!(instance_any(&scene.view(), ray, 2), 0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn view(&self) -> InstanceView<'_> {
        InstanceView {
            bvh: BvhView {
                nodes: &self.nodes,
                triangles: &self.triangles,
            },
            top: self.top,
            instances: &self.instances,
        }
    }

    /// The same scene over trees with eight children a node. `meshes` are
    /// those that [`Self::build`] was given.
    ///
    /// ```
    /// use glam::{Affine3A, Vec3};
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::instance::instance_closest;
    /// use raytwin::ray::instance_build::{Instances, Placement};
    /// use raytwin::ray::ray::Ray;
    ///
    /// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    /// # let place = Placement { to_scene, mesh: 0, mask: 1 };
    /// # let scene =
    /// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
    /// let ray = Ray {
    ///     origin: Vec3::new(5.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// // The same hit.
    /// let wide = scene.wide(&[&mesh])?;
    /// assert_eq!(wide.closest(&ray, 1), instance_closest(&scene.view(), ray, 1));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// The first fault found in a tree; none for the meshes of the build.
    pub fn wide(&self, meshes: &[&Bvh]) -> Result<Instances8, Bvh8Fault> {
        let meshes: Result<Vec<_>, _> = meshes.iter().map(|m| m.wide()).collect();
        Instances8::new(&self.top_nodes(), &self.instances, meshes?)
    }

    /// Carries a refit over to the scene that [`Self::wide`] has made.
    ///
    /// ```
    /// use glam::{Affine3A, Vec3};
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::instance_build::{Instances, Placement};
    /// use raytwin::ray::ray::Ray;
    ///
    /// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    /// # let place = Placement { to_scene, mesh: 0, mask: 1 };
    /// # let mut scene =
    /// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
    /// let ray = Ray {
    ///     origin: Vec3::new(5.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let mut wide = scene.wide(&[&mesh])?;
    /// let to_scene = Affine3A::from_translation(Vec3::new(7.0, 0.0, 0.0));
    /// scene.refit(&[Placement { to_scene, ..place }])?;
    /// scene.refit_wide(&mut wide)?;
    /// assert!(!wide.any(&ray, 1));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If that scene has another number of instances or other meshes.
    pub fn refit_wide(&self, wide: &mut Instances8) -> Result<(), Bvh8Fault> {
        wide.replace(&self.top_nodes(), &self.instances)
    }

    /// The root of the tree of instances, the first argument of the WGSL twin.
    ///
    /// ```
    /// use glam::{Affine3A, Vec3};
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::instance_build::{Instances, Placement};
    ///
    /// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    /// # let place = Placement { to_scene, mesh: 0, mask: 1 };
    /// # let scene =
    /// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
    /// // The trees of the meshes come first: here one node.
    /// assert_eq!(scene.top(), 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn top(&self) -> u32 {
        self.top
    }

    /// All trees for `ray/bvh.bindings`.
    ///
    /// ```
    /// use glam::{Affine3A, Vec3};
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::instance_build::{Instances, Placement};
    ///
    /// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    /// # let place = Placement { to_scene, mesh: 0, mask: 1 };
    /// # let scene =
    /// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
    /// // The mesh's node and that of the tree of instances.
    /// assert_eq!(scene.trees().node_words().len(), 2 * 8);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn trees(&self) -> Bvh {
        Bvh {
            nodes: self.nodes.clone(),
            triangles: self.triangles.clone(),
        }
    }

    /// The instances for `ray/instance.bindings`: sixteen words each. No
    /// instances give one that no ray sees.
    ///
    /// ```
    /// use glam::{Affine3A, Vec3};
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::instance_build::{Instances, Placement};
    ///
    /// # let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// # let mesh = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// # let to_scene = Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0));
    /// # let place = Placement { to_scene, mesh: 0, mask: 1 };
    /// # let scene =
    /// #     Instances::build(&[&mesh], &[place], 100.0, BuildQuality::Medium)?;
    /// let words = scene.instance_words();
    /// assert_eq!(words.len(), 16);
    /// // The translation back ends the first row.
    /// assert_eq!(f32::from_bits(words[3]), -5.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn instance_words(&self) -> Vec<u32> {
        if self.instances.is_empty() {
            return vec![0; 16];
        }
        let mut words = Vec::with_capacity(16 * self.instances.len());
        for i in &self.instances {
            for row in [i.x, i.y, i.z] {
                words.extend(row.to_array().map(f32::to_bits));
            }
            words.extend([i.root, i.mesh, i.mask, i.index]);
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raytwin_cpu::ray::instance::instance_closest;
    use raytwin_cpu::ray::ray::Ray;

    fn scene() -> Instances {
        let mesh = Bvh::build(
            &[Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
            &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
            BuildQuality::Fastest,
        )
        .expect("a mesh");
        let places: Vec<_> = (0..20)
            .map(|i| Placement {
                to_scene: Affine3A::from_translation(Vec3::new(i as f32, (i % 3) as f32, 0.0)),
                mesh: 0,
                mask: 1,
            })
            .collect();
        Instances::build(&[&mesh], &places, 100.0, BuildQuality::Medium).expect("a scene")
    }

    /// Bad trees are named, and walks over them end.
    #[test]
    fn broken_trees_are_named() {
        let refuse = |change: &dyn Fn(&mut Instances, usize)| {
            let mut scene = scene();
            let top = scene.top as usize;
            change(&mut scene, top);
            for i in 0..50 {
                let ray = Ray {
                    origin: Vec3::new(i as f32 * 0.4, 0.2, 5.0),
                    direction: Vec3::new(0.1, 0.0, -1.0),
                    t_min: 0.0,
                    t_max: f32::MAX,
                };
                let _ = instance_closest(&scene.view(), ray, 1);
            }
            scene.validate().expect_err("a broken tree")
        };
        assert_eq!(scene().validate(), Ok(()));
        assert_eq!(
            refuse(&|s, top| s.nodes[top].first = s.top),
            InstanceFault::Tree(Bvh8Fault::Child { node: 0, child: 0 })
        );
        assert!(matches!(
            refuse(&|s, top| s.nodes[top].first = u32::MAX),
            InstanceFault::Tree(Bvh8Fault::Child { node: 0, .. })
        ));
        assert_eq!(
            refuse(&|s, top| s.nodes[top + 2].min.x = f32::NAN),
            InstanceFault::Tree(Bvh8Fault::Box { node: 2 })
        );
        let leaf = |s: &Instances, top: usize| {
            let found = s.nodes[top..].iter().position(|n| n.count > 0);
            found.expect("a leaf")
        };
        let at = leaf(&scene(), scene().top as usize);
        assert_eq!(
            refuse(&|s, top| s.nodes[top + at].count = u32::MAX),
            InstanceFault::Tree(Bvh8Fault::Range { node: at as u32 })
        );
        assert!(matches!(
            refuse(&|s, top| s.nodes[top + at].min = s.nodes[top + at].max),
            InstanceFault::Box { node, .. } if node == at as u32
        ));
        assert!(matches!(
            refuse(&|s, _| s.instances[3].root = 7),
            InstanceFault::Mesh { instance: 3, .. }
        ));
        assert!(matches!(
            refuse(&|s, top| s.nodes[top + at].first ^= 1),
            InstanceFault::Box { .. } | InstanceFault::Leaves { .. }
        ));
    }
}
