// A blur along rows, then along columns, for ambient occlusion and other
// scalars, which stops at edges of depth and normal.
//
// The program defines
//   fn separable_blur_read(at: vec2u) -> SeparableBlurPixel

// Largest radius in pixels.
const SEPARABLE_BLUR_MAX_RADIUS: u32 = 32u;
// Weight of the squared distance between unit normals: as cos^128.
const SEPARABLE_BLUR_NORMAL: f32 = 64.0;
// Largest value; larger ones count as this.
const SEPARABLE_BLUR_MAX: f32 = 1e8;
// log2 e.
const SEPARABLE_BLUR_LOG2_E: f32 = 1.442695;

// What the blur knows of a pixel.
struct SeparableBlurPixel {
    // Where its surface is, in the world.
    position: vec3f,
    // Distance from its plane at which the weight falls to 1/e, above 0; not
    // above 0 where there is no surface.
    reach: f32,
    // Its unit normal.
    normal: vec3f,
    // The value to blur, >= 0.
    value: f32,
}

// The weight of a tap against a centre of weight 1, in [0, 1]:
// e^-(2 (d/r)^2 + p^2 + 64 |n - n'|^2), with d its distance and r the radius
// in pixels (1 to 64), p its distance from the centre's plane over reach.
fn separable_blur_weight(
    distance: u32,
    radius: u32,
    normal: vec3f,
    other_normal: vec3f,
    offset: vec3f,
    reach: f32,
) -> f32 {
    if reach <= 0.0 {
        return 0.0;
    }
    let height = abs(vec3_dot(normal, offset));
    // e^-64 and less; compared before dividing, so that nothing overflows.
    if height >= 8.0 * reach {
        return 0.0;
    }
    let p = height / reach;
    let d = f32(distance) / f32(radius);
    let turned = vec3f(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    let shape = (2.0 * (d * d) + p * p) + SEPARABLE_BLUR_NORMAL * vec3_dot(turned, turned);
    return exp2_poly(-SEPARABLE_BLUR_LOG2_E * shape);
}

// The value if it is finite and not negative, cut at the largest; else -1.
fn separable_blur_clean(value: f32) -> f32 {
    let v = sanitize_finite(value, -1.0);
    if v < 0.0 {
        return -1.0;
    }
    return min(v, SEPARABLE_BLUR_MAX);
}

// The weight of a tap, 0 if its value or its surface does not count.
fn separable_blur_tap(
    centre: SeparableBlurPixel,
    tap: SeparableBlurPixel,
    distance: u32,
    radius: u32,
) -> f32 {
    if separable_blur_clean(tap.value) < 0.0 || usable_surface(tap.position, tap.normal, tap.reach) == 0u {
        return 0.0;
    }
    let offset = vec3f(
        tap.position.x - centre.position.x,
        tap.position.y - centre.position.y,
        tap.position.z - centre.position.z,
    );
    return separable_blur_weight(
        distance,
        radius,
        centre.normal,
        tap.normal,
        offset,
        centre.reach,
    );
}

// One pass: a pixel, blurred along a row (axis 0) or a column (axis 1), radius
// in pixels, at most 32. The result lies between its inputs. Pixels outside
// the image count nowhere, nor do values that are negative or not finite.
// Without a surface, or with a number in it that is none, the value stays
// untouched.
fn separable_blur_pixel(pixel: vec2u, size: vec2u, axis: u32, radius: u32) -> f32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0.0;
    }
    let centre = separable_blur_read(pixel);
    let own = separable_blur_clean(centre.value);
    if usable_surface(centre.position, centre.normal, centre.reach) == 0u {
        return max(own, 0.0);
    }
    var sum = 0.0;
    var weight = 0.0;
    var low = SEPARABLE_BLUR_MAX;
    var high = 0.0;
    if own >= 0.0 {
        sum = own;
        weight = 1.0;
        low = own;
        high = own;
    }
    var along = vec2u(1u, 0u);
    var place = pixel.x;
    var end = size.x;
    if axis != 0u {
        along = vec2u(0u, 1u);
        place = pixel.y;
        end = size.y;
    }
    let reach = min(radius, SEPARABLE_BLUR_MAX_RADIUS);
    for (var i = 1u; i <= reach; i++) {
        var before = 0.0;
        var before_weight = 0.0;
        if i <= place {
            let at = vec2u(pixel.x - i * along.x, pixel.y - i * along.y);
            let tap = separable_blur_read(at);
            before_weight = separable_blur_tap(centre, tap, i, reach);
            if before_weight > 0.0 {
                before = separable_blur_clean(tap.value);
                low = min(low, before);
                high = max(high, before);
            }
        }
        var after = 0.0;
        var after_weight = 0.0;
        if i < end - place {
            let at = vec2u(pixel.x + i * along.x, pixel.y + i * along.y);
            let tap = separable_blur_read(at);
            after_weight = separable_blur_tap(centre, tap, i, reach);
            if after_weight > 0.0 {
                after = separable_blur_clean(tap.value);
                low = min(low, after);
                high = max(high, after);
            }
        }
        sum += before * before_weight + after * after_weight;
        weight += before_weight + after_weight;
    }
    if weight <= 0.0 {
        return 0.0;
    }
    return min(max(sum / weight, low), high);
}
