//! Building the tree that [`raytwin_cpu::ray::bvh`] and its WGSL twin traverse.
//!
//! obvhs finds the topology (PLOC with reinsertion); the boxes are our own,
//! computed from the triangles upwards with the margin that the watertight
//! traversal needs, and laid out so that children follow their parent.

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::builder::build_bvh2;
pub use raytwin_cpu::pass::bvh8::triangle_box as bvh_triangle_box;
use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault};
use raytwin_cpu::random::pcg::pcg_hash;
use raytwin_cpu::ray::bvh::{BVH_STACK, BvhNode, BvhTriangle, BvhView};

/// Largest number of triangles in one tree: 2^26.
pub const BVH_TRIANGLES_MAX: usize = 1 << 26;

/// Largest magnitude of a vertex coordinate: 2^39, about 5.5e11. Beyond it the
/// products of the triangle test could overflow.
pub const BVH_COORDINATE_MAX: f32 = 549_755_813_888.0;

/// How much time to spend on a better tree.
///
/// ```
/// use glam::Vec3;
///
/// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
/// // Every quality gives the same hits; what differs is how long they take.
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// for quality in BuildQuality::ALL {
///     assert!(
///         Bvh::build(&positions, &[[0, 1, 2]], quality)?.validate().is_ok()
///     );
/// }
/// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BuildQuality {
    /// PLOC with search distance 1, one triangle a leaf.
    Fastest,
    /// A wider search and a little reinsertion.
    Fast,
    /// About the build time of a binned SAH builder.
    #[default]
    Medium,
    /// Several times the build time of `Medium`.
    Slow,
    /// Every node is tried elsewhere.
    VerySlow,
}

impl BuildQuality {
    /// All qualities, fastest build first.
    pub const ALL: [Self; 5] = [
        Self::Fastest,
        Self::Fast,
        Self::Medium,
        Self::Slow,
        Self::VerySlow,
    ];

    /// obvhs parameters. Pre-splitting stays off: a split triangle's leaf box
    /// does not contain the triangle, and traversal relies on that it does.
    fn params(self) -> BvhBuildParams {
        let params = match self {
            Self::Fastest => BvhBuildParams::fastest_build(),
            Self::Fast => BvhBuildParams::fast_build(),
            Self::Medium => BvhBuildParams::medium_build(),
            Self::Slow => BvhBuildParams::slow_build(),
            Self::VerySlow => BvhBuildParams::very_slow_build(),
        };
        BvhBuildParams {
            pre_split: false,
            ..params
        }
    }
}

/// Why a mesh has no tree.
///
/// ```
/// use glam::Vec3;
///
/// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
/// // Vertex 7 is not there; the error says which triangle asks for it.
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let error =
///     Bvh::build(&positions, &[[0, 1, 7]], BuildQuality::Fast).unwrap_err();
/// assert!(error.to_string().starts_with("triangle 0 uses vertex 7"));
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BvhError {
    /// An index that no vertex has.
    #[error(
        "triangle {triangle} uses vertex {index}, but the mesh has {vertices} vertices: \
         mend the index list"
    )]
    IndexOutOfRange {
        /// The triangle.
        triangle: usize,
        /// Its index.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// NaN or an infinity.
    #[error(
        "triangle {triangle}: vertex {index} is ({x}, {y}, {z}), not finite: remove or repair it"
    )]
    NotFinite {
        /// The triangle.
        triangle: usize,
        /// The vertex.
        index: u32,
        /// Its first coordinate.
        x: f32,
        /// Its second coordinate.
        y: f32,
        /// Its third coordinate.
        z: f32,
    },
    /// A coordinate that would overflow.
    #[error(
        "triangle {triangle}: vertex {index} is ({x}, {y}, {z}), beyond {BVH_COORDINATE_MAX:e}: \
         scale the mesh down"
    )]
    TooFar {
        /// The triangle.
        triangle: usize,
        /// The vertex.
        index: u32,
        /// Its first coordinate.
        x: f32,
        /// Its second coordinate.
        y: f32,
        /// Its third coordinate.
        z: f32,
    },
    /// More triangles than a tree takes.
    #[error("{count} triangles are more than {BVH_TRIANGLES_MAX}: split the mesh")]
    TooManyTriangles {
        /// Number of triangles.
        count: usize,
    },
    /// [`Bvh::refit`] with the triangles of another mesh.
    #[error(
        "the mesh has {given} triangles, not the {built} of the tree: refit with the mesh that \
         it was built for, or build anew"
    )]
    Refit {
        /// Number of triangles.
        given: usize,
        /// Number of triangles that the tree was built for.
        built: usize,
    },
}

