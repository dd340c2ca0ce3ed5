//! The twins agree on whole pictures, and the samplers converge as they
//! should.

use raytwin_tests::gpu::adapters;
use raytwin_tests::scene::{Mesh, Scene};

use super::*;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 36;

fn toy() -> StageScene {
    StageScene::new(Scene::toy_room()).unwrap()
}

fn tiny() -> StageSettings {
    StageSettings {
        width: WIDTH,
        height: HEIGHT,
        reference_samples: 16,
        reference_samples_software: 16,
        repeats: 1,
        convergence_width: WIDTH,
        convergence_height: HEIGHT,
        convergence_samples: 64,
        convergence_samples_software: 16,
        convergence_reference: 512,
        ..StageSettings::quick()
    }
}

/// A ray whose hit sits on an edge may fall to either side when a driver
/// fuses multiply-adds: one pixel in 256 is allowed to differ, at 16 samples
/// by how many of them do.
#[test]
fn gpu_pictures_are_the_cpus() {
    let scene = toy();
    let pixels = (WIDTH * HEIGHT) as usize;
    let mut cpu = Renderer::new(&scene, Backend::Cpu, WIDTH, HEIGHT, 2.0).unwrap();
    for gpu in adapters().unwrap() {
        let stages = GpuStages::new(gpu).unwrap();
        let mut gpu = Renderer::new(&scene, Backend::Gpu(&stages), WIDTH, HEIGHT, 2.0).unwrap();
        for stage in Stage::ALL {
            for sampler in Sampler::ALL {
                let job = Job {
                    stage,
                    sampler,
                    samples: 16,
                    frame: 3,
                };
                let a = cpu.render(&job).unwrap();
                let b = gpu.render(&job).unwrap();
                let differing = a.image.differing(&b.image, 1e-4);
                let rmse = a.image.rmse(&b.image, None);
                assert!(
                    differing <= pixels / 256 && rmse < 5e-3,
                    "{} with {} on {}: {differing} of {pixels} pixels differ, RMSE {rmse}",
                    stage.name(),
                    sampler.name(),
                    gpu.label(),
                );
                assert_eq!(a.rays, b.rays, "{}", stage.name());
                // Something must be seen, lit and shaded, or equality is empty.
                let sum: f32 = a.image.data.iter().sum();
                let mean = sum / a.image.data.len() as f32;
                assert!(mean > 0.05 && mean < 0.98, "{}: mean {mean}", stage.name());
            }
        }
    }
}

/// Many short dispatches give what one gives.
#[test]
fn dispatches_add_up() {
    let scene = toy();
    let gpu = &adapters().unwrap()[0];
    let stages = GpuStages::new(gpu).unwrap();
    let job = Job::samples(Stage::AmbientOcclusion, 256);
    let mut gpu = Renderer::new(&scene, Backend::Gpu(&stages), 77, 41, 2.0).unwrap();
    let mut cpu = Renderer::new(&scene, Backend::Cpu, 77, 41, 2.0).unwrap();
    let a = cpu.render(&job).unwrap();
    let b = gpu.render(&job).unwrap();
    let rmse = a.image.rmse(&b.image, None);
    assert!(rmse < 1e-3, "RMSE {rmse}");
}

#[test]
fn samplers_converge_at_their_rates() {
    let result = convergence(&toy(), &tiny(), &[Backend::Cpu], &|_| ()).unwrap();
    assert_eq!(result.slopes.len(), 6);
    for reference in &result.references {
        let last = result
            .points
            .iter()
            .filter(|p| p.stage == reference.stage)
            .map(|p| p.rmse)
            .fold(f64::MAX, f64::min);
        assert!(
            reference.rmse < 0.5 * last,
            "{:?}: the reference errs by {}, the best point by {last}",
            reference.stage,
            reference.rmse
        );
    }
    for stage in [Stage::SoftShadow, Stage::AmbientOcclusion] {
        let slope = |sampler| {
            result
                .slopes
                .iter()
                .find(|s| s.stage == stage && s.sampler == sampler)
                .unwrap()
                .slope
        };
        let (white, halton) = (slope(Sampler::White), slope(Sampler::Halton));
        assert!(
            (-0.6..=-0.4).contains(&white),
            "{stage:?}: white noise {white}"
        );
        assert!(
            halton < white - 0.1,
            "{stage:?}: Halton {halton}, white {white}"
        );
    }
}

