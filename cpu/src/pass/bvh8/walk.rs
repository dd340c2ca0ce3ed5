//! The walk of one ray, for any kind of lanes.

use std::mem::MaybeUninit;

use super::lanes::Lanes;
use super::{Block, Bvh8, Faces, Filter, LEAF, Node, STACK};
use crate::ray::aabb::AABB_WIDEN;
use crate::ray::bvh::{BVH_MISS, BvhHit};
use crate::ray::plane::{PLANE_RATIO, PLANE_TINY};
use crate::ray::ray::{RAY_FLUSH, RAY_SLACK, Ray, RayShear};
use crate::ray::triangle::{TRIANGLE_PAD, triangle_intersect_sheared};
use glam::{Vec2, Vec3, Vec3A};

/// A postponed child: the bits of where the ray enters it, then what it is.
pub(super) type Entry = u64;

/// A stack that nobody has to clear.
pub(super) struct Stack {
    entries: [MaybeUninit<Entry>; STACK],
    depth: usize,
}

impl Stack {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            entries: [const { MaybeUninit::uninit() }; STACK],
            depth: 0,
        }
    }

    #[inline(always)]
    pub(super) fn push(&mut self, entry: Entry) {
        if let Some(slot) = self.entries.get_mut(self.depth) {
            slot.write(entry);
            self.depth += 1;
        }
    }

    #[inline(always)]
    pub(super) fn pop(&mut self) -> Option<Entry> {
        self.depth = self.depth.checked_sub(1)?;
        let entry = self.entries.get(self.depth)?;
        // SAFETY: `push` has written every entry below `depth`.
        Some(unsafe { entry.assume_init() })
    }
}

#[inline(always)]
fn ordered(a: Entry, b: Entry) -> (Entry, Entry) {
    if a < b { (a, b) } else { (b, a) }
}

/// What the boxes need of a ray, in every lane.
struct Prepared<L: Lanes> {
    /// Fused: what is added to the product of a near plane. Else the origin.
    near_at: [L::F; 3],
    near_inverse: [L::F; 3],
    /// The same for the far planes.
    far_at: [L::F; 3],
    far_inverse: [L::F; 3],
    /// 1 where the direction is negative: the upper plane is the near one.
    sign: [usize; 3],
    t_min: L::F,
}

/// What the boxes need of a ray, before it is spread over lanes.
#[derive(Clone, Copy)]
pub(super) struct Slopes {
    pub(super) origin: Vec3A,
    /// Reciprocals of the direction, infinite where it is zero.
    pub(super) slopes: Vec3A,
    /// A bit for each negative component.
    pub(super) negative: usize,
    pub(super) slack: f32,
    pub(super) t_min: f32,
}

impl LeafRay<'_> {
    /// A ray that nobody asks for.
    pub(super) const NONE: Self = Self {
        shear: RayShear {
            origin: Vec3::ZERO,
            direction: Vec3::ZERO,
            inverse: Vec3::ZERO,
            shear: Vec2::ZERO,
            axis: 0,
            parallel: 0,
            slack: 0.0,
        },
        axes: [0; 3],
        origin: [0.0; 3],
        t_min: 0.0,
        below: 0,
        above: 0,
        filter: Filter::ALL,
    };
}

impl Slopes {
    /// A ray that nobody asks for.
    pub(super) const NONE: Self = Self {
        origin: Vec3A::ZERO,
        slopes: Vec3A::ZERO,
        negative: 0,
        slack: 0.0,
        t_min: 0.0,
    };
}

/// What the triangles need of a ray.
#[derive(Clone, Copy)]
pub(super) struct LeafRay<'a> {
    pub(super) shear: RayShear,
    /// The vertices' axes in the order of the shear.
    pub(super) axes: [usize; 3],
    origin: [f32; 3],
    t_min: f32,
    /// Lanes that may have negative, or positive, edges.
    pub(super) below: u32,
    pub(super) above: u32,
    pub(super) filter: Filter<'a>,
}

