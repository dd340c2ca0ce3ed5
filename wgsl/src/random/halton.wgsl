// Halton points, aligned to pixels, with exact integer digits. Pixel-aligned
// index after Gruenschloss, Raab and Keller (2012) as in Ray Tracing Gems,
// chapter 25, section 25.5; rotation: Cranley and Patterson 1976.

// Bases of the first 32 dimensions.
const HALTON_PRIMES = array<u32, 32>(
    2u, 3u, 5u, 7u, 11u, 13u, 17u, 19u, 23u, 29u, 31u, 37u, 41u, 43u, 47u, 53u,
    59u, 61u, 67u, 71u, 73u, 79u, 83u, 89u, 97u, 101u, 103u, 107u, 109u, 113u,
    127u, 131u,
);
// Tile over which halton_index enumerates pixels: 2^8 by 3^6.
const HALTON_TILE_WIDTH: u32 = 256u;
const HALTON_TILE_HEIGHT: u32 = 729u;
// Distance between the indices of successive samples of one pixel.
const HALTON_STRIDE: u32 = 186624u;
// Samples of one pixel whose indices all fit 32 bits; then they repeat.
const HALTON_PERIOD: u32 = 23014u;

// Where one pixel is in its sequence.
struct HaltonState {
    dimension: u32,
    index: u32,
}

// What one draw gives: the state for the next draw, and a value in [0, 1).
struct HaltonDraw {
    state: HaltonState,
    value: f32,
}

// The lowest `digits` binary digits of index, mirrored. digits <= 32.
fn halton_reverse_base_two(index: u32, digits: u32) -> u32 {
    if digits == 0u {
        return 0u;
    }
    return reverseBits(index) >> (32u - digits);
}

// The lowest `digits` ternary digits of index, mirrored. digits <= 20.
fn halton_reverse_base_three(index: u32, digits: u32) -> u32 {
    var n = index;
    var result = 0u;
    var digit = 0u;
    while digit < digits {
        result = result * 3u + n % 3u;
        n = n / 3u;
        digit = digit + 1u;
    }
    return result;
}

// Index of the i-th point whose first two coordinates fall into pixel (x, y)
// of the tile of 256 x 729 pixels. i counts modulo HALTON_PERIOD: one more and
// the index would pass 2^32 and belong to another pixel.
fn halton_index(x: u32, y: u32, i: u32) -> u32 {
    let column = halton_reverse_base_two(x % HALTON_TILE_WIDTH, 8u);
    let row = halton_reverse_base_three(y % HALTON_TILE_HEIGHT, 6u);
    // 76545 = 729*105 is 1 mod 256 and 0 mod 729; 110080 = 256*430 the other
    // way round (the Chinese remainder theorem).
    let offset = (column * 76545u + row * 110080u) % HALTON_STRIDE;
    return offset + (i % HALTON_PERIOD) * HALTON_STRIDE;
}

// State for path number `path` of `paths` of one pixel in one frame; the
// points repeat after frame_loop frames. Drawing starts at the third dimension.
fn halton_init(
    x: u32,
    y: u32,
    path: u32,
    paths: u32,
    frame: u32,
    frame_loop: u32,
) -> HaltonState {
    // Reduced before the product so that no frame number overflows it.
    let i = (frame % max(frame_loop, 1u)) * max(paths, 1u) + path % max(paths, 1u);
    return HaltonState(2u, halton_index(x, y, i));
}

// Base of a dimension: the primes in order. Dimensions repeat from 32 on.
fn halton_prime(dimension: u32) -> u32 {
    var primes = HALTON_PRIMES;
    return primes[dimension & 31u];
}

// Digits of index in `base` (2 to 256), mirrored at the radix point; in [0, 1).
fn halton_radical_inverse(base: u32, index: u32) -> f32 {
    if base == 2u {
        return f32(reverseBits(index) >> 8u) * (1.0 / 16777216.0);
    }
    if base < 2u {
        return 0.0;
    }
    // While base^k <= 2^24, numerator and denominator are exact in f32; the
    // digits beyond enter as an exact ratio below one.
    let limit = 16777216u / base;
    var n = index;
    var mirrored = 0u;
    var power = 1u;
    while n != 0u && power <= limit {
        mirrored = mirrored * base + n % base;
        power = power * base;
        n = n / base;
    }
    var tail = 0u;
    var tail_power = 1u;
    while n != 0u {
        tail = tail * base + n % base;
        tail_power = tail_power * base;
        n = n / base;
    }
    let u = (f32(mirrored) + f32(tail) / f32(tail_power)) / f32(power);
    // All digits at their highest can round to one.
    return min(u, 0.99999994);
}

// Coordinate `dimension` of point `index`, in [0, 1).
fn halton_sample(dimension: u32, index: u32) -> f32 {
    return halton_radical_inverse(halton_prime(dimension), index);
}

// Draws one coordinate and moves on to the next dimension.
fn halton_next(state: HaltonState) -> HaltonDraw {
    return HaltonDraw(
        HaltonState(state.dimension + 1u, state.index),
        halton_sample(state.dimension, state.index),
    );
}

// Cranley-Patterson rotation: u + shift modulo one, in [0, 1), added as 24-bit
// integers because a float sum just below one would round to one.
fn halton_rotate(u: f32, shift: f32) -> f32 {
    let a = u32(u * 16777216.0);
    let b = u32(shift * 16777216.0);
    return f32((a + b) & 0x00ffffffu) * (1.0 / 16777216.0);
}