/// What [`Bvh::validate`] finds wrong with a tree.
///
/// ```
/// use glam::Vec3;
///
/// use raytwin::ray::bvh_build::{BuildQuality, Bvh, BvhFault};
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let mut tree = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Fast)?;
/// // The leaf now asks for a triangle that is not there.
/// tree.nodes[0].count = 2;
/// assert!(matches!(tree.validate(), Err(BvhFault::Range { node: 0, .. })));
/// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BvhFault {
    /// A child index outside the tree, or not above its parent's.
    #[error("node {node}: child {child} is outside the tree or before its parent")]
    Child {
        /// The inner node.
        node: u32,
        /// Index of its first child.
        child: u32,
    },
    /// A node that is nobody's child, or more than one's.
    #[error("node {node} has {parents} parents")]
    Parents {
        /// The node.
        node: u32,
        /// Times that it is a child.
        parents: u32,
    },
    /// A leaf's triangles outside the list.
    #[error("leaf {node}: triangles {first}..+{count} are outside the list")]
    Range {
        /// The leaf.
        node: u32,
        /// Its first triangle.
        first: u32,
        /// Its number of triangles.
        count: u32,
    },
    /// A box that does not contain what is below it.
    #[error("node {node}: its box does not contain item {item} below it")]
    Box {
        /// The node.
        node: u32,
        /// The child node, or for a leaf the position in the triangle list.
        item: u32,
    },
    /// A triangle that is in no leaf, or in several.
    #[error("the triangle at position {position} is in {leaves} leaves")]
    Leaves {
        /// Its position in the list.
        position: u32,
        /// Times that it is in a leaf.
        leaves: u32,
    },
    /// A primitive index that two triangles have.
    #[error("primitive {primitive} is there twice or out of range")]
    Primitive {
        /// The index.
        primitive: u32,
    },
    /// More inner levels than the traversal's stack holds.
    #[error("{depth} inner levels, more than {BVH_STACK}")]
    Depth {
        /// Inner levels.
        depth: usize,
    },
}

/// A tree over the triangles of one mesh.
///
/// ```
/// use glam::Vec3;
///
/// use raytwin::ray::bvh::bvh_closest;
/// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
/// use raytwin::ray::ray::Ray;
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let tree = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// assert_eq!(bvh_closest(&tree.view(), ray).t, 2.0);
/// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bvh {
    /// The nodes, root first; empty for an empty mesh.
    pub nodes: Vec<BvhNode>,
    /// The triangles in leaf order, each once.
    pub triangles: Vec<BvhTriangle>,
}

fn corners(positions: &[Vec3], triangle: usize, indices: [u32; 3]) -> Result<[Vec3; 3], BvhError> {
    let mut out = [Vec3::ZERO; 3];
    for (slot, index) in out.iter_mut().zip(indices) {
        let Some(&p) = positions.get(index as usize) else {
            return Err(BvhError::IndexOutOfRange {
                triangle,
                index,
                vertices: positions.len(),
            });
        };
        let Vec3 { x, y, z } = p;
        if !p.is_finite() {
            return Err(BvhError::NotFinite {
                triangle,
                index,
                x,
                y,
                z,
            });
        }
        if p.abs().max_element() > BVH_COORDINATE_MAX {
            return Err(BvhError::TooFar {
                triangle,
                index,
                x,
                y,
                z,
            });
        }
        *slot = p;
    }
    Ok(out)
}

/// A tree's shape before it is laid out: inner nodes name their children,
/// leaves a range of `order`.
pub(super) struct Shape {
    /// `(first, count)`; with count 0, children `first` and `first + 1`.
    nodes: Vec<(u32, u32)>,
    pub(super) order: Vec<u32>,
}

impl Shape {
    fn by_obvhs(boxes: &[Aabb], quality: BuildQuality) -> Self {
        let mut time = std::time::Duration::default();
        let tree = build_bvh2(boxes, quality.params(), &mut time);
        Self {
            nodes: tree
                .nodes
                .iter()
                .map(|n| (n.first_index, n.prim_count))
                .collect(),
            order: tree.primitive_indices,
        }
    }

