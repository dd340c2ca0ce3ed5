//! `measured.md`: the most important numbers as tables for a page of text; a
//! snapshot of it is kept under docs/.

use std::fmt::Write;

use super::page::{number, short};
use super::schema::{Adapter, BvhRow, KernelRow, Report, SequenceRow};

/// The tables.
#[must_use]
pub fn measured(report: &Report) -> String {
    let mut out = String::from("# What was measured\n\n");
    let machine = &report.machine;
    let day = report.date.split('T').next().unwrap_or(&report.date);
    let _ = writeln!(
        out,
        "A snapshot of `cargo xtask report` ({}, {day}) on {}, {} threads, {} {}: its `measured.md`. Run the command for your own machine and GPU: it also draws the pictures and plots.",
        report.settings.mode, machine.cpu, machine.threads, machine.os, machine.arch,
    );
    if !report.adapters.is_empty() && report.adapters.iter().all(|a| a.software) {
        out.push_str("No hardware GPU was there, so these are software drivers: their times say nothing about graphics hardware, their errors and parity are real.\n");
    }
    out.push('\n');
    for a in &report.adapters {
        let _ = writeln!(
            out,
            "- **{}**, driver {} {}, {}",
            a.name, a.driver, a.driver_info, a.backend
        );
    }
    techniques(report, &mut out);
    kernels(report, &mut out);
    traversal(report, &mut out);
    sequences(report, &mut out);
    goals(report, &mut out);
    out
}

/// Error and milliseconds of what is filtered over time.
fn sequences(report: &Report, out: &mut String) {
    if report.sequences.is_empty() {
        return;
    }
    out.push_str("\n## Over time\n\nA frame of a sequence on the CPU, reprojection and filters without tracing, and the last frame's error against a reference of 1024 samples. The report has more variants, and plots.\n");
    let few = |r: &SequenceRow| {
        let passes = r.variant.starts_with("SVGF") && r.variant.ends_with(" passes");
        let of_passes = passes && r.piece.as_deref() != Some("no passes over the image");
        let filtered = r.variant.starts_with("SVGF") || r.variant.starts_with("average");
        let average = r.variant == "average of 32 frames";
        of_passes || average || !filtered || r.variant.ends_with("passes, clamped")
    };
    for (name, rows) in super::plots::sequences(report) {
        let _ = writeln!(out, "\n**{name}**\n");
        heading(
            out,
            &["variant", "ms", "RMSE", "PSNR", "SSIM", "FLIP", "flicker"],
        );
        for r in rows.into_iter().filter(|r| few(r)) {
            let _ = writeln!(
                out,
                "| {} | {} | {} | {:.1} | {} | {} | {} |",
                r.variant,
                rough(r.ms),
                rough(r.rmse),
                r.psnr,
                r.ssim.map_or("–".into(), |s| format!("{s:.3}")),
                rough(r.flip),
                rough(r.flicker),
            );
        }
    }
}

fn heading(out: &mut String, columns: &[&str]) {
    let _ = writeln!(out, "| {} |", columns.join(" | "));
    let rule: Vec<_> = columns.iter().map(|_| "---").collect();
    let _ = writeln!(out, "| {} |", rule.join(" | "));
}

/// Two digits.
fn rough(x: f64) -> String {
    if x.abs() >= 100.0 {
        return format!("{x:.0}");
    }
    let text = format!("{x:.1e}");
    let two: f64 = text.parse().unwrap_or(x);
    number(two)
}

fn largest(values: impl Iterator<Item = f64>) -> Option<f64> {
    values.max_by(f64::total_cmp)
}

fn techniques(report: &Report, out: &mut String) {
    if report.kernels.is_empty() {
        return;
    }
    out.push_str(
        "\n## Techniques\n\nNanoseconds an element on the CPU, over the technique's kernels; the largest error on the CPU, in ULP of the contract's scale, of its bound; the largest on any adapter.\n\n",
    );
    heading(
        out,
        &[
            "technique",
            "kernels",
            "class",
            "ns",
            "error, of bound",
            "error, GPU",
        ],
    );
    let mut rows: Vec<&KernelRow> = report.kernels.iter().collect();
    rows.sort_by(|a, b| a.module.cmp(&b.module));
    for kernels in rows.chunk_by(|a, b| a.module == b.module) {
        let module = &kernels[0].module;
        let mut classes: Vec<&str> = kernels.iter().map(|k| k.class.as_str()).collect();
        classes.sort_unstable();
        classes.dedup();
        let times = || kernels.iter().filter_map(|k| k.cpu_ns);
        let least = times().min_by(f64::total_cmp).map(rough);
        let most = largest(times()).map(rough);
        let ns = match (least, most) {
            (Some(least), Some(most)) if least == most => least,
            (Some(least), Some(most)) => format!("{least} to {most}"),
            _ => "–".into(),
        };
        let errors = kernels
            .iter()
            .filter_map(|k| Some((k.cpu_err_ulp_max?, k.cpu_bound)));
        let exact = kernels.iter().all(|k| k.class == "A");
        let worst = errors.max_by(|a, b| a.0.total_cmp(&b.0));
        let cpu = match worst {
            _ if exact => "exact".into(),
            Some((error, bound)) => format!("{} of {}", rough(error), rough(bound)),
            None => "–".into(),
        };
        let gpu = match largest(kernels.iter().filter_map(|k| k.gpu_err_ulp_max)) {
            Some(_) if exact => "exact".into(),
            Some(error) => rough(error),
            None => "–".into(),
        };
        let _ = writeln!(
            out,
            "| [`{module}`]({module}.md) | {} | {} | {ns} | {cpu} | {gpu} |",
            kernels.len(),
            classes.join(", "),
        );
    }
}

