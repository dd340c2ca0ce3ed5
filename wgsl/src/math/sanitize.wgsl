// Keeping NaN and infinity out of buffers, by bit pattern: WGSL lets an
// implementation assume that they do not occur, and drivers fold x != x to
// false. A test on the bits survives.

// 1 if the bits are those of a finite f32, else 0 (NaN or infinity).
fn finite_bits(bits: u32) -> u32 {
    return select(0u, 1u, (bits & 0x7f800000u) != 0x7f800000u);
}

// The number behind bits, or fallback if that is NaN or infinite.
fn sanitize_bits(bits: u32, fallback: f32) -> f32 {
    if finite_bits(bits) == 0u {
        return fallback;
    }
    return bitcast<f32>(bits);
}

// x, or fallback if x is NaN or infinite.
fn sanitize_finite(x: f32, fallback: f32) -> f32 {
    return sanitize_bits(bitcast<u32>(x), fallback);
}

// v, or fallback if any component of v is NaN or infinite.
fn sanitize_vector(v: vec3f, fallback: vec3f) -> vec3f {
    let bits = bitcast<vec3u>(v);
    if (finite_bits(bits.x) & finite_bits(bits.y) & finite_bits(bits.z)) == 0u {
        return fallback;
    }
    return v;
}