/// [`ray_shear`](crate::ray::ray::ray_shear) without branches: the same
/// operations on the same numbers.
#[inline(always)]
pub(super) fn prepare_leaf<'a>(ray: &Ray, filter: Filter<'a>) -> (LeafRay<'a>, Slopes) {
    let faces = filter.faces;
    // A mask without a bit shares none with any triangle's.
    let lanes = u32::from(filter.mask != 0) * 0xff;
    let direction = Vec3A::from(ray.direction);
    let tiny = direction.abs().cmplt(Vec3A::splat(RAY_FLUSH));
    let direction = Vec3A::select(tiny, Vec3A::ZERO, direction);
    let zero = direction.cmpeq(Vec3A::ZERO);
    let slopes = Vec3A::ONE / direction;
    let inverse = Vec3A::select(zero, Vec3A::ZERO, slopes);
    let steepest = inverse.abs().max(Vec3A::ONE).max_element();
    let d = direction.to_array();
    let [x, y, z] = direction.abs().to_array();
    let last = u32::from((z >= x) & (z >= y));
    let axis = 2 * last + (1 - last) * u32::from(y >= x);
    let [kx, ky, kz] = AXES[axis as usize & 3];
    let largest = if d[kz] == 0.0 { 1.0 } else { d[kz] };
    let slack = RAY_SLACK * steepest;
    let leaf = LeafRay {
        shear: RayShear {
            origin: ray.origin,
            direction: direction.into(),
            inverse: inverse.into(),
            shear: Vec2::new(d[kx] / largest, d[ky] / largest),
            axis,
            parallel: u32::from(zero.any()),
            slack,
        },
        axes: [kx, ky, kz],
        origin: ray.origin.to_array(),
        t_min: ray.t_min,
        // Along the axis of the shear, counter-clockwise is seen from ahead.
        below: u32::from(faces == Faces::Both || d[kz] > 0.0) * lanes,
        above: u32::from(faces == Faces::Both || d[kz] < 0.0) * lanes,
        filter,
    };
    let slopes = Slopes {
        origin: ray.origin.into(),
        slopes,
        negative: direction.cmplt(Vec3A::ZERO).bitmask() as usize,
        slack: 2.0 * slack,
        t_min: ray.t_min,
    };
    (leaf, slopes)
}

/// By the largest component: the axes in the order of the shear.
const AXES: [[usize; 3]; 4] = [[1, 2, 0], [2, 0, 1], [0, 1, 2], [0, 1, 2]];

#[inline(always)]
fn splat3<L: Lanes>(l: L, v: Vec3A) -> [L::F; 3] {
    [l.splat(v.x), l.splat(v.y), l.splat(v.z)]
}

/// By how much far reciprocals are larger.
pub(super) const FAR: f32 = 1.0 + 1.0 / 262_144.0 + 1.0 / 2_097_152.0;

