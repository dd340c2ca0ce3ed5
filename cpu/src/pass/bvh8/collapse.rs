//! From a binary tree to nodes of eight children.

use glam::Vec3;

use super::{BLOCK, Block, Bvh8, Bvh8Fault, LEAF, Level, NOWHERE, Node};
use crate::ray::bvh::{BVH_STACK, BvhNode, BvhTriangle, BvhView};

/// What a node's test costs.
const NODE_COST: f32 = 1.0;

/// What a block's test costs. Measured from 0.5 to 1.5: less than a hundredth
/// of the speed lies between.
const LEAF_COST: f32 = 0.8;

const EMPTY_NODE: Node = Node {
    planes: [[[NOWHERE; 8], [-NOWHERE; 8]]; 3],
    children: [0; 8],
};

const EMPTY_BLOCK: Block = Block {
    vertices: [[[0.0; BLOCK]; 3]; 3],
    primitives: [u32::MAX; BLOCK],
    normals: [[0.0; BLOCK]; 3],
    slack: 0.0,
};

/// The cheapest way to stand for a subtree.
#[derive(Clone, Copy)]
struct Plan {
    /// Cost with at most `i + 1` roots.
    cost: [f32; 7],
    /// How many of `i + 2` roots go to the first child; 0: one root less does
    /// as well. The last entry is for a node of eight.
    split: [u8; 7],
    /// The most roots that are of use, up to 7.
    most: u8,
    /// As one root it is a leaf.
    leaf: bool,
    count: u32,
}

fn area(node: &BvhNode) -> f32 {
    let d = node.max - node.min;
    d.x * d.y + (d.y * d.z + d.z * d.x)
}

fn contains(node: &BvhNode, inner: &BvhNode) -> bool {
    node.min.cmple(inner.min).all() && node.max.cmpge(inner.max).all()
}

/// Checks the shape of a binary tree over so many items, so that no tree can
/// make a walk or the collapse loop or read outside: children exist, follow
/// their parent and have one, boxes are finite and contain those below, leaves
/// are within the list, and the depth.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::pass::bvh8::{Bvh8Fault, check_nodes};
/// use raytwin_cpu::ray::bvh::BvhNode;
///
/// let leaf = BvhNode { min: Vec3::ZERO, first: 0, max: Vec3::ONE, count: 4 };
/// assert_eq!(check_nodes(&[leaf], 4), Ok(()));
/// // The list has only three triangles.
/// assert_eq!(check_nodes(&[leaf], 3), Err(Bvh8Fault::Range { node: 0 }));
/// ```
///
/// # Errors
/// The first fault found, with its node.
pub fn check_nodes(nodes: &[BvhNode], items: usize) -> Result<(), Bvh8Fault> {
    let mut level = vec![0u8; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        let at = i as u32;
        if !(node.min.cmple(node.max).all() && node.min.is_finite() && node.max.is_finite()) {
            return Err(Bvh8Fault::Box { node: at });
        }
        // Level 0 is an orphan's, but for the root.
        if i > 0 && level[i] == 0 {
            return Err(Bvh8Fault::Parents { node: at });
        }
        let first = node.first as usize;
        if node.count > 0 {
            let end = first.saturating_add(node.count as usize);
            if end > items {
                return Err(Bvh8Fault::Range { node: at });
            }
            continue;
        }
        if first <= i || first.saturating_add(1) >= nodes.len() {
            return Err(Bvh8Fault::Child {
                node: at,
                child: node.first,
            });
        }
        let below = level[i] + 1;
        if usize::from(below) > BVH_STACK {
            return Err(Bvh8Fault::Depth { node: at });
        }
        for child in [first, first + 1] {
            if level[child] != 0 {
                return Err(Bvh8Fault::Parents { node: child as u32 });
            }
            level[child] = below;
            if !contains(node, &nodes[child]) {
                return Err(Bvh8Fault::Box { node: child as u32 });
            }
        }
    }
    Ok(())
}

