//! Ray against triangle, from both sides.

use glam::{Vec2, Vec3};

use super::aabb::{AABB_WIDEN, aabb_max, aabb_min, aabb_slab_local};
use super::plane::plane_divides;
use super::ray::{Ray, RayShear, ray_rotate, ray_shear};
use crate::math::vector::{vec3_cross, vec3_dot, vec3_normalize};

/// A triangle's box grows on each side by this part, 2^-20, of its largest
/// extent: more than the watertight test can shift an edge.
pub const TRIANGLE_PAD: f32 = 1.0 / 1_048_576.0;

/// An edge of which no component reaches this, 2^-100, has no length, and a
/// triangle whose edges, brought to size one, span less has no area.
pub const TRIANGLE_FLAT: f32 = f32::from_bits((127 - 100) << 23);

/// Where a ray meets a triangle.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::{Ray, ray_at};
/// use raytwin_cpu::ray::triangle::triangle_intersect_watertight;
///
/// // The weights place the hit: a (1 - u - v) + b u + c v.
/// let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let hit = triangle_intersect_watertight(ray, a, b, c);
/// let point = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
/// assert!((point - ray_at(ray, hit.t)).length() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct TriangleHit {
    /// 1 if the ray meets the triangle within its range, else 0.
    pub hit: u32,
    /// The ray's parameter at the hit; 0 on a miss.
    pub t: f32,
    /// Barycentric weight of the second vertex, in `[0, 1]`; 0 on a miss.
    pub u: f32,
    /// Barycentric weight of the third vertex, in `[0, 1]`; 0 on a miss.
    pub v: f32,
}

const MISS: TriangleHit = TriangleHit {
    hit: 0,
    t: 0.0,
    u: 0.0,
    v: 0.0,
};

/// Ray against triangle by Möller and Trumbore's determinants.
///
/// Fast, and not watertight: of rays aimed at the edges of a closed mesh
/// several in a hundred pass between two triangles. Inclusive edges. Möller,
/// Trumbore: Fast, Minimum Storage Ray/Triangle Intersection, JGT 2(1), 1997.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::Ray;
/// use raytwin_cpu::ray::triangle::triangle_intersect_moller_trumbore;
///
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let hit =
///     triangle_intersect_moller_trumbore(ray, Vec3::ZERO, Vec3::X, Vec3::Y);
/// assert_eq!((hit.hit, hit.t, hit.u, hit.v), (1, 2.0, 0.25, 0.5));
/// ```
#[inline]
#[must_use]
pub fn triangle_intersect_moller_trumbore(ray: Ray, a: Vec3, b: Vec3, c: Vec3) -> TriangleHit {
    let e1 = b - a;
    let e2 = c - a;
    let p = vec3_cross(ray.direction, e2);
    let det = vec3_dot(e1, p);
    let from_a = ray.origin - a;
    let q = vec3_cross(from_a, e1);
    let t_scaled = vec3_dot(e2, q);
    let divides = plane_divides(t_scaled, det);
    let divisor = if divides { det } else { 1.0 };
    let u = vec3_dot(from_a, p) / divisor;
    let v = vec3_dot(ray.direction, q) / divisor;
    let t = t_scaled / divisor;
    let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
    if divides && inside && t >= ray.t_min && t <= ray.t_max {
        TriangleHit { hit: 1, t, u, v }
    } else {
        MISS
    }
}

/// A vertex, relative to the ray's origin and with its axes rotated, moved
/// along the ray onto the plane through the origin.
///
/// The two triangles of an edge move its ends by these same operations, so
/// they see the same edge.
#[inline(always)]
fn triangle_shear(vertex: Vec3, shear: Vec2) -> Vec2 {
    Vec2::new(vertex.x - shear.x * vertex.z, vertex.y - shear.y * vertex.z)
}

