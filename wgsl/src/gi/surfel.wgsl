// Surfels (Ray Tracing Gems, chapter 25): discs that cover what the camera sees
// and keep its irradiance.
//
// The program defines
//   fn surfel_read(entry: u32) -> Surfel
//   fn surfel_read_irradiance(entry: u32) -> vec3f

// How many times farther a distance along the normal counts.
const SURFEL_SQUASH: f32 = 4.0;
// A squared distance that is far for every surfel; none is given larger.
const SURFEL_FAR: f32 = 1e6;
// Largest magnitude of a usable number.
const SURFEL_LARGEST: f32 = 1e15;
// Radii of usable surfels.
const SURFEL_RADIUS_MIN: f32 = 1e-9;
const SURFEL_RADIUS_MAX: f32 = 1e9;
// Entries of a list that are looked at.
const SURFEL_WALK: u32 = 1024u;
// Sum of weights below which nothing counts as covered by a mean.
const SURFEL_COVERED: f32 = 0.001;
// Smallest cosine of the area a pixel sees.
const SURFEL_GRAZING: f32 = 0.0625;
// Key of a pixel without a surface: above every other.
const SURFEL_TILE_EMPTY: u32 = 0xffffffffu;
const SURFEL_INV_PI: f32 = 0.3183099;

// A disc on a surface. Its irradiance is kept apart.
struct Surfel {
    // Its middle, in the world.
    position: vec3f,
    // Its radius, above 0.
    radius: f32,
    // Its unit normal.
    normal: vec3f,
    // Which object it lies on.
    mesh: u32,
}

// A weighted mean of irradiance.
struct SurfelGathered {
    // The mean; 0 where nothing covers.
    irradiance: vec3f,
    // Sum of the weights; 0 where nothing covers.
    weight: f32,
}

fn surfel_bits(value: f32) -> u32 {
    return bitcast<u32>(value) & 0x7fffffffu;
}

fn surfel_bits3(v: vec3f) -> u32 {
    return max(max(surfel_bits(v.x), surfel_bits(v.y)), surfel_bits(v.z));
}

// 1 if a surfel can cover anything: its numbers are finite, its radius in
// range, its normal has about unit length.
fn surfel_sound(surfel: Surfel) -> u32 {
    let radius = bitcast<u32>(surfel.radius);
    if surfel_bits3(surfel.position) > bitcast<u32>(SURFEL_LARGEST)
        || surfel_bits3(surfel.normal) > 0x40000000u
        || radius < bitcast<u32>(SURFEL_RADIUS_MIN)
        || radius > bitcast<u32>(SURFEL_RADIUS_MAX) {
        return 0u;
    }
    return select(0u, 1u, vec3_dot(surfel.normal, surfel.normal) > 0.98);
}

// Squared distance of a point from a surfel, in radii, with the part along the
// normal SURFEL_SQUASH times as long: 1 on the rim, at most SURFEL_FAR.
fn surfel_distance_squared(surfel: Surfel, point: vec3f) -> f32 {
    let x = point.x - surfel.position.x;
    let y = point.y - surfel.position.y;
    let z = point.z - surfel.position.z;
    // Squares of what is farther may be infinite.
    if max(max(abs(x), abs(y)), abs(z)) >= 1024.0 * surfel.radius {
        return SURFEL_FAR;
    }
    let to = vec3f(x / surfel.radius, y / surfel.radius, z / surfel.radius);
    let across = vec3_cross(surfel.normal, to);
    let along = SURFEL_SQUASH * vec3_dot(surfel.normal, to);
    return min(vec3_dot(across, across) + along * along, SURFEL_FAR);
}

// How much of a surfel is left at a squared distance: 1 in its middle, 0 from
// the rim (1) on, smoothly at both: (1 - m)^2 (1 + 2m).
fn surfel_attenuation(distance_squared: f32) -> f32 {
    if distance_squared >= 1.0 {
        return 0.0;
    }
    let m = sqrt(max(distance_squared, 0.0));
    let rest = min((1.0 - distance_squared) / (1.0 + m), 1.0);
    return min((rest * rest) * (1.0 + 2.0 * m), 1.0);
}

// How much two unit normals agree: the square of their cosine, 0 from a right
// angle on.
fn surfel_facing(normal: vec3f, other: vec3f) -> f32 {
    let cosine = clamp(vec3_dot(normal, other), 0.0, 1.0);
    return cosine * cosine;
}

// How much a surfel covers a point with a unit normal, in [0, 1]; 0 for
// surfels that are not sound, points and normals that are not finite.
fn surfel_weight(surfel: Surfel, point: vec3f, normal: vec3f) -> f32 {
    if surfel_sound(surfel) == 0u
        || surfel_bits3(point) > bitcast<u32>(SURFEL_LARGEST)
        || surfel_bits3(normal) > 0x40000000u {
        return 0.0;
    }
    let distance = surfel_distance_squared(surfel, point);
    return surfel_attenuation(distance) * surfel_facing(surfel.normal, normal);
}

