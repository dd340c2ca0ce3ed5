//! A microbenchmark for each kernel and stage, on the CPU and on every
//! adapter, made from the registry.
//!
//! `cargo bench -p raytwin-bench` runs all of them, `-- NAME` those with NAME
//! in their name: `cpu/math/trig::sincos_turn`, `llvmpipe/…`, `…/baseline: …`,
//! `cpu/stages/soft_shadow`.

use std::hint::black_box;
use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use raytwin::contract::Kernel;
use raytwin_bench::report::kernels::calibration_loop;
use raytwin_bench::stages::{Backend, GpuStages, Job, Renderer, Stage, StageScene};
use raytwin_tests::gpu::{self, Build, Program};
use raytwin_tests::scene::Scene;

const ELEMENTS: usize = 1 << 16;
const SEED: u32 = 0xbe_9c4;

/// Quick by default; the usual options of criterion change it.
fn configured<'a>(c: &'a mut Criterion, name: &str) -> BenchmarkGroup<'a, WallTime> {
    let mut group = c.benchmark_group(name);
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(100))
        .measurement_time(Duration::from_millis(400));
    group
}

fn all_kernels() -> Vec<Kernel> {
    raytwin::registry()
        .into_iter()
        .flat_map(|t| t.kernels)
        .collect()
}

fn cpu(c: &mut Criterion) {
    let mut group = configured(c, "cpu");
    group.throughput(Throughput::Elements(ELEMENTS as u64));
    group.bench_function("calibration loop", |b| {
        b.iter(|| calibration_loop(black_box(ELEMENTS)));
    });
    for kernel in all_kernels() {
        // Drawn inside, so that a filter pays for nothing else.
        let arrays = || {
            let input = kernel.draw_many(ELEMENTS, SEED);
            let output = vec![0; ELEMENTS * kernel.words_out()];
            (input, output)
        };
        group.bench_function(kernel.path(), |b| {
            let (input, mut output) = arrays();
            b.iter(|| kernel.run_cpu(black_box(&input), black_box(&mut output)));
        });
        for baseline in &kernel.baselines {
            let name = format!("{}/baseline: {}", kernel.path(), baseline.name);
            group.bench_function(name, |b| {
                let (input, mut output) = arrays();
                b.iter(|| (baseline.cpu)(black_box(&input), black_box(&mut output)));
            });
        }
    }
    group.finish();
}

/// Times come from the device's clock, where it has one: transfers are out.
fn adapters(c: &mut Criterion) {
    let gpus = match gpu::adapters() {
        Ok(gpus) => gpus,
        Err(error) => {
            eprintln!("no GPU benchmark: {error}");
            return;
        }
    };
    for gpu in gpus {
        let mut group = configured(c, &gpu.info.name);
        group.throughput(Throughput::Elements(ELEMENTS as u64));
        for kernel in all_kernels() {
            let mut bench = |name: String, function: &str, extra: &str| {
                group.bench_function(name, |b| {
                    let input = kernel.draw_many(ELEMENTS, SEED);
                    let program =
                        Program::with_function(gpu, &kernel, Build::Plain, function, extra)
                            .unwrap_or_else(|e| panic!("{}: {e}", kernel.path()));
                    b.iter_custom(|times| {
                        // The median of a few dispatches, times the count.
                        let repeats = usize::try_from(times).unwrap_or(16).clamp(1, 16);
                        let ns = program.time(&input, repeats) * ELEMENTS as f64;
                        Duration::from_secs_f64((ns * 1e-9 * times as f64).max(1e-9))
                    });
                });
            };
            bench(kernel.path(), kernel.name, "");
            for baseline in &kernel.baselines {
                let name = format!("{}/baseline: {}", kernel.path(), baseline.name);
                bench(name, "baseline", baseline.wgsl);
            }
        }
        group.finish();
    }
}

/// The toy room at one sample a pixel, as a frame.
fn stages(c: &mut Criterion) {
    const SIZE: (u32, u32) = (160, 90);
    let scene = StageScene::new(Scene::toy_room()).expect("the toy room has a tree");
    let mut bench = |place: &str, backend: Backend<'_>| {
        let mut group = configured(c, place);
        for stage in Stage::ALL {
            group.bench_function(format!("stages/{}", stage.name()), |b| {
                let mut renderer =
                    Renderer::new(&scene, backend, SIZE.0, SIZE.1, 2.0).expect("the toy room fits");
                let job = Job::frame(stage);
                b.iter_custom(|times| {
                    let mut total = 0.0;
                    for _ in 0..times {
                        total += renderer.render(&job).expect("one sample is sound").ms;
                    }
                    Duration::from_secs_f64((total * 1e-3).max(1e-9))
                });
            });
        }
        group.finish();
    };
    bench("cpu", Backend::Cpu);
    for gpu in gpu::adapters().unwrap_or_default() {
        let compiled = GpuStages::new(gpu).expect("the adapter takes the stages");
        bench(&gpu.info.name, Backend::Gpu(&compiled));
    }
}

criterion_group!(benches, cpu, adapters, stages);
criterion_main!(benches);
