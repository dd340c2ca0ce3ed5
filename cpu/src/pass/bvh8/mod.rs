//! Closest hit and any hit through a tree of eight children a node, eight
//! boxes or triangles at a time: [`ray/bvh`](crate::ray::bvh) for the
//! processor's vector instructions, with the same hits, bit for bit.
//!
//! The instructions are chosen at run time ([`Level`]), so a plain release
//! build has them. They are why this module has unsafe code (the
//! crate's other place is `simd`).

mod collapse;
mod group;
pub mod instances;
mod lanes;
mod walk;

pub use collapse::check_nodes;

use std::fmt;

use glam::Vec3;

use crate::math::vector::{vec3_cross, vec3_dot};
use crate::ray::bvh::{BVH_MISS, BVH_STACK, BvhHit, BvhView};
use crate::ray::ray::Ray;
use crate::ray::triangle::TRIANGLE_PAD;
use lanes::Portable;

/// Triangles in a block.
const BLOCK: usize = 8;

/// In a child's number: it is a block, not a node.
const LEAF: u32 = 1 << 31;

/// Postponed children: seven for each level.
const STACK: usize = 7 * BVH_STACK + 1;

/// A plane of a child that is not there: no ray is inside such a box.
const NOWHERE: f32 = f32::from_bits((127 + 126) << 23);

/// Eight boxes, plane by plane: 224 bytes, four cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Node {
    /// By axis: the lower planes, the upper planes.
    planes: [[[f32; 8]; 2]; 3],
    /// A node's index, or [`LEAF`] and a block's.
    children: [u32; 8],
}

impl Node {
    fn set(&mut self, slot: usize, low: Vec3, high: Vec3, child: u32) {
        for axis in 0..3 {
            self.planes[axis][0][slot] = low[axis];
            self.planes[axis][1][slot] = high[axis];
        }
        self.children[slot] = child;
    }

    /// The box around all children; those that are not there add nothing.
    fn bounds(&self) -> (Vec3, Vec3) {
        let low = |axis: usize| self.planes[axis][0].into_iter().fold(f32::MAX, f32::min);
        let high = |axis: usize| self.planes[axis][1].into_iter().fold(f32::MIN, f32::max);
        (
            Vec3::new(low(0), low(1), low(2)),
            Vec3::new(high(0), high(1), high(2)),
        )
    }
}

/// Which sides of a triangle a ray can hit.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Faces, triangle_box};
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
/// let (min, max) = triangle_box(a, b, c);
/// let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
/// let nodes = [BvhNode { min, first: 0, max, count: 1 }];
/// let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// // The triangle is seen from its front, then from behind.
/// assert!(tree.any_of(&ray, Faces::Front));
/// let behind =
///     Ray { origin: Vec3::new(0.25, 0.5, -2.0), direction: Vec3::Z, ..ray };
/// assert!(tree.any(&behind) && !tree.any_of(&behind, Faces::Front));
/// # Ok::<(), Bvh8Fault>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Faces {
    /// Both.
    #[default]
    Both,
    /// Those whose normal `(b - a) × (c - a)` is against the ray, so that the
    /// vertices are seen counter-clockwise.
    Front,
}

/// Which triangles a ray can hit.
///
/// The default is all of them. [`Faces`] alone turn into a filter, so
/// `closest_of(&ray, Faces::Front)` is enough where there are no masks.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Filter, triangle_box};
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
/// let (min, max) = triangle_box(a, b, c);
/// let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
/// let nodes = [BvhNode { min, first: 0, max, count: 1 }];
/// let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// // Only triangles with bit 2; this one has bit 1.
/// let filter = Filter { mask: 4, masks: &[2], ..Filter::ALL };
/// assert!(!tree.any_of(&ray, filter));
/// # Ok::<(), Bvh8Fault>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Filter<'a> {
    /// The sides that can be hit.
    pub faces: Faces,
    /// A triangle is there for the ray if its own mask shares a bit with this.
    pub mask: u32,
    /// By triangle of the mesh; one beyond the end has all bits. Where this is
    /// empty nothing is looked up.
    pub masks: &'a [u32],
}

