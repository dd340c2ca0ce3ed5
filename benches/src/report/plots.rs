//! Which plots there are.

use super::error::ReportError;
use super::plot::{Plot, Series, Ticks};
use super::schema::{
    BallRow, BuildRow, ConvergenceRow, KernelRow, PlotRow, ReflectionRow, Report, SequenceRow,
    SurfelRow,
};
use super::{Drawn, page};

/// An error of zero has no logarithm: it is drawn here.
const NO_ERROR: f64 = 0.02;

/// From 2^24 ULP on no digit is right, and more would say no more.
const NO_DIGIT: f64 = 16_777_216.0;

/// Every plot of a report: speed against error for each kernel with
/// baselines, then error against samples and time.
pub(super) fn all(report: &Report) -> Result<Vec<Drawn>, ReportError> {
    let mut out = Vec::new();
    let mut kernels: Vec<&KernelRow> = report.kernels.iter().collect();
    kernels.sort_by_key(|k| k.module != "math/trig");
    for kernel in kernels {
        if let Some(plot) = speed_against_error(kernel) {
            out.push(drawn(
                format!("plots/speed-error-{}.svg", kernel.name.replace('_', "-")),
                &plot,
            )?);
        }
    }
    let mut groups: Vec<(&str, &str, &str)> = Vec::new();
    for row in &report.convergence {
        let group = (row.scene.as_str(), row.stage.as_str(), row.backend.as_str());
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    for (scene, stage, backend) in groups {
        for against_time in [false, true] {
            let plot = convergence(report, scene, stage, backend, against_time);
            let axis = if against_time { "time" } else { "samples" };
            let file = format!(
                "plots/{}.svg",
                slug(&format!("{scene} {stage} {axis} {}", page::short(backend)))
            );
            out.push(drawn(file, &plot)?);
        }
    }
    for plot in materials(report)
        .into_iter()
        .chain(estimators(report))
        .chain(surfels(report))
        .chain(trees(report))
    {
        out.push(drawn(format!("plots/{}.svg", slug(&plot.title)), &plot)?);
    }
    Ok(out)
}

/// Plots whose title begins with this belong to the materials.
pub(super) const MATERIALS: [&str; 5] =
    ["Samplers", "Layers", "Reconstruction", "Worth", "Over time"];

/// Plots whose title begins with one of these belong to the traversal.
pub(super) const TREES: [&str; 3] = ["Trees", "Price", "Growth"];

/// Plots whose title begins with this belong to the surfels.
pub(super) const SURFELS: &str = "Surfels";

/// Plots whose title begins with this belong to the estimators.
pub(super) const ESTIMATOR: &str = "Estimators";

/// An error of nothing has no logarithm: it is drawn here.
const NOTHING_LOST: f64 = 1e-3;

fn series(name: String, colour: usize, points: Vec<(f64, f64)>) -> Series {
    Series {
        name,
        colour,
        points,
        labels: Vec::new(),
        stems: Vec::new(),
        joined: true,
    }
}

/// What occurs in some rows, in order, each once.
fn distinct<T, K: PartialEq>(rows: &[T], key: impl Fn(&T) -> K) -> Vec<K> {
    let mut out = Vec::new();
    for row in rows {
        let k = key(row);
        if !out.contains(&k) {
            out.push(k);
        }
    }
    out
}

fn materials(report: &Report) -> Vec<Plot> {
    let mut out = Vec::new();
    for degrees in distinct(&report.samplers, |r| r.degrees) {
        let names = distinct(&report.samplers, |r| r.sampler.clone());
        let lines = names.into_iter().enumerate().map(|(k, name)| {
            let points = report
                .samplers
                .iter()
                .filter(|r| r.sampler == name && r.degrees == degrees)
                .map(|r| (f64::from(r.alpha), r.efficiency))
                .collect();
            series(name, k, points)
        });
        out.push(Plot {
            title: format!("Samplers at {degrees} degrees"),
            x_label: "GGX roughness α".into(),
            y_label: "efficiency over the normal distribution's".into(),
            x_ticks: Ticks::Decimal,
            series: lines.collect(),
            guide: None,
        });
    }
    if let Some(plot) = layers(report) {
        out.push(plot);
    }
    let views = distinct(&report.reflections, |r| (r.scene.clone(), r.view.clone()));
    for (scene, view) in &views {
        let here = |r: &&ReflectionRow| r.scene == *scene && r.view == *view;
        let rows: Vec<&ReflectionRow> = report.reflections.iter().filter(here).collect();
        for backend in distinct(&rows, |r| r.backend.clone()) {
            out.push(reconstruction(scene, view, &backend, &rows));
        }
        let balls: Vec<&BallRow> = report
            .reflection_balls
            .iter()
            .filter(|b| b.scene == *scene && b.view == *view)
            .collect();
        out.push(worth(scene, view, &balls));
    }
    for (name, rows) in sequences(report) {
        out.push(over_time(&name, &rows, None));
        for adapter in rows.first().iter().flat_map(|r| r.gpu_ms.keys()) {
            out.push(over_time(&name, &rows, Some(adapter)));
        }
        // A line needs more than the two frames of what moves.
        if rows.iter().any(|r| r.by_frame.len() > 2) {
            out.push(by_frame(&name, &rows));
        }
    }
    out
}

/// No ray lost has no logarithm: it is drawn as half a ray.
const HALF_A_RAY: f64 = 0.5;

/// Ways to build a tree, the price of losing no ray, and cost against size.
fn trees(report: &Report) -> Vec<Plot> {
    let mut out = Vec::new();
    for mesh in distinct(&report.builds, |r| r.mesh.clone()) {
        let rows: Vec<_> = report.builds.iter().filter(|r| r.mesh == mesh).collect();
        let engines = distinct(&rows, |r| r.engine.clone());
        let lines = |x: &dyn Fn(&BuildRow) -> f64, joined: bool| -> Vec<Series> {
            let lines = engines.iter().enumerate().map(|(colour, engine)| {
                let rows: Vec<_> = rows.iter().filter(|r| r.engine == *engine).collect();
                Series {
                    labels: rows
                        .iter()
                        .map(|r| r.quality.clone().unwrap_or_default())
                        .collect(),
                    joined: joined && rows.len() > 1,
                    ..series(
                        engine.clone(),
                        colour,
                        rows.iter().map(|r| (x(r), r.mean)).collect(),
                    )
                }
            });
            lines.collect()
        };
        let y_label = "Mrays/s, geometric mean of four kinds, one thread";
        out.push(Plot {
            title: format!("Trees: build against speed, {mesh}"),
            x_label: "ms to build, one thread".into(),
            y_label: y_label.into(),
            x_ticks: Ticks::Decimal,
            series: lines(&|r| r.build_ms, true),
            guide: None,
        });
        out.push(Plot {
            title: format!("Price of being right, {mesh}"),
            x_label: format!(
                "rays lost of {} aimed at edges and vertices (none: at the left edge)",
                rows.first().map_or(0, |r| r.aimed)
            ),
            y_label: y_label.into(),
            x_ticks: Ticks::Decimal,
            series: lines(&|r| (r.leaks as f64).max(HALF_A_RAY), false),
            guide: None,
        });
    }
    let engines = distinct(&report.growth, |r| r.engine.clone());
    if !engines.is_empty() {
        let lines = engines.iter().enumerate().map(|(colour, engine)| {
            let rows = report.growth.iter().filter(|r| r.engine == *engine);
            let points = rows.map(|r| (r.triangles as f64, r.ns)).collect();
            series(engine.clone(), colour, points)
        });
        out.push(Plot {
            title: "Growth: cost of a ray against triangles".into(),
            x_label: "triangles of a displaced sphere".into(),
            y_label: "ns a ray, geometric mean of four kinds, one thread".into(),
            x_ticks: Ticks::Decimal,
            series: lines.collect(),
            guide: None,
        });
    }
    out
}

/// Error by frame for each event, by both measures; light that is left; error
/// against milliseconds.
fn surfels(report: &Report) -> Vec<Plot> {
    type Value = fn(&SurfelRow) -> f64;
    let rows = &report.surfels;
    let mut out = Vec::new();
    for scene in distinct(rows, |r| r.scene.clone()) {
        for event in distinct(rows, |r| r.event.clone()) {
            let of: Vec<&SurfelRow> = rows
                .iter()
                .filter(|r| r.scene == scene && r.event == event)
                .collect();
            let slots = distinct(&of, |r| r.slots);
            let dark = event.ends_with("out");
            let values: &[(&str, Value)] = if dark {
                &[("light left over that before", |r| r.mean)]
            } else {
                &[("RMSE", |r| r.rmse), ("FLIP", |r| r.flip)]
            };
            for (name, value) in values {
                let line = |slots: u32| -> Vec<(f64, f64)> {
                    let of = of.iter().filter(|r| r.slots == slots);
                    of.map(|r| (f64::from(r.frame), value(r).max(1e-6)))
                        .collect()
                };
                let mut lines: Vec<Series> = slots
                    .iter()
                    .enumerate()
                    .map(|(k, s)| series(format!("{s} slots"), k, line(*s)))
                    .collect();
                if *name == "RMSE" {
                    let first = slots.first().copied().unwrap_or_default();
                    let of = of.iter().filter(|r| r.slots == first);
                    let points = of.map(|r| (f64::from(r.frame), r.direct_rmse)).collect();
                    lines.push(series("no light that bounces".into(), 5, points));
                }
                out.push(Plot {
                    title: format!("{SURFELS}: {scene}, {event}, {name}"),
                    x_label: "frames".into(),
                    y_label: (*name).into(),
                    x_ticks: Ticks::Fours,
                    series: lines,
                    guide: None,
                });
            }
        }
        let cut: Vec<&SurfelRow> = rows
            .iter()
            .filter(|r| r.scene == scene && r.event == "after a cut")
            .collect();
        let slots = distinct(&cut, |r| r.slots);
        let lines = slots.iter().enumerate().map(|(k, s)| {
            let of: Vec<_> = cut
                .iter()
                .filter(|r| r.slots == *s && r.frame >= 4)
                .collect();
            Series {
                labels: of.iter().map(|r| r.frame.to_string()).collect(),
                ..series(
                    format!("{s} slots"),
                    k,
                    of.iter().map(|r| (r.ms, r.rmse)).collect(),
                )
            }
        });
        out.push(Plot {
            title: format!("{SURFELS}: {scene}, error against time, frames beside the points"),
            x_label: "ms a frame".into(),
            y_label: "RMSE".into(),
            x_ticks: Ticks::Decimal,
            series: lines.collect(),
            guide: None,
        });
    }
    out
}

/// Answers or errors by frame for each signal, then residual variance against
/// half-life for each noise and step.
fn estimators(report: &Report) -> Vec<Plot> {
    let shown = [
        "printed",
        "robust",
        "best window in hindsight",
        "average, 1/8",
        "average, 1/32",
        "average, 1/256",
    ];
    let mut out = Vec::new();
    for signal in distinct(&report.estimators, |r| r.signal.clone()) {
        let mut shows_answer = false;
        let lines = shown.iter().enumerate().filter_map(|(k, name)| {
            let row = report
                .estimators
                .iter()
                .find(|r| r.signal == signal && r.estimator == *name)?;
            shows_answer = row.shows_answer;
            let values = if row.shows_answer {
                &row.answer_by_frame
            } else {
                &row.rmse_by_frame
            };
            let points = row.frames.iter().map(|f| f64::from(*f));
            let points = points.zip(values.iter().copied()).collect();
            Some(series((*name).into(), k, points))
        });
        let lines = lines.collect();
        out.push(Plot {
            title: format!("{ESTIMATOR}: {signal}"),
            x_label: "frames since the signal moved".into(),
            y_label: if shows_answer { "answer" } else { "RMSE" }.into(),
            x_ticks: Ticks::Fours,
            series: lines,
            guide: None,
        });
    }
    let plots = distinct(&report.estimator_points, |r| {
        (r.noise.clone(), r.from, r.to)
    });
    for (noise, from, to) in plots {
        let rows: Vec<_> = report
            .estimator_points
            .iter()
            .filter(|r| r.noise == noise && r.from == from && r.to == to)
            .filter_map(|r| Some((r, r.half_life?)))
            .collect();
        let names = distinct(&rows, |r| r.0.estimator.clone());
        let lines = names.into_iter().enumerate().map(|(k, name)| {
            let chosen: Vec<_> = rows.iter().filter(|r| r.0.estimator == name).collect();
            Series {
                // The other memory's points lie beside these.
                labels: if name.contains("memory 256") {
                    Vec::new()
                } else {
                    chosen.iter().map(|r| r.0.setting.clone()).collect()
                },
                ..series(
                    name,
                    k,
                    chosen.iter().map(|r| (r.1, r.0.residual)).collect(),
                )
            }
        });
        out.push(Plot {
            title: format!("{ESTIMATOR}, quiet against fast: {noise}, step {from} to {to}"),
            x_label: "half-life of a step, frames".into(),
            y_label: "residual variance over the samples'".into(),
            x_ticks: Ticks::Decimal,
            series: lines.collect(),
            guide: None,
        });
    }
    out
}

/// The rows of each sequence, and its name.
pub(super) fn sequences(report: &Report) -> Vec<(String, Vec<&SequenceRow>)> {
    let key = |r: &SequenceRow| (r.scene.clone(), r.signal.clone(), r.event.clone(), r.size);
    distinct(&report.sequences, key)
        .into_iter()
        .map(|k| {
            let rows = report.sequences.iter().filter(|r| key(r) == k).collect();
            let (scene, signal, event, [width, height]) = k;
            let signal = signal.replace('_', " ");
            (
                format!("{scene}, {signal}, {event}, {width} × {height}"),
                rows,
            )
        })
        .collect()
}

/// Error against time a frame; without a filter there is no time to draw.
fn over_time(name: &str, all: &[&SequenceRow], adapter: Option<&String>) -> Plot {
    let time = |r: &SequenceRow| match adapter {
        None => Some(r.ms),
        Some(adapter) => r.gpu_ms.get(adapter).copied().flatten(),
    };
    let timed: Vec<&SequenceRow> = all.iter().copied().filter(|r| time(r).is_some()).collect();
    let rows = &timed[..];
    let middle = rows
        .iter()
        .find(|r| r.piece.as_deref() == Some("all of it"))
        .map_or((0.0, 0.0), |r| (r.rmse, time(r).unwrap_or_default()));
    let filtered = ["SVGF", "average"];
    let bare = all
        .iter()
        .find(|r| !filtered.iter().any(|f| r.variant.starts_with(f)));
    let of = |title: &str, k: usize, chosen: &[&&SequenceRow], labels: Vec<String>| Series {
        labels,
        joined: k == 0,
        ..series(
            title.into(),
            k,
            chosen
                .iter()
                .filter_map(|r| Some((time(r)?, r.rmse)))
                .collect(),
        )
    };
    let passes: Vec<_> = rows
        .iter()
        .filter(|r| r.variant.starts_with("SVGF") && r.variant.ends_with(" passes"))
        .collect();
    let pieces: Vec<_> = rows
        .iter()
        .filter(|r| {
            // What changes nothing would lie on the point that it came from.
            let of_the_passes = r.variant.ends_with(" passes");
            let moved = |now: f64, then: f64| (now / then - 1.0).abs() > 0.04;
            let moves = moved(r.rmse, middle.0) || moved(time(r).unwrap_or_default(), middle.1);
            r.piece.is_some() && !of_the_passes && moves
        })
        .collect();
    let averages: Vec<_> = rows
        .iter()
        .filter(|r| r.variant.starts_with("average"))
        .collect();
    let number = |r: &&&SequenceRow| r.variant.chars().filter(char::is_ascii_digit).collect();
    let rest = |r: &&&SequenceRow| {
        let part = r.variant.split_once(", ").map_or("", |p| p.1);
        part.to_owned()
    };
    Plot {
        title: match adapter {
            None => format!("Over time: {name}"),
            Some(adapter) => format!("Over time: {name}, {}", super::page::short(adapter)),
        },
        x_label: "milliseconds a frame".into(),
        y_label: "RMSE of the last frame".into(),
        x_ticks: Ticks::Decimal,
        series: vec![
            of(
                "SVGF, by passes",
                0,
                &passes,
                passes.iter().map(number).collect(),
            ),
            of(
                "three passes, with a piece left out or put in",
                1,
                &pieces,
                pieces
                    .iter()
                    .map(|r| r.piece.clone().unwrap_or_default())
                    .collect(),
            ),
            of(
                "average of 32 frames",
                2,
                &averages,
                averages.iter().map(rest).collect(),
            ),
        ],
        // What is not filtered takes no time, and has no place on this axis.
        guide: bare.map(|r| (r.rmse, 0.0, format!("no filter: {}", r.variant))),
    }
}

/// Error by frame.
fn by_frame(name: &str, rows: &[&SequenceRow]) -> Plot {
    let shown = [
        "1 spp",
        "quarter ray",
        "average of 32 frames",
        "average of 32 frames, clamped",
        "SVGF, 0 passes",
        "SVGF, 1 passes",
        "SVGF, 5 passes",
    ];
    let found = shown
        .into_iter()
        .filter_map(|head| rows.iter().find(|r| r.variant == head));
    // Counted after those that are missing: there are six colours.
    let lines = found.enumerate().map(|(k, row)| {
        let points = row
            .by_frame
            .iter()
            .map(|(frame, error)| (f64::from(frame + 1), *error))
            .collect();
        series(row.variant.clone(), k, points)
    });
    Plot {
        title: format!("Over time: {name}, by frame"),
        x_label: "frame".into(),
        y_label: "RMSE".into(),
        x_ticks: Ticks::Decimal,
        series: lines.collect(),
        guide: None,
    }
}

/// Light that is misplaced with fewer layers, against their cost.
fn layers(report: &Report) -> Option<Plot> {
    let first = report.layers.first()?;
    let mut backends: Vec<Option<&String>> = first.gpu_ns.keys().map(Some).collect();
    if first.cpu_ns[1].is_some() {
        backends.insert(0, None);
    }
    let lines = backends.into_iter().enumerate().map(|(k, backend)| {
        let rows: Vec<_> = report
            .layers
            .iter()
            .filter_map(|r| {
                let ns = match backend {
                    None => r.cpu_ns[1],
                    Some(label) => r.gpu_ns.get(label).and_then(|ns| ns[1]),
                };
                ns.map(|ns| (r.layers, (ns, r.error.max(NOTHING_LOST))))
            })
            .collect();
        Series {
            labels: rows.iter().map(|r| r.0.to_string()).collect(),
            ..series(
                backend.map_or("cpu".into(), |b| page::short(b).to_owned()),
                k,
                rows.iter().map(|r| r.1).collect(),
            )
        }
    });
    Some(Plot {
        title: "Layers of a paint".into(),
        x_label: "nanoseconds of layered_eval".into(),
        y_label: "misplaced light (none: 0.001)".into(),
        x_ticks: Ticks::Decimal,
        series: lines.collect(),
        guide: None,
    })
}

/// Error against time of the reconstruction, and what more rays would give.
fn reconstruction(scene: &str, view: &str, backend: &str, rows: &[&ReflectionRow]) -> Plot {
    let here: Vec<&&ReflectionRow> = rows.iter().filter(|r| r.backend == backend).collect();
    let own = here.iter().find(|r| r.neighbours == 0);
    let lines = [false, true].into_iter().enumerate().map(|(k, bilateral)| {
        let chosen: Vec<_> = here
            .iter()
            .filter(|r| r.neighbours > 0 && r.bilateral == bilateral)
            .collect();
        Series {
            labels: chosen.iter().map(|r| r.neighbours.to_string()).collect(),
            ..series(
                if bilateral {
                    "neighbours, then bilateral"
                } else {
                    "neighbours, by number"
                }
                .into(),
                k,
                chosen
                    .iter()
                    .map(|r| (r.trace_ms + r.filter_ms, r.rmse))
                    .collect(),
            )
        }
    });
    let mut lines: Vec<Series> = lines.collect();
    let guide = own.map(|r| {
        lines.push(Series {
            labels: vec!["1 ray".into()],
            ..series("a pixel's own ray".into(), 2, vec![(r.trace_ms, r.rmse)])
        });
        (
            r.rmse * r.trace_ms.sqrt(),
            -0.5,
            "more rays of its own".to_owned(),
        )
    });
    Plot {
        title: format!(
            "Reconstruction: {scene}, {view}, on {}",
            page::short(backend)
        ),
        x_label: "milliseconds for rays and filters".into(),
        y_label: "RMSE to the reference".into(),
        x_ticks: Ticks::Decimal,
        series: lines,
        guide,
    }
}

/// Rays of its own that a pixel would need, by roughness.
fn worth(scene: &str, view: &str, balls: &[&BallRow]) -> Plot {
    let kinds = [(false, false), (true, false), (false, true), (true, true)];
    let lines = kinds
        .into_iter()
        .enumerate()
        .map(|(k, (coated, bilateral))| {
            let name = format!(
                "{}{}",
                if coated { "coated" } else { "bare" },
                if bilateral { ", then bilateral" } else { "" }
            );
            let points = balls
                .iter()
                .filter(|b| b.coated == coated && b.bilateral == bilateral)
                .map(|b| (f64::from(b.roughness), b.rays_by_variance))
                .collect();
            series(name, k, points)
        });
    Plot {
        title: format!("Worth of 16 neighbours: {scene}, {view}"),
        x_label: "perceptual roughness".into(),
        y_label: "rays a pixel with the same variance".into(),
        x_ticks: Ticks::Decimal,
        series: lines.collect(),
        guide: Some((16.0, 0.0, "16 rays, the chapter's claim".into())),
    }
}

fn drawn(file: String, plot: &Plot) -> Result<Drawn, ReportError> {
    Ok(Drawn {
        svg: plot.svg()?,
        row: PlotRow {
            file,
            title: plot.title.clone(),
        },
    })
}

/// Lower-case words with hyphens.
fn slug(text: &str) -> String {
    let words: Vec<String> = text
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|w| !w.is_empty())
        .map(str::to_ascii_lowercase)
        .collect();
    words.join("-")
}

