// Where a pixel was in the frame before, and what is left of its history: the
// motion of a surface point or of what a mirror shows there, tests of each
// texel of the footprint, the mean of those that pass, and the blend of two
// such histories (Schied et al. 2017; Ray Tracing Gems, chapter 25).
// Needs math/exponent, math/luminance, math/vector, ray/camera; its bindings
// math/sanitize.
//
// The program declares a type and defines three functions:
//   alias ReprojectValue = f32;  (or vec2f, vec3f, vec4f)
//     what the history holds;
//   fn reproject_read_surface(at: vec2u) -> ReprojectSurface
//     the surface that this frame has in a pixel;
//   fn reproject_read_prior(at: vec2u) -> ReprojectSurface
//     the surface that the frame before had in a pixel;
//   fn reproject_read_history(at: vec2u) -> ReprojectHistory
//     the history of a pixel; of length 0 where its value is not finite.

// The motion, in pixels, of a point that the frame before did not show.
const REPROJECT_NOWHERE: f32 = 16777216.0;
// Motions of this many pixels and more have no history.
const REPROJECT_FAR: f32 = 4194304.0;
// Smallest share of a footprint that must pass the tests.
const REPROJECT_COVERAGE: f32 = 0.01;
// Images in a concave mirror are at most 1/this times as far away as what they
// show.
const REPROJECT_FOCUS: f32 = 0.015625;
// Smallest deviation that counts, relative to the signal.
const REPROJECT_DEVIATION: f32 = 0.03125;
// What a G-buffer knows of a pixel.
struct ReprojectSurface {
    // Where its surface is, in the world.
    position: vec3f,
    // Distance from the eye; not above 0 where there is no surface.
    depth: f32,
    // Its unit normal.
    normal: vec3f,
    // Which object it belongs to.
    mesh: u32,
}

// How far a texel may be from the surface that should be there.
struct ReprojectTolerance {
    // Distance from the surface, relative to its depth.
    plane: f32,
    // Distance between the unit normals, about the angle in radians.
    normal: f32,
}

// Limits of the tests that suit most scenes.
const REPROJECT_TOLERANCE: ReprojectTolerance = ReprojectTolerance(0.01, 0.5);

// Which texels of the frame before a pixel takes its history from: texel
// 3j + i of 0 to 8 lies at corner + (i, j) and weighs across[i] * down[j], if
// its bit in valid is set; reproject_tap gives both.
struct ReprojectTaps {
    // The first texel; left of the image it is 2^32 - 1, as integers wrap.
    corner: vec2u,
    // Weights of the three columns.
    across: vec3f,
    // Weights of the three rows.
    down: vec3f,
    // A bit for each texel that counts; none: no history.
    valid: u32,
}

// No history.
const REPROJECT_NO_TAPS: ReprojectTaps = ReprojectTaps(
    vec2u(0u, 0u),
    vec3f(0.0, 0.0, 0.0),
    vec3f(0.0, 0.0, 0.0),
    0u,
);

// A texel and its weight.
struct ReprojectTap {
    // The texel, inside the image if its weight is above 0.
    at: vec2u,
    // Its weight in [0, 1], not normalised over the valid texels.
    weight: f32,
}

// What has been gathered over the frames before.
struct ReprojectHistory {
    // The value.
    value: ReprojectValue,
    // How many frames it stands for; not above 0: no history.
    length: f32,
}

// How position and normal change over a surface, along one direction.
struct ReprojectBend {
    // Change of the position.
    along: vec3f,
    // Change of the unit normal over it.
    turn: vec3f,
}

// Where a camera sees a point: in pixels from the upper left corner, y down,
// and the depth along forward. A point behind the eye has a negative depth, and
// the place where the line through eye and point meets the image. Depth 0 (and
// place 0) means that there is no such place.
fn reproject_project(point: vec3f, camera: Camera) -> vec3f {
    let to = vec3f(
        point.x - camera.origin.x,
        point.y - camera.origin.y,
        point.z - camera.origin.z,
    );
    let across = vec3_cross(camera.right, camera.up);
    let ahead = vec3_dot(to, across);
    let volume = vec3_dot(camera.forward, across);
    if abs(ahead) <= 1e-18 || abs(volume) <= 1e-18 {
        return vec3f(0.0, 0.0, 0.0);
    }
    let x = vec3_dot(to, vec3_cross(camera.up, camera.forward)) / ahead;
    let y = vec3_dot(to, vec3_cross(camera.forward, camera.right)) / ahead;
    return vec3f(
        (0.5 + 0.5 * x) / camera.inverse_resolution.x,
        (0.5 - 0.5 * y) / camera.inverse_resolution.y,
        ahead / volume,
    );
}