impl Filter<'_> {
    /// Everything.
    pub const ALL: Self = Self {
        faces: Faces::Both,
        mask: u32::MAX,
        masks: &[],
    };

    /// Whether the masks let a triangle through.
    #[inline(always)]
    fn sees(&self, primitive: u32) -> bool {
        let own = self.masks.get(primitive as usize);
        own.copied().unwrap_or(u32::MAX) & self.mask != 0
    }
}

impl Default for Filter<'_> {
    fn default() -> Self {
        Filter::ALL
    }
}

impl From<Faces> for Filter<'_> {
    fn from(faces: Faces) -> Self {
        Self {
            faces,
            ..Filter::ALL
        }
    }
}

/// Why a tree could not be refitted.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, RefitError, triangle_box};
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
///
/// let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
/// let (min, max) = triangle_box(a, b, c);
/// let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
/// let nodes = [BvhNode { min, first: 0, max, count: 1 }];
/// let mut tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
/// // A mesh with fewer vertices than its triangle asks for.
/// let error = tree.refit(&[a, b], &[[0, 1, 2]]);
/// assert_eq!(error, Err(RefitError { primitive: 0 }));
/// # Ok::<(), Bvh8Fault>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RefitError {
    /// The triangle that has no indices, no vertex, or one that is not finite
    /// or beyond 2^39.
    pub primitive: u32,
}

impl fmt::Display for RefitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "triangle {} lacks indices or a vertex, or a vertex is not finite or beyond \
             {COORDINATE_MAX:e}: refit with the mesh that the tree was built for",
            self.primitive
        )
    }
}

impl std::error::Error for RefitError {}

/// Largest magnitude of a coordinate, 2^39: see [`Ray`].
const COORDINATE_MAX: f32 = f32::from_bits((127 + 39) << 23);

/// The normal that `triangle_intersect_sheared` takes: from the two shorter
/// edges, the same operations on the same numbers.
fn normal(a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let length_ab = vec3_dot(ab, ab);
    let length_bc = vec3_dot(bc, bc);
    let length_ca = vec3_dot(ca, ca);
    if length_ca >= length_ab && length_ca >= length_bc {
        vec3_cross(ab, bc)
    } else if length_ab >= length_bc {
        vec3_cross(bc, ca)
    } else {
        vec3_cross(ca, ab)
    }
}

/// Eight triangles, coordinate by coordinate: seven cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Block {
    /// By vertex, then by axis. Unused places have three equal vertices, which
    /// no ray hits.
    vertices: [[[f32; BLOCK]; 3]; 3],
    /// The triangles' indices in the mesh, [`BVH_MISS`] in unused places.
    primitives: [u32; BLOCK],
    /// The triangles' normals, by axis.
    normals: [[f32; BLOCK]; 3],
    /// By how much the products in `walk::behind` may err for the triangles'
    /// sizes alone.
    slack: f32,
}

/// 256 roundings: see `walk::behind`.
const SLACK_SIZE: f32 = 1.0 / 65_536.0;
/// 2^-120, above what numbers below the normal ones lose.
const SLACK_LEAST: f32 = f32::from_bits((127 - 120) << 23);

impl Block {
    fn set(&mut self, place: usize, corners: [Vec3; 3], primitive: u32) {
        for (vertex, at) in self.vertices.iter_mut().zip(corners) {
            for axis in 0..3 {
                vertex[axis][place] = at[axis];
            }
        }
        let [a, b, c] = corners;
        let normal = normal(a, b, c);
        for axis in 0..3 {
            self.normals[axis][place] = normal[axis];
        }
        let sides = [b - a, c - b, a - c].map(|side| side.abs().max_element());
        let size = sides[0].max(sides[1]).max(sides[2]);
        let slack = size * size * size * SLACK_SIZE + SLACK_LEAST;
        self.slack = self.slack.max(slack);
        self.primitives[place] = primitive;
    }
}

