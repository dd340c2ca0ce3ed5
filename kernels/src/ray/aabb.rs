//! Ray against box: the pair and its contract.

pub use raytwin_cpu::ray::aabb::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::ray::AABB;

#[cfg(feature = "contract")]
crate::value_struct!(AabbHit {
    hit: u32,
    t_near: f32,
    t_far: f32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ray::{Ray, RayShear, WideRay, ray_domain, ray_shear};
    use crate::contract::{Kernel, domains};
    use glam::{DVec2, DVec3, Vec2, Vec3};

    const SOURCE: &str = "Kay and Kajiya 1986; Ize 2013, JCGT 2(2), robust far plane";
    type WideShear = (DVec3, DVec3, DVec3, DVec2, u32, u32, f64);

    fn slab_local(lower: Vec3, upper: Vec3, shear: RayShear) -> Vec2 {
        aabb_slab_local(lower, upper, &shear)
    }
    fn slab(lower: Vec3, upper: Vec3, shear: RayShear) -> Vec2 {
        aabb_slab(lower, upper, &shear)
    }
    // By the reciprocals given, which are inputs here.
    fn interval(lower: DVec3, upper: DVec3, direction: DVec3, inverse: DVec3) -> DVec2 {
        let far = f64::from(super::ray::RAY_FAR);
        let mut near_far = DVec2::new(f64::NEG_INFINITY, f64::INFINITY);
        for i in 0..3 {
            let (a, b) = if direction[i] == 0.0 {
                if lower[i] <= 0.0 && upper[i] >= 0.0 {
                    (-far, far)
                } else {
                    (far, -far)
                }
            } else {
                let (a, b) = (lower[i] * inverse[i], upper[i] * inverse[i]);
                (a.min(b), a.max(b))
            };
            near_far = DVec2::new(near_far.x.max(a), near_far.y.min(b));
        }
        near_far
    }
    fn of_ray(ray: WideRay, lower: DVec3, upper: DVec3) -> DVec2 {
        let inverse = 1.0 / ray.1;
        interval(lower - ray.0, upper - ray.0, ray.1, inverse)
    }
    fn reach(ray: WideRay, lower: DVec3, upper: DVec3) -> f64 {
        let wide = lower.abs().max(upper.abs()) + ray.0.abs();
        (0..3)
            .filter(|&i| ray.1[i] != 0.0)
            .map(|i| (wide[i] / ray.1[i]).abs())
            .fold(0.0, f64::max)
    }

    let corners = domains::vec3(domains::range(-4.0, 4.0))
        .and(domains::vec3(domains::range(0.0, 4.0)))
        .map(|(lower, size)| (lower, lower + size));
    let with_shear = ray_domain()
        .and(corners.clone())
        .map(|(ray, (lower, upper))| (lower, upper, ray_shear(ray)));
    let ray = |origin: Vec3, direction: Vec3| Ray {
        origin,
        direction,
        t_min: 0.0,
        t_max: 100.0,
    };
    let hard_rays = [
        ray(Vec3::new(-2.0, 0.5, 0.5), Vec3::X),
        // In the plane of a face, and along an edge: with 1/0 these are 0·∞.
        ray(Vec3::new(-2.0, 0.0, 0.5), Vec3::X),
        ray(Vec3::new(-2.0, 1.0, 1.0), Vec3::new(1.0, 0.0, -0.0)),
        ray(Vec3::new(-2.0, 0.0, 0.0), Vec3::new(1.0, -0.0, 0.0)),
        ray(Vec3::splat(0.5), Vec3::new(0.3, -0.5, 0.7)),
        ray(Vec3::splat(-1.0), Vec3::ONE),
        ray(Vec3::new(-2.0, 0.5, 0.5), Vec3::new(1e-10, 0.0, 0.0)),
        ray(Vec3::new(-2.0, 2.0, 0.5), Vec3::X),
    ];

    vec![
        Kernel::new(
            "ray/aabb",
            "aabb_slab_local",
            ["lower", "upper", "shear"],
            slab_local,
            |lower: DVec3, upper: DVec3, (_, d, inverse, ..): WideShear| {
                interval(lower, upper, d, inverse)
            },
            with_shear.clone(),
        )
        .few_ulp(0.5, 1.0)
        .hard(hard_rays.map(|r| (Vec3::ZERO - r.origin, Vec3::ONE - r.origin, ray_shear(r))))
        .source(SOURCE)
        .build(),
        Kernel::new(
            "ray/aabb",
            "aabb_slab",
            ["box_min", "box_max", "shear"],
            slab,
            |lower: DVec3, upper: DVec3, (o, d, inverse, ..): WideShear| {
                interval(lower - o, upper - o, d, inverse)
            },
            with_shear,
        )
        .few_ulp(1.5, 3.0)
        .hard(hard_rays.map(|r| (Vec3::ZERO, Vec3::ONE, ray_shear(r))))
        .source(SOURCE)
        .build(),
        Kernel::new(
            "ray/aabb",
            "aabb_intersect",
            ["ray", "box_min", "box_max"],
            aabb_intersect,
            |ray: WideRay, lower: DVec3, upper: DVec3| {
                let slab = of_ray(ray, lower, upper);
                // As documented, the far plane is moved out.
                let near = slab.x.max(ray.2);
                let far = (slab.y * f64::from(AABB_WIDEN)).min(ray.3);
                if near <= far {
                    (1, near, far)
                } else {
                    (0, 0.0, 0.0)
                }
            },
            ray_domain()
                .and(corners)
                .map(|(ray, (lower, upper))| (ray, lower, upper)),
        )
        .scale_by(|ray: WideRay, lower: DVec3, upper: DVec3| reach(ray, lower, upper).max(1e-3))
        .undecided(|ray: WideRay, lower: DVec3, upper: DVec3| {
            let slab = of_ray(ray, lower, upper);
            let widened = slab.y * f64::from(AABB_WIDEN);
            let near = 2e-6 * reach(ray, lower, upper);
            let close = |a: f64, b: f64| (a - b).abs() < near && a != b;
            close(slab.x, widened) || close(widened, ray.2) || close(slab.x, ray.3)
        })
        .few_ulp(2.0, 6.5)
        .hard(hard_rays.map(|r| (r, Vec3::ZERO, Vec3::ONE)))
        .source(SOURCE)
        .build(),
    ]
}
