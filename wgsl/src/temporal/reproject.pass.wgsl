// temporal/reproject over an image, with any of its ready bindings: the history
// of surfaces, and of what mirrors show.

struct ReprojectPass {
    camera: Camera,
    prior_camera: Camera,
    // In a uniform a structure takes whole 16 bytes.
    @size(16) tolerance: ReprojectTolerance,
    size: vec2u,
    // Not 0: surfaces may bend, and are expected to.
    curved: u32,
    // Not 0: a motion's z counts, as surfaces may move.
    moving: u32,
    // Not 0: of mirrors, the surface's history and that of the hit point,
    // blended by how well each agrees with this frame.
    blend: u32,
}

@group(2) @binding(105) var<uniform> reproject_pass: ReprojectPass;

// A pixel's history at a motion; place is where its surface was.
fn reproject_pass_history(
    pixel: vec2u,
    surface: ReprojectSurface,
    motion: vec2f,
    place: vec3f,
) -> ReprojectHistory {
    let size = reproject_pass.size;
    var curvature = 0.0;
    if reproject_pass.curved != 0u && (motion.x != 0.0 || motion.y != 0.0) && reproject_near(motion) {
        let bend = reproject_bend(pixel, size, motion);
        curvature = reproject_curvature(bend.along, bend.turn);
    }
    var expected = surface;
    if surface.depth > 0.0 {
        expected = ReprojectSurface(
            place,
            vec3_length(place - reproject_pass.prior_camera.origin),
            surface.normal,
            surface.mesh,
        );
    }
    return reproject_pixel(pixel, size, motion, expected, curvature, reproject_pass.tolerance);
}

// Where a pixel's surface was in the frame before.
fn reproject_pass_place(pixel: vec2u, surface: ReprojectSurface, motion: vec3f) -> vec3f {
    if reproject_pass.moving == 0u || surface.depth <= 0.0 || !reproject_near(motion.xy) {
        return surface.position;
    }
    let camera = reproject_pass.camera;
    let depth = vec3_dot(surface.position - camera.origin, camera.forward);
    let then = vec2f((f32(pixel.x) + 0.5) + motion.x, (f32(pixel.y) + 0.5) + motion.y);
    return camera_position_from_depth(then, depth + motion.z, reproject_pass.prior_camera);
}

// The history of each pixel's surface, with its length in w.
@compute @workgroup_size(8, 8)
fn reproject_pass_surface(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= reproject_pass.size.x || id.y >= reproject_pass.size.y {
        return;
    }
    let surface = reproject_read_surface(id.xy);
    let motion = reproject_read_motion(id.xy);
    let place = reproject_pass_place(id.xy, surface, motion);
    let found = reproject_pass_history(id.xy, surface, motion.xy, place);
    reproject_write(id.xy, vec4f(found.value, found.length));
}

// The history of what each pixel's surface mirrors, with its length in w.
@compute @workgroup_size(8, 8)
fn reproject_pass_reflection(@builtin(global_invocation_id) id: vec3u) {
    let size = reproject_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    let surface = reproject_read_surface(id.xy);
    let motion = reproject_reflection_motion(
        id.xy,
        size,
        reproject_read_distance(id.xy),
        reproject_pass.camera,
        reproject_pass.prior_camera,
    );
    var found = reproject_pass_history(id.xy, surface, motion, surface.position);
    if reproject_pass.blend != 0u {
        let own_motion = reproject_read_motion(id.xy);
        let own = reproject_pass_history(
            id.xy, surface, own_motion.xy, reproject_pass_place(id.xy, surface, own_motion),
        );
        // What 5 x 5 pixels of this frame show.
        var seen = VARIANCE_CLAMP_EMPTY;
        let low = max(id.xy, vec2u(2u, 2u)) - vec2u(2u, 2u);
        let high = min(id.xy + vec2u(2u, 2u), size - vec2u(1u, 1u));
        for (var y = low.y; y <= high.y; y++) {
            for (var x = low.x; x <= high.x; x++) {
                seen = variance_clamp_add(seen, variance_clamp_read(vec2u(x, y)), 0u);
            }
        }
        let deviation = sqrt(seen.spread / max(seen.count, 1.0));
        let share = reproject_share(
            reproject_color_distance(own.value, seen.mean, deviation),
            reproject_color_distance(found.value, seen.mean, deviation),
        );
        found = reproject_blend(own, found, share);
    }
    reproject_write(id.xy, vec4f(found.value, found.length));
}
