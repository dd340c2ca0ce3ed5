//! [`filter::svgf`](crate::filter::svgf) over whole images.
//!
//! [`SvgfPass`] keeps an image as planes and gives at every pixel the bits of
//! `svgf_atrous_pixel` (three channels) or `svgf_atrous_scalar_pixel` (one),
//! whose source says what is computed; here is only how.
//!
//! Rows are padded by what the widest pass reaches, and pixels that are no data
//! have a mask of 0: so the inner loops have no branch, and where a block and
//! its taps are all data they have no mask either.

// Lanes index a dozen arrays at once.
#![allow(clippy::needless_range_loop)]

use glam::UVec2;

use crate::filter::svgf::{
    EXPONENT_MIN, LOG2_E, NORMAL_BITS, SVGF_VALUE_MAX, SvgfSettings, SvgfSurface, TOTAL_MIN,
    VALUE_BITS, VARIANCE_BITS, svgf_falloff, svgf_luminance_scale,
};

/// Pixels that are worked on together: what they need stays in registers and
/// the first cache.
const LANES: usize = 32;

/// Planes of a surface: position, normal, reach.
const SURFACE: usize = 7;
const NORMAL: usize = 3;
const REACH: usize = 6;

/// Planes of a prepared image after its channels.
const VARIANCE: usize = 0;
const LUMINANCE: usize = 1;
/// 1 where the sample and the surface are data.
const MASK: usize = 2;
/// 1 where the variance is data.
const VARIANCE_MASK: usize = 3;
/// 1 where the sample is data.
const KNOWN: usize = 4;
const PREPARED: usize = 5;

type Block = [f32; LANES];

/// The filter for images of one size, with `C` channels: 1 (shadow, ambient
/// occlusion) or 3 (colours). Create it once.
#[derive(Clone, Debug)]
pub struct SvgfPass<const C: usize> {
    size: UVec2,
    settings: SvgfSettings,
    /// Padding on each side of a row, and a row's length with it.
    margin: usize,
    pitch: usize,
    /// By row, then by plane.
    surfaces: Vec<f32>,
    prepared: Vec<f32>,
    /// By row: how many pixels before one are no data.
    gaps: Vec<u32>,
    /// By row, then by channel and variance; without padding.
    image: Vec<f32>,
}