#[test]
fn a_run_has_every_picture() {
    let scene = toy();
    let gpu = &adapters().unwrap()[0];
    let stages = GpuStages::new(gpu).unwrap();
    let run = run_stages(
        &scene,
        &tiny(),
        &[Backend::Cpu, Backend::Gpu(&stages)],
        &|_| (),
    )
    .unwrap();
    // Two exact stages, three sampled ones in two variants.
    assert_eq!(run.results.len(), 2 * (2 + 3 * 2));
    // Each with cpu, gpu and difference; one of all together; three samplers
    // on two stages.
    assert_eq!(run.pictures.len(), 3 * (2 + 3 * 2) + 1 + 3 * 2);
    let mut ids: Vec<_> = run.pictures.iter().map(|p| &p.id).collect();
    ids.sort();
    ids.dedup();
    assert_eq!(ids.len(), run.pictures.len());
    for r in &run.results {
        assert!(r.ms > 0.0 && r.rays > 0, "{r:?}");
        assert_eq!(r.rmse.is_none(), r.backend == "cpu" && r.variant != "1 spp");
        assert_eq!(r.differing.is_none(), r.backend == "cpu");
    }
}

/// The weighted variant lies between plain occlusion and none, and a higher
/// power comes closer to the plain one.
#[test]
fn the_power_darkens() {
    let scene = toy();
    let mean = |stage, power| {
        let mut r = Renderer::new(&scene, Backend::Cpu, WIDTH, HEIGHT, power).unwrap();
        let image = r.render(&Job::samples(stage, 16)).unwrap().image;
        image.data.iter().sum::<f32>() / image.data.len() as f32
    };
    let plain = mean(Stage::AmbientOcclusion, 2.0);
    let [half, two, many] = [0.5, 2.0, 60.0].map(|p| mean(Stage::AmbientOcclusionPower, p));
    assert!(1.0 > half && half > two && two > many && many >= plain);
    assert!(many - plain < 0.01);
}

/// A square floor, two units wide times `scale`, rising by `tilt` along x,
/// seen from above.
fn floor(scale: f32, place: f32, tilt: f32, flip: bool) -> Scene {
    let at = |x: f32, z: f32| Vec3::new(x, tilt * x, z) * scale + Vec3::splat(place);
    let triangle = |t: [u32; 3]| if flip { [t[0], t[2], t[1]] } else { t };
    let mesh = Mesh {
        positions: vec![at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)],
        indices: [[0, 2, 1], [0, 3, 2]].map(triangle).to_vec(),
        skipped: 0,
    };
    Scene::seen_whole("floor".into(), mesh)
}

/// An open floor under the light: every shadow ray gets away, so any darkness
/// is a surface that shadows itself, at whatever size and place and whichever
/// way its triangles turn.
#[test]
fn no_surface_shadows_itself() {
    let stages = GpuStages::new(&adapters().unwrap()[0]).unwrap();
    for backend in [Backend::Cpu, Backend::Gpu(&stages)] {
        for (scale, place, flip) in [
            (1.0, 0.0, false),
            (1.0, 0.0, true),
            (1e-4, 0.0, false),
            (1e4, 0.0, false),
            (1.0, 3e4, false),
        ] {
            let scene = StageScene::new(floor(scale, place, -0.31, flip)).unwrap();
            let mut r = Renderer::new(&scene, backend, WIDTH, HEIGHT, 2.0).unwrap();
            let lit = r.traced(Stage::HardShadow).iter().filter(|t| **t).count();
            let case = format!("{}, scale {scale}, place {place}, {flip}", r.label());
            assert!(lit > 200, "{case}: {lit} pixels face the light");
            for stage in &Stage::ALL[1..] {
                let image = r.render(&Job::samples(*stage, 4)).unwrap().image;
                let dark = image.data.iter().filter(|v| **v < 1.0).count();
                assert_eq!(dark, 0, "{case}: {} is dark", stage.name());
            }
        }
    }
}

