//! PCG hashes: the pair and its contract.

pub use raytwin_cpu::random::pcg::*;

/// The WGSL twin.
pub const WGSL: &str = raytwin_wgsl::random::PCG;

#[cfg(feature = "contract")]
crate::value_struct!(PcgDraw {
    state: u32,
    value: u32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{UVec2, UVec3, UVec4};

    const PAPER: &str = "Jarzynski and Olano 2020, JCGT 9(3), section 4";

    // The truths work in 64 bits modulo 2^32, over arrays of any length.
    const M: u64 = 1 << 32;
    fn lcg<const N: usize>(v: [u32; N]) -> [u64; N] {
        v.map(|x| (u64::from(x) * 1_664_525 + 1_013_904_223) % M)
    }
    fn fold<const N: usize>(v: [u64; N]) -> [u64; N] {
        v.map(|x| x ^ (x / 65_536))
    }
    fn narrow<const N: usize>(v: [u64; N]) -> [u32; N] {
        v.map(|x| x as u32)
    }
    // v[into] += v[a]·v[b], for each triple in turn.
    fn mix<const N: usize>(mut v: [u64; N], steps: &[(usize, usize, usize)]) -> [u64; N] {
        for &(into, a, b) in steps {
            v[into] = (v[into] + (v[a] * v[b]) % M) % M;
        }
        v
    }
    fn mix_two(v: [u64; 2]) -> [u64; 2] {
        let x = (v[0] + v[1] * 1_664_525) % M;
        [x, (v[1] + x * 1_664_525) % M]
    }
    fn hash(v: u32) -> u32 {
        let s = (u64::from(v) * 747_796_405 + 2_891_336_453) % M;
        let shift = s / (1 << 28) + 4;
        let word = ((s / (1 << shift)) ^ s) * 277_803_737 % M;
        ((word / (1 << 22)) ^ word) as u32
    }
    const THREE: [(usize, usize, usize); 3] = [(0, 1, 2), (1, 2, 0), (2, 0, 1)];
    const FOUR: [(usize, usize, usize); 4] = [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)];
    fn three(v: UVec3) -> UVec3 {
        UVec3::from_array(narrow(mix(fold(mix(lcg(v.to_array()), &THREE)), &THREE)))
    }

    vec![
        Kernel::new(
            "random/pcg",
            "pcg_hash",
            ["v"],
            pcg_hash,
            hash,
            (domains::any_u32(),),
        )
        .bit_exact()
        .hard([0, 1, 2, u32::MAX, 0x8000_0000].map(|v| (v,)))
        .source("O'Neill 2014, RXS-M-XS 32/32; Jarzynski and Olano 2020")
        .build(),
        Kernel::new(
            "random/pcg",
            "pcg2d",
            ["v"],
            pcg2d,
            |v: UVec2| UVec2::from_array(narrow(fold(mix_two(fold(mix_two(lcg(v.to_array()))))))),
            (domains::any_uvec2(),),
        )
        .bit_exact()
        .hard([UVec2::ZERO, UVec2::MAX].map(|v| (v,)))
        .source(PAPER)
        .build(),
        Kernel::new(
            "random/pcg",
            "pcg3d",
            ["v"],
            pcg3d,
            three,
            (domains::any_uvec3(),),
        )
        .bit_exact()
        .hard([UVec3::ZERO, UVec3::MAX, UVec3::new(1, 2, 3)].map(|v| (v,)))
        .source(PAPER)
        .build(),
        Kernel::new(
            "random/pcg",
            "pcg4d",
            ["v"],
            pcg4d,
            |v: UVec4| UVec4::from_array(narrow(mix(fold(mix(lcg(v.to_array()), &FOUR)), &FOUR))),
            (domains::any_uvec4(),),
        )
        .bit_exact()
        .hard([UVec4::ZERO, UVec4::MAX, UVec4::new(1, 2, 3, 4)].map(|v| (v,)))
        .source(PAPER)
        .build(),
        Kernel::new(
            "random/pcg",
            "pcg_seed",
            ["pixel", "frame"],
            pcg_seed,
            |pixel: UVec2, frame: u32| three(UVec3::new(pixel.x, pixel.y, frame)).x,
            (domains::any_uvec2(), domains::any_u32()),
        )
        .bit_exact()
        .hard([(UVec2::ZERO, 0), (UVec2::MAX, u32::MAX)])
        .source(PAPER)
        .build(),
        Kernel::new(
            "random/pcg",
            "pcg_next",
            ["state"],
            pcg_next,
            |state: u32| {
                let next = (u64::from(state) * 747_796_405 + 2_891_336_453) % M;
                (next as u32, hash(state))
            },
            (domains::any_u32(),),
        )
        .bit_exact()
        .hard([0, u32::MAX].map(|v| (v,)))
        .source("O'Neill 2014, RXS-M-XS 32/32")
        .build(),
        Kernel::new(
            "random/pcg",
            "pcg_unit",
            ["bits"],
            pcg_unit,
            |bits: u32| (f64::from(bits) / 256.0).floor() / 16_777_216.0,
            (domains::any_u32(),),
        )
        .bit_exact()
        .hard([0, 255, 256, u32::MAX, 0xffff_ff80].map(|v| (v,)))
        .source("24 exact bits; never 1")
        .build(),
    ]
}