// Whether two cameras and points are the same.
fn reproject_still(point: vec3f, prior_point: vec3f, camera: Camera, prior: Camera) -> bool {
    return all(point == prior_point)
        && all(camera.origin == prior.origin)
        && all(camera.right == prior.right)
        && all(camera.up == prior.up)
        && all(camera.forward == prior.forward)
        && all(camera.inverse_resolution == prior.inverse_resolution);
}

// How many pixels a point has to be moved to where the frame before saw it.
// prior_point is where the point was then, prior_camera the camera then.
// Exactly 0 where nothing moves, on any driver. REPROJECT_NOWHERE where one
// camera has the point before it and the other behind.
fn reproject_motion(
    point: vec3f,
    prior_point: vec3f,
    camera: Camera,
    prior_camera: Camera,
) -> vec2f {
    if reproject_still(point, prior_point, camera, prior_camera) {
        return vec2f(0.0, 0.0);
    }
    let now = reproject_project(point, camera);
    let then = reproject_project(prior_point, prior_camera);
    let before = now.z > 0.0 && then.z > 0.0;
    let behind = now.z < 0.0 && then.z < 0.0;
    if !before && !behind {
        return vec2f(REPROJECT_NOWHERE, REPROJECT_NOWHERE);
    }
    return vec2f(then.x - now.x, then.y - now.y);
}

// Curvature of a surface from two of its points, one over a length: along is
// the step from one to the other, turn the change of the unit normal over it.
// Above 0 for a convex surface; exact on a sphere and a plane, for a step of
// any size. 0 without a step.
fn reproject_curvature(along: vec3f, turn: vec3f) -> f32 {
    let square = vec3_dot(along, along);
    if square <= 1e-30 {
        return 0.0;
    }
    return vec3_dot(turn, along) / square;
}

// By how much a mirror adds to the curvature of a wave front that it reflects
// (one over a length), along one direction over its surface (Deschamps 1972):
// at normal incidence twice the mirror's curvature. view is the unit vector
// from the eye to the mirror. 0 for a flat mirror and without a step.
fn reproject_power(view: vec3f, normal: vec3f, along: vec3f, turn: vec3f) -> f32 {
    let cosine = -vec3_dot(view, normal);
    let seen = vec3_cross(view, along);
    let square = vec3_dot(seen, seen);
    if cosine <= 0.0 || square <= 1e-30 {
        return 0.0;
    }
    return (2.0 * cosine) * (vec3_dot(turn, along) / square);
}

// How far behind a mirror the image of a point lies that is distance before it:
// 1/image = 1/distance + power. Negative (a real image before the mirror)
// beyond the focus of a concave mirror, next to which it is limited.
fn reproject_image_distance(distance: f32, power: f32) -> f32 {
    let bend = 1.0 + distance * power;
    if bend >= 0.0 {
        return distance / max(bend, REPROJECT_FOCUS);
    }
    return distance / min(bend, -REPROJECT_FOCUS);
}

// Where a mirror's image of a hit point lies in the world. position is the
// mirror's point, not at the eye; distance that from there to the hit point.
fn reproject_virtual_point(eye: vec3f, position: vec3f, distance: f32, power: f32) -> vec3f {
    let view = vec3_normalize(vec3f(
        position.x - eye.x,
        position.y - eye.y,
        position.z - eye.z,
    ));
    let image = reproject_image_distance(distance, power);
    return vec3f(
        position.x + view.x * image,
        position.y + view.y * image,
        position.z + view.z * image,
    );
}

// Whether a motion is a number below REPROJECT_FAR.
fn reproject_near(motion: vec2f) -> bool {
    // By bits: NaN and infinity have the largest ones.
    let far = bitcast<u32>(REPROJECT_FAR);
    return (bitcast<u32>(motion.x) & 0x7fffffffu) < far
        && (bitcast<u32>(motion.y) & 0x7fffffffu) < far;
}

