//! [`filter::svgf`](crate::filter::svgf) over whole images.
//!
//! [`SvgfPass`] keeps an image as planes and gives at every pixel the bits of
//! `svgf_atrous_pixel` (three channels) or `svgf_atrous_scalar_pixel` (one),
//! whose source says what is computed; here is only how:
//!
//! - Pixels are worked on in blocks of `LANES`, a tap's weight in short loops
//!   over the block, so that the processor has many independent operations at
//!   hand. Rows are padded by what the widest pass reaches, and pixels that are
//!   no data have a mask of 0: the loops have no branch, and where a block and
//!   its taps are all data they have no mask either.
//! - Rows `step` apart, which share four of five rows of taps, come one after
//!   the other: what they read stays in the second cache at any image size.
//! - A pass does not wait for the whole image: it follows the one before as soon
//!   as what it reaches is there, and finds the surfaces still in a cache.
//! - [`crate::simd`] chooses the vector instructions.

// Lanes index a dozen arrays at once.
#![allow(clippy::needless_range_loop)]

use std::sync::atomic::{AtomicBool, Ordering};

use glam::UVec2;

use super::tiles::TileMask;
use crate::filter::svgf::{
    EXPONENT_MAX, FADE, LOG2_E, NORMAL, ROUND, STEEP, SVGF_VALUE_MAX, SvgfSettings, SvgfSurface,
    TOTAL_MIN, VALUE_BITS, VARIANCE_BITS, svgf_falloff, svgf_luminance_scale,
};
use crate::filter::tiles::{TILES_NONE, tiles_atrous_reach, tiles_reach, tiles_scalar_flags};
use crate::math::sanitize::usable_surface;
use crate::simd::{self, SimdLevel};

/// Pixels that are worked on together.
const LANES: usize = 128;

/// Blocks that are worked on before the next row.
const STRIP: usize = 16;

/// Rows that follow each other, `step` apart.
const BAND: usize = 16;

/// Rows of a pass for each thread, before the next pass follows: few enough that
/// with those that the passes lag behind they stay in the third cache.
const ROWS: usize = 32;

/// Numbers in a line of the cache.
const LINE: usize = 16;

/// Planes of a surface: position, normal, reach, and how much a distance of 1 adds
/// to an exponent, below 0 where there is no surface.
const SURFACE: usize = 8;
const REACH: usize = 6;
const STEEPNESS: usize = 7;

/// Planes that say what is data: 1 where the sample and the surface are.
const MASK: usize = 0;
/// 1 where the variance is data.
const VARIANCE_MASK: usize = 1;
/// 1 where the sample is data.
const KNOWN: usize = 2;
const MASKS: usize = 3;

/// Half of the largest variance: rounding up, sixteen passes long, does not make
/// it too large.
const LOUD_BITS: u32 = VARIANCE_BITS - (1 << 23);

type Block = [f32; LANES];

/// To begin an array with.
const EMPTY: &Block = &[0.0; LANES];
/// The mask where all is data.
const ONES: &Block = &[1.0; LANES];

/// Numbers from the start of a line of the cache on.
#[derive(Debug)]
struct Planes {
    data: Vec<f32>,
    start: usize,
    len: usize,
}

impl Planes {
    fn new(len: usize) -> Self {
        let data = vec![0.0f32; len + LINE];
        let start = data.as_ptr().align_offset(4 * LINE).min(LINE);
        Self { data, start, len }
    }

    #[inline(always)]
    fn all(&self) -> &[f32] {
        &self.data[self.start..self.start + self.len]
    }

    fn all_mut(&mut self) -> &mut [f32] {
        &mut self.data[self.start..self.start + self.len]
    }
}

impl Clone for Planes {
    fn clone(&self) -> Self {
        let mut new = Self::new(self.len);
        new.all_mut().copy_from_slice(self.all());
        new
    }
}

/// The filter for images of one size, with `C` channels: 1 (shadow, ambient
/// occlusion) or 3 (colours). Create it once.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::svgf::{SvgfSettings, SvgfSurface};
/// use raytwin_cpu::pass::svgf::SvgfPass;
///
/// // A noisy floor: 0 and 1, pixel by pixel.
/// let size = UVec2::splat(9);
/// let mut pass = SvgfPass::<1>::new(size, SvgfSettings::PAPER);
/// pass.set_surfaces(|at| SvgfSurface {
///     position: Vec3::new(at.x as f32, 0.0, at.y as f32),
///     reach: 0.1,
///     normal: Vec3::Y,
/// });
/// pass.set_image(|at| ([((at.x + at.y) % 2) as f32], 0.25));
/// pass.filter(|_| ());
/// assert!((pass.at(UVec2::splat(4)).0[0] - 0.5).abs() < 0.25);
/// ```
#[derive(Clone, Debug)]
pub struct SvgfPass<const C: usize> {
    size: UVec2,
    settings: SvgfSettings,
    level: SimdLevel,
    /// Padding on each side of a row, and a row's length with it.
    margin: usize,
    pitch: usize,
    /// By row, then by plane.
    surfaces: Planes,
    /// By row: the channels, the variance, and a colour's luminance.
    image: Planes,
    /// What a pass writes.
    next: Planes,
    masks: Planes,
    /// By row: how many pixels before a line of the cache are no data.
    gaps: Vec<u32>,
    /// Whether masks and luminance are still to be made.
    raw: bool,
    /// Whether a variance is so large that what comes of it may be no data.
    loud: bool,
    /// What [`SvgfPass::filter_tiles`] filters; without it everything is.
    tiles: Option<TileMask>,
}

/// Applies `work` to each row, in parallel with the feature `rayon`.
pub(super) fn for_rows<T: Send>(
    data: &mut [T],
    row: usize,
    work: impl Fn(usize, &mut [T]) + Sync + Send,
) {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        data.par_chunks_mut(row)
            .enumerate()
            .for_each(|(y, row)| work(y, row));
    }
    #[cfg(not(feature = "rayon"))]
    for (y, row) in data.chunks_mut(row).enumerate() {
        work(y, row);
    }
}

/// How many rows can be worked on at a time.
fn threads() -> usize {
    #[cfg(feature = "rayon")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "rayon"))]
    1
}

/// Rows and their numbers.
type Rows<'a> = Vec<(usize, &'a mut [f32])>;

/// Applies `work` to groups of rows that are `step` apart, in parallel with the
/// feature `rayon`. The first row's number is `first`.
fn for_bands(
    data: &mut [f32],
    row: usize,
    first: usize,
    step: usize,
    work: impl Fn(Rows<'_>) + Sync + Send,
) {
    let rows = data.len() / row;
    let mut bands: Vec<Rows<'_>> = Vec::new();
    bands.resize_with(rows.div_ceil(step * BAND) * step, Vec::new);
    for (i, row) in data.chunks_mut(row).enumerate() {
        bands[i / (step * BAND) * step + i % step].push((first + i, row));
    }
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        bands.into_par_iter().for_each(work);
    }
    #[cfg(not(feature = "rayon"))]
    bands.into_iter().for_each(work);
}

/// `LANES` values from here on.
#[inline(always)]
fn block(plane: &[f32], at: usize) -> &Block {
    let part: Option<&Block> = plane[at..].first_chunk();
    part.expect("rows are padded")
}

/// The blocks of a plane at some places. A loop, since what the library calls
/// for `from_fn` is not always inlined into code for another [`SimdLevel`].
#[inline(always)]
fn blocks<const N: usize>(plane: &[f32], at: [usize; N]) -> [&Block; N] {
    let mut all = [EMPTY; N];
    for j in 0..N {
        all[j] = block(plane, at[j]);
    }
    all
}