/// Costs from the leaves upwards. After Ylitie, Karras, Laine: Efficient
/// Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs, HPG 2017,
/// section 3.1, with a leaf of up to eight triangles at the price of one test.
fn plan(nodes: &[BvhNode]) -> Vec<Plan> {
    const NONE: Plan = Plan {
        cost: [0.0; 7],
        split: [0; 7],
        most: 1,
        leaf: true,
        count: 0,
    };
    let mut plans = vec![NONE; nodes.len()];
    for i in (0..nodes.len()).rev() {
        let node = &nodes[i];
        let area = area(node);
        if node.count > 0 {
            plans[i] = Plan {
                cost: [area * LEAF_COST * (node.count as usize).div_ceil(BLOCK) as f32; 7],
                count: node.count,
                ..NONE
            };
            continue;
        }
        let (left, right) = (&plans[node.first as usize], &plans[node.first as usize + 1]);
        let mut out = NONE;
        out.count = left.count.saturating_add(right.count);
        let mut spread = [f32::INFINITY; 9];
        // More roots than binary leaves are of no use.
        let (most_left, most_right) = (usize::from(left.most), usize::from(right.most));
        for a in 1..=most_left {
            for b in 1..=most_right.min(8 - a) {
                let cost = left.cost[a - 1] + right.cost[b - 1];
                if cost < spread[a + b] {
                    spread[a + b] = cost;
                    out.split[a + b - 2] = a as u8;
                }
            }
        }
        out.most = (most_left + most_right).min(7) as u8;
        for roots in 3..=8 {
            if spread[roots] > spread[roots - 1] {
                spread[roots] = spread[roots - 1];
                out.split[roots - 2] = 0;
            }
        }
        let inner = spread[8] + area * NODE_COST;
        let leaf = if out.count as usize <= BLOCK {
            area * LEAF_COST
        } else {
            f32::INFINITY
        };
        out.leaf = leaf <= inner;
        out.cost[0] = leaf.min(inner);
        for (i, &cost) in spread[2..8].iter().enumerate() {
            out.cost[i + 1] = cost;
            if cost >= out.cost[i] {
                out.cost[i + 1] = out.cost[i];
                out.split[i] = 0;
            }
        }
        plans[i] = out;
    }
    plans
}

struct Collapse<'a> {
    tree: BvhView<'a>,
    plans: Vec<Plan>,
    nodes: Vec<Node>,
    blocks: Vec<Block>,
}

