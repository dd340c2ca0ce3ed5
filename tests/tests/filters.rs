//! What the filters promise beyond their contracts.

use glam::Vec3;
use raytwin::contract::Value;
use raytwin::filter::spatial_reconstruct::{SPATIAL_RECONSTRUCT_EMPTY, spatial_reconstruct_add};

use raytwin_tests::derive::program;
use raytwin_tests::interval::Table;

/// WGSL leaves an implementation no other result for a constant image: the
/// mean stays the same number, and the spread stays 0.
#[test]
fn a_constant_stays_exact_on_any_implementation() {
    let kernel = raytwin::registry()
        .into_iter()
        .flat_map(|t| t.kernels)
        .find(|k| k.name == "spatial_reconstruct_add")
        .expect("registered");
    let program = program(&kernel).expect("valid WGSL");
    for (i, value) in [0.1f32, 3.3, 1000.1, 1e4, 0.0].into_iter().enumerate() {
        let color = Vec3::new(value, value * 0.7, value * 0.3);
        let (weight, pdf) = (0.3 + i as f32, 0.7f32);
        let state = spatial_reconstruct_add(SPATIAL_RECONSTRUCT_EMPTY, weight, pdf, color);
        for before in [SPATIAL_RECONSTRUCT_EMPTY, state] {
            let mut words = vec![0; kernel.words_in()];
            before.write(&mut words[..7]);
            weight.write(&mut words[7..8]);
            pdf.write(&mut words[8..9]);
            color.write(&mut words[9..]);
            let out = program
                .call(kernel.name, &words, Table::Wgsl)
                .expect("the interpreter runs it");
            for (lane, want) in [(0, color.x), (1, color.y), (2, color.z), (6, 0.0)] {
                assert!(
                    out[lane].is_exact() && out[lane].contains(want.to_bits()),
                    "{value}, lane {lane}: {:?}",
                    out[lane]
                );
            }
        }
    }
}