    /// Halves the set at the median of its longest axis: as shallow as a tree
    /// can be, whatever the mesh.
    fn by_median(boxes: &[Aabb]) -> Self {
        const LEAF: usize = 4;
        let middle: Vec<Vec3A> = boxes.iter().map(|b| b.min * 0.5 + b.max * 0.5).collect();
        let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
        let mut nodes = vec![(0, 0)];
        let mut todo = vec![(0usize, 0usize, boxes.len())];
        while let Some((node, start, end)) = todo.pop() {
            if end - start <= LEAF {
                nodes[node] = (start as u32, (end - start) as u32);
                continue;
            }
            let part = &mut order[start..end];
            let (mut low, mut high) = (Vec3A::MAX, Vec3A::MIN);
            for &i in &*part {
                low = low.min(middle[i as usize]);
                high = high.max(middle[i as usize]);
            }
            let extent = high - low;
            let axis = if extent.x >= extent.y && extent.x >= extent.z {
                0
            } else if extent.y >= extent.z {
                1
            } else {
                2
            };
            let half = part.len() / 2;
            part.select_nth_unstable_by(half, |&a, &b| {
                middle[a as usize][axis]
                    .total_cmp(&middle[b as usize][axis])
                    .then(a.cmp(&b))
            });
            let child = nodes.len();
            nodes[node] = (child as u32, 0);
            nodes.resize(child + 2, (0, 0));
            todo.push((child, start, start + half));
            todo.push((child + 1, start + half, end));
        }
        Self { nodes, order }
    }

    /// Number of inner levels.
    fn depth(&self) -> usize {
        let mut deepest = 0;
        let mut todo = vec![(0u32, 0usize)];
        while let Some((node, depth)) = todo.pop() {
            let (first, count) = self.nodes[node as usize];
            if count == 0 {
                deepest = deepest.max(depth + 1);
                todo.push((first, depth + 1));
                todo.push((first + 1, depth + 1));
            }
        }
        deepest
    }

    /// The shape for boxes, with at most [`BVH_STACK`] inner levels.
    pub(super) fn new(boxes: &[Aabb], quality: BuildQuality) -> Self {
        let shape = Self::by_obvhs(boxes, quality);
        if shape.depth() > BVH_STACK {
            return Self::by_median(boxes);
        }
        shape
    }

    /// Depth-first layout, siblings side by side, and boxes from below. The
    /// items in leaf order, and their boxes, come from `item`.
    pub(super) fn lay_out(&self, mut item: impl FnMut(u32) -> (Vec3, Vec3)) -> Vec<BvhNode> {
        const EMPTY: BvhNode = BvhNode {
            min: Vec3::MAX,
            first: 0,
            max: Vec3::MIN,
            count: 0,
        };
        let mut nodes = Vec::with_capacity(self.nodes.len());
        nodes.push(EMPTY);
        let mut items = 0;
        let mut todo = vec![(0u32, 0usize)];
        while let Some((from, to)) = todo.pop() {
            let (first, count) = self.nodes[from as usize];
            if count == 0 {
                let child = nodes.len();
                nodes.extend([EMPTY, EMPTY]);
                nodes[to].first = child as u32;
                todo.push((first + 1, child + 1));
                todo.push((first, child));
            } else {
                let node = &mut nodes[to];
                node.first = items;
                node.count = count;
                items += count;
                for &i in &self.order[first as usize..(first + count) as usize] {
                    let (low, high) = item(i);
                    node.min = node.min.min(low);
                    node.max = node.max.max(high);
                }
            }
        }
        join(&mut nodes);
        nodes
    }
}

/// The boxes of inner nodes from those of their children.
pub(super) fn join(nodes: &mut [BvhNode]) {
    for i in (0..nodes.len()).rev() {
        let first = nodes[i].first as usize;
        // In a broken tree a child may be anywhere.
        if nodes[i].count == 0 && first > i && first + 1 < nodes.len() {
            let (l, r) = (nodes[first], nodes[first + 1]);
            nodes[i].min = l.min.min(r.min);
            nodes[i].max = l.max.max(r.max);
        }
    }
}

/// A triangle's box as the search for a shape sees it, a little larger by a
/// random amount.
///
/// PLOC joins boxes that are each other's nearest. In a wall of equal squares
/// along the axes all neighbours are equally near, each box takes the first of
/// them, hardly two take each other, and the tree becomes a comb: with 64
/// squares a side its boxes had 9 to 25 times the area. Unequal boxes have no ties.
/// The tree's own boxes are computed from the triangles.
fn uneven(triangle: u32, low: Vec3, high: Vec3) -> Aabb {
    let extent = (high - low).max_element();
    // Some steps of the coordinates at least, or it would be rounded away.
    let far = low.abs().max(high.abs()).max_element();
    let most = extent * (1.0 / 1024.0) + far * (1.0 / 2_097_152.0);
    let part = (pcg_hash(triangle) >> 8) as f32 / 16_777_216.0;
    let grow = Vec3::splat(part * most);
    Aabb::new((low - grow).into(), (high + grow).into())
}