/// Of a light that is setting, the floor gets what is above the horizon.
#[test]
fn the_horizon_cuts_the_light() {
    let stages = GpuStages::new(&adapters().unwrap()[0]).unwrap();
    let mut scene = floor(1.0, 0.0, 0.0, false);
    scene.light = raytwin_tests::scene::Light::towards(Vec3::new(-0.6, 0.005, 0.8));
    let height = f64::from(scene.light.direction.y / scene.light.angular_radius);
    // Area of a disc above a chord.
    let expected =
        1.0 - (height.acos() - height * (1.0 - height * height).sqrt()) / std::f64::consts::PI;
    let scene = StageScene::new(scene).unwrap();
    for backend in [Backend::Cpu, Backend::Gpu(&stages)] {
        let mut r = Renderer::new(&scene, backend, WIDTH, HEIGHT, 2.0).unwrap();
        let traced = r.traced(Stage::SoftShadow);
        let image = r
            .render(&Job::samples(Stage::SoftShadow, 64))
            .unwrap()
            .image;
        let lit: Vec<f64> = (image.data.iter().zip(&traced))
            .filter(|(_, t)| **t)
            .map(|(v, _)| f64::from(*v))
            .collect();
        let mean = lit.iter().sum::<f64>() / lit.len() as f64;
        assert!(
            (mean - expected).abs() < 0.01,
            "{}: {mean} of the light is seen, {expected} is above the horizon",
            r.label()
        );
    }
}

#[test]
fn bad_settings_are_named() {
    let scene = toy();
    let new = |w, h| Renderer::new(&scene, Backend::Cpu, w, h, 2.0).err();
    for (width, height) in [
        (0, 0),
        (0, 9),
        (9, 0),
        (SIDE_MAX + 1, 1),
        (SIDE_MAX, SIDE_MAX),
    ] {
        assert_eq!(new(width, height), Some(StageError::Size { width, height }));
    }
    let mut r = Renderer::new(&scene, Backend::Cpu, 2, 2, 2.0).unwrap();
    let mut ask = |sampler, samples| {
        r.render(&Job {
            stage: Stage::SoftShadow,
            sampler,
            samples,
            frame: 0,
        })
        .err()
    };
    for samples in [0, SAMPLES_MAX + 1] {
        assert_eq!(
            ask(Sampler::White, samples),
            Some(StageError::Samples { samples })
        );
    }
    assert_eq!(
        ask(Sampler::Grid, 8),
        Some(StageError::Samples { samples: 8 })
    );
    let mut blind = Scene::toy_room();
    blind.camera.target = blind.camera.eye;
    assert!(matches!(
        StageScene::new(blind).err(),
        Some(StageError::Camera { .. })
    ));
}

/// Without triangles there is only sky.
#[test]
fn an_empty_mesh_is_all_sky() {
    let scene = StageScene::new(Scene::seen_whole("nothing".into(), Mesh::default())).unwrap();
    let gpu = &adapters().unwrap()[0];
    let stages = GpuStages::new(gpu).unwrap();
    for backend in [Backend::Cpu, Backend::Gpu(&stages)] {
        let mut r = Renderer::new(&scene, backend, 8, 8, 2.0).unwrap();
        let out = r.render(&Job::frame(Stage::AmbientOcclusion)).unwrap();
        assert_eq!((out.rays, out.image.data), (0, vec![1.0; 64]));
    }
}
