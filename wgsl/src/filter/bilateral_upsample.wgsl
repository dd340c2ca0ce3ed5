// From half or quarter resolution to full, without bleeding over edges:
// bilinear weights times how well each of the four surfaces fits. After Kopf
// et al., Joint Bilateral Upsampling, 2007.
//
// The program defines
//   fn bilateral_upsample_read_surface(pixel: vec2u) -> BilateralUpsampleSurface
//   fn bilateral_upsample_read_tap(at: vec2u) -> BilateralUpsampleTap

// Weight that the nearest value has in any case, 2^-24.
const BILATERAL_UPSAMPLE_FLOOR: f32 = 5.9604645e-8;
// Weight of the squared distance between unit normals: as cos^128.
const BILATERAL_UPSAMPLE_NORMAL: f32 = 64.0;
// Largest value of a channel; larger ones count as this.
const BILATERAL_UPSAMPLE_MAX: f32 = 1e8;
// log2 e.
const BILATERAL_UPSAMPLE_LOG2_E: f32 = 1.442695;

// A surface at full resolution.
struct BilateralUpsampleSurface {
    // Where it is, in the world.
    position: vec3f,
    // Distance from its plane at which a weight falls to 1/e, above 0; not
    // above 0 where there is no surface.
    reach: f32,
    // Its unit normal.
    normal: vec3f,
}

// A value at low resolution.
struct BilateralUpsampleTap {
    // The value, channels >= 0.
    color: vec3f,
    // How much it counts, in [0, 1]; 0 for no value, or no surface.
    weight: f32,
    // Where its surface is, in the world.
    position: vec3f,
    // Its unit normal.
    normal: vec3f,
}

// Where a pixel lies among the pixels of the low resolution.
struct BilateralUpsamplePlace {
    // The nearest pixel, the one whose block holds it.
    near: vec2u,
    // The next one on the other side, along each axis; 2^32 - 1 for -1.
    far: vec2u,
    // Bilinear weight of far along each axis, in [0, 1/2).
    share: vec2f,
}

// What has been summed up so far.
struct BilateralUpsampleSum {
    color: vec3f,
    weight: f32,
    low: vec3f,
    high: vec3f,
}

// Where a pixel (below 2^30) lies among pixels that stand for scale x scale
// each, 1 to 64, and have their values in the middle.
fn bilateral_upsample_place(pixel: vec2u, scale: u32) -> BilateralUpsamplePlace {
    let near = vec2u(pixel.x / scale, pixel.y / scale);
    // Twice the distance from the middle of the block, either side.
    let x = 2u * (pixel.x - near.x * scale) + 1u;
    let y = 2u * (pixel.y - near.y * scale) + 1u;
    var far = vec2u(near.x - 1u, near.y - 1u);
    if x > scale {
        far.x = near.x + 1u;
    }
    if y > scale {
        far.y = near.y + 1u;
    }
    let size = f32(2u * scale);
    return BilateralUpsamplePlace(
        near,
        far,
        vec2f(
            f32(max(x, scale) - min(x, scale)) / size,
            f32(max(y, scale) - min(y, scale)) / size,
        ),
    );
}

// How well a surface fits, in [0, 1]: e^-(p^2 + 64 |n - n'|^2), with p its
// distance from the pixel's plane over reach; offset is its position less the
// pixel's.
fn bilateral_upsample_weight(
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
    let turned = vec3f(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    let shape = p * p + BILATERAL_UPSAMPLE_NORMAL * vec3_dot(turned, turned);
    return exp2_poly(-BILATERAL_UPSAMPLE_LOG2_E * shape);
}

// Adds a colour; none of what is not finite or negative.
fn bilateral_upsample_add(
    sum: BilateralUpsampleSum,
    color: vec3f,
    weight: f32,
) -> BilateralUpsampleSum {
    let c = sanitize_vector(color, vec3f(-1.0, -1.0, -1.0));
    if weight <= 0.0 || c.x < 0.0 || c.y < 0.0 || c.z < 0.0 {
        return sum;
    }
    let x = min(c.x, BILATERAL_UPSAMPLE_MAX);
    let y = min(c.y, BILATERAL_UPSAMPLE_MAX);
    let z = min(c.z, BILATERAL_UPSAMPLE_MAX);
    return BilateralUpsampleSum(
        vec3f(
            sum.color.x + weight * x,
            sum.color.y + weight * y,
            sum.color.z + weight * z,
        ),
        sum.weight + weight,
        vec3f(min(sum.low.x, x), min(sum.low.y, y), min(sum.low.z, z)),
        vec3f(max(sum.high.x, x), max(sum.high.y, y), max(sum.high.z, z)),
    );
}

// A full-resolution pixel from the four low-resolution ones around it. The
// result lies between its inputs, channel by channel; where no value fits it
// is the nearest one. Values that are not finite or have a negative channel
// count nowhere; black if there are no others. A surface or a weight with a
// number that is none fits nowhere.
fn bilateral_upsample_pixel(pixel: vec2u, low_size: vec2u, scale: u32) -> vec3f {
    if low_size.x == 0u || low_size.y == 0u {
        return vec3f(0.0, 0.0, 0.0);
    }
    let place = bilateral_upsample_place(pixel, scale);
    let surface = bilateral_upsample_read_surface(pixel);
    let sound = usable_surface(surface.position, surface.normal, surface.reach);
    let nearest = vec2u(min(place.near.x, low_size.x - 1u), min(place.near.y, low_size.y - 1u));
    var sum = BilateralUpsampleSum(
        vec3f(0.0, 0.0, 0.0),
        0.0,
        vec3f(BILATERAL_UPSAMPLE_MAX, BILATERAL_UPSAMPLE_MAX, BILATERAL_UPSAMPLE_MAX),
        vec3f(0.0, 0.0, 0.0),
    );
    sum = bilateral_upsample_add(
        sum,
        bilateral_upsample_read_tap(nearest).color,
        BILATERAL_UPSAMPLE_FLOOR,
    );
    for (var i = 0u; i < 4u; i++) {
        var at = place.near;
        var share_x = 1.0 - place.share.x;
        var share_y = 1.0 - place.share.y;
        if (i & 1u) != 0u {
            at.x = place.far.x;
            share_x = place.share.x;
        }
        if (i & 2u) != 0u {
            at.y = place.far.y;
            share_y = place.share.y;
        }
        if at.x >= low_size.x || at.y >= low_size.y {
            continue;
        }
        let tap = bilateral_upsample_read_tap(at);
        if (sound & usable_surface(tap.position, tap.normal, tap.weight)) == 0u {
            continue;
        }
        let offset = vec3f(
            tap.position.x - surface.position.x,
            tap.position.y - surface.position.y,
            tap.position.z - surface.position.z,
        );
        let fit = bilateral_upsample_weight(surface.normal, tap.normal, offset, surface.reach);
        sum = bilateral_upsample_add(sum, tap.color, ((share_x * share_y) * fit) * tap.weight);
    }
    if sum.weight <= 0.0 {
        return vec3f(0.0, 0.0, 0.0);
    }
    return vec3f(
        min(max(sum.color.x / sum.weight, sum.low.x), sum.high.x),
        min(max(sum.color.y / sum.weight, sum.low.y), sum.high.y),
        min(max(sum.color.z / sum.weight, sum.low.z), sum.high.z),
    );
}
