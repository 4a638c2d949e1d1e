//! Runs in the background: they go on without their terminal, and `attach` shows them and ends as they do.

use std::{fs, process::Command};

use crate::engine::place::{CHAIN, Place, Running, stderr, stdout, well};

/// Starts a run in the background whose units wait; returns the number of its process.
fn detach(place: &Place) -> String {
    let said = stderr(&well(place.held(&["--detach", "--until", "split"])));
    assert!(said.contains("next   `pipeline attach 1`"), "{said}");
    let (_, rest) = said.split_once("process ").unwrap();
    rest.split(';').next().unwrap().to_owned()
}

fn attach(place: &Place) -> Command {
    place.bare(&place.lake(), "attach")
}

fn kill(signal: &str, process: &str) {
    let mut kill = Command::new("kill");
    kill.args([signal, process]);
    well(kill);
}

#[test]
fn detached_run_goes_on_and_is_attached_to_again_and_again() {
    let place = Place::with_inputs(CHAIN, 2);
    let process = detach(&place);
    let mut first = Running::start(attach(&place));
    first.wait_for_line("what it shows", |line| line.starts_with("attach run 1,"));
    first.wait_for(&place, "p000");
    kill("-INT", &first.child.id().to_string());
    let (code, said) = first.finish();
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("left   run 1 goes on"), "{said}");
    let second = Running::start(attach(&place));
    for partition in ["p000", "p001"] {
        place.let_go(partition);
    }
    let (code, said) = second.finish();
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains(&format!("process {process};")), "{said}");
    let last = attach(&place).output().unwrap();
    assert_eq!(last.status.code(), Some(0));
    assert!(
        stdout(&last).contains("done   2 files"),
        "{}",
        stdout(&last)
    );
    assert_eq!(place.take_log().len(), 2);
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let unwritten = attach(&place).stdout(full).output().unwrap();
    assert_eq!(unwritten.status.code(), Some(1));
    let said = stderr(&unwritten);
    assert!(said.contains("no space left on the disk"), "{said}");
}

#[test]
fn attach_ends_with_the_exit_code_of_the_run_or_says_that_there_is_none() {
    let place = Place::with_inputs(CHAIN, 6);
    place.input("bad", b"bad, so that something is skipped");
    detach(&place);
    for partition in ["p000", "p001", "p002", "p003", "p004", "p005", "bad"] {
        place.let_go(partition);
    }
    let skipped = attach(&place).output().unwrap();
    assert_eq!(skipped.status.code(), Some(3), "{}", stdout(&skipped));

    let place = Place::with_inputs(CHAIN, 1);
    kill("-9", &detach(&place));
    let killed = attach(&place).output().unwrap();
    assert_eq!(killed.status.code(), Some(1));
    assert!(
        stderr(&killed).contains("it was interrupted or killed"),
        "{}",
        stderr(&killed)
    );
}

#[test]
fn run_that_cannot_begin_says_so_at_once() {
    let place = Place::with_inputs(CHAIN, 1);
    let refused = place
        .command("run", &["--detach", "--until", "splt"])
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(stdout(&refused).contains("splt"), "{}", stdout(&refused));
    assert_eq!(
        fs::read_dir(place.lake().join("detached")).unwrap().count(),
        0
    );
    let nothing = attach(&place).output().unwrap();
    assert_eq!(nothing.status.code(), Some(2));
    assert!(
        stderr(&nothing).contains("no run was detached"),
        "{}",
        stderr(&nothing)
    );
}
