//! Sixteen rays that walk the tree together.

use super::lanes::Lanes;
use super::walk::{Entry, FAR, LeafRay, Row, Slopes, Stack, prepare_leaf, walk};
use super::{Bvh8, Faces, LEAF, Node};
use crate::ray::bvh::{BVH_MISS, BvhHit};
use crate::ray::ray::Ray;

/// Rays in a group: two registers of eight.
pub(super) const GROUP: usize = 16;

/// The group's numbers, ray by ray in lanes.
struct Rays {
    origin: [[Row; 2]; 3],
    near: [[Row; 2]; 3],
    far: [[Row; 2]; 3],
    t_min: [Row; 2],
    /// The closest hit so far; below any `t_min` for a ray that is done.
    t_max: [Row; 2],
}

/// Bounds of all rays: what one of them can at least, or at most, give.
struct Bounds<L: Lanes> {
    near_origin: [L::F; 3],
    far_origin: [L::F; 3],
    near: [[L::F; 2]; 3],
    far: [[L::F; 2]; 3],
    sign: [usize; 3],
    t_min: L::F,
    slack: L::F,
}

const ZERO: [Row; 2] = [Row([0.0; 8]); 2];

fn spread(slopes: &[Slopes], t_max: impl Fn(usize) -> f32) -> Rays {
    let mut rays = Rays {
        origin: [ZERO; 3],
        near: [ZERO; 3],
        far: [ZERO; 3],
        t_min: ZERO,
        // Places without a ray are done.
        t_max: [Row([-1.0; 8]); 2],
    };
    for (i, ray) in slopes.iter().enumerate() {
        let (half, lane) = (i / 8 % 2, i % 8);
        for k in 0..3 {
            rays.origin[k][half].0[lane] = ray.origin[k];
            rays.near[k][half].0[lane] = ray.slopes[k];
            rays.far[k][half].0[lane] = ray.slopes[k] * FAR;
        }
        rays.t_min[half].0[lane] = ray.t_min + 0.0;
        rays.t_max[half].0[lane] = t_max(i);
    }
    rays
}

#[inline(always)]
fn bounds<L: Lanes>(l: L, slopes: &[Slopes]) -> Bounds<L> {
    let first = &slopes[0];
    let (mut low_origin, mut high_origin) = (first.origin, first.origin);
    let (mut low, mut high) = (first.slopes, first.slopes);
    let (mut t_min, mut slack) = (first.t_min, first.slack);
    for ray in &slopes[1..] {
        low_origin = low_origin.min(ray.origin);
        high_origin = high_origin.max(ray.origin);
        low = low.min(ray.slopes);
        high = high.max(ray.slopes);
        t_min = t_min.min(ray.t_min);
        slack = slack.max(ray.slack);
    }
    let sign = [0, 1, 2].map(|k| first.negative >> k & 1);
    let mut out = Bounds {
        near_origin: [l.splat(0.0); 3],
        far_origin: [l.splat(0.0); 3],
        near: [[l.splat(0.0); 2]; 3],
        far: [[l.splat(0.0); 2]; 3],
        sign,
        t_min: l.splat(t_min + 0.0),
        slack: l.splat(slack),
    };
    for k in 0..3 {
        // A positive reciprocal: the origin farthest ahead enters first.
        let (near, far) = if sign[k] == 0 {
            (high_origin[k], low_origin[k])
        } else {
            (low_origin[k], high_origin[k])
        };
        out.near_origin[k] = l.splat(near);
        out.far_origin[k] = l.splat(far);
        out.near[k] = [l.splat(low[k]), l.splat(high[k])];
        out.far[k] = [l.splat(low[k] * FAR), l.splat(high[k] * FAR)];
    }
    out
}

/// At most what any of the rays gives for a near plane.
#[inline(always)]
fn near<L: Lanes>(l: L, node: &Node, all: &Bounds<L>, k: usize) -> L::F {
    let d = l.sub(l.load(&node.planes[k][all.sign[k]]), all.near_origin[k]);
    l.min(l.mul(d, all.near[k][0]), l.mul(d, all.near[k][1]))
}

/// At least what any of the rays gives for a far plane.
#[inline(always)]
fn far<L: Lanes>(l: L, node: &Node, all: &Bounds<L>, k: usize) -> L::F {
    let d = l.sub(l.load(&node.planes[k][1 - all.sign[k]]), all.far_origin[k]);
    l.max(l.mul(d, all.far[k][0]), l.mul(d, all.far[k][1]))
}

/// Which children some ray may touch, and where at the earliest.
///
/// Each step is monotone, also after rounding, so this is within what the
/// rays' own tests give.
#[inline(always)]
fn enter<L: Lanes>(l: L, node: &Node, all: &Bounds<L>, t_max: L::F) -> (u32, L::F) {
    let start = l.max(
        l.max(near(l, node, all, 0), near(l, node, all, 1)),
        l.max(near(l, node, all, 2), all.t_min),
    );
    let end = l.min(
        l.min(far(l, node, all, 0), far(l, node, all, 1)),
        l.min(far(l, node, all, 2), t_max),
    );
    (l.bits(l.le(start, l.add(end, all.slack))), start)
}