impl Bvh {
    /// Builds a tree over the triangles `indices` of `positions`.
    ///
    /// No triangles give an empty tree. At most [`BVH_STACK`] inner levels:
    /// where obvhs goes deeper, that mesh is halved at medians instead.
    /// Deterministic.
    ///
    /// ```
    /// use glam::Vec3;
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// // Two triangles that make a square.
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
    /// let indices = [[0, 1, 2], [0, 2, 3]];
    /// let tree = Bvh::build(&positions, &indices, BuildQuality::Medium)?;
    /// assert_eq!(tree.triangles.len(), 2);
    /// // No triangles, an empty tree.
    /// assert!(Bvh::build(&positions, &[], BuildQuality::Medium)?.nodes.is_empty());
    /// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
    /// ```
    ///
    /// # Errors
    /// An index out of range, a vertex that is not finite or beyond
    /// [`BVH_COORDINATE_MAX`] (each with the triangle that uses it), or more
    /// triangles than [`BVH_TRIANGLES_MAX`].
    pub fn build(
        positions: &[Vec3],
        indices: &[[u32; 3]],
        quality: BuildQuality,
    ) -> Result<Self, BvhError> {
        if indices.len() > BVH_TRIANGLES_MAX {
            return Err(BvhError::TooManyTriangles {
                count: indices.len(),
            });
        }
        let mut triangles = Vec::with_capacity(indices.len());
        let mut boxes = Vec::with_capacity(indices.len());
        for (i, &t) in indices.iter().enumerate() {
            let [a, b, c] = corners(positions, i, t)?;
            triangles.push(BvhTriangle {
                a,
                b,
                c,
                primitive: i as u32,
            });
            boxes.push(uneven(i as u32, a.min(b).min(c), a.max(b).max(c)));
        }
        if triangles.is_empty() {
            return Ok(Self::default());
        }
        let mut ordered = Vec::with_capacity(triangles.len());
        let nodes = Shape::new(&boxes, quality).lay_out(|i| {
            let t = triangles[i as usize];
            ordered.push(t);
            bvh_triangle_box(t.a, t.b, t.c)
        });
        Ok(Self {
            nodes,
            triangles: ordered,
        })
    }

    /// Moves the triangles, and the boxes with them; the tree's shape stays. The
    /// hits are those of a tree built anew; the more the mesh is deformed, the
    /// longer they take. For the GPU upload its words again
    /// (`raytwin::gpu::BvhBuffers::write`).
    ///
    /// ```
    /// use glam::Vec3;
    ///
    /// use raytwin::ray::bvh::bvh_closest;
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::ray::Ray;
    /// let mut positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let mut tree = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// for p in &mut positions {
    ///     p.z += 0.5;
    /// }
    /// tree.refit(&positions, &[[0, 1, 2]])?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// assert_eq!(bvh_closest(&tree.view(), ray).t, 1.5);
    /// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Self::build`], and if the mesh has another number of triangles than
    /// the tree. Then nothing is changed.
    pub fn refit(&mut self, positions: &[Vec3], indices: &[[u32; 3]]) -> Result<(), BvhError> {
        let other = BvhError::Refit {
            given: indices.len(),
            built: self.triangles.len(),
        };
        if indices.len() != self.triangles.len() {
            return Err(other);
        }
        let mut moved = Vec::with_capacity(self.triangles.len());
        for &BvhTriangle { primitive, .. } in &self.triangles {
            let triangle = primitive as usize;
            let t = *indices.get(triangle).ok_or_else(|| other.clone())?;
            let [a, b, c] = corners(positions, triangle, t)?;
            moved.push(BvhTriangle { a, b, c, primitive });
        }
        for node in self.nodes.iter_mut().filter(|node| node.count > 0) {
            let first = node.first as usize;
            let end = first.saturating_add(node.count as usize);
            (node.min, node.max) = (Vec3::MAX, Vec3::MIN);
            for t in moved.get(first..end).unwrap_or(&[]) {
                let (low, high) = bvh_triangle_box(t.a, t.b, t.c);
                node.min = node.min.min(low);
                node.max = node.max.max(high);
            }
        }
        join(&mut self.nodes);
        self.triangles = moved;
        Ok(())
    }

