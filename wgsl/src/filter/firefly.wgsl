// Lone bright pixels cut down: a cap at the largest of the eight neighbours, a
// rank filter that also lifts to the smallest of them, and a clamp at the mean
// of the 24 around plus some standard deviations. Channel by channel.
//
// The program defines
//   fn firefly_read(at: vec2u) -> vec3f

// Largest value of a channel; larger ones count as this.
const FIREFLY_MAX: f32 = 1e8;

// The smallest and the largest of some neighbours, channel by channel.
struct FireflyRange {
    low: vec3f,
    high: vec3f,
    count: u32,
}

// Mean and spread of some neighbours, channel by channel.
struct FireflyStats {
    mean: vec3f,
    // Sum of the squared distances from the mean.
    spread: vec3f,
    count: u32,
}

// No neighbours.
const FIREFLY_RANGE_EMPTY = FireflyRange(vec3f(1e8, 1e8, 1e8), vec3f(0.0, 0.0, 0.0), 0u);
const FIREFLY_STATS_EMPTY = FireflyStats(vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 0.0), 0u);

// A colour to reckon with, or -1 for one that is not finite or negative.
fn firefly_clean(color: vec3f) -> vec3f {
    let c = sanitize_vector(color, vec3f(-1.0, -1.0, -1.0));
    if c.x < 0.0 || c.y < 0.0 || c.z < 0.0 {
        return vec3f(-1.0, -1.0, -1.0);
    }
    return vec3f(min(c.x, FIREFLY_MAX), min(c.y, FIREFLY_MAX), min(c.z, FIREFLY_MAX));
}

// Mean of count equal numbers old and another, never outside the two.
fn firefly_mean(old: f32, count: f32, new_value: f32) -> f32 {
    let mean = (old * count + new_value) / (count + 1.0);
    return min(max(mean, min(old, new_value)), max(old, new_value));
}

// Takes a neighbour into the range; channels in [0, FIREFLY_MAX].
fn firefly_range_add(range: FireflyRange, color: vec3f) -> FireflyRange {
    return FireflyRange(
        vec3f(min(range.low.x, color.x), min(range.low.y, color.y), min(range.low.z, color.z)),
        vec3f(max(range.high.x, color.x), max(range.high.y, color.y), max(range.high.z, color.z)),
        range.count + 1u,
    );
}

// The colour, at most as large as the largest neighbour; without neighbours
// the colour itself.
fn firefly_cap(color: vec3f, range: FireflyRange) -> vec3f {
    if range.count == 0u {
        return color;
    }
    return vec3f(
        min(color.x, range.high.x),
        min(color.y, range.high.y),
        min(color.z, range.high.z),
    );
}

// The colour, neither larger than the largest neighbour nor smaller than the
// smallest; without neighbours the colour itself.
fn firefly_rank(color: vec3f, range: FireflyRange) -> vec3f {
    if range.count == 0u {
        return color;
    }
    return vec3f(
        max(min(color.x, range.high.x), range.low.x),
        max(min(color.y, range.high.y), range.low.y),
        max(min(color.z, range.high.z), range.low.z),
    );
}

// Takes a neighbour into the statistics; channels in [0, FIREFLY_MAX]. Equal
// neighbours keep their exact mean and a spread of 0.
fn firefly_stats_add(stats: FireflyStats, color: vec3f) -> FireflyStats {
    // Not divided by one, which need not be exact.
    if stats.count == 0u {
        return FireflyStats(color, vec3f(0.0, 0.0, 0.0), 1u);
    }
    let n = f32(stats.count);
    let old = stats.mean;
    let share = n / (n + 1.0);
    let x = color.x - old.x;
    let y = color.y - old.y;
    let z = color.z - old.z;
    return FireflyStats(
        vec3f(
            firefly_mean(old.x, n, color.x),
            firefly_mean(old.y, n, color.y),
            firefly_mean(old.z, n, color.z),
        ),
        vec3f(
            stats.spread.x + share * (x * x),
            stats.spread.y + share * (y * y),
            stats.spread.z + share * (z * z),
        ),
        stats.count + 1u,
    );
}

