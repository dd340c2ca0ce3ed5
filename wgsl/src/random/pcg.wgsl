// PCG hashes: integers in, integers out, the same bits everywhere.
// pcg2d, pcg3d, pcg4d: Jarzynski and Olano, JCGT 9(3), 2020. pcg_hash: O'Neill
// (2014), permutation RXS-M-XS.

// One word to one word, a bijection. pcg_hash(0) is 0x07bb2fe2.
fn pcg_hash(v: u32) -> u32 {
    let state = v * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Two words to two words, a bijection.
fn pcg2d(v: vec2u) -> vec2u {
    var x = v.x * 1664525u + 1013904223u;
    var y = v.y * 1664525u + 1013904223u;
    x = x + y * 1664525u;
    y = y + x * 1664525u;
    x = x ^ (x >> 16u);
    y = y ^ (y >> 16u);
    x = x + y * 1664525u;
    y = y + x * 1664525u;
    x = x ^ (x >> 16u);
    y = y ^ (y >> 16u);
    return vec2u(x, y);
}

// Three words to three words, a bijection.
fn pcg3d(v: vec3u) -> vec3u {
    var x = v.x * 1664525u + 1013904223u;
    var y = v.y * 1664525u + 1013904223u;
    var z = v.z * 1664525u + 1013904223u;
    x = x + y * z;
    y = y + z * x;
    z = z + x * y;
    x = x ^ (x >> 16u);
    y = y ^ (y >> 16u);
    z = z ^ (z >> 16u);
    x = x + y * z;
    y = y + z * x;
    z = z + x * y;
    return vec3u(x, y, z);
}

// Four words to four words, a bijection.
fn pcg4d(v: vec4u) -> vec4u {
    var x = v.x * 1664525u + 1013904223u;
    var y = v.y * 1664525u + 1013904223u;
    var z = v.z * 1664525u + 1013904223u;
    var w = v.w * 1664525u + 1013904223u;
    x = x + y * w;
    y = y + z * x;
    z = z + x * y;
    w = w + y * z;
    x = x ^ (x >> 16u);
    y = y ^ (y >> 16u);
    z = z ^ (z >> 16u);
    w = w ^ (w >> 16u);
    x = x + y * w;
    y = y + z * x;
    z = z + x * y;
    w = w + y * z;
    return vec4u(x, y, z, w);
}

// A generator's state after a draw, and what it drew.
struct PcgDraw {
    state: u32,
    value: u32,
}

// Seed for one pixel in one frame.
fn pcg_seed(pixel: vec2u, frame: u32) -> u32 {
    return pcg3d(vec3u(pixel.x, pixel.y, frame)).x;
}

// Draws 32 bits and advances the state (period 2^32).
fn pcg_next(state: u32) -> PcgDraw {
    return PcgDraw(state * 747796405u + 2891336453u, pcg_hash(state));
}

// Random bits to a number in [0, 1): the top 24 bits over 2^24, exactly.
fn pcg_unit(bits: u32) -> f32 {
    return f32(bits >> 8u) * (1.0 / 16777216.0);
}