    /// The tree for [`bvh_closest`](raytwin_cpu::ray::bvh::bvh_closest) and
    /// [`bvh_any`](raytwin_cpu::ray::bvh::bvh_any).
    ///
    /// ```
    /// use glam::Vec3;
    ///
    /// use raytwin::ray::bvh::bvh_any;
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::ray::Ray;
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let tree = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// assert_eq!(bvh_any(&tree.view(), ray), 1);
    /// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
    /// ```
    #[must_use]
    pub fn view(&self) -> BvhView<'_> {
        BvhView {
            nodes: &self.nodes,
            triangles: &self.triangles,
        }
    }

    /// The same tree with eight children a node, for the processor's vector
    /// instructions: the same hits, two and a half times as fast.
    ///
    /// ```
    /// use glam::Vec3;
    ///
    /// use raytwin::ray::bvh::bvh_closest;
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// use raytwin::ray::ray::Ray;
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let tree = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// // The same hit.
    /// assert_eq!(tree.wide()?.closest(&ray), bvh_closest(&tree.view(), ray));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// The first fault found; none in a tree that [`Bvh::build`] has made.
    pub fn wide(&self) -> Result<Bvh8, Bvh8Fault> {
        Bvh8::new(self.view())
    }

    /// The nodes for `ray/bvh.bindings`: eight words each. An empty tree gives
    /// one node of zeros, since a binding cannot be empty.
    ///
    /// ```
    /// use glam::Vec3;
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let tree = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// assert_eq!(tree.node_words().len(), 8 * tree.nodes.len());
    /// assert_eq!(Bvh::default().node_words(), [0; 8]);
    /// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
    /// ```
    #[must_use]
    pub fn node_words(&self) -> Vec<u32> {
        if self.nodes.is_empty() {
            return vec![0; 8];
        }
        let mut words = Vec::with_capacity(8 * self.nodes.len());
        for n in &self.nodes {
            words.extend(n.min.to_array().map(f32::to_bits));
            words.push(n.first);
            words.extend(n.max.to_array().map(f32::to_bits));
            words.push(n.count);
        }
        words
    }

    /// The triangles for `ray/bvh.bindings`: twelve words each, the primitive
    /// index fourth. An empty tree gives one triangle of zeros.
    ///
    /// ```
    /// use glam::Vec3;
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let tree = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// // Three vertices of four words; the fourth is the primitive's index.
    /// let words = tree.triangle_words();
    /// assert_eq!((words.len(), words[3]), (12, 0));
    /// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
    /// ```
    #[must_use]
    pub fn triangle_words(&self) -> Vec<u32> {
        if self.triangles.is_empty() {
            return vec![0; 12];
        }
        let mut words = Vec::with_capacity(12 * self.triangles.len());
        for t in &self.triangles {
            for (vertex, last) in [(t.a, t.primitive), (t.b, 0), (t.c, 0)] {
                words.extend(vertex.to_array().map(f32::to_bits));
                words.push(last);
            }
        }
        words
    }

    /// Number of inner levels.
    ///
    /// ```
    /// use glam::Vec3;
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// // One triangle is a leaf, without a level above it.
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let tree = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// assert_eq!(tree.depth(), 0);
    /// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
    /// ```
    #[must_use]
    pub fn depth(&self) -> usize {
        let mut deepest = 0;
        let mut level = vec![0usize; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate() {
            if node.count == 0 {
                let below = level[i] + 1;
                deepest = deepest.max(below);
                for child in [node.first as usize, node.first as usize + 1] {
                    if let Some(slot) = level.get_mut(child) {
                        *slot = below;
                    }
                }
            }
        }
        deepest
    }

    /// Checks what traversal relies on: children exist, follow their parent
    /// and have one parent each; every box contains what is below it, margin
    /// included; each triangle is in one leaf, each primitive index there
    /// once; and the depth.
    ///
    /// ```
    /// use glam::Vec3;
    ///
    /// use raytwin::ray::bvh_build::{BuildQuality, Bvh};
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let mut tree = Bvh::build(&positions, &[[0, 1, 2]], BuildQuality::Medium)?;
    /// assert_eq!(tree.validate(), Ok(()));
    /// // A box too small for its triangle.
    /// tree.nodes[0].max = Vec3::ZERO;
    /// assert!(tree.validate().is_err());
    /// # Ok::<(), raytwin::ray::bvh_build::BvhError>(())
    /// ```
    ///
    /// # Errors
    /// The first fault found.
    pub fn validate(&self) -> Result<(), BvhFault> {
        let mut parents = vec![0u32; self.nodes.len()];
        let mut leaves = vec![0u32; self.triangles.len()];
        let contains = |node: &BvhNode, low: Vec3, high: Vec3| {
            node.min.cmple(low).all() && node.max.cmpge(high).all()
        };
        for (i, node) in self.nodes.iter().enumerate() {
            let at = i as u32;
            let first = node.first as usize;
            if node.count == 0 {
                if first <= i || first + 1 >= self.nodes.len() {
                    return Err(BvhFault::Child {
                        node: at,
                        child: node.first,
                    });
                }
                for child in [first, first + 1] {
                    parents[child] += 1;
                    let c = &self.nodes[child];
                    if !contains(node, c.min, c.max) {
                        return Err(BvhFault::Box {
                            node: at,
                            item: child as u32,
                        });
                    }
                }
            } else {
                let end = first.saturating_add(node.count as usize);
                let Some(part) = self.triangles.get(first..end) else {
                    return Err(BvhFault::Range {
                        node: at,
                        first: node.first,
                        count: node.count,
                    });
                };
                for (k, t) in part.iter().enumerate() {
                    leaves[first + k] += 1;
                    let (low, high) = bvh_triangle_box(t.a, t.b, t.c);
                    if !contains(node, low, high) {
                        return Err(BvhFault::Box {
                            node: at,
                            item: (first + k) as u32,
                        });
                    }
                }
            }
        }
        for (i, &n) in parents.iter().enumerate() {
            if n != u32::from(i > 0) {
                return Err(BvhFault::Parents {
                    node: i as u32,
                    parents: n,
                });
            }
        }
        for (i, &n) in leaves.iter().enumerate() {
            if n != 1 {
                return Err(BvhFault::Leaves {
                    position: i as u32,
                    leaves: n,
                });
            }
        }
        let mut seen = vec![false; self.triangles.len()];
        for t in &self.triangles {
            match seen.get_mut(t.primitive as usize) {
                Some(s) if !*s => *s = true,
                _ => {
                    return Err(BvhFault::Primitive {
                        primitive: t.primitive,
                    });
                }
            }
        }
        let depth = self.depth();
        if depth > BVH_STACK {
            return Err(BvhFault::Depth { depth });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raytwin_cpu::ray::bvh::{BVH_MISS, bvh_any, bvh_closest};
    use raytwin_cpu::ray::ray::Ray;

    /// An n by n sheet over the unit square with hills.
    fn sheet(n: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let mut positions = Vec::new();
        let mut indices = Vec::new();
        for y in 0..=n {
            for x in 0..=n {
                let (u, v) = (x as f32 / n as f32, y as f32 / n as f32);
                positions.push(Vec3::new(u, v, 0.1 * (u * 9.0).sin() * (v * 7.0).cos()));
            }
        }
        let at = |x: u32, y: u32| y * (n + 1) + x;
        for y in 0..n {
            for x in 0..n {
                indices.push([at(x, y), at(x + 1, y), at(x, y + 1)]);
                indices.push([at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]);
            }
        }
        (positions, indices)
    }

    fn down(x: f32, y: f32) -> Ray {
        Ray {
            origin: Vec3::new(x, y, 2.0),
            direction: -Vec3::Z,
            t_min: 0.0,
            t_max: f32::MAX,
        }
    }

    #[test]
    fn every_quality_is_valid_and_hits() {
        let (p, t) = sheet(40);
        for quality in BuildQuality::ALL {
            let bvh = Bvh::build(&p, &t, quality).unwrap();
            assert_eq!(bvh.validate(), Ok(()));
            assert_eq!(bvh.triangles.len(), t.len());
            for i in 0..400 {
                let (x, y) = ((i % 20) as f32 / 20.0, (i / 20) as f32 / 20.0);
                assert_ne!(bvh_closest(&bvh.view(), down(x, y)).primitive, BVH_MISS);
            }
        }
    }

    #[test]
    fn no_triangles_no_hits() {
        let bvh = Bvh::build(&[], &[], BuildQuality::Medium).unwrap();
        assert_eq!(bvh.validate(), Ok(()));
        let hit = bvh_closest(&bvh.view(), down(0.0, 0.0));
        assert_eq!(hit.primitive, BVH_MISS);
        assert_eq!(bvh_any(&bvh.view(), down(0.0, 0.0)), 0);
        assert_eq!(
            (bvh.node_words().len(), bvh.triangle_words().len()),
            (8, 12)
        );
    }

    #[test]
    fn one_triangle_and_many_copies() {
        let p = [Vec3::ZERO, Vec3::X, Vec3::Y];
        for n in [1usize, 2, 3, 5, 1000] {
            let bvh = Bvh::build(&p, &vec![[0, 1, 2]; n], BuildQuality::Medium).unwrap();
            assert_eq!(bvh.validate(), Ok(()));
            let hit = bvh_closest(&bvh.view(), down(0.25, 0.25));
            assert_eq!((hit.t, hit.primitive), (2.0, 0));
        }
        let bvh = Bvh::build(&[Vec3::ONE], &[[0; 3]; 9], BuildQuality::Fastest).unwrap();
        assert_eq!(bvh.validate(), Ok(()));
    }

    #[test]
    fn bad_meshes_name_the_triangle() {
        let (mut p, mut t) = sheet(2);
        t[3][1] = 99;
        assert_eq!(
            Bvh::build(&p, &t, BuildQuality::Fast),
            Err(BvhError::IndexOutOfRange {
                triangle: 3,
                index: 99,
                vertices: 9
            })
        );
        t[3][1] = 0;
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            p[8].y = bad;
            let e = Bvh::build(&p, &t, BuildQuality::Fast).unwrap_err();
            assert!(
                matches!(
                    e,
                    BvhError::NotFinite {
                        triangle: 7,
                        index: 8,
                        ..
                    }
                ),
                "{e}"
            );
        }
        p[8].y = 1e12;
        let e = Bvh::build(&p, &t, BuildQuality::Fast).unwrap_err();
        assert!(matches!(e, BvhError::TooFar { triangle: 7, .. }), "{e}");
        assert!(e.to_string().contains("scale the mesh down"));
    }

    #[test]
    fn refit_is_rebuild() {
        let (before, indices) = sheet(24);
        let mut state = 7;
        let mut random = || {
            state = pcg_hash(state);
            (state >> 8) as f32 / 16_777_216.0 - 0.5
        };
        let after: Vec<Vec3> = before
            .iter()
            .map(|p| *p * 3.0 + 0.3 * Vec3::new(random(), random(), random()))
            .collect();
        let bits = |hit: raytwin_cpu::ray::bvh::BvhHit| {
            ([hit.t, hit.u, hit.v].map(f32::to_bits), hit.primitive)
        };
        for quality in BuildQuality::ALL {
            let mut tree = Bvh::build(&before, &indices, quality).expect("a sheet");
            let rebuilt = Bvh::build(&after, &indices, quality).expect("a sheet");
            tree.refit(&after, &indices).expect("the same triangles");
            assert_eq!(tree.validate(), Ok(()));
            let mut hits = 0;
            for i in 0..4000 {
                let ray = down(3.0 * (i % 63) as f32 / 62.0, 3.0 * (i / 63) as f32 / 63.0);
                let truth = bvh_closest(&rebuilt.view(), ray);
                assert_eq!(bits(bvh_closest(&tree.view(), ray)), bits(truth));
                hits += usize::from(truth.primitive != BVH_MISS);
            }
            assert!(hits > 2000, "{hits}");
            // A mesh that does not fit changes nothing.
            let was = tree.clone();
            let mut bad = before.clone();
            bad[30].y = f32::NAN;
            assert!(matches!(
                tree.refit(&bad, &indices),
                Err(BvhError::NotFinite { index: 30, .. })
            ));
            assert_eq!(
                tree.refit(&before, &indices[1..]),
                Err(BvhError::Refit {
                    given: indices.len() - 1,
                    built: indices.len(),
                })
            );
            assert!(tree.refit(&before[..9], &indices).is_err());
            assert!(tree == was);
        }
        // Broken trees neither panic nor hang.
        let mut broken = Bvh::build(&before, &indices, BuildQuality::Fast).expect("a sheet");
        broken.nodes[0].first = u32::MAX;
        broken.nodes[1].count = u32::MAX;
        broken.refit(&after, &indices).expect("the same triangles");
        broken.triangles[0].primitive = u32::MAX;
        assert!(broken.refit(&after, &indices).is_err());
    }

    #[test]
    fn deep_trees_are_rebuilt() {
        // Each triangle twice the size of the one before: obvhs nests them one
        // by one.
        let mut p = Vec::new();
        let mut t = Vec::new();
        for i in 0..100 {
            let s = 2f32.powi(i - 62);
            let k = p.len() as u32;
            p.extend([Vec3::X * s, Vec3::Y * s, Vec3::Z * s]);
            t.push([k, k + 1, k + 2]);
        }
        let boxes: Vec<_> = p
            .chunks(3)
            .map(|v| Aabb::from_points(&[v[0].into(), v[1].into(), v[2].into()]))
            .collect();
        let plain = Shape::by_obvhs(&boxes, BuildQuality::Fastest);
        assert!(plain.depth() > BVH_STACK, "{}", plain.depth());
        let bvh = Bvh::build(&p, &t, BuildQuality::Fastest).unwrap();
        assert_eq!(bvh.validate(), Ok(()));
        assert!(bvh.depth() < 10);
        let (p, t) = sheet(30);
        let boxes: Vec<_> = t
            .iter()
            .map(|i| Aabb::from_points(&i.map(|i| p[i as usize].into())))
            .collect();
        let depth = Shape::by_median(&boxes).depth();
        assert_eq!(depth, 9);
    }

    #[test]
    fn validation_sees_faults() {
        let (p, t) = sheet(8);
        let good = Bvh::build(&p, &t, BuildQuality::Fast).unwrap();
        let mut b = good.clone();
        b.nodes[0].first = 0;
        assert!(matches!(b.validate(), Err(BvhFault::Child { node: 0, .. })));
        let mut b = good.clone();
        b.nodes[1].max.x = -1.0;
        assert!(matches!(b.validate(), Err(BvhFault::Box { .. })));
        let mut b = good.clone();
        b.triangles[3].primitive = b.triangles[4].primitive;
        assert!(matches!(b.validate(), Err(BvhFault::Primitive { .. })));
        let mut b = good.clone();
        let leaf = b.nodes.iter().position(|n| n.count > 0).unwrap();
        b.nodes[leaf].count = 10_000;
        assert!(matches!(b.validate(), Err(BvhFault::Range { .. })));
        let mut b = good.clone();
        b.triangles[0].a.z += 1.0;
        assert!(matches!(b.validate(), Err(BvhFault::Box { .. })));
    }

    #[test]
    fn broken_trees_end() {
        let (p, t) = sheet(8);
        let good = Bvh::build(&p, &t, BuildQuality::Fast).unwrap();
        let rays: Vec<_> = (0..64)
            .map(|i| down((i % 8) as f32 / 8.0, (i / 8) as f32 / 8.0))
            .collect();
        let mut state = 7u32;
        let mut word = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 16) ^ state
        };
        let n = good.nodes.len() as u32;
        for round in 0..60 {
            let mut b = good.clone();
            for _ in 0..1 + round % 8 {
                let i = (word() % n) as usize;
                let value = [word(), word() % n, 0, u32::MAX, n - 1][(word() % 5) as usize];
                match word() % 3 {
                    0 => b.nodes[i].first = value,
                    1 => b.nodes[i].count = value % 20,
                    _ => b.nodes[i].min.x = f32::from_bits(value),
                }
            }
            for &r in &rays[round % 56..round % 56 + 8] {
                let hit = bvh_closest(&b.view(), r);
                assert!(hit.primitive == BVH_MISS || (hit.primitive as usize) < t.len());
                let any = bvh_any(&b.view(), r);
                assert!(any <= 1);
            }
        }
        // Every node its own parent, and a chain deeper than the stack.
        let mut b = good.clone();
        for (i, node) in b.nodes.iter_mut().enumerate() {
            node.count = 0;
            node.first = i as u32;
        }
        assert_eq!(bvh_closest(&b.view(), rays[9]).primitive, BVH_MISS);
        let root = good.nodes[0];
        b.nodes = (0..401)
            .map(|i| BvhNode {
                first: if i == 0 { 1 } else { (i + 1) & !1 | 1 },
                count: 0,
                ..root
            })
            .collect();
        let hit = bvh_closest(&b.view(), rays[9]);
        assert_eq!(hit.primitive, BVH_MISS);
    }

    /// A flat wall of equal squares along the axes costs no more than a turned
    /// one, wherever it is.
    #[test]
    fn equal_squares_make_no_comb() {
        let cost = |turn: f32, at: f32, size: f32, quality| {
            let mut positions = Vec::new();
            let mut indices = Vec::new();
            for i in 0..64u32 {
                for j in 0..64u32 {
                    let first = positions.len() as u32;
                    for (x, y) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
                        let flat = Vec3::new((i + x) as f32, (j + y) as f32, 0.0) * size;
                        positions.push(glam::Quat::from_rotation_y(turn) * flat + Vec3::splat(at));
                    }
                    indices.extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|k| k + first)));
                }
            }
            let bvh = Bvh::build(&positions, &indices, quality).expect("a wall");
            let area = |n: &BvhNode| {
                let d = n.max - n.min;
                d.x * d.y + d.y * d.z + d.z * d.x
            };
            let inner = bvh.nodes.iter().filter(|n| n.count == 0);
            inner.map(area).sum::<f32>() / area(&bvh.nodes[0])
        };
        for quality in BuildQuality::ALL {
            let turned = cost(0.7, 0.0, 1.0, quality);
            for (at, size) in [(0.0, 1.0), (5000.0, 1.0), (5000.0, 1.0 / 64.0)] {
                let along = cost(0.0, at, size, quality);
                assert!(along < 1.5 * turned, "{quality:?} {at}: {along} {turned}");
            }
        }
    }
}