/// The blocks of planes at one place.
#[inline(always)]
fn planes_at<const N: usize>(planes: [&[f32]; N], at: usize) -> [&Block; N] {
    let mut all = [EMPTY; N];
    for k in 0..N {
        all[k] = block(planes[k], at);
    }
    all
}

#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The kit's luminance of a colour.
#[inline(always)]
fn luminance(r: f32, g: f32, b: f32) -> f32 {
    (0.2126 * r + 0.7152 * g) + 0.0722 * b
}

/// `svgf_fade` without branches. The sum that rounds has the power of two in its
/// last bits.
#[inline(always)]
fn fade(exponent: f32) -> f32 {
    let rounded = ROUND - exponent;
    let f = exponent + (rounded - ROUND);
    let p = 1.0 + f * (FADE[0] + f * (FADE[1] + f * (FADE[2] + f * (FADE[3] + f * FADE[4]))));
    let scaled = f32::from_bits(p.to_bits().wrapping_add(rounded.to_bits() << 23));
    if exponent > EXPONENT_MAX { 0.0 } else { scaled }
}

/// B3 spline of tap `k` of `0..=2 * radius`.
#[inline(always)]
fn spline(k: usize, radius: usize) -> f32 {
    match k.abs_diff(radius) {
        0 => 0.375,
        1 => 0.25,
        _ => 0.0625,
    }
}

/// What a block has gathered.
struct Sums<const C: usize> {
    value: [Block; C],
    low: [Block; C],
    high: [Block; C],
    variance: Block,
    total: Block,
}

/// What a block's centres are.
struct Centres<'a> {
    position: [&'a Block; 3],
    normal: [&'a Block; 3],
    luminance: &'a Block,
    /// The normal, times log2 e and the falloff with the distance.
    across: [Block; 3],
    luminance_falloff: Block,
}

/// How normals weigh.
#[derive(Clone, Copy)]
struct Normals {
    squarings: u32,
    /// `NORMAL`, times the power over 128.
    steep: [f32; 3],
}

/// Planes of a row.
#[derive(Clone, Copy)]
struct Row<'a, const C: usize> {
    position: [&'a [f32]; 3],
    normal: [&'a [f32]; 3],
    steepness: &'a [f32],
    channels: [&'a [f32]; C],
    variance: &'a [f32],
    luminance: &'a [f32],
    masks: [&'a [f32]; MASKS],
    gaps: &'a [u32],
}

impl<const C: usize> Row<'_, C> {
    /// Whether all is data from here to there, and in the lines around.
    #[inline(always)]
    fn whole(&self, from: usize, to: usize) -> bool {
        self.gaps[to.div_ceil(LINE)] == self.gaps[from / LINE]
    }
}

/// Adds taps of one row to each pixel of a block. `at` are their places in the
/// row, for the block's first pixel. `weights` and `below` are for scratch.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn add_taps<const C: usize, const N: usize, const MASKED: bool>(
    sums: &mut Sums<C>,
    weights: &mut [Block; N],
    below: &mut [Block; N],
    centre: &Centres<'_>,
    normals: Normals,
    row: &Row<'_, C>,
    at: [usize; N],
    splines: [f32; N],
) {
    let (mut positions, mut others) = ([[EMPTY; 3]; N], [[EMPTY; 3]; N]);
    for j in 0..N {
        positions[j] = planes_at(row.position, at[j]);
        others[j] = planes_at(row.normal, at[j]);
    }
    let luminances = blocks(row.luminance, at);
    let [cx, cy, cz] = centre.position;
    let [ux, uy, uz] = &centre.across;
    for l in 0..LANES {
        for j in 0..N {
            let [px, py, pz] = positions[j];
            let (tx, ty, tz) = (px[l] - cx[l], py[l] - cy[l], pz[l] - cz[l]);
            let plane = ((ux[l] * tx + uy[l] * ty) + uz[l] * tz).abs();
            let apart =
                (luminances[j][l] - centre.luminance[l]).abs() * centre.luminance_falloff[l];
            weights[j][l] = plane + apart;
        }
    }
    let [nx, ny, nz] = centre.normal;
    let [a, b, c] = normals.steep;
    if normals.squarings < STEEP {
        for l in 0..LANES {
            for j in 0..N {
                let [px, py, pz] = others[j];
                let (dx, dy, dz) = (px[l] - nx[l], py[l] - ny[l], pz[l] - nz[l]);
                below[j][l] = least(0.5 * ((dx * dx + dy * dy) + dz * dz), 1.0);
            }
        }
        for _ in 0..normals.squarings {
            for j in 0..N {
                for y in &mut below[j] {
                    *y = *y * (2.0 - *y);
                }
            }
        }
        for j in 0..N {
            for l in 0..LANES {
                weights[j][l] = (1.0 - below[j][l]) * fade(weights[j][l]);
            }
        }
    } else {
        for l in 0..LANES {
            for j in 0..N {
                let [px, py, pz] = others[j];
                let (dx, dy, dz) = (px[l] - nx[l], py[l] - ny[l], pz[l] - nz[l]);
                let d = (dx * dx + dy * dy) + dz * dz;
                weights[j][l] += d * (a + d * (b + d * c));
            }
        }
        for j in 0..N {
            for w in &mut weights[j] {
                *w = fade(*w);
            }
        }
    }
    add_weighed::<C, N, MASKED>(sums, weights, row, at, splines);
}

/// Adds taps whose weights are known but for the spline.
#[inline(always)]
fn add_weighed<const C: usize, const N: usize, const MASKED: bool>(
    sums: &mut Sums<C>,
    weights: &[Block; N],
    row: &Row<'_, C>,
    at: [usize; N],
    splines: [f32; N],
) {
    let mut values = [[EMPTY; N]; C];
    for c in 0..C {
        values[c] = blocks(row.channels[c], at);
    }
    let variances = blocks(row.variance, at);
    let masks = blocks(row.masks[MASK], at);
    for l in 0..LANES {
        let mut w = [0.0; N];
        for j in 0..N {
            w[j] = splines[j] * weights[j][l];
            if MASKED {
                w[j] *= masks[j][l];
            }
        }
        for c in 0..C {
            let (mut sum, mut low, mut high) = (sums.value[c][l], sums.low[c][l], sums.high[c][l]);
            for j in 0..N {
                let v = values[c][j][l];
                sum += v * w[j];
                // Where there is no data v is 0, and must not count.
                if MASKED {
                    let gap = (1.0 - masks[j][l]) * SVGF_VALUE_MAX;
                    low = least(low, v + gap);
                    high = most(high, v - gap);
                } else {
                    low = least(low, v);
                    high = most(high, v);
                }
            }
            (sums.value[c][l], sums.low[c][l], sums.high[c][l]) = (sum, low, high);
        }
        let (mut variance, mut total) = (sums.variance[l], sums.total[l]);
        for j in 0..N {
            variance += (w[j] * w[j]) * variances[j][l];
            total += w[j];
        }
        (sums.variance[l], sums.total[l]) = (variance, total);
    }
}

/// `svgf_gaussian_pixel` of a block, from the rows above to below.
#[inline(always)]
fn gaussian<const C: usize>(rows: &[Option<Row<'_, C>>; 3], at: usize) -> Block {
    if let [Some(above), Some(own), Some(below)] = rows
        && [above, own, below].map(|r| r.whole(at - 1, at + LANES + 1)) == [true; 3]
    {
        return gaussian_whole([above.variance, own.variance, below.variance], at);
    }
    let (mut sum, mut total): (Block, Block) = ([0.0; LANES], [0.0; LANES]);
    let (mut low, mut high): (Block, Block) = ([f32::MAX; LANES], [0.0; LANES]);
    for (k, row) in rows.iter().enumerate() {
        let Some(row) = row else { continue };
        let down = if k == 1 { 0.5 } else { 0.25 };
        let weights = [0.25 * down, 0.5 * down, 0.25 * down];
        let variances = blocks(row.variance, [at - 1, at, at + 1]);
        if row.whole(at - 1, at + LANES + 1) {
            for l in 0..LANES {
                for j in 0..3 {
                    let v = variances[j][l];
                    sum[l] += weights[j] * v;
                    total[l] += weights[j];
                    low[l] = least(low[l], v);
                    high[l] = most(high[l], v);
                }
            }
        } else {
            let masks = blocks(row.masks[VARIANCE_MASK], [at - 1, at, at + 1]);
            for l in 0..LANES {
                for j in 0..3 {
                    let (v, m) = (variances[j][l], masks[j][l]);
                    let w = weights[j] * m;
                    sum[l] += w * v;
                    total[l] += w;
                    low[l] = if m > 0.0 { least(low[l], v) } else { low[l] };
                    high[l] = most(high[l], v);
                }
            }
        }
    }
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let mean = most(least(sum[l] / total[l], high[l]), low[l]);
        out[l] = if total[l] > 0.0 { mean } else { 0.0 };
    }
    out
}

/// [`gaussian`] where all is data: the weights' sum is 1, exactly.
#[inline(always)]
fn gaussian_whole(rows: [&[f32]; 3], at: usize) -> Block {
    let mut variances = [[EMPTY; 3]; 3];
    for k in 0..3 {
        variances[k] = blocks(rows[k], [at - 1, at, at + 1]);
    }
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let (mut sum, mut low, mut high) = (0.0, f32::MAX, 0.0);
        for k in 0..3 {
            let down = if k == 1 { 0.5 } else { 0.25 };
            for j in 0..3 {
                let v = variances[k][j][l];
                sum += if j == 1 { 0.5 * down } else { 0.25 * down } * v;
                low = least(low, v);
                high = most(high, v);
            }
        }
        out[l] = most(least(sum, high), low);
    }
    out
}

/// One pass over rows that are `step` apart.
struct Gather<'a, const C: usize> {
    pass: &'a SvgfPass<C>,
    step: usize,
    rows: Rows<'a>,
    /// Set where a pixel's result is no data: a variance that rounds up out of
    /// range. No input is known that does it.
    broken: &'a AtomicBool,
}

