//! `index.html`: one file that needs no other.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::schema::{BvhRow, FamilyRow, KernelRow, Rates, Report, SequenceRow};
use super::{Drawn, Shown};

/// The part of an adapter's or engine's label before its driver.
pub(super) fn short(label: &str) -> &str {
    label.split(" (").next().unwrap_or(label)
}

/// Three digits, whatever the size.
pub(super) fn number(x: f64) -> String {
    let magnitude = x.abs();
    if x == 0.0 {
        return "0".into();
    }
    if !(1e-3..1e5).contains(&magnitude) {
        return format!("{x:.1e}");
    }
    let before = magnitude.log10().floor() as i32 + 1;
    let digits = usize::try_from(3 - before).unwrap_or(0);
    let text = format!("{x:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').into()
    } else {
        text
    }
}

/// `12,345`.
fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(c);
    }
    out
}

pub(super) fn page(report: &Report, pictures: &[Shown], plots: &[Drawn]) -> String {
    let is_error = |p: &&Drawn| p.row.file.contains("speed-error");
    let (errors, rest): (Vec<&Drawn>, Vec<&Drawn>) = plots.iter().partition(is_error);
    let is_material = |p: &&Drawn| {
        let title = &p.row.title;
        super::plots::MATERIALS.iter().any(|m| title.starts_with(m))
    };
    let (material, rest): (Vec<&Drawn>, Vec<&Drawn>) = rest.into_iter().partition(is_material);
    let is_estimator = |p: &&Drawn| p.row.title.starts_with(super::plots::ESTIMATOR);
    let (estimator, lines): (Vec<&Drawn>, Vec<&Drawn>) = rest.into_iter().partition(is_estimator);
    let is_surfels = |p: &&Drawn| p.row.title.starts_with(super::plots::SURFELS);
    let (surfels, lines): (Vec<&Drawn>, Vec<&Drawn>) = lines.into_iter().partition(is_surfels);
    let is_tree = |p: &&Drawn| {
        let title = &p.row.title;
        super::plots::TREES.iter().any(|t| title.starts_with(t))
    };
    let (trees, lines): (Vec<&Drawn>, Vec<&Drawn>) = lines.into_iter().partition(is_tree);
    let with_trees = !report.bvh.is_empty() || !trees.is_empty();
    let of_surfels = |p: &&Shown| p.row.stage.as_deref() == Some(super::SURFELS);
    let (surfel_pictures, pictures): (Vec<&Shown>, Vec<&Shown>) =
        pictures.iter().partition(of_surfels);
    let with_estimators = !report.estimator_costs.is_empty();
    let with_materials =
        !material.is_empty() || !report.goals.is_empty() || !report.sequences.is_empty();
    let markup = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "raytwin: speed against error" }
                style { (PreEscaped(include_str!("style.css"))) }
            }
            body {
                h1 { "Speed against error" }
                p.lead { "Every raytwin kernel on the CPU and as WGSL: how fast, how far from the truth, and how far from its twin." }
                (facts(report))
                @for warning in &report.warnings { p.warning { (warning) } }
                (tiles(report))
                nav {
                    a href="#reading" { "How to read this" }
                    @if !errors.is_empty() { a href="#baselines" { "Against the built-ins" } }
                    @if !report.kernels.is_empty() { a href="#kernels" { "Kernels" } }
                    @if with_trees { a href="#traversal" { "Traversal" } }
                    @if !report.families.is_empty() { a href="#hard" { "Hard rays" } }
                    @if with_materials { a href="#materials" { "Materials and filters" } }
                    @if with_estimators { a href="#estimators" { "Estimators" } }
                    @if !report.surfels.is_empty() { a href="#surfels" { "Surfels" } }
                    @if !pictures.is_empty() { a href="#pictures" { "Pictures" } }
                    @if !lines.is_empty() { a href="#convergence" { "Convergence" } }
                    a href="#settings" { "Settings" }
                }
                (reading())
                @if !errors.is_empty() { (baselines(report, &errors)) }
                @if !report.kernels.is_empty() { (kernels(report)) }
                @if with_trees { (traversal(report, &trees)) }
                @if !report.families.is_empty() { (hard(report)) }
                @if with_materials { (materials(report, &material)) }
                @if with_estimators { (estimators(report, &estimator)) }
                @if !report.surfels.is_empty() { (surfel_section(report, &surfels, &surfel_pictures)) }
                @if !pictures.is_empty() { (pictures_section(report, &pictures)) }
                @if !lines.is_empty() { (convergence(report, &lines)) }
                (settings(report))
            }
        }
    };
    markup.into_string()
}

fn facts(report: &Report) -> Markup {
    let m = &report.machine;
    html! {
        dl.facts {
            dt { "Processor" } dd { (m.cpu) ", " (m.threads) " threads, " (m.os) " " (m.arch) }
            @for a in &report.adapters {
                dt { "Adapter" }
                dd {
                    (a.name) ", " (a.driver) " " (a.driver_info) ", " (a.backend)
                    @if a.software { " (software)" }
                }
            }
            @if report.adapters.is_empty() { dt { "Adapter" } dd.off { "none: run with --cpu" } }
            dt { "Embree" }
            dd {
                @match &report.embree.version {
                    Some(version) => (version),
                    None => span.bad { "not found" },
                }
            }
            dt { "tinybvh" }
            dd {
                @match &report.tinybvh {
                    Some(version) => (version),
                    None => span.bad { "takes no part, see the warnings" },
                }
            }
            dt { "raytwin" }
            dd {
                (report.version)
                @if let Some(revision) = &report.revision { " at " code { (revision) } }
                ", " (report.date) ", " (report.settings.mode) " run of "
                (format!("{:.0}", report.seconds)) " s"
            }
        }
    }
}

fn tile(bad: bool, value: String, text: String) -> Markup {
    html! { div.tile.bad[bad] { b { (value) } span { (text) } } }
}

