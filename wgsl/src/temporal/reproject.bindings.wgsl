// What temporal/reproject asks for, over storage buffers, with three channels:
// for a scalar (or two channels) declare your own alias and history instead.
//
// All are vec4u with the bits of floats: a mesh's number is none, and loading
// one as a float could flush it to 0. A surface takes two: position and depth,
// normal and mesh. A history takes one: value and length. layout.x is the
// image's width.

alias ReprojectValue = vec3f;

@group(2) @binding(33) var<storage, read> reproject_surfaces: array<vec4u>;
@group(2) @binding(34) var<storage, read> reproject_priors: array<vec4u>;
@group(2) @binding(35) var<storage, read> reproject_histories: array<vec4u>;
@group(2) @binding(36) var<uniform> reproject_layout: vec4u;

// The surface of a pixel. Outside the buffer: none.
fn reproject_read_surface(at: vec2u) -> ReprojectSurface {
    let index = at.y * reproject_layout.x + at.x;
    if index >= arrayLength(&reproject_surfaces) / 2u {
        return ReprojectSurface(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), 0u);
    }
    let place = reproject_surfaces[2u * index];
    let shape = reproject_surfaces[2u * index + 1u];
    return ReprojectSurface(
        bitcast<vec3f>(place.xyz),
        bitcast<f32>(place.w),
        bitcast<vec3f>(shape.xyz),
        shape.w,
    );
}

// The surface that the frame before had there.
fn reproject_read_prior(at: vec2u) -> ReprojectSurface {
    let index = at.y * reproject_layout.x + at.x;
    if index >= arrayLength(&reproject_priors) / 2u {
        return ReprojectSurface(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), 0u);
    }
    let place = reproject_priors[2u * index];
    let shape = reproject_priors[2u * index + 1u];
    return ReprojectSurface(
        bitcast<vec3f>(place.xyz),
        bitcast<f32>(place.w),
        bitcast<vec3f>(shape.xyz),
        shape.w,
    );
}

// The history of a pixel; none where it is not finite.
fn reproject_read_history(at: vec2u) -> ReprojectHistory {
    let index = at.y * reproject_layout.x + at.x;
    if index >= arrayLength(&reproject_histories) {
        return ReprojectHistory(vec3f(0.0, 0.0, 0.0), 0.0);
    }
    let texel = reproject_histories[index];
    let finite = (finite_bits(texel.x) & finite_bits(texel.y))
        & (finite_bits(texel.z) & finite_bits(texel.w));
    if finite == 0u {
        return ReprojectHistory(vec3f(0.0, 0.0, 0.0), 0.0);
    }
    return ReprojectHistory(bitcast<vec3f>(texel.xyz), bitcast<f32>(texel.w));
}

// For the passes: motions (x and y in pixels, from now to then; z the change of
// view depth, from now to then; 0), the distances from a mirror to what it
// shows, and the results.
@group(2) @binding(102) var<storage, read> reproject_motions: array<vec4f>;
@group(2) @binding(103) var<storage, read> reproject_distances: array<f32>;
@group(2) @binding(104) var<storage, read_write> reproject_results: array<vec4f>;

// Outside the buffer: none.
fn reproject_read_motion(at: vec2u) -> vec3f {
    let index = at.y * reproject_layout.x + at.x;
    if index >= arrayLength(&reproject_motions) {
        return vec3f(REPROJECT_NOWHERE, REPROJECT_NOWHERE, 0.0);
    }
    return reproject_motions[index].xyz;
}

// Outside the buffer: 0.
fn reproject_read_distance(at: vec2u) -> f32 {
    let index = at.y * reproject_layout.x + at.x;
    if index >= arrayLength(&reproject_distances) {
        return 0.0;
    }
    return reproject_distances[index];
}

fn reproject_write(at: vec2u, result: vec4f) {
    let index = at.y * reproject_layout.x + at.x;
    if index < arrayLength(&reproject_results) {
        reproject_results[index] = result;
    }
}
