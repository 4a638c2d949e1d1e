//! Charts are published in `reports/`.

use std::{collections::BTreeSet, fs};

use crate::engine::place::{Place, files_below, put, read, stderr, stdout, well};

const CHARTED: &str = r#"
[stages.split]
kind = "split"
root = "INPUTS"

[stages.first]
kind = "map"
inputs.parts = "split.parts"
chart = true
table = true

[stages.second]
kind = "map"
inputs.parts = "first.parts"
chart = true
"#;

/// Every chart that the lake shows, below `reports`.
fn charts(place: &Place) -> BTreeSet<String> {
    let reports = place.lake().join("reports");
    let charts = files_below(&reports).into_iter();
    charts
        .map(|path| path.strip_prefix(&reports).unwrap().display().to_string())
        .collect()
}

fn expected(stages: &[&str], parts: &[&str]) -> BTreeSet<String> {
    let of_stage = |stage: &&str| {
        let charts = parts
            .iter()
            .map(move |part| format!("own/{stage}/parts/{part}/bytes.svg"));
        charts.collect::<Vec<_>>()
    };
    stages.iter().flat_map(of_stage).collect()
}

#[test]
fn charts_of_the_newest_partitions_are_shown_and_mentioned() {
    let place = Place::with_inputs(CHARTED, 2);
    let said = stderr(&place.run_well(&[]));
    let folder = place.lake().join("reports/own");
    let line = format!("report `{}`", folder.display());
    assert_eq!(said.matches(&line).count(), 1, "{said}");
    let both = ["p000", "p001"];
    assert_eq!(charts(&place), expected(&["first", "second"], &both));
    let chart = read(&folder.join("first/parts/p000/bytes.svg"));
    assert_eq!(chart, b"<svg><title>2 bytes</title></svg>\n");
    let elsewhere = files_below(&place.lake().join("files"));
    assert!(
        elsewhere
            .iter()
            .all(|path| path.extension().unwrap() != "svg")
    );

    // A removed partition is unpublished, and a changed one is updated.
    fs::remove_file(place.inputs().join("p001.txt")).unwrap();
    place.input("p000", b"another text");
    place.run_well(&[]);
    assert_eq!(charts(&place), expected(&["first", "second"], &["p000"]));
    let chart = read(&folder.join("first/parts/p000/bytes.svg"));
    assert_eq!(chart, b"<svg><title>12 bytes</title></svg>\n");
    well(place.bare(&place.lake(), "verify"));

    // Nor is that of a stage which is no longer in the file, and then there is nothing to mention.
    let text = String::from_utf8(read(&place.pipeline())).unwrap();
    let (without, _) = text.split_once("[stages.second]").unwrap();
    put(&place.pipeline(), without.as_bytes());
    place.run_well(&[]);
    assert_eq!(charts(&place), expected(&["first"], &["p000"]));
    put(
        &place.pipeline(),
        without.replace("chart = true", "").as_bytes(),
    );
    let said = stderr(&place.run_well(&[]));
    assert!(!said.contains("report"), "{said}");
    assert_eq!(charts(&place), BTreeSet::new());
}

#[test]
fn a_lost_chart_is_shown_again_and_a_changed_one_is_found() {
    let place = Place::with_inputs(CHARTED, 1);
    place.run_well(&[]);
    let shown = place.published();
    fs::remove_dir_all(place.lake().join("reports")).unwrap();
    place.run_well(&[]);
    assert_eq!(place.published(), shown);
    let chart = place.lake().join("reports/own/second/parts/p000/bytes.svg");
    fs::remove_file(&chart).unwrap();
    put(&chart, b"<svg/>");
    let found = place.bare(&place.lake(), "verify").output().unwrap();
    assert_eq!(found.status.code(), Some(1));
    let said = stdout(&found) + &stderr(&found);
    assert!(
        said.contains("reports/own/second/parts/p000/bytes.svg"),
        "{said}"
    );
}
