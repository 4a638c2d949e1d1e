//! `gc` removes unreferenced artifacts and keeps the others, beside concurrent runs.

use std::{fs, process::Command};

use serde_json::Value;

use crate::engine::place::{CHAIN, Place, Running, assert_same, files_below, stderr, stdout, well};

/// The pipeline with another value, which changes every unit of `first` and downstream.
const OTHER: [&str; 2] = ["--set", "first.add=9"];

/// Bytes of the blobs that a lake holds.
fn bytes_kept(place: &Place) -> u64 {
    files_below(&place.lake().join("blobs"))
        .iter()
        .map(|path| fs::metadata(path).unwrap().len())
        .sum()
}

fn gc(place: &Place, arguments: &[&str]) -> Value {
    let mut command = place.bare(&place.lake(), "gc");
    command.args(["--format", "json"]).args(arguments);
    serde_json::from_slice(&well(command).stdout).unwrap()
}

fn tag(place: &Place, command: &str, arguments: &[&str]) {
    let mut command = place.bare(&place.lake(), command);
    command.args(arguments);
    well(command);
}

fn n_units(collected: &Value) -> usize {
    let units = collected["units"].as_object().unwrap().values();
    units
        .map(|of_output| of_output["n_units"].as_u64().unwrap() as usize)
        .sum()
}

fn assert_whole(place: &Place) {
    well(place.bare(&place.lake(), "verify"));
}

#[test]
fn a_dry_run_says_what_goes_and_exactly_that_goes() {
    let place = Place::with_inputs(CHAIN, 8);
    place.run_well(&OTHER);
    place.run_well(&[]);
    let (before, shown) = (bytes_kept(&place), place.published());
    place.take_log();
    let said = gc(&place, &["--dry-run"]);
    assert_eq!(bytes_kept(&place), before, "a dry run removes nothing");
    // What `first` and those after it made with the other value; `split` is the same in both runs.
    assert!(n_units(&said) >= 8 + 8, "{said}");
    assert!(said["units"].get("split.parts").is_none(), "{said}");
    let done = gc(&place, &[]);
    assert_eq!(done["units"], said["units"]);
    assert_eq!(done["n_bytes"], said["n_bytes"]);
    let freed = before - bytes_kept(&place);
    assert_eq!(Some(freed), said["n_bytes"].as_u64());
    assert_whole(&place);
    assert_eq!(n_units(&gc(&place, &[])), 0, "nothing is left to go");
    // Kept artifacts still exist, and removed ones are made like new ones.
    place.run_well(&[]);
    assert!(place.take_log().is_empty());
    assert_same(&place.published(), &shown, "");
    place.run_well(&OTHER);
    assert!(!place.take_log().is_empty());
    assert_same(&place.published(), &place.undisturbed(&OTHER), "");
}

#[test]
fn gc_keeps_tagged_runs_and_current_results() {
    let place = Place::with_inputs(CHAIN, 4);
    place.run_well(&OTHER);
    tag(&place, "tag", &["1", "good"]);
    place.run_well(&["--set", "first.add=11"]);
    place.run_well(&["--set", "first.add=12"]);
    // The file was never run to completion, but the units of `split` that it reaches are kept.
    place.take_log();
    let gone = gc(&place, &[]);
    assert!(n_units(&gone) > 0, "{gone}");
    assert_whole(&place);
    for (values, is_kept) in [
        (["--set", "first.add=12"], true),
        (OTHER, true),
        (["--set", "first.add=11"], false),
    ] {
        place.run_well(&values);
        let log = place.take_log();
        assert_eq!(log.is_empty(), is_kept, "{values:?}: {log:?}");
        assert!(log.iter().all(|made| made.kind != "split"), "{log:?}");
    }
    tag(&place, "untag", &["good"]);
    place.run_well(&[]);
    gc(&place, &[]);
    place.take_log();
    place.run_well(&OTHER);
    assert!(!place.take_log().is_empty(), "nothing kept it any more");
}

#[test]
fn a_run_that_goes_on_loses_nothing() {
    let place = Place::with_inputs(CHAIN, 4);
    place.run_well(&OTHER);
    place.run_well(&[]);
    // A run takes old results into use and makes new ones, and is held in the middle.
    place.input("held", b"a held one");
    for partition in ["p000", "p001", "p002", "p003"] {
        place.let_go(partition);
    }
    let mut run = Running::start(place.held(&OTHER));
    run.wait_for(&place, "held");
    gc(&place, &[]);
    gc(&place, &[]);
    assert_eq!(
        fs::read_dir(place.lake().join("staging")).unwrap().count(),
        1,
        "what is in the making stays"
    );
    // Without a gate all units proceed.
    fs::remove_dir_all(place.path("gate")).unwrap();
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
    assert_whole(&place);
    assert_same(&place.published(), &place.undisturbed(&OTHER), "");
}

#[test]
fn artifact_removed_during_verify_is_not_a_fault() {
    let place = Place::with_inputs(CHAIN, 12);
    place.run_well(&[]);
    for time in 0..8 {
        place.run_well(&["--set", &format!("first.add={}", 10 + time)]);
        place.run_well(&[]);
        let verifying = [(); 3].map(|()| Running::start(place.bare(&place.lake(), "verify")));
        let collecting = Running::start(place.bare(&place.lake(), "gc"));
        for verifying in verifying {
            let (code, said) = verifying.finish();
            assert_eq!(code, Some(0), "{said}");
        }
        let (code, said) = collecting.finish();
        assert_eq!(code, Some(0), "{said}");
    }
}

#[test]
fn gc_removes_stale_staging() {
    let place = Place::with_inputs(CHAIN, 2);
    place.input("held", b"a held one");
    let mut run = Running::start(place.held(&[]));
    run.wait_for(&place, "held");
    let mut kill = Command::new("kill");
    kill.args(["-9", &run.child.id().to_string()]);
    well(kill);
    run.finish();
    assert!(fs::read_dir(place.lake().join("staging")).unwrap().count() > 0);
    gc(&place, &[]);
    assert_eq!(
        fs::read_dir(place.lake().join("staging")).unwrap().count(),
        0
    );
    let mut locks = fs::read_dir(place.lake().join("locks")).unwrap();
    assert!(locks.all(|lock| lock.unwrap().file_name() == "collecting"));
    place.run_well(&[]);
    assert_whole(&place);
}

#[test]
fn a_folder_without_a_lake_is_refused_and_stays_as_it_is() {
    let place = Place::with_inputs(CHAIN, 1);
    for (folder, command) in [
        (place.lake(), "gc"),
        (place.lake(), "verify"),
        (place.inputs(), "gc"),
        (place.inputs(), "verify"),
    ] {
        let refused = place.bare(&folder, command).output().unwrap();
        let said = stderr(&refused);
        assert_eq!(refused.status.code(), Some(2), "{command}: {said}");
        let what = format!("no lake in `{}`", folder.display());
        assert!(said.contains(&what), "{command}: {said}");
        assert!(said.contains("--lake DIR"), "{command}: {said}");
        assert_eq!(stdout(&refused), "");
    }
    assert!(!place.lake().exists());
    assert_eq!(files_below(&place.inputs()).len(), 1);
}