impl<const C: usize> simd::Work for Gather<'_, C> {
    #[inline(always)]
    fn run(self) {
        if self.pass.settings.radius >= 2 {
            gather::<C, 5, 2>(self);
        } else if self.pass.settings.radius == 1 {
            gather::<C, 3, 1>(self);
        } else {
            gather::<C, 1, 0>(self);
        }
    }
}

/// `WIDE` is `2 * RADIUS + 1`.
#[inline(always)]
fn gather<const C: usize, const WIDE: usize, const RADIUS: usize>(work: Gather<'_, C>) {
    let Gather {
        pass,
        step,
        mut rows,
        broken,
    } = work;
    let width = pass.size.x as usize;
    let (mut weights, mut below) = ([[0.0; LANES]; WIDE], [[0.0; LANES]; WIDE]);
    let mut side_weights = [[0.0; LANES]; RADIUS];
    let mut side_below = [[0.0; LANES]; RADIUS];
    let squarings = pass.settings.squarings.min(16);
    let power = f32::from(1u16 << squarings.saturating_sub(STEEP));
    let normals = Normals {
        squarings,
        steep: NORMAL.map(|x| power * x),
    };
    for strip in (0..width).step_by(STRIP * LANES) {
        for (y, out) in &mut rows {
            let y = *y;
            let own = pass.planes(y);
            let mut around = [None, Some(own), None];
            around[0] = pass.row_at(y.checked_sub(1));
            around[2] = pass.row_at(y.checked_add(1));
            let mut taps = [None; WIDE];
            for k in 0..WIDE {
                taps[k] = pass.row_at((y + k * step).checked_sub(RADIUS * step));
            }
            for x in (strip..width.min(strip + STRIP * LANES)).step_by(LANES) {
                let at = pass.margin + x;
                let count = LANES.min(width - x);
                let steepness = block(own.steepness, at);
                let whole = own.whole(at, at + LANES);
                let known = if whole {
                    ONES
                } else {
                    block(own.masks[KNOWN], at)
                };
                // Neither what no pass can change nor what is nothing but sky.
                if pass.leaves_out(x, y) || !steepness.iter().any(|s| *s >= 0.0) {
                    pass.copy_block(&own, at, count, known, out);
                    continue;
                }
                let smooth = gaussian(&around, at);
                let mut centre = Centres {
                    position: planes_at(own.position, at),
                    normal: planes_at(own.normal, at),
                    luminance: block(own.luminance, at),
                    across: [[0.0; LANES]; 3],
                    luminance_falloff: [0.0; LANES],
                };
                for l in 0..LANES {
                    for k in 0..3 {
                        centre.across[k][l] = centre.normal[k][l] * steepness[l];
                    }
                    let scale = svgf_luminance_scale(
                        smooth[l],
                        centre.luminance[l],
                        pass.settings.sigma_luminance,
                    );
                    centre.luminance_falloff[l] = (LOG2_E * svgf_falloff(scale)) * known[l];
                }
                let mut sums = Sums::<C> {
                    value: [[0.0; LANES]; C],
                    low: [[SVGF_VALUE_MAX; LANES]; C],
                    high: [[-SVGF_VALUE_MAX; LANES]; C],
                    variance: [0.0; LANES],
                    total: [0.0; LANES],
                };
                for (k, row) in taps.iter().enumerate() {
                    let Some(row) = row else { continue };
                    let from = at - RADIUS * step;
                    let whole = row.whole(from, at + RADIUS * step + LANES);
                    let (mut places, mut splines) = ([0; WIDE], [0.0; WIDE]);
                    let (mut left, mut right) = ([0; RADIUS], [0; RADIUS]);
                    let (mut first, mut last) = ([0.0; RADIUS], [0.0; RADIUS]);
                    for j in 0..WIDE {
                        places[j] = from + j * step;
                        splines[j] = spline(j, RADIUS) * spline(k, RADIUS);
                    }
                    for j in 0..RADIUS {
                        (left[j], right[j]) = (places[j], places[RADIUS + 1 + j]);
                        (first[j], last[j]) = (splines[j], splines[RADIUS + 1 + j]);
                    }
                    macro_rules! add {
                        ($places:expr, $splines:expr, $weights:expr, $below:expr) => {
                            if whole {
                                add_taps::<C, _, false>(
                                    &mut sums, $weights, $below, &centre, normals, row, $places,
                                    $splines,
                                );
                            } else {
                                add_taps::<C, _, true>(
                                    &mut sums, $weights, $below, &centre, normals, row, $places,
                                    $splines,
                                );
                            }
                        };
                    }
                    if k == RADIUS {
                        // The centre weighs 1: no need to find that out.
                        add!(left, first, &mut side_weights, &mut side_below);
                        add_weighed::<C, 1, true>(
                            &mut sums,
                            &[[1.0; LANES]],
                            row,
                            [at],
                            [splines[RADIUS]],
                        );
                        add!(right, last, &mut side_weights, &mut side_below);
                    } else {
                        add!(places, splines, &mut weights, &mut below);
                    }
                }
                let mut results = [[0.0; LANES]; C];
                let own_values = planes_at(own.channels, at);
                for c in 0..C {
                    for l in 0..LANES {
                        let mean = sums.value[c][l] / sums.total[l];
                        let kept = least(most(mean, sums.low[c][l]), sums.high[c][l]);
                        let filled = if sums.total[l] < TOTAL_MIN { 0.0 } else { kept };
                        let own = own_values[c][l];
                        results[c][l] = if steepness[l] >= 0.0 { filled } else { own };
                    }
                }
                let (mut variance, mut light): (Block, Block) = ([0.0; LANES], [0.0; LANES]);
                let own_variance = block(own.variance, at);
                let mut bad = 0u32;
                for l in 0..LANES {
                    let spread = (sums.variance[l] / sums.total[l]) / sums.total[l];
                    let filled = if sums.total[l] < TOTAL_MIN {
                        0.0
                    } else {
                        spread
                    };
                    let own = own_variance[l] * known[l];
                    variance[l] = if steepness[l] >= 0.0 { filled } else { own };
                    bad |= u32::from(variance[l].to_bits() >= VARIANCE_BITS);
                }
                if C == 3 {
                    for l in 0..LANES {
                        light[l] = luminance(results[0][l], results[1][l], results[2][l]);
                    }
                }
                if bad != 0 {
                    broken.store(true, Ordering::Relaxed);
                }
                let planes = results.iter().chain([&variance]).chain([&light]);
                for (plane, values) in out.chunks_exact_mut(pass.pitch).zip(planes) {
                    plane[at..at + count].copy_from_slice(&values[..count]);
                }
            }
        }
    }
}

