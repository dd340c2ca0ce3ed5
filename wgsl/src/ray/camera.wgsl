// Pinhole camera: pixel to ray, and depth back to a world position.
// Needs math/vector, ray/ray.

const CAMERA_FAR: f32 = 3.4028234e38;

// A pinhole camera in world space.
struct Camera {
    // The eye.
    origin: vec3f,
    // From the middle of the image plane at depth 1 to its right edge.
    right: vec3f,
    // From the middle of the image plane at depth 1 to its upper edge.
    up: vec3f,
    // Unit vector along which depth is measured.
    forward: vec3f,
    // One over the image's width and height in pixels.
    inverse_resolution: vec2f,
}

// From the eye through a pixel to the image plane at depth 1.
fn camera_image_point(pixel: vec2f, camera: Camera) -> vec3f {
    let x = (pixel.x * camera.inverse_resolution.x) * 2.0 - 1.0;
    let y = 1.0 - (pixel.y * camera.inverse_resolution.y) * 2.0;
    return vec3f(
        (camera.right.x * x + camera.up.x * y) + camera.forward.x,
        (camera.right.y * x + camera.up.y * y) + camera.forward.y,
        (camera.right.z * x + camera.up.z * y) + camera.forward.z,
    );
}

// The ray from the eye through a point of the image, with a unit direction and
// no limit. pixel counts from the upper left corner, y down: the middle of
// pixel (i, j) is (i + 0.5, j + 0.5).
fn camera_ray(pixel: vec2f, camera: Camera) -> Ray {
    return Ray(
        camera.origin,
        vec3_normalize(camera_image_point(pixel, camera)),
        0.0,
        CAMERA_FAR,
    );
}

// World position of a pixel at a linear view depth: the distance along
// forward, not along the ray.
fn camera_position_from_depth(pixel: vec2f, depth: f32, camera: Camera) -> vec3f {
    let point = camera_image_point(pixel, camera);
    return vec3f(
        camera.origin.x + point.x * depth,
        camera.origin.y + point.y * depth,
        camera.origin.z + point.z * depth,
    );
}

// World position from what a depth buffer holds, by the inverse of the
// view-projection matrix, given as its four columns. uv is (0, 0) at the upper
// left corner; depth is the buffer's value (reversed z: 1 is near). Where the
// fourth coordinate is zero (an infinite far plane) the direction is returned.
fn position_from_depth(
    uv: vec2f,
    depth: f32,
    column_x: vec4f,
    column_y: vec4f,
    column_z: vec4f,
    column_w: vec4f,
) -> vec3f {
    let x = uv.x * 2.0 - 1.0;
    let y = 1.0 - uv.y * 2.0;
    let px = ((column_x.x * x + column_y.x * y) + column_z.x * depth) + column_w.x;
    let py = ((column_x.y * x + column_y.y * y) + column_z.y * depth) + column_w.y;
    let pz = ((column_x.z * x + column_y.z * y) + column_z.z * depth) + column_w.z;
    let pw = ((column_x.w * x + column_y.w * y) + column_z.w * depth) + column_w.w;
    let w = select(pw, 1.0, pw == 0.0);
    return vec3f(px / w, py / w, pz / w);
}