fn tiles(report: &Report) -> Markup {
    let mut tiles = Vec::new();
    let total = report.kernels.len();
    if total > 0 {
        let within = report.kernels.iter().filter(|k| k.within).count();
        tiles.push(tile(
            within < total,
            format!("{within} of {total}"),
            "kernels with every measured error inside its declared bound".into(),
        ));
        let precise: Vec<_> = report
            .kernels
            .iter()
            .filter(|k| k.adapters.values().any(|a| a.precise_differing.is_some()))
            .collect();
        if !precise.is_empty() {
            let same = |k: &&&KernelRow| {
                k.adapters
                    .values()
                    .all(|a| a.precise_differing.unwrap_or(0) == 0)
            };
            tiles.push(tile(
                false,
                format!(
                    "{} of {}",
                    precise.iter().filter(same).count(),
                    precise.len()
                ),
                "kernels give the CPU's bits on the GPU in the precise build".into(),
            ));
        }
        let tried: usize = report.kernels.iter().map(|k| k.hard_cases.tried).sum();
        let passed: usize = report.kernels.iter().map(|k| k.hard_cases.passed).sum();
        let undecided: usize = report.kernels.iter().map(|k| k.hard_cases.undecided).sum();
        tiles.push(tile(
            passed + undecided < tried,
            format!("{passed} of {}", tried - undecided),
            match undecided {
                0 => "hard cases passed by every twin".into(),
                n => format!(
                    "hard cases passed by every twin; {n} more lie on an edge and are undecided"
                ),
            },
        ));
    }
    let lost = |engine: &dyn Fn(&str) -> bool| {
        report
            .families
            .iter()
            .filter(|f| engine(&f.engine))
            .fold((0, 0), |(l, n), f| (l + f.leaks, n + f.rays))
    };
    if !report.families.is_empty() {
        let (ours, rays) = lost(&|e| e.starts_with("raytwin"));
        let (theirs, their_rays) = lost(&|e| e == super::bvh::EMBREE);
        let text = if report.embree.found {
            format!(
                "of {} hard rays lost by our traversal, both twins together; Embree's default loses {} of {}",
                grouped(rays),
                grouped(theirs),
                grouped(their_rays)
            )
        } else {
            format!("of {} hard rays lost by our traversal", grouped(rays))
        };
        tiles.push(tile(ours > 0, grouped(ours), text));
    }
    html! { @if !tiles.is_empty() { div.tiles { @for tile in tiles { (tile) } } } }
}

fn reading() -> Markup {
    html! {
        h2 #reading { "How to read this" }
        p {
            "Errors are in ULP, the distance between neighbouring 32-bit floats at the size of the true value "
            "(or at the scale that the kernel's contract names, for results such as unit vectors). "
            "The truth is computed in double precision from the paper, independently of both twins. "
            "A measured error stands before its bound as " em { "measured / bound" }
            "; the bar in the cell shows how much of the bound is used. A red cell is outside its bound: a bug."
        }
        p {
            "Class A kernels are bit-exact on every adapter, class B agree to a few ULP, class C use transcendental built-ins. "
            "Parity compares the twins as shipped, with whatever the driver makes of the float algebra. "
            em { "Bits differing" } " compares the precise build, the same program with contraction forbidden: "
            "0 is what a software driver must give; hardware may round a division otherwise. "
            "Undecided inputs lie so close to an edge (hit or miss) that rounding decides; they are counted and not compared."
        }
        p {
            "CPU times are one thread's, the median of interleaved runs over arrays; the number beside them is the multiple of a calibration loop "
            "(one dependent PCG hash) timed in the same run, which compares machines. GPU times are a whole dispatch over its number of elements. "
            "A software adapter uses the processor's cores for it."
        }
    }
}

fn error_cell(measured: bool, value: Option<f64>, wrong: usize, bound: f64, exact: bool) -> Markup {
    if !measured {
        return html! { td.off { "–" } };
    }
    let bad = wrong > 0 || value.is_none_or(|v| v > bound);
    if exact && !bad {
        return html! { td.zero { "exact" } };
    }
    let text = match value {
        Some(v) => number(v),
        None => "not finite".into(),
    };
    let part = value.map_or(100.0, |v| (v / bound * 100.0).clamp(0.0, 100.0));
    html! {
        td.bad[bad].meter[!bad] style=[(!bad).then(|| format!("--part:{part:.0}%"))] {
            (text) small { " / " (number(bound)) }
            @if wrong > 0 { " " (grouped(wrong)) " wrong" }
        }
    }
}

/// An error without a bound: from 2^24 ULP on no digit is right.
fn plain_error(value: Option<f64>, median: Option<f64>, wrong: usize) -> Markup {
    let text = |v: f64| {
        if v >= 16_777_216.0 {
            "> 2²⁴".into()
        } else {
            number(v)
        }
    };
    html! { td {
        @match value { Some(v) => (text(v)), None => "not finite" }
        @if wrong > 0 { " + " (grouped(wrong)) " wrong" }
        small { " / " (median.map_or("–".into(), text)) }
    } }
}

fn optional(x: Option<f64>) -> String {
    x.map_or("–".into(), number)
}

