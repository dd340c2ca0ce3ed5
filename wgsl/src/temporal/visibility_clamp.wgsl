// Shadow history held to the mean of 17 x 17 shadow rays, and as wide about it
// as those rays differ: the wide form of temporal/variance_clamp (FidelityFX
// Denoiser 1.x). The callbacks are those of filter/packed_visibility.

// Deviations to either side of the mean that FidelityFX allows.
const VISIBILITY_CLAMP_GAMMA: f32 = 0.5;
// Largest magnitude of a history; what is larger is a defect.
const VISIBILITY_CLAMP_LARGEST: f32 = 1e15;

// A visibility held to gamma deviations about the mean of its neighbourhood,
// and to [0, 1]. Inside, exactly the history. Where all rays agree exactly the
// mean, 0 or 1, as for a history that is no number.
fn visibility_clamp_limit(history: f32, mean: f32, variance: f32, gamma: f32) -> f32 {
    if (bitcast<u32>(history) & 0x7fffffffu) > bitcast<u32>(VISIBILITY_CLAMP_LARGEST) {
        return mean;
    }
    let reach = gamma * sqrt(variance);
    let low = max(mean - reach, 0.0);
    let high = min(mean + reach, 1.0);
    return min(max(history, low), high);
}

// As visibility_clamp_limit, from sum rays that reached the light among area.
fn visibility_clamp_counted(history: f32, sum: u32, area: u32, gamma: f32) -> f32 {
    return visibility_clamp_limit(
        history,
        packed_visibility_mean(sum, area),
        packed_visibility_variance(sum, area),
        gamma,
    );
}

// A pixel's visibility history held to the 17 x 17 rays around it, from up to
// 15 words. Rays outside the image do not count; a pixel outside is lit.
fn visibility_clamp_pixel(pixel: vec2u, size: vec2u, history: f32, gamma: f32) -> f32 {
    let sum = packed_visibility_sum(pixel, size);
    return visibility_clamp_counted(history, sum, packed_visibility_area(pixel, size), gamma);
}

// The same as second of two passes, from up to 17 rows' sums.
fn visibility_clamp_rows_pixel(pixel: vec2u, size: vec2u, history: f32, gamma: f32) -> f32 {
    let sum = packed_visibility_vertical(pixel, size);
    return visibility_clamp_counted(history, sum, packed_visibility_area(pixel, size), gamma);
}
