//! The summary in the terminal.

use std::fmt::Write;

use super::Written;
use super::page::{number, short};
use super::schema::Report;

/// A table of the most important numbers, and where the rest is.
#[must_use]
pub fn summary(written: &Written) -> String {
    let report = &written.report;
    let mut out = String::new();
    for warning in &report.warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    kernels(report, &mut out);
    engines(report, &mut out);
    stages(report, &mut out);
    materials(report, &mut out);
    let _ = writeln!(
        out,
        "\n{} files in {:.0} s: {}",
        report.files.len(),
        report.seconds,
        written.folder.join(super::output::PAGE).display()
    );
    out
}

fn table(out: &mut String, rows: &[Vec<String>]) {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| {
        rows.iter()
            .filter_map(|r| r.get(c))
            .map(|s| s.chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    for row in rows {
        let mut line = String::new();
        for (c, cell) in row.iter().enumerate() {
            let w = widths[c];
            let _ = if c == 0 {
                write!(line, "{cell:w$}")
            } else {
                write!(line, "  {cell:>w$}")
            };
        }
        let _ = writeln!(out, "{}", line.trim_end());
    }
}

fn header(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| (*n).to_owned()).collect()
}

fn kernels(report: &Report, out: &mut String) {
    if report.kernels.is_empty() {
        return;
    }
    let _ = writeln!(
        out,
        "\nkernels (errors in ULP; ? hard cases on an edge, undecided)"
    );
    let mut rows = vec![header(&[
        "", "class", "cpu ns", "gpu ns", "cpu err", "gpu err", "parity", "bound", "hard", "",
    ])];
    for k in &report.kernels {
        let cpu = report.settings.cpu;
        let gpu = !k.adapters.is_empty();
        let error = |measured: bool, e: Option<f64>| match (measured, e) {
            (false, _) => "-".into(),
            (true, Some(e)) => number(e),
            (true, None) => "not finite".into(),
        };
        rows.push(vec![
            format!("{}::{}", k.module, k.name),
            k.class.clone(),
            k.cpu_ns.map_or("-".into(), number),
            k.gpu_ns.map_or("-".into(), number),
            error(cpu, k.cpu_err_ulp_max),
            error(gpu, k.gpu_err_ulp_max),
            error(gpu, k.parity_ulp_max),
            number(k.parity_bound),
            match k.hard_cases.undecided {
                0 => format!("{}/{}", k.hard_cases.passed, k.hard_cases.tried),
                n => format!("{}/{} ({n}?)", k.hard_cases.passed, k.hard_cases.tried),
            },
            if k.within { "" } else { "OUTSIDE ITS BOUND" }.into(),
        ]);
    }
    table(out, &rows);
}

fn engines(report: &Report, out: &mut String) {
    if !report.bvh.is_empty() {
        let _ = writeln!(out, "\ntraversal (Mrays/s; in brackets over Embree's)");
        let mut rows = vec![header(&[
            "mesh, engine",
            "build ms",
            "primary",
            "shadow",
            "diffuse",
            "AO",
            "all threads",
            "bytes",
            "leaks",
            "false",
            "disagree",
        ])];
        for r in &report.bvh {
            let rate = |own: f64, ratio: Option<f64>| match ratio {
                Some(x) => format!("{own:.2} ({x:.2})"),
                None => format!("{own:.2} (Embree not found)"),
            };
            let e = r.to_embree.as_ref();
            rows.push(vec![
                format!("{}, {}", r.mesh, short(&r.engine)),
                r.build_ms.map_or("-".into(), |ms| format!("{ms:.1}")),
                rate(r.mrays.primary, e.map(|e| e.primary)),
                rate(r.mrays.shadow, e.map(|e| e.shadow)),
                rate(r.mrays.diffuse, e.map(|e| e.diffuse)),
                rate(r.mrays.ao, e.map(|e| e.ao)),
                r.all_threads.map_or("-".into(), |all| {
                    rate(all.mean(), r.all_to_embree.map(|e| e.mean()))
                }),
                r.bytes.map_or("-".into(), |bytes| format!("{bytes:.0}")),
                r.leaks.to_string(),
                r.false_hits.to_string(),
                r.disagreements.to_string(),
            ]);
        }
        table(out, &rows);
    }
    if report.families.is_empty() {
        return;
    }
    let _ = writeln!(out, "\nhard rays, all families together");
    let mut rows = vec![header(&["", "rays", "leaks", "false", "disagree"])];
    let mut engines: Vec<&str> = Vec::new();
    for r in &report.families {
        if !engines.contains(&r.engine.as_str()) {
            engines.push(&r.engine);
        }
    }
    for engine in engines {
        let mut sums = [0usize; 4];
        for r in report.families.iter().filter(|r| r.engine == engine) {
            for (sum, n) in sums
                .iter_mut()
                .zip([r.rays, r.leaks, r.false_hits, r.disagreements])
            {
                *sum += n;
            }
        }
        let mut row = vec![short(engine).to_owned()];
        row.extend(sums.map(|n| n.to_string()));
        rows.push(row);
    }
    table(out, &rows);
}

fn stages(report: &Report, out: &mut String) {
    if report.stages.is_empty() {
        return;
    }
    let _ = writeln!(out, "\nstages");
    let mut rows = vec![header(&["", "ms", "Mrays/s", "RMSE", "pixels unlike cpu"])];
    for r in &report.stages {
        rows.push(vec![
            format!(
                "{}/{} {} on {}",
                r.scene,
                r.name,
                r.variant,
                short(&r.backend)
            ),
            format!("{:.1}", r.ms),
            format!("{:.2}", r.rays as f64 / r.ms.max(1e-9) * 1e-3),
            r.rmse.map_or("-".into(), |e| format!("{e:.4}")),
            r.differing
                .map_or("-".into(), |n| format!("{n} of {}", r.pixels)),
        ]);
    }
    table(out, &rows);
    for s in &report.slopes {
        let _ = writeln!(
            out,
            "error of {} with {} on {} falls as samples^{:.2}",
            s.stage,
            s.sampler,
            short(&s.backend),
            s.slope
        );
    }
}

fn materials(report: &Report, out: &mut String) {
    if !report.goals.is_empty() {
        let _ = writeln!(out, "\ngoals (ratios of times in one run)");
        let mut rows = vec![header(&["", "measured", "goal", ""])];
        for g in &report.goals {
            rows.push(vec![
                format!("{} on {}", g.name, short(&g.backend)),
                format!("{:.2}", g.measured),
                format!("< {}", g.limit),
                if g.measured > g.limit { "missed" } else { "" }.into(),
            ]);
        }
        table(out, &rows);
    }
    if !report.passes.is_empty() {
        let _ = writeln!(out, "\nSVGF, pass by pass");
        let mut rows = vec![header(&[
            "",
            "ms",
            "asked for MB",
            "ideal MB",
            "GB/s",
            "copy GB/s",
        ])];
        for p in &report.passes {
            let [width, height] = p.size;
            rows.push(vec![
                format!(
                    "{} {width}x{height}, {} on {}",
                    p.signal,
                    p.pass,
                    short(&p.backend)
                ),
                format!("{:.2}", p.ms),
                format!("{:.1}", p.counted as f64 * 1e-6),
                format!("{:.1}", p.ideal as f64 * 1e-6),
                format!("{:.2}", p.gb_s),
                format!("{:.2}", p.copy_gb_s),
            ]);
        }
        table(out, &rows);
    }
    for r in &report.reflections {
        if let (16, Some(variance), Some(error)) =
            (r.neighbours, r.rays_by_variance, r.rays_by_error)
        {
            let _ = writeln!(
                out,
                "{}, {}: 16 neighbours{} at a quarter of a ray have the variance of {variance:.1} rays a pixel, the error of {error:.1}",
                r.scene,
                r.view,
                if r.bilateral { " and bilateral" } else { "" },
            );
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn columns_line_up() {
        let mut out = String::new();
        let row = |a: &str, b: &str| vec![a.to_owned(), b.to_owned()];
        super::table(&mut out, &[row("a", "100"), row("long", "7")]);
        assert_eq!(out, "a     100\nlong    7\n");
    }
}
