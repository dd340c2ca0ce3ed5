//! Statistics for samplers: chi-square with pooling, bins, correlation.
//!
//! Sources: the incomplete gamma function by series and continued fraction
//! (Abramowitz and Stegun 6.5.29, 6.5.31; the fraction evaluated by Lentz's
//! method), its logarithm by Stirling's series (6.1.41); Šidák 1967 for many
//! tests at once.

use std::f64::consts::TAU;

/// `ln Γ(x)` for `x > 0`, to about 1e-14 relative.
#[must_use]
pub fn ln_gamma(x: f64) -> f64 {
    // Stirling's series needs a large argument: Γ(x) = Γ(x + n) / (x (x+1) …).
    let (mut z, mut shift) = (x, 0.0);
    while z < 10.0 {
        shift += z.ln();
        z += 1.0;
    }
    let w = 1.0 / (z * z);
    let series = [
        1.0 / 12.0,
        -1.0 / 360.0,
        1.0 / 1260.0,
        -1.0 / 1680.0,
        1.0 / 1188.0,
        -691.0 / 360_360.0,
        1.0 / 156.0,
    ]
    .iter()
    .rev()
    .fold(0.0, |sum, c| sum * w + c);
    (z - 0.5) * z.ln() - z + 0.5 * TAU.ln() + series / z - shift
}

/// The regularised upper incomplete gamma function `Q(a, x)`, `a > 0`,
/// `x >= 0`.
#[must_use]
pub fn gamma_q(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let weight = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-17 {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return 1.0 - weight * sum;
    }
    let mut b = x + 1.0 - a;
    let mut c = f64::MAX;
    let mut d = 1.0 / b;
    let mut fraction = d;
    for i in 1..1_000_000 {
        let i = f64::from(i);
        let numerator = -i * (i - a);
        b += 2.0;
        d = 1.0 / (numerator * d + b);
        c = b + numerator / c;
        let factor = c * d;
        fraction *= factor;
        if (factor - 1.0).abs() < 1e-16 {
            break;
        }
    }
    weight * fraction
}

/// How likely a chi-square statistic of at least this size is by chance.
#[must_use]
pub fn chi_square_p_value(statistic: f64, degrees: f64) -> f64 {
    gamma_q(0.5 * degrees, 0.5 * statistic)
}

/// The significance for each of `tests` tests so that all of them together
/// reject a true hypothesis with probability `significance` (Šidák).
#[must_use]
pub fn sidak(significance: f64, tests: usize) -> f64 {
    // 1 - (1 - s)^(1/n) without cancellation.
    -((-significance).ln_1p() / tests as f64).exp_m1()
}

/// A chi-square test's outcome.
#[derive(Clone, Copy, Debug)]
pub struct ChiSquare {
    /// Sum of `(observed - expected)² / expected` over the pooled bins.
    pub statistic: f64,
    /// Degrees of freedom: pooled bins less one.
    pub degrees: usize,
    /// Probability of a statistic at least as large.
    pub p_value: f64,
}

/// Why counts cannot be tested, or fail before any statistic.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ChiSquareError {
    /// Something was observed where nothing may be.
    #[error("bin {bin} holds {observed} samples, and the density there is zero")]
    ZeroDensity {
        /// Which bin.
        bin: usize,
        /// How many.
        observed: u64,
    },
    /// A density is negative or not a number.
    #[error("bin {bin} expects {expected} samples")]
    BadDensity {
        /// Which bin.
        bin: usize,
        /// What was integrated.
        expected: f64,
    },
    /// Fewer than two bins are left after pooling.
    #[error("only {0} bins are left after pooling: too few samples to test anything")]
    TooFewBins(usize),
}

