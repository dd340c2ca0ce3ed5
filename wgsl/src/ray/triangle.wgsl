// Ray against triangle, from both sides.
// Needs math/vector, ray/ray, ray/aabb, ray/plane.

// A triangle's box grows on each side by this part of its largest extent: more
// than the watertight test can shift an edge.
const TRIANGLE_PAD: f32 = 9.536743e-7;

// An edge of which no component reaches this has no length, and a triangle
// whose edges, brought to size one, span less has no area.
const TRIANGLE_FLAT: f32 = 7.888609e-31; // 2^-100

// Where a ray meets a triangle.
struct TriangleHit {
    // 1 if the ray meets the triangle within its range, else 0.
    hit: u32,
    // The ray's parameter at the hit; 0 on a miss.
    t: f32,
    // Barycentric weights of the second and the third vertex; 0 on a miss.
    u: f32,
    v: f32,
}

// Ray against triangle by Moeller and Trumbore's determinants. Fast, and not
// watertight. Inclusive edges.
fn triangle_intersect_moller_trumbore(ray: Ray, a: vec3f, b: vec3f, c: vec3f) -> TriangleHit {
    let e1 = b - a;
    let e2 = c - a;
    let p = vec3_cross(ray.direction, e2);
    let det = vec3_dot(e1, p);
    let from_a = ray.origin - a;
    let q = vec3_cross(from_a, e1);
    let t_scaled = vec3_dot(e2, q);
    let divides = plane_divides(t_scaled, det);
    let divisor = select(1.0, det, divides);
    let u = vec3_dot(from_a, p) / divisor;
    let v = vec3_dot(ray.direction, q) / divisor;
    let t = t_scaled / divisor;
    let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
    if divides && inside && t >= ray.t_min && t <= ray.t_max {
        return TriangleHit(1u, t, u, v);
    }
    return TriangleHit(0u, 0.0, 0.0, 0.0);
}

// A vertex, relative to the ray's origin and with its axes rotated, moved
// along the ray onto the plane through the origin. The two triangles of an
// edge move its ends by these same operations, so they see the same edge.
fn triangle_shear(vertex: vec3f, shear: vec2f) -> vec2f {
    return vec2f(
        vertex.x - shear.x * vertex.z,
        vertex.y - shear.y * vertex.z,
    );
}

// Which side of the edge from a to b the ray is on: twice the signed area of
// the triangle that it makes with the edge. Exactly antisymmetric: the ends
// are taken in one order, the lower first, and the sign flipped, so that both
// triangles of an edge evaluate the same products in the same places,
// whichever of them a compiler fuses with the subtraction. Products that round
// to the same number give zero; otherwise the sign is that of their
// comparison, fused or not.
fn triangle_edge(a: vec2f, b: vec2f) -> f32 {
    let swap = a.x > b.x || (a.x == b.x && a.y > b.y);
    let low = select(a, b, swap);
    let high = select(b, a, swap);
    let p = low.x * high.y;
    let q = low.y * high.x;
    let area = select(p - q, 0.0, p == q);
    return select(area, -area, swap);
}

// The three edge functions of a triangle whose vertices are given from the
// ray's origin: one sign where the ray lets it through.
fn triangle_edges(shear: RayShear, la: vec3f, lb: vec3f, lc: vec3f) -> vec3f {
    let sa = triangle_shear(ray_rotate(la, shear.axis), shear.shear);
    let sb = triangle_shear(ray_rotate(lb, shear.axis), shear.shear);
    let sc = triangle_shear(ray_rotate(lc, shear.axis), shear.shear);
    let ea = triangle_edge(sb, sc);
    let eb = triangle_edge(sc, sa);
    let ec = triangle_edge(sa, sb);
    return vec3f(ea, eb, ec);
}