/// Which side of the edge from `a` to `b` the ray is on: twice the signed area
/// of the triangle that it makes with the edge.
///
/// Exactly antisymmetric: the ends are taken in one order, the lower first,
/// and the sign flipped, so that both triangles of an edge evaluate the same
/// products in the same places, whichever of them a compiler fuses with the
/// subtraction. Products that round to the same number give zero; otherwise
/// the sign is that of their comparison, fused or not.
#[inline(always)]
fn triangle_edge(a: Vec2, b: Vec2) -> f32 {
    let swap = a.x > b.x || (a.x == b.x && a.y > b.y);
    let low = if swap { b } else { a };
    let high = if swap { a } else { b };
    let p = low.x * high.y;
    let q = low.y * high.x;
    let area = if p == q { 0.0 } else { p - q };
    if swap { -area } else { area }
}

/// The three edge functions of a triangle whose vertices are given from the
/// ray's origin: one sign where the ray lets it through.
#[inline(always)]
pub(super) fn triangle_edges(shear: &RayShear, la: Vec3, lb: Vec3, lc: Vec3) -> Vec3 {
    let sa = triangle_shear(ray_rotate(la, shear.axis), shear.shear);
    let sb = triangle_shear(ray_rotate(lb, shear.axis), shear.shear);
    let sc = triangle_shear(ray_rotate(lc, shear.axis), shear.shear);
    let ea = triangle_edge(sb, sc);
    let eb = triangle_edge(sc, sa);
    let ec = triangle_edge(sa, sb);
    Vec3::new(ea, eb, ec)
}

/// The core of [`triangle_intersect_watertight`], for a ray that is prepared.
///
/// `t_min` and `t_max` are both accepted.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::{Ray, ray_shear};
/// use raytwin_cpu::ray::triangle::triangle_intersect_sheared;
///
/// // One ray, many triangles: prepare it once.
/// let ray = Ray {
///     origin: Vec3::new(0.25, 0.5, 2.0),
///     direction: Vec3::NEG_Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let shear = ray_shear(ray);
/// let mut closest = ray.t_max;
/// for z in [-1.0, 1.0, 0.0] {
///     let (a, b, c) = (
///         Vec3::new(0.0, 0.0, z),
///         Vec3::new(1.0, 0.0, z),
///         Vec3::new(0.0, 1.0, z),
///     );
///     let hit = triangle_intersect_sheared(&shear, ray.t_min, closest, a, b, c);
///     if hit.hit == 1 {
///         closest = hit.t;
///     }
/// }
/// assert_eq!(closest, 1.0);
/// ```
#[inline(always)]
#[must_use]
pub fn triangle_intersect_sheared(
    shear: &RayShear,
    t_min: f32,
    t_max: f32,
    a: Vec3,
    b: Vec3,
    c: Vec3,
) -> TriangleHit {
    let la = a - shear.origin;
    let lb = b - shear.origin;
    let lc = c - shear.origin;
    let edges = triangle_edges(shear, la, lb, lc);
    let (ea, eb, ec) = (edges.x, edges.y, edges.z);
    let below = ea < 0.0 || eb < 0.0 || ec < 0.0;
    let above = ea > 0.0 || eb > 0.0 || ec > 0.0;
    if below == above {
        return MISS;
    }
    triangle_finish(shear, t_min, t_max, [a, b, c], [la, lb, lc], [ea, eb, ec])
}

