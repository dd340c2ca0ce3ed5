// What the passes of temporal/accumulate ask for, over storage buffers. A
// colour's sample takes a vec4f (the last is free); its state two, in two
// buffers: the colour and the history's length, the luminance's mean and
// variance, 0 and the length again. A scalar's sample takes an f32, its state a
// vec4f: mean, variance, 0, length. layout.x is the image's width.

@group(2) @binding(109) var<storage, read> temporal_accumulate_samples: array<vec4f>;
@group(2) @binding(110) var<storage, read> temporal_accumulate_colors: array<vec4f>;
@group(2) @binding(111) var<storage, read> temporal_accumulate_moments: array<vec4f>;
@group(2) @binding(112) var<storage, read_write> temporal_accumulate_new_colors: array<vec4f>;
@group(2) @binding(113) var<storage, read_write> temporal_accumulate_new_moments: array<vec4f>;
@group(2) @binding(114) var<uniform> temporal_accumulate_layout: vec4u;
@group(2) @binding(116) var<storage, read> temporal_accumulate_scalars: array<f32>;

// Outside the buffer: black.
fn temporal_accumulate_read_sample(at: vec2u) -> vec3f {
    let index = at.y * temporal_accumulate_layout.x + at.x;
    if index >= arrayLength(&temporal_accumulate_samples) {
        return vec3f(0.0, 0.0, 0.0);
    }
    return temporal_accumulate_samples[index].xyz;
}

// Outside the buffer: 0.
fn temporal_accumulate_read_scalar(at: vec2u) -> f32 {
    let index = at.y * temporal_accumulate_layout.x + at.x;
    if index >= arrayLength(&temporal_accumulate_scalars) {
        return 0.0;
    }
    return temporal_accumulate_scalars[index];
}

// Outside the buffer: no history.
fn temporal_accumulate_read_color(at: vec2u) -> vec4f {
    let index = at.y * temporal_accumulate_layout.x + at.x;
    if index >= arrayLength(&temporal_accumulate_colors) {
        return vec4f(0.0, 0.0, 0.0, 0.0);
    }
    return temporal_accumulate_colors[index];
}

// Outside the buffer: no history.
fn temporal_accumulate_read_moments(at: vec2u) -> vec4f {
    let index = at.y * temporal_accumulate_layout.x + at.x;
    if index >= arrayLength(&temporal_accumulate_moments) {
        return vec4f(0.0, 0.0, 0.0, 0.0);
    }
    return temporal_accumulate_moments[index];
}

fn temporal_accumulate_write_color(at: vec2u, color: vec4f) {
    let index = at.y * temporal_accumulate_layout.x + at.x;
    if index < arrayLength(&temporal_accumulate_new_colors) {
        temporal_accumulate_new_colors[index] = color;
    }
}

fn temporal_accumulate_write_moments(at: vec2u, moments: vec4f) {
    let index = at.y * temporal_accumulate_layout.x + at.x;
    if index < arrayLength(&temporal_accumulate_new_moments) {
        temporal_accumulate_new_moments[index] = moments;
    }
}