// A bit for each of three texels from corner on that is inside and weighs
// something.
fn reproject_bits(corner: u32, size: u32, weights: vec3f) -> u32 {
    let first = select(0u, 1u, corner < size && weights.x > 0.0);
    let second = select(0u, 1u, corner + 1u < size && weights.y > 0.0);
    let third = select(0u, 1u, corner + 2u < size && weights.z > 0.0);
    return first | (second << 1u) | (third << 2u);
}

// Nine bits from those of three columns and three rows.
fn reproject_square(columns: u32, rows: u32) -> u32 {
    let first = columns * (rows & 1u);
    let second = columns * ((rows >> 1u) & 1u);
    let third = columns * ((rows >> 2u) & 1u);
    return first | (second << 3u) | (third << 6u);
}

// The four texels around where a pixel was, with bilinear weights. size is the
// image's, each side below 2^30, pixel inside it. Texels outside the image do
// not count, each for itself; nothing counts where the place itself is outside,
// or where the motion is not finite or REPROJECT_FAR or more. A motion of whole
// pixels gives one texel of weight 1.
fn reproject_footprint(pixel: vec2u, size: vec2u, motion: vec2f) -> ReprojectTaps {
    if !reproject_near(motion) {
        return REPROJECT_NO_TAPS;
    }
    // Of the motion alone, not of pixel plus motion: that would round.
    let base = vec2f(floor(motion.x), floor(motion.y));
    let part = vec2f(motion.x - base.x, motion.y - base.y);
    let corner = vec2u(pixel.x + u32(i32(base.x)), pixel.y + u32(i32(base.y)));
    let across = vec3f(1.0 - part.x, part.x, 0.0);
    let down = vec3f(1.0 - part.y, part.y, 0.0);
    // The image ends half a pixel beyond the middle of its last one.
    let next = vec2u(corner.x + 1u, corner.y + 1u);
    let left = corner.x < size.x || (next.x < size.x && part.x >= 0.5);
    let right = next.x < size.x || (corner.x < size.x && part.x <= 0.5);
    let top = corner.y < size.y || (next.y < size.y && part.y >= 0.5);
    let bottom = next.y < size.y || (corner.y < size.y && part.y <= 0.5);
    if !(left && right && top && bottom) {
        return REPROJECT_NO_TAPS;
    }
    return ReprojectTaps(
        corner,
        across,
        down,
        reproject_square(
            reproject_bits(corner.x, size.x, across),
            reproject_bits(corner.y, size.y, down),
        ),
    );
}

// Weights of the quadratic B-spline at t pixels from the middle texel.
fn reproject_spline(t: f32) -> vec3f {
    let low = 0.5 - t;
    let high = 0.5 + t;
    return vec3f(0.5 * (low * low), 0.75 - t * t, 0.5 * (high * high));
}

// The nine texels around where a pixel was, with the weights of the quadratic
// B-spline: for when none of the four nearest is of the same surface.
fn reproject_footprint_wide(pixel: vec2u, size: vec2u, motion: vec2f) -> ReprojectTaps {
    if !reproject_near(motion) {
        return REPROJECT_NO_TAPS;
    }
    let base = vec2f(floor(motion.x + 0.5), floor(motion.y + 0.5));
    let part = vec2f(motion.x - base.x, motion.y - base.y);
    let middle = vec2u(pixel.x + u32(i32(base.x)), pixel.y + u32(i32(base.y)));
    let corner = vec2u(middle.x - 1u, middle.y - 1u);
    // A place on the very edge belongs to the image on either side.
    let inside_x = middle.x < size.x || (corner.x < size.x && part.x <= -0.5);
    let inside_y = middle.y < size.y || (corner.y < size.y && part.y <= -0.5);
    if !inside_x || !inside_y {
        return REPROJECT_NO_TAPS;
    }
    let across = reproject_spline(part.x);
    let down = reproject_spline(part.y);
    return ReprojectTaps(
        corner,
        across,
        down,
        reproject_square(
            reproject_bits(corner.x, size.x, across),
            reproject_bits(corner.y, size.y, down),
        ),
    );
}