impl<const C: usize> SvgfPass<C> {
    /// Planes of an image: the channels, the variance, a colour's luminance.
    const IMAGE: usize = C + 1 + if C == 3 { 1 } else { 0 };
    const LUMINANCE: usize = if C == 3 { C + 1 } else { 0 };

    /// For images of this size. A colour's luminance is Rec. 709's; an image of
    /// one channel is its own. Each side is below 2^20; a pass has at most 16
    /// steps.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::svgf::SvgfSettings;
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    ///
    /// // Colours; one channel would be `SvgfPass::<1>`.
    /// let pass = SvgfPass::<3>::new(UVec2::new(640, 360), SvgfSettings::PAPER);
    /// assert_eq!(pass.size(), UVec2::new(640, 360));
    /// ```
    #[must_use]
    pub fn new(size: UVec2, settings: SvgfSettings) -> Self {
        let (width, height) = (size.x as usize, size.y as usize);
        let widest = 1usize << settings.passes.clamp(1, 16).saturating_sub(1);
        let margin = (settings.radius.min(2) as usize * widest)
            .max(1)
            .next_multiple_of(LINE);
        // An odd number of lines: planes and rows fall on different places of
        // the caches.
        let lines = (2 * margin + width.next_multiple_of(LANES)) / LINE;
        let pitch = (lines | 1) * LINE;
        let mut surfaces = Planes::new(height * SURFACE * pitch);
        for row in surfaces.all_mut().chunks_exact_mut(SURFACE * pitch) {
            row[STEEPNESS * pitch..].fill(-1.0);
        }
        Self {
            size,
            settings,
            level: SimdLevel::best(),
            margin,
            pitch,
            surfaces,
            image: Planes::new(height * Self::IMAGE * pitch),
            next: Planes::new(height * Self::IMAGE * pitch),
            masks: Planes::new(height * MASKS * pitch),
            gaps: vec![0; height * (pitch / LINE + 1)],
            raw: true,
            loud: false,
            tiles: None,
        }
    }

    /// With these vector instructions in place of the widest that the machine
    /// has. The results are the same.
    ///
    /// ```
    /// use glam::{UVec2, Vec3};
    /// use raytwin_cpu::filter::svgf::{SvgfSettings, SvgfSurface};
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    /// use raytwin_cpu::simd::SimdLevel;
    ///
    /// let size = UVec2::splat(9);
    /// let mut pass = SvgfPass::<1>::new(size, SvgfSettings::PAPER);
    /// pass.set_surfaces(|at| SvgfSurface {
    ///     position: Vec3::new(at.x as f32, 0.0, at.y as f32),
    ///     reach: 0.1,
    ///     normal: Vec3::Y,
    /// });
    /// pass.set_image(|at| ([((at.x + at.y) % 2) as f32], 0.25));
    /// // Without wide vectors: the same bits.
    /// let mut narrow = pass.clone().with_level(SimdLevel::Baseline);
    /// pass.filter(|_| ());
    /// narrow.filter(|_| ());
    /// assert_eq!(pass.row(4, 0), narrow.row(4, 0));
    /// ```
    #[must_use]
    pub fn with_level(mut self, level: SimdLevel) -> Self {
        self.level = level;
        self
    }

    /// Width and height.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::svgf::SvgfSettings;
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    ///
    /// let pass = SvgfPass::<1>::new(UVec2::new(640, 360), SvgfSettings::BLOG);
    /// assert_eq!(pass.size().x, 640);
    /// ```
    #[must_use]
    pub fn size(&self) -> UVec2 {
        self.size
    }

    /// The surfaces of a frame; what is no data counts as none.
    ///
    /// ```
    /// use glam::{UVec2, Vec3};
    /// use raytwin_cpu::filter::svgf::{SvgfSettings, SvgfSurface};
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    ///
    /// let mut pass = SvgfPass::<1>::new(UVec2::splat(9), SvgfSettings::PAPER);
    /// // A sky: no surface, so the filter changes nothing.
    /// pass.set_surfaces(|_| SvgfSurface {
    ///     position: Vec3::ZERO,
    ///     reach: 0.0,
    ///     normal: Vec3::Y,
    /// });
    /// pass.set_image(|at| ([at.x as f32], 1.0));
    /// pass.filter(|_| ());
    /// assert_eq!(pass.at(UVec2::new(5, 4)).0, [5.0]);
    /// ```
    pub fn set_surfaces(&mut self, read: impl Fn(UVec2) -> SvgfSurface + Sync + Send) {
        self.raw = true;
        let sigma = self.settings.sigma_depth;
        let (width, margin, pitch) = (self.size.x as usize, self.margin, self.pitch);
        for_rows(self.surfaces.all_mut(), SURFACE * pitch, |y, row| {
            for x in 0..width {
                let mut s = read(UVec2::new(x as u32, y as u32));
                let usable = usable_surface(s.position, s.normal, s.reach) != 0;
                if !usable {
                    s = SvgfSurface {
                        position: glam::Vec3::ZERO,
                        reach: 0.0,
                        normal: glam::Vec3::ZERO,
                    };
                }
                let planes = [
                    s.position.x,
                    s.position.y,
                    s.position.z,
                    s.normal.x,
                    s.normal.y,
                    s.normal.z,
                    s.reach,
                    if usable {
                        LOG2_E * svgf_falloff(sigma * s.reach)
                    } else {
                        -1.0
                    },
                ];
                for (k, v) in planes.into_iter().enumerate() {
                    row[k * pitch + margin + x] = v;
                }
            }
        });
    }

