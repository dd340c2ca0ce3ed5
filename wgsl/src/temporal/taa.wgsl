// Temporal anti-aliasing after Karis, High Quality Temporal Supersampling,
// 2014: the history, clipped to the 3 x 3 neighbours' box in YCoCg, blended
// with the new frame by weights 1 / (1 + luma).
//
// The program defines
//   fn taa_read(at: vec2u) -> vec3f

// Margin of the box over the largest luma in it, on every side.
const TAA_MARGIN: f32 = 0.00390625;
// Largest value of a channel; larger ones count as this.
const TAA_MAX: f32 = 1e8;

// Linear RGB as luma, orange less blue, green less purple.
fn taa_ycocg(rgb: vec3f) -> vec3f {
    let purple = rgb.x + rgb.z;
    let green = 2.0 * rgb.y;
    return vec3f(
        0.25 * (purple + green),
        0.5 * (rgb.x - rgb.z),
        0.25 * (green - purple),
    );
}

// Linear RGB from YCoCg.
fn taa_rgb(ycocg: vec3f) -> vec3f {
    let purple = ycocg.x - ycocg.z;
    return vec3f(purple + ycocg.y, ycocg.x + ycocg.z, purple - ycocg.y);
}

// How far along one axis the history may keep of its distance from the centre:
// 1 inside, less outside.
fn taa_part(away: f32, extent: f32) -> f32 {
    let size = abs(away);
    if size <= extent {
        return 1.0;
    }
    return extent / size;
}

// The history (linear RGB, channels in [0, TAA_MAX]), moved toward the centre
// of a box until it lies on its surface; untouched if it lies inside. low and
// high are corners in YCoCg; the box is taken larger by TAA_MARGIN of high.x.
fn taa_clip(history: vec3f, low: vec3f, high: vec3f) -> vec3f {
    let color = taa_ycocg(history);
    let margin = TAA_MARGIN * high.x;
    let centre = vec3f(
        0.5 * (low.x + high.x),
        0.5 * (low.y + high.y),
        0.5 * (low.z + high.z),
    );
    let away = vec3f(color.x - centre.x, color.y - centre.y, color.z - centre.z);
    let x = taa_part(away.x, 0.5 * (high.x - low.x) + margin);
    let y = taa_part(away.y, 0.5 * (high.y - low.y) + margin);
    let z = taa_part(away.z, 0.5 * (high.z - low.z) + margin);
    let part = min(min(x, y), z);
    if part >= 1.0 {
        return history;
    }
    let clipped = taa_rgb(vec3f(
        centre.x + part * away.x,
        centre.y + part * away.y,
        centre.z + part * away.z,
    ));
    return vec3f(max(clipped.x, 0.0), max(clipped.y, 0.0), max(clipped.z, 0.0));
}

// Mean of two numbers >= 0 with weights >= 0, never outside them.
fn taa_mix(a: f32, a_weight: f32, b: f32, b_weight: f32) -> f32 {
    let mixed = (a * a_weight + b * b_weight) / (a_weight + b_weight);
    return min(max(mixed, min(a, b)), max(a, b));
}

// History and new frame, blended: the new one with alpha in [0, 1], each over
// 1 + exposure * luma. alpha 1 selects the new frame, 0 the history.
fn taa_blend(history: vec3f, current: vec3f, alpha: f32, exposure: f32) -> vec3f {
    if alpha >= 1.0 {
        return current;
    }
    if alpha <= 0.0 {
        return history;
    }
    // The weights times both denominators.
    let old_weight = (1.0 - alpha) * (1.0 + exposure * taa_ycocg(current).x);
    let new_weight = alpha * (1.0 + exposure * taa_ycocg(history).x);
    return vec3f(
        taa_mix(history.x, old_weight, current.x, new_weight),
        taa_mix(history.y, old_weight, current.y, new_weight),
        taa_mix(history.z, old_weight, current.z, new_weight),
    );
}

// A colour to reckon with, or -1 for one that is not finite or negative.
fn taa_clean(color: vec3f) -> vec3f {
    let c = sanitize_vector(color, vec3f(-1.0, -1.0, -1.0));
    if c.x < 0.0 || c.y < 0.0 || c.z < 0.0 {
        return vec3f(-1.0, -1.0, -1.0);
    }
    return vec3f(min(c.x, TAA_MAX), min(c.y, TAA_MAX), min(c.z, TAA_MAX));
}

// A pixel of the new picture. history is what the last picture has where the
// surface was (alpha 1 if it has nothing). Colours that are not finite or have
// a negative channel count nowhere: as history they mean alpha 1, as the pixel
// itself the clipped history; black if there is neither.
fn taa_pixel(
    pixel: vec2u,
    size: vec2u,
    history: vec3f,
    alpha: f32,
    exposure: f32,
) -> vec3f {
    if pixel.x >= size.x || pixel.y >= size.y {
        return vec3f(0.0, 0.0, 0.0);
    }
    let old = taa_clean(history);
    let current = taa_clean(taa_read(pixel));
    if old.x < 0.0 || alpha >= 1.0 {
        return vec3f(max(current.x, 0.0), max(current.y, 0.0), max(current.z, 0.0));
    }
    var low = vec3f(TAA_MAX, TAA_MAX, TAA_MAX);
    var high = vec3f(-TAA_MAX, -TAA_MAX, -TAA_MAX);
    for (var y = max(pixel.y, 1u) - 1u; y <= min(pixel.y + 1u, size.y - 1u); y++) {
        for (var x = max(pixel.x, 1u) - 1u; x <= min(pixel.x + 1u, size.x - 1u); x++) {
            let color = taa_clean(taa_read(vec2u(x, y)));
            if color.x >= 0.0 {
                let c = taa_ycocg(color);
                low = vec3f(min(low.x, c.x), min(low.y, c.y), min(low.z, c.z));
                high = vec3f(max(high.x, c.x), max(high.y, c.y), max(high.z, c.z));
            }
        }
    }
    // Nothing to clip to: none of the neighbours is usable.
    if high.x < 0.0 {
        return old;
    }
    let clipped = taa_clip(old, low, high);
    if current.x < 0.0 {
        return clipped;
    }
    return taa_blend(clipped, current, alpha, exposure);
}