/// What kind of instructions a walk uses. The hits are the same.
///
/// ```
/// use raytwin_cpu::pass::bvh8::Level;
///
/// let best = Level::best();
/// assert!(Level::all().contains(&best));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Level {
    /// Every level that this processor has, slowest first.
    ///
    /// ```
    /// use raytwin_cpu::pass::bvh8::Level;
    ///
    /// // The portable level is there on every processor.
    /// assert_eq!(Level::all()[0].name(), "portable");
    /// ```
    #[must_use]
    pub fn all() -> Vec<Self> {
        #[allow(unused_mut)]
        let mut all = vec![Self(Kind::Portable)];
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt")
        {
            all.push(Self(Kind::Avx2));
            if is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512dq")
            {
                all.push(Self(Kind::Avx512));
            }
        }
        all
    }

    /// The fastest level that this processor has.
    ///
    /// ```
    /// use raytwin_cpu::pass::bvh8::Level;
    ///
    /// assert_eq!(Level::all().last(), Some(&Level::best()));
    /// ```
    #[must_use]
    pub fn best() -> Self {
        Self::all().pop().unwrap_or(Self(Kind::Portable))
    }

    /// A short name.
    ///
    /// ```
    /// use raytwin_cpu::pass::bvh8::Level;
    ///
    /// for level in Level::all() {
    ///     println!("{}", level.name());
    /// }
    /// assert!(["portable", "AVX2", "AVX-512"].contains(&Level::best().name()));
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self.0 {
            Kind::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "AVX-512",
        }
    }
}

/// Why a binary tree cannot be collapsed.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault};
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhView};
///
/// // A node that says it is its own child.
/// let node = BvhNode { min: Vec3::ZERO, first: 0, max: Vec3::ONE, count: 0 };
/// let view = BvhView { nodes: &[node], triangles: &[] };
/// let fault = Bvh8::new(view).unwrap_err();
/// assert_eq!(fault, Bvh8Fault::Child { node: 0, child: 0 });
/// println!("{fault}");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bvh8Fault {
    /// A child index outside the tree, or not above its parent's.
    Child {
        /// The inner node.
        node: u32,
        /// Index of its first child.
        child: u32,
    },
    /// A node that is nobody's child, or more than one's.
    Parents {
        /// The node.
        node: u32,
    },
    /// A leaf's triangles, or instances, outside the list.
    Range {
        /// The leaf.
        node: u32,
    },
    /// A box that is not finite, empty, or not within its parent's.
    Box {
        /// The node.
        node: u32,
    },
    /// More inner levels above this node than [`BVH_STACK`].
    Depth {
        /// The node.
        node: u32,
    },
    /// An instance of a mesh that is not there.
    Instance {
        /// Its position in the list.
        instance: u32,
    },
}

impl fmt::Display for Bvh8Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Child { node, child } => write!(
                f,
                "node {node}: child {child} is outside the tree or before its parent"
            ),
            Self::Parents { node } => write!(f, "node {node} has no parent, or several"),
            Self::Range { node } => write!(f, "leaf {node}: its items are outside the list"),
            Self::Box { node } => {
                write!(
                    f,
                    "node {node}: its box is not finite, empty, or not within its parent's"
                )
            }
            Self::Instance { instance } => {
                write!(f, "the instance at position {instance} is of no mesh")
            }
            Self::Depth { node } => {
                write!(
                    f,
                    "node {node}: more than {BVH_STACK} inner levels above it"
                )
            }
        }
    }
}

impl std::error::Error for Bvh8Fault {}

