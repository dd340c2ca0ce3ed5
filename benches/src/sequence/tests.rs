//! What filters over time must do, on a small picture.

use raytwin_tests::scene::Scene;

use super::*;

const SETTINGS: SequenceSettings = SequenceSettings {
    width: 192,
    height: 108,
    frames: 24,
    reference_samples: 64,
};

fn row(run: &SequenceRun, variant: Variant) -> &SequenceResult {
    let name = variant.name();
    run.results.iter().find(|r| r.variant == name).unwrap()
}

#[test]
fn still_images_converge_and_passes_help() {
    let scene = StageScene::new(Scene::toy_room()).unwrap();
    for stage in [Stage::SoftShadow, Stage::AmbientOcclusion] {
        let run = measure(&scene, stage, Event::Still, &SETTINGS).unwrap();
        for r in &run.results {
            println!(
                "{} {}: {:.2} ms, rmse {:.4}, ssim {:.3}, flicker {:.4}",
                r.signal, r.variant, r.ms, r.rmse, r.ssim, r.flicker
            );
        }
        let rmse = |v| row(&run, v).rmse;
        assert!(rmse(Variant::Average) < 0.4 * rmse(Variant::None));
        assert!(rmse(Variant::Svgf(0)) < 0.6 * rmse(Variant::None));
        // The passes blur the penumbras of thin slats; occlusion is smooth.
        if stage == Stage::AmbientOcclusion {
            assert!(rmse(Variant::Svgf(3)) < 0.6 * rmse(Variant::Svgf(0)));
        }
        let ssim = |v| row(&run, v).ssim;
        assert!(ssim(Variant::Svgf(3)) > ssim(Variant::None));
        for r in &run.results {
            assert!(r.half_life.is_none() && r.by_frame.len() == 24);
            assert!(r.flicker <= row(&run, Variant::None).flicker);
        }
    }
}

#[test]
fn a_short_history_forgets_a_light_sooner() {
    let scene = StageScene::new(Scene::toy_room()).unwrap();
    let run = measure(&scene, Stage::SoftShadow, Event::Jump, &SETTINGS).unwrap();
    let life = |v| row(&run, v).half_life;
    // Nothing is kept, so nothing has to go.
    assert_eq!(life(Variant::None), Some(0));
    // Five frames have half of a change after three; an average of all twelve
    // so far after as many again.
    let short = life(Variant::Svgf(0)).unwrap();
    assert!((2..=4).contains(&short), "{short}");
    assert!(life(Variant::Svgf(5)).unwrap() >= short - 1);
    assert_eq!(life(Variant::Average), Some(11));
    assert!(life(Variant::Clamped).unwrap() <= 2);
}

#[test]
fn ghosts() {
    let (before, after) = ([1.0, 0.0, 0.5], [0.0, 0.0, 1.0]);
    assert_eq!(ghost(&before, &before, &after), 1.0);
    assert_eq!(ghost(&after, &before, &after), 0.0);
    assert_eq!(ghost(&[0.5, 7.0, 0.75], &before, &after), 0.5);
    assert_eq!(ghost(&after, &after, &after), 0.0);
}