/// The boxes' part of a ray.
///
/// A box must let through what the triangles' own boxes let through, so here
/// both ends have a margin beyond that of `aabb_slab`. With `u = 2^-24`, and X
/// the exact distance `(plane - origin) · inverse`, the triangle's own near
/// end is at least `X - 2u |X|` and its far end, widened, at most
/// `X (1 + 2^-18) (1 + 4u) + slack`.
///
/// - Not fused: the same two operations as in `aabb_slab`, which are monotone.
///   The far reciprocal is widened by 2^-21 more than the far end, so that the
///   rounding of the factor is covered, and the slack is counted twice, so
///   that it is covered for a negative X too.
/// - Fused: `plane · inverse - origin · inverse` errs by `u |X|` and by
///   `2u |origin · inverse|`. The reciprocals make up for the first, by 2^-21
///   on each side, and four times the second is added.
///
/// Along a zero component the reciprocal is infinite, and nothing is fused: a
/// slab that holds the origin is everything, another is nothing, and a plane
/// through the origin gives a NaN, which `min` and `max` in [`enter`] leave
/// out.
#[inline(always)]
fn prepare<L: Lanes, const FUSED: bool>(l: L, ray: &Slopes) -> Prepared<L> {
    const NEAR: f32 = 1.0 - 1.0 / 2_097_152.0;
    const UNIT: f32 = 1.0 / 16_777_216.0;
    let (o, slopes) = (ray.origin, ray.slopes);
    let far = slopes * FAR;
    let (near, near_at, far_at) = if FUSED {
        let near = slopes * NEAR;
        let size = o.abs() * slopes.abs() * (8.0 * UNIT);
        let far_at = (size + Vec3A::splat(ray.slack)) - o * far;
        (near, -(o * near) - size, far_at)
    } else {
        (slopes, o, o)
    };
    Prepared {
        near_at: splat3(l, near_at),
        near_inverse: splat3(l, near),
        far_at: splat3(l, far_at),
        far_inverse: splat3(l, far),
        sign: [0, 1, 2].map(|k| ray.negative >> k & 1),
        // A zero must not be negative: distances are ordered by their bits.
        t_min: l.splat(ray.t_min + 0.0),
    }
}

#[inline(always)]
fn plane<L: Lanes, const FUSED: bool>(l: L, plane: L::F, at: L::F, inverse: L::F) -> L::F {
    if FUSED {
        l.mul_add(plane, inverse, at)
    } else {
        l.mul(l.sub(plane, at), inverse)
    }
}

#[inline(always)]
fn near<L: Lanes, const FUSED: bool>(l: L, node: &Node, ray: &Prepared<L>, k: usize) -> L::F {
    let planes = l.load(&node.planes[k][ray.sign[k]]);
    plane::<L, FUSED>(l, planes, ray.near_at[k], ray.near_inverse[k])
}

#[inline(always)]
fn far<L: Lanes, const FUSED: bool>(l: L, node: &Node, ray: &Prepared<L>, k: usize) -> L::F {
    let planes = l.load(&node.planes[k][1 - ray.sign[k]]);
    plane::<L, FUSED>(l, planes, ray.far_at[k], ray.far_inverse[k])
}

/// Which children the ray touches before `t_max`, and where it enters them.
/// A NaN is always the first operand, and so is left out.
#[inline(always)]
fn enter<L: Lanes, const FUSED: bool>(
    l: L,
    node: &Node,
    ray: &Prepared<L>,
    t_max: L::F,
    slack: L::F,
) -> (u32, L::F) {
    let start = l.max(
        l.max(
            near::<L, FUSED>(l, node, ray, 0),
            near::<L, FUSED>(l, node, ray, 1),
        ),
        l.max(near::<L, FUSED>(l, node, ray, 2), ray.t_min),
    );
    let end = l.min(
        l.min(
            far::<L, FUSED>(l, node, ray, 0),
            far::<L, FUSED>(l, node, ray, 1),
        ),
        l.min(far::<L, FUSED>(l, node, ray, 2), t_max),
    );
    let end = if FUSED { end } else { l.add(end, slack) };
    (l.bits(l.le(start, end)), start)
}

/// A vertex of each triangle, moved along the ray: `triangle_shear`.
#[inline(always)]
fn sheared<L: Lanes>(l: L, v: &[[f32; 8]; 3], ray: &LeafRay<'_>) -> (L::F, L::F) {
    let [kx, ky, kz] = ray.axes;
    let x = l.sub(l.load(&v[kx]), l.splat(ray.origin[kx]));
    let y = l.sub(l.load(&v[ky]), l.splat(ray.origin[ky]));
    let z = l.sub(l.load(&v[kz]), l.splat(ray.origin[kz]));
    (
        l.sub(x, l.mul(l.splat(ray.shear.shear.x), z)),
        l.sub(y, l.mul(l.splat(ray.shear.shear.y), z)),
    )
}