/// A tree of eight children a node.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
/// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
/// let (min, max) = triangle_box(a, b, c);
/// let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
/// let nodes = [BvhNode { min, first: 0, max, count: 1 }];
/// let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// assert_eq!(tree.closest(&ray).primitive, 0);
/// # Ok::<(), Bvh8Fault>(())
/// ```
#[derive(Clone, Debug)]
pub struct Bvh8 {
    nodes: Vec<Node>,
    blocks: Vec<Block>,
    root: u32,
    level: Level,
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn walk_avx2<const ANY: bool>(bvh: &Bvh8, ray: &Ray, filter: Filter<'_>) -> BvhHit {
    // SAFETY: this function is only called where its features are.
    let l = unsafe { lanes::x86::Avx2::assume() };
    walk::walk::<_, ANY>(l, bvh, ray, filter)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn walk_avx512<const ANY: bool>(bvh: &Bvh8, ray: &Ray, filter: Filter<'_>) -> BvhHit {
    // SAFETY: this function is only called where its features are.
    let l = unsafe { lanes::x86::Avx512::assume() };
    walk::walk::<_, ANY>(l, bvh, ray, filter)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn group_avx2<const ANY: bool>(bvh: &Bvh8, rays: &[Ray], filter: Filter<'_>, hits: &mut [BvhHit]) {
    // SAFETY: this function is only called where its features are.
    let l = unsafe { lanes::x86::Avx2::assume() };
    group::group::<_, ANY>(l, bvh, rays, filter, hits);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn group_avx512<const ANY: bool>(
    bvh: &Bvh8,
    rays: &[Ray],
    filter: Filter<'_>,
    hits: &mut [BvhHit],
) {
    // SAFETY: this function is only called where its features are.
    let l = unsafe { lanes::x86::Avx512::assume() };
    group::group::<_, ANY>(l, bvh, rays, filter, hits);
}

/// A triangle's box with the margin of the watertight traversal.
///
/// Four times the margin that the leaf test applies to the triangle's own box,
/// and then outwards to the next number, so that rounding on the way cannot
/// make the leaf test's box the larger one.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::pass::bvh8::triangle_box;
///
/// // The triangle's own box, and a little more on every side.
/// let (min, max) = triangle_box(Vec3::ZERO, Vec3::X, Vec3::Y);
/// assert!(min.max_element() < 0.0 && min.min_element() > -1e-5);
/// assert!(max.z > 0.0 && max.x > 1.0 && max.x < 1.00001);
/// ```
#[inline]
#[must_use]
pub fn triangle_box(a: Vec3, b: Vec3, c: Vec3) -> (Vec3, Vec3) {
    let low = a.min(b).min(c);
    let high = a.max(b).max(c);
    let extent = high - low;
    let pad = 4.0 * TRIANGLE_PAD * extent.x.max(extent.y).max(extent.z);
    let down = |v: f32| (v - pad).next_down();
    let up = |v: f32| (v + pad).next_up();
    (
        Vec3::new(down(low.x), down(low.y), down(low.z)),
        Vec3::new(up(high.x), up(high.y), up(high.z)),
    )
}

/// Rays that one task of a parallel batch takes.
#[cfg(feature = "rayon")]
const BATCH: usize = 512;

fn found(hits: &[BvhHit]) -> Vec<bool> {
    hits.iter().map(|h| h.primitive != BVH_MISS).collect()
}

impl Bvh8 {
    /// Collapses a binary tree.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView, bvh_closest};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// let (min, max) = triangle_box(a, b, c);
    /// let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// // The same hit as in the binary tree.
    /// let binary =
    ///     bvh_closest(&BvhView { nodes: &nodes, triangles: &triangles }, ray);
    /// assert_eq!(tree.closest(&ray), binary);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    ///
    /// # Errors
    /// The first fault found in the tree: indices outside, cycles, nodes with
    /// several parents or none, boxes that are not finite or do not contain
    /// those below, too many levels. That a leaf's box contains its triangles
    /// with their margin is the builder's to keep.
    pub fn new(tree: BvhView<'_>) -> Result<Self, Bvh8Fault> {
        collapse::collapse(tree)
    }

    /// The same tree, walked with other instructions.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Level, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let hit = tree.closest(&ray);
    /// // All levels give the same hit.
    /// for level in Level::all() {
    ///     assert_eq!(tree.clone().with_level(level).closest(&ray), hit);
    /// }
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn with_level(self, level: Level) -> Self {
        Self { level, ..self }
    }

    /// The instructions that walks use: at first the best there are.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Level, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// assert_eq!(tree.level(), Level::best());
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn level(&self) -> Level {
        self.level
    }

    /// Bytes of nodes and triangles.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// // One block of eight triangles, of which one is used.
    /// assert_eq!(tree.bytes(), 448);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn bytes(&self) -> usize {
        std::mem::size_of_val(&*self.nodes) + std::mem::size_of_val(&*self.blocks)
    }

    /// The mean number of children of a node, and of triangles of a block.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// // No node; a block with one triangle.
    /// let (_, triangles_of_block) = tree.fill();
    /// assert_eq!(triangles_of_block, 1.0);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn fill(&self) -> (f32, f32) {
        let children = self.nodes.iter().flat_map(|n| n.planes[0][0]);
        let children = children.filter(|&low| low != NOWHERE).count();
        let triangles = self.blocks.iter().flat_map(|b| b.primitives);
        let triangles = triangles.filter(|&p| p != BVH_MISS).count();
        (
            children as f32 / self.nodes.len().max(1) as f32,
            triangles as f32 / self.blocks.len().max(1) as f32,
        )
    }

    #[inline(always)]
    fn walk<const ANY: bool>(&self, ray: &Ray, filter: Filter<'_>) -> BvhHit {
        match self.level.0 {
            Kind::Portable => walk::walk::<_, ANY>(Portable, self, ray, filter),
            // SAFETY: a `Level` is only made by `Level::all`, which has asked
            // the processor for each of the features.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { walk_avx2::<ANY>(self, ray, filter) },
            // SAFETY: the same.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe { walk_avx512::<ANY>(self, ray, filter) },
        }
    }

    /// The closest triangle that a ray meets within its range, ends included:
    /// [`bvh_closest`](crate::ray::bvh::bvh_closest), every bit of it.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let hit = tree.closest(&ray);
    /// assert_eq!((hit.primitive, hit.t, hit.u, hit.v), (0, 2.0, 0.25, 0.5));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn closest(&self, ray: &Ray) -> BvhHit {
        self.walk::<false>(ray, Filter::ALL)
    }

    /// Whether the ray meets any triangle within its range, ends included.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// assert!(tree.any(&ray));
    /// // A light at distance 1 is not hidden by it.
    /// assert!(!tree.any(&Ray { t_max: 1.0, ..ray }));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn any(&self, ray: &Ray) -> bool {
        self.walk::<true>(ray, Filter::ALL).primitive != BVH_MISS
    }

