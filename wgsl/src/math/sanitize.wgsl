// Keeping NaN and infinity out of buffers, by bit pattern: WGSL lets an
// implementation assume that they do not occur, and drivers fold x != x to
// false. A test on the bits survives.

// Bits of 2^60, from where on usable_surface takes a number for none: what is
// below it, squared and summed, stays finite.
const USABLE_BITS: u32 = 0x5d800000u;

// Bits of 2, from where on it takes a normal for none.
const USABLE_NORMAL_BITS: u32 = 0x40000000u;

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

// The bits of the component that is largest in size, without its sign: ordered
// like the sizes, infinity above all numbers, NaN above infinity.
fn magnitude_bits(v: vec3f) -> u32 {
    let x = bitcast<u32>(v.x) & 0x7fffffffu;
    let y = bitcast<u32>(v.y) & 0x7fffffffu;
    let z = bitcast<u32>(v.z) & 0x7fffffffu;
    return max(max(x, y), z);
}

// 1 if a pixel has a surface whose numbers are ones, else 0: the position below
// 2^60 in size, the normal below 2, and scale (a depth, a reach, a weight; 0
// says that there is no surface) above 0 and below 2^60.
fn usable_surface(position: vec3f, normal: vec3f, scale: f32) -> u32 {
    let bits = bitcast<u32>(scale);
    return select(0u, 1u, magnitude_bits(position) < USABLE_BITS)
        & select(0u, 1u, magnitude_bits(normal) < USABLE_NORMAL_BITS)
        & select(0u, 1u, bits > 0u)
        & select(0u, 1u, bits < USABLE_BITS);
}
