//! Closest hit and any hit through a tree of eight children a node, eight
//! boxes or triangles at a time.

mod collapse;
mod lanes;
mod walk;

use std::fmt;

use glam::Vec3;

use crate::ray::bvh::{BVH_MISS, BVH_STACK, BvhHit, BvhView};
use crate::ray::ray::Ray;
use lanes::Portable;

/// Triangles in a block.
const BLOCK: usize = 8;

/// In a child's number: it is a block, not a node.
const LEAF: u32 = 1 << 31;

/// Postponed children: seven for each level.
const STACK: usize = 7 * BVH_STACK + 1;

/// Eight boxes, plane by plane: 256 bytes.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Node {
    /// By axis: the lower planes, the upper planes.
    planes: [[[f32; 8]; 2]; 3],
    /// A node's index, or [`LEAF`] and a block's.
    children: [u32; 8],
    spare: [u32; 8],
}

impl Node {
    fn set(&mut self, slot: usize, low: Vec3, high: Vec3, child: u32) {
        for axis in 0..3 {
            self.planes[axis][0][slot] = low[axis];
            self.planes[axis][1][slot] = high[axis];
        }
        self.children[slot] = child;
    }
}

/// Eight triangles, coordinate by coordinate: 320 bytes.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Block {
    /// By vertex, then by axis. Unused places have three equal vertices, which
    /// no ray hits.
    vertices: [[[f32; BLOCK]; 3]; 3],
    primitives: [u32; BLOCK],
}

/// What kind of instructions a walk uses. The hits are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Level {
    /// Every level that this processor has, slowest first.
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
        }
        all
    }

    /// The fastest level that this processor has.
    #[must_use]
    pub fn best() -> Self {
        Self::all().pop().unwrap_or(Self(Kind::Portable))
    }

    /// A short name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self.0 {
            Kind::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "AVX2",
        }
    }
}

/// Why a binary tree cannot be collapsed.
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
    /// A leaf's triangles outside the list.
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
}

impl fmt::Display for Bvh8Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Child { node, child } => write!(
                f,
                "node {node}: child {child} is outside the tree or before its parent"
            ),
            Self::Parents { node } => write!(f, "node {node} has no parent, or several"),
            Self::Range { node } => write!(f, "leaf {node}: its triangles are outside the list"),
            Self::Box { node } => {
                write!(
                    f,
                    "node {node}: its box is not finite, empty, or not within its parent's"
                )
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
#[derive(Clone, Debug)]
pub struct Bvh8 {
    nodes: Vec<Node>,
    blocks: Vec<Block>,
    root: u32,
    level: Level,
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn walk_avx2<const ANY: bool>(bvh: &Bvh8, ray: &Ray) -> BvhHit {
    // SAFETY: this function is only called where AVX2 is.
    let l = unsafe { lanes::x86::Avx2::assume() };
    walk::walk::<_, ANY>(l, &bvh.nodes, &bvh.blocks, bvh.root, ray)
}

impl Bvh8 {
    /// Collapses a binary tree.
    ///
    /// # Errors
    /// The first fault found in the tree.
    pub fn new(tree: BvhView<'_>) -> Result<Self, Bvh8Fault> {
        collapse::collapse(tree)
    }

    /// The same tree, walked with other instructions.
    #[must_use]
    pub fn with_level(self, level: Level) -> Self {
        Self { level, ..self }
    }

    /// Bytes of nodes and triangles.
    #[must_use]
    pub fn bytes(&self) -> usize {
        std::mem::size_of_val(&*self.nodes) + std::mem::size_of_val(&*self.blocks)
    }

    /// Counts, for whoever tunes the collapse.
    #[must_use]
    pub fn statistics(&self) -> String {
        let children: usize = self
            .nodes
            .iter()
            .map(|n| {
                (0..8)
                    .filter(|&i| n.planes[0][0][i] <= n.planes[0][1][i])
                    .count()
            })
            .sum();
        let triangles: usize = self
            .blocks
            .iter()
            .map(|b| b.primitives.iter().filter(|&&p| p != BVH_MISS).count())
            .sum();
        format!(
            "{:.2} children a node, {:.2} triangles a block",
            children as f64 / self.nodes.len() as f64,
            triangles as f64 / self.blocks.len() as f64
        )
    }

    #[inline(always)]
    fn walk<const ANY: bool>(&self, ray: &Ray) -> BvhHit {
        match self.level.0 {
            Kind::Portable => {
                walk::walk::<_, ANY>(Portable, &self.nodes, &self.blocks, self.root, ray)
            }
            // SAFETY: a `Level` is only made by `Level::all`, which has asked
            // the processor for each of the features.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { walk_avx2::<ANY>(self, ray) },
        }
    }

    /// The closest triangle that a ray meets within its range, ends included.
    #[must_use]
    pub fn closest(&self, ray: Ray) -> BvhHit {
        self.walk::<false>(&ray)
    }

    /// Whether the ray meets any triangle within its range, ends included.
    #[must_use]
    pub fn any(&self, ray: Ray) -> bool {
        self.walk::<true>(&ray).primitive != BVH_MISS
    }
}