/// `t` and barycentrics of a triangle whose edges have let the ray through.
#[inline]
fn triangle_finish(
    shear: &RayShear,
    t_min: f32,
    t_max: f32,
    vertices: [Vec3; 3],
    local: [Vec3; 3],
    edges: [f32; 3],
) -> TriangleHit {
    let [a, b, c] = vertices;
    let [la, lb, lc] = local;
    let [ea, eb, ec] = edges;

    // The interval of t in which the ray is inside the triangle's own box.
    let low = Vec3::new(
        aabb_min(aabb_min(la.x, lb.x), lc.x),
        aabb_min(aabb_min(la.y, lb.y), lc.y),
        aabb_min(aabb_min(la.z, lb.z), lc.z),
    );
    let high = Vec3::new(
        aabb_max(aabb_max(la.x, lb.x), lc.x),
        aabb_max(aabb_max(la.y, lb.y), lc.y),
        aabb_max(aabb_max(la.z, lb.z), lc.z),
    );
    let extent = high - low;
    let pad = aabb_max(aabb_max(extent.x, extent.y), extent.z) * TRIANGLE_PAD;
    let slab = aabb_slab_local(
        Vec3::new(low.x - pad, low.y - pad, low.z - pad),
        Vec3::new(high.x + pad, high.y + pad, high.z + pad),
        shear,
    );
    if slab.x > slab.y * AABB_WIDEN + shear.slack {
        return MISS;
    }

    let area = (ea + eb) + ec;
    let divisor = if area == 0.0 { 1.0 } else { area };
    let u = aabb_min(aabb_max(eb / divisor, 0.0), 1.0);
    let v = aabb_min(aabb_max(ec / divisor, 0.0), 1.0);

    // The plane's equation, kept inside the box's interval. The normal comes
    // from the two shorter edges, since the product of two long, nearly
    // parallel ones cancels, and the plane's point from the weights: next to
    // the hit a wrong normal, as a needle has, does little harm.
    let ab = b - a;
    let bc = c - b;
    let ca = a - c;
    let length_ab = vec3_dot(ab, ab);
    let length_bc = vec3_dot(bc, bc);
    let length_ca = vec3_dot(ca, ca);
    let (first, second) = if length_ca >= length_ab && length_ca >= length_bc {
        (ab, bc)
    } else if length_ab >= length_bc {
        (bc, ca)
    } else {
        (ca, ab)
    };
    let normal = vec3_cross(first, second);
    let point = Vec3::new(
        (la.x + ab.x * u) - ca.x * v,
        (la.y + ab.y * u) - ca.y * v,
        (la.z + ab.z * u) - ca.z * v,
    );
    let numerator = vec3_dot(normal, point);
    let denominator = vec3_dot(normal, shear.direction);
    let divides = plane_divides(numerator, denominator);
    let plane = numerator / if divides { denominator } else { 1.0 };
    let along = if divides { plane } else { slab.x };
    let t = aabb_max(aabb_min(along, slab.y), slab.x);
    if t < t_min || t > t_max {
        return MISS;
    }
    TriangleHit { hit: 1, t, u, v }
}

/// Ray against triangle without gaps: a ray through a closed mesh meets it,
/// also through edges and vertices, and whether or not a compiler fuses
/// multiply-adds.
///
/// Edge tests of Woop, Benthin, Wald: Watertight Ray/Triangle Intersection,
/// JCGT 2(1), 2013, in single precision only: see `triangle_edge` for what
/// replaces the published fall-back to double. Inclusive edges. `t` comes from
/// the plane's equation, clamped into the interval in which the ray is inside
/// the triangle's box, so a sliver cannot put it anywhere else, and the hit is
/// rejected where that interval is empty. A triangle seen exactly edge-on, and
/// one without area, is missed.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::Ray;
/// use raytwin_cpu::ray::triangle::triangle_intersect_watertight;
///
/// // Two triangles share the edge from a to c; a ray at its middle hits.
/// let (a, b, c, d) = (Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y);
/// let ray = Ray {
///     origin: Vec3::new(0.3, 0.2, 2.0),
///     direction: Vec3::new(0.1, 0.15, -1.0),
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let first = triangle_intersect_watertight(ray, a, b, c);
/// let second = triangle_intersect_watertight(ray, a, c, d);
/// assert!(first.hit == 1 || second.hit == 1);
/// ```
#[inline]
#[must_use]
pub fn triangle_intersect_watertight(ray: Ray, a: Vec3, b: Vec3, c: Vec3) -> TriangleHit {
    let shear = ray_shear(ray);
    triangle_intersect_sheared(&shear, ray.t_min, ray.t_max, a, b, c)
}

/// A vector over its largest component, or zero where that is below
/// [`TRIANGLE_FLAT`].
#[inline(always)]
fn triangle_even(v: Vec3) -> Vec3 {
    let largest = aabb_max(aabb_max(v.x.abs(), v.y.abs()), v.z.abs());
    if largest < TRIANGLE_FLAT {
        return Vec3::ZERO;
    }
    Vec3::new(v.x / largest, v.y / largest, v.z / largest)
}

