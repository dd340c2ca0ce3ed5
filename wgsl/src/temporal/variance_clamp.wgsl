// History held to what the pixel's neighbourhood shows now: a box around the
// neighbours' mean, as wide as their deviation and never wider than they are
// (Karis 2014, Salvi 2016).
//
// The program defines
//   fn variance_clamp_read(at: vec2u) -> vec3f

// Radius of the usual 5 x 5 neighbourhood.
const VARIANCE_CLAMP_RADIUS: u32 = 2u;
// Largest radius; larger ones count as this.
const VARIANCE_CLAMP_RADIUS_MAX: u32 = 8u;
// Largest magnitude of a channel; what is larger is a defect.
const VARIANCE_CLAMP_LARGEST: f32 = 1e15;
// Mode: each channel of RGB clamped for itself.
const VARIANCE_CLAMP_RGB: u32 = 0u;
// Bit of the mode: the box is in YCoCg.
const VARIANCE_CLAMP_YCOCG: u32 = 1u;
// Bit of the mode: clip towards the mean instead of clamping.
const VARIANCE_CLAMP_CLIP: u32 = 2u;
// Thinnest side that a box has when it clips, over its widest.
const VARIANCE_CLAMP_THINNEST: f32 = 0.015625;

// What has been seen of a neighbourhood; starts as VARIANCE_CLAMP_EMPTY.
struct VarianceClampMoments {
    // Mean colour.
    mean: vec3f,
    // Sum of squared distances from the mean along each axis of the box.
    spread: vec3f,
    // Smallest and largest coordinate along each axis.
    low: vec3f,
    high: vec3f,
    // Number of colours.
    count: f32,
}

// Nothing seen.
const VARIANCE_CLAMP_EMPTY: VarianceClampMoments = VarianceClampMoments(
    vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 0.0), 0.0,
);

// A box about a mean: how far it reaches along each axis, low <= 0 <= high.
struct VarianceClampBox {
    low: vec3f,
    high: vec3f,
}

// 1 if every channel is a number of magnitude at most VARIANCE_CLAMP_LARGEST,
// else 0. Compares bit patterns, which nothing folds away.
fn variance_clamp_usable(color: vec3f) -> u32 {
    let bits = bitcast<vec3u>(color);
    let largest = bitcast<u32>(VARIANCE_CLAMP_LARGEST);
    return select(0u, 1u, (bits.x & 0x7fffffffu) <= largest)
        & select(0u, 1u, (bits.y & 0x7fffffffu) <= largest)
        & select(0u, 1u, (bits.z & 0x7fffffffu) <= largest);
}

// Luma, orange-blue and green-purple of a colour, or of a difference of two.
fn variance_clamp_ycocg(rgb: vec3f) -> vec3f {
    let side = 0.5 * (rgb.x + rgb.z);
    return vec3f(
        0.5 * (rgb.y + side),
        0.5 * (rgb.x - rgb.z),
        0.5 * (rgb.y - side),
    );
}

// The colour, or difference of two, from luma, orange-blue and green-purple.
fn variance_clamp_rgb(ycocg: vec3f) -> vec3f {
    let side = ycocg.x - ycocg.z;
    return vec3f(side + ycocg.y, ycocg.x + ycocg.z, side - ycocg.y);
}

// A colour or a difference along the axes of the box.
fn variance_clamp_axes(rgb: vec3f, mode: u32) -> vec3f {
    if (mode & VARIANCE_CLAMP_YCOCG) == 0u {
        return rgb;
    }
    return variance_clamp_ycocg(rgb);
}

// The mean of count numbers, of the last one and the mean before it; never
// outside them.
fn variance_clamp_mean(mean: f32, sample: f32, count: f32) -> f32 {
    let moved = mean + (sample - mean) / count;
    return min(max(moved, min(mean, sample)), max(mean, sample));
}

// The moments with a colour added, the box's axes as mode says. A colour with
// a channel that is no number, or too large, is left out.
fn variance_clamp_add(
    moments: VarianceClampMoments,
    color: vec3f,
    mode: u32,
) -> VarianceClampMoments {
    if variance_clamp_usable(color) == 0u {
        return moments;
    }
    let place = variance_clamp_axes(color, mode);
    if moments.count <= 0.0 {
        return VarianceClampMoments(color, vec3f(0.0, 0.0, 0.0), place, place, 1.0);
    }
    let count = moments.count + 1.0;
    let part = moments.count / count;
    let mean = moments.mean;
    let away = vec3f(color.x - mean.x, color.y - mean.y, color.z - mean.z);
    let along = variance_clamp_axes(away, mode);
    return VarianceClampMoments(
        vec3f(
            variance_clamp_mean(mean.x, color.x, count),
            variance_clamp_mean(mean.y, color.y, count),
            variance_clamp_mean(mean.z, color.z, count),
        ),
        vec3f(
            moments.spread.x + part * (along.x * along.x),
            moments.spread.y + part * (along.y * along.y),
            moments.spread.z + part * (along.z * along.z),
        ),
        min(moments.low, place),
        max(moments.high, place),
        count,
    );
}

