//! The traversal again, with its arithmetic as a compiler may change it.
//!
//! WGSL lets a compiler fuse a product with a sum, gives division an error of
//! 2.5 ULP and does not say which of two products is fused. Rust never fuses,
//! so what a GPU may do is spelled out here, and the families run against it.

use glam::{Vec2, Vec3};
use raytwin_cpu::ray::aabb::AABB_WIDEN;
use raytwin_cpu::ray::bvh::{BVH_MISS, BvhHit, BvhView};
use raytwin_cpu::ray::ray::{RAY_FAR, Ray, RayShear, ray_rotate, ray_shear};
use raytwin_cpu::ray::triangle::TRIANGLE_PAD;

/// Which product of `p - q` goes into the subtraction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fuse {
    /// None: two roundings of products, one of the difference.
    No,
    /// The first product.
    First,
    /// The second product.
    Second,
    /// The first, the second and none for the three edges of a triangle.
    Mixed,
}

/// One way to compute.
#[derive(Clone, Copy, Debug)]
pub struct Arithmetic {
    /// Edge functions.
    pub edges: Fuse,
    /// Shear, slab margin, plane equation: every product that meets a sum.
    pub rest: bool,
    /// ULP that each division of the ray set-up is off by, alternating.
    pub division: i32,
    /// Edge ends in one order, as the kernels have it.
    pub canonical: bool,
    /// Equal products make zero, as the kernels have it.
    pub guard: bool,
}

impl Arithmetic {
    /// The kernels' own arithmetic.
    pub const PLAIN: Self = Self {
        edges: Fuse::No,
        rest: false,
        division: 0,
        canonical: true,
        guard: true,
    };

    fn fused(self, p: (f32, f32), q: (f32, f32), site: usize) -> f32 {
        let fuse = match self.edges {
            Fuse::Mixed => [Fuse::First, Fuse::Second, Fuse::No][site],
            other => other,
        };
        match fuse {
            Fuse::First => p.0.mul_add(p.1, -(q.0 * q.1)),
            Fuse::Second => (-q.0).mul_add(q.1, p.0 * p.1),
            _ => p.0 * p.1 - q.0 * q.1,
        }
    }

    fn edge(self, a: Vec2, b: Vec2, site: usize) -> f32 {
        let swap = self.canonical && (a.x > b.x || (a.x == b.x && a.y > b.y));
        let (low, high) = if swap { (b, a) } else { (a, b) };
        let area = if self.guard && low.x * high.y == low.y * high.x {
            0.0
        } else {
            self.fused((low.x, high.y), (low.y, high.x), site)
        };
        if swap { -area } else { area }
    }

    fn product_sum(self, a: f32, b: f32, c: f32) -> f32 {
        if self.rest {
            a.mul_add(b, c)
        } else {
            a * b + c
        }
    }

    fn dot(self, a: Vec3, b: Vec3) -> f32 {
        self.product_sum(a.z, b.z, self.product_sum(a.x, b.x, a.y * b.y))
    }

    fn shear_point(self, v: Vec3, s: Vec2) -> Vec2 {
        Vec2::new(
            self.product_sum(-s.x, v.z, v.x),
            self.product_sum(-s.y, v.z, v.y),
        )
    }

    fn set_up(self, ray: Ray) -> RayShear {
        let mut s = ray_shear(ray);
        let off = |v: f32, k: i32| {
            if v == 0.0 || self.division == 0 {
                v
            } else {
                f32::from_bits(v.to_bits().wrapping_add_signed(k * self.division))
            }
        };
        // Opposite directions for neighbours is the worst that can happen.
        s.inverse = Vec3::new(
            off(s.inverse.x, 1),
            off(s.inverse.y, -1),
            off(s.inverse.z, 1),
        );
        s.shear = Vec2::new(off(s.shear.x, -1), off(s.shear.y, 1));
        s
    }

    fn slab(self, lower: Vec3, upper: Vec3, shear: &RayShear) -> (f32, f32) {
        let (mut near, mut far) = (-RAY_FAR, RAY_FAR);
        for k in 0..3 {
            let (a, b) = if shear.direction[k] == 0.0 {
                if lower[k] <= 0.0 && upper[k] >= 0.0 {
                    (-RAY_FAR, RAY_FAR)
                } else {
                    (RAY_FAR, -RAY_FAR)
                }
            } else {
                let (a, b) = (lower[k] * shear.inverse[k], upper[k] * shear.inverse[k]);
                (a.min(b), a.max(b))
            };
            near = near.max(a);
            far = far.min(b);
        }
        (near, far)
    }