// How much the surfels of a list (its first entry, its length) cover a point:
// the sum of the weights of its first SURFEL_WALK.
fn surfel_coverage(point: vec3f, normal: vec3f, list: vec2u) -> f32 {
    let count = min(list.y, SURFEL_WALK);
    var sum = 0.0;
    for (var i = 0u; i < count; i++) {
        let surfel = surfel_read(list.x + i);
        sum = sum + surfel_weight(surfel, point, normal);
    }
    return sum;
}

// Area in the world that a pixel sees; depth along forward, cosine that of the
// normal with the ray to the eye, over that of the ray with the axis.
fn surfel_pixel_area(depth: f32, cosine: f32, camera: Camera) -> f32 {
    let image = vec3_cross(camera.right, camera.up);
    let square = vec3_dot(image, image);
    let pixel = camera.inverse_resolution.x * camera.inverse_resolution.y;
    let ahead = max(depth, 0.0);
    let plane = (4.0 * sqrt(square)) * pixel;
    return ((plane * ahead) * ahead) / max(cosine, SURFEL_GRAZING);
}

// Key of a pixel in its tile of 16 x 16: the smallest is that of the pixel that
// is covered least, and among equals of the first one.
fn surfel_tile_key(coverage: f32, index: u32) -> u32 {
    // The largest key is left for tiles without a surface.
    let steps = u32(clamp(coverage, 0.0, 15.999998) * 1048576.0);
    return (steps << 8u) | (index & 255u);
}

// Which pixel of its tile a key is that of.
fn surfel_tile_index(key: u32) -> u32 {
    return key & 255u;
}

// The coverage that a key holds, in steps of 2^-20.
fn surfel_tile_coverage(key: u32) -> f32 {
    return f32(key >> 8u) * (1.0 / 1048576.0);
}

// The chance that a tile spawns a surfel in a frame, in [0, 1]: what is missing
// to the target, times the surfels that the tile has room for, times rate.
fn surfel_spawn_chance(
    coverage: f32,
    target_coverage: f32,
    pixel_area: f32,
    tile_pixels: f32,
    radius: f32,
    rate: f32,
) -> f32 {
    let bits = bitcast<u32>(radius);
    if coverage >= target_coverage
        || bits < bitcast<u32>(SURFEL_RADIUS_MIN)
        || bits > bitcast<u32>(SURFEL_RADIUS_MAX) {
        return 0.0;
    }
    let room = (((pixel_area / radius) / radius) * tile_pixels) * SURFEL_INV_PI;
    return clamp(((target_coverage - coverage) * room) * rate, 0.0, 1.0);
}

// 1 if a pixel spawns a surfel in a frame, with the chance given: the same on
// every machine.
fn surfel_spawns(pixel: vec2u, frame: u32, chance: f32) -> u32 {
    return select(0u, 1u, pcg_unit(pcg_hash(pcg_seed(pixel, frame))) < chance);
}

// A mean of weight sum with a value of weight w added, between the two.
fn surfel_mix(mean: f32, sum: f32, value: f32, w: f32, total: f32) -> f32 {
    let mixed = (mean * sum + value * w) / total;
    return min(max(mixed, min(mean, value)), max(mean, value));
}

// Irradiance at a point: the mean over a list's surfels by how much they cover
// it, between the irradiances that count; 0 with weight 0 where the weights sum
// to less than SURFEL_COVERED.
fn surfel_gather(point: vec3f, normal: vec3f, list: vec2u) -> SurfelGathered {
    let count = min(list.y, SURFEL_WALK);
    var sum = 0.0;
    var mean = vec3f(0.0, 0.0, 0.0);
    for (var i = 0u; i < count; i++) {
        let entry = list.x + i;
        let surfel = surfel_read(entry);
        let w = surfel_weight(surfel, point, normal);
        if w <= 0.0 {
            continue;
        }
        let value = surfel_read_irradiance(entry);
        if surfel_bits3(value) > bitcast<u32>(SURFEL_LARGEST) {
            continue;
        }
        let total = sum + w;
        if sum <= 0.0 {
            mean = value;
        } else {
            mean = vec3f(
                surfel_mix(mean.x, sum, value.x, w, total),
                surfel_mix(mean.y, sum, value.y, w, total),
                surfel_mix(mean.z, sum, value.z, w, total),
            );
        }
        sum = total;
    }
    if sum < SURFEL_COVERED {
        return SurfelGathered(vec3f(0.0, 0.0, 0.0), 0.0);
    }
    return SurfelGathered(mean, sum);
}

fn surfel_occlusion_channel(v: f32, albedo: f32) -> f32 {
    let a = 2.0404 * albedo - 0.3324;
    let b = -4.7951 * albedo + 0.6417;
    let c = 2.7552 * albedo + 0.6903;
    return min(max(((v * a + b) * v + c) * v, v), 1.0);
}

// Ambient occlusion with the light that bounces around in the crevice, for each
// channel of albedo: between visibility and 1.
fn surfel_colored_occlusion(visibility: f32, albedo: vec3f) -> vec3f {
    return vec3f(
        surfel_occlusion_channel(visibility, albedo.x),
        surfel_occlusion_channel(visibility, albedo.y),
        surfel_occlusion_channel(visibility, albedo.z),
    );
}
