//! Halton points: the pair and its contract.

pub use raytwin_cpu::random::halton::*;

/// The WGSL twin.
pub const WGSL: &str = raytwin_wgsl::random::HALTON;

#[cfg(feature = "contract")]
crate::value_struct!(HaltonState {
    dimension: u32,
    index: u32,
});
#[cfg(feature = "contract")]
crate::value_struct!(HaltonDraw {
    state: HaltonState,
    value: f32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};

    const ENUMERATION: &str =
        "Gruenschloss, Raab and Keller 2012; Ray Tracing Gems ch. 25, section 25.5";
    const HALTON: &str = "Halton 1964; van der Corput 1935";

    // Digits as a list: nothing in common with the twins' running products.
    fn digits(mut n: u64, base: u64, count: usize) -> Vec<u64> {
        let mut out = Vec::new();
        while out.len() < count {
            out.push(n % base);
            n /= base;
        }
        out
    }
    fn mirrored(n: u32, base: u64, count: u32) -> u64 {
        digits(u64::from(n), base, count as usize)
            .iter()
            .fold(0, |value, digit| value * base + digit)
    }
    // The exact ratio in 128 bits; its f64 is right to 2^-53.
    fn radical_inverse(base: u32, index: u32) -> f64 {
        if base < 2 {
            return 0.0;
        }
        let (mut top, mut bottom) = (0u128, 1u128);
        for digit in digits(u64::from(index), u64::from(base), 33) {
            if bottom > u128::from(u64::MAX) {
                break;
            }
            top = top * u128::from(base) + u128::from(digit);
            bottom *= u128::from(base);
        }
        top as f64 / bottom as f64
    }
    // The one number below 256·729 with these two remainders, by search in
    // steps of 256 instead of by the constants of the twins.
    fn index(x: u32, y: u32, i: u32) -> u32 {
        let column = mirrored(x % 256, 2, 8) as u32;
        let row = mirrored(y % 729, 3, 6) as u32;
        let offset = (0..729)
            .map(|k| column + 256 * k)
            .find(|n| n % 729 == row)
            .expect("256 and 729 share no factor");
        offset + (i % 23_014) * 186_624
    }

    let base = domains::below(255).map(|b| b + 2);
    let prime = domains::below(32).map(|d| HALTON_PRIMES[d as usize]);
    let bases = base
        .and(prime)
        .and(domains::any_u32())
        .map(|((any, prime), w)| if w & 3 == 0 { any } else { prime });
    // Small indices are what renderers use; large ones are where code breaks.
    let indices = domains::any_u32()
        .and(domains::below(1 << 16))
        .and(domains::any_u32())
        .map(|((far, near), w)| if w & 1 == 0 { near } else { far });

    vec![
        Kernel::new(
            "random/halton",
            "halton_reverse_base_two",
            ["index", "digits"],
            halton_reverse_base_two,
            |n: u32, count: u32| mirrored(n, 2, count) as u32,
            (domains::any_u32(), domains::below(33)),
        )
        .bit_exact()
        .hard([(u32::MAX, 0), (u32::MAX, 32), (1, 32), (0, 8), (255, 8)])
        .source(ENUMERATION)
        .build(),
        Kernel::new(
            "random/halton",
            "halton_reverse_base_three",
            ["index", "digits"],
            halton_reverse_base_three,
            |n: u32, count: u32| mirrored(n, 3, count) as u32,
            (domains::any_u32(), domains::below(21)),
        )
        .bit_exact()
        .hard([(u32::MAX, 20), (u32::MAX, 0), (728, 6), (3_486_784_400, 20)])
        .source(ENUMERATION)
        .build(),
        Kernel::new(
            "random/halton",
            "halton_index",
            ["x", "y", "i"],
            halton_index,
            index,
            (domains::any_u32(), domains::any_u32(), indices.clone()),
        )
        .bit_exact()
        .hard([
            (0, 0, 0),
            (255, 728, 23_013),
            (255, 728, 23_014),
            (256, 729, 1),
            (u32::MAX, u32::MAX, u32::MAX),
        ])
        .source(ENUMERATION)
        .build(),
        Kernel::new(
            "random/halton",
            "halton_init",
            ["x", "y", "path", "paths", "frame", "frame_loop"],
            halton_init,
            |x: u32, y: u32, path: u32, paths: u32, frame: u32, frame_loop: u32| {
                let (paths, frame_loop) = (paths.max(1), frame_loop.max(1));
                let i = u64::from(frame % frame_loop) * u64::from(paths) + u64::from(path % paths);
                (2, index(x, y, i as u32))
            },
            (
                domains::any_u32(),
                domains::any_u32(),
                domains::any_u32(),
                domains::below(64),
                domains::any_u32(),
                domains::below(1024),
            ),
        )
        .bit_exact()
        .hard([
            (0, 0, 0, 1, 0, 1),
            (5, 7, 9, 0, 11, 0),
            (1, 2, 3, 4, u32::MAX, 256),
        ])
        .source(ENUMERATION)
        .build(),
        Kernel::new(
            "random/halton",
            "halton_prime",
            ["dimension"],
            halton_prime,
            |dimension: u32| {
                (2u32..)
                    .filter(|n| (2..*n).all(|d| n % d != 0))
                    .nth(dimension as usize % 32)
                    .expect("there is always another prime")
            },
            (indices.clone(),),
        )
        .bit_exact()
        .hard([0, 31, 32, u32::MAX].map(|d| (d,)))
        .source(HALTON)
        .build(),
        Kernel::new(
            "random/halton",
            "halton_radical_inverse",
            ["base", "index"],
            halton_radical_inverse,
            radical_inverse,
            (bases, indices.clone()),
        )
        .few_ulp(1.5, 4.5)
        .scale(0.5)
        .hard([
            (2, u32::MAX),
            (3, 3_486_785_458),
            (3, u32::MAX),
            (5, 1_220_706_588),
            (7, 1_977_327_827),
            (131, 294_500_312),
            (131, u32::MAX),
            (256, u32::MAX),
            (3, 12_582_914),
            (7, 12_582_912),
            (11, 11_534_346),
            (3, 0),
            (3, 4_782_968),
            (3, 43_046_720),
            // No digits: neither a division by zero nor a loop without end.
            (0, 7),
            (1, 7),
        ])
        .source(HALTON)
        .build(),
        Kernel::new(
            "random/halton",
            "halton_sample",
            ["dimension", "index"],
            halton_sample,
            |dimension: u32, index: u32| {
                radical_inverse(HALTON_PRIMES[dimension as usize % 32], index)
            },
            (domains::below(64), indices.clone()),
        )
        .few_ulp(1.5, 4.5)
        .scale(0.5)
        .hard([(0, u32::MAX), (31, u32::MAX), (32, 1), (u32::MAX, 1)])
        .source(HALTON)
        .build(),
        Kernel::new(
            "random/halton",
            "halton_next",
            ["state"],
            halton_next,
            |(dimension, index): (u32, u32)| {
                (
                    (dimension.wrapping_add(1), index),
                    radical_inverse(HALTON_PRIMES[dimension as usize % 32], index),
                )
            },
            (domains::below(64)
                .and(indices)
                .map(|(dimension, index)| HaltonState { dimension, index }),),
        )
        .few_ulp(1.5, 4.5)
        .scale(0.5)
        .hard(
            [(u32::MAX, 1), (2, 0), (31, u32::MAX)]
                .map(|(dimension, index)| (HaltonState { dimension, index },)),
        )
        .source(HALTON)
        .build(),
        Kernel::new(
            "random/halton",
            "halton_rotate",
            ["u", "shift"],
            halton_rotate,
            |u: f64, shift: f64| {
                let grid = 16_777_216.0;
                (((u * grid).floor() + (shift * grid).floor()) / grid).fract()
            },
            (
                domains::unit()
                    .and(domains::log_range(1e-9, 0.99))
                    .and(domains::any_u32())
                    .map(|((u, fine), w)| if w & 1 == 0 { u } else { fine }),
                domains::unit(),
            ),
        )
        .bit_exact()
        .hard([
            (0.0, 0.0),
            (0.99999994, 0.99999994),
            (0.99999994, 5.9604645e-8),
            (0.5, 0.5),
            (1e-9, 0.0),
        ])
        .source("Cranley and Patterson 1976")
        .build(),
    ]
}
