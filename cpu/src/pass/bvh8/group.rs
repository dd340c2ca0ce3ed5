//! Sixteen rays that walk the tree together.

use super::lanes::Lanes;
use super::walk::{
    Entry, FAR, LeafRay, Line, Row, Slopes, Stack, Wide, edges, finish, leaf_scalar, prepare_leaf,
    sides, walk,
};
use super::{BLOCK, Block, Bvh8, Filter, LEAF, Node};
use crate::ray::bvh::{BVH_MISS, BvhHit};
use crate::ray::ray::Ray;

/// Rays in a group: two registers of eight.
pub(super) const GROUP: usize = 16;

/// The group's numbers, ray by ray in lanes.
struct Rays {
    origin: [[Row; 2]; 3],
    near: [[Row; 2]; 3],
    far: [[Row; 2]; 3],
    direction: [[Row; 2]; 3],
    shear: [[Row; 2]; 2],
    slack: [Row; 2],
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

fn spread(rays_in: &[Ray], leaves: &[LeafRay<'_>], slopes: &[Slopes]) -> Rays {
    let mut rays = Rays {
        origin: [ZERO; 3],
        near: [ZERO; 3],
        far: [ZERO; 3],
        direction: [ZERO; 3],
        shear: [ZERO; 2],
        slack: ZERO,
        t_min: ZERO,
        // Places without a ray are done.
        t_max: [Row([-1.0; 8]); 2],
    };
    for (i, (ray, leaf)) in slopes.iter().zip(leaves).enumerate() {
        let (half, lane) = (i / 8 % 2, i % 8);
        for k in 0..3 {
            rays.origin[k][half].0[lane] = ray.origin[k];
            rays.near[k][half].0[lane] = ray.slopes[k];
            rays.far[k][half].0[lane] = ray.slopes[k] * FAR;
            rays.direction[k][half].0[lane] = leaf.shear.direction[k];
        }
        rays.shear[0][half].0[lane] = leaf.shear.shear.x;
        rays.shear[1][half].0[lane] = leaf.shear.shear.y;
        rays.slack[half].0[lane] = leaf.shear.slack;
        rays.t_min[half].0[lane] = ray.t_min + 0.0;
        rays.t_max[half].0[lane] = rays_in[i].t_max;
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

#[inline(always)]
fn row<L: Lanes>(l: L, of: &[[Row; 2]; 3], half: usize) -> Wide<L> {
    Wide {
        x: l.load(&of[0][half].0),
        y: l.load(&of[1][half].0),
        z: l.load(&of[2][half].0),
    }
}

/// Tests a block's triangles one by one, each for eight rays; whether one of
/// them has a new hit.
#[inline(always)]
fn triangles<L: Lanes, const ANY: bool>(
    l: L,
    block: &Block,
    half: usize,
    active: u32,
    prepared: &[LeafRay<'_>; GROUP],
    rays: &mut Rays,
    hits: &mut [BvhHit],
) -> bool {
    let [kx, ky, kz] = prepared[0].axes;
    let filter = prepared[0].filter;
    let origin = [
        l.load(&rays.origin[kx][half].0),
        l.load(&rays.origin[ky][half].0),
        l.load(&rays.origin[kz][half].0),
    ];
    let shear = [
        l.load(&rays.shear[0][half].0),
        l.load(&rays.shear[1][half].0),
    ];
    let mut active = active;
    let mut better = false;
    for k in 0..BLOCK {
        if block.primitives[k] == BVH_MISS {
            break;
        }
        if !filter.masks.is_empty() && !filter.sees(block.primitives[k]) {
            continue;
        }
        let v = &block.vertices;
        let corner = [
            sheared(l, [v[0][kx][k], v[0][ky][k], v[0][kz][k]], origin, shear),
            sheared(l, [v[1][kx][k], v[1][ky][k], v[1][kz][k]], origin, shear),
            sheared(l, [v[2][kx][k], v[2][ky][k], v[2][kz][k]], origin, shear),
        ];
        let edges = edges(l, corner);
        let (below, above) = sides(l, &edges);
        let through = l.xor(below, above);
        // One axis and one octant, so all rays see a triangle's same side.
        let (one, other) = (l.bits(below), l.bits(above));
        let passing =
            (one & prepared[0].below | other & prepared[0].above) & (one ^ other) & active;
        if passing == 0 {
            continue;
        }
        let line = Line {
            origin: row(l, &rays.origin, half),
            direction: row(l, &rays.direction, half),
            inverse: row(l, &rays.near, half),
            slack: l.load(&rays.slack[half].0),
            t_min: l.load(&rays.t_min[half].0),
            t_max: l.load(&rays.t_max[half].0),
        };
        let corners = [
            splat(l, [v[0][0][k], v[0][1][k], v[0][2][k]]),
            splat(l, [v[1][0][k], v[1][1][k], v[1][2][k]]),
            splat(l, [v[2][0][k], v[2][1][k], v[2][2][k]]),
        ];
        let n = &block.normals;
        let normal = splat(l, [n[0][k], n[1][k], n[2][k]]);
        let tested = finish(l, corners, normal, &edges, &line);
        let mut on_edge = l.bits(tested.on_edge) & passing;
        let hit = l.and(through, tested.hit);
        let mut found = l.bits(hit) & passing & !on_edge;
        if found != 0 {
            let (mut ts, mut us, mut vs) = (Row([0.0; 8]), Row([0.0; 8]), Row([0.0; 8]));
            l.store(tested.t, &mut ts.0);
            l.store(tested.u, &mut us.0);
            l.store(tested.v, &mut vs.0);
            if ANY {
                active &= !found;
            }
            while found != 0 {
                let lane = (found.trailing_zeros() & 7) as usize;
                found &= found - 1;
                let Some(best) = hits.get_mut(8 * half + lane) else {
                    continue;
                };
                let (t, primitive) = (ts.0[lane], block.primitives[k]);
                if t < best.t || (t == best.t && primitive < best.primitive) {
                    *best = BvhHit {
                        t,
                        u: us.0[lane],
                        v: vs.0[lane],
                        primitive,
                    };
                    rays.t_max[half].0[lane] = if ANY { -1.0 } else { t };
                    better = true;
                }
            }
        }
        while on_edge != 0 {
            let lane = (on_edge.trailing_zeros() & 7) as usize;
            on_edge &= on_edge - 1;
            let Some(best) = hits.get_mut(8 * half + lane) else {
                continue;
            };
            let was = *best;
            leaf_scalar(block, &prepared[8 * half + lane], 1 << k, best);
            if *best != was {
                rays.t_max[half].0[lane] = if ANY { -1.0 } else { best.t };
                better = true;
                if ANY {
                    active &= !(1 << lane);
                }
            }
        }
        if active == 0 {
            break;
        }
    }
    better
}

#[inline(always)]
fn splat<L: Lanes>(l: L, v: [f32; 3]) -> Wide<L> {
    Wide {
        x: l.splat(v[0]),
        y: l.splat(v[1]),
        z: l.splat(v[2]),
    }
}

/// `triangle_shear` of one vertex for eight rays.
#[inline(always)]
fn sheared<L: Lanes>(l: L, vertex: [f32; 3], origin: [L::F; 3], shear: [L::F; 2]) -> (L::F, L::F) {
    let x = l.sub(l.splat(vertex[0]), origin[0]);
    let y = l.sub(l.splat(vertex[1]), origin[1]);
    let z = l.sub(l.splat(vertex[2]), origin[2]);
    (l.sub(x, l.mul(shear[0], z)), l.sub(y, l.mul(shear[1], z)))
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
    filter: Filter<'_>,
    hits: &mut [BvhHit],
) {
    let n = rays.len().min(hits.len()).min(GROUP);
    let (rays, hits) = (&rays[..n], &mut hits[..n]);
    let mut prepared = [LeafRay::NONE; GROUP];
    let mut slopes = [Slopes::NONE; GROUP];
    let mut together = n > 1 && bvh.root & LEAF == 0;
    for (i, ray) in rays.iter().enumerate() {
        let (leaf, slope) = prepare_leaf(ray, filter);
        together &= leaf.shear.parallel == 0 && (i == 0 || slope.negative == slopes[0].negative);
        together &= i == 0 || leaf.shear.axis == prepared[0].shear.axis;
        prepared[i] = leaf;
        slopes[i] = slope;
    }
    if !together {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = walk::<L, ANY>(l, bvh, ray, filter);
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
    let mut lanes = spread(rays, &prepared[..n], slopes);
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
                    // What the bounds of all rays touch, none of them may.
                    if touch(l, node, k, &lanes, &all) == 0 {
                        continue;
                    }
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
                let active = touch(l, node, slot, &lanes, &all);
                let mut better = false;
                for half in 0..2 {
                    let active = active >> (8 * half) & 0xff;
                    if active != 0 {
                        better |= triangles::<L, ANY>(
                            l, block, half, active, &prepared, &mut lanes, hits,
                        );
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
