// Full-resolution reflections from half-resolution rays: each pixel gathers
// its neighbours' hits and weighs them by its own BRDF over the hit's density
// (Ray Tracing Gems, chapter 25; Stachowiak 2015). The result is the mean
// radiance under the pixel's own lobe, sum(w L) / sum(w) with w = f cos / pdf;
// times the lobe's albedo it is the reflected radiance.
//
// The program defines two functions:
//   fn spatial_reconstruct_read_hit(at: vec2u) -> SpatialReconstructHit
//     the hit of a half-resolution pixel;
//   fn spatial_reconstruct_weight(pixel: vec2u, at: vec2u, hit: SpatialReconstructHit) -> f32
//     f cos of the full-resolution pixel toward that hit, times any edge weight.

// Most neighbours that a pixel gathers, its own hit included.
const SPATIAL_RECONSTRUCT_MAX: u32 = 16u;
// Largest weight of one hit; larger ratios count as this.
const SPATIAL_RECONSTRUCT_WEIGHT_MAX: f32 = 1e9;
// Smallest weight of one hit; smaller ratios count as zero.
const SPATIAL_RECONSTRUCT_WEIGHT_MIN: f32 = 1e-9;
// Golden ratio less one, in units of 2^-32.
const SPATIAL_RECONSTRUCT_GOLDEN: u32 = 2654435769u;
// Bits of infinity, and of 2^60, from where on a channel is none.
const SPATIAL_RECONSTRUCT_INFINITY_BITS: u32 = 0x7f800000u;
const SPATIAL_RECONSTRUCT_RADIANCE_BITS: u32 = 0x5d800000u;

// A half-resolution hit.
struct SpatialReconstructHit {
    // Where the ray hit; for a miss a point far along the ray.
    position: vec3f,
    // Density of the ray's direction, per steradian; 0 for no ray.
    pdf: f32,
    // Radiance that comes back along the ray, not weighted by anything.
    radiance: vec3f,
}

// What has been gathered so far; starts as SPATIAL_RECONSTRUCT_EMPTY.
struct SpatialReconstructState {
    // Weighted mean radiance.
    color: vec3f,
    // Sum of the weights.
    weight: f32,
    // Sum of the squared weights.
    squares: f32,
    // Sum of the products of the weights of all pairs.
    pairs: f32,
    // Weighted sum of squared distances from the mean.
    spread: f32,
}

