//! What WGSL leaves an implementation for a constant image: nothing.
//!
//! Interval arithmetic over WGSL's accuracy table runs the filters' own text
//! over callbacks that give one value everywhere, on surfaces that do not.

use raytwin_tests::interval::{Program, Table};

const VALUES: [f32; 6] = [0.0, 0.1, 0.7, 3.3, 1000.1, 65000.0];

// Callbacks over a constant image; the value goes in for VALUE.
const CALLBACKS: &str = "
fn test_hash(at: vec2u) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    return (h ^ (h >> 15u)) & 255u;
}
fn firefly_read(at: vec2u) -> vec3f {
    return vec3f(VALUE, VALUE, VALUE);
}
fn taa_read(at: vec2u) -> vec3f {
    return vec3f(VALUE, 0.75 * VALUE, 0.5 * VALUE);
}
fn test_taa(x: u32, y: u32) -> f32 {
    let old = vec3f(VALUE, 0.75 * VALUE, 0.5 * VALUE);
    let new_color = taa_pixel(vec2u(x, y), vec2u(16u, 12u), old, 0.1, 1.0);
    return max(abs(new_color.y - old.y), abs(new_color.z - old.z)) + new_color.x;
}
fn bilateral_upsample_read_surface(pixel: vec2u) -> BilateralUpsampleSurface {
    let z = f32(test_hash(pixel)) * 0.00390625;
    return BilateralUpsampleSurface(vec3f(0.0, 0.0, z), 1.0, vec3f(0.0, 0.0, 1.0));
}
fn bilateral_upsample_read_tap(at: vec2u) -> BilateralUpsampleTap {
    let z = f32(test_hash(at)) * 0.00390625;
    return BilateralUpsampleTap(
        vec3f(VALUE, VALUE, VALUE), z, vec3f(0.0, 0.0, z), vec3f(0.0, 0.0, 1.0),
    );
}
fn separable_blur_read(at: vec2u) -> SeparableBlurPixel {
    let z = f32(test_hash(at)) * 0.00390625;
    return SeparableBlurPixel(vec3f(0.0, 0.0, z), 1.0, vec3f(0.0, 0.0, 1.0), VALUE);
}
";

const MODULES: [&str; 4] = [
    "filter/firefly",
    "filter/bilateral_upsample",
    "filter/separable_blur",
    "temporal/taa",
];

#[test]
fn stay_exact_on_any_implementation() {
    let library = raytwin::wgsl::link(&MODULES).expect("registered");
    for value in VALUES {
        let source = library.clone() + &CALLBACKS.replace("VALUE", &format!("{value:?}"));
        let program = Program::parse(&source).unwrap_or_else(|e| panic!("{e}"));
        let gamma = 4f32.to_bits();
        for (x, y) in [(0, 0), (7, 5), (15, 11), (3, 8)] {
            for (function, arguments) in [
                ("firefly_cap_pixel", vec![x, y, 16, 12]),
                ("firefly_rank_pixel", vec![x, y, 16, 12]),
                ("firefly_clamp_pixel", vec![x, y, 16, 12, gamma]),
                ("bilateral_upsample_pixel", vec![x, y, 8, 6, 2]),
                ("bilateral_upsample_pixel", vec![x, y, 4, 3, 4]),
                ("separable_blur_pixel", vec![x, y, 16, 12, 0, 5]),
                ("separable_blur_pixel", vec![x, y, 16, 12, 1, 5]),
                ("test_taa", vec![x, y]),
            ] {
                let out = program
                    .call(function, &arguments, Table::Wgsl)
                    .unwrap_or_else(|e| panic!("{function}: {e}"));
                for lane in out {
                    assert!(
                        lane.is_exact() && lane.contains(value.to_bits()),
                        "{function} at {x}, {y} of {value}: {lane:?}"
                    );
                }
            }
        }
    }
}

// All rays alike; WORD is what every block holds.
const RAYS: &str = "
fn packed_visibility_read(block: vec2u) -> u32 {
    return WORD;
}
fn packed_visibility_read_row(pixel: vec2u) -> u32 {
    return packed_visibility_horizontal(pixel, vec2u(45u, 30u));
}
";

#[test]
fn full_light_and_full_shadow_stay_exact_on_any_implementation() {
    let library = raytwin::wgsl::link(&["temporal/visibility_clamp"]).expect("registered");
    for (word, value) in [("0u", 0.0f32), ("0xffffffffu", 1.0)] {
        let source = library.clone() + &RAYS.replace("WORD", word);
        let program = Program::parse(&source).unwrap_or_else(|e| panic!("{e}"));
        for (x, y) in [(0, 0), (22, 15), (44, 29), (44, 3)] {
            for history in [0.0f32, 0.3, 1.0, 1e30] {
                for gamma in [0.0f32, 0.5, 2.0] {
                    let arguments = [x, y, 45, 30, history.to_bits(), gamma.to_bits()];
                    for function in ["visibility_clamp_pixel", "visibility_clamp_rows_pixel"] {
                        let out = program
                            .call(function, &arguments, Table::Wgsl)
                            .unwrap_or_else(|e| panic!("{function}: {e}"));
                        assert!(
                            out.len() == 1 && out[0].is_exact() && out[0].contains(value.to_bits()),
                            "{function} at {x}, {y} of {value}: {out:?}"
                        );
                    }
                }
            }
        }
    }
}