/// Pearson's chi-square test of counts against expected counts.
///
/// Bins are pooled, rarest first, until each pool expects at least
/// `least_expected` (5 is usual).
///
/// # Errors
/// If a bin of zero density holds samples, an expectation is negative, or
/// nothing is left to test.
pub fn chi_square(
    observed: &[u64],
    expected: &[f64],
    least_expected: f64,
) -> Result<ChiSquare, ChiSquareError> {
    assert_eq!(observed.len(), expected.len(), "one expectation a bin");
    let mut bins = Vec::with_capacity(expected.len());
    for (bin, (&observed, &expected)) in observed.iter().zip(expected).enumerate() {
        if expected.is_nan() || expected < 0.0 {
            return Err(ChiSquareError::BadDensity { bin, expected });
        }
        if expected > 0.0 {
            bins.push((expected, observed));
        } else if observed > 0 {
            return Err(ChiSquareError::ZeroDensity { bin, observed });
        }
    }
    bins.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut pools: Vec<(f64, u64)> = Vec::new();
    for (expected, observed) in bins {
        match pools.last_mut() {
            Some(last) if last.0 < least_expected => {
                last.0 += expected;
                last.1 += observed;
            }
            _ => pools.push((expected, observed)),
        }
    }
    if pools.len() < 2 {
        return Err(ChiSquareError::TooFewBins(pools.len()));
    }
    let statistic = pools
        .iter()
        .map(|&(expected, observed)| (observed as f64 - expected).powi(2) / expected)
        .sum();
    let degrees = pools.len() - 1;
    Ok(ChiSquare {
        statistic,
        degrees,
        p_value: chi_square_p_value(statistic, degrees as f64),
    })
}

/// The azimuth of `(x, y)` in turns, in `[0, 1)`.
#[must_use]
pub fn turn_of(x: f64, y: f64) -> f64 {
    let turn = (y.atan2(x) / TAU).rem_euclid(1.0);
    // A tiny negative angle rounds to a whole turn.
    if turn < 1.0 { turn } else { 0.0 }
}

/// Distance of two angles in turns around the circle, `[0, 1/2]`.
#[must_use]
pub fn turn_distance(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(1.0);
    d.min(1.0 - d)
}

/// A grid over a rectangle `[low, high] × [0, 1)` in which equal bins have
/// equal area: the height above a plane and the azimuth in turns for the
/// sphere (Archimedes), the squared radius and the azimuth for the disk.
///
/// Take an odd number of rows on the whole sphere: the horizon then runs
/// through the middle of a row and never along an edge, where one rounding
/// would move a sample into a bin of density zero.
#[derive(Clone, Copy, Debug)]
pub struct Bins {
    /// Bins along the first coordinate.
    pub rows: usize,
    /// Bins around the azimuth.
    pub columns: usize,
    /// First coordinate's range.
    pub range: (f64, f64),
}

impl Bins {
    /// Number of bins.
    #[must_use]
    pub fn count(&self) -> usize {
        self.rows * self.columns
    }

    /// The bin of a point, or `None` if the first coordinate is further than
    /// `slack` outside of its range.
    #[must_use]
    pub fn index(&self, first: f64, turn: f64, slack: f64) -> Option<usize> {
        let (low, high) = self.range;
        if !(first >= low - slack && first <= high + slack) {
            return None;
        }
        let at = |t: f64, n: usize| ((t * n as f64) as usize).min(n - 1);
        let row = at(((first - low) / (high - low)).max(0.0), self.rows);
        Some(row * self.columns + at(turn, self.columns))
    }

    /// Midpoints of an `n × n` grid in each bin: `(bin, first, turn)`.
    pub fn midpoints(&self, n: usize) -> impl Iterator<Item = (usize, f64, f64)> {
        let Self {
            rows,
            columns,
            range: (low, high),
        } = *self;
        (0..rows * n * columns * n).map(move |i| {
            let (r, c) = (i / (columns * n), i % (columns * n));
            let t = (r as f64 + 0.5) / (rows * n) as f64;
            let turn = (c as f64 + 0.5) / (columns * n) as f64;
            (r / n * columns + c / n, low + t * (high - low), turn)
        })
    }
}

/// Points of a square grid over Lambert's equal-area map of the sphere around
/// +z, out to `1 - cos θ = farthest` and beyond the corners as far as the
/// sphere goes: `[x, y, z]`, each standing for the same solid angle, which is
/// returned first. No sampler's coordinates run along this grid.
pub fn equal_area_grid(farthest: f64, side: usize) -> (f64, impl Iterator<Item = [f64; 3]>) {
    // The map's radius is √(2 (1 - cos θ)), 2 for the whole sphere.
    let half = (2.0 * farthest).sqrt();
    let step = 2.0 * half / side as f64;
    let at = move |i: usize| (i as f64 + 0.5) * step - half;
    let points = (0..side * side).filter_map(move |i| {
        let (x, y) = (at(i % side), at(i / side));
        let height = 0.5 * (x * x + y * y);
        // sin θ / radius = √(1 - height/2).
        let scale = (1.0 - 0.5 * height).max(0.0).sqrt();
        (height <= 2.0).then_some([x * scale, y * scale, 1.0 - height])
    });
    (step * step, points)
}

