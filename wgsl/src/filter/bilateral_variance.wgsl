// A bilateral filter as strong as the variance asks (Ray Tracing Gems, chapter
// 25): where a pixel is known well its kernel shrinks, in radius and in taps,
// down to nothing.
//
// The program defines
//   fn bilateral_variance_read(at: vec2u) -> BilateralVariancePixel

// Variance over squared value from which the kernel has its full radius: a
// relative standard deviation of one half.
const BILATERAL_VARIANCE_FULL: f32 = 0.25;
// Weight of the squared distance between unit normals: as cos^128.
const BILATERAL_VARIANCE_NORMAL: f32 = 64.0;
// Variances that a squared colour difference may have for a weight of 1/e.
const BILATERAL_VARIANCE_COLOR: f32 = 16.0;
// Golden ratio less one, in units of 2^-32.
const BILATERAL_VARIANCE_GOLDEN: u32 = 2654435769u;
// Bits of 2^60, from where on a channel is none.
const BILATERAL_VARIANCE_COLOR_BITS: u32 = 0x5d800000u;
// Bits of 2^120, from where on a variance is none.
const BILATERAL_VARIANCE_BITS: u32 = 0x7b800000u;
// log2 e.
const BILATERAL_VARIANCE_LOG2_E: f32 = 1.442695;

// What the filter knows of a pixel.
struct BilateralVariancePixel {
    // The value to filter, components >= 0.
    color: vec3f,
    // Its variance, as filter/spatial_reconstruct gives it.
    variance: f32,
    // Where its surface is.
    position: vec3f,
    // Distance from its plane at which the weight falls to 1/e; not above 0
    // where there is no surface.
    reach: f32,
    // Its unit normal.
    normal: vec3f,
}

// Squared size of a colour, or of a difference of two, channels weighted as in
// luminance.
fn bilateral_variance_square(color: vec3f) -> f32 {
    return (0.2126 * (color.x * color.x) + 0.7152 * (color.y * color.y))
        + 0.0722 * (color.z * color.z);
}

// 1 if every channel is a number of magnitude below 2^60, else 0.
fn bilateral_variance_usable(color: vec3f) -> u32 {
    let bits = bitcast<vec3u>(color);
    return select(0u, 1u, (bits.x & 0x7fffffffu) < BILATERAL_VARIANCE_COLOR_BITS)
        & select(0u, 1u, (bits.y & 0x7fffffffu) < BILATERAL_VARIANCE_COLOR_BITS)
        & select(0u, 1u, (bits.z & 0x7fffffffu) < BILATERAL_VARIANCE_COLOR_BITS);
}

// Weighted mean of two numbers >= 0, never outside them.
fn bilateral_variance_mix(a: f32, a_weight: f32, b: f32, b_weight: f32, total: f32) -> f32 {
    let mixed = (a * a_weight + b * b_weight) / total;
    return min(max(mixed, min(a, b)), max(a, b));
}

// Radius of the kernel in pixels: proportional to the relative standard
// deviation, max_radius from one half of it on, 0 for no variance. square is
// bilateral_variance_square of the value.
fn bilateral_variance_radius(variance: f32, square: f32, max_radius: f32) -> f32 {
    if variance <= 0.0 {
        return 0.0;
    }
    let full = BILATERAL_VARIANCE_FULL * square;
    if variance >= full {
        return max_radius;
    }
    return max_radius * sqrt(variance / full);
}

// How many neighbours a kernel of this radius ([0, 1024] pixels) reads: the
// radius squared, rounded down, at most max_taps.
fn bilateral_variance_taps(radius: f32, max_taps: u32) -> u32 {
    return min(u32(radius * radius), max_taps);
}

// Where tap index of 1 to taps lies, in pixels from the centre; round each
// component. turn in [0, 1) rotates the kernel.
fn bilateral_variance_offset(index: u32, taps: u32, radius: f32, turn: f32) -> vec2f {
    let angle = f32((index * BILATERAL_VARIANCE_GOLDEN) >> 8u) * 5.9604645e-8 + turn;
    let around = sincos_turn(angle);
    let r = radius * sqrt(f32(index) / f32(max(taps, 1u)));
    return vec2f(r * around.y, r * around.x);
}