/// A vector in every lane.
#[derive(Clone, Copy)]
pub(super) struct Wide<L: Lanes> {
    pub(super) x: L::F,
    pub(super) y: L::F,
    pub(super) z: L::F,
}

#[inline(always)]
fn minus<L: Lanes>(l: L, a: Wide<L>, b: Wide<L>) -> Wide<L> {
    Wide {
        x: l.sub(a.x, b.x),
        y: l.sub(a.y, b.y),
        z: l.sub(a.z, b.z),
    }
}

/// `vec3_dot`.
#[inline(always)]
fn dot<L: Lanes>(l: L, a: Wide<L>, b: Wide<L>) -> L::F {
    l.add(l.add(l.mul(a.x, b.x), l.mul(a.y, b.y)), l.mul(a.z, b.z))
}

/// One axis of the slab of the triangles' own boxes.
#[inline(always)]
fn slab_axis<L: Lanes>(l: L, low: L::F, high: L::F, pad: L::F, inverse: L::F) -> (L::F, L::F) {
    let a = l.mul(l.sub(low, pad), inverse);
    let b = l.mul(l.add(high, pad), inverse);
    (l.min(b, a), l.max(b, a))
}

/// The least of three, as `aabb_min(aabb_min(a, b), c)`.
#[inline(always)]
fn min3<L: Lanes>(l: L, a: L::F, b: L::F, c: L::F) -> L::F {
    l.min(c, l.min(b, a))
}

/// The largest of three, as `aabb_max(aabb_max(a, b), c)`.
#[inline(always)]
fn max3<L: Lanes>(l: L, a: L::F, b: L::F, c: L::F) -> L::F {
    l.max(c, l.max(b, a))
}

#[inline(always)]
fn vertex<L: Lanes>(l: L, v: &[[f32; 8]; 3]) -> Wide<L> {
    Wide {
        x: l.load(&v[0]),
        y: l.load(&v[1]),
        z: l.load(&v[2]),
    }
}

/// The products whose order tells on which side of each edge the ray is.
pub(super) struct Edges<L: Lanes> {
    plus: [L::F; 3],
    minus: [L::F; 3],
}

/// The edges of corners that are moved along the ray.
#[inline(always)]
pub(super) fn edges<L: Lanes>(l: L, corners: [(L::F, L::F); 3]) -> Edges<L> {
    let [a, b, c] = corners;
    Edges {
        plus: [l.mul(b.0, c.1), l.mul(c.0, a.1), l.mul(a.0, b.1)],
        minus: [l.mul(b.1, c.0), l.mul(c.1, a.0), l.mul(a.1, b.0)],
    }
}

/// Where some edge is negative, and where one is positive.
///
/// The order of an edge's ends and the test for equal products, which guard
/// the twin against fused operations, change no bit here but a zero's sign.
#[inline(always)]
pub(super) fn sides<L: Lanes>(l: L, edges: &Edges<L>) -> (L::M, L::M) {
    let ([p, q, r], [s, t, u]) = (edges.plus, edges.minus);
    (
        l.or(l.or(l.lt(p, s), l.lt(q, t)), l.lt(r, u)),
        l.or(l.or(l.lt(s, p), l.lt(t, q)), l.lt(u, r)),
    )
}

/// What the second half of the test needs of a ray: one ray in every lane, or
/// one in each.
pub(super) struct Line<L: Lanes> {
    pub(super) origin: Wide<L>,
    pub(super) direction: Wide<L>,
    pub(super) inverse: Wide<L>,
    pub(super) slack: L::F,
    pub(super) t_min: L::F,
    pub(super) t_max: L::F,
}

/// The outcome of the second half.
pub(super) struct Tested<L: Lanes> {
    /// The ray is exactly on an edge: a zero of either sign.
    pub(super) on_edge: L::M,
    /// Otherwise: whether it is a hit.
    pub(super) hit: L::M,
    pub(super) t: L::F,
    pub(super) u: L::F,
    pub(super) v: L::F,
}

