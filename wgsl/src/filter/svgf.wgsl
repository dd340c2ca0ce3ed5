// SVGF's spatial half (Schied et al. 2017, section 4): variance-guided a-trous
// passes over a noisy image, stopped at the edges of depth, normal and
// luminance.
//
// The order of a frame: accumulate over time, svgf_variance_pixel where the
// history is short, then svgf_atrous_pixel with steps 1, 2, 4, 8, 16; the output
// of pass settings.feedback is the next frame's history. Every function for a
// pixel has a scalar form, which is the same text over one channel.
//
// What counts as data: a value below 2^60 in size, with a variance below 2^121.
// A pixel with anything else (NaN, an infinity, 1e30) weighs nothing, and is
// filled from its neighbours by geometry alone.
//
// The program defines
//   fn svgf_read_surface(at: vec2u) -> SvgfSurface
//   fn svgf_read_color(at: vec2u) -> SvgfColor
//   fn svgf_read_scalar(at: vec2u) -> SvgfScalar
// A program with one kind of signal returns SvgfColor(vec3f(), 0.0) or
// SvgfScalar(0.0, 0.0) for the other.

// Part of the luminance that counts as a deviation where the variance is 0.
const SVGF_LUMINANCE_FLOOR: f32 = 1e-4;
// Part of the depth that counts as a slope where the gradient is 0.
const SVGF_DEPTH_FLOOR: f32 = 1e-3;
// Least scale of a weight, 2^-60; smaller ones count as this.
const SVGF_SCALE_MIN: f32 = 8.6736174e-19;
// From here on, 2^60, a value is no data.
const SVGF_VALUE_MAX: f32 = 1152921504606846976.0;
// Bits of 2^60.
const SVGF_VALUE_BITS: u32 = 0x5d800000u;
// Bits of 2^121.
const SVGF_VARIANCE_BITS: u32 = 0x7c000000u;
// Least sum of weights to divide by, 2^-40.
const SVGF_TOTAL_MIN: f32 = 9.094947e-13;
// Largest step between taps, in pixels.
const SVGF_STEP_MAX: u32 = 1048576u;
// Largest finite number.
const SVGF_HUGE: f32 = 3.4028234e38;
// Where a weight ends, 2^-40: its square would be subnormal.
const SVGF_EXPONENT_MAX: f32 = 40.0;
// 2^-f = 1 + f (F1 + ...), relative error 2^-23.4 on |f| <= 1/2.
const SVGF_FADE_A: f32 = -0.693147;
const SVGF_FADE_B: f32 = 0.24022242;
const SVGF_FADE_C: f32 = -0.055507336;
const SVGF_FADE_D: f32 = 0.0096715126;
const SVGF_FADE_E: f32 = -0.0013264727;
// -128 log2(1 - d/2) = d (N1 + ...), such that its power of 2 errs by 2^-24.
const SVGF_NORMAL_A: f32 = 92.33254;
const SVGF_NORMAL_B: f32 = 23.074078;
const SVGF_NORMAL_C: f32 = 8.015964;
// From here on, the power of 128, that is good enough.
const SVGF_STEEP: u32 = 7u;
// log2 e.
const SVGF_LOG2_E: f32 = 1.442695;

// How strong the filter is; the steps over time are in here too.
struct SvgfSettings {
    // Least weight of the new frame's colour in the history.
    alpha: f32,
    // Least weight of the new frame's moments.
    moments_alpha: f32,
    // Frames below which the variance is estimated over the image.
    history: f32,
    // Multiplies a surface's reach: the plane distance for a weight of 1/e.
    sigma_depth: f32,
    // Standard deviations of luminance for a weight of 1/e.
    sigma_luminance: f32,
    // The normals' cosine is raised to 2 to this power.
    squarings: u32,
    // Taps on each side of the centre: 2 for 5 x 5, 1 for 3 x 3.
    radius: u32,
    // Number of passes; pass i has a step of 2^i pixels.
    passes: u32,
    // The pass, from 0, whose output becomes the history.
    feedback: u32,
}