// Nothing gathered.
const SPATIAL_RECONSTRUCT_EMPTY: SpatialReconstructState =
    SpatialReconstructState(vec3f(0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0);

// A pixel's reconstructed value.
struct SpatialReconstruction {
    // Mean radiance under the pixel's lobe.
    color: vec3f,
    // Estimated variance of color; see spatial_reconstruct_finish.
    variance: f32,
    // How many hits of equal weight would count as much; 0 for none.
    samples: f32,
}

// Squared length of a colour difference, channels weighted as in luminance: a
// sum of terms of one sign, so it never cancels.
fn spatial_reconstruct_square(color: vec3f) -> f32 {
    return (0.2126 * (color.x * color.x) + 0.7152 * (color.y * color.y))
        + 0.0722 * (color.z * color.z);
}

// Weighted mean of two numbers >= 0, never outside them.
fn spatial_reconstruct_mix(a: f32, a_weight: f32, b: f32, b_weight: f32, total: f32) -> f32 {
    let mixed = (a * a_weight + b * b_weight) / total;
    return min(max(mixed, min(a, b)), max(a, b));
}

// Where the neighbour index lies, in half-resolution pixels from the pixel's
// own; round each component. Neighbour 0 is the pixel's own, the others lie on
// a spiral of golden-angle steps at distance sqrt(index): no two of the first
// 16 round to one pixel. turn in [0, 1) rotates all of them.
fn spatial_reconstruct_offset(index: u32, turn: f32) -> vec2f {
    let angle = f32((index * SPATIAL_RECONSTRUCT_GOLDEN) >> 8u) * 5.9604645e-8 + turn;
    let around = sincos_turn(angle);
    let r = sqrt(f32(index));
    return vec2f(r * around.y, r * around.x);
}

// How far a neighbour's surface may stand in for the pixel's: from 1 (the same
// plane) to 0. offset is the neighbour's position less the pixel's, reach
// (above 0) the distance from the pixel's plane at which the weight is 0.
fn spatial_reconstruct_edge(
    normal: vec3f,
    other_normal: vec3f,
    offset: vec3f,
    reach: f32,
) -> f32 {
    let plane = abs(vec3_dot(normal, offset));
    if plane >= reach {
        return 0.0;
    }
    let c = clamp(vec3_dot(normal, other_normal), 0.0, 1.0);
    let c_2 = c * c;
    let c_4 = c_2 * c_2;
    return (c_4 * c_4) * (1.0 - plane / reach);
}

// 1 if weight and density are numbers and every channel is one of magnitude
// below 2^60, else 0.
fn spatial_reconstruct_usable(weight: f32, pdf: f32, radiance: vec3f) -> u32 {
    let bits = bitcast<vec3u>(radiance);
    return select(0u, 1u, (bitcast<u32>(weight) & 0x7fffffffu) < SPATIAL_RECONSTRUCT_INFINITY_BITS)
        & select(0u, 1u, (bitcast<u32>(pdf) & 0x7fffffffu) < SPATIAL_RECONSTRUCT_INFINITY_BITS)
        & select(0u, 1u, (bits.x & 0x7fffffffu) < SPATIAL_RECONSTRUCT_RADIANCE_BITS)
        & select(0u, 1u, (bits.y & 0x7fffffffu) < SPATIAL_RECONSTRUCT_RADIANCE_BITS)
        & select(0u, 1u, (bits.z & 0x7fffffffu) < SPATIAL_RECONSTRUCT_RADIANCE_BITS);
}

// The weight of a hit: the pixel's f cos for its direction over the density
// with which it was drawn. 0 if either is not above 0 or the ratio is too
// small; capped. pdf <= 1e20.
fn spatial_reconstruct_ratio(weight: f32, pdf: f32) -> f32 {
    if weight <= 0.0 || pdf <= 0.0 {
        return 0.0;
    }
    // Compared before dividing, so that nothing overflows or underflows.
    if weight >= SPATIAL_RECONSTRUCT_WEIGHT_MAX * pdf {
        return SPATIAL_RECONSTRUCT_WEIGHT_MAX;
    }
    if weight < SPATIAL_RECONSTRUCT_WEIGHT_MIN * pdf {
        return 0.0;
    }
    return weight / pdf;
}

// Adds a hit: weight is the pixel's own f cos for its direction, times any
// edge weight; radiance has components in [0, 1e8]. A hit without weight
// leaves the state as it was.
fn spatial_reconstruct_add(
    state: SpatialReconstructState,
    weight: f32,
    pdf: f32,
    radiance: vec3f,
) -> SpatialReconstructState {
    let w = spatial_reconstruct_ratio(weight, pdf);
    if w <= 0.0 {
        return state;
    }
    if state.weight <= 0.0 {
        return SpatialReconstructState(radiance, w, w * w, 0.0, 0.0);
    }
    let before = state.weight;
    let total = before + w;
    let cross_weight = before * w;
    let old = state.color;
    let away = vec3f(radiance.x - old.x, radiance.y - old.y, radiance.z - old.z);
    return SpatialReconstructState(
        vec3f(
            spatial_reconstruct_mix(old.x, before, radiance.x, w, total),
            spatial_reconstruct_mix(old.y, before, radiance.y, w, total),
            spatial_reconstruct_mix(old.z, before, radiance.z, w, total),
        ),
        total,
        state.squares + w * w,
        state.pairs + cross_weight,
        state.spread + (cross_weight / total) * spatial_reconstruct_square(away),
    );
}

// The result, or centre if no hit had any weight. variance is that of the
// mean, from the differences between hits, in squared radiance with channels
// weighted as in luminance; of one hit alone it is the square of its value.
fn spatial_reconstruct_finish(
    state: SpatialReconstructState,
    centre: vec3f,
) -> SpatialReconstruction {
    if state.weight <= 0.0 {
        return SpatialReconstruction(centre, spatial_reconstruct_square(centre), 0.0);
    }
    if state.pairs <= 0.0 {
        return SpatialReconstruction(state.color, spatial_reconstruct_square(state.color), 1.0);
    }
    return SpatialReconstruction(
        state.color,
        (state.spread / state.weight) * (state.squares / (2.0 * state.pairs)),
        max((state.weight * state.weight) / state.squares, 1.0),
    );
}

// A full-resolution pixel from count half-resolution hits around it (1, 4, 8
// or 16, the first its own). size is that of the half-resolution image, each
// side below 2^30; turn in [0, 1) rotates the pattern. Without any weight the
// result is the own hit's radiance.
fn spatial_reconstruct_pixel(
    pixel: vec2u,
    size: vec2u,
    count: u32,
    turn: f32,
) -> SpatialReconstruction {
    var state = SPATIAL_RECONSTRUCT_EMPTY;
    if size.x == 0u || size.y == 0u {
        return spatial_reconstruct_finish(state, vec3f(0.0, 0.0, 0.0));
    }
    let own = vec2u(min(pixel.x / 2u, size.x - 1u), min(pixel.y / 2u, size.y - 1u));
    let centre = spatial_reconstruct_read_hit(own);
    let own_weight = spatial_reconstruct_weight(pixel, own, centre);
    if spatial_reconstruct_usable(own_weight, centre.pdf, centre.radiance) != 0u {
        state = spatial_reconstruct_add(state, own_weight, centre.pdf, centre.radiance);
    }
    let end = min(count, SPATIAL_RECONSTRUCT_MAX);
    for (var i = 1u; i < end; i++) {
        let offset = spatial_reconstruct_offset(i, turn);
        let x = i32(own.x) + i32(floor(offset.x + 0.5));
        let y = i32(own.y) + i32(floor(offset.y + 0.5));
        if x < 0 || y < 0 || x >= i32(size.x) || y >= i32(size.y) {
            continue;
        }
        let at = vec2u(u32(x), u32(y));
        let hit = spatial_reconstruct_read_hit(at);
        let hit_weight = spatial_reconstruct_weight(pixel, at, hit);
        if spatial_reconstruct_usable(hit_weight, hit.pdf, hit.radiance) != 0u {
            state = spatial_reconstruct_add(state, hit_weight, hit.pdf, hit.radiance);
        }
    }
    var fallback = centre.radiance;
    if spatial_reconstruct_usable(0.0, 0.0, fallback) == 0u {
        fallback = vec3f(0.0, 0.0, 0.0);
    }
    return spatial_reconstruct_finish(state, fallback);
}