/// The second half of `triangle_intersect_sheared`, the same operations on the
/// same numbers, for triangles whose edges let the ray through and rays
/// without a zero in their direction.
#[inline(always)]
pub(super) fn finish<L: Lanes>(
    l: L,
    corners: [Wide<L>; 3],
    normal: Wide<L>,
    edges: &Edges<L>,
    ray: &Line<L>,
) -> Tested<L> {
    let zero = l.splat(0.0);
    let one = l.splat(1.0);
    let ea = l.sub(edges.plus[0], edges.minus[0]);
    let eb = l.sub(edges.plus[1], edges.minus[1]);
    let ec = l.sub(edges.plus[2], edges.minus[2]);
    let on_edge = l.or(l.or(l.eq(ea, zero), l.eq(eb, zero)), l.eq(ec, zero));
    let [a, b, c] = corners;
    let la = minus(l, a, ray.origin);
    let lb = minus(l, b, ray.origin);
    let lc = minus(l, c, ray.origin);
    let low = Wide::<L> {
        x: min3(l, la.x, lb.x, lc.x),
        y: min3(l, la.y, lb.y, lc.y),
        z: min3(l, la.z, lb.z, lc.z),
    };
    let high = Wide::<L> {
        x: max3(l, la.x, lb.x, lc.x),
        y: max3(l, la.y, lb.y, lc.y),
        z: max3(l, la.z, lb.z, lc.z),
    };
    let extent = minus(l, high, low);
    let pad = l.mul(max3(l, extent.x, extent.y, extent.z), l.splat(TRIANGLE_PAD));
    let x = slab_axis(l, low.x, high.x, pad, ray.inverse.x);
    let y = slab_axis(l, low.y, high.y, pad, ray.inverse.y);
    let z = slab_axis(l, low.z, high.z, pad, ray.inverse.z);
    let near = max3(l, x.0, y.0, z.0);
    let far = min3(l, x.1, y.1, z.1);
    let widened = l.add(l.mul(far, l.splat(AABB_WIDEN)), ray.slack);
    let own_box = l.le(near, widened);

    let area = l.add(l.add(ea, eb), ec);
    let divisor = l.select(l.eq(area, zero), one, area);
    let u = l.min(one, l.max(zero, l.div(eb, divisor)));
    let v = l.min(one, l.max(zero, l.div(ec, divisor)));

    let (ab, ca) = (minus(l, b, a), minus(l, a, c));
    let point = Wide::<L> {
        x: l.sub(l.add(la.x, l.mul(ab.x, u)), l.mul(ca.x, v)),
        y: l.sub(l.add(la.y, l.mul(ab.y, u)), l.mul(ca.y, v)),
        z: l.sub(l.add(la.z, l.mul(ab.z, u)), l.mul(ca.z, v)),
    };
    let numerator = dot(l, normal, point);
    let denominator = dot(l, normal, ray.direction);
    let size = l.abs(denominator);
    let divides = l.and(
        l.lt(l.mul(l.abs(numerator), l.splat(PLANE_RATIO)), size),
        l.lt(l.splat(PLANE_TINY), size),
    );
    let plane = l.div(numerator, l.select(divides, denominator, one));
    let along = l.select(divides, plane, near);
    let t = l.max(near, l.min(far, along));
    let range = l.and(l.le(ray.t_min, t), l.le(t, ray.t_max));
    Tested {
        on_edge,
        hit: l.and(own_box, range),
        t,
        u,
        v,
    }
}

#[inline(always)]
fn splat_wide<L: Lanes>(l: L, v: Vec3) -> Wide<L> {
    Wide {
        x: l.splat(v.x),
        y: l.splat(v.y),
        z: l.splat(v.z),
    }
}