// The paper's: five passes of 5 x 5, the first one fed back.
const SVGF_PAPER: SvgfSettings =
    SvgfSettings(0.2, 0.2, 4.0, 1.0, 4.0, 7u, 2u, 5u, 0u);
// The blog's: four passes of 3 x 3, a wider luminance and softer normals.
const SVGF_BLOG: SvgfSettings =
    SvgfSettings(0.01, 0.2, 4.0, 1.0, 10.0, 5u, 1u, 4u, 1u);

// A colour and the variance of its luminance; below 0 counts as 0.
struct SvgfColor {
    value: vec3f,
    variance: f32,
}

// A number and its variance.
struct SvgfScalar {
    value: f32,
    variance: f32,
}

// What the filter knows of a pixel's surface.
struct SvgfSurface {
    // Where it is, in the world.
    position: vec3f,
    // Distance from its plane at which the weight falls to 1/e; not above 0
    // where there is no surface.
    reach: f32,
    // Its unit normal.
    normal: vec3f,
}

// One over a scale, which counts as 2^-60 at least: never infinite.
fn svgf_falloff(scale: f32) -> f32 {
    return 1.0 / max(scale, SVGF_SCALE_MIN);
}

// The luminance difference at which a weight falls to 1/e, from the centre's
// smoothed variance and its luminance. The second term stands for the paper's
// absolute epsilon, which would make the filter depend on the exposure.
fn svgf_luminance_scale(variance: f32, luminance: f32, sigma: f32) -> f32 {
    return sigma * sqrt(max(variance, 0.0)) + SVGF_LUMINANCE_FLOOR * abs(luminance);
}

// e^-(|difference| / scale): the weight of a tap by its luminance.
fn svgf_luminance_weight(difference: f32, scale: f32) -> f32 {
    return exp2_poly(-SVGF_LOG2_E * (abs(difference) * svgf_falloff(scale)));
}

// e^-(|n . offset| / reach): the weight of a tap by its distance from the
// centre's plane. offset is its position less the centre's.
fn svgf_depth_weight(normal: vec3f, offset: vec3f, reach: f32) -> f32 {
    return exp2_poly(-SVGF_LOG2_E * (abs(vec3_dot(normal, offset)) * svgf_falloff(reach)));
}

// The paper's depth weight, e^-(|z - z'| / (sigma |grad z . offset| + epsilon)),
// epsilon a thousandth of the depth. offset is in pixels, gradient the depth's
// change a pixel. On a plane at a grazing angle the far taps weigh too little;
// svgf_depth_weight does better.
fn svgf_depth_weight_gradient(
    difference: f32,
    depth: f32,
    gradient: vec2f,
    offset: vec2f,
    sigma: f32,
) -> f32 {
    let predicted = abs(gradient.x * offset.x + gradient.y * offset.y);
    let scale = sigma * predicted + SVGF_DEPTH_FLOOR * abs(depth);
    return exp2_poly(-SVGF_LOG2_E * (abs(difference) * svgf_falloff(scale)));
}

