// The multiscale mean estimator: an average that is long while the signal is
// still and short while it moves.
//
// multiscale_mean_step and _rgb_step are the listing of Ray Tracing Gems (2019),
// chapter 25, with its constants and in its order.
// multiscale_mean_robust_step and _robust_rgb_step keep the idea and mend what
// breaks: thresholds are fractions of the signal, what the clamp against
// fireflies cuts off is averaged on its own, the weight of a sample does not
// depend on the sample, its least value is one over the frames since the signal
// moved, the first sample is the first answer, and what is no number is left
// out. The functions for numbers are those for colours over one channel.

// The chapter's blend of the short average.
const MULTISCALE_MEAN_SHORT_BLEND: f32 = 0.08;
// Frames after which the robust form forgets, at most.
const MULTISCALE_MEAN_LONGEST: f32 = 256.0;
// Largest magnitude of a sample, or of an average, in the robust form.
const MULTISCALE_MEAN_LARGEST: f32 = 1e15;
// Largest variance in a state of the robust form.
const MULTISCALE_MEAN_LARGEST_VARIANCE: f32 = 4e30;
// Largest count of frames in a state of the robust form.
const MULTISCALE_MEAN_LARGEST_COUNT: f32 = 16777216.0;
// What is smaller counts as 0 in the robust form, 2^-100.
const MULTISCALE_MEAN_TINY: f32 = 7.8886091e-31;
// Part of the signal that counts as a deviation where the variance is 0.
const MULTISCALE_MEAN_FLOOR: f32 = 0.00390625;
// Standard errors that the averages may be apart and count as still.
const MULTISCALE_MEAN_CALM: f32 = 2.125;
// How fast the weight grows beyond that.
const MULTISCALE_MEAN_EAGER: f32 = 0.34375;
// The smallest normal number: a smaller variance is 0.
const MULTISCALE_MEAN_LEAST: f32 = 1.1754944e-38;

// What the printed estimator knows of a number; the chapter starts from zeros.
struct MultiscaleMeanState {
    // The answer.
    mean: f32,
    // The short average.
    short_mean: f32,
    // What the variance leaves of the blend, smoothed.
    vbbr: f32,
    // Variance about the short average.
    variance: f32,
    // How far apart both averages are, in deviations, smoothed.
    inconsistency: f32,
}

// What the printed estimator knows of a colour.
struct MultiscaleMeanRgbState {
    mean: vec3f,
    short_mean: vec3f,
    vbbr: f32,
    variance: vec3f,
    inconsistency: f32,
}

// What the robust estimator knows of a number; multiscale_mean_robust_value is
// its answer.
struct MultiscaleMeanRobustState {
    // Average of the samples as far as they are no fireflies.
    mean: f32,
    // The short average of the same.
    short_mean: f32,
    // Average of what was cut off.
    excess: f32,
    // Variance about the short average.
    variance: f32,
    // How far apart both averages are, in standard errors, smoothed.
    inconsistency: f32,
    // Frames in the mean: since the signal moved.
    length: f32,
    // Frames in all, as far as counted; 0 for none.
    age: f32,
}

// What the robust estimator knows of a colour.
struct MultiscaleMeanRobustRgbState {
    mean: vec3f,
    short_mean: vec3f,
    excess: vec3f,
    variance: vec3f,
    inconsistency: f32,
    length: f32,
    age: f32,
}

// A colour's state in 40 bytes; zeros are none.
struct MultiscaleMeanRobustRgbPacked {
    // Bits of the mean.
    mean_x: u32,
    mean_y: u32,
    mean_z: u32,
    // What was cut off; in x the age too.
    excess_x: u32,
    excess_y: u32,
    excess_z: u32,
    // From the mean to the short one, and the variance.
    spread_x: u32,
    spread_y: u32,
    spread_z: u32,
    // Inconsistency and length.
    counts: u32,
}

const MULTISCALE_MEAN_EMPTY: MultiscaleMeanState =
    MultiscaleMeanState(0.0, 0.0, 0.0, 0.0, 0.0);
