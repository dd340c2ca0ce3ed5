//! The reflections' per-pixel program on the CPU: the twin of `program.wgsl`.

use glam::{UVec2, Vec2, Vec3};
use raytwin_cpu::brdf::layered::{LayeredStack, layered_eval, layered_sample};
use raytwin_cpu::filter::bilateral_variance::{BilateralVariancePixel, bilateral_variance_pixel};
use raytwin_cpu::filter::spatial_reconstruct::{
    SpatialReconstructHit, SpatialReconstruction, spatial_reconstruct_edge,
    spatial_reconstruct_pixel,
};
use raytwin_cpu::math::luminance::luminance;
use raytwin_cpu::math::vector::{vec3_dot, vec3_length, vec3_normalize};
use raytwin_cpu::pass::bvh8::Bvh8;
use raytwin_cpu::random::pcg::{pcg_hash, pcg_next, pcg_seed, pcg_unit};
use raytwin_cpu::ray::bvh::BVH_MISS;
use raytwin_cpu::ray::camera::{Camera, camera_ray};
use raytwin_cpu::ray::ray::{Ray, ray_at};
use raytwin_cpu::ray::sphere::sphere_intersect;
use raytwin_cpu::sample::basis::{basis_from_normal, basis_to_local, basis_to_world};

/// Entries of a ball's table of albedos, over the cosine.
pub(crate) const ALBEDOS: usize = 32;

/// Least offset as a fraction of the distance from the origin, 2^-18.
const OFFSET_PRECISION: f32 = 1.0 / 262_144.0;

/// Where a ray that hits nothing ends.
const FAR: f32 = 1000.0;

/// Plane distance, over the distance to the eye, at which a neighbour's hit no
/// longer counts.
const REACH: f32 = 0.02;

/// No ball.
pub(crate) const NONE: u32 = u32::MAX;

/// What every pixel of one run shares.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parameters {
    pub camera: Camera,
    pub light_direction: Vec3,
    pub offset: f32,
    pub floor: f32,
    pub checker: f32,
    pub width: u32,
    pub height: u32,
    pub balls: u32,
    pub frame: u32,
    pub first_row: u32,
    pub first_sample: u32,
    pub sample_count: u32,
    pub neighbours: u32,
    pub max_taps: u32,
    pub max_radius: f32,
}

/// A ball, its material and what its material reflects.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball {
    pub center: Vec3,
    pub radius: f32,
    /// The layers, of which the first `count` exist.
    pub stack: LayeredStack<2>,
    pub count: u32,
    /// How it looks in another ball.
    pub tint: Vec3,
    /// Reflected part of light from everywhere, by the cosine of the view.
    pub albedo: [Vec3; ALBEDOS],
}

/// The stack as a program for `N` layers takes it.
pub(crate) trait Layers<const N: usize> {
    fn stack(&self) -> LayeredStack<N>;
}

impl<const N: usize> Layers<N> for Ball {
    #[inline]
    fn stack(&self) -> LayeredStack<N> {
        LayeredStack {
            layers: std::array::from_fn(|k| self.stack.layers[k]),
            diffuse: self.stack.diffuse,
        }
    }
}

/// What a pixel sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    pub position: Vec3,
    /// Index of the ball, or [`NONE`].
    pub ball: u32,
    pub normal: Vec3,
    /// See [`REACH`]; 0 without a ball.
    pub reach: f32,
    /// Toward the eye.
    pub viewer: Vec3,
}

/// The scene behind the callbacks.
#[derive(Clone, Copy)]
pub(crate) struct World<'a> {
    /// The bits of `ray/bvh`, in less than half of the time.
    pub bvh: &'a Bvh8,
    pub normals: &'a [Vec3],
    pub balls: &'a [Ball],
}

/// What a ray meets.
struct Met {
    /// `FAR` for nothing.
    t: f32,
    normal: Vec3,
    ball: u32,
    hit: bool,
}

fn reflect_offset(p: &Parameters, position: Vec3) -> f32 {
    p.offset.max(vec3_length(position) * OFFSET_PRECISION)
}

fn reflect_closest(p: &Parameters, w: &World<'_>, ray: Ray) -> Met {
    let hit = w.bvh.closest(&ray);
    let mut met = Met {
        t: FAR,
        normal: Vec3::ZERO,
        ball: NONE,
        hit: false,
    };
    if hit.primitive != BVH_MISS {
        let n = w.normals[hit.primitive as usize];
        met.t = hit.t;
        met.normal = if vec3_dot(n, ray.direction) > 0.0 {
            -n
        } else {
            n
        };
        met.hit = true;
    }
    for k in 0..p.balls {
        let ball = &w.balls[k as usize];
        let s = sphere_intersect(ray, ball.center, ball.radius);
        if s.hit != 0 && s.t < met.t {
            met.t = s.t;
            met.ball = k;
            met.hit = true;
        }
    }
    if met.ball != NONE {
        met.normal = vec3_normalize(ray_at(ray, met.t) - w.balls[met.ball as usize].center);
    }
    met
}