// One of three weights.
fn reproject_pick(weights: vec3f, index: u32) -> f32 {
    if index == 0u {
        return weights.x;
    }
    if index == 1u {
        return weights.y;
    }
    return weights.z;
}

// Texel index of 0 to 8 and its weight; a weight of 0: it does not count.
fn reproject_tap(taps: ReprojectTaps, index: u32) -> ReprojectTap {
    if index >= 9u || ((taps.valid >> (index & 31u)) & 1u) == 0u {
        return ReprojectTap(vec2u(0u, 0u), 0.0);
    }
    let row = index / 3u;
    let column = index - 3u * row;
    return ReprojectTap(
        vec2u(taps.corner.x + column, taps.corner.y + row),
        reproject_pick(taps.across, column) * reproject_pick(taps.down, row),
    );
}

// Whether there is a surface, and its numbers are ones.
fn reproject_usable(surface: ReprojectSurface) -> bool {
    return usable_surface(surface.position, surface.normal, surface.depth) != 0u;
}

// 1 if a texel of the frame before shows the surface that should be there, else
// 0. expected is the pixel's own surface, moved back to where it was then;
// curvature as in reproject_curvature, 0 for flat. Same mesh; distance from the
// surface at most tolerance.plane times the depth; distance of its normal from
// the expected one at most tolerance.normal. A surface with a number that is
// none matches nothing, nor does anything with such a curvature.
fn reproject_matches(
    expected: ReprojectSurface,
    curvature: f32,
    found: ReprojectSurface,
    tolerance: ReprojectTolerance,
) -> u32 {
    if !reproject_usable(expected) || !reproject_usable(found) || expected.mesh != found.mesh {
        return 0u;
    }
    if (bitcast<u32>(curvature) & 0x7fffffffu) >= USABLE_BITS {
        return 0u;
    }
    let to = vec3f(
        found.position.x - expected.position.x,
        found.position.y - expected.position.y,
        found.position.z - expected.position.z,
    );
    let fall = 0.5 * curvature * vec3_dot(to, to);
    let height = vec3_dot(expected.normal, to) + fall;
    if abs(height) > tolerance.plane * expected.depth {
        return 0u;
    }
    let turned = vec3f(
        (found.normal.x - expected.normal.x) - curvature * to.x,
        (found.normal.y - expected.normal.y) - curvature * to.y,
        (found.normal.z - expected.normal.z) - curvature * to.z,
    );
    if vec3_dot(turned, turned) > tolerance.normal * tolerance.normal {
        return 0u;
    }
    return 1u;
}

// The taps that pass the test, and whether those are enough; none if not.
fn reproject_tested(
    taps: ReprojectTaps,
    expected: ReprojectSurface,
    curvature: f32,
    tolerance: ReprojectTolerance,
) -> ReprojectTaps {
    var valid = taps.valid;
    var coverage = 0.0;
    for (var i = 0u; i < 9u; i++) {
        let tap = reproject_tap(taps, i);
        if tap.weight > 0.0 {
            let found = reproject_read_prior(tap.at);
            if reproject_matches(expected, curvature, found, tolerance) == 1u {
                coverage = coverage + tap.weight;
            } else {
                valid = valid & ~(1u << i);
            }
        }
    }
    if coverage < REPROJECT_COVERAGE {
        return REPROJECT_NO_TAPS;
    }
    return ReprojectTaps(taps.corner, taps.across, taps.down, valid);
}

// Which texels of the frame before show the same surface as a pixel does now:
// the four nearest, or, where less than REPROJECT_COVERAGE of them passes,
// those of the 3 x 3 around; if these do not suffice either, none. Reads one
// texel where nothing moves.
fn reproject_find(
    pixel: vec2u,
    size: vec2u,
    motion: vec2f,
    expected: ReprojectSurface,
    curvature: f32,
    tolerance: ReprojectTolerance,
) -> ReprojectTaps {
    if !reproject_usable(expected) {
        return REPROJECT_NO_TAPS;
    }
    let near = reproject_tested(
        reproject_footprint(pixel, size, motion),
        expected,
        curvature,
        tolerance,
    );
    if near.valid != 0u {
        return near;
    }
    return reproject_tested(
        reproject_footprint_wide(pixel, size, motion),
        expected,
        curvature,
        tolerance,
    );
}

