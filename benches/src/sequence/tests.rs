//! What filters over time must do, on a small picture.

use raytwin_tests::scene::Scene;

use super::*;
use crate::stages::StageScene;

const SETTINGS: SequenceSettings = SequenceSettings {
    width: 192,
    height: 108,
    frames: 24,
    reference_samples: 64,
    all: true,
};

fn run(signal: Signal, event: Event) -> SequenceRun {
    let scene = StageScene::new(Scene::toy_room()).unwrap();
    let balls = ReflectionScene::new(&scene).unwrap();
    let run = measure(&balls, signal, event, &SETTINGS, &|_| ()).unwrap();
    for r in &run.results {
        println!(
            "{} {} {}: {:.2} ms, rmse {:.4} (reference {:.4}), flip {:.3}, ssim {:.3}, flicker {:.4}, half-life {:?}",
            r.signal,
            r.event,
            r.variant,
            r.ms,
            r.rmse,
            r.reference_rmse,
            r.flip,
            r.ssim,
            r.flicker,
            r.half_life
        );
    }
    assert!(run.pictures.len() == 3 && run.pictures.iter().all(|p| p.png.len() > 100));
    run
}

fn row<'a>(run: &'a SequenceRun, name: &str) -> &'a SequenceResult {
    let found = run.results.iter().find(|r| r.variant == name);
    found.unwrap_or_else(|| panic!("no variant {name}"))
}

#[test]
fn frames_do_not_depend_on_the_run_or_its_threads() {
    for scene in [Scene::toy_room(), Scene::kitchen().unwrap()] {
        let scene = StageScene::new(scene).unwrap();
        let room = &scene.scene;
        let balls = ReflectionScene::new(&scene).unwrap_or_else(|| ReflectionScene::bare(&scene));
        let film = Film::new(&balls, Signal::SoftShadow, UVec2::new(96, 54));
        let at = |n| moment(Event::Pan, room.camera, room, balls.back, n, 8);
        let bits = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let frame = pool
                .build()
                .unwrap()
                .install(|| film.frame(&at(5), &at(4), 5));
            let bits = |v: &Vec3| v.to_array().map(f32::to_bits);
            frame.unwrap().noisy.iter().map(bits).collect::<Vec<_>>()
        };
        let once = bits(1);
        assert!(once.iter().any(|v| *v != once[0]), "nothing to see");
        assert!(bits(1) == once && bits(2) == once);
    }
}

const AVERAGE: &str = "average of 32 frames";

fn passes(n: u32) -> String {
    format!("SVGF, {n} passes")
}

#[test]
fn still_images_converge_and_passes_help() {
    for signal in [Signal::SoftShadow, Signal::AmbientOcclusion] {
        let run = run(signal, Event::Still);
        let rmse = |v: &str| row(&run, v).rmse;
        assert!(rmse(AVERAGE) < 0.4 * rmse("1 spp"));
        assert!(rmse(&passes(0)) < 0.6 * rmse("1 spp"));
        // The passes blur the penumbras of thin slats; occlusion is smooth.
        if signal == Signal::AmbientOcclusion {
            assert!(rmse(&passes(3)) < 0.6 * rmse(&passes(0)));
        }
        let ssim = |v: &str| row(&run, v).ssim;
        assert!(ssim(&passes(3)) > ssim("1 spp"));
        for r in &run.results {
            assert!(r.half_life.is_none() && r.by_frame.len() == 24);
            assert!(r.flicker <= row(&run, "1 spp").flicker);
            assert!(r.reference_rmse < 0.3 * row(&run, "1 spp").rmse);
        }
        // A still camera has the same history wherever it is looked for, and a
        // scalar as a colour is the same number three times.
        let ratio = rmse("SVGF, 3 passes, as RGB") / rmse(&passes(3));
        assert!((ratio - 1.0).abs() < 1e-5, "{ratio}");
    }
}

#[test]
fn a_short_history_forgets_a_light_sooner() {
    let run = run(Signal::SoftShadow, Event::LightJumps);
    let life = |v: &str| row(&run, v).half_life;
    // Nothing is kept, so nothing has to go.
    assert_eq!(life("1 spp"), Some(0));
    // Five frames have half of a change after three; an average of all twelve
    // so far after as many again.
    let short = life(&passes(0)).unwrap();
    assert!((2..=4).contains(&short), "{short}");
    assert!(life(&passes(5)).unwrap() >= short - 1);
    assert_eq!(life(AVERAGE), Some(11));
    assert!(life("average of 32 frames, clamped").unwrap() <= 2);
    assert!(life("average of 32 frames, clamped by 17 x 17 rays").unwrap() <= 2);
    // What is left out would not have changed.
    let tiles = row(&run, "SVGF, 3 passes, tiles left out");
    assert_eq!(tiles.by_frame, row(&run, &passes(3)).by_frame);
}

#[test]
fn history_follows_what_moves() {
    for (signal, event) in [
        (Signal::AmbientOcclusion, Event::Pan),
        (Signal::AmbientOcclusion, Event::Dolly),
        (Signal::AmbientOcclusion, Event::Turn),
        (Signal::SoftShadow, Event::Ball),
    ] {
        let run = run(signal, event);
        let rmse = |v: &str| row(&run, v).rmse;
        assert!(rmse(&passes(3)) < rmse("SVGF, 3 passes, not reprojected"));
        assert!(rmse(&passes(3)) < rmse("SVGF, 3 passes, reprojected without tests"));
        // Where the camera moves the history is somewhere else everywhere; a
        // moving shadow has none on what it falls on, unless that is clamped.
        if event == Event::Ball {
            assert!(rmse("average of 32 frames, clamped") < 0.8 * rmse(AVERAGE));
        } else {
            assert!(rmse(AVERAGE) < 0.6 * rmse("1 spp"));
            assert!(rmse(&passes(3)) < 0.8 * rmse("SVGF, 3 passes, not reprojected"));
        }
        assert!(row(&run, &passes(3)).flicker < 0.5 * row(&run, "1 spp").flicker);
    }
}

#[test]
fn reflections_move_otherwise_than_what_reflects() {
    let run = run(Signal::Reflection, Event::Pan);
    let rmse = |v: &str| row(&run, v).rmse;
    assert!(rmse(&passes(1)) < rmse("quarter ray"));
    assert!(rmse("SVGF, 3 passes, hit point") < rmse("SVGF, 3 passes, not reprojected"));
    let tiles = row(&run, "SVGF, 3 passes, tiles left out");
    assert_eq!(tiles.by_frame, row(&run, &passes(3)).by_frame);
}