// The core of triangle_intersect_watertight, for a ray that is prepared.
// t_min and t_max are both accepted.
fn triangle_intersect_sheared(
    shear: RayShear,
    t_min: f32,
    t_max: f32,
    a: vec3f,
    b: vec3f,
    c: vec3f,
) -> TriangleHit {
    let la = a - shear.origin;
    let lb = b - shear.origin;
    let lc = c - shear.origin;
    let edges = triangle_edges(shear, la, lb, lc);
    let ea = edges.x;
    let eb = edges.y;
    let ec = edges.z;
    let below = ea < 0.0 || eb < 0.0 || ec < 0.0;
    let above = ea > 0.0 || eb > 0.0 || ec > 0.0;
    if below == above {
        return TriangleHit(0u, 0.0, 0.0, 0.0);
    }

    // The interval of t in which the ray is inside the triangle's own box.
    let low = min(min(la, lb), lc);
    let high = max(max(la, lb), lc);
    let extent = high - low;
    let pad = max(max(extent.x, extent.y), extent.z) * TRIANGLE_PAD;
    let slab = aabb_slab_local(
        vec3f(low.x - pad, low.y - pad, low.z - pad),
        vec3f(high.x + pad, high.y + pad, high.z + pad),
        shear,
    );
    if slab.x > slab.y * AABB_WIDEN + shear.slack {
        return TriangleHit(0u, 0.0, 0.0, 0.0);
    }

    let area = (ea + eb) + ec;
    let divisor = select(area, 1.0, area == 0.0);
    let u = min(max(eb / divisor, 0.0), 1.0);
    let v = min(max(ec / divisor, 0.0), 1.0);

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
    let long_ca = length_ca >= length_ab && length_ca >= length_bc;
    let long_ab = length_ab >= length_bc;
    let first = select(select(ca, bc, long_ab), ab, long_ca);
    let second = select(select(ab, ca, long_ab), bc, long_ca);
    let normal = vec3_cross(first, second);
    let point = vec3f(
        (la.x + ab.x * u) - ca.x * v,
        (la.y + ab.y * u) - ca.y * v,
        (la.z + ab.z * u) - ca.z * v,
    );
    let numerator = vec3_dot(normal, point);
    let denominator = vec3_dot(normal, shear.direction);
    let divides = plane_divides(numerator, denominator);
    let plane = numerator / select(1.0, denominator, divides);
    let along = select(slab.x, plane, divides);
    let t = max(min(along, slab.y), slab.x);
    if t < t_min || t > t_max {
        return TriangleHit(0u, 0.0, 0.0, 0.0);
    }
    return TriangleHit(1u, t, u, v);
}

// Ray against triangle without gaps: a ray through a closed mesh meets it,
// also through edges and vertices, and whether or not a compiler fuses
// multiply-adds. Inclusive edges. t comes from the plane's equation, clamped
// into the interval in which the ray is inside the triangle's box; where that
// is empty there is no hit. A triangle seen exactly edge-on, and one without
// area, is missed.
fn triangle_intersect_watertight(ray: Ray, a: vec3f, b: vec3f, c: vec3f) -> TriangleHit {
    let shear = ray_shear(ray);
    return triangle_intersect_sheared(shear, ray.t_min, ray.t_max, a, b, c);
}

// A vector over its largest component, or zero where that is below
// TRIANGLE_FLAT.
fn triangle_even(v: vec3f) -> vec3f {
    let largest = max(max(abs(v.x), abs(v.y)), abs(v.z));
    if largest < TRIANGLE_FLAT {
        return vec3f(0.0);
    }
    return vec3f(v.x / largest, v.y / largest, v.z / largest);
}

// The unit normal of a triangle, on the side from which its vertices are seen
// counter-clockwise: the direction of (b - a) x (c - a). Zero for one without
// area. From the two shorter edges, each brought to size one first, so that
// neither long, nearly parallel edges nor very small or large triangles harm
// it.
fn triangle_normal(a: vec3f, b: vec3f, c: vec3f) -> vec3f {
    let ab = b - a;
    let bc = c - b;
    let ca = a - c;
    let all = max(
        max(max(abs(ab.x), abs(ab.y)), abs(ab.z)),
        max(max(abs(bc.x), abs(bc.y)), abs(bc.z)),
    );
    if all < TRIANGLE_FLAT {
        return vec3f(0.0);
    }
    // Which are the shorter ones, where squares may overflow.
    let even_ab = vec3f(ab.x / all, ab.y / all, ab.z / all);
    let even_bc = vec3f(bc.x / all, bc.y / all, bc.z / all);
    let even_ca = vec3f(ca.x / all, ca.y / all, ca.z / all);
    let length_ab = vec3_dot(even_ab, even_ab);
    let length_bc = vec3_dot(even_bc, even_bc);
    let length_ca = vec3_dot(even_ca, even_ca);
    let long_ca = length_ca >= length_ab && length_ca >= length_bc;
    let long_ab = length_ab >= length_bc;
    let first = select(select(ca, bc, long_ab), ab, long_ca);
    let second = select(select(ab, ca, long_ab), bc, long_ca);
    let normal = triangle_even(vec3_cross(triangle_even(first), triangle_even(second)));
    if vec3_dot(normal, normal) == 0.0 {
        return vec3f(0.0);
    }
    return vec3_normalize(normal);
}