// The history of the texels that count: their weighted mean, channel by channel
// between them. The length is the weighted harmonic mean of theirs.
fn reproject_gather(taps: ReprojectTaps) -> ReprojectHistory {
    var sum = ReprojectValue();
    var low = ReprojectValue();
    var high = ReprojectValue();
    var weight = 0.0;
    var rates = 0.0;
    var shortest = 0.0;
    var longest = 0.0;
    for (var i = 0u; i < 9u; i++) {
        let tap = reproject_tap(taps, i);
        if tap.weight <= 0.0 {
            continue;
        }
        let texel = reproject_read_history(tap.at);
        if texel.length <= 0.0 {
            continue;
        }
        if weight <= 0.0 {
            low = texel.value;
            high = texel.value;
            shortest = texel.length;
            longest = texel.length;
        } else {
            low = min(low, texel.value);
            high = max(high, texel.value);
            shortest = min(shortest, texel.length);
            longest = max(longest, texel.length);
        }
        sum = sum + texel.value * tap.weight;
        weight = weight + tap.weight;
        rates = rates + tap.weight / texel.length;
    }
    if weight < REPROJECT_COVERAGE {
        return ReprojectHistory(ReprojectValue(), 0.0);
    }
    return ReprojectHistory(
        min(max(sum / weight, low), high),
        min(max(weight / rates, shortest), longest),
    );
}

// The history of a pixel: reproject_find, then reproject_gather.
fn reproject_pixel(
    pixel: vec2u,
    size: vec2u,
    motion: vec2f,
    expected: ReprojectSurface,
    curvature: f32,
    tolerance: ReprojectTolerance,
) -> ReprojectHistory {
    return reproject_gather(
        reproject_find(pixel, size, motion, expected, curvature, tolerance),
    );
}

// The step from a pixel's surface to a neighbour's, or 0 if that is another
// object or none.
fn reproject_step(centre: ReprojectSurface, to: ReprojectSurface) -> ReprojectBend {
    if !reproject_usable(to) || to.mesh != centre.mesh {
        return ReprojectBend(vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 0.0));
    }
    return ReprojectBend(to.position - centre.position, to.normal - centre.normal);
}

// The shorter of the steps to two neighbours on opposite sides, as seen toward
// the second; of two of the same length the second.
fn reproject_shorter(back: ReprojectBend, ahead: ReprojectBend) -> ReprojectBend {
    let back_square = vec3_dot(back.along, back.along);
    let ahead_square = vec3_dot(ahead.along, ahead.along);
    if back_square > 0.0 && (ahead_square <= 0.0 || back_square < ahead_square) {
        return ReprojectBend(-back.along, -back.turn);
    }
    return ahead;
}

// How a pixel's surface bends in the image's direction parallax (in pixels, of
// any length): from the neighbour to the left or right, and that above or
// below, whichever is nearer in the world. For reproject_curvature and
// reproject_power.
fn reproject_bend(pixel: vec2u, size: vec2u, parallax: vec2f) -> ReprojectBend {
    let nothing = ReprojectBend(vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 0.0));
    if pixel.x >= size.x || pixel.y >= size.y || (parallax.x == 0.0 && parallax.y == 0.0) {
        return nothing;
    }
    let centre = reproject_read_surface(pixel);
    if !reproject_usable(centre) {
        return nothing;
    }
    var left = nothing;
    var right = nothing;
    var above = nothing;
    var below = nothing;
    if pixel.x > 0u {
        left = reproject_step(centre, reproject_read_surface(vec2u(pixel.x - 1u, pixel.y)));
    }
    if pixel.x + 1u < size.x {
        right = reproject_step(centre, reproject_read_surface(vec2u(pixel.x + 1u, pixel.y)));
    }
    if pixel.y > 0u {
        above = reproject_step(centre, reproject_read_surface(vec2u(pixel.x, pixel.y - 1u)));
    }
    if pixel.y + 1u < size.y {
        below = reproject_step(centre, reproject_read_surface(vec2u(pixel.x, pixel.y + 1u)));
    }
    let across = reproject_shorter(left, right);
    let down = reproject_shorter(above, below);
    // With a neighbour in one direction only, that one has to speak for both:
    // else the least change of the parallax would turn a curve into a plane.
    let length = abs(parallax.x) + abs(parallax.y);
    var x = length;
    if vec3_dot(down.along, down.along) > 0.0 {
        x = parallax.x;
    }
    var y = length;
    if vec3_dot(across.along, across.along) > 0.0 {
        y = parallax.y;
    }
    return ReprojectBend(
        across.along * x + down.along * y,
        across.turn * x + down.turn * y,
    );
}

