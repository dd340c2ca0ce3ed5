//! The walk of one ray, for any kind of lanes.

use std::mem::MaybeUninit;

use super::lanes::Lanes;
use super::{Block, LEAF, Node, STACK};
use crate::ray::bvh::{BVH_MISS, BvhHit};
use crate::ray::ray::{Ray, RayShear, ray_shear};
use crate::ray::triangle::triangle_intersect_sheared;
use glam::Vec3;

/// A postponed child: the bits of where the ray enters it, then what it is.
type Entry = u64;

/// A stack that nobody has to clear.
struct Stack {
    entries: [MaybeUninit<Entry>; STACK],
    depth: usize,
}

impl Stack {
    #[inline(always)]
    fn new() -> Self {
        Self {
            entries: [const { MaybeUninit::uninit() }; STACK],
            depth: 0,
        }
    }

    #[inline(always)]
    fn push(&mut self, entry: Entry) {
        if let Some(slot) = self.entries.get_mut(self.depth) {
            slot.write(entry);
            self.depth += 1;
        }
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<Entry> {
        self.depth = self.depth.checked_sub(1)?;
        // SAFETY: `push` has written every entry below `depth`.
        match self.entries.get(self.depth) {
            Some(entry) => Some(unsafe { entry.assume_init() }),
            None => None,
        }
    }
}

#[inline(always)]
fn ordered(a: Entry, b: Entry) -> (Entry, Entry) {
    if a < b { (a, b) } else { (b, a) }
}

/// A prepared ray, its numbers in every lane.
struct Prepared<L: Lanes> {
    shear: RayShear,
    t_min: f32,
    near_origin: [L::F; 3],
    near_inverse: [L::F; 3],
    far_origin: [L::F; 3],
    far_inverse: [L::F; 3],
    /// 1 where the direction is negative: the upper plane is the near one.
    sign: [usize; 3],
    t_min_lanes: L::F,
    slack: L::F,
    /// The vertices' axes in the order of the shear.
    axes: [usize; 3],
    shear_origin: [L::F; 3],
    shear_x: L::F,
    shear_y: L::F,
}

/// The far end is widened once more than in `aabb_slab`, by 2^-21, since here
/// the factor is part of the reciprocal.
const WIDEN: f32 = 1.0 + 1.0 / 262_144.0 + 1.0 / 2_097_152.0;

#[inline(always)]
fn splat3<L: Lanes>(l: L, v: Vec3) -> [L::F; 3] {
    [l.splat(v.x), l.splat(v.y), l.splat(v.z)]
}

#[inline(always)]
fn prepare<L: Lanes>(l: L, ray: Ray) -> Prepared<L> {
    let shear = ray_shear(ray);
    let sign = [
        usize::from(shear.direction.x < 0.0),
        usize::from(shear.direction.y < 0.0),
        usize::from(shear.direction.z < 0.0),
    ];
    let mut near_origin = shear.origin;
    let mut far_origin = shear.origin;
    let mut inverse = shear.inverse;
    if shear.parallel != 0 {
        // Along a zero component a slab that holds the origin, ends included,
        // is everything: its planes must not be at distance zero.
        for k in 0..3 {
            if shear.direction[k] == 0.0 {
                near_origin[k] = near_origin[k].next_up();
                far_origin[k] = far_origin[k].next_down();
                inverse[k] = f32::INFINITY;
            }
        }
    }
    let axes = match shear.axis {
        0 => [1, 2, 0],
        1 => [2, 0, 1],
        _ => [0, 1, 2],
    };
    let o = shear.origin;
    let far_inverse = inverse * WIDEN;
    Prepared {
        t_min: ray.t_min,
        near_origin: splat3(l, near_origin),
        near_inverse: splat3(l, inverse),
        far_origin: splat3(l, far_origin),
        far_inverse: splat3(l, far_inverse),
        sign,
        // A zero must not be negative: distances are ordered by their bits.
        t_min_lanes: l.splat(ray.t_min + 0.0),
        slack: l.splat(2.0 * shear.slack),
        axes,
        shear_origin: [
            l.splat(o[axes[0]]),
            l.splat(o[axes[1]]),
            l.splat(o[axes[2]]),
        ],
        shear_x: l.splat(shear.shear.x),
        shear_y: l.splat(shear.shear.y),
        shear,
    }
}

#[inline(always)]
fn near<L: Lanes>(l: L, node: &Node, ray: &Prepared<L>, k: usize) -> L::F {
    let plane = l.load(&node.planes[k][ray.sign[k]]);
    l.mul(l.sub(plane, ray.near_origin[k]), ray.near_inverse[k])
}

#[inline(always)]
fn far<L: Lanes>(l: L, node: &Node, ray: &Prepared<L>, k: usize) -> L::F {
    let plane = l.load(&node.planes[k][1 - ray.sign[k]]);
    l.mul(l.sub(plane, ray.far_origin[k]), ray.far_inverse[k])
}

/// Which children the ray touches before `t_max`, and where it enters them.
#[inline(always)]
fn enter<L: Lanes>(l: L, node: &Node, ray: &Prepared<L>, t_max: L::F) -> (u32, L::F) {
    let start = l.max(
        l.max(near(l, node, ray, 0), near(l, node, ray, 1)),
        l.max(near(l, node, ray, 2), ray.t_min_lanes),
    );
    let end = l.min(
        l.min(far(l, node, ray, 0), far(l, node, ray, 1)),
        far(l, node, ray, 2),
    );
    let end = l.add(end, ray.slack);
    (l.bits(l.le(start, l.min(end, t_max))), start)
}

/// A vertex of each triangle, moved along the ray: `triangle_shear`.
#[inline(always)]
fn sheared<L: Lanes>(l: L, v: &[[f32; 8]; 3], ray: &Prepared<L>) -> (L::F, L::F) {
    let x = l.sub(l.load(&v[ray.axes[0]]), ray.shear_origin[0]);
    let y = l.sub(l.load(&v[ray.axes[1]]), ray.shear_origin[1]);
    let z = l.sub(l.load(&v[ray.axes[2]]), ray.shear_origin[2]);
    (
        l.sub(x, l.mul(ray.shear_x, z)),
        l.sub(y, l.mul(ray.shear_y, z)),
    )
}

/// Which of a block's triangles have edges that let the ray through: the first
/// half of `triangle_intersect_sheared`.
#[inline(always)]
fn edges<L: Lanes>(l: L, block: &Block, ray: &Prepared<L>) -> u32 {
    let a = sheared(l, &block.vertices[0], ray);
    let b = sheared(l, &block.vertices[1], ray);
    let c = sheared(l, &block.vertices[2], ray);
    let (p, q) = (l.mul(b.0, c.1), l.mul(b.1, c.0));
    let (r, s) = (l.mul(c.0, a.1), l.mul(c.1, a.0));
    let (t, u) = (l.mul(a.0, b.1), l.mul(a.1, b.0));
    let below = l.or(l.or(l.lt(p, q), l.lt(r, s)), l.lt(t, u));
    let above = l.or(l.or(l.lt(q, p), l.lt(s, r)), l.lt(u, t));
    l.bits(below) ^ l.bits(above)
}

#[inline(always)]
fn leaf<L: Lanes>(l: L, block: &Block, ray: &Prepared<L>, best: &mut BvhHit, any: bool) {
    let mut through = edges(l, block, ray);
    while through != 0 {
        let k = (through.trailing_zeros() & 7) as usize;
        through &= through - 1;
        let v = &block.vertices;
        let vertex = |i: usize| Vec3::new(v[i][0][k], v[i][1][k], v[i][2][k]);
        let hit = triangle_intersect_sheared(
            &ray.shear,
            ray.t_min,
            best.t,
            vertex(0),
            vertex(1),
            vertex(2),
        );
        let primitive = block.primitives[k];
        if hit.hit != 0 && (hit.t < best.t || primitive < best.primitive) {
            *best = BvhHit {
                t: hit.t,
                u: hit.u,
                v: hit.v,
                primitive,
            };
            if any {
                return;
            }
        }
    }
}

/// The next child in the mask, and whether it is the last.
#[inline(always)]
fn next(mask: &mut u32, starts: &[f32; 8], node: &Node) -> (Entry, bool) {
    let k = (mask.trailing_zeros() & 7) as usize;
    *mask &= *mask - 1;
    let entry = u64::from(starts[k].to_bits()) << 32 | u64::from(node.children[k]);
    (entry, *mask == 0)
}

#[inline(always)]
pub(super) fn walk<L: Lanes>(
    l: L,
    nodes: &[Node],
    blocks: &[Block],
    root: u32,
    ray: Ray,
    any: bool,
) -> BvhHit {
    let mut best = BvhHit {
        t: ray.t_max,
        u: 0.0,
        v: 0.0,
        primitive: BVH_MISS,
    };
    let ray = prepare(l, ray);
    let mut stack = Stack::new();
    let mut at = root;
    let mut t_max = l.splat(best.t);
    loop {
        'down: while at & LEAF == 0 {
            let Some(node) = nodes.get(at as usize) else {
                break;
            };
            let (mut mask, start) = enter(l, node, &ray, t_max);
            if mask == 0 {
                break;
            }
            let mut starts = [0.0; 8];
            l.store(start, &mut starts);
            let (a, last) = next(&mut mask, &starts, node);
            if last {
                at = a as u32;
                continue;
            }
            let (b, last) = next(&mut mask, &starts, node);
            let (a, b) = ordered(a, b);
            if last {
                stack.push(b);
                at = a as u32;
                continue;
            }
            let (c, last) = next(&mut mask, &starts, node);
            let (a, c) = ordered(a, c);
            let (b, c) = ordered(b, c);
            if last {
                stack.push(c);
                stack.push(b);
                at = a as u32;
                continue;
            }
            let mut many = [0; 8];
            many[0] = a;
            many[1] = b;
            many[2] = c;
            let mut count = 3;
            loop {
                let (d, last) = next(&mut mask, &starts, node);
                let mut i = count;
                while i > 0 && many[i - 1] > d {
                    many[i] = many[i - 1];
                    i -= 1;
                }
                many[i] = d;
                count += 1;
                if last || count == 8 {
                    break;
                }
            }
            for &entry in many[1..count].iter().rev() {
                stack.push(entry);
            }
            at = many[0] as u32;
            continue 'down;
        }
        if at & LEAF != 0 {
            if let Some(block) = blocks.get((at & !LEAF) as usize) {
                leaf(l, block, &ray, &mut best, any);
                if any && best.primitive != BVH_MISS {
                    return best;
                }
                t_max = l.splat(best.t);
            }
        }
        loop {
            let Some(entry) = stack.pop() else {
                return best;
            };
            if f32::from_bits((entry >> 32) as u32) <= best.t {
                at = entry as u32;
                break;
            }
        }
    }
}