/// Applies `work` to each row, in parallel with the feature `rayon`.
fn for_rows<T: Send>(data: &mut [T], row: usize, work: impl Fn(usize, &mut [T]) + Sync + Send) {
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

/// `LANES` values from here on.
#[inline(always)]
fn block(plane: &[f32], at: usize) -> &Block {
    let part: Option<&Block> = plane[at..].first_chunk();
    part.expect("rows are padded")
}

#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// `exp2_poly` from [`EXPONENT_MIN`] to 0, and 0 below; without branches and without `floor`, which on
/// x86-64 before SSE 4.1 is a call.
#[inline(always)]
fn exp2_falling(x: f32) -> f32 {
    // 1.5 · 2^23: adding it rounds to an integer.
    const ROUND: f32 = 12_582_912.0;
    let x_kept = most(x, EXPONENT_MIN);
    let y = x_kept + 0.5;
    let nearest = (y + ROUND) - ROUND;
    let k = nearest - if nearest > y { 1.0 } else { 0.0 };
    let f = x_kept - k;
    let p = 1.0
        + f * (0.6931472
            + f * (0.24022648
                + f * (0.0555036 + f * (0.009618506 + f * (0.0013390806 + f * 0.00015326463)))));
    let integer = (k + ROUND).to_bits().wrapping_sub(ROUND.to_bits());
    let scale = f32::from_bits(integer.wrapping_add(127) << 23);
    if x < EXPONENT_MIN { 0.0 } else { p * scale }
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

/// `svgf_gaussian_pixel` of a block.
#[inline(always)]
fn gaussian<'a>(
    variance: &impl Fn(usize) -> &'a [f32],
    mask: &impl Fn(usize) -> &'a [f32],
    whole: &impl Fn(usize, usize, usize) -> bool,
    y: usize,
    height: usize,
    at: usize,
) -> Block {
    let (mut sum, mut total): (Block, Block) = ([0.0; LANES], [0.0; LANES]);
    let (mut low, mut high): (Block, Block) = ([f32::MAX; LANES], [0.0; LANES]);
    for row in y.saturating_sub(1)..(y + 2).min(height) {
        let complete = whole(row, at - 1, at + LANES + 1);
        for from in at - 1..=at + 1 {
            let across = if from == at { 0.5 } else { 0.25 };
            let w = across * if row == y { 0.5 } else { 0.25 };
            let v = block(variance(row), from);
            if complete {
                for l in 0..LANES {
                    sum[l] += w * v[l];
                    total[l] += w;
                    low[l] = least(low[l], v[l]);
                    high[l] = most(high[l], v[l]);
                }
            } else {
                let m = block(mask(row), from);
                for l in 0..LANES {
                    let w = w * m[l];
                    sum[l] += w * v[l];
                    total[l] += w;
                    low[l] = if m[l] > 0.0 {
                        least(low[l], v[l])
                    } else {
                        low[l]
                    };
                    high[l] = most(high[l], v[l]);
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
    depth_falloff: Block,
    luminance_falloff: Block,
}

/// Adds the tap at one offset to each pixel of a block. `s` and `p` are planes
/// of the tap's row, `at` its place in them.
#[inline(always)]
fn add_tap<const C: usize, const SQUARINGS: u32, const MASKED: bool>(
    sums: &mut Sums<C>,
    centre: &Centres<'_>,
    s: &[&[f32]; SURFACE],
    channels: &[&[f32]; C],
    p: &[&[f32]; PREPARED],
    at: usize,
    spline: f32,
) {
    let [px, py, pz, nx, ny, nz] = std::array::from_fn(|k| block(s[k], at));
    let values: [&Block; C] = std::array::from_fn(|c| block(channels[c], at));
    let variance = block(p[VARIANCE], at);
    let luminance = block(p[LUMINANCE], at);
    let mask = block(p[MASK], at);
    let [cx, cy, cz] = centre.position;
    let [ux, uy, uz] = centre.normal;
    let mut weight: Block = [0.0; LANES];
    for l in 0..LANES {
        let (tx, ty, tz) = (px[l] - cx[l], py[l] - cy[l], pz[l] - cz[l]);
        let plane = ((ux[l] * tx + uy[l] * ty) + uz[l] * tz).abs() * centre.depth_falloff[l];
        let apart = (luminance[l] - centre.luminance[l]).abs() * centre.luminance_falloff[l];
        let (dx, dy, dz) = (nx[l] - ux[l], ny[l] - uy[l], nz[l] - uz[l]);
        let mut below = least(0.5 * ((dx * dx + dy * dy) + dz * dz), 1.0);
        for _ in 0..SQUARINGS {
            below = below * (2.0 - below);
        }
        let w = spline * ((1.0 - below) * exp2_falling(-LOG2_E * (plane + apart)));
        weight[l] = if MASKED { w * mask[l] } else { w };
    }
    for c in 0..C {
        for l in 0..LANES {
            let v = values[c][l];
            sums.value[c][l] += v * weight[l];
            // Where there is no data v is 0.
            let gap = if MASKED {
                (1.0 - mask[l]) * SVGF_VALUE_MAX
            } else {
                0.0
            };
            sums.low[c][l] = least(sums.low[c][l], v + gap);
            sums.high[c][l] = most(sums.high[c][l], v - gap);
        }
    }
    for l in 0..LANES {
        sums.variance[l] += (weight[l] * weight[l]) * variance[l];
        sums.total[l] += weight[l];
    }
}

impl<const C: usize> SvgfPass<C> {
    /// For images of this size. A colour's luminance is Rec. 709's; an image of
    /// one channel is its own. Each side is below 2^20; a pass has at most 16
    /// steps.
    #[must_use]
    pub fn new(size: UVec2, settings: SvgfSettings) -> Self {
        let (width, height) = (size.x as usize, size.y as usize);
        let widest = 1usize << settings.passes.clamp(1, 16).saturating_sub(1);
        let margin = (settings.radius.min(2) as usize * widest).max(1);
        let pitch = margin + width.next_multiple_of(LANES) + margin;
        Self {
            size,
            settings,
            margin,
            pitch,
            surfaces: vec![0.0; height * SURFACE * pitch],
            prepared: vec![0.0; height * (C + PREPARED) * pitch],
            gaps: vec![0; height * (pitch + 1)],
            image: vec![0.0; height * (C + 1) * width],
        }
    }

    /// Width and height.
    #[must_use]
    pub fn size(&self) -> UVec2 {
        self.size
    }

    /// The surfaces of a frame; what is no data counts as none.
    pub fn set_surfaces(&mut self, read: impl Fn(UVec2) -> SvgfSurface + Sync + Send) {
        if self.size.x == 0 {
            return;
        }
        let (width, margin, pitch) = (self.size.x as usize, self.margin, self.pitch);
        for_rows(&mut self.surfaces, SURFACE * pitch, |y, row| {
            for x in 0..width {
                let mut s = read(UVec2::new(x as u32, y as u32));
                let bits = |v: glam::Vec3| {
                    let size = |x: f32| x.to_bits() & 0x7fff_ffff;
                    size(v.x).max(size(v.y)).max(size(v.z))
                };
                let reach = s.reach.to_bits();
                let usable = bits(s.position) < VALUE_BITS
                    && bits(s.normal) < NORMAL_BITS
                    && reach > 0
                    && reach < VALUE_BITS;
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
                ];
                for (k, v) in planes.into_iter().enumerate() {
                    row[k * pitch + margin + x] = v;
                }
            }
        });
    }

    /// The image to filter, and the variance of its luminance.
    pub fn set_image(&mut self, read: impl Fn(UVec2) -> ([f32; C], f32) + Sync + Send) {
        if self.size.x == 0 {
            return;
        }
        let width = self.size.x as usize;
        for_rows(&mut self.image, (C + 1) * width, |y, row| {
            for x in 0..width {
                let (value, variance) = read(UVec2::new(x as u32, y as u32));
                for (c, v) in value.into_iter().chain([variance]).enumerate() {
                    row[c * width + x] = v;
                }
            }
        });
    }

    /// A row of a channel, or of the variance for `channel == C`.
    ///
    /// # Panics
    /// If there is no such row or channel.
    #[must_use]
    pub fn row(&self, y: u32, channel: usize) -> &[f32] {
        assert!(channel <= C, "channel {channel} of {C} and the variance");
        let width = self.size.x as usize;
        let start = (y as usize * (C + 1) + channel) * width;
        &self.image[start..start + width]
    }

    /// A pixel's value and variance.
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
    pub fn filter(&mut self, mut feedback: impl FnMut(&Self)) {
        for i in 0..self.settings.passes.min(16) {
            self.atrous(1 << i);
            if i == self.settings.feedback {
                feedback(self);
            }
        }
    }

    /// One pass, with taps `step` pixels apart, at most as far as the widest of
    /// [`Self::filter`].
    pub fn atrous(&mut self, step: u32) {
        if self.size.x == 0 || self.size.y == 0 {
            return;
        }
        self.prepare();
        match self.settings.squarings {
            5 => self.gather::<5>(step),
            7 => self.gather::<7>(step),
            n if n < 5 => match n {
                0 => self.gather::<0>(step),
                1 => self.gather::<1>(step),
                2 => self.gather::<2>(step),
                3 => self.gather::<3>(step),
                _ => self.gather::<4>(step),
            },
            6 => self.gather::<6>(step),
            8 => self.gather::<8>(step),
            9 => self.gather::<9>(step),
            10 => self.gather::<10>(step),
            _ => self.gather::<16>(step),
        }
    }

    /// Copies the image into padded planes with masks and luminance.
    fn prepare(&mut self) {
        let (width, margin, pitch) = (self.size.x as usize, self.margin, self.pitch);
        let (image, surfaces) = (&self.image, &self.surfaces);
        for_rows(&mut self.prepared, (C + PREPARED) * pitch, |y, row| {
            let from = &image[y * (C + 1) * width..(y + 1) * (C + 1) * width];
            let reach = &surfaces[(y * SURFACE + REACH) * pitch + margin..][..width];
            for x in 0..width {
                let size = |v: f32| v.to_bits() & 0x7fff_ffff;
                let variance = from[C * width + x];
                let known_variance = size(variance) < VARIANCE_BITS;
                let mut known = known_variance;
                for c in 0..C {
                    known &= size(from[c * width + x]) < VALUE_BITS;
                }
                let usable = known && reach[x] > 0.0;
                for c in 0..C {
                    let v = from[c * width + x];
                    row[c * pitch + margin + x] = if known { v } else { 0.0 };
                }
                let put = |plane: usize| (C + plane) * pitch + margin + x;
                let nonnegative = if variance > 0.0 { variance } else { 0.0 };
                row[put(VARIANCE)] = if known_variance { nonnegative } else { 0.0 };
                let v = |c: usize| row[c * pitch + margin + x];
                let luminance = if C == 3 {
                    (0.2126 * v(0) + 0.7152 * v(1)) + 0.0722 * v(2)
                } else {
                    v(0)
                };
                row[put(LUMINANCE)] = luminance;
                row[put(MASK)] = f32::from(u8::from(usable));
                row[put(VARIANCE_MASK)] = f32::from(u8::from(known_variance));
                row[put(KNOWN)] = f32::from(u8::from(known));
            }
        });
        let prepared = &self.prepared;
        for_rows(&mut self.gaps, pitch + 1, |y, row| {
            let mask = &prepared[(y * (C + PREPARED) + C + MASK) * pitch..][..pitch];
            let mut count = 0;
            for (gap, m) in row.iter_mut().zip(mask) {
                *gap = count;
                count += u32::from(*m == 0.0);
            }
            row[pitch] = count;
        });
    }

    fn gather<const SQUARINGS: u32>(&mut self, step: u32) {
        let (width, height) = (self.size.x as usize, self.size.y as usize);
        let (margin, pitch, settings) = (self.margin, self.pitch, self.settings);
        let (surfaces, prepared, gaps) = (&self.surfaces, &self.prepared, &self.gaps);
        let radius = settings.radius.min(2) as usize;
        let step = (step as usize).min(margin / radius.max(1));
        let surface = |y: usize| -> [&[f32]; SURFACE] {
            std::array::from_fn(|k| &surfaces[(y * SURFACE + k) * pitch..][..pitch])
        };
        let plane = |y: usize, k: usize| &prepared[(y * (C + PREPARED) + k) * pitch..][..pitch];
        let channels = |y: usize| -> [&[f32]; C] { std::array::from_fn(|c| plane(y, c)) };
        let others = |y: usize| -> [&[f32]; PREPARED] { std::array::from_fn(|k| plane(y, C + k)) };
        let whole = |y: usize, from: usize, to: usize| {
            let row = &gaps[y * (pitch + 1)..];
            row[to] == row[from]
        };
        for_rows(&mut self.image, (C + 1) * width, |y, out| {
            let (own_s, own_v, own_p) = (surface(y), channels(y), others(y));
            // Taps within the image, from the first row on.
            let rows: Vec<_> = (0..=2 * radius)
                .filter_map(|k| {
                    let row = (y + k * step).checked_sub(radius * step)?;
                    (row < height).then(|| (k, row, surface(row), channels(row), others(row)))
                })
                .collect();
            for x in (0..width).step_by(LANES) {
                let at = margin + x;
                let smooth = gaussian(
                    &|row| plane(row, C + VARIANCE),
                    &|row| plane(row, C + VARIANCE_MASK),
                    &whole,
                    y,
                    height,
                    at,
                );
                let reach = block(own_s[REACH], at);
                let luminance = block(own_p[LUMINANCE], at);
                let mut centre = Centres {
                    position: std::array::from_fn(|k| block(own_s[k], at)),
                    normal: std::array::from_fn(|k| block(own_s[NORMAL + k], at)),
                    luminance,
                    depth_falloff: [0.0; LANES],
                    luminance_falloff: [0.0; LANES],
                };
                let known = block(own_p[KNOWN], at);
                for l in 0..LANES {
                    centre.depth_falloff[l] = svgf_falloff(settings.sigma_depth * reach[l]);
                    let scale =
                        svgf_luminance_scale(smooth[l], luminance[l], settings.sigma_luminance);
                    centre.luminance_falloff[l] = svgf_falloff(scale) * known[l];
                }
                let mut sums = Sums::<C> {
                    value: [[0.0; LANES]; C],
                    low: [[SVGF_VALUE_MAX; LANES]; C],
                    high: [[-SVGF_VALUE_MAX; LANES]; C],
                    variance: [0.0; LANES],
                    total: [0.0; LANES],
                };
                for (k, row, s, v, p) in &rows {
                    let complete = whole(*row, at - radius * step, at + radius * step + LANES);
                    for j in 0..=2 * radius {
                        let from = at + j * step - radius * step;
                        let spline = spline(j, radius) * spline(*k, radius);
                        if complete {
                            add_tap::<C, SQUARINGS, false>(
                                &mut sums, &centre, s, v, p, from, spline,
                            );
                        } else {
                            add_tap::<C, SQUARINGS, true>(
                                &mut sums, &centre, s, v, p, from, spline,
                            );
                        }
                    }
                }
                let count = LANES.min(width - x);
                for l in 0..count {
                    let surfaceless = reach[l] <= 0.0;
                    let nothing = !surfaceless && sums.total[l] < TOTAL_MIN;
                    for c in 0..C {
                        let mean = sums.value[c][l] / sums.total[l];
                        let kept = mean.max(sums.low[c][l]).min(sums.high[c][l]);
                        let own = own_v[c][at + l];
                        let filled = if nothing { 0.0 } else { kept };
                        out[c * width + x + l] = if surfaceless { own } else { filled };
                    }
                    let variance = (sums.variance[l] / sums.total[l]) / sums.total[l];
                    let filled = if nothing { 0.0 } else { variance };
                    out[C * width + x + l] = if surfaceless {
                        own_p[VARIANCE][at + l] * known[l]
                    } else {
                        filled
                    };
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::svgf::{SvgfColor, SvgfScalar, svgf_atrous_pixel, svgf_atrous_scalar_pixel};
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
        if at.y > 40 && at.y < 44 {
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
    fn exponential_is_the_kits() {
        for i in 0..200_000u32 {
            let x = -40.0 * pcg_unit(pcg_hash(i));
            assert_eq!(exp2_falling(x), crate::math::exponent::exp2_poly(x), "{x}");
        }
        for i in 0..=80u16 {
            let x = -f32::from(i) * 0.5;
            assert_eq!(exp2_falling(x), crate::math::exponent::exp2_poly(x), "{x}");
        }
        assert_eq!(exp2_falling(-40.001), 0.0);
        assert_eq!(exp2_falling(f32::MIN), 0.0);
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