/// One implementation: a point for each back end, at its largest error, with
/// a stem down to the median.
struct Implementation<'a> {
    name: String,
    colour: usize,
    /// Back end, nanoseconds, largest error (`None`: not finite), median.
    points: Vec<(&'a str, f64, Option<f64>, Option<f64>)>,
}

impl Implementation<'_> {
    fn series(self) -> Series {
        let clamp = |e: Option<f64>| e.unwrap_or(NO_DIGIT).clamp(NO_ERROR, NO_DIGIT);
        let sound: Vec<_> = self.points.into_iter().filter(|p| p.1 > 0.0).collect();
        Series {
            name: self.name,
            colour: self.colour,
            points: sound.iter().map(|p| (p.1, clamp(p.2))).collect(),
            stems: sound.iter().map(|p| clamp(p.3)).collect(),
            labels: sound.iter().map(|p| p.0.to_owned()).collect(),
            joined: false,
        }
    }
}

fn speed_against_error(kernel: &KernelRow) -> Option<Plot> {
    if kernel.baselines.is_empty() {
        return None;
    }
    let mut points = Vec::new();
    points.extend(
        kernel
            .cpu_ns
            .map(|ns| ("cpu", ns, kernel.cpu_err_ulp_max, kernel.cpu_err_ulp_median)),
    );
    for (label, on) in &kernel.adapters {
        points.push((page::short(label), on.ns, on.err_ulp_max, on.err_ulp_median));
    }
    let mut all = vec![Implementation {
        name: format!("raytwin: {}", kernel.name),
        colour: 1,
        points,
    }];
    for (i, baseline) in kernel.baselines.iter().enumerate() {
        let mut points = Vec::new();
        points.extend(baseline.cpu_ns.map(|ns| {
            (
                "cpu",
                ns,
                baseline.cpu_err_ulp_max,
                baseline.cpu_err_ulp_median,
            )
        }));
        for (label, on) in &baseline.adapters {
            points.push((page::short(label), on.ns, on.err_ulp_max, on.err_ulp_median));
        }
        all.push(Implementation {
            name: baseline.name.clone(),
            colour: if i == 0 { 0 } else { i + 2 },
            points,
        });
    }
    Some(Plot {
        title: format!("{}: speed against error", kernel.name),
        x_label: "ns a call".into(),
        y_label: "error in ULP: largest, and median below".into(),
        x_ticks: Ticks::Decimal,
        series: all.into_iter().map(Implementation::series).collect(),
        guide: None,
    })
}