// The box of a neighbourhood: gamma deviations about the mean along each axis,
// and no farther than the smallest and the largest coordinate.
fn variance_clamp_box(moments: VarianceClampMoments, gamma: f32, mode: u32) -> VarianceClampBox {
    let count = max(moments.count, 1.0);
    let middle = variance_clamp_axes(moments.mean, mode);
    let x = gamma * sqrt(moments.spread.x / count);
    let y = gamma * sqrt(moments.spread.y / count);
    let z = gamma * sqrt(moments.spread.z / count);
    return VarianceClampBox(
        vec3f(
            max(-x, min(moments.low.x - middle.x, 0.0)),
            max(-y, min(moments.low.y - middle.y, 0.0)),
            max(-z, min(moments.low.z - middle.z, 0.0)),
        ),
        vec3f(
            min(x, max(moments.high.x - middle.x, 0.0)),
            min(y, max(moments.high.y - middle.y, 0.0)),
            min(z, max(moments.high.z - middle.z, 0.0)),
        ),
    );
}

// How much of an offset along one axis is inside: 1, or the part at which it
// leaves. A box thinner than least counts as that thick.
fn variance_clamp_share(offset: f32, low: f32, high: f32, least: f32) -> f32 {
    let reach = max(select(-low, high, offset > 0.0), least);
    let length = abs(offset);
    if length <= reach {
        return 1.0;
    }
    return reach / length;
}

// value, but not outside a and b.
fn variance_clamp_between(value: f32, a: f32, b: f32) -> f32 {
    return min(max(value, min(a, b)), max(a, b));
}

// The history held to a box about mean: inside, exactly the history; outside,
// clamped along each axis, or (VARIANCE_CLAMP_CLIP) moved straight towards the
// mean. No channel of the result is outside history and mean; a box without
// extent gives exactly the mean, as does a history that is no number.
fn variance_clamp_limit(
    history: vec3f,
    mean: vec3f,
    bounds: VarianceClampBox,
    mode: u32,
) -> vec3f {
    if variance_clamp_usable(history) == 0u {
        return mean;
    }
    let away = vec3f(history.x - mean.x, history.y - mean.y, history.z - mean.z);
    let offset = variance_clamp_axes(away, mode);
    let low = bounds.low;
    let high = bounds.high;
    var moved = vec3f(0.0, 0.0, 0.0);
    if (mode & VARIANCE_CLAMP_CLIP) == 0u {
        let held = vec3f(
            min(max(offset.x, low.x), high.x),
            min(max(offset.y, low.y), high.y),
            min(max(offset.z, low.z), high.z),
        );
        if held.x == offset.x && held.y == offset.y && held.z == offset.z {
            return history;
        }
        if (mode & VARIANCE_CLAMP_YCOCG) == 0u {
            moved = held;
        } else {
            moved = variance_clamp_rgb(held);
        }
    } else {
        let widest = max(max(high.x - low.x, high.y - low.y), high.z - low.z);
        let least = VARIANCE_CLAMP_THINNEST * widest;
        let share_x = variance_clamp_share(offset.x, low.x, high.x, least);
        let share_y = variance_clamp_share(offset.y, low.y, high.y, least);
        let share_z = variance_clamp_share(offset.z, low.z, high.z, least);
        let share = min(min(share_x, share_y), share_z);
        if share >= 1.0 {
            return history;
        }
        moved = vec3f(share * away.x, share * away.y, share * away.z);
    }
    return vec3f(
        variance_clamp_between(mean.x + moved.x, history.x, mean.x),
        variance_clamp_between(mean.y + moved.y, history.y, mean.y),
        variance_clamp_between(mean.z + moved.z, history.z, mean.z),
    );
}

// A pixel's history held to its neighbourhood in the current frame. size is the
// image's, each side below 2^30; taps outside it, or that are no numbers, are
// left out. On a constant neighbourhood exactly its colour; without any usable
// tap the history, or black if it is no number.
fn variance_clamp_pixel(
    pixel: vec2u,
    size: vec2u,
    radius: u32,
    history: vec3f,
    gamma: f32,
    mode: u32,
) -> vec3f {
    if pixel.x >= size.x || pixel.y >= size.y {
        return vec3f(0.0, 0.0, 0.0);
    }
    let r = i32(min(radius, VARIANCE_CLAMP_RADIUS_MAX));
    var moments = VARIANCE_CLAMP_EMPTY;
    for (var dy = -r; dy <= r; dy++) {
        let y = i32(pixel.y) + dy;
        if y < 0 || y >= i32(size.y) {
            continue;
        }
        for (var dx = -r; dx <= r; dx++) {
            let x = i32(pixel.x) + dx;
            if x < 0 || x >= i32(size.x) {
                continue;
            }
            let tap = variance_clamp_read(vec2u(u32(x), u32(y)));
            moments = variance_clamp_add(moments, tap, mode);
        }
    }
    if moments.count <= 0.0 {
        if variance_clamp_usable(history) == 0u {
            return vec3f(0.0, 0.0, 0.0);
        }
        return history;
    }
    let bounds = variance_clamp_box(moments, gamma, mode);
    return variance_clamp_limit(history, moments.mean, bounds, mode);
}