/// Mean and variance.
#[must_use]
pub fn mean_variance(values: &[f32]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    let square = values.iter().map(|&v| (f64::from(v) - mean).powi(2));
    (mean, square.sum::<f64>() / n)
}

/// Pearson's correlation of numbers in `[0, 1)`, given as rows of pairs.
#[must_use]
pub fn pearson<'a>(rows: impl Iterator<Item = (&'a [f32], &'a [f32])>) -> f64 {
    let (mut n, mut sa, mut sb) = (0.0, 0.0, 0.0);
    let (mut saa, mut sbb, mut sab) = (0.0, 0.0, 0.0);
    for (row_a, row_b) in rows {
        let count = row_a.len().min(row_b.len());
        n += count as f64;
        for i in 0..count {
            // Centred on the middle, so that the sums do not cancel.
            let (a, b) = (f64::from(row_a[i]) - 0.5, f64::from(row_b[i]) - 0.5);
            sa += a;
            sb += b;
            saa += a * a;
            sbb += b * b;
            sab += a * b;
        }
    }
    (n * sab - sa * sb) / ((n * saa - sa * sa) * (n * sbb - sb * sb)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn sphere_integral(density: impl Fn([f64; 3]) -> f64) -> f64 {
        let (area, points) = equal_area_grid(2.0, 512);
        points.map(|d| density(d) * area).sum()
    }

    #[test]
    fn gamma_at_integers_and_halves() {
        for (x, gamma) in [(1.0, 1.0), (2.0, 1.0), (5.0, 24.0), (11.0, 3_628_800.0)] {
            assert!((ln_gamma(x) - f64::ln(gamma)).abs() < 1e-14 * (1.0 + gamma.ln()));
        }
        assert!((ln_gamma(0.5) - PI.sqrt().ln()).abs() < 1e-14);
        // Γ(n + 1) = n Γ(n), far out.
        let step = ln_gamma(10_201.0) - ln_gamma(10_200.0);
        assert!((step - 10_200f64.ln()).abs() < 1e-10);
    }

    #[test]
    fn p_values_of_printed_tables() {
        // Abramowitz and Stegun, table 26.8: upper percentage points.
        for (degrees, statistic, p) in [
            (1.0, 3.841_46, 0.05),
            (1.0, 10.827_6, 0.001),
            (10.0, 18.307_0, 0.05),
            (10.0, 2.558_21, 0.99),
            (30.0, 50.892_2, 0.01),
            (100.0, 135.807, 0.01),
            (100.0, 77.929_5, 0.95),
        ] {
            let found = chi_square_p_value(statistic, degrees);
            assert!((found / p - 1.0).abs() < 1e-4, "{degrees}: {found} for {p}");
        }
    }

    #[test]
    fn even_degrees_match_the_poisson_sum() {
        // Q(n, x) = e^-x Σ x^k / k!, k < n: on both sides of the mean.
        for n in [1u32, 3, 40, 200] {
            for ratio in [0.5, 0.9, 0.999, 1.001, 1.1, 1.5] {
                let x = f64::from(n) * ratio;
                let (mut term, mut sum) = ((-x).exp(), 0.0);
                for k in 0..n {
                    sum += term;
                    term *= x / f64::from(k + 1);
                }
                let found = gamma_q(f64::from(n), x);
                assert!((found - sum).abs() < 1e-12, "Q({n}, {x}) = {found}, {sum}");
            }
        }
    }

    #[test]
    fn many_degrees_match_the_normal_limit() {
        // Wilson and Hilferty: the cube root is normal; good to 1e-5 here.
        let degrees = 20_401.0;
        let at = |z: f64| {
            let k = 2.0 / (9.0 * degrees);
            degrees * (1.0 - k + z * f64::sqrt(k)).powi(3)
        };
        for (z, p) in [(0.0, 0.5), (1.644_854, 0.05), (3.090_232, 0.001)] {
            let found = chi_square_p_value(at(z), degrees);
            assert!((found - p).abs() < 1e-5, "z {z}: {found}");
        }
    }

    #[test]
    fn sidak_keeps_the_family_at_its_level() {
        let each = sidak(0.01, 18);
        assert!((1.0 - (1.0 - each).powi(18) - 0.01).abs() < 1e-15);
        assert!(sidak(0.01, 1) - 0.01 < 1e-17);
    }

    #[test]
    fn rare_bins_are_pooled_and_empty_ones_checked() {
        let expected = [1.0, 100.0, 2.0, 3.0, 0.0, 50.0];
        let observed = [2, 90, 1, 3, 0, 60];
        let test = chi_square(&observed, &expected, 5.0).expect("testable");
        // {1, 2, 3} pool to 6; 50 and 100 stand alone.
        assert_eq!(test.degrees, 2);
        assert!((test.statistic - (0.0 + 2.0 + 1.0)).abs() < 1e-12);
        let hit = [2, 90, 1, 3, 1, 60];
        assert_eq!(
            chi_square(&hit, &expected, 5.0).expect_err("a sample at density zero"),
            ChiSquareError::ZeroDensity {
                bin: 4,
                observed: 1
            }
        );
        assert!(chi_square(&[1, 2], &[1.0, f64::NAN], 5.0).is_err());
        assert!(chi_square(&[1, 2], &[1.0, 2.0], 5.0).is_err());
    }

    #[test]
    fn bins_hold_their_own_midpoints_and_nothing_outside() {
        let bins = Bins {
            rows: 101,
            columns: 202,
            range: (-1.0, 1.0),
        };
        let mut seen = vec![0; bins.count()];
        for (bin, z, turn) in bins.midpoints(2) {
            assert_eq!(bins.index(z, turn, 0.0), Some(bin));
            seen[bin] += 1;
        }
        assert!(seen.iter().all(|&n| n == 4));
        assert_eq!(bins.index(1.1, 0.0, 1e-6), None);
        assert_eq!(bins.index(f64::NAN, 0.0, 1e-6), None);
        assert_eq!(bins.index(1.0 + 1e-7, 0.999_999_999, 1e-6), Some(20_401));
        assert_eq!(bins.index(0.0, 0.0, 0.0), Some(50 * 202));
    }

    #[test]
    fn grid_covers_the_sphere_once() {
        assert!((sphere_integral(|_| 1.0) - 4.0 * PI).abs() < 1e-3);
        assert!((sphere_integral(|d| d[2].max(0.0)) - PI).abs() < 1e-3);
        assert!(sphere_integral(|d| d[0] + 2.0 * d[1]).abs() < 1e-9);
        assert!((sphere_integral(|d| d[0] * d[0]) - 4.0 * PI / 3.0).abs() < 1e-3);
        let (_, points) = equal_area_grid(1e-5, 16);
        for [x, y, z] in points {
            assert!((x * x + y * y + z * z - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn correlation_of_known_pairs() {
        let line: Vec<f32> = (0..100).map(|i| i as f32 / 100.0).collect();
        let back: Vec<f32> = line.iter().map(|a| 1.0 - a).collect();
        assert!((pearson([(&line[..], &line[..])].into_iter()) - 1.0).abs() < 1e-12);
        assert!((pearson([(&line[..], &back[..])].into_iter()) + 1.0).abs() < 1e-6);
        // The four corners of a square, in two rows of unequal ends.
        let rows = [
            (&[0.0, 0.0][..], &[0.0, 1.0, 0.7][..]),
            (&[1.0, 1.0][..], &[0.0, 1.0][..]),
        ];
        assert!(pearson(rows.into_iter()).abs() < 1e-15);
        assert_eq!(mean_variance(&[0.0, 1.0]), (0.5, 0.25));
    }

    #[test]
    fn turns_wrap() {
        assert_eq!(turn_of(0.0, 1.0), 0.25);
        assert_eq!(turn_of(1.0, -1e-30), 0.0);
        assert!((turn_distance(0.999, 0.001) - 0.002).abs() < 1e-12);
    }
}