/// Those of some triangles that the masks let through.
#[cold]
#[inline(never)]
fn unmasked(block: &Block, filter: &Filter<'_>, through: u32) -> u32 {
    let seen = block.primitives.iter().enumerate();
    seen.fold(through, |out, (k, &primitive)| {
        out & !(u32::from(!filter.sees(primitive)) << k)
    })
}

/// Those of some triangles that are behind the ray for certain, such as the
/// one that it starts from. The rest of the test would find that too, but it is
/// three quarters of the work.
///
/// The answer of [`finish`] is `max(near, min(far, along))`, with `along` either
/// `near` or the quotient of `n · P` and `n · d`. So it is before `t_min`, if that
/// is not negative, where `near` is, and the quotient is negative.
///
/// - `near` is the largest over the axes of the least product of a plane of the
///   triangle's box and the reciprocal. Subtractions and products are monotone
///   and the box holds the vertices, so it is at most the same of the vertices.
/// - `n · d` is what `finish` has. `n · P` is not known yet, but `n · A` for a vertex
///   A is, both relative to the origin. With `u = 2^-24` and L the longest
///   component of a side: P is `A + u ab - v ca` but for `4u (|A| + 2L)` a component,
///   with weights in `[0, 1]`; n is across the sides but for `6u L^2` a component,
///   so `n · ab` and `n · ca` are at most `40u L^3`; the sums of three err by `4u` of
///   what they add. With `R = sum |n A|` all that is below `188u L^3 + 13u R`. The
///   test has 256 and 16, and adds 2^-120 for numbers below the normal ones and
///   `2^-100 |n · d|`, so that the quotient does not become zero.
#[inline(always)]
fn behind<L: Lanes>(
    l: L,
    block: &Block,
    [a, b, c]: [Wide<L>; 3],
    normal: Wide<L>,
    ray: &LeafRay<'_>,
    through: u32,
) -> u32 {
    const SLACK: f32 = 1.0 / 1_048_576.0;
    const SLACK_QUOTIENT: f32 = f32::from_bits((127 - 100) << 23);
    let origin = splat_wide(l, ray.shear.origin);
    let la = minus(l, a, origin);
    let x = l.mul(normal.x, la.x);
    let y = l.mul(normal.y, la.y);
    let z = l.mul(normal.z, la.z);
    let height = l.add(l.add(x, y), z);
    let along = dot(l, normal, splat_wide(l, ray.shear.direction));
    let opposite = l.lt(l.mul(height, along), l.splat(0.0));
    let found = l.bits(opposite) & through;
    if found == 0 || ray.t_min < 0.0 {
        return 0;
    }
    let (lb, lc) = (minus(l, b, origin), minus(l, c, origin));
    let inverse = splat_wide(l, ray.shear.inverse);
    let least = |a, b, c, inverse| min3(l, l.mul(a, inverse), l.mul(b, inverse), l.mul(c, inverse));
    let near = max3(
        l,
        least(la.x, lb.x, lc.x, inverse.x),
        least(la.y, lb.y, lc.y, inverse.y),
        least(la.z, lb.z, lc.z, inverse.z),
    );
    let sum = l.add(l.add(l.abs(x), l.abs(y)), l.abs(z));
    let slack = l.add(
        l.add(l.mul(sum, l.splat(SLACK)), l.splat(block.slack)),
        l.mul(l.abs(along), l.splat(SLACK_QUOTIENT)),
    );
    let certain = l.and(l.lt(near, l.splat(ray.t_min)), l.lt(slack, l.abs(height)));
    found & l.bits(certain)
}

