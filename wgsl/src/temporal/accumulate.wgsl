// A running mean over frames, with its variance: an average while the history
// is short, an exponential average once it has reached its cap (Schied et al.
// 2017, section 4.1; West 1979 for the update about the mean).

// Largest magnitude of a sample or a mean; what is larger is a defect.
const TEMPORAL_ACCUMULATE_LARGEST: f32 = 1e15;
// Largest variance that such numbers have, rounding included.
const TEMPORAL_ACCUMULATE_LARGEST_VARIANCE: f32 = 4e30;
// Largest history length: beyond it f32 cannot count by one.
const TEMPORAL_ACCUMULATE_LONGEST: f32 = 16777216.0;

// What is known of a scalar.
struct TemporalAccumulateState {
    // Mean of the history.
    mean: f32,
    // Mean squared distance from the mean, >= 0.
    variance: f32,
    // Frames in the history, at most the cap; 0 for none.
    history: f32,
}

// What is known of a colour.
struct TemporalAccumulateRgbState {
    // Mean colour; a filter may feed its own result back here.
    color: vec3f,
    // Mean luminance, as samples came in.
    mean_luminance: f32,
    // Mean squared distance of the luminance from its mean, >= 0.
    variance: f32,
    // Frames in the history, at most the larger cap; 0 for none.
    history: f32,
}

// No history.
const TEMPORAL_ACCUMULATE_EMPTY: TemporalAccumulateState =
    TemporalAccumulateState(0.0, 0.0, 0.0);
// No history of a colour.
const TEMPORAL_ACCUMULATE_RGB_EMPTY: TemporalAccumulateRgbState =
    TemporalAccumulateRgbState(vec3f(0.0, 0.0, 0.0), 0.0, 0.0, 0.0);

// 1 if the magnitude of value is at most largest, a finite number >= 0; 0 if it
// is larger, infinite or NaN. Compares bit patterns, which nothing folds away.
fn temporal_accumulate_usable(value: f32, largest: f32) -> u32 {
    return select(0u, 1u, (bitcast<u32>(value) & 0x7fffffffu) <= bitcast<u32>(largest));
}

// Frames in the history once a new one is added: history + 1, at most cap, at
// least 1. A history below 1 counts as 0.
fn temporal_accumulate_history(history: f32, cap: f32) -> f32 {
    if history < 1.0 {
        return 1.0;
    }
    return min(history + 1.0, max(cap, 1.0));
}

// Weight of the newest of history frames: 1/history, at least 1/cap. The first
// frame's is a constant: 1.0/1.0 may be less than 1.
fn temporal_accumulate_alpha(history: f32, cap: f32) -> f32 {
    let length = min(history, cap);
    if length <= 1.0 {
        return 1.0;
    }
    return 1.0 / length;
}

// The mean with a sample of weight alpha in [0, 1] added, never outside the
// two. At alpha 1 the sample, whatever the mean was.
fn temporal_accumulate_mean(mean: f32, sample: f32, alpha: f32) -> f32 {
    if alpha >= 1.0 {
        return sample;
    }
    let away = sample - mean;
    var moved = mean + alpha * away;
    if alpha > 0.5 {
        moved = sample - (1.0 - alpha) * away;
    }
    return min(max(moved, min(mean, sample)), max(mean, sample));
}

// The variance with a sample of weight alpha in [0, 1] added, which lies
// difference away from the mean before it: (1 - a)(v + a d^2).
fn temporal_accumulate_variance(variance: f32, difference: f32, alpha: f32) -> f32 {
    if alpha >= 1.0 {
        return 0.0;
    }
    return (1.0 - alpha) * (variance + alpha * (difference * difference));
}