// max(n . n', 0) to the power of 2^squarings, of unit vectors. Squared is the
// cosine's distance y from 1: if c = 1 - y then c^2 = 1 - y (2 - y), which
// keeps the digits that c has lost.
fn svgf_normal_weight(normal: vec3f, other_normal: vec3f, squarings: u32) -> f32 {
    let turned = vec3f(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    var below = min(0.5 * vec3_dot(turned, turned), 1.0);
    for (var i = 0u; i < min(squarings, 16u); i++) {
        let y = below;
        below = y * (2.0 - y);
    }
    return 1.0 - below;
}

// 2^-exponent for exponent >= 0; 0 above 40.
fn svgf_fade(exponent: f32) -> f32 {
    if exponent > SVGF_EXPONENT_MAX {
        return 0.0;
    }
    let k = round(exponent);
    let f = exponent - k;
    let p = 1.0 + f * (SVGF_FADE_A + f * (SVGF_FADE_B + f * (SVGF_FADE_C
        + f * (SVGF_FADE_D + f * SVGF_FADE_E))));
    return p * bitcast<f32>((127u - u32(k)) << 23u);
}

// The three weights in one, with one exponential. The falloffs are svgf_falloff
// of the reach (times sigma_depth) and of svgf_luminance_scale; 0 leaves that
// weight out. The centre itself weighs exactly 1. From 7 squarings on the
// normals' weight is in the exponent too, by three terms of a logarithm.
fn svgf_weight(
    normal: vec3f,
    other_normal: vec3f,
    offset: vec3f,
    depth_falloff: f32,
    difference: f32,
    luminance_falloff: f32,
    squarings: u32,
) -> f32 {
    // All that is the centre's comes first: a loop over taps takes it out.
    let steep = SVGF_LOG2_E * depth_falloff;
    let across = vec3f(normal.x * steep, normal.y * steep, normal.z * steep);
    let plane = abs(vec3_dot(across, offset));
    let apart = abs(difference) * (SVGF_LOG2_E * luminance_falloff);
    let exponent = plane + apart;
    if squarings < SVGF_STEEP {
        return svgf_normal_weight(normal, other_normal, squarings) * svgf_fade(exponent);
    }
    let turned = vec3f(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    let d = vec3_dot(turned, turned);
    let power = f32(1u << (min(squarings, 16u) - SVGF_STEEP));
    let bent = d * (power * SVGF_NORMAL_A + d * (power * SVGF_NORMAL_B + d * (power * SVGF_NORMAL_C)));
    return svgf_fade(exponent + bent);
}

// B3 spline: 3/8, 1/4, 1/16.
fn svgf_spline(offset: i32) -> f32 {
    let far = select(0.0625, 0.25, abs(offset) == 1);
    return select(far, 0.375, offset == 0);
}

// Whether a tap at this place exists.
fn svgf_inside(x: i32, y: i32, size: vec2u) -> bool {
    return x >= 0 && y >= 0 && x < i32(size.x) && y < i32(size.y);
}

// A number's bits without its sign: in the order of the sizes.
fn svgf_scalar_bits(value: f32) -> u32 {
    return bitcast<u32>(value) & 0x7fffffffu;
}

// The largest component's bits, without its sign.
fn svgf_color_bits(value: vec3f) -> u32 {
    return magnitude_bits(value);
}

// Whether there is a surface, and its numbers are ones.
fn svgf_surface_usable(surface: SvgfSurface) -> bool {
    return usable_surface(surface.position, surface.normal, surface.reach) != 0u;
}

// Whether a variance is data.
fn svgf_variance_usable(variance: f32) -> bool {
    return svgf_scalar_bits(variance) < SVGF_VARIANCE_BITS;
}

// What a colour is judged by, and a scalar.
fn svgf_color_luminance(value: vec3f) -> f32 {
    return luminance(value);
}

fn svgf_scalar_luminance(value: f32) -> f32 {
    return value;
}

// The scalar's functions below are the colour's with the type and the callback
// exchanged; a test holds them to that.

// COLOR: begin
// The 3 x 3 Gaussian of the variance around a pixel, of the weights of those
// that exist and are data; 0 if none are.
fn svgf_gaussian_pixel(pixel: vec2u, size: vec2u) -> f32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0.0;
    }
    var sum = 0.0;
    var total = 0.0;
    var low = SVGF_HUGE;
    var high = 0.0;
    for (var dy = -1; dy <= 1; dy++) {
        for (var dx = -1; dx <= 1; dx++) {
            let x = i32(pixel.x) + dx;
            let y = i32(pixel.y) + dy;
            let w = select(0.25, 0.5, dx == 0) * select(0.25, 0.5, dy == 0);
            if !svgf_inside(x, y, size) {
                continue;
            }
            let found = svgf_read_color(vec2u(u32(x), u32(y))).variance;
            if !svgf_variance_usable(found) {
                continue;
            }
            let variance = max(found, 0.0);
            sum += w * variance;
            total += w;
            low = min(low, variance);
            high = max(high, variance);
        }
    }
    if total <= 0.0 {
        return 0.0;
    }
    return min(max(sum / total, low), high);
}