/// Tests a block's triangles, eight at a time.
#[inline(always)]
pub(super) fn leaf<L: Lanes>(l: L, block: &Block, ray: &LeafRay<'_>, best: &mut BvhHit) {
    let edges = edges(
        l,
        [
            sheared(l, &block.vertices[0], ray),
            sheared(l, &block.vertices[1], ray),
            sheared(l, &block.vertices[2], ray),
        ],
    );
    let (below, above) = sides(l, &edges);
    let (below, above) = (l.bits(below), l.bits(above));
    let mut through = (below ^ above) & ((below & ray.below) | (above & ray.above));
    if through == 0 {
        return;
    }
    if !ray.filter.masks.is_empty() {
        through = unmasked(block, &ray.filter, through);
        if through == 0 {
            return;
        }
    }
    if ray.shear.parallel != 0 {
        // Slabs without a division.
        leaf_scalar(block, ray, through, best);
        return;
    }
    let corners = [
        vertex(l, &block.vertices[0]),
        vertex(l, &block.vertices[1]),
        vertex(l, &block.vertices[2]),
    ];
    let normal = vertex(l, &block.normals);
    through &= !behind(l, block, corners, normal, ray, through);
    if through == 0 {
        return;
    }
    let line = Line {
        origin: splat_wide(l, ray.shear.origin),
        direction: splat_wide(l, ray.shear.direction),
        inverse: splat_wide(l, ray.shear.inverse),
        slack: l.splat(ray.shear.slack),
        t_min: l.splat(ray.t_min),
        t_max: l.splat(best.t),
    };
    let tested = finish(l, corners, normal, &edges, &line);
    let on_edge = through & l.bits(tested.on_edge);
    if on_edge != 0 {
        leaf_scalar(block, ray, on_edge, best);
    }
    let mut hits = through & !on_edge & l.bits(tested.hit);
    if hits == 0 {
        return;
    }
    let (mut ts, mut us, mut vs) = (Row([0.0; 8]), Row([0.0; 8]), Row([0.0; 8]));
    l.store(tested.t, &mut ts.0);
    l.store(tested.u, &mut us.0);
    l.store(tested.v, &mut vs.0);
    while hits != 0 {
        let k = (hits.trailing_zeros() & 7) as usize;
        hits &= hits - 1;
        let primitive = block.primitives[k];
        if ts.0[k] < best.t || (ts.0[k] == best.t && primitive < best.primitive) {
            *best = BvhHit {
                t: ts.0[k],
                u: us.0[k],
                v: vs.0[k],
                primitive,
            };
        }
    }
}

/// Eight numbers in one cache line.
#[derive(Clone, Copy)]
#[repr(align(32))]
pub(super) struct Row(pub(super) [f32; 8]);

#[cold]
#[inline(never)]
pub(super) fn leaf_scalar(block: &Block, ray: &LeafRay<'_>, mut through: u32, best: &mut BvhHit) {
    while through != 0 {
        let k = (through.trailing_zeros() & 7) as usize;
        through &= through - 1;
        let corner = |i: usize| {
            let v = &block.vertices[i];
            Vec3::new(v[0][k], v[1][k], v[2][k])
        };
        let (a, b, c) = (corner(0), corner(1), corner(2));
        let hit = triangle_intersect_sheared(&ray.shear, ray.t_min, best.t, a, b, c);
        let primitive = block.primitives[k];
        if hit.hit != 0 && (hit.t < best.t || primitive < best.primitive) {
            *best = BvhHit {
                t: hit.t,
                u: hit.u,
                v: hit.v,
                primitive,
            };
        }
    }
}