// The motion of what a mirror shows in a pixel, as reproject_motion: of the
// image of the hit point, distance from the mirror along the reflected ray.
// Mirror and hit point stand still; the curvature is taken from neighbouring
// pixels. Exactly 0 where the camera stands still.
fn reproject_reflection_motion(
    pixel: vec2u,
    size: vec2u,
    distance: f32,
    camera: Camera,
    prior_camera: Camera,
) -> vec2f {
    if pixel.x >= size.x || pixel.y >= size.y {
        return vec2f(REPROJECT_NOWHERE, REPROJECT_NOWHERE);
    }
    let mirror = reproject_read_surface(pixel);
    if !reproject_usable(mirror) {
        return vec2f(REPROJECT_NOWHERE, REPROJECT_NOWHERE);
    }
    // The camera of now at the place of then: movement without turning.
    let moved = Camera(
        prior_camera.origin,
        camera.right,
        camera.up,
        camera.forward,
        camera.inverse_resolution,
    );
    let parallax = reproject_motion(mirror.position, mirror.position, camera, moved);
    let bend = reproject_bend(pixel, size, parallax);
    let view = vec3_normalize(vec3f(
        mirror.position.x - camera.origin.x,
        mirror.position.y - camera.origin.y,
        mirror.position.z - camera.origin.z,
    ));
    let power = reproject_power(view, mirror.normal, bend.along, bend.turn);
    let point = reproject_virtual_point(camera.origin, mirror.position, distance, power);
    return reproject_motion(point, point, camera, prior_camera);
}

// One channel's distance in deviations.
fn reproject_deviations(value: f32, mean: f32, deviation: f32, least: f32) -> f32 {
    let unit = max(deviation, least);
    if unit <= 0.0 {
        return 0.0;
    }
    return abs(value - mean) / unit;
}

// How far a colour is from what a neighbourhood of the new frame shows:
// luminance of the distances from its mean in each channel, in standard
// deviations, of which each counts as at least REPROJECT_DEVIATION times the
// luminance of colour or mean. Arguments are >= 0.
fn reproject_color_distance(color: vec3f, mean: vec3f, deviation: vec3f) -> f32 {
    let least = REPROJECT_DEVIATION * max(luminance(color), luminance(mean));
    return luminance(vec3f(
        reproject_deviations(color.x, mean.x, deviation.x, least),
        reproject_deviations(color.y, mean.y, deviation.y, least),
        reproject_deviations(color.z, mean.z, deviation.z, least),
    ));
}

// The chapter's weight of a reprojected colour, in [0, 1]: 2 to the power of
// -10 times reproject_color_distance.
fn reproject_color_weight(color: vec3f, mean: vec3f, deviation: vec3f) -> f32 {
    return exp2_poly(-10.0 * reproject_color_distance(color, mean, deviation));
}

// The second one's share of a blend, in [0, 1], from the distances of both: its
// weight over the sum of the weights, without an underflow of either.
fn reproject_share(first: f32, second: f32) -> f32 {
    let ratio = exp2_poly(-10.0 * abs(second - first));
    if second > first {
        return ratio / (1.0 + ratio);
    }
    return 1.0 / (1.0 + ratio);
}

// The blend of two histories of one pixel, share in [0, 1] of it from the
// second; where one has no history, the other. Between the two in each channel.
fn reproject_blend(
    first: ReprojectHistory,
    second: ReprojectHistory,
    share: f32,
) -> ReprojectHistory {
    if second.length <= 0.0 {
        return first;
    }
    if first.length <= 0.0 {
        return second;
    }
    let rest = 1.0 - share;
    let mixed = first.value * rest + second.value * share;
    let rate = rest / first.length + share / second.length;
    return ReprojectHistory(
        min(max(mixed, min(first.value, second.value)), max(first.value, second.value)),
        min(max(1.0 / rate, min(first.length, second.length)), max(first.length, second.length)),
    );
}