fn baselines(report: &Report, plots: &[&Drawn]) -> Markup {
    let mut rows: Vec<&KernelRow> = report
        .kernels
        .iter()
        .filter(|k| !k.baselines.is_empty())
        .collect();
    rows.sort_by_key(|k| k.module != "math/trig");
    let cpu = report.settings.cpu;
    html! {
        h2 #baselines { "Against the built-ins" }
        p {
            "What the usual way costs and errs on each back end, beside the kernel. WGSL bounds its built-ins loosely, and every driver has its own: "
            "a program that must give the same picture everywhere cannot use them. Errors are largest / median, in ULP; from 2²⁴ on no digit is right, as where the truth is 0 and the result is not."
        }
        div.scroll { table {
            thead {
                tr {
                    th {}
                    @if cpu { th.group colspan="2" { "cpu" } }
                    @for a in &report.adapters { th.group colspan="2" { (short(&a.label)) } }
                }
                tr {
                    th { "Function" }
                    @if cpu { th { "ns" } th { "error" } }
                    @for _ in &report.adapters { th { "ns" } th { "error" } }
                }
            }
            tbody { @for k in rows {
                tr.own {
                    td { code { (k.name) } }
                    @if cpu {
                        td { (optional(k.cpu_ns)) }
                        (plain_error(k.cpu_err_ulp_max, k.cpu_err_ulp_median, k.cpu_wrong))
                    }
                    @for a in &report.adapters {
                        @if let Some(on) = k.adapters.get(&a.label) {
                            td { (number(on.ns)) }
                            (plain_error(on.err_ulp_max, on.err_ulp_median, on.wrong))
                        } @else { td.off { "–" } td.off { "–" } }
                    }
                }
                @for b in &k.baselines { tr.peer {
                    td { (b.name) }
                    @if cpu {
                        td { (optional(b.cpu_ns)) }
                        (plain_error(b.cpu_err_ulp_max, b.cpu_err_ulp_median, b.cpu_wrong))
                    }
                    @for a in &report.adapters {
                        @if let Some(on) = b.adapters.get(&a.label) {
                            td { (number(on.ns)) }
                            (plain_error(on.err_ulp_max, on.err_ulp_median, on.wrong))
                        } @else { td.off { "–" } td.off { "–" } }
                    }
                } }
            } }
        } }
        p.note { "Left is faster, down is more accurate. A point is the largest error, the stroke below it the median; errors are drawn between 0.02 and 2²⁴." }
        div.plots { @for plot in plots { figure { (PreEscaped(&plot.svg)) } } }
    }
}

fn kernels(report: &Report) -> Markup {
    let cpu = report.settings.cpu;
    let mut modules: Vec<&str> = Vec::new();
    for k in &report.kernels {
        if !modules.contains(&k.module.as_str()) {
            modules.push(&k.module);
        }
    }
    let columns = 3 + 3 * usize::from(cpu) + 5 * report.adapters.len();
    html! {
        h2 #kernels { "Kernels" }
        p.note { "Largest error before its bound, mean error after it, all in ULP. Hard cases: passed of those decided, + the undecided." }
        div.scroll { table {
            thead {
                tr {
                    th {} th {}
                    @if cpu { th.group colspan="3" { "cpu" } }
                    @for a in &report.adapters { th.group colspan="5" { (short(&a.label)) } }
                    th {}
                }
                tr {
                    th { "Function" } th { "Class" }
                    @if cpu { th { "ns" } th { "error / bound" } th { "mean" } }
                    @for _ in &report.adapters {
                        th { "ns" } th { "error / bound" } th { "mean" } th { "parity / bound" } th { "bits differing" }
                    }
                    th { "Hard cases" }
                }
            }
            @for module in modules { tbody {
                tr { th colspan=(columns) { (module) } }
                @for k in report.kernels.iter().filter(|k| k.module == module) { (kernel(report, k)) }
            } }
        } }
    }
}

fn kernel(report: &Report, k: &KernelRow) -> Markup {
    let exact = k.class == "A";
    let hard = &k.hard_cases;
    let failed = hard.passed + hard.undecided < hard.tried;
    html! { tr {
        td title=(format!("{}{}\n{}", k.name, k.signature, k.source)) { code { (k.name) } }
        td { (k.class) }
        @if report.settings.cpu {
            td { (optional(k.cpu_ns)) small { " " (optional(k.cpu_ratio)) "×" } }
            (error_cell(true, k.cpu_err_ulp_max, k.cpu_wrong, k.cpu_bound, exact))
            td { @if exact { "" } @else { (optional(k.cpu_err_ulp_mean)) } }
        }
        @for a in &report.adapters {
            @if let Some(on) = k.adapters.get(&a.label) {
                td { (number(on.ns)) }
                (error_cell(true, on.err_ulp_max, on.wrong, k.gpu_bound, exact))
                td { @if exact { "" } @else { (optional(on.err_ulp_mean)) } }
                (error_cell(true, on.parity_ulp_max, on.parity_wrong, k.parity_bound, exact))
                @match on.precise_differing {
                    Some(0) => td.zero { "0" },
                    Some(n) => td { (grouped(n)) small { " of " (grouped(k.inputs)) } },
                    None => td.off { "–" },
                }
            } @else { td.off colspan="5" { "not measured" } }
        }
        td.bad[failed] {
            (hard.passed) "/" (hard.tried - hard.undecided)
            @if hard.undecided > 0 { small { " + " (hard.undecided) "?" } }
        }
    } }
}

