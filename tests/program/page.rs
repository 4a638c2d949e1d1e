//! The page of a run: in a browser, and beside the lake's own figures.
//!
//! `PIPELINE_NODE_MODULES` names a folder with `puppeteer-core`, `axe-core`, `html-validate` and `gltf-validator`
//! from npm, `PIPELINE_CHROMIUM` a Chromium; without them the page is not opened, and the test says so.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use lake::recording;
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use robot::Link;
use serde_json::Value;
use stage_report::RecordedMotion;

use crate::program::bench::{Bench, stderr, stdout};

/// Largest page of the bundled sample, in bytes.
const MAX_PAGE_BYTES: u64 = 8_000_000;
/// Greatest difference of a link or the object in the player from the recording, in meters and radians.
const TOLERANCE: (f64, f64) = (1e-3, 0.5 * std::f64::consts::PI / 180.0);

/// Answers of a query, as JSON.
fn ask(folder: &Path, sql: &str) -> Vec<Value> {
    let asked = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(folder)
        .args(["query", "--run", "1", "--format", "json", sql])
        .output()
        .unwrap();
    assert!(asked.status.success(), "{}", stderr(&asked));
    let text = stdout(&asked);
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// Checks the page of the first run of a project.
pub(crate) fn check(lab: &Path) {
    let page = lab.join("data/lake/reports/cgf/report/page/all/index.html");
    let bytes = fs::metadata(&page).unwrap().len();
    assert!(bytes < MAX_PAGE_BYTES, "{bytes} bytes");
    let html = fs::read_to_string(&page).unwrap();
    // The marks of a machine, and anything that would be fetched.
    let host = fs::read_to_string("/etc/hostname").unwrap_or_default();
    for stranger in [
        "http://",
        "https://",
        "src=",
        env!("CARGO_MANIFEST_DIR"),
        lab.to_str().unwrap(),
    ] {
        let allowed = ["http://www.w3.org/2000/svg"];
        let found = html.matches(stranger).count();
        let known: usize = allowed
            .iter()
            .map(|known| {
                if known.starts_with(stranger) {
                    html.matches(known).count()
                } else {
                    0
                }
            })
            .sum();
        assert_eq!(found, known, "`{stranger}` is in the page");
    }
    assert!(
        host.trim().len() < 4 || !html.contains(host.trim()),
        "the host is in the page"
    );
    let rates = ask(
        lab,
        "select object, count(*) as n, sum(cast(success as int)) as held from rollouts group by object order by object",
    );
    let csv = fs::read_to_string(page.with_file_name("by_object.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect())
        .collect();
    assert_eq!(rows.len(), rates.len());
    for (row, expected) in rows.iter().zip(&rates) {
        assert_eq!(row[0], expected["object"].as_str().unwrap());
        assert_eq!(row[5], expected["held"].to_string());
        assert_eq!(row[6], expected["n"].to_string());
    }
    in_browser(lab, &page, &rates);
}

/// Clicks through the page, and compares its text and its player with the lake.
fn in_browser(lab: &Path, page: &Path, rates: &[Value]) {
    let variables = ["PIPELINE_NODE_MODULES", "PIPELINE_CHROMIUM"];
    let [Some(modules), Some(chromium)] = variables.map(measured_data::named_by) else {
        return;
    };
    let files = lab.join("data/lake/files/cgf/screen/rollouts/025_mug");
    let recording = crate::program::bench::first(&files, |_recording| true);
    let id = recording.file_stem().unwrap().to_str().unwrap();
    let motion = RecordedMotion::read(id, &recording::read(&recording).unwrap(), None).unwrap();
    let n = motion.moments.len();
    let moments = [0, n / 5, n / 3, n / 2, n - 1].map(|idx| &motion.moments[idx]);
    let times: Vec<String> = moments
        .iter()
        .map(|moment| moment.time_s.to_string())
        .collect();
    let ran = Command::new("node")
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/program/page/browser.cjs"))
        .args([page, chromium.as_path()])
        .args([id, &times.join(",")])
        .env("NODE_PATH", &modules)
        .output()
        .unwrap();
    assert!(ran.status.success(), "{}{}", stdout(&ran), stderr(&ran));
    let found: Value = serde_json::from_str(&stdout(&ran)).unwrap();
    eprintln!(
        "first paint of the page after {} ms",
        found["first_paint_ms"]
    );
    for nothing in ["faults", "violations", "invalid"] {
        assert_eq!(
            found[nothing].as_array().unwrap().len(),
            0,
            "{nothing}: {}",
            found[nothing]
        );
    }
    let requests = found["requests"].as_array().unwrap();
    assert!(
        requests
            .iter()
            .all(|one| one.as_str().unwrap().starts_with("file:///")
                || one.as_str().unwrap().starts_with("data:")),
        "{requests:?}"
    );
    reads_as_asked(lab, &found, rates);
    let of_object = found["filtered"].as_array().unwrap();
    assert!(
        !of_object.is_empty() && of_object.iter().all(|one| one == "025_mug"),
        "{of_object:?}"
    );
    assert_eq!(found["filtered"], found["clicked"]);
    assert_eq!(found["unfiltered_n"], found["motions_n"]);
    assert!(
        found["played_s"].as_f64().unwrap() > 0.1,
        "{}",
        found["played_s"]
    );
    assert_eq!(found["says_pause"], "Pause");
    for (what, expected) in [
        ("is_paused", true),
        ("blank", false),
        ("scrub_changes", true),
        ("drag_turns", true),
        ("key_plays", true),
    ] {
        assert_eq!(found[what], expected, "{what}");
    }
    assert_ne!(found["next"], id);
    assert_eq!(found["previous"], id);
    for (moment, shown) in moments.iter().zip(found["poses"].as_array().unwrap()) {
        let mut expected: BTreeMap<String, Isometry3<f64>> = BTreeMap::new();
        expected.insert("object".to_owned(), *moment.table_from_object);
        let links = motion.robot.forward_kinematics::<Link>(&moment.q).unwrap();
        for (link, root_from_link) in motion.robot.links().iter().zip(links) {
            expected.insert(
                link.name.clone(),
                *(moment.table_from_root * root_from_link),
            );
        }
        assert!(expected.len() > 20);
        for (name, expected) in &expected {
            let shown = pose(&shown[name]);
            let off_m = (shown.translation.vector - expected.translation.vector).norm();
            let off_rad = shown.rotation.angle_to(&expected.rotation);
            assert!(
                off_m < TOLERANCE.0 && off_rad < TOLERANCE.1,
                "`{name}` is off by {off_m} m, {off_rad} rad"
            );
        }
    }
}

/// The page's text has the figures of queries.
fn reads_as_asked(lab: &Path, found: &Value, rates: &[Value]) {
    let objects = found["objects"].as_array().unwrap();
    for (row, expected) in objects.iter().zip(rates) {
        assert_eq!(row[0], expected["object"]);
        let (held, n) = (
            expected["held"].as_f64().unwrap(),
            expected["n"].as_f64().unwrap(),
        );
        assert_eq!(
            row[2].as_str().unwrap(),
            format!("{:.1}\u{a0}%", 100.0 * held / n)
        );
        assert_eq!(row[4].as_str().unwrap(), expected["held"].to_string());
        assert_eq!(row[5].as_str().unwrap(), expected["n"].to_string());
    }
    let failures = ask(
        lab,
        "select reason, count(*) as n from rollouts where not success group by reason",
    );
    let reasons = found["reasons"].as_array().unwrap();
    assert_eq!(reasons.len(), failures.len());
    for expected in failures {
        let word = expected["reason"].as_str().unwrap().replace('_', " ");
        let row = reasons.iter().find(|row| row[0] == *word).unwrap();
        assert_eq!(row[1].as_str().unwrap(), expected["n"].to_string());
    }
    let trials = ask(
        lab,
        "select sum(successes_n) as s, sum(trials_n) as n from trials",
    );
    let (s, n) = (&trials[0]["s"], &trials[0]["n"]);
    let headline = found["headline"].as_str().unwrap();
    assert!(
        headline.starts_with("simulated success: objects ")
            && headline.ends_with(&format!(", executions {s} of {n}")),
        "{headline}"
    );
    let all = ask(
        lab,
        "select candidate_rate_mean as mean, successes_n as s, candidates_n as n from rates where origin = 'all'",
    );
    let figures = found["figures"].as_array().unwrap();
    let row = figures
        .iter()
        .find(|row| {
            row[0]
                .as_str()
                .unwrap()
                .starts_with("candidates that succeed (refine, all")
        })
        .unwrap();
    assert_eq!(
        row[1].as_str().unwrap(),
        format!("{:.1}\u{a0}%", 100.0 * all[0]["mean"].as_f64().unwrap())
    );
    assert_eq!(
        [row[3].as_str().unwrap(), row[4].as_str().unwrap()],
        [all[0]["s"].to_string(), all[0]["n"].to_string()]
    );
    let samples = ask(
        lab,
        "select count(*) as n from draws where stage = 'refine'",
    );
    let funnel = found["funnel"].as_array().unwrap();
    let row = funnel.iter().find(|row| row[0] == "samples").unwrap();
    assert_eq!(row[1].as_str().unwrap(), samples[0]["n"].to_string());
}

/// A pose by its position and its axes.
fn pose(shown: &Value) -> Isometry3<f64> {
    let vector = |key: &str| {
        let numbers = &shown[key];
        Vector3::from([0, 1, 2].map(|idx| numbers[idx].as_f64().unwrap()))
    };
    let axes = Matrix3::from_columns(&["x", "y", "z"].map(vector));
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&axes));
    Isometry3::from_parts(vector("position").into(), rotation)
}

/// The command makes the page of a run anew, with times, and compares runs.
#[test]
fn a_page_is_made_of_any_run_and_of_two_side_by_side() {
    let bench = crate::program::commands::finished();
    let out = tempfile::tempdir().unwrap();
    let make = |name: &str, runs: &[&str]| -> PathBuf {
        let folder = out.path().join(name);
        let mut command = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        command
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .arg("report")
            .args(runs);
        let ran = command
            .arg("--out")
            .arg(&folder)
            .arg("--lake")
            .arg(bench.lake())
            .output()
            .unwrap();
        assert!(ran.status.success(), "{}", stderr(&ran));
        let page = folder.join("index.html");
        assert_eq!(stdout(&ran).trim(), page.display().to_string());
        page
    };
    let one = fs::read_to_string(make("one", &[])).unwrap();
    assert!(one.contains("<th scope=\"col\" class=\"number\">Time</th>"));
    assert!(!one.contains("id=\"runs\""));
    let again = fs::read_to_string(make("again", &["1"])).unwrap();
    assert!(one == again, "the newest run is the first");
    let two = fs::read_to_string(make("two", &["newest", "1"])).unwrap();
    assert!(two.contains("<h2 id=\"runs-title\">Runs side by side</h2>"));
    assert!(out.path().join("two/runs_by_object.csv").is_file());
    assert!(out.path().join("one/report.md").is_file());
}

/// A pipeline without a cell, without training, or with one stage alone has a page without holes.
#[test]
fn what_is_not_there_is_said() {
    let bench = Bench::new();
    let mut replay = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    replay
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", "pipelines/replay.toml", "--lake"])
        .arg(bench.lake())
        .arg("--set")
        .arg(format!("ingest.root={}", bench.root().display()));
    let ran = replay.output().unwrap();
    assert!(ran.status.success(), "{}", stderr(&ran));
    let page = bench
        .lake()
        .join("reports/replay/report/page/all/index.html");
    assert!(
        stderr(&ran)
            .trim_end()
            .ends_with(&format!("report `{}`", page.display())),
        "{}",
        stderr(&ran)
    );
    let html = fs::read_to_string(&page).unwrap();
    for said in [
        "No training is wired to this report.",
        "candidates succeed",
        "<h2 id=\"motions-title\">Motions</h2>",
    ] {
        assert!(html.contains(said), "{said}");
    }
    let text = html.split("<script").next().unwrap();
    assert!(!text.contains("NaN") && !text.contains("inf "));
}