const MULTISCALE_MEAN_RGB_EMPTY: MultiscaleMeanRgbState =
    MultiscaleMeanRgbState(vec3f(0.0), vec3f(0.0), 0.0, vec3f(0.0), 0.0);
const MULTISCALE_MEAN_ROBUST_EMPTY: MultiscaleMeanRobustState =
    MultiscaleMeanRobustState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
const MULTISCALE_MEAN_ROBUST_RGB_EMPTY: MultiscaleMeanRobustRgbState =
    MultiscaleMeanRobustRgbState(
        vec3f(0.0), vec3f(0.0), vec3f(0.0), vec3f(0.0), 0.0, 0.0, 0.0,
    );

// smoothstep(0, 1, x).
fn multiscale_mean_smooth(x: f32) -> f32 {
    let t = clamp(x, 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

// The printed weight of a sample before it is reduced by the variance, in
// [1/256, 1]. relative is how far apart the averages are, in deviations;
// inconsistency the same, smoothed.
fn multiscale_mean_blend(relative: f32, inconsistency: f32) -> f32 {
    let lead = max(inconsistency - 0.2, 0.02);
    return clamp(multiscale_mean_smooth(relative * lead), 0.00390625, 1.0);
}

// The robust form's weight of a sample while the signal moves, in [0, 1].
// relative is how far apart the averages are, in standard errors of that
// distance; inconsistency the same, smoothed; reduction in [1/32, 1].
fn multiscale_mean_robust_blend(relative: f32, inconsistency: f32, reduction: f32) -> f32 {
    let lead = max(inconsistency - MULTISCALE_MEAN_CALM, 0.0);
    return multiscale_mean_smooth(MULTISCALE_MEAN_EAGER * relative * lead) * reduction;
}

// Whether value is a number of at most this magnitude, by its bits.
fn multiscale_mean_usable(value: f32, largest: f32) -> bool {
    return (bitcast<u32>(value) & 0x7fffffffu) <= bitcast<u32>(largest);
}

fn multiscale_mean_rgb_usable(value: vec3f, largest: f32) -> bool {
    let size = bitcast<vec3u>(value) & vec3u(0x7fffffffu);
    return max(max(size.x, size.y), size.z) <= bitcast<u32>(largest);
}

// One number for all channels: the chapter's luma.
fn multiscale_mean_luma(value: f32) -> f32 {
    return value;
}

fn multiscale_mean_rgb_luma(value: vec3f) -> f32 {
    return 0.299 * value.x + 0.587 * value.y + 0.114 * value.z;
}

// From one toward the other, never beyond either; what is below least is 0.
fn multiscale_mean_toward(a: f32, b: f32, t: f32, least: f32) -> f32 {
    let moved = min(max(a + (b - a) * t, min(a, b)), max(a, b));
    return select(moved, 0.0, abs(moved) < least);
}

fn multiscale_mean_rgb_toward(a: vec3f, b: vec3f, t: f32, least: f32) -> vec3f {
    return vec3f(
        multiscale_mean_toward(a.x, b.x, t, least),
        multiscale_mean_toward(a.y, b.y, t, least),
        multiscale_mean_toward(a.z, b.z, t, least),
    );
}

// The upper half of an f32 (8 bits of significand), rounded to nearest, ties to
// even; what is below 2^-100 is 0. x is finite and below 2^127.
fn multiscale_mean_upper_half(x: f32) -> u32 {
    let bits = bitcast<u32>(x);
    if (bits & 0x7fffffffu) < bitcast<u32>(MULTISCALE_MEAN_TINY) {
        return 0u;
    }
    return (bits + 0x7fffu + ((bits >> 16u) & 1u)) >> 16u;
}

fn multiscale_mean_pair(low: f32, high: f32) -> u32 {
    return multiscale_mean_upper_half(low) | (multiscale_mean_upper_half(high) << 16u);
}

fn multiscale_mean_low(word: u32) -> f32 {
    return bitcast<f32>(word << 16u);
}

fn multiscale_mean_high(word: u32) -> f32 {
    return bitcast<f32>(word & 0xffff0000u);
}

// COLOR: begin
// The chapter's listing, line by line.
fn multiscale_mean_rgb_step(
    state: MultiscaleMeanRgbState,
    sample: vec3f,
    short_blend: f32,
) -> MultiscaleMeanRgbState {
    // Fireflies.
    let early = sqrt(max(state.variance, vec3f(1e-5)));
    let high = vec3f(0.1) + state.short_mean + early * 8.0;
    let overflow = max(sample - high, vec3f(0.0));
    let y = sample - overflow;
    // Short-term mean and variance.
    let delta = y - state.short_mean;
    let short_mean = state.short_mean + delta * short_blend;
    let delta_after = y - short_mean;
    let variance = state.variance
        + (delta * delta_after - state.variance) * (short_blend * 0.5);
    let root = sqrt(max(variance, vec3f(1e-5)));
    let deviation = max(root, vec3f(1e-5));
    // How far the long-term mean lags behind.
    let short_diff = state.mean - short_mean;
    let relative = multiscale_mean_rgb_luma(abs(short_diff) / deviation);
    let inconsistency = state.inconsistency + (relative - state.inconsistency) * 0.08;
    let reduction = clamp(
        multiscale_mean_rgb_luma(short_mean * 0.5 / deviation), 0.03125, 1.0,
    );
    // The reduction of the frame before.
    let blend = multiscale_mean_blend(relative, inconsistency) * state.vbbr;
    let vbbr = state.vbbr + (reduction - state.vbbr) * 0.1;
    let mean = state.mean + (y - state.mean) * clamp(blend, 0.0, 1.0);
    return MultiscaleMeanRgbState(mean, short_mean, vbbr, variance, inconsistency);
}

// The state as it may be used: none if a member is NaN, infinite or too large.
fn multiscale_mean_robust_rgb_guard(
    state: MultiscaleMeanRobustRgbState,
) -> MultiscaleMeanRobustRgbState {
    let values = multiscale_mean_rgb_usable(state.mean, MULTISCALE_MEAN_LARGEST)
        & multiscale_mean_rgb_usable(state.short_mean, MULTISCALE_MEAN_LARGEST)
        & multiscale_mean_rgb_usable(state.excess, MULTISCALE_MEAN_LARGEST)
        & multiscale_mean_rgb_usable(state.variance, MULTISCALE_MEAN_LARGEST_VARIANCE);
    let numbers = multiscale_mean_usable(state.inconsistency, MULTISCALE_MEAN_LARGEST_COUNT)
        & multiscale_mean_usable(state.length, MULTISCALE_MEAN_LARGEST_COUNT)
        & multiscale_mean_usable(state.age, MULTISCALE_MEAN_LARGEST_COUNT);
    if !(values & numbers) {
        return MULTISCALE_MEAN_ROBUST_RGB_EMPTY;
    }
    return MultiscaleMeanRobustRgbState(
        state.mean,
        state.short_mean,
        max(state.excess, vec3f(0.0)),
        max(state.variance, vec3f(0.0)),
        max(state.inconsistency, 0.0),
        max(state.length, 0.0),
        max(state.age, 0.0),
    );
}

// The robust estimator with a frame's sample added. short_blend in (0, 1];
// longest >= 1 is the longest memory in frames.
fn multiscale_mean_robust_rgb_step(
    state: MultiscaleMeanRobustRgbState,
    sample: vec3f,
    short_blend: f32,
    longest: f32,
) -> MultiscaleMeanRobustRgbState {
    let kept = multiscale_mean_robust_rgb_guard(state);
    if !multiscale_mean_rgb_usable(sample, MULTISCALE_MEAN_LARGEST) {
        return kept;
    }
    if kept.age < 1.0 {
        return MultiscaleMeanRobustRgbState(
            sample, sample, vec3f(0.0), vec3f(0.0), 0.0, 1.0, 1.0,
        );
    }
    // What is known before the sample decides how much it weighs.
    let size = max(abs(kept.mean), abs(kept.short_mean));
    let deviation = max(sqrt(kept.variance), size * MULTISCALE_MEAN_FLOOR);
    let divisor = max(deviation, vec3f(MULTISCALE_MEAN_TINY));
    // The variances of both averages over that of the samples; half of the
    // mean's, for the newest samples are in both.
    let of_short = short_blend / (2.0 - short_blend);
    let of_mean = 0.5 / (2.0 * max(kept.length, 1.0) - 1.0);
    let spread = sqrt(of_short + of_mean);
    let apart = abs(kept.mean - kept.short_mean);
    let relative = multiscale_mean_rgb_luma(apart / divisor) / spread;
    let inconsistency = multiscale_mean_toward(
        kept.inconsistency, relative, short_blend, MULTISCALE_MEAN_LEAST,
    );
    let level = max(abs(kept.short_mean), vec3f(MULTISCALE_MEAN_TINY));
    let reduction = clamp(multiscale_mean_rgb_luma(level * 0.5 / divisor), 0.03125, 1.0);
    let catch_up = multiscale_mean_robust_blend(relative, inconsistency, reduction);
    let cap = max(longest, 1.0);
    var length = min(kept.length + 1.0, cap);
    let age = min(kept.age + 1.0, cap);
    let even = 1.0 / length;
    let young = 1.0 / age;
    let blend = max(catch_up, even);
    if catch_up > even {
        length = 1.0 / catch_up;
    }
    // Fireflies: cut off, but kept.
    let whole = kept.short_mean + kept.excess;
    let high = whole + (abs(whole) * 0.1 + deviation * 8.0);
    let clipped = min(sample, high);
    let short = max(short_blend, young);
    let delta = clipped - kept.short_mean;
    let spread_now = delta * delta * (1.0 - short);
    return MultiscaleMeanRobustRgbState(
        multiscale_mean_rgb_toward(kept.mean, clipped, blend, MULTISCALE_MEAN_TINY),
        multiscale_mean_rgb_toward(kept.short_mean, clipped, short, MULTISCALE_MEAN_TINY),
        multiscale_mean_rgb_toward(kept.excess, sample - clipped, young, MULTISCALE_MEAN_TINY),
        multiscale_mean_rgb_toward(
            kept.variance, spread_now, max(short_blend * 0.5, young), MULTISCALE_MEAN_LEAST,
        ),
        inconsistency,
        length,
        age,
    );
}

// The robust estimator's answer: the mean with what was cut off.
fn multiscale_mean_robust_rgb_value(state: MultiscaleMeanRobustRgbState) -> vec3f {
    return state.mean + state.excess;
}
// COLOR: end

// SCALAR: begin
// The chapter's listing, line by line.
fn multiscale_mean_step(
    state: MultiscaleMeanState,
    sample: f32,
    short_blend: f32,
) -> MultiscaleMeanState {
    // Fireflies.
    let early = sqrt(max(state.variance, f32(1e-5)));
    let high = f32(0.1) + state.short_mean + early * 8.0;
    let overflow = max(sample - high, f32(0.0));
    let y = sample - overflow;
    // Short-term mean and variance.
    let delta = y - state.short_mean;
    let short_mean = state.short_mean + delta * short_blend;
    let delta_after = y - short_mean;
    let variance = state.variance
        + (delta * delta_after - state.variance) * (short_blend * 0.5);
    let root = sqrt(max(variance, f32(1e-5)));
    let deviation = max(root, f32(1e-5));
    // How far the long-term mean lags behind.
    let short_diff = state.mean - short_mean;
    let relative = multiscale_mean_luma(abs(short_diff) / deviation);
    let inconsistency = state.inconsistency + (relative - state.inconsistency) * 0.08;
    let reduction = clamp(
        multiscale_mean_luma(short_mean * 0.5 / deviation), 0.03125, 1.0,
    );
    // The reduction of the frame before.
    let blend = multiscale_mean_blend(relative, inconsistency) * state.vbbr;
    let vbbr = state.vbbr + (reduction - state.vbbr) * 0.1;
    let mean = state.mean + (y - state.mean) * clamp(blend, 0.0, 1.0);
    return MultiscaleMeanState(mean, short_mean, vbbr, variance, inconsistency);
}

// The state as it may be used: none if a member is NaN, infinite or too large.
fn multiscale_mean_robust_guard(
    state: MultiscaleMeanRobustState,
) -> MultiscaleMeanRobustState {
    let values = multiscale_mean_usable(state.mean, MULTISCALE_MEAN_LARGEST)
        & multiscale_mean_usable(state.short_mean, MULTISCALE_MEAN_LARGEST)
        & multiscale_mean_usable(state.excess, MULTISCALE_MEAN_LARGEST)
        & multiscale_mean_usable(state.variance, MULTISCALE_MEAN_LARGEST_VARIANCE);
    let numbers = multiscale_mean_usable(state.inconsistency, MULTISCALE_MEAN_LARGEST_COUNT)
        & multiscale_mean_usable(state.length, MULTISCALE_MEAN_LARGEST_COUNT)
        & multiscale_mean_usable(state.age, MULTISCALE_MEAN_LARGEST_COUNT);
    if !(values & numbers) {
        return MULTISCALE_MEAN_ROBUST_EMPTY;
    }
    return MultiscaleMeanRobustState(
        state.mean,
        state.short_mean,
        max(state.excess, f32(0.0)),
        max(state.variance, f32(0.0)),
        max(state.inconsistency, 0.0),
        max(state.length, 0.0),
        max(state.age, 0.0),
    );
}

// The robust estimator with a frame's sample added. short_blend in (0, 1];
// longest >= 1 is the longest memory in frames.
fn multiscale_mean_robust_step(
    state: MultiscaleMeanRobustState,
    sample: f32,
    short_blend: f32,
    longest: f32,
) -> MultiscaleMeanRobustState {
    let kept = multiscale_mean_robust_guard(state);
    if !multiscale_mean_usable(sample, MULTISCALE_MEAN_LARGEST) {
        return kept;
    }
    if kept.age < 1.0 {
        return MultiscaleMeanRobustState(
            sample, sample, f32(0.0), f32(0.0), 0.0, 1.0, 1.0,
        );
    }
    // What is known before the sample decides how much it weighs.
    let size = max(abs(kept.mean), abs(kept.short_mean));
    let deviation = max(sqrt(kept.variance), size * MULTISCALE_MEAN_FLOOR);
    let divisor = max(deviation, f32(MULTISCALE_MEAN_TINY));
    // The variances of both averages over that of the samples; half of the
    // mean's, for the newest samples are in both.
    let of_short = short_blend / (2.0 - short_blend);
    let of_mean = 0.5 / (2.0 * max(kept.length, 1.0) - 1.0);
    let spread = sqrt(of_short + of_mean);
    let apart = abs(kept.mean - kept.short_mean);
    let relative = multiscale_mean_luma(apart / divisor) / spread;
    let inconsistency = multiscale_mean_toward(
        kept.inconsistency, relative, short_blend, MULTISCALE_MEAN_LEAST,
    );
    let level = max(abs(kept.short_mean), f32(MULTISCALE_MEAN_TINY));
    let reduction = clamp(multiscale_mean_luma(level * 0.5 / divisor), 0.03125, 1.0);
    let catch_up = multiscale_mean_robust_blend(relative, inconsistency, reduction);
    let cap = max(longest, 1.0);
    var length = min(kept.length + 1.0, cap);
    let age = min(kept.age + 1.0, cap);
    let even = 1.0 / length;
    let young = 1.0 / age;
    let blend = max(catch_up, even);
    if catch_up > even {
        length = 1.0 / catch_up;
    }
    // Fireflies: cut off, but kept.
    let whole = kept.short_mean + kept.excess;
    let high = whole + (abs(whole) * 0.1 + deviation * 8.0);
    let clipped = min(sample, high);
    let short = max(short_blend, young);
    let delta = clipped - kept.short_mean;
    let spread_now = delta * delta * (1.0 - short);
    return MultiscaleMeanRobustState(
        multiscale_mean_toward(kept.mean, clipped, blend, MULTISCALE_MEAN_TINY),
        multiscale_mean_toward(kept.short_mean, clipped, short, MULTISCALE_MEAN_TINY),
        multiscale_mean_toward(kept.excess, sample - clipped, young, MULTISCALE_MEAN_TINY),
        multiscale_mean_toward(
            kept.variance, spread_now, max(short_blend * 0.5, young), MULTISCALE_MEAN_LEAST,
        ),
        inconsistency,
        length,
        age,
    );
}

// The robust estimator's answer: the mean with what was cut off.
fn multiscale_mean_robust_value(state: MultiscaleMeanRobustState) -> f32 {
    return state.mean + state.excess;
}
// SCALAR: end

// The upper 24 bits of a number's bits, rounded to nearest, ties to even, with a
// count of at most 255 below them.
fn multiscale_mean_with_count(x: f32, count: f32) -> u32 {
    let bits = bitcast<u32>(x);
    return ((bits + 0x7fu + ((bits >> 8u) & 1u)) & 0xffffff00u) | u32(min(count, 255.0));
}

fn multiscale_mean_without_count(word: u32) -> f32 {
    return bitcast<f32>(word & 0xffffff00u);
}

fn multiscale_mean_count(word: u32) -> f32 {
    return f32(word & 0xffu);
}

// A state in 16 bytes of 28: the mean as it is, what was cut off in 24 bits with
// the age in the 8 below, all else as upper halves, the short average by its
// distance from the mean. Frames are counted to 255.
fn multiscale_mean_robust_pack(state: MultiscaleMeanRobustState) -> vec4u {
    let s = multiscale_mean_robust_guard(state);
    return vec4u(
        bitcast<u32>(s.mean),
        multiscale_mean_with_count(s.excess, s.age),
        multiscale_mean_pair(s.short_mean - s.mean, s.variance),
        multiscale_mean_pair(s.inconsistency, s.length),
    );
}

// The state behind multiscale_mean_robust_pack's words.
fn multiscale_mean_robust_unpack(words: vec4u) -> MultiscaleMeanRobustState {
    let mean = bitcast<f32>(words.x);
    return MultiscaleMeanRobustState(
        mean,
        mean + multiscale_mean_low(words.z),
        multiscale_mean_without_count(words.y),
        multiscale_mean_high(words.z),
        multiscale_mean_low(words.w),
        multiscale_mean_high(words.w),
        multiscale_mean_count(words.y),
    );
}

// As multiscale_mean_robust_pack, for a colour: 40 bytes of 60.
fn multiscale_mean_robust_rgb_pack(
    state: MultiscaleMeanRobustRgbState,
) -> MultiscaleMeanRobustRgbPacked {
    let s = multiscale_mean_robust_rgb_guard(state);
    let away = s.short_mean - s.mean;
    return MultiscaleMeanRobustRgbPacked(
        bitcast<u32>(s.mean.x),
        bitcast<u32>(s.mean.y),
        bitcast<u32>(s.mean.z),
        multiscale_mean_with_count(s.excess.x, s.age),
        multiscale_mean_with_count(s.excess.y, 0.0),
        multiscale_mean_with_count(s.excess.z, 0.0),
        multiscale_mean_pair(away.x, s.variance.x),
        multiscale_mean_pair(away.y, s.variance.y),
        multiscale_mean_pair(away.z, s.variance.z),
        multiscale_mean_pair(s.inconsistency, s.length),
    );
}

// As multiscale_mean_robust_unpack, for a colour.
fn multiscale_mean_robust_rgb_unpack(
    words: MultiscaleMeanRobustRgbPacked,
) -> MultiscaleMeanRobustRgbState {
    let mean = vec3f(
        bitcast<f32>(words.mean_x), bitcast<f32>(words.mean_y), bitcast<f32>(words.mean_z),
    );
    let away = vec3f(
        multiscale_mean_low(words.spread_x),
        multiscale_mean_low(words.spread_y),
        multiscale_mean_low(words.spread_z),
    );
    return MultiscaleMeanRobustRgbState(
        mean,
        mean + away,
        vec3f(
            multiscale_mean_without_count(words.excess_x),
            multiscale_mean_without_count(words.excess_y),
            multiscale_mean_without_count(words.excess_z),
        ),
        vec3f(
            multiscale_mean_high(words.spread_x),
            multiscale_mean_high(words.spread_y),
            multiscale_mean_high(words.spread_z),
        ),
        multiscale_mean_low(words.counts),
        multiscale_mean_high(words.counts),
        multiscale_mean_count(words.excess_x),
    );
}
