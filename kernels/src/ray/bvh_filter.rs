//! Traversal that leaves out triangles by side and by mask: the pair and its
//! contract.

pub use raytwin_cpu::ray::bvh_filter::*;

/// The WGSL twin, without what it requires and without its callbacks.
pub const WGSL: &str = raytwin_wgsl::ray::BVH_FILTER;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::bvh::parts::{self, Line, bvh, inside, lines, open};
    use super::bvh::{BVH_MISS, BvhHit};
    use super::ray::{Ray, WideRay};
    use crate::contract::{Kernel, domains};
    use std::sync::OnceLock;

    const SOURCE: &str = "ray/bvh; the side by the signs of the edge functions, Woop, Benthin and \
                          Wald 2013, JCGT 2(1)";
    const WHY: &str = "the kernel reads a tree through callbacks and loops over it; its t, u and v \
                       are those of ray/triangle's watertight test, whose bounds hold here, and \
                       which triangle is hit is checked against every triangle left in f64";
    const FIXTURE: &str = concat!(
        parts::fixture!(),
        "fn bvh_read_mask(primitive: u32) -> u32 {
    return raytwin_fixture[arrayLength(&raytwin_fixture) - 256u + primitive];
}
"
    );

    // Every seventh triangle is there for nobody.
    fn mask_of(primitive: u32) -> u32 {
        match primitive % 7 {
            0 => 0,
            1 | 2 => 1,
            3 | 4 => 2,
            5 => 3,
            _ => 0x8000_0000,
        }
    }
    fn masks() -> &'static [u32; 256] {
        static MASKS: OnceLock<[u32; 256]> = OnceLock::new();
        MASKS.get_or_init(|| std::array::from_fn(|i| mask_of(i as u32)))
    }
    fn closest(ray: Ray, faces: u32, mask: u32) -> BvhHit {
        bvh_closest_of(&bvh().view(), masks(), ray, faces, mask)
    }
    fn any(ray: Ray, faces: u32, mask: u32) -> u32 {
        bvh_any_of(&bvh().view(), masks(), ray, faces, mask)
    }
    fn seen(line: &Line, faces: u32, mask: u32) -> bool {
        mask_of(line.primitive) & mask != 0 && (faces != BVH_FACES_FRONT || line.front)
    }
    fn first(ray: WideRay, faces: u32, mask: u32) -> Option<Line> {
        lines(ray)
            .into_iter()
            .filter(|l| inside(ray, l) && seen(l, faces, mask))
            .min_by(|a, b| a.t.total_cmp(&b.t))
    }
    // A triangle too flat to tell its side counts from both.
    fn undecided(ray: WideRay, _faces: u32, mask: u32) -> bool {
        lines(ray).iter().any(|l| seen(l, 0, mask) && open(ray, l))
    }

    let words = {
        let mut words = parts::words();
        words.extend(masks());
        words
    };
    let asked = parts::rays()
        .and(domains::range(0.0, 2.0))
        .and(domains::range(0.0, 5.0))
        .map(|((ray, faces), mask)| {
            let mask = [1, 2, 3, 0x8000_0000, u32::MAX][(mask as usize).min(4)];
            (ray, faces as u32 & 1, mask)
        });
    let [along, zeros, diagonal, outside, short, slow] = parts::hard();
    let hard = [
        (along, 1, u32::MAX),
        (zeros, 1, 2),
        (diagonal, 0, 1),
        (outside, 1, u32::MAX),
        (short, 0, 3),
        (slow, 1, 1),
        // Nobody.
        (along, 0, 0),
        // A value that means nothing means both sides.
        (along, 7, 0x8000_0000),
    ];

    vec![
        Kernel::new(
            "ray/bvh_filter",
            "bvh_closest_of",
            ["ray", "faces", "mask"],
            closest,
            |ray: WideRay, faces: u32, mask: u32| match first(ray, faces, mask) {
                Some(line) => (line.t, line.weights[1], line.weights[2], line.primitive),
                None => (ray.3, 0.0, 0.0, BVH_MISS),
            },
            asked.clone(),
        )
        .scale_by(|ray: WideRay, faces: u32, mask: u32| {
            parts::scale(ray, first((ray.0, ray.1, 0.0, f64::MAX), faces, mask))
        })
        .undecided(undecided)
        .few_ulp(2.75, 13.5)
        .by_analysis(WHY)
        .hard(hard)
        .fixture(FIXTURE, words.clone())
        .source(SOURCE)
        .build(),
        Kernel::new(
            "ray/bvh_filter",
            "bvh_any_of",
            ["ray", "faces", "mask"],
            any,
            |ray: WideRay, faces: u32, mask: u32| u32::from(first(ray, faces, mask).is_some()),
            asked,
        )
        .undecided(undecided)
        .few_ulp(0.0, 0.0)
        .by_analysis(WHY)
        .hard(hard)
        .fixture(FIXTURE, words)
        .source(SOURCE)
        .build(),
    ]
}
