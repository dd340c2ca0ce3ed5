// filter/firefly over an image, with any of its ready bindings.

struct FireflyPass {
    size: vec2u,
    // 0: cap, 1: rank filter, 2: clamp by deviation.
    kind: u32,
    gamma: f32,
}

@group(2) @binding(86) var<uniform> firefly_pass: FireflyPass;

// The colours without lone bright pixels; w is 1.
@compute @workgroup_size(8, 8)
fn firefly_pass_main(@builtin(global_invocation_id) id: vec3u) {
    let size = firefly_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    var color = vec3f(0.0, 0.0, 0.0);
    if firefly_pass.kind == 0u {
        color = firefly_cap_pixel(id.xy, size);
    } else if firefly_pass.kind == 1u {
        color = firefly_rank_pixel(id.xy, size);
    } else {
        color = firefly_clamp_pixel(id.xy, size, firefly_pass.gamma);
    }
    firefly_write(id.xy, vec4f(color, 1.0));
}
