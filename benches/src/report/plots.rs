//! Which plots there are.

use super::error::ReportError;
use super::plot::{Plot, Series, Ticks};
use super::schema::{ConvergenceRow, KernelRow, PlotRow, Report};
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
    Ok(out)
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