    /// [`Self::closest`] among the triangles that the filter lets through.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Faces, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BVH_MISS, BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// assert_eq!(tree.closest_of(&ray, Faces::Front), tree.closest(&ray));
    /// // From behind, its front is not hit.
    /// let behind =
    ///     Ray { origin: Vec3::new(0.25, 0.5, -2.0), direction: Vec3::Z, ..ray };
    /// assert_eq!(tree.closest_of(&behind, Faces::Front).primitive, BVH_MISS);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn closest_of<'a>(&self, ray: &Ray, filter: impl Into<Filter<'a>>) -> BvhHit {
        self.walk::<false>(ray, filter.into())
    }

    /// [`Self::any`] among the triangles that the filter lets through.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Filter, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let masks = [0b10];
    /// let seen =
    ///     |mask| tree.any_of(&ray, Filter { mask, masks: &masks, ..Filter::ALL });
    /// assert!(seen(0b11) && !seen(0b01));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn any_of<'a>(&self, ray: &Ray, filter: impl Into<Filter<'a>>) -> bool {
        self.walk::<true>(ray, filter.into()).primitive != BVH_MISS
    }

    fn each<const ANY: bool>(&self, rays: &[Ray], filter: Filter<'_>) -> Vec<BvhHit> {
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            rays.par_iter()
                .with_min_len(BATCH)
                .map(|ray| self.walk::<ANY>(ray, filter))
                .collect()
        }
        #[cfg(not(feature = "rayon"))]
        rays.iter()
            .map(|ray| self.walk::<ANY>(ray, filter))
            .collect()
    }

    /// [`Self::closest`] of each ray, in parallel with the feature `rayon`.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BVH_MISS, BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let away = Ray { direction: Vec3::Z, ..ray };
    /// let hits = tree.closest_many(&[ray, away]);
    /// assert_eq!((hits[0].primitive, hits[1].primitive), (0, BVH_MISS));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn closest_many(&self, rays: &[Ray]) -> Vec<BvhHit> {
        self.each::<false>(rays, Filter::ALL)
    }

    /// [`Self::any`] of each ray, in parallel with the feature `rayon`.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let away = Ray { direction: Vec3::Z, ..ray };
    /// assert_eq!(tree.any_many(&[ray, away]), [true, false]);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn any_many(&self, rays: &[Ray]) -> Vec<bool> {
        found(&self.each::<true>(rays, Filter::ALL))
    }

    /// [`Self::closest_of`] of each ray, in parallel with the feature `rayon`.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Faces, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BVH_MISS, BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let behind =
    ///     Ray { origin: Vec3::new(0.25, 0.5, -2.0), direction: Vec3::Z, ..ray };
    /// let hits = tree.closest_many_of(&[ray, behind], Faces::Front);
    /// assert_eq!((hits[0].primitive, hits[1].primitive), (0, BVH_MISS));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn closest_many_of<'a>(&self, rays: &[Ray], filter: impl Into<Filter<'a>>) -> Vec<BvhHit> {
        self.each::<false>(rays, filter.into())
    }

    /// [`Self::any_of`] of each ray, in parallel with the feature `rayon`.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Faces, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let behind =
    ///     Ray { origin: Vec3::new(0.25, 0.5, -2.0), direction: Vec3::Z, ..ray };
    /// assert_eq!(tree.any_many_of(&[ray, behind], Faces::Front), [true, false]);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn any_many_of<'a>(&self, rays: &[Ray], filter: impl Into<Filter<'a>>) -> Vec<bool> {
        found(&self.each::<true>(rays, filter.into()))
    }

    fn group<const ANY: bool>(&self, rays: &[Ray], filter: Filter<'_>, hits: &mut [BvhHit]) {
        match self.level.0 {
            Kind::Portable => group::group::<_, ANY>(Portable, self, rays, filter, hits),
            // SAFETY: as in `walk`.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { group_avx2::<ANY>(self, rays, filter, hits) },
            // SAFETY: as in `walk`.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe { group_avx512::<ANY>(self, rays, filter, hits) },
        }
    }

    fn groups<const ANY: bool>(&self, rays: &[Ray], filter: Filter<'_>) -> Vec<BvhHit> {
        const NONE: BvhHit = BvhHit {
            t: 0.0,
            u: 0.0,
            v: 0.0,
            primitive: BVH_MISS,
        };
        let mut hits = vec![NONE; rays.len()];
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            hits.par_chunks_mut(group::GROUP)
                .zip(rays.par_chunks(group::GROUP))
                .with_min_len(BATCH / group::GROUP)
                .for_each(|(hits, rays)| self.group::<ANY>(rays, filter, hits));
        }
        #[cfg(not(feature = "rayon"))]
        for (hits, rays) in hits.chunks_mut(group::GROUP).zip(rays.chunks(group::GROUP)) {
            self.group::<ANY>(rays, filter, hits);
        }
        hits
    }

    /// [`Self::closest`] of each ray, for rays of which neighbours in the list
    /// go much the same way, as from a camera: sixteen at a time walk the tree
    /// together. The same hits; slower than [`Self::closest_many`] for rays
    /// that part.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// // Neighbouring pixels of a camera.
    /// let rays: Vec<_> = (0..40)
    ///     .map(|i| Ray { origin: ray.origin + 0.01 * i as f32 * Vec3::X, ..ray })
    ///     .collect();
    /// assert_eq!(tree.closest_coherent(&rays), tree.closest_many(&rays));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn closest_coherent(&self, rays: &[Ray]) -> Vec<BvhHit> {
        self.groups::<false>(rays, Filter::ALL)
    }

    /// [`Self::any`] of each ray, for rays as in [`Self::closest_coherent`].
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let rays: Vec<_> = (0..40)
    ///     .map(|i| Ray { origin: ray.origin + 0.1 * i as f32 * Vec3::X, ..ray })
    ///     .collect();
    /// let hidden = tree.any_coherent(&rays);
    /// assert!(hidden[0] && !hidden[39]);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn any_coherent(&self, rays: &[Ray]) -> Vec<bool> {
        found(&self.groups::<true>(rays, Filter::ALL))
    }

    /// [`Self::closest_of`] of each ray, for rays as in
    /// [`Self::closest_coherent`].
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Faces, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let hits = tree.closest_coherent_of(&[ray; 40], Faces::Front);
    /// assert!(hits.iter().all(|hit| *hit == tree.closest(&ray)));
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn closest_coherent_of<'a>(
        &self,
        rays: &[Ray],
        filter: impl Into<Filter<'a>>,
    ) -> Vec<BvhHit> {
        self.groups::<false>(rays, filter.into())
    }

    /// [`Self::any_of`] of each ray, for rays as in [`Self::closest_coherent`].
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, Filter, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// let filter = Filter { mask: 1, masks: &[2], ..Filter::ALL };
    /// assert_eq!(tree.any_coherent_of(&[ray; 40], filter), [false; 40]);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    #[must_use]
    pub fn any_coherent_of<'a>(&self, rays: &[Ray], filter: impl Into<Filter<'a>>) -> Vec<bool> {
        found(&self.groups::<true>(rays, filter.into()))
    }

    /// Moves the triangles to other vertices, and the boxes with them; the
    /// tree's shape stays. The hits are those of a tree built anew; the more
    /// the mesh is deformed, the longer they take.
    ///
    /// ```
    /// use glam::Vec3;
    /// use raytwin_cpu::pass::bvh8::{Bvh8, Bvh8Fault, triangle_box};
    /// use raytwin_cpu::ray::bvh::{BvhNode, BvhTriangle, BvhView};
    /// use raytwin_cpu::ray::ray::Ray;
    ///
    /// # let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    /// # let (min, max) = triangle_box(a, b, c);
    /// # let triangles = [BvhTriangle { a, b, c, primitive: 0 }];
    /// # let nodes = [BvhNode { min, first: 0, max, count: 1 }];
    /// # let mut tree = Bvh8::new(BvhView { nodes: &nodes, triangles: &triangles })?;
    /// let ray = Ray {
    ///     origin: Vec3::new(0.25, 0.5, 2.0),
    ///     direction: Vec3::NEG_Z,
    ///     t_min: 0.0,
    ///     t_max: 9.0,
    /// };
    /// // The triangle moves up by 1, toward the ray.
    /// tree.refit(&[a + Vec3::Z, b + Vec3::Z, c + Vec3::Z], &[[0, 1, 2]]).unwrap();
    /// assert_eq!(tree.closest(&ray).t, 1.0);
    /// # Ok::<(), Bvh8Fault>(())
    /// ```
    ///
    /// # Errors
    /// A primitive without indices, an index without a vertex, or a vertex
    /// that is not finite or beyond 2^39. Then nothing is changed.
    pub fn refit(&mut self, positions: &[Vec3], indices: &[[u32; 3]]) -> Result<(), RefitError> {
        let corners = |primitive: u32| -> Result<[Vec3; 3], RefitError> {
            let error = RefitError { primitive };
            let triangle = indices.get(primitive as usize).ok_or(error)?;
            let mut out = [Vec3::ZERO; 3];
            for (corner, &index) in out.iter_mut().zip(triangle) {
                let p = *positions.get(index as usize).ok_or(error)?;
                if !p.is_finite() || p.abs().max_element() > COORDINATE_MAX {
                    return Err(error);
                }
                *corner = p;
            }
            Ok(out)
        };
        for &primitive in self.blocks.iter().flat_map(|b| &b.primitives) {
            if primitive != BVH_MISS {
                corners(primitive)?;
            }
        }
        let mut boxes = Vec::with_capacity(self.blocks.len());
        for block in &mut self.blocks {
            let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
            let primitives = block.primitives;
            block.slack = 0.0;
            for (k, primitive) in primitives.into_iter().enumerate() {
                if primitive == BVH_MISS {
                    continue;
                }
                let moved = corners(primitive)?;
                block.set(k, moved, primitive);
                let (l, h) = triangle_box(moved[0], moved[1], moved[2]);
                low = low.min(l);
                high = high.max(h);
            }
            boxes.push((low, high));
        }
        // A child comes after its parent.
        for i in (0..self.nodes.len()).rev() {
            for slot in 0..8 {
                if self.nodes[i].planes[0][0][slot] == NOWHERE {
                    continue;
                }
                let child = self.nodes[i].children[slot];
                let (low, high) = if child & LEAF == 0 {
                    self.nodes[child as usize].bounds()
                } else {
                    boxes[(child & !LEAF) as usize]
                };
                self.nodes[i].set(slot, low, high, child);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
