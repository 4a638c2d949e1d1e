//! Units made in separate processes that share only the lake and the pipeline file.

use std::{collections::BTreeSet, fs};

use crate::engine::{
    place::{CHAIN, Place, assert_same, published, well},
    program_maps::Maps,
};

#[test]
fn processes_give_the_same_bytes_as_threads() {
    by_processes_and_threads(Maps::Stages);
    by_processes_and_threads(Maps::Programs);
}

fn by_processes_and_threads(maps: Maps) {
    let place = Place::with_inputs(&maps.of(CHAIN), 6);
    place.input("bad", b"bad, so that something is skipped");
    let threads = place.command("run", &[]).output().unwrap();
    assert_eq!(threads.status.code(), Some(3));
    let by_threads = place.take_log();
    let lake = place.path("lake_of_processes");
    let mut processes = place.command_in(&lake, "run", &["--processes"]);
    let processes = processes.output().unwrap();
    assert_eq!(processes.status.code(), Some(3));
    assert_same(&published(&lake), &place.published(), "");
    let units = |mut log: Vec<_>| {
        log.sort();
        log
    };
    assert_eq!(units(place.take_log()), units(by_threads));
    // Each finds what the other made.
    for flags in [&["--processes"][..], &[]] {
        let again = place.command("run", flags).output().unwrap();
        assert_eq!(again.status.code(), Some(3));
    }
    assert!(place.take_log().is_empty());
}

#[test]
fn a_process_makes_one_unit_after_the_other() {
    let place = Place::with_inputs(CHAIN, 12);
    place.run_well(&["--processes", "--jobs", "2", "--until", "first"]);
    let log = fs::read_to_string(place.log_file()).unwrap();
    for kind in ["split", "map"] {
        let lines = log.lines().filter(|line| line.starts_with(kind));
        let processes: Vec<&str> = lines.filter_map(|line| line.split(' ').nth(3)).collect();
        assert_eq!(processes.len(), 12, "{log}");
        let n_processes = processes.iter().collect::<BTreeSet<_>>().len();
        assert!((1..=2).contains(&n_processes), "{log}");
    }
}

#[test]
fn one_unit_is_made_by_its_name() {
    one_by_name(Maps::Stages);
    one_by_name(Maps::Programs);
}

fn one_by_name(maps: Maps) {
    let place = Place::with_inputs(&maps.of(CHAIN), 3);
    for (artifact, partition) in [("split.parts", "p001"), ("first.parts", "p001")] {
        well(place.command("unit", &[artifact, partition]));
        let made = place.take_log();
        assert_eq!(made.len(), 1, "{artifact}: {made:?}");
        assert_eq!(made[0].partition, partition);
    }
    well(place.command("unit", &["first.parts", "p001"]));
    assert!(place.take_log().is_empty(), "it was there");
    place.run_well(&[]);
    assert_eq!(place.take_log().len(), 2 + 2 + 3 + 1 + 1);
    assert_same(&place.published(), &place.undisturbed(&[]), "");
}

#[test]
fn malformed_event_of_a_process_fails_its_unit() {
    let place = Place::with_inputs(CHAIN, 1);
    // The stage notes on its stdout that it begins: between the events of its process.
    let mut run = place.command("run", &["--processes"]);
    let failed = run.env("OWN_STAGES_LOG", "/dev/stdout").output().unwrap();
    assert_eq!(failed.status.code(), Some(1));
    let text = String::from_utf8_lossy(&failed.stderr);
    for part in [
        "error: the process that made `split.parts` at `p000` broke the protocol: `split parts p000",
        "is not an event",
        "hint: run the same command again without `--processes`",
    ] {
        assert!(text.contains(part), "{text}");
    }
    place.run_well(&["--processes"]);
    assert_same(&place.published(), &place.undisturbed(&[]), "");
}