fn traversal(report: &Report, plots: &[&Drawn]) -> Markup {
    let mut meshes: Vec<&str> = Vec::new();
    for r in &report.bvh {
        if !meshes.contains(&r.mesh.as_str()) {
            meshes.push(&r.mesh);
        }
    }
    html! {
        h2 #traversal { "Traversal" }
        p {
            "Millions of rays a second, one thread and one ray at a time on the CPU, all engines in turn in the same run; "
            "the number beside is the multiple of Embree's default. A software adapter uses all cores. "
            "tinybvh, its eight-wide tree for AVX2, is in a process of its own, since all of it is compiled for this processor, and takes its turns there. "
            "The column for all threads is the geometric mean of the four kinds, rays in pieces over " (report.bvh.first().map_or(0, |r| r.threads)) " threads. "
            "Bytes are those of nodes and triangles as they are walked, Embree's as it counts them itself. "
            "Shadow and AO rays stop at any hit. Leaks, false hits and disagreements are counted on "
            "these meshes' own rays against an intersector in double precision: a leak is a hit that is lost, a false hit one on a triangle that the ray does not touch, a disagreement one at another distance than the truth, each by more than eight roundings of the largest coordinate; ties, two triangles at one distance, are no error."
        }
        @if !report.embree.found {
            p.warning { "Embree: not found. " (report.embree.mend.as_deref().unwrap_or_default()) }
        }
        div.scroll { table {
            thead { tr {
                th { "Engine" } th { "Build, ms" } th { "Bytes a triangle" }
                th { "Primary" } th { "Shadow" } th { "Diffuse" } th { "AO" }
                th { "All threads" }
                th { "Leaks" } th { "False hits" } th { "Disagree" } th { "Ties" }
            } }
            @for mesh in meshes {
                @let rows: Vec<&BvhRow> = report.bvh.iter().filter(|r| r.mesh == mesh).collect();
                tbody {
                    tr { th colspan="12" {
                        (mesh) " "
                        @if let Some(r) = rows.first() {
                            small.off { (grouped(r.triangles)) " triangles, " (grouped(r.checked)) " rays checked" }
                        }
                    } }
                    @for r in rows { tr {
                        td title=(r.engine) { (short(&r.engine)) }
                        td { @match r.build_ms { Some(ms) => (number(ms)), None => span.off { "–" } } }
                        td { @match r.bytes { Some(bytes) => (format!("{bytes:.0}")), None => span.off { "–" } } }
                        @for pick in [|r: &Rates| r.primary, |r: &Rates| r.shadow, |r: &Rates| r.diffuse, |r: &Rates| r.ao] {
                            td {
                                (number(pick(&r.mrays)))
                                @if let Some(e) = &r.to_embree { small { " " (format!("{:.2}", pick(e))) "×" } }
                            }
                        }
                        td { @match &r.all_threads {
                            Some(all) => {
                                (number(all.mean()))
                                @if let Some(e) = &r.all_to_embree { small { " " (format!("{:.2}", e.mean())) "×" } }
                            }
                            None => span.off { "–" }
                        } }
                        (mistakes(r.leaks)) (mistakes(r.false_hits)) (mistakes(r.disagreements))
                        td.off { (grouped(r.ties)) }
                    } }
                    @if !report.embree.found { tr { td { "Embree" } td.bad colspan="11" { "not found" } } }
                }
            }
        } }
        @if !plots.is_empty() {
            h3 { "What a build buys, what it costs to lose no ray, and larger meshes" }
            p {
                "Ours from the fastest build to the slowest, eight wide, each with its collapse; Embree's and tinybvh's with their default quality and their high one, obvhs with its own traversal. "
                "A plot of lost rays asks for rays from the eye to vertices and to points on edges, judged in double precision."
            }
            div.plots { @for plot in plots { figure { (PreEscaped(&plot.svg)) } } }
        }
        @if !report.stacks.is_empty() {
            h3 { "Where the WGSL traversal has its stack" }
            p { "The kernel keeps it in the function. The same text with the stack elsewhere, all in turn, the ratio by the geometric mean of the four kinds of rays; camera rays are compared hit by hit." }
            div.scroll { table {
                thead { tr {
                    th.left { "Mesh" } th.left { "Adapter" } th.left { "Stack" } th { "Rays a workgroup" }
                    th { "Mrays/s" } th { "Ratio" } th { "Other hits" }
                } }
                tbody { @for r in &report.stacks { tr {
                    td.left { (r.mesh) }
                    td.left title=(r.adapter) { (short(&r.adapter)) }
                    td.left { (r.stack) }
                    td { (r.workgroup) }
                    td { (number(r.mrays.mean())) }
                    td { (format!("{:.2}", r.ratio)) }
                    (mistakes(r.differing))
                } } }
            } }
        }
    }
}

fn mistakes(n: usize) -> Markup {
    html! { @if n == 0 { td.zero { "0" } } @else { td.bad { (grouped(n)) } } }
}

fn hard(report: &Report) -> Markup {
    let (mut families, mut engines): (Vec<&str>, Vec<&str>) = (Vec::new(), Vec::new());
    for r in &report.families {
        if !families.contains(&r.family.as_str()) {
            families.push(&r.family);
        }
        if !engines.contains(&r.engine.as_str()) {
            engines.push(&r.engine);
        }
    }
    let find = |family: &str, engine: &str| {
        report
            .families
            .iter()
            .find(|r| r.family == family && r.engine == engine)
    };
    let total = |engine: &str| {
        let mut sum = FamilyRow::default();
        for r in report.families.iter().filter(|r| r.engine == engine) {
            sum.rays += r.rays;
            sum.leaks += r.leaks;
            sum.false_hits += r.false_hits;
            sum.disagreements += r.disagreements;
        }
        sum
    };
    html! {
        h2 #hard { "Hard rays" }
        p {
            "Rays that ordinary tracers lose: through edges and vertices, along axes with either zero, over needles, in meshes of every size. "
            "All meshes are closed and all rays start inside, so a miss is a leak. Where a cell has three numbers they are "
            "leaks, false hits and disagreements. What disagrees are distances on needles and edge-on triangles, whose planes are ill-conditioned, and rays that start on the surface, within rounding of their own triangle. obvhs takes t_max as outside the range and its ray has no direction shorter than 1e-7. tinybvh has no t_min, takes t_max as outside too, and as infinite what is beyond 1e30."
        }
        @if !report.embree.found { p.warning { "Embree: not found, so its columns are missing here." } }
        div.scroll { table {
            thead { tr {
                th { "Family" } th { "Rays" }
                @for engine in &engines { th title=(engine) { (short(engine)) } }
            } }
            tbody {
                @for family in families { tr {
                    td { (family) }
                    td.off { (grouped(find(family, engines[0]).map_or(0, |r| r.rays))) }
                    @for engine in &engines {
                        @match find(family, engine) { Some(r) => (three(r)), None => td.off { "–" } }
                    }
                } }
                tr.own {
                    td { "All" }
                    td { (grouped(total(engines[0]).rays)) }
                    @for engine in &engines { (three(&total(engine))) }
                }
            }
        } }
    }
}

