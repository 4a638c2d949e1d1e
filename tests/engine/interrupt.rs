//! Ctrl-C.

use std::{fs, os::unix::process::CommandExt, process::Command};

use crate::engine::place::{CHAIN, Place, Running, assert_same, well};

/// Whom the signal reaches.
#[derive(Clone, Copy)]
enum Reaches {
    /// The run's own process, as a service manager does it.
    Run,
    /// The run and every process that it has started, as a terminal does it.
    Group,
}

#[test]
fn an_interrupted_run_leaves_nothing_half_made() {
    interrupt(&[], Reaches::Run);
}

#[test]
fn an_interrupted_run_of_processes_leaves_nothing_half_made() {
    interrupt(&["--processes"], Reaches::Run);
    interrupt(&["--processes"], Reaches::Group);
}

fn interrupt(flags: &[&str], reaches: Reaches) {
    let place = Place::with_inputs(CHAIN, 2);
    place.input("held", b"a held one");
    place.let_go("p000");
    place.let_go("p001");
    let mut command = place.held(flags);
    command.args(["--jobs", "2"]).process_group(0);
    let mut run = Running::start(command);
    run.wait_for(&place, "held");
    // The other of two workers comes to the second one when it has kept the first one.
    run.wait_for(&place, "p001");
    let process = run.child.id();
    let target = match reaches {
        Reaches::Run => process.to_string(),
        Reaches::Group => format!("-{process}"),
    };
    let mut kill = Command::new("kill");
    kill.args(["-INT", "--", &target]);
    well(kill);
    let (code, said) = run.finish();
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("interrupted"), "{said}");
    let left = fs::read_dir(place.lake().join("staging"));
    let left: Vec<_> = left.into_iter().flatten().flatten().collect();
    assert!(left.is_empty(), "{left:?}");
    assert!(place.log().iter().all(|made| made.kind == "split"));

    place.take_log();
    place.run_well(flags);
    let again = place.take_log();
    let split = again.iter().filter(|made| made.kind == "split");
    let split: Vec<&str> = split.map(|made| &*made.partition).collect();
    assert!(split.contains(&"held"), "{split:?}");
    assert!(!split.contains(&"p000"), "it was finished: {split:?}");
    assert_same(&place.published(), &place.undisturbed(&[]), "");
}
