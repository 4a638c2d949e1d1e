//! A change reruns only what depends on it.

use std::{
    collections::BTreeMap,
    fs::File,
    time::{Duration, SystemTime},
};

use serde_json::Value;

use crate::engine::{
    place::{Place, name, stdout, well},
    program_maps::Maps,
};

/// Recordings, so to speak.
const N_FILES: usize = 200;

const FIVE_STAGES: &str = r#"
[stages.split]
kind = "split"
root = "INPUTS"
modulo = 2

[stages.first]
kind = "map"
inputs.parts = "split.parts"

[stages.second]
kind = "map"
inputs.parts = "first.parts"

[stages.third]
kind = "map"
inputs.parts = "second.parts"

[stages.gather]
kind = "gather"
inputs.parts = "third.parts"
"#;

fn counts(expected: &[(&str, usize)]) -> BTreeMap<String, usize> {
    let counts = expected.iter();
    counts.map(|&(kind, n)| (kind.to_owned(), n)).collect()
}

/// Returns the number of units of each output in each state of the plan.
fn planned(place: &Place) -> BTreeMap<String, BTreeMap<String, usize>> {
    let plan = stdout(&well(place.command("plan", &["--format", "json"])));
    let plan: Value = serde_json::from_str(&plan).unwrap();
    let mut counts: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for node in plan["nodes"].as_array().unwrap() {
        let name = node["node"]["stage"].as_str().unwrap();
        for unit in node["units"].as_array().into_iter().flatten() {
            let states = counts.entry(name.to_owned()).or_default();
            let state = unit["state"].as_str().unwrap();
            *states.entry(state.to_owned()).or_default() += 1;
        }
    }
    counts
}

#[test]
fn a_change_reruns_only_its_dependents() {
    changes_rerun_dependents(Maps::Stages);
}

#[test]
fn a_change_reruns_only_its_dependent_programs() {
    changes_rerun_dependents(Maps::Programs);
}

fn changes_rerun_dependents(maps: Maps) {
    let place = Place::with_inputs(&maps.of(FIVE_STAGES), N_FILES);
    place.run_well(&[]);
    let all = [("split", N_FILES), ("map", 3 * N_FILES), ("gather", 1)];
    assert_eq!(place.take_counts(), counts(&all));

    // One recording is changed: one unit per mapped stage, and the one that gathers.
    place.input(&name(7), b"another text");
    let mapped = |uncertain| counts(&[("cached", N_FILES - 1), (uncertain, 1)]);
    assert_eq!(
        planned(&place),
        BTreeMap::from([
            ("split".to_owned(), mapped("run")),
            ("first".to_owned(), mapped("pending")),
            ("second".to_owned(), mapped("pending")),
            ("third".to_owned(), mapped("pending")),
            ("gather".to_owned(), counts(&[("pending", 1)])),
        ])
    );
    place.run_well(&[]);
    let one_each = counts(&[("split", 1), ("map", 3), ("gather", 1)]);
    assert_eq!(place.take_counts(), one_each);

    // All files are touched: nothing.
    let hour = Duration::from_hours(1);
    let modified = SystemTime::UNIX_EPOCH + 400_000 * hour;
    for number in 0..N_FILES {
        let path = place.inputs().join(format!("{}.txt", name(number)));
        let file = File::options().write(true).open(path).unwrap();
        file.set_modified(modified).unwrap();
    }
    place.run_well(&[]);
    assert_eq!(place.take_counts(), counts(&[]));

    // Another text with the same bytes modulo 2 and the same first letter: nothing below.
    place.input(&name(7), b"cnother text");
    place.run_well(&[]);
    let labels_differ = counts(&[("split", 1), ("map", 3)]);
    assert_eq!(place.take_counts(), labels_differ);
    place.input(&name(7), b"cpother text");
    place.run_well(&[]);
    assert_eq!(place.take_counts(), counts(&[("split", 1)]));

    // A value of the third mapped stage: its units, and the one that gathers.
    place.run_well(&["--set", &format!("third.{}=9", maps.add())]);
    let below = counts(&[("map", N_FILES), ("gather", 1)]);
    assert_eq!(place.take_counts(), below);
}

#[test]
fn a_change_of_code_reaches_the_kind_and_what_comes_out_differently() {
    let place = Place::with_inputs(FIVE_STAGES, 5);
    place.run_well(&[]);
    place.take_counts();
    let run_with = |versions: &str| {
        let mut command = place.command("run", &[]);
        command.env("OWN_STAGES_CODE", versions);
        well(command);
        place.take_counts()
    };
    // The new code of `split` gives the same bytes.
    assert_eq!(run_with("split=2"), counts(&[("split", 5)]));
    let below = counts(&[("map", 15), ("gather", 1)]);
    assert_eq!(run_with("split=2,map=2"), below);
    assert_eq!(run_with("split=2,map=2,group=2"), counts(&[]));
    // Earlier results are still there.
    assert_eq!(run_with(""), counts(&[]));
}
