//! The report as a program: its files, its schema, and what it does with bad
//! input.

use std::path::Path;
use std::process::{Command, Output};

use raytwin_bench::report::plot::{FRAME, Plot, Series, Ticks};
use raytwin_bench::report::schema::Report;
use serde_json::Value;

fn report(arguments: &[&str], out: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_report"))
        .args(arguments)
        .arg("--out")
        .arg(out)
        .output()
        .expect("the report starts")
}

fn keys(value: &Value, wanted: &[&str]) {
    for key in wanted {
        assert!(value.get(key).is_some(), "no `{key}` in {value}");
    }
}

/// Every field of a document, with the places of list items.
fn paths(value: &Value) -> Vec<String> {
    let below = |key: String, value: &Value| -> Vec<String> {
        let mut all: Vec<String> = paths(value).iter().map(|p| format!("{key}/{p}")).collect();
        all.push(key);
        all
    };
    match value {
        Value::Object(members) => members
            .iter()
            .flat_map(|(key, value)| below(key.clone(), value))
            .collect(),
        Value::Array(items) => items
            .iter()
            .enumerate()
            .flat_map(|(i, value)| below(i.to_string(), value))
            .collect(),
        _ => Vec::new(),
    }
}

#[test]
fn a_quick_report_has_the_documented_keys() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("report");
    let output = report(&["--quick", "--cpu", "--only", "random/pcg"], &folder);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("random/pcg::pcg_hash"));

    let bytes = std::fs::read(folder.join("report.json")).unwrap();
    let parsed: Report = serde_json::from_slice(&bytes).unwrap();
    let json: Value = serde_json::from_slice(&bytes).unwrap();
    // Reading a number may cost its last bit; no field may go.
    assert_eq!(paths(&serde_json::to_value(&parsed).unwrap()), paths(&json));
    keys(
        &json,
        &["version", "machine", "adapters", "kernels", "stages", "bvh"],
    );
    let kernels = json["kernels"].as_array().unwrap();
    assert!(kernels.len() >= 5, "{} kernels", kernels.len());
    for kernel in kernels {
        keys(
            kernel,
            &[
                "name",
                "group",
                "class",
                "cpu_ns",
                "gpu_ns",
                "adapters",
                "cpu_err_ulp_max",
                "gpu_err_ulp_max",
                "parity_ulp_max",
                "parity_bound",
                "hard_cases",
            ],
        );
        keys(&kernel["hard_cases"], &["tried", "passed"]);
        assert_eq!(kernel["module"], "random/pcg");
        assert_eq!(kernel["class"], "A");
        assert_eq!(kernel["cpu_err_ulp_max"], 0.0);
        assert!(kernel["cpu_ns"].as_f64().unwrap() > 0.0);
        assert_eq!(kernel["gpu_ns"], Value::Null, "--cpu");
        assert_eq!(kernel["within"], true);
    }
    assert_eq!(json["adapters"], Value::Array(Vec::new()), "--cpu");

    let page = std::fs::read_to_string(folder.join("index.html")).unwrap();
    assert!(page.contains("pcg_hash"));
    for outside in ["src=\"http", "href=\"http", "<link", "<script"] {
        assert!(!page.contains(outside), "the page needs {outside}");
    }
    for file in &parsed.files {
        assert!(folder.join(file).is_file(), "{file} is listed");
    }
    let beside: Vec<_> = std::fs::read_dir(temp.path()).unwrap().collect();
    assert_eq!(beside.len(), 1, "nothing is left beside: {beside:?}");
}

#[test]
fn schema_rows_have_the_documented_keys() {
    use raytwin_bench::report::schema::{BvhRow, StageRow};
    let stage = serde_json::to_value(StageRow::default()).unwrap();
    keys(&stage, &["name", "variant", "backend", "ms", "rmse"]);
    let bvh = serde_json::to_value(BvhRow::default()).unwrap();
    keys(
        &bvh,
        &[
            "mesh",
            "engine",
            "build_ms",
            "mrays",
            "leaks",
            "false_hits",
            "disagreements",
        ],
    );
    keys(&bvh["mrays"], &["primary", "shadow", "diffuse", "ao"]);
}

