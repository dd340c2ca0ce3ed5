//! Eight numbers at a time, on each kind of processor.
//!
//! Every operation rounds as the scalar one does and none is fused, so a walk
//! gives the same bits through each implementation.

/// Eight-wide arithmetic. A value of an implementing type is the proof that
/// the processor can do it: see [`Level`](super::Level).
pub(super) trait Lanes: Copy {
    /// Eight numbers.
    type F: Copy;
    /// Eight answers.
    type M: Copy;
    /// Whether [`Self::mul_add`] is one instruction.
    const FUSED: bool;
    fn load(self, from: &[f32; 8]) -> Self::F;
    fn splat(self, value: f32) -> Self::F;
    fn store(self, value: Self::F, to: &mut [f32; 8]);
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a · b + c`, rounded once. Only where [`Self::FUSED`] says so, and only
    /// for boxes: hits are never computed with it.
    fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// `if a < b { a } else { b }`; for zeros of both signs and NaN either.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// `if a > b { a } else { b }`; for zeros of both signs and NaN either.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a <= b`.
    fn le(self, a: Self::F, b: Self::F) -> Self::M;
    /// `a < b`.
    fn lt(self, a: Self::F, b: Self::F) -> Self::M;
    /// `a == b`.
    fn eq(self, a: Self::F, b: Self::F) -> Self::M;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    fn abs(self, a: Self::F) -> Self::F;
    fn select(self, mask: Self::M, yes: Self::F, no: Self::F) -> Self::F;
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    fn xor(self, a: Self::M, b: Self::M) -> Self::M;
    /// Lane `i` as bit `i`.
    fn bits(self, mask: Self::M) -> u32;
    /// Tests a block's triangles. Out of line, so that the numbers of the box
    /// test keep their registers.
    fn leaf(self, block: &Block, ray: &LeafRay<'_>, best: &mut BvhHit);
    /// The walk of a ray with a zero in its direction, if others are fused.
    fn walk_parallel<const ANY: bool>(
        self,
        nodes: &[Node],
        blocks: &[Block],
        root: u32,
        ray: &LeafRay<'_>,
        slopes: &Slopes,
        t_max: f32,
    ) -> BvhHit;
    /// Asks for a cache line that may be read soon. Any address will do.
    fn prefetch(self, _at: *const u8) {}
}

use super::walk::{self, LeafRay, Slopes};
use super::{Block, Node};
use crate::ray::bvh::BvhHit;

/// Arrays and loops, for every processor.
#[derive(Clone, Copy)]
pub(super) struct Portable;

impl Lanes for Portable {
    type F = [f32; 8];
    type M = [bool; 8];
    const FUSED: bool = false;
    #[inline(always)]
    fn mul_add(self, a: [f32; 8], b: [f32; 8], c: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| a[i].mul_add(b[i], c[i]))
    }
    #[inline(always)]
    fn load(self, from: &[f32; 8]) -> [f32; 8] {
        *from
    }
    #[inline(always)]
    fn splat(self, value: f32) -> [f32; 8] {
        [value; 8]
    }
    #[inline(always)]
    fn store(self, value: [f32; 8], to: &mut [f32; 8]) {
        *to = value;
    }
    #[inline(always)]
    fn add(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| a[i] + b[i])
    }
    #[inline(always)]
    fn sub(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| a[i] - b[i])
    }
    #[inline(always)]
    fn mul(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| a[i] * b[i])
    }
    #[inline(always)]
    fn min(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn max(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn le(self, a: [f32; 8], b: [f32; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] <= b[i])
    }
    #[inline(always)]
    fn lt(self, a: [f32; 8], b: [f32; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] < b[i])
    }
    #[inline(always)]
    fn eq(self, a: [f32; 8], b: [f32; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] == b[i])
    }
    #[inline(always)]
    fn div(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| a[i] / b[i])
    }
    #[inline(always)]
    fn abs(self, a: [f32; 8]) -> [f32; 8] {
        a.map(f32::abs)
    }
    #[inline(always)]
    fn select(self, mask: [bool; 8], yes: [f32; 8], no: [f32; 8]) -> [f32; 8] {
        std::array::from_fn(|i| if mask[i] { yes[i] } else { no[i] })
    }
    #[inline(always)]
    fn xor(self, a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] ^ b[i])
    }
    #[inline(always)]
    fn and(self, a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] & b[i])
    }
    #[inline(always)]
    fn or(self, a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] | b[i])
    }
    #[inline(always)]
    fn bits(self, mask: [bool; 8]) -> u32 {
        (0..8).fold(0, |bits, i| bits | u32::from(mask[i]) << i)
    }
    fn walk_parallel<const ANY: bool>(
        self,
        nodes: &[Node],
        blocks: &[Block],
        root: u32,
        ray: &LeafRay<'_>,
        slopes: &Slopes,
        t_max: f32,
    ) -> BvhHit {
        walk::walk_planes::<_, ANY, false>(self, nodes, blocks, root, ray, slopes, t_max)
    }
    #[inline(never)]
    fn leaf(self, block: &Block, ray: &LeafRay<'_>, best: &mut BvhHit) {
        walk::leaf(self, block, ray, best);
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    use super::{Block, BvhHit, Lanes, LeafRay, Node, Slopes, walk};
    use std::arch::x86_64::*;

    /// What AVX2 and AVX-512 have in common: registers of eight, and functions
    /// that are compiled for the features named.
    macro_rules! lanes {
        ($name:ident, $features:literal, $mask:ty, { $($own:item)* }) => {
            /// The proof that the processor has these features.
            #[derive(Clone, Copy)]
            pub(in super::super) struct $name(());

            impl $name {
                /// # Safety
                /// The processor must have the features that `Level` asks for.
                #[inline(always)]
                pub(in super::super) unsafe fn assume() -> Self {
                    Self(())
                }

                #[inline(never)]
                #[target_feature(enable = $features)]
                fn leaf_there(self, block: &Block, ray: &LeafRay<'_>, best: &mut BvhHit) {
                    walk::leaf(self, block, ray, best);
                }

                #[inline(never)]
                #[target_feature(enable = $features)]
                fn parallel_there<const ANY: bool>(
                    self,
                    nodes: &[Node],
                    blocks: &[Block],
                    root: u32,
                    ray: &LeafRay<'_>,
                    slopes: &Slopes,
                    t_max: f32,
                ) -> BvhHit {
                    walk::walk_planes::<_, ANY, false>(
                        self, nodes, blocks, root, ray, slopes, t_max,
                    )
                }
            }

            // SAFETY of every block in here: whoever holds this value has
            // promised, in `assume`, that the processor has the features;
            // loads and stores go to arrays of eight and need no alignment;
            // a prefetch reads nothing.
            impl Lanes for $name {
                type F = __m256;
                type M = $mask;
                const FUSED: bool = true;
                #[inline(always)]
                fn load(self, from: &[f32; 8]) -> __m256 {
                    unsafe { _mm256_loadu_ps(from.as_ptr()) }
                }
                #[inline(always)]
                fn splat(self, value: f32) -> __m256 {
                    unsafe { _mm256_set1_ps(value) }
                }
                #[inline(always)]
                fn store(self, value: __m256, to: &mut [f32; 8]) {
                    unsafe { _mm256_storeu_ps(to.as_mut_ptr(), value) }
                }
                #[inline(always)]
                fn add(self, a: __m256, b: __m256) -> __m256 {
                    unsafe { _mm256_add_ps(a, b) }
                }
                #[inline(always)]
                fn sub(self, a: __m256, b: __m256) -> __m256 {
                    unsafe { _mm256_sub_ps(a, b) }
                }
                #[inline(always)]
                fn mul(self, a: __m256, b: __m256) -> __m256 {
                    unsafe { _mm256_mul_ps(a, b) }
                }
                #[inline(always)]
                fn div(self, a: __m256, b: __m256) -> __m256 {
                    unsafe { _mm256_div_ps(a, b) }
                }
                #[inline(always)]
                fn mul_add(self, a: __m256, b: __m256, c: __m256) -> __m256 {
                    unsafe { _mm256_fmadd_ps(a, b, c) }
                }
                #[inline(always)]
                fn min(self, a: __m256, b: __m256) -> __m256 {
                    unsafe { _mm256_min_ps(a, b) }
                }
                #[inline(always)]
                fn max(self, a: __m256, b: __m256) -> __m256 {
                    unsafe { _mm256_max_ps(a, b) }
                }
                #[inline(always)]
                fn abs(self, a: __m256) -> __m256 {
                    unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), a) }
                }
                #[inline(always)]
                fn leaf(self, block: &Block, ray: &LeafRay<'_>, best: &mut BvhHit) {
                    unsafe { self.leaf_there(block, ray, best) }
                }
                #[inline(always)]
                fn walk_parallel<const ANY: bool>(
                    self,
                    nodes: &[Node],
                    blocks: &[Block],
                    root: u32,
                    ray: &LeafRay<'_>,
                    slopes: &Slopes,
                    t_max: f32,
                ) -> BvhHit {
                    unsafe { self.parallel_there::<ANY>(nodes, blocks, root, ray, slopes, t_max) }
                }
                #[inline(always)]
                fn prefetch(self, at: *const u8) {
                    unsafe { _mm_prefetch::<_MM_HINT_T0>(at.cast()) }
                }
                $($own)*
            }
        };
    }

    lanes!(Avx2, "avx2,fma,bmi1,bmi2,lzcnt,popcnt", __m256, {
        #[inline(always)]
        fn le(self, a: __m256, b: __m256) -> __m256 {
            unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(a, b) }
        }
        #[inline(always)]
        fn lt(self, a: __m256, b: __m256) -> __m256 {
            unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(a, b) }
        }
        #[inline(always)]
        fn eq(self, a: __m256, b: __m256) -> __m256 {
            unsafe { _mm256_cmp_ps::<_CMP_EQ_OQ>(a, b) }
        }
        #[inline(always)]
        fn select(self, mask: __m256, yes: __m256, no: __m256) -> __m256 {
            unsafe { _mm256_blendv_ps(no, yes, mask) }
        }
        #[inline(always)]
        fn xor(self, a: __m256, b: __m256) -> __m256 {
            unsafe { _mm256_xor_ps(a, b) }
        }
        #[inline(always)]
        fn and(self, a: __m256, b: __m256) -> __m256 {
            unsafe { _mm256_and_ps(a, b) }
        }
        #[inline(always)]
        fn or(self, a: __m256, b: __m256) -> __m256 {
            unsafe { _mm256_or_ps(a, b) }
        }
        #[inline(always)]
        fn bits(self, mask: __m256) -> u32 {
            unsafe { _mm256_movemask_ps(mask) as u32 }
        }
    });

    // Registers of eight too: what helps is that there are 32 of them, and
    // masks of their own.
    lanes!(
        Avx512,
        "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt",
        __mmask8,
        {
            #[inline(always)]
            fn le(self, a: __m256, b: __m256) -> __mmask8 {
                unsafe { _mm256_cmp_ps_mask::<_CMP_LE_OQ>(a, b) }
            }
            #[inline(always)]
            fn lt(self, a: __m256, b: __m256) -> __mmask8 {
                unsafe { _mm256_cmp_ps_mask::<_CMP_LT_OQ>(a, b) }
            }
            #[inline(always)]
            fn eq(self, a: __m256, b: __m256) -> __mmask8 {
                unsafe { _mm256_cmp_ps_mask::<_CMP_EQ_OQ>(a, b) }
            }
            #[inline(always)]
            fn select(self, mask: __mmask8, yes: __m256, no: __m256) -> __m256 {
                unsafe { _mm256_mask_blend_ps(mask, no, yes) }
            }
            #[inline(always)]
            fn xor(self, a: __mmask8, b: __mmask8) -> __mmask8 {
                a ^ b
            }
            #[inline(always)]
            fn and(self, a: __mmask8, b: __mmask8) -> __mmask8 {
                a & b
            }
            #[inline(always)]
            fn or(self, a: __mmask8, b: __mmask8) -> __mmask8 {
                a | b
            }
            #[inline(always)]
            fn bits(self, mask: __mmask8) -> u32 {
                u32::from(mask)
            }
        }
    );
}