/// Whether a ray meets anything.
pub(crate) fn reflect_any(balls: u32, w: &World<'_>, ray: Ray) -> bool {
    if w.bvh.any(&ray) {
        return true;
    }
    for k in 0..balls {
        let ball = &w.balls[k as usize];
        if sphere_intersect(ray, ball.center, ball.radius).hit != 0 {
            return true;
        }
    }
    false
}

fn reflect_light_visible(p: &Parameters, w: &World<'_>, position: Vec3) -> f32 {
    let ray = Ray {
        origin: position,
        direction: p.light_direction,
        t_min: reflect_offset(p, position),
        t_max: f32::MAX,
    };
    if reflect_any(p.balls, w, ray) {
        0.0
    } else {
        1.0
    }
}

/// The light along a ray: a sky, or a surface as the other stages shade it,
/// with one shadow ray. The floor has a pattern, balls are painted.
fn reflect_radiance(p: &Parameters, w: &World<'_>, ray: Ray, met: &Met) -> Vec3 {
    if !met.hit {
        let up = 0.5 + 0.5 * ray.direction.y;
        return Vec3::new(0.60 - 0.34 * up, 0.68 - 0.30 * up, 0.78 - 0.22 * up);
    }
    let position = ray_at(ray, met.t);
    let up = 0.5 + 0.5 * met.normal.y;
    let facing = vec3_dot(met.normal, p.light_direction).max(0.0);
    let mut key = 0.0;
    if facing > 0.0 {
        key = facing * reflect_light_visible(p, w, position);
    }
    let mut albedo = Vec3::ONE;
    if met.ball != NONE {
        albedo = w.balls[met.ball as usize].tint;
    } else if met.normal.y > 0.9 && position.y < p.floor {
        let square =
            (position.x * p.checker).floor() as i32 + (position.z * p.checker).floor() as i32;
        if square & 1 != 0 {
            albedo = Vec3::new(0.35, 0.33, 0.38);
        }
    }
    Vec3::new(
        albedo.x * ((0.18 + 0.13 * up) + 1.24 * key),
        albedo.y * ((0.16 + 0.17 * up) + 1.10 * key),
        albedo.z * ((0.15 + 0.22 * up) + 0.90 * key),
    )
}

/// The primary ray: what the pixel sees, and its colour where that is no ball.
pub(crate) fn reflect_surface(p: &Parameters, w: &World<'_>, pixel: UVec2) -> (Surface, Vec3) {
    let ray = camera_ray(
        Vec2::new(pixel.x as f32 + 0.5, pixel.y as f32 + 0.5),
        p.camera,
    );
    let met = reflect_closest(p, w, ray);
    let seen = Surface {
        position: ray_at(ray, met.t),
        ball: met.ball,
        normal: met.normal,
        reach: if met.ball == NONE { 0.0 } else { REACH * met.t },
        viewer: -ray.direction,
    };
    let colour = if met.ball == NONE {
        reflect_radiance(p, w, ray, &met)
    } else {
        Vec3::ZERO
    };
    (seen, colour)
}

/// Three independent numbers for one sample of one pixel.
fn reflect_random(pixel: UVec2, sample: u32) -> Vec3 {
    let a = pcg_next(pcg_seed(pixel, sample));
    let b = pcg_next(a.state);
    let c = pcg_next(b.state);
    Vec3::new(pcg_unit(a.value), pcg_unit(b.value), pcg_unit(c.value))
}

/// A number that turns a pixel's kernel.
fn reflect_turn(p: &Parameters, pixel: UVec2, lane: u32) -> f32 {
    pcg_unit(pcg_hash(
        pixel.x ^ pcg_hash(pixel.y ^ pcg_hash(2 * p.frame + lane)),
    ))
}

/// One reflection ray of a surface with `N` layers: the hit, and what the
/// sample weighs.
pub(crate) fn reflect_trace<const N: usize>(
    p: &Parameters,
    w: &World<'_>,
    s: &Surface,
    u: Vec3,
) -> (SpatialReconstructHit, Vec3) {
    let none = SpatialReconstructHit {
        position: s.position,
        pdf: 0.0,
        radiance: Vec3::ZERO,
    };
    let frame = basis_from_normal(s.normal);
    let wo = basis_to_local(frame, s.normal, s.viewer);
    let stack: LayeredStack<N> = w.balls[s.ball as usize].stack();
    let sample = layered_sample(&stack, wo, u);
    if sample.pdf <= 0.0 {
        return (none, Vec3::ZERO);
    }
    let ray = Ray {
        origin: s.position,
        direction: basis_to_world(frame, s.normal, sample.direction),
        t_min: reflect_offset(p, s.position),
        t_max: f32::MAX,
    };
    let met = reflect_closest(p, w, ray);
    let hit = SpatialReconstructHit {
        position: ray_at(ray, met.t),
        pdf: sample.pdf,
        radiance: reflect_radiance(p, w, ray, &met),
    };
    (hit, sample.weight)
}