fn kernels(report: &Report, out: &mut String) {
    if report.kernels.is_empty() {
        return;
    }
    out.push_str("\n## Kernels\n\nErrors are the largest over the report's inputs, in ULP of the contract's scale, before their bound. *bits* counts elements that differ from the CPU twin with contraction off.\n\n");
    let mut columns = vec![
        "kernel".to_owned(),
        "class".into(),
        "CPU ns".into(),
        "CPU error / bound".into(),
    ];
    for a in &report.adapters {
        columns.push(format!("{} ns", short(&a.label)));
        columns.extend(["error / bound", "parity / bound", "bits"].map(String::from));
    }
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    heading(out, &columns);
    for k in &report.kernels {
        let ns = k.cpu_ns.map_or("–".into(), number);
        let _ = write!(out, "| `{}` | {} | {ns} | ", k.name, k.class);
        let _ = write!(out, "{} |", against(k, k.cpu_err_ulp_max, k.cpu_bound));
        for a in &report.adapters {
            out.push_str(&on_adapter(k, a));
        }
        out.push('\n');
    }
}

fn against(k: &KernelRow, error: Option<f64>, bound: f64) -> String {
    match error {
        Some(0.0) if k.class == "A" => "exact".into(),
        Some(error) => format!("{} / {}", number(error), number(bound)),
        None => "–".into(),
    }
}

fn on_adapter(k: &KernelRow, adapter: &Adapter) -> String {
    let Some(on) = k.adapters.get(&adapter.label) else {
        return " – | – | – | – |".into();
    };
    format!(
        " {} | {} | {} | {} |",
        number(on.ns),
        against(k, on.err_ulp_max, k.gpu_bound),
        against(k, on.parity_ulp_max, k.parity_bound),
        on.precise_differing
            .map_or("–".into(), |bits| bits.to_string()),
    )
}

fn traversal(report: &Report, out: &mut String) {
    if report.bvh.is_empty() {
        return;
    }
    out.push_str("\n## Traversal\n\nMillions of rays a second, one thread and one ray at a time on the CPU; beside each the multiple of Embree's default in the same run. *All threads*: the geometric mean of the four kinds. *Bytes*: a triangle.\n\n");
    heading(
        out,
        &[
            "mesh",
            "engine",
            "build ms",
            "primary",
            "shadow",
            "diffuse",
            "AO",
            "all threads",
            "bytes",
            "leaks",
            "false hits",
        ],
    );
    let rate = |own: f64, ratio: Option<f64>| match ratio {
        Some(ratio) => format!("{own:.2} ({ratio:.2}×)"),
        None => format!("{own:.2}"),
    };
    for r in &report.bvh {
        let BvhRow { mrays, .. } = r;
        let e = r.to_embree.as_ref();
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            r.mesh,
            short(&r.engine),
            r.build_ms.map_or("–".into(), number),
            rate(mrays.primary, e.map(|e| e.primary)),
            rate(mrays.shadow, e.map(|e| e.shadow)),
            rate(mrays.diffuse, e.map(|e| e.diffuse)),
            rate(mrays.ao, e.map(|e| e.ao)),
            r.all_threads.map_or("–".into(), |all| {
                rate(all.mean(), r.all_to_embree.map(|e| e.mean()))
            }),
            r.bytes.map_or("–".into(), |bytes| format!("{bytes:.0}")),
            r.leaks,
            r.false_hits,
        );
    }
}

fn goals(report: &Report, out: &mut String) {
    if report.goals.is_empty() {
        return;
    }
    out.push_str("\n## Goals\n\nRatios of times in one run.\n\n");
    heading(out, &["goal", "on", "measured", "at most", "", ""]);
    for g in &report.goals {
        let _ = writeln!(
            out,
            "| {} | {} | {:.2} | {} | {} | {} |",
            g.name,
            short(&g.backend),
            g.measured,
            g.limit,
            if g.measured > g.limit { "missed" } else { "" },
            g.detail,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::schema::GoalRow;

    #[test]
    fn a_technique_is_a_line_and_a_kernel_one() {
        let kernel = |name: &str, class: &str, ns: f64, error: f64| KernelRow {
            name: name.into(),
            module: "sample/cone".into(),
            class: class.into(),
            cpu_ns: Some(ns),
            cpu_err_ulp_max: Some(error),
            cpu_bound: 5.5,
            ..KernelRow::default()
        };
        let report = Report {
            kernels: vec![
                kernel("cone_sample", "B", 34.56, 4.71),
                kernel("cone_count", "A", 0.581, 0.0),
            ],
            goals: vec![GoalRow {
                name: "fast".into(),
                backend: "cpu".into(),
                measured: 1.25,
                limit: 1.0,
                ..GoalRow::default()
            }],
            ..Report::default()
        };
        let text = measured(&report);
        for line in [
            "| [`sample/cone`](sample/cone.md) | 2 | A, B | 0.58 to 35 | 4.7 of 5.5 | – |",
            "| `cone_sample` | B | 34.6 | 4.71 / 5.5 |",
            "| `cone_count` | A | 0.581 | exact |",
            "| fast | cpu | 1.25 | 1 | missed |  |",
        ] {
            assert!(text.lines().any(|l| l == line), "{line}\n{text}");
        }
        assert_eq!(["0.072", "206", "5.2"], [0.0721, 206.4, 5.25].map(rough));
    }
}