    /// The image to filter, and the variance of its luminance.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::svgf::SvgfSettings;
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    ///
    /// let mut pass = SvgfPass::<3>::new(UVec2::splat(9), SvgfSettings::PAPER);
    /// pass.set_image(|at| ([at.x as f32, at.y as f32, 0.0], 0.25));
    /// assert_eq!(pass.at(UVec2::new(5, 4)), ([5.0, 4.0, 0.0], 0.25));
    /// ```
    pub fn set_image(&mut self, read: impl Fn(UVec2) -> ([f32; C], f32) + Sync + Send) {
        self.raw = true;
        let (width, margin, pitch) = (self.size.x as usize, self.margin, self.pitch);
        for_rows(self.image.all_mut(), Self::IMAGE * pitch, |y, row| {
            for x in 0..width {
                let (value, variance) = read(UVec2::new(x as u32, y as u32));
                for (c, v) in value.into_iter().chain([variance]).enumerate() {
                    row[c * pitch + margin + x] = v;
                }
            }
        });
    }

    /// A row of a channel, or of the variance for `channel == C`.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::svgf::SvgfSettings;
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    ///
    /// let mut pass = SvgfPass::<1>::new(UVec2::new(3, 2), SvgfSettings::PAPER);
    /// pass.set_image(|at| ([at.x as f32], 0.25));
    /// assert_eq!(pass.row(1, 0), [0.0, 1.0, 2.0]);
    /// // After the channels comes the variance.
    /// assert_eq!(pass.row(1, 1), [0.25; 3]);
    /// ```
    ///
    /// # Panics
    /// If there is no such row or channel.
    #[must_use]
    pub fn row(&self, y: u32, channel: usize) -> &[f32] {
        assert!(channel <= C, "channel {channel} of {C} and the variance");
        let start = (y as usize * Self::IMAGE + channel) * self.pitch + self.margin;
        &self.image.all()[start..start + self.size.x as usize]
    }

    /// A pixel's value and variance.
    ///
    /// ```
    /// use glam::UVec2;
    /// use raytwin_cpu::filter::svgf::SvgfSettings;
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    ///
    /// let mut pass = SvgfPass::<1>::new(UVec2::new(3, 2), SvgfSettings::PAPER);
    /// pass.set_image(|at| ([at.x as f32], 0.25));
    /// assert_eq!(pass.at(UVec2::new(2, 1)), ([2.0], 0.25));
    /// ```
    ///
    /// # Panics
    /// If it lies outside.
    #[must_use]
    pub fn at(&self, pixel: UVec2) -> ([f32; C], f32) {
        let x = pixel.x as usize;
        (
            std::array::from_fn(|c| self.row(pixel.y, c)[x]),
            self.row(pixel.y, C)[x],
        )
    }

    /// All passes, one after the other; `feedback` sees the image after the pass
    /// whose output becomes the history.
    ///
    /// ```
    /// use glam::{UVec2, Vec3};
    /// use raytwin_cpu::filter::svgf::{SvgfSettings, SvgfSurface};
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    ///
    /// let size = UVec2::splat(9);
    /// let mut pass = SvgfPass::<1>::new(size, SvgfSettings::PAPER);
    /// pass.set_surfaces(|at| SvgfSurface {
    ///     position: Vec3::new(at.x as f32, 0.0, at.y as f32),
    ///     reach: 0.1,
    ///     normal: Vec3::Y,
    /// });
    /// pass.set_image(|at| ([((at.x + at.y) % 2) as f32], 0.25));
    /// // The first pass's output is the next frame's history.
    /// let mut history = Vec::new();
    /// pass.filter(|image| history.extend_from_slice(image.row(4, 0)));
    /// assert_eq!(history.len(), 9);
    /// assert_ne!(history, pass.row(4, 0));
    /// ```
    pub fn filter(&mut self, mut feedback: impl FnMut(&Self)) {
        let passes = self.settings.passes.min(16);
        let history = self.settings.feedback;
        let mut done = 0;
        while done < passes {
            let end = if done <= history && history < passes {
                history + 1
            } else {
                passes
            };
            if self.raw {
                self.prepare();
            }
            // What is no data changes what the next pass finds.
            let alone = self.raw || self.loud;
            let end = if alone { done + 1 } else { end };
            self.flow(done..end);
            done = end;
            if history.checked_add(1) == Some(done) {
                feedback(self);
            }
        }
    }

    /// [`Self::filter`], leaving out tiles that it cannot change: where, as far
    /// as all its passes reach, every pixel with a surface is exactly 1, or
    /// every one exactly 0, with a variance of 0, and where there is no surface.
    /// Gives the same bits, and the tiles that were to be filtered; of a row
    /// whole blocks are.
    ///
    /// ```
    /// use glam::{UVec2, Vec3};
    /// use raytwin_cpu::filter::svgf::{SvgfSettings, SvgfSurface};
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    ///
    /// let mut pass = SvgfPass::<1>::new(UVec2::new(256, 8), SvgfSettings::PAPER);
    /// pass.set_surfaces(|at| SvgfSurface {
    ///     position: Vec3::new(at.x as f32, 0.0, at.y as f32),
    ///     reach: 0.1,
    ///     normal: Vec3::Y,
    /// });
    /// // A shadow's soft edge at the left; all the rest is lit.
    /// pass.set_image(|at| ([(at.x as f32 / 16.0).min(1.0)], 0.0));
    /// let tiles = pass.filter_tiles(|_| ());
    /// assert!(tiles.is_needed(UVec2::ZERO) && !tiles.is_needed(UVec2::new(31, 0)));
    /// ```
    pub fn filter_tiles(&mut self, feedback: impl FnMut(&Self)) -> TileMask {
        let mask = self.find_tiles();
        self.tiles = Some(mask.clone());
        self.filter(feedback);
        self.tiles = None;
        mask
    }

    /// The tiles that all passes together may change.
    fn find_tiles(&self) -> TileMask {
        let pixels = tiles_atrous_reach(self.settings.radius, self.settings.passes);
        let (width, height) = (self.size.x as usize, self.size.y as usize);
        let surfaces = self.surfaces.all();
        TileMask::from_tiles(self.size, tiles_reach(pixels), |tile| {
            let x = 8 * tile.x as usize..(8 * tile.x as usize + 8).min(width);
            let mut flags = TILES_NONE;
            for y in 8 * tile.y as usize..(8 * tile.y as usize + 8).min(height) {
                let reach = &surfaces[(y * SURFACE + REACH) * self.pitch + self.margin..];
                let variance = self.row(y as u32, C);
                for c in 0..C {
                    let value = self.row(y as u32, c);
                    for x in x.clone() {
                        let surface = u32::from(reach[x] > 0.0);
                        flags |= tiles_scalar_flags(value[x], variance[x], surface);
                    }
                }
            }
            flags
        })
    }

    /// Whether none of a block's tiles is to be filtered.
    #[inline(always)]
    fn leaves_out(&self, x: usize, y: usize) -> bool {
        let Some(mask) = &self.tiles else {
            return false;
        };
        let first = UVec2::new((x / 8) as u32, (y / 8) as u32);
        !(0..LANES as u32 / 8).any(|i| mask.is_needed(first + UVec2::new(i, 0)))
    }

    /// A block that the filter would not change.
    #[inline(always)]
    fn copy_block(
        &self,
        own: &Row<'_, C>,
        at: usize,
        count: usize,
        known: &Block,
        out: &mut [f32],
    ) {
        let planes = own.channels.iter().chain([&own.variance, &own.luminance]);
        for (k, (plane, values)) in out.chunks_exact_mut(self.pitch).zip(planes).enumerate() {
            plane[at..at + count].copy_from_slice(&values[at..at + count]);
            if k == C {
                for l in 0..count {
                    plane[at + l] *= known[l];
                }
            }
        }
    }

