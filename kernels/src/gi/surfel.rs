//! Surfels: the pair and its contract.

pub use raytwin_cpu::gi::surfel::*;

/// The WGSL twin, without what it requires and without its callbacks.
pub const WGSL: &str = raytwin_wgsl::gi::SURFEL;

#[cfg(feature = "contract")]
crate::value_struct!(Surfel {
    position: glam::Vec3,
    radius: f32,
    normal: glam::Vec3,
    mesh: u32,
});

#[cfg(feature = "contract")]
crate::value_struct!(SurfelGathered {
    irradiance: glam::Vec3,
    weight: f32,
});

/// A surfel in double precision.
#[cfg(feature = "contract")]
pub(crate) type WideSurfel = (glam::DVec3, f64, glam::DVec3, u32);

/// Surfels with a point near each: most within the rim, some beyond.
#[cfg(feature = "contract")]
pub(crate) fn surfel_and_point() -> crate::contract::Domain<(Surfel, glam::Vec3)> {
    use crate::contract::domains;
    domains::vec3(domains::range(-8.0, 8.0))
        .and(domains::log_range(1e-3, 1e3))
        .and(domains::unit_vector())
        .and(domains::unit_vector())
        .and(domains::range(0.0, 1.3))
        .and(domains::unit())
        .map(|(((((position, radius), normal), away), far), flat)| {
            let surfel = Surfel {
                position,
                radius,
                normal,
                mesh: 0,
            };
            // Half of them next to the plane, where the weights are.
            let along = if flat < 0.5 { 0.8 } else { 0.0 };
            let to = away - normal * (normal.dot(away) * along);
            (surfel, position + to * (radius * far))
        })
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use crate::ray::camera::Camera;
    use glam::{DVec2, DVec3, UVec2, Vec2, Vec3};

    const MODULE: &str = "gi/surfel";
    const CHAPTER: &str = "Ray Tracing Gems, ch. 25 (diffuse GI)";
    const SQUASHED: &str = "Lehtinen et al. 2008; Ray Tracing Gems, ch. 25";
    const OURS: &str = "ours: by bit pattern";
    const NOT_A_NUMBER: &str = "WGSL defines no f32 parameter that holds a NaN, so no table \
                                covers this signature; the tests are on bits and exact";
    const ENTRIES: u32 = 24;
    // Discs around the origin from a hash of their number, in exact fractions;
    // one without a radius, one without a normal.
    const FIXTURE: &str = "
fn raytwin_hash(entry: u32, lane: u32) -> u32 {
    var h = (entry * 0x9e3779b9u) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn surfel_read(entry: u32) -> Surfel {
    let x = f32(raytwin_hash(entry, 1u)) * 0.0078125 - 1.0;
    let y = f32(raytwin_hash(entry, 2u)) * 0.0078125 - 1.0;
    let z = f32(raytwin_hash(entry, 3u)) * 0.001953125 - 0.25;
    var radius = 0.5 + f32(raytwin_hash(entry, 4u)) * 0.00390625;
    var normal = vec3f(0.0, 0.0, 1.0);
    if raytwin_hash(entry, 5u) > 127u {
        normal = vec3f(0.6, 0.0, 0.8);
    }
    if entry == 5u {
        radius = 0.0;
    }
    if entry == 9u {
        normal = vec3f(0.0, 0.0, 0.0);
    }
    return Surfel(vec3f(x, y, z), radius, normal, entry);
}
fn surfel_read_irradiance(entry: u32) -> vec3f {
    let red = f32(raytwin_hash(entry, 6u)) * 0.00390625;
    let green = f32(raytwin_hash(entry, 7u)) * 0.00390625;
    let blue = f32(raytwin_hash(entry, 8u)) * 0.00390625;
    return vec3f(red, green, blue);
}
";
    fn hash(entry: u32, lane: u32) -> f32 {
        let mut h = entry.wrapping_mul(0x9e37_79b9) ^ lane.wrapping_mul(0xc2b2_ae35);
        h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
        h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
        ((h ^ (h >> 16)) & 255) as f32
    }
    fn read(entry: u32) -> Surfel {
        Surfel {
            position: Vec3::new(
                hash(entry, 1) * 0.0078125 - 1.0,
                hash(entry, 2) * 0.0078125 - 1.0,
                hash(entry, 3) * 0.001953125 - 0.25,
            ),
            radius: match entry {
                5 => 0.0,
                _ => 0.5 + hash(entry, 4) * 0.00390625,
            },
            normal: match entry {
                9 => Vec3::ZERO,
                _ if hash(entry, 5) > 127.0 => Vec3::new(0.6, 0.0, 0.8),
                _ => Vec3::Z,
            },
            mesh: entry,
        }
    }
    fn read_irradiance(entry: u32) -> Vec3 {
        Vec3::new(hash(entry, 6), hash(entry, 7), hash(entry, 8)) * 0.00390625
    }
    fn coverage(point: Vec3, normal: Vec3, list: UVec2) -> f32 {
        surfel_coverage(point, normal, list, read)
    }
    fn gather(point: Vec3, normal: Vec3, list: UVec2) -> SurfelGathered {
        surfel_gather(point, normal, list, read, read_irradiance)
    }

    fn finite(v: DVec3, most: f64) -> bool {
        v.to_array().into_iter().all(|x| x.abs() <= most)
    }
    fn exact_sound((position, radius, normal, _): WideSurfel) -> u32 {
        let largest = f64::from(SURFEL_LARGEST);
        let radii = f64::from(SURFEL_RADIUS_MIN)..=f64::from(SURFEL_RADIUS_MAX);
        let sound = finite(position, largest) && finite(normal, 2.0) && radii.contains(&radius);
        u32::from(sound && normal.length_squared() > 0.98)
    }
    // Lagrange's identity in place of the cross product.
    fn exact_distance((position, radius, n, _): WideSurfel, point: DVec3) -> f64 {
        let to = (point - position) / radius;
        let along = n.dot(to);
        let stretch = f64::from(SURFEL_SQUASH * SURFEL_SQUASH) - 1.0;
        (n.length_squared() * to.length_squared() + stretch * along * along)
            .min(f64::from(SURFEL_FAR))
    }
    fn exact_attenuation(square: f64) -> f64 {
        // The smoothstep polynomial 3t² - 2t³ of t = 1 - m.
        let t = (1.0 - square.max(0.0).sqrt()).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }
    fn exact_facing(a: DVec3, b: DVec3) -> f64 {
        a.dot(b).clamp(0.0, 1.0).powi(2)
    }
    fn exact_weight(surfel: WideSurfel, point: DVec3, normal: DVec3) -> f64 {
        if exact_sound(surfel) == 0 || !finite(point, SURFEL_LARGEST.into()) || !finite(normal, 2.0)
        {
            return 0.0;
        }
        exact_attenuation(exact_distance(surfel, point)) * exact_facing(surfel.2, normal)
    }
    fn wide(entry: u32) -> WideSurfel {
        let s = read(entry);
        (
            s.position.as_dvec3(),
            s.radius.into(),
            s.normal.as_dvec3(),
            s.mesh,
        )
    }
    fn entries(list: UVec2) -> impl Iterator<Item = u32> {
        (0..list.y.min(SURFEL_WALK)).map(move |i| list.x.wrapping_add(i))
    }
    fn exact_coverage(point: DVec3, normal: DVec3, list: UVec2) -> f64 {
        entries(list)
            .map(|e| exact_weight(wide(e), point, normal))
            .sum()
    }
    fn exact_gather(point: DVec3, normal: DVec3, list: UVec2) -> (DVec3, f64) {
        let weight = exact_coverage(point, normal, list);
        if weight < f64::from(SURFEL_COVERED) {
            return (DVec3::ZERO, 0.0);
        }
        let sum: DVec3 = entries(list)
            .map(|e| read_irradiance(e).as_dvec3() * exact_weight(wide(e), point, normal))
            .sum();
        (sum / weight, weight)
    }
    type WideCamera = (DVec3, DVec3, DVec3, DVec3, DVec2);
    fn exact_area(depth: f64, cosine: f64, (_, right, up, _, pixel): WideCamera) -> f64 {
        // The parallelogram by Lagrange's identity.
        let square = right.length_squared() * up.length_squared() - right.dot(up).powi(2);
        let plane = 4.0 * square.max(0.0).sqrt() * pixel.x * pixel.y;
        plane * depth.max(0.0).powi(2) / cosine.max(f64::from(SURFEL_GRAZING))
    }
    fn exact_chance(c: f64, target: f64, area: f64, pixels: f64, radius: f64, rate: f64) -> f64 {
        let radii = f64::from(SURFEL_RADIUS_MIN)..=f64::from(SURFEL_RADIUS_MAX);
        if c >= target || !radii.contains(&radius) {
            return 0.0;
        }
        let disc = std::f64::consts::PI * radius * radius;
        ((target - c) * area * pixels / disc * rate).clamp(0.0, 1.0)
    }
    fn exact_occlusion(v: f64, albedo: DVec3) -> DVec3 {
        let cubic = albedo * (2.0404 * v.powi(3) - 4.7951 * v.powi(2) + 2.7552 * v)
            + (-0.3324 * v.powi(3) + 0.6417 * v.powi(2) + 0.6903 * v);
        cubic.max(DVec3::splat(v)).min(DVec3::ONE)
    }

    let disc = |radius: f32, normal: Vec3| Surfel {
        position: Vec3::new(1.0, 2.0, 3.0),
        radius,
        normal,
        mesh: 0,
    };
    let tilted = Vec3::new(0.6, 0.0, 0.8);
    let good = disc(0.5, tilted);
    let middle = good.position;
    let lists = || {
        domains::below(ENTRIES)
            .and(domains::below(12))
            .map(|(first, count)| UVec2::new(first, count))
    };
    let places = || {
        domains::range(-1.0, 1.0)
            .and(domains::range(-1.0, 1.0))
            .and(domains::range(-0.3, 0.3))
            .map(|((x, y), z)| Vec3::new(x, y, z))
    };
    let place_hard = [
        (Vec3::ZERO, Vec3::Z, UVec2::ZERO),
        (Vec3::ZERO, Vec3::Z, UVec2::new(0, 12)),
        (Vec3::ZERO, Vec3::NEG_Z, UVec2::new(0, 12)),
        (Vec3::splat(1e9), Vec3::Z, UVec2::new(0, 12)),
        (Vec3::ZERO, Vec3::Z, UVec2::new(5, 1)),
        (Vec3::ZERO, Vec3::Z, UVec2::new(9, 1)),
        (Vec3::ZERO, Vec3::Z, UVec2::new(u32::MAX - 2, 6)),
    ];
    let camera = |right: Vec3, up: Vec3| Camera {
        origin: Vec3::ZERO,
        right,
        up,
        forward: Vec3::NEG_Z,
        inverse_resolution: Vec2::new(1.0 / 1920.0, 1.0 / 1080.0),
    };
    let views = domains::log_range(0.05, 4.0)
        .and(domains::log_range(0.05, 4.0))
        .and(domains::range(0.0, 1.0))
        .map(move |((right, up), turn)| {
            let (s, c) = (6.0 * turn).sin_cos();
            camera(Vec3::new(c, s, 0.0) * right, Vec3::new(-s, c, 0.0) * up)
        });

    vec![
        Kernel::new(
            MODULE,
            "surfel_sound",
            ["surfel"],
            surfel_sound,
            exact_sound,
            (surfel_and_point().map(|(s, _)| s),),
        )
        .bit_exact()
        .by_analysis(NOT_A_NUMBER)
        .hard([(good,), (disc(0.5, Vec3::ZERO),)])
        .hard(
            [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-30, 1e30, 1e-9, 1e9]
                .map(|r| (disc(r, tilted),)),
        )
        .hard(
            [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e20]
                .map(|b| (disc(0.5, Vec3::new(0.6, b, 0.8)),)),
        )
        .hard([f32::NAN, f32::INFINITY, 1e20].map(|b| {
            let position = Vec3::new(0.0, 0.0, b);
            (Surfel { position, ..good },)
        }))
        .fixture(FIXTURE, vec![0])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_distance_squared",
            ["surfel", "point"],
            surfel_distance_squared,
            exact_distance,
            surfel_and_point(),
        )
        .few_ulp(8.5, 32.0)
        .hard([
            (good, middle),
            (good, middle + tilted * 0.125),
            (good, middle + Vec3::Y * 0.5),
            (good, middle + Vec3::new(0.4, 0.0, -0.3)),
            (good, Vec3::splat(1e9)),
            (disc(1e-9, tilted), middle + Vec3::X),
            (disc(1e9, tilted), middle),
            (disc(1e9, Vec3::Z), Vec3::ZERO),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SQUASHED)
        .baseline(
            "difference of squares: |d|² + 15 (n.d)²",
            "fn baseline(s: Surfel, point: vec3f) -> f32 {
                let to = (point - s.position) / s.radius;
                let along = dot(s.normal, to);
                let across = dot(to, to) - along * along;
                return min(across + 16.0 * along * along, 1e6);
            }",
            |s: Surfel, point: Vec3| {
                let to = (point - s.position) / s.radius;
                let along = s.normal.dot(to);
                let across = to.dot(to) - along * along;
                (across + 16.0 * along * along).min(1e6)
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "surfel_attenuation",
            ["distance_squared"],
            surfel_attenuation,
            exact_attenuation,
            (domains::range(0.0, 1.5),),
        )
        .few_ulp(5.0, 21.0)
        .hard(
            [
                0.0, -0.0, 1.0, 0.99999994, 1e-30, 0.5, 0.25, 1e6, -1e-7, 3e38,
            ]
            .map(|m| (m,)),
        )
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .baseline(
            "smoothstep(1, 0, sqrt)",
            "fn baseline(square: f32) -> f32 { return 1.0 - smoothstep(0.0, 1.0, sqrt(square)); }",
            |square: f32| {
                let m = square.max(0.0).sqrt().min(1.0);
                1.0 - m * m * (3.0 - 2.0 * m)
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "surfel_facing",
            ["normal", "other"],
            surfel_facing,
            exact_facing,
            (domains::unit_vector(), domains::unit_vector()),
        )
        .scale(1.0)
        .few_ulp(2.0, 3.5)
        .hard([
            (Vec3::Z, Vec3::Z),
            (Vec3::Z, Vec3::NEG_Z),
            (Vec3::Z, Vec3::X),
            (tilted, tilted),
            (Vec3::ZERO, Vec3::Z),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_weight",
            ["surfel", "point", "normal"],
            surfel_weight,
            exact_weight,
            surfel_and_point()
                .and(domains::unit_vector())
                .map(|((s, p), n)| (s, p, n)),
        )
        .scale(1.0)
        .few_ulp(3.0, 14.5)
        .hard([
            (good, middle, tilted),
            (good, middle, -tilted),
            (good, middle + Vec3::Y * 0.5, tilted),
            (disc(0.0, tilted), middle, tilted),
            (disc(0.5, Vec3::ZERO), middle, tilted),
            (disc(1e20, tilted), middle, tilted),
            (good, Vec3::splat(1e20), tilted),
            (good, middle, Vec3::splat(1e20)),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_coverage",
            ["point", "normal", "list"],
            coverage,
            exact_coverage,
            (places(), domains::unit_vector(), lists()),
        )
        .scale(1.0)
        .few_ulp(4.25, 26.0)
        .hard(place_hard)
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_pixel_area",
            ["depth", "cosine", "camera"],
            surfel_pixel_area,
            exact_area,
            (
                domains::log_range(1e-3, 1e5),
                domains::range(0.0, 1.0),
                views,
            ),
        )
        .few_ulp(5.0, 17.5)
        .hard(
            [(0.0, 1.0), (-1.0, 1.0), (1.0, 0.0), (1.0, -1.0), (1e6, 0.5)]
                .map(|(d, c)| (d, c, camera(Vec3::X, Vec3::Y * 0.5))),
        )
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_tile_key",
            ["coverage", "index"],
            surfel_tile_key,
            |c: f64, index: u32| {
                let top = f64::from((1u32 << 24) - 2);
                let steps = (c * 1_048_576.0).floor().clamp(0.0, top);
                steps as u32 * 256 + index % 256
            },
            (domains::log_range(1e-7, 20.0), domains::below(256)),
        )
        .bit_exact()
        .hard([
            (0.0, 0),
            (-1.0, 255),
            (1e30, 255),
            (16.0, 0),
            (15.999999, 7),
            (15.999998, 7),
            (0.8, 300),
            (1e-30, 1),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_tile_index",
            ["key"],
            surfel_tile_index,
            |key: u32| key % 256,
            (domains::any_u32(),),
        )
        .bit_exact()
        .hard([(0,), (SURFEL_TILE_EMPTY,)])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_tile_coverage",
            ["key"],
            surfel_tile_coverage,
            |key: u32| (f64::from(key) / 256.0).floor() / 1_048_576.0,
            (domains::any_u32(),),
        )
        .bit_exact()
        .hard([(0,), (SURFEL_TILE_EMPTY,)])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_spawn_chance",
            [
                "coverage",
                "target_coverage",
                "pixel_area",
                "tile_pixels",
                "radius",
                "rate",
            ],
            surfel_spawn_chance,
            exact_chance,
            (
                domains::range(0.0, 1.0),
                domains::range(0.5, 1.5),
                domains::log_range(1e-8, 1.0),
                domains::range(1.0, 256.0).map(f32::round),
                domains::log_range(0.01, 10.0),
                domains::range(0.0, 1.0),
            ),
        )
        .few_ulp(5.25, 15.0)
        .hard([
            (0.8, 0.8, 1.0, 256.0, 0.1, 1.0),
            (2.0, 0.8, 1.0, 256.0, 0.1, 1.0),
            (0.0, 0.8, 1.0, 256.0, 0.0, 1.0),
            (0.0, 0.8, 1.0, 256.0, f32::INFINITY, 1.0),
            (0.0, 0.8, 1e3, 256.0, 0.1, 1.0),
            (0.0, 0.8, 0.0, 256.0, 0.1, 1.0),
            (0.0, 0.8, 1e-6, 256.0, 0.1, 0.0),
            (0.79999995, 0.8, 1e-6, 256.0, 0.1, 1.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_spawns",
            ["pixel", "frame", "chance"],
            surfel_spawns,
            |pixel: UVec2, frame: u32, chance: f64| {
                use crate::random::pcg::{pcg_hash, pcg_seed};
                let bits = pcg_hash(pcg_seed(pixel, frame));
                u32::from((f64::from(bits) / 256.0).floor() / 16_777_216.0 < chance)
            },
            (
                domains::any_uvec2(),
                domains::any_u32(),
                domains::range(0.0, 1.0),
            ),
        )
        .bit_exact()
        .hard([
            (UVec2::ZERO, 0, 0.0),
            (UVec2::ZERO, 0, 1.0),
            (UVec2::MAX, u32::MAX, 0.5),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_gather",
            ["point", "normal", "list"],
            gather,
            exact_gather,
            (places(), domains::unit_vector(), lists()),
        )
        // Absolute errors of the weights, over their sum.
        .scale_by(|point: DVec3, normal: DVec3, list: UVec2| {
            let weight = exact_coverage(point, normal, list);
            (1.0 / weight.max(f64::from(SURFEL_COVERED))).max(1.0)
        })
        .undecided(|point: DVec3, normal: DVec3, list: UVec2| {
            let weight = exact_coverage(point, normal, list);
            (weight - f64::from(SURFEL_COVERED)).abs() < 1e-5
        })
        .few_ulp(4.25, 115.0)
        .hard(place_hard)
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "surfel_colored_occlusion",
            ["visibility", "albedo"],
            surfel_colored_occlusion,
            exact_occlusion,
            (
                domains::range(0.0, 1.0),
                domains::vec3(domains::range(0.0, 1.0)),
            ),
        )
        .scale(1.0)
        .few_ulp(9.25, 15.25)
        .hard([
            (0.0, Vec3::ONE),
            (1.0, Vec3::ONE),
            (1.0, Vec3::ZERO),
            (0.5, Vec3::new(0.0, 0.5, 1.0)),
        ])
        .fixture(FIXTURE, vec![0])
        .source("Jimenez et al. 2016, equation 10")
        .build(),
    ]
}