fn three(r: &FamilyRow) -> Markup {
    html! {
        @if r.leaks + r.false_hits + r.disagreements == 0 { td.zero { "0" } }
        @else { td.bad[r.leaks > 0] {
            (grouped(r.leaks))
            @if r.false_hits + r.disagreements > 0 {
                small { ", " (grouped(r.false_hits)) ", " (grouped(r.disagreements)) }
            }
        } }
    }
}

fn figure(report: &Report, shown: &Shown) -> Markup {
    let caption = report
        .adapters
        .iter()
        .fold(shown.row.caption.clone(), |text, a| {
            text.replace(&a.label, short(&a.label))
        });
    let data = format!("data:image/png;base64,{}", STANDARD.encode(&shown.png));
    html! { figure {
        img src=(data) alt=(caption) loading="lazy";
        figcaption { (caption) }
    } }
}

fn materials(report: &Report, plots: &[&Drawn]) -> Markup {
    let figures = |head: &str| {
        let chosen: Vec<&&Drawn> = plots
            .iter()
            .filter(|p| p.row.title.starts_with(head))
            .collect();
        html! { @if !chosen.is_empty() {
            div.plots { @for plot in chosen { figure { (PreEscaped(&plot.svg)) } } }
        } }
    };
    html! {
        h2 #materials { "Materials and filters" }
        @if !report.goals.is_empty() {
            h3 { "Goals" }
            p.note { "Ratios of times from one run, each pair in turns: medians. They are aims and no tests; a machine that is shared may miss one by noise." }
            div.scroll { table {
                thead { tr { th { "Ratio" } th.left { "Back end" } th { "Measured" } th { "Goal" } th.left { "From" } } }
                tbody { @for g in &report.goals { tr {
                    td { (g.name) }
                    td.left title=(g.backend) { (short(&g.backend)) }
                    td.bad[g.measured > g.limit] { (format!("{:.2}", g.measured)) }
                    td { "< " (g.limit) }
                    td.left { (g.detail) }
                } } }
            } }
            @for g in &report.goals { @if let Some(shader) = &g.shader {
                details { summary { "The shader by hand: " (g.name) } pre { (shader) } }
            } }
        }
        @if !report.samplers.is_empty() {
            h3 { "GGX samplers" }
            p {
                "Efficiency is one over variance times nanoseconds of a direction with its density, here over that of sampling the normal distribution: "
                "2 means as good a mean in half the time. The variance is that of value times cosine over density with a Fresnel term of one, dropped samples included."
            }
            (figures("Samplers"))
        }
        @if !report.layers.is_empty() { (layers(report)) (figures("Layers")) }
        @if !report.reflections.is_empty() {
            h3 { "A quarter of a ray a pixel" }
            p {
                "Copper balls of roughness 0.1 to 0.85, in front under a clear coat, trace one ray for four pixels; each pixel gathers its neighbours' hits. "
                "The chapter says that this reduces variance like shooting 16 rays a pixel. We measure how many rays of its own a pixel would need for the same variance, "
                "and for the same error, which counts the bias too (a ratio of sums, and neighbours with other normals), over all balls; the plots below show it by roughness. "
                "A mirror gains nothing. The dashed line is what more rays of a pixel's own would give in the same time: a point below it is worth its filters, and where rays are cheap beside the material (as on a processor) it may not be."
            }
            (reflection_table(report))
            (figures("Worth"))
            (figures("Reconstruction"))
        }
        (passes_table(report))
        @if !report.sequences.is_empty() {
            h3 { "Over time" }
            p {
                "A ray (of reflections a quarter) a pixel and frame; camera, ball or light move. Errors are those of the last frame against a reference, whose own error is in the caption of each table; "
                "flicker is the mean change of the error between the last two frames, half-life the frames until half of a jump has arrived. "
                "SVGF remembers five frames. Its passes trade noise for blur: what is smooth (occlusion) gains, thin penumbras lose, and more so where the first pass is fed back into the history. "
                "Where a shadow moves over a floor that does not, the floor's history is found and holds the shadow of before: it drags behind by as many frames as are remembered, "
                "cut short by a clamp. An edge of the geometry (the front of the floor) stays a line in it, since no pass filters across. What a mirror shows drags too where only its surface is followed. "
                "A lone dark or bright pixel in a picture is a surface of a pixel's width: no neighbour is on it, and where the camera moves it has no history either, so it shows its one sample."
            }
            p {
                "Milliseconds are the CPU's; an adapter's are the sum of the passes that the variant is made of, timed alone at this size (what is not a pass has none): "
                "a colour's moments, and a scalar that is fed back, are reprojected a second time. Both twins give the same picture, so the error is the same."
            }
            @for (name, rows) in super::plots::sequences(report) { (sequence_table(&name, &rows)) (pieces_table(&rows)) }
            (figures("Over time"))
        }
    }
}