// A pixel's variance: its own where history frames are enough, else that of the
// luminance over 7 x 7 pixels, weighted by depth and normal. Unbiased where the
// weights amount to two pixels, 0 for a pixel alone; never negative.
fn svgf_variance_pixel(pixel: vec2u, size: vec2u, history: f32, settings: SvgfSettings) -> f32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0.0;
    }
    let own = svgf_read_color(pixel).variance;
    let known = svgf_variance_usable(own);
    if known && history >= settings.history {
        return max(own, 0.0);
    }
    let centre = svgf_read_surface(pixel);
    if !svgf_surface_usable(centre) {
        if known {
            return max(own, 0.0);
        }
        return 0.0;
    }
    let depth_falloff = svgf_falloff(settings.sigma_depth * centre.reach);
    var mean = 0.0;
    var total = 0.0;
    var pairs = 0.0;
    var spread = 0.0;
    for (var dy = -3; dy <= 3; dy++) {
        for (var dx = -3; dx <= 3; dx++) {
            let x = i32(pixel.x) + dx;
            let y = i32(pixel.y) + dy;
            if !svgf_inside(x, y, size) {
                continue;
            }
            let at = vec2u(u32(x), u32(y));
            let surface = svgf_read_surface(at);
            let tap = svgf_read_color(at);
            if !svgf_surface_usable(surface) || svgf_color_bits(tap.value) >= SVGF_VALUE_BITS {
                continue;
            }
            let to = surface.position - centre.position;
            let w = svgf_weight(
                centre.normal,
                surface.normal,
                to,
                depth_falloff,
                0.0,
                0.0,
                settings.squarings,
            );
            if w < SVGF_TOTAL_MIN {
                continue;
            }
            let before = total;
            total = before + w;
            let light = svgf_color_luminance(tap.value);
            if before <= 0.0 {
                mean = light;
                continue;
            }
            let part = w / total;
            let away = light - mean;
            pairs += before * w;
            spread += (before * part) * (away * away);
            let moved = (mean * before + light * w) / total;
            mean = min(max(moved, min(mean, light)), max(mean, light));
        }
    }
    if total <= 0.0 {
        return 0.0;
    }
    let square = total * total;
    return (spread / total) * (square / max(2.0 * pairs, 0.5 * square));
}

