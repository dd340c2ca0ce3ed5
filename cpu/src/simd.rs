//! The widest vector instructions that the machine has, chosen when it runs.
//!
//! A build for x86-64 in general may only use vectors of four numbers. Loops
//! that run under `run` are compiled for wider ones too. All levels give the
//! same bits: each operation is rounded for itself, and nothing is fused.
//!
//! Beside the traversal (`pass/bvh8`), which is written in vector instructions,
//! this is the one file of the crate with `unsafe`.

/// Vector instructions; each level has those before it.
///
/// ```
/// use raytwin_cpu::simd::SimdLevel;
///
/// // The levels are ordered: each has the instructions of those before it.
/// assert!(SimdLevel::Baseline < SimdLevel::Avx512);
/// assert!(SimdLevel::Baseline.is_available());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimdLevel {
    /// What the crate was compiled for.
    Baseline,
    /// AVX2, on x86-64: eight numbers.
    Avx2,
    /// AVX-512 F, BW, DQ and VL, on x86-64: sixteen numbers, twice the registers.
    Avx512,
}

impl SimdLevel {
    /// All of them, the narrowest first.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// Whether this machine has it.
    ///
    /// ```
    /// use raytwin_cpu::simd::SimdLevel;
    ///
    /// let here: Vec<_> =
    ///     SimdLevel::ALL.into_iter().filter(|level| level.is_available()).collect();
    /// assert_eq!(here.first(), Some(&SimdLevel::Baseline));
    /// ```
    #[must_use]
    pub fn is_available(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        {
            match self {
                Self::Baseline => true,
                Self::Avx2 => is_x86_feature_detected!("avx2"),
                Self::Avx512 => {
                    is_x86_feature_detected!("avx2")
                        && is_x86_feature_detected!("avx512f")
                        && is_x86_feature_detected!("avx512bw")
                        && is_x86_feature_detected!("avx512dq")
                        && is_x86_feature_detected!("avx512vl")
                }
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            self == Self::Baseline
        }
    }

    /// The widest that this machine has.
    ///
    /// ```
    /// use raytwin_cpu::simd::SimdLevel;
    ///
    /// let best = SimdLevel::best();
    /// assert!(best.is_available());
    /// assert!(SimdLevel::ALL.iter().all(|l| !l.is_available() || *l <= best));
    /// ```
    #[must_use]
    pub fn best() -> Self {
        let mut best = Self::Baseline;
        for level in Self::ALL {
            if level.is_available() {
                best = level;
            }
        }
        best
    }
}

/// Something that is compiled once for each level.
pub(crate) trait Work {
    /// Does it. Must be `#[inline(always)]`, with all that it calls in its inner
    /// loops: what is not inlined keeps the instructions of the crate's build.
    fn run(self);
}

/// Does it at a level, or as the crate was compiled where the machine has not
/// that level.
pub(crate) fn run(level: SimdLevel, work: impl Work) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn avx2(work: impl Work) {
            work.run();
        }
        #[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
        fn avx512(work: impl Work) {
            work.run();
        }
        if level == SimdLevel::Avx512 && level.is_available() {
            // SAFETY: the function is safe on machines with the instructions it
            // enables, and `is_available` has asked for each of them.
            return unsafe { avx512(work) };
        }
        if level == SimdLevel::Avx2 && level.is_available() {
            // SAFETY: as above.
            return unsafe { avx2(work) };
        }
    }
    let _ = level;
    work.run();
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32], &'a mut f32);

    impl Work for Sum<'_> {
        #[inline(always)]
        fn run(self) {
            *self.1 = self.0.iter().map(|x| x * x).fold(0.0, |a, b| a + b);
        }
    }

    #[test]
    fn every_level_runs_and_gives_the_same_bits() {
        assert!(SimdLevel::Baseline.is_available() && SimdLevel::best().is_available());
        let data: Vec<f32> = (0..1000u16).map(|i| 0.1 * f32::from(i)).collect();
        let at = |level| {
            let mut sum = 0.0;
            run(level, Sum(&data, &mut sum));
            sum
        };
        let baseline = at(SimdLevel::Baseline);
        assert!(baseline > 3e6);
        for level in SimdLevel::ALL {
            assert_eq!(at(level), baseline, "{level:?}");
        }
    }
}
