//! An interrupted unit resumes from its saved state.

use std::{
    fs::{self, File},
    os::unix::process::CommandExt,
    process::Command,
    time::{Duration, SystemTime},
};

use serde_json::Value;

use crate::engine::place::{Place, Running, assert_same, stderr, well};

const STEPS: &str = r#"
[stages.steps]
kind = "steps"
count = 6
"#;

const DAY: Duration = Duration::from_hours(24);

/// Returns the steps computed since the last call.
fn take_steps(place: &Place) -> Vec<String> {
    place.take_log().into_iter().map(|made| made.kind).collect()
}

/// Lists the saved state of interrupted units in the lake, by folder and file.
fn left(place: &Place) -> Vec<String> {
    let folder = place.lake().join("resume");
    let mut left = Vec::new();
    for unit in fs::read_dir(folder).into_iter().flatten().flatten() {
        left.push(unit.file_name().into_string().unwrap());
        for file in fs::read_dir(unit.path()).unwrap() {
            left.push(file.unwrap().file_name().into_string().unwrap());
        }
    }
    left
}

/// Runs until a step fails.
fn fail_at(place: &Place, moment: &str, arguments: &[&str]) {
    let mut run = place.command("run", arguments);
    let failed = run.env("OWN_STAGES_FAIL", moment).output().unwrap();
    let said = stderr(&failed);
    assert_eq!(failed.status.code(), Some(1), "{said}");
    assert!(
        said.contains(&format!("fails at `{moment}`, as asked for")),
        "{said}"
    );
}

fn assert_goes_on(place: &Place, flags: &[&str], expected: &[&str]) {
    assert_eq!(
        left(place).len(),
        2,
        "one unit, one file: {:?}",
        left(place)
    );
    take_steps(place);
    place.run_well(flags);
    assert_eq!(take_steps(place), expected);
    assert_eq!(left(place), Vec::<String>::new());
    assert_same(&place.published(), &place.undisturbed(&[]), "");
}

#[test]
fn a_unit_that_failed_goes_on_where_it_was() {
    for flags in [&[][..], &["--processes"]] {
        let place = Place::new(STEPS);
        fail_at(&place, "step4", flags);
        assert_eq!(
            take_steps(&place),
            ["step0", "step1", "step2", "step3", "step4"]
        );
        assert_goes_on(&place, flags, &["step4", "step5"]);
    }
}

#[test]
fn a_unit_that_failed_at_its_end_computes_nothing_again() {
    let place = Place::new(STEPS);
    fail_at(&place, "end", &[]);
    assert_goes_on(&place, &[], &[]);
}

#[test]
fn a_unit_that_was_stopped_or_killed_goes_on_where_it_was() {
    for signal in ["-INT", "-KILL"] {
        for flags in [&[][..], &["--processes"]] {
            let place = Place::new(STEPS);
            for step in ["step0", "step1", "step2"] {
                place.let_go(step);
            }
            let mut command = place.held(flags);
            command.process_group(0);
            let mut run = Running::start(command);
            run.wait_for_log(&place, "step3", |made| made.kind == "step3");
            let mut kill = Command::new("kill");
            // The unit's own process too, as a power failure takes it.
            kill.args([signal, "--", &format!("-{}", run.child.id())]);
            well(kill);
            run.finish();
            assert_goes_on(&place, flags, &["step3", "step4", "step5"]);
        }
    }
}

#[test]
fn changed_units_and_fresh_runs_ignore_resume_state() {
    let place = Place::new(STEPS);
    fail_at(&place, "step3", &[]);
    take_steps(&place);
    place.run_well(&["--set", "steps.count=2"]);
    assert_eq!(take_steps(&place), ["step0", "step1"]);
    assert_eq!(left(&place).len(), 2, "the other one's is left alone");
    place.run_well(&["--fresh"]);
    assert_eq!(take_steps(&place).len(), 6);
    assert_eq!(left(&place), Vec::<String>::new());
}

#[test]
fn stale_resume_state_is_collected() {
    let place = Place::new(STEPS);
    // Leaves something to collect besides.
    fail_at(&place, "step3", &[]);
    well(place.bare(&place.lake(), "verify"));
    assert_eq!(gc(&place), 0);
    assert_eq!(left(&place).len(), 2);
    let now = SystemTime::now();
    set_age(&place, now - 6 * DAY);
    assert_eq!(gc(&place), 0);
    set_age(&place, now - 8 * DAY);
    assert_eq!(n_leftovers(&place, &["--dry-run"]), 1);
    assert_eq!(left(&place).len(), 2, "only counted");
    // A live run owns it, however old it is.
    take_steps(&place);
    let mut run = Running::start(place.held(&[]));
    run.wait_for_log(&place, "step3", |made| made.kind == "step3");
    assert_eq!(gc(&place), 0);
    assert_eq!(left(&place).len(), 2);
    run.child.kill().unwrap();
    run.finish();
    gc(&place);
    assert_eq!(left(&place), Vec::<String>::new());
    take_steps(&place);
    place.run_well(&[]);
    assert_eq!(take_steps(&place).len(), 6);
}

#[test]
fn resume_state_of_a_finished_unit_is_collected_at_once() {
    let place = Place::new(STEPS);
    fail_at(&place, "step3", &[]);
    let unit = left(&place).remove(0);
    place.run_well(&[]);
    // As if the program had been killed right after it kept the unit.
    fs::create_dir_all(place.lake().join("resume").join(unit)).unwrap();
    assert_eq!(gc(&place), 1);
    assert_eq!(left(&place), Vec::<String>::new());
}

/// Number of leftovers that `gc` removes.
fn gc(place: &Place) -> u64 {
    n_leftovers(place, &[])
}

fn n_leftovers(place: &Place, arguments: &[&str]) -> u64 {
    let mut command = place.bare(&place.lake(), "gc");
    command.args(["--format", "json"]).args(arguments);
    let said: Value = serde_json::from_slice(&well(command).stdout).unwrap();
    said["n_leftovers"].as_u64().unwrap()
}

/// Makes everything that was left look as if it had been written then.
fn set_age(place: &Place, written: SystemTime) {
    for unit in fs::read_dir(place.lake().join("resume")).unwrap() {
        let unit = unit.unwrap().path();
        for file in fs::read_dir(&unit).unwrap() {
            let file = File::open(file.unwrap().path()).unwrap();
            file.set_modified(written).unwrap();
        }
        File::open(&unit).unwrap().set_modified(written).unwrap();
    }
}