// One a-trous pass for a pixel, step pixels between taps (at most 2^20): 1 in
// the first pass, then twice that. Each channel lies between its inputs. A pixel
// without a surface keeps its value; one whose value is no data is filled by
// geometry alone, 0 where its neighbours weigh nothing.
fn svgf_atrous_pixel(pixel: vec2u, size: vec2u, step: u32, settings: SvgfSettings) -> SvgfColor {
    let nothing = SvgfColor(vec3f(), 0.0);
    if pixel.x >= size.x || pixel.y >= size.y {
        return nothing;
    }
    let own = svgf_read_color(pixel);
    let known = svgf_color_bits(own.value) < SVGF_VALUE_BITS && svgf_variance_usable(own.variance);
    let centre = svgf_read_surface(pixel);
    if !svgf_surface_usable(centre) {
        if !known {
            return nothing;
        }
        return SvgfColor(own.value, max(own.variance, 0.0));
    }
    let depth_falloff = svgf_falloff(settings.sigma_depth * centre.reach);
    var light = 0.0;
    var luminance_falloff = 0.0;
    if known {
        light = svgf_color_luminance(own.value);
        let smooth_variance = svgf_gaussian_pixel(pixel, size);
        luminance_falloff = svgf_falloff(
            svgf_luminance_scale(smooth_variance, light, settings.sigma_luminance),
        );
    }
    let spacing = i32(min(step, SVGF_STEP_MAX));
    let radius = i32(min(settings.radius, 2u));
    var value = vec3f();
    var variance = 0.0;
    var total = 0.0;
    var low = vec3f(SVGF_VALUE_MAX);
    var high = vec3f(-SVGF_VALUE_MAX);
    for (var dy = -radius; dy <= radius; dy++) {
        for (var dx = -radius; dx <= radius; dx++) {
            let x = i32(pixel.x) + dx * spacing;
            let y = i32(pixel.y) + dy * spacing;
            if !svgf_inside(x, y, size) {
                continue;
            }
            let at = vec2u(u32(x), u32(y));
            let surface = svgf_read_surface(at);
            let tap = svgf_read_color(at);
            if !svgf_surface_usable(surface)
                || svgf_color_bits(tap.value) >= SVGF_VALUE_BITS
                || !svgf_variance_usable(tap.variance) {
                continue;
            }
            let to = surface.position - centre.position;
            var difference = 0.0;
            if known {
                difference = svgf_color_luminance(tap.value) - light;
            }
            let w = (svgf_spline(dx) * svgf_spline(dy)) * svgf_weight(
                centre.normal,
                surface.normal,
                to,
                depth_falloff,
                difference,
                luminance_falloff,
                settings.squarings,
            );
            value = value + tap.value * w;
            variance += (w * w) * max(tap.variance, 0.0);
            total += w;
            low = min(low, tap.value);
            high = max(high, tap.value);
        }
    }
    if total < SVGF_TOTAL_MIN {
        return nothing;
    }
    let mean = value / total;
    return SvgfColor(min(max(mean, low), high), (variance / total) / total);
}
// COLOR: end

// SCALAR: begin
fn svgf_gaussian_scalar_pixel(pixel: vec2u, size: vec2u) -> f32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0.0;
    }
    var sum = 0.0;
    var total = 0.0;
    var low = SVGF_HUGE;
    var high = 0.0;
    for (var dy = -1; dy <= 1; dy++) {
        for (var dx = -1; dx <= 1; dx++) {
            let x = i32(pixel.x) + dx;
            let y = i32(pixel.y) + dy;
            let w = select(0.25, 0.5, dx == 0) * select(0.25, 0.5, dy == 0);
            if !svgf_inside(x, y, size) {
                continue;
            }
            let found = svgf_read_scalar(vec2u(u32(x), u32(y))).variance;
            if !svgf_variance_usable(found) {
                continue;
            }
            let variance = max(found, 0.0);
            sum += w * variance;
            total += w;
            low = min(low, variance);
            high = max(high, variance);
        }
    }
    if total <= 0.0 {
        return 0.0;
    }
    return min(max(sum / total, low), high);
}