impl Collapse<'_> {
    /// The binary nodes that become the children of `node`, those that an
    /// occlusion query should ask first last: large and cheap ones.
    fn children(&self, node: u32, todo: &mut Vec<(u32, usize)>, out: &mut Vec<(f32, u32)>) {
        out.clear();
        if self.split(node, 8).is_some() {
            todo.push((node, 8));
        } else {
            // Boxes whose area is zero or too small for a number: no way is
            // cheaper than another, and the node must not be its own child.
            let first = self.tree.nodes[node as usize].first;
            todo.extend([(first + 1, 4), (first, 4)]);
        }
        while let Some((node, roots)) = todo.pop() {
            match self.split(node, roots) {
                Some((left, right)) => {
                    let first = self.tree.nodes[node as usize].first;
                    todo.push((first + 1, right));
                    todo.push((first, left));
                }
                None => {
                    let plan = &self.plans[node as usize];
                    let area = area(&self.tree.nodes[node as usize]);
                    let rank = if plan.leaf {
                        8.0 * area
                    } else {
                        area * (area / plan.cost[0])
                    };
                    out.push((rank, node));
                }
            }
        }
        out.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }

    /// How a subtree with at most so many roots divides them; `None` if one
    /// root stands for it.
    fn split(&self, node: u32, mut roots: usize) -> Option<(usize, usize)> {
        let plan = &self.plans[node as usize];
        while roots > 1 {
            let left = usize::from(plan.split[roots - 2]);
            if left > 0 {
                return Some((left, roots - left));
            }
            roots -= 1;
        }
        None
    }

    /// The triangles below a node.
    fn gather(&self, node: u32, todo: &mut Vec<u32>, out: &mut Vec<BvhTriangle>) {
        out.clear();
        todo.push(node);
        while let Some(node) = todo.pop() {
            let n = &self.tree.nodes[node as usize];
            if n.count == 0 {
                todo.extend([n.first + 1, n.first]);
            } else {
                let first = n.first as usize;
                out.extend_from_slice(&self.tree.triangles[first..first + n.count as usize]);
            }
        }
    }

    /// Up to eight triangles as a block.
    fn block(&mut self, triangles: &[BvhTriangle]) -> u32 {
        let at = self.blocks.len();
        self.blocks.push(EMPTY_BLOCK);
        let block = &mut self.blocks[at];
        for (k, t) in triangles.iter().enumerate().take(BLOCK) {
            block.set(k, [t.a, t.b, t.c], t.primitive);
        }
        at as u32 | LEAF
    }

    /// Triangles in one box, as one block or as nodes over blocks.
    fn bunch(&mut self, low: Vec3, high: Vec3, triangles: &[BvhTriangle]) -> u32 {
        if triangles.len() <= BLOCK {
            return self.block(triangles);
        }
        let at = self.nodes.len();
        self.nodes.push(EMPTY_NODE);
        let mut part = BLOCK;
        while part * 8 < triangles.len() {
            part *= 8;
        }
        for (slot, triangles) in triangles.chunks(part).enumerate() {
            let child = self.bunch(low, high, triangles);
            self.nodes[at].set(slot, low, high, child);
        }
        at as u32
    }

    fn run(&mut self) -> u32 {
        if self.tree.nodes.is_empty() {
            return 0;
        }
        let mut children = Vec::new();
        let mut spread = Vec::new();
        let mut below = Vec::new();
        let mut triangles = Vec::new();
        let is_leaf = |plans: &[Plan], node: u32| plans[node as usize].leaf;
        if is_leaf(&self.plans, 0) {
            self.gather(0, &mut below, &mut triangles);
            let root = self.tree.nodes[0];
            return self.bunch(root.min, root.max, &triangles);
        }
        self.nodes.push(EMPTY_NODE);
        let mut todo = vec![(0u32, 0usize)];
        while let Some((from, to)) = todo.pop() {
            self.children(from, &mut spread, &mut children);
            let start = todo.len();
            for (slot, &(_, child)) in children.iter().enumerate() {
                let BvhNode { min, max, .. } = self.tree.nodes[child as usize];
                let index = if is_leaf(&self.plans, child) {
                    self.gather(child, &mut below, &mut triangles);
                    self.bunch(min, max, &triangles)
                } else {
                    let index = self.nodes.len();
                    self.nodes.push(EMPTY_NODE);
                    todo.push((child, index));
                    index as u32
                };
                self.nodes[to].set(slot, min, max, index);
            }
            todo[start..].reverse();
        }
        0
    }
}

/// Collapses a binary tree.
pub(super) fn collapse(tree: BvhView<'_>) -> Result<Bvh8, Bvh8Fault> {
    check_nodes(tree.nodes, tree.triangles.len())?;
    // Room for a little more than ordinary meshes need, so that the lists do not
    // move as they grow; what is not used is given back.
    let triangles = tree.triangles.len();
    let mut collapse = Collapse {
        tree,
        plans: plan(tree.nodes),
        nodes: Vec::with_capacity(triangles / 20 + 1),
        blocks: Vec::with_capacity(triangles / 4 + 1),
    };
    let root = collapse.run();
    collapse.nodes.shrink_to_fit();
    collapse.blocks.shrink_to_fit();
    Ok(Bvh8 {
        nodes: collapse.nodes,
        blocks: collapse.blocks,
        root,
        level: Level::best(),
    })
}