#[test]
fn the_documentation_names_every_field() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/report.md");
    let text = std::fs::read_to_string(page).unwrap();
    let mut report = Report::default();
    report.kernels.push(Default::default());
    report.kernels[0]
        .adapters
        .insert("a".into(), Default::default());
    report.kernels[0].baselines.push(Default::default());
    report.kernels[0].baselines[0]
        .adapters
        .insert("a".into(), Default::default());
    report.adapters.push(Default::default());
    report.stages.push(Default::default());
    report.bvh.push(Default::default());
    report.families.push(Default::default());
    report.builds.push(Default::default());
    report.stacks.push(Default::default());
    report.growth.push(Default::default());
    report.convergence.push(Default::default());
    report.slopes.push(Default::default());
    report.references.push(Default::default());
    report.passes.push(Default::default());
    report.estimators.push(Default::default());
    report.estimator_points.push(Default::default());
    report.estimator_costs.push(Default::default());
    report.surfels.push(Default::default());
    report.pictures.push(Default::default());
    report.plots.push(Default::default());
    fn walk(value: &Value, text: &str) {
        match value {
            Value::Object(members) => {
                for (key, value) in members {
                    // The label of an adapter is no field.
                    assert!(
                        key == "a" || text.contains(&format!("`{key}`")),
                        "docs/report.md does not explain `{key}`"
                    );
                    walk(value, text);
                }
            }
            Value::Array(items) => items.iter().for_each(|v| walk(v, text)),
            _ => {}
        }
    }
    walk(&serde_json::to_value(&report).unwrap(), &text);
}

fn refused(arguments: &[&str], named: &str, mend: &str) {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("report");
    let output = report(arguments, &folder);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {errors}");
    assert_eq!(errors.lines().count(), 1, "one line: {errors}");
    assert!(errors.contains(named), "{errors} names {named}");
    assert!(errors.contains(mend), "{errors} says {mend}");
    let left: Vec<_> = std::fs::read_dir(temp.path()).unwrap().collect();
    assert!(left.is_empty(), "{arguments:?} left {left:?}");
}

#[test]
fn a_missing_scene_is_refused() {
    refused(
        &["--cpu", "--scene", "no/such/room.obj"],
        "room.obj",
        "check the path",
    );
}

#[test]
fn broken_scenes_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let cases: [(&str, &[u8], &str); 5] = [
        ("nan.obj", b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "NaN"),
        ("range.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 3\n", "out of range"),
        ("empty.obj", b"", "triangle"),
        ("broken.gltf", b"{\"asset\": ", "broken.gltf"),
        ("broken.glb", b"glTF\x02\x00\x00\x00", "broken.glb"),
    ];
    for (name, contents, mend) in cases {
        let path = temp.path().join(name);
        std::fs::write(&path, contents).unwrap();
        refused(&["--cpu", "--scene", path.to_str().unwrap()], name, mend);
    }
}

#[test]
fn other_bad_input_is_refused() {
    refused(&["--cpu", "--size", "0x0"], "0 x 0", "choose a width");
    refused(&["--cpu", "--only", "no-such"], "no-such", "math/");
}

#[test]
fn an_unwritable_folder_is_refused() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("file");
    std::fs::write(&file, "mine").unwrap();
    for out in [file.clone(), file.join("report")] {
        let output = report(&["--cpu", "--only", "random/pcg"], &out);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{errors}");
        assert!(errors.contains(&*out.to_string_lossy()), "{errors}");
        assert!(errors.contains("--out"), "{errors}");
    }
    assert_eq!(std::fs::read(&file).unwrap(), b"mine");
}

/// Centres of the circles of an SVG.
fn circles(svg: &str) -> Vec<(f64, f64)> {
    let number = |tag: &str, name: &str| -> f64 {
        let start = tag.find(&format!(" {name}=\"")).unwrap() + name.len() + 3;
        let end = start + tag[start..].find('"').unwrap();
        tag[start..end].parse().unwrap()
    };
    svg.split('<')
        .filter(|tag| tag.starts_with("circle"))
        .map(|tag| (number(tag, "cx"), number(tag, "cy")))
        .collect()
}

#[test]
fn a_plot_has_its_points_where_they_belong() {
    let points: Vec<(f64, f64)> = (0..4).map(|k| (10f64.powi(k), 10f64.powi(-k))).collect();
    let plot = Plot {
        title: "known & <data>".into(),
        x_label: "x".into(),
        y_label: "y".into(),
        x_ticks: Ticks::Decimal,
        series: vec![Series {
            name: "line".into(),
            colour: 0,
            points,
            labels: Vec::new(),
            stems: Vec::new(),
            joined: true,
        }],
        guide: None,
    };
    let svg = plot.svg().unwrap();
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
    assert!(svg.contains("known &amp; &lt;data&gt;"));
    let found = circles(&svg);
    assert_eq!(found.len(), 4);
    // Decades are evenly spaced; the margin is 6 % of the range at each end.
    let (left, top, right, bottom) = FRAME;
    for (k, (x, y)) in found.into_iter().enumerate() {
        let t = (0.06 + k as f64 / 3.0) / 1.12;
        let expected_x = f64::from(left) + t * f64::from(right - left);
        let expected_y = f64::from(top) + t * f64::from(bottom - top);
        assert!(
            (x - expected_x).abs() <= 0.51,
            "{k}: x {x}, not {expected_x}"
        );
        assert!(
            (y - expected_y).abs() <= 0.51,
            "{k}: y {y}, not {expected_y}"
        );
    }
}