    /// One pass, with taps `step` pixels apart, at most as far as the widest of
    /// [`Self::filter`].
    ///
    /// ```
    /// use glam::{UVec2, Vec3};
    /// use raytwin_cpu::filter::svgf::{
    ///     SvgfSample, SvgfSettings, SvgfSurface, svgf_atrous_scalar_pixel,
    /// };
    /// use raytwin_cpu::pass::svgf::SvgfPass;
    ///
    /// let size = UVec2::splat(9);
    /// let mut pass = SvgfPass::<1>::new(size, SvgfSettings::PAPER);
    /// pass.set_surfaces(|at| SvgfSurface {
    ///     position: Vec3::new(at.x as f32, 0.0, at.y as f32),
    ///     reach: 0.1,
    ///     normal: Vec3::Y,
    /// });
    /// pass.set_image(|at| ([((at.x + at.y) % 2) as f32], 0.25));
    /// pass.atrous(1);
    /// // The bits of the filter for one pixel.
    /// let surface = |at: UVec2| SvgfSurface {
    ///     position: Vec3::new(at.x as f32, 0.0, at.y as f32),
    ///     reach: 0.1,
    ///     normal: Vec3::Y,
    /// };
    /// let read = |at: UVec2| SvgfSample {
    ///     value: ((at.x + at.y) % 2) as f32,
    ///     variance: 0.25,
    /// };
    /// let pixel = svgf_atrous_scalar_pixel(
    ///     UVec2::splat(4),
    ///     size,
    ///     1,
    ///     SvgfSettings::PAPER,
    ///     surface,
    ///     read,
    /// );
    /// assert_eq!(pass.at(UVec2::splat(4)), ([pixel.value], pixel.variance));
    /// ```
    pub fn atrous(&mut self, step: u32) {
        if self.size.x == 0 || self.size.y == 0 {
            return;
        }
        if self.raw {
            self.prepare();
        }
        let step = step.min(1 << self.settings.passes.clamp(1, 16).saturating_sub(1)) as usize;
        self.atrous_rows(step, 0..self.size.y as usize);
        std::mem::swap(&mut self.image, &mut self.next);
    }

    /// Passes one behind the other: each does some rows as soon as the one before
    /// has done what they reach, while all that these rows read is still in a
    /// cache. The rows that a pass writes over are read by none any more, since
    /// no pass reaches farther than the next.
    fn flow(&mut self, passes: std::ops::Range<u32>) {
        let height = self.size.y as usize;
        if self.size.x == 0 {
            return;
        }
        let mut lag = 0;
        let passes: Vec<(usize, usize)> = passes
            .map(|i| {
                let step = 1 << i;
                // The variance's Gaussian reaches one pixel.
                lag += (self.settings.radius.min(2) as usize * step).max(1);
                (step, lag)
            })
            .collect();
        let rows = if passes.len() == 1 {
            height + lag
        } else {
            ROWS * threads()
        };
        // Each pass reads what the one before wrote, so the images change places
        // after each; after an odd number they change once more, for the next
        // rows to start from the same one.
        for front in (0..height + lag).step_by(rows) {
            for (step, lag) in &passes {
                let row = |front: usize| front.saturating_sub(*lag).min(height);
                let rows = row(front)..row(front + rows);
                if !rows.is_empty() {
                    self.atrous_rows(*step, rows);
                }
                std::mem::swap(&mut self.image, &mut self.next);
            }
            if passes.len() % 2 == 1 {
                std::mem::swap(&mut self.image, &mut self.next);
            }
        }
        if passes.len() % 2 == 1 {
            std::mem::swap(&mut self.image, &mut self.next);
        }
    }

    /// Rows of one pass, from `image` to `next`.
    fn atrous_rows(&mut self, step: usize, rows: std::ops::Range<usize>) {
        let mut next = std::mem::replace(&mut self.next, Planes::new(0));
        let (pass, broken) = (&*self, &AtomicBool::new(false));
        let row = Self::IMAGE * self.pitch;
        let data = &mut next.all_mut()[rows.start * row..rows.end * row];
        for_bands(data, row, rows.start, step.max(1), |rows| {
            let work = Gather {
                pass,
                step,
                rows,
                broken,
            };
            simd::run(pass.level, work);
        });
        self.raw |= broken.load(Ordering::Relaxed);
        self.next = next;
    }

    /// Says what is data, and makes 0 of what is not.
    fn prepare(&mut self) {
        let (width, margin, pitch) = (self.size.x as usize, self.margin, self.pitch);
        let (image, surfaces) = (self.image.all(), self.surfaces.all());
        let size = |v: f32| v.to_bits() & 0x7fff_ffff;
        let (unknown, loud) = (AtomicBool::new(false), AtomicBool::new(false));
        for_rows(self.masks.all_mut(), MASKS * pitch, |y, row| {
            let reach = &surfaces[(y * SURFACE + REACH) * pitch + margin..][..width];
            let plane = |k: usize| &image[(y * Self::IMAGE + k) * pitch + margin..][..width];
            let (channels, variance): ([&[f32]; C], _) = (std::array::from_fn(plane), plane(C));
            let (usable, rest) = row.split_at_mut(pitch);
            let (known_variance, known) = rest.split_at_mut(pitch);
            let usable = &mut usable[margin..][..width];
            let known_variance = &mut known_variance[margin..][..width];
            let known = &mut known[margin..][..width];
            let (mut all, mut high) = (true, false);
            for x in 0..width {
                let mut largest = 0;
                for c in 0..C {
                    largest = size(channels[c][x]).max(largest);
                }
                let v = size(variance[x]) < VARIANCE_BITS;
                let sample = v && largest < VALUE_BITS;
                known_variance[x] = if v { 1.0 } else { 0.0 };
                known[x] = if sample { 1.0 } else { 0.0 };
                usable[x] = if sample && reach[x] > 0.0 { 1.0 } else { 0.0 };
                all &= sample;
                high |= v && size(variance[x]) >= LOUD_BITS;
            }
            if high {
                loud.store(true, Ordering::Relaxed);
            }
            if !all {
                unknown.store(true, Ordering::Relaxed);
            }
        });
        // The next pass has numbers in place of what is none.
        self.raw = unknown.into_inner();
        self.loud = loud.into_inner();
        let masks = self.masks.all();
        for_rows(self.image.all_mut(), Self::IMAGE * pitch, |y, row| {
            let plane = |k: usize| &masks[(y * MASKS + k) * pitch + margin..][..width];
            let (known, known_variance) = (plane(KNOWN), plane(VARIANCE_MASK));
            let (samples, light) = row.split_at_mut((C + 1) * pitch);
            for (c, plane) in samples.chunks_exact_mut(pitch).enumerate() {
                let plane = &mut plane[margin..][..width];
                if c < C {
                    for (v, known) in plane.iter_mut().zip(known) {
                        *v = if *known > 0.0 { *v } else { 0.0 };
                    }
                } else {
                    for (v, known) in plane.iter_mut().zip(known_variance) {
                        *v = if *known > 0.0 { most(*v, 0.0) } else { 0.0 };
                    }
                }
            }
            if C == 3 {
                let channel = |c: usize| &samples[c * pitch + margin..][..width];
                let (r, g, b) = (channel(0), channel(1), channel(2));
                let light = &mut light[margin..][..width];
                for x in 0..width {
                    light[x] = luminance(r[x], g[x], b[x]);
                }
            }
        });
        for_rows(&mut self.gaps, pitch / LINE + 1, |y, row| {
            let mask = &masks[(y * MASKS + MASK) * pitch..][..pitch];
            let mut count = 0;
            for (gap, line) in row.iter_mut().zip(mask.chunks_exact(LINE).chain([&[][..]])) {
                *gap = count;
                for m in line {
                    count += u32::from(*m == 0.0);
                }
            }
        });
    }

