//! Several processes in one lake.

use std::{collections::BTreeMap, process::Stdio};

use crate::engine::{
    place::{Place, Running, assert_same, stderr},
    program_maps::Maps,
};

/// Two branches that share their first two stages.
const BRANCHES: &str = r#"
[stages.split]
kind = "split"
root = "INPUTS"

[stages.trunk]
kind = "map"
inputs.parts = "split.parts"
add = 1

[stages.left]
kind = "map"
inputs.parts = "trunk.parts"
add = 2

[stages.left_table]
kind = "gather"
inputs.parts = "left.parts"

[stages.right]
kind = "map"
inputs.parts = "trunk.parts"
add = 3

[stages.right_table]
kind = "group"
inputs.parts = "right.parts"
"#;

#[test]
fn processes_with_overlapping_targets_make_each_unit_once() {
    overlapping_targets(Maps::Stages);
    overlapping_targets(Maps::Programs);
}

fn overlapping_targets(maps: Maps) {
    const TARGETS: [&[&str]; 8] = [
        &[],
        &["--until", "left_table"],
        &["--until", "right_table"],
        &["--until", "trunk"],
        &[],
        &["--until", "left"],
        &["--until", "right"],
        &["--until", "split"],
    ];
    let place = Place::with_inputs(&maps.of(BRANCHES), 12);
    let processes = TARGETS.map(|target| {
        let mut command = place.command("run", target);
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        command.spawn().unwrap()
    });
    for (process, target) in processes.into_iter().zip(TARGETS) {
        let output = process.wait_with_output().unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(0), "{target:?}: {said}");
    }
    let mut executions = BTreeMap::new();
    for execution in place.take_log() {
        *executions.entry(execution).or_insert(0) += 1;
    }
    let again: Vec<_> = executions.iter().filter(|(_, count)| **count > 1).collect();
    assert!(again.is_empty(), "made more than once: {again:?}");
    assert_eq!(executions.len(), 4 * 12 + 2);
    assert_same(&place.published(), &place.undisturbed(&[]), "");
    place.run_well(&[]);
    assert!(place.take_log().is_empty());
}

#[test]
fn waiting_process_names_the_lock_holder() {
    let place = Place::with_inputs(BRANCHES, 1);
    place.input("held", b"a held one");
    place.let_go("p000");
    let mut first = Running::start(place.held(&["--until", "split"]));
    first.wait_for(&place, "held");
    let mut second = Running::start(place.held(&["--until", "split"]));
    let process = format!("waiting for process {}", first.child.id());
    second.wait_for_line("for whom it waits", |line| {
        line.contains(&process) && line.contains("split") && line.contains("held")
    });
    place.let_go("held");
    for running in [first, second] {
        let (code, said) = running.finish();
        assert_eq!(code, Some(0), "{said}");
    }
    assert_eq!(place.take_log().len(), 2);
}

#[test]
fn the_lock_of_a_process_that_died_is_taken_over() {
    lock_is_taken_over(Maps::Stages);
    lock_is_taken_over(Maps::Programs);
}

fn lock_is_taken_over(maps: Maps) {
    let place = Place::with_inputs(&maps.of(BRANCHES), 1);
    place.input("held", b"a held one");
    place.let_go("p000");
    let mut first = Running::start(place.held(&[]));
    first.wait_for(&place, "held");
    let second = Running::start(place.held(&[]));
    first.child.kill().unwrap();
    first.finish();
    place.let_go("held");
    place.let_go("all");
    place.let_go("a");
    let (code, said) = second.finish();
    assert_eq!(code, Some(0), "{said}");
    assert_same(&place.published(), &place.undisturbed(&[]), "");
}