// The mean plus gamma >= 0 standard deviations; without neighbours
// FIREFLY_MAX.
fn firefly_limit(stats: FireflyStats, gamma: f32) -> vec3f {
    if stats.count == 0u {
        return vec3f(FIREFLY_MAX, FIREFLY_MAX, FIREFLY_MAX);
    }
    let n = f32(stats.count);
    return vec3f(
        stats.mean.x + gamma * sqrt(stats.spread.x / n),
        stats.mean.y + gamma * sqrt(stats.spread.y / n),
        stats.mean.z + gamma * sqrt(stats.spread.z / n),
    );
}

// The range of the 3 x 3 pixels around a pixel inside the image, itself left
// out, and colours with a negative channel, an infinity or a NaN too.
fn firefly_range(pixel: vec2u, size: vec2u) -> FireflyRange {
    var range = FIREFLY_RANGE_EMPTY;
    if pixel.x >= size.x || pixel.y >= size.y {
        return range;
    }
    for (var y = max(pixel.y, 1u) - 1u; y <= min(pixel.y + 1u, size.y - 1u); y++) {
        for (var x = max(pixel.x, 1u) - 1u; x <= min(pixel.x + 1u, size.x - 1u); x++) {
            if x != pixel.x || y != pixel.y {
                let color = firefly_clean(firefly_read(vec2u(x, y)));
                if color.x >= 0.0 {
                    range = firefly_range_add(range, color);
                }
            }
        }
    }
    return range;
}

// The statistics of the 5 x 5 pixels around a pixel inside the image, with the
// same left out.
fn firefly_stats(pixel: vec2u, size: vec2u) -> FireflyStats {
    var stats = FIREFLY_STATS_EMPTY;
    if pixel.x >= size.x || pixel.y >= size.y {
        return stats;
    }
    for (var y = max(pixel.y, 2u) - 2u; y <= min(pixel.y + 2u, size.y - 1u); y++) {
        for (var x = max(pixel.x, 2u) - 2u; x <= min(pixel.x + 2u, size.x - 1u); x++) {
            if x != pixel.x || y != pixel.y {
                let color = firefly_clean(firefly_read(vec2u(x, y)));
                if color.x >= 0.0 {
                    stats = firefly_stats_add(stats, color);
                }
            }
        }
    }
    return stats;
}

// A pixel under the cap. One that is negative or not finite becomes the
// smallest of its neighbours; black outside the image or if none of them is
// usable either.
fn firefly_cap_pixel(pixel: vec2u, size: vec2u) -> vec3f {
    if pixel.x >= size.x || pixel.y >= size.y {
        return vec3f(0.0, 0.0, 0.0);
    }
    let range = firefly_range(pixel, size);
    let color = firefly_clean(firefly_read(pixel));
    if color.x >= 0.0 {
        return firefly_cap(color, range);
    }
    if range.count == 0u {
        return vec3f(0.0, 0.0, 0.0);
    }
    return range.low;
}

// A pixel under the rank filter: not below its smallest neighbour either.
fn firefly_rank_pixel(pixel: vec2u, size: vec2u) -> vec3f {
    if pixel.x >= size.x || pixel.y >= size.y {
        return vec3f(0.0, 0.0, 0.0);
    }
    let range = firefly_range(pixel, size);
    let color = firefly_clean(firefly_read(pixel));
    if color.x >= 0.0 {
        return firefly_rank(color, range);
    }
    if range.count == 0u {
        return vec3f(0.0, 0.0, 0.0);
    }
    return range.low;
}

// A pixel under the clamp: at most the mean of the 24 pixels around it plus
// gamma of their standard deviations. One that is negative or not finite
// becomes their mean.
fn firefly_clamp_pixel(pixel: vec2u, size: vec2u, gamma: f32) -> vec3f {
    if pixel.x >= size.x || pixel.y >= size.y {
        return vec3f(0.0, 0.0, 0.0);
    }
    let stats = firefly_stats(pixel, size);
    let color = firefly_clean(firefly_read(pixel));
    if color.x < 0.0 {
        return stats.mean;
    }
    let limit = firefly_limit(stats, gamma);
    return vec3f(min(color.x, limit.x), min(color.y, limit.y), min(color.z, limit.z));
}
