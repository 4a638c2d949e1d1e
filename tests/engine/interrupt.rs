//! Ctrl-C.

use std::process::Command;

use crate::place::{CHAIN, Place, Running, assert_same, files_below, well};

#[test]
fn an_interrupted_run_leaves_nothing_half_made() {
    interrupt(&[]);
}

#[test]
fn an_interrupted_run_of_processes_leaves_nothing_half_made() {
    interrupt(&["--processes"]);
}

fn interrupt(flags: &[&str]) {
    let place = Place::with_inputs(CHAIN, 2);
    place.input("held", b"a held one");
    place.let_go("p000");
    place.let_go("p001");
    let mut run = Running::start(place.held(flags));
    run.wait_for(&place, "held");
    let mut kill = Command::new("kill");
    kill.args(["-INT", &run.child.id().to_string()]);
    well(kill);
    let (code, said) = run.finish();
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("interrupted"), "{said}");
    let left = files_below(&place.lake().join("staging"));
    assert!(left.is_empty(), "{left:?}");
    assert!(place.log().iter().all(|made| made.kind == "split"));

    place.take_log();
    place.run_well(flags);
    let again = place.take_log();
    let split = again.iter().filter(|made| made.kind == "split");
    let split: Vec<&str> = split.map(|made| &*made.partition).collect();
    assert!(split.contains(&"held"), "{split:?}");
    assert!(split.len() < 3, "finished units were made again: {split:?}");
    assert_same(&place.published(), &place.undisturbed(&[]), "");
}