    /// A plane of a row of the image.
    #[inline(always)]
    fn plane_of(&self, y: usize, plane: usize) -> &[f32] {
        &self.image.all()[(y * Self::IMAGE + plane) * self.pitch..][..self.pitch]
    }

    /// The planes of a row of the image.
    #[inline(always)]
    fn planes(&self, y: usize) -> Row<'_, C> {
        let pitch = self.pitch;
        let surface = |k: usize| &self.surfaces.all()[(y * SURFACE + k) * pitch..][..pitch];
        let image = |k: usize| self.plane_of(y, k);
        let mask = |k: usize| &self.masks.all()[(y * MASKS + k) * pitch..][..pitch];
        let mut channels = [EMPTY.as_slice(); C];
        for (c, channel) in channels.iter_mut().enumerate() {
            *channel = image(c);
        }
        Row {
            position: [surface(0), surface(1), surface(2)],
            normal: [surface(3), surface(4), surface(5)],
            steepness: surface(STEEPNESS),
            channels,
            variance: image(C),
            luminance: image(Self::LUMINANCE),
            masks: [mask(0), mask(1), mask(2)],
            gaps: &self.gaps[y * (pitch / LINE + 1)..][..=pitch / LINE],
        }
    }

    /// As [`Self::planes`], if there is such a row.
    #[inline(always)]
    fn row_at(&self, y: Option<usize>) -> Option<Row<'_, C>> {
        y.filter(|y| *y < self.size.y as usize)
            .map(|y| self.planes(y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::svgf::{
        SvgfColor, SvgfScalar, svgf_atrous_pixel, svgf_atrous_scalar_pixel, svgf_fade,
    };
    use crate::random::pcg::{pcg_hash, pcg_unit};
    use glam::Vec3;

    fn noise(at: UVec2, lane: u32) -> f32 {
        pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
    }

    /// A rough wall with a step, a sky, and numbers that are none.
    fn surface(at: UVec2) -> SvgfSurface {
        let mut s = SvgfSurface {
            position: Vec3::new(
                at.x as f32,
                at.y as f32,
                noise(at, 1) * 0.1 + if at.x > 40 { 3.0 } else { 0.0 },
            ),
            reach: 0.5,
            normal: Vec3::new(0.2 * noise(at, 2), 0.1 * noise(at, 3), 1.0).normalize(),
        };
        if at.y > 40 && at.y < 44 || at.y < 3 && at.x > 100 {
            s.reach = 0.0;
        }
        if noise(at, 4) < 0.002 {
            s.position.x = f32::NAN;
        }
        s
    }

    fn value(at: UVec2) -> (Vec3, f32) {
        let mut v = Vec3::new(noise(at, 5), noise(at, 6), noise(at, 7)) * 2.0;
        let mut variance = noise(at, 8) - 0.05;
        if noise(at, 9) < 0.003 {
            v.y = [f32::NAN, f32::INFINITY, 1e30, -1e30][at.x as usize % 4];
        }
        if noise(at, 10) < 0.003 {
            variance = [f32::NAN, f32::INFINITY, f32::MAX, -f32::MAX][at.y as usize % 4];
        }
        (v, variance)
    }

    const PRESETS: [SvgfSettings; 3] = [
        SvgfSettings::PAPER,
        SvgfSettings::BLOG,
        SvgfSettings {
            radius: 2,
            squarings: 3,
            passes: 3,
            ..SvgfSettings::PAPER
        },
    ];

    #[test]
    fn every_pixel_is_that_of_the_technique() {
        for settings in PRESETS {
            for size in [
                UVec2::new(97, 70),
                UVec2::new(290, 37),
                UVec2::new(32, 5),
                UVec2::new(3, 40),
                UVec2::ONE,
            ] {
                let mut colour = SvgfPass::<3>::new(size, settings);
                let mut scalar = SvgfPass::<1>::new(size, settings);
                colour.set_surfaces(surface);
                scalar.set_surfaces(surface);
                colour.set_image(|at| {
                    let (v, variance) = value(at);
                    (v.to_array(), variance)
                });
                scalar.set_image(|at| {
                    let (v, variance) = value(at);
                    ([v.y], variance)
                });
                for i in 0..settings.passes {
                    let (before, before_scalar) = (colour.clone(), scalar.clone());
                    colour.atrous(1 << i);
                    scalar.atrous(1 << i);
                    for k in 0..size.x * size.y {
                        let at = UVec2::new(k % size.x, k / size.x);
                        let read = |at| {
                            let (v, variance) = before.at(at);
                            SvgfColor {
                                value: Vec3::from_array(v),
                                variance,
                            }
                        };
                        let want = svgf_atrous_pixel(at, size, 1 << i, settings, surface, read);
                        let (found, variance) = colour.at(at);
                        assert_eq!(found, want.value.to_array(), "{at} {size} pass {i}");
                        assert_eq!(variance, want.variance, "{at} {size} pass {i}");
                        let read = |at| {
                            let ([value], variance) = before_scalar.at(at);
                            SvgfScalar { value, variance }
                        };
                        let want =
                            svgf_atrous_scalar_pixel(at, size, 1 << i, settings, surface, read);
                        let ([found], variance) = scalar.at(at);
                        assert_eq!(
                            (found, variance),
                            (want.value, want.variance),
                            "{at} {size}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn weights_fade_as_the_techniques() {
        for i in 0..200_000u32 {
            let x = 42.0 * pcg_unit(pcg_hash(i));
            assert_eq!(fade(x), svgf_fade(x), "{x}");
        }
        for i in 0..=84u16 {
            let x = f32::from(i) * 0.5;
            assert_eq!(fade(x), svgf_fade(x), "{x}");
        }
        for x in [40.0f32.next_up(), 1e30, f32::MAX] {
            assert_eq!(fade(x), 0.0);
        }
        assert!(fade(40.0) > 0.0);
    }

    /// Images that take several turns of [`SvgfPass::flow`], against one pass
    /// after the other over the whole image.
    fn follows(loud: bool, bad: bool, settings: SvgfSettings) {
        let size = UVec2::new(21, 5 * (ROWS * threads()) as u32 / 2 + 7);
        let mut flowing = SvgfPass::<1>::new(size, settings);
        flowing.set_surfaces(surface);
        flowing.set_image(|at| {
            let (v, variance) = value(at);
            let v = if bad || v.y.abs() < 4.0 { v.y } else { 1.0 };
            let variance = if bad || variance.abs() < 4.0 {
                variance
            } else {
                1.0
            };
            let most = f32::from_bits(VARIANCE_BITS - 1);
            (
                [v],
                if loud && at.y % 50 == 7 {
                    most
                } else {
                    variance
                },
            )
        });
        let mut waiting = flowing.clone();
        let mut histories = Vec::new();
        flowing.filter(|image| histories.push(bits(image)));
        let mut expected = Vec::new();
        for i in 0..settings.passes {
            waiting.atrous(1 << i);
            if i == settings.feedback {
                expected.push(bits(&waiting));
            }
        }
        let what = format!("loud {loud} bad {bad} {settings:?}");
        assert!(histories == expected, "history, {what}");
        assert!(bits(&flowing) == bits(&waiting), "{what}");
    }

    #[test]
    fn passes_that_follow_each_other_give_the_same_bits() {
        for settings in PRESETS {
            for feedback in [0, 1, settings.passes - 1, 9] {
                let settings = SvgfSettings {
                    feedback,
                    ..settings
                };
                follows(false, false, settings);
                follows(false, true, settings);
                follows(true, false, settings);
            }
        }
        let narrow = SvgfSettings {
            radius: 0,
            ..SvgfSettings::PAPER
        };
        follows(false, false, narrow);
    }

    #[cfg(feature = "rayon")]
    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        for threads in [1, 3, 4] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().expect("a pool of a few threads");
            pool.install(|| follows(false, false, SvgfSettings::PAPER));
        }
    }

    #[test]
    fn an_image_without_surfaces_stays() {
        let mut pass = SvgfPass::<1>::new(UVec2::new(140, 9), SvgfSettings::PAPER);
        pass.set_image(|at| ([at.x as f32], 1.0));
        let before = bits(&pass);
        pass.filter(|_| ());
        assert!(bits(&pass) == before);
    }

    #[test]
    fn every_level_gives_the_same_bits() {
        let size = UVec2::new(333, 41);
        for settings in PRESETS {
            let at = |level| {
                let mut pass = SvgfPass::<3>::new(size, settings).with_level(level);
                pass.set_surfaces(surface);
                pass.set_image(|at| {
                    let (v, variance) = value(at);
                    (v.to_array(), variance)
                });
                pass.filter(|_| ());
                bits(&pass)
            };
            let baseline = at(SimdLevel::Baseline);
            for level in SimdLevel::ALL {
                assert!(at(level) == baseline, "{level:?}");
            }
        }
    }

    fn apart(a: UVec2, b: UVec2) -> u32 {
        a.x.abs_diff(b.x).max(a.y.abs_diff(b.y))
    }

    /// Shadows: a few soft ones in full light and full shadow, in each of which
    /// a pixel here and there is not quite sure, and numbers that are none.
    fn shadow(at: UVec2, seed: u32) -> ([f32; 1], f32) {
        let place = |lane| {
            UVec2::new(
                (noise(UVec2::new(seed, lane), 20) * 700.0) as u32,
                (noise(UVec2::new(seed, lane), 21) * 400.0) as u32,
            )
        };
        for lane in 0..2 {
            if apart(at, place(lane)) < 12 {
                return ([noise(at, 22)], 0.2 * noise(at, 23));
            }
        }
        let edge = 300 + (noise(UVec2::new(seed, 9), 24) * 200.0) as u32;
        let lit = f32::from(u8::from(at.x < edge));
        match (at == place(2), at == place(3), at == place(4)) {
            (true, ..) => ([lit], 1e-9),
            (_, true, _) => ([0.999], 0.0),
            (.., true) => ([f32::NAN], 0.0),
            _ => ([lit], 0.0),
        }
    }

    /// A floor of many heights below a sky.
    fn floor(at: UVec2) -> SvgfSurface {
        SvgfSurface {
            position: Vec3::new(at.x as f32, at.y as f32, noise(at, 1)),
            reach: if at.y < 60 { 0.0 } else { 0.5 },
            normal: Vec3::new(0.2 * noise(at, 2), 0.1 * noise(at, 3), 1.0).normalize(),
        }
    }

    fn bits<const C: usize>(pass: &SvgfPass<C>) -> Vec<u32> {
        let rows = (0..pass.size.y).flat_map(|y| (0..=C).map(move |c| (y, c)));
        rows.flat_map(|(y, c)| pass.row(y, c).iter().map(|v| v.to_bits()))
            .collect()
    }

    #[test]
    fn tiles_that_are_left_out_change_no_bit() {
        let size = UVec2::new(701, 398);
        let mut shares = Vec::new();
        for settings in PRESETS {
            for seed in 0..6 {
                let mut full = SvgfPass::<1>::new(size, settings);
                full.set_surfaces(floor);
                full.set_image(|at| shadow(at, seed));
                let mut tiled = full.clone();
                let (mut fed, mut fed_tiled) = (Vec::new(), Vec::new());
                full.filter(|p| fed = bits(p));
                let mask = tiled.filter_tiles(|p| fed_tiled = bits(p));
                assert!(bits(&full) == bits(&tiled), "{settings:?}, image {seed}");
                assert!(fed == fed_tiled, "{settings:?}, image {seed}, fed back");
                let all = mask.tiles().x * mask.tiles().y;
                shares.push(mask.count() as f32 / all as f32);
                // Afterwards it filters everything again.
                full.set_image(|at| shadow(at, seed + 100));
                tiled.set_image(|at| shadow(at, seed + 100));
                full.filter(|_| ());
                tiled.filter(|_| ());
                assert!(bits(&full) == bits(&tiled));
            }
        }
        println!("parts of the tiles that were filtered: {shares:.2?}");
        // Many are left out, and many are not.
        assert!(shares.iter().all(|s| *s > 0.02 && *s < 0.8));
    }

    #[test]
    fn reflections_leave_out_mirrors_and_rough_surfaces() {
        // Rays of a glossy strip between a mirror and a rough wall.
        let size = UVec2::new(300, 170);
        let surface = |at: UVec2| SvgfSurface {
            reach: if at.x > 90 && at.x < 120 { 0.5 } else { 0.0 },
            ..floor(at)
        };
        let image = |at: UVec2| {
            let (v, variance) = value(at);
            (v.to_array(), variance.abs())
        };
        let mut full = SvgfPass::<3>::new(size, SvgfSettings::PAPER);
        full.set_surfaces(surface);
        full.set_image(image);
        let mut tiled = full.clone();
        full.filter(|_| ());
        let mask = tiled.filter_tiles(|_| ());
        assert!(bits(&full) == bits(&tiled));
        let share = mask.count() as f32 / (mask.tiles().x * mask.tiles().y) as f32;
        println!("{share:.2} of the tiles were filtered");
        assert!(share > 0.1 && share < 0.5, "{share}");
    }

    #[test]
    fn a_reach_one_tile_too_small_is_not_enough() {
        // One uncertain pixel in full light, and the tiles that it ends in.
        let size = UVec2::new(300, 300);
        let spot = UVec2::new(151, 151);
        let mut full = SvgfPass::<1>::new(size, SvgfSettings::PAPER);
        full.set_surfaces(|at| SvgfSurface {
            position: Vec3::new(at.x as f32, at.y as f32, 0.0),
            reach: 1.0,
            normal: Vec3::Z,
        });
        // Near enough to its neighbours for them to take it in at once.
        full.set_image(|at| {
            if at == spot {
                ([0.99999], 1e6)
            } else {
                ([1.0], 0.0)
            }
        });
        let before = full.clone();
        full.filter(|_| ());
        let mut farthest = 0;
        for i in 0..size.x * size.y {
            let at = UVec2::new(i % size.x, i / size.x);
            if full.at(at) != before.at(at) {
                farthest = farthest.max(apart(at / 8, spot / 8));
            }
        }
        println!("the pixel is seen {farthest} tiles away");
        let pixels = tiles_atrous_reach(2, 5);
        assert_eq!(farthest, tiles_reach(pixels));
    }

    #[test]
    fn no_image_is_no_trouble() {
        for size in [UVec2::ZERO, UVec2::new(0, 4), UVec2::new(4, 0)] {
            let mut pass = SvgfPass::<3>::new(size, SvgfSettings::PAPER);
            pass.set_surfaces(surface);
            pass.set_image(|_| ([0.0; 3], 0.0));
            let mut fed = 0;
            pass.filter(|_| fed += 1);
            assert_eq!(fed, 1);
        }
    }
}