fn convergence(
    report: &Report,
    scene: &str,
    stage: &str,
    backend: &str,
    against_time: bool,
) -> Plot {
    let is_here =
        |row: &&ConvergenceRow| row.scene == scene && row.stage == stage && row.backend == backend;
    let mut series: Vec<Series> = Vec::new();
    for row in report.convergence.iter().filter(is_here) {
        let slope = report.slopes.iter().find(|s| {
            s.scene == scene && s.stage == stage && s.backend == backend && s.sampler == row.sampler
        });
        let name = match slope {
            Some(s) if !against_time => format!("{}, slope {:.2}", row.sampler, s.slope),
            _ => row.sampler.clone(),
        };
        let at = match series.iter().position(|s| s.name == name) {
            Some(at) => at,
            None => {
                series.push(Series {
                    name,
                    colour: series.len(),
                    points: Vec::new(),
                    labels: Vec::new(),
                    stems: Vec::new(),
                    joined: true,
                });
                series.len() - 1
            }
        };
        let x = if against_time {
            row.ms
        } else {
            f64::from(row.samples)
        };
        if x > 0.0 && row.rmse > 0.0 {
            series[at].points.push((x, row.rmse));
        }
    }
    // Through white noise at one sample: what independent samples must do.
    let guide = series
        .first()
        .and_then(|s| s.points.first())
        .filter(|_| !against_time)
        .map(|p| (p.1 * p.0.sqrt(), -0.5, "slope −1/2".to_owned()));
    Plot {
        title: format!(
            "{scene}: {}, on {}",
            stage.replace('_', " "),
            page::short(backend)
        ),
        x_label: if against_time {
            "milliseconds for the picture"
        } else {
            "samples a pixel"
        }
        .into(),
        y_label: "RMSE to the reference".into(),
        x_ticks: if against_time {
            Ticks::Decimal
        } else {
            Ticks::Fours
        },
        series,
        guide,
    }
}