/// Which rays touch one child.
#[inline(always)]
fn touch<L: Lanes>(l: L, node: &Node, slot: usize, rays: &Rays, all: &Bounds<L>) -> u32 {
    let mut out = 0;
    for half in 0..2 {
        let mut start = l.load(&rays.t_min[half].0);
        let mut end = l.load(&rays.t_max[half].0);
        let live = l.le(l.splat(0.0), end);
        for k in 0..3 {
            let origin = l.load(&rays.origin[k][half].0);
            let low = l.splat(node.planes[k][all.sign[k]][slot]);
            let high = l.splat(node.planes[k][1 - all.sign[k]][slot]);
            start = l.max(
                l.mul(l.sub(low, origin), l.load(&rays.near[k][half].0)),
                start,
            );
            end = l.min(
                l.mul(l.sub(high, origin), l.load(&rays.far[k][half].0)),
                end,
            );
        }
        let hit = l.and(l.le(start, l.add(end, all.slack)), live);
        out |= l.bits(hit) << (8 * half);
    }
    out
}

fn largest(t_max: &[Row; 2]) -> f32 {
    let all = t_max.iter().flat_map(|row| row.0);
    all.fold(-1.0, |a, b| if b > a { b } else { a })
}

/// Hits of up to sixteen rays.
#[inline(always)]
pub(super) fn group<L: Lanes, const ANY: bool>(
    l: L,
    bvh: &Bvh8,
    rays: &[Ray],
    hits: &mut [BvhHit],
) {
    let n = rays.len().min(hits.len()).min(GROUP);
    let (rays, hits) = (&rays[..n], &mut hits[..n]);
    let mut prepared = [const { None::<LeafRay> }; GROUP];
    let mut slopes = [Slopes::NONE; GROUP];
    let mut together = n > 1 && bvh.root & LEAF == 0;
    for (i, ray) in rays.iter().enumerate() {
        let (leaf, slope) = prepare_leaf(ray, Faces::Both);
        together &= leaf.shear.parallel == 0 && (i == 0 || slope.negative == slopes[0].negative);
        prepared[i] = Some(leaf);
        slopes[i] = slope;
    }
    if !together {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = walk::<L, ANY>(l, bvh, ray, Faces::Both);
        }
        return;
    }
    for (ray, hit) in rays.iter().zip(&mut *hits) {
        *hit = BvhHit {
            t: ray.t_max,
            u: 0.0,
            v: 0.0,
            primitive: BVH_MISS,
        };
    }
    let slopes = &slopes[..n];
    let mut lanes = spread(slopes, |i| rays[i].t_max);
    let all = bounds(l, slopes);
    let mut farthest = largest(&lanes.t_max);
    let mut stack = Stack::new();
    // A node, or a block as its parent's number and place.
    let mut at = 0u32;
    loop {
        if at & LEAF == 0 {
            if let Some(node) = bvh.nodes.get(at as usize) {
                let (mut mask, start) = enter(l, node, &all, l.splat(farthest));
                let mut starts = Row([0.0; 8]);
                l.store(start, &mut starts.0);
                let mut found = [0 as Entry; 8];
                let mut count = 0;
                while mask != 0 {
                    let k = (mask.trailing_zeros() & 7) as usize;
                    mask &= mask - 1;
                    let child = node.children[k];
                    let child = if child & LEAF == 0 {
                        child
                    } else {
                        LEAF | at << 3 | k as u32
                    };
                    let entry = u64::from(starts.0[k].to_bits()) << 32 | u64::from(child);
                    let mut i = count;
                    // The farthest first: the nearest is on top of the stack.
                    while i > 0 && found[i - 1] < entry {
                        found[i] = found[i - 1];
                        i -= 1;
                    }
                    found[i] = entry;
                    count += 1;
                }
                for &entry in &found[..count] {
                    stack.push(entry);
                }
            }
        } else {
            let place = at & !LEAF;
            let (node, slot) = ((place >> 3) as usize, (place & 7) as usize);
            if let Some(node) = bvh.nodes.get(node)
                && let Some(block) = bvh.blocks.get((node.children[slot] & !LEAF) as usize)
            {
                let mut active = touch(l, node, slot, &lanes, &all);
                let mut better = false;
                while active != 0 {
                    let i = active.trailing_zeros() as usize % GROUP;
                    active &= active - 1;
                    let (Some(hit), Some(ray)) = (hits.get_mut(i), &prepared[i]) else {
                        continue;
                    };
                    let was = hit.primitive;
                    l.leaf(block, ray, hit);
                    if hit.primitive != was {
                        better = true;
                        lanes.t_max[i / 8].0[i % 8] = if ANY { -1.0 } else { hit.t };
                    }
                }
                if better {
                    farthest = largest(&lanes.t_max);
                }
            }
        }
        loop {
            let Some(entry) = stack.pop() else {
                return;
            };
            if f32::from_bits((entry >> 32) as u32) <= farthest {
                at = entry as u32;
                break;
            }
        }
    }
}