/// What the passes of all filters cost on adapters, and the memory they move.
fn passes_table(report: &Report) -> Markup {
    if report.passes.is_empty() {
        return html! {};
    }
    let mut groups: Vec<(&str, [u32; 2])> = Vec::new();
    for r in &report.passes {
        let key = (r.backend.as_str(), r.size);
        if !groups.contains(&key) {
            groups.push(key);
        }
    }
    html! {
        h3 { "Passes" }
        p {
            "Every filter as a wgpu pass, by the adapter's clock. Counted bytes are those that the shader asks for, each tap counted; "
            "ideal ones those of reading each input once and writing each output once. GB a second are the ideal bytes over the time, beside what a copy reaches in the same run."
        }
        @for (backend, [width, height]) in groups {
            div.scroll { table {
                caption { (short(backend)) ", " (width) " × " (height) }
                thead { tr {
                    th.left { "Filter" } th.left { "Step" } th.left { "Images" } th { "ms" } th { "MB counted" } th { "MB ideal" } th { "GB/s" } th { "of a copy's" }
                } }
                tbody { @for r in report.passes.iter().filter(|r| r.backend == backend && r.size == [width, height]) { tr {
                    td.left { (r.signal) }
                    td.left { (r.pass) }
                    td.left { (r.images) }
                    td { (number(r.ms)) }
                    td { (number(r.counted as f64 * 1e-6)) }
                    td { (number(r.ideal as f64 * 1e-6)) }
                    td { (number(r.gb_s)) }
                    td { (format!("{:.0} %", 100.0 * r.gb_s / r.copy_gb_s)) }
                } } }
            } }
        }
    }
}

fn estimators(report: &Report, plots: &[&Drawn]) -> Markup {
    let quiet = "quiet against fast";
    let (fast, by_frame): (Vec<&&Drawn>, Vec<&&Drawn>) =
        plots.iter().partition(|p| p.row.title.contains(quiet));
    let adapters: Vec<&String> = report
        .estimator_costs
        .first()
        .map(|r| r.gpu_ns.keys().collect())
        .unwrap_or_default();
    html! {
        h2 #estimators { "Estimators over time" }
        p {
            "The multiscale mean estimator as printed and in its robust form, beside plain averages. "
            "A still signal should give a quiet answer, and a change should arrive soon; an exponential average trades the one for the other. "
            "The best window in hindsight is the mean of the last frames, as many as would have erred least over all runs, for each frame anew: no estimator without foresight gets there."
        }
        @if !fast.is_empty() {
            h3 { "Quiet against fast" }
            p { "Left and below is better. What is below the line of the exponential averages is better than any of them." }
            div.plots { @for plot in fast { figure { (PreEscaped(&plot.svg)) } } }
        }
        @if !report.estimators.is_empty() {
            h3 { "By signal" }
            div.plots { @for plot in by_frame { figure { (PreEscaped(&plot.svg)) } } }
            div.scroll { table {
                thead { tr {
                    th { "Signal" } th.left { "Estimator" } th { "RMSE" } th { "Mean over the true one" }
                    th { "Half-life, frames" } th { "Nine tenths, frames" }
                } }
                tbody { @for r in &report.estimators { tr {
                    td { (r.signal) }
                    td.left { (r.estimator) }
                    td { (number(r.rmse)) }
                    td { (number(r.bias)) }
                    td { (optional(r.half_life)) }
                    td { (optional(r.ninety)) }
                } } }
            } }
        }
        h3 { "Cost" }
        div.scroll { table {
            thead { tr {
                th { "Estimator" } th { "Bytes" } th { "cpu, ns" }
                @for a in &adapters { th { (short(a)) ", ns" } }
                th { "Error by packing" }
            } }
            tbody { @for r in &report.estimator_costs { tr {
                td { (r.estimator) }
                td { (r.bytes) }
                td { (optional(r.cpu_ns)) }
                @for a in &adapters { td { (optional(r.gpu_ns.get(*a).copied().flatten())) } }
                td { (optional(r.packed_error)) }
            } } }
        } }
    }
}

fn surfel_section(report: &Report, plots: &[&Drawn], pictures: &[&Shown]) -> Markup {
    let mut scenes: Vec<&str> = Vec::new();
    for row in &report.surfels {
        if !scenes.contains(&row.scene.as_str()) {
            scenes.push(&row.scene);
        }
    }
    html! {
        h2 #surfels { "Surfels" }
        p {
            "Light straight from the lamp is traced, light that bounces comes from surfels: a ray a surfel and frame once it is old. "
            "References are path traced at the same pixels; everything is diffuse. "
            "A slot is room for a surfel; its radius is what lets a full pool cover the scene. Times are of the CPU with all threads, rays too, while the pool still grows. "
            "Surfaces that no pixel has seen have no surfels, so what they would reflect is missing and the picture stays too dark: compare the mean with that of surfels everywhere. Bare is the part of the pixels that no surfel covers. "
            "After a change of the lamp the old light takes some 50 frames to fall by half, as each bounce waits for the one before."
        }
        @for scene in scenes {
            h3 { (scene) }
            div.pictures { @for p in pictures.iter().filter(|p| p.row.scene == scene) { (figure(report, p)) } }
            div.plots { @for plot in plots.iter().filter(|p| p.row.title.contains(scene)) { figure { (PreEscaped(&plot.svg)) } } }
            div.scroll { table {
                thead { tr {
                    th.left { "Event" } th { "Slots" } th { "Frame" } th { "Surfels" } th { "RMSE" } th { "without bounces" }
                    th { "FLIP" } th { "Bare" } th { "Mean over the true one" } th { "ms" }
                } }
                tbody { @for r in report.surfels.iter().filter(|r| r.scene == scene) { tr {
                    td.left { (r.event) }
                    td { (grouped(r.slots as usize)) }
                    td { (r.frame) }
                    td { (grouped(r.alive as usize)) }
                    td { (number(r.rmse)) }
                    td { (number(r.direct_rmse)) }
                    td { (number(r.flip)) }
                    td { (number(r.bare)) }
                    td { (number(r.mean)) }
                    td { (number(r.ms)) }
                } } }
            } }
        }
    }
}