    fn far(self, far: f32, shear: &RayShear) -> f32 {
        self.product_sum(far, AABB_WIDEN, shear.slack)
    }

    /// `t` if the triangle is hit up to `t_max`.
    fn triangle(self, s: &RayShear, t_min: f32, t_max: f32, v: [Vec3; 3]) -> Option<f32> {
        let local = v.map(|p| p - s.origin);
        let flat = local.map(|p| self.shear_point(ray_rotate(p, s.axis), s.shear));
        let e = [
            self.edge(flat[1], flat[2], 0),
            self.edge(flat[2], flat[0], 1),
            self.edge(flat[0], flat[1], 2),
        ];
        let below = e.iter().any(|&x| x < 0.0);
        let above = e.iter().any(|&x| x > 0.0);
        if below == above {
            return None;
        }
        let low = local[0].min(local[1]).min(local[2]);
        let high = local[0].max(local[1]).max(local[2]);
        let pad = (high - low).max_element();
        let grow = |p: Vec3, sign: f32| {
            Vec3::from_array(
                p.to_array()
                    .map(|x| self.product_sum(sign * pad, TRIANGLE_PAD, x)),
            )
        };
        let slab = self.slab(grow(low, -1.0), grow(high, 1.0), s);
        if slab.0 > self.far(slab.1, s) {
            return None;
        }
        let sides = [v[1] - v[0], v[2] - v[1], v[0] - v[2]];
        let [ab, bc, ca] = sides.map(|e| self.dot(e, e));
        let k = if ca >= ab && ca >= bc {
            0
        } else if ab >= bc {
            1
        } else {
            2
        };
        let (e1, e2) = (sides[k], sides[(k + 1) % 3]);
        let area = (e[0] + e[1]) + e[2];
        let weight = |e: f32| (e / if area == 0.0 { 1.0 } else { area }).clamp(0.0, 1.0);
        let point = Vec3::from_array([0, 1, 2].map(|i| {
            let near = self.product_sum(sides[0][i], weight(e[1]), local[0][i]);
            self.product_sum(-sides[2][i], weight(e[2]), near)
        }));
        let cross = |a: f32, b: f32, c: f32, d: f32| self.product_sum(a, b, -(c * d));
        let normal = Vec3::new(
            cross(e1.y, e2.z, e1.z, e2.y),
            cross(e1.z, e2.x, e1.x, e2.z),
            cross(e1.x, e2.y, e1.y, e2.x),
        );
        let (num, den) = (self.dot(normal, point), self.dot(normal, s.direction));
        let t = if den.abs() > 1e-36 { num / den } else { slab.0 };
        let t = t.min(slab.1).max(slab.0);
        (t >= t_min && t <= t_max).then_some(t)
    }

    /// The closest hit; weights are not computed.
    #[must_use]
    pub fn closest(self, view: &BvhView<'_>, ray: Ray) -> BvhHit {
        let s = self.set_up(ray);
        let mut best = BvhHit {
            t: ray.t_max,
            u: 0.0,
            v: 0.0,
            primitive: BVH_MISS,
        };
        let mut todo = vec![0u32];
        while let Some(i) = todo.pop() {
            let Some(node) = view.nodes.get(i as usize) else {
                continue;
            };
            let slab = self.slab(node.min - s.origin, node.max - s.origin, &s);
            let near = slab.0.max(ray.t_min);
            if near > self.far(slab.1, &s) || near > best.t {
                continue;
            }
            if node.count == 0 {
                todo.extend([node.first, node.first + 1]);
                continue;
            }
            let first = node.first as usize;
            for t in &view.triangles[first..first + node.count as usize] {
                if let Some(at) = self.triangle(&s, ray.t_min, best.t, [t.a, t.b, t.c])
                    && (at < best.t || t.primitive < best.primitive)
                {
                    best.t = at;
                    best.primitive = t.primitive;
                }
            }
        }
        best
    }
}