/// The ray of a half-resolution pixel.
pub(crate) fn reflect_half<const N: usize>(
    p: &Parameters,
    w: &World<'_>,
    s: &Surface,
    at: UVec2,
) -> SpatialReconstructHit {
    reflect_trace::<N>(p, w, s, reflect_random(at, p.frame)).0
}

/// The sum over a pixel's own samples: the estimate without reconstruction.
pub(crate) fn reflect_sum<const N: usize>(
    p: &Parameters,
    w: &World<'_>,
    s: &Surface,
    pixel: UVec2,
) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for i in 0..p.sample_count {
        let u = reflect_random(pixel, p.frame.wrapping_add(p.first_sample + i));
        let (hit, weight) = reflect_trace::<N>(p, w, s, u);
        sum += Vec3::new(
            weight.x * hit.radiance.x,
            weight.y * hit.radiance.y,
            weight.z * hit.radiance.z,
        );
    }
    sum
}

/// A pixel's radiance from its neighbours' half-resolution hits.
pub(crate) fn reflect_reconstruct<const N: usize>(
    p: &Parameters,
    w: &World<'_>,
    surfaces: &[Surface],
    hits: &[SpatialReconstructHit],
    pixel: UVec2,
) -> SpatialReconstruction {
    let half = UVec2::new(p.width.div_ceil(2), p.height.div_ceil(2));
    let s = &surfaces[(pixel.y * p.width + pixel.x) as usize];
    let stack: LayeredStack<N> = w.balls[s.ball as usize].stack();
    let frame = basis_from_normal(s.normal);
    let wo = basis_to_local(frame, s.normal, s.viewer);
    spatial_reconstruct_pixel(
        pixel,
        half,
        p.neighbours,
        reflect_turn(p, pixel, 0),
        |at| hits[(at.y * half.x + at.x) as usize],
        |_, at, hit| {
            let other = &surfaces[(2 * at.y * p.width + 2 * at.x) as usize];
            let away = hit.position - s.position;
            if other.reach <= 0.0 || hit.pdf <= 0.0 || vec3_dot(away, away) <= 0.0 {
                return 0.0;
            }
            let wi = basis_to_local(frame, s.normal, vec3_normalize(away));
            let value = luminance(layered_eval(&stack, wo, wi)) * wi.z.max(0.0);
            value
                * spatial_reconstruct_edge(
                    s.normal,
                    other.normal,
                    other.position - s.position,
                    s.reach,
                )
        },
    )
}

/// The filtered radiance times what the ball reflects.
pub(crate) fn reflect_finish(
    p: &Parameters,
    w: &World<'_>,
    surfaces: &[Surface],
    reconstructed: &[SpatialReconstruction],
    pixel: UVec2,
) -> Vec3 {
    let index = (pixel.y * p.width + pixel.x) as usize;
    let s = &surfaces[index];
    let mut radiance = reconstructed[index].color;
    if p.max_taps > 0 {
        radiance = bilateral_variance_pixel(
            pixel,
            UVec2::new(p.width, p.height),
            p.max_radius,
            p.max_taps,
            reflect_turn(p, pixel, 1),
            |at| {
                let index = (at.y * p.width + at.x) as usize;
                let other = &surfaces[index];
                BilateralVariancePixel {
                    color: reconstructed[index].color,
                    variance: reconstructed[index].variance,
                    position: other.position,
                    reach: other.reach,
                    normal: other.normal,
                }
            },
        );
    }
    let albedo = reflect_albedo(&w.balls[s.ball as usize], vec3_dot(s.normal, s.viewer));
    Vec3::new(
        radiance.x * albedo.x,
        radiance.y * albedo.y,
        radiance.z * albedo.z,
    )
}

/// The table at a cosine, between its entries.
pub(crate) fn reflect_albedo(ball: &Ball, cos: f32) -> Vec3 {
    let x = cos.clamp(0.0, 1.0) * (ALBEDOS - 1) as f32;
    let k = (x as u32).min(ALBEDOS as u32 - 2);
    let t = x - k as f32;
    let (a, b) = (ball.albedo[k as usize], ball.albedo[k as usize + 1]);
    Vec3::new(
        a.x + (b.x - a.x) * t,
        a.y + (b.y - a.y) * t,
        a.z + (b.z - a.z) * t,
    )
}