fn svgf_variance_scalar_pixel(pixel: vec2u, size: vec2u, history: f32, settings: SvgfSettings) -> f32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0.0;
    }
    let own = svgf_read_scalar(pixel).variance;
    let known = svgf_variance_usable(own);
    if known && history >= settings.history {
        return max(own, 0.0);
    }
    let centre = svgf_read_surface(pixel);
    if !svgf_surface_usable(centre) {
        if known {
            return max(own, 0.0);
        }
        return 0.0;
    }
    let depth_falloff = svgf_falloff(settings.sigma_depth * centre.reach);
    var mean = 0.0;
    var total = 0.0;
    var pairs = 0.0;
    var spread = 0.0;
    for (var dy = -3; dy <= 3; dy++) {
        for (var dx = -3; dx <= 3; dx++) {
            let x = i32(pixel.x) + dx;
            let y = i32(pixel.y) + dy;
            if !svgf_inside(x, y, size) {
                continue;
            }
            let at = vec2u(u32(x), u32(y));
            let surface = svgf_read_surface(at);
            let tap = svgf_read_scalar(at);
            if !svgf_surface_usable(surface) || svgf_scalar_bits(tap.value) >= SVGF_VALUE_BITS {
                continue;
            }
            let to = surface.position - centre.position;
            let w = svgf_weight(
                centre.normal,
                surface.normal,
                to,
                depth_falloff,
                0.0,
                0.0,
                settings.squarings,
            );
            if w < SVGF_TOTAL_MIN {
                continue;
            }
            let before = total;
            total = before + w;
            let light = svgf_scalar_luminance(tap.value);
            if before <= 0.0 {
                mean = light;
                continue;
            }
            let part = w / total;
            let away = light - mean;
            pairs += before * w;
            spread += (before * part) * (away * away);
            let moved = (mean * before + light * w) / total;
            mean = min(max(moved, min(mean, light)), max(mean, light));
        }
    }
    if total <= 0.0 {
        return 0.0;
    }
    let square = total * total;
    return (spread / total) * (square / max(2.0 * pairs, 0.5 * square));
}

fn svgf_atrous_scalar_pixel(pixel: vec2u, size: vec2u, step: u32, settings: SvgfSettings) -> SvgfScalar {
    let nothing = SvgfScalar(f32(), 0.0);
    if pixel.x >= size.x || pixel.y >= size.y {
        return nothing;
    }
    let own = svgf_read_scalar(pixel);
    let known = svgf_scalar_bits(own.value) < SVGF_VALUE_BITS && svgf_variance_usable(own.variance);
    let centre = svgf_read_surface(pixel);
    if !svgf_surface_usable(centre) {
        if !known {
            return nothing;
        }
        return SvgfScalar(own.value, max(own.variance, 0.0));
    }
    let depth_falloff = svgf_falloff(settings.sigma_depth * centre.reach);
    var light = 0.0;
    var luminance_falloff = 0.0;
    if known {
        light = svgf_scalar_luminance(own.value);
        let smooth_variance = svgf_gaussian_scalar_pixel(pixel, size);
        luminance_falloff = svgf_falloff(
            svgf_luminance_scale(smooth_variance, light, settings.sigma_luminance),
        );
    }
    let spacing = i32(min(step, SVGF_STEP_MAX));
    let radius = i32(min(settings.radius, 2u));
    var value = f32();
    var variance = 0.0;
    var total = 0.0;
    var low = f32(SVGF_VALUE_MAX);
    var high = f32(-SVGF_VALUE_MAX);
    for (var dy = -radius; dy <= radius; dy++) {
        for (var dx = -radius; dx <= radius; dx++) {
            let x = i32(pixel.x) + dx * spacing;
            let y = i32(pixel.y) + dy * spacing;
            if !svgf_inside(x, y, size) {
                continue;
            }
            let at = vec2u(u32(x), u32(y));
            let surface = svgf_read_surface(at);
            let tap = svgf_read_scalar(at);
            if !svgf_surface_usable(surface)
                || svgf_scalar_bits(tap.value) >= SVGF_VALUE_BITS
                || !svgf_variance_usable(tap.variance) {
                continue;
            }
            let to = surface.position - centre.position;
            var difference = 0.0;
            if known {
                difference = svgf_scalar_luminance(tap.value) - light;
            }
            let w = (svgf_spline(dx) * svgf_spline(dy)) * svgf_weight(
                centre.normal,
                surface.normal,
                to,
                depth_falloff,
                difference,
                luminance_falloff,
                settings.squarings,
            );
            value = value + tap.value * w;
            variance += (w * w) * max(tap.variance, 0.0);
            total += w;
            low = min(low, tap.value);
            high = max(high, tap.value);
        }
    }
    if total < SVGF_TOTAL_MIN {
        return nothing;
    }
    let mean = value / total;
    return SvgfScalar(min(max(mean, low), high), (variance / total) / total);
}
// SCALAR: end