/// The unit normal of a triangle, on the side from which its vertices are seen
/// counter-clockwise: the direction of `(b - a) × (c - a)`. Zero for one
/// without area.
///
/// From the two shorter edges, each brought to size one first, so that neither
/// long, nearly parallel edges nor very small or large triangles harm it.
/// Each component errs by a few units of rounding over the sine of the angle
/// between those edges, if the edges themselves are exact; rounding the
/// difference of two far vertices turns it further, as it turns the triangle.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::triangle::triangle_normal;
///
/// assert_eq!(triangle_normal(Vec3::ZERO, Vec3::X, Vec3::Y), Vec3::Z);
/// // Seen from the other side, and without area.
/// assert_eq!(triangle_normal(Vec3::ZERO, Vec3::Y, Vec3::X), Vec3::NEG_Z);
/// assert_eq!(triangle_normal(Vec3::ZERO, Vec3::X, 2.0 * Vec3::X), Vec3::ZERO);
/// ```
#[inline]
#[must_use]
pub fn triangle_normal(a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    let ab = b - a;
    let bc = c - b;
    let ca = a - c;
    let all = aabb_max(
        aabb_max(aabb_max(ab.x.abs(), ab.y.abs()), ab.z.abs()),
        aabb_max(aabb_max(bc.x.abs(), bc.y.abs()), bc.z.abs()),
    );
    if all < TRIANGLE_FLAT {
        return Vec3::ZERO;
    }
    // Which are the shorter ones, where squares may overflow.
    let even_ab = Vec3::new(ab.x / all, ab.y / all, ab.z / all);
    let even_bc = Vec3::new(bc.x / all, bc.y / all, bc.z / all);
    let even_ca = Vec3::new(ca.x / all, ca.y / all, ca.z / all);
    let length_ab = vec3_dot(even_ab, even_ab);
    let length_bc = vec3_dot(even_bc, even_bc);
    let length_ca = vec3_dot(even_ca, even_ca);
    let (first, second) = if length_ca >= length_ab && length_ca >= length_bc {
        (ab, bc)
    } else if length_ab >= length_bc {
        (bc, ca)
    } else {
        (ca, ab)
    };
    let normal = triangle_even(vec3_cross(triangle_even(first), triangle_even(second)));
    if vec3_dot(normal, normal) == 0.0 {
        return Vec3::ZERO;
    }
    vec3_normalize(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    type Test = fn(Ray, Vec3, Vec3, Vec3) -> TriangleHit;
    const BOTH: [Test; 2] = [
        triangle_intersect_moller_trumbore,
        triangle_intersect_watertight,
    ];

    fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
        Ray {
            origin: origin.into(),
            direction: direction.into(),
            t_min: 0.0,
            t_max: f32::MAX,
        }
    }

    fn corner() -> [Vec3; 3] {
        [Vec3::ZERO, Vec3::X, Vec3::Y]
    }

    #[test]
    fn weights_and_distance() {
        let [a, b, c] = corner();
        for test in BOTH {
            for z in [4.0, -4.0] {
                let h = test(ray([0.25, 0.5, z], [0.0, 0.0, -0.5 * z]), a, b, c);
                assert_eq!((h.hit, h.t, h.u, h.v), (1, 2.0, 0.25, 0.5));
            }
            assert_eq!(
                test(ray([0.75, 0.5, 1.0], [0.0, 0.0, -1.0]), a, b, c).hit,
                0
            );
            assert_eq!(test(ray([0.25, 0.5, 1.0], [0.0, 0.0, 1.0]), a, b, c).hit, 0);
            assert_eq!(test(ray([-1.0, 0.2, 0.0], [1.0, 0.0, 0.0]), a, b, c).hit, 0);
        }
    }

    #[test]
    fn oblique_rays_agree_with_the_point_aimed_at() {
        let (a, b, c) = (
            Vec3::new(1.0, -2.0, 5.0),
            Vec3::new(4.0, 1.0, 3.0),
            Vec3::new(-2.0, 3.0, 7.0),
        );
        for test in BOTH {
            for axis in 0..3 {
                // Each axis in turn is the largest.
                let turn = |v: Vec3| ray_rotate(v, axis);
                let p = a * 0.3 + b * 0.45 + c * 0.25;
                let o = Vec3::new(0.5, 0.25, -1.0);
                let r = ray(turn(o).into(), turn((p - o) * 0.5).into());
                let h = test(r, turn(a), turn(b), turn(c));
                assert_eq!(h.hit, 1);
                assert!((h.t - 2.0).abs() < 1e-6, "{}", h.t);
                assert!((h.u - 0.45).abs() < 1e-6 && (h.v - 0.25).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn edges_and_vertices_are_inside() {
        let [a, b, c] = corner();
        for test in BOTH {
            for (x, y) in [
                (0.0, 0.0),
                (1.0, 0.0),
                (0.0, 1.0),
                (0.5, 0.0),
                (0.0, 0.5),
                (0.5, 0.5),
            ] {
                for z in [-1.0, 1.0] {
                    for zero in [0.0, -0.0] {
                        let h = test(ray([x, y, z], [zero, zero, -z]), a, b, c);
                        assert_eq!((h.hit, h.t), (1, 1.0), "{x} {y}");
                    }
                }
            }
        }
    }

    #[test]
    fn ends_of_the_range_are_inside() {
        let [a, b, c] = corner();
        let mut r = ray([0.25, 0.25, 3.0], [0.0, 0.0, -1.0]);
        for test in BOTH {
            (r.t_min, r.t_max) = (3.0, 3.0);
            assert_eq!(test(r, a, b, c).hit, 1);
            (r.t_min, r.t_max) = (0.0, 3.0f32.next_down());
            assert_eq!(test(r, a, b, c).hit, 0);
            (r.t_min, r.t_max) = (3.0f32.next_up(), 9.0);
            assert_eq!(test(r, a, b, c).hit, 0);
        }
    }

    #[test]
    fn no_area_no_hit() {
        let r = ray([0.5, 0.0, 1.0], [0.0, 0.0, -1.0]);
        for test in BOTH {
            assert_eq!(test(r, Vec3::ZERO, Vec3::X, Vec3::X * 0.25).hit, 0);
            assert_eq!(test(r, Vec3::X * 0.5, Vec3::X * 0.5, Vec3::X * 0.5).hit, 0);
        }
    }

    #[test]
    fn normals_of_any_size() {
        let [a, b, c] = corner();
        for scale in [1e-28, 1e-12, 1.0, 1e11] {
            assert_eq!(triangle_normal(a * scale, b * scale, c * scale), Vec3::Z);
            assert_eq!(triangle_normal(c * scale, b * scale, a * scale), -Vec3::Z);
        }
        // A needle: 1e-10 of its length wide.
        let n = triangle_normal(a, b, Vec3::new(0.5, 1e-10, 1e-10));
        let truth = Vec3::new(0.0, -1.0, 1.0) / 2f32.sqrt();
        assert!((n - truth).abs().max_element() < 2e-7, "{n}");
        for (a, b, c) in [(a, a, a), (a, b, b), (a, b, b * 0.25), (a, a, b)] {
            assert_eq!(triangle_normal(a, b, c), Vec3::ZERO);
        }
    }

    #[test]
    fn zero_direction_misses() {
        let [a, b, c] = corner();
        for test in BOTH {
            assert_eq!(test(ray([0.2, 0.2, 0.0], [0.0; 3]), a, b, c).hit, 0);
        }
    }

    #[test]
    fn edges_are_antisymmetric() {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / 16_777_216.0 - 0.5
        };
        for _ in 0..10_000 {
            let (a, b) = (Vec2::new(next(), next()), Vec2::new(next(), next()));
            assert_eq!(triangle_edge(a, b), -triangle_edge(b, a));
        }
    }
}
