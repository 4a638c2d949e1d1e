//! `pipeline doctor` says what is ready and what is missing.

use std::net::TcpListener;

use crate::{
    bench::{Bench, put, stderr, stdout},
    commands::{done, pipeline},
};

#[test]
fn doctor_finds_everything_ready_and_leaves_nothing_behind() {
    let bench = Bench::new();
    let report = done(&bench, "doctor", &[]);
    assert!(!bench.lake().exists());
    assert!(
        report.lines().all(|line| line.starts_with("ok ")),
        "{report}"
    );
    for subject in [
        "lake",
        "hard links",
        "locks",
        "compute",
        "ingest",
        "retarget",
        "train",
        "sample",
        "screen",
        "dispatch",
        "robot cell",
    ] {
        let has_line = report.lines().any(|line| line[9..].starts_with(subject));
        assert!(has_line, "{subject}: {report}");
    }
}

/// The report of a doctor that is not content, and what it says to people.
fn missing(arguments: &[&str]) -> (String, String) {
    let output = Bench::new().command("doctor", arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stdout(&output));
    (stdout(&output), stderr(&output))
}

#[test]
fn doctor_names_what_is_missing_and_what_to_do() {
    let (report, hints) = missing(&[
        "--set",
        "ingest.root=no/such/folder",
        "--set",
        "train.hand=no/such.urdf",
        "--set",
        "sample.steps=1",
    ]);
    for (stage, says) in [
        ("ingest", "no/such/folder"),
        ("train", "no/such.urdf"),
        ("sample", "steps"),
    ] {
        let line = report.lines().find(|line| line[9..].starts_with(stage));
        let line = line.unwrap();
        assert!(
            line.starts_with("missing ") && line.contains(says),
            "{line}"
        );
    }
    assert!(hints.contains("hint: unpack the dataset"), "{hints}");
    assert!(
        hints.contains("`pipelines/cgf.toml` cannot run: 3 missing"),
        "{hints}"
    );
    assert!(report.contains("\nok       retarget "), "{report}");
}

#[test]
fn doctor_asks_a_real_cell_whether_it_is_there() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let cell = format!("dispatch.cell=tcp/{}", listener.local_addr().unwrap());
    let report = done(&Bench::new(), "doctor", &["--set", &cell]);
    assert!(report.contains("\nunset    robot cell"), "{report}");
    assert!(report.contains("--execute"), "{report}");
    drop(listener);
    let (report, hints) = missing(&["--set", &cell]);
    assert!(report.contains("\nmissing  robot cell"), "{report}");
    assert!(hints.contains("dispatch.cell=simulated"), "{hints}");
}

#[test]
fn doctor_notices_a_lake_that_cannot_be_written() {
    let folder = tempfile::tempdir().unwrap();
    put(&folder.path().join("file"), "no folder\n");
    let lake = folder.path().join("file/lake");
    let output = pipeline(&["doctor", "--lake", lake.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    let (report, hints) = (stdout(&output), stderr(&output));
    assert!(report.starts_with("missing  lake"), "{report}");
    assert!(hints.contains("--lake DIR"), "{hints}");
}

#[test]
fn doctor_reports_a_wrong_file_as_every_command_does() {
    let wrong = pipeline(&["doctor", "no/such.toml"]);
    assert_eq!(wrong.status.code(), Some(2));
    let several = pipeline(&["doctor", "--set", "seed=1,2"]);
    assert_eq!(several.status.code(), Some(2));
    assert!(
        stderr(&several).contains("one value"),
        "{}",
        stderr(&several)
    );
}