fn sequence_table(name: &str, rows: &[&SequenceRow]) -> Markup {
    let reference = rows.first().map_or(0.0, |r| r.reference_rmse);
    let adapters: Vec<&String> = rows
        .first()
        .map(|r| r.gpu_ms.keys().collect())
        .unwrap_or_default();
    html! {
        h4 { (name) }
        div.scroll { table {
        caption { "The reference's own error is about " (number(reference)) "." }
        thead { tr {
            th.left { "Variant" } th { "ms" } @for a in &adapters { th { "ms, " (short(a)) } } th { "RMSE" } th { "Relative MSE" }
            th { "PSNR, dB" } th { "SSIM" } th { "FLIP" } th { "Flicker" } th { "Half-life, frames" }
        } }
        tbody { @for r in rows { tr {
            td.left { (r.variant) }
            td { (number(r.ms)) }
            @for a in &adapters { td { (optional(r.gpu_ms.get(*a).copied().flatten())) } }
            td { (number(r.rmse)) }
            td { (number(r.relative_mse)) }
            td { (format!("{:.1}", r.psnr)) }
            td { (optional(r.ssim)) }
            td { (number(r.flip)) }
            td { (number(r.flicker)) }
            td { @match r.half_life { Some(n) => (n), None => span.off { "–" } } }
        } } }
    } } }
}

/// What each piece buys: error added and time saved when it is left out.
fn pieces_table(rows: &[&SequenceRow]) -> Markup {
    let Some(base) = rows
        .iter()
        .find(|r| r.piece.as_deref() == Some("all of it"))
    else {
        return html! {};
    };
    let percent = |value: f64| match (100.0 * (value - 1.0)).round() {
        0.0 => "±0 %".to_owned(),
        n => format!("{n:+} %"),
    };
    let adapters: Vec<&String> = base.gpu_ms.keys().collect();
    let saved = |then: Option<f64>, now: Option<f64>| match (then, now) {
        (Some(then), Some(now)) => format!("{:+.1}", then - now),
        _ => "–".into(),
    };
    let on = |r: &SequenceRow, a: &String| r.gpu_ms.get(a).copied().flatten();
    html! { div.scroll { table {
        caption {
            "What each piece buys: SVGF with three passes, changed in one thing. RMSE and milliseconds of all of it: "
            (number(base.rmse)) ", " (number(base.ms)) "."
        }
        thead { tr {
            th.left { "Changed" } th { "RMSE added" } th { "RMSE" } th { "FLIP" } th { "Flicker" } th { "ms saved" }
            @for a in &adapters { th { "ms saved, " (short(a)) } }
        } }
        tbody { @for r in rows.iter().filter(|r| r.piece.is_some() && r.variant != base.variant) { tr {
            td.left { (r.piece.as_deref().unwrap_or_default()) }
            td { (format!("{:+.4}", r.rmse - base.rmse)) }
            td { (percent(r.rmse / base.rmse)) }
            td { (percent(r.flip / base.flip)) }
            td { (percent(r.flicker / base.flicker)) }
            td { (saved(Some(base.ms), Some(r.ms))) }
            @for a in &adapters { td { (saved(on(base, a), on(r, a))) } }
        } } }
    } } }
}

fn layers(report: &Report) -> Markup {
    let adapters: Vec<&String> = report
        .layers
        .first()
        .map(|r| r.gpu_ns.keys().collect())
        .unwrap_or_default();
    let cpu = report.settings.cpu;
    html! {
        h3 { "Layers" }
        p {
            "A paint of four layers over a diffuse base, and the best choice of fewer: nanoseconds of density, value and sample, "
            "and how much of the reflected light is then in the wrong place (mean over six views). The number of layers is a constant of the program."
        }
        div.scroll { table {
            thead {
                tr {
                    th {} th {} th {}
                    @if cpu { th.group colspan="3" { "cpu" } }
                    @for a in &adapters { th.group colspan="3" { (short(a)) } }
                }
                tr {
                    th { "Layers" } th.left { "Kept" } th { "Misplaced" }
                    @for _ in 0..adapters.len() + usize::from(cpu) { th { "density" } th { "value" } th { "sample" } }
                }
            }
            tbody { @for r in &report.layers { tr {
                td { (r.layers) }
                td.left { (r.kept) }
                td { (number(r.error)) }
                @if cpu { @for ns in r.cpu_ns { td { (optional(ns)) } } }
                @for a in &adapters {
                    @for ns in r.gpu_ns.get(*a).copied().unwrap_or_default() { td { (optional(ns)) } }
                }
            } } }
        } }
    }
}

fn reflection_table(report: &Report) -> Markup {
    html! { div.scroll { table {
        thead { tr {
            th { "View" } th.left { "Back end" } th.left { "Variant" } th { "Rays, ms" } th { "Filters, ms" }
            th { "RMSE" } th { "Bias" } th { "Rays by variance" } th { "Rays by error" } th { "Pixels unlike cpu" }
        } }
        tbody { @for r in &report.reflections { tr {
            td { (r.scene) ", " (r.view) }
            td.left title=(r.backend) { (short(&r.backend)) }
            td.left {
                @if r.neighbours == 0 { "a ray of its own" }
                @else { "quarter ray, " (r.neighbours) @if r.bilateral { ", bilateral" } }
            }
            td { (number(r.trace_ms)) }
            td { (number(r.filter_ms)) }
            td { (number(r.rmse)) }
            td { (optional(r.bias)) }
            td { (optional(r.rays_by_variance)) }
            td { (optional(r.rays_by_error)) }
            td { @match r.differing {
                Some(n) => { (grouped(n)) small { " of " (grouped(r.pixels)) } }
                None => span.off { "–" },
            } }
        } } }
    } } }
}

/// The reflections' views and the sequences of a scene, in order.
fn other_stages<'a>(pictures: &[&'a Shown]) -> Vec<&'a str> {
    let mut out = Vec::new();
    for p in pictures {
        if let Some(stage) = p.row.stage.as_deref()
            && [super::REFLECTIONS, super::SEQUENCES]
                .iter()
                .any(|s| stage.starts_with(s))
            && !out.contains(&stage)
        {
            out.push(stage);
        }
    }
    out
}

fn stage_title(stage: &str) -> String {
    crate::stages::Stage::ALL
        .iter()
        .find(|s| s.name() == stage)
        .map_or_else(|| stage.to_owned(), |s| s.title().to_owned())
}

