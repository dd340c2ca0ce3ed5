// Unit vectors as two numbers: the octahedral map (Cigolle et al., JCGT 3(2), 2014).

// 1/32767.
const OCTAHEDRAL_SNORM: f32 = 3.0518509e-5;

// Maps a direction (not zero, components below 1e37) to the square [-1, 1]^2.
fn octahedral_encode(n: vec3f) -> vec2f {
    let sum = (abs(n.x) + abs(n.y)) + abs(n.z);
    let x = n.x / sum;
    let y = n.y / sum;
    if n.z >= 0.0 {
        return vec2f(x, y);
    }
    // Fold the lower half outward; a zero folds to the positive side.
    let fold_x = 1.0 - abs(y);
    let fold_y = 1.0 - abs(x);
    return vec2f(
        select(-fold_x, fold_x, x >= 0.0),
        select(-fold_y, fold_y, y >= 0.0),
    );
}

// Maps a point of the square [-1, 1]^2 back to the unit vector.
fn octahedral_decode(p: vec2f) -> vec3f {
    let z = 1.0 - (abs(p.x) + abs(p.y));
    let t = max(-z, 0.0);
    return vec3_normalize(vec3f(
        p.x + select(t, -t, p.x >= 0.0),
        p.y + select(t, -t, p.y >= 0.0),
        z,
    ));
}

// octahedral_decode of two 16-bit snorms, x in the low half: of
// pack2x16snorm(octahedral_encode(n)).
fn octahedral_unpack(bits: u32) -> vec3f {
    let x = (f32((bits & 0xffffu) ^ 0x8000u) - 32768.0) * OCTAHEDRAL_SNORM;
    let y = (f32((bits >> 16u) ^ 0x8000u) - 32768.0) * OCTAHEDRAL_SNORM;
    return octahedral_decode(vec2f(clamp(x, -1.0, 1.0), clamp(y, -1.0, 1.0)));
}