/// Puts a child on the stack and asks for its first four cache lines, which
/// for a node are all. No branch: whether it is a node nobody foresees.
#[inline(always)]
fn postpone<L: Lanes>(l: L, nodes: &[Node], blocks: &[Block], stack: &mut Stack, entry: Entry) {
    stack.push(entry);
    let child = entry as u32;
    let block = blocks.as_ptr().wrapping_add((child & !LEAF) as usize);
    let node = nodes.as_ptr().wrapping_add(child as usize);
    let at: *const u8 = if child & LEAF == 0 {
        node.cast()
    } else {
        block.cast()
    };
    for line in 0..4 {
        l.prefetch(at.wrapping_add(64 * line));
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

/// Walks the tree. A ray with a zero in its direction needs planes that are
/// not fused.
#[inline(always)]
pub(super) fn walk<L: Lanes, const ANY: bool>(
    l: L,
    bvh: &Bvh8,
    ray: &Ray,
    filter: Filter<'_>,
) -> BvhHit {
    let (nodes, blocks, root) = (&*bvh.nodes, &*bvh.blocks, bvh.root);
    let (leaf, slopes) = prepare_leaf(ray, filter);
    if !L::FUSED {
        walk_planes::<L, ANY, false>(l, nodes, blocks, root, &leaf, &slopes, ray.t_max)
    } else if leaf.shear.parallel == 0 {
        walk_planes::<L, ANY, true>(l, nodes, blocks, root, &leaf, &slopes, ray.t_max)
    } else {
        l.walk_parallel::<ANY>(nodes, blocks, root, &leaf, &slopes, ray.t_max)
    }
}

#[inline(always)]
pub(super) fn walk_planes<L: Lanes, const ANY: bool, const FUSED: bool>(
    l: L,
    nodes: &[Node],
    blocks: &[Block],
    root: u32,
    leaf_ray: &LeafRay<'_>,
    slopes: &Slopes,
    t_max: f32,
) -> BvhHit {
    let mut best = BvhHit {
        t: t_max,
        u: 0.0,
        v: 0.0,
        primitive: BVH_MISS,
    };
    let ray = prepare::<L, FUSED>(l, slopes);
    let slack = l.splat(slopes.slack);
    let mut stack = Stack::new();
    let mut at = root;
    let mut t_max = l.splat(best.t);
    loop {
        'down: while at & LEAF == 0 {
            let Some(node) = nodes.get(at as usize) else {
                break;
            };
            let (mut mask, start) = enter::<L, FUSED>(l, node, &ray, t_max, slack);
            if mask == 0 {
                break;
            }
            let mut starts = Row([0.0; 8]);
            l.store(start, &mut starts.0);
            let (a, last) = next(&mut mask, &starts.0, node);
            if last {
                at = a as u32;
                continue;
            }
            if ANY {
                // The children with the largest boxes come last: those first.
                let mut a = a;
                loop {
                    postpone(l, nodes, blocks, &mut stack, a);
                    let (b, last) = next(&mut mask, &starts.0, node);
                    a = b;
                    if last {
                        at = a as u32;
                        continue 'down;
                    }
                }
            }
            let (b, last) = next(&mut mask, &starts.0, node);
            let (a, b) = ordered(a, b);
            if last {
                postpone(l, nodes, blocks, &mut stack, b);
                at = a as u32;
                continue;
            }
            let (c, last) = next(&mut mask, &starts.0, node);
            let (a, c) = ordered(a, c);
            let (b, c) = ordered(b, c);
            if last {
                postpone(l, nodes, blocks, &mut stack, c);
                postpone(l, nodes, blocks, &mut stack, b);
                at = a as u32;
                continue;
            }
            let mut many = [0; 8];
            many[0] = a;
            many[1] = b;
            many[2] = c;
            let mut count = 3;
            loop {
                let (d, last) = next(&mut mask, &starts.0, node);
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
                postpone(l, nodes, blocks, &mut stack, entry);
            }
            at = many[0] as u32;
            continue 'down;
        }
        if at & LEAF != 0
            && let Some(block) = blocks.get((at & !LEAF) as usize)
        {
            l.leaf(block, leaf_ray, &mut best);
            if ANY && best.primitive != BVH_MISS {
                return best;
            }
            t_max = l.splat(best.t);
        }
        loop {
            let Some(entry) = stack.pop() else {
                return best;
            };
            if ANY || f32::from_bits((entry >> 32) as u32) <= best.t {
                at = entry as u32;
                break;
            }
        }
    }
}