fn pictures_section(report: &Report, pictures: &[&Shown]) -> Markup {
    let mut scenes: Vec<&str> = Vec::new();
    for p in pictures {
        if !scenes.contains(&p.row.scene.as_str()) {
            scenes.push(&p.row.scene);
        }
    }
    let [width, height] = report.settings.picture;
    html! {
        h2 #pictures { "Pictures" }
        p {
            "Each stage on each back end at " (width) " by " (height) " pixels, at one sample a pixel and as reference; "
            "beside each GPU picture its difference to the CPU's of the same samples, sixteen times brighter. "
            "The random integers and the order of operations are the same, so a difference is a driver's float algebra at an edge, and nothing else."
        }
        @for scene in scenes {
            @let of_scene: Vec<&Shown> = pictures.iter().copied().filter(|p| p.row.scene == scene).collect();
            h3 { (scene) }
            @for p in of_scene.iter().filter(|p| p.row.stage.is_none()) { div.hero { (figure(report, p)) } }
            @if report.stages.iter().any(|r| r.scene == scene) { (stage_table(report, scene)) }
            @for stage in crate::stages::Stage::ALL {
                @let of_stage: Vec<&&Shown> = of_scene.iter().filter(|p| p.row.stage.as_deref() == Some(stage.name())).collect();
                @if !of_stage.is_empty() {
                    h4 { (stage.title()) }
                    div.pictures { @for p in of_stage { (figure(report, p)) } }
                }
            }
            @for stage in other_stages(&of_scene) {
                h4 {
                    @if let Some(view) = stage.strip_prefix("reflections_") { "Reflections, " (view) }
                    @else { "Over time: " (stage.trim_start_matches("sequences_").replace('_', " ")) }
                }
                div.pictures {
                    @for p in of_scene.iter().filter(|p| p.row.stage.as_deref() == Some(stage)) { (figure(report, p)) }
                }
            }
        }
    }
}

fn stage_table(report: &Report, scene: &str) -> Markup {
    html! { div.scroll { table {
        thead { tr {
            th { "Stage" } th.left { "Variant" } th.left { "Back end" } th { "Samples" }
            th { "ms" } th { "Mrays/s" } th { "RMSE" } th { "RMSE to cpu" } th { "Pixels unlike cpu" }
        } }
        tbody { @for r in report.stages.iter().filter(|r| r.scene == scene) { tr {
            td { (stage_title(&r.name)) }
            td.left { (r.variant) }
            td.left title=(r.backend) { (short(&r.backend)) }
            td { (r.samples) }
            td { (number(r.ms)) }
            td { (number(r.rays as f64 / r.ms.max(1e-9) * 1e-3)) }
            td { (optional(r.rmse)) }
            td { (optional(r.parity_rmse)) }
            td { @match r.differing {
                Some(n) => { (grouped(n)) small { " of " (grouped(r.pixels)) } }
                None => span.off { "–" },
            } }
        } } }
    } } }
}

fn convergence(report: &Report, plots: &[&Drawn]) -> Markup {
    html! {
        h2 #convergence { "Convergence" }
        p {
            "Error of the picture against the number of samples and against time, both axes logarithmic. "
            "Independent samples must fall along the dashed line, as samples to the power −1/2; Halton points with a random rotation for each pixel fall faster. "
            "A grid is the same in every pixel: it has no noise but bands, and at few samples it looks better by the number than to the eye."
        }
        @for r in &report.references { p.note {
            "Reference for " (r.stage.replace('_', " ")) " in " (r.scene) ": " (r.samples)
            " samples a pixel over " (grouped(r.pixels)) " pixels, its own error about " (number(r.rmse)) ". "
        } }
        div.plots { @for plot in plots { figure { (PreEscaped(&plot.svg)) } } }
    }
}

fn settings(report: &Report) -> Markup {
    let s = &report.settings;
    html! {
        h2 #settings { "Settings" }
        dl.facts {
            dt { "Kernels" }
            dd {
                "errors over " (grouped(s.kernel_inputs)) " random inputs (an eighth where a kernel reads a mesh) and the hard cases; CPU times over "
                (grouped(s.timed_elements)) " elements, median of " (s.timed_runs) " runs"
            }
            dt { "Traversal" }
            dd {
                (grouped(s.rays)) " rays of each kind, median of " (s.ray_rounds) " rounds over all engines; "
                (grouped(s.family_rays)) " rays in each hard family"
            }
            dt { "Pictures" } dd { (s.picture[0]) " × " (s.picture[1]) }
            @if let Some(only) = &s.only { dt { "Only" } dd { code { (only) } } }
            @if let Some(scene) = &s.scene { dt { "Scene" } dd { code { (scene) } } }
        }
        footer { "The same numbers are in " code { "report.json" } ", the pictures in " code { "pictures/" }
            ", the plots in " code { "plots/" } "; docs/report.md explains each field." }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        let texts = [
            0.0, 1.0, 0.12345, 12.345, 1234.5, 250_000.0, 1.5, 99.96, 0.0001, -2.5,
        ]
        .map(number);
        let expected = [
            "0", "1", "0.123", "12.3", "1234", "2.5e5", "1.5", "100", "1.0e-4", "-2.5",
        ];
        assert_eq!(texts, expected);
        assert_eq!(grouped(1_234_567), "1,234,567");
        assert_eq!(short("llvmpipe (LLVM 15) (Mesa)"), "llvmpipe");
    }

    #[test]
    fn a_page_escapes_and_needs_no_other_file() {
        let report = Report {
            warnings: vec!["<script>".into()],
            ..Report::default()
        };
        let page = page(&report, &[], &[]);
        assert!(page.contains("&lt;script&gt;") && !page.contains("<script"));
        assert!(!page.contains("<link") && !page.contains("src=\"http"));
    }
}
