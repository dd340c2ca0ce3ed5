//! What the reflections must be, on a small picture.

use raytwin_tests::gpu;
use raytwin_tests::scene::Scene;

use super::*;

const SETTINGS: ReflectionSettings = ReflectionSettings {
    width: 160,
    height: 90,
    reference_samples: 128,
    frames: 6,
    repeats: 1,
};

fn toy() -> StageScene {
    StageScene::new(Scene::toy_room()).unwrap()
}

fn row(run: &ReflectionRun, neighbours: u32, bilateral: bool) -> &ReflectionResult {
    run.results
        .iter()
        .find(|r| r.neighbours == neighbours && r.bilateral == bilateral)
        .unwrap()
}

/// More neighbours and the filter each reduce variance and error, and a
/// quarter of a ray with both is better than a ray.
#[test]
fn neighbours_help() {
    let scene = toy();
    let scene = ReflectionScene::new(&scene).unwrap();
    let run = measure(&scene, 0, &SETTINGS, &[Backend::Cpu], &|_| ()).unwrap();
    for bilateral in [false, true] {
        let worth = NEIGHBOURS.map(|n| row(&run, n, bilateral).rays_by_variance.unwrap());
        assert!(worth.is_sorted(), "{worth:?}");
    }
    for n in NEIGHBOURS {
        let [plain, filtered] = [false, true].map(|b| row(&run, n, b));
        assert!(filtered.rmse < plain.rmse, "{n}: {filtered:?} {plain:?}");
    }
    assert!(row(&run, 16, true).rmse < 0.75 * row(&run, 0, false).rmse);
    // On average it is as bright: the ratio's bias is small.
    let mean = |variant: &str| {
        let picture = run.pictures.iter().find(|p| p.variant == variant).unwrap();
        picture
            .image
            .data
            .iter()
            .map(|v| f64::from(*v))
            .sum::<f64>()
    };
    let ratio = mean("filtered") / mean("reference");
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
}

/// The two programs give one picture.
#[test]
fn adapters_give_the_same_pictures() {
    let scene = toy();
    let scene = ReflectionScene::new(&scene).unwrap();
    let settings = ReflectionSettings {
        reference_samples: 1,
        frames: 2,
        ..SETTINGS
    };
    for gpu in gpu::adapters().unwrap() {
        let program = ReflectionGpu::new(gpu).unwrap();
        for view in 0..scene.views().len() {
            let run = measure(&scene, view, &settings, &[Backend::Gpu(&program)], &|_| ()).unwrap();
            assert_eq!(run.results.len(), 1 + 2 * NEIGHBOURS.len());
            for r in &run.results {
                let differing = r.differing.unwrap();
                // Rays that meet an edge on one and pass it on the other.
                assert!(
                    differing * 200 <= r.pixels && r.pixels > 1000,
                    "{}: {differing} of {} differ with {} neighbours",
                    r.backend,
                    r.pixels,
                    r.neighbours
                );
            }
        }
    }
}

/// Metals and coats reflect no more than they get, and a coat takes its part.
#[test]
fn albedos_are_sound() {
    let scene = toy();
    let scene = ReflectionScene::new(&scene).unwrap();
    for ball in &scene.balls {
        for albedo in &ball.albedo {
            assert!(
                albedo.min_element() > 0.0 && albedo.max_element() <= 1.02,
                "{albedo}"
            );
        }
    }
    let straight = |k: usize| scene.balls[k].albedo[ALBEDOS - 1];
    assert!((straight(0).x - 0.955).abs() < 5e-3, "{}", straight(0));
    assert!(straight(6).x < straight(0).x);
}

#[test]
fn a_scene_without_a_place_has_no_balls() {
    let scene = StageScene::new(Scene::seen_whole("other".into(), Scene::toy_room().mesh)).unwrap();
    assert!(ReflectionScene::new(&scene).is_none());
}
