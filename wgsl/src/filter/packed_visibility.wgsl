// 32 shadow rays in one word, and their mean over 17 x 17 pixels.
//
// One word holds a block of 8 x 4 pixels: bit 8 y + x is set if the ray of the
// pixel (x, y) of the block reached the light. Pixels outside the image count
// nowhere, whatever the unused bits of a block hold.
//
// The program defines
//   fn packed_visibility_read(block: vec2u) -> u32
//   fn packed_visibility_read_row(pixel: vec2u) -> u32

// How far the neighbourhood reaches in each direction.
const PACKED_VISIBILITY_REACH: u32 = 8u;

// Whether each of a block's rays reached the light.
struct PackedVisibilityRays {
    // At 8 y + x the ray of the pixel (x, y) of the block: 0 if something is in
    // its way.
    visible: array<u32, 32>,
}

// The block that holds a pixel.
fn packed_visibility_block(pixel: vec2u) -> vec2u {
    return vec2u(pixel.x >> 3u, pixel.y >> 2u);
}

// A pixel's bit in its block's word; only the lowest bits of local count.
fn packed_visibility_bit(local: vec2u) -> u32 {
    return 1u << (((local.y & 3u) << 3u) | (local.x & 7u));
}

// A block's word.
fn packed_visibility_pack(rays: PackedVisibilityRays) -> u32 {
    var copy = rays;
    var word = 0u;
    for (var i = 0u; i < 32u; i++) {
        if copy.visible[i] != 0u {
            word |= 1u << i;
        }
    }
    return word;
}

// 1 if the pixel's ray reached the light, else 0.
fn packed_visibility_unpack(word: u32, local: vec2u) -> u32 {
    return (word >> (((local.y & 3u) << 3u) | (local.x & 7u))) & 1u;
}

// The bits of those pixels of a block that lie in the rectangle from low to
// high, both included, in pixels of the image. block.x below 2^29, block.y
// below 2^30.
fn packed_visibility_window(block: vec2u, low: vec2u, high: vec2u) -> u32 {
    let start = vec2u(block.x << 3u, block.y << 2u);
    let end = vec2u(start.x + 7u, start.y + 3u);
    if low.x > end.x || low.y > end.y || high.x < start.x || high.y < start.y {
        return 0u;
    }
    if low.x > high.x || low.y > high.y {
        return 0u;
    }
    let x0 = max(low.x, start.x) & 7u;
    let y0 = max(low.y, start.y) & 3u;
    let x1 = min(high.x, end.x) & 7u;
    let y1 = min(high.y, end.y) & 3u;
    let row = (0xffu << x0) & (0xffu >> (7u - x1));
    let rows = (0xffffffffu << (y0 << 3u)) & (0xffffffffu >> ((3u - y1) << 3u));
    return (row * 0x01010101u) & rows;
}

// How many rays of a block reached the light, of those in window.
fn packed_visibility_count(word: u32, window: u32) -> u32 {
    return countOneBits(word & window);
}

// How many rays reached the light in the rectangle from low to high, both
// included; 0 if one is beyond the other.
fn packed_visibility_rectangle(low: vec2u, high: vec2u) -> u32 {
    let first = packed_visibility_block(low);
    let last = packed_visibility_block(high);
    var sum = 0u;
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            let block = vec2u(x, y);
            let window = packed_visibility_window(block, low, high);
            if window != 0u {
                sum += packed_visibility_count(packed_visibility_read(block), window);
            }
        }
    }
    return sum;
}

// The first pixel of the neighbourhood.
fn packed_visibility_low(pixel: vec2u) -> vec2u {
    return vec2u(
        pixel.x - min(pixel.x, PACKED_VISIBILITY_REACH),
        pixel.y - min(pixel.y, PACKED_VISIBILITY_REACH),
    );
}

// The last pixel of the neighbourhood; pixel lies inside size.
fn packed_visibility_high(pixel: vec2u, size: vec2u) -> vec2u {
    return vec2u(
        pixel.x + min(size.x - 1u - pixel.x, PACKED_VISIBILITY_REACH),
        pixel.y + min(size.y - 1u - pixel.y, PACKED_VISIBILITY_REACH),
    );
}

// How many pixels of the image lie in the neighbourhood of a pixel: 289 away
// from the borders, 81 in a corner, 0 for a pixel outside.
fn packed_visibility_area(pixel: vec2u, size: vec2u) -> u32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0u;
    }
    let low = packed_visibility_low(pixel);
    let high = packed_visibility_high(pixel, size);
    return (high.x - low.x + 1u) * (high.y - low.y + 1u);
}

// First of two passes: how many rays reached the light in the pixel's row, 8
// pixels to either side. From three words at most; 0 outside the image.
fn packed_visibility_horizontal(pixel: vec2u, size: vec2u) -> u32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0u;
    }
    let low = packed_visibility_low(pixel);
    let high = packed_visibility_high(pixel, size);
    return packed_visibility_rectangle(vec2u(low.x, pixel.y), vec2u(high.x, pixel.y));
}

// Second of two passes: the sum of the rows' sums, 8 pixels up and down; 0
// outside the image.
fn packed_visibility_vertical(pixel: vec2u, size: vec2u) -> u32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0u;
    }
    let low = packed_visibility_low(pixel);
    let high = packed_visibility_high(pixel, size);
    var sum = 0u;
    for (var y = low.y; y <= high.y; y++) {
        sum += packed_visibility_read_row(vec2u(pixel.x, y));
    }
    return sum;
}

// The same sum in one pass, without an image of rows: from 15 words at most.
fn packed_visibility_sum(pixel: vec2u, size: vec2u) -> u32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0u;
    }
    let low = packed_visibility_low(pixel);
    let high = packed_visibility_high(pixel, size);
    return packed_visibility_rectangle(low, high);
}

// The mean of area rays of which sum reached the light, area <= 4096; without
// rays 1, lit. Exactly 0 if none did and exactly 1 if all did.
fn packed_visibility_mean(sum: u32, area: u32) -> f32 {
    if sum >= area {
        return 1.0;
    }
    return f32(sum) / f32(area);
}

// The variance of one ray among area of which sum reached the light,
// p (1 - p); area <= 4096. Exactly 0 where all agree, at most 1/4.
fn packed_visibility_variance(sum: u32, area: u32) -> f32 {
    if sum >= area {
        return 0.0;
    }
    return f32(sum * (area - sum)) / f32(area * area);
}