// The history as it may be used: empty if a member is NaN, infinite or too
// large, and a negative variance or length as 0.
fn temporal_accumulate_guard(state: TemporalAccumulateState) -> TemporalAccumulateState {
    let usable = temporal_accumulate_usable(state.mean, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(state.variance, TEMPORAL_ACCUMULATE_LARGEST_VARIANCE)
        & temporal_accumulate_usable(state.history, TEMPORAL_ACCUMULATE_LONGEST);
    if usable == 0u {
        return TEMPORAL_ACCUMULATE_EMPTY;
    }
    return TemporalAccumulateState(
        state.mean, max(state.variance, 0.0), max(state.history, 0.0),
    );
}

// The state with a frame's sample added; cap >= 1 is the longest history. A
// sample that is no number, or too large, is left out; a history that is no
// number counts as none.
fn temporal_accumulate_step(
    state: TemporalAccumulateState,
    sample: f32,
    cap: f32,
) -> TemporalAccumulateState {
    let kept = temporal_accumulate_guard(state);
    if temporal_accumulate_usable(sample, TEMPORAL_ACCUMULATE_LARGEST) == 0u {
        return kept;
    }
    let history = temporal_accumulate_history(kept.history, cap);
    let alpha = temporal_accumulate_alpha(history, cap);
    let away = sample - kept.mean;
    return TemporalAccumulateState(
        temporal_accumulate_mean(kept.mean, sample, alpha),
        temporal_accumulate_variance(kept.variance, away, alpha),
        history,
    );
}

// As temporal_accumulate_guard, for a colour.
fn temporal_accumulate_rgb_guard(
    state: TemporalAccumulateRgbState,
) -> TemporalAccumulateRgbState {
    let color = temporal_accumulate_usable(state.color.x, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(state.color.y, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(state.color.z, TEMPORAL_ACCUMULATE_LARGEST);
    let moments = temporal_accumulate_usable(state.mean_luminance, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(state.variance, TEMPORAL_ACCUMULATE_LARGEST_VARIANCE)
        & temporal_accumulate_usable(state.history, TEMPORAL_ACCUMULATE_LONGEST);
    if (color & moments) == 0u {
        return TEMPORAL_ACCUMULATE_RGB_EMPTY;
    }
    return TemporalAccumulateRgbState(
        state.color, state.mean_luminance, max(state.variance, 0.0), max(state.history, 0.0),
    );
}

// The state with a frame's colour added: cap for the colour, moments_cap for
// the moments of its luminance, both >= 1.
fn temporal_accumulate_rgb_step(
    state: TemporalAccumulateRgbState,
    sample: vec3f,
    cap: f32,
    moments_cap: f32,
) -> TemporalAccumulateRgbState {
    let kept = temporal_accumulate_rgb_guard(state);
    let usable = temporal_accumulate_usable(sample.x, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(sample.y, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(sample.z, TEMPORAL_ACCUMULATE_LARGEST);
    if usable == 0u {
        return kept;
    }
    let history = temporal_accumulate_history(kept.history, max(cap, moments_cap));
    let alpha = temporal_accumulate_alpha(history, cap);
    let moments_alpha = temporal_accumulate_alpha(history, moments_cap);
    let light = luminance(sample);
    let away = light - kept.mean_luminance;
    return TemporalAccumulateRgbState(
        vec3f(
            temporal_accumulate_mean(kept.color.x, sample.x, alpha),
            temporal_accumulate_mean(kept.color.y, sample.y, alpha),
            temporal_accumulate_mean(kept.color.z, sample.z, alpha),
        ),
        temporal_accumulate_mean(kept.mean_luminance, light, moments_alpha),
        temporal_accumulate_variance(kept.variance, away, moments_alpha),
        history,
    );
}

// Sum of the squared weights of all samples in a history, with one of weight
// alpha added; start from 1.
fn temporal_accumulate_squares(squares: f32, alpha: f32) -> f32 {
    let keep = 1.0 - alpha;
    return (keep * keep) * squares + alpha * alpha;
}

// The unbiased variance of one sample, from the variance of a history and its
// squares: v/(1 - s). 0 where squares is 1 or more.
fn temporal_accumulate_unbiased(variance: f32, squares: f32) -> f32 {
    if squares >= 1.0 {
        return 0.0;
    }
    return variance / (1.0 - squares);
}

// Plain moments (mean of the values, mean of their squares) with a sample of
// weight alpha added. What others use, to compare with.
fn temporal_accumulate_plain_moments(moments: vec2f, sample: f32, alpha: f32) -> vec2f {
    return vec2f(
        temporal_accumulate_mean(moments.x, sample, alpha),
        temporal_accumulate_mean(moments.y, sample * sample, alpha),
    );
}

// The variance behind plain moments. It cancels.
fn temporal_accumulate_plain_variance(moments: vec2f) -> f32 {
    return max(moments.y - moments.x * moments.x, 0.0);
}