// The weight of a tap against a centre of weight 1, in [0, 1]:
// e^-(p^2 + 64 |n - n'|^2 + d^2 / (16 variance)), with p the tap's distance
// from the centre's plane over reach and d^2 the squared colour difference.
fn bilateral_variance_weight(
    normal: vec3f,
    other_normal: vec3f,
    offset: vec3f,
    reach: f32,
    difference: vec3f,
    variance: f32,
) -> f32 {
    if variance <= 0.0 || reach <= 0.0 {
        return 0.0;
    }
    let height = abs(vec3_dot(normal, offset));
    let apart = bilateral_variance_square(difference);
    // e^-64 and less; compared before dividing, so that nothing overflows.
    if height >= 8.0 * reach || apart >= 1024.0 * variance {
        return 0.0;
    }
    let p = height / reach;
    let turned = vec3f(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    let shape = p * p + BILATERAL_VARIANCE_NORMAL * vec3_dot(turned, turned);
    let exponent = -BILATERAL_VARIANCE_LOG2_E
        * (shape + apart / (BILATERAL_VARIANCE_COLOR * variance));
    return exp2_poly(exponent);
}

// A pixel, filtered as far as its variance asks. size is the image's, each
// side below 2^30; max_radius in pixels and max_taps bound the kernel. The
// result lies between its inputs, channel by channel; no variance or no
// surface, or a number in it that is none: the pixel's own value, untouched.
fn bilateral_variance_pixel(
    pixel: vec2u,
    size: vec2u,
    max_radius: f32,
    max_taps: u32,
    turn: f32,
) -> vec3f {
    if pixel.x >= size.x || pixel.y >= size.y {
        return vec3f(0.0, 0.0, 0.0);
    }
    let centre = bilateral_variance_read(pixel);
    var color = centre.color;
    // A variance that is none (by bits: NaN has the largest) counts as 0.
    var variance = 0.0;
    if bitcast<u32>(centre.variance) < BILATERAL_VARIANCE_BITS {
        variance = centre.variance;
    }
    var radius = bilateral_variance_radius(
        variance,
        bilateral_variance_square(centre.color),
        max_radius,
    );
    var sum = 1.0;
    let sound = bilateral_variance_usable(centre.color) != 0u;
    if !sound {
        // Its neighbours fill it, by geometry alone.
        color = vec3f(0.0, 0.0, 0.0);
        variance = 1.0;
        radius = max_radius;
        sum = 0.0;
    }
    var taps = bilateral_variance_taps(radius, max_taps);
    if usable_surface(centre.position, centre.normal, centre.reach) == 0u {
        taps = 0u;
    }
    for (var i = 1u; i <= taps; i++) {
        let offset = bilateral_variance_offset(i, taps, radius, turn);
        let x = i32(pixel.x) + i32(floor(offset.x + 0.5));
        let y = i32(pixel.y) + i32(floor(offset.y + 0.5));
        if x < 0 || y < 0 || x >= i32(size.x) || y >= i32(size.y) {
            continue;
        }
        let tap = bilateral_variance_read(vec2u(u32(x), u32(y)));
        if (usable_surface(tap.position, tap.normal, tap.reach) & bilateral_variance_usable(tap.color)) == 0u {
            continue;
        }
        let to = tap.position - centre.position;
        var difference = vec3f(0.0, 0.0, 0.0);
        if sound {
            difference = tap.color - centre.color;
        }
        let w = bilateral_variance_weight(
            centre.normal,
            tap.normal,
            to,
            centre.reach,
            difference,
            variance,
        );
        if w <= 0.0 {
            continue;
        }
        // The first of a broken pixel, exactly.
        if sum <= 0.0 {
            color = tap.color;
        }
        let total = sum + w;
        color = vec3f(
            bilateral_variance_mix(color.x, sum, tap.color.x, w, total),
            bilateral_variance_mix(color.y, sum, tap.color.y, w, total),
            bilateral_variance_mix(color.z, sum, tap.color.z, w, total),
        );
        sum = total;
    }
    return color;
}
