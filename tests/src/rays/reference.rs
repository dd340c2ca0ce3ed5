//! What a ray hits, in double precision.
//!
//! The mesh and the ray are single precision, so differences of coordinates
//! are exact in double and every sign below is right but for rays within about
//! 1e-15 of an edge. Edges are inclusive and evaluated in one canonical order,
//! so the reference has no gaps either.

use glam::{DVec3, Vec3};
use raytwin_cpu::ray::bvh::{BvhTriangle, BvhView};
use raytwin_cpu::ray::ray::Ray;

/// The closest hit in double precision.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceHit {
    /// The ray's parameter.
    pub t: f64,
    /// Weight of the second vertex.
    pub u: f64,
    /// Weight of the third vertex.
    pub v: f64,
    /// Lowest index among the triangles at `t`.
    pub primitive: u32,
    /// All triangles whose `t` is within a relative 1e-12 of it.
    pub ties: Vec<u32>,
    /// Smallest barycentric weight: how far inside the triangle the hit is.
    pub margin: f64,
}

/// One triangle: `(t, u, v)` of its plane hit if the line passes through it.
///
/// No range is applied. `None` also for a triangle seen exactly edge-on.
#[must_use]
pub fn reference_triangle(ray: Ray, a: Vec3, b: Vec3, c: Vec3) -> Option<(f64, f64, f64)> {
    let o = ray.origin.as_dvec3();
    let d = ray.direction.as_dvec3();
    let [a, b, c] = [a, b, c].map(|p| p.as_dvec3() - o);
    let ea = edge(d, b, c);
    let eb = edge(d, c, a);
    let ec = edge(d, a, b);
    let below = ea < 0.0 || eb < 0.0 || ec < 0.0;
    let above = ea > 0.0 || eb > 0.0 || ec > 0.0;
    if below == above {
        return None;
    }
    let area = ea + eb + ec;
    let normal = (b - a).cross(c - a);
    let slope = normal.dot(d);
    if slope == 0.0 || area == 0.0 {
        return None;
    }
    // Inside the range of its vertices, whatever rounding a needle leaves.
    let axis = d.abs().max_position();
    let ends = [a, b, c].map(|p| p[axis] / d[axis]);
    let low = ends[0].min(ends[1]).min(ends[2]);
    let high = ends[0].max(ends[1]).max(ends[2]);
    let t = (normal.dot(a) / slope).clamp(low, high);
    Some((t, eb / area, ec / area))
}

/// Six times the volume of the tetrahedron over `d` and the edge, the ends in
/// one order.
fn edge(d: DVec3, a: DVec3, b: DVec3) -> f64 {
    let swap = (a.x, a.y, a.z) > (b.x, b.y, b.z);
    let (low, high) = if swap { (b, a) } else { (a, b) };
    let volume = d.dot(low.cross(high));
    if swap { -volume } else { volume }
}

fn touches(ray: Ray, low: Vec3, high: Vec3, t_max: f64) -> bool {
    let mut near = f64::from(ray.t_min);
    let mut far = t_max;
    for k in 0..3 {
        let (o, d) = (f64::from(ray.origin[k]), f64::from(ray.direction[k]));
        let (l, h) = (f64::from(low[k]) - o, f64::from(high[k]) - o);
        let pad = 1e-12 * (l.abs().max(h.abs()));
        if d == 0.0 {
            if l > pad || h < -pad {
                return false;
            }
        } else {
            let (s, e) = ((l - pad) / d, (h + pad) / d);
            let (s, e) = if d < 0.0 {
                ((h + pad) / d, (l - pad) / d)
            } else {
                (s, e)
            };
            near = near.max(s);
            far = far.min(e);
        }
    }
    near <= far + 1e-12 * far.abs()
}

/// Calls `f` with every triangle whose node the ray touches before the value
/// that `f` returned last.
fn walk(view: &BvhView<'_>, ray: Ray, mut f: impl FnMut(&BvhTriangle) -> f64) {
    let mut t_max = f64::from(ray.t_max) * (1.0 + 1e-6);
    let mut todo = vec![0u32];
    while let Some(i) = todo.pop() {
        let Some(node) = view.nodes.get(i as usize) else {
            continue;
        };
        if !touches(ray, node.min, node.max, t_max) {
            continue;
        }
        if node.count == 0 {
            todo.extend([node.first, node.first + 1]);
        } else {
            let first = node.first as usize;
            for t in &view.triangles[first..first + node.count as usize] {
                t_max = t_max.min(f(t));
            }
        }
    }
}

/// The closest hit with `t_min <= t <= t_max`.
#[must_use]
pub fn reference_closest(view: &BvhView<'_>, ray: Ray) -> Option<ReferenceHit> {
    const TIE: f64 = 1e-12;
    let mut all: Vec<(f64, f64, f64, u32)> = Vec::new();
    let mut best = f64::INFINITY;
    walk(view, ray, |tri| {
        if let Some((t, u, v)) = reference_triangle(ray, tri.a, tri.b, tri.c)
            && t >= f64::from(ray.t_min)
            && t <= f64::from(ray.t_max)
        {
            all.push((t, u, v, tri.primitive));
            best = best.min(t);
        }
        best + TIE * best.abs()
    });
    all.retain(|h| h.0 <= best + TIE * best.abs());
    all.sort_by_key(|h| h.3);
    let &(t, u, v, primitive) = all.first()?;
    Some(ReferenceHit {
        t,
        u,
        v,
        primitive,
        ties: all.iter().map(|h| h.3).collect(),
        margin: u.min(v).min(1.0 - u - v),
    })
}

/// Whether anything is hit within the range.
#[must_use]
pub fn reference_any(view: &BvhView<'_>, ray: Ray) -> bool {
    reference_closest(view, ray).is_some()
}
